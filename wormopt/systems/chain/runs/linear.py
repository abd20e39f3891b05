"""Run scenes of kind ``linear``: linear theory of a chain and its loop with frozen gain."""

from __future__ import annotations

import time
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any

import casadi as ca
import numpy as np

from wormopt.analysis.frequencies import frequencies
from wormopt.analysis.linearise import LinearModel, linearise
from wormopt.analysis.normal_form import normal_form
from wormopt.control.frozen import Complex, FrozenLoop, Margins
from wormopt.control.lambda_tracker import Feedback
from wormopt.control.reference import gait_reference
from wormopt.control.tube_gain import Task, least_gain, static_gains
from wormopt.errors import Interrupted, SceneError, SolveError
from wormopt.model.friction import Law
from wormopt.model.gait import Gait
from wormopt.model.model import Model
from wormopt.progress import Report
from wormopt.result import NOT_RECHECKED, Check, Result
from wormopt.simulation.options import Exact
from wormopt.study.conclude import conclude
from wormopt.study.scene import Scene
from wormopt.study.types import per
from wormopt.systems.chain.frozen import (
    Frozen,
    bisect,
    settled,
    task_of,
    without_dry_friction,
)
from wormopt.systems.chain.loops import (
    chain_for,
    close_loop,
    draw_links,
    laws_of,
)
from wormopt.systems.chain.scenes.linear import LinearScene
from wormopt.systems.chain.tables import FilterTracker
from wormopt.systems.chain.tracked import Tracked, watched
from wormopt.systems.shared.proof import CrossCheck, cross_check, warnings_of_contact
from wormopt.systems.shared.settings import tolerance_of, treatment_of
from wormopt.systems.shared.signals import simulate_whole
from wormopt.systems.spiked import gait_of_shape

_STEPS = 15  # simulations of the bisection, about
_LONGEST = 2000  # periods after which a start must be forgotten, to be simulated so long
_AGREED = 1e-6  # poles and disk margins by two routes
_HARMONICS = 1e-3  # errors by harmonics and by simulation: kinks of the reference, samples


@dataclass(frozen=True, eq=False)
class Worm:
    """Worm and tracker of a scene."""

    plant: Model
    laws: list[Law]
    gait: Gait
    shift: float
    task: Task
    feedback: Feedback

    def error(self, gain: float) -> float:
        """Largest error of the frozen loop without dry friction."""
        return self.task.error(FrozenLoop(self.task.plant, gain, self.feedback))

    def bound(self, gain: float) -> float:
        """Bound of the error with dry friction."""
        return self.task.bound(FrozenLoop(self.task.plant, gain, self.feedback))


def run(scene: Scene[LinearScene], report: Report) -> Result:
    """Analyse the worm and its frozen loops, and simulate the tracker.

    The result is "failed" if routes disagree. Raises SceneError for a gait file or a motion that is
    too short, SolveError if a motion stops early, and Interrupted; the last two with an empty
    Result.
    """
    try:
        return _result(scene, report)
    except SolveError as error:
        nothing = conclude(scene, {}).failed(error.reason)
        raise SolveError(error.reason, error.suggestion, nothing, error.code) from None
    except Interrupted:
        raise Interrupted(conclude(scene, {}).failed("interrupted")) from None


def _result(scene: Scene[LinearScene], report: Report) -> Result:
    table, clock = scene.table, time.perf_counter()
    worm = _worm(scene)
    point = linearise(
        worm.plant, output="length", x={"velocity": np.array(table.point.velocity)},
        v_reg=table.point.v_reg,
    )  # fmt: skip
    motion, second = _learn(scene, worm, report)
    learned = float(motion["k_end"])
    simulated = time.perf_counter()
    loops = _loops(scene, worm)
    margins = [loop.margins() for loop in loops]
    analysed = time.perf_counter()
    frozen = Frozen.of(
        worm.plant, gait_reference(worm.gait, worm.plant.t, shift=worm.shift),
        table.tracker, table.worm, worm.gait.period,
    )  # fmt: skip
    numbers, arrays = _gains(scene, worm, frozen, loops, learned, report)
    loop = FrozenLoop(worm.task.plant, learned, worm.feedback)
    timings = {
        "simulate": simulated - clock,
        "analyse": analysed - simulated,
        "bisect": time.perf_counter() - analysed,
    }
    own = loop.margins()
    return conclude(
        scene,
        {
            "gain_learned": learned,
            **numbers,
            "capture_time": motion["capture_time"],
            "tube_radius": table.tracker.tube_radius,
            **_structure(worm.plant, point),
            "pole_slowest": float(loop.poles.real.max()),
            "gain_margin": _finite(own.gain),
            "phase_margin": own.phase,
            "disk_margin": own.disk,
            "sensitivity_peak": _finite(own.peak),
        },
        {**_of_point(point), **_of_loops(loops, margins, loop), **arrays},
        checks=_checks(scene, worm, loop, own, numbers, second),
        warnings=_warnings(scene, worm, numbers, motion, second),
        timings=timings,
        facts={
            "hidden": "the position of the worm is a shift, which is no pole or zero of the loop"
        },
    )


def _worm(scene: Scene[LinearScene]) -> Worm:
    table = scene.table
    gait = gait_of_shape(table.reference.gait, scene, "reference.gait")
    if table.time.end < 2 * gait.period:
        fault = f"is less than two periods of the reference, {2 * gait.period:g}; write more"
        raise SceneError(scene.name, [("time.end", fault)])
    plant = chain_for(table.worm, table.start, draw_links(table.worm, table.time.end), gait)
    laws = laws_of(table.worm)
    shift = table.reference.shift % gait.period
    rest = np.array(per(table.worm.rest_length, table.worm.links))
    feedback: Feedback = "filter" if isinstance(table.tracker, FilterTracker) else "derivative"
    return Worm(plant, laws, gait, shift, task_of(plant, laws, gait, shift, rest), feedback)


def _learn(
    scene: Scene[LinearScene], worm: Worm, report: Report
) -> tuple[dict[str, Any], CrossCheck | None]:
    """Results of the adaptive motion and of its second route."""
    table = scene.table
    reference = gait_reference(worm.gait, worm.plant.t, shift=worm.shift)
    loop = close_loop(worm.plant, reference, table.tracker, table.worm)
    tolerance, contact = tolerance_of(table.tolerance), treatment_of(table.contact)
    motion = simulate_whole(
        watched(loop, table.tracker), table.time.end, table.time.samples, contact, tolerance, report
    )
    recheck = table.tolerance.recheck
    second = cross_check(loop, motion, tolerance, recheck=recheck, report=report)
    return Tracked("tracker", table.tracker, loop, motion).numbers, second


def _loops(scene: Scene[LinearScene], worm: Worm) -> list[FrozenLoop]:
    gains = scene.table.gains
    return [
        FrozenLoop(worm.task.plant, float(gain), worm.feedback)
        for gain in np.geomspace(gains.least, gains.most, gains.count)
    ]


def _gains(
    scene: Scene[LinearScene], worm: Worm, frozen: Frozen, loops: list[FrozenLoop],
    learned: float, report: Report,
) -> tuple[dict[str, Any], dict[str, Any]]:  # fmt: skip
    """Sufficient gains, the errors that determine them, and both over the gain."""
    table, radius = scene.table, scene.table.tracker.tube_radius
    contact, tolerance = treatment_of(table.contact), tolerance_of(table.tolerance)
    tried: list[float] = []

    def simulated(gain: float) -> float:
        tried.append(gain)
        report(f"simulating with the gain {gain:.4g}", min(1.0, len(tried) / _STEPS))
        return frozen.error(gain, table.time.end, contact, tolerance)

    grid = np.array([loop.gain for loop in loops])
    needed, trials = bisect(simulated, table.gains.least, table.gains.most, radius, learned)
    trials.sort()
    numbers = {
        "gain_linear": least_gain(worm.error, grid, radius),
        "gain_sure": least_gain(worm.bound, grid, radius),
        "gain_simulated": needed,
        "error_learned": simulated(learned),
        "error_sure": _finite(worm.bound(learned)),
    }
    return numbers, {
        "error_linear": _numbers([worm.task.error(loop) for loop in loops]),
        "error_bound": _numbers([worm.task.bound(loop) for loop in loops]),
        "tried_gain": np.array([gain for gain, _ in trials]),
        "tried_error": np.array([error for _, error in trials]),
    }


# -- checks and warnings ---------------------------------------------------------------------------


def _finite(value: float) -> float | None:
    return float(value) if np.isfinite(value) else None


def _numbers(values: list[float]) -> np.ndarray:
    found = np.array(values, dtype=float)
    return np.where(np.isfinite(found), found, np.nan)


def _structure(plant: Model, point: LinearModel) -> dict[str, Any]:
    """Conditions of a high-gain tracker."""
    gain = normal_form(plant, output="length").gain_at()
    mass = np.mean(np.asarray(next(s.value for s in plant.p if s.name == "mass"), dtype=float))
    return {
        "common_zero": float(_apart(point.zeros, point.shifts).real.max()),
        "minimum_phase": int(point.minimum_phase),
        "gain_definite": float(mass * np.linalg.eigvalsh((gain + gain.T) / 2)[0]),
    }


def _apart(roots: Complex, shifts: int) -> Complex:
    """Poles or zeros without the exact zeros of shifts."""
    return np.delete(roots, np.flatnonzero(roots == 0)[:shifts]).astype(np.complex128)


def _of_point(point: LinearModel) -> dict[str, Any]:
    poles, zeros = (_apart(roots, point.shifts) for roots in (point.poles, point.zeros))
    omega = frequencies(point)
    response = point.frequency_response(omega)
    return {
        "omega": omega,
        "magnitude": np.abs(response),
        "phase": np.unwrap(np.angle(response), axis=-1),
        "zero_real": zeros.real,
        "zero_imag": zeros.imag,
        "pole_real": poles.real,
        "pole_imag": poles.imag,
    }


def _of_loops(
    loops: list[FrozenLoop], margins: list[Margins], learned: FrozenLoop
) -> dict[str, Any]:
    poles = np.array([loop.poles for loop in loops], dtype=np.complex128)
    own = learned.poles
    return {
        "gain": np.array([loop.gain for loop in loops]),
        "loop_real": poles.real,
        "loop_imag": poles.imag,
        "learned_real": own.real,
        "learned_imag": own.imag,
        "gain_margins": _numbers([each.gain for each in margins]),
        "phase_margins": _numbers([each.phase for each in margins]),
        "disk_margins": _numbers([each.disk for each in margins]),
        "sensitivity_peaks": _numbers([each.peak for each in margins]),
    }


# -- trust ---------------------------------------------------------------------------------------


def _checks(
    scene: Scene[LinearScene], worm: Worm, loop: FrozenLoop, own: Margins,
    numbers: dict[str, Any], second: CrossCheck | None,
) -> Iterator[Check]:  # fmt: skip
    if second:
        yield second.check
    poles, disk = loop.by_control()
    size = np.abs(loop.poles).max()
    yield _agree("poles by python-control", _apart_by(loop.poles, poles) / size, _AGREED)
    again = _apart_by(loop.poles, _again(scene, worm, loop)) / size
    yield _agree("poles of the Model's closed loop", again, _AGREED)
    if loop.stable:
        yield _agree("disk margin by python-control", own.disk / disk - 1, _HARMONICS)
        yield _agree("static gains of the impulse responses", _static(loop), _HARMONICS)
        if _settled(worm, loop) <= _LONGEST * worm.gait.period:
            yield _agree("error by simulation without dry friction",
                         _by_simulation(scene, worm, loop), _HARMONICS)  # fmt: skip
    if numbers["error_sure"] is not None and isinstance(treatment_of(scene.table.contact), Exact):
        share = numbers["error_learned"] / numbers["error_sure"]
        advice = "the error with frozen gain exceeds its bound; write a larger time.end"
        yield Check("error against its bound", share, 1.0, advice)


def _agree(what: str, difference: float, limit: float) -> Check:
    return Check(what, float(difference), limit, f"{what}: both routes differ by {difference:.2g}")


def _apart_by(ours: np.ndarray, theirs: np.ndarray) -> float:
    """Largest distance of one of our poles from the nearest of theirs."""
    return float(np.abs(ours[:, None] - theirs).min(axis=1).max())


def _free(scene: Scene[LinearScene], worm: Worm) -> Frozen:
    """The frozen loop around the worm without dry friction."""
    table, free = scene.table, without_dry_friction(worm.plant, worm.laws)
    dry = [s.symbol for s in free.u if s.name == "ground"]
    if dry:
        at_rest = ca.substitute(free.ode, dry[0], ca.SX.zeros(dry[0].numel()))
        free = replace(free, ode=at_rest, u=free.u[:-1])
    reference = gait_reference(worm.gait, free.t, shift=worm.shift)
    return Frozen.of(free, reference, table.tracker, table.worm, worm.gait.period)


def _again(scene: Scene[LinearScene], worm: Worm, loop: FrozenLoop) -> np.ndarray:
    """Poles of the linearised Model of the closed loop."""
    model = _free(scene, worm).loop
    return linearise(model, output="length", x={"gain": loop.gain}).poles


def _static(loop: FrozenLoop) -> float:
    """Relative difference between integrals of impulse responses and their closed form."""
    found, known = static_gains(loop)
    return float(np.abs(found - known).max() / np.abs(known).max())


def _settled(worm: Worm, loop: FrozenLoop) -> float:
    return settled(float(loop.poles.real.max()), worm.gait.period)


def _by_simulation(scene: Scene[LinearScene], worm: Worm, loop: FrozenLoop) -> float:
    """Relative difference between the error by harmonics and by a simulated motion."""
    simulated = _free(scene, worm).error(
        loop.gain, _settled(worm, loop), Exact(), tolerance_of(scene.table.tolerance)
    )
    return worm.task.error(loop) / simulated - 1


def _warnings(
    scene: Scene[LinearScene], worm: Worm, numbers: dict[str, Any], motion: dict[str, Any],
    second: CrossCheck | None,
) -> Iterator[str]:  # fmt: skip
    if second is None:
        yield NOT_RECHECKED
    yield from warnings_of_contact(treatment_of(scene.table.contact), worm.laws)
    most = scene.table.gains.most
    for name in ("gain_linear", "gain_simulated"):
        if numbers[name] is None:
            yield f"{name}: no gain up to {most:g} suffices; write a larger gains.most"
    loop = FrozenLoop(worm.task.plant, float(motion["k_end"]), worm.feedback)
    if not loop.stable:
        yield (
            f"at gain_learned = {loop.gain:.4g} the linear loop is unstable; its margins are "
            "reported as 0"
        )
    if loop.stable and _settled(worm, loop) > _LONGEST * worm.gait.period:
        yield "the motion decays too slowly to recheck gain_linear by simulation"
    if motion["capture_time"] is None:
        yield "the adaptive motion ends outside the tube; its gain may still grow"
