"""Verification of a certificate in exact arithmetic, from its file alone.

This module shares no code with the modules that make certificates: it builds every inequality from
the problem. The page on certified gaits states the theorem, with the same letters.
"""

from __future__ import annotations

import json
from collections import defaultdict
from collections.abc import Iterator, Sequence
from fractions import Fraction
from functools import lru_cache
from itertools import combinations, product
from math import isqrt, lcm
from operator import mul
from typing import Any

FORMAT, VERSION = "wormopt certificate", 1
Data = dict[str, Any]
Matrix = tuple[tuple[Any, ...], ...]
Row = tuple[Sequence[Any], list[Fraction], bool]
Push = list[tuple[list[Fraction], list[Fraction]]]


def read(text: str) -> tuple[Data, Data, Fraction]:
    """Read problem, proof and bound from the text of a file; raises ValueError."""
    file = json.loads(text, parse_float=Fraction)
    if not isinstance(file, dict) or file.get("format") != FORMAT:
        raise ValueError(f'"format" must be "{FORMAT}"')
    if file.get("version") != VERSION:
        raise ValueError(f"version {file.get('version')!r} is not known; only {VERSION} is")
    sharing = file["problem"].pop("sharing")
    need_known = {"equal", "least_actuation"}
    if sharing not in need_known:
        raise ValueError(f"problem.sharing: not {sharing!r}; write one of {sorted(need_known)}")
    problem, proof = _fractions(file["problem"]), _fractions(file["proof"])
    return {**problem, "sharing": sharing}, proof, Fraction(file["bound"])


def _fractions(value: Any) -> Any:
    """Convert strings to fractions, through all lists and tables."""
    if isinstance(value, dict):
        return {key: _fractions(each) for key, each in value.items()}
    if isinstance(value, list):
        return [_fractions(each) for each in value]
    return Fraction(value) if isinstance(value, str) else value


class BrokenProofError(Exception):
    """A step of a proof does not hold; the message says which."""


def need(holds: bool, what: str) -> None:
    """Raise `BrokenProofError` unless it holds."""
    if not holds:
        raise BrokenProofError(what)


def check(
    p: Data,
    h: Data,
    bound: Fraction,
    strokes: Sequence[Fraction | None] = (),
    link: int | None = None,
) -> int:
    """Check the proof h that no gait of the problem p exceeds the bound; count its inequalities.

    The bound is on the speed, or on the mean rate of a link. `strokes`: proven bounds or None.
    """
    known = list(strokes) or [None] * (len(p["masses"]) - 1)
    count = 0
    for earlier in h.get("stroke_proofs", ()):  # a link covers its stroke twice in a period
        j, most = earlier["link"], earlier["bound"]
        count += check(p, earlier["proof"], most, known, j)
        known[j] = min(most * p["period"] / 2, known[j] or most * p["period"] / 2)
    accelerations = [x for k in ("starts", "brakes") for way in h[k] for x in way]
    need(min(*p["masses"], p["period"], *h["strokes"], *accelerations) > 0, "a size is not above 0")
    need(min(p["drag"], *p["load"]) >= 0, "a drag or load is below 0")
    ways = [_check_link(p, h, j, stroke) for j, stroke in enumerate(known)]
    if "pieces" not in h:  # without pieces, a link's acceleration has no other limit
        for given in (*h["starts"], *h["brakes"]):
            for j, (taken, a) in enumerate(zip(given, p["acceleration"], strict=True)):
                need(taken >= a, f"link {j}: {taken} is below its acceleration")
        faces = {}
    else:
        _check_cover(p, h)
        faces = {face: _pushes(p, h, *face) for face in sorted(_faces(p, h))}
    if "values" not in h:
        need(link is None, "mean rates are bounded by mean rates")
        most = sum((stroke / time for stroke, time in ways), Fraction(0))
        need(most <= bound, f"the mean rates of the links allow {float(most):.9g}")
        return count + len(ways)
    need(min(h["degree"], h["cells"]) >= 1, "W has no degree or no cells")
    table = {tuple(k): v for k, v in zip(h["points"], h["values"], strict=True)}
    rows = (_check_face(h, bound, table, face, own, link) for (face, _), own in faces.items())
    return count + sum(rows)


def _check_link(p: Data, h: Data, j: int, known: Fraction | None) -> tuple[Fraction, Fraction]:
    """Check rates and stroke of a link; return its stroke and the least time for both ways."""
    a, whole, stroke = p["acceleration"][j], p["length"][j][1] - p["length"][j][0], h["strokes"][j]
    for way in (0, 1):
        rate, taken = p["rates"] and p["rates"][way][j], h["rates"][way][j]
        swing = taken**2 / a  # shortest stroke of a link that reaches this rate
        slow = swing >= whole or _time(p, j, swing, [1 / a] * 2) >= p["period"]
        need(slow or (rate and taken >= rate), f"link {j} can be faster than {taken}")
    ways = zip(h["starts"], h["brakes"], strict=True)
    time = _time(p, j, stroke, [(1 / start[j] + 1 / brake[j]) / 2 for start, brake in ways])
    enough = stroke >= whole or time >= p["period"] or (known is not None and stroke >= known)
    need(enough, f"link {j} can move by more than {stroke}")
    return stroke, time


def _time(p: Data, j: int, stroke: Fraction, inertia: Sequence[Fraction]) -> Fraction:
    """Least time in which a link covers a stroke both ways, rounded down."""
    time = Fraction(0)
    for way, e in enumerate(inertia):
        rate = p["rates"] and p["rates"][way][j]
        reached = rate and rate**2 * e <= stroke
        time += stroke / rate + rate * e if reached else 2 * _root(stroke * e)
    return time


def _root(x: Fraction) -> Fraction:
    """Lower bound of a square root."""
    return Fraction(isqrt(x.numerator * x.denominator * 10**40), x.denominator * 10**20)


def _check_cover(p: Data, h: Data) -> None:
    """Check that pieces cover all velocities once, each with known masses at rest."""
    size, points = len(p["masses"]), h["vertices"]
    own = defaultdict(list)
    for piece in h["pieces"]:
        corners = [points[i] for i in piece]
        own[tuple(i for i in range(size) if not any(v[i] for v in corners))].append(piece)
        need(min(map(min, corners)) >= 0, f"a mass moves backward on piece {piece}")
        for j, (c, e) in enumerate(zip(*h["rates"], strict=True)):
            rates = [h["mesh_unit"] * (v[j] - v[j + 1]) for v in corners]
            need(-c <= min(rates) and max(rates) <= e, f"link {j} is too fast on piece {piece}")
            need(min(rates) * max(rates) >= 0, f"link {j} has both signs on piece {piece}")
    need(set(own) == set(combinations(range(size), p["resting"])), "other sets of masses rest")
    beside = defaultdict(list)  # by facet: masses at rest, row of the inverse, opposite vertex
    for rest, pieces in own.items():
        moving = [i for i in range(size) if i not in rest]
        at = [(*(v[i] for i in moving), 1) for v in points]  # vertices in coordinates of the pieces
        places = []
        for piece in pieces:
            need(len(piece) == len(moving) + 1, f"piece {piece} has not {len(moving) + 1} vertices")
            places.append(_inverse(tuple(zip(*(at[i] for i in piece), strict=True))))
            need(bool(places[-1]), f"piece {piece} is flat")
            for vertex, row in zip(piece, places[-1], strict=True):
                beside[frozenset(piece) - {vertex}].append((rest, row, at[vertex]))
        middle = [sum(values) for values in zip(*(at[i] for i in pieces[0]), strict=True)]
        inside = sum(all(_dot(row, middle) >= 0 for row in place) for place in places)
        need(inside == 1, f"pieces overlap where masses {rest} rest")
    for facet, sides in beside.items():
        corners, rests = [points[i] for i in facet], [rest for rest, *_ in sides]
        still = [i for i in range(size) if not any(v[i] for v in corners)]
        if len(still) > p["resting"]:  # pieces with each subset of them meet here
            need(sorted(rests) == list(combinations(still, p["resting"])), f"a gap at {corners}")
        elif len(sides) == 2:
            need(_dot(sides[0][1], sides[1][2]) < 0, f"pieces overlap at {corners}")
        else:
            edge = False
            for j, (c, e) in enumerate(zip(*h["rates"], strict=True)):
                edge |= {h["mesh_unit"] * (v[j] - v[j + 1]) for v in corners} in ({-c}, {e})
            need(edge and len(sides) == 1, f"no piece lies beyond {corners}")


def _faces(p: Data, h: Data) -> set[tuple[tuple[int, ...], tuple[int, ...]]]:
    """Pieces with their resting masses and, where loads matter, faces on which more masses rest."""
    size, fewest = len(p["masses"]), p["resting"]
    loads_matter = p["spike_load"] is not None or p["actuator_force"] is not None
    found = set()
    for count in range(fewest, size if loads_matter else fewest + 1):
        for piece, rest in product(h["pieces"], combinations(range(size), count)):
            face = tuple(sorted(i for i in piece if not any(h["vertices"][i][x] for x in rest)))
            if len(face) == size - count + 1:
                found.add((face, rest))
    return found


def _limits(p: Data, rest: Sequence[int], corners: Sequence[Sequence[Fraction]]) -> Iterator[Row]:
    """Limits on a face: weights of the masses' accelerations, and room at each corner.

    The weighted sum plus the room is at least 0. The last value says whether the room differs
    between the corners. Rows where it does have the same weights up to the sign; others have their
    largest room at all corners.
    """
    size = len(p["masses"])
    for j, a in enumerate(p["acceleration"]):
        for sign in (1, -1) if {j, j + 1} - set(rest) else ():
            yield [sign * ((i == j) - (i == j + 1)) for i in range(size)], [a] * len(corners), False
    ones = [Fraction(1)] * size
    forces = [(1, ones, size * (p["load"][0] - p["sigma_margin"]), True)]
    if p["spike_load"] is not None:
        own = [p["spike_load"][i] for i in rest]
        most = len(own) * min(own) if p["sharing"] == "equal" else sum(own)
        forces.append((-1, ones, most - size * p["load"][1], True))
    if p["actuator_force"] is not None and (len(rest) == 1 or p["sharing"] == "equal"):
        for j, most in enumerate(p["actuator_force"], 1):
            held = Fraction(sum(i < j for i in rest), len(rest))
            weights = [held - (i < j) for i in range(size)]
            for sign, load in product((1, -1), p["load"]):
                room = most + sign * (load * (size * held - j) + _dot(weights, p["beyond"]))
                forces.append((sign, weights, room, False))
    for sign, weights, room, moves in forces:
        rooms = [room + sign * p["drag"] * _dot(weights, v) for v in corners]
        rooms = rooms if moves else [max(rooms)] * len(rooms)
        yield [sign * w * m for w, m in zip(weights, p["masses"], strict=True)], rooms, moves


def _pushes(p: Data, h: Data, face: Sequence[int], rest: Sequence[int]) -> list[Push]:
    """Accelerations whose convex hull contains the admissible ones on a face, at its corners."""
    size = len(p["masses"])
    moving = [i for i in range(size) if i not in rest]
    corners = [[h["mesh_unit"] * x for x in h["vertices"][i]] for i in face]
    limits = _limits(p, rest, corners)
    rows: list[Row] = [(tuple(w[i] for i in moving), room, moves) for w, room, moves in limits]
    place = _inverse(tuple(zip(*((*(v[i] for i in moving), 1) for v in corners), strict=True)))
    found = []
    for points in _vertices(rows):
        push = []
        for w in points if p["drag"] else points[:1]:
            full, gains = dict(zip(moving, w, strict=True)), []
            for j in range(size - 1):
                way = int(sum(v[j] - v[j + 1] for v in corners) > 0)
                u = (2 * way - 1) * (full.get(j, 0) - full.get(j + 1, 0))
                start, brake = h["starts"][way][j], h["brakes"][way][j]
                need(-brake <= u <= start, f"link {j} accelerates by {u} on face {face}")
                gains.append(1 + u / brake)
            push.append(([_dot(row[:-1], w) for row in place], gains))
        found.append(push)
    return found


def _vertices(rows: list[Row]) -> set[tuple[tuple[Fraction, ...], ...]]:
    """Points, linear between the corners, whose convex hull contains the polytope of the rows.

    They are the vertices for the largest rooms. A vertex on a row that varies moves along its edge
    with this row, if the other rows allow it at all corners.
    """
    found = set()
    for chosen in combinations(rows, len(rows[0][0])):
        inverse = _inverse(tuple(normal for normal, *_ in chosen))
        if not inverse:
            continue
        rooms = [(max(room), *room) for _, room, _ in chosen]
        points = zip(*rooms, strict=True)
        widest, *own = (tuple(-_dot(row, side) for row in inverse) for side in points)
        if all(_dot(normal, widest) + max(room) >= 0 for normal, room, _ in rows):
            fixed = [(normal, room[0]) for normal, room, moves in rows if not moves]
            kept = all(_dot(normal, x) + room >= 0 for x in own for normal, room in fixed)
            found.add(tuple(own) if kept else (widest,) * len(own))
    return found


def _check_face(
    h: Data,
    bound: Fraction,
    table: dict[tuple[int, ...], Any],
    face: Sequence[int],
    pushes: list[Push],
    link: int | None,
) -> int:
    """Check dW/dt + (V_0 + V_n)/2, or + |v_link|, <= bound on a face, in whole numbers."""
    points, degree, cells = [h["vertices"][i] for i in face], h["degree"], h["cells"]
    links, low = len(points[0]) - 1, _exponents(degree, len(face))
    high = _templates(degree, len(face))
    w = {e: table[tuple(_dot(e, x) for x in zip(*points, strict=True))] for e in low}
    rates = [[v[j] - v[j + 1] for v in points] for j in range(links)]
    ends = [v[0] + v[-1] for v in points] if link is None else [2 * abs(v) for v in rates[link]]
    whole = []  # for each push: the factors at every corner, and the bound
    for push in pushes:
        rows = []
        for turn, gains in push:
            slopes = [
                g * h["mesh_unit"] * cells / d for g, d in zip(gains, h["strokes"], strict=True)
            ]
            rows.append([h["unit"] * x for x in (*turn, *slopes)] + [h["mesh_unit"] / 2])
        most = (degree + 1) * bound
        by = lcm(most.denominator, *(x.denominator for row in rows for x in row))
        whole.append(([[int(x * by) for x in row] for row in rows], int(most * by)))
    step = [(cells + 1) ** (links - 1 - j) for j in range(links)]
    for cell, corner in product(product(range(cells), repeat=links), product((0, 1), repeat=links)):
        here = sum((c + b) * s for c, b, s in zip(cell, corner, step, strict=True))
        own = {e: values[here] for e, values in w.items()}
        rise = []
        for s, sign in zip(step, (1 - 2 * b for b in corner), strict=True):
            rise.append({e: sign * (v[here + sign * s] - v[here]) for e, v in w.items()})
        parts = {}  # for each coefficient: the terms that the factors multiply
        for e, (below, slopes) in high.items():
            parts[e] = [sum(k * own[a] for a, k in slope.items()) for slope in slopes]
            for rate, up in zip(rates, rise, strict=True):
                parts[e].append(sum(k * rate[q] * up[a] for q, k, a in below))
            parts[e].append(sum(k * ends[q] for q, k, _ in below))
        for rows, most in whole:
            corners = [{e: sum(map(mul, row, part)) for e, part in parts.items()} for row in rows]
            found = corners[0]
            if len(rows) > 1:  # linear between the corners: the degree rises by one
                found = _mixed(corners)
                most *= degree + 2
            worst = max(found, key=found.__getitem__)
            where = f"face {face}, cell {cell}, corner {corner}, coefficient {worst}"
            need(found[worst] <= most, f"dW/dt + V exceeds the bound on {where}")
    return len(whole) * len(high) * (2 * cells) ** links


def _mixed(found: list[dict[tuple[int, ...], int]]) -> dict[tuple[int, ...], int]:
    """Coefficients of Σ λ_r f_r, times their degree, from those of each f_r."""
    degree = sum(next(iter(found[0]))) + 1
    return {
        e: sum(e[r] * f[_moved(e, r, -1)] for r, f in enumerate(found) if e[r])
        for e in _exponents(degree, len(found))
    }


@lru_cache
def _exponents(degree: int, count: int) -> list[tuple[int, ...]]:
    return [e for e in product(range(degree + 1), repeat=count) if sum(e) == degree]


@lru_cache
def _templates(degree: int, count: int) -> dict[tuple[int, ...], Any]:
    """Coefficients of degree + 1, times this number, of W times a linear function and of dW/dλ."""
    found = {}
    for e in _exponents(degree + 1, count):
        below = [(q, e[q], _moved(e, q, -1)) for q in range(count) if e[q]]
        slopes: list[dict[tuple[int, ...], int]] = [{} for _ in range(count)]
        for _, k, a in below:
            for r, q in product(range(count), repeat=2):
                if a[r]:
                    to = _moved(_moved(a, r, -1), q, 1)
                    slopes[q][to] = slopes[q].get(to, 0) + k * a[r]
        found[e] = below, slopes
    return found


def _moved(e: tuple[int, ...], q: int, by: int) -> tuple[int, ...]:
    return (*e[:q], e[q] + by, *e[q + 1 :])


def _dot(a: Sequence[Any], b: Sequence[Any]) -> Any:
    return sum(x * y for x, y in zip(a, b, strict=True))


@lru_cache(maxsize=4096)
def _inverse(matrix: Matrix) -> Matrix:
    """Inverse of a square matrix; empty if it has none."""
    size = len(matrix)
    rows = [
        [*map(Fraction, r), *(Fraction(i == k) for k in range(size))] for i, r in enumerate(matrix)
    ]
    for k in range(size):
        pivot = next((i for i in range(k, size) if rows[i][k]), None)
        if pivot is None:
            return ()
        rows[k], rows[pivot] = rows[pivot], rows[k]
        rows[k] = [x / rows[k][k] for x in rows[k]]
        for i in range(size):
            if i != k and rows[i][k]:
                rows[i] = [x - rows[i][k] * y for x, y in zip(rows[i], rows[k], strict=True)]
    return tuple(tuple(row[size:]) for row in rows)
