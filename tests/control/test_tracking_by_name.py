"""Models whose output and input have names of their own are tracked like any other."""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import casadi as ca
import numpy as np
import pytest

import wormopt as wo
from wormopt.control.funnel import Funnel, funnel_tracker
from wormopt.control.lambda_tracker import Quadratic, lambda_tracker
from wormopt.control.loop import Reference, as_tracked, gait_reference, with_reference
from wormopt.control.lqr import lqr
from wormopt.errors import ArgumentError
from wormopt.model.gait import Gait

J, C, D = 0.5, 2.0, 0.1
STILL = Gait(np.array([0.0, 1.0]), np.full((1, 1, 1), 0.4))
WIDE = Funnel(3.0, 0.2, 1.0)


def wheel() -> wo.Model:
    """A wheel on a torsion spring, with a lamp beside it that nobody tracks."""
    phi, spin, torque, volt = (ca.SX.sym(name) for name in ("phi", "spin", "torque", "volt"))
    states = [
        wo.Signal("phi", phi, "angle", value=0.0),
        wo.Signal("spin", spin, "angular_frequency", value=0.0),
    ]
    ode = ca.vertcat(spin, (torque - C * phi - D * spin) / J)
    inputs = [wo.Signal("volt", volt, value=0.0), wo.Signal("torque", torque)]
    outputs = [wo.Output("tip", 3 * phi, "length"), wo.Output("glow", volt)]
    return wo.Model("wheel", states, ode, u=inputs, outputs=outputs)


NAMES: Any = {"output": "phi", "input": "torque"}
TUBE: Any = {"tube_radius": 0.05, "adaptation": Quadratic(1e4)}
FUNNELS: Any = {"funnel": WIDE, "rate_funnel": WIDE}
Close = Callable[[wo.Model, Reference], wo.Model]
LOOPS: dict[str, Close] = {
    "lambda": lambda plant, aim: lambda_tracker(plant, aim, **TUBE, **NAMES),
    "filter": lambda plant, aim: lambda_tracker(plant, aim, feedback="filter", **TUBE, **NAMES),
    "funnel": lambda plant, aim: funnel_tracker(plant, aim, **FUNNELS, **NAMES),
    "lqr": lambda plant, aim: lqr(plant, aim, error_weight=9.0, **NAMES),
}


@pytest.mark.parametrize("name", LOOPS)
def test_a_wheel_is_turned_to_where_it_shall_be(name: str):
    plant = wheel()
    loop = LOOPS[name](plant, gait_reference(STILL, plant.t))
    motion = wo.simulate(loop, 40.0, times=np.linspace(0.0, 40.0, 41))
    radius = {"funnel": 0.2, "lqr": 1e-6}.get(name, 0.05)
    assert abs(motion["error"][0, -1]) < radius * (1 + 1e-3)
    assert motion["phi"][0, -1] - motion["error"][0, -1] == pytest.approx(0.4)
    # the input under its own name is the torque that the balance of moments asks for
    held = C * motion["phi"][0, -1] + D * motion["spin"][0, -1]
    if name == "lqr":
        assert motion["torque"][0, -1] == pytest.approx(held, abs=1e-6)
    assert [signal.name for signal in loop.u] == ["volt"]
    units = {output.name: output.unit for output in loop.outputs}
    assert units["error"] == units["reference"] == "angle"


def test_lqr_has_the_gains_of_its_closed_form():
    """J e'' + D e' + C e = v: K_0 = -C + sqrt(C^2 + q), K_1 = -D + sqrt(D^2 + 2 J K_0)."""
    plant = wheel()
    loop = LOOPS["lqr"](plant, gait_reference(STILL, plant.t))
    k0 = -C + (C**2 + 9.0) ** 0.5
    k1 = -D + (D**2 + 2 * J * k0) ** 0.5
    found = {signal.name: signal.value for signal in loop.p if signal.name.endswith("gain")}
    assert found == {"error_gain": pytest.approx((k0,)), "rate_gain": pytest.approx((k1,))}


def test_an_output_of_the_model_is_followed_too():
    plant = wheel()
    aim = gait_reference(Gait(STILL.breaks, 3 * STILL.polynomial), plant.t)
    loop = lqr(plant, aim, error_weight=9.0, output="tip", input="torque")
    motion = wo.simulate(loop, 20.0, times=np.linspace(0.0, 20.0, 11))
    assert motion["phi"][0, -1] == pytest.approx(0.4, abs=1e-6)
    compared = with_reference(plant, aim, output="tip")
    assert {"error", "error_norm"} <= {output.name for output in compared.outputs}


@pytest.mark.parametrize(
    ("names", "said"),
    [
        ({}, "wheel has no output 'length'.*write output= one of 'phi', 'spin', 'tip', 'glow'"),
        ({"output": "phi"}, "no input 'input' of 1.*one of 'volt' of 1, 'torque' of 1"),
        ({"output": "glow", "input": "torque"}, "rates of wheel directly"),
        ({"output": "spin", "input": "torque"}, "rates of wheel directly"),
    ],
)
@pytest.mark.parametrize("close", [lambda_tracker, funnel_tracker, lqr])
def test_names_that_are_not_there_are_told(
    close: Callable[..., wo.Model], names: dict[str, str], said: str
):
    plant = wheel()
    needed = {
        lambda_tracker: {"tube_radius": 0.1},
        funnel_tracker: FUNNELS,
        lqr: {"error_weight": 1.0},
    }[close]
    with pytest.raises(ArgumentError, match=said):
        close(plant, gait_reference(STILL, plant.t), **needed, **names)


def carriage() -> wo.Model:
    """Two integrators, and a third that the input reaches last."""
    far, x, v, u = (ca.SX.sym(name) for name in ("far", "x", "v", "u"))
    states = [wo.Signal(n, s, value=0.0) for n, s in zip("fxv", (far, x, v), strict=True)]
    outputs = [wo.Output("both", ca.vertcat(x, far)), wo.Output("push", x + u)]
    return wo.Model("c", states, ca.vertcat(x, v, u), u=[wo.Signal("u", u)], outputs=outputs)


@pytest.mark.parametrize(
    ("output", "input_", "message"),
    [
        ("y", "u", "has no output 'y'"),
        ("x", "w", "has no input 'w' of 1 scalars"),
        ("both", "u", "has no input 'u' of 2 scalars"),
        ("push", "u", "push of c has a relative degree below two"),
        ("v", "u", "v of c has a relative degree below two"),
        ("f", "u", "u does not act on its acceleration"),
    ],
)
def test_what_cannot_follow_is_refused(output: str, input_: str, message: str):
    with pytest.raises(ArgumentError, match=message):
        as_tracked(carriage(), output, input_)


def test_a_tracked_plant_has_the_names_of_a_chain():
    plant = as_tracked(wheel(), "tip", "torque")
    assert [signal.name for signal in plant.u] == ["input"]
    assert [signal.name for signal in plant.p] == ["volt"]  # another input keeps its value
    assert ca.is_equal(plant["length"], plant["tip"])
    assert ca.is_equal(ca.simplify(plant["rate"] - 3 * plant["spin"]), ca.SX(0))
    again = wheel()
    clash = replace(again, outputs=[wo.Output("rate", 2 * again["spin"])])
    with pytest.raises(ArgumentError, match="another signal 'rate'"):
        as_tracked(clash, "phi", "torque")
