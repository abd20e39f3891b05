"""Runs of kind ``planar-turn``: a worm of two links turns in place."""

from __future__ import annotations

import time
from collections.abc import Iterator
from typing import Any

import numpy as np

from wormopt.errors import SolveError
from wormopt.model.planar_friction import Elliptic
from wormopt.progress import Report
from wormopt.result import Check, Result
from wormopt.study.conclude import conclude
from wormopt.study.scene import Scene
from wormopt.systems.planar.body.se2 import rotate
from wormopt.systems.planar.body.shape import chain_shape
from wormopt.systems.planar.crawling.crawl import Crawl, crawl
from wormopt.systems.planar.crawling.record import Quadrature, quadrature
from wormopt.systems.planar.runs.crawling import (
    checks_of,
    instants,
    recheck,
    variables_of,
    way_scalars,
)
from wormopt.systems.planar.scenes.turn import PlanarTurnScene
from wormopt.systems.planar.turning import TurnInPlace, heading_rate_bound
from wormopt.systems.shared.optimum import refused

_PROMISED, _WITHIN = 1e-8, 1e-9
_ANGLES = 201


@np.errstate(all="ignore")  # values that are not finite are checked where it matters
def run(scene: Scene[PlanarTurnScene], report: Report) -> Result:
    """Follow the gait; status "failed" if it differs from that of the conditions of rest.

    Raises SolveError if the motion is not unique.
    """
    table, begin = scene.table, time.perf_counter()
    gait = table.gait()
    report("crawl", 0.0)
    laws = [Elliptic(f, f, f) for f in (gait.end_friction, gait.middle_friction, gait.end_friction)]
    try:
        found = crawl(chain_shape(2), laws, gait.stroke)
    except SolveError as error:
        raise refused(scene, error) from None
    crawled = time.perf_counter()
    report("recheck", 0.7)
    rule = quadrature(found, instants(found))
    errors, violation = recheck(found, rule)
    scalars = _scalars(table, gait, found)
    return conclude(
        scene,
        scalars | _way(table, found) | errors,
        _variables(table, gait, found, rule),
        checks=[*_promised(gait, scalars), *checks_of(errors)],
        facts={
            "second_way": "the dual problem by an interior point; quadrature at even phases",
            "dual_violation": violation,
        },
        warnings=_warnings(gait),
        timings={"crawl": crawled - begin, "recheck": time.perf_counter() - crawled},
    )


def _cycle(table: PlanarTurnScene) -> float:
    return 2 * (table.swing_time + table.swap_time)


def _way(table: PlanarTurnScene, found: Crawl) -> dict[str, Any]:
    told = way_scalars(found, _cycle(table), None)
    return {name: told[name] for name in table.scalars if name in told}


def _scalars(table: PlanarTurnScene, gait: TurnInPlace, found: Crawl) -> dict[str, Any]:
    turn, middle = found.displacement[2], np.array([-gait.long, 0.0])
    drift = float(np.hypot(*(found.displacement[:2] + rotate(turn, middle) - middle)))
    rate, bound = abs(float(turn)) / _cycle(table), heading_rate_bound(table.pace.joint)
    off = abs(turn - gait.turn), abs(found.work / gait.work - 1), drift / gait.long
    return {
        "heading_rate": rate,
        "heading_rate_bound": bound,
        "gap": 1 - rate / bound if gait.holds else None,
        "cycle_time": _cycle(table),
        "swap_time": table.swap_time,
        "swing_hold": float(gait.swing_hold(_angles(gait)).max()),
        "swap_hold": float(gait.swap_hold(np.array([gait.straight, gait.bent])).max()),
        "drift": drift,
        "turn_promised": gait.turn if gait.holds else None,
        "work_promised": gait.work if gait.holds else None,
        "promise_error": float(max(off)) if gait.holds else None,
    }


def _angles(gait: TurnInPlace) -> np.ndarray:
    return np.linspace(gait.straight, gait.bent, _ANGLES)


def _promised(gait: TurnInPlace, scalars: dict[str, Any]) -> Iterator[Check]:
    if gait.holds:
        yield Check("turn, work and place promised", scalars["promise_error"], _PROMISED,
                    "turn, work or drift differ from the conditions of rest")  # fmt: skip
        excess = max(0.0, scalars["heading_rate"] / scalars["heading_rate_bound"] - 1)
        yield Check("heading below its bound", excess, _WITHIN, "the rate exceeds its bound")


def _variables(
    table: PlanarTurnScene, gait: TurnInPlace, found: Crawl, rule: Quadrature
) -> dict[str, Any]:
    swing, swap = table.swing_time, table.swap_time
    ends = np.cumsum([0.0, swing, swap, swing, swap])
    tau, corners = rule.tau, found.course.stroke.breaks
    side = np.clip(np.searchsorted(corners, tau, side="right") - 1, 0, 3)
    pace = 1 / (4 * np.diff(ends)[side])
    told = variables_of(found, rule, np.interp(tau, corners, ends), pace, table.cycles)
    angle = told["shape"][2]
    angles = np.concatenate([*[angle[:-1]] * table.cycles, angle[-1:]])
    holds = gait.swing_hold(_angles(gait))
    return told | {
        "mean_heading": told["heading"] - angles / 2,
        "swing_angle": _angles(gait),
        "hold_by_angle": holds,
    }


def _warnings(gait: TurnInPlace) -> Iterator[str]:
    if not gait.holds:
        yield (
            "the ground cannot hold the resting masses during the whole gait: they slip, and the "
            "turn and its bound are not known in advance; with worm.middle_friction of "
            f"{2 * gait.end_friction:g} they rest at any angle"
        )
