"""Compiled steps of Moreau and Jean."""

from __future__ import annotations

import ctypes
from functools import cache

import casadi as ca
import numpy as np

from wormopt.numerics.expressions import AtPlaces
from wormopt.simulation.native.build import function_library, library, parts
from wormopt.simulation.native.model_code import places_library

_POINTER = ctypes.POINTER(ctypes.c_double)


class _Call(ctypes.Structure):
    """`Call` of moreau.c."""

    _fields_ = tuple((name, ctypes.c_void_p) for name in ("function", "arg", "res", "iw", "w"))


class Marcher:
    """Strides of equal steps, of the functions `kick` and `inputs` of `MoreauJean`.

    Raises CompilerError if there is no compiler or it fails.
    """

    def __init__(
        self, kick: ca.Function, inputs: ca.Function | AtPlaces | None, steps: int
    ) -> None:
        self._march = _driver().march
        self._march.restype = None
        self._steps, self._half, self._gathered = steps, kick.numel_out(0), kick.numel_out(1)
        self._kept: list[object] = []  # the calls store addresses only
        u = np.zeros(kick.numel_in(2))
        results = [np.zeros(kick.numel_out(i)) for i in range(2)]
        self._kick = self._called(function_library(kick), kick, {2: u}, results)
        self._inputs = _Call()
        if inputs is not None:
            vectors = places_library(inputs) if isinstance(inputs, AtPlaces) else None
            function = inputs.function if isinstance(inputs, AtPlaces) else inputs
            code = vectors or function_library(function)
            self._inputs = self._called(code, function, {}, [u])

    def _called(
        self, code: ctypes.CDLL, function: ca.Function,
        given: dict[int, np.ndarray], results: list[np.ndarray],
    ) -> _Call:  # fmt: skip
        arg, res = (_POINTER * function.sz_arg())(), (_POINTER * function.sz_res())()
        for pointers, arrays in ((arg, given), (res, dict(enumerate(results)))):
            for i, array in arrays.items():
                pointers[i] = array.ctypes.data_as(_POINTER)
        iw, w = np.zeros(function.sz_iw(), np.int64), np.zeros(function.sz_w())
        self._kept += [code, given, results, arg, res, iw, w]
        run = ctypes.cast(getattr(code, function.name()), ctypes.c_void_p)
        addresses = ctypes.addressof(arg), ctypes.addressof(res), iw.ctypes.data, w.ctypes.data
        return _Call(run.value, *addresses)

    def __call__(
        self, start: np.ndarray, scheduled: np.ndarray, numbers: np.ndarray, sizes: np.ndarray
    ) -> np.ndarray:
        """Return the columns after each stride.

        `start` is the first column, `scheduled` has a column for each stride, `sizes` are those of
        its steps.
        """
        states = np.empty((len(sizes) + 1, len(start)))
        states[0] = start
        values = np.ascontiguousarray(scheduled.T, float)
        counts = np.array(
            [len(sizes), self._steps, self._half, self._gathered, len(scheduled)], np.int64
        )
        arrays = counts, values, np.ascontiguousarray(numbers, float), np.ascontiguousarray(sizes)
        self._march(
            ctypes.byref(self._inputs), ctypes.byref(self._kick),
            *(ctypes.c_void_p(one.ctypes.data) for one in (*arrays, states)),
        )  # fmt: skip
        return states[1:].T


@cache
def _driver() -> ctypes.CDLL:
    return library("moreau", parts("moreau.c"))
