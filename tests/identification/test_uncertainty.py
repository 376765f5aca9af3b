"""Profiles: an interval is as wide as the likelihood says, also where some coordinates tell nothing."""

from dataclasses import dataclass, field
from types import SimpleNamespace

import numpy as np
import pytest

from harness.identification.uncertainty import Summit, _interval, limits_of_knowledge, profile

SAMPLES, STRICT = 3000, 3e6


class TwoVariances:
    """Logarithms of two variances: samples of variance one, of their sum, and others that show the second as zero."""

    lower, upper = np.full(2, -60.0), np.full(2, 60.0)

    def values(self, z, keep_first=False):
        first, second = np.exp(z)
        summed, alone = first + second, 1.0 + second
        return -0.5 * (SAMPLES * (np.log(summed) + 1 / summed) + STRICT * (np.log(alone) + 1 / alone))

    def slopes(self, z, moved):
        first, second = np.exp(z)
        rates = np.array([[first, second], [0.0, second]]) / np.array([[first + second], [1.0 + second]])
        excess = np.array([1 / (first + second), 1 / (1.0 + second)]) - 1
        weight = 0.5 * np.array([SAMPLES, STRICT])
        gradient, information = rates.T @ (weight * excess), rates.T @ (weight[:, None] * rates)
        return float(self.values(z)), gradient[moved], information[np.ix_(moved, moved)]


@dataclass
class Space:
    """What of the coordinates a profile asks for."""

    lower: np.ndarray
    upper: np.ndarray
    weight: np.ndarray = field(default_factory=lambda: np.zeros(2))
    coordinates: tuple = (SimpleNamespace(stated_std=np.inf),) * 2

    def __len__(self):
        return 2


def test_a_variance_near_zero_does_not_cut_the_interval_of_another_short():
    """The information predicts that it moves along by any factor; the profile then begins where it is far too large."""
    objective, z = TwoVariances(), np.array([0.0, -59.9])
    value, _, information = objective.slopes(z, np.ones(2, dtype=bool))
    space = Space(objective.lower, objective.upper)
    knowledge = limits_of_knowledge(space, z, information)
    drawn = profile(Summit(space, objective, z, value, information, knowledge), [0])
    expected = 1.96 * np.sqrt(2 / SAMPLES)
    assert _interval(*drawn[0], 0.0, float(knowledge.error[0])) == pytest.approx((-expected, expected), rel=0.05)
