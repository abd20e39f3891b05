"""Scenes of kind "track": a chain whose links follow a gait by an adaptive controller."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, Literal

from msgspec import Meta, field

from wormopt.errors import Fault
from wormopt.scene.numerics import ContactTable, ExactContact, Start, TimeSpan, ToleranceTable
from wormopt.scene.types import (
    Finite,
    FinitePerLink,
    NonNegative,
    NonNegativePerLink,
    Positive,
    SceneTable,
    Table,
    extreme_numbers,
    wrong_count,
)
from wormopt.systems.chain.scenes.chain import ChainTable
from wormopt.systems.spiked.scenes.shapes import Shape


class Reference(Table, frozen=True, kw_only=True):
    """What the links shall do.

    Parameters
    ----------
    gait : FastShape, BlockWaveShape, AccordionShape, SineShape or FileShape
        A gait.
    shift : float
        The reference at time t is the gait at t + shift.
    """

    gait: Shape
    shift: Finite = 0.0


class ExponentLaw(Table, frozen=True, kw_only=True, tag_field="law", tag="exponent"):
    """The gain grows by gamma [|e| - lambda]+ |e|^(r - 1).

    Parameters
    ----------
    exponent : float
        r, at least 1.
    """

    exponent: Annotated[float, Meta(ge=1, le=100, description="a number from 1 to 100")]


class DecayLaw(Table, frozen=True, kw_only=True, tag_field="law", tag="decay"):
    """Growth with two exponents; the gain decays once the error has stayed in the tube.

    Parameters
    ----------
    dwell : float
        Time in the tube before the gain decays.
    decay : float
        Rate sigma of decay, k' = -sigma k.
    """

    dwell: Positive
    decay: NonNegative


class QuadraticLaw(Table, frozen=True, kw_only=True, tag_field="law", tag="quadratic"):
    """The chapter's law: the gain grows by gamma ([|e| - lambda]+)^2."""


class FeedForwardTable(Table, frozen=True, kw_only=True):
    """Force that would hold links of these numbers on the reference, added to the tracker's.

    Parameters
    ----------
    stiffness, damping, rest_length : float or tuple of float, optional
        What the controller believes of the links; the worm's own if left out.
    """

    stiffness: NonNegativePerLink | None = None
    damping: NonNegativePerLink | None = None
    rest_length: NonNegativePerLink | None = None


class LambdaTracker(Table, frozen=True, kw_only=True, tag_field="feedback"):
    """What both lambda-trackers share.

    Parameters
    ----------
    name : str
        What pictures call it.
    tube_radius : float
        Radius lambda of the tube.
    gain_start : float
        Gain k at the start.
    growth : float
        Factor gamma of the gain's growth.
    adaptation : QuadraticLaw, ExponentLaw or DecayLaw
        How the gain grows.
    feedforward : FeedForwardTable, optional
        Force added.
    """

    name: str = ""
    tube_radius: Positive
    gain_start: Positive = 1.0
    growth: Positive = 1.0
    adaptation: QuadraticLaw | ExponentLaw | DecayLaw = field(default_factory=QuadraticLaw)
    feedforward: FeedForwardTable | None = None

    def faults(self, key: str, links: int) -> Iterator[Fault]:
        """Yield what does not fit a worm of so many links; `key` is the path of this table."""
        yield from _faults_of_feedforward(key, self.feedforward, links)


class DerivativeTracker(LambdaTracker, frozen=True, kw_only=True, tag="derivative"):
    """Tracker (13), which knows the rates of the links.

    Parameters
    ----------
    name, tube_radius, gain_start, growth, adaptation, feedforward : object
        As for `LambdaTracker`.
    """


class FilterTracker(LambdaTracker, frozen=True, kw_only=True, tag="filter"):
    """Tracker (14), which estimates the rates of the links by a filter.

    Parameters
    ----------
    name, tube_radius, gain_start, growth, adaptation, feedforward : object
        As for `LambdaTracker`.
    filter_start : float or tuple of float
        The filter's theta at the start, alike for all or one per link.
    """

    filter_start: FinitePerLink = 1.0

    def faults(self, key: str, links: int) -> Iterator[Fault]:
        """Yield what does not fit a worm of so many links; `key` is the path of this table."""
        yield from super().faults(key, links)
        yield from wrong_count(f"{key}.filter_start", self.filter_start, links, "links")


class FunnelTable(Table, frozen=True, kw_only=True):
    """Bound end + (start - end) exp(-t/time) on a norm.

    Parameters
    ----------
    start, end : float
        Width at time 0 and after long time.
    time : float
        Time in which it narrows.
    """

    start: Positive
    end: Positive
    time: Positive


class FunnelTracker(Table, frozen=True, kw_only=True, tag_field="feedback", tag="funnel"):
    """Funnel controller: the error and its rate stay within bounds that shrink in time.

    Parameters
    ----------
    name : str
        What pictures call it.
    funnel, rate_funnel : FunnelTable
        Bounds on the error and on e' + k_0 e.
    gain : float
        Force per speed in the middle of the funnels.
    tube_radius : float, optional
        Radius of the tube that it is judged by; the end of the funnel if left out.
    feedforward : FeedForwardTable, optional
        Force added.
    """

    name: str = ""
    funnel: FunnelTable
    rate_funnel: FunnelTable
    gain: Positive = 1.0
    tube_radius: Positive | None = None
    feedforward: FeedForwardTable | None = None

    def faults(self, key: str, links: int) -> Iterator[Fault]:
        """Yield what does not fit a worm of so many links; `key` is the path of this table."""
        yield from _faults_of_feedforward(key, self.feedforward, links)


Tracker = FilterTracker | DerivativeTracker | FunnelTracker


class EnsembleTable(Table, frozen=True, kw_only=True):
    """Many worms, each with random links of its own.

    Parameters
    ----------
    members : int
        How many. The first is the worm that the scene has without this table.
    """

    members: Annotated[int, Meta(ge=2, le=100_000, description="a whole number from 2 to 100000")]


class TrackScene(SceneTable, frozen=True, kw_only=True):
    """A chain whose links follow a gait, by one tracker or by several side by side.

    Parameters
    ----------
    schema : int
        Version of the scene form, 1.
    kind : {"track"}
        The kind.
    title : str
        Title of pictures and reports.
    units : {"dimensionless", "SI"}
        Whether numbers are in SI units.
    want : tuple of str
        Pictures to draw.
    worm : ChainTable
        The worm.
    start : Start
        Where it starts.
    reference : Reference
        What its links shall do.
    tracker : table or tuple of tables
        The controllers; each has the worm for itself.
    contact : SmoothContact or ExactContact
        How contact is treated.
    time : TimeSpan
        How long.
    tolerance : ToleranceTable
        How exact.
    ensemble : EnsembleTable, optional
        Many worms at a time.
    """

    kind: Literal["track"]
    want: tuple[Literal["trackers", "motion", "bands"], ...] = ()
    worm: ChainTable
    start: Start = field(default_factory=Start)
    reference: Reference
    tracker: Tracker | tuple[Tracker, ...]
    contact: ContactTable = field(default_factory=ExactContact)
    time: TimeSpan
    tolerance: ToleranceTable = field(default_factory=ToleranceTable)
    ensemble: EnsembleTable | None = None

    @property
    def trackers(self) -> tuple[Tracker, ...]:
        """The controllers as a list, also where there is one."""
        return self.tracker if isinstance(self.tracker, tuple) else (self.tracker,)

    def tracker_key(self, index: int) -> str:
        """Key path of a tracker."""
        return f"tracker[{index}]" if isinstance(self.tracker, tuple) else "tracker"

    def faults(self, folder: Path) -> Iterator[Fault]:
        """Check what no single key shows; `folder` is the scene's."""
        yield from super().faults(folder)
        yield from extreme_numbers(self)
        links = self.worm.links
        yield from self.worm.faults(self.time.end)
        yield from self.start.faults(links)
        yield from self.reference.gait.faults(links, folder, "reference.gait")
        if not self.trackers:
            yield "tracker", "there is none; write at least one [[tracker]]"
        for index, tracker in enumerate(self.trackers):
            yield from tracker.faults(self.tracker_key(index), links)
        yield from self._faults_of_ensemble()

    def _faults_of_ensemble(self) -> Iterator[Fault]:
        if self.ensemble is None:
            if "bands" in self.want:
                yield "want", '"bands" shows an ensemble; write [ensemble] members = 200'
            return
        if self.worm.random is None:
            yield "ensemble", "all members would be alike; write [worm.random]"
        for word in ("trackers", "motion"):
            if word in self.want:
                yield (
                    "want",
                    f'"{word}" shows a single worm; write "bands", or leave out [ensemble]',
                )


def _faults_of_feedforward(
    key: str, feedforward: FeedForwardTable | None, links: int
) -> Iterator[Fault]:
    if feedforward is not None:
        for name in feedforward.__struct_fields__:
            value = getattr(feedforward, name)
            yield from wrong_count(f"{key}.feedforward.{name}", value, links, "links")
