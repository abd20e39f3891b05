"""Compiled code is made once, kept where nobody else can write, and never loaded damaged."""

import hashlib
import os
import subprocess
import sys
from collections.abc import Iterator
from importlib.util import find_spec
from pathlib import Path
from types import SimpleNamespace

import casadi as ca
import pytest

from wormopt.model.model import Model, Signal
from wormopt.simulation.native import build, model_code
from wormopt.simulation.native.build import CompilerError, cache_folder, compiler, library, repeated
from wormopt.simulation.simulate import simulate

COMMAND = compiler()
pytestmark = pytest.mark.compiled

ANSWER = [("answer.c", "int answer(void) { return 42; }\n")]
ASK = (
    "from wormopt.simulation.native.build import library\n"
    f"assert library('answer', {ANSWER!r}).answer() == 42\n"
)
SIMULATE = """
import casadi as ca
from wormopt.model.model import Model, Signal
from wormopt.simulation.simulate import simulate
x, rate = ca.SX.sym("x"), ca.SX.sym("rate")
states, rates = [Signal("x", x, value=1.0)], [Signal("rate", rate, value=1.0)]
model = Model("decay", x=states, ode=-rate * x, p=rates)
for value in (1.0, 2.0):
    motion = simulate(model, 1.0, p={"rate": value}, route="native")
    assert abs(motion.end[0] - 2.718281828459045 ** -value) < 1e-11
"""


class Compiler:
    """A compiler that keeps a log of its calls, and a cache folder of its own."""

    def __init__(self, folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
        self.folder, self.log, self.path = folder, folder / "log", folder / "compiler"
        self.set("")
        monkeypatch.setenv("CC", str(self.path))
        monkeypatch.setenv("XDG_CACHE_HOME", str(folder / "cache"))
        compiler.cache_clear()

    def set(self, before: str) -> None:
        """Have the compiler do something else first."""
        assert COMMAND is not None
        lines = [
            "#!/bin/sh",
            before,
            f'echo call >> "{self.log}"',
            f'exec {" ".join(COMMAND)} "$@"',
        ]
        self.path.write_text("\n".join(lines) + "\n")
        self.path.chmod(0o755)

    @property
    def calls(self) -> int:
        return len(self.log.read_text().splitlines()) if self.log.exists() else 0

    @property
    def entries(self) -> list[Path]:
        return sorted(cache_folder().iterdir())


@pytest.fixture
def logged(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Compiler]:
    yield Compiler(tmp_path, monkeypatch)
    compiler.cache_clear()


def start(code: str) -> subprocess.Popen[str]:
    return subprocess.Popen([sys.executable, "-c", code], stderr=subprocess.PIPE, text=True)


def run(code: str) -> None:
    process = start(code)
    _, errors = process.communicate(timeout=120)
    assert process.returncode == 0, errors


def answer() -> int:
    return library("answer", ANSWER).answer()


# -- the cache -------------------------------------------------------------------------------


@pytest.mark.slow
def test_a_second_process_compiles_nothing(logged: Compiler):
    run(SIMULATE)
    assert logged.calls == 2  # the driver and the model
    run(SIMULATE + SIMULATE.replace("-rate * x", "-rate * ca.sinh(ca.asinh(x))"))
    assert logged.calls == 3  # another model


def test_processes_that_compile_at_once_do_not_disturb_each_other(logged: Compiler):
    come = logged.folder / "come"  # each waits until the other compiles too
    wait = f"for i in $(seq 3000); do [ $(wc -l < {come}) -gt 1 ] && break; sleep 0.02; done"
    logged.set(f"echo >> {come}; {wait}")
    processes = [start(ASK) for _ in range(2)]
    for process in processes:
        _, errors = process.communicate(timeout=120)
        assert process.returncode == 0, errors
    assert logged.calls == 2
    (entry,) = logged.entries
    assert entry.suffix == build.SUFFIX


@pytest.mark.parametrize(
    "damage",
    ["flipped", *(pytest.param(each, marks=pytest.mark.slow) for each in ("shorter", "emptied"))],
)
def test_a_damaged_entry_is_made_anew(logged: Compiler, damage: str):
    run(ASK)
    (entry,) = logged.entries
    content = entry.read_bytes()
    half = len(content) // 2
    flipped = content[:half] + bytes([content[half] ^ 4]) + content[half + 1 :]
    entry.write_bytes({"shorter": content[:half], "flipped": flipped, "emptied": b""}[damage])
    run(ASK)
    assert logged.calls == 2
    run(ASK)
    assert logged.calls == 2


def test_an_entry_depends_on_the_compiler_and_its_options(logged: Compiler):
    answer()
    library("answer", ANSWER, "-O1")
    assert logged.calls == 2
    logged.set(": another one")
    answer()
    assert logged.calls == 3
    assert len(logged.entries) == 3


def test_an_entry_depends_on_every_program_of_the_command(
    logged: Compiler, monkeypatch: pytest.MonkeyPatch
):
    wrapper = logged.folder / "wrapper"
    wrapper.write_text('#!/bin/sh\nexec "$@"\n')
    wrapper.chmod(0o755)
    monkeypatch.setenv("CC", f"{wrapper} {logged.path} -DUNUSED")
    compiler.cache_clear()
    for expected in (1, 1):
        assert answer() == 42
        assert logged.calls == expected
    logged.set(": another one")
    assert answer() == 42
    assert logged.calls == 2


def test_the_folder_is_closed_to_others(logged: Compiler):
    folder = logged.folder / "cache" / "wormopt" / "native"
    folder.mkdir(parents=True)
    folder.chmod(0o777)
    assert cache_folder() == folder
    assert folder.stat().st_mode & 0o777 == 0o700
    answer()
    assert logged.entries[0].stat().st_mode & 0o077 == 0


@pytest.mark.skipif(sys.platform == "win32", reason="files have no owners here")
def test_what_belongs_to_somebody_else_is_not_used(
    logged: Compiler, monkeypatch: pytest.MonkeyPatch
):
    answer()
    folder, me = cache_folder(), os.getuid()
    monkeypatch.setattr(os, "getuid", lambda: me + 1)
    with pytest.raises(CompilerError, match="belongs to another user"):
        answer()
    # an entry of somebody else's in a folder of one's own
    monkeypatch.setattr(build, "cache_folder", lambda: folder)
    assert answer() == 42
    assert logged.calls == 2


def test_an_entry_that_cannot_be_loaded_is_said(logged: Compiler):
    run(ASK)  # elsewhere: what is loaded here must not be written over
    (entry,) = logged.entries
    body = b"this is no library"
    entry.write_bytes(body + hashlib.sha256(body).digest())
    with pytest.raises(CompilerError, match="cannot be loaded"):
        answer()


def test_an_entry_that_another_process_has_loaded_need_not_be_replaced(
    logged: Compiler, monkeypatch: pytest.MonkeyPatch
):
    def refuse(built: Path, path: Path) -> None:
        path.write_bytes(built.read_bytes())  # as the other process made it
        raise PermissionError(13, "The process cannot access the file")

    monkeypatch.setattr(Path, "replace", refuse)
    assert answer() == 42
    assert logged.calls == 1


# -- no compiler, or a bad one ---------------------------------------------------------------


def model() -> Model:
    x = ca.SX.sym("x")
    return Model("growth", x=[Signal("x", x, value=1.0)], ode=x)


def hide_compilers(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("CC", "")
    monkeypatch.setenv("PATH", "/no/such/folder")
    monkeypatch.setattr(build, "find_spec", lambda name: None)
    compiler.cache_clear()


@pytest.mark.usefixtures("logged", "forgotten")
def test_without_a_compiler_the_native_route_says_what_to_install(monkeypatch: pytest.MonkeyPatch):
    hide_compilers(monkeypatch)
    with pytest.raises(CompilerError, match="no C compiler was found; install one"):
        simulate(model(), 1.0, route="native")
    motion = simulate(model(), 1.0)
    assert motion.route == "python"
    assert motion.end[0] == pytest.approx(2.718281828459045, abs=1e-9)


def test_the_named_compiler_is_taken_or_none(logged: Compiler, monkeypatch: pytest.MonkeyPatch):
    assert compiler() == (str(logged.path),)
    monkeypatch.setenv("CC", f"{logged.path} -g")
    compiler.cache_clear()
    assert compiler() == (str(logged.path), "-g")
    monkeypatch.setenv("CC", "/no/such/compiler")
    compiler.cache_clear()
    assert compiler() is None


def test_the_path_of_a_compiler_may_have_spaces(logged: Compiler, monkeypatch: pytest.MonkeyPatch):
    path = logged.path.rename(logged.folder / "a compiler")
    monkeypatch.setenv("CC", str(path))
    compiler.cache_clear()
    assert compiler() == (str(path),)


@pytest.mark.usefixtures("logged")
def test_on_windows_no_compiler_but_that_of_ziglang_is_taken_unasked(
    monkeypatch: pytest.MonkeyPatch,
):
    monkeypatch.setattr(build, "sys", SimpleNamespace(platform="win32", executable="python"))
    monkeypatch.setenv("CC", "")
    for there, command in ((True, ("python", "-m", "ziglang", "cc")), (False, None)):
        monkeypatch.setattr(build, "find_spec", lambda name, there=there: there)
        compiler.cache_clear()
        assert compiler() == command


@pytest.mark.usefixtures("logged")
def test_the_compiler_of_ziglang_is_the_last_choice(monkeypatch: pytest.MonkeyPatch):
    hide_compilers(monkeypatch)
    monkeypatch.setattr(build, "find_spec", lambda name: name == "ziglang")
    assert compiler() == (sys.executable, "-m", "ziglang", "cc")


@pytest.mark.slow
@pytest.mark.skipif(find_spec("ziglang") is None, reason="ziglang is not installed")
@pytest.mark.usefixtures("logged")
def test_ziglang_compiles_the_driver(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setenv("CC", f"{sys.executable} -m ziglang cc")
    run(SIMULATE)
    assert simulate(model(), 1.0).route == "native"


@pytest.mark.slow
@pytest.mark.skipif(find_spec("ziglang") is None, reason="ziglang is not installed")
def test_libraries_for_windows_export_functions_beside_those_of_casadi(tmp_path: Path):
    x, y = ca.SX.sym("x"), ca.MX.sym("y", 2)
    functions = [ca.Function("rhs", [x], [ca.sin(x)]), ca.Function("length", [y], [ca.sumsqr(y)])]
    text, _ = model_code.source(functions)
    for file, content in [*build.parts(*model_code.HEADERS), ("model.c", text)]:
        (tmp_path / file).write_text(content)
    zig = [sys.executable, "-m", "ziglang", "cc", "-target", "x86_64-windows-gnu"]
    call = [*zig, "-std=c11", "-shared", build.ALL_EXPORTED, "model.c", "-o", "model.dll"]
    subprocess.run(call, cwd=tmp_path, check=True, capture_output=True)
    content = (tmp_path / "model.dll").read_bytes()
    assert b"\0rhs\0" in content
    assert b"\0length\0" in content


def test_a_library_that_casadi_cannot_load_is_as_none(monkeypatch: pytest.MonkeyPatch):
    def refuse(*_: str) -> None:
        raise RuntimeError("no such file")  # it was given a path with letters of another code page

    x = ca.SX.sym("x")
    monkeypatch.setattr(ca, "external", refuse)
    assert repeated(ca.Function("step", [x], [2 * x]), 3)(1.0) == 8.0


def test_what_the_compiler_complains_of_is_passed_on(logged: Compiler):
    with pytest.raises(CompilerError, match="undeclared"):
        library("bad", [("bad.c", "int answer(void) { return unknown; }\n")])
    logged.set("echo licence expired >&2; exit 1")
    with pytest.raises(CompilerError, match="licence expired"):
        answer()
    assert logged.entries == []


@pytest.mark.usefixtures("logged", "forgotten")
def test_a_folder_that_cannot_be_made_is_no_reason_to_stop(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    (tmp_path / "file").write_text("")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "file"))
    with pytest.raises(CompilerError, match="cannot be used"):
        answer()
    assert simulate(model(), 1.0).route == "python"
