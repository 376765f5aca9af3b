"""The oracle of a case: the fit that knows what is missing, as the best that a trace could reach.

The true effects in the library's words (``tests/blind/plant_oracle.py``), the parameters that are not as published
and what the trace fits anyway are fitted to the same drives, from their true values, and judged on the same held-out
drive. Where the library has no form for what is missing there is no oracle.
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from threadpoolctl import threadpool_limits

from harness.common.files import write_files
from harness.diagnosis.fitting import FittedHypothesis, Fitting, ParameterPoint
from harness.diagnosis.model.augmented_model import AugmentedModel
from harness.diagnosis.model.hypotheses import Hypothesis, coordinates, hypotheses
from harness.diagnosis.run import TraceTask
from harness.diagnosis.selection.forward_selection import first_variances
from harness.diagnosis.selection.score_test import ScoreTest
from harness.diagnosis.selection.validation import HeldOut
from harness.identification.measured_file import names_of
from harness.models.assembly.placement import split

FILE = "oracle.json"
ITERATIONS = 25
"""As many as the nominal fit of a trace gets."""


def write_oracle(folder: Path, task: TraceTask, augmented: AugmentedModel) -> None:
    """Fit the oracle of a case and write ``oracle.json``: held-out excess, hypotheses and fitted values.

    Args:
        folder: Of the case; its ``sealed.json`` is read.
        task: As it was traced.
        augmented: Its model, compiled.
    """
    sealed = json.loads((folder / "sealed.json").read_text())
    with threadpool_limits(1):
        oracle = _oracle(sealed, task, augmented)
    write_files(folder, {FILE: json.dumps(oracle, indent=1) + "\n"})


def _oracle(sealed: Mapping[str, Any], task: TraceTask, augmented: AugmentedModel) -> dict[str, Any]:
    recordings = task.train + task.test
    drives = [augmented.drive(r, name) for r, name in zip(recordings, names_of(recordings), strict=True)]
    train, test = drives[: len(task.train)], drives[len(task.train) :]
    true = [true_hypotheses(augmented, effect) for effect in sealed["effects"]]
    if not all(true):
        return {"excess": None, "added": None, "parameters": {}}
    variances = first_variances(augmented, drives)
    fitting = Fitting(augmented, train, variances)
    free = free_parameters(sealed, task.free, augmented)
    start, added = _start(fitting, sealed, true, free)
    fitted = fitting.fit(coordinates(augmented, free, added, len(train)), start, ITERATIONS)
    judged = HeldOut(augmented, test, variances).judge(added, fitted.point)
    return {
        "excess": judged.normalised_excess_mse if math.isfinite(judged.normalised_excess_mse) else None,
        "added": [h.name for h in added],
        "parameters": {n: float(fitted.point.values[augmented.row(n), 0]) for h in added for n in h.shared}
        | {n: float(fitted.point.values[augmented.row(n), 0]) for n in free},
    }


def true_hypotheses(augmented: AugmentedModel, effect: Mapping[str, Any]) -> tuple[Hypothesis, ...]:
    """Return the smallest hypothesis of the library that holds what is true, or several that together do, or nothing.

    A random process is none: of an oracle a simulation is asked, which predicts no process. Where the seal has no
    values to go by it is everything that the library's effect has, or one of its places: then all places are returned,
    and the drives decide.

    Args:
        augmented: The model with the library.
        effect: From ``sealed.json``.
    """
    needed = _needed(effect)
    effects = (h for h in hypotheses(augmented, ()) if h.kind == "effect" and not h.random)
    own = [h for h in effects if split(h.name)[0] == effect["name"]]
    if not effect["in_library"] or not own:
        return ()
    if not needed:
        most = max(len(h.shared) for h in own)
        return tuple(h for h in own if len(h.shared) == most)
    holding = [h for h in own if needed <= {*h.shared, *h.change_times}]
    if holding:
        return (min(holding, key=lambda h: len(h.shared)),)
    parts = tuple(h for h in own if needed & {*h.shared, *h.change_times})
    return parts if needed <= {n for h in parts for n in (*h.shared, *h.change_times)} else ()


def _needed(effect: Mapping[str, Any]) -> set[str]:
    """Return the parameters of the library that the seal has values of."""
    sealed_values = effect["oracle"]
    return {*sealed_values["parameters"], *(name for times in sealed_values["per_drive"].values() for name in times)}


def free_parameters(sealed: Mapping[str, Any], usual: Sequence[str], augmented: AugmentedModel) -> tuple[str, ...]:
    """Return the parameters of the model that the oracle fits: the usual ones, and those that are not as published.

    A parameter that an effect of the plant overwrites is the effect's.
    """
    taken = {name for effect in sealed["effects"] for name in effect["parameters"]}
    wrong = [n for n in sealed["parameters"] if n in augmented.names and n not in taken]
    return tuple(dict.fromkeys([*usual, *wrong]))


def _start(
    fitting: Fitting, sealed: Mapping[str, Any], true: Sequence[tuple[Hypothesis, ...]], free: tuple[str, ...]
) -> tuple[ParameterPoint, tuple[Hypothesis, ...]]:
    """Return the truth and what holds it; of an effect without values in the library's words, what a score promises."""
    point, augmented = fitting.first(), fitting.augmented
    values = point.values.copy()
    for name in free:
        if name in sealed["parameters"]:
            values[augmented.row(name)] = sealed["parameters"][name]["true"]
    for effect in sealed["effects"]:
        for name, value in effect["oracle"]["parameters"].items():
            values[augmented.row(name)] = value
        for i, drive in enumerate(fitting.drives):
            for name, time in effect["oracle"]["per_drive"][drive.name].items():
                values[augmented.row(name), i] = time
    point = replace(point, values=values)
    if all(effect["oracle"]["parameters"] for effect in sealed["effects"]):
        return point, tuple(h for own in true for h in own)
    without: FittedHypothesis = fitting.fit(coordinates(augmented, free, (), len(fitting.drives)), point, ITERATIONS)
    test, values = ScoreTest(fitting, without), without.point.values.copy()
    added: list[Hypothesis] = []
    for own, effect in zip(true, sealed["effects"], strict=True):
        if effect["oracle"]["parameters"]:
            added += own
            continue
        scores = test.of(own)
        for score in scores if _needed(effect) else [max(scores, key=lambda s: s.gain)]:
            added.append(score.hypothesis)
            for name, value in zip(score.hypothesis.shared, [*score.amplitudes, *score.shapes], strict=True):
                values[augmented.row(name)] = value
    return replace(without.point, values=values), tuple(added)
