"""Kind "coil-row": the field of a row of coils that are switched in turn."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import Any, ClassVar

from wormopt.errors import Fault
from wormopt.study import (
    Given,
    array,
    check,
    entry,
    facts,
    number,
    on_use,
    parts,
    scalar,
    scalars,
    signal,
    stage,
    warnings,
    whole,
)
from wormopt.systems.coils.tables import Coils, Switching
from wormopt.systems.shared.studies import SIStudy

with on_use():
    import numpy as np

    from wormopt.magnetics.coils import CoilRow, field_by_quadrature
    from wormopt.magnetics.travelling import MovingProfile, harmonic_shares, moving_profile
    from wormopt.model.gait import Gait

_ACCEPTED = 1e-8  # relative difference of fields by formula and by quadrature
_PER_PITCH, _PHASES_PER_STEP, _MOST_PHASES = 16, 16, 1024
_WAVELENGTH_POINTS = 256
_CHECKED = 3
_SQUARE = "magnetic_field_squared"
_SIZES = {
    "coils": ("count", "number of places along the row, as the next six an assumption"),
    "pitch": ("length", "distance of neighbours"),
    "coil_inner": ("length", "inner radius"),
    "coil_outer": ("length", "outer radius"),
    "coil_length": ("length", "length along the axis"),
    "coil_gap": ("length", "gap between the two coils of a place; unknown for a single coil"),
    "line_height": ("length", "height of the line"),
    "currents_limit": ("ampere_turns", "largest ampere-turns of a coil"),
    "current_density_limit": ("current_density", "`currents_limit` over the winding's section"),
}


class Line(Given):
    """The line of the fluid, along *x*.

    A line through windings ("a coil inside the fluid") is refused, as is a margin that leaves
    nothing of the row.
    """

    height: float = number(
        "length",
        "height of the fluid's line above the middle of the coils, or of the gap; negative "
        "below it",
    )
    margin: int = whole(
        0,
        100,
        "number of coils at each end that the analysis in the wave's frame leaves out",
        default=3,
    )

    def faults_in(self, coils: Coils) -> Iterator[Fault]:
        """Yield a fault if the line meets a winding, or nothing is left of the row."""
        low, high = coils.taken
        if low <= abs(self.height) <= high:
            inside = f", or within {low:g}" if low else ""
            yield (
                "line.height",
                f"{self.height:g} puts a coil inside the fluid: the line meets windings, which "
                f"reach from {low:g} to {high:g}; write a height beyond ±{high:g}{inside}",
            )
        if coils.count < 2:
            yield (
                "coils.count",
                "a wave needs two or more coils; write at least 2",
            )
        elif 2 * self.margin >= coils.count - 1:
            yield (
                "line.margin",
                f"{self.margin} coils at each end leave none of {coils.count}; write at most "
                f"{(coils.count - 2) // 2}",
            )


@dataclass(frozen=True)
class WaveFrame:
    """The field in the frame of the wave: H² over its phase, along the interior of the row."""

    phase: np.ndarray = signal("rad", "phase", "phase of the wave")
    square_mean: np.ndarray = signal(_SQUARE, "phase", "H² in the frame of the wave, mean")
    square_low: np.ndarray = signal(_SQUARE, "phase", "H² in the frame of the wave, low")
    square_high: np.ndarray = signal(_SQUARE, "phase", "H² in the frame of the wave, high")


class AlongRow(SIStudy):
    """The field of a row of coils along a line of fluid."""

    coils: Coils = entry("the row", default=Coils)
    line: Line = entry("line of the fluid")

    def faults_of_keys(self) -> Iterator[Fault]:
        yield from super().faults_of_keys()
        yield from self.line.faults_in(self.coils)

    def interior(self, per_pitch: int) -> np.ndarray:
        """Return positions along the row, in m, far from its ends and evenly over whole pitches.

        There is one position more than `per_pitch` gives, so that no two have the same place
        relative to their nearest coil, and all together are evenly spaced over a pitch too.
        """
        pitches = self.coils.count - 1 - 2 * self.line.margin
        count = pitches * per_pitch + 1
        return self.coils.pitch * (self.line.margin + pitches * (np.arange(count) + 0.5) / count)

    @stage
    def profile(self) -> MovingProfile:
        raise NotImplementedError

    @parts(WaveFrame)
    def wave_frame(self) -> WaveFrame:
        profile = self.profile
        low, high = profile.square.min(axis=0), profile.square.max(axis=0)
        return WaveFrame(profile.xi, profile.mean, low, high)

    @scalar(
        "share",
        "root mean square of *H*² less its mean at each phase of the wave, over that of the mean's "
        "variation; unknown if nothing travels",
    )
    def ripple(self) -> float | None:
        return self.profile.ripple

    @scalars(_SIZES)
    def sizes(self) -> dict[str, Any]:
        coils = self.coils
        return {
            "coils": coils.count,
            "pitch": coils.pitch,
            "coil_inner": coils.inner_radius,
            "coil_outer": coils.outer_radius,
            "coil_length": coils.length,
            "coil_gap": coils.gap,
            "line_height": self.line.height,
            "currents_limit": coils.ampere_turns,
            "current_density_limit": coils.ampere_turns / coils.section,
        }


class SwitchedRow(AlongRow, kind="coil-row"):
    """Compute the travelling magnetic field of a row of coils switched in turn.

    By default three coils are on, shifted by one at every switch. Theory and assumptions:
    [theory-coils.md](../theory-coils.md). `units` must be `"SI"`.

    The trust report has `recheck` and `warnings`. `error` of `recheck` is the largest difference
    of the field to a quadrature of the Biot-Savart law at three points, over the largest field;
    1e-8 is accepted. `warnings` report a current density that copper cannot carry for long.
    """

    pictures: ClassVar = {
        "travelling_field": "map over place and time, snapshots, the field in the frame of "
        "the wave",
    }

    switching: Switching = entry("sequence of active coils")

    def faults_of_keys(self) -> Iterator[Fault]:
        yield from super().faults_of_keys()
        yield from self.switching.faults_in(self.coils)

    @cached_property
    def currents(self) -> Gait:
        """Ampere-turns of the coils over time."""
        return self.switching.currents(self.coils)

    @stage
    def field_along_the_row(self) -> np.ndarray:
        square = self.coils.row.square(self.place, self.line.height, self.currents(self.time))
        return np.sqrt(square).T

    @stage
    def profile(self) -> MovingProfile:
        return moving_profile(
            self.coils.row,
            self.currents,
            self.interior(_PER_PITCH),
            self.line.height,
            wavelength=self.wavelength,
            period=self.currents.period,
            phases=min(_PHASES_PER_STEP * self.currents.pieces, _MOST_PHASES),
        )

    @array("length", "place", "position along the row")
    def place(self) -> np.ndarray:
        count = self.coils.count
        return self.coils.pitch * np.linspace(-1, count, _PER_PITCH * (count + 1) + 1)

    @array("time", "time", "middle of each step of switching")
    def time(self) -> np.ndarray:
        return (self.currents.breaks[:-1] + self.currents.breaks[1:]) / 2

    @array("magnetic_field", "time place", "field H")
    def field(self) -> np.ndarray:
        return self.field_along_the_row

    @array("length", "coil", "position of the coil")
    def coil_place(self) -> np.ndarray:
        return self.coils.row.places

    @array("ampere_turns", "coil time", "ampere-turns")
    def current(self) -> np.ndarray:
        return self.currents(self.time)

    @scalar("magnetic_field", "largest *H* on the line", headline=True)
    def field_max(self) -> float:
        return float(self.field.max())

    @scalar("speed", "pitch times switches per second", headline=True)
    def wave_speed(self) -> float:
        return self.coils.pitch * self.switching.frequency

    @scalar("length", "`switching.every` pitches", headline=True)
    def wavelength(self) -> float:
        return self.currents.pieces * self.coils.pitch

    @scalar("rate", "waves per second", headline=True)
    def frequency(self) -> float:
        return self.wave_speed / self.wavelength

    @scalar(
        "share",
        "share of the first harmonic of *H* along one wavelength about the middle of the row at "
        "one time: its squared amplitude over the sum of all",
        headline=True,
    )
    def first_harmonic_share(self) -> float:
        return self.harmonic_shares[0]

    @scalar("share", "shares of the first eight harmonics, as `first_harmonic_share`")
    def harmonic_shares(self) -> np.ndarray:
        row, on = self.coils.row, self.switching.on
        middle = (row.count - 1) // 2
        step = (middle - (on - 1) // 2) % self.currents.pieces  # with a block in the middle
        centre = row.pitch * (middle + (0.5 if on % 2 == 0 else 0.0))
        points = np.arange(_WAVELENGTH_POINTS) / _WAVELENGTH_POINTS - 0.5
        x, currents = centre + self.wavelength * points, self.currents.on_piece(step, np.zeros(1))
        return harmonic_shares(np.sqrt(row.square(x, self.line.height, currents)[:, 0]))

    @scalar("ampere_turns", "largest current of a coil")
    def currents_max(self) -> float:
        return self.switching.amount(self.coils)

    @stage
    def second_route(self) -> float:
        return quadrature_error(self.coils.row, self.currents, self.line.height)

    @check(
        _ACCEPTED,
        "the field by quadrature differs by {value:.2g} of the largest; {limit:g} is accepted; "
        "write a line farther from the windings",
    )
    def field_by_quadrature(self) -> float:
        return self.second_route

    @facts
    def recheck(self) -> dict[str, Any]:
        found = {"error": self.second_route, "accepted": _ACCEPTED, "points": _CHECKED}
        return {"recheck": found}

    @warnings
    def limits_of_the_row(self) -> Iterator[str]:
        yield from self.coils.too_hot(self.currents_max)
        if not self.harmonic_shares.any():
            yield "the field does not vary along the row, so there is no wave"
        elif not math.isfinite(self.profile.ripple):
            yield "the same coils are always on, so the field does not travel and there is no wave"


def quadrature_error(row: CoilRow, currents: Gait, z: float) -> float:
    """Return the largest difference of the field to that by quadrature, over the largest field.

    The points are arbitrary.
    """
    share = (np.arange(_CHECKED) * 0.6180339887) % 1.0
    x = row.pitch * (row.count - 1) * share
    now = currents(currents.period * (share[::-1] + 0.01))
    formula = np.einsum("cmk,km->cm", row.influence(x, z), now)
    second = field_by_quadrature(row, x, z, now)
    largest = float(np.max(np.abs(second), initial=0.0))
    return float(np.max(np.abs(formula - second))) / largest if largest else 0.0
