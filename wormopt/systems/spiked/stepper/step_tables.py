"""Step commands as text: a CSV table for people and programs, a C table for a timer interrupt."""

from __future__ import annotations

import csv
from collections.abc import Iterable

import numpy as np

from wormopt.errors import ArgumentError
from wormopt.systems.spiked.stepper.steps import Steps

_LARGEST = 2**32 - 1


def csv_text(steps: Steps) -> str:
    """Table ``time_s,motor,direction`` under lines that begin with ``#`` and say what it needs.

    Motors are counted from 1, as links are. Numbers read back as they were.
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
            *(f"{time!r},{motor + 1},{direction}\n" for time, motor, direction in rows),
        ]
    )


def read_csv(text: str) -> Steps:
    """Read back what `csv_text` wrote; raises ArgumentError if it is no such table."""
    lines = text.splitlines()
    head = dict(line[1:].split(":", 1) for line in lines if line.startswith("#") and ":" in line)
    about = {name.strip(): value for name, value in head.items()}
    rows = list(csv.reader(line for line in lines if not line.startswith("#")))
    if not rows or rows[0] != ["time_s", "motor", "direction"]:
        raise ArgumentError("no table of steps: no line time_s,motor,direction")
    try:
        columns = list(zip(*rows[1:], strict=True)) or [(), (), ()]
        return Steps(
            float(about["period_s"]),
            float(about["travel_m"]),
            np.array([float(v) for v in about["length_at_start_m"].split(",")]),
            np.array([float(v) for v in columns[0]]),
            np.array([int(v) - 1 for v in columns[1]], dtype=int),
            np.array([int(v) for v in columns[2]], dtype=int),
        )
    except (KeyError, ValueError) as error:
        raise ArgumentError(f"no table of steps: {error}") from None


def in_ticks(steps: Steps, tick: float) -> tuple[int, list[np.ndarray]]:
    """Period and each motor's delays (its steps + 1,), start to end of the period, in ticks.

    Delays are differences of rounded instants: errors do not add up. Raises ArgumentError
    if two steps of a motor fall on one tick, or the period is too long for 32 bits.
    """
    whole = round(steps.period / tick)
    if whole > _LARGEST:
        least = steps.period / _LARGEST
        raise ArgumentError(
            f"a period of {steps.period:g} has more ticks than 32 bits hold; "
            f"write a tick of {least:.3g} or more"
        )
    delays = []
    for j in range(steps.links):
        instants = np.rint(steps.of_motor(j)[0] / tick).astype(np.int64)
        # the first step follows the last, a period later
        gaps = np.diff(instants, append=instants[:1] + whole)
        if np.any(gaps < 1):
            raise ArgumentError(
                f"two steps of motor {j + 1} fall on one tick; write a tick below "
                f"{steps.interval_min:.3g}, or a larger motor.hysteresis"
            )
        delays.append(np.diff(np.concatenate([[0], instants, [whole]])))
    return whole, delays


def c_text(steps: Steps, tick: float) -> str:
    """C99 source, a translation unit of its own, with delays and directions of every motor.

    `tick` is in s. Raises ArgumentError as `in_ticks`.
    """
    whole, delays = in_ticks(steps, tick)
    parts = [
        "/* Steps of one period, for a timer.\n"
        f" * tick: {tick!r} s; way per step: {steps.travel!r} m; period: {steps.period!r} s.\n"
        " * Lengths of the links at the start: "
        f"{', '.join(repr(float(v)) for v in steps.start)} m.\n"
        " * motor_j_delay[k]: ticks from step k - 1 of motor j to step k; the first counts from\n"
        " * the start of the period. motor_j_rest: ticks from its last step to the period's end,\n"
        " * where all begins again. motor_j_direction[k]: 1 lengthens link j by one step.\n"
        " */\n#include <stdint.h>\n\n"
        f"const uint32_t period_ticks = {whole}u;\n"
    ]
    for j, delay in enumerate(delays, start=1):
        direction = steps.of_motor(j - 1)[1]
        # C knows no arrays without entries: a motor that does not step has one that never counts
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
