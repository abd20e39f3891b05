"""A driven chain that sticks and slips: the smooth law of several widths beside the exact one."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from tests.benchmarks.ladder import Run, Task, Way
from tests.benchmarks.run import OWN
from tests.oracles.driven_chain import DrivenChain, Grip, linear_flow
from wormopt.simulation.options import Exact, Smooth, Treatment
from wormopt.simulation.simulate import simulate
from wormopt.systems.spiked.construct import travelling_sine

_WIDTHS = tuple(np.logspace(-1, -5, 9).tolist())  # v_reg
_TIMES = np.linspace(0.0, 15.0, 601)


def task(_name: str, quick: bool) -> Task:
    """Positions over time; `quick`: widths down to 3e-4."""
    known = linear_flow(_chain(), _TIMES[-1], _TIMES[1:]).states
    return Task(
        "a chain that sticks and slips, by the smooth law of width v_reg",
        "closed form between events",
        "positions",
        "v_reg",
        1e-3,
        known[: len(known) // 2],
        [
            Way(OWN, lambda: _follow(lambda _: Exact()), (0.0,)),
            Way(f"{OWN}, smooth", lambda: _follow(Smooth), _WIDTHS[: 6 if quick else None]),
        ],
    )


def _chain() -> DrivenChain:
    gait, grip = travelling_sine(2, 4.0), Grip(1.0, 3.0)
    return DrivenChain.alike(gait, grip, stiffness=10.0, damping=0.5)


def _follow(law: Callable[[float], Treatment]) -> Run:
    model = _chain().model()

    def run(width: float) -> np.ndarray:
        motion = simulate(model, _TIMES[-1], contact=law(width), times=_TIMES[1:])
        return motion["position"]

    return run
