# pyright: strict
"""Members of a study: what it computes and reports, each declared where it is computed."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, fields
from functools import partial
from operator import attrgetter
from string import Formatter
from typing import Any, Generic, Literal, Self, TypeVar, overload

from wormopt.errors import ArgumentError, WormoptError
from wormopt.quantities import NAME
from wormopt.result import Check
from wormopt.study.given import check_quantity

T = TypeVar("T")
Method = Callable[[Any], T]
Role = Literal["stage", "scalar", "array", "check", "warning", "fact", "attribute", "parts"]


class NotComputedError(WormoptError):
    """A member that a stopped or failed study did not reach."""


class AbsentError(NotComputedError, ArgumentError):
    """A member that this study does not have, such as a number of a float, if there is none.

    Members that need it are absent too.
    """


@dataclass
class Member(Generic[T]):
    """Declaration of a result of a study.

    On a study it gives the value, which is computed once and cached; on the class, itself.
    """

    compute: Method[T]
    role: Role
    quantity: str = ""
    meaning: str = ""  # of checks: the message if the limit is exceeded
    dims: tuple[str, ...] = ()
    limit: float | str = 0.0  # a number, or the name of a member or key
    headline: bool = False
    headlines: tuple[str, ...] = ()  # of several
    when: str = ""  # member or key that it requires
    reported_as: str = ""  # name in results, if a key has the name of the method
    several: bool = False  # a mapping or a sequence, with names known after computing only
    declared: Mapping[str, tuple[Any, ...]] = field(
        default_factory=dict[str, tuple[Any, ...]]
    )  # names known before
    of: Any = None  # of `parts`: the dataclass
    name: str = ""
    part_of: str = ""  # member of whose dataclass it is a field

    def __set_name__(self, owner: type, name: str) -> None:
        self.name, self.__doc__ = name, getattr(self.compute, "__doc__", "")
        self.reported_as = self.reported_as or name

    @overload
    def __get__(self, study: None, owner: Any = None) -> Self: ...
    @overload
    def __get__(self, study: object, owner: Any = None) -> T: ...
    def __get__(self, study: Any, owner: Any = None) -> Any:
        if study is None:
            return self
        kept: dict[str, Any] = study.__dict__
        if self.name not in kept:
            kept[self.name] = study.computed(self)
        return kept[self.name]

    @property
    def declares(self) -> Mapping[str, tuple[Any, ...]]:
        """Quantity, dimensions if it has some, and meaning of each result, by name."""
        one = (self.quantity, self.dims, self.meaning)
        return self.declared if self.several else {self.reported_as: one if self.dims else one[::2]}

    @property
    def names(self) -> Sequence[str]:
        """Names by which its results are requested; for several, also its own for all of them."""
        if self.role not in ("scalar", "array", "check"):
            return ()
        own = [*self.declared, self.name] if self.several else [self.reported_as.replace(" ", "_")]
        return tuple(dict.fromkeys(own))

    def asked_by(self, names: Iterable[str]) -> bool:
        """Whether one of the names is that of one of its results, or begins so before a dot."""
        heads = {name.partition(".")[0] for name in self.names}
        return any(name.partition(".")[0] in heads for name in names)

    def reported(self, found: Any, names: Sequence[str]) -> Iterator[tuple[str, Any]]:
        """Yield results by name; for several the requested ones, or all without names."""
        if not self.several:
            yield self.reported_as, found
            return
        for name, one in found.items():
            if not names or {name, name.partition(".")[0], self.name} & {*names}:
                yield name, one

    @property
    def named(self) -> Sequence[str]:
        """Members and keys, which may be dotted, that its declaration refers to."""
        named = [self.when] if self.when else []
        named += [self.limit] if isinstance(self.limit, str) else []
        if self.role == "check" and not self.several:
            fields_ = [
                name for _, name, _, _ in Formatter().parse(self.meaning) if name is not None
            ]
            named += [name for name in fields_ if name not in ("value", "limit")]
        return named


Declared = Callable[[Method[T]], Member[T]]


def _declare(role: Role, quantity: str, meaning: str, dims: str = "", **more: Any) -> Any:
    check_quantity(quantity)
    if not meaning.strip():
        raise TypeError(f"a {role} needs a meaning")
    if wrong := [dim for dim in dims.split() if not NAME.fullmatch(dim)]:
        raise TypeError(f'{", ".join(wrong)}: dimensions are words, such as "mass time"')
    named = tuple(dims.split())

    def made(compute: Method[Any]) -> Member[Any]:
        return Member(compute, role, quantity, meaning, named, **more)

    return made


def stage(compute: Method[T]) -> Member[T]:
    """A step of the computation. It is timed; a failure is stored with its partial result."""
    return Member(compute, "stage")


def scalar(
    quantity: str, meaning: str, *, headline: bool = False, when: str = "", name: str = ""
) -> Declared[T]:
    """A number of the result: None if unknown, absent without the member or key `when`.

    `name` is its name in results, if a key has the name of the method.
    """
    return _declare("scalar", quantity, meaning, headline=headline, when=when, reported_as=name)


def scalars(
    declared: Mapping[str, tuple[str, str]], *, when: str = "", headline: Iterable[str] = ()
) -> Declared[Mapping[str, Any]]:
    """Numbers computed together, some of `declared` (name: quantity, meaning), or Scalars."""
    known = dict(declared)
    return lambda compute: Member(
        compute, "scalar", several=True, declared=known, when=when, headlines=tuple(headline)
    )


def array(quantity: str, dims: str, meaning: str, *, when: str = "", name: str = "") -> Declared[T]:
    """A variable of the result over dimensions, such as ``"mass time"``."""
    return _declare("array", quantity, meaning, dims, when=when, reported_as=name)


def arrays(
    declared: Mapping[str, tuple[str, tuple[str, ...], str]], *, when: str = ""
) -> Declared[Mapping[str, Any]]:
    """Arrays computed together, some of `declared` (name: quantity, dimensions, meaning)."""
    known = dict(declared)
    return lambda compute: Member(compute, "array", several=True, declared=known, when=when)


def check(
    limit: float | str, advice: str, quantity: str = "", *, when: str = "", name: str = ""
) -> Declared[T]:
    """A number accepted up to a limit.

    Beyond it `advice` is reported, with fields such as ``{value}``, ``{limit}``, ``{film.top}``.
    `limit` is a number, or the name of a member or key.
    """
    return _declare("check", quantity, advice, limit=limit, when=when, reported_as=name)


def _several(role: Role) -> Any:
    return partial(Member, role=role, several=True)


def checks(compute: Method[Iterable[Check]]) -> Member[Iterable[Check]]:
    """Checks whose number or advice depends on the study."""
    return _several("check")(compute)


def warnings(compute: Method[Iterable[str]]) -> Member[Iterable[str]]:
    """Warnings in words."""
    return _several("warning")(compute)


def facts(compute: Method[Mapping[str, Any]]) -> Member[Mapping[str, Any]]:
    """Parts of the trust report that are neither accepted nor refused, by name."""
    return _several("fact")(compute)


def attributes(compute: Method[Mapping[str, Any]]) -> Member[Mapping[str, Any]]:
    """Data for pictures and exports that fit no array, by name."""
    return _several("attribute")(compute)


# -- results computed together: a dataclass whose fields are members -------------------------------


def value(
    quantity: str, meaning: str, *, headline: bool = False, when: str = "", name: str = ""
) -> Any:
    """A field that is a scalar of the result, with the name of the field or `name`."""
    made = scalar(quantity, meaning, headline=headline, when=when, name=name)
    return field(metadata={"member": made})


def signal(quantity: str, dims: str, meaning: str, *, when: str = "", name: str = "") -> Any:
    """A field that is a variable of the result, with the name of the field or `name`."""
    return field(metadata={"member": array(quantity, dims, meaning, when=when, name=name)})


def parts(of: type[T], *, when: str = "") -> Declared[T]:
    """Results of one function, as a dataclass; each of its fields is a member too."""
    return lambda compute: Member(compute, "parts", of=of, when=when)


def members_of_parts(whole: Member[Any]) -> Iterator[Member[Any]]:
    """Members of the fields of such a dataclass."""
    for one in fields(whole.of):
        if "member" in one.metadata:
            made: Member[Any] = one.metadata["member"](attrgetter(f"{whole.name}.{one.name}"))
            made.name, made.reported_as = one.name, made.reported_as or one.name
            made.part_of = whole.name
            yield made
