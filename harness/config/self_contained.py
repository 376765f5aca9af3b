"""A study with all that its files say written out, so that it can be had again where they are not."""

from __future__ import annotations

from dataclasses import replace
from itertools import repeat
from typing import Any

from harness.common.files import parse_toml, toml_text
from harness.config.design_tables import DesignTable
from harness.config.external import external_table
from harness.config.factors import Models, completed
from harness.config.posterior import with_posterior
from harness.config.problems import Problems
from harness.config.schema import DriveTable, ModelTable, NoiseTable, StudyFile, TuningTable, UncertainTable
from harness.config.specs import ModelSpec, StudySpec, assembled


def self_contained(study: StudySpec) -> str:
    """Return a study file that states the same as a study, to the bit, and names no other but recordings and networks.

    Values and noise of parameter sets, drives of sets, tuned noise and samples of factors are written out.
    """
    raw = StudyFile.model_validate(parse_toml(study.text, str(study.path)))
    models = Models(study.plant, study.belief, study.path.parent)
    tuned = {e.name: e.noise for e in study.estimators if e.noise}
    update: dict[str, Any] = {
        "design": [
            table.model_copy(update={"factor": list(map(completed, table.factor, spec.factors, repeat(models)))})
            if table.factor
            else table
            for table, spec in zip(written_out(raw, study), study.designs, strict=True)
        ],
        "plant": _table(study.plant),
        "belief": _table(study.belief),
        "drives": [],
        "drive": [DriveTable(name=d.name, kind=d.kind, **d.options) for d in study.drives],
        "tuning": TuningTable.model_validate({"rule": study.tuning, "estimator": tuned}) if tuned else None,
    }
    return toml_text(raw.model_copy(update=update).model_dump(exclude_unset=True, exclude_none=True))


def written_out(raw: StudyFile, study: StudySpec) -> list[DesignTable]:
    """Return the designs of a study with the factors that results of other commands stand for."""
    problems = Problems(str(study.path))
    tables = [with_posterior(t, "design", study.plant, study.path.parent, problems) for t in raw.design]
    problems.stop()
    return [table.model_copy(update={"posterior": None, "model": None}) for table in tables]


def without_files(study: StudySpec) -> StudySpec:
    """Return the same study with a text that names no file that this program wrote: equal runs give equal stores."""
    return replace(study, text=self_contained(study))


def _table(spec: ModelSpec) -> ModelTable:
    """Return the table that states a model without a parameter set."""
    noise = NoiseTable(process=spec.process_noise, measurement=spec.measurement_noise, input=spec.input_noise)
    if spec.external is not None:
        return ModelTable(**external_table(spec), noise=noise)
    states = assembled(spec.vehicle, spec.tyre, spec.effects, spec.sensors, spec.unknown_inputs).states
    stated: dict[str, Any] = {
        "vehicle": spec.vehicle,
        "tyre": spec.tyre,
        "effects": list(spec.effects),
        "sensors": spec.sensors,
        "integrator": spec.integrator,
        "step": spec.step,
        "substeps": spec.substeps,
        "values": spec.values,
        "noise": NoiseTable(
            process={n: spec.process_noise[n] for n in states},
            measurement=spec.measurement_noise,
            input=spec.input_noise,
        ),
    }
    if spec.unknown_inputs:
        stated["unknown_inputs"] = list(spec.unknown_inputs)
    for key, considered in (("unknown_parameters", False), ("considered_parameters", True)):
        entries = [
            UncertainTable(name=s.name, prior=s.prior, **({"walk": s.walk} if s.walk else {}))
            for s in spec.parameter_states
            if s.considered is considered
        ]
        if entries:
            stated[key] = entries
    return ModelTable(**stated)
