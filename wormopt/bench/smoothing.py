"""How the smooth treatment of contact tends to the exact one, and what that costs."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from wormopt.bench.driven_chain import DrivenChain, Grip
from wormopt.progress import Report
from wormopt.simulation.options import Exact, Smooth
from wormopt.simulation.simulate import simulate
from wormopt.systems.spiked.construct import travelling_sine

WIDTHS = tuple(np.logspace(-1, -5, 9).tolist())
"""Widths v_reg of the smooth law."""

_END = 15.0


@dataclass(frozen=True)
class Smoothing:
    """One smooth motion beside the exact one."""

    v_reg: float  # width of the smooth law
    difference: float  # largest, of positions at any sample time
    steps: int  # of the smooth motion
    exact_steps: int
    events: int  # of the exact motion


def measure_smoothing(widths: Sequence[float], report: Report) -> Iterator[Smoothing]:
    """Simulate a chain that sticks and slips by the smooth law of several widths v_reg."""
    worm = DrivenChain(
        mass=np.ones(3),
        stiffness=np.full(2, 10.0),
        damping=np.full(2, 0.5),
        gait=travelling_sine(2, 4.0),
        grips=[Grip(1.0, 3.0)] * 3,
    )
    model, times = worm.model(), np.linspace(0.0, _END, 601)
    exact = simulate(model, _END, contact=Exact(), times=times)
    for k, width in enumerate(widths):
        report(f"smoothing: v_reg = {width:.1e}", k / len(widths))
        smooth = simulate(model, _END, contact=Smooth(width), times=times)
        apart = np.abs(smooth.state("position") - exact.state("position")).max()
        yield Smoothing(width, float(apart), smooth.n_steps, exact.n_steps, len(exact.events))


def order(found: Sequence[Smoothing]) -> float:
    """Exponent p of differences ~ v_reg^p, fitted to widths below 1e-2; NaN if fewer than two."""
    kept = [s for s in found if s.v_reg < 1e-2]
    if len(kept) < 2:
        return float("nan")
    return float(
        np.polyfit(np.log([s.v_reg for s in kept]), np.log([s.difference for s in kept]), 1)[0]
    )
