"""Scenes of kinds "coil-row" and "coil-inverse": the field of a row of coils, and its currents."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, ClassVar, Literal

from msgspec import Meta

from wormopt.errors import Fault
from wormopt.study.given import Given, entry, number, positive, whole
from wormopt.study.types import Seed
from wormopt.systems.coils.scenes.material import Permeability, SIScene

Starts = Annotated[int, Meta(ge=1, le=100, description="a whole number from 1 to 100")]
# Least gap of facing coils over their length; smaller gaps are lost in round-off.
_LEAST_GAP = 1e-12

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
_RIPPLE = (
    "share",
    "root mean square of *H*² less its mean at each phase of the wave, over that of the mean's "
    "variation; unknown if nothing varies",
)
_IN_THE_FRAME = "H² in the frame of the wave, "
_PROFILE = {
    "phase": ("rad", ("phase",), "phase of the wave"),
    "square_mean": ("magnetic_field_squared", ("phase",), _IN_THE_FRAME + "mean"),
    "square_low": ("magnetic_field_squared", ("phase",), _IN_THE_FRAME + "low"),
    "square_high": ("magnetic_field_squared", ("phase",), _IN_THE_FRAME + "high"),
    "current": ("ampere_turns", ("coil", "time"), "ampere-turns"),
}


class CoilsTable(Given):
    """A row of equal coils.

    Sizes marked *assumed* are not published in Zimmermann et al. 2007 [[1]](../references.md). That
    these values belong together is also an assumption: 20 coils and 3000 ampere-turns are from its
    section 3.5, the pitch is from section 3.4.

    Coils that overlap are refused.
    """

    count: int = whole(1, 200, "number of places along the row; 20 in section 3.5", default=20)
    pitch: float = positive("length", "distance of neighbours; from section 3.4", default=10e-3)
    inner: float = positive("length", "inner radius of the winding; assumed", default=2e-3)
    outer: float = positive("length", "outer radius of the winding; assumed", default=4.5e-3)
    length: float = positive("length", "axial length of the winding; assumed", default=20e-3)
    ampere_turns: float = positive(
        "ampere_turns", "largest ampere-turns of a coil; 3000 in section 3.5", default=3000.0
    )
    axis: Literal["across", "along", "vertical"] = entry(
        "direction of the coils' axes: horizontal across the row (*y*), along it (*x*) or "
        "upright (*z*)",
        default="across",
    )
    gap: float | None = positive(
        "length",
        "gap between two facing coils at each place; a single coil if left out",
        default=None,
    )

    def faults(self) -> Iterator[Fault]:
        """Yield rows that cannot be built."""
        if self.inner >= self.outer:
            yield (
                "coils.inner",
                f"{self.inner:g} is not below coils.outer = {self.outer:g}; write a radius below "
                "coils.outer",
            )
        size, what = 2 * self.outer, "twice coils.outer"
        if self.axis == "along":
            size, what = self.length, "coils.length"
        if self.pitch < size:
            yield (
                "coils.pitch",
                f"{self.pitch:g} is below {what} = {size:g}, so the coils overlap; write at least "
                f"{size:g}, or smaller coils",
            )
        if self.gap is not None and self.axis == "along":
            yield "coils.gap", 'coils with axis = "along" do not face each other; leave it out'
        elif self.gap is not None and self.gap < _LEAST_GAP * self.length:
            yield (
                "coils.gap",
                f"{self.gap:g} is lost in round-off beside coils.length = {self.length:g}; write "
                f"at least {_LEAST_GAP * self.length:.3g}",
            )

    @property
    def taken(self) -> tuple[float, float]:
        """Heights between which a line along the row meets windings, symmetric above and below."""
        if self.axis == "along":
            return self.inner, self.outer
        if self.axis == "across":
            return (0.0, self.outer) if self.gap is None else (1.0, 0.0)
        if self.gap is None:
            return 0.0, self.length / 2
        return self.gap / 2, self.gap / 2 + self.length


class LineTable(Given):
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

    def faults(self, coils: CoilsTable) -> Iterator[Fault]:
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
                "a single coil is no row along which a wave travels; write 2 or more",
            )
        elif 2 * self.margin >= coils.count - 1:
            yield (
                "line.margin",
                f"{self.margin} coils at each end leave nothing of {coils.count}; write at most "
                f"{(coils.count - 2) // 2}",
            )


class RowScene(SIScene):
    """A row of coils along a line of fluid."""

    coils: CoilsTable = entry("the row", default=CoilsTable)
    line: LineTable = entry("line of the fluid")

    def faults(self, folder: Path) -> Iterator[Fault]:
        """Yield faults that no single key shows."""
        yield from super().faults(folder)
        yield from self.coils.faults()
        yield from self.line.faults(self.coils)


class SwitchingTable(Given):
    """Blocks of active coils, shifted by one coil at every switch.

    More ampere-turns than the coils carry are refused.
    """

    rate: float = positive("rate", "switches per second, *n* of Zimmermann et al.")
    on: int = whole(1, 200, "number of coils in a block", default=3)
    every: int | None = whole(
        1,
        200,
        "number of coils after which the pattern repeats; a single block if left out",
        default=None,
    )
    ampere_turns: float | None = number(
        "ampere_turns",
        "ampere-turns of an active coil; `coils.ampere_turns` if left out",
        least=0,
        default=None,
    )

    def faults(self, coils: CoilsTable) -> Iterator[Fault]:
        """Yield patterns and currents beyond the limits of the row."""
        every = coils.count if self.every is None else self.every
        if every > coils.count:
            yield (
                "switching.every",
                f"{every} exceeds the {coils.count} coils of the row; write at most that",
            )
        elif self.on > every:
            yield (
                "switching.on",
                f"{self.on} coils do not fit into a pattern of {every}; write at most that",
            )
        if self.ampere_turns is not None and self.ampere_turns > coils.ampere_turns:
            yield (
                "switching.ampere_turns",
                f"{self.ampere_turns:g} exceeds the limit of the coils; write at most "
                f"coils.ampere_turns = {coils.ampere_turns:g}",
            )


class CoilRowScene(RowScene):
    """The travelling field of a row of coils that are switched in turn.

    By default three coils are on, shifted by one at every switch. Theory and assumptions:
    [theory-coils.md](../theory-coils.md). `units` must be `"SI"`.

    The trust report has `recheck` and `warnings`. `error` of `recheck` is the largest difference
    of the field to a quadrature of the Biot-Savart law at three points, over the largest field;
    1e-8 is accepted. `warnings` report a current density that copper cannot carry for long.
    """

    scalars: ClassVar = {
        "field_max": ("magnetic_field", "largest *H* on the line"),
        "wave_speed": ("speed", "pitch times switches per second"),
        "wavelength": ("length", "`switching.every` pitches"),
        "frequency": ("rate", "waves per second"),
        "first_harmonic_share": (
            "share",
            "share of the first harmonic of *H* along one wavelength about the middle of the row "
            "at one time: its squared amplitude over the sum of all",
        ),
        "harmonic_shares": ("share", "the same for the first eight harmonics"),
        "ripple": _RIPPLE,
        "currents_max": ("ampere_turns", "largest current of a coil"),
    } | _SIZES
    variables: ClassVar = {
        "place": ("length", ("place",), "position along the row"),
        "time": ("time", ("time",), "middle of each step of switching"),
        "field": ("magnetic_field", ("time", "place"), "field H"),
        "coil_place": ("length", ("coil",), "position of the coil"),
    } | _PROFILE

    kind: Literal["coil-row"]
    want: tuple[Literal["travelling_field"], ...] = entry(
        "`travelling_field`: map over place and time, snapshots, the field in the frame of "
        "the wave",
        default=(),
    )
    switching: SwitchingTable = entry("sequence of active coils")

    def faults(self, folder: Path) -> Iterator[Fault]:
        """Yield faults that no single key shows."""
        yield from super().faults(folder)
        yield from self.switching.faults(self.coils)


class FilmTable(Given):
    """A film of magnetic fluid."""

    depth: float = positive("length", "mean thickness")
    mu_r: Permeability = entry("relative permeability", quantity="1", default=1.09)
    viscosity: float = positive("viscosity", "dynamic viscosity", default=0.01)
    density: float = positive("density", "density, used for warnings only", default=1100.0)
    surface_tension: float = number("surface_tension", "surface tension", least=0, default=0.03)


class WaveTable(Given):
    """The wanted wave of the surface."""

    delta: float = number("share", "amplitude over mean thickness", above=0, below=1)
    wavelength: float = positive("length", "wavelength, at least two pitches")
    frequency: float = positive("angular_frequency", "angular frequency of the wave")
    field: float | None = positive(
        "magnetic_field", "*H*<sub>0</sub>; optimised if left out", default=None
    )


class CurrentLimitsTable(Given):
    """Limits of the currents, besides the ampere-turns of the coils."""

    slew: float | None = positive(
        "ampere_turn_rate",
        "largest rate of a coil's ampere-turns; unlimited if left out",
        default=None,
    )
    polarity: Literal["any", "one", "alternating"] = entry(
        "sign of the currents: any, with the period of the wave; a single sign; or a change "
        "of sign after each period",
        default="any",
    )


class CurrentSearchTable(Given):
    """Resolution and starting points of the search."""

    nodes: int = whole(
        8, 200, "corners of the waveform in a period, and number of phases compared", default=40
    )
    places: int = whole(1, 20, "places per pitch at which fields are compared", default=3)
    starts: int = whole(
        1, 100, "number of starts: three values of *H*<sub>0</sub>, then random ones", default=4
    )
    seed: Seed = entry("seed; equal seeds give equal starts", default=0)


class CoilInverseScene(RowScene):
    """Currents of a row whose travelling field is closest to that needed for a wave of a film.

    The wanted *H*² for a cosine wave of the film is eq. 31 of Zimmermann et al. 2007
    [[1]](../references.md). Theory, and the range of fields of a row:
    [theory-coils.md](../theory-coils.md#3-currents-for-a-field). `units` must be `"SI"`.

    The resulting film is the steady film nearest to the wave under the mean field in the wave's
    frame. Newton's method finds it; it is unknown if there is none. To simulate a film under this
    field, use a scene of kind [`film-forward`](film-forward.md) beside your `results` folder with
    `field = { file = "results/coil_row_inverse", variable = "pressure_mean" }`.
    `gait_breaks` and `gait_polynomial` are the currents as a Gait (`load_gait`).

    The trust report has `solver`, `violation` (of the program), `bound_violation` (of the currents
    themselves), and `recheck` (*H*² at three places and times by quadrature, and the residual
    there). `starts` lists offset, status and residual of each start. `warnings` report currents at
    their bound, starts with different results, a residual that grows on the finer grid, and effects
    that lubrication neglects. A large residual is a valid result, not a failure. The exit code is 3
    if no start is solved.
    """

    scalars: ClassVar = {
        "field_residual": (
            "share",
            "root mean square of the error of *H*² over that of *D*, on a grid four times finer in "
            "place and phase",
        ),
        "field_residual_mean": ("share", "the same for the mean over the places"),
        "field_residual_program": ("share", "the same at the points of the program"),
        "ripple": _RIPPLE,
        "H0": ("magnetic_field", "*H*<sub>0</sub>"),
        "H0_least": ("magnetic_field", "√*D*<sub>max</sub>"),
        "field_max": ("magnetic_field", "largest *H* on the line"),
        "currents_max": ("ampere_turns", "largest current of a coil"),
        "currents_share": ("share", "largest current over its bound"),
        "slew_max": ("ampere_turn_rate", "largest slope of a current"),
        "wavelength": ("length", "wavelength of the wave"),
        "period": ("time", "period of the wave"),
        "wave_speed": ("speed", "speed of the wave"),
        "pressure_unit": ("stress", "*P* of eq. 25 of Zimmermann et al."),
        "tension_number": ("1", "*W* of eq. 25"),
        "eps": ("1", "*ε* of eq. 25"),
        "mean_flow": ("1", "mean flow of the wave"),
        "film_distance": ("share", "largest difference of the resulting film to the wave"),
        "film_mean_flow": ("share", "mean flow of the resulting film"),
        "film_growth_rate": (
            "share",
            "largest growth rate of small deviations of that film, in units of the frequency",
        ),
    } | _SIZES
    variables: ClassVar = _PROFILE | {
        "square_target": ("magnetic_field_squared", ("phase",), "wanted H²"),
        "pressure_mean": ("1", ("phase",), "(mu - 1) H² / (8 pi) over P"),
        "time": ("time", ("time",), "time"),
        "film_phase": ("rad", ("film_phase",), "phase of the wave"),
        "film_thickness": (
            "1", ("film_phase",), "thickness of the resulting film, over its mean",
        ),
        "gait_breaks": ("time", ("break",), "currents as a Gait: breaks"),
        "gait_polynomial": (
            "ampere_turns", ("piece", "coil", "power"), "currents as a Gait: polynomial",
        ),
    }  # fmt: skip

    kind: Literal["coil-inverse"]
    want: tuple[Literal["row_currents"], ...] = entry(
        "`row_currents`: *H*² over the phase of the wave, and the currents", default=()
    )
    film: FilmTable = entry("the fluid")
    wave: WaveTable = entry("wanted wave of its surface")
    limits: CurrentLimitsTable = entry("limits of the currents", default=CurrentLimitsTable)
    search: CurrentSearchTable = entry("resolution and starting points", default=CurrentSearchTable)

    def faults(self, folder: Path) -> Iterator[Fault]:
        """Yield faults that no single key shows."""
        yield from super().faults(folder)
        if self.wave.wavelength < 2 * self.coils.pitch:
            yield (
                "wave.wavelength",
                f"{self.wave.wavelength:g} is below two pitches; coils {self.coils.pitch:g} apart "
                f"cannot distinguish this wave from a longer one; write at least "
                f"{2 * self.coils.pitch:g}",
            )
