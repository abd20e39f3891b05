"""Kind "planar-serpenoid": speed of a long worm with a bending wave."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import cached_property
from typing import ClassVar, Literal

from wormopt.errors import Fault
from wormopt.study import (
    Study,
    array,
    check,
    entry,
    number,
    on_use,
    scalar,
    stage,
    warnings,
    whole,
)
from wormopt.study.types import Positive

with on_use():
    import numpy as np
    from scipy.integrate import tanhsinh
    from scipy.optimize import brentq, minimize_scalar
    from scipy.special import j0

    from wormopt.systems.planar.serpenoid import (
        FiniteSerpenoid,
        best_serpenoid,
        finite_serpenoid,
        serpenoid_speed,
    )

# Second routes: force balances are exact to round-off, a minimum of power to its square root.
_AGREED = {"viscous": 1e-10, "unit": 1e-10, "elliptic": 1e-6}

# Turn in a period, in rad, above which a finite worm is said to turn.
_TURNS = 1e-9
# Least shortfall of the recoil over the squared amplitude that second routes search.
_LEAST = 1e-9


class PlanarSerpenoid(Study, kind="planar-serpenoid"):
    """Compute the speed of a serpenoid wave on viscous or dry ground.

    The wave travels backward along the body; its tangent angle is *α* sin *ks*. Infinite worms on
    viscous or dry ground are computed over the amplitude. On viscous ground, worms of finite
    length, made of rods, are computed too; their ends recoil. See
    [theory](../theory-planar.md#6-serpenoid-waves).
    """

    pictures: ClassVar = {
        "serpenoid": "speed over amplitude, with the best one and that of the scene, and the "
        "best wave",
    }
    headline: ClassVar = ("speed", "speed_over_wave", "amplitude_best", "speed_best")

    amplitude: float = number("angle", "amplitude *α* of the tangent angle", above=0, most=2.4)
    ratio: float = number(
        "1", "resistance across over along: *r*, or *ρ* on dry ground", above=1, most=1000000.0
    )
    ground: Literal["viscous", "elliptic", "unit"] = entry(
        "`viscous`, or dry: `elliptic` (maximal dissipation), `unit` (direction alone)",
        default="viscous",
    )
    waves: tuple[Positive, ...] = entry(
        "numbers of waves on finite worms; viscous ground only", quantity="count", default=()
    )
    rods_per_wave: int = whole(3, 60, "number of rods per wave on finite worms", default=12)

    def faults_of_keys(self) -> Iterator[Fault]:
        if self.waves and self.ground != "viscous":
            yield "waves", "finite worms are computed on viscous ground only; leave it out"
        for waves in self.waves:
            rods = waves * self.rods_per_wave
            if abs(rods - round(rods)) > 1e-9 * rods:
                yield "waves", f"{waves:g} waves are no whole number of rods; change rods_per_wave"
            elif not 2 <= round(rods) <= 60:
                yield "waves", f"{waves:g} waves need 2 to 60 rods in all; change rods_per_wave"

    # -- the infinite worm -------------------------------------------------------------------------

    @array("angle", "amplitude", "amplitude of the tangent angle", name="amplitude")
    def amplitudes(self) -> np.ndarray:
        return np.linspace(0.05, 2.35, 47)

    @array("1", "amplitude", "speed relative to that of the material")
    def speed_by_amplitude(self) -> np.ndarray:
        return np.array([serpenoid_speed(a, self.ratio, self.ground) for a in self.amplitudes])

    @scalar("1", "speed relative to that of the material along the wave, *V*/*c*")
    def speed(self) -> float:
        return serpenoid_speed(self.amplitude, self.ratio, self.ground)

    @scalar("1", "speed relative to that of the wave in space")
    def speed_over_wave(self) -> float:
        return self.speed / float(j0(self.amplitude))

    @cached_property
    def best(self) -> tuple[float, float]:
        """Amplitude of the highest speed, and that speed."""
        return best_serpenoid(self.ratio, self.ground)

    @scalar("angle", "amplitude with the highest *V*/*c*")
    def amplitude_best(self) -> float:
        return self.best[0]

    @scalar("1", "`speed` at `amplitude_best`")
    def speed_best(self) -> float:
        return self.best[1]

    @scalar("share", "difference to the speed of a second route, relative to speed + *α*²/4")
    def recheck_error(self) -> float:
        another = another_speed(self.amplitude, self.ratio, self.ground)
        # over what may cancel: the speed, and by how much the wave is shorter than the material
        return abs(self.speed - another) / (abs(self.speed) + self.amplitude**2 / 4)

    # -- finite worms ------------------------------------------------------------------------------

    @stage
    def finite_worms(self) -> list[FiniteSerpenoid]:
        found = []
        for k, waves in enumerate(self.waves):
            self.report(f"{waves:g} waves", k / len(self.waves))
            found.append(
                finite_serpenoid(
                    self.amplitude, self.ratio, per_wave=self.rods_per_wave, waves=waves
                )
            )
        return found

    @scalar("1", "`speed_over_wave` of finite worms with `waves`, viscous ground")
    def finite_over_wave(self) -> list[float]:
        return [worm.over_wave for worm in self.finite_worms]

    # -- the trust report --------------------------------------------------------------------------

    @property
    def accepted(self) -> float:
        """Accepted difference of both routes."""
        return _AGREED[self.ground]

    @check(
        "accepted",
        "the second route gives a speed that differs by {value:.2g}",
        name="speed by another route",
    )
    def second_route(self) -> float:
        return self.recheck_error

    @warnings
    def doubts(self) -> Iterator[str]:
        if self.ground == "unit":
            yield (
                "the unit law has no minimum principle: the speed satisfies a balance of forces, "
                "but its uniqueness is not proven"
            )
        if any(abs(worm.swim.turn) > _TURNS for worm in self.finite_worms):
            yield "a finite worm turns in a period: its speed depends on the initial phase"


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
