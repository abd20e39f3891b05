"""Reports: what stands on the page, that it is whole, safe and small, and what commands refuse."""

import base64
import dataclasses
import html
import json
import re
import tomllib
from collections import Counter
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import wormopt as wo
from tests.oracles.by_sweep import make_sweep
from wormopt.cli import main
from wormopt.quantities import Scalar, Variable
from wormopt.reports.colours import ink_on, shade
from wormopt.reports.motion import moving
from wormopt.reports.page import LARGEST
from wormopt.reports.words import marked, number, public, unit_text
from wormopt.result import Result
from wormopt.study import packaged_scenes
from wormopt.study.toml import toml_text
from wormopt.version import VERSION

HOSTILE = "</script><script>alert(1)</script><img src=x onerror=alert(2)> \"'&<b>"
VOID = {"meta", "input", "br", "img", "hr", "link"}


class Whole(HTMLParser):
    """Reads a page strictly: what is opened is closed, in order."""

    def __init__(self, text: str) -> None:
        super().__init__(convert_charrefs=True)
        self.open: list[str] = []
        self.ids: list[str] = []
        self.names: Counter[str] = Counter()
        self.words: list[str] = []
        self.feed(text)
        self.close()
        assert self.open == []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.names[tag] += 1
        assert all(not name.startswith("on") for name, _ in attrs), attrs
        assert all(count == 1 for count in Counter(name for name, _ in attrs).values())
        self.ids += [value or "" for name, value in attrs if name == "id"]
        if tag not in VOID:
            self.open.append(tag)

    def handle_startendtag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.handle_starttag(tag, attrs)
        if tag not in VOID:
            self.open.pop()

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag

    def handle_data(self, data: str) -> None:
        if not {"script", "style"} & {*self.open}:
            self.words.append(data)

    @property
    def text(self) -> str:
        return re.sub(r"[ \n]+", " ", " ".join(self.words))


def page_of(results: Any, folder: Path, **options: Any) -> str:
    path = folder / "page.html"
    wo.report(results, path, force=True, **options)
    return path.read_text("utf-8")


@pytest.fixture(scope="module")
def gait() -> Result:
    return wo.run("fast_gait")


@pytest.fixture(scope="module")
def uphill() -> Result:
    return wo.run("uphill_gait")


@pytest.fixture(scope="module")
def sweep(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return make_sweep(tmp_path_factory.mktemp("sweep"))


@pytest.fixture(autouse=True)
def unpainted(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> None:
    """Pictures take seconds: only tests that ask for `painted` have them."""
    if "painted" not in request.fixturenames:
        monkeypatch.setattr("wormopt.reports.page.pictures", lambda *_, **__: iter(()))
        monkeypatch.setattr("wormopt.reports.sweep.pictures", lambda *_, **__: iter(()))


@pytest.fixture
def painted() -> None:
    """Draw the pictures."""


# What stands on the page -------------------------------------------------------------------------


def test_the_page_tells_what_was_asked_and_found(gait: Result, tmp_path: Path):
    told = Whole(page_of(gait, tmp_path)).text
    assert "Fast gait (15) of a three-mass worm" in told
    assert "Simulate a given gait" in told
    assert f"Accepted. All {len(gait.checks)} checks passed." in told
    assert "speed 1.2 mean speed" in told
    assert "worm.load 20 " in told
    assert "time to load" in told
    assert "computed by wormopt" in told


def test_units_stand_by_the_numbers(tmp_path: Path):
    fast = wo.run(wo.load_scene("fast_gait", ['units="SI"']))
    told = Whole(page_of(fast, tmp_path)).text
    assert "speed 1.2 m\xa0s⁻¹" in told
    assert "period 1 s" in told


def test_a_failed_result_says_so_at_the_top(gait: Result, tmp_path: Path):
    told = Whole(page_of(gait.failed("the mesh is too coarse"), tmp_path)).text
    assert "Failed. The mesh is too coarse." in told
    assert told.index("Failed.") < told.index("The answer")
    assert "Accepted" not in told


def test_a_check_that_is_not_passed_is_told_in_words(gait: Result, tmp_path: Path):
    found = {"value": 0.5, "limit": 1e-9, "passed": False, "advice": "take smaller steps"}
    trust = {**gait.trust, "checks": {"balance": found}, "warnings": ["the spikes are short"]}
    told = Whole(page_of(dataclasses.replace(gait, trust=trust), tmp_path)).text
    line = f"Not accepted: balance is 0.5, accepted is up to {number(1e-9)}. Take smaller steps."
    assert line in told
    assert "The spikes are short." in told


def test_bounds_and_second_routes_are_told(tmp_path: Path):
    bound = {"bound": Scalar(1.5, "m s-1"), "gap_certified": Scalar(0.25)}
    scalars = {"ceiling": Scalar(2.0, "m s-1")} | bound
    trust = {
        "recheck": {"route": "cvodes", "error": 2e-11, "accepted": 1e-7, "shared": "the model"},
        "certificate": {"holds_for": "every gait"},
    }
    told = Whole(page_of(Result("a", "gait", scalars=scalars, trust=trust), tmp_path)).text
    assert "the two differ by" in told
    assert "Both share the model." in told
    assert "the result is within 25\u202f% of it" in told
    assert "Nothing can be faster" not in told  # the bound says more
    assert "It holds for every gait." in told


def test_several_results_are_set_side_by_side(gait: Result, uphill: Result, tmp_path: Path):
    page = page_of([gait, uphill], tmp_path)
    whole = Whole(page)
    assert "2 results side by side" in whole.text
    speeds = [r.scalars["speed"].value for r in (gait, uphill)]
    assert speeds[0] > speeds[1]
    assert f"speed {number(speeds[0])} best {number(speeds[1])}" in whole.text
    assert {"r0", "r1"} <= {*whole.ids}


def test_a_failed_result_is_never_the_best(gait: Result, uphill: Result, tmp_path: Path):
    told = Whole(page_of([gait.failed("no"), uphill, gait], tmp_path)).text
    fast, slow = (number(r.scalars["speed"].value) for r in (gait, uphill))
    assert f"speed {fast} {slow} {fast} best" in told
    told = Whole(page_of([gait.failed("no"), uphill], tmp_path)).text
    assert f"speed {fast} {slow} " in told
    assert " best " not in told.split("Side by side")[1].split("The answer")[0]


def test_keys_in_which_scenes_differ_are_set_side_by_side(tmp_path: Path):
    two = [wo.run(wo.load_scene("fast_gait", [f"worm.load={load}"])) for load in (20, 30)]
    told = Whole(page_of(two, tmp_path)).text.split("Side by side")[1].split("The answer")[0]
    assert "worm.load 20 30" in told
    assert "worm.mass" not in told
    page = page_of(two, tmp_path)
    for k, load in enumerate((20, 30)):  # and head the results, whose titles are the same
        apart = f"<code>worm.load</code> = {load}"
        assert f'<a href="#r{k}">{two[k].title}</a> {apart}</li>' in page
        assert f'<h2 id="r{k}-title">{k}. {two[k].title}</h2><p>{apart}</p>' in page


def test_a_front_shows_its_points_and_whose_numbers_there_are_besides(tmp_path: Path):
    front = Result(
        "front", "gait-pareto",
        scalars={"front_knee": Scalar(1), "mode_sequence": Scalar([[0], [2]])},
        variables=(Variable("front_speed", "1", ("point",), np.array([0.25, 0.5, 0.75])),),
        attributes={"table": "| point | speed | limits, \\|*l*\\| |  |\n| --- | --- | --- | --- |\n"
                             "| 0 | 0.25 | rate |  |\n| 1 | 0.5 |  | knee |\n| 2 | 1 | <b> |  |\n"},
    )  # fmt: skip
    told = Whole(page_of(front, tmp_path)).text
    assert "the knee of the front, point 1 of 0 to 2, is the one that was chosen" in told
    assert "mode sequence [0] [2]" in told
    assert "point speed limits, | l | 0 0.25 rate – 1 0.5 – knee 2 1 <b> –" in told


def test_an_angle_is_shown_as_it_was_typed(tmp_path: Path):
    variables = (
        Variable("slope", "rad", ("slope",), np.radians([10.0, 20.0])),
        Variable("speed", "m s-1", ("slope",), np.array([0.5, 0.25])),
        Variable("status", "1", ("slope",), np.zeros(2, int)),
    )
    axes = [{"key": "worm.slope", "dim": "slope", "values": np.radians([10.0, 20.0]).tolist()}]
    for typed, told in (("10:20:2 deg", "20 deg"), ("0.17:0.35:2", "0.349066 rad")):
        swept = Result(
            "swept", "sweep", variables=variables,
            scene_text=json.dumps({"kind": "gait", "sweep": {"over": {"worm.slope": typed}}}),
            attributes={"axes": axes, "numbers": ["speed"]},
        )  # fmt: skip
        assert f'aria-label="worm.slope = {told}: 0.25"' in page_of(swept, tmp_path)
        (drawn,) = swept.plot().axes
        assert drawn.get_xlabel() == f"worm.slope ({told.split()[1]})"
        assert np.asarray(drawn.lines[0].get_xdata())[-1] == pytest.approx(
            float(told.split()[0]), rel=1e-5
        )


def test_results_of_different_kinds_share_what_they_share(gait: Result, tmp_path: Path):
    other = Result("other", "slide", scalars={"speed": Scalar(0.5), "time": Scalar(1.0)})
    told = Whole(page_of([gait, other], tmp_path)).text
    assert "speed 1.2 best 0.5" in told


def test_a_result_with_nothing_in_it_has_a_page(tmp_path: Path):
    whole = Whole(page_of(Result("bare", "gait"), tmp_path))
    assert "bare" in whole.text
    assert "The result does not hold its scene." in whole.text


# Whole, safe, small ------------------------------------------------------------------------------


def pages(gait: Result, uphill: Result, sweep: Path, folder: Path) -> dict[str, str]:
    return {
        "one": page_of(gait, folder),
        "two": page_of([uphill, uphill], folder),
        "sweep": page_of(sweep, folder),
    }


@pytest.mark.slow
@pytest.mark.usefixtures("painted")
def test_pages_are_well_formed_and_every_link_leads_somewhere(
    gait: Result, uphill: Result, sweep: Path, tmp_path: Path
):
    for name, page in pages(gait, uphill, sweep, tmp_path).items():
        whole = Whole(page)
        twice = [one for one, count in Counter(whole.ids).items() if count > 1]
        assert twice == [], name
        led = re.findall(r'href="#([^"]+)"|url\(#([^)]+)\)|(?:for|labelledby)="([^"]+)"', page)
        assert {"".join(parts) for parts in led} <= {*whole.ids}, name
        assert whole.names["h1"] == 1
        assert len(page.encode()) <= LARGEST
        for elsewhere in ("http://", "https://", "//cdn", "@import", "src="):
            told = page.replace('"http://www.w3.org/1999/xlink"', "")
            assert elsewhere not in told, (name, elsewhere)


def test_hostile_texts_are_shown_and_not_obeyed(gait: Result, tmp_path: Path):
    hostile = dataclasses.replace(
        gait,
        scene=HOSTILE,
        title=HOSTILE,
        status="failed",
        reason=HOSTILE,
        scalars={HOSTILE: Scalar(1.0, HOSTILE), **gait.scalars},
        trust={"warnings": [HOSTILE], HOSTILE: {HOSTILE: HOSTILE}, "recheck": {"route": HOSTILE}},
        timings_s={HOSTILE: 1.0},
        scene_text=json.dumps({"kind": "gait", HOSTILE: HOSTILE, "worm": {"mass": HOSTILE}}),
        attributes={"trackers": [HOSTILE]},
    )
    plain, page = page_of(gait, tmp_path), page_of([hostile, hostile], tmp_path, title=HOSTILE)
    assert Whole(page).names["script"] == Whole(plain).names["script"] + 1  # one worm more
    assert Whole(page).names["img"] == 0
    assert HOSTILE in Whole(page).text
    assert HOSTILE not in page


def test_names_of_folders_and_users_are_kept_back(gait: Result, tmp_path: Path):
    scene = json.loads(gait.scene_text)
    scene["gait"]["file"] = "/home/anna/secret/gait.nc"
    secret = dataclasses.replace(
        gait,
        scene_text=json.dumps(scene),
        reason="could not read C:\\Users\\anna\\gait.nc",
        trust={"warnings": ["see ~anna/secret/log.txt"], "where": str(tmp_path / "x")},
    )
    (tmp_path / "anna").mkdir()
    secret.save(tmp_path / "anna")
    page = page_of(tmp_path / "anna", tmp_path)
    link = re.findall(r"base64,([^\"]+)", page)
    page += "".join(base64.b64decode(one).decode() for one in link)
    assert "anna" not in page
    assert str(tmp_path) not in page
    assert "gait.nc" in page
    assert Path.home().name not in re.sub("<[^>]*>", "", page).split() or Path.home().name == "root"


@pytest.mark.parametrize(
    ("text", "left"),
    [
        ("/home/anna/a.nc", "a.nc"),
        ("in /tmp/x/y, say", "in y, say"),
        ("file:///home/anna/a.nc", "a.nc"),
        (r"C:\Users\anna\a.nc", "a.nc"),
        ("~/gaits/a.nc", "a.nc"),
        ("m/s, km/h and and/or", "m/s, km/h and and/or"),
        ("1 / 2 and n/m/k", "1 / 2 and n/m/k"),
    ],
)
def test_of_a_path_only_the_name_is_left(text: str, left: str):
    assert public(text) == left


@pytest.mark.slow
@pytest.mark.usefixtures("painted")
def test_many_large_results_stay_within_a_mail(gait: Result, tmp_path: Path):
    page = page_of([gait] * 25, tmp_path)
    assert len(page.encode()) <= LARGEST
    assert "is left out for want of room" in page


def test_what_does_not_fit_a_mail_is_refused(
    gait: Result, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setattr("wormopt.reports.page.LARGEST", 20_000)
    with pytest.raises(wo.ArgumentError, match="by mail; report fewer results"):
        wo.report(gait, tmp_path / "large.html")
    assert not (tmp_path / "large.html").exists()


@pytest.mark.usefixtures("painted")
def test_a_picture_that_fails_costs_no_page(gait: Result, tmp_path: Path):
    broken = [v for v in gait.variables if v.name != "length"]
    broken.append(Variable("length", "1", ("other",), np.zeros(3)))
    told = Whole(page_of(dataclasses.replace(gait, variables=tuple(broken)), tmp_path)).text
    assert "The picture “gait” could not be drawn" in told


# The parts ---------------------------------------------------------------------------------------


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
    name, link = re.findall(
        r'download="([^"]+)" href="data:application/toml;base64,([^"]+)"', page_of(gait, tmp_path)
    )[0]
    (tmp_path / name).write_bytes(base64.b64decode(link))
    again = wo.load_scene(tmp_path / name)
    assert again.text == gait.scene_text
    assert again.name == gait.scene


@pytest.mark.parametrize("name", ["design_fast_gait", "fig05_lambda_trackers", "spiked_chain"])
def test_the_keys_listed_are_those_that_the_file_sets(name: str, tmp_path: Path):
    from wormopt.reports.asked import keys_set

    scene = wo.load_scene(name)
    raw = tomllib.loads(packaged_scenes()[name].read_text("utf-8"))
    in_file = {path for path, _ in leaves(raw)} - {"schema", "kind", "title", "units", "want"}
    listed = {key.path: key.value for key in keys_set(scene.table.kind, json.loads(scene.text))}
    assert {*listed} <= in_file | {path for path in listed if path.endswith(".kind")}
    for path in in_file - {*listed}:  # set, but to what it is anyway
        shorter = write(shorter_scene(raw, path), tmp_path)
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


def write(raw: dict[str, Any], folder: Path) -> Path:
    path = folder / "scene.toml"
    path.write_text(toml_text(raw), "utf-8")
    return path


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


# The motion --------------------------------------------------------------------------------------


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
    shown = moving(
        Result("part", "track",
               variables=(time, Variable("position", "1", ("mass", "time"), position)))
    )  # fmt: skip
    assert shown is not None
    assert shown.time[-1] == 3


# Sweeps ------------------------------------------------------------------------------------------


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
    return Result(
        "grid", "sweep",
        variables=(*axes, Variable("speed", "m s-1", dims, values),
                   Variable("status", "1", dims, np.zeros(shape, int))),
        attributes={"axes": [{"key": f"worm.{d}", "dim": d} for d in dims]},
    )  # fmt: skip


def test_a_large_sweep_stays_within_a_mail(tmp_path: Path):
    page = page_of(grid_result((60, 60)), tmp_path)
    assert len(page.encode()) <= LARGEST
    Whole(page)


def test_points_are_read_from_the_folder_of_the_sweep_only(sweep: Path, tmp_path: Path):
    from wormopt.reports.grid import grid_of
    from wormopt.reports.source import Source

    result = Result.load(sweep)
    names = [
        f"../{sweep.name}/points/{name}" if name else None for name in result.attributes["points"]
    ]
    inside = [file for file in grid_of(Source(result, folder=sweep)).files if file]
    assert len(inside) == 7
    away = dataclasses.replace(result, attributes={**result.attributes, "points": names})
    folder = tmp_path / "elsewhere"
    folder.mkdir()
    assert not any(grid_of(Source(away, folder=folder)).files)


# Commands ----------------------------------------------------------------------------------------


def test_the_command_writes_a_page(gait: Result, tmp_path: Path, capsys: pytest.CaptureFixture):
    gait.save(tmp_path)
    out = tmp_path / "new" / "page.html"
    assert main(["report", str(tmp_path), "-o", str(out), "--title", "Mine & yours"]) == 0
    assert '<h1 id="title">Mine &amp; yours</h1>' in out.read_text("utf-8")
    assert capsys.readouterr().out == f"Saved in {out}\n"
    assert [path.name for path in out.parent.iterdir()] == ["page.html"]


def test_nothing_is_written_over(gait: Result, tmp_path: Path, capsys: pytest.CaptureFixture):
    gait.save(tmp_path)
    out = tmp_path / "page.html"
    out.write_text("mine")
    assert main(["report", str(tmp_path / "result.nc"), "-o", str(out)]) == 2
    assert out.read_text() == "mine"
    assert "is there already" in capsys.readouterr().err
    assert main(["report", str(tmp_path), "-o", str(out), "--force"]) == 2
    assert out.read_text() == "mine"
    out = tmp_path / "own.html"
    assert main(["report", str(tmp_path), "-o", str(out)]) == 0
    assert main(["report", str(tmp_path), "-o", str(out), "--title", "Another", "--force"]) == 0
    assert "Another" in out.read_text("utf-8")


@pytest.mark.parametrize(
    ("given", "says"),
    [
        ("none.nc", "there is no such folder or file"),
        ("empty", "holds no result.nc"),
        ("broken.nc", "is no result of wormopt"),
        ("notes.txt", "is no result of wormopt"),
    ],
)
def test_what_is_no_result_is_refused(
    given: str, says: str, tmp_path: Path, capsys: pytest.CaptureFixture
):
    (tmp_path / "empty").mkdir()
    (tmp_path / "broken.nc").write_bytes(b"CDF\x02" + bytes(40))
    (tmp_path / "notes.txt").write_text("notes")
    assert main(["report", str(tmp_path / given), "-o", str(tmp_path / "p.html")]) == 2
    err = capsys.readouterr().err
    assert given in err
    assert says in err
    assert "Traceback" not in err
    assert not (tmp_path / "p.html").exists()


def test_where_no_page_can_be_is_refused(
    gait: Result, tmp_path: Path, capsys: pytest.CaptureFixture
):
    gait.save(tmp_path)
    for out, says in ((tmp_path, "is a folder"), (tmp_path / "result.nc" / "p", "cannot be")):
        assert main(["report", str(tmp_path), "-o", str(out)]) == 2
        assert says in capsys.readouterr().err
    assert not [path for path in tmp_path.iterdir() if path.name.startswith(".wormopt")]


def test_no_result_is_no_page(tmp_path: Path):
    with pytest.raises(wo.ArgumentError, match="no result"):
        wo.report([], tmp_path / "page.html")


def test_the_version_and_the_date_are_those_of_the_file(gait: Result, tmp_path: Path):
    import os

    gait.save(tmp_path)
    file = tmp_path / "result.nc"
    data = file.read_bytes()
    assert data.count(f"wormopt {VERSION}".encode()) == 1
    other = "9.8.7".ljust(len(VERSION), "6")  # as long: NetCDF states the length of texts
    file.write_bytes(data.replace(VERSION.encode(), other.encode()))
    os.utime(file, (1_000_000_000, 1_000_000_000))
    told = Whole(page_of(tmp_path, tmp_path)).text
    assert f"computed by wormopt {other}" in told
    assert "file of 2001-09-09 01:46 UTC" in told


def test_the_script_of_the_page_is_the_one_allowed(gait: Result, tmp_path: Path):
    import hashlib

    page = page_of(gait, tmp_path)
    (script,) = re.findall(r"<script>(.*?)</script>", page, re.DOTALL)
    digest = base64.b64encode(hashlib.sha256(script.encode()).digest()).decode()
    (policy,) = re.findall(r'Content-Security-Policy" content="([^"]+)"', page)
    assert f"script-src 'sha256-{digest}'" in html.unescape(policy)
    assert "default-src 'none'" in html.unescape(policy)
