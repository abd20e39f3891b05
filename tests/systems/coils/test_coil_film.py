"""A film over switched coils: its limits, orders, what it keeps, and the kind "coil-film"."""

from itertools import pairwise
from typing import Any

import casadi as ca
import numpy as np
import pytest
from outcomes import refusals
from scipy.integrate import solve_ivp
from scipy.sparse.linalg import spsolve

import wormopt as wo
from wormopt.errors import ArgumentError
from wormopt.magnetics.hydrostatics import Fluid, Linear, growth_rate
from wormopt.model.model import Model, Signal
from wormopt.runner import attempt
from wormopt.simulation.options import Tolerance
from wormopt.study.scene import load_scene
from wormopt.systems.coils.coil_pressure import CoilPressure
from wormopt.systems.coils.film import Layer, coil_film, surface_film
from wormopt.systems.coils.profile import settle

OIL = Fluid(1200.0, 0.03, Linear(0.35))
SHORT = [
    "coils.count=4", "time.switches=5", "switching.frequency=4.0", "grid.cells=8", "film.top=2.5",
]  # fmt: skip


def no_pull(h: ca.SX, slope: ca.SX) -> Any:
    return 0 * h


def rates_of(model: Model, inputs: np.ndarray | None = None) -> tuple[ca.Function, ca.Function]:
    """Right-hand side and sparse Jacobian as functions of the state alone."""
    x, ode = model.x[0].symbol, model.ode
    if inputs is not None:
        ode = ca.substitute(ode, model.u[0].symbol, ca.SX(ca.DM(inputs)))
    return ca.Function("f", [x], [ode]), ca.Function("J", [x], [ca.jacobian(ode, x)])


def ripple_rate(cells: int, gradient: float) -> float:
    """Rate of the slowest ripple but one of a flat film between walls, from the Jacobian."""
    layer = Layer(OIL, 0.05, 1e-3, 0.02, cells)
    _, jacobian = rates_of(surface_film(layer, lambda h, slope: gradient * h))
    J = jacobian(np.zeros(cells - 1)).sparse()
    mode = np.sin(2 * np.pi * np.arange(1, cells) / cells)
    rates = (J @ mode) / np.where(np.abs(mode) > 1e-9, mode, np.nan)
    assert np.nanmax(rates) - np.nanmin(rates) < 1e-8 * abs(np.nanmean(rates))
    return float(np.nanmean(rates))


@pytest.mark.parametrize("gradient", [0.0, 5e3, 3e4])
def test_ripples_follow_the_dispersion_relation_at_second_order(gradient: float) -> None:
    known = growth_rate(OIL, 0.05, 1e-3, 2 * np.pi / 0.02, gradient=gradient)
    rates = np.array([ripple_rate(n, gradient) for n in (32, 64, 128)])
    errors = np.abs(rates / known - 1)
    assert np.log2(errors[:-1] / errors[1:]) == pytest.approx(2.0, abs=0.02)
    finer = (4 * rates[1:] - rates[:-1]) / 3
    assert (64 * finer[1] - 4 * finer[0]) / 60 == pytest.approx(known, rel=1e-6)


def test_entropy_falls_exactly_as_in_the_equation() -> None:
    """Under weight alone d/dt sum 3 eta / (2 h) = -rho g sum (jump of h)² / step."""
    rng = np.random.default_rng(3)
    layer = Layer(Fluid(1200.0, 1e-25, Linear(0.35)), 0.05, 1e-3, 0.02, 24)
    h = np.exp(rng.normal(0, 2, 24))
    h *= layer.depth / h.mean()
    f, _ = rates_of(surface_film(layer, no_pull))
    change = np.diff(np.concatenate([[0], np.array(f(layer.volume(h))).ravel(), [0]]))
    falls = -np.sum(3 * layer.viscosity / (2 * h**2) * change)
    assert falls == pytest.approx(-OIL.weight * np.sum(np.diff(h) ** 2) / layer.step, rel=1e-9)


def test_hostile_films_are_refused() -> None:
    with pytest.raises(ArgumentError, match="cells are too few"):
        Layer(OIL, 0.05, 1e-3, 0.02, 4)
    with pytest.raises(ArgumentError, match="viscosity must be a number above 0"):
        Layer(OIL, 0.0, 1e-3, 0.02, 20)
    layer = Layer(OIL, 0.05, 1e-3, 0.02, 20)
    with pytest.raises(ArgumentError, match="above 0 in every cell"):
        layer.volume(np.linspace(0, 2e-3, 20))
    with pytest.raises(ArgumentError, match="the mean thickness is"):
        layer.volume(2e-3)
    row = wo.magnetics.CoilRow(wo.magnetics.Coil(2e-3, 4.5e-3, 5e-3), 2, 0.01, "vertical")
    with pytest.raises(ArgumentError, match="a coil is inside the fluid"):
        coil_film(layer, row, ground=2e-3, top=3e-3)
    with pytest.raises(ArgumentError, match="not resolved"):
        coil_film(Layer(OIL, 0.05, 1e-3, 0.02, 5), row, ground=2.5e-3 + 1e-6, top=3e-3)


@pytest.mark.slow
def test_a_small_wave_in_time_follows_the_dispersion_relation() -> None:
    known, length, end = growth_rate(OIL, 0.05, 1e-3, np.pi / 0.02), 0.02, 0.4
    rates = []
    for cells in (50, 100, 200):
        layer = Layer(OIL, 0.05, 1e-3, length, cells)
        wave = np.cos(np.pi * layer.places / length)
        wave -= wave.mean()
        start = layer.volume(layer.depth * (1 + 1e-5 * wave))
        motion = wo.simulate(
            surface_film(layer, no_pull), end, x0={"volume": start}, route="cvodes",
            tolerance=Tolerance(1e-9, 1e-13, max_steps=100_000),
        )  # fmt: skip
        left = (motion["thickness"][:, -1] / layer.depth - 1) @ wave / (1e-5 * wave @ wave)
        rates.append(np.log(left) / end)
    once = [(4 * b - a) / 3 for a, b in pairwise(rates)]
    assert once[1] == pytest.approx(known, rel=1e-6)


def at_rest(cells: int, study: CoilPressure, current: float, guess: Any) -> np.ndarray:
    """Thickness over one coil below where nothing flows, by Newton's method."""
    left, right = study.profile.ends
    layer = Layer(study.liquid, 0.05, study.profile.mean, right - left, cells, start=left)
    placed = study.placed_coil
    row = wo.magnetics.CoilRow(placed.coil, 1, 1.0, "vertical")
    model = coil_film(layer, row, ground=-placed.middle, top=2 * layer.depth, own_field=False)
    f, jacobian = rates_of(model, np.array([current]))
    h = guess(layer.places)
    state = layer.volume(h * layer.depth / h.mean())
    change: Any = None
    for _ in range(8):
        change = spsolve(jacobian(state).sparse().tocsc(), np.array(f(state)).ravel())
        state = state - change
    assert np.abs(change).max() < 1e-10 * layer.depth * layer.step
    whole = np.concatenate([[0], state, [0]])
    return layer.depth + np.diff(whole) / layer.step


@pytest.mark.slow
def test_at_rest_it_is_the_surface_of_coil_pressure() -> None:
    study: CoilPressure = load_scene("fig25_coil_pressure", ["coil.ampere_turns=2000.0"]).table
    settled = settle(study.profile, tolerance=1e-10)
    assert settled.stop is None

    def surface(x: np.ndarray) -> np.ndarray:
        return settled.equations.at(settled.y, x)

    errors = []
    for cells in (40, 80, 160):
        h = at_rest(cells, study, 2000.0, surface)
        x = np.linspace(*study.profile.ends, cells + 1)
        errors.append(np.abs(h - surface((x[1:] + x[:-1]) / 2)).max() / study.profile.mean)
    assert np.log2(np.array(errors[:-1]) / errors[1:]) == pytest.approx(2.0, abs=0.15)
    assert errors[-1] < 2e-4


def travelled(cells: int, tension: float, strength: float, eps: float) -> np.ndarray:
    """Thickness after a period under a pressure strength cos(t - x), no weight; over the mean."""
    fluid = Fluid(1.0, tension / eps**3, Linear(0.1), gravity=1e-12)
    step = 2 * np.pi / cells
    layer = Layer(fluid, 1.0, eps, 2 * np.pi, cells, start=-step / 2, ends="periodic")
    t = ca.SX.sym("t")
    wave = strength / eps**2 * ca.cos(t - ca.DM(layer.places))
    film = surface_film(layer, lambda h, slope: wave, t=t)
    motion = wo.simulate(
        film, 2 * np.pi, route="cvodes", tolerance=Tolerance(1e-9, 1e-9, max_steps=100_000)
    )
    return motion["thickness"][:, -1] / eps


@pytest.mark.slow
def test_without_weight_and_ripple_it_is_the_film_of_the_given_field() -> None:
    points, W, strength = 64, 0.1, 1.0
    xi = wo.film.grid(points)
    known = wo.simulate(
        wo.film.thin_film(-strength * np.sin(xi), W), 2 * np.pi, route="cvodes",
        tolerance=Tolerance(1e-10, 1e-10, max_steps=100_000),
    )["thickness"][:, -1]  # fmt: skip
    wanted = known[-np.arange(points)]  # at the end xi = -x
    assert np.ptp(wanted) > 0.3
    found = [travelled(n, W, strength, 1e-4)[:: n // points] for n in (64, 128, 256)]
    errors = [np.abs(h - wanted).max() for h in found]
    # cells centred on the points: means and values differ at second order, as the scheme does
    assert np.log2(np.array(errors[:-1]) / errors[1:]) == pytest.approx(2.0, abs=0.15)
    once = [(4 * b - a) / 3 for a, b in pairwise(found)]
    assert np.abs((16 * once[1] - once[0]) / 15 - wanted).max() < 1e-5


def switched(tolerance: float, cells: int = 8) -> np.ndarray:
    film = load_scene("fig24_travelling_wave", [*SHORT, f"grid.cells={cells}"]).table
    motion = film.follow(film.currents, film.layer, tolerance)
    return motion["thickness"][:, -1] / film.layer.depth


@pytest.mark.slow
def test_errors_fall_with_the_cells_and_with_the_tolerance() -> None:
    exact = switched(1e-11)
    # steps and orders are chosen from step to step, so that the slope is that of a line of best fit
    tolerances = np.logspace(-4, -9, 6)
    errors = np.array([np.abs(switched(tol) - exact).max() for tol in tolerances])
    slope = np.polyfit(np.log(tolerances), np.log(errors), 1)[0]
    assert 0.8 < slope < 1.2
    assert errors[-1] < 1e-7
    grids = [switched(1e-9, n) for n in (4, 8, 16, 32)]
    halves = [
        np.abs(fine.reshape(-1, 2).mean(axis=1) - coarse).max() for coarse, fine in pairwise(grids)
    ]
    orders = np.log2(np.array(halves[:-1]) / halves[1:])
    assert orders[-1] == pytest.approx(2.0, abs=0.25)


@pytest.mark.slow
def test_a_thousand_random_fields_leave_the_film_positive_and_whole() -> None:
    """Pulls of up to 30 times the weight of the depth, of five harmonics; seeds are told."""
    layer = Layer(OIL, 0.05, 1e-3, 0.03, 30)
    strength = ca.SX.sym("strength", 5)
    waves = np.cos(np.pi * np.outer(layer.places / layer.length, np.arange(1, 6)))
    drawn = ca.mtimes(ca.DM(waves), strength)
    film = surface_film(
        layer, lambda h, slope: drawn, p=[Signal("strength", strength, "stress", value=0.0)]
    )
    rng = np.random.default_rng(4)
    thinnest = np.inf
    for trial in range(1000):
        size = OIL.weight * layer.depth * 10 ** rng.uniform(-1, 1.5)
        motion = wo.simulate(
            film, 1.0, p={"strength": size * rng.normal(0, 1, 5)}, times=np.linspace(0, 1, 11),
            route="cvodes", tolerance=Tolerance(1e-5, 1e-7, max_steps=100_000),
        )  # fmt: skip
        h = motion["thickness"]
        assert h.min() > 0, trial
        assert np.abs(h.mean(axis=0) / layer.depth - 1).max() < 1e-13, trial
        thinnest = min(thinnest, h.min() / layer.depth)
    assert thinnest < 0.2  # the fields did draw the film away


@pytest.mark.slow
def test_the_scene_is_trusted_and_agrees_with_scipys_radau() -> None:
    scene = load_scene("fig24_travelling_wave", [*SHORT, "grid.tolerance=1e-7"])
    result = wo.run(scene)
    assert result.status == "ok"
    h = result["thickness"].values
    layer, currents = scene.table.layer, scene.table.currents
    film = scene.table.setup(layer).model()
    state = np.zeros(layer.cells - 1)
    for k in range(5):
        f, jacobian = rates_of(film, currents.on_piece(k % 4, np.zeros(1))[:, 0])
        state = solve_ivp(
            lambda t, y, f=f: np.array(f(y)).ravel(), (0.0, 0.25), state, "Radau",
            jac=lambda t, y, J=jacobian: J(y).sparse(), rtol=1e-8, atol=1e-15,
        ).y[:, -1]  # fmt: skip
    known = layer.depth + np.diff(np.concatenate([[0], state, [0]])) / layer.step
    assert np.abs(h[-1] - known).max() < 1e-5 * layer.depth
    assert h.max() - layer.depth > 0.1 * layer.depth


@pytest.mark.parametrize("name", ["fig24_travelling_wave", "coil_cargo"])
def test_terms_of_the_field_stand_for_the_currents(name: str) -> None:
    study = load_scene(name, ["coils.count=4", "grid.cells=4"]).table
    setup = study.setup(study.layer)
    rng = np.random.default_rng(1)
    x = [rng.uniform(0, 0.1, s.size) * s.nominal for s in setup.model().x]
    currents = rng.normal(scale=1000.0, size=4)
    rates = []
    for model, given in (
        (setup.model(), currents),
        (setup.model_by_terms(), setup.field.terms(currents)),
    ):
        states = ca.vertcat(*(signal.symbol for signal in model.x))
        f = ca.Function("f", [states, model.u[0].symbol], [model.ode])
        rates.append(np.array(f(np.concatenate(x), given)).ravel())
    assert rates[1] == pytest.approx(rates[0], rel=1e-9, abs=1e-12 * np.abs(rates[0]).max())
    # between two equal coils the field along the row and up vanishes in the middle
    assert len(setup.field.terms(currents)) == setup.field.series[0, ..., 0].size


@pytest.mark.slow
def test_coils_that_are_too_strong_fail_with_the_reason() -> None:
    result = wo.run(load_scene("fig24_travelling_wave", [*SHORT, "film.top=1.2"]))
    assert result.status == "failed"
    assert "raise film.top" in result.reason
    upright = ['coils.axis="vertical"', "coils.gap=20e-3", "switching.ampere_turns=3000.0"]
    many = wo.run(
        load_scene("fig24_travelling_wave", [*SHORT, *upright, "film.top=8", "fluid.chi=2.5"])
    )
    assert "forms peaks" in many.reason
    # rounding decides whether an integrator gets to the end of such a motion
    absurd = attempt(load_scene("fig24_travelling_wave", [*SHORT, "fluid.chi=1e7"]))
    assert absurd.status == "failed"
    assert "lower switching" in absurd.reason or "raise grid.cells" in absurd.reason


test_what_cannot_be_is_refused = refusals(
    "fig24_travelling_wave",
    """
    coils={axis="vertical"} | film.ground | a coil inside the fluid
    switching.on=30 | switching.on | do not fit into a pattern
    film.overhang=100.0 | film.overhang | write 1 at most
    units="dimensionless" | units | permeability of vacuum
    film.depth=1.0 & time.switches=1 & coils.count=6 | film.ground | less than 4 m above
    """,
)
