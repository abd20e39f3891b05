"""Runs scenes of kind ``gait``: the motion of a worm with spikes and a given gait."""

from __future__ import annotations

import time
from collections.abc import Iterator

from wormopt.progress import Report
from wormopt.result import Result
from wormopt.study.scene import Scene
from wormopt.systems.shared.transport import assumed
from wormopt.systems.spiked.crawl import Crawl, crawl
from wormopt.systems.spiked.runs.motion import (
    Findings,
    agreement,
    cross_check,
    motion_facts,
    motion_scalars,
    motion_variables,
)
from wormopt.systems.spiked.runs.reference import gait_of_shape
from wormopt.systems.spiked.scenes.gait import GaitScene, RegionTable


def run(scene: Scene[GaitScene], report: Report) -> Result:
    """Compute the motion for the scene's gait and check it by an independent computation.

    Signals cover one period. The result is "failed" if the two speeds differ by more than 1e-9.
    """
    table, worm = scene.table, scene.table.worm
    clock = time.perf_counter()
    report("crawling", None)
    gait = gait_of_shape(table.gait, scene)
    plant = worm.worm
    loads = plant.loads(plant.load_range[1])
    motion = crawl(gait, plant.masses, plant.drag, loads, table.gait.sharing)
    crawled = time.perf_counter()
    again = cross_check(motion)
    found = Findings(
        motion_scalars(motion, again, table.units),
        motion_variables(motion) if table.want else {},
        tuple(agreement(motion, again)),
        motion_facts(motion, again) | assumed(table.units),
        tuple(_warnings(motion)),
        {"crawl": crawled - clock, "recheck": time.perf_counter() - crawled},
    )
    if "region" in table.want:
        from wormopt.systems.spiked.runs.region import mapped  # imports the simulator

        report("mapping periods and loads", None)
        found |= mapped(table.region or RegionTable(), motion)
    return found.result(scene)


def _warnings(motion: Crawl) -> Iterator[str]:
    if motion.glides:
        yield "the worm glides: at some times no mass rests and nothing holds the forward motion"
    elif motion.drops:
        yield "the kinematic velocity jumps down: there the worm is thrown forward"
    if motion.corners:
        yield "link rates jump: actuators act by impulses, so force and energy are undefined"
    if motion.impulses:
        yield "corners of the gait cause impulses on the spikes"
