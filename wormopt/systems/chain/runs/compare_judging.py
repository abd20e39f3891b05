"""Evaluate the controllers of a comparison on the nominal plant and on drawn plants."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import Any

import casadi as ca
import numpy as np

from wormopt.control.reference import gait_reference
from wormopt.control.sensing import NOISE
from wormopt.errors import SolveError
from wormopt.model.gait import Gait
from wormopt.model.model import Model, Switch, pack
from wormopt.progress import Report, silent
from wormopt.simulation.ensemble import Scenario, simulate_ensemble
from wormopt.simulation.options import Exact, Tolerance
from wormopt.simulation.simulate import simulate
from wormopt.simulation.trajectory import Trajectory
from wormopt.systems.chain.copies import Draw
from wormopt.systems.chain.measured import judged, judged_numbers
from wormopt.systems.chain.rivals import Answer, Rival, driven, noise_of
from wormopt.systems.chain.runs.compare_tables import Drawn, Known
from wormopt.systems.chain.scenes.compare_tracking import CompareScene
from wormopt.systems.shared.declared import JUDGED
from wormopt.systems.shared.proof import CrossCheck, cross_check
from wormopt.systems.shared.settings import tolerance_of
from wormopt.systems.shared.signals import simulate_whole

# Drawn plants are simulated less exactly, since they differ by far more.
_LOOSE = Tolerance(relative=1e-8, absolute=1e-9)
_SAMPLES = 501
TOLD = tuple(JUDGED)
"""Quantities that are reported of every motion."""
# Limits with poor measurements: error in tube radii, and number of steps, beyond which a plant is
# lost.
_LOST, _PATIENCE = 10.0, 100_000


@dataclass(frozen=True, eq=False)
class JudgedRun:
    """One controller on the nominal plant and on the others."""

    rival: Rival
    motion: Trajectory | None  # of the worm as it is believed; None if it is lost
    second: CrossCheck | None  # its second route
    numbers: dict[str, Any]  # of `motion`
    drawn: Drawn  # of the other plants


def judge(
    table: CompareScene, rival: Rival, draws: Sequence[Draw], check: bool, report: Report
) -> JudgedRun:
    """Simulate a controller on all plants; `check` requests a second route where affordable.

    Raises SolveError if the nominal motion fails although measurements are exact.
    """
    report(f"simulating {rival.name}", 0.7)
    model, tolerance = judged(rival.model, table.tube), tolerance_of(table.tolerance)
    looks = table.measurement is not None and not table.measurement.exact
    if looks:
        model = _given_up(model, table)
    motion = _believed(model, table, tolerance, may_fail=looks)
    # Scenes of kind "track" recheck trackers: their many steps take long in Python.
    check &= not rival.model.delays and not any(s.name == "gain" for s in rival.model.x)
    recheck = check and table.tolerance.recheck
    second = motion and cross_check(model, motion, tolerance, recheck=recheck, report=silent)
    members = dict(scenarios(rival, draws, table))
    ensemble = simulate_ensemble(
        model,
        table.time.end,
        list(members.values()),
        times=np.linspace(0.0, table.time.end, _SAMPLES),
        tolerance=replace(_LOOSE, max_steps=_PATIENCE) if looks else _LOOSE,
    )
    numbers: list[dict[str, Any] | None] = [None] * len(draws)
    for k, each, code in zip(members, ensemble.motions, ensemble.codes, strict=True):
        if not code and each.end_time == table.time.end:
            numbers[k] = judged_numbers(each, table.tube)
    own = dict.fromkeys(TOLD) if motion is None else judged_numbers(motion, table.tube)
    return JudgedRun(rival, motion, second, own, drawn_numbers(numbers))


def _believed(
    model: Model, table: CompareScene, tolerance: Tolerance, *, may_fail: bool
) -> Trajectory | None:
    """Motion of the nominal plant; None if it is lost."""
    try:
        motion = simulate_whole(
            model, table.time.end, table.time.samples, Exact(), tolerance, silent
        )
    except SolveError:
        if not may_fail:
            raise
        return None
    return motion if motion.end_time == table.time.end else None


def _given_up(model: Model, table: CompareScene) -> Model:
    """The model, with an event that ends its motion where the error is far outside the tube."""
    error = model["error"]
    far = ca.dot(error, error) - (_LOST * table.tube.radius) ** 2
    lost = Switch("is lost", far, pack(model.x), terminal=True)
    return replace(model, switches=[*model.switches, lost])


def scenarios(
    rival: Rival, draws: Sequence[Draw], table: CompareScene
) -> Iterator[tuple[int, Scenario]]:
    """Plants by number, each with its own noise and with the inputs of a deciding controller."""
    noisy = any(schedule.name == NOISE for schedule in rival.model.schedules)
    for k, draw in enumerate(draws):
        if noisy:
            course = noise_of(table, k + 1)
            (own,) = gait_reference(course, rival.model.t, periodic=False).schedules
            yield k, Scenario(p=draw, schedules={NOISE: own.values})
        elif rival.others is None:
            yield k, Scenario(p=draw)
        elif (course := rival.others[k]) is not None:
            (own,) = gait_reference(course, rival.model.t, periodic=False, name="input").schedules
            yield k, Scenario(p=draw, schedules={"input": own.values})


def drawn_numbers(numbers: Sequence[dict[str, Any] | None]) -> Drawn:
    """Collect quantities of plants; NaN where a simulation failed or an event never happens."""

    def column(name: str) -> np.ndarray:
        values = (None if n is None else n[name] for n in numbers)
        return np.array([np.nan if v is None else v for v in values], dtype=float)

    return Drawn({name: column(name) for name in TOLD}, sum(n is None for n in numbers))


def know(
    table: CompareScene, gait: Gait, name: str, answer: Answer, draws: Sequence[Draw]
) -> Known:
    """Make plans with the true parameters, and simulate each on its plant."""
    numbers: list[dict[str, Any] | None] = []
    for plan, draw in zip(answer.known, draws, strict=False):
        motion = None
        if plan is not None:
            with suppress(SolveError):  # Counted as a plan that was not found.
                motion = simulate(
                    judged(driven(table, gait, plan.inputs, periodic=plan.periodic), table.tube),
                    table.time.end,
                    p=draw,
                    times=np.linspace(0.0, table.time.end, _SAMPLES),
                    tolerance=_LOOSE,
                )
        numbers.append(None if motion is None else judged_numbers(motion, table.tube))
    return Known(name, drawn_numbers(numbers))
