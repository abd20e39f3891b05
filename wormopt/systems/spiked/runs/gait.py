"""Scenes of kind ``gait``: what a given gait does to a worm with spikes, (1)-(7)."""

from __future__ import annotations

import time
from collections.abc import Iterator

from wormopt.progress import Report
from wormopt.result import Result
from wormopt.scene.scene import Scene
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
    """Crawl with the scene's gait and check the motion by a second route.

    Signals cover one period. "failed" where the two routes' speeds differ by more than 1e-9.
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
        from wormopt.systems.spiked.runs.region import mapped  # it simulates

        report("mapping periods and loads", None)
        found |= mapped(table.region or RegionTable(), motion)
    return found.result(scene)


def _warnings(motion: Crawl) -> Iterator[str]:
    if motion.glides:
        yield "the worm glides: for a while no mass rests, so forward motion is not held"
    elif motion.drops:
        yield "the kinematic velocity jumps down: the worm is thrown forward there"
    if motion.corners:
        yield "link rates jump: actuators act by impulses, force and energy have no value"
    if motion.impulses:
        yield "corners of the gait load the spikes with impulses"
