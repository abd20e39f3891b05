"""Step times of motors whose links follow a gait, by exact inversion of lengths.

Also step commands as text: a CSV table for people and programs, and C source for a timer interrupt.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from itertools import pairwise
from typing import Any, Literal

import numpy as np

from wormopt.errors import ArgumentError
from wormopt.model.gait import Gait
from wormopt.numerics.chebyshev import resolve
from wormopt.systems.spiked.stepper.stepper import Stepper, demand
from wormopt.systems.spiked.stretches import exact_degree
from wormopt.tables import Wrong, parse_table

# Share of a microstep by which a level must be passed, so that a length that only touches it causes
# no step to and fro.
_TOUCH = 1e-9
_MOST = 2_000_000
_LARGEST = 2**32 - 1


@dataclass(frozen=True, eq=False)
class Steps:
    """Steps of all motors over one period, in order of time.

    Raises ArgumentError if arrays do not fit together or a motor does not return.
    """

    period: float
    travel: float  # change of length per (micro)step
    start: np.ndarray  # (n,) link lengths at time 0, where counts are 0
    time: np.ndarray  # (m,) from 0 to the period, ascending
    motor: np.ndarray  # (m,) int, index of the motor and its link
    direction: np.ndarray  # (m,) int: +1 lengthens by one travel, -1 shortens

    def __post_init__(self) -> None:
        shapes = {self.time.shape, self.motor.shape, self.direction.shape}
        if len(shapes) > 1 or self.time.ndim != 1:
            raise ArgumentError(
                "time, motor and direction differ in shape; give one entry per step"
            )
        if np.any(np.diff(self.time) < 0):
            raise ArgumentError("times do not increase; sort the steps by time")
        if self.time.size and not 0 <= self.time[0] <= self.time[-1] <= self.period:
            raise ArgumentError("times must be from 0 to the period")
        if np.any(np.abs(self.direction) != 1):
            raise ArgumentError("directions must be 1 or -1")
        if np.any((self.motor < 0) | (self.motor >= self.links)):
            raise ArgumentError(f"motors must be 0 to {self.links - 1}")
        left = np.bincount(self.motor, self.direction, self.links)
        if np.any(left != 0):
            raise ArgumentError(
                f"motor {int(np.flatnonzero(left)[0])} does not return within the period"
            )

    @property
    def links(self) -> int:
        """Number of links."""
        return len(self.start)

    @property
    def counts(self) -> np.ndarray:
        """Steps of each motor over the period, both directions, shape (n,)."""
        return np.bincount(self.motor, minlength=self.links)

    def of_motor(self, motor: int) -> tuple[np.ndarray, np.ndarray]:
        """Times and directions of the steps of one motor, counted from 0."""
        own = self.motor == motor
        return self.time[own], self.direction[own]

    def lengths(self, t: np.ndarray) -> np.ndarray:
        """Commanded lengths (n, m) at times (m,) in the period; at a step the new length."""
        rows = [self.taken(j, t) for j in range(self.links)]
        return self.start[:, None] + self.travel * np.array(rows)

    def taken(self, motor: int, t: np.ndarray, side: Literal["left", "right"] = "right") -> Any:
        """Net steps of a motor until times (m,); `side` selects the value at a step itself."""
        time, direction = self.of_motor(motor)
        count = np.concatenate([[0], np.cumsum(direction)])
        return count[np.searchsorted(time, t, side=side)]

    @property
    def intervals_min(self) -> np.ndarray:
        """Shortest time between two steps of each motor, shape (n,), infinite without steps."""
        times = [self.of_motor(j)[0] for j in range(self.links)]
        after = [np.diff(time, append=time[:1] + self.period) for time in times]
        return np.array([intervals.min(initial=np.inf) for intervals in after])

    @property
    def interval_min(self) -> float:
        """Shortest time between two steps of one motor; infinite without steps."""
        return float(self.intervals_min.min())


def step_times(gait: Gait, stepper: Stepper) -> Steps:
    """Find the times at which motors step so that lengths follow a gait.

    A motor steps when its length passes the middle between two positions by the hysteresis. The
    error of the commanded length is at most 1/2 + hysteresis microsteps. Positions are counted
    from the length at time 0, so strokes of whole microsteps end on a position.

    Parameters
    ----------
    gait : Gait
        Lengths of the links, m and s.
    stepper : Stepper
        The motor.

    Returns
    -------
    Steps
        Times accurate to rounding; motors return to their start at the end of the period.

    Raises
    ------
    ArgumentError
        If a length jumps, or if there are more than two million steps.
    SolveError
        If the gait is too fast for the motor; the message gives the smallest period.

    Examples
    --------
    >>> import numpy as np
    >>> gait = Gait(np.array([0.0, 2.0, 4.0]), np.array([[[1.0, 1.0]], [[3.0, -1.0]]]))
    >>> motor = Stepper(lead=1.0, steps_per_turn=1, hysteresis=0.0)
    >>> steps = step_times(gait, motor)
    >>> steps.time, steps.direction
    (array([0.5, 1.5, 2.5, 3.5]), array([ 1,  1, -1, -1]))
    """
    demand(gait, stepper).refuse(stepper)
    start = gait(np.zeros(1))[:, 0]
    found = [_steps_of_link(gait, stepper, j, float(start[j])) for j in range(gait.links)]
    time, direction = map(np.concatenate, zip(*found, strict=True))
    motor = np.repeat(np.arange(gait.links), [len(times) for times, _ in found])
    order = np.lexsort((motor, time))
    return Steps(
        gait.period, stepper.travel, start, time[order], motor[order], direction[order].astype(int)
    )


def turning_times(gait: Gait, link: int) -> np.ndarray:
    """Breaks of the gait and times at which a length reverses; it is monotone between them."""
    # Ascending, from 0 to the period; links are counted from 0.
    return np.unique([gait.breaks[q] + s for q, *ends in _runs(gait, link) for s in ends])


def quantisation_error(gait: Gait, steps: Steps) -> np.ndarray:
    """Largest difference (n,) between commanded length and gait, over all time."""
    # Both are monotone between steps and turning points, so it is largest next to one of them.
    worst = []
    for j in range(gait.links):
        edges = np.concatenate([steps.of_motor(j)[0], turning_times(gait, j)])
        ideal = _length(gait, j, edges) - steps.start[j]
        sides = steps.taken(j, edges, "left"), steps.taken(j, edges)
        worst.append(max(float(np.abs(ideal - steps.travel * held).max()) for held in sides))
    return np.array(worst)


def _length(gait: Gait, link: int, t: np.ndarray) -> np.ndarray:
    # a gait that closes only up to rounding has different lengths at start and end of the period
    last = t >= gait.period
    values = gait(t)[link]
    if np.any(last):
        width = float(gait.breaks[-1] - gait.breaks[-2])
        values[last] = gait.on_piece(gait.pieces - 1, np.array([width]))[link, 0]
    return values


def _runs(gait: Gait, link: int) -> Iterator[tuple[int, float, float]]:
    """Intervals (piece, from, to) on which a length is monotone."""
    for piece in range(gait.pieces):
        width = float(gait.breaks[piece + 1] - gait.breaks[piece])
        rate = resolve(
            lambda s, piece=piece: gait.on_piece(piece, s, 1)[link : link + 1],
            0.0,
            width,
            exact_degree(gait),
        )
        edges = np.unique(np.concatenate([[0.0], rate.roots(0), [width]]))
        for a, b in pairwise(edges):
            yield piece, float(a), float(b)


def _steps_of_link(
    gait: Gait, stepper: Stepper, link: int, start: float
) -> tuple[np.ndarray, np.ndarray]:
    """Times and directions of one motor's steps."""
    travel, margin = stepper.travel, 0.5 + stepper.hysteresis
    times, directions, count, total = [np.zeros(0)], [np.zeros(0)], 0, 0
    for piece, a, b in _runs(gait, link):
        place = (gait.on_piece(piece, np.array([b]))[link, 0] - start) / travel
        up = int(max(0, np.ceil(place - _TOUCH - (count + margin))))
        down = int(max(0, np.ceil((count - margin) - place - _TOUCH)))
        number, sign = (up, 1) if up else (down, -1)
        if not number:
            continue
        total += number
        if total > _MOST:
            raise ArgumentError(f"more than {_MOST} steps per period; decrease microsteps")
        levels = start + travel * (count + sign * (margin + np.arange(number)))
        times.append(gait.breaks[piece] + _instants(gait, piece, link, (a, b), levels))
        directions.append(np.full(number, sign))
        count += sign * number
    # rounding at a break may put a step just before the last one of the previous piece
    return np.maximum.accumulate(np.concatenate(times)), np.concatenate(directions)


def _instants(
    gait: Gait, piece: int, link: int, span: tuple[float, float], levels: np.ndarray
) -> np.ndarray:
    """Times at which a monotone length passes many levels: Newton's method within brackets."""
    low, high = np.full(len(levels), span[0]), np.full(len(levels), span[1])
    rising = levels[-1] > levels[0] or bool(
        np.diff(gait.on_piece(piece, np.array(span))[link])[0] > 0
    )
    s, last = (low + high) / 2, high - low
    for _ in range(200):
        gap = gait.on_piece(piece, s)[link] - levels
        before = (gap < 0) == rising
        low, high = np.where(before, s, low), np.where(before, high, s)
        slope = gait.on_piece(piece, s, 1)[link]
        with np.errstate(divide="ignore", invalid="ignore"):
            newton = s - gap / slope
        # Newton if it stays inside and at least halves the previous step, else bisection
        good = (newton >= low) & (newton <= high) & (np.abs(newton - s) <= last / 2)
        new = np.where(good, newton, (low + high) / 2)
        last, s = np.abs(new - s), new
        if np.all(last <= 2 * np.spacing(span[1])):
            break
    return s


def csv_text(steps: Steps) -> str:
    """Write steps as a table ``time_s,motor,direction`` below lines with ``#`` for parameters.

    Motors are counted from 0, as links are. Numbers are read back exactly.
    """
    head = {
        "period_s": repr(float(steps.period)),
        "travel_m": repr(float(steps.travel)),
        "length_at_start_m": ",".join(repr(float(v)) for v in steps.start),
        "step_count": ",".join(str(v) for v in steps.counts),
    }
    rows = zip(steps.time.tolist(), steps.motor.tolist(), steps.direction.tolist(), strict=True)
    return "".join(
        [
            *(f"# {name}: {value}\n" for name, value in head.items()),
            "time_s,motor,direction\n",
            *(f"{time!r},{motor},{direction}\n" for time, motor, direction in rows),
        ]
    )


def read_csv(text: str) -> Steps:
    """Read the text of `csv_text`."""
    wrong = list[Wrong]()
    table = parse_table(text, wrong, time="time_s")
    assert table is not None
    assert not wrong
    about = dict(remark.split(":", 1) for remark in table.remarks if ":" in remark)
    time, motor, direction = (np.array(column) for column in table.values.values())
    start = np.array([float(v) for v in about["length_at_start_m"].split(",")])
    period, travel = float(about["period_s"]), float(about["travel_m"])
    return Steps(period, travel, start, time, motor.astype(int), direction.astype(int))


def in_ticks(steps: Steps, tick: float) -> tuple[int, list[np.ndarray]]:
    """Convert to ticks: the period, and each motor's delays (its steps + 1,) over the period."""
    # Delays are differences of rounded times, so errors do not add up.
    whole = round(steps.period / tick)
    if whole > _LARGEST:
        least = steps.period / _LARGEST
        raise ArgumentError(
            f"a period of {steps.period:g} has more ticks than 32 bits hold; "
            f"write a tick of at least {least:.3g}"
        )
    delays = []
    for j in range(steps.links):
        instants = np.rint(steps.of_motor(j)[0] / tick).astype(np.int64)
        # the first step follows the last, a period later
        gaps = np.diff(instants, append=instants[:1] + whole)
        if np.any(gaps < 1):
            raise ArgumentError(
                f"two steps of motor {j} are on one tick; write a tick below "
                f"{steps.interval_min:.3g}, or a larger motor.hysteresis"
            )
        delays.append(np.diff(np.concatenate([[0], instants, [whole]])))
    return whole, delays


def c_text(steps: Steps, tick: float) -> str:
    """Write steps as C99 source, one translation unit with delays and directions of every motor."""
    whole, delays = in_ticks(steps, tick)
    parts = [
        "/* Steps of one period, for a timer.\n"
        f" * tick: {tick!r} s; travel per step: {steps.travel!r} m; period: {steps.period!r} s.\n"
        " * Lengths of the links at the start: "
        f"{', '.join(repr(float(v)) for v in steps.start)} m.\n"
        " * motor_j_delay[k]: ticks from step k - 1 of motor j to step k; the first counts from\n"
        " * the start of the period. motor_j_rest: ticks from its last step to the end of the\n"
        " * period; then it repeats. motor_j_direction[k]: 1 lengthens link j by one step.\n"
        " */\n#include <stdint.h>\n\n"
        f"const uint32_t period_ticks = {whole}u;\n"
    ]
    for j, delay in enumerate(delays):
        direction = steps.of_motor(j)[1]
        # C has no empty arrays: a motor without steps gets one entry that is never used
        size = max(len(direction), 1)
        name = f"motor_{j}"
        parts.append(
            f"\nconst uint32_t {name}_count = {len(direction)}u;\n"
            f"const uint32_t {name}_rest = {delay[-1]}u;\n"
            f"const uint32_t {name}_delay[{size}] = {{\n{_list(delay[:-1])}\n}};\n"
            f"const int8_t {name}_direction[{size}] = {{\n{_list(direction)}\n}};\n"
        )
    return "".join(parts)


def _list(values: Iterable[int]) -> str:
    words = [str(v) for v in values] or ["0"]
    rows = [", ".join(words[k : k + 12]) for k in range(0, len(words), 12)]
    return "    " + ",\n    ".join(rows)
