"""Findings of the dissertation (Ziaukas 2023, chapter 5), each as a test on our data.

A finding is put in numbers by a region in which a ratio of errors must lie. The words of the dissertation (marginal,
hardly, clearly) have no numbers there; the regions below are this project's reading of them and are printed.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np

from harness.common.arrays import Floats
from harness.common.statistics import Interval
from harness.models.quantities import words
from harness.realtime.outcome import PACES, PUBLISHED
from reproductions.campaign.evidence import Evidence, Verdict, judge, ratio_of_medians, share

FORCE, ANGLE = "lateral_force_axle_21", "articulation_angle"
EKF, UKF, NETWORK = "EKF", "UKF", "NARX"
EVERYONE = (EKF, UKF, NETWORK)
MATCHED = {"process-noise": "×1", "mass": "24 t", "cog": "0 m", "friction": "0.9", "tyre": "±0 %"}
"""Level that the estimators believe, by study."""

THEIRS = ("ideal", *MATCHED)
"""Studies of the dissertation."""

STUDIES_OF = {
    "5.3 and 5.5": THEIRS,
    "5.3,": ("ideal",),
    "5.4.1": ("process-noise",),
    "5.4.2": ("mass",),
    "5.4.3": ("cog",),
    "5.4.4": ("friction",),
    "5.4.5": ("tyre",),
    "6.3.3": ("realtime",),
}
"""Studies that a finding is tested on, by how its place begins."""

MEDIANS = {
    (EKF, FORCE): 1.64, (UKF, FORCE): 1.63, (NETWORK, FORCE): 1.89,
    (EKF, ANGLE): 3.54, (UKF, ANGLE): 3.55, (NETWORK, ANGLE): 3.26,
}  # fmt: skip
"""Medians of Bild 5.6, in kN and degrees."""

MARGINAL = (0.95, 1.05)
HARDLY = (0.8, 1.25)
CLEARLY_MORE = (1.5, np.inf)
SLIGHTLY_MORE = (1.0, 1.5)
SLIGHTLY_LESS = (1 / 1.5, 1.0)
LARGER = (1.0, np.inf)

DRIVES = "The dissertation's tyre parameters and recorded drives are not published; ours are this project's choice."


class Groups(Protocol):
    """Runs of the dissertation's studies, asked for by names; see ``reproductions.campaign.results.Results``."""

    @property
    def study_names(self) -> tuple[str, ...]:
        """Names of the studies of ``THEIRS`` that there are."""

    def errors(self, study: str, band: str | None, estimator: str, target: str) -> Floats:
        """Return the RMSE of a group of runs, ``(stratum, sample, repeat)``."""

    def diverged(self, study: str, band: str, estimator: str) -> tuple[int, int]:
        """Return how many runs of a group diverged, and how many there are."""

    def bands(self, study: str) -> list[str]:
        """Return the labels of a study's levels."""

    @property
    def times(self) -> Any:
        """What ``harness realtime`` measured."""


@dataclass(frozen=True)
class Claim:
    """A finding of the dissertation.

    Attributes:
        text: The finding, in our words.
        place: Section and figure.
        means: What must hold for it to be reproduced, in words.
        test: Returns the numbers behind it.
        reason: Why ours may differ; printed where it is not reproduced.
    """

    text: str
    place: str
    means: str
    test: Callable[[Groups], list[Evidence]]
    reason: str

    @property
    def studies(self) -> tuple[str, ...]:
        """The studies that it is tested on."""
        return next(names for begin, names in STUDIES_OF.items() if self.place.startswith(begin))


@dataclass(frozen=True)
class Finding:
    """A claim with our evidence and verdict."""

    claim: Claim
    evidence: list[Evidence]

    @property
    def verdict(self) -> Verdict:
        """What the evidence says, taken together."""
        return judge(self.evidence)


def findings(results: Groups) -> list[Finding]:
    """Test every claim."""
    return [Finding(claim, claim.test(results)) for claim in CLAIMS]


def _between(results: Groups, study: str, band: str | None, second: str, first: str, target: str) -> tuple:
    """Return the ratio of two estimators on the same runs."""
    errors = [results.errors(study, band, name, target) for name in (second, first)]
    return ratio_of_medians(errors[0], errors[1])


def _growth(results: Groups, study: str, band: str, estimator: str, target: str) -> tuple:
    """Return the error at a level over that at the level which is believed, on the same drives and noise."""
    errors = [results.errors(study, b, estimator, target) for b in (band, MATCHED[study])]
    return ratio_of_medians(errors[0], errors[1])


def _marginal(results: Groups) -> list[Evidence]:
    theirs = {("ideal", target): MEDIANS[UKF, target] / MEDIANS[EKF, target] for target in (FORCE, ANGLE)}
    return [
        Evidence(f"UKF : EKF, {words(study)}, {words(target)}", value, MARGINAL, theirs.get((study, target), np.nan), n)
        for study in results.study_names
        for target in (FORCE, ANGLE)
        for value, n in [_between(results, study, None, UKF, EKF, target)]
    ]


def _network(target: str, region: tuple[float, float]) -> Callable[[Groups], list[Evidence]]:
    def test(results: Groups) -> list[Evidence]:
        value, n = _between(results, "ideal", None, NETWORK, EKF, target)
        return [
            Evidence(
                f"network : EKF, {words(target)}", value, region, MEDIANS[NETWORK, target] / MEDIANS[EKF, target], n
            )
        ]

    return test


def _grows(
    study: str, bands: tuple[str, ...], targets: tuple[str, ...], region: tuple[float, float]
) -> Callable[[Groups], list[Evidence]]:
    """Compare levels with the one believed, for every estimator."""

    def test(results: Groups) -> list[Evidence]:
        return [
            Evidence(f"{name} at {band}, {words(target)}", value, region, np.nan, n)
            for target in targets
            for band in bands
            for name in EVERYONE
            for value, n in [_growth(results, study, band, name, target)]
        ]

    return test


def _ends_diverge(results: Groups) -> list[Evidence]:
    evidence, theirs = [], 11 / 60
    for name in EVERYONE:
        count, total = results.diverged("cog", "-2 m", name)
        value = share(count, total)
        evidence.append(Evidence(f"{name} at −2 m, share diverged", value, (theirs / 2, 2 * theirs), theirs, total))
    return evidence


def _worst_at_half(results: Groups) -> list[Evidence]:
    """Compare the error at 0.5 with that at the worst of the other levels."""
    evidence = []
    for name in EVERYONE:
        others = [b for b in results.bands("friction") if b != "0.5"]
        medians = [np.nanmedian(results.errors("friction", b, name, FORCE)) for b in others]
        worst = others[int(np.argmax(medians))]
        pair = [results.errors("friction", b, name, FORCE) for b in ("0.5", worst)]
        value, n = ratio_of_medians(pair[0], pair[1])
        evidence.append(Evidence(f"{name}, 0.5 : {worst}, lateral force axle 21", value, LARGER, np.nan, n))
    return evidence


def _tyre_growth(results: Groups) -> list[Evidence]:
    evidence = []
    for band, theirs in (("±10 %", 1.046), ("±20 %", 1.238), ("±30 %", 1.509)):
        region = (1 + (theirs - 1) / 2, 1 + 2 * (theirs - 1))
        for name in EVERYONE:
            value, n = _growth(results, "tyre", band, name, FORCE)
            evidence.append(Evidence(f"{name} at {band}, lateral force axle 21", value, region, theirs, n))
    return evidence


def _time_of_a_step(results: Groups) -> list[Evidence]:
    """Compare the time of a step without a pause with that of the EKF."""
    times, evidence = results.times, []
    for name, kind in ((UKF, "ukf"), (NETWORK, "narx")):
        value = Interval(*map(float, times["ratio"].sel(pace=PACES[0], estimator=name).values))
        theirs, steps = PUBLISHED[kind] / PUBLISHED["ekf"], times.sizes["time"]
        evidence.append(Evidence(f"{name} : EKF, time of a step", value, (theirs / 2, 2 * theirs), theirs, steps))
    return evidence


CLAIMS = (
    Claim(
        "EKF and UKF differ only marginally.",
        "5.3 and 5.5, Bild 5.6 to 5.13",
        "medians within 5 % of each other in every study, all levels together",
        _marginal,
        "What the linearisation costs shows up where no other error hides it.",
    ),
    Claim(
        "When all is ideal the network is slightly worse than the filters on the lateral force.",
        "5.3, Bild 5.6",
        "median of the network 1 to 1.5 times that of the EKF",
        _network(FORCE, SLIGHTLY_MORE),
        "Our network follows the steering at once, on drives whose kinds it was trained on; the steering that the "
        f"filters estimate lags, which costs them more than they gain by knowing the model. {DRIVES}",
    ),
    Claim(
        "When all is ideal the network is slightly better than the filters on the articulation angle.",
        "5.3, Bild 5.6",
        "median of the network 0.67 to 1 times that of the EKF",
        _network(ANGLE, SLIGHTLY_LESS),
        "Ours is better by more than slightly, for the same reason as on the force.",
    ),
    Claim(
        "Ten-fold process noise makes every estimator clearly worse, on both targets.",
        "5.4.1, Bild 5.8",
        "median at ten-fold noise more than 1.5 times that at the believed noise",
        _grows("process-noise", ("×10",), (FORCE, ANGLE), CLEARLY_MORE),
        "An estimator whose error is mostly its own, not the noise's, is hurt less by more noise: that of the filters "
        "is the lag of the steering.",
    ),
    Claim(
        "Less process noise than believed helps the estimate of the force only little.",
        "5.4.1, Bild 5.8",
        "median at a thousandth of the noise 0.8 to 1.25 times that at the believed noise",
        _grows("process-noise", ("×0.001",), (FORCE,), HARDLY),
        "Where the model and its parameters are exact, process noise causes the larger part of the error, which "
        f"falls with it. {DRIVES}",
    ),
    Claim(
        "A trailer mass other than believed makes the force clearly worse, in both directions.",
        "5.4.2, Bild 5.9",
        "median at 8 t and at 32 t more than 1.5 times that at 24 t",
        _grows("mass", ("8 t", "32 t"), (FORCE,), CLEARLY_MORE),
        DRIVES,
    ),
    Claim(
        "The mass hardly affects the articulation angle.",
        "5.4.2, Bild 5.9",
        "median at 8 t and at 32 t 0.8 to 1.25 times that at 24 t",
        _grows("mass", ("8 t", "32 t"), (ANGLE,), HARDLY),
        "The dissertation's angle is about 3° off at every mass; our errors are smaller, so the effect of the mass "
        "shows.",
    ),
    Claim(
        "A shifted centre of gravity makes the force worse, forward and back.",
        "5.4.3, Bild 5.11",
        "median at −2 m and at 2 m more than 1.5 times that without a shift",
        _grows("cog", ("-2 m", "+2 m"), (FORCE,), CLEARLY_MORE),
        DRIVES,
    ),
    Claim(
        "The centre of gravity hardly affects the articulation angle.",
        "5.4.3, Bild 5.11",
        "median at −2 m and at 2 m 0.8 to 1.25 times that without a shift",
        _grows("cog", ("-2 m", "+2 m"), (ANGLE,), HARDLY),
        "As with the mass: our errors are smaller without any change.",
    ),
    Claim(
        "With the centre of gravity 2 m further back runs diverge (11 of 60).",
        "5.4.3",
        "share of diverged runs between half and twice the dissertation's",
        _ends_diverge,
        "Whether a run leaves the stable range depends on the lateral acceleration of the drives and on the rear "
        "tyres. " + DRIVES,
    ),
    Claim(
        "On a road of friction 0.5 the force suffers most.",
        "5.4.4, Bild 5.12",
        "median at 0.5 larger than at the worst of the other levels",
        _worst_at_half,
        DRIVES,
    ),
    Claim(
        "Friction hardly affects the articulation angle.",
        "5.4.4, Bild 5.12",
        "median at 0.5 and at 1.1 0.8 to 1.25 times that at 0.9",
        _grows("friction", ("0.5", "1.1"), (ANGLE,), HARDLY),
        "As with the mass: our errors are smaller without any change.",
    ),
    Claim(
        "Trailer tyres within ±10, 20, 30 % of those believed make the median error of the force grow by 4.6, 23.8 and "
        "50.9 %.",
        "5.4.5, Bild 5.13",
        "growth between half and twice the dissertation's",
        _tyre_growth,
        "In the dissertation the error before any change is many times ours, so the same change of the tyres is a "
        "smaller part of it.",
    ),
    Claim(
        "The trailer's tyres hardly affect the articulation angle.",
        "5.4.5, Bild 5.13",
        "median in each band 0.8 to 1.25 times that with the tyres as believed",
        _grows("tyre", ("±10 %", "±20 %", "±30 %"), (ANGLE,), HARDLY),
        "As with the mass: our errors are smaller without any change.",
    ),
    Claim(
        "A step of the network takes least computing time, one of the UKF most (loads of 0.67, 1.65 and 5.61 %).",
        "6.3.3, Bild 6.9",
        "ratio to the EKF between half and twice the dissertation's, steps without a pause",
        _time_of_a_step,
        "Ratios depend on processor and code: here all are compiled from the same equations.",
    ),
)
