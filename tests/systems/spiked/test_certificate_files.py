"""Certificates in files: verified exactly, and refused where they are broken."""

import json
from collections.abc import Callable
from fractions import Fraction
from functools import cache
from typing import Any

import pytest
from certified import BEST_OF_THREE_LINKS, bound_of, g1, less

import wormopt as wo
from wormopt.cli import main
from wormopt.errors import ArgumentError
from wormopt.model.given import fields_of
from wormopt.systems.spiked.certify.bound import at_once
from wormopt.systems.spiked.certify.certificate import Certificate, verify
from wormopt.systems.spiked.certify.program import Level, Outer, Program
from wormopt.systems.spiked.certify.statement import Statement
from wormopt.systems.spiked.gait_problem import GaitProblem, Worm
from wormopt.systems.spiked.limits import Limits, Rates


@cache
def certificate(task: GaitProblem, *level: int) -> Certificate:
    outer = Outer(Statement.of(task))
    bound, proof = Program(outer, Level(*level)).solve(60.0)
    return Certificate.of(fields_of(outer.statement), proof, Fraction(bound) + Fraction(1, 10**8))


SPIKED = g1(spike_load=25.0, actuator_force=20.0, drag=0.5)


@pytest.mark.parametrize(
    "task", [SPIKED, g1(3, resting=2), g1(rate=(1.0, 0.6), length=((0.7, 1.3), (0.7, 1.1)))]
)
def test_certificates_are_verified_exactly(task: GaitProblem):
    found = verify(certificate(task, 1, 1, 2))
    assert found.holds, found.reason
    assert found.inequalities > 100


def test_a_certificate_of_three_links_is_verified_exactly():
    """Linear in the velocities: 48 simplices, in half a second."""
    found = verify(certificate(g1(3), 1, 1, 1))
    assert found.holds, found.reason
    assert BEST_OF_THREE_LINKS < found.bound < 1.5


def changed(task: GaitProblem, change: Callable[[Any], None]) -> Certificate:
    file = json.loads(certificate(task, 1, 1, 2).text)
    change(file)
    return Certificate(json.dumps(file))


def put(*path: Any, to: Any) -> Callable[[Any], None]:
    """Change one entry of a file, by what it is or to another."""

    def change(file: Any) -> None:
        *way, last = path
        for key in way:
            file = file[key]
        file[last] = to(file[last]) if callable(to) else to

    return change


BROKEN: dict[str, tuple[Callable[[Any], Any], str]] = {
    "a bound that is lower": (put("bound", to=less), "exceeds the bound"),
    "a sign of W": (
        put("proof", "values", to=lambda values: [[-x for x in v] for v in values]),
        "exceeds the bound",
    ),
    "a coefficient": (put("proof", "values", 3, 0, to=lambda x: x + 10**6), "exceeds the bound"),
    "a larger load": (put("problem", "load", to=["6", "6"]), "exceeds the bound"),
    "a smaller margin": (put("problem", "sigma_margin", to="-1"), "exceeds the bound"),
    "stronger spikes": (put("problem", "spike_load", to=["30"] * 3), "exceeds the bound"),
    "stronger actuators": (put("problem", "actuator_force", to=["30"] * 2), "exceeds the bound"),
    "less drag": (put("problem", "drag", to="0.1"), "exceeds the bound"),
    "a faster link": (put("problem", "rates", 1, 0, to="1.001"), "link 0 can be faster"),
    "a quicker link": (put("problem", "acceleration", to=["21", "20"]), "accelerates by"),
    "a longer link": (put("problem", "length", 0, to=["0.7", "1.4"]), "link 0 can move by more"),
    "a shorter stroke": (put("proof", "strokes", 1, to=less), "link 1 can move by more"),
    "weaker brakes": (
        put("proof", "brakes", 1, 0, to=lambda brakes: less(brakes[0])),
        "link 0 accelerates by",
    ),
    "a piece left out": (lambda f: f["proof"]["pieces"].pop(), "no piece lies beyond|a gap"),
    "a piece twice": (put("proof", "pieces", to=lambda p: [*p, p[0]]), "overlap|a gap"),
    "a piece moved": (put("proof", "vertices", 0, to=lambda v: [x + 1 for x in v]), ""),
    "other resting masses": (put("problem", "resting", to=2), "masses rest"),
    "no cells": (put("proof", "cells", to=0), "no cells"),
}


@pytest.mark.parametrize("name", BROKEN)
def test_a_broken_certificate_is_not_verified(name: str):
    change, said = BROKEN[name]
    found = verify(changed(SPIKED, change))
    assert not found.holds
    assert any(part in found.reason for part in said.split("|")), found.reason


def test_a_broken_certificate_of_mean_rates_is_not_verified():
    proven = bound_of(g1(5), 1.9).certificate
    assert proven is not None
    file = json.loads(proven.text)
    file["bound"] = less(file["bound"])
    assert "mean rates" in verify(Certificate(json.dumps(file))).reason
    file = json.loads(proven.text)
    file["proof"]["brakes"][0][0] = "19"
    assert "below its acceleration" in verify(Certificate(json.dumps(file))).reason


def test_the_command_verifies_a_file(tmp_path, capsys: pytest.CaptureFixture[str]):
    good, bad, none = (tmp_path / f"{name}.json" for name in ("good", "bad", "none"))
    certificate(g1(), 1, 1, 2).save(good)
    assert verify(good).holds
    assert wo.verify(str(good)).holds
    assert main(["verify", str(good)]) == 0
    out = capsys.readouterr().out
    assert "no gait within the limits of its `problem` is faster than" in out
    assert "in the units of the scene" in out
    bad.write_text(changed(g1(), BROKEN["a bound that is lower"][0]).text)
    assert main(["verify", str(bad)]) == 3
    assert "not verified: dW/dt" in capsys.readouterr().err
    assert main(["verify", str(none)]) == 2
    assert "none.json: No such file" in capsys.readouterr().err
    assert main(["verify", str(tmp_path)]) == 2
    err = capsys.readouterr().err
    assert "certificate.json: No such file" in err
    assert "those of a peak with [search.certify] only" in err
    good.rename(tmp_path / "certificate.json")
    assert main(["verify", str(tmp_path)]) == 0


def test_strokes_are_rounded_up_from_what_is_proven():
    """They were rounded down by what the last digits of floats may be off: not verified."""
    worm = Worm(links=3, mass=(1.9752096437611943, 1.0, 1.320529048672694, 0.5), load=6.29336757)
    rate = (1.3728651274683445, 1.4607125195623956, 1.238089937382999)
    low = (0.4203364253546264, 0.6575655446053759, 0.8734806309272474)
    high = (1.188261913845055, 1.214853091485605, 1.4077341618810624)
    limits = Limits(
        period=1.0,
        length=tuple(zip(low, high, strict=True)),
        resting=3,
        rate=Rates(contraction=rate, extension=rate),
        acceleration=(34.60666055673868, 13.994626096661797, 9.5),
    )
    found = at_once(GaitProblem(worm, limits))
    assert found is not None
    assert found.certificate is not None
    assert verify(found.certificate).reason == ""


def test_forces_that_no_gait_can_keep_leave_the_bound_of_rates():
    """A spike holds 4 at most where a load of 15 pulls: no acceleration keeps all limits."""
    limits = Limits(period=1.0, length=(0.7, 1.3), rate=1.0, acceleration=20.0, spike_load=4.0)
    found = at_once(GaitProblem(Worm(links=2, load=5.0), limits))
    assert found is not None
    assert found.bound <= 1.0


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("{", "not a certificate: Expecting"),
        ("[]", '"format" must be "wormopt certificate"'),
        ('{"format": "wormopt certificate", "version": 2}', "version 2 is not known; only 1 is"),
        ('{"format": "wormopt certificate", "version": 1}', "'problem' is missing"),
    ],
)
def test_what_is_no_certificate_is_refused(text: str, said: str, tmp_path):
    file = tmp_path / "c.json"
    file.write_text(text)
    with pytest.raises(ArgumentError) as refused:
        verify(file)
    assert said in str(refused.value)
    assert str(file) in str(refused.value)


@pytest.mark.parametrize("key", ["masses", "rates", "sharing", "length"])
def test_a_certificate_without_a_key_is_refused(key: str):
    with pytest.raises(ArgumentError, match=f"'{key}' is missing"):
        verify(changed(g1(), lambda f: f["problem"].pop(key)))
