"""The numbers that decide what a trace names and what its verdict is: each here once, with its reason.

Halved or doubled, a number that is not here (a grid, a tolerance of a fit, a number of iterations) changes how long a
trace takes and the last digits of what it finds, and not which effect it names.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass


@dataclass(frozen=True)
class Priors:
    """What is known before the drives are seen.

    That the odds of a kind are shared corrects for how many hypotheses are tried (Scott and Berger 2010, section 2). An
    effect that is tried at several places shares those of its file.

    Attributes:
        odds: Against the same model without it, that something of a kind is there; all hypotheses of a kind share them.
        stated: Standard deviation of the logarithm of a parameter about its stated value, where its set states none.
        length: The same of a length that says where an axle, a coupling or the CoG is.
        implausible: How many of these one of many parameters may be off at most.
        beside_curves: The most that it may be for the step of a parameter besides curves.
        misfit: Factor on the spectrum of the innovations in an octave that something unmodelled adds at least.
        gain: Share by which a gain may differ from what positions say of it, besides their standard errors.
        intensity: Standard deviation of the logarithm of an intensity of a random process on another day.
        likeness: Share by which the size of a change may be off, because the model of the vehicle is only like it.
    """

    odds: Mapping[str, float]
    stated: float
    length: float
    implausible: float
    beside_curves: float
    misfit: float
    gain: float
    intensity: float
    likeness: float


BIC_NEEDED = 50.0
"""Gain in BIC on the fitted drives that counts as evidence, and as a lead over another hypothesis.

Drives without a missing effect reach 9, 43 and 69 by chance where samples are taken as independent; the other criteria
refuse what passes this one. A curve or an order, which has no BIC, needs as much: half of it in log-likelihood."""

HOPEFUL = 500.0
"""Gain in BIC beyond doubt: an addition that leaves the simulation error is then tried with a further one, because the
error may be that of another effect."""

MOST = 0.5
"""Share that counts as most of something: hypotheses with this share of the largest predicted gain are fitted; a round
begins again where the model without addition, refitted, reaches this share of the best gain, because its ranking was
that of a poor fit; what takes over this share of another's gain is tried in its place; a fault of one sensor must take
it of its own signal's error, where other signals mask its share."""

ERROR_NEEDED = 0.2
"""Share of the simulation error on held-out drives, beyond the noise of sensors and inputs and what is uncertain of
that (``EXCESS``), that an addition must take: what gains likelihood and no prediction is mostly noise that was fitted.
"""

EXCESS = 0.05
"""Mean square of the simulation error over its floor, less one, below which nothing is left to explain: the variance of
the noise itself is estimated to a few percent. Also the share of the squared correlations of the innovations that a
random process may leave: a road is smoother than a Gauss-Markov process, the more so, the larger its bank is."""

LITTLE = 0.01
"""Share of the excess of the model without additions below which nothing is left to explain either: of a large effect
the library's form and the vehicle differ by as much."""

FURTHER_CHANGE = 0.05
"""Share of what changes explain already that a further one must explain, in gain in BIC: the form of a large change is
that of the library but for some percent, and what that leaves is no other change."""

SAME = 0.999
"""Cosine of two responses from which the drives cannot tell hypotheses apart at all; only one of them is fitted."""

TRIED = 3
"""Hypotheses that are fitted beyond those that promise enough: what acts like the best of a round, what may stand
in the place of an addition; and curves at most. Further ones act like these."""

ROUNDS = 5
"""Largest number of additions: two effects, and what the recordings have of their own."""

WHITE = 1e-8
"""p-value of the innovations on the held-out drives, below which something is missing whatever the simulation error is.
With the right structure it is rarely below 1e-4; the margin covers noise variances that are slightly wrong."""

STRONG = 10.0
"""Gain in BIC from which the evidence is strong (Kass and Raftery 1995, section 3.2): a model of which much is missing
anyway takes it up, and so does one that has only to predict."""

DIFFERENCES = 12
"""Largest number of effects by which such a model grows."""

CORRELATED = 0.15
"""Correlation of the noise of samples beyond which a model that grows takes not all of them: of neighbours it makes
standard errors a seventh too small, and half of the samples would make them two fifths larger."""

INDEPENDENT = 0.05
"""Correlation of those that then are taken."""

FARTHER = 4.0
"""Largest ratio of the excess of the simulation to the one expected of a random process; beyond it something else is
missing. A slow process may well reach twice its standard deviation in a drive, that of a gyroscope that drifts as well
as any other."""

PRIORS = Priors(
    odds={
        "effect": 0.3,  # of the vehicle: a model that somebody believes in lacks something in every fourth case or so
        "sensor": 0.3,  # a fault of one sensor is as common: mountings, scales, clocks
        "parameter": 0.3,  # and so is one stated value that is off by more than its tolerance
        "many": 0.03,  # that many are off at once is rarer, and such a model fits whatever is missing
        "none": 0.1,  # something that the library does not hold; it has thirty effects because they are what is met
    },
    stated=0.2,  # most stated values are right to a fifth
    length=0.05,  # axles are measured with a tape, and the CoG by weighing them
    implausible=3.0,  # a factor of 1.8; beyond it many parameters fit whatever is missing and are not believed
    beside_curves=0.03,  # further from the fit the linear response of a parameter that is hardly excited does not hold
    misfit=1.5,  # a noise variance that was estimated, and parameters that were, leave some percent
    gain=0.01,  # clocks, roll, and positions of another point of the vehicle
    intensity=0.15,  # of 34 days on which nothing had changed; with twice that a constant bias was a gyroscope's drift
    likeness=0.1,  # of plants that share nothing with the models; docs/attribution.md has what intervals then hold
)
"""What is known before the drives are seen."""

HORIZONS = (0.0, 0.1, 1.0, 10.0, math.inf)
"""s; one sample, then decades from what sensors and steering do to what a manoeuvre does, and the whole drive."""

CALM = 0.3
"""m/s^2; lateral acceleration that a road with a cross slope of 3 % has without any steering."""

BLOCK = 5.0
"""s; longer than what is left of a manoeuvre in the next one, and short enough for two dozen blocks in 120 s."""

MASS = 0.9
"""Probability that the confusable set holds."""
