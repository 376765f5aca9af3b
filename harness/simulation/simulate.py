"""Simulate drives: batches of runs for a study, or one drive as a recording."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from harness.common.arrays import Floats, batches
from harness.common.errors import UserError
from harness.common.registry import closest
from harness.engine.compile import CompiledModel, compile_model, load_source, paste
from harness.engine.simd.lanes import LANES
from harness.models.assembly.assemble import Model
from harness.models.contracts import Profile
from harness.models.roles import SENSORS
from harness.models.signals import TRUTH, signal_attributes
from harness.runner.limits import LARGEST
from harness.runner.simulation_loop import SIMULATION, simulate

if TYPE_CHECKING:
    import xarray as xr

    from harness.config import ModelSpec


@dataclass(frozen=True)
class Batch:
    """Simulated runs of one drive, ``LANES`` at a time; of several batches every array has their axis in front.

    Attributes:
        truth: Signals asked for, ``(samples, ns, LANES)``.
        measurements: Noisy outputs, ``(samples, ny, LANES)``.
        left_at: First sample at which the plant is outside its range of validity or out of control, or a signal that is
            needed is no number, ``(LANES,)``; ``samples`` if there is none.
        input_errors: By which inputs are off as estimators get them, by signal ``(samples, LANES)``; others are exact.
    """

    truth: Floats
    measurements: Floats
    left_at: Floats
    input_errors: dict[str, Floats] = field(default_factory=dict)


class Simulator:
    """A compiled plant and the loop over time around it.

    Args:
        compiled: The plant.
        needed: Signals without which a run is worth nothing: it ends where one of them is no number.
        within: Largest magnitude of further signals, with which a run ends as well.
    """

    def __init__(
        self, compiled: CompiledModel, needed: Sequence[str] = (), within: Mapping[str, float] | None = None
    ) -> None:
        self.compiled = compiled
        limits = dict.fromkeys(needed, LARGEST) | dict(within or {})
        self.largest = np.array([limits.get(name, 0.0) for name in compiled.signal_names])
        source = paste(compiled, "simulate", [simulate], SIMULATION)
        self.loop = load_source("simulate", source).simulate
        self.limits = compiled.model.limits

    def run(
        self,
        inputs: Floats,
        constants: Floats,
        variance_x: Floats,
        variance_y: Floats,
        noise: Floats,
        x0: Floats,
        between: Floats | None = None,
    ) -> Batch:
        """Simulate ``LANES`` runs, or several batches of them: then all but the inputs have their axis in front.

        Args:
            inputs: ``(samples, nu, LANES)``.
            constants: From ``CompiledModel.constants``, ``(nc, LANES)``.
            variance_x: Process noise per step, ``(nx, LANES)``.
            variance_y: Measurement noise per sample, ``(ny, LANES)``.
            noise: Standard normal numbers, ``(samples, nx + ny, LANES)``.
            x0: First state, ``(nx, LANES)``.
            between: Inputs during the step behind each sample, ``(samples, nu, LANES)``; by default the sample's.
        """
        samples, lead = inputs.shape[0], noise.shape[:-3]
        truth = np.empty((*lead, samples, len(self.compiled.signal_names), LANES))
        y = np.empty((*lead, samples, self.compiled.ny, LANES))
        left = np.empty((*lead, LANES))
        self.loop(
            (inputs, inputs if between is None else between),
            batches(constants, 2),
            batches(np.sqrt(variance_x), 2),
            batches(np.sqrt(variance_y), 2),
            self.limits,
            self.largest,
            batches(x0, 2),
            batches(noise, 3),
            batches(truth, 3),
            batches(y, 3),
            left.reshape(-1, 1, LANES),
        )
        return Batch(truth, y, left)


def input_table(profile: Profile, model: Model, elsewhere: Sequence[str] = ()) -> Floats:
    """Return the inputs of a model over a drive, ``(samples, nu)``; NaN for those that come from elsewhere.

    The rate of an input is its forward difference, which is what Euler's step needs to keep the kingpin tie;
    an estimator at sample k + 1 knows it, because it knows the input at k and k + 1.

    Raises:
        UserError: If the drive has no such input.
    """
    step = float(profile.time[1] - profile.time[0])
    names, rates = model.inputs, model.rates
    known: dict[str, Floats] = {
        **{name: np.full(len(profile.time), value) for name, value in model.otherwise.items()},
        "steering_wheel_angle": profile.steering_wheel_angle,
        "speed": profile.speed,
        "time": profile.time,
        **profile.further,
    }
    for rate, source in rates.items():
        if source in known:
            known[rate] = forward_difference(known[source], step)
    known |= {name: np.full(len(profile.time), np.nan) for name in elsewhere}
    missing = [n for n in names if n not in known]
    if missing:
        raise UserError(
            f"a simulated drive has no input '{missing[0]}', a recording may{closest(missing[0], sorted(known))}"
        )
    return np.column_stack([known[n] for n in names]) if names else np.empty((len(profile.time), 0))


def straight(table: Floats, model: Model) -> tuple[Floats, Floats]:
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
    found = values.copy()
    found[:-1] = 0.5 * (values[:-1] + values[1:])
    return found


def first_state(model: Model, parameters: Floats, profile: Profile) -> Floats:
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
        signals: Quantities to record beside states, inputs and measured outputs.
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
    compiled = compile_model(model, spec.step, spec.integrator, spec.substeps, wanted)
    simulator = Simulator(compiled)
    table = input_table(profile, model)
    at, between = (table, table) if held else straight(table, model)
    samples = len(table)
    noise = np.zeros((samples, compiled.nx + compiled.ny, LANES))
    if seed is not None:
        rng = np.random.default_rng(np.random.SeedSequence(seed))
        noise[:] = rng.standard_normal((samples, compiled.nx + compiled.ny))[..., None]
    parameters = in_lanes(compiled.parameter_vector(spec.values))
    constants = compiled.constants(parameters)
    batch = simulator.run(
        in_lanes(at),
        constants,
        in_lanes(variances(spec.process_noise, model.states)),
        in_lanes(variances(spec.measurement_noise, outputs)),
        noise,
        first_state(model, parameters, profile),
        in_lanes(between),
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


def variances(noise: Mapping[str, float], names: Sequence[str]) -> Floats:
    """Return noise variances in the order of ``names``; a state without noise has none."""
    return np.array([float(noise.get(name, 0.0)) for name in names])
