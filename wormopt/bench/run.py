"""`wormopt bench`: measure cases, print tables, write pictures."""

from __future__ import annotations

import math
import platform
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import TYPE_CHECKING, Any

import casadi as ca

from wormopt.bench.cases import GOAL, WORK_PRECISION, Case
from wormopt.bench.chain_length import LENGTHS, LONG, Length, measure_lengths, slope
from wormopt.bench.smoothing import WIDTHS, Smoothing, measure_smoothing, order
from wormopt.bench.work_precision import Effort, Record, measure, ratio
from wormopt.model.model import Model, Signal
from wormopt.progress import Report
from wormopt.simulation.simulate import simulate

if TYPE_CHECKING:
    from wormopt.bench.ocp import Timed


_QUICK = Effort(rounds=3, longest=0.5, slow=0.1, per_decade=1)
_LONGEST_EXACT = 200  # links; beyond, an exact run takes minutes
_PACKAGES = (
    *("casadi", "numpy", "scipy", "numba", "diffrax", "scikit-sundae", "heyoka"),
    *("rockit-meco", "yapss"),
)

Found = dict[str, Any]


def machine() -> dict[str, str]:
    """What the times depend on: processor, system, versions."""
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8", errors="replace").splitlines()
        model = next(line.split(":")[1].strip() for line in lines if line.startswith("model name"))
    except (OSError, StopIteration):
        model = platform.processor()
    found = {"processor": model, "system": platform.platform(), "python": platform.python_version()}
    for package in _PACKAGES:
        try:
            found[package] = version(package)
        except PackageNotFoundError:
            continue
    return found


def bench(name: str, *, quick: bool, folder: Path, report: Report) -> Iterator[Found]:
    """Measure a case of `wormopt.bench.CASES` and write its picture to `folder`.

    Yields what is known so far, ready for JSON; ``done`` is true once nothing is missing.
    `quick`: fewer tolerances and rounds, no solver that needs longer than half a second.
    """
    if name in WORK_PRECISION:
        yield from _work_precision(WORK_PRECISION[name], quick, folder, report)
    elif name == "smoothing":
        yield from _smoothing(quick, folder, report)
    elif name == "averaging":
        yield from _averaging(quick, folder, report)
    elif name == "ocp":
        yield from _ocp(quick, folder, report)
    elif name == "design":
        yield from _design(quick, folder, report)
    else:
        yield from _chain_length(quick, folder, report)


def _work_precision(case: Case, quick: bool, folder: Path, report: Report) -> Iterator[Found]:
    _compile_driver()
    records: list[Record] = []
    for records in measure(case, _QUICK if quick else Effort(), report):
        yield _described(case, records)
    picture = folder / f"{case.name}.png"
    from wormopt.bench.pictures import draw_records  # matplotlib, once there is something to draw

    draw_records(case, records, picture)
    yield _described(case, records) | {"picture": str(picture), "done": True}


def _compile_driver() -> None:
    """Compile what is compiled once a machine, so that first runs pay for their model alone."""
    x = ca.SX.sym("x")
    simulate(Model("decay", x=[Signal("x", x, value=1.0)], ode=-x), 1.0)


def _described(case: Case, records: Sequence[Record]) -> Found:
    known = {record.solver: record for record in records}
    targets = []
    for target in case.targets:
        value = ratio(known, target)
        targets.append(
            {
                "than": list(target.than),
                "most": target.most,
                "ratio": _number(value),
                "met": None if math.isnan(value) else value <= target.most,
            }
        )
    return {
        "case": case.name,
        "title": case.title,
        "source": case.source,
        "goal": GOAL,
        "solvers": [_solver(record) for record in records],
        "targets": targets,
        "done": False,
    }


def _solver(record: Record) -> Found:
    return {
        "solver": record.solver,
        "first_s": _number(record.first),
        "time_s": _number(record.time),
        "points": [
            {"tolerance": p.tolerance, "error": p.error, "time_s": p.time, "runs": len(p.times)}
            for p in record.points
        ],
        "failures": record.failures,
        "missing": record.missing,
    }


def _number(value: float) -> float | None:
    return None if math.isnan(value) else value


def _chain_length(quick: bool, folder: Path, report: Report) -> Iterator[Found]:
    smooth = [n for n in LENGTHS if n <= (200 if quick else LENGTHS[-1])]
    exact = [n for n in smooth if n <= _LONGEST_EXACT]
    known: list[Length] = []
    for found in measure_lengths({"smooth": smooth, "exact": exact}, 3 if quick else 5, report):
        known = found
        yield _lengths(known)
    picture = folder / "chain_length.png"
    from wormopt.bench.pictures import draw_lengths

    draw_lengths(known, picture)
    yield _lengths(known) | {"picture": str(picture), "done": True}


def _lengths(found: Sequence[Length]) -> Found:
    rows = [asdict(c) | {"step": _number(c.step)} for c in found]
    slopes = {contact: _number(slope(found, contact)) for contact in ("smooth", "exact")}
    return {"case": "chain_length", "lengths": rows, "slopes": slopes, "done": False}


def _smoothing(quick: bool, folder: Path, report: Report) -> Iterator[Found]:
    known: list[Smoothing] = []
    for found in measure_smoothing(WIDTHS[:6] if quick else WIDTHS, report):
        known.append(found)
        yield _widths(known)
    picture = folder / "smoothing.png"
    from wormopt.bench.pictures import draw_smoothing

    draw_smoothing(known, picture)
    yield _widths(known) | {"picture": str(picture), "done": True}


def _widths(found: Sequence[Smoothing]) -> Found:
    rows = [asdict(s) for s in found]
    return {"case": "smoothing", "widths": rows, "order": _number(order(found)), "done": False}


def _averaging(quick: bool, folder: Path, report: Report) -> Iterator[Found]:
    from wormopt.bench.averaging import draw_averages, measure_averages, measure_curve

    known, found = [], {"case": "averaging", "averages": [], "done": False}
    for timed in measure_averages(quick, report):
        known.append(timed)
        found["averages"] = [asdict(t) for t in known]
        yield found
    report("averaging: resonance curve", 0.95)
    picture = folder / "averaging.png"
    draw_averages(known, picture)
    yield found | {"curve": asdict(measure_curve()), "picture": str(picture), "done": True}


def _ocp(quick: bool, folder: Path, report: Report) -> Iterator[Found]:
    from wormopt.bench.ocp import grids, measure_ocp

    known: list[Timed] = []
    for known in measure_ocp(grids(quick=quick), 5 if quick else 25, report):
        yield _times(known)
    picture = folder / "ocp.png"
    from wormopt.bench.pictures import draw_times

    draw_times(known, picture)
    yield _times(known) | {"picture": str(picture), "done": True}


def _times(known: Sequence[Timed]) -> Found:
    from wormopt.bench.ocp import MOST, THAN, solve_ratio

    rows = [
        {
            "solver": t.solver,
            "grid": t.grid,
            "build_s": _number(t.build),
            "solve_s": _number(t.solve),
            "error": _number(t.error),
            "iterations": t.iterations,
            "functions_s": t.functions_s,
            "missing": t.missing,
        }
        for t in known
    ]
    ratios = {t.grid: solve_ratio(known, t.grid) for t in known}
    targets = [
        {"grid": grid, "than": THAN, "most": MOST, "ratio": ratio, "met": ratio <= MOST}
        for grid, ratio in ratios.items()
        if not math.isnan(ratio)
    ]
    return {"case": "ocp", "times": rows, "targets": targets, "done": False}


def _design(quick: bool, folder: Path, report: Report) -> Iterator[Found]:
    from wormopt.bench.design import described, measure_design, posed

    known, problems = [], posed(quick=quick)
    for known in measure_design(problems, 4.0 if quick else 30.0, report):
        yield described(known)
    picture = folder / "design.png"
    from wormopt.bench.pictures import draw_gaps

    draw_gaps(known, picture)
    yield described(known) | {"picture": str(picture), "done": True}


# -- text --------------------------------------------------------------------------------------


def table(found: Mapping[str, Any]) -> str:
    """Lay out for readers what is known of a case, as yielded by `bench`."""
    if "widths" in found:
        lines = _widths_table(found)
    elif "averages" in found:
        lines = _averages_table(found)
    elif "times" in found:
        lines = _times_table(found)
    elif "attempts" in found:
        lines = _attempts_table(found)
    else:
        lines = _lengths_table(found) if "lengths" in found else _solvers_table(found)
    if not found["done"]:
        lines.append("  (unfinished)")
    return "\n".join(lines)


def _solvers_table(found: Mapping[str, Any]) -> list[str]:
    own = next((s["time_s"] for s in found["solvers"] if s["solver"] == "wormopt"), None)
    rows = [("solver", "first run", f"time at {GOAL:.0e}", "ours/theirs", "best error", "failed")]
    notes = []
    for s in found["solvers"]:
        if s["missing"]:
            notes.append(f"  {s['solver']}: {s['missing']}")
            continue
        best = min((p["error"] for p in s["points"]), default=None)
        share = f"{own / s['time_s']:.4f}" if own and s["time_s"] else ""
        rows.append(
            (
                s["solver"],
                _seconds(s["first_s"]),
                _seconds(s["time_s"], "not reached"),
                share,
                f"{best:.0e}" if best is not None else "",
                str(len(s["failures"])) if s["failures"] else "",
            )
        )
        notes += [f"  {s['solver']} failed at {failure}" for failure in s["failures"]]
    lines = [f"{found['case']}: {found['title']}", f"  reference: {found['source']}"]
    lines += _aligned(rows) + notes
    for target in found["targets"]:
        than = " or ".join(target["than"])
        if target["ratio"] is None:
            lines.append(f"  target: at most {target['most']:.4g} of {than}: unknown")
            continue
        met = "met" if target["met"] else "missed"
        lines.append(f"  target: at most {target['most']:.4g} of {than}: "
                     f"{target['ratio']:.4g}, {met}")  # fmt: skip
    return lines


def _lengths_table(found: Mapping[str, Any]) -> list[str]:
    rows = [("links", "contact", "first run", "a step", "steps", "events", "")]
    rows += [
        (
            str(c["links"]),
            c["contact"],
            _seconds(c["first"]),
            _seconds(c["step"]),
            str(c["steps"]),
            str(c["events"]),
            c["failure"],
        )
        for c in found["lengths"]
    ]
    lines = ["chain_length: cost of a step against the number of links", *_aligned(rows)]
    for contact, value in found["slopes"].items():
        if value is not None:
            lines.append(f"  {contact}: a step costs n^{value:.2f} from n = {LONG} on")
    return lines


def _times_table(found: Mapping[str, Any]) -> list[str]:
    rows = [("grid", "solver", "build", "solve", "iterations", "in functions", "error")]
    notes = []
    for t in found["times"]:
        if t["missing"]:
            notes.append(f"  {t['solver']} on {t['grid']}: {t['missing']}")
            continue
        if t["error"] is None:
            continue
        rows.append(
            (
                t["grid"],
                t["solver"],
                _seconds(t["build_s"]),
                _seconds(t["solve_s"]),
                str(t["iterations"] or ""),
                _seconds(sum(t["functions_s"].values()) or None),
                f"{t['error']:.1e}",
            )
        )
    lines = ["ocp: the fastest slide, smooth law with v_reg = 1/40", *_aligned(rows), *notes]
    for target in found["targets"]:
        met = "met" if target["met"] else "missed"
        lines.append(
            f"  target, {target['grid']}: solve at most {target['most']:g} of {target['than']}: "
            f"{target['ratio']:.3g}, {met}"
        )
    return lines


def _attempts_table(found: Mapping[str, Any]) -> list[str]:
    solvers = list(dict.fromkeys(r["solver"] for r in found["reached"]))
    rows = [("within", "problems", *solvers, "ours/theirs")]
    for entry in found["ratios"]:
        told = [r for r in found["reached"] if r["accuracy"] == entry["accuracy"]]
        if not told:  # no bound is so sharp
            continue
        cells = [f"{_seconds(r['time_s'], 'not reached')}, {r['share']:.0%}" for r in told]
        ratio = "" if entry["ratio"] is None else f"{entry['ratio']:.3g}"
        rows.append((f"{entry['accuracy']:.1%}", str(told[0]["problems"]), *cells, ratio))
    count = len({a["problem"] for a in found["attempts"]})
    lines = [f"design: {count} problems, median time and share that came so near", *_aligned(rows)]
    lines.append("  of the problems whose certified bound is sharp enough to tell")
    for a in found["attempts"]:
        if a["wrong"] or a["failure"]:
            why = a["failure"] or f"speed {a['best']:.9g} above the ceiling {a['ceiling']:.9g}"
            lines.append(f"  {a['solver']} on {a['problem']}: {why}")
    return lines


def _averages_table(found: Mapping[str, Any]) -> list[str]:
    rows = [("method", "effort", "error", "an evaluation")]
    rows += [
        (a["method"], f"{a['effort']:g}", f"{a['error']:.1e}", _seconds(a["seconds"]))
        for a in found["averages"]
    ]
    lines = ["averaging: mean rates of the pair, error over eps against (18)", *_aligned(rows)]
    if "curve" in found:
        c = found["curve"]
        lines.append(
            f"  steady states and a curve of {c['points']} points: first {_seconds(c['first'])}, "
            f"again {_seconds(c['warm'])}; averaging {_seconds(c['build'])}; error {c['error']:.0e}"
        )
    return lines


def _widths_table(found: Mapping[str, Any]) -> list[str]:
    widths = found["widths"]
    rows = [("v_reg", "difference", "steps")]
    rows += [(f"{s['v_reg']:.1e}", f"{s['difference']:.2e}", str(s["steps"])) for s in widths]
    rows += [("exact", f"{s['events']} events", str(s["exact_steps"])) for s in widths[:1]]
    lines = ["smoothing: difference of the smooth from the exact motion", *_aligned(rows)]
    if found["order"] is not None:
        lines.append(f"  the difference goes like v_reg^{found['order']:.2f} below 1e-2")
    return lines


def _aligned(rows: Sequence[tuple[str, ...]]) -> list[str]:
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    return [
        "  " + "  ".join(c.ljust(w) for c, w in zip(row, widths, strict=True)).rstrip()
        for row in rows
    ]


def _seconds(value: float | None, missing: str = "") -> str:
    if value is None:
        return missing
    for unit, size in (("s", 1.0), ("ms", 1e-3)):
        if value >= size:
            return f"{value / size:.3g} {unit}"
    return f"{value / 1e-6:.3g} us"
