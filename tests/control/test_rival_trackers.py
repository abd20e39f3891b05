"""Backstepping, gains that jump, two funnels: forces by hand, and what each of them promises."""

import inspect
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np
import pytest
from effort import examples
from hypothesis import assume, example, given, settings
from hypothesis import strategies as st
from on_gaits import LOOSE, following
from outcomes import value
from worms import point, worm

import wormopt as wo
from tests.oracles.by_text import RANDOM, TRACK, write
from wormopt.control.funnel import Funnel, FunnelLaw, _check_room, funnel_tracker
from wormopt.control.lambda_tracker import Feedback, Quadratic, lambda_tracker
from wormopt.control.loop import Reference, gait_reference
from wormopt.control.switching import switching_tracker
from wormopt.errors import ArgumentError, SceneError
from wormopt.model.friction import Coulomb
from wormopt.model.gait import Gait
from wormopt.model.model import Model
from wormopt.simulation.simulate import simulate
from wormopt.study import load_scene
from wormopt.systems.chain.build import chain

# -- forces at a point, by hand ------------------------------------------------------------------


@settings(max_examples=examples(20))
@given(seed=st.integers(0, 10**6))
def test_the_force_of_backstepping_and_of_switching_at_a_point(seed: int):
    random = np.random.default_rng(seed)
    plant = worm(2, position=(4.0, 2.0, 0.0))
    gait = Gait(np.array([0.0, 1.0]), np.full((1, 2, 1), 2.0))
    reference = gait_reference(gait, plant.t)
    e, k, xi = random.uniform(-1, 1, 2), random.uniform(0.5, 3), random.uniform(-2, 2, 2)
    x = {"position": [4 + e.sum(), 2 + e[1], 0.0], "velocity": np.zeros(3), "gain": k}
    stepped = lambda_tracker(plant, reference, tube_radius=0.2, feedback="backstepping")
    at = point(stepped, x | {"input_filter": xi}, [np.full(2, 2.0)])
    u = -k * e - (k**2 + e @ e) * k**4 * (1 + xi @ xi) * (xi + k * e)
    assert at["input"] == pytest.approx(u, rel=1e-10)
    rate = max(0.0, np.sqrt(e @ e) - 0.2) ** 2
    assert at["ode"][6:] == pytest.approx([rate, *(u - xi)], rel=1e-10)
    switched = switching_tracker(plant, reference, tube_radius=0.2, settling=1.0, overshoot=0.1)
    names = ("trial_bound", "trial_end", "trial_time", "trial_margin")
    at = point(switched, x | {"filter": xi} | dict.fromkeys(names, 1.0), [np.full(2, 2.0)])
    slope = k**2 * (e - xi)
    assert at["input"] == pytest.approx(-(k**2 * xi + k * slope), rel=1e-10)
    assert at["ode"][6:] == pytest.approx([0.0, *slope, 0, 0, 0, 0], rel=1e-10)
    assert at["gain_rate"].tolist() == [0.0]


def test_the_first_bound_of_switching_is_above_the_error_and_the_tube():
    """Links of 2.4 and 2.2 are to be 2 long; the first trial may use a share of the overshoot."""
    plant, share = worm(2, position=(4.6, 2.2, 0.0)), 1 - np.sqrt(0.5)
    for radius, widest in ((0.2, np.hypot(0.4, 0.2)), (0.6, 0.6)):
        trials: dict[str, Any] = SWITCHING | {"tube_radius": radius}
        loop = switching_tracker(plant, STILL, **trials)
        values = {signal.name: signal.value for signal in loop.x}
        assert values["trial_bound"] == pytest.approx(widest + share * 0.1, rel=1e-14)
        assert values["trial_margin"] == pytest.approx(share * 0.1, rel=1e-14)


def test_every_gain_of_switching_is_twice_the_one_before_if_nothing_else_is_said():
    """The first trial then has 1 - 1/sqrt(2) of the time to settle."""
    plant = worm(2, position=(4.0, 2.0, 0.0))
    loop = switching_tracker(plant, following(plant), tube_radius=0.2, settling=3.0, overshoot=0.1)
    values = {signal.name: signal.value for signal in (*loop.x, *loop.p)}
    assert values["gain_factor"] == 2.0
    assert values["gain"] == 1.0
    assert values["trial_end"] == pytest.approx(3.0 * (1 - np.sqrt(0.5)), rel=1e-14)
    with pytest.raises(ArgumentError, match="factor must be finite and above 1"):
        switching_tracker(plant, STILL, **SWITCHING, factor=1.0)
    (factor,) = (signal for signal in loop.p if signal.name == "gain_factor")
    factor.check(np.array([1.0]))
    with pytest.raises(ArgumentError, match="gain_factor"):
        factor.check(np.array([np.nextafter(1.0, 0.0)]))


@pytest.mark.parametrize(
    ("feedback", "usual"),
    [
        ("filter", {"gain": 1.0, "filter": (1.0, 1.0), "gain_growth": (1.0,)}),
        ("difference", {"gain": 1.0, "lag": 0.01, "gain_growth": (1.0,)}),
        ("backstepping", {"gain": 1.0, "input_filter": 0.0, "gain_growth": (1.0,)}),
    ],
)
def test_trackers_start_and_grow_by_1_if_nothing_else_is_said(feedback: Feedback, usual: dict):
    plant = worm()
    loop = lambda_tracker(plant, following(plant), tube_radius=0.2, feedback=feedback)
    assert not loop.switches
    values = {signal.name: signal.value for signal in (*loop.x, *loop.p)}
    assert {name: values[name] for name in usual} == usual


numbers_of_funnels = st.floats(0.1, 5.0)


@settings(max_examples=examples(100))
@given(st.builds(Funnel, *[numbers_of_funnels] * 3), st.builds(Funnel, *[numbers_of_funnels] * 3))
@example(Funnel(2.0, 0.1, 3.0), Funnel(5.0, 0.2, 0.2))  # too narrow on the way only
@example(Funnel(2.0, 1.0, 1.0), Funnel(1.5, 0.5, 0.1))  # early on the way only
@example(Funnel(2.0, 1.0, 10.0), Funnel(0.15, 0.05, 1.0))  # the same, slower and smaller
@example(Funnel(2.0, 1.0, 1.0), Funnel(1.23, 0.23, 0.5))  # for a short while
@example(Funnel(2.0, 1.0, 1.0), Funnel(1.053, 0.75, 0.5))  # it would have been before
@example(Funnel(2.0, 0.1, 3.0), Funnel(5.0, 0.7, 0.2))  # nowhere too narrow
@example(Funnel(1.0, 1.0, 1.0), Funnel(1.0, 1.0, 2.0))  # neither narrows
@example(Funnel(2.0, 1.0, 1.0), Funnel(3.0, 2.0, 1.0))  # both at once
def test_an_error_at_the_edge_of_its_funnel_can_follow_it(funnel: Funnel, rate_funnel: Funnel):
    t = np.linspace(0.0, 60.0, 60_001)

    def width(of: Funnel) -> np.ndarray:
        start, end, time = map(float, (of.start, of.end, of.time))
        return end + (start - end) * np.exp(-t / time)

    room = (width(rate_funnel) + np.gradient(width(funnel), t)).min()
    assume(abs(room) > 1e-2)
    if room > 0:
        _check_room(funnel, rate_funnel)
    else:
        with pytest.raises(ArgumentError, match="the funnel narrows at"):
            _check_room(funnel, rate_funnel)


# -- what trackers promise, on random worms ------------------------------------------------------

worms = st.fixed_dictionaries(
    {
        "mass": st.floats(0.5, 2),
        "stiffness": st.floats(0, 20),
        "damping": st.floats(0, 8),
        "law": st.builds(Coulomb, st.floats(0.1, 3), st.floats(0.1, 12)),
        "position": st.tuples(st.floats(3.9, 4.2), st.floats(1.9, 2.1), st.just(0.0)),
    }
)


@pytest.mark.slow
@settings(max_examples=examples(6))
@given(numbers=worms, feedback=st.sampled_from(["derivative", "filter", "difference"]))
def test_gains_grow_by_what_is_outside_of_the_tube_and_keep_it_there(
    numbers: dict[str, Any], feedback: Feedback
):
    """k(t) - k(0) is the integral of gamma [|e| - lambda]+^2; in the end |e| <= 1.15 lambda."""
    plant, gamma, lam = worm(**numbers), 1e4, 0.2
    loop = lambda_tracker(
        plant, following(plant), tube_radius=lam, feedback=feedback, lag=0.01,
        adaptation=Quadratic(gamma), filter_start=0.0, watch=True,
    )  # fmt: skip
    end = 6.0
    motion = simulate(loop, end, dense=True, tolerance=LOOSE)
    t = np.linspace(0, end, 60_001)
    at = motion.at(t)
    gain, excess = at["gain"][0], np.maximum(at["error_norm"][0] - lam, 0)
    assert np.diff(gain).min() >= -1e-9
    assert gain[-1] - gain[0] == pytest.approx(gamma * np.trapezoid(excess**2, t), rel=1e-4)
    assert excess[t > 5].max() < 0.15 * lam


@settings(max_examples=examples(6))
@given(
    numbers=worms,
    factor=st.floats(1.2, 3),
    settling=st.floats(0.2, 1),
    overshoot=st.floats(0.05, 0.5),
)
def test_switching_keeps_what_is_prescribed(
    numbers: dict[str, Any], factor: float, settling: float, overshoot: float
):
    plant, lam = worm(**numbers), 0.2
    loop = switching_tracker(
        plant, following(plant), tube_radius=lam, settling=settling, overshoot=overshoot,
        factor=factor, gain_start=2.0,
    )  # fmt: skip
    end = 1.5
    motion = simulate(loop, end, dense=True, tolerance=LOOSE)
    t = np.linspace(0, end, 3001)
    at = motion.at(t)
    size, gain = at["error_norm"][0], at["gain"][0]
    assert motion.largest("error_norm") <= max(size[0], lam) + overshoot + 1e-7
    assert np.mean(size > lam + 1e-7) * end <= settling + 1e-3
    failed = sum(event.name == "trial fails" for event in motion.events)
    assert gain[-1] == pytest.approx(2.0 * factor**failed, rel=1e-12)
    assert np.diff(gain).min() >= 0
    assert set(np.round(np.log(gain / 2) / np.log(factor), 9)) <= set(range(failed + 1))


@settings(max_examples=examples(6))
@given(numbers=worms, law=st.sampled_from(["recursive", "two gains"]))
def test_errors_stay_in_their_funnels_and_gains_are_bounded(
    numbers: dict[str, Any], law: FunnelLaw
):
    plant = worm(**numbers)
    loop = funnel_tracker(
        plant, following(plant), law=law, gain=20.0,
        funnel=Funnel(1.0, 0.2, time=0.5), rate_funnel=Funnel(5.0, 4.0, time=0.5),
    )  # fmt: skip
    motion = simulate(loop, 3.0, dense=True, tolerance=LOOSE)
    for norm, width in (("error_norm", "funnel"), ("rate_error_norm", "rate_funnel")):
        assert motion.largest(loop[norm] / loop[width]) < 0.99
    assert motion.largest("funnel_gain") < 100


@pytest.mark.slow
@settings(max_examples=examples(6))
@given(mass=st.floats(0.5, 2), stiffness=st.floats(5, 15), lam=st.floats(0.3, 0.5))
def test_backstepping_tracks_by_small_gains(mass: float, stiffness: float, lam: float):
    """With a feed-forward of the springs; the gain is the integral of what is outside."""
    plant = worm(mass=mass, stiffness=stiffness, law=Coulomb(0.5, 2.0), position=(4.0, 2.0, 0.0))
    loop = lambda_tracker(
        plant, following(plant), tube_radius=lam, feedback="backstepping", gain_start=0.8,
        adaptation=Quadratic(1e4), watch=True, feedforward=wo.FeedForward(stiffness, 2.0, 5.0),
    )  # fmt: skip
    motion = simulate(loop, 4.0, dense=True, tolerance=LOOSE)
    t = np.linspace(0, 4, 40_001)
    at = motion.at(t)
    excess = np.maximum(at["error_norm"][0] - lam, 0)
    gained = 1e4 * np.trapezoid(excess**2, t)
    assert at["gain"][0, -1] - 0.8 == pytest.approx(gained, rel=1e-3, abs=1e-7)
    assert excess[t > 3].max() < 0.15 * lam


# -- what is refused -----------------------------------------------------------------------------


def test_an_error_that_starts_at_the_edge_of_its_funnel_is_refused():
    plant, wide = worm(position=(4.5, 2.0, 0.0)), Funnel(9.0, 9.0, 1.0)
    funnel = Funnel(0.5, 0.5, 1.0)
    with pytest.raises(ArgumentError, match=r"starts at 0\.5, outside"):
        funnel_tracker(plant, STILL, funnel=funnel, rate_funnel=wide, law="two gains")
    least = Funnel(np.nextafter(0.5, 1.0), 0.5, 1.0)
    loop = funnel_tracker(plant, STILL, funnel=least, rate_funnel=wide, law="two gains")
    assert [signal.value for signal in loop.p if signal.name == "gain"] == [1.0]  # as none is said


def test_no_more_room_than_needed_is_too_little():
    """The funnel narrows by 1 at first; links that part by 0.5 touch a rate funnel of 0.5."""
    with pytest.raises(ArgumentError, match="narrows at the rate 1, but the rate funnel"):
        _check_room(Funnel(2.0, 1.0, 1.0), Funnel(1.0, 1.0, 1.0))
    plant = worm(position=(4.0, 2.0, 0.0), velocity=(0.5, 0.0, 0.0))
    wide, law = Funnel(9.0, 9.0, 1.0), "two gains"
    for width in (0.5, np.nextafter(0.5, 1.0)):
        narrow = Funnel(width, 0.5, 1.0)
        if width > 0.5:
            funnel_tracker(plant, STILL, funnel=wide, rate_funnel=narrow, law=law)
        else:
            with pytest.raises(ArgumentError, match=r"e' starts at 0\.5, outside"):
                funnel_tracker(plant, STILL, funnel=wide, rate_funnel=narrow, law=law)


@pytest.mark.parametrize("law", ["recursive", "two gains"])
@pytest.mark.parametrize("which", ["funnel", "rate_funnel"])
@pytest.mark.parametrize("part", ["start", "end", "time"])
def test_funnels_of_symbols_are_not_judged(law: FunnelLaw, which: str, part: str):
    """One number that is the plant's own parameter: what is known later is checked later."""
    plant = chain(1, mass=1.0, stiffness=1.0, damping=1.0, rest_length=2.0, drag=0.1,
                  position=(2.0, 0.0))  # fmt: skip
    still = Reference(ca.SX([2.0]), ca.SX(1, 1), ca.SX(1, 1))
    funnels: dict[str, Any] = {"funnel": Funnel(1.0, 0.1, 1.0)}
    funnels |= {"rate_funnel": Funnel(2.0, 1.0, 1.0)}
    funnels[which] = replace(funnels[which], **{part: plant["stiffness"]})
    loop = funnel_tracker(plant, still, **funnels, law=law)
    assert ca.depends_on(loop[which], plant["stiffness"])
    assert f"{which}_{part}" not in {signal.name for signal in loop.p}


STILL = Reference(ca.SX([2.0, 2.0]), ca.SX(2, 1), ca.SX(2, 1))
SWITCHING: dict[str, Any] = {"tube_radius": 0.2, "settling": 1.0, "overshoot": 0.1}


def test_switching_needs_a_start_and_a_funnel_does_not():
    plant = worm()
    unknown = replace(plant, x=[replace(signal, value=None) for signal in plant.x])
    with pytest.raises(ArgumentError, match="needs initial values"):
        switching_tracker(unknown, STILL, **SWITCHING)
    loop = funnel_tracker(unknown, STILL, funnel=Funnel(9, 8, 1), rate_funnel=Funnel(9, 8, 1))
    assert [signal.value for signal in loop.x] == [None, None]


@pytest.mark.parametrize("make", [lambda_tracker, switching_tracker, funnel_tracker])
def test_plant_and_reference_come_first_and_all_else_by_name(make: Callable[..., Model]):
    first, second, *others = inspect.signature(make).parameters.values()
    assert first.kind == second.kind == inspect.Parameter.POSITIONAL_OR_KEYWORD
    assert {other.kind for other in others} == {inspect.Parameter.KEYWORD_ONLY}


def test_a_filter_starts_at_one_number_or_one_for_each_link():
    with pytest.raises(ArgumentError, match="filter_start must be one number or 2"):
        lambda_tracker(worm(), STILL, tube_radius=0.2, feedback="filter", filter_start=[1, 2, 3])


WRONG = [float("nan"), float("inf"), -1.0, 0.0, "a", 1j, [1.0, 2.0, 3.0], True, 10**400]


@pytest.mark.parametrize("wrong", WRONG, ids=lambda wrong: repr(wrong)[:9])
def test_what_is_no_number_model_or_name_is_refused(wrong: Any):
    """Whatever it is, by an ArgumentError."""
    wide, plant = Funnel(9.0, 8.0, 1.0), worm(position=(4.0, 2.0, 0.0))
    trials: list[tuple[Any, dict[str, Any], tuple[str, ...]]] = [
        (lambda_tracker, {"tube_radius": 0.2, "feedback": "difference"},
         ("tube_radius", "gain_start", "lag", "feedback", "actuator", "adaptation")),
        (switching_tracker, SWITCHING,
         ("tube_radius", "settling", "overshoot", "gain_start", "factor", "actuator")),
        (funnel_tracker, {"funnel": wide, "rate_funnel": wide},
         ("funnel", "rate_funnel", "law", "gain", "actuator", "feedforward")),
        (wo.Delay, {"name": "past", "symbol": ca.SX.sym("p"), "signal": ca.SX.sym("x"), "lag": 1.0},
         ("symbol", "signal", "lag", "before")),
    ]  # fmt: skip
    for make, usual, keys in trials:
        for key in keys:
            if key == "before" and wrong == 0.0:
                continue  # a past of 0
            first: Any = () if make is wo.Delay else (plant, STILL)
            with pytest.raises(ArgumentError):
                make(*first, **(usual | {key: wrong}))


# -- scenes --------------------------------------------------------------------------------------

RIVALS = (
    'tracker=[{feedback="difference", lag=0.05, tube_radius=0.2, growth=1e4},'
    '{feedback="switching", tube_radius=0.2, settling=0.5, overshoot=0.3, gain_start=5},'
    '{feedback="backstepping", tube_radius=0.3, feedforward={}},'
    '{feedback="funnel", law="two gains", funnel={start=1, end=0.2, time=0.5}, gain=20,'
    " rate_funnel={start=4, end=3, time=0.5}}]"
)


@pytest.mark.slow
def test_a_scene_sets_rivals_side_by_side(tmp_path: Path):
    """Each by the same report, confirmed by a second route, with its own lag, trials and funnel."""
    change = [RIVALS, "time.end=0.6", "time.samples=601"]
    change += ["tolerance.relative=1e-9", "tolerance.absolute=1e-10"]
    result = wo.run(load_scene(write(tmp_path, TRACK), change))
    assert result.status == "ok", result.reason
    assert result.attributes["trackers"] == [
        "(13), delayed difference", "switching gains", "filtered input", "funnel, two gains",
    ]  # fmt: skip
    routes = [each["route"] for each in result.trust["recheck"]]
    assert routes == ["python"] * 4
    gains, ends = result["gain"].values, value(result, "k_end")
    assert ends == pytest.approx(gains[:, -1])
    assert ends[1] == pytest.approx(5 * 2 ** round(np.log2(ends[1] / 5)))
    assert result["error_norm"].values[1].max() < 0.5
    assert value(result, "time_outside_tube")[1] < 0.5
    assert np.all(result["error_norm"].values[3] < result["funnel"].values[3])
    # the delayed difference, from what the result holds: k e + k' e + k (e - e(t - h)) / h
    t, e = result["time"].values, result["length"].values[0] - result["reference"].values
    back = np.searchsorted(t, t - 0.05 + 1e-9, side="right") - 1
    assert t[200] - t[back[200]] == pytest.approx(0.05, abs=1e-9)
    rate = 1e4 * np.maximum(result["error_norm"].values[0] - 0.2, 0) ** 2
    past = np.where(t < 0.05, e[:, :1], e[:, back])
    expected = -((gains[0] + rate) * e + gains[0] * (e - past) / 0.05)
    assert result["input"].values[0] == pytest.approx(expected, rel=1e-6, abs=1e-6)


def test_a_scene_refuses_a_rate_funnel_that_is_too_narrow(tmp_path: Path):
    change = 'tracker={feedback="funnel", law="two gains", funnel={start=1, end=0.1, time=0.1}, '
    change += "rate_funnel={start=4, end=2, time=1}}"
    with pytest.raises(SceneError, match="tracker: at t = 0 the funnel narrows at the rate 9, but"):
        wo.run(load_scene(write(tmp_path, TRACK), [change]))


def test_an_ensemble_of_delayed_loops(tmp_path: Path):
    change = ['tracker={feedback="difference", lag=0.1, tube_radius=0.2, growth=100}',
              "time.end=0.25", "tolerance.recheck=false"]  # fmt: skip
    result = wo.run(load_scene(write(tmp_path, RANDOM), change))
    assert result.status == "unchecked"
    assert result["member_distance"].values.shape == (1, 5)
    assert len(set(result["member_distance"].values[0])) == 5
