"""Patterns of currents that travel along a row of coils, and the speed of a float under them.

All coils have one waveform, delayed by one step from coil to coil: the pattern moves by a coil per
step. It has `per_step` values per step, which hold, or are corners of a polyline. A current between
two corners lies between theirs and its slope is that of the chord, so limits at the corners are
limits at all times.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Literal

import casadi as ca
import numpy as np

from wormopt.errors import SolveError, interruptible
from wormopt.magnetics.coils import CoilRow
from wormopt.model.gait import Gait
from wormopt.numerics.expressions import Call
from wormopt.ocp.nlp import Ipopt
from wormopt.systems.coils.film import FilmSetup, Float, Layer
from wormopt.systems.coils.film_code import compiled, of_piece
from wormopt.systems.coils.row_currents import TravellingTarget, fit_currents
from wormopt.systems.film import CosineWave, Fluid

Form = Literal["ramps", "steps"]
_MARGIN, _PLACES = 3, 3
_STEPS = 1000
_RADAU = 1e-5


@dataclass(frozen=True, eq=False)
class Pattern:
    """Waveform of one coil over a period, after which the pattern repeats."""

    values: np.ndarray  # (repeat * per_step,) ampere-turns of coil 0, equidistant from time 0 on
    rate: float  # steps per second
    per_step: int  # values per step
    form: Form = "ramps"  # corners of a polyline, or values that hold

    @property
    def repeat(self) -> int:
        """Number of coils after which the pattern repeats."""
        return len(self.values) // self.per_step

    def at(self, k: np.ndarray, count: int) -> np.ndarray:
        """Return ampere-turns (count, len(k)) of the coils, values k."""
        own = k - self.per_step * np.arange(count)[:, None]
        return self.values[own % len(self.values)]

    def pieces(self, count: int, time: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return ampere-turns (count, pieces) at the start of each piece, slopes, and durations.

        Slopes are in ampere-turns per second, durations in s; the last piece ends at `time`.
        """
        whole = 1 / (self.rate * self.per_step)
        k = np.arange(max(1, math.ceil(time / whole - 1e-9)))
        begin = self.at(k, count)
        growth = self.at(k + 1, count) - begin if self.form == "ramps" else np.zeros_like(begin)
        lengths = np.full(len(k), whole)
        lengths[-1] = time - whole * k[-1]
        return begin, growth / whole, lengths

    def course(self, count: int) -> Gait:
        """Return the ampere-turns of all coils over a period."""
        begin, slopes, lengths = self.pieces(count, self.repeat / self.rate)
        breaks = lengths[0] * np.arange(len(self.values) + 1)
        return Gait(breaks, np.stack([begin.T, slopes.T], axis=2))

    @property
    def largest(self) -> float:
        """Largest ampere-turns, at all times."""
        return float(np.abs(self.values).max())

    @property
    def slew(self) -> float:
        """Largest slope of a current, in ampere-turns per second; infinite if it jumps."""
        jump = float(np.abs(np.diff(self.values, append=self.values[0])).max())
        if self.form == "steps":
            return np.inf if jump else 0.0
        return jump * self.rate * self.per_step

    @property
    def square(self) -> float:
        """Mean square of a coil's ampere-turns over a period."""
        one = self.values
        if self.form == "steps":
            return float(np.mean(one**2))
        other = np.roll(one, -1)
        return float(np.mean(one**2 + one * other + other**2) / 3)

    def later(self, share: float) -> Pattern:
        """Return the pattern delayed by a share of its period, to the nearest value."""
        return replace(self, values=np.roll(self.values, round(share * len(self.values))))

    def paced(self, share: float, rates: tuple[float, float]) -> Pattern:
        """Return the pattern at a multiple of its rate, within the range of rates."""
        return replace(self, rate=float(np.clip(share * self.rate, *rates)))

    def kept(self, limit: float, slew: float | None = None) -> Pattern:
        """Return the pattern within limits: too large values cut, too steep ones scaled to 0."""
        kept = replace(self, values=np.clip(self.values, -limit, limit))
        if slew is None or kept.slew <= slew:
            return kept
        return replace(kept, values=kept.values * (slew / kept.slew))


def block(on: int, amount: float, rate: float, repeat: int, per_step: int, form: Form) -> Pattern:
    """Return blocks of active coils: jumps as `magnetics.switched_course`, or ramps of a piece."""
    behind = -np.arange(repeat * per_step) % (repeat * per_step)
    lit = behind < on * per_step if form == "ramps" else (-(-behind // per_step)) % repeat < on
    return Pattern(np.where(lit, amount, 0.0), rate, per_step, form)


# -- currents by the mean field --------------------------------------------------------------------


def wave_pattern(
    layer: Layer, row: CoilRow, ground: float, delta: float, rate: float, repeat: int,
    per_step: int, *, form: Form = "ramps", slew: float | None = None,
) -> Pattern | None:  # fmt: skip
    """Return currents whose mean field holds a cosine wave of amplitude `delta`, or None.

    The wave is `repeat` coils long. The field is that at the surface of the flat film, with its
    magnetisation in weak fields. The wave first, then its currents: the two designs ignore the
    ripple and ends of a row, and the effect of the float on the film.
    """
    magnet, wavelength = layer.fluid, repeat * row.pitch
    chi = magnet.magnetisation.chi
    turn = 2 * math.pi * rate / repeat
    film = Fluid(
        mu_r=1 + chi, viscosity=layer.viscosity, density=magnet.density,
        surface_tension=magnet.surface_tension, depth=layer.depth, wavelength=wavelength,
        frequency=turn,
    )  # fmt: skip
    wave, unit = CosineWave(delta), float(film.field(1.0)) ** 2
    # the weight of a wave of one harmonic acts like a tension
    held = film.tension + magnet.weight * layer.depth / film.pressure
    target = TravellingTarget(
        lambda xi: unit * np.asarray(wave.field_function(xi, held)),
        unit * wave.peak(held).value,
        wavelength,
        repeat / rate,
    )
    margin = min(_MARGIN, (row.count - 2) // 2)
    low, high = row.places[margin], row.places[-1 - margin]
    places = np.linspace(low, high, _PLACES * (row.count - 1 - 2 * margin) + 1)
    try:
        fit = fit_currents(
            row, target, places, ground + layer.depth, nodes=repeat * per_step, slew=slew,
            starts=3, options=Ipopt(),
        )  # fmt: skip
    except SolveError:
        return None
    return Pattern(_held(fit.nodes, form), rate, per_step, form)


def _held(nodes: np.ndarray, form: Form) -> np.ndarray:
    """Return corners of a polyline; for values that hold, the means of its pieces."""
    return nodes if form == "ramps" else (nodes + np.roll(nodes, -1)) / 2


# -- the float -------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Rides(FilmSetup):
    """A float on a film over a row, for a given time from a flat film, under patterns.

    The Model is that of one piece of a pattern, its length and field as parameters: one
    integrator serves all pieces of all patterns.
    """

    cargo: Float
    time: float  # s
    tolerance: float = 1e-3

    def speed(self, pattern: Pattern) -> float:
        """Return the mean speed in m/s; minus infinity if the simulation fails or leaves `top`."""
        state, solver, field = np.zeros(self.layer.cells + 1), _solver(self), self.field
        state[-2] = self.start / self.cargo.length
        for begin, slope, length in zip(
            *(part.T for part in pattern.pieces(self.row.count, self.time)), strict=True
        ):
            inputs = np.concatenate([[length], field.terms(begin), field.terms(slope * length)])
            try:
                with interruptible():
                    state = np.array(solver(x0=state, p=inputs)["xf"]).ravel()
            except RuntimeError:
                return -np.inf
            # volumes are in units of that of a flat cell
            high = self.layer.depth * (1 + np.diff(state[:-2], prepend=0.0, append=0.0).max())
            if not np.all(np.isfinite(state)) or high > self.top:
                return -np.inf
        return float(state[-2] * self.cargo.length - self.start) / self.time


@lru_cache(maxsize=2)
def _solver(rides: Rides) -> ca.Function:
    """Return the integrator over a piece, from 0 to 1; states of nominal size 1."""
    options = {
        "reltol": rides.tolerance, "abstol": rides.tolerance, "max_num_steps": _STEPS,
        "min_step_size": 1e-12, "disable_internal_warnings": True, "show_eval_warnings": False,
    }  # fmt: skip
    count = rides.field.terms(np.zeros(rides.row.count)).size
    equations = compiled(rides, of_piece(count)) or _by_interpreter(rides)
    return ca.integrator("ride", "cvodes", equations, 0.0, 1.0, options)


def _by_interpreter(rides: Rides) -> dict[str, ca.SX]:
    film = rides.model_by_terms()
    moved = film.x[:3]  # volume, position, velocity; further states are not needed
    states = ca.vertcat(*(one.symbol for one in moved))
    scale = np.concatenate([np.full(one.size, one.nominal) for one in moved])
    terms = film.u[0]
    x, t, p = ca.SX.sym("x", len(scale)), ca.SX.sym("t"), ca.SX.sym("p", 2 * terms.size + 1)
    length, begin, growth = ca.vertsplit(p, [0, 1, terms.size + 1, p.numel()])
    (ode,) = ca.substitute(
        [film.ode[: len(scale)]], [states, terms.symbol], [x * scale, begin + growth * t]
    )
    return {"t": t, "x": x, "p": p, "ode": ca.cse(ode / scale * length)}


def travel_by_radau(rides: Rides, pattern: Pattern) -> float:
    """Return the float's displacement in m by SciPy's Radau, from corner to corner.

    The Model's equations are in SI, with time in s.
    """
    from scipy.integrate import solve_ivp  # needed by checks only
    from scipy.sparse import csc_array

    film, field = rides.model_by_terms(), rides.field
    x = ca.vertcat(*(one.symbol for one in film.x[:3]))
    scale = np.concatenate([np.full(one.size, one.nominal) for one in film.x[:3]])
    given, ode = [x, film.u[0].symbol], film.ode[: len(scale)]
    by_state = ca.jacobian(ode, x)
    rate, slopes = (Call(ca.Function("f", given, [part])) for part in (ode, by_state.nz[:]))
    rows, columns = by_state.row(), by_state.sparsity().colind()
    state = np.zeros(len(scale))
    state[-2] = rides.start
    pieces = (part.T for part in pattern.pieces(rides.row.count, rides.time))
    for begin, slope, length in zip(*pieces, strict=True):
        first, growth = field.terms(begin), field.terms(slope)

        def terms(t: float, first: np.ndarray = first, growth: np.ndarray = growth) -> np.ndarray:
            return first + growth * t

        found = solve_ivp(
            lambda t, x, now=terms: rate(x, now(t))[0].copy(), (0.0, length), state,
            method="Radau", rtol=_RADAU, atol=_RADAU * scale,
            jac=lambda t, x, now=terms: csc_array((slopes(x, now(t))[0].copy(), rows, columns)),
        )  # fmt: skip
        if not found.success:
            return float("nan")
        state = found.y[:, -1]
    return float(state[-2] - rides.start)
