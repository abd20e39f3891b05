"""What limits are worth: by formulas, by solving again with the limit moved, by units."""

from pathlib import Path

import numpy as np
import pytest
from effort import examples
from g1_worm import G1_LIMITS, G1_WORM
from hypothesis import assume, given, settings
from hypothesis import strategies as st

import wormopt as wo
from wormopt.errors import ArgumentError
from wormopt.numerics.bilinear import Climb
from wormopt.pictures import draw
from wormopt.progress import silent
from wormopt.systems.spiked.design.design import Design
from wormopt.systems.spiked.design.optimize import design, designed
from wormopt.systems.spiked.design.sensitivity import (
    Limit,
    Sensitivity,
    limits_of,
    scaling_error,
    sensitivities,
)
from wormopt.systems.spiked.gait_problem import GaitProblem, Objective, Search, Worm
from wormopt.systems.spiked.limits import Limits, Rates

ORDER = ((0,), (1,), (2,))


def by_name(known: tuple[Sensitivity, ...]) -> dict[str, Sensitivity]:
    return {s.name: s for s in known}


def climbed_again(found: Design, limit: Limit, share: float) -> float:
    """The objective where a limit has moved, solved in units of its own from the same arcs."""
    trial = found.trial
    assert trial is not None
    old, task = trial.program, limit.moved(limit.value * (1 + share))
    shortest, longest = (end / trial.cycles for end in task.limits.period_range)
    widths = old.widths(trial.point)
    widths = widths * np.clip(widths.sum(), shortest, longest) / widths.sum()
    new = type(old)(task, old.sequence, (shortest, longest), old.arcs, old.degree)
    start = new.start_arcs(widths)
    assert start is not None
    point, _ = new.bilinear.sharpen(new.bilinear.climb(start, Climb(1e-10, 60)))
    return abs(new.objective(point))


def designed_again(found: Design, limit: Limit, share: float) -> float:
    """The objective where a limit has moved, by a search from nothing."""
    trial = designed(limit.moved(limit.value * (1 + share)), Search(), silent).trial
    assert trial is not None
    return abs(trial.value)


def assert_confirmed(found: Design, again=climbed_again, share: float = 1e-3) -> None:
    """Central differences, which a curved objective leaves alone, to 1 %."""
    known = sensitivities(found)
    assert [s for s in known if s.one_sided] == []
    assert found.trial is not None
    for s, limit in zip(known, limits_of(found.task), strict=True):
        if s.value:
            change = again(found, limit, share) - again(found, limit, -share)
            elasticity = change / (2 * share * abs(found.trial.value))
            assert s.elasticity == pytest.approx(elasticity, rel=0.01, abs=2e-5), s.name


@given(
    rate=st.floats(0.5, 1.5),
    acceleration=st.floats(10.0, 40.0),
    load=st.floats(4.0, 12.0),
    mass=st.floats(0.5, 2.0),
    period=st.floats(0.9, 1.2),
)
@settings(max_examples=examples(10))
def test_two_masses_have_a_formula(rate, acceleration, load, mass, period):
    """A trapezoid of the rate: up with the acceleration, down with what the load holds back."""
    fall = 2 * load / mass
    assume(fall < 0.95 * acceleration)
    ramps = 1 / acceleration + 1 / fall
    assume(rate * ramps < 0.3 * period)
    found = design(
        Worm(1, mass, load=load),
        Limits(period, (0.5, 2.0), rate=rate, acceleration=acceleration),
        search=Search(sequence=((0,), (1,)), effort="quick"),
    )
    speed = rate / 2 - rate**2 / (2 * period) * ramps
    assert found.trial is not None
    assume(found.cycles == 1)
    assert found.speed == pytest.approx(speed, rel=1e-9)
    known = by_name(sensitivities(found))
    expected = {
        "limits.rate": 0.5 - rate / period * ramps,
        "limits.period": rate**2 / (2 * period**2) * ramps,
        "limits.acceleration": rate**2 / (2 * period) / acceleration**2,
        "worm.load": rate**2 / (2 * period) / (fall * load),
        "worm.mass": -(rate**2) / (2 * period) / (fall * mass),
        "limits.length.longest": 0.0,
    }
    for name, derivative in expected.items():
        assert known[name].derivative == pytest.approx(derivative, rel=1e-3, abs=1e-7), name


def test_where_more_limits_meet_than_need_to_no_single_one_helps():
    """The stroke of a link is just what its rate allows: speed is 0.425 by either."""
    limits = G1_LIMITS.vary(length=(0.7, 0.7 + 0.425))
    found = design(Worm(1, load=5.0), limits, search=Search(sequence=((0,), (1,)), effort="quick"))
    assert found.speed == pytest.approx(0.425, abs=1e-9)
    known = by_name(sensitivities(found))
    assert all(known[name].one_sided for name in ("limits.rate", "limits.length.longest"))
    for name, raised, lowered in (
        ("limits.rate", 0.0, 0.35),
        ("limits.length.longest", 0.0, 1.0),
        ("limits.length.shortest", -1.0, 0.0),
        ("limits.period", -0.425, 0.075),
        ("limits.acceleration", 0.0, 1 / 800),
    ):
        s = known[name]
        assert (s.raised, s.lowered) == pytest.approx((raised, lowered), rel=1e-3, abs=1e-6), name
        assert s.derivative == pytest.approx(0.0, abs=1e-6), name


@pytest.mark.slow
def test_cost_solved_again():
    """Of a cost, which ways are better is turned round; so is the required speed."""
    search = Search(sequence=((0,), (1,), (0, 1), (1,), (2,)), effort="quick")
    found = design(G1_WORM, G1_LIMITS, "peak_spike_load", 0.75, search)
    assert found.trial is not None
    assert -found.trial.value == pytest.approx(25.434782608695, abs=1e-7)
    assert_confirmed(found)
    known = by_name(sensitivities(found))
    assert known["limits.rate"].derivative < 0 < known["objective.speed"].derivative


@pytest.mark.slow
def test_lists_add_up_to_the_one_number():
    """Also where a family of gaits is the best, as here: single multipliers differ by half."""
    search = Search(sequence=ORDER, effort="quick")
    one = by_name(sensitivities(design(G1_WORM, G1_LIMITS, search=search)))
    each = G1_LIMITS.vary(rate=Rates(1.0, (1.0, 1.0)), acceleration=(20.0, 20.0))
    worm = G1_WORM.vary(mass=(1.0, 1.0, 1.0))
    many = by_name(sensitivities(design(worm, each, search=search)))
    for name, parts in (
        ("limits.acceleration", ["limits.acceleration[0]", "limits.acceleration[1]"]),
        (
            "limits.rate",
            ["limits.rate.contraction", "limits.rate.extension[0]", "limits.rate.extension[1]"],
        ),
        ("worm.mass", ["worm.mass[0]", "worm.mass[1]", "worm.mass[2]"]),
    ):
        total = sum(many[part].derivative for part in parts)
        assert total == pytest.approx(one[name].derivative, rel=1e-2), name


@pytest.mark.slow
@given(seed=st.integers(0, 2**32 - 1))
@settings(max_examples=examples(8))
def test_other_units_describe_the_same_worm(seed):
    """Elasticities times powers of a unit add up to that of the speed."""
    random = np.random.default_rng(seed)
    masses = random.uniform(0.5, 2.0, 3).tolist()
    worm = Worm(2, masses, load=(random.uniform(3, 6), random.uniform(6, 9)))
    limits = Limits(
        period=(0.5, random.uniform(0.8, 1.5)),
        length=((0.7, random.uniform(0.9, 1.3)), (0.6, random.uniform(0.9, 1.3))),
        rate=random.uniform(0.5, 1.5, 2).tolist(),
        acceleration=random.uniform(10, 40),
        spike_load=random.uniform(40, 60),
        sigma_margin=random.uniform(0.1, 1.0),
    )
    found = design(worm, limits, search=Search(sequence=ORDER))
    known = sensitivities(found)
    assume(not any(s.one_sided for s in known))
    assert scaling_error(known, Objective()) < 1e-2  # what is promised


def test_names_are_those_of_the_scene_and_each_moves_its_own_number():
    limits = G1_LIMITS.vary(period=(0.5, 1.0), rate=Rates(1.0, (1.0, 2.0)), spike_load=40.0)
    task = GaitProblem(G1_WORM.vary(load=(4.0, 4.0)), limits)
    moved = {limit.name: limit.moved(1.1 * limit.value) for limit in limits_of(task)}
    assert list(moved) == [
        "limits.period.shortest", "limits.period.longest", "limits.length.shortest",
        "limits.length.longest", "limits.rate.contraction", "limits.rate.extension[0]",
        "limits.rate.extension[1]", "limits.acceleration", "limits.spike_load",
        "limits.sigma_margin", "worm.mass", "worm.load",
    ]  # fmt: skip
    assert moved["limits.rate.extension[1]"].limits.rate == Rates(1.0, (1.0, 2.2))
    assert moved["limits.length.longest"].limits.length == pytest.approx((0.7, 1.43))
    assert moved["worm.load"].worm.load_range == pytest.approx((4.4, 4.4))


def test_scene_tells_what_binds(tmp_path: Path):
    change = ['units="SI"', "gait.acceleration=[20, 20]", "search.sequence=[[0], [1], [2]]",
              'search.effort="quick"']  # fmt: skip
    scene = wo.load_scene("design_fast_gait", change)
    result = wo.run(scene)
    rate = result.scalars["sensitivity.rate"]
    assert rate.value == pytest.approx(0.651333, abs=1e-6)
    assert rate.unit == "1"
    acceleration = result.scalars["sensitivity.acceleration"]
    assert sum(acceleration.value) == pytest.approx(0.004441, rel=1e-2)
    assert acceleration.unit == "s"
    assert result.scalars["sensitivity.load"].unit == "m s-1 N-1"
    assert result.trust["sensitivity"]["scaling_error"] < 1e-4
    assert result.attributes["limits"]["name"][3] == "gait.rate"
    draw(result, "limits", tmp_path / "limits.png")


@pytest.mark.slow
def test_smooth_costs_have_none():
    search = Search(sequence=((0,), (1,)), effort="quick", workers=1)
    found = design(Worm(1, load=5.0), G1_LIMITS, "acceleration_effort", 0.3, search)
    for verb in (sensitivities, wo.certify):
        with pytest.raises(ArgumentError, match=r"acceleration_effort.*; design for speed, peak"):
            verb(found)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("worm", "limits"),
    [
        (G1_WORM, G1_LIMITS),
        (G1_WORM, G1_LIMITS.vary(spike_load=27.0)),
        (G1_WORM.vary(drag=0.5), G1_LIMITS),
        (
            Worm(2, load=9.49),
            Limits(1.54, (0.606, 0.862), rate=1.68, acceleration=67.7, spike_load=114.0),
        ),
        (
            Worm(2, (1.24, 0.608, 1.15), load=9.93),
            Limits(0.693, (0.618, 1.28), rate=0.721, acceleration=4.27, spike_load=34.3),
        ),
        (
            Worm(2, load=6.45),
            Limits(
                (0.384, 0.566),
                (0.537, 1.13),
                resting=2,
                rate=Rates((1.34, 0.843), (1.13, 0.948)),
                acceleration=27.3,
            ),
        ),
        (
            Worm(2, drag=0.161, load=7.1),
            Limits(3.09, ((0.605, 1.07), (0.605, 0.913)), rate=1.24, acceleration=26.6),
        ),
        (
            Worm(2, load=2.14),
            Limits(3.35, (0.694, 1.23), rate=0.679, acceleration=15.1, spike_load=10.3),
        ),
    ],
)
def test_problems_solved_again(worm: Worm, limits: Limits):
    assert_confirmed(design(worm, limits))


@pytest.mark.slow
@pytest.mark.parametrize("limits", [G1_LIMITS, G1_LIMITS.vary(spike_load=27.0)])
def test_whole_designs_again(limits: Limits):
    assert_confirmed(design(G1_WORM, limits), designed_again)
