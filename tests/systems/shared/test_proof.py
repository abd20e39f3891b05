"""Second routes: right motions are confirmed, and by another method than the first."""

from typing import Any

import casadi as ca
import pytest

from wormopt.model.model import Model, Signal, Switch
from wormopt.progress import silent
from wormopt.simulation.options import Route, Tolerance
from wormopt.simulation.simulate import simulate
from wormopt.simulation.trajectory import Trajectory
from wormopt.systems.shared import proof

X, V = ca.SX.sym("x"), ca.SX.sym("v")


def body(start: float, force: Any, *switches: Switch) -> Model:
    states = [Signal("x", X, value=start), Signal("v", V, value=0.0)]
    return Model("body", states, ca.vertcat(V, force), switches=list(switches))


@pytest.mark.parametrize("apart", [-2e-10, 2e-10])
def test_an_event_at_the_end_may_happen_in_one_route_only(
    apart: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A ball falls from a height of 0.5 to the ground at t = 1, where it bounces."""

    def rounded(model: Model, span: tuple[float, float], **how: Any) -> Trajectory:
        if how["route"] == "python" and span[1] == motion.end_time:
            span, how = (0.0, span[1] + apart), how | {"times": [span[1] + apart]}
        return simulate(model, span, **how)

    ball = body(0.5, ca.SX(-1), Switch("bounce", -X, ca.vertcat(0, -V)))
    motion = simulate(ball, 1.0 - apart / 2)
    monkeypatch.setattr(proof, "simulate", rounded)
    found = proof.cross_check(ball, motion, Tolerance(), report=silent)
    assert found
    assert not found.fault
    assert found.until == pytest.approx(1.0, abs=1e-6)
    (warning,) = proof.warnings_of_motion(motion, found)
    assert warning.endswith("rounding decides whether the event there still happens")


@pytest.mark.parametrize("first", ["auto", "python"])
def test_another_method_steps_in_where_implicit_steps_fail(first: Route) -> None:
    """A body falls on a wall that pushes back with 10,000 times its weight."""
    falling = body(1.0, ca.if_else(X < 0, 1e4, -1))
    motion = simulate(falling, 20.0, route=first)
    found = proof.cross_check(falling, motion, Tolerance(), report=silent)
    assert found
    assert not found.fault
    assert found.route != motion.route
    assert ("not their code" in found.shared) == (motion.route == "native")
