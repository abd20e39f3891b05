"""Base of the kinds "magnetic-pair" and "resonance": averages of a magneto-elastic pair."""

from __future__ import annotations

import math
from collections.abc import Iterator
from functools import cached_property

from wormopt.errors import SolveError
from wormopt.result import Check
from wormopt.study import Study, entry, on_use, scalar
from wormopt.study.numerics import AveragingTable, ToleranceTable
from wormopt.systems.pair.tables import PairTable

with on_use():
    from wormopt.systems.chain import law_of
    from wormopt.systems.pair.steady import Pair

_SMALL = 0.1  # push over stiffness times length from which the parameter is not small
_AGREED = 1e-9  # accepted relative difference between steady states of eqs. 18 and 19


class PairStudy(Study):
    """Base of studies of the averaged pair."""

    pair: PairTable = entry("the pair")
    averaging: AveragingTable = entry("computation of the averages", default=AveragingTable)
    tolerance: ToleranceTable = entry("tolerance of the exact simulations", default=ToleranceTable)

    @cached_property
    def dimensionless(self) -> Pair:
        """The pair, exact and averaged."""
        laws = law_of(self.pair.friction, 0), law_of(self.pair.friction, 1)
        return Pair(self.pair.smallness, laws, self.pair.cosines, self.averaging.nodes)

    @scalar("1", "*ε*, the small parameter")
    def eps(self) -> float:
        return self.pair.smallness

    @scalar("1", "strain *u*<sub>0</sub> of the sample", when="pair.sample")
    def u0(self) -> float:
        return 2 * self.eps

    def no_steady_motion(self, detuning: float, largest: float = math.inf) -> SolveError:
        """Error for a pair without a steady motion at a detuning, with a swing up to `largest`."""
        reason = self.dimensionless.why_none(detuning, largest)
        suggestion = "change detuning, pair.friction or pair.cosines"
        return SolveError(reason, suggestion, code="no_steady_motion")

    def closed_form_checks(self, difference: float | None, advice: str) -> Iterator[Check]:
        """Yield the check against eq. 19, where that applies."""
        if difference is not None:
            yield Check("closed form (19)", difference, _AGREED, advice.format(difference))

    def warnings_of_eps(self) -> Iterator[str]:
        """Warn where the parameter is not small."""
        if self.eps > _SMALL:
            yield (
                f"eps = {self.eps:.4g} is not small: averages have errors of about eps in first "
                "and eps^2 in second order; the exact motion has none"
            )
