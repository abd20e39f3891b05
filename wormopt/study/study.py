# pyright: strict
"""A kind of study is one class: its fields are the keys of a scene, its members the results."""

from __future__ import annotations

import hashlib
import json
import time
from collections.abc import Callable, Generator, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager, nullcontext, suppress
from dataclasses import dataclass, field, replace
from difflib import get_close_matches
from functools import cached_property
from itertools import chain
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, Generic, Literal, Self, TypeVar, cast

import msgspec
from msgspec import Struct, structs

from wormopt.errors import Fault, Interrupted, SolveError, UnknownNameError, interruptible
from wormopt.lazy import load
from wormopt.progress import Report, silent
from wormopt.quantities import Scalar, Variable, unit_of
from wormopt.result import Check, Result, Status, Unchecked
from wormopt.shown import brief, lines
from wormopt.study.given import Given, bare, default_of, entry, tables_in
from wormopt.study.members import AbsentError, Member, NotComputedError, members_of_parts
from wormopt.study.plausible import items_of, unusual_sizes
from wormopt.study.reference import quantity_of
from wormopt.study.swept import Swept
from wormopt.study.toml import Overrides
from wormopt.study.types import FOLDER, Title

T = TypeVar("T")
Names = Sequence[str]
_PLACE = ("_name", "_folder")  # attributes with the origin of a study


@dataclass
class _Progress:
    """Progress of a study, shared with the studies that run as part of it."""

    report: Report = silent
    timings: dict[str, float] = field(default_factory=dict[str, float])
    inner: list[float] = field(
        default_factory=list[float]
    )  # seconds of stages within the running ones


class Study(Given):
    """Base of all kinds of study.

    Fields are what a user gives. Members, declared by the decorators of `wormopt.study.members`,
    are what the study computes: each is computed once, when it is first asked for, with what it
    needs and nothing else.
    """

    units_of_texts: ClassVar[str] = "dimensionless"
    members: ClassVar[Mapping[str, Member[Any]]] = {}
    scalars: ClassVar[Mapping[str, tuple[str, str]]] = {}
    """Quantity and meaning of scalars whose names are known, by name."""
    variables: ClassVar[Mapping[str, tuple[str, tuple[str, ...], str]]] = {}
    """Quantity, dimensions and meaning of variables whose names are known, by name."""
    headline: ClassVar[tuple[str, ...]] = ()
    """Scalars that answer what was asked, reported first; the first five if empty."""
    pictures: ClassVar[Mapping[str, str | tuple[str, str]]] = {}
    """Meaning of pictures by name, for the key `want`.

    A function of that name in `pictures.py` of the system draws one of a Result. Another is named
    after the meaning, as "function" or "module:function".
    """
    drawn_by: ClassVar[Mapping[str, str]] = {}
    """Functions of pictures by name, "module:function"."""
    refuses: ClassVar[Mapping[str, str]] = {}
    """Keys that the kind does not take of shared tables: why, and what to write instead.

    By dotted path; the tag of a table comes after its key. Templates, pages and schemas leave them
    out.
    """
    wanted: ClassVar[tuple[str, ...]] = ()
    """Pictures for which the study computes more."""
    table_file: ClassVar[bool] = False
    """Whether results have a table file of their own."""
    exports: ClassVar[Mapping[str, str]] = {}
    """Further files by name: "module:function" giving its text of the result, or None."""
    resumes: ClassVar[bool] = False
    """Whether a study that was interrupted continues from there when it is run again."""

    schema: Literal[1] = entry("version of the scene form", default=1)
    kind: str = entry("what the scene computes", default="")
    title: Title = entry("title of pictures and reports; its name if left out", default="")
    units: Literal["dimensionless", "SI"] = entry(
        "names of the units in the results; nothing is converted", default="dimensionless"
    )
    want: tuple[str, ...] = entry("pictures to draw, each once", default=())

    def __init_subclass__(cls, **config: Any) -> None:
        super().__init_subclass__(**config)
        seen = {name: one for c in reversed(cls.__mro__) for name, one in vars(c).items()}
        found: dict[str, Member[Any]] = {n: m for n, m in seen.items() if isinstance(m, Member)}
        for whole in [one for one in found.values() if one.role == "parts"]:
            for part in members_of_parts(whole):
                if isinstance(seen.get(part.name), property | cached_property):
                    raise TypeError(f"{cls.__name__}.{part.name} is a part of {whole.name} too")
                if found.setdefault(part.name, part) is part:
                    setattr(cls, part.name, part)
                elif found[part.name].part_of not in ("", whole.name):
                    raise TypeError(f"{cls.__name__}.{part.name} is a part of two members")
        for name in found:
            if hasattr(Study, name):
                raise TypeError(f"{cls.__name__}.{name} is a name of Study; choose another")
        cls.members = found
        room = cls.__module__.rpartition(".")[0]
        cls.drawn_by = {}
        for name, said in cls.pictures.items():
            function = name if isinstance(said, str) else said[1]
            own = f"{room}.pictures:{function}"
            cls.drawn_by[name] = function if ":" in function else own
        numbers = [one for one in found.values() if one.role == "scalar"]
        cls.scalars = {name: meant for one in numbers for name, meant in one.declares.items()}
        headline = (one.headlines or (one.reported_as,) * one.headline for one in numbers)
        cls.headline = cls.headline or tuple(chain.from_iterable(headline))
        signals = [one for one in found.values() if one.role == "array"]
        cls.variables = {
            name: declared for one in signals for name, declared in one.declares.items()
        }

    @classmethod
    def check_class(cls) -> None:
        """Raise TypeError for members that have the name of a key, or name what is not there."""
        for member in cls.members.values():
            if member.name in cls.__struct_fields__:
                raise TypeError(f"{cls.__name__}.{member.name} is a key and a member")
            if wrong := [path for path in member.named if not _has(cls, path)]:
                what = f"names {', '.join(wrong)}, which is not a member or key"
                raise TypeError(f"{cls.__name__}.{member.name} {what}")

    # -- what was given, and where -----------------------------------------------------------------

    @property
    def name(self) -> str:
        """Name of the scene."""
        return vars(self).get("_name", self.kind)

    @property
    def folder(self) -> Path:
        """Folder to which file names in the scene are relative."""
        return vars(self).get("_folder") or FOLDER.get(Path())

    @property
    def scene(self) -> Any:
        """The study as a Scene."""
        return Scene(self.name, self.folder, self)

    def __repr__(self) -> str:
        own = [one for one in structs.fields(self) if one.name not in Study.__struct_fields__]
        given = [one.name for one in own if getattr(self, one.name) != default_of(one)]
        title = f": {self.title}" if self.title else ""
        return lines(f"{type(self).__name__} {self.name}{title}", f"given: {', '.join(given)}")

    def placed(self, name: str, folder: Path) -> None:
        """Set the name and the folder of the scene."""
        vars(self).update(_name=name, _folder=folder)

    def vary(self, *changes: Overrides, **tables: Any) -> Self:
        """Make the same with other keys, which may be dotted: ``vary({"film.depth": "5 mm"})``."""
        before = FOLDER.set(self.folder)
        try:
            varied = super().vary(*changes, **tables)
        finally:
            FOLDER.reset(before)
        varied.placed(self.name, self.folder)
        return varied

    def wrong(self) -> Iterator[Fault]:
        """Yield refused keys, and only without them faults between keys that are valid."""
        found = [fault for path in self.refuses for fault in self._refused(path)]
        found = found or [*super().wrong()]
        twice = sorted({word for word in self.want if self.want.count(word) > 1})
        yield from found or (("want", f'"{word}" is given twice; write it once') for word in twice)

    def _refused(self, path: str) -> Iterator[Fault]:
        places = _given_at(self, path.split("."), "")
        return ((place, self.refuses[path]) for place in places)

    def __reduce__(self) -> Any:
        place = {name: one for name, one in vars(self).items() if name in _PLACE}
        return (*super().__reduce__(), place)

    def __setstate__(self, place: Mapping[str, Any]) -> None:
        vars(self).update(place)

    # -- computing ---------------------------------------------------------------------------------

    @property
    def _progress(self) -> _Progress:
        return vars(self).setdefault("_shared_progress", _Progress())

    def report(self, text: str, fraction: float | None = None) -> None:
        """Report the present step, and the fraction done if it is known."""
        self._progress.report(text, fraction)

    def computed(self, member: Member[Any]) -> Any:
        """Compute and cache a member. A failed one fails again in the same way."""
        if member.when and not self._value_of(member.when):
            raise AbsentError(f"there is no {member.name} without {member.when}")
        failures = self._failures
        failed = failures.get(member.name)
        if "_closed" in vars(self) and (failed or member.role == "stage"):
            raise NotComputedError(f"{member.name.replace('_', ' ')} was not computed")
        if isinstance(failed, Exception):
            raise failed.with_traceback(None)
        failures.pop(member.name, None)  # an interrupted one is computed again
        try:
            with self._timed(member.name) if member.role == "stage" else nullcontext():
                self._load_imports()
                found: Any = member.compute(self)
                return [*found] if member.several and hasattr(found, "__next__") else found
        except (Exception, KeyboardInterrupt) as error:
            if member.role == "stage" or error not in failures.values():
                failures[member.name] = error
            raise

    @property
    def _failures(self) -> dict[str, BaseException]:
        """Errors of stages, and of other members that caused them, by name."""
        return vars(self).setdefault("_failed", {})

    @contextmanager
    def _timed(self, stage: str) -> Generator[None]:
        """Report a stage, and measure its time without that of stages within it."""
        progress = self._progress
        progress.report(stage.replace("_", " "), None)
        progress.inner.append(0.0)
        start = time.perf_counter()
        try:
            with interruptible():  # here it still is the interrupt of this stage
                yield
        finally:
            spent = time.perf_counter() - start
            own = spent - progress.inner.pop()
            progress.timings[stage] = progress.timings.get(stage, 0.0) + own
            if progress.inner:
                progress.inner[-1] += spent

    def _load_imports(self) -> None:
        for kind in type(self).__mro__[:-1]:
            if issubclass(kind, Study):
                load(kind.__module__)

    def part_of(self, whole: Study) -> None:
        """Report progress and count times as part of another study."""
        vars(self)["_shared_progress"] = whole._progress

    def models(self) -> dict[str, Any] | None:
        """Models that are simulated, by label, for fits and exports; None without any."""
        return None

    def stopped(self) -> str:
        """Reason for an interruption although every stage has a result; "" if there was none."""
        return ""

    def unsolved(self) -> SolveError | None:
        """Error of a study without an answer although every stage has a result, None otherwise."""
        return None

    # -- results -----------------------------------------------------------------------------------

    def result(self, report: Report | None = None) -> Result:
        """Compute all that the study reports.

        Raises
        ------
        SolveError, Interrupted
            With the Result of what was computed before as `partial`.
        """
        return self._reported((), report)

    def only(self, *names: str, report: Report | None = None) -> Result:
        """Compute some scalars, variables or checks, with the members that they need.

        The status is "unchecked", and the trust report lists the checks that were left out.
        Raises UnknownNameError for names that results of the kind never have, else as `result`.
        """
        return self._reported(self.check_names(names), report)

    def check_names(self, names: Names) -> Names:
        """Names of results as those of members; UnknownNameError for others."""
        asked = [name.replace(" ", "_") for name in names]  # names of checks have spaces
        members = self.members.values()
        if unknown := [name for name in asked if not any(m.asked_by([name]) for m in members)]:
            checks = [m.names[0] for m in members if m.role == "check" and not m.several]
            known = dict.fromkeys([*self.scalars, *self.variables, *checks])
            open_ = [m for m in members if m.several and m.names and not m.declared]
            groups = ", ".join(repr(member.name) for member in open_)
            hint = f"write {groups} for names that depend on the scene" if groups else ""
            raise UnknownNameError(f"a study of kind {self.kind}", "result", unknown, known, hint)
        return asked

    def __getitem__(self, name: str) -> Any:
        """Value of a scalar or variable by its name in results."""
        reported = [one for one in self.members.values() if one.role in ("scalar", "array")]
        asked = [one for one in reported if one.asked_by([name])]
        for member in asked or [one for one in reported if one.several]:
            if not member.several:
                if member.reported_as == name:
                    return _bare(getattr(self, member.name))
                continue
            with nullcontext() if asked else suppress(AbsentError):
                if name in (found := getattr(self, member.name)):
                    return _bare(found[name])
        known = [*self.scalars, *self.variables]
        if name in known:
            raise AbsentError(f"this study has no {name}")
        raise UnknownNameError(f"a study of kind {self.kind}", "result", [name], known)

    if not TYPE_CHECKING:  # type checkers know members, and refuse other names

        def __getattr__(self, name: str) -> Any:
            """Value of a scalar or variable that is computed together with others."""
            if hasattr(type(self), name):  # its own AttributeError
                return object.__getattribute__(self, name)
            if name in (reported := {**self.scalars, **self.variables}):
                return self[name]
            close = get_close_matches(name, {**reported, **self.members}, n=1)
            hint = f"; did you mean {close[0]!r}?" if close else ""
            raise AttributeError(f"a study of kind {self.kind} has no {name!r}{hint}")

    def _reported(self, names: Names, report: Report | None) -> Result:
        before = self._progress.report
        self._progress.report = report or before
        try:
            result = self._partly(names) if names else self._complete()
        except SolveError as error:
            found = self.unfinished(str(error))
            raise SolveError(error.reason, error.suggestion, found, error.code) from None
        except KeyboardInterrupt as stop:
            during = [name for name, error in self._failures.items() if error is stop]
            where = f" during {during[0].replace('_', ' ')}" if during else ""
            resume = "; run again to resume" if self.resumes else ""
            found = self.unfinished(f"interrupted{where}{resume}")
            if not found.scalars and not found.variables:
                raise
            raise Interrupted(found) from None
        finally:
            self._progress.report = before
        done = self._closed(partials=False)
        with suppress(NotComputedError):
            if reason := done.stopped():
                self.forget()
                raise Interrupted(result.failed(reason))
            if error := done.unsolved():
                found = result.failed(error.reason)
                raise SolveError(error.reason, error.suggestion, found, error.code)
        return result

    def forget(self) -> None:
        """Drop cached results."""
        for name in [name for name in vars(self) if not name.startswith("_")]:
            del vars(self)[name]

    def _complete(self) -> Result:
        return self.concluded(
            self._scalars(), self._variables(), self._checks(), self._warnings(),
            self._joined("fact"), self._joined("attribute"),
        )  # fmt: skip

    def concluded(
        self,
        scalars: Mapping[str, Any],
        variables: Iterable[Variable],
        checks: Sequence[Check],
        warnings: Iterable[str],
        facts: Mapping[str, Any],
        attributes: Mapping[str, Any],
    ) -> Result:
        """Make a result: failed if a check is, unchecked if a warning says so."""
        warned = [*self._given_warnings(), *warnings]
        status, reasons = status_of(checks, warned)
        trust = {**self.facts, **facts}
        if checks:
            trust["checks"] = {one.name: one.found() for one in checks}
        return self._made(
            status=status,
            reason="; ".join(reasons),
            scalars=dict(scalars),
            variables=tuple(variables),
            trust=trust | {"warnings": [*dict.fromkeys(warned)]},
            attributes=attributes,
        )

    def _partly(self, names: Names) -> Result:
        """Result of some members only."""
        scalars, variables, checks = (
            self._scalars(names), self._variables(names), self._checks(names),
        )  # fmt: skip
        if not (scalars or variables or checks):
            raise AbsentError(f"this study has no {', '.join(names)}")
        failed = "; ".join(one.advice for one in checks if not one.passed)
        left = [
            member.name.replace("_", " ")
            if member.several
            else member.reported_as.replace("_", " ")
            for member in self.members.values()
            if member.role == "check" and not member.asked_by(names)
        ]
        return self._made(
            status="failed" if failed else "unchecked",
            reason=failed or "only some results were computed",
            scalars=scalars,
            variables=variables,
            trust={
                "checks": {one.name: one.found() for one in checks},
                "checks_left_out": left,
                "warnings": [*dict.fromkeys(self._given_warnings())],
            },
        )

    def unfinished(self, reason: str) -> Result:
        """Result of the finished stages; arrays also of partial results of failed stages."""
        done, begun = self._closed(partials=False), self._closed(partials=True)
        return self._made(
            status="failed",
            reason=reason,
            scalars=done._scalars(),  # noqa: SLF001 - of this class
            variables=begun._variables(),  # noqa: SLF001
            attributes=begun._joined("attribute"),  # noqa: SLF001
            trust={**self.facts, "warnings": [*dict.fromkeys(self._given_warnings())]},
        )

    def _closed(self, partials: bool) -> Study:
        """Copy that computes no stage, with finished results and, if requested, partial ones."""
        copy = msgspec.structs.replace(self)
        vars(copy).update(
            vars(self), _closed=True, _partials=partials, _failed=dict(self._failures)
        )
        for name, error in self._failures.items() if partials else ():
            handed = getattr(error, "partial", None)
            if handed is not None:
                vars(copy)[name] = handed
        return copy

    def _made(self, **found: Any) -> Result:
        scene = self.scene
        return Result(
            self.name, self.kind, scene.title, timings_s=dict(self._progress.timings),
            scene_text=scene.text, **found,
        )  # fmt: skip

    def _given_warnings(self) -> Iterator[str]:
        yield from unusual_sizes(self, self.units)
        yield from self.file_warnings(self.folder, self.units)

    def _gathered(self, role: str, of: Callable[..., Iterable[T]], names: Names = ()) -> list[T]:
        """Results of the members of a role, without absent and unreached ones."""
        gathered: list[T] = []
        for member in self.members.values():
            if member.role != role or (names and not member.asked_by(names)):
                continue
            try:
                gathered += list(of(member, getattr(self, member.name)))
            except NotComputedError as error:
                partly = "_closed" in vars(self) or isinstance(error, AbsentError)
                if names or not partly:
                    raise
            except Exception:
                if not vars(self).get("_partials"):  # a partial result may not be enough for it
                    raise
        return gathered

    def _joined(self, role: str) -> dict[str, Any]:
        def of(_: Member[Any], found: Mapping[str, Any]) -> Iterable[tuple[str, Any]]:
            return found.items()

        return dict(self._gathered(role, of))

    def _scalars(self, names: Names = ()) -> dict[str, Scalar]:
        def of(member: Member[Any], found: Any) -> Iterator[tuple[str, Scalar]]:
            for name, one in member.reported(found, names):
                yield name, self.with_unit(name, one, member.declares)

        return dict(self._gathered("scalar", of, names))

    def _variables(self, names: Names = ()) -> tuple[Variable, ...]:
        def of(member: Member[Any], found: Any) -> Iterator[Variable]:
            for name, one in member.reported(found, names):
                if one is not None:
                    yield self.variable(name, one, member.declares)

        return tuple(self._gathered("array", of, names))

    def unit_in_results(self, quantity: str) -> str:
        """Unit of a quantity in the results of this study."""
        return unit_of(quantity, self.units) if quantity else "1"

    def with_unit(
        self, name: str, value: Any, declared: Mapping[str, tuple[Any, ...]] | None = None
    ) -> Scalar:
        """Scalar of a declared name, or a Scalar itself."""
        quantity = (self.scalars if declared is None else declared).get(name, ("",))[0]
        return value if isinstance(value, Scalar) else Scalar(value, self.unit_in_results(quantity))

    def variable(
        self, name: str, values: Any, declared: Mapping[str, tuple[Any, ...]] | None = None
    ) -> Variable:
        """Variable of a declared name, or a variable itself."""
        if isinstance(values, Variable):
            return values
        quantity, dims, what = (self.variables if declared is None else declared)[name]
        return Variable(name, self.unit_in_results(quantity), tuple(dims), values, what)

    def _checks(self, names: Names = ()) -> list[Check]:
        def of(member: Member[Any], found: Any) -> Iterator[Check]:
            if member.several:
                yield from found
                return
            limit = member.limit
            limit = self._value_of(limit) if isinstance(limit, str) else limit
            made = Check(member.reported_as.replace("_", " "), found, limit)
            if not made.passed:
                values = _Values(self, member, found, limit)
                made = replace(made, advice=member.meaning.format_map(values))
            yield made

        return self._gathered("check", of, names)

    def _warnings(self) -> list[str]:
        def of(_: Member[Any], found: Iterable[str]) -> Iterable[str]:
            return found

        return self._gathered("warning", of)

    def _value_of(self, path: str) -> Any:
        found: Any = self
        for name in path.split("."):
            found = getattr(found, name)
        return found


def status_of(checks: Sequence[Check], warned: Iterable[str]) -> tuple[Status, dict[str, None]]:
    """Status of a result by its checks and warnings, with reasons."""
    failed = dict.fromkeys(check.advice for check in checks if not check.passed)
    if failed:
        return "failed", failed
    doubts = dict.fromkeys(str(text) for text in warned if isinstance(text, Unchecked))
    if not checks and not doubts:
        doubts = {"no check of the numbers was made": None}
    return ("unchecked" if doubts else "ok"), doubts


TableT = TypeVar("TableT", bound=Study, covariant=True)


@dataclass(frozen=True)
class Scene(Generic[TableT]):
    """A scene as data, without results.

    Parameters
    ----------
    name : str
        Stem of the file name, or the given name.
    folder : Path
        Folder of the file; file names in the scene are relative to it.
    table : Study
        The content, of the class of the scene's kind.
    sweep : Swept, optional
        Keys varied when the scene is swept.

    Examples
    --------
    >>> from wormopt.study import load_scene
    >>> scene = load_scene("fast_gait")
    >>> scene.name, scene.table.kind, scene.table.worm.links
    ('fast_gait', 'gait', 2)
    """

    name: str
    folder: Path
    table: TableT
    sweep: Swept | None = None

    def __repr__(self) -> str:
        return lines(f"Scene {self.name} ({self.table.kind}): {self.title}")

    @property
    def title(self) -> str:
        """Title given in the scene, its name otherwise."""
        return self.table.title or self.name

    @property
    def text(self) -> str:
        """Every key of the scene, defaults included, as JSON text."""
        table = _without_none(msgspec.to_builtins(self.table))
        return json.dumps(table, ensure_ascii=False, sort_keys=True)

    @property
    def key(self) -> str:
        """Hash of the content: equal scenes have equal keys."""
        return hashlib.sha256(self.text.encode()).hexdigest()

    @property
    def warnings(self) -> tuple[str, ...]:
        """Warnings about unlikely values, such as a link of 300 m."""
        return tuple(unusual_sizes(self.table, self.table.units))


def _without_none(value: Any) -> Any:
    if isinstance(value, dict):
        table = cast("dict[str, Any]", value)
        return {key: _without_none(item) for key, item in table.items() if item is not None}
    return value


class _Amount:
    """A value in a message, with its unit; `{film.top}` reads a key of a table."""

    def __init__(self, study: Study, path: str, value: Any, quantity: str) -> None:
        self._study, self._path, self._value, self._quantity = study, path, value, quantity

    def __getattr__(self, name: str) -> _Amount:
        path = f"{self._path}.{name}"
        value = getattr(self._value, name)
        return _Amount(self._study, path, value, quantity_of(type(self._study), path))

    def __format__(self, form: str) -> str:
        text = format(self._value, form) if form else brief(self._value)
        unit = self._study.unit_in_results(self._quantity)
        return text if unit == "1" else f"{text} {unit}"


class _Values(dict[str, Any]):
    """Values of the fields of a message."""

    def __init__(self, study: Study, member: Member[Any], value: Any, limit: Any) -> None:
        of_member = (_Amount(study, "", one, member.quantity) for one in (value, limit))
        super().__init__(zip(("value", "limit"), of_member, strict=True))
        self._study = study

    def __missing__(self, name: str) -> _Amount:
        member = self._study.members.get(name)
        quantity = member.quantity if member else quantity_of(type(self._study), name)
        return _Amount(self._study, name, getattr(self._study, name), quantity)


def _given_at(value: Any, names: Sequence[str], key: str) -> Iterator[str]:
    """Key paths at which a value below a table is given, not by default."""
    if not names:
        yield key
    elif isinstance(value, tuple):
        for place, item in items_of(value, key):
            yield from _given_at(item, names, place)
    elif isinstance(value, Struct):
        first, *rest = names
        if value.__struct_config__.tag == first:
            yield from _given_at(value, rest, key)
        for each in structs.fields(value):
            below = getattr(value, each.name)
            # 0 and false say that there is none
            if each.name == first and below and below != default_of(each):
                yield from _given_at(below, rest, f"{key}.{first}" if key else first)


def _has(study: type[Study], path: str) -> bool:
    """Whether a study has a member or key; keys may be dotted, down to a property of a table."""
    inside: list[Any] = [study]
    for name in path.split("."):
        with_it = [table for table in inside if name in table.__struct_fields__]
        if not with_it:
            return any(hasattr(table, name) for table in inside)
        types = [f.type for t in with_it for f in msgspec.structs.fields(t) if f.name == name]
        inside = [table for kind in types for table in tables_in(bare(kind))]
    return True


def _bare(found: Any) -> Any:
    """Value of a result without its unit."""
    if isinstance(found, Variable):
        return found.values
    return found.value if isinstance(found, Scalar) else found
