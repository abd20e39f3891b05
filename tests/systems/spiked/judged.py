"""A judge of designs that shares no code with the program, nor with `crawl`; interruptions."""

from itertools import count

import numpy as np
import pytest

from tests.benchmarks import design_cases
from tests.benchmarks.design_cases import Motion
from wormopt.numerics.bilinear import BilinearProgram
from wormopt.study.given import plain
from wormopt.systems.spiked.bimodal import integrate
from wormopt.systems.spiked.design.design import Design
from wormopt.systems.spiked.gait_problem import Worm
from wormopt.systems.spiked.limits import Limits


def motion_of(found: Design) -> Motion:
    """Velocities from link rates alone: where nothing slides back the slowest mass rests."""
    h, polynomial = np.diff(found.gait.breaks), found.gait.polynomial
    assert polynomial.shape[2] == 3  # rates are linear on each piece
    relative = np.hstack([np.zeros((len(h), 1)), -np.cumsum(polynomial[:, :, 1], axis=1)])
    velocities = relative - relative.min(axis=1, keepdims=True)
    return Motion(h, velocities, polynomial[0, :, 0])


def case_of(worm: Worm, limits: Limits) -> design_cases.Case:
    return {"name": "drawn", "worm": plain(worm), "gait": plain(limits)}


def check(found: Design, tolerance: float = 1e-8) -> None:
    """Its limits hold and its speed is what it says, by the judge and by integration."""
    worm, limits = found.task.worm, found.task.limits
    if not worm.drag:
        judged = motion_of(found)
        assert judged.worst(design_cases.Arrays.of(case_of(worm, limits))) <= tolerance
        assert judged.speed == pytest.approx(found.speed, rel=1e-9)
    again = integrate(found.gait, worm.masses, worm.drag, worm.load_range[1])
    assert again.speed == pytest.approx(found.speed, rel=1e-8)
    assert again.resting_min >= limits.resting
    assert max(found.violations.values()) <= 1e-9


def interrupt_after(monkeypatch: pytest.MonkeyPatch, climbs: int) -> None:
    """The user stops in a climb, once."""
    climb, begun = BilinearProgram.climb, count(1)

    def interrupted_once(*args):
        if next(begun) == climbs:
            raise KeyboardInterrupt
        return climb(*args)

    monkeypatch.setattr(BilinearProgram, "climb", interrupted_once)
