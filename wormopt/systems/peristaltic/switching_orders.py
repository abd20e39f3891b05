"""Order of coil switching: all orders of a short worm, a search for longer worms.

An order is a cyclic sequence of events: number k < N switches coil k on, N + k switches it off, and
at number 2 N + k segment k touches the wall, if it does. Simultaneous events belong to several
orders. From the best times of an order with simultaneous events, the search continues with the
order in which these are exchanged.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from itertools import combinations, permutations

import numpy as np

from wormopt.errors import SolveError
from wormopt.progress import Report, silent
from wormopt.systems.peristaltic.switched import Limits, Objective, SwitchedWorm
from wormopt.systems.peristaltic.switching import (
    ANCHORED,
    OFF,
    ON,
    Switched,
    SwitchingProgram,
)

Ring = tuple[int, ...]
"""Numbers of the events in their order, 0 first."""
First = tuple[Ring, np.ndarray]
"""An order and the initial durations of its arcs."""

# Largest number of segments without a wall for which all orders are tried.
MOST_TRIED = 3
# Initial times of a long worm, the best of which are used: waves with coils on for these shares of
# a period, and this number of random ones.
_DUTIES, _RANDOM = (0.3, 0.5, 0.7), 200
# Initial period, in sums of both time constants; periods for worms that touch a wall.
_LONG, _LENGTHS = 3.0, (0.3, 1.0, 3.0, 10.0)
# Delay of simultaneous events in the order of their list, as a share of a period.
_APART = 1e-6
# Smallest relative gain that counts; share of the period below which an arc counts as empty.
_GAIN, _GONE = 1e-9, 1e-5


@dataclass(frozen=True, eq=False)
class Search:
    """The best order found."""

    best: Switched
    ring: Ring
    tried: int  # number of orders whose times were optimised
    complete: bool  # whether these were all


def search(
    worm: SwitchedWorm,
    objective: Objective,
    limits: Limits,
    *,
    starts: int = 8,
    seed: int = 0,
    report: Report = silent,
) -> Search:
    """Find the best order and times of switching, of a long worm from `starts` initial orders."""
    n = worm.segments
    touching = worm.ground.contact is not None
    program = SwitchingProgram(worm, 3 * n if touching else 2 * n, objective)
    complete = n <= MOST_TRIED and not touching
    if complete:
        even = np.full(2 * n, np.clip(_LONG * worm.time, *limits.period_range) / (2 * n))
        firsts = [(ring, even) for ring in all_rings(n)]
    else:
        noise = np.random.default_rng(seed)
        tried = _footsteps(worm, limits, noise) if touching else _waves(worm, limits, noise)
        firsts = _promising(program, n, tried, limits, starts)
    found: dict[Ring, Switched | None] = {}
    for k, (ring, first) in enumerate(firsts):
        report("orders of switching", k / len(firsts))
        _climb(program, n, ring, first, limits, found)
    reached = {
        ring: best for ring, best in found.items() if best is not None and best.displacement > 0
    }
    if not reached:
        raise _nowhere(worm, objective.speed, limits, starts, seed)
    ring = max(reached, key=lambda ring: reached[ring].worth)
    return Search(reached[ring], ring, len(found), complete)


def _nowhere(
    worm: SwitchedWorm, speed: float | None, limits: Limits, starts: int, seed: int
) -> SolveError:
    """Return why no order was found, and the highest speed of the worm."""
    if speed is None:
        return SolveError(
            "no order of switching moves forward within the limits",
            "write a longer limits.period, a larger limits.duty or limits.together, or a smaller "
            "limits.dwell",
            code="infeasible",
        )
    free = search(worm, Objective(maximise="speed"), limits, starts=starts, seed=seed)
    return SolveError(
        f"no switching within the limits has a mean speed of {speed:g}",
        f"write a lower objective.speed; the fastest switching has {free.best.worth:.6g}",
        code="infeasible",
    )


def _climb(
    program: SwitchingProgram,
    segments: int,
    ring: Ring,
    first: np.ndarray,
    limits: Limits,
    found: dict[Ring, Switched | None],
) -> None:
    """Solve an order, and continue with its neighbours while the objective improves."""
    worth = -np.inf
    while ring not in found:
        best = found[ring] = program.best(states_of(ring, segments), first, limits)
        if best is None or best.worth <= worth + _GAIN * abs(worth):
            return
        worth = best.worth
        for arc in np.flatnonzero(best.durations <= _GONE * best.period):
            other, durations = exchanged(ring, best.durations, int(arc))
            if other in found or _same_coil(ring, int(arc), segments):
                continue
            between = other.index(ring[(arc + 1) % len(ring)])
            if program.allowed(states_of(other, segments), limits)[between]:
                ring, first = other, durations
                break


def all_rings(segments: int) -> Iterator[Ring]:
    """Yield all orders, (2 N - 1)! of them."""
    return ((0, *rest) for rest in permutations(range(1, 2 * segments)))


def states_of(ring: Ring, segments: int) -> np.ndarray:
    """Return states of all segments (events, N) on the arcs that begin with each event."""
    after = (ON, OFF, ANCHORED)
    state = np.zeros(segments, dtype=int)
    states = []
    for event in ring + ring:  # the state before the first event is known after one cycle
        state[event % segments] = after[event // segments]
        states.append(state.copy())
    return np.array(states[len(ring) :])


def exchanged(ring: Ring, durations: np.ndarray, arc: int) -> tuple[Ring, np.ndarray]:
    """Return the order with the switches at both ends of an arc exchanged, and its durations."""
    switches, after = list(ring), (arc + 1) % len(ring)
    switches[arc], switches[after] = switches[after], switches[arc]
    first = switches.index(0)
    return (*switches[first:], *switches[:first]), np.roll(durations, -first)


def _same_coil(ring: Ring, arc: int, segments: int) -> bool:
    """Return whether both events of an arc are of one coil, which cannot be exchanged."""
    return ring[arc] % segments == ring[(arc + 1) % len(ring)] % segments


def _promising(
    program: SwitchingProgram,
    segments: int,
    tried: Iterable[First],
    limits: Limits,
    starts: int,
) -> list[First]:
    """Return the most promising initial orders, each with its best durations."""
    promises: dict[Ring, tuple[float, np.ndarray]] = {}
    for ring, durations in tried:
        promise = program.promise(states_of(ring, segments), durations, limits)
        if ring not in promises or promise > promises[ring][0]:
            promises[ring] = promise, durations
    ranked = sorted(promises, key=lambda ring: -promises[ring][0])
    return [(ring, promises[ring][1]) for ring in ranked[:starts]]


def _waves(worm: SwitchedWorm, limits: Limits, noise: np.random.Generator) -> Iterator[First]:
    """Yield waves of all lengths, and random times."""
    n, period = worm.segments, float(np.clip(_LONG * worm.time, *limits.period_range))
    half_steps = np.arange(1, 2 * n) / (2 * n)  # turns from coil to coil, either way
    on = [np.arange(n) * step for step in half_steps for _ in _DUTIES]
    off = [phases + duty for phases, duty in zip(on, _DUTIES * len(half_steps), strict=True)]
    for turns in [*np.hstack([on, off]), *noise.random((_RANDOM, 2 * n))]:
        yield _ordered(np.arange(2 * n), turns, period)


def _ordered(events: np.ndarray, turns: np.ndarray, period: float) -> First:
    """Return order and durations of events at phases; simultaneous ones stay in list order."""
    at = np.mod(turns - turns[0] + _APART * np.arange(len(turns)), 1.0)
    places = np.argsort(at)
    return tuple(events[places].tolist()), period * np.diff(at[places], append=1.0)


def _footsteps(worm: SwitchedWorm, limits: Limits, noise: np.random.Generator) -> Iterator[First]:
    """Yield sequences of anchored segments, in any order, with equal durations."""
    n = worm.segments
    drawn = [
        tuple(noise.permutation(n)[:count].tolist())
        for count in noise.integers(2, n, _RANDOM, endpoint=True)
    ]
    for steps in [*combinations(range(n), 2), tuple(range(n)), *drawn]:
        for length in _LENGTHS:
            period = float(np.clip(length * worm.time, *limits.period_range))
            yield _walk(worm, steps, period, noise)


def _walk(
    worm: SwitchedWorm, steps: tuple[int, ...], period: float, noise: np.random.Generator
) -> First:
    """Return initial times in which the segments of `steps` are anchored in turn."""
    # Each other segment goes on when the worm steps forward over it and off when it steps back over
    # it. It is off long enough that it does not touch.
    n, count = worm.segments, len(steps)
    passed = np.zeros((n, count))  # 1 if step k goes forward over a segment, -1 if back
    for k, (before, after) in enumerate(zip(np.roll(steps, 1), steps, strict=True)):
        passed[min(before, after) + 1 : max(before, after), k] = np.sign(before - after)
    favour = passed + 0.5 * noise.random(passed.shape)
    on, off = favour.argmax(axis=1) / count, favour.argmin(axis=1) / count
    off -= noise.choice([0.0, 0.5], n) * np.mod(off - on, 1.0)
    least, flight = (_time_off(worm, time) / period for time in (period, period * (1 - 1 / count)))
    on = off + np.maximum(np.mod(on - off, 1.0), least)
    holding = np.array(steps)
    touch = np.arange(count) / count
    off[holding] = touch + 1 / count
    on[holding] = off[holding] + flight
    events = np.concatenate([np.arange(2 * n), 2 * n + holding])
    # the next one touches before the last one goes off
    return _ordered(events, np.concatenate([on, off, touch - 3 * n * _APART]), period)


def _time_off(worm: SwitchedWorm, flight: float) -> float:
    """Return the coil-off time of a segment that touches the wall again after a time of flight."""
    contact = worm.ground.contact
    assert contact is not None
    times = worm.tau_off * np.geomspace(1e-4, 20, 400)
    top = worm.length_off - (worm.length_off - contact) * np.exp(-times / worm.tau_off)
    falls = worm.time_on * np.log((top - worm.length_on) / (contact - worm.length_on))
    return float(np.interp(flight, times + falls, times))
