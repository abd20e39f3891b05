"""The planar cells of the stress matrix: random blocks and chains on ground of every kind."""

from __future__ import annotations

import zlib
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from tests.oracles.planar_loop import LOOSE, TIGHT, box_flow, planar_flow
from tests.oracles.planar_worm import Drive, PlanarWorm, block
from wormopt.model.friction import Coulomb, NoSlip, Spike
from wormopt.model.model import Model
from wormopt.model.planar_friction import Elliptic
from wormopt.simulation.options import Exact
from wormopt.systems.planar.dynamics.chain import Axes, planar_chain
from wormopt.systems.planar.dynamics.motion import swing
from wormopt.systems.planar.shape import Harmonics

Kind = Literal["elliptic", "isotropic", "box", "spike", "skid", "spiked skid"]


@dataclass(frozen=True, eq=False)
class PlanarCell:
    """One planar run of the matrix, with contact treated exactly."""

    name: str
    group: str
    worm: PlanarWorm
    span: float
    kind: Kind

    core = False
    contact = Exact()

    def model(self) -> Model:
        """Build the Model: chains by the package's builders, blocks by hand."""
        worm = self.worm
        if not worm.looks:
            return worm.model()
        n = worm.n - 1
        plant = planar_chain(
            n,
            mass=worm.mass,
            stiffness=worm.stiffness,
            damping=worm.damping,
            rest_length=worm.length,
            bending_stiffness=worm.bending if n > 1 else 0.0,
            bending_damping=worm.bending_damping if n > 1 else 0.0,
            rest_angle=worm.angle if n > 1 else 0.0,
            law=[self._law(i) for i in range(worm.n)],
            pull=np.zeros((worm.n, 2)) if worm.load is None else worm.load,
            position=worm.place,
            velocity=worm.velocity,
        )
        courses = {"input": _harmonics(worm.drive)}
        if n > 1:
            courses["torque"] = _harmonics(worm.torque)
        return swing(plant, 2 * np.pi / worm.drive.omega, courses)

    def _law(self, i: int) -> Elliptic | Axes:
        ahead, back, beside = (
            float(part[i]) for part in (self.worm.forward, self.worm.backward, self.worm.sideways)
        )
        if self.kind in ("elliptic", "isotropic"):
            return Elliptic(ahead, back, beside)
        across = NoSlip() if "skid" in self.kind else Coulomb(beside, beside)
        return Axes(Spike() if "spike" in self.kind else Coulomb(ahead, back), across)

    @property
    def start(self) -> np.ndarray:
        """Places and velocities at time 0."""
        return self.worm.start

    @property
    def resting(self) -> np.ndarray:
        """Which states are velocities that are 0 at the start."""
        found = self.start == 0
        found[: 2 * self.worm.n] = False
        return found

    def follow(self, times: np.ndarray) -> Callable[[np.ndarray, float], np.ndarray]:
        """What follows the motion from a start, exactly at a tolerance of 1e-13, else less so."""

        def flow(start: np.ndarray, tolerance: float) -> np.ndarray:
            if self.worm.ground == "elliptic":
                care = TIGHT if tolerance <= 1e-13 else LOOSE
                return planar_flow(self.worm, self.span, times, start=start, care=care).states
            motion = box_flow(self.worm, self.span, times, start=start, relative=tolerance)
            return motion.states

        return flow


def _harmonics(drive: Drive) -> Harmonics:
    return Harmonics(np.zeros(drive.cosine.shape[1]), drive.cosine, drive.sine)


def _resistances(dice: np.random.Generator, kind: Kind, masses: int) -> list[np.ndarray]:
    """F+, F- and Fn of each mass."""
    if kind == "isotropic":
        return [dice.uniform(0.3, 2.0, masses)] * 3
    ahead = dice.uniform(0.3, 1.5, masses)
    back, beside = ahead * dice.uniform(1.1, 4.0), dice.uniform(0.4, 3.0, masses)
    if kind == "skid":
        beside = np.full(masses, np.inf)
    return [ahead, back, beside]


def _block(name: str, kind: Kind) -> PlanarCell:
    """A block that is pushed, loaded or both, and looks anywhere."""
    dice = np.random.default_rng(zlib.crc32(name.encode()))
    resistance = [float(part[0]) for part in _resistances(dice, kind, 1)]
    heading, direction, way = dice.uniform(-np.pi, np.pi, 3)
    speed, size = dice.uniform(0.2, 2.0), dice.choice([0.0, 0.3, 0.8, 2.0]) * min(resistance)
    if dice.random() < 0.15:
        speed = 0.0  # begins at rest: slides off, or not at all
    worm = block(
        speed * np.array([np.cos(direction), np.sin(direction)]),
        resistance,
        load=size * np.array([np.cos(way), np.sin(way)]),
        heading=float(heading),
        mass=float(dice.uniform(0.5, 2.0)),
        ground="box" if kind == "box" else "elliptic",
    )
    return PlanarCell(name, f"planar blocks: {kind}", worm, 3.0, kind)


def _chain(name: str, kind: Kind, links: int, *, straight: bool = False) -> PlanarCell:
    """A chain that begins at rest, nearly straight, and is driven by a few harmonics."""
    dice = np.random.default_rng(zlib.crc32(name.encode()))
    masses, joints = links + 1, max(links - 1, 0)
    forward, backward, sideways = _resistances(dice, kind, masses)
    length = dice.uniform(0.8, 1.2, links)
    bends = np.zeros(links) if straight else dice.uniform(-0.4, 0.4, links)
    angle = dice.uniform(-np.pi, np.pi) * (not straight) + np.cumsum(bends)
    steps = length[:, None] * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    place = np.vstack([np.cumsum(steps[::-1], axis=0)[::-1], np.zeros(2)])
    omega, harmonics = dice.uniform(1.5, 4.0), int(dice.integers(1, 3))
    order = np.arange(1, harmonics + 1)[:, None]

    def drive(actuators: int, size: float) -> Drive:
        cosine, sine = dice.uniform(-1, 1, (2, harmonics, actuators)) * size / order
        return Drive(cosine, sine, omega)

    load = np.zeros((masses, 2))
    if not straight and dice.random() < 0.5:
        load += 0.3 * forward.min() * dice.uniform(-1, 1, 2)
    worm = PlanarWorm(
        dice.uniform(0.6, 1.5, masses),
        place,
        np.zeros((masses, 2)),
        forward,
        backward,
        sideways,
        pairs=[(j, j + 1) for j in range(links)],
        stiffness=dice.uniform(8.0, 20.0, links),
        damping=dice.uniform(0.3, 1.5, links),
        length=length,
        drive=drive(links, 4.0),
        bending=dice.uniform(2.0, 6.0, joints),
        bending_damping=dice.uniform(0.2, 0.8, joints),
        angle=0.0 * bends[1:] if straight else -bends[1:],
        torque=drive(joints, 0.0 if straight else 2.0),
        load=load,
        drag=(0.0, 0.0),
        ground="elliptic" if kind in ("elliptic", "isotropic") else "spike"
        if "spike" in kind else "box",
    )  # fmt: skip
    if "skid" in kind:
        worm = replace(worm, sideways=np.full(masses, np.inf))
    what = "straight" if straight else kind
    return PlanarCell(name, f"planar chains: {what}", worm, 3.0, kind)


_SIZES: dict[Kind, int] = {"elliptic": 44, "isotropic": 28, "box": 20, "spike": 12, "skid": 12}


def _all() -> Iterator[PlanarCell]:
    blocks: dict[Kind, int] = {"elliptic": 35, "isotropic": 20, "box": 15}
    for kind, count in blocks.items():
        for k in range(count):
            yield _block(f"planar-block {kind} {k}", kind)
    for kind, count in _SIZES.items():
        for k in range(count):
            yield _chain(f"planar-chain {kind} {k}, links {k % 4 + 1}", kind, k % 4 + 1)
    for k in range(14):
        name = f"planar-chain straight {k}, links {k % 3 + 1}"
        yield _chain(name, "elliptic", k % 3 + 1, straight=True)


def planar_cells(*, quick: bool = False) -> list[PlanarCell]:
    """List the planar cells; `quick`: one or two of each group, for a shorter time."""
    found = list(_all())
    if not quick:
        return found
    groups: dict[str, list[PlanarCell]] = {}
    for cell in found:
        groups.setdefault(cell.group, []).append(cell)
    chosen = [cell for group in groups.values() for cell in group[:2]]
    return [replace(cell, span=1.0) for cell in chosen]
