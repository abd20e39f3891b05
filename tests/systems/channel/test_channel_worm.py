"""Body in a channel: closed forms (32)-(36), scenes "channel-worm" and "segment-shapes"."""

import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import casadi as ca
import msgspec
import numpy as np
import pytest
from outcomes import failed_checks, refusals, value
from places import DOCS
from scipy.integrate import quad
from scipy.special import ellipe

import wormopt as wo
from wormopt.cli import main
from wormopt.errors import ArgumentError, SolveError, UnknownNameError
from wormopt.result import Result
from wormopt.study import load_scene
from wormopt.systems.channel import channel_worm, segments
from wormopt.systems.channel.closed_forms import (
    SHAPES,
    ChannelWorm,
    segment_count,
)
from wormopt.systems.channel.rod import distances, graph_curve
from wormopt.systems.channel.samples import SAMPLES
from wormopt.systems.channel.segments import SLEEVE_RISE, exact_elastica

SAMPLE_1, SAMPLE_2, CAPSULE = map(ChannelWorm.of, ("sample-1", "sample-2", "capsule"))
# mm, by sympy to 20 digits in test_errata.py and of the same integrals; counts by the
# nearest integer; velocities in mm per switch.
REFERENCE = [
    (SAMPLE_1, (12.550570, 12.504597, 12.206556), (4, 4, 4), (1.457469, 1.431198, 1.260889)),
    (SAMPLE_2, (11.663275, 11.629182, 11.412712), (6, 6, 7), (1.108850, 1.086122, 0.988899)),
    (CAPSULE, (11.944523, 11.906314, 11.661904), (6, 6, 6), (1.296349, 1.270876, 1.107936)),
]


def run(name: str, *changes: str) -> Result:
    return wo.run(load_scene(name, changes))


def shaped(*changes: str) -> Result:
    """Shapes of a segment without the rod, which test_rod_rest.py looks at."""
    scene = load_scene("segment_shapes", changes)
    return wo.run(replace(scene, table=msgspec.structs.replace(scene.table, rod=None)))


# -- closed forms ---------------------------------------------------------------------------------


@pytest.mark.parametrize(("worm", "lengths", "counts", "velocities"), REFERENCE)
def test_bodies_of_the_chapter(worm: ChannelWorm, lengths: Any, counts: Any, velocities: Any):
    assert [1e3 * worm.arc_length(s) for s in SHAPES] == pytest.approx(lengths, abs=1e-6)
    assert tuple(worm.count(s) for s in SHAPES) == counts
    found = [1e3 * worm.velocity_per_frequency(s) for s in SHAPES]
    assert found == pytest.approx(velocities, abs=1e-6)


def test_the_count_as_printed_and_what_it_changes():
    assert [replace(SAMPLE_1, rule="floor").count(s) for s in SHAPES] == [3, 3, 3]
    assert [replace(SAMPLE_2, rule="floor").count(s) for s in SHAPES] == [6, 6, 6]
    assert [replace(CAPSULE, rule="floor").count(s) for s in SHAPES] == [6, 6, 6]
    assert SAMPLE_1.missing_length("sine") == pytest.approx(4 * 12.550570e-3 - 48e-3, abs=1e-8)
    assert all(CAPSULE.missing_length(s) < 0 for s in SHAPES)


def test_counts_of_halves_and_of_arrays():
    assert segment_count(25.0, 10.0) == 3
    assert segment_count(24.9, 10.0) == 2
    assert segment_count(29.9, 10.0, "floor") == 2
    assert segment_count(np.array([24.0, 26.0]), 10.0).tolist() == [2.0, 3.0]
    x = ca.SX.sym("x")
    count = ca.Function("count", [x], [segment_count(x, 10.0)])
    assert [float(count(length)) for length in (24.0, 25.0)] == [2.0, 3.0]


def test_bodies_of_expressions():
    """Derivatives of the velocity by the body's thickness, against differences."""
    body = ca.SX.sym("body")
    worm = ChannelWorm(10e-3, 11e-3, body, 48e-3, 5e4)
    for shape in SHAPES:
        speed = worm.velocity_per_frequency(shape)
        both = ca.Function("both", [body], [speed, ca.gradient(speed, body)])
        found = [float(number) for number in both(4e-3)]
        ends = [
            replace(SAMPLE_1, body=4e-3 + step).velocity_per_frequency(shape)
            for step in (-1e-8, 1e-8)
        ]
        slope = (ends[1] - ends[0]) / 2e-8
        assert found[0] == pytest.approx(SAMPLE_1.velocity_per_frequency(shape), rel=1e-12)
        assert found[1] == pytest.approx(slope, rel=1e-6)
    stiffness = ca.Function("stiffness", [body], [worm.bending_stiffness])
    assert float(stiffness(4e-3)) == pytest.approx(5e4 * math.pi * 2e-3**4 / 4, rel=1e-14)
    assert CAPSULE.bending_stiffness is None


@pytest.mark.parametrize("name", ["pitch", "channel", "body", "length", "youngs_modulus"])
@pytest.mark.parametrize("bad", [0.0, -1.0, math.nan, math.inf, "1", True])
def test_numbers_that_are_none_are_refused(name: str, bad: Any):
    with pytest.raises(ArgumentError, match=f"{name} must be a number above 0"):
        replace(SAMPLE_1, **{name: bad})


def test_bodies_that_do_not_fit_are_refused():
    for body in (11e-3, 12e-3):
        with pytest.raises(ArgumentError, match="body must be less than channel"):
            replace(SAMPLE_1, body=body)
    with pytest.raises(ArgumentError, match="shorter than the pitch"):
        replace(SAMPLE_1, length=9.9e-3)
    assert replace(SAMPLE_1, length=10e-3).length == SAMPLE_1.pitch
    with pytest.raises(ArgumentError, match="too steep"):
        replace(SAMPLE_1, channel=0.2)
    with pytest.raises(ArgumentError, match="'nearest' or 'floor'"):
        replace(SAMPLE_1, rule="ceil")
    with pytest.raises(UnknownNameError, match="no body 'sample-3'"):
        ChannelWorm.of("sample-3")


# -- distances ------------------------------------------------------------------------------------


def test_distances_of_curves():
    """An arc of a circle and its chord, both by the share of their length."""
    R, top = 2.0, 0.6
    arc = graph_curve(
        lambda x: np.sqrt(R * R - (x - R * math.sin(top)) ** 2), 2 * R * math.sin(top)
    )
    flat = graph_curve(lambda x: R * math.cos(top) + 0 * x, 2 * R * math.sin(top))
    assert arc.length == pytest.approx(2 * R * top, rel=1e-13)

    def square(a: float) -> float:
        return R * R * ((math.sin(a) - a / top * math.sin(top)) ** 2
                        + (math.cos(a) - math.cos(top)) ** 2)  # fmt: skip

    largest, mean = distances(arc, flat)
    assert largest == pytest.approx(max(map(math.sqrt, map(square, np.linspace(0, top, 100_001)))))
    assert mean == pytest.approx(math.sqrt(quad(square, 0, top)[0] / top), rel=1e-12)
    assert distances(flat, arc) == pytest.approx((largest, mean), rel=1e-13)
    assert distances(arc, arc) == (0.0, 0.0)


# -- scenes ---------------------------------------------------------------------------------------


def test_figure_19():
    result = run("fig19_channel_worm")
    assert result.status == "ok"
    assert value(result, "shapes") == ["sine", "beam", "line"]
    assert value(result, "segments") == [4, 4, 4]
    assert value(result, "direction") == -1
    per = [1.457469e-3, 1.431198e-3, 1.260889e-3]
    assert value(result, "velocity_per_frequency") == pytest.approx(per, abs=1e-9)
    assert value(result, "measured_frequency") == [100.0, 250.0]
    assert value(result, "measured_velocity") == pytest.approx([0.0789, 0.1], rel=1e-12)
    first, second = value(result, "velocity_at")
    assert first == pytest.approx([100 * v for v in per], abs=1e-7)
    assert second == pytest.approx([250 * v for v in per], abs=1e-6)
    # the beam line is 1.81 times what was measured, although the text has them match
    assert value(result, "velocity_over_measured")[0][1] == pytest.approx(1.8139, abs=1e-4)
    assert (value(result, "valid_below"), value(result, "stops_above")) == (100.0, 950.0)
    velocity = result["velocity"].values
    assert velocity[:, 0] == pytest.approx([5 * v for v in per], abs=1e-8)
    assert velocity[:, -1] == pytest.approx([1000 * v for v in per], abs=1e-6)
    longer = [text for text in result.trust["warnings"] if "exceed the body of 48 mm" in text]
    assert len(longer) == 3
    assert result.trust["recheck_error"] < 1e-13
    printed = run("fig19_channel_worm", 'worm.count="floor"')
    assert value(printed, "segments") == [3, 3, 3]
    assert not any("exceed" in text for text in printed.trust["warnings"])


def test_figure_20():
    result = run("fig20_capsule")
    assert result.status == "ok"
    assert value(result, "arc_length")[2] == pytest.approx(math.sqrt(136) * 1e-3, rel=1e-14)
    assert value(result, "velocity_at")[0][2] == pytest.approx(55.3968e-3, abs=1e-7)
    assert value(result, "velocity_over_measured")[0][2] == pytest.approx(0.99635, abs=1e-5)
    assert (value(result, "valid_below"), value(result, "stops_above")) == (50.0, 700.0)


def test_marks_belong_to_the_body_as_it_was():
    changed = run("fig19_channel_worm", "worm.body=5e-3")
    assert value(changed, "measured_frequency") == [250.0]
    assert value(changed, "valid_below") is None
    assert value(run("fig20_capsule", "worm.youngs_modulus=1e6"), "measured_frequency") == [50.0]
    own = run("fig20_capsule", "worm.channel=11e-3", "valid_below=20.0", "stops_above=300.0")
    assert (value(own, "valid_below"), value(own, "stops_above")) == (20.0, 300.0)
    short = run("fig20_capsule", "worm.channel=30e-3", "worm.length=12e-3")
    assert value(short, "segments") == [0, 0, 0]
    assert value(short, "velocity_per_frequency") == [0.0, 0.0, 0.0]
    assert sum("shorter than one segment" in text for text in short.trust["warnings"]) == 3


def test_a_wrong_length_fails(monkeypatch: pytest.MonkeyPatch):
    wrong = graph_curve(lambda x: 0.7001 * x, 10e-3)
    monkeypatch.setattr(channel_worm, "assumed_curve", lambda worm, shape: wrong)
    result = run("fig19_channel_worm")
    assert result.status == "failed"
    assert "differ by" in result.reason
    assert failed_checks(result) == ["lengths of centre lines"]


@pytest.mark.parametrize("sample", SAMPLES)
def test_shapes_of_the_chapter_s_bodies(sample: str):
    result = shaped(f'worm.sample="{sample}"')
    worm = ChannelWorm.of(sample)
    assert result.status == "ok"
    names = [*SHAPES, "point_contact", "sleeve"]
    assert value(result, "shapes") == names
    rise = worm.rise / worm.pitch
    exact = {name: exact_elastica(name, rise) for name in ("point_contact", "sleeve")}
    lengths = [worm.arc_length(s) for s in SHAPES]
    lengths += [worm.pitch * one.length for one in exact.values()]
    assert value(result, "arc_length") == pytest.approx(lengths, rel=1e-12)
    reactions = value(result, "reaction_over_stiffness")
    assert reactions[:3] == [None] * 3
    found = [one.reaction / worm.pitch**2 for one in exact.values()]
    assert reactions[3:] == pytest.approx(found, rel=1e-11)
    energies = value(result, "energy_over_stiffness")
    assert energies[3:] == pytest.approx([e.energy / worm.pitch for e in exact.values()], rel=1e-11)
    assert energies[2] is None  # kinks
    assert energies[4] < energies[3] < energies[0] < energies[1]
    # largest curvatures of (33) and (34), at the walls
    bends = [math.pi**2 * worm.rise / 2 / worm.pitch**2, 6 * worm.rise / worm.pitch**2]
    assert value(result, "curvature_max")[:2] == pytest.approx(bends, rel=1e-9)
    assert value(result, "angle_max")[2] == pytest.approx(math.atan(rise), rel=1e-12)
    if worm.bending_stiffness is None:
        assert value(result, "reaction") == value(result, "energy") == [None] * 5
        assert value(result, "bending_stiffness") is None
    else:
        newtons = [worm.bending_stiffness * v for v in found]
        assert value(result, "reaction")[3:] == pytest.approx(newtons, rel=1e-11)
    assert all(result.trust[name]["recheck_error"] < 1e-12 for name in exact)


def test_energies_of_assumed_shapes():
    """Of (34), by quadrature of y''² / (2 (1 + y'²)^(5/2))."""
    rise, energies = 0.7, value(shaped(), "energy_over_stiffness")

    def density(x: float) -> float:
        slope, bend = 6 * rise * x * (1 - x), 6 * rise * (1 - 2 * x)
        return bend**2 / 2 / (1 + slope**2) ** 2.5

    assert energies[1] * 10e-3 == pytest.approx(quad(density, 0, 1, epsrel=1e-12)[0], rel=1e-11)

    def density_of_sine(x: float) -> float:
        slope = rise * math.pi / 2 * math.sin(math.pi * x)
        bend = rise * math.pi**2 / 2 * math.cos(math.pi * x)
        return bend**2 / 2 / (1 + slope**2) ** 2.5

    wanted = quad(density_of_sine, 0, 1, epsrel=1e-12)[0]
    assert energies[0] * 10e-3 == pytest.approx(wanted, rel=1e-11)


def test_which_assumed_shape_is_closest():
    result = shaped()
    largest, mean = (result[f"distance_{name}"].values for name in ("max", "rms"))
    assert value(result, "exact_shapes") == ["point_contact", "sleeve"]
    assert value(result, "closest_shape") == ["sine", "sine"]
    assert value(result, "closest_distance") == pytest.approx(largest[3:, 0].tolist())
    assert value(result, "closest_distance_rms") == pytest.approx(mean[3:, 0].tolist())
    assert np.all(largest[3:, 0] < largest[3:, 1])
    # from the saved points themselves
    x, y = result["x"].values, result["y"].values
    assert np.ptp([x, y], axis=1)[:, [0, -1]] == pytest.approx(np.zeros((2, 2)), abs=1e-12)
    seen = np.hypot(x[:, None] - x, y[:, None] - y)
    assert largest == pytest.approx(seen.max(axis=2), rel=1e-3)
    share = result["share"].values
    assert mean == pytest.approx(np.sqrt(np.trapezoid(seen**2, share)), rel=1e-3, abs=1e-15)
    # flat segments are beams
    assert value(shaped("worm.pitch=47e-3"), "closest_shape") == ["beam", "beam"]


def test_a_segment_that_leaves_the_walls_is_told(tmp_path: Path, capsys: Any):
    channel = 4e-3 + 1.001 * SLEEVE_RISE * 10e-3
    with pytest.raises(SolveError, match="the walls would have to pull") as caught:
        shaped(f"worm.channel={channel}")
    assert caught.value.code == "no_contact"
    change = ["--set", f"worm.channel={channel}", "--quiet", "-o", str(tmp_path / "out")]
    assert main(["run", "segment_shapes", *change]) == 3
    assert 'exact = ["point_contact"]' in capsys.readouterr().err
    one = shaped(f"worm.channel={channel}", 'exact=["point_contact"]')
    assert value(one, "exact_shapes") == ["point_contact"]
    assert len(value(one, "arc_length")) == 4
    with pytest.raises(SolveError, match="larger degree") as caught:
        shaped("worm.channel=60e-3", 'exact=["point_contact"]', "degree=32")
    assert caught.value.code == "unresolved"


def test_thick_bodies_are_told():
    thick = shaped("worm.body=6e-3", "worm.channel=13e-3")
    assert all(strain < 1 for strain in value(thick, "surface_strain")[3:])
    assert sum("the surface strain" in text for text in thick.trust["warnings"]) == 2
    assert sum("penetrate itself" in text for text in thick.trust["warnings"]) == 2  # sine, beam
    steep = shaped("worm.pitch=6e-3", "rod.outer_radius=6e-3")
    assert sum("penetrate itself" in text for text in steep.trust["warnings"]) == 3
    assert "solid and round" in steep.trust["assumptions"]["cross-section"]


def test_an_elastica_that_elliptic_integrals_deny_fails(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(
        segments, "exact_elastica", lambda closing, rise: exact_elastica(closing, 1.001 * rise)
    )
    result = shaped()
    assert result.status == "failed"
    assert "point_contact: differs by" in result.reason
    assert "sleeve: differs by" in result.reason
    assert failed_checks(result) == ["point contact", "sleeve"]


BODIES = """
    units="dimensionless" | units | write units = "SI"
    worm.body=11e-3 | worm.body | write less than 0.011
    worm.body=10.9999e-3 | worm.body | lost in round-off
    worm.length=9e-3 | worm.length | write at least 0.01
    worm.channel=0.2 | worm.pitch | write more than 0.0196
    worm={pitch=1e-2, channel=2e-2} | worm.body | sample = "sample-1"
    """
test_wrong_bodies_are_told = refusals("fig19_channel_worm", BODIES)
test_wrong_segments_are_told = refusals(
    "segment_shapes",
    f"""{BODIES}
    exact=[] | exact
    exact=["sleeve", "sleeve"] | exact
    exact=["glued"] | exact[0]
    """,
)
test_wrong_capsules_are_told = refusals(
    "fig20_capsule",
    """
    frequency=[100, 5] | frequency
    measured=[{frequency=1.0, text="a"}] | measured[0].velocity
    """,
)


def test_the_table_of_bodies():
    """The column of (32) in docs/theory-channel.md, from arc lengths by quadrature."""
    page = (DOCS / "theory-channel.md").read_text(encoding="utf-8")
    section = page.partition("### 4.3 All bodies")[2]
    for name, count in (("sample 1", 4), ("sample 2", 6), ("capsule", 6)):
        (row,) = [line for line in section.splitlines() if line.startswith(f"| {name} |")]
        printed = [float(text) for text in row.split("|")[2].split(",")]
        body = SAMPLES[name.replace(" ", "-")]
        rise = (body.channel - body.body) / body.pitch
        sine = 2 / math.pi * ellipe(-((math.pi * rise) ** 2) / 4)
        beam = quad(lambda t, r=rise: math.sqrt(1 + (6 * r * t * (1 - t)) ** 2), 0, 1)[0]
        line = math.hypot(1, rise)
        counts = (count, count, 7 if name == "sample 2" else count)
        wanted = [
            1e3 * body.pitch * k * (long - 1) / (k + 3)
            for long, k in zip((sine, beam, line), counts, strict=True)
        ]
        assert printed == pytest.approx(wanted, abs=5e-3)
