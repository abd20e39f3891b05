"""References, lambda-trackers and funnel control against the theory's numbers and hand formulas."""

from collections.abc import Callable, Sequence
from dataclasses import FrozenInstanceError, fields, replace
from typing import Any

import casadi as ca
import numpy as np
import pytest
from effort import examples
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import solve_ivp

from wormopt.control.funnel import Funnel, funnel_tracker
from wormopt.control.lambda_tracker import (
    Adaptation,
    Decay,
    Exponent,
    Feedback,
    Quadratic,
    lambda_tracker,
)
from wormopt.control.loop import FeedForward
from wormopt.control.reference import Reference, gait_reference
from wormopt.model.friction import Coulomb
from wormopt.model.gait import Gait
from wormopt.model.model import Model, Output, Signal, pack
from wormopt.model.path import ornstein_uhlenbeck, piecewise_constant
from wormopt.model.schedule import Schedule
from wormopt.systems.chain.build import chain
from wormopt.systems.spiked.construct import accordion, block_wave, fast_gait, travelling_sine

# -- a small simulator: scipy's DOP853, stretch by stretch between breaks and events -------------


def piece_at(schedule: Schedule, t: float) -> tuple[int, float]:
    """Piece of a schedule at a time inside it, and when the piece began."""
    since, period = t - schedule.start, schedule.breaks[-1]
    turn = period * np.floor(since / period) if schedule.periodic else 0.0
    piece = int(np.searchsorted(schedule.breaks, since - turn, side="right")) - 1
    piece = min(max(piece, 0), schedule.pieces - 1)
    return piece, schedule.start + turn + schedule.breaks[piece]


def breaks_in(schedule: Schedule, until: float) -> list[float]:
    period = schedule.breaks[-1]
    turns = range(-1, int((until - schedule.start) / period) + 1) if schedule.periodic else [0]
    times = [schedule.start + k * period + b for k in turns for b in schedule.breaks[:-1]]
    return [t for t in times if 1e-12 < t < until - 1e-12]


class Compiled:
    """An expression of a model as a fast function of (t, x); v_reg smooths the contacts."""

    def __init__(self, model: Model, expression: ca.SX, v_reg: float) -> None:
        smooth = [c.law.smooth(c.velocity, v_reg) for c in model.contacts]
        expression = ca.substitute(ca.densify(expression), model.forces, ca.vertcat(*smooth))
        scheduled = [s for item in model.schedules for s in (item.symbol, item.begin)]
        given_at = ca.vertcat(model.t, pack(model.x), *scheduled)
        function = ca.Function("f", [given_at, pack(model.p)], [expression])
        numbers = [np.broadcast_to(np.array(p.value, float), p.size) for p in model.p]
        self.given = np.zeros(given_at.numel())
        self.numbers = np.concatenate([np.zeros(0), *numbers])
        self.result = np.zeros(expression.numel())
        self.n_x = model.n_x
        self.buffer, self.run = function.buffer()
        ends = (self.buffer.set_arg, 0, self.given), (self.buffer.set_arg, 1, self.numbers)
        for connect, k, array in (*ends, (self.buffer.set_res, 0, self.result)):
            connect(k, array.data)  # pyright: ignore[reportCallIssue]

    def __call__(self, t: float, x: np.ndarray) -> np.ndarray:
        self.given[0], self.given[1 : 1 + self.n_x] = t, x
        self.run()
        return self.result.copy()

    def set_pieces(self, schedules: Sequence[Schedule], t: float) -> None:
        found = [(s, *piece_at(s, t)) for s in schedules]
        parts = [np.append(s.values[piece], begin) for s, piece, begin in found]
        self.given[1 + self.n_x :] = np.concatenate([np.zeros(0), *parts])


class Run:
    """Motion of a closed loop: states at the ends of all stretches, events, outputs on demand."""

    def __init__(self, model: Model, until: float, v_reg: float = 1 / 40, rtol: float = 1e-12):
        self.model, self.v_reg = model, v_reg
        x = np.concatenate([np.broadcast_to(np.array(s.value, float), s.size) for s in model.x])
        ode = Compiled(model, model.ode, v_reg)
        guards = Compiled(model, ca.vertcat(ca.SX(0, 1), *(s.guard for s in model.switches)), v_reg)
        resets = [Compiled(model, s.reset, v_reg) for s in model.switches]
        self.events: list[tuple[str, float]] = []
        self.times, self.states = [0.0], [x]
        ends = sorted({until, *(b for s in model.schedules for b in breaks_in(s, until))})
        fired = dict.fromkeys(range(len(resets)), -1.0)
        t = 0.0
        for end in ends:
            for function in (ode, guards, *resets):
                function.set_pieces(model.schedules, (t + end) / 2)
            while end - t > 1e-13:
                watch = [self._event(guards, k, fired[k]) for k in range(len(resets))]
                part = solve_ivp(
                    ode, (t, end), x, "DOP853", rtol=rtol, atol=1e-13, events=watch or None
                )
                assert part.status >= 0, part.message
                t, x = part.t[-1], part.y[:, -1]
                if part.status == 1:
                    k = next(k for k, found in enumerate(part.t_events) if len(found))
                    fired[k] = t
                    self.events.append((model.switches[k].name, t))
                    x = resets[k](t, x)
                self.times.append(t)
                self.states.append(x)

    @staticmethod
    def _event(guards: Compiled, k: int, fired: float) -> Callable[[float, np.ndarray], float]:
        def guard(t: float, x: np.ndarray) -> float:
            return 1.0 if t < fired + 1e-9 else guards(t, x)[k]

        guard.terminal, guard.direction = True, 1.0  # type: ignore[attr-defined]
        return guard

    @property
    def end(self) -> np.ndarray:
        return self.states[-1]

    def __getitem__(self, name: str) -> np.ndarray:
        """Values of a state or an output at the ends of all stretches, (stretches + 1, size)."""
        names = [s.name for s in self.model.x]
        if name in names:
            k, sizes = names.index(name), np.cumsum([0] + [s.size for s in self.model.x])
            return np.array(self.states)[:, sizes[k] : sizes[k + 1]]
        function = Compiled(self.model, self.model[name], self.v_reg)
        rows = []
        for t, x in zip(self.times, self.states, strict=True):
            function.set_pieces(self.model.schedules, t)
            rows.append(function(t, x))
        return np.array(rows)


def worm(links: int = 2, **numbers: Any) -> Model:
    usual = {"mass": 1.0, "stiffness": 10.0, "damping": 5.0, "rest_length": 2.0}
    return chain(links, law=Coulomb(1.0, 10.0), **(usual | numbers))


def pushed() -> Model:
    plant = worm()
    return replace(plant, u=[replace(plant.u[0], name="push")])


# -- benchmarks of docs/verification.md -------------------------------------------------------

TRACKS: dict[Feedback, list[float]] = {
    "filter": [
        13.7293026425339, 12.5129899383629, 11.2234323017047,
        1.5442046082437, 1.2147444914821, 0.6496895012235,
        17.0537482219161, -0.7848014274676, -0.7122939752036,
    ],
    "derivative": [
        13.9905483956915, 12.7643770141827, 11.4656131519066,
        1.5265682540374, 1.2068425686835, 0.6714590289857,
        17.4065002539140,
    ],
}  # fmt: skip


@pytest.mark.parametrize("feedback", ["filter", "derivative"])
def test_the_trackers_reproduce_the_benchmarks(feedback: Feedback):
    """TRACK14 and TRACK13: the chapter's data, rest length 0, x(0) = (0, 2, 4), at t = 10."""
    plant = worm(rest_length=0.0, position=(0.0, 2.0, 4.0))
    reference = gait_reference(fast_gait(1.0), plant.t)
    loop = lambda_tracker(plant, reference, tube_radius=0.2, feedback=feedback)
    run = Run(loop, 10.0)
    assert run.end == pytest.approx(TRACKS[feedback], abs=1e-9)
    assert run["error_norm"].min() > 0.2  # the tube is never reached


# -- references ----------------------------------------------------------------------------------

TABLE = np.random.default_rng(6)
GAITS = {
    "fast": fast_gait(1.3),
    "quintic": block_wave(3, 1, 0.7, (0.9, 1.2), "quintic"),
    "corners": accordion(2, 1.1, (1.0, 2.0), "trapezoid", ramp=0.0),
    "sine": travelling_sine(4, 0.6, 2.0, 0.5, lag=0.2),
    "one constant": Gait(np.array([0.0, 1.0]), np.full((1, 2, 1), 2.5)),
    "polynomial and harmonic": Gait(
        np.array([0.0, 0.3, 1.0]),
        TABLE.normal(size=(2, 3, 4)),
        TABLE.normal(size=2),
        TABLE.normal(size=(2, 3)),
        TABLE.normal(size=(2, 3)),
    ),
}


def evaluated(reference: Reference, time: ca.SX, t: float) -> list[np.ndarray]:
    schedule = reference.schedule
    assert schedule is not None
    expressions = [reference.value, reference.rate, reference.acceleration]
    function = ca.Function("f", [time, schedule.symbol, schedule.begin], expressions)
    piece, begin = piece_at(schedule, t)
    return [np.array(part).ravel() for part in function(t, schedule.values[piece], begin)]


@given(
    name=st.sampled_from(sorted(GAITS)),
    t=st.floats(-5, 20),
    shift=st.one_of(st.just(0.0), st.floats(-3, 3)),
)
def test_a_reference_is_the_gait_and_its_exact_derivatives(name: str, t: float, shift: float):
    """Against Gait's own evaluation, wrapped and shifted; at breaks either piece may count."""
    gait, time = GAITS[name], ca.SX.sym("t")
    at = np.mod(t + shift, gait.period)
    if np.abs(at - gait.breaks).min() < 1e-9:
        return
    found = evaluated(gait_reference(gait, time, shift=shift), time, t)
    for derivative, part in enumerate(found):
        expected = gait(np.array([t + shift]), derivative)[:, 0]
        assert part == pytest.approx(expected, rel=1e-9, abs=1e-9)


@pytest.mark.parametrize("name", GAITS)
def test_rates_are_slopes_of_the_values(name: str):
    """Central differences inside a piece, which know nothing of derivatives."""
    gait, time, h = GAITS[name], ca.SX.sym("t"), 1e-5
    reference = gait_reference(gait, time, shift=0.1)
    for t in (gait.breaks[:-1] + gait.breaks[1:]) / 2 - 0.1 + 3 * gait.period:
        ahead, now, behind = (evaluated(reference, time, t + d) for d in (h, 0.0, -h))
        for k in (0, 1):
            slope = (ahead[k] - behind[k]) / (2 * h)
            assert now[k + 1] == pytest.approx(slope, abs=1e-4 * (1 + np.abs(slope).max()))


def test_a_reference_may_have_no_shift_that_is_no_number():
    with pytest.raises(ValueError, match="shift must be finite"):
        gait_reference(fast_gait(1.0), ca.SX.sym("t"), shift=float("nan"))


def test_the_travelling_sine_is_what_it_says():
    gait, t = travelling_sine(3, 0.8, 2.0, 0.5, lag=0.15), np.linspace(0, 2, 41)
    angle = 2 * np.pi * (t / 0.8 - 0.15 * np.arange(1, 4)[:, None])
    w = 2 * np.pi / 0.8
    assert gait(t) == pytest.approx(2.0 + 0.5 * np.sin(angle), abs=1e-13)
    assert gait(t, 1) == pytest.approx(0.5 * w * np.cos(angle), abs=1e-12)
    assert gait(t, 2) == pytest.approx(-0.5 * w**2 * np.sin(angle), abs=1e-11)
    with pytest.raises(ValueError, match="links is 0; write 1 or more"):
        travelling_sine(0, 1.0)


# -- trackers at a point, against formulas written by hand ---------------------------------------


def point(loop: Model, x: dict[str, Any], reference: list[np.ndarray]) -> dict[str, np.ndarray]:
    """Outputs and ode at given states, the reference's schedule replaced by plain numbers."""
    symbols = [*(s.symbol for s in loop.x), *(p.symbol for p in loop.p), loop.t, loop.forces]
    numbers = [np.array(x[s.name]) for s in loop.x] + [np.array(p.value) for p in loop.p]
    (schedule,) = loop.schedules
    function = ca.Function(
        "f",
        [*symbols, schedule.symbol, schedule.begin],
        [loop.ode, *(o.expression for o in loop.outputs)],
    )
    found = function(*numbers, 0.4, np.zeros(len(loop.contacts)), np.hstack(reference), 0.0)
    names = ["ode", *(o.name for o in loop.outputs)]
    return dict(zip(names, (np.array(f).ravel() for f in found), strict=True))


@settings(max_examples=examples(30))
@given(seed=st.integers(0, 10**6), feedback=st.sampled_from(["derivative", "filter"]))
def test_the_force_of_a_tracker_at_a_point(seed: int, feedback: Feedback):
    """(13): -(k e + k' e + k e'); (14): -(k th + k' th + k th'), th' = -k^2 th + k^2 e."""
    random = np.random.default_rng(seed)
    plant = worm(3, mass=2.0)
    # y_ref = a + b s at s = 0.4
    a, b = random.uniform(1, 3, 3), random.uniform(-1, 1, 3)
    gait = Gait(np.array([0.0, 1.0]), np.stack([a, b], axis=1)[None])
    believed = FeedForward(stiffness=[8.0, 9.0, 11.0], rest_length=1.9, damping=4.0)
    loop = lambda_tracker(
        plant,
        gait_reference(gait, plant.t),
        tube_radius=0.3,
        feedback=feedback,
        adaptation=Quadratic(growth=2.5),
        feedforward=believed,
    )
    x = {"position": random.uniform(-3, 3, 4), "velocity": random.uniform(-1, 1, 4)}
    x |= {"gain": random.uniform(0, 5, 1), "filter": random.uniform(-1, 1, 3)}
    at = point(loop, x, [a, b])
    y_ref, k, theta = a + 0.4 * b, x["gain"][0], x["filter"]
    e, e_rate = -np.diff(x["position"]) - y_ref, -np.diff(x["velocity"]) - b
    size = np.sqrt(np.sum(e**2))
    k_rate = 2.5 * max(0.0, size - 0.3) ** 2
    theta_rate = -(k**2) * theta + k**2 * e
    if feedback == "derivative":
        u = -(k * e + k_rate * e + k * e_rate)
        controller = [k_rate]
    else:
        u = -(k * theta + k_rate * theta + k * theta_rate)
        controller = [k_rate, *theta_rate]
    u = u + np.array([8.0, 9.0, 11.0]) * (y_ref - 1.9) + 4.0 * b
    assert at["input"] == pytest.approx(u, rel=1e-12)
    assert at["reference"] == pytest.approx(y_ref)
    assert at["error"] == pytest.approx(e)
    assert at["error_norm"] == pytest.approx(size)
    assert at["gain_rate"] == pytest.approx(k_rate)
    assert at["ode"][8:] == pytest.approx(controller)
    # The plant gets this force: its own link forces and motion say so.
    spring = 10 * (e + y_ref - 2) + 5 * (e_rate + b)
    assert at["link_force"] == pytest.approx(spring - u)
    mu = np.concatenate([[0.0], spring - u, [0.0]])
    assert at["ode"][4:8] == pytest.approx((mu[:-1] - mu[1:]) / 2, rel=1e-9, abs=1e-9)


def test_a_true_feed_forward_leaves_links_on_the_reference_without_force():
    """At e = e' = 0 the actuators carry the springs: mu = 0."""
    plant = worm(2, stiffness=[9.0, 12.0], damping=[3.0, 4.0], rest_length=[1.5, 1.0])
    a, b = np.array([2.0, 1.8]), np.array([0.5, -0.7])
    gait = Gait(np.array([0.0, 1.0]), np.stack([a, b], axis=1)[None])
    believed = FeedForward([9.0, 12.0], [1.5, 1.0], [3.0, 4.0])
    loop = lambda_tracker(
        plant, gait_reference(gait, plant.t), tube_radius=0.2, feedforward=believed
    )
    y = a + 0.4 * b
    x = {"position": [y.sum(), y[1], 0.0], "velocity": [b.sum() + 1, b[1] + 1, 1.0], "gain": 5.0}
    at = point(loop, x, [a, b])
    assert at["link_force"] == pytest.approx(0, abs=1e-12)


@pytest.mark.parametrize("feedback", ["filter", "derivative"])
@pytest.mark.parametrize("law", [Quadratic(), Exponent(1.0), Exponent(2.5), Decay(1.0, 0.1)])
@pytest.mark.parametrize("error", [0.0, 0.2, 0.3, 1.2, 2.0])
def test_derivatives_are_finite_everywhere(feedback: Feedback, law: Adaptation, error: float):
    """At e = 0 and on the tube's surface, too, where |e| and square roots have none."""
    plant = worm(1)
    reference = Reference(ca.SX([2.0]), ca.SX(1, 1), ca.SX(1, 1))
    loop = lambda_tracker(
        plant, reference, tube_radius=0.2, feedback=feedback, adaptation=law, watch=True
    )
    x, guards = pack(loop.x), ca.vertcat(*(s.guard for s in loop.switches))
    slopes = [ca.jacobian(loop.ode, x), ca.jacobian(guards, x)]
    function = ca.Function("J", [x, pack(loop.p), loop.forces], slopes)
    start = np.concatenate([np.atleast_1d(np.array(s.value, float)) for s in loop.x])
    start[0] = 2.0 + error
    numbers = np.concatenate([np.atleast_1d(np.array(p.value, float)) for p in loop.p])
    for found in function(start, numbers, np.zeros(2)):
        assert np.all(np.isfinite(found.full()))


# -- adaptation, on an error prescribed in time --------------------------------------------------


def puppet(law: Adaptation, pieces: Sequence[tuple[float, float]], **options: Any) -> Model:
    """Loop whose error is piecewise linear in time, whatever the tracker does.

    The plant ignores its input and stays at 0, so the error is minus the reference. ``pieces``
    are (time, error) at the corners.
    """
    q, v, u = ca.SX.sym("q"), ca.SX.sym("v"), ca.SX.sym("u")
    x = [Signal("position", q, value=0.0), Signal("velocity", v, value=0.0)]
    plant = Model(
        "puppet",
        x,
        ca.vertcat(v, 0 * u),
        u=[Signal("input", u)],
        outputs=[Output("length", q)],
    )
    t, e = np.array(pieces).T
    polynomial = np.stack([-e[:-1], -np.diff(e) / np.diff(t)], axis=1)[:, None, :]
    reference = gait_reference(Gait(t, polynomial), plant.t)
    return lambda_tracker(plant, reference, tube_radius=0.2, adaptation=law, **options)


def test_growth_by_the_chapters_law_and_by_an_exponent():
    """|e| = 2.2 - t outside the tube: k - k(0) = gamma int (2 - t)^2, or (2 - t)(2.2 - t)^(r-1)."""
    fall = [(0.0, 2.2), (2.2, 0.0), (3.0, 0.0)]
    run = Run(puppet(Quadratic(1.5), fall, gain_start=0.7), 3.0)
    assert run.end[2] == pytest.approx(0.7 + 1.5 * 8 / 3, abs=1e-10)
    run = Run(puppet(Exponent(2.0), fall), 3.0)
    assert run.end[2] == pytest.approx(1 + 8 / 3 + 0.2 * 2, abs=1e-10)
    run = Run(puppet(Exponent(1.0), fall), 3.0)
    assert run.end[2] == pytest.approx(1 + 2, abs=1e-10)


def test_decay_goes_through_all_its_regimes():
    """|e| = 2.2 - t, then 0, then t - 5, with lambda = 0.2, dwell 0.9 and sigma = 0.3.

    Far until t = 1: int_0^1 (2 - t)^2 = 7/3; near until t = 2: int sqrt(2 - t) = 2/3; constant
    until t = 2.9; decay until the error leaves the tube at 5.2; then near again.
    """
    law = Decay(dwell=0.9, decay=0.3, growth=2.0)
    run = Run(puppet(law, [(0.0, 2.2), (2.2, 0.0), (5.0, 0.0), (6.0, 1.0)]), 6.0)
    assert run.events == [
        ("dwell time passes", pytest.approx(0.9)),  # outside the tube, without effect
        ("enters the wide tube", pytest.approx(1.0)),
        ("enters the tube", pytest.approx(2.0)),
        ("dwell time passes", pytest.approx(2.9)),
        ("leaves the tube", pytest.approx(5.2)),
    ]
    gain, times = run["gain"][:, 0], np.array(run.times)
    peak = 1 + 2 * (7 / 3 + 2 / 3)
    low = peak * np.exp(-0.3 * 2.3)
    by_hand = {1.0: 1 + 14 / 3, 2.0: peak, 2.9: peak, 5.2: low, 6.0: low + 4 / 3 * 0.8**1.5}
    for t, expected in by_hand.items():
        k = int(np.argmin(np.abs(times - t)))
        assert gain[k] == pytest.approx(expected, abs=2e-9)
    decaying = run["gain_decaying"][:, 0]
    assert np.array_equal(decaying == 1, (times > 2.8999) & (times < 5.1999))


def test_visits_to_the_tube_shorter_than_the_dwell_time_do_not_count():
    """In the tube on [0, 0.6], outside to 1.4 and inside again: decay from 2.4 on, not from 1."""
    corners = [(0.0, 0.0), (0.4, 0.0), (1.0, 0.6), (1.6, 0.0), (4.0, 0.0)]
    run = Run(puppet(Decay(dwell=1.0, decay=0.5), corners), 4.0)
    visits = [(n, round(t, 9)) for n, t in run.events if n != "dwell time passes"]
    assert visits == [("leaves the tube", 0.6), ("enters the tube", 1.4)]
    assert run.events[-1] == ("dwell time passes", pytest.approx(2.4))
    grown = 1 + 2 * (2 / 3) * 0.4**1.5
    assert run.end[2] == pytest.approx(grown * np.exp(-0.5 * 1.6), abs=2e-9)


def test_an_error_that_starts_in_the_tube_has_entered_it_at_the_start():
    run = Run(puppet(Decay(dwell=1.0, decay=0.5), [(0.0, 0.1), (3.0, 0.1)]), 3.0)
    assert run.events == [("dwell time passes", pytest.approx(1.0))]
    assert run.end[2] == pytest.approx(np.exp(-0.5 * 2.0), abs=1e-10)


def test_an_error_just_outside_of_the_tube_lets_no_gain_decay():
    """|e| = 0.3 beside lambda = 0.2: the gain grows by sqrt(0.1) all the time."""
    run = Run(puppet(Decay(dwell=1.0, decay=0.5), [(0.0, 0.3), (3.0, 0.3)]), 3.0)
    assert run.events == [("dwell time passes", pytest.approx(1.0))]
    assert run.end[2] == pytest.approx(1 + 3 * np.sqrt(0.1), abs=1e-10)


def test_watching_the_tube_locates_crossings_and_changes_nothing():
    """On the real worm with a small gain: the error enters and leaves the tube many times."""
    plant = worm()
    options: dict[str, Any] = {"tube_radius": 0.2, "adaptation": Quadratic(5.0)}
    reference = gait_reference(fast_gait(1.0), plant.t)
    watched = Run(lambda_tracker(plant, reference, watch=True, **options), 3.0)
    plain = Run(lambda_tracker(plant, reference, **options), 3.0)
    assert plain.events == []
    names = [name for name, _ in watched.events]
    assert len(names) >= 6
    assert set(names[::2]) == {"leaves the tube"}  # it starts on the reference
    assert set(names[1::2]) == {"enters the tube"}
    assert watched.end == pytest.approx(plain.end, abs=1e-8)
    norm, gain = watched["error_norm"][:, 0], watched["gain"][:, 0]
    times = np.array(watched.times)
    for (name, t), (_, until) in zip(watched.events[:-1], watched.events[1:], strict=True):
        first, last = (int(np.argmin(np.abs(times - s))) for s in (t, until))
        assert norm[first] == pytest.approx(0.2, abs=1e-10)
        grown = gain[last] - gain[first]
        # Located in a step across the kink of k', so not to the last digit.
        assert abs(grown) < 1e-9 if name == "enters the tube" else grown > 0.1


# -- plants with schedules of their own ----------------------------------------------------------


def test_random_links_and_a_gait_run_through_one_loop():
    """A path without spread is the constant; one with spread gives another motion."""

    def end(stiffness: Any) -> np.ndarray:
        plant = worm(stiffness=stiffness)
        reference = gait_reference(fast_gait(1.0), plant.t, shift=0.2)
        loop = lambda_tracker(plant, reference, tube_radius=0.2, feedback="filter")
        names = [s.name for s in loop.schedules]
        assert names == ([] if isinstance(stiffness, float) else ["stiffness"]) + ["reference"]
        return Run(loop, 1.5, rtol=1e-10).end

    def steps(spread: float) -> Any:
        return piecewise_constant(np.random.default_rng(1), [10.0, 10.0], spread, 0.4, 1.5)

    constant = end(10.0)
    assert end(steps(0.0)) == pytest.approx(constant, abs=1e-8)
    assert np.abs(end(steps(3.0)) - constant).max() > 1e-4
    still = ornstein_uhlenbeck(np.random.default_rng(1), [10.0, 10.0], 0.0, 1.0, 0.5, 1.5)
    assert end(still) == pytest.approx(constant, abs=1e-8)


def test_members_of_an_ensemble_share_their_expressions():
    """Two draws differ in the schedule's values alone, so one compiled model serves both."""

    def loop(seed: int) -> Model:
        path = ornstein_uhlenbeck(np.random.default_rng(seed), [10.0, 10.0], 2.0, 1.0, 0.5, 1.5)
        plant = worm(stiffness=path)
        return lambda_tracker(plant, gait_reference(fast_gait(1.0), plant.t), tube_radius=0.2)

    first, second = loop(1), loop(2)
    assert str(first.ode) == str(second.ode)
    one, other = first.schedules[0], second.schedules[0]
    assert np.array_equal(one.breaks, other.breaks)
    assert not np.array_equal(one.values, other.values)
    mixed = replace(first, schedules=[replace(one, values=other.values), first.schedules[1]])
    assert Run(mixed, 0.6, rtol=1e-9).end == pytest.approx(Run(second, 0.6, rtol=1e-9).end)


# -- funnel control ------------------------------------------------------------------------------


def test_the_funnel_controller_keeps_both_errors_in_their_funnels():
    plant = worm(position=(4.3, 2.0, 0.0))
    outer, inner = Funnel(0.8, 0.1, time=0.5), Funnel(3.0, 1.5, time=0.5)
    reference = gait_reference(fast_gait(1.0), plant.t)
    loop = funnel_tracker(plant, reference, funnel=outer, rate_funnel=inner, gain=4.0)
    run = Run(loop, 3.0, rtol=1e-10)
    assert np.all(run["error_norm"] < run["funnel"])
    assert np.all(run["rate_error_norm"] < run["rate_funnel"])
    width = 0.1 + 0.7 * np.exp(-np.array(run.times) / 0.5)
    assert run["funnel"][:, 0] == pytest.approx(width)
    assert run["error_norm"][-1] < 0.1


@settings(max_examples=examples(20))
@given(seed=st.integers(0, 10**6))
def test_the_force_of_the_funnel_controller_at_a_point(seed: int):
    """k_0 = 1/(1 - |e|^2/psi_0^2), e_1 = e' + k_0 e, k_1 likewise, u = -gain k_1 e_1."""
    random = np.random.default_rng(seed)
    plant = worm()
    gait = Gait(np.array([0.0, 1.0]), np.array([[[2.0, 0.0], [2.0, 0.0]]]))
    loop = funnel_tracker(
        plant,
        gait_reference(gait, plant.t),
        funnel=Funnel(2.0, 0.5, time=2.0),
        rate_funnel=Funnel(9.0, 3.0, time=1.0),
        gain=3.0,
        feedforward=FeedForward(10.0, 1.5),
    )
    e, e_rate = random.uniform(-0.5, 0.5, 2), random.uniform(-1, 1, 2)
    x = {
        "position": [4 + e.sum(), 2 + e[1], 0.0],
        "velocity": [e_rate.sum(), e_rate[1], 0.0],
    }
    at = point(loop, x, [np.full(2, 2.0), np.zeros(2)])
    width, rate_width = 0.5 + 1.5 * np.exp(-0.2), 3 + 6 * np.exp(-0.4)
    k0 = 1 / (1 - (e @ e) / width**2)
    e1 = e_rate + k0 * e
    k1 = 1 / (1 - (e1 @ e1) / rate_width**2)
    assert at["input"] == pytest.approx(-3 * k1 * e1 + 10 * 0.5)
    assert at["funnel_gain"] == pytest.approx([k0, k1])
    assert at["funnel"][0] == pytest.approx(width)
    assert at["rate_funnel"][0] == pytest.approx(rate_width)
    assert at["rate_error_norm"][0] == pytest.approx(np.sqrt(e1 @ e1))


def test_a_start_outside_a_funnel_is_refused_with_its_numbers():
    """e(0) = (0.3, 0.4) - 0: |e| = 0.5; e_1 = e' + e / (1 - 0.25) at psi_0 = 1."""
    plant = worm(position=(4.7, 2.4, 0.0), velocity=(0.9, 0.0, 0.0))
    # The gait shifted by a quarter of its two pieces: the second piece counts, 2 throughout.
    polynomial = np.array([[[9.0], [9.0]], [[2.0], [2.0]]])
    reference = gait_reference(Gait(np.array([0.0, 0.5, 1.0]), polynomial), plant.t, shift=-1.25)
    wide = Funnel(9.0, 1.0, time=1.0)
    with pytest.raises(ValueError, match=r"the error starts at 0\.5, outside its funnel of 0\.5"):
        funnel_tracker(plant, reference, funnel=Funnel(0.5, 0.1, time=1.0), rate_funnel=wide)
    e1 = np.array([0.9, 0.0]) + np.array([0.3, 0.4]) / 0.75
    start = f"{np.sqrt(e1 @ e1):.6g}"
    with pytest.raises(ValueError, match=rf"e' \+ k_0 e starts at {start}, outside .* of 1.4"):
        funnel_tracker(
            plant,
            reference,
            funnel=Funnel(1.0, 0.1, time=1.0),
            rate_funnel=Funnel(1.4, 0.1, time=1.0),
        )
    unknown = replace(plant, x=[replace(s, value=None) for s in plant.x])
    funnel_tracker(unknown, reference, funnel=Funnel(0.5, 0.1, time=1.0), rate_funnel=wide)


# -- what a loop tells, and what is refused ------------------------------------------------------


def test_a_closed_loop_tells_what_it_is():
    plant = worm()
    loop = lambda_tracker(
        plant,
        gait_reference(fast_gait(1.0), plant.t),
        tube_radius=0.25,
        feedback="filter",
        adaptation=Decay(2.0, 0.1, growth=3.0),
        gain_start=1.5,
        filter_start=[0.1, 0.2],
        feedforward=FeedForward(9.0, [1.5, 1.6]),
    )
    assert [(s.name, s.value) for s in loop.x[2:]] == [
        ("gain", 1.5), ("filter", (0.1, 0.2)), ("gain_decaying", 0.0), ("gain_timer", 0.0),
    ]  # fmt: skip
    assert list(loop.u) == []
    own = {p.name: p.value for p in loop.p[len(plant.p) :]}
    assert own == {
        "tube_radius": 0.25,
        "gain_dwell": (2.0,),
        "gain_decay": (0.1,),
        "gain_growth": (3.0,),
        "feedforward_stiffness": (9.0, 9.0),
        "feedforward_rest_length": (1.5, 1.6),
        "feedforward_damping": (0.0, 0.0),
    }
    assert [o.name for o in loop.outputs[len(plant.outputs) :]] == [
        "reference", "error", "error_norm", "input", "gain_rate",
    ]  # fmt: skip
    assert [c.name for c in loop.contacts] == [c.name for c in plant.contacts]
    assert [s.name for s in loop.schedules] == ["reference"]
    assert loop.t is plant.t
    for switch in loop.switches:
        assert switch.reset.numel() == loop.n_x
    # No expression knows the input any more.
    shown = ca.vertcat(loop.ode, *(o.expression for o in loop.outputs))
    assert not ca.depends_on(shown, plant.u[0].symbol)


def test_loops_of_many_links_stay_linear_in_size():
    def instructions(links: int) -> int:
        plant = worm(links)
        reference = gait_reference(travelling_sine(links, 1.0), plant.t)
        loop = lambda_tracker(plant, reference, tube_radius=0.2, feedback="filter")
        (schedule,) = loop.schedules
        symbols = [loop.t, pack(loop.x), pack(loop.p), loop.forces, schedule.symbol, schedule.begin]
        return ca.Function("f", symbols, [loop.ode]).n_instructions()

    counts = [instructions(n) for n in (50, 100, 200)]
    assert counts[2] - counts[1] == 2 * (counts[1] - counts[0])


def without_inertia() -> Model:
    q, u = ca.SX.sym("q"), ca.SX.sym("u")
    outputs = [Output("length", q)]
    return Model("glider", [Signal("q", q)], u, u=[Signal("input", u)], outputs=outputs)


def constant(size: int) -> Reference:
    return Reference(ca.SX.ones(size), ca.SX(size, 1), ca.SX(size, 1))


WIDE = Funnel(9.0, 1.0, 1.0)


@pytest.mark.parametrize(
    ("build", "message"),
    [
        (lambda: lambda_tracker(worm(), constant(3), tube_radius=0.2), "has 3 entries, length"),
        (lambda: lambda_tracker(worm(), constant(2), tube_radius=0.0), "tube_radius must be"),
        (lambda: lambda_tracker(worm(), constant(2), tube_radius=np.inf), "tube_radius must be"),
        (
            lambda: lambda_tracker(worm(), constant(2), tube_radius=0.2, gain_start=0.0),
            "gain_start must be finite and above 0",
        ),
        (lambda: lambda_tracker(without_inertia(), constant(1), tube_radius=0.2), "not by inertia"),
        (
            lambda: lambda_tracker(pushed(), constant(2), tube_radius=0.2),
            "has no input 'input' of 2",
        ),
        (lambda: Quadratic(0.0), "growth must be finite and above 0"),
        (lambda: Exponent(0.9), "exponent must be finite and at least 1"),
        (lambda: Exponent(np.nan), "exponent must be"),
        (lambda: Exponent(2.0, growth=0.0), "growth must be"),
        (lambda: Decay(1.0, 0.1, growth=0.0), "growth must be"),
        (lambda: Decay(0.0, 0.1), "dwell must be finite and above 0"),
        (lambda: Decay(1.0, -0.1), "decay must be finite and at least 0"),
        (lambda: Funnel(0.0, 1.0, 1.0), "start of a funnel"),
        (lambda: Funnel(1.0, 1.0, np.inf), "time of a funnel"),
        (
            lambda: funnel_tracker(worm(), constant(2), funnel=WIDE, rate_funnel=WIDE, gain=-1.0),
            "gain must be finite and above 0",
        ),
    ],
)
def test_loops_that_make_no_sense_are_refused(build: Callable[[], object], message: str):
    with pytest.raises(ValueError, match=message):
        build()


@pytest.mark.parametrize(
    "law",
    [
        Quadratic,
        Exponent,
        lambda growth: Decay(1.0, 0.1, growth),
        lambda start: Funnel(start, 1.0, 1.0),
    ],
)
def test_laws_that_hold_symbols_are_told_apart_by_who_they_are(law: Callable[[ca.SX], object]):
    """Whether two symbols are equal is an expression, not a yes or no."""
    one, other = law(ca.SX.sym("one")), law(ca.SX.sym("other"))
    assert one != other
    assert len({one, other, one}) == 2


@pytest.mark.parametrize("law", [Quadratic(), Exponent(2.0), Decay(1.0, 0.1), WIDE])
def test_laws_stay_what_they_are(law: Any):
    """What was checked once stays in range."""
    for field in fields(law):
        with pytest.raises(FrozenInstanceError):
            setattr(law, field.name, -1.0)


def test_a_misspelt_feedback_and_a_reference_of_another_time_are_refused():
    plant = chain(2, mass=1.0, stiffness=10.0, damping=5.0, rest_length=2.0)
    reference = gait_reference(fast_gait(1.0), plant.t)
    with pytest.raises(ValueError, match="feedback must be"):
        lambda_tracker(plant, reference, tube_radius=0.2, feedback="derivativ")  # type: ignore[arg-type]
    other = gait_reference(fast_gait(1.0), ca.SX.sym("t"))
    with pytest.raises(ValueError, match=r"plant\.t"):
        lambda_tracker(plant, other, tube_radius=0.2)
