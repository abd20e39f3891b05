"""Members of ensembles side by side in vectors: each as it is alone, and as closed forms say."""

import ctypes
import math
import threading

import casadi as ca
import numpy as np
import pytest

from tests.benchmarks.cases import WORK_PRECISION, mag2, track
from wormopt.errors import ArgumentError, Interrupted
from wormopt.model.model import Model, Signal
from wormopt.model.schedule import Schedule
from wormopt.simulation import ensemble
from wormopt.simulation.ensemble import Ensemble, Scenario, simulate_ensemble
from wormopt.simulation.native import build, kernel, model_code
from wormopt.simulation.options import Exact, Smooth, Tolerance
from wormopt.simulation.simulate import simulate

pytestmark = pytest.mark.compiled

_USUAL = np.concatenate([np.linspace(-4.0, 4.0, 81), np.logspace(-300, 0, 23), [0.0, -0.0]])
_FAR = np.array([30.0, -25.0, 99_999.0, -3e5, 1e22, 650.0, 720.0, -720.0, -800.0, 5e-324])
_AT = np.concatenate([_USUAL, _FAR, [math.inf, -math.inf, math.nan]])


def in_lanes(function: ca.Function, x: np.ndarray) -> np.ndarray:
    """Values (n, m) of a function (t, x, p, s) -> y at x (n, m), by the C code for lanes."""
    text = model_code.lanes_source(function)
    assert text is not None
    library = model_code._lanes_library(text)
    width = model_code.LANES
    blocks = -(-x.shape[1] // width)
    padded = np.zeros((len(x), blocks * width))
    padded[:, : x.shape[1]] = x
    room = np.zeros(2000)
    first = -room.ctypes.data % 512 // 8  # where a vector may begin
    given = room[first : first + len(x) * width]
    found = room[first + 800 : first + 800 + function.nnz_out(0) * width]
    results = []
    for k in range(blocks):
        given[:] = padded[:, k * width : (k + 1) * width].ravel()
        at = ctypes.c_void_p(given.ctypes.data)
        library.rhs(at, at, at, at, ctypes.c_void_p(found.ctypes.data))
        results.append(found.reshape(-1, width).copy())
    return np.hstack(results)[:, : x.shape[1]]


def of_x(result: ca.SX, x: ca.SX) -> ca.Function:
    t, p, s = ca.SX.sym("t"), ca.SX.sym("p"), ca.SX.sym("s")
    return ca.Function("f", [t, x, p, s], [ca.densify(result)])


@pytest.mark.parametrize("name", ["tanh", "exp", "sin", "cos"])
def test_vector_functions_are_right_to_the_last_bits(name: str):
    x = ca.SX.sym("x")
    found = in_lanes(of_x(getattr(ca, name)(x), x), _AT[None])[0]
    with np.errstate(all="ignore"):
        # digits beyond double precision where the machine has them
        right = getattr(np, name)(_AT.astype(np.longdouble))
        near = np.abs(found - right) <= 4.5e-16 * np.abs(right) + (2e-16 if name in "sincos" else 0)
        same = found == right.astype(float)
    assert np.all(near | same | (np.isnan(found) & np.isnan(right)))


_ONE = ("sqrt fabs sign floor ceil tan asin acos atan sinh cosh asinh acosh atanh log log1p expm1 "
        "erf").split()  # fmt: skip


def test_every_operation_is_that_of_casadi():
    x = ca.SX.sym("x", 2)
    a, b = x[0], x[1]
    rows = [getattr(ca, name)(a) for name in _ONE]
    rows += [a + b, a - b, a * b, a / b, -a, 1 / a, a**2, 2 * a, ca.fmax(a, b), ca.fmin(a, b)]
    rows += [ca.if_else(a < b, a, b), ca.if_else(a <= b, a, b), a == b, a != b]
    rows += [ca.logic_not(a), ca.logic_and(a, b), ca.logic_or(a, b), ca.if_else(a, b, 3)]
    rows += [ca.fabs(a) ** b, ca.fmod(a, b), ca.hypot(a, b), ca.atan2(a, b), ca.copysign(a, b)]
    function = of_x(ca.vertcat(*rows, ca.inf, -2.5), x)
    some = np.array([0.0, -0.0, 1.0, -1.0, 0.3, -2.7, 5.5, math.inf, math.nan])
    at = np.array(np.meshgrid(some, some)).reshape(2, -1)
    right = np.hstack([np.array(function(0, column, 0, 0)) for column in at.T])
    np.testing.assert_allclose(in_lanes(function, at), right, rtol=1e-15, atol=1e-16)


def test_what_vectors_cannot_do_is_left_to_single_runs():
    x, t = ca.SX.sym("x"), ca.SX.sym("t")
    assert model_code.lanes_source(of_x(ca.erfinv(x), x)) is None
    model = Model("odd", x=[Signal("x", x, value=0.1)], ode=ca.erfinv(x / 10), t=t)
    found = simulate_ensemble(model, 1.0, [Scenario(x0={"x": 0.02 * k}) for k in range(9)])
    assert set(found.codes) == {""}
    assert found.end[3].tolist() == simulate(model, 1.0, x0={"x": 0.06}).end.tolist()


# -- motions ----------------------------------------------------------------------------------


@pytest.fixture
def together(monkeypatch: pytest.MonkeyPatch):
    """`simulate_ensemble`, where no member may go alone."""

    def alone(*_: object) -> None:
        raise AssertionError("a member has gone alone")

    def run(*given: object, **options: object) -> Ensemble:
        with monkeypatch.context() as patched:
            patched.setattr(kernel, "integrate", alone)
            return simulate_ensemble(*given, **options)  # type: ignore[arg-type]

    return run


def oscillator() -> Model:
    """A mass on a spring, pushed by another force on each of three pieces of a period."""
    x, v, k, push = (ca.SX.sym(name) for name in ("x", "v", "k", "push"))
    breaks = np.array([0.0, 0.3, 0.7, 1.0])
    begin = ca.SX.sym("begin")
    schedule = Schedule("push", push, begin, breaks, np.zeros((3, 1)), periodic=True)
    states = [Signal("x", x, value=1.0), Signal("v", v, value=0.0)]
    ode = ca.vertcat(v, push - k * x)
    return Model("oscillator", states, ode, p=[Signal("k", k, value=1.0)], schedules=[schedule])


def swing(k: float, pushes: np.ndarray, t: float) -> np.ndarray:
    """The same in closed form, from piece to piece."""
    state, begun, w = np.array([1.0, 0.0]), 0.0, math.sqrt(k)
    ends = [c + b for c in range(math.ceil(t)) for b in (0.3, 0.7, 1.0)]
    for number, end in enumerate(ends):
        length = min(end, t) - begun
        rest, c, s = pushes[number % 3] / k, math.cos(w * length), math.sin(w * length)
        x, v = state[0] - rest, state[1]
        state = np.array([rest + c * x + s * v / w, c * v - w * s * x])
        begun = min(end, t)
        if begun == t:
            break
    return state


@pytest.mark.parametrize("count", [8, 11, 16, 25])
def test_members_of_any_number_have_their_closed_forms(together, count: int):
    rng = np.random.default_rng(count)
    stiff, pushes = rng.uniform(0.5, 400.0, count), rng.uniform(-1.0, 1.0, (count, 3, 1))
    members = [
        Scenario(p={"k": k}, schedules={"push": push})
        for k, push in zip(stiff, pushes, strict=True)
    ]
    times = np.linspace(0.0, 2.5, 6)
    found = together(oscillator(), 2.5, members, times=times)
    for k, push, states in zip(stiff, pushes, found.states, strict=True):
        right = np.array([swing(k, push[:, 0], t) for t in times]).T
        np.testing.assert_allclose(states, right, atol=1e-9 * math.sqrt(k))


def test_the_chapters_tracker_keeps_its_digits(together):
    case = WORK_PRECISION["track14"]
    rng = np.random.default_rng(14)
    members = [Scenario(p={"stiffness": rng.uniform(7.0, 13.0, 2)}) for _ in range(8)]
    members.insert(5, Scenario())
    found = together(track("filter"), case.span, members, contact=case.contact)
    np.testing.assert_allclose(found.end[5, :6], case.reference, atol=1e-11)
    for k in (0, 8):
        alone = simulate(track("filter"), case.span, contact=case.contact, p=members[k].p)
        np.testing.assert_allclose(found.end[k], alone.end, rtol=1e-10)
        assert found.motions[k].n_steps == pytest.approx(alone.n_steps, rel=0.01)


def test_laws_with_kinks_are_right(together):
    x, v, a, b = (ca.SX.sym(name) for name in "xvab")
    states = [Signal("x", x, value=1.0), Signal("v", v, value=0.0)]
    ode = ca.vertcat(v, -ca.if_else(x > 0, a, b) * x)
    model = Model("bent", x=states, ode=ode, p=[Signal("a", a), Signal("b", b)])
    rng = np.random.default_rng(3)
    numbers = rng.uniform(1.0, 9.0, (13, 2))
    members = [Scenario(p={"a": one, "b": other}) for one, other in numbers]
    ends = together(model, 4.0, members, tolerance=Tolerance(1e-12, 1e-13)).end
    for (one, other), end in zip(numbers, ends, strict=True):
        first, second = math.sqrt(one), math.sqrt(other)
        t = 4.0 % (math.pi / first + math.pi / second)
        if t < math.pi / 2 / first:
            right = math.cos(first * t)
        elif t < math.pi / 2 / first + math.pi / second:
            right = -first / second * math.sin(second * (t - math.pi / 2 / first))
        else:
            right = math.sin(first * (t - math.pi / 2 / first - math.pi / second))
        assert end[0] == pytest.approx(right, abs=1e-8)


def test_steep_laws_are_resolved_as_alone(together):
    # steps differ, here as between single runs whose tolerances differ in the fifth digit
    worm, members = track("derivative"), [Scenario(p={"stiffness": [9.0 + k, 9]}) for k in range(9)]
    found = together(worm, 1.0, members, contact=Smooth(1e-4))
    for k in (0, 3, 7):
        alone = simulate(worm, 1.0, contact=Smooth(1e-4), p=members[k].p)
        np.testing.assert_allclose(found.end[k], alone.end, rtol=1e-10, atol=1e-11)


def test_events_are_each_members_own(together):
    members = [Scenario(x0={"position": [0.01 * k, 0.0]}) for k in range(10)]
    times = np.linspace(0.0, 60.0, 301)
    found = together(mag2(), 60.0, members, times=times, contact=Exact())
    for k in (0, 9):
        alone = simulate(mag2(), 60.0, x0=members[k].x0, times=times)
        np.testing.assert_allclose(found.states[k], alone.states, atol=1e-10)
        of_both = zip(found.motions[k].events, alone.events, strict=True)
        for own, other in of_both:
            assert (own.name, own.kind, own.mode) == (other.name, other.kind, other.mode)
            assert own.time == pytest.approx(other.time, abs=1e-10)


# -- failures ---------------------------------------------------------------------------------


def growing() -> Model:
    x, a = ca.SX.sym("x"), ca.SX.sym("a")
    return Model("growing", x=[Signal("x", x, value=1.0)], ode=a * x**2, p=[Signal("a", a)])


def test_who_fails_leaves_the_others_alone(together):
    rates = np.array([0.2, -1.0, 3.0, 0.1, 0.0, 1.0, -7.0, 0.3, 2.0, -0.5, 0.49])
    times = [0.0, 0.4, 2.0]
    members = [Scenario(p={"a": rate}) for rate in rates]
    found = together(growing(), 2.0, members, times=times)
    ends_early = rates >= 0.5
    assert [code != "" for code in found.codes] == ends_early.tolist()
    assert set(found.codes) <= {"", "step_too_small", "not_finite"}
    np.testing.assert_allclose(found.end[~ends_early, 0], 1 / (1 - 2 * rates[~ends_early]))
    assert np.isnan(found.states[ends_early][:, 0, 2]).all()
    poles = [found.motions[k].end_time for k in np.flatnonzero(ends_early)]
    np.testing.assert_allclose(poles, 1 / rates[ends_early], rtol=1e-6)


def test_who_is_stiff_goes_on_by_implicit_steps():
    x, k, t = ca.SX.sym("x"), ca.SX.sym("k"), ca.SX.sym("t")
    ode = -k * (x - ca.cos(t))
    model = Model("lag", x=[Signal("x", x, value=0.0)], ode=ode, p=[Signal("k", k)], t=t)
    gains = np.array([1.0, 2.0, 5.0, 1e7, 8.0, 3.0, 4.0, 6.0, 7.0])
    found = simulate_ensemble(model, 10.0, [Scenario(p={"k": gain}) for gain in gains])
    share = gains / (gains**2 + 1)
    settled = share * (gains * math.cos(10.0) + math.sin(10.0))
    np.testing.assert_allclose(
        found.end[:, 0], settled - share * gains * np.exp(-10.0 * gains), atol=1e-8
    )
    routes = [motion.route for motion in found.motions]
    assert routes[3] != "native"
    assert {*routes[:3], *routes[4:]} == {"native"}


def test_steps_run_out_member_by_member(together):
    members = [Scenario(p={"k": k}) for k in (1.0, 1e8, *range(2, 9))]
    found = together(oscillator(), 1.0, members, tolerance=Tolerance(max_steps=2000))
    assert found.codes == ("", "too_many_steps", *[""] * 7)
    assert found.motions[1].n_steps + found.motions[1].n_rejected == 2000


def test_a_member_that_does_not_fit_is_refused():
    members = [Scenario(p={"a": 0.1}) for _ in range(9)]
    members[4] = Scenario(p={"rate": 0.1})
    with pytest.raises(ArgumentError, match="rate"):
        simulate_ensemble(growing(), 1.0, members)


@pytest.mark.parametrize("threads", [1, 2])
def test_members_that_are_done_are_kept_when_interrupted(threads: int):
    def report(text: str, _: float | None = None) -> None:
        if text == "simulating members":
            raise KeyboardInterrupt

    # every other one would take minutes
    members = [Scenario(p={"k": 1e8 if k % 2 else 1.0}) for k in range(40)]
    with pytest.raises(Interrupted) as caught:
        simulate_ensemble(oscillator(), 500.0, members, threads=threads, report=report)
    partial = caught.value.partial
    assert partial.codes[0] == ""
    assert partial.codes[1::2] == ("interrupted",) * 20
    assert len(partial.codes) == 40


@pytest.mark.parametrize("count", [7, 40])
@pytest.mark.parametrize("threads", [1, 2])
def test_all_are_given_up_where_the_first_spend_all_their_steps(count: int, threads: int):
    few = {"tolerance": Tolerance(max_steps=200_000), "threads": threads}
    stiff, easy = Scenario(p={"k": 1e10}), Scenario(p={"k": 1.0})
    members = [*[stiff] * (count - 1), easy]
    found = simulate_ensemble(oscillator(), 500.0, members, give_up_after=3, **few)
    assert found.codes[:3] == ("too_many_steps",) * 3
    assert set(found.codes[3:-1]) <= {"too_many_steps", "given_up"}
    assert np.isnan(found.end[3:-1]).all()
    if count == 40:
        assert found.codes[-1] == "given_up"
    else:
        tried = simulate_ensemble(oscillator(), 500.0, [easy, *members], give_up_after=3, **few)
        assert tried.codes == ("", *["too_many_steps"] * (count - 1), "")


def test_all_threads_take_members_that_wait(monkeypatch: pytest.MonkeyPatch):
    seen, advance, both = set(), kernel._advance_lanes, threading.Barrier(2)

    def watched(runs: list[kernel.Run]) -> None:
        if threading.get_ident() not in seen:
            seen.add(threading.get_ident())
            both.wait(timeout=60)
        advance(runs)

    monkeypatch.setattr(kernel, "_advance_lanes", watched)
    members = [Scenario(p={"k": 1.0 + k}) for k in range(30)]
    found = simulate_ensemble(oscillator(), 1.0, members, threads=2)
    assert len(seen) == 2
    right = [math.cos(math.sqrt(1.0 + k)) for k in range(30)]
    np.testing.assert_allclose(found.end[:, 0], right, atol=1e-10)


def test_without_a_compiler_members_go_as_before(monkeypatch: pytest.MonkeyPatch):
    members = [Scenario(p={"k": 1.0 + k}) for k in range(9)]
    monkeypatch.setattr(ensemble, "_goes_together", lambda *_: False)
    alone = simulate_ensemble(oscillator(), 1.0, members).end
    monkeypatch.undo()
    build.compiler.cache_clear()
    monkeypatch.setattr(build, "compiler", lambda: None)
    monkeypatch.setattr(model_code, "compiled_lanes", model_code.compiled_lanes.__wrapped__)
    monkeypatch.setattr(model_code, "_lanes_library", model_code._lanes_library.__wrapped__)
    found = simulate_ensemble(oscillator(), 1.0, members)
    np.testing.assert_allclose(found.end, alone, rtol=1e-13)
