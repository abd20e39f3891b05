"""Pages of panels: labels, units, colours and facts come from what a result declares."""

from typing import Any

import numpy as np
import pytest
from matplotlib.colors import same_color
from matplotlib.figure import Figure

from wormopt.errors import UnknownNameError
from wormopt.pictures import figure
from wormopt.pictures.page import Animation, Page, Panel
from wormopt.pictures.style import LINKS, MASSES
from wormopt.quantities import Scalar, Variable
from wormopt.result import Result

TIME = np.linspace(0.0, 2.0, 5)
ROWS = np.arange(15.0).reshape(3, 5) / 1e3
RESULT = Result(
    "walk",
    "gait",
    scalars={
        "speed": Scalar(0.0031, "m s-1"),
        "ways": Scalar([0.1, None], "m"),
        "gap": Scalar(0.1),
    },
    variables=(
        Variable("time", "s", ("time",), TIME, "time from the start"),
        Variable("position", "m", ("mass", "time"), ROWS, "position of the mass, mass by mass"),
        Variable("length", "m", ("link", "time"), ROWS[:2], "link length"),
        Variable("drift", "m s-1", ("time",), ROWS[0]),
    ),
    attributes={"radius": 0.005, "held": [1, 2]},
)


def page(*units: str) -> Page:
    return Page(RESULT, 3.0, units=units)


def test_values_are_in_the_units_shown():
    shown, plain = page("mm", "mm s-1"), page()
    assert shown["position"] == pytest.approx(1e3 * ROWS)
    assert shown["ways"] == [100.0, None]
    assert (shown.unit("speed"), plain.unit("speed")) == ("mm s-1", "m s-1")
    assert shown.length("radius") == pytest.approx(5.0)
    assert plain["held"] == [1, 2]
    assert "position" in plain
    assert plain.get("way") is None
    with pytest.raises(
        UnknownNameError, match="no scalar or variable 'speeds'; did you mean"
    ) as no:
        _ = plain["speeds"]
    assert isinstance(no.value, KeyError)


def test_axes_label_themselves():
    above, below = page("mm").rows(1, 1)
    above.curves("time", "position")
    below.curves("time", "length", words="$l_j$")
    assert above.axes.get_ylabel() == "position of the mass (mm)"
    assert below.axes.get_ylabel() == "link length $l_j$ (mm)"
    assert above.axes.get_xlabel() == ""  # its ticks have no numbers
    assert below.axes.get_xlabel() == "time $t$ (s)"
    alone = page().panel()
    alone.curve("time", "drift")
    alone.curve("time", "length", pick=0, words="not told twice")
    assert alone.axes.get_ylabel() == "drift (m\xa0s$^{-1}$)"
    alone.label(y="speed", of="speed")
    assert alone.axes.get_ylabel() == "speed (m\xa0s$^{-1}$)"


@pytest.mark.parametrize(("name", "palette", "first"), [
    ("position", MASSES, "mass 0 (head)"), ("length", LINKS, "link 0"),
])  # fmt: skip
def test_curves_have_the_colours_of_what_they_are(name: str, palette: Any, first: str):
    panel = page().panel()
    panel.curves("time", name)
    lines = panel.axes.get_lines()
    assert all(same_color(line.get_color(), own) for line, own in zip(lines, palette, strict=False))
    assert lines[0].get_label() == first
    assert [np.asarray(line.get_ydata()).tolist() for line in lines] == RESULT[name].values.tolist()


def test_palettes_of_one_picture_have_no_colour_in_common():
    """As written, and for three masses, two links and two joints also to the eye."""
    assert not {*MASSES} & {*LINKS}
    drawn = page().panel()
    drawn.curves(TIME, ROWS[:2], what="joint")
    drawn.curves(TIME, ROWS[:2], what="link")
    assert len({line.get_color() for line in drawn.axes.get_lines()}) == 4


def test_limits_are_grey_where_all_share_them():
    shared, own = page().rows(1, 1)
    shared.limits([(0.0, 1.0), (0.0, 1.0)])
    own.limits([(0.0, 1.0), (0.0, 2.0)])
    assert len(shared.axes.get_lines()) == 2
    assert [entry.get_label() for entry in shared.labelled()] == ["limit"]
    assert [line.get_color() for line in own.axes.get_lines()] == [*LINKS[:1] * 2, *LINKS[1:2] * 2]
    shared.limits([])
    assert len(shared.labelled()) == 1


def test_rests_and_glides_are_filled():
    panel = page().panel()
    panel.rests("time", np.array([[1, 1, 0, 0, 0], [0, 0, 0, 1, 1]]))
    spans = [path.get_extents().bounds for bars in panel.axes.collections
             for path in bars.get_paths()]  # fmt: skip
    assert [(x, x + width) for x, _, width, _ in spans] == [(0.0, 0.5), (1.5, 2.0)]
    assert [entry.get_label() for entry in panel.labelled()] == ["rests"]  # no glide lasts
    longer = page().panel()
    longer.rests("time", np.array([[1, 0, 0, 1, 1]]))
    assert [entry.get_label() for entry in longer.labelled()] == ["rests", "worm glides"]


def test_one_legend_names_everything_once():
    drawn = page()
    above, below = drawn.rows(1, 1)
    for panel in (above, below):
        panel.curve("time", "drift", "drift")
    below.entry("proxy")
    (legend,) = drawn.legend().legends
    assert [text.get_text() for text in legend.get_texts()] == ["drift", "proxy"]


def test_facts_leave_out_what_is_unknown():
    drawn = page("mm s-1")
    drawn.facts("to scale", "", speed="mean speed", gap=("", "%"), way="way", ways="ways")
    (text,) = drawn.drawn.texts
    assert text.get_text() == "to scale; mean speed 3.1\xa0mm\xa0s$^{-1}$; gap 10\xa0%"


def test_cells_lie_around_their_points():
    panel = page("mm").panel()
    panel.map("time", [0.0, 1.0, 2.0], "position", about=5.0)
    (mesh,) = panel.axes.collections
    assert panel.axes.get_xlim() == (-0.25, 2.25)
    assert panel.axes.get_ylim() == (-0.5, 2.5)
    low, high = mesh.get_clim()
    assert low + high == pytest.approx(10.0)
    assert high == pytest.approx(14.0)
    assert panel.page.drawn.axes[1].get_ylabel() == "position of the mass (mm)"


def test_an_animation_keeps_its_stage():
    def stage(result: Result) -> Page:
        drawn = Page(result, 2.0)
        drawn.panel().level(0.0, "ground")
        return drawn

    def pose(panel: Panel, frame: int) -> None:
        panel.curve([frame], panel.page["drift"][:1], marker="o")

    moving = Animation(4, stage, pose)
    drawn = moving(RESULT)
    assert isinstance(drawn, Figure)
    moving.show(drawn, 3)
    ground, worm = drawn.axes[0].get_lines()
    assert ground.get_label() == "ground"
    assert np.asarray(worm.get_xdata()).tolist() == [3]


def test_labels_that_are_longer_than_their_axes_are_broken(monkeypatch: pytest.MonkeyPatch):
    def composed(result: Result) -> Figure:
        drawn = Page(result, 2.0, 2.0)
        for panel in drawn.rows(1, 1, 1):
            panel.label(y="a label with very many words, which no panel has room for")
        drawn.panels[-1].label("short")
        return drawn.drawn

    monkeypatch.setattr("wormopt.pictures._composer", lambda *_: composed)
    drawn = figure(RESULT, "any", width=85)
    drawn.draw_without_rendering()
    for axes in drawn.axes:
        assert axes.get_ylabel().count("\n") >= 2
    assert drawn.axes[-1].get_xlabel() == "short"
