"""A plant of somebody else as a ``Simulator``: its runs go one after the other through worker processes."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np

from harness.common.arrays import Floats
from harness.common.errors import UserError
from harness.engine.simd.lanes import LANES
from harness.external.bodies import Run
from harness.external.description import digest_of
from harness.external.losses import Losses
from harness.external.processes import Lost, Workers
from harness.external.references import located
from harness.runner.contract import Batch, Held, InputSeries, Ports, Signals
from harness.simulation.degraded_sensors import degrade

if TYPE_CHECKING:
    from harness.config import ModelSpec
    from harness.config.specs import ExternalSpec


class ExternalPlant:
    """A plant of somebody else (``harness.runner.contract.Simulator``).

    Args:
        spec: The plant of a study.

    Attributes:
        losses: Runs that were lost, by reason.

    Raises:
        UserError: If its file is not there, or not the one that the study is of.
    """

    def __init__(self, spec: ModelSpec) -> None:
        assert spec.external is not None
        self._description, self._step = spec.external.description, spec.step
        self.model = spec.model()
        self.ports, self.losses = Ports.of(self.model), Losses(self._description.file)
        loader = _loader(spec.external) | {"description": self._description.as_dict()}
        loader |= {"integrator": spec.integrator, "substeps": spec.substeps}
        self._workers = Workers(loader, spec.external.timeout)

    def run(self, inputs: InputSeries, held: Held, noise: Floats, record: Signals) -> Batch:
        """Simulate runs one after the other, see ``harness.runner.contract.Simulator``.

        Inputs are held from sample to sample.
        """
        lead, samples, nd = noise.shape[:-3], len(inputs.at), len(self.ports.states)
        deviations = np.sqrt(np.concatenate([held.process_noise, held.measurement_noise], axis=-2))
        scattered = deviations[..., None, :, :] * noise
        table, forces = inputs.at[:, :, 0], _by_run(scattered[..., :nd, :], lead)
        own = held.values[..., : len(self._description.parameters), :]  # behind them are those of its sensors
        values = _by_run(np.broadcast_to(own, (*lead, *own.shape[-2:])), lead)
        # Lanes without a run of their own repeat the last one.
        fresh = [i == 0 or not _alike(i, values, forces) for i in range(len(values))]
        jobs = ((self._step, table, forces[i], values[i]) for i in np.flatnonzero(fresh))
        answers = [self._outputs(answer, samples) for answer in self._workers.calls("simulate", jobs)]
        answered = np.cumsum(fresh) - 1
        outputs, reached, lost = (np.stack([answer[part] for answer in answers])[answered] for part in range(3))
        columns = {p.signal: outputs[..., i] for i, p in enumerate(self._description.outputs)}
        columns |= {name: forces[..., i] for i, name in enumerate(self.ports.states)}
        columns |= {name: np.broadcast_to(table[:, i], outputs.shape[:2]) for i, name in enumerate(self.ports.inputs)}
        inside = np.arange(samples) < reached[:, None]
        for name, largest in [*self._description.limits.items(), *record.largest.items()]:
            if name in columns:
                inside &= np.abs(columns[name]) <= largest
        measured = _in_lanes([columns[str(e)] for e in self.model.outputs.values()], lead) + scattered[..., nd:, :]
        degrade(self.model, measured, held, noise, self._step)
        return Batch(
            _in_lanes([columns[name] for name in record.names], lead),
            measured,
            np.where(inside.all(axis=1), samples, np.argmin(inside, axis=1)).astype(float).reshape(*lead, LANES),
            lost=lost.reshape(*lead, LANES),
        )

    def outputs(self, inputs: Floats, values: Floats) -> Floats:
        """Return what the sensors would measure without noise ``(samples, ny)``, NaN from where the run was lost.

        Args:
            inputs: In the order of ``ports.inputs``, held from sample to sample ``(samples, nu)``.
            values: Parameters ``(np,)``.
        """
        undisturbed = np.zeros((len(inputs), len(self.ports.states)))
        answer = self._workers.call("simulate", self._step, inputs, undisturbed, values)
        published, reached, _ = self._outputs(answer, len(inputs))
        columns = {p.signal: published[:, i] for i, p in enumerate(self._description.outputs)}
        columns |= {name: inputs[:, i] for i, name in enumerate(self.ports.inputs)}
        measured = np.column_stack([columns[str(e)] for e in self.model.outputs.values()])
        measured[reached:] = np.nan
        return measured

    def _outputs(self, answer: Run | Lost, samples: int) -> tuple[Floats, int, bool]:
        """Return the outputs of a run, the first sample from which on nothing counts, and whether the code lost it."""
        shape = samples, len(self._description.outputs)
        if isinstance(answer, Lost):
            answer = Run(np.full(shape, np.nan), 0, answer.reason)
        elif answer.outputs.shape != shape:
            words = f"its outputs have the shape {answer.outputs.shape} in place of {shape}"
            answer = Run(np.full(shape, np.nan), 0, words)
        elif (bad := ~np.isfinite(answer.outputs[: answer.reached])).any():
            k, i = np.argwhere(bad)[0]
            words = f"its output '{self._description.outputs[i].variable}' is no number at t = {k * self._step:g} s"
            answer = Run(answer.outputs, int(k), words)
        if answer.reason:
            self.losses.add(answer.reason)
        return answer.outputs, answer.reached, bool(answer.reason)

    def close(self) -> None:
        """End its processes."""
        self._workers.close()


def _loader(external: ExternalSpec) -> dict[str, Any]:
    """Return what worker processes make a plant from.

    Raises:
        UserError: If its file is not there, or another one.
    """
    description = external.description
    if description.kind == "python":
        file, loader = located(description.file, external.folders)
    else:
        file = next((f / description.file for f in external.folders if (f / description.file).is_file()), None)
        loader = {"file": str(file and file.resolve())}
    for name, digest in description.digests.items():
        if file is None:
            places = " or ".join(str(f.absolute()) for f in dict.fromkeys(external.folders))
            raise UserError(f"the plant '{description.file}' is needed, and {name} is not in {places}")
        if digest_of(file) != digest:
            raise UserError(f"{file} is not the plant that the study is of: its content is another one")
    return {"kind": description.kind, **loader}


def _by_run(values: Floats, lead: tuple[int, ...]) -> Floats:
    """Return numbers of batches ``(..., n, LANES)``, or ``(..., samples, n, LANES)``, with all runs in front."""
    inner = values.ndim - len(lead) - 1
    runs = math.prod(lead) * values.shape[-1]  # which -1 does not say of a plant without parameters or disturbances
    return np.moveaxis(values, -1, len(lead)).reshape(runs, *values.shape[len(lead) : len(lead) + inner])


def _alike(i: int, values: Floats, forces: Floats) -> bool:
    """Whether a run has the parameters and disturbances of the one before."""
    return np.array_equal(values[i], values[i - 1]) and np.array_equal(forces[i], forces[i - 1])


def _in_lanes(columns: list[Floats], lead: tuple[int, ...]) -> Floats:
    """Return columns ``(runs, samples)`` as ``(..., samples, n, LANES)``."""
    table = np.stack(columns, axis=-1)
    return np.ascontiguousarray(np.moveaxis(table.reshape(*lead, LANES, *table.shape[1:]), len(lead), -1))
