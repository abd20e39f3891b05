"""Pins and skids: benchmark numbers, invariances, singular shapes, loads, a second route."""

import casadi as ca
import numpy as np
import pytest
from effort import examples
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from wormopt.errors import ArgumentError, SolveError
from wormopt.model.planar_friction import Elliptic
from wormopt.systems.planar.kinematic import (
    Constraints,
    Phase,
    held,
    kinematic_motion,
    loads,
)
from wormopt.systems.planar.path.simulate import simulate_held
from wormopt.systems.planar.poses import compose, inverse, rotate
from wormopt.systems.planar.shape import Harmonics, Polygon, chain_shape, kinematics_at

SEEDS = st.integers(0, 2**32 - 1)


def pinned(pin: int, skid: int) -> Constraints:
    return Constraints(pins=(pin,), skids=(skid,))


TAIL, HEAD = pinned(2, 0), pinned(0, 2)
WORM = chain_shape(2)
LAW = Elliptic(1.0, 1.5, 2.0)


class Drag:
    """Viscous ground."""

    def slip_force(self, v: ca.SX) -> ca.SX:
        return -ca.vertcat(0.7 * v[0], 2.1 * v[1])


def square(low: tuple[float, float], high: tuple[float, float]) -> Polygon:
    """Second length and angle round a rectangle, the angle first; the first length is 1."""
    (l0, a0), (l1, a1) = low, high
    return Polygon([[1.0, l0, a0], [1.0, l0, a1], [1.0, l1, a1], [1.0, l1, a0]])


def random_stroke(seed: int, links: int, swing: float = 0.25) -> Harmonics:
    """Lengths about 1, angles about a random shape."""
    noise = np.random.default_rng(seed)
    mean = np.concatenate([np.ones(links), noise.uniform(-0.6, 0.6, links - 1)])
    tables = noise.normal(size=(2, 2, 2 * links - 1))
    cosine, sine = swing * tables / np.abs(tables).sum(axis=(0, 1))
    return Harmonics(mean, cosine, sine)


def places_of(links: int, s: np.ndarray) -> np.ndarray:
    """Places of masses, by hand."""
    lengths, psi, r = s[:links], 0.0, [np.zeros(2)]
    for j in range(links):
        r.append(r[-1] - lengths[j] * np.array([np.cos(psi), np.sin(psi)]))
        if j < links - 1:
            psi -= s[links + j]
    return np.array(r)


def pose_of(places: np.ndarray) -> np.ndarray:
    d = places[0] - places[1]
    return np.array([*places[0], np.arctan2(d[1], d[0])])


@pytest.mark.parametrize(
    ("stroke", "turn"),
    [
        (square((0.8, 0.0), (1.2, 1.0)), 0.119661637380),
        (square((0.7, -0.5), (1.3, 1.0)), 0.256220495702),
    ],
)
def test_turn_of_a_worm_with_pinned_tail_and_a_skid_at_the_head(stroke: Polygon, turn: float):
    motion = kinematic_motion(WORM, stroke, TAIL)
    assert abs(motion.displacement[2] - turn) < 5e-13
    # the tail does not move: the head goes round it
    tail = places_of(2, stroke.at(0.0)[0][0])[2]
    moved = compose(motion.displacement, [*tail, 0.0])[:2]
    assert np.abs(moved - tail).max() < 1e-13


@settings(max_examples=examples(12))
@given(SEEDS, st.integers(2, 4))
def test_cartesian_integration_ends_in_the_same_pose(seed: int, links: int):
    noise = np.random.default_rng(seed)
    worm, stroke = chain_shape(links), random_stroke(seed, links)
    pin, skid = noise.permutation(links + 1)[:2].tolist()
    phases = [Phase(0.4, pinned(pin, skid)), Phase(1.0, pinned(skid, pin))]
    try:
        motion = kinematic_motion(worm, stroke, phases)
    except SolveError:
        assume(False)
        return
    assume(motion.condition < 30)
    start = places_of(links, stroke.at(0.0)[0][0])
    _, course = simulate_held(start, stroke, phases, looks=1, accuracy=1e-10)
    off = pose_of(course[-1]) - motion.displacement
    off[2] = (off[2] + np.pi) % (2 * np.pi) - np.pi
    assert np.abs(off).max() < 1e-7


@settings(max_examples=examples(10))
@given(SEEDS)
def test_pace_mirror_and_reversal(seed: int):
    stroke = random_stroke(seed, 2)
    motion = kinematic_motion(WORM, stroke, TAIL).displacement
    sides = np.array([1.0, 1.0, -1.0])
    mirrored = Harmonics(stroke.mean * sides, stroke.cosine * sides, stroke.sine * sides)
    over = kinematic_motion(WORM, mirrored, TAIL).displacement
    assert np.abs(over - motion * [1, -1, -1]).max() < 1e-12
    back = kinematic_motion(WORM, Harmonics(stroke.mean, stroke.cosine, -stroke.sine), TAIL)
    assert np.abs(back.displacement - inverse(motion)).max() < 1e-12

    class Paced:
        n_s, breaks = 3, np.array([0.0, 1.0])

        def at(self, tau: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
            t = np.atleast_1d(tau)
            s, ds = stroke.at(t + 0.1 * np.sin(2 * np.pi * t))
            return s, ds * (1 + 0.2 * np.pi * np.cos(2 * np.pi * t))[:, None]

    paced = kinematic_motion(WORM, Paced(), TAIL).displacement  # type: ignore[arg-type]
    assert np.abs(paced - motion).max() < 1e-12


def test_there_and_back_again_goes_nowhere_and_a_change_of_pins_does():
    there = Polygon([[1.0, 1.0, 0.0], [1.3, 1.2, 0.7]])
    assert np.abs(kinematic_motion(WORM, there, TAIL).displacement).max() < 1e-14
    straight = Polygon([[1.0, 1.0, 0.0], [1.3, 1.2, 0.0]])
    moved = kinematic_motion(WORM, straight, [Phase(0.5, TAIL), Phase(1.0, HEAD)])
    assert np.abs(moved.displacement - [0.5, 0.0, 0.0]).max() < 1e-14


def test_a_pinned_middle_turns_on_the_spot_by_the_bend():
    bend = Polygon([[0.6, 0.6, 0.0], [0.6, 0.6, 0.8]])
    motion = kinematic_motion(WORM, bend, [Phase(0.5, pinned(1, 0)), Phase(1.0, pinned(1, 2))])
    middle = np.array([-0.6, 0.0])
    assert abs(motion.displacement[2] + 0.8) < 1e-14
    there = motion.displacement[:2] + rotate(motion.displacement[2], middle)
    assert np.abs(there - middle).max() < 1e-14


@settings(max_examples=examples(30))
@given(SEEDS, st.integers(2, 5))
def test_velocity_of_random_constraints_is_that_of_least_squares(seed: int, links: int):
    """Against least squares over all Cartesian velocities, by finite differences of places."""
    noise = np.random.default_rng(seed)
    worm, s = chain_shape(links), random_stroke(seed, links).at(0.3)[0]
    rates = noise.normal(size=s.shape)
    skids = tuple(noise.permutation(links + 1)[:3].tolist())
    constraints = Constraints(skids=skids)
    at = kinematics_at(worm, s)
    found = held(at, rates, constraints)
    assume(found.condition[0] < 1e4)
    v = at.J[0] @ found.twist[0] + at.B[0] @ rates[0]
    scale = np.abs(v).max()
    assert np.abs(v[constraints.rows]).max() < 1e-11 * scale * found.condition[0]
    h = 1e-6

    def moved(by: float) -> np.ndarray:
        there = places_of(links, s[0] + by * rates[0])
        return np.array([compose(by * found.twist[0], [*r, 0.0])[:2] for r in there])

    places = (moved(h) - moved(-h)) / (2 * h)
    for i in range(links + 1):
        own = rotate(-at.headings[0, i], places[i])
        assert np.abs(own - v[2 * i : 2 * i + 2]).max() < 1e-7 * max(scale, 1.0)


@settings(max_examples=examples(25))
@given(SEEDS)
def test_pin_and_skid_are_singular_where_the_heading_is_perpendicular(seed: int):
    """A bent worm whose condition is bad exactly where the theory says it is."""
    noise = np.random.default_rng(seed)
    s = np.array([noise.uniform(0.5, 2.0), noise.uniform(0.5, 2.0), noise.uniform(-3, 3)])
    r = places_of(2, s)
    at = kinematics_at(WORM, s[None])
    look = np.array([np.cos(at.headings[0, 0]), np.sin(at.headings[0, 0])])
    found = held(at, np.ones((1, 3)), TAIL)
    # |det| of the three rows is the heading times the way, exactly
    det = abs(np.linalg.det(at.J[0][TAIL.rows]))
    assert abs(det - abs(look @ (r[0] - r[2]))) < 1e-12
    assert found.condition[0] >= 1


def test_singular_shapes_on_the_way_are_refused_by_name():
    # psi2'(l1 + l2 cos phi) = ...: singular at cos phi = -l1 / l2
    stroke = Polygon([[0.5, 1.0, 1.8], [0.5, 1.0, 2.4]])
    with pytest.raises(SolveError, match=r"angle 1 = 2\.094") as refused:
        kinematic_motion(WORM, stroke, TAIL)
    assert refused.value.code == "singular"
    assert "perpendicular" in refused.value.reason


def test_three_skids_of_a_straight_worm_or_an_arc_are_refused():
    skids = Constraints(skids=(0, 1, 2))
    with pytest.raises(SolveError, match="parallel"):
        kinematic_motion(WORM, Polygon([[1.0, 1.3, -0.5], [1.0, 1.3, 0.7]]), skids)
    # equal links bent alike: the bisectors are tangents of an arc, but those of the ends are not
    arc, inner = chain_shape(4, lengths=(1.0,) * 4), Constraints(skids=(1, 2, 3))
    with pytest.raises(SolveError, match="meet there"):
        kinematic_motion(arc, Polygon([[0.4, 0.2, 0.4], [0.2, 0.8, 0.2]]), inner)


def test_what_does_not_determine_or_is_not_there_is_refused():
    for pins, skids, message in (((2,), (), "turn freely about mass 2"), ((), (0, 1), "2 of three"),
                                 ((0,), (0, 1), "mass 0 is a pin and a skid")):  # fmt: skip
        with pytest.raises(ArgumentError, match=message):
            Constraints(pins=pins, skids=skids)
    for phases, message in ((pinned(5, 0), "no mass 5"), ([Phase(0.5, TAIL)], "ascend")):
        with pytest.raises(ArgumentError, match=message):
            kinematic_motion(WORM, square((0.8, 0), (1, 1)), phases)


def test_two_pins_need_their_distance():
    pins = Constraints(pins=(0, 2))
    with pytest.raises(SolveError, match="contradict") as refused:
        kinematic_motion(WORM, Polygon([[1.0, 1.0, 0.3], [1.2, 1.0, 0.3]]), pins)
    assert refused.value.code == "contradiction"

    class Rounds:
        """Lengths for which the distance of head and tail stays while the joint bends."""

        n_s, breaks = 3, np.array([0.0, 1.0])

        def at(self, tau: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
            t = np.atleast_1d(tau)
            phi = 0.8 + 0.4 * np.sin(2 * np.pi * t)
            dphi = 0.8 * np.pi * np.cos(2 * np.pi * t)
            # |r0 - r2|² = 2 l² (1 + cos phi) = 4
            l = np.sqrt(2 / (1 + np.cos(phi)))  # noqa: E741
            dl = l**3 / 4 * np.sin(phi) * dphi
            return np.stack([l, l, phi], axis=1), np.stack([dl, dl, dphi], axis=1)

    motion = kinematic_motion(WORM, Rounds(), pins)  # type: ignore[arg-type]
    assert motion.contradiction < 1e-12
    assert np.abs(motion.displacement).max() < 1e-12


@settings(max_examples=examples(10))
@given(SEEDS, st.sampled_from([LAW, Drag()]))
def test_forces_and_moments_balance_and_the_work_is_that_of_friction(seed: int, law: object):
    stroke = random_stroke(seed, 2)
    motion = kinematic_motion(WORM, stroke, TAIL)
    found = loads(motion, law)  # type: ignore[arg-type]
    at = kinematics_at(WORM, stroke.at(found.tau)[0])
    force = rotate(at.headings, found.force)
    size = np.abs(force).max()
    assert np.abs(force.sum(axis=1)).max() < 1e-11 * size
    moment = at.points[..., 0] * force[..., 1] - at.points[..., 1] * force[..., 0]
    assert np.abs(moment.sum(axis=1)).max() < 1e-11 * size
    assert found.determined.all()
    assert (found.power >= 0).all()
    # pins and skids do no work: that of friction alone, and no less than it is
    assert np.abs(found.velocity[:, 2]).max() < 1e-11
    assert np.abs(found.velocity[:, 0, 1]).max() < 1e-11


def test_loads_of_a_straight_worm_by_hand():
    # the tail pinned; mass 1 and head slide ahead against 1 each, so the pin bears 2 backward
    push = Polygon([[1.0, 1.0, 0.0], [1.3, 1.2, 0.0]])
    motion = kinematic_motion(WORM, push, TAIL)
    found = loads(motion, Elliptic(1.0, 3.0, 2.0), np.array([0.2, 0.7]))
    assert np.abs(found.force[0] - [[-1, 0], [-1, 0], [2, 0]]).max() < 1e-13
    assert np.abs(found.force[1] - [[3, 0], [3, 0], [-6, 0]]).max() < 1e-13
    assert found.pin_load == pytest.approx(6.0, abs=1e-12)


def test_more_than_three_rows_leave_loads_open():
    hold = Constraints(pins=(2,), skids=(0, 1))
    stretch = Polygon([[1.0, 1.0, 0.0], [1.3, 1.2, 0.0]])
    found = loads(kinematic_motion(WORM, stretch, hold), LAW, np.array([0.2]))
    assert not found.determined.any()
    assert np.abs(rotate(0.0, found.force).sum(axis=1)).max() < 1e-12
