"""Scales and messages that the scenes of the magneto-elastic pair share."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from wormopt.analysis.steady import SteadyState
from wormopt.errors import SolveError
from wormopt.magnetics.material import SMALL_STRAIN
from wormopt.result import left_out
from wormopt.study.conclude import conclude
from wormopt.study.scene import Scene
from wormopt.systems.chain import law_of
from wormopt.systems.pair.scenes.magnetic_pair import MagneticPairTable
from wormopt.systems.pair.steady import Pair

# Push over stiffness times length from which the parameter is not small.
_SMALL = 0.1
# Velocity over the amplitude of the stretch up to which it is nothing but rounding.
_ROUNDING = 1e-9


@dataclass(frozen=True)
class Scales:
    """Units of the dimensionless pair, in units of the scene."""

    length: float = 1.0  # l0 of the link
    time: float = 1.0  # natural time sqrt(m / c)

    @classmethod
    def of(cls, table: MagneticPairTable) -> Scales:
        """Scales of a sample; 1 without a sample."""
        return cls(table.sample.length if table.sample else 1.0, table.natural_time)

    @property
    def speed(self) -> float:
        """Unit of velocities."""
        return self.length / self.time


def pair_of(table: MagneticPairTable, nodes: int) -> Pair:
    """Make the pair of a scene; `nodes`: points of quadrature."""
    laws = law_of(table.friction, 0), law_of(table.friction, 1)
    return Pair(table.smallness, laws, table.cosines, nodes)


def no_steady_motion(scene: Scene[Any], reason: str) -> SolveError:
    """Error for a pair without a steady motion, with a failed Result."""
    suggestion = "change detuning, pair.friction or pair.cosines"
    return SolveError(reason, suggestion, conclude(scene, {}).failed(reason), "no_steady_motion")


def warnings_of_pair(pair: Pair, state: SteadyState | None) -> Iterator[str]:
    """Warn where the steady pair at `state` violates assumptions of its theory."""
    if pair.eps > _SMALL:
        yield (
            f"eps = {pair.eps:.4g} is not small: averages have errors of about eps in first and "
            "eps^2 in second order; the exact motion has none"
        )
    if state is None:
        return
    strain = 2 * float(np.hypot(*state.states["swing"]))
    if strain > SMALL_STRAIN:
        yield left_out(
            strain,
            f"the amplitude of the stretch is {strain:.3g} of the length, but the law of the "
            f"material assumes small strains, up to about {SMALL_STRAIN:g}",
        )
    if float(state.states["center_velocity"][0]) < -_ROUNDING * strain:
        yield "the pair moves backward, since friction is weaker in that direction"
