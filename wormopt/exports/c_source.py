"""C source of a gait: exact tables in double precision, or in single for microcontrollers."""

from __future__ import annotations

import re
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from wormopt.errors import ArgumentError
from wormopt.exports.common import ExportedGait, identifier


@dataclass(frozen=True)
class Precision:
    """Type of the numbers, ending of its constants and functions, and how tables are kept."""

    type: str
    ending: str = ""
    place: str = ""  # of tables in memory
    read: str = "{}"

    def table(self, name: str, shape: str, values: np.ndarray) -> str:
        """Table of constants, as hexadecimal numbers, which are exact."""
        rows = _rows(values, self)
        return f"static const {self.type} {name}{shape}{self.place} = {{\n{rows}\n}};\n"

    def number(self, value: float) -> str:
        """Constant, rounded to this precision."""
        if self is DOUBLE:
            return value.hex()
        return re.sub(r"\.?0*p", "p", float(np.float32(value)).hex()) + self.ending


DOUBLE = Precision("double")
SINGLE = Precision("float", "f", " PROGMEM", "READ({})")
# AVR reads constants from the memory of the program by functions of its own.
_IN_PROGRAM = """
#ifdef __AVR__
#include <avr/pgmspace.h>
#define READ(number) pgm_read_float(&(number))
#else
#ifndef PROGMEM
#define PROGMEM
#endif
#define READ(number) (number)
#endif
"""


def make(exported: ExportedGait, stem: str) -> dict[str, bytes]:
    """Files of a gait: ``STEM.h``, ``STEM.c`` and ``STEM_replay.c``."""
    if not stem.isprintable() or '"' in stem or "\\" in stem:
        raise ArgumentError(f"{stem!r}: C includes no file of that name; write letters and digits")
    replay = _replay(exported, identifier(stem), f"{stem}.h")
    return library(exported, stem, DOUBLE) | {f"{stem}_replay.c": replay.encode()}


def library(exported: ExportedGait, stem: str, precision: Precision) -> dict[str, bytes]:
    """``STEM.h`` and ``STEM.c``: the function that gives the lengths."""
    name = identifier(stem)
    texts = {
        f"{stem}.h": _header(exported, name, precision.type),
        f"{stem}.c": _source(exported, name, f"{stem}.h", precision),
    }
    return {file: text.encode() for file, text in texts.items()}


def comment(lines: Iterable[str]) -> str:
    """Comment of these lines, whatever they contain."""
    kept = (line.replace("*/", "* /").replace("/*", "/ *").replace("??", "? ?") for line in lines)
    return "/* " + "\n * ".join(kept) + "\n */\n"


def _header(exported: ExportedGait, name: str, number: str) -> str:
    time, length, rate, acceleration = exported.units
    head = comment(
        [
            "Link lengths of a worm, repeated periodically.",
            *exported.remarks,
            f"Units: time {time}, length {length}, rate {rate}, acceleration {acceleration}; "
            "1 means none.",
        ]
    )
    return f"""{head}
#ifndef {name.upper()}_H
#define {name.upper()}_H

#ifdef __cplusplus
extern "C" {{
#endif

enum {{ {name}_links = {exported.gait.links} }};

/* Duration of a cycle, after which the lengths repeat; the period of a designed gait may hold
 * several cycles. */
extern const {number} {name}_cycle;

/* Lengths of links 0, 1, ... at the time t, which may be any, before 0 too; their rates and
 * accelerations. Each array has room for {name}_links numbers, or is a null pointer. Where two
 * pieces of the gait meet, the later counts.
 */
void {name}_length({number} t, {number} length[], {number} rate[], {number} acceleration[]);

#ifdef __cplusplus
}}
#endif

#endif
"""


def _source(exported: ExportedGait, name: str, header: str, precision: Precision) -> str:
    gait, table = exported.gait, precision.table
    pieces, links, powers = gait.polynomial.shape
    cycle = f"{precision.number(gait.period)}; /* {gait.period!r} */"
    parts = [
        comment(["See the header.", *exported.remarks]),
        f"""
#include "{header}"

#include <math.h>
#include <stddef.h>
{_IN_PROGRAM if precision is SINGLE else ""}
enum {{ PIECES = {pieces}, LINKS = {links}, POWERS = {powers} }};

const {precision.type} {name}_cycle = {cycle}

/* When pieces begin. */
""",
        table("begin", "[PIECES]", gait.breaks[:-1]),
        "\n/* Of each piece and link, by ascending power of the time since the piece began. */\n",
        table("coefficient", "[PIECES][LINKS][POWERS]", gait.polynomial),
    ]
    if gait.omega is not None and gait.cosine is not None and gait.sine is not None:
        parts += [
            "\n/* Of each piece; amplitudes of each link. */\n",
            table("omega", "[PIECES]", gait.omega),
            table("cosine", "[PIECES][LINKS]", gait.cosine),
            table("sine", "[PIECES][LINKS]", gait.sine),
        ]
    parts.append(_function(name, gait.omega is not None, precision))
    return "".join(parts)


def _function(name: str, harmonic: bool, precision: Precision) -> str:
    number, f, read = precision.type, precision.ending, precision.read.format
    turn = f"""
    const {number} w = {read("omega[piece]")}, c = cos{f}(w * s), n = sin{f}(w * s);
"""
    swing = f"""
        const {number} even = {read("cosine[piece][j]")}, odd = {read("sine[piece][j]")};
        const {number} along = even * c + odd * n;
        l += along;
        r += w * (odd * c - even * n);
        a -= w * w * along;
"""
    return f"""
void {name}_length({number} t, {number} length[], {number} rate[], {number} acceleration[])
{{
    int piece = PIECES - 1, j, k;
    {number} s = fmod{f}(t, {name}_cycle);
    if (s < 0.0{f})
        s += {name}_cycle;
    if (s >= {name}_cycle) /* a sum may be rounded up to it */
        s = 0.0{f};
    while (piece > 0 && s < {read("begin[piece]")})
        --piece;
    s -= {read("begin[piece]")};
{turn if harmonic else ""}
    for (j = 0; j < LINKS; ++j) {{
        {number} l = 0.0{f}, r = 0.0{f}, a = 0.0{f};
        for (k = POWERS - 1; k >= 0; --k) {{
            a = a * s + 2.0{f} * r;
            r = r * s + l;
            l = l * s + {read("coefficient[piece][j][k]")};
        }}
{swing if harmonic else ""}        if (length != NULL)
            length[j] = l;
        if (rate != NULL)
            rate[j] = r;
        if (acceleration != NULL)
            acceleration[j] = a;
    }}
}}
"""


def _replay(exported: ExportedGait, name: str, header: str) -> str:
    gait, period = exported.gait, exported.gait.period
    middle = (gait.breaks[:-1] + gait.breaks[1:]) / 2
    spread = np.linspace(-2.3, 3.7, 41) * period
    at = np.concatenate([gait.breaks[:-1], middle, spread])
    rows = np.concatenate([gait(at), gait(at, 1), gait(at, 2)]).T
    # effect of the rounding of the time
    size = [float(np.abs(part).max()) or 1.0 for part in np.split(rows, 3, axis=1)]
    head = comment(
        [
            "Compares the tables with samples of the same gait. Compile it with the source beside "
            "it and -lm;",
            "it ends with 0 if all agree to 1e-12 of the largest length, rate and acceleration.",
            *exported.remarks,
        ]
    )
    return f"""{head}
#include "{header}"

#include <math.h>
#include <stdio.h>

enum {{ SAMPLES = {len(at)}, LINKS = {gait.links} }};

{DOUBLE.table("at", "[SAMPLES]", at)}
/* Lengths, then rates, then accelerations. */
{DOUBLE.table("expected", "[SAMPLES][3][LINKS]", rows.reshape(len(at), 3, gait.links))}
{DOUBLE.table("size", "[3]", np.array(size))}
int main(void)
{{
    double found[3][LINKS], worst = 0.0;
    int i, j, k;
    for (i = 0; i < SAMPLES; ++i) {{
        {name}_length(at[i], found[0], found[1], found[2]);
        for (k = 0; k < 3; ++k)
            for (j = 0; j < LINKS; ++j) {{
                const double off = fabs(found[k][j] - expected[i][k][j]) / size[k];
                if (!(off <= worst)) /* so that no NaN passes */
                    worst = off;
            }}
    }}
    printf("largest difference %g\\n", worst);
    return worst <= 1e-12 ? 0 : 1;
}}
"""


def _rows(values: np.ndarray, precision: Precision, depth: int = 1) -> str:
    inset = "    " * depth
    if values.ndim == 1:
        words = [precision.number(v) for v in values.tolist()]
        lines = (", ".join(words[k : k + 4]) for k in range(0, len(words), 4))
        return inset + f",\n{inset}".join(lines)
    parts = [_rows(part, precision, depth + 1) for part in values]
    if all("\n" not in text for text in parts):
        return ",\n".join(f"{inset}{{{text.strip()}}}" for text in parts)
    return ",\n".join(f"{inset}{{\n{text}\n{inset}}}" for text in parts)
