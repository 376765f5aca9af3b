"""Drives and estimators, of a study or stated alone, and options of its report, all checked."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, TypeVar

from pydantic import BaseModel

from harness.common import locations, registry
from harness.common.errors import UserError
from harness.common.files import read_toml
from harness.common.units import refuse_misread, to_si
from harness.config.problems import Problems, validated
from harness.config.roles import ESTIMATORS
from harness.config.schema import DrivesFile, DriveTable, EstimatorTable, OpenTable, StudyFile
from harness.config.specs import DesignSpec, DriveSpec, EstimatorSpec, MonitorSpec, OverTimeSpec, RareEventSpec
from harness.external.references import located
from harness.models.drive_options import options_of
from harness.models.signals import SIGNALS

_Open = TypeVar("_Open", bound=OpenTable)


def load_drives(name: str, folder: Path) -> tuple[DriveSpec, ...]:
    """Return the drives of a set, by its name or the path of a TOML file.

    A name is looked for in ``<folder>/drives`` first, then as ``harness.common.locations`` does.

    Raises:
        UserError: If there is no such file or a drive in it is wrong.
    """
    problems = Problems("drives", "drives")
    drives = drives_of(StudyFile.model_construct(drives=name, drive=[]), folder, problems)
    problems.stop()
    return tuple(drives)


def drives_of(raw: StudyFile, folder: Path, problems: Problems) -> list[DriveSpec]:
    """Return the drives of the named files, in order, and then those of the study itself."""
    drives: list[DriveSpec] = []
    for name in [raw.drives] if isinstance(raw.drives, str) else raw.drives:
        path = folder / name
        if not name.endswith(".toml"):
            try:
                path = locations.find(locations.DRIVE_SETS, name, folder / "drives")
            except UserError as error:
                problems.add("drives", str(error))
                continue
        elif not path.is_file():
            problems.add("drives", f"there is no file {path}")
            continue
        inner = problems.for_file(str(path))
        try:
            content = validated(read_toml(path), DrivesFile, inner)
        except UserError as error:
            problems.add("drives", str(error))
            continue
        if content is not None:
            drives += drive_specs(content.drive, path.parent, folder, inner, drives)
    drives += drive_specs(raw.drive, folder, folder, problems, drives)
    if not drives and not raw.drives and not raw.drive:
        problems.add("drives", 'a study needs a drive; add drives = "robustness" or a [[drive]] table')
    return drives


def drive_specs(
    tables: list[DriveTable], own_folder: Path, folder: Path, problems: Problems, before: list[DriveSpec]
) -> list[DriveSpec]:
    """Return drives, their options known; those before them have names that none of them may have."""
    specs: list[DriveSpec] = []
    for i, table in enumerate(tables):
        key = f"drive[{i}]"
        first = next((d for d in [*before, *specs] if d.name == table.name), None)
        if first is not None:
            taken = first.where.removeprefix(problems.at(""))
            problems.add(f"{key}.name", f"'{table.name}' is the name of {taken.lstrip(': ')} already; choose another")
        with problems.catch(f"{key}.kind"):
            options = options_of(table.kind)
            _check_options(
                table,
                [o.name for o in options],
                [o.name for o in options if o.default is None],
                key,
                problems,
            )
        base = _base(table.further, (own_folder, folder, Path()))
        specs.append(DriveSpec(table.name, table.kind, table.further, problems.at(key), base))
    return specs


def _check_options(table: DriveTable, options: list[str], required: list[str], key: str, problems: Problems) -> None:
    for name in table.further:
        if name not in options:
            problems.add(
                f"{key}.{name}", f"drive '{table.kind}' has no option '{name}'{registry.closest(name, options)}"
            )
    for name in required:
        if name not in table.further:
            problems.add(f"{key}.{name}", f"drive '{table.kind}' needs this option; add it")


def _base(options: dict[str, Any], candidates: tuple[Path, ...]) -> Path:
    """Return the first folder in which a file named by an option exists (the first folder if none does)."""
    return next((c for c in candidates if named_files(options, c)), candidates[0])


def whole_paths(options: dict[str, Any], base: Path) -> dict[str, Any]:
    """Return options whose files are found from any folder."""
    return {k: str((base / v).resolve()) if names_file(base, v) else v for k, v in options.items()}


def named_files(options: Any, folder: Path, name: str = "") -> dict[str, Path]:
    """Return the files that options, at any depth, name by themselves or as the module of ``module:Name``, by key."""
    if isinstance(options, Mapping | list):
        entries = options.items() if isinstance(options, Mapping) else enumerate(options)
        nested = [named_files(v, folder, f"{name}.{k}" if name else str(k)) for k, v in entries]
        return {key: path for each in nested for key, path in each.items()}
    if names_file(folder, options):
        return {name: folder / options}
    if not isinstance(options, str) or ":" not in options:
        return {}
    try:
        path, _ = located(options, [folder])
    except UserError:  # other text with a colon
        return {}
    return {} if path is None else {name: path}


def names_file(folder: Path, value: Any) -> bool:
    """Whether an option's value names a file: text with a suffix, so that column names are none."""
    if not isinstance(value, str) or not Path(value).suffix:
        return False
    try:
        return (folder / value).is_file()
    except (OSError, ValueError):  # text that cannot be a file name
        return False


def estimator_specs(tables: list[EstimatorTable], folder: Path, problems: Problems) -> list[EstimatorSpec]:
    """Return estimators, their settings checked and completed."""
    specs: list[EstimatorSpec] = []
    for i, table in enumerate(tables):
        key, settings = f"estimator[{i}]", table.further
        with problems.catch(f"{key}.kind"):
            module = ESTIMATORS.load(table.kind, ())
            model: type[BaseModel] | None = getattr(module, "Settings", None)
            keys = [] if model is None else sorted(model.model_fields)
            unknown = [k for k in settings if k not in keys]
            for name in unknown:
                problems.add(
                    f"{key}.{name}",
                    f"estimator '{table.kind}' has no setting '{name}'{registry.closest(name, keys)}",
                )
            if model is not None and not unknown:
                refuse_misread(settings, problems.at(key))
                if (checked := validated(settings, model, problems, key)) is not None:
                    settings = checked.model_dump()
        base = _base(settings, (folder, Path()))
        specs.append(
            EstimatorSpec(table.name or table.kind, table.kind, settings, base, input_signal=table.input_signal)
        )
    refuse_twice([s.name for s in specs], "estimator", "name", problems)
    return specs


def refuse_twice(names: list[str], table: str, key: str, problems: Problems, alike: Callable[[str], str] = str) -> None:
    """Note every name that an earlier entry of a list of tables has already, or one that ``alike`` makes equal."""
    keys = [alike(name) for name in names]
    for i, name in enumerate(names):
        if keys[i] in keys[:i]:
            first = keys.index(keys[i])
            problems.add(f"{table}[{i}].{key}", f"'{name}' is the name of {table}[{first}] already; choose another")


def single_drive(content: Mapping[str, Any], where: str) -> DriveSpec:
    """Return a drive.

    Args:
        content: Keys and values as in ``[[drive]]``; a file that it names is looked for in the working directory.
        where: Named in errors in place of the file.

    Raises:
        UserError: If there is no such kind, or it has no such option or needs another one.
    """
    problems = Problems(where, "drive[0]")
    specs = drive_specs([_single(content, DriveTable, problems)], Path(), Path(), problems, [])
    problems.stop()
    return specs[0]


def single_estimator(content: Mapping[str, Any], where: str) -> EstimatorSpec:
    """Return an estimator.

    Args:
        content: Keys and values as in ``[[estimator]]``; a file that it names is looked for in the working directory.
        where: Named in errors in place of the file.

    Raises:
        UserError: If there is no such estimator, it has no such setting, or a setting does not fit.
    """
    problems = Problems(where, "estimator[0]")
    specs = estimator_specs([_single(content, EstimatorTable, problems)], Path(), problems)
    problems.stop()
    return specs[0]


def _single(content: Mapping[str, Any], table: type[_Open], problems: Problems) -> _Open:
    checked = validated(dict(content), table, problems)
    problems.stop()
    assert checked is not None
    return checked


def limits(raw: StudyFile, problems: Problems) -> dict[str, float]:
    """Return the largest tolerable RMSE by target in SI; a tolerance design needs at least one.

    Args:
        raw: The study file.
        problems: Where problems are noted.
    """
    largest: dict[str, float] = {}
    for name, written in raw.limits.items():
        key = f"limits.{name}"
        if name not in raw.targets:
            problems.add(key, f"a limit belongs to a target, '{name}' is none{registry.closest(name, raw.targets)}")
            continue
        with problems.catch(key):
            largest[name] = to_si(written, SIGNALS[name].unit if name in SIGNALS else "", problems.at(key))
            if not largest[name] > 0.0:
                problems.add(key, f"an RMSE is never below zero; give a positive limit, not {written!r}")
    for i, design in enumerate(raw.design):
        if design.sampling == "tolerance" and not raw.limits:
            problems.add(
                f"design[{i}].sampling",
                "a tolerance map needs the error that counts as tolerable; add a table [limits] with an RMSE for a "
                f"target, e.g. {raw.targets[0]} = ...",
            )
    return largest


def score_after(raw: StudyFile, problems: Problems) -> float:
    """Return the time in s after which scores count."""
    with problems.catch("score_after"):
        seconds = to_si(raw.score_after, "s", problems.at("score_after"))
        if seconds < 0:
            problems.add("score_after", f"a time from the beginning of a drive is not negative, got {seconds:g} s")
        return seconds
    return 0.0


def probability_within(raw: StudyFile, problems: Problems) -> float:
    """Return the half-width of the interval of a probability for which the report counts points."""
    key, width = "report.probability_within", 0.01
    with problems.catch(key):
        width = to_si(raw.report.probability_within, "", problems.at(key))
        if not 0.0 < width < 1.0:
            problems.add(key, f"give a share between 0 and 1, such as '1 %', not {raw.report.probability_within!r}")
    return width


def rare_event(
    raw: StudyFile, tolerable: dict[str, float], estimators: Sequence[EstimatorSpec], problems: Problems
) -> RareEventSpec | None:
    """Return the event that subset simulation is asked for, or ``None`` if none is or it is wrong."""
    table, key, before = raw.report.rare_event, "report.rare_event", len(problems)
    if table is None:
        return None
    names = [e.name for e in estimators]
    chosen = table.estimator or next(iter(names), "")
    suited = [d.name for d in raw.design if d.sampling == "population"]
    for entry, name, choices, what in (
        ("design", table.design, suited, "design with sampling = 'population'"),
        ("target", table.target, raw.targets, "target of the study"),
        ("estimator", chosen, names, "estimator of the study"),
    ):
        if name not in choices:
            problems.add(f"{key}.{entry}", f"'{name}' is no {what}{registry.closest(name, choices)}")
    limit = tolerable.get(table.target, 0.0)
    if table.limit is not None:
        with problems.catch(f"{key}.limit"):
            unit = SIGNALS[table.target].unit if table.target in SIGNALS else ""
            limit = to_si(table.limit, unit, problems.at(f"{key}.limit"))
    if len(problems) == before and not limit > 0:
        problems.add(f"{key}.limit", f"give a positive limit, as 'limits' has none of {table.target}")
    spec = RareEventSpec(table.design, table.target, limit, chosen, table.samples)
    return spec if len(problems) == before else None


def monitor(
    raw: StudyFile, tolerable: dict[str, float], estimators: Sequence[EstimatorSpec], problems: Problems
) -> MonitorSpec | None:
    """Return what is asked of trust monitors, or ``None`` if nothing is or it is wrong."""
    table, key, before = raw.report.monitor, "report.monitor", len(problems)
    if table is None:
        return None
    chosen, names = dict(tolerable) if not table.limits else {}, [e.name for e in estimators]
    for target, value in table.limits.items():
        where = f"{key}.limits.{target}"
        if target not in raw.targets:
            problems.add(where, f"'{target}' is no target of the study{registry.closest(target, raw.targets)}")
            continue
        with problems.catch(where):
            chosen[target] = to_si(value, SIGNALS[target].unit if target in SIGNALS else "", problems.at(where))
            if not chosen[target] > 0:
                problems.add(where, f"give an error above zero, not {value!r}")
    if not chosen and not table.limits:
        problems.add(f"{key}.limits", "state the error of a target that matters, as the study has no 'limits'")
    for i, name in enumerate(table.estimators):
        if name not in names:
            problems.add(
                f"{key}.estimators[{i}]", f"'{name}' is no estimator of the study{registry.closest(name, names)}"
            )
    times = {}
    for entry, value in (("window", table.window), ("within", table.within)):
        with problems.catch(f"{key}.{entry}"):
            times[entry] = to_si(value, "s", problems.at(f"{key}.{entry}"))
            if not times[entry] > 0:
                problems.add(f"{key}.{entry}", f"give a time above zero, not {value!r}")
    if len(problems) > before:
        return None
    watched = tuple(dict.fromkeys(table.estimators)) or tuple(names[:1])
    return MonitorSpec(chosen, times["window"], float(table.false_alarms), times["within"], table.runs, watched)


def over_time(
    raw: StudyFile, designs: list[DesignSpec], drives: list[DriveSpec], problems: Problems
) -> OverTimeSpec | None:
    """Return the drive along which errors are kept in windows, or ``None`` if none was asked for or one is wrong.

    Args:
        raw: The study file.
        designs: Those that could be resolved.
        drives: Those that could be resolved.
        problems: Where problems are noted.
    """
    table, key = raw.report.sensitivity_over_time, "report.sensitivity_over_time"
    if table is None:
        return None
    before = len(problems)
    suited = [d.name for d in raw.design if d.sampling == "saltelli"]
    if table.design not in suited:
        near = registry.closest(table.design, suited)
        problems.add(f"{key}.design", f"'{table.design}' is no design with sampling = 'saltelli'{near}")
    if drives and table.drive not in [d.name for d in drives]:
        near = registry.closest(table.drive, [d.name for d in drives])
        problems.add(f"{key}.drive", f"there is no drive '{table.drive}'{near}")
    window = 0.0
    with problems.catch(f"{key}.window"):
        window = to_si(table.window, "s", problems.at(f"{key}.window"))
        if not window > 0.0:
            problems.add(f"{key}.window", f"give a positive length, not {table.window!r}")
    return OverTimeSpec(table.design, table.drive, window) if len(problems) == before else None
