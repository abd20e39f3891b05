"""Travelling waves: every mass does what the one behind, or ahead of, it did a phase before.

The velocity of mass i in phase p depends on (p + i), or (p - i), modulo the number of phases only,
so that the program of a cycle has the unknowns of one mass, however many links the worm has.
Neighbours are alike in all phases, so that links need the rows of one phase; the sums of forces
are not, as the chain has ends.
"""

from __future__ import annotations

from functools import cached_property

import numpy as np

from wormopt.systems.spiked.programs.program import GaitProgram
from wormopt.systems.spiked.search.sequences import Sequence_


def wave_orders(links: int, resting: int) -> list[Sequence_]:
    """Orders in which blocks of resting masses, equally far apart, run from tail to head.

    One for each number of phases q, with the shortest blocks that leave `resting` at rest.
    """
    masses, found = links + 1, []
    for phases in range(2, masses + 1):
        for block in range(1, phases):
            sets = [
                tuple(i for i in range(masses) if (i + p) % phases < block) for p in range(phases)
            ]
            if min(map(len, sets)) >= resting:
                found.append(tuple(sets))
                break
    return found


def wave_direction(sequence: Sequence_, masses: int) -> int:
    """Direction in which masses rest in turn, each a phase after its neighbour.

    1 from tail to head, -1 from head to tail, 0 where it is no wave.
    """
    phases = len(sequence)
    for direction in (1, -1):
        classes = {direction * i % phases for i in sequence[0]}
        if phases <= masses and all(
            set(resting) == {i for i in range(masses) if (direction * i + p) % phases in classes}
            for p, resting in enumerate(sequence)
        ):
            return direction
    return 0


class WaveProgram(GaitProgram):
    """Program of a cycle whose phases are alike: a travelling wave.

    Parameters as for `GaitProgram`; `sequence` must be a wave (`wave_direction`), with equal
    numbers of arcs in all phases. Limits of every link and mass hold, unequal ones too.
    """

    @cached_property
    def _uniform(self) -> bool:
        limits = self.limits
        given = [
            limits.mass,
            *limits.rates,
            limits.strokes,
            limits.acceleration if limits.acceleration is not None else [0.0],
            self.task.limits.spike_load or 0.0,
            self.task.limits.actuator_force or 0.0,
        ]
        return all(np.ptp(np.asarray(values)) == 0.0 for values in given)

    @property
    def _phases(self) -> int:
        if not self._uniform:
            return len(self.sequence)
        # every pair of neighbouring classes is a link's in the first phase; where there are as
        # many phases as masses, that of the last and the first class is so in the second only
        return 1 if len(self.sequence) <= self.limits.links else 2

    def _add_columns(self) -> None:
        """Columns by class: (phase + or - mass) modulo phases, and arc of the phase."""
        limits, phases, arcs = self.limits, len(self.sequence), int(self.arcs[0])
        masses, columns = np.arange(limits.links + 1), self.rows.columns
        direction = wave_direction(self.sequence, len(masses))
        classes = (direction * masses + np.arange(phases)[:, None]) % phases  # (phase, mass)
        most = np.full(phases, np.inf)
        for phase, resting in enumerate(self.sequence):
            np.minimum.at(most, classes[phase], limits.fastest(resting))
        self.h = np.tile(columns(np.ones(arcs)), phases)
        at_nodes = np.repeat(most[:, None], arcs, axis=1)
        at_nodes[:, 0] = np.minimum(most, np.roll(most, 1))
        starts = columns(at_nodes)
        ends = np.concatenate([starts[:, 1:], np.roll(starts[:, :1], -1, axis=0)], axis=1)
        inner = [columns(np.repeat(most[:, None], arcs, axis=1)) for _ in range(self.degree - 1)]
        by_class = np.stack([starts, *inner, ends], axis=2)  # (class, arc, coefficient)
        self.v = by_class[classes].transpose(0, 2, 3, 1).reshape(phases * arcs, -1, len(masses))
        strokes = np.full((phases, arcs), limits.strokes.min())
        of_links = columns(strokes)[classes[:, 1:]]
        self.length = of_links.transpose(0, 2, 1).reshape(phases * arcs, -1)
        self._add_peak_column()
