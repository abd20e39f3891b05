"""Kind "peristaltic-drag": the best gait of a worm on linear drag."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import Any, ClassVar, Literal

from wormopt.errors import Fault, SolveError
from wormopt.result import Check
from wormopt.study import (
    Given,
    attributes,
    checks,
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
from wormopt.study.numerics import MeshTable
from wormopt.study.types import Pair, wrong_order
from wormopt.systems.shared.optimal_motion import OptimalMotion

with on_use():
    import casadi as ca
    import numpy as np

    from wormopt.numerics.collocation import Collocation
    from wormopt.ocp.mesh import Mesh
    from wormopt.ocp.optimise import Optimum
    from wormopt.systems.peristaltic.drag import rings
    from wormopt.systems.peristaltic.drag_gaits import (
        SHORTEST,
        DragAim,
        SmallGait,
        Stationary,
        best_gait,
        first_gait,
        mean_step,
        small_gaits,
        stationary,
        touches,
    )

# Accepted relative difference of both routes to the best gait.
_AGREED = 1e-7
_INSTANTS = 512


class Drag(Given):
    """Drag *c*(*l*) = *c*<sub>0</sub>(*l*/*L*)<sup>*a*</sup> on the centre of a segment."""

    exponent: float = number(
        "1", "exponent *a*: 1 for drag per present length, below 0 if thick segments grip"
    )
    coefficient: float = positive(
        "drag", "drag *c*<sub>0</sub> of a segment of length *L*", default=1.0
    )

    def faults_of_keys(self) -> Iterator[Fault]:
        if self.exponent == 0:
            yield (
                "exponent",
                "if drag does not depend on length no gait has a net displacement; write 1.0, or "
                "-1.0 for thick segments that grip",
            )


class Worm(Given):
    """A worm of segments that can all stretch and shorten."""

    segments: int = whole(2, 20, "number of segments")
    length: float = positive("length", "reference length *L* of a segment", default=1.0)


class Effort(Given):
    """Effort allowed in a period; exactly one of the two."""

    strain_rate: float | None = positive(
        "rate", "∫∑(*l*′<sub>j</sub>/*L*)² d*t* over a period", default=None
    )
    dissipation: float | None = positive(
        "energy", "energy dissipated in a period by drag spread along each segment", default=None
    )

    def faults_of_keys(self) -> Iterator[Fault]:
        if (self.strain_rate is None) == (self.dissipation is None):
            yield (
                "",
                "none or two limits are given; write either strain_rate or dissipation",
            )


class Limits(Given):
    """Limits of the lengths."""

    mean_length: float | None = positive(
        "length", "mean length of each segment over a period; free if left out", default=None
    )
    keeps_length: bool = entry(
        "whether the total length of the worm is constant; needs `mean_length`", default=False
    )
    length: Pair | None = entry(
        "least and largest length of a segment; required without `mean_length`, else at least "
        "a tenth of *L*",
        quantity="length",
        default=None,
    )

    def faults_in(self, usual: float) -> Iterator[Fault]:
        """Yield limits that no lengths satisfy, or that leave lengths free; `usual` is *L*."""
        mean = self.mean_length
        if self.length is not None:
            yield from wrong_order("limits.length", self.length, may_be_equal=False)
        elif mean is None:
            yield (
                "limits",
                "without mean_length and length the best gait shortens segments to nothing; write "
                f"mean_length = {usual:g}",
            )
        if mean is None and self.keeps_length:
            yield "limits.mean_length", f"missing; keeps_length needs it: write {usual:g}"
        low, high = self.length or (0.1 * usual, float("inf"))
        if mean is not None and low < high and not low < mean < high:
            middle = (low + high) / 2 if self.length else usual
            yield (
                "limits.mean_length",
                f"{mean:g} is not between the lengths {low:g} and {high:g}; write {middle:g}",
            )


class Search(Given):
    """Starting points of the search."""

    starts: int = whole(
        1, 10, "number of initial gaits: the best of the ⌊*N*/2⌋ small gaits", default=1
    )


@dataclass(frozen=True)
class Signals:
    """The motion over a period."""

    instant: np.ndarray = signal("time", "instant", "time")
    length: np.ndarray = signal("length", "segment instant", "length of the segment")
    length_small: np.ndarray = signal("length", "segment instant", "length in the best small gait")
    rate: np.ndarray = signal("speed", "segment instant", "rate of the length")
    position: np.ndarray = signal("length", "ring instant", "position of the ring")
    velocity: np.ndarray = signal("speed", "instant", "velocity of the mean of all segment centres")
    dissipation: np.ndarray = signal("power", "instant", "power dissipated by drag")


@dataclass(frozen=True)
class SmallGaits:
    """The best gaits of small strains."""

    gain_strain_rate: float = value("1", "*k* of the best small gait by strain rate")
    gain_dissipation: float = value("1", "*k* of the best small gait by dissipation")
    segments_per_wave_strain_rate: float = value(
        "count", "`segments_per_wave`, best by strain rate"
    )
    segments_per_wave_dissipation: float = value(
        "count", "`segments_per_wave`, best by dissipation"
    )


class PeristalticDrag(OptimalMotion, kind="peristaltic-drag"):
    """Optimise the gait of a peristaltic worm whose drag depends on segment length.

    The gait has the longest displacement per period at a given effort. The ground resists each
    segment by *c*(*l*) times its velocity. The worm moves only because drag depends on length. The
    best gait of small strains solves an eigenvalue problem. For any effort the gait is optimised
    numerically. See [theory](../theory-peristaltic.md#4-drag).
    """

    pictures: ClassVar = {
        "drag_gait": "velocity and lengths, with the best small gait dashed",
        "body": "the worm over a period, from top to bottom",
        "animation": "the moving worm",
    }
    headline: ClassVar = ("distance", "distance_small", "wave_step", "segments_per_wave")

    worm: Worm = entry("the worm")
    drag: Drag = entry("drag law of the ground")
    period: float = positive("time", "period", default=1.0)
    effort: Effort = entry("effort allowed in a period")
    limits: Limits = entry("limits of the lengths")
    search: Search = entry("starting points of the search", default=Search)
    mesh: MeshTable = entry(
        "discretisation",
        default=MeshTable(arcs=12, degree=8, scheme="legendre"),
    )

    def faults_of_keys(self) -> Iterator[Fault]:
        yield from self.limits.faults_in(self.worm.length)
        if self.limits.keeps_length and self.worm.segments < 3:
            yield (
                "worm.segments",
                "2 segments of fixed total length have one shape variable and no net displacement; "
                "write 3",
            )
        most = self.worm.segments // 2
        if self.search.starts > most:
            what = f"there are only {most} small gaits that go forward; write {most}"
            yield "search.starts", what

    # -- solving -----------------------------------------------------------------------------------

    @cached_property
    def aim(self) -> DragAim:
        """The worm, its effort and limits."""
        effort, limits, L = self.effort, self.limits, self.worm.length
        least, most = limits.length or (SHORTEST * L, float("inf"))
        return DragAim(
            segments=self.worm.segments,
            exponent=self.drag.exponent,
            cost="dissipation" if effort.strain_rate is None else "strain_rate",
            effort=effort.strain_rate or effort.dissipation or 0.0,
            period=self.period,
            length=L,
            drag=self.drag.coefficient,
            mean=limits.mean_length,
            keeps_length=limits.keeps_length,
            limits=(least, most),
        )

    @cached_property
    def found(self) -> tuple[Optimum, tuple[float, ...]]:
        """The best gait, and the objectives of all starts."""
        mesh, starts = self.mesh, self.search.starts
        points = Collocation(mesh.degree, mesh.scheme)
        even = Mesh.even(1, mesh.arcs, points, max(0, mesh.degree - 1))
        return best_gait(self.aim, even, mesh.tolerance, starts=starts, report=self.report)

    def solve(self) -> dict[str, Optimum]:
        """Find the best gait."""
        return {"gait": self.found[0]}

    @stage
    def second_route(self) -> tuple[Stationary | None, str]:
        """The gait by its Euler-Lagrange equations, and the method or why there is none."""
        if self.touches_limit:
            return None, "none: a segment reaches a limit of its length"
        if self.aim.mean is None:
            return None, "none: without a mean length the mean of the lengths is not determined"
        try:
            with np.errstate(all="ignore"):
                found = stationary(self.motion, self.aim)
        except SolveError as error:
            return None, f"failed: {error.reason}"
        return found, "Euler-Lagrange equations, by Newton's method"

    @cached_property
    def touches_limit(self) -> bool:
        """Whether a segment reaches a limit of its length."""
        return touches(self.motion, self.aim)

    # -- signals -----------------------------------------------------------------------------------

    def expressions(self) -> dict[str, ca.SX]:
        model = self.motion.program.problem.model
        return {
            "length": model["lengths"],
            "rate": model["rates"],
            "velocity": model["speed"],
            "dissipation": model["dissipation"],
            "position": rings(model["position"], model["lengths"]),
        }

    @parts(Signals)
    def signals(self) -> Signals:
        return Signals(**self.sampled, length_small=self.small_lengths(self.sampled["instant"]))

    @attributes
    def with_small(self) -> dict[str, list[str]]:
        return {"signals": [*self.expressions(), "length_small"]}

    @cached_property
    def lengths(self) -> np.ndarray:
        """Lengths at even times over a period, (N, m)."""
        return self.motion.output("lengths", np.arange(_INSTANTS) / _INSTANTS * self.period)

    @cached_property
    def harmonic(self) -> np.ndarray:
        """First harmonic of the length of each segment."""
        return np.fft.rfft(self.lengths, axis=1)[:, 1]

    def small_lengths(self, t: np.ndarray) -> np.ndarray:
        """Return lengths (N, m) of the best small gait, in phase with the gait at its start."""
        small = self.aim.small[0]
        ahead = float(np.angle(small.mode.conj() @ self.harmonic)) / (2 * np.pi) * self.period
        return first_gait(self.aim, small)(t + ahead)

    # -- numbers -----------------------------------------------------------------------------------

    @scalar("length", "displacement per period")
    def distance(self) -> float:
        ends = self.motion.state("position", np.array([0.0, self.motion.duration]))
        return float(ends[0, 1] - ends[0, 0])

    @scalar("speed", "`distance` divided by the period")
    def speed(self) -> float:
        return self.distance / self.motion.duration

    @scalar("length", "displacement by the theory of small strains, same effort")
    def distance_small(self) -> float:
        return self.aim.small_displacement

    @scalar(
        "length",
        "`distance` from the Euler-Lagrange equations; unknown if a segment reaches a limit of "
        "its length",
    )
    def distance_stationary(self) -> float | None:
        again = self.second_route[0]
        return again and again.displacement

    @scalar("1", "derivative of `distance` in lengths *L* by the relative effort")
    def price(self) -> float | None:
        again = self.second_route[0]
        return again and again.price * self.aim.effort / self.aim.length

    @scalar(
        "angle",
        "mean phase of a segment's first harmonic less that of the segment before; if positive "
        "the wave runs forward",
    )
    def wave_step(self) -> float:
        return mean_step(self.harmonic)

    @scalar("count", "2π divided by the size of `wave_step`")
    def segments_per_wave(self) -> float:
        return _per_wave(self.wave_step)

    @parts(SmallGaits)
    def for_small_strains(self) -> SmallGaits:
        aim = self.aim
        rate, dissipated = (_first(aim, cost) for cost in ("strain_rate", "dissipation"))
        return SmallGaits(
            rate.gain, dissipated.gain, _per_wave(rate.step), _per_wave(dissipated.step)
        )

    @scalar("length", "least length of a segment")
    def length_min(self) -> float:
        return float(self.lengths.min())

    @scalar("length", "largest")
    def length_max(self) -> float:
        return float(self.lengths.max())

    @scalar("rate", "integral of squared strain rates over a period")
    def effort_strain_rate(self) -> float:
        return self.integral("strain_power")

    @scalar("energy", "energy dissipated by drag in a period")
    def effort_dissipation(self) -> float:
        return self.integral("dissipation")

    def integral(self, name: str) -> float:
        """Return the integral of an output over the motion, by the points of its mesh."""
        arcs, points = self.motion.arcs, self.motion.mesh.collocation
        t = self.motion.breaks[:-1] + np.multiply.outer(points.tau, arcs.duration)
        values = self.motion.output(name, t.ravel()).reshape(t.shape)
        return float(points.B @ values @ arcs.duration)

    @scalar("time", "period", name="time")
    def duration(self) -> float:
        return self.numbers.duration

    @scalar(
        "1", "minimised value: the negative displacement over `distance_small`", name="objective"
    )
    def minimised(self) -> float:
        return self.numbers.minimised

    @scalar("speed", "root mean square of \\|*l*′\\|")
    def input_rms(self) -> float | None:
        return self.numbers.input_rms

    @scalar("speed", "largest rate of a length")
    def input_peak(self) -> float | None:
        return self.numbers.input_peak

    # -- the trust report --------------------------------------------------------------------------

    @checks
    def equations(self) -> Iterator[Check]:
        again, reason = self.second_route
        name = "equations of Euler and Lagrange"
        if again is not None:
            advice = f"by the Euler-Lagrange equations the displacement is {again.displacement:.9g}"
            yield Check(name, abs(again.displacement / self.distance - 1), _AGREED, advice)
        elif reason.startswith("failed"):
            advice = (
                "the Euler-Lagrange equations were not solved: "
                f"{reason.removeprefix('failed: ')}; write a drag.exponent farther from 0, or less "
                "effort"
            )
            yield Check(name, None, _AGREED, advice)

    @facts
    def routes(self) -> dict[str, Any]:
        starts = [-self.aim.small_displacement * objective for objective in self.found[1]]
        return {"starts": starts, "second_route": self.second_route[1]}

    @warnings
    def of_gait(self) -> Iterator[str]:
        reason = self.second_route[1]
        if reason.startswith("none"):
            yield f"no second route to this gait: {reason.removeprefix('none: ')}"
        if self.touches_limit and self.limits.length is None:
            yield (
                f"a segment reaches the least length, {SHORTEST:g} of its usual length; write "
                "limits.length, or a smaller effort"
            )
        if len(self.aim.small) > 1:
            yield "a local optimum; write more search.starts to try more waves on the body"


def _first(aim: DragAim, cost: Literal["strain_rate", "dissipation"]) -> SmallGait:
    return small_gaits(aim.segments, aim.exponent, cost, fixed_total=aim.keeps_length)[0]


def _per_wave(step: float) -> float:
    return 2 * np.pi / abs(step) if step else np.inf
