"""Fronts: every point's gait is kept, the table, the knee, jumps, and quick searches told."""

import json
from pathlib import Path

import numpy as np
import pytest

import wormopt as wo
from wormopt.cli import main
from wormopt.errors import ArgumentError, SceneError
from wormopt.families.store import Store
from wormopt.pictures import figure
from wormopt.result import Result, Variable
from wormopt.systems.spiked import gait_pareto

# Three orders: a pair of masses in turn at low speed, then the wave of three.
CHANGES = [
    "pareto.points=3", 'search.effort="quick"', "search.phases=3", "search.workers=1", "want=[]"
]  # fmt: skip


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Where the command line leaves a front."""
    at = tmp_path_factory.mktemp("front")
    sets = [part for change in CHANGES for part in ("--set", change)]
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(gait_pareto, "checkpoints", lambda: Store(at / "kept"))
        assert main(["run", "pareto_speed_load", "-o", str(at / "o"), "--quiet", *sets]) == 0
    return at / "o"


def crawled(gait):
    motion = wo.crawl(gait, [1.0, 1.0, 1.0], 0.0, 5.0)
    return motion.speed, motion.extremes("reaction")[1].max()


@pytest.mark.slow
def test_the_gait_of_every_point_is_read_back_and_does_what_the_front_says(folder: Path):
    result = Result.load(folder)
    count = len(result["front_speed"].values)
    assert count == 3
    for point in range(count):
        speed, load = crawled(wo.load_gait(folder, point=point))
        assert speed == pytest.approx(result["front_speed"].values[point], abs=1e-12)
        assert load == pytest.approx(result["front_value"].values[point], abs=1e-9)
    knee = result.scalars["front_knee"].value
    assert crawled(wo.load_gait(folder)) == crawled(wo.load_gait(folder, point=knee))


def test_what_is_no_point_is_refused(folder: Path, tmp_path: Path):
    for point in (3, -1):
        with pytest.raises(ArgumentError, match=rf"no point {point}; .*t has '0', '1', '2'"):
            wo.load_gait(folder, point=point)
    gait = wo.load_gait(folder)
    gait.to_csv(tmp_path / "gait.csv")
    with pytest.raises(ArgumentError, match="one gait; omit point"):
        wo.load_gait(tmp_path / "gait.csv", point=0)
    wo.run("fast_gait").save(tmp_path)
    with pytest.raises(ArgumentError, match="contains no front"):
        wo.load_gait(tmp_path, point=0)


def test_a_scene_takes_the_gait_of_a_point(folder: Path):
    def scene(point: int) -> wo.Scene:
        file = json.dumps(str(folder / "result.nc"))
        return wo.load_scene("fast_gait", [f'gait={{shape="file", file={file}, point={point}}}'])

    speeds = Result.load(folder)["front_speed"].values
    assert wo.run(scene(1)).scalars["speed"].value == pytest.approx(speeds[1], abs=1e-12)
    with pytest.raises(SceneError, match=r"gait\.point: .*no point 9"):
        wo.run(scene(9))


def test_the_summary_tells_the_front(folder: Path):
    told = json.loads((folder / "summary.json").read_text())
    scalars = {name: entry["value"] for name, entry in told["scalars"].items()}
    result = Result.load(folder)
    assert scalars["front_speeds"] == result["front_speed"].values.tolist()
    assert scalars["front_values"] == result["front_value"].values.tolist()
    assert scalars["front_counted"] == [True] * 3
    assert scalars["front_sequences"][-1] == [[0], [1], [2]]
    assert scalars["front_resting"] == [1] * 3
    assert "rate" in scalars["front_binding"][-1]
    assert scalars["speed"] == scalars["front_speeds"][scalars["front_knee"]]
    assert "table.md" in told["files"]


def test_the_table_is_printed_and_names_knee_and_jumps(
    folder: Path, capsys: pytest.CaptureFixture[str]
):
    from wormopt.cli.common import print_result

    result = Result.load(folder)
    print_result(result)
    table = (folder / "table.md").read_text()
    assert table in capsys.readouterr().out
    _, _, *rows = table.splitlines()
    knee, jumps = (result.scalars[name].value for name in ("front_knee", "front_jumps"))
    assert [k for k, row in enumerate(rows) if "knee" in row] == [knee]
    assert sum("new resting sequence" in row for row in rows) == jumps > 0
    assert [row.split("|")[1].strip() for row in rows] == ["0", "1", "2"]


def test_the_picture_joins_no_line_across_a_jump_and_marks_the_knee():
    columns = {
        "front_speed": [0.2, 0.4, 0.6, 0.8],
        "front_value": [1.0, 2.0, 5.0, 9.0],
        "front_accepted": [1, 1, 1, 1],
        "front_order": [0, 0, 1, 1],
    }
    points = tuple(Variable(name, "1", ("point",), column) for name, column in columns.items())
    result = Result("trade", "gait-pareto", variables=points, scalars={"front_knee": wo.Scalar(1)})
    drawn = figure(result, "front")
    joined = [line.get_xdata() for line in drawn.axes[0].lines if line.get_linestyle() == "-"]
    assert sorted(map(tuple, np.array(joined).tolist())) == [(0.2, 0.4), (0.6, 0.8)]
    (legend,) = drawn.legends
    told = [text.get_text() for text in legend.get_texts()]
    assert {"knee, point 1", "resting sequence changes"} <= set(told)
    (star,) = (line for line in drawn.axes[0].lines if line.get_marker() == "*")
    assert np.asarray(star.get_xydata()).tolist() == [[0.4, 2.0]]


def test_the_gait_drawn_beside_is_named_as_the_knees(folder: Path):
    result = Result.load(folder)
    told = " ".join(text.get_text().replace("\n", " ") for text in figure(result, "gait").texts)
    assert f"the knee of the front, point {result.scalars['front_knee'].value}" in told


def test_a_quick_search_says_so():
    own = ["worm.links=1", "search.sequence=[[0],[1]]"]
    quick = wo.run(wo.load_scene("design_fast_gait", [*own, 'search.effort="quick"']))
    normal = wo.run(wo.load_scene("design_fast_gait", own))
    (told,) = quick.trust["warnings"]
    assert 'search.effort = "quick"' in told
    assert '"normal"' in told
    assert normal.trust["warnings"] == []


def test_a_front_says_that_its_search_was_quick(folder: Path):
    warnings = Result.load(folder).trust["warnings"]
    assert sum('search.effort = "quick"' in told for told in warnings) == 1
