"""``harness.Study``: estimators compared where the vehicle departs from what they believe."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, TypedDict, Unpack

from harness.api._show import Shown, keywords
from harness.api.drive import Drive
from harness.api.estimator import Estimator
from harness.api.model import Model
from harness.common.errors import UserError
from harness.common.places import place
from harness.config import build_study, load_study
from harness.config.specs import Device

if TYPE_CHECKING:
    from harness.api.results import Results

Quantity = float | str
Drives = str | Drive | Mapping[str, Any] | Sequence[str | Drive | Mapping[str, Any]]
Estimators = (
    Mapping[str, str | Estimator | Mapping[str, Any]] | str | Estimator | Sequence[str | Estimator | Mapping[str, Any]]
)


class StudyKeys(TypedDict, total=False):
    """Further keys of a study file.

    Attributes:
        title: The question, heading of the report.
        seed: Of all random numbers (default 0).
        tuning: File written by ``harness tune``.
        history: The runs to draw over time.
        limits: Largest tolerable RMSE by target.
        report: Further content of the report.
    """

    title: str
    seed: int
    tuning: str
    history: Mapping[str, Any] | Sequence[Mapping[str, Any]]
    limits: Mapping[str, Quantity]
    report: Mapping[str, Any]


class FactorKeys(TypedDict, total=False):
    """Further keys of a factor.

    Attributes:
        scale: ``linear`` by default.
        band: Half-width around each level or shift.
        labels: One per band.
    """

    scale: Literal["linear", "log"] | None
    band: Quantity | None
    labels: Sequence[str] | None


@keywords(FactorKeys)
def factor(
    parameter: str,
    *,
    of: Literal["plant", "belief", "both"] | None = None,
    unit: str | None = None,
    levels: Sequence[Quantity] | None = None,
    shift: Sequence[Quantity] | None = None,
    bands: Sequence[Quantity] | None = None,
    range: Sequence[Quantity] | None = None,
    distribution: str | Mapping[str, Any] | None = None,
    **further: Unpack[FactorKeys],
) -> dict[str, Any]:
    """Return a factor of a design: the table ``[[design.factor]]`` of a study file.

    Exactly one of levels, shift, bands, range and distribution is stated. A number is in SI units or in ``unit``, text
    carries its own.

    Args:
        parameter: Parameter of the model, or ``process_noise_scale``, ``measurement_noise_scale``,
            ``input_noise_scale``.
        of: Whose value it replaces; the plant's by default.
        unit: Of the labels and of plain numbers.
        levels: Values.
        shift: Differences from what is believed; percent is relative to it.
        bands: Half-widths around what is believed.
        range: One band by its edges.
        distribution: How likely which value is: a kind, or a mapping with more (docs/studies.md).
        further: See ``FactorKeys``.

    Example:
        >>> import harness as h
        >>> h.factor("mass", shift=["-10 %", "10 %"])
        {'parameter': 'mass', 'shift': ['-10 %', '10 %']}
    """
    varied = {"levels": levels, "shift": shift, "bands": bands, "range": range, "distribution": distribution}
    return _stated({"parameter": parameter, "of": of, "unit": unit, **varied, **further})


class PopulationKeys(TypedDict, total=False):
    """Keys of a population.

    Attributes:
        scramblings: Independent scramblings (default 8).
        correlation: Of two factors each.
        groups: Factors that are ranked as one.
        posterior: Result folder of ``harness identify`` or ``trace``, or a sample in a CSV file.
        model: Which model of the confusable set of a trace, the likeliest is 1.
        share: How likely it is that the vehicle is one of this design, in a ratio to the others.
    """

    scramblings: int | None
    correlation: Sequence[tuple[str, str, float]] | None
    groups: Mapping[str, Sequence[str]] | None
    posterior: str | None
    model: int | None
    share: float | None


@keywords(PopulationKeys)
def design(
    name: str,
    factors: Sequence[Mapping[str, Any]] = (),
    *,
    sampling: Literal["sobol", "saltelli", "tolerance", "population"] | None = None,
    samples: int | None = None,
    boxes: int | None = None,
    repeats: int | None = None,
    sobol_any_n: bool | None = None,
    **population: Unpack[PopulationKeys],
) -> dict[str, Any]:
    """Return a design: the table ``[[design]]`` of a study file.

    Args:
        name: Unique name, that of its group in the store.
        factors: From ``factor``; the i-th bands of all of them belong together. None for the nominal case alone.
        sampling: ``sobol`` by default, ``saltelli`` for sensitivity indices, ``tolerance`` for nested boxes,
            ``population`` for how often a limit is broken, and by which factors.
        samples: Sobol points per band (default 1).
        boxes: Nested boxes of a tolerance design.
        repeats: Runs with fresh noise per point (default 1).
        sobol_any_n: Allow a number of samples that is no power of two.
        population: See ``PopulationKeys``.

    Example:
        >>> import harness as h
        >>> h.design("loads", [h.factor("mass", range=["1.4 t", "1.9 t"])], samples=16)["samples"]
        16
    """
    keys = {"sampling": sampling, "samples": samples, "boxes": boxes, "repeats": repeats, "sobol_any_n": sobol_any_n}
    return {"name": name, "factor": [dict(each) for each in factors], **_stated({**keys, **population})}


def levels(
    parameter: str,
    values: Sequence[Quantity],
    repeats: int = 1,
    name: str = "",
    *,
    of: Literal["plant", "belief", "both"] | None = None,
    unit: str | None = None,
    scale: Literal["linear", "log"] | None = None,
    band: Quantity | None = None,
    labels: Sequence[str] | None = None,
) -> dict[str, Any]:
    """Return a design that varies one parameter over levels.

    Args:
        parameter: As in ``factor``.
        values: The levels.
        repeats: Runs with fresh noise per level and drive.
        name: Name of the design; that of the parameter by default.
        of: As in ``factor``.
        unit: As in ``factor``.
        scale: As in ``factor``.
        band: Half-width around each level.
        labels: One per level.

    Example:
        >>> import harness as h
        >>> h.levels("mass", ["1.4 t", "1.9 t"], repeats=8)["repeats"]
        8
    """
    varied = factor(parameter, of=of, unit=unit, levels=values, scale=scale, band=band, labels=labels)
    return design(name or parameter, [varied], repeats=repeats)


class Study(Shown):
    """A study: drives, plant, belief, estimators and what is varied.

    Arguments are the keys of a study file and mean the same (docs/studies.md); the tables of which a file may have
    several are in the plural here.

    Args:
        plant: The vehicle that is simulated: a model, or a mapping with the keys of ``[plant]``.
        belief: The model that the estimators assume: a model, or a mapping with the keys in which it differs from the
            plant, such as ``{"unknown_inputs": ["steering_wheel_angle"]}``. As the plant by default.
        targets: Quantities to score: states or ports of both models.
        drives: Drives; text names a file of drives.
        estimators: Kind or estimator by its name in tables and figures; without names, a list of them.
        designs: From ``levels`` or ``design``.
        name: Name of the study and of its result folder.
        folder: Files that it names are looked for here first.
        further: See ``StudyKeys``.

    Attributes:
        spec: The resolved record that all packages below take (internal).

    Raises:
        UserError: If anything in it is wrong; one line per problem.
        ModelError: If there is no such vehicle or parameter set.

    Example:
        >>> import harness as h
        >>> study = h.Study(
        ...     plant=h.model("car", "govindarajan_2018", sensors="car_series"),
        ...     targets=["lateral_velocity"],
        ...     drives=[h.drive("sine", duration="10 s", amplitude="20 deg")],
        ...     estimators={"EKF": "ekf", "UKF": h.Estimator("ukf", alpha=0.5)},
        ...     designs=[h.levels("mass", ["1.5 t", "1.8 t"], repeats=4)],
        ... )
        >>> study.runs
        16
    """

    @keywords(StudyKeys)
    def __init__(
        self,
        plant: Model | Mapping[str, Any],
        *,
        targets: Sequence[str],
        drives: Drives,
        estimators: Estimators,
        designs: Sequence[Mapping[str, Any]],
        belief: Model | Mapping[str, Any] | None = None,
        name: str = "study",
        folder: str | Path = "",
        **further: Unpack[StudyKeys],
    ) -> None:
        content = {
            "name": name,
            "targets": _listed(targets),
            "plant": _model_table(plant),
            **({} if belief is None else {"belief": _model_table(belief)}),
            **_drive_tables(drives),
            "estimator": _estimator_tables(estimators),
            "design": [dict(each) for each in ([designs] if isinstance(designs, Mapping) else designs)],
            **_stated(further),
        }
        self.spec = build_study(content, Path(folder) / name)

    @property
    def name(self) -> str:
        """Its name."""
        return self.spec.name

    @property
    def runs(self) -> int:
        """Number of runs, each estimator's counted."""
        drives, estimators = len(self.spec.drives), len(self.spec.estimators)
        return sum(d.bands * d.samples * d.repeats for d in self.spec.designs) * drives * estimators

    @property
    def toml(self) -> str:
        """The study file that states the same."""
        return self.spec.text

    def run(
        self,
        out: str | Path | None = None,
        jobs: int | None = None,
        *,
        scheduler: str | None = None,
        dask: Literal["local"] | None = None,
        agree: Callable[[str], None] | None = None,
        restart: bool = False,
        device: Device = "cpu",
    ) -> Results:
        """Run the study and return its results.

        An interrupted run continues where it stopped, and a finished one computes nothing again. The scores are
        identical to the bit for any number of workers. Progress is shown on stderr.

        Args:
            out: Result folder or its URL (docs/cluster.md); ``results/<name>`` by default.
            jobs: Worker threads, or processes with ``dask``; all cores by default.
            scheduler: Address of a Dask scheduler whose workers run it (docs/cluster.md).
            dask: ``"local"`` runs it on Dask worker processes of this machine.
            agree: Called before anything is computed that takes above an hour or 10 GB, with what it takes in words; an
                error that it raises keeps the run from beginning. Nobody is asked by default.
            restart: Throw away the result that is in the folder.
            device: ``"cuda"`` runs it on a graphics card (docs/gpu.md).

        Raises:
            UserError: If the folder holds another study's result or is being written by another process, a worker of
                the cluster does not fit, or there is no card to run on.
            WorkError: If the disk is full.

        Example:
            >>> import tempfile, harness as h
            >>> study = h.Study(
            ...     plant=h.model("car", "govindarajan_2018", sensors="car_series"),
            ...     targets=["lateral_velocity"],
            ...     drives=[h.drive("sine", duration="10 s", amplitude="20 deg")],
            ...     estimators=["ekf"],
            ...     designs=[h.levels("mass", ["1.5 t", "1.8 t"], repeats=4)],
            ... )
            >>> results = study.run(tempfile.mkdtemp(), jobs=1)
            >>> results["mass"].rmse.sizes["repeat"], len(results.to_dataframe())
            (4, 8)
        """
        from harness.api.results import open_results
        from harness.study.run import run_study

        if scheduler is not None and (dask is not None or jobs is not None):
            raise UserError("scheduler says which workers run the study; leave out dask and jobs")
        if device != "cpu" and (scheduler is not None or dask is not None or jobs is not None):
            raise UserError("a graphics card runs the study by itself; leave out scheduler, dask and jobs")
        if self.spec.monitor is not None:
            from harness.remedy.monitor.run import window_of

            window_of(self.spec, self.spec.monitor)  # before hours of runs
        with contextlib.ExitStack() as stack:
            client = None
            if scheduler is not None or dask is not None:
                from harness.study.cluster import connected, refuse_objects

                refuse_objects(self.spec)
                client = stack.enter_context(connected(scheduler, jobs))
            folder = Path("results") / self.name if out is None else place(out)
            run_study(self.spec, folder, jobs, client=client, agree=agree, restart=restart, device=device)
        self._count_monitors(folder, jobs)
        return open_results(folder)

    def _count_monitors(self, folder: Path, jobs: int | None) -> None:
        """Count the trust monitors that the study asks for, and say of which estimator there is none."""
        if self.spec.monitor is None:
            return
        from rich.console import Console
        from rich.text import Text

        from harness.common.stages import showing
        from harness.remedy.monitor.of_study import write

        console = Console(stderr=True)
        with showing(console, "looking at what is counted of trust monitors") as show:
            missing = write(self.spec, folder, jobs, show)
        for sentence in missing:
            console.print(Text(sentence), soft_wrap=True)

    def _facts(self) -> dict[str, Any]:
        study = self.spec
        return {
            "question": study.title,
            "targets": ", ".join(study.targets),
            "plant": study.plant.model().name,
            "belief": study.belief.model().name,
            "drives": ", ".join(d.name for d in study.drives),
            "estimators": ", ".join(e.name for e in study.estimators),
            "designs": ", ".join(f"{d.name} ({', '.join(d.band_labels)})" for d in study.designs),
            "runs": self.runs,
        }

    def _title(self) -> str:
        return f"Study '{self.name}'"


def read_study(path: str | Path, quick: bool = False) -> Study:
    """Read a study file.

    Args:
        path: TOML file; files it names are looked for in its folder first.
        quick: Few drives and runs for a first look, under a name of its own.

    Raises:
        UserError: If anything in it is wrong; one line per problem.

    Example:
        >>> import tempfile, pathlib, harness as h
        >>> file = pathlib.Path(tempfile.mkdtemp()) / "small.toml"
        >>> _ = file.write_text('''
        ... name = "small"
        ... targets = ["lateral_velocity"]
        ... [plant]
        ... vehicle = "car"
        ... parameters = "govindarajan_2018"
        ... tyre = "magic_formula"
        ... sensors = "car_series"
        ... [[drive]]
        ... name = "sine"
        ... kind = "sine"
        ... amplitude = "20 deg"
        ... [[estimator]]
        ... kind = "ekf"
        ... [[design]]
        ... name = "nominal"
        ... ''')
        >>> h.read_study(file).runs
        1
    """
    study = Study.__new__(Study)
    study.spec = load_study(path, quick)
    return study


def _model_table(given: Model | Mapping[str, Any]) -> dict[str, Any]:
    return given.table() if isinstance(given, Model) else dict(given)


def _drive_tables(given: Drives) -> dict[str, Any]:
    """Return drives by the keys of a study file: ``drives`` are files, ``drive`` tables."""
    several = [given] if isinstance(given, str | Drive | Mapping) else list(given)
    files = [each for each in several if isinstance(each, str)]
    tables = [each.table() if isinstance(each, Drive) else each for each in several if not isinstance(each, str)]
    return {**({"drives": files} if files else {}), **({"drive": tables} if tables else {})}


def _estimator_tables(given: Estimators) -> list[dict[str, Any]]:
    if isinstance(given, Mapping):
        return [{**_estimator_table(each), "name": name} for name, each in given.items()]
    return [_estimator_table(each) for each in ([given] if isinstance(given, str | Estimator) else given)]


def _estimator_table(given: str | Estimator | Mapping[str, Any]) -> dict[str, Any]:
    if isinstance(given, str):
        return {"kind": given}
    return given.table() if isinstance(given, Estimator) else dict(given)


def _stated(keys: Mapping[str, Any]) -> dict[str, Any]:
    """Return the keys that were stated, their values as TOML has them."""
    return {key: _listed(value) for key, value in keys.items() if value is not None}


def _listed(value: Any) -> Any:
    """Return a sequence or array as the list that TOML has for it."""
    if hasattr(value, "tolist"):
        return value.tolist()
    return [_listed(each) for each in value] if isinstance(value, list | tuple) else value
