"""A film under a travelling field as a Model: volume, orders, rates, steady waves, integrators."""

import math
from collections.abc import Callable
from typing import Any

import casadi as ca
import numpy as np
import pytest
from scipy.integrate import solve_ivp

from wormopt.analysis.continuation import continue_branch
from wormopt.analysis.steady import Rates
from wormopt.errors import ArgumentError
from wormopt.model.model import Signal
from wormopt.numerics.newton import newton
from wormopt.simulation.options import Tolerance
from wormopt.simulation.simulate import simulate
from wormopt.systems.film.cosine import CosineWave
from wormopt.systems.film.given_field import film_thickness, film_volume, slope_on, thin_film
from wormopt.systems.film.lubrication import field_slope
from wormopt.systems.film.shapes import FourierWave, grid


def slope_of(wave: Any, tension: Any, points: int) -> Any:
    xi = grid(points)
    return field_slope(wave.height(xi), wave.height(xi, 3), wave.constant, tension)


def steady_film(
    wave: Any, tension: float, points: int, order: int = 12
) -> tuple[Rates, np.ndarray]:
    """Steady film next to a wave under the wave's field."""
    rates = Rates(thin_film(slope_of(wave, tension, points), tension, order=order))
    start = film_volume(wave.height(grid(points)), order=order)
    x, found = newton(rates, start[None], np.zeros(0))
    assert found.all()
    return rates, x[0]


class Spectral:
    """The same film by Fourier differentiation of the thickness itself, with its Jacobian."""

    def __init__(self, wave: Any, tension: float, points: int) -> None:
        count = np.fft.fftfreq(points, 1 / points)
        assert points % 2  # no wave of two points a period
        unit = np.fft.fft(np.eye(points), axis=0)
        self.first, self.third = (
            np.fft.ifft(((1j * count) ** n)[:, None] * unit, axis=0).real for n in (1, 3)
        )
        self.tension = tension
        self.slope = self.first @ -np.asarray(wave.field_function(grid(points), tension))

    def rates(self, _: float, h: np.ndarray) -> np.ndarray:
        F = self.tension * (self.third @ h) + self.slope
        return self.first @ (-(h**3) / 3 * F - h)

    def slopes(self, _: float, h: np.ndarray) -> np.ndarray:
        F = self.tension * (self.third @ h) + self.slope
        own = -(h**3 / 3)[:, None] * self.tension * self.third - np.diag(h * h * F + 1)
        return self.first @ own


@pytest.mark.parametrize("points", [64, 65])
def test_rates_are_those_of_the_conservation_law(points: int):
    """Against Fourier differentiation, for a film that is far from steady."""
    wave, tension = CosineWave(0.5), 0.2
    xi, fine = grid(points), grid(195)

    def shape(at: np.ndarray) -> np.ndarray:
        return 1 + 0.3 * np.sin(at) - 0.1 * np.cos(2 * at)

    rates = Rates(thin_film(slope_of(wave, tension, points), tension))
    found = rates(film_volume(shape(xi))[None], np.zeros(0))[0]
    thickness_rate = film_thickness(found) - 1
    exact = Spectral(wave, tension, len(fine)).rates(0.0, shape(fine))
    harmonics = np.fft.rfft(exact) / len(fine)
    there: Any = sum(
        2 * (harmonics[k] * np.exp(1j * k * xi)).real for k in range(1, len(harmonics))
    )
    assert np.abs(thickness_rate - there).max() < 2e-7 * np.abs(there).max()


@pytest.mark.parametrize("wave", [CosineWave(0.5), FourierWave([0.4, 0.1], [0.0, 0.1])])
def test_newtons_wave_is_the_closed_form(wave: Any):
    _, x = steady_film(wave, 0.1, 128)
    assert np.abs(film_thickness(x) - wave.height(grid(128))).max() < 1e-10


@pytest.mark.parametrize("order", [4, 6, 8])
def test_the_error_of_the_steady_wave_falls_with_the_order(order: int):
    wave, points = FourierWave([0.4, 0.1], [0.0, 0.1]), np.array([32, 48, 64, 96])
    errors = []
    for count in points.tolist():
        _, x = steady_film(wave, 0.1, count, order)
        errors.append(np.abs(film_thickness(x, order=order) - wave.height(grid(count))).max())
    slope = -np.polyfit(np.log(points), np.log(errors), 1)[0]
    assert order - 0.4 < slope < order + 0.6
    assert errors[-1] < 100 * (2 * math.pi / 96) ** order


def test_flow_at_the_points_of_a_steady_film_is_28():
    wave = CosineWave(0.7)
    rates, x = steady_film(wave, 0.3, 128)
    flow = rates.steady(x, np.zeros(0))["flow"]
    assert np.abs(flow - (wave.height(grid(128)) + wave.constant)).max() < 1e-8


def test_ripples_of_a_flat_film_without_field_follow_the_dispersion_relation():
    """exp(i k xi + s t): s = -W k^4 / 3 - i k; here eigenvalues and a simulated ripple."""
    tension, points = 0.2, 96
    film = thin_film(np.zeros(points), tension)
    found = Rates(film).steady(np.zeros(points - 1), np.zeros(0)).eigenvalues
    for k in range(1, 6):
        exact = -tension * k**4 / 3 + 1j * k
        assert np.abs(found - exact).min() < 1e-7 * abs(exact)
    k, size, end = 2, 1e-6, 1.5
    start = film_volume(1 + size * np.cos(k * grid(points)))
    motion = simulate(
        film, end, x0={"volume": start}, route="cvodes", tolerance=Tolerance(1e-9, 1e-15)
    )
    decayed = size * math.exp(-tension * k**4 / 3 * end)
    exact = 1 + decayed * np.cos(k * (grid(points) - end))
    assert np.abs(motion["thickness"][:, -1] - exact).max() < 1e-4 * decayed


def test_growth_of_a_ripple_on_an_unstable_wave():
    """delta = 0.9, W = 1: the wave that the field holds does not stay."""
    wave, points = CosineWave(0.9), 128
    rates, x = steady_film(wave, 1.0, points)
    growth = rates.steady(x, np.zeros(0)).eigenvalues[0]
    assert growth.imag == 0
    odd = np.linalg.eigvals(Spectral(wave, 1.0, 129).slopes(0.0, wave.height(grid(129))))
    assert growth.real == pytest.approx(np.sort(odd.real)[-1], rel=1e-6)
    slopes = rates.slopes(x[None], np.zeros(0))[0]
    found: Any = np.linalg.eig(slopes)
    values, vectors = found
    mode = vectors[:, np.argmax(values.real)].real
    mode *= 1e-7 / np.abs(mode).max()
    motion = simulate(rates.model, 4.0, x0={"volume": x + mode}, route="cvodes",
                      tolerance=Tolerance(1e-11, 1e-13))  # fmt: skip
    grown = np.linalg.norm(motion.end - x) / np.linalg.norm(mode)
    assert math.log(grown) / 4.0 == pytest.approx(growth.real, rel=1e-3)


def test_a_flat_film_settles_on_the_cosine_wave():
    wave, points, periods = CosineWave(0.5), 128, 50
    film = thin_film(slope_of(wave, 0.1, points), 0.1)
    times = np.linspace(0.0, 2 * math.pi * periods, 201)
    motion = simulate(
        film, times[-1], times=times, route="cvodes", tolerance=Tolerance(1e-8, 1e-10)
    )
    h = motion["thickness"]
    assert np.abs(h[:, -1] - wave.height(grid(points))).max() < 1e-9
    assert np.abs(h.mean(axis=0) - 1).max() < 1e-12


def test_two_integrators_and_two_discretisations_agree():
    wave, tension, end = CosineWave(0.6), 0.1, 4.0
    film = thin_film(slope_of(wave, tension, 216), tension)
    ours = simulate(film, end, route="cvodes", tolerance=Tolerance(1e-10, 1e-12))
    theirs = Spectral(wave, tension, 135)
    found = solve_ivp(
        theirs.rates, (0, end), np.ones(135), "BDF", jac=theirs.slopes, rtol=1e-9, atol=1e-11
    )
    shared = np.arange(27) * 8  # phases that both have: 216 and 135 are multiples of 27
    gap = ours["thickness"][shared, -1] - found.y[::5, -1]
    assert np.abs(gap).max() < 1e-7


@pytest.mark.slow
def test_a_drop_folds_where_it_loses_stability():
    """W = 0.01: the steady drop exists from delta = 0.417 on, and is stable from its fold on."""
    points, delta = 96, ca.SX.sym("delta")
    wave, xi = CosineWave(delta), ca.DM(grid(points))
    slope = field_slope(wave.height(xi), wave.height(xi, 3), wave.constant, 0.01)
    film = thin_film(slope, 0.01, order=8, p=[Signal("delta", delta, value=0.5)])
    motion = simulate(film, 120.0, route="cvodes", tolerance=Tolerance(1e-8, 1e-10))
    rates = Rates(film)
    x, found = newton(rates, motion.end[None], np.array([0.5]))
    assert found.all()
    drop = rates.steady(x[0], np.array([0.5]))
    assert drop.stable
    assert film_thickness(x[0], order=8).max() == pytest.approx(3.256, abs=0.01)
    branch = continue_branch(drop, "delta", (0.4, 0.55), max_points=60)
    (fold,) = branch.folds
    assert fold.parameter == pytest.approx(0.4175, abs=1e-3)
    lost = np.flatnonzero(np.diff(branch.stable.astype(int)) != 0)
    assert len(lost) == 1
    assert np.abs(branch.parameter[lost[0]] - fold.parameter) < 5e-3


@pytest.mark.parametrize(("points", "order"), [(32, 4), (33, 12), (128, 14)])
def test_volume_and_thickness_are_inverse(points: int, order: int):
    xi = grid(points)
    h = 1 + 0.4 * np.cos(xi - 0.3) + 0.1 * np.sin(5 * xi)
    v = film_volume(h, order=order)
    assert np.abs(film_thickness(v, order=order) - h).max() < 1e-13
    both = film_thickness(np.column_stack([v, 0 * v]), order=order)
    assert both[:, 0] == pytest.approx(h)
    assert both[:, 1] == pytest.approx(np.ones(points))


def test_slopes_leave_out_what_points_cannot_hold():
    samples = np.cos(grid(64)) + np.cos(20 * grid(64))
    for points, kept in ((33, 0), (48, 20)):
        expected = -np.sin(grid(points)) - kept * np.sin(20 * grid(points))
        assert np.abs(slope_on(points, samples) - expected).max() < 1e-11


@pytest.mark.parametrize(
    ("made", "message"),
    [
        (lambda: thin_film(np.zeros(64), 0.0), "without surface tension"),
        (lambda: thin_film(np.zeros(64), math.nan), "tension must be above 0"),
        (lambda: thin_film(np.zeros(20), 0.1), "20 points are too few"),
        (lambda: thin_film(np.zeros(64), 0.1, order=5), "order must be one of 4, 6"),
        (lambda: thin_film(np.ones(64), 0.1), "is not periodic"),
        (lambda: thin_film(np.full(64, math.nan), 0.1), "finite"),
        (lambda: film_volume(np.full(32, 2.0)), "mean thickness must be 1"),
        (lambda: film_volume(np.full(32, math.nan)), "finite"),
        (lambda: slope_on(64, np.array([1.0, 2.0, 1.0])), "too few"),
        (lambda: slope_on(64, np.linspace(0, 1, 50)), "is not periodic"),
    ],
)
def test_films_that_cannot_be_are_refused(made: Callable[[], Any], message: str):
    with pytest.raises(ArgumentError, match=message):
        made()
