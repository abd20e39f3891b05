"""Kind "peristaltic-design": the fastest gait of a worm that anchors in a tube."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import Annotated, Any, ClassVar

from msgspec import Meta

from wormopt.errors import ArgumentError, Fault, SceneError
from wormopt.study import (
    Given,
    Study,
    check,
    entry,
    facts,
    number,
    on_use,
    parts,
    positive,
    scalar,
    signal,
    stage,
    value,
    warnings,
    whole,
)
from wormopt.study.types import Pair, Positive

with on_use():
    import numpy as np

    from wormopt.systems.peristaltic.anchored import (
        AnchoredGait,
        anchored_wave,
        anchors_needed,
        slip,
    )
    from wormopt.systems.peristaltic.anchored_fastest import AnchorLimits, Fastest, fastest

# Relative difference below which sizes count as equal.
_EQUAL = 1e-9
# Accepted round-off of a gait, relative to strokes and rates; of a bound, relative to the speed.
_ROUNDING, _SOLVED = 1e-8, 1e-6
# Gap above which a warning is given.
_WIDE = 0.01
_ASSUMED = {
    "segments": "sealed cylinders: radius R sqrt(L/l), and no change of length by uniform pressure",
    "anchors": "clamped: a segment rests with both of its rings, and only while it is shortest",
    "rates": "lengths follow the coils at any rate within the limits; no inertia, no creep",
    "drag": "dry, the same for every moving segment, in both directions",
}
Rate = Annotated[
    Positive | Pair, Meta(description="a number above 0, or two, [contraction, extension]")
]


class Worm(Given):
    """The worm: sealed segments that thicken as they shorten."""

    segments: int = whole(3, 12, "number of segments *N*")
    length: float = positive("length", "rest length *L* of a segment, its longest")
    radius: float = positive("length", "rest radius *R* of a segment, its least")
    drag: float = number("force", "dry drag of each moving segment", least=0)
    load: float = number("force", "load against the advance of the worm", least=0, default=0.0)
    push: float | None = positive(
        "force", "push available from a growing segment; not checked if left out", default=None
    )

    def length_of(self, radius: float) -> float:
        """Return the length at which a segment has a radius."""
        return self.length * (self.radius / radius) ** 2


class Tube(Given):
    """The tube."""

    radius: float = positive("length", "inner radius, above that of the worm")
    friction: float = positive("1", "coefficient of dry friction on its wall")
    wall_force: float = positive("force", "total normal force of an anchored segment")


class Limits(Given):
    """Limits of the gait."""

    rate: Rate = entry("largest rate of a length; one value holds for both", quantity="speed")
    clearance: float = positive("length", "least clearance of a moving segment from the wall")
    reserve: float = number(
        "1",
        "least ratio of friction limit to force on the anchors",
        least=1,
        most=1000000.0,
        default=1.0,
    )
    anchors: int | None = whole(
        1, 10, "least number of anchored segments; the least that holds if left out", default=None
    )

    @property
    def rates(self) -> tuple[float, float]:
        """Largest rates of contraction and extension."""
        contraction, extension = self.rate if isinstance(self.rate, tuple) else (self.rate,) * 2
        return contraction, extension


class OrderSearch(Given):
    """Options of the search for the order of anchors, and of the proof."""

    phases: int = whole(
        3, 16, "largest number of phases in a cycle; the bound is for these gaits", default=6
    )
    time_limit: float = positive("s", "time after which the proof of the bound stops", default=50.0)


@dataclass(frozen=True)
class Designed:
    """The gait and its bounds."""

    speed: float = value("speed", "mean speed of the designed gait")
    advance: float = value("length", "advance per cycle")
    period: float = value("time", "duration of a cycle")
    ceiling: float = value(
        "speed", "upper bound for every gait, from rates and number of anchors alone"
    )
    bound: float = value("speed", "upper bound for gaits of at most `search.phases` phases")
    gap_certified: float = value("1", "largest relative increase in speed that is still possible")
    order: list[list[int]] = value("1", "anchored segments of each phase")
    durations: list[float] = value("time", "durations of the phases")
    n_phases: int = value("count", "number of phases with a duration above 0")
    nodes: int = value("count", "number of nodes of branch and bound")


@dataclass(frozen=True)
class BothEnds:
    """Both ends of every phase; between them all signals but the radius are linear."""

    time: np.ndarray = signal("time", "time", "time")
    length: np.ndarray = signal("length", "segment time", "length of the segment")
    radius: np.ndarray = signal("length", "segment time", "radius of the segment")
    anchored: np.ndarray = signal("1", "segment time", "1 where the segment is anchored")
    position: np.ndarray = signal("length", "ring time", "position of the ring")


@dataclass(frozen=True)
class OfWave:
    """The wave for comparison."""

    wave_speed: float = value(
        "speed", "speed of the fastest wave with advance (*N* − *m*) *D* per cycle that also holds"
    )
    wave_short: int = value("count", "number of short segments *m* in the wave")
    wave_time: np.ndarray = signal("time", "wave_time", "time")
    wave_position: np.ndarray = signal("length", "wave_time", "position of the head in the wave")


class PeristalticDesign(Study, kind="peristaltic-design"):
    """Design the fastest gait of a worm that anchors in a tube, with a bound.

    A segment is sealed: at length *l* its radius is *R*√(*L*/*l*). At *L*(*R*/*R*_t)² it touches
    the wall. It is anchored, and rests, while it has this length. A segment that is anchored
    neither before nor after the end of a phase has the clearance there. Each flight from rest to
    rest therefore has a phase in which the segment lifts and one in which it lands. The number *k*
    of anchored segments satisfies *k μ N*_w ≥ reserve × (load + drag × (*N* − *k*)) at any time.
    See [theory-peristaltic.md](../theory-peristaltic.md#3-anchored-gaits).

    A worm as thick as its tube is refused, as is a clearance without room. A wall force that needs
    more than *N* − 2 anchors is refused; the message gives the least force that suffices.

    The trust report has `checks` of the gait's lengths against the displacements of the rings,
    anchored segments that move or are long, clearance of flights, and rates. Further checks cover
    slips in the quasi-static motion of least dissipation, and speed against the ceiling and the
    waves. `facts` state the scope of the certificate and the assumptions. Warnings report a gap
    above 1 % and a push of the foremost growing segment above `worm.push`.
    """

    pictures: ClassVar = {
        "peristalsis": "the body in its tube over a cycle, and its advance with the ceiling",
        "animation": ("the moving body", "animation_of_anchors"),
    }
    headline: ClassVar = ("speed", "advance", "period", "ceiling", "bound")

    worm: Worm = entry("the worm")
    pipe: Tube = entry("the tube")
    limits: Limits = entry("limits of the gait")
    search: OrderSearch = entry("options of the search", default=OrderSearch)

    def faults_of_keys(self) -> Iterator[Fault]:
        worm, room = self.worm, self.pipe.radius - self.worm.radius
        if room <= 0:
            yield (
                "pipe.radius",
                f"{self.pipe.radius:g} leaves no room for a worm of radius {worm.radius:g}; "
                "write more than that",
            )
        elif self.limits.clearance > room * (1 + _EQUAL):
            yield (
                "limits.clearance",
                f"{self.limits.clearance:g} exceeds the room {room:g} between worm and tube; "
                "write at most that",
            )
        most = worm.segments - 2
        if (self.limits.anchors or 0) > most:
            yield (
                "limits.anchors",
                f"{self.limits.anchors} of {worm.segments} segments leave none to move; write at "
                f"most {most}, or more segments",
            )

    # -- sizes -------------------------------------------------------------------------------------

    @scalar("force", "friction limit of an anchored segment, *μ N*_w")
    def hold(self) -> float:
        return self.pipe.friction * self.pipe.wall_force

    @scalar("count", "least number *k* of anchored segments at any time")
    def anchors(self) -> int:
        worm, given, reserve = self.worm, self.limits.anchors, self.limits.reserve
        try:
            needed = anchors_needed(worm.segments, self.hold, worm.drag, worm.load, reserve)
        except ArgumentError as error:
            least = reserve * (worm.load + 2 * worm.drag) / (worm.segments - 2) / self.pipe.friction
            message = f"{error}; write at least {least * (1 + 1e-5):.6g}"  # never rounded down
            raise SceneError(self.name, [("pipe.wall_force", message)]) from None
        if given and given < needed:
            message = f"{given} do not hold; write at least {needed}, or leave it out"
            raise SceneError(self.name, [("limits.anchors", message)])
        return given or needed

    @scalar("length", "length of a segment at the wall")
    def shortest(self) -> float:
        return self.worm.length_of(self.pipe.radius)

    @scalar("length", "longest less shortest length, *D*")
    def stroke(self) -> float:
        return self.worm.length - self.shortest

    @scalar("length", "length of a segment with the clearance less the shortest length")
    def lift(self) -> float:
        clear = self.worm.length_of(self.pipe.radius - self.limits.clearance)
        return min(clear - self.shortest, self.stroke)

    @scalar("speed", "largest rates of contraction and extension")
    def rate_limit(self) -> list[float]:
        return [*self.limits.rates]

    @scalar("length", "`worm.radius`")
    def worm_radius(self) -> float:
        return self.worm.radius

    @scalar("length", "`pipe.radius`")
    def tube_radius(self) -> float:
        return self.pipe.radius

    # -- the gait ----------------------------------------------------------------------------------

    @stage
    def design(self) -> Fastest:
        rates = self.limits.rates
        limits = AnchorLimits(self.worm.segments, self.anchors, self.stroke, self.lift, rates)
        return fastest(limits, self.search.phases, self.search.time_limit, self.report)

    @property
    def gait(self) -> AnchoredGait:
        """The designed gait."""
        return self.design.gait

    @parts(Designed)
    def designed(self) -> Designed:
        found, gait = self.design, self.gait
        return Designed(
            speed=gait.speed,
            advance=gait.advance,
            period=gait.period,
            ceiling=found.ceiling,
            bound=found.bound,
            gap_certified=found.gap,
            order=[list(rest) for rest in gait.order],
            durations=gait.durations.tolist(),
            n_phases=int(gait.lasting.sum()),
            nodes=found.nodes,
        )

    @parts(BothEnds)
    def both_ends(self) -> BothEnds:
        gait = self.gait
        begin, kept = np.concatenate([[0.0], np.cumsum(gait.durations)]), gait.lasting
        length = self.shortest + gait.lengths
        behind = np.concatenate([[0.0], np.cumsum(length[0])])
        rings = np.vstack([[-behind], -behind + np.cumsum(gait.displacements, axis=0)])

        def ends(values: np.ndarray) -> np.ndarray:
            pairs = np.stack([values[:-1][kept], values[1:][kept]], axis=1)
            return pairs.reshape(-1, *values.shape[1:])

        lengths = ends(np.vstack([length, length[:1]])).T
        return BothEnds(
            time=ends(begin),
            length=lengths,
            radius=self.worm.radius * np.sqrt(self.worm.length / lengths),
            anchored=np.repeat(gait.anchored[kept], 2, axis=0).T.astype(float),
            position=ends(rings).T,
        )

    @scalar("1", "holding reserve of each phase; unknown for phases of no duration")
    def reserves(self) -> list[float | None]:
        found = self.gait.reserves(self.hold, self.worm.drag, self.worm.load)
        return [float(r) if np.isfinite(r) else None for r in found]

    @scalar("1", "least holding reserve of all phases")
    def reserve_min(self) -> float | None:
        return min((r for r in self.reserves if r is not None), default=None)

    @scalar("force", "largest drag that the foremost growing segment pushes")
    def push_max(self) -> float:
        return float(self.gait.pushes(self.worm.drag).max())

    @cached_property
    def lifted(self) -> float:
        """Least length of a flight above the shortest."""
        return float(self.gait.clearances().min())

    @scalar("length", "least over all flights of the largest distance from the wall")
    def clearance_min(self) -> float:
        thickest = self.worm.radius * np.sqrt(self.worm.length / (self.shortest + self.lifted))
        return float(self.pipe.radius - thickest)

    # -- the wave ----------------------------------------------------------------------------------

    @parts(OfWave)
    def wave(self) -> OfWave:
        short, step = self.anchors + 1, self.stroke / min(self.limits.rates)
        wave = anchored_wave(self.worm.segments, short, self.stroke, step)
        return OfWave(
            wave_speed=wave.speed,
            wave_short=short,
            wave_time=np.concatenate([[0.0], np.cumsum(wave.durations)]),
            wave_position=np.concatenate([[0.0], np.cumsum(wave.displacements[:, 0])]),
        )

    @scalar("1", "speed divided by that of the wave")
    def gain(self) -> float:
        return self.gait.speed / self.wave.wave_speed

    # -- checks, from the gait's lengths and displacements alone -----------------------------------

    @check(_ROUNDING, "lengths and ring positions disagree")
    def lengths_against_ways(self) -> float:
        return float(self.gait.faults()[0] / self.stroke)

    @check(_ROUNDING, "an anchored segment moves, or is not short", name="anchors")
    def anchors_that_move(self) -> float:
        return float(self.gait.faults()[1] / self.stroke)

    @check(_ROUNDING, "a flight is nearer to the wall than allowed")
    def clearance(self) -> float:
        return max(0.0, 1 - self.lifted / self.lift)

    @check(_ROUNDING, "a length changes faster than allowed")
    def rates(self) -> float:
        gait, unit = self.gait, self.stroke
        allowed = np.outer(gait.durations, self.limits.rates)[:, None, :] / unit
        change = gait.changes[:, :, None] / unit * [-1, 1]
        return max(0.0, float((change - allowed).max()))

    @check(_ROUNDING, "the anchors slip")
    def slides(self) -> float:
        return slip(self.gait, self.hold, self.worm.drag, self.worm.load) / self.stroke

    @check(_SOLVED, "the gait exceeds its bound; please report this")
    def over_the_bound(self) -> float:
        return max(0.0, self.gait.speed / min(self.design.ceiling, self.design.bound) - 1)

    @check(_SOLVED, "the wave is faster; please report this scene")
    def below_the_wave(self) -> float:
        return max(0.0, self.wave.wave_speed / self.gait.speed - 1)

    # -- trust -------------------------------------------------------------------------------------

    @facts
    def certified(self) -> dict[str, Any]:
        found = self.design
        every = found.gait.speed >= found.ceiling * (1 - _SOLVED)
        phases = "any number of" if every else f"at most {found.phases}"
        proof = (
            "the mode program, rigorous under round-off"
            if every
            else f"branch and bound over orders of anchors ({found.nodes} nodes), to 1e-6"
        )
        kept = f"with {self.anchors} or more segments anchored at any time"
        certificate = {"holds_for": f"gaits of {phases} phases per cycle {kept}", "proof": proof}
        return {"assumptions": _ASSUMED, "certificate": certificate}

    @warnings
    def of_gait(self) -> Iterator[str]:
        if self.design.gap > _WIDE:
            yield (
                f"the gait may be up to {self.design.gap:.2g} of the speed below the optimum; "
                "write a larger search.time_limit, or fewer search.phases"
            )
        if self.reserve_min is not None and self.reserve_min < 1 + _ROUNDING:
            yield (
                "in some phase the anchors have no reserve: reserve_min is 1, and any disturbance "
                "makes them slip; write a larger limits.reserve"
            )
        most = self.worm.push
        if most is not None and self.push_max > most:
            yield (
                f"a growing segment must push {self.push_max:.4g}, more than worm.push = "
                f"{most:g}; write more limits.anchors, which leaves fewer segments to push"
            )
