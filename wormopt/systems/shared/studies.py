"""Studies of several systems: values in SI units, windings, keys that the engine refuses."""

from __future__ import annotations

from collections.abc import Generator, Iterator
from contextlib import contextmanager
from typing import ClassVar

from wormopt.errors import ArgumentError, Fault, SceneError
from wormopt.study import Study


class SIStudy(Study):
    """A study whose values are in SI units."""

    why_si: ClassVar[str] = (
        'the permeability of vacuum has units; write units = "SI", with A/m, Pa and m'
    )

    def faults_of_keys(self) -> Iterator[Fault]:
        if self.units != "SI":
            yield "units", self.why_si


def wrong_winding(inner: float, outer: float) -> Iterator[Fault]:
    """Yield a fault if a winding has no thickness."""
    if inner >= outer:
        yield "inner_radius", f"{inner:g} is not below outer_radius = {outer:g}; write less"


@contextmanager
def refused_at(study: Study, key: str) -> Generator[None]:
    """Refuse a key of a study if an engine object cannot be made of it."""
    try:
        yield
    except ArgumentError as error:
        raise SceneError(study.name, [(key, str(error))]) from None
