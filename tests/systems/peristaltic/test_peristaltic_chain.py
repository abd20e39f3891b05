"""Worms of membrane segments: events against steps that know none, energies, symmetries, limits."""

import math
from dataclasses import replace

import casadi as ca
import numpy as np
import pytest
from outcomes import refusals

import wormopt as wo
from wormopt.control.drive import drive
from wormopt.errors import ArgumentError
from wormopt.magnetics.material import MU0
from wormopt.model.gait import Gait
from wormopt.model.model import Model, Signal, pack
from wormopt.model.schedule import Schedule
from wormopt.numerics.expressions import identically_zero
from wormopt.simulation.moreau import MoreauJean
from wormopt.simulation.options import Smooth, Tolerance
from wormopt.simulation.simulate import simulate
from wormopt.simulation.trajectory import Trajectory
from wormopt.study import load_scene
from wormopt.systems.peristaltic.chain import (
    Bed,
    Body,
    DragGround,
    DryGround,
    Ground,
    peristaltic_worm,
)
from wormopt.systems.peristaltic.crawl import (
    Anchors,
    crawl,
    energy_error,
    harmonic_wave,
    held,
    second_route,
    switched_wave,
)
from wormopt.systems.peristaltic.segment import Anchoring, Segment
from wormopt.systems.peristaltic.tables import Tube
from wormopt.systems.peristaltic.worm import Holding

SEGMENT = Segment(20e-3, 5e-3, 0.3e-3, 20e3)  # the set of numbers that works, theory section 6
MASS, DAMPING = 1200 * SEGMENT.volume, 0.15
FIELD = math.sqrt(2 * 564.0 / (MU0 * 0.35))  # of 564 Pa
TUBE = Tube(5.05e-3, 0.3)
BED = Bed(TUBE, 1e8)
QUICK = {"samples": 42, "relative": 1e-9}


def body(segments: int, **changed: float) -> Body:
    return Body([SEGMENT] * segments, MASS, DAMPING, **changed)  # type: ignore[arg-type]


def wave(segments: int, on: int = 1, *, retrograde: bool = True, step: float = 0.05) -> Gait:
    return switched_wave(segments, on, step=step, size=FIELD, retrograde=retrograde)


def follow(
    worm: Body, ground: Ground, course: Gait, anchoring: Anchoring = "mid", cycles: int = 1
) -> tuple[Model, Trajectory]:
    model = peristaltic_worm(worm, ground, anchoring)
    return model, crawl(model, course, cycles, nominal_work=worm.nominal_work, **QUICK)


# -- P9: two bodies in a tube, friction as it is given --------------------------------------------


class Spring:
    """A segment that is a spring of stiffness 1 and length 1; a coil adds its pressure to it."""

    length = radius = stiffness = volume = 1.0

    def radius_at(self, stretch: ca.SX) -> ca.SX:
        return 1.0 + 0 * stretch

    def energy(self, stretch: ca.SX) -> ca.SX:
        return (stretch - 1) ** 2 / 2

    def elastic_pull(self, stretch: ca.SX) -> ca.SX:
        return stretch - 1

    def coil_pull(self, _stretch: ca.SX, pressure: ca.SX) -> ca.SX:
        return -pressure


P9_BREAKS = np.array([0.0, 26.0, 52.0])


def two_bodies() -> tuple[Model, Signal]:
    """Masses of 1 at weight 1; friction coefficients are symbols, a field of 1 a pressure of 1."""
    limits = Signal("limits", ca.SX.sym("limits", 2))
    pair = Body([Spring()], 2.0, mu_r=1 + 2 / MU0, gravity=1.0)  # type: ignore[list-item]
    return peristaltic_worm(pair, DryGround(limits.symbol, limits.symbol), "clamp"), limits


def p9_values(rear: float) -> np.ndarray:
    """Limits of front and rear, and the coil, in both halves of a cycle."""
    return np.array([[0.07, rear, 1.0], [rear, 0.07, 0.0]])


P9 = [
    (1.2, [(1.02, 1.06), (2.12, 2.18), (3.24, 3.30)], {}),
    (
        0.6,
        [(0.79487971, 0.83174514), (1.62193311, 1.65905591), (2.44922158, 2.48634593)],
        {("ring 1", "stick"): 1.50528514, ("ring 1", "release"): 2.38438185,
         ("ring 0", "reversal"): 2.96945583},
    ),
]  # fmt: skip


@pytest.mark.parametrize(("rear", "ends", "events"), P9)
def test_two_bodies_in_a_tube_go_as_far_as_in_closed_form(
    rear: float, ends: list[tuple[float, float]], events: dict[tuple[str, str], float]
):
    model, limits = two_bodies()
    switched = ca.vertcat(limits.symbol, pack(model.u))
    parts = Schedule("coil", switched, ca.SX.sym("begin"), P9_BREAKS, p9_values(rear), True)
    motion = simulate(replace(model, u=[], schedules=[parts]), 156.0, times=[0, 52, 104, 156])
    ways = motion["position"] - motion["position"][:, :1]
    assert pytest.approx(np.array(ends), abs=6e-9) == ways[:, 1:].T
    for (name, kind), time in events.items():
        first = next(e.time for e in motion.events if (e.name, e.kind) == (name, kind))
        assert first == pytest.approx(time, abs=6e-9)


def test_they_go_as_far_by_steps_of_moreau_and_jean():
    model, limits = two_bodies()
    inputs, places = ca.SX.sym("u", 3), ca.SX.sym("q", 2)
    order = ca.vertcat(inputs[2], inputs[:2])
    marcher = MoreauJean(
        replace(model, u=[*model.u, limits]), inputs=ca.Function("i", [places, inputs], [order])
    )
    parts = Schedule("coil", inputs, ca.SX.sym("begin"), P9_BREAKS, p9_values(0.6), True)
    start, errors = np.array([0.0, -1.0, 0.0, 0.0]), []
    for step in (3.2e-3, 8e-4, 2e-4):
        end = marcher.march(156.0, start, schedule=parts, step=step).states[:2, -1]
        errors.append(np.abs(end - start[:2] - P9[1][1][-1]).max())
    assert errors[-1] < 1e-4
    assert 0.6 < np.log(errors[0] / errors[-1]) / np.log(16) < 1.6


# -- energy, second route -------------------------------------------------------------------------

GROUNDS = [
    (BED, "mid", {}),
    (BED, "clamp", {}),
    (DryGround(0.1, 0.3), "mid", {"load": 1e-3}),
    (DragGround(0.2, -1.0), "mid", {}),
]


@pytest.mark.parametrize(("ground", "anchoring", "changed"), GROUNDS)
def test_energy_is_balanced_and_steps_without_events_come_near_at_first_order(
    ground: Ground, anchoring: Anchoring, changed: dict[str, float]
):
    model, motion = follow(body(2, **changed), ground, wave(2), anchoring)
    assert energy_error(motion) < 1e-7
    for name in ("damping", "friction", "drag"):
        assert np.diff(motion[f"{name}_work"][0]).max() < 1e-18  # nothing of it comes back
    found = second_route(model, wave(2), motion)
    assert found.fine < 2e-3
    assert found.fine < 0.5 * found.coarse


@pytest.mark.parametrize(
    ("ground", "damping"), [(DragGround(50.0, -1.0), 0.0), (DryGround(0.1, 0.3), 20.0)]
)
def test_steps_of_the_second_route_are_stable_where_drag_or_damping_is_fast(
    ground: Ground, damping: float
):
    worm = Body([SEGMENT] * 2, MASS, damping)
    model, motion = follow(worm, ground, wave(2))
    found = second_route(model, wave(2), motion)
    assert found.fine < 0.5 * found.coarse < 1e-3


@pytest.mark.slow
def test_a_worm_that_rests_agrees_with_the_second_route():
    model, motion = follow(body(2), DryGround(1e3, 1e3), wave(2), "clamp")
    assert np.ptp(motion["position"], axis=1).max() == 0
    assert second_route(model, wave(2), motion).coarse < 1e-15  # rounding


def test_smooth_friction_tends_to_the_exact_one():
    worm, course = body(2), wave(2)
    exact = follow(worm, BED, course)[1].end[:3]
    driven = drive(peristaltic_worm(worm, BED), course, periodic=True)
    errors = []
    for width in (4e-5, 1e-5):
        smooth = simulate(driven, 0.1, contact=Smooth(width), tolerance=Tolerance(1e-8, 1e-9))
        errors.append(np.abs(smooth.end[:3] - exact).max())
    assert errors[1] < 0.5 * errors[0] < 1e-5


def test_a_harmonic_wave_is_held_for_ever_shorter_times():
    course = harmonic_wave(2, 0.25, period=0.1, size=FIELD, retrograde=True)
    model, motion = follow(body(2), DryGround(0.1, 0.3), course)
    found = second_route(model, course, motion)
    assert found.fine < 0.5 * found.coarse < 1e-2


# -- exact statements -----------------------------------------------------------------------------


@pytest.mark.parametrize("segments", [1, 2, 5])
def test_drag_that_does_not_depend_on_length_moves_nothing_whatever_the_gait(segments: int):
    """From the Model's own expressions: M x_c'' = -c0 sum u_j' and sum m_j u_j = M x_c.

    So the mean middle, at rest in the beginning, stays at rest. Masses and c0 are powers of 2: no
    number is rounded.
    """
    model = peristaltic_worm(Body([SEGMENT] * segments, 2.0, 0.5), DragGround(0.25, 0.0))
    v, pulled = model["velocity"], model.ode[segments + 1 :]
    drags = ca.vertcat(*(c.law.slip_force(c.velocity, 1) for c in model.contacts))
    middles = ca.sum1(v[:-1] + v[1:]) / 2
    braked = 2 * ca.jtimes(middles, v, ca.substitute(pulled, model.forces, drags)) + 0.25 * middles
    symbols = ca.vertcat(pack(model.x), pack(model.u))
    assert identically_zero(braked, symbols).all()
    masses = 2 * model["center"] * segments - ca.sum1(model["position"][:-1])
    masses -= ca.sum1(model["position"][1:])
    assert identically_zero(masses, symbols).all()


def test_a_wide_tube_is_open_ground():
    course, worm = wave(3), body(3)
    wide = follow(worm, Bed(Tube(1.0, 0.2), 1e8), course)[1]
    opened = follow(worm, DryGround(0.2, 0.2), course)[1]
    assert wide.end == pytest.approx(opened.end, rel=1e-12)
    assert wide["normal_force"].max() == 0.0


@pytest.mark.parametrize("anchoring", ["mid", "clamp"])
def test_a_mirrored_wave_moves_the_mirrored_worm(anchoring: Anchoring):
    motions = [follow(body(3), BED, wave(3, retrograde=way), anchoring)[1] for way in (True, False)]
    ways = [motion["position"] - motion["position"][:, :1] for motion in motions]
    assert ways[0] == pytest.approx(-ways[1][::-1], abs=1e-10)
    assert np.abs(ways[0]).max() > 1e-4


def test_as_the_wall_becomes_rigid_its_force_becomes_that_of_the_rigid_tube():
    """Balance of membrane, coil and wall; the difference is of the order 1 / k."""
    rigid = TUBE.normal_force(SEGMENT, 564.0)
    stretch, sizes, errors = ca.SX.sym("stretch"), 10.0 ** np.arange(8, 12), []
    for size in sizes:
        bed = Bed(TUBE, float(size))
        pull = SEGMENT.elastic_pull(stretch) + SEGMENT.coil_pull(stretch, 564.0)
        short = ca.rootfinder("f", "newton", {"x": stretch, "g": pull - bed.push(SEGMENT, stretch)})
        found = float(short(x0=0.999 * TUBE.stretch_at_contact(SEGMENT))["x"])
        errors.append(abs(bed.normal_force(SEGMENT, found) / rigid - 1))
    slopes = -np.diff(np.log10(errors))
    assert np.all((slopes > 0.97) & (slopes < 1.03))
    assert errors[-1] < 1e-4


# -- anchors --------------------------------------------------------------------------------------


def test_anchors_of_a_wave_are_those_that_are_on_in_two_steps():
    held_on = Anchors(wave(4, 2), 8).held(1)
    assert held_on[:, ::2].astype(int).T.tolist() == [
        [1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1],
    ]  # fmt: skip


@pytest.mark.parametrize("anchoring", ["mid", "clamp"])
def test_no_worm_beats_ideal_anchors_and_a_light_one_slips_little(anchoring: Anchoring):
    """Even without weight: what becomes short touches the wall before what is long is so."""
    course = wave(3, 2)
    _, motion = follow(body(3, gravity=0.05), BED, course, anchoring, cycles=3)
    center, anchors = motion["center"][0], Anchors(course, 42)
    ideal = SEGMENT.length * (1 - TUBE.stretch_at_contact(SEGMENT))
    assert 0.2 * ideal < center[-1] - center[84] < ideal
    assert anchors.slip(motion, 1) < 0.1 * ideal
    assert 0 <= anchors.reserve(motion, 1) < 1


@pytest.mark.slow
def test_a_long_worm_over_many_switches_is_balanced():
    course = wave(10, 3, step=0.1)
    _, motion = follow(body(10), BED, course, cycles=10)
    assert len(motion.system.model.breaks(motion.end_time)) == 101
    assert energy_error(motion) < 1e-7
    assert motion["center"][0, -1] > motion["center"][0, 0]


# -- scenes ---------------------------------------------------------------------------------------


def test_a_course_that_varies_is_held_at_its_middles():
    course = harmonic_wave(2, 0.5, period=1.0, size=2.0, retrograde=True)
    schedule = held(course, 4)
    assert schedule.values[:, 0] == pytest.approx(1 + np.cos(np.pi * (np.arange(4) + 0.5) / 2))
    assert schedule.values[:, 1] == pytest.approx(2 - schedule.values[:, 0])


SHORT = ["want=[]", "time.cycles=2", "time.settle=1"]


@pytest.mark.slow
def test_the_scene_in_a_tube_moves_against_its_wave():
    result = wo.run(load_scene("peristaltic_tube", SHORT))
    found = {name: scalar.value for name, scalar in result.scalars.items()}
    assert result.status == "ok", result.reason
    assert (found["against_wave"], found["coil_duty"]) == (1, 0.5)
    assert (found["holding_reserve"], found["slip"] > 0) == (0, True)
    assert any("holding_reserve is 0" in text for text in result.trust["warnings"])
    assert found["stroke"] == pytest.approx(20e-3 * (1 - 0.98029604941), rel=1e-9)
    assert found["loading"] == pytest.approx(0.47, rel=1e-3)
    assert 0 < found["advance"] < found["advance_ideal"] == pytest.approx(2 * found["stroke"])
    works = sum(found[f"{name}_work"] for name in ("coil", "damping", "friction"))
    stored = result["stored"].values
    assert works == pytest.approx(stored[-1] - stored[0], rel=1e-6)


@pytest.mark.slow
def test_the_scene_on_open_ground_moves_against_its_wave():
    result = wo.run(load_scene("fig28_peristaltic_wave", SHORT))
    assert result.status == "ok", result.reason
    assert result.scalars["against_wave"].value == 1


@pytest.mark.parametrize("reserve", [0.0, 1e-3, None])
def test_anchors_with_nothing_to_spare_are_warned_of(reserve: float | None):
    """Segments that slide use all of their friction: none is left, and nothing said so."""
    study = load_scene("peristaltic_tube", SHORT).table
    vars(study)["holding"] = Holding(slip=9.4e-5, holding_reserve=reserve)
    told = [text for text in study.warnings_of_anchors() if "no reserve" in text]
    assert len(told) == (reserve == 0)
    assert all("slide back by 9.4e-05 m" in text for text in told)


def test_a_load_that_takes_the_worm_along_is_warned_of():
    result = wo.run(load_scene("fig28_peristaltic_wave", [*SHORT, "worm.load=0.1"]))
    assert result.scalars["speed"].value < -1
    assert "drags the worm" in result.trust["warnings"][0]


@pytest.mark.parametrize(("coefficient", "settled"), [(1e-4, False), (0.1, True)])
def test_a_worm_that_still_gathers_speed_is_warned_of(coefficient: float, settled: bool):
    """Its mass over its drag is 19 s and 0.02 s, and it is simulated for 2 s."""
    ground = f"ground={{kind='drag', coefficient={coefficient}, exponent=-1.0}}"
    changes = ["want=[]", "worm.segments=3", "wave.on=1", ground]
    told = wo.run(load_scene("fig28_peristaltic_wave", changes)).trust["warnings"]
    assert [text for text in told if "has not settled" in text] == ([] if settled else told)
    assert len(told) == (not settled)


def test_ordinary_rubber_does_not_move_and_says_why():
    rubber = ["worm.shear_modulus=3.33e5", "worm.wall=5e-4", "worm.segments=2", "wave.on=1"]
    result = wo.run(load_scene("peristaltic_tube", SHORT + rubber))
    assert abs(result.scalars["advance"].value) < 1e-6
    assert any("never reach the wall" in text for text in result.trust["warnings"])


test_what_cannot_be_is_refused_with_what_would_do = refusals(
    "peristaltic_tube",
    """
    coils.current=3.0 | coils.current | 2.729
    ground.radius=4e-3 | ground.radius | write more than 0.005
    ground.friction=0.0 & worm.load=1e-3 | ground.friction | 0.0135
    wave.on=4 | wave.on | at most 3
    time.cycles=2 | time.settle | at most 1
    worm.wall=4e-3 | worm.wall | less than 0.0025
    """,
)


def test_builders_refuse_what_cannot_be():
    with pytest.raises(ArgumentError, match="mid or clamp"):
        peristaltic_worm(body(2), BED, "both")  # type: ignore[arg-type]
    with pytest.raises(ArgumentError, match="does not fit"):
        peristaltic_worm(body(2), Bed(Tube(4e-3, 0.3), 1e8))
    with pytest.raises(ArgumentError, match="mass"):
        Body([SEGMENT] * 2, [1.0, 1.0, 1.0])
    with pytest.raises(ArgumentError, match="stiffness"):
        Bed(TUBE, 0.0)
