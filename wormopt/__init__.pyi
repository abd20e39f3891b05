# Each comment "Group: ..." heads the names below it, in `help(wormopt)` and in the reference.
# ruff: noqa: I001

# Group: Worms and gaits
from wormopt.systems.spiked.gait_problem import Worm as Worm
from wormopt.systems.spiked.limits import Limits as Limits
from wormopt.systems.spiked.limits import Rates as Rates
from wormopt.systems.spiked.gait_problem import Objective as Objective
from wormopt.systems.spiked.gait_problem import Search as Search
from wormopt.systems.spiked.gait_problem import GaitProblem as GaitProblem
from wormopt.systems.spiked.design.design import Design as Design
from wormopt.systems.spiked.design.optimize import design as design
from wormopt.systems.spiked.design.sensitivity import Sensitivity as Sensitivity
from wormopt.systems.spiked.design.sensitivity import sensitivities as sensitivities
from wormopt.systems.spiked.certify.certified import Certified as Certified
from wormopt.systems.spiked.certify.certified import certify as certify
from wormopt.systems.spiked.certify.certificate import Certificate as Certificate
from wormopt.systems.spiked.certify.certificate import Verification as Verification
from wormopt.systems.spiked.certify.certificate import verify as verify
from wormopt.systems.spiked.verify import violations as violations
from wormopt.systems.spiked.crawl import crawl as crawl
from wormopt.systems.spiked.construct import fast_gait as fast_gait
from wormopt.systems.spiked.construct import travelling_sine as travelling_sine
from wormopt.model.gait import Gait as Gait
from wormopt.systems.spiked.construct import load_gait as load_gait
from wormopt.systems.spiked import stepper as stepper
from wormopt.systems import peristaltic as peristaltic

# Group: Models and contact
from wormopt.model.model import Model as Model
from wormopt.model.model import Signal as Signal
from wormopt.model.model import Output as Output
from wormopt.model.model import Switch as Switch
from wormopt.model.model import Contact as Contact
from wormopt.model.friction import Law as Law
from wormopt.model.friction import Coulomb as Coulomb
from wormopt.model.friction import Stribeck as Stribeck
from wormopt.model.friction import Viscous as Viscous
from wormopt.model.friction import Spike as Spike
from wormopt.model.friction import NoSlip as NoSlip
from wormopt.model.modes import ModeSequence as ModeSequence
from wormopt.model.schedule import Schedule as Schedule
from wormopt.model.schedule import Delay as Delay
from wormopt.systems.chain.build import chain as chain
from wormopt.systems.chain.copies import scenario_model as scenario_model
from wormopt.simulation.walls import smooth_walls as smooth_walls

# Group: Simulation
from wormopt.simulation.simulate import simulate as simulate
from wormopt.simulation.trajectory import Trajectory as Trajectory
from wormopt.simulation.trajectory import Event as Event
from wormopt.simulation.trajectory import NonsmoothEvent as NonsmoothEvent
from wormopt.numerics.options import Exact as Exact
from wormopt.numerics.options import Smooth as Smooth
from wormopt.numerics.options import Tolerance as Tolerance
from wormopt.simulation.moreau import MoreauJean as MoreauJean
from wormopt.simulation.periodic import PeriodicOrbit as PeriodicOrbit
from wormopt.simulation.periodic import periodic_orbit as periodic_orbit
from wormopt.simulation.gradient import Gradient as Gradient
from wormopt.simulation.gradient import gradient as gradient

# Group: Control
from wormopt.control.drive import drive as drive
from wormopt.control.interconnect import interconnect as interconnect
from wormopt.control.interconnect import controller_of as controller_of
from wormopt.control.lambda_tracker import lambda_tracker as lambda_tracker
from wormopt.control.lambda_tracker import Quadratic as Quadratic
from wormopt.control.lambda_tracker import Decay as Decay
from wormopt.control.lambda_tracker import Exponent as Exponent
from wormopt.control.funnel import Funnel as Funnel
from wormopt.control.funnel import funnel_tracker as funnel_tracker
from wormopt.control.switching import switching_tracker as switching_tracker
from wormopt.control.loop import Reference as Reference
from wormopt.control.loop import gait_reference as gait_reference
from wormopt.control.loop import FeedForward as FeedForward
from wormopt.control.lqr import lqr as lqr
from wormopt.systems.chain.compare import compare as compare
from wormopt.systems.chain.hardware import Hardware as Hardware
from wormopt.control.predictive import plan_mpc as plan_mpc
from wormopt.control.predictive import run_mpc as run_mpc
from wormopt.control.predictive import MpcOptions as MpcOptions
from wormopt.control.estimation import Estimation as Estimation

# Group: Optimal control
from wormopt.ocp.problem import Problem as Problem
from wormopt.ocp.problem import Constraint as Constraint
from wormopt.ocp.problem import Ends as Ends
from wormopt.numerics.collocation import Collocation as Collocation
from wormopt.ocp.mesh import Mesh as Mesh
from wormopt.ocp.contact import Regularised as Regularised
from wormopt.ocp.contact import Complementarity as Complementarity
from wormopt.ocp.contact import FixedModes as FixedModes
from wormopt.ocp.motion import Guess as Guess
from wormopt.ocp.motion import Motion as Motion
from wormopt.ocp.optimise import Optimum as Optimum
from wormopt.ocp.optimise import optimise as optimise
from wormopt.ocp.optimise import refine as refine
from wormopt.ocp.optimise import optimise_multistart as optimise_multistart
from wormopt.ocp.switching import optimise_switching_times as optimise_switching_times
from wormopt.ocp.nlp import Ipopt as Ipopt
from wormopt.ocp.nlp import Plugin as Plugin

# Group: Analysis
from wormopt.analysis.average import average as average
from wormopt.analysis.steady import steady_states as steady_states
from wormopt.analysis.steady import SteadyState as SteadyState
from wormopt.analysis.steady import steady_sensitivity as steady_sensitivity
from wormopt.analysis.steady import SteadySensitivity as SteadySensitivity
from wormopt.analysis.continuation import continue_branch as continue_branch
from wormopt.analysis.continuation import Branch as Branch
from wormopt.analysis.linearise import linearise as linearise
from wormopt.analysis.linearise import LinearModel as LinearModel
from wormopt.analysis.bode import bode as bode
from wormopt.analysis.vibration import vibration_modes as vibration_modes
from wormopt.analysis.vibration import VibrationModes as VibrationModes
from wormopt.analysis.normal_form import normal_form as normal_form
from wormopt.analysis.normal_form import NormalForm as NormalForm
from wormopt.analysis.normal_form import relative_degree as relative_degree

# Group: Fitting and experiments
from wormopt.fitting.recording import Recording as Recording
from wormopt.fitting.experiment import Experiment as Experiment
from wormopt.fitting.unknowns import Unknown as Unknown
from wormopt.fitting.task import FitTask as FitTask
from wormopt.fitting.fit import fit as fit
from wormopt.fitting.estimate import Fit as Fit
from wormopt.fitting.estimate import Attempt as Attempt
from wormopt.fitting.identifiability import identifiability as identifiability
from wormopt.fitting.posterior import posterior as posterior
from wormopt.fitting.prediction import predict as predict
from wormopt.fitting.profile import profile as profile
from wormopt.fitting.noise import whiteness as whiteness
from wormopt.fitting.planning import plan_experiment as plan_experiment
from wormopt.fitting.planning import Plan as Plan
from wormopt.fitting.experiment import mean_rate as mean_rate
from wormopt.fitting.choices import Constant as Constant
from wormopt.fitting.choices import Ramps as Ramps
from wormopt.fitting.choices import Waves as Waves

# Group: Magnetics, films and coils
from wormopt import magnetics as magnetics
from wormopt.systems import film as film
from wormopt.systems import pair as pair

# Group: Planar robots and channels
from wormopt.systems import planar as planar
from wormopt.model.planar_friction import Elliptic as Elliptic
from wormopt.model.planar_friction import PlanarLaw as PlanarLaw
from wormopt.model.planar_friction import AnisotropicCoulomb as AnisotropicCoulomb
from wormopt.systems import channel as channel

# Group: Families: sweeps and ensembles
from wormopt.families.sweep import sweep as sweep
from wormopt.simulation.ensemble import simulate_ensemble as simulate_ensemble
from wormopt.simulation.ensemble import Ensemble as Ensemble
from wormopt.simulation.ensemble import Scenario as Scenario
from wormopt.numerics.workers import Engine as Engine

# Group: Results and files
from wormopt.study import load_scene as load_scene
from wormopt.study import Scene as Scene
from wormopt.runner import run as run
from wormopt.runner import load as load
from wormopt.result import Result as Result
from wormopt.result import Check as Check
from wormopt.quantities import Scalar as Scalar
from wormopt.quantities import Variable as Variable
from wormopt.reports.report import report as report
from wormopt.pictures import draw as draw
from wormopt.exports.export import export as export
from wormopt.errors import WormoptError as WormoptError
from wormopt.errors import ArgumentError as ArgumentError
from wormopt.errors import UnknownNameError as UnknownNameError
from wormopt.errors import SceneError as SceneError
from wormopt.errors import SolveError as SolveError
from wormopt.errors import Interrupted as Interrupted

__all__: list[str]
__version__: str
