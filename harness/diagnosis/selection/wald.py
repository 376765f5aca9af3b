"""What a model would lose without one of its additions, by the curvature of its likelihood (Wald 1943).

With the estimate ``a`` of its amplitudes, counted from where it is absent, and their covariance ``C`` beside all else
that the fit moved, the loss in log-likelihood is ``a' C^-1 a / 2`` with the noise as it is; noise that is fitted again
may take up half of it. What loses a gain that is beyond doubt need not be
fitted again without it; neither need what stands in its place with a response of cosine ``c`` to its own, because that
takes over the share ``c^2`` of the loss at most.
"""

from __future__ import annotations

import math

import numpy as np

from harness.diagnosis.fitting.fit import Fitted
from harness.diagnosis.model.hypotheses import Hypothesis
from harness.diagnosis.selection.candidate_fits import Added, CandidateFits
from harness.identification.uncertainty import marginal


def losses(fits: CandidateFits, added: Added, fitted: Fitted) -> dict[Hypothesis, float]:
    """Return the loss in BIC that is predicted of a fit without each of its additions; none of a random process."""
    moved = [c for c in fitted.coordinates if c.kind == "parameter"]
    information = fits.fitting.information(fitted)
    stated, found = fits.augmented.stated(), {}
    for h in added:
        rows = [] if h.random else [i for i, c in enumerate(moved) if c.name in h.amplitudes]
        own = [moved[i] for i in rows]
        away = np.array([c.coordinate(fitted.point.value(c)) - c.coordinate(float(stated[c.rows[0]])) for c in own])
        gain = 0.5 * float(away @ marginal(information, rows) @ away) if rows else 0.0
        found[h] = fits.bic(gain, h.count(len(fits.fitting.drives))) if math.isfinite(gain) else 0.0
    return found
