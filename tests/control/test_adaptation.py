"""Gains of lambda-trackers over time, plants with schedules, funnel control."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import casadi as ca
import numpy as np
import pytest
from effort import examples
from hypothesis import given, settings
from hypothesis import strategies as st
from loop_runs import Run
from worms import point, worm

from wormopt.control.funnel import Funnel, FunnelLaw, funnel_tracker
from wormopt.control.lambda_tracker import Adaptation, Decay, Exponent, Quadratic, lambda_tracker
from wormopt.control.loop import FeedForward, gait_reference
from wormopt.model.gait import Gait
from wormopt.model.model import Model, Output, Signal
from wormopt.model.schedule import ornstein_uhlenbeck, piecewise_constant
from wormopt.systems.spiked.construct import fast_gait

# -- adaptation, on an error prescribed in time --------------------------------------------------


def puppet(law: Adaptation, pieces: Sequence[tuple[float, float]], **options: Any) -> Model:
    """Loop whose error is piecewise linear in time, whatever the tracker does.

    The plant ignores its input and stays at 0, so the error is minus the reference. ``pieces``
    are (time, error) at the corners.
    """
    q, v, u = ca.SX.sym("q"), ca.SX.sym("v"), ca.SX.sym("u")
    x = [Signal("position", q, value=0.0), Signal("velocity", v, value=0.0)]
    outputs = [Output("length", q)]
    plant = Model("puppet", x, ca.vertcat(v, 0 * u), u=[Signal("input", u)], outputs=outputs)
    t, e = np.array(pieces).T
    polynomial = np.stack([-e[:-1], -np.diff(e) / np.diff(t)], axis=1)[:, None, :]
    reference = gait_reference(Gait(t, polynomial), plant.t)
    return lambda_tracker(plant, reference, tube_radius=0.2, adaptation=law, **options)


def test_growth_by_the_chapters_law_and_by_an_exponent():
    """|e| = 2.2 - t outside the tube: k - k(0) = gamma int (2 - t)^2, or (2 - t)(2.2 - t)^(r-1)."""
    fall = [(0.0, 2.2), (2.2, 0.0), (3.0, 0.0)]
    run = Run(puppet(Quadratic(1.5), fall, gain_start=0.7), 3.0)
    assert run.end[2] == pytest.approx(0.7 + 1.5 * 8 / 3, abs=1e-10)
    run = Run(puppet(Exponent(2.0), fall), 3.0)
    assert run.end[2] == pytest.approx(1 + 8 / 3 + 0.2 * 2, abs=1e-10)
    run = Run(puppet(Exponent(1.0), fall), 3.0)
    assert run.end[2] == pytest.approx(1 + 2, abs=1e-10)


def test_decay_goes_through_all_its_regimes():
    """|e| = 2.2 - t, then 0, then t - 5, with lambda = 0.2, dwell 0.9 and sigma = 0.3.

    Far until t = 1: int_0^1 (2 - t)^2 = 7/3; near until t = 2: int sqrt(2 - t) = 2/3; constant
    until t = 2.9; decay until the error leaves the tube at 5.2; then near again.
    """
    law = Decay(dwell=0.9, decay=0.3, growth=2.0)
    run = Run(puppet(law, [(0.0, 2.2), (2.2, 0.0), (5.0, 0.0), (6.0, 1.0)]), 6.0)
    assert run.events == [
        ("dwell time passes", pytest.approx(0.9)),  # outside the tube, without effect
        ("enters the wide tube", pytest.approx(1.0)),
        ("enters the tube", pytest.approx(2.0)),
        ("dwell time passes", pytest.approx(2.9)),
        ("leaves the tube", pytest.approx(5.2)),
    ]
    gain, times = run["gain"][:, 0], np.array(run.times)
    peak = 1 + 2 * (7 / 3 + 2 / 3)
    low = peak * np.exp(-0.3 * 2.3)
    by_hand = {1.0: 1 + 14 / 3, 2.0: peak, 2.9: peak, 5.2: low, 6.0: low + 4 / 3 * 0.8**1.5}
    for t, expected in by_hand.items():
        k = int(np.argmin(np.abs(times - t)))
        assert gain[k] == pytest.approx(expected, abs=2e-9)
    decaying = run["gain_decaying"][:, 0]
    assert np.array_equal(decaying == 1, (times > 2.8999) & (times < 5.1999))


def test_visits_to_the_tube_shorter_than_the_dwell_time_do_not_count():
    """In the tube on [0, 0.6], outside to 1.4 and inside again: decay from 2.4 on, not from 1."""
    corners = [(0.0, 0.0), (0.4, 0.0), (1.0, 0.6), (1.6, 0.0), (4.0, 0.0)]
    run = Run(puppet(Decay(dwell=1.0, decay=0.5), corners), 4.0)
    visits = [(n, round(t, 9)) for n, t in run.events if n != "dwell time passes"]
    assert visits == [("leaves the tube", 0.6), ("enters the tube", 1.4)]
    assert run.events[-1] == ("dwell time passes", pytest.approx(2.4))
    grown = 1 + 2 * (2 / 3) * 0.4**1.5
    assert run.end[2] == pytest.approx(grown * np.exp(-0.5 * 1.6), abs=2e-9)


def test_an_error_that_starts_in_the_tube_has_entered_it_at_the_start():
    run = Run(puppet(Decay(dwell=1.0, decay=0.5), [(0.0, 0.1), (3.0, 0.1)]), 3.0)
    assert run.events == [("dwell time passes", pytest.approx(1.0))]
    assert run.end[2] == pytest.approx(np.exp(-0.5 * 2.0), abs=1e-10)


def test_an_error_just_outside_of_the_tube_lets_no_gain_decay():
    """|e| = 0.3 beside lambda = 0.2: the gain grows by sqrt(0.1) all the time."""
    run = Run(puppet(Decay(dwell=1.0, decay=0.5), [(0.0, 0.3), (3.0, 0.3)]), 3.0)
    assert run.events == [("dwell time passes", pytest.approx(1.0))]
    assert run.end[2] == pytest.approx(1 + 3 * np.sqrt(0.1), abs=1e-10)


def test_watching_the_tube_locates_crossings_and_changes_nothing():
    """On the real worm with a small gain: the error enters and leaves the tube many times."""
    plant = worm()
    options: dict[str, Any] = {"tube_radius": 0.2, "adaptation": Quadratic(5.0)}
    reference = gait_reference(fast_gait(1.0), plant.t)
    watched = Run(lambda_tracker(plant, reference, watch=True, **options), 3.0)
    plain = Run(lambda_tracker(plant, reference, **options), 3.0)
    assert plain.events == []
    names = [name for name, _ in watched.events]
    assert len(names) >= 6
    assert set(names[::2]) == {"leaves the tube"}  # it starts on the reference
    assert set(names[1::2]) == {"enters the tube"}
    assert watched.end == pytest.approx(plain.end, abs=1e-8)
    norm, gain = watched["error_norm"][:, 0], watched["gain"][:, 0]
    times = np.array(watched.times)
    for (name, t), (_, until) in zip(watched.events[:-1], watched.events[1:], strict=True):
        first, last = (int(np.argmin(np.abs(times - s))) for s in (t, until))
        assert norm[first] == pytest.approx(0.2, abs=1e-10)
        grown = gain[last] - gain[first]
        # Located in a step across the kink of k', so not to the last digit.
        assert abs(grown) < 1e-9 if name == "enters the tube" else grown > 0.1


# -- plants with schedules of their own ----------------------------------------------------------


def test_random_links_and_a_gait_run_through_one_loop():
    """A path without spread is the constant; one with spread gives another motion."""

    def end(stiffness: Any) -> np.ndarray:
        plant = worm(stiffness=stiffness)
        reference = gait_reference(fast_gait(1.0), plant.t, shift=0.2)
        loop = lambda_tracker(plant, reference, tube_radius=0.2, feedback="filter")
        names = [s.name for s in loop.schedules]
        assert names == ([] if isinstance(stiffness, float) else ["stiffness"]) + ["reference"]
        return Run(loop, 1.5, rtol=1e-10).end

    def steps(spread: float) -> Any:
        return piecewise_constant(np.random.default_rng(1), [10.0, 10.0], spread, 0.4, 1.5)

    constant = end(10.0)
    assert end(steps(0.0)) == pytest.approx(constant, abs=1e-8)
    assert np.abs(end(steps(3.0)) - constant).max() > 1e-4
    still = ornstein_uhlenbeck(np.random.default_rng(1), [10.0, 10.0], 0.0, 1.0, 0.5, 1.5)
    assert end(still) == pytest.approx(constant, abs=1e-8)


def test_members_of_an_ensemble_share_their_expressions():
    """Two draws differ in the schedule's values alone, so one compiled model serves both."""

    def loop(seed: int) -> Model:
        path = ornstein_uhlenbeck(np.random.default_rng(seed), [10.0, 10.0], 2.0, 1.0, 0.5, 1.5)
        plant = worm(stiffness=path)
        return lambda_tracker(plant, gait_reference(fast_gait(1.0), plant.t), tube_radius=0.2)

    first, second = loop(1), loop(2)
    assert str(first.ode) == str(second.ode)
    one, other = first.schedules[0], second.schedules[0]
    assert np.array_equal(one.breaks, other.breaks)
    assert not np.array_equal(one.values, other.values)
    mixed = replace(first, schedules=[replace(one, values=other.values), first.schedules[1]])
    assert Run(mixed, 0.6, rtol=1e-9).end == pytest.approx(Run(second, 0.6, rtol=1e-9).end)


# -- funnel control ------------------------------------------------------------------------------


@pytest.mark.parametrize("law", ["recursive", "two gains"])
@settings(max_examples=examples(20))
@given(seed=st.integers(0, 10**6))
def test_the_force_of_the_funnel_controller_at_a_point(law: FunnelLaw, seed: int):
    """k_0 = 1/(1 - |e|^2/psi_0^2), e_1 = e' + k_0 e, k_1 likewise, u = -gain k_1 e_1.

    With two gains k_0 = 1/(1 - |e|/psi_0), k_1 likewise of e', u = -gain (k_0^2 e + k_1 e').
    """
    random = np.random.default_rng(seed)
    plant = worm()
    loop = funnel_tracker(
        plant, gait_reference(Gait(np.array([0.0, 1.0]), np.full((1, 2, 1), 2.0)), plant.t),
        funnel=Funnel(2.0, 0.5, time=2.0), rate_funnel=Funnel(9.0, 3.0, time=1.0), law=law,
        gain=3.0, feedforward=FeedForward(10.0, 1.5),
    )  # fmt: skip
    e, rate = random.uniform(-0.5, 0.5, 2), random.uniform(-1, 1, 2)
    x = {"position": [4 + e.sum(), 2 + e[1], 0.0], "velocity": [rate.sum(), rate[1], 0.0]}
    at = point(loop, x, [np.full(2, 2.0)])
    width, rate_width = 0.5 + 1.5 * np.exp(-0.2), 3 + 6 * np.exp(-0.4)
    if law == "recursive":
        k0 = 1 / (1 - (e @ e) / width**2)
        inner = rate + k0 * e
        k1 = 1 / (1 - (inner @ inner) / rate_width**2)
        u = -3 * k1 * inner
    else:
        inner = rate
        k0, k1 = 1 / (1 - np.hypot(*e) / width), 1 / (1 - np.hypot(*rate) / rate_width)
        u = -3 * (k0**2 * e + k1 * rate)
    assert at["input"] == pytest.approx(u + 10 * 0.5, rel=1e-9)
    assert at["funnel_gain"] == pytest.approx([k0, k1])
    assert (at["funnel"][0], at["rate_funnel"][0]) == pytest.approx((width, rate_width))
    assert at["rate_error_norm"][0] == pytest.approx(np.hypot(*inner))


def test_a_start_outside_a_funnel_is_refused_with_its_numbers():
    """e(0) = (0.3, 0.4) - 0: |e| = 0.5; e_1 = e' + e / (1 - 0.25) at psi_0 = 1."""
    plant = worm(position=(4.7, 2.4, 0.0), velocity=(0.9, 0.0, 0.0))
    # The gait shifted by a quarter of its two pieces: the second piece counts, 2 throughout.
    polynomial = np.array([[[9.0], [9.0]], [[2.0], [2.0]]])
    reference = gait_reference(Gait(np.array([0.0, 0.5, 1.0]), polynomial), plant.t, shift=-1.25)
    wide = Funnel(9.0, 1.0, time=1.0)
    with pytest.raises(ValueError, match=r"the error starts at 0\.5, outside its funnel of 0\.5"):
        funnel_tracker(plant, reference, funnel=Funnel(0.5, 0.1, time=1.0), rate_funnel=wide)
    e1 = np.array([0.9, 0.0]) + np.array([0.3, 0.4]) / 0.75
    start = f"{np.sqrt(e1 @ e1):.6g}"
    funnel = Funnel(1.0, 0.1, time=1.0)
    with pytest.raises(ValueError, match=rf"e' \+ k_0 e starts at {start}, outside .* of 1.4"):
        funnel_tracker(plant, reference, funnel=funnel, rate_funnel=Funnel(1.4, 0.1, time=1.0))
    unknown = replace(plant, x=[replace(s, value=None) for s in plant.x])
    funnel_tracker(unknown, reference, funnel=Funnel(0.5, 0.1, time=1.0), rate_funnel=wide)
