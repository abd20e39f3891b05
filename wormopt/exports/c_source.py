"""C99: a gait as tables of exact coefficients and one function; and a program that tests both."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from wormopt.errors import ArgumentError
from wormopt.exports.common import ExportedGait, identifier


def make(exported: ExportedGait, stem: str) -> dict[str, bytes]:
    """Files of a gait: ``STEM.h``, ``STEM.c`` and ``STEM_replay.c``.

    Raises ArgumentError if C could not include a file of that name.
    """
    if not stem.isprintable() or '"' in stem or "\\" in stem:
        raise ArgumentError(f"{stem!r}: C includes no file of that name; write letters and digits")
    name = identifier(stem)
    texts = {
        f"{stem}.h": _header(exported, name),
        f"{stem}.c": _source(exported, name, f"{stem}.h"),
        f"{stem}_replay.c": _replay(exported, name, f"{stem}.h"),
    }
    return {file: text.encode() for file, text in texts.items()}


def _comment(lines: Iterable[str]) -> str:
    kept = (line.replace("*/", "* /").replace("/*", "/ *").replace("??", "? ?") for line in lines)
    return "/* " + "\n * ".join(kept) + "\n */\n"


def _header(exported: ExportedGait, name: str) -> str:
    time, length, rate, acceleration = exported.units
    comment = _comment(
        [
            "Link lengths of a worm, repeated periodically.",
            *exported.remarks,
            f"Units: time {time}, length {length}, rate {rate}, acceleration {acceleration}; "
            "1 means none.",
        ]
    )
    return f"""{comment}
#ifndef {name.upper()}_H
#define {name.upper()}_H

#ifdef __cplusplus
extern "C" {{
#endif

enum {{ {name}_links = {exported.gait.links} }};

/* Duration of a cycle, after which the lengths repeat; the period of a designed gait may hold
 * several cycles. */
extern const double {name}_cycle;

/* Lengths of links 0, 1, ... at the time t, which may be any, before 0 too; their rates and
 * accelerations. Each array has room for {name}_links numbers, or is a null pointer. Where two
 * pieces of the gait meet, the later counts.
 */
void {name}_length(double t, double length[], double rate[], double acceleration[]);

#ifdef __cplusplus
}}
#endif

#endif
"""


def _source(exported: ExportedGait, name: str, header: str) -> str:
    gait = exported.gait
    pieces, links, powers = gait.polynomial.shape
    parts = [
        _comment(["See the header.", *exported.remarks]),
        f"""
#include "{header}"

#include <math.h>
#include <stddef.h>

enum {{ PIECES = {pieces}, LINKS = {links}, POWERS = {powers} }};

const double {name}_cycle = {gait.period.hex()}; /* {gait.period!r} */

/* When pieces begin. */
""",
        _table("begin", "[PIECES]", gait.breaks[:-1]),
        "\n/* Of each piece and link, by ascending power of the time since the piece began. */\n",
        _table("coefficient", "[PIECES][LINKS][POWERS]", gait.polynomial),
    ]
    if gait.omega is not None and gait.cosine is not None and gait.sine is not None:
        parts += [
            "\n/* Of each piece; amplitudes of each link. */\n",
            _table("omega", "[PIECES]", gait.omega),
            _table("cosine", "[PIECES][LINKS]", gait.cosine),
            _table("sine", "[PIECES][LINKS]", gait.sine),
        ]
    parts.append(_function(name, gait.omega is not None))
    return "".join(parts)


def _function(name: str, harmonic: bool) -> str:
    turn = """
    const double c = cos(omega[piece] * s), n = sin(omega[piece] * s), w = omega[piece];
"""
    swing = """
        const double along = cosine[piece][j] * c + sine[piece][j] * n;
        l += along;
        r += w * (sine[piece][j] * c - cosine[piece][j] * n);
        a -= w * w * along;
"""
    return f"""
void {name}_length(double t, double length[], double rate[], double acceleration[])
{{
    int piece = PIECES - 1, j, k;
    double s = fmod(t, {name}_cycle);
    if (s < 0.0)
        s += {name}_cycle;
    if (s >= {name}_cycle) /* a sum may be rounded up to it */
        s = 0.0;
    while (piece > 0 && s < begin[piece])
        --piece;
    s -= begin[piece];
{turn if harmonic else ""}
    for (j = 0; j < LINKS; ++j) {{
        double l = 0.0, r = 0.0, a = 0.0;
        for (k = POWERS - 1; k >= 0; --k) {{
            a = a * s + 2.0 * r;
            r = r * s + l;
            l = l * s + coefficient[piece][j][k];
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
    comment = _comment(
        [
            "Compares the tables with samples of the same gait. Compile it with the source beside "
            "it and -lm;",
            "it ends with 0 if all agree to 1e-12 of the largest length, rate and acceleration.",
            *exported.remarks,
        ]
    )
    return f"""{comment}
#include "{header}"

#include <math.h>
#include <stdio.h>

enum {{ SAMPLES = {len(at)}, LINKS = {gait.links} }};

{_table("at", "[SAMPLES]", at)}
/* Lengths, then rates, then accelerations. */
{_table("expected", "[SAMPLES][3][LINKS]", rows.reshape(len(at), 3, gait.links))}
{_table("size", "[3]", np.array(size))}
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


def _table(name: str, shape: str, values: np.ndarray) -> str:
    return f"static const double {name}{shape} = {{\n{_rows(values)}\n}};\n"


def _rows(values: np.ndarray, depth: int = 1) -> str:
    """Initialiser of an array, as hexadecimal numbers, which are exact."""
    inset = "    " * depth
    if values.ndim == 1:
        words = [v.hex() for v in values.tolist()]
        lines = (", ".join(words[k : k + 4]) for k in range(0, len(words), 4))
        return inset + f",\n{inset}".join(lines)
    parts = [_rows(part, depth + 1) for part in values]
    if all("\n" not in text for text in parts):
        return ",\n".join(f"{inset}{{{text.strip()}}}" for text in parts)
    return ",\n".join(f"{inset}{{\n{text}\n{inset}}}" for text in parts)
