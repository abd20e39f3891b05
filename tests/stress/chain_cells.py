"""The cells of the stress matrix: worms, what drives them, and how contact is treated."""

from __future__ import annotations

import zlib
from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import product

import numpy as np

from tests.oracles.driven_chain import DrivenChain, Grip
from wormopt.control.lambda_tracker import Feedback, lambda_tracker
from wormopt.control.loop import gait_reference
from wormopt.model.gait import Gait
from wormopt.model.model import Model
from wormopt.simulation.options import Exact, Smooth, Treatment
from wormopt.systems.spiked.construct import accordion, block_wave, fast_gait, travelling_sine


@dataclass(frozen=True)
class Tracker:
    """A lambda-tracker in the place of the command.

    Crossings of its tube, where the growth of the gain has a kink, are events, as in scenes.
    """

    feedback: Feedback  # "derivative": (13); "filter": (14)
    radius: float  # of the tube, lambda
    gain: float  # at the start, k(0)


@dataclass(frozen=True, eq=False)
class Cell:
    """One run of the matrix."""

    name: str
    group: str  # part of the matrix it belongs to
    worm: DrivenChain  # numbers of the worm, and its gait
    span: float  # last time
    v_reg: float | None = None  # width of the smooth law; None: exact contact
    tracker: Tracker | None = None  # follows the gait; None: gait commands rest lengths

    @property
    def core(self) -> bool:
        """Whether it is one of the ordinary cells, all of which must be right."""
        return self.group.startswith("core")

    @property
    def contact(self) -> Treatment:
        """How contact is treated."""
        return Exact() if self.v_reg is None else Smooth(self.v_reg)

    def model(self) -> Model:
        """Build the Model."""
        worm, tracker = self.worm, self.tracker
        if tracker is None:
            return worm.model()
        plant = worm.worm(2.0)
        return lambda_tracker(
            plant,
            gait_reference(worm.gait, plant.t),
            tube_radius=tracker.radius,
            feedback=tracker.feedback,
            gain_start=tracker.gain,
            filter_start=0.0,
            watch=True,
        )


_ONE_TEN, _ONE_TWO, _ALIKE = Grip(1.0, 10.0), Grip(1.0, 2.0), Grip(0.5, 0.5)
_STICTION = Grip(1.0, 3.0, 1.5, 4.0)
_FEEDBACKS: tuple[Feedback, ...] = ("filter", "derivative")


def _cell(
    group: str,
    span: float,
    name: str,
    links: int,
    grip: Grip,
    gait: str | Gait,
    v_reg: float | None = None,
    tracker: Tracker | None = None,
    *,
    stiffness: float | np.ndarray = 40.0,
    mass: float | np.ndarray = 1.0,
    drag: float = 0.0,
    spread: float = 0.1,
) -> Cell:
    """Worm with numbers that are off by up to a tenth, by dice that the name has thrown.

    Nothing is symmetric then; a ``spread`` of 0 leaves them as they are.
    """
    dice = np.random.default_rng(zlib.crc32(name.encode()))
    masses = mass * dice.uniform(1 - spread, 1 + spread, links + 1)
    c = stiffness * dice.uniform(1 - spread, 1 + spread, links)
    # damped to a tenth of what would be critical for the link's own masses
    damping = 0.2 * np.sqrt(c * np.minimum(masses[:-1], masses[1:]))
    gait = _gait(gait, links) if isinstance(gait, str) else gait
    worm = DrivenChain(masses, c, damping, gait, [grip] * (links + 1), drag)
    return Cell(name, group, worm, span, v_reg, tracker)


def _gait(name: str, links: int) -> Gait:
    if name == "sine":
        return travelling_sine(links, 1.0, lag=1 / min(links + 1, 10))
    if name == "block":
        return fast_gait(1.0) if links == 2 else block_wave(links, 1, 1.0, (1.4, 2.6))
    return accordion(links, 1.0, (1.6, 2.4))


def jumping_gait(links: int, seed: int, pieces: int = 12, period: float = 4.0) -> Gait:
    """Random lengths between 1.5 and 2.5 that jump at random times, `pieces` a period."""
    dice = np.random.default_rng((seed, links))
    breaks = np.sort(np.append(dice.uniform(0.0, period, pieces - 1), [0.0, period]))
    return Gait(breaks, dice.uniform(1.5, 2.5, (pieces, links, 1)))


# -- ordinary cells ------------------------------------------------------------------------------


def _core() -> Iterator[Cell]:
    for feedback, v_reg, radius, gain, gait in product(
        _FEEDBACKS, (1e-1, 1 / 40, 1e-2), (1.0, 0.2, 0.05), (1.0, 10.0), ("block", "sine")
    ):
        name = f"{feedback} tracker, {gait}, v_reg {v_reg:g}, lambda {radius:g}, k0 {gain:g}"
        tracker, part = Tracker(feedback, radius, gain), "core: smooth trackers"
        yield _cell(part, 10.0, name, 2, _ONE_TEN, gait, v_reg, tracker, stiffness=10.0)
    grips = {"F 1:10": _ONE_TEN, "F 1:2": _ONE_TWO, "F alike": _ALIKE, "stiction": _STICTION}
    for feedback, radius, gain, gait, label in product(
        _FEEDBACKS, (1.0, 0.2), (1.0, 10.0), ("block", "sine"), ("F 1:10", "F 1:2")
    ):
        name = f"{feedback} tracker, {gait}, exact {label}, lambda {radius:g}, k0 {gain:g}"
        tracker, part = Tracker(feedback, radius, gain), "core: exact trackers"
        yield _cell(part, 5.0, name, 2, grips[label], gait, None, tracker, stiffness=10.0)
    for links, label, gait, c in product((1, 2, 3, 5), grips, ("block", "sine"), (10.0, 40.0)):
        name = f"chain of {links}, {gait}, exact {label}, c {c:g}"
        yield _cell("core: exact chains", 10.0, name, links, grips[label], gait, stiffness=c)
    for links, label, gait, v_reg in product(
        (1, 3), ("F 1:10", "F 1:2"), ("block", "sine"), (1 / 40, 1e-2)
    ):
        name = f"chain of {links}, {gait}, {label}, v_reg {v_reg:g}"
        yield _cell("core: smooth chains", 10.0, name, links, grips[label], gait, v_reg)
    for links, gait, drag in product((1, 2, 3, 5), ("block", "sine"), (0.5, 1.0)):
        name = f"chain of {links} on spikes, {gait}, drag {drag:g}"
        yield _cell("core: spiked chains", 10.0, name, links, Grip.spike(), gait, drag=drag)


# -- beyond the ordinary -------------------------------------------------------------------------


def _steep() -> Iterator[Cell]:
    part, widths, gaits = "steep smoothing", (1e-3, 1e-4, 1e-5, 1e-6, 1e-7), ("block", "sine")
    for v_reg, feedback, radius, gait in product(widths, _FEEDBACKS, (0.2, 0.01), gaits):
        name = f"{feedback} tracker, {gait}, v_reg {v_reg:g}, lambda {radius:g}"
        tracker = Tracker(feedback, radius, 1.0)
        yield _cell(part, 5.0, name, 2, _ONE_TEN, gait, v_reg, tracker, stiffness=10.0)
    for v_reg, links, gait in product(widths, (2, 5), gaits):
        name = f"chain of {links}, {gait}, v_reg {v_reg:g}"
        yield _cell(part, 5.0, name, links, _ONE_TWO, gait, v_reg)


def _high_gains() -> Iterator[Cell]:
    for radius, gain, feedback in product((1e-2, 1e-3, 1e-4), (1.0, 1e2, 1e3, 1e4), _FEEDBACKS):
        for exact in (False, True) if radius != 1e-3 and gain in (1e2, 1e4) else (False,):
            name = f"{'exact ' * exact}{feedback} tracker, lambda {radius:g}, k0 {gain:g}"
            span, v_reg = (0.3, None) if exact else (5.0, 1 / 40)
            tracker, part = Tracker(feedback, radius, gain), "high gains"
            yield _cell(part, span, name, 2, _ONE_TEN, "block", v_reg, tracker, stiffness=10.0)


def _ratios() -> Iterator[Cell]:
    """Stiffness, mass or both spread over up to six decades along the worm."""
    for decades, what, contact in product(
        (1, 2, 3, 4, 6), ("stiffness", "mass", "both"), ("exact", "smooth")
    ):
        name = f"{what} over {decades} decades, {contact}"
        c, m = (10.0 ** (decades * np.linspace(-0.5, 0.5, size)) for size in (4, 5))
        c = 40.0 * c if what != "mass" else 40.0
        m = m[::-1] if what != "stiffness" else 1.0
        v_reg = None if contact == "exact" else 1 / 40
        yield _cell("ratios", 3.0, name, 4, _ONE_TWO, "sine", v_reg, stiffness=c, mass=m)


def _long_worms() -> Iterator[Cell]:
    for links, contact, gait in product(
        (10, 20, 50, 100), ("exact", "smooth", "spikes"), ("block", "sine")
    ):
        name = f"chain of {links}, {gait}, {contact}"
        grip, drag = (Grip.spike(), 1.0) if contact == "spikes" else (_ONE_TWO, 0.0)
        span, v_reg = (3.0, 1 / 40) if contact == "smooth" else (20.0 / links, None)
        yield _cell("long worms", span, name, links, grip, gait, v_reg, drag=drag)
    for links, feedback in product((10, 20, 50), _FEEDBACKS):
        name, tracker = f"{feedback} tracker of {links} links", Tracker(feedback, 0.2, 1.0)
        yield _cell("long worms", 3.0, name, links, _ONE_TWO, "sine", 1 / 40, tracker)


def _long_times() -> Iterator[Cell]:
    part = "long times"
    for periods in (30.0, 100.0, 300.0, 1000.0):
        # the second route takes half a minute for 300 periods
        for feedback in _FEEDBACKS if periods < 300 else ("filter",):
            name, tracker = (
                f"{feedback} tracker for {periods:g} periods",
                Tracker(feedback, 0.5, 1.0),
            )
            yield _cell(part, periods, name, 2, _ONE_TWO, "sine", 1 / 10, tracker, stiffness=10.0)
        for kind in ("exact", "stiction", "spikes", "smooth")[: 4 if periods < 300 else 3]:
            name = f"chain, {kind}, for {periods:g} periods"
            grip = {"stiction": _STICTION, "spikes": Grip.spike()}.get(kind, _ONE_TWO)
            v_reg, drag = 1 / 40 if kind == "smooth" else None, 1.0 if kind == "spikes" else 0.2
            yield _cell(part, periods, name, 2, grip, "block", v_reg, drag=drag)


def _jumps() -> Iterator[Cell]:
    for seed, kind in product(range(8), ("exact", "spikes", "smooth", "tracker", "exact tracker")):
        name, gait = f"jumping reference {seed}, {kind}", jumping_gait(2 + seed % 2, seed)
        grip, drag = (Grip.spike(), 1.0) if kind == "spikes" else (_ONE_TEN, 0.0)
        v_reg = 1 / 40 if kind in ("smooth", "tracker") else None
        feedback = _FEEDBACKS[seed // 2 % 2]
        tracker = Tracker(feedback, 0.2, 1.0) if "tracker" in kind else None
        yield _cell("jumps", 8.0, name, gait.links, grip, gait, v_reg, tracker, drag=drag)


def _frictions() -> Iterator[Cell]:
    part = "frictions"
    grips = {
        "no friction": Grip(0.0, 0.0),
        "F+ = F-": Grip(1.0, 1.0),
        "hardly any friction": Grip(1e-7, 2e-7),
        "huge stiction": Grip(1.0, 2.0, 1e4, 1e4),
        "F- huge": Grip(1.0, 1e5),
        "none forward": Grip(0.0, 1.0),
    }
    for (label, grip), links, contact in product(grips.items(), (1, 3), ("exact", "smooth")):
        name, v_reg = (
            f"{label}, chain of {links}, {contact}",
            None if contact == "exact" else 1 / 40,
        )
        yield _cell(part, 5.0, name, links, grip, "sine", v_reg)
    for stick, gait in product((3.0, 10.0, 30.0, 100.0), ("block", "sine")):
        name, grip = f"stiction {stick:g}, {gait}", Grip(1.0, 2.0, stick, 2 * stick)
        yield _cell(part, 8.0, name, 2, grip, gait, stiffness=100.0)
    grips = {"F 1:2": _ONE_TWO, "spikes": Grip.spike(), "stiction": _STICTION, "F+ = F-": _ALIKE}
    for (label, grip), gait in product(grips.items(), ("block", "accordion")):
        name, drag = f"{label}, {gait}, all masses and links alike", float(label == "spikes")
        yield _cell(part, 5.0, name, 3, grip, gait, drag=drag, spread=0.0)


def cells(*, quick: bool = False) -> list[Cell]:
    """List the cells of the matrix; `quick`: only some of each group, none that takes long."""
    parts = (_core, _steep, _high_gains, _ratios, _long_worms, _long_times, _jumps, _frictions)
    found = [cell for part in parts for cell in part()]
    if not quick:
        return found
    groups: dict[str, list[Cell]] = {}
    for cell in found:
        if cell.worm.links <= 20 and not (cell.tracker and cell.tracker.gain > 100.0):
            groups.setdefault(cell.group, []).append(cell)
    chosen = [cell for group in groups.values() for cell in group[:: len(group) // 3 + 1]]
    return [replace(cell, span=min(cell.span, 1.0)) for cell in chosen]
