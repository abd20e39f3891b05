"""FMI 3.0 and 2.0: a Model as an FMU, its contacts smooth, by CasADi's own export.

CasADi 3.8 writes code and description of the model for FMI 3.0. Corrections: its wrapper does not
evaluate again when only time is set, uses time 0 in derivatives, 1 for the nominal size of every
state, and leaves open whether a step ends the simulation; the description lacks units and
dependence on time. Co-simulation and saved states are ours, in `co_simulation.c`.
`tests/exports/test_exported_programs.py` checks each.
"""

from __future__ import annotations

import io
import platform
import re
import subprocess
import sys
import tempfile
import zipfile
from collections.abc import Iterator, Sequence
from contextlib import chdir
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal
from xml.etree import ElementTree

import casadi as ca
import numpy as np

from wormopt.errors import ArgumentError
from wormopt.exports import fmi2
from wormopt.exports.common import identifier, remarks
from wormopt.files import MARK
from wormopt.kinds import KINDS
from wormopt.model.explicit import Explicit
from wormopt.model.model import TINY, Model
from wormopt.model.schedule import Schedule
from wormopt.model.values import signal_values
from wormopt.quantities import parsed, unit_of_signal
from wormopt.result import Result
from wormopt.shown import one_line
from wormopt.simulation.native.build import SHARED, SUFFIX, compiler, error_output
from wormopt.simulation.options import Smooth
from wormopt.study.scene import scene_of_text
from wormopt.version import VERSION

_HEADER = "fmi3Functions.h"
# Lines of CasADi's wrapper, and their corrections.
_MENDED = (
    ("m->t = time;", "m->t = m->v[0] = time;\n  m->up_to_date = 0;"),
    (
        "m->t = startTime;",
        "m->t = m->v[0] = startTime;\n  m->up_to_date = 0;\n  m->h = 0;\n"
        "  m->relative = toleranceDefined && tolerance > 0 ? tolerance : 1e-6;",
    ),
    ("m->arg[i++] = 0;  // t", "m->arg[i++] = &m->t;"),
    ("\nfmi3Status fmi3Get", "\nFMI3_Export fmi3Status fmi3Get"),
    (
        "// We should not need this as there are no internal iterations",
        "*enterEventMode = *terminateSimulation = fmi3False;",
    ),
    ("nominals[i] = 1;", "nominals[i] = nominal[i];"),
    ("} casadi_fmi_memory;", "  double relative, h; // of co-simulation\n} casadi_fmi_memory;"),
    ("#include <fmi3", "#include <math.h>\n#include <string.h>\n#include <fmi3"),
)
# Functions that the wrapper does not implement, and their bodies.
_FILLED = {
    "fmi3InstantiateCoSimulation": "return fmi3InstantiateModelExchange(instanceName, "
    "instantiationToken, resourcePath, visible, loggingOn, instanceEnvironment, logMessage);",
    "fmi3EnterStepMode": "return fmi3OK;",
    "fmi3DoStep": "*eventHandlingNeeded = *terminateSimulation = *earlyReturn = fmi3False;\n"
    "  *lastSuccessfulTime = currentCommunicationPoint + communicationStepSize;\n"
    "  return step_to((casadi_fmi_memory*)instance, currentCommunicationPoint, "
    "*lastSuccessfulTime);",
    "fmi3GetFMUState": "if (!*FMUState) *FMUState = malloc(sizeof(casadi_fmi_memory));\n"
    "  if (!*FMUState) return fmi3Error;\n"
    "  memcpy(*FMUState, instance, sizeof(casadi_fmi_memory));\n  return fmi3OK;",
    "fmi3SetFMUState": "memcpy(instance, FMUState, sizeof(casadi_fmi_memory));\n  return fmi3OK;",
    "fmi3FreeFMUState": "free(*FMUState);\n  *FMUState = 0;\n  return fmi3OK;",
}
_STUB = r"( {name}\([^{{}}]*{{\n)  // Not implemented\n  return [^;]*;"
_MACHINES = {"amd64": "x86_64", "arm64": "aarch64", "i386": "x86", "i686": "x86"}


@dataclass(frozen=True, eq=False)
class Plant:
    """A Model to be exported, with remarks."""

    model: Model
    v_reg: float = 1 / 40
    units: str = "SI"  # or "dimensionless": units of quantities
    remarks: tuple[str, ...] = ()


def make(plants: Sequence[Plant], stem: str, version: Literal[2, 3] = 3) -> dict[str, bytes]:
    """``STEM.fmu``, or ``STEM_0.fmu`` and so on for several models; of FMI 3.0 or 2.0."""
    stems = [stem] if len(plants) == 1 else [f"{stem}_{k}" for k in range(len(plants))]
    pairs = zip(stems, plants, strict=True)
    return {f"{each}.fmu": _archive(plant, each, version) for each, plant in pairs}


def _archive(plant: Plant, stem: str, version: int) -> bytes:
    name = f"{identifier(stem)}_model"  # no C function has this name
    _refuse(plant.model)
    dae = _builder(plant, name)
    with tempfile.TemporaryDirectory() as folder, chdir(folder):  # CasADi writes here
        files = dae.export_fmu({"no_warning": True, "with_serialization": False})
        wrapper = Path(f"{name}_wrap.c")
        text = wrapper.read_text(encoding="utf-8")
        for old, new in _MENDED:
            text = text.replace(old, new)
        for function, body in _FILLED.items():
            text = re.sub(_STUB.format(name=function), rf"\1  {body}", text)
        text = text.replace(*_nominals(plant.model))
        steps = Path(__file__).with_name("co_simulation.c").read_text(encoding="utf-8")
        reset = "FMI3_Export fmi3Status fmi3Reset"
        text = text.replace(reset, f"{steps}{reset}", 1)
        if version == 2:
            text += Path(__file__).with_name("fmi2.c").read_text(encoding="utf-8")
        wrapper.write_text(text, encoding="utf-8", newline="\n")
        described = Path("modelDescription.xml")
        _mend_description(described, stem, _description(plant), _timed(plant))
        _remove_headers(Path("buildDescription.xml"))
        library = _compiled(name)
        if version == 2:
            three = ElementTree.parse(described).getroot()  # noqa: S314  it is ours
            _write(fmi2.description(three, [f"{name}.c", wrapper.name]), described)
            del files["buildDescription.xml"]
            files[_HEADER] = f"sources/{_HEADER}"
        files[library] = f"binaries/{_platform(version)}/{name}{SUFFIX}"
        stream = io.BytesIO()
        with zipfile.ZipFile(stream, "w", zipfile.ZIP_DEFLATED) as archive:
            for local, path in sorted(files.items()):
                archive.write(local, path.removeprefix("./"))
            archive.comment = MARK.encode()
    return stream.getvalue()


def _refuse(model: Model) -> None:
    model.refuse_delays("an FMU here")
    x = ca.vertcat(*(signal.symbol for signal in model.x))
    for switch in model.switches:  # switches that only report events may be dropped
        if switch.terminal or not ca.is_equal(ca.densify(switch.reset), x, 2):
            raise ArgumentError(
                f"{model.name}: {switch.name!r} changes states or ends the motion, but an FMU of "
                "wormopt has no events; use a model without switches"
            )
    if any(c.gap is not None or c.normal_force is not None for c in model.contacts):
        raise ArgumentError(f"{model.name} has walls; make them elastic with smooth_walls")


def _nominals(model: Model) -> tuple[str, str]:
    """Correction of the wrapper that adds the nominal size of every state."""
    line = "#include <fmi3Functions.h>\n"
    sizes = [repr(float(s.nominal)) for s in model.x for _ in range(s.size)]
    return line, f"{line}static const double nominal[] = {{{', '.join(sizes)}}};\n"


def _timed(plant: Plant) -> bool:
    """Whether the model depends on time itself."""
    model = plant.model
    outputs = (ca.vec(o.expression) for o in model.outputs)
    expressions = ca.vertcat(model.ode, model.contact_velocities, *outputs)
    return len(model.schedules) > 0 or bool(ca.depends_on(expressions, model.t))


def _description(plant: Plant) -> str:
    parts = [plant.model.name, *plant.remarks]
    if plant.model.contacts:
        parts.append(
            "friction is smoothed over velocities of the width v_reg: no contact ever rests"
        )
    return one_line("; ".join(parts))


def plants_of(what: object) -> list[Plant]:
    """The models of a Result, or a Model itself; raises ArgumentError if there is none."""
    if isinstance(what, Model):
        return [Plant(what)]
    if not isinstance(what, Result):
        raise ArgumentError(f"an FMU takes a Result or a Model, not {type(what).__name__}")
    kind = KINDS.get(what.kind)
    scene = scene_of_text(what.scene, what.kind, what.scene_text) if kind else None
    models = scene.table.models() if scene else None
    if scene is None or models is None:
        raise ArgumentError(
            f"{what.scene}: a result of kind {what.kind} holds no model, which an FMU needs; "
            "use kind simulate or track"
        )
    treatment, notes = scene.table.contact.options, remarks(what)
    v_reg = treatment.v_reg if isinstance(treatment, Smooth) else Smooth().v_reg
    return [
        Plant(model, v_reg, scene.table.units, (*notes, label) if label else tuple(notes))
        for label, model in models.items()
    ]


# -- the model in CasADi's interface -------------------------------------------------------------


def _builder(plant: Plant, name: str) -> Any:
    model = plant.model
    taken = {s.name for s in (*model.x, *model.u, *model.p)}
    outputs = [o for o in model.outputs if o.name not in taken]
    taken |= {o.name for o in outputs}
    explicit = Explicit(model, [o.name for o in outputs])
    width = explicit.symbols["v_reg"]
    laws = [c.law.smooth(c.velocity, width) for c in model.contacts]
    function = explicit.function("model", "rates", "observed", ca.vertcat(ca.SX(0, 1), *laws))

    dae = ca.DaeBuilder(name)
    t = dae.add(_free("time", taken), "independent", {"unit": "s"} if plant.units == "SI" else {})
    x = _signals(dae, plant, model.x, signal_values(model.x, None, "state"), "local")
    u = _signals(dae, plant, model.u, signal_values(model.u, None, "input", 0.0), "input")
    p = _signals(dae, plant, model.p, signal_values(model.p, None, "parameter"), "parameter")
    # v_reg is in every model, so that users can treat all the same
    says = {"start": plant.v_reg, "description": "width of the smooth law of friction"}
    v_reg = dae.add(
        _free("v_reg", taken), "parameter", "tunable", says | _unit("speed", plant.units)
    )
    s = [_scheduled(schedule, t) for schedule in model.schedules]

    rates, observed, forces = function(t, _column(x), _column(u), _column(p), v_reg, _column(s))
    for k, state in enumerate(x):
        dae.eq(dae.der(state), rates[k])
    at = 0
    for output in outputs:
        for scalar in _scalars(output.name, output.expression.numel()):
            dae.eq(dae.add(scalar, "output", _unit(output.unit, plant.units)), observed[at])
            at += 1
    if "contact_force" not in taken:
        for k, scalar in enumerate(_scalars("contact_force", len(laws))):
            dae.eq(dae.add(scalar, "output", _unit("force", plant.units)), forces[k])
    return dae


def _signals(
    dae: Any, plant: Plant, signals: Sequence[Any], values: np.ndarray, causality: str
) -> list[ca.MX]:
    """Add the variables of some signals, scalar by scalar."""
    found, at = [], 0
    for signal in signals:
        for scalar in _scalars(signal.name, signal.size):
            says = _unit(signal.unit, plant.units) | dict(_bounds(signal))
            says |= {"start": float(values[at]), "nominal": float(signal.nominal)}
            if causality == "parameter":
                found.append(dae.add(scalar, causality, "tunable", says))
            else:
                found.append(dae.add(scalar, causality, says))
            if causality == "local":
                dae.set_initial(scalar, "exact")
            at += 1
    return found


def _column(parts: Sequence[ca.MX]) -> ca.MX:
    return ca.vertcat(ca.MX(0, 1), *parts)


def _bounds(signal: Any) -> Iterator[tuple[str, float]]:
    for word, bound in (("min", signal.lower), ("max", signal.upper)):
        if np.isfinite(bound):
            yield word, 0.0 if bound == TINY else float(bound)


def _scalars(name: str, size: int) -> list[str]:
    """Names of the scalars of a signal in FMI: ``position[0]``, ``'odd name'``."""
    if not re.fullmatch(r"[A-Za-z_]\w*", name, flags=re.ASCII):
        odd = (not c.isascii() or not c.isprintable() or c in "'\"\\" for c in name)
        kept = (f"_{ord(c):x}_" if o else c for c, o in zip(name, odd, strict=True))
        name = f"'{''.join(kept)}'"
    return [name] if size == 1 else [f"{name}[{k}]" for k in range(size)]


def _free(name: str, taken: set[str]) -> str:
    """Name that no signal of the model has."""
    return f"{name}_" if name in taken else name


def _unit(quantity: str, units: str) -> dict[str, str]:
    """Unit of a quantity, or of a unit's name."""
    unit = unit_of_signal(quantity, units)
    return {} if unit in ("1", "") else {"unit": unit}


def _scheduled(schedule: Schedule, t: ca.MX) -> ca.MX:
    """Values of a schedule at the time t, as `Schedule.locate` finds them."""
    breaks = ca.MX(ca.DM(schedule.breaks))
    period = float(schedule.breaks[-1])
    since = t - schedule.start + 4 * np.finfo(float).eps * ca.fmax(ca.fabs(t), period)
    turn = ca.floor(since / period) * period if schedule.periodic else ca.MX(0)
    piece = ca.low(breaks, since - turn)
    return ca.vertcat(
        schedule.start + turn + breaks[piece], ca.MX(ca.DM(schedule.values.T))[:, piece]
    )


# -- descriptions --------------------------------------------------------------------------------


def _mend_description(path: Path, name: str, text: str, timed: bool) -> None:
    """Complete ``modelDescription.xml``; `timed`: whether the model depends on time itself."""
    root = ElementTree.parse(path).getroot()  # noqa: S314  CasADi has just written it
    root.set("modelName", name)
    root.set("description", text)
    root.set("generationTool", f"wormopt {VERSION}, {root.get('generationTool')}")
    variables, structure = root.find("ModelVariables"), root.find("ModelStructure")
    assert variables is not None
    assert structure is not None
    for variable in [*variables]:
        if variable.get("name", "").startswith("__assign__"):  # CasADi's own
            variables.remove(variable)
    for unknown in structure.iter("InitialUnknown"):  # parameters are missing there
        unknown.attrib.pop("dependencies", None)
    for unknown in (*structure.iter("Output"), *structure.iter("ContinuousStateDerivative")):
        if timed:
            unknown.set("dependencies", f"0 {unknown.get('dependencies', '')}".strip())
    units = {v.get("unit"): None for v in variables if v.get("unit")}
    exchange = root.find("ModelExchange")
    assert exchange is not None
    exchange.set("canGetAndSetFMUState", "true")
    after = [*root].index(exchange) + 1
    stepped = {"canHandleVariableCommunicationStepSize": "true"}
    root.insert(after, ElementTree.Element("CoSimulation", {**exchange.attrib, **stepped}))
    after += 1
    root.insert(after, ElementTree.Element("DefaultExperiment", startTime="0"))
    if units:
        defined = ElementTree.Element("UnitDefinitions")
        defined.extend(_unit_definition(str(name)) for name in units)
        root.insert(after, defined)
    _write(root, path)


def _remove_headers(path: Path) -> None:
    """Remove headers from ``buildDescription.xml``: they are no compilation units."""
    root = ElementTree.parse(path).getroot()  # noqa: S314  CasADi has just written it
    for files in root.iter("SourceFileSet"):
        for file in [*files]:
            if file.get("name", "").endswith(".h"):
                files.remove(file)
    _write(root, path)


def _unit_definition(name: str) -> ElementTree.Element:
    found = ElementTree.Element("Unit", name=name)
    try:
        factor, powers = parsed(name)
    except ValueError:
        return found  # a user's unit: only its name is known
    attributes = {base: str(power) for base, power in powers.items()}
    if factor != 1:
        attributes["factor"] = repr(float(factor))
    found.append(ElementTree.Element("BaseUnit", attributes))
    return found


def _write(root: ElementTree.Element, path: Path) -> None:
    ElementTree.indent(root, "    ")
    ElementTree.ElementTree(root).write(path, encoding="UTF-8", xml_declaration=True)


# -- the library ---------------------------------------------------------------------------------


def _compiled(name: str) -> str:
    """Compile the sources in the current folder; returns the library."""
    command = compiler()
    if command is None:
        raise ArgumentError("an FMU needs a C compiler; install one, or wormopt[compiler]")
    library = f"{name}{SUFFIX}"
    Path(_HEADER).write_bytes(Path(__file__).with_name(_HEADER).read_bytes())
    flags = [*SHARED, "-O2", "-fvisibility=hidden", "-I."]
    call = [*command, *flags, f"{name}.c", f"{name}_wrap.c", "-o", library, "-lm"]
    # the command is the user's own compiler
    done = subprocess.run(call, capture_output=True, check=False)  # noqa: S603
    if done.returncode:
        raise ArgumentError(f"{' '.join(command)} cannot compile the FMU:\n{error_output(done)}")
    return library


def _platform(version: int) -> str:
    """Name of this machine in FMI."""
    system, machine = platform.system().lower(), platform.machine().lower()
    if version == 2:
        return f"{system.replace('windows', 'win')}{64 if sys.maxsize > 2**32 else 32}"
    return f"{_MACHINES.get(machine, machine)}-{system}"
