"""Parts of a report: numbers, scenes, motions, sweeps."""

import base64
import dataclasses
import json
import re
import tomllib
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hints import Patch
from hypothesis import given
from hypothesis import strategies as st
from places import SAVED
from report_pages import Whole, page_of

import wormopt as wo
from wormopt.cli import main
from wormopt.quantities import Variable
from wormopt.reports.parts import marked, number, unit_text
from wormopt.reports.pictures import animation
from wormopt.reports.report import LARGEST
from wormopt.reports.source import Source, keys_set
from wormopt.reports.sweep import grid_of, ink_on, shade
from wormopt.reports.worm import moving
from wormopt.result import Result
from wormopt.study import packaged_scenes
from wormopt.study.toml import toml_text
from wormopt.systems.coils import pictures as coils

pytestmark = pytest.mark.usefixtures("unpainted")


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (0.0, "0"), (1.0, "1"), (-2.5, "−2.5"), (0.82566665338, "0.825667"),
        (12345.0, "12\u202f345"),
        (1e-9, "1\u202f×\u202f10⁻⁹"), (-3.25e-12, "−3.25\u202f×\u202f10⁻¹²"),
        (1.5e20, "1.5\u202f×\u202f10²⁰"), (float("nan"), "unknown"), (None, "unknown"),
        (True, "yes"), (0.0001, "0.0001"), (123456.7, "123457"), (17.500000000000004, "17.5"),
    ],
)  # fmt: skip
def test_numbers_are_written_as_readers_write_them(value: Any, text: str):
    assert number(value) == text


@given(st.floats(-1e300, 1e300))
def test_a_number_as_written_is_the_number(value: float):
    text = number(value, 9)
    plain = text.replace("\u202f×\u202f10", "e").replace("\u202f", "").replace("−", "-")
    read = float(plain.translate(str.maketrans("⁻⁰¹²³⁴⁵⁶⁷⁸⁹", "-0123456789")))
    assert read == pytest.approx(value, rel=5.1e-4 if "×" in text else 5.1e-9)


def test_units_and_meanings_are_written_as_in_a_book():
    assert unit_text("kg m s-2") == "kg\xa0m\xa0s⁻²"
    assert unit_text("1") == ""
    said = marked("largest \\|*μ*<sub>j</sub>\\|, see [theory](../x.md) of `a` <b>")
    assert said == "largest |<em>μ</em><sub>j</sub>|, see theory of <code>a</code> &lt;b&gt;"


TABLES = st.recursive(
    st.integers(-(2**60), 2**60) | st.floats(allow_nan=False, allow_infinity=False)
    | st.booleans() | st.text(st.characters(exclude_categories=["Cs"])),
    lambda inner: st.lists(inner, max_size=3)
    | st.dictionaries(st.text(st.characters(exclude_categories=["Cs"])), inner, max_size=3),
    max_leaves=12,
)  # fmt: skip


@given(st.dictionaries(st.text(st.characters(exclude_categories=["Cs"])), TABLES, max_size=4))
def test_a_table_written_as_toml_reads_the_same(table: dict[str, Any]):
    assert tomllib.loads(toml_text(table)) == table


@pytest.mark.parametrize("name", packaged_scenes())
def test_a_packaged_scene_written_as_toml_is_the_scene(name: str, tmp_path: Path):
    scene = wo.load_scene(name)
    path = tmp_path / f"{name}.toml"
    path.write_text(toml_text(json.loads(scene.text)), "utf-8")
    for beside in scene.folder.glob("*.py"):
        (tmp_path / beside.name).write_bytes(beside.read_bytes())
    assert wo.load_scene(path).text == scene.text


def test_the_scene_of_the_page_can_be_run_again(gait: Result, tmp_path: Path):
    sought = r'download="([^"]+)" href="data:application/toml;base64,([^"]+)"'
    name, link = re.findall(sought, page_of(gait, tmp_path))[0]
    (tmp_path / name).write_bytes(base64.b64decode(link))
    again = wo.load_scene(tmp_path / name)
    assert again.text == gait.scene_text
    assert again.name == gait.scene


@pytest.mark.parametrize("name", ["design_fast_gait", "fig05_lambda_trackers", "spiked_chain"])
def test_the_keys_listed_are_those_that_the_file_sets(name: str, tmp_path: Path):
    scene = wo.load_scene(name)
    raw = tomllib.loads(packaged_scenes()[name].read_text("utf-8"))
    in_file = {path for path, _ in leaves(raw)} - {"schema", "kind", "title", "units", "want"}
    listed = {key.path: key.value for key in keys_set(scene.table.kind, json.loads(scene.text))}
    assert {*listed} <= in_file | {path for path in listed if path.endswith(".kind")}
    for path in in_file - {*listed}:  # set, but to what it is anyway
        shorter = tmp_path / "scene.toml"
        shorter.write_text(toml_text(shorter_scene(raw, path)), "utf-8")
        assert wo.load_scene(shorter).text == scene.text, path


def leaves(raw: Any, path: str = "") -> list[tuple[str, Any]]:
    if isinstance(raw, dict):
        return [p for k, v in raw.items() for p in leaves(v, f"{path}.{k}" if path else k)]
    if isinstance(raw, list) and raw and isinstance(raw[0], dict):
        return [p for i, v in enumerate(raw) for p in leaves(v, f"{path}[{i}]")]
    return [(path, raw)]


def shorter_scene(raw: dict[str, Any], path: str) -> dict[str, Any]:
    copy = json.loads(json.dumps(raw))
    *way, last = re.sub(r"\[(\d+)\]", r".\1", path).split(".")
    inside = copy
    for key in way:
        inside = inside[int(key)] if isinstance(inside, list) else inside[key]
    del inside[last]
    if not inside and len(way) == 1:
        del copy[way[0]]
    return copy


def test_what_is_written_on_a_map_can_be_read():
    def light(colour: str) -> float:
        parts = [int(colour[k : k + 2], 16) / 255 for k in (1, 3, 5)]
        linear = [p / 12.92 if p <= 0.03928 else ((p + 0.055) / 1.055) ** 2.4 for p in parts]
        return float(np.dot(linear, (0.2126, 0.7152, 0.0722)))

    shares = np.linspace(0, 1, 201)
    ways = [light(shade(share)) for share in shares]
    assert all(np.diff(ways) < 0)  # ever darker
    for share in shares:
        ink = {"#000": 0.0, "#fff": 1.0}[ink_on(shade(share))]
        dark, bright = sorted((ink, light(shade(share))))
        assert (bright + 0.05) / (dark + 0.05) >= 4.5  # WCAG 2, level AA


def test_a_gait_is_shown_for_two_cycles(gait: Result):
    shown = moving(gait)
    assert shown is not None
    period, advance = (gait.scalars[name].value for name in ("period", "advance"))
    assert shown.time[[0, -1]] == pytest.approx([0, 2 * period])
    x = shown.lanes[0].position
    half = len(shown.time) // 2
    assert x[:, half:] == pytest.approx(x[:, : half + 1] + advance, abs=1e-9)


def test_masses_rest_when_the_simulator_says_so():
    result = wo.run("spiked_chain")
    shown = moving(result)
    assert shown is not None
    rests = shown.lanes[0].rests
    assert rests is not None
    start, end, who = (result[f"rest_{n}"].values for n in ("start", "end", "contact"))
    grid = result["time"].values[1] - result["time"].values[0]
    checked = 0
    for frame, t in enumerate(shown.time):
        # as the samples show it: within a sample of a change either may be said
        if np.min(np.abs(np.concatenate([start, end]) - t)) < 1.01 * grid:
            continue
        inside = {int(who[k]) for k in np.flatnonzero((start <= t) & (t <= end))}
        assert {*np.flatnonzero(rests[:, frame])} == inside, t
        checked += 1
    assert checked > 150


def test_trackers_move_side_by_side(fig05: Result):
    shown = moving(fig05)
    assert shown is not None
    assert [lane.label for lane in shown.lanes] == fig05.attributes["trackers"]
    for k, lane in enumerate(shown.lanes):
        ends = fig05["position"].values[k][:, [0, -1]]
        assert lane.position[:, [0, -1]] == pytest.approx(ends)


def test_a_load_is_a_slope_where_it_weighs_what_a_slope_would():
    weight = 9.80665
    changes = ['units="SI"', "worm.mass=1.0", f"worm.load={weight * np.sin(0.2)}"]
    steep = ['units="SI"', "worm.mass=1.0", f"worm.load={weight * 0.9}"]
    shown = [moving(wo.run(wo.load_scene("fast_gait", c))) for c in (changes, steep, [])]
    assert shown[0] is not None
    assert shown[0].angle == pytest.approx(0.2)
    assert shown[0].pull == 0
    assert [(s.angle, s.pull > 0) for s in shown[1:] if s] == [(0.0, True), (0.0, True)]


def test_the_ground_rises_as_the_scene_says(gait: Result, tmp_path: Path):
    scene = json.loads(gait.scene_text)
    for degrees, told in ((12, "The ground rises by 12°."), (-12, "rises by −12°."),
                          (60, "rises by 60°, drawn less steep than it is.")):  # fmt: skip
        scene["worm"] |= {"slope": np.radians(degrees), "load": 3.0}
        sloping = dataclasses.replace(gait, scene_text=json.dumps(scene))
        shown = moving(sloping)
        assert shown is not None
        assert (shown.angle, shown.pull) == (pytest.approx(np.radians(degrees)), 3.0)
        page = page_of(sloping, tmp_path)
        assert told in Whole(page).text
        turned = -np.sign(degrees) * min(abs(degrees), 30)
        assert f"rotate({turned:.3f} " in page


@pytest.mark.parametrize("position", [np.full((3, 4), np.nan), np.zeros((3, 4))])
def test_a_motion_that_is_none_is_shown_as_it_is(position: np.ndarray, tmp_path: Path):
    variables = (
        Variable("time", "1", ("time",), np.arange(4.0)),
        Variable("position", "1", ("mass", "time"), position),
    )
    result = Result("still", "gait", variables=variables)
    assert (moving(result) is None) == bool(np.isnan(position).any())
    Whole(page_of(result, tmp_path))


def test_an_unfinished_motion_is_shown_as_far_as_it_came():
    position = np.vstack([np.arange(6.0), np.arange(6.0) - 1])
    position[:, 4:] = np.nan
    time = Variable("time", "1", ("time",), np.arange(6.0))
    places = Variable("position", "1", ("mass", "time"), position)
    shown = moving(Result("part", "track", variables=(time, places)))
    assert shown is not None
    assert shown.time[-1] == 3


@pytest.mark.slow
def test_a_sweep_is_a_map_of_its_points(sweep: Path, tmp_path: Path):
    page = page_of(sweep, tmp_path)
    told = Whole(page).text
    assert "9 points over worm.load and gait.elongation" in told
    assert "6 ok, 1 failed, 1 refused, 1 not computed" in told
    result = Result.load(sweep)
    first = page.split('class="grid"')[1].split("</table>")[0]
    for point, speed in enumerate(result["speed"].values.ravel()):
        cell = re.search(rf'<a class="([^"]*)" data-point="{point}"[^>]*>([^<]*)</a>', first)
        assert cell is not None
        state = int(result["status"].values.ravel()[point])
        assert (f"state{state}" in cell[1]) == (state > 0)
        assert state or cell[2] == number(speed, 3)
    assert "the check failed" in told
    best = int(np.nanargmax(np.where(result["status"].values == 0, result["speed"].values, -1)))
    assert re.findall(r'class="cell best" data-point="(\d+)"', first) == [str(best)]


@pytest.mark.parametrize(("shape", "holds"), [((7,), "plot"), ((2, 2, 2), "rows")])
def test_a_sweep_of_one_key_is_a_line_and_of_three_a_table(
    shape: tuple[int, ...], holds: str, tmp_path: Path
):
    result = grid_result(shape)
    page = page_of(result, tmp_path)
    Whole(page)
    assert f'class="{holds}"' in page
    assert page.count("data-point=") >= int(np.prod(shape))


def test_a_sweep_as_it_was_computed_opens(tmp_path: Path):
    out = tmp_path / "out"
    over = ["--over", "worm.load=[30, 40]", "--over", "gait.elongation=[0.1, 0.15]"]
    asked = ["sweep", "fast_gait", *over, "-o", str(out), "--engine", "serial", "--no-plots"]
    assert main([*asked, "--quiet"]) == 0
    page = page_of(out, tmp_path)
    whole = Whole(page)
    assert "4 points over worm.load and gait.elongation" in whole.text
    assert {f"r0-p{k}-motion" for k in range(4)} <= {*whole.ids}
    assert "wormopt sweep fast_gait.toml" in whole.text
    (link,) = re.findall(r"base64,([^\"]+)", page)
    written = tomllib.loads(base64.b64decode(link).decode())
    assert [*written["sweep"]["over"]] == ["worm.load", "gait.elongation"]
    speeds = Result.load(out)["speed"].values
    first = page.split('class="grid"')[1].split("</table>")[0]
    cells = dict(re.findall(r'data-point="(\d)"[^>]*>([^<]*)</a>', first))
    assert [cells[str(k)] for k in range(4)] == [number(v, 3) for v in speeds.ravel()]


def test_points_that_lie_anywhere_are_dots(tmp_path: Path):
    speed = np.array([0.5, 0.75, np.nan])
    variables = (
        Variable("load", "N", ("point",), np.array([1.0, 2.0, 4.0])),
        Variable("law", "1", ("point",), np.arange(3)),
        Variable("speed", "m s-1", ("point",), speed),
        Variable("status", "1", ("point",), np.array([0, 0, 1])),
    )
    axes = [{"key": "worm.load", "dim": "load", "values": [1.0, 2.0, 4.0]},
            {"key": "worm.law", "dim": "law", "values": ["spike", "<b>", "viscous"]}]  # fmt: skip
    found = Result("any", "sweep", variables=variables, attributes={"axes": axes})
    page = page_of(found, tmp_path)
    Whole(page)
    said = re.findall(r'class="cell dot[^"]*" data-point="\d" [^>]*aria-label="([^"]*)"', page)
    assert said == [
        "worm.load = 1 N, worm.law = spike: 0.5",
        "worm.load = 2 N, worm.law = &lt;b&gt;: 0.75, best",
        "worm.load = 4 N, worm.law = viscous: failed",
    ]


def grid_result(shape: tuple[int, ...]) -> Result:
    dims = tuple(f"d{k}" for k in range(len(shape)))
    axes = [Variable(d, "1", (d,), np.arange(1.0, n + 1)) for d, n in zip(dims, shape, strict=True)]
    values = np.linspace(0, 1, int(np.prod(shape))).reshape(shape)
    axes += [Variable("speed", "m s-1", dims, values),
             Variable("status", "1", dims, np.zeros(shape, int))]  # fmt: skip
    over = [{"key": f"worm.{d}", "dim": d} for d in dims]
    return Result("grid", "sweep", variables=tuple(axes), attributes={"axes": over})


def test_films_and_planar_worms_move_in_frames(monkeypatch: Patch, tmp_path: Path):
    short = dataclasses.replace(coils.animation, frames=4)
    monkeypatch.setattr(coils, "animation", short)
    result = Result.load(SAVED / "coil_cargo.nc")
    assert moving(result) is None
    figure = animation(result, "r0-motion", 1e6)
    read = Whole(figure)
    assert "r0-motion" in read.ids
    assert {f"f{k}" for k in range(4)} == set(re.findall(r'class="frame (f\d+)"', figure))
    assert 'max="3"' in figure
    assert "left out for want of room" in animation(result, "r0-motion", 1e3)
    assert animation(Result("far", "track"), "r0-motion", 1e6) == ""
    without = dataclasses.replace(result, variables=())
    assert animation(without, "r0-motion", 1e6) == ""


def test_a_large_sweep_stays_within_a_mail(tmp_path: Path):
    page = page_of(grid_result((60, 60)), tmp_path)
    assert len(page.encode()) <= LARGEST
    Whole(page)


@pytest.mark.slow
def test_points_are_read_from_the_folder_of_the_sweep_only(sweep: Path, tmp_path: Path):
    result = Result.load(sweep)
    files = result.attributes["files"]
    names = [f"../{sweep.name}/points/{name}" if name else None for name in files]
    inside = [file for file in grid_of(Source(result, folder=sweep)).files if file]
    assert len(inside) == 7
    before = {**result.attributes, "points": files}  # as earlier builds named it
    del before["files"]
    earlier = dataclasses.replace(result, attributes=before)
    assert [f for f in grid_of(Source(earlier, folder=sweep)).files if f] == inside
    away = dataclasses.replace(result, attributes={**result.attributes, "files": names})
    folder = tmp_path / "elsewhere"
    folder.mkdir()
    assert not any(grid_of(Source(away, folder=folder)).files)
