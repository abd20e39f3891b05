"""Kind "planar-crawl": one stroke of a body that crawls slowly on dry ground."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import ClassVar, Literal

from wormopt.errors import Fault
from wormopt.study import Given, entry, number, on_use, parts, positive, scalar, warnings, whole
from wormopt.systems.planar.crawls import STRAIGHT, Crawling, Signals, signals_of, size_of
from wormopt.systems.planar.tables import Body, HarmonicStroke, StrokeTable, wrong_rows

with on_use():
    import numpy as np

    from wormopt.model.planar_friction import Elliptic
    from wormopt.systems.planar.crawling.crawl import Crawl, crawl

_STILL = 1e-9  # distance over the length of the body up to which a stroke leads nowhere


class PerMassGround(Given):
    """Dry ground that resists forward, backward and sideways motion differently."""

    law: Literal["elliptic", "unit"] = entry(
        "friction law; only `elliptic` is accepted, `unit` is refused", default="elliptic"
    )
    forward: float | tuple[float, ...] = positive(
        "force", "*F*<sup>+</sup>, resistance to forward motion", per="masses"
    )
    backward: float | tuple[float, ...] | None = positive(
        "force",
        "*F*<sup>−</sup>, resistance to backward motion; `forward` if left out",
        per="masses",
        default=None,
    )
    sideways: float | tuple[float, ...] | None = positive(
        "force",
        "*F*<sub>n</sub>, resistance to sideways motion; `forward` if left out",
        per="masses",
        default=None,
    )

    def numbers(self, masses: int) -> list[tuple[float, float, float]]:
        """Return the forward, backward and sideways resistance of each mass."""
        given = (self.forward, self.backward or self.forward, self.sideways or self.forward)
        rows = [one if isinstance(one, tuple) else (one,) * masses for one in given]
        return list(zip(*rows, strict=True))

    def faults_of_keys(self) -> Iterator[Fault]:
        if self.law == "unit":
            yield (
                "law",
                '"unit" has no principle of least power, so the motion of a slow body may not be '
                'unique; write "elliptic"',
            )


class Load(Given):
    """Load on the head, which turns with the first link."""

    ahead: float = number("force", "force along the first link", default=0.0)
    left: float = number("force", "force to the left of the first link", default=0.0)
    moment: float = number("energy", "moment, positive to the left", default=0.0)

    @property
    def numbers(self) -> tuple[float, float, float]:
        """Force ahead, force to the left, and moment."""
        return (self.ahead, self.left, self.moment)


class PlanarCrawl(Crawling, kind="planar-crawl"):
    """Simulate slow crawling in the plane on dry friction: displacement, turn, work.

    The body moves so slowly that its inertia does not matter: at every instant it has the velocity
    of least power. The phases at which masses stop and start follow exactly. See
    [theory](../theory-planar.md#3-slow-crawling-on-dry-ground). The status is `failed` if a second
    route finds another motion, or if forces, moments or works are not balanced.
    """

    pictures: ClassVar = {
        "crawl": "the body at equal times of its strokes, with its mean place; resting masses "
        "are filled",
        "forces": (
            "forces of the ground, loads of the actuators and resting masses over a stroke",
            "crawl_forces",
        ),
        "animation": "the moving body, as a GIF",
    }
    headline: ClassVar = ("distance", "turn", "work", "speed", "stages")

    body: Body = entry("the body")
    ground: PerMassGround = entry("the ground; a value for all masses, or one for each")
    stroke: StrokeTable = entry("periodic change of the shape variables")
    load: Load = entry("load on the head", default=Load)
    period: float = positive(
        "time", "duration of a stroke; distance and work do not depend on it", default=1.0
    )
    cycles: int = whole(1, 100, "number of strokes shown", default=2)
    samples: int = whole(
        16, 4096, "initial number of phases at which changes of rest are searched", default=128
    )

    @property
    def counts(self) -> dict[str, int]:
        return {"masses": self.body.links + 1}

    def faults_of_keys(self) -> Iterator[Fault]:
        if self.body.n_s == 0:
            yield "body.links", "a single link of fixed length has no shape to change; write 3"
        else:
            yield from list(wrong_rows(self.stroke, self.body.n_s)) or self._wrong_shapes()

    def _wrong_shapes(self) -> Iterator[Fault]:
        """Yield faults where a length may vanish or a joint may turn past π."""
        lengths, reach = self.body.n_lengths, _reach(self.stroke)
        for k, (low, high) in enumerate(reach):
            bend = max(-low, high)
            if k < lengths and low <= 0:
                yield (
                    "stroke",
                    f"link {k + 1} shrinks to {low:.3g} in the stroke; write lengths that stay "
                    "above 0",
                )
            elif k >= lengths and bend >= math.pi:
                joint = k - lengths + 1
                yield "stroke", f"joint {joint} bends by {bend:.3g}; write angles within ±π"
        if all(high - low < 1e-12 * max(1, high) for low, high in reach):
            yield (
                "stroke",
                "the shape never changes; write another row than 0, or different corners",
            )

    def follow(self) -> Crawl:
        laws = [Elliptic(*row) for row in self.ground.numbers(self.body.links + 1)]
        return crawl(
            self.body.shape(),
            laws,
            self.stroke.stroke(),
            load=self.load.numbers,
            samples=self.samples,
        )

    @property
    def duration(self) -> float:
        return self.period

    @parts(Signals)
    def signals(self) -> Signals:
        tau = self.rule.tau
        pace = np.full(len(tau), 1 / self.period)
        return signals_of(self.crawl, self.rule, tau * self.period, pace, self.cycles)

    @scalar("speed", "`distance` divided by the period")
    def speed(self) -> float:
        return self.stroke_numbers.distance / self.period

    @scalar("force", "unknown if the stroke turns the body or leads nowhere")
    def work_per_distance(self) -> float | None:
        done = self.stroke_numbers
        goes = done.distance > _STILL * size_of(self.crawl)
        return done.work / done.distance if goes and abs(done.turn) < STRAIGHT else None

    @scalar(
        "force",
        "lower bound of `work_per_distance` for strokes without turn or load: the sum of the "
        "masses' least resistances",
    )
    def work_per_distance_floor(self) -> float | None:
        floor = sum(min(row) for row in self.ground.numbers(self.body.links + 1))
        return None if any(self.load.numbers) else floor

    @warnings
    def turns(self) -> Iterator[str]:
        if abs(self.stroke_numbers.turn) > STRAIGHT:
            yield (
                "the stroke turns the body: the distance is that of the head, and repeated strokes "
                "lie on a circle"
            )


def _reach(stroke: StrokeTable) -> list[tuple[float, float]]:
    """Least and largest value of each shape variable; harmonics are sampled."""
    if isinstance(stroke, HarmonicStroke):
        rows = [_harmonic(stroke, 2 * math.pi * k / 360) for k in range(360)]
    else:
        rows = stroke.corners
    return [(min(column), max(column)) for column in zip(*rows, strict=True)]


def _harmonic(stroke: HarmonicStroke, angle: float) -> list[float]:
    found = list(stroke.mean)
    for h, (c, s) in enumerate(zip(stroke.cosine, stroke.sine, strict=True), start=1):
        for k in range(len(found)):
            found[k] += c[k] * math.cos(h * angle) + s[k] * math.sin(h * angle)
    return found
