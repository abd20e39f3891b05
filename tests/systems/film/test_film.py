"""Film of magnetic fluid: closed forms, quadrature for any shape, and what Navier-Stokes says."""

import math
import re
from functools import cache
from itertools import pairwise
from pathlib import Path
from typing import Any

import casadi as ca
import mpmath as mp
import numpy as np
import pytest
import sympy as sp
from effort import examples
from hints import Capture
from hypothesis import given, settings
from hypothesis import strategies as st
from outcomes import refusals, run_text, value
from places import DOCS
from scipy.integrate import quad

import wormopt as wo
from wormopt.errors import ArgumentError
from wormopt.magnetics.pressure import OERSTED, field_of, gaussian_pressure, magnetic_pressure
from wormopt.systems.film.cosine import CosineWave, square_wave_flow
from wormopt.systems.film.shapes import (
    FourierWave,
    field_function,
    flow_constant,
    grid,
    harmonics_of,
)
from wormopt.systems.film.units import Fluid

AMPLITUDES = [0.01, 0.1, 0.5, 0.9, 0.99]

# delta, C, mean flow, D_max (mu - 1) / (8 pi) at W = 0; to half of the last digit.
PRINTED = [
    (0.1, -0.985075, 0.014925, 0.301906),
    (0.5, -0.666667, 0.333333, 1.863390),
    (0.9, -0.135231, 0.864769, 16.525442),
]


@pytest.mark.parametrize(("delta", "constant", "mean", "largest"), PRINTED)
def test_values_of_the_theory(delta: float, constant: float, mean: float, largest: float):
    wave = CosineWave(delta)
    assert wave.constant == pytest.approx(constant, abs=5.1e-7)
    assert wave.mean_flow == pytest.approx(mean, abs=5.1e-7)
    assert wave.peak().value == pytest.approx(largest, abs=5.1e-7)


def with_digits(delta: float, tension: float) -> tuple[Any, Any]:
    """Field function of (31) and its slope, in 30 digits."""
    delta, tension = mp.mpf(delta), mp.mpf(tension)
    C = -2 * (1 - delta**2) / (2 + delta**2)

    def D(xi: Any) -> Any:
        h = 1 + delta * mp.cos(xi)
        bend = -tension * delta * mp.cos(xi)
        return bend + 3 * delta * mp.sin(xi) * (1 + h) / ((2 + delta**2) * h**2)

    def slope(xi: Any) -> Any:
        h = 1 + delta * mp.cos(xi)
        return tension * delta * mp.sin(xi) + 3 / h**2 + 3 * C / h**3

    return D, slope


@pytest.mark.parametrize("tension", [0.0, 0.03, 1.0, 40.0])
@pytest.mark.parametrize("delta", AMPLITUDES)
def test_the_least_field_and_its_place_to_round_off(delta: float, tension: float):
    peak = CosineWave(delta).peak(tension)
    with mp.workdps(30):
        D, slope = with_digits(delta, tension)
        xi: Any = mp.findroot(slope, mp.mpf(peak.xi))
        assert peak.xi == pytest.approx(float(xi), abs=2e-14)
        assert peak.value == pytest.approx(float(D(xi)), rel=4e-15)
    everywhere = CosineWave(delta).field_function(np.linspace(0, 2 * np.pi, 100_001), tension)
    assert everywhere.max() <= peak.value * (1 + 1e-14)
    assert everywhere.max() == pytest.approx(peak.value, rel=1e-4)


@pytest.mark.parametrize("delta", AMPLITUDES)
def test_the_pressure_is_the_integral_of_30(delta: float):
    wave = CosineWave(delta)

    def slope(s: float) -> float:
        h = 1 + delta * math.cos(s)
        return 3 / h**2 + 3 * wave.constant / h**3

    for xi in (0.7, 2.0, 2.9, 4.0):
        found: Any = mp.quad(slope, [0, xi] if xi < 3 else [0, 3, 3.3, xi])
        expected = float(found)
        assert wave.pressure(xi) == pytest.approx(expected, rel=1e-11, abs=1e-13)


# -- flow ------------------------------------------------------------------------------------------


@pytest.mark.parametrize("order", range(5))
def test_numbers_arrays_and_expressions_agree(order: int):
    xi = np.linspace(0, 6, 7)
    symbol, delta = ca.SX.sym("xi"), ca.SX.sym("delta")
    for wave, symbolic in (
        (CosineWave(0.4), CosineWave(delta)),
        (FourierWave([0.3, 0.0, 0.1], [0.1]), FourierWave([0.3, 0.0, 0.1], [0.1])),
    ):
        rows = [
            lambda w, s: w.height(s, order),
            lambda w, s: w.field_function(s, 0.2),
            lambda w, s: w.inverse(s),
            lambda w, s: w.inverse(s, 1.5),
        ]
        for row in rows:
            values = row(wave, xi)
            function = ca.Function("f", [symbol, delta], [row(symbolic, symbol)])
            assert values == pytest.approx(np.array(function(xi[None, :], 0.4))[0], abs=1e-13)
            assert [row(wave, float(each)) for each in xi] == pytest.approx(values, abs=1e-14)


@cache
def residuals() -> Any:
    """What lubrication leaves over in (20) and (23), scaled by (25), for h = 1 + delta cos xi."""
    x, z, t, eps, Re, W = sp.symbols("x z t eps Re W", positive=True)
    delta = sp.Rational(1, 2)
    xi = t - x
    h = 1 + delta * sp.cos(xi)
    C = -2 * (1 - delta**2) / (2 + delta**2)
    F = -3 * (h + C) / h**3
    u = F * (z**2 / 2 - h * z)
    w = F * sp.diff(h, x) * z**2 / 2 + sp.diff(F, x) * (h * z**2 / 2 - z**3 / 6)
    p = 3 * delta * sp.sin(xi) * (2 + delta * sp.cos(xi)) / ((2 + delta**2) * h**2)
    field = -p - W * sp.diff(h, x, 2)  # (mu - 1) H² / (8 pi), but for a constant

    def inertia(v: Any) -> Any:
        return sp.diff(v, t) + u * sp.diff(v, x) + w * sp.diff(v, z)

    along = eps * Re * inertia(u) + sp.diff(p, x) - eps**2 * sp.diff(u, x, 2) - sp.diff(u, z, 2)
    up = eps**3 * Re * inertia(w) + sp.diff(p, z)
    up -= eps**2 * (eps**2 * sp.diff(w, x, 2) + sp.diff(w, z, 2))
    # Stress over P: 2 eps² u_x, eps u_z + eps³ w_x, 2 eps² w_z; n = (-eps h_x, 1) / root
    slope, root = eps * sp.diff(h, x), sp.sqrt(1 + eps**2 * sp.diff(h, x) ** 2)
    shear = eps * sp.diff(u, z) + eps**3 * sp.diff(w, x)
    xx, zz = 2 * eps**2 * sp.diff(u, x), 2 * eps**2 * sp.diff(w, z)
    traction = (-slope * xx + shear) / root, (-slope * shear + zz) / root
    normal = (-slope * traction[0] + traction[1]) / root
    tangential = (traction[0] + slope * traction[1]) / root
    curvature = -W * sp.diff(h, x, 2) / root**3
    balance = -p + curvature - field + normal
    return sp.lambdify(
        (x, z, t, eps, Re, W),
        [along, up, *(each.subs(z, h) for each in (balance, tangential / eps))],
        "numpy",
    )


ORDERS = [(1.0, (1, 2, 2, 2)), (0.0, (2, 2, 2, 2))]


@pytest.mark.parametrize(("Re", "orders"), ORDERS)
def test_navier_stokes_is_met_up_to_the_powers_of_eps_that_lubrication_leaves_out(
    Re: float, orders: tuple[int, ...]
):
    """Momentum along and up; normal and tangential stress, the latter over its own scale eps."""
    t, share = np.meshgrid(np.linspace(0, 2 * np.pi, 41), np.linspace(0.05, 1, 11))
    z = share * (1 + 0.5 * np.cos(t))
    sizes = []
    for eps in (0.02, 0.01, 0.005):
        left = residuals()(0.0, z, t, eps, Re, 0.7)
        sizes.append([float(np.max(np.abs(each + 0 * t))) for each in left])
    for before, after in pairwise(sizes):
        rates = np.log2(np.array(before) / np.array(after))
        assert rates == pytest.approx(np.array(orders), abs=0.1)
    assert max(sizes[-1]) < 2.0 if Re else max(sizes[-1]) < 0.01


# -- any shape -------------------------------------------------------------------------------------


@pytest.mark.parametrize("tension", [0.0, 0.3])
@pytest.mark.parametrize("delta", AMPLITUDES)
def test_quadrature_finds_the_closed_forms(delta: float, tension: float):
    closed, by_sums = CosineWave(delta), FourierWave([delta])
    xi = np.linspace(0, 2 * np.pi, 1001)
    assert by_sums.constant == pytest.approx(closed.constant, abs=1e-14)
    size = closed.peak(tension).value
    gap = by_sums.field_function(xi, tension) - closed.field_function(xi, tension)
    assert np.max(np.abs(gap)) < 1e-12 * max(size, 1)
    assert by_sums.peak(tension).value == pytest.approx(size, rel=1e-13)
    assert by_sums.peak(tension).xi == pytest.approx(closed.peak(tension).xi, abs=1e-12)
    for length in (0.3, 2.0, 6.0):
        assert by_sums.inverse(xi, length) == pytest.approx(closed.inverse(xi, length), abs=1e-12)


def test_sums_converge_spectrally():
    """Poles of 1 / h at distance -log(e) from the real axis, e = (1 - sqrt(1 - delta²)) / delta:
    errors fall by the factor e for every point, but for powers of their number."""
    delta, counts = 0.8, np.array([20, 24, 28, 32, 36, 40])
    e = (1 - math.sqrt(1 - delta**2)) / delta
    errors = [
        abs(flow_constant(1 + delta * np.cos(grid(n))) - CosineWave(delta).constant) for n in counts
    ]
    rate, _ = np.polyfit(counts, np.log(errors / counts**2.0), 1)
    assert rate == pytest.approx(math.log(e), rel=0.1)
    assert errors[-1] < 1e-8


SHAPES = st.lists(st.tuples(st.floats(-1, 1), st.floats(-1, 1)), min_size=1, max_size=5).filter(
    lambda rows: sum(abs(a) + abs(b) for a, b in rows) > 0.05
)


def shape(rows: list[tuple[float, float]], half: float) -> FourierWave:
    """Random harmonics, so small that |h - 1| is at most half."""
    total = sum(abs(a) + abs(b) for a, b in rows)
    return FourierWave([half * a / total for a, _ in rows], [half * b / total for _, b in rows])


@settings(max_examples=examples(60))
@given(rows=SHAPES, half=st.floats(0.1, 0.9), other=st.floats(-1.5, 1.5))
def test_the_field_is_periodic_for_that_constant_and_for_no_other(
    rows: list[tuple[float, float]], half: float, other: float
):
    wave = shape(rows, half)
    integrals = [
        quad(lambda s, n=n: wave.height(s) ** n, 0, 2 * math.pi, epsrel=1e-11, limit=500)[0]
        for n in (-2, -3)
    ]

    def jump(C: float) -> float:
        return 3 * (integrals[0] + C * integrals[1])

    assert abs(jump(wave.constant)) < 1e-9 * integrals[1]
    assert jump(wave.constant + other) == pytest.approx(3 * other * integrals[1], abs=1e-7)
    xi = grid(wave.nodes)
    h = wave.height(xi)
    on_grid = field_function(h, 0.2)
    assert wave.field_function(xi, 0.2) == pytest.approx(on_grid, abs=1e-10 * np.max(np.abs(h**-3)))
    peak = wave.peak(0.2)
    assert np.max(on_grid) <= peak.value + 1e-11 * np.max(h**-3)


@settings(max_examples=examples(200))
@given(rows=SHAPES, delta=st.floats(0.05, 0.95))
def test_no_shape_carries_more_than_the_square_wave(rows: list[tuple[float, float]], delta: float):
    wave = shape(rows, 1.0 - 1e-9)
    swing = wave.height(grid(4096)) - 1
    h = 1 + delta * swing / np.max(np.abs(swing))
    assert 1 + flow_constant(h) <= square_wave_flow(delta)


def test_steep_waves_come_near_to_the_square_wave():
    """So nothing less is a bound."""
    delta, xi = 0.6, grid(1 << 14)
    gaps = [
        square_wave_flow(delta) - 1 - flow_constant(1 + delta * np.tanh(steep * np.sin(xi)))
        for steep in (4.0, 16.0, 64.0)
    ]
    assert gaps[0] > gaps[1] > gaps[2] > 0
    assert gaps[2] < 0.02


def test_no_wave_carries_more_is_proven():
    """f = h^-2 - q h^-3 is concave, then convex, and not below its chord at the right end."""
    delta, h = sp.symbols("delta h", positive=True)
    q = 1 - square_wave_flow(delta)
    f = h**-2 - q * h**-3
    assert sp.simplify(sp.diff(f, h, 2) - 6 * (h - 2 * q) / h**5) == 0
    left, right = f.subs(h, 1 - delta), f.subs(h, 1 + delta)
    assert sp.simplify(left + right) == 0  # the chord is 0 at the mean of h
    gap = (right - left) / (2 * delta) - sp.diff(f, h).subs(h, 1 + delta)
    rest = sp.factor(gap * delta * (1 + delta) ** 3 * (1 + 3 * delta**2))
    assert sp.expand(rest - delta**2 * (6 + 6 * delta + 4 * delta**2)) == 0


def test_a_wave_with_several_hills_has_the_highest_one():
    wave = FourierWave([0.1, 0.05, 0.3], [0.2, 0.0, 0.02])
    xi = np.linspace(0, 2 * np.pi, 20_001)
    for tension in (0.0, 0.05, 1.0):
        peak, values = wave.peak(tension), wave.field_function(xi, tension)
        assert values.max() <= peak.value * (1 + 1e-13)
        assert values.max() == pytest.approx(peak.value, rel=1e-6)
        assert xi[np.argmax(values)] == pytest.approx(peak.xi, abs=1e-3)


def test_expressions_on_a_grid():
    """What a design of waves differentiates: C and the field as functions of the thickness."""
    h = ca.SX.sym("h", 48)
    values = CosineWave(0.5).height(grid(48))
    function = ca.Function("film", [h], [flow_constant(h), field_function(h, 0.3)])
    constant, field = function(values)
    assert float(constant) == pytest.approx(CosineWave(0.5).constant, abs=1e-14)
    closed = CosineWave(0.5).field_function(grid(48), 0.3)
    assert np.array(field).ravel() == pytest.approx(closed, abs=1e-11)
    slope = ca.Function("slope", [h], [ca.gradient(flow_constant(h), h)])
    step = np.zeros(48)
    step[7] = 1e-6
    difference = (flow_constant(values + step) - flow_constant(values - step)) / 2e-6
    assert float(slope(values)[7]) == pytest.approx(difference, rel=1e-7)


def test_harmonics_of_values_make_the_wave_again():
    wave = FourierWave([0.2, 0.1], [0.0, 0.05, 0.1])
    again = FourierWave(*harmonics_of(1.7 * wave.height(grid(32))))
    assert again.height(grid(50)) == pytest.approx(wave.height(grid(50)), abs=1e-15)


@pytest.mark.parametrize("delta", [0.0, 1.0, -0.5, math.nan, math.inf, True, "half", None])
def test_amplitudes_that_cannot_be(delta: Any):
    with pytest.raises(ArgumentError, match="above 0 and below 1"):
        CosineWave(delta)


@pytest.mark.parametrize(
    ("harmonics", "message"),
    [
        (([1.2],), "falls to -0.2"),
        (([1.0],), "must stay above 0"),
        (([],), "no wave"),
        (([math.nan],), "finite"),
        ((["a"],), "numbers"),
    ],
)
def test_shapes_that_cannot_be(harmonics: Any, message: str):
    with pytest.raises(ArgumentError, match=message):
        FourierWave(*harmonics)


def test_a_film_too_thin_for_sums_is_refused():
    with pytest.raises(ArgumentError, match="too small for quadrature"):
        _ = FourierWave([1 - 1e-9]).constant


# -- units -----------------------------------------------------------------------------------------

OIL = {
    "mu_r": 1.05, "viscosity": 0.05, "density": 1100.0, "surface_tension": 0.028, "depth": 1e-4,
    "wavelength": 1e-2, "frequency": 10.0,
}  # fmt: skip


def test_gaussian_and_si_units_tell_the_same_field():
    """(31) as the chapter has it: Gaussian, H*² = H² P, D with 8 pi / (mu - 1)."""
    oil, peak = Fluid(**OIL), CosineWave(0.5).peak()
    P = 10 * oil.pressure  # in dyn/cm²
    oersted = math.sqrt(8 * math.pi / 0.05 * peak.value * P)
    assert float(oil.gaussian_field(peak.value)) == pytest.approx(oersted, rel=1e-12)
    assert float(oil.field(peak.value)) == pytest.approx(oersted * OERSTED, rel=1e-12)
    assert pytest.approx(79.5774715, abs=1e-7) == OERSTED
    ratio = gaussian_pressure(1.05, oersted) / 10 / magnetic_pressure(1.05, oersted * OERSTED)
    assert ratio == pytest.approx(1, rel=1e-14)
    assert float(field_of(1.05, magnetic_pressure(1.05, 321.0))) == pytest.approx(321.0)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"wavelength": 5e-4}, "eps = depth"),
        ({"viscosity": 5e-4, "depth": 3e-4}, "eps Re"),
        ({"mu_r": 1.5}, "mu_r - 1 is 0.5"),
        ({"depth": 2e-3, "wavelength": 0.2}, "rho g d / P"),
    ],
)
def test_what_lubrication_leaves_out_is_warned_of(change: dict[str, float], message: str):
    assert list(Fluid(**OIL).warnings()) == []
    assert any(message in text for text in Fluid(**(OIL | change)).warnings())


def test_a_negative_pressure_has_no_field():
    with pytest.raises(ArgumentError, match="D_max"):
        Fluid(**OIL).field(-1.0)


@pytest.mark.slow
def test_the_page_runs(capsys: Capture):
    page = (DOCS / "theory-film.md").read_text(encoding="utf-8")
    for number, program in enumerate(re.findall(r"```python\n(.*?)```", page, re.DOTALL)):
        exec(compile(program, f"theory-film.md, {number}", "exec"), {"__name__": "page"})
    assert "0.333333333" in capsys.readouterr().out


# -- scenes ----------------------------------------------------------------------------------------

FILM = """schema = 1
kind = "film-flow"
[film]
delta = 0.5
"""


def test_figure_15():
    result = wo.run("fig15_film_flow")
    assert result.status == "ok"
    assert value(result, "c_constant") == pytest.approx(-2 / 3)
    assert value(result, "mean_flow") == pytest.approx(1 / 3)
    assert value(result, "d_max") == pytest.approx(1.863390, abs=5.1e-7)
    assert value(result, "xi_at_d_max") == pytest.approx(math.acos(-2 / 3))
    delta = result["curve_delta"].values
    assert result["curve_mean_flow"].values == pytest.approx(3 * delta**2 / (2 + delta**2))
    assert np.all(result["curve_square_wave"].values > result["curve_mean_flow"].values)
    fields = result["field_curves"].values
    assert fields.min() >= 0
    assert fields.min(axis=1) == pytest.approx(0, abs=1e-2)
    means = np.trapezoid(fields, result["xi"].values, axis=1) / (2 * math.pi)
    assert means[[0, 2, 4]] == pytest.approx([0.301906, 1.863390, 16.525442], abs=1e-6)
    assert max(check.value or 0.0 for check in result.checks) < 1e-12
    assert len(result.checks) == 6


def test_the_packaged_film_in_si_units():
    result = wo.run("film_field")
    oil = Fluid(**OIL)
    assert result.status == "ok"
    assert result.trust["warnings"] == []
    assert value(result, "tension_number") == pytest.approx(oil.tension)
    peak = CosineWave(0.5).peak(oil.tension)
    pascal = magnetic_pressure(1.05, value(result, "field_h0"))
    assert pascal == pytest.approx(peak.value * oil.pressure)
    gaussian = value(result, "field_h0_gaussian")
    assert gaussian * OERSTED == pytest.approx(value(result, "field_h0"))
    assert value(result, "flow_rate") == pytest.approx(oil.speed * 1e-4 / 3)
    units = {name: result.scalars[name].unit for name in ("field_h0", "flow_rate", "wave_speed")}
    assert units == {"field_h0": "A m-1", "flow_rate": "m2 s-1", "wave_speed": "m s-1"}
    assert result["field"].values.max() == pytest.approx(value(result, "field_max"), rel=1e-4)
    assert abs(result.trust["validity"]["gaussian_units_difference"]) < 1e-14


def test_a_wave_by_harmonics_is_the_cosine_wave_too(tmp_path: Path):
    one = run_text(tmp_path, FILM, "film.tension=0.4")
    other = run_text(tmp_path, FILM, "film={sines=[0.5], tension=0.4}")
    for name in ("c_constant", "mean_flow", "d_max", "delta"):
        assert value(other, name) == pytest.approx(value(one, name), abs=1e-12)
    shift = value(other, "xi_at_d_max") - value(one, "xi_at_d_max")
    assert shift == pytest.approx(math.pi / 2, abs=1e-12)


test_bad_films_are_refused = refusals(
    "fig15_film_flow",
    """
    film={} | film.delta | missing
    film.cosines=[0.1] | film.delta | so cosines cannot be added
    film={cosines=[1.3]} | film.cosines | falls to -0.3
    film={cosines=[0.0]} | film.cosines | there is no wave
    film={sines=[1.3]} | film.sines | falls to -0.3
    film.delta=0.9999 | film.delta | falls to 0.0001
    units="SI" | film.fluid | missing
    curves.delta=[1.5] | curves.delta | below 1
    curves.range=[0.9, 0.1] | curves.range | empty
    """,
)
test_bad_fluids_are_refused = refusals(
    "film_field",
    """
    film.tension=0.1 | film.tension | write surface_tension in
    units="dimensionless" | film.fluid | is in SI units
    """,
)
