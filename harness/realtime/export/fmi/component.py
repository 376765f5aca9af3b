"""Exported C as a model of FMI: its variables, and the C between them and the functions of the export."""

from __future__ import annotations

import hashlib
import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Literal

from harness.realtime.export.folder import filled_from
from harness.realtime.export.interface import Quantity
from harness.realtime.export.plant import PlantExport, files
from harness.realtime.export.source import BELIEVED, Export, header, source

Role = Literal["input", "measurement", "valid", "parameter", "output", "time"]
Type = Literal["real", "integer", "boolean"]


@dataclass(frozen=True)
class ModelVariable:
    """A variable of an FMU.

    Attributes:
        name: No two have the same.
        role: An input that has to be there, a measurement that may be missing, whether it is there, ...
        description: Frame and meaning.
        unit: SI; 1 of what has none.
        type: Of its values.
        start: Of what can be set.
        direct: Whether an output depends on the inputs of the same time.
        least, most: What it may be, infinite where nothing bounds it; of a variance 0 and more.
    """

    name: str
    role: Role
    description: str
    unit: str = "1"
    type: Type = "real"
    start: float = 0.0
    direct: bool = False
    least: float = -math.inf
    most: float = math.inf


@dataclass(frozen=True)
class FmuComponent:
    """What an FMU is made of.

    Attributes:
        name: Of the model and its library.
        title: What it is, one line.
        step: Of the model in s; communication steps are multiples.
        sampled: Whether it acts at samples only, rather than in continuous time.
        variables: In the order of their value references.
        functions: C of ``model``, ``model_begin``, ``model_step`` and ``model_follow``.
        files: Sources by name, the header too.
    """

    name: str
    title: str
    step: float
    sampled: bool
    variables: tuple[ModelVariable, ...]
    functions: str
    files: Mapping[str, str]

    @property
    def token(self) -> str:
        """Of variables and code, as FMI 2.0 calls it the GUID."""
        text = "\n".join([self.functions, *self.files.values(), *map(repr, self.variables)])
        code = hashlib.sha256(text.encode()).hexdigest()
        return f"{{{code[:8]}-{code[8:12]}-{code[12:16]}-{code[16:20]}-{code[20:32]}}}"

    @property
    def model_header(self) -> str:
        """``fmi_model.h``: the table of the variables, and the functions."""
        rows = [
            f"    {{\"{_escaped(v.name)}\", '{v.role[0]}', '{v.type[0]}', {_number(v.start)}, {_number(v.least)}, "
            f"{_number(v.most)}}},"
            for v in self.variables
        ]
        return "\n".join([
            f"/* {self.title}: variables by value reference, and the model behind them. */",
            f'#include "{self.name}.h"\n\n#include <math.h>\n',
            f'#define MODEL_NAME "{self.name}"\n#define MODEL_TOKEN "{self.token}"\n#define MODEL_STEP {self.step!r}',
            f"#define VARIABLES {len(rows)}\n#define TIME {len(rows) - 1}\n",
            "/* Roles: " + ", ".join(f"{r[0]} {r}" for r in _ROLES) + "; types: real, integer, boolean. */",
            "static const struct {\n    const char *name;\n    char role, type;\n    double start, least, most;\n} "
            "variables[VARIABLES] = {",
            *rows,
            f"}};\n\n{self.functions}",
        ])  # fmt: skip


_ROLES: tuple[Role, ...] = ("input", "measurement", "valid", "parameter", "output", "time")
WITHOUT_UNIT = ("1", "", "dimensionless")
"""What stands for a unit where there is none."""

_VARIANCES = ("process_noise", "measurement_noise", "first_variance")

_CLOCK = ModelVariable("time", "time", "simulation time", "s")


def _escaped(name: str) -> str:
    return name.replace("\\", "\\\\").replace('"', '\\"')


def _number(value: float) -> str:
    if math.isinf(value):
        return "INFINITY" if value > 0 else "-INFINITY"
    return "NAN" if math.isnan(value) else repr(float(value))


def _distinct(variables: Iterable[ModelVariable]) -> tuple[ModelVariable, ...]:
    """Return variables of which no two have one name."""
    taken, result = {_CLOCK.name}, []
    for each in variables:
        name = each.name
        while name in taken:
            name = f"{name}_"
        taken.add(name)
        result.append(replace(each, name=name))
    return tuple(result)


def _described(quantity: Quantity) -> str:
    """Return meaning and frame."""
    _, *frame, meaning = (part.strip() for part in f"{quantity.says};".rstrip(";").split(";"))
    return "; ".join([meaning, *frame])


def _squared(unit: str) -> str:
    return unit if unit in WITHOUT_UNIT else f"({unit})^2"


def of_estimator(export: Export, has_covariance: bool, first: Sequence[float]) -> FmuComponent:
    """Return an estimator as a model of FMI.

    Args:
        export: The estimator.
        has_covariance: Whether it states one.
        first: Inputs to begin with, where an importer sets none.
    """
    face, name, number = export.interface, export.name, f"{export.name}_real"
    known = [
        ModelVariable(q.name, "input", _described(q), q.unit, start=value)
        for q, value in zip(face.inputs, first, strict=True)
    ]
    measured = [
        ModelVariable(q.name, "measurement", f"measured: {_described(q)}; NaN where it is missing", q.unit,
                      start=math.nan)
        for q in face.measurements
    ]  # fmt: skip
    valid = [
        ModelVariable(f"valid_{q.name}", "valid", f"whether {q.name} is measured at this sample", type="boolean",
                      start=1.0)
        for q in face.measurements
    ]  # fmt: skip
    believed = [
        ModelVariable(
            q.name if group == "parameters" else f"{group}.{q.name}", "parameter",
            f"believed: {_described(q)}" if group == "parameters" else f"believed {meaning}: {_described(q)}",
            _squared(q.unit) if group in _VARIANCES else q.unit, start=value,
            least=0.0 if group in _VARIANCES else q.lower, most=math.inf if group in _VARIANCES else q.upper,
        )
        for group, meaning in BELIEVED.items()
        for q, value in zip(export.quantities(group), export.values(group), strict=True)
    ]  # fmt: skip
    results = [
        (ModelVariable(f"estimate_{q.name}", "output", f"estimate: {_described(q)}", q.unit), f"value.{q.field}")
        for q in face.estimates
    ]
    results += [(v, f"deviation.{q.field}") for v, q in zip(_deviations(face.estimates), face.estimates, strict=True)]
    results += [(_NIS, "nis"), (_LIKELIHOOD, "log_likelihood")]
    results = results if has_covariance else results[: len(face.estimates)]
    results += [(_USED, "used"), (_OUTSIDE, "outside")]
    results += [] if export.monitor is None else [(v, v.name) for v in _WATCHED]
    begin = len(known) + len(measured) + len(valid)
    variables = _distinct([*known, *measured, *valid, *believed, *(v for v, _ in results)])
    functions = _OF_ESTIMATOR.format(
        name=name,
        inputs="\n".join(filled_from(face.inputs, "inputs", number, "v")),
        measurements="\n".join(_measurement(face.measurements, number, len(known))),
        belief="\n".join(_belief(export, number, begin)),
        outputs=_outputs([of for _, of in results], begin + len(believed)),
    )
    texts = {f"{name}.h": header(export), f"{name}.c": source(export)}
    return FmuComponent(name, export.title, export.step, True, (*variables, _CLOCK), functions, texts)


def _deviations(estimates: Sequence[Quantity]) -> list[ModelVariable]:
    meaning = "standard deviation of the estimate of"
    return [ModelVariable(f"deviation_{q.name}", "output", f"{meaning} {q.name}", q.unit) for q in estimates]


_NIS = ModelVariable("nis", "output", "normalised innovation squared, chi-square of as many degrees as used; 0 of none")
_LIKELIHOOD = ModelVariable("log_likelihood", "output", "of the measurements of the sample")
_USED = ModelVariable("used", "output", "measurements used at this sample", type="integer")
_OUTSIDE = ModelVariable(
    "outside", "output", "the state is beyond what the equations hold for, or no number", type="boolean"
)

_WATCHED = (
    ModelVariable("trust", "output", "level of the trust monitor: 0, 1 or 2", type="integer"),
    ModelVariable("reasons", "output", "of the trust monitor: bits, named in the header", type="integer"),
    ModelVariable("evidence", "output", "largest statistic of the innovations over its bound; above 1 trust is 2"),
)


def _measurement(measurements: Sequence[Quantity], number: str, first: int) -> list[str]:
    """Return the lines that fill the measurements: NaN of one that is not there."""
    count = len(measurements)
    lines = [
        f"    measurements.{q.field} = ({number}) (measured && v[{first + count + i}] != 0.0 ? v[{first + i}] "
        ": (double) NAN);"
        for i, q in enumerate(measurements)
    ]
    return lines or ["    measurements.none = 0;\n    (void) measured;"]


def _belief(export: Export, number: str, first: int) -> list[str]:
    lines = []
    for group in BELIEVED:
        quantities = export.quantities(group)
        lines += filled_from(quantities, f"belief.{group}", number, "v", first)
        first += len(quantities)
    return lines


def _outputs(fields: Sequence[str], first: int) -> str:
    lines = []
    for i, field in enumerate(fields):
        results = f"(double) outcome.{field}"
        if field == "nis":
            results = f"outcome.used > 0 ? {results} : 0.0"
        lines.append(f"    v[{first + i}] = {results if field != 'outside' else 'outcome.outside ? 1.0 : 0.0'};")
    return "\n".join(lines)


_OF_ESTIMATOR = """typedef {name} model;

/* Take a sample; what is not measured is missing. */
static void model_step(model *m, double *v, bool measured) {{
    {name}_inputs inputs;
    {name}_measurements measurements;
    {name}_outcome outcome;
{inputs}
{measurements}
    {name}_step(m, &inputs, &measurements, &outcome);
{outputs}
}}

/* Begin a run: the first sample uses no measurement. */
static void model_begin(model *m, double *v) {{
    {name}_belief belief;
{belief}
    {name}_begin(m, &belief);
    model_step(m, v, false);
}}

/* Outputs change at samples only. */
static void model_follow(model *m, double *v) {{
    (void) m, (void) v;
}}
"""


def of_a_plant(plant: PlantExport) -> FmuComponent:
    """Return a plant as a model of FMI."""
    name, number = plant.name, f"{plant.name}_real"
    states = set(plant.states)
    inputs = [ModelVariable(q.name, "input", _described(q), q.unit, start=float(q.value or 0.0)) for q in plant.inputs]
    parameters = [
        ModelVariable(
            q.name, "parameter", _described(q), q.unit, start=float(q.value or 0.0), least=q.lower, most=q.upper
        )
        for q in plant.parameters
    ]
    first = [
        ModelVariable(
            f"first.{q.name}", "parameter", f"first state: {_described(q)}", q.unit, start=float(q.value or 0.0)
        )
        for q in plant.first
    ]
    results = [
        ModelVariable(q.name, "output", _described(q), q.unit, direct=q.name not in states) for q in plant.signals
    ]
    results.append(_OUTSIDE)
    outputs = len(inputs) + len(parameters) + len(first)
    lines = [f"    v[{outputs + i}] = (double) signals.{q.field};" for i, q in enumerate(plant.signals)]
    functions = _OF_PLANT.format(
        name=name,
        inputs="\n".join(filled_from(plant.inputs, "inputs", number, "v")),
        parameters="\n".join([
            *filled_from(plant.parameters, "values.parameters", number, "v", len(inputs)),
            *filled_from(plant.first, "values.first", number, "v", len(inputs) + len(parameters)),
        ]),
        outputs="\n".join([*lines, f"    v[{outputs + len(lines)}] = outside ? 1.0 : 0.0;"]),
    )  # fmt: skip
    variables = _distinct([*inputs, *parameters, *first, *results])
    return FmuComponent(name, plant.title, plant.step, False, (*variables, _CLOCK), functions, files(plant))


_OF_PLANT = """typedef {name} model;

static {name}_inputs inputs_of(const double *v) {{
    {name}_inputs inputs;
    (void) v;
{inputs}
    return inputs;
}}

/* Let outputs follow from state and inputs. */
static void model_follow(model *m, double *v) {{
    const {name}_inputs inputs = inputs_of(v);
    {name}_signals signals;
    const bool outside = {name}_tell(m, &inputs, &signals);
{outputs}
}}

/* Take a step, the last of a communication step or not. */
static void model_step(model *m, double *v, bool last) {{
    const {name}_inputs inputs = inputs_of(v);
    {name}_step(m, &inputs);
    if (last) {{
        model_follow(m, v);
    }}
}}

/* Begin a run. */
static void model_begin(model *m, double *v) {{
    const {name}_inputs inputs = inputs_of(v);
    {name}_values values;
{parameters}
    {name}_begin(m, &values, &inputs);
    model_follow(m, v);
}}
"""
