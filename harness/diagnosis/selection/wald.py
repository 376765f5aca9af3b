"""What a model would lose without one of its additions, by the curvature of its likelihood (Wald 1943).

With its amplitudes where it is absent, all else that the fit moved goes where it is likeliest by the Fisher information
``F``, within its bounds, and the loss in log-likelihood is ``d'F d / 2`` of the whole step ``d``, with the noise as it
is; noise that is fitted again may take up half of it. Without bounds that is Wald's statistic. They matter where
several together do the same: channels that are late against the steering wheel cannot be early instead.

What loses a gain that is beyond doubt need not be fitted again without it.
"""

from __future__ import annotations

import math

import numpy as np

from harness.diagnosis.fitting.fit import Fitted
from harness.diagnosis.model.hypotheses import Hypothesis
from harness.diagnosis.selection.candidate_fits import Added, CandidateFits
from harness.identification.fisher_scoring import bounded_step


def losses(fits: CandidateFits, added: Added, fitted: Fitted) -> dict[Hypothesis, float]:
    """Return the loss in BIC that is predicted of a fit without each of its additions; none of a random process."""
    moved = [c for c in fitted.coordinates if c.kind == "parameter"]
    information = fits.fitting.information(fitted)
    stated, found = fits.augmented.stated(), {}
    z = np.array([c.coordinate(fitted.point.value(c)) for c in moved])
    lower, upper = (np.array([getattr(c, name) for c in moved]) - z for name in ("lower", "upper"))
    for h in added:
        rows = [] if h.random else [i for i, c in enumerate(moved) if c.name in h.amplitudes]
        others = [i for i in range(len(moved)) if i not in rows]
        step = np.zeros(len(moved))
        step[rows] = [moved[i].coordinate(float(stated[moved[i].rows[0]])) - z[i] for i in rows]
        with np.errstate(over="ignore", invalid="ignore"):
            pull = -(information @ step)[others]
            if np.isfinite(pull).all():
                own = information[np.ix_(others, others)]
                step[others] = bounded_step(pull, own, 0.0, lower[others], upper[others])
            loss = 0.5 * float(step @ information @ step)
        found[h] = fits.bic(loss, h.count(len(fits.fitting.drives))) if math.isfinite(loss) else 0.0
    return found
