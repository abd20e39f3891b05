"""Models that are formulas of time and parameters, so that what a fit knows is known exactly."""

from collections.abc import Callable, Mapping
from typing import Any

import casadi as ca
import numpy as np

from wormopt.fitting.estimate import Fit
from wormopt.fitting.task import FitTask
from wormopt.model.model import Model, Output, Signal


def formula(
    outputs: Callable[[ca.SX, Mapping[str, ca.SX]], Mapping[str, ca.SX]], **values: float
) -> Model:
    """Make a model whose outputs are formulas of time and of parameters with these values."""
    t, rest = ca.SX.sym("t"), ca.SX.sym("rest")
    symbols = {name: ca.SX.sym(name) for name in values}
    told = [Output(name, expression) for name, expression in outputs(t, symbols).items()]
    p = [Signal(name, symbols[name], value=value) for name, value in values.items()]
    return Model("formula", [Signal("rest", rest, value=0.0)], ca.SX(0.0), t=t, p=p, outputs=told)


def fit_at(task: FitTask, **values: float) -> Fit:
    """Make the fit that ends at these values, which are its best."""
    at = [values[name] for name in task.names]
    theta = np.array([np.log(v) if c.log else v for c, v in zip(task.coordinates, at, strict=True)])
    r, jacobian = task.residuals(theta)
    return Fit(task, theta, r, jacobian, 0.0, True, "", ())


def noisy(seed: int, values: Any, sd: float) -> np.ndarray:
    return np.asarray(values) + sd * np.random.default_rng(seed).standard_normal(np.shape(values))
