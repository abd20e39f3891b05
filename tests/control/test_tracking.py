"""References and lambda-trackers against the theory's numbers and formulas written by hand."""

from collections.abc import Callable
from dataclasses import replace

import casadi as ca
import numpy as np
import pytest
from effort import examples
from hypothesis import given, settings
from hypothesis import strategies as st
from loop_runs import Run, piece_at
from worms import TRACKED, point, worm

from wormopt.control.funnel import Funnel, funnel_tracker
from wormopt.control.lambda_tracker import (
    Adaptation,
    Decay,
    Exponent,
    Feedback,
    Quadratic,
    lambda_tracker,
)
from wormopt.control.loop import FeedForward, Reference, gait_reference
from wormopt.model.gait import Gait
from wormopt.model.model import Model, Output, Signal, pack
from wormopt.systems.chain.build import chain
from wormopt.systems.spiked.construct import accordion, block_wave, fast_gait, travelling_sine


def pushed() -> Model:
    plant = worm()
    return replace(plant, u=[replace(plant.u[0], name="push")])


# -- benchmarks of docs/verification.md -------------------------------------------------------


@pytest.mark.parametrize("feedback", ["filter", "derivative"])
def test_the_trackers_reproduce_the_benchmarks(feedback: Feedback):
    """TRACK14 and TRACK13: the chapter's data, rest length 0, x(0) = (0, 2, 4), at t = 10."""
    plant = worm(rest_length=0.0, position=(0.0, 2.0, 4.0))
    reference = gait_reference(fast_gait(1.0), plant.t)
    loop = lambda_tracker(plant, reference, tube_radius=0.2, feedback=feedback)
    run = Run(loop, 10.0)
    assert run.end == pytest.approx(TRACKED[feedback], abs=1e-9)
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
        plant, gait_reference(gait, plant.t), tube_radius=0.3, feedback=feedback,
        adaptation=Quadratic(growth=2.5), feedforward=believed,
    )  # fmt: skip
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
        (lambda: lambda_tracker(worm(), constant(3), tube_radius=0.2), "has 3 entries, but length"),
        (lambda: lambda_tracker(worm(), constant(2), tube_radius=0.0), "tube_radius must be"),
        (lambda: lambda_tracker(worm(), constant(2), tube_radius=np.inf), "tube_radius must be"),
        (
            lambda: lambda_tracker(worm(), constant(2), tube_radius=0.2, gain_start=0.0),
            "gain_start must be finite and above 0",
        ),
        (lambda: lambda_tracker(without_inertia(), constant(1), tube_radius=0.2), "directly, not"),
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


def test_a_reference_of_another_time_is_refused():
    plant = chain(2, mass=1.0, stiffness=10.0, damping=5.0, rest_length=2.0)
    other = gait_reference(fast_gait(1.0), ca.SX.sym("t"))
    with pytest.raises(ValueError, match=r"plant\.t"):
        lambda_tracker(plant, other, tube_radius=0.2)
