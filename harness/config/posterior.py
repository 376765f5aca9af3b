"""Posterior of an identification as the factors of a design: what recordings leave open of the parameters."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from harness.common.arrays import Floats
from harness.common.errors import UserError
from harness.common.files import read_text
from harness.config.bounds import out_of_bounds
from harness.config.design_tables import DesignTable, DistributionTable, FactorTable
from harness.config.problems import Problems
from harness.config.specs import ModelSpec
from harness.models.assembly.model import StateSpaceModel
from harness.models.assembly.placement import place_of
from harness.models.roles import EFFECTS
from harness.models.signals import SIGNALS

FILES = ("identify.json", "trace.json")
"""What the commands write that leave a posterior."""

_LARGEST = 1.0 - 1e-9
"""Correlation from which two parameters would be one."""


@dataclass(frozen=True)
class Posterior:
    """What an identification leaves open: a normal distribution of its estimates (Laplace's approximation).

    Attributes:
        file: Where it stands.
        names: Parameters.
        values: Their estimates, SI.
        errors: Their standard errors, with what coloured innovations add; NaN where nothing is known.
        correlation: Of the estimates ``(n, n)``.
    """

    file: Path
    names: tuple[str, ...]
    values: Floats
    errors: Floats
    correlation: Floats


def read_posterior(name: str, folder: Path, where: str) -> Posterior:
    """Return the posterior that a result folder of ``harness identify`` or ``trace`` holds, without that of noise.

    Args:
        name: The folder, beside a study or in the working directory.
        folder: Of the study.
        where: Key path, for errors.

    Raises:
        UserError: If it holds none.
    """
    path = next((p for top in (folder, Path()) for file in FILES if (p := top / name / file).is_file()), None)
    if path is None:
        raise UserError(
            f"{where}: there is no {' and no '.join(FILES)} in '{name}', beside the study or in the working folder"
        )
    try:
        content: Any = json.loads(read_text(path))
        estimates = content["estimates"]
        kept = [i for i, e in enumerate(estimates) if " " not in e["name"]]  # noise has the name of its signal as well
        table = np.array(
            [[np.nan if x is None else float(x) for x in row] for row in content["correlation"]], dtype=float
        )
        values, errors = (
            np.array([np.nan if (x := estimates[i][key]) is None else float(x) for i in kept], dtype=float)
            for key in ("value", "standard_error")
        )
        names = tuple(str(estimates[i]["name"]) for i in kept)
        correlation = table[np.ix_(kept, kept)] if table.size else np.eye(len(kept))
    except (ValueError, KeyError, TypeError, IndexError) as error:
        raise UserError(f"{where}: {path} is no result of harness identify or trace; run that again") from error
    if failed := content.get("failed"):
        raise UserError(f"{where}: {path}: {str(failed).rstrip('.')}; identify again")
    shape, off = (len(names), len(names)), correlation - np.eye(len(correlation))
    if not np.isfinite(values).all() or correlation.shape != shape or not np.abs(off).max(initial=0.0) <= 1.0 + 1e-6:
        raise UserError(f"{where}: {path} holds values or correlations that no fit writes; run the command again")
    if not np.allclose(correlation, correlation.T, atol=1e-6) or not np.allclose(np.diag(off), 0.0, atol=1e-6):
        raise UserError(f"{where}: {path} holds correlations that no fit writes; run the command again")
    return Posterior(path, names, values, errors, correlation)


def with_posterior(raw: DesignTable, key: str, plant: ModelSpec, folder: Path, problems: Problems) -> DesignTable:
    """Return a design whose factors include the parameters of its posterior, correlated as their estimates are.

    A parameter that has a factor of its own is that, independent of the others.

    Args:
        raw: The table.
        key: Its key path.
        plant: The plant.
        folder: Of the study.
        problems: Where problems are noted.
    """
    place = f"{key}.posterior"
    if raw.posterior is None:
        return raw
    if raw.sampling != "population":
        problems.add(place, "vehicles are drawn from a posterior by sampling = 'population'; state that")
        return raw
    posterior: Posterior | None = None
    with problems.catch(place):
        posterior = read_posterior(raw.posterior, folder, problems.at(place))
    if posterior is None:
        return raw
    model, own = plant.model(), {factor.parameter for factor in raw.factor}
    drawn = [i for i, n in enumerate(posterior.names) if n not in own and not _of_no_sensor(n, model)]
    unknown = [posterior.names[i] for i in drawn if posterior.names[i] not in model.parameter_names]
    if unknown:
        sentence = f"the plant has no parameter '{unknown[0]}' of {posterior.file}; take the model of that fit"
        problems.add(place, sentence)
        return raw
    lacking = [posterior.names[i] for i in drawn if not posterior.errors[i] > 0]
    if lacking:
        problems.add(
            place,
            f"{posterior.file} states no error of '{lacking[0]}'; say how far it may be off by a factor of its own, or "
            "fit it no more",
        )
        return raw
    declared = {p.name: p for p in model.parameters}
    for i in drawn:
        if (wrong := out_of_bounds(declared[posterior.names[i]], float(posterior.values[i]))) is not None:
            problems.add(place, f"{posterior.file}: {wrong}")
            return raw
    factors = [
        FactorTable(
            parameter=posterior.names[i],
            distribution=DistributionTable(
                kind="truncated_normal", mean=float(posterior.values[i]), std=float(posterior.errors[i])
            ),
        )
        for i in drawn
    ]
    correlation = [
        (posterior.names[i], posterior.names[j], float(np.clip(posterior.correlation[i, j], -_LARGEST, _LARGEST)))
        for row, i in enumerate(drawn)
        for j in drawn[:row]
        if abs(posterior.correlation[i, j]) > 0
    ]
    return raw.model_copy(
        update={"factor": [*raw.factor, *factors], "correlation": [*(raw.correlation or []), *correlation] or None}
    )


def _of_no_sensor(name: str, model: StateSpaceModel) -> bool:
    """Whether a parameter is of a sensor that a plant does not have, so that it plays no part in it."""
    if name in model.parameter_names:
        return False
    files = [file for file in map(EFFECTS.load, EFFECTS.names()) if place_of(file) == "output"]
    signals = [name.removeprefix(f"{p.name}_") for f in files for p in f.PARAMETERS if name.startswith(f"{p.name}_")]
    return any(signal in SIGNALS and signal not in model.outputs for signal in signals)
