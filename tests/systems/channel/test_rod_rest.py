"""The rod among the shapes of a segment: scenes "segment-shapes" with [rod]."""

from dataclasses import replace
from functools import lru_cache
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import pytest
from matplotlib.figure import Figure
from outcomes import refusals, value

import wormopt as wo
from wormopt.cli import main
from wormopt.errors import SolveError
from wormopt.pictures import figure
from wormopt.progress import silent
from wormopt.result import Check, Result
from wormopt.study import load_scene
from wormopt.systems.channel import rod_rest, segment_shapes
from wormopt.systems.channel.closed_forms import ChannelWorm
from wormopt.systems.channel.rod import Curve
from wormopt.systems.channel.tables import RodOverCoils


@lru_cache
def run(*changes: str) -> Result:
    return wo.run(load_scene("segment_shapes", changes))


def quick(*changes: str) -> Result:
    return run("rod.elements=24", "samples=401", *changes)


def fault(found: rod_rest.RodAtRest) -> str:
    return "; ".join(check.advice for check in found.checks() if not check.passed)


@lru_cache
def small() -> rod_rest.RodAtRest:
    return rod_rest.rest_of(ChannelWorm.of("sample-1"), RodOverCoils(elements=20), silent)


@pytest.mark.slow
def test_the_default_mesh_is_fine_enough():
    result = run()
    assert result.status == "ok"
    # what 96 elements give
    assert value(result, "arc_length")[-1] == pytest.approx(13.469e-3, abs=0.004e-3)
    assert value(result, "closest_distance_rod") == pytest.approx(0.98e-3, abs=0.002e-3)


@pytest.mark.slow
def test_which_assumed_shape_is_closest_to_the_rod():
    result = quick()
    assert result.status == "ok"
    assert value(result, "shapes")[-1] == "rod"
    assert value(result, "closest_shape_rod") == "sine"
    apart = result["distance_max"].values[-1]
    assert value(result, "closest_distance_rod") == pytest.approx(apart[0])
    assert apart[0] == pytest.approx(0.98e-3, abs=0.02e-3)
    assert apart[0] < apart[1] < apart[2]
    assert np.all(apart[3:5] < apart[0])  # elastica are nearer
    assert value(result, "arc_length")[-1] == pytest.approx(13.469e-3, abs=0.01e-3)
    # 13.469 is what 96 elements give
    assert value(result, "rod_arc_lengths") == pytest.approx([13.469e-3] * 2, abs=0.01e-3)
    trust = result.trust["rod"]
    assert trust["stable"]
    assert max(trust["residual"], trust["imbalance"]) < 1e-9
    assert "local minimum" in result.trust["assumptions"]["rod's rest"]


@pytest.mark.slow
def test_the_segment_is_the_rod_between_two_coils():
    result = quick()
    x, y = (result[name].values[-1] for name in "xy")
    assert (x[0], x[-1]) == pytest.approx((0.0, 10e-3), abs=1e-12)
    assert (y[0], y[-1]) == pytest.approx((2e-3, 9e-3), abs=1e-9)
    nodes_x, nodes_y = result["rod_x"].values, result["rod_y"].values
    inside = (nodes_x > 0) & (nodes_x < 10e-3)
    assert np.interp(nodes_x[inside], x, y) == pytest.approx(nodes_y[inside], abs=2e-6)
    polyline = np.hypot(np.diff(x), np.diff(y)).sum()
    assert value(result, "arc_length")[-1] == pytest.approx(polyline, rel=1e-4)
    for wall in ("upper", "lower"):
        forces = result[f"rod_force_{wall}_at"].values
        assert np.all(forces >= 0)
        assert value(result, f"rod_force_{wall}") == pytest.approx(forces.sum())
        height = 9e-3 if wall == "upper" else 2e-3
        assert nodes_y[forces > 0] == pytest.approx(height, abs=1e-12)
    assert value(result, "rod_preferred")
    assert value(result, "rod_energy") < value(result, "rod_energy_on_one_wall") < 0


def facts(drawn: Figure) -> str:
    told = " ".join(text.get_text() for text in drawn.texts)
    return told.replace("\n", " ").replace("\N{NO-BREAK SPACE}", " ")


@pytest.mark.slow
def test_weak_fields_do_not_bend_it_from_wall_to_wall():
    result = quick("rod.ampere_turns=1000")
    assert result.status == "ok"
    assert not value(result, "rod_reaches_walls")
    assert value(result, "closest_shape_rod") is None
    assert value(result, "closest_shape")[-1] is None
    assert value(result, "segments")[-1] is value(result, "velocity_per_frequency")[-1] is None
    assert "closest to rod: not from wall to wall" in facts(figure(result, "segment_shapes"))
    assert any("do not bend it from wall to wall" in text for text in result.trust["warnings"])


@pytest.mark.slow
def test_two_coils_and_other_sides_of_the_block():
    """A block of two coils has one segment, which falls; it is shown as one that rises."""
    result = quick("rod.on=2", "rod.every=6")
    y = result["y"].values[-1]
    assert (y[0], y[-1]) == pytest.approx((2e-3, 9e-3), abs=5e-5)
    assert len(value(result, "rod_arc_lengths")) == 1
    # what is on the upper and the lower side is alike
    upper, lower = (value(result, f"rod_force_{wall}") for wall in ("upper", "lower"))
    assert upper == pytest.approx(lower, rel=5e-3)
    x = result["x"].values[-1]
    assert x + x[::-1] == pytest.approx(10e-3, abs=2e-5)


@pytest.mark.slow
def test_a_sweep_over_the_field():
    result = quick("rod.sweep=[1000, 3000, 4600, 6000]")
    lengths = result["sweep_arc_length"].values
    assert np.isnan(lengths[0])
    assert np.all(np.diff(lengths[1:]) > 0)
    assert lengths[2] == pytest.approx(value(result, "arc_length")[-1], rel=2e-3)
    assert value(result, "sweep_closest_shape") == [None, "sine", "sine", "sine"]
    assert result["sweep_distance"].values.shape == (3, 4)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"softest": -1e-3}, "the rest is not stable"),
        ({"imbalance": 1e-3}, "not balanced, by 0.001 (imbalance)"),
        ({"residual": float("nan")}, "not balanced, by nan (residual)"),
    ],
)
def test_rests_of_a_sweep_that_are_not_to_be_trusted_are_left_out(
    change: dict[str, float], said: str, monkeypatch: pytest.MonkeyPatch
):
    found, starts = small(), []

    def spoilt(bench: Any, turns: float, start: np.ndarray) -> Any:
        starts.append(start)
        return replace(found.rest, **change) if turns == 5000 else found.rest

    monkeypatch.setattr(rod_rest._Bench, "at", spoilt)
    table = msgspec.structs.replace(found.table, sweep=(4600.0, 5000.0))
    line = Curve(0.01, lambda share: np.array([0.01 * share, 0 * share, 0 * share]))
    sweep = rod_rest.sweep_of(found.worm, table, {"line": line}, silent)
    (warning,) = sweep.left_out
    assert warning.startswith("rod.sweep: left out at 5000 ampere-turns: ")
    assert said in warning
    assert sweep.sweep_arc_length == pytest.approx([found.curve.length, np.nan], nan_ok=True)
    assert np.isfinite(sweep.sweep_distance).tolist() == [[True, False]]
    assert sweep.sweep_closest_shape == ["line", None]
    # nor does the next rest start from it
    assert np.array_equal(starts[0], starts[1])


def test_a_body_of_unknown_modulus_is_left_out():
    result = run('worm.sample="capsule"')
    assert "rod" not in value(result, "shapes")
    assert "rod_x" not in result
    assert any("worm.youngs_modulus" in text for text in result.trust["warnings"])


test_wrong_keys_are_told = refusals(
    "segment_shapes",
    """
    rod.inner_radius=9e-3 | rod.inner_radius | write less
    rod.outer_radius=11e-3 | rod.outer_radius | write at most 0.01
    rod.every=3 | rod.every | write at least 4
    rod.elements=10 | rod.elements | write at least 20
    rod.sweep=[5, 4] | rod.sweep | ascend
    worm.channel=1e-9 | worm.body | does not fit
    """,
)


@pytest.mark.slow
def test_a_body_that_does_not_reach_over_the_coils(tmp_path: Path, capsys: Any):
    changes = ["rod.elements=20", "worm.length=12e-3", "rod.ampere_turns=500"]
    sets = [word for change in changes for word in ("--set", change)]
    assert main(["run", "segment_shapes", "--quiet", "-o", str(tmp_path / "out"), *sets]) == 3
    told = capsys.readouterr().err
    assert "does not reach over the active coils" in told
    assert "rod.on" in told


@pytest.mark.slow
@pytest.mark.parametrize("turns", [1e5, 1e8])
def test_fields_that_crush_it_are_told(turns: float):
    with pytest.raises(SolveError, match=r"smaller rod\.ampere_turns") as caught:
        quick(f"rod.ampere_turns={turns}")
    assert caught.value.code in ("crushed", "no_rest", "not_balanced", "no_segment")


def test_what_is_not_to_be_trusted_says_so(monkeypatch: pytest.MonkeyPatch):
    found = small()
    assert fault(found) == ""
    assert "write more rod.elements" in fault(replace(found, mesh_change=0.01))
    loose = replace(found.rest, softest=-1e-9)
    assert "not stable" in fault(replace(found, rest=loose))
    off = replace(found.rest, imbalance=1e-3)
    assert "forces are not balanced, by 0.001 (imbalance)" in fault(replace(found, rest=off))
    slope = replace(found.rest, residual=2e-3, imbalance=1e-9)
    assert "forces are not balanced, by 0.002 (residual)" in fault(replace(found, rest=slope))
    made_up = Check("made up", 1.0, 0.0, "made up")
    monkeypatch.setattr(rod_rest.RodAtRest, "checks", lambda self: iter([made_up]))
    monkeypatch.setattr(segment_shapes, "rest_of", lambda *_: found)
    result = wo.run(load_scene("segment_shapes", ["samples=21"]))
    assert (result.status, result.reason) == ("failed", "made up")
    assert made_up in result.checks
