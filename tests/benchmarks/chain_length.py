"""Driven chains of ever more links n: the cost of a step should grow like n."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from functools import partial
from pathlib import Path
from statistics import median
from typing import Any

from tests.benchmarks.memory import growth, megabytes
from tests.benchmarks.run import Found, aligned, axes, curve, exponent, save, seconds, timed
from tests.oracles.driven_chain import DrivenChain, Grip
from wormopt.errors import SolveError
from wormopt.model.model import Model
from wormopt.progress import Report
from wormopt.simulation.options import Exact, Smooth, Tolerance
from wormopt.simulation.simulate import simulate
from wormopt.systems.spiked.construct import travelling_sine

LENGTHS = (2, 5, 10, 20, 50, 100, 200, 500, 1000)
"""Numbers of links."""

_LONG = 50  # links; from here on code and numbers no longer fit into the nearest cache
_LONGEST_EXACT = 200  # links; beyond, an exact run takes minutes
_TREATMENTS = {"smooth": Smooth(1 / 40), "exact": Exact()}
_TOLERANCE = Tolerance(1e-8, 1e-9)


def measured(_name: str, quick: bool, report: Report) -> Iterator[Found]:
    """Measure chains of all lengths; shorter ones only if `quick`."""
    smooth = [n for n in LENGTHS if n <= (200 if quick else LENGTHS[-1])]
    tasks = [("smooth", n) for n in smooth]
    tasks += [("exact", n) for n in smooth if n <= _LONGEST_EXACT]
    rows: list[Found] = []
    for k, (contact, links) in enumerate(tasks):
        report(f"chain of {links} links, {contact}", k / len(tasks))
        cost = _cost(links, contact, 3 if quick else 5)
        rows.append({"links": links, "contact": contact, **cost})
        slopes = {}
        for kind in _TREATMENTS:
            long = [c for c in rows if c["contact"] == kind and c["links"] >= _LONG and c["step"]]
            slopes[kind] = exponent([c["links"] for c in long], [c["step"] for c in long])
        yield {"lengths": rows, "slopes": slopes}


def long_chain(links: int) -> Model:
    """Chain of n links under a command that runs along it, with friction on every mass."""
    gait = travelling_sine(links, 1.0, lag=1 / min(links, 10))
    return DrivenChain.alike(gait, Grip(1.0, 3.0)).model()


def _cost(links: int, contact: str, rounds: int) -> Found:
    """Seconds from numbers to the end of the first run, and of a step in warm runs."""
    span = 2.0 if contact == "smooth" or links <= 100 else 0.5  # enough events by then
    chosen: Any = {"contact": _TREATMENTS[contact], "tolerance": _TOLERANCE, "route": "native"}
    built, model = timed(long_chain, links)

    def run() -> tuple[int, int, str]:
        try:
            motion = simulate(model, span, **chosen)
        except SolveError as error:
            return 0, 0, error.code
        return motion.n_steps + motion.n_rejected, len(motion.events), ""

    (ran, (steps, events, failure)), memory = growth(partial(timed, run))
    times: list[float] = []
    while not failure and len(times) < rounds and sum(times) <= 10.0:
        times.append(timed(run)[0])
    step = median(times) / steps if times else None  # accepted or rejected
    counts = {"steps": steps, "events": events, "failure": failure}
    return {"first": built + ran, "memory": memory, "step": step, **counts}


# -- telling -------------------------------------------------------------------------------------


def ratios(_found: Mapping[str, Any]) -> dict[str, float]:
    """None: there is nobody beside us."""
    return {}


def lines(found: Mapping[str, Any]) -> list[str]:
    """The table, and the exponents."""
    rows = [("links", "contact", "first run", "memory", "a step", "steps", "events", "")]
    for c in found["lengths"]:
        times = seconds(c["first"]), megabytes(c["memory"]), seconds(c["step"])
        counts = str(c["steps"]), str(c["events"])
        rows.append((str(c["links"]), c["contact"], *times, *counts, c["failure"]))
    return [
        "chain_length: cost of a step against the number of links",
        *aligned(*rows),
        *(
            f"  {contact}: a step costs {_power(p)}"
            for contact, p in found["slopes"].items()
            if p is not None
        ),
    ]


def _power(slope: float) -> str:
    return f"n^{slope:.2f} from n = {_LONG} on"


def draw(found: Mapping[str, Any], path: Path) -> None:
    """Draw it to a PNG file."""
    from matplotlib.ticker import FixedLocator, NullLocator

    figure, left = axes("links n", "time of a step (s)")
    for k, (contact, slope) in enumerate(found["slopes"].items()):
        rows = [c for c in found["lengths"] if c["contact"] == contact and c["step"]]
        label = contact if slope is None else f"{contact}: {_power(slope)}"
        curve(left, k, rows, "links", "step", label=label)
    left.xaxis.set_major_locator(FixedLocator(sorted({c["links"] for c in found["lengths"]})))
    left.xaxis.set_major_formatter("{x:g}")
    left.xaxis.set_minor_locator(NullLocator())
    save(figure, path, "chain_length: cost of a step of a chain of n links")
