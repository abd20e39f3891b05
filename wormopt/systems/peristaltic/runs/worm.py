"""Runs of kind ``peristaltic-worm``: a worm of membrane segments, on the ground or in a tube."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from time import perf_counter
from typing import Any

import numpy as np

from wormopt.errors import Interrupted, SolveError
from wormopt.model.gait import Gait
from wormopt.model.model import Model
from wormopt.progress import Report
from wormopt.result import Check, Result, Unchecked
from wormopt.simulation.trajectory import Trajectory
from wormopt.study.conclude import conclude
from wormopt.study.scene import Scene
from wormopt.systems.peristaltic.chain.chain import POWERS, Body, peristaltic_worm
from wormopt.systems.peristaltic.chain.crawl import (
    Anchors,
    SecondRoute,
    crawl,
    energy_error,
    second_route,
    stored,
)
from wormopt.systems.peristaltic.chain.ground import Bed, DragGround, DryGround, Ground
from wormopt.systems.peristaltic.chain.waves import harmonic_wave, switched_wave
from wormopt.systems.peristaltic.scenes.worm import (
    DragTable,
    DryTable,
    PeristalticWormScene,
    SwitchedWave,
    TubeTable,
)
from wormopt.systems.peristaltic.segment.segment import Segment, Tube
from wormopt.systems.shared.signals import event_arrays

_SAMPLES = 160  # least number of samples per cycle
# Accepted errors of energies, of the second route's end over the longest path, and the accepted
# part of that at a quarter of its step (a quarter at first order), unless that is noise: without
# damping, single sticks and slips that fall into one step or the next cause as much.
_ENERGY, _AGREED, _ORDER, _NOISE = 1e-6, 0.01, 0.5, 1e-4
_NONE = 1e-9  # a reserve below this counts as none
_ASSUMED = (
    "segments are sealed: no fluid is exchanged",
    "membranes are thin and incompressible; segments are cylinders",
    "the field is uniform within a coil and 0 at the segment's ends",
    "a dashpot along each segment represents all viscous losses",
)


@dataclass(frozen=True, eq=False)
class WormCase:
    """Model of a scene."""

    table: PeristalticWormScene

    @cached_property
    def segment(self) -> Segment:
        """Return one segment."""
        worm = self.table.worm
        return Segment(
            worm.length, worm.radius, worm.wall, worm.shear_modulus, self.table.coils.share,
            worm.neo_hookean,
        )  # fmt: skip

    @cached_property
    def body(self) -> Body:
        """Return all segments."""
        worm, coils = self.table.worm, self.table.coils
        return Body(
            [self.segment] * worm.segments, worm.mass, worm.damping, coils.mu_r,
            coils.field_per_current, worm.gravity, worm.load,
        )  # fmt: skip

    @property
    def ground(self) -> Ground:
        """Return the ground."""
        ground = self.table.ground
        if isinstance(ground, DryTable):
            return DryGround(ground.forward, ground.backward)
        if isinstance(ground, DragTable):
            return DragGround(ground.coefficient, ground.exponent)
        return Bed(Tube(ground.radius, ground.friction), ground.bedding)

    @cached_property
    def course(self) -> Gait:
        """Return the currents of one cycle."""
        wave, n, size = self.table.wave, self.table.worm.segments, self.table.coils.current
        ahead = wave.direction == "retrograde"
        if isinstance(wave, SwitchedWave):
            return switched_wave(n, wave.on, step=wave.step, size=size, retrograde=ahead)
        return harmonic_wave(n, wave.waves, period=wave.period, size=size, retrograde=ahead)

    @property
    def samples(self) -> int:
        """Return the number of samples per cycle, the same in each piece of it."""
        return self.course.pieces * -(-_SAMPLES // self.course.pieces)

    @cached_property
    def free_stretch(self) -> float:
        """Return the stretch of a segment whose coil is on, without load."""
        return self.segment.stretch_at(self.table.coils.pressure)

    @property
    def stroke(self) -> float:
        """Return the shortening of a segment by its coil; in a tube, until it fills it."""
        ground, short = self.ground, self.free_stretch
        if isinstance(ground, Bed):
            short = max(short, ground.tube.stretch_at_contact(self.segment))
        return self.segment.length * (1 - short)

    @property
    def advance_ideal(self) -> float | None:
        """Return the advance per cycle with ideal anchors."""
        wave, n = self.table.wave, self.table.worm.segments
        return (n - wave.on) * self.stroke if isinstance(wave, SwitchedWave) else None

    @property
    def anchors(self) -> Anchors | None:
        """Return the segments intended to anchor."""
        wave = self.table.wave
        known = isinstance(wave, SwitchedWave) and wave.on > 1
        known &= not isinstance(self.table.ground, DragTable)
        return Anchors(self.course, self.samples) if known else None


@np.errstate(all="ignore")  # values that are not finite are checked where it matters
def run(scene: Scene[PeristalticWormScene], report: Report) -> Result:
    """Simulate the worm, then again by time stepping without events.

    Raises SolveError if the motion cannot be followed, or Interrupted.
    """
    case, settings, begin = WormCase(scene.table), scene.table.course, perf_counter()
    model = peristaltic_worm(case.body, case.ground, scene.table.anchoring)
    motion = crawl(
        model,
        case.course,
        settings.cycles,
        nominal_work=case.body.nominal_work,
        samples=case.samples,
        relative=settings.tolerance,
        report=report,
    )
    moved = perf_counter()
    try:
        second = second_route(model, case.course, motion, settings.moreau_step, report)
    except (SolveError, Interrupted) as error:
        if isinstance(error, Interrupted):
            reason = "interrupted before the second route was finished"
            raise Interrupted(_result(scene, case, motion, None, {}).failed(reason)) from None
        second = None
    timings = {"motion": moved - begin, "recheck": perf_counter() - moved}
    return _result(scene, case, motion, second, timings)


def _result(
    scene: Scene[PeristalticWormScene],
    case: WormCase,
    motion: Trajectory,
    second: SecondRoute | None,
    timings: dict[str, float],
) -> Result:
    scalars = _scalars(case, motion, second)
    ground = scene.table.ground
    return conclude(
        scene,
        scalars,
        _signals(motion) | event_arrays([motion], several=False),
        checks=_checks(case, scalars, second),
        facts={
            "route": motion.route,
            "moreau_step": second and second.step,
            "moreau_error_coarse": second and second.coarse,
            "assumptions": [*_ASSUMED, f"friction acts at: {scene.table.anchoring}"],
        },
        warnings=_warnings(case, scalars),
        timings=timings,
        attributes={
            "radius": case.segment.radius,
            "length": case.segment.length,
            "coil_share": case.segment.coil_share,
            "tube": ground.radius if isinstance(ground, TubeTable) else None,
            "anchoring": "mid" if isinstance(ground, DragTable) else scene.table.anchoring,
            "period": case.course.period,
            "steps": case.course.pieces,
            "current": scene.table.coils.current,
        },
    )


def _scalars(case: WormCase, motion: Trajectory, second: SecondRoute | None) -> dict[str, Any]:
    table, settle = case.table, case.table.course.settle
    center = motion["center"][0]
    cycles = table.course.cycles - settle
    advance = float(center[-1] - center[settle * case.samples]) / cycles
    ideal, anchors = case.advance_ideal, case.anchors
    wave = 1 if table.wave.direction == "direct" else -1
    limit = table.loading_limit
    loading = float(case.segment.loading(table.coils.pressure))
    moves = abs(advance) > 1e-6 * case.stroke
    size = table.coils.current
    return {
        "advance": advance,
        "advance_ideal": ideal,
        "advance_share": advance / ideal if ideal else None,
        "speed": advance / case.course.period,
        "against_wave": -wave * int(np.sign(advance)) if moves else 0,
        "stroke": case.stroke,
        "slip": anchors.slip(motion, settle) if anchors else None,
        "holding_reserve": anchors.reserve(motion, settle) if anchors else None,
        "coil_duty": float(np.mean(motion["input"][:, : case.samples] ** 2)) / size**2,
        "loading": loading,
        "loading_share": loading / limit,
        "magnetic_pressure": table.coils.pressure,
        "weight": table.worm.mass * table.worm.gravity,
        "normal_force_max": float(motion["normal_force"].max()),
        "wall_depth_max": _depth(case, motion),
        "stretch_min": float(motion["stretch"].min()),
        **{f"{name}_work": float(motion[f"{name}_work"][0, -1]) for name in POWERS},
        "energy_error": energy_error(motion),
        "moreau_error": second and second.fine,
        "n_events": len(motion.events),
        "n_steps": motion.n_steps,
    }


def _depth(case: WormCase, motion: Trajectory) -> float:
    ground = case.table.ground
    if not isinstance(ground, TubeTable):
        return 0.0
    return float(np.maximum(motion["radius"] - ground.radius, 0.0).max())


def _signals(motion: Trajectory) -> dict[str, np.ndarray]:
    model: Model = motion.system.model
    return {
        "time": motion.time,
        "position": motion["position"],
        "current": motion["input"],
        "stretch": motion["stretch"],
        "normal_force": motion["normal_force"],
        "contact_force": motion.observe(model.forces),
        "resting": _resting(motion),
        "center": motion["center"][0],
        "stored": stored(motion),
        **{f"work_{name}": motion[f"{name}_work"][0] for name in POWERS},
    }


def _resting(motion: Trajectory) -> np.ndarray:
    modes = motion.modes_at(motion.time)
    count = len(motion.system.model.contacts)
    return (modes == 0).astype(float) if len(modes) else np.zeros((count, len(motion.time)))


def _checks(case: WormCase, scalars: dict[str, Any], second: SecondRoute | None) -> Iterator[Check]:
    yield Check(
        "energy balance", scalars["energy_error"], _ENERGY,
        "energy is not balanced; write a smaller course.tolerance",
    )  # fmt: skip
    ends = "ends elsewhere" if second else "does not finish"
    advice = f"the second route (Moreau-Jean) {ends}; write a smaller course.moreau_step"
    yield Check("second route", second and second.fine, _AGREED, advice)
    yield Check(
        "second route, order",
        second and second.fine / max(second.coarse, _NOISE),
        _ORDER,
        "the second route does not converge at its order; write a smaller course.moreau_step",
    )
    yield Check(
        "coil over length",
        case.segment.coil_share / scalars["stretch_min"],
        1.0,
        "a coil pulled its segment into itself, which the model does not cover; write a "
        "smaller coils.current",
    )


def _warnings(case: WormCase, scalars: dict[str, Any]) -> Iterator[str]:
    ground, worm, advance = case.ground, case.table.worm, scalars["advance"]
    if advance * worm.load < 0 and abs(advance) > worm.segments * case.stroke:
        yield (
            f"the load of {worm.load:g} N drags the worm {abs(advance):.3g} m per cycle, more than "
            "the sum of all strokes; write a smaller worm.load"
        )
    head, pressure = 2 * worm.density * worm.gravity * worm.radius, case.table.coils.pressure
    if 0 < pressure < head:
        yield Unchecked(
            f"the weight of the fluid makes a pressure of {head:.3g} Pa over a segment's width, "
            f"more than the {pressure:.3g} Pa of the field: segments sag and are no cylinders"
        )
    reserve = scalars["holding_reserve"]
    if reserve is not None and reserve < _NONE:
        more = "ground.forward and ground.backward"
        more = "ground.friction or coils.current" if isinstance(ground, Bed) else more
        yield (
            "anchors have no reserve: holding_reserve is 0, and segments intended to hold slide "
            f"back by {scalars['slip']:.3g} m per cycle; write larger {more}, or a smaller "
            "worm.load"
        )
    if not isinstance(ground, Bed):
        return
    least = ground.tube.stretch_at_contact(case.segment)
    if case.free_stretch >= least:
        yield (
            f"segments never reach the wall: a coil shortens them to {case.free_stretch:.5g} of "
            f"their length, but only {least:.5g} fills the tube, so nothing anchors; write a "
            "larger coils.current, or a softer or thinner wall"
        )
