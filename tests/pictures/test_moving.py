"""Animations of films and worms: what each frame shows, against the result."""

from typing import Any

import numpy as np
import pytest
from drawn import sample
from matplotlib.figure import Figure
from matplotlib.patches import Polygon, Rectangle

import wormopt as wo
from wormopt.pictures import figure, worms
from wormopt.quantities import Variable
from wormopt.result import Result
from wormopt.systems.coils import pictures as coils
from wormopt.systems.film import pictures as film


def shown(drawn: Figure, moves: Any, frame: int) -> tuple[list[float], np.ndarray, np.ndarray]:
    """Middles of the coils that are on, the surface (2, n), and the outline (2, m) of the body."""
    moves.show(drawn, frame)
    axes = drawn.axes[0]
    fresh = [patch for patch in axes.patches if patch.get_gid() != "stays"]
    boxes = [patch for patch in fresh if isinstance(patch, Rectangle)]
    surface = np.asarray(next(p for p in fresh if isinstance(p, Polygon)).get_xy())[:-5]
    (body,) = axes.collections
    outline = np.asarray(body.get_paths()[0].vertices)
    return [box.get_x() + box.get_width() / 2 for box in boxes], surface.T, outline.T


@pytest.mark.parametrize("frame", [0, 50, 143])
def test_a_film_over_coils_moves_with_its_float_and_the_coils_that_are_on(frame: int):
    result = sample("cargo")
    drawn, moves = figure(result, "animation", width=85), coils.animation
    on, surface, body = shown(drawn, moves, frame)
    time = result["time"].values
    now = time[-1] * frame / 143
    k = int(np.flatnonzero(time <= now + 1e-12)[-1])
    lit = result["coil_place"].values[result["current"].values[k] > 0]
    assert on == pytest.approx((1e3 * lit).tolist())
    assert np.allclose(surface[0], 1e3 * result["x"].values)
    heights = [np.interp(now, time, column) for column in result["thickness"].values.T]
    assert np.allclose(surface[1], 1e3 * np.array(heights))
    middle = 1e3 * np.interp(now, time, result["float_position"].values)
    size = result.attributes["float"]
    assert body[0].min() == pytest.approx(middle - 500 * size["length"])
    assert body[0].max() == pytest.approx(middle + 500 * size["length"])
    below = np.interp(body[0], *surface)
    thick = 1e3 * size["thickness"]
    assert np.allclose(np.minimum(abs(body[1] - below), abs(body[1] - below - thick)), 0, atol=0.02)
    assert f"{now:.2f} s" in drawn.axes[0].texts[-1].get_text()


@pytest.mark.parametrize("frame", [0, 60])
def test_a_body_in_a_wave_moves_with_the_film(frame: int):
    result = sample("carried")
    drawn, moves = figure(result, "animation", width=85), film.animation
    _, surface, body = shown(drawn, moves, frame)
    wavelength, speed = (result.scalars[name].value for name in ("wavelength", "wave_speed"))
    now = result["time"].values[0] + 4 * wavelength / speed * frame / 144
    middle = np.interp(now, result["time"].values, result["position"].values) / wavelength
    assert (body[0].min() + body[0].max()) / 2 == pytest.approx(middle)
    assert (body[1].min(), body[1].max()) == pytest.approx((0.0, result.attributes["height"]))
    # the crest is where the phase omega t - k x is that of the largest height
    crest = result["xi"].values[np.argmax(result["height"].values)] / (2 * np.pi)
    at = surface[0][np.argmax(surface[1])]
    off = (now * speed / wavelength - at - crest + 0.5) % 1 - 0.5
    assert abs(off) <= np.diff(surface[0]).max()


def test_a_film_without_a_float_moves_alone():
    result = sample("coil_film")
    assert "float_position" not in result
    drawn = figure(result, "animation", width=85)
    coils.animation.show(drawn, 100)
    assert len(drawn.axes[0].collections) == 0


def test_the_field_that_makes_the_wave_is_drawn_below_it():
    result: Result = sample("floats")
    drawn = figure(result, "animation", width=85)
    film.animation.show(drawn, 30)
    patches = [patch for patch in drawn.axes[0].patches if patch.get_gid() != "stays"]
    areas = [np.asarray(patch.get_xy()) for patch in patches if isinstance(patch, Polygon)]
    below = [area for area in areas if area[:, 1].max() < 0]
    assert len(below) == 1
    assert below[0][:, 1].max() == pytest.approx(-0.1, abs=0.02)
    assert len(drawn.axes[0].collections) == len(result.attributes["lengths"])


def masses(drawn: Figure) -> list[tuple[float, float, bool]]:
    """Places of the masses, and whether they are filled, of the frame that is shown."""
    circles = [line for line in drawn.axes[0].lines if line.get_marker() == "o"]
    return [
        (*line.get_xydata()[0].tolist(), line.get_markerfacecolor() != "white")  # type: ignore[index,union-attr]
        for line in circles
    ]


@pytest.mark.parametrize("frame", [0, 31, 77, 119])
def test_a_gait_moves_with_its_masses_at_rest_filled(frame: int):
    result = sample("certificate")
    drawn = figure(result, "animation", width=85)
    worms.animation.show(drawn, frame)
    time, x = result["time"].values, result["position"].values
    turn, t = divmod(2 * time[-1] * round(frame * 240 / 119) / 240, time[-1])
    if frame == 119:
        turn, t = 1, time[-1]
    expected = [np.interp(t, time, row) + turn * (row[-1] - row[0]) for row in x]
    found = masses(drawn)
    assert [place for place, _, _ in found] == pytest.approx(expected)
    rests = result["resting"].values[:, np.searchsorted(time, t, side="right") - 1] > 0
    assert [filled for _, _, filled in found] == rests.tolist()
    spikes = [line for line in drawn.axes[0].lines if line.get_marker() == "v"]
    assert len(spikes) == rests.sum()


def test_worms_side_by_side_have_their_own_ground():
    result = sample("trackers")
    drawn = figure(result, "animation", width=85)
    worms.animation.show(drawn, 119)
    expected = result["position"].values[..., -1]
    found = masses(drawn)
    heights = sorted({height for _, height, _ in found}, reverse=True)
    assert len(heights) == len(expected)
    for height, row in zip(heights, expected, strict=True):
        own = [place for place, at, _ in found if at == height]
        assert own == pytest.approx(row.tolist())
    assert {text.get_text() for text in drawn.axes[0].texts} >= {*result.attributes["trackers"]}


def test_the_ground_moves_under_a_worm_that_goes_far():
    time = np.linspace(0.0, 10.0, 501)
    x = np.stack([10 * time + 1, 10 * time])
    variables = (
        Variable("time", "1", ("time",), time),
        Variable("position", "m", ("mass", "time"), x, "position of the mass"),
    )
    drawn = figure(Result("far", "simulate", variables=variables), "animation")
    for frame in (0, 119):
        worms.animation.show(drawn, frame)
        assert [place for place, _, _ in masses(drawn)] == pytest.approx([0.5, -0.5])
        moving = [text for text in drawn.axes[0].texts if text.get_gid() is None]
        marks = [text for text in moving if text.get_position()[1] < -0.3]
        middle = 100 * frame / 119 + 0.5
        assert len(marks) >= 2
        for mark in marks:
            assert mark.get_position()[0] == pytest.approx(float(mark.get_text()) - middle)


def test_a_motion_that_was_not_computed_is_named():
    with pytest.raises(wo.UnknownNameError, match="position"):
        figure(Result("far", "simulate"), "animation")


@pytest.mark.parametrize("frame", [0, 40, 119])
def test_a_film_in_a_given_field_takes_its_thicknesses_in_turn(frame: int):
    result = sample("forward")
    drawn = figure(result, "animation", width=85)
    film.animation_of_film.show(drawn, frame)
    (area,) = [patch for patch in drawn.axes[0].patches if patch.get_gid() != "stays"]
    assert isinstance(area, Polygon)
    surface = np.asarray(area.get_xy())[:-5]
    time, xi = result["time"].values, result["xi"].values
    now = time[0] + (time[-1] - time[0]) * frame / 119
    heights = [np.interp(now, time, column) for column in result["thickness"].values.T]
    assert np.allclose(surface[:-1], np.column_stack([xi / np.pi, heights]))
    assert np.allclose(surface[-1], [2.0, heights[0]])
