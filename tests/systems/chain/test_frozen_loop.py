"""Loops with a frozen gain against closed forms: margins, errors, bounds, least gains."""

import math
from typing import Any

import numpy as np
import pytest
import scipy.signal
from effort import examples
from hypothesis import given, settings
from hypothesis import strategies as st
from outcomes import refusals
from worms import free_worm

import wormopt as wo
from wormopt.analysis.linearise import linearise
from wormopt.control.frozen import FrozenLoop, Plant, Task, least_gain, peak_gains, static_gains
from wormopt.errors import Interrupted, SolveError
from wormopt.model.friction import Coulomb, Law, Spike, Viscous
from wormopt.study import load_scene
from wormopt.systems.chain import linear
from wormopt.systems.chain.build import chain
from wormopt.systems.chain.frozen import bisect, task_of
from wormopt.systems.spiked.construct import fast_gait

seeds = st.integers(0, 10**6)
patient = settings(max_examples=examples(24))


def free_mass(zero: float | None = None) -> Plant:
    """1/s^2, or (zero - s) / (s + 1)^3; the force of the ground comes in as the input does."""
    if zero is None:
        b = np.array([[0.0], [1.0]])
        return Plant(np.array([[0.0, 1.0], [0.0, 0.0]]), b, np.array([[1.0, 0.0]]), b)
    a = np.array([[-3.0, -3.0, -1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
    b = np.array([[1.0], [0.0], [0.0]])
    return Plant(a, b, np.array([[0.0, -1.0, zero]]), b)


def random_plant(seed: int, drag: float = 1.0) -> tuple[Plant, dict[str, Any]]:
    random = np.random.default_rng(seed)
    links = int(random.integers(1, 5))
    sizes = {"mass": links + 1, "stiffness": links, "damping": links, "drag": links + 1}
    numbers: dict[str, Any] = {k: 10 ** random.uniform(-0.7, 0.7, n) for k, n in sizes.items()}
    numbers["drag"] = drag * numbers["drag"]
    worm = chain(links, rest_length=1.0, **numbers)
    return Plant.of(linearise(worm, output="length"), links), numbers


# -- margins -------------------------------------------------------------------------------------


@pytest.mark.parametrize("gain", [0.5, 2.0, 30.0])
def test_margins_of_a_free_mass(gain: float):
    """k (1 + s) / s^2 has the gain 1 at w^2 = (k^2 + sqrt(k^4 + 4 k^2)) / 2, lag pi - atan w."""
    found = FrozenLoop(free_mass(), gain, "derivative").margins()
    crossing = math.sqrt((gain**2 + math.sqrt(gain**4 + 4 * gain**2)) / 2)
    assert found.phase == pytest.approx(math.atan(crossing), rel=1e-9)
    assert found.gain == np.inf


@pytest.mark.parametrize("gain", [0.25, 1.0, 1.9])
def test_gain_margin_of_a_plant_that_is_not_minimum_phase(gain: float):
    """1 + f k (1 + s)(2 - s) / (s + 1)^3 vanishes where s^2 + (2 - f k) s + 1 + 2 f k does."""
    loop = FrozenLoop(free_mass(zero=2.0), gain, "derivative")
    assert loop.margins().gain == pytest.approx(2 / gain, rel=1e-9)
    lost = FrozenLoop(free_mass(zero=2.0), 2.1, "derivative").margins()
    assert (lost.gain, lost.phase, lost.disk, lost.peak) == (0.0, 0.0, 0.0, np.inf)


@pytest.mark.parametrize("gain", [0.9, 0.999, 1.001, 4.0])
def test_the_filter_needs_a_gain_above_one_around_a_free_mass(gain: float):
    """s^3 + k^2 s^2 + k^3 s + k^3 is stable for k^5 > k^3 (Routh)."""
    assert FrozenLoop(free_mass(), gain, "filter").stable is (gain > 1)


@pytest.mark.parametrize("feedback", ["derivative", "filter"])
def test_margins_of_one_link_agree_with_control(control: Any, feedback: Any):
    plant, _ = random_plant(3)
    plant = Plant(plant.A, plant.B[:, :1], plant.C[:1], plant.F)
    loop = FrozenLoop(plant, 20.0, feedback)
    opened = control.ss(*loop.opened, 0)
    ours = loop.margins()
    gain, phase, *_ = control.stability_margins(opened)
    assert ours.gain == np.inf
    assert gain > 1e9  # there is none, but for rounding
    assert ours.phase == pytest.approx(math.radians(phase), rel=1e-6)
    disk = control.disk_margins(opened, np.logspace(-3, 6, 4001))[0]
    assert ours.disk == pytest.approx(disk, rel=1e-4)
    assert ours.disk == pytest.approx(loop.by_control()[1], rel=1e-4)


@patient
@given(seed=seeds, decade=st.floats(-1, 3))
def test_every_gain_is_stable_around_a_chain(seed: int, decade: float):
    """The rate answers the input as a passive system, and (1 + s) / s turns it by less than 90."""
    plant, _ = random_plant(seed)
    loop = FrozenLoop(plant, 10**decade, "derivative")
    found = loop.margins()
    assert loop.stable
    assert found.gain == np.inf
    assert found.phase > 0
    assert 0 < found.disk <= 2
    assert found.peak >= 1


@patient
@given(seed=seeds)
def test_poles_of_high_gain_go_to_the_zeros(seed: int):
    """-1 for each link, of 1 + s, and the worm's own zero, -(sum k) / (sum m)."""
    plant, numbers = random_plant(seed)
    poles = FrozenLoop(plant, 1e6, "derivative").poles
    links = len(numbers["stiffness"])
    near = np.sort(poles.real[np.abs(poles) < 30])
    ends = [-1.0] * links
    if len(plant.A) > 2 * links:  # the common motion is not hidden
        ends.append(-numbers["drag"].sum() / numbers["mass"].sum())
    assert near == pytest.approx(np.sort(ends), rel=2e-3)


# -- errors --------------------------------------------------------------------------------------


def test_error_of_one_link_by_hand():
    """Constant: c / (c + k); at w: |P| / |P + k (1 + s)|, P = s^2 m / 2 + d s + c."""
    worm = chain(1, mass=3.0, stiffness=8.0, damping=2.0, rest_length=1.0)
    plant = Plant.of(linearise(worm, output="length"), 1)
    count, amplitude, offset, gain, period = 512, 0.3, 0.2, 15.0, 2.0
    angle = 2 * np.pi * np.arange(count) / count
    zero = np.zeros(2)
    plant = Plant(plant.A, plant.B, plant.C, np.zeros((2, 2)))
    task = Task(plant, period, offset + amplitude * np.cos(angle)[None], zero, zero, zero)
    s = 2j * np.pi / period
    own = s**2 * 1.5 + 2 * s + 8
    swing = own / (own + gain * (1 + s))
    still = offset * 8 / (8 + gain)
    by_hand = -still - amplitude * np.real(swing * np.exp(1j * angle))
    loop = FrozenLoop(plant, gain, "derivative")
    assert task.error_over_period(loop, pushed=True)[0] == pytest.approx(by_hand, abs=1e-12)
    assert task.error(loop) == pytest.approx(np.abs(by_hand).max(), rel=1e-12)


@pytest.mark.parametrize("gain", [0.3, 1.0, 3.0])
def test_peak_gain_of_a_swinging_loop(gain: float):
    """s^2 + k s + k: the integral of |h| is coth(pi a / (2 w)) / k, its poles being -a +- i w."""
    loop = FrozenLoop(free_mass(), gain, "derivative")
    a = gain / 2
    w = math.sqrt(gain - a**2)
    known = 1 / (math.tanh(math.pi * a / (2 * w)) * gain)
    assert peak_gains(loop)[0, 0] == pytest.approx(known, rel=1e-4)
    found, exact = static_gains(loop)
    assert exact[0, 0] == pytest.approx(1 / gain, rel=1e-12)
    assert found == pytest.approx(exact, rel=1e-5)


def test_peak_gain_of_a_creeping_loop_is_static():
    """Real poles, no zero: the impulse response has one sign."""
    loop = FrozenLoop(free_mass(), 9.0, "derivative")
    assert peak_gains(loop)[0, 0] == pytest.approx(1 / 9, rel=1e-6)


@settings(max_examples=examples(12))
@given(seed=seeds, feedback=st.sampled_from(["derivative", "filter"]))
def test_no_course_of_friction_breaks_the_bound(seed: int, feedback: Any):
    """Forces that jump at random times between the ends of their range, through lsim."""
    random = np.random.default_rng(seed)
    law = Coulomb(*random.uniform(0.2, 3.0, 2))
    worm = chain(2, mass=random.uniform(0.5, 2, 3), stiffness=8.0, damping=2.0, rest_length=2.0,
                 drag=0.3, law=law, load=random.uniform(0, 1, 3))  # fmt: skip
    gait = fast_gait(1.0)
    task = task_of(worm, [law] * 3, gait, 0.0, np.full(2, 2.0))
    loop = FrozenLoop(task.plant, float(random.uniform(2, 8)), feedback)
    force, seen = _driven(loop)
    times = np.linspace(0, 40, 8001)
    phase, slope = gait(times) - 2.0, gait(times, 1)
    wanted = loop.gain * (phase + slope) if feedback == "derivative" else phase
    switching = np.sign(
        np.sin(times[:, None] * random.uniform(0.3, 6, 3) + random.uniform(0, 6, 3))
    )
    push = task.load + task.force + task.range * switching
    entering = np.hstack([push, wanted.T])
    _, y, _ = scipy.signal.lsim((loop.closed, force, seen, np.zeros((2, 5))), entering, times)
    error = np.linalg.norm(y - phase.T, axis=1)[4001:]
    assert error.max() <= task.bound(loop) * (1 + 1e-3)  # lsim joins samples by lines
    assert task.error(loop) <= task.bound(loop) + 1e-12


def _driven(loop: FrozenLoop) -> tuple[np.ndarray, np.ndarray]:
    """Where pushes and the reference enter the closed loop, and where lengths show."""
    plant, k = loop.plant, loop.gain
    more = len(loop.closed) - len(plant.A)
    pushes = np.vstack([plant.F, np.zeros((more, plant.F.shape[1]))])
    if loop.feedback == "derivative":
        enters = plant.B
    else:  # theta' has -k^2 y_ref, and u the part -(k - k^3) theta - k^3 (y - y_ref)
        enters = np.vstack([k**3 * plant.B, -(k**2) * np.eye(more)])
    return np.hstack([pushes, enters]), np.hstack([plant.C, np.zeros((len(plant.C), more))])


def test_spikes_have_no_bound_and_drag_is_no_dry_friction():
    def task(laws: list[Law], drag: float = 0.0) -> Task:
        worm = free_worm(2, stiffness=8.0, damping=2.0, law=laws or None, drag=drag)
        return task_of(worm, laws, fast_gait(1.0), 0.0, np.full(2, 2.0))

    spiked = task([Spike()] * 3)
    loop = FrozenLoop(spiked.plant, 30.0, "derivative")
    assert spiked.bound(loop) == np.inf
    assert spiked.error(loop) < 0.5
    wet, own = task([Viscous(0.4)] * 3), task([], drag=0.4)
    first, second = (t.bound(FrozenLoop(t.plant, 30.0, "derivative")) for t in (wet, own))
    assert first == pytest.approx(second, rel=1e-9)
    assert first == pytest.approx(wet.error(FrozenLoop(wet.plant, 30.0, "derivative")))


# -- least gains ---------------------------------------------------------------------------------


def test_least_gain_where_sizes_rise_and_fall():
    grid = np.geomspace(1, 100, 21)
    assert least_gain(lambda k: 10 / k, grid, 0.7) == pytest.approx(10 / 0.7)
    assert least_gain(lambda k: 10 / k, grid, 20.0) == 1.0
    assert least_gain(lambda k: 10 / k, grid, 0.05) is None
    humped = least_gain(lambda k: k / (1 + (k / 10) ** 2), grid, 3.0)  # small gains are no answer
    assert humped == pytest.approx(10 * (1 / 0.6 + math.sqrt(1 / 0.36 - 1)))
    assert least_gain(lambda k: np.inf if k < 10 else 0.0, grid, 1.0) == pytest.approx(10, rel=0.3)
    assert least_gain(lambda k: np.inf, grid, 1.0) is None


@pytest.mark.parametrize("guess", [0.1, 3.0, 14.0, 90.0, 1e4])
def test_bisection_from_any_guess(guess: float):
    found, tried = bisect(lambda k: 10 / k, 1.0, 100.0, 0.7, guess)
    assert found == pytest.approx(10 / 0.7, rel=1e-3)
    assert found is not None
    assert found >= 10 / 0.7
    assert all(error == 10 / gain for gain, error in tried)
    assert bisect(lambda k: 10 / k, 1.0, 100.0, 0.05, guess)[0] is None
    assert bisect(lambda k: 10 / k, 1.0, 100.0, 20.0, guess)[0] == 1.0


# -- the kind ------------------------------------------------------------------------------------


test_scenes_that_make_no_sense_are_refused = refusals(
    "linear_chain",
    """
    worm.stiffness=[10, 0] | worm.stiffness | is 0, and a link without stiffness
    gains.most=1 | gains.most | is not above gains.least = 1
    tracker.feedforward={} | tracker.feedforward | is not allowed
    tracker.feedback=funnel | tracker
    worm.random={stiffness={process='fixed', spread=1}} | worm.random | is not allowed
    point.velocity=[1, 2] | point.velocity | 2 entries for 3 masses
    time.end=1.9 | time.end | is less than two periods
    """,
)


def test_a_motion_that_stops_short_fails_with_a_reason():
    with pytest.raises(SolveError) as stopped:
        wo.run(load_scene("linear_chain", ["tolerance.max_steps=20"]))
    assert stopped.value.partial.status == "failed"
    assert stopped.value.partial.reason == str(stopped.value)


def test_who_interrupts_keeps_a_result():
    def stop(what: str, fraction: float | None) -> None:
        raise KeyboardInterrupt

    scene = load_scene("linear_chain", ["time.end=2.5", "tolerance.recheck=false"])
    with pytest.raises(Interrupted) as stopped:
        wo.run(scene, report=stop)
    assert stopped.value.partial.reason == "interrupted during motion"


@pytest.mark.slow
@pytest.mark.parametrize("feedback", ["derivative", "filter"])
def test_gains_of_the_scene_are_in_order(feedback: str):
    """What harmonics ask for, what the worm needs, what is enough: three routes in their order."""
    tracker = f"tracker={{feedback='{feedback}', tube_radius=0.2, growth=1e4}}"
    result = wo.run(load_scene("linear_chain", [tracker]))
    assert result.status == "ok"
    assert result["common_zero"].value == pytest.approx(-0.1, rel=1e-9)
    assert result["minimum_phase"].value == 1
    assert result["gain_definite"].value == pytest.approx(1.0)  # 2 - 2 cos(pi / 3)
    linear, needed, sure = (
        result[f"gain_{name}"].value for name in ("linear", "simulated", "sure")
    )
    assert linear < needed < sure
    assert needed == pytest.approx(linear, rel=0.15)
    assert result["gain_learned"].value == pytest.approx(linear, rel=0.02)
    assert result["error_learned"].value < result["error_sure"].value
    assert np.all(np.diff(result["error_linear"].values) < 0)
    assert np.all(result["loop_real"].values < 0)


@pytest.mark.slow
def test_without_friction_harmonics_say_what_is_needed():
    """A worm on drag alone: the least gains by harmonics, by simulation and by bound are one."""
    change = ["worm.friction={kind='viscous', drag=0.3}", "time.end=30", "gains.count=9"]
    result = wo.run(load_scene("linear_chain", change))
    assert result.status == "ok"
    linear = result["gain_linear"].value
    assert result["gain_simulated"].value == pytest.approx(linear, rel=2e-3)
    assert result["gain_sure"].value == pytest.approx(linear, rel=1e-6)


@pytest.mark.slow
def test_a_resting_worm_has_the_slope_of_the_smooth_law():
    """(F+ + F-) / (2 v_reg) for each mass of 1, and drag."""
    change = ["point.velocity=0", "point.v_reg=0.1", "gains.count=5", "tolerance.recheck=false"]
    result = wo.run(load_scene("linear_chain", change))
    assert result["common_zero"].value == pytest.approx(-(11 / 0.2 + 0.1), rel=1e-9)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("target", "name", "fault"),
    [
        (FrozenLoop, "by_control", "poles by python-control"),
        (linear, "static_gains", "static gains of the impulse responses"),
        (linear, "settled", "error by simulation without dry friction"),
        (Task, "bound", "the error with frozen gain exceeds its bound"),
    ],
)
def test_each_route_that_disagrees_fails_the_result(
    monkeypatch: pytest.MonkeyPatch, target: Any, name: str, fault: str
):
    own = getattr(target, name)
    wrong = {
        "by_control": lambda loop: (own(loop)[0] - 1e-3, own(loop)[1]),
        "static_gains": lambda loop: (own(loop)[0] * 1.01, own(loop)[1]),
        "settled": lambda slowest, period: 2 * period,  # the start is not forgotten by then
        "bound": lambda task, loop: 0.3 * own(task, loop),
    }
    monkeypatch.setattr(target, name, wrong[name])
    change = ["time.end=4", "gains.count=5", "tolerance.recheck=false", "tolerance.relative=1e-8"]
    result = wo.run(load_scene("linear_chain", change))
    assert result.status == "failed"
    assert fault in result.reason
