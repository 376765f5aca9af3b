"""How much weight a filter gives a measurement: the gain, where a state is measured itself.

With independent sensor noise the gain of a Kalman filter is ``K = P C' R^-1`` with the covariance ``P`` after the
correction. Where an output is a state itself, its entry for that state is the variance that the filter states after the
measurement over the variance of the measurement: 1 follows the sensor, 0 ignores it.
"""

from __future__ import annotations

import numpy as np
import xarray as xr

from harness.models.quantities import quantity
from harness.reporting.document import Block, Prose, Sheet, plain
from harness.study.report.analysis import Analysis
from harness.study.results import run_in_words

_FIRST = 4  # samples told one by one
FOLLOWS, IGNORES = 0.95, 0.05
"""Weights from which a filter is said to follow the sensor, or the model."""


def blocks(analysis: Analysis) -> list[Block]:
    """Return the gains of the drawn runs; nothing where no state was measured that was drawn."""
    rows, said = [], []
    for data in analysis.store.histories:
        name = run_in_words(data, drive=False)
        for target, estimator, gains in gains_of(data):
            rows.append([name, quantity(target).words, estimator, *(f"{k:.4f}" for k in [*gains[:_FIRST], gains[-1]])])
            if gains[-1] >= FOLLOWS:
                said.append(f"{name}: {estimator} finally follows the measured {quantity(target).words}.")
            elif gains[-1] <= IGNORES:
                said.append(f"{name}: {estimator} finally relies on its model and its inputs.")
    if not rows:
        return []
    text = (
        "Where a sensor measures a state itself, the gain of a Kalman filter for it is the variance after the "
        f"measurement over that of the measurement: 1 follows the sensor, 0 ignores it. {' '.join(said)}"
    )
    header = ["run", "quantity", "estimator", *(f"K({n})" for n in range(1, _FIRST + 1)), "K at the end"]
    caption = "Gain of the measurement of a quantity on its own estimate, at the first samples and at the end."
    return [
        Prose(plain(text.strip())),
        Sheet(header, rows, caption, left=3),
    ]


def gains_of(data: xr.Dataset) -> list[tuple[str, str, np.ndarray]]:
    """Return target, estimator and gains ``(samples - 1,)`` for every measured target with a stated variance."""
    gains = []
    for target in (str(t) for t in data["target"].values):
        measured = data.get(f"measured_{target}")
        if measured is None or not measured.attrs.get("variance", 0.0) > 0:
            continue
        for estimator in (str(e) for e in data["estimator"].values):
            variance = data["std"].sel(target=target, estimator=estimator).values[1:] ** 2
            if len(variance) >= _FIRST and np.isfinite(variance).all():
                gains.append((target, estimator, variance / measured.attrs["variance"]))
    return gains
