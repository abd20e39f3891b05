"""Signals of optimal motions, whose coordinate of time is called ``instant``."""

from __future__ import annotations

from dataclasses import replace

from matplotlib.figure import Figure

from wormopt.plot import simulation
from wormopt.plot.parts import GREY, facts, scalar
from wormopt.result import Result, Variable

__all__ = ["over_time", "signals"]


def signals(result: Result) -> Figure:
    """Signals against time, one below the other, with the instants at which phases change.

    Parameters
    ----------
    result : Result
        Of optimal control.

    Returns
    -------
    Figure
    """
    drawn = simulation.signals(over_time(result))
    for axes in drawn.axes:
        for instant in (scalar(result, "phase_times") or [])[1:-1]:
            axes.axvline(instant, color=GREY, linewidth=0.8, linestyle=":")
    drawn.axes[0].set_title(facts(result, "time", "n_phases", "solve_iterations"), loc="left")
    return drawn


def over_time(result: Result) -> Result:
    """Call the coordinate ``instant`` of an optimal motion ``time``, as other pictures know it.

    Parameters
    ----------
    result : Result
        Of optimal control; its scalar ``time`` is how long the motion takes.

    Returns
    -------
    Result
        Without that scalar.
    """

    def called(name: str) -> str:
        return "time" if name == "instant" else name

    def renamed(variable: Variable) -> Variable:
        dims = tuple(map(called, variable.dims))
        return replace(variable, name=called(variable.name), dims=dims)

    others = {name: value for name, value in result.scalars.items() if name != "time"}
    return replace(result, scalars=others, variables=tuple(map(renamed, result.variables)))
