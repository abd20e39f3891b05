"""Samples of the posterior distribution of unknowns, given readings and priors.

Draws by the No-U-Turn sampler of nutpie, with gradients from the Jacobian of the residuals, in
coordinates without bounds in which the fit's covariance is about 1.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from functools import cached_property
from importlib import import_module
from typing import Any

import numpy as np
from scipy.special import expit, log_expit, logit

from wormopt.errors import ArgumentError, Interrupted, SolveError, UnknownNameError
from wormopt.fitting.estimate import Fit, check_fit
from wormopt.fitting.information import DETERMINED, spectrum
from wormopt.fitting.noise import rows_estimated
from wormopt.fitting.task import FitTask, robust
from wormopt.progress import Report, silent
from wormopt.shown import SHORT, lines, text

_INSIDE = 1e-3  # share of the interval by which a point at a bound is moved inside


@dataclass(frozen=True, eq=False)
class Unbounded:
    """theta (n,) as a function of u (n,): logistic between two bounds, exponential from one."""

    lower: np.ndarray
    upper: np.ndarray
    nominal: np.ndarray

    def theta(self, u: np.ndarray) -> np.ndarray:
        """Coordinates within bounds."""
        grown = self.nominal * np.exp(u)
        return self._choose(u, self.lower + grown, self.upper - grown, self._between(expit(u)))

    def slopes(self, u: np.ndarray) -> np.ndarray:
        """d(theta) / d(u)."""
        grown = self.nominal * np.exp(u)
        return self._choose(np.ones_like(u), grown, -grown, self._room * expit(u) * expit(-u))

    def log_slopes(self, u: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Logarithms of the slopes' sizes up to constants, with first and second derivatives."""
        one, none = np.ones_like(u), np.zeros_like(u)
        return (
            self._choose(none, u, u, log_expit(u) + log_expit(-u)),
            self._choose(none, one, one, expit(-u) - expit(u)),
            self._choose(none, none, none, -2 * expit(u) * expit(-u)),
        )

    def u(self, theta: np.ndarray) -> np.ndarray:
        """Numbers without bounds; coordinates at a bound are moved a little inside."""
        below = np.maximum(theta - self.lower, _INSIDE * np.minimum(self.nominal, self._room))
        above = np.maximum(self.upper - theta, _INSIDE * np.minimum(self.nominal, self._room))
        share = np.clip((theta - self._from) / self._room, _INSIDE, 1 - _INSIDE)
        grown = np.log(below / self.nominal), np.log(above / self.nominal)
        return self._choose(theta, *grown, logit(share))

    @cached_property
    def _kind(self) -> np.ndarray:
        return np.isfinite(self.lower) + 2 * np.isfinite(self.upper)

    @cached_property
    def _room(self) -> np.ndarray:
        return np.where(self._kind == 3, self.upper - self._from, 1.0)

    @cached_property
    def _from(self) -> np.ndarray:
        return np.where(self._kind == 3, self.lower, 0.0)

    def _between(self, share: np.ndarray) -> np.ndarray:
        return self._from + self._room * share

    def _choose(self, *forms: np.ndarray) -> np.ndarray:
        return np.choose(self._kind, forms)


# Limits of A. Vehtari et al., Bayesian Analysis 16 (2021) 667, for the rank-normalised R-hat and
# the effective number of draws.
R_HAT, FEWEST = 1.01, 400
_LOOK = 0.05  # seconds between checks of the sampler


@dataclass(frozen=True, eq=False)
class Posterior:
    """Draws of the unknowns, and whether they are reliable."""

    names: tuple[str, ...]  # of the unknowns, then of estimated noise: "noise of position"
    draws: np.ndarray  # (chains, m, n) numbers drawn
    divergences: int  # steps of the sampler that went astray: the probability is rough there
    r_hat: np.ndarray  # (n,) rank-normalised R-hat of the draws, 1 where chains agree
    # (n,) number of independent draws they are worth, in the bulk or the tails, whichever is less
    effective: np.ndarray

    def __repr__(self) -> str:
        count = int(np.prod(self.draws.shape[:2]))
        summary = f"Posterior: {count} draws" + ("" if self.doubts else ", reliable")
        lows, highs = self.interval(0.95).T
        found = ", ".join(
            f"{name} {text(float(low), SHORT)} to {text(float(high), SHORT)}"
            for name, low, high in zip(self.names, lows, highs, strict=True)
        )
        return lines(summary, *self.doubts, found)

    def __getitem__(self, name: str) -> np.ndarray:
        """Draws (chains, m) of an unknown; UnknownNameError if there is none."""
        if name not in self.names:
            raise UnknownNameError("the posterior", "unknown", [name], self.names)
        return self.draws[:, :, self.names.index(name)]

    def interval(self, level: float = 0.95) -> np.ndarray:
        """Interval of each unknown that holds this share of the draws, with as many on each side.

        Parameters
        ----------
        level : float, optional
            The share.

        Returns
        -------
        ndarray, shape (n, 2)
        """
        ends = (0.5 - level / 2, 0.5 + level / 2)
        return np.quantile(self.draws.reshape(-1, len(self.names)), ends, axis=0).T

    @property
    def doubts(self) -> tuple[str, ...]:
        """Reasons why the draws are unreliable; empty if they are reliable."""
        doubts = []
        if self.divergences:
            doubts.append(
                f"{self.divergences} draws diverged: the probability has kinks or corners there"
            )
        apart = [n for n, r in zip(self.names, self.r_hat, strict=True) if not r <= R_HAT]
        if apart:
            doubts.append(f"chains differ in {', '.join(apart)}; draw more, or fit fewer unknowns")
        few = [n for n, e in zip(self.names, self.effective, strict=True) if not e >= FEWEST]
        if few:
            doubts.append(f"draws of {', '.join(few)} depend on each other; draw more")
        return tuple(doubts)


def posterior(
    found: Fit,
    *,
    draws: int = 500,
    tune: int = 300,
    chains: int = 4,
    seed: int = 0,
    report: Report = silent,
) -> Posterior:
    """Draw samples from the posterior distribution of the unknowns of a fit.

    The probability is that of normal noise, or of noise according to the loss, times the priors.
    Without a prior all values of a coordinate between its bounds are equally probable (of the
    logarithm with ``log``), and so are all logarithms of noise that is to be estimated.

    Parameters
    ----------
    found : Fit
        Fit, near which the chains start.
    draws, tune : int, optional
        Numbers of kept draws and of adaptation draws, per chain.
    chains : int, optional
        Number of chains, at least two; they are compared.
    seed : int, optional
        Seed of the random numbers.
    report : callable, optional
        Receives the share that is done.

    Returns
    -------
    Posterior
        Draws, with convergence problems listed in `doubts`.

    Raises
    ------
    ArgumentError
        If nutpie is not installed, a number is too small, or an unknown without bounds has no
        effect on the readings, so the posterior does not exist.
    SolveError
        If the sampler finds no valid start.
    Interrupted
        If the user stopped it; `partial` is the posterior of the draws made so far, None before
        there are any.

    Notes
    -----
    M. Hoffman and A. Gelman, Journal of Machine Learning Research 15 (2014) 1593; nutpie.

    Examples
    --------
    >>> import casadi as ca
    >>> import wormopt as wo
    >>> x, rate = ca.SX.sym("x"), ca.SX.sym("rate")
    >>> decay = wo.Model("decay", [wo.Signal("x", x, value=1.0)], -rate * x,
    ...                  p=[wo.Signal("rate", rate, value=1.0)])
    >>> run = wo.Recording([0.0, 1.0], {"x": [1.0, 0.4]}, noise={"x": 0.02})
    >>> found = wo.fit(wo.FitTask(decay, [run], [wo.Unknown("rate")]), seeds=1)
    >>> drawn = posterior(found)  # doctest: +SKIP
    >>> drawn.interval(0.95).round(2)  # doctest: +SKIP
    array([[0.82, 1.02]])
    """
    check_fit(found)
    for name, given, least in (("draws", draws, 4), ("tune", tune, 50), ("chains", chains, 2)):
        if not (isinstance(given, int) and given >= least):
            raise ArgumentError(f"{name} must be a whole number, {least} or more, not {given!r}")
    nutpie, arviz = _libraries()
    density = Density(found)
    done = [0]

    def expander(*_: int) -> Callable[..., dict[str, np.ndarray]]:
        def expand(y: np.ndarray) -> dict[str, np.ndarray]:
            done[0] += 1
            return {"numbers": density.numbers(y)}

        return expand

    n = len(density.names)
    model = nutpie.compiled_pyfunc.from_pyfunc(
        n,
        lambda: density.log,
        expander,
        [np.dtype("float64")],
        [(n,)],
        ["numbers"],
        make_initial_point_fn=lambda s: np.random.default_rng(s).standard_normal(n),
    )
    how: dict[str, Any] = {"draws": draws, "tune": tune, "chains": chains, "seed": seed}
    sampler = nutpie.sample(model, **how, progress_bar=False, blocking=False)
    try:
        trace = None
        while trace is None:
            report("drawing", min(done[0] / (chains * (draws + tune)), 1.0))
            with suppress(TimeoutError):
                trace = sampler.wait(timeout=_LOOK)
    except KeyboardInterrupt:
        raise Interrupted(_made(density, arviz, sampler.abort())) from None
    except RuntimeError as error:
        raise SolveError(
            "the sampler found no valid start", "narrow the bounds, or check the fit"
        ) from error
    made = _made(density, arviz, trace)
    assert made is not None
    return made


def _libraries() -> tuple[Any, Any]:
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", FutureWarning)  # of arviz, once a day
            arviz = import_module("arviz")
            nutpie = import_module("nutpie")
            import_module("nutpie.compiled_pyfunc")
    except ImportError as error:
        what = "posterior: the package nutpie is not installed"
        raise ArgumentError(f"{what}; pip install 'wormopt[bayes]'") from error
    return nutpie, arviz


def _made(density: Density, arviz: Any, trace: Any) -> Posterior | None:
    numbers = np.asarray(trace.posterior["numbers"].values)
    if numbers.shape[1] < 4:  # draws, below which there is no R-hat
        return None
    return Posterior(
        density.names,
        numbers,
        int(trace.sample_stats["diverging"].sum()),
        np.atleast_1d(arviz.rhat({"numbers": numbers})["numbers"].values),
        np.minimum(
            *(
                np.atleast_1d(arviz.ess({"numbers": numbers}, method=how)["numbers"].values)
                for how in ("bulk", "tail")
            )
        ),
    )


class Lost(Exception):
    """A motion that cannot be simulated, as nutpie's error for a divergent draw."""

    is_recoverable = True


@dataclass(frozen=True, eq=False)
class Density:
    """Logarithm of the probability, in variables of about normal distribution."""

    found: Fit

    @property
    def task(self) -> FitTask:
        """The fitted task."""
        return self.found.task

    @property
    def names(self) -> tuple[str, ...]:
        """Unknowns, then estimated noise."""
        return (*self.found.names, *(f"noise of {signal}" for signal in self.found.estimated))

    def numbers(self, y: np.ndarray) -> np.ndarray:
        """Draws (n,) in own units: unknowns, then standard deviations."""
        u, scales = self._parts(y)
        noise = [self.task.level(signal) for signal in self.found.estimated]
        return np.concatenate([self.task.values(self._free.theta(u)), np.exp(scales) * noise])

    def log(self, y: np.ndarray) -> tuple[float, np.ndarray]:
        """Logarithm of the probability up to a constant, and its gradient (n,)."""
        u, scales = self._parts(y)
        count, slopes = self.task.count, self._free.slopes(u)
        try:
            plain, jacobian = self.task.plain(self._free.theta(u))
        except (SolveError, ArgumentError) as error:
            raise Lost(str(error)) from error
        over = self._rows @ scales
        plain = plain * np.exp(-over)
        r, steep = robust(plain[:count], self.task.loss)
        pulled = np.append(r * steep, plain[count:])
        log_slopes, bends, _ = self._free.log_slopes(u)
        by_u = bends - slopes * (jacobian.T @ (pulled * np.exp(-over)))
        by_scale = self._rows.T @ (pulled * plain - 1)
        squares = r @ r + plain[count:] @ plain[count:]
        value = -0.5 * squares - np.sum(over) + np.sum(log_slopes)
        return float(value), self._wide.T @ np.append(by_u, by_scale)

    def _parts(self, y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Unknowns without bounds, and logarithms of noise over that of the fit."""
        moved = self._wide @ y
        n = len(self.found.theta)
        return self._middle + moved[:n], moved[n:]

    @cached_property
    def _free(self) -> Unbounded:
        return Unbounded(*self.task.bounds, self.task.nominal)

    @cached_property
    def _middle(self) -> np.ndarray:
        return self._free.u(self.found.theta)

    @cached_property
    def _rows(self) -> np.ndarray:
        """Rows (rows, l) of each estimated noise."""
        found = np.zeros((len(self.found.residuals), len(self.found.estimated)))
        for k, signal in enumerate(self.found.estimated):
            found[rows_estimated(self.task, signal), k] = 1.0
        return found

    @cached_property
    def _wide(self) -> np.ndarray:
        """Factor (n, n) of the covariance about the fit."""
        columns = self.found.jacobian * self._free.slopes(self._middle)
        of_bounds = np.diag(np.sqrt(-self._free.log_slopes(self._middle)[2]))
        s, turned = spectrum(np.vstack([columns, of_bounds]), np.ones(len(self._middle)))
        if (s <= DETERMINED * s.max()).any():
            shares = zip(self.task.names, turned[:, -1], strict=True)
            names = [name for name, share in shares if abs(share) > 0.1]
            raise ArgumentError(
                f"the readings do not determine {', '.join(names)}; write bounds on both sides, or "
                "a prior"
            )
        whole = np.diag(np.append(1 / s, 1 / np.sqrt(2 * self._rows.sum(axis=0))))
        whole[: len(s)] = turned @ whole[: len(s)]
        return whole
