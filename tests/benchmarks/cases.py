"""The benchmarks: what is simulated, what the answer is, and where that answer comes from."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import casadi as ca
import numpy as np

from tests.benchmarks.ladder import Target
from tests.oracles.driven_chain import DrivenChain, Grip, Plant
from wormopt.control.lambda_tracker import Feedback, lambda_tracker
from wormopt.control.loop import gait_reference
from wormopt.model.friction import Coulomb
from wormopt.model.model import Contact, Model, Signal
from wormopt.simulation.options import Exact, Smooth, Treatment
from wormopt.systems.chain.build import chain
from wormopt.systems.spiked.construct import fast_gait, travelling_sine

GOAL = 1e-9
"""Error in (x, v) at which times are compared."""

MAG2_EPS = 0.036
"""Strength of the drive of MAG2, and of friction backward."""

MAG2_NU = math.sqrt(2.0) + 0.5 * MAG2_EPS
"""Its frequency."""


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
    feedback: Feedback = "filter"  # tracker, for hand-written right-hand sides
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
    reference = gait_reference(fast_gait(1.0), worm.t)
    return lambda_tracker(worm, reference, tube_radius=0.2, feedback=feedback)


def mag2() -> Model:
    """Benchmark MAG2: system (16) as a plain model of two masses."""
    t, x, v, force = ca.SX.sym("t"), ca.SX.sym("x", 2), ca.SX.sym("v", 2), ca.SX.sym("f", 2)
    pull = x[0] - x[1] + MAG2_EPS * (1 + ca.cos(MAG2_NU * t))
    law = Coulomb(0.5 * MAG2_EPS, MAG2_EPS)
    return Model(
        "MAG2",
        x=[Signal("position", x, value=0.0), Signal("velocity", v, value=0.0)],
        ode=ca.vertcat(v, force[0] - pull, force[1] + pull),
        t=t,
        contacts=[Contact(f"mass {i}", v[i], force[i], law) for i in range(2)],
    )


def mag2_plant() -> Plant:
    """Benchmark MAG2 in NumPy."""

    def rates(t: float, y: np.ndarray, force: np.ndarray) -> np.ndarray:
        pull = y[0] - y[1] + MAG2_EPS * (1.0 + math.cos(MAG2_NU * t))
        return np.array([y[2], y[3], force[0] - pull, force[1] + pull])

    grips = [Grip(0.5 * MAG2_EPS, MAG2_EPS)] * 2
    return Plant(rates, np.zeros(4), np.array([2, 3]), np.ones(2), grips, lambda _: np.zeros(0))


_SPIKED = DrivenChain.alike(fast_gait(1.0), Grip.spike(), drag=1.0)
_STICK = DrivenChain.alike(travelling_sine(3, 1.0), Grip(1.0, 3.0, 1.5, 4.0))

_SMOOTH = (
    *("scipy LSODA", "scipy Radau", "scipy DOP853"),
    *("CasADi CVODES", "CasADi CVODES (Adams)", "CasADi IDAS"),
    *("scipy LSODA + numba", "scipy DOP853 + numba"),
    *("diffrax Dopri8", "scikit-sundae CVODE", "heyoka"),
)
_EXACT = ("wormopt", "event loop DOP853", "event loop LSODA", "event loop Radau")
_DIGITS = "13 digits by independent code, docs/verification.md"
_CLOSED = "closed form between events (tests/oracles/driven_chain.py)"


def _track(feedback: Feedback, reference: Sequence[float]) -> Case:
    number = {"derivative": 13, "filter": 14}[feedback]
    by_hand = ("hand-written C",) if number == 14 else ()
    return Case(
        f"track{number}",
        f"lambda-tracker ({number}), smooth friction, chapter's data, t = 10",
        lambda: track(feedback),
        Smooth(1 / 40),
        10.0,
        np.array(reference),
        _DIGITS,
        ("wormopt", *by_hand, *_SMOOTH),
        (
            Target(("CasADi CVODES",), 1 / 20),
            Target(("scipy LSODA", "scipy Radau", "scipy DOP853"), 1 / 60),
            *(Target((name,), 1.5) for name in by_hand),
            *(Target(("heyoka",), 1.1) for _ in by_hand),
        ),
        feedback,
    )


_TRACK13 = (
    *(13.9905483956915, 12.7643770141827, 11.4656131519066),
    *(1.5265682540374, 1.2068425686835, 0.6714590289857),
)
_TRACK14 = (
    *(13.7293026425339, 12.5129899383629, 11.2234323017047),
    *(1.5442046082437, 1.2147444914821, 0.6496895012235),
)
_SPIKED_END = (
    *(33.86999709433, 32.1268028788, 30.43239145097),
    *(1.723569370587, 1.979455675845, 0.4497860398088),
)
_STICK_END = (
    *(42.01449307401, 40.44607291658, 37.83038695491, 36.4094808727),
    *(0.1378182377376, 4.772051921085, 4.397090334646, -1.427712246064),
)

WORK_PRECISION = {
    case.name: case
    for case in (
        _track("derivative", _TRACK13),
        _track("filter", _TRACK14),
        Case(
            "mag2",
            "magneto-elastic pair (16), exact dry friction, t = 400: 369 events, 5 sticks",
            mag2,
            Exact(),
            400.0,
            np.array([68.6821179593, 69.1082146640, -0.1937052220, 0.7347495453]),
            f"{_DIGITS}, and {_CLOSED}",
            (*_EXACT, "hand-written C", "heyoka"),
            (
                Target(("event loop DOP853",), 1 / 50),
                Target(("hand-written C",), 3.0),
                Target(("heyoka",), 1.0),
            ),
            plant=mag2_plant,
        ),
        Case(
            "spiked_chain",
            "three masses on spikes driven by gait (15), t = 20: 61 releases, 58 sticks",
            _SPIKED.model,
            Exact(),
            20.0,
            np.array(_SPIKED_END),
            _CLOSED,
            _EXACT,
            plant=_SPIKED.plant,
            max_step=0.01,
        ),
        Case(
            "stick_chain",
            "four masses with stiction driven by a running sine, t = 20: 144 reversals, 15 sticks",
            _STICK.model,
            Exact(),
            20.0,
            np.array(_STICK_END),
            _CLOSED,
            _EXACT,
            plant=_STICK.plant,
        ),
    )
}
