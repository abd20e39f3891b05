"""Scenes of kind ``gait``: what a given gait does to a worm with spikes, (1)-(7)."""

from __future__ import annotations

import time

from wormopt.progress import Report
from wormopt.quantities import Scalar, unit_of
from wormopt.result import Result
from wormopt.scene.scene import Scene
from wormopt.systems.spiked.crawl import Crawl, crawl
from wormopt.systems.spiked.runs.motion import (
    disagreements,
    motion_scalars,
    motion_trust,
    motion_variables,
    recheck,
)
from wormopt.systems.spiked.runs.reference import gait_of_shape
from wormopt.systems.spiked.scenes.gait import GaitScene


def run(scene: Scene[GaitScene], report: Report) -> Result:
    """Crawl with the scene's gait and check the motion by a second route.

    Signals cover one period. "failed" where the two routes' speeds differ by more than 1e-9.
    """
    table = scene.table
    worm = table.worm
    clock = time.perf_counter()
    report("crawling", None)
    gait = gait_of_shape(table.gait, scene)
    motion = crawl(gait, worm.masses, worm.drag, worm.worm.load_range[1], table.gait.sharing)
    scalars = motion_scalars(motion, table.units)
    crawled = time.perf_counter()
    again = recheck(motion)
    error = abs(again.speed - motion.speed)
    scalars["recheck_speed_error"] = Scalar(error, unit_of("speed", table.units))
    checked = time.perf_counter()
    trust = dict(motion_trust(motion, again))
    warnings = _warnings(motion)
    faults = disagreements(motion, again)
    return Result(
        scene=scene.name,
        kind=table.kind,
        title=scene.title,
        status="failed" if faults else "ok",
        reason="; ".join(faults),
        scalars=scalars,
        variables=tuple(motion_variables(motion, table.units)) if table.want else (),
        trust=trust | {"warnings": warnings},
        timings_s={"crawl": crawled - clock, "recheck": checked - crawled},
        scene_text=scene.text,
    )


def _warnings(motion: Crawl) -> list[str]:
    found = []
    if motion.glides:
        found.append("the worm glides: for a while no mass rests, so forward motion is not held")
    elif motion.drops:
        found.append("the kinematic velocity jumps down: the worm is thrown forward there")
    if motion.corners:
        found.append("link rates jump: actuators act by impulses, force and energy have no value")
    if motion.impulses:
        found.append("corners of the gait load the spikes with impulses")
    return found
