"""Compiled equations of films with floats: those of the Model, and their Jacobian."""

from dataclasses import replace

import casadi as ca
import numpy as np
import pytest

from wormopt.magnetics.coils import Coil, CoilRow
from wormopt.magnetics.hydrostatics import Fluid, Langevin, Linear
from wormopt.magnetics.travelling import shifted_course, switched_course
from wormopt.model.gait import Gait
from wormopt.progress import silent
from wormopt.simulation.native import build
from wormopt.systems.coils import film_code
from wormopt.systems.coils.film import FilmSetup, Float, Layer
from wormopt.systems.coils.film_code import compiled, of_piece, of_schedule, simulate_film
from wormopt.systems.coils.patterns import Rides, block

ROW = CoilRow(Coil(2e-3, 4.5e-3, 20e-3, 1500.0), count=4, pitch=10e-3, gap=11e-3)
FILM = Layer(Fluid(1200.0, 0.03, Linear(0.35)), 0.05, 1e-3, 0.05, 21, start=-0.01)
SETUP = FilmSetup(FILM, ROW, -0.5e-3, 4e-3, True, Float(0.012, 3.6e-3, 1e-6, edge=4e-3), 0.02)
SATURATED = replace(FILM, fluid=replace(FILM.fluid, magnetisation=Langevin(0.35, 3e4)))
RIDES = Rides(**vars(SETUP), time=1.0)
pytestmark = pytest.mark.skipif(build.compiler() is None, reason="no compiler")


@pytest.mark.parametrize(
    ("setup", "powers"),
    [
        (SETUP, 0),
        (SETUP, 2),
        (replace(SETUP, own_field=False, layer=replace(FILM, cells=8)), 1),
        (replace(SETUP, layer=SATURATED), 0),
        (replace(SETUP, row=replace(ROW, gap=None, axis="vertical"), ground=13e-3), 0),
    ],
    ids=["piece", "schedule", "few cells that jump", "saturated", "field of two components"],
)
def test_equations_are_those_of_the_model(setup: FilmSetup, powers: int) -> None:
    """At random states, some with the float beyond a wall, by CasADi's derivatives of the whole.

    `powers`: of time in the schedule of a driven film; 0: a piece of a ride.
    """
    rng = np.random.default_rng(3)
    model = setup.model_by_terms()
    x, terms = ca.vertcat(*(one.symbol for one in model.x)), model.u[0].symbol
    whole = ca.Function("whole", [x, terms], [model.ode, ca.jacobian(model.ode, x)])
    sizes = np.concatenate([np.full(one.size, one.nominal) for one in model.x])
    own = sizes[:] if powers else sizes[:-2]
    first, growth = rng.uniform(-3e4, 3e4, (2, terms.numel()))
    t, begin, length = 0.7, 0.3, 0.4
    if powers:
        layout, p, u = of_schedule(len(first), powers, 1), [0.0], [begin, *first, *growth]
        u = [*u[: 1 + powers * len(first)], 0.0]
        since, pace = (t - begin) * (powers - 1), 1.0
    else:
        layout, p, u = of_piece(len(first)), [length, *first, *growth], []
        since, pace = t, length
    found = compiled(setup, layout)
    assert found is not None
    names = ["jac:ode:x", "jac:alg:x", "jac:ode:z", "jac:alg:z"]
    jacobian = found.factory("jacF", ["t", "x", "z", "p", "u"], names)
    for place in (-0.012, 0.0123, 0.041):
        state = rng.uniform(-0.2, 0.2, len(sizes))
        state[setup.layer.cells - 1] = place / sizes[setup.layer.cells - 1]
        ode, slopes = map(np.array, whole(sizes * state, first + since * growth))
        ode = pace * ode[: len(own), 0] / own
        slopes = pace * slopes[: len(own), : len(own)] * own / own[:, None]
        given = t, state[: len(own)], [], p, u
        mine = np.array(found(*given)[0]).ravel(), np.array(jacobian(*given)[0])
        assert mine[0] == pytest.approx(ode, rel=1e-9, abs=1e-10 * np.abs(ode).max())
        largest = np.abs(slopes).max(axis=1, keepdims=True)
        assert np.all(np.abs(mine[1] - slopes) <= 1e-9 * largest)


@pytest.mark.parametrize(
    "currents",
    [switched_course(4, 900.0, 2.0), shifted_course(np.array([0, 900.0, 0]), 1.0, 0.3, 4)],
)
def test_motions_are_those_without_a_compiler(
    currents: Gait, monkeypatch: pytest.MonkeyPatch
) -> None:
    times = np.linspace(0, 1.3, 5)
    here = simulate_film(SETUP, currents, times, 1e-7, silent)
    monkeypatch.setattr(film_code, "compiled", lambda *_: None)
    there = simulate_film(SETUP, currents, times, 1e-7, silent)
    assert np.ptp(here["position"]) > 1e-4
    for name in ("position", "thickness", "field_work", "dissipated"):
        size = np.abs(there[name]).max()
        assert here[name] == pytest.approx(there[name], abs=1e-5 * size), name


def test_rides_need_no_compiler(monkeypatch: pytest.MonkeyPatch) -> None:
    rides, pattern = replace(RIDES, tolerance=1e-6), block(2, 1200.0, 1.0, 4, 1, "steps")
    here = rides.speed(pattern)
    monkeypatch.setattr(build, "compiler", lambda: None)
    alone = replace(rides, time=np.nextafter(rides.time, 2))  # another integrator
    assert alone.speed(pattern) == pytest.approx(here, rel=1e-4)


@pytest.mark.parametrize(
    "setup",
    [
        replace(SETUP, cargo=None),
        replace(SETUP, layer=replace(FILM, ends="periodic")),
        replace(SETUP, layer=replace(FILM, cells=7)),
        replace(SETUP, layer=SATURATED, row=replace(ROW, axis="vertical")),
    ],
)
def test_other_films_are_not_compiled(setup: FilmSetup) -> None:
    assert compiled(setup, of_piece(1)) is None
