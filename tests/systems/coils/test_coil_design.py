"""Designed currents: patterns and their limits, rides by two routes, rivals, kind "coil-design"."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from outcomes import refusals

import wormopt as wo
from wormopt.magnetics.coils import Coil, CoilRow
from wormopt.magnetics.hydrostatics import Fluid, Linear
from wormopt.magnetics.travelling import shifted_course, switched_course
from wormopt.numerics.direct_search import evolve
from wormopt.numerics.workers import Engine, Workers, using
from wormopt.study.scene import load_scene
from wormopt.systems.coils import coil_design
from wormopt.systems.coils.design import Judged, Task, neighbours, starts_of
from wormopt.systems.coils.film import Float, Layer
from wormopt.systems.coils.patterns import (
    Form,
    Pattern,
    Rides,
    block,
    travel_by_radau,
    wave_pattern,
)
from wormopt.systems.coils.tables import Copper

OIL = Fluid(1200.0, 0.03, Linear(0.35))
ROW = CoilRow(Coil(2e-3, 4.5e-3, 20e-3, 1500.0), count=6, pitch=10e-3, gap=11e-3)
FILM = Layer(OIL, 0.05, 1e-3, 0.07, 28, start=-0.01)
RIDES = Rides(FILM, ROW, -0.5e-3, 4e-3, True, Float(0.012, 3.6e-3, 1e-6, edge=4e-3), 0.02, 1.0)
forms = st.sampled_from(["ramps", "steps"])


def random_pattern(seed: int, repeat: int, per_step: int, form: Form) -> Pattern:
    rng = np.random.default_rng(seed)
    values = rng.uniform(-2000.0, 2000.0, repeat * per_step)
    return Pattern(values, float(rng.uniform(0.3, 3.0)), per_step, form)


@given(
    seed=st.integers(0, 2**32 - 1), repeat=st.integers(3, 8), per_step=st.integers(1, 4), form=forms
)
def test_every_coil_has_its_neighbours_course_a_step_later(
    seed: int, repeat: int, per_step: int, form: Form
) -> None:
    pattern = random_pattern(seed, repeat, per_step, form)
    course = pattern.course(7)
    t = np.random.default_rng(seed).uniform(0, course.period, 40)
    now, later = course(t), course(np.mod(t + 1 / pattern.rate, course.period))
    assert later[1:] == pytest.approx(now[:-1], abs=1e-6)


@given(
    seed=st.integers(0, 2**32 - 1), per_step=st.integers(1, 4), form=forms,
    slew=st.one_of(st.none(), st.floats(10.0, 1e4)),
)  # fmt: skip
def test_limits_hold_at_all_times_and_not_only_at_corners(
    seed: int, per_step: int, form: Form, slew: float | None
) -> None:
    slew = None if form == "steps" else slew
    pattern = random_pattern(seed, 5, per_step, form).kept(1500.0, slew)
    course = pattern.course(6)
    t = np.linspace(0, course.period * (1 - 1e-12), 2001)
    values = course(t)
    assert np.abs(values).max() <= 1500.0 * (1 + 1e-9)
    assert np.abs(values).max() <= pattern.largest * (1 + 1e-9)
    if slew is not None:
        steepest = np.abs(np.diff(values) / np.diff(t)).max()
        assert steepest <= slew * (1 + 1e-6)
        assert steepest == pytest.approx(pattern.slew, rel=1e-6)


@given(seed=st.integers(0, 2**32 - 1), per_step=st.integers(1, 4), form=forms)
def test_the_mean_square_is_that_of_the_course(seed: int, per_step: int, form: Form) -> None:
    pattern = random_pattern(seed, 5, per_step, form)
    course = pattern.course(1)
    # Gauss's rule is exact on each piece
    nodes, weights = np.polynomial.legendre.leggauss(3)
    lengths = np.diff(course.breaks)
    t = course.breaks[:-1, None] + lengths[:, None] * (nodes + 1) / 2
    square = (course(t.ravel()).reshape(t.shape) ** 2 @ weights / 2) @ lengths / course.period
    assert pattern.square == pytest.approx(square, rel=1e-9)


def test_neighbours_are_within_the_limits(monkeypatch: pytest.MonkeyPatch) -> None:
    """Who sits at the largest rate is not told that a larger one were better."""
    monkeypatch.setattr(Rides, "speed", lambda _, pattern: pattern.rate)
    task = Task(RIDES, Copper(), "speed", "ramps", 1, (0.5, 2.0))
    at_the_end = Pattern(np.full(5, 1500.0), 2.0, 1)
    found = neighbours(task, at_the_end, 0.05, Workers(1))
    assert len(found) == 2 * 6
    assert max(one.speed for one in found) == 2.0
    assert min(one.speed for one in found) == pytest.approx(1.9)
    assert max(one.pattern.largest for one in found) == 1500.0


def test_courses_are_those_of_the_magnetics_room() -> None:
    """Blocks that jump are `switched_course`, polylines `shifted_course`."""
    mine, known = block(3, 1500.0, 0.5, 6, 2, "steps").course(6), switched_course(6, 1500.0, 0.5)
    t = np.linspace(0.01, 11.9, 57)
    assert mine(t) == pytest.approx(known(t))
    pattern = random_pattern(3, 5, 2, "ramps")
    known = shifted_course(pattern.values, 5 / pattern.rate, 1 / pattern.rate, 6)
    t = np.linspace(0, 0.999 * known.period, 61)
    assert pattern.course(6)(t) == pytest.approx(known(t), abs=1e-6)


def test_power_is_that_of_a_wire_wound_turn_by_turn() -> None:
    """N turns of a wire of the section fill times window over N, summed radius by radius."""
    row = CoilRow(Coil(2e-3, 4.5e-3, 20e-3), count=4, pitch=10e-3, gap=11e-3)
    turns, current = 2000, 0.7
    radii = 2e-3 + 2.5e-3 * (np.arange(turns) + 0.5) / turns
    section = 0.6 * 2.5e-3 * 20e-3 / turns
    resistance = 1.72e-8 * np.sum(2 * np.pi * radii) / section
    known = 2 * 4 * resistance * current**2
    always = Pattern(np.full(5, turns * current), 1.0, 1, "steps")
    assert Copper(resistivity=1.72e-8, fill=0.6).power(row, always) == pytest.approx(
        known, rel=1e-9
    )


def test_the_evolution_finds_optima_that_are_known() -> None:
    """A turned, stretched quadratic; a linear function, best in a corner of its bounds."""
    rng = np.random.default_rng(5)
    turn = np.linalg.qr(rng.standard_normal((6, 6)))[0]
    best, sizes = rng.uniform(-0.5, 0.5, 6), np.logspace(0, 1, 6)
    box = (np.full(6, -1.0), np.full(6, 1.0))
    found = evolve(
        lambda x: -np.sum((sizes * ((x - best) @ turn)) ** 2, axis=1), np.zeros(6), 0.3, box, 150
    )
    assert found.point == pytest.approx(best, abs=1e-4)
    assert np.all(np.diff(found.course) >= 0)
    corner = evolve(lambda x: x @ np.arange(1.0, 7.0), np.zeros(6), 0.3, box, 60)
    assert corner.value == pytest.approx(21.0, abs=1e-6)


def test_the_evolution_keeps_its_start_where_nothing_is_better() -> None:
    start = np.array([0.2, -0.3])
    box = (np.full(2, -1.0), np.full(2, 1.0))
    found = evolve(lambda x: np.where(np.all(x == start, axis=1), 0.0, -np.inf), start, 0.3, box, 5)
    assert found.value == 0.0
    assert found.point == pytest.approx(start)


@pytest.mark.slow
@pytest.mark.parametrize(("form", "rate"), [("ramps", 1.3), ("steps", 4.0)])
def test_rides_go_as_far_as_by_radau(form: Form, rate: float) -> None:
    pattern = block(3, 1500.0, rate, 5, 2, form)
    far = travel_by_radau(RIDES, pattern)
    rough, close = (
        replace(RIDES, tolerance=tolerance).speed(pattern) for tolerance in (1e-3, 1e-6)
    )
    assert abs(far) > 1e-3
    assert close == pytest.approx(far, abs=1e-6)
    assert rough == pytest.approx(far, abs=1e-4)


@pytest.mark.slow
def test_the_film_does_not_know_the_sign_of_all_currents() -> None:
    """The pull goes with H²."""
    pattern = random_pattern(8, 5, 2, "ramps").kept(1500.0)
    turned = replace(pattern, values=-pattern.values)
    assert RIDES.speed(turned) == pytest.approx(RIDES.speed(pattern), rel=1e-9)


@pytest.mark.slow
def test_films_that_leave_the_field_that_is_known_do_not_count() -> None:
    pattern = block(3, 1500.0, 1.3, 5, 2, "steps")
    assert replace(RIDES, top=1.05e-3).speed(pattern) == -np.inf


@pytest.mark.slow
def test_currents_by_the_mean_field_keep_limits_and_are_weaker_for_lower_waves() -> None:
    low, high = (wave_pattern(FILM, ROW, -0.5e-3, d, 1.0, 5, 2) for d in (0.2, 0.4))
    assert low is not None
    assert high is not None
    assert low.square < high.square
    assert high.largest <= 1500.0 * (1 + 1e-9)


@pytest.mark.slow
def test_the_packaged_scene_beats_mean_field_and_block_within_limits() -> None:
    short = [
        "coils.count=8", "time.end=3.0", "search.generations=6", "pattern.repeats=[5]",
        "grid.cells=8",
    ]  # fmt: skip
    result = wo.run(load_scene("coil_cargo_design", short))
    scalars = {name: scalar.value for name, scalar in result.scalars.items()}
    assert result.status == "ok", result.reason
    assert scalars["over_mean_field"] > 0.02
    assert scalars["over_block"] > 0.0
    assert scalars["currents_max"] <= 1500.0
    assert np.abs(result["current"].values).max() <= 1500.0 * (1 + 1e-9)


@pytest.mark.slow
def test_least_power_beats_mean_field_and_block_and_may_be_faster_than_asked() -> None:
    short = [
        "coils.count=7", "time.end=3.0", "search.generations=4", "pattern.repeats=[5]",
        "pattern.per_step=2", "pattern.form=steps", "search.starts=1", "grid.cells=12",
        'objective={seek="power", speed=4e-3}',
    ]  # fmt: skip
    result = wo.run(load_scene("coil_cargo_design", short))
    scalars = {name: scalar.value for name, scalar in result.scalars.items()}
    assert result.status == "ok", result.reason
    assert scalars["float_speed"] > 0.99 * 4e-3
    assert scalars["power"] < min(scalars["block_power"], scalars["mean_field_power"])
    assert scalars["currents_max"] <= 1500.0


@pytest.mark.slow
@pytest.mark.parametrize("count", [1, 2, 3, 4])
def test_as_many_searches_start_as_are_written(count: int) -> None:
    pattern = block(2, 1.0, 1.0, 5, 1, "steps")
    rivals = [
        Judged(pattern, name, value, 1.0, value)
        for name, value in (("wave", 4.0), ("wave", 3.0), ("block", 2.0), ("block", 1.0))
    ]
    found = [(one.name, one.value) for one in starts_of(rivals, count)]
    assert found == [("block", 2.0), ("wave", 4.0), ("wave", 3.0), ("block", 1.0)][:count]


@pytest.mark.parametrize(("speed", "gain"), [(2.0, 0.5), (0.0, None), (-1.0, None)])
def test_the_gain_over_a_rival_that_does_not_move_is_unknown(
    monkeypatch: pytest.MonkeyPatch, speed: float, gain: float | None
) -> None:
    monkeypatch.setattr(coil_design.CoilDesign, "float_speed", 3.0)
    assert wo.load("coil_cargo_design").gain_over(speed, 1.0) == gain


def test_a_rival_that_no_search_betters_is_the_design(monkeypatch: pytest.MonkeyPatch) -> None:
    """As where searches end, on the coarse grid, at currents that are worse on the fine one."""
    monkeypatch.setattr(coil_design, "search", lambda *_: [])
    short = ["coils.count=7", "time.end=2.0", "pattern.repeats=[5]", "grid.cells=8"]
    result = wo.run(load_scene("coil_cargo_design", short))
    overs = [result.scalars[name].value for name in ("over_mean_field", "over_block")]
    assert min(overs) == 0.0 <= max(overs)
    assert any("no search improved on the best" in text for text in result.trust["warnings"])


@pytest.mark.parametrize("seed", range(5))
def test_the_fine_grid_finds_the_best_of_each_sort_though_the_coarse_one_misleads(
    monkeypatch: pytest.MonkeyPatch, seed: int
) -> None:
    """Floats of half the patterns are lost on the fine grid, others are up to 3 % faster."""
    rng = np.random.default_rng(seed)
    own = [block(2, 1.0, 1.0, 5, 1, "steps") for _ in range(36)]
    coarse = [
        Judged(pattern, ("design", "block", "wave")[k % 3], value, 1.0, value)
        for k, (pattern, value) in enumerate(zip(own, rng.uniform(5.0, 8.0, 36), strict=True))
    ]
    lost, more = rng.integers(0, 2, 36), rng.uniform(0.99, 1.03, 36)
    fine = [replace(one, value=one.value * f * (1 - 0.3 * b)) for one, f, b in zip(
        coarse, more, lost, strict=True
    )]  # fmt: skip
    ridden = []

    def judge(_: Task, job: tuple[str, Pattern]) -> Judged:
        ridden.append(next(one for one in fine if one.pattern is job[1]))
        return ridden[-1]

    monkeypatch.setattr(Task, "judge", judge)
    with using(Engine("serial")):
        found = wo.load("coil_cargo_design").on_the_fine_grid(coarse)
    for sort in ("design", "block", "wave"):
        known, every = (
            max(one.value for one in judged if one.name == sort) for judged in (found, fine)
        )
        assert known == every
    assert len(set(ridden)) == len(ridden) < 36


test_what_cannot_be_is_refused = refusals(
    "coil_cargo_design",
    """
    objective.seek=power | objective.speed | needs the speed
    objective.speed=1.0 | objective.speed | leave it out
    pattern.form="steps" & pattern.slew=10.0 | pattern.slew | jump
    pattern.frequency=[2.0, 1.0] | pattern.frequency | smaller number first
    pattern.repeats=[20] | pattern.repeats | at most
    pattern.repeats=[] | pattern.repeats | one or more
    cargo.start=1.0 | cargo.start | not between the walls
    """,
)
