"""Single steps of the C of an estimator against those of its kernel in Python, from a Sobol sequence.

A point of the sequence is a first state with its covariance, parameters and noise, and a few samples behind it: inputs,
and measurements, of which some are missing. What an estimator carries besides mean and covariance follows
from these.
"""

from __future__ import annotations

import subprocess
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy import special
from scipy.stats import qmc

from harness.common.arrays import Floats
from harness.common.files import write_files
from harness.engine.simd.lanes import LANES
from harness.estimation.compiled_estimator import CompiledEstimator
from harness.realtime.export.run import Exported
from harness.realtime.export.source import Export, header, source

SAMPLES = 8
"""Of a point behind its first state."""

MISSING = 0.2
"""Share of the measurements that are not there."""

WARNINGS = ("-std=c99", "-pedantic", "-Wall", "-Wextra", "-Wconversion", "-Werror", "-ffp-contract=off")
"""What C that is printed compiles with, without a word."""


@dataclass(frozen=True)
class Region:
    """Where points lie.

    Attributes:
        mean, mean_spread: Middle and half width of first states ``(nx,)``.
        deviation: Typical standard deviation of each state ``(nx,)``; those of points are up to ten times more or less.
        inputs, inputs_spread: Middle and half width ``(nu,)``.
        parameters: Middle; points are within 10 % ``(np,)``.
        process_noise: Middle; points are up to three times more or less ``(nx,)``.
        measurement_noise: The same ``(ny,)``.
    """

    mean: Floats
    mean_spread: Floats
    deviation: Floats
    inputs: Floats
    inputs_spread: Floats
    parameters: Floats
    process_noise: Floats
    measurement_noise: Floats


def around(run: Exported) -> Region:
    """Return the region that a recorded run went through."""
    mean, variance = run.history.mean, np.einsum("kii->ki", run.history.state_covariance)
    deviation = np.sqrt(np.where(np.isfinite(variance), variance, 0.0))
    typical = np.maximum(np.median(deviation, axis=0), 1e-3 * deviation.max(axis=0, initial=0.0))
    typical = np.where(typical > 0, typical, 1e-3 * (1.0 + np.abs(mean).max(axis=0)))
    low, high = mean.min(axis=0), mean.max(axis=0)
    least, most = run.inputs.min(axis=0), run.inputs.max(axis=0)
    return Region(
        0.5 * (low + high),
        0.5 * (high - low) + typical,
        typical,
        0.5 * (least + most),
        0.5 * (most - least) + 0.05 * np.abs(least + most),
        *(np.array(run.export.values(g)) for g in ("parameters", "process_noise", "measurement_noise")),
    )


@dataclass(frozen=True)
class Points:
    """Points of a sequence, all with their axis in front.

    Attributes:
        parameters, process_noise, measurement_noise: What is believed.
        mean, covariance: First state.
        inputs: At the samples, the first one included ``(points, 1 + SAMPLES, nu)``.
        surprise: Measurements minus those of the first state, in standard deviations; NaN where missing
            ``(points, SAMPLES, ny)``.
    """

    parameters: Floats
    process_noise: Floats
    measurement_noise: Floats
    mean: Floats
    covariance: Floats
    inputs: Floats
    surprise: Floats


@dataclass(frozen=True)
class Steps:
    """What an estimator holds behind each step, with the axes ``(points, SAMPLES)`` in front.

    Attributes:
        mean, covariance, memory: Its state.
        nis, log_likelihood, used, repaired: What it says of the sample.
    """

    mean: Floats
    covariance: Floats
    memory: Floats
    nis: Floats
    log_likelihood: Floats
    used: Floats
    repaired: Floats


def points(region: Region, first: int, count: int, seed: int = 0) -> Points:
    """Return points of a rotated Sobol sequence in a region, from one of its numbers on."""
    nx, nu, ny = len(region.mean), len(region.inputs), len(region.measurement_noise)
    sizes = (
        len(region.parameters), nx, ny, nx, nx, nx * (nx - 1) // 2, (1 + SAMPLES) * nu, SAMPLES * ny, SAMPLES * ny,
    )  # fmt: skip
    sequence = qmc.Sobol(sum(sizes), scramble=False)
    sequence.fast_forward(1 + first)  # the first point of all is the origin
    rotation = np.random.default_rng(seed).random(sum(sizes))
    numbers = (sequence.random(count) + rotation) % 1.0
    p, q, r, x, s, c, u, y, missing = np.split(numbers, np.cumsum(sizes)[:-1], axis=1)
    lower = np.zeros((count, nx, nx))
    lower[:, *np.tril_indices(nx, -1)] = 2 * c - 1
    lower[:, range(nx), range(nx)] = 1.0
    lower /= np.sqrt((lower**2).sum(axis=2, keepdims=True))
    factor = lower * (region.deviation * 10.0 ** (2 * s - 1))[:, :, None]
    surprise = 3.0 * special.ndtri(np.clip(y, 1e-6, 1 - 1e-6))
    surprise[missing < MISSING] = np.nan
    return Points(
        region.parameters * (0.9 + 0.2 * p),
        region.process_noise * 3.0 ** (2 * q - 1),
        region.measurement_noise * 3.0 ** (2 * r - 1),
        region.mean + region.mean_spread * (2 * x - 1),
        factor @ factor.transpose(0, 2, 1),
        (region.inputs + region.inputs_spread * (2 * u.reshape(count, 1 + SAMPLES, nu) - 1)),
        surprise.reshape(count, SAMPLES, ny),
    )


def in_python(estimator: CompiledEstimator, given: Points, before: Floats | None = None) -> tuple[Steps, Floats]:
    """Return the steps of the kernel that studies run, and the measurements ``(points, SAMPLES, ny)``.

    Each measurement lies about that of the estimate before, unless others are given. Points are whole batches.
    """
    compiled = estimator.compiled
    nx, ny, count = compiled.nx, compiled.ny, len(given.mean)
    rows = estimator.init(np.zeros(nx), np.zeros(nx)).memory.shape[0]
    mean, covariance = np.empty((count, SAMPLES, nx)), np.empty((count, SAMPLES, nx, nx))
    memory, said = np.empty((count, SAMPLES, rows)), np.empty((4, count, SAMPLES))
    measured = np.empty((count, SAMPLES, ny))
    for begin in range(0, count, LANES):
        chosen = slice(begin, begin + LANES)
        p, q, r, x, P = (
            np.ascontiguousarray(np.moveaxis(a[chosen], 0, -1))
            for a in (given.parameters, given.process_noise, given.measurement_noise, given.mean, given.covariance)
        )
        belief = estimator.belief(compiled.constants(p), q, r)
        state = estimator.init(x, np.zeros_like(x))._replace(covariance=P)
        u = np.ascontiguousarray(np.moveaxis(given.inputs[chosen], 0, -1))
        for k in range(SAMPLES):
            y = np.empty((ny, LANES))
            compiled.kernels.output(state.mean, u[k + 1], belief.constants, y)
            y += np.sqrt(r) * np.moveaxis(given.surprise[chosen, k], 0, -1)
            if before is not None:
                y[:] = np.moveaxis(before[chosen, k], 0, -1)
            state, info = estimator.step(state, u[k], u[k + 1], y, belief)
            measured[chosen, k] = y.T
            mean[chosen, k], memory[chosen, k] = state.mean.T, state.memory.T
            covariance[chosen, k] = np.moveaxis(state.covariance, -1, 0)
            said[:, chosen, k] = [each[0] for each in (info.nis, info.log_likelihood, info.seen, info.repairs)]
    return Steps(mean, covariance, memory, *said), measured


_MAIN = """
int main(void) {
    static double given[GIVEN], results[RESULTS];
    clock_t taken = 0;
    long points = 0;
    while (fread(given, sizeof given, 1, stdin) == 1) {
        clock_t begin = clock();
        steps(given, results);
        taken += clock() - begin;
        points++;
        if (fwrite(results, sizeof results, 1, stdout) != 1) {
            return 1;
        }
    }
    fprintf(stderr, "%g", (double) taken / (double) CLOCKS_PER_SEC);
    return points > 0 ? 0 : 1;
}
"""


def driver(export: Export) -> str:
    """Return a C program that reads points, takes their steps and writes what the estimator holds behind each."""
    name, number, sizes = export.name, f"{export.name}_real", {m.name: m.size for m in export.library.members}
    groups = ("parameters", "process_noise", "measurement_noise")
    lines = [
        "static void steps(const double *from, double *to) {",
        f"    static {name} e;\n    {name}_belief belief;\n    {name}_inputs inputs;",
        f"    {name}_measurements measurements;\n    {name}_outcome outcome;\n    {name}_believe(&belief);",
    ]
    for group in groups:
        lines += [f"    belief.{group}.{q.field} = ({number}) *from++;" for q in export.quantities(group)]
    lines.append(f"    {name}_begin(&e, &belief);\n    e.begun = true;")
    begun = [member for member in ("mean", "covariance", "inputs_before") if member in sizes]
    for member in begun:
        lines.append(f"    for (int i = 0; i < {sizes[member]}; i++) {{")
        lines.append(f"        e.{member}[i] = ({number}) *from++;\n    }}")
    lines.append(f"    for (int k = 0; k < {SAMPLES}; k++) {{")
    face = export.interface
    for group, quantities in (("inputs", face.inputs), ("measurements", face.measurements)):
        lines += [f"        {group}.{q.field} = ({number}) *from++;" for q in quantities]
        lines += [] if quantities else [f"        {group}.none = 0;"]
    lines.append(f"        {name}_step(&e, &inputs, &measurements, &outcome);")
    told = [m for m in ("mean", "covariance", "memory", "nis", "log_likelihood", "seen", "repairs") if m in sizes]
    for held in told:
        lines.append(f"        for (int i = 0; i < {sizes[held]}; i++) {{")
        lines.append(f"            *to++ = (double) e.{held}[i];\n        }}")
    first = sum(len(export.quantities(group)) for group in groups) + sum(sizes[m] for m in begun)
    given = first + SAMPLES * (len(face.inputs) + len(face.measurements))
    head = [f'#include "{name}.h"\n\n#include <stdio.h>\n#include <time.h>\n', f"#define GIVEN {given}"]
    head.append(f"#define RESULTS {SAMPLES * sum(sizes[m] for m in told)}\n")
    return "\n".join([*head, *lines, "    }\n}", _MAIN])


def built(export: Export, folder: Path, compiler: str, flags: Sequence[str] = ("-O2",)) -> Path:
    """Write the C of an estimator into a folder and return the program that takes steps, compiled without a warning.

    Raises:
        CalledProcessError: If it does not compile.
    """
    name = export.name
    write_files(folder, {f"{name}.h": header(export), f"{name}.c": source(export), "steps.c": driver(export)})
    command = [compiler, *WARNINGS, *flags, f"{name}.c", "steps.c", "-o", "steps", "-lm"]
    subprocess.run(command, cwd=folder, check=True, capture_output=True, text=True)
    return folder / "steps"


def in_c(program: Path, given: Points, measured: Floats, rows: int) -> tuple[Steps, float]:
    """Return the steps of the C, and how long they took in s.

    Args:
        program: From ``built``.
        given: The points.
        measured: From ``in_python``.
        rows: Of the memory.

    Raises:
        CalledProcessError: If it ends early, such as by a sanitizer.
    """
    count, nx = given.mean.shape
    behind = np.concatenate([given.inputs[:, 1:], measured], axis=2).reshape(count, -1)
    parts = given.parameters, given.process_noise, given.measurement_noise, given.mean
    table = np.concatenate([*parts, given.covariance.reshape(count, -1), given.inputs[:, 0], behind], axis=1)
    done = subprocess.run([str(program)], input=table.tobytes(), capture_output=True, check=True)
    sizes = nx, nx * nx, rows, 1, 1, 1, 1
    results = np.frombuffer(done.stdout).reshape(count, SAMPLES, sum(sizes))
    mean, covariance, memory, *said = np.split(results, np.cumsum(sizes)[:-1], axis=2)
    covariance = covariance.reshape(count, SAMPLES, nx, nx)
    return Steps(mean, covariance, memory, *(s[..., 0] for s in said)), float(done.stderr)


def differences(c: Steps, python: Steps, spread: Floats) -> dict[str, Floats]:
    """Return how far the steps are apart ``(points, SAMPLES)``, infinite where one of the two alone is no number.

    A mean counts in standard deviations or its own size, whichever is more; a covariance in the product of the standard
    deviations; the NIS and the likelihood in themselves, or 1. What else is carried shows in the steps that follow.

    Args:
        c: Steps of the C.
        python: Those of the kernel.
        spread: In place of standard deviations, of an estimator that states none ``(nx,)``.
    """
    deviation = np.sqrt(np.einsum("psii->psi", np.abs(python.covariance)))
    scales = {
        "mean": np.fmax(np.where(np.isnan(deviation), spread, deviation), np.abs(python.mean)),
        "covariance": deviation[..., :, None] * deviation[..., None, :],
        "nis": np.fmax(np.abs(python.nis), 1.0),
        "log_likelihood": np.fmax(np.abs(python.log_likelihood), 1.0),
        "used": np.ones_like(python.used),
    }
    return {name: _apart(getattr(c, name), getattr(python, name), scale) for name, scale in scales.items()}


def _apart(a: Floats, b: Floats, scale: Floats) -> Floats:
    with np.errstate(invalid="ignore", divide="ignore", over="ignore"):
        apart = np.abs(a - b) / scale
    apart = np.where(a == b, 0.0, np.where(np.isfinite(a) & np.isfinite(b), apart, np.inf))
    apart = np.where(~np.isfinite(a) & ~np.isfinite(b), 0.0, apart)
    return np.asarray(apart.reshape(*a.shape[:2], -1).max(axis=2, initial=0.0))
