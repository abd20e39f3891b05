"""Crawls, designed gaits and certificates of the stress matrix.

Crawls are followed by quadrature and by steps of Moreau. Designed gaits are held against their
limits by the same route, against a bound of a linear program written anew, and against gaits in
closed form: all links shorten together while the head rests, and lengthen while the tail does. One
link has no better gait. Problems without an answer must be refused.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field
from functools import partial
from typing import Any

import numpy as np
from scipy.optimize import root_scalar

from tests.stress.crawl_route import Crawling, most_speed
from tests.stress.verdict import Case, Dice, Judged, Kind, above, apart, many, spread
from wormopt.errors import SolveError
from wormopt.model.gait import Gait
from wormopt.systems.spiked.certify.certificate import verify
from wormopt.systems.spiked.certify.certified import certify
from wormopt.systems.spiked.construct import accordion, block_wave, travelling_sine
from wormopt.systems.spiked.crawl import Crawl, crawl
from wormopt.systems.spiked.design.design import Design
from wormopt.systems.spiked.design.optimize import design
from wormopt.systems.spiked.gait_problem import Cost, Objective, Search, Worm
from wormopt.systems.spiked.limits import Limits

# -- crawls --------------------------------------------------------------------------------------


def _smooth(dice: Dice, links: int, period: float, size: float) -> Gait:
    """Cubics between random lengths and rates at random times."""
    pieces = int(dice.integers(2, 6))
    shares = dice.dirichlet(np.full(pieces, 4.0))
    breaks = period * np.append(0.0, np.cumsum(shares))
    h = np.diff(breaks)[:, None]
    x = size * dice.uniform(1.0, 2.0, (pieces, links))
    v = size / period * dice.uniform(-3.0, 3.0, (pieces, links))
    x1, v1 = np.roll(x, -1, axis=0), np.roll(v, -1, axis=0)
    square, cube = 3 * (x1 - x) / h**2 - (2 * v + v1) / h, 2 * (x - x1) / h**3 + (v + v1) / h**2
    return Gait(breaks, np.stack([x, v, square, cube], axis=2))


def _cornered(dice: Dice, links: int, period: float, size: float) -> Gait:
    """Straight lines between random lengths."""
    pieces = int(dice.integers(2, 6))
    breaks = period * np.append(0.0, np.cumsum(dice.dirichlet(np.full(pieces, 4.0))))
    x = size * dice.uniform(1.0, 2.0, (pieces, links))
    slopes = (np.roll(x, -1, axis=0) - x) / np.diff(breaks)[:, None]
    return Gait(breaks, np.stack([x, slopes], axis=2))


def _sine(dice: Dice, links: int, period: float, size: float) -> Gait:
    return travelling_sine(links, period, 2 * size, size * dice.uniform(0.1, 1), dice.uniform(0, 1))


def _wave(dice: Dice, links: int, period: float, size: float) -> Gait:
    length, profile = (size, size * dice.uniform(1.1, 2.0)), str(dice.choice(_PROFILES))
    asked: Any = {"profile": profile, "ramp": float(dice.choice([0.0, 0.1, 0.5]))}
    if dice.random() < 0.3:
        return accordion(links, period, length, **asked)
    return block_wave(links, int(dice.integers(1, links + 1)), period, length, **asked)


def _still(dice: Dice, links: int, period: float, size: float) -> Gait:
    """Lengths of which none, or only the first, changes."""
    lengths = size * dice.uniform(1.0, 2.0, (1, links, 1))
    moves = dice.choice([0.0, 0.1 * size])
    turning = moves * np.eye(links)[:1]
    omega = np.array([2 * np.pi / period])
    return Gait(np.array([0.0, period]), lengths, omega, turning, 0 * turning)


_PROFILES = ("cosine", "trapezoid", "quintic")
Make = Callable[[Dice, int, float, float], Gait]


def _crawl(make: Make, dice: Dice, *, hard: bool = False) -> Judged:
    links = int(dice.integers(1, 6))
    period = spread(dice, 1e-3, 1e6) if hard else spread(dice, 0.3, 3.0)
    size = spread(dice, 1e-9, 1e3) if hard else 1.0
    gait = make(dice, links, period, size)
    decades = 6 if hard else 1
    mass = 10 ** dice.uniform(-decades / 2, decades / 2, links + 1)
    pull = size / period**2 * mass.mean()  # forces of inertia are of this size
    load = float(dice.choice([0.3, 3.0, 30.0, 300.0])) * pull * dice.uniform(0.5, 2.0)
    drag = float(dice.choice([0.0, 0.1, 10.0])) * pull * period / size
    motion = crawl(gait, mass.tolist(), drag, load)
    yield from _compared(motion, Crawling(gait, mass, drag, load))


def _compared(motion: Crawl, other: Crawling) -> Judged:
    """Everything that quadrature or steps tell of a crawl."""
    fastest = np.abs(other.extremes_of_links(1)).max()
    masses = len(other.mass)
    if not other.rests:
        speed, doubt = other.stepped
        yield "speed by steps", abs(motion.speed - speed) / (1e-9 * fastest + doubt)
        return
    speed, size = other.advance / other.gait.period, other.force_size
    yield "speed", apart(motion.speed, speed, 1e-10, fastest)
    least, most = other.extremes(other.load_on)
    total = motion.extremes("sigma")
    yield "least load", apart(total[0] * masses, least, 1e-8, size * masses)
    yield "largest load", apart(total[1] * masses, most, 1e-8, size * masses)
    if np.all([len(stretch.resting) == 1 for stretch in motion.stretches]):
        known = other.extremes(other.forces)
        yield "actuators", apart(motion.extremes("actuator_force"), known, 1e-8, size * masses)
    if not motion.corners:  # the load of all spikes is the work of the way against load and drag
        push = motion.integral("reaction").sum() / other.gait.period
        balance = masses * other.load + _mean_drag(other)
        yield "mean load", apart(push, balance, 1e-9, size * masses)


def _mean_drag(other: Crawling) -> float:
    """Mean drag of all masses: all advance alike."""
    return other.drag * len(other.mass) * other.advance / other.gait.period


def _crawls() -> Iterator[Kind]:
    kinds: dict[str, tuple[Make, int]] = {
        "smooth": (_smooth, 45),
        "corners": (_cornered, 20),
        "sines": (_sine, 25),
        "waves": (_wave, 25),
        "still": (_still, 8),
    }
    for name, (make, count) in kinds.items():
        yield f"crawls: {name}", partial(_crawl, make), count
    for name, make in (("smooth", _smooth), ("waves", _wave), ("sines", _sine)):
        yield f"extreme crawls: {name}", partial(_crawl, make, hard=True), 15


# -- designs -------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Asked:
    """A problem of design with one period, one range and one limit each for all links."""

    links: int
    mass: tuple[float, ...]
    load: float
    period: float
    span: float  # longest less shortest length
    rate: float
    acceleration: float
    drag: float = 0.0
    resting: int = 1
    more: dict[str, Any] = field(default_factory=dict)

    @property
    def worm(self) -> Worm:
        """Who crawls."""
        return Worm(self.links, self.mass, self.drag, self.load)

    @property
    def limits(self) -> Limits:
        """Within what."""
        length = (self.span, 2 * self.span)
        return Limits(self.period, length, self.resting, self.rate, self.acceleration, **self.more)

    def design(self, objective: Objective | None = None) -> Design:
        """Ask for the best gait."""
        quick = Search(effort="quick", workers=1)
        return design(self.worm, self.limits, objective or Objective(), search=quick)

    @property
    def together(self) -> float:
        """Mean speed of the gait in which all links do the same, one cycle a period.

        In each stroke they get faster by the acceleration, stay at the rate, and get slower as
        fast as the load slows the masses that move. Both strokes go equally far.
        """
        spans, mass = np.arange(self.links + 1), np.array(self.mass)
        whole = (self.links + 1) * self.load
        brakes = [whole / float(mass @ spans), whole / float(mass @ spans[::-1])]
        brakes = [min(self.acceleration, brake) for brake in brakes]

        def lasts(way: float) -> float:
            return sum(self._time(way, brake) for brake in brakes)

        if lasts(self.span) <= self.period:
            return self.links * self.span / self.period
        far = (0.0, self.span)
        way = root_scalar(lambda way: lasts(way) - self.period, bracket=far, xtol=1e-300).root
        return self.links * float(way) / self.period

    def _time(self, way: float, brake: float) -> float:
        """Shortest time of a stroke."""
        slowness = 1 / self.acceleration + 1 / brake
        if way <= self.rate**2 * slowness / 2:
            return float(np.sqrt(2 * way * slowness))
        return way / self.rate + self.rate * slowness / 2

    @property
    def one_cycle(self) -> bool:
        """Whether a period is too short for the whole range, so that no second cycle helps."""
        return self.together < self.links * self.span / self.period * (1 - 1e-9)


def _asked(dice: Dice, links: int, *, hard: str = "") -> Asked:
    """Random numbers, of which `hard` names the one that is extreme."""
    period = spread(dice, 1e-3, 1e6) if hard == "periods" else spread(dice, 0.5, 2.0)
    span = spread(dice, 1e-9, 1e-3) if hard == "ranges" else spread(dice, 0.2, 1.0)
    decades = 6 if hard == "mass ratios" else 0.5
    mass = 10 ** dice.uniform(-decades / 2, decades / 2, links + 1)
    rate = span / period * dice.uniform(1.0, 4.0)
    acceleration = rate / period * dice.uniform(8.0, 40.0)
    inertia = acceleration * float(mass.max())
    load = inertia * (spread(dice, 1e-6, 1e6) if hard == "loads" else spread(dice, 0.1, 10.0))
    return Asked(links, tuple(mass.tolist()), load, period, span, rate, acceleration)


def _held(found: Design, asked: Asked) -> Judged:
    """Whether a designed gait keeps to what was asked, and is as fast as it says."""
    gait = found.gait
    other = Crawling(gait, np.array(asked.mass), asked.drag, asked.load)
    share = 1e-7
    low, high = other.extremes_of_links(0)
    yield "shortest", above(asked.span, float(low.min()), share)
    yield "longest", above(float(high.max()), 2 * asked.span, share)
    for name, order, most in (("rate", 1, asked.rate), ("acceleration", 2, asked.acceleration)):
        largest = float(np.abs(other.extremes_of_links(order)).max())
        yield name, above(largest, most, share)
    lengths, rates = other.gap
    yield "closed lengths", lengths / (share * asked.span)
    yield "closed rates", rates / (share * asked.rate)
    cycles = asked.period / gait.period
    yield "period", abs(cycles - max(round(cycles), 1)) / share
    size = len(asked.mass) * other.force_size
    yield "pulling spike", above(-other.least_load, 0.0, share, size)
    yield "speed", apart(found.speed, other.advance / gait.period, 1e-9, asked.rate)
    if most := asked.more.get("spike_load"):
        largest = float(other.extremes(other.load_of_one)[1][0])
        yield "spike load", above(largest, most, share)
    rate = np.full(asked.links, asked.rate)
    bound = most_speed(rate, rate, asked.resting)
    yield "bound of rates", above(found.speed, bound, 1e-8)


def _one_link(hard: str, dice: Dice) -> Judged:
    asked = _asked(dice, 1, hard=hard)
    found = asked.design()
    yield from _held(found, asked)
    best = asked.together
    yield "less than can be had", above(best, found.speed, 1e-6)
    if asked.one_cycle:
        yield "more than can be had", above(found.speed, best, 1e-7)


def _links(hard: str, dice: Dice) -> Judged:
    asked = _asked(dice, int(dice.integers(2, 4)), hard=hard)
    found = asked.design()
    yield from _held(found, asked)
    yield "slower than all links alike", above(asked.together, found.speed, 1e-6)


def _loaded(dice: Dice) -> Judged:
    """Few spikes carry little: a limit a little above what even slow gaits need."""
    easy = _asked(dice, int(dice.integers(1, 3)))
    need = len(easy.mass) * easy.load
    more = {"spike_load": need * dice.uniform(1.05, 2.0)}
    asked = Asked(**{**vars(easy), "more": more})
    found = asked.design()
    yield from _held(found, asked)


def _draggy(dice: Dice) -> Judged:
    """Drag holds a worm back as load does: no slower than without."""
    easy = _asked(dice, int(dice.integers(1, 3)))
    drag = easy.load / easy.rate * dice.uniform(0.1, 3.0)
    asked = Asked(**{**vars(easy), "drag": drag})
    found = asked.design()
    yield from _held(found, asked)
    yield "slower than all links alike", above(easy.together, found.speed, 1e-3)


def _cheap(minimise: Cost, dice: Dice) -> Judged:
    """Least costs at a speed that the worm can well keep up."""
    links = 1 if minimise == "energy_per_distance" else int(dice.integers(1, 3))
    asked = _asked(dice, links)
    speed = asked.together * dice.uniform(0.3, 0.9)
    found = asked.design(Objective(minimise, speed))
    yield from _held(found, asked)
    yield "slower than required", above(speed, found.speed, 1e-7)
    other = Crawling(found.gait, np.array(asked.mass), asked.drag, asked.load)
    whole = len(asked.mass) * asked.load
    if minimise == "energy_per_distance":
        yield "energy", apart(found.value, other.work / other.advance, 1e-7)
        yield "less than the load takes", above(whole, found.value, 1e-9)
        return
    largest = float(other.extremes(other.load_of_one)[1][0])
    yield "peak", apart(found.value, largest, 1e-7)
    yield "less than a mean", above(whole / asked.links, found.value, 1e-9)


def _resting(dice: Dice) -> Judged:
    """Several masses rest at any time."""
    easy = _asked(dice, int(dice.integers(2, 4)))
    asked = Asked(**{**vars(easy), "resting": 2})
    found = asked.design()
    yield from _held(found, asked)


def _impossible(dice: Dice) -> Judged:
    """Refused is right: spikes too weak for the load, speeds above any bound."""
    easy = _asked(dice, int(dice.integers(1, 4)))
    objective = Objective()
    if dice.random() < 0.5:
        weak = len(easy.mass) * easy.load * dice.uniform(0.1, 0.99)
        asked = Asked(**{**vars(easy), "more": {"spike_load": weak / easy.links}})
    else:
        rate = np.full(easy.links, easy.rate)
        beyond = most_speed(rate, rate, 1) * dice.uniform(1.001, 3.0)
        asked, objective = easy, Objective("peak_spike_load", beyond)
    try:
        found = asked.design(objective)
    except SolveError as error:
        yield "refusal names what to change", 0.0 if error.suggestion else np.inf
        return
    yield f"found {found.speed:.6g} where nothing can be", np.inf


def _designs() -> Iterator[Kind]:
    for hard in ("", "periods", "ranges", "mass ratios", "loads"):
        name = hard or "plain"
        yield f"one link: {name}", partial(_one_link, hard), 12
        yield f"designs: {name}", partial(_links, hard), 8
    yield "designs: spike loads", _loaded, 12
    yield "designs: drag", _draggy, 8
    yield "designs: two rest", _resting, 8
    yield "designs: least peaks", partial(_cheap, "peak_spike_load"), 10
    yield "designs: least energy", partial(_cheap, "energy_per_distance"), 6
    yield "designs: impossible", _impossible, 14


# -- certificates --------------------------------------------------------------------------------


def _certified(links: int, hard: str, dice: Dice) -> Judged:
    """No motion that is known beats the bound, which is not above that of rates."""
    asked = _asked(dice, links, hard=hard)
    proof = certify(asked.design(), gap=0.03, time_limit=3.0)
    yield from _held(proof.design, asked)
    rate = np.full(links, asked.rate)
    yield "known motion", above(asked.together, proof.bound, 1e-9)
    yield "bound of rates", above(proof.bound, most_speed(rate, rate, 1), 1e-8)
    speed = Crawling(proof.design.gait, np.array(asked.mass), 0.0, asked.load).advance
    speed /= proof.design.gait.period
    yield "its own design", above(speed, proof.bound, 1e-9)
    if proof.certificate is not None:
        yield "verified", 0.0 if verify(proof.certificate).holds else np.inf
    yield "gap", apart(proof.gap, proof.bound / speed - 1, 1e-6, 1.0)


def _certificates() -> Iterator[Kind]:
    for hard in ("", "periods", "ranges", "mass ratios", "loads"):
        name = f"certificates: {hard or 'plain'}"
        yield f"{name}, one link", partial(_certified, 1, hard), 7
        yield f"{name}, two links", partial(_certified, 2, hard), 3


def cases(*, quick: bool) -> Iterable[Case]:
    """Crawls, designs and certificates; `quick`: two of each kind."""
    return many([*_crawls(), *_designs(), *_certificates()], quick=quick)
