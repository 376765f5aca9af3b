"""Points of the box: where they lie and what their studies gave, kept one file each so that a search can go on."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import joblib
import numpy as np
from numpy.typing import NDArray
from scipy import signal
from scipy.stats import qmc

from harness.common import sources
from harness.common.arrays import Floats
from harness.study.design import units
from harness.study.evaluate import StudyEvaluator
from harness.study.provenance import engine_hash
from harness.study.run import histories
from reproductions.box import studies
from reproductions.box.factors import FACTORS, place_of, settings
from reproductions.kept import Parts, state_of

SCORES = ("rmse", "max_error", "status")
SEED = 2023
DELAY_LIMIT = 4.0
"""s; the longest delay of the input estimate that is looked for."""


@dataclass(frozen=True)
class Point:
    """What the studies gave at one point.

    Attributes:
        number: From 0; those of the Sobol sequence first.
        place: In the unit box, ``(len(FACTORS),)``.
        at: Values by factor.
        bands: Labels of the levels by design.
        scores: By ``<design>/<score>``: ``rmse`` and ``max_error`` ``(band, drive, sample, repeat, estimator,
            target)`` in SI units, ``status`` without the last axis.
        drives: Their names.
        delay: Of the EKF's steering-wheel angle behind the true one on two ramps, s.
        ripple: Standard deviation of that estimate about its own average over one second, rad.
    """

    number: int
    place: Floats
    at: dict[str, float]
    bands: dict[str, list[str]]
    scores: dict[str, NDArray[Any]]
    drives: list[str]
    delay: float
    ripple: float


def sequence(count: int) -> Floats:
    """Return the first points of a scrambled Sobol sequence in the unit box, ``(count, len(FACTORS))``."""
    return np.asarray(qmc.Sobol(len(FACTORS), rng=np.random.default_rng(SEED)).random(count))


def evaluate(number: int, at: Mapping[str, float], jobs: int, network: str = studies.NETWORK) -> Point:
    """Run the studies of the point with some values by factor, with a network by name or file."""
    study = studies.study_at(at, network)
    evaluator = StudyEvaluator(study)
    for kernel in range(evaluator.kernels):
        evaluator.warm_up(kernel)
    every = [u for design in study.designs for u in units(study, design)]
    results = joblib.Parallel(jobs, backend="threading")(joblib.delayed(evaluator.evaluate)(u) for u in every)
    scores: dict[str, NDArray[Any]] = {}
    for d, design in enumerate(study.designs):
        for score in SCORES:
            rows = [
                [
                    np.concatenate([r[score] for u, r in zip(every, results, strict=True) if where(u, d, band, drive)])
                    for drive in range(len(study.drives))
                ]
                for band in range(design.bands)
            ]
            scores[f"{design.name}/{score}"] = np.array(rows, dtype=np.int8 if score == "status" else np.float32)
    delay, ripple = steering_delay(evaluator)
    bands = {d.name: list(d.band_labels) for d in study.designs}
    return Point(number, place_of(at), dict(at), bands, scores, [d.name for d in study.drives], delay, ripple)


def where(unit: Any, design: int, band: int, drive: int) -> bool:
    """Tell whether a unit belongs to a design, band and drive."""
    return (unit.design, unit.band, unit.drive) == (design, band, drive)


def steering_delay(evaluator: StudyEvaluator) -> tuple[float, float]:
    """Return delay in s and ripple in rad of the first estimator's steering-wheel angle in the first history.

    The delay is the lag of the largest correlation; NaN where the run is lost.
    """
    run = histories(evaluator)[0]
    estimate = run["estimate"].isel(estimator=0).sel(target="steering_wheel_angle").values
    true, step = run["input_steering_wheel_angle"].values, evaluator.study.belief.step
    if not np.isfinite(estimate).all():
        return np.nan, np.nan
    return lag(estimate, true, step), ripple(estimate, step)


def lag(estimate: Floats, true: Floats, step: float) -> float:
    """Return by how much an estimate lags behind the truth, s: where their correlation is largest."""
    lags = np.arange(int(DELAY_LIMIT / step))
    correlations = [np.corrcoef(estimate[k:], true[: len(true) - k])[0, 1] for k in lags]
    return float(lags[int(np.argmax(correlations))] * step)


def ripple(estimate: Floats, step: float) -> float:
    """Return the standard deviation of an estimate about its average over one second."""
    width = round(1.0 / step)
    smooth = signal.fftconvolve(estimate, np.full(width, 1.0 / width), mode="same")
    return float(np.std((estimate - smooth)[width:-width]))


class Folder:
    """The points kept in a folder, each in a file of its own.

    Args:
        path: The folder; made when the first point is written.
    """

    def __init__(self, path: Path) -> None:
        self.parts = Parts(path)
        at_centre = studies.study_at(settings(np.full(len(FACTORS), 0.5)))
        self.code = engine_hash(at_centre) + sources.digest([studies])

    def get(self, number: int, place: Floats) -> Point | None:
        """Return a point that is there already.

        Raises:
            UserError: If the file is damaged, or was made at another place or by other code.
        """
        content = self.parts.get(_name(number), self._state(place))
        if content is None:
            return None
        bands = {n.removeprefix("bands/"): list(map(str, v)) for n, v in content.items() if n.startswith("bands/")}
        scores = {n: v for n, v in content.items() if n.split("/")[-1] in SCORES}
        drives, delay = list(map(str, content["drives"])), float(content["delay"])
        return Point(number, place, settings(place), bands, scores, drives, delay, float(content["ripple"]))

    def put(self, point: Point) -> None:
        """Write a point, whole or not at all."""
        content: dict[str, Any] = {**point.scores, **{f"bands/{n}": np.array(v) for n, v in point.bands.items()}}
        content |= {"drives": np.array(point.drives), "delay": point.delay, "ripple": point.ripple}
        self.parts.put(_name(point.number), self._state(point.place), content)

    def _state(self, place: Floats) -> str:
        return state_of(self.code, place.tobytes())

    def points(self, places: Floats, first: int, jobs: int, tell: Callable[[str], None]) -> Iterator[Point]:
        """Yield the points at some places, those that are not there yet computed and kept.

        Args:
            places: In the unit box, ``(points, len(FACTORS))``.
            first: Number of the first.
            jobs: Threads.
            tell: Called with a line after each point that was computed.
        """
        for number, place in enumerate(places, start=first):
            point = self.get(number, place)
            if point is None:
                point = replace(evaluate(number, settings(place), jobs), place=place)
                self.put(point)
                tell(f"point {number + 1} of {first + len(places)}")
            yield point


def _name(number: int) -> str:
    return f"point_{number:04d}"
