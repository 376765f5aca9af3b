"""Simulate drives: batches of runs for a study, or one drive as a recording."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np
from numba.core.dispatcher import Dispatcher

from harness.common.arrays import Floats, batches
from harness.common.errors import UserError
from harness.common.registry import closest
from harness.engine.compile import CompiledModel, compile_model, load_source, paste
from harness.engine.simd.lanes import LANES
from harness.models.assembly.assemble import StateSpaceModel
from harness.models.contracts import Profile
from harness.models.roles import SENSORS
from harness.models.signals import TRUTH, signal_attributes
from harness.runner.contract import Batch, Held, InputSeries, Ports, Signals
from harness.runner.simulation_loop import SIMULATION, simulate
from harness.simulation.degraded_sensors import degrade

if TYPE_CHECKING:
    import xarray as xr

    from harness.config import ModelSpec


class CompiledSimulator:
    """A plant of equations as kernels (``harness.runner.contract.Simulator``).

    Args:
        model: The equations.
        step: Sample time in s.
        integrator, substeps: As ``harness.engine.compile.compile_model`` takes them.
    """

    def __init__(
        self, model: StateSpaceModel, step: float = 0.01, integrator: str = "euler", substeps: int = 1
    ) -> None:
        self.model, self._options = model, (step, integrator, substeps)
        self.ports = Ports.of(model)
        self.loops: dict[tuple[str, ...], Dispatcher] = {}
        self._compiled: dict[tuple[str, ...], CompiledModel] = {}

    @classmethod
    def of(cls, spec: ModelSpec) -> CompiledSimulator:
        """Return the plant of a study."""
        return cls(spec.model(), spec.step, spec.integrator, spec.substeps)

    def compiled(self, record: Signals) -> CompiledModel:
        """Return its kernels with the signals that are recorded."""
        if record.names not in self._compiled:
            self._compiled[record.names] = compile_model(self.model, *self._options, record.names)
        return self._compiled[record.names]

    def loop(self, record: Signals) -> Dispatcher:
        """Return the compiled loop over time."""
        if record.names not in self.loops:
            source = paste(self.compiled(record), "simulate", [simulate], SIMULATION)
            self.loops[record.names] = load_source("simulate", source).simulate
        return self.loops[record.names]

    def run(self, inputs: InputSeries, held: Held, noise: Floats, record: Signals) -> Batch:
        """Simulate ``LANES`` runs, or several batches of them, see ``harness.runner.contract.Simulator``."""
        samples, lead, ports = inputs.at.shape[0], noise.shape[:-3], self.ports
        truth = np.empty((*lead, samples, len(record.names), LANES))
        y, left_at = np.empty((*lead, samples, len(ports.outputs), LANES)), np.empty((*lead, LANES))
        self.loop(record)(
            (inputs.at, inputs.at if inputs.between is None else inputs.between),
            batches(self.compiled(record).constants(held.values), 2),
            batches(np.sqrt(held.process_noise), 2),
            batches(np.sqrt(held.measurement_noise), 2),
            self.model.limits,
            largest(record),
            batches(held.first, 2),
            batches(noise, 3),
            batches(truth, 3),
            batches(y, 3),
            left_at.reshape(-1, 1, LANES),
        )
        degrade(self.model, y, held, noise, self._options[0])
        return Batch(truth, y, left_at)


def largest(record: Signals) -> Floats:
    """Return the largest magnitude of each signal that is recorded, zero where it may be anything ``(ns,)``."""
    return np.array([record.largest.get(name, 0.0) for name in record.names])


def input_table(profile: Profile, model: StateSpaceModel, elsewhere: Sequence[str] = ()) -> Floats:
    """Return the inputs of a model over a drive, ``(samples, nu)``; NaN for those that come from elsewhere.

    The rate of an input is its forward difference, which is what Euler's step needs to keep the kingpin tie;
    an estimator at sample k + 1 knows it, because it knows the input at k and k + 1.

    Raises:
        UserError: If the drive has no such input.
    """
    step = float(profile.time[1] - profile.time[0])
    names, rates = model.inputs, model.rates
    signals: dict[str, Floats] = {
        **{name: np.full(len(profile.time), value) for name, value in model.otherwise.items()},
        "steering_wheel_angle": profile.steering_wheel_angle,
        "speed": profile.speed,
        "time": profile.time,
        **profile.further,
    }
    for rate, source in rates.items():
        if source in signals:
            signals[rate] = forward_difference(signals[source], step)
    signals |= {name: np.full(len(profile.time), np.nan) for name in elsewhere}
    missing = [n for n in names if n not in signals]
    if missing:
        raise UserError(
            f"a simulated drive has no input '{missing[0]}', a recording may{closest(missing[0], sorted(signals))}"
        )
    return np.column_stack([signals[n] for n in names]) if names else np.empty((len(profile.time), 0))


def straight(table: Floats, model: StateSpaceModel) -> tuple[Floats, Floats]:
    """Return inputs that run straight from sample to sample: at the samples and during the step behind each.

    Args:
        table: From ``input_table`` ``(samples, nu)``: rates are forward differences, those of the step behind a sample.
        model: Whose inputs they are.
    """
    at, behind = np.empty_like(table), np.empty_like(table)
    for i, name in enumerate(model.inputs):
        at[:, i], behind[:, i] = joined(table[:, i], name in model.rates)
    return at, behind


def joined(values: Floats, rate: bool) -> tuple[Floats, Floats]:
    """Return an exact input that runs straight from sample to sample: at the samples and during the step behind each.

    A rate is constant over the step behind a sample, and at the sample the mean of both sides.

    Args:
        values: Samples of the input, of a rate its forward differences ``(samples,)``.
        rate: Whether it is a rate.
    """
    if not rate:
        return values, halfway(values)
    at = values.copy()
    at[1:] = halfway(values)[:-1]
    return at, values


def forward_difference(values: Floats, step: float) -> Floats:
    """Return the rate of a signal over the step behind each sample; behind the last one that of the step before it."""
    difference = np.diff(values) / step
    return np.append(difference, difference[-1:])


def halfway(values: Floats) -> Floats:
    """Return the mean of each sample and the next; the last one as it is."""
    middles = values.copy()
    middles[:-1] = 0.5 * (values[:-1] + values[1:])
    return middles


def first_state(model: StateSpaceModel, parameters: Floats, profile: Profile) -> Floats:
    """Return where a model starts, ``(nx, LANES)``: zero but for its ``start``.

    Args:
        model: The model; ``start`` of its vehicle says which states do not start at zero.
        parameters: In the model's order, ``(np, LANES)``.
        profile: The drive, of which the first sample counts.
    """
    x = np.zeros((len(model.states), parameters.shape[1]))
    for state, source in model.start.items():
        row = model.states.index(state)
        if not isinstance(source, str):
            x[row] = source
        elif source in model.parameter_names:
            x[row] = parameters[model.parameter_names.index(source)]
        else:
            x[row] = getattr(profile, source)[0]
    return x


def in_lanes(table: Floats) -> Floats:
    """Repeat an array for every lane: ``(...)`` becomes ``(..., LANES)``."""
    return np.ascontiguousarray(np.repeat(table[..., None], LANES, axis=-1))


def simulate_drive(
    spec: ModelSpec, profile: Profile, signals: Sequence[str] = (), seed: int | None = None, held: bool = True
) -> xr.Dataset:
    """Simulate one drive and return it as a recording.

    Args:
        spec: Vehicle, parameters and noise.
        profile: The drive.
        signals: Quantities to record in addition to states, inputs and measured outputs.
        seed: Seed of process and measurement noise; ``None`` simulates without noise.
        held: Whether inputs are held behind each sample, as in a study, or run straight to the next one, as a driver's.

    Returns:
        Dataset over ``time`` as a logger would have recorded it: inputs and measured outputs under their names, the
        outputs with their noise. The truth of an output is ``true_<signal>``; with noise so is that of everything else
        that no sensor gives, without noise such a signal has its own name. Each variable has ``units``, ``long_name``
        and ``frame``.

    Raises:
        UserError: If the vehicle leaves the range in which its equations hold.
    """
    import xarray as xr  # whose import takes a good part of the start of a study, which does without

    model = spec.model()
    outputs = list(model.outputs)
    wanted = tuple(dict.fromkeys([*model.states, *signals, *SENSORS.load(spec.sensors).OUTPUTS.values()]))
    simulator = CompiledSimulator.of(spec)
    table = input_table(profile, model)
    at, between = (table, table) if held else straight(table, model)
    samples, width = len(table), len(model.states) + len(outputs)
    noise = np.zeros((samples, width, LANES))
    if seed is not None:
        rng = np.random.default_rng(np.random.SeedSequence(seed))
        noise[:] = rng.standard_normal((samples, width))[..., None]
    batch = simulator.run(
        InputSeries(in_lanes(at), in_lanes(between)), as_stated(spec, profile), noise, Signals(wanted)
    )
    if batch.left_at[0] < samples:
        raise UserError(
            f"the vehicle leaves the range in which its equations hold at t = {batch.left_at[0] * spec.step:.2f} s "
            f"({', '.join(model.valid)}); choose a calmer drive"
        )
    columns = {name: at[:, i] for i, name in enumerate(model.inputs) if name not in wanted}
    columns |= {name: batch.measurements[:, i, 0] for i, name in enumerate(outputs)}
    for i, name in enumerate(wanted):
        columns[TRUTH + name if name in outputs or seed is not None else name] = batch.truth[:, i, 0]
    dataset = xr.Dataset(coords={"time": ("time", profile.time, {"units": "s", "long_name": "time"})})
    for name, values in columns.items():
        dataset[name] = ("time", values, signal_attributes(name.removeprefix(TRUTH)))
    dataset.attrs = {
        "model": model.name,
        "parameters": spec.parameters,
        "seed": "none" if seed is None else seed,
    }
    return dataset


def as_stated(spec: ModelSpec, profile: Profile) -> Held:
    """Return what a model holds as it is stated, on a drive, the same in all lanes."""
    model = spec.model()
    values = in_lanes(np.array([float(spec.values[n]) for n in model.parameter_names]))
    noise = in_lanes(variances(spec.process_noise, model.states))
    sensors = in_lanes(variances(spec.measurement_noise, list(model.outputs)))
    return Held(values, noise, sensors, first_state(model, values, profile))


def variances(noise: Mapping[str, float], names: Sequence[str]) -> Floats:
    """Return noise variances in the order of ``names``; a state without noise has none."""
    return np.array([float(noise.get(name, 0.0)) for name in names])
