"""docs/errata.md on bodies in a channel, (32)-(36), and on the pressure under a coil.

Lengths in mm, velocities in mm/s per coil switch a second. Arc lengths are integrals of smooth
functions, evaluated by sympy to 20 digits: far more than rounding here decides.
"""

from typing import Any

import pytest
import sympy as sp
from simplified import zero
from sympy import Rational as Q

Expression = Any  # of sympy, whose types are loose

x = sp.Symbol("x", real=True)
L, d, d_w = sp.symbols("L d d_w", positive=True)

SINE = (d - d_w) / 2 * sp.sin(sp.pi * x / L)  # (33) as printed
SINE_SHIFTED = d / 2 + (d - d_w) / 2 * sp.sin(sp.pi * (x - L / 2) / L)
BEAM = -2 * (d - d_w) / L**3 * x**3 + 3 * (d - d_w) / L**2 * x**2 + d_w / 2  # (34)
LINE = (d - d_w) * x / L  # (35)
SHAPES = {"sine": SINE_SHIFTED, "beam": BEAM, "line": LINE}

SAMPLE_1: Any = {L: 10, d: 11, d_w: 4}
BODY = 48  # length of sample 1
CAPSULE: Any = {L: 10, d: 10, d_w: 4}
CAPSULE_BODY = 75


def arc_length(shape: Expression, sizes: Any) -> Expression:
    """l_s of one segment, 0 <= x <= L."""
    curve = shape.subs(sizes)
    return sp.Integral(sp.sqrt(1 + sp.diff(curve, x) ** 2), (x, 0, sizes[L])).evalf(20)


def speed(segments: int, length: Expression) -> Expression:
    """(32) over n: k_s (l_s - L) / ((k_s + 3) T) with T = 1/n."""
    return segments * (length - 10) / (segments + 3)


def rounds_to(value: Expression, printed: str) -> bool:
    """Whether a number is the printed one, rounded to its last digit."""
    half = Q(1, 2) / 10 ** len(printed.partition(".")[2])
    return bool(Q(printed) - half <= value <= Q(printed) + half)


# --- (33), (35): where the curves lie ----------------------------------------------------


def ends(shape: Expression) -> list[Expression]:
    """Height and slope where the segment begins and where it ends, x = 0 and x = L."""
    return [sp.simplify(f.subs(x, place)) for place in (0, L) for f in (shape, sp.diff(shape, x))]


def test_the_sine_of_33_needs_its_shift_to_go_from_wall_to_wall():
    """Centre lines run from d_w/2 to d - d_w/2 and along the walls at both ends, as (34) does."""
    wall_to_wall = [d_w / 2, 0, d - d_w / 2, 0]
    assert all(zero(f - e) for f, e in zip(ends(BEAM), wall_to_wall, strict=True))
    assert all(zero(f - e) for f, e in zip(ends(SINE_SHIFTED), wall_to_wall, strict=True))
    begin, slope, end, _ = ends(SINE)
    assert begin == end == 0  # as printed it rises to the middle and returns
    assert zero(slope - sp.pi * (d - d_w) / (2 * L))


def test_the_shift_of_33_does_not_change_its_length():
    """Slopes squared repeat with L, and the printed curve is the shifted one half an L later."""
    printed, shifted = (sp.diff(shape, x) ** 2 for shape in (SINE, SINE_SHIFTED))
    assert zero(printed.subs(x, x + L) - printed)
    assert zero(printed.subs(x, x - L / 2) - shifted)


def test_the_line_of_35_misses_half_the_width_of_the_body():
    begin, _, end, _ = ends(LINE)
    assert begin == 0
    assert end == d - d_w
    begin, _, end, _ = ends(LINE + d_w / 2)
    assert begin == d_w / 2
    assert zero(end - (d - d_w / 2))


# --- (32), (36): counts and velocities ---------------------------------------------------


@pytest.mark.parametrize(
    ("shape", "length", "printed_length", "printed_speed"),
    [
        ("sine", "12.550570", "12.6", "1.46"),
        ("beam", "12.504597", "12.5", "1.43"),
        ("line", "12.206556", "12.2", "1.26"),
    ],
)
def test_velocities_of_sample_1_need_the_nearest_count_and_lengths_not_rounded(
    shape: str, length: str, printed_length: str, printed_speed: str
):
    found = arc_length(SHAPES[shape], SAMPLE_1)
    assert rounds_to(found, length)
    assert rounds_to(found, printed_length)
    assert sp.floor(BODY / found) == 3
    assert BODY / found > Q(7, 2)  # the nearest integer is 4
    assert rounds_to(speed(4, found), printed_speed)
    assert not rounds_to(speed(3, found), printed_speed)
    assert 4 * found > BODY  # four segments are more than there is of the body


def test_12_6_is_rounded_and_not_what_1_46_was_computed_from():
    """12.55 rounded once more; with 12.6 itself (32) gives 1.49."""
    assert rounds_to(speed(4, Q("12.55")), "1.46")
    assert rounds_to(speed(4, Q("12.6")), "1.49")


def test_the_root_of_36_is_the_length_of_a_segment():
    """(35) with d_c for d_w; the count is 6 by either rule, and (32) gives the printed 1.1 n."""
    slope = sp.diff(LINE, x)
    length = sp.sqrt(L**2 + (d - d_w) ** 2)
    assert zero(L * sp.sqrt(1 + slope**2) - length)
    found = length.subs(CAPSULE)
    assert found == sp.sqrt(136)
    assert rounds_to(found, "11.66")
    assert sp.floor(CAPSULE_BODY / found) == 6
    assert CAPSULE_BODY / found < Q(13, 2)
    assert rounds_to(speed(6, found), "1.107936")
    assert rounds_to(speed(6, found), "1.1")
    assert rounds_to(50 * speed(6, found), "55.4")  # measured 55.6


def test_counting_coils_in_place_of_segments_would_not_fit_both_bodies():
    """floor(l_w / L) gives the 4 of sample 1, but 7 for the capsule."""
    assert sp.floor(Q(BODY, 10)) == 4
    assert sp.floor(Q(CAPSULE_BODY, 10)) == 7


def test_the_beam_of_sample_1_is_far_above_its_measured_maximum():
    """143 mm/s at n = 100 against 78.9; and 100 mm/s is more than either body is said to reach."""
    computed = 100 * speed(4, arc_length(BEAM, SAMPLE_1))
    assert rounds_to(computed, "143")
    assert computed > Q("1.8") * Q("78.9")
    assert max(Q("78.9"), Q("55.6")) < 100


# --- 3.5: pressure -----------------------------------------------------------------------


def test_the_pressure_under_a_coil_is_2_2_kilopascal():
    """mu0 chi H^2 / 2 with chi = 0.35 and H = 1e5 A/m; 2200 MPa would need 1e8 A/m, over 100 T."""
    mu0 = 4 * sp.pi / 10**7
    H, chi = sp.Symbol("H", positive=True), Q("0.35")
    pressure = mu0 * chi * H**2 / 2
    assert Q(2150) < pressure.subs(H, 10**5) < Q(2250)
    (needed,) = sp.solve(pressure - 2200 * 10**6, H)
    assert Q("0.99") * 10**8 < needed < Q("1.01") * 10**8
    assert mu0 * needed > 100
