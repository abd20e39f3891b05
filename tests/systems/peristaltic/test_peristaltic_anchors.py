"""Peristaltic worms that anchor: waves, ceilings, quasi-static slides, the fastest gaits."""

from fractions import Fraction
from itertools import combinations, product

import numpy as np
import pytest
from effort import examples
from hypothesis import given, settings
from hypothesis import strategies as st
from outcomes import refusals

import wormopt as wo
from wormopt.errors import ArgumentError
from wormopt.pictures import figure
from wormopt.systems.peristaltic.anchored import (
    anchored_wave,
    anchors_needed,
    common_velocity,
    slides,
)
from wormopt.systems.peristaltic.anchored_fastest import (
    AnchorLimits,
    fastest,
    fastest_of_order,
    mode_bound,
)
from wormopt.systems.peristaltic.pictures import animation_of_anchors
from wormopt.systems.peristaltic.segment import Anchoring, Segment
from wormopt.systems.peristaltic.tables import Tube
from wormopt.systems.spiked.construct import block_wave
from wormopt.systems.spiked.crawl import crawl
from wormopt.systems.spiked.search.orders import ceiling as ceiling_of_spikes

# Ceilings over the rate by the number of anchors, from 1 on.
CEILINGS: dict[Anchoring, dict[int, str]] = {
    "clamp": {2: "0 0", 3: "1/2 0 0", 4: "1 1/3 0 0", 5: "3/2 2/3 1/4 0 0", 6: "2 1 1/2 1/5 0 0"},
    "mid": {2: "1/2 0", 3: "1 1/4 0", 4: "3/2 1/2 1/6 0", 5: "2 1 1/2 1/8 0",
            6: "5/2 3/2 3/4 3/8 1/10 0"},
}  # fmt: skip
SEGMENT, TUBE = Segment(20e-3, 5e-3, 0.3e-3, 20e3), Tube(5.05e-3, 0.3)
PRESSURE = 564.0

waves = st.integers(2, 9).flatmap(lambda n: st.tuples(st.just(n), st.integers(1, n - 1)))
sizes = st.floats(0.1, 10)


@pytest.mark.parametrize("anchoring", ["clamp", "mid"])
@pytest.mark.parametrize("segments", [2, 3, 4, 5, 6])
def test_ceilings(anchoring: Anchoring, segments: int):
    known = [float(Fraction(text)) for text in CEILINGS[anchoring][segments].split()]
    found = [mode_bound(segments, k + 1, (2.0, 2.0), anchoring).speed for k in range(segments)]
    assert found == pytest.approx(2 * np.array(known), abs=2e-9)


@pytest.mark.parametrize("segments", [3, 4, 5, 6])
def test_the_ceiling_of_clamped_segments_is_that_of_spikes_by_another_rule(segments: int):
    """Both rings of anchored segments rest. At equal rates two links fewer have the same."""
    for anchors in range(1, segments - 1):
        sets = [{*rest, *(j + 1 for j in rest)} for rest in combinations(range(segments), anchors)]
        for slow in (1.0, 0.7):
            own = mode_bound(segments, anchors, (1.0, slow)).speed
            rates = [1.0] * segments, [slow] * segments
            assert ceiling_of_spikes(*rates, anchors + 1, sets) == pytest.approx(own, rel=1e-8)
        fewer = [1.0] * (segments - 2)
        own = mode_bound(segments, anchors, (1.0, 1.0)).speed
        assert ceiling_of_spikes(fewer, fewer, anchors) == pytest.approx(own, rel=1e-8)


@settings(max_examples=examples(50))
@given(wave=waves, stroke=sizes, step=sizes)
def test_waves_of_any_length(wave: tuple[int, int], stroke: float, step: float):
    segments, short = wave
    gait = anchored_wave(segments, short, stroke, step)
    assert gait.displacements.sum(axis=0) == pytest.approx((segments - short) * stroke)
    assert gait.speed == pytest.approx((segments - short) * stroke / (segments * step))
    assert gait.faults().max() <= 1e-12 * stroke
    assert np.all((gait.lengths == 0).sum(axis=1) == short)
    assert gait.displacements.min() >= -1e-12 * stroke  # nothing goes back
    assert np.all(gait.anchored.sum(axis=1) == short - 1)
    assert np.array_equal(gait.anchored[1:], np.roll(gait.anchored, 1, axis=1)[:-1])  # to the tail
    if short > 1:
        assert gait.clearances() == pytest.approx(stroke)
        most = mode_bound(segments, short - 1, (stroke / step, stroke / step)).speed
        assert gait.speed <= most * (1 + 1e-9)


@settings(max_examples=examples(10))
@given(wave=waves)
def test_rigid_anchors_are_spikes_and_the_wave_is_that_of_a_block_at_rest(wave: tuple[int, int]):
    """Rings as masses with spikes crawl by the same lengths; segments as masses advance as far."""
    segments, short = wave
    gait = anchored_wave(segments, short, 1.0, 0.5)
    motion = crawl(gait.gait(2.0), [1.0] * (segments + 1), 0.0, 1e8)
    assert motion.advance == pytest.approx(gait.advance)
    links = block_wave(segments - 1, short, gait.period, (2.0, 3.0))
    block = crawl(links, [1.0] * segments, 0.0, 1e8)
    assert block.advance == pytest.approx(gait.advance)
    middles = (gait.displacements[:, 1:] + gait.displacements[:, :-1]) / 2
    assert middles.sum(axis=1) == pytest.approx(segments - short)  # N - m masses by a stroke each


@pytest.mark.parametrize(("short", "advance"), [(1, -1.0), (2, 0.5), (3, -0.5), (4, 1.0)])
def test_a_wave_on_even_ground_slides(short: int, advance: float):
    """Isotropic Coulomb friction at the middles: 5 segments, strokes a cycle."""
    gait = anchored_wave(5, short, 1.0, 1.0)
    assert gait.advance + slides(gait, 1.0, 1.0).sum(axis=0) == pytest.approx([advance] * 2)


def test_what_statics_does_not_tell_is_told():
    gait = anchored_wave(4, 2, 1.0, 1.0)  # middles move by 0, 1/2, 1/2, 1: between which is rest?
    assert np.ptp(slides(gait, 1.0, 1.0), axis=1) == pytest.approx(0)
    assert common_velocity(np.array([0.0, 1.0]), 1.0, 1.0) == (-1.0, 0.0)
    assert common_velocity(np.array([0.0, 1.0, 2.0]), 1.0, 2.0) == (-1.0, 0.0)
    with pytest.raises(ArgumentError, match="exceeds the friction, at most 2"):
        common_velocity(np.array([0.0, 1.0]), 1.0, 1.0, force=2.1)


frictions = st.tuples(st.floats(-3, 3), st.floats(0.1, 2), st.floats(0.1, 2))


@given(contacts=st.lists(frictions, min_size=1, max_size=6), share=st.floats(-0.95, 0.95))
def test_slides_dissipate_least(contacts: list[tuple[float, float, float]], share: float):
    """No other velocity dissipates less, and between the two told all dissipate the same."""
    v, ahead, back = np.array(contacts).T
    force = share * float(np.sum(ahead if share > 0 else back))

    def dissipated(common: float) -> float:
        moves = v + common
        return float(ahead @ np.maximum(moves, 0) + back @ np.maximum(-moves, 0) - force * common)

    low, high = common_velocity(v, ahead, back, force)
    least = dissipated(low)
    assert dissipated(high) == pytest.approx(least, abs=1e-9)
    others = np.concatenate([-v, np.linspace(-4, 4, 9)])
    assert min(map(dissipated, others.tolist())) >= least - 1e-9


def fastest_on_a_lattice(segments: int, anchors: int, levels: int) -> float:
    """Largest mean over cycles of gaits whose lengths change by 0 or a level in every step.

    What is short before and after a step rests. The most that steps can gain, by dynamic
    programming over all lengths; a multiple of all short cycles apart it grows by their mean.
    """
    states = np.array(list(product(range(levels + 1), repeat=segments)))
    moves = np.array(list(product((-1, 0, 1), repeat=segments)))
    base = (levels + 1) ** np.arange(segments - 1, -1, -1)
    edges: list[tuple[np.ndarray, ...]] = []
    for start in states:
        end = start + moves
        rests = (start == 0) & (end == 0)
        ways = np.pad(-np.cumsum(moves, axis=1), ((0, 0), (1, 0)))
        ways -= ways[np.arange(len(moves)), rests.argmax(axis=1)][:, None]
        held = ~np.any(rests & ((ways[:, 1:] != 0) | (ways[:, :-1] != 0)), axis=1)
        inside = np.all((end >= 0) & (end <= levels), axis=1)
        fits = held & inside & (rests.sum(axis=1) >= anchors)
        edges.append((np.full(fits.sum(), start @ base), end[fits] @ base, ways[fits, 0]))
    begin, end, gain = (np.concatenate(part) for part in zip(*edges, strict=True))
    most, steps = [np.zeros(len(states))], 60
    for _ in range(2 * steps):
        best = np.full(len(states), -1e9)
        np.maximum.at(best, begin, gain + most[-1][end])
        most.append(best)
    return float(most[-1].max() - most[steps].max()) / steps


LONG = [case for case in product((4, 5), (1, 2, 3), (0.5, 1.0)) if case[1] < case[0] - 1]


@pytest.mark.parametrize(
    ("segments", "anchors", "clearance"),
    [(3, 1, 1.0), (3, 1, 0.5), *(pytest.param(*case, marks=pytest.mark.slow) for case in LONG)],
)
def test_the_fastest_gait_is_that_of_the_lattice_and_proven(
    segments: int, anchors: int, clearance: float
):
    """With half a stroke the ceiling is reached, with a whole one what full strokes can do."""
    limits = AnchorLimits(segments, anchors, 1.0, clearance, (1.0, 1.0))
    found = fastest(limits, 6)
    known = fastest_on_a_lattice(segments, anchors, round(1 / clearance))
    assert found.gait.speed == pytest.approx(known, rel=1e-7)
    assert found.gap < 0.01
    assert found.bound >= found.gait.speed * (1 - 1e-9)
    assert found.gait.faults().max() < 1e-9
    assert found.gait.clearances().min() >= clearance - 1e-9
    wave = anchored_wave(segments, anchors + 1, 1.0, 1.0)
    assert found.gait.speed >= wave.speed * (1 - 1e-9)
    if clearance == 0.5:
        assert found.gait.speed == pytest.approx(found.ceiling, rel=1e-7)


@pytest.mark.slow
@pytest.mark.parametrize(("segments", "anchors"), [(3, 1), (4, 1), (4, 2), (5, 2), (5, 3)])
def test_between_half_a_stroke_and_a_whole_the_bound_is_met(segments: int, anchors: int):
    found = fastest(AnchorLimits(segments, anchors, 1.0, 0.7, (1.0, 1.0)), 6)
    assert found.gap < 1e-4
    assert found.gait.speed < found.ceiling * 0.9


def test_an_order_keeps_its_limits_at_unequal_rates():
    limits = AnchorLimits(4, 2, 0.5, 0.2, (1.0, 0.25))
    wave = anchored_wave(4, 3, 0.5, 2.0)
    gait = fastest_of_order(limits, wave.order)
    assert gait is not None
    assert wave.speed < gait.speed < limits.ceiling.speed
    allowed = gait.durations[:, None] + 1e-12
    assert np.all(gait.changes >= -allowed)
    assert np.all(gait.changes <= 0.25 * allowed)
    assert gait.lengths.max() <= 0.5 + 1e-12


def test_too_few_that_hold_are_refused_with_what_would_do():
    assert anchors_needed(5, 27.2e-3, 5.5e-3) == 1
    assert anchors_needed(5, 27.2e-3, 5.5e-3, reserve=1.5) == 2
    with pytest.raises(ArgumentError, match=r"0\.00366667 suffices"):
        anchors_needed(5, 1e-3, 5.5e-3)
    assert anchors_needed(5, 0.00366667, 5.5e-3) == 3
    with pytest.raises(ArgumentError, match="N - 2 = 3"):
        AnchorLimits(5, 4, 1.0, 0.5, (1.0, 1.0))


QUICK = ("want=[]", "worm.segments=3", "limits.reserve=1.0")


def test_the_scene():
    """Its numbers are the closed forms of the working set; three segments reach the ceiling."""
    result = wo.run(wo.load_scene("peristaltic_design", QUICK))
    assert result.status == "ok"
    found = {name: scalar.value for name, scalar in result.scalars.items()}
    assert found["shortest"] == pytest.approx(SEGMENT.length * TUBE.stretch_at_contact(SEGMENT))
    wall_force = TUBE.normal_force(SEGMENT, PRESSURE)
    assert found["hold"] == pytest.approx(TUBE.friction * wall_force, rel=1e-3)
    assert found["speed"] == pytest.approx(3.94e-3 / 2, rel=1e-7)
    assert found["wave_speed"] == pytest.approx(3.94e-3 / 3)
    assert found["clearance_min"] >= 0.02e-3 * (1 - 1e-9)
    advance = np.ptp(result["position"].values[:, [0, -1]], axis=1)
    assert advance == pytest.approx(found["advance"])


def test_the_worm_moves_in_its_picture():
    result = wo.run(wo.load_scene("peristaltic_design", QUICK))
    drawn = figure(result, "animation")
    (axes,) = drawn.axes
    before = axes.dataLim.x1
    animation_of_anchors.show(drawn, animation_of_anchors.frames - 1)
    assert axes.dataLim.x1 > before


test_scenes_and_worms_that_do_not_hold_are_refused = refusals(
    "peristaltic_design",
    """
    pipe.radius=4e-3 | pipe.radius | no room
    limits.clearance=0.06e-3 | limits.clearance | write at most that
    limits.anchors=4 | limits.anchors | at most 3
    pipe.wall_force=1e-3 & want=[] | pipe.wall_force | write at least 0.0183335
    limits.anchors=1 & want=[] | limits.anchors | write at least 2
    """,
)


def test_a_push_beyond_elastic_return_is_warned_of():
    result = wo.run(wo.load_scene("peristaltic_design", [*QUICK, "worm.push=1e-3"]))
    assert any("worm.push" in warning for warning in result.trust["warnings"])


@pytest.mark.parametrize(("drag", "spare"), [(0.01 * (1 - 1e-11), False), (0.009, True)])
def test_anchors_that_hold_just_what_they_must_are_warned_of(drag: float, spare: bool):
    """One of three holds 0.25 times 0.08 N, and two move."""
    tube = ["pipe.friction=0.25", "pipe.wall_force=0.08", f"worm.drag={drag}"]
    result = wo.run(wo.load_scene("peristaltic_design", [*QUICK, *tube]))
    assert result.status == "ok", result.reason
    assert result["reserve_min"].value == pytest.approx(0.02 / (2 * drag))
    told = any("the anchors have no reserve" in text for text in result.trust["warnings"])
    assert told is not spare
