"""Bounds of inputs hold in closed loops, and inputs that push the wrong way are refused.

References: the same loops written anew with numpy.clip and integrated by scipy.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import casadi as ca
import numpy as np
import pytest
from effort import examples
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import solve_ivp

import wormopt as wo
from wormopt.control.funnel import Funnel, funnel_tracker
from wormopt.control.lambda_tracker import lambda_tracker
from wormopt.control.loop import Reference
from wormopt.control.lqr import lqr
from wormopt.control.predictive import MpcOptions, plan_mpc, run_mpc
from wormopt.control.switching import switching_tracker
from wormopt.errors import ArgumentError
from wormopt.model.friction import Coulomb
from wormopt.model.model import Contact, Model, Output, Signal
from wormopt.simulation.options import Smooth
from wormopt.simulation.simulate import simulate

LIMIT = 6.0
t = ca.SX.sym("t")


def arm(limit: float = LIMIT, gain: Any = 1.0, size: int = 1) -> Model:
    """Angles whose accelerations are `gain` times the torques."""
    angle, rate, tau = (ca.SX.sym(name, size) for name in ("angle", "rate", "tau"))
    states = [Signal("angle", angle, "angle", value=0.0), Signal("rate", rate, value=0.0)]
    ode = ca.vertcat(rate, ca.DM(gain) @ tau)
    inputs = [Signal("tau", tau, lower=-limit, upper=limit)]
    return Model("arm", states, ode, u=inputs, t=t, outputs=[Output("turned", angle, "angle")])


def swing(plant: Model, size: int = 1) -> Reference:
    """Angles that swing as sin 2 t, or are at rest at 0."""
    own = plant.t
    value, ones = ca.sin(2 * own), ca.SX.ones(size)
    return Reference(value * ones, 2 * ca.cos(2 * own) * ones, -4 * value * ones)


NAMES: Any = {"output": "angle", "input": "tau"}


def clipped(command: Callable[[float, np.ndarray], float], more: Any = None, **start: Any) -> Any:
    """End of the arm under a command within the limits, at 2."""

    def rates(at: float, y: np.ndarray) -> list[float]:
        pushed = float(np.clip(command(at, y), -LIMIT, LIMIT))
        return [y[1], pushed, *(more(at, y) if more else ())]

    options: Any = {"method": "LSODA", "rtol": 1e-10, "atol": 1e-11}
    return solve_ivp(rates, (0, 2), start.get("y0", [0.0, 0.0]), **options).y[:, -1]


def test_an_lqr_keeps_its_input_within_bounds_and_says_so():
    plant = arm()
    loop = lqr(plant, swing(plant), error_weight=1e7, **NAMES)
    motion = simulate(loop, 2.0)
    assert abs(motion["tau"]).max() == LIMIT
    assert motion["saturated"][0, 0] == 1
    (said,) = motion.warnings
    assert "first at t = 0" in said
    k0, k1 = np.sqrt(1e7), np.sqrt(2 * np.sqrt(1e7))  # of a double integrator

    def command(at: float, y: np.ndarray) -> float:
        return -4 * np.sin(2 * at) - k0 * (y[0] - np.sin(2 * at)) - k1 * (y[1] - 2 * np.cos(2 * at))

    assert motion.end == pytest.approx(clipped(command), abs=1e-6)


def test_a_lambda_tracker_keeps_its_input_within_bounds():
    plant = arm()
    loop = lambda_tracker(plant, swing(plant), tube_radius=0.1, gain_start=20.0, **NAMES)
    motion = simulate(loop, 2.0)
    assert abs(motion["tau"]).max() == LIMIT

    def errors(at: float, y: np.ndarray) -> tuple[float, float, float]:
        e, rate = y[0] - np.sin(2 * at), y[1] - 2 * np.cos(2 * at)
        return e, rate, max(abs(e) - 0.1, 0) ** 2

    def command(at: float, y: np.ndarray) -> float:
        e, rate, growth = errors(at, y)
        return -(y[2] * e + growth * e + y[2] * rate)

    found = clipped(command, lambda at, y: [errors(at, y)[2]], y0=[0.0, 0.0, 20.0])
    assert motion.end == pytest.approx(found, abs=1e-6)


def loops(plant: Model) -> dict[str, Model]:
    """Every kind of closed loop around a plant."""
    aim = swing(plant, plant.u[0].size)
    wide, wider = Funnel(20.0, 10.0, time=1.0), Funnel(80.0, 60.0, time=1.0)
    given: Any = {**NAMES, "tube_radius": 0.1}
    return {
        **{
            kind: lambda_tracker(plant, aim, feedback=kind, gain_start=3.0, **given)
            for kind in ("derivative", "filter", "difference", "backstepping")
        },
        "funnel": funnel_tracker(plant, aim, funnel=wide, rate_funnel=wider, gain=50.0, **NAMES),
        "switching": switching_tracker(
            plant, aim, settling=1.0, overshoot=0.5, gain_start=5.0, **given
        ),
        "lqr": lqr(plant, aim, error_weight=1e4, **NAMES),
    }


@pytest.mark.parametrize("kind", list(loops(arm())))
def test_every_closed_loop_keeps_bounds(kind: str):
    limit = 3.0 if kind == "filter" else 0.5
    motion = simulate(loops(arm(limit))[kind], 0.3, route="python")
    assert abs(motion["tau"]).max() <= limit
    assert motion["saturated"].max() == 1
    assert set(np.unique(motion["saturated"])) <= {0.0, 1.0}


def test_bounds_on_one_side_cut_on_one_side():
    plant = arm(np.inf)
    tau = plant.u[0]
    pull = Model("pull", plant.x, plant.ode, u=[Signal("tau", tau.symbol, lower=0.0)], t=t)
    motion = simulate(lqr(pull, swing(pull), error_weight=1e4, **NAMES), 3.0)
    assert motion["tau"].min() == 0.0
    assert motion["tau"].max() > 10


def test_without_bounds_nothing_changes():
    for kind, loop in loops(arm(np.inf)).items():
        assert "saturated" not in {o.name for o in loop.outputs}, kind
        ode = ca.Function("ode", [ca.vertcat(*ca.symvar(loop.ode))], [loop.ode])
        kinds = {ode.instruction_id(i) for i in range(ode.n_instructions())}
        assert ca.OP_FMIN not in kinds, kind
    assert simulate(loops(arm(np.inf))["lqr"], 0.1).warnings == ()


def test_decisions_are_cut_to_the_bounds_of_the_worm_and_say_how_often():
    """A worm whose bounds are tighter than the plan knows."""
    x, v, u, f = (ca.SX.sym(name) for name in "xvuf")
    states = [Signal("x", x, value=0), Signal("v", v, value=0)]
    sole = [Contact("sole", v, f, Coulomb(0.5, 2.0))]

    def block(bound: float) -> Model:
        push = [Signal("u", u, value=0, lower=-bound, upper=bound)]
        return Model("block", states, ca.vertcat(v, u + f), u=push, contacts=sole, t=t)

    plant = block(np.inf)
    ends = wo.Ends.of(plant, 1)
    error = x - ca.sin(ca.pi / 2 * t)
    problem = wo.Problem(
        plant, ends, ends.integrals[0], (2.0, 2.0), integrands=error**2 + 1e-3 * u**2,
        boundary_constraints=[wo.Constraint("start", ends.start, [0, 0], [0, 0])],
    )  # fmt: skip
    mesh = wo.Mesh.even(1, 20, wo.Collocation(2, "radau"))
    guess = wo.Guess(2.0, lambda at: np.zeros((2, len(at))))
    plan = plan_mpc(problem, mesh, wo.Regularised(0.1, 0.2), guess)
    asked = np.abs(
        run_mpc(plant, plan, MpcOptions(horizon=5), contact=Smooth(0.1)).inputs.polynomial
    )
    tight = run_mpc(block(3.0), plan, MpcOptions(horizon=5), contact=Smooth(0.1))
    assert asked.max() > 3.0
    assert np.abs(tight.inputs.polynomial).max() == 3.0
    assert 0 < tight.saturated.mean() < 1


# -- inputs that push the wrong way ----------------------------------------------------------------


def trackers(plant: Model) -> list[Callable[[], Model]]:
    aim = swing(plant, plant.u[0].size)
    wide = Funnel(20.0, 10.0, time=1.0)
    return [
        lambda: lambda_tracker(plant, aim, tube_radius=0.1, **NAMES),
        lambda: funnel_tracker(plant, aim, funnel=wide, rate_funnel=wide, **NAMES),
        lambda: switching_tracker(
            plant, aim, tube_radius=0.1, settling=1.0, overshoot=0.5, **NAMES
        ),
    ]


@settings(max_examples=examples(10))
@given(seed=st.integers(0, 10**6), size=st.integers(1, 4))
def test_the_sign_of_the_high_frequency_gain_decides(seed: int, size: int):
    random = np.random.default_rng(seed)
    root = random.normal(size=(size, size))
    gain = root @ root.T + 0.1 * np.eye(size)
    for build in trackers(arm(np.inf, gain, size)):
        assert build().u == []
    for build in trackers(arm(np.inf, -gain, size)):
        with pytest.raises(ArgumentError, match="reverse the sign of the input"):
            build()
    if size > 1:
        for build in trackers(arm(np.inf, gain @ np.diag([1.0, *[-1.0] * (size - 1)]), size)):
            with pytest.raises(ArgumentError, match="another order and sign of the inputs"):
                build()


def test_an_input_that_does_not_act_at_the_start_is_refused():
    with pytest.raises(ArgumentError, match="does not accelerate all entries of angle"):
        trackers(arm(np.inf, [[1.0, 1.0], [1.0, 1.0]], 2))[0]()


def test_an_input_of_relative_degree_three_is_refused():
    """A torque that a coil builds up."""
    angle, rate, torque, tau = (ca.SX.sym(name) for name in ("angle", "rate", "torque", "tau"))
    states = [
        Signal(n, s, value=0.0)
        for n, s in zip(("angle", "rate", "torque"), (angle, rate, torque), strict=True)
    ]
    ode = ca.vertcat(rate, torque, tau - torque)
    slow = Model("slow arm", states, ode, u=[Signal("tau", tau)], t=t)
    with pytest.raises(ArgumentError, match="eigenvalues 0"):
        trackers(slow)[0]()


def test_gains_of_unknown_parameters_are_not_judged_and_those_of_known_ones_are():
    angle, rate, tau, mass = (ca.SX.sym(name) for name in ("angle", "rate", "tau", "mass"))

    def plant(value: float | None) -> Model:
        states = [Signal("angle", angle, value=0.0), Signal("rate", rate, value=0.0)]
        ode = ca.vertcat(rate, tau / mass)
        own = [Signal("mass", mass, value=value)]
        return Model("arm", states, ode, u=[Signal("tau", tau)], p=own, t=t)

    assert trackers(plant(None))[0]().name
    assert trackers(plant(2.0))[0]().name
    with pytest.raises(ArgumentError, match=r"eigenvalues -0\.5 at the start"):
        trackers(plant(-2.0))[0]()
