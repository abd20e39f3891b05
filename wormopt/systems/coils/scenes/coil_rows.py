"""Scenes of kinds "coil-row" and "coil-inverse": the field of a row of coils, and its currents."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, ClassVar, Literal

from msgspec import Meta, field

from wormopt.errors import Fault
from wormopt.scene.types import Finite, NonNegative, Positive, Seed, Table, says
from wormopt.systems.coils.scenes.material import Permeability, SIScene

Count = Annotated[int, Meta(ge=1, le=200, description="a whole number from 1 to 200")]
Margin = Annotated[int, Meta(ge=0, le=100, description="a whole number from 0 to 100")]
Amplitude = Annotated[float, Meta(gt=0, lt=1, description="a number above 0 and below 1")]
Nodes = Annotated[int, Meta(ge=8, le=200, description="a whole number from 8 to 200")]
Places = Annotated[int, Meta(ge=1, le=20, description="a whole number from 1 to 20")]
Starts = Annotated[int, Meta(ge=1, le=100, description="a whole number from 1 to 100")]
# Of their length, between facing coils: less is lost in rounding.
_LEAST_GAP = 1e-12

_SIZES = {
    "coils": ("count", "what was assumed, as the next six"),
    "pitch": ("length", "distance of neighbours"),
    "coil_inner": ("length", "inner radius"),
    "coil_outer": ("length", "outer radius"),
    "coil_length": ("length", "length along the axis"),
    "coil_gap": ("length", "gap between both coils of a place; unknown where there is only one"),
    "line_height": ("length", "height of the line"),
    "currents_limit": ("ampere_turns", "what a coil carries"),
    "current_density_limit": ("current_density", "that over the section of the winding"),
}
_RIPPLE = (
    "share",
    "root mean square of *H*² less its mean at each phase of the wave, over that of the mean's "
    "variation; unknown where nothing varies",
)
_IN_THE_FRAME = "H² in the frame of the wave, "
_PROFILE = {
    "phase": ("rad", ("phase",), "phase of the wave"),
    "square_mean": ("magnetic_field_squared", ("phase",), _IN_THE_FRAME + "mean"),
    "square_low": ("magnetic_field_squared", ("phase",), _IN_THE_FRAME + "low"),
    "square_high": ("magnetic_field_squared", ("phase",), _IN_THE_FRAME + "high"),
    "current": ("ampere_turns", ("coil", "time"), "ampere-turns"),
}


class CoilsTable(Table, frozen=True, kw_only=True):
    """A row of equal coils; sizes that the chapter does not tell are assumptions.

    So is that they belong together: 20 coils and 3000 ampere-turns are told of its section 3.5,
    the pitch of section 3.4.

    Refused: coils that overlap.
    """

    count: Annotated[Count, says("count", "places along the row; 20 in section 3.5")] = 20
    pitch: Annotated[Positive, says("length", "distance of neighbours; of section 3.4")] = 10e-3
    inner: Annotated[Positive, says("length", "inner radius of the winding; assumed")] = 2e-3
    outer: Annotated[Positive, says("length", "outer radius of the winding; assumed")] = 4.5e-3
    length: Annotated[Positive, says("length", "of the winding along the axis; assumed")] = 20e-3
    ampere_turns: Annotated[
        Positive, says("ampere_turns", "largest of a coil; 3000 in section 3.5")
    ] = 3000.0
    axis: Annotated[
        Literal["across", "along", "vertical"],
        says(
            "",
            "direction of the coils' axes: horizontal across the row (*y*), along it (*x*) or "
            "upright (*z*)",
        ),
    ] = "across"
    gap: Annotated[
        Positive | None,
        says(
            "length", "two coils at each place face each other over this gap; one coil if left out"
        ),
    ] = None

    def faults(self) -> Iterator[Fault]:
        """Yield what cannot be built."""
        if self.inner >= self.outer:
            yield (
                "coils.inner",
                f"{self.inner:g} is not below coils.outer = {self.outer:g}; the winding lies "
                "between both: write the smaller radius here",
            )
        size, what = 2 * self.outer, "twice coils.outer"
        if self.axis == "along":
            size, what = self.length, "coils.length"
        if self.pitch < size:
            yield (
                "coils.pitch",
                f"{self.pitch:g} is below {what} = {size:g}: the coils overlap; write at least "
                f"{size:g}, or smaller coils",
            )
        if self.gap is not None and self.axis == "along":
            yield "coils.gap", 'coils with axis = "along" do not face each other; leave it out'
        elif self.gap is not None and self.gap < _LEAST_GAP * self.length:
            yield (
                "coils.gap",
                f"{self.gap:g} is lost in rounding beside coils.length = {self.length:g}; write at "
                f"least {_LEAST_GAP * self.length:.3g}",
            )

    @property
    def taken(self) -> tuple[float, float]:
        """Heights between which a line along the row meets windings, above and below alike."""
        if self.axis == "along":
            return self.inner, self.outer
        if self.axis == "across":
            return (0.0, self.outer) if self.gap is None else (1.0, 0.0)
        if self.gap is None:
            return 0.0, self.length / 2
        return self.gap / 2, self.gap / 2 + self.length


class LineTable(Table, frozen=True, kw_only=True):
    """The line of the fluid, along *x*.

    Refused: a line through windings ("a coil inside the fluid"), a margin that leaves nothing.
    """

    height: Annotated[
        Finite,
        says(
            "length",
            "of the fluid's line above the middle of the coils, or of the gap; below it negative",
        ),
    ]
    margin: Annotated[
        Margin,
        says(
            "count",
            "coils at each end that are left out where the frame of the wave is looked at",
        ),
    ] = 3

    def faults(self, coils: CoilsTable) -> Iterator[Fault]:
        """Yield a fault if the line goes through a winding, or nothing is left of it."""
        low, high = coils.taken
        if low <= abs(self.height) <= high:
            inside = f", or nearer to the middle than {low:g}" if low else ""
            yield (
                "line.height",
                f"{self.height:g}: a coil inside the fluid; the line goes through windings, which "
                f"reach from {low:g} to {high:g}: write a height beyond {high:g}{inside}",
            )
        if 2 * self.margin >= coils.count - 1:
            yield (
                "line.margin",
                f"{self.margin} coils at each end leave nothing of {coils.count}; write at most "
                f"{max((coils.count - 2) // 2, 0)}",
            )


class RowScene(SIScene, frozen=True, kw_only=True):
    """A row of coils along a line of fluid."""

    coils: Annotated[CoilsTable, says("", "the row")] = field(default_factory=CoilsTable)
    line: Annotated[LineTable, says("", "where the fluid is")]

    def faults(self, folder: Path) -> Iterator[Fault]:
        """Yield faults that no single key shows."""
        yield from super().faults(folder)
        yield from self.coils.faults()
        yield from self.line.faults(self.coils)


class SwitchingTable(Table, frozen=True, kw_only=True):
    """Blocks of coils that are on, shifted by one coil again and again.

    Refused: more ampere-turns than the coils carry.
    """

    rate: Annotated[Positive, says("rate", "switches a second, the chapter's *n*")]
    on: Annotated[Count, says("count", "coils of a block")] = 3
    every: Annotated[
        Count | None,
        says(
            "count",
            "the pattern repeats after so many coils; one block in the whole row if left out",
        ),
    ] = None
    ampere_turns: Annotated[
        NonNegative | None,
        says("ampere_turns", "of each coil that is on; `coils.ampere_turns` if left out"),
    ] = None

    def faults(self, coils: CoilsTable) -> Iterator[Fault]:
        """Yield what the row cannot do, as key path and message."""
        every = coils.count if self.every is None else self.every
        if every > coils.count:
            yield (
                "switching.every",
                f"{every} is more than the {coils.count} coils of the row; write at most that",
            )
        elif self.on > every:
            yield (
                "switching.on",
                f"{self.on} coils do not fit into a pattern of {every}; write at most that",
            )
        if self.ampere_turns is not None and self.ampere_turns > coils.ampere_turns:
            yield (
                "switching.ampere_turns",
                f"{self.ampere_turns:g} is above what the coils carry; write at most "
                f"coils.ampere_turns = {coils.ampere_turns:g}",
            )


class CoilRowScene(RowScene, frozen=True, kw_only=True):
    """The travelling field of a row of coils that are switched in turn.

    The field along a row of coils that are switched in turn: three on, shifted by one at every
    switch. Theory and assumptions: [theory-coils.md](../theory-coils.md). `units` must be `"SI"`.

    The trust report: `recheck` (`error`: largest difference of the field from that by quadrature
    of Biot and Savart's law at three points, over the largest; 1e-8 is accepted), `warnings` (a
    current density that copper does not carry for long).
    """

    scalars: ClassVar = {
        "field_max": ("magnetic_field", "largest *H* on the line"),
        "wave_speed": ("speed", "pitch times switches a second"),
        "wavelength": ("length", "`switching.every` pitches"),
        "frequency": ("rate", "waves a second"),
        "first_harmonic_share": (
            "share",
            "of *H* along one wavelength about the middle of the row at one time: squared "
            "amplitude of the first harmonic over the sum of all",
        ),
        "harmonic_shares": ("share", "the same of the first eight"),
        "ripple": _RIPPLE,
        "currents_max": ("ampere_turns", "of a coil"),
    } | _SIZES
    variables: ClassVar = {
        "place": ("length", ("place",), "place along the row"),
        "time": ("time", ("time",), "middle of each step of switching"),
        "field": ("magnetic_field", ("time", "place"), "field H"),
        "coil_place": ("length", ("coil",), "place of the coil"),
    } | _PROFILE

    kind: Literal["coil-row"]
    want: Annotated[
        tuple[Literal["travelling_field"], ...],
        says(
            "",
            "`travelling_field`: map over place and time, snapshots, the field in the frame of "
            "the wave",
        ),
    ] = ()
    switching: Annotated[SwitchingTable, says("", "which coils are on when")]

    def faults(self, folder: Path) -> Iterator[Fault]:
        """Yield faults that no single key shows."""
        yield from super().faults(folder)
        yield from self.switching.faults(self.coils)


class FilmTable(Table, frozen=True, kw_only=True):
    """A film of magnetic fluid."""

    depth: Annotated[Positive, says("length", "mean thickness")]
    mu_r: Annotated[Permeability, says("1", "relative permeability")] = 1.09
    viscosity: Annotated[Positive, says("viscosity", "dynamic viscosity")] = 0.01
    density: Annotated[Positive, says("density", "enters warnings only")] = 1100.0
    surface_tension: Annotated[NonNegative, says("surface_tension", "of the fluid")] = 0.03


class WaveTable(Table, frozen=True, kw_only=True):
    """The wave that the surface shall have."""

    delta: Annotated[Amplitude, says("share", "amplitude over mean thickness")]
    wavelength: Annotated[Positive, says("length", "at least two pitches")]
    frequency: Annotated[Positive, says("angular_frequency", "of the wave")]
    field: Annotated[
        Positive | None, says("magnetic_field", "*H*<sub>0</sub>; sought if left out")
    ] = None


class CurrentLimitsTable(Table, frozen=True, kw_only=True):
    """What currents must keep to, besides the ampere-turns of the coils."""

    slew: Annotated[
        Positive | None,
        says("ampere_turn_rate", "largest change of a coil's ampere-turns; any if left out"),
    ] = None
    polarity: Annotated[
        Literal["any", "one", "alternating"],
        says(
            "",
            "currents of any sign with the period of the wave; of one sign; or such that change "
            "their sign after each period",
        ),
    ] = "any"


class CurrentSearchTable(Table, frozen=True, kw_only=True):
    """How finely and from where currents are sought."""

    nodes: Annotated[
        Nodes, says("count", "corners of the course in one period, and phases compared")
    ] = 40
    places: Annotated[Places, says("count", "places per pitch at which fields are compared")] = 3
    starts: Annotated[
        Starts, says("count", "three values of *H*<sub>0</sub>, then random ones")
    ] = 4
    seed: Annotated[Seed, says("", "the same seed gives the same starts")] = 0


class CoilInverseScene(RowScene, frozen=True, kw_only=True):
    """Currents of a row whose travelling field comes nearest to what a wave of a film needs.

    Nearest to the *H*² that a cosine wave of a film needs, (31). Theory, and what a row can carry:
    [theory-coils.md](../theory-coils.md#3-currents-for-a-field). `units` must be `"SI"`.

    The film that results is the steady one next to the wave under the mean field in the wave's
    frame, found by Newton's method; unknown where there is none. To follow a film in time under
    this field, give it to a scene of kind [`film-forward`](film-forward.md) beside your `results`
    folder: `field = { file = "results/coil_row_inverse", variable = "pressure_mean" }`.
    `gait_breaks` and `gait_polynomial` are the currents as a Gait (`load_gait`).

    The trust report: `solver`, `violation` (of the program), `bound_violation` (of the currents
    themselves), `recheck` (*H*² at three places and times by quadrature, and the residual there),
    `starts` (offset, status, residual of each), `warnings` (currents at their bound, starts that
    ended elsewhere, a residual that grows on the finer grid, what lubrication leaves out). A large
    residual is an answer and no failure. Exit code 3 where no start is solved.
    """

    scalars: ClassVar = {
        "field_residual": (
            "share",
            "root mean square of the difference of *H*² over that of *D*, on a grid four times "
            "finer in place and phase",
        ),
        "field_residual_mean": ("share", "the same of the mean over the places"),
        "field_residual_program": ("share", "at the points of the program"),
        "ripple": _RIPPLE,
        "H0": ("magnetic_field", "*H*<sub>0</sub>"),
        "H0_least": ("magnetic_field", "√*D*<sub>max</sub>"),
        "field_max": ("magnetic_field", "largest *H* on the line"),
        "currents_max": ("ampere_turns", "largest of a coil"),
        "currents_share": ("share", "over the bound"),
        "slew_max": ("ampere_turn_rate", "largest slope of a current"),
        "wavelength": ("length", "of the wave"),
        "period": ("time", "of the wave"),
        "wave_speed": ("speed", "of the wave"),
        "pressure_unit": ("stress", "*P* of (25)"),
        "tension_number": ("1", "*W* of (25)"),
        "eps": ("1", "*ε* of (25)"),
        "mean_flow": ("1", "mean flow of the wave"),
        "film_distance": ("share", "largest difference of the film that results from the wave"),
        "film_mean_flow": ("share", "what it carries"),
        "film_growth_rate": (
            "share",
            "largest rate at which a small deviation of it grows, in units of the frequency",
        ),
    } | _SIZES
    variables: ClassVar = _PROFILE | {
        "square_target": ("magnetic_field_squared", ("phase",), "H² wanted"),
        "pressure_mean": ("1", ("phase",), "(mu - 1) H² / (8 pi) over P"),
        "time": ("time", ("time",), "time"),
        "film_phase": ("rad", ("film_phase",), "phase of the wave"),
        "film_thickness": (
            "1", ("film_phase",), "thickness of the film that results, over the mean",
        ),
        "gait_breaks": ("time", ("break",), "currents as a Gait: breaks"),
        "gait_polynomial": (
            "ampere_turns", ("piece", "coil", "power"), "currents as a Gait: polynomial",
        ),
    }  # fmt: skip

    kind: Literal["coil-inverse"]
    want: Annotated[
        tuple[Literal["row_currents"], ...],
        says("", "`row_currents`: *H*² over the phase of the wave, and the currents"),
    ] = ()
    film: Annotated[FilmTable, says("", "the fluid")]
    wave: Annotated[WaveTable, says("", "the wave it shall have")]
    limits: Annotated[CurrentLimitsTable, says("", "what currents must keep to")] = field(
        default_factory=CurrentLimitsTable
    )
    search: Annotated[CurrentSearchTable, says("", "how they are sought")] = field(
        default_factory=CurrentSearchTable
    )

    def faults(self, folder: Path) -> Iterator[Fault]:
        """Yield faults that no single key shows."""
        yield from super().faults(folder)
        if self.wave.wavelength < 2 * self.coils.pitch:
            yield (
                "wave.wavelength",
                f"{self.wave.wavelength:g} is below two pitches: coils {self.coils.pitch:g} apart "
                f"do not tell such a wave from a longer one; write at least "
                f"{2 * self.coils.pitch:g}",
            )
