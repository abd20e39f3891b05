"""Waves of coil currents along a worm, and its motion, by events and by time stepping."""

from __future__ import annotations

import math
from dataclasses import dataclass

import casadi as ca
import numpy as np

from wormopt.control.drive import drive
from wormopt.model.gait import Gait
from wormopt.model.model import Model
from wormopt.model.schedule import Schedule
from wormopt.model.values import signal_values
from wormopt.progress import Report, silent
from wormopt.simulation.moreau import MoreauJean
from wormopt.simulation.options import Tolerance
from wormopt.simulation.simulate import simulate
from wormopt.simulation.trajectory import Trajectory
from wormopt.systems.peristaltic.anchored import running_block
from wormopt.systems.peristaltic.chain import POWERS
from wormopt.systems.shared.models import drags_in_ode, measure_works


def switched_wave(segments: int, on: int, *, step: float, size: float, retrograde: bool) -> Gait:
    """Return a block of coils that are on, which moves by one segment after each step.

    In the first step the block is at the end from which it runs. Beyond the other end it starts
    again.

    Parameters
    ----------
    segments, on : int
        Number of segments, and of coils that are on at a time.
    step, size : float
        Duration of a step, s; input of a coil that is on.
    retrograde : bool
        Whether the wave runs from head to tail.

    Returns
    -------
    Gait
        Inputs over a cycle.

    Examples
    --------
    >>> switched_wave(3, 1, step=0.1, size=2.0, retrograde=True)(0.15).ravel()
    array([0., 2., 0.])
    """
    lit = running_block(segments, on)[:, :: 1 if retrograde else -1]
    return Gait(step * np.arange(segments + 1.0), size * lit[:, :, None].astype(float))


def harmonic_wave(
    segments: int, lag: float, *, period: float, size: float, retrograde: bool
) -> Gait:
    """Return inputs size (1 + cos(2 pi (t / period - lag j))) / 2 of segment j; -lag if direct.

    Parameters
    ----------
    segments : int
        Number of segments.
    lag : float
        Lag of a segment behind the one ahead of it, in periods.
    period, size : float
        Duration of a cycle, s; largest input.
    retrograde : bool
        Whether the wave runs from head to tail.

    Returns
    -------
    Gait
        Inputs over a cycle.

    Examples
    --------
    >>> harmonic_wave(2, 0.5, period=1.0, size=2.0, retrograde=True)(0.0).ravel()
    array([2., 0.])
    """
    phase = 2 * math.pi * lag * np.arange(segments) * (1 if retrograde else -1)
    return Gait(
        np.array([0.0, period]),
        np.full((1, segments, 1), size / 2),
        np.array([2 * math.pi / period]),
        size / 2 * np.cos(phase)[None],
        size / 2 * np.sin(phase)[None],
    )


def held(course: Gait, parts: int) -> Schedule:
    """Return a periodic gait as piecewise constant values, from the middles of equal parts.

    Each piece has `parts` parts. One part is exact if the gait is constant between its breaks.
    """
    counted = np.arange(parts * course.pieces + 1) / parts
    breaks = np.interp(counted, np.arange(course.pieces + 1), course.breaks)
    values = course((breaks[:-1] + breaks[1:]) / 2).T
    symbol = ca.SX.sym("course", course.links)
    return Schedule("course", symbol, ca.SX.sym("begin"), breaks, values, periodic=True)


# Number of steps of the second route within which a varying input is constant.
_HELD = 10
# Steps of the second route over the time constants of the fastest vibration and of the fastest
# decay; for the latter stability suffices.
_STEP, _STABLE = 0.05, 0.8
# Displacement in segment lengths that counts as none; differences are relative to at least this.
_AT_REST = 1e-9


def crawl(
    model: Model,
    course: Gait,
    cycles: int,
    *,
    nominal_work: float,
    samples: int = 160,
    relative: float = 1e-10,
    report: Report = silent,
) -> Trajectory:
    """Simulate a worm with exact contact through cycles of its inputs, and integrate all works.

    `samples`: samples per cycle; the last instant of one is the first of the next. Raises
    SolveError or Interrupted like `simulate`.
    """
    driven = drive(measure_works(model, nominal_work), course, periodic=True)
    end = cycles * course.period
    return simulate(
        driven,
        end,
        times=np.linspace(0.0, end, cycles * samples + 1),
        tolerance=Tolerance(relative, relative / 10),
        report=report,
    )


@dataclass(frozen=True)
class SecondRoute:
    """End by Moreau-Jean steps, compared with the end by events."""

    step: float  # the longer step; the shorter one is a quarter of it
    coarse: float  # largest difference of a position by the longer step, over the longest path
    fine: float  # error by the shorter step: a quarter, at first order


def second_route(
    model: Model,
    course: Gait,
    motion: Trajectory,
    step: float | None = None,
    report: Report = silent,
) -> SecondRoute:
    """Simulate the same worm with steps of one length, then of a quarter of it.

    Friction is solved for in each step, without events. Errors are of first order. `model` has
    inputs. Raises SolveError like `MoreauJean.march`.
    """
    inputs, rings = sum(s.size for s in model.u), model.places()[0].size
    u, q = ca.SX.sym("u", inputs), ca.SX.sym("q", rings)
    marcher = MoreauJean(drags_in_ode(model), inputs=ca.Function("inputs", [q, u], [u]))
    if step is None:
        vibration, decay = fastest(model, motion)
        step = min(_STEP / vibration, _STABLE / decay if decay else math.inf)
    start = signal_values(model.x, None, "state", fill=0.0)
    ways = np.abs(np.diff(motion["position"], axis=1)).sum(axis=1)
    way, errors = max(ways.max(), _AT_REST * float(motion["length"].mean())), []
    for size in (step, step / 4):
        parts = 1 if course.degree == 0 else math.ceil(course.period / (_HELD * size))
        schedule = held(course, parts)
        end = marcher.march(motion.end_time, start, schedule=schedule, step=size, report=report)
        errors.append(np.abs(end.states[:rings, -1] - motion.end[:rings]).max() / way)
    return SecondRoute(step, float(errors[0]), float(errors[1]))


def _sliding(model: Model) -> ca.SX:
    """Return the ode with all contacts sliding forward."""
    slides = [contact.law.slip_force(contact.velocity, 1) for contact in model.contacts]
    return ca.substitute(model.ode, model.forces, ca.vertcat(ca.SX(0, 1), *slides))


def fastest(model: Model, motion: Trajectory) -> tuple[float, float]:
    """Return the largest vibration frequency (rad/s) and decay rate about any sampled state."""
    rings = model.places()[0].size
    x, u = ca.vertcat(*(s.symbol for s in model.x)), model.u[0].symbol
    J = ca.jacobian(_sliding(model)[rings:], x)
    # no eigenvalue is larger
    bounds = [ca.mmax(ca.sum2(ca.fabs(ca.densify(part)))) for part in (J[:, :rings], J[:, rings:])]
    largest = ca.Function("largest", [x, u], [ca.vertcat(*bounds)])
    values = np.array(largest(motion.states[: 2 * rings], motion["input"])).max(axis=1)
    return math.sqrt(float(values[0])), float(values[1])


# -- results ---------------------------------------------------------------------------------------


def energy_error(motion: Trajectory) -> float:
    """Return the largest difference of works and energy gained, over the largest work."""
    works = [motion[f"{name}_work"][0] for name in POWERS]
    gained = stored(motion)
    gap = np.abs(sum(works) - (gained - gained[0])).max()
    return float(gap / max(np.abs(works).max(), math.ulp(0.0)))


def stored(motion: Trajectory) -> np.ndarray:
    """Return kinetic and elastic energy, and that of the tube's wall, over time."""
    names = ("kinetic", "elastic", "wall")
    return np.sum([motion[f"{name}_energy"][0] for name in names], axis=0)


@dataclass(frozen=True, eq=False)
class Anchors:
    """Segments that stay short through each step of a switched wave, by its pattern alone."""

    course: Gait
    samples: int  # of a cycle

    def held(self, cycles: int) -> np.ndarray:
        """Return these segments at each sample but the last; shape (segments, cycles samples)."""
        lit = self.course.polynomial[:, :, 0] > 0
        both = lit & np.roll(lit, 1, axis=0)
        return np.tile(np.repeat(both, self.samples // len(both), axis=0), (cycles, 1)).T

    def slip(self, motion: Trajectory, settle: int) -> float:
        """Return the mean displacement of these segments per cycle, in absolute value."""
        x, per_step = motion["position"], self.samples // self.course.pieces
        middles = ((x[:-1] + x[1:]) / 2)[:, settle * self.samples :: per_step]
        ways = np.abs(np.diff(middles, axis=1))
        cycles = ways.shape[1] // self.course.pieces
        which = self.held(cycles)[:, ::per_step]
        return float((ways * which).sum() / max(which[:, 0].sum(), 1) / cycles)

    def reserve(self, motion: Trajectory, settle: int) -> float:
        """Return the least unused share of their friction."""
        force = motion.observe(motion.system.model.forces)[:, settle * self.samples : -1]
        limits = [motion[f"limit_{way}"] for way in ("forward", "backward")]
        ahead, behind = (limit[:, settle * self.samples : -1] for limit in limits)
        which = self.held(force.shape[1] // self.samples)
        if len(force) > len(which):  # at rings: those of a segment's both ends
            none = np.zeros_like(which[:1])
            which = np.vstack([which, none]) | np.vstack([none, which])
        pushed = (force * which).sum(axis=0)
        limit = np.where(pushed < 0, (ahead * which).sum(axis=0), (behind * which).sum(axis=0))
        used = np.abs(pushed) / np.maximum(limit, math.ulp(0.0))
        return float(np.clip(1 - used.max(initial=0.0), 0.0, 1.0))
