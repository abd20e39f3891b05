"""Design, simulation and optimal control of worm-like locomotion systems.

Public names are loaded on first use, so that importing the package costs nothing.

>>> import wormopt as wo
>>> scene = wo.load_scene("fast_gait")
>>> result = wo.run(scene)
>>> round(result.scalars["speed"].value, 9)
1.2
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

from wormopt.version import VERSION

if TYPE_CHECKING:
    from wormopt.analysis.average import average
    from wormopt.analysis.bode import bode
    from wormopt.analysis.continuation import Branch, follow_branch
    from wormopt.analysis.lie import relative_degree
    from wormopt.analysis.linearise import Linear, linearise
    from wormopt.analysis.steady import SteadyState, steady_states
    from wormopt.analysis.vibration import Modes, vibration_modes
    from wormopt.control.drive import drive
    from wormopt.control.funnel import Funnel, funnel_tracker
    from wormopt.control.lambda_tracker import Decay, Exponent, Quadratic, lambda_tracker
    from wormopt.control.loop import FeedForward
    from wormopt.control.lqr import lqr
    from wormopt.control.reference import Reference, follow
    from wormopt.errors import (
        ArgumentError,
        Interrupted,
        SceneError,
        SolveError,
        UnknownNameError,
        WormoptError,
    )
    from wormopt.magnetics.coils import CoilRow
    from wormopt.magnetics.identify import Identification, identify_material
    from wormopt.magnetics.material import MagnetoElastic
    from wormopt.magnetics.travelling import MovingProfile, moving_profile, switched_course
    from wormopt.magnetics.winding import Coil
    from wormopt.model.friction import Coulomb, Law, Spike, Stribeck, Viscous
    from wormopt.model.gait import Gait
    from wormopt.model.model import Contact, Model, Output, Schedule, Signal, Switch
    from wormopt.model.modes import ModeSequence
    from wormopt.numerics.collocation import Collocation
    from wormopt.ocp.contact import Complementary, Prescribed, Smoothed
    from wormopt.ocp.mesh import Mesh
    from wormopt.ocp.motion import Guess, Motion
    from wormopt.ocp.nlp import Ipopt, Plugin
    from wormopt.ocp.optimise import Optimum, best_of, optimise, refine
    from wormopt.ocp.polish import polish
    from wormopt.ocp.problem import Bound, Ends, Problem
    from wormopt.quantities import Scalar, Variable
    from wormopt.result import Result
    from wormopt.runner import run
    from wormopt.scene import Scene, load_scene
    from wormopt.simulation.ensemble import Ensemble, Member, simulate_ensemble
    from wormopt.simulation.moreau import Marcher
    from wormopt.simulation.options import Exact, Smooth, Tolerance
    from wormopt.simulation.simulate import simulate
    from wormopt.simulation.trajectory import Event, Trajectory
    from wormopt.simulation.walls import smooth_walls
    from wormopt.systems.chain.build import chain
    from wormopt.systems.chain.copies import copies
    from wormopt.systems.channel.channel_rod import channel_rod
    from wormopt.systems.channel.closed_forms import ChannelWorm
    from wormopt.systems.channel.rod import Rod
    from wormopt.systems.film.cosine import CosineWave
    from wormopt.systems.film.float import float_drift, floating, tracers
    from wormopt.systems.film.shapes import FourierWave
    from wormopt.systems.film.thin_film import thin_film
    from wormopt.systems.film.units import Fluid
    from wormopt.systems.pair.averaged_pair import averaged_pair, steady_pair
    from wormopt.systems.pair.magnetic_pair import magnetic_pair
    from wormopt.systems.pair.slow_pair import slow_pair
    from wormopt.systems.spiked.certify.proof import Certificate, Certified, certify
    from wormopt.systems.spiked.construct import fast_gait, travelling_sine
    from wormopt.systems.spiked.crawl import crawl
    from wormopt.systems.spiked.design.design import Design
    from wormopt.systems.spiked.design.optimize import design
    from wormopt.systems.spiked.design.sensitivity import Sensitivity, sensitivities
    from wormopt.systems.spiked.files import load_gait
    from wormopt.systems.spiked.limits import Limits, Rates
    from wormopt.systems.spiked.stepper.bristles import ratchet
    from wormopt.systems.spiked.stepper.stepper import Stepper
    from wormopt.systems.spiked.stepper.steps import step_times
    from wormopt.systems.spiked.task import Objective, Search, Task, Worm
    from wormopt.systems.spiked.verify import violations

__version__ = VERSION

# Public name -> module it lives in. The imports above repeat it for type checkers.
_HOMES = {
    "ArgumentError": "wormopt.errors",
    "Bound": "wormopt.ocp.problem",
    "Branch": "wormopt.analysis.continuation",
    "Certificate": "wormopt.systems.spiked.certify.proof",
    "Certified": "wormopt.systems.spiked.certify.proof",
    "ChannelWorm": "wormopt.systems.channel.closed_forms",
    "Coil": "wormopt.magnetics.winding",
    "CoilRow": "wormopt.magnetics.coils",
    "Collocation": "wormopt.numerics.collocation",
    "Complementary": "wormopt.ocp.contact",
    "Contact": "wormopt.model.model",
    "CosineWave": "wormopt.systems.film.cosine",
    "Coulomb": "wormopt.model.friction",
    "Decay": "wormopt.control.lambda_tracker",
    "Design": "wormopt.systems.spiked.design.design",
    "Ends": "wormopt.ocp.problem",
    "Ensemble": "wormopt.simulation.ensemble",
    "Event": "wormopt.simulation.trajectory",
    "Exact": "wormopt.simulation.options",
    "Exponent": "wormopt.control.lambda_tracker",
    "FeedForward": "wormopt.control.loop",
    "Fluid": "wormopt.systems.film.units",
    "FourierWave": "wormopt.systems.film.shapes",
    "Funnel": "wormopt.control.funnel",
    "Gait": "wormopt.model.gait",
    "Guess": "wormopt.ocp.motion",
    "Identification": "wormopt.magnetics.identify",
    "Interrupted": "wormopt.errors",
    "Ipopt": "wormopt.ocp.nlp",
    "Law": "wormopt.model.friction",
    "Limits": "wormopt.systems.spiked.limits",
    "Linear": "wormopt.analysis.linearise",
    "MagnetoElastic": "wormopt.magnetics.material",
    "Marcher": "wormopt.simulation.moreau",
    "Member": "wormopt.simulation.ensemble",
    "Mesh": "wormopt.ocp.mesh",
    "ModeSequence": "wormopt.model.modes",
    "Model": "wormopt.model.model",
    "Modes": "wormopt.analysis.vibration",
    "Motion": "wormopt.ocp.motion",
    "MovingProfile": "wormopt.magnetics.travelling",
    "Objective": "wormopt.systems.spiked.task",
    "Optimum": "wormopt.ocp.optimise",
    "Output": "wormopt.model.model",
    "Plugin": "wormopt.ocp.nlp",
    "Prescribed": "wormopt.ocp.contact",
    "Problem": "wormopt.ocp.problem",
    "Quadratic": "wormopt.control.lambda_tracker",
    "Rates": "wormopt.systems.spiked.limits",
    "Reference": "wormopt.control.reference",
    "Result": "wormopt.result",
    "Rod": "wormopt.systems.channel.rod",
    "Scalar": "wormopt.quantities",
    "Scene": "wormopt.scene",
    "SceneError": "wormopt.errors",
    "Schedule": "wormopt.model.model",
    "Search": "wormopt.systems.spiked.task",
    "Sensitivity": "wormopt.systems.spiked.design.sensitivity",
    "Signal": "wormopt.model.model",
    "Smooth": "wormopt.simulation.options",
    "Smoothed": "wormopt.ocp.contact",
    "SolveError": "wormopt.errors",
    "Spike": "wormopt.model.friction",
    "SteadyState": "wormopt.analysis.steady",
    "Stepper": "wormopt.systems.spiked.stepper.stepper",
    "Stribeck": "wormopt.model.friction",
    "Switch": "wormopt.model.model",
    "Task": "wormopt.systems.spiked.task",
    "Tolerance": "wormopt.simulation.options",
    "Trajectory": "wormopt.simulation.trajectory",
    "UnknownNameError": "wormopt.errors",
    "Variable": "wormopt.quantities",
    "Viscous": "wormopt.model.friction",
    "Worm": "wormopt.systems.spiked.task",
    "WormoptError": "wormopt.errors",
    "average": "wormopt.analysis.average",
    "averaged_pair": "wormopt.systems.pair.averaged_pair",
    "best_of": "wormopt.ocp.optimise",
    "bode": "wormopt.analysis.bode",
    "certify": "wormopt.systems.spiked.certify.proof",
    "chain": "wormopt.systems.chain.build",
    "channel_rod": "wormopt.systems.channel.channel_rod",
    "copies": "wormopt.systems.chain.copies",
    "crawl": "wormopt.systems.spiked.crawl",
    "design": "wormopt.systems.spiked.design.optimize",
    "drive": "wormopt.control.drive",
    "fast_gait": "wormopt.systems.spiked.construct",
    "float_drift": "wormopt.systems.film.float",
    "floating": "wormopt.systems.film.float",
    "follow": "wormopt.control.reference",
    "follow_branch": "wormopt.analysis.continuation",
    "funnel_tracker": "wormopt.control.funnel",
    "identify_material": "wormopt.magnetics.identify",
    "lambda_tracker": "wormopt.control.lambda_tracker",
    "linearise": "wormopt.analysis.linearise",
    "load_gait": "wormopt.systems.spiked.files",
    "load_scene": "wormopt.scene",
    "lqr": "wormopt.control.lqr",
    "magnetic_pair": "wormopt.systems.pair.magnetic_pair",
    "moving_profile": "wormopt.magnetics.travelling",
    "optimise": "wormopt.ocp.optimise",
    "polish": "wormopt.ocp.polish",
    "ratchet": "wormopt.systems.spiked.stepper.bristles",
    "refine": "wormopt.ocp.optimise",
    "relative_degree": "wormopt.analysis.lie",
    "run": "wormopt.runner",
    "sensitivities": "wormopt.systems.spiked.design.sensitivity",
    "simulate": "wormopt.simulation.simulate",
    "simulate_ensemble": "wormopt.simulation.ensemble",
    "slow_pair": "wormopt.systems.pair.slow_pair",
    "smooth_walls": "wormopt.simulation.walls",
    "steady_pair": "wormopt.systems.pair.averaged_pair",
    "steady_states": "wormopt.analysis.steady",
    "step_times": "wormopt.systems.spiked.stepper.steps",
    "switched_course": "wormopt.magnetics.travelling",
    "thin_film": "wormopt.systems.film.thin_film",
    "tracers": "wormopt.systems.film.float",
    "travelling_sine": "wormopt.systems.spiked.construct",
    "vibration_modes": "wormopt.analysis.vibration",
    "violations": "wormopt.systems.spiked.verify",
}

__all__ = [
    "ArgumentError",
    "Bound",
    "Branch",
    "Certificate",
    "Certified",
    "ChannelWorm",
    "Coil",
    "CoilRow",
    "Collocation",
    "Complementary",
    "Contact",
    "CosineWave",
    "Coulomb",
    "Decay",
    "Design",
    "Ends",
    "Ensemble",
    "Event",
    "Exact",
    "Exponent",
    "FeedForward",
    "Fluid",
    "FourierWave",
    "Funnel",
    "Gait",
    "Guess",
    "Identification",
    "Interrupted",
    "Ipopt",
    "Law",
    "Limits",
    "Linear",
    "MagnetoElastic",
    "Marcher",
    "Member",
    "Mesh",
    "ModeSequence",
    "Model",
    "Modes",
    "Motion",
    "MovingProfile",
    "Objective",
    "Optimum",
    "Output",
    "Plugin",
    "Prescribed",
    "Problem",
    "Quadratic",
    "Rates",
    "Reference",
    "Result",
    "Rod",
    "Scalar",
    "Scene",
    "SceneError",
    "Schedule",
    "Search",
    "Sensitivity",
    "Signal",
    "Smooth",
    "Smoothed",
    "SolveError",
    "Spike",
    "SteadyState",
    "Stepper",
    "Stribeck",
    "Switch",
    "Task",
    "Tolerance",
    "Trajectory",
    "UnknownNameError",
    "Variable",
    "Viscous",
    "Worm",
    "WormoptError",
    "__version__",
    "average",
    "averaged_pair",
    "best_of",
    "bode",
    "certify",
    "chain",
    "channel_rod",
    "copies",
    "crawl",
    "design",
    "drive",
    "fast_gait",
    "float_drift",
    "floating",
    "follow",
    "follow_branch",
    "funnel_tracker",
    "identify_material",
    "lambda_tracker",
    "linearise",
    "load_gait",
    "load_scene",
    "lqr",
    "magnetic_pair",
    "moving_profile",
    "optimise",
    "polish",
    "ratchet",
    "refine",
    "relative_degree",
    "run",
    "sensitivities",
    "simulate",
    "simulate_ensemble",
    "slow_pair",
    "smooth_walls",
    "steady_pair",
    "steady_states",
    "step_times",
    "switched_course",
    "thin_film",
    "tracers",
    "travelling_sine",
    "vibration_modes",
    "violations",
]


def __getattr__(name: str) -> Any:
    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    value = getattr(import_module(_HOMES[name]), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted(__all__)
