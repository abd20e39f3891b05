"""Masses with prescribed harmonic velocities: builder, closed form, averages, exact motion."""

import dataclasses
import math
from collections.abc import Sequence
from typing import Any

import casadi as ca
import numpy as np
import pytest
from effort import examples
from hypothesis import given, settings
from hypothesis import strategies as st
from outcomes import value
from scipy.optimize import root_scalar
from swinging_masses import COULOMB, PERIOD, THIRDS, mean_force, solved

from wormopt.errors import ArgumentError
from wormopt.model.friction import Coulomb, Law, Stribeck, Viscous
from wormopt.simulation.options import Tolerance
from wormopt.simulation.simulate import simulate
from wormopt.systems.swinging.prescribed import harmonic_masses, imbalance, steady_masses
from wormopt.systems.swinging.steady import Runner, SlowVelocity, measured

WEAK = Stribeck(0.001, 0.001, stick_forward=0.03, stick_backward=0.03, v_stribeck=0.8)


def slow_of(model: Any, order: Any = 1, nodes: int = 16) -> SlowVelocity:
    frequency = next(signal.symbol for signal in model.p if signal.name == "frequency")
    return SlowVelocity(model, 2 * np.pi / frequency, order, nodes)


def test_displacements_are_integrals_of_the_velocities():
    cosines, sines = [[1.0, 0.3], [-0.4, -0.3], [-0.6, 0.0]], [[0.0, 0.2], [0.5, 0.0], [-0.5, -0.2]]
    model = harmonic_masses(cosines, sines, law=COULOMB, frequency=1.7, velocity=0.3, place=True)
    times = np.linspace(0.0, 9.0, 4001)
    motion = simulate(model, 9.0, times=times)
    v, x = motion["velocity"], motion["displacement"]
    steps = np.diff(times)
    # Simpson's rule over pairs of steps; where masses reverse velocities bend, which costs 2e-8
    inner = (v[:, :-2:2] + 4 * v[:, 1:-1:2] + v[:, 2::2]) * steps[0] / 3
    assert x[:, 2::2] - x[:, [0]] == pytest.approx(np.cumsum(inner, axis=1), abs=1e-7)
    assert v.mean(axis=0) == pytest.approx(motion["center_velocity"][0], abs=1e-15)
    assert motion["relative_velocity"].sum(axis=0) == pytest.approx(0.0, abs=1e-15)


def test_the_law_of_motion_is_that_of_the_whole_mass():
    model = harmonic_masses([1.0, -0.5], [0.2, -0.1], law=COULOMB, mass=[1.0, 2.0])
    force = model.forces
    rate = ca.Function("f", [ca.vertcat(*(s.symbol for s in model.p)), force], [model.ode])
    values = np.concatenate([np.ravel(np.array(s.value)) for s in model.p])
    assert float(rate(values, [0.5, -2.0])) == pytest.approx(-1.5 / 3, abs=1e-16)
    assert [signal.value for signal in model.x] == [0.0]  # at rest, as nothing is said


def test_actuators_feed_what_the_ground_takes_and_the_centre_gains():
    """Power is losses by the law of friction and the change of M V^2 / 2, instant by instant."""
    cosines, sines, mass = [1.0, -0.4, -0.3], [0.0, 0.5, -0.25], [1.0, 1.0, 2.0]
    laws = [Coulomb(0.3, 1.0), Coulomb(0.5, 0.2), Coulomb(0.1, 0.4)]
    model = harmonic_masses(cosines, sines, law=laws, mass=mass, frequency=1.3, velocity=0.2)
    motion = simulate(model, 12.0, times=np.linspace(0.0, 12.0, 1201))
    v, V = motion["velocity"], motion["center_velocity"][0]
    slides = np.all(np.abs(v) > 1e-9, axis=0)
    ahead, behind = ([getattr(law, way) for law in laws] for way in ("forward", "backward"))
    force = np.where(v > 0, -np.array(ahead)[:, None], np.array(behind)[:, None])
    losses, gain = -(force * v).sum(axis=0), V * force.sum(axis=0)
    assert np.count_nonzero(slides) > 1000
    assert losses[slides].min() > 0
    assert motion["power"][0][slides] == pytest.approx((losses + gain)[slides], abs=1e-13)
    assert motion["total_force"][0][slides] == pytest.approx(force.sum(axis=0)[slides], abs=1e-13)


def test_steady_motions_scale_with_the_common_factor_and_not_with_frequency_and_mass():
    model = harmonic_masses(np.cos(THIRDS), np.sin(THIRDS), law=COULOMB)
    averaged = slow_of(model).averaged
    function = ca.Function(
        "F", [averaged.x[0].symbol, ca.vertcat(*(s.symbol for s in averaged.p))], [averaged.ode]
    )
    friction = np.concatenate([np.ravel(np.array(s.value)) for s in averaged.p[3:]])
    top = math.sin(math.pi / 2 * 0.007 / 0.013)
    for scale, frequency, mass in ((1.0, 1.0, 3.0), (2.5, 0.3, 3.0), (0.4, 7.0, 0.1)):
        p = np.concatenate([[scale, frequency, mass], friction])
        assert float(function(scale * top, p)) == pytest.approx(0.0, abs=1e-15 / mass)
        assert float(function(0.0, p)) == pytest.approx(3 * 0.0035 / mass, rel=1e-13)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"cosines": [1.0, -0.9]}, "harmonic 1 the masses times cosines add up to 0.1"),
        ({"mass": [1.0, 2.0]}, "add up to -1, times sines to 0;"),
        ({"cosines": [[1.0, 0.5], [-1.0, -0.4]], "sines": np.zeros((2, 2))}, "harmonic 2"),
        ({"sines": [0.0, 0.0, 0.0]}, "must have the same shape, not (2, 1) and (3, 1)"),
        ({"cosines": [0.0, 0.0]}, "all relative velocities are 0"),
        ({"cosines": np.zeros((2, 2, 2))}, "one row per mass"),
        ({"mass": [1.0, 1.0, 1.0]}, "one positive number, or 2"),
        ({"law": [COULOMB]}, "law has 1 entries"),
    ],
)
def test_worms_that_cannot_be_are_refused(changes: dict[str, Any], message: str):
    given_ = {"cosines": [1.0, -1.0], "sines": [0.0, 0.0], "law": COULOMB, **changes}
    with pytest.raises(ArgumentError) as caught:
        harmonic_masses(given_.pop("cosines"), given_.pop("sines"), **given_)
    assert message in str(caught.value)


def test_what_is_left_of_the_momentum():
    left = imbalance([[1.0, 2.0], [1.0, 0.0]], [[0.0, 1.0], [0.5, 1.0]], [1.0, 3.0])
    assert left.tolist() == [[4.0, 1.5], [2.0, 4.0]]


def phasors(draw: Any) -> np.ndarray:
    count = draw(st.integers(2, 5))
    part = st.floats(-1, 1)
    found = np.array([complex(draw(part), draw(part)) for _ in range(count)])
    return np.round(found, 3)


@settings(max_examples=examples(30))
@given(st.data())
def test_random_phasors_average_to_the_closed_form(data: st.DataObject):
    raw = phasors(data.draw)
    masses = np.array([data.draw(st.floats(0.2, 3)) for _ in raw])
    own = raw - masses @ raw / masses.sum()
    if np.abs(own).min() < 0.05:
        return
    laws = [
        Coulomb(data.draw(st.floats(0.001, 0.02)), data.draw(st.floats(0.001, 0.02))) for _ in own
    ]
    V = steady_masses(np.abs(own), laws)
    model = harmonic_masses(own.real, own.imag, law=laws, mass=masses)
    bends = [*np.abs(own), *-np.abs(own)]
    (steady,) = slow_of(model).steady(bends)
    largest = np.abs(own).max()
    assert steady.stable
    # at the largest amplitude the mean force is flat: V is known no better than its root
    near = abs(abs(V) - largest) < 1e-3 * largest
    assert steady.velocity == pytest.approx(V, abs=(1e-6 if near else 1e-11) * largest)
    mean_force = sum(
        (law.backward - law.forward) / 2
        - (law.backward + law.forward) / math.pi * math.asin(min(max(V / a, -1), 1))
        for law, a in zip(laws, np.abs(own), strict=True)
    )
    assert mean_force == pytest.approx(0.0, abs=2e-11 * len(laws))


def test_equal_laws_fulfil_the_sum_of_arcs():
    for amplitudes in ([2.0, 2.0, 2.0], [1.0, 0.5, 0.25], [1.0, 0.9, 0.1, 0.1]):
        for forward, backward in ((0.5, 1.0), (1.0, 1.1), (2.0, 0.7)):
            V = steady_masses(amplitudes, Coulomb(forward, backward))
            phi = math.pi / 2 * (backward - forward) / (backward + forward)
            arcs = np.arcsin(np.clip(V / np.array(amplitudes), -1, 1)).sum()
            assert arcs == pytest.approx(len(amplitudes) * phi, abs=1e-13)
    assert steady_masses([2.0, 2.0], Coulomb(0.5, 1.0)) == pytest.approx(1.0, abs=1e-15)
    assert steady_masses([3.0, 1.0], Coulomb(1.0, 1.0)) == pytest.approx(0.0, abs=1e-15)


@pytest.mark.parametrize(
    ("amplitude", "law", "message"),
    [
        ([1.0, 0.0], COULOMB, "amplitudes must be positive"),
        ([1.0, 1.0], Viscous(1.0), "closed form needs dry friction"),
        ([1.0, 1.0], Coulomb(0.0, 1.0), "friction must act in both directions"),
        ([1.0, 1.0], [COULOMB], "law has 1 entries"),
    ],
)
def test_closed_forms_that_are_not_there_are_refused(amplitude: Any, law: Any, message: str):
    with pytest.raises(ArgumentError, match=message):
        steady_masses(amplitude, law)


COSINES = np.array([[1.0, 0.3, 0.2], [-0.2, -0.5, 0.1], [-0.8, 0.2, -0.3]])

SINES = np.array([[0.1, 0.4, -0.2], [0.6, -0.1, 0.5], [-0.7, -0.3, -0.3]])


@pytest.mark.slow
@pytest.mark.parametrize(
    ("laws", "nodes", "bound"),
    [
        ([COULOMB] * 3, 16, 1e-15),
        ([Viscous(0.01)] * 3, 16, 1e-15),
        ([COULOMB, Viscous(0.02), Coulomb(0.02, 0.001)], 16, 1e-15),
        ([dataclasses.replace(WEAK, v_stribeck=0.5)] * 3, 90, 5e-13),
    ],
    ids=["dry", "viscous", "mixed", "stribeck"],
)
def test_mean_forces_of_several_harmonics_by_quadrature(laws: list[Law], nodes: int, bound: float):
    mass = np.array([1.0, 1.0, 1.0])
    model = harmonic_masses(COSINES, SINES, law=laws, mass=mass)
    slow = slow_of(model, nodes=nodes)
    for V in (-2.5, -0.9, -0.31, 0.0, 0.17, 0.8, 1.6):
        expected = sum(
            mean_force(law, V, c, s) for law, c, s in zip(laws, COSINES, SINES, strict=True)
        )
        assert 3 * slow.rate(V) == pytest.approx(expected, rel=0, abs=bound)


def errors(cosines: Any, sines: Any, sizes: Sequence[float]) -> dict[Any, list[float]]:
    """Exact mean velocity less steady ones of both orders, for friction 0.3 and 1 times a size."""
    found: dict[Any, list[float]] = {1: [], 2: []}
    for eps in sizes:
        law = Coulomb(0.3 * eps, eps)
        slow = harmonic_masses(cosines, sines, law=law)
        steady = {
            order: root_scalar(
                slow_of(slow, order).rate, bracket=(0.4, 0.9), xtol=1e-300, rtol=1e-15
            ).root
            for order in (1, 2)
        }
        moving = measured(harmonic_masses(cosines, sines, law=law, place=True))
        runner = Runner(moving, PERIOD, Tolerance(), lambda *_: None)
        exact = runner.orbit(steady[2]).velocity
        for order, V in steady.items():
            found[order].append(abs(exact - V))
    return found


def orders(values: Sequence[float], sizes: Sequence[float]) -> np.ndarray:
    return np.diff(np.log(values)) / np.diff(np.log(sizes))


@pytest.mark.slow
def test_errors_are_of_first_and_second_order_in_the_friction():
    sizes, turn = (0.08, 0.04, 0.02, 0.01), THIRDS
    cosines = np.stack([np.cos(turn), 0.6 * np.cos(turn + 0.2)], axis=1)
    sines = np.stack([np.sin(turn), 0.6 * np.sin(turn + 0.2)], axis=1)
    found = errors(cosines, sines, sizes)
    assert orders(found[1], sizes) == pytest.approx(1.0, abs=0.2)
    assert orders(found[2], sizes) == pytest.approx(2.0, abs=0.25)
    assert found[1][-1] < 0.12 * sizes[-1]
    assert found[2][-1] < 0.3 * sizes[-1] ** 2


def test_of_equal_swings_the_first_order_is_as_good_as_the_second():
    # forward and backward in time the swings are alike, up to the names of masses
    sizes = (0.08, 0.04, 0.02, 0.01)
    found = errors(np.cos(THIRDS), np.sin(THIRDS), sizes)
    assert found[1] == pytest.approx(found[2], abs=1e-13)
    assert orders(found[1], sizes) == pytest.approx(2.0, abs=0.02)
    assert found[1][-1] < 0.01 * sizes[-1] ** 2


def by_hand(cosines: np.ndarray, sines: np.ndarray, law: Any, V: float) -> tuple[float, float]:
    """Velocity after a period and way in it: V is linear between reversals, found one by one."""
    t, x, fine = 0.0, 0.0, 400

    def v(i: int, t: float, begin: float, V: float, rate: float) -> float:
        return V + rate * (t - begin) + cosines[i] * math.cos(t) + sines[i] * math.sin(t)

    signs = [1 if v(i, 1e-9, 0.0, V, 0.0) > 0 else -1 for i in range(len(cosines))]
    while t < PERIOD:
        rate = sum(-law.forward if s > 0 else law.backward for s in signs) / len(signs)
        after, who = PERIOD, None
        for i, sign in enumerate(signs):
            grid = np.linspace(t + 1e-9, PERIOD, fine)
            values = np.array([sign * v(i, s, t, V, rate) for s in grid])
            below = np.flatnonzero(values < 0)
            if below.size and below[0]:
                found = root_scalar(
                    lambda s, *held: v(held[0], s, *held[1:]),
                    args=(i, t, V, rate),
                    bracket=(float(grid[below[0] - 1]), float(grid[below[0]])),
                    xtol=1e-300, rtol=1e-15,
                ).root  # fmt: skip
                if found < after:
                    after, who = found, i
        x += V * (after - t) + rate * (after - t) ** 2 / 2
        V, t = V + rate * (after - t), after
        if who is not None:
            signs[who] = -signs[who]
    return V, x


@pytest.mark.parametrize("forward", [0.006, pytest.param(0.015, marks=pytest.mark.slow)])
def test_the_exact_motion_against_one_by_hand(forward: float):
    of_the_scene = forward == 0.006
    result = solved() if of_the_scene else solved(f"worm.friction.forward={forward}")
    law, cosines, sines = Coulomb(forward, 0.02), np.cos(THIRDS), np.sin(THIRDS)
    start = root_scalar(
        lambda V: by_hand(cosines, sines, law, V)[0] - V, bracket=(0.1, 0.9), xtol=1e-13
    ).root
    mean = by_hand(cosines, sines, law, start)[1] / PERIOD
    assert value(result, "velocity_exact_mean") == pytest.approx(mean, abs=1e-10)
    assert result.trust["exact"]["start"] == pytest.approx(start, abs=1e-9)
