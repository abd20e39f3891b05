"""Cost of a step against the number of links of a chain: it should grow like n."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from statistics import median
from time import perf_counter

import numpy as np

from wormopt.bench.cases import long_chain
from wormopt.errors import SolveError
from wormopt.progress import Report
from wormopt.simulation.options import Exact, Smooth, Tolerance, Treatment
from wormopt.simulation.simulate import simulate

LENGTHS = (2, 5, 10, 20, 50, 100, 200, 500, 1000)
"""Numbers of links."""

LONG = 50
"""From here on a chain is long: code and numbers no longer fit into the nearest cache."""

_TREATMENTS: dict[str, Treatment] = {"smooth": Smooth(1 / 40), "exact": Exact()}
_TOLERANCE = Tolerance(1e-8, 1e-9)


@dataclass(frozen=True)
class Length:
    """What a chain of some length costs."""

    links: int
    contact: str  # "smooth" or "exact"
    first: float  # s, from numbers to the end of the first run: build, compile, run
    step: float  # s per step, accepted or rejected, in warm runs
    steps: int
    events: int
    failure: str = ""  # why there is no result


def measure_lengths(
    lengths: Mapping[str, Sequence[int]], rounds: int, report: Report
) -> Iterator[list[Length]]:
    """Measure chains of several lengths; yields the same list again, one longer each time.

    `lengths`: numbers of links for "smooth" and "exact"; `rounds`: warm runs, for a median.
    """
    found: list[Length] = []
    tasks = [(contact, links) for contact, all_links in lengths.items() for links in all_links]
    for k, (contact, links) in enumerate(tasks):
        report(f"chain of {links} links, {contact}", k / len(tasks))
        found.append(_measure(links, contact, rounds))
        yield found


def _measure(links: int, contact: str, rounds: int) -> Length:
    begin = perf_counter()
    model = long_chain(links)
    treatment = _TREATMENTS[contact]
    span = 2.0 if contact == "smooth" or links <= 100 else 0.5  # enough events by then

    def run() -> tuple[int, int]:
        motion = simulate(model, span, contact=treatment, tolerance=_TOLERANCE, route="native")
        return motion.n_steps + motion.n_rejected, len(motion.events)

    try:
        steps, events = run()
    except SolveError as error:
        return Length(links, contact, perf_counter() - begin, math.nan, 0, 0, error.code)
    first = perf_counter() - begin
    times = []
    for _ in range(rounds):
        begin = perf_counter()
        run()
        times.append(perf_counter() - begin)
        if sum(times) > 10.0:
            break
    return Length(links, contact, first, median(times) / steps, steps, events)


def slope(found: Sequence[Length], contact: str) -> float:
    """Exponent p of a step's cost ~ n^p, fitted to chains of `LONG` links and more.

    `contact` is "smooth" or "exact"; NaN where fewer than two chains count.
    """
    kept = [c for c in found if c.contact == contact and c.links >= LONG and c.step > 0]
    if len(kept) < 2:
        return math.nan
    n, time = np.log([c.links for c in kept]), np.log([c.step for c in kept])
    return float(np.polyfit(n, time, 1)[0])
