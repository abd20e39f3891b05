"""Scenes of planar motion: links that close up, obstacles; releases, and orders of other routes."""

from __future__ import annotations

from typing import Any

import casadi as ca
import numpy as np
import pytest
from numpy.testing import assert_allclose
from outcomes import refused, value
from scipy.integrate import solve_ivp

import wormopt as wo
from wormopt.errors import SolveError
from wormopt.model.friction import Coulomb, Viscous
from wormopt.model.model import Contact, Model, Signal
from wormopt.model.planar_friction import Elliptic
from wormopt.simulation.options import Route, Smooth, Tolerance
from wormopt.simulation.simulate import simulate
from wormopt.systems.planar.dynamics.chain import Axes, chain_places, planar_chain
from wormopt.systems.planar.dynamics.motion import (
    Yielding,
    closed_link,
    let_give_way,
    step_again,
    stepper_of,
    swing,
    watch_links,
)
from wormopt.systems.planar.obstacles import Disc, Wall
from wormopt.systems.planar.shape import Harmonics

# A worm of two masses that is thrown along x.
THROWN: dict[str, Any] = {
    "schema": 1, "kind": "planar-motion", "title": "Thrown",
    "worm": {"links": 1, "mass": 1.0, "stiffness": 12.0, "damping": 2.0, "rest_length": 1.0},
    "ground": {"law": "elliptic", "forward": 0.4, "backward": 1.2, "sideways": 2.0},
    "start": {"velocity": [1.5, 0.0]},
    "time": {"end": 1.2, "samples": 31},
    "tolerance": {"relative": 1e-8, "absolute": 1e-9},
}  # fmt: skip
POST = {"shape": "disc", "centre": [1.6, 0.1], "radius": 0.3}
WALL = {"shape": "wall", "point": [1.5, 0.0], "angle": 3.14159}


def pulled(force: float) -> Model:
    """Two masses 1 that nothing resists, 1 apart, pulled together by a constant force."""
    worm = planar_chain(1, mass=1.0, stiffness=0.0, damping=0.0, rest_length=1.0)
    still = np.zeros((0, 1))
    return swing(worm, 1.0, {"input": Harmonics(np.array([-force]), still, still)})


@pytest.mark.parametrize("route", ["native", "python"])
def test_a_motion_ends_where_its_link_closes(route: Route) -> None:
    """Length 1 - F t² falls to 0.01 at sqrt(0.99 / F)."""
    motion = simulate(watch_links(pulled(2.0), 0.01), 5.0, route=route)
    assert closed_link(motion) == "link 1"
    assert motion.end_time == pytest.approx(np.sqrt(0.99 / 2), abs=1e-10)


def test_links_that_stay_open_end_nothing() -> None:
    """Nor does one that is short from the start and gets longer."""
    motion = simulate(watch_links(pulled(2.0), 0.01), 0.5)
    assert (closed_link(motion), motion.end_time) == ("", 0.5)
    motion = simulate(watch_links(pulled(-1.0), 2.0), 0.5)
    assert (closed_link(motion), motion.end_time) == ("", 0.5)


def test_a_scene_whose_link_closes_is_given_up_with_what_to_change() -> None:
    """Quickly, with what has been found."""
    scene = {**THROWN, "actuation": {"period": 3.0, "force": {"mean": [-100.0]}}}
    with pytest.raises(SolveError, match=r"link 1 closes up at t = 0\.\d+.*actuation\.force") as e:
        wo.run(scene)
    assert e.value.code == "link_closed"
    assert e.value.partial.status == "failed"
    assert len(e.value.partial["time"].values) < 31


@pytest.mark.slow
def test_a_worm_pressed_against_a_stiff_wall_gets_by_slow_slip() -> None:
    """It hovered at 1e-8 and spent 300000 steps; smoothed friction leads to the same end."""
    changed = {
        "want": [],
        "time.end": 4.0,
        "tolerance.recheck": False,
        "obstacles": [{"shape": "wall", "point": [3.3, 0.0], "angle": np.pi}],
    }
    exact, smooth = (
        wo.run("planar_chain", {**changed, "contact": contact})
        for contact in ({"treatment": "exact"}, {"treatment": "smooth", "v_reg": 1e-5})
    )
    assert exact.status == "unchecked"
    assert exact.scalars["n_steps"].value < 50_000
    for name in ("x", "y"):
        assert_allclose(exact[name].values[:, -1], smooth[name].values[:, -1], rtol=0, atol=1e-3)


@pytest.mark.slow
@pytest.mark.parametrize(("obstacle", "end"), [(POST, 0.6), (WALL, 1.2)])
def test_an_obstacle_stops_a_worm(obstacle: dict[str, Any], end: float) -> None:
    """It is not entered, takes no more than the worm has, and pushes against the way."""
    scene = {**THROWN, "time": {"end": end, "samples": 31}}
    free, stopped = (wo.run({**scene, "obstacles": given}) for given in ([], [obstacle]))
    assert stopped.status == "ok"
    assert stopped["x"].values[0].max() < 1.51
    assert free["x"].values[0].max() > 1.7
    assert 0 < float(stopped["wall_depth"].value) < 5e-3
    assert -2.25 < float(stopped["wall_work"].value) < -0.1
    assert float(stopped["wall_error"].value) < 0.02
    assert float(stopped["energy_error"].value) < 1e-9


@pytest.mark.parametrize(
    ("changed", "key", "words"),
    [
        ({"obstacles": [{**POST, "centre": [1.1, 0.1]}]}, "obstacles[0]", "mass 0 starts within"),
        ({"obstacles": [{**POST, "radius": 0.0}]}, "obstacles[0].radius", "above 0"),
        ({"obstacles": [{**POST, "shape": "ring"}]}, "obstacles[0]", "disc"),
        ({"obstacles": [{**WALL, "friction": 0.3}]}, "obstacles[0].friction", "smooth"),
        ({"obstacle_stiffness": 10.0}, "obstacle_stiffness", "[[obstacles]]"),
        (
            {"obstacles": [POST], "worm": {**THROWN["worm"], "stiffness": 0.0}},
            "obstacle_stiffness", "missing",
        ),
    ],
)  # fmt: skip
def test_wrong_obstacles_are_told_by_their_keys(changed: dict[str, Any], key: str, words: str):
    refused(THROWN | changed, (), key, words)


def test_soft_obstacles_are_not_trusted() -> None:
    """The end hangs on how they give way."""
    found = wo.run({**THROWN, "obstacles": [WALL], "obstacle_stiffness": 3.0})
    assert found.status == "failed"
    assert "obstacle_stiffness" in found.reason


def thrown(obstacle: Disc | Wall) -> Model:
    """A worm of two masses on viscous ground, bound for an obstacle."""
    return planar_chain(
        1, mass=1.0, stiffness=10.0, damping=1.0, rest_length=1.0, velocity=(1.5, 0.0),
        law=Axes(Viscous(0.3), Viscous(1.0)), obstacles=[obstacle],
    )  # fmt: skip


@pytest.mark.parametrize(
    "obstacle", [Disc((1.6, 0.1), 0.3), Wall((1.5, 0.0), 2.8)], ids=["disc", "wall"]
)
def test_stiff_obstacles_are_rigid_ones(obstacle: Disc | Wall) -> None:
    """Against steps of Moreau and Jean: half the difference by four times the stiffness."""
    stepper = stepper_of(thrown(obstacle))
    assert stepper is not None
    rigid = stepper.march(1.0, step=1e-4).states[:4, -1]
    errors = []
    for stiffness in (1e3, 4e3, 1.6e4):
        soft = let_give_way(thrown(obstacle), Yielding(stiffness, 1.0))
        motion = simulate(soft, 1.0, tolerance=Tolerance(1e-8, 1e-10), route="python")
        errors.append(np.abs(motion.end[:4] - rigid).max())
    assert errors[-1] < 2e-2
    assert errors[1] < 0.75 * errors[0]
    assert errors[2] < 0.75 * errors[1]


def pushed(law: Any, load: Any, size: int = 2) -> Model:
    """A mass 1 at rest under a load that depends on time."""
    r, v, f = (ca.SX.sym(name, size) for name in "rvf")
    t = ca.SX.sym("t")
    states = [Signal("position", r, value=0.0), Signal("velocity", v, value=0.0)]
    return Model(
        "mass", states, ca.vertcat(v, f + load(t)), t=t, contacts=[Contact("mass", v, f, law)]
    )


@pytest.mark.parametrize("route", ["native", "python"])
def test_a_release_that_turns_costs_few_steps(route: Route) -> None:
    """Explicit steps are held short by how fast slow slip turns, but for the onset."""
    model = pushed(Elliptic(1, 3, 2), lambda t: ca.vertcat(2.5 * ca.sin(t), 1.5 * ca.sin(1.7 * t)))
    motion = simulate(model, 1.5, route=route)
    assert [e.kind for e in motion.events] == ["release"]
    assert motion.n_steps + motion.n_rejected < 500
    sharp = simulate(model, 1.5, route=route, tolerance=Tolerance(1e-13, 1e-14))
    assert motion.end == pytest.approx(sharp.end, abs=1e-10)


def test_a_release_goes_where_a_stiff_integrator_goes() -> None:
    """From 1e-3 after the release on, by Radau in speed and angle, which know no contact."""
    load = lambda t: np.array([2.5 * np.sin(t), 1.5 * np.sin(1.7 * t)])  # noqa: E731
    law = Elliptic(1, 3, 2)
    motion = simulate(
        pushed(law, lambda t: ca.vertcat(2.5 * ca.sin(t), 1.5 * ca.sin(1.7 * t))), 1.0, dense=True
    )
    begin = motion.events[0].time + 0.03
    x0 = np.append(*(motion.at(np.array([begin]))[name][:, 0] for name in ("position", "velocity")))

    def rate(t: float, x: np.ndarray) -> np.ndarray:
        v, F = x[2:], np.array([1.0 if x[2] >= 0 else 3.0, 2.0])
        return np.append(v, load(t) - F**2 * v / np.hypot(*(F * v)))

    found = solve_ivp(rate, (begin, 1.0), x0, "Radau", rtol=1e-10, atol=1e-13)
    assert motion.end == pytest.approx(found.y[:, -1], abs=1e-8)


def inner_lag() -> float:
    """Velocity that the smooth law is ahead after a release, by matching to V' = s + 1 / (2 V²)."""
    begin, end = -40.0, 60.0
    found = solve_ivp(
        lambda s, V: s + 1 / (2 * V**2), (begin, end), [1 / np.sqrt(-2 * begin)], "Radau",
        rtol=1e-10, atol=1e-12,
    )  # fmt: skip
    return float(found.y[0, -1] - end**2 / 2 + 2 / (3 * end**3))


def test_the_smooth_law_lets_go_early_by_the_power_of_four_fifths() -> None:
    """Release under a load F + j t: velocity ahead by C (F² d⁴ / j)^(1/5), d its width.

    m = 1. Before, the mass creeps; in between, over times (F d² / j³)^(1/5), creep and growth of
    the load are alike. C belongs to the solution that comes from creep.
    """
    F, j, widths = 1.3, 0.7, np.array([3e-3, 3e-4])
    model = pushed(Elliptic(F, F, F), lambda t: ca.vertcat(F + j * (t - 0.5), 0))
    exact = simulate(model, 2.0).end[2]
    assert exact == pytest.approx(j * 1.5**2 / 2, abs=1e-10)
    ahead = np.array(
        [
            simulate(model, 2.0, contact=Smooth(d), tolerance=Tolerance(1e-9, 1e-11)).end[2] - exact
            for d in widths.tolist()
        ]
    )
    assert np.diff(np.log(ahead)) / np.diff(np.log(widths)) == pytest.approx(0.8, abs=0.02)
    assert ahead / (inner_lag() * (F**2 * widths**4 / j) ** 0.2) == pytest.approx(1, abs=0.03)


def test_on_a_line_it_lets_go_early_at_first_order_but_for_a_logarithm() -> None:
    """Tanh leaves no tail: (d / 2) log(1 / d) at most."""
    F, j, widths = 1.3, 0.7, np.array([1e-2, 1e-3])
    model = pushed(Coulomb(F, F), lambda t: F + j * (t - 0.5), 1)
    exact = simulate(model, 2.0).end[1]
    ahead = [
        simulate(model, 2.0, contact=Smooth(d), tolerance=Tolerance(1e-9, 1e-11)).end[1] - exact
        for d in widths.tolist()
    ]
    scaled = widths * np.log(1 / widths)
    assert np.diff(np.log(ahead)) / np.diff(np.log(scaled)) == pytest.approx(1.0, abs=0.1)
    assert (np.array(ahead) < widths * np.log(1 / widths)).all()


@pytest.mark.slow
@pytest.mark.parametrize(
    "law", [Elliptic(0.4, 1.2, 2.0), Axes(Coulomb(0.4, 1.2), Coulomb(2.0, 2.0))],
    ids=["elliptic", "box"],
)  # fmt: skip
def test_steps_come_nearer_at_first_order_two_sided(law: Any) -> None:
    """Where events lie in their steps averages out over lengths near each other."""
    worm = planar_chain(
        3, mass=1.0, stiffness=12.0, damping=2.0, rest_length=1.0, bending_stiffness=4.0,
        bending_damping=0.8, law=law, position=chain_places([1, 1, 1], [0.2, -0.1]),
    )  # fmt: skip
    force = Harmonics(np.zeros(3), np.array([[3.5, -1.75, -1.75]]), np.array([[0.0, 3.03, -3.03]]))
    torque = Harmonics(np.array([0.3, 0.3]), np.array([[2.0, -1.0]]), np.array([[0.0, 1.73]]))
    model = swing(worm, 3.0, {"input": force, "torque": torque})
    motion = simulate(model, 6.0, times=np.linspace(0, 6, 301))
    assert len(motion.events) > 6
    stepper = stepper_of(model)
    assert stepper is not None
    steps = np.array([2e-3, 1e-3, 5e-4, 2.5e-4])
    errors = [step_again(stepper, motion, step=step).coarse for step in steps.tolist()]
    assert np.polyfit(np.log(steps), np.log(errors), 1)[0] == pytest.approx(1.0, abs=0.15)
    assert errors[-1] < 1e-3


def test_a_motion_of_next_to_no_length_is_not_taken_for_a_sensitive_one() -> None:
    """Steps of 5e-9 come nearer until they differ by rounding, which is large beside the way."""
    result = wo.run(wo.load_scene("planar_chain", ["time.end=1e-6", "want=[]"]))
    assert result.status == "ok"
    assert 0 < value(result, "distance") < 1e-12


def test_numbers_do_not_depend_on_the_number_of_samples() -> None:
    """A spring spins and oscillates many times between two samples; by SciPy in polar places."""
    worm = {**THROWN["worm"], "stiffness": 10.0, "damping": 0.5}
    start = {"turning": 10.0, "lengths": 1.2}
    scene = {**THROWN, "worm": worm, "ground": {"law": "free"}, "start": start}

    def rates(_t: float, y: np.ndarray) -> list[float]:
        length, speed, _ = y
        spin = 10 * 1.2**2 / length**2
        return [speed, length * spin**2 - 2 * (10 * (length - 1) + 0.5 * speed), spin]

    sol = solve_ivp(rates, (0, 8.0), [1.2, 0.0, 0.0], rtol=1e-10, atol=1e-10, dense_output=True)
    result = wo.run({**scene, "time": {"end": 8.0, "samples": 2}})
    assert result.status == "ok"
    assert value(result, "turn") == pytest.approx(sol.y[2, -1], rel=1e-8)
    shortest = sol.sol(np.linspace(0, 8.0, 100_001))[0].min()
    assert value(result, "length_min") == pytest.approx(shortest, rel=1e-6)


def test_a_skid_takes_the_energy_of_a_start_across_it() -> None:
    """Two masses at (1, 1): the skid takes 1 at once, friction the other 1 over 1/2 of way."""
    ground, start = {"law": "skid", "along": 1.0}, {"velocity": [1.0, 1.0]}
    result = wo.run({**THROWN, "ground": ground, "start": start})
    assert result.status == "ok"
    assert value(result, "ground_work") == pytest.approx(-2.0, rel=1e-9)
    assert value(result, "x_way") == pytest.approx(0.5, rel=1e-9)


def test_steep_ellipses_are_advised_to_be_skids() -> None:
    ground = {"law": "elliptic", "forward": 1.0, "sideways": 1e12}
    with pytest.raises(SolveError, match='write law = "skid"'):
        wo.run({**THROWN, "ground": ground, "start": {"velocity": [1.0, 1.0]}})
