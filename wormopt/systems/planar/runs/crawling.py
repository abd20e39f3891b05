"""Scalars, arrays and checks shared by scenes of slow crawling."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np

from wormopt.result import Check
from wormopt.systems.planar.body.se2 import circle_of, rotate
from wormopt.systems.planar.crawling.crawl import Crawl
from wormopt.systems.planar.crawling.recheck import (
    cross,
    even_displacement,
    most_resistance,
    repeated,
)
from wormopt.systems.planar.crawling.record import Quadrature, Record, record

_INSTANTS, _BESIDE = 240, 1e-5
_SAMPLED, _EVEN = 24, 4096
_STRAIGHT, _STILL = 1e-9, 1e-9
_BALANCED, _WORKS, _DUAL, _DUAL_TWIST = 1e-7, 1e-7, 1e-7, 1e-5
_EVEN_ERROR, _GAUSS_ERROR = 2e-5, 1e-5


def way_scalars(crawl: Crawl, period: float, floor: float | None) -> dict[str, Any]:
    """Return displacement and cost of a stroke; `floor` is known only without a load."""
    way, turn = float(np.hypot(*crawl.displacement[:2])), float(crawl.displacement[2])
    straight = abs(turn) < _STRAIGHT
    circle = None if straight else circle_of(crawl.displacement)
    goes = straight and way > _STILL * size_of(crawl)
    return {
        "distance": way,
        "displacement": crawl.displacement[:2].tolist(),
        "turn": turn,
        "circle_centre": list(circle.centre) if circle else None,
        "circle_radius": circle.radius if circle else None,
        "speed": way / period,
        "work": crawl.work,
        "mean_power": crawl.work / period,
        "work_per_distance": crawl.work / way if goes else None,
        "work_per_distance_floor": floor,
        "stages": len(crawl.phases),
    }


def size_of(crawl: Crawl) -> float:
    """Return the length of the body, the scale of displacements."""
    shapes, _ = crawl.course.stroke.at(np.zeros(1))
    points = np.array(crawl.course.crawler.shape.kinematics(shapes[0])[0])
    return float(np.hypot(*np.diff(points, axis=1)).sum())


def recheck(crawl: Crawl, rule: Quadrature) -> tuple[dict[str, float], str]:
    """Recompute the crawl by second routes; return errors and the excess of the dual's limits."""
    crawler = crawl.course.crawler
    fine = record(crawl, rule.nodes)
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
    errors = {
        "actuator_work": actuators,
        "balance_error": max(_unbalanced(fine, crawler.load), _unbalanced(seen, crawler.load)),
        "work_error": abs(actuators + pulled - crawl.work) / size,
        "dual_error": float((np.abs(dual.power - worth) / usual).max()),
        "dual_twist_error": float((off.max(axis=1) / np.maximum(speeds, 1e-6 * length)).max()),
        "even_error": float((apart[0] / [length, length, 1.0]).max()),
        "gauss_error": float((apart[1] / [length, length, 1.0]).max()),
    }
    return errors, f"{dual.violation.max():.1e}"


def _unbalanced(seen: Record, load: np.ndarray) -> float:
    """Return the largest residual force or moment, relative to the largest."""
    forces, points = seen.forces, seen.points
    force = np.abs(forces.sum(axis=1) + load[:2]).max(axis=1)
    size = np.linalg.norm(forces, axis=2).sum(axis=1)
    moment = np.abs(cross(points, forces).sum(axis=1) + load[2])
    length = np.linalg.norm(points, axis=2).max(axis=1)
    return float(max((force / size).max(), (moment / (size * length)).max()))


def checks_of(errors: dict[str, float]) -> Iterator[Check]:
    """Yield the checks of a crawl."""
    looked = "a stop may have been missed; write more samples"
    yield Check("balance of forces and moments", errors["balance_error"], _BALANCED,
                "forces of the ground and the load do not balance")  # fmt: skip
    yield Check("work of the actuators", errors["work_error"], _WORKS,
                f"work of actuators and ground differ; {looked}")  # fmt: skip
    yield Check("power by forces of most resistance", errors["dual_error"], _DUAL,
                "the dual problem gives another power")  # fmt: skip
    yield Check("velocity by forces of most resistance", errors["dual_twist_error"], _DUAL_TWIST,
                "the dual problem gives another velocity")  # fmt: skip
    yield Check("displacement by even phases", errors["even_error"], _EVEN_ERROR,
                f"even phases give another displacement; {looked}")  # fmt: skip
    yield Check("displacement by Gauss' rule on fixed phases", errors["gauss_error"], _GAUSS_ERROR,
                f"another quadrature gives another displacement; {looked}")  # fmt: skip


def instants(crawl: Crawl) -> np.ndarray:
    """Return even phases of a stroke, and phases just before and after masses stop and start."""
    inner = crawl.breaks[1:-1]
    return np.unique(np.concatenate([np.linspace(0, 1, _INSTANTS + 1), inner - _BESIDE,
                                     inner + _BESIDE]))  # fmt: skip


def variables_of(
    crawl: Crawl, rule: Quadrature, times: np.ndarray, pace: np.ndarray, cycles: int
) -> dict[str, Any]:
    """Return arrays over `cycles` strokes, by phases, and by times (m,) of these phases.

    `pace` (m,) is the rate of the phase in time.
    """
    told = record(crawl, rule.tau)
    motion, laps = told.motion, np.arange(cycles)
    poses = repeated(crawl.displacement, rule.poses, cycles)
    shapes = np.concatenate([*[told.points[:-1]] * cycles, told.points[-1:]])
    placed = poses[:, None, :2] + rotate(poses[:, None, 2], shapes)
    rests = motion.rest.astype(float)
    time = np.append((laps[:, None] * times[-1] + times[:-1]).ravel(), cycles * times[-1])
    velocities = motion.velocities * pace[:, None, None]
    links = told.shapes.shape[1] - (crawl.course.crawler.shape.n_points - 2)
    loads = {"link_force": told.actuators.T[:links], "joint_torque": told.actuators.T[links:]}
    return {
        "time": time,
        "x": placed[..., 0].T,
        "y": placed[..., 1].T,
        "center_x": placed[..., 0].mean(axis=1),
        "center_y": placed[..., 1].mean(axis=1),
        "heading": poses[:, 2],
        "resting": np.concatenate([*[rests[:-1]] * cycles, rests[-1:]]).T,
        "phase": told.tau,
        "shape": told.shapes.T,
        "head_velocity": velocities[:, 0].T,
        "tail_velocity": velocities[:, -1].T,
        "ground_ahead": motion.forces[..., 0].T,
        "ground_left": motion.forces[..., 1].T,
        "stroke_resting": rests.T,
        **{name: rows for name, rows in loads.items() if len(rows)},
        "power": motion.power * pace,
        "stage_start": crawl.breaks[:-1],
        "stage_resting": np.array([phase.rest for phase in crawl.phases], dtype=float),
    }
