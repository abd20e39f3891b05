"""Slow crawling in the plane beside another solver: smoothed friction on many instants."""

from __future__ import annotations

import numpy as np
import pytest

import wormopt as wo
from wormopt.model.planar_friction import Elliptic
from wormopt.systems.planar.planar_turn import TurnInPlace

P = wo.planar
_SMOOTHING = 10.0 ** -np.arange(0, 8.1, 0.5)


def _kinematics(lengths, angles, rates):
    """J (G, m, 2, 3) and b (G, m, 2) of a chain of fixed lengths, by complex numbers."""
    none = np.zeros((len(angles), 1))
    links = np.concatenate([none, -np.cumsum(angles, axis=1)], axis=1)
    turning = np.concatenate([none, -np.cumsum(rates, axis=1)], axis=1)
    step = -np.asarray(lengths) * np.exp(1j * links)
    place = np.concatenate([none, np.cumsum(step, axis=1)], axis=1)
    velocity = np.concatenate([none, np.cumsum(1j * turning * step, axis=1)], axis=1)
    look = np.concatenate([links[:, :1], links[:, 1:] + angles / 2, links[:, -1:]], axis=1)
    back = np.exp(-1j * look)
    columns = [np.stack([np.real(c), np.imag(c)], -1) for c in (back, 1j * back, 1j * place * back)]
    b = velocity * back
    return np.stack(columns, -1), np.stack([b.real, b.imag], -1)


def _least(J, b, ahead, back, aside):
    """Twists (G, 3) and powers (G,) by Newton's steps on sqrt(psi^2 + d^2), d to 1e-8."""
    x = np.zeros((len(b), 3))

    def parts(x, d):
        v = b + np.einsum("gmcn,gn->gmc", J, x)
        along = np.where(v[..., 0] >= 0, ahead, back)
        W = np.stack([along, np.broadcast_to(aside, along.shape)], -1) ** 2
        return v, W, np.sqrt((W * v * v).sum(-1) + d * d)

    for d in _SMOOTHING:
        for _ in range(30):
            v, W, size = parts(x, d)
            pull = np.einsum("gmcn,gmc->gmn", J, W * v / size[..., None])
            slope = pull.sum(axis=1)
            H = np.einsum("gmcn,gmc,gmck->gnk", J, W / size[..., None], J)
            H = H - np.einsum("gmn,gmk,gm->gnk", pull, pull, 1 / size) + 1e-13 * np.eye(3)
            step = -np.linalg.solve(H, slope[..., None])[..., 0]
            factor, value = np.ones(len(x)), size.sum(axis=1)
            for _ in range(30):
                worse = parts(x + factor[:, None] * step, d)[2].sum(axis=1) > value * (1 + 1e-15)
                factor[worse] /= 2
                if not worse.any():
                    break
            x = x + factor[:, None] * step
            if np.abs(step).max() < 1e-3 * d:
                break
    return x, parts(x, 0.0)[2].sum(axis=1)


def _reference(lengths, numbers, stroke, count=2400):
    """x, y, angle and work of a stroke by the midpoint rule."""
    s, ds = stroke.at((np.arange(count) + 0.5) / count)
    twist, power = _least(*_kinematics(lengths, s, ds), *numbers)
    turn = np.cumsum(twist[:, 2]) / count
    way = (twist[:, 0] + 1j * twist[:, 1]) * np.exp(1j * (turn - twist[:, 2] / 2 / count))
    place = way.mean()
    return np.array([place.real, place.imag, turn[-1], power.mean()])


def _drawn(seed: int):
    """Lengths, resistances and stroke of a worm of two to five links."""
    rng = np.random.default_rng(seed)
    n = int(rng.integers(2, 6))
    lengths = rng.uniform(0.5, 1.5, n)
    ahead, back = np.exp(rng.uniform(-0.7, 0.7, (2, n + 1)))
    aside = ahead * np.exp(rng.uniform(np.log(0.3), np.log(10), n + 1))
    if rng.random() < 0.5:
        return lengths, (ahead, back, aside), P.Polygon(rng.uniform(-1.2, 1.2, (3, n - 1)))
    swings = 0.7 * rng.normal(size=(2, 1, n - 1))
    return lengths, (ahead, back, aside), P.Harmonics(rng.uniform(-0.5, 0.5, n - 1), *swings)


@pytest.mark.slow
@pytest.mark.parametrize("seed", [*range(40), 64, 77])
def test_random_worms_go_as_far_as_by_smoothed_friction(seed):
    lengths, numbers, stroke = _drawn(seed)
    laws = [Elliptic(*(float(x) for x in row)) for row in zip(*numbers, strict=True)]
    found = P.crawl(P.chain_shape(len(lengths), lengths=tuple(lengths)), laws, stroke)
    expected = _reference(lengths, numbers, stroke)
    assert [*found.displacement, found.work] == pytest.approx(expected, abs=5e-5, rel=5e-5)
    assert found.error < 1e-8
    assert found.work_error < 1e-8 * found.work


def test_links_that_only_turn_about_one_at_rest_need_few_panels():
    # the twist is 0 but for rounding, which no polynomial follows
    laws = [Elliptic(f, f, f) for f in (1.0, 4.0, 1.0)]
    stroke = P.Polygon([[0.2], [0.9], [-0.4]])
    found = P.crawl(P.chain_shape(2, lengths=(1.0, 0.5)), laws, stroke)
    assert len(found.travel.ends) < 30
    assert found.displacement == pytest.approx(np.zeros(3), abs=1e-12)
    assert found.work == pytest.approx(0.5 * (0.7 + 1.3 + 0.6), rel=1e-12)


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(60))
def test_a_gait_turns_in_place_just_where_its_conditions_hold(seed):
    rng = np.random.default_rng(seed)
    grip, short = rng.uniform(0.8, 2.6), rng.uniform(0.3, 0.95)
    straight, bent = rng.uniform(-2.0, 2.0, 2)
    gait = TurnInPlace(1.0, float(grip), float(short), 1.0, float(straight), float(bent))
    laws = [Elliptic(f, f, f) for f in (1.0, float(grip), 1.0)]
    found = P.crawl(P.chain_shape(2), laws, gait.stroke)
    turns = abs(found.displacement[2] - gait.turn) < 1e-9 and abs(found.work - gait.work) < 1e-9
    assert turns == gait.holds
    if gait.holds:  # both swings at a rate of 1, swaps in no time: the bound is met
        rate = abs(found.displacement[2]) / (2 * abs(bent - straight))
        assert rate == pytest.approx(0.5, abs=1e-8)
