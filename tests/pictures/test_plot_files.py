"""Files of pictures: formats, sizes, animations, written whole, and the command `plot`."""

import dataclasses
import io
import json
import os
import re
import subprocess
import sys
from base64 import b64decode
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any
from xml.etree import ElementTree

import numpy as np
import pytest
from drawn import sample, without
from PIL import Image

import wormopt as wo
from wormopt.cli import main
from wormopt.files import sealed
from wormopt.pictures import draw, figure, save, shortened, worms
from wormopt.result import Result
from wormopt.systems.channel import pictures as rod


def test_missing_variables_are_named_and_leave_no_file(tmp_path: Path):
    result = without(sample("gait"), "resting", "length", "rate")
    with pytest.raises(KeyError, match="no scalar or variable 'resting'"):
        draw(result, "gait", tmp_path / "gait.png")
    there = "no picture 'portrait' of kind gait; there are: gait, motion"
    with pytest.raises(ValueError, match="did you mean motion"):
        figure(result, "motions")
    with pytest.raises(ValueError, match=there):
        draw(result, "portrait", tmp_path / "portrait.png")
    assert list(tmp_path.iterdir()) == []


def test_a_picture_that_cannot_be_written_leaves_the_old_one(tmp_path: Path):
    path = tmp_path / "front.unknown"
    path.write_text("old")
    with pytest.raises(ValueError, match=r"no format unknown; write \.png, \.pdf, \.svg"):
        draw(sample("front"), "front", path)
    assert path.read_text() == "old"
    assert list(tmp_path.iterdir()) == [path]


def test_the_animation_moves(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    short = dataclasses.replace(worms.animation, frames=12)  # of 120
    monkeypatch.setattr(worms, "animation", short)
    path = tmp_path / "animation.gif"
    draw(sample("animation"), "animation", path, width=50)
    assert path.stat().st_size < 2_000_000
    with Image.open(path) as film:
        assert getattr(film, "n_frames", 1) == 12
        first = np.asarray(film.convert("RGB"))
        film.seek(6)
        assert (np.asarray(film.convert("RGB")) != first).any()
    assert list(tmp_path.iterdir()) == [path]


FORMATS = {"png": b"\x89PNG\r\n", "pdf": b"%PDF-", "svg": b"<?xml"}


@cache
def written(picture: str, form: str) -> bytes:
    """A file with a picture as wide as a column."""
    with TemporaryDirectory() as folder:
        path = Path(folder) / f"a.{form}"
        draw(sample(picture), picture, path, width=85)
        return path.read_bytes()


@pytest.mark.parametrize(
    ("picture", "form"),
    [
        ("motion", "png"),
        *(pytest.param("motion", form, marks=pytest.mark.slow) for form in ("pdf", "svg")),
        *(pytest.param("gait", form, marks=pytest.mark.slow) for form in FORMATS),
        pytest.param("coil_pressure", "png", marks=pytest.mark.slow),
        pytest.param("basins", "svg", marks=pytest.mark.slow),
    ],
)
def test_the_same_result_gives_the_same_file(picture: str, form: str):
    first = written(picture, form)
    assert first.startswith(FORMATS[form])
    memory = io.BytesIO()
    save(figure(sample(picture), picture, width=85), memory, form)
    assert sealed(memory.getvalue()) == first


def test_formats_have_the_width_asked_for_and_fonts_that_journals_take():
    png, pdf, svg = (written("motion", form) for form in FORMATS)
    with Image.open(io.BytesIO(png)) as image:
        assert image.size[0] == pytest.approx(85 / 25.4 * image.info["dpi"][0], abs=1)
    box = re.search(rb"/MediaBox \[ 0 0 ([0-9.]+)", pdf)
    assert box
    assert float(box[1]) == pytest.approx(85 / 25.4 * 72, abs=0.01)
    assert b"/Type3" not in pdf
    assert b"/FontFile2" in pdf
    for file in (pdf, svg):
        assert not re.search(rb"CreationDate|<dc:date>", file)
    assert b"<text" not in svg  # outlines: no font need be there


def test_an_animation_is_still_as_a_picture_and_only_it_moves(tmp_path: Path):
    draw(sample("animation"), "animation", tmp_path / "still.png", width=85)
    with pytest.raises(ValueError, match=r"only an animation moves; write \.png, \.pdf, \.svg"):
        draw(sample("gait"), "gait", tmp_path / "gait.gif")
    assert [path.name for path in tmp_path.iterdir()] == ["still.png"]


def drawn_at(root: ElementTree.Element, frame: str) -> list[dict[str, str]]:
    """Paths and markers of the parts of a moving picture with this class."""
    parts = [part for part in root.iter() if frame in part.get("class", "").split()]
    named = ("path", "use")  # what has an id is defined where it is first used
    return [one.attrib for part in parts for one in part.iter()
            if one.tag.rpartition("}")[2] in named and "id" not in one.attrib]  # fmt: skip


@pytest.mark.slow
def test_a_picture_that_moves_by_itself(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """Every frame is as `show` draws it, and is shown for its share of the time."""
    short = dataclasses.replace(worms.animation, frames=6)  # of 120
    monkeypatch.setattr(worms, "animation", short)
    result = sample("animation")
    draw(result, "animation", tmp_path / "a.svg", width=85)
    text = (tmp_path / "a.svg").read_text("utf-8")
    root = ElementTree.fromstring(text)
    assert "<script" not in text
    assert "{visibility:visible}16.666667%{visibility:hidden}" in text
    delays = [f".f{k}{{animation-delay:{k / 12:.5f}s}}" in text for k in range(7)]
    assert delays == [*[True] * 6, False]
    one = figure(result, "animation", width=85)
    for frame in range(6):
        short.show(one, frame)
        axes = one.axes[0]
        for artist in (*axes.lines, *axes.patches, *axes.collections, *axes.texts):
            if artist.get_gid() is None:
                artist.set_gid("frame-0-0")
        memory = io.BytesIO()
        save(one, memory, "svg")
        alone = re.sub('id="frame-0-0"', 'class="f0"', shortened(memory.getvalue().decode()))
        assert drawn_at(root, f"f{frame}") == drawn_at(ElementTree.fromstring(alone), "f0")
    draw(result, "animation", tmp_path / "b.svg", width=85)
    assert (tmp_path / "b.svg").read_bytes() == (tmp_path / "a.svg").read_bytes()


def test_an_animation_moves_in_a_notebook_and_a_still_picture_does_not(
    monkeypatch: pytest.MonkeyPatch,
):
    short = dataclasses.replace(worms.animation, frames=3)
    monkeypatch.setattr(worms, "animation", short)
    shown = sample("animation").plot("animation")._repr_html_()  # type: ignore[attr-defined]
    assert shown is not None
    found = re.fullmatch(r'<img src="data:image/svg\+xml;base64,([^"]*)" alt="[^"<>]*">', shown)
    assert found is not None
    assert b'class="frame f2"' in b64decode(found[1])
    assert sample("front").plot("front")._repr_html_() is None  # type: ignore[attr-defined]


@pytest.mark.slow
def test_mp4_is_made_by_ffmpeg_or_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """A stand-in that counts the frames it is given."""
    monkeypatch.setenv("PATH", str(tmp_path))
    with pytest.raises(ValueError, match=r"MP4 needs ffmpeg.*install it.*or write \.gif"):
        draw(sample("animation"), "animation", tmp_path / "a.mp4")
    stand_in = tmp_path / "ffmpeg"
    count = "sys.stdin.buffer.read(); size = sys.argv[sys.argv.index('-s') + 1]"
    write = "open(sys.argv[-1], 'w').write(f'{size} {len(data)}')"
    stand_in.write_text(f"#!{sys.executable}\nimport sys\ndata = {count}\n{write}\n")
    stand_in.chmod(0o700)
    draw(sample("animation"), "animation", tmp_path / "a.mp4", width=85)
    size, length = (tmp_path / "a.mp4").read_text().split()
    across, down = map(int, size.split("x"))
    assert int(length) == 120 * across * down * 4
    assert across % 2 == down % 2 == 0  # as the codec wants


@pytest.fixture
def saved(tmp_path: Path) -> Path:
    folder = tmp_path / "result"
    folder.mkdir()
    result = sample("limits")
    result.save(folder)
    return folder


@pytest.mark.slow
def test_plot_draws_what_the_scene_wants_beside_the_result(saved: Path, capsys: Any):
    assert main(["plot", str(saved)]) == 0
    drawn = [f"{name}.png" for name in ("gait", "motion", "spikes", "limits")]
    assert capsys.readouterr().out.split() == [str(saved / name) for name in drawn]
    assert main(["plot", str(saved / "result.nc"), "gait", "--format", "pdf"]) == 0
    listed = json.loads((saved / "summary.json").read_text())["files"]
    assert listed == ["result.nc", "summary.json", "certificate.json", *drawn, "gait.pdf"]
    assert {path.name for path in saved.iterdir()} == set(listed)
    assert Result.load(saved).scalars == sample("limits").scalars
    # they are its own now, to be drawn again
    before = (saved / "gait.pdf").read_bytes()
    assert main(["plot", str(saved), "gait", "--format", "pdf", "--width", "85mm"]) == 0
    assert (saved / "gait.pdf").read_bytes() != before


def test_plot_writes_where_it_is_told(saved: Path, tmp_path: Path):
    out = tmp_path / "new" / "x.pdf"
    assert main(["plot", str(saved), "motion", "-o", str(out), "--width", "8.5cm"]) == 0
    assert out.read_bytes().startswith(b"%PDF")
    folder = tmp_path / "folder"
    two = ["spikes", "motion", "--width", "85mm"]
    assert main(["plot", str(saved), *two, "-o", str(folder), "--no-title"]) == 0
    assert {path.name for path in folder.iterdir()} == {"spikes.png", "motion.png"}
    files = {"result.nc", "summary.json", "certificate.json"}
    assert {path.name for path in saved.iterdir()} == files


def test_plot_replaces_only_what_is_its_own(saved: Path, tmp_path: Path, capsys: Any):
    foreign = saved / "gait.png"
    foreign.write_text("mine")
    assert main(["plot", str(saved), "motion", "gait"]) == 2
    assert "gait.png: is there already" in capsys.readouterr().err
    assert foreign.read_text() == "mine"
    assert not (saved / "motion.png").exists()
    assert main(["plot", str(saved), "gait", "--force"]) == 2  # never what is not ours
    assert foreign.read_text() == "mine"
    # one of ours that is elsewhere is known by its mark
    for form in ("png", "pdf", "svg"):
        picture = tmp_path / "new" / f"motion.{form}"
        elsewhere = ["motion", "-o", str(picture)]
        assert main(["plot", str(saved), *elsewhere, "--width", "60mm"]) == 0
        assert main(["plot", str(saved), *elsewhere]) == 2
        assert main(["plot", str(saved), *elsewhere, "--force", "--width", "85mm"]) == 0
        if form == "png":
            with Image.open(picture) as opened:
                opened.verify()  # its checksums
        picture.write_bytes(picture.read_bytes() + b" ")  # edited
        assert main(["plot", str(saved), *elsewhere, "--force"]) == 2
    # of another folder nothing is known
    other = tmp_path / "gait.png"
    other.write_text("mine")
    assert main(["plot", str(saved), "gait", "-o", str(tmp_path)]) == 2
    assert other.read_text() == "mine"
    # nor of a result that the summary does not list
    (saved / "other.nc").write_bytes((saved / "result.nc").read_bytes())
    assert main(["plot", str(saved / "other.nc"), "gait"]) == 2


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["gaits"], "no picture 'gaits' of kind gait-design; did you mean gait?"),
        (
            ["certificate"],
            "cannot be drawn: the result has no scalar or variable 'proof_time'",
        ),
        (["gait", "--format", "mp4"], "gait.mp4: only an animation moves"),
        (
            ["gait", "motion", "-o", "x.pdf"],
            "x.pdf: one file cannot hold 2 pictures (gait, motion)",
        ),
        (["gait", "-o", "x.jpg"], "x.jpg: no format jpg; write .png, .pdf, .svg"),
        (["gait", "-o", "x.svg", "--format", "pdf"], "does not end in .pdf"),
    ],
)
def test_plot_refuses_what_cannot_be(saved: Path, capsys: Any, arguments: list[str], said: str):
    before = {path.name for path in saved.iterdir()}
    assert main(["plot", str(saved), *arguments]) == 2
    told = capsys.readouterr()
    assert said in told.err
    assert told.out == ""
    assert {path.name for path in saved.iterdir()} == before


def test_plot_tells_what_is_no_result(tmp_path: Path, capsys: Any):
    assert main(["plot", str(tmp_path)]) == 2
    assert "holds no result.nc" in capsys.readouterr().err
    (tmp_path / "result.nc").write_text("nothing")
    assert main(["plot", str(tmp_path)]) == 2
    assert "is not a result of wormopt" in capsys.readouterr().err


@pytest.mark.parametrize("size", ["wide", "10mm", "-85mm", "85pt", "nan", "1e9"])
def test_plot_refuses_a_size_that_is_none(saved: Path, size: str, capsys: Any):
    with pytest.raises(SystemExit) as stop:
        main(["plot", str(saved), f"--width={size}"])
    assert stop.value.code == 2
    assert "write for example 85mm" in capsys.readouterr().err


@pytest.mark.slow
def test_pictures_that_nobody_named_may_be_missing(saved: Path, capsys: Any):
    result = dataclasses.replace(sample("limits"), scene_text="")
    result.save(saved)
    assert main(["plot", str(saved)]) == 0  # all of the kind
    told = capsys.readouterr()
    assert "certificate cannot be drawn" in told.err
    assert (saved / "animation.gif").exists()
    (saved / "animation.gif").unlink()  # no longer listed
    without(result, "").save(saved)
    assert main(["plot", str(saved), "--force"]) == 2
    assert "the result has no data for a picture" in capsys.readouterr().err


def test_an_animation_of_a_rod_is_drawn_frame_by_frame():
    result = sample("rod_motion")
    drawn = figure(result, "animation")
    before = drawn.axes[0].texts[-1].get_text()
    rod.animation.show(drawn, 100)
    assert drawn.axes[0].texts[-1].get_text() != before


@pytest.mark.parametrize(
    "command",
    [
        "run",
        "plot",
        pytest.param("sweep", marks=pytest.mark.slow),
        pytest.param("report", marks=pytest.mark.slow),
    ],
)
def test_a_backend_that_is_not_there_is_refused_before_the_work(command: str, tmp_path: Path):
    """In a process of its own, as Matplotlib takes the backend when it is loaded."""
    wo.Result("walk", "gait").save(tmp_path)
    words = {
        "run": ["run", "fast_gait", "-o", "out"],
        "sweep": ["sweep", "fast_gait", "--over", "worm.load=[1,2]", "-o", "out"],
        "plot": ["plot", str(tmp_path)],
        "report": ["report", str(tmp_path), "-o", "out.html"],
    }[command]
    done = subprocess.run(
        [sys.executable, "-m", "wormopt", *words], cwd=tmp_path, capture_output=True, text=True,
        check=False, env={**os.environ, "MPLBACKEND": "nonsense"},
    )  # fmt: skip
    assert done.returncode == 2
    assert done.stdout == ""
    (line,) = done.stderr.splitlines()
    assert line.startswith("MPLBACKEND=nonsense: Matplotlib has no such backend, or it is not in")
    assert ("--no-plots" in line) == (command in ("run", "sweep"))
    assert not (tmp_path / "out").exists()
    assert (tmp_path / "result.nc").exists()


def test_without_pictures_no_backend_is_needed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setenv("MPLBACKEND", "nonsense")
    asked = ["run", "fast_gait", "--no-plots", "--quiet", "-o", str(tmp_path / "out")]
    assert main(asked) == 0
