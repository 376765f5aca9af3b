"""Posterior as the factors of a design: what recordings leave open of the parameters, by a fit or by a sample."""

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
from harness.config.distributions import cells, numbers
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
    """What data leave open of parameters: the distribution of each, and the correlation of their normal scores.

    Attributes:
        file: Where it stands.
        names: Parameters.
        values: Their means, SI.
        distributions: ``None`` of a parameter of which no error is known.
        correlation: ``(n, n)``.
    """

    file: Path
    names: tuple[str, ...]
    values: Floats
    distributions: tuple[DistributionTable | None, ...]
    correlation: Floats


def read_posterior(name: str, folder: Path, where: str, model: int | None = None) -> Posterior:
    """Return the posterior that a result folder of ``harness identify`` or ``trace`` or a sample in a CSV file holds.

    Args:
        name: Folder or file, next to a study or in the working directory.
        folder: Of the study.
        where: Key path, for errors.
        model: Number of a model of the confusable set of a trace, from 1; by default of what was fitted last.

    Raises:
        UserError: If it holds none.
    """
    is_sample = name.lower().endswith(".csv")
    files = ("",) if is_sample else FILES
    path = next((p for top in (folder, Path()) for file in files if (p := top / name / file).is_file()), None)
    if path is None:
        lacking = f"no file '{name}'" if is_sample else f"no {' and no '.join(FILES)} in '{name}'"
        raise UserError(f"{where}: there is {lacking}, next to the study or in the working folder")
    if is_sample and model is not None:
        raise UserError(f"{where}: {path} is a sample and has no models; remove 'model'")
    return _of_sample(path) if is_sample else _of_fit(path, where, model)


def _of_sample(path: Path) -> Posterior:
    """Return that of a table with a row for each vehicle and a column for each parameter, in SI units.

    Dependence is that of a Gaussian copula with the correlation of the normal scores of the ranks (van der Waerden).
    """
    from scipy.special import ndtri
    from scipy.stats import rankdata

    columns = {name: numbers(path, name, texts) for name, texts in cells(path).items()}
    if not columns:
        raise UserError(f"{path}: is empty; write a column for each parameter and a row for each vehicle")
    if constant := [name for name, values in columns.items() if len(set(values)) < 2]:
        raise UserError(f"{path}: column '{constant[0]}' has one value only; take it out")
    table = np.array(list(columns.values()))
    scores = ndtri(rankdata(table, axis=1) / (table.shape[1] + 1))
    distributions = [DistributionTable(kind="empirical", values=list(values)) for values in columns.values()]
    return Posterior(path, tuple(columns), table.mean(axis=1), tuple(distributions), np.atleast_2d(np.corrcoef(scores)))


def _of_fit(path: Path, where: str, model: int | None) -> Posterior:
    """Return the normal distribution of the estimates of a fit (Laplace's approximation), without those of noise."""
    try:
        whole: Any = json.loads(read_text(path))
        content = whole if model is None else _model_of(whole, model, path, where)
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
    except UserError:
        raise
    except (ValueError, KeyError, TypeError, IndexError, AttributeError) as error:
        raise UserError(f"{where}: {path} is no result of harness identify or trace; run that again") from error
    if failed := whole.get("failed"):
        raise UserError(f"{where}: {path}: {str(failed).rstrip('.')}; identify again")
    shape, off = (len(names), len(names)), correlation - np.eye(len(correlation))
    if not np.isfinite(values).all() or correlation.shape != shape or not np.abs(off).max(initial=0.0) <= 1.0 + 1e-6:
        raise UserError(f"{where}: {path} holds values or correlations that no fit writes; run the command again")
    if not np.allclose(correlation, correlation.T, atol=1e-6) or not np.allclose(np.diag(off), 0.0, atol=1e-6):
        raise UserError(f"{where}: {path} holds correlations that no fit writes; run the command again")
    pairs = zip(values.tolist(), errors.tolist(), strict=True)
    distributions = [DistributionTable(kind="truncated_normal", mean=v, std=e) if e > 0 else None for v, e in pairs]
    return Posterior(path, names, values, tuple(distributions), correlation)


def _model_of(content: Any, number: int, path: Path, where: str) -> Any:
    """Return a model of the confusable set of a trace.

    Raises:
        UserError: If there is none of that number.
    """
    models = (content.get("confusable") or {}).get("models") or []
    if number > len(models):
        raise UserError(
            f"{where}: {path} has {len(models)} confusable models; there is no model = {number}. State one of a trace "
            "that left more, or remove 'model'"
        )
    return models[number - 1]


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
        if raw.model is not None:
            problems.add(f"{key}.model", "a model is one of the posterior of a trace; state that by 'posterior'")
        return raw
    if raw.sampling != "population":
        problems.add(place, "vehicles are drawn from a posterior by sampling = 'population'; state that")
        return raw
    posterior: Posterior | None = None
    with problems.catch(place):
        posterior = read_posterior(raw.posterior, folder, problems.at(place), raw.model)
    if posterior is None:
        return raw
    model, own = plant.model(), {factor.parameter for factor in raw.factor}
    drawn = [i for i, n in enumerate(posterior.names) if n not in own and not _of_no_sensor(n, model)]
    unknown = [posterior.names[i] for i in drawn if posterior.names[i] not in model.parameter_names]
    if unknown:
        sentence = f"the plant has no parameter '{unknown[0]}' of {posterior.file}; take the model that it is of"
        problems.add(place, sentence)
        return raw
    lacking = [posterior.names[i] for i in drawn if posterior.distributions[i] is None]
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
    factors = [FactorTable(parameter=posterior.names[i], distribution=posterior.distributions[i]) for i in drawn]
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
