"""Walls that give way, followed by IDAS, against steps of Moreau and Jean and exact answers."""

import math
from dataclasses import replace
from typing import Any

import casadi as ca
import numpy as np
import pytest

from wormopt.control.loop import feed
from wormopt.errors import ArgumentError
from wormopt.magnetics.blocks import block_field
from wormopt.magnetics.coils import Coil, CoilRow
from wormopt.model.friction import Coulomb
from wormopt.model.model import Contact, Model, Signal
from wormopt.model.schedule import Schedule
from wormopt.simulation.moreau import MoreauJean, StepRecord
from wormopt.simulation.options import Exact, Smooth, Tolerance
from wormopt.simulation.simulate import simulate
from wormopt.simulation.trajectory import Trajectory
from wormopt.simulation.walls import smooth_walls
from wormopt.systems.channel.rod import Rod
from wormopt.systems.channel.rod_model import (
    block_load,
    block_schedule,
    channel_rod,
    magnetic_strength,
    straight,
    switched_blocks,
)

G, MU = 9.81, 0.4
LOOSE = Tolerance(1e-5, 1e-5)


def block() -> Model:
    """A block of mass 1 between a floor at 0 and a ceiling at 0.2, pulled along and across."""
    q, v, pull = ca.SX.sym("q", 2), ca.SX.sym("v", 2), ca.SX.sym("pull", 2)
    contacts, force = [], ca.vertcat(pull[0], pull[1] - G)
    for name, gap, side in (("floor", q[1], 1.0), ("ceiling", 0.2 - q[1], -1.0)):
        rubbed, pressed = ca.SX.sym(f"rubbed {name}"), ca.SX.sym(f"pressed {name}")
        held = MU * pressed
        law = Coulomb(held, held)
        contacts.append(Contact(name, v[0], rubbed, law, gap=gap, normal_force=pressed))
        force += ca.vertcat(rubbed, side * pressed)
    states = [Signal("place", q, value=0.0), Signal("rate", v, value=0.0)]
    inputs = [Signal("pull", pull, value=0.0)]
    return Model("block", states, ca.vertcat(v, force), u=inputs, contacts=contacts)


BLOCK = block()
# on the floor it is pushed, held, pushed back, lifted to the ceiling, pushed there, let fall
PULLS = np.array(
    [[6.0, 0.0], [1.0, 0.0], [-9.0, 0.0], [0.0, 30.0], [10.0, 30.0], [0.0, 30.0], [0.0, 0.0]]
)
PUSHED = Schedule(
    "pull", ca.SX.sym("pulls", 2), ca.SX.sym("begin"), 0.4 * np.arange(len(PULLS) + 1), PULLS
)
END = 0.4 * len(PULLS)


def softened(level: float) -> Trajectory:
    """With k tau² of 8 masses: a bounce of a tenth; all errors fall with the level."""
    fed = replace(feed(BLOCK, BLOCK.u, PUSHED.symbol), schedules=[PUSHED])
    soft = smooth_walls(fed, 2e4 / level**2, smoothing=1e-6 * level**2, relaxation=2e-2 * level)
    times = np.linspace(0, END, 141)
    return simulate(soft, END, contact=Smooth(1e-2 * level), tolerance=LOOSE, times=times)


def marched(step: float) -> StepRecord:
    symbols = ca.MX.sym("q", 2), ca.MX.sym("c", 2)
    marcher = MoreauJean(BLOCK, inputs=ca.Function("inputs", symbols, [symbols[1]]))
    return marcher.march(END, np.zeros(4), schedule=PUSHED, step=step)


def test_a_block_pushed_along_walls_moves_alike():
    """The gap closes in proportion as walls stiffen and friction sharpens, down to the steps'."""
    sharp = marched(1e-5)
    apart = []
    for level in (1.0, 0.3, 0.1, 0.03):
        soft = softened(level)
        place = [np.interp(soft.time, sharp.time, row) for row in sharp.states[:2]]
        apart.append(float(np.abs(soft.states[:2] - place).max()))
    assert sharp.states[0].max() > 0.2  # it did go somewhere
    assert sharp.states[1].max() == pytest.approx(0.2, abs=1e-3)
    ratios = np.array(apart[:-1]) / np.array(apart[1:])
    assert ratios.min() > 2.5, apart
    assert apart[-1] < 3e-4


def test_what_is_pushed_by_less_than_friction_creeps_by_the_width_of_the_law():
    """Smooth friction does not hold: the speed is v_reg artanh(pull / friction)."""
    soft = softened(0.1)
    speed = soft.states[2][(soft.time > 0.72) & (soft.time < 0.8)]
    assert speed == pytest.approx(1e-3 * math.atanh(1.0 / (MU * G)), rel=1e-3)


def test_a_resting_block_enters_the_wall_by_its_weight():
    soft = smooth_walls(BLOCK, 1e4, smoothing=1e-8, relaxation=0.02)
    motion = simulate(soft, 2.0, contact=Smooth(1e-3), tolerance=LOOSE)
    assert motion.end[1] == pytest.approx(1e-8 / G - G / 1e4, rel=1e-6)  # N (N / k + g) = epsilon
    assert motion["wall_force"][0, -1] == pytest.approx(G, rel=1e-6)


@pytest.mark.parametrize(("relaxation", "least", "most"), [(0.0, 0.98, 1.0), (0.02, -2e-3, 0.0)])
def test_impacts_lose_what_the_relaxation_takes(relaxation: float, least: float, most: float):
    """Without it energy is kept; with k tau² of 40 masses nothing comes back."""
    soft = smooth_walls(BLOCK, 1e5, smoothing=1e-7, relaxation=relaxation)
    fall = math.sqrt(2 * 0.1 / G)
    start = {"place": [0.0, 0.1], "rate": [0.0, 0.0]}
    times = np.linspace(fall + 0.13, 3 * fall, 100)
    motion = simulate(soft, 3 * fall, x0=start, contact=Smooth(1.0), tolerance=LOOSE, times=times)
    assert least <= motion.states[1].max() / 0.1 <= most


def test_far_walls_hardly_push():
    soft = smooth_walls(BLOCK, 1e4, smoothing=1e-8, relaxation=0.0)
    far = ca.Function("far", [soft.x[0].symbol, soft.x[1].symbol, *(s.symbol for s in soft.p)],
                      [soft["wall_force"]])  # fmt: skip
    for gap in (1e-6, 1e-3, 0.1):
        force = float(far([0.0, gap], [0, 0], 1e4, 1e-8, 0.0)[0])
        assert force * (force / 1e4 + gap) == pytest.approx(1e-8, rel=1e-12)
        assert force > 0


# -- a rod ----------------------------------------------------------------------------------------


def pulled(elements: int) -> tuple[Rod, Model, ca.Function, Schedule]:
    """A rod in a channel, the pull of three coils in seven that are on, and when they are."""
    rod = Rod(48e-3, 4e-3, 5e4, 1100.0, damping_time=1e-3, elements=elements, degree=1)
    row = CoilRow(Coil(2e-3, 9e-3, 20e-3), 1, pitch=10e-3, gap=13e-3, sides="alternating")
    field = block_field(row, 1.03 * 3.5e-3, on=3, every=7, tolerance=1e-3)
    strength = magnetic_strength(rod, susceptibility=1.0, ampere_turns=3000.0)
    schedule = block_schedule(switched_blocks(7, rate=60.0), 10e-3, strength)
    return rod, channel_rod(rod, 11e-3, friction=0.5), block_load(rod, [field]), schedule


def with_pull(model: Model, load: ca.Function, schedule: Schedule) -> Model:
    """The same pull as an expression of the model."""
    places = ca.vertcat(*(signal.symbol for signal in model.x[:3]))
    found: Any = load.expand().call([places, schedule.symbol])
    return replace(feed(model, model.u, found[0]), schedules=[schedule])


@pytest.mark.slow
def test_a_rod_in_a_travelling_field_moves_alike():
    """Over a switch; centre and shape tend to those of Moreau's steps as walls and friction harden.

    Between levels the relaxation and the width of friction are divided by about 3, the stiffness is
    multiplied by 10: k tau² stays 100 masses of a node. The shortest relaxation is below the
    period of the fastest vibration over 2 pi. The field goes on at 1/60.
    """
    rod, model, load, schedule = pulled(elements=8)
    start, end = straight(rod, along=30e-3), 0.024
    x0 = np.concatenate([start[signal.name] for signal in model.x])
    sharp = MoreauJean(model, inputs=load).march(end, x0, schedule=schedule, step=1e-6)
    fed, n = with_pull(model, load, schedule), rod.count
    centre, across = rod.weights @ sharp.states[:n] / rod.length, sharp.states[n : 2 * n]
    apart = []
    for tau in (4e-4, 1.2e-4, 4e-5):
        soft = smooth_walls(fed, 8e-3 / tau**2, smoothing=1e-13, relaxation=tau)
        times = np.linspace(0, end, 101)
        contact = Smooth(3.3 * tau)
        motion = simulate(soft, end, x0=start, contact=contact, tolerance=LOOSE, times=times)
        assert motion.route == "idas"
        own = rod.weights @ motion.states[:n] / rod.length
        shape = np.array([np.interp(times, sharp.time, row) for row in across])
        off = own - np.interp(times, sharp.time, centre), motion.states[n : 2 * n] - shape
        apart.append([float(np.sqrt(np.mean(part**2))) for part in off])
    ratios = np.array(apart[:-1]) / np.array(apart[1:])
    assert ratios.min() > 2.5, apart  # of the centre and of the shape
    assert apart[-1][0] < 0.02 * np.ptp(centre)
    assert apart[-1][1] < 0.003 * np.ptp(across)


# -- refusals -------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("numbers", "said"),
    [
        ((0.0, 1e-6, 0.0), "wall_stiffness must be positive"),
        ((math.inf, 1e-6, 0.0), "wall_stiffness must be finite"),
        ((1.0, -1.0, 0.0), "wall_smoothing must be positive"),
        ((1.0, 1.0, -1.0), "wall_relaxation must be 0 or above"),
        ((1.0, 1.0, math.nan), "wall_relaxation must be finite"),
    ],
)
def test_walls_that_cannot_be_are_refused(numbers: tuple[float, float, float], said: str):
    with pytest.raises(ArgumentError, match=said):
        smooth_walls(BLOCK, numbers[0], smoothing=numbers[1], relaxation=numbers[2])


def test_models_without_walls_are_refused():
    free = replace(BLOCK, contacts=[replace(c, gap=None) for c in BLOCK.contacts])
    with pytest.raises(ArgumentError, match="no walls"):
        smooth_walls(free, 1.0, smoothing=1.0, relaxation=0.0)
    pressed = [
        Signal(f"pressed {c.name}", c.normal_force, value=0.0)
        for c in BLOCK.contacts
        if c.normal_force is not None
    ]
    contacts = [replace(c, normal_force=None) for c in BLOCK.contacts]
    bare = replace(BLOCK, contacts=contacts, u=[*BLOCK.u, *pressed])
    with pytest.raises(ArgumentError, match="write its normal_force"):
        smooth_walls(bare, 1.0, smoothing=1.0, relaxation=0.0)
    (floor, ceiling), pull = BLOCK.contacts, BLOCK.u[0].symbol
    assert floor.gap is not None
    moved = replace(BLOCK, contacts=[replace(floor, gap=floor.gap - pull[1]), ceiling])
    with pytest.raises(ArgumentError, match="states alone"):
        smooth_walls(moved, 1.0, smoothing=1.0, relaxation=0.0)


def test_walls_that_do_not_give_way_are_no_task_for_integrators():
    with pytest.raises(ArgumentError, match="smooth_walls"):
        simulate(BLOCK, 1.0, contact=Smooth(1e-2))
    soft = smooth_walls(BLOCK, 1e4, smoothing=1e-8, relaxation=0.0)
    with pytest.raises(ValueError, match="exact"):
        simulate(soft, 1.0, contact=Exact())
