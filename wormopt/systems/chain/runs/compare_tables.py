"""Markdown tables of a comparison: all controllers, drawn plants, known plants."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from wormopt.systems.chain.certainty import LEVEL, less, median_interval, share_interval
from wormopt.systems.chain.scenes.compare_tracking import RANKED, CompareScene


@dataclass(frozen=True, eq=False)
class Drawn:
    """Quantities of one controller on the drawn plants."""

    values: dict[str, np.ndarray]  # (members,) by name; NaN: not simulated or nothing happens
    failed: int  # how many could not be simulated

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

    def quantiles(self, name: str, *shares: float) -> list[float]:
        """Quantiles, at `shares` from 0 to 1, of a quantity over the plants that were simulated."""
        values = self.values[name][np.isfinite(self.values[name])]
        return [float(np.quantile(values, s)) if values.size else np.nan for s in shares]


@dataclass(frozen=True, eq=False)
class Known:
    """A plan made with the true parameters of each known plant."""

    name: str  # which plan
    drawn: Drawn  # of these plants; ``failed``: for which none was found


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


def table_of(
    table: CompareScene,
    references: Sequence[str],
    numbers: Sequence[Mapping[str, Mapping[str, float | None]]],
    drawn: Sequence[Mapping[str, Drawn]],
    known: Sequence[Known],
) -> str:
    """Markdown with all figures.

    By reference and controller, `numbers` belong to the nominal plant and `drawn` to the other
    plants. `known` are the plans with true parameters for the first reference.
    """
    lines: list[str] = []
    for name, row, plants in zip(references, numbers, drawn, strict=True):
        lines += ["", f"## {name}: the nominal plant", "", *_nominal(row)]
        lines += ["", f"## {name}: {_plants(table)}", "", *_draws(plants)]
        lines += ["", f"## {name}: intervals over the plants", "", *_certain(plants)]
    if table.draws.known:
        count = table.draws.known
        lines += [
            "",
            f"## {references[0]}: plans with the true parameters of {count} of these plants",
            "",
        ]
        lines += _knowledge(table, drawn[0], known)
    return "\n".join([*_legend(table), *lines, ""])


def _plants(table: CompareScene) -> str:
    return f"{table.draws.members} plants, ±{table.draws.spread:.0%}"


def _legend(table: CompareScene) -> list[str]:
    capture = f"{table.tube.capture:g}"
    return [
        f"λ = {table.tube.radius:g}, time 0 to {table.time.end:g}. Time outside the tube and the "
        f"largest |e| count from t = {capture} on. Work spent is the positive power of each "
        "actuator over time, without recovery; net work includes the power that flows back. Cost "
        "of transport is work spent over total mass and distance. One simulator with exact "
        "contact computes all motions.",
        *_measured(table),
    ]


def _measured(table: CompareScene) -> Iterator[str]:
    measurement = table.measurement
    if measurement is not None and not measurement.exact:
        yield ""
        yield (
            f"Measurements have a delay of {measurement.delay:g} and noise of "
            f"{measurement.noise:g} on samples every {measurement.interval:g}."
        )


def _nominal(row: Mapping[str, Mapping[str, float | None]]) -> Iterator[str]:
    yield from head_of(["", *_COLUMNS.values()])
    for name, values in row.items():
        yield line_of([name, *(text_of(values[key]) for key in _COLUMNS)])


def _draws(plants: Mapping[str, Drawn]) -> Iterator[str]:
    yield from head_of(
        ["", "leave the tube", "failed", "time outside", "largest \\|e\\|", "∫\\|e\\|²", "u rms",
         "distance"]
    )  # fmt: skip
    for name, each in plants.items():
        bands = [
            _band(each, key)
            for key in ("time_outside_tube", "error_peak", "error_integral", "input_rms",
                        "distance")
        ]  # fmt: skip
        yield line_of([name, str(each.outside), str(each.failed), *bands])
    yield ""
    yield "Median over the plants, with the 5 % and 95 % quantiles in brackets."


def _certain(plants: Mapping[str, Drawn]) -> Iterator[str]:
    first = next(iter(plants))
    yield from head_of(
        ["", "share that leaves the tube", *(f"median {_ALL[n]}" for n in RANKED),
         f"less ∫\\|e\\|² than {first}", f"less ∫\\|u\\|² than {first}"]
    )  # fmt: skip
    for k, (name, each) in enumerate(plants.items()):
        medians = [_interval(*each.median(n)) for n in RANKED]
        shares = []
        for number in ("error_integral", "input_integral"):
            rows = np.array([plants[first].values[number], each.values[number]])
            better = share_interval(int(less(rows)[1, 0]), rows.shape[1])
            shares.append(_interval(*better) if k else "–")
        yield line_of([name, _interval(*each.outside_share), *medians, *shares])
    yield ""
    yield (
        f"Intervals of {LEVEL:.0%}: of shares by Clopper and Pearson, of medians by order "
        "statistics; failed plants rank worst. The last two columns give the share of plants on "
        "which the controller has the lower value than the first, compared plant by plant."
    )


def _interval(low: float, high: float) -> str:
    return f"[{text_of(low)}, {text_of(high)}]"


def _knowledge(
    table: CompareScene, plants: Mapping[str, Drawn], known: Sequence[Known]
) -> Iterator[str]:
    """Means over the plants for which every plan was found, so that rows are comparable."""
    weight, count = table.optimal.input_weight if table.optimal else 0.0, table.draws.known
    found = [each for each in known if each.drawn.failed < count]
    whole = np.all([np.isfinite(k.drawn.values["distance"]) for k in found], axis=0)
    whole = np.broadcast_to(whole, (count,))
    rows = {f"{k.name}, plant known": k.drawn for k in found}
    rows |= {name: _first(each, count) for name, each in plants.items()}
    yield from head_of(["", "∫\\|e\\|² + ρ\\|u\\|²", "∫\\|u\\|²", "time outside", "mean speed"])
    for name, each in rows.items():
        means = {
            key: float(np.mean(each.values[key][whole])) if whole.any() else np.nan
            for key in ("error_integral", "input_integral", "time_outside_tube", "mean_speed")
        }
        cost = means["error_integral"] + weight * means["input_integral"]
        shown = [cost, *(means[k] for k in ("input_integral", "time_outside_tube", "mean_speed"))]
        yield line_of([name, *map(text_of, shown)])
    yield ""
    lost = ", ".join(f"{k.name} {k.drawn.failed}" for k in known)
    yield (
        f"Means over the {int(whole.sum())} plants of {count} for which every plan was found. "
        f"Plans not found: {lost}. ρ = {weight:g}."
    )


def _first(drawn: Drawn, count: int) -> Drawn:
    return Drawn({k: v[:count] for k, v in drawn.values.items()}, 0)


def _band(each: Drawn, name: str) -> str:
    middle, low, high = each.quantiles(name, 0.5, 0.05, 0.95)
    return f"{text_of(middle)} [{text_of(low)}, {text_of(high)}]"


def head_of(names: Sequence[str]) -> Iterator[str]:
    """Head of a table with a left-aligned first column."""
    yield line_of(names)
    yield line_of(["---", *["---:"] * (len(names) - 1)])


def line_of(cells: Sequence[str]) -> str:
    """Line of a table."""
    return "| " + " | ".join(cells) + " |"


def text_of(value: float | None) -> str:
    """The number with three digits."""
    if value is None or not np.isfinite(value):
        return "never" if value is None else "–"
    return f"{value:.3g}" if abs(value) < 100 else f"{value:.0f}"
