"""Certificates: a bound on the speed of every gait, with a proof that anybody can verify."""

from __future__ import annotations

import json
import os
from collections.abc import Mapping
from dataclasses import dataclass
from fractions import Fraction
from pathlib import Path
from typing import Any

from wormopt.errors import ArgumentError
from wormopt.shown import Part, brief, html, lines
from wormopt.systems.spiked.certify.check import FORMAT, VERSION, BrokenProofError, check, read


@dataclass(frozen=True, eq=False)
class Verification:
    """Result of the verification of a certificate.

    Parameters
    ----------
    holds : bool
        Whether all inequalities of the proof hold.
    bound : Fraction
        The bound in the certificate.
    inequalities : int
        Number of verified inequalities; 0 if one does not hold.
    reason : str
        The first inequality that does not hold, or "".

    Examples
    --------
    >>> import wormopt as wo
    >>> limits = wo.Limits(period=1.0, length=(0.7, 1.3), rate=1.0, acceleration=20.0)
    >>> proven = wo.certify(wo.design(wo.Worm(links=1, load=5.0), limits))
    >>> found = wo.verify(proven.certificate)
    >>> found.holds, found.inequalities > 0, found.reason
    (True, True, '')
    """

    holds: bool
    bound: Fraction
    inequalities: int
    reason: str = ""


@dataclass(frozen=True, eq=False)
class Certificate:
    """A proof that no gait within a problem's limits is faster than a bound.

    Parameters
    ----------
    text : str
        Content of its file, in JSON.

    Examples
    --------
    >>> import wormopt as wo
    >>> limits = wo.Limits(period=1.0, length=(0.7, 1.3), rate=1.0, acceleration=20.0)
    >>> proven = wo.certify(wo.design(wo.Worm(links=1, load=5.0), limits))
    >>> proven.certificate.save("certificate.json")
    >>> wo.verify("certificate.json").holds, round(float(proven.certificate.bound), 6)
    (True, 0.425)
    """

    text: str

    @classmethod
    def of(
        cls, problem: Mapping[str, Any], proof: Mapping[str, Any], bound: Fraction
    ) -> Certificate:
        """Write a certificate.

        Parameters
        ----------
        problem : mapping
            Worm and limits, with numbers as fractions.
        proof : mapping
            Data of the proof.
        bound : Fraction
            The proven bound on the speed.
        """
        content = {
            "format": FORMAT,
            "version": VERSION,
            "claim": "no gait of the problem has a mean speed above the bound",
            "bound": bound,
            "problem": dict(problem),
            "proof": dict(proof),
        }
        return cls(json.dumps(content, default=str, separators=(",", ":")) + "\n")

    @property
    def bound(self) -> Fraction:
        """The proven bound: no gait is faster."""
        return Fraction(json.loads(self.text)["bound"])

    def __repr__(self) -> str:
        bound = f"no gait is faster than {float(self.bound):.9g}"
        return lines(f"Certificate: {bound}", f"{len(self.text)} characters of JSON")

    def _repr_html_(self) -> str:
        problem = json.loads(self.text)["problem"]
        rows = [(str(name), brief(value)) for name, value in problem.items()]
        title = f"Certificate: no gait is faster than {float(self.bound):.9g}"
        return html(title, [Part("Problem", rows)], ["wo.verify checks it in exact arithmetic"])

    def save(self, file: str | os.PathLike[str]) -> None:
        """Write the certificate to a file.

        Parameters
        ----------
        file : path
            Name of the file.
        """
        Path(file).write_text(self.text, encoding="utf-8")


def verify(certificate: Certificate | str | os.PathLike[str]) -> Verification:
    """Verify a certificate in exact arithmetic, from its file alone.

    Parameters
    ----------
    certificate : Certificate or path
        A certificate, its file, or the folder of a result, which holds it as ``certificate.json``.

    Returns
    -------
    Verification
        Whether the proof holds; otherwise, the first inequality that fails.

    Raises
    ------
    ArgumentError
        If the file does not exist, or if it is not a certificate.

    Examples
    --------
    >>> import wormopt as wo
    >>> limits = wo.Limits(period=1.0, length=(0.7, 1.3), rate=1.0, acceleration=20.0)
    >>> proven = wo.certify(wo.design(wo.Worm(links=1, load=5.0), limits))
    >>> found = wo.verify(proven.certificate)
    >>> found.holds, round(float(found.bound), 6)
    (True, 0.425)
    """
    if isinstance(certificate, Certificate):
        name, text = "certificate", certificate.text
    else:
        file = Path(certificate)
        what = "give the file of a certificate"
        if file.is_dir():
            file /= "certificate.json"
            what = "designs of a speed write it, those of a peak with [search.certify] only"
        name = os.fspath(file)
        try:
            text = file.read_text(encoding="utf-8")
        except (OSError, UnicodeDecodeError) as error:
            why = error.strerror if isinstance(error, OSError) else "not a text"
            raise ArgumentError(f"{name}: {why}; {what}") from None
    bound = Fraction(0)
    try:
        problem, proof, bound = read(text)
        return Verification(True, bound, check(problem, proof, bound))
    except BrokenProofError as error:
        return Verification(False, bound, 0, str(error))
    except (KeyError, IndexError) as error:
        raise ArgumentError(f"{name}: {error.args[0]!r} is missing in the certificate") from None
    except (ValueError, TypeError, AttributeError, ZeroDivisionError, RecursionError) as error:
        raise ArgumentError(f"{name}: not a certificate: {error}") from None
