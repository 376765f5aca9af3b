"""A plant as one C source: its equations, integrated as in studies, and the functions that a simulation calls."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from importlib.metadata import version
from types import FunctionType
from typing import Any

from harness.common.errors import UserError
from harness.config import StudySpec
from harness.config.specs import ModelSpec
from harness.engine.c99 import values as v
from harness.engine.c99.program import Program
from harness.engine.c99.values import Array, Root
from harness.engine.compile import CompiledModel, compile_model, load_source, paste
from harness.engine.kernel_source import Kernel
from harness.models.assembly.degradation import apart
from harness.models.contracts import Profile
from harness.models.roles import SENSORS
from harness.realtime.export import plant_kernels
from harness.realtime.export.interface import Quantity, name_in_c, of_parameters, of_signals
from harness.realtime.export.library import Member, MemoryLayout, Precision
from harness.realtime.export.source import array_of, comment, mentioned, structure, with_kernels
from harness.simulation.drives import profile_of
from harness.simulation.simulate import input_table


@dataclass(frozen=True)
class PlantExport:
    """A plant as C.

    Attributes:
        name: That everything in C begins with.
        title: What it is, one line.
        study: Digest of the study.
        step: Sample time in s.
        precision: Of the numbers.
        inputs: What drives it, with the values at the beginning of the study's first drive.
        signals, parameters: What comes out, and what it is.
        states: Names of those signals that are states.
        first: States that begin at a number of their own.
        begins: Where each state begins, in C.
        kernels: Tables and functions.
        begin, move, tell: Statements of ``begin_plant``, ``move_plant`` and ``tell_plant``.
        members: What it holds.
    """

    name: str
    title: str
    study: str
    step: float
    precision: Precision
    inputs: tuple[Quantity, ...]
    signals: tuple[Quantity, ...]
    parameters: tuple[Quantity, ...]
    states: tuple[str, ...]
    first: tuple[Quantity, ...]
    begins: tuple[str, ...]
    kernels: str
    begin: list[str]
    move: list[str]
    tell: list[str]
    members: list[Member]

    @property
    def answer(self) -> str:
        """What it is, in a sentence."""
        lines = source(self).count("\n")
        return (
            f"{self.title} in C: {lines:,} lines, a step of {self.step:g} s, without noise; {self.precision} precision"
        )


def driven(study: StudySpec, believed: bool) -> ModelSpec:
    """Return the model of a plant: that of a study, or what it believes without anything that is estimated with it.

    Its sensors are not degraded.

    Raises:
        UserError: If it is somebody else's.
    """
    spec = study.plant
    if believed:
        spec = dataclasses.replace(study.belief, unknown_inputs=(), parameter_states=())
    if spec.external is not None:
        raise UserError(f"study '{study.name}': its plant cannot be exported: it has no equations of the harness")
    return dataclasses.replace(spec, effects=tuple(apart(spec.effects)[0]))


def printed_plant(
    study: StudySpec, believed: bool = False, precision: Precision = "double", name: str | None = None
) -> PlantExport:
    """Return the plant of a study as C, without noise and degradations of sensors.

    Args:
        study: The study.
        believed: Whether it is what the study believes.
        precision: Of the numbers.
        name: That everything in C begins with; the study's and ``plant`` by default.

    Raises:
        UserError: If it cannot be printed.
    """
    spec = driven(study, believed)
    model = spec.model()
    signals = tuple(dict.fromkeys([*SENSORS.load(spec.sensors).OUTPUTS.values(), *study.targets, *model.states]))
    compiled = compile_model(model, spec.step, spec.integrator, spec.substeps, signals, jacobians=False)
    title = f"the plant of study '{study.name}' cannot be exported"
    if compiled.kernels.CONDITIONS:
        raise UserError(f"{title}: effects of its model may be absent; state one with those that are there")
    parameters = of_parameters(compiled, [float(spec.values[n]) for n in model.parameter_names])
    profile = profile_of(study.plant, study.drives[0])
    inputs = tuple(
        dataclasses.replace(q, value=float(value))
        for q, value in zip(of_signals(model.inputs), input_table(profile, model)[0], strict=True)
    )
    first, begins = _first(compiled, profile, parameters, inputs)
    kernels, (begin, move, tell), members = _printed(title, compiled)
    words = " ".join(f"Plant of study '{study.name}'".split()).replace("*/", "* /")
    return PlantExport(
        name_in_c(name, f"{study.name}_plant"), words, study.hash, spec.step, precision, inputs, of_signals(signals),
        parameters, model.states, first, begins, kernels, begin, move, tell, members,
    )  # fmt: skip


def _first(
    compiled: CompiledModel, profile: Profile, parameters: Sequence[Quantity], inputs: Sequence[Quantity]
) -> tuple[tuple[Quantity, ...], tuple[str, ...]]:
    """Return the states that begin at a number of their own, and where each state begins in C."""
    places = {q.name: f"values->parameters.{q.field}" for q in parameters}
    places |= {q.name: f"inputs->{q.field}" for q in inputs}
    first, begins = [], []
    for quantity in of_signals(compiled.model.states):
        start = compiled.model.start.get(quantity.name, 0.0)
        if isinstance(start, str) and start in places:
            begins.append(places[start])
            continue
        if isinstance(start, str):
            start = float(getattr(profile, start)[0])
        first.append(dataclasses.replace(quantity, value=start))
        begins.append(f"values->first.{quantity.field}")
    return tuple(first), tuple(begins)


def _printed(title: str, compiled: CompiledModel) -> tuple[str, list[list[str]], list[Member]]:
    """Return tables and functions, the statements of the three kernels, and what a plant holds."""
    functions: list[Kernel] = [plant_kernels.begin_plant, plant_kernels.move_plant, plant_kernels.tell_plant]
    module = load_source("printed_plant", paste(compiled, "export of a plant", functions))
    program, memory = Program(title), MemoryLayout()

    def function(of: Any) -> FunctionType:
        return getattr(module, of.__name__).py_func

    nx, nu, ns = compiled.nx, compiled.nu, len(compiled.signal_names)
    c = memory.array("constants", (compiled.nc, 1), "of the model, from its parameters")
    x = memory.array("state", (nx, 1), "of the model")
    ahead, work = memory.array("ahead", (nx, 1), "scratch"), memory.array("work", (compiled.nw, 1), "scratch")
    signals = memory.array("signals", (ns, 1), "of a sample")
    beyond = memory.array("outside", (1, 1), "1 where the state is beyond its limits or no number")
    p, u, first = (
        Array("real", shape, Root(place), v.whole(0))
        for place, shape in (("p", (1, len(compiled.model.parameters), 1)), ("u", (nu, 1)), ("first", (nx, 1)))
    )
    limits = program.table("limits", compiled.model.limits)
    lines = [
        program.statements(function(kernel), arguments)[1]
        for kernel, arguments in (
            (functions[0], [p, first, c.reshaped((1, compiled.nc, 1)), x]),
            (functions[1], [x, u, c, ahead, work]),
            (functions[2], [x, u, c, limits, signals, beyond]),
        )
    ]
    return "\n\n".join(program.needed([each for part in lines for each in part])), lines, memory.members


def header(plant: PlantExport) -> str:
    """Return the text of the header."""
    name, upper, number = plant.name, plant.name.upper(), f"{plant.name}_real"
    counts = {"INPUTS": plant.inputs, "SIGNALS": plant.signals, "PARAMETERS": plant.parameters}
    defines = [
        f'#define {upper}_VERSION "{version("robustness-harness")}" /* of the robustness harness */',
        f'#define {upper}_STUDY "{plant.study}"',
        f"#define {upper}_STEP {plant.step!r} /* s, of a step */",
        *(f"#define {upper}_{key} {len(group)}" for key, group in counts.items()),
    ]
    groups: Mapping[str, tuple[str, Sequence[Quantity]]] = {
        "parameters": ("of the vehicle", plant.parameters), "first": ("first states", plant.first),
    }  # fmt: skip
    values = [comment("What it is: the study's by default."), "typedef struct {"]
    for group, (meaning, quantities) in groups.items():
        fields = [f"        {number} {q.field}; /* {q.says} */" for q in quantities] or [f"        {number} none;"]
        values += [f"    struct {{ /* {meaning} */", *fields, f"    }} {group};"]
    members = [f"    {number} {m.name}[{m.size}]; /* {m.meaning} */" for m in plant.members]
    return "\n\n".join([
        comment(
            f"{plant.title}, without noise. Printed by the robustness harness from the kernels that its studies run; "
            "do not edit. SI units; axes of ISO 8855: x forward, y left, z up. Nothing is allocated."
        ),
        f"#ifndef {upper}_H\n#define {upper}_H\n#include <stdbool.h>\n#ifdef __cplusplus\nextern \"C\" {{\n#endif",
        f"typedef {plant.precision} {number};",
        "\n".join(defines),
        structure(f"{name}_inputs", plant.inputs, number, "What drives it, held during a step.", "there is no input"),
        structure(f"{name}_signals", plant.signals, number, "What its sensors would measure, targets, states.", ""),
        "\n".join([*values, f"}} {name}_values;"]),
        "\n".join(["typedef struct {", *members, f"}} {name};"]),
        f"""/* Write the values of the study. */
void {name}_default({name}_values *values);

/* Begin a run; some states may begin at an input. */
void {name}_begin({name} *e, const {name}_values *values, const {name}_inputs *inputs);

/* Take a step of {plant.step:g} s. */
void {name}_step({name} *e, const {name}_inputs *inputs);

/* Write the signals of now; return whether the state is beyond what the equations hold for, or no number. */
bool {name}_tell({name} *e, const {name}_inputs *inputs, {name}_signals *signals);""",
        "#ifdef __cplusplus\n}\n#endif\n#endif",
    ]) + "\n"  # fmt: skip


def source(plant: PlantExport) -> str:
    """Return the text of the source."""
    name = plant.name

    def arrays(lines: Sequence[str], **places: Sequence[str]) -> list[str]:
        return [array_of(array, fields) for array, fields in places.items() if fields and mentioned(array, lines)]

    u = [f"inputs->{q.field}" for q in plant.inputs]
    p = [f"values->parameters.{q.field}" for q in plant.parameters]
    defaults = [f"void {name}_default({name}_values *values) {{"]
    for group, quantities in (("parameters", plant.parameters), ("first", plant.first)):
        defaults += [f"    values->{group}.{q.field} = {float(q.value or 0.0)!r};" for q in quantities]
        defaults += [] if quantities else [f"    values->{group}.none = 0.0;"]
    begin = [
        f"void {name}_begin({name} *e, const {name}_values *values, const {name}_inputs *inputs) {{",
        *arrays(plant.begin, p=p, first=plant.begins), "    (void) values;", "    (void) inputs;",
        "    memset(e, 0, sizeof *e);", *plant.begin, "}",
    ]  # fmt: skip
    step = [
        f"void {name}_step({name} *e, const {name}_inputs *inputs) {{",
        *arrays(plant.move, u=u), "    (void) inputs;", *plant.move, "}",
    ]  # fmt: skip
    tell = [
        f"bool {name}_tell({name} *e, const {name}_inputs *inputs, {name}_signals *signals) {{",
        *arrays(plant.tell, u=u), "    (void) inputs;", *plant.tell,
        *(f"    signals->{q.field} = e->signals[{i}];" for i, q in enumerate(plant.signals)),
        "    return e->outside[0] > 0.0;", "}",
    ]  # fmt: skip
    functions = ["\n".join(part) for part in ([*defaults, "}"], begin, step, tell)]
    return with_kernels(plant.title, name, plant.precision, plant.kernels, functions)


def files(plant: PlantExport) -> dict[str, str]:
    """Return header and source by file name."""
    return {f"{plant.name}.h": header(plant), f"{plant.name}.c": source(plant)}
