"""The best wave of a film: theory of small waves, other methods, limits, what is refused."""

import dataclasses
import math
from collections.abc import Callable
from typing import Any

import casadi as ca
import numpy as np
import pytest
from hints import Patch
from outcomes import refusals, refused, value

import wormopt as wo
from wormopt.errors import ArgumentError, SolveError
from wormopt.ocp.nlp import Bounds, Ipopt, NonlinearProgram
from wormopt.result import Result
from wormopt.study import load_scene
from wormopt.systems.film import film_wave
from wormopt.systems.film.cosine import CosineWave, square_wave_flow
from wormopt.systems.film.film_wave import checks_of_wave, cosine_beside, sampled, sampled_wave
from wormopt.systems.film.float import CAPTURE_DELTA, float_drift
from wormopt.systems.film.shapes import (
    FourierWave,
    field_function,
    flow_constant,
    grid,
    harmonics_of,
)
from wormopt.systems.film.wave_problem import (
    WaveAim,
    WaveLimits,
    field_needs,
    fitting_cosine,
    largest_flow,
    wave_problem,
)
from wormopt.systems.film.wave_search import DesignedWave, best_wave

NAME = "film_wave_design"
FIELD = field_needs(0.5, 0.1)[0]
LIMITS = WaveLimits(0.1, (0.5, 1.5), FIELD)
rng = np.random.default_rng


def solved(*changes: str) -> Result:
    return wo.run(load_scene(NAME, ["want=[]", *changes]))


def keeps_its_promises(wave: DesignedWave) -> bool:
    return all(check.passed for check in checks_of_wave(wave, WaveAim(), sampled_wave(wave)))


@pytest.fixture(scope="module")
def both() -> tuple[Result, DesignedWave]:
    """Result of the scene, and the wave on which it rests."""
    waves: list[DesignedWave] = []

    def kept(*given: Any, **options: Any) -> DesignedWave:
        waves.append(best_wave(*given, **options))
        return waves[-1]

    with Patch.context() as patch:
        patch.setattr(film_wave, "best_wave", kept)
        return solved("search.crests=1"), waves[0]


@pytest.fixture(scope="module")
def best(both: tuple[Result, DesignedWave]) -> Result:
    return both[0]


@pytest.fixture(scope="module")
def wave(both: tuple[Result, DesignedWave]) -> DesignedWave:
    return both[1]


# -- the best wave of the scene ------------------------------------------------------------------


@pytest.mark.slow
def test_with_the_field_of_the_cosine_another_wave_carries_a_third_more(best: Result):
    assert best.status == "ok"
    assert value(best, "cosine_delta") == pytest.approx(0.5, abs=1e-9)
    assert value(best, "mean_flow_cosine") == pytest.approx(1 / 3, abs=1e-9)
    assert value(best, "mean_flow_supremum") == pytest.approx(square_wave_flow(0.5), abs=1e-15)
    assert value(best, "mean_flow") == pytest.approx(0.445792, abs=1e-6)
    assert value(best, "gain") == pytest.approx(3 * value(best, "mean_flow"), rel=1e-9)
    gap = value(best, "mean_flow_supremum") - value(best, "mean_flow")
    assert value(best, "gap_to_supremum") == pytest.approx(gap, abs=1e-15)
    assert gap > 0
    assert value(best, "float_drift_cosine") == pytest.approx(0.618146030, abs=1e-8)
    assert value(best, "float_drift") > value(best, "float_drift_cosine")
    assert not value(best, "captured")


@pytest.mark.slow
def test_the_shape_alone_says_the_same_as_the_optimiser(best: Result):
    assert value(best, "recheck_error") < 1e-9
    assert value(best, "defect_max") < 2e-9
    assert best.trust["first_order_gain"] < 1e-7
    assert best.trust["checks"]["range of the field"]["value"] < 1e-5
    assert all(check.passed for check in best.checks)
    h = np.interp(grid(4001), best["xi"].values, best["height"].values)
    assert h.min() >= 0.5 - 1e-8
    assert h.max() <= 1.5 + 1e-8
    assert np.mean(h) == pytest.approx(1.0, abs=1e-3)


@pytest.mark.slow
def test_the_field_jumps_between_its_limits_and_is_straight_where_the_film_rests(best: Result):
    xi, h, field = (best[name].values for name in ("xi", "height", "field_pressure"))
    C = value(best, "c_constant")
    for level in (0.5, 1.5):
        rests = (np.abs(h - level) < 1e-7) & (np.minimum(field, FIELD - field) > 1e-6)
        inside = rests & np.roll(rests, 1) & np.roll(rests, -1)
        assert inside.sum() > 8
        # (29) without curvature
        drops = np.diff(field)[inside[:-1] & inside[1:]]
        apart = np.diff(xi)[inside[:-1] & inside[1:]]
        kept = apart > 1e-6
        assert drops[kept] / apart[kept] == pytest.approx(-3 * (level + C) / level**3, abs=1e-4)
        assert np.abs(best["height_slope"].values[inside]).max() < 1e-6
    moves = (np.abs(h - 0.5) > 1e-4) & (np.abs(h - 1.5) > 1e-4)
    share = field[moves] / FIELD
    assert np.minimum(share, 1 - share).max() < 1e-6
    assert set(np.round(share)) == {0.0, 1.0}


def test_a_float_on_the_wave_drifts_as_its_harmonics_say(wave: DesignedWave):
    assert keeps_its_promises(wave)
    cosines, sines = harmonics_of(wave.thickness(grid(1024)))
    smooth = FourierWave(cosines[:200].tolist(), sines[:200].tolist())
    assert smooth.mean_flow == pytest.approx(wave.mean_flow, abs=1e-6)
    assert float_drift(smooth).velocity == pytest.approx(sampled_wave(wave).float_drift, abs=1e-5)


@pytest.mark.slow
def test_another_method_finds_no_better_wave(wave: DesignedWave):
    """Thickness on a grid as the unknown, flow and field by quadrature, nothing of phases."""
    nodes, (least, most) = 97, LIMITS.thickness
    h = ca.SX.sym("h", nodes)
    mean = ca.sum1(h) / nodes
    D = field_function(h, LIMITS.tension)
    lift = ca.SX.sym("lift")
    w = ca.vertcat(h, lift)
    f = ca.Function("f", [w], [flow_constant(h), ca.vertcat(D + lift, mean)])
    symbols = ca.MX.sym("w", nodes + 1)
    constant, constraints = f(symbols)
    nlp = NonlinearProgram(symbols, ca.MX.sym("p", 0), -constant, constraints)
    bounds = Bounds(
        np.r_[np.full(nodes, least), -50.0],
        np.r_[np.full(nodes, most), 50.0],
        np.r_[np.zeros(nodes), 1.0],
        np.r_[np.full(nodes, FIELD), 1.0],
        np.zeros(0),
    )
    flows = []
    for start in (CosineWave(0.45).height(grid(nodes)), wave.thickness(grid(nodes))):
        found = nlp.solve(np.r_[np.asarray(start), FIELD / 2], bounds, Ipopt(tolerance=1e-7))
        assert found.success
        flows.append(1 - found.objective)
    # fields that jump are not resolved by a grid, which costs some of the flow
    assert max(flows) == pytest.approx(wave.mean_flow, abs=8e-3)
    assert max(flows) < wave.mean_flow + 2e-3


# -- waves so small that the flow is quadratic in the field ----------------------------------------


def small_flow(tension: float, crests: int) -> float:
    """Flow over the square of the field's range, of a field that jumps evenly, by its series.

    To first order (29) is W h''' + 3 h + B' = 0 for h less 1, and the flow 3 mean (h - 1)².
    """
    k = crests * (2 * np.arange(4000) + 1.0)
    return float(6 * np.sum(k**2 / (tension**2 * k**6 + 9) * (crests / (math.pi * k)) ** 2))


def best_small_flow(tension: float, starts: int = 60) -> float:
    """Largest flow of any field within 0 and 1: maxima of a convex form, climbed by jumps."""
    nodes = 512
    k = np.fft.rfftfreq(nodes, 1 / nodes)
    response = 1j * k / (1j * tension * k**3 - 3)
    response[0] = 0
    found = []
    for seed in range(starts):
        spectrum = rng(seed).normal(size=(2, 9))
        start = np.zeros(len(k), dtype=complex)
        start[1:10] = spectrum[0] + 1j * spectrum[1]
        field = (np.fft.irfft(start) > 0).astype(float)
        h = response * np.fft.rfft(field)
        for _ in range(500):
            better = (np.fft.irfft(np.conj(response) * h) > 0).astype(float)
            if np.array_equal(better, field):
                break
            field = better
            h = response * np.fft.rfft(field)
        found.append(3 * float(np.mean(np.fft.irfft(h) ** 2)))
    return max(found)


@pytest.mark.parametrize(("tension", "crests"), [(0.1, 3), (1.0, 1), (0.02, 5)])
def test_even_jumps_are_the_best_small_field(tension: float, crests: int):
    series = [small_flow(tension, n) for n in range(1, 9)]
    assert int(np.argmax(series)) + 1 == crests
    assert best_small_flow(tension) == pytest.approx(max(series), rel=2e-3)


@pytest.mark.slow
def test_a_weak_field_makes_the_wave_of_the_linear_film():
    limits = dataclasses.replace(LIMITS, field=0.02)
    found = best_wave(limits, WaveAim())
    assert found.crests == 3
    assert found.mean_flow / 0.02**2 == pytest.approx(small_flow(0.1, 3), rel=1e-4)
    assert keeps_its_promises(found)


# -- limits --------------------------------------------------------------------------------------


@pytest.mark.slow
def test_the_least_field_for_the_largest_flow_is_the_field_it_was_found_with(wave: DesignedWave):
    aim = WaveAim("field", mean_flow=wave.mean_flow)
    least = best_wave(dataclasses.replace(LIMITS, field=None), aim, crests=1)
    assert least.field_range == pytest.approx(FIELD, rel=1e-6)
    assert least.reached == least.field_range
    assert least.mean_flow == pytest.approx(wave.mean_flow, abs=1e-9)


def test_crests_alike_are_single_crests_of_another_film():
    wave, xi = FourierWave([0.3, 0.1], [0.0, 0.05]), grid(8192)
    for n in (2, 3):
        single, many = sampled(wave.height(xi), 0.1 * n**3), sampled(wave.height(n * xi), 0.1)
        assert many.c_constant == pytest.approx(single.c_constant, abs=1e-12)
        assert np.ptp(many.field) == pytest.approx(np.ptp(single.field) / n, rel=1e-4)
        assert many.float_drift == pytest.approx(single.float_drift, abs=1e-9)
    assert LIMITS.single(2) == WaveLimits(0.8, (0.5, 1.5), 2 * FIELD)


def test_no_wave_carries_more_than_the_supremum():
    for seed in range(200):
        a, b = rng(seed).uniform(0.05, 0.95), rng(seed + 1000).uniform(1.05, 3.0)
        levels = np.sort(rng(seed).uniform(a, b, 6))
        levels[[0, -1]] = a, b
        shares = rng(seed).dirichlet(np.ones(6))
        high = levels > 1
        # the shares above and below are scaled so that the mean is 1
        up, down = shares[high] @ (levels[high] - 1), shares[~high] @ (1 - levels[~high])
        shares = np.where(high, shares * down, shares * up)
        shares /= shares.sum()
        assert shares @ levels == pytest.approx(1.0)
        flow = 1 - (shares @ levels**-2) / (shares @ levels**-3)
        assert flow <= largest_flow((a, b)) + 1e-12


def test_the_supremum_is_that_of_the_square_wave_and_grows_with_the_room():
    for delta in (0.1, 0.5, 0.9):
        assert largest_flow((1 - delta, 1 + delta)) == pytest.approx(square_wave_flow(delta))
    assert largest_flow((0.5, 1.6)) > largest_flow((0.5, 1.5)) > largest_flow((0.6, 1.5))


def test_the_largest_cosine_keeps_field_slope_and_thickness():
    assert fitting_cosine(0.1, (0.5, 1.5), 100.0) == pytest.approx(0.5, abs=1e-9)
    assert fitting_cosine(0.1, (0.4, 2.0), FIELD) == pytest.approx(0.5, abs=1e-9)
    slope = field_needs(0.3, 0.1)[1]
    assert fitting_cosine(0.1, (0.4, 2.0), FIELD, slope) == pytest.approx(0.3, abs=1e-9)
    # by values on a fine grid
    xi, wave = grid(200_000), CosineWave(0.6)
    D = np.asarray(wave.field_function(xi, 0.4))
    expected = np.ptp(D), np.abs(np.gradient(D, xi)).max()
    assert field_needs(0.6, 0.4) == pytest.approx(expected, rel=1e-6)


@pytest.mark.parametrize("limit", [1e-300, 1e-12, 1e-9, 1e-6, 4e-5, 1e-3])
@pytest.mark.parametrize("tension", [0.0, 0.1, 10.0])
def test_tiny_limits_are_kept_and_used(tension: float, limit: float):
    """By the film linear in delta: D = -W delta cos xi + 3 delta sin xi, and its slope."""
    size = math.hypot(tension, 3.0)
    by_field = fitting_cosine(tension, (0.5, 1.5), limit)
    assert by_field == pytest.approx(limit / (2 * size), rel=1e-6 + by_field)
    by_slope = fitting_cosine(tension, (0.5, 1.5), 100.0, limit)
    assert by_slope == pytest.approx(limit / size, rel=1e-6 + 10 * by_slope)
    assert field_needs(by_field, tension)[0] <= limit * (1 + 1e-9)


@pytest.mark.parametrize("limit", [0.0, -1.0, math.nan])
def test_no_cosine_needs_nothing(limit: float):
    with pytest.raises(ArgumentError, match="must be above 0"):
        fitting_cosine(0.1, (0.5, 1.5), limit)
    with pytest.raises(ArgumentError, match="must be above 0"):
        fitting_cosine(0.1, (0.5, 1.5), 1.0, limit)


def test_the_cosine_beside_does_what_is_asked_or_there_is_none():
    free = WaveLimits(0.1, (0.35, 1.7))
    held = cosine_beside(free, WaveAim("field", capture=True))
    assert held.cosine_delta == CAPTURE_DELTA
    none = cosine_beside(WaveLimits(0.1, (0.5, 1.7)), WaveAim("field", capture=True))
    assert math.isnan(none.cosine_delta)
    carries = cosine_beside(free, WaveAim("field", mean_flow=0.3))
    assert carries.mean_flow_cosine == pytest.approx(0.3, abs=1e-12)


@pytest.mark.slow
def test_more_room_and_more_field_carry_more_and_tension_hinders(wave: DesignedWave):
    def flow(**changes: Any) -> float:
        found = best_wave(dataclasses.replace(LIMITS, **changes), WaveAim(), crests=2)
        assert keeps_its_promises(found)
        assert found.mean_flow < largest_flow(found.limits.thickness)
        return found.mean_flow

    by_field = [flow(field=1.0), flow(field=2.0), wave.mean_flow, flow(field=6.0)]
    by_thickness = [flow(thickness=(0.6, 1.5)), wave.mean_flow, flow(thickness=(0.5, 1.7))]
    by_tension = [flow(tension=0.3), wave.mean_flow, flow(tension=0.03), flow(tension=0.01)]
    for flows in (by_field, by_thickness, by_tension):
        assert np.min(np.diff(flows)) > 1e-4
    # fronts are as wide as the root of tension: so is what is missing to the supremum
    gaps = square_wave_flow(0.5) - np.array(by_tension[2:])
    assert math.log(gaps[0] / gaps[1]) / math.log(3) == pytest.approx(0.5, abs=0.15)


@pytest.mark.slow
def test_a_field_that_cannot_jump_carries_less_and_keeps_its_slope(best: Result):
    steep = solved("limits.gradient=4.0", "search.crests=1")
    assert steep.status == "ok"
    assert 1 / 3 < value(steep, "mean_flow") < value(best, "mean_flow")
    xi, field = steep["xi"].values, steep["field_pressure"].values
    apart = np.diff(xi) > 1e-6
    assert np.abs(np.diff(field)[apart] / np.diff(xi)[apart]).max() == pytest.approx(4, abs=1e-3)


@pytest.mark.slow
def test_a_float_is_carried_as_fast_as_the_wave_can():
    def found(*changes: str, room: str = "[0.6, 1.4]") -> Result:
        return solved(f"limits.thickness={room}", "search.crests=1", *changes)

    fast, plain = found('objective={maximise="float_speed"}'), found()
    assert fast.status == "ok"
    assert value(fast, "float_drift") >= value(plain, "float_drift") - 1e-9
    assert value(fast, "mean_flow") <= value(plain, "mean_flow") + 1e-9
    assert value(fast, "gain") > 1
    held = found('objective={maximise="float_speed"}', room="[0.4, 1.7]")
    assert value(held, "captured")
    assert value(held, "float_drift") == 1.0


@pytest.mark.slow
def test_the_least_field_that_holds_a_float():
    found = solved(
        'objective={minimise="field", capture=true}',
        "limits={thickness=[0.35, 1.7]}",
        "search.crests=2",
    )
    assert found.status == "ok"
    assert value(found, "captured")
    # at the verge: the surface is as fast as the wave on one crest and slower elsewhere
    assert value(found, "capture_margin") == pytest.approx(0.0, abs=1e-6)
    assert found["surface_velocity"].values.max() == pytest.approx(1.0, abs=1e-5)
    assert value(found, "cosine_delta") == pytest.approx(CAPTURE_DELTA)
    assert value(found, "gain") > 2


@pytest.mark.slow
def test_a_sweep_tells_other_films():
    found = solved("map={tension=[0.1, 0.02], field=[2.0]}", "search.crests=2")
    flows, cosine = found["sweep_mean_flow"].values, found["sweep_mean_flow_cosine"].values
    assert flows.shape == (2, 1)
    assert flows[1, 0] > flows[0, 0]
    assert np.all(flows > cosine)
    assert np.all(flows < value(found, "mean_flow_supremum"))


# -- what is told and refused ----------------------------------------------------------------------


def test_a_wave_that_does_not_do_what_was_found_fails(wave: DesignedWave, monkeypatch: Patch):
    class Off(DesignedWave):
        def thickness(self, xi: np.ndarray) -> np.ndarray:
            return super().thickness(xi) * (1 + 1e-4 * np.cos(xi))

    names = [f.name for f in dataclasses.fields(wave)]
    off = Off(**{name: getattr(wave, name) for name in names})
    monkeypatch.setattr(film_wave, "best_wave", lambda *given, **options: off)
    result = solved()
    assert result.status == "failed"
    assert "C by quadrature differs by" in result.reason
    assert "thickness beyond its bounds" in result.reason
    lost = [check for check in result.checks if not check.passed]
    assert {"C by quadrature", "thickness beyond its bounds"} <= {check.name for check in lost}
    assert "; ".join(check.advice for check in lost) == result.reason


@pytest.mark.parametrize("vain", [("margin", "drift"), ("drift",), ("margin",)])
def test_a_later_search_in_vain_keeps_what_was_found(
    wave: DesignedWave, monkeypatch: Patch, vain: tuple[str, ...]
):
    def search(limits: WaveLimits, aim: WaveAim, **rest: Any) -> DesignedWave:
        if aim.seek in vain:
            raise SolveError("no start converged", "another mesh")
        return wave

    monkeypatch.setattr(film_wave, "best_wave", search)
    found = solved('objective={maximise="float_speed"}')
    assert found.status == "ok"
    drift = sampled_wave(wave).float_drift
    assert value(found, "float_drift") == pytest.approx(drift, rel=1e-12)
    told = [text for text in found.trust["warnings"] if "no start converged" in text]
    assert len(told) == len(vain)


def test_a_search_in_vain_keeps_its_reason(monkeypatch: Patch):
    def lost(*given: Any, **options: Any) -> DesignedWave:
        raise SolveError("no way", code="not_solved")

    monkeypatch.setattr(film_wave, "best_wave", lost)
    with pytest.raises(SolveError, match="no way") as caught:
        solved()
    assert caught.value.partial.status == "failed"


def test_what_no_field_can_do_is_refused():
    for aim, key, said in (
        ("mean_flow=0.47", "objective.mean_flow", "has a mean flow above 0.464286"),
        ("capture=true", "objective.capture", "no wave between these thicknesses holds a float"),
    ):
        change = ["limits={thickness=[0.5, 1.5]}", f'objective={{minimise="field", {aim}}}']
        refused(NAME, change, key, said)


@pytest.mark.parametrize(
    ("made", "message"),
    [
        (lambda: dataclasses.replace(LIMITS, tension=0.0), "tension must be a number above 0"),
        (lambda: dataclasses.replace(LIMITS, field=-1.0), "field must be a number above 0"),
        (lambda: dataclasses.replace(LIMITS, gradient=math.inf), "gradient must be a number abo"),
        (lambda: dataclasses.replace(LIMITS, thickness=(0.5, 0.9)), "the mean thickness is 1"),
        (lambda: dataclasses.replace(LIMITS, thickness=(0.0, 2.0)), "the mean thickness is 1"),
        (lambda: WaveAim("field"), "the least field makes no wave"),
        (lambda: WaveAim("field", mean_flow=1.0), "above 0 and below 1"),
        (lambda: WaveAim("drift"), "must be below 0"),
        (lambda: wave_problem(LIMITS, WaveAim("field", capture=True)), "limits need a field unle"),
    ],
)
def test_limits_and_aims_that_cannot_be_are_refused(made: Callable[[], Any], message: str):
    with pytest.raises(ArgumentError, match=message):
        made()


test_what_is_wrong_in_a_scene_is_said = refusals(
    NAME,
    """
    limits.thickness=[0.5, 0.9] | limits.thickness | does not contain the mean
    limits.thickness=[1.0, 1.5] | limits.thickness | does not contain the mean
    limits.thickness=[1.5, 0.5] | limits.thickness | empty
    limits.thickness=[0, 2] | limits.thickness | above 0
    limits={thickness=[0.5, 1.5]} | limits.field | missing
    objective={} | objective | no objective or two are given
    objective={minimise="field"} | objective | the least field makes no wave
    objective={minimise="field", mean_flow=0.3} | limits.field | leave it out
    objective={maximise="mean_flow", mean_flow=0.3} | objective.mean_flow | leave it out
    objective={maximise="mean_flow", capture=true} | objective.capture | leave it out
    mesh.degree=2 | mesh.degree | write 3 or more
    map={} | map | is empty
    map.tension=[0.1, 0.1] | map.tension | repeats a number
    """,
)


@pytest.mark.slow
def test_low_waves_of_the_least_field_are_one_shape():
    """Of small waves the field is linear in the amplitude, and the flow quadratic."""
    field = []
    for flow in (1e-7, 1e-5):
        changes = [
            f'objective={{minimise="field", mean_flow={flow}}}',
            "limits={thickness=[0.5, 1.5]}",
            "search.crests=1",
        ]
        result = wo.run(load_scene("film_wave_design", changes))
        assert result.status == "ok", flow
        field.append(result["field_range"].value)
    assert field[1] == pytest.approx(10 * field[0], rel=1e-3)
