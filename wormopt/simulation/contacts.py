"""Decides in exact treatment which contacts slide and which rest, from velocities and forces."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from wormopt.lazy import on_use
from wormopt.numerics.expressions import Call
from wormopt.numerics.roots import root
from wormopt.simulation.grip import ENTRIES
from wormopt.simulation.initial_value import F_REST, KINDS, InitialValueProblem
from wormopt.simulation.saltation import Columns
from wormopt.simulation.sharing import SHARE_REST, Sharing, Split
from wormopt.simulation.steps import GivenUp

with on_use():  # slow to import, and hardly ever needed
    from scipy.optimize import root as zero

# Share of the force too small to turn a direction.
_SMALL = 1e-13
_SWEEPS = 300
# After this many sweeps all directions are turned at once.
_PATIENCE = 5
# Share of the force to which directions must fit.
_FIT = 1e-10
# Share of the whole time to measure how fast a direction turns.
_GLANCE = 1e-7


class Aim:
    """Directions of onset, the entries of `s` after the modes; 0 for none."""

    def __init__(
        self, task: InitialValueProblem, s: np.ndarray, shared: tuple[tuple[str, np.ndarray], ...]
    ) -> None:
        system = task.system
        self._onsets = s[len(system.contacts) :].reshape(-1, ENTRIES)
        self._directions = self._onsets[:, :2]  # initial directions
        self._glance = _GLANCE * (task.span[1] - task.span[0])
        self._place = {i: k for k, i in enumerate(system.planar.tolist())}
        self._sizes = [system.contacts[i].nominal_force for i in self._place]
        self._toward = np.zeros((0, 2))
        self._joint: set[int] = set()  # of contacts released together, to stay in line
        if self._place:
            self._call, self._rates = Call(system.aims, *shared), Call(system.rhs, *shared)

    def is_set(self, contact: int) -> bool:
        """Whether a contact is in its onset."""
        return contact in self._place and bool(self._directions[self._place[contact]].any())

    def clear(self, contact: int) -> None:
        """End the onset of a contact."""
        if contact in self._place:
            self._onsets[self._place[contact]] = 0.0
            self._joint.discard(self._place[contact])

    def look(self, t: float, x: np.ndarray) -> None:
        """Note the directions of forces on contacts at rest, before modes change."""
        if self._place:
            self._toward = self._call(t, x)[0].reshape(-1, 3)[:, :2].copy()

    def set(self, t: float, x: np.ndarray, contacts: Sequence[int]) -> None:
        """Begin the onset of released contacts."""
        places = [self._place[i] for i in contacts if i in self._place]
        for k in places:
            self._begin(k, t, self._toward[k])
        for k in places:
            self._turn(k, t, x)

    def _begin(self, k: int, t: float, toward: np.ndarray) -> None:
        self._onsets[k] = *(toward / np.linalg.norm(toward)), 0.0, t

    def set_together(
        self, t: float, contacts: Sequence[int], velocities: Sequence[np.ndarray]
    ) -> None:
        """Begin the onset of contacts on one body, whose velocities fit each other already."""
        for i, v in zip(contacts, velocities, strict=True):
            if i in self._place:
                self._begin(self._place[i], t, v)
                self._joint.add(self._place[i])

    def sweep(self, t: float, x: np.ndarray) -> None:
        """Turn directions of onset until they fit each other."""
        # Those that do not converge end with the first step, since their error is large: then the
        # motion turns the velocities itself.
        begun = np.flatnonzero(self._directions.any(axis=1))
        places = [int(k) for k in begun if int(k) not in self._joint]
        for sweep in range(1, _SWEEPS + 1 if places else 0):
            before = self._directions.copy()
            for k in places:
                self._turn(k, t, x)
            if np.abs(self._directions - before).sum() <= _SMALL:
                break
            if sweep % _PATIENCE == 0 and self._turn_together(places, t, x):
                break

    def _turn_together(self, places: list[int], t: float, x: np.ndarray) -> bool:
        """Turn all directions at once, if sweeps take too long; returns whether they fit."""
        before, sizes = self._directions[places], np.array(self._sizes)[places]

        def off(angles: np.ndarray) -> np.ndarray:
            self._directions[places] = np.column_stack([np.cos(angles), np.sin(angles)])
            lacking: np.ndarray = self._call(t, x)[0][2::3][places] / sizes
            return lacking

        first = np.arctan2(before[:, 1], before[:, 0])
        fit = bool(np.abs(off(zero(off, first, tol=_SMALL).x)).max() <= _FIT)
        if not fit:
            self._directions[places] = before
        return fit

    def follow(self, t: float, x: np.ndarray) -> None:
        """Find how fast the directions of contacts in onset turn."""
        begun = self._directions.any(axis=1) & (self._onsets[:, 3] == t) & (self._onsets[:, 2] == 0)
        places = [int(k) for k in np.flatnonzero(begun) if int(k) not in self._joint]
        if not places:
            return
        later, ahead = t + self._glance, x + self._glance * self._rates(t, x)[0]
        for k in places * min(len(places), 2):
            self._onsets[k, 2] = 0.0
            still = float(self._call(later, ahead)[0][3 * k + 2])
            self._onsets[k, 2] = 1.0
            change = float(self._call(later, ahead)[0][3 * k + 2]) - still
            turns = _SMALL * self._sizes[k] < abs(still) < abs(change) / self._glance
            self._onsets[k, 2] = -still / change if turns else 0.0

    def _turn(self, k: int, t: float, x: np.ndarray) -> None:
        """Turn a direction until the force of onset is that of sliding."""
        # A force on the edge of the holding set gives its direction at once; one beyond it does not
        # if resistance is anisotropic.
        first = float(np.arctan2(self._directions[k, 1], self._directions[k, 0]))

        def off(turn: float) -> float:
            angle = first + turn
            self._directions[k] = np.cos(angle), np.sin(angle)
            return float(self._call(t, x)[0][3 * k + 2])

        begin = off(0.0)
        small = _SMALL * self._sizes[k]
        if not abs(begin) > small:
            return
        near, turn = 0.0, -np.sign(begin) * 1e-6
        while (end := off(turn)) * begin > 0 and abs(turn) < 2 * np.pi:
            near, turn = turn, turn + np.clip(turn, -0.5, 0.5)
        if not end * begin <= 0:  # other laws than that of largest dissipation may have none
            off(0.0)
            return
        off(root(off, near, turn))


_REVERSAL, _STICK, _RELEASE, _IMPACT = (
    KINDS.index(kind) for kind in ("reversal", "stick", "release", "impact")
)

# Share of the holding force of a contact at rest; above errors of events.
_HELD = 1e-2
# Look-ahead times, as shares of the span, for contacts that hardly part.
_LATER = (0.0, 1e-7, 1e-5, 1e-3)
# Least determinant, relative to its rows, that determines forces of contacts at rest.
_OPEN = 1e-10


class Change(NamedTuple):
    """Change of a contact's mode."""

    which: int  # contact
    kind: int  # index in KINDS
    mode: int  # from then on


class _Probe(NamedTuple):
    """Values per contact."""

    velocity: np.ndarray
    acceleration: np.ndarray
    force: np.ndarray
    least: np.ndarray
    largest: np.ndarray
    determined: float

    @property
    def toward(self) -> np.ndarray:
        """Direction in which a resting contact would be released."""
        return np.where(self.force - self.least < self.largest - self.force, 1.0, -1.0)

    @property
    def margin(self) -> np.ndarray:
        return np.minimum(self.force - self.least, self.largest - self.force)


class Contacts:
    """Modes of the contacts that may rest.

    `modes` (+1, -1, 0, then directions of onset) are rewritten here only.
    """

    def __init__(
        self,
        task: InitialValueProblem,
        p: np.ndarray,
        modes: np.ndarray,
        sharing: Sharing | None,
        columns: Columns,
    ) -> None:
        system, shared = task.system, (("p", p), ("s", modes))
        self._sharing, self._columns = sharing, columns
        self._n, self._span = len(system.contacts), task.span[1] - task.span[0]
        self._s, self._modes, self._coupled = modes, modes[: self._n], system.coupled
        self._v_rest, self._v_stop, self._f_rest = task.v_rest, task.v_stop, task.f_rest
        self._held_by = task.f_rest / F_REST
        self._least_onset, self._drift = task.reach[1], task.v_drift
        self._states, self._rows, self._sliding = (
            system.row_state,
            system.row_contact,
            system.sliding,
        )
        planar = set(system.planar.tolist())
        self._in_plane = np.isin(np.arange(self._n), system.planar)
        laws = enumerate(contact.law for contact in system.contacts)
        self._directions = [(1,) if i in planar else law.directions for i, law in laws]
        self._prescribed, self._geared = frozenset(system.prescribed), frozenset(system.geared)
        self._held = np.array([not directions for directions in self._directions], dtype=bool)
        self._released = dict[int, float]()  # time of the last release by an event
        self._probe, self._project = Call(system.probe, *shared), Call(system.project, *shared)
        self._aim = Aim(task, modes, shared)

    def _look(self, t: float, x: np.ndarray) -> _Probe:
        (found,) = self._probe(t, x)
        return _Probe(*found[:-1].copy().reshape(5, self._n), determined=float(found[-1]))

    def decide(
        self, t: float, x: np.ndarray, forced: int | None, at_start: bool
    ) -> tuple[np.ndarray, list[Change], list[int]]:
        """Decide which contacts rest, from velocities and then from forces.

        `forced`: contact of an event; a moving one rests from now on, a resting one is released.
        Returns the state after impulses, changes, and contacts at velocity 0.
        """
        before, probe = self._modes.copy(), self._look(t, x)
        if forced is not None and (self._has_begun(forced, probe) or self._is_held(forced, probe)):
            forced = None
        # velocities above which a stop needs an impulse
        jump_from = np.where(before == 0, self._drift, np.maximum(1e3 * self._v_rest, self._v_stop))
        struck = self._held & (np.abs(probe.velocity) > jump_from)
        if struck.any():
            x = self._hold(t, x)
            probe = self._look(t, x)
        self._by_velocity(t, probe, forced)
        rests = (self._modes == 0) & (np.arange(self._n) != forced)
        suspects = self._columns.suspects(t, x, rests & (before != 0))
        hit = rests & (np.abs(probe.velocity) > jump_from)
        if hit.any():
            if self._coupled:  # velocities alone do not determine the impulses
                raise GivenUp("no_contact_mode")
            self._columns.carry("project_along", t, x)
        gone = forced if forced is not None and before[forced] == 0 else None
        passing = self._part(t, x, gone, probe)
        passing += self._slide_through(t, x, np.flatnonzero((self._modes == 0) & ~hit).tolist())
        x = self._stopped(t, x)
        if self._sharing:
            self._take_along(t, x)
            x = self._stopped(t, x)
        stopped = [*np.flatnonzero(self._modes == 0).tolist(), *passing]
        forced_mode = None if forced is None else float(before[forced])
        if forced is not None and forced_mode == 0:
            self._released |= dict.fromkeys(self._release(t, x, [forced], probe), t)
        probe = self._settle(t, x)
        if self._columns.k:
            self._note_doubts(t, x, probe, suspects, forced_mode, at_start)
        self._columns.carry_rest(t, x)
        self._aim.follow(t, x)
        return x, self._changes(before, forced, struck | hit), stopped

    def _settle(self, t: float, x: np.ndarray) -> _Probe:
        """Alternate releases and stops until neither is needed."""
        for _ in range(9 + 8 * self._n):
            if self._coupled:
                self._aim.sweep(t, x)
            probe = self._look(t, x)
            if not (self._sharing or probe.determined > _OPEN):  # forces are undetermined
                break
            if not (self._let_go(t, x, probe) or (self._coupled and self._catch_again(t, probe))):
                return probe
        raise GivenUp("no_contact_mode")

    def _note_doubts(
        self,
        t: float,
        x: np.ndarray,
        probe: _Probe,
        suspects: np.ndarray,
        forced_mode: float | None,
        at_start: bool,
    ) -> None:
        """Doubt derivatives if a small change would have changed the decision."""
        doubts, shares = self._columns.doubts, probe.margin / self._held_by
        doubts.decision(t, self._modes, shares, suspects, forced_mode, at_start=at_start)
        for i in np.flatnonzero(suspects & (self._modes == 0)).tolist() if at_start else []:
            if self._slides_on(t, x, i, float(probe.toward[i])):
                doubts.slides_on(t, i)

    def _slides_on(self, t: float, x: np.ndarray, i: int, toward: float) -> bool:
        """Whether a resting contact would slide on if it moved in the direction of its force."""
        self._modes[i] = toward
        goes = np.sign(self._look(t, x).acceleration[i])
        self._modes[i] = 0.0
        return bool(goes == toward)

    def _has_begun(self, i: int, probe: _Probe) -> bool:
        """End a contact's onset if it is fast enough to define its own direction."""
        ends = self._aim.is_set(i) and probe.velocity[i] > self._least_onset[i] / 2
        if ends:
            self._aim.clear(i)
        return ends

    def _is_held(self, i: int, probe: _Probe) -> bool:
        """Whether a resting contact that is to be released holds after all."""
        # If others slip so slowly that their forces turn at once, its own may have been out of
        # bounds only in between.
        if self._modes[i] != 0 or not self._coupled or not probe.determined > _OPEN:
            return False
        return bool(probe.margin[i] > _HELD * self._held_by[i])

    def _hold(self, t: float, x: np.ndarray) -> np.ndarray:
        """Stop resting contacts by impulses on these contacts only."""
        before = self._s.copy()
        self._s[:] = self._sliding
        self._modes[self._held] = 0.0
        self._columns.carry("project_along", t, x)
        x = self._stopped(t, x)
        self._s[:] = before
        return x

    def _changes(self, before: np.ndarray, forced: int | None, struck: np.ndarray) -> list[Change]:
        found = []
        for i, (was, now) in enumerate(zip(before.tolist(), self._modes.tolist(), strict=True)):
            if was == now and i != forced and not struck[i]:
                continue
            kind = _RELEASE if was == 0 else _STICK if now == 0 else _REVERSAL
            found.append(Change(i, _IMPACT if struck[i] else kind, int(now)))
        return found

    def _by_velocity(self, t: float, probe: _Probe, forced: int | None) -> None:
        """Set modes by velocity alone; at 0 acceleration decides for prescribed velocities."""
        for i, v in enumerate(probe.velocity):
            if i in self._prescribed:
                ahead = -self._modes[i] if i == forced else probe.acceleration[i]
                ahead = v if i != forced and abs(v) > self._v_stop[i] else ahead
                self._modes[i] = np.sign(ahead) or self._modes[i]
                self._check_directions([i])
                continue
            begins = self._aim.is_set(i)
            if begins and i != forced:
                continue
            self._aim.clear(i)
            slow = self._drift[i] if self._modes[i] == 0 else self._v_stop[i]
            if i != forced and abs(v) > slow:
                self._modes[i] = np.sign(v) if np.sign(v) in self._directions[i] else 0.0
            elif self._released.get(i) != t:  # unless released at this instant
                self._modes[i] = 0.0

    def _part(self, t: float, x: np.ndarray, gone: int | None, before: _Probe) -> list[int]:
        """Let contacts slide that cannot rest together, such as on the ground and on a belt."""
        # They share a degree of freedom and their velocities are 0 at once, but differ later. All
        # slide forward at first; then the one that moves most against its mode is stopped, and
        # released the other way if its force does not hold it: the acceleration rises to its value.
        # `gone` was released by an event, in a direction of `before`.
        if self._sharing or not self._coupled or self._look(t, x).determined > _OPEN:
            return []
        among = [i for i in np.flatnonzero(self._modes == 0).tolist() if self._directions[i]]
        if not any(self._parts(t + later * self._span, x, among, gone, before) for later in _LATER):
            raise GivenUp("no_contact_mode")
        return [i for i in among if self._modes[i] != 0]

    def _parts(
        self, t: float, x: np.ndarray, among: list[int], gone: int | None, before: _Probe
    ) -> bool:
        """Find how contacts part; False if undetermined."""
        for i in among:
            self._modes[i] = before.toward[i] if i == gone else self._directions[i][0]
        for _ in range(2 * len(among) + 1):
            probe = self._look(t, x)
            if not probe.determined > _OPEN:
                break
            held = [i for i in among if self._modes[i] == 0 and probe.margin[i] < -self._f_rest[i]]
            for i in held:
                self._modes[i] = probe.toward[i]
            if held:
                self._check_directions(held)
                continue
            ahead = np.sign(self._modes) * probe.acceleration / self._drift
            rounding = 1e-9 * np.abs(probe.acceleration / self._drift).max()
            sliding = [i for i in among if self._modes[i] != 0 and i != gone]
            worst = min(sliding, key=ahead.__getitem__, default=gone)
            if worst is None or worst == gone or ahead[worst] > rounding:
                return True
            if ahead[worst] > -rounding:  # the contact hardly parts from the others
                break
            self._modes[worst] = 0.0
        return False

    def _slide_through(self, t: float, x: np.ndarray, slow: list[int]) -> list[int]:
        """Release, before any stop, geared contacts that their force cannot hold."""
        # Stopping them without an acting force would stop everything that moves.
        passing = list[int]()
        for i in slow:
            if i in self._geared:
                probe = self._look(t, x)
                if -probe.margin[i] > self._f_rest[i]:
                    self._modes[i] = probe.toward[i]
                    passing.append(i)
        self._check_directions(passing)
        return passing

    def _take_along(self, t: float, x: np.ndarray) -> None:
        """Let planar contacts rest that others have stopped: their slip direction is undefined."""
        slow = self._in_plane & (np.abs(self._look(t, x).velocity) <= self._v_stop)
        for i in np.flatnonzero(slow & (self._modes != 0)).tolist():
            if not self._aim.is_set(i):
                self._modes[i] = 0.0

    def _stopped(self, t: float, x: np.ndarray) -> np.ndarray:
        (found,) = self._project(t, x)
        x = found.copy()
        x[self._states[(self._modes[self._rows] == 0) & (self._states >= 0)]] = 0.0
        return x

    def _splits(self, t: float, x: np.ndarray) -> list[Split]:
        return self._sharing.look(t, x) if self._sharing else []

    def _release(self, t: float, x: np.ndarray, gone: list[int], probe: _Probe) -> list[int]:
        """Release contacts and those that share a load with them; returns all that move."""
        splits = self._splits(t, x)
        shared = {int(i) for split in splits for i in split.contacts}
        alone, all_ = [i for i in gone if i not in shared], list[int]()
        self._aim.look(t, x)
        for split in splits:
            if not set(gone) & {*split.contacts.tolist()}:
                continue
            assert self._sharing is not None
            slip = self._sharing.slip(t, x, split)
            for i, v in zip(slip.contacts, slip.velocities, strict=True):
                self._modes[i] = 1.0 if len(v) == 2 else np.sign(*v)
            self._aim.set_together(t, slip.contacts, slip.velocities)
            all_ += slip.contacts
        for i in alone:
            self._modes[i] = probe.toward[i]
        self._check_directions(alone + all_)
        self._aim.set(t, x, alone)
        return alone + all_

    def _check_directions(self, gone: list[int]) -> None:
        if any(self._modes[i] not in self._directions[i] for i in gone):
            raise GivenUp("no_contact_mode")

    def _let_go(self, t: float, x: np.ndarray, probe: _Probe) -> bool:
        """Release contacts that do not hold, the worst one first if contacts act on each other."""
        outside = -probe.margin / self._f_rest
        for split in self._splits(t, x):
            outside[split.contacts] = (split.share - 1) / SHARE_REST
        gone = np.flatnonzero((self._modes == 0) & (outside > 1)).tolist()
        if not gone:
            return False
        if self._coupled:
            gone = [max(gone, key=outside.tolist().__getitem__)]
        if self._columns.k:
            for i in gone:
                lacking = float(-probe.margin[i] / self._held_by[i])
                self._columns.doubts.let_go(t, i, float(probe.toward[i]), lacking)
        self._release(t, x, gone, probe)
        return True

    def _catch_again(self, t: float, probe: _Probe) -> bool:
        """Stop again a released contact that would move against its mode by more than rounding."""
        acceleration = probe.acceleration / self._drift  # drift is proportional to nominal speed
        rounding = 1e-9 * np.abs(acceleration).max()
        for i, mode in enumerate(self._modes):
            moves = abs(probe.velocity[i]) > self._v_stop[i]
            if moves or mode == 0 or i in self._prescribed or self._released.get(i) == t:
                continue
            if mode * acceleration[i] < -rounding:
                self._modes[i] = 0.0
                self._aim.clear(i)
                return True
        return False
