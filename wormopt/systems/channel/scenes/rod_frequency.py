"""Scenes of kind "rod-frequency": how fast a magnetisable rod crawls, over the frequency."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, ClassVar, Literal

from msgspec import Meta

from wormopt.errors import Fault
from wormopt.scene.types import Positive, Table, Title, says
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
Rounds = Annotated[int, Meta(ge=0, le=20, description="a whole number from 0 to 20")]
Count = Annotated[int, Meta(ge=0, le=60, description="a whole number from 0 to 60")]
Rates = Annotated[
    tuple[Positive, ...],
    Meta(min_length=1, max_length=60, description="a list of finite numbers above 0"),
]
Factors = Annotated[
    tuple[Positive, ...],
    Meta(min_length=1, max_length=6, description="a list of 1 to 6 finite numbers above 0"),
]
Speed = Annotated[float, Meta(ge=0, le=1e3, description="a number from 0 to 1000")]


class SensitivityTable(Table, frozen=True, kw_only=True):
    """Which numbers are changed, one at a time, to see what the velocity hangs on."""

    parameters: Annotated[
        tuple[Doubtful, ...],
        Meta(min_length=1),
        says("", "numbers of the worm, the channel and the coils"),
    ] = (
        "youngs_modulus",
        "density",
        "damping_time",
        "susceptibility",
        "friction",
        "coil_outer",
        "coil_clearance",
    )
    factors: Annotated[
        Factors,
        says(
            "share",
            "by which each of them is changed; coils that would overlap get all of their pitch",
        ),
    ] = (0.5, 2.0)
    rates: Annotated[Rates, says("rate", "switches a second at which")] = (20.0, 100.0, 500.0)


class SearchTable(Table, frozen=True, kw_only=True):
    """How the best frequency and the best pattern are sought."""

    refine: Annotated[
        Count, says("count", "frequencies tried between the neighbours of the best one")
    ] = 8
    rounds: Annotated[
        Rounds,
        says(
            "count",
            "rounds of a compass search for a pattern, over frequency, `duration` and `shift`; 0 "
            "for none",
        ),
    ] = 4


class MeasuredTable(Table, frozen=True, kw_only=True):
    """A measured point that the picture shows."""

    rate: Annotated[Positive, says("rate", "switches a second")]
    velocity: Annotated[
        Speed, says("speed", "against the travel of the field; 0 where the body did not move")
    ]
    text: Annotated[Title, says("", "what the picture says of it")]


def _motions(name: str) -> dict[str, tuple[str, tuple[str, ...], str]]:
    """Variables of motions over the frequency."""
    return {
        f"{name}_rate": ("rate", (name,), "switches a second"),
        f"{name}_velocity": ("speed", (name,), "mean velocity"),
        f"{name}_error": ("speed", (name,), "half of its 95 % interval"),
        f"{name}_arc_length": ("length", (name,), "of a segment"),
    }


_CHANGED = ("parameter", "factor", "sensitive_rate")


class RodFrequencyScene(RodScene, frozen=True, kw_only=True):
    """Velocity of a magnetisable rod over the frequency at which its coils are switched.

    The mean velocity over the frequency of switching, beside the natural frequencies of the rod;
    the best frequency, the best pattern of switching, and which of the assumed numbers the answer
    hangs on. The rod is that of kind [`rod-motion`](rod-motion.md). Theory:
    [theory-channel.md](../theory-channel.md#4-velocity-against-frequency). Only `units = "SI"`.
    Numbers marked *assumed* are not published for the experiments; every result shows them as
    scalars `assumed_…`.

    Motions run side by side on all cores, and each is kept as soon as it is done: a run that was
    stopped goes on where it was, with other `rates` too. Until the run has ended they lie in
    `checkpoints/rods-…` of the user's cache folder (`~/.cache/wormopt` on Linux); a version of the
    code that computes otherwise starts anew. A motion that is lost fails the result and is named.
    """

    scalars: ClassVar = {
        "velocity_mean": ("speed", "over `rates`, positive with the field"),
        "velocity_error": ("speed", "over `rates`, half the width of its 95 % interval"),
        "direction": (
            "1", "over `rates`: −1 against the travel of the field, 1 with it, 0 where not sure",
        ),
        "frequency_best": ("rate", "fastest against the field, `refine` included"),
        "velocity_best": ("speed", "its velocity"),
        "velocity_best_error": ("speed", "half the width of its 95 % interval"),
        "velocity_per_frequency_slow": (
            "length", "velocity over frequency at the lowest of `rates`",
        ),
        "velocity_per_frequency_32": (
            "length", "by (32) for the shapes sine, beam, line; negative, against the field",
        ),
        "arc_length_slow": ("length", "of a segment at the lowest of `rates`"),
        "energy_error": ("share", "largest of all motions, as for `rod-motion`"),
        "rolloff_frequency": (
            "rate",
            "first of `rates` at which the velocity is below half of what the lowest of them "
            "promises; unknown if there is none, or the rod does not go against the field there",
        ),
        "standstill_frequencies": (
            "rate",
            "those of `rates` at which the velocity, its error added, is below 2 % of the best "
            "and its direction not sure",
        ),
        "forward_frequencies": ("rate", "those at which the rod goes with the field"),
        "eigenfrequencies": (
            "rate", "Hz; first four of the free rod, without walls and damping",
        ),
        "eigenfrequencies_pinned": ("rate", "Hz; with both ends held across the channel"),
        "eigenfrequencies_segment": ("rate", "Hz; of a rod of one pitch held so"),
        "pattern_rate": ("rate", "best pattern found by the compass search, a local one"),
        "pattern_duration": ("count", "of it"),
        "pattern_shift": ("count", "of it"),
        "pattern_velocity": (
            "speed",
            "its velocity; a pattern counts as better only beyond the errors of both",
        ),
        "pattern_velocity_error": ("speed", "half the width of its 95 % interval"),
        "pattern_gain": (
            "share",
            "gain over the first pattern at `frequency_best`, unknown where that does not go "
            "against the field",
        ),
        "sensitive_rates": ("rate", "as given"),
        "sensitive_to": (
            "1",
            "number whose change moves the velocity most, at each of these rates; unknown where "
            "no change is beyond its error",
        ),
    } | ASSUMED  # fmt: skip
    variables: ClassVar = (
        _motions("curve")
        | _motions("refined")
        | {
            "sensitive_rate": ("rate", ("sensitive_rate",), "switches a second"),
            "changed_velocity": ("speed", _CHANGED, "velocity of the mean motion"),
            "changed_error": ("speed", _CHANGED, "error of the mean motion"),
            "changed_factor": ("share", _CHANGED, "by what the number was changed"),
            "unchanged_velocity": ("speed", ("sensitive_rate",), "velocity of the mean motion"),
            "unchanged_error": ("speed", ("sensitive_rate",), "error of the mean motion"),
            "centre_rate": ("rate", ("centre",), "switches a second"),
            "centre_duration": ("count", ("centre",), "duration in switches"),
            "centre_shift": ("count", ("centre",), "shift in switches"),
            "centre_velocity": ("speed", ("centre",), "mean velocity"),
        }
    )

    kind: Literal["rod-frequency"]
    want: Annotated[
        tuple[Literal["rod_frequency"], ...],
        says("", "`rod_frequency`: velocity over frequency, and what it hangs on"),
    ] = ()
    rates: Annotated[Rates, says("rate", "switches a second, ascending")]
    switching: Annotated[PatternTable, says("", "how")] = PatternTable()
    course: Annotated[CourseTable, says("", "how long; 3 s if there is no such table")] = (
        CourseTable(duration=3.0)
    )
    sensitivity: Annotated[
        SensitivityTable | None,
        says("", "what the velocity hangs on; left out if there is no such table"),
    ] = None
    search: Annotated[
        SearchTable | None, says("", "what is best; left out if there is no such table")
    ] = None
    accepted: Annotated[
        Share,
        says(
            "share",
            "largest change of the best velocity on a mesh of half as many elements more and by "
            "half the step, beyond the errors of both and over that velocity, that is accepted",
        ),
    ] = 0.1
    measured: Annotated[
        tuple[MeasuredTable, ...], says("", "marks in the picture, a list of tables")
    ] = ()

    def faults(self, folder: Path) -> Iterator[Fault]:
        """Yield faults that no single key shows."""
        yield from super().faults(folder)
        if list(self.rates) != sorted(set(self.rates)):
            yield "rates", "must ascend, each standing once; write them in order"
