"""What a user gives, in a scene or from Python: declared once, read and checked in one way.

A `Given` is a table of a scene whose fields say their quantity, meaning, bounds and default:

>>> class Spring(Given):
...     "A spring."
...
...     length: float = positive("length", "length without load")
...     stiffness: float = positive("stiffness", "force per elongation", default=100.0)
>>> Spring(length="60 mm").length
0.06
>>> Spring(length=-1)
Traceback (most recent call last):
wormopt.study.given.RefusedError: Spring: length: -1 is not allowed; write a finite number above 0
"""

from __future__ import annotations

import sys
from collections.abc import Iterator, Mapping
from math import isfinite
from pathlib import Path
from types import SimpleNamespace, UnionType
from typing import (
    TYPE_CHECKING,
    Annotated,
    Any,
    ClassVar,
    Literal,
    NamedTuple,
    Self,
    Union,
    dataclass_transform,
    get_args,
    get_origin,
    get_type_hints,
)

import msgspec
from msgspec import NODEFAULT, Meta, Struct, StructMeta

from wormopt.errors import ArgumentError, Fault, SceneError
from wormopt.quantities import ABSOLUTE, UNITS
from wormopt.scene.overrides import Overrides, as_toml, override
from wormopt.units import has_unit

_LARGEST = sys.float_info.max
_SMALL = 1e-30


class RefusedError(SceneError, ArgumentError):
    """What was given from Python cannot be used: all that is wrong, key by key."""


def check_quantity(quantity: str) -> None:
    """Raise TypeError for a quantity without a unit, while the class is made."""
    if quantity and quantity not in UNITS and quantity not in ABSOLUTE:
        raise TypeError(f"{quantity!r} is no quantity; wormopt.quantities.UNITS lists them")


def says(quantity: str, meaning: str, usual: tuple[float, float] | None = None) -> Meta:
    """What a key means, in Markdown, and its quantity: a name of `wormopt.quantities`, or "".

    `usual` are the sizes in SI of which nobody is warned, where not those of the quantity.
    """
    return Meta(extra={"quantity": quantity, "meaning": meaning, "usual": usual})


def said_of(kind: Any) -> dict[str, Any]:
    """What `says` says, by the type of a key; empty where nothing is said."""
    if get_origin(kind) is not Annotated:
        return {}
    said = [meta.extra for meta in get_args(kind)[1:] if meta.extra]
    return said[-1] if said else {}


def meaning(kind: Any) -> tuple[str, str]:
    """Quantity and meaning of a key, by its type; "" where there is none."""
    said = said_of(kind)
    return said.get("quantity", ""), said.get("meaning", "")


def default_of(field: Any) -> Any:
    """Value of a key that is left out, NODEFAULT where it must not be."""
    made = field.default_factory
    return field.default if made is NODEFAULT else made()


class Key(NamedTuple):
    """What a field declares."""

    quantity: str
    meaning: str
    default: Any
    bounds: Mapping[str, Any] = {}  # of msgspec.Meta
    words: str = ""  # what a message asks the user to write
    per: str = ""  # of which parts a list has one entry each
    usual: tuple[float, float] | None = None  # see `says`

    def typed(self, kind: Any) -> Any:
        """Type of the field with all that it declares, as the reader and schemas take it."""
        words = [Meta(description=self.words)] if self.words else []
        said = says(self.quantity, self.meaning, self.usual).extra or {}
        return Annotated[self._bounded(kind), *words, Meta(extra={**said, "per": self.per})]

    def _bounded(self, kind: Any) -> Any:
        if kind in (int, float):
            return Annotated[kind, Meta(**self.bounds)] if self.bounds else kind
        if get_origin(kind) in (Union, UnionType):
            return Union[tuple(map(self._bounded, get_args(kind)))]  # noqa: UP007
        if get_origin(kind) is tuple and self.bounds:
            listed = tuple[self._bounded(get_args(kind)[0]), ...]
            ends = Meta(min_length=2, max_length=2)
            return Annotated[listed, ends] if self.per == "ends" else listed
        return kind


def number(
    quantity: str,
    meaning: str,
    *,
    default: Any = NODEFAULT,
    above: float | None = None,
    least: float | None = None,
    below: float | None = None,
    most: float | None = None,
    per: str = "",
    usual: tuple[float, float] | None = None,
) -> Any:
    """A number within bounds.

    With `per` a list is allowed too, with one number for each of these parts ("links", say); with
    ``per="ends"`` a range [smallest, largest].
    """
    bounds: dict[str, float] = {"gt": above} if above is not None else {}
    bounds |= {"ge": -_LARGEST if least is None else least} if above is None else {}
    bounds |= {"lt": below} if below is not None else {"le": _LARGEST if most is None else most}
    words = _words(above, least, below, most)
    if per:
        ends = per == "ends"
        listed = "a range [smallest, largest]" if ends else f"a list of such numbers, one per {per}"
        words += f", or {listed.removesuffix('s')}"
    return Key(quantity, meaning, default, bounds, words, per, usual)


def _words(
    above: float | None, least: float | None, below: float | None, most: float | None
) -> str:
    """Say in words which numbers bounds allow."""
    if least is not None and most is not None:
        return f"a number from {least:g} to {most:g}"
    low = [] if above is None else [f"above {above:g}"]
    high = [] if below is None else [f"below {below:g}"]
    high += [] if most is None else [f"at most {most:g}"]
    if low or high:
        return ("a number " if high else "a finite number ") + " and ".join(low + high)
    return "a finite number" if least is None else f"a finite number, {least:g} or above"


def positive(
    quantity: str,
    meaning: str,
    *,
    default: Any = NODEFAULT,
    per: str = "",
    usual: tuple[float, float] | None = None,
) -> Any:
    """A number above 0."""
    return number(quantity, meaning, default=default, above=0, per=per, usual=usual)


def whole(
    low: int, high: int, meaning: str, *, quantity: str = "count", default: Any = NODEFAULT
) -> Any:
    """A whole number from `low` to `high`."""
    words = f"a whole number from {low} to {high}"
    return Key(quantity, meaning, default, {"ge": low, "le": high}, words)


def key(meaning: str, *, quantity: str = "", default: Any = NODEFAULT, per: str = "") -> Any:
    """A key whose annotation says what is allowed: a choice, a flag, text, a list, or a table."""
    return Key(quantity, meaning, default, per=per)


@dataclass_transform(
    frozen_default=True,
    kw_only_default=True,
    field_specifiers=(number, positive, whole, key, msgspec.field),
)
class GivenMeta(StructMeta):
    """Makes types of what fields declare, and reads what a class is called with."""

    def __new__(
        mcs,
        name: str,
        bases: tuple[type, ...],
        space: dict[str, Any],
        *,
        kind: str = "",
        **config: Any,
    ) -> Any:
        declared = {field: one for field, one in space.items() if isinstance(one, Key)}
        notes = space.get("__annotations__", {})
        own = SimpleNamespace(__annotations__={field: notes[field] for field in declared})
        scope = {**vars(sys.modules[space["__module__"]])}
        types = get_type_hints(own, scope, include_extras=True)
        for field, one in declared.items():
            check_quantity(one.quantity)
            notes[field] = one.typed(types[field])
            table = isinstance(one.default, type)
            space[field] = msgspec.field(default_factory=one.default) if table else one.default
            if one.default is NODEFAULT:
                del space[field]
        if kind:  # of a study
            notes["kind"], space["kind"] = Literal[kind], kind
        return super().__new__(
            mcs,
            name,
            bases,
            space,
            frozen=True,
            kw_only=True,
            dict=True,
            forbid_unknown_fields=True,
            **config,
        )

    if not TYPE_CHECKING:  # type checkers know the fields

        def __call__(cls, /, **given: Any) -> Any:  # noqa: N805
            return cls.made(given)


class Given(Struct, metaclass=GivenMeta):
    """Base of what users give: unchangeable, compared by its fields, checked when it is made."""

    units_of_texts: ClassVar[str] = "SI"
    """Units into which texts such as "60 mm" are read where a table is made from Python."""

    @classmethod
    def made(cls, given: Mapping[str, Any]) -> Self:
        """Make one of keys and values; RefusedError says all that is wrong."""
        from wormopt.scene.read import read_table  # which reads tables of this module

        optional = {f.encode_name for f in msgspec.structs.fields(cls) if f.default is None}
        raw = {k: as_toml(v) for k, v in given.items() if v is not None or k not in optional}
        faults: list[Fault] = []
        found = read_table(raw, cls, "", raw.get("units", cls.units_of_texts), faults)
        if found is None or faults:
            raise RefusedError(cls.__name__, faults)
        vars(found)["_has_units"] = _has_units(list(raw.values()))
        return found

    @property
    def has_units(self) -> bool:
        """Whether texts with units were given in Python."""
        return vars(self).get("_has_units", False)

    @classmethod
    def of_checked(cls, fields: Mapping[str, Any]) -> Self:
        """Make one of fields that were checked before."""
        return StructMeta.__call__(cls, **fields)

    @property
    def counts(self) -> Mapping[str, int]:
        """Numbers of links, masses and the like, for lists that have one entry for each."""
        return {}

    def faults_of_keys(self) -> Iterator[Fault]:
        """Yield what no single key of this table shows: key and message."""
        yield from ()

    def wrong(self) -> Iterator[Fault]:
        """Yield all that is wrong with keys that are right each by itself."""
        extreme = [
            fault
            for name in self.__struct_fields__
            if not isinstance(value := getattr(self, name), Given)
            for fault in _extreme_numbers(value, name)
        ]
        yield from extreme or list(_wrong_lists(self, self.counts, "")) or self.faults_of_keys()

    @property
    def facts(self) -> dict[str, Any]:
        """What trust reports say of the table, beside what was found."""
        below = (getattr(self, name) for name in self.__struct_fields__)
        tables = [table for table in below if isinstance(table, Given)]
        return {key: fact for table in tables for key, fact in table.facts.items()}

    def file_warnings(self, folder: Path, units: str) -> Iterator[str]:
        """Yield what to know about the files that the table and those in it name."""
        for name in self.__struct_fields__:
            value = getattr(self, name)
            for table in value if isinstance(value, tuple) else (value,):
                if isinstance(table, Given):
                    yield from table.file_warnings(folder, units)

    def vary(self, *changes: Overrides, **tables: Any) -> Self:
        """Make the same with other keys, which may be dotted: ``vary({"film.depth": "5 mm"})``."""
        raw = plain(self)
        faults = [fault for change in (*changes, tables) for fault in override(raw, change)]
        if faults:
            raise RefusedError(type(self).__name__, faults)
        return type(self).made(raw)

    def __reduce__(self) -> Any:  # fields alone travel: nothing cached, and nothing is read again
        fields = {name: getattr(self, name) for name in self.__struct_fields__}
        return type(self).of_checked, (fields,)


def _has_units(value: Any) -> bool:
    if isinstance(value, list):
        return any(map(_has_units, value))
    return value.has_units if isinstance(value, Given) else (
        isinstance(value, str) and has_unit(value)
    )  # fmt: skip


def plain(value: Any) -> Any:
    """Tables, lists and numbers of what was given, as a TOML file would have them."""
    if isinstance(value, Struct):
        config = value.__struct_config__
        tag = {config.tag_field: config.tag} if config.tag_field else {}
        found = {name: plain(getattr(value, name)) for name in value.__struct_fields__}
        return tag | {name: item for name, item in found.items() if item is not None}
    if isinstance(value, Mapping):
        return {name: plain(item) for name, item in value.items()}
    return [plain(item) for item in value] if isinstance(value, list | tuple) else value


def _wrong_lists(made: Any, counts: Mapping[str, int], path: str) -> Iterator[Fault]:
    """Yield lists that have another length than there are parts, in a table and below it."""
    for field in msgspec.structs.fields(type(made)):
        value, name = getattr(made, field.name), f"{path}.{field.name}" if path else field.name
        things: Any = said_of(field.type).get("per", "")
        if things in counts:
            yield from wrong_count(name, value, counts[things], things)
        if isinstance(value, Given) and not value.counts.keys() & counts.keys():
            yield from _wrong_lists(value, counts, name)


def _extreme_numbers(value: object, key: str = "") -> Iterator[Fault]:
    """Yield a fault for each number so extreme that products of a few of them overflow.

    `value` is that of a key, or in it; tables in it have checked their own.
    """
    if isinstance(value, tuple):
        for index, item in enumerate(value):
            yield from _extreme_numbers(item, f"{key}[{index}]")
    elif isinstance(value, Mapping):
        for name, item in value.items():
            yield from _extreme_numbers(item, f"{key}.{name}")
    elif isinstance(value, float) and not (value == 0 or _SMALL <= abs(value) <= 1 / _SMALL):
        if not isfinite(value):
            yield key, f"{value} is not allowed; write a finite number"
            return
        size = "small" if abs(value) < 1 else "large"
        yield (
            key,
            f"{value:g} is too {size} to compute with; choose units in which it is nearer to 1",
        )


def wrong_count(
    key: str,
    value: object,
    count: int,
    things: Literal["links", "masses", "joints"],
    entry: Literal["number", "table"] = "number",
) -> Iterator[Fault]:
    """Yield a fault if a list does not hold one entry per link or per mass.

    A value that is no list is fine.
    """
    if isinstance(value, tuple) and len(value) != count:
        yield (
            key,
            (
                f"{_entries(len(value))} for {count} {things}; write one {entry} for all {things}, "
                f"or a list of {count}"
            ),
        )


def _entries(count: int) -> str:
    return "1 entry" if count == 1 else f"{count} entries"
