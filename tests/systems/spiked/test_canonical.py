"""Of gaits that are equally fast, the same one is designed whatever rounding does."""

import numpy as np
import pytest
from designs import kept
from g1_worm import G1, G1_LIMITS, G1_WORM

import wormopt as wo
from wormopt.systems.spiked.design import design as designs
from wormopt.systems.spiked.design.design import Design
from wormopt.systems.spiked.design.optimize import design, designed
from wormopt.systems.spiked.gait_problem import GaitProblem, Search, Worm
from wormopt.systems.spiked.limits import Limits
from wormopt.systems.spiked.search.trial import Trier

ROBOT = {
    "schema": 1,
    "kind": "gait-design",
    "units": "SI",
    "worm": {"links": 4, "mass": "80 g", "slope": "10 deg"},
    "gait": {"period": ["2 s", "12 s"], "length": ["50 mm", "70 mm"], "spike_load": "0.5 N"},
    "motor": {"lead": "2 mm", "rate_max": 10.0, "acceleration_max": 40.0},
    "objective": {"maximise": "speed"},
    "search": {"effort": "quick"},
}


def problem(name: str) -> tuple[GaitProblem, Search]:
    scene = wo.load_scene(ROBOT if name == "robot" else name)
    return scene.table.task(scene.table.objective), scene.table.search


def nudged(task: GaitProblem, rng: np.random.Generator) -> GaitProblem:
    """The same with each number off by up to four units in its last place."""

    def off(value):
        if isinstance(value, tuple):
            return tuple(map(off, value))
        if not isinstance(value, float) or value == 0:
            return value
        return value + int(rng.integers(-4, 5)) * float(np.spacing(value))

    names = ("length", "rate", "acceleration", "spike_load")
    limits = task.limits.vary(**{name: off(getattr(task.limits, name)) for name in names})
    worm = task.worm.vary(mass=off(task.worm.mass), load=off(task.worm.load))
    return task.vary(worm=worm, limits=limits)


def lengths(found: Design) -> np.ndarray:
    return np.array([found.gait(t).ravel() for t in np.linspace(0.0, found.period, 401)])


@pytest.mark.parametrize(
    ("name", "times", "accepted"),
    [
        ("design_fast_gait", 1, 1e-6),
        pytest.param("design_uphill_gait", 3, 1e-6, marks=pytest.mark.slow),
        # its speed has a round top: a share of 1e-12 of it moves phases by its root
        pytest.param("design_spike_limited", 3, 2e-5, marks=pytest.mark.slow),
        pytest.param("robot", 8, 1e-6, marks=pytest.mark.slow),
    ],
)
def test_rounding_does_not_choose_the_gait(name: str, times: int, accepted: float):
    task, search = problem(name)
    first = designed(task, search, lambda *_: None)
    assert first.trial is not None
    assert first.speed == pytest.approx(first.trial.value, rel=1e-9)
    assert max(first.violations.values()) < 1e-9
    rng = np.random.default_rng(5)
    for _ in range(times):
        other = designed(nudged(task, rng), search, lambda *_: None)
        assert other.sequence == first.sequence
        assert other.durations == pytest.approx(first.durations, abs=accepted * first.period)
        assert lengths(other) == pytest.approx(lengths(first), rel=accepted)


QUICK = Search(effort="quick", workers=1)


def test_a_cycle_begins_with_the_smallest_order():
    """Mirror images and rotations are as fast; the design is the same one."""
    found = kept(G1_WORM, G1_LIMITS, search=QUICK)
    assert found.sequence == ((0,), (1,), (2,))


@pytest.mark.parametrize("order", [((1,), (2,), (0,)), ((2,), (1,), (0,))])
def test_an_order_that_is_asked_for_is_kept(order):
    found = design(G1_WORM, G1_LIMITS, search=QUICK.vary(sequence=order))
    assert found.sequence == order
    assert found.trial is not None
    turned, _ = designs.canonical_gait(Trier(found.task), found.trial, turn=True)
    assert turned.sequence == ((0,), (1,), (2,))
    free = kept(G1_WORM, G1_LIMITS, search=QUICK)
    assert found.speed == pytest.approx(free.speed, rel=1e-9)


def test_links_are_as_long_as_they_can_be():
    """Shorter links are as fast; the mean length is above that of the gait that is mirrored."""
    found = kept(G1_WORM, G1_LIMITS, search=QUICK)
    weights = 1.0 - np.arange(2) / 4
    mean = lengths(found)[:-1].mean(axis=0) @ weights
    mirrored = (2.0 - lengths(found)[:-1, ::-1]).mean(axis=0) @ weights
    assert mean > mirrored - 1e-6


@pytest.mark.parametrize(
    ("worm", "limits"),
    [
        (G1_WORM, G1_LIMITS),
        pytest.param(Worm(3, load=5.0), G1_LIMITS, marks=pytest.mark.slow),
        pytest.param(Worm(4, load=5.0), G1_LIMITS.vary(resting=2), marks=pytest.mark.slow),
        pytest.param(Worm(6, load=5.0), G1_LIMITS, marks=pytest.mark.slow),
        pytest.param(Worm(2, load=5.0, drag=0.5), G1_LIMITS, marks=pytest.mark.slow),
        pytest.param(G1_WORM, G1_LIMITS.vary(spike_load=27.0), marks=pytest.mark.slow),
    ],
)
def test_the_choice_costs_nothing(worm: Worm, limits: Limits, monkeypatch: pytest.MonkeyPatch):
    """Neither speed nor limits, against the gait that the search found."""
    found = kept(worm, limits, search=QUICK)
    monkeypatch.setattr(designs, "canonical_gait", lambda trier, trial, *, turn: (trial, trial))
    first = design(worm, limits, search=QUICK)
    assert found.speed >= first.speed * (1 - 1e-11)
    assert max(found.violations.values()) <= max(1e-11, *first.violations.values())


def test_an_interrupted_choice_keeps_the_gait_that_was_found(monkeypatch: pytest.MonkeyPatch):
    def interrupted(*_: object, turn: bool):
        raise KeyboardInterrupt

    monkeypatch.setattr(designs, "canonical_gait", interrupted)
    found = design(G1_WORM, G1_LIMITS, search=QUICK)
    assert found.ended == "interrupted"
    assert found.speed == pytest.approx(G1, rel=1e-9)
