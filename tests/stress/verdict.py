"""Cases of the stress matrix, and what becomes of them: right, refused, wrong or undecided.

A case draws its numbers with dice that its name throws, asks the package, and finds the answer
anew by other means. It yields what it compared: how far both are apart, over what is allowed.
"""

from __future__ import annotations

import math
import zlib
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from wormopt.errors import SolveError, WormoptError

Class = Literal["right", "refused", "wrong", "undecided"]
Dice = np.random.Generator
Judged = Iterator[tuple[str, float]]
"""What was compared and its distance, over what is allowed."""
Compare = Callable[[Dice], Judged]
Kind = tuple[str, Compare, int]
"""A group, what compares, and the number of cases."""


class Undecided(Exception):
    """The other route fails, so that nothing is known of the case."""


@dataclass(frozen=True)
class Verdict:
    """What became of a case."""

    name: str
    group: str
    core: bool  # whether it is an ordinary one
    verdict: Class
    reason: str = ""  # refusal, what is wrong, or why undecided
    known: float = 1.0  # share of the time in which anything can be known
    off: float = 0.0  # largest distance of the routes over what is allowed


@dataclass(frozen=True)
class Case:
    """One question to the package, with its answer by other means."""

    name: str
    group: str
    compare: Compare
    core: bool = False
    span: float = 0.0  # how long it takes, beside motions over so much time

    def judge(self) -> Verdict:
        """Ask and compare."""
        off, what = -1.0, "nothing was compared"
        dice = np.random.default_rng(zlib.crc32(self.name.encode()))
        try:
            for text, distance in self.compare(dice):
                distance = math.inf if math.isnan(distance) else distance
                if distance > off:
                    off, what = distance, text
        except WormoptError as error:
            told = " ".join(str(error).split())
            if not told or (isinstance(error, SolveError) and not error.suggestion):
                return self._verdict("wrong", f"refused without naming what to change: {told}")
            return self._verdict("refused", told)
        except Undecided as error:
            return self._verdict("undecided", f"other route: {error}")
        except Exception as error:
            return self._verdict("wrong", f"{type(error).__name__}: {error}")
        if 0.0 <= off <= 1.0:
            return self._verdict("right", off=off)
        return self._verdict("wrong", f"{what}: off by {off:.3g} times what is allowed", off)

    def _verdict(self, kind: Class, reason: str = "", off: float = 0.0) -> Verdict:
        return Verdict(self.name, self.group, self.core, kind, reason, 1.0, off)


def many(kinds: Iterable[Kind], *, quick: bool, span: float = 0) -> Iterator[Case]:
    """So many cases of each kind, at most two if `quick`."""
    for group, compare, count in kinds:
        for k in range(min(count, 2) if quick else count):
            yield Case(f"{group} {k}", group, compare, span=span)


def apart(found: ArrayLike, known: ArrayLike, share: float, size: float = 0.0) -> float:
    """Largest distance over a share of the known numbers' size, or of `size` if that is more."""
    found, known = np.asarray(found, float), np.asarray(known, float)
    if found.shape != known.shape or not np.all(np.isfinite(known)):
        raise Undecided(f"numbers {known.shape} do not answer {found.shape}, or are not finite")
    whole = max(float(np.max(np.abs(known), initial=0.0)), size)
    far = float(np.max(np.abs(found - known), initial=0.0))
    return far / (share * whole) if whole else (0.0 if far == 0 else math.inf)


def above(found: float, limit: float, share: float, size: float = 0.0) -> float:
    """How far a number is above a limit, over a share of the limit's size or of `size`."""
    return max(found - limit, 0.0) / (share * max(abs(limit), size))


def spread(dice: Dice, least: float, most: float) -> float:
    """A positive number, all its decades alike."""
    return float(10 ** dice.uniform(math.log10(least), math.log10(most)))
