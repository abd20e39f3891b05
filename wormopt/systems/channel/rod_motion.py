"""Kind "rod-motion": a magnetisable rod that switched coils move through a channel."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import asdict, dataclass
from functools import cached_property, lru_cache
from typing import Annotated, Any, ClassVar

from msgspec import Meta, structs

from wormopt.errors import SolveError
from wormopt.result import Check
from wormopt.study import (
    Given,
    arrays,
    attributes,
    checks,
    entry,
    facts,
    number,
    on_use,
    parts,
    positive,
    scalar,
    signal,
    stage,
    value,
    warnings,
)
from wormopt.systems.channel.rod_course import RodPoint
from wormopt.systems.channel.tables import Pattern, RodStudy

with on_use():
    import numpy as np

    from wormopt.magnetics.blocks import BlockField
    from wormopt.model.schedule import Schedule
    from wormopt.numerics.workers import each
    from wormopt.simulation.moreau import MoreauJean, StepRecord
    from wormopt.systems.channel.closed_forms import warnings_of_susceptibility
    from wormopt.systems.channel.rod import Rod
    from wormopt.systems.channel.rod_course import (
        ASSUMED,
        change_of,
        check_of_error,
        checks_of_change,
        checks_of_motion,
        energy_error,
        lengths_between,
        mean_velocity,
    )
    from wormopt.systems.channel.rod_model import (
        Blocks,
        block_pull,
        block_schedule,
        channel_rod,
        magnetic_strength,
        straight,
        switched_blocks,
    )

Levels = Annotated[
    tuple[Annotated[int, Meta(ge=4, le=200)], ...],
    Meta(max_length=6, description="a list of up to 6 whole numbers from 4 to 200"),
]
Fractions = Annotated[
    tuple[Annotated[float, Meta(gt=0, le=1)], ...],
    Meta(max_length=6, description="a list of up to 6 numbers above 0, at most 1"),
]
_POWERS = ("damping_power", "load_power")
_FRAMES, _SAMPLES = 144, 1200
# Largest number of steps: some minutes.
_MOST_STEPS = 2e7


class Switching(Pattern):
    """Switching pattern of the coils, and its frequency."""

    frequency: float = positive(
        "rate", "*n*, switches per second; the field travels one pitch in 1/`frequency`"
    )


class Convergence(Given):
    """Other meshes and steps, to test convergence."""

    elements: Levels = entry("other numbers of elements", quantity="count", default=(24,))
    steps: Fractions = entry(
        "other time steps, as shares of the step", quantity="share", default=(0.5,)
    )
    accepted: float = number(
        "share",
        "accepted change of the mean velocity with any of these, beyond the errors of both and "
        "relative to that velocity (to a hundredth of the field's, if that is "
        "more)",
        above=0,
        below=1,
        default=0.1,
    )


@dataclass(frozen=True)
class Totals:
    """Wall forces of the whole motion, and work until its end."""

    pressed_max: float = value("force", "largest force of a wall on a node")
    pressed_mean: float = value("force", "mean of the sum of wall forces over all nodes")
    field_work: float = value("energy", "work of the field on the rod, at the end")
    friction_work: float = value("energy", "work of friction")
    damping_work: float = value("energy", "work of the material's damping")
    wall_work: float = value("energy", "work of impacts")
    step_count: int = value("count", "number of time steps")


@dataclass(frozen=True)
class Histories:
    """Displacement of the rod, and work on it, at a limited number of times."""

    instants: np.ndarray = signal("time", "time", "time", name="time")
    centre: np.ndarray = signal("length", "time", "mean position of the rod")
    work_load: np.ndarray = signal("energy", "time", "work of the field")
    work_damping: np.ndarray = signal("energy", "time", "work of the material's damping")
    work_friction: np.ndarray = signal("energy", "time", "work of friction")
    work_walls: np.ndarray = signal("energy", "time", "work of impacts")


@dataclass(frozen=True)
class Frames:
    """Shapes over the last two repeats of the pattern, wall forces, and active coils."""

    frame: np.ndarray = signal("time", "frame", "time of a shape")
    rod_x: np.ndarray = signal("length", "frame node", "x of the nodes")
    rod_y: np.ndarray = signal("length", "frame node", "y of the nodes")
    rod_angle: np.ndarray = signal("rad", "frame node", "angle of the nodes")
    pressed_upper: np.ndarray = signal("force", "frame node", "force on the upper wall")
    pressed_lower: np.ndarray = signal("force", "frame node", "force on the lower wall")
    first_coil: np.ndarray = signal("count", "frame", "first coil of an active block")
    coils_on: np.ndarray = signal("count", "frame", "number of coils in the block")


def _over(name: str, quantity: str) -> dict[str, tuple[str, tuple[str, ...], str]]:
    """Return the variables of motions with another step or mesh."""
    return {
        f"{name}_again": (quantity, (f"{name}_again",), name),
        f"velocity_by_{name}": ("speed", (f"{name}_again",), "mean velocity"),
        f"error_by_{name}": ("speed", (f"{name}_again",), "error of the mean velocity"),
    }


class RodMotion(RodStudy, kind="rod-motion"):
    """Simulate a magnetisable rod between walls, driven by coils switched in turn.

    A worm of soft magnetisable rubber lies between two walls, with coils beside them. The scene
    simulates one motion of the rod: velocity and direction, shapes, wall forces, and the balance of
    work. It repeats the simulation with other steps and meshes. Theory:
    [theory-channel.md](../theory-channel.md#3-rod-in-the-channel). Only `units = "SI"`. Parameters
    marked *assumed* are not published for the experiments in Zimmermann et al. 2007
    [[1]](../references.md). Every result lists them as scalars `assumed_…`.

    `frame` are times in the last two repeats of the pattern. The status is `failed` if the energy
    balance has an error above 1 %, or walls are penetrated by more than 5 % of the room. It is also
    `failed` if the mean velocity changes too much with step or mesh, or its error is above half of
    it.
    """

    pictures: ClassVar = {
        "rod_motion": "shapes, displacement, works",
        "animation": "the moving rod, as a GIF",
    }
    headline: ClassVar = (
        "velocity_mean", "velocity_error", "direction", "velocity_per_frequency", "field_speed",
    )  # fmt: skip

    switching: Switching = entry("switching of the coils")
    convergence: Convergence = entry("other meshes and steps", default=Convergence)

    # -- the rod and its coils ---------------------------------------------------------------------

    def varied(self, **tables: dict[str, Any]) -> RodMotion:
        """Return the study with new values by key in the tables named; values are not checked."""
        changed = {
            name: structs.replace(getattr(self, name), **numbers)
            for name, numbers in tables.items()
        }
        return structs.replace(self, **changed)

    def finer(self, elements: int | None = None, share: float = 0.5) -> RodMotion:
        """Return the same motion on another mesh, or with shorter steps.

        With `elements`, steps are the longest that this mesh allows; else they shrink by `share`.
        """
        if elements is not None:
            return self.varied(mesh={"elements": elements, "step": None})
        return self.varied(mesh={"step": share * self.step})

    @property
    def cycle(self) -> float:
        """Time after which the pattern repeats, in s."""
        return self.switching.every / self.switching.frequency

    @property
    def room(self) -> float:
        """Room of the centre line to either side of the channel's middle, in m."""
        return (self.channel.diameter - self.worm.diameter) / 2

    @property
    def end(self) -> float:
        """End time, after whole repeats of the pattern, in s."""
        repeats = max(self.time.cycles, int(np.ceil(self.time.end / self.cycle)))
        return repeats * self.cycle

    @cached_property
    def rod(self) -> Rod:
        """The rod."""
        worm, mesh = self.worm, self.mesh
        return Rod(
            worm.length, worm.diameter, worm.youngs_modulus, worm.density,
            damping_time=worm.damping_time, poisson_ratio=worm.poisson_ratio,
            elements=mesh.elements, degree=mesh.degree, skin=worm.skin or 0.0,
        )  # fmt: skip

    @cached_property
    def blocks(self) -> Blocks:
        """Sequence of active coils."""
        pattern = self.switching
        return switched_blocks(pattern.every, pattern.frequency, pattern.duration, pattern.shift)

    @property
    def schedule(self) -> Schedule:
        """Times and strengths of the blocks."""
        turns = self.coils.ampere_turns
        strength = magnetic_strength(self.rod, self.worm.susceptibility, turns)
        return block_schedule(self.blocks, self.coils.pitch, strength)

    @property
    def fields(self) -> tuple[BlockField, ...]:
        """Fields of the blocks that occur."""
        return tuple(
            self.coils.field(
                self.coils.pitch, self.channel.diameter, self.worm.diameter, count,
                self.switching.every, self.mesh.field_tolerance,
            )
            for count in self.blocks.counts
        )  # fmt: skip

    @property
    def numbers(self) -> dict[str, float]:
        """Parameters of the rod's model by name."""
        return {
            "youngs_modulus": self.worm.youngs_modulus,
            "density": self.worm.density,
            "damping_time": self.worm.damping_time,
            "friction": self.channel.friction,
        }

    @cached_property
    def stepper(self) -> MoreauJean:
        """Time stepper of the rod, compiled once for all materials, frictions and rates."""
        rod = self.rod
        sizes = rod.length, rod.diameter, rod.poisson_ratio, rod.elements, rod.degree, rod.skin
        return _stepper(*sizes, self.channel.diameter, self.fields)

    @property
    def start(self) -> np.ndarray:
        """State of a straight rod at rest, one repeat of the pattern from coil 0."""
        state = straight(self.rod, along=self.switching.every * self.coils.pitch)
        return np.concatenate([state[signal.name] for signal in self.stepper.model.x])

    @cached_property
    def step(self) -> float:
        """Longest time step, in s."""
        if self.mesh.step is not None:
            return self.mesh.step
        values = [self.numbers[signal.name] for signal in self.stepper.model.p]
        return self.stepper.safe_step(self.start, np.array(values))

    # -- the motion --------------------------------------------------------------------------------

    @stage
    def motion(self) -> StepRecord:
        step = self.step
        self._check_steps(step)
        try:
            return self.stepper.march(
                self.end, self.start, p=self.numbers, schedule=self.schedule, step=step,
                report=self.report,
            )  # fmt: skip
        except SolveError as lost:
            suggestion = "write a shorter mesh.step, or fewer coils.ampere_turns"
            raise SolveError(lost.reason, suggestion, lost.partial, lost.code) from None

    def _check_steps(self, step: float) -> None:
        """Refuse motions with too many steps: stiff or light rods, or very slow switching."""
        end, rate = self.end, self.switching.frequency
        count = max(end / step, 10 * end * rate)
        if not count <= _MOST_STEPS:
            raise SolveError(
                f"{end:.3g} s at {rate:g} switches per second take {count:.2g} steps, more "
                f"than {_MOST_STEPS:g}: the longest stable step is {step:.2g} s",
                "write a smaller worm.youngs_modulus or worm.damping_time, a larger worm.density, "
                "fewer time.cycles, or a shorter time.end",
                None,
                "too_many_steps",
            )

    @stage
    def repetitions(self) -> list[tuple[str, float, RodPoint]]:
        given = self.convergence
        others = [("step", share, self.finer(share=share)) for share in given.steps]
        others += [("elements", count, self.finer(count)) for count in given.elements]
        jobs = [other for _, _, other in others]
        found = dict(each(point_of, jobs, self.report, "again, more finely"))
        return [(name, size, found[k]) for k, (name, size, _) in enumerate(others)]

    @cached_property
    def mean_place(self) -> np.ndarray:
        """Mean position of the rod at all times, in m."""
        rod = self.rod
        return rod.weights @ self.motion.states[: rod.count] / rod.length

    @parts(RodPoint)
    def point(self) -> RodPoint:
        steps, n = self.motion, self.rod.count
        mass = float(self.rod.inertia[0].sum())
        mean = mean_velocity(steps.time, self.mean_place, self.cycle, self.time.settle)
        across = steps.states[n : 2 * n]
        return RodPoint(
            **asdict(mean),
            rate=self.switching.frequency,
            energy_error=energy_error(
                self.stepper.model, steps, self.numbers, mass, self.field_speed
            ),
            penetration=max(float(np.abs(across).max()) / self.room - 1, 0.0),
            field_error=max(field.error for field in self.fields),
            arc_length=self._segment_length(),
        )

    def _segment_length(self) -> float:
        """Return the mean rod length from coil to coil of a block just before coils change, m."""
        # NaN if the rod never reached over a block. Durations of coils are rounded to whole
        # switches.
        steps, rate = self.motion, self.switching.frequency
        n, pitch = self.rod.count, self.coils.pitch
        count, repeat = round(self.switching.duration), self.switching.every * self.coils.pitch
        switches = np.arange(round(steps.time[-1] * rate))
        switches = switches[switches > self.time.settle * len(switches)]
        looks = np.searchsorted(steps.time, (switches + 1) / rate * (1 - 1e-9)) - 1
        x, y = steps.states[:n, looks], steps.states[n : 2 * n, looks]
        first, width = (switches - count + 1) * pitch, (count - 1) * pitch
        first += repeat * np.round((x.mean(axis=0) - first - width / 2) / repeat)
        over = (x.min(axis=0) < first) & (first + width < x.max(axis=0))
        if count < 2 or not over.any():
            return float("nan")
        first = first[over]
        found = lengths_between(x[:, over], y[:, over], first, first + width)
        return float(found.mean() / (count - 1))

    # -- results -----------------------------------------------------------------------------------

    @scalar("1", "−1 against the travel of the field, 1 with it, 0 if the interval contains both")
    def direction(self) -> int:
        return self.point.direction

    @scalar("length", "`velocity_mean` over `rate`")
    def velocity_per_frequency(self) -> float:
        return self.point.velocity / self.switching.frequency

    @scalar("speed", "speed of the travelling field")
    def field_speed(self) -> float:
        return self.switching.frequency * self.coils.pitch

    @scalar("length", "largest depth in a wall: the displacement of one step")
    def penetration_max(self) -> float:
        return self.point.penetration * self.room

    @parts(Totals)
    def totals(self) -> Totals:
        steps = self.motion
        return Totals(
            pressed_max=float(steps.pressed.max(initial=0.0)),
            pressed_mean=float(np.mean(steps.pressed.sum(axis=0))),
            field_work=float(steps.work["load_power"][-1]),
            friction_work=float(steps.work["friction"][-1]),
            damping_work=float(steps.work["damping_power"][-1]),
            wall_work=float(steps.work["walls"][-1]),
            step_count=steps.n_steps,
        )

    @parts(Histories)
    def histories(self) -> Histories:
        steps = self.motion
        kept = np.unique(np.linspace(0, len(steps.time) - 1, _SAMPLES).astype(int))
        works = {name.removesuffix("_power"): done[kept] for name, done in steps.work.items()}
        return Histories(
            instants=steps.time[kept],
            centre=self.mean_place[kept],
            **{f"work_{name}": done for name, done in works.items()},
        )

    @parts(Frames)
    def frames(self) -> Frames:
        blocks, steps = self.blocks, self.motion
        since = max(steps.time[-1] - 2 * self.cycle, 0.0)
        kept = np.searchsorted(steps.time, np.linspace(since, steps.time[-1], _FRAMES))
        kept = np.clip(kept, 1, len(steps.time) - 1)
        time = steps.time[kept]
        x, y, angle = np.split(steps.states[: 3 * self.rod.count, kept].T, 3, axis=1)
        inside = np.mod(time - 1e-9 * self.cycle, blocks.breaks[-1])
        piece = np.searchsorted(blocks.breaks, inside, side="right") - 1
        turn = np.round((time - inside) / blocks.breaks[-1]) * 2 * self.switching.every
        return Frames(
            frame=time,
            rod_x=x,
            rod_y=y,
            rod_angle=angle,
            pressed_upper=steps.pressed[::2, kept - 1].T,
            pressed_lower=steps.pressed[1::2, kept - 1].T,
            first_coil=blocks.first[piece] + turn,
            coils_on=blocks.count[piece],
        )

    @scalar("speed", "mean velocity for each of `convergence.steps`, then `convergence.elements`")
    def velocity_again(self) -> list[float]:
        return [other.velocity for _, _, other in self.repetitions]

    @arrays(_over("step", "share") | _over("elements", "count"))
    def repeated(self) -> dict[str, np.ndarray]:
        found = {}
        for kind in ("step", "elements"):
            rows = [
                (size, other.velocity, other.error)
                for name, size, other in self.repetitions
                if name == kind
            ]
            if rows:
                columns = map(np.array, zip(*rows, strict=True))
                found |= dict(zip(_over(kind, ""), columns, strict=True))
        return found

    @attributes
    def drawn(self) -> dict[str, Any]:
        coils = self.coils
        return {
            "channel": self.channel.diameter,
            "body": self.worm.diameter,
            "pitch": coils.pitch,
            "every": self.switching.every,
            "coil": [coils.inner_radius, coils.outer_radius, coils.length, coils.clearance],
        }

    # -- the trust report --------------------------------------------------------------------------

    @checks
    def of_motions(self) -> Iterator[Check]:
        yield from checks_of_motion(self.point)
        accepted = self.convergence.accepted
        if not self.repetitions:
            yield check_of_error(self.point, self.field_speed)
        for name, size, other in self.repetitions:
            what = f"with {name} {size:g}"
            yield from checks_of_motion(other, what)
            yield from checks_of_change(self.point, other, self.field_speed, accepted, what)

    @facts
    def found(self) -> dict[str, Any]:
        point, others = self.point, [other for _, _, other in self.repetitions]
        return {
            "energy_error": point.energy_error,
            "penetration_share": point.penetration,
            "field_error": point.field_error,
            "velocity_error": point.error,
            "recheck_velocity_change": change_of(point, others, self.field_speed),
            "accepted": self.convergence.accepted,
            "assumptions": ASSUMED,
        }

    @warnings
    def of_velocity(self) -> Iterator[str]:
        point = self.point
        if point.error > 0.1 * abs(point.velocity):
            yield (
                f"the error of the mean velocity is {point.error:.2g} m/s; write a longer time.end"
            )
        if not point.settled:
            yield (
                "the mean velocity of the first half differs from that of the second, so it has "
                "not converged; write a larger time.settle or a longer time.end"
            )
        yield from warnings_of_susceptibility(self.worm.susceptibility)


def point_of(motion: RodMotion) -> RodPoint:
    """Simulate a copy of a motion, which keeps no states."""
    return structs.replace(motion).point


@lru_cache(maxsize=16)
def _stepper(
    length: float,
    diameter: float,
    poisson_ratio: float,
    elements: int,
    degree: int,
    skin: float,
    channel: float,
    fields: tuple[BlockField, ...],
) -> MoreauJean:
    """Return the steps of a rod; material and friction are parameters."""
    rod = Rod(length, diameter, 1.0, 1.0, poisson_ratio=poisson_ratio, elements=elements,
              degree=degree, skin=skin)  # fmt: skip
    model = channel_rod(rod, channel, friction=1.0)
    return MoreauJean(model, integrals=_POWERS, inputs=block_pull(rod, fields))
