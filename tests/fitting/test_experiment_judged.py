"""Planned experiments judged: against random ones, and by fits to what scipy's steps recorded."""

import math

import numpy as np
import pytest
from scipy.stats import chi2

import wormopt as wo
from tests.oracles.by_recordings import Course, Ground, chain, follow
from wormopt.fitting.experiment import largest_excess
from wormopt.model.friction import Coulomb
from wormopt.systems.block.block import block

pytestmark = pytest.mark.slow

LENGTHS = {"length": (1.4, 2.6)}
UNKNOWNS = [
    wo.Unknown("forward", ["friction_forward"]),
    wo.Unknown("backward", ["friction_backward"]),
    wo.Unknown("damping", ["damping"]),
    wo.Unknown("stiffness", ["stiffness"]),
]
VALUES = (0.3, 1.0, 1.0, 10.0)


def worm(end: float, choice: wo.Ramps | wo.Waves) -> wo.Experiment:
    """Three masses, whose links' rest lengths are moved."""
    forward, backward, damping, stiffness = VALUES
    law = Coulomb(forward, backward)
    model = wo.chain(2, mass=1.0, stiffness=stiffness, damping=damping, rest_length=2.0, law=law)
    times = np.arange(1, round(50 * end) + 1) / 50
    return wo.Experiment(model, UNKNOWNS, {"position": 0.01}, times, [choice], limits=LENGTHS)


def moved(pieces: int, end: float) -> wo.Ramps:
    return wo.Ramps("rest_length", (2.0, 2.0), end, pieces, change=0.5, rate=1.0)


def waves() -> wo.Waves:
    return wo.Waves("rest_length", (2.0, 2.0), (0.2, 0.6), 2, change=0.5, rate=1.5)


def dragged() -> wo.Experiment:
    """A block on dry ground with stiction that a force moves and a camera follows."""
    unknowns = [wo.Unknown("mass"), wo.Unknown("friction_forward"), wo.Unknown("friction_backward")]
    force = wo.Ramps("force", (0.0,), 6.0, 8, change=3.0, rate=6.0)
    return wo.Experiment(
        block(Coulomb(1.0, 2.0, 1.3, 2.6)),
        unknowns,
        {"position": 0.01, "velocity": 0.05},
        np.arange(1, 301) / 50,
        [force],
        limits={"position": (-1.0, 1.0)},
    )


WANTED = ["forward", "backward", "damping"]
CASES = {
    "worm, ramps, seed 0": (worm(8.0, moved(6, 8.0)), WANTED, 0),
    "worm, ramps, seed 1": (worm(8.0, moved(6, 8.0)), WANTED, 1),
    "worm, ramps, seed 2": (worm(8.0, moved(6, 8.0)), WANTED, 2),
    "worm, waves, seed 3": (worm(8.0, waves()), WANTED, 3),
    "block, seed 0": (dragged(), None, 0),
    "block, seed 1": (dragged(), None, 1),
}


@pytest.mark.parametrize("case", CASES)
def test_the_region_is_at_most_half_that_after_the_best_of_twenty(case):
    """Same duration, same limits; random runs are as large as the limits allow."""
    todo, wanted, seed = CASES[case]
    plan = wo.plan_experiment(todo, todo.criterion("D", wanted), seed=seed, starts=2)
    assert len(plan.rivals) == 20
    for rival in plan.rivals:
        assert largest_excess(todo, rival.chosen, 2001) <= 1e-5
    assert plan.shrinks(plan.rivals[0].known) >= 2.0
    assert plan.recheck == pytest.approx(plan.value, abs=1e-5)
    assert plan.excess <= 1e-6
    assert plan.departure <= 0.1


def test_no_small_change_within_the_limits_is_much_better():
    """Random steps that keep all limits gain less than a hundredth: it was searched to the end."""
    todo = dragged()
    plan = wo.plan_experiment(todo, todo.criterion("D"), starts=2)
    rng, better = np.random.default_rng(7), []
    for _ in range(200):
        beside = np.clip(plan.chosen + rng.normal(0.0, 0.01, todo.size), -1, 1)
        if largest_excess(todo, beside, 501) <= 0:
            better.append(plan.value - plan.criterion(todo.knowledge(beside)))
    assert len(better) > 10
    assert max(better) < 1e-2


def test_information_is_that_of_the_noise_free_cost():
    """Curvature of half the weighted squares by second differences of scipy's recordings."""
    todo = worm(4.0, moved(4, 4.0))
    chosen = todo.choices[0].draw(np.random.default_rng(3))
    information = todo.run(chosen).jacobian.T @ todo.run(chosen).jacobian
    h = 2e-4 * np.array(VALUES)
    shifts = [np.array(VALUES) + s * row * h for row in np.eye(4) for s in (1, -1)]
    seen = [recorded(todo, chosen, shift) for shift in shifts]
    slopes = [(seen[2 * k] - seen[2 * k + 1]).ravel() / (2 * h[k]) / 0.01 for k in range(4)]
    assert information == pytest.approx(np.array(slopes) @ np.array(slopes).T, rel=2e-4)


def recorded(todo: wo.Experiment, chosen: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Positions (3, m) by scipy's steps and events."""
    forward, backward, damping, stiffness = values
    (course,) = todo.choices
    assert isinstance(course, wo.Ramps)
    knots = np.linspace(0.0, todo.end, course.pieces + 1)
    rows = course.over_time(chosen, knots) - 2.0
    slopes = np.diff(rows) / np.diff(knots)
    pieces = np.stack([rows[:, :-1].T, slopes.T], axis=2)
    bodies = chain(
        [1.0] * 3,
        np.full(2, stiffness),
        np.full(2, damping),
        2.0,
        [Ground(forward, backward)] * 3,
        Course(knots, pieces, periodic=False),
        drives="rest_length",
    )
    times = np.append(0.0, todo.instants)
    return follow(bodies, times, [4.0, 2.0, 0.0], [0.0] * 3).values["position"][:, 1:]


def test_fits_scatter_as_the_plan_expects():
    """100 fits to scipy's recording of the planned run under fresh noise, none of it ours."""
    todo, count = worm(8.0, moved(6, 8.0)), 100
    plan = wo.plan_experiment(todo, todo.criterion("D", WANTED), starts=1)
    clean = recorded(todo, plan.chosen, np.array(VALUES))
    p, schedules = todo.chosen.values(plan.chosen)
    rng, found = np.random.default_rng(11), []
    for _ in range(count):
        seen = clean + rng.normal(0.0, 0.01, clean.shape)
        run = wo.Recording(
            todo.instants,
            {"position": seen},
            noise={"position": 0.01},
            p=p,
            schedules=schedules,
            span=(0.0, todo.end),
            x0={"position": [4.0, 2.0, 0.0], "velocity": 0.0},
        )
        fitted = wo.fit(wo.FitTask(todo.driven, [run], UNKNOWNS), seeds=1)
        assert fitted.offset < 0.2, fitted.reason  # standard errors: a hundredth of the spread
        found.append(fitted.theta)
    off = (np.array(found) - VALUES) @ np.linalg.inv(np.linalg.cholesky(plan.known.covariance)).T
    # whitened by what was expected: chi-squared, all together and along each direction, and no bias
    low, high = chi2.ppf([5e-4, 1 - 5e-4], off.size)
    assert low < np.sum(off**2) < high
    low, high = chi2.ppf([5e-4, 1 - 5e-4], count)
    assert np.all((low < np.sum(off**2, axis=0)) & (np.sum(off**2, axis=0) < high))
    assert np.all(np.abs(off.mean(axis=0)) < 3.9 / math.sqrt(count))
