"""What a notebook shows: a line or two, a table that no text can break, a picture."""

from typing import Any

import numpy as np
import pytest
from matplotlib.figure import Figure
from report_pages import Whole
from slides import LINE, slide

import wormopt as wo
from wormopt.quantities import Scalar, Variable
from wormopt.result import Check, Result
from wormopt.shown import brief, line, whole_lists

HOSTILE = '<script>alert("λ")</script>\n\x1b[31m & </table>'


def hostile() -> Result:
    time = Variable("time", "s", ("time",), np.linspace(0, 1, 5000), "time")
    many = {f"number_{k}": Scalar(k / 3, "m") for k in range(60)}
    words = {HOSTILE: Scalar(HOSTILE), "much": Scalar(list(range(5000))), "lost": Scalar(None)}
    trust = {
        "warnings": [HOSTILE],
        "checks": {HOSTILE: Check(HOSTILE, 2.0, 1.0, HOSTILE).found()},
        "recheck": {"route": HOSTILE, "error": 1.0},
        "violations": {HOSTILE: 1.0},
    }
    more: dict[str, Any] = {"trust": trust, "attributes": {"trackers": [HOSTILE] * 3}}
    more |= {"status": "failed", "reason": HOSTILE * 20, "scalars": words | many}
    return Result(HOSTILE, "gait", title=HOSTILE, variables=(time,), **more)


def optimum() -> wo.Optimum:
    """The shortest slide, coarsely."""
    mesh = wo.Mesh.even(1, 20, wo.Collocation(2))
    return wo.optimise(slide(), mesh, wo.Complementarity(residual=1e-3, first=1e-1), LINE)


@pytest.fixture(scope="module")
def things() -> dict[str, Any]:
    """One of everything that a notebook shows."""
    limits = wo.Limits(period=1.0, length=(0.7, 1.3), rate=1.0, acceleration=20.0)
    design = wo.design(wo.Worm(links=1, load=5.0), limits)
    proof, result = wo.certify(design), wo.run("fast_gait")
    springs = {"stiffness": 50.0, "damping": 1.0, "rest_length": 1.0}
    model = wo.chain(40, mass=1.0, **springs, law=wo.Coulomb(1.0, 2.0), velocity=1.0)
    found = optimum()
    return {
        "hostile result": hostile(),
        "empty result": Result("nothing", "gait"),
        "result": result,
        "scene": wo.load_scene("design_fast_gait"),
        "study": wo.load("fig27_float"),
        "design": design,
        "certified": proof,
        "certificate": proof.certificate,
        "sensitivities": wo.sensitivities(design),
        "sensitivity": wo.sensitivities(design)[0],
        "trust": result.trust,
        "variable": result["length"],
        "gait": design.gait,
        "linear": wo.linearise(model, output="length", v_reg=0.1),
        "crawl": design.motion,
        "model": model,
        "trajectory": wo.simulate(model, 0.1),
        "ensemble": wo.simulate_ensemble(model, 0.1, [wo.Scenario(), wo.Scenario()]),
        "optimum": found,
        "motion": found.motion,
    }


SHOWN = {
    "hostile result": "Result of <script>",
    "empty result": "Result of nothing (gait): ok; 0 variables",
    "result": "speed 1.2, period 1",
    "scene": "Scene design_fast_gait (gait-design): Fast gait of a three-mass worm",
    "study": "Float fig27_float: A travelling wave",
    "design": "Design: 2 masses, speed 0.425, period 1 (proven)",
    "certified": "Certified design: 2 masses, speed 0.425",
    "certificate": "Certificate: no gait is faster than 0.425",
    "sensitivities": "Sensitivities to 8 limits",
    "sensitivity": "Sensitivity to limits.period = 1: derivative 0.075, elasticity 0.176",
    "variable": "Variable length(link, time): link length",
    "gait": "Gait: period 1, links 1",
    "linear": "LinearModel chain of 40 links: 82 states, 40 inputs, 40 outputs",
    "crawl": "Crawl of 2 masses (speed 0.425, at rest [[0], [1]]): time 0 to 1",
    "model": "Model chain of 40 links: states position[41], velocity[41]",
    "trajectory": "Trajectory of chain of 40 links (exact, native; ",
    "ensemble": "Ensemble of 2 motions, 0 of them not to the end",
    "optimum": "Optimum: objective 1.22",
    "motion": "Motion of block (20 arcs in 1 phases): time 0 to 1.22",
}


@pytest.mark.compiled
@pytest.mark.parametrize("name", SHOWN)
def test_a_repr_is_a_line_or_two(things: dict[str, Any], name: str):
    shown = repr(things[name])
    assert len(shown.splitlines()) <= 2
    assert all(len(each) <= 100 for each in shown.splitlines())
    assert shown.replace("\n", "").isprintable()
    assert SHOWN[name] in shown


@pytest.mark.parametrize(
    "name",
    [
        "hostile result", "empty result", "result", "trust", "variable", "design", "gait",
        "sensitivities", "certificate", "linear", "crawl", "trajectory", "optimum",
    ],
)  # fmt: skip
def test_a_table_is_whole_and_harmless(things: dict[str, Any], name: str):
    text = things[name]._repr_html_()
    read = Whole(text)
    tags = {*read.names}
    assert tags == {"table", "caption", "b", "tr", "td"} | tags & {"th", "i"}
    assert read.attributes <= {"style", "colspan"}
    assert read.holders <= {"td", "th", "b", "i"}
    assert len(text) < 30_000
    assert "#" not in text.partition(">")[0]  # no colour of its own, for light pages or dark


def test_texts_stand_in_a_table_as_they_are():
    read = Whole(hostile()._repr_html_())
    assert "<script" not in hostile()._repr_html_()
    assert HOSTILE in read.words  # the title
    assert "unknown" in read.words
    assert any(text.endswith("…], 5000 in all") for text in read.words)


@pytest.mark.parametrize("picture", ["gait", "motion", "spikes"])
def test_a_design_is_drawn(things: dict[str, Any], picture: str):
    figure = things["design"].plot(picture)
    labels = [axes.get_xlabel() + axes.get_ylabel() for axes in figure.axes]
    assert any("time" in label for label in labels)
    with pytest.raises(wo.ArgumentError, match="picture"):
        things["design"].plot("limits")


def test_a_design_moves(things: dict[str, Any]):
    drawn = things["design"].plot("animation")
    circles = [line for line in drawn.axes[0].lines if line.get_marker() == "o"]
    assert len(circles) == 2
    assert drawn.moves.frames > 2


@pytest.mark.parametrize(
    ("value", "shown"),
    [
        (None, "unknown"),
        ([], "none"),
        (1 / 3, "0.333333"),
        (123456, "123456"),
        (True, "true"),
        ([None, 0.5], "[unknown, 0.5]"),
        ([[1], [2, 3]], "[[1], [2, 3]]"),
        (["a, b", "c"], '["a, b", "c"]'),
        (["a", "c"], "[a, c]"),
        (
            [[0, 1, 2, k] for k in range(9)],
            "[[0, 1, 2, 0], [0, 1, 2, 1], [0, 1, 2, 2], …], 9 in all",
        ),
        (list(range(100)), "[0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, …], 100 in all"),
        ([[float(k), None] for k in range(100)], "100 × 2 entries, 0 to 99"),
        (["x" * 100] * 2, "[…], 2 in all"),
        ("a\nb" + "c" * 100, "a b" + "c" * 56 + "…"),
    ],
)
def test_values_in_short(value: Any, shown: str):
    assert brief(value) == shown
    assert len(shown) <= 60


def test_lists_are_named_once_where_all_their_entries_are_named():
    names = ["a.b", "c[0]", "c[1]", "d[0].low", "d[0].high", "d[1].low", "d[1].high"]
    assert whole_lists(["c[1]", "a.b"], names) == ["c[1]", "a.b"]
    given = ["a.b", "c[0]", "c[1]", "d[0].low", "d[1].low"]
    assert whole_lists(given, names) == ["a.b", "c", "d.low"]


def test_a_line_holds_no_control_characters():
    assert line("a\x1b[31m\n\tb\u202e") == "a [31m b"


def test_a_result_draws_what_its_scene_wants_first(things: dict[str, Any]):
    result = things["result"]
    drawn = result.plot()
    assert isinstance(drawn, Figure)
    wanted = wo.load_scene("fast_gait").table.want
    assert len(wanted) > 1
    sizes = {name: len(result.plot(name).axes) for name in ("gait", "motion")}
    assert len(drawn.axes) == sizes[wanted[0]]
    with pytest.raises(ValueError, match="no picture 'nonsense' of kind gait; there are: gait"):
        result.plot("nonsense")


@pytest.mark.parametrize("name", ["crawl", "motion", "optimum"])
def test_a_motion_draws_its_signals(things: dict[str, Any], name: str):
    found = things[name]
    motion = found.motion if name == "optimum" else found
    panels = found.plot().axes
    rests = "resting" in motion.names  # in a band below
    assert len(panels) == min(len(motion.names), 8) + rests
    for axes, signal in zip(panels[:8], motion.names, strict=False):
        rows = np.atleast_2d(motion[signal])
        assert len(axes.lines) == len(rows)
        for drawn, row in zip(axes.lines, rows, strict=True):
            assert np.array_equal(np.asarray(drawn.get_ydata()), row)
            assert np.array_equal(np.asarray(drawn.get_xdata()), motion.time)
    if rests:
        shown = [path.get_extents() for c in panels[-1].collections for path in c.get_paths()]
        for mass, row in enumerate(motion["resting"]):
            own = sum(box.width for box in shown if box.y0 < mass < box.y1)
            assert own == pytest.approx(np.trapezoid(row, motion.time), abs=0.01)


def test_signals_are_drawn_by_name(things: dict[str, Any]):
    drawn = things["trajectory"].plot("velocity", "position")
    assert [axes.get_ylabel() for axes in drawn.axes] == ["velocity", "position"]
    assert len(drawn.axes[0].lines) == 41
    with pytest.raises(wo.UnknownNameError, match="'nonsense'"):
        things["motion"].plot("nonsense")


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore::DeprecationWarning", "ignore::ResourceWarning")
def test_a_notebook_runs():
    nbformat, nbclient = (pytest.importorskip(name) for name in ("nbformat", "nbclient"))
    cells = [
        "import wormopt as wo\nresult = wo.run('fast_gait')\nresult",
        "result.plot('gait')",
        "result.to_dataframe()[['length_0', 'length_1']].loc[0.5]",
        "float(result.to_xarray()['rate'].sel(link=0, time=0.5, method='nearest'))",
    ]
    book = nbformat.v4.new_notebook(cells=[nbformat.v4.new_code_cell(cell) for cell in cells])
    nbclient.NotebookClient(book, timeout=120, kernel_name="python3").execute()
    shown = [cell.outputs[-1].data for cell in book.cells]
    assert Whole(shown[0]["text/html"]).words[0] == "Fast gait (15) of a three-mass worm"
    assert shown[0]["text/plain"].startswith("Result of fast_gait (gait): ok")
    assert "image/png" in shown[1]
    assert "length_0" in shown[2]["text/plain"]
    # (15) with l0 = 2, e = 0.15, at t = 1/2: link 0 contracts at its fastest
    rate = 2 * 0.15 * 3 * np.pi * np.sin(1.5 * np.pi)
    assert float(shown[3]["text/plain"]) == pytest.approx(rate, rel=1e-4)
