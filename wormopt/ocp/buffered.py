"""CasADi functions called many times a second: numbers go in and out by memory that is kept."""

from __future__ import annotations

import casadi as ca
import numpy as np


class Buffered:
    """A function of which nonzeros of arguments and results are numpy arrays.

    Conversions to CasADi's own matrices would take several times as long as small functions do.
    """

    def __init__(self, function: ca.Function) -> None:
        self._buffer, self._evaluate = function.buffer()
        self._arguments = [np.zeros(function.nnz_in(k)) for k in range(function.n_in())]
        self._results = [np.zeros(function.nnz_out(k)) for k in range(function.n_out())]
        for k, array in enumerate(self._arguments):
            self._buffer.set_arg(k, memoryview(array))
        for k, array in enumerate(self._results):
            self._buffer.set_res(k, memoryview(array))

    def __call__(self, *arguments: np.ndarray) -> list[np.ndarray]:
        """Evaluate at nonzeros, column by column; results are overwritten by the next call."""
        for array, given in zip(self._arguments, arguments, strict=True):
            array[:] = given
        self._evaluate()
        return self._results
