"""Compiles C sources to shared libraries, once, and keeps them in the user's cache folder.

An entry is named by the hash of everything it depends on and ends with the hash of its own bytes,
so that a damaged one is detected before it is loaded. It is written under another name and
renamed, so that others see it whole or not at all.
"""

from __future__ import annotations

import ctypes
import hashlib
import os
import platform
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from functools import cache
from importlib.resources import files
from importlib.util import find_spec
from pathlib import Path

import casadi as ca
from platformdirs import user_cache_path

SUFFIX = {"win32": ".dll", "darwin": ".dylib"}.get(sys.platform, ".so")
"""File suffix of shared libraries on this system."""
SHARED = ("-std=c11", "-shared", *(() if sys.platform == "win32" else ("-fPIC",)))
"""Flags that make a shared library."""
ALL_EXPORTED = "-DCASADI_SYMBOL_EXPORT="
"""Flag for Windows: CasADi's code would export its own functions only."""
_DIGEST = 32
# ARM compilers accept one of these flags, others the other
_OWN_MACHINE = "-mcpu" if platform.machine().lower() in ("arm64", "aarch64") else "-march"
_FLAGS = (
    *SHARED,
    f"{_OWN_MACHINE}=native",
    "-fno-math-errno",
    *((ALL_EXPORTED,) if sys.platform == "win32" else ()),
)


class CompilerError(Exception):
    """There is no C compiler, or compilation fails."""


@cache
def compiler() -> tuple[str, ...] | None:
    """Command of the C compiler: ``$CC``, the system's, or that of the package ziglang."""
    # On Windows the system's compiler is not used: GCC misaligns vectors there (GCC bug 54412).
    named = os.environ.get("CC", "").strip()
    if named:
        words = [named] if shutil.which(named) else named.split()  # C:\Program Files\... is one
        return tuple(words) if shutil.which(words[0]) else None
    for name in () if sys.platform == "win32" else ("cc", "gcc", "clang"):
        if shutil.which(name):
            return (name,)
    return (sys.executable, "-m", "ziglang", "cc") if find_spec("ziglang") else None


def cache_folder() -> Path:
    """Folder of compiled code, accessible to this user only."""
    folder = user_cache_path("wormopt") / "native"
    try:
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)
        if sys.platform != "win32":
            if folder.stat().st_uid != os.getuid():
                raise CompilerError(f"{folder} belongs to another user")
            folder.chmod(0o700)
    except OSError as error:
        raise CompilerError(f"{folder} cannot be used: {error.strerror}") from error
    return folder


def parts(*names: str) -> list[tuple[str, str]]:
    """C sources of this folder: file names and texts."""
    folder = files("wormopt.simulation.native")
    return [(name, (folder / name).read_text(encoding="utf-8")) for name in names]


def library(name: str, sources: Sequence[tuple[str, str]], optimise: str = "-O2") -> ctypes.CDLL:
    """Load the shared library of some C sources, from the cache if possible.

    `sources` are (file name, text), headers included; `name` begins the library's file name.
    """
    command = compiler()
    if command is None:
        raise CompilerError("no C compiler was found; install one, or the extra wormopt[compiler]")
    flags = (optimise, *_FLAGS)
    path = cache_folder() / f"{name}-{_key(sources, flags, command)}{SUFFIX}"
    if not _whole(path):
        _compile(path, sources, flags, command)
    try:
        return ctypes.CDLL(str(path))
    except OSError as error:  # such as a folder without execute permission
        raise CompilerError(f"{path} cannot be loaded: {error}") from error


def error_output(done: subprocess.CompletedProcess[bytes]) -> str:
    """Error output of a compiler run."""
    return done.stderr.decode(errors="replace").strip()


@cache
def _machine() -> str:
    """Description of the processor, on which -march=native depends."""
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8", errors="replace").splitlines()
    except OSError:
        lines = []
    flags = [line for line in lines if line.startswith(("flags", "model name", "Features"))]
    return "\n".join([platform.platform(), platform.processor(), *sorted(set(flags))])


def _key(sources: Sequence[tuple[str, str]], flags: Sequence[str], command: Sequence[str]) -> str:
    parts = [*flags, *command, _machine()]
    for word in command:  # "ccache gcc" is two programs
        found = shutil.which(word)
        if found:
            made = Path(found).stat()
            parts += [found, str(made.st_size), str(made.st_mtime_ns)]
    parts += [text for source in sources for text in source]
    return hashlib.sha256("\0".join(parts).encode()).hexdigest()[:32]


def _whole(path: Path) -> bool:
    """Whether an entry exists, is the user's own, and is undamaged."""
    try:
        content = path.read_bytes()
        mine = sys.platform == "win32" or path.stat().st_uid == os.getuid()
    except OSError:
        return False
    body, digest = content[:-_DIGEST], content[-_DIGEST:]
    return mine and len(body) > 0 and hashlib.sha256(body).digest() == digest


def _compile(
    path: Path, sources: Sequence[tuple[str, str]], flags: Sequence[str], command: Sequence[str]
) -> None:
    try:
        with tempfile.TemporaryDirectory(dir=path.parent, prefix="building-") as folder:
            for file, text in sources:
                (Path(folder) / file).write_text(text, encoding="utf-8", newline="\n")
            units = [file for file, _ in sources if file.endswith(".c")]
            built = Path(folder) / f"built{SUFFIX}"
            call = [*command, *flags, *units, "-o", built.name, "-lm"]
            # the command is the user's own compiler
            done = subprocess.run(call, cwd=folder, capture_output=True, check=False)  # noqa: S603
            if done.returncode:
                raise CompilerError(f"{' '.join(command)} failed:\n{error_output(done)}")
            body = built.read_bytes()
            built.write_bytes(body + hashlib.sha256(body).digest())
            built.chmod(0o700)
            try:
                built.replace(path)
            except PermissionError:  # Windows: another process has loaded it
                if not _whole(path):
                    raise
    except OSError as error:
        raise CompilerError(f"cannot compile in {path.parent}: {error}") from error


# Measured on the steps of a rod: -O2 compiles longer and runs no faster.
_LEVEL = "-O1"


def function_library(function: ca.Function) -> ctypes.CDLL:
    """Compile a function with everything it calls; CasADi must be able to write it as C."""
    generator = ca.CodeGenerator("function.c")
    generator.add(function)
    return library("function", [("function.c", generator.dump())], _LEVEL)


def repeated(step: ca.Function, count: int) -> ca.Function:
    """Repeat a function of a state and constants; compiled if there is a compiler."""
    function = folded(step, count)
    try:
        found = function_library(function)
        return ca.external(function.name(), found._name)  # noqa: SLF001  where ctypes keeps the path
    except (CompilerError, RuntimeError):  # on Windows CasADi refuses some characters in the path
        return function


def folded(step: ca.Function, count: int) -> ca.Function:
    """Repeat a function of a state and constants, not compiled."""
    given = [ca.MX.sym(step.name_in(i), step.size1_in(i)) for i in range(step.n_in())]
    held = [ca.repmat(part, 1, count) for part in given[1:]]
    return ca.Function("stride", given, [step.fold(count)(given[0], *held)])
