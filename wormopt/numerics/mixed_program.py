"""Linear programs with integer columns: branch and bound by HiGHS."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import highspy
import numpy as np

from wormopt.numerics.linear_program import Rows, silent_highs

# Tolerance of rows and integer columns, and gap of the best point.
TOLERANCE = 1e-9
MISSED = 1e-8


@dataclass(frozen=True, eq=False)
class Mixed:
    """Bounds of the maximum of a mixed program."""

    bound: float  # no point is better, to the solver's tolerances
    x: np.ndarray  # best point found; empty if none
    value: float  # its objective; -inf if none
    nodes: int  # of the tree


def maximise_mixed(
    cost: np.ndarray,
    rows: Rows,
    lower: np.ndarray,
    upper: np.ndarray,
    whole: np.ndarray,
    seconds: float,
) -> Mixed:
    """Maximise a linear cost (n,) within rows and bounds; columns `whole` are integers.

    After `seconds` it returns what it has. One thread makes it reproducible.
    """
    starts, column, value, row_lower, row_upper = rows.assemble(len(cost))
    model: Any = highspy.HighsLp()
    model.num_row_, model.num_col_ = rows.count, len(cost)
    model.sense_ = highspy.ObjSense.kMaximize
    model.col_cost_, model.col_lower_, model.col_upper_ = cost, lower, upper
    model.row_lower_, model.row_upper_ = row_lower, row_upper
    matrix = model.a_matrix_
    matrix.format_ = highspy.MatrixFormat.kRowwise
    matrix.start_, matrix.index_, matrix.value_ = starts, column, value
    kinds = [highspy.HighsVarType.kContinuous, highspy.HighsVarType.kInteger]
    model.integrality_ = [kinds[int(j)] for j in np.isin(np.arange(len(cost)), whole)]
    solver = silent_highs()
    options: dict[str, float | int] = {
        "threads": 1,
        "time_limit": max(seconds, 0.1),
        "mip_feasibility_tolerance": TOLERANCE,
        "primal_feasibility_tolerance": TOLERANCE,
        "mip_rel_gap": 0.0,
        "mip_abs_gap": MISSED,
    }
    for option, number in options.items():
        solver.setOptionValue(option, number)
    solver.passModel(model)
    solver.run()
    info, solution = solver.getInfo(), solver.getSolution()
    found = bool(solution.value_valid)
    return Mixed(
        float(info.mip_dual_bound),
        np.array(solution.col_value) if found else np.empty(0),
        float(info.objective_function_value) if found else -np.inf,
        int(info.mip_node_count),
    )
