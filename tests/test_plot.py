"""Pictures: written whole, labelled with units, honest about failure, legible for every n."""

import dataclasses
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from PIL import Image

from wormopt.plot import PICTURES, draw, figure
from wormopt.plot.parts import stretches
from wormopt.result import Result, Scalar, Variable

UNITS = {
    "time": "s",
    "length": "m",
    "rate": "m s-1",
    "position": "m",
    "reaction": "N",
    "reaction_mean": "N",
    "sigma": "N",
    "actuator_force": "N",
}


def shuffle(links: int, units: bool = True) -> Result:
    """A worm whose masses rest one after another, tail first, and which glides at the end."""
    masses, phases = links + 1, links + 2
    time = np.concatenate([np.linspace(p, p + 1, 9) for p in range(phases)]) / phases
    phase = np.repeat(np.arange(phases), 9)
    resting = np.array([phase == masses - 1 - i for i in range(masses)]).astype(int)
    rate = np.array([resting[j] - resting[j + 1] for j in range(links)])
    arrays = {
        "time": time,
        "resting": resting,
        "length": 1 + 0.2 * np.array([np.sin(2 * np.pi * time + j) for j in range(links)]),
        "rate": rate,
        "position": 0.6 * time - np.arange(masses)[:, None],
        "reaction": 9.0 * resting,
        "reaction_mean": 9.0 * resting.sum(axis=0) / masses,
        "sigma": 10 * np.cos(phase),
        "actuator_force": 4.0 * rate,
    }
    variables = tuple(
        Variable(name, UNITS.get(name, "1") if units else "1", dims_of(values, links), values)
        for name, values in arrays.items()
    )
    scalars = {
        "speed": Scalar(0.6, "m s-1"),
        "length_limits": Scalar([0.7, 1.3]),
        "rate_limit": Scalar([1.5] * links),
        "spike_load_limit": Scalar(12.0),
        "actuator_force_limit": Scalar(5.0),
    }
    return Result("shuffle", "gait", "Größe λ — 1 $", scalars=scalars, variables=variables)


def dims_of(values: np.ndarray, links: int) -> tuple[str, ...]:
    return ("time",) if values.ndim == 1 else ("link" if len(values) == links else "mass", "time")


def front() -> Result:
    columns = {"front_speed": [0.5, 0.3, 0.7], "front_value": [12.0, 9.0, 20.0]}
    variables = [Variable(name, "N", ("point",), np.array(v)) for name, v in columns.items()]
    variables.append(Variable("front_accepted", "1", ("point",), np.array([1, 1, 0])))
    scalars = {"front_objective": Scalar("peak_spike_load"), "ceiling": Scalar(1.0)}
    return Result("front", "gait-pareto", "", scalars=scalars, variables=tuple(variables))


def sample(picture: str) -> Result:
    return front() if picture == "front" else shuffle(2)


def texts(drawn: Figure) -> str:
    titles = [axes.get_title(loc="left") for axes in drawn.axes]
    return " ".join([drawn.get_suptitle(), *titles]).replace("\n", " ")


@pytest.mark.parametrize("picture", sorted(PICTURES.keys() - {"animation"}))
def test_every_picture_is_written(picture: str, tmp_path: Path):
    path = tmp_path / f"{picture}.png"
    draw(sample(picture), picture, path)
    with Image.open(path) as image:
        assert min(image.size) > 500
        assert len(image.convert("RGB").getcolors(1_000_000) or []) > 20
    assert list(tmp_path.iterdir()) == [path]


@pytest.mark.parametrize("links", range(1, 9))
def test_pictures_for_every_number_of_links(links: int):
    for picture in ("gait", "motion", "spikes", "animation"):
        drawn = figure(shuffle(links), picture)
        drawn.draw_without_rendering()
        assert drawn.axes


@pytest.mark.parametrize("picture", PICTURES)
def test_axes_carry_symbols_and_units(picture: str):
    drawn = figure(sample(picture), picture)
    assert drawn.axes[-1].get_xlabel().endswith(")")
    assert "$" in drawn.axes[-1].get_xlabel()
    labelled = [axes.get_ylabel() for axes in drawn.axes if len(axes.get_yticks())]
    assert all(labelled)
    bare = figure(shuffle(2, units=False), "gait")
    assert bare.axes[0].get_ylabel() == "link length $l_j$"


def test_units_are_raised():
    assert figure(shuffle(2), "gait").axes[1].get_ylabel() == r"rate $\dot l_j$ (m s$^{-1}$)"


def test_limits_are_thin_dashed_lines():
    lengths, rates, _ = figure(shuffle(2), "gait").axes
    for axes, limits in ((lengths, {0.7, 1.3}), (rates, {-1.5, 1.5})):
        dashed = [line for line in axes.get_lines() if line.get_linestyle() == "--"]
        assert {float(np.ravel(line.get_ydata())[0]) for line in dashed} == limits
    scalars = {
        "length_limits": Scalar([[0.7, 1.3], [0.6, 1.4]]),
        "rate_limit": Scalar([[1.0, 1.2], [2.0, 2.2]]),
    }
    apart = figure(dataclasses.replace(shuffle(2), scalars=scalars), "gait")
    for axes, limits in (
        (apart.axes[0], [0.7, 1.3, 0.6, 1.4]),
        (apart.axes[1], [-1, 2, -1.2, 2.2]),
    ):
        dashed = [line for line in axes.get_lines() if line.get_linestyle() == "--"]
        assert [float(np.ravel(line.get_ydata())[0]) for line in dashed] == limits
    without = figure(dataclasses.replace(shuffle(2), scalars={}), "gait")
    assert len(without.axes[0].get_lines()) == 2


def test_motion_shows_two_periods_and_the_masses_at_rest():
    (axes,) = figure(shuffle(2), "motion").axes
    heavy = [c for c in axes.collections if isinstance(c, LineCollection)]
    spans = [
        [np.asarray(path.vertices)[:, 1].tolist() for path in lines.get_paths()] for lines in heavy
    ]
    assert spans[:3] == [[[0.5, 0.75]], [[0.25, 0.5]], [[0.0, 0.25]]]
    assert spans[3:] == [[[1.5, 1.75]], [[1.25, 1.5]], [[1.0, 1.25]]]
    assert np.ravel(axes.get_lines()[3].get_xdata())[0] == pytest.approx(0.6)


def test_failed_results_are_marked():
    failed = dataclasses.replace(sample("gait"), status="failed", reason="spike_load is too low")
    for picture in ("gait", "motion", "spikes", "animation"):
        assert "failed: spike_load is too low" in texts(figure(failed, picture))
        assert "failed" not in texts(figure(shuffle(2), picture))


def test_a_front_shows_what_was_not_accepted_hollow():
    (axes,) = figure(front(), "front").axes
    good, bad, _ = axes.get_lines()
    assert np.asarray(good.get_xdata()).tolist() == [0.3, 0.5]
    assert np.asarray(bad.get_xdata()).tolist() == [0.7]
    assert bad.get_markerfacecolor() == "none"
    assert axes.get_ylabel() == r"largest load on a spike, max $\lambda_i$ (N)"


def test_missing_variables_are_named_and_leave_no_file(tmp_path: Path):
    result = Result("walk", "gait", variables=(Variable("time", "s", ("time",), np.arange(2.0)),))
    with pytest.raises(KeyError, match="resting, length, rate") as caught:
        draw(result, "gait", tmp_path / "gait.png")
    assert "'gait'" in caught.value.__notes__[0]
    with pytest.raises(ValueError, match="no picture 'portrait'; there are gait, motion"):
        draw(result, "portrait", tmp_path / "portrait.png")
    assert list(tmp_path.iterdir()) == []


def test_a_picture_that_cannot_be_written_leaves_the_old_one(tmp_path: Path):
    path = tmp_path / "front.unknown"
    path.write_text("old")
    with pytest.raises(ValueError, match="unknown"):
        draw(front(), "front", path)
    assert path.read_text() == "old"
    assert list(tmp_path.iterdir()) == [path]


def test_the_animation_moves(tmp_path: Path):
    path = tmp_path / "animation.gif"
    draw(shuffle(2), "animation", path)
    assert path.stat().st_size < 2_000_000
    with Image.open(path) as film:
        assert getattr(film, "n_frames", 1) > 40
        first = np.asarray(film.convert("RGB"))
        film.seek(20)
        assert (np.asarray(film.convert("RGB")) != first).any()
    assert list(tmp_path.iterdir()) == [path]


def test_letters_without_a_glyph_do_no_harm(tmp_path: Path):
    draw(dataclasses.replace(front(), title="蠕虫 λ"), "front", tmp_path / "front.png")
    assert (tmp_path / "front.png").stat().st_size > 1000


def test_no_pyplot_state():
    code = "import sys, wormopt.plot; sys.exit('matplotlib.pyplot' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


def test_stretches():
    time = np.array([0.0, 1.0, 1.0, 2.0, 3.0])
    holds = np.array([True, True, False, True, True])
    assert stretches(time, holds) == [(0.0, 1.0), (2.0, 3.0)]
    assert stretches(time, np.array([False, True, True, False, False])) == []
