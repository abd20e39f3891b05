"""Every tracker on random worms of 1 to 6 links against equations typed in again, by events."""

from typing import Any

import numpy as np
import pytest

import wormopt as wo
from tests.oracles.by_events import Followed, Ground, Trials, coulomb, spike, stribeck, viscous
from wormopt.control.lambda_tracker import Quadratic, lambda_tracker
from wormopt.control.loop import Reference, gait_reference
from wormopt.model.friction import Law
from wormopt.model.model import Model
from wormopt.model.schedule import ParameterPath
from wormopt.simulation.options import Route
from wormopt.simulation.simulate import simulate
from wormopt.systems.chain.build import chain

Array = np.ndarray
GAMMA, LAM, SETTLING, OVERSHOOT, FACTOR = 5.0, 0.1, 1.6, 0.2, 1.5
FUNNELS = {"funnel": wo.Funnel(2.0, 0.8, 1.0), "rate_funnel": wo.Funnel(12.0, 8.0, 2.0)}
TRACKERS = [
    "derivative", "filter", "difference", "backstepping", "switching", "recursive", "two gains",
]  # fmt: skip


def close(
    name: str, plant: Model, reference: Reference, gain: float, lag: float, **more: Any
) -> Model:
    if name == "switching":
        return wo.switching_tracker(
            plant, reference, tube_radius=LAM, settling=SETTLING, overshoot=OVERSHOOT,
            factor=FACTOR, gain_start=gain, **more,
        )  # fmt: skip
    if name in ("recursive", "two gains"):
        law: Any = name
        return wo.funnel_tracker(plant, reference, law=law, gain=gain, **FUNNELS, **more)
    feedback: Any = name
    return lambda_tracker(
        plant, reference, tube_radius=LAM, feedback=feedback, adaptation=Quadratic(GAMMA),
        gain_start=gain, filter_start=0.3, lag=lag, watch=True, **more,
    )  # fmt: skip


def typed_in(name: str, gain: float, lag: float, trials: Trials) -> Any:
    """The same controllers once more, in NumPy."""

    def grown(e: Array) -> float:
        return GAMMA * max(float(np.linalg.norm(e)) - LAM, 0.0) ** 2

    def width(which: str, t: float) -> float:
        f: Any = FUNNELS[which]
        return f.end + (f.start - f.end) * np.exp(-t / f.time)

    def derivative(t: float, e: Array, rate: Array, own: Array, before: Array) -> Any:
        return -(own[0] * e + grown(e) * e + own[0] * rate), [grown(e)]

    def filtered(t: float, e: Array, rate: Array, own: Array, before: Array) -> Any:
        k, theta = own[0], own[1:]
        slope = k**2 * (e - theta)
        return -(k * theta + grown(e) * theta + k * slope), [grown(e), *slope]

    def difference(t: float, e: Array, rate: Array, own: Array, before: Array) -> Any:
        return derivative(t, e, (e - before) / lag, own, before)

    def backstepping(t: float, e: Array, rate: Array, own: Array, before: Array) -> Any:
        k, xi = own[0], own[1:]
        u = -k * e - (k**2 + e @ e) * k**4 * (1 + xi @ xi) * (xi + k * e)
        return u, [grown(e), *(u - xi)]

    def switching(t: float, e: Array, rate: Array, own: Array, before: Array) -> Any:
        k = gain * trials.gain
        slope = k**2 * (e - own)
        return -(k**2 * own + k * slope), slope

    def recursive(t: float, e: Array, rate: Array, own: Array, before: Array) -> Any:
        inner = rate + e / (1 - e @ e / width("funnel", t) ** 2)
        return -gain * inner / (1 - inner @ inner / width("rate_funnel", t) ** 2), []

    def two_gains(t: float, e: Array, rate: Array, own: Array, before: Array) -> Any:
        first = 1 / (1 - np.linalg.norm(e) / width("funnel", t))
        second = 1 / (1 - np.linalg.norm(rate) / width("rate_funnel", t))
        return -gain * (first**2 * e + second * rate), []

    laws = (derivative, filtered, difference, backstepping, switching, recursive, two_gains)
    return dict(zip(TRACKERS, laws, strict=True))[name]


def drawn_ground(random: np.random.Generator) -> tuple[Ground, Law]:
    f, b, s = random.uniform(0.05, 3), random.uniform(0.05, 8), random.uniform(1, 1.6)
    grounds = [
        (coulomb(f, b, s), wo.Coulomb(f, b, f * s, b * s)),
        (stribeck(f, b, s, 0.2), wo.Stribeck(f, b, f * s, b * s, 0.2)),
        (viscous(f), wo.Viscous(f)),
        (spike(), wo.Spike()),
    ]
    return grounds[random.choice(4, p=[0.4, 0.3, 0.2, 0.1])]


@pytest.mark.parametrize(
    ("name", "by_springs", "seed", "route"),
    [
        *(
            (name, True, seed, "python")  # three or five links on grounds of several kinds
            for name, seed in zip(
                ("difference", "backstepping", "switching", "two gains"), (4, 4, 1, 4), strict=True
            )
        ),
        *(
            # in 0 an error touches its bound for 4e-4, which scipy's events step over
            pytest.param(name, by_springs, seed, route, marks=pytest.mark.slow)
            for name in TRACKERS
            for by_springs in (False, True)
            for route in ("native", "python")
            for seed in (1, 2, 5, 6, 7, 8)
        ),
    ],
)
def test_trackers_on_random_worms(name: str, by_springs: bool, seed: int, route: Route):
    random = np.random.default_rng(seed)
    n = int(random.integers(1, 7))
    lag, gain = float(random.choice([0.07, 0.2, 3.0])), float(random.uniform(0.5, 1.0))
    ground, laws = zip(*(drawn_ground(random) for _ in range(n + 1)), strict=True)
    numbers: dict[str, Any] = {
        "mass": random.uniform(0.3, 2, n + 1),
        "stiffness": random.uniform(0.5, 3 if by_springs else 20, n),
        "damping": random.uniform(0.5, 6, n),
        "rest_length": random.uniform(1, 3, n),
        "drag": random.uniform(0, 1, n + 1),
    }
    middle = numbers["rest_length"] + random.uniform(-0.2, 0.2, n)
    cosine, sine = random.uniform(-0.2, 0.2, (2, n))
    w = random.uniform(1, 6)

    def aim(t: float) -> tuple[Array, Array]:
        c, s = np.cos(w * t), np.sin(w * t)
        return middle + cosine * c + sine * s, w * (sine * c - cosine * s)

    lengths = numbers["rest_length"] + random.uniform(-0.2, 0.2, n)
    position = np.append(np.cumsum(lengths[::-1])[::-1], 0.0)
    plant = chain(n, law=laws, position=position, **numbers)
    gait = wo.Gait(np.array([0.0, 2 * np.pi / w]), middle[None, :, None], np.array([w]),
                   cosine[None], sine[None])  # fmt: skip
    actuator = "rest_length" if by_springs else "force"
    loop = close(name, plant, gait_reference(gait, plant.t), gain, lag, actuator=actuator)
    error = lengths - aim(0.0)[0]
    trials = Trials(float(np.linalg.norm(error)), LAM, SETTLING, OVERSHOOT, FACTOR)
    own = {
        "filter": np.append(gain, np.full(n, 0.3)),
        "backstepping": np.append(gain, np.zeros(n)),
        "switching": error,
    }.get(name, np.full(int(name in ("derivative", "difference")), gain))
    by_hand = Followed(
        numbers, ground, aim, typed_in(name, gain, lag, trials), by_springs,
        lag if name == "difference" else np.inf, trials if name == "switching" else None,
    )  # fmt: skip
    end = by_hand.run(np.concatenate([position, np.zeros(n + 1), own]), 0.8)
    motion = simulate(loop, 0.8, route=route)
    found = motion.end
    if name == "switching":
        assert found[2 * n + 2] == pytest.approx(gain * trials.gain, rel=1e-12)
        found = np.delete(found, 2 * n + 2)
    assert found[: len(end)] == pytest.approx(end, rel=1e-8, abs=1e-8)
    assert sum(event.kind in ("stick", "reversal") for event in motion.events) == by_hand.count


@pytest.mark.parametrize("varies", [False, True])
@pytest.mark.parametrize("name", TRACKERS)
def test_what_is_commanded_is_a_force_or_moves_rest_lengths(name: str, varies: bool):
    """(11): the force is c_j times as large, link by link, and a feed-forward stays as it is."""
    steps = ParameterPath(np.array([0.0, 0.5, 1.0]), np.array([[[3.0], [5.0]], [[7.0], [4.0]]]))
    plant = chain(2, mass=1.0, stiffness=steps if varies else [2.0, 7.0], damping=5.0,
                  rest_length=2.0, drag=0.1, position=(4.2, 1.9, 0.0))  # fmt: skip
    still = gait_reference(wo.Gait(np.array([0.0, 1.0]), np.full((1, 2, 1), 2.1)), plant.t)
    x = {"position": [4.1, 1.8, 0.0], "velocity": [0.3, -0.1, 0.2], "gain": 0.9}
    x |= dict.fromkeys(("trial_bound", "trial_end", "trial_time", "trial_margin"), 1.0)
    x |= {"filter": [0.3, -0.2], "input_filter": [0.1, 0.4]}
    ahead = wo.FeedForward(3.0, [1.0, 1.5], 0.7)
    hows = [
        {"actuator": "force"},
        {"actuator": "rest_length"},
        {"actuator": "rest_length", "feedforward": ahead},
    ]
    loops = [close(name, plant, still, 0.9, 0.1, **how) for how in hows]
    start = {key: x[key] for key in x if key in {s.name for s in loops[0].x}}
    alone, moved, more = (
        simulate(loop, 1e-9, x0=start, times=[0.0], route="python")["input"][:, 0] for loop in loops
    )
    assert moved == pytest.approx(([3.0, 5.0] if varies else [2.0, 7.0]) * alone, rel=1e-12)
    assert np.all(np.abs(alone) > 1e-3)
    assert more - moved == pytest.approx(3.0 * (2.1 - np.array([1.0, 1.5])), rel=1e-12)
