"""Models with delays: exact solutions, jumps that come back, what is asked of users, refusals."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from math import factorial
from typing import Any

import casadi as ca
import numpy as np
import pytest
from effort import examples
from hypothesis import given, settings
from hypothesis import strategies as st

import wormopt as wo
from wormopt.errors import ArgumentError, Interrupted, SolveError
from wormopt.model import schedule as schedules
from wormopt.model.model import Contact, Model, Output, Signal, Switch
from wormopt.model.schedule import Delay
from wormopt.simulation import delays
from wormopt.simulation.options import Route, Smooth, Tolerance
from wormopt.simulation.periodic import periodic_orbit
from wormopt.simulation.simulate import simulate


def retarded(lag: float | ca.SX = 1.0, start: float = 1.0, p: Sequence[Signal] = ()) -> Model:
    """x' = -x(t - lag), and x = start before."""
    x, past = ca.SX.sym("x"), ca.SX.sym("past")
    delays = [Delay("past", past, x, lag)]
    return Model("lagging", [Signal("x", x, value=start)], -past, p=p, delays=delays)


def by_steps(t: float, lag: float = 1.0) -> float:
    """x' = -x(t - h), x = 1 before 0: of degree n + 1 from n h to (n + 1) h."""
    s = t / lag
    return sum((-lag) ** k * (s - k + 1) ** k / factorial(k) for k in range(int(s) + 2))


def test_the_simplest_delay_equation_against_its_polynomials(route: Route):
    motion = simulate(retarded(), 12.0, route=route, dense=True)
    t = np.linspace(0, 12, 97)
    at = motion.at(t)
    assert at["x"][0] == pytest.approx([by_steps(s) for s in t], abs=1e-10)
    before = [by_steps(s - 1) if s > 1 else 1.0 for s in t]
    assert at["past"][0] == pytest.approx(before, abs=1e-10)
    assert motion.end[0] == pytest.approx(by_steps(12.0), abs=1e-10)


def test_errors_fall_with_the_tolerance():
    """No order is lost at 1, 2, 3, ..., where ever higher derivatives jump."""
    relative = np.array([1e-5, 1e-7, 1e-9, 1e-11])
    ends = [simulate(retarded(), 9.5, tolerance=Tolerance(r, r / 10)).end[0] for r in relative]
    errors = np.abs(np.array(ends) - by_steps(9.5))
    assert np.all(errors < 3 * relative)


@settings(max_examples=examples(9))
@given(
    rate=st.floats(-2, 0.5),
    lags=st.tuples(st.floats(0.05, 1.2), st.floats(0.05, 1.2)),
    weights=st.tuples(st.floats(-1, 1), st.floats(-1, 1)),
)
def test_an_exponential_that_two_delays_and_a_given_past_keep(
    rate: float, lags: tuple[float, float], weights: tuple[float, float]
):
    """x = exp(r t) solves x' = a x + b x(t - g) + c x(t - h) with a = r - b e^-rg - c e^-rh."""
    x, t, p = ca.SX.sym("x"), ca.SX.sym("t"), ca.SX.sym("p", 3)
    past = [ca.SX.sym(f"past_{k}") for k in range(2)]
    own = rate - sum(w * np.exp(-rate * h) for w, h in zip(weights, lags, strict=True))
    ode = own * x + weights[0] * past[0] + weights[1] * past[1]
    numbers = [Signal("numbers", p, value=(rate, *lags))]
    delays = [Delay(f"past_{k}", past[k], x, p[1 + k], before=ca.exp(p[0] * t)) for k in range(2)]
    lagging = Model("two lags", [Signal("x", x, value=1.0)], ode, t=t, p=numbers, delays=delays)
    motion = simulate(lagging, (0.0, 3.0), route="python")
    # what errors may have grown by: the comparison equation y' = sum of sizes times y
    growth = np.exp(3.0 * (abs(own) + abs(weights[0]) + abs(weights[1])))
    assert motion.end[0] == pytest.approx(np.exp(3 * rate), abs=1e-9 * growth)
    assert motion["past_0"][0, 0] == pytest.approx(np.exp(-rate * lags[0]), rel=1e-9)


def test_a_lag_is_a_parameter_that_needs_no_new_model():
    h = ca.SX.sym("h")
    lagging = retarded(h, p=[Signal("lag", h, "time", value=1.0)])
    for lag in (1.0, 0.3):
        found = simulate(lagging, 2.2, p={"lag": lag})
        assert found.end[0] == pytest.approx(by_steps(2.2, lag), abs=1e-10)
    with pytest.raises(ArgumentError, match="lag of past must be positive and finite, not -1"):
        simulate(lagging, 2.2, p={"lag": -1.0})


@pytest.mark.parametrize("lag", [0.5, 0.37, 2.5])
def test_jumps_come_back_after_the_lag(route: Route, lag: float):
    """A sawtooth s that falls from 1 to 0, and y' = s(t - lag), whose integral is known."""
    s, y, past = ca.SX.sym("s"), ca.SX.sym("y"), ca.SX.sym("past")
    states = [Signal("s", s, value=0.0), Signal("y", y, value=0.0)]
    switches, delays = [Switch("falls", s - 1, ca.vertcat(0, y))], [Delay("past", past, s, lag)]
    saw = Model("saw", states, ca.vertcat(1, past), switches=switches, delays=delays)
    t = np.linspace(0, 4.75, 96)
    motion = simulate(saw, 4.75, times=t, route=route)
    since = np.maximum(t - lag, 0.0)
    expected = np.floor(since) / 2 + (since % 1.0) ** 2 / 2
    assert motion["y"][0] == pytest.approx(expected, abs=1e-11)
    assert [event.time for event in motion.events] == pytest.approx([1, 2, 3, 4], abs=1e-12)
    apart = np.abs((t - lag) % 1.0 - 0.5) < 0.49  # at a jump either side may count
    assert motion["past"][0][apart] == pytest.approx((since % 1.0)[apart], abs=1e-12)


def test_a_jump_just_after_a_stretch_began_leaves_a_piece_that_is_all_but_nothing(route: Route):
    """The first step of the stretch one lag later must not look beyond that piece."""
    x, past, t = ca.SX.sym("x", 2), ca.SX.sym("past"), ca.SX.sym("t")
    memory = Delay("past", past, ca.cos(t), 0.01)
    kick = Switch("kick", t - 0.200006, x + ca.DM([1e-3, 0.0]))
    model = Model(
        "kicked", [Signal("x", x, value=2.0)], ca.vertcat(past, past**6), t=t,
        switches=[kick], delays=[memory],
    )  # fmt: skip
    motion = simulate(model, 0.3, route=route, tolerance=Tolerance(relative=1e-10, absolute=1e-11))
    # before the start the cosine was 1, for a lag
    known = np.polynomial.legendre.leggauss(20)
    sixth = 0.29 / 2 * np.sum(known[1] * np.cos(0.29 / 2 * (known[0] + 1)) ** 6)
    exact = [2.0 + 0.01 + np.sin(0.29) + 1e-3, 2.0 + 0.01 + sixth]
    np.testing.assert_allclose(motion.end, exact, atol=1e-8)


def test_breaks_of_schedules_come_back_too():
    """v' = a(t - h) of an acceleration that jumps: x is piecewise quadratic."""
    a, begin, v, past = (ca.SX.sym(n) for n in ("a", "begin", "v", "past"))
    course = wo.Schedule(
        "a", a, begin, np.array([0.0, 1.0, 1.7, 3.0]), np.array([[1.0], [-2], [5]])
    )
    delays = [Delay("past", past, a * 1.0, 0.45)]
    cart = Model("cart", [Signal("v", v, value=0.0)], past, schedules=[course], delays=delays)
    t = np.linspace(0, 3, 61)
    held = 0.45  # the acceleration at the start, before
    found = simulate(cart, 3.0, times=t)["v"][0]
    s = np.maximum(t - held, 0.0)
    expected = np.minimum(t, held) + np.minimum(s, 1.0) - 2 * np.clip(s - 1, 0, 0.7)
    expected += 5 * np.maximum(s - 1.7, 0.0)
    assert found == pytest.approx(expected, abs=1e-11)


def test_smooth_contact_and_a_later_start():
    """A block pulled to where it was: m x'' = -(x(t - h)) - F(v); twice, from 0 and from 7."""
    x, v, f, past = (ca.SX.sym(n) for n in ("x", "v", "f", "past"))
    states = [Signal("x", x, value=1.0), Signal("v", v, value=0.0)]
    contacts = [Contact("block", v, f, wo.Coulomb(1.0, 2.0))]
    delays = [Delay("past", past, x, 0.05)]
    block = Model("block", states, ca.vertcat(v, f - 9 * past), contacts=contacts, delays=delays)
    ends = [
        simulate(block, span, contact=contact).end
        for span in ((0.0, 2.0), (7.0, 9.0))
        for contact in (Smooth(0.01), wo.Exact())
    ]
    assert ends[0] == pytest.approx(ends[2], abs=1e-9)
    assert ends[1] == pytest.approx(ends[3], abs=1e-9)
    assert ends[0] == pytest.approx(ends[1], abs=0.05)
    assert np.abs(ends[0] - ends[1]).max() > 1e-4


# -- what users see ------------------------------------------------------------------------------


def test_a_motion_with_delays_ends_by_a_switch_and_is_stopped():
    model = retarded()
    until = Switch("half", 0.55 - model["x"], model["x"], terminal=True)
    motion = simulate(replace(model, switches=[until]), 9.0, times=np.linspace(0, 9, 91))
    assert motion.end_time == pytest.approx(0.45, abs=1e-12)
    assert len(motion.time) == 5
    # at the very end of a stretch too
    at_one = Switch("one", -model["x"], model["x"], terminal=True)
    assert simulate(replace(model, switches=[at_one]), 9.0).end_time == pytest.approx(1.0)
    calls = []

    def stop(_text: str, fraction: float | None = None) -> None:
        calls.append(fraction)
        if len(calls) > 3:
            raise KeyboardInterrupt

    with pytest.raises(Interrupted) as stopped:
        simulate(model, 9.0, times=np.linspace(0, 9, 91), report=stop)
    partial = stopped.value.partial
    assert partial.end_time == pytest.approx(3.0)
    assert partial["x"][0, -1] == pytest.approx(by_steps(3.0), abs=1e-10)


def test_steps_are_counted_over_all_stretches():
    with pytest.raises(SolveError, match="steps was reached") as refused:
        simulate(retarded(0.5), 15.0, tolerance=Tolerance(max_steps=40))
    assert 30 <= refused.value.partial.n_steps <= 41
    assert 0 < refused.value.partial.end_time < 10


def test_ensembles_and_sharing_of_models():
    members = [wo.Scenario(x0={"x": value}) for value in (1.0, -2.0)]
    ends = wo.simulate_ensemble(retarded(), 3.5, members).end
    assert ends[:, 0] == pytest.approx([by_steps(3.5), -2 * by_steps(3.5)], abs=1e-10)


def test_a_lag_of_any_length_beyond_the_end_is_a_constant():
    """x' = -x(t - h) = -1 while t < h."""
    for lag in (3.0, 1e9, 1e18, 1e300):
        motion = simulate(retarded(lag), 3.0, times=np.linspace(0, 3, 7))
        assert motion["x"][0] == pytest.approx(1 - np.linspace(0, 3, 7), abs=1e-12)
        assert motion["past"][0] == pytest.approx(1.0, abs=1e-15)


def test_rates_of_the_past_are_not_known():
    """x' = v + x(t - h): x'' holds a rate of the past; with the past in v' it does not."""
    x, v, u, past = (ca.SX.sym(name) for name in ("x", "v", "u", "past"))
    states = [Signal("x", x, value=0.0), Signal("v", v, value=0.0)]
    delayed = {"u": [Signal("input", u, value=0.0)], "delays": [Delay("past", past, x, 0.3)]}
    with pytest.raises(ArgumentError, match="rates of delayed signals are unknown"):
        wo.normal_form(Model("early", states, ca.vertcat(v + past, u - x), **delayed), output="x")
    late = Model("late", states, ca.vertcat(v, u - x - past), **delayed)
    form = wo.normal_form(late, output="x")
    assert ca.is_equal(ca.simplify(form.drift + x + past), ca.SX(0))
    with pytest.raises(ArgumentError, match="zero dynamics does not support delays"):
        form.zero_dynamics()
    still = wo.Reference(ca.SX(1), ca.SX(0), ca.SX(0))
    with pytest.raises(ArgumentError, match="LQR does not support delays"):
        wo.lqr(late, still, error_weight=1.0, output="x")


def forced() -> Model:
    v, f, past = ca.SX.sym("v"), ca.SX.sym("f"), ca.SX.sym("past")
    contact = Contact("block", v, f, wo.Coulomb(1.0, 1.0))
    delay = Delay("past", past, f * 1.0, 0.1)
    return Model("block", [Signal("v", v, value=1.0)], f - past, contacts=[contact], delays=[delay])


def shown() -> Model:
    model = retarded()
    return replace(model, outputs=[Output("place", model["x"])])


@pytest.mark.parametrize(
    ("use", "message"),
    [
        (lambda: simulate(retarded(), 1.0, route="cvodes"), "do not support delays"),
        (lambda: simulate(retarded(1e-9), 1.0), r"1e\+09 stretches, more than max_steps"),
        (lambda: simulate(forced(), 1.0), "not on contact forces or delayed signals"),
        (lambda: periodic_orbit(retarded(), 1.0), "does not support delays, and lagging has past"),
        (lambda: wo.linearise(shown(), output="place"), "has delays"),
        (lambda: wo.relative_degree(shown(), output="place"), "has delays"),
        (lambda: wo.steady_states(retarded(), {"x": (-1.0, 1.0)}), "does not support delays"),
        (lambda: wo.average(retarded(), 1.0), "does not support delays"),
        (lambda: wo.scenario_model(retarded(), [{}]), "does not support delays"),
        (lambda: retarded(0.0), "lag must be finite and above 0"),
        (lambda: retarded(float("nan")), "lag must be finite and above 0"),
        (lambda: Delay("past", ca.SX.sym("p", 2), ca.SX.sym("x"), 1.0), "columns of one size"),
        (lambda: Delay("past", ca.SX(1.0), ca.SX.sym("x"), 1.0), "columns of one size"),
        (lambda: replace(retarded(), p=[Signal("past", ca.SX.sym("q"))]), "share the name"),
    ],
)
def test_what_knows_no_delays_refuses_them(use: Callable[[], object], message: str):
    with pytest.raises(ArgumentError, match=message):
        use()


def test_an_optimisation_refuses_delays():
    model = retarded()
    ends = wo.Ends.of(model)
    problem = wo.Problem(model=model, ends=ends, minimise=ends.duration, duration=(0.1, 1.0))
    mesh, guess = wo.Mesh.even(1, 4, wo.Collocation(2)), wo.Guess(1.0, lambda t: 1 + 0 * t[None])
    with pytest.raises(ArgumentError, match="optimisation does not support delays"):
        wo.optimise(problem, mesh, wo.FixedModes(wo.ModeSequence(((),))), guess)


def passed_on(signal: ca.SX, t: ca.SX, before: ca.SX | None = None) -> Model:
    """A state that grows by a signal of time half a second ago."""
    sum_, past = ca.SX.sym("sum"), ca.SX.sym("past")
    delay = Delay("past", past, signal, lag=0.5, before=before)
    return Model("passed on", [Signal("sum", sum_, value=0.0)], past, t=t, delays=[delay])


@pytest.mark.parametrize("place", [-0.3, 0.3, 1.234567])
def test_pulses_and_steps_in_what_is_remembered_are_seen(place: float):
    t = ca.SX.sym("t")
    pulse = ca.logic_and(t > place, t < place + 1e-4) * 1e4
    gauss = ca.exp(-(((t - place) / 1e-3) ** 2))
    sums = 1.0, (2.5 if place > 0 else 0.0) - place, np.sqrt(np.pi) * 1e-3
    for signal, sum_ in zip((pulse, t > place, gauss), sums, strict=True):
        model = passed_on(signal, t) if place > 0 else passed_on(0 * t, t, before=signal)
        assert simulate(model, 3.0).end == pytest.approx([sum_], rel=1e-7)


def test_a_past_of_any_size_is_remembered_in_few_pieces(monkeypatch: pytest.MonkeyPatch):
    """The signal is 0 at the start, so the allowed error must come from the past itself."""
    counts: list[int] = []

    def counted(*given: Any) -> Any:
        pieces = schedules.fitted(*given)
        counts.append(len(pieces))
        return pieces

    monkeypatch.setattr(delays, "fitted", counted)
    t = ca.SX.sym("t")
    gauss = ca.exp(-(((t + 0.3) / 1e-3) ** 2))
    simulate(passed_on(0 * t, t, before=gauss), 0.5)
    assert max(counts) < 100


@pytest.mark.parametrize("remembers", ["sign", "state"])
def test_a_relay_with_a_delay_turns_where_it_did(remembers: str, route: Route):
    """x' = -sign x(t - 1) from 0.5 falls to -1, and goes between -1 and 1 ever after."""
    x, past = ca.SX.sym("x"), ca.SX.sym("past")
    signal, ode = (ca.sign(x), -past) if remembers == "sign" else (x, -ca.sign(past))
    delays = [Delay("past", past, signal, 1.0)]
    model = Model("relay", [Signal("x", x, value=0.5)], ode, delays=delays)
    motion = simulate(model, 6.0, times=[1.5, 3.5, 6.0], route=route)
    assert motion.states[0] == pytest.approx([-1.0, 1.0, -0.5], abs=1e-8)
