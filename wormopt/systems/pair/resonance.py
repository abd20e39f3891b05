"""Kind "resonance": steady motions of the pair over the frequency of its field."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import Annotated, Any, ClassVar

from msgspec import Meta

from wormopt.errors import Fault, SolveError
from wormopt.result import Check, left_out
from wormopt.study import (
    Given,
    array,
    checks,
    entry,
    facts,
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
from wormopt.study.types import Finite, wrong_order
from wormopt.systems.pair.pair_study import PairStudy
from wormopt.systems.pair.tables import LOWEST, NATURAL

with on_use():
    import numpy as np

    from wormopt.analysis.continuation import Branch
    from wormopt.analysis.steady import rates_of
    from wormopt.magnetics.material import SMALL_STRAIN
    from wormopt.systems.pair.steady import Exact, Points, branches_of, confirm, points_of

FinitePair = Annotated[
    tuple[Finite, ...],
    Meta(min_length=2, max_length=2, description="two finite numbers, [least, largest]"),
]


class Frequencies(Given):
    """Frequencies of the continuation of steady motions."""

    detuning: FinitePair = entry(
        "least and largest detuning *Δ*", quantity="1", default=(-2.0, 2.0)
    )
    points: int = whole(2, 10000, "number of equidistant detunings in the result", default=400)
    largest: float = positive(
        "1",
        "amplitude, in lengths of the link, above which a branch counts as unbounded",
        default=100.0,
    )

    def faults_of_keys(self) -> Iterator[Fault]:
        yield from wrong_order("detuning", self.detuning, may_be_equal=False)


class Confirm(Given):
    """Exact simulations from every stable steady state; default: none."""

    time: float = positive(
        "1", "duration of each, in natural times √(*m*/*c*), in SI scenes too", default=2000.0
    )
    periods: int = whole(
        1, 1000, "number of last field periods that are averaged, and as many before", default=50
    )


@dataclass(frozen=True)
class SteadyMotions:
    """Steady motions at the detunings of the sweep, and the branches to which they belong."""

    steady_motions: int = value("count", "number of steady states", headline=True)
    stable: int = value("count", "number of stable steady states", headline=True)
    velocity_largest: float = value("speed", "largest \\|*V*\\| of the steady states")
    detuning: np.ndarray = signal("1", "point", "detuning of the field")
    velocity_steady: np.ndarray = signal("speed", "point", "velocity of the centre")
    velocity_second: np.ndarray = signal("speed", "point", "velocity of the centre, second order")
    amplitude_steady: np.ndarray = signal("length", "point", "amplitude of half the stretch")
    stable_point: np.ndarray = signal("1", "point", "whether it is stable")
    branch: np.ndarray = signal("1", "point", "index of its branch")


@dataclass(frozen=True)
class Branches:
    """The continued branches, one after the other."""

    branches: int = value("count", "branches")
    delta_fold: list[float] = value("1", "detunings of the folds, ascending; empty without folds")
    curve_detuning: np.ndarray = signal("1", "curve", "detuning of the field")
    curve_velocity: np.ndarray = signal("speed", "curve", "velocity of the centre")
    curve_amplitude: np.ndarray = signal("length", "curve", "amplitude of half the stretch")
    curve_stable: np.ndarray = signal("1", "curve", "whether it is stable")
    curve_branch: np.ndarray = signal("1", "curve", "index of the branch")


class Resonance(PairStudy, kind="resonance"):
    """Compute the frequency response of a magneto-elastic pair: steady motions.

    The result contains all branches of the averaged motion, folds, stability, and an exact motion
    from every stable point. Variables over `curve` are the continued branches. Detunings without a
    steady motion have no state. Theory: [theory-magnetics.md](../theory-magnetics.md#2-the-pair).
    """

    pictures: ClassVar = {"resonance": "velocity and amplitude over the detuning"}
    headline: ClassVar = ("velocity_largest", "steady_motions", "stable", "delta_fold", "confirmed")

    frequencies: Frequencies = entry("range of frequencies", default=Frequencies)
    confirm: Confirm | None = entry("exact motions for comparison", default=None)

    def faults_of_keys(self) -> Iterator[Fault]:
        yield from self.pair.faults_in(self.units)
        lowest = NATURAL + self.pair.smallness * self.frequencies.detuning[0]
        if self.confirm is not None:
            least = 2 * self.confirm.periods * 2 * math.pi / max(lowest, LOWEST)
            if self.confirm.time < least:
                yield (
                    "confirm.time",
                    f"is shorter than twice confirm.periods; write at least {least:.5g}, or fewer "
                    "periods",
                )
        yield from self.pair.slow_fields("frequencies.detuning", self.frequencies.detuning[0])

    @stage
    def continuation(self) -> list[Branch]:
        low, high = self.frequencies.detuning
        found = branches_of(self.dimensionless, (low, high), self.frequencies.largest)
        if not found:
            raise self.no_steady_motion((low + high) / 2 or high, self.frequencies.largest)
        return found

    @stage
    def steady_points(self) -> Points:
        low, high = self.frequencies.detuning
        detuning = np.linspace(low, high, self.frequencies.points)
        found = points_of(self.dimensionless, self.continuation, detuning)
        if not found.detuning.size:
            at = self.curves.curve_detuning
            raise SolveError(
                f"no branch has a steady motion at the {len(detuning)} detunings of the result; "
                f"they are between {at.min():.6g} and {at.max():.6g}",
                "write frequencies.detuning within that range, or more frequencies.points",
                code="no_steady_motion",
            )
        return found

    @stage
    def exact_motions(self) -> Exact | None:
        if self.confirm is None:
            return None
        return confirm(
            self.dimensionless, self.steady_points, self.confirm.time, self.confirm.periods,
            self.tolerance.options, self.report,
        )  # fmt: skip

    # -- results -----------------------------------------------------------------------------------

    @parts(SteadyMotions)
    def motions(self) -> SteadyMotions:
        points, speed = self.steady_points, self.pair.speed_unit
        return SteadyMotions(
            steady_motions=len(points.detuning),
            stable=int(points.stable.sum()),
            velocity_largest=float(np.abs(points.velocity).max()) * speed,
            detuning=points.detuning,
            velocity_steady=points.velocity * speed,
            velocity_second=points.second * speed,
            amplitude_steady=points.amplitude * self.pair.length_unit,
            stable_point=points.stable,
            branch=points.branch,
        )

    @parts(Branches)
    def curves(self) -> Branches:
        found, pair = self.continuation, self.dimensionless
        x = np.concatenate([branch.x for branch in found])
        numbers = [np.full(len(branch.x), k) for k, branch in enumerate(found)]
        return Branches(
            branches=len(found),
            delta_fold=sorted(pair.detuning(f.parameter) for b in found for f in b.folds),
            curve_detuning=pair.detuning(np.concatenate([b.parameter for b in found])),
            curve_velocity=x[:, 0] * self.pair.speed_unit,
            curve_amplitude=np.hypot(x[:, 1], x[:, 2]) * self.pair.length_unit,
            curve_stable=np.concatenate([branch.stable for branch in found]),
            curve_branch=np.concatenate(numbers),
        )

    @property
    def exact(self) -> Exact:
        """Exact motions, where there are any."""
        assert self.exact_motions
        return self.exact_motions

    def error(self, velocity: np.ndarray) -> float | None:
        """Largest difference of velocities from exact motions that converged."""
        return _largest(np.abs(velocity - self.exact.velocity)[self.exact.settled])

    @array("speed", "point", "velocity of the centre, exact mean", when="confirm")
    def velocity_exact(self) -> np.ndarray:
        return self.exact.velocity * self.pair.speed_unit

    @scalar("count", "number of exact motions that converged", when="confirm")
    def confirmed(self) -> int:
        return int(self.exact.settled.sum())

    @scalar("1", "largest difference of *V* between exact motions and first order", when="confirm")
    def averaging_error(self) -> float | None:
        return self.error(self.steady_points.velocity)

    @scalar("1", "largest difference of *V* between exact motions and second order", when="confirm")
    def averaging_error_second(self) -> float | None:
        return self.error(self.steady_points.second)

    # -- the trust report --------------------------------------------------------------------------

    @cached_property
    def closed_form_difference(self) -> float | None:
        """Largest difference of steady states from eq. 19, where it applies."""
        found = map(
            self.dimensionless.closed_form_difference,
            self.steady_points.x,
            self.steady_points.detuning.tolist(),
        )
        return max((one for one in found if one is not None), default=None)

    @checks
    def closed_form(self) -> Iterator[Check]:
        advice = "steady states differ from eq. 19 by {:.2g}"
        yield from self.closed_form_checks(self.closed_form_difference, advice)

    @facts
    def found(self) -> dict[str, Any]:
        points, pair, exact = self.steady_points, self.dimensionless, self.exact_motions
        rates = rates_of(pair.averages[0])
        nearest = int(np.argmin(np.abs(points.detuning - self.frequencies.detuning[1])))
        p = rates.parameters({"frequency": pair.frequency(float(points.detuning[nearest]))})
        return {
            "quadrature_error": pair.quadrature_error(rates.steady(points.x[nearest], p)),
            "branch_ends": [list(branch.ends) for branch in self.continuation],
            "exact": exact
            and {
                "motions": int(points.stable.sum()),
                "gave_up": exact.gave_up,
                "settled": int(exact.settled.sum()),
                "largest_drift": _largest(np.abs(exact.velocity - exact.before)),
            },
            "closed_form_difference": self.closed_form_difference,
        }

    @warnings
    def of_averages(self) -> Iterator[str]:
        yield from self.warnings_of_eps()
        points, ends = self.steady_points, [branch.ends for branch in self.continuation]
        if runaways := sum("runaway" in of_branch for of_branch in ends):
            yield (
                f"the swing of {runaways} branches exceeds frequencies.largest = "
                f"{self.frequencies.largest:g} lengths of the link near the natural frequency, but "
                "the law of the material is for small strains"
            )
        if lost := sum("lost" in of_branch or "steps" in of_branch for of_branch in ends):
            yield f"{lost} branches ended before the end of the sweep"
        strains = 2 * points.amplitude
        if np.any(strains > SMALL_STRAIN):
            yield left_out(
                float(np.median(strains)),
                f"{np.mean(strains > SMALL_STRAIN):.0%} of the steady motions stretch the link by "
                f"more than {SMALL_STRAIN:.0%}, but the law of the material assumes small strains",
            )
        if small := float(np.mean(~self.dimensionless.swung(points.x[:, 1:].T))):
            yield (
                f"{small:.0%} of the steady motions have too small a swing, compared with eps, for "
                "an average of second order"
            )
        if without := len({*points.detuning} - {*points.detuning[points.stable]}):
            yield f"no stable steady motion was found at {without} of the detunings"

    @warnings
    def of_exact_motions(self) -> Iterator[str]:
        points, exact = self.steady_points, self.exact_motions
        if exact is None:
            return
        if unsettled := int(points.stable.sum()) - int(exact.settled.sum()):
            yield f"{unsettled} exact motions have not converged; write a longer confirm.time"
        if apart := int(np.sum(np.abs(points.velocity - exact.velocity)[exact.settled] > self.eps)):
            yield (
                f"{apart} exact motions converge to a velocity that differs from the average by "
                "more than eps"
            )


def _largest(values: np.ndarray) -> float | None:
    known = values[np.isfinite(values)]
    return float(known.max()) if known.size else None
