"""FMUs compiled from C equations, of FMI 2.0 and 3.0, for co-simulation and model exchange; and FMUs that do harm."""

from __future__ import annotations

import shutil
import subprocess
import zipfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from xml.sax.saxutils import quoteattr

import pytest

WRAPPER = Path(__file__).with_name("fmu_wrapper.c")
HOOKS = ("INSTANTIATE", "EXIT_INITIALIZATION", "RESET", "GET", "STEP", "INDICATORS", "COMPLETED", "EVENT")

needs_compiler = pytest.mark.skipif(shutil.which("gcc") is None, reason="FMUs of the tests are compiled by gcc")


@dataclass(frozen=True)
class Equations:
    """Equations to make an FMU of.

    Attributes:
        inputs, outputs: Units by name.
        parameters: Unit, start and further attributes by name.
        states: Starts by name.
        code: C that writes ``dx[i]`` and ``y[i]`` from ``u[i]``, ``p[i]`` and ``x[i]``.
        indicators: Number of event indicators.
        hooks: C by hook: ``STEP`` at the beginning of a step at time ``t``, and others.
        flags: Names of boolean inputs, ``m->b[i]``.
    """

    inputs: Mapping[str, str]
    outputs: Mapping[str, str]
    parameters: Mapping[str, tuple[str, float] | tuple[str, float, str]]
    states: Mapping[str, float]
    code: str
    indicators: int = 0
    hooks: Mapping[str, str] = field(default_factory=dict)
    flags: Sequence[str] = ()
    interface_attributes: str = ""
    variability: str = "continuous"

    def faulty(self, **hooks: str) -> Equations:
        return replace(self, hooks={**self.hooks, **hooks})


UNITS = {
    "rad": "<BaseUnit rad='1'/>",
    "deg": "<BaseUnit rad='1' factor='0.017453292519943295'/>",
    "m/s": "<BaseUnit m='1' s='-1'/>",
    "km/h": "<BaseUnit m='1' s='-1' factor='0.2777777777777778'/>",
    "kg": "<BaseUnit kg='1'/>",
    "degC": "<BaseUnit K='1' offset='273.15'/>",
}


def make(folder: Path, equations: Equations, version: int = 2, kind: str = "cs", substeps: int = 1) -> Path:
    """Compile an FMU, once for the same equations in a folder."""
    import fmpy
    from fmpy import platform, platform_tuple, sharedLibraryExtension

    path = folder / f"truck_{version}_{kind}.fmu"
    co = kind == "cs"
    starts = [0.0] * len(equations.inputs) + [p[1] for p in equations.parameters.values()] + [0.0]
    sizes = {
        "VERSION": version, "NU": len(equations.inputs), "NP": len(equations.parameters),
        "NX": len(equations.states), "NY": len(equations.outputs), "NZ": equations.indicators,
        "SUBSTEPS": substeps, "KIND": int(co), "TOKEN": '"{token}"',
        "START": f"{{{', '.join(map(repr, starts))}}}",
        "START_X": f"{{{', '.join([*map(repr, equations.states.values()), '0.0'])}}}",
    }  # fmt: skip
    hooks = {f"IN_{hook}": equations.hooks.get(hook, "") for hook in HOOKS}
    text = "".join(f"#define {name} {value}\n" for name, value in sizes.items())
    text += "".join("#define {} {}\n".format(n, " ".join(v.split("\n"))) for n, v in hooks.items())
    build = folder / f"build_{version}_{kind}"
    build.mkdir(parents=True, exist_ok=True)
    signature = "Model *m, const double *u, const double *p, const double *x, double *dx, double *y"
    (build / "hooks.c").write_text(f"static void evaluate({signature}) {{\n{equations.code}\n}}\n")
    (build / "model.c").write_text(text + WRAPPER.read_text())
    library = build / f"truck{sharedLibraryExtension}"
    headers = Path(fmpy.__file__).parent / "c-code"
    command = ["gcc", "-O2", "-w", "-ffp-contract=off", "-shared", "-fPIC", f"-I{headers}", f"-I{build}"]
    subprocess.run([*command, "-o", library, build / "model.c", "-lm"], check=True)
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("modelDescription.xml", (_xml_2 if version == 2 else _xml_3)(equations, co))
        where = platform if version == 2 else platform_tuple
        archive.write(library, f"binaries/{where}/{library.name}")
    return path


def _units(equations: Equations) -> str:
    names = {*equations.inputs.values(), *equations.outputs.values(), *(p[0] for p in equations.parameters.values())}
    rows = [f"<Unit name={quoteattr(n)}>{UNITS.get(n, '')}</Unit>" for n in sorted(names - {""})]
    return f"<UnitDefinitions>{''.join(rows)}</UnitDefinitions>" if rows else ""


def _rows(equations: Equations, co: bool) -> list[tuple[str, str, str, str]]:
    """Return name, attributes of the variable, of its number, and kind."""

    def unit(text: str) -> str:
        return f" unit={quoteattr(text)}" if text else ""

    rows = [
        (n, f'causality="input" variability="{equations.variability}"', f'start="0"{unit(u)}', "input")
        for n, u in equations.inputs.items()
    ]
    for name, (u, start, *further) in equations.parameters.items():
        number = f'start="{start!r}"{unit(u)} {"".join(further)}'
        rows.append((name, 'causality="parameter" variability="tunable"', number, "parameter"))
    rows += [(n, 'causality="output"', unit(u), "output") for n, u in equations.outputs.items()]
    if not co:
        rows += [(n, 'causality="local"', f'start="{v!r}"', "state") for n, v in equations.states.items()]
        rows += [(f"der({n})", 'causality="local"', "DERIVATIVE", "derivative") for n in equations.states]
    return rows


def _xml_2(equations: Equations, co: bool) -> str:
    rows, variables = _rows(equations, co), []
    first = {
        kind: next((i + 1 for i, r in enumerate(rows) if r[3] == kind), 0) for kind in ("output", "state", "derivative")
    }
    seen = 0
    for i, (name, attributes, number, kind) in enumerate(rows):
        if kind == "derivative":
            number, seen = f'derivative="{first["state"] + seen}"', seen + 1
        initial = ' initial="exact"' if kind == "state" else ""
        variables.append(
            f'<ScalarVariable name={quoteattr(name)} valueReference="{i}" {attributes}{initial}><Real {number}/>'
            "</ScalarVariable>"
        )
    for i, name in enumerate(equations.flags):
        variables.append(
            f'<ScalarVariable name="{name}" valueReference="{1000 + i}" causality="input" variability="discrete">'
            '<Boolean start="false"/></ScalarVariable>'
        )
    outputs = "".join(f'<Unknown index="{first["output"] + i}"/>' for i in range(len(equations.outputs)))
    derivatives = "".join(
        f'<Unknown index="{first["derivative"] + i}"/>' for i in range(0 if co else len(equations.states))
    )
    kind = "CoSimulation" if co else "ModelExchange"
    variable = ' canHandleVariableCommunicationStepSize="true"' if co else ""
    indicators = "" if co else f' numberOfEventIndicators="{equations.indicators}"'
    return (
        '<?xml version="1.0" encoding="UTF-8"?><fmiModelDescription fmiVersion="2.0" modelName="truck" guid="{token}" '
        f'generationTool="tests"{indicators}>'
        f'<{kind} modelIdentifier="truck"{variable} {equations.interface_attributes}/>{_units(equations)}'
        '<LogCategories><Category name="logStatusError"/></LogCategories>'
        f"<ModelVariables>{''.join(variables)}</ModelVariables>"
        f"<ModelStructure><Outputs>{outputs}</Outputs>"
        f"{f'<Derivatives>{derivatives}</Derivatives>' if derivatives else ''}</ModelStructure></fmiModelDescription>"
    )


def _xml_3(equations: Equations, co: bool) -> str:
    rows, variables, seen = _rows(equations, co), [], 0
    state = next((i for i, r in enumerate(rows) if r[3] == "state"), 0)
    for i, (name, attributes, number, kind) in enumerate(rows):
        if kind == "derivative":
            number, seen = f'derivative="{state + seen}"', seen + 1
        initial = ' initial="exact"' if kind == "state" else ""
        variables.append(f'<Float64 name={quoteattr(name)} valueReference="{i}" {attributes}{initial} {number}/>')
    for i, name in enumerate(equations.flags):
        variables.append(f'<Boolean name="{name}" valueReference="{1000 + i}" causality="input" start="false"/>')
    for i in range(0 if co else equations.indicators):
        variables.append(f'<Float64 name="z{i}" valueReference="{2000 + i}" causality="local"/>')
    structure = "".join(f'<Output valueReference="{i}"/>' for i, r in enumerate(rows) if r[3] == "output")
    structure += "".join(
        f'<ContinuousStateDerivative valueReference="{i}"/>' for i, r in enumerate(rows) if r[3] == "derivative"
    )
    structure += "".join(
        f'<EventIndicator valueReference="{2000 + i}"/>' for i in range(0 if co else equations.indicators)
    )
    kind = "CoSimulation" if co else "ModelExchange"
    return (
        '<?xml version="1.0" encoding="UTF-8"?><fmiModelDescription fmiVersion="3.0" modelName="truck" '
        f'instantiationToken="{{token}}" generationTool="tests"><{kind} modelIdentifier="truck" '
        f"{equations.interface_attributes}/>{_units(equations)}<ModelVariables>{''.join(variables)}</ModelVariables>"
        f"<ModelStructure>{structure}</ModelStructure></fmiModelDescription>"
    )


SPRING = Equations(
    inputs={"delta": "deg", "force": ""},
    outputs={"rate": "deg", "beta": "rad"},
    parameters={"body.m": ("kg", 2.0, 'min="1" max="3"'), "k": ("", 5.0)},
    states={"angle": 0.0, "velocity": 0.1},
    code="dx[0] = x[1]; dx[1] = (u[0] + u[1] - p[1] * x[0]) / p[0]; y[0] = x[1]; y[1] = x[0] + 0.1 * u[0];",
)
"""A small model: a mass on a spring, with feed-through."""

SPRING_MAP = {
    "inputs": {"steering_wheel_angle": "delta"},
    "outputs": {"heading": "rate", "sideslip_angle": "beta"},
    "process_noise": {"side_force": {"variable": "force", "unit": "N"}},
    "parameters": {"mass": "body.m"},
}


def of_model(model, values: Mapping[str, float], published: Sequence[str]) -> Equations:
    """Return the equations of a vehicle of the harness as C, with what it publishes under the names of the signals."""
    import sympy as sp

    from harness.engine.codegen.derivatives import derive
    from harness.models.signals import SIGNALS

    derived = derive(model, published, jacobians=False)

    def written(expression: sp.Expr) -> str:
        return str(sp.ccode(expression, user_functions={"larger": "fmax", "smaller": "fmin"}))

    def read(names: Sequence[str], array: str) -> list[str]:
        return [f"const double {name} = {array}[{i}];" for i, name in enumerate(names)]

    lines = [*read(model.inputs, "u"), *read(model.parameter_names, "p"), *read(model.states, "x")]
    for name, value in {**derived.constants, **derived.assignments}.items():
        lines.append(f"const double {name} = {written(value)};")
    lines += [f"dx[{i}] = {written(value)};" for i, value in enumerate(derived.derivatives)]
    lines += [f"y[{i}] = {written(derived.signals[name])};" for i, name in enumerate(published)]
    starts = {state: model.start.get(state, 0.0) for state in model.states}
    first = {f"x.{state}": float(values.get(v, 0.0) if isinstance(v, str) else v) for state, v in starts.items()}
    return Equations(
        inputs={name: SIGNALS[name].unit for name in model.inputs},
        outputs={name: SIGNALS[name].unit for name in published},
        parameters={p.name: (p.unit, float(values[p.name])) for p in model.parameters},
        states=first,
        code="\n".join(lines),
    )
