"""Coils that are on or off: arcs in closed form, orders, times, limits, two routes to each."""

import math
from collections.abc import Callable
from functools import cache

import casadi as ca
import numpy as np
import pytest
from msgspec.structs import replace
from outcomes import refusals
from scipy.integrate import solve_ivp

import wormopt as wo
from wormopt.errors import ArgumentError, SolveError
from wormopt.result import Result
from wormopt.study import load_scene
from wormopt.systems.peristaltic import switching_orders as orders
from wormopt.systems.peristaltic.switched import DragGround, Limits, Objective, SwitchedWorm
from wormopt.systems.peristaltic.switching import Switched, SwitchingProgram
from wormopt.systems.peristaltic.switching_orders import all_rings, exchanged, search, states_of

SPEED, THRIFT = Objective(maximise="speed"), Objective(minimise="energy_per_distance")
FREE = Limits((0.1, 50.0))
TWO = SwitchedWorm(
    segments=2, length_on=0.6, length_off=1.4, time_on=1.0, time_off=1.0,
    ground=DragGround(-1.0),
)  # fmt: skip
THREE = replace(TWO, segments=3)


@cache
def fastest() -> Switched:
    return search(TWO, SPEED, FREE).best


class SecondOnly(DragGround):
    """Ground on which half of what the second segment gives counts, c = 1 / l."""

    def velocity(self, lengths: ca.SX, rates: ca.SX, anchored: ca.SX) -> ca.SX:
        """Half of c_1 l_1' over the sum of both c."""
        c = 1 / lengths
        return c[1] * rates[1] / (2 * (c[0] + c[1]))


def way_by_ode(worm: SwitchedWorm, found: Switched, exponent: float) -> np.ndarray:
    """Lengths and way after a period, by a Runge-Kutta code and drag written out."""
    n = worm.segments

    def rates(_: float, y: np.ndarray, state: np.ndarray) -> np.ndarray:
        lengths = y[:n]
        tau = np.where(state, worm.time_on, worm.tau_off)
        l_dot = (np.where(state, worm.length_on, worm.length_off) - lengths) / tau
        behind = -np.cumsum(l_dot) + l_dot / 2  # of centres, less the head's velocity
        c = lengths**exponent
        head = -(c @ behind) / c.sum()
        return np.append(l_dot, head - l_dot.sum() / 2)  # the middle between both ends

    y = np.append(found.start, 0.0)
    for state, d in zip(found.order, found.durations, strict=True):
        y = solve_ivp(rates, (0, d), y, args=(state,), rtol=1e-11, atol=1e-13).y[:, -1]
    return y


@pytest.mark.parametrize("longest", [2.0, 70.0])
def test_arcs_in_closed_form_are_those_of_the_ode(longest: float):
    worm = SwitchedWorm(
    segments=3, length_on=0.5, length_off=1.3, time_on=0.7, time_off=1.6,
    ground=DragGround(1.4),
)  # fmt: skip
    ring = (0, 4, 1, 5, 2, 3)
    found = SwitchingProgram(worm, 6, SPEED).at(
        states_of(ring, len(ring) // 2), np.array([0.3, 0.9, 0.2, 1.1, 0.6, longest])
    )
    end = way_by_ode(worm, found, 1.4)
    assert end[:3] == pytest.approx(found.start, abs=1e-9)
    assert end[3] == pytest.approx(found.displacement, abs=1e-9)
    assert found.worth == pytest.approx(found.displacement / found.period)


def test_the_best_times_of_two_coils_from_a_cold_start():
    found = search(TWO, SPEED, FREE)
    assert (found.tried, found.complete) == (math.factorial(3), True)
    assert found.best.worth == pytest.approx(0.0157251385080923, abs=1e-14)
    assert way_by_ode(TWO, found.best, -1.0)[2] == pytest.approx(found.best.displacement, abs=1e-9)
    program = SwitchingProgram(TWO, 4, SPEED)
    noise = np.random.default_rng(3).normal(size=(50, 4))
    for step in noise:
        other = program.at(found.best.order, found.best.durations + 1e-2 * step)
        assert other.worth < found.best.worth


def test_another_ground_has_its_own_optimum():
    # by arcs in closed form, collocation and an ODE code, of others
    found = search(replace(TWO, ground=SecondOnly(-1.0)), SPEED, FREE).best
    assert found.worth == pytest.approx(0.00793473180539, abs=5e-15)
    times = [1.77774438, 1.63243791, 1.21050997, 1.36024917]
    assert found.durations == pytest.approx(times, abs=2e-5)


def test_the_sign_of_the_exponent_turns_the_wave():
    ahead = search(replace(TWO, ground=DragGround(1.0)), SPEED, FREE)
    behind = search(TWO, SPEED, FREE)
    assert ahead.best.worth == pytest.approx(behind.best.worth, abs=1e-12)
    assert ahead.ring != behind.ring


def test_orders():
    for n in (2, 3):
        rings = list(all_rings(n))
        assert len(set(rings)) == math.factorial(2 * n - 1)
        for ring in rings[:20]:
            states = states_of(ring, len(ring) // 2)
            changes = np.abs(states - np.roll(states, 1, axis=0)).sum(axis=1)
            assert (changes == 1).all()
            for arc in range(2 * n):
                if ring[arc] % n == ring[(arc + 1) % (2 * n)] % n:
                    continue  # a coil is not put off before it is on
                other, labels = exchanged(ring, np.arange(2 * n), arc)
                assert other[0] == 0
                same = (states_of(other, len(other) // 2) == states[labels]).all(axis=1)
                assert labels[~same].tolist() == [arc]  # only the arc between both is another


@pytest.mark.slow
def test_a_search_finds_what_all_orders_give(monkeypatch: pytest.MonkeyPatch):
    every = search(THREE, SPEED, FREE)
    assert (every.tried, every.complete) == (math.factorial(5), True)
    monkeypatch.setattr(orders, "MOST_TRIED", 2)
    some = search(THREE, SPEED, FREE)
    assert some.tried < 20
    assert not some.complete
    assert some.best.worth == pytest.approx(every.best.worth, abs=1e-12)
    assert some.ring == every.ring


def duty(found: Switched) -> np.ndarray:
    """Part of the period that each coil is on."""
    return found.durations @ found.order / found.period


@pytest.mark.parametrize(
    ("limits", "kept"),
    [
        (replace(FREE, duty=0.3), lambda f: duty(f).max() <= 0.3 + 1e-9),
        (replace(FREE, together=1), lambda f: f.lasting[0].sum(axis=1).max() == 1),
        (replace(FREE, dwell=4.0), lambda f: (f.durations @ f.order).min() >= 4.0 - 1e-8),
        (Limits((2.0, 3.0)), lambda f: f.period <= 3.0 + 1e-9),
    ],
)
def test_limits_are_kept_and_cost_speed(limits: Limits, kept: Callable[[Switched], bool]):
    found = search(TWO, SPEED, limits).best
    assert kept(found)
    assert not kept(fastest())
    assert 0 < found.worth < fastest().worth


@pytest.mark.slow
def test_thrift_against_speed():
    limits = Limits((0.1, 20.0))
    fast, cheap = search(TWO, SPEED, limits).best, search(TWO, THRIFT, limits).best
    on = {id(f): float((f.durations @ f.order).sum()) for f in (fast, cheap)}
    assert cheap.displacement / on[id(cheap)] > 1.1 * fast.displacement / on[id(fast)]
    assert cheap.displacement / cheap.period < 0.9 * fast.worth
    slowest = 0.98 * fast.worth
    both = search(TWO, replace(THRIFT, speed=slowest), limits).best
    assert both.displacement / both.period == pytest.approx(slowest, rel=1e-7)
    with pytest.raises(SolveError, match=r"fastest switching has 0\.0157251"):
        search(TWO, replace(THRIFT, speed=0.02), limits)


def test_worms_that_are_none_are_refused():
    with pytest.raises(ArgumentError, match=r"segments.*2"):
        TWO.vary(segments=1)
    with pytest.raises(ArgumentError, match=r"length_on.*above 0"):
        TWO.vary(length_on=-1.0)


@pytest.mark.parametrize("aim", [SPEED, THRIFT])
def test_periods_that_are_longer_than_any_use_change_nothing(aim: Objective):
    far = Limits((0.5, 2.0**63)).that_count(TWO)
    assert far.period[0] == 0.5
    assert far.that_count(TWO) == far
    longer = replace(far, period=(0.5, 2 * far.period[1]))
    found, same = (search(TWO, aim, limits).best for limits in (far, longer))
    assert same.worth == pytest.approx(found.worth, rel=1e-12)
    assert FREE.that_count(TWO) == FREE


def solved(*changes: str) -> Result:
    return wo.run(load_scene("peristaltic_switching", ["want=[]", *changes]))


def test_the_scene_finds_the_same_by_collocation_and_simulation():
    found = solved("worm.segments=2")
    assert found.status == "ok"
    assert found.scalars["speed"].value == pytest.approx(0.0157251385080923, abs=1e-13)
    assert [check.name for check in found.checks] == [
        "simulation of the inputs found",
        "arcs in closed form",
    ]
    assert all(check.value is not None and abs(check.value) < 1e-11 for check in found.checks)
    on, start = found.scalars["on_time"].value, found.scalars["on_start"].value
    assert start[0] == 0
    assert on == pytest.approx([1.58018208 + 1.73672158, 1.73672158 + 1.42137941], abs=1e-5)
    places = found["position"].values
    assert places[:-1] - places[1:] == pytest.approx(found["length"].values)
    assert places[0, -1] - places[0, 0] == pytest.approx(found.scalars["distance"].value)


@pytest.mark.slow
def test_arcs_of_many_time_constants_are_resolved():
    found = solved("worm.segments=2", "limits.period=[24.0, 1e12]")
    assert found.status == "ok"
    assert found.scalars["time"].value == pytest.approx(24.0)
    best = search(TWO, SPEED, Limits((24.0, 24.0))).best
    assert found.scalars["speed"].value == pytest.approx(best.worth, rel=1e-9)


def test_a_polish_in_vain_names_keys_of_the_scene(monkeypatch: pytest.MonkeyPatch):
    def in_vain(*_: object) -> None:
        raise SolveError("not solved", "try another guess", code="not_solved")

    monkeypatch.setattr("wormopt.systems.peristaltic.peristaltic_switching.polish", in_vain)
    with pytest.raises(SolveError, match=r"^not solved; write limits\.period within \[2, 12\]"):
        solved("worm.segments=2", "worm.time_on=2.0")


@pytest.mark.slow
def test_the_packaged_scene_in_its_own_units_and_in_si():
    plain = solved()
    assert plain.scalars["speed"].value == pytest.approx(0.0322729487093, abs=1e-12)
    small = solved(
        'units="SI"', "worm.length_on=0.006", "worm.length_off=0.014", "worm.time_on=0.1",
        "limits.period=[0.05, 2.0]",
    )  # fmt: skip
    assert small.scalars["speed"].value == pytest.approx(plain.scalars["speed"].value / 10)


test_what_is_refused = refusals(
    "peristaltic_switching",
    """
    limits.dwell=12.0 | limits.dwell | at most 10
    objective={} | objective | no objective or two
    objective.speed=1.0 | objective.speed
    limits.together=5 | limits.together | there are only 3
    ground.exponent=0.0 | ground.exponent | write 1.0, or -1.0
    worm.length_on=1.4 | worm.length_on | equals length_off
    limits.period=[3.0, 1.0] | limits.period | smaller number first
    limits={period=[1.0, 10.0], dwell=4.0, duty=0.3} | limits.duty | at least 0.4
    worm.time_on=1e-3 | limits.period | 0.001 lengths rest long before
    worm.time_on=1e-3 | limits.period | at most 0.036
    limits={period=[1.0, 99.0], dwell=19.0} | limits.dwell | at most 18
    worm.time_off=1e3 | worm.time_on | at least 33.33
    worm.time_on=1e6 | limits.period | 1e+06 lengths hardly
    worm.time_on=1e6 | limits.period | 100, better 1e+06
    worm.time_off=0.02 | worm.time_off | at least 0.03333
    """,
)
