"""Numbers and arrays with units, and the units of quantities.

Numbers written with their unit, such as "60 mm", "300 mm/s^2" or "10 deg", are exact SI numbers:
decimal factors are fractions, so that "60 mm" is the very number 0.06. NumPy is loaded for arrays
only, so that scenes are checked without it.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from dataclasses import dataclass
from difflib import get_close_matches
from fractions import Fraction
from functools import cache
from typing import TYPE_CHECKING, Any

from wormopt.errors import ArgumentError
from wormopt.shown import Part, html, lines

if TYPE_CHECKING:
    import numpy as np

NAME = re.compile(r"[A-Za-z][A-Za-z0-9_]*")
# Quantity -> unit of a scene with units = "SI"; in a dimensionless scene every unit is "1".
UNITS = {
    "length": "m",
    "area": "m2",
    "time": "s",
    "speed": "m s-1",
    "acceleration": "m s-2",
    "acceleration_squared": "m2 s-4",
    "angle": "rad",
    "angular_frequency": "rad s-1",
    "rate": "s-1",
    "rate_change": "s-2",
    "mass": "kg",
    "density": "kg m-3",
    "viscosity": "Pa s",
    "surface_tension": "N m-1",
    "force": "N",
    "impulse": "N s",
    "energy": "J",
    "effort": "N2 s",
    "action": "J s",
    "power": "W",
    "energy_per_distance": "J m-1",
    "drag": "N s m-1",
    "stiffness": "N m-1",
    "compliance": "m N-1",
    "stress": "Pa",
    "bedding": "Pa m-1",
    "magnetic_field": "A m-1",
    "field_per_current": "m-1",
    "current": "A",
    "induction": "T",
    "force_per_length": "N m-1",
    "mass_rate_per_length": "kg s-1 m-1",
    "bending_stiffness": "N m2",
    "torque": "N m",
    "joint_stiffness": "N m rad-1",
    "joint_damping": "N m s rad-1",
    "curvature": "m-1",
    "curvature_squared": "m-2",
    "magnetic_field_squared": "A2 m-2",
    "ampere_turns": "A",
    "ampere_turn_rate": "A s-1",
    "current_density": "A m-2",
    "resistance": "ohm",
    "resistivity": "ohm m",
    "length_squared_time": "m2 s",
    "flow_per_width": "m2 s-1",
    "force_per_width": "N m-1",
    "energy_per_width": "J m-1",
    "mass_per_width": "kg m-1",
    "diffusivity": "m2 s-1",
    "share": "1",
    "count": "1",
}
GRAVITY = 9.80665
"""Standard acceleration of gravity, m/s²."""
# Units of scenes of both kinds.
ABSOLUTE = ("rad", "s", "Oe", "1")


def unit_of(quantity: str, units: str) -> str:
    """Unit of a quantity, a key of `UNITS` or one of `ABSOLUTE`, in a scene's system of units.

    `units` is "dimensionless" or "SI".
    """
    if quantity in ABSOLUTE:
        return quantity
    unit = UNITS[quantity]
    return unit if units == "SI" else "1"


def unit_of_signal(unit: str, units: str) -> str:
    """Unit of a signal of a Model, which names a quantity or a unit, in a system of units."""
    if unit in UNITS:
        return unit_of(unit, units)
    return unit if units == "SI" else "1"


@cache
def check_quantity(whose: str, unit: str) -> None:
    """Raise ArgumentError if `unit` is neither a quantity nor a unit that no quantity has."""
    if unit in UNITS or unit in ABSOLUTE:
        return
    meant = [quantity for quantity, own in UNITS.items() if own == unit]
    meant = meant or get_close_matches(unit, UNITS, n=1, cutoff=0.7)
    if not meant and all(_UNIT.fullmatch(part) for part in unit.split(" ")):
        return
    hint = f"did you mean {meant[0]!r}?" if meant else 'write a quantity such as "length", or "1"'
    raise ArgumentError(f"the unit of {whose!r} is {unit!r}; {hint}")


_UNIT = re.compile("(kg|m|s|A|K|mol|cd|rad|N|Pa|J|W|V|C|F|H|T|Wb|Hz|ohm)(-?[1-9])?")


def unit_ratio(quantity: str, per: str, units: str) -> str:
    """Unit of a derivative: of one quantity by another, both keys of `UNITS`."""
    powers: dict[str, int] = {}
    for name, sign in ((quantity, 1), (per, -1)):
        for symbol, power in re.findall(r"([A-Za-z]+)(-?\d*)", unit_of(name, units)):
            powers[symbol] = powers.get(symbol, 0) + sign * int(power or 1)
    parts = [f"{s}{p if p != 1 else ''}" for s, p in powers.items() if p]
    return " ".join(parts) or "1"


def plain(value: Any) -> Any:
    """Convert a value to JSON types: arrays to lists, NaN and infinity to None."""
    if hasattr(value, "tolist"):  # arrays and numbers of NumPy
        value = value.tolist()
    if value is None or isinstance(value, bool | int | str):
        return value
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if isinstance(value, Mapping):
        return {str(key): plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [plain(item) for item in value]
    raise TypeError(f"a Result cannot hold {type(value).__name__} {value!r}")


@dataclass(frozen=True)
class Scalar:
    """One number, text or (ragged) list with its unit.

    Parameters
    ----------
    value : number, text, list or None
        NaN and infinities become None: unknown.
    unit : str
        Unit as UDUNITS text, "1" for dimensionless values.

    Examples
    --------
    >>> Scalar(float("nan"), "m s-1")
    Scalar(value=None, unit='m s-1')
    """

    value: Any
    unit: str = "1"

    def __post_init__(self) -> None:
        object.__setattr__(self, "value", plain(self.value))


@dataclass(frozen=True, eq=False)
class Variable:
    """A named array with a unit and named dimensions.

    A variable named like its only dimension is the coordinate of that dimension.

    Parameters
    ----------
    name : str
        ASCII letters, digits and underscores.
    unit : str
        Unit as UDUNITS text, "1" for dimensionless values.
    dims : tuple of str
        One name per axis, at least one.
    values : array_like
        Real numbers, not empty. Kept as float64, or int32 for integers and truth values
        (the file format knows no others).
    long_name : str
        Long name, for axis labels.

    Raises
    ------
    ValueError
        If name, dims and values do not fit together or the file format cannot hold them.

    Examples
    --------
    >>> Variable("time", "s", ("time",), [0.0, 0.5, 1.0], "time").values
    array([0. , 0.5, 1. ])
    """

    name: str
    unit: str
    dims: tuple[str, ...]
    values: np.ndarray
    long_name: str = ""

    def __repr__(self) -> str:
        return lines(f"Variable {self._title}", self._range)

    def _repr_html_(self) -> str:
        sizes = zip(self.dims, self.values.shape, strict=True)
        rows = [("dimensions", ", ".join(f"{dim} {size}" for dim, size in sizes))]
        return html(f"Variable {self._title}", [Part("", [*rows, ("values", self._range)])])

    @property
    def _title(self) -> str:
        unit = "" if self.unit == "1" else f" in {self.unit}"
        over = f"{self.name}({', '.join(self.dims)}){unit}"
        return f"{over}: {self.long_name}" if self.long_name else over

    @property
    def _range(self) -> str:
        known = self.values[~(self.values != self.values)]  # without NaN
        ends = f"{known.min():.6g} to {known.max():.6g}" if known.size else "all unknown"
        return f"{' × '.join(map(str, self.values.shape))} values, {ends}"

    def __post_init__(self) -> None:
        values = _storable(self.name, self.values)
        object.__setattr__(self, "values", values)
        object.__setattr__(self, "dims", tuple(self.dims))
        for name in (self.name, *self.dims):
            if not NAME.fullmatch(name):
                raise ValueError(f"{name!r} is not a name of ASCII letters, digits and _")
        if len(self.dims) != values.ndim or not self.dims:
            raise ValueError(f"{self.name} has {values.ndim} axes but dimensions {self.dims}")
        if values.size == 0:
            raise ValueError(f"{self.name} is empty; leave it out of the Result")


def _storable(name: str, values: Any) -> np.ndarray:
    import numpy as np

    if isinstance(values, np.ma.MaskedArray):
        values = np.ma.filled(values.astype(float), np.nan)
    array = np.asarray(values)
    if array.dtype.kind == "f":
        return array.astype(np.float64)
    if array.dtype.kind not in "biu":
        raise ValueError(f"{name} holds {array.dtype}, not real numbers")
    fits = array.size == 0 or (array.min() >= -(2**31) and array.max() < 2**31)
    return array.astype(np.int32 if fits else np.float64)


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
        what = "has a unit, but the scene has none"
        raise ValueError(f'{what}; write the bare number, or units = "SI"')
    if target == "1" and quantity != "share":
        raise ValueError("has a unit, but this quantity has none; write the bare number")
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
        raise ValueError(f"is too large or has too many digits; {hint}") from None
    if exact and not number:
        raise ValueError(f"is too small; {hint}")
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
        return 'for example "5 %" or 0.05'
    with_unit, bare = _EXAMPLES.get(unit, (f"0.06 {unit}", "0.06"))
    return f'for example "{with_unit}" or {bare}'


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
            raise ValueError("has a product after /, which is ambiguous")
        if index and not factors:
            raise ValueError("has nothing after /")
        if "1" in factors[1:] or (len(factors) > 1 and factors[0] == "1"):
            raise ValueError("contains two numbers")
        for text in factors:
            found = _FACTOR.fullmatch(text)
            if not found:
                raise ValueError(f'has a unit that cannot be read, "{text}"')
            power = int(found[2] or 1) * (-1 if index else 1)
            size, base = _symbol(found[1])
            factor *= size**power
            for name, exponent in re.findall(r"([a-zA-Z]+)(-?\d*)", base):
                dimension[name] = dimension.get(name, 0) + power * int(exponent or 1)
    return factor, {name: power for name, power in dimension.items() if power}


def scale(unit: str) -> tuple[Fraction, Dimension]:
    """Size and dimension of a unit or of a multiple: "0.02 s" a frame, "-0.21 mm" a pixel."""
    found = _TEXT.fullmatch(unit)
    size, dimension = parsed(found[2] if found else unit)
    factor = Fraction(found[1]) * size if found else size
    if not factor:
        raise ValueError("is 0")
    if not 1e-300 < abs(factor) < 1e300:
        raise ValueError("is too large or too small")
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
