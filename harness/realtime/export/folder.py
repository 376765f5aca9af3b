"""The folder of an exported estimator: what builds, tests and uses it."""

from __future__ import annotations

from collections.abc import Sequence
from importlib import resources

import numpy as np

from harness.common.arrays import Floats
from harness.common.files import toml_text
from harness.external.estimators.library import HEADER
from harness.realtime.export.interface import Quantity
from harness.realtime.export.source import BELIEVED, Export, header, source, wrapped
from harness.runner.contract import History
from harness.runner.monitor import REASONS

TOLERANCE = {"double": "1e-9", "float": "1e-2"}
"""Up to which a replay has to be as recorded, over the largest magnitude."""


def contents(
    export: Export,
    has_covariance: bool,
    inputs: Floats,
    measurements: Floats,
    history: History,
    trust: Floats | None = None,
) -> dict[str, str]:
    """Return the files of an exported estimator by name.

    Args:
        export: The estimator.
        has_covariance: Whether it states one.
        inputs: Of a recorded run ``(samples, nu)``.
        measurements: Of that run ``(samples, ny)``.
        history: What the harness estimated in it.
        trust: Levels and reasons of the monitor in it ``(samples, 2)``, if there is one.
    """
    name = export.name
    return {
        f"{name}.h": header(export),
        f"{name}.c": source(export),
        f"harness_{name}.c": "\n".join(wrapped(adapter(export))) + "\n",
        HEADER.name: HEADER.read_text(encoding="utf-8"),
        "main.c": "\n".join(wrapped(_main(export))) + "\n",
        "replay.csv": _replay(export, has_covariance, inputs, measurements, history, trust),
        "estimator.toml": study_table(export, has_covariance),
        "Makefile": _filled("Makefile", export),
        "CMakeLists.txt": _filled("CMakeLists.txt", export),
        "README.md": _filled(
            "README.md",
            export,
            TRUST=_trust(export),
            COLUMNS=_columns(export),
            WATCHED="" if export.monitor is None else ", `trust`, `reasons`",
        ),
    }


def _filled(template: str, export: Export, **more: str) -> str:
    text = resources.files("harness.realtime.export").joinpath("templates", template).read_text(encoding="utf-8")
    words = {"NAME": export.name, "UPPER": export.name.upper(), "TITLE": export.title, "STEP": f"{export.step:g}"}
    for word, meaning in (words | more).items():
        text = text.replace(f"@{word}@", meaning)
    return text


def _columns(export: Export) -> str:
    """Return the rows of the table of what a CSV has to have."""
    face = export.interface
    rows = [f"| `{q.name}` | input; {q.says} |" for q in face.inputs]
    rows += [f"| `{q.name}` | measurement, empty or nan where it is missing; {q.says} |" for q in face.measurements]
    return "\n".join([*rows, f"| `time` | s, from sample to sample {export.step:g}; may be left out |"])


def _trust(export: Export) -> str:
    """Return the section on the trust monitor; nothing without one."""
    if export.monitor is None:
        return ""
    levels = "0 trusted, 1 outside of what was studied, 2 contradicted by the innovations"
    rows = [f"| {bit} | {meaning} |" for bit, meaning in REASONS.items()]
    return "\n".join([
        "\n## When not to trust it\n", f"`outcome.trust`, and the column `trust` of the estimates: {levels}.",
        "`outcome.reasons` is the sum of\n", "| | |", "|--:|---|", *rows, "",
        *(f"* {sentence}" for sentence in export.monitor.says), "",
    ])  # fmt: skip


def results_of(export: Export) -> list[str]:
    """Return the names of what a step says."""
    estimates = [q.name for q in export.interface.estimates]
    trust = [] if export.monitor is None else ["trust", "reasons"]
    return [*(f"estimate_{n}" for n in estimates), *(f"deviation_{n}" for n in estimates), "nis", *trust]


def _quoted(names: Sequence[str]) -> str:
    return ", ".join(f'"{n}"' for n in names) or "NULL"


def filled_from(
    quantities: Sequence[Quantity], group: str, number: str, values: str, first: int = 0, factors: Sequence[float] = ()
) -> list[str]:
    """Return the lines that fill a structure from numbers, each times its factor."""
    times = [f"{f!r} * " if f != 1.0 else "" for f in factors] or [""] * len(quantities)
    lines = [
        f"    {group}.{q.field} = ({number}) {f'({t}{values}[{first + i}])' if t else f'{values}[{first + i}]'};"
        for i, (q, t) in enumerate(zip(quantities, times, strict=True))
    ]
    return lines or [f"    {group}.none = 0;"]


def _main(export: Export) -> str:
    name, face, number = export.name, export.interface, f"{export.name}_real"
    count = len(face.estimates)
    step = [
        *filled_from(face.inputs, "inputs", number, "values"),
        *filled_from(face.measurements, "measurements", number, "values", len(face.inputs)),
        f"    {name}_step(&estimator, &inputs, &measurements, &outcome);",
        *(f"    computed[{i}] = (double) outcome.value.{q.field};" for i, q in enumerate(face.estimates)),
        *(f"    computed[{count + i}] = (double) outcome.deviation.{q.field};" for i, q in enumerate(face.estimates)),
        f"    computed[{2 * count}] = outcome.used > 0 ? (double) outcome.nis : (double) NAN;",
    ]
    if export.monitor is not None:
        step += [
            f"    computed[{2 * count + 1 + i}] = (double) outcome.{n};" for i, n in enumerate(("trust", "reasons"))
        ]
    given = [q.name for q in (*face.inputs, *face.measurements)]
    return _filled(
        "main.c", export, GIVEN=_quoted(given), RESULTS=_quoted(results_of(export)), TAKE="\n".join(step),
        TOLERANCE=TOLERANCE[export.precision], COUNT=str(len(results_of(export))),
    )  # fmt: skip


def adapter(export: Export) -> str:
    """Return the source by which a study calls the estimator (``harness_estimator.h``)."""
    name, face, number = export.name, export.interface, f"{export.name}_real"
    lines, first = [], 0
    for group in BELIEVED:
        quantities = export.quantities(group)
        lines += filled_from(quantities, f"belief.{group}", number, "values", first, export.factors.get(group, ()))
        first += len(quantities)
    step = [
        *filled_from(face.inputs, "known", number, "inputs"),
        *filled_from(face.measurements, "measured", number, "measurements"),
    ]
    computed = []
    for i, q in enumerate(face.estimates):
        deviation = f"(double) outcome.deviation.{q.field}"
        computed += [
            f"    estimates[{i}] = (double) outcome.value.{q.field};",
            f"    variances[{i}] = {deviation} * {deviation};",
        ]
    sizes = f"{{{len(face.inputs)}, {len(face.measurements)}, {len(face.estimates)}, {first}, (int) sizeof({name})}}"
    unused = [f"    (void) {n};" for n, g in (("inputs", face.inputs), ("measurements", face.measurements)) if not g]
    return "\n".join([
        f"/* {export.title} as an estimator of a study: see estimator.toml. */",
        f'#include "harness_estimator.h"\n#include "{name}.h"\n\n#include <math.h>\n',
        "void harness_sizes(harness_sizes_t *sizes) {",
        f"    const harness_sizes_t own = {sizes};\n    *sizes = own;\n}}\n",
        "int harness_reset(void *state, const double *values, double step) {",
        f"    {name}_belief belief;", *lines, f"    {name}_begin(state, &belief);",
        f"    return fabs(step - {export.step!r}) < 1e-9 ? 0 : 1;\n}}\n",
        "int harness_step(void *state, const double *inputs, const double *measurements, double dt, double *estimates, "
        "double *variances, double *nis) {",
        f"    {name}_inputs known;\n    {name}_measurements measured;\n    {name}_outcome outcome;", *unused, *step,
        f"    {name}_step(state, &known, &measured, &outcome);", *computed,
        "    if (outcome.used > 0) {\n        *nis = (double) outcome.nis;\n    }",
        "    return dt > 0.0 && outcome.outside ? 1 : 0;\n}",
    ])  # fmt: skip


def study_table(export: Export, has_covariance: bool) -> str:
    """Return the table of a study that has the built library as an estimator."""
    face = export.interface
    believed = [q.name if g == "parameters" else f"{g}.{q.name}" for g in BELIEVED for q in export.quantities(g)]
    table = {
        "name": f"{export.name} in C",
        "kind": "external",
        "library": f"lib{export.name}.so",
        "inputs": [q.name for q in face.inputs],
        "measurements": [q.name for q in face.measurements],
        "estimates": [q.name for q in face.estimates],
        "values": believed,
        "variances": has_covariance,
        "nis": has_covariance,
    }
    return toml_text({"estimator": [table]})


def _replay(
    export: Export,
    has_covariance: bool,
    inputs: Floats,
    measurements: Floats,
    history: History,
    trust: Floats | None,
) -> str:
    """Return the CSV of a recorded run, to the last digit."""
    face = export.interface
    time = export.step * np.arange(len(inputs))
    names = ["time", *(q.name for q in (*face.inputs, *face.measurements)), *results_of(export)]
    nis = np.where(history.facts[:, 1] > 0, history.facts[:, 0], np.nan)
    table = np.column_stack([time, inputs, measurements, history.estimate, history.deviation, nis])
    table = table if trust is None else np.column_stack([table, trust])
    if not has_covariance:
        names = names[: 1 + inputs.shape[1] + measurements.shape[1] + history.estimate.shape[1]]
    lines = (",".join(map(repr, row)) for row in table[:, : len(names)].tolist())
    return "\n".join([",".join(names), *lines]) + "\n"
