"""Closed loops integrated by SciPy's DOP853, stretch by stretch between breaks and events."""

from collections.abc import Callable, Sequence

import casadi as ca
import numpy as np
from scipy.integrate import solve_ivp

from wormopt.model.model import Model, pack
from wormopt.model.schedule import Schedule


def piece_at(schedule: Schedule, t: float) -> tuple[int, float]:
    """Piece of a schedule at a time inside it, and when the piece began."""
    since, period = t - schedule.start, schedule.breaks[-1]
    turn = period * np.floor(since / period) if schedule.periodic else 0.0
    piece = int(np.searchsorted(schedule.breaks, since - turn, side="right")) - 1
    piece = min(max(piece, 0), schedule.pieces - 1)
    return piece, schedule.start + turn + schedule.breaks[piece]


def breaks_in(schedule: Schedule, until: float) -> list[float]:
    period = schedule.breaks[-1]
    turns = range(-1, int((until - schedule.start) / period) + 1) if schedule.periodic else [0]
    times = [schedule.start + k * period + b for k in turns for b in schedule.breaks[:-1]]
    return [t for t in times if 1e-12 < t < until - 1e-12]


class Compiled:
    """An expression of a model as a fast function of (t, x); v_reg smooths the contacts."""

    def __init__(self, model: Model, expression: ca.SX, v_reg: float) -> None:
        smooth = [c.law.smooth(c.velocity, v_reg) for c in model.contacts]
        expression = ca.substitute(ca.densify(expression), model.forces, ca.vertcat(*smooth))
        scheduled = [s for item in model.schedules for s in (item.symbol, item.begin)]
        given_at = ca.vertcat(model.t, pack(model.x), *scheduled)
        function = ca.Function("f", [given_at, pack(model.p)], [expression])
        numbers = [np.broadcast_to(np.array(p.value, float), p.size) for p in model.p]
        self.given = np.zeros(given_at.numel())
        self.numbers = np.concatenate([np.zeros(0), *numbers])
        self.result = np.zeros(expression.numel())
        self.n_x = model.n_x
        self.buffer, self.run = function.buffer()
        ends = (self.buffer.set_arg, 0, self.given), (self.buffer.set_arg, 1, self.numbers)
        for connect, k, array in (*ends, (self.buffer.set_res, 0, self.result)):
            connect(k, array.data)  # pyright: ignore[reportCallIssue]

    def __call__(self, t: float, x: np.ndarray) -> np.ndarray:
        self.given[0], self.given[1 : 1 + self.n_x] = t, x
        self.run()
        return self.result.copy()

    def set_pieces(self, schedules: Sequence[Schedule], t: float) -> None:
        found = [(s, *piece_at(s, t)) for s in schedules]
        parts = [np.append(s.values[piece], begin) for s, piece, begin in found]
        self.given[1 + self.n_x :] = np.concatenate([np.zeros(0), *parts])


class Run:
    """Motion of a closed loop: states at the ends of all stretches, events, outputs on demand."""

    def __init__(self, model: Model, until: float, v_reg: float = 1 / 40, rtol: float = 1e-12):
        self.model, self.v_reg = model, v_reg
        x = np.concatenate([np.broadcast_to(np.array(s.value, float), s.size) for s in model.x])
        ode = Compiled(model, model.ode, v_reg)
        guards = Compiled(model, ca.vertcat(ca.SX(0, 1), *(s.guard for s in model.switches)), v_reg)
        resets = [Compiled(model, s.reset, v_reg) for s in model.switches]
        self.events: list[tuple[str, float]] = []
        self.times, self.states = [0.0], [x]
        ends = sorted({until, *(b for s in model.schedules for b in breaks_in(s, until))})
        fired = dict.fromkeys(range(len(resets)), -1.0)
        t = 0.0
        for end in ends:
            for function in (ode, guards, *resets):
                function.set_pieces(model.schedules, (t + end) / 2)
            while end - t > 1e-13:
                watch = [self._event(guards, k, fired[k]) for k in range(len(resets))]
                part = solve_ivp(
                    ode, (t, end), x, "DOP853", rtol=rtol, atol=1e-13, events=watch or None
                )
                assert part.status >= 0, part.message
                t, x = part.t[-1], part.y[:, -1]
                if part.status == 1:
                    k = next(k for k, found in enumerate(part.t_events) if len(found))
                    fired[k] = t
                    self.events.append((model.switches[k].name, t))
                    x = resets[k](t, x)
                self.times.append(t)
                self.states.append(x)

    @staticmethod
    def _event(guards: Compiled, k: int, fired: float) -> Callable[[float, np.ndarray], float]:
        def guard(t: float, x: np.ndarray) -> float:
            return 1.0 if t < fired + 1e-9 else guards(t, x)[k]

        guard.terminal, guard.direction = True, 1.0  # type: ignore[attr-defined]
        return guard

    @property
    def end(self) -> np.ndarray:
        return self.states[-1]

    def __getitem__(self, name: str) -> np.ndarray:
        """Values of a state or an output at the ends of all stretches, (stretches + 1, size)."""
        names = [s.name for s in self.model.x]
        if name in names:
            k, sizes = names.index(name), np.cumsum([0] + [s.size for s in self.model.x])
            return np.array(self.states)[:, sizes[k] : sizes[k + 1]]
        function = Compiled(self.model, self.model[name], self.v_reg)
        rows = []
        for t, x in zip(self.times, self.states, strict=True):
            function.set_pieces(self.model.schedules, t)
            rows.append(function(t, x))
        return np.array(rows)
