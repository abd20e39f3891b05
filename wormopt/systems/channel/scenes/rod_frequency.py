"""Scenes of kind "rod-frequency": velocity of a magnetisable rod over the frequency."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, ClassVar, Literal

from msgspec import Meta

from wormopt.errors import Fault
from wormopt.study.given import Given, entry, number, positive, whole
from wormopt.study.types import Positive, Title
from wormopt.systems.channel.scenes.rod import (
    ASSUMED,
    CourseTable,
    PatternTable,
    RodScene,
    Share,
)

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


class SensitivityTable(Given):
    """Parameters changed one at a time, to find those the velocity depends on."""

    parameters: Annotated[tuple[Doubtful, ...], Meta(min_length=1)] = entry(
        "parameters of the worm, the channel and the coils",
        default=(
            "youngs_modulus",
            "density",
            "damping_time",
            "susceptibility",
            "friction",
            "coil_outer",
            "coil_clearance",
        ),
    )
    factors: Factors = entry(
        "factors of the change; coils that would overlap are limited to their pitch",
        quantity="share",
        default=(0.5, 2.0),
    )
    rates: Rates = entry(
        "switches per second of these runs",
        quantity="rate",
        default=(
            20.0,
            100.0,
            500.0,
        ),
    )


class SearchTable(Given):
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


class MeasuredTable(Given):
    """A measured point shown in the plot."""

    rate: float = positive("rate", "switches per second")
    velocity: float = number(
        "speed",
        "velocity against the travel of the field; 0 if the body stood still",
        least=0,
        most=1000.0,
    )
    text: Title = entry("label in the plot")


def _motions(name: str) -> dict[str, tuple[str, tuple[str, ...], str]]:
    """Return variables of motions over the frequency."""
    return {
        f"{name}_rate": ("rate", (name,), "switches per second"),
        f"{name}_velocity": ("speed", (name,), "mean velocity"),
        f"{name}_error": ("speed", (name,), "half the width of its 95 % interval"),
        f"{name}_arc_length": ("length", (name,), "length of a segment"),
    }


_CHANGED = ("parameter", "factor", "sensitive_rate")


class RodFrequencyScene(RodScene):
    """Velocity of a magnetisable rod over the switching frequency of its coils.

    The scene computes the mean velocity over the frequency, with the natural frequencies of the
    rod. It finds the best frequency, the best switching pattern, and the assumed parameters on
    which the velocity depends most. The rod is that of kind [`rod-motion`](rod-motion.md). Theory:
    [theory-channel.md](../theory-channel.md#4-velocity-against-frequency). Only `units = "SI"`.
    Parameters marked *assumed* are not published for the experiments. Every result lists them as
    scalars `assumed_…`.

    Motions run in parallel on all cores. Each is saved when it ends, so a stopped run resumes, also
    with other `rates`. Until the run ends they are in `checkpoints/rods-…` of the user's cache
    folder (`~/.cache/wormopt` on Linux). A version of the code that computes differently starts
    again. The status is `failed` if a motion fails; the report names it.
    """

    scalars: ClassVar = {
        "velocity_mean": ("speed", "velocities over `rates`, positive with the field"),
        "velocity_error": ("speed", "over `rates`, half the width of the 95 % interval"),
        "direction": (
            "1", "over `rates`: −1 against the travel of the field, 1 with it, 0 if not certain",
        ),
        "frequency_best": ("rate", "frequency of the highest velocity against the field"),
        "velocity_best": ("speed", "velocity at `frequency_best`"),
        "velocity_best_error": ("speed", "half the width of its 95 % interval"),
        "velocity_per_frequency_slow": (
            "length", "velocity over frequency at the lowest of `rates`",
        ),
        "velocity_per_frequency_32": (
            "length", "by eq. 32 (WLLS) for sine, beam, line; negative: against the field",
        ),
        "arc_length_slow": ("length", "length of a segment at the lowest of `rates`"),
        "energy_error": ("share", "largest `energy_error` of all motions, see `rod-motion`"),
        "rolloff_frequency": (
            "rate",
            "first of `rates` with a velocity below half of that extrapolated from the lowest; "
            "unknown if there is none, or if the rod does not move against the field there",
        ),
        "standstill_frequencies": (
            "rate",
            "those of `rates` with a velocity, including its error, below 2 % of the best, and "
            "with uncertain direction",
        ),
        "forward_frequencies": ("rate", "those of `rates` at which the rod moves with the field"),
        "eigenfrequencies": (
            "rate", "in Hz; first four of the free rod, without walls and damping",
        ),
        "eigenfrequencies_pinned": ("rate", "in Hz; with both ends held across the channel"),
        "eigenfrequencies_segment": ("rate", "in Hz; of a rod of one pitch with held ends"),
        "pattern_rate": ("rate", "frequency of the best pattern, a local optimum"),
        "pattern_duration": ("count", "`duration` of the best pattern"),
        "pattern_shift": ("count", "`shift` of the best pattern"),
        "pattern_velocity": (
            "speed",
            "velocity of the best pattern; it counts as better only beyond the errors of both",
        ),
        "pattern_velocity_error": ("speed", "half the width of its 95 % interval"),
        "pattern_gain": (
            "share",
            "gain over the first pattern at `frequency_best`; unknown if that does not move "
            "against the field",
        ),
        "sensitive_rates": ("rate", "`sensitivity.rates`"),
        "sensitive_to": (
            "1",
            "parameter with the largest effect on the velocity, at each of these rates; unknown if "
            "no effect is beyond its error",
        ),
    } | ASSUMED  # fmt: skip
    variables: ClassVar = (
        _motions("curve")
        | _motions("refined")
        | {
            "sensitive_rate": ("rate", ("sensitive_rate",), "switches per second"),
            "changed_velocity": ("speed", _CHANGED, "mean velocity with the changed parameter"),
            "changed_error": ("speed", _CHANGED, "error of this velocity"),
            "changed_factor": ("share", _CHANGED, "factor of the change"),
            "unchanged_velocity": ("speed", ("sensitive_rate",), "mean velocity without changes"),
            "unchanged_error": ("speed", ("sensitive_rate",), "error of this velocity"),
            "centre_rate": ("rate", ("centre",), "switches per second"),
            "centre_duration": ("count", ("centre",), "duration in switches"),
            "centre_shift": ("count", ("centre",), "shift in switches"),
            "centre_velocity": ("speed", ("centre",), "mean velocity"),
        }
    )

    kind: Literal["rod-frequency"]
    want: tuple[Literal["rod_frequency"], ...] = entry(
        "`rod_frequency`: velocity over frequency, and its sensitivities", default=()
    )
    rates: Rates = entry("switches per second, ascending", quantity="rate")
    switching: PatternTable = entry("how", default=PatternTable())
    course: CourseTable = entry(
        "duration; 3 s if there is no such table", default=CourseTable(duration=3.0)
    )
    sensitivity: SensitivityTable | None = entry(
        "sensitivity of the velocity; not computed if left out", default=None
    )
    search: SearchTable | None = entry("search for the optimum; not run if left out", default=None)
    accepted: Share = entry(
        "accepted relative change of the best velocity with 1.5 times the elements and with "
        "half the step, beyond the errors of both",
        quantity="share",
        default=0.1,
    )
    measured: tuple[MeasuredTable, ...] = entry("measured points in the plot", default=())

    def faults(self, folder: Path) -> Iterator[Fault]:
        """Yield faults that no single key shows."""
        yield from super().faults(folder)
        if list(self.rates) != sorted(set(self.rates)):
            yield "rates", "the rates do not ascend; write them in order, each once"
