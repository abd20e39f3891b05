"""Kind "gait-design": the optimal gait within limits, with a bound on every gait."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Mapping, Sequence
from functools import cached_property
from time import perf_counter
from typing import Any, ClassVar

from wormopt.errors import Fault, SolveError
from wormopt.model.given import per
from wormopt.quantities import Scalar, Variable, unit_of, unit_ratio
from wormopt.result import Check, Result
from wormopt.study import (
    array,
    arrays,
    attributes,
    checks,
    entry,
    facts,
    on_use,
    scalars,
    stage,
    warnings,
)
from wormopt.systems.shared.declared import GAIT
from wormopt.systems.shared.gravity import weights
from wormopt.systems.spiked.gait_problem import DesignTable, Objective, Worm
from wormopt.systems.spiked.motion import DESIGN_SCALARS, MOTION_VARIABLES

with on_use():
    import numpy as np

    from wormopt.systems.spiked.certify.bound import Bounded, bounded, gap_of
    from wormopt.systems.spiked.certify.certificate import Verification, verify
    from wormopt.systems.spiked.design.design import Design
    from wormopt.systems.spiked.design.optimize import designed
    from wormopt.systems.spiked.design.sensitivity import Sensitivity, scaling_error, sensitivities
    from wormopt.systems.spiked.design_results import DesignReport, of_design, with_keys

# Rounding of a gait's own value, relative, in its comparison with a bound.
_PROOF_ROUNDING = 1e-12
# Sensitivities of larger programs take seconds; they are computed only if the picture is wanted.
_MOST_UNKNOWNS = 3000

_PROOF_SCALARS = {
    "bound": (
        "speed",
        "for a speed, or with `[search.certify]`: proven bound for gaits with any phases and "
        "cycles: no gait is faster, or cheaper. It is never above the ceiling. Before anything "
        "better is proven it equals the ceiling, or 0 for a cost",
    ),
    "gap_certified": (
        "share",
        "with `bound`: largest possible improvement by any gait, as a share of `objective`",
    ),
    "certified_seconds": ("s", "with `[search.certify]`: time spent on the proof"),
}
_PROOF_VARIABLES: dict[str, tuple[str, tuple[str, ...], str]] = {
    "proof_time": ("s", ("proof",), "time spent on the proof"),
    "proof_bound": ("speed", ("proof",), "proven bound"),
    "proof_value": ("speed", ("proof",), "objective of the gait"),
}


class GaitDesign(DesignTable, kind="gait-design"):
    """Design the fastest gait within limits on links, spikes and actuators.

    Kind [`gait`](gait.md) explains the scalars and variables. Signals and the saved gait cover one
    cycle, `period` long. `objective`, `bound`, `discretisation_error`, `proof_bound` and
    `proof_value` have the quantity of the objective. The attribute `limits` holds the lists `name`,
    `value`, `unit` and `one_sided` in the order of `limit_elasticity`, and `objective`.
    `limit_elasticity` is the relative sensitivity of the objective to each limit (0 for a limit
    of 0).

    **Sensitivities.** The scalars `sensitivity.KEY` give the change of the objective per unit of
    each number in `[gait]`, `[worm]` and `objective.speed`. They show which limits bind the gait:
    `sensitivity.period`, `.length.shortest`, `.length.longest`, `.rate` (or `.rate.contraction`,
    `.rate.extension`), `.acceleration`, `.spike_load`, `.actuator_force`, `.sigma_margin`, `.speed`
    (the required speed), `.mass`, `.drag`, `.load`, for each number that the scene gives. A range
    has `.shortest` and `.longest`; a range of loads has `.smallest` and `.largest`. A key with one
    number per link or mass has a list. The sensitivity of a limit that does not bind is 0. On a
    slope, `.load` refers to the whole load, weight included, and `.slope` to the load that the
    slope makes; `.mass` keeps the load constant.

    - It is the derivative of the optimal objective for this resting sequence and number of cycles.
      If another sequence becomes better, the gain is larger than the derivative, never smaller.
    - It refers to the direction in which the objective improves; for limits, this is relaxation. A
      limit of 0 can only be raised: `sensitivity.sigma_margin` is then the cost of a small margin.
    - If raising and lowering a limit differ by more than 1 %, another limit becomes active at this
      point. The trust report lists these limits under `sensitivity.one_sided`. If several limits
      bind together and relaxing any single one does not help, the sensitivity of each is 0.
      Programs with more than 400 unknowns are not solved again to distinguish this case from a
      family of equally good gaits. There the limit of one link or mass among many may be worth more
      than reported, and `scaling_error` is not small.
    - With `[motor]`, `rate` and `acceleration` are the effective limits, one per link, from the
      scene or the motor.
    - `sensitivity.scaling_error` in the trust report is the error of a known identity: a change of
      the units of mass, length and time does not change the gait, so certain sums of relative
      sensitivities are known. It is near 0 unless sensitivities differ between the directions.
    - With `gait.tick` they are the sensitivities of the optimal gait without `gait.tick`, because
      with whole ticks the optimal objective moves in jumps.
    - They are unknown for `energy_per_distance`, for `acceleration_effort` and for an interrupted
      design. Unless `want` contains `limits`, they are also unknown for programs with more than
      3000 unknowns. The trust report gives the reason.

    **The trust report** contains, besides `violations`, the balances and the second route
    ([quick start](../quickstart.md#3-the-trust-report)):

    | key | meaning |
    | --- | --- |
    | `solver.status` | `sharpened`: arcs were halved until this gained nothing, then the solution was refined to rounding; `cut short` after a time limit or Ctrl-C; the status of IPOPT for a smooth cost |
    | `solver.violation` | largest violation of any row of the last program, in the units of the row |
    | `solver.arcs_per_phase`, `solver.degree` | arcs of the gait in each phase of `solver.sequence`; degree of the lengths on an arc |
    | `solver.sequence`, `solver.durations`, `solver.cycles` | prescribed resting sequence, without phases that shrank to nothing; duration of each phase; cycles in a period |
    | `search.ended` | `searched`; `proven`, if no gait can be better by more than `search.gap`; `time limit` or `interrupted` |
    | `search.tried`, `search.variations_tried` | resting sequences tried; variations made, including those skipped because of their ceilings |
    | `search.linear_programs` | linear programs solved in the search |
    | `search.stages_s` | seconds of each stage |
    | `search.best` | the best five sequences with their cycles and objective, before they are sharpened |
    | `sensitivity` | how the sensitivities were computed, or why they are unknown |
    | `certificate` | for a speed, or with `[search.certify]`: the gaits to which the proof applies, its method, the number of inequalities verified exactly, and why a longer proof ended |

    The proof is written to the file `certificate.json`, unless the ceiling from rates and resting
    masses is the better bound. `wormopt verify certificate.json` verifies it.
    """  # noqa: E501

    headline: ClassVar = (
        "speed",
        "objective",
        "bound",
        "gap_certified",
        "period",
        "cycles",
        "tick_loss",
        "mode_sequence",
    )
    pictures: ClassVar = {
        "gait": "as for kind [`gait`](gait.md), for one cycle",
        "motion": "as for kind [`gait`](gait.md), for one cycle",
        "spikes": "as for kind [`gait`](gait.md), for one cycle",
        "limits": "relative sensitivity of the speed or cost to each limit (not for "
        "`energy_per_distance` and `acceleration_effort`)",
        "certificate": "bound over time (needs a table `[search.certify]`)",
        "animation": ("two cycles", "wormopt.pictures.worms:animation"),
    }
    wanted: ClassVar = ("limits",)
    exports: ClassVar = {"certificate.json": "wormopt.systems.spiked.gait_design:as_json"}

    objective: Objective = entry("the objective")

    def _faults_of_loads(self) -> Iterator[Fault]:
        """Yield a fault if the spikes cannot carry all loads, their average over a cycle."""
        limit, masses = self.gait.spike_load, self.worm.links + 1
        whole = masses * self.worm.load_range[1]
        if limit is not None and sum(per(limit, masses)) <= whole:
            yield (
                "gait.spike_load",
                f"the {masses} spikes together can carry {sum(per(limit, masses)):.6g}, which is "
                f"not above the load of the worm, {whole:.6g}, their average load over a cycle: "
                f"no gait exists; write more than {whole / masses:.6g} per spike, or a smaller "
                "load",
            )

    def faults_of_keys(self) -> Iterator[Fault]:
        faults = list(self.faults_of_design())
        yield from faults or self._faults_of_loads()
        yield from self.objective.faults_in_scene()
        yield from self.faults_of_cost("objective.minimise", self.objective.minimise)
        if self.search.certify is None:
            if "certificate" in self.want:
                yield "want", '"certificate" is given without a proof; add a table [search.certify]'
        elif self.objective.is_smooth:
            yield (
                "search.certify",
                f"a proof is not available for minimise = {self.objective.minimise!r}, only for "
                "speed, peak_spike_load and peak_actuator_force; remove the table, or choose "
                "another objective",
            )

    # -- the design --------------------------------------------------------------------------------

    @stage
    def design(self) -> Design:
        task = self.task(self.objective)
        try:
            return designed(task, self.search, self.report)
        except SolveError as error:
            raise with_keys(error, self) from None

    @stage
    def second_route(self) -> DesignReport:
        return of_design(self, self.design)

    @stage
    def sensitivity(self) -> Sequence[Sensitivity]:
        return sensitivities(self.design)

    @stage
    def certificate(self) -> tuple[Bounded, float]:
        """The bound, and the time spent on it; without `[search.certify]` that of the search."""
        found, clock = self.design, perf_counter()
        if self.search.certify is None:
            assert found.bounded is not None
            return found.bounded, 0.0
        known = found.survey.bounded
        clock -= known.history[-1][0] if known else 0.0  # spent in the search
        proven = bounded(found.task, found.value, self.search.certify, self.report, known)
        return proven, perf_counter() - clock

    @stage
    def verification(self) -> Verification | None:
        """The certificate verified in exact arithmetic."""
        certificate = self.proven.certificate
        return None if certificate is None else verify(certificate)

    @property
    def is_complete(self) -> bool:
        """Whether the search came to its end."""
        return self.design.ended != "interrupted"

    @cached_property
    def has_proof(self) -> bool:
        """Whether there is a bound, and a sound gait to compare with it."""
        found = self.design
        has_bound = self.search.certify is not None or found.bounded is not None
        sound = self.is_complete and all(check.passed for check in self.second_route.checks)
        return has_bound and sound

    @property
    def is_certified(self) -> bool:
        """Whether the bound is that of `[search.certify]`."""
        return self.has_proof and self.search.certify is not None

    @cached_property
    def why_insensitive(self) -> str:
        """Why there are no sensitivities to limits; "" if there are."""
        trial = self.design.trial
        if trial is None:
            return "a smooth cost is minimised by another solver, whose multipliers are not kept"
        if len(trial.point.x) > _MOST_UNKNOWNS and "limits" not in self.want:
            return 'the program is large; add "limits" to want'
        return ""

    @property
    def is_sensitive(self) -> bool:
        """Whether sensitivities to limits are known."""
        return self.is_complete and not self.why_insensitive

    @property
    def proven(self) -> Bounded:
        """The bound on the objective of every gait."""
        return self.certificate[0]

    @property
    def certified_gap(self) -> float:
        """Largest possible improvement; negative if the gait is better than its bound."""
        cost = self.objective.minimise is not None
        return gap_of(self.design.value, self.proven.bound, cost)

    def stopped(self) -> str:
        """Why the design is not complete."""
        if not self.is_complete:
            return "interrupted: this is the best gait so far; the search did not finish"
        if self.is_certified and self.proven.ending == "interrupted":
            return "interrupted: the gait is complete, its bound is not tight"
        return ""

    # -- results -----------------------------------------------------------------------------------

    @scalars(
        DESIGN_SCALARS
        | {"objective": ("speed", "objective reached, in its quantity, recomputed from the gait")}
    )
    def numbers(self) -> Mapping[str, Any]:
        return {**self.second_route.scalars, "objective": self.second_route.objective}

    @scalars({}, when="is_sensitive")
    def derivatives(self) -> Mapping[str, Any]:
        return scalars_of(self.sensitivity, self.worm, self.objective.quantity, self.units)

    @scalars(_PROOF_SCALARS, when="has_proof")
    def bounds(self) -> Mapping[str, Any]:
        bound = Scalar(self.proven.bound, unit_of(self.objective.quantity, self.units))
        known = {"bound": bound, "gap_certified": max(0.0, self.certified_gap)}
        return known | ({"certified_seconds": self.certificate[1]} if self.is_certified else {})

    @arrays(MOTION_VARIABLES | GAIT)
    def signals(self) -> Mapping[str, Any]:
        return self.second_route.variables

    @array("1", "limit", "relative sensitivity of the objective to the limit", when="is_sensitive")
    def limit_elasticity(self) -> np.ndarray:
        return np.array([limit.elasticity for limit in self.sensitivity])

    @arrays(_PROOF_VARIABLES, when="is_certified")
    def bound_over_time(self) -> Mapping[str, Any]:
        time, bound = np.array(self.proven.history).T[:2]
        unit = unit_of(self.objective.quantity, self.units)
        shown = {"proof_bound": bound, "proof_value": 0 * bound + self.design.value}
        return {"proof_time": time} | {
            name: Variable(name, unit, ("proof",), values, _PROOF_VARIABLES[name][2])
            for name, values in shown.items()
        }

    @checks
    def verdicts(self) -> Iterator[Check]:
        yield from self.second_route.checks
        if not self.has_proof:
            return
        advice = (
            "the gait is better than its proven bound, which is an error; please report this scene"
        )
        over = max(0.0, -self.certified_gap)
        yield Check("gait over its proven bound", over, _PROOF_ROUNDING, advice)
        if (verified := self.verification) is not None:
            advice = (
                f"verification of the certificate failed: {verified.reason}; please report this "
                "scene"
            )
            yield Check("certificate verified", 0.0 if verified.holds else 1.0, 0.0, advice)

    @facts
    def evidence(self) -> Mapping[str, Any]:
        known = dict(self.second_route.facts)
        if self.is_sensitive:
            known["sensitivity"] = {
                "method": "multipliers of the program under a change of each limit; the resting "
                "sequence is kept",
                "one_sided": [limit.name for limit in self.sensitivity if limit.one_sided],
                "scaling_error": scaling_error(self.sensitivity, self.objective),
            }
        elif self.is_complete:
            known["sensitivity"] = f"unknown: {self.why_insensitive}"
        if self.has_proof:
            proof: dict[str, Any] = {
                "holds_for": "every gait with any resting sequence, number of phases and cycles in "
                f"which gait.resting = {self.gait.resting} and all other limits hold at all times",
                "source": self.proven.source,
            }
            if self.verification is not None:
                proof["verified_inequalities"] = self.verification.inequalities
            if self.search.certify is not None:
                proof |= {"ended": self.proven.ending, "wanted_gap": self.search.certify.gap}
            known["certificate"] = proof
        return known

    @warnings
    def doubts(self) -> Iterator[str]:
        yield from self.second_route.warnings
        if self.search.certify is None or not self.has_proof:
            return
        missed = f"the gap {self.search.certify.gap:g} was not reached"
        if self.proven.ending in ("time limit", "interrupted"):
            yield f"{missed} ({self.proven.ending}): increase search.certify.time_limit"
        elif self.proven.ending == "finest program":
            yield (
                f"{missed} with the largest program; either a better gait exists (try "
                'search.effort = "thorough"), or the bound is not tight'
            )

    @attributes
    def shown(self) -> Mapping[str, Any]:
        certificate = self.proven.certificate if self.has_proof else None
        known = {} if certificate is None else {"certificate": certificate.text}
        if not self.is_sensitive:
            return known
        weight = (".pull", ".slope") if _has_weights(self.worm) else ("", "")
        return known | {
            "limits": {
                "objective": self.objective.minimise or "speed",
                "name": [limit.name.replace(*weight) for limit in self.sensitivity],
                "value": [limit.value for limit in self.sensitivity],
                "unit": [unit_of(limit.quantity, self.units) for limit in self.sensitivity],
                "one_sided": [limit.one_sided for limit in self.sensitivity],
            }
        }


def _has_weights(worm: Worm) -> bool:
    """Whether a slope pulls the masses by unequal forces, which are then in `pull`."""
    return bool(worm.slope) and len(set(worm.masses)) > 1


def scalars_of(
    known: Sequence[Sensitivity], worm: Worm, objective: str, units: str
) -> dict[str, Scalar]:
    """Scalars ``sensitivity.KEY``; lists where a key has one number per link or mass."""
    values: dict[str, Any] = {}
    quantities: dict[str, str] = {}
    for limit in known:
        if _has_weights(worm) and limit.name.startswith("worm.pull"):
            continue
        name = re.sub(r"\[\d+\]", "", limit.name.partition(".")[2])
        quantities[name] = limit.quantity
        if "[" in limit.name:
            values.setdefault(name, []).append(limit.derivative)
        else:
            values[name] = limit.derivative
    if worm.slope:  # derivative by the loads, times m g cos(slope)
        across = weights(math.pi / 2 - worm.slope, worm.gravity, worm.masses)
        part = "worm.pull" if _has_weights(worm) else "worm.load"  # which the weight is in
        loads = [limit.derivative for limit in known if limit.name.startswith(part)]
        if len(loads) != len(across) or (len(loads) == 2 and not _has_weights(worm)):
            loads = [sum(loads) / len(across)] * len(across)
        values["slope"] = sum(a * b for a, b in zip(loads, across, strict=True))
        quantities["slope"] = "angle"
    return {
        f"sensitivity.{name}": Scalar(value, unit_ratio(objective, quantities[name], units))
        for name, value in values.items()
    }


def as_json(result: Result) -> str | None:
    """Text of ``certificate.json``; None without one."""
    return result.attributes.get("certificate")
