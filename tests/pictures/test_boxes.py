"""Nothing that is written, no legend and no panel covers another or leaves the sheet."""

from itertools import combinations

import numpy as np
import pytest
from drawn import PICTURES, Box, areas, boxes, overlap, sample, standard
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.legend import Legend

from wormopt.pictures import figure

# What fast tests draw: the pictures with the most texts and panels.
CROWDED = {
    "bands", "film", "gait", "limits", "planar_gait", "shift", "trackers",
}  # fmt: skip


def collisions(drawn: Figure, written: list[Box]) -> list[str]:
    """What lies on what, or off the sheet."""
    panels, legends = areas(drawn)
    off = [
        f"{box.what} leaves the sheet"
        for box in (*written, *legends)
        if (box.corners < -1).any() or (box.corners[1] > [*(np.array(drawn.bbox.size) + 1)]).any()
    ]
    pairs = [*combinations(written, 2), *combinations(panels, 2), *combinations(legends, 2)]
    # texts and legends in their own panel are meant to be there
    pairs += [(box, panel) for box in (*written, *legends) for panel in panels
              if box.owner is not panel.what]  # fmt: skip
    pairs += [(legend, panel) for legend in legends for panel in panels
              if legend.owner is panel.what and not _within(legend, panel)]  # fmt: skip
    pairs += [(box, legend) for legend in legends for box in written if not _of(box, legend)]
    return off + [f"{a.what} covers {b.what}" for a, b in pairs if overlap(a, b) > 1]


def _within(inner: Box, outer: Box) -> bool:
    middle = inner.corners.mean(axis=0)
    return bool(((outer.corners[0] < middle) & (middle < outer.corners[1])).all())


def _of(box: Box, legend: Box) -> bool:
    """Whether a text is part of a legend, or is written in the same panel."""
    assert isinstance(legend.what, Legend)
    own = [text.get_text() for text in (*legend.what.get_texts(), legend.what.get_title())]
    return box.what in own


# narrow is the harder
@pytest.mark.parametrize("width", [85, pytest.param(180, marks=pytest.mark.slow)])
@pytest.mark.parametrize(
    "picture",
    [pytest.param(p, marks=() if p in CROWDED else pytest.mark.slow) for p in PICTURES],
)
def test_nothing_covers_another_or_leaves_the_sheet(picture: str, width: int):
    drawn = standard(picture) if width == 85 else figure(sample(picture), picture, width=width)
    assert drawn.get_figwidth() == pytest.approx(width / 25.4)
    assert drawn.get_figheight() < 240 / 25.4  # a page
    written = boxes(drawn)
    assert collisions(drawn, written) == []
    for box in written:
        assert 6.5 <= box.size <= 10, box.what


def test_what_covers_another_would_be_seen():
    drawn = Figure()
    drawn.text(0.5, 0.5, "one")
    drawn.text(0.51, 0.5, "other")
    drawn.text(0.99, 0.1, "outside")
    assert collisions(drawn, boxes(drawn)) == ["outside leaves the sheet", "one covers other"]
    drawn = Figure()
    axes: list[Axes] = list(np.ravel(drawn.subplots(1, 2)))
    axes[0].plot([0, 1], label="a curve with a name that is long")
    axes[0].legend(loc="center left", bbox_to_anchor=(1.0, 0.5))
    (found, *_) = [words for words in collisions(drawn, boxes(drawn)) if words.startswith("Legend")]
    assert "covers Axes" in found
