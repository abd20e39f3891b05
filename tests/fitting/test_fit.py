"""Fits: exact answers, scipy's own motions, invariants, and what cannot be told."""

import re
from typing import Any

import casadi as ca
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import wormopt as wo
from wormopt.fitting.information import (
    correlation_of,
    covariance_of,
    leverages,
    offset_of,
    spectrum,
    triangle,
)
from wormopt.fitting.stretches import lifted
from wormopt.fitting.task import SCALES, Shooting, robust
from wormopt.model.lift import lift


def sliding_block(*, mass: float = 2.0, friction: float = 3.0) -> wo.Model:
    """A block on dry ground, thrown."""
    x, v, f, m = (ca.SX.sym(name) for name in "xvfm")
    (law,), numbers = lift([wo.Coulomb(friction, friction)])
    return wo.Model(
        "block",
        [wo.Signal("position", x, value=0.0), wo.Signal("velocity", v, value=1.0)],
        ca.vertcat(v, f / m),
        p=[wo.Signal("mass", m, lower=0.0, value=mass), *numbers],
        contacts=[wo.Contact("block", v, f, law)],
        outputs=[wo.Output("twice", 2 * x)],
    )


def thrown(time: np.ndarray, speed: float, slowing: float) -> np.ndarray:
    """Way of a block that stops: v t - a t²/2 until v / a."""
    t = np.minimum(time, speed / slowing)
    return speed * t - slowing * t**2 / 2


TIME = np.linspace(0.0, 1.5, 61)


def readings(seed: int, noise: float = 1e-3) -> np.ndarray:
    """Of a block that is slowed by 1.25, which is a friction of 2.5."""
    return thrown(TIME, 1.0, 1.25) + noise * np.random.default_rng(seed).standard_normal(TIME.size)


def task_on(
    seen: np.ndarray, *sought: str | wo.Unknown, noise: float | None = None, **how: Any
) -> wo.FitTask:
    run = wo.Recording(TIME, {"position": seen}, noise={"position": noise} if noise else None)
    unknowns = [wo.Unknown(each) if isinstance(each, str) else each for each in sought]
    return wo.FitTask(sliding_block(), [run], unknowns, **how)


def fit_of_block(*sought: wo.Unknown, noise: float | None = 1e-3, **how: Any) -> wo.Fit:
    return wo.fit(task_on(readings(0), *sought, noise=noise), **how)


FRICTION = wo.Unknown("friction_forward", lower=0.1)


# -- exact answers -----------------------------------------------------------------------------


def test_covariance_is_that_of_the_closed_form():
    """d(way)/d(F/m) = -t²/2 until the stop, -v²/(2 a²) then; variance sd² / sum of squares."""
    found = fit_of_block(wo.Unknown("friction_forward", lower=0.1, upper=50.0))
    assert found.converged
    slowing = found.values[0] / 2.0
    slope = -np.where(slowing * TIME < 1, TIME**2 / 2, 1 / (2 * slowing**2)) / 2.0
    assert found.standard_errors[0] == pytest.approx(1e-3 / np.linalg.norm(slope), rel=1e-6)
    # the estimate: the root of the closed form's own normal equation
    seen = readings(0)
    normal = slope @ (thrown(TIME, 1.0, slowing) - seen)
    assert abs(normal) < 1e-6 * np.linalg.norm(slope) * np.linalg.norm(seen)


def test_only_the_ratio_of_force_and_mass_is_told():
    found = fit_of_block(wo.Unknown("friction_forward"), wo.Unknown("mass"), seeds=2)
    assert np.all(np.isinf(found.standard_errors))
    assert found.correlation == pytest.approx(np.ones((2, 2)), abs=1e-9)
    s, v = found.singular
    assert s[1] < 1e-7 * s[0]
    assert v[:, 1] * np.sign(v[0, 1]) == pytest.approx(np.sqrt([0.5, 0.5]), abs=0.2)
    assert found.values[0] / found.values[1] == pytest.approx(1.25, rel=0.01)


def test_a_prior_tells_what_data_do_not():
    mass = wo.Unknown("mass", prior=(2.2, 0.1))
    found = fit_of_block(wo.Unknown("friction_forward"), mass, seeds=2)
    assert found.values[1] == pytest.approx(2.2, abs=1e-4)  # a thousandth of its error
    assert found.standard_errors[1] == pytest.approx(0.1, rel=1e-6)
    assert found.standard_errors[0] == pytest.approx(0.1 * found.values[0] / 2.2, rel=1e-2)


def test_what_lies_at_a_bound_is_told():
    found = fit_of_block(wo.Unknown("friction_forward", upper=2.0, start=1.0), seeds=2)
    assert found.at_bound == ("friction_forward",)
    assert found.values[0] == 2.0
    assert any("times the given noise" in line for line in found.warnings)


def test_logarithm_and_number_are_one_fit():
    plain = fit_of_block(FRICTION, seeds=1)
    log = fit_of_block(wo.Unknown("friction_forward", lower=0.1, log=True), seeds=1)
    assert log.values == pytest.approx(plain.values, rel=1e-6)
    assert log.standard_errors == pytest.approx(plain.standard_errors, rel=1e-5)
    assert log.theta == pytest.approx(np.log(plain.values), rel=1e-6)


def test_noise_is_estimated_free_of_bias():
    """Of a straight fit of k numbers to m readings, sd² = sum of squares / (m - k)."""
    found = fit_of_block(FRICTION, noise=None)
    assert found.estimated == ("position",)
    left = found.task.split(found.residuals)["run"]["position"] * found.noise["position"]
    assert found.noise["position"] ** 2 == pytest.approx(np.sum(left**2) / 60, rel=1e-3)
    assert found.noise["position"] == pytest.approx(1e-3, rel=0.3)


def test_outliers_are_borne_by_a_robust_loss():
    seen = readings(1)
    seen[::7] += 0.5
    for loss, off in (("linear", 10.0), ("huber", 0.01), ("soft_l1", 0.01), ("cauchy", 0.01)):
        found = wo.fit(task_on(seen, FRICTION, noise=1e-3, loss=loss), seeds=1)
        error = abs(found.values[0] - 2.5) / 2.5
        assert error < off
        assert (error > 0.1) == (loss == "linear")


def test_runs_share_numbers_and_have_their_own():
    speeds, runs = (1.0, 0.6), []
    for k, speed in enumerate(speeds):
        seen = np.vstack([thrown(TIME, speed, 1.25)])
        runs.append(wo.Recording(TIME, {"position": seen}, noise={"position": 1e-4}, name=f"{k}"))
    sought = [FRICTION, wo.Unknown("velocity", per_run=True, start=0.8)]
    found = wo.fit(wo.FitTask(sliding_block(), runs, sought), seeds=2)
    assert found.names == ("friction_forward", "velocity, 0", "velocity, 1")
    assert found.values == pytest.approx([2.5, *speeds], rel=1e-6)
    first, second = (found.task.split(found.jacobian[:, k]) for k in (1, 2))
    assert not np.any(first["1"]["position"])
    assert not np.any(second["0"]["position"])


def test_gaps_and_outputs_are_read():
    seen = 2 * thrown(TIME, 1.0, 1.25)
    seen[10:25] = np.nan
    run = wo.Recording(TIME, {"twice": seen}, noise={"twice": 1e-3})
    found = wo.fit(wo.FitTask(sliding_block(), [run], [wo.Unknown("friction_forward")]), seeds=1)
    assert found.values[0] == pytest.approx(2.5, rel=1e-6)
    assert found.residuals.shape == (46,)
    assert found.continuity(3) < 1e-6
    back = found.task.split(found.residuals)["run"]["twice"]
    assert np.array_equal(np.isnan(back[0]), np.isnan(seen))


# -- linear algebra ----------------------------------------------------------------------------


@given(st.integers(0, 2**32 - 1), st.integers(1, 6), st.integers(1, 900))
def test_the_triangle_has_the_products_of_the_matrix(seed: int, n: int, rows: int):
    matrix = np.random.default_rng(seed).standard_normal((rows, n))
    small = triangle(matrix)
    assert small.shape == (n, n)
    assert small.T @ small == pytest.approx(matrix.T @ matrix, rel=1e-10, abs=1e-10)


@given(st.integers(0, 2**32 - 1), st.integers(2, 6))
def test_covariance_of_a_full_rank_is_the_inverse(seed: int, n: int):
    rng = np.random.default_rng(seed)
    jacobian, nominal = rng.standard_normal((30, n)), 10.0 ** rng.uniform(-3, 3, n)
    inverse = np.linalg.inv(jacobian.T @ jacobian)
    found = covariance_of(spectrum(jacobian, nominal), nominal)
    assert found == pytest.approx(inverse, rel=1e-6, abs=1e-12)
    size = np.sqrt(np.diag(inverse))
    assert correlation_of(spectrum(jacobian, nominal)) == pytest.approx(
        inverse / np.outer(size, size), abs=1e-9
    )
    hat = jacobian @ inverse @ jacobian.T
    assert leverages(jacobian) == pytest.approx(np.diag(hat), abs=1e-9)


@given(st.integers(0, 2**32 - 1), st.integers(3, 7))
def test_nothing_is_small_that_cannot_be_told(seed: int, n: int):
    """Two columns that are multiples of each other: both infinite, the others as without them."""
    rng = np.random.default_rng(seed)
    jacobian = rng.standard_normal((40, n))
    jacobian[:, 1] = rng.uniform(0.5, 2.0) * jacobian[:, 0]
    covariance = covariance_of(spectrum(jacobian, np.ones(n)), np.ones(n))
    assert np.all(np.isinf(covariance[:2, :2]))
    assert covariance[0, 1] < 0 < covariance[0, 0]
    rest = np.linalg.inv(jacobian[:, 1:].T @ jacobian[:, 1:])[1:, 1:]
    assert covariance[2:, 2:] == pytest.approx(rest, rel=1e-6, abs=1e-12)


def test_the_offset_counts_standard_errors():
    rng = np.random.default_rng(3)
    jacobian, noise = rng.standard_normal((50, 4)), rng.standard_normal(50)
    noise -= jacobian @ np.linalg.lstsq(jacobian, noise, rcond=None)[0]
    free = np.ones(4, dtype=bool)
    assert offset_of(noise, jacobian, free) < 1e-12
    error = np.sqrt(np.linalg.inv(jacobian[:, :1].T @ jacobian[:, :1])[0, 0])
    one = np.array([True, False, False, False])
    assert offset_of(noise + jacobian[:, 0] * error, jacobian, one) == pytest.approx(1.0)


@given(st.sampled_from(sorted(SCALES)), st.floats(-1e3, 1e3))
def test_a_loss_is_its_formula_and_slope(loss: str, r: float):
    c = SCALES[loss]  # type: ignore[index]
    z = (r / c) ** 2
    formula = {
        "soft_l1": 2 * (np.sqrt(1 + z) - 1),
        "huber": z if z <= 1 else 2 * np.sqrt(z) - 1,
        "cauchy": np.log1p(z),
    }[loss]
    value, slope = robust(np.array([r]), loss)  # type: ignore[arg-type]
    assert value[0] ** 2 == pytest.approx(c**2 * formula, rel=1e-6, abs=1e-12)
    h = 1e-6 * max(1.0, abs(r))
    ends = [robust(np.array([r + s]), loss)[0][0] for s in (-h, h)]  # type: ignore[arg-type]
    assert slope[0] == pytest.approx((ends[1] - ends[0]) / (2 * h), rel=1e-4, abs=1e-6)


# -- what is refused or told --------------------------------------------------------------------

GOOD = {"position": thrown(TIME, 1.0, 1.25)}


def with_one(values: np.ndarray, at: int, value: float) -> np.ndarray:
    values = values.copy()
    values[at] = value
    return values


@pytest.mark.parametrize(
    ("time", "values", "more", "told"),
    [
        (with_one(TIME, 4, np.nan), GOOD, {}, "time 4 is nan"),
        (with_one(TIME, 4, 0.01), GOOD, {}, "goes backwards"),
        (with_one(TIME, 4, TIME[3]), GOOD, {}, "occurs twice"),
        (TIME[:1], {"position": [1.0]}, {}, "at least two"),
        (TIME, {}, {}, "readings by name"),
        (TIME, {"position": np.full(61, np.nan)}, {}, "has no readings"),
        (TIME, {"position": np.full(61, 3.0)}, {}, "all signals are constant"),
        (
            TIME,
            {"position": with_one(GOOD["position"], 7, np.inf)},
            {},
            "position[0] is infinite in reading 7",
        ),
        (TIME, {"position": np.zeros((2, 5))}, {}, "not (size, 61)"),
        (TIME, {"position": ["a"] * 61}, {}, "must be a number"),
        (TIME, GOOD, {"noise": {"position": 0.0}}, "must be positive"),
        (TIME, GOOD, {"noise": {"place": 1.0}}, "no readings"),
        (TIME, GOOD, {"span": (0.5, 2.0)}, "outside"),
    ],
)
def test_a_recording_that_cannot_be_is_refused(
    time: np.ndarray, values: dict, more: dict, told: str
):
    with pytest.raises(wo.ArgumentError, match=re.escape(told)):
        wo.Recording(time, values, **more)


def test_units_mistaken_are_told():
    task = task_on(5e3 * thrown(TIME, 1.0, 1.25), "velocity")
    assert any("check their unit" in line for line in task.warnings)


def test_a_start_away_from_its_reading_is_told():
    shifted, start = readings(0) + 0.3, wo.Unknown("position", per_run=True)
    (told,) = task_on(shifted, FRICTION).warnings
    assert told.startswith("run: position[0] starts at 0, but its first reading is 0.300")
    assert task_on(readings(0), FRICTION).warnings == ()
    assert task_on(shifted, FRICTION, start).warnings == ()


@pytest.mark.parametrize(
    ("make", "told"),
    [
        (lambda: wo.Unknown("mass", lower=2.0, upper=1.0), "below upper"),
        (lambda: wo.Unknown("mass", lower=2.0, start=1.0), "within its bounds"),
        (lambda: wo.Unknown("mass", start=-1.0, log=True), "log needs"),
        (lambda: wo.Unknown("mass", prior=(1.0, 0.0)), "positive deviation"),
        (lambda: wo.Unknown("mass", prior=3.0), "mean, deviation"),  # type: ignore[arg-type]
        (lambda: task_of("weight"), "no parameter"),
        (lambda: task_of("mass[3]"), "1 entries"),
        (lambda: task_of("mass", "mass"), "two unknowns have the name mass"),
        (lambda: task_of(wo.Unknown("c", {"mass": [0.0]})), "is 0"),
        (lambda: task_of(wo.Unknown("c", {"mass": [1.0, 1.0]})), "the shape"),
        (lambda: wo.fit(3), "must be a FitTask"),  # type: ignore[arg-type]
        (lambda: wo.fit(task_of("mass"), seeds=0), "whole number"),
        (lambda: wo.FitTask(sliding_block(), [], []), "at least one Recording"),
    ],
)
def test_a_task_that_cannot_be_is_refused(make, told: str):
    with pytest.raises(wo.ArgumentError, match=told):
        make()


def task_of(*sought: str | wo.Unknown) -> wo.FitTask:
    task = task_on(GOOD["position"], *sought)
    task.residuals(task.start)
    return task


def test_more_numbers_than_readings_are_refused():
    run = wo.Recording([0.0, 0.5], {"position": [0.0, np.nan]}, span=(0.0, 1.0))
    with pytest.raises(wo.ArgumentError, match="add 1 more"):
        wo.FitTask(sliding_block(), [run], [wo.Unknown("mass"), wo.Unknown("velocity")])


def test_a_start_that_cannot_be_simulated_says_why():
    x = ca.SX.sym("x")
    rate = ca.SX.sym("rate")
    numbers = [wo.Signal("rate", rate, value=9.0)]
    model = wo.Model("explosion", [wo.Signal("x", x, value=1.0)], rate * x**2, p=numbers)
    run = wo.Recording([0.0, 0.5, 1.0], {"x": [1.0, 1.1, 1.3]})
    task = wo.FitTask(model, [run], [wo.Unknown("rate")])
    with pytest.raises(wo.SolveError, match="no start of the fit could be simulated"):
        wo.fit(task, seeds=1)
    found = wo.fit(task, seeds=8)
    assert found.values[0] == pytest.approx(0.23, abs=0.02)
    assert np.isinf(found.starts[-1].cost)


def test_the_best_so_far_is_kept_when_interrupted(monkeypatch: pytest.MonkeyPatch):
    calls, whole = [0], Shooting.motion

    def stopping(self, *args, **more):
        calls[0] += 1
        if calls[0] == 12:
            raise KeyboardInterrupt
        return whole(self, *args, **more)

    monkeypatch.setattr(Shooting, "motion", stopping)
    with pytest.raises(wo.Interrupted) as stopped:
        fit_of_block(wo.Unknown("friction_forward", lower=0.1, start=8.0))
    found = stopped.value.partial
    assert isinstance(found, wo.Fit)
    assert not found.converged
    assert found.reason == "interrupted"
    assert found.values[0] < 8.0


# -- motions of scipy ----------------------------------------------------------------------------


def test_ground_that_holds_whatever_the_number_is_no_bottom():
    """Pushed by 1.5, a block of mass 2 slides on ground that resists with 1, and rests on 4."""
    x, v, f = (ca.SX.sym(name) for name in "xvf")
    (law,), numbers = lift([wo.Coulomb(1.0, 1.0)])
    states = [wo.Signal("position", x, value=0.0), wo.Signal("velocity", v, value=0.0)]
    ground = wo.Contact("block", v, f, law)
    model = wo.Model("block", states, ca.vertcat(v, (1.5 + f) / 2), p=numbers, contacts=[ground])
    run = wo.Recording(TIME, {"position": 0.125 * TIME**2}, noise={"position": 1e-3})
    task = wo.FitTask(model, [run], [wo.Unknown("friction_forward", start=4.0, lower=0.1)])
    held = wo.fit(task, seeds=1, nodes=0)
    assert not held.converged
    assert held.reason.startswith("the motion does not depend on friction_forward")
    assert np.isinf(held.standard_errors[0])
    found = wo.fit(task)
    assert found.converged
    assert found.values[0] == pytest.approx(1.0, rel=1e-6)


@pytest.mark.slow
def test_nodes_lead_where_a_long_motion_goes_astray():
    """A spring of 40 turns: a stiffness a third off is turns too fast, and a motion is lost."""
    x, v, k = (ca.SX.sym(name) for name in "xvk")
    states = [wo.Signal("position", x, value=1.0), wo.Signal("velocity", v, value=0.0)]
    swing = wo.Model("swing", states, ca.vertcat(v, -k * x), p=[wo.Signal("stiffness", k)])
    time = np.linspace(0.0, 80 * np.pi, 2001)
    seen = np.cos(time) + 0.05 * np.random.default_rng(2).standard_normal(time.size)
    run = wo.Recording(time, {"position": seen}, noise={"position": 0.05})
    task = wo.FitTask(swing, [run], [wo.Unknown("stiffness", start=1.3, lower=0.1, upper=10.0)])
    alone = wo.fit(task, seeds=1, nodes=0)
    assert abs(alone.values[0] - 1) > 0.1
    assert any("times the given noise" in line for line in alone.warnings)
    found = wo.fit(task, seeds=1, nodes=40)
    assert found.converged
    assert abs(found.values[0] - 1) < 4 * found.standard_errors[0]
    # d cos(sqrt(k) t)/dk = -t sin(t)/2 at k = 1
    assert found.standard_errors[0] == pytest.approx(
        0.05 / np.linalg.norm(time * np.sin(time) / 2), rel=0.01
    )


def test_stretches_have_exact_derivatives():
    """Of readings and jumps, by unknowns and by the starts of stretches, against differences."""
    sought = wo.Unknown("friction_forward", log=True), wo.Unknown("velocity", start=0.9)
    sharp = wo.Tolerance(1e-12, 1e-14)
    task = task_on(thrown(TIME, 1.0, 1.25), *sought, noise=0.01, tolerance=sharp)
    whole, w = lifted(task, task.start, 4)
    r, jacobian = whole.residuals(w)
    assert r.shape == (61 + 4 * 2,)
    for k in range(len(w)):
        step = 1e-6 * np.eye(len(w))[k]
        slope = (whole.residuals(w + step)[0] - whole.residuals(w - step)[0]) / 2e-6
        assert slope == pytest.approx(jacobian[:, k], abs=1e-5 * np.abs(jacobian[:, k]).max())


# -- what is no noise is said -------------------------------------------------------------------


@pytest.mark.slow
def test_all_starts_are_tried_where_they_agree_but_leave_no_noise():
    """A block that turns back at the end, which friction never makes it do."""
    rng = np.random.default_rng(4)
    seen = thrown(TIME, 1.0, 1.25) - 0.02 * np.maximum(TIME - 1.0, 0.0)
    seen += 5e-3 * rng.standard_normal(TIME.size)
    sought = wo.Unknown("friction_forward", lower=0.1, upper=50.0)
    right = thrown(TIME, 1.0, 1.25) + 5e-3 * rng.standard_normal(TIME.size)
    strange = wo.fit(task_on(seen, sought, noise=1e-3))
    plain = wo.fit(task_on(right, sought, noise=5e-3))
    assert len(plain.starts) == 3
    assert not any("residuals" in line for line in plain.warnings)
    assert len(strange.starts) == 8
    assert any("times the given noise" in line for line in strange.warnings)


@pytest.mark.slow
def test_a_clock_that_is_late_is_told_though_the_size_is_that_of_noise():
    """Residuals smaller than the noise said that hang together: only their order tells."""
    seen = thrown(np.maximum(TIME - 0.03, 0.0), 1.0, 1.25)
    seen += 0.002 * np.random.default_rng(6).standard_normal(TIME.size)
    found = wo.fit(task_on(seen, FRICTION, noise=0.015))
    assert np.mean(found.residuals**2) < 1
    assert any("are correlated" in line for line in found.warnings)


@pytest.mark.slow
def test_numbers_held_by_their_bounds_are_no_fit():
    friction = wo.Unknown("friction_forward", lower=0.1, upper=50.0)
    speed = wo.Unknown("velocity", start=1.0, lower=0.1, upper=5.0)
    found = wo.fit(task_on(1e3 * thrown(TIME, 1.0, 1.25), friction, speed))
    assert found.at_bound == ("friction_forward", "velocity")
    assert not found.converged
    assert found.reason.startswith("2 of 2 unknowns are at their bounds")


def test_errors_are_infinite_where_derivatives_are_no_more_exact_than_that():
    """Singular values 1 and 1e-4: told if derivatives are known to 1e-6, not told if to 1e-3."""
    pair = np.array([1.0, 1e-4]), np.eye(2)
    assert covariance_of(pair, np.ones(2), 1e-6)[1, 1] == pytest.approx(1e8)
    assert np.isinf(covariance_of(pair, np.ones(2), 1e-3)[1, 1])
    assert covariance_of(pair, np.ones(2), 1e-3)[0, 0] == pytest.approx(1.0)


@pytest.mark.slow
def test_a_number_that_only_matters_above_a_threshold_is_not_known_as_well_as_its_error_says():
    """Below 1 the rate of this decay does not matter, and its best value is just above."""
    x, rate = ca.SX.sym("x"), ca.SX.sym("rate")
    known = [wo.Signal("rate", rate, value=3.0)]
    model = wo.Model("decay", [wo.Signal("x", x, value=1.0)], -ca.fmax(rate, 1.0) * x, p=known)
    time = np.linspace(0.0, 2.0, 21)
    seen = np.exp(-1.01 * time) + 0.02 * (-1.0) ** np.arange(21)
    run = wo.Recording(time, {"x": seen}, x0={"x": 1.0}, noise={"x": 0.02})
    sought = wo.Unknown("rate", lower=0.2, upper=5.0)
    found = wo.fit(wo.FitTask(model, [run], [sought]), seeds=12)
    assert found.values[0] == pytest.approx(1.01, abs=0.02)
    (said,) = [each for each in found.warnings if "ended between" in each]
    assert said.startswith("rate ended between 0.")
    # where every value matters, nothing is said
    plain = wo.Model("decay", [wo.Signal("x", x, value=1.0)], -rate * x, p=known)
    found = wo.fit(wo.FitTask(plain, [run], [sought]), seeds=12)
    assert not any("ended between" in each for each in found.warnings)
