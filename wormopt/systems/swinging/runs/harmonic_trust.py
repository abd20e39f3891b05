"""How far to trust the speed of masses that swing about their centre."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from wormopt.model.friction import Law
from wormopt.scene.types import per
from wormopt.simulation.trajectory import Trajectory
from wormopt.systems.chain.runs.chains import law_of, tolerance_of
from wormopt.systems.shared.proof import accepted_error, count_events, warnings_of_motion
from wormopt.systems.swinging.runs.exact_orbit import NUDGE, Orbit
from wormopt.systems.swinging.runs.slow_velocity import Steady
from wormopt.systems.swinging.scenes.harmonic_masses import HarmonicMassesScene, SwingingTable

# Friction's impulse in a period against the momentum of the smallest amplitude: beyond this it is
# not small.
_SMALL = 0.2
# Of the largest velocity: by how much averages on twice as many nodes may differ, and the first
# order from the closed form.
_QUADRATURE = 1e-9
# Second-order averaging may be off by so many squares of the ripple, and by so much of the largest
# velocity in any case.
_FACTOR, _FLOOR = 10.0, 1e-8
# Changes of friction by a share move the velocity by at most so many such shares of the largest.
_NUDGED = 10.0


@dataclass(frozen=True, eq=False)
class Found:
    """What the routes found."""

    first: Sequence[Steady]  # steady velocities, average of first order
    second: Sequence[Steady | None]  # steady velocities, average of second order
    finer: Sequence[Steady]  # the first order on twice as many nodes
    chosen: int  # which of first the course tends to
    closed: float | None  # closed form, of dry friction and one harmonic
    orbits: Sequence[Orbit | None]  # exact, one per entry of first; None: gave up
    course: Trajectory | None  # exact, from the velocity given
    averaged: Trajectory  # course averaged to first order
    nudged: bool  # friction had to be changed a little, see `nudged`
    lost: str  # why the chosen orbit, or the course, is missing


def laws_of(worm: SwingingTable) -> list[Law]:
    """Friction law of every mass."""
    one_each = isinstance(worm.friction, tuple)
    return [law_of(table, 0 if one_each else i) for i, table in enumerate(worm.ground)]


def relative_velocities(worm: SwingingTable, theta: np.ndarray) -> np.ndarray:
    """Velocities relative to the centre, (N, m), at shares `theta` (m,) of the period."""
    coefficients = np.array(worm.coefficients)
    turn = 2 * np.pi * np.outer(np.arange(1, coefficients.shape[1] + 1), theta)
    return coefficients[:, :, 0] @ np.cos(turn) + coefficients[:, :, 1] @ np.sin(turn)


def period_of(table: HarmonicMassesScene) -> float:
    """Period of the first harmonic."""
    return 2 * np.pi / table.worm.frequency


def difference(exact: float | None, other: float | None) -> float | None:
    """How far two numbers are apart, if both are known."""
    return None if exact is None or other is None else abs(exact - other)


def smallness_of(worm: SwingingTable) -> float:
    """Impulse of the largest sliding forces in a period against the smallest swing's momentum.

    Averaging is for values far below 1.
    """
    speeds = np.abs(relative_velocities(worm, np.linspace(0, 1, 257)))
    forces = sum(
        max(abs(float(law.slip_force(d * v, d))) for d in law.directions for v in (0.0, own.max()))
        for law, own in zip(laws_of(worm), speeds, strict=True)
    )
    momentum = sum(per(worm.mass, worm.masses)) * speeds.max(axis=1).min()
    return float(2 * np.pi / worm.frequency * forces / momentum)


def trust(found: Found, table: HarmonicMassesScene, size: float) -> dict[str, Any]:
    """Trust report; `size` is the largest velocity relative to the centre."""
    orbit = found.orbits[found.chosen]
    first, second = found.first[found.chosen], found.second[found.chosen]
    exact = orbit and orbit.velocity
    return {
        "routes": {
            "first_order": first.velocity,
            "second_order": second and second.velocity,
            "closed_form": found.closed,
            "exact": exact,
            "error": difference(exact, second and second.velocity),
            "accepted": orbit and _accepted(orbit, table.worm),
        },
        "averaging": {
            "nodes": table.averaging.nodes,
            "change_by_doubled_nodes": _quadrature(found),
            "closed_form_error": difference(found.closed, first.velocity),
            "accepted": _QUADRATURE * size,
            "steady": [asdict(steady) for steady in found.first],
        },
        "smallness": {"value": smallness_of(table.worm), "small_up_to": _SMALL},
        "exact": orbit and _trust_of_orbit(orbit, found.nudged),
        "warnings": list(_warnings(found, table, size)),
    }


def _trust_of_orbit(orbit: Orbit, was_nudged: bool) -> Mapping[str, Any]:
    return {
        "route": orbit.motion.route,
        "start": orbit.start,
        "drift": orbit.drift,
        "simulations": orbit.trials,
        "events": count_events(orbit.motion),
        "recheck": orbit.second
        and {
            "route": orbit.second.route,
            "error": orbit.second.error,
            "accepted": orbit.second.accepted,
            "shared": orbit.second.shared,
        },
        "friction_changed": was_nudged,
        "mean_forces_add_up_to": float(orbit.force.sum()),
    }


def _quadrature(found: Found) -> float | None:
    """Largest change of a steady velocity on twice as many nodes; None if one comes or goes."""
    if len(found.finer) != len(found.first):
        return None
    both = zip(found.first, found.finer, strict=True)
    return max(abs(coarse.velocity - fine.velocity) for coarse, fine in both)


def _accepted(orbit: Orbit, worm: SwingingTable) -> float:
    """Error of second-order averaging that is accepted.

    It is of second order in the ripple, against the smallest swing that is to be reversed.
    """
    speeds = np.abs(relative_velocities(worm, np.linspace(0, 1, 257))).max(axis=1)
    return float(_FACTOR * orbit.ripple**2 / speeds.min() + _FLOOR * speeds.max())


def known_velocity(found: Found, table: HarmonicMassesScene, size: float) -> float | None:
    """Exact mean velocity of the chosen motion; None where it cannot be told from rest.

    That is, not above the accepted error, or above what `nudged` makes of it. `size` is the
    largest velocity relative to the centre.
    """
    orbit = found.orbits[found.chosen]
    if orbit is None:
        return None
    error = accepted_error(tolerance_of(table.tolerance)) * size
    if found.nudged:
        error = max(error, _NUDGED * NUDGE * size)
    return orbit.velocity if abs(orbit.velocity) > error else None


def faults_of(found: Found, table: HarmonicMassesScene, size: float) -> Iterator[str]:
    """Say why the result is not to be trusted.

    `size` is the largest velocity relative to the centre.
    """
    orbit, first = found.orbits[found.chosen], found.first[found.chosen]
    second, change = found.second[found.chosen], _quadrature(found)
    if change is None or not change <= _QUADRATURE * size:
        yield (
            "averages on twice as many nodes have other steady velocities"
            + ("" if change is None else f", by {change:.2g}")
            + "; write a larger averaging.nodes"
        )
    if found.closed is not None and abs(found.closed - first.velocity) > _QUADRATURE * size:
        yield f"the closed form is {found.closed:.9g} where averaging finds {first.velocity:.9g}"
    if orbit is None or found.course is None:
        yield f"the exact motion is not to be had: {found.lost}"
    if orbit is None:
        return
    if orbit.second and orbit.second.fault:
        yield orbit.second.fault
    accepted = accepted_error(tolerance_of(table.tolerance)) * size
    if first.stable and abs(orbit.drift) > accepted:
        yield f"the exact motion drifts by {orbit.drift:.2g} in ten periods"
    error = difference(orbit.velocity, second and second.velocity)
    small = smallness_of(table.worm) <= _SMALL and not orbit.rest_share
    if small and (error is None or not error <= _accepted(orbit, table.worm)):
        yield (
            "friction is small, but the exact mean velocity is not that of second-order averaging, "
            + ("which has none" if error is None else f"by {error:.2g}")
        )


def _warnings(found: Found, table: HarmonicMassesScene, size: float) -> Iterator[str]:
    orbit, smallness = found.orbits[found.chosen], smallness_of(table.worm)
    if smallness > _SMALL:
        yield (
            f"friction is not small: in a period it may change momentum by {smallness:.2g} of "
            "that of the smallest swing"
            + ("" if orbit is None else "; velocity_exact_mean holds all the same")
        )
    if orbit is None:
        return
    if orbit.rest_share:
        yield (
            f"a mass rests for {orbit.rest_share:.2g} of the period: averaging takes it to pass "
            "through 0 at once"
        )
    if found.nudged:
        yield (
            "masses reverse at the same instant; exact simulation was done with friction larger "
            "backward and smaller forward by a share of 1e-9, so that they do not"
        )
    missing = [
        f"{steady.velocity:.6g}"
        for k, steady in enumerate(found.first)
        if found.orbits[k] is None and k != found.chosen
    ]
    if missing:
        yield f"no exact motion was found at the steady velocity {', '.join(missing)}"
    if orbit.velocity and not known_velocity(found, table, size):
        yield (
            f"the exact mean velocity {orbit.velocity:.2g} is not told from rest: it is below the "
            "error that is accepted; what is over it is unknown"
        )
    if not found.first[found.chosen].stable:
        yield "the steady velocity told is not stable: the course starts on it"
    course = found.course
    if course is not None:
        left = abs(course.state("center_velocity")[0, -1] - orbit.start)
        if left > 0.01 * size:
            yield (
                f"the course has not come to the steady motion by its end, but to within "
                f"{left:.2g}; write more course.periods"
            )
    yield from warnings_of_motion(orbit.motion, orbit.second)
