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
    from wormopt.averaging.average import average
    from wormopt.averaging.continuation import Branch, follow_branch
    from wormopt.averaging.steady import SteadyState, steady_states
    from wormopt.core.friction import Coulomb, Law, Spike, Stribeck, Viscous
    from wormopt.core.gait import Gait
    from wormopt.core.limits import Limits, Rates
    from wormopt.core.model import Contact, Model, Output, Schedule, Signal, Switch
    from wormopt.core.modes import ModeSequence
    from wormopt.core.task import Objective, Search, Task, Worm
    from wormopt.errors import (
        ArgumentError,
        Interrupted,
        SceneError,
        SolveError,
        UnknownNameError,
        WormoptError,
    )
    from wormopt.gaits.certify import Certificate
    from wormopt.gaits.construct import fast_gait, travelling_sine
    from wormopt.gaits.design import Design
    from wormopt.gaits.files import load_gait
    from wormopt.gaits.optimize import design
    from wormopt.gaits.proof import Certified, certify
    from wormopt.gaits.sensitivity import Sensitivity, sensitivities
    from wormopt.gaits.verify import violations
    from wormopt.linear.bode import bode
    from wormopt.linear.lie import relative_degree
    from wormopt.linear.linearise import Linear, linearise
    from wormopt.linear.modes import Modes, vibration_modes
    from wormopt.magnetics.coils import CoilRow
    from wormopt.magnetics.identify import Identification, identify_material
    from wormopt.magnetics.material import MagnetoElastic
    from wormopt.magnetics.travelling import MovingProfile, moving_profile, switched_course
    from wormopt.magnetics.winding import Coil
    from wormopt.optimal.collocation import Collocation
    from wormopt.optimal.contact import Complementary, Prescribed, Smoothed
    from wormopt.optimal.mesh import Mesh
    from wormopt.optimal.motion import Guess, Motion
    from wormopt.optimal.nlp import Ipopt, Plugin
    from wormopt.optimal.optimise import Optimum, best_of, optimise, refine
    from wormopt.optimal.polish import polish
    from wormopt.optimal.problem import Bound, Ends, Problem
    from wormopt.result import Result, Scalar, Variable
    from wormopt.runner import run
    from wormopt.scenes import Scene, load_scene
    from wormopt.simulation.ensemble import Ensemble, Member, simulate_ensemble
    from wormopt.simulation.moreau import Marcher
    from wormopt.simulation.options import Exact, Smooth, Tolerance
    from wormopt.simulation.simulate import simulate
    from wormopt.simulation.trajectory import Event, Trajectory
    from wormopt.simulation.walls import smooth_walls
    from wormopt.tracking.drive import drive
    from wormopt.tracking.funnel import Funnel, funnel_tracker
    from wormopt.tracking.lambda_tracker import Decay, Exponent, Quadratic, lambda_tracker
    from wormopt.tracking.loop import FeedForward
    from wormopt.tracking.lqr import lqr
    from wormopt.tracking.reference import Reference, follow
    from wormopt.worms.averaged_pair import averaged_pair, steady_pair
    from wormopt.worms.bristles import ratchet
    from wormopt.worms.chain import chain
    from wormopt.worms.channel import ChannelWorm
    from wormopt.worms.channel_rod import channel_rod
    from wormopt.worms.copies import copies
    from wormopt.worms.crawl import crawl
    from wormopt.worms.drift import float_drift
    from wormopt.worms.film import CosineWave
    from wormopt.worms.film_shapes import FourierWave
    from wormopt.worms.film_units import Fluid
    from wormopt.worms.float import floating, tracers
    from wormopt.worms.magnetic_pair import magnetic_pair
    from wormopt.worms.rod import Rod
    from wormopt.worms.slow_pair import slow_pair
    from wormopt.worms.stepper import Stepper
    from wormopt.worms.steps import step_times
    from wormopt.worms.thin_film import thin_film

__version__ = VERSION

# Public name -> module it lives in. The imports above repeat it for type checkers.
_HOMES = {
    "ArgumentError": "wormopt.errors",
    "Bound": "wormopt.optimal.problem",
    "Branch": "wormopt.averaging.continuation",
    "Certificate": "wormopt.gaits.certify",
    "Certified": "wormopt.gaits.proof",
    "ChannelWorm": "wormopt.worms.channel",
    "Coil": "wormopt.magnetics.winding",
    "CoilRow": "wormopt.magnetics.coils",
    "Collocation": "wormopt.optimal.collocation",
    "Complementary": "wormopt.optimal.contact",
    "Contact": "wormopt.core.model",
    "CosineWave": "wormopt.worms.film",
    "Coulomb": "wormopt.core.friction",
    "Decay": "wormopt.tracking.lambda_tracker",
    "Design": "wormopt.gaits.design",
    "Ends": "wormopt.optimal.problem",
    "Ensemble": "wormopt.simulation.ensemble",
    "Event": "wormopt.simulation.trajectory",
    "Exact": "wormopt.simulation.options",
    "Exponent": "wormopt.tracking.lambda_tracker",
    "FeedForward": "wormopt.tracking.loop",
    "Fluid": "wormopt.worms.film_units",
    "FourierWave": "wormopt.worms.film_shapes",
    "Funnel": "wormopt.tracking.funnel",
    "Gait": "wormopt.core.gait",
    "Guess": "wormopt.optimal.motion",
    "Identification": "wormopt.magnetics.identify",
    "Interrupted": "wormopt.errors",
    "Ipopt": "wormopt.optimal.nlp",
    "Law": "wormopt.core.friction",
    "Limits": "wormopt.core.limits",
    "Linear": "wormopt.linear.linearise",
    "MagnetoElastic": "wormopt.magnetics.material",
    "Marcher": "wormopt.simulation.moreau",
    "Member": "wormopt.simulation.ensemble",
    "Mesh": "wormopt.optimal.mesh",
    "ModeSequence": "wormopt.core.modes",
    "Model": "wormopt.core.model",
    "Modes": "wormopt.linear.modes",
    "Motion": "wormopt.optimal.motion",
    "MovingProfile": "wormopt.magnetics.travelling",
    "Objective": "wormopt.core.task",
    "Optimum": "wormopt.optimal.optimise",
    "Output": "wormopt.core.model",
    "Plugin": "wormopt.optimal.nlp",
    "Prescribed": "wormopt.optimal.contact",
    "Problem": "wormopt.optimal.problem",
    "Quadratic": "wormopt.tracking.lambda_tracker",
    "Rates": "wormopt.core.limits",
    "Reference": "wormopt.tracking.reference",
    "Result": "wormopt.result",
    "Rod": "wormopt.worms.rod",
    "Scalar": "wormopt.result",
    "Scene": "wormopt.scenes",
    "SceneError": "wormopt.errors",
    "Schedule": "wormopt.core.model",
    "Search": "wormopt.core.task",
    "Sensitivity": "wormopt.gaits.sensitivity",
    "Signal": "wormopt.core.model",
    "Smooth": "wormopt.simulation.options",
    "Smoothed": "wormopt.optimal.contact",
    "SolveError": "wormopt.errors",
    "Spike": "wormopt.core.friction",
    "SteadyState": "wormopt.averaging.steady",
    "Stepper": "wormopt.worms.stepper",
    "Stribeck": "wormopt.core.friction",
    "Switch": "wormopt.core.model",
    "Task": "wormopt.core.task",
    "Tolerance": "wormopt.simulation.options",
    "Trajectory": "wormopt.simulation.trajectory",
    "UnknownNameError": "wormopt.errors",
    "Variable": "wormopt.result",
    "Viscous": "wormopt.core.friction",
    "Worm": "wormopt.core.task",
    "WormoptError": "wormopt.errors",
    "average": "wormopt.averaging.average",
    "averaged_pair": "wormopt.worms.averaged_pair",
    "best_of": "wormopt.optimal.optimise",
    "bode": "wormopt.linear.bode",
    "certify": "wormopt.gaits.proof",
    "chain": "wormopt.worms.chain",
    "channel_rod": "wormopt.worms.channel_rod",
    "copies": "wormopt.worms.copies",
    "crawl": "wormopt.worms.crawl",
    "design": "wormopt.gaits.optimize",
    "drive": "wormopt.tracking.drive",
    "fast_gait": "wormopt.gaits.construct",
    "float_drift": "wormopt.worms.drift",
    "floating": "wormopt.worms.float",
    "follow": "wormopt.tracking.reference",
    "follow_branch": "wormopt.averaging.continuation",
    "funnel_tracker": "wormopt.tracking.funnel",
    "identify_material": "wormopt.magnetics.identify",
    "lambda_tracker": "wormopt.tracking.lambda_tracker",
    "linearise": "wormopt.linear.linearise",
    "load_gait": "wormopt.gaits.files",
    "load_scene": "wormopt.scenes",
    "lqr": "wormopt.tracking.lqr",
    "magnetic_pair": "wormopt.worms.magnetic_pair",
    "moving_profile": "wormopt.magnetics.travelling",
    "optimise": "wormopt.optimal.optimise",
    "polish": "wormopt.optimal.polish",
    "ratchet": "wormopt.worms.bristles",
    "refine": "wormopt.optimal.optimise",
    "relative_degree": "wormopt.linear.lie",
    "run": "wormopt.runner",
    "sensitivities": "wormopt.gaits.sensitivity",
    "simulate": "wormopt.simulation.simulate",
    "simulate_ensemble": "wormopt.simulation.ensemble",
    "slow_pair": "wormopt.worms.slow_pair",
    "smooth_walls": "wormopt.simulation.walls",
    "steady_pair": "wormopt.worms.averaged_pair",
    "steady_states": "wormopt.averaging.steady",
    "step_times": "wormopt.worms.steps",
    "switched_course": "wormopt.magnetics.travelling",
    "thin_film": "wormopt.worms.thin_film",
    "tracers": "wormopt.worms.float",
    "travelling_sine": "wormopt.gaits.construct",
    "vibration_modes": "wormopt.linear.modes",
    "violations": "wormopt.gaits.verify",
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
