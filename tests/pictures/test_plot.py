"""Pictures: labelled with units, honest about failure, legible for every n."""

import dataclasses
import re
from pathlib import Path

import numpy as np
import pytest
from drawn import (
    PICTURES,
    QUICK,
    SI,
    boxes,
    composed,
    real,
    sample,
    standard,
    two_trackers,
    without,
)
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.colors import same_color
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Rectangle
from PIL import Image
from places import SAVED

import wormopt as wo
from tests.results.make import SCENES as SAVED_SCENES
from wormopt.pictures import draw, figure
from wormopt.pictures.style import LINKS, stretches
from wormopt.quantities import Scalar
from wormopt.result import Result

THREE = (
    'tracker=[{feedback="filter", tube_radius=0.2, growth=1e4, filter_start=0.0}, '
    '{feedback="derivative", tube_radius=0.2, growth=1e4}, {feedback="funnel", '
    "funnel={start=2.0, end=0.2, time=0.5}, rate_funnel={start=20.0, end=5.0, time=0.5}}]"
)


def crawl(trackers: int = 2, links: int = 2) -> Result:
    """A chain of so many links under two trackers of `track_sine`, or a funnel besides."""
    more = (THREE,) if trackers == 3 else ()
    return real(*two_trackers(2.0 if links == 2 else 0.1, links), *more)


def texts(drawn: Figure) -> str:
    """What stands above a picture: title, failure, facts."""
    above = " ".join(text.get_text() for text in drawn.texts)
    return re.sub(r"\s+", " ", above)


def entries(drawn: Figure) -> list[str]:
    """Words of all legends."""
    legends = [*drawn.legends, *(axes.get_legend() for axes in drawn.axes)]
    return [text.get_text() for found in legends if found for text in found.get_texts()]


# One of each way to draw: lines, bars, colours, shades, outlines. All others are drawn, though not
# written, where their texts are looked at.
WRITTEN = {"gait", "limits", "certificate", "bands", "basins", "segment_shapes", "motion"}


@pytest.mark.parametrize(
    "picture",
    [
        pytest.param(p, marks=() if p in WRITTEN else pytest.mark.slow)
        for p in PICTURES
        if p != "animation"
    ],
)
def test_every_picture_is_written(picture: str, tmp_path: Path):
    path = tmp_path / f"{picture}.png"
    draw(sample(picture), picture, path, width=85)
    with Image.open(path) as image:
        # as wide as a column; as tall as what it shows: three bars are a flat picture
        assert image.width > 500
        assert image.height > image.width / 5
        assert len(image.convert("RGB").getcolors(1_000_000) or []) > 20
    assert list(tmp_path.iterdir()) == [path]


@pytest.mark.parametrize(
    "objective", ["speed", pytest.param("peak_spike_load", marks=pytest.mark.slow)]
)
def test_bars_of_limits_tell_which_way_helps(objective: str):
    changes = [SI, *QUICK, f"objective={{minimise={objective!r}, speed=0.5}}"]
    result = real("design_fast_gait", *(changes if objective != "speed" else []))
    known, elasticity = result.attributes["limits"], result["limit_elasticity"].values
    binding = np.argsort(-abs(elasticity))[: np.sum(abs(elasticity) > 1e-6)]
    known["one_sided"] = [name == "worm.load" for name in known["name"]]
    axes = figure(result, "limits").axes[0]
    bars = [bar for bar in axes.patches if isinstance(bar, Rectangle)]
    assert [bar.get_width() for bar in bars] == elasticity[binding].tolist()
    widths = {round(bar.get_width(), 3) for bar in bars}
    assert widths >= ({0.789, 0.211, 0.104} if objective == "speed" else {0.829, -0.332})
    raised, lowered = LINKS[::3][:2] if objective == "speed" else LINKS[3::-3]
    for bar in bars:
        colour = raised if bar.get_width() > 0 else lowered
        assert same_color(bar.get_facecolor(), colour)
    ticks = [text.get_text() for text in axes.get_yticklabels()]
    assert ticks[:1] == (
        ["gait.rate = 1 m\xa0s$^{-1}$"] if objective == "speed" else ["worm.load = 5 N"]
    )
    assert "gait.acceleration = 20 m\xa0s$^{-2}$" in ticks
    marked = [text.get_text() for text in axes.texts]
    told = [f"{elasticity[k]:+.3g}{' *' * known['one_sided'][k]}" for k in binding]
    assert marked == [text.replace("-", "−") for text in told]
    narrow = figure(result, "limits", width=85)
    texts_in = [(str(box.what), box.corners) for box in boxes(narrow)]
    numbers = [c for text, c in texts_in if re.fullmatch(r"[+−][\d.]+( \*)?", text)]
    beside = [c for c in numbers if c[0, 0] > narrow.axes[0].bbox.x1]  # clear of bars and names
    assert len(beside) == len(told)
    notes = texts(figure(result, "limits"))
    assert "influence: gait.length.shortest, gait.length.longest" in notes
    assert "0: gait.sigma_margin" in notes


def wave(links: int) -> Result:
    """A block wave of `uphill_gait` with so many links; from three on the worm glides."""
    return real("uphill_gait", f"worm.links={links}", "gait.resting=1")


@pytest.mark.parametrize(
    "links", [1, *(pytest.param(n, marks=pytest.mark.slow) for n in range(2, 9))]
)
def test_pictures_for_every_number_of_links(links: int):
    for picture in ("gait", "motion", "spikes", "animation"):
        drawn = figure(wave(links), picture)
        drawn.draw_without_rendering()
        assert drawn.axes


@pytest.mark.parametrize("picture", PICTURES)
def test_axes_carry_symbols_and_units_and_links_and_masses_count_from_0(picture: str):
    result, drawn = sample(picture), composed(picture)
    last = [a for a in drawn.axes if a.get_visible() and a.get_label() != "<colorbar>"][-1]
    # waveforms are always dimensionless, and gains are told by the scene's numbers
    plain = {"waveform": "time $t$", "margins": "gain $k$"}
    assert last.get_xlabel().endswith(plain.get(picture, ")"))
    assert "$" in last.get_xlabel()
    first = [axes for axes in drawn.axes if (at := axes.get_subplotspec()) and at.is_first_col()]
    labelled = [axes.get_ylabel() for axes in first if len(axes.get_yticks())]
    assert all(labelled)
    # no link and no mass has a number that only counting from 1 gives
    words = " ".join([*entries(drawn), *(a.get_xlabel() + a.get_ylabel() for a in drawn.axes)])
    for what in ("link", "mass"):
        counts = [n for v in result.variables for d, n in zip(v.dims, v.values.shape, strict=True)
                  if d == what]  # fmt: skip
        named = {int(number) for number in re.findall(rf"\b{what} (\d+)", words)}
        assert not named or (max(named) < counts[0] and (len(named) == 1 or min(named) == 0))


def test_axes_without_units_carry_symbols_alone():
    bare = figure(real("fast_gait"), "gait")
    assert bare.axes[0].get_ylabel() == "link length $l_j$"


def test_reversals_are_drawn_without_an_exact_motion_too():
    found = sample("reversals")
    lost = without(found, "event_", "center_velocity")
    averaged = tuple(v for v in found.variables if v.name == "center_velocity_averaged")
    lost = dataclasses.replace(lost, variables=(*lost.variables, *averaged))
    whole, lost = (figure(result, "reversals").axes for result in (found, lost))
    assert len(whole[1].get_lines()) == len(lost[1].get_lines()) + 1
    dots = [line for line in whole[0].get_lines() if line.get_marker() == "o"]
    at = [float(np.ravel(dot.get_xdata())[0]) for dot in dots]
    assert at == found["event_share"].values.tolist()
    # three masses, a third of a period apart, each reverses twice
    assert at[2:] == pytest.approx([share + 1 / 3 for share in at[:-2]], abs=1e-3)
    assert not [line for line in lost[0].get_lines() if line.get_marker() == "o"]
    legend = whole[1].get_legend()
    assert legend
    labels = [text.get_text().replace("\n", " ") for text in legend.get_texts()]
    assert labels == ["exact", "averaged, order 1", "steady", "steady, unstable"]


def test_velocities_in_a_channel_show_what_was_measured_where_it_was():
    result = sample("channel_velocity")
    nothing = {name: Scalar([]) for name in result.scalars if name.startswith("measured")}
    nothing |= {name: Scalar(None) for name in ("valid_below", "stops_above")}
    unseen = dataclasses.replace(result, scalars=dict(result.scalars) | nothing)
    told, bare = (figure(r, "channel_velocity").axes[0] for r in (result, unseen))
    labels = told.get_legend_handles_labels()[1]
    assert labels[:3] == [
        "sine: 1.457 mm per switch", "beam: 1.431 mm per switch", "line: 1.261 mm per switch"
    ]  # fmt: skip
    assert labels[3].startswith("sample 1: measured")
    assert labels[3].endswith(": 78.9\xa0mm\xa0s$^{-1}$")
    assert labels[5:] == [
        r"eq. 32 not valid: $n \geq$ 100",
        "stands still above 950, from the text",
    ]
    first, second = (line for line in told.get_lines() if line.get_marker() not in ("None", ""))
    assert np.ravel(first.get_xydata()) == pytest.approx([100.0, 78.9])
    assert np.ravel(second.get_xydata()) == pytest.approx([250.0, 100.0])
    (shade,) = told.patches
    assert shade.get_window_extent().x0 == pytest.approx(told.transData.transform((100, 1))[0])
    assert len(bare.get_legend_handles_labels()[1]) == 3


def test_a_body_in_a_channel_is_drawn_as_thick_as_it_is():
    result = sample("segment_shapes")
    drawn = figure(result, "segment_shapes")
    above, _, below = drawn.axes
    outline = next(p for p in above.patches if p.get_label() == "body, rod")
    corners = np.asarray(outline.get_path().vertices)
    thick, wide = 1e3 * result.scalars["body"].value, 1e3 * result.scalars["channel"].value
    assert (thick, wide) == (4.0, 11.0)
    # about the centre line of the rod, at right angles to it
    middle = 1e3 * result["y"].values[-1]
    half = thick / 2 * np.cos(result["theta"].values[-1])
    assert corners[:, 1].min() == pytest.approx((middle - half).min(), abs=1e-6)
    assert corners[:, 1].max() == pytest.approx((middle + half).max(), abs=1e-6)
    assert corners[:, 1].min() > -0.05  # between the walls, but for what they give
    assert corners[:, 1].max() < wide + 0.05
    styles = [line.get_linestyle() for line in above.get_lines()]
    assert styles[:3] == ["--"] * 3
    assert "rod at rest at 4600 ampere-turns" in texts(drawn)
    assert len(below.get_lines()) == 5  # distances of the others from the rod


def test_a_branch_is_dashed_where_it_is_not_stable_and_its_fold_marked():
    result = sample("resonance")
    above = figure(result, "resonance").axes[0]
    labels = {line.get_label(): line.get_linestyle() for line in above.get_lines()}
    assert labels["average"] == "-"
    assert labels["average, unstable"] == "--"
    (fold,) = result.scalars["delta_fold"].value
    assert [text.get_text() for text in above.texts] == [f"fold {fold:.4g}"]


def test_fields_of_a_film_are_shown_over_their_mean():
    result = sample("film")
    fields = next(a for a in figure(result, "film").axes if a.get_ylabel().startswith("$H^2"))
    for line in fields.get_lines():
        assert np.mean(np.asarray(line.get_ydata())[:-1]) == pytest.approx(1.0)
    told = [text.split(": ") for text in fields.get_legend_handles_labels()[1]]
    assert [float(delta) for delta, _ in told] == pytest.approx(result["field_delta"].values)
    means = [float(mean.replace("·10$^{", "e").strip("}$")) for _, mean in told]
    assert means == pytest.approx(result["field_curves"].values[:, :-1].mean(axis=1), rel=1e-3)


def test_a_map_of_films_names_its_outcomes_and_marks_unstable_waves():
    drawn = figure(sample("basins"), "basins")
    assert [text.get_text() for text in drawn.legends[0].get_texts()] == [
        "takes the wave", "another steady film", "still moves", "breaks", "not resolved"
    ]  # fmt: skip
    marked = {t.get_text(): t.get_fontproperties().get_weight() for t in drawn.axes[0].texts}
    assert marked["+0.50"] == marked["+0.47"] == "bold"
    assert {marked[stable] for stable in ("−0.24", "−0.31", "−1.62", "−0.44")} == {"normal"}
    assert "bold where it is unstable" in texts(drawn)


def test_a_course_marks_where_the_film_broke():
    result = sample("basins")  # whose film breaks
    course = figure(result, "forward").axes[0]
    (cross,) = (line for line in course.get_lines() if line.get_marker() == "x")
    at, when = (result.scalars[f"broke_{name}"].value for name in ("xi", "time"))
    assert np.ravel(cross.get_xydata()) == pytest.approx([at / np.pi, when / (2 * np.pi)])
    assert 0 < when < 1


@pytest.mark.slow
def test_limits_are_thin_dashed_lines():
    result = sample("limits")
    drawn = figure(result, "gait")
    lengths, rates, accelerations, _ = drawn.axes
    assert "limit" in entries(drawn)
    for axes, limits in (
        (lengths, {0.7, 1.3}), (rates, {-1.0, 1.0}), (accelerations, {-20.0, 20.0})
    ):  # fmt: skip
        dashed = thin(axes)
        drawn_at = sorted({float(np.ravel(line.get_ydata())[0]) for line in dashed})
        assert drawn_at == pytest.approx(sorted(limits), rel=1e-12)
    ranges = "gait.length=[[0.7, 1.3], [0.6, 1.4]]"
    uneven = "gait.rate={contraction=[1.0, 1.2], extension=[2.0, 2.2]}"
    apart = figure(real("design_fast_gait", SI, *QUICK, ranges, uneven), "gait")
    for axes, limits in (
        (apart.axes[0], [0.7, 1.3, 0.6, 1.4]),
        (apart.axes[1], [-1, 2, -1.2, 2.2]),
    ):
        dashed = thin(axes)
        assert [float(np.ravel(line.get_ydata())[0]) for line in dashed] == pytest.approx(
            limits, rel=1e-12
        )
    assert len(figure(sample("gait"), "gait").axes[0].get_lines()) == 2
    assert "limit" not in entries(figure(sample("gait"), "gait"))


def thin(axes: Axes) -> list[Line2D]:
    """Lines that are level, from one side to the other: limits."""
    return [line for line in axes.get_lines() if len(np.ravel(line.get_xdata())) == 2]


@pytest.mark.slow
def test_curves_that_cover_each_other_are_told_apart_in_grey():
    """Every link of a gait has its own pair of colour and dashes, up to eight."""
    for links in (2, 8):
        lengths = figure(wave(links), "gait").axes[0]
        own = [(str(line.get_color()), str(line._dash_pattern)) for line in lengths.get_lines()]  # pyright: ignore
        assert len(set(own)) == links


def test_motion_shows_two_periods_and_the_masses_at_rest():
    """Of gait (15) the masses 1, 0 and 2 rest for a third of the period each; it advances 1.2."""
    (axes,) = figure(sample("motion"), "motion").axes
    heavy = [c for c in axes.collections if isinstance(c, LineCollection)]
    spans = [
        [np.asarray(path.vertices)[:, 1].tolist() for path in lines.get_paths()] for lines in heavy
    ]
    for turn, of_masses in ((0, spans[:3]), (1, spans[3:])):
        for (span,), start in zip(of_masses, (1 / 3, 0.0, 2 / 3), strict=True):
            assert span == pytest.approx([turn + start, turn + start + 1 / 3])
    assert np.ravel(axes.get_lines()[3].get_xdata())[0] == pytest.approx(1.2)


@pytest.mark.parametrize(
    "links", [pytest.param(n, marks=pytest.mark.slow) for n in (1, 2, 8, 9, 30)]
)
def test_pictures_of_chains_for_every_number_of_links(links: int):
    for picture in ("trackers", "motion"):
        drawn = figure(crawl(3 if links == 2 else 2, links), picture)
        drawn.draw_without_rendering()
    shown = [text.get_text() for text in drawn.legends[0].get_texts()]
    assert shown[-1] == "rests"
    assert len(shown) == (links + 2 if links <= 8 else 3)


def test_trackers_stand_side_by_side_on_the_same_scales():
    result = crawl(3)
    drawn = figure(result, "trackers")
    axes = np.array(drawn.axes[:15]).reshape(5, 3)
    names = ["tracker (14)", "tracker (13)", "funnel controller"]
    assert [a.get_title(loc="left") for a in axes[0]] == names
    for row in axes:
        assert len({a.get_ylim() for a in row}) == 1
        assert row[0].get_ylabel()
    # the strip is lambda wide on either side of the reference
    strip = np.asarray(axes[0, 0].collections[0].get_paths()[0].vertices)
    reference = result["reference"].values[0]
    assert strip[:, 1].min() == pytest.approx(reference.min() - 0.2)
    assert strip[:, 1].max() == pytest.approx(reference.max() + 0.2)


def test_motions_of_simulations_mark_each_tracker_s_own_rests():
    result = crawl(2)
    axes = figure(result, "motion").axes
    rests = {name: result[f"rest_{name}"].values for name in ("start", "end", "contact", "tracker")}
    found = []
    for tracker in (0, 1):
        heavy = [c for c in axes[tracker].collections if isinstance(c, LineCollection)]
        paths = [np.asarray(path.vertices)[:, 1] for lines in heavy for path in lines.get_paths()]
        own = rests["tracker"] == tracker
        told = set(zip(rests["start"][own], rests["end"][own], strict=True))
        found.append({(path[0], path[-1]) for path in paths})
        # those shorter than a point are not drawn
        assert {(a, b) for a, b in told if b - a > 0.01} <= found[-1] <= told
    assert found[0] != found[1]


def test_bands_hold_the_median():
    result = sample("bands")
    drawn = figure(result, "bands")
    lines = drawn.axes[0].get_lines()
    medians = [np.asarray(line.get_ydata()) for line in lines if line.get_linestyle() == "-"]
    assert result["quantile"].values[2] == 0.5
    assert medians[0] == pytest.approx(result["length_band"].values[0, 2, 0])


@pytest.mark.slow
@pytest.mark.parametrize("contacts", [1, 3, 12])
def test_signals_show_rests_as_shades_or_as_a_band(contacts: int):
    if contacts == 1:
        result = sample("signals")
    else:
        places = [2.0 * (contacts - 1 - i) for i in range(contacts)]
        changes = [f"worm.links={contacts - 1}", f"start.position={places}", "time.end=1.0"]
        gait = 'actuation={law="gait", gait={shape="sine", period=1.0, amplitude=0.2}}'
        result = real("spiked_chain", *changes, gait, "tolerance.recheck=false")
    drawn = figure(result, "signals")
    drawn.draw_without_rendering()
    signals = result.attributes["signals"]
    assert len(drawn.axes) == len(signals) + (contacts > 1)
    assert drawn.axes[2].get_ylabel().startswith(signals[2].replace("_", "\n"))
    assert ("at rest" in entries(drawn)) == (contacts == 1)


def test_failed_results_are_marked():
    failed = dataclasses.replace(sample("gait"), status="failed", reason="spike_load is too low")
    for picture in ("gait", "animation"):
        for title in (True, False):
            drawn = figure(failed, picture, title=title)
            assert "failed: spike_load is too low" in texts(drawn)
            assert (failed.title in texts(drawn)) == title
        assert "failed" not in texts(figure(sample(picture), picture))


def test_a_front_shows_what_was_not_accepted_hollow():
    found = sample("front")
    assert found["front_accepted"].values.tolist() == [1, 1, 1, 1]
    lost = dataclasses.replace(found["front_accepted"], values=np.array([1, 1, 0, 1]))
    variables = (*without(found, "front_accepted", "front_order").variables, lost)
    (axes,) = figure(dataclasses.replace(found, variables=variables), "front").axes
    drawn = {line.get_label(): line for line in axes.get_lines()}
    good, bad = drawn["best found"], drawn["not accepted"]
    speed = found["front_speed"].values
    assert np.asarray(good.get_xdata()).tolist() == speed[[0, 1, 3]].tolist()
    assert np.asarray(bad.get_xdata()).tolist() == speed[[2]].tolist()
    assert bad.get_markerfacecolor() == "none"
    assert axes.get_ylabel() == r"largest load on a spike, max $\lambda_i$ (N)"


def test_letters_without_a_glyph_do_no_harm(tmp_path: Path):
    draw(dataclasses.replace(sample("front"), title="蠕虫 λ"), "front", tmp_path / "front.png")
    assert (tmp_path / "front.png").stat().st_size > 1000


def test_without_title_a_picture_is_smaller_and_says_neither_title_nor_facts():
    result = sample("limits")
    whole, bare = (figure(result, "gait", title=title) for title in (True, False))
    assert f"{result.title} mean speed 0.8257\xa0m".replace("\xa0", " ") in texts(whole)
    assert texts(bare) == ""
    assert whole.get_figheight() > bare.get_figheight()
    assert figure(result, "gait", height=120).get_figheight() == pytest.approx(120 / 25.4)
    assert figure(result, "gait", height=120, title=False).get_figheight() == pytest.approx(
        120 / 25.4
    )
    for width, height in ((20, None), (None, 3000), (np.nan, None)):
        with pytest.raises(ValueError, match="in mm, from 30 to 2000"):
            figure(result, "gait", width=width, height=height)


@pytest.mark.slow
def test_facts_are_rounded_and_in_the_units_of_the_picture():
    told = texts(figure(sample("steps"), "steps"))
    assert "travel per step 5 µm" in told
    assert "mean speed 3.167 mm s$^{-1}$ ideal 3.333 mm s$^{-1}$" in told
    assert "10$^{-5}$ N m$^{2}$" in texts(figure(sample("membrane"), "membrane"))
    for picture in PICTURES:
        found = standard(picture)
        digits = re.findall(r"\d[\d.]*", texts(found).partition(sample(picture).title)[2])
        assert all(len(number.replace(".", "").lstrip("0")) <= 4 for number in digits), picture


def test_stretches():
    time = np.array([0.0, 1.0, 1.0, 2.0, 3.0])
    holds = np.array([True, True, False, True, True])
    assert stretches(time, holds) == [(0.0, 1.0), (2.0, 3.0)]
    assert stretches(time, np.array([False, True, True, False, False])) == []


def test_the_bound_of_every_gait_is_drawn_over_time():
    result = sample("certificate")
    drawn = figure(result, "certificate")
    (axes,) = drawn.axes
    assert "proven bound for all gaits" in entries(drawn)
    assert np.asarray(axes.lines[0].get_ydata())[-1] == result.scalars["bound"].value
    told = texts(figure(result, "gait"))  # nearer than the ceiling, which is 1 here
    assert "proven bound 0.8" in told
    assert "no gait is faster" not in told


@pytest.mark.parametrize("name", SAVED_SCENES)
def test_saved_results_can_be_made_anew(name: str):
    assert wo.Result.load(SAVED / f"{name}.nc").status in ("ok", "unchecked")
    wo.load_scene(name, SAVED_SCENES[name])
