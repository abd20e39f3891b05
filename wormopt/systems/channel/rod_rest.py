"""The body of a channel as a rod at rest in the field of coils, from wall to wall."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property

from wormopt.errors import ArgumentError, SolveError
from wormopt.result import Check
from wormopt.study import on_use, signal, value

with on_use():
    import casadi as ca
    import numpy as np

    from wormopt.analysis.resting import Loaded, Rest
    from wormopt.magnetics.blocks import BlockField
    from wormopt.progress import Report
    from wormopt.systems.channel.closed_forms import ChannelWorm
    from wormopt.systems.channel.rod import Curve, Rod, RodLine, distances
    from wormopt.systems.channel.rod_model import (
        block_energy,
        block_load,
        channel_rod,
        magnetic_strength,
    )
    from wormopt.systems.channel.tables import RodOverCoils

# Accepted residual of the forces, and accepted change of length with two thirds of the elements.
_BALANCED, _MESH = 1e-6, 5e-3
# Shares of the field in which a rod on one wall is computed up to the whole field.
_SHARES = (0.05, 0.2, 0.5, 1.0)
# Statics do not depend on density and friction, which the Model needs.
_DENSITY, _FRICTION = 1000.0, 1.0

ASSUMED = {
    "rod": "the rod stretches, shears and bends by any amount; its material is linear; no friction",
    "rod's field": "coils, susceptibility and ampere-turns are not published; the body does not "
    "change the field; no iron; the pull acts on its centre line",
    "rod's rest": "a local minimum of the energy, from the sine shape over the block; there may "
    "be others",
    "rod's contact": "walls are touched at the nodes of the elements",
}


@dataclass(frozen=True, eq=False)
class RodAtRest:
    """A rod at rest, and its segment between two coils."""

    table: RodOverCoils
    worm: ChannelWorm
    rod: Rod  # the body on elements
    rest: Rest  # places and forces; x from the middle of the block
    curve: Curve  # middle segment, lower to upper wall as `SegmentShape`
    bending: tuple[float, float]  # bending energy over E I and largest curvature, 1/m
    mesh_change: float  # change of the length with two thirds of the elements, over the length
    field_error: float  # largest error of the series of H², over largest H²
    reached: bool = value(
        "1",
        "whether the rod touches the walls within half a coil distance of both coils of the "
        "segment",
        name="rod_reaches_walls",
    )
    lengths: list[float] = value(
        "length",
        "length of all segments of the block; `arc_length` has the middle one",
        name="rod_arc_lengths",
    )
    stretch: float = value(
        "share",
        "length of the segment less that of the same piece of the body without load",
        name="rod_stretch",
    )
    compression: float = value(
        "share",
        "largest shortening of any fibre; at 1 cross sections penetrate each other, and the "
        "rod is refused as crushed (exit code 3)",
        name="rod_compression_max",
    )
    other_energy: float | None = value(
        "energy",
        "energy of a rod along the wall of the first coil; unknown if it does not stay there",
        name="rod_energy_on_one_wall",
    )

    @property
    def walls(self) -> tuple[np.ndarray, np.ndarray]:
        """Forces of the upper and of the lower wall on the nodes."""
        return self.rest.pressed[::2], self.rest.pressed[1::2]

    def checks(self) -> Iterator[Check]:
        """Yield the checks of the rest; the mesh counts if forces balance."""
        for check in _balance(self.rest):
            advice = f"rod: {check.advice}"
            yield Check(f"rod: {check.name}", check.value, check.limit, advice, check.passed)
            if not check.passed:
                return
        yield Check(
            "rod: change with the mesh",
            self.mesh_change,
            _MESH,
            f"rod: with fewer elements the segment's length changes by a share of "
            f"{self.mesh_change:.2g}; write more rod.elements",
        )


def _balance(rest: Rest) -> Iterator[Check]:
    """Yield the checks of a single rest."""
    for name in ("residual", "imbalance"):
        off = getattr(rest, name)
        yield Check(name, off, _BALANCED, f"forces are not balanced, by {off:.2g} ({name})")
    advice = "the rest is not stable; write other rod.ampere_turns"
    yield Check("stability", rest.softest, 0.0, advice, rest.stable)


def _doubt(rest: Rest) -> str:
    """Return why a rest is not reliable; empty if it is."""
    return next((check.advice for check in _balance(rest) if not check.passed), "")


@dataclass(frozen=True, eq=False)
class _Bench:
    """The rod in its channel over a block of coils, for any ampere-turns."""

    worm: ChannelWorm
    table: RodOverCoils
    elements: int

    @cached_property
    def rod(self) -> Rod:
        worm, table = self.worm, self.table
        assert worm.youngs_modulus is not None
        return Rod(worm.length, worm.body, worm.youngs_modulus, _DENSITY,
                   poisson_ratio=table.poisson_ratio, elements=self.elements,
                   degree=table.degree)  # fmt: skip

    @cached_property
    def field(self) -> BlockField:
        worm, table = self.worm, self.table
        return table.field(
            worm.pitch, worm.channel, worm.body, table.on, table.every, table.field_tolerance
        )

    @cached_property
    def loaded(self) -> Loaded:
        rod = self.rod
        return Loaded(
            channel_rod(rod, self.worm.channel, _FRICTION), block_energy(rod, self.field),
            block_load(rod, [self.field]), size=rod.stiffness().bending / self.worm.pitch,
        )  # fmt: skip

    def at(self, ampere_turns: float, start: np.ndarray) -> Rest:
        """Return the rest at given ampere-turns, with the first coil on the upper side."""
        strength = magnetic_strength(self.rod, self.table.susceptibility, ampere_turns)
        try:
            found = self.loaded.rest(start, [0.0, 1.0, strength, 0.0])
        except SolveError as error:
            raise SolveError(
                f"rod at {ampere_turns:g} ampere-turns: {error.reason.partition(': ')[2]}",
                "write smaller rod.ampere_turns or rod.susceptibility, or more rod.elements",
                code=error.code,
            ) from None  # fmt: skip
        if not self.compression(found) < 1:
            raise SolveError(
                f"rod at {ampere_turns:g} ampere-turns: the field crushes it until cross sections "
                "penetrate each other",
                "write smaller rod.ampere_turns or rod.susceptibility", code="crushed",
            )  # fmt: skip
        return found

    def compression(self, rest: Rest) -> float:
        """Return the largest relative shortening of fibres; at 1 neighbouring sections touch."""
        places = (ca.DM(part) for part in rest.places.reshape(3, -1))
        stretch, _, curvature = (np.array(part) for part in self.rod.strains(*places))
        return float((np.abs(curvature) * self.worm.body / 2 - stretch).max())

    @property
    def bent(self) -> np.ndarray:
        """Start: sines from coil to coil, flat on a wall beyond, the middle over the block's."""
        rod, pitch, room = self.rod, self.worm.pitch, self.worm.rise / 2
        reach = (self.table.on - 1) / 2 * pitch
        x = np.linspace(-reach - rod.length, reach + rod.length, 16 * rod.count + 1)
        y = room * np.cos(np.pi * (np.clip(x, -reach, reach) + reach) / pitch)
        along = np.append(0.0, np.cumsum(np.hypot(np.diff(x), np.diff(y))))
        at = along[-1] / 2 + rod.nodes - rod.length / 2
        angle = np.arctan2(np.gradient(y), np.gradient(x))
        return np.concatenate([np.interp(at, along, part) for part in (x, y, angle)])

    @property
    def flat(self) -> np.ndarray:
        """Start: straight along the wall of the first coil."""
        rod = self.rod
        y = np.full(rod.count, 0.999 * self.worm.rise / 2)
        return np.concatenate([rod.nodes - rod.length / 2, y, 0 * y])

    def segment(self, rest: Rest, k: int) -> Curve:
        """Return the centre line from coil k of the block to the next, from the lower wall up."""
        line, pitch, middle = RodLine(self.rod, rest.places), self.worm.pitch, self.worm.channel / 2
        first = (k - (self.table.on - 1) / 2) * pitch
        side = -1.0 if k % 2 == 0 else 1.0
        try:
            found = line.between(first, first + pitch)
        except ArgumentError:
            raise SolveError(
                "at rest the body does not reach over the active coils",
                "write a longer worm.length, fewer coils in rod.on, or smaller rod.ampere_turns, "
                "which contract it less",
                code="no_segment",
            ) from None  # fmt: skip

        def points(share: np.ndarray) -> np.ndarray:
            x, y, angle = found.points(share)
            return np.array([x - first, middle + side * y, side * angle])

        return Curve(found.length, points, found.breaks)

    @property
    def middle_segment(self) -> int:
        """Index of the block's segment that is analysed."""
        return (self.table.on - 1) // 2

    def reached(self, rest: Rest) -> bool:
        """Return whether both coils of the middle segment hold the rod on their walls."""
        x = rest.places[: self.rod.count]
        for k in (self.middle_segment, self.middle_segment + 1):
            place = (k - (self.table.on - 1) / 2) * self.worm.pitch
            near = np.abs(x - place) < self.worm.pitch / 2
            if not np.any(rest.pressed[k % 2 :: 2][near] > 0):
                return False
        return True


def rest_of(worm: ChannelWorm, table: RodOverCoils, report: Report) -> RodAtRest:
    """Return the rest of the body over a block of coils, and its segment between two of them.

    The modulus of `worm` must be known.
    """
    report("rod: field of the coils", None)
    bench = _Bench(worm, table, table.elements)
    report("rod: coming to rest", None)
    rest = bench.at(table.ampere_turns, bench.bent)
    k = bench.middle_segment
    curve = bench.segment(rest, k)
    coarse = _Bench(worm, table, max(4, 2 * table.elements // 3))
    other = coarse.segment(coarse.at(table.ampere_turns, coarse.bent), k)
    first = (k - (table.on - 1) / 2) * worm.pitch
    line = RodLine(bench.rod, rest.places)
    return RodAtRest(
        table=table, worm=worm, rod=bench.rod, rest=rest, curve=curve,
        lengths=[bench.segment(rest, j).length for j in range(table.on - 1)],
        reached=bench.reached(rest), bending=line.curvature(first, first + worm.pitch),
        stretch=curve.length / line.unloaded(first, first + worm.pitch) - 1,
        other_energy=_on_one_wall(bench, table),
        compression=bench.compression(rest),
        mesh_change=abs(other.length / curve.length - 1),
        field_error=bench.field.error,
    )  # fmt: skip


def _on_one_wall(bench: _Bench, table: RodOverCoils) -> float | None:
    """Return the energy of the rod that stays on the first coil's wall as the field grows."""
    places, rest = bench.flat, None
    for share in _SHARES:
        try:
            rest = bench.at(np.sqrt(share) * table.ampere_turns, places)
        except SolveError:
            return None
        places = rest.places
    assert rest is not None
    alone = not np.any(rest.pressed[1::2]) and not _doubt(rest)
    return rest.energy if alone else None


@dataclass(frozen=True, eq=False)
class Sweep:
    """Rests over ampere-turns; NaN if the segment does not span the walls."""

    left_out: list[str]  # warnings of rests that are unstable or unbalanced
    sweep: np.ndarray = signal("ampere_turns", "sweep", "ampere-turns")
    sweep_arc_length: np.ndarray = signal("length", "sweep", "length of the segment")
    sweep_distance: np.ndarray = signal(
        "length", "assumed sweep", "largest distance from the assumed shapes"
    )
    sweep_closest_shape: list[str | None] = value(
        "1", "closest assumed shape at each value of `rod.sweep`"
    )


def sweep_of(
    worm: ChannelWorm, table: RodOverCoils, assumed: dict[str, Curve], report: Report
) -> Sweep:
    """Return length and closest `assumed` shape over ampere-turns, each from the previous rest."""
    bench, turns = _Bench(worm, table, table.elements), np.array(table.sweep)
    apart = np.full((len(assumed), len(turns)), np.nan)
    lengths = np.full(len(turns), np.nan)
    places, warnings = bench.bent, []
    # from strong fields, which hold the rod on both walls, to weak ones
    for done, j in enumerate(np.argsort(turns)[::-1]):
        report(f"rod: {turns[j]:g} ampere-turns", done / len(turns))
        rest = bench.at(float(turns[j]), places)
        if doubt := _doubt(rest):
            warnings.append(f"rod.sweep: left out at {turns[j]:g} ampere-turns: {doubt}")
            continue
        places = rest.places
        if not bench.reached(rest):
            break  # on one wall it stays there in all weaker fields
        curve = bench.segment(rest, bench.middle_segment)
        lengths[j] = curve.length
        apart[:, j] = [distances(curve, other)[0] for other in assumed.values()]
    names = list(assumed)
    closest = [None if np.isnan(column[0]) else names[int(np.argmin(column))] for column in apart.T]
    return Sweep(warnings, turns, lengths, apart, closest)
