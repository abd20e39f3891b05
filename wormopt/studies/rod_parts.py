"""What studies of a rod in a channel share: one motion, from a scene's tables to its mean speed."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import lru_cache
from itertools import pairwise
from time import perf_counter
from typing import Any

import casadi as ca
import msgspec
import numpy as np

from wormopt.core.model import Model, pack
from wormopt.magnetics.blocks import BlockField, block_field
from wormopt.magnetics.coils import Coil, CoilRow
from wormopt.progress import Report, silent
from wormopt.result import Scalar, unit_of
from wormopt.scenes.rod import (
    ChannelTable,
    CourseTable,
    MeshTable,
    PatternTable,
    WormTable,
    ZigzagTable,
)
from wormopt.simulation.moreau import Marcher, Steps
from wormopt.worms.channel_rod import channel_rod, straight
from wormopt.worms.magnetic_rod import (
    Blocks,
    block_load,
    block_schedule,
    magnetic_strength,
    switched_blocks,
)
from wormopt.worms.rod import Rod

__all__ = [
    "ASSUMED",
    "RodCase",
    "RodCourse",
    "assumed_scalars",
    "blocks_of",
    "direction",
    "follow",
    "mean_velocity",
    "rod_of",
    "segment_length",
    "stable_step",
]

# How much wider than the room of the centre line the strip is on which the field is known: walls
# are touched at the middle of steps, and penetrated by as much as one step moves.
_WIDER = 1.05
# Parts of the time from whose means the error of the mean is told: its root is the 2 there.
_BLOCKS = 4
_POWERS = ("damping_power", "load_power")

ASSUMED = {
    "plane": "the rod moves in one plane; gravity acts across it and is left out, and so is drag",
    "row": "the row of coils goes on beyond both ends of the worm's way",
    "field": "the worm does not change the field; no iron; the pull acts on its centre line",
    "impact": "what hits a wall does not bounce",
    "magnetisation": "linear in the field, without saturation and hysteresis",
}


@dataclass(frozen=True)
class RodCase:
    """One motion of a rod in a channel, by the tables of its scene.

    Parameters
    ----------
    worm, channel, coils, pattern, mesh, course : Table
        Of the scene.
    rate : float
        Switches per second.
    """

    worm: WormTable
    channel: ChannelTable
    coils: ZigzagTable
    pattern: PatternTable
    mesh: MeshTable
    course: CourseTable
    rate: float

    def varied(self, **tables: dict[str, Any]) -> RodCase:
        """Change numbers of some tables.

        Parameters
        ----------
        **tables : dict
            New numbers by key, for each table.
        """
        changed = {
            name: msgspec.structs.replace(getattr(self, name), **numbers)
            for name, numbers in tables.items()
        }
        return replace(self, **changed)

    @property
    def key(self) -> str:
        """Text that is the same for the same motions."""
        return msgspec.json.encode(self, order="deterministic").decode()

    @property
    def cycle(self) -> float:
        """Time after which the pattern repeats, in s."""
        return self.pattern.every / self.rate

    @property
    def field_speed(self) -> float:
        """Speed of the travelling field, in m/s."""
        return self.rate * self.coils.pitch


@dataclass(frozen=True, eq=False)
class RodCourse:
    """A motion, and what it comes to.

    Parameters
    ----------
    rod : Rod
        What moved.
    steps : Steps
        The motion.
    centre : ndarray, shape (m,)
        Mean place of the rod, in m.
    velocity, velocity_error : float
        Mean velocity after settling, positive with the field, in m/s, and its standard error.
    energy_error : float
        Largest error of the balance of energy, over all that the field has done.
    penetration : float
        Deepest into a wall, in m.
    field_error : float
        Largest error of the series of H², over the largest H².
    seconds : float
        Spent.
    """

    rod: Rod
    steps: Steps
    centre: np.ndarray
    velocity: float
    velocity_error: float
    energy_error: float
    penetration: float
    field_error: float
    seconds: float


def rod_of(worm: WormTable, mesh: MeshTable) -> Rod:
    """Make the rod of a scene.

    Parameters
    ----------
    worm, mesh : Table
        Of the scene.
    """
    return Rod(
        worm.length,
        worm.diameter,
        worm.youngs_modulus,
        worm.density,
        damping_time=worm.damping_time,
        poisson_ratio=worm.poisson_ratio,
        elements=mesh.elements,
        degree=mesh.degree,
    )


def follow(case: RodCase, report: Report = silent) -> RodCourse:
    """Follow a straight rod in the middle of the channel as the coils are switched.

    Parameters
    ----------
    case : RodCase
        What moves, where and how.
    report : callable, optional
        Told how far it is.

    Returns
    -------
    RodCourse

    Raises
    ------
    SolveError
        If the motion is no longer a number.
    Interrupted
        If the user stopped it.
    """
    begin = perf_counter()
    rod = rod_of(case.worm, case.mesh)
    blocks = blocks_of(case)
    fields = tuple(_field(case, count) for count in blocks.counts)
    strength = magnetic_strength(rod, case.worm.susceptibility, case.coils.ampere_turns)
    schedule = block_schedule(blocks, case.coils.pitch, strength)
    marcher = _marcher_of(case, rod, fields)
    numbers, x0 = _numbers(case), _start(case, marcher, rod)
    cycles = max(case.course.cycles, int(np.ceil(case.course.duration / case.cycle)))
    steps = marcher.march(
        cycles * case.cycle, x0, p=numbers, schedule=schedule, step=case.mesh.step, report=report
    )
    centre = rod.weights @ steps.states[: rod.count] / rod.length
    velocity, error = mean_velocity(steps.time, centre, case.course.settle)
    room = (case.channel.diameter - case.worm.diameter) / 2
    return RodCourse(
        rod=rod,
        steps=steps,
        centre=centre,
        velocity=velocity,
        velocity_error=error,
        energy_error=_energy_error(marcher.model, steps, numbers),
        penetration=float(np.abs(steps.states[rod.count : 2 * rod.count]).max() - room),
        field_error=max(field.error for field in fields),
        seconds=perf_counter() - begin,
    )


def stable_step(case: RodCase) -> float:
    """Longest stable time step of a case.

    Parameters
    ----------
    case : RodCase
        What moves.

    Returns
    -------
    float
        In s.
    """
    rod = rod_of(case.worm, case.mesh)
    marcher = _marcher_of(case, rod, tuple(_field(case, count) for count in blocks_of(case).counts))
    numbers = _numbers(case)
    values = np.array([numbers[signal.name] for signal in marcher.model.p])
    return marcher.stable_step(_start(case, marcher, rod), values)


def blocks_of(case: RodCase) -> Blocks:
    """Tell which coils are on when.

    Parameters
    ----------
    case : RodCase
        How they are switched.
    """
    pattern = case.pattern
    return switched_blocks(pattern.every, case.rate, pattern.duration, pattern.shift)


def _numbers(case: RodCase) -> dict[str, float]:
    """Parameters of the model."""
    return {
        "youngs_modulus": case.worm.youngs_modulus,
        "density": case.worm.density,
        "damping_time": case.worm.damping_time,
        "friction": case.channel.friction,
    }


def _start(case: RodCase, marcher: Marcher, rod: Rod) -> np.ndarray:
    """A straight rod at rest one repeat of the pattern away from the first coil."""
    state = straight(rod, along=case.pattern.every * case.coils.pitch)
    return np.concatenate([state[signal.name] for signal in marcher.model.x])


def mean_velocity(time: np.ndarray, centre: np.ndarray, settle: float) -> tuple[float, float]:
    """Mean velocity of a motion that repeats itself, regularly or not, and how sure it is.

    Weights that rise from 0 and fall to 0 smoothly make the mean of what repeats itself in any
    period much shorter than the time independent of where the time begins and ends.

    Parameters
    ----------
    time, centre : ndarray, shape (m,)
        The motion.
    settle : float
        Share of the time at the beginning that does not count.

    Returns
    -------
    velocity : float
    error : float
        Standard error: of the means over quarters of what counts.

    Examples
    --------
    >>> t = np.linspace(0.0, 20.0, 2001)
    >>> velocity, error = mean_velocity(t, 0.3 * t + np.sin(2 * np.pi * t), 0.5)
    >>> abs(velocity - 0.3) < 1e-3, error < 1e-2
    (True, True)
    """
    edges = np.linspace(settle * time[-1], time[-1], _BLOCKS + 1)
    parts = [_weighted(time, centre, *span) for span in pairwise(edges.tolist())]
    return _weighted(time, centre, edges[0], edges[-1]), float(np.std(parts, ddof=1)) / 2


def _weighted(time: np.ndarray, centre: np.ndarray, begin: float, end: float) -> float:
    part = (time >= begin) & (time <= end)
    t, x = time[part], centre[part]
    share = ((t[1:] + t[:-1]) / 2 - begin) / (end - begin)
    weight = np.exp(-1 / np.maximum(share * (1 - share), 1e-6)) * np.diff(t)
    return float(weight @ (np.diff(x) / np.diff(t)) / weight.sum())


def direction(course: RodCourse) -> int:
    """Tell where the rod goes.

    Parameters
    ----------
    course : RodCourse
        The motion.

    Returns
    -------
    int
        1 with the field, -1 against it, 0 where the mean velocity is within two errors of 0.
    """
    if abs(course.velocity) <= 2 * course.velocity_error:
        return 0
    return 1 if course.velocity > 0 else -1


def segment_length(case: RodCase, course: RodCourse) -> float:
    """Mean length of the rod from coil to coil of a block, just before the coils change.

    Parameters
    ----------
    case : RodCase
        With an even number of switches for which coils are on.
    course : RodCourse
        Its motion.

    Returns
    -------
    float
        In m; NaN where the rod never reached over a block.
    """
    found = []
    steps, n, pitch = course.steps, course.rod.count, case.coils.pitch
    count = round(case.pattern.duration)
    repeat = case.pattern.every * pitch
    switches = np.arange(round(steps.time[-1] * case.rate))
    late = switches[switches > case.course.settle * len(switches)]
    for k in late:
        look = np.searchsorted(steps.time, (k + 1) / case.rate * (1 - 1e-9)) - 1
        x, y = steps.states[:n, look], steps.states[n : 2 * n, look]
        first = (k - count + 1) * pitch
        first += repeat * round((x.mean() - first - (count - 1) * pitch / 2) / repeat)
        last = first + (count - 1) * pitch
        if x.min() < first and last < x.max() and count > 1:
            found.append(_length_between(x, y, first, last) / (count - 1))
    return float(np.mean(found)) if found else float("nan")


def _length_between(x: np.ndarray, y: np.ndarray, first: float, last: float) -> float:
    """Length of a polyline from the first place along the row to the last."""
    arc = np.append(0.0, np.cumsum(np.hypot(np.diff(x), np.diff(y))))
    inside = np.flatnonzero((x[:-1] - first) * (x[1:] - first) <= 0)
    beyond = np.flatnonzero((x[:-1] - last) * (x[1:] - last) <= 0)
    i, j = inside[0], beyond[-1]
    begin = np.interp(first, np.sort(x[i : i + 2]), np.sort(arc[i : i + 2]))
    end = np.interp(last, np.sort(x[j : j + 2]), np.sort(arc[j : j + 2]))
    return float(abs(end - begin))


def assumed_scalars(case: RodCase) -> dict[str, Scalar]:
    """Numbers that are assumptions, so that results show them.

    Parameters
    ----------
    case : RodCase
        Which has them.

    Returns
    -------
    dict of str to Scalar
    """
    found = {
        "density": (case.worm.density, "density"),
        "damping_time": (case.worm.damping_time, "time"),
        "susceptibility": (case.worm.susceptibility, "share"),
        "friction": (case.channel.friction, "share"),
        "coil_outer": (case.coils.outer, "length"),
        "ampere_turns": (case.coils.ampere_turns, "ampere_turns"),
    }
    return {
        f"assumed_{name}": Scalar(value, unit_of(unit, "SI"))
        for name, (value, unit) in found.items()
    }


def _energy_error(model: Model, steps: Steps, numbers: dict[str, float]) -> float:
    """Largest difference of the energy from what has been done on the rod."""
    energy = ca.Function(
        "energy",
        [pack(model.x), pack(model.p)],
        [model.output("strain_energy") + model.output("kinetic_energy")],
    )
    count = steps.states.shape[1]
    p = np.array([numbers[signal.name] for signal in model.p])
    stored = np.array(energy.map(count)(steps.states, np.tile(p[:, None], count))).ravel()
    done = sum(steps.work.values())
    scale = np.abs(np.diff(steps.work["load_power"])).sum()
    return float(np.abs(stored - stored[0] - done).max() / scale) if scale else 0.0


@lru_cache(maxsize=32)
def _block_field(
    coil: Coil, pitch: float, gap: float, half: float, on: int, every: int, tolerance: float
) -> BlockField:
    row = CoilRow(coil, 2, pitch, gap=gap, sides="alternating")
    return block_field(row, half, on, every, tolerance)


def _field(case: RodCase, count: int) -> BlockField:
    coils, channel = case.coils, case.channel
    return _block_field(
        Coil(coils.inner, coils.outer, coils.length),
        coils.pitch,
        channel.diameter + 2 * coils.clearance,
        _WIDER * (channel.diameter - case.worm.diameter) / 2,
        count,
        case.pattern.every,
        case.mesh.field_tolerance,
    )


def _marcher_of(case: RodCase, rod: Rod, fields: tuple[BlockField, ...]) -> Marcher:
    sizes = rod.length, rod.diameter, rod.poisson_ratio, rod.elements, rod.degree
    return _marcher(*sizes, case.channel.diameter, fields)


@lru_cache(maxsize=16)
def _marcher(
    length: float,
    diameter: float,
    poisson_ratio: float,
    elements: int,
    degree: int,
    channel: float,
    fields: tuple[BlockField, ...],
) -> Marcher:
    """Steps of a rod, whatever its material and friction: those are parameters."""
    rod = Rod(length, diameter, 1.0, 1.0, poisson_ratio=poisson_ratio, elements=elements,
              degree=degree)  # fmt: skip
    model = channel_rod(rod, channel, friction=1.0)
    return Marcher(model, integrals=_POWERS, inputs=block_load(rod, fields))
