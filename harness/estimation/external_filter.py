"""An estimator in worker processes as a filter of the runner: its arrays in, a history out."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from harness.common.arrays import Floats
from harness.common.errors import UserError, closest
from harness.common.units import scale, to_si
from harness.engine.compile import CompiledModel
from harness.estimation.external_loader import GROUPS, KINDS, loader_of
from harness.external.bodies import RunEstimates, Timed
from harness.external.losses import Losses
from harness.external.processes import Lost, Workers
from harness.models.signals import SIGNALS, signal_attributes
from harness.runner.contract import Held, History, InputSeries, Kept, Ports, Record

SEED = "seed"
"""Value of the belief that is a random number; whoever asks for it draws random numbers."""


@dataclass(frozen=True)
class Columns:
    """Signals that an estimator gets or gives.

    Attributes:
        names: In its order.
        factors: SI units over its own.
    """

    names: tuple[str, ...]
    factors: Floats


class _Run(NamedTuple):
    """What an estimator gets in a run; equal runs are computed once."""

    inputs: Floats
    measurements: Floats
    values: Floats
    seed: int

    def equals(self, other: _Run) -> bool:
        return self.seed == other.seed and all(
            np.array_equal(a, b, equal_nan=True) for a, b in zip(self[:3], other[:3], strict=True)
        )


class ExternalFilter:
    """An estimator of somebody else, see ``harness.runner.contract.Filter``.

    Args:
        settings: Those of ``harness/estimation/methods/external.py``.
        compiled: The belief.
        folder: To which files that settings name are relative.

    Attributes:
        losses: Runs that it did not finish, by reason.

    Raises:
        UserError: If it cannot be loaded, or gets or gives what is not there.
    """

    def __init__(self, settings: Mapping[str, Any], compiled: CompiledModel, folder: Path) -> None:
        self.ports, self.signals = Ports.of(compiled.model), compiled.signal_names
        self._step = compiled.step_size
        kind, file = next((k, settings[k]) for k in KINDS if settings[k] is not None)
        self._kind, self.losses = kind, Losses(file)
        self._where = f"estimator {kind} = '{file}'"
        if kind == "fmu" and any(isinstance(settings[name], Mapping) for name in GROUPS):
            self._refuse("an FMU, or its map, states the units; list the signals alone")
        model = compiled.model
        self._all_values = (
            *model.parameter_names,
            *(f"process_noise.{s}" for s in model.states),
            *(f"measurement_noise.{o}" for o in model.outputs),
            *(f"first.{s}" for s in model.states),
            *(f"first_variance.{s}" for s in model.states),
        )
        values = settings["values"]
        if values is None and settings["filter"] is not None:
            values = [f"measurement_noise.{o}" for o in settings["measurements"] or model.outputs]
            values += [] if settings["filter"] == "ukf" else [SEED]
        elif values is None:
            values = list(self._all_values) if kind == "python" else []
        for name in values:
            if name not in (*self._all_values, SEED):
                self._refuse(f"values: the belief has no '{name}'{closest(name, self._all_values)}")
        self.is_random = SEED in values
        self._values = [(*self._all_values, SEED).index(name) for name in values]
        there = {"inputs": list(model.inputs), "measurements": list(model.outputs)}
        loader = loader_of(settings, folder, self._where)
        timeout = to_si(settings["timeout"], "s", f"{self._where}: timeout")
        self._workers = Workers({**loader, "values": values}, timeout)
        declared = self._declared()
        stated = {**declared, **{n: v for n, v in settings.items() if v is not None}}
        self._inputs, self._measurements, self._estimates = (
            self._columns(group, stated.get(group), there.get(group)) for group in GROUPS
        )
        sizes = {
            g: len(c.names) for g, c in zip(GROUPS, (self._inputs, self._measurements, self._estimates), strict=True)
        }
        sizes |= {"values": len(values), "features": sizes["inputs"] + sizes["measurements"]}
        for name, size in declared.get("sizes", {}).items():
            if size != (own := sizes[name]):
                by = "inputs and measurements, which are its features," if name == "features" else f"'{name}'"
                self._refuse(f"it has {size} {name}, the study {own}; state as many by {by} in its order")
        nis = bool(stated.get("nis"))
        self.has_covariance = bool(stated.get("variances")) or (nis and kind != "fmu")  # elsewhere they come with it
        self._has_nis = nis and self.has_covariance
        self.gives = np.array([name in self._estimates.names for name in self.signals], dtype=bool)

    @property
    def times_steps(self) -> bool:
        """Whether single steps of it can be timed; those of an FMU cannot."""
        return self._kind != "fmu"

    @property
    def nis_scale(self) -> float:
        """Measurements of the belief over those that it takes: scaled so its NIS compares with the former number."""
        return len(self.ports.outputs) / max(len(self._measurements.names), 1)

    def _refuse(self, why: str) -> None:
        raise UserError(f"{self._where}: {why}")

    def _declared(self) -> dict[str, Any]:
        try:
            declared = self._workers.call("declared")
        except UserError as error:
            raise UserError(f"{self._where}: {error}") from None
        if isinstance(declared, Lost):
            self._refuse(declared.reason)
        return declared

    def _columns(self, group: str, written: Any, there: list[str] | None) -> Columns:
        """Return the signals of a group, checked; ``there`` are those to choose from."""
        if not written and there is None:
            self._refuse("which signals does it give? state them in its order: estimates = [...]")
        written = there if written is None else written
        for name in written:
            if there is not None and name not in there:
                what = "knows no input" if group == "inputs" else "measures no"
                self._refuse(f"{group}: the belief {what} '{name}'{closest(name, there)}")
            if there is None and name not in SIGNALS and name not in self.signals:
                self._refuse(f"{group}: there is no signal '{name}'{closest(name, list(SIGNALS))}")
        units = written if isinstance(written, Mapping) else {}
        factors = [
            scale(units[name], signal_attributes(name)["units"], f"{self._where}: {group}.{name}")
            if name in units
            else 1.0
            for name in written
        ]
        return Columns(tuple(written), np.array(factors, dtype=float))

    def run(self, inputs: InputSeries, measurements: Floats, held: Held, record: Record[Kept]) -> Kept:
        """Run over batches or a recording, one run after the other."""
        is_recording = inputs.effects is not None  # which has no axis of lanes
        u, y = (each[..., None] for each in (inputs.at, measurements)) if is_recording else (inputs.at, measurements)
        runs = self._runs(u, y, held)
        begins = [i for i, run in enumerate(runs) if not i or not run.equals(runs[i - 1])]
        jobs = [(self._step, *runs[i]) for i in begins]
        answers = [self._checked(answer, y.shape[-3]) for answer in self._workers.calls("estimate", jobs)]
        of_runs = [answers[at] for at in np.searchsorted(begins, range(len(runs)), side="right") - 1]
        return record.of(self._history(of_runs, runs, (*y.shape[:-3], y.shape[-1])), self)

    def timed(self, inputs: InputSeries, measurements: Floats, held: Held) -> Callable[[slice, bool], Timed]:
        """Return what takes samples of the first run of a batch in a worker process and times them.

        Raises:
            UserError: If its code fails.
        """
        run = self._runs(inputs.at, measurements, held)[0]

        def take(samples: slice, begins: bool) -> Timed:
            given = run.inputs[samples], run.measurements[samples], run.values
            answer = self._workers.call("timed", self._step, *given, begins)
            if isinstance(answer, Lost):
                self._refuse(f"its steps cannot be timed: {answer.reason}")
            timed: Timed = answer
            return timed

        return take

    def _runs(self, u: Floats, y: Floats, held: Held) -> list[_Run]:
        """Return what it gets in each run, batch by batch, in its units."""
        inputs, outputs = list(self.ports.inputs), list(self.ports.outputs)
        lead, lanes, axis = y.shape[:-3], y.shape[-1], y.ndim - 3
        u = u[..., [inputs.index(n) for n in self._inputs.names], :]
        u = np.broadcast_to(u, (*lead, *u.shape[-3:-1], lanes))
        y = y[..., [outputs.index(n) for n in self._measurements.names], :]
        known_inputs, measured = (
            np.moveaxis(each / columns.factors[:, None], -1, axis).reshape(math.prod(lead) * lanes, *each.shape[-3:-1])
            for each, columns in ((u, self._inputs), (y, self._measurements))
        )
        measured[:, 0] = math.nan
        seeds = [0] * len(measured)
        if self.is_random and held.seeds is not None:
            seeds = [int(s.generate_state(1)[0]) for s in held.seeds][: len(measured)]
        table = np.column_stack([self._table(held, lead, lanes), seeds])[:, self._values]
        return [_Run(*row) for row in zip(known_inputs, measured, table, seeds, strict=True)]

    def _table(self, held: Held, lead: tuple[int, ...], lanes: int) -> Floats:
        """Return all values of the belief but the seed, ``(runs, values)``."""
        variance = held.process_noise if held.first_variance is None else held.first_variance
        if variance.shape == (len(self.ports.states),) * 2:
            variance = np.diag(variance)
        parts = (
            part[:, None] if part.ndim == 1 else part
            for part in (held.values, held.process_noise, held.measurement_noise, held.first, variance)
        )
        table = np.concatenate([np.broadcast_to(p[..., :lanes], (*lead, p.shape[-2], lanes)) for p in parts], axis=-2)
        return np.moveaxis(table, -1, -2).reshape(-1, len(self._all_values))

    def _checked(self, answer: Any, samples: int) -> RunEstimates:
        """Return an answer in which nothing counts from the first number on that is none; count what was lost."""
        shape = samples, len(self._estimates.names)
        if isinstance(answer, Lost):
            checked = self._nothing(shape, answer.reason)
        elif wrong := self._wrong_shape(answer, shape):
            checked = self._nothing(shape, wrong)
        else:
            checked = self._up_to_no_number(answer)
        if checked.reason:
            self.losses.add(checked.reason)
        return checked

    def _nothing(self, shape: tuple[int, int], reason: str) -> RunEstimates:
        return RunEstimates(np.full(shape, math.nan), np.full(shape, math.nan), np.full(shape[0], math.nan), 0, reason)

    def _wrong_shape(self, answer: RunEstimates, shape: tuple[int, int]) -> str:
        if answer.estimates.shape != shape:
            return f"it gives {answer.estimates[0].size} estimates, the study states {shape[1]}"
        if self.has_covariance and (answer.variances is None or answer.variances.shape != shape):
            given = 0 if answer.variances is None else answer.variances[0].size
            return f"it gives {given} variances for {shape[1]} estimates"
        if self._has_nis and answer.nis is None:
            return "it gives no NIS"
        return ""

    def _up_to_no_number(self, answer: RunEstimates) -> RunEstimates:
        bad, reason = ~np.isfinite(answer.estimates), "its estimate of '{}' is no number"
        bad[0] = False
        if self.has_covariance and not bad[: answer.reached].any():
            assert answer.variances is not None
            bad, reason = ~(answer.variances >= 0.0), "its variance of '{}' is below zero or no number"
            bad[0] = False
        rows = bad[: answer.reached].any(axis=1)
        if not rows.any():
            return answer
        first = int(rows.argmax())
        return answer._replace(reached=first, reason=reason.format(self._estimates.names[int(bad[first].argmax())]))

    def _history(self, answers: list[RunEstimates], runs: list[_Run], shape: tuple[int, ...]) -> History:
        """Return what it gave in all runs; of the state no more than there is among its estimates."""
        *lead, lanes = shape
        samples, states, signals = len(runs[0].inputs), list(self.ports.states), list(self.signals)
        batches, ny, factors = len(runs) // lanes, len(self.ports.outputs), self._estimates.factors

        def room(*size: int) -> Floats:
            return np.full((batches, samples, *size, lanes), math.nan)

        estimate, deviation, mean, variance = (room(len(n)) for n in (signals, signals, states, states))
        facts = room(5)
        facts[:, :, [3, 4]] = 0.0
        missing = np.isnan(np.stack([run.measurements for run in runs])).reshape(batches, lanes, samples, -1)
        facts[:, :, 1] = np.moveaxis((~missing).sum(axis=-1), 1, -1)
        places = [
            (column, names.index(name), held, spread)
            for column, name in enumerate(self._estimates.names)
            for names, held, spread in ((signals, estimate, deviation), (states, mean, variance))
            if name in names
        ]
        for i, answer in enumerate(answers):
            batch, lane = divmod(i, lanes)
            whole = slice(0, answer.reached)
            for column, at, held, spread in places:
                held[batch, whole, at, lane] = answer.estimates[whole, column] * factors[column]
                if self.has_covariance and answer.variances is not None:
                    spread[batch, whole, at, lane] = answer.variances[whole, column] * factors[column] ** 2
            if self._has_nis and answer.nis is not None:
                facts[batch, whole, 0, lane] = answer.nis[whole]
                facts[batch, np.isnan(facts[batch, :, 0, lane]), 1, lane] = 0.0
            facts[batch, answer.reached :, 4, lane] = 1.0
        covariance = np.broadcast_to(math.nan, (batches, samples, len(states), len(states), lanes))
        if self.has_covariance:
            covariance = covariance.copy()
            np.einsum("...iil->...il", covariance)[:] = variance
            np.sqrt(deviation, out=deviation)
        nothing = [np.broadcast_to(math.nan, (batches, samples, *n, lanes)) for n in ((0, 0), (ny,), (ny, ny))]
        parts = mean, covariance, estimate, deviation, *nothing, facts
        return History(*(p.reshape(*lead, *p.shape[1:]) for p in parts))
