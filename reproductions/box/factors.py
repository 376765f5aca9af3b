"""Factors of the box, which the dissertation does not publish: range and reason of each."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from harness.common.arrays import Floats


@dataclass(frozen=True)
class BoxFactor:
    """A quantity that the dissertation leaves open.

    Attributes:
        name: Key in files.
        words: Name in reports.
        unit: As printed; empty for a ratio.
        lower: Lower end of the box, or of the choices.
        upper: Upper end.
        log: Whether the range is filled evenly in the logarithm.
        published: What the dissertation says of it.
        choices: The values of a factor that has no range; the first belongs to the lower end.
    """

    name: str
    words: str
    unit: str
    lower: float
    upper: float
    log: bool
    published: str
    choices: tuple[float, ...] = ()

    def value(self, place: float) -> float:
        """Return the value at a place in the unit interval."""
        if self.choices:
            return self.choices[min(int(place * len(self.choices)), len(self.choices) - 1)]
        if self.log:
            return float(self.lower * np.exp(place * np.log(self.upper / self.lower)))
        return float(self.lower + place * (self.upper - self.lower))

    def place(self, value: float) -> float:
        """Return the place in the unit interval that has a value."""
        if self.choices:
            return (self.choices.index(value) + 0.5) / len(self.choices)
        if self.log:
            return float(np.log(value / self.lower) / np.log(self.upper / self.lower))
        return (value - self.lower) / (self.upper - self.lower)


def _choice(name: str, words: str, unit: str, choices: tuple[float, ...], published: str) -> BoxFactor:
    return BoxFactor(name, words, unit, min(choices), max(choices), False, published, choices)


TYRES = "Bild 4.6 shows histograms of the tyre parameters without numbers; table 4.4 gives the range of the search."
DRIVES = "The recorded drives of 5.3 are described in words: kinds of manoeuvres, not their speeds and angles."
NOISE = (
    "(5.3) and (5.4) have no units and do not say whether they are variances per sample or intensities; Bild 5.7 shows "
    "a force that is clearly noisy, and 5.3 blames its worst run on unfavourable noise."
)

FACTORS: tuple[BoxFactor, ...] = (
    BoxFactor("shape_factor_11", "shape factor, front axle", "", 1.0, 1.9, False, TYRES),
    BoxFactor("shape_factor_12", "shape factor, drive axle", "", 1.0, 1.9, False, TYRES),
    BoxFactor("shape_factor_2", "shape factor, trailer", "", 1.0, 1.9, False, TYRES),
    BoxFactor("stiffness_11", "cornering stiffness, front axle", "× ours", 0.5, 2.0, True, TYRES),
    BoxFactor("stiffness_12", "cornering stiffness, drive axle", "× ours", 0.5, 2.0, True, TYRES),
    BoxFactor("stiffness_2", "cornering stiffness, trailer", "× ours", 0.5, 2.0, True, TYRES),
    BoxFactor("stiffness_load_2", "load of the largest stiffness, trailer", "× ours", 0.5, 2.0, True, TYRES),
    BoxFactor("relaxation_tractor", "relaxation length, tractor", "m", 0.1, 1.5, True, TYRES),
    BoxFactor("relaxation_trailer", "relaxation length, trailer", "m", 0.1, 1.5, True, TYRES),
    BoxFactor(
        "trailer_inertia_scale",
        "trailer's yaw inertia",
        "× a box's",
        0.7,
        6.0,
        True,
        "Table 4.3 prints half of m (track² + length²), six times what a homogeneous box has.",
    ),
    BoxFactor(
        "steering_variance",
        "random walk of the steering wheel",
        "rad² per step",
        1e-6,
        1e-2,
        True,
        "1e-5 without a unit, of the steering wheel or of the road wheels (5.3e-3 at the wheel).",
    ),
    BoxFactor("noise_intensity", "variance of all noise", "× printed", 1.0, 100.0, True, NOISE),
    BoxFactor("process_noise", "variance of the process noise", "× that", 0.1, 10.0, True, NOISE),
    _choice(
        "constraint_rate",
        "stabilisation of the kingpin tie",
        "1/s",
        (0.0, 10.0),
        "(4.17) is differentiated in time; a stabilisation is not mentioned.",
    ),
    _choice(
        "finer_plant",
        "integration of the plant",
        "(0 Euler 10 ms, 1 Runge-Kutta 5 ms)",
        (0.0, 1.0),
        "Euler with 10 ms for the model (4.1.4); what simulated the plant is not said.",
    ),
    BoxFactor("intensity", "intensity of the steering", "×", 0.5, 1.3, False, DRIVES),
    BoxFactor("pace", "speed of the drives", "×", 0.6, 1.4, False, DRIVES),
    BoxFactor("frequency", "frequency of the steering", "×", 0.5, 1.6, True, DRIVES),
    _choice("slow_drives", "drives below 10 m/s", "of 6", (3.0, 4.0, 5.0, 6.0), DRIVES),
    BoxFactor(
        "divergence_limit",
        "angle error that counts as diverged",
        "deg",
        20.0,
        80.0,
        True,
        "Runs in which an estimator became unstable are counted; by which limit is not said.",
    ),
)
"""In the order of the columns of a design."""


def settings(place: Floats) -> dict[str, float]:
    """Return the values of all factors at a place in the unit box, ``(len(FACTORS),)``."""
    return {f.name: f.value(float(p)) for f, p in zip(FACTORS, place, strict=True)}


def place_of(at: Mapping[str, float]) -> Floats:
    """Return the place in the unit box that has some values, ``(len(FACTORS),)``."""
    return np.array([f.place(at[f.name]) for f in FACTORS])


def onto_choices(places: Floats) -> Floats:
    """Return places, ``(points, len(FACTORS))``, in the middle of their choice where a factor has choices."""
    chosen = np.array(places, dtype=float)
    for k, f in enumerate(FACTORS):
        if f.choices:
            chosen[:, k] = [f.place(f.value(p)) for p in chosen[:, k]]
    return chosen


def as_printed(at: Mapping[str, float]) -> dict[str, float]:
    """Return values with the three digits that tables print, so that whoever reads one can go there."""
    return {name: float(f"{value:.3g}") for name, value in at.items()}
