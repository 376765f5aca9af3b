"""Resolved specifications of a study: names checked, units SI, defaults filled in.

All later stages read these records and never the TOML file.
"""

from __future__ import annotations

import functools
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

from harness.common.components import remembered
from harness.config.marginals import Marginal
from harness.external.description import Description
from harness.external.opaque import opaque_model
from harness.models.assembly.assemble import StateSpaceModel, assemble
from harness.models.assembly.degradation import with_degradations
from harness.models.assembly.parameter_states import ParameterState, with_parameters
from harness.models.assembly.placement import load_effect
from harness.models.roles import SENSORS, VEHICLES

Side = Literal["plant", "belief", "both"]
Integrator = Literal["euler", "heun", "rk4"]
Sampling = Literal["sobol", "saltelli", "tolerance", "population"]

NOISE_SCALES: tuple[str, ...] = ("process_noise_scale", "measurement_noise_scale", "input_noise_scale")
"""Pseudo-parameters a factor may vary: they multiply all variances of one kind; nominal value 1."""

InputSignal = Literal["filtered", "measured"]
"""Value that an estimator takes for an input measured with noise: given its past, or as measured."""

NOISE_GROUPS: tuple[str, ...] = ("process", "unknown_inputs", "measurement")
"""Groups of variances that tuning multiplies by a factor each."""


Device = Literal["cpu", "cuda"]
"""Device of a study: the cores of a processor, or a graphics card of NVIDIA."""


@dataclass(frozen=True)
class ExternalSpec:
    """A plant of somebody else.

    Attributes:
        description: What is known of it without its file.
        folders: In which its file is looked for.
        timeout: Longest time in s by the clock that a run may take.
    """

    description: Description
    folders: tuple[Path, ...] = ()
    timeout: float = 60.0


@dataclass(frozen=True)
class ModelSpec:
    """One vehicle with everything needed to run it: the truth (plant) or what an estimator believes.

    Attributes:
        vehicle: File in ``models/vehicles``; empty for a plant of somebody else.
        parameters: Name of the parameter set, or path of a parameter file.
        tyre: File in ``models/tyres``; ``None`` for a vehicle without tyres.
        effects: Files in ``models/effects``, in the order they act.
        sensors: File in ``models/sensors``.
        integrator: Scheme of one substep.
        step: Sample time in s.
        substeps: Integration steps per sample.
        values: Every parameter of vehicle, tyre and effects, SI.
        process_noise: Variance per step of every state (unknown inputs included), SI squared.
        measurement_noise: Variance per sample of every output, SI squared.
        input_noise: Variance per sample of the inputs that estimators get with noise, SI squared; others are exact.
        unknown_inputs: Inputs estimated as random walks (belief only; Ziaukas 2023, 2.32 and 2.33).
        parameter_states: Parameters that are not known for sure, estimated or considered (belief only).
        external: The plant, where somebody else wrote it; the states of its model are its disturbances.
    """

    vehicle: str
    parameters: str
    tyre: str | None
    effects: tuple[str, ...]
    sensors: str
    integrator: Integrator
    step: float
    substeps: int
    values: dict[str, float]
    process_noise: dict[str, float]
    measurement_noise: dict[str, float]
    unknown_inputs: tuple[str, ...] = ()
    input_noise: dict[str, float] = field(default_factory=dict)
    parameter_states: tuple[ParameterState, ...] = ()
    external: ExternalSpec | None = None

    @property
    def estimated_parameters(self) -> tuple[str, ...]:
        """Names of the parameters that are estimated."""
        return tuple(s.name for s in self.parameter_states if not s.considered)

    def model(self) -> StateSpaceModel:
        """Return the assembled model, augmented by all that is unknown; the same object on every call."""
        if self.external is not None:
            return self._opaque
        names = self.vehicle, self.tyre, self.effects, self.sensors
        return assembled(*names, self.unknown_inputs, self.parameter_states)

    @property
    def wheelbase(self) -> float:
        """Wheelbase in m that limits a drive; 1 where the vehicle does not say."""
        if self.external is not None:
            return self.external.description.wheelbase or 1.0
        vehicle = VEHICLES.load(self.vehicle)
        return float(vehicle.wheelbase(self.values)) if hasattr(vehicle, "wheelbase") else 1.0

    @property
    def steering_ratio(self) -> float:
        """Steering wheel angle over the angle of the road wheels that limits a drive; 1 where the vehicle has none."""
        if self.external is not None:
            return self.external.description.steering_ratio or 1.0
        return self.values.get("steering_ratio", 1.0)

    @functools.cached_property
    def _opaque(self) -> StateSpaceModel:
        assert self.external is not None
        plain = opaque_model(self.external.description, SENSORS.load(self.sensors).OUTPUTS)
        return with_degradations(plain, {name: load_effect(name) for name in self.effects})


@remembered
@functools.lru_cache(maxsize=64)
def assembled(
    vehicle: str,
    tyre: str | None,
    effects: tuple[str, ...],
    sensors: str,
    unknown_inputs: tuple[str, ...],
    parameter_states: tuple[ParameterState, ...] = (),
) -> StateSpaceModel:
    """Return the model of these names, assembled once."""
    model = assemble(vehicle, tyre, effects, sensors)
    if unknown_inputs:
        model = model.augment(unknown_inputs)
    return with_parameters(model, parameter_states, VEHICLES.load(vehicle)) if parameter_states else model


@dataclass(frozen=True)
class DriveSpec:
    """A drive by name; its options stay as written, ``harness.simulation.drives`` resolves them.

    Attributes:
        name: Unique name within the study.
        kind: File in ``models/drives``.
        options: Options as in the file, numbers in SI or text with a unit.
        where: File and key of the table, for errors.
        base: Folder against which relative file names of the options are resolved.
    """

    name: str
    kind: str
    options: dict[str, Any]
    where: str = ""
    base: Path = Path()


@dataclass(frozen=True)
class EstimatorSpec:
    """An estimator by unique name.

    Attributes:
        name: Name in tables and figures.
        kind: File in ``harness/estimation/methods``.
        settings: Settings, checked and completed by the ``Settings`` of that file where it has one.
        base: Folder against which relative file names of the settings are resolved.
        noise: Factors on the variances it believes, by ``NOISE_GROUPS``; empty if it is not tuned.
        input_signal: What it takes for inputs with noise, as stated; ``None`` if nothing is.
    """

    name: str
    kind: str
    settings: dict[str, Any]
    base: Path = Path()
    noise: dict[str, float] = field(default_factory=dict)
    input_signal: InputSignal | None = None


@dataclass(frozen=True)
class FactorSpec:
    """One quantity a design varies.

    Attributes:
        parameter: Parameter of the model, or one of ``NOISE_SCALES``.
        of: Whose value it replaces.
        unit: SI unit.
        report_unit: Unit of the labels (pint).
        nominal: What the belief holds (the plant, if the belief has no such parameter), SI.
        levels: Centre of each band, SI, shape ``(bands,)``.
        lower: Lower edge of each band, SI, the level itself where it has no band, shape ``(bands,)``.
        upper: Upper edge of each band, SI, shape ``(bands,)``.
        labels: One label per band.
        log: Whether a band is sampled evenly in the logarithm of the value.
        marginal: How likely which value is; ``None`` for levels and for bands, which are filled evenly.
    """

    parameter: str
    of: Side
    unit: str
    report_unit: str
    nominal: float
    levels: tuple[float, ...]
    lower: tuple[float, ...]
    upper: tuple[float, ...]
    labels: tuple[str, ...]
    log: bool = False
    marginal: Marginal | None = None

    @property
    def written(self) -> str:
        """Name by which a design tells the factor from another one of the same parameter."""
        return f"belief.{self.parameter}" if self.of == "belief" else self.parameter

    @property
    def banded(self) -> bool:
        """Whether any band has a width, so that the factor takes a dimension of the Sobol sequence."""
        return any(low < high for low, high in zip(self.lower, self.upper, strict=True))


@dataclass(frozen=True)
class DesignSpec:
    """One set of cases: the i-th bands of all factors belong together.

    Attributes:
        name: Unique name within the study.
        factors: What is varied; empty for the nominal case alone.
        base_samples: Points of the Sobol sequence that the design is made from.
        repeats: Runs with fresh noise per point and drive.
        sampling: How the bands are filled, see ``harness.study.design``.
        scramblings: Independent scramblings, each with ``base_samples`` points.
        correlation: Of the normal scores of the factors, one row each; empty where they are independent.
        correlation_change: Largest difference of it from what was stated, which was no correlation matrix.
        groups: Factors that are ranked as one, by the name of the group; they decide no score.
        share: How likely it is that the vehicle is one of these, in a ratio to other designs; it decides no score.
    """

    name: str
    factors: tuple[FactorSpec, ...]
    base_samples: int = 1
    repeats: int = 1
    sampling: Sampling = "sobol"
    scramblings: int = 1
    correlation: tuple[tuple[float, ...], ...] = ()
    correlation_change: float = 0.0
    groups: tuple[tuple[str, tuple[str, ...]], ...] = ()
    share: float | None = None

    @property
    def samples(self) -> int:
        """Points per band."""
        match self.sampling:
            case "saltelli":  # A, B and A with one column of B for each factor (Saltelli et al. 2010)
                return self.base_samples * (len(self.factors) + 2)
            case "tolerance":  # the nominal point, each factor alone at both edges, the box
                return 1 + 2 * len(self.factors) + self.base_samples
        return self.base_samples * self.scramblings

    @property
    def common_noise(self) -> bool:
        """Whether all points share their noise, so that the error is a function of the factors alone."""
        return self.sampling in ("saltelli", "tolerance")

    @property
    def bands(self) -> int:
        """Number of bands (levels)."""
        return len(self.factors[0].levels) if self.factors else 1

    @property
    def band_labels(self) -> tuple[str, ...]:
        """One label per band; factors that vary together under one label (``±10 %``) share it."""
        if not self.factors:
            return ("nominal",)
        together = zip(*(f.labels for f in self.factors), strict=True)
        return tuple(
            row[0]
            if len(set(row)) == 1
            else ", ".join(f"{f.parameter} {label}" for f, label in zip(self.factors, row, strict=True))
            for row in together
        )


@dataclass(frozen=True)
class HistorySpec:
    """A run that the report draws over time (as Ziaukas 2023, Bild 5.10).

    Attributes:
        name: What the report calls it; empty for its band and drive.
        design: Name of the design.
        band: Index of the band in it.
        drive: Name of the drive.
        levels: The band's levels by parameter, SI.
        sample: Index of the Sobol point.
        repeat: Index of the repeat.
        signals: Quantities of the belief to draw in addition to the targets and the unknown inputs.
    """

    name: str
    design: str
    band: int
    drive: str
    levels: dict[str, float] = field(default_factory=dict)
    sample: int = 0
    repeat: int = 0
    signals: tuple[str, ...] = ()


@dataclass(frozen=True)
class OverTimeSpec:
    """The drive along which errors are kept in windows, for sensitivity indices over time.

    Attributes:
        design: Name of the design, sampled by ``saltelli``.
        drive: Name of the drive.
        window: Length of a window in s.
    """

    design: str
    drive: str
    window: float


@dataclass(frozen=True)
class RareEventSpec:
    """An event whose probability is estimated by subset simulation; it decides no score.

    Attributes:
        design: Name of the design, sampled by ``population``.
        target: Whose largest error is compared.
        limit: With what, SI.
        estimator: Name of the estimator.
        samples: Points of a level.
    """

    design: str
    target: str
    limit: float
    estimator: str
    samples: int


@dataclass(frozen=True)
class MonitorSpec:
    """What a trust monitor is to be; it decides no score.

    Attributes:
        limits: Error of a target that matters, SI.
        window: Over which it averages, in s.
        per_hour: False alarms that it may give in an hour.
        within: In which it has to speak of an error, in s.
        runs: Of a level and drive that are counted, at most.
        estimators: Names of those that are watched.
    """

    limits: dict[str, float]
    window: float = 2.0
    per_hour: float = 1.0
    within: float = 3.0
    runs: int = 40
    estimators: tuple[str, ...] = ()


@dataclass(frozen=True)
class CountFrom:
    """Where the counts begin that the random numbers of a run depend on.

    A study that runs some runs of another one begins where those are, and gets the same noise.

    Attributes:
        drive: Count of the first drive.
        sample: Count of the first Sobol point.
        repeat: Count of the first repeat.
    """

    drive: int = 0
    sample: int = 0
    repeat: int = 0


@dataclass(frozen=True)
class StudySpec:
    """A study, resolved by ``load_study`` or ``build_study``.

    Attributes:
        name: Name of the result folder.
        title: The question the report answers.
        seed: Seed of all random numbers; 0 is a seed like any other.
        targets: Quantities that are scored; both models have them.
        plant: The vehicle that is simulated.
        belief: The model that the estimators assume.
        drives: At least one.
        estimators: At least one.
        designs: At least one.
        history: The runs to draw over time; possibly none.
        text: The study file as read, or as it would be written.
        tuning: The rule by which the estimators' noise was tuned; empty if it is the belief's.
        limits: Largest error that counts as tolerable by target, SI; it decides no score, only what the report says.
        over_time: The drive for sensitivity over time; ``None`` if it was not asked for.
        score_after: s at the beginning of every drive that no score counts.
        bound: Whether the report shows the posterior Cramer-Rao bound; it decides no score.
        probability_within: Half-width of the interval of a probability for which the report counts points.
        rare_event: What subset simulation estimates after the run; ``None`` if it was not asked for.
        monitor: What is counted of trust monitors after the run; ``None`` if it was not asked for.
        count_from: Where the counts begin that random numbers depend on.
        hash: SHA-256 of what the study computes: independent of comments, layout, title and labels; changes
            with every resolved number, with the drives' options and with the content of recorded files.
        path: The study file.
        device: What computes its scores, ``cpu`` or ``cuda``; the numbers differ by rounding.
    """

    name: str
    title: str
    seed: int
    targets: tuple[str, ...]
    plant: ModelSpec
    belief: ModelSpec
    drives: tuple[DriveSpec, ...]
    estimators: tuple[EstimatorSpec, ...]
    designs: tuple[DesignSpec, ...]
    history: tuple[HistorySpec, ...]
    text: str
    hash: str
    path: Path
    tuning: str = ""
    limits: dict[str, float] = field(default_factory=dict)
    over_time: OverTimeSpec | None = None
    score_after: float = 0.0
    count_from: CountFrom = CountFrom()
    bound: bool = False
    probability_within: float = 0.01
    rare_event: RareEventSpec | None = None
    monitor: MonitorSpec | None = None
    device: Device = "cpu"

    def design(self, name: str) -> DesignSpec:
        """Return a design by name."""
        return next(d for d in self.designs if d.name == name)

    def drive(self, name: str) -> DriveSpec:
        """Return a drive by name."""
        return next(d for d in self.drives if d.name == name)
