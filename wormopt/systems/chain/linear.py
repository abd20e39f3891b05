"""Kind "linear": linear theory of a chain and of its tracker with a constant gain."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, ClassVar

from msgspec import field

from wormopt.errors import ArgumentError, Fault, Interrupted, SceneError, SolveError
from wormopt.result import NOT_RECHECKED, Check
from wormopt.study import (
    Given,
    checks,
    entry,
    facts,
    on_use,
    parts,
    positive,
    scalar,
    signal,
    stage,
    value,
    warnings,
    whole,
)
from wormopt.study.given import wrong_count
from wormopt.study.numerics import (
    Contacts,
    ExactContact,
    Tolerances,
    ToleranceTable,
)
from wormopt.study.types import FinitePerMass, per
from wormopt.systems.chain.tables import ChainTable, DerivativeTracker, FilterTracker
from wormopt.systems.chain.tracking import Tracking

with on_use():
    import casadi as ca
    import numpy as np

    from wormopt.analysis.bode import frequencies
    from wormopt.analysis.linearise import LinearModel, linearise
    from wormopt.analysis.normal_form import normal_form
    from wormopt.control.frozen import Complex, FrozenLoop, Margins, Task, least_gain, static_gains
    from wormopt.model.gait import Gait
    from wormopt.model.model import Model
    from wormopt.simulation.options import Exact
    from wormopt.systems.chain.frozen import (
        Frozen,
        bisect,
        settled,
        task_of,
        task_of_own,
        without_dry_friction,
    )
    from wormopt.systems.chain.tracked import Tracked, follow
    from wormopt.systems.shared.proof import CrossCheck, warnings_of_contact

MOST_LINKS = 12
"""Margins need the eigenvalues of large matrices many times."""
_STEPS = 15  # simulations of the bisection, about
_LONGEST = 2000  # periods after which a start must be forgotten, to be simulated so long
_AGREED = 1e-6  # poles and disk margins by two routes
_HARMONICS = 1e-3  # errors by harmonics and by simulation: kinks of the reference, samples


class Point(Given):
    """Operating point of the linearisation: links at rest length, contacts with the smooth law."""

    velocity: FinitePerMass = entry(
        "velocity of the masses; dry friction is a constant force where it is not 0",
        quantity="speed",
        default=0.0,
    )
    v_reg: float = positive(
        "speed", "width of the smooth friction law, whose slope at rest is finite", default=1 / 40
    )


class Gains(Given):
    """Gains at which the loop with frozen gain is analysed. Not allowed: `most` ≤ `least`."""

    least: float = positive("", "smallest *k*", default=1.0)
    most: float = positive("", "largest *k*", default=1000.0)
    count: int = whole(2, 500, "number of gains, evenly spaced in the logarithm", default=31)

    def faults_of_keys(self) -> Iterator[Fault]:
        if self.most <= self.least:
            yield "most", f"is not above gains.least = {self.least:g}; write more"


@dataclass(frozen=True)
class Response:
    """The chain at the operating point."""

    omega: np.ndarray = signal("angular_frequency", "omega", "angular frequency")
    magnitude: np.ndarray = signal("compliance", "link input omega", "|G|, link length over force")
    phase: np.ndarray = signal("angle", "link input omega", "phase of G")
    zero_real: np.ndarray = signal(
        "rate", "zero", "real parts of the zeros, without the shift of the whole chain"
    )
    zero_imag: np.ndarray = signal("rate", "zero", "imaginary parts of the zeros")
    pole_real: np.ndarray = signal(
        "rate", "pole", "real parts of the chain's poles, without the shift of the whole chain"
    )
    pole_imag: np.ndarray = signal("rate", "pole", "imaginary parts of the chain's poles")


@dataclass(frozen=True)
class Loops:
    """Loops with constant gain, over the gain."""

    gain: np.ndarray = signal("count", "gain", "frozen gain")
    loop_real: np.ndarray = signal("rate", "gain loop_pole", "real parts of the loop's poles")
    loop_imag: np.ndarray = signal("rate", "gain loop_pole", "imaginary parts of the loop's poles")
    gain_margins: np.ndarray = signal("count", "gain", "gain margin")
    phase_margins: np.ndarray = signal("angle", "gain", "phase margin")
    disk_margins: np.ndarray = signal("count", "gain", "disk margin")
    sensitivity_peaks: np.ndarray = signal("count", "gain", "largest |S|")
    error_linear: np.ndarray = signal("length", "gain", "largest error without dry friction")
    error_bound: np.ndarray = signal("length", "gain", "bound of the error with dry friction")


@dataclass(frozen=True)
class AtLearned:
    """The loop with the gain that the tracker reaches."""

    pole_slowest: float = value(
        "rate", "largest real part of the poles of the loop at `gain_learned`"
    )
    gain_margin: float | None = value(
        "count",
        "gain margin at `gain_learned`: factor, common to all inputs, up to which the loop is "
        "stable; unknown above 10⁶",
    )
    phase_margin: float = value(
        "angle",
        "phase margin at `gain_learned`: largest phase lag, common to all inputs, at which "
        "the loop is stable",
    )
    disk_margin: float = value(
        "count",
        "disk margin at `gain_learned`: 1 / max \\|*S* − ½\\|, for independent gains and lags "
        "of the inputs; at most 2",
    )
    sensitivity_peak: float | None = value(
        "count", "max \\|*S*\\| over all frequencies at `gain_learned`"
    )
    learned_real: np.ndarray = signal(
        "rate", "loop_pole", "real parts of the loop's poles at the learned gain"
    )
    learned_imag: np.ndarray = signal(
        "rate", "loop_pole", "imaginary parts of the loop's poles at the learned gain"
    )


@dataclass(frozen=True)
class Tried:
    """Simulations of the nonlinear chain with constant gains."""

    gain_simulated: float | None = value(
        "count",
        "least *k* at which the nonlinear chain with frozen gain stays in the tube over the "
        "last period, by bisection over simulations; unknown above `gains.most`",
    )
    error_learned: float = value(
        "length", "largest \\|*e*\\| over the last period with the gain frozen at `gain_learned`"
    )
    tried_gain: np.ndarray = signal("count", "trial", "frozen gain of a simulation")
    tried_error: np.ndarray = signal(
        "length", "trial", "largest error of that simulation over the last period"
    )


class Linear(Tracking, kind="linear"):
    """Analyse a chain with a tracker: poles, zeros, margins, sufficient gains.

    Poles, zeros and the frequency response belong to the chain at `point`. Margins and errors
    belong to the loop with constant gain, where dry friction is an external force. Three scalars
    give the gain that suffices for the tube: `gain_linear`, `gain_sure` and `gain_simulated`.
    `gain_learned` is the gain that the tracker reaches in a simulation.

    `[model]` is a plant of your own in place of the chain, linear but for its contacts. It is
    linearised at its start, and lengths count from those at rest without input.

    Not allowed: links without stiffness; more than 12 links; a motion shorter than two periods of
    the reference.

    Arrays over `gain` are NaN where no value exists: a gain margin above a factor of 10⁶, or an
    unbounded error.
    """

    refuses: ClassVar = {
        "worm.random": "is not allowed, since linear theory describes a single chain; leave the "
        "table out",
        "tracker.feedforward": "is not allowed, since the frozen loop has no feed-forward; leave "
        "the table out",
    }
    pictures: ClassVar = {
        "bode": ("gain and phase of the chain", "response"),
        "poles": "poles, zeros, and the loop's poles over the gain",
        "margins": "margins and errors over the gain, with the sufficient gains and "
        "the learned one",
    }
    headline: ClassVar = (
        "gain_learned",
        "gain_linear",
        "gain_simulated",
        "gain_sure",
        "phase_margin",
        "disk_margin",
    )

    tracker: FilterTracker | DerivativeTracker = entry("the tracker; `feedback` selects its kind")
    point: Point = entry("operating point of the linearisation", default=Point)
    gains: Gains = entry("gains of the frozen loop", default=Gains)
    contact: Contacts = field(default_factory=ExactContact)
    tolerance: Tolerances = field(default_factory=ToleranceTable)

    def faults_of_keys(self) -> Iterator[Fault]:
        yield from super().faults_of_keys()
        if self.model is not None and self.point.velocity != 0.0:
            yield "point.velocity", "applies to [worm] only; write value= of states of your Model"

    def faults_of_worm(self, worm: ChainTable) -> Iterator[Fault]:
        yield from wrong_count("point.velocity", self.point.velocity, worm.links + 1, "masses")
        if min(per(worm.stiffness, 1)) <= 0:
            yield (
                "worm.stiffness",
                "is 0, and a link without stiffness has no rest length; write positive numbers",
            )

    def faults_of_sizes(self, links: int) -> Iterator[Fault]:
        yield from super().faults_of_sizes(links)
        yield from self.tracker.faults("tracker", links)
        if links > MOST_LINKS:
            key, what = ("worm.links", "is") if self.worm else ("model.output", "has entries")
            yield key, f"{what} above {MOST_LINKS}, the largest number that is analysed; write less"

    # -- the plant and its loops -------------------------------------------------------------------

    @cached_property
    def gait(self) -> Gait:
        """The gait that the links follow; SceneError if the motion is too short for it."""
        gait = self.gait_of(self.reference.gait, "reference.gait")
        if self.time.end < 2 * gait.period:
            fault = f"is less than two periods of the reference, {2 * gait.period:g}; write more"
            raise SceneError(self.name, [("time.end", fault)])
        return gait

    @cached_property
    def task(self) -> Task:
        """Reference and disturbance of the linear loops."""
        if self.worm is not None:
            rest = np.array(per(self.worm.rest_length, self.links))
            return task_of(self.plant, self.laws, self.gait, self.shift, rest)
        try:
            return task_of_own(self.plant, self.laws, self.gait, self.shift)
        except ArgumentError as error:
            raise SceneError(self.name, [("model.file", str(error))]) from None

    def loop(self, gain: float) -> FrozenLoop:
        """The linear loop with a constant gain."""
        filtered = isinstance(self.tracker, FilterTracker)
        return FrozenLoop(self.task.plant, gain, "filter" if filtered else "derivative")

    def frozen(self, plant: Model) -> Frozen:
        """The loop with a constant gain around a chain, to be simulated."""
        return Frozen.of(plant, self.target(plant), self.tracker, self.worm, self.gait.period)

    @cached_property
    def loops(self) -> list[FrozenLoop]:
        """Linear loops of the gains that are analysed."""
        gains = np.geomspace(self.gains.least, self.gains.most, self.gains.count)
        return [self.loop(float(gain)) for gain in gains]

    @cached_property
    def point_model(self) -> LinearModel:
        """The chain linearised at the operating point."""
        velocity = {"velocity": np.array(self.point.velocity)} if self.worm else None
        return linearise(self.plant, output="length", x=velocity, v_reg=self.point.v_reg)

    # -- the adaptive motion -----------------------------------------------------------------------

    @stage
    def motion(self) -> Tracked:
        loop = self.closed(self.plant, self.target(self.plant), self.tracker, "tracker")
        span = self.time.end, self.time.samples
        how = self.contact.options, self.tolerance.options, self.report
        try:
            return follow("tracker", self.tracker, loop, *span, *how)
        except (SolveError, Interrupted) as error:
            error.partial = None  # the gain before the end is not the learned one
            raise

    @stage
    def recheck(self) -> CrossCheck | None:
        return self.motion.recheck(self.tolerance.options, self.tolerance.recheck, self.report)

    @scalar("count", "*k* at the end of the adaptive motion")
    def gain_learned(self) -> float:
        return float(self.motion.numbers["k_end"])

    @scalar(
        "time",
        "time of the last entry of the adaptive motion into the tube; unknown if there is none",
    )
    def capture_time(self) -> float | None:
        return self.motion.numbers["capture_time"]

    @scalar("length", "*λ*")
    def tube_radius(self) -> float:
        return self.tracker.tube_radius

    # -- linear theory -----------------------------------------------------------------------------

    @parts(Response)
    def response(self) -> Response:
        point = self.point_model
        poles, zeros = (_apart(roots, point.shifts) for roots in (point.poles, point.zeros))
        omega = frequencies(point)
        found = point.frequency_response(omega)
        phase = np.unwrap(np.angle(found), axis=-1)
        return Response(omega, np.abs(found), phase, zeros.real, zeros.imag, poles.real, poles.imag)

    @scalar(
        "rate",
        "zero of the plant at `point` that is largest: of a chain minus the slope of all friction "
        "over the mass; unknown if there is none",
    )
    def common_zero(self) -> float | None:
        zeros = _apart(self.point_model.zeros, self.point_model.shifts)
        return float(zeros.real.max()) if zeros.size else None

    @scalar("count", "1 if the chain at `point` is minimum phase, otherwise 0")
    def minimum_phase(self) -> int:
        return int(self.point_model.minimum_phase)

    @scalar(
        "count",
        "least eigenvalue of the symmetric part of the high-frequency gain, of a chain times the "
        "mean mass; if it is positive, a high-gain tracker has the right sign",
    )
    def gain_definite(self) -> float:
        gain = normal_form(self.plant, output="length").gain_at()
        masses = next((s.value for s in self.plant.p if s.name == "mass"), None)
        mass = np.mean(np.asarray(masses, dtype=float)) if self.worm else 1.0
        return float(mass * np.linalg.eigvalsh((gain + gain.T) / 2)[0])

    @stage
    def margins(self) -> list[Margins]:
        return [loop.margins() for loop in self.loops]

    @parts(Loops)
    def over_gain(self) -> Loops:
        loops, margins = self.loops, self.margins
        poles = np.array([loop.poles for loop in loops], dtype=np.complex128)
        return Loops(
            gain=np.array([loop.gain for loop in loops]),
            loop_real=poles.real,
            loop_imag=poles.imag,
            gain_margins=_numbers([each.gain for each in margins]),
            phase_margins=_numbers([each.phase for each in margins]),
            disk_margins=_numbers([each.disk for each in margins]),
            sensitivity_peaks=_numbers([each.peak for each in margins]),
            error_linear=_numbers([self.task.error(loop) for loop in loops]),
            error_bound=_numbers([self.task.bound(loop) for loop in loops]),
        )

    @cached_property
    def learned(self) -> FrozenLoop:
        """The linear loop with the gain that the tracker reaches."""
        return self.loop(self.gain_learned)

    @parts(AtLearned)
    def at_learned(self) -> AtLearned:
        poles, own = self.learned.poles, self.learned.margins()
        peak, slowest = _finite(own.peak), float(poles.real.max())
        found = slowest, _finite(own.gain), own.phase, own.disk, peak
        return AtLearned(*found, poles.real, poles.imag)

    @scalar(
        "count",
        "least *k* from which the linear loop without dry friction stays in the tube after a "
        "long time, from the harmonics of the reference; `gains.least` if that suffices; "
        "unknown above `gains.most`",
    )
    def gain_linear(self) -> float | None:
        gains = np.array([loop.gain for loop in self.loops])
        return least_gain(lambda gain: self.task.error(self.loop(gain)), gains, self.tube_radius)

    @scalar(
        "count",
        "`gain_linear` with a bound on the effect of dry friction; sufficient for every friction "
        "force over time, not necessary; unknown above `gains.most`, or if friction has no "
        "bound",
    )
    def gain_sure(self) -> float | None:
        gains = np.array([loop.gain for loop in self.loops])
        return least_gain(lambda gain: self.task.bound(self.loop(gain)), gains, self.tube_radius)

    @scalar("length", "bound of `error_learned` by linear theory; unknown if friction has no bound")
    def error_sure(self) -> float | None:
        return _finite(self.task.bound(self.learned))

    # -- constant gains, simulated -----------------------------------------------------------------

    @stage
    def bisection(self) -> Tried:
        frozen, gains_tried = self.frozen(self.plant), list[float]()

        def simulated(gain: float) -> float:
            gains_tried.append(gain)
            share = min(1.0, len(gains_tried) / _STEPS)
            self.report(f"simulating with the gain {gain:.4g}", share)
            return frozen.error(gain, self.time.end, self.contact.options, self.tolerance.options)

        least, most = self.gains.least, self.gains.most
        needed, trials = bisect(simulated, least, most, self.tube_radius, self.gain_learned)
        gains, errors = np.array(sorted(trials)).T
        return Tried(needed, simulated(self.gain_learned), gains, errors)

    @parts(Tried)
    def tried(self) -> Tried:
        return self.bisection

    # -- trust -------------------------------------------------------------------------------------

    @checks
    def checks_of_routes(self) -> Iterator[Check]:
        if self.recheck:
            yield self.recheck.check
        loop = self.learned
        poles, disk = loop.by_control()
        size = np.abs(loop.poles).max()
        yield _agree("poles by python-control", _apart_by(loop.poles, poles) / size, _AGREED)
        again = linearise(self._free.loop, output="length", x={"gain": loop.gain}).poles
        apart = _apart_by(loop.poles, again) / size
        yield _agree("poles of the Model's closed loop", apart, _AGREED)
        if loop.stable:
            yield _agree(
                "disk margin by python-control", self.at_learned.disk_margin / disk - 1, _HARMONICS
            )
            if loop.plant.F.size:
                yield _agree("static gains of the impulse responses", _static(loop), _HARMONICS)
            if self._settled <= _LONGEST * self.gait.period:
                simulated = self._free.error(
                    loop.gain, self._settled, Exact(), self.tolerance.options
                )
                what = "error by simulation without dry friction"
                yield _agree(what, self.task.error(loop) / simulated - 1, _HARMONICS)
        if self.error_sure is not None and isinstance(self.contact, ExactContact):
            share = self.bisection.error_learned / self.error_sure
            advice = "the error with frozen gain exceeds its bound; write a larger time.end"
            yield Check("error against its bound", share, 1.0, advice)

    @cached_property
    def _free(self) -> Frozen:
        """The frozen loop around the worm without dry friction."""
        free = without_dry_friction(self.plant, self.laws)
        if dry := [s.symbol for s in free.u if s.name == "ground"]:
            at_rest = ca.substitute(free.ode, dry[0], ca.SX.zeros(dry[0].numel()))
            free = replace(free, ode=at_rest, u=free.u[:-1])
        return self.frozen(free)

    @property
    def _settled(self) -> float:
        """Time after which the start is forgotten."""
        return settled(float(self.learned.poles.real.max()), self.gait.period)

    @warnings
    def doubts(self) -> Iterator[str]:
        if self.recheck is None:
            yield NOT_RECHECKED
        yield from warnings_of_contact(self.contact.options, self.laws)
        sufficient = {
            "gain_linear": self.gain_linear,
            "gain_simulated": self.bisection.gain_simulated,
        }
        for name, gain in sufficient.items():
            if gain is None:
                most = self.gains.most
                yield f"{name}: no gain up to {most:g} suffices; write a larger gains.most"
        if not self.learned.stable:
            yield (
                f"at gain_learned = {self.gain_learned:.4g} the linear loop is unstable; its "
                "margins are reported as 0"
            )
        elif self._settled > _LONGEST * self.gait.period:
            yield "the motion decays too slowly to recheck gain_linear by simulation"
        if self.capture_time is None:
            yield "the adaptive motion ends outside the tube; its gain may still grow"

    @facts
    def left_out(self) -> dict[str, Any]:
        if self.worm is None:
            return {}
        return {
            "hidden": "the position of the worm is a shift, which is not a pole or zero of the loop"
        }


def _finite(value: float) -> float | None:
    return float(value) if np.isfinite(value) else None


def _numbers(values: Sequence[float]) -> np.ndarray:
    found = np.array(values, dtype=float)
    return np.where(np.isfinite(found), found, np.nan)


def _apart(roots: Complex, shifts: int) -> Complex:
    """Poles or zeros without the exact zeros of shifts."""
    return np.delete(roots, np.flatnonzero(roots == 0)[:shifts]).astype(np.complex128)


def _agree(what: str, difference: float, limit: float) -> Check:
    return Check(what, float(difference), limit, f"{what}: both routes differ by {difference:.2g}")


def _apart_by(ours: np.ndarray, theirs: np.ndarray) -> float:
    """Largest distance of a pole of this route from the nearest one of the other."""
    return float(np.abs(ours[:, None] - theirs).min(axis=1).max())


def _static(loop: FrozenLoop) -> float:
    """Relative difference between integrals of impulse responses and their closed form."""
    found, known = static_gains(loop)
    return float(np.abs(found - known).max() / np.abs(known).max())
