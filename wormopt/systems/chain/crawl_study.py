"""The chain of an optimal crawl, in the sizes and with the problem that its search needs."""

from __future__ import annotations

import math
from dataclasses import replace
from functools import cached_property

from wormopt.study import entry, on_use
from wormopt.study.numerics import MeshTable, Start
from wormopt.study.types import per
from wormopt.systems.chain.crawl_tables import Aim, CrawlLimits, Robust, Search
from wormopt.systems.chain.tables import ChainTable
from wormopt.systems.shared.optimal_motion import OptimalMotion

with on_use():
    import numpy as np

    from wormopt.model.model import Model
    from wormopt.ocp.problem import Problem
    from wormopt.systems.chain.copies import draw_factors, numbers_of, scenario_model
    from wormopt.systems.chain.dynamic import crawl_problem
    from wormopt.systems.chain.loops import build_chain, draw_links, laws_of

USUAL_SIZES = 20.0
"""Largest input in nominal sizes."""
# The least friction counts, but at least this share of the largest.
_FRICTION = 1e-2


class CrawlStudy(OptimalMotion):
    """A chain that crawls within limits. It can be sent to other processes."""

    worm: ChainTable = entry("the chain, with `friction`")
    limits: CrawlLimits = entry("limits of the crawl")
    objective: Aim = entry("objective of the crawl")
    mesh: MeshTable = entry("mesh in time", default=MeshTable(arcs=24))
    search: Search = entry("starting points of the search", default=Search)
    robust: Robust | None = entry(
        "design for several chains; default: a single chain", default=None
    )

    @property
    def single_chain(self) -> bool:
        """Whether the crawl is designed for one chain."""
        return self.robust is None

    @cached_property
    def plant(self) -> Model:
        """The nominal chain, in usual sizes of its rest lengths and periods."""
        rest = float(np.mean(per(self.worm.rest_length, self.worm.links)))
        size = rest / 2 if rest > 0 else 1.0
        links = draw_links(self.worm, 1.0)
        return build_chain(self.worm, Start(), links, size, self.limits.period_range[1])

    @cached_property
    def draws(self) -> list[dict[str, np.ndarray]]:
        """Parameters of each chain that differ from the nominal ones; the first is nominal."""
        if self.robust is None:
            return [{}]
        random, own = np.random.default_rng(self.robust.seed), numbers_of(self.plant)
        factors = [draw_factors(own, self.robust.spread, random) for _ in range(self.robust.draws)]
        return [{}, *({name: own[name] * f for name, f in drawn.items()} for drawn in factors)]

    @cached_property
    def reach(self) -> float:
        """Usual amplitude of the lengths of links, by their range if they have one."""
        usual, ranges = self.plant.x[0].nominal, self.limits.length_ranges(self.worm.links)
        if ranges is None:
            return usual
        return min(max(high - low for low, high in ranges) / 2, 2 * usual)

    def needed(self, rate: float) -> float:
        """Force that moves links of this rate through their reach, against ground and load.

        More force seldom helps, so it replaces limits that are far above it.
        """
        worm, masses = self.worm, self.worm.links + 1
        slips = (s * float(law.slip_force(-s * rate, -s)) for law in laws_of(worm) for s in (1, -1))
        ground = sum(map(abs, per(worm.pull, masses))) + sum(filter(math.isfinite, map(abs, slips)))
        inertia = sum(per(worm.mass, masses)) * rate / self.reach
        links = max(per(worm.stiffness, 1)) * self.reach + max(per(worm.damping, 1)) * rate
        return links + (inertia + sum(per(worm.drag, masses))) * rate + ground

    def sized(self, speed: float) -> Model:
        """Scale the plant by the usual size of velocities, and by friction.

        Masses and periods alone give forces that are too small by orders of magnitude for light
        worms.
        """
        position, velocity = self.plant.x
        velocity = replace(velocity, nominal=max(speed, velocity.nominal / 10))
        plant, most = self.plant, max(per(self.limits.actuator_force, 1))
        force = min(most, USUAL_SIZES * self.needed(velocity.nominal))
        held = [end for law in laws_of(self.worm) for end in law.stick_interval]
        sizes = np.abs(np.array(held, dtype=float))
        sizes = np.minimum(sizes[sizes > 0], force)
        friction = float(max(sizes.min(), _FRICTION * sizes.max()) if len(sizes) else force)
        return replace(
            plant,
            x=[position, velocity],
            u=[replace(u, nominal=max(friction, force / USUAL_SIZES)) for u in plant.u],
            contacts=[
                replace(c, nominal_force=friction, nominal_speed=velocity.nominal)
                for c in plant.contacts
            ],
        )

    def problem(self, speed: float) -> Problem:
        """State the problem where velocities have this usual size."""
        plant = self.sized(speed)
        if self.robust is None:
            return crawl_problem(plant, self.limits, self.objective)
        copies = scenario_model(plant, self.draws)
        return crawl_problem(copies, self.limits, self.objective, self.robust.judge)
