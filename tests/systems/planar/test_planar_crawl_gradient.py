"""Derivatives of slow crawls: exact ones, invariances, differences of crawls, and refusals."""

from __future__ import annotations

import numpy as np
import pytest

import wormopt as wo
from wormopt.errors import ArgumentError, SolveError
from wormopt.model.planar_friction import Elliptic
from wormopt.systems.planar.planar_turn import TurnInPlace

P = wo.planar
ROUGH = [Elliptic(f, f, f) for f in (1.0, 2.0, 1.0)]
TURN = TurnInPlace(1.0, 2.0, short=0.5, long=1.0, straight=0.2, bent=1.2)


@pytest.fixture(scope="module")
def turn():
    return P.crawl(P.chain_shape(2), ROUGH, TURN.stroke)


def test_another_pace_changes_nothing(cycle):
    # s'(tau) sin(2 pi tau), which is a shift of the phase that is 0 at the ends
    paced = P.Harmonics(
        [-np.pi, 0.0], cosine=[[0.0, 0.0], [np.pi, 0.0]], sine=[[0.0, 0.0], [0.0, np.pi]]
    )
    slopes = P.crawl_gradient(cycle, [paced]).stroke
    assert slopes == pytest.approx(np.zeros((1, 4)), abs=1e-7)


def test_begun_later_the_way_turns_with_the_first_velocity(cycle):
    # h^-1 d h for the pose h of a small step, and d a way without turn: d + dt (w x d)
    later = P.Harmonics([0.0, 0.0], cosine=[[0.0, 2 * np.pi]], sine=[[-2 * np.pi, 0.0]])
    slopes = P.crawl_gradient(cycle, [later]).stroke[0]
    w = float(cycle.course.at(np.array([0.0])).twist[0, 2])
    x, y, _ = cycle.displacement
    assert slopes == pytest.approx([w * y, -w * x, 0.0, 0.0], abs=1e-7)


def test_ground_that_is_harder_all_over_costs_work_alone(cycle):
    numbers = np.array([[1.0, 1.0, 3.0]] * 4)
    scaled = np.einsum("mk,mkd->d", numbers, P.crawl_gradient(cycle).ground)
    assert scaled[3] == pytest.approx(cycle.work, rel=1e-9)
    assert scaled[:3] == pytest.approx(np.zeros(3), abs=1e-8)


def test_a_turn_in_place_has_the_slopes_of_its_closed_form(turn):
    # turn = straight - bent, work = 2 F l (bent - straight) + 4 F (long - short)
    corners = np.array(TURN.stroke.corners)
    bent = P.Polygon(np.where(corners == 1.2, [0.0, 0.0, 1.0], 0.0))
    found = P.crawl_gradient(turn, [bent])
    assert found.stroke[0, 2:] == pytest.approx([-1.0, 1.0], abs=1e-10)
    # either end swings once, and slides in either swap, half of it ahead
    ends = found.ground[[0, 2], :, 3]
    assert ends.sum() == pytest.approx(TURN.work, rel=1e-10)
    assert ends.sum(axis=1) == pytest.approx([1.5, 1.5], abs=1e-10)
    assert found.ground[1] == pytest.approx(np.zeros((3, 4)), abs=1e-12)
    assert found.ground[:, :, 2] == pytest.approx(np.zeros((3, 3)), abs=1e-10)


def test_where_masses_rest_together_by_the_stroke_alone_it_is_refused(turn):
    longer = P.Polygon(np.array([[1.0, 0.0, 0.0], *np.zeros((3, 3))]))
    with pytest.raises(SolveError, match="keeps their distance"):
        P.crawl_gradient(turn, [longer])


def test_directions_that_do_not_fit_are_refused(cycle, turn):
    with pytest.raises(ArgumentError, match="write 2 variables"):
        P.crawl_gradient(cycle, [P.Harmonics([0.0], [[1.0]], [[0.0]])])
    with pytest.raises(ArgumentError, match="no breaks but those of the stroke"):
        P.crawl_gradient(cycle, [P.Polygon([[0.0, 0.0], [1.0, 0.0]])])
    with pytest.raises(ArgumentError, match="no breaks but those of the stroke"):
        P.crawl_gradient(turn, [P.Polygon(np.eye(3))])


def _told(shape, laws, stroke):
    found = P.crawl(shape, laws, stroke)
    return np.array([*found.displacement, found.work])


def _harmonics(rows):
    return P.Harmonics(rows[0], rows[1:2], rows[2:3])


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(4))
def test_derivatives_are_differences_of_crawls(seed):
    rng = np.random.default_rng(seed)
    n, eps = 2 + seed % 3, 2e-5
    shape = P.chain_shape(n, lengths=tuple(rng.uniform(0.6, 1.4, n)))
    numbers = np.column_stack([*rng.uniform(0.8, 1.6, (2, n + 1)), rng.uniform(1.0, 4.0, n + 1)])
    if seed % 2:
        start, way = rng.uniform(-1.0, 1.0, (2, 4, n - 1))
        make = P.Polygon
    else:
        start = np.vstack([rng.uniform(-0.2, 0.2, (1, n - 1)), rng.uniform(-1, 1, (2, n - 1))])
        way = rng.normal(size=start.shape)
        make = _harmonics

    laws = [Elliptic(*row) for row in numbers.tolist()]
    slopes = P.crawl_gradient(P.crawl(shape, laws, make(start)), [make(way)])
    both = [_told(shape, laws, make(start + sign * eps * way)) for sign in (1, -1)]
    assert slopes.stroke[0] == pytest.approx((both[0] - both[1]) / (2 * eps), abs=1e-6, rel=1e-6)
    harder = rng.normal(size=numbers.shape)
    both = []
    for sign in (1, -1):
        rows = (numbers + sign * eps * harder).tolist()
        both.append(_told(shape, [Elliptic(*row) for row in rows], make(start)))
    told = np.einsum("mk,mkd->d", harder, slopes.ground)
    assert told == pytest.approx((both[0] - both[1]) / (2 * eps), abs=1e-6, rel=1e-6)
