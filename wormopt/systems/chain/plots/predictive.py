"""Pictures of predictive control."""

from matplotlib.figure import Figure

from wormopt.result import Result


def predictive(result: Result) -> Figure:
    return Figure()


def estimates(result: Result) -> Figure:
    return Figure()
