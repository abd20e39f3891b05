"""Worms as robots of a physics engine: bodies, joints, ground and targets of the joints."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np

from wormopt.errors import ArgumentError
from wormopt.exports.common import ExportedGait, remarks
from wormopt.model.friction import Coulomb, Law, Spike
from wormopt.model.gait import Gait
from wormopt.result import Result
from wormopt.study.scene import scene_of_text
from wormopt.study.types import per
from wormopt.systems.chain.loops import laws_of
from wormopt.systems.planar.design.gaits import side_times
from wormopt.systems.planar.shape import Polygon, Stroke
from wormopt.systems.planar.tables import EllipticGround
from wormopt.systems.spiked import Worm

# Mass of a slow body, whose scene has none, over friction times cycle² over length: inertia changes
# the displacement by about this share of the length.
_LIGHT = 1e-5
_SAMPLES = 1000  # of a cycle, for ranges of joints and forces

DIFFERS = "Differs from the scene:"
"""Beginning of remarks on what an engine lacks."""

Targets = Callable[[np.ndarray], tuple[np.ndarray, np.ndarray]]


@dataclass(frozen=True, eq=False)
class Robot:
    """A chain of masses, head first, whose joints follow targets over a cycle.

    Joints are ``link_j``, the length between masses j and j + 1, and in the plane ``joint_j``, the
    angle at mass j + 1, positive if the front is turned to the left.
    """

    name: str
    mass: np.ndarray  # (n + 1,)
    drag: np.ndarray  # of each mass, on a line
    load: np.ndarray
    grips: Sequence[tuple[float, float, float]]  # friction forward, backward, sideways
    cycle: float
    targets: Targets  # of times (m,): values and rates of all joints (m, q)
    displacement: tuple[float, float, float] | None = (
        None  # x, y, angle per cycle with exact contact
    )
    lengths: tuple[float, ...] | None = None  # of links that do not slide
    planar: bool = False
    heading: str = "rear"  # of inner masses
    trailed: tuple[float, float, float] = (0.0, 0.0, 0.0)  # in the plane, on the head
    elastic: np.ndarray | None = None  # stiffness and damping (2, q) of joints without servos
    fall: float = 0.0  # acceleration of all masses against x
    root: np.ndarray = field(default_factory=lambda: np.zeros((2, 3)))  # x, y, yaw; their rates
    begin: np.ndarray | None = None  # values and rates (2, q) at the start; default: the targets
    hold: float = 0.0  # of spikes, which hold any force in the scene
    massless: bool = False  # in its scene
    notes: tuple[str, ...] = ()  # what differs from the scene
    remarks: tuple[str, ...] = ()

    @property
    def links(self) -> int:
        """Number of links."""
        return len(self.mass) - 1

    @property
    def joints(self) -> list[str]:
        """Names of the joints with a target."""
        slides = [f"link_{j}" for j in range(self.links)] if self.lengths is None else []
        return slides + [f"joint_{j}" for j in range(self.links - 1) if self.planar]

    @cached_property
    def reach(self) -> np.ndarray:
        """Least and largest value and largest rate of each joint (q, 3), sampled."""
        value, rate = self.targets(self.cycle * np.arange(_SAMPLES) / _SAMPLES)
        return np.stack([value.min(axis=0), value.max(axis=0), np.abs(rate).max(axis=0)], axis=1)

    @property
    def size(self) -> float:
        """Mean length of a link."""
        return float(
            np.mean(self.reach[: self.links, :2] if self.lengths is None else self.lengths)
        )

    def table(self, steps: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Times of a whole cycle in steps, and the targets of the joints there (steps + 1, q)."""
        t = self.cycle * np.arange(steps) / steps
        value, rate = (np.vstack([rows, rows[:1]]) for rows in self.targets(t))
        return np.append(t, self.cycle), value, rate


def robot_of(result: object) -> Robot:
    """Make the robot of a result; raises ArgumentError if its kind has none."""
    if not isinstance(result, Result):
        raise ArgumentError(f"a robot needs a Result, not {type(result).__name__}")
    made = _KINDS.get(result.kind)
    if made is None:
        raise ArgumentError(
            f"{result.scene}: a result of kind {result.kind} holds no chain with targets of its "
            f"joints, which mjcf and urdf need; use kind {', '.join(_KINDS)}"
        )
    table = scene_of_text(result.scene, result.kind, result.scene_text).table
    bare = "the scene has no units: its units are taken as m, s and kg"
    units = () if table.units == "SI" else (bare,)
    return replace(made(result, table), remarks=(*remarks(result), *units))


# -- on a line -------------------------------------------------------------------------------------


def _spiked(result: Result, table: Any) -> Robot:
    worm, gait = table.worm, ExportedGait.of(result).gait
    masses = worm.links + 1
    found = result.scalars
    speed = found.get("speed_ideal", found.get("speed"))  # without steps of motors
    displacement = None if speed is None else (float(speed.value) * gait.period, 0.0, 0.0)
    robot = _on_a_line(result, worm, worm.loads(worm.load_range[1]), gait, [Spike()] * masses)
    return replace(robot, displacement=displacement, **_started(result))


def _rubbing(result: Result, _: Any) -> Robot:
    found = {name: one.value for name, one in result.scalars.items()}
    mass, gait = found["mass_found"], ExportedGait.of(result).gait
    worm = Worm(len(mass) - 1, tuple(mass), found["drag_found"])
    pairs = zip(found["forward_found"], found["backward_found"], strict=True)
    laws = [Coulomb(forward, backward) for forward, backward in pairs]
    robot = _on_a_line(result, worm, tuple(found["load_found"]), gait, laws)
    displacement = (found["speed"] * gait.period, 0.0, 0.0)
    return replace(robot, displacement=displacement, **_started(result))


def _tracked(result: Result, table: Any) -> Robot:
    worm, gait = table.worm, ExportedGait.of(result).gait
    robot = _on_a_line(result, worm, worm.pull, gait, laws_of(worm))
    note = "the controller is not in this file: servos follow its reference"
    return replace(robot, notes=(*robot.notes, note))


def _commanded(result: Result, table: Any) -> Robot:
    worm = table.worm
    gait, shift = table.command(np.array(per(worm.rest_length, worm.links))) if worm else (None, 0)
    if gait is None or worm.random:
        raise ArgumentError(
            f"{result.scene}: mjcf and urdf need commanded lengths of links that are not random; "
            'use a scene with [worm] and actuation.law = "gait" or "harmonic"'
        )
    elastic = np.array([per(getattr(worm, n), worm.links) for n in ("stiffness", "damping")])
    robot = _on_a_line(result, worm, worm.pull, gait, laws_of(worm), shift)
    return replace(robot, elastic=elastic, **_started(result))


def _started(result: Result) -> dict[str, np.ndarray]:
    """Position and velocity at the start of a result on a line, if it has them."""
    if "velocity" not in result:
        return {}
    rows = np.array([result[name].values[:, 0] for name in ("position", "velocity")])
    return {"root": np.pad(rows[:, :1], ((0, 0), (0, 2))), "begin": -np.diff(rows)}


def _on_a_line(
    result: Result,
    worm: Any,
    loads: float | tuple[float, ...],
    gait: Gait,
    laws: Sequence[Law],
    shift: float = 0.0,
) -> Robot:
    mass, drag, load = (np.array(per(n, worm.links + 1)) for n in (worm.mass, worm.drag, loads))
    t = gait.period * np.arange(_SAMPLES) / _SAMPLES
    pace, bend = (float(np.abs(gait(t, k)).sum(axis=0).max()) for k in (1, 2))
    # half of it bounds the forces of the ground: no mass is faster than all links together
    hold = 2 * float(np.abs(load).sum() + drag.sum() * pace + mass.sum() * bend) or 1.0
    grips, notes = [(0.0, 0.0, 0.0)] * len(mass), ()
    for i, law in enumerate(laws):
        drag[i] += float(getattr(law, "drag", 0.0))  # of Viscous
        ahead, back = (float(getattr(law, n, 0.0)) for n in ("forward", "backward"))
        grips[i] = (ahead, hold if isinstance(law, Spike) else back, 0.0)
        sticks = (getattr(law, f"stick_{n}", None) or 0.0 for n in ("forward", "backward"))
        if any(s > f for s, f in zip(sticks, (ahead, back), strict=True)):
            notes = ("stiction is replaced by the sliding force",)
    return Robot(
        result.scene,
        mass,
        drag,
        load,
        grips,
        gait.period,
        lambda t: (gait(t + shift).T, gait(t + shift, 1).T),
        hold=hold if any(isinstance(law, Spike) for law in laws) else 0.0,
        notes=notes,
    )


# -- in the plane ----------------------------------------------------------------------------------


def _crawling(result: Result, table: Any) -> Robot:
    stroke = table.stroke.stroke()
    grips = table.ground.numbers(table.body.links + 1)
    load = table.load.numbers
    return _slow(result, table.body, stroke, table.period * stroke.breaks, grips, trailed=load)


def _turning(result: Result, table: Any) -> Robot:
    ends, middle = table.worm.end_friction, table.worm.middle_friction
    times = np.cumsum([0.0, *table.durations, *table.durations])
    return _slow(result, None, table.worm.stroke, times, [(f, f, f) for f in (ends, middle, ends)])


def _designed(result: Result, table: Any) -> Robot:
    aim = table.task
    if table.ground is None or not aim.closed or "corner" not in result:
        raise ArgumentError(
            f"{result.scene}: mjcf and urdf need dry ground and a gait that repeats; use a design "
            'with [ground] and objective.purpose = "speed" or "turn"'
        )
    corners = result["corner"].values
    grips = table.grips or (1.0,) * (table.body.links + 1)
    numbers = [tuple(grip * number for number in table.ground.numbers) for grip in grips]
    times = np.cumsum([0.0, *side_times(aim, corners)])
    return _slow(result, table.body, Polygon(corners), times, numbers)


def _slow(
    result: Result,
    body: Any,
    stroke: Stroke,
    times: np.ndarray,
    grips: Sequence[Any],
    **more: Any,
) -> Robot:
    """A slow body, whose mass has to be small; `times` are those of the stroke's breaks."""
    cycle, breaks = float(times[-1]), stroke.breaks

    def targets(t: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        side = np.clip(np.searchsorted(times, t, side="right") - 1, 0, len(times) - 2)
        pace = (np.diff(breaks) / np.diff(times))[side]
        shape, rate = stroke.at(np.minimum(breaks[side] + (t - times[side]) * pace, 1.0))
        return shape, rate * pace[:, None]

    lengths = body.sizes if body else None
    size = float(np.mean(lengths or targets(np.zeros(1))[0][0, : len(grips) - 1]))
    mass = _LIGHT * min(map(min, grips)) * cycle**2 / size
    displacement = None
    if "displacement" in result.scalars:  # not in a result that failed early
        x, y = result.scalars["displacement"].value
        displacement = (x, y, result.scalars["turn"].value)
    return Robot(
        result.scene,
        np.full(len(grips), mass),
        np.zeros(len(grips)),
        np.zeros(len(grips)),
        grips,
        cycle,
        targets,
        displacement,
        lengths,
        planar=True,
        heading=body.heading if body else "bisector",
        massless=True,
        notes=_oval(grips),
        **more,
    )


def _oval(grips: Sequence[tuple[float, float, float]]) -> tuple[str, ...]:
    """Remark on friction that differs ahead and back."""
    if all(ahead == back for ahead, back, _ in grips):
        return ()
    return (
        "friction that differs ahead and back is one ellipse about their mean and a constant "
        "push: exact along the heading, not across it, unless a controller sets the friction by "
        "the direction of motion (wormopt.exports.play.friction_by_direction)",
    )


def _swinging(result: Result, table: Any) -> Robot:
    """A worm of springs in the plane: forces on them are targets of their rest lengths."""
    worm, drive, n = table.worm, table.actuation, table.worm.links
    keys = [f"{b}stiffness" for b in ("", "bending_")], [f"{b}damping" for b in ("", "bending_")]
    elastic = np.array(
        [[*per(getattr(worm, a), n), *per(getattr(worm, b), n - 1)] for a, b in keys]
    )
    grounds = table.ground if isinstance(table.ground, tuple) else (table.ground,) * (n + 1)
    wrong = {
        "actuation": drive is None,
        "worm.stiffness or bending_stiffness of 0": not elastic[0].all(),
        "ground.law": not all(isinstance(ground, EllipticGround) for ground in grounds),
        "worm.rod_mass": worm.rod_mass is not None,
        "obstacles": bool(table.obstacles),
    }
    if any(wrong.values()):
        keys = ", ".join(key for key, is_wrong in wrong.items() if is_wrong)
        raise ArgumentError(
            f"{result.scene}: mjcf and urdf do not support {keys}; "
            'use springs with periodic forces on ground of law = "elliptic", without rods and '
            "obstacles"
        )
    rest = np.array([*per(worm.rest_length, n), *per(worm.rest_angle, n - 1)])
    forces = [
        one.harmonics(count) if one else Polygon(np.zeros((2, count)))
        for one, count in ((drive.force, n), (drive.torque, n - 1))
    ]

    def targets(t: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        force, rate = map(
            np.hstack, zip(*(one.at(t / drive.period) for one in forces), strict=True)
        )
        return rest + force / elastic[0], rate / drive.period / elastic[0]

    start = table.start
    place, speed = start.places(worm)[0], start.velocities(worm)[0]
    begin = rest.copy()
    if start.lengths is not None:
        begin[:n] = start.lengths
    if start.angles is not None:
        begin[n:] = start.angles
    yaw = start.direction + float(begin[n:].sum())
    return Robot(
        result.scene,
        np.array(per(worm.mass, n + 1)),
        np.zeros(n + 1),
        np.zeros(n + 1),
        [ground.numbers for ground in grounds],
        drive.period,
        targets,
        planar=True,
        heading=worm.heading,
        elastic=elastic,
        fall=float(-worm.weights()[0, 0] / worm.masses()[0]),
        root=np.array([[*place, yaw], [*speed, start.turning]]),
        begin=np.array([begin, 0 * begin]),
        notes=_oval([ground.numbers for ground in grounds]),
    )


_KINDS: dict[str, Callable[[Result, Any], Robot]] = {
    **dict.fromkeys(("gait", "gait-design", "gait-pareto", "stepper"), _spiked),
    "friction-design": _rubbing,
    **dict.fromkeys(("track", "track-optimal"), _tracked),
    "simulate": _commanded,
    "planar-crawl": _crawling,
    "planar-turn": _turning,
    "planar-design": _designed,
    "planar-motion": _swinging,
}
