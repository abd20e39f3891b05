"""Kind "magnetic-pair": motion of the pair from rest, exact and averaged."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, ClassVar

from wormopt.errors import Fault, SolveError
from wormopt.result import Check, Unchecked, left_out
from wormopt.study import (
    Given,
    array,
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
from wormopt.systems.pair.pair_study import PairStudy
from wormopt.systems.pair.tables import NATURAL

with on_use():
    import numpy as np

    from wormopt.analysis.steady import SteadyState
    from wormopt.magnetics.material import SMALL_STRAIN
    from wormopt.model.model import Model
    from wormopt.simulation.simulate import simulate
    from wormopt.simulation.trajectory import Trajectory
    from wormopt.systems.pair.exact import magnetic_pair, scaled_law
    from wormopt.systems.shared.proof import CrossCheck, cross_check

# Largest distance of a converged first-order average from its steady state.
_CONVERGED = 1e-9
# Largest distance, over the swing, at which the averaged motion still shows the steady state.
_NEAR = 0.1
_ROUNDING = 1e-9  # largest rounding of a velocity, over the amplitude of the stretch
# A motion whose consecutive mean velocities differ by a larger share has not converged.
_DRIFT = 1e-6
# Decay times of a deviation, longest time in 1 / eps, steps of the average.
_FADED, _LONGEST, _STEPS = 25.0, 2000.0, 5_000
# Periods of the field at the end that are shown in detail.
_LATE, _LATE_SAMPLES = 4, 801


class Duration(Given):
    """The motion that is simulated from rest."""

    end: float | None = positive(
        "time",
        "duration, at least twice `periods`; default: 60/*ε* natural times, longer where "
        "deviations decay slowly",
        default=None,
    )
    samples: int = whole(2, 100000, "number of equidistant times in the result", default=2001)
    periods: int = whole(
        1,
        1000,
        "number of last field periods over which the exact motion is averaged; as many before "
        "are used to check convergence",
        default=20,
    )


@dataclass(frozen=True)
class Steady:
    """The steady motion of first order to which the pair converges."""

    velocity_steady: float = value("1", "*V* of the steady motion in first order, dimensionless")
    amplitude_steady: float = value("1", "amplitude *a* of half the stretch in the steady motion")
    strain_amplitude: float = value("1", "amplitude 2*a* of the stretch")
    phase_steady: float = value("rad", "phase *ξ* of the steady motion")
    stable: bool = value("1", "whether small deviations decay")
    decay_rate: float = value("rate", "decay rate of the slowest deviation")


@dataclass(frozen=True)
class ExactMotion:
    """The exact motion over time, and in the last periods."""

    instants: np.ndarray = signal("time", "time", "time", name="time")
    velocity: np.ndarray = signal("speed", "time", "exact velocity of the centre")
    velocity_period: np.ndarray = signal("speed", "time", "exact mean over a period of the field")
    late_time: np.ndarray = signal("time", "late", "time in the last periods")
    late_velocity: np.ndarray = signal("speed", "late", "exact velocity of the centre")


class MagneticPair(PairStudy, kind="magnetic-pair"):
    """Simulate two masses on a magneto-elastic link in a pulsating field.

    The pair starts from rest. The result contains the exact motion, its averages of first and
    second order, and the steady motion to which they converge. Theory:
    [theory-magnetics.md](../theory-magnetics.md#2-the-pair).

    The trust report has `closed_form_difference` (difference from eq. 19 of Zimmermann et al. 2007,
    for equal dry friction), `settled_to` (distance of the average's end from its steady state),
    `quadrature_error` (change of the mean rates with twice the nodes, over *ε*), residuals, and the
    events, rests and second route of the exact motion. The exit code is 3 without a steady motion:
    at detuning 0, or where friction takes more than the field supplies.

    Limits: averages are asymptotic in *ε*; a warning appears above 0.1. They assume that masses
    pass through 0 without rest, which the exact motion checks. A warning also appears at strains
    above 0.1, where the law of the material is no longer valid.
    """

    pictures: ClassVar = {
        "velocity": "velocity over time (figure 13 of Zimmermann et al. 2007), and the last four "
        "periods in detail; the average of second order begins where the swing reaches 4 *ε*",
    }
    headline: ClassVar = (
        "velocity_steady",
        "velocity_steady_second",
        "velocity_exact_mean",
        "amplitude_steady",
        "stable",
    )

    detuning: float = number(
        "1", "detuning *Δ*: the field's frequency is √2 + *εΔ* natural frequencies √(*c*/*m*)"
    )
    time: Duration = entry("the motion", default=Duration)
    stated_velocity: float | None = number(
        "speed", "a published velocity for comparison", default=None
    )

    def faults_of_keys(self) -> Iterator[Fault]:
        yield from self.pair.faults_in(self.units)
        slow = list(self.pair.slow_fields("detuning", self.detuning))
        yield from slow
        if not slow and self.time.end is not None:
            least = 2 * self.time.periods * self.turn * self.pair.time_unit
            if self.time.end < least:
                yield (
                    "time.end",
                    f"is shorter than twice time.periods; write at least {least:.5g}, or fewer "
                    "periods",
                )

    @property
    def nu(self) -> float:
        """Dimensionless frequency of the field."""
        return NATURAL + self.pair.smallness * self.detuning

    @property
    def turn(self) -> float:
        """Dimensionless period of the field."""
        return 2 * math.pi / self.nu

    def models(self) -> dict[str, Model]:
        """Make the pair of eq. 16, in the scene's units; without a dashpot, its `damping` is 0."""
        units, push, mass, stiffness = self.pair, self.pair.smallness, 1.0, 1.0
        if units.sample:
            mass, stiffness = units.sample.mass, units.sample.mass / units.time_unit**2
            push *= stiffness * units.length_unit
        laws = self.dimensionless.laws
        return {
            "": magnetic_pair(
                law=[scaled_law(law, push, units.speed_unit) for law in laws],
                push=push,
                frequency=self.nu / units.time_unit,
                mass=mass,
                stiffness=stiffness,
                cosines=units.cosines,
            )
        }

    # -- dimensionless motions ---------------------------------------------------------------------

    @stage
    def steady_states(self) -> tuple[SteadyState, ...]:
        found = self.dimensionless.steady(self.detuning)
        if not found:
            raise self.no_steady_motion(self.detuning)
        return found

    @cached_property
    def duration(self) -> float:
        """Duration of the motion."""
        if self.time.end is not None:
            return self.time.end / self.pair.time_unit
        states = self.steady_states
        slowest = max(s.eigenvalues[0].real for s in states if s.stable or len(states) == 1)
        least = 2 * self.time.periods * self.turn
        converged = max(60 / self.eps, _FADED / max(-slowest, 1e-300), least)
        return min(converged, _LONGEST / self.eps)

    @cached_property
    def settings(self) -> dict[str, Any]:
        """Settings of all simulations."""
        return {"p": {"frequency": self.nu}, "tolerance": self.tolerance.options}

    @property
    def times(self) -> np.ndarray:
        """Times at which motions are kept."""
        return np.linspace(0.0, self.duration, self.time.samples)

    @stage
    def first_average(self) -> Trajectory:
        tolerance = replace(self.settings["tolerance"], max_steps=_STEPS)
        settings = self.settings | {"tolerance": tolerance}
        model, times = self.dimensionless.averages[0], self.times
        try:
            return simulate(model, self.duration, times=times, dense=True, **settings)
        except SolveError as error:
            raise SolveError(
                f"the averaged motion cannot be simulated from rest ({error.reason}): the pair "
                "stays at rest where the friction at rest exceeds the push of the field",
                "use kind resonance to find its steady motions, or write weaker friction at rest",
                code="no_start",
            ) from None

    @stage
    def second_average(self) -> Trajectory | None:
        first, pair = self.first_average, self.dimensionless
        large = np.flatnonzero(pair.swung(first["swing"]))  # from where it is valid
        if not large.size or large[0] == len(first.time) - 1:
            return None
        k = int(large[0])
        x0 = {name: first[name][:, k] for name in ("center_velocity", "swing")}
        span = (float(first.time[k]), float(first.time[-1]))
        return simulate(pair.averages[1], span, x0=x0, times=first.time[k:], **self.settings)

    @stage
    def exact_motion(self) -> Trajectory:
        return simulate(
            self.dimensionless.exact, self.duration, times=self.times, dense=True,
            report=self.report, **self.settings,
        )  # fmt: skip

    @stage
    def second_route(self) -> CrossCheck | None:
        return cross_check(
            self.dimensionless.exact, self.exact_motion, recheck=self.tolerance.recheck,
            report=self.report, **self.settings,
        )  # fmt: skip

    @cached_property
    def state(self) -> SteadyState:
        """The steady state to which the first average converges."""
        end = self.first_average.end
        return min(self.steady_states, key=lambda state: np.abs(state.x - end).max())

    @cached_property
    def refined(self) -> SteadyState | None:
        """Steady state of second order."""
        return self.dimensionless.refined(self.state)

    @cached_property
    def means(self) -> tuple[float, float]:
        """Mean exact velocities in the last whole periods, and in as many before, these first."""
        length = self.time.periods * self.turn
        marks = self.duration - length * np.array([2, 1, 0])
        before, last = np.diff(self.exact_motion.at(marks)["center"][0]) / length
        return float(before), float(last)

    # -- results -----------------------------------------------------------------------------------

    @parts(Steady)
    def steady(self) -> Steady:
        state, amplitude = self.state, float(self.state["amplitude"][0])
        return Steady(
            velocity_steady=float(state.x[0]),
            amplitude_steady=amplitude,
            strain_amplitude=2 * amplitude,
            phase_steady=float(state["lag"][0]),
            stable=state.stable,
            decay_rate=-float(state.eigenvalues[0].real) / self.pair.time_unit,
        )

    @parts(ExactMotion)
    def over_time(self) -> ExactMotion:
        motion, half, speed = self.exact_motion, self.turn / 2, self.pair.speed_unit
        t = motion.time
        inside = (t >= half) & (t <= t[-1] - half)
        period = np.full(len(t), np.nan)
        ahead, behind = (motion.at(t[inside] + side * half)["center"][0] for side in (1, -1))
        period[inside] = (ahead - behind) / (2 * half)
        late = t[-1] - np.linspace(_LATE * self.turn, 0.0, _LATE_SAMPLES)
        late_velocity = motion.at(np.clip(late, 0.0, t[-1]))["center_velocity"][0]
        return ExactMotion(
            instants=t * self.pair.time_unit,
            velocity=motion["center_velocity"][0] * speed,
            velocity_period=period * speed,
            late_time=late * self.pair.time_unit,
            late_velocity=late_velocity * speed,
        )

    @array("speed", "time", "average of first order")
    def velocity_first(self) -> np.ndarray:
        count = len(self.exact_motion.time)  # fewer if that failed
        return self.first_average["center_velocity"][0][:count] * self.pair.speed_unit

    @array("speed", "time", "average of second order")
    def velocity_second(self) -> np.ndarray | None:
        if self.second_average is None:
            return None
        found = self.second_average["center_velocity"][0] * self.pair.speed_unit
        return np.concatenate([np.full(self.time.samples - len(found), np.nan), found])

    @scalar("angular_frequency", "frequency of the field")
    def frequency(self) -> float:
        return self.nu / self.pair.time_unit

    @scalar("1", "*V* of the steady motion in second order; unknown where the swing is below 4 *ε*")
    def velocity_steady_second(self) -> float | None:
        return float(self.refined.x[0]) if self.refined else None

    @scalar("1", "displacement of the exact motion over time, in the last whole periods")
    def velocity_exact_mean(self) -> float:
        return self.means[1]

    @scalar("1", "difference between first order and the exact mean")
    def averaging_error(self) -> float:
        return abs(self.steady.velocity_steady - self.means[1])

    @scalar("1", "difference between second order and the exact mean")
    def averaging_error_second(self) -> float | None:
        second = self.velocity_steady_second
        return None if second is None else abs(second - self.means[1])

    @scalar("stiffness", "stiffness of the sample", when="pair.sample")
    def stiffness(self) -> float:
        sample = self.pair.sample
        return sample.mass / self.pair.time_unit**2 if sample else 1.0

    @scalar("angular_frequency", "natural frequency √(*c*/*m*) of the sample", when="pair.sample")
    def natural_rate(self) -> float:
        return 1 / self.pair.time_unit

    @scalar("speed", "`velocity_steady` in SI units, with a sample", when="pair.sample")
    def velocity_steady_si(self) -> float:
        return self.steady.velocity_steady * self.pair.speed_unit

    @scalar("speed", "`velocity_exact_mean` in SI units, with a sample", when="pair.sample")
    def velocity_exact_mean_si(self) -> float:
        return self.means[1] * self.pair.speed_unit

    @property
    def is_stated(self) -> bool:
        """Whether there is a published velocity."""
        return self.stated_velocity is not None

    @scalar("speed", "stated velocity, as in the scene", when="is_stated")
    def velocity_stated(self) -> float:
        return self.stated_velocity or 0.0

    @scalar("speed", "relative deviation of the stated velocity", when="is_stated")
    def velocity_stated_deviation(self) -> float:
        return self.velocity_stated - self.steady.velocity_steady * self.pair.speed_unit

    # -- the trust report --------------------------------------------------------------------------

    @cached_property
    def closed_form_difference(self) -> float | None:
        """Difference of the steady state from eq. 19, where it applies."""
        return self.dimensionless.closed_form_difference(self.state.x, self.detuning)

    @checks
    def accepted(self) -> Iterator[Check]:
        advice = "the averaged model's steady state differs from eq. 19 by {:.2g} of its size"
        yield from self.closed_form_checks(self.closed_form_difference, advice)
        if self.second_route:
            yield self.second_route.check

    @cached_property
    def rests(self) -> list[float]:
        """Times at which a mass of the exact motion comes to rest."""
        return [event.time for event in self.exact_motion.events if event.kind == "stick"]

    @property
    def late_rests(self) -> int:
        """Number of rests in the second half."""
        return sum(at > self.exact_motion.end_time / 2 for at in self.rests)

    @property
    def settled(self) -> float:
        """Distance of the end of the first average from its steady state."""
        return float(np.abs(self.state.x - self.first_average.end).max())

    @facts
    def found(self) -> dict[str, Any]:
        state, second = self.state, self.second_route
        return {
            "steady_states": len(self.steady_states),
            "steady_residual": state.residual,
            "steady_residual_second": self.refined.residual if self.refined else None,
            "settled_to": self.settled,
            "closed_form_difference": self.closed_form_difference,
            "quadrature_error": self.dimensionless.quadrature_error(state),
            "exact": {
                "route": self.exact_motion.route,
                "events": len(self.exact_motion.events),
                "rests": len(self.rests),
                "rests_in_second_half": self.late_rests,
                "mean_before": self.means[0],
                "recheck": second.error if second else None,
                "recheck_route": second.route if second else "",
                "recheck_shares": second.shared if second else "",
            },
            "eigenvalues": [[one.real, one.imag] for one in state.eigenvalues],
        }

    @warnings
    def of_pair(self) -> Iterator[str]:
        yield from self.warnings_of_eps()
        strain = self.steady.strain_amplitude
        if strain > SMALL_STRAIN:
            yield left_out(
                strain,
                f"the amplitude of the stretch is {strain:.3g} of the length, but the law of the "
                f"material assumes small strains, up to about {SMALL_STRAIN:g}",
            )
        if self.steady.velocity_steady < -_ROUNDING * strain:
            yield "the pair moves backward, since friction is weaker in that direction"

    @warnings
    def of_convergence(self) -> Iterator[str]:
        before, last = self.means
        if abs(last - before) > _DRIFT * max(abs(last), abs(before)):
            yield (
                f"the exact motion has not converged: its mean velocity changed from {before:.7g} "
                f"to {last:.7g}; write a later time.end"
            )
        if self.settled > _CONVERGED:
            text = (
                f"the averaged motion ends {self.settled:.2g} away from the steady state; write a "
                "later time.end"
            )
            yield Unchecked(text) if self.settled > _NEAR * self.steady.amplitude_steady else text
        if self.late_rests:
            yield (
                f"masses came to rest {self.late_rests} times in the second half, but averaging "
                "assumes that they pass through 0"
            )
        if self.refined is None:
            yield "the swing is too small compared with eps for an average of second order"
        if len(self.steady_states) > 1:
            yield (
                f"{len(self.steady_states)} steady motions exist; from rest the pair converges to "
                "the reported one"
            )

    @warnings
    def of_stated_velocity(self) -> Iterator[str]:
        own, exact = (
            velocity * self.pair.speed_unit
            for velocity in (self.steady.velocity_steady, self.means[1])
        )
        if self.is_stated and abs(self.velocity_stated - own) > 1e-2 * abs(own):
            yield (
                f"the stated velocity {self.velocity_stated:g} agrees neither with eq. 19, "
                f"{own:.6g}, nor with the exact motion, {exact:.6g}"
            )
