"""Arduino: a sketch that plays a gait on servos, with its C source in single precision."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from wormopt.errors import ArgumentError
from wormopt.exports.c_source import SINGLE, comment, library
from wormopt.exports.common import ExportedGait, identifier

_MICROSECOND = 1e-6
_LONGEST = 2**31  # microseconds, so that a sum of two times fits into 32 bits
_SAMPLES = 257  # of each piece, for the range of the lengths
_FLASH = 32_256  # bytes for programs on an Uno


def make(exported: ExportedGait, stem: str) -> dict[str, bytes]:
    """``NAME/NAME.ino``, ``NAME/NAME.h`` and ``NAME/NAME.c``; a sketch needs its own folder."""
    name = identifier(stem)
    gait = exported.gait
    cycle = round(gait.period / _MICROSECOND)
    if not 1 <= cycle < _LONGEST:
        raise ArgumentError(
            f"a cycle lasts {gait.period:g} s, but the clock of a sketch counts microseconds in 32 "
            f"bits; use {_MICROSECOND:g} to {_LONGEST * _MICROSECOND:.0f} s"
        )
    largest = max(float(np.abs(array).max()) for array in gait.arrays().values())
    if largest > float(np.finfo(np.float32).max):
        raise ArgumentError(f"{largest:g} is too large for 32-bit numbers; choose larger units")
    files = library(exported, name, SINGLE)
    files[f"{name}.ino"] = _sketch(exported, name, cycle).encode()
    return {f"{name}/{file}": content for file, content in files.items()}


def _sketch(exported: ExportedGait, name: str, cycle: int) -> str:
    gait = exported.gait
    share = np.linspace(0.0, 1.0, _SAMPLES)
    lengths = np.hstack(
        [gait.on_piece(k, share * length) for k, length in enumerate(np.diff(gait.breaks))]
    )
    size = 4 * sum(array.size for array in gait.arrays().values())
    room = "" if size < _FLASH else ", more than an Uno has"
    note = "The scene has no units: its unit of time is taken as 1 s."
    head = comment(
        [
            "Plays a gait on servos, one for each link, again and again.",
            *exported.remarks,
            *([note] if exported.time_unit != "s" else []),
            f"The tables have {size} bytes{room}.",
        ]
    )
    unit = "" if exported.length_unit == "1" else f", in {exported.length_unit}"
    return f"""{head}
#include <Servo.h>

#include "{name}.h"

/* Edit these: the pin of each servo, and the pulses in microseconds at which its link has the
 * shortest and the longest length of the gait. Measure them on the robot. */
static const int pin[{name}_links] = {{{_list(range(2, 2 + gait.links))}}};
static const int pulse_shortest[{name}_links] = {{{_list([1000] * gait.links)}}};
static const int pulse_longest[{name}_links] = {{{_list([2000] * gait.links)}}};

/* Lengths of the gait{unit}. */
static const float shortest[{name}_links] = {{{_list(lengths.min(axis=1))}}};
static const float longest[{name}_links] = {{{_list(lengths.max(axis=1))}}};

static const uint32_t cycle = {cycle}UL; /* microseconds */
static const uint32_t step = 20000UL;    /* a servo gets a pulse every 20 ms */

static Servo servo[{name}_links];
static uint32_t before, phase;

static void show()
{{
    float length[{name}_links];
    {name}_length(1e-6f * (float)phase, length, NULL, NULL);
    for (int j = 0; j < {name}_links; ++j) {{
        const float range = longest[j] - shortest[j];
        const float share = range > 0.0f ? (length[j] - shortest[j]) / range : 0.0f;
        const float pulse = pulse_shortest[j] + share * (pulse_longest[j] - pulse_shortest[j]);
        servo[j].writeMicroseconds((int)(pulse + 0.5f));
    }}
}}

void setup()
{{
    for (int j = 0; j < {name}_links; ++j)
        servo[j].attach(pin[j]);
    before = micros();
    phase = 0;
    show();
}}

void loop()
{{
    const uint32_t passed = (uint32_t)micros() - before; /* right when the clock begins anew */
    if (passed < step)
        return;
    before += passed;
    phase = (phase + passed) % cycle;
    show();
}}
"""


def _list(values: Iterable[float]) -> str:
    return ", ".join(f"{value:.9g}" for value in values)
