"""Strokes that turn back: where all rates of the shape pass through 0 the motion has a kink."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from effort import examples
from hints import Patch
from hypothesis import assume, given, settings
from hypothesis import strategies as st

import wormopt as wo
from wormopt.errors import SolveError
from wormopt.model.planar_friction import Elliptic
from wormopt.systems.planar.crawling.crawl import Course
from wormopt.systems.planar.crawling.velocity import Crawler

P = wo.planar


def _turns(cosine: np.ndarray, sine: np.ndarray) -> np.ndarray:
    """Phases at which a sum of harmonics of one variable turns back, by roots of a polynomial."""
    orders = np.arange(1, len(cosine) + 1)
    up = 0.5 * 1j * orders * (cosine - 1j * sine)  # of exp(i h 2 pi tau) in the derivative
    roots = np.roots(np.concatenate([up[::-1], [0], up.conj()]))
    on = roots[np.abs(np.abs(roots) - 1) < 1e-6]
    return np.sort(np.angle(on) / (2 * np.pi) % 1)


def _work(turns: np.ndarray) -> float:
    """Work of two links of length 1 on even ground of resistance 1, by the angles it turns at.

    The mirrored body moves along its bisector. With x = |phi| / 2 the middle mass goes at
    sin x / (2 sqrt 3) - cos x / 2 per rate of the angle, and |v| + 2 |v_end| is cos(x - pi / 3).
    """

    def whole(phi: float) -> float:
        return float(np.sign(phi) * 2 * (np.sin(abs(phi) / 2 - np.pi / 3) + np.sin(np.pi / 3)))

    heights = np.array([whole(phi) for phi in turns])
    return float(np.abs(np.diff(np.append(heights, heights[0]))).sum())


def _scene(body: dict[str, Any], ground: dict[str, Any], stroke: dict[str, Any]) -> dict[str, Any]:
    return {"schema": 1, "kind": "planar-crawl", "body": body, "ground": ground, "stroke": stroke}


@pytest.mark.slow
def test_the_scene_of_a_single_joint_is_accepted():
    stroke = {"course": "harmonic", "mean": [0.3], "cosine": [[0.5]], "sine": [[0.1]]}
    result = wo.run(_scene({"links": 2, "lengths": 1.0}, {"forward": 1.0}, stroke))
    known = _work(np.array([0.3 - np.sqrt(0.26), 0.3 + np.sqrt(0.26)]))
    assert result.status == "ok", result.reason
    assert result["work"].value == pytest.approx(known, rel=1e-11)
    assert result["actuator_work"].value == pytest.approx(known, rel=1e-8)


@pytest.mark.slow
@settings(max_examples=examples(6))
@given(st.integers(0, 2**32 - 1), st.integers(1, 3))
def test_work_of_two_equal_links_is_that_of_the_angles_they_turn_at(seed: int, orders: int):
    rng = np.random.default_rng(seed)
    cosine, sine = rng.uniform(-0.5, 0.5, (2, orders)) / np.arange(1, orders + 1)
    stroke = P.Harmonics([rng.uniform(-0.3, 0.3)], cosine[:, None], sine[:, None])
    shape = P.chain_shape(2, lengths=(1.0, 1.0))
    found = P.crawl(shape, Elliptic(1.0, 1.0, 1.0), stroke)
    turns = _turns(cosine, sine)
    assert found.work == pytest.approx(_work(stroke.at(turns)[0][:, 0]), rel=1e-10)
    assert found.displacement == pytest.approx(np.zeros(3), abs=1e-10)


@pytest.mark.parametrize(
    "aside", [2e-4, *(pytest.param(each, marks=pytest.mark.slow) for each in (1e-3, 1e-5))]
)
def test_a_kink_between_a_node_and_the_end_of_its_panel_is_seen(aside: float, monkeypatch: Patch):
    """No root tells of this one, and Gauss' nodes are too far from the end to feel it."""
    monkeypatch.setattr(Course, "breaks", property(lambda course: course.stroke.breaks))
    angle = 2 * np.pi * aside
    stroke = P.Harmonics([1.0], cosine=[[0.5 * np.cos(angle)]], sine=[[0.5 * np.sin(angle)]])
    shape = P.chain_shape(2, lengths=(1.0, 1.0))
    found = P.crawl(shape, Elliptic(1.0, 1.0, 1.0), stroke, samples=32)
    assert found.work == pytest.approx(_work(np.array([0.5, 1.5])), rel=1e-11)


@given(st.integers(0, 2**32 - 1))
def test_joints_in_step_turn_back_together(seed: int):
    """All joints follow one course: breaks are its turns; joints out of step have none."""
    rng = np.random.default_rng(seed)
    cosine, sine = rng.uniform(-0.5, 0.5, (2, 3)) / np.arange(1, 4)
    ratios = rng.uniform(0.2, 1.0, 2) * rng.choice([-1, 1], 2)
    together = P.Harmonics([0.1, 0.2], np.outer(cosine, ratios), np.outer(sine, ratios))
    crawler = Crawler.of(P.chain_shape(3, lengths=(1.0,) * 3), Elliptic(1.0, 1.0, 3.0), (0, 0, 0))
    breaks = Course(crawler, together).breaks
    turns = _turns(cosine, sine)
    assume(np.diff(turns, prepend=turns[-1] - 1).min() > 0.005)
    assert breaks[1:-1] == pytest.approx(turns[(turns > 1e-6) & (turns < 1 - 1e-6)], abs=1e-9)
    circle = P.Harmonics([0.0, 0.0], cosine=[[1.0, 0.0]], sine=[[0.0, 1.0]])
    assert Course(crawler, circle).breaks.tolist() == [0.0, 1.0]


def _drawn(seed: int) -> dict[str, Any]:
    """Two to four links on ground of four sorts, by strokes of three sorts."""
    rng = np.random.default_rng(seed)
    n, orders = int(rng.integers(2, 5)), int(rng.integers(1, 4))
    lengths = rng.uniform(0.5, 1.5, n).tolist() if rng.random() < 0.7 else 1.0
    names = (("forward",), ("forward", "sideways"), ("forward", "backward", "sideways"))
    sort, numbers = int(rng.integers(0, 4)), rng.uniform(0.5, 3, (3, n + 1))
    each = zip(("forward", "backward", "sideways"), numbers, strict=True)
    ground = {name: row.tolist() for name, row in each if sort and name in names[sort - 1]}
    size = 0.6 / np.arange(1, orders + 1)[:, None]
    cosine, sine = rng.uniform(-1, 1, (2, orders, n - 1)) * size
    if rng.random() < 0.25:  # all joints turn back together
        sine = cosine * rng.uniform(-1, 1)
    stroke = {
        "course": "harmonic", "mean": rng.uniform(-0.8, 0.8, n - 1).tolist(),
        "cosine": cosine.tolist(), "sine": sine.tolist(),
    }  # fmt: skip
    if rng.random() < 0.25:
        corners = rng.uniform(-1.2, 1.2, (int(rng.integers(2, 6)), n - 1))
        stroke = {"course": "polygon", "corners": corners.tolist()}
    return _scene({"links": n, "lengths": lengths}, ground or {"forward": 1.0}, stroke)


@pytest.mark.slow
@pytest.mark.parametrize(
    "tens", [pytest.param(k, marks=[pytest.mark.many] * (k > 1)) for k in range(20)]
)
def test_no_right_crawl_is_refused(tens: int):
    for seed in range(10 * tens, 10 * tens + 10):
        try:
            result = wo.run(_drawn(seed))
        except SolveError as error:  # equal links, through a part of the stroke
            if "the motion is not unique" not in error.reason:
                raise
            continue
        assert result.status == "ok", (seed, result.reason)


@pytest.mark.slow
def test_an_instant_at_which_the_motion_is_open_does_not_refuse_a_stroke():
    """Three equal links straighten in front: there, and only there, other velocities do as well."""
    stroke = {
        "course": "harmonic",
        "mean": [-0.6755160025112188, 0.5425420988651222],
        "cosine": [
            [-0.5761965718304626, -0.5731153141711082],
            [0.2618950007529099, 0.282102873143179],
            [0.14347774733249058, 0.07616529130279415],
        ],
        "sine": [
            [-0.41113560589511255, 0.48904226430313946],
            [0.002895223809581182, 0.12021084480911748],
            [-0.1907001224027438, -0.15299421503604618],
        ],
    }
    ground = {"forward": 2.1778577587514123, "sideways": 2.1703146339678083}
    result = wo.run(_scene({"links": 3, "lengths": 1.0}, ground, stroke))
    assert result.status == "ok", result.reason
