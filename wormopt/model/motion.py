"""What every motion answers, whoever found it: signals by name over its time."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import Any

import numpy as np


class SampledMotion(ABC):
    """A motion known at instants: simulated, optimal, or crawling in closed form."""

    time: np.ndarray  # (m,) instants, ascending; where something jumps, one may stand twice

    @property
    @abstractmethod
    def names(self) -> tuple[str, ...]:
        """Names of its signals."""

    @abstractmethod
    def __getitem__(self, name: str) -> np.ndarray:
        """Samples (entries, m) of a signal."""

    def to_xarray(self) -> Any:
        """Make an xarray.Dataset of all signals over the coordinate ``time``.

        Returns
        -------
        xarray.Dataset
            Signals of several entries have a dimension of their own, ``<name>_entry``.

        Raises
        ------
        ImportError
            If xarray is not installed.
        """
        import xarray  # only who asks for it needs it

        found = {}
        for name in self.names:
            values = np.atleast_2d(self[name])
            single = len(values) == 1
            dims = ("time",) if single else (f"{name}_entry", "time")
            found[name] = (dims, values[0] if single else values)
        return xarray.Dataset(found, coords={"time": self.time})
