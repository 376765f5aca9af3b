"""Model description and build description of an FMU (FMI 2.0.4, 2.2; FMI 3.0.1, 2.4)."""

from __future__ import annotations

import math
from collections.abc import Sequence
from importlib.metadata import version as installed
from xml.sax.saxutils import quoteattr

from harness.common.errors import UserError
from harness.common.units import scale
from harness.external.fmu.units import base_units, exponents
from harness.realtime.export.fmi.component import WITHOUT_UNIT, FmuComponent, ModelVariable

_FIRST_LINE = '<?xml version="1.0" encoding="UTF-8"?>'
FLAGS = "-std=c99 -ffp-contract=off"
"""Of the compiler: sums keep their order."""

_CAUSALITY = {"measurement": "input", "valid": "input", "time": "independent"}


def description(component: FmuComponent, version: int) -> str:
    """Return ``modelDescription.xml``.

    Args:
        component: What it describes.
        version: Of FMI, 2 or 3.
    """
    two = version == 2
    about = (
        "Outputs at the end of a communication step are those of the inputs and measurements that were set before it; "
        "of several steps of the model in one, measurements count at the last."
        if component.sampled
        else "Inputs are held during a communication step."
    )
    steps = f"Communication steps are multiples of {component.step:g} s."
    text = f"{component.title}. {about} {steps} SI units, axes of ISO 8855."
    head = {
        "fmiVersion": "2.0" if two else "3.0",
        "modelName": component.name,
        "guid" if two else "instantiationToken": component.token,
        "description": text,
        "generationTool": f"robustness harness {installed('robustness-harness')}",
        "variableNamingConvention": "flat",
    }
    step = repr(component.step)
    offers = {
        "modelIdentifier": component.name,
        "canHandleVariableCommunicationStepSize": "true",
        "canGetAndSetFMUstate" if two else "canGetAndSetFMUState": "true",
        "canSerializeFMUstate" if two else "canSerializeFMUState": "true",
        **({} if two else {"fixedInternalStepSize": step}),
    }
    if two:
        files = "".join(f"<File name={quoteattr(n)}/>" for n in compiled_files(component, version))
        interface = f"<CoSimulation{_attributes(offers)}><SourceFiles>{files}</SourceFiles></CoSimulation>"
    else:
        interface = f"<CoSimulation{_attributes(offers)}/>"
    return "\n".join([
        _FIRST_LINE, f"<fmiModelDescription{_attributes(head)}>", interface, _units(component.variables, two),
        '<LogCategories><Category name="logStatusError"/></LogCategories>',
        f'<DefaultExperiment startTime="0.0" stepSize="{step}"/>',
        "<ModelVariables>", *(_variable(v, i, component.sampled, two) for i, v in enumerate(component.variables)),
        "</ModelVariables>", "<ModelStructure>", *_structure(component, two), "</ModelStructure>",
        "</fmiModelDescription>",
    ]) + "\n"  # fmt: skip


def build_description(component: FmuComponent) -> str:
    """Return ``buildDescription.xml`` of FMI 3.0."""
    files = "".join(f"<SourceFile name={quoteattr(n)}/>" for n in compiled_files(component, 3))
    return (
        f'{_FIRST_LINE}\n<fmiBuildDescription fmiVersion="3.0"><BuildConfiguration modelIdentifier="{component.name}">'
        f'<SourceFileSet language="C99" compilerOptions="{FLAGS}">{files}</SourceFileSet>'
        '<Library name="m" external="true"/></BuildConfiguration></fmiBuildDescription>\n'
    )


def compiled_files(component: FmuComponent, version: int) -> list[str]:
    """Return the sources that a compiler takes."""
    return [*(name for name in component.files if name.endswith(".c")), f"fmi{version}.c"]


def _attributes(values: dict[str, str]) -> str:
    return "".join(f" {name}={quoteattr(value)}" for name, value in values.items())


def _units(variables: Sequence[ModelVariable], two: bool) -> str:
    names = sorted({v.unit for v in variables if v.type == "real" and v.unit not in WITHOUT_UNIT})
    return f"<UnitDefinitions>{''.join(map(_unit, names))}</UnitDefinitions>" if names else ""


def _unit(name: str) -> str:
    """Return the definition of a unit, without base units where powers are no whole numbers."""
    try:
        powers = exponents(name)
        factor = scale(name, base_units(powers), "unit")
    except UserError:
        return f"<Unit name={quoteattr(name)}/>"
    if any(int(power) != power for _, power in powers):
        return f"<Unit name={quoteattr(name)}/>"
    base = {base: str(int(power)) for base, power in powers} | ({} if factor == 1.0 else {"factor": repr(factor)})
    return f"<Unit name={quoteattr(name)}><BaseUnit{_attributes(base)}/></Unit>"


def _start(variable: ModelVariable) -> dict[str, str]:
    if variable.role in ("output", "time"):
        return {}
    if variable.type == "boolean":
        return {"start": "true" if variable.start else "false"}
    return {"start": "NaN" if math.isnan(variable.start) else repr(variable.start)}


def _variable(variable: ModelVariable, reference: int, sampled: bool, two: bool) -> str:
    """Return the element of a variable."""
    variability = "fixed" if variable.role == "parameter" else "discrete"
    if variable.role == "time" or (variable.type == "real" and variability == "discrete" and not sampled):
        variability = "continuous"
    whole = {
        "name": variable.name,
        "valueReference": str(reference),
        "causality": _CAUSALITY.get(variable.role, variable.role),
        "variability": variability,
        "description": variable.description,
    }
    number = _start(variable)
    if variable.type == "real" and variable.unit not in WITHOUT_UNIT:
        number["unit"] = variable.unit
    number |= {key: repr(float(bound)) for key, bound in (("min", variable.least), ("max", variable.most))
               if math.isfinite(bound)}  # fmt: skip
    if two:
        kind = {"real": "Real", "integer": "Integer", "boolean": "Boolean"}[variable.type]
        return f"<ScalarVariable{_attributes(whole)}><{kind}{_attributes(number)}/></ScalarVariable>"
    kind = {"real": "Float64", "integer": "Int32", "boolean": "Boolean"}[variable.type]
    return f"<{kind}{_attributes(whole | number)}/>"


def _structure(component: FmuComponent, two: bool) -> list[str]:
    """Return the outputs: which of them follow at once from inputs, and that all of them begin with the others."""
    outputs = [(i, v) for i, v in enumerate(component.variables) if v.role == "output"]
    key = "index" if two else "valueReference"
    first = 1 if two else 0
    direct = [f'{key}="{i + first}"' + ("" if v.direct else ' dependencies=""') for i, v in outputs]
    if two:
        unknown = "".join(f'<Unknown index="{i + 1}"/>' for i, _ in outputs)
        return [f"<Outputs>{''.join(f'<Unknown {each}/>' for each in direct)}</Outputs>",
                f"<InitialUnknowns>{unknown}</InitialUnknowns>"]  # fmt: skip
    return [*(f"<Output {each}/>" for each in direct), *(f'<InitialUnknown valueReference="{i}"/>' for i, _ in outputs)]
