"""What is changed in the code by `.ci/mutants`.

Python: operators of cosmic-ray, and here statements left out, functions swapped for their
opposites, numbers doubled. C: the like by patterns, line by line.
"""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

# Operators of cosmic-ray that are tried. Others only make what cannot run, such as shifts of
# floats.
_OPERATORS = """
    Add_Sub Sub_Add Mul_Div Div_Mul Pow_Mul FloorDiv_Div Mod_FloorDiv BitAnd_BitOr BitOr_BitAnd
    Lt_LtE Lt_Gt LtE_Lt LtE_GtE Gt_GtE Gt_Lt GtE_Gt GtE_LtE Eq_NotEq NotEq_Eq
    Is_IsNot IsNot_Is In_NotIn NotIn_In Delete_USub Delete_Not AddNot ReplaceTrueWithFalse
    ReplaceFalseWithTrue ReplaceAndWithOr ReplaceOrWithAnd ReplaceBreakWithContinue
    ReplaceContinueWithBreak NumberReplacer ZeroIterationForLoop
""".split()
_OPPOSITES = """
    max min maximum minimum argmax argmin any all sin cos floor ceil fmin fmax inf nan
    first last low high least most before after start stop lower upper
""".split()
_SWAPS = dict(zip(_OPPOSITES[::2], _OPPOSITES[1::2], strict=True))
_SWAPS |= {there: here for here, there in _SWAPS.items()}


class Mutant(NamedTuple):
    """A changed file."""

    path: str
    line: int
    old: str  # the line
    new: str  # what it becomes
    text: str  # of the whole file

    @property
    def change(self) -> tuple[str, str, str]:
        """By which `.ci/mutants.tsv` knows it."""
        return self.path.rpartition("/")[2], self.old, self.new

    @property
    def told(self) -> str:
        """The change as a run prints it, wherever its line has gone since."""
        return f"\n      - {self.old}\n      + {self.new}\n"

    def __str__(self) -> str:
        return f"    {self.path}:{self.line}{self.told}".rstrip("\n")


def mutants_of(root: Path, path: str) -> list[Mutant]:
    """All mutants of a file, each a change of one line, in order."""
    text = (root / path).read_text()
    texts = _of_c(text) if path.endswith(".c") else _of_python(text)
    mutants = {(m.line, m.new): m for new in texts for m in _lines_of(path, text, new)}
    return sorted(mutants.values(), key=lambda mutant: mutant[:4])


def _lines_of(path: str, before: str, after: str) -> Iterator[Mutant]:
    pairs = zip(before.split("\n"), after.split("\n"), strict=True)
    changed = [(k, old, new) for k, (old, new) in enumerate(pairs, 1) if old != new]
    if changed:
        k, old, _ = changed[0]
        new = " ".join(new.strip() for _, _, new in changed)
        yield Mutant(path, k, old.strip(), new, after)


def _of_python(text: str) -> Iterator[str]:
    from cosmic_ray.mutating import mutate_code
    from cosmic_ray.plugins import get_operator, operator_names

    same = _meaning(text)
    for name in operator_names():
        if not name.endswith(tuple(_OPERATORS)):
            continue
        operator, occurrence = get_operator(name)(), 0
        while (new := mutate_code(text, operator, occurrence)) is not None:
            occurrence += 1
            if new.count("\n") == text.count("\n") and _meaning(new) not in (same, None):
                yield new
    for new in (*_left_out(text), *_by_names(text)):
        if _meaning(new) not in (same, None):
            yield new


def _meaning(text: str) -> str | None:
    """What is run of a program, without annotations; None if it is none."""
    try:
        tree = ast.parse(text)
    except SyntaxError:
        return None
    for node in ast.walk(tree):
        for field in ("annotation", "returns"):
            if getattr(node, field, None) is not None:
                setattr(node, field, ast.Constant(0))
    return ast.dump(tree)


def _spans(node: ast.AST, lines: list[str]) -> tuple[int, int]:
    """First and last character of a node in the text."""
    ends = []
    for row, byte in ((node.lineno, node.col_offset), (node.end_lineno, node.end_col_offset)):
        column = len(lines[row - 1].encode()[:byte].decode())
        ends.append(sum(len(line) + 1 for line in lines[: row - 1]) + column)
    return ends[0], ends[1]


def _left_out(text: str) -> Iterator[str]:
    """Leave out a call, an assignment to a part or in place, a raise, a return of nothing."""
    lines = text.split("\n")
    for node in ast.walk(ast.parse(text)):
        call = isinstance(node, ast.Expr) and isinstance(node.value, ast.Call)
        part = isinstance(node, ast.Assign) and not isinstance(node.targets[0], ast.Name)
        ends = isinstance(node, ast.Return) and node.value is None
        if call or part or ends or isinstance(node, ast.AugAssign | ast.Raise):
            a, b = _spans(node, lines)
            yield text[:a] + "pass" + "\n" * text[a:b].count("\n") + text[b:]


def _by_names(text: str) -> Iterator[str]:
    """Swap a function for its opposite, double a number that is no whole one."""
    lines = text.split("\n")
    for node in ast.walk(ast.parse(text)):
        a, b = _spans(node, lines) if hasattr(node, "lineno") else (0, 0)
        if isinstance(node, ast.Name | ast.Attribute) and isinstance(node.ctx, ast.Load):
            name = node.id if isinstance(node, ast.Name) else node.attr
            if name in _SWAPS:
                yield text[: b - len(name)] + _SWAPS[name] + text[b:]
        elif isinstance(node, ast.Constant) and isinstance(node.value, float) and node.value:
            yield text[:a] + repr(2 * node.value) + text[b:]


# Of C: pattern and what takes its place, by turns. Heads of loops are left alone, as one turn more
# reads what is not there.
_CHANGES = {
    r" < ": (" <= ", " > "),
    r" <= ": (" < ", " >= "),
    r" > ": (" >= ", " < "),
    r" >= ": (" > ", " <= "),
    r" == ": (" != ",),
    r" != ": (" == ",),
    r" && ": (" || ",),
    r" \|\| ": (" && ",),
    r" \+ ": (" - ",),
    r" - ": (" + ",),
    r" \* ": (" / ",),
    r" / ": (" * ",),
    r" \|= ": (" = ",),
    r"(?<=[=(,?:] )-(?=[\w(])|(?<=\()-(?=[\w(])|(?<=return )-(?=[\w(])": ("",),
    r"!(?=[\w(])": ("",),
    r"\bfmin\b": ("fmax",),
    r"\bfmax\b": ("fmin",),
    r"\bfabs\b": ("",),
    r"(?<![\w.])0\.0(?!\d)": ("1.0",),
    r"(?<![\w.])(?!0\.0\b)(?:\d+\.\d*(?:e[+-]?\d+)?|\d+e[+-]?\d+)": ("(2.0 * {})", "(0.0 * {})"),
    r"(?<=[=(,?:] )1(?=[;),])": ("0",),
    r"(?<=[=(,?:] )0(?=[;),])": ("1",),
    r"\bcontinue;": (";",),
    r"\bbreak;": (";",),
}
_LEFT_OUT = re.compile(
    r"^( *(?:if \(.*\) |else )?)([\w>\[\]. +*-]+ [|+*-]?= [^{}]*;|\w+\([^{}]*\);)$"
)
_DECLARED = re.compile(r"^ *(?:const |static |double |int |long |Kind |return )")


def _of_c(text: str) -> Iterator[str]:
    blank = re.sub(r"/\*.*?\*/", lambda m: re.sub(r"[^\n]", "\0", m[0]), text, flags=re.S)
    lines, bare = text.split("\n"), blank.split("\n")

    def with_line(k: int, new: str) -> str:
        return "\n".join([*lines[:k], new, *lines[k + 1 :]])

    for k, line in enumerate(bare):
        if line.startswith(("#", "static const double SAMPLES")):
            continue
        head = re.match(r" *for \(.*?;.*?;.*?\)", line)
        for pattern, places in _CHANGES.items():
            for found in re.finditer(pattern, line):
                if head and found.start() < head.end():
                    continue
                for place in places:
                    new = place.format(found[0])
                    yield with_line(k, lines[k][: found.start()] + new + lines[k][found.end() :])
        statement = _LEFT_OUT.match(line)
        if statement and not _DECLARED.match(line) and not head:
            yield with_line(k, statement[1] + ";")
