"""Scenes of kind ``gait``: what a given gait does to a worm with spikes, (1)-(7)."""

from __future__ import annotations

import time
from pathlib import Path

from wormopt.core.gait import Gait
from wormopt.errors import SceneError
from wormopt.gaits.construct import accordion, block_wave, fast_gait
from wormopt.gaits.files import load_gait
from wormopt.progress import Report
from wormopt.result import Result, Scalar, unit_of
from wormopt.scenes.gait import Accordion, BlockWave, FastGait, GaitFile, GaitScene
from wormopt.scenes.scene import Scene
from wormopt.studies.motion import (
    disagreements,
    motion_scalars,
    motion_trust,
    motion_variables,
    recheck,
)
from wormopt.worms.crawl import Crawl, crawl

__all__ = ["run"]


def run(scene: Scene[GaitScene], report: Report) -> Result:
    """Crawl with the scene's gait and check the motion by a second route.

    Parameters
    ----------
    scene : Scene
        Of kind ``gait``.
    report : callable
        Told what goes on.

    Returns
    -------
    Result
        With signals over one period where pictures are wanted. Status "failed" where the two
        routes differ in speed by more than 1e-9.

    Raises
    ------
    SceneError
        If the gait's file cannot be used.
    SolveError
        If no periodic motion exists.
    """
    table = scene.table
    worm = table.worm
    clock = time.perf_counter()
    report("crawling", None)
    gait = _gait(scene)
    motion = crawl(gait, worm.masses, worm.drag, worm.load, table.gait.sharing)
    scalars = motion_scalars(motion, table.units)
    crawled = time.perf_counter()
    again = recheck(motion, worm)
    error = abs(again.speed - motion.speed)
    scalars["recheck_speed_error"] = Scalar(error, unit_of("speed", table.units))
    checked = time.perf_counter()
    trust = dict(motion_trust(motion, worm, again))
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


def _gait(scene: Scene[GaitScene]) -> Gait:
    shape, links = scene.table.gait, scene.table.worm.links
    if isinstance(shape, FastGait):
        return fast_gait(shape.period, shape.rest_length, shape.elongation)
    if isinstance(shape, GaitFile):
        return _gait_from_file(scene, shape)
    length, ramp = (shape.length[0], shape.length[1]), shape.ramp or 0.0
    if isinstance(shape, BlockWave):
        return block_wave(links, shape.resting, shape.period, length, shape.profile, ramp)
    assert isinstance(shape, Accordion)
    return accordion(links, shape.period, length, shape.profile, ramp)


def _gait_from_file(scene: Scene[GaitScene], shape: GaitFile) -> Gait:
    path = scene.folder / Path(shape.file)
    try:
        gait = load_gait(path)
    except (OSError, ValueError) as error:
        raise SceneError(scene.name, [("gait.file", f"{shape.file}: {error}")]) from None
    if gait.links != scene.table.worm.links:
        message = f"the file has {gait.links} links; set worm.links = {gait.links}"
        raise SceneError(scene.name, [("gait.file", message)])
    return gait if shape.period is None else gait.with_period(shape.period)


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
