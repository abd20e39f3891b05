"""Quantities of controllers on drawn plants: exact intervals, and Markdown tables.

No distribution is assumed. Failed simulations rank below all others.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.special import bdtr, betaincinv

from wormopt.systems.shared.declared import JUDGED

LEVEL = 0.95
"""Least probability that an interval contains its quantity."""

_COLUMNS = {
    "capture_time": "captured at",
    "time_outside_tube": "time outside",
    "error_peak": "largest \\|e\\|",
    "error_integral": "∫\\|e\\|²",
    "input_rms": "u rms",
    "input_peak": "u peak",
    "distance": "distance",
    "mean_speed": "mean speed",
    "work": "work spent",
    "net_work": "net work",
    "energy_per_mass_distance": "work over mass and distance",
}
_ALL = _COLUMNS | {"input_integral": "∫\\|u\\|²"}
_BANDS = ("time_outside_tube", "error_peak", "error_integral", "input_rms", "distance")


def share_interval(count: int, members: int) -> tuple[float, float]:
    """Clopper-Pearson interval of a share, from `count` of `members` observed."""
    tail = (1 - LEVEL) / 2
    low = betaincinv(count, members - count + 1, tail) if count else 0.0
    high = betaincinv(count + 1, members - count, 1 - tail) if count < members else 1.0
    return float(low), float(high)


def median_interval(values: np.ndarray) -> tuple[float, float]:
    """Interval of the median between two of the values, by order statistics."""
    n = len(values)
    # none below the least value or above the largest; unknown values rank above all
    ranked = np.array([-np.inf, *np.sort(np.where(np.isnan(values), np.inf, values)), np.inf])
    below = np.searchsorted(bdtr(np.arange(n + 1), n, 0.5), (1 - LEVEL) / 2)
    ends = ranked[[below, n + 1 - below]]
    low, high = np.where(np.isinf(ends), np.nan, ends).tolist()
    return low, high


def less(rows: np.ndarray) -> np.ndarray:
    """Number of members on which each row is lower than each other row.

    `rows` has the shape (rivals, members), the result (rivals, rivals).
    """
    known = np.where(np.isnan(rows), np.inf, rows)
    return np.sum(known[:, None, :] < known[None, :, :], axis=2)


@dataclass(frozen=True, eq=False)
class Drawn:
    """Quantities of one controller on the drawn plants."""

    values: dict[str, np.ndarray]  # (members,) by name; NaN: not simulated or nothing happens
    failed: int  # how many could not be simulated

    @classmethod
    def of(cls, numbers: Sequence[Mapping[str, float | None] | None]) -> Drawn:
        """Collect the quantities of each plant, None where its simulation failed."""
        columns = {name: [n and n[name] for n in numbers] for name in JUDGED}  # None becomes NaN
        values = {name: np.array(column, dtype=float) for name, column in columns.items()}
        return cls(values, sum(n is None for n in numbers))

    def first(self, count: int) -> Drawn:
        """The first plants only."""
        return Drawn({name: values[:count] for name, values in self.values.items()}, 0)

    @property
    def outside(self) -> int:
        """Number of plants that leave the tube after capture, including failed simulations."""
        stays = self.values["time_outside_tube"] == 0
        return len(stays) - int(np.sum(stays))

    @property
    def outside_share(self) -> tuple[float, float]:
        """Interval of the share of plants that leave the tube."""
        return share_interval(self.outside, len(self.values["time_outside_tube"]))

    def median(self, name: str) -> tuple[float, float]:
        """Interval of the median of a quantity over all plants; failed simulations rank worst."""
        return median_interval(self.values[name])

    def band(self, name: str) -> str:
        """Median of a quantity over the simulated plants, with 5 % and 95 % quantiles, as text."""
        values = self.values[name][np.isfinite(self.values[name])]
        shares = (0.5, 0.05, 0.95)
        middle, low, high = np.quantile(values, shares) if values.size else [np.nan] * 3
        return f"{text_of(middle)} [{text_of(low)}, {text_of(high)}]"


# -- Markdown --------------------------------------------------------------------------------------


def markdown_table(head: Sequence[str], rows: Iterable[Sequence[str]]) -> Iterator[str]:
    """Lines of a table with a left-aligned first column."""
    for cells in (head, ["---", *["---:"] * (len(head) - 1)], *rows):
        yield "| " + " | ".join(cells) + " |"


def text_of(value: float | None) -> str:
    """The number with three digits."""
    if value is None or not np.isfinite(value):
        return "never" if value is None else "–"
    return f"{value:.3g}" if abs(value) < 100 else f"{value:.0f}"


def nominal_table(row: Mapping[str, Mapping[str, float | None]]) -> Iterator[str]:
    """Quantities of each controller on the nominal plant."""
    known = [
        key
        for key in _COLUMNS
        if key == "capture_time" or any(numbers[key] is not None for numbers in row.values())
    ]
    yield from markdown_table(
        ["", *(_COLUMNS[key] for key in known)],
        ([name, *(text_of(numbers[key]) for key in known)] for name, numbers in row.items()),
    )


def drawn_table(plants: Mapping[str, Drawn]) -> Iterator[str]:
    """Medians and quantiles of each controller over the drawn plants."""
    shown = _known(plants, _BANDS)
    yield from markdown_table(
        ["", "leave the tube", "failed", *(_ALL[name] for name in shown)],
        (
            [name, str(each.outside), str(each.failed), *map(each.band, shown)]
            for name, each in plants.items()
        ),
    )
    yield ""
    yield "Median over the plants, with the 5 % and 95 % quantiles in brackets."


def _known(plants: Mapping[str, Drawn], names: Sequence[str]) -> list[str]:
    """Quantities that a plant has: one of the user's own has no distance, say."""
    return [n for n in names if any(np.isfinite(p.values[n]).any() for p in plants.values())]


def interval_table(plants: Mapping[str, Drawn], ranked: Sequence[str]) -> Iterator[str]:
    """Intervals of shares and of medians of `ranked`, and comparisons with the first controller."""
    first, ranked = next(iter(plants)), _known(plants, ranked)
    compared = ("error_integral", "input_integral")

    def row(name: str, each: Drawn) -> Iterator[str]:
        yield name
        yield _interval(*each.outside_share)
        yield from (_interval(*each.median(key)) for key in ranked)
        for key in compared:
            rows = np.array([plants[first].values[key], each.values[key]])
            share = share_interval(int(less(rows)[1, 0]), rows.shape[1])
            yield "–" if name == first else _interval(*share)

    yield from markdown_table(
        [
            "",
            "share that leaves the tube",
            *(f"median {_ALL[key]}" for key in ranked),
            *(f"less {_ALL[key]} than {first}" for key in compared),
        ],
        ([*row(name, each)] for name, each in plants.items()),
    )
    yield ""
    yield (
        f"Intervals of {LEVEL:.0%}: of shares by Clopper and Pearson, of medians by order "
        "statistics; failed plants rank worst. The last two columns give the share of plants on "
        "which the controller has the lower value than the first, compared plant by plant."
    )


def _interval(low: float, high: float) -> str:
    return f"[{text_of(low)}, {text_of(high)}]"


def known_table(
    plants: Mapping[str, Drawn], known: Mapping[str, Drawn], count: int, weight: float
) -> Iterator[str]:
    """Means over the plants for which every plan was found, so that rows are comparable.

    `known` are plans made with the true parameters of the first `count` plants; `weight` is that of
    |u|² in the cost.
    """
    found = {name: each for name, each in known.items() if each.failed < count}
    whole = np.all([np.isfinite(each.values["distance"]) for each in found.values()], axis=0)
    whole = np.broadcast_to(whole, (count,))
    rows = {f"{name}, plant known": each for name, each in found.items()}
    rows |= {name: each.first(count) for name, each in plants.items()}

    def mean(each: Drawn, key: str) -> float:
        return float(np.mean(each.values[key][whole])) if whole.any() else np.nan

    def cells(each: Drawn) -> Iterator[float]:
        yield mean(each, "error_integral") + weight * mean(each, "input_integral")
        yield from (
            mean(each, key) for key in ("input_integral", "time_outside_tube", "mean_speed")
        )

    yield from markdown_table(
        ["", "∫\\|e\\|² + ρ\\|u\\|²", "∫\\|u\\|²", "time outside", "mean speed"],
        ([name, *map(text_of, cells(each))] for name, each in rows.items()),
    )
    yield ""
    lost = ", ".join(f"{name} {each.failed}" for name, each in known.items())
    yield (
        f"Means over the {int(whole.sum())} plants of {count} for which every plan was found. "
        f"Plans not found: {lost}. ρ = {weight:g}."
    )
