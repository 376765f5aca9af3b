"""Run compiled estimators over recordings: what they say of every state, and how well that agrees with what is known.

A recording holds inputs and measurements as time went by; nobody knows the true state. What an estimator says is judged
by its innovations, and where the recording holds a *reference* of a state or port (a signal that the estimator does not
measure), by its error. Recorded inputs are smoothed, or known from their past alone; what is not known of them is in
the covariance.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, Literal

import numpy as np
import xarray as xr

from harness.common.arrays import Floats
from harness.common.errors import UserError
from harness.common.registry import closest
from harness.config import InputSignal, ModelSpec
from harness.engine.compile import compile_model
from harness.engine.simd.lanes import LANES
from harness.estimation.external_filter import ExternalFilter
from harness.estimation.filters import estimator_of
from harness.identification.data import DriveData
from harness.identification.innovations import Innovations
from harness.identification.signal_noise import white_variance
from harness.models.quantities import difference
from harness.models.roles import SENSORS
from harness.models.signals import TRUTH, signal_attributes
from harness.recordings.motion.kinematics import with_sideslip
from harness.runner.contract import Held, History, InputSeries
from harness.runner.history import EverySample
from harness.simulation.simulate import in_lanes, variances

Inputs = Literal["joined", "held"]

_UNKNOWN = "what is not known of them is in the stated standard deviations."

SMOOTHED = (
    f"Recorded inputs and their rates are those given all samples of the recording, later ones as well; {_UNKNOWN} In "
    "a vehicle an estimator knows the past only."
)
"""What has to be said of an estimate on smoothed inputs."""

_CAUSAL: dict[str, str] = {
    "filtered": f"Recorded inputs and their rates are those given the samples so far; {_UNKNOWN}",
    "measured": f"Recorded inputs are taken as measured, their rates given the samples so far; {_UNKNOWN}",
}


def inputs_in_words(runs: Sequence[xr.Dataset]) -> str:
    """Say what estimators took for recorded inputs, of each kind once."""
    by_comment: dict[str, list[str]] = {}
    for run in runs:
        names = by_comment.setdefault(str(run.attrs["comment"]), [])
        if run.attrs["estimator"] not in names:
            names.append(run.attrs["estimator"])
    if len(by_comment) == 1:
        return next(iter(by_comment))
    return " ".join(f"{', '.join(names)}: {words}" for words, names in by_comment.items())


def certain_in_words(runs: Sequence[xr.Dataset]) -> list[str]:
    """Say which states estimators begin with as certain, because a free run does not move them."""
    names = list(dict.fromkeys(name for run in runs for name in str(run.attrs["certain"]).split(", ") if name))
    if not names:
        return []
    values = ", ".join(f"{name} = ..." for name in names)
    return [
        f"{', '.join(names)}: a free run does not move {'it' if len(names) == 1 else 'them'}, so the estimate begins "
        f"with the variance of a single step's process noise; state START_VARIANCE = dict({values}) in the vehicle's "
        "file if it is less sure than that"
    ]


WANDERING = 10.0
"""s; an unknown input begins as far from zero as its random walk gets in this time."""

_NOTHING_KNOWN = math.nan


class RecordedModel:
    """A model as estimators on recordings believe it.

    Args:
        spec: The model, its step that of the recordings; unknown inputs are among its states.
        signals: Ports and inputs to estimate in addition to every state and unknown parameter.
        inputs: ``joined``: recorded inputs run straight from sample to sample, as measured ones do; ``held``: they
            stay constant behind each sample, as those of a simulation do.
        references: Signal of the recording by the state or port that it is the reference of. Without it, a signal of
            the same name that is not measured by the sensors and is stated as no other's; of a simulated recording the
            exact one.

    Attributes:
        signals: All that is estimated: states first, then parameters in place of the states that stand for them.
        compiled: Its kernels.
        filtered: The same model under an extended Kalman filter, for likelihood and free run.

    Raises:
        UserError, ModelError: If the model has no such quantity.
    """

    def __init__(
        self,
        spec: ModelSpec,
        signals: Sequence[str] = (),
        inputs: Inputs = "joined",
        references: Mapping[str, str] | None = None,
        jobs: int | None = None,
    ) -> None:
        model = spec.model()
        for name in (*signals, *(references or {})):
            model.resolve(name)
        self.spec, self.inputs = spec, inputs
        self.references = dict(references or {})
        states = (n for n in model.states if n not in model.within)
        self.signals = tuple(dict.fromkeys([*states, *spec.estimated_parameters, *signals, *self.references]))
        self.compiled = compile_model(model, spec.step, spec.integrator, spec.substeps, self.signals)
        self.filtered = Innovations(spec, jobs=jobs)

    def __reduce__(self) -> tuple[type[RecordedModel], tuple[Any, ...]]:
        """Pickle what it is made of: its kernels are compiled again."""
        return RecordedModel, (self.spec, self.signals, self.inputs, self.references, self.filtered.jobs)

    def drive(
        self, recording: xr.Dataset, name: str = "recording", input_signal: InputSignal | None = None
    ) -> DriveData:
        """Return a recording in terms of the model, with the spread of the first state.

        A measured state begins as measured, others as the vehicle states, else at zero. How far they may be off is the
        vehicle's ``START_VARIANCE``, else the mean square of the state in a free run over the recording; of an unknown
        input, how far its random walk gets in ten seconds.

        Args:
            recording: As ``RecordedEstimator.run`` takes it.
            name: For errors and reports.
            input_signal: What of measured inputs is taken; by default smoothed ones.

        Raises:
            UserError: If a signal is missing, an input has a gap, or the step is not the model's.
        """
        drive, spec = self.filtered.drive(recording, name, self.inputs, input_signal), self.spec
        model, variance = spec.model(), drive.first_variance.copy()
        for i, state in enumerate(model.states):
            if state in model.start_variance:
                variance[i] = model.start_variance[state]
            elif state in spec.unknown_inputs:
                variance[i] = spec.process_noise[state] * max(1.0, WANDERING / spec.step)
        return replace(drive, first_variance=variance)

    def certain(self, drive: DriveData) -> list[str]:
        """Return the states whose first variance is no more than what a step adds, though nobody states it."""
        model, noise = self.spec.model(), self.spec.process_noise
        stated = {*model.start_variance, *model.outputs, *self.spec.unknown_inputs}
        return [
            state
            for state, variance in zip(model.states, drive.first_variance, strict=True)
            if state not in stated and variance <= noise[state]
        ]

    def reference(self, recording: xr.Dataset) -> dict[str, str]:
        """Return the signal of a recording that is the reference of each estimated one, where there is any.

        Raises:
            UserError: If a reference that was asked for is not in the recording, or is what the estimators measure.
        """
        model = self.spec.model()
        outputs, references = model.outputs, {}
        claimed = set(self.references.values()) - set(self.references)
        for name in (n for n in self.signals if n not in model.inputs and n not in claimed):
            source = self.references.get(name, name)
            exact = f"{TRUTH}{source}" in recording
            if name in self.references and source not in recording and not exact:
                there = [str(v) for v in recording]
                raise UserError(f"reference of '{name}': the recording lacks '{source}'{closest(source, there)}")
            if name in self.references and source in outputs and not exact:
                raise UserError(
                    f"reference of '{name}': the estimators measure '{source}'; choose sensors without it to compare "
                    "with it"
                )
            column = f"{TRUTH}{source}" if exact else source
            if column in recording and (source not in outputs or exact) and np.isfinite(recording[column]).any():
                references[name] = column
        return references


class RecordedEstimator:
    """An estimator compiled to run over recordings.

    Args:
        model: What it believes.
        kind: File in ``harness/estimation/methods``.
        settings: As in a study.
        folder: To which files that settings name are relative.
        name: In reports and results; the kind if empty.
        input_signal: What it takes for measured inputs: ``filtered`` over their past or as ``measured``; by default
            smoothed, given all samples of the recording.

    Raises:
        UserError, ModelError: If there is no such estimator, a setting does not fit, or it does not fit the model.
    """

    def __init__(
        self,
        model: RecordedModel,
        kind: str,
        settings: Mapping[str, Any] | None = None,
        folder: Path = Path(),
        name: str = "",
        input_signal: InputSignal | None = None,
    ) -> None:
        self.input_signal = input_signal
        self.model, self.kind, self.settings, self.name = model, kind, dict(settings or {}), name or kind
        self._estimator = estimator_of(kind, model.compiled, self.settings, folder)

    def lost(self) -> list[str]:
        """Return in words which runs it lost, of one of somebody else, since the last call."""
        return self._estimator.losses.taken() if isinstance(self._estimator, ExternalFilter) else []

    def run(self, recording: xr.Dataset, seed: int = 0, drive: DriveData | None = None) -> xr.Dataset:
        """Run over a recording.

        Args:
            recording: From ``harness.recordings.load_recording`` or ``harness.simulation.simulate.simulate_drive``:
                signals in SI units over ``time``, equidistant by the step of the model. A missing measurement (NaN)
                is skipped exactly; inputs may have no gaps.
            seed: Of estimators that draw random numbers.
            drive: The same recording from ``RecordedModel.drive`` with smoothed inputs, where it was asked for already.

        Returns:
            Dataset over ``time`` (s) and ``output`` (measured quantities), with CF attributes (units, long_name,
            ancillary_variables). SI units; from a divergence on everything estimated is NaN.

            ``<signal>``, ``<signal>_std``
                estimate of every state and chosen port, and its standard deviation (NaN of an estimator without)
            ``measured_<output>``
                what the estimator was given, NaN where nothing was measured; attribute ``port``: the state or port of
                the model that the sensor measures
            ``innovation_<output>``, ``innovation_std_<output>``
                measurement less its prediction, and what the estimator states of its spread; NaN where not measured
            ``innovation_covariance``
                ``(time, output, other_output)``
            ``nis``, ``nis_degrees``
                normalised innovation squared, and the number of measurements in it, its mean if all is right
            ``log_likelihood``
                of each sample's measurements
            ``reference_<signal>``, ``error_<signal>``, ``nees_<signal>``
                where the recording holds a reference: it, estimate less reference, and that squared over the variance
            ``nees``, ``nees_degrees``
                normalised estimation error squared of all signals with a reference together

            Attributes: ``estimator``, ``settings``, ``model``, ``parameters`` (their set), ``estimated_parameters``,
            ``recording``, ``start`` and ``begun`` (as of it), ``diverged_at`` (s, NaN if it did not),
            ``log_likelihood`` (sum), ``repairs`` (samples with a covariance factor that had to be repaired),
            ``updates`` (samples with a measurement), ``inputs``, ``certain`` (states that begin so), ``comment``.

        Raises:
            UserError: If a signal is missing, an input has a gap, or the step is not the model's.
        """
        about = name_of(recording)
        if drive is None or self.input_signal is not None:
            drive = self.model.drive(recording, about, self.input_signal)
        compiled, estimator = self.model.compiled, self._estimator
        recording = with_sideslip(recording, compiled.model.outputs)
        references = self.model.reference(recording)
        rows = np.array([compiled.signal_names.index(n) for n in references], dtype=np.int64)
        spec, model = self.model.spec, compiled.model
        held = Held(
            in_lanes(compiled.parameter_vector(spec.values)),
            in_lanes(variances(spec.process_noise, model.states)),
            in_lanes(variances(spec.measurement_noise, list(model.outputs))),
            self.model.filtered.first_state(drive, self.model.filtered.stated()),
            drive.first_variance,
            seeds=[np.random.SeedSequence(seed)] * LANES,
        )
        inputs = InputSeries(drive.inputs, drive.between, effects=drive.effects)
        kept = estimator.run(inputs, drive.measurements, held, EverySample(of_state=False, of_signals=True, rows=rows))
        return self._dataset(recording, about, drive, references, kept)

    def _dataset(
        self, recording: xr.Dataset, about: str, drive: DriveData, references: Mapping[str, str], kept: History
    ) -> xr.Dataset:
        spec, estimator = self.model.spec, self._estimator
        lost = np.flatnonzero(_is_lost(kept.facts, estimator.has_covariance))
        until = int(lost[0]) if lost.size else len(drive.time)
        for values in vars(kept).values():
            values[until:] = np.nan
        kept.estimate[:, ~estimator.gives] = np.nan
        if not estimator.has_covariance:
            kept.deviation[:] = kept.covariance[:] = kept.spread[:] = kept.innovation[:] = np.nan
            kept.facts[:, [0, 2]] = np.nan
        kept.deviation[:, ~estimator.gives] = np.nan
        outputs = list(spec.model().outputs)
        data = xr.Dataset(
            coords={
                "time": ("time", drive.time, {"units": "s", "long_name": "time since the first sample", "axis": "T"}),
                "output": ("output", outputs, {"long_name": "measured quantity"}),
                "other_output": ("other_output", outputs, {"long_name": "measured quantity"}),
            }
        )
        for i, name in enumerate(self.model.compiled.signal_names):
            _put(data, name, kept.estimate[:, i], name, "estimate of the {}", f"{name}_std")
            _put(data, f"{name}_std", kept.deviation[:, i], name, "standard deviation of the estimated {}")
        _put_innovations(data, SENSORS.load(spec.sensors).OUTPUTS, kept, drive, estimator.has_covariance)
        _put_errors(data, recording, references, self.model.compiled.signal_names, kept)
        likelihood = kept.facts[1:until, 2]
        data.attrs = {
            "Conventions": "CF-1.11",
            "title": f"{self.name} on {about}",
            "estimator": self.name,
            "kind": self.kind,
            "settings": ", ".join(f"{k}={v}" for k, v in self.settings.items()) or "none",
            "model": spec.model().name,
            "parameters": spec.parameters,
            "estimated_parameters": ", ".join(spec.estimated_parameters),
            "recording": about,
            "source": str(recording.attrs.get("source", "")),
            **{name: recording.attrs[name] for name in ("start", "begun") if name in recording.attrs},
            "diverged_at": float(drive.time[until]) if until < len(drive.time) else _NOTHING_KNOWN,
            "log_likelihood": float(likelihood.sum()) if estimator.has_covariance else _NOTHING_KNOWN,
            "repairs": int(np.nansum(kept.facts[:, 3])),
            "updates": int(np.isfinite(drive.measurements[1:until]).any(axis=1).sum()),
            "inputs": self.model.inputs,
            "certain": ", ".join(self.model.certain(drive)),
            "comment": SMOOTHED if self.input_signal is None else _CAUSAL[self.input_signal],
        }
        return data


def _is_lost(facts: Floats, stated: bool) -> np.ndarray:
    """Return the samples with a state outside its limits, or whose NIS or likelihood, if stated, is no number."""
    expected = np.isfinite(facts[:, [0, 2]]) | np.isnan(facts[:, [0, 2]]).all(axis=0)
    surprised = (facts[:, 1] > 0) & ~expected.all(axis=1)
    return (facts[:, 4] > 0) | (surprised & stated)


def name_of(recording: xr.Dataset) -> str:
    """Return the name of a recording: as stated, or that of its file."""
    given = recording.attrs.get("name")
    return str(given) if given else Path(str(recording.attrs.get("file", "recording"))).name.split(".")[0]


def _put(
    data: xr.Dataset, variable: str, values: Floats, signal: str, meaning: str, ancillary: str | None = None
) -> None:
    """Enter a variable that has the unit of a signal."""
    about = signal_attributes(signal)
    long_name = meaning.format(signal.replace("_", " "))
    attributes = {"units": about["units"] or "1", "long_name": long_name, "frame": about["frame"]}
    if attributes["units"] == "dimensionless":
        attributes["units"] = "1"
    if ancillary is not None:
        attributes["ancillary_variables"] = ancillary
    data[variable] = ("time", values.copy(), attributes)


def _put_innovations(data: xr.Dataset, ports: Mapping[str, str], kept: History, drive: DriveData, stated: bool) -> None:
    """Enter measurements, innovations, their covariance, NIS and likelihood; NaN where nothing was measured."""
    missing = ~np.isfinite(drive.measurements)
    missing[0] = True
    kept.innovation[missing] = np.nan
    deviation = np.sqrt(np.diagonal(kept.spread, axis1=1, axis2=2))
    for a, name in enumerate(ports):
        spread = f"innovation_std_{name}"
        _put(data, f"measured_{name}", drive.measurements[:, a], name, "measured {}")
        data[f"measured_{name}"].attrs["port"] = ports[name]
        _put(data, f"innovation_{name}", kept.innovation[:, a], name, "innovation of the measured {}", spread)
        values = np.where(missing[:, a], np.nan, deviation[:, a])
        _put(data, spread, values, name, "standard deviation that is stated of the innovation of the measured {}")
    unmeasured = missing[:, :, None] | missing[:, None, :]
    covariance = np.where(unmeasured, np.nan, kept.spread)
    about = {"long_name": "covariance of the innovations", "comment": "product of the units of both outputs"}
    data["innovation_covariance"] = (("time", "output", "other_output"), covariance, about)
    counted = np.where(missing.all(axis=1) | (not stated), np.nan, kept.facts[:, 0])
    degrees = np.where(np.isfinite(kept.facts[:, 4]), (~missing).sum(axis=1), 0)
    data["nis"] = ("time", counted, {"units": "1", "long_name": "normalised innovation squared"})
    data["nis_degrees"] = ("time", degrees, {"units": "1", "long_name": "measurements in the NIS"})
    about = {"units": "1", "long_name": "log-likelihood of the measurements of a sample"}
    data["log_likelihood"] = ("time", np.where(missing.all(axis=1), np.nan, kept.facts[:, 2]), about)


def _put_errors(
    data: xr.Dataset, recording: xr.Dataset, references: Mapping[str, str], names: Sequence[str], kept: History
) -> None:
    """Enter references, errors and NEES."""
    if not references:
        return
    errors = np.empty((len(kept.estimate), len(references)))
    for r, (name, source) in enumerate(references.items()):
        truth = np.asarray(recording[source].values, dtype=float)
        errors[:, r] = difference(name, kept.estimate[:, names.index(name)], truth)
        _put(data, f"reference_{name}", truth, name, "reference of the {}")
        noise = 0.0 if source.startswith(TRUTH) else math.sqrt(white_variance([truth]))
        data[f"reference_{name}"].attrs |= {"channel": source, "noise_std": noise}
        _put(data, f"error_{name}", errors[:, r], name, "estimate less reference of the {}")
        with np.errstate(divide="ignore", invalid="ignore"):
            share = errors[:, r] ** 2 / kept.covariance[:, r, r]
        about = {"units": "1", "long_name": f"error of the {name.replace('_', ' ')} squared over its variance"}
        data[f"nees_{name}"] = ("time", np.where(np.isfinite(share), share, np.nan), about)
    together, degrees = _joint_nees(errors, kept.covariance)
    about = {"long_name": "normalised estimation error squared", "comment": f"of {', '.join(references)}"}
    data["nees"] = ("time", together, {"units": "1", **about})
    data["nees_degrees"] = ("time", degrees, {"units": "1", "long_name": "signals in the NEES"})


def _joint_nees(errors: Floats, covariance: Floats) -> tuple[Floats, Floats]:
    """Return the NEES of all signals with a reference and how many count; what is missing or dependent counts less.

    A port that follows from the others adds no degree of freedom: the pseudo-inverse leaves its direction out.
    """
    finite = np.isfinite(errors)
    scale = np.sqrt(np.diagonal(covariance, axis1=1, axis2=2))
    usable = finite & (scale > 0)
    whole = np.where(usable, errors / np.where(usable, scale, 1.0), 0.0)
    unit = covariance / np.where(usable, scale, 1.0)[:, :, None] / np.where(usable, scale, 1.0)[:, None, :]
    unit = np.where(usable[:, :, None] & usable[:, None, :], unit, 0.0)
    stated = np.isfinite(unit).all(axis=(1, 2))  # by an estimator that states variances alone only that of one signal
    unit[~stated] = 0.0
    values, vectors = np.linalg.eigh(unit)
    kept = values > 1e-9
    parts = np.einsum("kij,ki->kj", vectors, whole) ** 2
    total = np.sum(np.where(kept, parts / np.where(kept, values, 1.0), 0.0), axis=1)
    degrees = np.where(stated, kept.sum(axis=1), 0)
    return np.where(degrees > 0, total, np.nan), degrees.astype(float)
