# pyright: strict, reportUnknownArgumentType=false
"""The table ``[sweep]`` that any scene may have: which of its keys are varied, and how."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator
from typing import Annotated, Any, ClassVar, Literal

from msgspec import Meta

from wormopt.errors import Fault
from wormopt.study.given import Given, entry
from wormopt.study.types import Seed

_NUMBER = r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?"
RANGE = re.compile(
    rf"\s*(?P<low>{_NUMBER}):(?P<high>{_NUMBER})(?::(?P<count>\d+))?(?::(?P<spacing>log))?"
    r"\s*(?P<unit>[^\d:].*)?"
)
"""first:last:count, first:last:count:log, or first:last where values are drawn; then a unit."""
Method = Literal["grid", "zip", "latin-hypercube", "sobol"]
_MOST = 1_000_000
Points = Annotated[int, Meta(ge=1, le=_MOST, description=f"a whole number from 1 to {_MOST}")]


class Swept(Given):
    """Keys that are varied when the scene is swept; `wormopt run` leaves them as they are."""

    drawn_by: ClassVar = {"sweep": "wormopt.families.pictures:sweep"}
    exports: ClassVar = {"points.csv": "wormopt.families.gathered:as_csv"}

    over: dict[str, Any] = entry(
        'dotted key = values: a list, `"1:10:10"` (ten from 1 to 10), `"1:100:5:log"`, or '
        '`"1:10"` where values are drawn; a unit may follow'
    )
    method: Method = entry(
        "`grid`: every combination; `zip`: first with first, second with second, ...; "
        "`latin-hypercube`, `sobol`: drawn within the ranges",
        default="grid",
    )
    points: Points | None = entry("number of random samples", default=None)
    seed: Seed = entry("seed of the random samples", default=0)

    @property
    def drawn(self) -> bool:
        """Whether values are drawn from ranges."""
        return self.method in ("latin-hypercube", "sobol")

    def faults(self) -> Iterator[Fault]:
        """Yield faults between the keys."""
        if not self.over:
            yield "over", 'no key is varied; write for example over."worm.load" = "1:10:10"'
        for key, values in self.over.items():
            if key.partition(".")[0] in ("kind", "schema", "units", "sweep"):
                yield f"over.{key}", "cannot be varied; write one scene for each value"
            what = self._fault_of(values)
            if what:
                yield f"over.{key}", what
        counts = {key: _count(values) for key, values in self.over.items()}
        if self.method == "zip" and len(set(counts.values())) > 1:
            listed = ", ".join(f"{count} of {key}" for key, count in counts.items())
            yield "over", f"zip needs equal numbers of values of all keys, not {listed}"
        if self.method == "grid" and max(counts.values(), default=0) <= _MOST < math.prod(
            counts.values()
        ):
            yield "over", f"{math.prod(counts.values())} points are too many; write at most {_MOST}"
        if self.drawn and self.points is None:
            yield "points", f"missing; write how many points {self.method} draws"
        if not self.drawn and self.points is not None:
            yield "points", f'is for method = "latin-hypercube" or "sobol", not "{self.method}"'

    def _fault_of(self, values: Any) -> str:
        if not isinstance(values, str | list):
            return f'{values!r} is not a list or range; write for example [1, 2, 5] or "1:10:10"'
        if isinstance(values, list):
            if self.drawn:
                return f'{self.method} draws from a range; write "first:last"'
            return "" if values else "is an empty list; write the values"
        found = RANGE.fullmatch(values)
        if not found:
            return f'{values!r} is not a range; write "first:last:count", or a list of values'
        low, high, count = float(found["low"]), float(found["high"]), found["count"]
        if not (math.isfinite(low) and math.isfinite(high)):
            return "the ends of the range must be finite"
        if self.drawn:
            if count and not found["spacing"]:
                return f'{self.method} draws the points itself; write "{low:g}:{high:g}"'
            return "" if low < high else "the range is empty; write the smaller number first"
        if not count:
            return f'the number of values is missing; write for example "{low:g}:{high:g}:10"'
        if not 1 <= int(count) <= _MOST:
            return f"{count} values are not allowed; write 1 to {_MOST}"
        if found["spacing"] and min(low, high) <= 0:
            return "a logarithmic range must begin and end above 0"
        return ""


def _count(values: Any) -> int:
    if isinstance(values, list):
        return len(values)
    found = RANGE.fullmatch(values) if isinstance(values, str) else None
    return int(found["count"] or 1) if found else 1
