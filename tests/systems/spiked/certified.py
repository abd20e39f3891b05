"""Bounds that several files of this folder compute."""

from fractions import Fraction
from typing import Any

import numpy as np
from hypothesis import strategies as st
from scipy.optimize import root_scalar

from wormopt.progress import silent
from wormopt.systems.spiked.certify.bound import Bounded, bounded
from wormopt.systems.spiked.gait_problem import Certify, GaitProblem, Objective, Worm
from wormopt.systems.spiked.limits import Limits, Rates

SPEED = Objective()

ANY = (0.1, 100.0)

# Best gaits of G1's worm that are known, found by independent searches.
BEST_OF_ANY_PERIOD, BEST_OF_THREE_LINKS = 0.869449, 1.28049


def g1(links: int = 2, objective: Objective = SPEED, **changed: Any) -> GaitProblem:
    worm = {name: changed.pop(name) for name in ("mass", "drag", "load") if name in changed}
    given_ = {"period": ANY, "length": (0.7, 1.3), "rate": 1.0, "acceleration": 20.0}
    return GaitProblem(Worm(links, **{"load": 5.0} | worm), Limits(**given_ | changed), objective)


def bound_of(task: GaitProblem, value: float, gap: float = 0.01, seconds: float = 600.0) -> Bounded:
    return bounded(task, value, Certify(gap, seconds), silent)


def less(number: str, share: str = "0.999") -> str:
    return str(Fraction(number) * Fraction(share))


def one_link_speed(worm: Worm, limits: Limits) -> float:
    """Largest speed of two masses that rest in turn, k = 0, one stroke in and one out.

    A mass speeds up as the link and the other's spike allow, runs at the link's rate, and slows
    down as the link and sigma allow. Both strokes have one length, in times that fill the period.
    """
    (contraction,), (extension,) = limits.rate_limits(1) or ((np.inf,), (np.inf,))
    link = np.inf if limits.acceleration is None else float(np.max(limits.acceleration))
    spike = np.inf if limits.spike_load is None else float(np.max(limits.spike_load))
    load, period = worm.load_range[0], limits.period_range[0]

    def stroke(h: float, mass: float, rate: float) -> float:
        up = min(link, (spike - 2 * load) / mass)
        down = min(link, 2 * (load - limits.sigma_margin) / mass)
        ramps = 1 / up + 1 / down
        top = min(rate, h / ramps)
        return top * h - top**2 / 2 * ramps

    def apart(h: float) -> float:
        return stroke(h, worm.masses[1], contraction) - stroke(
            period - h, worm.masses[0], extension
        )

    h = float(root_scalar(apart, bracket=(1e-9, period - 1e-9), xtol=1e-15, rtol=1e-14).root)
    way = min(stroke(h, worm.masses[1], contraction), np.ptp(limits.length_ranges(1)))
    return float(way / period)


@st.composite
def one_link_tasks(draw: st.DrawFn) -> GaitProblem:
    load, room = draw(st.floats(2.0, 20.0)), draw(st.floats(0.05, 1.5))
    spike = draw(st.none() | st.floats(1.2, 4.0))
    limits = Limits(
        period=draw(st.floats(0.5, 2.0)),
        length=(0.3, 0.3 + room),
        rate=Rates(draw(st.floats(0.3, 2.0)), draw(st.floats(0.3, 2.0))),
        acceleration=draw(st.floats(5.0, 50.0)),
        spike_load=spike and 2 * load * spike,
        sigma_margin=load * draw(st.just(0.0) | st.floats(1e-9, 0.8)),
    )
    masses = draw(st.tuples(st.floats(0.2, 3.0), st.floats(0.2, 3.0)))
    return GaitProblem(Worm(links=1, mass=masses, load=load), limits, SPEED)
