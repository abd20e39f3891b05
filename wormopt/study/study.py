"""A kind of study is one class: its fields are the keys of a scene, its members the results."""

from __future__ import annotations

import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, ClassVar, Literal

import msgspec

from wormopt.errors import Fault, Interrupted, SolveError, UnknownNameError
from wormopt.progress import Report, silent
from wormopt.quantities import Scalar, Variable, unit_of
from wormopt.result import Check, Result, left_out
from wormopt.shown import brief
from wormopt.study.conclude import status_of
from wormopt.study.given import entry
from wormopt.study.later import load
from wormopt.study.members import AbsentError, Member, NotComputedError, members_of_parts
from wormopt.study.plausible import surprises
from wormopt.study.reference import quantity_of
from wormopt.study.types import FOLDER, SceneTable

_PLACE = ("_name", "_folder")  # what a study knows of where it comes from


@dataclass
class _Progress:
    """How far a study is, shared with the studies that run as part of it."""

    report: Report = silent
    timings: dict[str, float] = field(default_factory=dict)
    inner: list[float] = field(default_factory=list)  # seconds of stages within the running ones


class Study(SceneTable):
    """Base of all kinds of study.

    Fields are what a user gives. Members, declared by the decorators of `wormopt.study.members`,
    are what the study computes: each is computed once, when it is first asked for, with what it
    needs and nothing else.
    """

    units_of_texts: ClassVar[str] = "dimensionless"
    members: ClassVar[Mapping[str, Member[Any]]] = {}
    pictures: ClassVar[Mapping[str, str]] = {}
    """Pictures by name: "module:function" that draws one of a Result."""
    wanted: ClassVar[tuple[str, ...]] = ()
    """Pictures for which the study computes more."""
    table_file: ClassVar[bool] = False
    """Whether results have a table file of their own."""
    exports: ClassVar[Mapping[str, str]] = {}
    """Further files by name: "module:function" giving its text of the result, or None."""

    schema: Literal[1] = entry("version of the scene form", default=1)
    kind: str = entry("what the scene computes", default="")

    def __init_subclass__(cls, **config: Any) -> None:
        super().__init_subclass__(**config)
        seen = {n: one for c in reversed(cls.__mro__) for n, one in vars(c).items()}
        found = {n: one for n, one in seen.items() if isinstance(one, Member)}
        for whole in [one for one in found.values() if one.role == "parts"]:
            for part in members_of_parts(whole):
                found.setdefault(part.name, part)
                setattr(cls, part.name, part)
        taken = [n for n in found if hasattr(Study, n)]
        if taken:
            raise TypeError(f"{cls.__name__}.{taken[0]} is a name of Study; choose another")
        cls.members = found
        cls.scalars, headline = {}, list[str]()
        cls.variables = {}
        for one in found.values():
            if one.role == "scalar":
                own = {one.reported_as: (one.quantity, one.meaning)}
                cls.scalars |= one.declared if one.several else own
                headline += one.headlines + (one.reported_as,) * one.headline
            elif one.role == "array":
                own = {one.reported_as: (one.quantity, one.dims, one.meaning)}
                cls.variables |= one.declared if one.several else own
        cls.headline = cls.headline or tuple(headline)
        for one in found.values():
            one.check_words(lambda name: hasattr(cls, name) or name in _annotated(cls))

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
        from wormopt.study.scene import Scene

        return Scene(self.name, self.folder, self)

    @property
    def checks_itself(self) -> bool:
        """Whether a table that was read is checked already."""
        return True

    def placed(self, name: str, folder: Path) -> None:
        """Note the name and the folder of the scene."""
        vars(self).update(_name=name, _folder=folder)

    def wrong(self) -> Iterator[Fault]:
        """Yield all that is wrong with keys that are right each by itself."""
        found = list(super().wrong())
        yield from found or SceneTable.faults(self, self.folder)

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
        """Report what is being done, and the fraction done if it is known."""
        self._progress.report(text, fraction)

    def computed(self, member: Member[Any]) -> Any:
        """Compute a member, which is then kept. A stage that failed fails again in the same way.

        Raises AbsentError if the study has no such member, NotComputedError in partial results.
        """
        if member.when and not self._value_of(member.when):
            raise AbsentError(f"there is no {member.name} without {member.when}")
        if member.role != "stage":
            self._load_imports()
            return member.compute(self)
        if "_closed" in vars(self):
            raise NotComputedError(f"{member.name.replace('_', ' ')} was not computed")
        failures: dict[str, BaseException] = vars(self).setdefault("_failures", {})
        if isinstance(failed := failures.pop(member.name, None), Exception):
            failures[member.name] = failed
            raise failed.with_traceback(None)
        progress = self._progress
        progress.report(member.name.replace("_", " "), None)
        progress.inner.append(0.0)
        start = time.perf_counter()
        try:
            self._load_imports()
            return member.compute(self)
        except (Exception, KeyboardInterrupt) as error:
            failures[member.name] = error
            raise
        finally:
            spent = time.perf_counter() - start
            own = spent - progress.inner.pop()
            progress.timings[member.name] = progress.timings.get(member.name, 0.0) + own
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
        """Why the study was interrupted although every stage has a result; "" if it was not."""
        return ""

    # -- results -----------------------------------------------------------------------------------

    def result(self, report: Report = silent) -> Result:
        """Compute all that the study reports.

        Raises
        ------
        SolveError, Interrupted
            With the Result of what was computed before as `partial`.
        """
        return self._reported((), report)

    def only(self, *names: str, report: Report = silent) -> Result:
        """Compute some scalars, variables or checks, and nothing that they do not need.

        The status is "unchecked", and the trust report lists the checks that were left out.
        """
        known = [one for member in self.members.values() for one in member.names]
        heads = {one.partition(".")[0] for one in known}
        if unknown := [name for name in names if name.partition(".")[0] not in heads]:
            raise UnknownNameError(f"a study of kind {self.kind}", "result", unknown, known)
        return self._reported(names, report)

    def __getitem__(self, name: str) -> Any:
        """Value of a scalar or variable by its name in results."""
        for member in self.members.values():
            if member.role in ("scalar", "array") and member.may_be((name,)):
                found = getattr(self, member.name)
                if not member.several:
                    return found
                if name in found:
                    return getattr(found[name], "value", found[name])
        known = [*self.scalars, *self.variables]
        raise UnknownNameError(f"a study of kind {self.kind}", "result", [name], known)

    def _reported(self, names: Sequence[str], report: Report) -> Result:
        self._progress.report = report
        try:
            result = self._complete(names)
        except SolveError as error:
            found = self._unfinished(str(error))
            raise SolveError(error.reason, error.suggestion, found, error.code) from None
        except KeyboardInterrupt as stop:
            during = [n for n, e in vars(self).get("_failures", {}).items() if e is stop]
            where = f" during {during[0].replace('_', ' ')}" if during else ""
            found = self._unfinished(f"interrupted{where}")
            if not found.scalars and not found.variables:
                raise
            raise Interrupted(found) from None
        if reason := self.stopped():
            raise Interrupted(result.failed(reason))
        return result

    def _complete(self, names: Sequence[str]) -> Result:
        if names:
            return self._partly(names)
        scalars, variables = self._scalars(), self._variables()
        checks, warned = list(self._checks()), [*self._given_warnings(), *self._warnings()]
        status, reasons = status_of(checks, warned)
        trust = {**self.facts, **self._joined("fact")}
        if checks:
            trust["checks"] = {one.name: one.found() for one in checks}
        return self._made(
            status=status,
            reason="; ".join(reasons),
            scalars=scalars,
            variables=variables,
            trust=trust | {"warnings": [*dict.fromkeys(warned)]},
            attributes=self._joined("attribute"),
        )

    def _partly(self, names: Sequence[str]) -> Result:
        """Result of some members only."""
        scalars, variables = self._scalars(names), self._variables(names)
        checks = list(self._checks(names))
        failed = "; ".join(one.advice for one in checks if not one.passed)
        left = [m.name for m in self.members.values() if m.role == "check" and not m.may_be(names)]
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

    def _unfinished(self, reason: str) -> Result:
        """Result of the stages that are finished; arrays also of what failed stages handed over."""
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
        """Copy that computes no stage, with what is finished and, if asked for, partial stages."""
        copy = msgspec.structs.replace(self)
        vars(copy).update(vars(self), _closed=True)
        for name, error in vars(self).get("_failures", {}).items():
            handed = getattr(error, "partial", None)
            if partials and handed is not None:
                vars(copy)[name] = handed
        return copy

    def _made(self, **found: Any) -> Result:
        scene = self.scene
        return Result(
            self.name, self.kind, scene.title, timings_s=dict(self._progress.timings),
            scene_text=scene.text, **found,
        )  # fmt: skip

    def _given_warnings(self) -> Iterator[str]:
        """Yield warnings about what was given."""
        yield from surprises(self, self.units)
        yield from self.file_warnings(self.folder, self.units)

    def _members(self, role: str, names: Sequence[str]) -> Iterator[tuple[Member[Any], Any]]:
        """Yield members of a role with their values, without absent ones and those not reached."""
        for member in self.members.values():
            if member.role != role or (names and not member.may_be(names)):
                continue
            try:
                yield member, getattr(self, member.name)
            except AbsentError:
                continue
            except NotComputedError:
                if "_closed" not in vars(self):
                    raise

    def _joined(self, role: str) -> dict[str, Any]:
        return {name: one for _, found in self._members(role, ()) for name, one in found.items()}

    def _scalars(self, names: Sequence[str] = ()) -> dict[str, Scalar]:
        reported: dict[str, Scalar] = {}
        for member, value in self._members("scalar", names):
            found = value if member.several else {member.reported_as: value}
            for name, one in found.items():
                quantity = member.declared[name][0] if name in member.declared else member.quantity
                unit = unit_of(quantity, self.units) if quantity else "1"
                reported[name] = one if isinstance(one, Scalar) else Scalar(one, unit)
        return {name: one for name, one in reported.items() if not names or name in names}

    def _variables(self, names: Sequence[str] = ()) -> tuple[Variable, ...]:
        reported: list[Variable] = []
        for member, value in self._members("array", names):
            own = {member.reported_as: (member.quantity, member.dims, member.meaning)}
            declared = member.declared if member.several else own
            for name, one in value.items() if member.several else [(member.reported_as, value)]:
                if isinstance(one, Variable):
                    reported.append(one)
                elif one is not None:
                    quantity, dims, what = declared[name]
                    unit = unit_of(quantity, self.units) if quantity else "1"
                    reported.append(Variable(name, unit, tuple(dims), one, what))
        return tuple(one for one in reported if not names or one.name in names)

    def _checks(self, names: Sequence[str] = ()) -> Iterator[Check]:
        for member, value in self._members("check", names):
            if member.several:
                yield from value
                continue
            limit = member.limit
            limit = self._value_of(limit) if isinstance(limit, str) else limit
            made = Check(member.reported_as.replace("_", " "), value, limit)
            yield made if made.passed else replace(made, advice=self._worded(member, value, limit))

    def _warnings(self) -> Iterator[str]:
        for member, value in self._members("warning", ()):
            if member.several:
                yield from value
            elif value > member.limit:
                words = self._worded(member, value, member.limit)
                yield left_out(value, words) if member.neglected else words

    def _worded(self, member: Member[Any], value: Any, limit: Any) -> str:
        """Words of a check or warning with the values and units of what they name."""
        return member.meaning.format_map(_Values(self, member, value, limit))

    def _value_of(self, path: str) -> Any:
        found: Any = self
        for name in path.split("."):
            found = getattr(found, name)
        return found


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
        unit = unit_of(self._quantity, self._study.units) if self._quantity else "1"
        return text if unit == "1" else f"{text} {unit}"


class _Values(dict[str, Any]):
    """What the fields of a message stand for."""

    def __init__(self, study: Study, member: Member[Any], value: Any, limit: Any) -> None:
        of_member = (_Amount(study, "", one, member.quantity) for one in (value, limit))
        super().__init__(zip(("value", "limit"), of_member, strict=True))
        self._study = study

    def __missing__(self, name: str) -> _Amount:
        member = self._study.members.get(name)
        quantity = member.quantity if member else quantity_of(type(self._study), name)
        return _Amount(self._study, name, getattr(self._study, name), quantity)


def _annotated(kind: type) -> set[str]:
    return {name for c in kind.__mro__ for name in vars(c).get("__annotations__", {})}
