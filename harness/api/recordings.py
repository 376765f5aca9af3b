"""Signals over time as an xarray Dataset, and what they determine.

``harness.simulate``, ``read_recording``, ``check`` and ``observability``.
"""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import xarray as xr

from harness.api._show import Shown
from harness.api.drive import Drive
from harness.api.model import Model
from harness.common.errors import UserError

if TYPE_CHECKING:
    import pandas as pd

    from harness.recordings.check.run import CheckResult


_UNEVEN = 1e-3
"""Largest deviation of a sampling interval from their mean, in intervals."""


def simulate(model: Model, drive: Drive, seed: int | None = None, signals: Sequence[str] = ()) -> xr.Dataset:
    """Simulate one drive.

    Inputs run straight from sample to sample, as those of a driver do and as everything that takes a recording expects;
    in a study they are held.

    Args:
        model: The vehicle.
        drive: What it drives.
        seed: Seed of process and measurement noise; ``None`` simulates without noise.
        signals: Quantities to record in addition to states, inputs and measured outputs (``harness list signals``).

    Returns:
        Dataset over ``time`` (s) as a logger would have recorded it: inputs and measured outputs under their names, the
        outputs with their noise. The truth of an output is ``true_<signal>``; with a seed so are the other states and
        ``signals``, which without one have their own names. Each variable has ``units`` (SI), ``long_name``, ``frame``
        and ``role``, one of ``truth``, ``input`` and ``measurement``. It is a recording: wherever one is taken, this
        is, and nothing takes a truth for a measurement.

    Raises:
        UserError: If the drive does not fit, a signal is unknown, or the vehicle leaves the range in which its
            equations hold.
        ModelError: If the drive asks for too much lateral acceleration.

    Example:
        >>> import harness as h
        >>> car = h.model("car", "govindarajan_2018", sensors="car_series")
        >>> run = h.simulate(car, h.drive("sine", duration="10 s", amplitude="20 deg"), seed=1)
        >>> run.yaw_rate.dims, run.yaw_rate.attrs["units"], run.yaw_rate.attrs["role"]
        (('time',), 'rad/s', 'measurement')
        >>> sorted(run.filter_by_attrs(role="truth").data_vars)
        ['true_lateral_acceleration', 'true_lateral_velocity', 'true_yaw_rate']
    """
    from harness.simulation.drives import profile_of
    from harness.simulation.simulate import simulate_drive

    spec = model.spec
    for signal in signals:
        spec.model().resolve(signal)
    run = simulate_drive(spec, profile_of(spec, drive), signals, seed, held=False)
    inputs = set(spec.model().inputs) - set(spec.model().states)
    outputs = set(spec.model().outputs)
    for name, variable in run.data_vars.items():
        variable.attrs["role"] = "measurement" if name in outputs else "input" if name in inputs else "truth"
    return run.assign_attrs(name=drive.name)


def read_recording(
    source: str | os.PathLike[str] | pd.DataFrame | xr.Dataset,
    channels: str | os.PathLike[str] | Mapping[str, Any] | None = None,
    *,
    step: float | str | None = None,
    name: str | None = None,
    databases: Sequence[str] = (),
) -> xr.Dataset:
    """Read a measured drive, or bring one that is in memory onto one time base in SI units.

    Args:
        source: File of a known format (``harness list readers``), folder with one signal per file, DataFrame (one row
            per sample, ``time`` in s as column or index or an index of times, units by column in ``attrs["units"]``) or
            Dataset (variables over a time, units in the attribute ``units`` of each).
        channels: Channel map: path of a TOML file or its content as a mapping (docs/measured-data.md). Without one the
            columns must carry the names of signals; in a file they must be in SI units, in memory a stated unit is
            converted.
        step: Step of the common time base: s, or text with a unit; that of the channel map or of the clock by default.
        name: In reports; by default that of the file.
        databases: What the frames of a bus log hold, each ``[BUS=]FILE``; those of the channel map by default.

    Returns:
        Dataset over ``time`` (s, equidistant from 0) with a variable per signal, ``(time,)``, NaN in gaps, with
        ``units``, ``long_name``, ``frame`` and what is known of its channel; attribute ``warnings`` lists what is
        irregular.

    Raises:
        UserError: If source or map cannot be read or do not fit each other; with file, key or column, and remedy.

    Example:
        >>> import numpy as np, pandas as pd, harness as h
        >>> time = np.arange(0, 5, 0.01)
        >>> log = pd.DataFrame({"t": time, "gyro": 10 * np.sin(time)})
        >>> channels = {"time": {"channel": "t", "unit": "s"}, "yaw_rate": {"channel": "gyro", "unit": "deg/s"}}
        >>> lap = h.read_recording(log, channels)
        >>> lap.yaw_rate.attrs["units"], round(float(lap.yaw_rate.max()), 4), dict(lap.sizes)
        ('rad/s', 0.1745, {'time': 500})
    """
    from harness.common.units import to_si
    from harness.recordings.read.load import load_recording

    seconds = None if step is None else to_si(step, "s", "step")
    if seconds is not None and seconds <= 0:
        raise UserError(f"step: {step!r} must be positive")
    mapped = channels if channels is None or isinstance(channels, Mapping) else Path(channels)
    return load_recording(source, mapped, seconds, name, databases)


def recordings_of(given: Any, what: str) -> list[xr.Dataset]:
    """Return recordings as the packages below take them (internal).

    Args:
        given: One recording or several: a path, a DataFrame, or a Dataset, such as ``simulate`` and ``read_recording``
            return, whole or a part of it.
        what: Argument, for errors.

    Raises:
        UserError: If there is none, or one cannot be read or is not on one time base.
    """
    several = given if isinstance(given, list | tuple) else [given]
    if not several:
        raise UserError(f"{what}: give at least one recording")
    recordings = []
    for i, each in enumerate(several):
        if not isinstance(each, xr.Dataset) or each.get("time", xr.DataArray(0)).dtype.kind in "mM":
            recordings.append(read_recording(each))
        else:
            recordings.append(_completed(each, f"{what}[{i}]" if isinstance(given, list | tuple) else what))
    return recordings


def _completed(recording: xr.Dataset, what: str) -> xr.Dataset:
    """Return a recording with the attributes that reading would have given it, its time from 0."""
    if "time" not in recording.dims or recording.sizes["time"] < 2:
        raise UserError(f"{what}: has no dimension 'time' of at least two samples; harness.read_recording makes one")
    time = np.asarray(recording["time"].to_numpy(), dtype=float)
    if np.ptp(np.diff(time)) > _UNEVEN * abs(time[-1] - time[0]) / (len(time) - 1):
        raise UserError(f"{what}: is not sampled evenly; harness.read_recording brings it onto one time base")
    name = str(recording.attrs.get("name") or "recording")
    defaults = {"name": name, "file": name, "reference": "CoG", "warnings": []}
    begun = recording["time"].copy(data=time - time[0]) if time[0] else recording["time"]
    completed = recording.assign_coords(time=begun).assign_attrs({**defaults, **recording.attrs})
    for each in completed.data_vars.values():
        each.attrs = {"derived": 0, **each.attrs}
    return completed


def check(
    source: str | os.PathLike[str] | pd.DataFrame | xr.Dataset,
    channels: str | os.PathLike[str] | Mapping[str, Any] | None = None,
    *,
    parameters: str | None = None,
    databases: Sequence[str] = (),
) -> Check:
    """Compare the signals of a recording with each other, explain what does not agree, and mend its map.

    Args:
        source: As ``harness.read_recording`` takes it: a path, a DataFrame or a Dataset, as it was recorded.
        channels: Channel map: path of a TOML file or its content as a mapping; none where columns are signals.
        parameters: Parameter set or parameter file; no line of the mended map is kept with which its model fits worse
            than without it. Of a car it gives the curves of the axles as well.
        databases: What the frames of a bus log hold, each ``[BUS=]FILE``; those of the channel map by default.

    Returns:
        What was found.

    Raises:
        UserError: If source or map cannot be read or do not fit each other.
        ModelError: If there is no such parameter set.

    Example:
        >>> import numpy as np, pandas as pd, harness as h
        >>> time = np.arange(0, 60, 0.01)
        >>> heading = 0.6 * np.sin(0.5 * time) + 0.2 * np.sin(2 * time)
        >>> log = pd.DataFrame({"time": time, "heading": heading, "gyro": np.degrees(np.gradient(heading, 0.01))})
        >>> channels = {
        ...     "time": {"channel": "time", "unit": "s"},
        ...     "heading": {"channel": "heading", "unit": "rad"},
        ...     "yaw_rate": {"channel": "gyro", "unit": "rad/s"},
        ... }
        >>> found = h.check(log, channels)
        >>> [f.kind for f in found.findings], found.passes, found.mended["yaw_rate"]["unit"]
        (['unit'], True, 'deg/s')
    """
    from harness.identification.fit_recordings import NominalFit
    from harness.recordings.check.run import check_recording

    fit_error = None if parameters is None else NominalFit(parameters)
    mapped = channels if channels is None or isinstance(channels, Mapping) else Path(channels)
    return Check(check_recording(source, mapped, parameters, fit_error, databases))


class Check(Shown):
    """What a check found; made by ``harness.check``."""

    def __init__(self, result: CheckResult) -> None:
        self._result = result

    @property
    def findings(self) -> list[Any]:
        """What is wrong, the largest first; each has ``kind``, ``signals``, ``words`` and ``evidence``."""
        return list(self._result.findings)

    @property
    def comparisons(self) -> pd.DataFrame:
        """One row per comparison, by its name.

        Columns ``verdict``, ``slope``, ``slope_std``, ``offset`` (SI), ``delay``, ``delay_std`` and ``drift`` (s),
        ``explained`` (share of the variance), ``reasons``.
        """
        import pandas as pd

        columns = ["verdict", "slope", "slope_std", "offset", "delay", "delay_std", "drift", "explained"]
        rows = {f.name: [*(getattr(f, c) for c in columns), ", ".join(f.reasons)] for f in self._result.fits}
        return pd.DataFrame.from_dict(rows, orient="index", columns=[*columns, "reasons"]).rename_axis("comparison")

    @property
    def recording(self) -> xr.Dataset:
        """The recording as the given map reads it."""
        return self._result.recording

    @property
    def mended(self) -> dict[str, Any] | None:
        """The whole channel map as it should be; ``None`` if there is nothing to mend."""
        return None if self._result.remedy is None else self._result.remedy.content

    @property
    def passes(self) -> bool:
        """Whether nothing disagrees as the mended map reads the recording, or as the given one does."""
        from harness.recordings.motion.consistency import DISAGREES

        fits = self._result.fits if self._result.remedy is None else self._result.remedy.fits
        return all(f.verdict != DISAGREES for f in fits)

    @property
    def answer(self) -> str:
        """The result in sentences."""
        return " ".join(self._result.sentences)

    @property
    def notes(self) -> list[str]:
        """All irregularities of the recording, with the evidence."""
        return self._result.warnings

    def report(self, folder: str | Path) -> list[Path]:
        """Write ``check.html``, ``check.pdf`` and, where there is something to mend, ``mended.toml``; return the paths.

        Raises:
            UserError: If the folder cannot be written.
        """
        from harness.recordings.check.check_report import write_check

        return write_check(self._result, Path(folder))

    def _facts(self) -> dict[str, Any]:
        return {"answer": self.answer, **{f"finding {i + 1}": str(f) for i, f in enumerate(self.findings)}}

    def _table(self) -> tuple[pd.DataFrame, str]:
        return self.comparisons, f"{len(self.comparisons)} comparisons"


def observability(model: Model, drive: Drive | None = None) -> xr.Dataset:
    """Check structural observability along a drive (docs/observability.md).

    Args:
        model: What an estimator believes, with its unknown inputs and parameters.
        drive: Straight, a sine and straight again by default.

    Returns:
        Dataset over ``time`` (s): ``connected`` (states with a path to an output), ``rank`` (structural), each with the
        number ``required`` in its attributes, ``observable`` (both met), ``output_connected (time, state)``. With
        unknown parameters also ``std (time, parameter)``, the smallest standard deviation possible, and
        ``correlation (parameter, other)`` at the end.

    Raises:
        UserError: If the drive does not fit.
        ModelError: If the drive asks for too much lateral acceleration.

    Example:
        >>> import harness as h
        >>> car = h.model("car", "govindarajan_2018", sensors="car_series")
        >>> criteria = h.observability(car, h.drive("sine", duration="5 s", amplitude="20 deg"))
        >>> int(criteria["rank"].max()), criteria["rank"].attrs["required"]
        (2, 2)
    """
    from harness.estimation.information import parameter_information
    from harness.estimation.observability import structural_observability, synthetic_manoeuvre
    from harness.simulation.drives import profile_of

    spec = model.spec
    profile = synthetic_manoeuvre() if drive is None else profile_of(spec, drive)
    criteria = structural_observability(spec.model(), spec.values, profile)
    return criteria.merge(parameter_information(spec, profile)) if spec.parameter_states else criteria
