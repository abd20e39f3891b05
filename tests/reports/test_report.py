"""Reports: what stands on the page, that it is whole, safe and small, and what commands refuse."""

import base64
import dataclasses
import hashlib
import html
import json
import os
import re
from collections import Counter
from pathlib import Path

import numpy as np
import pytest
from hints import Capture, Patch
from report_pages import Whole, page_of

import wormopt as wo
from wormopt.cli import main
from wormopt.quantities import Scalar, Variable
from wormopt.reports.parts import number, public
from wormopt.reports.report import LARGEST
from wormopt.result import Result
from wormopt.version import VERSION

pytestmark = pytest.mark.usefixtures("unpainted")

HOSTILE = "</script><script>alert(1)</script><img src=x onerror=alert(2)> \"'&<b>"


@pytest.fixture(scope="module")
def uphill() -> Result:
    return wo.run("uphill_gait")


# What stands on the page -------------------------------------------------------------------------


def test_the_page_tells_what_was_asked_and_found(gait: Result, tmp_path: Path):
    told = Whole(page_of(gait, tmp_path)).text
    assert "Fast gait (15) of a three-mass worm" in told
    assert "Simulate a given gait" in told
    assert f"Accepted. All {len(gait.checks)} checks passed." in told
    assert "speed 1.2 mean speed" in told
    assert "worm.load 20 " in told
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
    assert "the knee of the front, point 1 of 0 to 2, is the selected one" in told
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
        end = np.asarray(drawn.lines[0].get_xdata())[-1]
        assert end == pytest.approx(float(told.split()[0]), rel=1e-5)


def test_results_of_different_kinds_share_what_they_share(gait: Result, tmp_path: Path):
    other = Result("other", "slide", scalars={"speed": Scalar(0.5), "time": Scalar(1.0)})
    told = Whole(page_of([gait, other], tmp_path)).text
    assert "speed 1.2 best 0.5" in told


def test_a_result_with_nothing_in_it_has_a_page(tmp_path: Path):
    whole = Whole(page_of(Result("bare", "gait"), tmp_path))
    assert "bare" in whole.text
    assert "The result does not hold its scene." in whole.text


# Whole, safe, small ------------------------------------------------------------------------------


@pytest.mark.slow
@pytest.mark.usefixtures("painted")
def test_pages_are_well_formed_and_every_link_leads_somewhere(
    gait: Result, uphill: Result, sweep: Path, tmp_path: Path
):
    shown = {"one": gait, "two": [uphill, uphill], "sweep": sweep}
    for name, results in shown.items():
        page = page_of(results, tmp_path)
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
        gait, scene=HOSTILE, title=HOSTILE, status="failed", reason=HOSTILE,
        scalars={HOSTILE: Scalar(1.0, HOSTILE), **gait.scalars},
        trust={"warnings": [HOSTILE], HOSTILE: {HOSTILE: HOSTILE}, "recheck": {"route": HOSTILE}},
        timings_s={HOSTILE: 1.0}, attributes={"trackers": [HOSTILE]},
        scene_text=json.dumps({"kind": "gait", HOSTILE: HOSTILE, "worm": {"mass": HOSTILE}}),
    )  # fmt: skip
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


def test_what_does_not_fit_a_mail_is_refused(gait: Result, tmp_path: Path, monkeypatch: Patch):
    monkeypatch.setattr("wormopt.reports.report.LARGEST", 20_000)
    with pytest.raises(wo.ArgumentError, match="by mail; report fewer results"):
        wo.report(gait, tmp_path / "large.html")
    assert not (tmp_path / "large.html").exists()


@pytest.mark.usefixtures("painted")
def test_a_picture_that_fails_costs_no_page(gait: Result, tmp_path: Path):
    broken = [v for v in gait.variables if v.name != "length"]
    broken.append(Variable("length", "1", ("other",), np.zeros(3)))
    told = Whole(page_of(dataclasses.replace(gait, variables=tuple(broken)), tmp_path)).text
    assert "The picture “gait” could not be drawn" in told


# Commands ----------------------------------------------------------------------------------------


def test_the_command_writes_a_page(gait: Result, tmp_path: Path, capsys: Capture):
    gait.save(tmp_path)
    out = tmp_path / "new" / "page.html"
    assert main(["report", str(tmp_path), "-o", str(out), "--title", "Mine & yours"]) == 0
    assert '<h1 id="title">Mine &amp; yours</h1>' in out.read_text("utf-8")
    assert capsys.readouterr().out == f"Saved in {out}\n"
    assert [path.name for path in out.parent.iterdir()] == ["page.html"]


def test_nothing_is_written_over(gait: Result, tmp_path: Path, capsys: Capture):
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
        ("broken.nc", "is not a result of wormopt"),
        ("notes.txt", "is not a result of wormopt"),
    ],
)
def test_what_is_no_result_is_refused(given: str, says: str, tmp_path: Path, capsys: Capture):
    (tmp_path / "empty").mkdir()
    (tmp_path / "broken.nc").write_bytes(b"CDF\x02" + bytes(40))
    (tmp_path / "notes.txt").write_text("notes")
    assert main(["report", str(tmp_path / given), "-o", str(tmp_path / "p.html")]) == 2
    err = capsys.readouterr().err
    assert given in err
    assert says in err
    assert "Traceback" not in err
    assert not (tmp_path / "p.html").exists()


def test_where_no_page_can_be_is_refused(gait: Result, tmp_path: Path, capsys: Capture):
    gait.save(tmp_path)
    for out, says in (
        ("", "is a folder"),
        ("result.nc/p.html", "cannot be"),
        ("x.txt", "a report is an HTML page; write a name that ends in .html"),
    ):
        assert main(["report", str(tmp_path), "-o", str(tmp_path / out)]) == 2
        assert says in capsys.readouterr().err
    assert not [path for path in tmp_path.iterdir() if path.name.startswith(".wormopt")]


def test_no_result_is_no_page(tmp_path: Path):
    with pytest.raises(wo.ArgumentError, match="no result"):
        wo.report([], tmp_path / "page.html")


def test_the_version_and_the_date_are_those_of_the_file(gait: Result, tmp_path: Path):
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
    page = page_of(gait, tmp_path)
    (script,) = re.findall(r"<script>(.*?)</script>", page, re.DOTALL)
    digest = base64.b64encode(hashlib.sha256(script.encode()).digest()).decode()
    (policy,) = re.findall(r'Content-Security-Policy" content="([^"]+)"', page)
    assert f"script-src 'sha256-{digest}'" in html.unescape(policy)
    assert "default-src 'none'" in html.unescape(policy)
