"""What averages over cells cannot pass, given the values at the cells' ends.

Take a weighted sum f of the velocities of a phase. From a cell's start it rises at most so fast,
to its end it falls at most so fast, and it is never larger than the links' rates allow. Run along
these three for any shares of the cell: what is passed over bounds the average of f. There are
as many such cuts as there are shares; they are made where a solution breaks them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

__all__ = ["Cut", "Cuts"]


@dataclass(frozen=True, eq=False)
class Cut:
    """A weighted sum of velocities in a phase, its slopes and its largest value.

    Parameters
    ----------
    phase : int
        Number of the phase.
    weights : ndarray, shape (n + 1,)
        Weights of the masses' velocities.
    rise, fall : float
        Largest slopes; infinite where nothing limits them.
    most : float
        Largest value.
    """

    phase: int
    weights: np.ndarray
    rise: float
    fall: float
    most: float


class Cuts:
    """Many weighted sums, looked at together.

    Parameters
    ----------
    cuts : sequence of Cut
        The sums.
    """

    def __init__(self, cuts: Sequence[Cut]) -> None:
        self.phase = np.array([cut.phase for cut in cuts], int)
        self.weights = np.array([cut.weights for cut in cuts])
        slopes = np.array([[cut.rise, cut.fall, cut.most] for cut in cuts]).T
        self.rise, self.fall, self.most = slopes

    def reach(self, which: np.ndarray, before: np.ndarray, after: np.ndarray) -> np.ndarray:
        """Twice the area below both slopes, run along for two shares of a cell.

        Parameters
        ----------
        which : ndarray of int
            Numbers of the sums.
        before, after : ndarray
            Shares of the cell, from its start and to its end.
        """
        return _square(before, self.rise[which]) + _square(after, self.fall[which])

    def shares(
        self, start: np.ndarray, end: np.ndarray, level: np.ndarray, reach: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Shares of cells that bound their averages best.

        Parameters
        ----------
        start, end : ndarray, shape (sums, cells)
            Values at the ends.
        level : ndarray, shape (sums, 1)
            Largest values, where values are multiplied by the duration.
        reach : ndarray, shape (sums, 1)
            What turns a slope into a change over a cell.

        Returns
        -------
        before, after : ndarray, shape (sums, cells)
        """
        with np.errstate(divide="ignore", invalid="ignore"):
            up, down = (slope[:, None] * reach for slope in (self.rise, self.fall))
            before, after = (level - start) / up, (level - end) / down
            meet = _share((end - start + down) / (up + down))
        # where nothing limits a slope it is not run along
        before = np.where(np.isfinite(self.rise)[:, None], _share(before), 0.0)
        after = np.where(np.isfinite(self.fall)[:, None], _share(after), 0.0)
        apart = before + after <= 1.0
        return np.where(apart, before, meet), np.where(apart, after, 1.0 - meet)


def _share(value: np.ndarray) -> np.ndarray:
    """A number from 0 to 1; any will do where there is none."""
    return np.clip(np.nan_to_num(value, nan=0.5), 0.0, 1.0)


def _square(share: np.ndarray, slope: np.ndarray) -> np.ndarray:
    """Slope times a square, in which a share of 0 makes even an unlimited slope vanish."""
    return share**2 * np.where(share > 0.0, slope, 0.0)
