"""What a fit knows: combinations that cannot be told apart, profiles, tests, predictions."""

from dataclasses import replace

import casadi as ca
import numpy as np
import pytest
from effort import examples
from hints import Patch
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import stats
from scipy.optimize import brentq

from tests.oracles.by_formula import fit_at, formula, noisy
from wormopt.errors import ArgumentError, UnknownNameError
from wormopt.fitting.estimate import Fit
from wormopt.fitting.identifiability import identifiability, sparse_basis
from wormopt.fitting.noise import excess, ljung_box, runs_test, whiteness
from wormopt.fitting.prediction import predict
from wormopt.fitting.profile import profile
from wormopt.fitting.recording import Recording
from wormopt.fitting.task import FitTask
from wormopt.fitting.unknowns import Unknown
from wormopt.model.friction import Coulomb
from wormopt.simulation.simulate import simulate
from wormopt.systems.chain.build import chain

T = np.linspace(0.0, 5.0, 41)
SD = 0.3


def of_formula(outputs, unknowns: str = "", **values: float) -> Fit:
    """Fit at the values that its readings, without noise, were made with."""
    model = formula(outputs, **values)
    read = FitTask(model, [Recording(T, {"y": T}, noise={"y": 0.01})], [Unknown("a")])
    exact = read.motions(np.array([values["a"]]))[0]["y"]
    chosen = [Unknown(name) for name in (unknowns or values)]
    task = FitTask(model, [Recording(T, {"y": exact}, noise={"y": 0.01})], chosen)
    return fit_at(task, **{name: values[name] for name in task.names})


# -- what cannot be told apart -------------------------------------------------------------------


def test_products_sums_and_what_does_nothing_are_told_in_words():
    def outputs(t, p):
        wave = p["k"] * p["l"] ** 2 * ca.sin(t) + (p["a"] - 2 * p["b"]) * t
        return {"y": wave + p["o"] + ca.exp(-p["m"] / p["d"] * t)}

    found = of_formula(outputs, k=3.0, l=0.5, a=1.0, b=-2.0, o=0.0, m=2.0, d=3.0, idle=7.0)
    known = identifiability(found)
    assert known.rank == 4
    assert known.gap > 1e4
    assert set(known.words) == {
        "idle has no effect on the measurements",
        "k times c^2 and l over c change nothing: only k * l^2 is known",
        "a + 2 c and b + c change nothing: only a - 2 b is known",
        "m times c and d times c change nothing: only m / d is known",
    }
    # o alone stands by itself, and is known as well as by hand
    assert np.isfinite(known.errors).tolist() == [name == "o" for name in known.names]
    assert known.weak == known.by_prior == ()


def test_what_holds_at_one_point_only_is_not_told_as_a_law():
    known = identifiability(
        of_formula(lambda t, p: {"y": (p["a"] + p["b"] ** 2) * t}, a=1.0, b=0.5)
    )
    (lost,) = known.lost
    assert (lost.form, lost.names) == ("here", ("a", "b"))
    # da + 2 b db = 0, in relative changes: a da/a + 2 b² db/b = 0
    assert lost.changes[0] / lost.changes[1] == pytest.approx(-0.5, rel=1e-6)
    assert "to first order" in known.words[0]


@pytest.mark.slow
def test_three_that_scale_together_are_one_combination_and_two_ratios():
    def oscillation(t, p):
        rate = p["d"] / (2 * p["a"])
        return {"y": ca.exp(-rate * t) * ca.cos(ca.sqrt(p["k"] / p["a"] - rate**2) * t)}

    known = identifiability(of_formula(oscillation, a=2.0, k=8.0, d=0.6))
    assert known.words == (
        "a times c, k times c and d times c change nothing: only a / k and a / d are known",
    )


def test_a_prior_makes_known_what_readings_do_not():
    found = of_formula(lambda t, p: {"y": (p["a"] + p["b"]) * t}, a=1.0, b=2.0)
    with_prior = replace(found.task, unknowns=[Unknown("a"), Unknown("b", prior=(2.0, 0.1))])
    known = identifiability(fit_at(with_prior, a=1.0, b=2.0))
    assert known.by_prior == ("a", "b")
    assert np.isinf(known.errors).all()
    assert "a is known from its prior only" in known.words


def test_an_error_as_large_as_the_number_is_weak():
    # sd of b = 0.01 / |e^-20t| about 1.3 times b: from t = 0 alone
    found = of_formula(lambda t, p: {"y": p["a"] * t + p["b"] * ca.exp(-20 * t)}, a=1.0, b=0.008)
    known = identifiability(found)
    assert known.weak == ("b",)
    assert known.gap == known.singular_values[-1] / known.error > 1
    assert known.errors[1] == pytest.approx(0.01 / 0.008, rel=0.01)
    assert known.words == ("b is known only to 125 %",)


@settings(max_examples=examples(30))
@given(st.integers(2, 7), st.integers(1, 3), st.integers(0, 10**6))
def test_a_sparse_basis_spans_the_same_and_finds_pairs(n: int, pairs: int, seed: int):
    rng = np.random.default_rng(seed)
    pairs = min(pairs, n // 2)
    hidden = np.zeros((pairs, n))
    for k in range(pairs):
        hidden[k, 2 * k : 2 * k + 2] = rng.uniform(0.2, 1.0, 2) * rng.choice([-1, 1], 2)
    mixed, _ = np.linalg.qr((rng.normal(size=(pairs, pairs)) @ hidden).T)
    found = sparse_basis(mixed, 1e-9)
    assert sorted(np.flatnonzero(row)[0] for row in found) == [2 * k for k in range(pairs)]
    assert (np.count_nonzero(found, axis=1) == 2).all()
    for row in found:
        (twin,) = [h for h in hidden if h[np.flatnonzero(row)[0]]]
        assert row == pytest.approx(twin / twin[np.argmax(np.abs(twin))], abs=1e-6)


# -- profiles ------------------------------------------------------------------------------------


def line_task(noise: float | None, **unknowns: object) -> FitTask:
    model = formula(lambda t, p: {"y": p["a"] + p["b"] * t}, a=1.0, b=-0.5)
    y = noisy(3, 1.0 - 0.5 * T, SD)
    run = Recording(T, {"y": y}, noise=None if noise is None else {"y": noise}, name="first")
    return FitTask(model, [run], [Unknown("a"), Unknown("b", **unknowns)])  # type: ignore[arg-type]


def by_hand(task: FitTask) -> tuple[np.ndarray, np.ndarray, float]:
    """Best line, inverse of the normal matrix, squares of what is left."""
    X, y = np.column_stack([np.ones_like(T), T]), task.recordings[0].readings["y"][0]
    inverse = np.linalg.inv(X.T @ X)
    best = inverse @ X.T @ y
    return best, inverse, float(np.sum((y - X @ best) ** 2))


@pytest.mark.parametrize("known", [pytest.param(True, marks=pytest.mark.slow), False])
def test_profiles_of_a_line_are_those_of_the_textbook(known: bool):
    task = line_task(SD if known else None)
    best, inverse, left = by_hand(task)
    freedom = len(T) - 2
    sd = SD if known else np.sqrt(left / freedom)
    quantile = stats.norm.ppf(0.95) if known else stats.t.ppf(0.95, freedom)
    found = fit_at(task if known else task.with_noise({"y": sd}), a=best[0], b=best[1])
    found = found if known else replace(found, estimated=("y",))
    made = profile(found, level=0.9)
    for k, name in enumerate("ab"):
        half = quantile * sd * np.sqrt(inverse[k, k])
        assert made[name].interval == pytest.approx((best[k] - half, best[k] + half), rel=2e-3)
        assert made[name].open == (False, False)
        # every point lies on the parabola, in the line of best partners
        away = (made[name].values - best[k]) ** 2 / (sd**2 * inverse[k, k])
        assert made[name].rises == pytest.approx(away, rel=1e-3, abs=1e-3)


@pytest.mark.slow
def test_a_crooked_profile_is_that_of_the_best_partner_in_closed_form():
    model = formula(lambda t, p: {"y": p["a"] * ca.exp(-p["k"] * t)}, a=2.0, k=0.8)
    y = noisy(5, 2 * np.exp(-0.8 * T), 0.5)

    def squares(k: float) -> float:
        e = np.exp(-k * T)
        return float(y @ y - (y @ e) ** 2 / (e @ e)) / 0.25

    rates = np.linspace(0.2, 3.0, 20001)
    best = rates[np.argmin([squares(k) for k in rates])]
    limit = squares(best) + stats.chi2.ppf(0.95, 1)
    ends = (
        brentq(lambda k: squares(k) - limit, 0.1, best),
        brentq(lambda k: squares(k) - limit, best, 20.0),
    )
    e = np.exp(-best * T)
    task = FitTask(
        model, [Recording(T, {"y": y}, noise={"y": 0.5})], [Unknown("a"), Unknown("k", log=True)]
    )
    made = profile(fit_at(task, a=y @ e / (e @ e), k=best), ["k"])["k"]
    assert made.interval == pytest.approx(ends, rel=3e-3)
    assert ends[1] - best > 1.2 * (best - ends[0])  # crooked indeed
    assert made.rises == pytest.approx([squares(k) - squares(best) for k in made.values], abs=2e-3)


def test_a_side_that_readings_do_not_bound_is_open():
    """k / (1 + k) is below 1, and 0.99 ± 0.02 cannot tell how far k is."""
    model = formula(lambda t, p: {"y": p["k"] / (1 + p["k"]) * t}, k=99.0)
    run = Recording([0.0, 1.0], {"y": [0.0, 0.99]}, noise={"y": 0.02})
    least = 0.99 - stats.norm.ppf(0.975) * 0.02
    free = profile(fit_at(FitTask(model, [run], [Unknown("k")]), k=99.0))["k"]
    assert free.open == (False, True)
    assert free.interval == (pytest.approx(least / (1 - least), rel=5e-3), np.inf)
    assert free.words == ("the readings do not bound k above",)
    bound = profile(fit_at(FitTask(model, [run], [Unknown("k", upper=500.0)]), k=99.0))["k"]
    assert bound.interval[1] == bound.values[-1] == 500.0
    assert bound.open[1]


def test_a_profile_finds_the_better_fit_and_says_so():
    task = line_task(SD)
    best, inverse, _ = by_hand(task)
    off = 0.5 * SD / np.sqrt(len(T))
    made = profile(fit_at(task, a=best[0] + off, b=best[1]), ["b"])["b"]
    half = stats.norm.ppf(0.975) * SD * np.sqrt(inverse[1, 1])
    assert made.fell == pytest.approx(0.25, rel=1e-3)
    assert made.interval == pytest.approx((best[1] - half, best[1] + half), rel=2e-3)
    assert "fit again" in made.words[0]


def test_what_is_refused():
    found = fit_at(line_task(SD), a=1.0, b=-0.5)
    with pytest.raises(ArgumentError, match="between 0 and 1"):
        profile(found, level=95.0)
    for verb in (profile, identifiability, whiteness):
        with pytest.raises(ArgumentError, match="not FitTask"):
            verb(found.task)  # type: ignore[arg-type]
    with pytest.raises(ArgumentError, match="not dict"):
        predict(found, {"y": [1.0]})  # type: ignore[arg-type]
    with pytest.raises(UnknownNameError, match="'c'"):
        profile(found, ["c"])


# -- residuals -----------------------------------------------------------------------------------


def test_residuals_of_a_fit_are_computed_once(monkeypatch: Patch):
    found, plain, calls = fit_at(line_task(SD), a=1.0, b=-0.5), FitTask.plain, list[FitTask]()
    monkeypatch.setattr(FitTask, "plain", lambda *given: calls.append(given[0]) or plain(*given))
    assert excess(found) > 0
    assert whiteness(found).tests
    assert calls == [found.task]


def test_portmanteau_and_runs_by_hand():
    zigzag = np.tile([1.0, -1.0], 5)
    # r1 = -9/10: 10 * 12 * 0.81 / 9; 10 runs where 6 ± sqrt(20/9) are due
    assert ljung_box(zigzag, 1) == pytest.approx((10.8, stats.chi2.sf(10.8, 1)))
    assert runs_test(zigzag)[0] == pytest.approx(4 / np.sqrt(20 / 9))
    # a gap takes two pairs away: r1 = -7/9, of 9 readings with the mean 1/9 left
    gap = np.append(zigzag[:4], np.append(np.nan, zigzag[5:]))
    r = np.where(np.isnan(gap), 0.0, gap - np.nanmean(gap))
    r1 = sum(a * b for a, b in zip(r[1:], r[:-1], strict=True)) / np.nansum(r**2)
    assert ljung_box(gap, 1)[0] == pytest.approx(9 * 11 * r1**2 / 7)


@pytest.mark.slow
@pytest.mark.parametrize("gaps", [0.0, 0.3])
def test_false_alarms_are_as_frequent_as_said(gaps: float):
    rng = np.random.default_rng(11)
    rows = rng.standard_normal((400, 100))
    rows[rng.random(rows.shape) < gaps] = np.nan
    for test in (ljung_box, lambda row: runs_test(row[np.isfinite(row)])):
        alarms = sum(test(row)[1] < 0.05 for row in rows)
        assert stats.binomtest(alarms, len(rows), 0.05).pvalue > 1e-3


def test_residuals_that_swing_jump_or_are_too_large_are_told():
    task = line_task(SD)
    best, *_ = by_hand(task)
    y = task.recordings[0].readings["y"][0]

    def told(changed: np.ndarray) -> set[str]:
        run = replace(task.recordings[0], values={"y": changed})
        # what is added is orthogonal to lines but for little: the fit may stay
        found = fit_at(replace(task, recordings=[run]), a=best[0], b=best[1])
        return {each.test for each in whiteness(found).suspects}

    assert told(y) == set()
    assert "correlation" in told(y + 0.4 * np.sin(4 * np.pi * T / 5))
    assert "normal" in told(y + np.where(np.arange(len(T)) == 20, 8 * SD, 0.0))
    assert told(best[0] + best[1] * T + 2 * (y - best[0] - best[1] * T)) == {"size"}


# -- predictions ---------------------------------------------------------------------------------


def two_runs(seed: int, own: bool) -> tuple[Fit, Recording, np.ndarray, np.ndarray]:
    """Line fitted to a short run, a longer one kept, and the designs of both."""
    model = formula(lambda t, p: {"y": p["a"] + p["b"] * t}, a=1.0, b=-0.5)
    first, later = T[:12], np.linspace(0.0, 10.0, 300)
    runs = [
        Recording(t, {"y": noisy(seed + k, 1 - 0.5 * t, SD)}, noise={"y": SD}, name=name)
        for k, (t, name) in enumerate([(first, "first"), (later, "kept")])
    ]
    X, kept = (np.column_stack([np.ones_like(t), t]) for t in (first, later))
    best = np.linalg.lstsq(X, runs[0].readings["y"][0], rcond=None)[0]
    task = FitTask(model, runs[:1], [Unknown("a", per_run=own), Unknown("b")])
    found = fit_at(task, **dict(zip(task.names, best, strict=True)))
    return found, runs[1], X, kept


def test_the_band_of_a_line_is_that_of_the_textbook():
    found, run, X, kept = two_runs(0, own=False)
    ahead = predict(found, run)
    covariance = SD**2 * np.linalg.inv(X.T @ X)
    model = np.sqrt(np.sum((kept @ covariance) * kept, axis=1))
    assert ahead.model_error["y"][0] == pytest.approx(model, rel=1e-6)
    assert ahead.error["y"][0] == pytest.approx(np.hypot(model, SD), rel=1e-6)
    whole = SD**2 * np.eye(len(kept)) + kept @ covariance @ kept.T
    off = run.readings["y"][0] - kept @ found.theta
    assert ahead.chi2 == pytest.approx(off @ np.linalg.solve(whole, off), rel=1e-6)
    assert (ahead.freedom, ahead.words) == (len(kept), ())
    lower, upper = ahead.band("y")
    inside = (lower[0] <= run.readings["y"][0]) & (run.readings["y"][0] <= upper[0])
    assert ahead.coverage == np.mean(inside)


def test_what_a_run_has_of_its_own_is_fitted_to_it_and_costs_a_degree():
    """Equal to generalised least squares in the offset, by dense matrices."""
    found, run, X, kept = two_runs(0, own=True)
    ahead = predict(found, run)
    slope = found.theta[list(found.names).index("b")]
    variance = SD**2 * np.linalg.inv(X.T @ X)[1, 1]
    off = run.readings["y"][0] - slope * kept[:, 1]
    off = off - off.mean()  # all that is left once the offset is free
    centred = kept[:, 1] - kept[:, 1].mean()
    basis = np.linalg.svd(np.ones((len(kept), 1)))[0][:, 1:]  # contrasts
    whole = basis.T @ (SD**2 * np.eye(len(kept)) + variance * np.outer(centred, centred)) @ basis
    assert ahead.chi2 == pytest.approx(
        (basis.T @ off) @ np.linalg.solve(whole, basis.T @ off), rel=1e-6
    )
    assert ahead.freedom == len(kept) - 1
    own = SD**2 / len(kept) + variance * centred**2
    assert ahead.model_error["y"][0] == pytest.approx(np.sqrt(own), rel=1e-6)


def test_a_run_that_shows_what_the_fit_cannot_tell_has_no_band():
    model = formula(lambda t, p: {"y": p["a"] * t + p["b"] * ca.fmax(t - 1, 0)}, a=1.0, b=2.0)
    early = Recording(T[:8], {"y": T[:8]}, noise={"y": SD}, name="early")
    found = fit_at(FitTask(model, [early], [Unknown("a"), Unknown("b")]), a=1.0, b=2.0)
    late = Recording(T, {"y": T + 2 * np.fmax(T - 1, 0)}, noise={"y": SD}, name="late")
    ahead = predict(found, late)
    assert np.isinf(ahead.model_error["y"][0]).tolist() == (T > 1).tolist()
    assert ahead.words == ("y in late depends on unidentified unknowns",)
    # with b free what is left is exact
    assert ahead.chi2 == pytest.approx(0.0, abs=1e-8)


# -- a block that slides and stops ---------------------------------------------------------------


def test_forces_of_a_worm_are_known_but_for_their_scale():
    """Newton's law is the same with every mass and force times c: places tell ratios only."""
    ground = Coulomb(1.0, 3.0)
    worm = chain(1, mass=1.0, stiffness=10.0, damping=1.0, rest_length=2.0, law=ground)
    times, start = np.linspace(0.0, 2.0, 41), {"position": [3.5, 0.0], "velocity": [0.0, 0.0]}
    true = simulate(worm, 2.0, x0=start, times=times)["position"]
    run = Recording(times, {"position": true}, noise={"position": 0.01}, x0=start)
    named = {"mass": 1.0, "stiffness": 10.0, "damping": 1.0, "friction": 1.0, "rest_length": 2.0}
    unknowns = [
        Unknown("mass", "mass"),
        *map(Unknown, ("stiffness", "damping", "rest_length")),
        Unknown("friction", {"friction_forward": [1.0, 1.0], "friction_backward": [3.0, 3.0]}),
    ]
    known = identifiability(fit_at(FitTask(worm, [run], unknowns), **named))
    scale = "mass, stiffness, damping and friction scale alike: only their ratios are known"
    assert known.words == (scale,)
    assert np.isfinite(known.errors).tolist() == [n == "rest_length" for n in known.names]
