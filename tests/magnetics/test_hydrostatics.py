"""Ferrofluid at rest at a coil: law of magnetisation, surface, branch, scenes "coil-pressure"."""

import math
import re
from typing import Any

import casadi as ca
import hypothesis.strategies as st
import mpmath as mp
import numpy as np
import pytest
from effort import examples
from hypothesis import given, settings
from outcomes import refusals, value
from scipy.integrate import solve_bvp

import wormopt as wo
from wormopt.errors import ArgumentError, SolveError
from wormopt.magnetics import hydrostatics
from wormopt.magnetics.hydrostatics import (
    Fluid,
    Langevin,
    Linear,
    Placed,
    balance,
    flat_layer_pull,
    langevin_ratio,
    log_sinh_ratio,
    pressure,
    pull,
)
from wormopt.magnetics.material import MU0
from wormopt.magnetics.winding import Coil
from wormopt.pictures import figure
from wormopt.result import Result
from wormopt.study import load_scene
from wormopt.systems.coils import coil_pressure
from wormopt.systems.coils import profile as at_rest
from wormopt.systems.coils.profile import (
    Collocation,
    Profile,
    Rested,
    Settled,
    Stop,
    nodes_of,
    settle,
)

SCENE = "fig25_coil_pressure"
# A thin winding needs few nodes: the tests are quick.
THIN = [
    "coil={inner_radius=9e-3, outer_radius=11e-3, length=10e-3, distance=5e-3, ampere_turns=500.0}",
    "layer={thickness=4e-3, width=0.06}",
]
BAD: list[Any] = [0.0, -1.0, math.nan, math.inf, "1", None]


def solved(*changes: str) -> Result:
    return wo.run(load_scene(SCENE, [*THIN, *changes]))


def parts(*changes: str) -> tuple[Fluid, Placed, Profile, float]:
    """Fluid, coil, surface and ampere-turns of a scene."""
    study = load_scene(SCENE, [*THIN, *changes]).table
    return study.liquid, study.placed_coil, study.profile, study.coil.ampere_turns


# -- laws ------------------------------------------------------------------------------------------


@settings(max_examples=examples(100))
@given(y=st.floats(1e-6, 1e4))
def test_langevins_function_and_its_integral(y: float):
    with mp.workdps(40):
        exact = mp.mpf(y)
        integral, ratio = mp.log(mp.sinh(exact) / exact), (mp.coth(exact) - 1 / exact) / exact
    assert float(log_sinh_ratio(y * y)) == pytest.approx(float(integral), rel=3e-14)
    assert float(langevin_ratio(y * y)) == pytest.approx(float(ratio), rel=3e-14)


@pytest.mark.parametrize("y", [0.0, 1e-5, 0.3, 0.999, 1.001, 3.0, 500.0])
def test_derivatives_are_exact_in_and_across_both_branches(y: float):
    y2 = ca.SX.sym("y2")
    made = log_sinh_ratio(y2)
    found = ca.Function(
        "d", [y2], [made, ca.gradient(made, y2), ca.gradient(langevin_ratio(y2), y2)]
    )
    with mp.workdps(60):
        h = mp.mpf("1e-15")

        def ratio(q: Any) -> Any:
            root = mp.sqrt(q)
            return (mp.coth(root) - 1 / root) / root if q else mp.mpf(1) / 3

        at = mp.mpf(y) ** 2
        slope = (ratio(at + 2 * h) - ratio(at + h)) / h
    wanted = [float(log_sinh_ratio(y * y)), float(langevin_ratio(y * y)) / 2, float(slope)]
    assert np.array(found(y * y)).ravel() == pytest.approx(wanted, rel=1e-11)


def test_weak_fields_and_strong_ones():
    weak, strong = 10.0, 1e8
    law = Langevin(0.35, 2e4)
    assert law.energy(weak**2) == pytest.approx(Linear(0.35).energy(weak**2), rel=1e-6)
    assert law.energy(strong**2) == pytest.approx(2e4 * strong, rel=2e-3)


@given(
    x=st.floats(-1e5, 1e5), z=st.floats(-1e5, 1e5), slope=st.floats(-10, 10), turn=st.floats(-1, 1)
)
def test_the_pull_does_not_depend_on_the_frame(x: float, z: float, slope: float, turn: float):
    fluid = Fluid(1200.0, 0.03, Langevin(0.8, 2e4))
    steep = math.atan(slope) + turn
    if abs(steep) > 1.5:
        return
    c, s = math.cos(turn), math.sin(turn)
    turned = pull(fluid, (c * x - s * z, s * x + c * z), math.tan(steep))
    assert turned == pytest.approx(pull(fluid, (x, z), slope), rel=1e-6, abs=1e-6)


def test_a_flat_layer_in_a_field_across_it():
    # all around the fluid H is H0; inside H0 / (1 + chi): the exact pressure of the surface
    fluid, H0 = Fluid(1200.0, 0.03, Linear(0.35)), 1e4
    inside = H0 / 1.35
    exact = MU0 * 0.35 * inside**2 / 2 + MU0 * (0.35 * inside) ** 2 / 2
    assert flat_layer_pull(fluid, (0.0, H0), 0.0) == pytest.approx(exact, rel=1e-14)
    assert flat_layer_pull(fluid, (H0, 0.0), 0.0) == pull(fluid, (H0, 0.0), 0.0)


@settings(max_examples=examples(50))
@given(
    chi=st.floats(0.01, 10), angle=st.floats(-math.pi, math.pi), H0=st.floats(1.0, 1e6),
    slope=st.floats(-3, 3),
)  # fmt: skip
def test_the_field_inside_a_flat_layer(chi: float, angle: float, H0: float, slope: float):
    saturation = 3e4
    fluid = Fluid(1200.0, 0.03, Langevin(chi, saturation))
    H = (H0 * math.cos(angle), H0 * math.sin(angle))
    with mp.workdps(40):
        root = mp.sqrt(1 + mp.mpf(slope) ** 2)
        across, along = abs(H[1] - mp.mpf(slope) * H[0]) / root, (H[0] + slope * H[1]) / root
        y_of = 3 * mp.mpf(chi) / saturation

        def magnetised(n: Any) -> Any:
            size = mp.sqrt(n**2 + along**2)
            y = y_of * size
            return saturation * (mp.coth(y) - 1 / y) * n / size

        n = mp.findroot(
            lambda n: n + magnetised(n) - across,
            (across / (1 + mp.mpf(chi)) * mp.mpf("0.999"), across * mp.mpf("1.001")),
            solver="anderson", tol=1e-50, verify=False, maxsteps=200,
        )  # fmt: skip
        assert abs(n + magnetised(n) - across) <= mp.mpf(10) ** -25 * H0
        y = y_of * mp.sqrt(n**2 + along**2)
        energy = mp.mpf(saturation) ** 2 / (3 * mp.mpf(chi)) * mp.log(mp.sinh(y) / y)
        exact = float(MU0 * (energy + magnetised(n) ** 2 / 2))
    assert float(flat_layer_pull(fluid, H, slope)) == pytest.approx(exact, rel=1e-11)


@pytest.mark.parametrize("bad", BAD)
def test_what_is_no_fluid_is_refused(bad: Any):
    for make in (
        lambda: Linear(bad),
        lambda: Langevin(bad, 2e4),
        lambda: Langevin(0.35, bad),
        lambda: Fluid(bad, 0.03, Linear(0.3)),
        lambda: Fluid(1200.0, bad, Linear(0.3)),
        lambda: Fluid(1200.0, 0.03, Linear(0.3), gravity=bad),
        lambda: Placed(Coil(1e-3, 2e-3, 1e-2), "vertical", "below", bad),
    ):
        with pytest.raises(ArgumentError, match="must be a number above 0"):
            make()


def test_sides_and_axes_that_there_are_not():
    coil = Coil(1e-3, 2e-3, 1e-2)
    with pytest.raises(ArgumentError, match='side is "beside"'):
        Placed(coil, "vertical", "beside", 1e-3)  # pyright: ignore
    with pytest.raises(ArgumentError, match='axis is "across"'):
        Placed(coil, "across", "below", 1e-3)  # pyright: ignore


@pytest.mark.parametrize("axis", ["vertical", "along"])
@pytest.mark.parametrize("side", ["below", "above"])
def test_the_field_of_a_placed_coil_is_a_potential_field(axis: Any, side: Any):
    placed = Placed(Coil(4e-3, 6e-3, 8e-3), axis, side, 3e-3)
    x, z = ca.SX.sym("x"), ca.SX.sym("z")
    Hx, Hz = placed.field(x, z, 16)
    turn = ca.Function(
        "turn", [x, z], [ca.gradient(Hx, z) - ca.gradient(Hz, x), ca.gradient(Hz, z), Hx, Hz]
    )
    for place in ((2e-3, 1e-3), (7e-3, -0.5e-3), (0.0, 0.0)):
        curl, size, *formula = np.array(turn(*place)).ravel()
        assert abs(curl) <= 1e-8 * max(abs(size), 1.0)
        numbers = placed.field(np.array(place[0]), np.array(place[1]))
        assert np.ravel(numbers) == pytest.approx(formula, rel=1e-10, abs=1e-12)


# -- collocation -----------------------------------------------------------------------------------


def test_nodes_differentiate_and_integrate():
    nodes = nodes_of(20)
    x = nodes.x
    assert nodes.first @ np.exp(x) == pytest.approx(np.exp(x), abs=1e-11)
    assert nodes.second @ np.sin(3 * x) == pytest.approx(-9 * np.sin(3 * x), abs=1e-8)
    assert nodes.weights @ np.exp(x) == pytest.approx(2 * math.sinh(1), rel=1e-14)
    assert nodes.to_series @ np.cos(5 * np.arccos(x)) == pytest.approx(np.eye(21)[5], abs=1e-14)


@pytest.mark.parametrize("walls", ["upright", "pinned"])
def test_the_jacobian_is_that_of_differences(walls: str):
    _, _, profile, _ = parts(f'layer.walls="{walls}"')
    equations = Collocation(profile, 12)
    y = equations.flat() * (1 + 0.05 * np.cos(np.arange(14.0)))
    p = np.array([0.7])
    matrix = equations.slopes(y[None], p)[0]
    step = 1e-7 * profile.mean
    for k in range(14):
        ahead, back = y.copy(), y.copy()
        ahead[k] += step
        back[k] -= step
        rows = (equations(ahead[None], p) - equations(back[None], p))[0] / (2 * step)
        assert matrix[:, k] == pytest.approx(rows, rel=1e-5, abs=1e-5 * np.abs(matrix).max())
    by_load = (equations(y[None], p + 1e-6) - equations(y[None], p - 1e-6))[0] / 2e-6
    assert np.ravel(equations.slope_by("load")(y, p)) == pytest.approx(by_load, rel=1e-6, abs=1e-9)


def test_no_current_leaves_the_layer_flat():
    result = solved("coil.ampere_turns=0")
    assert result.status == "ok"
    assert result["surface"].values == pytest.approx(4e-3, rel=1e-14)
    assert result["pressure"].values == pytest.approx(1200 * 9.80665 * 4e-3, rel=1e-13)
    assert value(result, "pressure_change_max") == pytest.approx(0, abs=1e-12)
    depth = 4e-3 - result["inside_z"].values
    assert result["inside_pressure"].values == pytest.approx(1200 * 9.80665 * depth, abs=1e-11)
    assert value(result, "magnetic_force") == 0
    figure(result, "coil_pressure").draw_without_rendering()


def by_fourier(
    fluid: Fluid, placed: Placed, thickness: float, width: float, x: np.ndarray, current: float
) -> np.ndarray:
    """Linearised surface: gamma y'' - rho g y = -f + mean, y' = 0 at the walls, by cosines."""
    s = (np.arange(600) + 0.5) / 600 * width  # from the left wall
    Hx, Hz = placed.field(s - width / 2, np.full(600, thickness))
    f = np.asarray(pull(fluid, (current * Hx, current * Hz), 0.0))
    found = np.zeros_like(x)
    for k in range(1, 200):
        q = k * math.pi / width
        c = 2 / 600 * np.sum(f * np.cos(q * s))
        found += c / (fluid.weight + fluid.surface_tension * q**2) * np.cos(q * (x + width / 2))
    return found


def test_in_weak_fields_the_surface_is_that_of_the_linear_equation():
    x = np.linspace(-0.03, 0.03, 101)
    errors = []
    for current in (20.0, 40.0):
        fluid, placed, profile, _ = parts(f"coil.ampere_turns={current}")
        settled = settle(profile)
        rise = settled.equations.at(settled.y, x) - 4e-3
        linear = by_fourier(fluid, placed, 4e-3, 0.06, x, current)
        errors.append(np.abs(rise - linear).max() / np.abs(linear).max())
    assert errors[0] < 1e-3
    # what is neglected is of the size of the rise itself, which goes like the square
    assert 3.5 < errors[1] / errors[0] < 4.5


def surface_by_shooting(profile: Profile, load: float, guess: Any) -> Any:
    """The same balance by scipy's collocation of order 4, written for h''."""
    given_ = [profile.x, profile.h, profile.slope, profile.bend, profile.level, profile.load]
    rest = profile.balance
    solved_for = -ca.substitute(rest, profile.bend, 0) / ca.gradient(rest, profile.bend)
    bend = ca.Function("bend", [*given_[:3], *given_[4:]], [solved_for])  # linear in h''
    left, right = profile.ends
    mean = profile.mean

    def rhs(x: Any, y: Any, p: Any) -> Any:
        rows = [np.atleast_2d(v) for v in (x, y[0] * mean, y[1])]
        second = np.array(bend(*rows, p[0] * mean, load)).ravel()
        return np.vstack([y[1] / mean, second, y[0]])

    def ends(a: Any, b: Any, p: Any) -> Any:
        walls = (a[1], b[1]) if profile.walls == "upright" else (a[0] - 1, b[0] - 1)
        return np.array([*walls, a[2], b[2] - (right - left)])

    x = np.linspace(left, right, 161)
    h, slope, level = guess(x)
    area = np.concatenate([[0], np.cumsum(np.diff(x) * (h[1:] + h[:-1]) / 2)]) / mean
    start = np.vstack([h / mean, slope, area])
    return solve_bvp(rhs, ends, x, start, p=[level / mean], tol=1e-7, max_nodes=5000)


@pytest.mark.parametrize("walls", ["upright", pytest.param("pinned", marks=pytest.mark.slow)])
def test_another_collocation_finds_the_same_surface(walls: str):
    _, _, profile, _ = parts(f'layer.walls="{walls}"', "fluid.saturation=2e4")
    settled = settle(profile)
    assert settled.resolved
    found = surface_by_shooting(profile, 1.0, lambda x: (0 * x + 4e-3, 0 * x, 4e-3))
    assert found.success
    assert settled.equations.at(settled.y, found.x) == pytest.approx(4e-3 * found.y[0], abs=2e-9)
    assert np.ptp(found.y[0]) > 0.1
    assert 4e-3 * found.p[0] == pytest.approx(settled.y[-1], abs=2e-9)


def test_the_error_falls_geometrically_with_the_degree():
    _, _, profile, _ = parts()
    best = settle(profile, tolerance=1e-12)
    x = np.linspace(*profile.ends, 301)
    exact = best.equations.at(best.y, x)
    degrees = np.array([16, 24, 32, 40, 48])
    errors = []
    for n in degrees:
        equations = Collocation(profile, int(n))
        start = np.append(best.equations.at(best.y, equations.x), best.y[-1])
        y, found = equations.newton(start, 1.0)
        assert found
        errors.append(np.abs(equations.at(y, x) - exact).max() / profile.mean)
    rate = -np.polyfit(degrees, np.log(errors), 1)[0]
    # the nearest singularity is a wire 10 mm off the axis and 9 mm under the surface
    singular = complex(10e-3, 9e-3) / 0.03
    ellipse = math.log(abs(singular + np.sqrt(singular**2 - 1)))
    assert 0.7 * ellipse < rate < 1.5 * ellipse
    assert errors[-1] < 1e-5


def test_forces_on_the_fluid_balance_and_would_not_at_another_current():
    fluid, placed, profile, _ = parts("fluid.saturation=3e4")
    settled = settle(profile)
    right = Rested(fluid, placed, settled, 500.0)
    wrong = Rested(fluid, placed, settled, 505.0)
    assert right.force_imbalance < 1e-9
    assert right.volume_error < 1e-12
    assert right.field_error < 1e-8
    assert settled.equations.rates_of_growth(settled.y, settled.load)[0].real < 0
    assert wrong.field_error > 1e-4


@pytest.mark.parametrize("fault", [pytest.param("jump", marks=pytest.mark.slow), "energy"])
def test_a_wrong_pull_at_the_surface_is_found(monkeypatch: pytest.MonkeyPatch, fault: str):
    def wrong(fluid: Fluid, field: tuple[Any, Any], slope: Any) -> Any:
        energy = MU0 * fluid.magnetisation.energy(field[0] ** 2 + field[1] ** 2)
        jump = pull(fluid, field, slope) - energy
        return energy - 3 * jump if fault == "jump" else 2 * energy + jump

    for module in (hydrostatics, at_rest):
        monkeypatch.setattr(module, "pull", wrong)
    result = solved()
    assert result.status == "failed"
    assert "force imbalance" in result.reason
    assert "force imbalance" in [check.name for check in result.checks if not check.passed]


def test_the_force_is_that_of_the_stress_on_the_outside():
    # Maxwell's stress of the unchanged field has no net force; Kelvin's force by its potential
    fluid, placed, profile, _ = parts()
    rested = Rested(fluid, placed, settle(profile), 500.0)
    x, weights = rested.quadrature
    energy = [
        MU0 * 0.35 / 2 * sum(part**2 for part in rested.field(x, z))
        for z in (rested.surface(x), np.zeros_like(x))
    ]
    assert rested.force == pytest.approx(weights @ (energy[0] - energy[1]), rel=1e-8)


@pytest.mark.slow
def test_a_coil_above_draws_the_fluid_up_until_there_is_no_rest():
    changes = ['coil.side="above"', "coil.distance=12e-3", "coil.ampere_turns=4000.0"]
    with pytest.raises(SolveError, match="folds") as caught:
        solved(*changes)
    assert caught.value.code == "fold"
    assert caught.value.suggestion.startswith("write coil.ampere_turns below")
    kept = caught.value.partial
    assert kept.status == "failed"
    fold = value(kept, "ampere_turns")
    # the slowest deviation does not die out at the fold
    assert abs(kept.trust["growth_rate"]) < 1e-3 * kept.trust["degree"]
    _, _, profile, _ = parts(*changes)
    below = solved(*changes[:2], f"coil.ampere_turns={0.99 * fold}")
    assert below.status == "ok"
    assert below.trust["growth_rate"] < 0
    advised = re.search(r"coil\.ampere_turns below (\S+), ", caught.value.suggestion)
    assert advised is not None
    assert 0.99 * fold < float(advised[1]) <= fold
    xs, hs = below["x"].values, below["surface"].values

    def guess(x: Any) -> Any:
        h = np.interp(x, xs, hs)
        return h, np.gradient(h, x), float(np.mean(h))

    assert surface_by_shooting(profile, 0.99 * fold / 4000, guess).success
    assert not surface_by_shooting(profile, 1.02 * fold / 4000, guess).success


@pytest.mark.slow
@pytest.mark.parametrize("limit", [1236.7, 1239.99, 0.08765, 54321.0, 1.2367e6])
def test_the_current_that_is_advised_is_one_at_which_the_surface_rests(
    monkeypatch: pytest.MonkeyPatch, limit: float
):
    def stops(profile: Profile, **_: Any) -> Settled:
        equations = Collocation(profile, 16)
        share = limit / full
        stop = Stop("fold", share, 0.0, 0.0) if share < 1 else None
        return Settled(equations, equations.flat(), min(share, 1.0), np.ones((1, 3)), stop, True)

    def unreported(study: coil_pressure.CoilPressure) -> Result:
        assert study.settled
        return Result(SCENE, "coil-pressure")

    monkeypatch.setattr(coil_pressure, "settle", stops)
    # what is tested is the advice, not the report of this flat layer
    monkeypatch.setattr(coil_pressure.CoilPressure, "_complete", unreported)
    full = 1.7 * limit
    with pytest.raises(SolveError, match="folds") as caught:
        solved(f"coil.ampere_turns={full!r}")
    advised = re.search(r"coil\.ampere_turns below (\S+), ", caught.value.suggestion)
    assert advised is not None
    full = float(advised[1])
    assert 0.99 * limit < full
    assert solved(f"coil.ampere_turns={full!r}").status == "ok"


@pytest.mark.slow
def test_a_thin_layer_runs_dry():
    with pytest.raises(SolveError, match="runs dry") as caught:
        solved("layer.thickness=3e-4", "coil.ampere_turns=3000.0")
    assert caught.value.code == "floor"
    assert np.min(caught.value.partial["surface"].values) == pytest.approx(0, abs=1e-6)


@pytest.mark.slow
@settings(max_examples=examples(8))
@given(
    chi=st.floats(0.01, 3), thickness=st.floats(1e-3, 1e-2), tension=st.floats(0.01, 0.1),
    current=st.floats(1e-3, 600), saturated=st.booleans(),
)  # fmt: skip
def test_whatever_the_layer_it_rests_or_says_why(
    chi: float, thickness: float, tension: float, current: float, saturated: bool
):
    fluid = f"fluid={{chi={chi}, surface_tension={tension}{', saturation=2e4' * saturated}}}"
    changes = [
        fluid, f"layer.thickness={thickness}", f"coil.ampere_turns={current}", "surface.degree=96",
    ]  # fmt: skip
    refused: SolveError | None = None
    result: Result | None = None
    try:
        result = solved(*changes)
    except SolveError as error:
        refused = error
    if result is None:
        assert refused is not None
        assert refused.suggestion
        assert refused.code in ("fold", "floor", "unstable", "lost", "unresolved")
        return
    assert result.status == "ok", result.reason
    assert value(result, "volume_error") < 1e-9
    assert result.trust["force_imbalance"] < 1e-6


# -- scenes ----------------------------------------------------------------------------------------


@pytest.mark.slow
def test_the_scene_of_figure_25():
    result = wo.run(SCENE)
    assert result.status == "ok"
    # on the axis the field of the winding is elementary, and the highest pressure is there
    a, b, top, end = 5e-3, 15e-3, 3e-3, 23e-3

    def part(z: float) -> float:
        return z * math.log((b + math.hypot(b, z)) / (a + math.hypot(a, z)))

    H = 3000 / (2 * (b - a) * 20e-3) * (part(end) - part(top))
    assert value(result, "field_bottom_max") == pytest.approx(H, rel=1e-10)
    magnetic = MU0 * 0.35 * H**2 / 2
    level = value(result, "pressure_max") - magnetic
    assert 0 < level < value(result, "pressure_without_field")
    assert value(result, "pressure_change_max") == pytest.approx(446.3, abs=0.1)
    assert value(result, "surface_rise_max") == pytest.approx(1.81e-3, abs=1e-5)
    # the printed "2200 MPa" in Pa: what a field of 100 kA/m does
    assert value(result, "field_for_stated") == pytest.approx(1.0e5, rel=1e-3)
    assert value(result, "pressure_over_stated") == pytest.approx(0.2029, abs=1e-4)
    (warning,) = result.trust["warnings"]
    assert "reduces its pull" in warning


def test_the_pressure_as_printed_is_told_to_be_too_large():
    result = solved("stated_pressure=2.2e9")
    assert value(result, "induction_for_stated") == pytest.approx(125.7, abs=0.1)
    assert any("126 T" in text and "check its unit" in text for text in result.trust["warnings"])


def test_a_weak_fluid_needs_no_warning():
    assert solved("fluid.chi=0.03").trust["warnings"] == []


def test_a_fluid_without_weight_is_told_and_not_to_take_less_than_no_current():
    with pytest.raises(SolveError, match="cannot be continued beyond 0 ") as caught:
        solved("fluid.density=1e-29")
    assert caught.value.suggestion.startswith("write usual values of fluid and layer")
    assert caught.value.partial.trust["growth_rate"] < 0


def test_a_surface_that_is_not_resolved_is_refused():
    with pytest.raises(SolveError, match="does not resolve") as caught:
        solved("surface={tolerance=1e-10, degree=64}", "layer.width=0.3")
    assert caught.value.code == "unresolved"


test_wrong_scenes_are_told = refusals(
    SCENE,
    """
    units="dimensionless" | units | write units = "SI"
    coil.inner_radius=0.02 | coil.inner_radius | below outer_radius
    coil={side="above", distance=5e-3} | coil.distance | inside the fluid
    """,
)


def test_the_balance_of_the_docs():
    fluid = Fluid(1200.0, 0.03, Linear(0.35))
    H = (3e3, 4e3)
    level, h, slope, bend = 0.011, 0.01, 0.3, -2.0
    inside = pressure(fluid, h, H[0] ** 2 + H[1] ** 2, level)
    normal = (H[1] - slope * H[0]) / math.hypot(1, slope)
    curvature = -bend / math.hypot(1, slope) ** 3
    left = inside + MU0 * (0.35 * normal) ** 2 / 2 - 0.03 * curvature
    assert balance(fluid, H, h, slope, bend, level) == pytest.approx(left / fluid.weight, rel=1e-13)


@pytest.mark.slow
def test_a_small_coil_is_computed_at_its_full_current():
    # lengths of 10 µm, at which rounding keeps steps from the end of the branch by 1e-13
    scene = {
        "schema": 1, "kind": "coil-pressure", "units": "SI", "stated_pressure": 2200.0,
        "fluid": {"chi": 0.35, "density": 1200.0, "surface_tension": 0.03},
        "layer": {"thickness": 1e-5, "width": 1e-4, "walls": "upright"},
        "coil": {"ampere_turns": 3.0, "inner_radius": 5e-6, "outer_radius": 1.5e-5,
                 "length": 2e-5, "distance": 3e-6, "side": "below", "axis": "vertical"},
    }  # fmt: skip
    result = wo.run(scene)
    assert result.status == "ok"
    assert result.scalars["ampere_turns"].value == 3.0
