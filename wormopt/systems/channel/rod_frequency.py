"""Kind "rod-frequency": velocity of a magnetisable rod over the frequency of its coils."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass, replace
from functools import cached_property
from typing import Annotated, Any, ClassVar, Literal

from msgspec import Meta, structs

from wormopt.errors import Fault, Interrupted, SolveError
from wormopt.progress import Report
from wormopt.quantities import Scalar
from wormopt.result import Check, Result
from wormopt.study import (
    Given,
    arrays,
    attributes,
    checks,
    entry,
    facts,
    number,
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
from wormopt.study.types import Positive, Title
from wormopt.systems.channel.rod_course import RodPoint
from wormopt.systems.channel.rod_motion import RodMotion, Switching, point_of
from wormopt.systems.channel.tables import Duration, Pattern, RodStudy

with on_use():
    import numpy as np

    from wormopt.analysis.vibration import VibrationModes, vibration_modes
    from wormopt.families.points import Point, points
    from wormopt.families.store import Store, checkpoints, key_of
    from wormopt.numerics.direct_search import Look, compass
    from wormopt.systems.channel.closed_forms import (
        SHAPES,
        ChannelWorm,
        warnings_of_susceptibility,
    )
    from wormopt.systems.channel.rod_course import (
        ASSUMED,
        change_of,
        checks_of_change,
        checks_of_motion,
    )
    from wormopt.systems.channel.rod_model import channel_rod

Doubtful = Literal[
    "youngs_modulus",
    "density",
    "damping_time",
    "susceptibility",
    "friction",
    "coil_outer",
    "coil_clearance",
]
Rates = Annotated[
    tuple[Positive, ...],
    Meta(min_length=1, max_length=60, description="a list of finite numbers above 0"),
]
Factors = Annotated[
    tuple[Positive, ...],
    Meta(min_length=1, max_length=6, description="a list of 1 to 6 finite numbers above 0"),
]
_KEYS = {
    "youngs_modulus": "worm.youngs_modulus",
    "density": "worm.density",
    "damping_time": "worm.damping_time",
    "susceptibility": "worm.susceptibility",
    "friction": "channel.friction",
    "coil_outer": "coils.outer_radius",
    "coil_clearance": "coils.clearance",
}
_STEPS = {"frequency": 0.25, "duration": 0.5, "shift": 0.3}
_MODES = 4
# The velocity has rolled off below this share of that extrapolated from the slowest switching; the
# rod stands still below this share of the best velocity, errors included.
_ROLLED, _STILL = 0.5, 0.02


class Sensitivity(Given):
    """Parameters changed one at a time, to find those the velocity depends on."""

    parameters: Annotated[tuple[Doubtful, ...], Meta(min_length=1)] = entry(
        "parameters of the worm, the channel and the coils", default=tuple(_KEYS)
    )
    factors: Factors = entry(
        "factors of the change; coils that would overlap are limited to their pitch",
        quantity="share",
        default=(0.5, 2.0),
    )
    frequencies: Rates = entry(
        "switches per second of these runs", quantity="rate", default=(20.0, 100.0, 500.0)
    )


class Search(Given):
    """Options of the search for the best frequency and pattern."""

    refine: int = whole(
        0, 60, "number of frequencies tried between the neighbours of the best one", default=8
    )
    rounds: int = whole(
        0,
        20,
        "rounds of a compass search for a pattern over frequency, `duration` and `shift`; 0 "
        "for none",
        default=4,
    )


class Measured(Given):
    """A measured point shown in the plot."""

    frequency: float = positive("rate", "switches per second")
    velocity: float = number(
        "speed",
        "velocity against the travel of the field; 0 if the body stood still",
        least=0,
        most=1000.0,
    )
    text: Title = entry("label in the plot")


def _motions(name: str) -> dict[str, tuple[str, tuple[str, ...], str]]:
    """Return the variables of motions over the frequency."""
    return {
        f"{name}_rate": ("rate", (name,), "switches per second"),
        f"{name}_velocity": ("speed", (name,), "mean velocity"),
        f"{name}_error": ("speed", (name,), "half the width of its 95 % interval"),
        f"{name}_arc_length": ("length", (name,), "length of a segment"),
    }


def _columns(name: str, points: list[RodPoint]) -> dict[str, np.ndarray]:
    """Return the values of these variables."""
    keys = [key.removeprefix(f"{name}_") for key in _motions(name)]
    return {f"{name}_{key}": np.array([getattr(one, key) for one in points]) for key in keys}


@dataclass(frozen=True)
class Velocities:
    """Velocities over the frequencies of the scene."""

    velocity_mean: list[float] = value(
        "speed", "velocities over `frequencies`, positive with the field"
    )
    velocity_error: list[float] = value(
        "speed", "over `frequencies`, half the width of the 95 % interval"
    )
    direction: list[int] = value(
        "1", "over `frequencies`: −1 against the travel of the field, 1 with it, 0 if not certain"
    )
    velocity_per_frequency_slow: float = value(
        "length", "velocity over frequency at the lowest of `frequencies`"
    )
    arc_length_slow: float = value("length", "length of a segment at the lowest of `frequencies`")
    rolloff_frequency: float | None = value(
        "rate",
        "first of `frequencies` with a velocity below half of that extrapolated from the lowest; "
        "unknown if there is none, or if the rod does not move against the field there",
    )
    forward_frequencies: list[float] = value(
        "rate", "those of `frequencies` at which the rod moves with the field"
    )


@dataclass(frozen=True)
class Best:
    """The highest velocity against the field."""

    frequency_best: float = value("rate", "frequency of the highest velocity against the field")
    velocity_best: float = value(
        "speed",
        "velocity at `frequency_best`, of a motion three times as long; its first third, by which "
        "the frequency was chosen, does not count",
    )
    velocity_best_error: float = value("speed", "half the width of its 95 % interval")
    standstill_frequencies: list[float] = value(
        "rate",
        "those of `frequencies` with a velocity, including its error, below 2 % of the best, and "
        "with uncertain direction",
    )


@dataclass(frozen=True)
class Eigenfrequencies:
    """Natural frequencies of the rod and of a part of it."""

    eigenfrequencies: list[float] = value(
        "rate", "in Hz; first four of the free rod, without walls and damping"
    )
    eigenfrequencies_pinned: list[float] = value(
        "rate", "in Hz; with both ends held across the channel"
    )
    eigenfrequencies_segment: list[float] = value(
        "rate", "in Hz; of a rod of one pitch with held ends"
    )


@dataclass(frozen=True)
class BestPattern:
    """The best switching pattern, and the centres of its search."""

    pattern_rate: float = value("rate", "frequency of the best pattern, a local optimum")
    pattern_duration: float = value("count", "`duration` of the best pattern")
    pattern_shift: float = value("count", "`shift` of the best pattern")
    pattern_velocity: float = value(
        "speed",
        "velocity of the best pattern, like `velocity_best`; it counts as better only beyond the "
        "errors of both",
    )
    pattern_velocity_error: float = value("speed", "half the width of its 95 % interval")
    pattern_gain: float | None = value(
        "share",
        "gain over the first pattern at `frequency_best`; unknown if that does not move "
        "against the field",
    )
    centre_rate: np.ndarray = signal("rate", "centre", "switches per second")
    centre_duration: np.ndarray = signal("count", "centre", "duration in switches")
    centre_shift: np.ndarray = signal("count", "centre", "shift in switches")
    centre_velocity: np.ndarray = signal("speed", "centre", "mean velocity")


@dataclass(frozen=True)
class Changes:
    """Velocities with one parameter changed at a time."""

    points: list[RodPoint]
    sensitive_rates: list[float] = value("rate", "`sensitivity.frequencies`")
    sensitive_to: list[str | None] = value(
        "1",
        "parameter with the largest effect on the velocity, at each of these rates; unknown if "
        "no effect is beyond its error",
    )
    sensitive_rate: np.ndarray = signal("rate", "sensitive_rate", "switches per second")
    changed_velocity: np.ndarray = signal(
        "speed", "parameter factor sensitive_rate", "mean velocity with the changed parameter"
    )
    changed_error: np.ndarray = signal(
        "speed", "parameter factor sensitive_rate", "error of this velocity"
    )
    changed_factor: np.ndarray = signal(
        "share", "parameter factor sensitive_rate", "factor of the change"
    )
    unchanged_velocity: np.ndarray = signal(
        "speed", "sensitive_rate", "mean velocity without changes"
    )
    unchanged_error: np.ndarray = signal("speed", "sensitive_rate", "error of this velocity")


class RodFrequency(RodStudy, kind="rod-frequency"):
    """Compute the velocity of a magnetisable rod over the frequency of its coils.

    The scene computes the mean velocity over the frequency, with the natural frequencies of the
    rod. It finds the best frequency, the best switching pattern, and the assumed parameters on
    which the velocity depends most. The rod is that of kind [`rod-motion`](rod-motion.md). Theory:
    [theory-channel.md](../theory-channel.md#4-velocity-against-frequency). Only `units = "SI"`.
    Parameters marked *assumed* are not published for the experiments. Every result lists them as
    scalars `assumed_…`.

    Motions run in parallel on all cores. Each is saved when it ends, so a stopped run resumes, also
    at other frequencies. Until the run ends they are in `checkpoints` of the user's cache folder
    (`~/.cache/wormopt` on Linux). A version of the code that computes differently starts
    again. The status is `failed` if a motion fails; the report names it.
    """

    pictures: ClassVar = {"rod_frequency": "velocity over frequency, and its sensitivities"}
    headline: ClassVar = (
        "velocity_mean", "velocity_error", "direction", "frequency_best", "velocity_best",
    )  # fmt: skip
    resumes = True

    frequencies: Rates = entry("switches per second, ascending", quantity="rate")
    switching: Pattern = entry("switching of the coils", default=Pattern)
    time: Duration = entry("duration", default=Duration(end=3.0))
    sensitivity: Sensitivity | None = entry(
        "sensitivity of the velocity; not computed if left out", default=None
    )
    search: Search | None = entry("search for the optimum; not run if left out", default=None)
    accepted: float = number(
        "share",
        "accepted relative change of the best velocity with 1.5 times the elements and with "
        "half the step, beyond the errors of both",
        above=0,
        below=1,
        default=0.1,
    )
    measured: tuple[Measured, ...] = entry("measured points in the plot", default=())

    def faults_of_keys(self) -> Iterator[Fault]:
        yield from super().faults_of_keys()
        if list(self.frequencies) != sorted(set(self.frequencies)):
            yield "frequencies", "they do not ascend; write them in order, each once"

    # -- motions -----------------------------------------------------------------------------------

    def at(self, rate: float) -> RodMotion:
        """Return the motion at `rate` switches per second."""
        switching = Switching(frequency=rate, **structs.asdict(self.switching))
        return RodMotion(
            units="SI", worm=self.worm, channel=self.channel, coils=self.coils,
            switching=switching, mesh=self.mesh, time=self.time,
        )  # fmt: skip

    @cached_property
    def simulated(self) -> list[RodMotion]:
        """All motions that were simulated so far."""
        return []

    def simulate(self, motions: Sequence[RodMotion], text: str) -> list[RodPoint]:
        """Simulate several motions, or read them back; `text` names the purpose."""
        self.simulated.extend(motions)
        return rod_points(motions, checkpoints(), self.report, text)

    def result(self, report: Report | None = None) -> Result:
        """Compute all that the study reports, see `Study`; then saved motions are not needed."""
        found = super().result(report)
        checkpoints().forget(map(key_of, self.simulated))
        return found

    @stage
    def curve(self) -> list[RodPoint]:
        points = self.simulate(
            [self.at(rate) for rate in self.frequencies], "velocity over frequency"
        )
        if all(point.reason for point in points):
            raise SolveError(points[0].reason, "write a shorter mesh.step")
        return points

    @stage
    def near_best(self) -> list[RodPoint]:
        """Motions between the neighbours of the best frequency."""
        if self.search is None:
            return []
        k = self.curve.index(_fastest(self.curve))
        low, high = (
            self.frequencies[max(k - 1, 0)],
            self.frequencies[min(k + 1, len(self.frequencies) - 1)],
        )
        between = np.geomspace(low, high, self.search.refine + 2)[1:-1]
        rates = [rate for one in between if (rate := float(f"{one:.4g}")) not in self.frequencies]
        return self.simulate([self.at(rate) for rate in rates], "best frequency")

    @cached_property
    def best_point(self) -> RodPoint:
        """The fastest motion against the field on the curve and near its best point."""
        return _fastest([*self.curve, *self.near_best])

    @stage
    def pattern_search(self) -> tuple[list[Look], list[RodPoint]]:
        """Centres of a compass search over the pattern, and all motions of it."""
        if self.search is None or not self.search.rounds:
            return [], []
        first, pattern, motions = self.at(self.best_point.rate), self.switching, []

        def look(points: Sequence[dict[str, float]], *, anew: bool = False) -> list[Look]:
            # rates are rounded, so that the same frequency is the same motion again
            several = [
                first.varied(
                    switching=point | {"frequency": float(f"{math.exp(point['frequency']):.4g}")}
                )
                for point in points
            ]
            found = self.simulate([*map(_again, several)] if anew else several, "best pattern")
            motions.extend(found)
            return [
                Look(point, -math.inf if one.reason else -one.velocity, one.error)
                for point, one in zip(points, found, strict=True)
            ]

        rate = first.switching.frequency
        start = {"frequency": math.log(rate), "duration": pattern.duration, "shift": pattern.shift}
        bounds = {
            "frequency": (math.log(rate / 4), math.log(4 * rate)),
            "duration": (1.5, min(5.0, pattern.every - 1.6)),
            "shift": (-0.6, 0.6),
        }
        centres = compass(
            look, start, _STEPS, bounds, self.search.rounds, lambda one: look([one], anew=True)[0]
        )
        return centres, motions

    @stage
    def sensitivities(self) -> Changes | None:
        """Motions with one assumed parameter changed at a time."""
        own = self.sensitivity
        if own is None:
            return None
        todo = [
            [(1.0, self.at(rate))]
            + [_changed(self.at(rate), name, by) for name in own.parameters for by in own.factors]
            for rate in own.frequencies
        ]
        points = self.simulate([one for row in todo for _, one in row], "sensitivity")
        return _changes(own, np.array([[factor for factor, _ in row] for row in todo]), points)

    @stage
    def repetitions(self) -> list[RodPoint]:
        """The best motion again, then on a finer mesh and with half the step."""
        best = self.at(self.best_point.rate)
        finer = best.finer(math.ceil(1.5 * self.mesh.elements))
        return self.simulate([_again(best), finer, best.finer()], "best frequency again")

    @property
    def best_again(self) -> RodPoint:
        """The motion of `best_point`, without the chance by which it was chosen."""
        return self.repetitions[0]

    @cached_property
    def all_points(self) -> list[RodPoint]:
        """All motions."""
        found = [*self.curve, *self.near_best, *self.pattern_search[1]]
        found += self.sensitivities.points if self.sensitivities else []
        return [*found, *self.repetitions]

    @cached_property
    def known_points(self) -> list[RodPoint]:
        """All motions that did not fail."""
        return [point for point in self.all_points if not point.reason]

    # -- results -----------------------------------------------------------------------------------

    @parts(Velocities)
    def of_curve(self) -> Velocities:
        points, first = self.curve, self.curve[0]
        return Velocities(
            velocity_mean=[point.velocity for point in points],
            velocity_error=[point.error for point in points],
            direction=[point.direction for point in points],
            velocity_per_frequency_slow=first.velocity / first.rate,
            arc_length_slow=first.arc_length,
            rolloff_frequency=_rolloff(points),
            forward_frequencies=[point.rate for point in points if point.direction > 0],
        )

    @parts(Best)
    def best(self) -> Best:
        best, slow = self.best_again, _STILL * abs(self.best_again.velocity)
        return Best(
            frequency_best=best.rate,
            velocity_best=best.velocity,
            velocity_best_error=best.error,
            standstill_frequencies=[
                one.rate for one in self.curve
                if not one.direction and abs(one.velocity) + one.error <= slow
            ],
        )  # fmt: skip

    @arrays(_motions("curve"))
    def points_of_curve(self) -> dict[str, np.ndarray]:
        return _columns("curve", self.curve)

    @arrays(_motions("refined"))
    def points_near_best(self) -> dict[str, np.ndarray]:
        return _columns("refined", self.near_best) if self.near_best else {}

    @scalar("length", "by eq. 32 (WLLS) for sine, beam, line; negative: against the field")
    def velocity_per_frequency_32(self) -> list[float]:
        worm = self.worm
        body = ChannelWorm(self.coils.pitch, self.channel.diameter, worm.diameter, worm.length)
        return [-body.velocity_per_frequency(shape) for shape in SHAPES]

    @scalar("share", "largest `energy_error` of all motions, see `rod-motion`")
    def energy_error(self) -> float:
        return max(point.energy_error for point in self.known_points)

    @parts(Eigenfrequencies)
    def natural(self) -> Eigenfrequencies:
        rod, channel = self.at(1.0).rod, self.channel
        whole, part = (
            channel_rod(one, channel.diameter, channel.friction)
            for one in (rod, replace(rod, length=self.coils.pitch))
        )
        ends = {"across": [0, rod.count - 1]}
        return Eigenfrequencies(
            _above_zero(vibration_modes(whole, count=_MODES + 3, rigid=3)),
            _above_zero(vibration_modes(whole, ends, count=_MODES + 1, rigid=1)),
            _above_zero(vibration_modes(part, ends, count=2, rigid=1)),
        )

    @property
    def seeks_pattern(self) -> bool:
        """Whether the best pattern is searched for."""
        return self.search is not None and self.search.rounds > 0

    @parts(BestPattern, when="seeks_pattern")
    def best_pattern(self) -> BestPattern:
        centres, _ = self.pattern_search
        first, last = centres[0], centres[-1]
        points = [look.point for look in centres]
        return BestPattern(
            pattern_rate=math.exp(last.point["frequency"]),
            pattern_duration=last.point["duration"],
            pattern_shift=last.point["shift"],
            pattern_velocity=-last.value,
            pattern_velocity_error=last.error,
            pattern_gain=last.value / first.value - 1 if first.value > 0 else None,
            centre_rate=np.array([math.exp(point["frequency"]) for point in points]),
            centre_duration=np.array([point["duration"] for point in points]),
            centre_shift=np.array([point["shift"] for point in points]),
            centre_velocity=np.array([-look.value for look in centres]),
        )

    @parts(Changes, when="sensitivity")
    def changes(self) -> Changes:
        assert self.sensitivities is not None
        return self.sensitivities

    @attributes
    def drawn(self) -> dict[str, Any]:
        return {
            "measured": [[one.frequency, one.velocity, one.text] for one in self.measured],
            "parameters": list(self.sensitivity.parameters) if self.sensitivity else [],
        }

    # -- the trust report --------------------------------------------------------------------------

    @property
    def field_speed_best(self) -> float:
        """Speed of the travelling field at the best frequency, in m/s."""
        return self.best_point.rate * self.coils.pitch

    @checks
    def of_motions(self) -> Iterator[Check]:
        fine: dict[str, Check] = {}
        for position, point in enumerate(dict.fromkeys(self.all_points)):
            for check in checks_of_motion(point):
                if not check.passed:
                    yield replace(check, name=f"{check.name} of motion {position}")
                elif (check.value or 0.0) >= (fine.get(check.name, check).value or 0.0):
                    fine[check.name] = check
        yield from fine.values()
        best, *others = self.repetitions
        for what, point in zip(("on a finer mesh", "with half the step"), others, strict=True):
            if not best.reason and not point.reason:
                yield from checks_of_change(best, point, self.field_speed_best, self.accepted, what)

    @facts
    def found(self) -> dict[str, Any]:
        points, others = self.known_points, self.repetitions[1:]
        return {
            "energy_error": self.energy_error,
            "penetration_share": max(point.penetration for point in points),
            "field_error": max(point.field_error for point in points),
            "recheck_velocity_change": change_of(self.best_again, others, self.field_speed_best),
            "accepted": self.accepted,
            "motions": len(self.all_points),
            "assumptions": ASSUMED,
        }

    @warnings
    def of_curve_points(self) -> Iterator[str]:
        known = [point for point in self.curve if not point.reason]
        unsure = [p.rate for p in known if p.error > max(0.1 * abs(p.velocity), 1e-3)]
        for rates, text in (
            (unsure, "the motion is irregular at {}: the error of its mean exceeds a tenth"),
            ([p.rate for p in known if not p.settled], "the mean has not converged at {}"),
        ):
            if rates:
                listed = ", ".join(f"{rate:g}" for rate in rates) + " switches per second"
                yield text.format(listed) + "; write a longer time.end"
        if self.best_again.direction != -1:
            yield (
                "the rod does not move against the field with certainty at any frequency, so "
                "frequency_best is not the best frequency of crawling"
            )
        yield from warnings_of_susceptibility(self.worm.susceptibility)


def _fastest(points: list[RodPoint]) -> RodPoint:
    """Return the fastest motion against the field."""
    known = [point for point in points if not point.reason]
    return min(known, key=lambda point: point.velocity)


def _again(motion: RodMotion) -> RodMotion:
    """Return a motion three times as long, whose mean leaves out the part by which it was chosen.

    The fastest of irregular motions was fast by chance in part.
    """
    settle = max(motion.time.settle, 1 / 3)
    return motion.varied(time={"end": 3 * motion.end, "settle": settle})


def _rolloff(points: list[RodPoint]) -> float | None:
    """Return the first frequency with a velocity far below the initial slope, against the field."""
    first = points[0]
    if first.direction != -1:
        return None
    least = _ROLLED * first.velocity / first.rate
    return next((point.rate for point in points if point.velocity / point.rate > least), None)


def _above_zero(modes: VibrationModes) -> list[float]:
    return modes.frequencies[modes.frequencies > 0][:_MODES].tolist()


def _changed(motion: RodMotion, name: str, factor: float) -> tuple[float, RodMotion]:
    """Return the changed motion and the actual factor, which the available room may limit."""
    table, _, key = _KEYS[name].partition(".")
    old = getattr(getattr(motion, table), key)
    new = old * factor
    if name == "coil_outer":
        new = min(max(new, 1.05 * motion.coils.inner_radius), motion.coils.pitch)
    return new / old, motion.varied(**{table: {key: new}})


def _changes(own: Sensitivity, factors: np.ndarray, points: list[RodPoint]) -> Changes:
    """Return the velocities of `points`: for each rate the unchanged motion, then all changes.

    `factors` of the changes has one row for each rate.
    """
    velocity, error = (
        np.reshape([getattr(point, key) for point in points], factors.shape)
        for key in ("velocity", "error")
    )
    moved = np.abs(velocity[:, 1:] - velocity[:, :1])
    moved[~(moved > np.hypot(error[:, 1:], error[:, :1]))] = 0.0
    largest = np.argmax(moved, axis=1)
    names = [name for name in own.parameters for _ in own.factors]

    def by_parameter(rows: np.ndarray) -> np.ndarray:
        return rows[:, 1:].T.reshape(len(own.parameters), len(own.factors), -1)

    return Changes(
        points=points,
        sensitive_rates=list(own.frequencies),
        sensitive_to=[names[k] if row[k] else None for k, row in zip(largest, moved, strict=True)],
        sensitive_rate=np.array(own.frequencies),
        changed_velocity=by_parameter(velocity),
        changed_error=by_parameter(error),
        changed_factor=by_parameter(factors),
        unchanged_velocity=velocity[:, 0],
        unchanged_error=error[:, 0],
    )


# -- motions side by side --------------------------------------------------------------------------


def rod_points(
    motions: Sequence[RodMotion], store: Store, report: Report, text: str
) -> list[RodPoint]:
    """Simulate several rods in parallel, or read them from the store; `text` names the purpose.

    Interrupted has the finished ones.
    """
    try:
        return _told(motions, points(motions, rod_result, store, report, f"{text}: "))
    except Interrupted as stop:
        raise Interrupted(_told(motions, stop.partial)) from None


def _told(motions: Sequence[RodMotion], found: Sequence[Point]) -> list[RodPoint]:
    return [
        RodPoint.lost(motion.switching.frequency, point.reason)
        if point.is_poor
        else RodPoint(**{name: scalar.value for name, scalar in point.scalars.items()})
        for motion, point in zip(motions, found, strict=True)
        if point.status != "not computed"
    ]


def rod_result(motion: RodMotion) -> Result:
    """Simulate a rod; its result is kept with a `RodPoint` for scalars, and nothing else."""
    scalars = {name: Scalar(number) for name, number in asdict(point_of(motion)).items()}
    return Result(motion.name, motion.kind, scalars=scalars)
