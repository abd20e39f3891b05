"""The benchmarks: what is simulated, what the answer is, and where that answer comes from."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import casadi as ca
import numpy as np

from wormopt.bench.driven_chain import DrivenChain, Grip
from wormopt.bench.event_loop import Plant, plant_of_chain
from wormopt.bench.plants import mag2_plant
from wormopt.control.lambda_tracker import Feedback, lambda_tracker
from wormopt.control.reference import follow
from wormopt.model.friction import Coulomb
from wormopt.model.model import Contact, Model, Signal
from wormopt.simulation.options import Exact, Smooth, Treatment
from wormopt.systems.chain.build import chain
from wormopt.systems.spiked.construct import fast_gait, travelling_sine

GOAL = 1e-9
"""Error in (x, v) at which times are compared."""


@dataclass(frozen=True)
class Target:
    """A ratio of times at `GOAL` that wormopt has to keep."""

    than: tuple[str, ...]  # solvers; the fastest of them counts
    most: float  # largest time of wormopt over theirs


@dataclass(frozen=True, eq=False)
class Case:
    """One benchmark of work against precision."""

    name: str
    title: str
    build: Callable[[], Model]
    contact: Treatment
    span: float  # last time
    reference: np.ndarray  # positions and velocities at the end; the model's first states
    source: str  # where the reference comes from
    solvers: tuple[str, ...]  # names of those that can take it
    targets: tuple[Target, ...] = ()  # what wormopt has to keep
    feedback: Feedback | None = None  # tracker, for hand-written right-hand sides
    plant: Callable[[], Plant] | None = None  # for the event loop
    max_step: float = math.inf  # of the event loop, where it would miss events


def track(feedback: Feedback) -> Model:
    """Benchmarks TRACK13 ("derivative") and TRACK14 ("filter"): the chapter's worm and data.

    They use the trackers (13) and (14).
    """
    worm = chain(
        2,
        mass=1.0,
        stiffness=10.0,
        damping=5.0,
        rest_length=0.0,
        law=Coulomb(1.0, 10.0),
        position=(0.0, 2.0, 4.0),
    )
    reference = follow(fast_gait(1.0), worm.t)
    return lambda_tracker(worm, reference, tube_radius=0.2, feedback=feedback)


def mag2() -> Model:
    """Benchmark MAG2: system (16) as a plain model of two masses."""
    t, x, v, force = ca.SX.sym("t"), ca.SX.sym("x", 2), ca.SX.sym("v", 2), ca.SX.sym("f", 2)
    eps = 0.036
    pull = x[0] - x[1] + eps * (1 + ca.cos((math.sqrt(2) + 0.5 * eps) * t))
    law = Coulomb(0.5 * eps, eps)
    return Model(
        "MAG2",
        x=[Signal("position", x, value=0.0), Signal("velocity", v, value=0.0)],
        ode=ca.vertcat(v, force[0] - pull, force[1] + pull),
        t=t,
        contacts=[Contact(f"mass {i}", v[i], force[i], law) for i in range(2)],
    )


_SPIKED = DrivenChain(
    mass=np.ones(3),
    stiffness=np.full(2, 40.0),
    damping=np.full(2, 2.0),
    gait=fast_gait(1.0),
    grips=[Grip.spike()] * 3,
    drag=1.0,
)
_STICK = DrivenChain(
    mass=np.ones(4),
    stiffness=np.full(3, 40.0),
    damping=np.full(3, 2.0),
    gait=travelling_sine(3, 1.0),
    grips=[Grip(1.0, 3.0, 1.5, 4.0)] * 4,
)


def long_chain(links: int) -> Model:
    """Chain of n links under a command that runs along it, with friction on every mass."""
    return DrivenChain(
        mass=np.ones(links + 1),
        stiffness=np.full(links, 40.0),
        damping=np.full(links, 2.0),
        gait=travelling_sine(links, 1.0, lag=1 / min(links, 10)),
        grips=[Grip(1.0, 3.0)] * (links + 1),
    ).model()


_SMOOTH = (
    "wormopt",
    "scipy LSODA",
    "scipy Radau",
    "scipy DOP853",
    "CasADi CVODES",
    "CasADi CVODES (Adams)",
    "CasADi IDAS",
    "scipy LSODA + numba",
    "scipy DOP853 + numba",
    "diffrax Dopri8",
    "scikit-sundae CVODE",
    "heyoka",
)
_EXACT = ("wormopt", "event loop DOP853", "event loop LSODA", "event loop Radau")
_NUMPY = ("scipy LSODA", "scipy Radau", "scipy DOP853")
_TRACK = (Target(("CasADi CVODES",), 1 / 20), Target(_NUMPY, 1 / 60))
_CLOSED = "closed form between events (bench/linear_flow.py)"

WORK_PRECISION = {
    case.name: case
    for case in (
        Case(
            "track13",
            "lambda-tracker (13), smooth friction, chapter's data, t = 10",
            lambda: track("derivative"),
            Smooth(1 / 40),
            10.0,
            np.array(
                [
                    *(13.9905483956915, 12.7643770141827, 11.4656131519066),
                    *(1.5265682540374, 1.2068425686835, 0.6714590289857),
                ]
            ),
            "13 digits by independent code, docs/verification.md",
            _SMOOTH,
            _TRACK,
            feedback="derivative",
        ),
        Case(
            "track14",
            "lambda-tracker (14), smooth friction, chapter's data, t = 10",
            lambda: track("filter"),
            Smooth(1 / 40),
            10.0,
            np.array(
                [
                    *(13.7293026425339, 12.5129899383629, 11.2234323017047),
                    *(1.5442046082437, 1.2147444914821, 0.6496895012235),
                ]
            ),
            "13 digits by independent code, docs/verification.md",
            ("wormopt", "hand-written C", *_SMOOTH[1:]),
            (*_TRACK, Target(("hand-written C",), 1.5)),
            feedback="filter",
        ),
        Case(
            "mag2",
            "magneto-elastic pair (16), exact dry friction, t = 400: 369 events, 5 sticks",
            mag2,
            Exact(),
            400.0,
            np.array([68.6821179593, 69.1082146640, -0.1937052220, 0.7347495453]),
            f"13 digits by independent code, docs/verification.md, and {_CLOSED}",
            _EXACT,
            (Target(("event loop DOP853",), 1 / 50),),
            plant=mag2_plant,
        ),
        Case(
            "spiked_chain",
            "three masses on spikes driven by gait (15), t = 20: 61 releases, 58 sticks",
            _SPIKED.model,
            Exact(),
            20.0,
            np.array(
                [
                    *(33.86999709433, 32.1268028788, 30.43239145097),
                    *(1.723569370587, 1.979455675845, 0.4497860398088),
                ]
            ),
            _CLOSED,
            _EXACT,
            plant=lambda: plant_of_chain(_SPIKED),
            max_step=0.01,
        ),
        Case(
            "stick_chain",
            "four masses with stiction driven by a running sine, t = 20: 144 reversals, 15 sticks",
            _STICK.model,
            Exact(),
            20.0,
            np.array(
                [
                    *(42.01449307401, 40.44607291658, 37.83038695491, 36.4094808727),
                    *(0.1378182377376, 4.772051921085, 4.397090334646, -1.427712246064),
                ]
            ),
            _CLOSED,
            _EXACT,
            plant=lambda: plant_of_chain(_STICK),
        ),
    )
}
