"""The verb `fit`: recordings in, numbers out, with how well they are known."""

from __future__ import annotations

from wormopt.fitting.estimate import Fit
from wormopt.fitting.task import FitTask
from wormopt.progress import Report, silent


def fit(task: FitTask, *, seeds: int = 8, seed: int = 0, report: Report = silent) -> Fit:
    """Find the numbers with which a model reproduces recordings best.

    Parameters
    ----------
    task : FitTask
        What is to be fitted.
    seeds : int, optional
        From how many starts: the first is the one given.
    seed : int, optional
        Of the random numbers that the others are drawn with.
    report : callable, optional
        Told how far it is, see `wormopt.progress`.

    Returns
    -------
    Fit

    Raises
    ------
    SolveError
        If no start leads anywhere; the reason is that of the first.
    Interrupted
        If the user stopped it; `partial` is the best fit so far.
    """
    raise NotImplementedError
