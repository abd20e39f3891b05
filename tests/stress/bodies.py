"""Bodies in a channel: segments between coils, the elastica, vibrations of thin and thick rods.

Judged by quadrature of the first integral of bending, by shooting, by Timoshenko's beam solved with
exponentials, by strain energies integrated anew.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping
from itertools import pairwise

import casadi as ca
import numpy as np
from scipy.integrate import quad, solve_ivp

from tests.stress.means import refused, zero
from tests.stress.rods import RODS
from tests.stress.verdict import Case, Dice, Judged, apart, many, spread
from wormopt.analysis.vibration import vibration_modes
from wormopt.model.model import pack
from wormopt.systems.channel.closed_forms import STEEPEST, ChannelWorm, Shape
from wormopt.systems.channel.rod import Rod
from wormopt.systems.channel.rod_model import channel_rod
from wormopt.systems.channel.segments import (
    SLEEVE_RISE,
    Free,
    assumed_shapes,
    elastic_shape,
    exact_elastica,
)

_HELD = {
    "free": (("moment", "shear"), {}),
    "pinned": (("place", "moment"), {"across": [0, -1]}),
    "clamped": (("place", "angle"), {"across": [0, -1], "angle": [0, -1]}),
}
_STATES = ("place", "angle", "moment", "shear")


def cases(*, quick: bool) -> Iterable[Case]:
    """List the cases of bodies."""
    kinds = (
        ("segments of bodies", _segment, 25),
        ("bending of segments", _bending, 10),
        ("elastica", _elastica, 30),
        ("elastica solved", _shape, 12),
        ("vibrations of rods", _vibration, 24),
        ("damping of rods", _damping, 8),
        *RODS,
        ("no bodies", _no_body, 5),
    )
    return many(kinds, quick=quick, span=0.2)


# -- assumed segments ------------------------------------------------------------------------------


def _worm(dice: Dice, steep: float) -> ChannelWorm:
    """A body in sizes from micrometres to metres, its segments up to so steep."""
    pitch, body = spread(dice, 1e-6, 10.0), spread(dice, 1e-2, 10.0)
    rise = pitch * spread(dice, 1e-4, steep)
    body *= pitch
    return ChannelWorm(pitch, body + rise, body, pitch * spread(dice, 1.01, 100.0), 5e4)


def _slopes(rise: float) -> dict[Shape, Callable[[float], float]]:
    """Slopes of the assumed shapes over a pitch of 1, (33) to (35)."""
    return {
        "sine": lambda x: rise * math.pi / 2 * math.cos(math.pi * (x - 0.5)),
        "beam": lambda x: -6 * rise * x**2 + 6 * rise * x,
        "line": lambda _: rise,
    }


def _segment(dice: Dice) -> Judged:
    worm = _worm(dice, STEEPEST * 0.999)
    for shape, slope in _slopes(worm.rise / worm.pitch).items():
        length = quad(lambda x, f=slope: math.hypot(1, f(x)), 0, 1, epsabs=0, epsrel=1e-13)[0]
        yield f"length, {shape}", apart(worm.arc_length(shape), worm.pitch * length, 1e-12)
        ratio = worm.length / worm.pitch / length
        if abs(ratio % 1 - 0.5) < 1e-9:
            continue  # two counts are as near
        count = round(ratio)
        yield f"count, {shape}", apart(worm.count(shape), count, 1e-12, size=1)
        speed = worm.pitch * (length - 1) * count / (count + 3)
        told = worm.velocity_per_frequency(shape)
        yield f"velocity, {shape}", apart(told, speed, 1e-12, size=worm.pitch * 1e-3)
        middle = worm.center_line(shape, worm.pitch / 2)
        yield f"middle, {shape}", apart(middle, worm.channel / 2, 1e-12)


def _bending(dice: Dice) -> Judged:
    """Energy and largest curvature of assumed shapes, by second derivatives written out."""
    worm = _worm(dice, 3.0)
    rise = worm.rise / worm.pitch
    bends = {
        "sine": lambda x: -rise * math.pi**2 / 2 * math.sin(math.pi * (x - 0.5)),
        "beam": lambda x: 6 * rise - 12 * rise * x,
    }
    slopes: Mapping[str, Callable[[float], float]] = {**_slopes(rise)}
    for found in assumed_shapes(worm):
        if found.name == "line":
            yield "kinks", 0.0 if found.energy is None else math.inf
            continue
        slope, bend = slopes[found.name], bends[found.name]

        def curvature(x: float, slope: Callable = slope, bend: Callable = bend) -> float:
            return bend(x) / (1 + slope(x) ** 2) ** 1.5

        energy = quad(
            lambda x, k=curvature, f=slope: k(x) ** 2 / 2 * math.hypot(1, f(x)), 0, 1,
            epsabs=0, epsrel=1e-10, limit=200,
        )[0]  # fmt: skip
        yield f"energy, {found.name}", apart(found.energy or 0.0, energy / worm.pitch, 1e-7)
        x = np.linspace(0, 1, 20001)
        most = max(abs(curvature(float(at))) for at in x[::10])
        yield f"curvature, {found.name}", apart(found.curvature or 0.0, most / worm.pitch, 1e-4)


# -- elastica --------------------------------------------------------------------------------------


def _first_integral(closing: Free, steepest: float) -> dict[str, float]:
    """Segment whose largest angle is given, by quadrature over the angle, scaled by its span.

    theta'² / 2 = V (sin top - sin theta) with point contact, |N| cos theta - V sin theta with a
    sleeve: with theta = top - s² the root at the top is taken out. Forces of size 1 to begin with.
    """
    top = steepest
    sleeve = closing == "sleeve"
    V, N = (math.cos(top), -math.sin(top)) if sleeve else (1.0, 0.0)

    def speed(s: float) -> float:
        """Rate of theta over s, at theta = top - s²."""
        half = s * s / 2
        fall = math.sin(half) / half  # of s² / 2
        if sleeve:  # sin(top - theta), as |N| = sin top, V = cos top
            return math.sqrt(2 * math.sin(s * s)) / s
        # sin top - sin theta = 2 cos(top - half) sin half
        return math.sqrt(2 * math.cos(top - half) * fall)

    end = math.sqrt(top)
    ease = math.sqrt(max(math.pi / 2 - top, 0.0))  # width of the peak of a steep middle
    edges = [0.0, *(p for p in ease * 2.0 ** np.arange(-3, 12) if p < end), end]
    nodes, weights = np.polynomial.legendre.leggauss(24)

    def over(f: Callable[[float], float]) -> float:
        """Integral of f over the arc from the wall to the middle, by Gauss' rule on parts."""
        return sum(
            (b - a) * w * f(top - s * s) / speed(s)
            for a, b in pairwise(edges)
            for s, w in zip(a + (b - a) / 2 * (1 + nodes), weights, strict=True)
        )

    span = 2 * over(lambda a: math.sin(math.pi / 2 - a))
    wall = math.sqrt(-2 * N) if sleeve else math.sqrt(2 * math.sin(top))
    bend = over(
        (lambda a: -N * math.cos(a) - V * math.sin(a)) if sleeve
        else (lambda a: math.sin(top) - math.sin(a))
    )  # fmt: skip
    return {
        "rise": 2 * over(math.sin) / span,
        "length": 2 * over(lambda _: 1.0) / span,
        "reaction": V * span**2,
        "tension": N * span**2,
        "energy": 2 * bend * span,
        "curvature": wall * span,
    }


def _elastica(dice: Dice) -> Judged:
    closing: Free = "sleeve" if dice.random() < 0.4 else "point_contact"
    if closing == "sleeve":
        steepest = float(dice.uniform(0.01, 1.0)) * math.pi / 2
    elif dice.random() < 0.5:
        steepest = math.pi / 2 - spread(dice, 1e-6, 1.0)
    else:
        steepest = spread(dice, 1e-3, 1.5)
    known = _first_integral(closing, steepest)
    found = exact_elastica(closing, known["rise"])
    # a steep one hardly tells its angle by its rise
    for name, value in known.items():
        yield name, apart(getattr(found, name), value, 1e-8, size=1e-6)


def _shape(dice: Dice) -> Judged:
    """The elastica by collocation: what it says of its start is shot to its end."""
    closing: Free = "sleeve" if dice.random() < 0.4 else "point_contact"
    most = 0.98 * SLEEVE_RISE if closing == "sleeve" else 6.0
    pitch, rise = spread(dice, 1e-4, 1.0), spread(dice, 1e-2, most)
    worm = ChannelWorm(pitch, pitch * (rise + 0.3), pitch * 0.3, 5 * pitch, 5e4)
    found = elastic_shape(worm, closing, 256)
    assert found.reaction is not None
    assert found.tension is not None
    assert found.curvature is not None
    V, N = found.reaction * pitch**2, found.tension * pitch**2

    def bend(_: float, y: np.ndarray) -> list[float]:
        c, s = math.cos(y[0]), math.sin(y[0])
        return [y[1], -V * c + N * s, c, s, y[1] ** 2 / 2]

    begin = [0.0, found.curvature * pitch, 0.0, 0.0, 0.0]
    far = solve_ivp(bend, (0, found.curve.length / pitch), begin, method="DOP853", rtol=1e-12,
                    atol=1e-13)  # fmt: skip
    end = far.y[:, -1]
    steep = 1e-8 * (1 + V)  # shooting makes errors of the start grow
    yield "end", apart(end[[0, 2, 3]], [0.0, 1.0, rise], steep)
    yield "energy", apart((found.energy or 0.0) * pitch, end[4], steep)
    if closing == "sleeve":
        yield "Hamiltonian", apart(begin[1] ** 2 / 2, -N, 1e-8)


# -- vibrations ------------------------------------------------------------------------------------


def _rod(dice: Dice, longest: float) -> Rod:
    """A rod from a stub to a thread, of jelly or of steel, solid or filled."""
    diameter = spread(dice, 1e-5, 0.1)
    skin = 0.0 if dice.random() < 0.6 else diameter * float(dice.uniform(0.02, 0.5))
    return Rod(
        length=diameter * spread(dice, 2.0, longest),
        diameter=diameter,
        youngs_modulus=spread(dice, 1e3, 2e11),
        density=spread(dice, 1e2, 2e4),
        poisson_ratio=float(dice.uniform(0.0, 0.5)),
        elements=10,
        degree=4,
        skin=skin,
    )


def _beam(rod: Rod, ends: tuple[str, str], count: int) -> np.ndarray:
    """Angular frequencies of Timoshenko's beam: its state is carried along by an exponential."""
    hole = 1 - 2 * rod.skin / rod.diameter if rod.skin else 0.0
    area, second = (math.pi * rod.diameter**p / q for p, q in ((2, 4), (4, 64)))
    stiff, square, nu = second * (1 - hole**4) * rod.youngs_modulus, hole**2, rod.poisson_ratio
    shape = 6 * (1 + nu) * (1 + square) ** 2
    shape /= (7 + 6 * nu) * (1 + square) ** 2 + (20 + 12 * nu) * square
    shear = shape * rod.youngs_modulus / (2 * (1 + nu)) * area * (1 - square)
    soft, slender = stiff / (shear * rod.length**2), second / (area * rod.length**2)
    known, wanted = ([_STATES.index(name) for name in side] for side in (_other(ends), ends))

    def end(wave: float | np.ndarray) -> np.ndarray:
        w2 = np.atleast_1d(wave) ** 4
        rates = np.zeros((len(w2), 4, 4))
        rates[:, 0, 1] = rates[:, 1, 2] = 1.0
        rates[:, 0, 3], rates[:, 1, 2], rates[:, 2, 3] = soft, 1.0, -1.0
        rates[:, 2, 1], rates[:, 3, 0] = -w2 * slender, -w2
        growth, modes = np.linalg.eig(rates)
        carried = modes * np.exp(growth)[:, None] @ np.linalg.inv(modes)
        return np.real(np.linalg.det(carried[:, wanted][:, :, known]))

    waves = np.arange(0.3, 15.0, 0.1)
    values = end(waves)
    at = np.flatnonzero(values[:-1] * values[1:] < 0)[:count]
    roots = [zero(lambda w: end(w)[0], float(waves[k]), float(waves[k + 1])) for k in at]
    return np.array(roots) ** 2 * math.sqrt(stiff / (rod.density * area)) / rod.length**2


def _other(ends: tuple[str, str]) -> tuple[str, ...]:
    return tuple(name for name in _STATES if name not in ends)


def _vibration(dice: Dice) -> Judged:
    rod = _rod(dice, 1e4)
    name = str(dice.choice(list(_HELD)))
    ends, held = _HELD[name]
    model = channel_rod(rod, 3 * rod.diameter, 0.5)
    across = {"along": list(range(rod.count)), **held}
    known = _beam(rod, ends, 2) / (2 * math.pi)
    modes = vibration_modes(model, across, rigid=2 if name == "free" else 0)
    moving = modes.frequencies[modes.frequencies > 0][: len(known)]
    share = 1e-5 + (modes.rounding / known[0]) ** 2  # slender rods hide among rounding
    yield "across", apart(moving / known, np.ones(len(known)), share)
    only = {"across": list(range(rod.count)), "angle": list(range(rod.count))}
    along = vibration_modes(model, only, count=3, rigid=1).frequencies
    first = math.sqrt(rod.stiffness().stretching / (rod.density * rod.area)) / (2 * rod.length)
    yield "along", apart(along / first, [0.0, 1.0, 2.0], 1e-5)


def _damping(dice: Dice) -> Judged:
    """Rods that lose from next to nothing to all of a vibration within a part of its period."""
    rod = _rod(dice, 200.0)
    model = channel_rod(rod, 3 * rod.diameter, 0.5)
    x, half = pack(model.x), model.n_x // 2
    rates = model.ode[half:]
    others = [s for s in ca.symvar(ca.vertcat(model.ode)) if s.name() not in _names(x)]
    p = pack(model.p)
    named = {signal.name: signal.symbol for signal in model.p}
    rates = ca.substitute(rates, ca.vertcat(*_outside(others, p)), 0)
    call = ca.Function("matrices", [x, p], [ca.jacobian(rates, x)])
    first = float(_beam(rod, ("moment", "shear"), 1)[0])
    share = spread(dice, 1e-6, 1e3)
    values = {"youngs_modulus": rod.youngs_modulus, "density": rod.density,
              "damping_time": share / first, "friction": 0.5}  # fmt: skip
    straight = np.concatenate([rod.nodes, np.zeros(5 * rod.count)])
    J = np.array(call(straight, [values[name] for name in named]))
    K, D = -J[:, :half], -J[:, half:]
    n = rod.count
    K, D = K[n:, n:], D[n:, n:]  # across and angles: these are coupled
    s = np.linalg.eigvals(D).real
    # of one mode: s² + t w² s + w² = 0 with t w² the eigenvalue of D
    wanted = share * first
    yield "damping", apart(s[np.argmin(abs(s - wanted))] / wanted, 1.0, 1e-4)
    yield "goes with stiffness", apart(D * first / share, K, 1e-9)


def _names(x: ca.SX) -> set[str]:
    return {x[i].name() for i in range(x.numel())}


def _outside(symbols: list[ca.SX], p: ca.SX) -> list[ca.SX]:
    """Forces and inputs: symbols that are no parameters."""
    own = _names(p)
    return [symbol for symbol in symbols if symbol.name() not in own]


def _no_body(dice: Dice) -> Judged:
    """Sizes that no body in a channel has."""
    more = 1 + spread(dice, 1e-3, 1e2)
    yield "thick", refused(lambda: ChannelWorm(1.0, 1.0, more, 9.0), "body must be less")
    yield "short", refused(lambda: ChannelWorm(more, 2.0, 1.0, 1.0), "length must be at least")
    yield "steep", refused(lambda: ChannelWorm(1.0, 1 + 10 * more, 1.0, 9.0), "channel - body")
    worm = ChannelWorm(1.0, 1 + SLEEVE_RISE * (1 + spread(dice, 1e-6, 1.0)), 1.0, 9.0)
    yield "sleeve", refused(lambda: elastic_shape(worm, "sleeve", 64), "thicker body")
    yield "rise", refused(lambda: exact_elastica("sleeve", SLEEVE_RISE * more), "rise", "1.66")
    yield "length", refused(lambda: Rod(-more, 1.0, 1.0, 1.0), "length must be positive")
    yield "volume", refused(lambda: Rod(1, 1, 1, 1, poisson_ratio=more), "poisson_ratio", "0.5")
    yield "skin", refused(lambda: Rod(1, 1, 1, 1, skin=more), "skin", "write at most")
    rod = Rod(1.0, 1.0, 1.0, 1.0, elements=1)
    yield "room", refused(lambda: channel_rod(rod, 1 / more, 0.5), "diameter", "channel")
