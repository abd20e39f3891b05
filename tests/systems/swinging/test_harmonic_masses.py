"""Masses with prescribed harmonic velocities: builder, closed form, kind "harmonic-masses"."""

import dataclasses
import math
from collections.abc import Sequence
from functools import cache
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np
import pytest
from effort import examples
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import quad
from scipy.optimize import root_scalar

import wormopt as wo
from wormopt.analysis.average import average
from wormopt.cli import main
from wormopt.errors import ArgumentError, SceneError, SolveError
from wormopt.model.friction import Coulomb, Law, Stribeck, Viscous
from wormopt.result import Result
from wormopt.simulation.options import Tolerance
from wormopt.simulation.simulate import simulate
from wormopt.study import load_scene
from wormopt.systems.shared.proof import CrossCheck
from wormopt.systems.swinging import steady as steadies
from wormopt.systems.swinging.harmonic_masses import Masses
from wormopt.systems.swinging.prescribed import harmonic_masses, imbalance, steady_masses
from wormopt.systems.swinging.steady import (
    Runner,
    SlowVelocity,
    Steady,
    measured,
    sign_changes,
    tends_to,
)

SCENE = "three_masses_harmonic"
THIRDS = 2 * np.pi * np.arange(3) / 3
PERIOD = 2 * np.pi
COULOMB = Coulomb(0.003, 0.01)
WEAK = Stribeck(0.001, 0.001, stick_forward=0.03, stick_backward=0.03, v_stribeck=0.8)


def solved_anew(*changes: str) -> Result:
    return wo.run(load_scene(SCENE, changes))


solved = cache(solved_anew)


def value(result: Result, name: str) -> Any:
    return result.scalars[name].value


def slow_of(model: Any, order: Any = 1, nodes: int = 16) -> SlowVelocity:
    frequency = next(signal.symbol for signal in model.p if signal.name == "frequency")
    return SlowVelocity(model, 2 * np.pi / frequency, order, nodes)


# -- the builder -----------------------------------------------------------------------------------


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
        ({"cosines": [1.0, math.nan]}, "finite numbers, one row per mass"),
        ({"cosines": "fast"}, "must be a number or a list of numbers"),
        ({"cosines": np.zeros((2, 2, 2))}, "one row per mass"),
        ({"mass": [1.0, 1.0, 1.0]}, "one positive number, or 2"),
        ({"mass": -1.0}, "one positive number, or 2"),
        ({"frequency": 0.0}, "frequency must be positive"),
        ({"law": [COULOMB]}, "one friction law, or 2"),
        ({"law": 0.1}, "one friction law, or 2"),
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


# -- the closed form -------------------------------------------------------------------------------


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
        ([], COULOMB, "amplitudes must be positive"),
        ([1.0, 1.0], Viscous(1.0), "closed form needs dry friction"),
        ([1.0, 1.0], Coulomb(0.0, 1.0), "friction must act in both directions"),
        ([1.0, 1.0], [COULOMB], "one friction law, or 2"),
    ],
)
def test_closed_forms_that_are_not_there_are_refused(amplitude: Any, law: Any, message: str):
    with pytest.raises(ArgumentError, match=message):
        steady_masses(amplitude, law)


# -- averages by quadrature ------------------------------------------------------------------------


def mean_force(law: Law, V: float, cosines: Any, sines: Any) -> float:
    """Mean friction of one mass by adaptive quadrature between reversals."""
    order = np.arange(1, len(cosines) + 1)

    def v(t: float) -> float:
        return float(V + cosines @ np.cos(order * t) + sines @ np.sin(order * t))

    grid = np.linspace(0.0, PERIOD, 2001)
    values = [v(t) for t in grid]
    edges = [0.0, PERIOD]
    for k in np.flatnonzero(np.diff(np.sign(values))):
        bracket = (float(grid[k]), float(grid[k + 1]))
        edges.append(root_scalar(v, bracket=bracket, xtol=1e-300, rtol=1e-15).root)
    total = 0.0
    for a, b in zip(sorted(edges)[:-1], sorted(edges)[1:], strict=True):
        sign = 1 if v((a + b) / 2) > 0 else -1
        part = quad(
            lambda t, sign=sign: float(law.slip_force(v(t), sign)), a, b, epsabs=1e-16, limit=200
        )
        total += part[0]
    return total / PERIOD


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


# -- orders ----------------------------------------------------------------------------------------


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


# -- the exact motion by hand ----------------------------------------------------------------------


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


@pytest.mark.parametrize("forward", [0.006, 0.015])
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


# -- what a scene says of itself -------------------------------------------------------------------


def worm_of(changes: Sequence[str]) -> Masses:
    table: Any = load_scene(SCENE, changes).table
    return table.worm


UNEQUAL = [
    "worm.masses=2", "worm.mass=[1, 2]", "worm.frequency=4",
    "worm.harmonic.0.amplitude=[1, 0.5]", "worm.harmonic.0.phase=[30, 210]",
]  # fmt: skip


@pytest.mark.parametrize(
    ("law", "largest"),
    [
        ('{kind="coulomb", forward=0.006, backward=0.02}', 2 * 0.02),
        ('{kind="coulomb", forward=0.02, backward=0.006}', 2 * 0.02),
        ('{kind="viscous", drag=0.01}', 0.01 * 1.0 + 0.01 * 0.5),
        ('{kind="stribeck", forward=0.001, backward=0.002, stick_forward=0.03, '
         'stick_backward=0.04, v_stribeck=0.8}', 2 * 0.04),
    ],
)  # fmt: skip
def test_smallness_is_the_friction_of_a_period_beside_the_least_swing(law: str, largest: float):
    """Forces of both masses over 2 pi / 4; the whole mass 3 times the smaller speed 0.5."""
    worm = worm_of([*UNEQUAL, f"worm.friction={law}"])
    assert worm.smallness == pytest.approx(math.pi / 2 * largest / (3 * 0.5), rel=1e-4)


def test_masses_begin_to_reverse_at_the_extremes_of_their_swings():
    """For one harmonic plus and minus the amplitudes; for two cos t + a cos 2t has four, at
    sin t = 0 and cos t = -1/(4a)."""
    worm = worm_of(UNEQUAL)
    found = np.sort(worm.extremes)
    assert found == pytest.approx([-1.0, -0.5, 0.5, 1.0], abs=1e-12)
    a = 0.8
    second = f"{{order=2, amplitude={a}, phase=[0, 180]}}"
    first = "{amplitude=1, phase=[0, 180]}"
    worm = worm_of(["worm.masses=2", f"worm.harmonic=[{first}, {second}]"])
    own = [1 + a, -1 + a, -1 / (4 * a) + a * (2 / (4 * a) ** 2 - 1)]
    own.append(own[-1])
    assert np.sort(worm.extremes) == pytest.approx(
        np.sort(np.concatenate([own, -np.array(own)])), abs=1e-9
    )


# -- scenes ----------------------------------------------------------------------------------------


def test_the_packaged_scene_reaches_its_closed_form():
    result = solved()
    top = math.sin(math.pi / 2 * 0.014 / 0.026)
    assert result.status == "ok"
    assert result.trust["warnings"] == []
    for name in ("velocity_closed_form", "velocity_steady", "velocity_steady_second"):
        assert value(result, name) == pytest.approx(top, abs=1e-13)
    assert value(result, "velocity_exact_mean") == pytest.approx(top, abs=4e-6)
    assert value(result, "averaging_error_second") < 4e-6
    assert value(result, "steady_stable") == [1]
    assert abs(value(result, "exact_drift")) < 1e-12
    assert value(result, "force_mean") == pytest.approx([0.0] * 3, abs=1e-13)
    assert value(result, "recheck_error") < 1e-11
    assert value(result, "advance") == pytest.approx(
        PERIOD * value(result, "velocity_exact_mean"), rel=1e-14
    )
    # what actuators give, friction takes
    cost = value(result, "power_mean") / value(result, "velocity_exact_mean")
    assert value(result, "energy_per_distance") == pytest.approx(cost, rel=1e-14)
    end = result["center_velocity"].values[-1]
    assert end == pytest.approx(result["center_velocity_averaged"].values[-1], abs=2e-3)
    assert sorted(result["event_contact"].values.tolist()) == [0, 0, 1, 1, 2, 2]
    # each mass a third of a period behind the one before
    swings = np.cos(2 * np.pi * (result["share"].values - np.arange(3)[:, None] / 3))
    assert result["relative_velocity"].values == pytest.approx(swings, abs=1e-13)


def test_power_is_that_of_the_averages():
    # mean of |F v| with V at its steady value: work of friction both ways, in closed form
    V, forward, backward = math.sin(math.pi / 2 * 0.014 / 0.026), 0.006, 0.02
    turn = math.acos(-V)  # forward for |t| < turn
    ahead = (V * turn + math.sin(turn)) / math.pi
    behind = ahead - V
    lost = 3 * (forward * ahead + backward * behind)
    assert value(solved(), "power_mean") == pytest.approx(lost, rel=1e-4)


def test_masses_that_reverse_at_once_go_at_half_their_amplitude():
    # at any time two go forward and one back: friction cancels, and V stays A / 2 exactly
    result = solved("worm.friction.forward=0.01")
    assert result.status == "ok"
    assert value(result, "velocity_steady") == pytest.approx(0.5, abs=1e-14)
    assert value(result, "velocity_exact_mean") == pytest.approx(0.5, abs=2e-9)
    assert value(result, "velocity_ripple") < 1e-9


@pytest.mark.slow
def test_friction_that_falls_with_velocity_lets_equals_go_either_way():
    law = 'worm.friction={kind="stribeck", forward=0.001, backward=0.001, stick_forward=0.03, '
    law += "stick_backward=0.03, v_stribeck=0.8}"
    ahead, back, still = (
        solved(law, f"start.velocity={V}", "time.periods=2") for V in (0.1, -0.1, 0.0)
    )
    back_V, rest, ahead_V = value(ahead, "steady_velocities")
    assert value(ahead, "steady_stable") == [1, 0, 1]
    assert ahead_V == pytest.approx(-back_V, abs=1e-12)
    assert rest == pytest.approx(0.0, abs=1e-12)
    assert value(ahead, "velocity_steady") == ahead_V
    assert value(back, "velocity_steady") == back_V
    assert value(ahead, "exact_velocities")[0] == pytest.approx(back_V, abs=1e-3)
    # the mean force at the steady velocity, by another route
    law_ = Stribeck(0.001, 0.001, stick_forward=0.03, stick_backward=0.03, v_stribeck=0.8)
    force = mean_force(law_, ahead_V, np.array([1.0]), np.array([0.0]))
    assert force == pytest.approx(0.0, abs=1e-12)
    # a start on a steady velocity stays there, stable or not
    assert value(still, "velocity_steady") == rest
    assert value(still, "stable") == 0


@pytest.mark.parametrize("off", [-1e-16, 0.0, 1e-16])
def test_a_start_on_a_root_with_round_off_stays_on_it(off: float):
    steady = [Steady(-0.7, -1.0), Steady(off, 1.0), Steady(0.7, -1.0)]
    assert tends_to(0.0, steady, 1e-9) == 1
    assert tends_to(1e-6, steady, 1e-9) == 2
    assert tends_to(-1e-6, steady, 1e-9) == 0


def test_a_velocity_that_may_be_zero_is_unknown():
    # two equal masses, friction alike both ways: nothing tells forward from backward
    result = solved("worm.masses=2", "worm.harmonic.0.phase=[0, 180]", "worm.friction.forward=0.02")
    assert result.status == "ok"
    assert value(result, "velocity_steady") == pytest.approx(0.0, abs=1e-12)
    for name in ("velocity_exact_mean", "energy_per_distance", "advance"):
        assert value(result, name) is None
    assert value(result, "power_mean") > 0
    assert any("may be zero" in text for text in result.trust["warnings"])


@pytest.mark.slow
@pytest.mark.slow
@pytest.mark.parametrize(
    "lost", [pytest.param("not_finite", marks=pytest.mark.slow), "no_periodic_motion"]
)
def test_an_orbit_nobody_chose_takes_no_other_with_it(monkeypatch: pytest.MonkeyPatch, lost: str):
    def orbit(self: Runner, guess: float, **options: Any):
        if abs(guess) < 0.1:
            raise SolveError("none here", code=lost)
        return honest(self, guess, **options)

    honest = Runner.orbit
    monkeypatch.setattr(Runner, "orbit", orbit)
    law = 'worm.friction={kind="stribeck", forward=0.001, backward=0.001, stick_forward=0.03, '
    law += "stick_backward=0.03, v_stribeck=0.8}"
    result = solved_anew(law, "start.velocity=0.1", "time.periods=2")
    assert result.status == "ok"
    back, rest, ahead = value(result, "exact_velocities")
    assert rest is None
    assert back == pytest.approx(-ahead, abs=1e-6)
    assert "center" in {variable.name for variable in result.variables}
    assert any("no exact motion was found at the steady" in t for t in result.trust["warnings"])
    # the one chosen is needed
    chosen = solved_anew(law, "start.velocity=0", "time.periods=2")
    assert chosen.status == "failed"
    assert "none here" in chosen.reason
    assert "center" in {variable.name for variable in chosen.variables}


def test_without_recheck_there_is_none_and_a_warning(monkeypatch: pytest.MonkeyPatch):
    def never(*given: Any, **options: Any):
        raise AssertionError

    monkeypatch.setattr("wormopt.systems.shared.proof.simulate", never)
    result = solved_anew("tolerance.recheck=false")
    assert result.status == "unchecked"
    assert value(result, "recheck_error") is None
    assert result.trust["exact"]["recheck"] is None
    assert any("tolerance.recheck is false" in text for text in result.trust["warnings"])


def test_friction_that_is_not_small_is_told_and_rests_too():
    result = solved("worm.friction={kind='coulomb', forward=0.6, backward=2.0}")
    assert result.status == "ok"
    warnings = " ".join(result.trust["warnings"])
    assert "friction is not small" in warnings
    assert "rests for 0.036 of the period" in warnings
    assert value(result, "rest_share") == pytest.approx(0.036, abs=0.001)
    assert value(result, "averaging_error_second") > 0.01


def test_a_course_that_is_too_short_is_told():
    assert any("more time.periods" in w for w in solved("time.periods=3").trust["warnings"])


def test_units_and_masses_scale_the_answer():
    # velocities tenfold, frequency double, forces and masses a hundredfold: nothing else changes
    plain = solved()
    large = solved(
        'units="SI"', "worm.mass=100", "worm.frequency=2", "worm.harmonic.0.amplitude=10",
        "worm.friction.forward=12", "worm.friction.backward=40",
    )  # fmt: skip
    for name, factor in (
        ("velocity_exact_mean", 10),
        ("averaging_error_second", 10),
        ("advance", 5),
    ):
        assert value(large, name) == pytest.approx(factor * value(plain, name), rel=1e-6)
    assert large.scalars["velocity_steady"].unit == "m s-1"
    assert large.scalars["power_mean"].unit == "W"


def test_a_run_saves_its_picture(tmp_path: Path):
    folder = tmp_path / "out"
    assert main(["run", SCENE, "-o", str(folder), "--quiet"]) == 0
    assert (folder / "reversals.png").stat().st_size > 10_000
    assert Result.load(folder)["relative_velocity"].values.shape == (3, 721)


# -- failures --------------------------------------------------------------------------------------


def failed_checks(result: Result) -> list[str]:
    return [check.name for check in result.checks if not check.passed]


def test_a_second_route_that_ends_elsewhere_fails(monkeypatch: pytest.MonkeyPatch):
    def elsewhere(*given: Any, **options: Any) -> CrossCheck:
        found = honest(*given, **options)
        assert found
        return dataclasses.replace(found, error=1e-3)

    honest = steadies.cross_check
    monkeypatch.setattr(steadies, "cross_check", elsewhere)
    result = solved_anew()
    assert result.status == "failed"
    assert "ends in other states" in result.reason
    assert failed_checks(result) == ["second route"]


def test_too_few_nodes_fail(tmp_path: Path):
    law = 'worm.friction={kind="stribeck", forward=0.002, backward=0.004, stick_forward=0.02, '
    law += "stick_backward=0.03, v_stribeck=0.05}"
    options = ["--set", law, "--set", "averaging.nodes=4", "--quiet", "-o", str(tmp_path / "out")]
    assert main(["run", SCENE, *options]) == 3
    result = Result.load(tmp_path / "out")
    assert result.status == "failed"
    assert "larger averaging.nodes" in result.reason
    assert "averages on twice as many nodes" in failed_checks(result)


def test_masses_that_hand_their_rest_on_go_as_the_slowest_mass():
    """Friction lets two of three masses slide forward while one rests, which each does in turn."""
    result = solved("worm.friction={kind='coulomb', forward=3.0, backward=10.0}")
    assert result.status == "ok"
    mean = 1.5 * math.sqrt(3) / math.pi  # of the largest of three cosines
    assert value(result, "velocity_exact_mean") == pytest.approx(mean, abs=1e-8)
    assert value(result, "rest_share") == pytest.approx(1 / 3, abs=1e-8)


def test_masses_that_friction_stops_at_once_end_too():
    """A swing of 1e-9 is undone by friction within 1e-7 of a period: the average is stiff."""
    result = solved("worm.harmonic.0.amplitude=1e-9")
    mean = 1.5e-9 * math.sqrt(3) / math.pi  # of the largest of three cosines
    assert value(result, "velocity_exact_mean") == pytest.approx(mean, rel=1e-8, abs=0.0)
    assert value(result, "velocity_steady") == pytest.approx(
        1e-9 * math.sin(math.pi / 2 * 7 / 13), rel=1e-9, abs=0.0
    )


@pytest.mark.parametrize("backward", [2e-4, 2e-6])
def test_masses_that_all_but_cease_to_reverse_are_where_averages_bend(backward: float):
    """Second order falls short there; that is told, not held against the motion."""
    result = solved(f"worm.friction={{kind='coulomb', forward=0.006, backward={backward}}}")
    assert result.status == "ok"
    share = 0.006 / (0.006 + backward)
    assert value(result, "velocity_steady") == pytest.approx(math.sin(math.pi * (0.5 - share)))
    assert any("averages have a corner" in line for line in result.trust["warnings"])
    assert "second order" not in result.trust["checks"]


def test_averages_that_disagree_with_the_exact_motion_fail(monkeypatch: pytest.MonkeyPatch):
    def wrong(self: SlowVelocity, V: float) -> float:
        return honest(self, V) + 1e-3 * self.order

    honest = SlowVelocity.rate
    monkeypatch.setattr(SlowVelocity, "rate", wrong)
    result = solved_anew()
    assert result.status == "failed"
    assert "the closed form gives" in result.reason
    assert "exact mean velocity differs from second-order averaging" in result.reason
    assert failed_checks(result) == ["closed form", "second order"]


@pytest.mark.parametrize(
    ("change", "key", "message"),
    [
        ("worm.harmonic.0.phase=[0, 120, 230]", "worm.harmonic[0]", "add up to amplitude 0.17"),
        ("worm.mass=[1, 1, 2]", "worm.harmonic[0]", "add up to amplitude 1 at phase -120"),
        ("worm.mass=[1, 2]", "worm.mass", "2 entries for 3 masses"),
        ("worm.harmonic.0.amplitude=[1, 1]", "worm.harmonic[0].amplitude", "2 entries"),
        ("worm.harmonic.0.amplitude=0", "worm.harmonic", "mass 0, 1, 2 does not swing"),
        ("worm.harmonic=[{amplitude=[1, 1, 0], phase=[0, 180, 0]}]", "worm.harmonic", "mass 2"),
        ("worm.harmonic=[{amplitude=1, phase=[0,120,240]}, {amplitude=1, phase=[0,120,240]}]",
         "worm.harmonic[1].order", "repeats order 1"),
        ("worm.harmonic=[]", "worm.harmonic", "no mass swings"),
        ("worm.harmonic.0.order=6", "worm", "reverse too often"),
        ("worm.harmonic.0.order=0", "worm.harmonic[0].order", "1 to 12"),
        ("worm.masses=1", "worm.masses", "2 to 12"),
        ("worm.frequency=0", "worm.frequency", "above 0"),
        ('worm.friction={kind="spike"}', "worm.friction", "spikes do not slide back"),
        ("worm.friction.forward=0", "worm.friction", "no resistance to motion forward"),
        ('worm.friction={kind="viscous", drag=0}', "worm.friction", "forward"),
        ('worm.friction=[{kind="viscous", drag=1}]', "worm.friction", "1 entry for 3 masses"),
        ("worm.friction.stick_forward=0.001", "worm.friction.stick_forward", "below the sliding"),
        ("averaging.nodes=1", "averaging.nodes", "2 to 64"),
        ("time.periods=0", "time.periods", "1 to 10000"),
        ("worm.frequency=1e40", "worm.frequency", "too large"),
        ('want=["motion"]', "want", "reversals"),
    ],
)  # fmt: skip
def test_wrong_scenes_are_told(
    change: str, key: str, message: str, capsys: pytest.CaptureFixture[str]
):
    with pytest.raises(SceneError) as caught:
        load_scene(SCENE, [change])
    faults = caught.value.faults
    assert any(where.startswith(key) and message in text for where, text in faults), faults
    assert main(["run", SCENE, "--set", change]) == 2
    assert key.split("[")[0] in capsys.readouterr().err


def test_poles_are_no_roots():
    def rate(x: float) -> float:
        return (x - 0.3) / (x - 0.7) if x != 0.7 else math.inf

    found = sign_changes(rate, np.linspace(-1, 1, 50))
    assert found == pytest.approx([0.3], abs=1e-12)


def test_a_place_is_nothing_for_averages():
    model = harmonic_masses(np.cos(THIRDS), np.sin(THIRDS), law=COULOMB)
    moving = harmonic_masses(np.cos(THIRDS), np.sin(THIRDS), law=COULOMB, place=True)
    assert [s.name for s in moving.x] == ["center", "center_velocity"]
    averaged = average(model, PERIOD)
    assert [output.name for output in averaged.outputs] == []


@pytest.mark.parametrize("side", ["forward", "backward"])
def test_friction_too_large_to_be_followed_is_refused_at_once(side: str):
    """Impulse in a period, 2 pi 1e9 on each of three masses of speed 1: 2 pi 1e9 of momentum."""
    with pytest.raises(SceneError, match=r"worm.friction: .* by 6.28e\+09 .* smaller by 6.3"):
        wo.run(load_scene("three_masses_harmonic", [f"worm.friction.{side}=1e9"]))
