"""Steps of Moreau and Jean against exact motions: impacts, dry friction, energy, order."""

import math
from dataclasses import replace

import casadi as ca
import numpy as np
import pytest
from effort import examples
from hypothesis import given, settings
from hypothesis import strategies as st

from wormopt.errors import ArgumentError, Interrupted, SolveError
from wormopt.model.friction import Coulomb, Spike
from wormopt.model.model import Contact, Model, Output, Signal, pack
from wormopt.model.schedule import Schedule
from wormopt.numerics.expressions import AtPlaces
from wormopt.simulation.moreau import MoreauJean, StepRecord
from wormopt.systems.channel.rod import Rod
from wormopt.systems.channel.rod_model import channel_rod, straight

G, MU = 9.81, 0.4


def block() -> Model:
    """A block of mass 2 over a floor; pull and weight are numbers that may change."""
    q, v, mass = ca.SX.sym("q", 2), ca.SX.sym("v", 2), 2.0
    pull, weight, mu = (ca.SX.sym(name) for name in ("pull", "weight", "mu"))
    rubbed, pressed = ca.SX.sym("rubbed"), ca.SX.sym("pressed")
    held = mu * pressed
    floor = Contact("floor", v[0], rubbed, Coulomb(held, held), gap=q[1], normal_force=pressed)
    numbers = zip((pull, weight, mu), ("pull", "weight", "mu"), (0.0, mass * G, MU), strict=True)
    return Model(
        "block",
        x=[Signal("place", q, value=0.0), Signal("rate", v, value=0.0)],
        ode=ca.vertcat(v, (pull + rubbed) / mass, (pressed - weight) / mass),
        p=[Signal(name, symbol, value=value) for symbol, name, value in numbers],
        outputs=[Output("power", pull * v[0] - weight * v[1])],
        contacts=[floor],
    )


BLOCK = MoreauJean(block(), integrals=["power"])


def kinetic(steps: StepRecord) -> np.ndarray:
    return (steps.states[2] ** 2 + steps.states[3] ** 2) * 2.0 / 2


@given(st.floats(0.2, 5.0), st.integers(100, 3000))
@settings(max_examples=examples(30))
def test_a_sliding_block_stops_after_the_distance_of_coulomb(speed: float, count: int):
    duration = 1.5 * speed / (MU * G)
    step = duration / count
    found = BLOCK.march(duration, np.array([0.1, 0.0, speed, 0.0]), step=step)
    x, y, u, w = found.states[:, -1]
    # velocity falls linearly: steps are exact but for the last one, which stops within itself
    assert x - 0.1 == pytest.approx(speed**2 / (2 * MU * G), abs=MU * G * step**2 / 4)
    assert (u, w) == (0.0, 0.0)
    assert y == 0.0
    assert found.pressed == pytest.approx(2 * G)
    assert found.rubbed[0, 0] == pytest.approx(-MU * 2 * G)
    assert found.rubbed[0, -1] == 0.0
    assert found.work["friction"][-1] == pytest.approx(-(speed**2), rel=1e-12)
    assert found.work["walls"][-1] == 0.0


@pytest.mark.parametrize("share", [0.0, 0.5, 0.999, -0.999])
def test_friction_holds_what_it_can(share: float):
    pull = share * MU * 2 * G
    found = BLOCK.march(2.0, np.zeros(4), p={"pull": pull}, step=1e-2)
    assert np.abs(found.states).max() < 1e-15
    assert found.rubbed == pytest.approx(-pull)


@pytest.mark.parametrize("sign", [1, -1])
def test_what_friction_cannot_hold_slides(sign: int):
    found = BLOCK.march(1.0, np.zeros(4), p={"pull": sign * 1.5 * MU * 2 * G}, step=1e-2)
    assert found.states[:, -1] == pytest.approx([sign * MU * G / 4, 0, sign * MU * G / 2, 0])


def dropped(step: float, speed: float = 0.3) -> StepRecord:
    """A block thrown from the height of 0.5: it falls, hits the floor, slides and stops."""
    return BLOCK.march(1.0, np.array([0.0, 0.5, speed, 0.0]), step=step)


def test_an_impact_takes_the_energy_of_the_normal_motion():
    """Restitution 0, and by dry friction of the impulse MU times the speed of the fall."""
    height, speed, fall = 0.5, 3.0, math.sqrt(2 * G * 0.5)
    found = dropped(1e-5, speed)
    slid = (speed - MU * fall) ** 2 / (2 * MU * G)
    assert found.states[0, -1] == pytest.approx(speed * fall / G + slid, abs=2e-4)
    assert found.states[1:, -1] == pytest.approx([0, 0, 0], abs=1e-4)
    assert found.work["walls"][-1] == pytest.approx(-2 * G * height, rel=2e-4)
    assert found.work["friction"][-1] == pytest.approx(-(speed**2), rel=2e-4)


def test_energy_is_accounted_for_in_every_step():
    found = dropped(1e-3)
    done = sum(found.work[name] for name in ("walls", "friction", "power"))
    assert kinetic(found) - kinetic(found)[0] == pytest.approx(done, abs=1e-12)
    assert np.diff(found.work["walls"]).max() <= 0
    assert np.diff(found.work["friction"]).max() <= 0


def test_impacts_are_met_to_first_order():
    """The time of an impact is known to a step: errors over many steps' phases fall with it."""
    fall = math.sqrt(2 * G * 0.5)
    exact = 3.0 * fall / G + (3.0 - MU * fall) ** 2 / (2 * MU * G)
    sizes, errors = np.array([4e-3, 2e-3, 1e-3, 5e-4]), []
    for size in sizes:
        phases = size * np.linspace(0.75, 1.25, 23)
        errors.append(np.mean([abs(dropped(phase, 3.0).states[0, -1] - exact) for phase in phases]))
    slope = np.polyfit(np.log(sizes), np.log(errors), 1)[0]
    assert 0.8 < slope < 1.2, errors
    assert errors[-1] < 1e-3


# -- rods ---------------------------------------------------------------------------------------

ROD = Rod(48e-3, 4e-3, 5e4, 1100.0, elements=4, degree=2)
FREE = MoreauJean(channel_rod(ROD, 1.0, 0.5))
NARROW = MoreauJean(channel_rod(ROD, 11e-3, 0.5), integrals=["damping_power", "load_power"])


def flung(size: float, spin: float = 2.0) -> np.ndarray:
    """A rod that turns and bends."""
    state = straight(ROD)
    s = ROD.nodes / ROD.length
    state["across_rate"] = size * np.cos(2 * np.pi * s)
    state["along_rate"] = 0.1 + 0 * s
    state["angle_rate"] = spin + 0 * s
    return np.concatenate([state[signal.name] for signal in FREE.model.x])


def energy(marcher: MoreauJean, states: np.ndarray) -> np.ndarray:
    """Elastic and kinetic energy at each look."""
    model = marcher.model
    p = np.array([5e4, 1100.0, 0.0, 0.5])
    total = model["strain_energy"] + model["kinetic_energy"]
    of = ca.Function("energy", [pack(model.x), pack(model.p)], [total])
    return np.array(of.map(states.shape[1])(states, np.tile(p[:, None], states.shape[1]))).ravel()


def test_energy_oscillates_but_does_not_drift():
    """2000 periods of the fastest vibration, some 20 of the slowest, strains of a tenth."""
    x0 = flung(0.5)
    numbers = np.array([5e4, 1100.0, 0.0, 0.5])
    size = 0.5 * FREE.stable_step(x0, numbers)
    swings = []
    for step in (size, size / 2):
        found = FREE.march(2.0, x0, step=step)
        relative = energy(FREE, found.states) / energy(FREE, x0[:, None]) - 1
        third = len(relative) // 3
        swings.append(float(np.std(relative)))
        early, late = relative[:third], relative[-third:]
        assert abs(late.mean() - early.mean()) < 0.05 * swings[-1]
        assert np.abs(late).max() < 1.5 * np.abs(early).max()
    assert swings[0] < 2e-3
    assert 3 < swings[0] / swings[1] < 5  # of second order


def test_momentum_is_kept():
    mass = ROD.inertia[0]
    found = FREE.march(0.5, flung(0.5)).states
    n = ROD.count
    for rows in (slice(3 * n, 4 * n), slice(4 * n, 5 * n)):
        momentum = mass @ found[rows]
        assert np.abs(momentum - momentum[0]).max() < 1e-12 * mass.sum()


def final(marcher: MoreauJean, x0: np.ndarray, end: float, count: int) -> np.ndarray:
    return marcher.march(end, x0, step=end / count).states[: 3 * ROD.count, -1]


def test_without_contact_steps_are_of_second_order():
    x0, end = flung(0.3), 0.02
    exact = final(FREE, x0, end, 64000)
    counts = np.array([500, 1000, 2000])
    errors = [np.abs(final(FREE, x0, end, k) - exact).max() for k in counts]
    assert np.diff(np.log2(errors)) == pytest.approx(-2, abs=0.15), errors
    assert errors[-1] < 1e-4


def test_between_walls_energy_is_accounted_for_and_only_lost():
    x0 = flung(0.8)
    for damping in (0.0, 1e-4):
        found = NARROW.march(0.2, x0, step=1e-5, p={"damping_time": damping})
        stored = energy(NARROW, found.states)
        lost = sum(found.work[name] for name in ("walls", "friction", "damping_power"))
        ceiling = 5e-4 if damping else 2e-5  # powers of damping are summed to first order
        assert np.abs(stored - stored[0] - lost).max() < ceiling * stored[0]
        assert found.work["walls"][-1] < -0.01 * stored[0]
        assert found.work["friction"][-1] < -0.01 * stored[0]
        # walls are entered by no more than a step's way
        across = found.states[ROD.count : 2 * ROD.count]
        assert np.abs(across).max() < 3.5e-3 + 1e-5 * np.abs(found.states[4 * ROD.count :]).max()
        assert found.pressed.min() >= 0
        assert np.all(np.abs(found.rubbed) <= 0.5 * found.pressed * (1 + 1e-9) + 1e-15)


# -- refusals -----------------------------------------------------------------------------------


def test_models_of_another_form_are_refused():
    q, t = ca.SX.sym("q"), ca.SX.sym("t")
    with pytest.raises(ArgumentError, match="coordinates, followed by their rates"):
        MoreauJean(Model("decay", x=[Signal("q", q)], ode=-q))
    whole = block()
    (floor,) = whole.contacts
    flat = replace(floor, gap=None)
    with pytest.raises(ArgumentError, match="or neither"):
        MoreauJean(replace(whole, contacts=[flat]))
    with pytest.raises(ArgumentError, match="slide both ways"):
        MoreauJean(replace(whole, contacts=[replace(floor, law=Spike())]))
    with pytest.raises(ArgumentError, match="depend on time"):
        MoreauJean(replace(whole, t=t, ode=whole.ode + ca.vertcat(0, 0, t, 0)))
    with pytest.raises(ArgumentError, match="affine"):
        MoreauJean(replace(whole, ode=whole.ode + ca.vertcat(0, 0, floor.force**2, 0)))


def test_contacts_that_act_on_one_another_are_refused():
    """A bar on two feet: pressing the one lifts the other."""
    q, v, feet = ca.SX.sym("q", 2), ca.SX.sym("v", 2), []
    ode = ca.vertcat(v, 0, -G)
    for side in (1.0, -1.0):
        rubbed, pressed = ca.SX.sym("rubbed"), ca.SX.sym("pressed")
        gap = q[1] + side * q[0]
        feet.append(
            Contact(f"foot {side:g}", v[0], rubbed, Coulomb(pressed, pressed), gap=gap,
                    normal_force=pressed)
        )  # fmt: skip
        ode += ca.vertcat(0, 0, 3 * side * pressed, pressed)
    bar = Model("bar", x=[Signal("q", q), Signal("v", v)], ode=ode, contacts=feet)
    with pytest.raises(ArgumentError, match="foot 1 and foot -1 interact through the mass"):
        MoreauJean(bar).march(1.0, np.zeros(4), step=0.1)


@pytest.mark.parametrize(("end", "step"), [(1.0, None), (1.0, 0.0), (1.0, math.nan), (-1.0, 0.1)])
def test_steps_that_lead_nowhere_are_refused(end: float, step: float | None):
    with pytest.raises(ArgumentError, match="write a step"):
        BLOCK.march(end, np.zeros(4), step=step)


def test_steps_that_are_too_long_are_told():
    with pytest.raises(SolveError, match="infinite or NaN") as caught:
        FREE.march(50.0, flung(0.5), step=3e-3)
    assert np.all(np.isfinite(caught.value.partial.states[:, 0]))
    assert caught.value.code == "not_finite"


def test_the_user_may_stop_it():
    def stop(text: str, fraction: float | None) -> None:
        if (fraction or 0.0) > 0.3:
            raise KeyboardInterrupt

    with pytest.raises(Interrupted) as caught:
        BLOCK.march(100.0, np.zeros(4), step=1e-3, report=stop)
    assert 0 < caught.value.partial.time[-1] < 100.0


@pytest.mark.parametrize("count", [3, 8, 21])  # the last eight places overlap those before
def test_functions_of_many_places_are_the_same_in_vectors(count: int):
    place, common, weight = ca.SX.sym("place", 2), ca.SX.sym("common"), ca.SX.sym("weight")
    found = weight * ca.vertcat(ca.sin(place[0]) * place[1] + common, place[1] ** 2)
    weights = np.linspace(1.0, 2.0, count)
    at = AtPlaces(ca.Function("one", [place, common, weight], [found]), weights)
    q, v, u = (ca.SX.sym(name, 2 * count) for name in "qvu")
    model = Model(
        "places",
        x=[Signal("place", q, value=0.0), Signal("rate", v, value=0.0)],
        u=[Signal("push", u, value=0.0)],
        ode=ca.vertcat(v, u),
    )
    pushed = Schedule(
        "common", ca.SX.sym("c"), ca.SX.sym("b"), np.array([0, 0.3, 1]), np.array([[1.0], [2.0]])
    )
    start = np.append(np.linspace(-3, 3, 2 * count), np.ones(2 * count))
    steps, plain = (
        MoreauJean(model, inputs=inputs).march(1.0, start, schedule=pushed, step=0.01).states[:, -1]
        for inputs in (at, at.function)
    )
    assert steps == pytest.approx(plain, rel=1e-12)
