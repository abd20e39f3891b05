"""The controllers that a scene of kind ``compare-tracking`` sets against each other."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np

from wormopt.control.drive import drive
from wormopt.control.loop import with_reference
from wormopt.control.lqr import lqr
from wormopt.control.reference import follow
from wormopt.model.gait import Gait
from wormopt.model.model import Model
from wormopt.scene.scene import Scene
from wormopt.systems.chain.runs.chains import draw_links
from wormopt.systems.chain.runs.loops import build_loop, labels
from wormopt.systems.chain.runs.plans import Draw, Plan, plant_of
from wormopt.systems.chain.scenes.compare_tracking import CompareScene
from wormopt.systems.chain.scenes.track import Reference, TrackScene

LQR = "LQR, feed-forward"


@dataclass(frozen=True, eq=False)
class Rival:
    """One way of moving the worm."""

    name: str  # for tables and pictures
    model: Model  # without inputs; output ``error`` against the reference


def rivals(
    scene: Scene[CompareScene], gait: Gait, plans: Mapping[str, Plan | None]
) -> Iterator[Rival]:
    """Close the loops and put in the plans, first as they are, then with LQR around them.

    Plans that were not found are left out.
    """
    table = scene.table
    loops = _as_track_scene(scene)
    links = draw_links(table.worm, table.time.end)
    for k, name in enumerate(labels(table.tracker)):
        yield Rival(name, build_loop(loops, k, gait, links))
    yield Rival(LQR, _lqr(table, gait, None))
    found = {name: plan for name, plan in plans.items() if plan is not None}
    for name, plan in found.items():
        yield Rival(name, driven(table, gait, plan))
    for name, plan in found.items():
        yield Rival(f"{name} + LQR", _lqr(table, gait, plan))


def _as_track_scene(scene: Scene[CompareScene]) -> Scene[TrackScene]:
    """The same worm and trackers as a scene of kind "track" has them."""
    table = scene.table
    shape = next(iter(table.reference)).gait  # not looked at: the gait is given
    track = TrackScene(
        schema=1,
        kind="track",
        worm=table.worm,
        start=table.start,
        reference=Reference(gait=shape),  # type: ignore[arg-type]
        tracker=table.tracker,
        time=table.time,
    )
    return Scene(scene.name, scene.folder, track)


def driven(table: CompareScene, gait: Gait, plan: Plan) -> Model:
    """Plant under a plan, open loop, judged by the reference `gait`."""
    plant = plant_of(table, gait)
    compared = with_reference(plant, follow(gait, plant.t))
    return drive(compared, plan.inputs, periodic=plan.periodic)


def _lqr(table: CompareScene, gait: Gait, plan: Plan | None) -> Model:
    """LQR on the reference, or around a plan: its input fed forward, its lengths as reference."""
    plant, weights = plant_of(table, gait), table.lqr
    reference = follow(gait, plant.t)
    aim = reference
    if plan is not None:
        aim = follow(plan.lengths, plant.t, periodic=plan.periodic, name="course")
    loop = lqr(
        plant,
        aim,
        error_weight=weights.error_weight,
        rate_weight=weights.rate_weight,
        input_weight=weights.input_weight,
        feedforward=None if plan is None else plan.inputs,
    )
    return loop if plan is None else with_reference(loop, reference)


def draw_plants(table: CompareScene, gait: Gait) -> list[Draw]:
    """Parameters of plants that are not as believed, one draw per member.

    They depend neither on `gait` nor on how many members there are. Stiction varies with the
    sliding force of its direction.
    """
    own = {s.name: np.array(s.value, dtype=float) for s in plant_of(table, gait).p}
    spread = table.draws.spread
    found = []
    for member in range(table.draws.members):
        random = np.random.default_rng([table.draws.seed, member])
        factors = {
            name: random.uniform(1 - spread, 1 + spread, own[name].shape)
            for name in _VARIED
            if name in own
        }
        factors |= {
            f"friction_stick_{side}": factors[f"friction_{side}"]
            for side in ("forward", "backward")
            if f"friction_stick_{side}" in own
        }
        found.append({name: own[name] * factor for name, factor in factors.items()})
    return found


_VARIED = ("mass", "stiffness", "damping", "friction_forward", "friction_backward")
