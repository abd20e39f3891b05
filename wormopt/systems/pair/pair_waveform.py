"""Kind "pair-waveform": the best periodic field of a magneto-elastic pair."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import Any, ClassVar, Literal

from wormopt.errors import Fault, SolveError
from wormopt.quantities import Scalar, unit_of
from wormopt.result import Unchecked
from wormopt.study import (
    Given,
    arrays,
    attributes,
    check,
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
from wormopt.study.numerics import MeshTable
from wormopt.study.types import Seed, per
from wormopt.systems.chain import CoulombFriction, faults_of_law
from wormopt.systems.pair.tables import Aim, Limits
from wormopt.systems.shared.declared import INSTANT
from wormopt.systems.shared.optimal_motion import OptimalMotion

with on_use():
    import casadi as ca
    import numpy as np

    from wormopt.model.friction import Coulomb
    from wormopt.model.model import Model
    from wormopt.numerics.collocation import Collocation
    from wormopt.ocp.mesh import Mesh
    from wormopt.ocp.motion import Guess
    from wormopt.ocp.optimise import Optimum
    from wormopt.systems.chain import law_of
    from wormopt.systems.pair.exact import magnetic_pair, scaled_law
    from wormopt.systems.pair.waveform import (
        FADED,
        MOST_PERIODS,
        Harmonic,
        Proof,
        best_field,
        best_harmonic,
        check_strain,
        field_course,
        first_field,
        first_harmonic,
        guesses,
        prove,
        scaled,
        waveform_problem,
    )
    from wormopt.systems.shared.optimum import warnings_of_reading

_WIDE = 1.0  # strain above which the model of the link is not valid


class DrivenPair(Given):
    """Two masses on a magneto-elastic link, dimensionless."""

    eps: float = positive("share", "push of the field over stiffness times length")
    friction: CoulombFriction = entry(
        "friction law of the ground; forces over the push, equal or one per mass; weaker forward "
        "than backward"
    )

    def faults_of_keys(self) -> Iterator[Fault]:
        law, wrong = self.friction, list(faults_of_law("friction", self.friction, 2))
        yield from wrong
        if not wrong and sum(per(law.forward, 2)) >= sum(per(law.backward, 2)):
            yield (
                "friction",
                "is not weaker forward than backward, so the pair does not move forward; write "
                "forward below backward",
            )

    def model(self, frequency: float, cosines: tuple[float, ...] | None) -> Model:
        """Make the dimensionless pair; without cosines the field is its input."""
        laws = [scaled_law(law_of(self.friction, mass), self.eps) for mass in range(2)]
        return magnetic_pair(law=laws, push=self.eps, frequency=frequency, cosines=cosines)


class Search(Given):
    """Starting points of the search."""

    starts: int = whole(
        1,
        100,
        "number of starts: the harmonic field, then random fields of three harmonics",
        default=1,
    )
    seed: Seed = entry("seed of the starts", default=0)


@dataclass(frozen=True)
class InHarmonicField:
    """The best harmonic field within the limits, and the motion in it."""

    speed_harmonic: float = value(
        "speed", "mean speed of the periodic orbit in the harmonic field, by exact simulation"
    )
    frequency_harmonic: float = value("angular_frequency", "frequency of the harmonic field")
    amplitude_harmonic: float = value("share", "amplitude of the harmonic field")
    strain_max_harmonic: float = value(
        "share", "largest \\|*x*<sub>2</sub> − *x*<sub>1</sub>\\| in the harmonic field"
    )
    work_per_distance_harmonic: float | None = value(
        "energy_per_distance", "work of the harmonic field over the distance"
    )
    drift_harmonic: float = value(
        "share", "change of stretch and velocities over the last block of `periods_harmonic`"
    )
    periods_harmonic: int = value(
        "count", "periods until the motion in the harmonic field was periodic"
    )


@dataclass(frozen=True)
class InFieldFound:
    """The field found, and the motion in it."""

    speed: float = value("speed", "mean speed of the optimiser")
    frequency: float = value("angular_frequency", "frequency of the field found")
    first_harmonic: float = value("share", "amplitude of the first harmonic of the field found")
    swing: float = value("share", "half the difference of largest and smallest stretch")
    gait_breaks: np.ndarray = signal("time", "gait_break", "times of the field's pieces")
    gait_polynomial: np.ndarray = signal(
        "share",
        "gait_piece link gait_power",
        "field, coefficients of s^k, s the time since the piece began",
    )


@dataclass(frozen=True)
class Simulated:
    """The exact simulation in the field found."""

    speed_simulated: float = value(
        "speed", "mean speed of an exact simulation over 20 periods in the field found"
    )
    strain_max: float = value("share", "largest \\|*x*<sub>2</sub> − *x*<sub>1</sub>\\|")
    work_per_distance: float | None = value(
        "energy_per_distance", "work of the field over the distance"
    )
    drift: float = value("share", "change of stretch and velocities over the 20 periods")
    push_left: float = value(
        "share",
        "least remaining share of a push of a thousandth, over up to 1200 periods; the simulation "
        "ends below 0.5. A warning appears if it is never below",
    )
    gain: float | None = value(
        "share",
        "ratio of `speed_simulated` to `speed_harmonic`; for `minimise` of the works per distance; "
        "unknown where the harmonic field does not move the pair, or not at the required speed",
    )


SIGNALS = INSTANT | {
    "field": ("share", ("instant",), "field G"),
    "field_harmonic": ("share", ("instant",), "harmonic field"),
    "stretch": ("length", ("instant",), "stretch x_2 - x_1"),
    "stretch_harmonic": ("length", ("instant",), "stretch in the harmonic field"),
    "position": ("length", ("mass", "instant"), "position of the mass"),
    "velocity": ("speed", ("mass", "instant"), "velocity of the mass"),
    "contact_force": ("force", ("mass", "instant"), "force of the ground"),
}


class PairWaveform(OptimalMotion, kind="pair-waveform"):
    """Optimise the periodic field that drives a magneto-elastic pair.

    The magneto-elastic pair (eq. 16 of Zimmermann et al. 2007) moves in the best field, and for
    comparison in a harmonic field within the same limits. Velocities repeat after a period,
    positions repeat up to the advance. Friction is exact dry friction. See
    [optimal.md](../optimal.md#the-field-of-a-magneto-elastic-pair). The scene is dimensionless:
    lengths over that of the link, times over √(*m*/*c*).

    The mean of the harmonic field is the middle of `limits.field`. It has the largest amplitude
    that range, slope and strain allow (for `minimise`: the smallest with the required speed), at
    the best frequency of the range. If its mean alone, applied at rest, stretches the link beyond
    `limits.strain`, a warning says so, `gain` is unknown, and the search starts from the fastest
    harmonic field about a lower mean. The same holds if that strain leaves a harmonic field too
    weak to move the pair. If the pair rests in the first field, four random fields are tried.

    `input_rms` and `input_peak` are those of *G*, with a slope limit those of *G*′. The arrays
    contain the instants at which arcs join twice. `gait_breaks` and `gait_polynomial` are the exact
    field, as a Gait of one row: `drive(magnetic_pair(..., cosines=None), load_gait("result.nc"),
    periodic=True)` moves the pair with it.
    """

    pictures: ClassVar = {
        "waveform": "field, stretch and velocities over a period; the harmonic field, scaled to "
        "the same period, is shifted so its crest is that of the first harmonic",
    }
    headline: ClassVar = ("speed", "speed_simulated", "speed_harmonic", "gain", "frequency")

    units: Literal["dimensionless"] = entry(
        "lengths over that of the link, times over √(*m*/*c*)", default="dimensionless"
    )
    pair: DrivenPair = entry("the pair")
    limits: Limits = entry("limits of the field")
    objective: Aim = entry("objective of the waveform")
    mesh: MeshTable = entry("mesh in time", default=MeshTable(arcs=100))
    search: Search = entry("starting points of the search", default=Search)

    @cached_property
    def free(self) -> Model:
        """The pair with the field as its input."""
        return self.pair.model(self.harmonic_field.frequency, None)

    # -- what is computed --------------------------------------------------------------------------

    @stage
    def harmonic_field(self) -> Harmonic:
        law = law_of(self.pair.friction, 0)
        assert isinstance(law, Coulomb)
        check_strain(self.limits, self.pair.eps, float(law.forward))
        return best_harmonic(self.driven, self.limits, self.objective, self.report)

    @property
    def driven(self) -> Model:
        """The pair in a harmonic field."""
        return self.pair.model(self.limits.frequencies[0], (1.0, 1.0))

    @stage
    def start(self) -> tuple[Harmonic, list[Guess]]:
        first = first_field(self.driven, self.limits, self.harmonic_field, self.report)
        starts, seed = self.search.starts, self.search.seed
        found = guesses(self.free, self.limits, first, self.pair.eps, starts=starts, seed=seed)
        return first, found

    @cached_property
    def searched(self) -> tuple[dict[str, Optimum], tuple[float, ...]]:
        """The solves by name, the last with exact phases, and the results of the starts."""
        first, starts = self.start
        mesh = Mesh.even(1, self.mesh.arcs, Collocation(self.mesh.degree, self.mesh.scheme))
        problem = waveform_problem(scaled(self.free, first), self.limits, self.objective)
        try:
            return best_field(problem, mesh, starts, self.mesh.tolerance, self.report)
        except SolveError as error:  # its partial result is no optimum
            raise SolveError(error.reason, error.suggestion, code=error.code) from None

    def solve(self) -> dict[str, Optimum]:
        """Find the best field."""
        return self.searched[0]

    @stage
    def proof(self) -> Proof:
        return prove(self.free, self.motion, self.report)

    # -- results -----------------------------------------------------------------------------------

    @scalar(
        "speed", "value that was minimised; a speed is maximised as its negative", name="objective"
    )
    def minimised(self) -> Scalar:
        quantity = "energy_per_distance" if self.objective.minimise else "speed"
        return Scalar(self.numbers.minimised, unit_of(quantity, self.units))

    @parts(InHarmonicField)
    def harmonic(self) -> InHarmonicField:
        found, orbit = self.harmonic_field, self.harmonic_field.orbit
        return InHarmonicField(
            speed_harmonic=orbit.speed,
            frequency_harmonic=found.frequency,
            amplitude_harmonic=found.amplitude,
            strain_max_harmonic=orbit.strain,
            work_per_distance_harmonic=orbit.work_per_distance,
            drift_harmonic=orbit.drift,
            periods_harmonic=orbit.periods,
        )

    @parts(InFieldFound)
    def field_found(self) -> InFieldFound:
        motion, course = self.motion, field_course(self.motion)
        x = motion.states(np.array([0.0, motion.duration]))[0]
        stretch = motion.output("stretch", np.linspace(0, motion.duration, 2001))
        return InFieldFound(
            speed=float(x[1] - x[0]) / motion.duration,
            frequency=2 * math.pi / motion.duration,
            first_harmonic=first_harmonic(course)[0],
            swing=float(np.ptp(stretch)) / 2,
            gait_breaks=course.breaks,
            gait_polynomial=course.polynomial,
        )

    @parts(Simulated)
    def simulated(self) -> Simulated:
        proof, orbit = self.proof, self.proof.orbit
        return Simulated(
            speed_simulated=proof.speed,
            strain_max=orbit.strain,
            work_per_distance=orbit.work_per_distance,
            drift=orbit.drift,
            push_left=proof.left,
            gain=_gain(proof, self.harmonic_field, fastest=self.objective.maximise is not None),
        )

    def expressions(self) -> dict[str, ca.SX]:
        model = self.motion.program.problem.model
        names = ("position", "velocity", "stretch", "field")
        return {name: model[name] for name in names} | {"contact_force": model.forces}

    @arrays(SIGNALS)
    def signals(self) -> dict[str, np.ndarray]:
        motion, harmonic = self.motion, self.harmonic_field
        # The harmonic field is shifted so its crest is that of the waveform's first harmonic.
        lag = first_harmonic(field_course(motion))[1] / (2 * math.pi)
        at = np.mod(self.sampled["instant"] / motion.duration - lag, 1.0) * harmonic.course.period
        dense = harmonic.orbit.motion.dense
        assert dense is not None
        x = dense(at)
        return self.sampled | {
            "field_harmonic": harmonic.course(at)[0],
            "stretch_harmonic": x[1] - x[0],
        }

    @attributes
    def shown(self) -> dict[str, Any]:
        return {"signals": ["field", "stretch", "velocity"]}

    # -- the trust report --------------------------------------------------------------------------

    @check(
        1e-7,
        "after 20 periods the simulated speed is {speed_simulated:.6g}, not {speed:.6g}",
        name="speed by simulation",
    )
    def speed_error(self) -> float:
        found, kept = self.field_found.speed, self.proof.speed
        return abs(kept - found) / max(abs(found), abs(kept), 1e-300)

    @facts
    def tried(self) -> dict[str, Any]:
        return {"starts": self.searched[1]}

    @warnings
    def of_reading(self) -> Iterator[str]:
        return warnings_of_reading(*self.optimisation.optima.values())

    @warnings
    def of_harmonic_field(self) -> Iterator[str]:
        harmonic, orbit, proof = self.harmonic_field, self.harmonic_field.orbit, self.proof
        if not orbit.settled:
            yield (
                f"in the harmonic field the motion still changes by {orbit.drift:.2g} after "
                f"{orbit.periods} periods; its speed is that of the last period"
            )
        if not harmonic.kept:
            yield (
                f"the middle of limits.field alone stretches the link by {orbit.strain:.6g}, "
                "beyond limits.strain; so there is no harmonic field about it, and gain is unknown"
            )
            return
        if self.objective.maximise and not proof.speed > orbit.speed:
            yield (
                "in the simulation the waveform is not faster than the harmonic field: "
                f"{proof.speed:.6g} against {orbit.speed:.6g}; write search.starts to try more"
            )
        if self.objective.minimise and not harmonic.reached:
            yield (
                "no harmonic field within the limits reaches objective.speed; the best has "
                f"{orbit.speed:.6g}, and gain is unknown"
            )
        spent, least = orbit.work_per_distance, proof.orbit.work_per_distance
        if self.objective.minimise and harmonic.reached and spent and least and not least < spent:
            yield (
                "in the simulation the waveform does not need less work than the harmonic field: "
                f"{least:.6g} against {spent:.6g}; write search.starts to try more"
            )

    @warnings
    def of_motion(self) -> Iterator[str]:
        left, strain = self.proof.left, self.proof.orbit.strain
        if left >= FADED:
            yield (
                f"a small push does not decay: {left:.2g} of it remains after {MOST_PERIODS} "
                "periods, so the motion may be unstable"
            )
        if strain >= _WIDE:
            yield Unchecked(
                f"the link changes its length by {100 * strain:.3g} %, but the law of its material "
                "is for small strains, and at zero length the masses would pass each other; write "
                "limits.strain"
            )
        if self.search.starts == 1:
            yield (
                "the result is a local optimum from a single start; write search.starts to try more"
            )


def _gain(proof: Proof, harmonic: Harmonic, *, fastest: bool) -> float | None:
    """Ratio of speeds, or of works per distance, above 1 if the waveform is better."""
    orbit = harmonic.orbit
    if fastest:
        still = 1e-9 * orbit.strain * harmonic.frequency
        return proof.speed / orbit.speed if orbit.speed > still else None
    spent, least = orbit.work_per_distance, proof.orbit.work_per_distance
    return spent / least if harmonic.reached and spent and least else None
