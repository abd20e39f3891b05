"""Kind "peristaltic-segment": one membrane segment, its coil and its tube."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import Any, ClassVar

from wormopt.errors import ArgumentError, Fault, SceneError, SolveError
from wormopt.quantities import GRAVITY
from wormopt.result import Unchecked
from wormopt.study import (
    Given,
    attributes,
    check,
    entry,
    facts,
    number,
    on_use,
    parts,
    positive,
    signal,
    stage,
    value,
    warnings,
    whole,
)
from wormopt.study.types import Pair, wrong_order
from wormopt.systems.peristaltic.tables import SegmentTable, Tube
from wormopt.systems.shared.studies import SIStudy, refused_at, wrong_winding

with on_use():
    import numpy as np

    from wormopt.magnetics.winding import Coil
    from wormopt.numerics.chebyshev import resolve
    from wormopt.systems.peristaltic.membranes import (
        WIDEST,
        Balloon,
        Fibres,
        balloon,
        barrel_swelling,
        inflated,
        largest_loading,
        limit_of_inflation,
        range_of_fill,
    )
    from wormopt.systems.peristaltic.segment import Segment, WoundSegment, density, slopes

_ACCEPTED = 1e-9
_NONE = 1e-9  # a reserve below this share counts as none
_ASSUMED = {
    "sealed": "no fluid leaves or enters the segment, so uniform pressure does not deform it; "
    "only [inflation] lets fluid in",
    "ideal coil": "the field of [coil] is uniform over a share of the segment and 0 at its ends; "
    "[winding] has the field on the axis of a real coil, which the fluid does not change",
    "cylinder": "the segment stays a cylinder, its ends as wide as its middle; barrel_radius and "
    "[inflation] show the effect of rings at the ends",
    "no wrinkles": "the wall carries the axial compression that a sealed cylinder has when it "
    "shortens; a shell with so thin a wall buckles at a stroke of about 2 h / (3 R)",
    "caps": "the pull of the field across the ends, chi times the pressure there, is neglected",
    "rubber": "incompressible, without creep, hysteresis or bending stiffness of the wall",
}


class IdealCoil(Given):
    """An ideal coil: a uniform field over a share of the segment, none beyond."""

    pressure: float = number(
        "stress", "magnetic pressure μ<sub>0</sub>χ*H*²/2 in the fluid", least=0
    )
    share: float = number(
        "share", "share of the segment's length in the field", above=0, most=1, default=0.5
    )


class Fluid(Given):
    """The magnetic fluid in the segment."""

    density: float = positive("density", "density of the fluid", default=1200.0)
    chi: float = positive("1", "susceptibility", default=0.35)


class Winding(Given):
    """A real coil around the middle of the segment, for comparison."""

    ampere_turns: float = positive("current", "current times turns")
    inner_radius: float = positive("length", "inner radius; above segment and tube")
    outer_radius: float = positive("length", "outer radius of the winding")
    length: float = positive("length", "length along the segment")

    def faults_of_keys(self) -> Iterator[Fault]:
        yield from wrong_winding(self.inner_radius, self.outer_radius)


class Inflation(Given):
    """A given inner pressure, for segments that share their fluid or have a pump."""

    pressure: float = positive("stress", "pressure, up to the limit of inflation")
    fibre_angle: float | None = number(
        "angle",
        "angle of inextensible fibres to the axis; no fibres if left out",
        above=0,
        below=1.5707,
        default=None,
    )
    fill: float | None = number(
        "share",
        "volume of a sealed segment over the largest with these fibres; needs `fibre_angle`",
        above=0,
        most=1,
        default=None,
    )

    def faults_of_keys(self) -> Iterator[Fault]:
        if self.fill is not None and self.fibre_angle is None:
            yield "fill", "needs fibres; write inflation.fibre_angle"


@dataclass(frozen=True)
class Strokes:
    """Effect of the coil on a segment that touches no tube."""

    stroke: float = value("share", "free stroke: shortening by the coil over the length")
    stroke_loaded: float = value(
        "share", "stroke against the load both ways; 0 if the coil is too weak"
    )
    swelling: float = value("length", "growth of the radius over the free stroke")
    stretch: float = value("share", "length over unstressed length, in the coil")
    stretch_extended: float = value(
        "share", "`stretch` when extended without field against the load"
    )
    stretch_loaded: float = value("share", "`stretch` when shortened in the coil against the load")
    stretch_deepest: float = value("share", "least stretch at this pressure with the best coil")
    loading: float = value("1", "κ = *pR*/(*Gh*) of the coil's pressure")
    coil_pull: float = value("force", "pull of the coil at the unstressed length")
    barrel_radius: float = value("length", "largest radius between rings for a parabolic meridian")
    weight: float = value("force", "weight of the fluid")
    head: float = value("stress", "hydrostatic pressure of the fluid over the segment's width")


@dataclass(frozen=True)
class Curves:
    """Strokes up to twice the coil's pressure, and forces over the stretch."""

    pressure: np.ndarray = signal("stress", "pressure", "magnetic pressure of the coil")
    free_stroke: np.ndarray = signal("share", "pressure", "stroke without load")
    loaded_stroke: np.ndarray = signal("share", "pressure", "stroke against the load")
    deepest_stroke: np.ndarray = signal("share", "pressure", "stroke with the best coil")
    axial_stretch: np.ndarray = signal("share", "axial_stretch", "length over unstressed length")
    return_forces: np.ndarray = signal("force", "axial_stretch", "push of the rubber on the ends")
    coil_pulls: np.ndarray = signal("force", "axial_stretch", "pull of the ideal coil")


@dataclass(frozen=True)
class Hold:
    """Forces of a segment that fills its tube."""

    moves: bool = value("1", "whether it fills the tube, holds the load and pushes itself forward")
    normal_force: float = value("force", "normal force on the tube wall; 0 if it does not reach it")
    holding: float = value("force", "friction limit by this normal force")
    holding_loaded: float = value("force", "`holding` while the load pulls the ends apart")
    drag: float = value("force", "friction of one relaxed segment on the tube, by its weight")
    gap: float = value("length", "distance between the unstressed segment and the wall")
    stretch_contact: float = value("share", "stretch at which it fills the tube")
    surplus: float = value("force", "axial pull carried by the wall; negative if it does not touch")
    return_force: float = value(
        "force", "push of the rubber on its ends, from contact with the wall"
    )
    pressure_to_wall: float | None = value(
        "stress", "magnetic pressure at which it begins to touch"
    )
    modulus_to_wall: float = value(
        "stress", "shear modulus at which this pressure just reaches the wall"
    )


@dataclass(frozen=True)
class RealCoil:
    """The segment in the field of a real coil."""

    winding_pressure: float = value("stress", "magnetic pressure in the middle of the real coil")
    winding_share: float = value("share", "share of the ideal coil that pulls like the real one")
    winding_stretch: float = value("share", "stretch in the real coil")
    field_place: np.ndarray = signal(
        "length", "field_place", "axial distance from the coil's middle"
    )
    field_pressure: np.ndarray = signal(
        "stress", "field_place", "magnetic pressure of the real coil"
    )
    winding_pulls: np.ndarray = signal("force", "axial_stretch", "pull of the real coil")


@dataclass(frozen=True)
class Inflated:
    """A cylinder under the given pressure."""

    pressure_max: float | None = value(
        "stress", "limit of inflation, where the cylinder becomes unstable"
    )
    inflated_hoop: float = value(
        "share", "radius over unstressed radius of a cylinder at the pressure"
    )
    inflated_stretch: float = value("share", "length over unstressed length of that cylinder")


@dataclass(frozen=True)
class WithFibres:
    """A cylinder with fibres under the given pressure."""

    fibre_stretch: float = value("share", "length over unstressed length with fibres")
    fibre_angle: float = value("angle", "angle of the fibres at the pressure")


@dataclass(frozen=True)
class Filled:
    """Angles between which the fibres of a sealed segment remain."""

    fill_angle_low: float = value("angle", "least angle of fibres around a sealed segment")
    fill_angle_high: float = value("angle", "largest angle of fibres around a sealed segment")


@dataclass(frozen=True)
class Swollen:
    """The true membrane under the given pressure."""

    membrane_hoop: float = value(
        "share", "radius in the middle of the membrane over that of the rings"
    )
    membrane_stretch: float = value("share", "length over unstressed length of the membrane")
    membrane_volume: float = value("share", "volume over unstressed volume of the membrane")
    membrane_place: np.ndarray = signal(
        "length", "membrane_point", "distance from the membrane's middle"
    )
    membrane_radius: np.ndarray = signal("length", "membrane_point", "radius of the membrane")


class PeristalticSegment(SIStudy, kind="peristaltic-segment"):
    """Compute a membrane segment in its coil and tube: stroke, wall force, limits.

    The segment is a sealed rubber tube full of magnetic fluid, which a coil shortens. The scene
    computes its stroke without load, against a load, and up to the wall of a tube. It computes the
    normal force on the wall, the load that this force holds, and whether such segments can move.
    A real coil is compared with the ideal one. A given pressure is applied to a segment that is
    not sealed: as a cylinder, a true membrane, and with fibres. Theory and assumptions:
    [theory-peristaltic.md](../theory-peristaltic.md#1-the-segment). Only `units = "SI"`.

    The trust report names its `assumptions`. It checks stretches and wall force against the
    energy, and the true membrane by its first integral. `warnings` state why a segment does not
    move and which values suffice, and whether it is too soft for the weight of its fluid.
    """

    pictures: ClassVar = {
        "segment": "shapes in coil and tube",
        "stroke": "stroke over pressure, and the forces",
    }
    headline: ClassVar = ("stroke", "stroke_loaded", "swelling", "moves", "normal_force")

    segment: SegmentTable = entry("the segment")
    coil: IdealCoil = entry("the coil")
    fluid: Fluid = entry("the fluid", default=Fluid)
    load: float = number(
        "force", "drag on the ends, which the segment must overcome and hold", least=0, default=0.0
    )
    pipe: Tube | None = entry("the tube; none if left out", default=None)
    winding: Winding | None = entry("the real coil; none if left out", default=None)
    inflation: Inflation | None = entry("a given pressure; none if left out", default=None)
    stretches: Pair = entry(
        "range of stretches in the plot of forces", quantity="share", default=(0.85, 1.1)
    )
    samples: int = whole(11, 1000, "number of points of the curves", default=101)
    gravity: float = positive("acceleration", "acceleration of gravity", default=GRAVITY)

    def faults_of_keys(self) -> Iterator[Fault]:
        yield from super().faults_of_keys()
        yield from wrong_order("stretches", self.stretches, may_be_equal=False)
        segment, tube, winding = self.segment, self.pipe, self.winding
        if tube:
            yield from segment.faults_in("pipe.radius", tube.radius)
        outside = max(segment.radius, tube.radius if tube else 0.0)
        if winding and winding.inner_radius <= outside:
            yield (
                "winding.inner_radius",
                f"{winding.inner_radius:g} m is not outside segment and tube; write more than "
                f"{outside:g}",
            )

    # -- the free segment --------------------------------------------------------------------------

    @cached_property
    def body(self) -> Segment:
        """The segment in its coil."""
        return self.segment.in_coil(self.coil.share)

    @parts(Strokes)
    def strokes(self) -> Strokes:
        segment, pressure, load = self.body, self.coil.pressure, self.load
        with refused_at(self, "segment.shear_modulus"):
            stretch = segment.stretch_at(pressure)
            longest, loaded = segment.stretch_at(0.0, -load), segment.stretch_at(pressure, load)
            deepest = segment.deepest_stretch(pressure)
        specific_weight = self.fluid.density * self.gravity
        return Strokes(
            stroke=1 - stretch,
            stroke_loaded=max(longest - loaded, 0.0),
            swelling=segment.radius_at(stretch) - segment.radius,
            stretch=stretch,
            stretch_extended=longest,
            stretch_loaded=loaded,
            stretch_deepest=deepest,
            loading=segment.loading(pressure),
            coil_pull=segment.coil_pull(1.0, pressure),
            barrel_radius=segment.radius * barrel_swelling(stretch),
            weight=specific_weight * segment.volume,
            head=2 * specific_weight * segment.radius,
        )

    @parts(Curves)
    def curves(self) -> Curves:
        segment, load = self.body, self.load
        most = 2 * self.coil.pressure or segment.shear_modulus * segment.wall / segment.radius
        pressures, stretches = np.linspace(0.0, most, self.samples), self.plotted_stretches
        with refused_at(self, "segment.shear_modulus"):
            free, loaded, deepest = (
                np.array([stretch(p) for p in pressures])
                for stretch in (
                    segment.stretch_at,
                    lambda p: segment.stretch_at(p, load),
                    segment.deepest_stretch,
                )
            )
        return Curves(
            pressure=pressures,
            free_stroke=1 - free,
            loaded_stroke=np.maximum(self.strokes.stretch_extended - loaded, 0.0),
            deepest_stroke=1 - deepest,
            axial_stretch=stretches,
            return_forces=-segment.elastic_pull(stretches),
            coil_pulls=segment.coil_pull(stretches, self.coil.pressure),
        )

    @cached_property
    def plotted_stretches(self) -> np.ndarray:
        """Stretches at which forces are plotted."""
        least, largest = self.stretches
        return np.linspace(least, largest, self.samples)

    @check(
        _ACCEPTED,
        "the stretch differs by {value:.2g} from that of the least energy",
        name="stretch of the least energy",
    )
    def stretch_error(self) -> float:
        segment, pressure, stretch = self.body, self.coil.pressure, self.strokes.stretch

        def energy(stretch: np.ndarray) -> np.ndarray:
            return (segment.energy(stretch) + segment.magnetic_energy(stretch, pressure))[None]

        low = max(0.9 * stretch, segment.coil_share)
        series = resolve(energy, low, 1.1 * stretch)
        rests = np.array([low, *series.derivative().roots(0)])
        return abs(rests[np.argmin(series(rests)[0])] - stretch)

    # -- the segment in its tube -------------------------------------------------------------------

    @property
    def walls(self) -> Tube:
        """The tube, where there is one."""
        assert self.pipe
        return self.pipe

    @parts(Hold, when="pipe")
    def hold(self) -> Hold:
        segment, tube, pressure, load = self.body, self.walls, self.coil.pressure, self.load
        stretch = tube.stretch_at_contact(segment)
        push, unit = -segment.elastic_pull(stretch), segment.coil_pull(stretch, 1.0)
        free, loaded = (max(tube.normal_force(segment, pressure, f), 0.0) for f in (0.0, load))
        drag, holding = tube.friction * self.strokes.weight, tube.friction * loaded
        return Hold(
            moves=bool(holding > 0 and holding >= load + drag and push >= drag),
            normal_force=free,
            holding=tube.friction * free,
            holding_loaded=holding,
            drag=drag,
            gap=tube.radius - segment.radius,
            stretch_contact=stretch,
            surplus=tube.surplus(segment, pressure),
            return_force=push,
            pressure_to_wall=push / unit if unit else None,
            modulus_to_wall=segment.shear_modulus * pressure * unit / push,
        )

    @check(
        _ACCEPTED,
        "the normal force differs by {value:.2g} from the derivative of the energy",
        when="pipe",
        name="work of the wall",
    )
    def wall_work(self) -> float:
        return wall_work_error(self.body, self.walls, self.coil.pressure)

    # -- the segment in a real coil ----------------------------------------------------------------

    @parts(RealCoil, when="winding")
    def real_coil(self) -> RealCoil:
        assert self.winding
        winding, turns = self.winding, self.winding.ampere_turns
        coil = Coil(winding.inner_radius, winding.outer_radius, winding.length)
        wound = WoundSegment(self.body, coil, self.fluid.chi)
        places = self.body.length * np.linspace(-0.75, 0.75, self.samples)
        return RealCoil(
            winding_pressure=wound.pressure(0.0, turns),
            winding_share=wound.share(1.0),
            winding_stretch=wound.stretch_at(turns),
            field_place=places,
            field_pressure=wound.pressure(places, turns),
            winding_pulls=wound.coil_pull(self.plotted_stretches, turns),
        )

    # -- the segment under a given pressure --------------------------------------------------------

    @parts(Inflated, when="inflation")
    def cylinder(self) -> Inflated:
        assert self.inflation
        a, pressure, segment = self.segment.neo_hookean, self.inflation.pressure, self.body
        limit, unit = limit_of_inflation(a), 1 / segment.loading(1.0)
        try:
            _, hoop, stretch = inflated(segment.loading(pressure), a)
        except ArgumentError:
            most = largest_loading(a) * unit
            swells = f"the pressure that swells it {WIDEST:g}-fold"
            what = "the limit of inflation" if limit else swells
            message = f"{pressure:g} Pa is above {what}; write at most {most:.6g}"
            raise SceneError(self.name, [("inflation.pressure", message)]) from None
        return Inflated(limit.loading * unit if limit else None, hoop, stretch)

    @cached_property
    def fibres(self) -> Fibres | None:
        """Fibres around the segment, if there are any."""
        angle = self.inflation and self.inflation.fibre_angle
        return None if angle is None else Fibres(self.body, angle)

    @parts(WithFibres, when="fibres")
    def with_fibres(self) -> WithFibres:
        assert self.inflation
        assert self.fibres
        with refused_at(self, "inflation.fibre_angle"):
            angle = self.fibres.angle_at(self.inflation.pressure)
        return WithFibres(float(self.fibres.stretches(angle)[0]), angle)

    @property
    def fill(self) -> float | None:
        """Volume over the largest one with fibres, if given."""
        return self.inflation and self.inflation.fill

    @parts(Filled, when="fill")
    def filled(self) -> Filled:
        assert self.fill
        return Filled(*range_of_fill(self.fill))

    @stage
    def membrane(self) -> Balloon | None:
        """The true membrane; None without pressure, or if it bends too sharply to be resolved."""
        if self.inflation is None:
            return None
        _ = self.cylinder  # SceneError for a pressure above the limit
        segment = self.body
        loading = segment.loading(self.inflation.pressure)
        try:
            return balloon(
                segment.length / segment.radius, loading=loading, neo_hookean=segment.neo_hookean
            )
        except SolveError as error:
            if error.code == "unresolved":
                return None
            raise

    @parts(Swollen, when="membrane")
    def swollen(self) -> Swollen:
        shape, radius = self.membrane, self.body.radius
        assert shape
        return Swollen(
            shape.radius[0], shape.stretch, shape.volume, radius * shape.place,
            radius * shape.radius,
        )  # fmt: skip

    @check(
        _ACCEPTED,
        "the first integral of the membrane varies by {value:.2g} along it",
        when="membrane",
        name="first integral of the membrane",
    )
    def first_integral(self) -> float:
        """Spread of w - lam_1 w_1 along the meridian."""
        shape, a = self.membrane, self.segment.neo_hookean
        assert shape
        radius, _, stretch, _, _ = shape.solution.at(np.linspace(0.0, 1.0, len(shape.radius)))
        along, _ = slopes(stretch, radius, a)
        return float(np.ptp(density(stretch, radius, a) - stretch * along))

    # -- trust -------------------------------------------------------------------------------------

    @facts
    def assumed(self) -> dict[str, Any]:
        return {"assumptions": _ASSUMED}

    @warnings
    def weak_or_heavy(self) -> Iterator[str]:
        if self.pipe and not self.hold.moves:
            yield f"the segment will not move: {self.why_at_rest()}"
        if self.pipe and self.hold.moves and self.spare <= _NONE:
            yield (
                "the segment moves without any reserve: the wall just holds load and drag, or the "
                "rubber just overcomes the drag"
            )
        if 0 < self.coil.pressure < self.strokes.head:
            yield Unchecked(
                f"the weight of the fluid makes a pressure of {self.strokes.head:.3g} Pa over its "
                f"width, more than the {self.coil.pressure:.3g} Pa of the field: the segment sags"
            )
        if self.strokes.stretch == self.coil.share:
            yield "the coil pulls the whole segment into its uniform field, where its pull ends"
        if self.inflation and self.membrane is None:
            yield (
                "the true membrane is not computed: at this small pressure it bends only at its "
                "rings, too sharply to be resolved, and is a cylinder elsewhere"
            )

    @property
    def spare(self) -> float:
        """Least unused share of hold and push in the tube."""
        hold = self.hold
        return min(
            1 - (self.load + hold.drag) / hold.holding_loaded, 1 - hold.drag / hold.return_force
        )

    def why_at_rest(self) -> str:
        """Return why the segment does not move, with values that suffice."""
        hold, needed = self.hold, self.load + self.hold.drag
        if not hold.normal_force:
            asks = [f"coil.share below {hold.stretch_contact:.4g}"]
            if hold.pressure_to_wall:
                asks = [f"coil.pressure = {hold.pressure_to_wall:.4g}"]
            if hold.modulus_to_wall:
                asks.append(f"segment.shear_modulus = {hold.modulus_to_wall:.4g}")
            return (
                f"it swells by {1e6 * self.strokes.swelling:.3g} µm of the {1e6 * hold.gap:.3g} µm "
                f"to the wall; write {', or '.join(asks)}"
            )
        if not needed:
            return "without friction nothing holds; write a pipe.friction above 0"
        if hold.holding_loaded < needed:
            return (
                f"the wall holds {1e3 * hold.holding_loaded:.3g} mN, less than load and drag, "
                f"{1e3 * needed:.3g} mN"
            )
        return (
            f"the rubber pushes with {1e3 * hold.return_force:.3g} mN against a drag of "
            f"{1e3 * hold.drag:.3g} mN"
        )

    @attributes
    def sizes(self) -> dict[str, Any]:
        """Sizes that plots need beside the results; lengths in m."""
        sizes = {
            "length": self.segment.length,
            "radius": self.segment.radius,
            "coil_share": self.coil.share,
            "coil_pressure": self.coil.pressure,
            "load": self.load,
        }
        if self.pipe:
            sizes["tube_radius"] = self.pipe.radius
        if self.inflation:
            sizes["inflation_pressure"] = self.inflation.pressure
        if self.winding:
            sizes["winding_length"] = self.winding.length
        return sizes


def wall_work_error(segment: Segment, tube: Tube, pressure: float) -> float:
    """Compare the normal force with minus the derivative of the energy by the tube's radius."""

    def energy(radius: np.ndarray) -> np.ndarray:
        stretch = (segment.radius / radius) ** 2
        return (segment.energy(stretch) + segment.magnetic_energy(stretch, pressure))[None]

    # on the side where the coil's pull does not end
    pulled = tube.stretch_at_contact(segment) >= segment.coil_share
    low, high = (0.99, 1.0) if pulled else (1.0, 1.01)
    series = resolve(energy, low * tube.radius, high * tube.radius)
    work = -float(series.derivative()(np.array([tube.radius]))[0, 0])
    size = abs(work) + 2 * segment.length / tube.radius * segment.stiffness
    return abs(work - tube.normal_force(segment, pressure)) / size
