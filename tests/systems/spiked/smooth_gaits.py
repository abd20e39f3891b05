"""Smooth gaits drawn at random, a load that holds them, and glides of gait (15) by hand."""

import math
from collections.abc import Callable, Sequence

import numpy as np
from hypothesis import strategies as st
from scipy.optimize import root_scalar

from wormopt.model.gait import Gait


def hermite_gait(widths: Sequence[float], values: np.ndarray, slopes: np.ndarray) -> Gait:
    """Periodic C1 cubics through given lengths and rates, shape (pieces, n) each."""
    h = np.array(widths)[:, None]
    d, e = slopes, np.roll(slopes, -1, axis=0)
    rise = np.roll(values, -1, axis=0) - values
    cubic = np.stack(
        [values, d, (3 * rise / h - 2 * d - e) / h, (d + e - 2 * rise / h) / h**2], axis=2
    )
    return Gait(np.concatenate([[0.0], np.cumsum(widths)]), cubic)


@st.composite
def smooth_gaits(draw: st.DrawFn, max_links: int = 4) -> Gait:
    """Random periodic C1 piecewise cubics."""
    links, pieces = draw(st.integers(1, max_links)), draw(st.integers(2, 4))
    widths = draw(st.lists(st.floats(0.2, 1.0), min_size=pieces, max_size=pieces))
    random = np.random.default_rng(draw(st.integers(0, 10**6)))
    shape = (pieces, links)
    return hermite_gait(widths, random.uniform(0.7, 1.3, shape), random.uniform(-1, 1, shape))


def safe_load(gait: Gait, mass: Sequence[float]) -> float:
    """A load that holds any gait in mode 2: |mean of m_i v_i'| <= mean mass * sum_j |l_j''|."""
    widths = np.diff(gait.breaks)
    ends = [gait.on_piece(q, np.array([0.0, h]), 2) for q, h in enumerate(widths)]
    return max(float(np.abs(e).sum(axis=0).max()) for e in ends) * float(np.mean(mass))


def glide_by_hand(drag: float, load: float) -> tuple[float, float, float]:
    """Start, end and gained way of the first glide of gait (15), masses 1.

    Free of the spikes, the centre of mass obeys W' + k W + Gamma = 0 from the instant at which
    sigma vanishes until W falls on W0 of the next third.
    """
    top, omega, drift = 0.6 * math.pi, 3 * math.pi, load / drag

    def root(function: Callable[[float], float], a: float, b: float) -> float:
        return float(root_scalar(function, bracket=(a, b), method="brentq", xtol=1e-16).root)

    def sigma(t: float) -> float:
        return top * (omega * math.cos(omega * t) + drag * math.sin(omega * t)) + load

    start = root(sigma, 1 / 6, 1 / 3)
    speed = top * math.sin(omega * start)

    def free(t: float) -> float:
        return (speed + drift) * math.exp(-drag * (t - start)) - drift

    end = root(lambda t: free(t) + top * math.sin(omega * t), 1 / 3, 1 / 2)
    way = (speed + drift) * -math.expm1(-drag * (end - start)) / drag - drift * (end - start)
    return start, end, way - top / omega * (2 + math.cos(omega * start) + math.cos(omega * end))
