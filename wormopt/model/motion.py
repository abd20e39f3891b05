"""Interface of all motions: signals by name over time."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np

from wormopt.labelled import Samples, dataframe, dataset
from wormopt.lazy import above
from wormopt.shown import SHORT, Part, html, lines, text

# Panels of a picture and rows of a table that are shown by default.
_MOST_PANELS, _MOST_ROWS = 8, 24

if TYPE_CHECKING:
    import pandas
    import xarray
    from matplotlib.figure import Figure


class SampledMotion(ABC):
    """Motion known at instants: simulated, optimal, or a crawl in closed form."""

    time: np.ndarray  # (m,) instants, ascending; duplicated at jumps

    @property
    @abstractmethod
    def names(self) -> tuple[str, ...]:
        """Names of its signals."""

    @abstractmethod
    def __getitem__(self, name: str) -> np.ndarray:
        """Samples (entries, m) of a signal."""

    def dimension(self, name: str) -> str:
        """Name of the dimension of a signal's entries."""
        return f"{name}_entry"

    @property
    def _title(self) -> str:
        return type(self).__name__

    def __repr__(self) -> str:
        span = f"time {self.time[0]:.6g} to {self.time[-1]:.6g}, " if len(self.time) else ""
        of = f"{self._title}: {span}{len(self.time)} instants"
        return lines(of, ", ".join(self.names))

    def overview(self) -> Part:
        """Rows of a table: each entry of a signal at both ends, its smallest and largest value."""
        rows = [("signal", "first", "last", "smallest", "largest")]
        for name in self.names if len(self.time) else ():
            values = np.atleast_2d(self[name])
            for j, row in enumerate(values):
                label = f"{name}_{j}" if len(values) > 1 else name
                first, last, least, most = (
                    text(float(number), SHORT) for number in (row[0], row[-1], row.min(), row.max())
                )
                rows.append((label, first, last, least, most))
        left = len(rows) - 1 - _MOST_ROWS
        cut = f"; {left} more rows are left out" if left > 0 else ""
        return Part(f"{len(self.time)} instants{cut}", rows[: _MOST_ROWS + 1])

    def _repr_html_(self) -> str:
        return html(self._title, [self.overview()])

    def _samples(self) -> Iterator[Samples]:
        yield Samples("time", ("time",), self.time)
        for name in self.names:
            values = np.atleast_2d(self[name])
            single = len(values) == 1
            dims = ("time",) if single else (self.dimension(name), "time")
            yield Samples(name, dims, values[0] if single else values)

    def to_xarray(self) -> xarray.Dataset:
        """Make an xarray.Dataset of all signals over the coordinate ``time``.

        Returns
        -------
        xarray.Dataset
            Signals of several entries have a dimension of their own, ``<name>_entry``, that counts
            from 0; with ``mass`` and ``link`` instead in a crawl. Where something jumps, what was
            before stands a last digit earlier, so that every instant can be selected.

        Raises
        ------
        ImportError
            If xarray is not installed.
        """
        return dataset(self._samples())

    def to_dataframe(self) -> pandas.DataFrame:
        """Make a pandas.DataFrame: a row for each instant, columns ``position_0`` and so on.

        Returns
        -------
        pandas.DataFrame
            Its index is ``time``, the same as that of `to_xarray`.

        Raises
        ------
        ImportError
            If pandas is not installed.
        """
        return dataframe(self._samples(), over="time")

    def plot(self, *names: str) -> Figure:
        """Draw signals over time, one below the other.

        Parameters
        ----------
        *names : str
            Which; the first eight if none is named.

        Returns
        -------
        matplotlib.figure.Figure
            Bound to no window; a notebook shows it.

        Raises
        ------
        UnknownNameError
            If there is no such signal.
        """
        return above("wormopt.pictures.motion:signals")(self, names or self.names[:_MOST_PANELS])
