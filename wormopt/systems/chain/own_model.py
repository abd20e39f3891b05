"""Load a user's model: a function in a Python file beside the scene that returns a Model."""

from __future__ import annotations

import contextlib
import inspect
import re
import sys
import traceback
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from difflib import get_close_matches
from pathlib import Path
from types import ModuleType
from typing import Any

from wormopt.errors import ArgumentError, SceneError
from wormopt.model.model import Model
from wormopt.model.values import signal_values

_NAME = re.compile(r"[A-Za-z][A-Za-z0-9_]*")
# Names that the Result itself uses.
_TAKEN = {
    "time",
    *(f"event_{what}" for what in ("time", "kind", "contact", "mode")),
    *(f"rest_{what}" for what in ("start", "end", "contact")),
    *("event", "rest", "n_events", "n_steps", "recheck_error"),
}


@dataclass(frozen=True)
class OwnModel:
    """A function that makes a model, as a scene names it."""

    scene: str  # name of the scene, for messages
    folder: Path
    file: str
    function: str
    parameters: Mapping[str, Any]


def load_model(own: OwnModel) -> Model:
    """Run the user's file and its function, as the scene's key ``model`` says.

    Raises SceneError if the file or function is missing or fails, or if its return value is not a
    Model that can be simulated and saved.
    """
    path = own.folder / own.file
    try:
        code = compile(path.read_bytes(), str(path), "exec")
    except (OSError, ValueError, SyntaxError) as error:
        raise _refused(own, f"{own.file} cannot be read: {error}") from None
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


def _refused(own: OwnModel, message: str, key: str = "model") -> SceneError:
    return SceneError(own.scene, [(key, message)])


def _shown(value: object) -> str:
    return "nothing" if value is None else type(value).__name__


def _attempt(
    own: OwnModel,
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
        return "model"
    named = [name for name in given if re.search(rf"\b{re.escape(name)}\b", reason)] or list(given)
    return f"parameters.{named[0]}" if len(named) == 1 else "parameters"


def _function(own: OwnModel, module: ModuleType) -> Callable[..., Any]:
    file, name = own.file, own.function
    found = getattr(module, name, None)
    if callable(found):
        return found
    functions = [key for key, value in vars(module).items() if inspect.isfunction(value)]
    close = get_close_matches(name, functions, n=1) or functions[:1]
    hint = f'write model = "{file}:{close[0]}"' if close else f"define it: def {name}(): ..."
    raise _refused(own, f"{file} has no function {name}; {hint}")


def _check_parameters(own: OwnModel, function: Callable[..., Any]) -> None:
    given: Mapping[str, Any] = own.parameters
    name = own.function
    try:
        signature = inspect.signature(function)
    except ValueError:  # A function without a signature in Python reports its parameters by itself.
        return
    taken = signature.parameters.values()
    known = [p.name for p in taken if p.kind in (p.POSITIONAL_OR_KEYWORD, p.KEYWORD_ONLY)]
    anything = any(p.kind is p.VAR_KEYWORD for p in taken)
    faults = [
        (f"parameters.{key}", f"{name}() has no such parameter; {_hint(key, known)}")
        for key in given
        if key not in known and not anything
    ]
    faults += [
        (f"parameters.{p.name}", f"missing; {name}() needs it, and it has no default")
        for p in taken
        if p.name in known and p.default is p.empty and p.name not in given
    ]
    if faults:
        raise SceneError(own.scene, faults)


def _hint(key: str, known: list[str]) -> str:
    close = get_close_matches(key, known, n=1)
    if close:
        return f"did you mean {close[0]}?"
    return f"its parameters are {', '.join(known)}" if known else "it has no parameters"


def _check_model(own: OwnModel, model: Model) -> None:
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
