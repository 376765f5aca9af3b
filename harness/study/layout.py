"""How a store is laid out: the arrays of each design, their chunks, and what is known before the first run.

Every unit has chunks of its own. The arrays of scores are declared without writing any score, however many there will
be.
"""

from __future__ import annotations

import json
import platform
from collections.abc import Iterable, Mapping
from pathlib import Path, PurePath
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from harness.common import stores
from harness.config import DesignSpec, ModelSpec, StudySpec
from harness.config.bounds import loading_parameters
from harness.config.factors import is_believed
from harness.config.load import file_digests
from harness.config.self_contained import self_contained
from harness.external.description import Description, ExternalParameter, Port
from harness.models.signals import SIGNALS
from harness.study import checksums
from harness.study.design import points, unit_counts, unit_shape
from harness.study.provenance import code_state, commit, processor
from harness.study.score_names import (
    FLAGS,
    LOST_CONTROL,
    MEANINGS,
    NORMAL_SCORE,
    OVER_TIME,
    PENDING,
    PER_RUN,
    PER_TARGET,
    STATUS,
)

if TYPE_CHECKING:
    import xarray as xr

    from harness.study.evaluate import StudyEvaluator

_RUN = ("band", "sample", "drive", "repeat", "estimator")


def create(study: StudySpec, evaluator: StudyEvaluator, path: Path, attributes: Mapping[str, Any]) -> None:
    """Write a store in which every score is pending.

    Args:
        study: The study.
        evaluator: Its compiled models.
        path: The store, which is not there yet, on a file system.
        attributes: Of its root.
    """
    root: Any = stores.group(path, mode="w")
    root.attrs.update(dict(attributes))
    for design in study.designs:
        coordinates = _known(study, design, evaluator)
        stores.write(coordinates, path, design.name)
        of_group: Any = root[design.name].attrs
        of_group.pop("coordinates", None)  # xarray's word on coordinates of the scores, which have it themselves
        dims = _declare_scores(study, design, evaluator, root, coordinates)
        checksums.declare(path, design.name, dims, (design.bands, *unit_counts(study, design), len(study.drives)))


def _declare_scores(
    study: StudySpec, design: DesignSpec, evaluator: StudyEvaluator, root: Any, labels: xr.Dataset
) -> dict[str, list[str]]:
    """Add the arrays of scores, as xarray would write them full of fill values; return the dimensions of each."""
    samples, repeats = unit_shape(study, design)
    index = study.designs.index(design)
    kept = [w for d in range(len(study.drives)) if (w := evaluator.windows.count(index, d)) is not None]
    sizes = {
        "band": design.bands, "sample": design.samples, "drive": len(study.drives), "repeat": design.repeats,
        "estimator": len(study.estimators), "target": len(study.targets), "window": kept[0] if kept else 0,
    }  # fmt: skip
    own = {"band": 1, "sample": samples, "drive": 1, "repeat": repeats}
    dims_of = {}
    for name, (dims, dtype, attributes) in _scores(bool(kept)).items():
        shape = [sizes[d] for d in dims]
        auxiliary = sorted(
            str(n) for n, c in labels.coords.items() if n not in labels.dims and set(c.dims) <= set(dims)
        )
        fill = {} if name == STATUS else {"_FillValue": "AAAAAAAA+H8="}  # NaN, as xarray spells it
        root.create_array(
            f"{design.name}/{name}",
            shape=shape,
            chunks=[min(own.get(d, size), size) for d, size in zip(dims, shape, strict=True)],
            # All chunks in one folder: a folder for each dimension takes longer to make than the files in it.
            chunk_key_encoding={"name": "default", "separator": checksums.SEPARATOR},
            dtype=dtype,
            fill_value=PENDING if name == STATUS else np.nan,  # a chunk that holds nothing else takes no file
            dimension_names=dims,
            attributes={**attributes, "coordinates": " ".join(auxiliary), **fill},
        )
        dims_of[name] = list(dims)
    return dims_of


def _scores(over_time: bool) -> dict[str, tuple[tuple[str, ...], str, dict[str, Any]]]:
    """Return dimensions, type and attributes of each array of scores."""
    of_target = {"units": "unit of the target"}
    scores: dict[str, tuple[tuple[str, ...], str, dict[str, Any]]] = {
        name: ((*_RUN, "target"), "float64", {"long_name": MEANINGS[name], **of_target}) for name in PER_TARGET
    }
    for name in PER_RUN:
        unit = "s" if name == "time_of_divergence" else "1"
        scores[name] = (_RUN, "float64", {"long_name": MEANINGS[name], "units": unit})
    if over_time:
        dims = ("band", "sample", "repeat", "estimator", "target", "window")  # kept along one drive only
        scores[OVER_TIME] = (dims, "float32", {"long_name": MEANINGS[OVER_TIME], **of_target})
    scores[LOST_CONTROL] = (_RUN[:-1], "float64", {"long_name": MEANINGS[LOST_CONTROL], "units": "s"})
    flags = {"flag_values": list(FLAGS.values()), "flag_meanings": " ".join(FLAGS)}  # as CF has them
    scores[STATUS] = (_RUN, "int8", {"long_name": MEANINGS[STATUS], **flags})
    return scores


def _known(study: StudySpec, design: DesignSpec, evaluator: StudyEvaluator) -> xr.Dataset:
    """Return what is known of a design before its first run: values of the factors, coordinates, attributes."""
    import xarray as xr  # a store that is there already is continued without

    table = points(study, design)
    targets = list(study.targets)
    variables: dict[str, Any] = {}
    for i, factor in enumerate(table.factors):
        unit = design.factors[i].unit
        variables[f"factor_{factor}"] = (("band", "sample"), table.values[:, :, i], {"units": unit})
        if design.sampling == "population":
            variables[f"{NORMAL_SCORE}_{factor}"] = (("sample",), table.scores[:, i], {"units": "1"})
    factors = [
        {
            "name": name,
            "parameter": f.parameter,
            "of": f.of,
            "unit": f.report_unit,
            "si_unit": f.unit,
            "nominal": f.nominal,
            "scale": "log" if f.log else "linear",
            "lower": list(f.lower),
            "upper": list(f.upper),
            **({"distribution": f.marginal.kind} if f.marginal else {}),
            **({} if is_believed(f.parameter, study.belief) else {"believed": False}),
        }
        for name, f in zip(table.factors, design.factors, strict=True)
    ]
    coordinates = {
        "drive": as_text([d.name for d in study.drives]),
        "estimator": as_text([e.name for e in study.estimators]),
        "target": as_text(targets),
        "band_label": ("band", as_text(table.band_labels)),
        "target_unit": ("target", as_text([SIGNALS[t].unit for t in targets])),
        "duration": ("drive", [float(d.profile.time[-1]) for d in evaluator.compiled.drives], {"units": "s"}),
    }
    attributes = {
        "factors": json.dumps(factors),
        "state_dimension": evaluator.compiled.belief.nx,
        "output_dimension": evaluator.compiled.belief.ny,
        "sampling": design.sampling,
        "base_samples": design.base_samples,
        "samples": design.samples,
        "repeats": design.repeats,
    }
    if design.scramblings > 1:
        attributes["scramblings"] = design.scramblings
    if design.correlation:
        attributes |= {"correlation": json.dumps(design.correlation), "correlation_change": design.correlation_change}
    if study.over_time is not None and study.over_time.design == design.name:
        attributes |= {"over_time_drive": study.over_time.drive, "over_time_window": study.over_time.window}
    return xr.Dataset(variables, coords=coordinates, attrs=attributes)


def as_text(words: Iterable[Any]) -> NDArray[Any]:
    """Return text of any length, which Zarr's format specifies; text of fixed length it does not."""
    return np.array([str(w) for w in words], dtype=object)


def root_attributes(study: StudySpec) -> dict[str, Any]:
    """Return what the root of a store says of study, code and machine."""
    sides = {"plant": study.plant, "belief": study.belief}
    description: dict[str, Any] = {
        side: {
            "model": spec.model().name,
            "parameters": PurePath(spec.parameters).name,  # of a file without its place
            "tyre": spec.tyre,
            "effects": list(spec.effects),
            "sensors": spec.sensors,
            "integrator": spec.integrator,
            "substeps": spec.substeps,
            "unknown_inputs": list(spec.unknown_inputs),
            **({"uncertain_parameters": said} if (said := _uncertain(spec)) else {}),
            **({} if spec.external is None else {"foreign": _foreign(spec.external.description)}),
            "process_noise": spec.process_noise,
            "measurement_noise": spec.measurement_noise,
            "input_noise": spec.input_noise,
        }
        for side, spec in sides.items()
    }
    plant, belief = study.plant.values, study.belief.values
    units = {p.name: p.unit for spec in sides.values() for p in spec.model().parameters}
    description["tuning"] = study.tuning or "every estimator believes the noise of the belief"
    description["noise_factors"] = {e.name: e.noise for e in study.estimators if e.noise}
    description["differing"] = {
        name: {"plant": plant.get(name), "belief": belief.get(name), "unit": units.get(name, "")}
        for name in sorted(plant.keys() | belief.keys())
        if plant.get(name) != belief.get(name)
    }
    limits = {side: spec.model().valid for side, spec in sides.items()}
    shared = [s for s in study.belief.model().states if s in study.plant.model().states]
    description["valid"] = {
        s: {**{side: valid.get(s) for side, valid in limits.items()}, "unit": SIGNALS[s].unit}
        for s in shared
        if limits["plant"].get(s) != limits["belief"].get(s)
    }
    return {
        **words(study),
        checksums.GROUP: {"histories": len(study.history)},
        "study_name": study.name,
        "study_hash": study.hash,
        "seed": study.seed,
        "step": study.plant.step,
        **({"score_after": study.score_after} if study.score_after else {}),
        "designs": json.dumps([d.name for d in study.designs]),
        "description": json.dumps(description, sort_keys=True),
        **({"files": json.dumps(files)} if (files := file_digests(study)) else {}),
        **code_state(study),
        "commit": commit(),
        "machine": f"{platform.system()} {platform.machine()}, {processor()}",
    }


def _foreign(description: Description) -> dict[str, Any]:
    """Return what a report says of a plant of somebody else."""
    files = (f"{name}, SHA-256 {digest[:16]}" for name, digest in description.digests.items())
    mapped: dict[str, dict[str, Port | ExternalParameter]] = {
        "input": {p.signal: p for p in description.inputs},
        "output": {p.signal: p for p in description.outputs},
        "process noise": {p.signal: p for p in description.disturbances},
        "parameter": {p.name: p for p in description.parameters if p.name != p.variable},
    }
    return {
        "kind": {"fmu": "FMU", "python": "Python class"}[description.kind],
        **description.facts,
        "files": list(files),
        "process_noise_acts_on": [p.signal for p in description.disturbances] or "nothing: it has none",
        "units": {p.signal: p.unit for p in description.disturbances},
        "map": [
            [group, name, p.variable, p.unit, p.scale, p.offset]
            for group, entries in mapped.items()
            for name, p in entries.items()
        ],
    }


def _uncertain(spec: ModelSpec) -> list[str]:
    """Say what an estimator is not sure of."""
    units = {p.name: p.unit for p in spec.model().parameters} | {
        p.name: p.unit for p in loading_parameters(spec.vehicle).values()
    }
    return [
        f"{s.name} {'considered' if s.considered else 'estimated'} as {s.believed:g} ± {s.prior:g} {units[s.name]}"
        + (f", walk {s.walk:g} {units[s.name]}/s**0.5" if s.walk else "")
        for s in spec.parameter_states
    ]


def words(study: StudySpec) -> dict[str, Any]:
    """Return what a store says of its study that no score depends on, for the report and to compute runs again.

    ``study`` is the file as written, ``self_contained_study`` the same with all that its files say.
    """
    return {
        "study": study.text,
        "self_contained_study": self_contained(study),
        "title": study.title,
        "limits": json.dumps(study.limits),
        **(
            {"probability_within": study.probability_within}
            if study.probability_within != StudySpec.probability_within
            else {}
        ),
        **({"groups": json.dumps(groups)} if (groups := {d.name: d.groups for d in study.designs if d.groups}) else {}),
        **({"shares": json.dumps(shares)} if (shares := {d.name: d.share for d in study.designs if d.share}) else {}),
    }
