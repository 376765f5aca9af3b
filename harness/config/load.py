"""The two ways to get a study: ``load_study`` for study files, ``build_study`` for studies made in Python."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any, TypeVar

from pydantic import BaseModel, ValidationError

from harness.common import locations, registry
from harness.common.errors import UserError
from harness.common.files import parse_toml, read_text, read_toml, refuse_control_characters, toml_text
from harness.common.units import refuse_misread
from harness.config.designs import resolve_design
from harness.config.factors import Models, number
from harness.config.model import resolve_model, stated
from harness.config.pair import check_pair
from harness.config.problems import Problems, add_validation_errors
from harness.config.quick import shortened
from harness.config.report_options import limits, over_time, score_after
from harness.config.roles import ESTIMATORS
from harness.config.schema import DrivesFile, DriveTable, EstimatorTable, StudyFile
from harness.config.specs import CountFrom, DesignSpec, DriveSpec, EstimatorSpec, HistorySpec, ModelSpec, Study
from harness.config.tuning import with_tuning
from harness.models.drive_options import options_of

_MOST_RUNS = 10**9
"""Runs of a study; the list of their units alone takes 400 MB."""

_Table = TypeVar("_Table", bound=BaseModel)


def load_study(path: str | Path, quick: bool = False, tuned: bool = True) -> Study:
    """Read a study file, check everything in it and return it with all defaults and units resolved.

    Args:
        path: The TOML file. Files it names are looked for in its folder first, then in the working directory.
        quick: Return the study shortened, under a name of its own, see ``harness.config.quick``.
        tuned: Whether its tuning file counts; without it the study may name one that is still to be written.

    Raises:
        UserError: If the file cannot be read or anything in it is wrong: one line per problem, each with
            file, key and remedy. Problems of form (unknown keys, wrong types) come before those of content.
    """
    path = Path(path)
    text = read_text(path)
    problems = Problems(str(path))
    raw = _validated(parse_toml(text, str(path)), StudyFile, problems)
    problems.stop()
    assert raw is not None
    if not tuned:
        raw = raw.model_copy(update={"tuning": None})
    if not quick:
        return _resolve(raw, text, path)
    drives = _drives(raw, path.parent, problems)
    problems.stop()
    found = [replace(d, options=whole_paths(d.options, d.base)) for d in drives]
    return _resolve_tables(shortened(raw, found), path)


def build_study(content: Mapping[str, Any] | StudyFile, path: str | Path = "study") -> Study:
    """Return a study made in Python, checked and resolved as if it stood in a file, see ``load_study``.

    Args:
        content: Keys and values as a study file has them; numbers in SI units or text with a unit.
        path: Names the study in errors; files that it names are looked for in this one's folder first.

    Returns:
        The study; its ``text`` is the TOML file that states the same.

    Raises:
        UserError: If anything in it is wrong.
    """
    path = Path(path)
    problems = Problems(str(path))
    raw = content if isinstance(content, StudyFile) else _validated(content, StudyFile, problems)
    problems.stop()
    assert raw is not None
    return _resolve_tables(raw, path)


def _resolve_tables(raw: StudyFile, path: Path) -> Study:
    """Check a study that stands in no file as it is, see ``_resolve``; its text is the file that states the same."""
    try:
        text = toml_text(raw.model_dump(exclude_unset=True, exclude_none=True))
    except (TypeError, ValueError) as error:
        raise UserError(f"{path}: contains what a study file cannot represent: {error}") from None
    return _resolve(raw, text, path)


def _resolve(raw: StudyFile, text: str, path: Path) -> Study:
    """Check what a study says and return it with all defaults and units resolved."""
    problems = Problems(str(path))
    folder = path.parent

    plant_table = stated("plant", raw.plant, folder, problems)
    plant = resolve_model(plant_table, problems)
    belief = resolve_model(stated("belief", raw.belief, folder, problems, plant_table), problems)
    drives = _drives(raw, folder, problems)
    estimators, rule = with_tuning(raw.tuning, estimator_specs(raw.estimator, folder, problems), folder, problems)
    designs: list[DesignSpec] = []
    _refuse_twice([d.name for d in raw.design], "design", "name", problems)
    for i, entry in enumerate(raw.design):
        if entry.name == "history":
            problems.add(f"design[{i}].name", "'history' is where the store keeps the runs over time; choose another")
    if plant is not None and belief is not None:
        check_pair(plant, belief, raw, problems)
        for i, table in enumerate(raw.design):
            design = resolve_design(table, f"design[{i}]", Models(plant, belief), problems)
            designs += [] if design is None else [design]
    _refuse_too_many(designs, len(drives), problems)
    histories: list[HistorySpec | None] = []
    if belief is not None and len(designs) == len(raw.design):
        _refuse_twice_history(raw, problems)
        histories = [_history(raw, key, designs, drives, belief, problems) for key in raw.histories]
    tolerable = limits(raw, problems)
    settled = score_after(raw, problems)
    along = over_time(raw, designs, drives, problems)
    problems.stop()
    assert plant is not None
    assert belief is not None
    study = Study(
        name=raw.name,
        title=raw.title,
        seed=raw.seed,
        targets=tuple(dict.fromkeys([*raw.targets, *belief.estimated_parameters])),
        plant=plant,
        belief=belief,
        drives=tuple(drives),
        estimators=tuple(estimators),
        designs=tuple(designs),
        history=tuple(h for h in histories if h is not None),
        text=text,
        hash="",
        path=path,
        tuning=rule,
        limits=tolerable,
        over_time=along,
        score_after=settled,
        bound=raw.report.bound,
        count_from=CountFrom(**raw.count_from.model_dump()),
    )
    object.__setattr__(study, "hash", _hash(study))  # the record is complete only now
    return study


def _validated(content: Mapping[str, Any], table: type[_Table], problems: Problems) -> _Table | None:
    refuse_control_characters(content, problems.file)
    try:
        return table.model_validate(dict(content))
    except ValidationError as error:
        add_validation_errors(problems, error, table)
    return None


def _refuse_twice(names: list[str], table: str, key: str, problems: Problems) -> None:
    for i, name in enumerate(names):
        if name in names[:i]:
            first = names.index(name)
            problems.add(f"{table}[{i}].{key}", f"'{name}' is the name of {table}[{first}] already; choose another")


def load_drives(name: str, folder: Path) -> tuple[DriveSpec, ...]:
    """Return the drives of a set, by its name or the path of a TOML file.

    A name is looked for in ``<folder>/drives`` first, then as ``harness.common.locations`` does.

    Raises:
        UserError: If there is no such file or a drive in it is wrong.
    """
    problems = Problems("drives", "drives")
    drives = _drives(StudyFile.model_construct(drives=name, drive=[]), folder, problems)
    problems.stop()
    return tuple(drives)


def _drives(raw: StudyFile, folder: Path, problems: Problems) -> list[DriveSpec]:
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
        inner = problems.of(str(path))
        try:
            content = _validated(read_toml(path), DrivesFile, inner)
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
    tables: list[DriveTable], beside: Path, folder: Path, problems: Problems, before: list[DriveSpec]
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
        base = _base(table.further, (beside, folder, Path()))
        specs.append(DriveSpec(table.name, table.kind, table.further, problems.at(key), base))
    return specs


def _check_options(table: DriveTable, known: list[str], required: list[str], key: str, problems: Problems) -> None:
    for name in table.further:
        if name not in known:
            problems.add(f"{key}.{name}", f"drive '{table.kind}' has no option '{name}'{registry.closest(name, known)}")
    for name in required:
        if name not in table.further:
            problems.add(f"{key}.{name}", f"drive '{table.kind}' needs this option; add it")


def _base(options: dict[str, Any], candidates: tuple[Path, ...]) -> Path:
    """Return the first folder in which a file named by an option exists (the first folder if none does)."""
    return next((c for c in candidates if any(_names_file(c, v) for v in options.values())), candidates[0])


def whole_paths(options: dict[str, Any], base: Path) -> dict[str, Any]:
    """Return options whose files are found from any folder."""
    return {k: str((base / v).resolve()) if _names_file(base, v) else v for k, v in options.items()}


def _names_file(folder: Path, value: Any) -> bool:
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
            known = [] if model is None else sorted(model.model_fields)
            unknown = [k for k in settings if k not in known]
            for name in unknown:
                problems.add(
                    f"{key}.{name}",
                    f"estimator '{table.kind}' has no setting '{name}'{registry.closest(name, known)}",
                )
            if model is not None and not unknown:
                refuse_misread(settings, problems.at(key))
                try:
                    settings = model.model_validate(settings).model_dump()
                except ValidationError as error:
                    add_validation_errors(problems, error, model, key)
        base = _base(settings, (folder, Path()))
        specs.append(
            EstimatorSpec(table.name or table.kind, table.kind, settings, base, input_signal=table.input_signal)
        )
    _refuse_twice([s.name for s in specs], "estimator", "name", problems)
    return specs


def _refuse_too_many(designs: list[DesignSpec], drives: int, problems: Problems) -> None:
    """Count the runs before anything is laid out."""
    counts = [d.bands * drives * d.samples * d.repeats for d in designs]
    if (runs := sum(counts)) > _MOST_RUNS:
        d = designs[max(range(len(designs)), key=counts.__getitem__)]
        problems.add(
            "design",
            f"{runs:.3g} runs, at most {_MOST_RUNS:.0e} can be planned; the design '{d.name}' has {d.bands} bands with "
            f"{d.samples:.3g} samples on {drives} drives, each {d.repeats:.3g} times: state fewer samples or repeats",
        )


def _refuse_twice_history(raw: StudyFile, problems: Problems) -> None:
    named: dict[str, str] = {}
    for key, table in raw.histories.items():
        if table.name and table.name in named:
            problems.add(f"{key}.name", f"'{table.name}' is the name of {named[table.name]} already; choose another")
        named.setdefault(table.name, key)


def _history(
    raw: StudyFile,
    key: str,
    designs: list[DesignSpec],
    drives: list[DriveSpec],
    belief: ModelSpec,
    problems: Problems,
) -> HistorySpec | None:
    """Find the band, and check that design, drive, sample, repeat and signals exist."""
    before, table = len(problems), raw.histories[key]
    for i, signal in enumerate(table.signals):
        with problems.catch(f"{key}.signals[{i}]"):
            belief.model().resolve(signal)
    names = [d.name for d in designs]
    if table.drive not in [d.name for d in drives] and drives:
        near = registry.closest(table.drive, [d.name for d in drives])
        problems.add(f"{key}.drive", f"there is no drive '{table.drive}'{near}")
    if table.design not in names:
        near = registry.closest(table.design, names)
        problems.add(f"{key}.design", f"there is no design '{table.design}'{near}")
        return None
    at = names.index(table.design)
    design = designs[at]
    for index, count in (("sample", design.samples), ("repeat", design.repeats)):
        if getattr(table, index) >= count:
            problems.add(f"{key}.{index}", f"design '{design.name}' has {count}, counted from 0; give less")
    band: int | None = None
    levels: dict[str, float] = {}
    with problems.catch(key):
        band, levels = _history_band(raw, key, design, at, problems)
    if band is None or len(problems) > before:
        return None
    return HistorySpec(
        table.name, design.name, band, table.drive, levels, table.sample, table.repeat, tuple(table.signals)
    )


def _history_band(
    raw: StudyFile, where: str, design: DesignSpec, at: int, problems: Problems
) -> tuple[int, dict[str, float]]:
    table = raw.histories[where]
    fits = list(range(design.bands))
    labels = ", ".join(design.band_labels)
    for name, written in table.levels.items():
        key = problems.at(f"{where}.levels.{name}")
        found = [i for i, f in enumerate(design.factors) if f.parameter == name]
        if not found:
            near = registry.closest(name, [f.parameter for f in design.factors])
            raise UserError(f"{key}: design '{design.name}' does not vary '{name}'{near}")
        factor = design.factors[found[0]]
        value = number(written, raw.design[at].factor[found[0]].unit, factor.unit, key)
        fits = [b for b in fits if abs(factor.levels[b] - value) <= 1e-9 * max(abs(value), 1e-9)]
        if not fits:
            raise UserError(f"{key}: {written!r} is no level of design '{design.name}'; its bands: {labels}")
    if table.band is not None:
        if table.band not in design.band_labels:
            near = registry.closest(table.band, design.band_labels)
            raise UserError(f"{problems.at(f'{where}.band')}: no band is labelled '{table.band}'{near}")
        fits = [b for b in fits if design.band_labels[b] == table.band]
    if len(fits) != 1:
        raise UserError(
            f"{problems.at(where)}: {len(fits)} bands of design '{design.name}' fit; name one by "
            f"'levels' or 'band' ({labels})"
        )
    return fits[0], {f.parameter: f.levels[fits[0]] for f in design.factors}


def _hash(study: Study) -> str:
    """Return the SHA-256 of everything that decides the scores, in one canonical order."""

    def model(spec: ModelSpec) -> dict[str, Any]:
        # a study without them stays the same
        absent = {k for k in ("input_noise", "parameter_states") if not getattr(spec, k)}
        return {k: v for k, v in asdict(spec).items() if k not in {"parameters", *absent}}

    content = {
        "name": study.name,
        "seed": study.seed,
        "targets": study.targets,
        "plant": model(study.plant),
        "belief": model(study.belief),
        "drives": [[d.name, d.kind, d.options, _file_digests(d.options, d.base)] for d in study.drives],
        "estimators": [
            {
                "name": e.name,
                "kind": e.kind,
                "settings": e.settings,
                "noise": e.noise,
                "files": _file_digests(e.settings, e.base),
                **({"input_signal": e.input_signal or "filtered"} if study.belief.input_noise else {}),
            }
            for e in study.estimators
        ],
        "designs": [
            {
                "name": d.name,
                "sampling": d.sampling,
                "samples": d.base_samples,
                "repeats": d.repeats,
                "factors": [[f.parameter, f.of, f.levels, f.lower, f.upper, f.log] for f in d.factors],
            }
            for d in study.designs
        ],
        "history": [asdict(h) for h in study.history],
        "over_time": study.over_time and asdict(study.over_time),
    }
    if study.score_after:  # one that scores from the beginning stays the same
        content["score_after"] = study.score_after
    if study.count_from != CountFrom():
        content["count_from"] = asdict(study.count_from)
    canonical = json.dumps(content, sort_keys=True, ensure_ascii=True, default=str)
    return hashlib.sha256(canonical.encode()).hexdigest()


def _file_digests(options: dict[str, Any], base: Path) -> dict[str, str]:
    """Return the digest of every file an option or setting names: another recording is another study."""
    return {
        name: hashlib.sha256((base / value).read_bytes()).hexdigest()
        for name, value in options.items()
        if _names_file(base, value)
    }
