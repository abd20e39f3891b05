"""Run scenes of kind ``tracker-readings``: simulate all readings and compare them with the text."""

from __future__ import annotations

import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from wormopt.control.lambda_tracker import Feedback
from wormopt.model.friction import Coulomb
from wormopt.progress import Report
from wormopt.result import Check, Result
from wormopt.simulation.ensemble import simulate_ensemble
from wormopt.simulation.native.build import compiler
from wormopt.simulation.options import Tolerance
from wormopt.study.conclude import conclude
from wormopt.study.scene import Scene
from wormopt.study.types import per
from wormopt.systems.chain.measured import balance, chain_checks, chain_facts
from wormopt.systems.chain.readings import (
    SENTENCES,
    Course,
    Criteria,
    Example,
    Reading,
    Structure,
    as_model,
    build,
    ends,
    gait_of,
    readings,
    scenario,
    structure_of,
    supported,
)
from wormopt.systems.chain.runs.readings_table import csv_of, table_of
from wormopt.systems.chain.scenes.readings import ReadingsScene
from wormopt.systems.chain.tables import DerivativeTracker, FilterTracker
from wormopt.systems.chain.tracked import Tracked, watched
from wormopt.systems.shared.proof import (
    CrossCheck,
    accepted_error,
    cross_check,
    warnings_of_contact,
    warnings_of_motion,
)
from wormopt.systems.shared.settings import tolerance_of, treatment_of
from wormopt.systems.shared.signals import event_arrays, fitted, sample, simulate_whole
from wormopt.systems.spiked import gait_of_shape

TRACKERS: dict[Feedback, str] = {"filter": "tracker (14)", "derivative": "tracker (13)"}
"""Order of the published figures: tracker (14) left, tracker (13) right."""
# Readings differ by percents; the reading that is shown is simulated again, exactly.
_LOOSE = Tolerance(relative=1e-9, absolute=1e-10, max_steps=200_000)
# Mirror images are two integrations of one motion, with gains of up to 1e4 times the error.
_MIRRORED = 1e-5
_SAMPLES, _ENDS = 1001, 33


@dataclass(frozen=True, eq=False)
class _Found:
    """Results of every reading."""

    choices: np.ndarray  # (readings, keys) which entry
    numbers: dict[str, np.ndarray]  # (2, readings), by the names of variables
    supported: np.ndarray  # (readings, sentences)
    ends: np.ndarray  # (readings, 2) first and last


@np.errstate(all="ignore")  # values that are not finite are noticed where they matter
def run(scene: Scene[ReadingsScene], report: Report) -> Result:
    """Simulate and judge all readings; "failed" if checks of the shown reading disagree.

    Raises SceneError for a gait's file, SolveError if the motion of the shown reading stops early.
    """
    table, clock = scene.table, time.perf_counter()
    example, listed = _example(scene), readings(**_choices(table))
    courses = _simulate(table, example, listed, report)
    found = _judge(table, listed, courses)
    chosen = _best(found)
    shown = [_show(table, example, listed[chosen], name, report) for name in TRACKERS]
    simulated = time.perf_counter()
    tolerance = tolerance_of(table.tolerance)
    recheck = table.tolerance.recheck
    seconds = [
        cross_check(each.loop, each.motion, tolerance, recheck=recheck, report=report)
        for each in shown
    ]
    timings = {"simulate": simulated - clock, "recheck": time.perf_counter() - simulated}
    return _result(scene, example, listed, found, chosen, shown, seconds, timings)


def _example(scene: Scene[ReadingsScene]) -> Example:
    table, n = scene.table, scene.table.worm.links
    return Example(
        gait_of_shape(table.reference.gait, scene, "reference.gait"),
        np.array(per(table.worm.mass, n + 1)),
        np.array(per(table.worm.stiffness, n)),
        np.array(per(table.worm.damping, n)),
        table.tracker.tube_radius,
        table.tracker.gain_start,
        np.array(per(table.tracker.filter_start, n)),
        table.reference.shift,
    )


def _choices(table: ReadingsScene) -> dict[str, Sequence]:
    given: dict[str, Sequence] = {
        name: getattr(table.readings, name) for name in table.readings.__struct_fields__
    }
    rests = [None if value == "reference" else value for value in given["rest_length"]]
    return given | {"rest_length": rests}


def _criteria(table: ReadingsScene) -> Criteria:
    by = table.sentences
    return Criteria(by.strips, by.quick, by.window, by.settled, by.growing)


# -- all readings ----------------------------------------------------------------------------------


def _simulate(
    table: ReadingsScene, example: Example, listed: Sequence[Reading], report: Report
) -> dict[tuple[str, int], Course]:
    """Motions by tracker and reading; the signs of tracker (14) do not affect tracker (13)."""
    groups: dict[Structure, list[int]] = {}
    for name in TRACKERS:
        for k, reading in enumerate(listed):
            if name == "filter" or reading.signs == listed[0].signs:
                groups.setdefault(structure_of(reading, name), []).append(k)
    found: dict[tuple[str, int], Course] = {}
    for number, (structure, members) in enumerate(groups.items()):
        report("simulating readings", number / len(groups))
        own = [listed[k] for k in members]
        several = _courses(table, example, structure, own)
        found |= zip(((structure.feedback, k) for k in members), several, strict=True)
    alike = len(table.readings.signs)  # the key that varies fastest
    for k in range(len(listed)):
        found["derivative", k] = found["derivative", k - k % alike]
    return found


def _courses(
    table: ReadingsScene, example: Example, of: Structure, members: Sequence[Reading]
) -> Iterator[Course]:
    loop = build(example, of)
    times = np.linspace(0.0, table.time.end, _SAMPLES)
    # Positive feedback of the error grows beyond bounds; implicit steps are not worth their cost.
    explicit = "native" if compiler() else "python"
    herd = simulate_ensemble(
        loop,
        table.time.end,
        [scenario(example, each, of, loop) for each in members],
        contact=treatment_of(table.contact),
        times=times,
        tolerance=_LOOSE,
        route=explicit if of.unstable else "auto",
    )
    masses, gain = example.links + 1, 2 * (example.links + 1)  # gains follow positions and rates
    for reading, states in zip(members, herd.states, strict=True):
        wanted = gait_of(example, reading)(times + example.shift)
        yield Course(times, -np.diff(states[:masses], axis=0) - wanted, states[gain])


def _judge(
    table: ReadingsScene,
    listed: Sequence[Reading],
    courses: Mapping[tuple[str, int], Course],
) -> _Found:
    by, radius = _criteria(table), table.tracker.tube_radius
    said, lasting = [], []
    for k in range(len(listed)):
        pair = courses["derivative", k], courses["filter", k]
        said.append(list(supported(*pair, radius, by).values()))
        held = list(ends(*pair, radius, by, _ENDS)) if all(said[-1]) else []
        lasting.append((held[0], held[-1]) if held else (np.nan, np.nan))
    numbers = [
        [_numbers(courses[name, k], radius, by.window) for k in range(len(listed))]
        for name in TRACKERS
    ]
    lengths = [len(entries) for entries in _choices(table).values()]
    return _Found(
        np.array(np.unravel_index(np.arange(len(listed)), lengths)).T,
        {
            name: np.array([[each[name] for each in row] for row in numbers])
            for name in numbers[0][0]
        },
        np.array(said),
        np.array(lasting),
    )


def _numbers(course: Course, radius: float, window: float) -> dict[str, float]:
    return {
        "gain_middle": float(course.gain[len(course.gain) // 2]),
        "gain_end": float(course.gain[-1]),
        "gain_growth": course.growth(window),
        "error_peak": course.peak(window),
        "captured_outputs": course.captured(radius, "outputs", window),
        "captured_norm": course.captured(radius, "norm", window),
    }


def _departures(found: _Found) -> np.ndarray:
    return np.sum(found.choices > 0, axis=1)


def _best(found: _Found) -> int:
    """Index of the reading that is shown."""
    count, lasting = found.supported.sum(axis=1), np.nan_to_num(np.ptp(found.ends, axis=1))
    ranks = zip(-count, _departures(found), -lasting, range(len(count)), strict=True)
    return min(ranks)[-1]


# -- the reading that is shown -------------------------------------------------------------------


def _show(
    table: ReadingsScene, example: Example, reading: Reading, name: Feedback, report: Report
) -> Tracked:
    of = structure_of(reading, name)
    loop = build(example, of)
    loop = as_model(loop, scenario(example, reading, of, loop))
    told = (FilterTracker if name == "filter" else DerivativeTracker)(
        tube_radius=example.tube_radius
    )
    motion = simulate_whole(
        watched(loop, told),
        table.time.end,
        table.time.samples,
        treatment_of(table.contact),
        tolerance_of(table.tolerance),
        lambda _, fraction: report(f"simulating {TRACKERS[name]}", fraction),
    )
    return Tracked(TRACKERS[name], told, loop, motion)


def _result(
    scene: Scene[ReadingsScene],
    example: Example,
    listed: Sequence[Reading],
    found: _Found,
    chosen: int,
    shown: Sequence[Tracked],
    seconds: Sequence[CrossCheck | None],
    timings: Mapping[str, float],
) -> Result:
    table, tolerance = scene.table, tolerance_of(scene.table.tolerance)
    energies = [balance(each.motion) for each in shown]
    checks = list(_mirror(example, listed, found))
    for k, (each, second, energy) in enumerate(zip(shown, seconds, energies, strict=True)):
        checks += chain_checks(second, energy, tolerance, each.label)
        checks.append(_same(each, found.numbers["gain_end"][k, chosen]))
    counts, gains = found.supported.sum(axis=1), found.numbers["gain_end"]
    choices = _choices(table)
    told = {name: entries[k] for (name, entries), k in
            zip(choices.items(), found.choices[chosen], strict=True)}  # fmt: skip
    variables = {
        "reading_choice": found.choices,
        "supported": found.supported.astype(float),
        **found.numbers,
        "ends_first": found.ends[:, 0],
        "ends_last": found.ends[:, 1],
    }
    return conclude(
        scene,
        {
            "n_readings": len(listed),
            "n_supporting": int(np.sum(found.supported.all(axis=1))),
            "most_supported": int(counts.max()),
            "chosen": chosen,
            "chosen_departures": int(_departures(found)[chosen]),
            "chosen_gain": gains[:, chosen],
            "given_up": int(np.sum(np.isnan(gains))),
            "recheck_error": [second and second.error for second in seconds],
        },
        variables | _signals(shown),
        checks=checks,
        facts=chain_facts([each.motion for each in shown], seconds, tolerance, energies),
        warnings=_warnings(table, listed[chosen], shown, seconds),
        timings=timings,
        attributes={
            "trackers": list(TRACKERS.values()),
            "sentences": list(SENTENCES),
            "sentence_meanings": list(SENTENCES.values()),
            "choices": {name: list(entries) for name, entries in choices.items()},
            "chosen_reading": told,
            "table": table_of(table, choices, variables, chosen),
        },
    )


def as_csv(result: Result) -> str:
    """All readings, one per line, as the file ``readings.csv`` of a result."""
    return csv_of(result)


def _signals(shown: Sequence[Tracked]) -> dict[str, Any]:
    signals = [sample(each.motion, each.expressions) for each in shown]
    arrays = {name: np.array([s[name] for s in signals]) for name in signals[0]}
    first = shown[0]
    return {
        "time": first.motion.time,
        "reference": first.motion.observe(first.loop["reference"]),
        **fitted(arrays, ReadingsScene.variables),
        **event_arrays([each.motion for each in shown], several=True),
    }


def _same(each: Tracked, gain: float) -> Check:
    """Whether the shown motion agrees with the judged reading."""
    exact = float(each.motion["gain"][0, -1])
    off, accepted = abs(gain / exact - 1), accepted_error(_LOOSE)
    advice = (
        f"{each.label}: the gain of the judged reading differs from the exact gain by {off:.2g}"
    )
    return Check(f"{each.label}: gain as judged", off, accepted, advice)


def _mirror(example: Example, listed: Sequence[Reading], found: _Found) -> Iterator[Check]:
    """Mirror images have the same gains: F+ and F- exchanged, and the order of links."""
    places = {reading: k for k, reading in enumerate(listed)}
    pairs = [(k, places[image]) for reading, k in places.items()
             if (image := _image(reading)) in places and places[image] > k
             and _symmetric(example, reading)]  # fmt: skip
    if not pairs:
        return
    one, other = np.array(pairs).T
    gains = found.numbers["gain_end"]
    off = float(np.nanmax(abs(gains[:, one] / gains[:, other] - 1), initial=0.0))
    advice = f"the gains of {len(pairs)} pairs of mirror images differ by {off:.2g}"
    yield Check("mirror images", off, _MIRRORED, advice)


def _image(reading: Reading) -> Reading:
    links = "reversed" if reading.links == "printed" else "printed"
    forward, backward = reading.friction
    return Reading(**vars(reading) | {"links": links, "friction": (backward, forward)})


def _symmetric(example: Example, reading: Reading) -> bool:
    rows = (
        example.mass,
        example.stiffness,
        example.damping,
        example.filter_start,
        np.diff(reading.start),
    )
    return all(np.array_equal(row, row[::-1]) for row in rows)


def _warnings(
    table: ReadingsScene,
    chosen: Reading,
    shown: Sequence[Tracked],
    seconds: Sequence[CrossCheck | None],
) -> Iterator[str]:
    yield from warnings_of_contact(treatment_of(table.contact), [Coulomb(*chosen.friction)])
    for each, second in zip(shown, seconds, strict=True):
        yield from warnings_of_motion(each.motion, second)
