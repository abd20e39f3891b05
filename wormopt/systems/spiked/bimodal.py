"""The bimodal system (7) integrated in time with located events: a second route to every gait.

The period comes as arcs on which one mass leads and sigma keeps its sign. The worm glides
throughout an arc of sigma < 0; on an arc of sigma >= 0 a glide slows down steadily, ends at most
once, and then the spikes hold. So no event is missed between two steps, and the double zero of w
where a glide begins is the end of an arc, never an event inside one.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from wormopt.errors import ArgumentError, SolveError
from wormopt.model.gait import Gait
from wormopt.systems.spiked.arcs import TIE, Arc, DrivenWorm, Spell, Vectorised, cut_piece

_QUADRATURE = 1e-14  # relative to the integral of the largest value
_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(12)


@dataclass(frozen=True, eq=False)
class BimodalMotion:
    """Periodic motion of a worm with spikes."""

    advance: float  # distance per period
    speed: float  # advance / period
    # start, end in [0, T); past T it ends before it starts; (0, T): never ends
    glides: tuple[tuple[float, float], ...]
    # (time, masses resting from then on); the first at 0
    switches: tuple[tuple[float, frozenset[int]], ...]
    lambda_min: float  # of (7), mean spike load over masses, no impulses
    lambda_max: float  # as lambda_min
    lambda_mean: float  # over the period, impulses included
    impulses: tuple[tuple[float, float], ...]  # (time, size) on the spikes, summed over the masses
    resting_min: int  # fewest masses at rest together on any interval
    time: np.ndarray  # (events,) times of one period when something changes
    position: np.ndarray  # (events,) of the head
    glide: np.ndarray  # (events,) common velocity w, after a jump


def integrate(
    gait: Gait,
    mass: Sequence[float],
    drag: float,
    load: float,
    *,
    rtol: float = 1e-13,
    max_periods: int = 50,
) -> BimodalMotion:
    """Integrate (7) from w = 0 until periodic; return the last period. Raises SolveError.

    Unequal masses: mean(m) w' + k w + sigma = lambda, sigma = p' + k W0 + Γ, p the mean of
    m_i v_i at w = 0. Without load and drag w + const is a motion too. `rtol` ≥ 3e-14.
    """
    if len(mass) != gait.links + 1:
        raise ArgumentError(f"{len(mass)} masses on {gait.links} links")
    worm = DrivenWorm(gait, np.asarray(mass, dtype=float), drag, load)
    arcs = [arc for piece in range(gait.pieces) for arc in cut_piece(worm, piece)]
    w = 0.0
    for _ in range(max_periods):
        track = _Track(worm, w, rtol)
        for arc in arcs:
            track.run(arc)
        track.cross_corner(gait.pieces - 1, 0)
        if abs(track.w - w) <= 100 * rtol * worm.rate_scale:
            return track.motion()
        w = track.w
    raise SolveError(
        f"the worm's motion is not periodic after {max_periods} periods of the gait",
        "allow more periods, or give worm.drag or worm.load a larger value",
    )


class _Track:
    """One period on the way: where the worm is, how it moves and what was met."""

    def __init__(self, worm: DrivenWorm, w: float, rtol: float) -> None:
        self.worm, self.w, self.rtol = worm, w, rtol
        self.x = self.load_integral = 0.0
        self.lambdas: list[float] = []
        self.impulses: list[tuple[float, float]] = []
        self.events: list[tuple[float, float, float]] = [(0.0, 0.0, w)]
        self.spells: list[Spell] = []
        self.piece = 0

    def run(self, arc: Arc) -> None:
        """Move along an arc, gliding first if the worm glides or sigma pulls."""
        if arc.piece != self.piece:
            self.cross_corner(self.piece, arc.piece)
        held = self._glide(arc) if self.w > 0 or arc.pulls else arc.start
        if held < arc.end:
            self._hold(arc, held)

    def cross_corner(self, piece: int, following: int) -> None:
        """Keep the momentum between pieces, unless the spikes have to push."""
        worm, self.piece = self.worm, following
        jump = worm.momentum(following, 0.0) - worm.momentum(piece, worm.duration(piece))
        jump /= float(worm.mass.mean())
        if self.w == 0 and abs(jump) <= TIE * worm.rate_scale:
            return
        push, self.w = max(0.0, jump - self.w), max(0.0, self.w - jump)
        if push > TIE * worm.rate_scale:
            size = push * float(worm.mass.sum())
            self.impulses.append((float(worm.gait.breaks[following]), size))
            self.load_integral += size / len(worm.mass)
        self.events.append((self.events[-1][0], self.x, self.w))

    def _glide(self, arc: Arc) -> float:
        """Glide along an arc; returns when the glide ends, at the latest the arc's end."""
        from scipy.integrate import solve_ivp  # loads for long, and designed gaits never glide

        worm = self.worm
        mass = worm.mass.mean()

        def slope(s: float, state: np.ndarray) -> tuple[float, float]:
            w = float(state[1])
            lead, sigma = worm.held(arc.piece, arc.leader, np.array([s]))[:, 0]
            return lead + w, -(worm.drag * w + sigma) / mass

        def stop(_: float, state: np.ndarray) -> float:
            return state[1]

        # attributes that scipy reads; while sigma < 0 no glide ends
        vars(stop).update(terminal=True, direction=-1)
        solution = solve_ivp(
            slope,
            (arc.start, arc.end),
            (0.0, self.w),
            method="DOP853",
            events=None if arc.pulls else stop,
            rtol=self.rtol,
            atol=self.rtol * worm.rate_scale * np.array([worm.gait.period, 1.0]),
        )
        if solution.status < 0:
            raise SolveError(
                f"a glide of the worm could not be integrated ({solution.message})",
                "loosen rtol",
            )
        end = float(solution.t[-1])
        self.x += float(solution.y[0, -1])
        self.w = max(0.0, float(solution.y[1, -1])) if solution.status == 0 else 0.0
        self.lambdas.append(0.0)
        self._log(arc, arc.start, end, ())
        return end

    def _hold(self, arc: Arc, start: float) -> None:
        """Rest on the spikes: w = 0, so that position and load are integrals of known functions.

        They are found by quadrature and not from the lengths and momenta of which they are the
        differences, so that lambda_mean = k speed + Gamma remains a check.
        """
        worm = self.worm

        def known(s: np.ndarray) -> np.ndarray:
            return worm.held(arc.piece, arc.leader, s)

        scale = np.array([worm.rate_scale, worm.force_scale])
        way, load = _integral(known, (start, arc.end), scale)
        self.x += float(way)
        self.load_integral += float(load)
        flat = TIE * worm.force_scale
        self.lambdas += _extremes(lambda s: known(s)[1], (start, arc.end), flat)
        self._log(arc, start, arc.end, arc.resting)

    def _log(self, arc: Arc, start: float, end: float, resting: tuple[int, ...]) -> None:
        begin = float(self.worm.gait.breaks[arc.piece])
        self.spells.append((begin + start, begin + end, resting))
        self.events.append((begin + end, self.x, self.w))

    def motion(self) -> BimodalMotion:
        """What was met, as a periodic motion."""
        period = self.worm.gait.period
        switches = _switches(self.spells, 1e-9 * period)
        time, position, glide = np.array(self.events).T
        return BimodalMotion(
            advance=self.x,
            speed=self.x / period,
            glides=_glides(self.spells),
            switches=switches,
            lambda_min=min(self.lambdas),
            lambda_max=max(self.lambdas),
            lambda_mean=self.load_integral / period,
            impulses=tuple(self.impulses),
            resting_min=min(len(resting) for _, resting in switches),
            time=time,
            position=position,
            glide=glide,
        )


def _integral(rows: Vectorised, ends: tuple[float, float], scale: np.ndarray) -> np.ndarray:
    """Integrate rows by Gauss' rule on ever more panels, until nothing changes but round-off."""
    (a, b), before = ends, np.full(len(scale), np.inf)
    for panels in (1, 2, 4, 8, 16, 32, 64, 128):
        width = (b - a) / panels
        s = a + width * (np.arange(panels)[:, None] + (_NODES + 1) / 2)
        value = width / 2 * (rows(s.ravel()) @ np.tile(_WEIGHTS, panels))
        if np.all(np.abs(value - before) <= _QUADRATURE * scale * (b - a)):
            break
        before = value
    return value


def _extremes(function: Vectorised, ends: tuple[float, float], flat: float) -> list[float]:
    """Smallest and largest value on an interval; variation below `flat` is not looked into."""
    s = np.linspace(*ends, 33)
    values = function(s)
    found = []
    for sign in (1.0, -1.0):
        at = int(np.argmin(sign * values))
        best = float(values[at])
        if 0 < at < len(s) - 1 and np.ptp(values) > flat:
            from scipy.optimize import fminbound

            lowest = fminbound(
                lambda t, sign=sign: sign * function(np.array([t]))[0],
                s[at - 1],
                s[at + 1],
                xtol=1e-9 * (ends[1] - ends[0]),
            )
            best = sign * min(sign * float(function(np.array([lowest]))[0]), sign * best)
        found.append(best)
    return found


def _switches(spells: list[Spell], shortest: float) -> tuple[tuple[float, frozenset[int]], ...]:
    """Times at which the resting set changes, spells below a length left out."""
    switches: list[tuple[float, frozenset[int]]] = []
    for start, end, masses in spells:
        resting = frozenset(masses)
        if end - start > shortest and (not switches or switches[-1][1] != resting):
            switches.append((start if switches else 0.0, resting))
    return tuple(switches)


def _glides(spells: list[Spell]) -> tuple[tuple[float, float], ...]:
    """Glides of the period; one that runs on past its end is one glide, not two."""
    glides: list[tuple[float, float]] = []
    for start, end, resting in spells:
        if resting:
            continue
        if glides and glides[-1][1] == start:
            start, _ = glides.pop()
        glides.append((start, end))
    period = spells[-1][1]
    if len(glides) > 1 and glides[0][0] == 0.0 and glides[-1][1] == period:
        glides = [*glides[1:-1], (glides[-1][0], glides[0][1])]
    return tuple(glides)
