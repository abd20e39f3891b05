"""A user's model: a function in a Python file beside the scene that returns a Model."""

from __future__ import annotations

import ast
import contextlib
import inspect
import math
import re
import sys
import traceback
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from difflib import get_close_matches
from pathlib import Path
from types import ModuleType
from typing import Annotated, Any, NamedTuple

from msgspec import Meta

from wormopt.errors import ArgumentError, Fault, SceneError
from wormopt.study import Given, entry, on_use
from wormopt.study.types import Title
from wormopt.systems.spiked import why_unreadable

with on_use():
    import casadi as ca
    import numpy as np

    from wormopt.control.loop import as_tracked
    from wormopt.model.model import Model
    from wormopt.model.values import signal_values
    from wormopt.quantities import Variable, unit_of_signal
    from wormopt.simulation.trajectory import Trajectory
    from wormopt.systems.shared.signals import sample

_NAME = re.compile(r"[A-Za-z][A-Za-z0-9_]*")
# Names that the Result itself uses.
_TAKEN = {
    "time",
    *(f"event_{what}" for what in ("time", "kind", "contact", "mode")),
    *(f"rest_{what}" for what in ("start", "end", "contact")),
    *("event", "rest", "n_events", "n_steps", "recheck_error"),
}
# What may bind names that the text does not show.
_BINDERS = {"*", "__getattr__", "__dict__", "exec", "globals", "locals", "setattr", "vars"}
_FILE = r"^[^\x00-\x1f]+\.py:[A-Za-z_][A-Za-z0-9_]*$"


class OwnModel(Given):
    """A model of your own: a function in a Python file that returns a `Model`.

    `wormopt check` reads the file without running it: it finds a missing function and wrong
    parameters of a plain one, but not what happens inside. A saved result never runs it. Output
    that the file prints goes to stderr. Errors name the line where there is one: a file that cannot
    be read, is not Python, fails, or lacks the function; parameters that the function does not
    take, or that are missing; a return value other than a Model; invalid names. If the function
    fails because of `parameters`, or a value is outside the bounds of the Model's parameter, the
    message names that key.
    """

    file: Annotated[
        str, Meta(pattern=_FILE, description='"file.py:function", such as "my_worm.py:build"')
    ] = entry("a Python file, relative to the scene's folder, and a function in it")
    parameters: dict[str, Any] = entry(
        "arguments of that function by name: text, true, false, finite numbers, and lists and "
        "tables of these",
        default=dict,
    )

    def faults_in(self, folder: Path) -> Iterator[Fault]:
        """Yield what is wrong in a scene of this folder, without running the file."""
        for name, value in self.parameters.items():
            if not _is_plain(value):
                yield (
                    f"model.parameters.{name}",
                    "is not supported; write text, true, false, a finite number, or lists and "
                    "tables of these",
                )
        shown, _, function = self.file.rpartition(":")
        yield from _faults_of_file(folder / shown, shown, function, self.parameters)

    def load(self, scene: str, folder: Path) -> Model:
        """Run the file and its function; `scene` is a name for messages."""
        file, _, function = self.file.rpartition(":")
        return _load(_Asked(scene, folder, file, function, self.parameters))


class OwnPlant(OwnModel):
    """A plant of your own, which follows the reference instead of a chain.

    Its input must accelerate its output: the output has relative degree two, as a length under a
    force. The result contains every named state and output of the Model beside those listed.
    """

    output: Title = entry("output, or state, that follows the reference", default="length")
    input: Title = entry("input by which the controller acts, of as many entries", default="input")

    def plant(self, scene: str, folder: Path) -> Model:
        """Load the plant, as `as_tracked` makes it of the file's Model."""
        model = self.load(scene, folder)
        try:
            return as_tracked(model, self.output, self.input)
        except ArgumentError as error:
            place = next((k for k in ("output", "input") if f"{k}=" in str(error)), "file")
            raise SceneError(scene, [(f"model.{place}", str(error))]) from None


class _Asked(NamedTuple):
    """The function to run."""

    scene: str
    folder: Path
    file: str
    function: str
    parameters: Mapping[str, Any]


def _faults_of_file(
    path: Path, shown: str, function: str, given: Mapping[str, Any]
) -> Iterator[Fault]:
    """Read the file without running it; only `wormopt run` runs it."""
    unreadable = why_unreadable(path)
    if unreadable:
        yield "model.file", f'"{shown}" cannot be read from {path.parent}: {unreadable}'
        return
    try:
        yield from _faults_of_text(ast.parse(path.read_bytes(), shown), shown, function, given)
    except SyntaxError as error:
        yield "model.file", f"{shown} line {error.lineno}: {error.msg}; write valid Python"
    except (ValueError, RecursionError, MemoryError) as error:
        yield "model.file", f"{shown} is not Python: {error}"


def _faults_of_text(
    tree: ast.Module, file: str, name: str, given: Mapping[str, Any]
) -> Iterator[Fault]:
    """Faults that the text shows: a name that nothing binds, or arguments of a plain function."""
    nodes = [*ast.walk(tree)]
    bound = [found for node in nodes for found in _names_bound(node)]
    mentioned = {getattr(node, "id", getattr(node, "attr", "")) for node in nodes}
    plain = {one.name: one for one in tree.body if isinstance(one, ast.FunctionDef)}
    if name not in bound:
        if not _BINDERS & {*bound, *mentioned}:
            yield "model.file", _no_function(file, name, [*plain])
    elif bound.count(name) == 1 and name in plain and not plain[name].decorator_list:
        taken = plain[name].args
        places = [one.arg for one in (*taken.posonlyargs, *taken.args)]
        needed = places[: len(places) - len(taken.defaults)]
        by_name = zip(taken.kwonlyargs, taken.kw_defaults, strict=True)
        needed += [one.arg for one, default in by_name if default is None]
        known = [one.arg for one in (*taken.args, *taken.kwonlyargs)]
        anything = taken.kwarg is not None
        yield from _faults_of_parameters(name, given, known, needed, anything)


def _names_bound(node: ast.AST) -> Iterator[str]:
    """Names that a piece of Python binds in some scope; "*" for all names of a module."""
    if isinstance(node, ast.alias):
        yield (node.asname or node.name).partition(".")[0]
    elif isinstance(node, ast.Name):
        if isinstance(node.ctx, ast.Store):
            yield node.id
    elif isinstance(found := getattr(node, "name", None), str):
        yield found


def _is_plain(value: object) -> bool:
    """Whether a value has the same meaning in TOML, JSON and Python."""
    if isinstance(value, list):
        return all(_is_plain(item) for item in value)
    if isinstance(value, dict):
        return all(_is_plain(item) for item in value.values())
    if isinstance(value, float):
        return math.isfinite(value)
    return isinstance(value, bool | int | str)


def _load(own: _Asked) -> Model:
    path = own.folder / own.file
    try:
        code = compile(path.read_bytes(), str(path), "exec")
    except (OSError, ValueError, SyntaxError) as error:
        raise _refused(own, f"{own.file} cannot be read: {error}; name a readable file") from None
    module = ModuleType(f"wormopt_model_{path.stem}")
    module.__file__ = str(path)
    sys.modules[module.__name__] = module  # where dataclasses and pickle look for it
    # Stdout belongs to results; what the user's file prints goes to stderr.
    with contextlib.redirect_stdout(sys.stderr):
        # The user's own file, from the scene that the user runs.
        _attempt(own, path, lambda: exec(code, module.__dict__))  # noqa: S102
        function = _function(own, module)
        _check_parameters(own, function)
        given = own.parameters
        model = _attempt(own, path, lambda: function(**given), given)
    if not isinstance(model, Model):
        what = f"{own.function}() returns {_shown(model)}, not a Model"
        raise _refused(own, f"{what}; end it with return Model(...), from wormopt import Model")
    _check_model(own, model)
    return model


def _refused(own: _Asked, message: str, key: str = "model.file") -> SceneError:
    return SceneError(own.scene, [(key, message)])


def _shown(value: object) -> str:
    return "nothing" if value is None else type(value).__name__


def _attempt(
    own: _Asked,
    path: Path,
    action: Callable[[], Any],
    given: Mapping[str, Any] | None = None,
) -> Any:
    try:
        return action()
    except (Exception, SystemExit) as error:
        lines = [
            frame.lineno
            for frame in traceback.extract_tb(error.__traceback__)
            if frame.filename == str(path)
        ]
        where = f" line {lines[-1]}" if lines else ""
        reason = " ".join(str(error).split()) or "no message"
        message = f"{own.file}{where}: {type(error).__name__}: {reason}"
        if not given:
            raise _refused(own, f"{message}; correct it there") from error
        message = f"{own.function}() fails with the given parameters: {message}"
        what = "write other values, or correct the file"
        raise _refused(own, f"{message}; {what}", _blamed(given, reason)) from error


def _blamed(given: Mapping[str, Any] | None, reason: str) -> str:
    """Key of the parameter that an error names, or None."""
    if not given:
        return "model.file"
    named = [name for name in given if re.search(rf"\b{re.escape(name)}\b", reason)] or list(given)
    return f"model.parameters.{named[0]}" if len(named) == 1 else "model.parameters"


def _function(own: _Asked, module: ModuleType) -> Callable[..., Any]:
    file, name = own.file, own.function
    found = getattr(module, name, None)
    if callable(found):
        return found
    functions = [key for key, value in vars(module).items() if inspect.isfunction(value)]
    raise _refused(own, _no_function(file, name, functions))


def _no_function(file: str, name: str, functions: list[str]) -> str:
    close = get_close_matches(name, functions, n=1) or functions[:1]
    hint = f'write "{file}:{close[0]}"' if close else f"define it: def {name}(): ..."
    return f"{file} has no function {name}; {hint}"


def _check_parameters(own: _Asked, function: Callable[..., Any]) -> None:
    try:
        signature = inspect.signature(function)
    except ValueError:  # A function without a signature in Python reports its parameters by itself.
        return
    taken = signature.parameters.values()
    known = [p.name for p in taken if p.kind in (p.POSITIONAL_OR_KEYWORD, p.KEYWORD_ONLY)]
    needed = [p.name for p in taken if p.default is p.empty]
    anything = any(p.kind is p.VAR_KEYWORD for p in taken)
    faults = [*_faults_of_parameters(own.function, own.parameters, known, needed, anything)]
    if faults:
        raise SceneError(own.scene, faults)


def _faults_of_parameters(
    name: str, given: Mapping[str, Any], known: list[str], needed: list[str], anything: bool
) -> Iterator[Fault]:
    for key in given:
        if key not in known and not anything:
            yield f"model.parameters.{key}", f"{name}() has no such parameter; {_hint(key, known)}"
    for key in needed:
        if key in known and key not in given:
            what = f"missing; {name}() needs it, and it has no default"
            yield f"model.parameters.{key}", what


def _hint(key: str, known: list[str]) -> str:
    close = get_close_matches(key, known, n=1)
    if close:
        return f"did you mean {close[0]}?"
    return f"its parameters are {', '.join(known)}" if known else "it has no parameters"


def _check_model(own: _Asked, model: Model) -> None:
    """Refuse a model that cannot be simulated or saved."""
    names = [signal.name for signal in model.x] + [output.name for output in model.outputs]
    for name in names:
        if not isinstance(name, str) or not _NAME.fullmatch(name):
            raise _refused(
                own,
                f"{name!r} is not a valid name; write letters, digits and _, starting with a "
                "letter",
            )
    # Each name is in the Result, with its end as a scalar and its entries as a dimension.
    used = [f"{name}{part}" for name in names for part in ("", "_end", "_entry")]
    for name in names:
        if used.count(name) > 1 or name in _TAKEN:
            raise _refused(own, f"the name {name!r} is already used; rename that state or output")
    try:
        signal_values(model.p, None, "parameter")
    except ArgumentError as error:
        raise _refused(own, str(error), _blamed(own.parameters, str(error))) from error
    if not model.n_x:
        raise _refused(own, "the Model has no states; give it at least one in x")


# -- signals ---------------------------------------------------------------------------------------


def own_signals(model: Model) -> dict[str, str]:
    """Unit of every named state and output of a user's model, and of its contact forces."""
    named = {part.name: part.unit for part in (*model.x, *model.outputs)}
    return named | ({"contact_force": "force"} if model.contacts else {})


def own_variables(
    motions: Sequence[Trajectory], named: Mapping[str, str], units: str, over: str = ""
) -> dict[str, Variable]:
    """Signals of a user's model over time, by name, from their units.

    With `over`, a first dimension of this name counts the motions, of which the shortest ends all.
    """
    count = min(len(motion.time) for motion in motions)
    sampled = [sample(motion, _expressions(motion.system.model, named)) for motion in motions]
    found = {}
    for name, unit in named.items():
        rows = np.array([each[name][:, :count] for each in sampled])
        dims = [over, *([f"{name}_entry"] if rows.shape[1] > 1 else []), "time"]
        rows = rows if rows.shape[1] > 1 else rows[:, 0]
        dims, rows = (tuple(dims), rows) if over else (tuple(dims[1:]), rows[0])
        found[name] = Variable(name, unit_of_signal(unit, units), dims, rows, name)
    return found


def _expressions(model: Model, names: Iterable[str]) -> dict[str, ca.SX]:
    there = {part.name for part in (*model.x, *model.outputs)}
    return {
        name: ca.vec(ca.densify(model[name] if name in there else model.forces)) for name in names
    }
