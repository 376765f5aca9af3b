"""Ziaukas 2023, 5.4 and 5.5: what the estimators lose where the vehicle is not as believed."""

from __future__ import annotations

import itertools

import numpy as np

from harness.config import load_study
from harness.models.quantities import words
from reproductions.campaign.claims import ANGLE, CLAIMS, EKF, EVERYONE, FORCE, MATCHED, NETWORK, UKF
from reproductions.campaign.evidence import Evidence, share
from reproductions.published import ziaukas_evidence as evidence
from reproductions.published.record import Kind, Record, Test, between, image, point, setting, statement
from reproductions.published.results import STUDIES, Stored

TITLE = "Ziaukas 2023, 5.4 and 5.5: robustness"
NOTE = (
    "Findings of the campaign are tested as there (reproductions/campaign/claims.py). Runs are paired: the same "
    "drives and the same noise at every level."
)

CLOSER = (
    "Our errors are smaller without any change, those of the network most, so that changes show and estimators order "
    "otherwise."
)
FILTERS = (EKF, UKF)
NOISES = ("×10", "×1", "×0.1", "×0.01", "×0.001")
MASSES = ("8 t", "12 t", "16 t", "20 t", "24 t", "28 t", "32 t")
FRICTIONS = ("0.5", "0.6", "0.7", "0.8", "1", "1.1")
"""Levels of friction that are not believed."""

BANDS = ("±10 %", "±20 %", "±30 %")


def over(study: str, estimator: str, other: str, target: str, bands: tuple[str, ...]) -> evidence.Pairs:
    """Return pairs of two estimators on the same runs, by level."""
    return {f"{estimator} over {other}, {b}": ((study, b, estimator, target), (study, b, other, target)) for b in bands}


def levels(study: str, level: str, other: str, target: str, names: tuple[str, ...] = EVERYONE) -> evidence.Pairs:
    """Return pairs of two levels, by estimator."""
    return {f"{n}, {level} over {other}": ((study, level, n, target), (study, other, n, target)) for n in names}


def _lost(study: str, band: str, theirs: tuple[int, int]) -> Test:
    """Return the test of the share of runs that any of the estimators or the plant lose."""

    def test(stored: Stored) -> list[Evidence]:
        value = theirs[0] / theirs[1]
        counts = {name: stored.diverged(study, band, name) for name in EVERYONE}
        return [
            Evidence(f"{name}: share of runs lost", share(count, total), between(value), value, total)
            for name, (count, total) in counts.items()
        ]

    return test


def _falls_steadily(name: str) -> Test:
    return evidence.ratio(
        {
            f"{name}, {low} over {high}": (("process-noise", low, name, ANGLE), ("process-noise", high, name, ANGLE))
            for high, low in itertools.pairwise(NOISES)
        },
        (0.0, 1.0),
    )


def _noise() -> tuple[Record, ...]:
    name = "process-noise"
    less = NOISES[3:]
    return (
        *evidence.findings("5.4.1"),
        Record(
            "5.4.1",
            "runs that diverge at ten-fold noise",
            "14 of 120",
            "",
            test=_lost(name, "×10", (14, 120)),
            needs=name,
            reason="Whether a run leaves the range of validity depends on drives and tyres, which are ours.",
        ),
        statement(
            "Bild 5.8",
            "at a thousandth of the noise the force is a little worse again than at a hundredth",
            evidence.ratio(levels(name, "×0.001", "×0.01", FORCE), (1.0, 1.25)),
            name,
        ),
        statement(
            "5.4.1",
            "on the force the network is worse than the EKF at every noise",
            evidence.ratio(over(name, NETWORK, EKF, FORCE, NOISES), (1.0, np.inf)),
            name,
            CLOSER,
        ),
        statement(
            "5.4.1",
            "on the angle the network is better than the EKF at every noise",
            evidence.ratio(over(name, NETWORK, EKF, ANGLE, NOISES), (0.0, 1.0)),
            name,
            CLOSER,
        ),
        statement("5.4.1", "the network's angle gets better steadily with less noise", _falls_steadily(NETWORK), name),
        statement(
            "5.4.1",
            "the filters' angle gets better down to a hundredth of the noise",
            evidence.ratio(levels(name, "×0.01", "×1", ANGLE, FILTERS), (0.0, 1.0)),
            name,
        ),
        statement(
            "5.4.1",
            "and a little worse again at a thousandth",
            evidence.ratio(levels(name, "×0.001", "×0.01", ANGLE, FILTERS), (1.0, 1.25)),
            name,
            "In theirs an error remains that is not the noise's; in ours the error falls with the noise.",
        ),
        statement(
            "Bild 5.8",
            "with less noise the worst run of the UKF is better than that of the EKF on the angle",
            evidence.extremes(over(name, UKF, EKF, ANGLE, less), np.nanmax, (0.0, 1.0)),
            name,
        ),
        statement(
            "5.4.1",
            "with less noise the network's angle scatters less than the filters'",
            evidence.extremes(over(name, NETWORK, EKF, ANGLE, less), evidence.spread, (0.0, 1.0)),
            name,
            CLOSER,
        ),
        image("Bild 5.8", "errors over the process noise"),
    )


def _mass_median(band: str) -> Record:
    def test(stored: Stored) -> list[Evidence]:
        return [
            Evidence(n, e.value, e.region, e.theirs, e.n)
            for n in EVERYONE
            for e in evidence.median(("mass", band, n, ANGLE), 3.0)(stored)
        ]

    return Record("5.4.2", f"median error of the angle at {band}", "3", "°", test=test, needs="mass", reason=CLOSER)


def _closes(stored: Stored) -> list[Evidence]:
    """Compare how far the network is behind at 8 t with how far at 24 t."""
    ratios = []
    for band in ("8 t", "24 t"):
        medians = [np.nanmedian(stored.errors("mass", band, n, FORCE)) for n in (NETWORK, EKF)]
        ratios.append(float(medians[0] / medians[1]))
    return [point("network over EKF at 8 t, over the same at 24 t", ratios[0] / ratios[1], (0.0, 1.0))]


def _overestimates(stored: Stored) -> list[Evidence]:
    """Compare the RMS of the estimated force with the true one in the run that is drawn over time."""
    runs = [h for h in stored.stores["mass"].histories if h.attrs["band_label"] == "8 t"]
    evidence = []
    for name in EVERYONE:
        for run in runs:
            truth = run["truth"].sel(target=FORCE).to_numpy()
            estimate = run["estimate"].sel(target=FORCE, estimator=name).to_numpy()
            ratio = float(np.sqrt(np.nanmean(estimate**2) / np.nanmean(truth**2)))
            evidence.append(
                point(f"{name}: RMS of the estimate over the truth, {run.attrs['drive']}", ratio, (1.0, np.inf)),
            )
    return evidence


def _mass() -> tuple[Record, ...]:
    of_550 = "A median over our drives stands for their drive, which is not published. " + CLOSER
    return (
        setting(
            "5.4.2",
            "mass that is believed",
            "24000",
            load_study(STUDIES / "mass.toml").belief.values["trailer_mass"],
            "kg",
        ),
        *evidence.findings("5.4.2"),
        *(_mass_median(band) for band in MASSES),
        statement(
            "5.4.2",
            "at masses not believed the filters' lead over the network on the force shrinks",
            _closes,
            "mass",
        ),
        statement(
            "5.4.2",
            "on the angle the network is a little better than the EKF at every mass",
            evidence.ratio(over("mass", NETWORK, EKF, ANGLE, MASSES), (0.0, 1.0)),
            "mass",
            CLOSER,
        ),
        statement(
            "5.4.2",
            "the least error of the angle is a filter's at every mass",
            evidence.extremes(over("mass", EKF, NETWORK, ANGLE, MASSES), np.nanmin, (0.0, 1.0)),
            "mass",
        ),
        *(
            Record(
                "Bild 5.10",
                f"error of the angle on a drive at 8 t, {name}",
                theirs,
                "°",
                test=evidence.median(("mass", "8 t", name, ANGLE), float(theirs)),
                needs="mass",
                reason=of_550,
            )
            for name, theirs in ((EKF, "2.70"), (NETWORK, "2.36"))
        ),
        statement("Bild 5.10", "at 8 t all overestimate the force", _overestimates, "mass"),
        image("Bild 5.9, 5.10", "errors over the mass; a drive at 8 t over time"),
    )


def _cog() -> tuple[Record, ...]:
    ends = ("-2 m", "+2 m")
    return (
        *evidence.findings("5.4.3"),
        statement(
            "5.4.3",
            "on the angle the worst run of the network is worse than that of the EKF, shifted by 2 m",
            evidence.extremes(over("cog", NETWORK, EKF, ANGLE, ends), np.nanmax, (1.0, np.inf)),
            "cog",
        ),
        image("Bild 5.11", "errors over the shift of the centre of gravity"),
    )


def _friction() -> tuple[Record, ...]:
    name = "friction"
    believed = load_study(STUDIES / "friction.toml").belief.values["friction"]
    return (
        setting("5.4.4", "friction that is believed", "0.9", believed),
        setting("5.4.4", "least friction", "0.5", _factor_end("friction", 0)),
        setting("5.4.4", "largest friction", "1.1", _factor_end("friction", -1)),
        *evidence.findings("5.4.4"),
        statement(
            "5.4.4",
            "less friction hurts the force more than as much more friction (0.7 and 1.1)",
            evidence.ratio(levels(name, "0.7", "1.1", FORCE), (1.0, np.inf)),
            name,
        ),
        statement(
            "5.4.4",
            "on the force the network is a little better than the EKF at every friction not believed",
            evidence.ratio(over(name, NETWORK, EKF, FORCE, FRICTIONS), (0.0, 1.0)),
            name,
            CLOSER,
        ),
        statement(
            "5.4.4",
            "on the angle the EKF is a little better than the network at every friction",
            evidence.ratio(over(name, EKF, NETWORK, ANGLE, (*FRICTIONS, "0.9")), (0.0, 1.0)),
            name,
        ),
        image("Bild 5.12", "errors over the friction"),
    )


def _factor_end(study: str, which: int) -> float:
    """Return the first or the last level of the factor of a study."""
    return float(load_study(STUDIES / f"{study}.toml").designs[0].factors[0].levels[which])


def _tyre() -> tuple[Record, ...]:
    name = "tyre"
    study = load_study(STUDIES / "tyre.toml")
    design = study.designs[0]
    grows = next(c for c in CLAIMS if c.text.startswith("Trailer tyres within"))
    runs = len(study.drives) * design.samples * design.repeats * 4
    return (
        setting("5.4.5", "tyre parameters that vary together", "4", len(design.factors)),
        setting("5.4.5", "points of the Sobol sequence per band", "20", design.samples),
        setting("5.4.5", "repeats of each point and drive", "5", design.repeats),
        setting("5.4.5", "runs in all", "2400", runs),
        *(
            Record(
                "5.4.5",
                f"growth of the median error of the force at {band}",
                f"{100 * (theirs - 1):.1f}",
                "%",
                test=evidence.finding(grows, theirs),
                needs=name,
                reason=grows.reason,
            )
            for band, theirs in zip(BANDS, (1.046, 1.238, 1.509), strict=True)
        ),
        *evidence.findings("5.4.5", without="Trailer tyres within"),
        statement(
            "5.4.5",
            "on the force the EKF is a little better than the network in every band",
            evidence.ratio(over(name, EKF, NETWORK, FORCE, BANDS), (0.0, 1.0)),
            name,
        ),
        statement(
            "5.4.5",
            "on the angle the UKF is always a little better than the EKF",
            evidence.ratio(over(name, UKF, EKF, ANGLE, BANDS), (0.0, 1.0)),
            name,
        ),
        statement(
            "5.4.5",
            "on the angle the network scatters less than the UKF",
            evidence.extremes(over(name, NETWORK, UKF, ANGLE, BANDS), evidence.spread, (0.0, 1.0)),
            name,
            CLOSER,
        ),
        image("Bild 5.13", "errors over the band of the tyres"),
    )


ENDS = {"process-noise": ("×10",), "mass": ("8 t", "32 t"), "cog": ("-2 m", "+2 m"), "friction": ("0.5", "1.1")}
ENDS |= {"tyre": ("±30 %",)}


def _angle_is_robust(study: str) -> Record:
    def test(stored: Stored) -> list[Evidence]:
        pairs = []
        for band in ENDS[study]:
            for name in EVERYONE:
                growth = [
                    np.nanmedian(stored.errors(study, band, name, t))
                    / np.nanmedian(stored.errors(study, MATCHED[study], name, t))
                    for t in (ANGLE, FORCE)
                ]
                pairs.append(
                    point(
                        f"{name}, {band}: growth of the angle over that of the force", growth[0] / growth[1], (0.0, 1.0)
                    ),
                )
        return pairs

    return Record(
        "5.5",
        f"the angle is more robust than the force: {words(study)}",
        kind=Kind.STATEMENT,
        test=test,
        needs=study,
        reason="The angle grows from a small error. " + CLOSER,
    )


def records() -> tuple[Record, ...]:
    """Return what the sections publish."""
    return (
        *_noise(),
        *_mass(),
        *_cog(),
        *_friction(),
        *_tyre(),
        *evidence.findings("5.3 and 5.5"),
        *(_angle_is_robust(study) for study in ENDS),
    )
