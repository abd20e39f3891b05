"""Reports in a real browser: the worm moves, cells open, keys suffice, nothing is loaded.

Skipped where there is no Chromium, or what drives it.
"""

import importlib.util
import re
import shutil
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from places import SAVED

import wormopt as wo
from tests.oracles.by_sweep import make_sweep
from wormopt.quantities import Variable
from wormopt.result import Result

NAMES = ("chromium", "chromium-browser", "google-chrome")
CHROMIUM = next(filter(None, map(shutil.which, NAMES)), None)
if CHROMIUM is None:
    pytest.skip("no Chromium on this machine", allow_module_level=True)
sync_api = pytest.importorskip("playwright.sync_api", reason="playwright is not installed")

FLAGS = [
    "--disable-gpu", "--disable-quic", "--no-first-run", "--disable-background-networking",
    "--disable-component-update", "--disable-sync",
]  # fmt: skip
PHONE, DESK = {"width": 390, "height": 844}, {"width": 1100, "height": 900}
Open = Callable[..., Any]


@pytest.fixture(scope="module")
def browser() -> Iterator[Any]:
    with sync_api.sync_playwright() as playwright:
        chromium = playwright.chromium.launch(
            executable_path=CHROMIUM, args=FLAGS, chromium_sandbox=False
        )
        yield chromium
        chromium.close()


@pytest.fixture
def opened(browser: Any) -> Iterator[Open]:
    """Open a page; at the end it must have loaded nothing and complained of nothing."""
    contexts, wanted, asked, said = [], set(), set(), []

    def open_page(path: Path, **options: Any) -> Any:
        context = browser.new_context(offline=True, **({"viewport": DESK} | options))
        contexts.append(context)
        page = context.new_page()
        page.on("request", lambda request: asked.add(request.url.partition("#")[0]))
        page.on("console", lambda message: said.append(message.text))
        page.on("pageerror", lambda error: said.append(str(error)))
        wanted.add(path.as_uri())
        page.goto(path.as_uri())
        return page

    yield open_page
    for context in contexts:
        context.close()
    assert asked == wanted
    assert said == []


@pytest.fixture(scope="module")
def design() -> Result:
    return wo.run("design_fast_gait")


@pytest.fixture(scope="module")
def pages(design: Result, tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """A design, a comparison with a simulation, and a sweep."""
    folder = tmp_path_factory.mktemp("pages")
    failed = wo.run("uphill_gait").failed("it was stopped")
    found: dict[str, Any] = {
        "design": design,
        "comparison": [design, failed, wo.run("spiked_chain")],
        "sweep": make_sweep(folder),
    }
    for name, results in found.items():
        with pytest.MonkeyPatch.context() as patch:
            if name != "design":  # pictures take seconds
                patch.setattr("wormopt.reports.report.pictures", lambda *_, **__: iter(()))
                patch.setattr("wormopt.reports.sweep.pictures", lambda *_, **__: iter(()))
            wo.report(results, folder / f"{name}.html")
    return {name: folder / f"{name}.html" for name in found}


def places(page: Any, figure: str) -> np.ndarray:
    """Where the masses are, read off the picture: against the ground's own marks."""
    found = page.evaluate(
        """(figure) => {
          const middle = (node) => { const box = node.getBoundingClientRect();
                                     return box.x + box.width / 2; };
          const stage = document.querySelector(figure + " .stage");
          return {
            marks: [...stage.querySelectorAll("text.tick")].map((t) => [middle(t), t.textContent]),
            masses: [...stage.querySelectorAll(".mass circle")].map(middle),
          };
        }""",
        figure,
    )
    at = [x for x, _ in found["marks"]]
    named = [float(text.replace("−", "-")) for _, text in found["marks"]]
    return np.polyval(np.polyfit(at, named, 1), found["masses"])


def position(design: Result, t: float) -> np.ndarray:
    """Where the masses of a gait are at any time."""
    time, x = design["time"].values, design["position"].values
    period, advance = time[-1], x[0, -1] - x[0, 0]
    turn = min(t // period, 1)
    return np.array([np.interp(t - turn * period, time, row) for row in x]) + turn * advance


def time_of(page: Any, frame: int) -> float:
    slider = page.locator("#r0-motion .slider")
    return 2 * frame / int(slider.get_attribute("max"))


def set_slider(page: Any, frame: int, figure: str = "#r0-motion") -> None:
    page.locator(f"{figure} .slider").fill(str(frame))


def test_the_worm_follows_the_slider(opened: Open, pages: dict[str, Path], design: Result):
    page = opened(pages["design"])
    before = places(page, "#r0-motion")
    assert before == pytest.approx(position(design, 0.0), abs=0.004)
    for frame in (1, 37, 120, 121, 240):
        set_slider(page, frame)
        expected = position(design, time_of(page, frame))
        # a fifth of a pixel
        assert places(page, "#r0-motion") == pytest.approx(expected, abs=0.002), frame
    assert np.abs(places(page, "#r0-motion") - before).max() > 1


def test_masses_that_rest_are_marked_and_spikes_loaded(
    opened: Open, pages: dict[str, Path], design: Result
):
    page = opened(pages["design"])
    time, rests = design["time"].values, design["resting"].values
    load = design["reaction"].values
    seen = set()
    for frame in range(2, 120, 4):
        set_slider(page, frame)
        k = np.searchsorted(time, time_of(page, frame), side="right") - 1
        masses = page.locator("#r0-motion .mass")
        marked = [m.get_attribute("class") == "mass rests" for m in masses.all()]
        assert marked == rests[:, k].astype(bool).tolist()
        bars = [float(b.get_attribute("height")) for b in page.locator("#r0-motion .bar").all()]
        assert bars == pytest.approx((40 * load[:, k] / load.max()).tolist(), abs=0.2)
        seen.add(tuple(marked))
    assert len(seen) == 3


def test_it_plays_and_stops(opened: Open, pages: dict[str, Path], design: Result):
    page = opened(pages["design"])
    slider, button = (page.locator(f"#r0-motion {name}") for name in (".slider", ".play"))
    page.wait_for_timeout(200)
    assert slider.input_value() == "0"  # nothing moves by itself
    button.click()
    assert button.text_content() == "Pause"
    page.wait_for_function("() => +document.querySelector('#r0-motion .slider').value > 20")
    button.click()
    assert button.text_content() == "Play"
    frame = int(slider.input_value())
    page.wait_for_timeout(100)
    assert slider.input_value() == str(frame)
    expected = position(design, time_of(page, frame))
    assert places(page, "#r0-motion") == pytest.approx(expected, abs=0.002)


def test_keys_suffice(opened: Open, pages: dict[str, Path]):
    page = opened(pages["design"])
    slider = page.locator("#r0-motion .slider")
    for _ in range(60):
        page.keyboard.press("Tab")
        if slider.evaluate("node => node === document.activeElement"):
            break
    page.keyboard.press("ArrowRight")
    page.keyboard.press("ArrowRight")
    assert slider.input_value() == "2"
    assert slider.get_attribute("aria-valuetext").startswith("t = 0.0167")
    page.keyboard.press("End")
    assert slider.input_value() == slider.get_attribute("max")
    page.keyboard.press("Home")
    page.keyboard.press(" ")
    page.wait_for_function("() => +document.querySelector('#r0-motion .slider').value > 3")
    page.keyboard.press(" ")
    assert page.locator("#r0-motion .play").text_content() == "Play"


def test_who_wants_little_motion_sees_it_once(opened: Open, pages: dict[str, Path]):
    for wish, ends in (("reduce", True), ("no-preference", False)):
        page = opened(pages["design"], reduced_motion=wish)
        last = int(page.locator("#r0-motion .slider").get_attribute("max"))
        set_slider(page, last - 6)
        page.locator("#r0-motion .play").click()
        page.wait_for_timeout(700)
        button = page.locator("#r0-motion .play").text_content()
        assert (button == "Play") == ends
        value = int(page.locator("#r0-motion .slider").input_value())
        assert (value == last) if ends else (value < last // 2)


def test_a_simulation_moves_too(opened: Open, pages: dict[str, Path]):
    page = opened(pages["comparison"])
    result = wo.run("spiked_chain")
    time, x = result["time"].values, result["position"].values
    last = int(page.locator("#r2-motion .slider").get_attribute("max"))
    for frame in (0, last // 3, last):
        set_slider(page, frame, "#r2-motion")
        expected = [np.interp(time[-1] * frame / last, time, row) for row in x]
        assert places(page, "#r2-motion") == pytest.approx(expected, abs=0.02)


def test_the_ground_moves_under_a_worm_that_goes_far(opened: Open, tmp_path: Path):
    time = np.linspace(0.0, 10.0, 501)
    x = np.stack([10 * time + 1, 10 * time + 0.2 * np.sin(time)])
    variables = (
        Variable("time", "1", ("time",), time),
        Variable("position", "1", ("mass", "time"), x),
    )
    wo.report(Result("far", "simulate", variables=variables), tmp_path / "far.html")
    page = opened(tmp_path / "far.html")
    last = int(page.locator("#r0-motion .slider").get_attribute("max"))
    for frame in (0, 77, last):
        set_slider(page, frame)
        expected = [np.interp(10 * frame / last, time, row) for row in x]
        assert places(page, "#r0-motion") == pytest.approx(expected, abs=0.02)
        stage = page.locator("#r0-motion svg.worm").bounding_box()
        for circle in page.locator("#r0-motion .mass circle").all():
            box = circle.bounding_box()
            assert stage["x"] < box["x"] < stage["x"] + stage["width"] - box["width"]


SEEN = """() => [...document.querySelectorAll("#r0-motion .frame")]
  .filter((part) => getComputedStyle(part).visibility === "visible")
  .map((part) => part.getAttribute("class").split(" ")[1])"""


def test_a_worm_among_obstacles_moves_in_frames(
    opened: Open, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setattr("wormopt.reports.report.pictures", lambda *_, **__: iter(()))
    wo.report(SAVED / "planar_path.nc", tmp_path / "path.html")
    page = opened(tmp_path / "path.html")
    last = int(page.locator("#r0-motion .slider").get_attribute("max"))
    assert last == 79  # of 160 frames every second
    for frame in (0, 45, last):
        set_slider(page, frame)
        own = page.locator(f"#r0-motion .f{frame}").count()
        assert page.evaluate(SEEN) == [f"f{frame}"] * own
        assert own > 3
    page.locator("#r0-motion .play").click()
    page.wait_for_function("() => +document.querySelector('#r0-motion .slider').value > 3")
    page.locator("#r0-motion .play").click()
    still = opened(tmp_path / "path.html", java_script_enabled=False)
    assert set(still.evaluate(SEEN)) == {"f0"}
    assert not still.locator("#r0-motion .play").is_visible()


def test_a_page_without_scripts_can_be_read(opened: Open, pages: dict[str, Path], design: Result):
    page = opened(pages["design"], java_script_enabled=False)
    poses = page.locator("#r0-motion svg.poses")
    assert poses.is_visible()
    assert not page.locator("#r0-motion .stage").is_visible()
    assert poses.locator("circle").count() == 9 * 3
    told = page.locator("body").inner_text()
    passed = f"All {len(design.checks)} checks passed"
    for words in ("The answer", "0.82567", passed, "wormopt run design_fast_gait"):
        assert words in told
    page = opened(pages["sweep"], java_script_enabled=False)
    assert page.locator("figure.map").count() == 3
    assert all(one.is_visible() for one in page.locator("figure.map").all())
    page.locator("figure.map").first.locator('a[data-point="4"]').click()
    assert page.locator("#r0-p4 svg.poses").is_visible()  # the link opens what it leads to


def test_cells_open_their_points(opened: Open, pages: dict[str, Path]):
    page = opened(pages["sweep"])
    panel = page.locator(".panel")
    assert not panel.is_visible()
    for point, place in ((4, "worm.load = 10, gait.elongation = 0.15"),
                         (0, "worm.load = 5, gait.elongation = 0.1")):  # fmt: skip
        page.locator(f'figure.map:visible a[data-point="{point}"]').click()
        assert panel.locator("h3").text_content() == place
        assert panel.locator("svg.worm").count() == 1
        moved = f"#r0-p{point}-motion"
        assert panel.locator(moved).is_visible()
        set_slider(page, 60, moved)
    page.locator('figure.map:visible a[data-point="8"]').click()
    assert "failed: the check failed" in panel.inner_text()
    page.locator('figure.map:visible a[data-point="2"]').click()
    assert "refused: gait.elongation: too much" in panel.inner_text()
    assert panel.locator("svg").count() == 0
    assert len(page.evaluate("[...document.querySelectorAll('[id]')].map((n) => n.id)")) == len(
        set(page.evaluate("[...document.querySelectorAll('[id]')].map((n) => n.id)"))
    )


def test_another_number_is_chosen(opened: Open, pages: dict[str, Path]):
    page = opened(pages["sweep"])
    maps = page.locator("figure.map")
    assert [m.is_visible() for m in maps.all()] == [True, False, False]
    page.locator("select").select_option(label="spike load max")
    assert [m.is_visible() for m in maps.all()] == [False, True, False]


def test_arrows_go_from_cell_to_cell(opened: Open, pages: dict[str, Path]):
    page = opened(pages["sweep"])
    page.locator("select").focus()
    page.keyboard.press("Tab")  # the box that may be scrolled
    page.keyboard.press("Tab")
    where = "document.activeElement.dataset.point"
    assert page.evaluate(where) == "6"  # the upper left: largest load, least elongation
    for key, point in (("ArrowRight", "7"), ("ArrowDown", "4"), ("ArrowDown", "1"),
                       ("ArrowDown", "1"), ("ArrowLeft", "0"), ("ArrowRight", "1")):  # fmt: skip
        page.keyboard.press(key)
        assert page.evaluate(where) == point
    outline = page.evaluate("getComputedStyle(document.activeElement).outlineStyle")
    assert outline == "solid"
    page.keyboard.press("Enter")
    assert page.locator(".panel h3").text_content() == "worm.load = 5, gait.elongation = 0.15"


@pytest.mark.parametrize("name", ["design", "comparison", "sweep"])
@pytest.mark.parametrize("size", [PHONE, DESK], ids=["phone", "desk"])
def test_nothing_is_wider_than_the_screen(
    opened: Open, pages: dict[str, Path], name: str, size: dict[str, int]
):
    page = opened(pages[name], viewport=size)
    assert page.evaluate("document.documentElement.scrollWidth") <= size["width"]


def test_on_paper_there_are_poses_and_no_buttons(opened: Open, pages: dict[str, Path]):
    page = opened(pages["design"], color_scheme="dark")
    page.emulate_media(media="print")
    assert page.locator("#r0-motion svg.poses").is_visible()
    assert not page.locator(".play").is_visible()
    colour = page.evaluate("getComputedStyle(document.documentElement).backgroundColor")
    assert colour == "rgb(255, 255, 255)"


def test_dark_is_dark_and_pictures_stay_on_white(opened: Open, pages: dict[str, Path]):
    page = opened(pages["design"], color_scheme="dark")
    shade = "(name) => getComputedStyle(document.querySelector(name)).backgroundColor"
    dark = [int(part) for part in re.findall(r"\d+", page.evaluate(shade, "html"))]
    assert max(dark) < 40
    assert page.evaluate(shade, ".card") == "rgb(255, 255, 255)"


@pytest.mark.parametrize(
    ("name", "scheme"),
    [("design", "light"), ("design", "dark"), ("comparison", "dark"), ("sweep", "light")],
)
def test_no_one_is_shut_out(opened: Open, pages: dict[str, Path], name: str, scheme: str):
    """No serious violation that axe finds, with all that opens open."""
    carrier = importlib.util.find_spec("axe_playwright_python")
    if carrier is None or carrier.origin is None:
        pytest.skip("axe-playwright-python, which carries axe, is not installed")
    axe = (Path(carrier.origin).parent / "axe.min.js").read_text("utf-8")
    page = opened(pages[name], color_scheme=scheme)
    if name == "sweep":
        page.locator('figure.map:visible a[data-point="4"]').click()
    page.evaluate("document.querySelectorAll('details').forEach((one) => { one.open = true; })")
    page.evaluate(axe)
    found = page.evaluate("axe.run({exclude: ['.card svg > *']})")  # within pictures of role img
    assert found["passes"]
    bad = [
        (one["id"], one["help"], [node["html"][:160] for node in one["nodes"][:3]])
        for one in found["violations"]
        if one["impact"] in ("serious", "critical")
    ]
    assert bad == []
