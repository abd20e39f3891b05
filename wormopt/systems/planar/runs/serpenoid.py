"""Runs of kind ``planar-serpenoid``: speeds of serpenoid waves."""

from __future__ import annotations

import time
from collections.abc import Callable

import numpy as np
from scipy.integrate import tanhsinh
from scipy.optimize import brentq, minimize_scalar
from scipy.special import j0

from wormopt.progress import Report
from wormopt.result import Check, Result
from wormopt.study.conclude import conclude
from wormopt.study.scene import Scene
from wormopt.systems.planar.scenes.serpenoid import PlanarSerpenoidScene
from wormopt.systems.planar.serpenoid import best_serpenoid, finite_serpenoid, serpenoid_speed

_AMPLITUDES = np.linspace(0.05, 2.35, 47)
# Second routes: force balances are exact to round-off, a minimum of power to its square root.
_AGREED = {"viscous": 1e-10, "unit": 1e-10, "elliptic": 1e-6}

# Least shortfall of the recoil over the squared amplitude that second routes search.
_LEAST = 1e-9


def run(scene: Scene[PlanarSerpenoidScene], report: Report) -> Result:
    """Compute the speed, the best amplitude, and the speeds of finite worms."""
    table, begin = scene.table, time.perf_counter()
    speed = serpenoid_speed(table.amplitude, table.ratio, table.ground)
    best, most = best_serpenoid(table.ratio, table.ground)
    curve = [serpenoid_speed(a, table.ratio, table.ground) for a in _AMPLITUDES]
    another = another_speed(table.amplitude, table.ratio, table.ground)
    # over what may cancel: the speed, and by how much the wave is shorter than the material
    off = abs(speed - another) / (abs(speed) + table.amplitude**2 / 4)
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
                  f"the second route gives a speed that differs by {off:.2g}"),
        ],
        warnings=_warnings(table, turns),
        timings={"infinite": infinite - begin, "finite": time.perf_counter() - infinite},
    )  # fmt: skip


def _warnings(table: PlanarSerpenoidScene, turns: float) -> list[str]:
    found = []
    if table.ground == "unit":
        found.append(
            "the unit law has no minimum principle: the speed satisfies a balance of forces, but "
            "its uniqueness is not proven"
        )
    if turns > 1e-9:
        found.append("a finite worm turns in a period: its speed depends on the initial phase")
    return found


def another_speed(alpha: float, ratio: float, ground: str) -> float:
    """Return V / c by a second route: force balance, or least power on elliptic ground.

    The shortfalls y = 1 - w of the recoil, 1 - J0 and 1 - cos are divided by alpha^2, so that
    small waves are no differences of larger numbers.
    """

    def mean(value: Callable[[np.ndarray], np.ndarray]) -> float:
        # tanh-sinh: its points cluster near 0, where dry friction changes direction
        return float(tanhsinh(value, 0.0, np.pi / 2, rtol=1e-14).integral) * 2 / np.pi

    def parts(u: np.ndarray, y: float) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        psi = alpha * np.sin(u)
        c, s = np.cos(psi), np.sin(psi) / alpha
        return c, s, _bent(psi, alpha) + y * c, (1 - alpha**2 * y) * s

    def force(y: float) -> float:
        def along(u: np.ndarray) -> np.ndarray:
            c, s, ahead, aside = parts(u, y)
            size = np.hypot(alpha * ahead, aside) if ground == "unit" else 1.0
            return (ahead * c - ratio * aside * s) / size

        return mean(along)

    crest = mean(lambda u: np.abs(np.sin(alpha * np.sin(u)))) / alpha

    def power(y: float) -> float:
        def more(u: np.ndarray) -> np.ndarray:
            _, _, ahead, aside = parts(u, y)
            across = ratio * np.abs(aside)
            return ahead**2 / (np.hypot(alpha * ahead, across) + across)

        return mean(more) - ratio * crest * y  # the power of slip across is linear in y

    bend = mean(lambda u: _bent(alpha * np.sin(u), alpha))
    ends = np.log(_LEAST), -2 * np.log(alpha)  # of log y: from no recoil to almost no motion
    if ground == "elliptic":
        found = minimize_scalar(
            lambda z: power(np.exp(z)), bounds=ends, method="bounded", options={"xatol": 1e-10}
        )
        z = float(found.x)  # pyright: ignore[reportAttributeAccessIssue]
    else:
        z = float(brentq(lambda z: force(np.exp(z)), *ends, xtol=1e-14))  # pyright: ignore
    return alpha**2 * (float(np.exp(z)) - bend)


def _bent(psi: np.ndarray, alpha: float) -> np.ndarray:
    """Return (1 - cos psi) / alpha^2."""
    return 2 * (np.sin(psi / 2) / alpha) ** 2
