"""The two ways to get a study: ``load_study`` for study files, ``build_study`` for studies made in Python."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict, astuple, replace
from pathlib import Path
from typing import Any

from harness.common import registry
from harness.common.errors import ModelError, UserError
from harness.common.files import parse_toml, read_text, refuse_control_characters, toml_text
from harness.config.designs import check_shares, resolve_design
from harness.config.entries import (
    drives_of,
    estimator_specs,
    limits,
    monitor,
    named_files,
    over_time,
    probability_within,
    rare_event,
    refuse_twice,
    score_after,
    whole_paths,
)
from harness.config.external import inherited, is_external, resolve_external
from harness.config.factors import Models, number
from harness.config.model import resolve_model, stated
from harness.config.problems import Problems, validated
from harness.config.schema import DriveTable, HistoryTable, StudyFile
from harness.config.specs import CountFrom, DesignSpec, DriveSpec, HistorySpec, ModelSpec, StudySpec
from harness.config.tuning import with_tuning
from harness.models.contracts import DRIVE_INPUTS

_MOST_RUNS = 10**9
"""Runs of a study; the list of their units alone takes 400 MB."""

QUICK_RUNS = 8
"""Runs of each level on a drive in a quick look: as many as are computed side by side; fewer would take as long."""

QUICK_SUFFIX = "-quick"


def load_study(path: str | Path, quick: bool = False, tuned: bool = True) -> StudySpec:
    """Read a study file, check everything in it and return it with all defaults and units resolved.

    Args:
        path: The TOML file. Files it names are looked for in its folder first, then in the working directory.
        quick: Return the study shortened, under a name of its own, see ``_shortened``.
        tuned: Whether its tuning file counts; without it the study may name one that is still to be written.

    Raises:
        UserError: If the file cannot be read or anything in it is wrong: one line per problem, each with
            file, key and remedy. Problems of form (unknown keys, wrong types) come before those of content.
    """
    path = Path(path)
    text = read_text(path)
    problems = Problems(str(path))
    raw = validated(parse_toml(text, str(path)), StudyFile, problems)
    problems.stop()
    assert raw is not None
    if not tuned:
        raw = raw.model_copy(update={"tuning": None})
    if not quick:
        return _resolve(raw, text, path)
    drives = drives_of(raw, path.parent, problems)
    problems.stop()
    whole_drives = [replace(d, options=whole_paths(d.options, d.base)) for d in drives]
    return _resolve_tables(_shortened(raw, whole_drives), path)


def _shortened(study: StudyFile, drives: Sequence[DriveSpec]) -> StudyFile:
    """Return a study that is over soon, for a look at whether it runs and what its report shows.

    It keeps the drives that the report draws over time, or else the first, and of each design at most ``QUICK_RUNS``
    points or repeats. The name, and with it the folder of the result, ends in ``QUICK_SUFFIX``, and the title says what
    was cut: nobody shall take the result for that of the whole study.

    Args:
        study: What the file states.
        drives: All drives of the study, of its own tables and of the files it names.
    """
    over_time = study.report.sensitivity_over_time
    drawn = {table.drive for table in study.histories.values()} | ({over_time.drive} if over_time else set())
    kept = [d for d in drives if d.name in drawn] or list(drives[:1])
    designs = []
    for design in study.design:
        samples = min(design.samples, QUICK_RUNS)
        repeats = min(design.repeats, QUICK_RUNS // samples)
        designs.append(design.model_copy(update={"samples": samples, "repeats": repeats}))
    changes: dict[str, Any] = {
        "name": study.name + QUICK_SUFFIX,
        "title": f"{study.title or study.name} (quick look: {len(kept)} of {len(drives)} drives, few runs)",
        "drives": [],
        "drive": [DriveTable(name=d.name, kind=d.kind, **d.options) for d in kept],
        "design": designs,
    }
    if study.report.monitor is not None:  # drives are too few to calibrate on
        changes["report"] = study.report.model_copy(update={"monitor": None})
    first = [table.model_copy(update={"sample": 0, "repeat": 0}) for table in study.histories.values()]
    if first:
        changes["history"] = first[0] if isinstance(study.history, HistoryTable) else first
    return study.model_copy(update=changes)


def build_study(content: Mapping[str, Any] | StudyFile, path: str | Path = "study") -> StudySpec:
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
    raw: StudyFile | None
    if isinstance(content, StudyFile):
        raw = content
    else:
        refuse_control_characters(content, str(path))
        raw = validated(dict(content), StudyFile, problems)
    problems.stop()
    assert raw is not None
    return _resolve_tables(raw, path)


def _resolve_tables(raw: StudyFile, path: Path) -> StudySpec:
    """Check a study that stands in no file as it is, see ``_resolve``; its text is the file that states the same."""
    try:
        text = toml_text(raw.model_dump(exclude_unset=True, exclude_none=True))
    except (TypeError, ValueError) as error:
        raise UserError(f"{path}: contains what a study file cannot represent: {error}") from None
    return _resolve(raw, text, path)


_TAKEN = {"history": "the runs over time", "checksums": "those of its files", "zarr.json": "what it is"}
"""Names in a store that no design can have, and what is there."""


def _resolve(raw: StudyFile, text: str, path: Path) -> StudySpec:
    """Check what a study says and return it with all defaults and units resolved."""
    problems = Problems(str(path))
    folder = path.parent

    plant_table = stated("plant", raw.plant, folder, problems)
    if is_external(raw.plant):
        belief = resolve_model(stated("belief", raw.belief, folder, problems, inherited(plant_table)), problems)
        plant = resolve_external(raw.plant, plant_table, belief, folder, problems)
    else:
        plant = resolve_model(plant_table, problems)
        belief = resolve_model(stated("belief", raw.belief, folder, problems, plant_table), problems)
    drives = drives_of(raw, folder, problems)
    estimators, rule = with_tuning(raw.tuning, estimator_specs(raw.estimator, folder, problems), folder, problems)
    designs: list[DesignSpec] = []
    refuse_twice([d.name for d in raw.design], "design", "name", problems, str.casefold)  # they become folders
    for i, entry in enumerate(raw.design):
        if entry.name.casefold() in _TAKEN:
            holds = _TAKEN[entry.name.casefold()]
            problems.add(f"design[{i}].name", f"'{entry.name}' is where the store keeps {holds}; choose another")
    if plant is not None and belief is not None:
        _check_pair(plant, belief, raw, problems)
        for i, table in enumerate(raw.design):
            design = resolve_design(table, f"design[{i}]", Models(plant, belief, folder), problems)
            designs += [] if design is None else [design]
    _refuse_too_many(designs, len(drives), problems)
    histories: list[HistorySpec | None] = []
    if belief is not None and len(designs) == len(raw.design):
        check_shares(designs, problems)
        _refuse_twice_history(raw, problems)
        histories = [_history(raw, key, designs, drives, belief, problems) for key in raw.histories]
    tolerable = limits(raw, problems)
    settled = score_after(raw, problems)
    within = probability_within(raw, problems)
    rare = rare_event(raw, tolerable, estimators, problems)
    watched = monitor(raw, tolerable, estimators, problems)
    along = over_time(raw, designs, drives, problems)
    problems.stop()
    assert plant is not None
    assert belief is not None
    study = StudySpec(
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
        probability_within=within,
        rare_event=rare,
        monitor=watched,
        count_from=CountFrom(**raw.count_from.model_dump()),
    )
    object.__setattr__(study, "hash", _hash(study))  # the record is complete only now
    return study


def _check_pair(plant: ModelSpec, belief: ModelSpec, raw: StudyFile, problems: Problems) -> None:
    """Note where plant and belief do not share sample time, measured outputs, known inputs and targets."""
    if plant.step != belief.step:
        problems.add(
            "belief.step",
            f"{belief.step:g} s differs from the plant's {plant.step:g} s; both run on the same samples. "
            "Use belief.substeps for finer integration",
        )
    truth, held = plant.model(), belief.model()
    for output in held.outputs:
        if output not in truth.outputs:
            problems.add(
                "belief.sensors",
                f"the belief measures '{output}', which the plant's sensors do not give"
                f"{registry.closest(output, list(truth.outputs))}",
            )
    for name in held.inputs:
        given = {*truth.inputs, *truth.outputs, *truth.states, *truth.ports, *DRIVE_INPUTS, *held.rates, "time"}
        given |= set(held.otherwise)
        if name not in given:
            problems.add(
                "belief.vehicle",
                f"the belief needs input '{name}', which the plant does not have; add it to belief.unknown_inputs",
            )
    _check_input_noise(plant, belief, problems)
    for i, target in enumerate(raw.targets):
        if target in raw.targets[:i]:
            problems.add(f"targets[{i}]", f"'{target}' is named twice; remove one")
        for side, model in (("plant", truth), ("belief", held)):
            if target in held.estimated:
                continue  # scored where the plant has such a parameter
            try:
                model.resolve(target)
            except ModelError as error:
                problems.add(f"targets[{i}]", f"the {side} cannot give it: {error}")
                break


def _check_input_noise(plant: ModelSpec, belief: ModelSpec, problems: Problems) -> None:
    """Note inputs with noise that estimators take as exact, do not read, or get from a sensor with its own noise."""
    for name in plant.input_noise:
        key = f"plant.noise.input.{name}"
        if name not in belief.model().inputs:
            problems.add(key, f"no estimator reads '{name}' as an input; remove the key")
        elif name not in plant.model().inputs and name not in DRIVE_INPUTS:
            problems.add(
                key, f"'{name}' is what a sensor gives, whose noise is noise.measurement.{name}; remove the key"
            )
        elif name not in belief.input_noise:
            problems.add(
                f"belief.noise.input.{name}",
                f"estimators read '{name}' with noise; state the variance that they believe it to have",
            )


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
        varying = [i for i, f in enumerate(design.factors) if f.parameter == name]
        if not varying:
            near = registry.closest(name, [f.parameter for f in design.factors])
            raise UserError(f"{key}: design '{design.name}' does not vary '{name}'{near}")
        factor = design.factors[varying[0]]
        value = number(written, raw.design[at].factor[varying[0]].unit, factor.unit, key)
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


def _hash(study: StudySpec) -> str:
    """Return the SHA-256 of everything that decides the scores, in one canonical order."""

    def model(spec: ModelSpec) -> dict[str, Any]:
        # a study without them stays the same
        absent = {k for k in ("input_noise", "parameter_states", "external") if not getattr(spec, k)}
        content = {k: v for k, v in asdict(replace(spec, external=None)).items() if k not in {"parameters", *absent}}
        if spec.external is not None:  # what its files are called, and how long they may take, decides no score
            described = replace(spec.external.description, file="", facts={})
            used = spec.external.description.facts.get("interface")
            content["external"] = described.as_dict() | {
                "digests": sorted(described.digests.values()),
                "interface": used,
            }
        return content

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
                "factors": [
                    # one without a distribution stays the same
                    [f.parameter, f.of, f.levels, f.lower, f.upper, f.log, *(astuple(f.marginal) if f.marginal else ())]
                    for f in d.factors
                ],
                **({"scramblings": d.scramblings} if d.scramblings > 1 else {}),
                **({"correlation": d.correlation} if d.correlation else {}),
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


def file_digests(study: StudySpec) -> dict[str, str]:
    """Return the SHA-256 of the files that drives and estimators of a study name, by where they are named."""
    named = [(f"drive '{d.name}'", d.options, d.base) for d in study.drives]
    named += [(f"estimator '{e.name}'", e.settings, e.base) for e in study.estimators]
    return {
        f"{what}, {key}": digest
        for what, options, base in named
        for key, digest in _file_digests(options, base).items()
    }


def _file_digests(options: dict[str, Any], base: Path) -> dict[str, str]:
    """Return the digest of every file an option or setting names: another recording is another study."""
    return {name: hashlib.sha256(path.read_bytes()).hexdigest() for name, path in named_files(options, base).items()}
