"""Properties of planned runs: excess over limits, linearity of measurements, predictions."""

from __future__ import annotations

import numpy as np

from wormopt.errors import ArgumentError, SolveError
from wormopt.fitting.experiment import Experiment
from wormopt.fitting.information import Criterion
from wormopt.model.model import Model
from wormopt.simulation.options import Tolerance
from wormopt.simulation.simulate import simulate

_FAR = 2.0  # standard errors within which measurements must be linear
_TOLERANCE = Tolerance(1e-9, 1e-10)


def largest_excess(experiment: Experiment, chosen: np.ndarray, looks: int) -> float:
    """Largest excess of any limit, as a share; infinite if the motion cannot be simulated."""
    found = [experiment.chosen.excess(chosen)[0], np.abs(chosen) - 1]
    try:
        found.append(experiment.limited(chosen, looks))
    except SolveError:
        return np.inf
    return float(np.max(np.concatenate(found)))


def departure(experiment: Experiment, chosen: np.ndarray) -> float:
    """Deviation of measurements from linearity in the unknowns over their expected errors.

    If masses begin or cease to stick within these errors, one-sided derivatives do not apply on
    the other side, and expected errors are wrong. Evaluated along the principal axes of the
    confidence ellipsoid, two standard errors to both sides; in standard errors for each of them,
    infinite if there is no such motion or value.
    """
    worst = 0.0
    try:
        run = experiment.run(chosen)
        here = experiment.seen(chosen, np.zeros(len(experiment.names)))
        for axis in run.known.axes.T:
            for step in (-_FAR * axis, _FAR * axis):
                departs = experiment.seen(chosen, step) - here - run.jacobian @ step
                worst = max(worst, float(np.linalg.norm(departs)) / _FAR)
    except (SolveError, ArgumentError):  # such as friction below 0
        return np.inf
    return worst


def mean_rate(
    experiment: Experiment,
    model: Model,
    output: str,
    span: tuple[float, float],
    *,
    entry: int = 0,
) -> Criterion:
    """Criterion of a small variance of the mean rate of a state or output in some motion.

    Parameters
    ----------
    experiment : Experiment
        Whose unknowns there are.
    model : Model
        What moves then, with the same unknowns: the same worm under the gait it is built for.
    output : str
        Name of a state or output; of the mean speed it is that of the place.
    span : (float, float)
        First and last time.
    entry : int, optional
        Which entry of it.

    Returns
    -------
    Criterion

    Raises
    ------
    SolveError
        If the motion cannot be followed.
    ArgumentError
        If the prediction depends on none of the unknowns.

    Examples
    --------
    The mean rate of x' = -r x from 1 over a unit time is exp(-r) - 1; its derivative at r = 1 is
    -exp(-1), by which the error of r counts:

    >>> import casadi as ca
    >>> import wormopt as wo
    >>> x, r, u = (ca.SX.sym(name) for name in "xru")
    >>> numbers = [wo.Signal("rate", r, value=1.0), wo.Signal("feed", u, value=0.0)]
    >>> decay = wo.Model("decay", [wo.Signal("x", x, value=1.0)], u - r * x, p=numbers)
    >>> feed = wo.Constant("feed", 0.0, 1.0)
    >>> todo = wo.Experiment(decay, [wo.Unknown("rate")], {"x": 0.02}, [0.5, 1.0], [feed])
    >>> mean_rate(todo, decay, "x", (0.0, 1.0)).rows.round(6)
    array([[-0.367879]])
    """
    first, last = span
    motion = simulate(
        model,
        last,
        contact=experiment.contact,
        times=[first, last],
        tolerance=_TOLERANCE,
        sensitivities=experiment.directions,
    )
    row = np.diff(motion.derivative(output)[entry])[:, 0] / (last - first)
    if not np.any(row):
        raise ArgumentError(f"the mean rate of {output} depends on none of the unknowns")
    return Criterion("A", row[None, :])
