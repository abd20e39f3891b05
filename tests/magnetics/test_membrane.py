"""Membrane: formulas, closed form of the best thickness, scenes of kind "membrane"."""

import math
from pathlib import Path
from typing import Any

import casadi as ca
import hypothesis.strategies as st
import numpy as np
import pytest
import sympy
from effort import examples
from hypothesis import given, settings
from outcomes import failed_checks, refusals, value

import wormopt as wo
from wormopt.cli import main
from wormopt.errors import ArgumentError, SolveError
from wormopt.pictures import figure
from wormopt.study import load_scene
from wormopt.systems.coils.membrane import Choice, Membrane

SCENE = "membrane"
NUMBERS = (4e-3, 5e5, 2200.0, 1e-11, 0.15, 1200.0)


def closed_form() -> tuple[dict[str, Any], Any]:
    """Least thickness for each limit, by sympy from hoop stress, Hooke's and Fick's law."""
    h, R, E, p, D, dc, rho, t, top = sympy.symbols("h R E p D dc rho t top", positive=True)
    length = sympy.Symbol("L", positive=True)
    # half a tube, cut along its axis: the pressure on the cut is held by both walls
    force = sympy.Symbol("s", positive=True)
    (stress,) = sympy.solve(2 * force * h * length - p * 2 * R * length, force)
    flux = D * dc / h * 2 * sympy.pi * R * length
    lost = flux * t / (rho * sympy.pi * R**2 * length)
    measures = {"loss": lost, "stress": stress, "strain": stress / E}
    needed = {name: sympy.solve(expr - top, h)[0] for name, expr in measures.items()}
    return needed, (R, E, p, D, dc, rho, t, top)


def by_hand(lifetime: float, limits: dict[str, float], numbers: Any = NUMBERS) -> dict[str, float]:
    needed, symbols = closed_form()
    found = {name: sympy.lambdify(symbols, needed[name]) for name in limits}
    return {name: float(found[name](*numbers, lifetime, limits[name])) for name in limits}


def test_more_strain_is_more_loss_in_proportion():
    h, tube = sympy.Symbol("h", positive=True), Membrane(*NUMBERS)
    ratio = sympy.simplify(tube.strain(h) / tube.loss_share(h, 1e7))
    assert not ratio.has(h)  # so that every thickness is on the front


def test_formulas_take_expressions():
    h, tube = ca.SX.sym("h"), Membrane(*NUMBERS, contact_strain=0.02)
    left = tube.contact_pressure(h)
    slope = ca.Function("slope", [h], [ca.gradient(left, h), ca.gradient(tube.strain(h), h)])
    found = np.array(slope(1e-4)).ravel()
    assert found == pytest.approx([-5e5 * 0.02 / 4e-3, -tube.strain(1e-4) / 1e-4])


def test_the_beam_is_a_thin_tube():
    tube, h = Membrane(*NUMBERS), 1e-7
    second_moment = math.pi / 4 * ((4e-3 + h / 2) ** 4 - (4e-3 - h / 2) ** 4)
    assert tube.bending_stiffness(h) == pytest.approx(5e5 * second_moment, rel=1e-8)


@pytest.mark.parametrize("bad", [0.0, -1.0, math.nan, math.inf, "1", None])
@pytest.mark.parametrize("place", range(6))
def test_what_is_no_membrane_is_refused(place: int, bad: Any):
    with pytest.raises(ArgumentError, match="must be a number above 0"):
        Membrane(*(bad if k == place else number for k, number in enumerate(NUMBERS)))


@settings(max_examples=examples(20))
@given(
    loss=st.floats(1e-3, 0.9), stress=st.floats(1e3, 1e6), strain=st.floats(1e-3, 1.0),
    lifetime=st.floats(1e5, 1e9),
)  # fmt: skip
def test_the_best_thickness_is_that_of_the_closed_form(
    loss: float, stress: float, strain: float, lifetime: float
):
    limits = {"loss": loss, "stress": stress, "strain": strain}
    choice = Choice(Membrane(*NUMBERS), lifetime, limits)
    best, violation = choice.widest((math.log(1e-9), math.log(1e3)), **limits)
    assert violation < 1e-9
    assert best == pytest.approx(max(by_hand(lifetime, limits).values()), rel=1e-8)


def test_the_packaged_scene():
    result = wo.run(SCENE)
    assert result.status == "ok"
    exact = by_hand(3.15e7, {"loss": 0.1, "stress": 5e4, "strain": 0.1})
    for name, thickness in exact.items():
        assert value(result, f"thickness_for_{name}") == pytest.approx(thickness, rel=1e-8)
    assert value(result, "thickness_best") == pytest.approx(0.196875e-3, rel=1e-8)
    assert value(result, "limited_by") == "loss"
    assert value(result, "loss_share") == pytest.approx(0.1, rel=1e-8)
    assert result.trust["warnings"] == []
    assert result.trust["recheck_error"] < 1e-9


def test_free_ends_are_a_named_assumption():
    trust = wo.run(SCENE).trust
    assert "free to shorten" in trust["assumptions"]["free ends"]
    # Hooke's law with and without the stress along the tube
    E, nu, hoop, axial = sympy.symbols("E nu hoop axial", positive=True)
    strain = (hoop - nu * axial) / E
    tube = Membrane(*NUMBERS)
    free = strain.subs({axial: 0, hoop: tube.stress(1e-4), E: tube.youngs_modulus})
    assert tube.strain(1e-4) == pytest.approx(float(free), rel=1e-14)
    closed = strain.subs(axial, hoop / 2)
    assert sympy.simplify(closed / strain.subs(axial, 0) - (1 - nu / 2)) == 0
    assert "(1 - nu/2) p R / (E h)" in trust["assumptions"]["free ends"]


def test_the_front_is_that_of_the_closed_form():
    result = wo.run(SCENE)
    h, loss, strain = (result[f"front_{name}"].values for name in ("thickness", "loss", "strain"))
    assert (h[0], h[-1]) == pytest.approx((1e-3, 2e-5), rel=1e-7)
    wanted = by_hand(3.15e7, {"loss": 1.0})["loss"] / loss
    assert h == pytest.approx(wanted, rel=1e-9)
    assert strain == pytest.approx(2200 * 4e-3 / 5e5 / h, rel=1e-12)
    within = result["front_within"].values == 1
    assert np.all(h[within] >= value(result, "thickness_best") * (1 - 1e-6))
    assert np.all(h[~within] <= value(result, "thickness_best") * (1 + 1e-6))


@pytest.mark.parametrize(
    ("change", "limited_by"),
    [
        ("lifetime=1e6", "s"),
        ("lifetime=6e7", "loss"),
        ("membrane.stress_max=2e4", "stress"),
        ("membrane.strain_max=0.05", "strain"),
        ("thickness=[4e-4, 1e-3]", "thickness"),
    ],
)
def test_what_limits_the_thickness(change: str, limited_by: str):
    result = wo.run(load_scene(SCENE, [change]))
    assert result.status == "ok"
    assert value(result, "limited_by").startswith(limited_by)


def test_limits_that_no_thickness_meets():
    with pytest.raises(SolveError, match="no thickness up to") as caught:
        wo.run(load_scene(SCENE, ["loss_max=0.001"]))
    assert caught.value.code == "infeasible"
    assert "shorter lifetime" in caught.value.suggestion
    assert caught.value.partial.status == "failed"
    assert "limits" in failed_checks(caught.value.partial)
    with pytest.raises(SolveError, match=r"thickness\[1\] to 0.00197"):
        wo.run(load_scene(SCENE, ["loss_max=0.01"]))


@pytest.mark.parametrize(
    "change",
    ["loss_max=0.016", "loss_max=0.01", "membrane.stress_max=7123", "membrane.strain_max=0.0137"],
)
def test_the_thickness_advised_is_enough(change: str):
    with pytest.raises(SolveError) as caught:
        wo.run(load_scene(SCENE, [change]))
    advised = caught.value.suggestion.split("thickness[1] to ")[1].split(",")[0]
    result = wo.run(load_scene(SCENE, [change, f"thickness=[2e-5, {advised}]"]))
    assert result.status == "ok"
    assert value(result, "thickness_best") == pytest.approx(float(advised), rel=0.01)
    assert f"for {advised} m" in caught.value.reason


def test_warnings():
    result = wo.run(load_scene(SCENE, ["membrane.strain_max=0.5", "lifetime=1e6"]))
    assert value(result, "limited_by") == "stress"
    thick = wo.run(load_scene(SCENE, ["lifetime=1.2e8", "contact_strain=0.1"]))
    assert [text.split()[1] for text in thick.trust["warnings"]] == ["wall", "contact_strain"]
    soft = wo.run(load_scene(SCENE, ["membrane.youngs_modulus=1e5", "membrane.strain_max=0.5"]))
    assert any("not small" in text for text in soft.trust["warnings"])


def test_a_wrong_answer_fails(monkeypatch: pytest.MonkeyPatch):
    right = Choice.widest

    def wrong(self: Choice, *given: Any, **limits: float) -> tuple[float, float]:
        thickness, _ = right(self, *given, **limits)
        return 1.001 * thickness, 0.0

    monkeypatch.setattr(Choice, "widest", wrong)
    result = wo.run(SCENE)
    assert result.status == "failed"
    assert "differs by 0.001" in result.reason
    assert failed_checks(result) == ["thickness in closed form"]


test_wrong_scenes_are_told = refusals(
    SCENE,
    """
    units="dimensionless" | units | write units = "SI"
    thickness=[1e-3, 1e-4] | thickness | smaller number first
    thickness=[1e-3, 1e-2] | thickness[1] | membrane.radius
    """,
)


@pytest.mark.slow
def test_the_picture(tmp_path: Path):
    result = wo.run(SCENE)
    labels = [text.get_text() for text in figure(result, "membrane").legends[0].get_texts()]
    assert "best: 0.197 mm" in labels
    out = tmp_path / "out"
    assert main(["run", SCENE, "-o", str(out), "--quiet", "--set", "loss_max=0.001"]) == 3
    assert (out / "membrane.png").stat().st_size > 10_000


def test_limits_that_mean_none():
    result = wo.run(load_scene(SCENE, ["membrane.strain_max=1e30", "lifetime=1e-30"]))
    exact = by_hand(1e-30, {"loss": 0.1, "strain": 1e30})
    for name, thickness in exact.items():
        assert value(result, f"thickness_for_{name}") == pytest.approx(thickness, rel=1e-12)


def test_every_limit_that_no_thickness_meets_is_named():
    with pytest.raises(SolveError) as caught:
        wo.run(load_scene(SCENE, ["fluid.pressure=1e9"]))
    assert "raise membrane.stress_max and membrane.strain_max" in caught.value.suggestion
