"""Run scenes of kind ``magnetic-pair``: velocity of the pair from rest, exact and averaged."""

from __future__ import annotations

import time
from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from wormopt.analysis.steady import SteadyState
from wormopt.errors import SolveError
from wormopt.model.friction import Law, Stribeck, Viscous
from wormopt.model.model import Model
from wormopt.progress import Report
from wormopt.result import Check, Result
from wormopt.simulation.simulate import simulate
from wormopt.simulation.trajectory import Trajectory
from wormopt.study.conclude import conclude
from wormopt.study.scene import Scene
from wormopt.systems.pair.exact import magnetic_pair, scaled_law
from wormopt.systems.pair.runs.pair import Scales, no_steady_motion, pair_of, warnings_of_pair
from wormopt.systems.pair.scenes.magnetic_pair import MagneticPairScene
from wormopt.systems.pair.steady import Pair
from wormopt.systems.shared.proof import CrossCheck, cross_check
from wormopt.systems.shared.settings import tolerance_of

# Accepted distance of the average of first order from its steady state, and from eq. 19.
_SETTLED = 1e-9
# A motion whose consecutive mean velocities differ by a larger share has not converged.
_DRIFT = 1e-6
# Decay times of a deviation, longest time in 1 / eps, steps of the average.
_FADED, _LONGEST, _STEPS = 25.0, 2000.0, 5_000
# Periods of the field at the end that are shown in detail.
_LATE, _LATE_SAMPLES = 4, 801


@dataclass(frozen=True, eq=False)
class _Found:
    """All dimensionless results."""

    pair: Pair
    detuning: float
    states: tuple[SteadyState, ...]
    first: Trajectory
    second: Trajectory | None
    exact: Trajectory
    cross_check: CrossCheck | None
    means: tuple[float, float]

    @property
    def frequency(self) -> float:
        """Frequency of the field."""
        return self.pair.frequency(self.detuning)

    @cached_property
    def state(self) -> SteadyState:
        """The steady state to which the first average converges."""
        gaps = [np.abs(state.x - self.first.end).max() for state in self.states]
        return self.states[int(np.argmin(gaps))]

    @property
    def settled(self) -> float:
        """Distance of the end of the first average from it."""
        return float(np.abs(self.state.x - self.first.end).max())

    @cached_property
    def refined(self) -> SteadyState | None:
        """Steady state of second order."""
        return self.pair.refined(self.state)

    @cached_property
    def difference(self) -> float | None:
        """Difference of that state from eq. 19, where it applies."""
        return self.pair.closed_form_difference(self.state.x, self.detuning)


@np.errstate(all="ignore")  # values that are not finite are noticed where they matter
def run(scene: Scene[MagneticPairScene], report: Report) -> Result:
    """Simulate the pair from rest and compare with its averages.

    The result is "failed" if averages do not converge or the second route ends elsewhere. Raises
    SolveError without a steady motion, or if a motion cannot be simulated.
    """
    table, begin = scene.table, time.perf_counter()
    pair, scales = pair_of(table.pair, table.averaging.nodes), Scales.of(table.pair)
    report("averaging", 0.0)
    states = pair.steady(table.detuning)
    if not states:
        raise no_steady_motion(scene, pair.why_none(table.detuning))
    averaged = time.perf_counter()
    found = _simulated(table, pair, scales, states, report)
    simulated = time.perf_counter()
    sticks = [event.time for event in found.exact.events if event.kind == "stick"]
    late = sum(at > found.exact.end_time / 2 for at in sticks)
    return conclude(
        scene,
        _scalars(table, found, scales),
        _variables(found, scales),
        checks=_checks(found),
        facts=_facts(found, len(sticks), late),
        warnings=_warnings(table, found, late),
        timings={"average": averaged - begin, "simulate": simulated - averaged},
    )


def models_of(scene: Scene[MagneticPairScene]) -> dict[str, Model]:
    """Make the pair of eq. 16, in the scene's units; without a dashpot, its `damping` is 0."""
    table = scene.table
    scales, push = Scales.of(table.pair), table.pair.smallness
    mass = stiffness = 1.0
    if sample := table.pair.sample:
        mass, stiffness = sample.mass, sample.mass / scales.time**2
        push *= stiffness * scales.length
    pair = pair_of(table.pair, table.averaging.nodes)
    return {
        "": magnetic_pair(
            law=[_law_in_units(law, push, scales.speed) for law in pair.laws],
            push=push,
            frequency=pair.frequency(table.detuning) / scales.time,
            mass=mass,
            stiffness=stiffness,
            cosines=pair.cosines,
        )
    }


def _law_in_units(law: Law, push: float, speed: float) -> Law:
    """Friction law with forces over the push and velocities over a speed."""
    law = scaled_law(law, push)
    if isinstance(law, Viscous):
        return replace(law, drag=law.drag / speed)
    return replace(law, v_stribeck=speed * law.v_stribeck) if isinstance(law, Stribeck) else law


def _simulated(
    table: MagneticPairScene,
    pair: Pair,
    scales: Scales,
    states: tuple[SteadyState, ...],
    report: Report,
) -> _Found:
    nu = pair.frequency(table.detuning)
    tolerance = tolerance_of(table.tolerance)
    course, turn = table.course, 2 * np.pi / nu
    slowest = max(state.eigenvalues[0].real for state in states if state.stable or len(states) == 1)
    settled = max(60 / pair.eps, _FADED / max(-slowest, 1e-300), 2 * course.periods * turn)
    end = min(settled, _LONGEST / pair.eps) if course.end is None else course.end / scales.time
    times = np.linspace(0.0, end, course.samples)
    given: dict[str, Any] = {"p": {"frequency": nu}, "tolerance": tolerance}
    report("averaged motions", 0.2)
    first = _first(pair, end, times, given)
    report("exact motion", 0.4)
    exact = simulate(pair.exact, end, times=times, dense=True, report=report, **given)
    second_route = cross_check(
        pair.exact, exact, tolerance,
        p={"frequency": nu}, recheck=table.tolerance.recheck, report=report,
    )  # fmt: skip
    return _Found(
        pair,
        table.detuning,
        states,
        first,
        _second(pair, first, given),
        exact,
        second_route,
        _means(exact, end, course.periods * turn),
    )


def _first(pair: Pair, end: float, times: np.ndarray, given: dict[str, Any]) -> Trajectory:
    """Average of first order, from rest."""
    loose = replace(given["tolerance"], max_steps=_STEPS)
    try:
        return simulate(
            pair.averages[0], end, times=times, dense=True, **(given | {"tolerance": loose})
        )
    except SolveError as error:
        raise SolveError(
            f"the averaged motion cannot be simulated from rest ({error.reason}): the pair stays "
            "at rest where the friction at rest exceeds the push of the field",
            "use kind resonance to find its steady motions, or write weaker friction at rest",
            code="no_start",
        ) from None


def _second(pair: Pair, first: Trajectory, given: dict[str, Any]) -> Trajectory | None:
    """Average of second order, from where the swing of the first is large enough."""
    large = np.flatnonzero(pair.swung(first["swing"]))
    if not large.size or large[0] == len(first.time) - 1:
        return None
    k = int(large[0])
    x0 = {name: first[name][:, k] for name in ("center_velocity", "swing")}
    span = (float(first.time[k]), float(first.time[-1]))
    return simulate(pair.averages[1], span, x0=x0, times=first.time[k:], **given)


def _means(exact: Trajectory, end: float, length: float) -> tuple[float, float]:
    """Displacement over time in the last whole periods, and in as many before."""
    places = exact.at(np.array([end - 2 * length, end - length, end]))["center"][0]
    before, last = np.diff(places) / length
    return float(before), float(last)


# -- results ---------------------------------------------------------------------------------------


def _checks(found: _Found) -> Iterator[Check]:
    off = found.difference
    if off is not None:
        advice = f"the averaged model's steady state differs from eq. 19 by {off:.2g} of its size"
        yield Check("closed form (19)", off, _SETTLED, advice)
    if found.cross_check:
        yield found.cross_check.check


def _scalars(table: MagneticPairScene, found: _Found, scales: Scales) -> dict[str, Any]:
    state, exact = found.state, found.means[1]
    first, amplitude = float(state.x[0]), float(state["amplitude"][0])
    second = float(found.refined.x[0]) if found.refined else None
    scalars = {
        "eps": found.pair.eps,
        "frequency": found.frequency / scales.time,
        "velocity_steady": first,
        "amplitude_steady": amplitude,
        "phase_steady": float(state["lag"][0]),
        "velocity_steady_second": second,
        "velocity_exact_mean": exact,
        "averaging_error": abs(first - exact),
        "averaging_error_second": None if second is None else abs(second - exact),
        "stable": state.stable,
        "decay_rate": -float(state.eigenvalues[0].real) / scales.time,
        "strain_amplitude": 2 * amplitude,
    }
    if sample := table.pair.sample:
        scalars |= {
            "u0": sample.strain,
            "stiffness": sample.mass / scales.time**2,
            "natural_rate": 1 / scales.time,
            "velocity_steady_si": first * scales.speed,
            "velocity_exact_mean_si": exact * scales.speed,
        }
    if table.stated_velocity is not None:
        scalars["velocity_stated"] = table.stated_velocity
        scalars["velocity_stated_deviation"] = table.stated_velocity - first * scales.speed
    return scalars


def _variables(found: _Found, scales: Scales) -> dict[str, np.ndarray]:
    t = found.exact.time
    late = t[-1] - np.linspace(_LATE * 2 * np.pi / found.frequency, 0.0, _LATE_SAMPLES)
    close = found.exact.at(np.clip(late, 0.0, t[-1]))["center_velocity"][0]
    velocities = {
        "velocity": found.exact["center_velocity"][0],
        "velocity_period": _sliding(found),
        "velocity_first": found.first["center_velocity"][0],
        "late_velocity": close,
    }
    if found.second is not None:
        velocities["velocity_second"] = np.full(len(t), np.nan)
        begun = len(t) - len(found.second.time)
        velocities["velocity_second"][begun:] = found.second["center_velocity"][0]
    times = {"time": t * scales.time, "late_time": late * scales.time}
    return times | {name: values * scales.speed for name, values in velocities.items()}


def _sliding(found: _Found) -> np.ndarray:
    """Mean velocity over one period around every time; none close to the ends."""
    t, half = found.exact.time, np.pi / found.frequency
    inside = (t >= half) & (t <= t[-1] - half)
    values = np.full(len(t), np.nan)
    ahead, behind = (found.exact.at(t[inside] + side * half)["center"][0] for side in (1, -1))
    values[inside] = (ahead - behind) / (2 * half)
    return values


def _facts(found: _Found, rests: int, late: int) -> dict[str, Any]:
    state, refined = found.state, found.refined
    return {
        "steady_states": len(found.states),
        "steady_residual": state.residual,
        "steady_residual_second": refined.residual if refined else None,
        "settled_to": found.settled,
        "closed_form_difference": found.difference,
        "quadrature_error": found.pair.quadrature_error(state),
        "exact": {
            "route": found.exact.route,
            "events": len(found.exact.events),
            "rests": rests,
            "rests_in_second_half": late,
            "mean_before": found.means[0],
            "recheck": None if found.cross_check is None else found.cross_check.error,
            "recheck_route": "" if found.cross_check is None else found.cross_check.route,
            "recheck_shares": "" if found.cross_check is None else found.cross_check.shared,
        },
        "eigenvalues": [[value.real, value.imag] for value in state.eigenvalues],
    }


def _warnings(table: MagneticPairScene, found: _Found, late: int) -> Iterator[str]:
    yield from warnings_of_pair(found.pair, found.state)
    before, last = found.means
    if abs(last - before) > _DRIFT * max(abs(last), abs(before)):
        yield (
            f"the exact motion has not converged: its mean velocity changed from {before:.7g} to "
            f"{last:.7g}; write a later course.end"
        )
    if found.settled > _SETTLED:
        yield (
            f"the averaged motion ends {found.settled:.2g} away from the steady state; write a "
            "later course.end"
        )
    if late:
        yield (
            f"masses came to rest {late} times in the second half, but averaging assumes that they "
            "pass through 0"
        )
    if found.refined is None:
        yield "the swing is too small compared with eps for an average of second order"
    if len(found.states) > 1:
        yield (
            f"{len(found.states)} steady motions exist; from rest the pair converges to the "
            "reported one"
        )
    if table.stated_velocity is None:
        return
    scale = Scales.of(table.pair).speed
    own = float(found.state.x[0]) * scale
    if abs(table.stated_velocity - own) > 1e-2 * abs(own):
        yield (
            f"the stated velocity {table.stated_velocity:g} agrees neither with eq. 19, {own:.6g}, "
            f"nor with the exact motion, {found.means[1] * scale:.6g}"
        )
