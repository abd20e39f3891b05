"""Motions that routes refuse or leave to each other: growth, work without end, stiffness."""

from dataclasses import replace
from typing import Any

import casadi as ca
import numpy as np
import pytest
import simulated
from on_routes import ALL, attempted, scalar, sine_worm

from wormopt.errors import SolveError
from wormopt.model.friction import Coulomb
from wormopt.model.model import Model, Signal, Switch
from wormopt.simulation import routes
from wormopt.simulation.initial_value import InitialValueProblem, Outcome
from wormopt.simulation.options import Route, Smooth, Tolerance
from wormopt.simulation.simulate import simulate


def refused(model: Model, span: float, route: Route, **options: Any) -> SolveError:
    error = simulated.refused(model, span, route, **options)
    motion = error.partial
    assert motion.route in (route, "idas")
    assert len(motion.time) == motion.states.shape[1]
    assert np.all(motion.time <= motion.end_time)
    return error


@pytest.mark.parametrize("route", ALL)
def test_growth_beyond_bounds_keeps_what_there_is(route: Route):
    t = np.linspace(0, 2, 201)
    error = refused(scalar("x^2"), 2.0, route, times=t)
    assert error.code in ("step_too_small", "not_finite", "solver_failed")
    assert (error.code == "solver_failed") == (route == "cvodes")
    motion = error.partial
    assert 0.95 < motion.end_time < 1 + 1e-9
    assert motion.time.tolist() == t[: len(motion.time)].tolist()
    known = motion.time < 0.9
    assert motion.states[0, known] == pytest.approx(1 / (1 - motion.time[known]), rel=1e-6)


@pytest.mark.parametrize("route", ALL)
def test_what_is_no_number_is_refused(route: Route):
    assert refused(scalar("x"), 1.0, route, x0={"x": np.nan}).code == "not_finite"
    codes = ("not_finite", "step_too_small", *(("solver_failed",) if route == "cvodes" else ()))
    assert refused(scalar("-1/sqrt x"), 1.0, route).code in codes


@pytest.mark.parametrize("route", ALL)
def test_work_without_end_is_refused(route: Route):
    y = ca.SX.sym("y", 2)
    model = Model("circle", x=[Signal("y", y, value=1.0)], ode=ca.vertcat(y[1], -y[0]))
    error = refused(model, 1e6, route, tolerance=Tolerance(max_steps=500))
    assert error.code == "too_many_steps"
    assert error.partial.end_time < 1e3
    assert error.partial.end_time > 0 or route == "cvodes"  # which stops at samples only
    assert error.partial.n_steps <= 500


@pytest.mark.parametrize("most", [60, 61, 62, 63])
def test_steps_that_are_too_inexact_count_as_work(route: Route, most: int):
    """Pulses of a width that the steps between them do not know."""
    x, t = ca.SX.sym("x"), ca.SX.sym("t")
    ode = 10 * ca.exp(-100 * ca.sin(t) ** 2) - x
    model = Model("pulses", x=[Signal("x", x, value=1.0)], ode=ode, t=t)
    error = refused(model, 1e5, route, tolerance=Tolerance(max_steps=most, max_step=np.inf))
    assert error.code == "too_many_steps"
    assert error.partial.n_rejected > 10
    assert error.partial.n_steps + error.partial.n_rejected == most


def test_no_polynomial_is_fitted_that_nobody_asks_for(route: Route):
    """Twelve evaluations for a step, three more for a sample within it, two at the start."""
    y = ca.SX.sym("y", 2)
    model = Model("circle", x=[Signal("y", y, value=(1.0, 0.0))], ode=ca.vertcat(y[1], -y[0]))
    for times in ([50.0], [25.0, 50.0]):
        motion = simulate(model, 50.0, times=times, route=route)
        assert motion.n_rejected == 0
        assert motion.n_evaluations == 12 * motion.n_steps + 2 + 3 * (len(times) - 1)


def test_a_guard_that_is_no_number_is_refused(route: Route):
    x, t = ca.SX.sym("x"), ca.SX.sym("t")
    guard = Switch("root", ca.sqrt(1 - t), x)
    model = Model("root", x=[Signal("x", x, value=1.0)], ode=-x, t=t, switches=[guard])
    error = refused(model, 2.0, route)
    assert error.code == "not_finite"
    assert error.partial.end_time <= 1.0


@pytest.mark.parametrize(("share", "ticks"), [(0.99, 64), (1.01, 150)])
def test_as_many_events_are_allowed_as_functions_are_watched(
    route: Route, share: float, ticks: int
):
    """32, and 16 for each: the one after them may come 1e-10 of the span after the first."""
    w, n = ca.SX.sym("w"), ca.SX.sym("n")
    tick = share * 4e-10 / 64
    clock = Model(
        "clock",
        x=[Signal("w", w, value=0.0), Signal("n", n, value=0.0)],
        ode=ca.vertcat(ca.tanh(1e3 * (150 - n)), 0),
        switches=[
            Switch("tick", w - tick, ca.vertcat(0, n + 1)),
            Switch("never", -1 - n, ca.vertcat(w, n)),
        ],
    )
    motion, code = attempted(clock, (2.0, 6.0), route=route)
    assert len(motion.events) == ticks
    assert code == ("" if ticks == 150 else "events_accumulate")


@pytest.mark.parametrize(("hits", "code"), [(30, ""), (31, "events_accumulate")])
def test_at_one_instant_switches_may_fire_each_other_ten_times_each(
    route: Route, hits: int, code: str
):
    """Each of two throws the ball to the other, but for the last that has it."""
    t, a, b, n = (ca.SX.sym(name) for name in ("t", "a", "b", "n"))
    over = ca.if_else(n < hits - 1, 1, -1)
    table = Model(
        "table",
        x=[Signal(name, s, value=-1.0) for name, s in (("a", a), ("b", b))]
        + [Signal("n", n, value=0.0)],
        ode=ca.SX([-1, -1, 0]),
        t=t,
        switches=[
            Switch("serve", t - 0.5, ca.SX([1, -1, 0])),
            Switch("ping", a, ca.vertcat(-1, over, n + 1)),
            Switch("pong", b, ca.vertcat(over, -1, n + 1)),
        ],
    )
    motion, found = attempted(table, 1.0, route=route)
    assert found == code
    assert (motion.end[2], len(motion.events)) == (hits, hits + 1)


def test_a_guard_that_a_jump_has_lowered_fires_with_another_of_the_same_value(route: Route):
    """x = t goes back by 2 at 2 with one exact step to each event."""
    x, a, b = (ca.SX.sym(name) for name in ("x", "a", "b"))
    model = Model(
        "rounds",
        x=[Signal(name, s, value=0.0) for name, s in (("x", x), ("a", a), ("b", b))],
        ode=ca.SX([1, 0, 0]),
        switches=[
            Switch("a", x - 1, ca.vertcat(x, a + 1, b)),
            Switch("b", x - 1, ca.vertcat(x, a, b + 1)),
            Switch("back", x - 2, ca.vertcat(0, a, b)),
        ],
    )
    motion = simulate(model, 9.5, route=route, tolerance=Tolerance(max_step=np.inf))
    assert [event.name for event in motion.events] == 4 * ["a", "b", "back"] + ["a", "b"]
    assert motion.end == pytest.approx([1.5, 5.0, 5.0], abs=1e-12)


def test_progress_is_the_share_of_the_time_that_has_passed():
    said: list[float] = []
    y = ca.SX.sym("y", 2)
    model = Model("circle", x=[Signal("y", y, value=1.0)], ode=ca.vertcat(y[1], -y[0]))
    simulate(
        model, (4.0, 6.0), route="python", tolerance=Tolerance(max_step=1.25e-3),
        report=lambda text, share: said.append(share or 0.0),
    )  # fmt: skip
    assert said == pytest.approx([0, 500 / 1600, 1000 / 1600, 1500 / 1600], abs=1e-9)


def relaxation() -> Model:
    """Van der Pol's oscillator, very stiff; counts how often x rises through 0."""
    x, count = ca.SX.sym("x", 2), ca.SX.sym("count")
    states = [Signal("x", x, value=(2.0, 0.0)), Signal("count", count, value=0.0)]
    ode = ca.vertcat(x[1], 1e3 * (1 - x[0] ** 2) * x[1] - x[0], 0)
    switches = [Switch("rises", x[0], ca.vertcat(x, count + 1))]
    return Model("relaxation", states, ode, switches=switches)


def test_explicit_steps_give_up_where_they_would_crawl(route: Route):
    error = refused(relaxation(), 4e4, route)
    assert error.code == "stiff"
    assert 0 < error.partial.end_time < 1e3
    assert error.partial.end[0] == pytest.approx(2.0, abs=0.1)


@pytest.mark.usefixtures("no_compiler")
def test_stiff_motions_with_switches_take_implicit_steps():
    tolerance = Tolerance(1e-7, 1e-8)
    t = np.linspace(0, 1700, 35)
    motion = simulate(relaxation(), 1700.0, times=t, dense=True, tolerance=tolerance)
    assert motion.route == "radau"
    (event,) = motion.events
    assert motion.n_steps < 2000
    assert motion.end[2] == 1
    assert motion.at(t).states == pytest.approx(motion.states, abs=1e-12)
    # found without events by another code
    smooth = replace(relaxation(), switches=())
    times = [event.time - 1e-7, event.time + 1e-7]
    before, after = simulate(smooth, 1700.0, times=times, route="cvodes").states[0]
    slope = (after - before) / 2e-7
    assert event.time - before / slope == pytest.approx(event.time, abs=1e-4)


@pytest.mark.slow
def test_where_implicit_steps_are_too_many_explicit_ones_go_on(monkeypatch: pytest.MonkeyPatch):
    """Steps in Python have a limit of their own: nobody waits for ten million of them."""
    tolerance = Tolerance(1e-7, 1e-8)
    few = simulate(relaxation(), 4000.0, tolerance=tolerance)
    monkeypatch.setattr(routes, "_STEPS_FOR_A_LOOK", 20)
    monkeypatch.setattr(routes, "_STEPS_IN_PYTHON", 20)
    many = simulate(relaxation(), 4000.0, tolerance=tolerance)
    assert (few.route, many.route) == ("radau", "native")
    assert many.n_steps > 100 * few.n_steps
    assert many.end[2] == few.end[2] > 1
    assert many.events[0].time == pytest.approx(few.events[0].time, abs=1e-3)


@pytest.mark.compiled
@pytest.mark.parametrize(("end", "limits"), [(4e3, [30, 60]), (1e9, [30])])
def test_implicit_steps_end_early_where_they_get_nowhere(
    end: float, limits: list[int], monkeypatch: pytest.MonkeyPatch
):
    """A few of them show whether the end is within reach of all."""
    asked, in_python = list[int](), routes._in_python

    def noted(task: InitialValueProblem, *given: Any, **options: Any) -> Outcome:
        if options:  # implicit ones
            asked.append(task.tolerance.max_steps)
        return in_python(task, *given, **options)

    monkeypatch.setattr(routes, "_in_python", noted)
    monkeypatch.setattr(routes, "_STEPS_FOR_A_LOOK", 30)
    monkeypatch.setattr(routes, "_STEPS_IN_PYTHON", 60)
    with pytest.raises(SolveError) as caught:
        simulate(relaxation(), end, tolerance=Tolerance(1e-7, 1e-8, max_steps=3000))
    assert (caught.value.code, asked) == ("too_many_steps", limits)


def test_what_passes_the_smooth_layer_unseen_is_refused():
    error = refused(
        sine_worm(Coulomb(1.0, 10.0)),
        10.0,
        "cvodes",
        contact=Smooth(1e-8),
        tolerance=Tolerance(1e-4, 1e-5),
    )
    assert error.code == "layer_not_resolved"
    assert error.partial.end_time < 10.0
