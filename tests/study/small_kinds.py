# pyright: reportArgumentType=false, reportCallIssue=false, reportAttributeAccessIssue=false
# pyright: reportRedeclaration=false, reportOptionalMemberAccess=false
# pyright: reportIncompatibleMethodOverride=false
"""Small kinds of studies."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from wormopt.errors import Fault
from wormopt.quantities import Scalar
from wormopt.result import Check, left_out
from wormopt.study import (
    Given,
    Study,
    array,
    arrays,
    attributes,
    check,
    checks,
    entry,
    facts,
    number,
    parts,
    positive,
    scalar,
    scalars,
    signal,
    stage,
    value,
    warnings,
    whole,
)

CALLS: Counter[str] = Counter()
"""How often each member was computed."""

FAIL: dict[str, BaseException] = {}
"""What members raise, by name."""


def called(name: str) -> None:
    CALLS[name] += 1
    if name in FAIL:
        raise FAIL[name]


class Spring(Given):
    """A spring."""

    stiffness: float = positive("stiffness", "force per elongation", default=100.0)
    length: float = number("length", "length without load", least=0, most=10)
    label: str = entry("what it is called", default="")

    def faults_of_keys(self) -> Iterator[Fault]:
        if self.length > self.stiffness:
            yield "length", f"{self.length:g} is above the stiffness; write less"


class Soft(Given, tag_field="law", tag="soft"):
    """A soft ground."""

    depth: float = positive("length", "depth")


class Hard(Given, tag_field="law", tag="hard"):
    """A hard ground."""


class Chain(Given):
    """Links in a row."""

    links: int = whole(1, 5, "links", default=2)
    mass: float | tuple[float, ...] = positive("mass", "mass of a link", per="links", default=1.0)

    @property
    def counts(self) -> dict[str, int]:
        return {"links": self.links}


@dataclass(frozen=True)
class Pulled:
    """What a pull does."""

    time: np.ndarray = signal("time", "time", "time")
    path: np.ndarray = signal("length", "time", "path of the end")
    reach: float = value("length", "largest path", headline=True)
    sag: float | None = value("length", "sag of the ground", when="ground")
    private: int = 0


class Pull(Study, kind="toy-pull"):
    """Pull at a spring."""

    wanted = ("paths",)

    spring: Spring = entry("the spring")
    chain: Chain = entry("its links", default=Chain)
    more: tuple[Spring, ...] = entry("other springs", default=())
    ground: Soft | Hard | None = entry("below it", default=None)
    force: float = number("force", "force at the end", least=-5, below=5)
    mode: Literal["slow", "fast"] = entry("how it is pulled", default="slow")
    file: str = entry("a file", default="")

    def faults_of_keys(self) -> Iterator[Fault]:
        if self.file and not (self.folder / self.file).is_file():
            yield "file", "there is no such file"

    @stage
    def motion(self) -> np.ndarray:
        called("motion")
        return np.linspace(0.0, self.force / self.spring.stiffness, 3)

    @stage
    def finer_motion(self) -> np.ndarray:
        called("finer_motion")
        return self.motion * (1 + 1e-12)

    @parts(Pulled)
    def pulled(self) -> Pulled:
        called("pulled")
        return Pulled(np.arange(3.0), self.motion, float(self.motion[-1]), None)

    @scalar("energy", "energy of the spring")
    def energy(self) -> float:
        called("energy")
        return self.force * self.reach / 2

    @scalar("share", "a number that nobody knows")
    def unknown(self) -> None:
        return None

    @scalar("length", "depth of the ground", when="ground")
    def depth(self) -> float:
        return self.ground.depth

    @scalar("length", "half of it")
    def half_depth(self) -> float:
        return self.depth / 2

    @scalars({"first": ("force", "first force"), "last": ("force", "last force")})
    def forces(self) -> dict[str, Any]:
        called("forces")
        return {"first": 0.0, "last": self.force, "last.doubled": Scalar(2 * self.force, "N")}

    @arrays({"lengths": ("length", ("link",), "lengths of links")})
    def of_links(self) -> dict[str, Any]:
        called("of_links")
        return {"lengths": np.ones(self.chain.links)}

    @array("force", "time", "force over time", name="force")
    def force_over_time(self) -> np.ndarray:
        return self.finer_motion * self.spring.stiffness

    @check(1e-9, "finer steps change {reach} by {value:.1e}, more than {limit}", "length")
    def grid_error(self) -> float:
        called("grid_error")
        return abs(float(self.finer_motion[-1]) - self.reach)

    @check("spring.length", "{value} is longer than {spring.length}; lower {force}", "length")
    def overstretched(self) -> float:
        return self.reach

    @checks
    def own(self) -> Iterator[Check]:
        called("own")
        yield Check("sum of forces", 0.0, 1e-9, "something else pulls")

    @warnings
    def words(self) -> Iterator[str]:
        if self.mode == "fast":
            yield "fast is not slow"
        if self.reach > 0.5:
            yield left_out(self.reach, f"{self.reach:g} is a long way")

    @facts
    def said(self) -> dict[str, Any]:
        return {"law": "Hooke"}

    @attributes
    def drawn(self) -> dict[str, Any]:
        return {"ends": [float(self.motion[0]), float(self.motion[-1])]}


def pull(**changes: Any) -> Pull:
    return Pull(**{"spring": Spring(length=1.0), "force": 2.0, **changes})
