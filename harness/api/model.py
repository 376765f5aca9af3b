"""``harness.model``: a vehicle with its parameters, as ``[plant]`` of a study states it."""

from __future__ import annotations

from collections.abc import Hashable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, TypedDict, Unpack

from harness.api._show import Shown, keywords, note
from harness.config import ModelSpec, complete, largest_sensors, resolve_single
from harness.config.parameter_set import set_text
from harness.config.unknown_parameters import KEYS as UNCERTAIN
from harness.models.signals import SIGNALS

if TYPE_CHECKING:
    import pandas as pd


class Integration(TypedDict, total=False):
    """How a model is integrated; a study file has the same keys.

    Attributes:
        step: Sample time, a number in s or text with a unit (default 0.01 s; that of the recordings where it is run on
            some).
        integrator: Scheme of one substep (default ``euler``).
        substeps: Integration steps per sample (default 1).
    """

    step: float | str
    integrator: Literal["euler", "heun", "rk4"]
    substeps: int


class Further(Integration, total=False):
    """What an estimator is not sure of in addition to unknown inputs; for a belief only. Keys of a study file.

    Attributes:
        unknown_parameters: Parameters that it is to estimate: names, or ``{"name": ..., "prior": "1 m", "walk":
            "0.1 m/sqrt(h)"}`` with the standard deviation of the value and of its random walk.
        considered_parameters: Parameters whose uncertainty it reckons with and whose value it leaves alone; the same.
    """

    unknown_parameters: Sequence[str | Mapping[str, Any]] | None
    considered_parameters: Sequence[str | Mapping[str, Any]] | None


@keywords(Further)
def model(
    vehicle: str,
    parameters: str | Path | None = None,
    *,
    tyre: str | None = None,
    effects: Sequence[str] | None = None,
    sensors: str | Sequence[str] | None = None,
    values: Mapping[str, float | str] | None = None,
    noise: Mapping[str, Any] | None = None,
    unknown_inputs: Sequence[str] | None = None,
    **further: Unpack[Further],
) -> Model:
    """Return a model: a vehicle, its tyre, effects, sensors, parameters and noise.

    Arguments are the keys of ``[plant]`` in a study file and mean the same. What is left out follows from the parameter
    set; a tyre is ``magic_formula`` where one is needed; sensors are all signals of the recordings the model is run on
    that a set measures and whose noise is known, or else the series ones. A note on stderr says where a choice was made
    that may surprise.

    Args:
        vehicle: Name of a vehicle (``harness list vehicles``).
        parameters: Name of a parameter set or path of a TOML parameter file; the vehicle's only set by default.
        tyre: Name of a tyre.
        effects: Names of effects in the order they act; ``effect@place`` acts at one place.
        sensors: Name of a set of sensors, or the signals that are measured.
        values: Parameters that differ from the set: a number in SI units, or text with a unit such as ``"1.6 t"``.
        noise: Variances that differ from the set: ``{"process": {state: variance per step}, "measurement": {output:
            variance per sample}, "input": {signal: variance per sample}, "process_scale": factor,
            "measurement_scale": factor, "input_scale": factor}``, SI squared; inputs not named are exact.
        unknown_inputs: Inputs that an estimator is to estimate as random walks; for a belief only.
        further: ``unknown_parameters`` and ``considered_parameters``, see ``Further``; ``step``, ``integrator`` and
            ``substeps``, see ``Integration``.

    Returns:
        The model, everything in it checked.

    Raises:
        UserError: If anything is unknown, out of bounds or of the wrong unit, or there are several parameter sets to
            choose from.
        ModelError: If there is no such vehicle or parameter set.

    Example:
        >>> import harness as h
        >>> car = h.model("car", "govindarajan_2018", sensors="car_series", values={"mass": "1.6 t"})
        >>> print(*car.parameters.loc["mass", ["value", "unit"]])
        1600.0 kg
        >>> car.outputs
        ('yaw_rate', 'lateral_acceleration')
    """
    stated = {
        "vehicle": vehicle,
        "parameters": None if parameters is None else str(parameters),
        "tyre": tyre,
        "effects": _list(effects),
        "sensors": _list(sensors),
        "values": values,
        "noise": noise,
        "unknown_inputs": _list(unknown_inputs),
        **further,
    }
    return Model({key: _plain(value) for key, value in stated.items() if value is not None})


class Model(Shown):
    """A vehicle with everything needed to run it; made by ``harness.model``, by a fit or by a diagnosis.

    Attributes:
        stated: What was stated, by the keys of ``[plant]`` in a study file.
    """

    def __init__(self, stated: Mapping[str, Any]) -> None:
        self.stated: dict[str, Any] = dict(stated)
        if isinstance(sensors := self.stated.get("sensors"), list):
            self.stated["sensors"] = ", ".join(sensors)
        self._spec: ModelSpec | None = None
        table, _ = complete(self.stated, choose_sensors=False)
        if (
            "sensors" not in table
        ):  # which of them is decided later, by recordings perhaps; the rest is checked with most
            table["sensors"] = largest_sensors(table)
        self._checked = self._resolve(table)

    @property
    def spec(self) -> ModelSpec:
        """The resolved record that all packages below take (internal).

        Raises:
            UserError: If there are several sets of sensors to choose from and none was stated.
        """
        if self._spec is None:
            self._spec = self._resolve(self.table())
        return self._spec

    def table(self, recordings: Sequence[Iterable[Hashable]] | None = None) -> dict[str, Any]:
        """Return the model by the keys of ``[plant]`` in a study file, what was left out filled in.

        Args:
            recordings: Recordings that it is for (their signals count); sensors follow from them if none are stated.

        Raises:
            UserError: If there are several sets of sensors to choose from, or the recordings hold
                nothing that any of them measures.
        """
        table, notes = self.completed(recordings)
        for each in notes:
            note(each)
        return table

    def completed(
        self, recordings: Sequence[Iterable[Hashable]] | None = None
    ) -> tuple[dict[str, Any], tuple[str, ...]]:
        """Return the same as ``table``, and what was chosen in sentences (internal)."""
        return complete(self.stated, recordings)

    def replace(self, **keys: Any) -> Model:
        """Return a model that differs in some keys, see ``harness.model``.

        Entries of ``values`` and ``noise`` are put in place of those of the same name; all other keys as a whole.

        Raises:
            UserError: As ``harness.model``.

        Example:
            >>> import harness as h
            >>> car = h.model("car", "govindarajan_2018", values={"mass": "1.6 t"})
            >>> heavy = car.replace(values={"mass": "1.9 t"})
            >>> float(heavy.parameters.value["mass"])
            1900.0
        """
        return Model(_merged(self.stated, {k: _plain(v) for k, v in keys.items()}))

    @property
    def vehicle(self) -> str:
        """Name of the vehicle."""
        return self._checked.vehicle

    @property
    def tyre(self) -> str | None:
        """Name of the tyre; ``None`` for a vehicle without one."""
        return self._checked.tyre

    @property
    def effects(self) -> tuple[str, ...]:
        """Effects in force."""
        return self._checked.effects

    @property
    def step(self) -> float:
        """Sample time in s."""
        return self._checked.step

    @property
    def states(self) -> tuple[str, ...]:
        """Names of the states, those of effects and unknown inputs included."""
        return tuple(self._checked.model().states)

    @property
    def inputs(self) -> tuple[str, ...]:
        """Names of the inputs."""
        return tuple(self._checked.model().inputs)

    @property
    def outputs(self) -> tuple[str, ...]:
        """Names of the measured outputs.

        Raises:
            UserError: If there are several sets of sensors to choose from and none was stated.
        """
        return tuple(self.spec.model().outputs)

    @property
    def parameters(self) -> pd.DataFrame:
        """Every parameter by name: ``value``, ``unit``, ``lower`` and ``upper`` bound (SI), ``meaning``."""
        import pandas as pd

        spec = self._checked
        rows = {p.name: (spec.values[p.name], p.unit, p.lower, p.upper, p.meaning) for p in spec.model().parameters}
        columns = ["value", "unit", "lower", "upper", "meaning"]
        return pd.DataFrame.from_dict(rows, orient="index", columns=columns).rename_axis("parameter")

    @property
    def noise(self) -> pd.DataFrame:
        """Noise by ``(kind, name)``: ``variance`` in SI squared, per step (process) or sample (the others), ``unit``.

        Raises:
            UserError: If there are several sets of sensors to choose from and none was stated.
        """
        import pandas as pd

        from harness.models.signals import SIGNALS

        rows = {
            (kind, name): (variance, f"({SIGNALS[name].unit})^2" if name in SIGNALS else "")
            for kind, noise in _noise_of(self.spec).items()
            for name, variance in noise.items()
        }
        index = pd.MultiIndex.from_tuples(list(rows), names=["kind", "name"])
        return pd.DataFrame(list(rows.values()), index=index, columns=["variance", "unit"])

    def write(self, path: str | Path, source: str = "") -> Path:
        """Write a parameter file, which studies, commands and ``harness.model`` take by its path.

        Behind every value stand its unit, the range it may have and what it means.

        Args:
            path: File to write.
            source: Where the values come from.

        Raises:
            UserError: If it cannot be written.
        """
        self.outputs  # noqa: B018 - refuses a model whose sensors are not decided
        return write_set(self._checked, Path(path), source)

    def resolved_for(self, recordings: Sequence[Iterable[Hashable]], believed: bool = False, **keys: Any) -> ModelSpec:
        """Return the record for recordings, with further keys where they were not stated (internal).

        Args:
            recordings: The recordings.
            believed: Whether it is for an estimator, which may be unsure of what the parameter file says so of.
            keys: Further keys.
        """
        return self._resolve({**keys, **self.table(recordings)}, believed)

    def _resolve(self, table: Mapping[str, Any], believed: bool = False) -> ModelSpec:
        unsure = believed or any(table.get(key) for key in ("unknown_inputs", *UNCERTAIN))
        side: Literal["plant", "belief"] = "belief" if unsure else "plant"
        return resolve_single(table, f"model '{table['vehicle']}'", side)

    def _facts(self) -> dict[str, Any]:
        spec = self._checked
        return {
            "parameters": spec.parameters,
            "tyre": spec.tyre,
            "effects": ", ".join(spec.effects),
            "sensors": self.stated.get("sensors", "") if self._spec is None else self._spec.sensors,
            "states": ", ".join(self.states),
            "inputs": ", ".join(self.inputs),
            "step": f"{spec.step:g} s, {spec.integrator}, {spec.substeps} per sample",
            "changed": ", ".join(f"{k} = {v}" for k, v in self.stated.get("values", {}).items()),
        }

    def _title(self) -> str:
        return f"Model of {self.vehicle}"

    def _table(self) -> tuple[pd.DataFrame, str]:
        return self.parameters, f"{len(self.parameters)} parameters"

    def _state(self) -> Any:
        return self.stated, self._checked


def write_set(spec: ModelSpec, path: Path, source: str) -> Path:
    """Write a resolved record as a parameter file (internal)."""
    from harness.common.files import write_files

    model = spec.model()
    means = {
        p.name: f"{p.unit}, {p.lower:g} to {p.upper:g}; {p.meaning}".removeprefix("dimensionless, ")
        for p in model.parameters
    }
    noise = {("process_noise", n): f"({SIGNALS[n].unit})^2 a step" for n in model.states if n in SIGNALS}
    noise |= {("measurement_noise", n): f"({SIGNALS[n].unit})^2" for n in model.outputs if n in SIGNALS}
    (written,) = write_files(path.parent, {path.name: set_text(spec, source, means, noise)})
    return written


def model_of(spec: ModelSpec) -> Model:
    """Return a resolved record as a model (internal)."""
    table = {
        "vehicle": spec.vehicle,
        "parameters": spec.parameters,
        "tyre": spec.tyre,
        "effects": list(spec.effects),
        "sensors": spec.sensors,
        "integrator": spec.integrator,
        "step": spec.step,
        "substeps": spec.substeps,
        "values": spec.values,
        "noise": _noise_of(spec),
        "unknown_inputs": list(spec.unknown_inputs) or None,
        **{
            key: [{"name": s.name, "prior": s.prior, **({"walk": s.walk} if s.walk else {})} for s in some] or None
            for key, considered in UNCERTAIN.items()
            for some in [[s for s in spec.parameter_states if s.considered == considered]]
        },
    }
    return Model({key: _plain(value) for key, value in table.items() if value is not None})


def _noise_of(spec: ModelSpec) -> dict[str, dict[str, float]]:
    """Return the variances of a record by kind; inputs are left out where all are exact."""
    process = {n: v for n, v in spec.process_noise.items() if n not in spec.model().within}
    variances = {"process": process, "measurement": spec.measurement_noise, "input": spec.input_noise}
    return {kind: noise for kind, noise in variances.items() if noise or kind != "input"}


def _list(names: Sequence[Any] | None) -> Any:
    return names if names is None or isinstance(names, str) else list(names)


def _plain(value: Any) -> Any:
    """Return a value with NumPy's numbers as Python's, at any depth, as TOML has them."""
    if isinstance(value, Mapping):
        return {str(k): _plain(v) for k, v in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(v) for v in value]
    return value.item() if hasattr(value, "item") and not getattr(value, "shape", ()) else value


def _merged(old: Mapping[str, Any], new: Mapping[str, Any]) -> dict[str, Any]:
    """Return a table with other entries, those of tables within it one by one."""
    merged = {**old}
    for key, value in new.items():
        inner = isinstance(value, Mapping) and isinstance(merged.get(key), Mapping)
        merged[key] = _merged(merged[key], value) if inner else value
    return {key: value for key, value in merged.items() if value is not None}
