"""Slow crawling in the plane: benchmark cycles, balances, and the group of displacements."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from effort import examples
from hypothesis import example, given, settings
from hypothesis import strategies as st

import wormopt as wo
from tests.oracles.by_crawls import CIRCLE, SNAKE, THREE
from wormopt.errors import ArgumentError, SolveError
from wormopt.model.planar_friction import AnisotropicCoulomb, Elliptic
from wormopt.systems.planar.crawling.crawl import Crawl
from wormopt.systems.planar.planar_turn import TurnInPlace, swing_hold
from wormopt.systems.planar.poses import inverse

P = wo.planar


@pytest.mark.slow
def test_three_links_stop_and_go_when_they_should(cycle):
    half = [0.2954567555, 0.4693633254, np.pi / 4, 1.1014330014, 1.2753395713]
    found = 2 * np.pi * cycle.breaks[1:-1]
    assert found == pytest.approx([*half, *(np.pi + np.array(half))], abs=6e-11)
    sets = [np.flatnonzero(phase.rest).tolist() for phase in cycle.phases]
    assert sets == [[], [0, 1], [0], [3], [2, 3], [], [0, 1], [0], [3], [2, 3], []]


def test_head_of_three_links_moves_as_other_programs_say():
    t = np.array([2.0, 0.6])
    s = np.column_stack([np.cos(t), np.sin(t)])
    ds = np.column_stack([-np.sin(t), np.cos(t)])
    motion = P.crawl_velocity(THREE, SNAKE, s, ds)
    assert motion.twist[0] == pytest.approx(
        [0.379952117734, -0.252139599410, -0.683667000296], abs=2e-12
    )
    assert motion.twist[1] == pytest.approx([0.0, 0.0, -0.11746997682], abs=6e-12)


def _worm(seed: int, *, one_sided: bool = False):
    """A worm, its laws and an instant of its stroke."""
    rng = np.random.default_rng(seed)
    n = int(rng.integers(2, 9))
    shape = P.chain_shape(n, lengths=tuple(rng.uniform(0.5, 1.5, n)))
    laws = []
    for _ in range(n + 1):
        ahead, back, aside = rng.uniform(0.5, 3.0, 3)
        laws.append(Elliptic(ahead, back if one_sided else ahead, aside))
    return shape, laws, rng.uniform(-0.8, 0.8, n - 1), rng.uniform(-1, 1, n - 1)


def changes(found: Crawl) -> np.ndarray:
    """Phases of the stroke at which a mass stops, starts or turns back."""
    sets = [(*one.rest, *one.back) for one in found.phases]
    return np.array([
        one.end for one, (a, b) in zip(found.phases[:-1], pairwise(sets), strict=True) if a != b
    ])  # fmt: skip


@pytest.mark.slow
@example(202)
@settings(max_examples=examples(6))
@given(st.integers(0, 10**6))
def test_a_stroke_backward_undoes_itself(seed):
    shape, laws, mean, amplitude = _worm(seed)
    rng = np.random.default_rng(seed)
    cosine, sine = amplitude[None] / 2, rng.uniform(-0.4, 0.4, (1, len(mean)))
    there = P.crawl(shape, laws, P.Harmonics(mean / 2, cosine, sine))
    back = P.crawl(shape, laws, P.Harmonics(mean / 2, cosine, -sine))
    assert back.displacement == pytest.approx(inverse(there.displacement), abs=1e-8)
    assert back.work == pytest.approx(there.work, rel=1e-9)
    # phase 0 of the backward stroke is that of the forward one; where the shape all but turns back,
    # the strokes may be cut at different phases
    assert changes(back) == pytest.approx(1 - changes(there)[::-1], abs=1e-8)


def test_a_stroke_to_and_fro_goes_nowhere():
    to_and_fro = P.Polygon([[0.1, 0.7], [0.9, -0.5]])
    assert P.crawl(THREE, SNAKE, to_and_fro).displacement == pytest.approx(np.zeros(3), abs=1e-10)


def test_pace_does_not_matter():
    shape, laws, s, ds = _worm(3, one_sided=True)
    slow, fast = (P.crawl_velocity(shape, laws, s, c * ds) for c in (1e-3, 1e3))
    assert 1e6 * slow.twist == pytest.approx(fast.twist, rel=1e-9)


def test_laws_without_a_minimum_are_refused():
    with pytest.raises(ArgumentError, match="least power"):
        P.crawl(THREE, AnisotropicCoulomb(1.0, 1.0, 3.0), CIRCLE)
    with pytest.raises(ArgumentError, match="2 laws for 4 masses"):
        P.crawl(THREE, [SNAKE, SNAKE], CIRCLE)


ROUGH = [Elliptic(f, f, f) for f in (1.0, 2.0, 1.0)]


def test_turn_in_place_turns_and_goes_nowhere():
    # theory note B10
    gait = TurnInPlace(1.0, 2.0, short=0.5, long=1.0, straight=0.2, bent=1.2)
    assert gait.holds
    found = P.crawl(P.chain_shape(2), ROUGH, gait.stroke)
    assert found.displacement[2] == pytest.approx(-1.0, abs=1e-12)
    assert found.work == pytest.approx(3.0, abs=1e-12)
    assert (gait.turn, gait.work) == (-1.0, 3.0)
    middle = np.array([-1.0, 0.0])
    x, y, angle = found.displacement
    turned = [np.cos(angle) * middle[0], np.sin(angle) * middle[0]]
    assert [x + turned[0], y + turned[1]] == pytest.approx(middle, abs=1e-12)


@pytest.mark.parametrize(
    ("grip", "short"),
    [
        (1e30, 0.5),
        *(pytest.param(*each, marks=pytest.mark.slow) for each in ((1e9, 0.5), (2.0, 1e-6))),
    ],
)
def test_a_turn_in_place_about_a_pin_or_with_a_short_link(grip: float, short: float):
    """By the closed form: the short link swings twice, and each of four ends moves by the rest."""
    rate, ends = {"joint": 1.0, "link": 1.0}, {"straight": 0.2, "bent": 1.2}
    worm = {"end_friction": 1.0, "middle_friction": grip, "short": short, "long": 1.0, **ends}
    result = wo.run({"schema": 1, "kind": "planar-turn", "worm": worm, "rate": rate})
    assert result.status == "ok"
    assert result.scalars["turn"].value == pytest.approx(-1.0, abs=1e-10)
    assert result.scalars["work"].value == pytest.approx(2 * short + 4 * (1 - short), abs=1e-10)


def test_the_hold_of_a_swing_is_the_largest_between_its_samples_too():
    # straight, the middle mass holds F (1 + k) across; a swing from -1 to 1.3 has no sample there
    for share, holds in ((1 - 1e-9, False), (1 + 1e-9, True)):
        gait = TurnInPlace(1.0, 1.8 * share, short=0.8, long=1.0, straight=-1.0, bent=1.3)
        assert gait.swing_hold_max == pytest.approx(1 / share, rel=1e-13)
        assert gait.holds is holds
    bends = np.linspace(-1.0, 1.3, 99)
    assert gait.swing_hold_max >= gait.swing_hold(bends).max()


@settings(max_examples=examples(20))
@given(st.floats(0.2, 0.98), st.floats(0.5, 2.5), st.floats(-2.8, 2.8))
@example(0.5, 1.0, 7e-189)
def test_the_long_link_rests_while_the_closed_form_says_so(ratio, grip, phi):
    hold = float(swing_hold(phi, ratio, grip))
    closed = (np.cos(phi) + ratio) ** 2
    closed += max(0.0, abs(np.sin(phi)) - np.sqrt(1 - ratio**2)) ** 2
    if abs(closed - grip**2) < 1e-3:
        return
    laws = [Elliptic(f, f, f) for f in (1.0, grip, 1.0)]
    motion = P.crawl_velocity(P.chain_shape(2, lengths=(1.0, ratio)), laws, [phi], [1.0])
    rests = motion.rest[0].tolist() == [True, True, False]
    assert rests == (closed <= grip**2) == (hold <= 1)
    if rests:
        assert motion.hold[0] == pytest.approx(hold, rel=1e-6)


def test_a_load_shifts_the_balance_until_it_outruns_the_ground():
    s, ds = np.array([0.3, 0.2]), np.array([1.0, -0.3])
    J = np.array(THREE.kinematics(s)[2])
    load = np.array([0.0, 1.0, 0.5])
    for rates in (ds, 0 * ds):
        motion = P.crawl_velocity(THREE, SNAKE, s, rates, load=load)
        assert J.T @ motion.forces[0].ravel() == pytest.approx(-load, abs=1e-8)
    assert abs(motion.twist).max() < 1e-12
    with pytest.raises(SolveError, match="largest that the ground can hold"):
        P.crawl_velocity(THREE, SNAKE, s, ds, load=[5.0, 0.0, 0.0])


def test_a_straight_chain_that_the_ground_leaves_open_is_refused():
    shape = P.chain_shape(3)
    with pytest.raises(SolveError, match="the motion is not unique"):
        P.crawl_velocity(shape, SNAKE, [1.0, 1.0, 1.0, 0.0, 0.0], [1.0, -0.5, 0.3, 0.0, 0.0])


def test_of_two_equal_links_it_is_open_which_one_turns():
    # both turning about the middle mass take F l (|w1| + |w2|), whatever their shares
    with pytest.raises(SolveError, match="the motion is not unique"):
        P.crawl_velocity(P.chain_shape(2, lengths=(1.0, 1.0)), ROUGH, [1.0], [1.0])


@pytest.mark.parametrize("share", [0.02, 0.1, 0.2, 0.25, 0.4])
def test_of_three_equal_links_it_is_open_which_one_turns(share):
    # other minimisers of the same power, found by Nelder and Mead, turn slower by up to 0.1
    s, laws = [0.5 * share, share - 0.5], [Elliptic(1.0, 3.0, sideways=1.0)] * 4
    with pytest.raises(SolveError, match=r"not unique.*angle 1.*resistance of a mass"):
        P.crawl_velocity(THREE, laws, s, [0.5, 1.0])
    laws[0] = Elliptic(1.01, 3.03, sideways=1.01)
    decided = P.crawl_velocity(THREE, laws, s, [0.5, 1.0])
    J = np.array(THREE.kinematics(s)[2])
    assert J.T @ decided.forces[0].ravel() == pytest.approx(np.zeros(3), abs=1e-9)
