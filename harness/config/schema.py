"""The study file as pydantic models: which keys there are, what they hold, and the JSON schema of it."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import BeforeValidator, Field, StrictBool, StrictInt, StrictStr, Tag

from harness.common.errors import UserError
from harness.common.files import write_files
from harness.config.design_tables import DesignTable
from harness.config.key_types import FileName, Name, Number, OpenTable, Quantity, StrictTable, Text, one_of
from harness.config.problems import LIST, TABLE, TEXT


class NoiseTable(StrictTable):
    """``[plant.noise]``, ``[belief.noise]``."""

    process_scale: Quantity | None = Field(default=None, description="factor on every process-noise variance")
    measurement_scale: Quantity | None = Field(default=None, description="factor on every measurement-noise variance")
    input_scale: Quantity | None = Field(default=None, description="factor on every input-noise variance")
    process: dict[str, Quantity] = Field(
        default_factory=dict, description="variance per step by state, square of the state's SI unit"
    )
    measurement: dict[str, Quantity] = Field(
        default_factory=dict, description="variance per sample by output, square of the output's SI unit"
    )
    input: dict[str, Quantity] = Field(
        default_factory=dict,
        description="variance per sample by input signal, square of the signal's SI unit; other inputs are exact",
    )


class UncertainTable(StrictTable):
    """An entry of ``unknown_parameters`` or ``considered_parameters`` with more than a name."""

    name: Name = Field(description="parameter of the model or of its load")
    prior: Quantity | None = Field(
        default=None,
        description="standard deviation with which its value is known (default: that of the parameter set)",
    )
    walk: Quantity | None = Field(
        default=None, description='standard deviation of its random walk, "0.1 m/sqrt(h)" (default: a constant)'
    )


UncertainParameter = Annotated[Text | Annotated[UncertainTable, Tag(TABLE)], one_of(TEXT, TABLE)]


class ModelTable(StrictTable):
    """``[plant]``, ``[belief]``."""

    vehicle: Name | None = Field(default=None, description="file in models/vehicles")
    fmu: Name | None = Field(default=None, description="[plant] only: FMU in place of a vehicle")
    map: Name | None = Field(default=None, description="[plant] only: TOML file that maps signals to those of the FMU")
    python: Name | None = Field(default=None, description="[plant] only: module:Class in place of a vehicle")
    interface: Literal["co-simulation", "model-exchange"] | None = Field(
        default=None,
        description="of an FMU with both (default co-simulation; integrator and substeps are of the other)",
    )
    timeout: Quantity | None = Field(
        default=None, description="of an FMU or a Python class: longest time that a run may take (default 60 s)"
    )
    described: dict[str, Any] | None = Field(
        default=None, description="what a store knows of an FMU or a Python class; written by the program"
    )
    parameters: Name | None = Field(
        default=None, description="file in models/parameters, or path of a TOML parameter file"
    )
    tyre: Name | None = Field(default=None, description="file in models/tyres")
    effects: list[Name] | None = Field(
        default=None,
        description="files in models/effects, in the order they act; `effect@place` acts at one place; none if absent",
    )
    sensors: Name | None = Field(
        default=None, description="file in models/sensors, or signals with commas between them"
    )
    integrator: Literal["euler", "heun", "rk4"] | None = Field(
        default=None, description="scheme of one substep (default euler)"
    )
    step: Quantity | None = Field(default=None, description="sample time (default 0.01 s)")
    substeps: Annotated[StrictInt, Field(ge=1, le=1000)] | None = Field(
        default=None, description="integration steps per sample (default 1)"
    )
    values: dict[str, Quantity] = Field(
        default_factory=dict, description="parameters that differ from the parameter set"
    )
    noise: NoiseTable = Field(default=NoiseTable(), description="noise that differs from the parameter set")
    unknown_inputs: list[Name] | None = Field(
        default=None, description="[belief] only: inputs to be estimated as random walks"
    )
    unknown_parameters: list[UncertainParameter] | None = Field(
        default=None, description="[belief] only: parameters to be estimated in addition to the states"
    )
    considered_parameters: list[UncertainParameter] | None = Field(
        default=None, description="[belief] only: parameters whose uncertainty is reckoned with, not estimated"
    )


class DriveTable(OpenTable):
    """``[[drive]]``: name, kind and the options of the kind (``harness list drives``)."""

    name: Name = Field(description="unique name")
    kind: Name = Field(description="file in models/drives")


class DrivesFile(StrictTable):
    """A file of drives, ``studies/drives/<name>.toml``."""

    title: StrictStr = Field(default="", description="what the drives are for")
    drive: list[DriveTable] = Field(min_length=1, description="the drives")


class EstimatorTable(OpenTable):
    """``[[estimator]]``: name, kind and the settings of the kind."""

    name: Name | None = Field(default=None, description="unique name in tables and figures (default: the kind)")
    kind: Name = Field(description="file in harness/estimation/methods")
    input_signal: Literal["filtered", "measured"] | None = Field(
        default=None,
        description="what it takes for an input with noise: filtered over its past (default), or as measured",
    )


class VarianceFactorsTable(StrictTable):
    """``[tuning.estimator.<name>]``: factors on the variances that an estimator believes."""

    process: Number = Field(description="on those of the states")
    unknown_inputs: Number = Field(description="on those of the random walks of unknown inputs")
    measurement: Number = Field(description="on those of the outputs")


class TuningTable(StrictTable):
    """``[tuning]``: the content of a tuning file in the place of its name."""

    rule: StrictStr = Field(default="stated", description="how the factors came about")
    estimator: dict[str, VarianceFactorsTable] = Field(description="factors by the name of the estimator")


def as_table(estimator: Any) -> Any:
    """Return the table of an estimator that is given by its kind alone."""
    return {"kind": estimator} if isinstance(estimator, str) else estimator


Estimators = list[Annotated[EstimatorTable, BeforeValidator(as_table, json_schema_input_type=Name | EstimatorTable)]]


class HistoryTable(StrictTable):
    """``[history]``, or ``[[history]]`` for several: a run that is drawn over time."""

    name: StrictStr = Field(default="", description="what the report calls it; default: band and drive")
    design: Name = Field(description="name of a design")
    drive: Name = Field(description="name of a drive")
    levels: dict[str, Quantity] = Field(default_factory=dict, description="levels by parameter, as in the design")
    band: Name | None = Field(default=None, description="label of the band, where the design has no levels")
    sample: Annotated[StrictInt, Field(ge=0)] = Field(default=0, description="index of the Sobol point, from 0")
    repeat: Annotated[StrictInt, Field(ge=0)] = Field(default=0, description="index of the repeat, from 0")
    signals: list[Name] = Field(
        default_factory=list,
        description="further states or ports of the belief to draw, in addition to targets and unknown inputs",
    )


class OverTimeTable(StrictTable):
    """``sensitivity_over_time`` of ``[report]``."""

    design: Name = Field(description="name of a design with sampling = 'saltelli'")
    drive: Name = Field(description="name of a drive")
    window: Quantity = Field(default="1 s", description="length of the windows in which the error is taken")


class RareEventTable(StrictTable):
    """``rare_event`` of ``[report]``."""

    design: Name = Field(description="name of a design with sampling = 'population'")
    target: Name = Field(description="whose largest error on the worst drive exceeds the limit")
    limit: Quantity | None = Field(default=None, description="the limit (default: that of `limits`)")
    estimator: Name | None = Field(default=None, description="name of the estimator (default: the first)")
    samples: Annotated[StrictInt, Field(ge=100, multiple_of=10)] = Field(
        default=1000, description="points of each level of subset simulation"
    )


class MonitorTable(StrictTable):
    """``monitor`` of ``[report]``."""

    limits: dict[str, Quantity] = Field(
        default_factory=dict, description="error that matters by target (default: `limits` of the study)"
    )
    estimators: list[Name] = Field(default_factory=list, description="names of estimators (default: the first)")
    window: Quantity = Field(default="2 s", description="time over which innovations are averaged")
    false_alarms: Annotated[Number, Field(gt=0)] = Field(
        default=1.0, description="allowed in an hour where all is as believed"
    )
    within: Quantity = Field(default="3 s", description="time in which an error has to be said")
    runs: Annotated[StrictInt, Field(ge=1)] = Field(
        default=40, description="of each level and drive that are counted, at most"
    )


class ReportTable(StrictTable):
    """``[report]``: what the report shows beyond what every report shows."""

    sensitivity_over_time: OverTimeTable | None = Field(
        default=None, description="sensitivity indices along a drive; the errors per window are kept in the store"
    )
    rare_event: RareEventTable | None = Field(
        default=None, description="an event too rare for the points of a population, by subset simulation after the run"
    )
    monitor: MonitorTable | None = Field(
        default=None, description="trust monitors of estimators, calibrated and counted after the run (docs/monitor.md)"
    )
    probability_within: Quantity = Field(
        default=0.01,
        description="half-width of the interval of a probability that the report says the points needed for (1 %)",
    )
    bound: StrictBool = Field(
        default=False, description="the smallest error that anyone could reach with these sensors, in the box plots"
    )


Histories = Annotated[
    Annotated[HistoryTable, Tag(TABLE)] | Annotated[list[HistoryTable], Tag(LIST)], one_of(TABLE, LIST)
]


class CountTable(StrictTable):
    """``count_from``: where the counts begin that the random numbers of a run depend on."""

    drive: Annotated[StrictInt, Field(ge=0)] = Field(default=0, description="count of the first drive")
    sample: Annotated[StrictInt, Field(ge=0)] = Field(default=0, description="count of the first Sobol point")
    repeat: Annotated[StrictInt, Field(ge=0)] = Field(default=0, description="count of the first repeat")


class StudyFile(StrictTable):
    """A study: the errors of estimators when the plant departs from the belief."""

    name: FileName = Field(description="name of the result folder")
    title: StrictStr = Field(default="", description="the question, heading of the report")
    seed: Annotated[StrictInt, Field(ge=0)] = Field(default=0, description="seed of all random numbers")
    count_from: CountTable = Field(
        default=CountTable(), description="where drives, Sobol points and repeats begin to count for random numbers"
    )
    targets: Annotated[list[Name], Field(min_length=1)] = Field(
        description="quantities to score: states or ports of both models"
    )
    tuning: Annotated[Text | Annotated[TuningTable, Tag(TABLE)], one_of(TEXT, TABLE)] | None = Field(
        default=None,
        description="file written by harness tune, or its table: factors on the noise each estimator believes",
    )
    score_after: Quantity = Field(
        default=0.0, description="time at the beginning of every drive that no score counts: estimators settle"
    )
    drives: Annotated[Text | Annotated[list[Name], Tag(LIST)], one_of(TEXT, LIST)] = Field(
        default_factory=list, description="files of drives: drives/<name>.toml next to the study"
    )
    drive: list[DriveTable] = Field(default_factory=list, description="drives of this study only")
    plant: ModelTable = Field(description="the vehicle that is simulated")
    belief: ModelTable = Field(
        default=ModelTable(), description="the model that the estimators assume; default: as the plant"
    )
    estimator: Annotated[Estimators, Field(min_length=1)] = Field(
        description="the estimators to compare: tables, or kinds alone"
    )
    design: Annotated[list[DesignTable], Field(min_length=1)] = Field(description="what is varied")
    history: Histories = Field(default_factory=list, description="the runs to plot over time")
    limits: dict[str, Quantity] = Field(
        default_factory=dict, description="largest tolerable RMSE by target, for the tolerance map"
    )
    report: ReportTable = Field(default=ReportTable(), description="further content of the report")

    @property
    def histories(self) -> dict[str, HistoryTable]:
        """The runs to draw by their key in the file: ``history`` alone, or ``history[0]`` and so on."""
        if isinstance(self.history, HistoryTable):
            return {"history": self.history}
        return {f"history[{i}]": table for i, table in enumerate(self.history)}


class ParameterFile(StrictTable):
    """A parameter set as a TOML file, for a vehicle without a file in ``models/parameters``."""

    vehicle: Name = Field(description="file in models/vehicles")
    tyre: Name | None = Field(default=None, description="file in models/tyres that the values belong to")
    effects: list[Name] = Field(
        default_factory=list, description="files in models/effects that are in force with these values"
    )
    sensors: Name | None = Field(
        default=None, description="file in models/sensors, or signals with commas between them, unless others are named"
    )
    source: StrictStr = Field(default="", description="where the values come from")
    noise_step: Quantity = Field(default=0.01, description="step in s to which the process noise belongs")
    values: dict[str, Quantity] = Field(description="parameters of vehicle and tyre")
    std: dict[str, Quantity] = Field(
        default_factory=dict, description="standard deviation with which a value is known, by parameter"
    )
    unknown_inputs: list[Name] = Field(
        default_factory=list, description="inputs that an estimator with these values estimates"
    )
    unknown_parameters: list[UncertainParameter] = Field(
        default_factory=list, description="parameters that an estimator with these values estimates"
    )
    considered_parameters: list[UncertainParameter] = Field(
        default_factory=list, description="parameters whose uncertainty an estimator with these values reckons with"
    )
    warning: StrictStr = Field(default="", description="what whoever takes these values has to know")
    process_noise: dict[str, Quantity] = Field(default_factory=dict, description="variance per step by state")
    measurement_noise: dict[str, Quantity] = Field(default_factory=dict, description="variance per sample by output")


def study_schema() -> dict[str, Any]:
    """Return the JSON schema of a study file, for editors that check TOML while one types."""
    schema = StudyFile.model_json_schema()
    schema["$schema"] = "https://json-schema.org/draft/2020-12/schema"
    return schema


def write_schema(path: Path) -> Path:
    """Write the JSON schema of a study file and return its path.

    Raises:
        UserError: If its folder is not there, or cannot be written to.
    """
    if not path.parent.is_dir():
        raise UserError(f"{path}: there is no folder {path.parent}; make it first")
    return write_files(path.parent, {path.name: json.dumps(study_schema(), indent=2) + "\n"})[0]
