"""Runs of kind ``planar-crawl``: one stroke of a body that crawls slowly on dry ground."""

from __future__ import annotations

import time
from collections.abc import Iterator

import numpy as np

from wormopt.errors import SolveError
from wormopt.progress import Report
from wormopt.result import Result
from wormopt.study.conclude import conclude
from wormopt.study.scene import Scene
from wormopt.systems.planar.crawling.crawl import Crawl, crawl
from wormopt.systems.planar.crawling.record import quadrature
from wormopt.systems.planar.runs.crawling import (
    checks_of,
    instants,
    recheck,
    variables_of,
    way_scalars,
)
from wormopt.systems.planar.scenes.crawl import PlanarCrawlScene
from wormopt.systems.shared.optimum import refused

_STRAIGHT = 1e-9


@np.errstate(all="ignore")  # values that are not finite are checked where it matters
def run(scene: Scene[PlanarCrawlScene], report: Report) -> Result:
    """Follow the stroke; status "failed" if a second route finds another motion.

    Raises SolveError if the ground cannot hold the load or the motion is not unique.
    """
    table, begin = scene.table, time.perf_counter()
    masses = table.body.links + 1
    report("crawl", 0.0)
    try:
        found = crawl(
            table.body.shape(), table.ground.laws(masses), table.stroke.stroke(),
            load=table.load.numbers, samples=table.samples,
        )  # fmt: skip
    except SolveError as error:
        raise refused(scene, error) from None
    crawled = time.perf_counter()
    report("recheck", 0.7)
    tau = instants(found)
    rule = quadrature(found, tau)
    errors, violation = recheck(found, rule)
    floor = sum(min(row) for row in table.ground.numbers(masses))
    loaded = any(table.load.numbers)
    return conclude(
        scene,
        way_scalars(found, table.period, None if loaded else floor) | errors,
        variables_of(
            found, rule, tau * table.period, np.full(len(tau), 1 / table.period), table.cycles
        ),
        checks=checks_of(errors),
        facts={
            "second_way": "the dual problem by an interior point; quadrature at even phases",
            "dual_violation": violation,
        },
        warnings=_warnings(found),
        timings={"crawl": crawled - begin, "recheck": time.perf_counter() - crawled},
    )


def _warnings(found: Crawl) -> Iterator[str]:
    if abs(found.displacement[2]) > _STRAIGHT:
        yield (
            "the stroke turns the body: the distance is that of the head, and repeated strokes "
            "lie on a circle"
        )
