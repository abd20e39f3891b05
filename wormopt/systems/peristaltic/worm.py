"""Kind "peristaltic-worm": simulation of a worm of membrane segments."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any, ClassVar, Literal

from wormopt.errors import Fault, SolveError
from wormopt.quantities import GRAVITY
from wormopt.result import Check, Unchecked
from wormopt.study import (
    Given,
    arrays,
    attributes,
    check,
    checks,
    entry,
    facts,
    number,
    on_use,
    parts,
    positive,
    scalar,
    scalars,
    signal,
    stage,
    value,
    warnings,
    whole,
)
from wormopt.systems.peristaltic.tables import SegmentTable, Tube
from wormopt.systems.shared.declared import EVENTS
from wormopt.systems.shared.studies import SIStudy

with on_use():
    import numpy as np

    from wormopt.model.gait import Gait
    from wormopt.model.model import Model
    from wormopt.simulation.trajectory import Trajectory
    from wormopt.systems.peristaltic.chain import (
        POWERS,
        Bed,
        Body,
        DragGround,
        DryGround,
        Ground,
        peristaltic_worm,
    )
    from wormopt.systems.peristaltic.crawl import (
        Anchors,
        SecondRoute,
        crawl,
        energy_error,
        harmonic_wave,
        second_route,
        stored,
        switched_wave,
    )
    from wormopt.systems.peristaltic.segment import Segment
    from wormopt.systems.shared.signals import event_arrays

_MU0 = 4e-7 * math.pi
_SAMPLES = 160  # least number of samples per cycle
# Accepted errors of energies, of the second route's end over the longest path, and the accepted
# part of that at a quarter of its step (a quarter at first order), unless that is noise: without
# damping, single sticks and slips that fall into one step or the next cause as much.
_ENERGY, _AGREED, _ORDER, _NOISE = 1e-6, 0.01, 0.5, 1e-4
_NONE = 1e-9  # a reserve below this counts as none
_STILL = 1e-6  # share of the stroke below which the advance of a cycle counts as none
_SETTLED = 0.01  # accepted change of the advance over the cycles of its mean, as a share
_ASSUMED = (
    "segments are sealed: no fluid is exchanged",
    "membranes are thin and incompressible; segments are cylinders",
    "the field is uniform within a coil and 0 at the segment's ends",
    "a dashpot along each segment represents all viscous losses",
)


class Worm(SegmentTable):
    """The worm: a row of sealed membrane cylinders full of magnetic fluid."""

    segments: int = whole(1, 30, "number of segments *N*; segment 0 is the head")
    density: float = positive(
        "density", "mean density of a segment, in its volume π*R*²*L*, *assumed*"
    )
    damping: float = number("drag", "damping along each segment (Kelvin-Voigt), *assumed*", least=0)
    load: float = number("force", "load on the whole worm against forward motion", default=0.0)
    gravity: float = positive("acceleration", "acceleration of gravity", default=GRAVITY)

    @property
    def mass(self) -> float:
        """Mass of a segment."""
        return self.density * math.pi * self.radius**2 * self.length


class Coils(Given):
    """One coil around each segment, and the fluid in it."""

    current: float = positive("current", "current of a coil that is on")
    field_per_current: float = positive(
        "field_per_current", "magnetic field in the fluid per current, *assumed*"
    )
    mu_r: float = number("1", "relative permeability of the fluid", above=1)
    share: float = number(
        "share",
        "share *c* of the segment's length in the field, *assumed*",
        above=0,
        below=1,
        default=0.5,
    )

    @property
    def pressure(self) -> float:
        """Magnetic pressure in the field of a coil that is on."""
        return _MU0 * (self.mu_r - 1) * (self.field_per_current * self.current) ** 2 / 2


class Wave(Given, tag_field="kind"):
    """A wave of currents along the worm."""

    direction: Literal["retrograde", "direct"] = entry(
        "`retrograde`: the wave runs from head to tail; `direct`: from tail to head",
        default="retrograde",
    )

    @property
    def retrograde(self) -> bool:
        """Whether the wave runs from head to tail."""
        return self.direction == "retrograde"

    def currents(self, segments: int, size: float) -> Gait:
        """Return the currents of one cycle, of a size where a coil is on."""
        raise NotImplementedError


class SwitchedWave(Wave, tag="switched"):
    """Coils are on or off; the block of coils that are on moves by one segment each step."""

    on: int = whole(1, 30, "number *m* of coils on at a time")
    step: float = positive("time", "time until the block moves by one segment")

    def currents(self, segments: int, size: float) -> Gait:
        return switched_wave(
            segments, self.on, step=self.step, size=size, retrograde=self.retrograde
        )


class HarmonicWave(Wave, tag="harmonic"):
    """Currents *I* (1 + cos(2π *t*/*T* − 2π *q j*/*N*))/2 in segment *j*."""

    period: float = positive("time", "*T*")
    waves: float = number(
        "1", "phase lag *q*/*N* between neighbouring segments, in periods", above=0, below=1
    )

    def currents(self, segments: int, size: float) -> Gait:
        """Return the currents of one cycle, of a largest size."""
        return harmonic_wave(
            segments, self.waves, period=self.period, size=size, retrograde=self.retrograde
        )


class Dry(Given, tag_field="kind", tag="dry"):
    """Open ground with dry friction by weight."""

    forward: float = number("1", "coefficient against sliding forward", least=0)
    backward: float = number("1", "coefficient against sliding backward", least=0)

    def law(self) -> Ground:
        """Return the ground."""
        return DryGround(self.forward, self.backward)


class Drag(Given, tag_field="kind", tag="drag"):
    """Open ground with drag *c*<sub>0</sub> (*l*/*L*)<sup>*a*</sup> at the segments' middles."""

    coefficient: float = positive("drag", "drag *c*<sub>0</sub> of a segment")
    exponent: float = number(
        "1", "exponent *a*: if positive long segments grip, if negative short ones, at 0 none"
    )

    def law(self) -> Ground:
        """Return the ground."""
        return DragGround(self.coefficient, self.exponent)


class InTube(Given, tag_field="kind", tag="tube"):
    """A straight tube: swollen segments press on its wall and grip it."""

    radius: float = positive("length", "*R*<sub>t</sub>, above that of the worm")
    friction: float = number(
        "1", "coefficient of dry friction, for weight and wall pressure", least=0
    )
    bedding: float = positive("bedding", "*k*<sub>w</sub>, wall pressure per depth, *assumed*")

    def law(self) -> Ground:
        """Return the wall as ground."""
        return Bed(Tube(self.radius, self.friction), self.bedding)


class Duration(Given):
    """Duration and accuracy of the simulation."""

    cycles: int = whole(1, 1000, "number of cycles of the wave", default=6)
    settle: int = whole(0, 999, "number of first cycles that means leave out", default=2)
    tolerance: float = number(
        "share", "relative tolerance of a step", least=1e-13, most=1e-4, default=1e-10
    )
    moreau_step: float | None = positive(
        "time",
        "longer step of the second route, which also uses a quarter of it; if left out, a "
        "twentieth of the shortest vibration's period over 2π",
        default=None,
    )

    def faults_of_keys(self) -> Iterator[Fault]:
        if self.settle >= self.cycles:
            yield "settle", f"no cycle is left; write at most {self.cycles - 1}"


@dataclass(frozen=True)
class Signals:
    """The motion over time."""

    times: np.ndarray = signal("time", "time", "time", name="time")
    position: np.ndarray = signal("length", "ring time", "position of the ring")
    current: np.ndarray = signal("current", "segment time", "current of the coil")
    stretch: np.ndarray = signal("1", "segment time", "length over unstressed length")
    normal_force: np.ndarray = signal("force", "segment time", "force of the wall")
    contact_force: np.ndarray = signal("force", "contact time", "tangential force of the ground")
    resting: np.ndarray = signal("count", "contact time", "1 while the contact rests, else 0")
    center: np.ndarray = signal("length", "time", "position of the centre of mass")
    stored: np.ndarray = signal(
        "energy", "time", "kinetic and elastic energy, including the wall's"
    )
    work_coil: np.ndarray = signal("energy", "time", "work of the coils")
    work_damping: np.ndarray = signal("energy", "time", "work of the dashpots")
    work_drag: np.ndarray = signal("energy", "time", "work of drag")
    work_friction: np.ndarray = signal("energy", "time", "work of dry friction")
    work_load: np.ndarray = signal("energy", "time", "work of the load")


@dataclass(frozen=True)
class Advance:
    """How far the worm moves in a cycle, against what its wave could do."""

    advance: float = value(
        "length", "displacement of the mass centre per cycle, mean after `settle`"
    )
    advance_ideal: float | None = value(
        "length", "(*N* − *m*) *D*, advance with ideal anchors; unknown for harmonic currents"
    )
    advance_share: float | None = value("share", "`advance` divided by `advance_ideal`")
    speed: float = value("speed", "mean speed after `time.settle` cycles")
    against_wave: int = value("1", "1: moves against its wave; −1: with it; 0: not at all")


@dataclass(frozen=True)
class Holding:
    """How well segments that a step leaves short stay in place; None if none is meant to."""

    slip: float | None = value(
        "length", "backward slip per cycle of the segments that a step leaves short: at best 0"
    )
    holding_reserve: float | None = value(
        "share", "least unused share of the friction of those segments; 0 if they slide"
    )


class PeristalticWorm(SIStudy, kind="peristaltic-worm"):
    """Simulate a worm of membrane segments with coils, on the ground or in a tube.

    Coils that are on shorten their segments, which swell. A wave of active coils moves the worm.
    Rest and sliding are resolved exactly. Theory:
    [theory-peristaltic.md](../theory-peristaltic.md#2-the-chain). Moreau-Jean time stepping, which
    uses no events, computes the motion again. Only `units = "SI"`. Parameters marked *assumed* are
    not from Zimmermann et al. 2007 [[1]](../references.md). The status is `failed` if energy is not
    balanced, the second route disagrees, or a coil pulls its segment into itself.

    `frame` are times in the last two cycles.
    """

    pictures: ClassVar = {
        "worm": "the body over the last cycle",
        "course": "positions and energies over time",
        "animation": ("the moving body, as a GIF", "animation_of_worm"),
    }
    headline: ClassVar = ("advance", "advance_share", "speed", "against_wave", "slip")

    worm: Worm = entry("the worm")
    coils: Coils = entry("the coils")
    wave: SwitchedWave | HarmonicWave = entry("switching of the coils over time")
    ground: Dry | Drag | InTube = entry("open ground, or a tube")
    anchoring: Literal["mid", "clamp"] = entry(
        "`mid`: friction acts at the middle of a segment; `clamp`: half of it at either end. "
        "Drag acts at the middle",
        default="mid",
    )
    time: Duration = entry("duration and accuracy", default=Duration)

    def faults_of_keys(self) -> Iterator[Fault]:
        yield from super().faults_of_keys()
        worm, wave, ground = self.worm, self.wave, self.ground
        if isinstance(wave, SwitchedWave) and wave.on >= worm.segments:
            yield (
                "wave.on",
                f"{wave.on} of {worm.segments} coils on leave none to switch on; write at "
                f"most {worm.segments - 1}",
            )
        yield from self._faults_of_field()
        if isinstance(ground, InTube):
            yield from worm.faults_in("ground.radius", ground.radius)
        if worm.load and not isinstance(ground, Drag):
            against = "backward" if worm.load > 0 else "forward"
            key = "friction" if isinstance(ground, InTube) else against
            if not getattr(ground, key):
                least = abs(worm.load) / (worm.segments * worm.mass * worm.gravity)
                yield (
                    f"ground.{key}",
                    f"0, and the load is {worm.load:g} N: nothing holds the worm; write "
                    f"{least:.3g} or more",
                )

    def _faults_of_field(self) -> Iterator[Fault]:
        worm, coils = self.worm, self.coils
        most = self.loading_limit * worm.shear_modulus * worm.wall / worm.radius
        if coils.pressure >= most:
            current = coils.current * math.sqrt(most / coils.pressure)
            yield (
                "coils.current",
                f"{coils.current:g} A make a magnetic pressure of {coils.pressure:.4g} "
                f"Pa; from {most:.4g} Pa a coil pulls its segment into itself; write less than "
                f"{current:.4g}",
            )

    @property
    def loading_limit(self) -> float:
        """P R / (G h) at which coil and membrane balance at the length of the coil."""
        c, a = self.coils.share, self.worm.neo_hookean
        return 2 * c * (c**-2 - c) * (a + (1 - a) / c)

    # -- the model ---------------------------------------------------------------------------------

    @cached_property
    def segment(self) -> Segment:
        """One segment in its coil."""
        return self.worm.in_coil(self.coils.share)

    @cached_property
    def body(self) -> Body:
        """All segments."""
        worm, coils = self.worm, self.coils
        return Body(
            [self.segment] * worm.segments, worm.mass, worm.damping, coils.mu_r,
            coils.field_per_current, worm.gravity, worm.load,
        )  # fmt: skip

    @cached_property
    def model(self) -> Model:
        """The worm on its ground."""
        return peristaltic_worm(self.body, self.ground.law(), self.anchoring)

    @cached_property
    def currents(self) -> Gait:
        """Currents of one cycle."""
        return self.wave.currents(self.worm.segments, self.coils.current)

    @property
    def samples(self) -> int:
        """Number of samples per cycle, the same in each piece of it."""
        return self.currents.pieces * -(-_SAMPLES // self.currents.pieces)

    # -- the motion --------------------------------------------------------------------------------

    @stage
    def motion(self) -> Trajectory:
        with np.errstate(all="ignore"):  # values that are not finite are checked where it matters
            return crawl(
                self.model,
                self.currents,
                self.time.cycles,
                nominal_work=self.body.nominal_work,
                samples=self.samples,
                relative=self.time.tolerance,
                report=self.report,
            )

    @stage
    def recheck(self) -> SecondRoute | None:
        """The end by time stepping; None if it does not get there."""
        step = self.time.moreau_step
        try:
            with np.errstate(all="ignore"):
                return second_route(self.model, self.currents, self.motion, step, self.report)
        except SolveError:
            return None

    @parts(Signals)
    def signals(self) -> Signals:
        motion = self.motion
        contacts, modes = self.model.contacts, motion.modes_at(motion.time)
        at_rest = (modes == 0).astype(float)
        return Signals(
            times=motion.time,
            position=motion["position"],
            current=motion["input"],
            stretch=motion["stretch"],
            normal_force=motion["normal_force"],
            contact_force=motion.observe(motion.system.model.forces),
            resting=at_rest if len(modes) else np.zeros((len(contacts), len(motion.time))),
            center=motion["center"][0],
            stored=stored(motion),
            **{f"work_{name}": motion[f"{name}_work"][0] for name in POWERS},
        )

    @arrays(EVENTS)
    def events(self) -> Mapping[str, np.ndarray]:
        return event_arrays([self.motion], several=False)

    # -- advance and hold --------------------------------------------------------------------------

    @cached_property
    def free_stretch(self) -> float:
        """Stretch of a segment whose coil is on, without load."""
        return self.segment.stretch_at(self.coils.pressure)

    @cached_property
    def contact_stretch(self) -> float:
        """Stretch at which a segment fills the tube; 0 without a tube."""
        ground = self.ground
        if not isinstance(ground, InTube):
            return 0.0
        return Tube(ground.radius, ground.friction).stretch_at_contact(self.segment)

    @scalar(
        "length",
        "*D*: shortening of a segment by its coil without load, or until it fills the tube",
    )
    def stroke(self) -> float:
        return self.segment.length * (1 - max(self.free_stretch, self.contact_stretch))

    @parts(Advance)
    def progress(self) -> Advance:
        wave, settle, center = self.wave, self.time.settle, self.signals.center
        moved = float(center[-1] - center[settle * self.samples])
        advance = moved / (self.time.cycles - settle)
        switched = isinstance(wave, SwitchedWave)
        ideal = (self.worm.segments - wave.on) * self.stroke if switched else None
        against = int(np.sign(advance)) * (1 if wave.retrograde else -1)
        return Advance(
            advance=advance,
            advance_ideal=ideal,
            advance_share=advance / ideal if ideal else None,
            speed=advance / self.currents.period,
            against_wave=against if abs(advance) > _STILL * self.stroke else 0,
        )

    @parts(Holding)
    def holding(self) -> Holding:
        several = isinstance(self.wave, SwitchedWave) and self.wave.on > 1
        if isinstance(self.ground, Drag) or not several:
            return Holding(None, None)
        anchors, settle = Anchors(self.currents, self.samples), self.time.settle
        return Holding(anchors.slip(self.motion, settle), anchors.reserve(self.motion, settle))

    # -- loads -------------------------------------------------------------------------------------

    @scalar("share", "mean of the coils' squared currents over `coils.current` squared")
    def coil_duty(self) -> float:
        one_cycle = self.signals.current[:, : self.samples]
        return float(np.mean(one_cycle**2)) / self.coils.current**2

    @scalar("1", "*κ* = *p*<sub>m</sub>*R*/(*Gh*)")
    def loading(self) -> float:
        return float(self.segment.loading(self.coils.pressure))

    @scalar("share", "*κ* over that at which a coil pulls its segment into itself")
    def loading_share(self) -> float:
        return self.loading / self.loading_limit

    @scalar("stress", "*p*<sub>m</sub> of a coil that is on")
    def magnetic_pressure(self) -> float:
        return self.coils.pressure

    @scalar("force", "weight of a segment")
    def weight(self) -> float:
        return self.worm.mass * self.worm.gravity

    @scalar("force", "largest force of the wall on a segment")
    def normal_force_max(self) -> float:
        return float(self.signals.normal_force.max())

    @scalar("length", "largest depth of a segment in the wall")
    def wall_depth_max(self) -> float:
        if not isinstance(self.ground, InTube):
            return 0.0
        return float(np.maximum(self.motion["radius"] - self.ground.radius, 0.0).max())

    @scalar("1", "least length of a segment, over *L*")
    def stretch_min(self) -> float:
        return float(self.signals.stretch.min())

    # -- energy and errors -------------------------------------------------------------------------

    @scalars(
        {
            "coil_work": ("energy", "work of the coils"),
            "damping_work": ("energy", "work of the dashpots"),
            "drag_work": ("energy", "work of drag"),
            "friction_work": ("energy", "work of dry friction"),
            "load_work": ("energy", "work of the load"),
        }
    )
    def works(self) -> dict[str, float]:
        return {f"{name}_work": float(self.motion[f"{name}_work"][0, -1]) for name in POWERS}

    @scalar("share", "works less the energy gained, relative to the largest of them")
    def energy_error(self) -> float:
        return energy_error(self.motion)

    @scalar("share", "difference to the second route's end, over the longest path")
    def moreau_error(self) -> float | None:
        return self.recheck and self.recheck.fine

    @scalar("count", "number of located events: reversals, sticks, releases")
    def n_events(self) -> int:
        return len(self.motion.events)

    @scalar("count", "number of integrator steps")
    def n_steps(self) -> int:
        return self.motion.n_steps

    @check(_ENERGY, "energy is not balanced; write a smaller time.tolerance")
    def energy_balance(self) -> float:
        return self.energy_error

    @checks
    def against_second_route(self) -> Iterator[Check]:
        second, remedy = self.recheck, "write a smaller time.moreau_step"
        ends = "ends elsewhere" if second else "does not finish"
        advice = f"the second route (Moreau-Jean) {ends}; {remedy}"
        yield Check("second route", self.moreau_error, _AGREED, advice)
        order = second and second.fine / max(second.coarse, _NOISE)
        advice = f"the second route does not converge at its order; {remedy}"
        yield Check("second route, order", order, _ORDER, advice)

    @check(
        1.0,
        "a coil pulled its segment into itself, which the model does not cover; write a smaller "
        "coils.current",
    )
    def coil_over_length(self) -> float:
        return self.coils.share / self.stretch_min

    # -- trust -------------------------------------------------------------------------------------

    @facts
    def routes(self) -> dict[str, Any]:
        second = self.recheck
        return {
            "route": self.motion.route,
            "moreau_step": second and second.step,
            "moreau_error_coarse": second and second.coarse,
            "assumptions": [*_ASSUMED, f"friction acts at: {self.anchoring}"],
        }

    @warnings
    def weak_or_heavy(self) -> Iterator[str]:
        worm, advance, pressure = self.worm, self.progress.advance, self.coils.pressure
        if advance * worm.load < 0 and abs(advance) > worm.segments * self.stroke:
            yield (
                f"the load of {worm.load:g} N drags the worm {abs(advance):.3g} m per cycle, more "
                "than the sum of all strokes; write a smaller worm.load"
            )
        head = 2 * worm.density * worm.gravity * worm.radius
        if 0 < pressure < head:
            yield Unchecked(
                f"the weight of the fluid makes a pressure of {head:.3g} Pa over a segment's "
                f"width, more than the {pressure:.3g} Pa of the field: segments sag and are no "
                "cylinders"
            )
        yield from self.warnings_of_anchors()
        least = self.contact_stretch
        if least and self.free_stretch >= least:
            yield (
                f"segments never reach the wall: a coil shortens them to {self.free_stretch:.5g} "
                f"of their length, but only {least:.5g} fills the tube, so nothing anchors; write "
                "a larger coils.current, or a softer or thinner wall"
            )

    @warnings
    def unsettled(self) -> Iterator[str]:
        """Yield a warning if the mean advance differs between the first and last cycles counted."""
        cycles = np.diff(self.signals.center[self.time.settle * self.samples :: self.samples])
        # whole pairs of cycles, as a motion may repeat after two
        half = 2 * (len(cycles) // 4) or len(cycles) // 2
        if not half:
            return
        first, last = cycles[:half].mean(), cycles[-half:].mean()
        if abs(last - first) > max(_SETTLED * np.abs(cycles).max(), _STILL * self.stroke):
            yield (
                f"the motion has not settled: the mean advance of a cycle is {first:.3g} m just "
                f"after time.settle and {last:.3g} m at the end; write more time.cycles and "
                "time.settle"
            )

    def warnings_of_anchors(self) -> Iterator[str]:
        """Yield a warning if segments intended to hold have no reserve."""
        reserve = self.holding.holding_reserve
        if reserve is not None and reserve < _NONE:
            in_tube = isinstance(self.ground, InTube)
            more = "ground.friction or coils.current" if in_tube else (
                "ground.forward and ground.backward"
            )  # fmt: skip
            yield (
                "anchors have no reserve: holding_reserve is 0, and segments intended to hold "
                f"slide back by {self.holding.slip:.3g} m per cycle; write larger {more}, or a "
                "smaller worm.load"
            )

    @attributes
    def drawn(self) -> dict[str, Any]:
        ground = self.ground
        return {
            "radius": self.worm.radius,
            "length": self.worm.length,
            "coil_share": self.coils.share,
            "tube": ground.radius if isinstance(ground, InTube) else None,
            "anchoring": "mid" if isinstance(ground, Drag) else self.anchoring,
            "period": self.currents.period,
            "steps": self.currents.pieces,
            "current": self.coils.current,
        }
