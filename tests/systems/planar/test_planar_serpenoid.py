"""Serpenoid waves: closed form, elliptic and unit laws, finite worms."""

from __future__ import annotations

import numpy as np
import pytest
from effort import examples
from hypothesis import given, settings
from hypothesis import strategies as st
from outcomes import refused
from scipy.special import j0

import wormopt as wo
from wormopt.errors import ArgumentError
from wormopt.systems.planar.planar_serpenoid import another_speed
from wormopt.systems.planar.serpenoid import (
    SerpenoidWave,
    best_serpenoid,
    finite_serpenoid,
    serpenoid_speed,
)
from wormopt.systems.planar.shape import chain_shape
from wormopt.systems.planar.swimming.recheck import stepped
from wormopt.systems.planar.swimming.swimmer import Swimmer

# Two computations of others each: amplitude, ratio, ground, V over the wave's speed.
SPEEDS = [
    (0.5, 2.0, "viscous", 0.105066256657),
    (1.0, 2.0, "viscous", 0.279567250102),
    (1.0, 10.0, "viscous", 0.777406367632),
    (1.0, 2.0, "elliptic", 0.486936986396),
    (1.0, 2.0, "unit", 0.199075444191),
    (1.0, 5.0, "elliptic", 0.900535099648),
    (1.0, 5.0, "unit", 0.587242636583),
]


@pytest.mark.parametrize(("alpha", "ratio", "ground", "speed"), SPEEDS)
def test_infinite(alpha: float, ratio: float, ground: str, speed: float) -> None:
    found = serpenoid_speed(alpha, ratio, ground)  # type: ignore[arg-type]
    assert found / j0(alpha) == pytest.approx(speed, abs=6e-13)


@pytest.mark.parametrize("ground", ["viscous", "elliptic", "unit"])
@settings(max_examples=examples(4), deadline=None)
@given(size=st.floats(-12, 0.36), ratio=st.floats(0.01, 6).map(lambda size: 10**size))
def test_by_another_way(ground: str, size: float, ratio: float) -> None:
    """By other quadratures, relative to the amplitude's square, which small speeds go by."""
    alpha, accepted = 10**size, 1e-6 if ground == "elliptic" else 1e-11
    found = serpenoid_speed(alpha, ratio, ground)  # type: ignore[arg-type]
    scale = abs(found) + alpha**2 / 4
    assert abs(found - another_speed(alpha, ratio, ground)) <= accepted * scale


@pytest.mark.parametrize("alpha", [1e-4, 1e-7, 1e-9, 1e-30])
def test_small_waves_go_by_the_square_of_their_amplitude(alpha: float) -> None:
    """V/c = (r - 1) alpha²/2 to the next order, alpha² r of it."""
    for r in (1.5, 10.0):
        speed = serpenoid_speed(alpha, r)
        assert speed == pytest.approx((r - 1) * alpha**2 / 2, rel=2 * r * alpha**2 + 1e-12, abs=0)


@pytest.mark.parametrize("ground", ["viscous", "elliptic", "unit"])
def test_small_waves_on_steep_ground_are_rechecked(ground: str) -> None:
    changes = ["amplitude=1e-7", "ratio=1e6", f"ground={ground}", "waves=[]"]
    result = wo.run(wo.load_scene("planar_serpenoid", changes))
    accepted = 1e-6 if ground == "elliptic" else 1e-11
    assert result.scalars["recheck_error"].value < accepted


@given(alpha=st.floats(0.1, 2.3))
@settings(max_examples=examples(10))
def test_isotropic_ground(alpha: float) -> None:
    """Viscous, no wave gets anywhere; dry, both laws are one."""
    assert abs(serpenoid_speed(alpha, 1.0)) < 1e-15
    laws = [serpenoid_speed(alpha, 1.0, ground) for ground in ("elliptic", "unit")]
    assert laws[0] == pytest.approx(laws[1], abs=1e-14)


@pytest.mark.parametrize(
    ("ratio", "alpha", "speed"),
    [(2.0, 1.181295694, 0.223434072524), (10.0, 0.871964983, 0.604624190)],
)
def test_best_amplitude(ratio: float, alpha: float, speed: float) -> None:
    found = best_serpenoid(ratio)
    assert found[0] == pytest.approx(alpha, abs=1e-9)
    assert found[1] == pytest.approx(speed, abs=1e-9)


@pytest.mark.parametrize(("waves", "speed"), [(1, 0.683219), (2, 0.734918)])
def test_finite(waves: int, speed: float) -> None:
    found = finite_serpenoid(1.0, 10.0, waves=waves)
    assert found.over_wave == pytest.approx(speed, abs=6e-7)
    assert abs(found.swim.turn) < 1e-13


@pytest.mark.slow
def test_finite_by_steps_of_the_balance() -> None:
    swimmer = Swimmer(chain_shape(12, lengths=(1 / 12,) * 12), rods=(1.0, 10.0))
    again = stepped(swimmer, SerpenoidWave(1.0, 12, 12))
    assert np.hypot(*again[:2]) / j0(1.0) == pytest.approx(0.6832194805, abs=1e-9)


@pytest.mark.slow
def test_longer_worms_approach_the_infinite_one() -> None:
    """Recoil falls with length; what is left of four waves is that rods are no curve."""
    speeds = [finite_serpenoid(1.0, 10.0, waves=w).over_wave for w in (1, 2, 4)]
    assert speeds[2] == pytest.approx(0.746866, abs=6e-7)
    assert speeds[0] < speeds[1] < speeds[2] < 0.777406367632


@pytest.mark.parametrize(
    "wrong", [(0.0, 2.0, "viscous"), (2.5, 2.0, "unit"), (1.0, 0.0, "unit"), (1.0, 2.0, "wet")]
)
def test_what_cannot_be_is_refused(wrong: tuple[float, float, str]) -> None:
    with pytest.raises(ArgumentError):
        serpenoid_speed(*wrong)  # type: ignore[arg-type]


def test_best_amplitude_of_very_slippery_worms() -> None:
    """For r → ∞ the best amplitude is (8/r)^(1/4): J0 loses alpha²/4, the recoil 2/(r alpha²)."""
    for r in (1e5, 1e6):
        alpha, _ = best_serpenoid(r)
        assert alpha == pytest.approx((8 / r) ** 0.25, rel=0.01)
        near = [serpenoid_speed(alpha + step, r) for step in (-1e-3, 0.0, 1e-3)]
        assert near[1] == max(near)
    for ground in ("elliptic", "unit"):
        alpha, speed = best_serpenoid(1e6, ground)
        assert speed >= max(serpenoid_speed(alpha * share, 1e6, ground) for share in (0.9, 1.1))


def test_waves_that_are_no_whole_number_of_rods_are_refused() -> None:
    refused("planar_serpenoid", "waves=[1.04]", "waves", "whole number of rods")


def test_ground_that_resists_alike_or_dry_and_nearly_alike_carries_no_wave_ahead() -> None:
    with pytest.raises(ArgumentError, match="above 1"):
        best_serpenoid(1.0)
    assert serpenoid_speed(1.0, 1.01, "elliptic") < 0
    with pytest.raises(ArgumentError, match="no wave"):
        best_serpenoid(1.01, "elliptic")
