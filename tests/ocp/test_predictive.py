"""Predictive control and estimation: exact answers, other solvers, other routes, hostile input."""

from dataclasses import replace
from functools import cache
from typing import Any

import casadi as ca
import numpy as np
import pytest
from effort import examples
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.linalg import solve_discrete_are
from scipy.optimize import lsq_linear

from wormopt.control.estimation import Estimation, Estimator, places
from wormopt.control.predictive import (
    MpcOptions,
    MpcPlan,
    PredictiveController,
    cost_to_go,
    plan_mpc,
    run_mpc,
)
from wormopt.errors import ArgumentError, SolveError
from wormopt.model.friction import Coulomb
from wormopt.model.model import Contact, Model, Signal
from wormopt.numerics.collocation import Collocation
from wormopt.ocp.contact import Complementarity, Regularised
from wormopt.ocp.mesh import Mesh
from wormopt.ocp.motion import Guess
from wormopt.ocp.nlp import Ipopt
from wormopt.ocp.problem import Constraint, Ends, Problem
from wormopt.ocp.stages import _OPTIONS, Linearised, StageProgram, Stages, Tail
from wormopt.ocp.transcription import Transcription
from wormopt.simulation.options import Smooth

RADAU = Collocation(2, "radau")
FORWARD, BACKWARD, MASS = 0.5, 2.0, 1.5


def block(limit: float = np.inf, friction: bool = True) -> Model:
    """A block on the ground: m v' = u + f, drawn to a place by a spring."""
    x, v, u, f, m, c = (ca.SX.sym(name) for name in ("x", "v", "u", "f", "m", "c"))
    low, high = ca.SX.sym("low"), ca.SX.sym("high")
    ground = Contact("sole", v, f, Coulomb(low, high))  # pyright: ignore[reportArgumentType]
    force = f if friction else 0.0
    return Model(
        "block",
        [Signal("position", x, value=0.3), Signal("velocity", v, value=0.0)],
        ca.vertcat(v, (u - c * x + force) / m),
        u=[Signal("input", u, lower=-limit, upper=limit, value=0.0)],
        p=[
            Signal("mass", m, value=MASS),
            Signal("stiffness", c, value=1.0),
            *([Signal("friction_forward", low, value=FORWARD)] if friction else []),
            *([Signal("friction_backward", high, value=BACKWARD)] if friction else []),
        ],
        contacts=[ground] if friction else [],
    )


def problem_of(model: Model, end: float, **more: Any) -> Problem:
    """Least integral of (x - sin 3 t)^2 + v^2 / 10 + u^2 / 100 from the model's start."""
    ends = Ends.of(model, 1)
    x, v, u = model["position"], model["velocity"], model["input"]
    aim = ca.sin(3 * model.t) if model.contacts else ca.SX(0)
    cost = (x - aim) ** 2 + v**2 / 10 + u**2 / 100
    start = Constraint("start", ends.start, [0.3, 0.0], [0.3, 0.0])
    problem = Problem(model, ends, ends.integrals[0], (end, end), integrands=cost)
    return replace(problem, boundary_constraints=[start], **more)


GUESS = Guess(2.0, lambda t: np.vstack([0.3 + 0 * t, 0 * t]))


@cache
def planned(
    limit: float = np.inf, friction: bool = True, end: float = 2.0, arcs: int = 24
) -> MpcPlan:
    problem = problem_of(block(limit, friction), end)
    guess = replace(GUESS, duration=end)
    return plan_mpc(problem, Mesh.even(1, arcs, RADAU), Regularised(0.2, 0.4), guess)


def solved(
    stages: Stages, row: np.ndarray, plan: MpcPlan, k: int, p: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """One arc's equations, solved by Newton's method at its start and inputs; and its end."""
    row, part = row[None].copy(), replace(plan.given.part(slice(k, k + 1)), p=p)
    for _ in range(20):
        arc = stages.linearise(row, part)
        row[:, stages.inner] += arc.inner
    return row[0], stages.linearise(row, part).end[0]


# -- stages ----------------------------------------------------------------------------------------


@pytest.mark.parametrize("k", [0, 7, 20])
def test_linearised_arcs_are_derivatives_of_solved_ones(k: int):
    plan = planned()
    stages, p = plan.stages, plan.given.p
    row, _ = solved(stages, plan.course.rows[k], plan, k, p)
    arc = stages.linearise(row[None], plan.given.part(slice(k, k + 1)))
    by_p = stages.sensitivity(row[None], plan.given.part(slice(k, k + 1)), np.arange(4))
    step = 1e-5
    for j, place in enumerate(stages.v):
        ends = []
        for sign in (1, -1):
            moved = row.copy()
            moved[place] += sign * step
            ends.append(solved(stages, moved, plan, k, p)[1])
        assert (ends[0] - ends[1]) / (2 * step) == pytest.approx(arc.dynamics[0, :, j], abs=1e-7)
    for j in range(4):
        ends = [
            solved(stages, row, plan, k, p * np.exp(sign * step * (np.arange(4) == j)))[1]
            for sign in (1, -1)
        ]
        assert (ends[0] - ends[1]) / (2 * step) == pytest.approx(by_p.end[0, :, j], abs=1e-7)


TASK, EVEN = problem_of(block(), 2.0), Mesh.even(1, 4, RADAU)


@pytest.mark.parametrize(
    ("change", "mesh", "contact", "said"),
    [
        (
            {"path_constraints": [Constraint("way", TASK.model["position"], 0, 1)]},
            EVEN,
            Regularised(0.1),
            "only limits of inputs",
        ),
        ({"minimise": TASK.ends.end[0] ** 2}, EVEN, Regularised(0.1), "weighted sum of integrals"),
        ({}, Mesh(1, 4, RADAU), Regularised(0.1), "mesh with shares"),
        ({"duration": (1.0, 2.0)}, EVEN, Regularised(0.1), "fixed duration"),
        ({}, EVEN, Complementarity(0.1), "smooth contact"),
        ({}, Mesh.even(1, 4, RADAU, input_degree=1), Regularised(0.1), "constant on each arc"),
    ],
)
def test_stages_refuse_what_they_cannot_hold(
    change: dict[str, Any], mesh: Mesh, contact: Any, said: str
):
    with pytest.raises(ArgumentError, match=said):
        Stages(Transcription(replace(TASK, **change), mesh, contact))


# -- quadratic programs ----------------------------------------------------------------------------


def random_stages(seed: int, n: int, n_x: int, n_u: int) -> tuple[Linearised, np.ndarray]:
    rng, n_v = np.random.default_rng(seed), n_x + n_u
    root = rng.normal(size=(n, n_v, n_v))
    none = np.zeros((n, 0))
    return Linearised(
        end=none,
        dynamics=0.5 * rng.normal(size=(n, n_x, n_v)),
        cost=none,
        gradient=rng.normal(size=(n, n_v)),
        hessian=root @ root.transpose(0, 2, 1) + 0.1 * np.eye(n_v),
        inner=none,
        inner_by=none,
        defect=0.0,
    ), rng.normal(size=(n, n_x))


@settings(max_examples=examples(30))
@given(
    seed=st.integers(0, 10**6),
    n=st.integers(1, 8),
    size=st.sampled_from([(1, 1), (1, 3), (1, 7), (2, 1), (4, 1), (6, 2), (8, 3), (5, 3)]),
    wide=st.sampled_from([1e3, 1.0, 0.1]),
)
def test_a_dense_solver_with_active_sets_finds_the_same_inputs(
    seed: int, n: int, size: tuple[int, int], wide: float
):
    """Of 1 and 3 or 7: CasADi's BLASFEO solves triangular systems of these wrongly."""
    n_x, n_u = size
    arcs, gaps = random_stages(seed, n, n_x, n_u)
    first = np.random.default_rng(seed + 1).normal(size=n_x)
    tail = Tail(np.ones(n_x), 2 * np.eye(n_x))
    box = np.full((n, n_u), wide)
    v, end, holds = StageProgram(n, n_x, n_u).solve(first, arcs, gaps, tail, (-box, box))
    assert holds
    # everything by all inputs w: v_k = V w + v_0
    x_by, x_0 = np.zeros((n_x, n * n_u)), first
    H, g = np.zeros((n * n_u, n * n_u)), np.zeros(n * n_u)
    for k in range(n):
        own = np.eye(n * n_u)[k * n_u : (k + 1) * n_u]
        V, v_0 = np.vstack([x_by, own]), np.append(x_0, np.zeros(n_u))
        H += V.T @ arcs.hessian[k] @ V
        g += V.T @ (arcs.gradient[k] + arcs.hessian[k] @ v_0)
        x_by, x_0 = arcs.dynamics[k] @ V, arcs.dynamics[k] @ v_0 + gaps[k]
    H += x_by.T @ tail.hessian @ x_by
    g += x_by.T @ (tail.gradient + tail.hessian @ x_0)
    root = np.linalg.cholesky(H).T
    dense = lsq_linear(root, -np.linalg.solve(root.T, g), (-wide, wide), "bvls", tol=1e-14)
    assert dense.success
    assert v[:, n_x:].ravel() == pytest.approx(dense.x, abs=1e-6)
    assert end == pytest.approx(x_by @ dense.x + x_0, abs=1e-6)


def test_steps_are_kept_within_so_much():
    """What has no limit and wants to go far goes far, and no further at once."""
    arcs, gaps = random_stages(0, 3, 2, 1)
    arcs.dynamics[:, :, 2] = 0.0
    arcs.gradient[:, 2] = -1e7
    none = np.full((3, 1), np.inf)
    program = StageProgram(3, 2, 1)
    v, _, holds = program.solve(np.ones(2), arcs, gaps, Tail.none(2), (-none, none))
    assert holds
    assert v[:, 2] == pytest.approx(1e4)


@pytest.mark.parametrize("most", [1, 2, 3])
def test_a_solver_that_gives_up_is_not_believed(most: int, monkeypatch: pytest.MonkeyPatch):
    """What it leaves obeys dynamics and box, and is not optimal."""
    monkeypatch.setitem(_OPTIONS, "iter_max", most)
    arcs, gaps = random_stages(1, 6, 2, 2)
    box = np.full((6, 2), 0.1)
    program = StageProgram(6, 2, 2)
    assert not program.solve(np.ones(2), arcs, gaps, Tail.none(2), (-box, box))[2]


@pytest.mark.parametrize("wrong", ["box", "gaps", "first", "hessian", "gradient", "dynamics"])
def test_a_program_without_a_solution_says_so(wrong: str):
    arcs, gaps = random_stages(0, 3, 2, 1)
    first, box = np.zeros(2), [np.full((3, 1), -1.0), np.full((3, 1), 1.0)]
    if wrong == "box":
        box.reverse()
    else:
        {"gaps": gaps, "first": first}.get(wrong, getattr(arcs, wrong, gaps)).flat[0] = np.nan
    low, high = box
    assert not StageProgram(3, 2, 1).solve(first, arcs, gaps, Tail.none(2), (low, high))[2]


def test_cost_to_go_of_many_stages_is_that_of_the_algebraic_riccati_equation():
    A, B = np.array([[1.0, 0.1], [0.0, 0.95]]), np.array([[0.005], [0.1]])
    Q, R, S = np.diag([1.0, 0.2]), np.array([[0.05]]), np.array([[0.01], [0.02]])
    H = np.block([[Q, S], [S.T, R]])
    n = 600
    dynamics, hessian = (np.broadcast_to(m, (n, *m.shape)) for m in (np.hstack([A, B]), H))
    found = cost_to_go(dynamics, np.zeros((n, 3)), hessian, 2)
    P = solve_discrete_are(A, B, Q, R, s=S)
    K = np.linalg.solve(R + B.T @ P @ B, B.T @ P @ A + S.T)
    assert found.hessian[0] == pytest.approx(P, rel=1e-9)
    assert found.feedback[0] == pytest.approx(K, rel=1e-9)
    assert not found.ahead.any()


# -- plans and decisions ---------------------------------------------------------------------------


@pytest.mark.parametrize("limit", [np.inf, 2.0])
def test_a_plan_is_the_optimum_that_an_interior_point_finds(limit: float):
    plan = planned(limit)
    program = plan.stages.program
    assert plan.violation < 1e-12
    found = program.nlp.solve(program.pack(plan.motion.arcs, plan.bounds), plan.bounds, Ipopt())
    assert found.success
    assert plan.objective == pytest.approx(found.objective, rel=1e-8)
    assert plan.inputs[:, 0] == pytest.approx(
        program.unpack(found.w).inputs[0, 0], abs=1e-4 if np.isfinite(limit) else 1e-6
    )
    if np.isfinite(limit):
        assert np.sum(np.abs(plan.inputs) > limit - 1e-5) > 3  # or nothing would be tested


@pytest.mark.parametrize("limit", [np.inf, 2.0])
@pytest.mark.parametrize(("horizon", "steps"), [(1, 1), (6, 1), (6, 10), (100, 1)])
def test_decisions_repeat_the_plan_where_the_model_is_right(limit: float, horizon: int, steps: int):
    """Bellman: the plant takes the model's own steps, so that the costs are the same."""
    plan = planned(limit)
    stages, control = plan.stages, PredictiveController(plan, MpcOptions(horizon, steps))
    x, p, cost = plan.course.rows[0, stages.start], plan.given.p, 0.0
    for k in range(len(plan.times) - 1):
        decided = control.decide(k, x * stages.arc.x_nominal)
        assert np.all(np.abs(decided.input) <= limit)
        row = control.course.rows[k]
        row, x = solved(stages, row, plan, k, p)
        cost += stages.linearise(row[None], plan.given.part(slice(k, k + 1))).cost[0]
        assert decided.input == pytest.approx(plan.inputs[k], abs=2e-5)
    assert cost <= plan.objective * (1 + 1e-6)
    assert cost == pytest.approx(plan.objective, rel=1e-6)


@pytest.mark.parametrize("horizon", [1, 5])
def test_decisions_of_a_linear_worm_are_those_of_lqr(horizon: int):
    """Far from the end, feedback of the infinite time, whatever the horizon and the state."""
    plan = planned(friction=False, end=20.0, arcs=200)
    stages, k = plan.stages, 20
    arc = stages.linearise(plan.course.rows[k : k + 1], plan.given.part(slice(k, k + 1)))
    A, B = np.hsplit(arc.dynamics[0], [2])
    H = arc.hessian[0]
    P = solve_discrete_are(A, B, H[:2, :2], H[2:, 2:], s=H[:2, 2:])
    K = np.linalg.solve(H[2:, 2:] + B.T @ P @ B, B.T @ P @ A + H[2:, :2])
    control = PredictiveController(plan, MpcOptions(horizon))
    for state in ([1.0, 0.0], [-0.3, 2.0]):
        decided = control.decide(k, np.array(state))
        assert decided.input == pytest.approx(-K @ state, rel=1e-6)
        assert decided.steps == 1


def test_full_convergence_leaves_nothing_to_do():
    plan = planned()
    control = PredictiveController(plan, MpcOptions(10, 50, 1e-9))
    decided = control.decide(5, np.array([0.6, -0.4]))
    assert 1 < decided.steps < 50
    assert decided.size <= 1e-9
    again = control.decide(5, np.array([0.6, -0.4]))
    assert again.steps == 1
    assert again.input == pytest.approx(decided.input, abs=1e-7)


def test_a_worm_that_is_as_believed_is_moved_at_least_as_well_as_open_loop():
    """By an integrator that is not the controller's: the smooth law, adaptive steps."""
    plan = planned()
    model = block()
    receded = run_mpc(model, plan, MpcOptions(5), contact=Smooth(0.2))
    assert receded.unsolved == 0
    # discretisation alone tells decisions from the plan: of third order in the arcs
    assert np.abs(receded.inputs.polynomial[:, 0, 0] - plan.inputs[:, 0]).max() < 0.05
    assert receded.states.shape == (2, 25)
    assert receded.seconds.shape == (24,)


@pytest.mark.parametrize("state", [[np.nan, 0.0], [np.inf, 0.0], [0.0], [0.0, 0.0, 0.0]])
def test_what_is_no_state_is_refused(state: list[float]):
    control = PredictiveController(planned(), MpcOptions(3))
    with pytest.raises(ArgumentError, match="state must be 2 finite numbers"):
        control.decide(0, np.array(state))


def test_a_plan_that_is_not_found_says_what_to_change(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr("wormopt.control.predictive._MOST_STEPS", 2)
    problem = problem_of(block(), 2.0)
    with pytest.raises(SolveError, match="no plan is found at v_reg") as caught:
        plan_mpc(problem, Mesh.even(1, 20, RADAU), Regularised(1e-5, 1e-5), GUESS)
    assert "larger v_reg" in str(caught.value)


@pytest.mark.parametrize(
    ("make", "wrong"),
    [
        *((MpcOptions, {key: 0}) for key in ("horizon", "steps", "tolerance")),
        (MpcOptions, {"tolerance": np.nan}),
        (Estimation, {"names": ()}),
        *((Estimation, {key: 0}) for key in ("window", "noise", "memory", "steps")),
        (Estimation, {"spread": -1.0}),
    ],
)
def test_decisions_and_estimation_refuse_nonsense(make: Any, wrong: dict[str, Any]):
    with pytest.raises(ArgumentError):
        make(**wrong)


# -- estimation ------------------------------------------------------------------------------------


def followed(plan: MpcPlan, inputs: np.ndarray, p: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Arcs and states of a worm that takes the model's own steps with other parameters."""
    stages, x, rows = plan.stages, plan.course.rows[0, plan.stages.start], []
    states = [x]
    for k, u in enumerate(inputs):
        row = plan.course.rows[k].copy()
        row[stages.start], row[stages.inputs] = x, u
        row, x = solved(stages, row, plan, k, p)
        rows.append(row)
        states.append(x)
    return np.array(rows), np.array(states)


@settings(max_examples=examples(6))
@given(st.lists(st.floats(0.75, 1.3), min_size=3, max_size=3))
def test_estimation_finds_the_parameters_of_exact_measurements(factors: list[float]):
    plan, names = planned(), ("mass", "friction_forward", "friction_backward")
    stages = plan.stages
    chosen, sizes = places(stages, names), stages.arc.x_nominal
    p = plan.given.p.copy()
    p[chosen] *= factors
    inputs = 4 * np.sin(np.arange(24) / 2)[:, None]
    rows, states = followed(plan, inputs, p)
    # what slides out of a window is linearised where it stood
    for window, off in ((24, 1e-7), (12, 1e-3)):
        estimation = Estimation(names, window, noise=1e-6, spread=10.0, steps=3)
        estimator, found = Estimator(stages, plan.given, estimation), plan.given.p
        for k, row in enumerate(rows):
            guess = plan.course.rows[k].copy()  # of another motion, and of believed parameters
            guess[stages.inputs] = row[stages.inputs]
            found = estimator.see(guess, states[k] * sizes, states[k + 1] * sizes)
        assert found[chosen] == pytest.approx(p[chosen], rel=off)
        others = np.setdiff1d(np.arange(len(p)), chosen)
        assert np.array_equal(found[others], plan.given.p[others])


def test_what_cannot_be_seen_stays_as_believed():
    plan = planned()
    chosen = places(plan.stages, ("friction_backward",))
    rows, states = followed(plan, np.full((10, 1), 6.0), plan.given.p)  # never slides back
    estimation = Estimation(("friction_backward",), window=5)
    estimator = Estimator(plan.stages, plan.given, estimation)
    for k, row in enumerate(rows):
        found = estimator.see(row, states[k], states[k + 1])
        assert found[chosen] == pytest.approx(BACKWARD, rel=0.02)


def test_a_window_remembers_what_slid_out_of_it():
    """With a short window the last arcs alone say little; with memory all arcs count."""
    plan, names = planned(), ("mass",)
    stages = plan.stages
    chosen = places(stages, names)
    p = plan.given.p.copy()
    p[chosen] *= 1.2
    inputs = np.concatenate([3 * np.sin(np.arange(12)), np.zeros(12)])[:, None]
    rows, states = followed(plan, inputs, p)
    noise = np.random.default_rng(0).normal(scale=3e-3, size=states.shape)
    off = {}
    for memory in (1e-3, np.inf):
        estimation = Estimation(names, window=3, noise=3e-3, spread=0.3, memory=memory)
        estimator, found = Estimator(stages, plan.given, estimation), plan.given.p
        for k, row in enumerate(rows):
            found = estimator.see(row, *(states + noise)[k : k + 2])
        off[memory] = abs(float(found[chosen][0] / p[chosen][0] - 1))
    assert off[np.inf] < 0.05 < off[1e-3]


def test_only_parameters_above_0_that_exist_are_estimated():
    plan = planned()
    with pytest.raises(ArgumentError, match="no parameter 'lenght'; there are mass, stiffness"):
        Estimator(plan.stages, plan.given, Estimation(("lenght",)))
    nothing = replace(plan.given, p=0 * plan.given.p)
    with pytest.raises(ArgumentError, match="above 0"):
        Estimator(plan.stages, nothing, Estimation(("mass",)))
