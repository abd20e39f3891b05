"""Whether a film goes the same way on twice as many points."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from wormopt.progress import Report, silent
from wormopt.systems.film.runs.film_courses import Course, Setting, follow

# A film whose highest harmonics are below this share is resolved by itself.
_ENOUGH = 1e-6


@dataclass(frozen=True, eq=False)
class Resolved:
    """A course and the one on half as many points with which it was compared."""

    course: Course  # on the most points
    coarser: Course | None  # on half as many points
    # of last thicknesses at common points; None if outcomes or end times differ
    difference: float | None

    def agrees(self, agreement: float) -> bool:
        """Whether both courses end alike, to within `agreement`."""
        return self.difference is not None and self.difference <= agreement


def resolved(setting: Setting, report: Report = silent, *, once: bool = False) -> Resolved:
    """Follow a film on more and more points until two resolutions agree; callers check that.

    `once`: be content with one resolution where its harmonics have died out.
    """
    points = setting.grid.points
    found = Resolved(follow(setting, points, report), None, None)
    while 2 * points <= setting.grid.most:
        if once and found.course.outcome != "unresolved" and found.course.tail < _ENOUGH:
            break
        points *= 2
        finer = follow(setting, points, report)
        found = Resolved(finer, found.course, _difference(found.course, finer))
        if found.agrees(setting.grid.agreement):
            break
    return found


def _difference(coarse: Course, fine: Course) -> float | None:
    if coarse.outcome != fine.outcome or fine.outcome == "unresolved":
        return None
    if fine.broke is not None and coarse.broke is not None:
        last = fine.broke[0]  # the shapes are those of other times
        return abs(coarse.broke[0] - last) / max(last, 2 * math.pi)
    return float(np.abs(coarse.thickness[:, -1] - fine.thickness[::2, -1]).max())
