"""How rivals of a comparison do: on the worm as it is believed, and on plants that are not."""

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

# Plants that are not as believed are simulated less exactly: they differ by far more.
_LOOSE = Tolerance(relative=1e-8, absolute=1e-9)
_SAMPLES = 501
TOLD = tuple(JUDGED)
"""Numbers that are told of every motion."""
# What feedback that sees badly may do: errors of so many radii, and steps beyond which it is lost.
_LOST, _PATIENCE = 10.0, 100_000


@dataclass(frozen=True, eq=False)
class JudgedRun:
    """One rival on the worm as it is believed, and on the others."""

    rival: Rival
    motion: Trajectory | None  # of the worm as it is believed; None if it is lost
    second: CrossCheck | None  # its second route
    numbers: dict[str, Any]  # of `motion`
    drawn: Drawn  # of the other plants


def judge(
    table: CompareScene, rival: Rival, draws: Sequence[Draw], check: bool, report: Report
) -> JudgedRun:
    """Simulate a rival on all plants; `check` asks for a second route where that is affordable.

    Raises SolveError where the worm as believed fails though controllers see it as it is.
    """
    report(f"simulating {rival.name}", 0.7)
    model, tolerance = judged(rival.model, table.tube), tolerance_of(table.tolerance)
    looks = table.measurement is not None and not table.measurement.exact
    if looks:
        model = _given_up(model, table)
    motion = _believed(model, table, tolerance, may_fail=looks)
    # Trackers are rechecked in scenes of their own kind: their many steps take long in Python.
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
    """Motion of the worm as it is believed; None if it is lost."""
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
    """The model, whose motion ends where the error is far beyond the tube: the worm is lost."""
    error = model["error"]
    far = ca.dot(error, error) - (_LOST * table.tube.radius) ** 2
    lost = Switch("is lost", far, pack(model.x), terminal=True)
    return replace(model, switches=[*model.switches, lost])


def scenarios(
    rival: Rival, draws: Sequence[Draw], table: CompareScene
) -> Iterator[tuple[int, Scenario]]:
    """Plants by their number, each with its own noise, and inputs where the rival decides."""
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
    """Collect numbers of plants; NaN where one could not be simulated or it never happens."""

    def column(name: str) -> np.ndarray:
        values = (None if n is None else n[name] for n in numbers)
        return np.array([np.nan if v is None else v for v in values], dtype=float)

    return Drawn({name: column(name) for name in TOLD}, sum(n is None for n in numbers))


def know(
    table: CompareScene, gait: Gait, name: str, answer: Answer, draws: Sequence[Draw]
) -> Known:
    """Plans made by somebody who knows the plant, each simulated on its plant."""
    numbers: list[dict[str, Any] | None] = []
    for plan, draw in zip(answer.known, draws, strict=False):
        motion = None
        if plan is not None:
            with suppress(SolveError):  # counted as one that is not found
                motion = simulate(
                    judged(driven(table, gait, plan.inputs, periodic=plan.periodic), table.tube),
                    table.time.end,
                    p=draw,
                    times=np.linspace(0.0, table.time.end, _SAMPLES),
                    tolerance=_LOOSE,
                )
        numbers.append(None if motion is None else judged_numbers(motion, table.tube))
    return Known(name, drawn_numbers(numbers))
