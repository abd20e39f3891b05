"""The verb `average`: replaces a Model with small changes per period by one without the period.

x' = f(x, t) with small f of period T is, averaged, y' = F(y). To first order F is the mean of f
over a period at fixed y. To second order x = y + u(y, t) with u the integral of f - F that has no
mean, and F gains the mean of (df/dx) u [1]. Where a contact's velocity changes sign, f jumps, and
df/dx holds the jump times the shift of its place, -(dv/dx u) / (dv/dt) [2].

With theta in [0, 1] as the elapsed share of the period, a contact's velocity is a trigonometric
polynomial c_0 + sum_k (a_k cos(2 pi k theta) + b_k sin(2 pi k theta)) with coefficients that
depend on the slow states. Its sign changes are computed, not sampled:

- One harmonic, of order k, has 2 k of them, in closed form.
- Several harmonics of a fixed shape g, velocity = A + B g(theta): between two extrema of g, which
  are numbers, the velocity is monotonic and has one at most. It is bracketed by bisection and
  sharpened by Newton's method, all as one expression, so that its derivatives are exact too.

References
----------
[1] J. A. Sanders, F. Verhulst, J. Murdock, Averaging Methods in Nonlinear Dynamical Systems,
    2nd ed., Springer 2007, chapter 2.
[2] J. Llibre, D. D. Novaes, M. A. Teixeira, Higher order averaging theory for finding periodic
    solutions via Brouwer degree, Nonlinearity 27 (2014) 563-583, for smooth f; its jumps follow by
    letting their width tend to 0.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from numbers import Integral, Real
from typing import Literal

import casadi as ca
import numpy as np

from wormopt.errors import ArgumentError
from wormopt.model.model import Model, Output, pack
from wormopt.model.planar_friction import PlanarLaw
from wormopt.model.values import nominal_of, signal_values
from wormopt.numerics.collocation import Collocation

_HALVINGS = 30  # leaves 1e-9 of the bracket, which two Newton steps square twice
_NEGLIGIBLE = 1e-12
_BESIDE = 1e-2  # of the unit circle: effect of round-off on a fivefold zero
_MOST = 31  # harmonics
_ELSEWHERE = np.array([0.07, 0.3, 0.61, 0.88])  # shares of the period at which harmonics differ


@dataclass(frozen=True, eq=False)
class Crossing:
    """A place where a velocity may change its sign."""

    place: ca.SX  # share theta of the period, in [0, 1)
    real: ca.SX  # 1: sign change; 0: none, and `place` is arbitrary
    rising: ca.SX  # 1: velocity becomes positive; 0: negative


@dataclass(frozen=True, eq=False)
class Wave:
    """A velocity over one period as a trigonometric polynomial."""

    mean: ca.SX  # coefficient c_0
    cosines: ca.SX  # (K, 1) coefficients of the harmonics 1 to K
    sines: ca.SX  # (K, 1) coefficients of the harmonics 1 to K

    @property
    def degree(self) -> int:
        """Number of harmonics K."""
        return self.cosines.numel()

    def __call__(self, theta: ca.SX | float) -> ca.SX:
        """Velocity at the share `theta` of the period."""
        angle = 2 * np.pi * theta * ca.DM(np.arange(1, self.degree + 1))
        return self.mean + ca.dot(self.cosines, ca.cos(angle)) + ca.dot(self.sines, ca.sin(angle))

    def slope(self, theta: ca.SX | float) -> ca.SX:
        """Derivative of the velocity by theta, the elapsed share of the period."""
        order = 2 * np.pi * ca.DM(np.arange(1, self.degree + 1))
        turn = order * theta
        return ca.dot(order, self.sines * ca.cos(turn) - self.cosines * ca.sin(turn))

    @classmethod
    def of(cls, velocity: ca.Function, symbols: ca.SX, values: np.ndarray) -> Wave:
        """Shortest wave equal to `velocity`, a function (symbols, theta) -> velocity.

        `values` (n, m): numbers for `symbols` (n, 1) that show which harmonics are present.
        """
        degree = _harmonics_in(velocity, values)
        count = 2 * degree + 2
        grid = np.arange(count) / count
        samples = ca.vertcat(*(velocity(symbols, theta) for theta in grid))
        turns = 2 * np.pi * np.outer(np.arange(1, degree + 1), grid)
        # exact zeros of cosines instead of 6e-17 omit coefficients that are 0
        table = np.vstack([np.cos(turns), np.sin(turns)]) * 2 / count
        table[np.abs(table) < _NEGLIGIBLE] = 0.0
        harmonics = ca.mtimes(ca.DM(table), samples)
        return cls(ca.sum1(samples) / count, harmonics[:degree], harmonics[degree:])

    def crossings(self, symbols: ca.SX, values: np.ndarray) -> list[Crossing]:
        """Find the sign changes of a velocity that depends on theta.

        `values` (n, m): numbers for `symbols` (n, 1), on which the coefficients depend.
        """
        there = self._there(symbols, values)
        if len(there) == 1:
            return self._of_one_harmonic(int(there[0]) + 1)
        return self._of_a_shape(symbols, values)

    def _harmonics(self, symbols: ca.SX, values: np.ndarray) -> np.ndarray:
        """Harmonics as complex numbers, a column for each of the samples."""
        parts = ca.horzcat(self.cosines, self.sines)
        both = ca.Function("harmonics", [symbols], [parts, self.mean])
        found = []
        for column in values.T:
            swing, mean = map(np.array, both(column))
            swing[np.abs(swing) <= _NEGLIGIBLE * np.abs(mean)] = 0.0  # rounding errors of 0
            found.append(swing @ (1, -1j))
        return np.stack(found, axis=1)

    def _there(self, symbols: ca.SX, values: np.ndarray) -> np.ndarray:
        sizes = np.abs(self._harmonics(symbols, values))
        return np.flatnonzero((sizes > _NEGLIGIBLE * sizes.max(axis=0)).any(axis=1))

    def _of_one_harmonic(self, order: int) -> list[Crossing]:
        cosine, sine = self.cosines[order - 1], self.sines[order - 1]
        size = ca.sqrt(cosine**2 + sine**2)
        real = ca.fabs(self.mean) < size
        # the guards keep derivatives finite where there is no sign change
        share = ca.if_else(real, -self.mean / ca.if_else(real, size, 1), 0)
        top = ca.atan2(ca.if_else(real, sine, 0), ca.if_else(real, cosine, 1))
        half = ca.acos(share)
        return [
            Crossing(_turned((turn / (2 * np.pi) + k) / order), real, ca.SX(rising))
            for k in range(order)
            for turn, rising in ((top - half, 1), (top + half, 0))
        ]

    def _of_a_shape(self, symbols: ca.SX, values: np.ndarray) -> list[Crossing]:
        extrema = _extrema(self._shape(symbols, values))
        found = []
        for low, high in pairwise([*extrema, extrema[0] + 1]):
            at_low, at_high = self(low), self(high)
            real = at_low * at_high < 0
            place = self._bracketed(low, high, at_low)
            for _ in range(2):
                slope = ca.if_else(real, self.slope(place), 1)
                place = ca.if_else(real, place - self(place) / slope, (low + high) / 2)
            found.append(Crossing(_turned(place), real, at_high > 0))
        return found

    def _shape(self, symbols: ca.SX, values: np.ndarray) -> np.ndarray:
        """Harmonics as complex numbers, which may depend on states by one common factor only."""
        found = self._harmonics(symbols, values).T
        shape = next(harmonics for harmonics in found if np.any(harmonics))
        for harmonics in found:
            # the factor is real: a complex one would turn all harmonics by one angle, which is no
            # shift in time
            factor = np.vdot(shape, harmonics).real / np.vdot(shape, shape).real
            if np.abs(harmonics - factor * shape).max() > 1e-9 * np.abs(harmonics).max():
                raise ArgumentError(
                    "a contact velocity has several harmonics whose ratios depend on states or "
                    "parameters; only a common factor of all of them may do so"
                )
        return shape / np.abs(shape).max()

    def _bracketed(self, start: float, end: float, at_low: ca.SX) -> ca.SX:
        """Bisect a bracket; its derivative is 0, Newton's steps add that of the place."""
        low, high = ca.SX(start), ca.SX(end)
        for _ in range(_HALVINGS):
            middle = (low + high) / 2
            before = self(middle) * at_low > 0
            low, high = ca.if_else(before, middle, low), ca.if_else(before, high, middle)
        return (low + high) / 2


def sign_after(wave: Wave, crossings: Sequence[Crossing]) -> ca.SX:
    """Sign (+1 or -1) of a velocity at the beginning of the period, before any crossing."""
    # It is that after the last crossing, one period earlier; without any, that of the mean.
    last, sign = ca.SX(-1), ca.if_else(wave.mean < 0, -1, 1)
    for crossing in crossings:
        later = ca.logic_and(crossing.real, crossing.place > last)
        last = ca.if_else(later, crossing.place, last)
        sign = ca.if_else(later, 2 * crossing.rising - 1, sign)
    return sign


def _turned(place: ca.SX) -> ca.SX:
    """The place shifted to [0, 1), with its derivative."""
    turned = place - ca.floor(place)
    return turned - (turned >= 1)  # a place below 0 by less than round-off


def _harmonics_in(velocity: ca.Function, values: np.ndarray) -> int:
    """Highest harmonic present."""
    count = 2 * _MOST + 2
    samples = _sampled(velocity, values, np.arange(count) / count)
    spectrum = np.fft.rfft(samples, axis=1) / count
    sizes = np.abs(spectrum).max(axis=0)
    there = np.flatnonzero(sizes > _NEGLIGIBLE * max(sizes.max(), 1e-300))
    highest = int(there[-1]) if there.size else 0
    # harmonics above half the number of samples have aliases on them, and nowhere else
    turns = np.exp(2j * np.pi * np.outer(np.arange(len(sizes)), _ELSEWHERE))
    series = 2 * (spectrum @ turns).real - spectrum[:, :1].real
    off = np.abs(_sampled(velocity, values, _ELSEWHERE) - series).max()
    if highest > _MOST or off > 1e-9 * np.abs(samples).max():
        raise ArgumentError(
            f"contact velocities must be a mean and at most {_MOST} harmonics of the period; "
            "write their common period, and replace jumps and corners by smooth functions"
        )
    return highest


def _sampled(velocity: ca.Function, values: np.ndarray, theta: np.ndarray) -> np.ndarray:
    """Velocity at shares of the period (n,) for all columns of `values` (k, m): (m, n)."""
    count = values.shape[1]
    points, shares = np.repeat(values, len(theta), axis=1), np.tile(theta, count)
    return np.array(velocity(points, shares[None])).reshape(count, len(theta))


def _extrema(harmonics: np.ndarray) -> list[float]:
    """Extrema of Re sum_k c_k exp(2 pi i k theta), ascending in [0, 1)."""
    # With w = exp(2 pi i theta) its derivative is a polynomial in w over a power of w; extrema are
    # its roots on the unit circle. Multiple roots come out beside the circle; nearby roots that are
    # no extrema only split monotonic parts.
    slopes = 1j * np.arange(1, len(harmonics) + 1) * harmonics
    roots = np.roots(np.concatenate([slopes[::-1], [0.0], slopes.conj()]))
    on_circle = roots[np.abs(np.abs(roots) - 1) < _BESIDE]
    return np.sort(np.angle(on_circle) / (2 * np.pi) % 1.0).tolist()


# Parts of a period without reversals.
_PARTS = 8


_SHARES = (0.07, 0.3, 0.61, 0.88)  # of a period, at which a model is tested for periodicity


def average(
    model: Model,
    period: float | ca.SX,
    *,
    order: Literal[1, 2] = 1,
    nodes: int = 16,
) -> Model:
    """Average a model over the period of its time, split where contacts reverse.

    Parameters
    ----------
    model : Model
        In standard form: its states change little in a period, the field and the friction of
        `slow_pair` say are small. Velocities of contacts are a mean and harmonics of the period;
        of several harmonics, only a common factor may depend on states and parameters.
    period : float or casadi.SX
        Period T, a number or an expression of the model's parameters. Schedules must repeat with
        it.
    order : {1, 2}, optional
        The error of the averaged motion over a time of order 1/size(f) is of this order in the
        size of f, if the averaged motion starts at x - u.
    nodes : int, optional
        Points of Gauss' quadrature on each piece between two reversals, or on an eighth of the
        period where there are no contacts. Dry friction under a few harmonics needs no more than
        16, laws that are steep over a part of the velocities do.

    Returns
    -------
    Model
        Autonomous, with the same states, parameters and inputs, and those outputs that do not
        depend on time. It has no contacts: sliding friction is averaged in; contacts must pass
        through velocity 0 without a rest. If a velocity is 0 at all times, friction opposes
        forward motion.

    Raises
    ------
    ArgumentError
        If the model is not periodic, has switches or algebraic variables, a contact does not swing
        or cannot slide both ways, or a velocity is of no such form.

    Examples
    --------
    A block on ground that shakes to and fro with the velocity cos(t), F+ = 0.01, F- = 0.02, drifts
    with the velocity at which the mean friction vanishes, sin(pi/6) = 1/2:

    >>> from wormopt.model.friction import Coulomb
    >>> from wormopt.model.model import Contact, Signal
    >>> t, v, force = ca.SX.sym("t"), ca.SX.sym("v"), ca.SX.sym("f")
    >>> ground = Contact("block", v + ca.cos(t), force, Coulomb(0.01, 0.02))
    >>> block = Model("block", x=[Signal("v", v)], ode=force, t=t, contacts=[ground])
    >>> drift = average(block, 2 * np.pi)
    >>> abs(float(ca.Function("F", [v], [drift.ode])(0.5))) < 1e-17
    True
    """
    if order not in (1, 2):
        raise ArgumentError(f"order must be 1 or 2, not {order!r}")
    if isinstance(nodes, bool) or not isinstance(nodes, Integral) or nodes < 1:
        raise ArgumentError(f"nodes must be a whole number, 1 or above, not {nodes!r}")
    course = _Course(_checked(model), _checked_period(period), int(nodes))
    ode = course.mean if order == 1 else course.mean + course.second
    return Model(
        f"{model.name}, averaged",
        x=model.x,
        ode=ode,
        u=model.u,
        p=model.p,
        outputs=[output for output in model.outputs if not course.depends(output)],
    )


def _checked(model: Model) -> Model:
    if not isinstance(model, Model):
        raise ArgumentError(f"model must be a Model, not {type(model).__name__}")
    if model.switches or model.z:
        what = "has switches or algebraic variables and cannot be averaged"
        raise ArgumentError(f"{model.name} {what}")
    for contact in model.contacts:
        if isinstance(contact.law, PlanarLaw):
            raise ArgumentError(f"{contact.name} moves in the plane and cannot be averaged")
        if set(contact.law.directions) != {1, -1}:
            raise ArgumentError(f"{contact.name} must slide both ways to be averaged")
    return model


def _checked_period(period: object) -> ca.SX:
    if isinstance(period, Real) and 0 < float(period) < math.inf:
        return ca.SX(float(period))
    if not isinstance(period, ca.SX) or period.numel() != 1:
        raise ArgumentError(
            f"period must be a positive number or an expression of parameters, not {period!r}"
        )
    return period


@dataclass(frozen=True, eq=False)
class _Piece:
    """A part of the period on which all contacts keep their direction."""

    start: ca.SX  # as a share of the period
    end: ca.SX  # as a share of the period
    before: ca.SX  # directions of the contacts before the start
    signs: ca.SX  # directions of the contacts on the piece
    reversed: ca.SX  # 1 for the contact that reverses at the start; else 0
    scheduled: np.ndarray  # values of the schedules' symbols


class _Course:
    """A model over one period: its pieces, and the means over them."""

    def __init__(self, model: Model, period: ca.SX, nodes: int) -> None:
        model.refuse_delays("averaging")
        self.model, self.period = model, period
        self.rule = Collocation(nodes)
        self.x, self.fixed = pack(model.x), ca.vertcat(pack(model.p), pack(model.u))
        self.theta = ca.SX.sym("theta")
        self.signs = ca.SX.sym("signs", len(model.contacts))
        symbols = [s for schedule in model.schedules for s in (schedule.begin, schedule.symbol)]
        self.scheduled = ca.vertcat(ca.SX(0, 1), *symbols)
        self._check_period()

    def depends(self, output: Output) -> bool:
        """Whether an output depends on more than states, parameters and inputs."""
        others = ca.vertcat(self.model.t, self.model.forces, self.scheduled)
        return bool(ca.depends_on(output.expression, others))

    def _in_share(self, expression: ca.SX) -> ca.SX:
        return ca.substitute(expression, self.model.t, self.period * self.theta)

    # -- functions of one instant ------------------------------------------------------------------

    @cached_property
    def _velocities(self) -> ca.SX:
        return self._in_share(self.model.contact_velocities)

    @cached_property
    def _rates(self) -> ca.SX:
        """The ode with sliding friction in the directions ``signs``."""
        sliding = []
        for i, contact in enumerate(self.model.contacts):
            v, ahead = self._velocities[i], self.signs[i] > 0
            slip = contact.law.slip_force
            sliding.append(ca.if_else(ahead, slip(v, 1), slip(v, -1)))
        ode = self._in_share(self.model.ode)
        return ca.substitute(ode, self.model.forces, ca.vertcat(ca.SX(0, 1), *sliding))

    def _function(self, name: str, expression: ca.SX, *more: ca.SX) -> ca.Function:
        given = [self.x, self.fixed, self.theta, self.signs, self.scheduled, *more]
        return ca.Function(name, given, [expression])

    def _at(
        self, function: ca.Function, piece: _Piece, theta: ca.SX, signs: ca.SX, *more: ca.SX
    ) -> ca.SX:
        return function(self.x, self.fixed, theta, signs, piece.scheduled, *more)

    # -- pieces ------------------------------------------------------------------------------------

    @cached_property
    def pieces(self) -> list[_Piece]:
        """Pieces in their order."""
        waves = [self._wave(i) for i in range(len(self.model.contacts))]
        symbols, values = self._samples_of_waves
        crossings = [wave.crossings(symbols, values) for wave in waves]
        signs = ca.vertcat(
            ca.SX(0, 1), *(sign_after(w, c) for w, c in zip(waves, crossings, strict=True))
        )
        found: list[_Piece] = []
        for low, high, scheduled in self._segments():
            places = _sorted([*_within(crossings, low, high)])
            starts = [(ca.SX(low), ca.SX.zeros(len(waves))), *places]
            ends = [*(place for place, _ in places), ca.SX(high)]
            for (start, reversing), end in zip(starts, ends, strict=True):
                before, signs = signs, signs * (1 - 2 * reversing)
                found.append(_Piece(start, end, before, signs, reversing, scheduled))
        return found

    @cached_property
    def _samples(self) -> tuple[ca.SX, np.ndarray]:
        """Symbols of states and constants, and sample values for them."""
        fixed = np.concatenate([signal_values(s, None, "parameter", fill=1.0)
                                for s in (self.model.p, self.model.u)])  # fmt: skip
        random = np.random.default_rng(0)
        nominal = nominal_of(self.model.x)
        states = nominal[:, None] * random.uniform(0.2, 1.0, (len(nominal), 3))
        return ca.vertcat(self.x, self.fixed), np.vstack([states, np.tile(fixed, (3, 1)).T])

    @cached_property
    def _samples_of_waves(self) -> tuple[ca.SX, np.ndarray]:
        """Samples including some without zeros: a harmonic that is 0 now may appear later."""
        symbols, values = self._samples
        there = np.where(
            values == 0, np.random.default_rng(1).uniform(0.2, 1.0, values.shape), values
        )
        repeats = self._repeats(self._velocities, there)
        return symbols, np.hstack([values, there]) if repeats else values

    def _wave(self, i: int) -> Wave:
        contact, velocity = self.model.contacts[i], self._velocities[i]
        if self.scheduled.numel() and ca.depends_on(velocity, self.scheduled):
            raise ArgumentError(
                f"the velocity of {contact.name} depends on a schedule; only forces may do so"
            )
        symbols, values = self._samples_of_waves
        wave = Wave.of(ca.Function("velocity", [symbols, self.theta], [velocity]), symbols, values)
        if wave.degree == 0:
            raise ArgumentError(f"{contact.name} does not swing: its velocity has no period")
        return wave

    def _segments(self) -> Iterator[tuple[float, float, np.ndarray]]:
        """Shares of the period between breaks of schedules, and the values there."""
        if not self.model.schedules:
            count = 1 if self.model.contacts else _PARTS
            for k in range(count):
                yield k / count, (k + 1) / count, np.zeros(0)
            return
        period = float(self.period)
        for low, high in pairwise(self.model.breaks(period)):
            values = []
            for schedule in self.model.schedules:
                begin, (piece,) = schedule.locate(np.array([(low + high) / 2]))
                values += [begin, schedule.values[piece]]
            yield low / period, high / period, np.concatenate(values)

    def _check_period(self) -> None:
        symbols = ca.vertcat(*(p.symbol for p in self.model.p), ca.SX(0, 1))
        free = [s for s in ca.symvar(self.period) if not ca.depends_on(symbols, s)]
        if free:
            raise ArgumentError("the period must be a number or an expression of parameters")
        for schedule in self.model.schedules:
            turns = float(self.period) / schedule.breaks[-1] if self.period.is_constant() else 0.5
            if not schedule.periodic or abs(turns - round(turns)) > 1e-12 or round(turns) < 1:
                raise ArgumentError(
                    f"schedule {schedule.name} does not repeat with the period; give a period "
                    "that is a whole multiple of it, as a number"
                )
        if not self.model.schedules:
            self._check_repetition()

    def _check_repetition(self) -> None:
        both = ca.vertcat(self._in_share(self.model.ode), self._velocities)
        forces = ca.DM.ones(len(self.model.contacts))
        if not self._repeats(ca.substitute(both, self.model.forces, forces), self._samples[1]):
            raise ArgumentError(f"{self.model.name} does not repeat after the period given")

    def _repeats(self, expression: ca.SX, values: np.ndarray) -> bool:
        """Whether an expression of share, states and constants is periodic, by samples."""
        course = ca.Function("course", [self._samples[0], self.theta], [expression])
        pairs = [[np.array(course(values, theta + turn)) for turn in (0, 1)] for theta in _SHARES]
        size = max(float(np.abs(now).max(initial=0.0)) for now, _ in pairs)
        return all(np.abs(later - now).max(initial=0.0) <= 1e-9 * size for now, later in pairs)

    # -- means -------------------------------------------------------------------------------------

    @cached_property
    def _samples_on_pieces(self) -> list[ca.SX]:
        """Rates at the nodes of every piece, one column per node."""
        rates = self._function("rates", self._rates)
        return [
            ca.horzcat(
                *(self._at(rates, piece, theta, piece.signs) for theta in self._nodes(piece))
            )
            for piece in self.pieces
        ]

    def _nodes(self, piece: _Piece) -> list[ca.SX]:
        return [piece.start + (piece.end - piece.start) * tau for tau in self.rule.tau]

    @cached_property
    def mean(self) -> ca.SX:
        """First order: the mean of the rates."""
        weights = ca.DM(self.rule.B)
        parts = [
            (piece.end - piece.start) * ca.mtimes(rates, weights)
            for piece, rates in zip(self.pieces, self._samples_on_pieces, strict=True)
        ]
        return sum(parts[1:], parts[0])

    @cached_property
    def _swings(self) -> list[tuple[ca.SX, ca.SX]]:
        """The part u of x without mean, at the start and at the nodes of every piece."""
        start, total, found = ca.SX.zeros(self.model.n_x), ca.SX.zeros(self.model.n_x), []
        for piece, rates in zip(self.pieces, self._samples_on_pieces, strict=True):
            length = self.period * (piece.end - piece.start)
            excess = rates - ca.repmat(self.mean, 1, self.rule.degree)
            inside = ca.repmat(start, 1, self.rule.degree)
            inside += length * ca.mtimes(excess, ca.DM(self.rule.A.T))
            total += (piece.end - piece.start) * ca.mtimes(inside, ca.DM(self.rule.B))
            found.append((start, inside))
            start = start + length * ca.mtimes(excess, ca.DM(self.rule.B))
        return [(s - total, n - ca.repmat(total, 1, self.rule.degree)) for s, n in found]

    @cached_property
    def second(self) -> ca.SX:
        """Second order: the mean of (df/dx) u, jumps of f included."""
        du = ca.SX.sym("u", self.model.n_x)
        along = self._function("along", ca.jtimes(self._rates, self.x, du), du)
        found = ca.SX.zeros(self.model.n_x)
        for piece, (at_start, at_nodes) in zip(self.pieces, self._swings, strict=True):
            for j, theta in enumerate(self._nodes(piece)):
                weight = (piece.end - piece.start) * self.rule.B[j]
                found += weight * self._at(along, piece, theta, piece.signs, at_nodes[:, j])
            if not piece.reversed.is_zero():
                found += self._jump(piece, at_start)
        return found

    def _jump(self, piece: _Piece, u: ca.SX) -> ca.SX:
        """Effect of a reversal that shifts with u."""
        du = ca.SX.sym("u", self.model.n_x)
        v = self._velocities
        shifts = ca.horzcat(ca.jtimes(v, self.x, du), ca.jacobian(v, self.theta))
        found = self._at(self._function("shift", shifts, du), piece, piece.start, piece.signs, u)
        change, slope = ca.vertsplit(ca.mtimes(piece.reversed.T, found).T)
        real = ca.sum1(piece.reversed)
        shift = -change / ca.if_else(real, slope, 1)
        rates = self._function("rates", self._rates)
        before = self._at(rates, piece, piece.start, piece.before)
        return (before - self._at(rates, piece, piece.start, piece.signs)) * shift


def _within(
    crossings: Sequence[Sequence[Crossing]], low: float, high: float
) -> Iterator[tuple[ca.SX, ca.SX]]:
    """Places of crossings in a segment, and reversing contacts; others are at its start."""
    for i, own in enumerate(crossings):
        unit = ca.SX.zeros(len(crossings))
        unit[i] = 1
        for crossing in own:
            inside = ca.logic_and(crossing.place >= low, crossing.place < high)
            real = ca.logic_and(crossing.real, inside)
            yield ca.if_else(real, crossing.place, low), real * unit


def _sorted(places: list[tuple[ca.SX, ca.SX]]) -> list[tuple[ca.SX, ca.SX]]:
    """Sort places by expressions, with their attributes."""
    # At ties exactly one order is taken, for places and contacts, so that derivatives are those
    # of one order; fmin and fmax would both take the derivative of the first.
    places = places.copy()
    for last in range(len(places) - 1, 0, -1):
        for k in range(last):
            (a, what_a), (b, what_b) = places[k], places[k + 1]
            ordered = a <= b
            places[k] = ca.if_else(ordered, a, b), ca.if_else(ordered, what_a, what_b)
            places[k + 1] = ca.if_else(ordered, b, a), ca.if_else(ordered, what_b, what_a)
    return places
