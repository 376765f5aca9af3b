"""Training data: simulated drives with noise, what the network reads beside what it shall give."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from harness.common.arrays import Floats
from harness.common.errors import UserError
from harness.common.files import BUNDLED_STUDIES
from harness.common.registry import closest
from harness.config import DriveSpec, ModelSpec
from harness.config.model import resolve_single
from harness.engine.simd.lanes import LANES
from harness.models.contracts import Profile
from harness.runner.contract import InputSeries, Signals
from harness.simulation.drives import profile_of, read_drives
from harness.simulation.simulate import CompiledSimulator, as_stated, input_table

DRIVES = BUNDLED_STUDIES / "drives" / "narx-training.toml"
INPUTS = ("yaw_rate_trailer", "speed")
OUTPUTS = ("articulation_angle", "lateral_force_axle_21")
PARTS = ("train", "validation", "test")


@dataclass(frozen=True)
class Series:
    """One drive.

    Attributes:
        name: Name of the drive.
        inputs: What the network reads, ``(samples, inputs)``: measurements with their noise, known inputs without.
        outputs: What it shall give, the simulated truth, ``(samples, outputs)``.
    """

    name: str
    inputs: Floats
    outputs: Floats


@dataclass(frozen=True)
class Data:
    """All drives of a training, by their part, and the sample time in s."""

    train: tuple[Series, ...]
    validation: tuple[Series, ...]
    test: tuple[Series, ...]
    step: float

    def ranges(self) -> tuple[Floats, Floats]:
        """Return smallest and largest value of each input and each output in the training part, ``(signals, 2)``."""
        return limits([s.inputs for s in self.train]), limits([s.outputs for s in self.train])


def limits(tables: Sequence[Floats]) -> Floats:
    """Return the smallest and the largest value of each column over all tables, ``(columns, 2)``."""
    every = np.concatenate(tables)
    return np.column_stack([every.min(axis=0), every.max(axis=0)])


def semitrailer(trailer_mass: str = "24 t", parameters: str = "ziaukas_2023") -> ModelSpec:
    """Return the plant of the robustness studies at a trailer mass, by name or TOML file of its parameters."""
    return resolve_single(
        {
            "vehicle": "semitrailer",
            "parameters": parameters,
            "tyre": "magic_formula",
            "sensors": "series",
            "values": {"trailer_mass": trailer_mass},
        },
        "training data",
    )


def make(spec: ModelSpec, drives: Path = DRIVES, seed: int = 1, inputs=INPUTS, outputs=OUTPUTS) -> Data:
    """Simulate the drives of a file; the part of each is the first word of its name.

    Args:
        spec: The plant, with its noise.
        drives: File of drives named ``train-...``, ``validation-...`` and ``test-...``.
        seed: Root of the noise; every drive has its own stream.
        inputs: Measured outputs or inputs of the plant.
        outputs: Quantities of the plant.

    Raises:
        UserError: If a drive belongs to no part, a part is empty, or the plant leaves its range of validity.
    """
    tables = read_drives(drives)
    parts = {name: name.split("-")[0] for name in tables}
    for name, part in parts.items():
        if part not in PARTS:
            raise UserError(f"{drives}, drive '{name}': the name must begin with {', '.join(p + '-' for p in PARTS)}")
    profiles = {
        name: profile_of(spec, DriveSpec(name, kind, options, f"{drives}, drive '{name}'", drives.parent))
        for name, (kind, options) in tables.items()
    }
    series = simulate(spec, profiles, seed, inputs, outputs)
    chosen = {part: tuple(s for s in series if parts[s.name] == part) for part in PARTS}
    for part in PARTS:
        if not chosen[part]:
            raise UserError(f"{drives}: no drive begins with '{part}-'; the network needs some")
    return Data(**chosen, step=spec.step)


def simulate(
    spec: ModelSpec, profiles: dict[str, Profile], seed: int, inputs: Sequence[str], outputs: Sequence[str]
) -> list[Series]:
    """Simulate drives of one length side by side, each with its own noise.

    Raises:
        UserError: If a signal is unknown or the plant leaves its range of validity.
    """
    model = spec.model()
    for name in inputs:
        if name not in model.outputs and name not in model.inputs:
            raise UserError(f"the network cannot read '{name}'{closest(name, [*model.outputs, *model.inputs])}")
    simulator, record = CompiledSimulator.of(spec), Signals(tuple(outputs))
    width = len(model.states) + len(model.outputs)
    as_defined = as_stated(spec, next(iter(profiles.values())))
    held = replace(as_defined, first=np.zeros_like(as_defined.first))
    tables = {name: input_table(p, model) for name, p in profiles.items()}
    series, names = [], list(profiles)
    for start in range(0, len(names), LANES):
        group = names[start : start + LANES]
        samples = max(len(tables[n]) for n in group)
        u = np.empty((samples, len(model.inputs), LANES))
        noise = np.empty((samples, width, LANES))
        for lane in range(LANES):  # spare lanes repeat the last drive
            name = group[min(lane, len(group) - 1)]
            table = tables[name]
            u[:, :, lane] = np.pad(table, ((0, samples - len(table)), (0, 0)), "edge")
            rng = np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(names.index(name),)))
            noise[:, :, lane] = rng.standard_normal((samples, width))
        batch = simulator.run(InputSeries(u), held, noise, record)
        for lane, name in enumerate(group):
            n = len(tables[name])
            if batch.left_at[lane] < n:
                at = batch.left_at[lane] * spec.step
                raise UserError(f"drive '{name}': the vehicle leaves its range of validity at {at:.2f} s")
            columns = [
                batch.measurements[:n, list(model.outputs).index(i), lane]
                if i in model.outputs
                else u[:n, model.inputs.index(i), lane]
                for i in inputs
            ]
            series.append(Series(name, np.column_stack(columns), batch.truth[:n, :, lane].copy()))
    return series
