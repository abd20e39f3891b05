"""Kind "harmonic-masses": mean velocity of masses with prescribed oscillations."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from functools import cached_property, partial
from typing import Any, ClassVar, Literal

from wormopt.errors import Fault, SceneError, SolveError
from wormopt.result import Check
from wormopt.study import (
    Given,
    Study,
    checks,
    entry,
    facts,
    number,
    on_use,
    parts,
    positive,
    signal,
    stage,
    value,
    warnings,
    whole,
)
from wormopt.study.given import wrong_count
from wormopt.study.numerics import AveragingTable, ToleranceTable
from wormopt.study.types import FinitePerMass, NonNegativePerMass, PerMass, per
from wormopt.systems.chain import Friction, SpikeFriction, ViscousFriction, faults_of_law

with on_use():
    import numpy as np

    from wormopt.model.friction import Coulomb
    from wormopt.model.model import Model
    from wormopt.simulation.simulate import simulate
    from wormopt.simulation.trajectory import Trajectory
    from wormopt.systems.chain import laws_of
    from wormopt.systems.shared.proof import accepted_error, count_events, warnings_of_motion
    from wormopt.systems.swinging.prescribed import harmonic_masses, steady_masses
    from wormopt.systems.swinging.steady import (
        Orbit,
        Runner,
        SlowVelocity,
        Steady,
        attempt,
        measured,
        nearest,
        tends_to,
    )

# Accepted sum of the momenta, as a share of the largest of a mass; the builder is as strict, or
# less.
_BALANCED = 5e-13
# Masses times highest harmonic: there are up to twice as many reversals in a period, and averaging
# sorts them.
_MOST = 16
# Instants of the period in the picture.
_POINTS = 721
# Steady velocities have round-off: a start this close, relative to the largest velocity, is on one.
_ON = 1e-9
# Friction's impulse in a period over the least momentum amplitude, above which it is not small.
_SMALL = 0.2
# Value of the same above which exact motions are not simulated, since their velocities round.
_LARGE = 1e9
# Accepted difference, relative to the largest velocity, of averages on twice as many nodes, and
# between first order and closed form.
_QUADRATURE = 1e-9
# Accepted error of second-order averaging: this many squares of the ripple, and at least this share
# of the largest velocity.
_FACTOR, _FLOOR = 10.0, 1e-8
# Averages of second order are not compared with the exact motion if the ripple exceeds this share
# of the distance to a velocity at which a mass begins or ceases to reverse.
_NEAR = 0.05


class Harmonic(Given):
    """A harmonic of the velocities relative to the centre.

    The velocity is Σ<sub>k</sub> *A*<sub>ik</sub> cos(*k ω t* − *φ*<sub>ik</sub>).
    """

    order: int = whole(1, 12, "*k*", default=1)
    amplitude: NonNegativePerMass = entry("amplitudes *A*<sub>ik</sub>", quantity="speed")
    phase: FinitePerMass = entry("phases *φ*<sub>ik</sub> in degrees", default=0.0)


class Masses(Given):
    """Masses with prescribed velocities relative to their centre.

    Not allowed: velocities with a total momentum other than 0 (the message gives its value), masses
    without oscillation, repeated orders, friction in one direction only.
    """

    masses: int = whole(2, 12, "number of masses; times the highest `order` at most 16")
    mass: PerMass = entry("point masses", quantity="mass", default=1.0)
    frequency: float = positive(
        "angular_frequency", "angular frequency *ω* of the first harmonic", default=1.0
    )
    harmonic: tuple[Harmonic, ...] = entry("tables `[[worm.harmonic]]`, one for each harmonic")
    friction: Friction | tuple[Friction, ...] = entry(
        "friction law of the ground, one table for all masses or one per mass; no spikes"
    )

    @property
    def ground(self) -> tuple[Friction, ...]:
        """Friction of every mass."""
        return self.friction if isinstance(self.friction, tuple) else (self.friction,) * self.masses

    @property
    def coefficients(self) -> list[list[tuple[float, float]]]:
        """Cosine and sine amplitudes of every harmonic up to the highest, for every mass."""
        found = [[(0.0, 0.0)] * max(h.order for h in self.harmonic) for _ in range(self.masses)]
        for harmonic in self.harmonic:
            amplitude, phase = (
                per(value, self.masses) for value in (harmonic.amplitude, harmonic.phase)
            )
            for i in range(self.masses):
                turn = math.radians(phase[i] % 360.0)
                found[i][harmonic.order - 1] = (
                    amplitude[i] * math.cos(turn),
                    amplitude[i] * math.sin(turn),
                )
        return found

    def faults_of_keys(self) -> Iterator[Fault]:
        counts = [*wrong_count("mass", self.mass, self.masses, "masses")]
        orders = [harmonic.order for harmonic in self.harmonic]
        if not orders:
            yield "harmonic", "is empty, so no mass swings; write a table for each harmonic"
            return
        for index, harmonic in enumerate(self.harmonic):
            key = f"harmonic[{index}]"
            for name in ("amplitude", "phase"):
                value = getattr(harmonic, name)
                counts += wrong_count(f"{key}.{name}", value, self.masses, "masses")
            if orders.index(harmonic.order) < index:
                yield f"{key}.order", f"repeats order {harmonic.order}; write each once"
        if self.masses * max(orders) > _MOST:
            yield (
                "",
                f"has {self.masses} masses with harmonics up to {max(orders)}, which reverse too "
                f"often; write fewer, their product at most {_MOST}",
            )
        yield from counts
        if not counts and len(set(orders)) == len(orders):
            yield from self._faults_of_swing()
        yield from self._faults_of_friction()

    def _faults_of_swing(self) -> Iterator[Fault]:
        masses, coefficients = per(self.mass, self.masses), self.coefficients
        sizes = [max(math.hypot(*pair) for pair in own) for own in coefficients]
        still = [str(i) for i, size in enumerate(sizes) if size == 0]
        if still:
            yield (
                "harmonic",
                f"mass {', '.join(still)} does not swing; write an amplitude above 0 in a harmonic",
            )
        largest = max(m * size for m, size in zip(masses, sizes, strict=True))
        for index, harmonic in enumerate(self.harmonic):
            pairs = [own[harmonic.order - 1] for own in coefficients]
            left = [math.fsum(m * p[k] for m, p in zip(masses, pairs, strict=True)) for k in (0, 1)]
            if math.hypot(*left) > _BALANCED * largest:
                amount, phase = math.hypot(*left), math.degrees(math.atan2(left[1], left[0]))
                yield (
                    f"harmonic[{index}]",
                    "velocities relative to the centre must have no total momentum, but masses "
                    f"times these add up to amplitude {amount:.6g} at phase {phase:.6g}; write "
                    "amplitudes and phases whose sum is 0",
                )

    def _faults_of_friction(self) -> Iterator[Fault]:
        several = isinstance(self.friction, tuple)
        if several:
            wrong = [*wrong_count("friction", self.friction, self.masses, "masses", "table")]
            yield from wrong
            if wrong:
                return
        resists = {"forward": False, "backward": False}
        for i, law in enumerate(self.ground if several else self.ground[:1]):
            key = f"friction[{i}]" if several else "friction"
            yield from faults_of_law(key, law, 1 if several else self.masses)
            if isinstance(law, SpikeFriction):
                yield key, "spikes do not slide back, but these masses must; write another kind"
                return
            for side in resists:
                name = "drag" if isinstance(law, ViscousFriction) else side
                resists[side] |= any(number > 0 for number in per(getattr(law, name), 1))
        for side in (side for side, there in resists.items() if not there):
            yield (
                "friction",
                f"has no resistance to motion {side}: every velocity at which all masses slide "
                f"{side} is steady; write friction {side}",
            )

    @property
    def period(self) -> float:
        """Period of the oscillation."""
        return 2 * math.pi / self.frequency

    def model(self, *, place: bool) -> Model:
        """Make the Model; `place`: whether the position of the centre is a state."""
        coefficients = np.array(self.coefficients)
        return harmonic_masses(
            coefficients[:, :, 0],
            coefficients[:, :, 1],
            law=laws_of(self),
            frequency=self.frequency,
            mass=self.mass,
            place=place,
        )

    def relative_velocities(self, theta: np.ndarray) -> np.ndarray:
        """Velocities relative to the centre, (N, m), at phases `theta` (m,) of the period."""
        coefficients = np.array(self.coefficients)
        turn = 2 * np.pi * np.outer(np.arange(1, coefficients.shape[1] + 1), theta)
        return coefficients[:, :, 0] @ np.cos(turn) + coefficients[:, :, 1] @ np.sin(turn)

    @cached_property
    def extremes(self) -> np.ndarray:
        """Velocities V at which a mass begins or ceases to reverse, with the error of a grid."""
        w = self.relative_velocities(np.arange(4096) / 4096)
        before, after = np.roll(w, 1, axis=1), np.roll(w, -1, axis=1)
        bent = before - 2 * w + after
        turns = (w - before) * (after - w) <= 0
        top = w - (after - before) ** 2 / (8 * np.where(bent == 0, 1, bent))
        return -top[turns]

    @cached_property
    def closed_form(self) -> float | None:
        """Steady velocity of `steady_masses`, for dry friction and one harmonic."""
        laws = [law for law in laws_of(self) if isinstance(law, Coulomb)]
        only, *others = self.harmonic
        if others or len(laws) < self.masses:
            return None
        return steady_masses(per(only.amplitude, self.masses), laws)

    @cached_property
    def smallness(self) -> float:
        """Impulse of the largest sliding forces in a period over the least momentum amplitude.

        Averaging needs values far below 1.
        """
        speeds = np.abs(self.relative_velocities(np.linspace(0, 1, 257)))
        forces = sum(
            max(
                abs(float(law.slip_force(d * v, d)))
                for d in law.directions
                for v in (0.0, own.max())
            )
            for law, own in zip(laws_of(self), speeds, strict=True)
        )
        momentum = sum(per(self.mass, self.masses)) * speeds.max(axis=1).min()
        return float(2 * np.pi / self.frequency * forces / momentum)


class Start(Given):
    """Initial state of the simulated motion."""

    velocity: float = number("speed", "initial velocity *V* of the centre", default=0.0)


class Duration(Given):
    """A simulated motion for comparison."""

    periods: int = whole(1, 10000, "duration in periods", default=60)
    samples: int = whole(
        2,
        1000000,
        "number of equidistant instants in the result, including both ends",
        default=2001,
    )


@dataclass(frozen=True)
class Averages:
    """Steady velocities by averaging."""

    first: list[Steady]  # in first order, ascending
    second: list[Steady | None]  # in second order, one for each of `first`
    finer: list[Steady]  # in first order, on twice as many nodes

    @property
    def quadrature(self) -> float | None:
        """Largest change of a steady velocity on twice as many nodes; None if one comes or goes."""
        if len(self.finer) != len(self.first):
            return None
        both = zip(self.first, self.finer, strict=True)
        return max(abs(coarse.velocity - fine.velocity) for coarse, fine in both)


@dataclass(frozen=True, eq=False)
class ExactMotions:
    """Motions simulated with exact contact."""

    orbits: list[Orbit | None]  # periodic, one for each steady velocity; None: not found
    course: Trajectory | None  # from the velocity given
    lost: str  # why the relevant orbit, or the course, is missing


@dataclass(frozen=True)
class AveragedNumbers:
    """Numbers of the steady velocities by averaging."""

    velocity_steady: float = value(
        "speed", "steady *V* to which the motion converges, in first order", headline=True
    )
    velocity_steady_second: float | None = value(
        "speed", "`velocity_steady` in second order", headline=True
    )
    velocity_closed_form: float | None = value(
        "speed",
        "steady *V* in closed form, for dry friction and one harmonic; else unknown",
        headline=True,
    )
    stable: int = value("count", "whether small deviations decay")
    settling_time: float | None = value("time", "time constant of their decay")
    steady_velocities: list[float] = value("speed", "all steady velocities")
    steady_stable: list[int] = value("count", "whether each of them is stable")
    smallness: float = value(
        "share", "largest impulse of friction in a period over the least momentum amplitude"
    )


@dataclass(frozen=True)
class ExactNumbers:
    """Numbers of the exact periodic motion; None if it was not found."""

    velocity_exact_mean: float | None = value(
        "speed",
        "displacement of the exact periodic motion over ten periods, divided by their "
        "duration; this and quantities divided by it are unknown below the accepted error "
        "(1e-7 of the largest velocity, or 1000 tolerances)",
        headline=True,
    )
    averaging_error: float | None = value(
        "speed", "difference between first order and the exact mean", headline=True
    )
    averaging_error_second: float | None = value(
        "speed", "difference between second order and the exact mean"
    )
    exact_velocities: list[float | None] = value("speed", "exact mean velocities at these")
    advance: float | None = value("length", "displacement in a period")
    velocity_ripple: float | None = value(
        "speed", "difference of largest and least *V* in the periodic motion"
    )
    exact_drift: float | None = value("speed", "change of *V* after ten periods")
    force_mean: np.ndarray | None = value("force", "mean friction on each mass")
    power_mean: float | None = value("power", "mean power of the actuators")
    energy_per_distance: float | None = value(
        "energy_per_distance", "energy of the actuators over distance"
    )
    rest_share: float | None = value(
        "share", "largest share of the period during which one mass rests"
    )
    recheck_error: float | None = value(
        "share", "error of the second route for the periodic motion"
    )


@dataclass(frozen=True)
class Signals:
    """Velocities over a period and over time, and the events of a period."""

    share: np.ndarray = signal("share", "share", "time as a share of the period")
    relative_velocity: np.ndarray = signal(
        "speed", "mass share", "velocity of the mass relative to the centre"
    )
    times: np.ndarray = signal("time", "time", "time", name="time")
    center_velocity_averaged: np.ndarray = signal(
        "speed", "time", "velocity of the centre, averaged to first order"
    )
    center_velocity: np.ndarray | None = signal("speed", "time", "exact velocity of the centre")
    center: np.ndarray | None = signal("length", "time", "position of the centre")
    event_share: list[float] | None = signal(
        "share", "event", "time of the event as a share of the period"
    )
    event_contact: list[int] | None = signal("count", "event", "mass")
    event_mode: list[int] | None = signal("count", "event", "direction from then on, 0 at rest")


class HarmonicMasses(Study, kind="harmonic-masses"):
    """Compute the speed of masses with prescribed oscillations, averaged and exact.

    Actuators hold the masses to prescribed harmonic velocities relative to their centre; friction
    determines the velocity *V* of the centre. The result contains all steady velocities by averages
    of first and second order, in closed form where one exists, and the exact periodic motion at
    each. Theory: [theory-magnetics.md](../theory-magnetics.md#3-averaging).

    A motion that starts on a steady velocity, to 1e-9 of the largest, stays on it, whether it is
    stable or not.

    The trust report has `routes` (steady velocity by every route, `error` of the second order and
    the `accepted` value: ten squares of the ripple over the least amplitude), `averaging`
    (`change_by_doubled_nodes`, difference from the closed form), `smallness`, and `exact` (velocity
    at the start of the period, drift, events, second route).

    The status is `failed` where twice the nodes give other velocities, the closed form or the
    second route disagrees, or the exact motion drifts or cannot be simulated. It is also `failed`
    where friction is small (`smallness` up to 0.2, no rest) and the error of second order exceeds
    the accepted value. A missing exact motion at a steady velocity to which the motion does not
    converge only gives a warning. Further warnings: friction that is not small, masses that rest, a
    motion that is too short, a velocity that may be zero, no second route (`tolerance.recheck =
    false`).
    """

    pictures: ClassVar = {
        "reversals": "velocities over a period with their reversals, *V* over time",
    }

    worm: Masses = entry("the masses")
    start: Start = entry("start of a simulated motion for comparison", default=Start)
    time: Duration = entry("duration of the motion", default=Duration)
    averaging: AveragingTable = entry("computation of the averages", default=AveragingTable)
    tolerance: ToleranceTable = entry("tolerances of simulations", default=ToleranceTable)

    # -- computing ---------------------------------------------------------------------------------

    @cached_property
    def size(self) -> float:
        """Largest velocity relative to the centre."""
        return float(np.abs(self.worm.extremes).max())

    def slow(self, order: Literal[1, 2], nodes: int) -> SlowVelocity:
        """Average the velocity of the centre."""
        model = self.worm.model(place=False)
        return SlowVelocity(model, 2 * np.pi / model["frequency"], order, nodes)

    @stage
    def averages(self) -> Averages:
        if (smallness := self.worm.smallness) > _LARGE:
            message = (
                f"can change the momentum in a period by {smallness:.3g} times the least "
                f"momentum amplitude, but at most {_LARGE:.0e} is simulated; write all "
                f"friction smaller by {smallness / _LARGE:.2g} or more"
            )
            raise SceneError(self.name, [("worm.friction", message)])
        nodes, extremes = self.averaging.nodes, self.worm.extremes.tolist()
        first = self.slow(1, nodes).steady(extremes)
        if not first:
            raise SolveError("no steady velocity exists", "write friction in both directions")
        finer = self.slow(1, 2 * nodes).steady(extremes)
        second = self.slow(2, nodes).steady(extremes)
        return Averages(first, [nearest(steady, second) for steady in first], finer)

    @cached_property
    def chosen(self) -> int:
        """Index of the steady velocity to which the motion converges."""
        return tends_to(self.start.velocity, self.averages.first, _ON * self.size)

    @property
    def steady(self) -> Steady:
        """Steady velocity to which the motion converges, in first order."""
        return self.averages.first[self.chosen]

    @property
    def second_order(self) -> float | None:
        """Steady velocity to which the motion converges, in second order."""
        second = self.averages.second[self.chosen]
        return second and second.velocity

    @stage
    def exact(self) -> ExactMotions:
        """Find the periodic motions near the steady velocities, and the requested motion."""
        time, found = self.time, self.averages
        runner = Runner(
            measured(self.worm.model(place=True)),
            self.worm.period,
            self.tolerance.options,
            self.report,
        )
        tried = [
            attempt(partial(runner.orbit, (s or f).velocity, recheck=self.tolerance.recheck))
            for f, s in zip(found.first, found.second, strict=True)
        ]
        motion, no_motion = attempt(
            partial(runner.run, self.start.velocity, time.periods, time.samples)
        )
        lost = [str(error) for error in (tried[self.chosen][1], no_motion) if error]
        return ExactMotions([orbit for orbit, _ in tried], motion, lost[0] if lost else "")

    @property
    def orbit(self) -> Orbit | None:
        """The exact motion to which the simulated motion converges."""
        return self.exact.orbits[self.chosen]

    @stage
    def averaged_course(self) -> Trajectory:
        end = self.time.periods * self.worm.period
        stiff = self.worm.smallness > 1.0  # it converges within a period
        return simulate(
            self.slow(1, self.averaging.nodes).averaged,
            end,
            x0={"center_velocity": self.start.velocity},
            times=np.linspace(0.0, end, self.time.samples),
            tolerance=self.tolerance.options,
            route="radau" if stiff else "auto",
        )

    @property
    def accepted(self) -> float:
        """Accepted error of exact velocities."""
        return accepted_error(self.tolerance.options) * self.size

    # -- results -----------------------------------------------------------------------------------

    @parts(AveragedNumbers)
    def averaged_numbers(self) -> AveragedNumbers:
        all_steady, steady = self.averages.first, self.steady
        return AveragedNumbers(
            velocity_steady=steady.velocity,
            velocity_steady_second=self.second_order,
            velocity_closed_form=self.worm.closed_form,
            stable=int(steady.stable),
            settling_time=-1 / steady.slope if steady.stable else None,
            steady_velocities=[one.velocity for one in all_steady],
            steady_stable=[int(one.stable) for one in all_steady],
            smallness=self.worm.smallness,
        )

    @parts(ExactNumbers)
    def exact_numbers(self) -> ExactNumbers:
        orbit = self.orbit
        known = orbit.velocity if orbit and abs(orbit.velocity) > self.accepted else None
        velocity = orbit and orbit.velocity
        return ExactNumbers(
            velocity_exact_mean=known,
            averaging_error=_apart(velocity, self.steady.velocity),
            averaging_error_second=_apart(velocity, self.second_order),
            exact_velocities=[one and one.velocity for one in self.exact.orbits],
            advance=known and known * self.worm.period,
            velocity_ripple=orbit and orbit.ripple,
            exact_drift=orbit and orbit.drift,
            force_mean=orbit and orbit.force,
            power_mean=orbit and orbit.power,
            energy_per_distance=orbit and known and orbit.power / abs(known),
            rest_share=orbit and orbit.rest_share,
            recheck_error=orbit and orbit.second and orbit.second.error,
        )

    @parts(Signals)
    def signals(self) -> Signals:
        theta, averaged, course = (
            np.linspace(0.0, 1.0, _POINTS),
            self.averaged_course,
            self.exact.course,
        )
        motion, period = self.orbit and self.orbit.motion, self.worm.period
        contacts = [contact.name for contact in motion.system.model.contacts] if motion else []
        events = [e for e in motion.events if e.time < period] if motion else []
        return Signals(
            share=theta,
            relative_velocity=self.worm.relative_velocities(theta),
            times=averaged.time,
            center_velocity_averaged=averaged["center_velocity"][0],
            center_velocity=course and course["center_velocity"][0],
            center=course and course["center"][0],
            event_share=[e.time / period for e in events] or None,
            event_contact=[contacts.index(e.name) for e in events] or None,
            event_mode=[e.mode for e in events] or None,
        )

    # -- the trust report --------------------------------------------------------------------------

    @facts
    def routes(self) -> dict[str, Any]:
        orbit, closed, found = self.orbit, self.worm.closed_form, self.averages
        first, second, exact = self.steady.velocity, self.second_order, orbit and orbit.velocity
        return {
            "routes": {
                "first_order": first,
                "second_order": second,
                "closed_form": closed,
                "exact": exact,
                "error": _apart(exact, second),
                "accepted": orbit and self._accepted_by(orbit),
            },
            "averaging": {
                "nodes": self.averaging.nodes,
                "change_by_doubled_nodes": found.quadrature,
                "closed_form_error": _apart(closed, first),
                "accepted": _QUADRATURE * self.size,
                "steady": [asdict(steady) for steady in found.first],
            },
            "smallness": {"value": self.worm.smallness, "small_up_to": _SMALL},
            "exact": orbit
            and {
                "route": orbit.motion.route,
                "start": orbit.start,
                "drift": orbit.drift,
                "simulations": orbit.trials,
                "events": count_events(orbit.motion),
                "recheck": orbit.second and orbit.second.facts,
                "mean_forces_add_up_to": float(orbit.force.sum()),
            },
        }

    def _accepted_by(self, orbit: Orbit) -> float:
        """Return the accepted error of second-order averaging."""
        # It is of second order in the ripple over the least amplitude that is to be reversed.
        speeds = np.abs(self.worm.relative_velocities(np.linspace(0, 1, 257))).max(axis=1)
        return float(_FACTOR * orbit.ripple**2 / speeds.min() + _FLOOR * speeds.max())

    def _bends(self, orbit: Orbit) -> bool:
        """Whether ripple nearly reaches a velocity where a mass begins or ceases to reverse."""
        room = np.abs(self.worm.extremes - orbit.velocity).min()
        return bool(orbit.ripple > _NEAR * room)

    @checks
    def agreement(self) -> Iterator[Check]:
        first, orbit, change = self.steady, self.orbit, self.averages.quadrature
        limit, closed = _QUADRATURE * self.size, self.worm.closed_form
        by = "" if change is None else f", by {change:.2g}"
        advice = (
            f"averages on twice as many nodes have other steady velocities{by}; write a larger "
        )
        yield Check("averages on twice as many nodes", change, limit, advice + "averaging.nodes")
        if closed is not None:
            advice = f"the closed form gives {closed:.9g}, averaging gives {first.velocity:.9g}"
            yield Check("closed form", closed - first.velocity, limit, advice)
        missing, why = [orbit, self.exact.course].count(None), self.exact.lost
        yield Check("exact motions missing", missing, 0.0, f"an exact motion was not found: {why}")
        if orbit is None:
            return
        if orbit.second:
            yield orbit.second.check
        if first.stable:
            advice = f"the exact motion drifts by {orbit.drift:.2g} in ten periods"
            yield Check("drift", orbit.drift, self.accepted, advice)
        if self.worm.smallness <= _SMALL and not orbit.rest_share and not self._bends(orbit):
            error = _apart(orbit.velocity, self.second_order)
            advice = (
                "friction is small, but the exact mean velocity differs from second-order "
                "averaging, "
                + ("which has no steady velocity" if error is None else f"by {error:.2g}")
            )
            yield Check("second order", error, self._accepted_by(orbit), advice)

    @warnings
    def of_orbit(self) -> Iterator[str]:
        orbit, smallness, steady = self.orbit, self.worm.smallness, self.averages.first
        if smallness > _SMALL:
            yield (
                f"friction is not small: in a period it can change the momentum by {smallness:.2g} "
                "times the least momentum amplitude"
                + ("" if orbit is None else "; velocity_exact_mean is valid nevertheless")
            )
        if orbit is None:
            return
        if orbit.rest_share:
            yield (
                f"a mass rests for {orbit.rest_share:.2g} of the period, but averaging assumes "
                "that its velocity passes through 0 without a rest"
            )
        if smallness <= _SMALL and self._bends(orbit):
            yield (
                "a mass nearly begins or ceases to reverse, where averages have a corner: second "
                "order is not compared with the exact motion; write worm.friction that is more "
                "alike in both directions"
            )
        missing = [
            f"{one.velocity:.6g}"
            for k, one in enumerate(steady)
            if self.exact.orbits[k] is None and k != self.chosen
        ]
        if missing:
            yield f"no exact motion was found at the steady velocity {', '.join(missing)}"
        if orbit.velocity and not self.exact_numbers.velocity_exact_mean:
            yield (
                f"the exact mean velocity {orbit.velocity:.2g} may be zero, since it is below the "
                "accepted error; quantities divided by it are unknown"
            )
        if not self.steady.stable:
            yield "the reported steady velocity is unstable: the motion starts on it"
        if (course := self.exact.course) is not None:
            left = abs(course["center_velocity"][0, -1] - orbit.start)
            if left > 0.01 * self.size:
                yield (
                    f"the motion ends {left:.2g} away from the steady motion; write more "
                    "time.periods"
                )
        yield from warnings_of_motion(orbit.motion, orbit.second)


def _apart(exact: float | None, other: float | None) -> float | None:
    """Difference of two numbers, if both are known."""
    return None if exact is None or other is None else abs(exact - other)
