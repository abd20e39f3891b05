"""Smooth gaits drawn at random, and a load that holds them."""

from collections.abc import Sequence

import numpy as np
from hypothesis import strategies as st

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
