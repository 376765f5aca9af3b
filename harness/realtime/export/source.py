"""Header and source of an exported estimator."""

from __future__ import annotations

import re
import textwrap
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from importlib.metadata import version

from harness.engine.c99.program import in_single_precision
from harness.realtime.export.interface import Interface, Quantity
from harness.realtime.export.library import Library, Member, Precision
from harness.realtime.export.monitor import Monitor
from harness.runner.monitor import CONTRADICTED, REASON_NAMES, REASONS, TRUSTED, UNPROVEN

WIDTH = 112


@dataclass(frozen=True)
class Export:
    """An estimator that leaves the harness.

    Attributes:
        name: C identifier that everything begins with.
        title: What it is, in words.
        library: Its kernels.
        interface: What it gets and gives.
        precision: Of its numbers.
        step: Sample time in s.
        variances: Of process noise, measurement noise and first states, and the first states, as the study believes.
        factors: By which noise and first variances differ from those of the study's belief, because it is tuned.
        study: Digest of the study.
        settings: Of the estimator, in words.
        monitor: Its monitor, if there is one.
    """

    name: str
    title: str
    library: Library
    interface: Interface
    precision: Precision
    step: float
    variances: dict[str, Sequence[float]]
    factors: dict[str, Sequence[float]]
    study: str
    settings: str
    monitor: Monitor | None = None

    @property
    def memory(self) -> int:
        """Bytes of an estimator."""
        size = 8 if self.precision == "double" else 4
        return size * (1 + sum(m.size for m in self.library.members))

    def quantities(self, group: str) -> tuple[Quantity, ...]:
        """Return the quantities that a group of what is believed has a number for."""
        if group == "parameters":
            return self.interface.parameters
        return self.interface.measurements if group == "measurement_noise" else self.interface.states

    def values(self, group: str) -> Sequence[float]:
        """Return what the study believes of a group."""
        if group == "parameters":
            return [q.value or 0.0 for q in self.interface.parameters]
        return self.variances[group]


BELIEVED = {
    "parameters": "of the vehicle",
    "process_noise": "variance that a sample adds to each state",
    "measurement_noise": "variance of each measurement",
    "first": "first state",
    "first_variance": "variance of each first state",
}
"""What an estimator believes, in the order in which a study hands it over; values are those of the study."""


def comment(text: str, margin: str = "") -> str:
    """Return text as a comment; its lines are paragraphs."""
    lines = [line for part in text.split("\n") for line in textwrap.wrap(part, WIDTH - len(margin) - 6)]
    return f"{margin}/* " + f"\n{margin} * ".join(lines) + " */"


def structure(name: str, quantities: Sequence[Quantity], number: str, what: str, empty: str) -> str:
    """Return a structure with a field for each quantity; one of none has a number of no meaning."""
    fields = [f"    {number} {q.field}; /* {q.says} */" for q in quantities] or [f"    {number} none; /* {empty} */"]
    return "\n".join([comment(what), "typedef struct {", *fields, f"}} {name};"])


def header(export: Export) -> str:
    """Return the text of the header."""
    name, upper, number = export.name, export.name.upper(), f"{export.name}_real"
    face, values = (
        export.interface,
        [
            f'#define {upper}_VERSION "{version("robustness-harness")}" /* of the robustness harness */',
            f'#define {upper}_STUDY "{export.study}"',
            f'#define {upper}_KERNELS "{export.library.digest}"',
            f"#define {upper}_STEP {export.step!r} /* s, from sample to sample */",
        ],
    )
    counts = {"INPUTS": face.inputs, "MEASUREMENTS": face.measurements, "ESTIMATES": face.estimates,
              "STATES": face.states, "PARAMETERS": face.parameters}  # fmt: skip
    parts = [
        comment(
            f"{export.title}. Printed by the robustness harness from the kernels that its studies run; do not edit. "
            f"{export.settings} SI units; axes of ISO 8855: x forward, y left, z up. An estimator has {export.memory} "
            "bytes of memory, which the caller keeps; nothing is allocated, nothing calls itself. Several may run."
        ),
        f"#ifndef {upper}_H\n#define {upper}_H\n#include <stdbool.h>\n#ifdef __cplusplus\nextern \"C\" {{\n#endif",
        f"typedef {export.precision} {number};",
        "\n".join(values + [f"#define {upper}_{key} {len(group)}" for key, group in counts.items()]),
        _places(upper, face.states),
        structure(f"{name}_inputs", face.inputs, number, "What is known, at a sample and held until the next.",
                   "there is no input"),
        structure(f"{name}_measurements", face.measurements, number, "What is measured at a sample; NaN is missing.",
                   "there is no measurement"),
        structure(f"{name}_signals", face.estimates, number, "What is estimated.", "nothing is estimated"),
        *([] if export.monitor is None else [_trust(upper, export.monitor)]),
        _outcome(name, number, export.monitor is not None),
        _belief(export, number),
        _memory(name, number, export.library.members),
        _functions(name),
        "#ifdef __cplusplus\n}\n#endif\n#endif",
    ]  # fmt: skip
    return "\n\n".join(parts) + "\n"


def _places(upper: str, states: Sequence[Quantity]) -> str:
    lines = [f"    {upper}_STATE_{q.field.upper()} = {i}, /* {q.says} */" for i, q in enumerate(states)]
    lines[-1] = lines[-1].replace(", /*", " /*", 1)
    return "\n".join([comment("Places of the states in mean and covariance."), "enum {", *lines, "};"])


def _trust(upper: str, monitor: Monitor) -> str:
    """Return levels of trust and their reasons, and how often the monitor was right."""
    of_level = {
        "TRUSTED": (TRUSTED, "all as in the runs in which the study kept its limits"),
        "UNPROVEN": (UNPROVEN, "outside of what was studied: nothing says that it is wrong, nor that it is right"),
        "CONTRADICTED": (CONTRADICTED, "the innovations are not those of the vehicle that is believed"),
    }
    levels = [f"    {upper}_{name} = {level}, /* {meaning} */" for name, (level, meaning) in of_level.items()]
    names = zip(REASON_NAMES, REASONS.items(), strict=True)
    reasons = [f"    {upper}_{name} = {bit}, /* {meaning} */" for name, (bit, meaning) in names]
    reasons[-1] = reasons[-1].replace(", /*", " /*", 1)
    levels[-1] = levels[-1].replace(", /*", " /*", 1)
    return "\n".join([
        comment("\n".join(["Whether the estimate is to be trusted. In the study of this estimator:", *monitor.says])
                .replace("*/", "* /")), "enum {", *levels, "};\n",
        comment("Why it is not; bits that may come together."), "enum {", *reasons, "};",
    ])  # fmt: skip


def _outcome(name: str, number: str, watched: bool) -> str:
    outside = "whether the state is beyond what the equations hold for, or no number: begin anew"
    trust = f"""
    int trust; /* level: 0, 1 or 2 */
    int reasons; /* bits */
    {number} evidence; /* largest statistic of the innovations over its bound; above 1 the level is 2 */"""
    return f"""/* What a step says. */
typedef struct {{
    {name}_signals value;
    {name}_signals deviation; /* standard deviations; NaN of an estimator that states none */
    {number} nis; /* normalised innovation squared, of chi-square with as many degrees as used */
    {number} log_likelihood; /* of the measurements of the sample */
    {number} used; /* measurements that were there */
    {number} repaired; /* 1 where a factor of a covariance had to be repaired, else 0 */
    bool outside; /* {outside} */{trust if watched else ""}
}} {name}_outcome;"""


def _belief(export: Export, number: str) -> str:
    lines = [comment("What is believed; of parameters, noise and first states."), "typedef struct {"]
    for group, meaning in BELIEVED.items():
        lines += [f"    struct {{ /* {meaning} */"]
        quantities = export.quantities(group)
        lines += [f"        {number} {q.field}; /* {_of(group, q)} */" for q in quantities] or [
            f"        {number} none;"
        ]
        lines += [f"    }} {group};"]
    return "\n".join([*lines, f"}} {export.name}_belief;"])


def _of(group: str, quantity: Quantity) -> str:
    return f"({quantity.unit})^2" if group.endswith(("noise", "variance")) else quantity.says


def _memory(name: str, number: str, members: Sequence[Member]) -> str:
    lines = [f"    {number} {m.name}[{m.size}]; /* {m.meaning} */" for m in members]
    return "\n".join([comment("An estimator; read what you like, and write nothing but to go on from a state "
                               "that was kept: mean, covariance, memory and inputs_before, with begun."),
                      "typedef struct {", "    bool begun;", *lines, f"}} {name};"])  # fmt: skip


def _functions(name: str) -> str:
    return f"""/* Write what the study believes. */
void {name}_believe({name}_belief *belief);

/* Begin a run. */
void {name}_begin({name} *e, const {name}_belief *belief);

/* Take one sample. The first one behind {name}_begin uses no measurement: its outcome is the first state's. */
void {name}_step({name} *e, const {name}_inputs *inputs, const {name}_measurements *measurements,
                 {name}_outcome *outcome);"""


_PRELUDE = {
    "double": """typedef double real;
#define real_abs fabs
#define real_copysign copysign
#define real_floor floor
#define real_fma fma
#define real_sqrt sqrt""",
    "float": """typedef float real;
#define real_abs fabsf
#define real_copysign copysignf
#define real_floor floorf
#define real_fma fmaf
#define real_sqrt sqrtf""",
}

_POWER = """/* 2 to the power k, a whole number. */
static real power_of_two(real k) {
    UNSIGNED bits;
    real power;
    if (!(k >= -SMALLEST.0)) {
        return k < 0.0 ? 0.0 : (real) NAN;
    }
    if (k > BIAS.0) {
        return (real) INFINITY;
    }
    bits = (UNSIGNED) ((int) k + BIAS) << MANTISSA;
    memcpy(&power, &bits, sizeof power);
    return power;
}"""

_EXPONENT = """/* The exponent e of x = m 2^e with 1 <= m < 2, of a positive normal number. */
static real exponent_of(real x) {
    UNSIGNED bits;
    memcpy(&bits, &x, sizeof bits);
    return (real) ((int) (bits >> MANTISSA) - BIAS);
}"""

_LAYOUT = {
    "double": {"UNSIGNED": "uint64_t", "SMALLEST": "1022", "BIAS": "1023", "MANTISSA": "52"},
    "float": {"UNSIGNED": "uint32_t", "SMALLEST": "126", "BIAS": "127", "MANTISSA": "23"},
}


def source(export: Export) -> str:
    """Return the text of the source."""
    functions = [_believe(export), _begin(export), _step(export)]
    return with_kernels(export.title, export.name, export.precision, export.library.source, functions)


def with_kernels(title: str, name: str, precision: Precision, kernels: str, functions: Sequence[str]) -> str:
    """Return the text of a source: kernels, and the functions over them that its header declares."""
    layout = _LAYOUT[precision]
    needed = [
        text for text, function in ((_POWER, "power_of_two("), (_EXPONENT, "exponent_of(")) if function in kernels
    ]
    bits = [_filled(text, layout) for text in needed]
    parts = [
        comment(f"{title}: see {name}.h. Printed by the robustness harness; do not edit."),
        "\n".join([f'#include "{name}.h"', "", "#include <math.h>", *(["#include <stdint.h>"] if bits else []),
                   "#include <string.h>"]),
        '#ifdef __FAST_MATH__\n#error "no -ffast-math: NaN is a missing measurement, and sums have an order"\n#endif',
        _PRELUDE[precision],
        *bits,
        kernels,
        *functions,
    ]  # fmt: skip
    text = "\n\n".join(parts)
    if precision == "float":
        text = in_single_precision(text)
    return "\n".join(wrapped(text)) + "\n"


def _filled(text: str, layout: dict[str, str]) -> str:
    return re.sub("|".join(layout), lambda match: layout[match[0]], text)


def _believe(export: Export) -> str:
    lines = [f"void {export.name}_believe({export.name}_belief *belief) {{"]
    for group in BELIEVED:
        quantities, values = export.quantities(group), export.values(group)
        lines += [f"    belief->{group}.{q.field} = {float(x)!r};" for q, x in zip(quantities, values, strict=True)]
        lines += [] if quantities else [f"    belief->{group}.none = 0.0;"]
    return "\n".join([*lines, "}"])


def array_of(name: str, places: Sequence[str]) -> str:
    """Return the statement that gathers numbers in an array."""
    return f"    const real {name}[{len(places)}] = {{{', '.join(places)}}};"


def mentioned(name: str, lines: Sequence[str]) -> bool:
    """Return whether lines of C mention a name."""
    return any(re.search(rf"\b{name}\b", line) for line in lines)


def _begin(export: Export) -> str:
    lines = [f"void {export.name}_begin({export.name} *e, const {export.name}_belief *belief) {{"]
    for array, group in (("p", "parameters"), ("first", "first"), ("variance", "first_variance")):
        fields = [f"belief->{group}.{q.field}" for q in export.quantities(group)]
        if mentioned(array, export.library.begin) and fields:
            lines.append(array_of(array, fields))
    lines.append("    memset(e, 0, sizeof *e);")
    for group in ("process_noise", "measurement_noise"):
        lines += [f"    e->{group}[{i}] = belief->{group}.{q.field};" for i, q in enumerate(export.quantities(group))]
    return "\n".join([*lines, *export.library.begin, "}"])


def _step(export: Export) -> str:
    name, face, library = export.name, export.interface, export.library
    lines = [f"void {name}_step({name} *e, const {name}_inputs *inputs, const {name}_measurements *measurements, "
             f"{name}_outcome *outcome) {{"]  # fmt: skip
    for array, group, quantities in (("u", "inputs", face.inputs), ("y", "measurements", face.measurements)):
        used = [*library.take, *library.tell, "inputs_before[0] = u" if array == "u" else ""]
        if quantities and mentioned(array, used):
            lines.append(array_of(array, [f"{group}->{q.field}" for q in quantities]))
        else:
            lines.append(f"    (void) {group};")
    held = [f"        e->inputs_before[{i}] = u[{i}];" for i in range(len(face.inputs))]
    lines += [
        "    if (e->begun) {",
        *(f"    {line}" for line in library.take),
        "    } else {",
        "        e->begun = true;",
        "        e->nis[0] = (real) NAN;",
        *held,
        "    }",
        *library.tell,
    ]
    count = len(face.estimates)
    for i, q in enumerate(face.estimates):
        lines += [f"    outcome->value.{q.field} = e->estimates[{i}];",
                  f"    outcome->deviation.{q.field} = e->estimates[{count + i}];"]  # fmt: skip
    for field, member in (
        ("nis", "nis"),
        ("log_likelihood", "log_likelihood"),
        ("used", "seen"),
        ("repaired", "repairs"),
    ):
        lines.append(f"    outcome->{field} = e->{member}[0];")
    lines.append("    outcome->outside = e->outside[0] > 0.0;")
    if export.monitor is not None:
        lines += [f"    outcome->{field} = (int) e->trust[{i}];" for i, field in enumerate(("trust", "reasons"))]
        lines.append("    outcome->evidence = e->trust[2];")
    return "\n".join([*lines, "}"])


def wrapped(text: str) -> Iterator[str]:
    """Give the lines of C text, long ones broken."""
    for line in text.splitlines():
        if len(line) <= WIDTH or line.startswith("#"):
            yield line
            continue
        margin = line[: len(line) - len(line.lstrip())]
        yield from textwrap.wrap(
            line, WIDTH, subsequent_indent=margin + "        ", break_long_words=False, break_on_hyphens=False
        )
