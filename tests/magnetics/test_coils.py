"""Coils and rows of coils: magpylib, closed forms, Maxwell's equations, courses of currents."""

import math
from collections.abc import Callable
from itertools import product
from typing import Any

import casadi as ca
import hypothesis.strategies as st
import numpy as np
import pytest
from effort import examples
from hypothesis import given, settings
from scipy.optimize import least_squares

import wormopt as wo
from wormopt.errors import ArgumentError, SolveError
from wormopt.magnetics.coils import Coil, CoilRow, field_by_quadrature
from wormopt.magnetics.travelling import harmonic_shares as shares
from wormopt.magnetics.travelling import moving_profile, shifted_course, switched_course
from wormopt.magnetics.winding import loop_field, sheet_field
from wormopt.systems.coils.row_currents import RowFit, TravellingTarget, fit_currents

COIL = Coil(2e-3, 4.5e-3, 20e-3, 3000.0)
ROWS = {
    "across": CoilRow(COIL, 3, 10e-3, "across"),
    "facing": CoilRow(COIL, 3, 10e-3, "across", gap=11e-3),
    "along": CoilRow(Coil(4e-3, 6e-3, 8e-3, 3000.0), 3, 10e-3, "along"),
    "vertical": CoilRow(COIL, 3, 10e-3, "vertical"),
    "between": CoilRow(COIL, 3, 10e-3, "vertical", gap=11e-3),
    "in turn": CoilRow(COIL, 3, 10e-3, "vertical", gap=11e-3, sides="alternating"),
}
# A height of the line that is off the windings of each of them.
HEIGHTS = {"across": 6e-3, "facing": 0.5e-3, "along": 1e-3, "vertical": -12e-3}
HEIGHTS |= {"between": 1e-3, "in turn": 1e-3}
QUICK = ("facing", "vertical")
CURRENTS = np.array([3000.0, -1000.0, 500.0])


def cloud(count: int = 400, seed: int = 0) -> tuple[np.ndarray, np.ndarray]:
    """Distances from the axis and along it, some of them on the axis or level with an end."""
    rng = np.random.default_rng(seed)
    rho, s = rng.uniform(0, 3, count), rng.uniform(-4, 4, count)
    rho[:10] = 0.0
    s[10:20] = 1.5
    s[20:30] = 0.0
    return rho, s


def off(found: np.ndarray, reference: np.ndarray) -> float:
    """Largest difference of vectors, over the length of the reference."""
    difference = np.linalg.norm(found - reference, axis=-1)
    return float(np.max(difference / np.linalg.norm(reference, axis=-1)))


# -- one loop, one sheet, one coil -----------------------------------------------------------------


def test_a_loop_is_that_of_magpylib():
    magpylib = pytest.importorskip("magpylib")
    rho, s = cloud()
    reference = magpylib.current.Circle(diameter=2.0, current=1.0).getH(np.c_[rho, 0 * rho, s])
    axial, radial = loop_field(1.0, rho**2, s)
    assert off(np.c_[radial * rho, 0 * rho, axial], reference) < 1e-12


def test_a_sheet_is_the_cylinder_magnet_of_magpylib():
    magpylib = pytest.importorskip("magpylib")
    rho, s = cloud()
    magnet = magpylib.magnet.Cylinder(dimension=(2.0, 3.0), polarization=(0, 0, 1.0))
    reference = magnet.getB(np.c_[rho, 0 * rho, s])  # B of a magnet: that of the currents round it
    axial, radial = sheet_field(1.0, 1.5, rho**2, s)
    axial = axial + ((rho < 1) & (np.abs(s) < 1.5))
    assert off(np.c_[radial * rho, 0 * rho, axial], reference) < 1e-12


@pytest.mark.parametrize("clearance", [pytest.param(0.05, marks=pytest.mark.slow), 0.2])
def test_a_coil_is_a_nest_of_cylinder_magnets_of_magpylib(clearance: float):
    magpylib = pytest.importorskip("magpylib")
    coil = Coil(0.5, 1.25, 3.0)
    rng = np.random.default_rng(1)
    rho, s = rng.uniform(0, 3, 20_000), rng.uniform(-4, 4, 20_000)
    distance = coil.clearance(rho**2, s)
    near = (distance > clearance) & (distance < 1.5 * clearance)
    rho, s = rho[near][:60], s[near][:60]
    assert len(rho) == 60
    places, weights = np.polynomial.legendre.leggauss(400)
    reference = np.zeros((60, 3))
    for place, weight in zip(places, weights / 2, strict=True):
        radius = 0.875 + 0.375 * place
        sheet = magpylib.magnet.Cylinder(dimension=(2 * radius, 3.0), polarization=(0, 0, 1 / 3))
        reference += weight * sheet.getB(np.c_[rho, 0 * rho, s])
    axial, radial = coil.field(rho**2, s)
    assert off(np.c_[radial * rho, 0 * rho, axial], reference) < 1e-10


def test_on_the_axis_a_coil_has_the_known_closed_form():
    s = np.linspace(-50e-3, 50e-3, 41)

    def end(z: np.ndarray) -> np.ndarray:
        outer, inner = (r + np.hypot(r, z) for r in (COIL.outer, COIL.inner))
        return z * np.log(outer / inner)

    half, section = COIL.length / 2, COIL.length * (COIL.outer - COIL.inner)
    reference = (end(s + half) - end(s - half)) / (2 * section)
    axial, radial = COIL.field(np.zeros(41), s)
    assert axial == pytest.approx(reference, rel=1e-11)
    assert np.all(np.isfinite(radial))


def test_a_helmholtz_pair():
    s = ca.SX.sym("s")
    H = loop_field(1.0, 0.0, s + 0.5)[0] + loop_field(1.0, 0.0, s - 0.5)[0]
    slopes = [H]
    for _ in range(4):
        slopes.append(ca.gradient(slopes[-1], s))
    values = np.asarray(ca.Function("pair", [s], [ca.vertcat(*slopes)])(0.0)).ravel()
    first = 0.8**1.5
    # the field of such a pair is even to the third derivative: -144/125 is that of the fourth
    assert values[:4] == pytest.approx([first, 0, 0, 0], abs=1e-12)
    assert values[4] / first == pytest.approx(-24 * 144 / 125, rel=1e-10)


@pytest.mark.parametrize("length", [0.02, 1.0, 20.0])
def test_a_dipole_keeps_its_digits_however_far_away(length: float):
    """Both ends of a solenoid cancel: at 1e5 radii nothing was left of them."""
    coil, angle = Coil(0.3, 1.0, length), 0.7
    moment = math.pi * (1 + 0.3 + 0.09) / 3
    cosine, sine = math.cos(angle), math.sin(angle)
    for r in length * np.array([1e4, 1e6, 1e8]):
        axial, radial = coil.field((r * sine) ** 2, r * cosine)
        dipole = moment / (4 * math.pi * r**3) * np.array([3 * cosine**2 - 1, 3 * sine * cosine])
        found = np.array([float(axial), float(radial) * r * sine])
        share = 10 * (math.hypot(1.0, length) / r) ** 2 + 1e-10
        assert np.abs(found - dipole).max() < share * np.linalg.norm(dipole)


def test_the_field_is_the_same_level_with_an_end_and_beside():
    q, half = np.full(2, 7e-3**2), COIL.length / 2
    at, beside = COIL.field(q, np.array([half, half * (1 + 1e-13)]))[0]
    assert at == pytest.approx(beside, rel=1e-11)


@settings(max_examples=examples(40))
@given(
    inner=st.floats(0.1, 2.0), depth=st.floats(0.1, 2.0), length=st.floats(0.2, 5.0),
    rho=st.floats(0.0, 6.0), s=st.floats(-6.0, 6.0),
)  # fmt: skip
def test_more_nodes_change_nothing(inner: float, depth: float, length: float, rho: float, s: float):
    coil = Coil(inner, inner + depth, length)
    clearance = float(coil.clearance(rho**2, s))
    if clearance < 0.1 * depth:
        return
    few, many = (coil.expression(rho**2, s, n) for n in (coil.nodes(clearance), 150))
    size = math.hypot(many[0], many[1] * rho)
    assert math.hypot(few[0] - many[0], (few[1] - many[1]) * rho) < 1e-10 * size


# -- rows ------------------------------------------------------------------------------------------


def magpylib_row(row: CoilRow, currents: np.ndarray) -> Any:
    """The row as a few thousand loops."""
    magpylib = pytest.importorskip("magpylib")
    places, weights = np.polynomial.legendre.leggauss(16)
    coil, turn = row.coil, {"along": (0, 90, 0), "across": (-90, 0, 0), "vertical": (0, 0, 0)}
    apart = 0.0 if row.gap is None else (row.gap + coil.length) / 2
    nodes = [*zip(places, weights / 2, strict=True)]
    loops = []
    for (a, wa), (b, wb), side, k in product(nodes, nodes, {-apart, apart}, range(row.count)):
        radius = (coil.inner + coil.outer) / 2 + a * (coil.outer - coil.inner) / 2
        middle = np.array([k * row.pitch, 0.0, 0.0])
        middle[("along", "across", "vertical").index(row.axis)] += b * coil.length / 2 + side
        current = wa * wb * currents[k]
        loop = magpylib.current.Circle(diameter=2 * radius, current=current, position=middle)
        for angle, axis in zip(turn[row.axis], "xy", strict=False):
            loop.rotate_from_angax(angle, axis, anchor=middle)
        loops.append(loop)
    return magpylib.Collection(*loops)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["facing", "along", "vertical"])
def test_a_row_is_that_of_magpylib(name: str):
    row = ROWS[name]
    x, y = np.array([3e-3, 17e-3, 32e-3]), np.array([0.0, 1e-3, -0.5e-3])
    z = {"facing": 2e-3, "along": 14e-3, "vertical": 1.4 * HEIGHTS["vertical"]}[name]
    source = magpylib_row(row, CURRENTS)
    reference = source.getH(np.c_[x, y, np.full(3, z)])
    assert off(row.field(x, z, CURRENTS, y).T, reference) < 1e-10


@pytest.mark.parametrize(
    "name", [pytest.param(one, marks=[pytest.mark.slow] * (one not in QUICK)) for one in ROWS]
)
def test_maxwells_equations_hold_in_air(name: str):
    row, place = ROWS[name], ca.SX.sym("place", 3)
    H = row.expression(place, CURRENTS, 10)
    both = ca.Function("both", [place], [H, ca.jacobian(H, place)])
    # the second lies on the axis of a coil along the row, or in the middle of a gap
    for point in ([13e-3, 0.4e-3, HEIGHTS[name]], [20e-3, 0.0, HEIGHTS[name]]):
        if name in ("along", "facing", "between"):
            point[2] = 0.0 if point[1] == 0 else point[2]
        values, slopes = (np.asarray(part) for part in both(point))
        size = np.abs(slopes).max()
        assert np.all(np.isfinite(slopes))
        assert abs(np.trace(slopes)) < 1e-10 * size
        assert np.abs(slopes - slopes.T).max() < 1e-10 * size
        found = row.field(point[0], point[2], CURRENTS, point[1]).ravel()
        assert values.ravel() == pytest.approx(found, rel=1e-11, abs=1e-6)


@pytest.mark.parametrize("name", ROWS)
def test_the_gradient_of_the_square_is_that_of_differences(name: str):
    row, z, step = ROWS[name], HEIGHTS[name], 1e-6
    x = np.array([1e-3, 12e-3, 26e-3])
    gradient = row.square_gradient(x, z, CURRENTS, 0.3e-3)
    for axis in range(3):
        ends = []
        for sign in (-2, -1, 1, 2):
            point = [x, np.full(3, 0.3e-3), np.full(3, z)]
            point[axis] = point[axis] + sign * step
            ends.append(row.square(point[0], point[2], CURRENTS, point[1]))
        difference = (8 * (ends[2] - ends[1]) - (ends[3] - ends[0])) / (12 * step)
        size = np.abs(gradient).max()
        assert gradient[axis] == pytest.approx(difference, rel=1e-6, abs=1e-7 * size)


def quadrature_error(row: CoilRow, x: np.ndarray, height: float, currents: np.ndarray) -> float:
    second = field_by_quadrature(row, x, height, currents)
    formula = np.einsum("cmk,km->cm", row.influence(x, height), currents)
    return float(np.abs(second - formula).max() / np.abs(second).max())


@pytest.mark.slow
@pytest.mark.parametrize("name", ROWS)
def test_quadrature_of_biot_and_savart_finds_the_same(name: str):
    row, x = ROWS[name], np.array([7e-3, 23e-3])
    currents = np.c_[CURRENTS, CURRENTS[::-1]]
    assert quadrature_error(row, x, HEIGHTS[name], currents) < 1e-11


@pytest.mark.parametrize("gap", [1e-3, 3e-4])
def test_quadrature_ends_next_to_a_winding(gap: float):
    """Of points over an end, between the radii: there the field is steep along both."""
    row, x = CoilRow(COIL, 2, 10e-3, gap=gap), np.array([2.5e-3, 7e-3])
    currents = np.c_[CURRENTS, CURRENTS[::-1]][:2]
    assert quadrature_error(row, x, 0.0, currents) < 1e-11


def test_quadrature_keeps_its_digits_beside_a_long_coil():
    """Its ends are seen at nearly the same angle, and the sheets are passed closely."""
    long, x = CoilRow(Coil(0.5, 1.0, 1e3), 1, 2.0, "vertical"), np.array([1.02])
    assert quadrature_error(long, x, 0.3, np.ones((1, 1))) < 1e-10


@pytest.mark.parametrize("height", [1e2, 1e9])
def test_quadrature_keeps_its_digits_however_far_away(height: float):
    """Around a turn all but nothing is left of the distances: no rule ended on their rounding."""
    row, x = ROWS["vertical"], np.array([7e-3, 23e-3])
    currents = np.c_[CURRENTS, CURRENTS[::-1]]
    assert quadrature_error(row, x, height, currents) < 1e-9


def test_a_row_shifted_by_a_pitch_is_itself():
    row = ROWS["vertical"]
    A = row.influence([4e-3, 14e-3], HEIGHTS["vertical"])
    assert A[:, 0, :-1] == pytest.approx(A[:, 1, 1:], rel=1e-12, abs=1e-9)


@pytest.mark.parametrize(
    ("message", "build"),
    [
        ("inner must be above 0", lambda: Coil(0.0, 1.0, 1.0)),
        ("inner must be above 0", lambda: Coil(-1.0, 1.0, 1.0)),
        ("length must be above 0", lambda: Coil(0.5, 1.0, math.nan)),
        ("must be below outer", lambda: Coil(1.0, 1.0, 1.0)),
        ("overlap", lambda: CoilRow(COIL, 3, 8.9e-3)),
        ("overlap", lambda: CoilRow(COIL, 3, 19e-3, "along")),
        ('axis is "up"', lambda: CoilRow(COIL, 3, 20e-3, "up")),  # pyright: ignore
        ("gap", lambda: CoilRow(COIL, 3, 20e-3, "along", gap=1e-3)),
        ("at least one coil", lambda: CoilRow(COIL, 0, 20e-3)),
        ("inside the fluid", lambda: ROWS["across"].influence(3e-3, 0.0)),
        ("inside the fluid", lambda: ROWS["along"].square_gradient(0.0, 5e-3, CURRENTS)),
        ("in the winding", lambda: COIL.field(np.array([9e-6]), np.zeros(1))),
        ("limit of 3000", lambda: ROWS["facing"].field(0.0, 0.0, [3001.0, 0, 0])),
        (r"not \(3, ...\)", lambda: ROWS["facing"].field(0.0, 0.0, [1.0])),
        ("do not fit", lambda: switched_course(4, 1.0, 1.0, on=5)),
        ("do not fit", lambda: switched_course(4, 1.0, 1.0, every=5)),
        ("rate", lambda: switched_course(4, 1.0, 0.0)),
        ("shift", lambda: shifted_course([1.0], 1.0, 0.0, 2)),
    ],
)
def test_what_cannot_be_is_refused(message: str, build: Callable[[], object]):
    with pytest.raises(ArgumentError, match=message):
        build()


# -- courses ---------------------------------------------------------------------------------------


@pytest.mark.parametrize(("every", "on"), [(None, 3), (5, 2), (4, 4)])
def test_a_switched_row_shifts_by_one_coil_at_each_switch(every: int | None, on: int):
    course = switched_course(8, 3000.0, 50.0, on=on, every=every)
    count = every or 8
    t = (np.arange(count) + 0.5) / 50.0
    values = course(t)
    assert set(np.unique(values)) <= {0.0, 3000.0}
    assert np.sum(values[:count] > 0, axis=0).tolist() == [on] * count
    assert np.all(values[1:, 1:] == values[:-1, :-1])
    assert course.period == pytest.approx(count / 50.0)


@settings(max_examples=examples(30))
@given(
    nodes=st.lists(st.floats(-5, 5), min_size=2, max_size=9),
    shift=st.floats(0.01, 3.0),
    alternating=st.booleans(),
)
def test_each_coil_follows_its_neighbour(nodes: list[float], shift: float, alternating: bool):
    course = shifted_course(nodes, 1.0, shift, 3, alternating=alternating)
    t = np.linspace(0, 2, 41) + 1e-3
    values = course(t)
    assert values[1] == pytest.approx(course(t - shift)[0], abs=1e-6)
    assert values[2] == pytest.approx(course(t - shift)[1], abs=1e-6)
    at_nodes = course(np.arange(len(nodes)) / len(nodes) + 1e-12)[0]
    assert at_nodes == pytest.approx(nodes, abs=1e-9)
    sign = -1 if alternating else 1
    assert course(t + 1.0)[0] == pytest.approx(sign * values[0], abs=1e-6)


def test_the_simulator_follows_a_course_of_currents():
    charge, current = ca.SX.sym("charge", 3), ca.SX.sym("current", 3)
    x, u = [wo.Signal("charge", charge)], [wo.Signal("current", current)]
    model = wo.Model("charged", x=x, ode=current, u=u)
    course = switched_course(3, 2.0, 10.0, on=1)
    run = wo.simulate(wo.drive(model, course, periodic=True), 0.75)
    # 7.5 steps of 0.1 s: coil 0 is on in steps 0, 3, 6, coil 1 in 1, 4 and half of 7
    assert np.ravel(run.end) == pytest.approx([0.6, 0.5, 0.4], abs=1e-9)


def test_a_smooth_field_travels_forward_without_ripple():
    row = CoilRow(COIL, 24, 10e-3, "across", gap=30e-3)
    nodes = 1000 * np.cos(2 * np.pi * np.arange(400) / 400)
    course = shifted_course(nodes, 2.0, 2.0 * 10e-3 / 80e-3, 24)
    x = np.linspace(80e-3, 160e-3, 33)
    profile = moving_profile(row, course, x, 0.0, wavelength=80e-3, period=2.0)
    assert profile.ripple < 0.01
    assert shares(profile.mean)[1] > 0.999  # H has the period of the wave, H² half of it
    backward = moving_profile(row, course, x, 0.0, wavelength=-80e-3, period=2.0)
    assert backward.ripple > 1


def test_a_profile_tells_its_residual():
    row = ROWS["facing"]
    course = switched_course(3, 1000.0, 1.0, on=1)
    profile = moving_profile(row, course, [20e-3], 0.0, wavelength=30e-3, period=3.0, phases=51)
    assert profile.ripple == 0
    assert profile.residual(profile.mean) == 0
    shift = 3.0 * profile.variation
    assert profile.residual(profile.mean + shift) == pytest.approx(3.0)


# -- currents for a field --------------------------------------------------------------------------

SMOOTH = CoilRow(COIL, 16, 10e-3, "across", gap=15e-3)
PLACES = np.linspace(40e-3, 110e-3, 15)
AMPLITUDE = 2e7


def wanted(xi: np.ndarray) -> np.ndarray:
    return AMPLITUDE * (np.cos(xi) + 0.2 * np.sin(2 * xi))


LEAST = float(np.max(wanted(np.linspace(0, 2 * np.pi, 100_001))))


def fitted(**changes: object) -> RowFit:
    target = TravellingTarget(wanted, LEAST, 80e-3, 1.0, changes.pop("square", None))  # pyright: ignore
    given_: dict = {"nodes": 16, "starts": 2} | changes
    row = given_.pop("row", SMOOTH)
    return fit_currents(row, target, PLACES, 0.0, **given_)


@pytest.fixture(scope="module")
def free() -> RowFit:
    return fitted()


def maps() -> tuple[np.ndarray, np.ndarray]:
    """Field of each node's course at the points of the program, and phases there."""
    A = SMOOTH.influence(PLACES, 0.0)
    turn = (np.arange(16) + 0.5 * (np.arange(15) % 2)[:, None]) / 16
    t = turn + PLACES[:, None] / 80e-3
    columns = []
    for unit in np.eye(16):
        currents = shifted_course(unit, 1.0, 0.125, 16)(t.ravel()).reshape(16, 15, 16)
        columns.append(np.einsum("cmk,kmn->cmn", A, currents).reshape(3, -1))
    return np.stack(columns, axis=2), 2 * np.pi * turn.ravel()


def test_the_program_compares_the_field_of_the_course(free: RowFit):
    B, xi = maps()
    left = np.sum((B @ free.nodes) ** 2, axis=0) - free.square + wanted(xi)
    found = np.sqrt(np.mean(left**2)) / np.std(wanted(xi))
    assert found == pytest.approx(free.residual, rel=1e-9)
    assert free.solution.violation < 1e-9
    assert free.square >= LEAST * (1 - 1e-9)


def test_no_other_currents_are_nearer(free: RowFit):
    B, xi = maps()
    unit = np.abs(free.nodes).max()

    def left(w: np.ndarray) -> np.ndarray:
        return (np.sum((B @ (unit * w[:16])) ** 2, axis=0) - LEAST * w[16] + wanted(xi)) / LEAST

    start = np.append(free.nodes / unit, free.square / LEAST)
    low = np.append(np.full(16, -3000 / unit), 1.0)
    begin = start * (1 + 0.1 * np.random.default_rng(3).uniform(-1, 1, 17))
    second = least_squares(left, np.maximum(begin, low + 1e-6), bounds=(low, np.inf), xtol=1e-12)
    assert np.sum(left(start) ** 2) == pytest.approx(2 * second.cost, rel=1e-5)


def test_bounds_on_currents_hold(free: RowFit):
    limit = 0.6 * np.abs(free.nodes).max()
    row = CoilRow(Coil(2e-3, 4.5e-3, 20e-3, limit), 16, 10e-3, "across", gap=15e-3)
    weak = fitted(row=row)
    assert np.abs(weak.nodes).max() == pytest.approx(limit, rel=1e-6)
    assert np.abs(weak.nodes).max() <= limit
    assert weak.residual > 1.5 * free.residual
    steepest = np.abs(np.diff(free.nodes, append=free.nodes[0])).max() * 16
    slow = fitted(slew=0.5 * steepest)
    assert np.abs(slow.course.polynomial[:, :, 1]).max() == pytest.approx(0.5 * steepest, rel=1e-5)
    assert slow.residual > free.residual


def test_polarity_is_kept():
    one, turned = fitted(polarity="one"), fitted(polarity="alternating")
    assert one.nodes.min() >= 0
    assert turned.course.period == pytest.approx(2.0)
    t = np.linspace(0, 1, 31)
    assert turned.course(t + 1.0) == pytest.approx(-turned.course(t), abs=1e-6)
    assert max(one.residual, turned.residual) < 0.2


def test_a_given_offset_is_kept(free: RowFit):
    given_ = fitted(square=1.7 * LEAST)
    assert given_.square == pytest.approx(1.7 * LEAST)
    assert given_.residual >= free.residual * (1 - 1e-6)
    with pytest.raises(ArgumentError, match="negative somewhere"):
        TravellingTarget(wanted, LEAST, 80e-3, 1.0, 0.9 * LEAST)


def test_fits_that_cannot_be_are_told():
    with pytest.raises(SolveError, match="none of 1 starts") as caught:
        fitted(starts=1, options=wo.Ipopt(iterations=1))
    assert caught.value.code == "not_solved"
    for changes in ({"nodes": 3}, {"starts": 0}, {"slew": 0.0}, {"polarity": "both"}):
        with pytest.raises(ArgumentError):
            fitted(**changes)
