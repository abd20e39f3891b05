"""Numbers written with their unit: "60 mm", "300 mm/s^2", "10 deg", as SI numbers, exactly.

Decimal factors are fractions, so that "60 mm" is the very number 0.06.
"""

from __future__ import annotations

import math
import re
from fractions import Fraction

from wormopt.quantities import unit_of

Dimension = dict[str, int]
"""Nonzero powers of m, kg, s, A and rad; a turn is not dimensionless here."""

_PREFIXES = {"n": -9, "u": -6, "µ": -6, "μ": -6, "m": -3, "c": -2, "d": -1, "k": 3, "M": 6, "G": 9}
_TURN = Fraction(math.pi) / 180
# Symbol: factor, and its base units.
_PREFIXED: dict[str, tuple[Fraction, str]] = {
    "m": (Fraction(1), "m"),
    "g": (Fraction(1, 1000), "kg"),
    "s": (Fraction(1), "s"),
    "A": (Fraction(1), "A"),
    "rad": (Fraction(1), "rad"),
    "Hz": (Fraction(1), "s-1"),
    "N": (Fraction(1), "m kg s-2"),
    "Pa": (Fraction(1), "m-1 kg s-2"),
    "J": (Fraction(1), "m2 kg s-2"),
    "W": (Fraction(1), "m2 kg s-3"),
    "T": (Fraction(1), "kg s-2 A-1"),
    "V": (Fraction(1), "m2 kg s-3 A-1"),
    "ohm": (Fraction(1), "m2 kg s-3 A-2"),
    "Ω": (Fraction(1), "m2 kg s-3 A-2"),
    "Oe": (Fraction(250) / Fraction(math.pi), "A m-1"),
}
_PLAIN: dict[str, tuple[Fraction, str]] = {
    "min": (Fraction(60), "s"),
    "h": (Fraction(3600), "s"),
    "deg": (_TURN, "rad"),
    "°": (_TURN, "rad"),
    "%": (Fraction(1, 100), ""),
    "1": (Fraction(1), ""),
}
_NUMBER = r"[+-]?(?:\d+(?:\.\d*)?|\.\d+)(?:[eE][+-]?\d{1,3})?"
_TEXT = re.compile(rf"\s*((?>{_NUMBER}))\s*(\S.*?)\s*", re.ASCII)
_FACTOR = re.compile(r"([A-Za-zµμ°%Ω]+|1)(?:\^?([+-]?\d))?")
WITH_UNIT = r"^\s*[+-]?([0-9]+(\.[0-9]*)?|\.[0-9]+)([eE][+-]?[0-9]{1,3})?\s*[A-Za-zµμ°%Ω1/]"
"""Beginning of such a text, as a pattern for JSON Schema."""

_POWERS = str.maketrans("⁰¹²³⁴⁵⁶⁷⁸⁹⁻", "0123456789-")
# Equivalent notations of a number with that unit.
_EXAMPLES = {
    "m": ("60 mm", "0.06"),
    "s": ("60 ms", "0.06"),
    "kg": ("60 g", "0.06"),
    "N": ("60 mN", "0.06"),
    "rad": ("45 deg", "0.785398"),
    "m s-1": ("60 mm/s", "0.06"),
    "m s-2": ("60 mm/s^2", "0.06"),
    "s-1": ("60 Hz", "60"),
    "A m-1": ("60 kA/m", "60e3"),
    "Pa": ("60 kPa", "60e3"),
}


def has_unit(text: str) -> bool:
    """Whether a text is a number followed by something, such as "60 mm"."""
    return _TEXT.fullmatch(text) is not None


def to_number(text: str, quantity: str, units: str) -> float:
    """Convert a number with its unit to the unit of its quantity.

    `units` is the scene's, "dimensionless" or "SI". ValueError describes the fault and the remedy.
    """
    found = _TEXT.fullmatch(text)
    assert found, text
    if re.match(r",\d", found[2]):
        if text.count(",") > 1 or "." in text:
            raise ValueError(f"is a list without brackets; write [{text.strip()}]")
        raise ValueError(f'has a decimal comma; write "{text.strip().replace(",", ".")}"')
    # Radians are numbers in scenes without units, too: degrees are allowed there.
    target = unit_of("rad" if quantity == "angle" else quantity, units)
    if target == "1" and units != "SI" and unit_of(quantity, "SI") != "1":
        raise ValueError('has a unit in a scene without; write the bare number, or units = "SI"')
    if target == "1" and quantity != "share":
        raise ValueError("has a unit where there is none; write the bare number")
    hint = f"write {_article(quantity)}, {example(target)}"
    try:
        factor, dimension = parsed(found[2])
        least, wanted = parsed(target)
    except ValueError as error:
        raise ValueError(f"{error}; {hint}") from None
    if wanted.get("rad", 0) < 0:  # "N m" may replace "N m/rad"
        dimension.setdefault("rad", wanted["rad"])
    if dimension != wanted:
        raise ValueError(f"is not {_article(quantity)}; {hint}")
    try:
        exact = Fraction(found[1]) * factor / least
        number = float(exact)
    except (ValueError, OverflowError):
        raise ValueError(f"is too large or too long a number; {hint}") from None
    if exact and not number:
        raise ValueError(f"is too small a number; {hint}")
    return number


def bare_number(text: str) -> str:
    """Remedy for a number with a unit where only numbers are allowed."""
    found = _TEXT.fullmatch(text)
    assert found, text
    try:
        factor, dimension = parsed(found[2])
        number = float(Fraction(found[1]) * factor)
    except (ValueError, OverflowError):
        return "write the bare number"
    of = {"m": "metres", "rad": "radians", "s": "seconds", "kg": "kilograms"}
    (name, power), *more = dimension.items() or [("", 0)]
    tail = f", in {of[name]}" if not more and power == 1 and name in of else ", in SI units"
    return f"write the bare number, {number:.9g}{tail if dimension else ''}"


def example(unit: str) -> str:
    """Show by an example how to write a number of a unit."""
    if unit == "1":
        return '"5 %" or 0.05 say'
    with_unit, bare = _EXAMPLES.get(unit, (f"0.06 {unit}", "0.06"))
    return f'"{with_unit}" or {bare} say'


def _article(quantity: str) -> str:
    words = {"rad": "angle", "s": "time"}.get(quantity, quantity).replace("_", " ")
    return f"{'an' if words[0] in 'aeio' else 'a'} {words}"


def parsed(unit: str) -> tuple[Fraction, Dimension]:
    """Size in base units, and dimension, of products and quotients as "m s-2" and "N s/m"."""
    unit = re.sub(r"[⁻⁰¹²³⁴⁵⁶⁷⁸⁹]+", lambda found: found[0].translate(_POWERS), unit)
    factor, dimension = Fraction(1), Dimension()
    for index, part in enumerate(unit.replace("**", "^").split("/")):
        factors = re.split(r"[\s·*]+", part.strip()) if part.strip() else []
        if index and len(factors) > 1:
            raise ValueError("has a product behind its /, which may be read in two ways")
        if index and not factors:
            raise ValueError("has nothing behind its /")
        if "1" in factors[1:] or (len(factors) > 1 and factors[0] == "1"):
            raise ValueError("is two numbers")
        for text in factors:
            found = _FACTOR.fullmatch(text)
            if not found:
                raise ValueError(f'has no unit that can be read, "{text}"')
            power = int(found[2] or 1) * (-1 if index else 1)
            size, base = _symbol(found[1])
            factor *= size**power
            for name, exponent in re.findall(r"([a-zA-Z]+)(-?\d*)", base):
                dimension[name] = dimension.get(name, 0) + power * int(exponent or 1)
    return factor, {name: power for name, power in dimension.items() if power}


def scale(unit: str) -> tuple[Fraction, Dimension]:
    """Size and dimension of a unit or of a multiple: "0.02 s" a frame, "-0.21 mm" a pixel.

    ValueError describes the fault.
    """
    found = _TEXT.fullmatch(unit)
    size, dimension = parsed(found[2] if found else unit)
    factor = Fraction(found[1]) * size if found else size
    if not factor:
        raise ValueError("is no size")
    if not 1e-300 < abs(factor) < 1e300:
        raise ValueError("is too large or too small a size")
    return factor, dimension


def _symbol(text: str) -> tuple[Fraction, str]:
    known = _PREFIXED | _PLAIN
    if text in known:
        return known[text]
    prefix, symbol = text[:1], text[1:]
    if prefix in _PREFIXES and symbol in _PREFIXED:
        size, base = _PREFIXED[symbol]
        return size * Fraction(10) ** _PREFIXES[prefix], base
    raise ValueError(f'has a unit that is not known here, "{text}"')
