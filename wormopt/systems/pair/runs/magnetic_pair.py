"""Scenes of kind ``magnetic-pair``: velocity of the pair from rest on, exactly and on average."""

from __future__ import annotations

import time
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from wormopt.analysis.steady import SteadyState
from wormopt.errors import SolveError
from wormopt.progress import Report
from wormopt.quantities import Scalar, Variable, unit_of
from wormopt.result import Result
from wormopt.scene.scene import Scene
from wormopt.simulation.simulate import simulate
from wormopt.simulation.trajectory import Trajectory
from wormopt.systems.chain.runs.chains import tolerance_of
from wormopt.systems.pair.runs.pair import Pair, Scales, no_steady_motion, warnings_of_pair
from wormopt.systems.pair.scenes.magnetic_pair import MagneticPairScene
from wormopt.systems.shared.proof import Recheck, recheck

# The average of first order shall settle, and agree with (19), to this.
_SETTLED = 1e-9
# Velocities of consecutive means that differ by more, of their size, have not settled.
_DRIFT = 1e-6
# Times of 1/e after which a deviation has faded, longest time in 1 / eps, steps of the average.
_FADED, _LONGEST, _STEPS = 25.0, 2000.0, 20_000
# Periods of the field at the end that are shown closely.
_LATE, _LATE_SAMPLES = 4, 801


@dataclass(frozen=True, eq=False)
class _Found:
    """All that was computed, dimensionless."""

    pair: Pair
    frequency: float
    states: tuple[SteadyState, ...]
    first: Trajectory
    second: Trajectory | None
    exact: Trajectory
    recheck: Recheck | None
    means: tuple[float, float]

    @property
    def state(self) -> SteadyState:
        """The steady state to which the first average settles."""
        gaps = [np.abs(state.x - self.first.end).max() for state in self.states]
        return self.states[int(np.argmin(gaps))]

    @property
    def settled(self) -> float:
        """How far from it the first average ends."""
        return float(np.abs(self.state.x - self.first.end).max())

    @property
    def refined(self) -> SteadyState | None:
        """The same of second order."""
        return self.pair.refined(self.state)


@np.errstate(all="ignore")  # what is not finite is noticed where it matters
def run(scene: Scene[MagneticPairScene], report: Report) -> Result:
    """Simulate the pair from rest and compare with its averages.

    Status "failed" where averages do not settle or the second route ends elsewhere. Raises
    SolveError without a steady motion, or where a motion cannot be followed.
    """
    table, begin = scene.table, time.perf_counter()
    pair, scales = Pair(table.pair, table.averaging.nodes), Scales.of(table.pair)
    report("averaging", 0.0)
    states = pair.steady(table.detuning)
    if not states:
        raise no_steady_motion(scene, pair.why_none(table.detuning))
    averaged = time.perf_counter()
    found = _simulated(table, pair, scales, states, report)
    simulated = time.perf_counter()
    faults = [*_faults(table, found)]
    return Result(
        scene=scene.name,
        kind=table.kind,
        title=scene.title,
        status="failed" if faults else "ok",
        reason="; ".join(faults),
        scalars=_scalars(table, found, scales),
        variables=(*_variables(table, found, scales),),
        trust=_trust(table, found),
        timings_s={"average": averaged - begin, "simulate": simulated - averaged},
        scene_text=scene.text,
    )


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
    second_route = None
    if table.tolerance.recheck:
        second_route = recheck(pair.exact, exact, tolerance, p={"frequency": nu}, report=report)
    return _Found(
        pair,
        nu,
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
            f"the averaged motion cannot be followed from rest ({error.reason}): where friction at "
            "rest is more than the field gives, the pair does not leave it",
            "look for its steady motions with kind resonance, or write weaker friction at rest",
            code="no_start",
        ) from None


def _second(pair: Pair, first: Trajectory, given: dict[str, Any]) -> Trajectory | None:
    """Average of second order, from where the first has swung up enough for it."""
    large = np.flatnonzero(pair.swung(first.state("swing")))
    if not large.size or large[0] == len(first.time) - 1:
        return None
    k = int(large[0])
    x0 = {name: first.state(name)[:, k] for name in ("center_velocity", "swing")}
    span = (float(first.time[k]), float(first.time[-1]))
    return simulate(pair.averages[1], span, x0=x0, times=first.time[k:], **given)


def _means(exact: Trajectory, end: float, length: float) -> tuple[float, float]:
    """Displacement over time in the last whole periods, and in as many before."""
    places = exact.at(np.array([end - 2 * length, end - length, end])).output("center")[0]
    before, last = np.diff(places) / length
    return float(before), float(last)


# -- what is told ----------------------------------------------------------------------------------


def _faults(table: MagneticPairScene, found: _Found) -> Iterator[str]:
    difference = found.pair.closed_form_difference(found.state.x, table.detuning)
    if difference is not None and difference > _SETTLED:
        yield f"the averaged model's steady state differs from (19) by {difference:.2g} of its size"
    if found.recheck and found.recheck.fault:
        yield found.recheck.fault


def _scalars(table: MagneticPairScene, found: _Found, scales: Scales) -> dict[str, Scalar]:
    state, refined, exact = found.state, found.refined, found.means[1]
    first = float(state.x[0])
    second = float(refined.x[0]) if refined else None
    scalars = {
        "eps": Scalar(found.pair.eps),
        "frequency": Scalar(
            found.frequency / scales.time, unit_of("angular_frequency", table.units)
        ),
        "velocity_steady": Scalar(first),
        "amplitude_steady": Scalar(float(state.output("amplitude")[0])),
        "phase_steady": Scalar(float(state.output("lag")[0]), "rad"),
        "velocity_steady_second": Scalar(second),
        "velocity_exact_mean": Scalar(exact),
        "averaging_error": Scalar(abs(first - exact)),
        "averaging_error_second": Scalar(None if second is None else abs(second - exact)),
        "stable": Scalar(state.stable),
        "decay_rate": Scalar(-float(state.eigenvalues[0].real) / scales.time,
                             unit_of("rate", table.units)),
        "strain_amplitude": Scalar(2 * float(state.output("amplitude")[0])),
    }  # fmt: skip
    if table.pair.sample is not None:
        speed = unit_of("speed", table.units)
        scalars |= {
            "u0": Scalar(table.pair.sample.strain),
            "stiffness": Scalar(
                table.pair.sample.mass / scales.time**2, unit_of("stiffness", table.units)
            ),
            "natural_rate": Scalar(1 / scales.time, unit_of("angular_frequency", table.units)),
            "velocity_steady_si": Scalar(first * scales.speed, speed),
            "velocity_exact_mean_si": Scalar(exact * scales.speed, speed),
        }
    if table.stated_velocity is not None:
        unit = unit_of("speed", table.units)
        scalars["velocity_stated"] = Scalar(table.stated_velocity, unit)
        scalars["velocity_stated_deviation"] = Scalar(
            table.stated_velocity - first * scales.speed, unit
        )
    return scalars


def _variables(table: MagneticPairScene, found: _Found, scales: Scales) -> Iterator[Variable]:
    t, speed = found.exact.time, unit_of("speed", table.units)

    def of(name: str, values: np.ndarray, what: str) -> Variable:
        return Variable(name, speed, ("time",), values * scales.speed, what)

    yield Variable("time", unit_of("time", table.units), ("time",), t * scales.time, "time")
    yield of("velocity", found.exact.output("center_velocity")[0], "velocity of the centre, exact")
    yield of("velocity_period", _sliding(found), "its mean over a period of the field")
    yield of("velocity_first", found.first.state("center_velocity")[0], "average, first order")
    late = t[-1] - np.linspace(_LATE * 2 * np.pi / found.frequency, 0.0, _LATE_SAMPLES)
    close = found.exact.at(np.clip(late, 0.0, t[-1])).output("center_velocity")[0]
    unit = unit_of("time", table.units)
    yield Variable("late_time", unit, ("late",), late * scales.time, "time in the last periods")
    yield Variable(
        "late_velocity", speed, ("late",), close * scales.speed, "velocity of the centre, exact"
    )
    if found.second is not None:
        late = np.full(len(t), np.nan)
        late[len(t) - len(found.second.time) :] = found.second.state("center_velocity")[0]
        yield of("velocity_second", late, "average, second order")


def _sliding(found: _Found) -> np.ndarray:
    """Mean velocity over one period around every time; nearer to the ends, none."""
    t, half = found.exact.time, np.pi / found.frequency
    inside = (t >= half) & (t <= t[-1] - half)
    values = np.full(len(t), np.nan)
    ahead, behind = (
        found.exact.at(t[inside] + side * half).output("center")[0] for side in (1, -1)
    )
    values[inside] = (ahead - behind) / (2 * half)
    return values


def _trust(table: MagneticPairScene, found: _Found) -> dict[str, Any]:
    state, refined = found.state, found.refined
    sticks = [event.time for event in found.exact.events if event.kind == "stick"]
    late = sum(time > found.exact.end_time / 2 for time in sticks)
    return {
        "steady_states": len(found.states),
        "steady_residual": state.residual,
        "steady_residual_second": refined.residual if refined else None,
        "settled_to": found.settled,
        "closed_form_difference": found.pair.closed_form_difference(state.x, table.detuning),
        "quadrature_error": found.pair.quadrature_error(state),
        "exact": {
            "route": found.exact.route,
            "events": len(found.exact.events),
            "rests": len(sticks),
            "rests_in_second_half": late,
            "mean_before": found.means[0],
            "recheck": None if found.recheck is None else found.recheck.error,
            "recheck_route": "" if found.recheck is None else found.recheck.route,
            "recheck_shares": "" if found.recheck is None else found.recheck.shared,
        },
        "eigenvalues": [[value.real, value.imag] for value in state.eigenvalues],
        "warnings": [*_warnings(table, found, late)],
    }


def _warnings(table: MagneticPairScene, found: _Found, late: int) -> Iterator[str]:
    yield from warnings_of_pair(found.pair, found.state)
    before, last = found.means
    if abs(last - before) > _DRIFT * max(abs(last), abs(before)):
        yield (
            f"the exact motion has not settled: its mean velocity went from {before:.7g} to "
            f"{last:.7g}; write a later course.end"
        )
    if found.settled > _SETTLED:
        yield (
            f"the averaged motion ends {found.settled:.2g} from the steady state given; write a "
            "later course.end"
        )
    if late:
        yield (
            f"masses came to rest {late} times in the second half: averaging assumes that they "
            "pass through 0"
        )
    if found.refined is None:
        yield "the swing is too small against eps for an average of second order"
    if len(found.states) > 1:
        yield f"{len(found.states)} steady motions: from rest it settles on the one given"
    if table.stated_velocity is None:
        return
    scale = Scales.of(table.pair).speed
    own = float(found.state.x[0]) * scale
    if abs(table.stated_velocity - own) > 1e-2 * abs(own):
        yield (
            f"the stated velocity {table.stated_velocity:g} is not that of (19), {own:.6g}, nor "
            f"that of the exact motion, {found.means[1] * scale:.6g}"
        )
