"""Tables and studies of a body in a channel."""

from __future__ import annotations

from collections.abc import Iterator
from typing import ClassVar, Literal

from wormopt.errors import Fault
from wormopt.study import Given, entry, on_use, positive
from wormopt.systems.channel.samples import SAMPLES, Sample
from wormopt.systems.shared.si import SIStudy

with on_use():
    from wormopt.systems.channel.closed_forms import ChannelWorm

STEEPEST, FLATTEST = 10.0, 1e-3
"""Limits of the rise over the coil distance; below the least, l_s - L is lost in round-off."""
_SIZES = ("pitch", "channel", "body", "length")


class ChannelBody(Given):
    """A body, its channel and the coils beside it.

    Keys that are left out have the values of `sample`; without a sample all sizes are required.
    """

    sample: Literal["sample-1", "sample-2", "capsule"] | None = entry(
        "a body of K. Zimmermann et al. 2007 (WLLS); gives the keys that are left out", default=None
    )
    pitch: float | None = positive("length", "distance of neighbouring coils", default=None)
    channel: float | None = positive("length", "diameter of the channel", default=None)
    body: float | None = positive(
        "length",
        "diameter of the body; the channel's less a thousandth to ten times the pitch",
        default=None,
    )
    length: float | None = positive(
        "length", "length of the body, at least the pitch", default=None
    )
    youngs_modulus: float | None = positive(
        "stress",
        "Young's modulus of a solid round body, *assumed*; the capsule has none; without "
        "it forces and energies are unknown; not used by `channel-worm`",
        default=None,
    )
    count: Literal["nearest", "floor"] = entry(
        "number of segments: the integer nearest to length over segment, or its integral part "
        "as in eq. 32 of Zimmermann et al. is "
        "printed",
        default="nearest",
    )

    @property
    def of_chapter(self) -> Sample | None:
        """Return the named body if at most its modulus is changed."""
        changed = any(getattr(self, name) is not None for name in _SIZES)
        return None if self.sample is None or changed else SAMPLES[self.sample]

    def size(self, name: str) -> float | None:
        """Return a size or the modulus by its key, from the named body if the scene has none."""
        given = getattr(self, name)
        return getattr(SAMPLES[self.sample], name) if given is None and self.sample else given

    def faults_of_keys(self) -> Iterator[Fault]:
        """Yield missing sizes, and sizes that do not fit each other."""
        sizes = [self.size(name) for name in _SIZES]
        missing = [name for name, size in zip(_SIZES, sizes, strict=True) if size is None]
        for name in missing:
            yield name, 'missing; write it in m, or name a body: sample = "sample-1"'
        if missing:
            return
        pitch, channel, body, length = (float(size or 0.0) for size in sizes)
        if body >= channel:
            yield (
                "body",
                f"a body with a diameter of {body:g} m does not fit in a channel of {channel:g} m; "
                f"write less than {channel:g}, or a wider worm.channel",
            )
        elif channel - body >= STEEPEST * pitch:
            yield (
                "pitch",
                f"the body would rise by {channel - body:g} m within {pitch:g} m; write more than "
                f"{(channel - body) / STEEPEST:g}",
            )
        elif channel - body < FLATTEST * pitch:
            yield (
                "body",
                f"a body with a diameter of {body:g} m fills the channel, and its rise is lost in "
                f"round-off; write less than {channel - FLATTEST * pitch:g}",
            )
        if length < pitch:
            yield (
                "length",
                f"{length:g} m is less than the coil distance; write at least {pitch:g}",
            )

    def worm(self) -> ChannelWorm:
        """Return the body with its sizes."""
        names = ("pitch", "channel", "body", "length", "youngs_modulus")
        return ChannelWorm(*(self.size(name) for name in names), rule=self.count)


class BodyStudy(SIStudy):
    """A body in a channel."""

    why_si: ClassVar = 'the bodies of the scene are in m and Pa; write units = "SI"'

    worm: ChannelBody = entry("the body")
