"""Scenes of kind ``planar-serpenoid``: speeds of serpenoid waves."""

from __future__ import annotations

import time

import numpy as np
from scipy.integrate import quad
from scipy.optimize import brentq, minimize_scalar
from scipy.special import j0

from wormopt.progress import Report
from wormopt.result import Check, Result
from wormopt.scene.conclude import conclude
from wormopt.scene.scene import Scene
from wormopt.systems.planar.scenes.serpenoid import PlanarSerpenoidScene
from wormopt.systems.planar.serpenoid import best_serpenoid, finite_serpenoid, serpenoid_speed

_AMPLITUDES = np.linspace(0.05, 2.35, 47)
# The other ways: balances of force to round-off, a minimum of power to its square root.
_AGREED = {"viscous": 1e-10, "unit": 1e-10, "elliptic": 1e-6}


def run(scene: Scene[PlanarSerpenoidScene], report: Report) -> Result:
    """Find the speed, the best amplitude, and the speeds of finite worms."""
    table, begin = scene.table, time.perf_counter()
    speed = serpenoid_speed(table.amplitude, table.ratio, table.ground)
    best, most = best_serpenoid(table.ratio, table.ground)
    curve = [serpenoid_speed(a, table.ratio, table.ground) for a in _AMPLITUDES]
    off = abs(speed - another_speed(table.amplitude, table.ratio, table.ground))
    infinite = time.perf_counter()
    finite = []
    for k, waves in enumerate(table.waves):
        report(f"{waves:g} waves", k / len(table.waves))
        worm = finite_serpenoid(
            table.amplitude, table.ratio, per_wave=table.rods_per_wave, waves=waves
        )
        finite.append(worm)
    turns = max((abs(worm.swim.turn) for worm in finite), default=0.0)
    return conclude(
        scene,
        {
            "speed": speed,
            "speed_over_wave": speed / float(j0(table.amplitude)),
            "amplitude_best": best,
            "speed_best": most,
            "recheck_error": off,
            "finite_over_wave": [worm.over_wave for worm in finite],
        },
        {"amplitude": _AMPLITUDES, "speed_by_amplitude": np.array(curve)},
        checks=[
            Check("speed by another way", off, _AGREED[table.ground],
                  f"by another way the speed differs by {off:.2g}"),
        ],
        warnings=_warnings(table, turns),
        timings={"infinite": infinite - begin, "finite": time.perf_counter() - infinite},
    )  # fmt: skip


def _warnings(table: PlanarSerpenoidScene, turns: float) -> list[str]:
    found = []
    if table.ground == "unit":
        found.append(
            "the unit law has no principle of a minimum: the speed is a balance of forces, and "
            "nothing proves it the only one"
        )
    if turns > 1e-9:
        found.append("a finite worm turns in a period: its way hangs on where the wave begins")
    return found


def another_speed(alpha: float, ratio: float, ground: str) -> float:
    """V / c by adaptive quadrature: of the force, or on elliptic ground by the least power."""

    def mean(value: object) -> float:
        return quad(value, 0.0, np.pi / 2, epsabs=1e-13, epsrel=1e-13, limit=400)[0] * 2 / np.pi

    def parts(u: float, w: float) -> tuple[float, float, float, float]:
        psi = alpha * np.sin(u)
        c, s = np.cos(psi), np.sin(psi)
        return c, s, 1 - w * c, w * s

    def force(u: float, w: float) -> float:
        c, s, ahead, aside = parts(u, w)
        size = np.hypot(ahead, aside) if ground == "unit" else 1.0
        return (ahead * c - ratio * aside * s) / size

    def power(u: float, w: float) -> float:
        _, _, ahead, aside = parts(u, w)
        return float(np.hypot(ahead, ratio * aside))

    if ground == "elliptic":
        top = 1.0 / max(0.2, float(j0(alpha)))
        found = minimize_scalar(
            lambda w: mean(lambda u: power(u, w)), bounds=(0.0, top), method="bounded",
            options={"xatol": 1e-10},
        )  # fmt: skip
        w = float(found.x)  # pyright: ignore[reportAttributeAccessIssue]
    else:

        def total(w: float) -> float:
            return mean(lambda u: force(u, w))

        high = 1.0
        while total(high) > 0:
            high *= 2
        w = float(brentq(total, 0.0, high, xtol=1e-14))  # pyright: ignore
    return float(j0(alpha)) - w
