"""Motions of the stress matrix: `simulate` compared with routes of other code.

When is a run right? `simulate` is asked for steps that err by 1e-11 of the state. The second route
tells what that means for the motion: it follows it as exactly as it can, and once more from a start
that is off by 1e-11, with steps that err as much. How far these two are apart is how far any
computation of that precision may be off (chaos included). A run is right if at every sample time,
for every kind of state, it is within

    1e-8 (largest size of that kind of state) + 10 (largest distance of the two so far).

Once that is more than a thousandth of the size nothing can be known; the comparison ends there. If
that leaves less than a tenth of the time, or if the second route fails, the cell is undecided, and
that is not right. A refusal is a SolveError with a code. All else is wrong.

The second route depends on the cell: the closed form between events for chains that gaits command
(exact contact), solve_ivp with terminal events for trackers (exact contact), CVODES for smooth
contact, logarithms of speeds in a slowed time for dry friction in the plane.
Where the closed form gives up solve_ivp takes its place, and where CVODES does LSODA.
Where `simulate` has used an implicit integrator itself, and where references jump, it is
LSODA with an analytic Jacobian.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from time import process_time
from typing import Any

import numpy as np

from tests.oracles.driven_chain import Plant, linear_flow
from tests.oracles.integrators import Regularised, by_casadi, by_lsoda, called, event_loop
from tests.stress.chain_cells import Cell, cells
from tests.stress.planar_cells import PlanarCell
from tests.stress.verdict import Class, Verdict
from wormopt.errors import SolveError
from wormopt.model.model import Model
from wormopt.simulation.options import Tolerance
from wormopt.simulation.simulate import simulate

_BASE, _FACTOR, _UNKNOWN = 1e-8, 10.0, 1e-3
_SAMPLES = 40
_LONGEST = 60.0  # seconds of a processor after which simulate is stopped
_TOLERANCE = Tolerance(1e-11, 1e-12, max_steps=2_000_000)
# Tolerances of the second route, and the size of the errors put in.
_TIGHT, _LOOSE, _OFF = 1e-13, 1e-11, 1e-11

Follow = Callable[[np.ndarray, float], np.ndarray]


class _TooLong(Exception):
    pass


@dataclass(frozen=True, eq=False)
class Motion:
    """A case of the matrix: the motion of a cell."""

    cell: Cell | PlanarCell

    @property
    def name(self) -> str:
        """The cell's."""
        return self.cell.name

    @property
    def group(self) -> str:
        """Part of the matrix it belongs to."""
        return self.cell.group

    @property
    def span(self) -> float:
        """Over how long it is followed."""
        return self.cell.span

    def judge(self) -> Verdict:
        """Run the cell by both routes and compare."""
        return judge(self.cell)


def cases(*, quick: bool) -> list[Motion]:
    """Chains and trackers; `quick`: only some of each group, none that takes long."""
    return [Motion(cell) for cell in cells(quick=quick)]


def judge(cell: Cell | PlanarCell) -> Verdict:
    """Run a cell by both routes and compare."""
    dice = np.random.default_rng(len(cell.name))
    times = np.append(np.sort(dice.uniform(0.02, 0.99, _SAMPLES - 1)), 1.0) * cell.span
    begin = process_time()

    def hurry(_text: str, _fraction: float | None) -> None:
        if process_time() - begin > _LONGEST:
            raise _TooLong

    def verdict(kind: Class, reason: str = "", known: float = 1.0, off: float = 0.0) -> Verdict:
        return Verdict(cell.name, cell.group, cell.core, kind, reason, known, off)

    try:
        model = cell.model()
        motion = simulate(
            model, cell.span, contact=cell.contact, times=times, tolerance=_TOLERANCE, report=hurry
        )
    except SolveError as error:
        if not error.code or not error.suggestion or error.partial is None:
            missing = "code, suggestion or partial motion"
            return verdict("wrong", f"refused without {missing}: {error}")
        return verdict("refused", f"{error.code}: {error.suggestion}")
    except _TooLong:
        return verdict("undecided", "simulate takes too long")
    except Exception as error:
        return verdict("wrong", f"{type(error).__name__}: {error}")
    try:
        implicit = motion.route in ("cvodes", "idas", "radau")
        tight, loose = second_route(cell, model, times, implicit=implicit)
    except Exception as error:
        reason = f"second route: {type(error).__name__}: {' '.join(str(error).split())[:200]}"
        return verdict("undecided", reason)
    known, off, where = _compare(model, motion.states, tight, loose)
    if not off <= 1.0:
        return verdict("wrong", f"{where}: off by {off:.3g} times what is allowed", known, off)
    if known < 0.1:
        reason = "what happens cannot be known in double precision"
        return verdict("undecided", reason, known, off)
    return verdict("right", "", known, off)


def _compare(
    model: Model, states: np.ndarray, tight: np.ndarray, loose: np.ndarray
) -> tuple[float, float, str]:
    """Share of the time known; distance over what is allowed in its worst case, and which it is."""
    known = samples = tight.shape[1]
    shares, at = {}, 0
    for signal in model.x:
        row, at = slice(at, at + signal.size), at + signal.size
        size = max(float(np.abs(tight[row]).max()), 1e-3)
        apart = np.maximum.accumulate(np.abs(loose[row] - tight[row]).max(axis=0))
        allowed = _BASE * size + _FACTOR * apart
        unknown = ~(allowed <= _UNKNOWN * size)
        known = min(known, int(np.argmax(unknown)) if unknown.any() else samples)
        shares[signal.name] = np.abs(states[row] - tight[row]).max(axis=0) / allowed
    worst, where = 0.0, ""
    for name, share in shares.items():
        for k in range(known):
            if not share[k] <= worst:  # NaN included
                worst, where = float(share[k]), f"{name} at sample {k}"
    return known / samples, worst, where


# -- the second route ----------------------------------------------------------------------------


def second_route(
    cell: Cell | PlanarCell, model: Model, times: np.ndarray, *, implicit: bool
) -> tuple[np.ndarray, np.ndarray]:
    """Follow a cell's motion without `simulate`, tight and loose: states (n_x, m).

    The loose motion starts off by 1e-11 of each state's size; steps that err do by 1e-11.
    `implicit`: the first route was, so this must not be. Raises whatever the means raise.
    """
    start, follow = _means(cell, model, times, implicit)
    dice = np.random.default_rng(0)
    off = _OFF * np.maximum(np.abs(start), 1.0) * dice.choice([-1.0, 1.0], len(start))
    if isinstance(cell, PlanarCell):
        off[cell.resting] = 0.0
    elif cell.v_reg is None:
        masses = cell.worm.links + 1
        off[masses : 2 * masses] = 0.0  # what rests shall go on resting
    return follow(start, _TIGHT), follow(start + off, _LOOSE)


def _means(
    cell: Cell | PlanarCell, model: Model, times: np.ndarray, implicit: bool
) -> tuple[np.ndarray, Follow]:
    """The start, and what follows the motion from a start to a tolerance."""
    if isinstance(cell, PlanarCell):
        return cell.start, cell.follow(times)
    worm, span = cell.worm, cell.span
    if cell.v_reg is None and cell.tracker is None:

        def flow(start: np.ndarray, tolerance: float) -> np.ndarray:
            reach = 1.0 if tolerance == _TIGHT else 0.7
            return linear_flow(worm, span, times, start=start, reach=reach).states

        def events(start: np.ndarray, tolerance: float) -> np.ndarray:
            asked: Any = {"start": start, "relative": tolerance, "max_step": 0.02}
            return event_loop(worm.plant(), span, times, **asked).states

        return worm.start, _either(flow, events)
    if cell.v_reg is None:
        plant = _plant(cell, model)

        def loop(start: np.ndarray, tolerance: float) -> np.ndarray:
            asked: Any = {"start": start, "relative": tolerance, "max_step": 0.005}
            return event_loop(plant, span, times, **asked).states

        return plant.start, loop
    smoothed = Regularised(model, cell.v_reg)

    def lsoda(start: np.ndarray, tolerance: float) -> np.ndarray:
        return by_lsoda(smoothed, times, start, tolerance)

    if implicit or cell.group == "jumps":  # CasADi goes on over jumps without a new start
        return smoothed.start, lsoda

    def cvodes(start: np.ndarray, tolerance: float) -> np.ndarray:
        return by_casadi(smoothed, "cvodes", times, tolerance, max_num_steps=2_000_000)(start)

    return smoothed.start, _either(cvodes, lsoda)


def _either(usual: Follow, other: Follow) -> Follow:
    """Follow by what is usual; where that gives up, by other means."""

    def follow(start: np.ndarray, tolerance: float) -> np.ndarray:
        try:
            return usual(start, tolerance)
        except RuntimeError:
            return other(start, tolerance)

    return follow


def _plant(cell: Cell, model: Model) -> Plant:
    """Closed loop of a tracker with the contact forces left open."""
    free = Regularised(model, None)
    call, pieces = called(free.function), list(free.pieces(cell.span))
    starts = np.array([piece.start for piece in pieces])
    masses = cell.worm.links + 1

    def rates(t: float, y: np.ndarray, force: np.ndarray) -> np.ndarray:
        piece = pieces[max(int(starts.searchsorted(t, side="right")) - 1, 0)]
        return call(t, y, np.concatenate([piece.values, force]))

    velocity = np.arange(masses, 2 * masses)
    return Plant(rates, free.start, velocity, cell.worm.mass, cell.worm.grips, lambda _: starts[1:])
