"""LQR with feed-forward against python-control, hand-written matrices and exact error dynamics."""

from collections.abc import Callable
from typing import Any

import casadi as ca
import numpy as np
import pytest
from effort import examples
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import simpson
from scipy.linalg import expm, solve_continuous_lyapunov
from worms import free_worm as worm

from wormopt.control.loop import gait_reference
from wormopt.control.lqr import lqr
from wormopt.model.friction import Coulomb
from wormopt.model.gait import Gait
from wormopt.model.model import Model, Output, Signal, pack
from wormopt.model.schedule import ParameterPath
from wormopt.model.values import signal_values
from wormopt.simulation.simulate import simulate
from wormopt.systems.spiked.construct import fast_gait, travelling_sine

seeds = st.integers(0, 10**6)
few = settings(max_examples=examples(25))


def random_numbers(seed: int) -> dict[str, Any]:
    """Masses and links, spread over a decade."""
    random = np.random.default_rng(seed)
    n = int(random.integers(1, 6))
    sizes = {"mass": n + 1, "stiffness": n, "damping": n, "rest_length": n}
    return {name: 10 ** random.uniform(-0.5, 0.5, size) for name, size in sizes.items()}


def gain_by_hand(mass: np.ndarray) -> np.ndarray:
    """High-frequency gain: l_j'' = x_{j-1}'' - x_j'', and u_j pushes both apart."""
    outer = -np.diag(1 / mass[1:-1], 1) - np.diag(1 / mass[1:-1], -1)
    return np.diag(1 / mass[:-1] + 1 / mass[1:]) + outer


def pair_by_hand(numbers: dict[str, Any]) -> tuple[np.ndarray, np.ndarray]:
    """A and B of (e, e') for l'' = G (u - c (l - l0) - d l')."""
    G, n = gain_by_hand(numbers["mass"]), len(numbers["stiffness"])
    below = [-G @ np.diag(numbers["stiffness"]), -G @ np.diag(numbers["damping"])]
    return np.block([[np.zeros((n, n)), np.eye(n)], below]), np.vstack([np.zeros((n, n)), G])


def weights(seed: int, n: int) -> dict[str, Any]:
    """A matrix, a diagonal and a number."""
    random = np.random.default_rng(seed + 1)
    root = random.normal(size=(n, n))
    square = root @ root.T
    return {
        "error_weight": 5 * (square + square.T) + np.eye(n),
        "rate_weight": random.uniform(0, 2, n),
        "input_weight": random.uniform(0.1, 1, ()),
    }


def as_matrices(given: dict[str, Any], n: int) -> tuple[np.ndarray, np.ndarray]:
    zero = np.zeros((n, n))
    Q = np.block([[given["error_weight"], zero], [zero, np.diag(given["rate_weight"])]])
    return Q, given["input_weight"] * np.eye(n)


def matrix(loop: Model, name: str, rows: int) -> np.ndarray:
    (found,) = (p.value for p in loop.p if p.name == name)
    return np.reshape(np.asarray(found), (rows, -1))


def gains(loop: Model, n: int) -> np.ndarray:
    return np.hstack([matrix(loop, "error_gain", n), matrix(loop, "rate_gain", n)])


def built(seed: int) -> tuple[Model, int, dict[str, Any], dict[str, Any]]:
    numbers = random_numbers(seed)
    n = len(numbers["stiffness"])
    plant, given = worm(n, **numbers), weights(seed, n)
    reference = gait_reference(travelling_sine(n, 1.0, 2.0, 0.4, lag=0.2), plant.t)
    return lqr(plant, reference, **given), n, numbers, given


# -- the gain ------------------------------------------------------------------------------------


@few
@given(seed=seeds)
def test_the_gain_solves_the_riccati_equation(seed: int):
    """The cost of the loop, from a Lyapunov equation, solves it and has this gain."""
    loop, n, numbers, given_ = built(seed)
    (A, B), (Q, R), K = pair_by_hand(numbers), as_matrices(given_, n), gains(loop, n)
    closed = A - B @ K
    assert np.linalg.eigvals(closed).real.max() < 0
    P = solve_continuous_lyapunov(closed.T, -(Q + K.T @ R @ K))
    residual = A.T @ P + P @ A - P @ B @ np.linalg.solve(R, B.T) @ P + Q
    assert np.abs(residual).max() < 1e-9 * np.abs(Q).max() * max(1.0, np.abs(P).max())
    assert gains(loop, n) == pytest.approx(np.linalg.solve(R, B.T @ P), rel=1e-8, abs=1e-8)


@few
@given(seed=seeds)
def test_poles_of_the_loop_are_those_of_the_error_and_two_at_zero(seed: int):
    """Eigenvalues of the loop's own Jacobian; place and speed of the whole worm are free."""
    loop, n, numbers, _ = built(seed)
    slope = ca.Function("J", [pack(loop.p)], [ca.jacobian(loop.ode, pack(loop.x))])
    J = slope(signal_values(loop.p, None, "parameter")).full()
    A, B = pair_by_hand(numbers)
    closed = A - B @ gains(loop, n)
    # characteristic polynomials: eigenvalues at 0 are double, their rounding is large
    s = np.array([0.3, 1.0, -2.0, 2.0j, 1 - 5j])[:, None, None]
    ours = np.linalg.det(s * np.eye(2 * n + 2) - J)
    assert ours == pytest.approx(np.linalg.det(s * np.eye(2 * n) - closed) * s.ravel() ** 2)


# -- the loop ------------------------------------------------------------------------------------


@few
@given(seed=seeds)
def test_the_force_at_a_point(seed: int):
    """u = c (y_ref - l0) + d y_ref' + G^-1 y_ref'' - K (e, e')."""
    random = np.random.default_rng(seed)
    loop, n, numbers, _ = built(seed)
    x = {"position": random.uniform(-3, 3, n + 1), "velocity": random.uniform(-1, 1, n + 1)}
    gait = travelling_sine(n, 1.0, 2.0, 0.4, lag=0.2)
    y, dy, ddy = (gait(np.array([0.0]), k)[:, 0] for k in range(3))
    e, de = -np.diff(x["position"]) - y, -np.diff(x["velocity"]) - dy
    ahead = numbers["stiffness"] * (y - numbers["rest_length"]) + numbers["damping"] * dy
    ahead += np.linalg.solve(gain_by_hand(numbers["mass"]), ddy)
    start = simulate(loop, 1e-6, x0=x)
    assert start["feedforward"][:, 0] == pytest.approx(ahead, rel=1e-9, abs=1e-9)
    u = ahead - gains(loop, n) @ np.append(e, de)
    assert start["input"][:, 0] == pytest.approx(u, rel=1e-9, abs=1e-9)


@pytest.mark.parametrize(
    "extra",
    [
        {"mass": [1.0, 2.0, 0.5, 1.0]},
        {"drag": 0.4, "load": [0.3, 0.1, 0.0, 0.2]},
        {"mass": [1.0, 2.0, 0.5, 1.0], "drag": [0.2, 0.4, 0.1, 0.2]},
    ],
)
def test_without_friction_an_error_of_zero_stays_zero(extra: dict[str, Any]):
    """The feed-forward is exact for any masses and loads, and for drag in proportion to masses."""
    plant, gait = worm(3, **extra), travelling_sine(3, 1.0, 2.0, 0.5, lag=0.15)
    loop = lqr(plant, gait_reference(gait, plant.t), error_weight=100.0)
    y, dy = (gait(np.zeros(1), k)[:, 0] for k in range(2))
    x0 = {name: np.append(np.cumsum(v[::-1])[::-1], 0.0) for name, v in
          (("position", y), ("velocity", dy))}  # fmt: skip
    motion = simulate(loop, 5.0, x0=x0, times=np.linspace(0, 5, 501))
    assert np.abs(motion["error"]).max() < 1e-10
    assert motion["input"] == pytest.approx(motion["feedforward"], abs=1e-8)


def test_the_error_falls_as_the_exponential_says_and_costs_what_it_should():
    numbers = random_numbers(4)
    n = len(numbers["stiffness"])
    plant, given_ = worm(n, **numbers), weights(4, n)
    loop = lqr(plant, gait_reference(travelling_sine(n, 1.0), plant.t), **given_)
    times = np.linspace(0.0, 15.0, 6001)
    motion = simulate(loop, 15.0, times=times)
    rate = -np.diff(motion["velocity"], axis=0)
    z = np.vstack([motion["error"], rate - travelling_sine(n, 1.0)(times, 1)])
    (A, B), (Q, R), K = pair_by_hand(numbers), as_matrices(given_, n), gains(loop, n)
    closed = A - B @ K
    for k in (200, 800):
        assert z[:, k] == pytest.approx(expm(closed * times[k]) @ z[:, 0], abs=1e-9)
    v = motion["input"] - motion["feedforward"]
    density = np.sum(z * (Q @ z), axis=0) + np.sum(v * (R @ v), axis=0)
    P = solve_continuous_lyapunov(closed.T, -(Q + K.T @ R @ K))
    assert simpson(density, x=times) == pytest.approx(z[:, 0] @ P @ z[:, 0], rel=1e-7)


def test_the_controller_does_not_know_another_plant():
    """Stiffness 10 believed, 12 true: the error comes to rest at (10 - 12)(y - l0)/(12 + K_0)."""
    plant = worm(1, rest_length=1.5)
    still = gait_reference(Gait(np.array([0.0, 1.0]), np.full((1, 1, 1), 2.0)), plant.t)
    loop = lqr(plant, still, error_weight=400.0)
    motion = simulate(loop, 30.0, p={"stiffness": 12.0})
    assert motion["feedforward"] == pytest.approx(10.0 * 0.5)
    k0 = matrix(loop, "error_gain", 1)[0, 0]
    assert motion["error"][0, -1] == pytest.approx(-2 * 0.5 / (12 + k0), rel=1e-8)
    knows = lqr(plant, still, error_weight=400.0, p={"stiffness": 12.0})
    assert [p.value for p in knows.p[: len(plant.p)]] == [p.value for p in plant.p]
    motion = simulate(knows, 30.0, p={"stiffness": 12.0})
    assert motion["error"][0, -1] == pytest.approx(0, abs=1e-9)
    # told by its parameters it is the same
    told = {"feedforward_stiffness": matrix(knows, "feedforward_stiffness", 1)[0]}
    told |= {"feedforward_force": matrix(knows, "feedforward_force", 1)[0]}
    motion = simulate(loop, 30.0, p={"stiffness": 12.0, **told})
    assert motion["error"][0, -1] == pytest.approx(0, abs=1e-9)


def test_links_that_vary_count_as_they_are_at_the_start():
    values = np.array([[[10.0, 0.0], [8.0, 0.0]], [[12.0, 1.0], [9.0, 0.0]]])
    steps = ParameterPath(np.array([0.0, 0.5, 1.0]), values)
    plant, fixed = worm(stiffness=steps), worm(stiffness=[10.0, 8.0])
    gait = fast_gait(1.0)
    varying = lqr(plant, gait_reference(gait, plant.t), error_weight=9.0)
    constant = lqr(fixed, gait_reference(gait, fixed.t), error_weight=9.0)
    assert [s.name for s in varying.schedules] == ["stiffness", "reference"]
    assert gains(varying, 2) == pytest.approx(gains(constant, 2))


def test_a_real_worm_under_exact_friction_follows_the_fast_gait():
    """Friction is a bounded disturbance; the error repeats with the gait and falls with K_0."""
    largest = []
    for error_weight in (1e2, 1e4, 1e6):
        plant = worm(law=Coulomb(1.0, 10.0), rest_length=1.0)
        loop = lqr(plant, gait_reference(fast_gait(1.0), plant.t), error_weight=error_weight)
        t = np.linspace(8.0, 9.0, 101)
        motion = simulate(loop, 10.0, times=np.append(t, t + 1))
        assert any(event.kind == "stick" for event in motion.events)
        error = motion["error"]
        assert error[:, 101:] == pytest.approx(error[:, :101], abs=1e-6)
        largest.append(np.abs(error).max())
        assert motion.end[0] > 3.0  # it crawls
    assert largest[0] > 2 * largest[1] > 4 * largest[2]
    assert largest[2] < 0.02


def test_feedback_around_a_given_course():
    """Free links under forces that are linear in time: lengths are cubics, l'' = G u."""
    breaks = np.array([0.0, 0.6, 1.5])
    forces = np.array([[[0.5, 1.0], [-0.3, 0.2]], [[-2.0, 1.5], [0.4, 0.0]]])
    G, y, dy, cubics = gain_by_hand(np.array([1.0, 2.0, 0.5])), np.full(2, 2.0), np.zeros(2), []
    for force, h in zip(forces, np.diff(breaks), strict=True):
        a, b = (G @ force).T
        cubics.append(np.stack([y, dy, a / 2, b / 6], axis=1))
        y, dy = y + dy * h + a * h**2 / 2 + b * h**3 / 6, dy + a * h + b * h**2 / 2
    optimum, course = Gait(breaks, np.array(cubics)), Gait(breaks, forces)
    plant = worm(mass=[1.0, 2.0, 0.5], stiffness=0.0, damping=0.0)
    reference = gait_reference(optimum, plant.t, periodic=False)
    loop = lqr(plant, reference, error_weight=25.0, feedforward=course)
    assert [s.name for s in loop.schedules] == ["reference", "feedforward"]
    assert [p.name for p in loop.p[len(plant.p) :]] == ["error_gain", "rate_gain"]
    times = np.linspace(0.0, 1.5, 31)
    motion = simulate(loop, 1.5, times=times)
    assert np.abs(motion["error"]).max() < 1e-11
    assert motion["input"][:, :-1] == pytest.approx(course(times[:-1]), abs=1e-10)
    disturbed = simulate(loop, 1.5, x0={"position": [4.3, 2.1, 0.0]}, times=times)
    numbers = {"mass": np.array([1.0, 2.0, 0.5]), "stiffness": np.zeros(2), "damping": np.zeros(2)}
    A, B = pair_by_hand(numbers)
    z = [expm((A - B @ gains(loop, 2)) * t) @ [0.2, 0.1, 0.0, 0.0] for t in times]
    assert disturbed["error"] == pytest.approx(np.array(z)[:, :2].T, abs=1e-10)
    # afterwards the last length is held, and the last force
    after = simulate(loop, 4.0)["feedforward"][:, -1]
    assert after == pytest.approx([-2.0 + 1.5 * 0.9, 0.4])


def test_a_course_repeats_with_the_reference():
    plant = worm()
    course = Gait(np.array([0.0, 0.5, 1.0]), np.array([[[1.0], [2.0]], [[3.0], [4.0]]]))
    loop = lqr(plant, gait_reference(fast_gait(1.0), plant.t), error_weight=1.0, feedforward=course)
    motion = simulate(loop, 3.0, times=[0.1, 0.6, 1.1, 2.6])
    assert motion["feedforward"][0] == pytest.approx([1.0, 3.0, 1.0, 3.0])


def test_a_loop_tells_what_it_is():
    plant = worm(law=Coulomb(1.0, 10.0))
    loop = lqr(plant, gait_reference(fast_gait(1.0), plant.t), error_weight=1.0)
    assert [p.name for p in loop.p[len(plant.p) :]] == [
        "error_gain", "rate_gain", "feedforward_inertia", "feedforward_damping",
        "feedforward_stiffness", "feedforward_force",
    ]  # fmt: skip
    assert [o.name for o in loop.outputs[len(plant.outputs) :]] == [
        "reference", "error", "error_norm", "input", "feedforward",
    ]  # fmt: skip
    assert (list(loop.u), loop.n_x, len(loop.contacts)) == ([], plant.n_x, 3)
    # Equal masses: G = [[2, -1], [-1, 2]] / m
    assert matrix(loop, "feedforward_inertia", 2) == pytest.approx(
        np.array([[2.0, 1.0], [1.0, 2.0]]) / 3
    )


# -- what is refused -----------------------------------------------------------------------------


def cubic_spring() -> Model:
    q, v, u = ca.SX.sym("q"), ca.SX.sym("v"), ca.SX.sym("u")
    states = [Signal("q", q), Signal("v", v)]
    ode = ca.vertcat(v, u - q**3)
    return Model("cubic", states, ode, u=[Signal("input", u)], outputs=[Output("length", q)])


def idle() -> Model:
    q, v, u = ca.SX.sym("q"), ca.SX.sym("v"), ca.SX.sym("u")
    states = [Signal("q", q), Signal("v", v)]
    outputs = [Output("length", q)]
    return Model("idle", states, ca.vertcat(v, 0 * u), u=[Signal("input", u)], outputs=outputs)


def loop_of(plant: Model, **options: Any) -> Model:
    gait = Gait(np.array([0.0, 1.0]), np.full((1, plant["length"].numel(), 1), 2.0))
    options = {"error_weight": 1.0} | options
    return lqr(plant, gait_reference(gait, plant.t), **options)


@pytest.mark.parametrize(
    ("build", "message"),
    [
        (lambda: loop_of(worm(), error_weight=[1.0, 2.0, 3.0]), "error_weight must be one number"),
        (lambda: loop_of(worm(), error_weight=-1.0), "error_weight must be positive semidefinite"),
        (lambda: loop_of(worm(), rate_weight=np.inf), "rate_weight must be finite"),
        (lambda: loop_of(worm(), error_weight=[[1.0, 2.0], [0.0, 1.0]]), "and symmetric"),
        (lambda: loop_of(worm(), input_weight=0.0), "input_weight must be positive definite"),
        (lambda: loop_of(worm(stiffness=0.0), error_weight=0.0), "no optimal feedback is stable"),
        (
            lambda: loop_of(worm(stiffness=0.0, damping=0.0), error_weight=0.0, rate_weight=1.0),
            "no optimal feedback is stable",
        ),
        (lambda: loop_of(worm(), p={"mas": 1.0}), "mas"),
        (lambda: loop_of(worm(), p={"mass": -1.0}), "mass must be positive"),
        (lambda: loop_of(cubic_spring()), "cubic is not linear"),
        (lambda: loop_of(idle()), "do not accelerate links independently"),
        (lambda: loop_of(worm(), feedforward=np.zeros(2)), "feedforward must be a Gait"),
        (
            lambda: loop_of(worm(), feedforward=travelling_sine(3, 1.0)),
            "has 3 rows, the reference 2",
        ),
    ],
)
def test_loops_that_make_no_sense_are_refused(build: Callable[[], object], message: str):
    with pytest.raises((ValueError, KeyError), match=message):
        build()
