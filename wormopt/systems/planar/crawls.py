"""Results of slow crawls, shared by the kinds "planar-crawl" and "planar-turn"."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

from wormopt.study import Study, check, facts, on_use, parts, signal, stage, value

with on_use():
    import numpy as np

    from wormopt.systems.planar.crawling.crawl import Crawl
    from wormopt.systems.planar.crawling.recheck import (
        Quadrature,
        Record,
        cross,
        even_displacement,
        most_resistance,
        quadrature,
        record,
        repeated,
    )
    from wormopt.systems.planar.poses import circle_of, rotate

STRAIGHT = 1e-9
"""Turn up to which a stroke counts as straight."""
_INSTANTS, _BESIDE = 240, 1e-5
_SAMPLED, _EVEN = 24, 4096
_LOOK = "a stop may have been missed; write more samples"


@dataclass(frozen=True)
class Stroke:
    """Displacement and work of a stroke."""

    distance: float = value(
        "length", "distance of the head per stroke; frame-independent if `turn` is 0"
    )
    displacement: list[float] = value("length", "[forward, to the left], in the frame at the start")
    turn: float = value("angle", "rotation of the body to the left per stroke")
    circle_centre: list[float] | None = value(
        "length", "centre of the circle of repeated strokes, [x, y]; unknown without a turn"
    )
    circle_radius: float | None = value(
        "length", "radius of that circle for the head; unknown without a turn"
    )
    work: float = value("energy", "work dissipated by friction per stroke")
    mean_power: float = value("power", "`work` divided by the period")
    stages: int = value(
        "count", "stages per stroke; a mass stops, starts or reverses between two stages"
    )


@dataclass(frozen=True)
class Errors:
    """Differences to second routes: forces as unknowns instead of velocities, and even phases."""

    violation: float  # of balance and limits in the dual problem, relative
    actuator_work: float = value("energy", "work of the actuators per stroke, from their loads")
    balance_error: float = value("share", "residual of forces and moments, relative to the largest")
    work_error: float = value(
        "share", "`actuator_work` plus the load's work less `work`, relative to `work`"
    )
    dual_error: float = value("share", "difference in power to the dual problem, at sampled phases")
    dual_twist_error: float = value(
        "share", "difference in body velocity to the dual problem, relative to the fastest mass"
    )
    even_error: float = value(
        "share",
        "difference in displacement to a quadrature at even phases, relative to the body length",
    )
    gauss_error: float = value(
        "share",
        "difference in displacement to Gauss' rule between fixed phases and breaks, relative to "
        "the body length",
    )


@dataclass(frozen=True)
class Signals:
    """The body over several strokes, and forces over one."""

    time: np.ndarray = signal("time", "time", "time since the start")
    x: np.ndarray = signal(
        "length", "mass time", "*x* of each mass; the head starts with its heading along x"
    )
    y: np.ndarray = signal("length", "mass time", "*y* of each mass")
    center_x: np.ndarray = signal("length", "time", "mean *x* of the masses")
    center_y: np.ndarray = signal("length", "time", "mean *y* of the masses")
    heading: np.ndarray = signal("angle", "time", "angle of the first link")
    resting: np.ndarray = signal("1", "mass time", "1 while the mass rests, else 0")
    phase: np.ndarray = signal("1", "stroke_time", "phase of the stroke, from 0 to 1")
    shape: np.ndarray = signal(
        "1", "shape_variable stroke_time", "shape variables: lengths, then angles"
    )
    head_velocity: np.ndarray = signal(
        "speed", "axis stroke_time", "velocity of the head, along link 0 and to its left"
    )
    tail_velocity: np.ndarray = signal(
        "speed", "axis stroke_time", "velocity of the tail, along its link, left"
    )
    ground_ahead: np.ndarray = signal(
        "force", "mass stroke_time", "ground force along the mass's heading"
    )
    ground_left: np.ndarray = signal(
        "force", "mass stroke_time", "ground force to the left of the heading"
    )
    stroke_resting: np.ndarray = signal("1", "mass stroke_time", "1 while the mass rests, else 0")
    link_force: np.ndarray | None = signal(
        "force", "link stroke_time", "force of the link's actuator; positive pushes"
    )
    joint_torque: np.ndarray | None = signal(
        "energy",
        "joint stroke_time",
        "torque of the joint's actuator; positive turns the front to the left",
    )
    power: np.ndarray = signal("power", "stroke_time", "power dissipated by friction")
    stage_start: np.ndarray = signal(
        "1", "stage", "phases at which the set of resting masses changes"
    )
    stage_resting: np.ndarray = signal("1", "stage mass", "1 for the masses that rest in the stage")


class Crawling(Study):
    """Base of kinds that follow a slow crawl and check it by second routes."""

    def follow(self) -> Crawl:
        """Return the crawl over a stroke. Subclasses do this."""
        raise NotImplementedError

    @property
    def duration(self) -> float:
        """Duration of a stroke. Subclasses know it."""
        raise NotImplementedError

    @stage
    def crawl(self) -> Crawl:
        with np.errstate(all="ignore"):  # values that are not finite are checked where it matters
            return self.follow()

    @cached_property
    def rule(self) -> Quadrature:
        """Quadrature at even phases, and just before and after masses stop and start."""
        inner = self.crawl.breaks[1:-1]
        even = np.linspace(0, 1, _INSTANTS + 1)
        instants = np.unique(np.concatenate([even, inner - _BESIDE, inner + _BESIDE]))
        return quadrature(self.crawl, instants)

    @stage
    def recheck(self) -> Errors:
        with np.errstate(all="ignore"):
            return errors_of(self.crawl, self.rule)

    @parts(Stroke)
    def stroke_numbers(self) -> Stroke:
        return stroke_of(self.crawl, self.duration)

    @parts(Errors)
    def errors(self) -> Errors:
        return self.recheck

    @check(1e-7, "forces of the ground and the load do not balance")
    def balance_of_forces_and_moments(self) -> float:
        return self.errors.balance_error

    @check(1e-7, f"work of actuators and ground differ; {_LOOK}")
    def work_of_the_actuators(self) -> float:
        return self.errors.work_error

    @check(1e-7, "the dual problem gives another power")
    def power_by_forces_of_most_resistance(self) -> float:
        return self.errors.dual_error

    @check(1e-5, "the dual problem gives another velocity")
    def velocity_by_forces_of_most_resistance(self) -> float:
        return self.errors.dual_twist_error

    @check(2e-5, f"even phases give another displacement; {_LOOK}")
    def displacement_by_even_phases(self) -> float:
        return self.errors.even_error

    @check(
        1e-5,
        f"another quadrature gives another displacement; {_LOOK}",
        name="displacement by Gauss' rule on fixed phases",
    )
    def displacement_by_fixed_phases(self) -> float:
        return self.errors.gauss_error

    @facts
    def second_route(self) -> Mapping[str, Any]:
        return {
            "second_route": "the dual problem by an interior point; quadrature at even phases",
            "dual_violation": f"{self.errors.violation:.1e}",
        }


def stroke_of(crawl: Crawl, period: float) -> Stroke:
    """Return displacement and work of a stroke."""
    turn = float(crawl.displacement[2])
    circle = None if abs(turn) < STRAIGHT else circle_of(crawl.displacement)
    return Stroke(
        distance=float(np.hypot(*crawl.displacement[:2])),
        displacement=crawl.displacement[:2].tolist(),
        turn=turn,
        circle_centre=list(circle.centre) if circle else None,
        circle_radius=circle.radius if circle else None,
        work=crawl.work,
        mean_power=crawl.work / period,
        stages=len(crawl.phases),
    )


def size_of(crawl: Crawl) -> float:
    """Return the length of the body, the scale of displacements."""
    shapes, _ = crawl.course.stroke.at(np.zeros(1))
    points = np.array(crawl.course.crawler.shape.kinematics(shapes[0])[0])
    return float(np.hypot(*np.diff(points, axis=1)).sum())


def errors_of(crawl: Crawl, rule: Quadrature) -> Errors:
    """Compute the crawl again by second routes."""
    crawler = crawl.course.crawler
    fine = record(crawl, rule.nodes, rule.motion)
    actuators = float(rule.weights @ (fine.actuators * fine.rates).sum(axis=1))
    pulled = float(rule.weights @ (fine.motion.twist @ crawler.load))
    size, length = max(crawl.work, 1e-300), size_of(crawl)
    seen = record(crawl, (np.arange(_SAMPLED) + 0.4142) / _SAMPLED)
    dual = most_resistance(crawler, seen.shapes, seen.rates)
    worth = seen.motion.power - seen.motion.twist @ crawler.load  # this is minimal
    usual = np.maximum(seen.motion.power, 1e-6 * size)
    speeds = np.linalg.norm(seen.motion.velocities, axis=2).max(axis=1)
    off = np.abs(dual.twist - seen.motion.twist) * [1.0, 1.0, length]
    even = even_displacement(crawl.course, _EVEN, crawl.phases)
    apart = np.abs([even - crawl.displacement, rule.poses[-1] - crawl.displacement])
    return Errors(
        actuator_work=actuators,
        balance_error=max(_unbalanced(fine, crawler.load), _unbalanced(seen, crawler.load)),
        work_error=abs(actuators + pulled - crawl.work) / size,
        dual_error=float((np.abs(dual.power - worth) / usual).max()),
        dual_twist_error=float((off.max(axis=1) / np.maximum(speeds, 1e-6 * length)).max()),
        even_error=float((apart[0] / [length, length, 1.0]).max()),
        gauss_error=float((apart[1] / [length, length, 1.0]).max()),
        violation=float(dual.violation.max()),
    )


def _unbalanced(seen: Record, load: np.ndarray) -> float:
    """Return the largest residual force or moment, relative to the largest."""
    forces, points = seen.forces, seen.points
    force = np.abs(forces.sum(axis=1) + load[:2]).max(axis=1)
    size = np.linalg.norm(forces, axis=2).sum(axis=1)
    moment = np.abs(cross(points, forces).sum(axis=1) + load[2])
    length = np.linalg.norm(points, axis=2).max(axis=1)
    return float(max((force / size).max(), (moment / (size * length)).max()))


def signals_of(
    crawl: Crawl, rule: Quadrature, times: np.ndarray, pace: np.ndarray, cycles: int
) -> Signals:
    """Return the body over `cycles` strokes, and forces by phases, at times (m,) of these.

    `pace` (m,) is the rate of the phase in time.
    """
    seen = record(crawl, rule.tau)
    motion, rests = seen.motion, seen.motion.rest.astype(float)
    poses = repeated(crawl.displacement, rule.poses, cycles)
    placed = poses[:, None, :2] + rotate(poses[:, None, 2], over_cycles(seen.points, cycles))
    starts = np.arange(cycles)[:, None] * times[-1]
    velocities = motion.velocities * pace[:, None, None]
    links = seen.shapes.shape[1] - (crawl.course.crawler.shape.n_points - 2)
    forces, torques = seen.actuators.T[:links], seen.actuators.T[links:]
    return Signals(
        time=np.append((starts + times[:-1]).ravel(), cycles * times[-1]),
        x=placed[..., 0].T,
        y=placed[..., 1].T,
        center_x=placed[..., 0].mean(axis=1),
        center_y=placed[..., 1].mean(axis=1),
        heading=poses[:, 2],
        resting=over_cycles(rests, cycles).T,
        phase=seen.tau,
        shape=seen.shapes.T,
        head_velocity=velocities[:, 0].T,
        tail_velocity=velocities[:, -1].T,
        ground_ahead=motion.forces[..., 0].T,
        ground_left=motion.forces[..., 1].T,
        stroke_resting=rests.T,
        link_force=forces if len(forces) else None,
        joint_torque=torques if len(torques) else None,
        power=motion.power * pace,
        stage_start=crawl.breaks[:-1],
        stage_resting=np.array([phase.rest for phase in crawl.phases], dtype=float),
    )


def over_cycles(rows: np.ndarray, cycles: int) -> np.ndarray:
    """Repeat rows over a stroke; the last row begins the next stroke."""
    return np.concatenate([*[rows[:-1]] * cycles, rows[-1:]])
