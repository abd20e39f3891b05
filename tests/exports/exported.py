"""Gaits and models that tests export, and their lengths by formula."""

from pathlib import Path

import casadi as ca
import numpy as np
from numpy.polynomial import Polynomial

import wormopt as wo
from wormopt.result import Result


def rough(links: int = 3) -> wo.Gait:
    """Gait of uneven pieces, with polynomials of degree 5 and a harmonic, anything but smooth."""
    rng = np.random.default_rng(5)
    breaks = np.concatenate([[0.0], np.cumsum(rng.uniform(0.1, 0.5, 7))])
    draw = rng.standard_normal
    return wo.Gait(
        breaks, draw((7, links, 6)), rng.uniform(1, 9, 7), draw((7, links)), draw((7, links))
    )


def by_formula(gait: wo.Gait, t: float, derivative: int) -> np.ndarray:
    """Lengths, rates, ... by numpy's polynomials and by turning complex amplitudes."""
    t = np.mod(t, gait.period)
    q = max(np.flatnonzero(gait.breaks[:-1] <= t))
    s = t - gait.breaks[q]
    values = [
        Polynomial(c).deriv(derivative)(s) if derivative else Polynomial(c)(s)
        for c in gait.polynomial[q]
    ]
    if gait.omega is None or gait.cosine is None or gait.sine is None:
        return np.array(values)
    turning = (1j * gait.omega[q]) ** derivative * np.exp(1j * gait.omega[q] * s)
    return np.array(values) + ((gait.cosine[q] - 1j * gait.sine[q]) * turning).real


def gait_in(result: Result) -> wo.Gait:
    names = ("breaks", "polynomial", "omega", "cosine", "sine")
    return wo.Gait(**{n: result[f"gait_{n}"].values for n in names if f"gait_{n}" in result})


def made(folder: Path) -> Path:
    folder.mkdir()
    return folder


def swing() -> wo.Model:
    t, x, v, k = (ca.SX.sym(name) for name in ("t", "x", "v", "k"))
    states = [wo.Signal("place", x, "length", nominal=3.0, value=0.5),
              wo.Signal("speed of it, λ", v, "speed", value=0.0)]  # fmt: skip
    number, pull = wo.Signal("time", k, "s-3", value=2.0), k * x * t
    outputs = [wo.Output("pull", pull, "acceleration")]
    return wo.Model("swing", states, ca.vertcat(v, -pull), p=[number], t=t, outputs=outputs)
