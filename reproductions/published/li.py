"""Li et al. 2017: settings, what the text says of its figures, and under which process noise fading helps.

The paper prints no error: its figures are images, and its table of the car is one too. The plant is the two-track car
of ``studies/car-strong-tracking.toml`` in place of the paper's simulator.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np

from harness.common.statistics import Interval, median_interval
from harness.common.units import registry
from harness.config import load_study
from harness.estimation.methods import st_cdkf
from harness.models.quantities import words
from harness.reporting import style
from harness.study.results import Design, StudyResults
from reproductions.campaign.evidence import Evidence, ratio_of_medians
from reproductions.published.record import HERE, Kind, Record, foreign, image, point, setting, statement
from reproductions.published.results import STUDIES, Stored

TITLE = "Li et al. 2017: strong-tracking central-difference Kalman filter"
NOTE = (
    "The paper states no error as a number, only figures. Its process noise Q = 0.001 I has no unit; the level ×10 "
    "below has its 0.001 for speed, sideslip and yaw rate, in SI units (docs/cars.md)."
)

OF = "car-strong-tracking"
LEVELS = (0.001, 0.01, 0.1, 1.0, 10.0, 100.0)
REPEATS = 10
FADING, PLAIN = "ST-CDKF", "CDKF"
GOOD, POOR = ("longitudinal_velocity", "yaw_rate"), "sideslip_angle"
JUDGED = ("yaw_rate", "sideslip_angle")
HELPS = 0.98
"""More accurate: an error at least 2 % smaller."""

STIFFNESSES = ("cornering_stiffness_front", "cornering_stiffness_rear")
WANDERING = (1e3, 1e4, 1e5, 1e6)
"""(N/rad)² per step: stiffnesses believed to change less than in the study."""

NEVER_STIFFER = 1.0
"""(N/rad)² per step: a stiffness that hardly moves."""

TUNED = (
    "A tuned filter loses by fading: the newest residual always weighs more than half, so chance alone inflates the "
    "covariance (docs/estimators/st_cdkf.md). It helps a filter whose process noise is stated too small."
)


def _fading(table: dict[str, Any]) -> None:
    """Compare the filter with and without fading over decades of process noise."""
    factor = {"parameter": "process_noise_scale", "of": "belief", "levels": list(LEVELS)}
    table["estimator"] = [e for e in table["estimator"] if e["name"] in (FADING, PLAIN)]
    table["design"] = [{"name": "process-noise", "repeats": REPEATS, "factor": [factor]}]
    for history in table["history"]:
        history["levels"] = {"process_noise_scale": 1.0}


def _held(table: dict[str, Any]) -> None:
    """Hold the stiffnesses where they begin."""
    table["estimator"] = [e for e in table["estimator"] if e["name"] == FADING]
    table["design"] = [{"name": "held", "repeats": REPEATS}]
    table["belief"]["noise"]["process"] |= dict.fromkeys(STIFFNESSES, NEVER_STIFFER)
    table.pop("history")


def fading(stored: Stored) -> StudyResults:
    """Return the study of fading over the process noise that the filter states."""
    return stored.small("fading", _fading, OF)


def _errors(design: Design, target: str, band: str, estimator: str) -> np.ndarray:
    t, b = [q.name for q in design.targets].index(target), design.bands.index(band)
    return design.rmse[t, b, design.estimators.index(estimator)]


def _wandering(variance: float) -> Callable[[dict[str, Any]], None]:
    """Return what states another process noise of the stiffnesses alone, in (N/rad)² per step."""

    def build(table: dict[str, Any]) -> None:
        table["estimator"] = [e for e in table["estimator"] if e["name"] in (FADING, PLAIN)]
        table["design"] = [{"name": "stiffness", "repeats": REPEATS}]
        table["belief"]["noise"]["process"] |= dict.fromkeys(STIFFNESSES, variance)
        table.pop("history")

    return build


def _compared(design: Design, target: str, band: str) -> list[Evidence]:
    """Return the error with fading over that without, on the runs that neither loses."""
    pair = [_errors(design, target, band, name) for name in (FADING, PLAIN)]
    value, n = ratio_of_medians(pair[0], pair[1])
    lost = [int(np.sum(~np.isfinite(errors))) for errors in pair]
    what = f"with fading : without; {lost[0]} and {lost[1]} of {pair[0].size} runs lost"
    return [Evidence(what, value, (0.0, HELPS), np.nan, n)]


def _helps(level: float, target: str) -> Record:
    def test(stored: Stored) -> list[Evidence]:
        return _compared(fading(stored).designs[0], target, f"×{level:g}")

    motion, stiffness = 1e-4 * level, style.number(1e7 * level, 1)
    quantity = (
        f"fading makes the {words(target)} more accurate: process noise {motion:g} (motion), {stiffness} (N/rad)² "
        "(stiffness)"
    )
    return Record("3, abstract", quantity, kind=Kind.STATEMENT, test=test, needs=HERE, reason=TUNED)


def _helps_slow(variance: float, target: str) -> Record:
    def test(stored: Stored) -> list[Evidence]:
        design = stored.small(f"stiffness-e{math.log10(variance):.0f}", _wandering(variance), OF).designs[0]
        return _compared(design, target, design.bands[0])

    quantity = (
        f"fading makes the {words(target)} more accurate: process noise 0.0001 (motion), {style.number(variance, 1)} "
        "(N/rad)² (stiffness)"
    )
    return Record("3, abstract", quantity, kind=Kind.STATEMENT, test=test, needs=HERE, reason=TUNED)


def _least_interval(_: Stored) -> list[Evidence]:
    """Return the least squared interval that our filter accepts."""
    accepted = []
    for squared in (0.5, 0.99, 1.0, 1.5, 3.0):
        try:
            accepted.append(st_cdkf.Settings.model_validate({"interval_squared": squared}).interval_squared)
        except ValueError:
            continue
    return [point("least of 0.5, 0.99, 1, 1.5 and 3 that is accepted", min(accepted), (1.0, 1.0), 1.0)]


def _lost(stored: Stored) -> list[Evidence]:
    """Count runs that diverge, over all levels."""
    status = fading(stored).designs[0].status
    names = fading(stored).designs[0].estimators
    lost = {name: int(np.sum(status[:, names.index(name)] == 1)) for name in (FADING, PLAIN)}
    total = status[:, 0].size
    what = f"runs lost with fading less those without ({lost[FADING]} and {lost[PLAIN]} of {total})"
    return [point(what, lost[FADING] - lost[PLAIN], (-np.inf, 0.0), n=total)]


def _relative(stored: Stored) -> dict[str, np.ndarray]:
    """Return RMSE over the root mean square of the truth about its mean, by signal and drive."""
    errors: dict[str, list[float]] = {}
    for history in fading(stored).histories:
        for signal in (*GOOD, POOR):
            truth = history["truth"].sel(target=signal).to_numpy()
            error = history["estimate"].sel(target=signal, estimator=FADING).to_numpy() - truth
            errors.setdefault(signal, []).append(float(np.sqrt(np.nanmean(error**2)) / np.nanstd(truth)))
    return {signal: np.array(values) for signal, values in errors.items()}


def _good(signal: str) -> Callable[[Stored], list[Evidence]]:
    def test(stored: Stored) -> list[Evidence]:
        errors = _relative(stored)
        names = [str(h.attrs["drive"]) for h in fading(stored).histories]
        return [
            point(f"{name}, relative error of the {words(signal)} over that of the sideslip", own / other, (0.0, 1.0))
            for name, own, other in zip(names, errors[signal], errors[POOR], strict=True)
        ]

    return test


def _falls(stored: Stored) -> list[Evidence]:
    """Compare the least estimated stiffness on a manoeuvre with the first."""
    evidence = []
    for history in fading(stored).histories:
        for axle in ("front", "rear"):
            estimate = history["estimate"].sel(target=f"cornering_stiffness_{axle}", estimator=FADING).to_numpy()
            what = f"{history.attrs['drive']}, least stiffness {axle} over the first"
            evidence.append(point(what, float(np.nanmin(estimate) / estimate[0]), (-np.inf, 0.9)))
    return evidence


def _parallel(stored: Stored) -> list[Evidence]:
    held = stored.small("stiffness-held", _held, OF).designs[0]
    design = fading(stored).designs[0]
    errors = [_errors(design, POOR, "×1", FADING), _errors(held, POOR, held.bands[0], FADING)]
    values = [median_interval(e) for e in errors]
    ratio = Interval(
        values[0].value / values[1].value, values[0].lower / values[1].upper, values[0].upper / values[1].lower
    )
    return [Evidence("sideslip, stiffnesses estimated : held", ratio, (0.0, 1.0), np.nan, errors[0].size)]


def _option(drive: str, name: str, unit: str) -> float:
    """Return an option of a drive of the study in the paper's unit."""
    options = next(d for d in load_study(STUDIES / f"{OF}.toml").drives if d.name == drive).options
    return float(registry().Quantity(str(options[name])).to(unit).magnitude)


def _manoeuvre(section: str, words_: str, drive: str, speed: str, angle: str) -> tuple[Record, Record]:
    return (
        setting(section, f"{words_}: first speed", speed, _option(drive, "speed", "km/h"), "km/h"),
        setting(section, f"{words_}: largest steering-wheel angle", angle, _option(drive, "amplitude", "deg"), "°"),
    )


UNITS = "The paper prints no unit; read in SI units it lets the yaw rate drift, so the study takes 10⁻⁴ (docs/cars.md)."


def records() -> tuple[Record, ...]:
    """Return what the document publishes."""
    belief = load_study(STUDIES / f"{OF}.toml").belief
    default = st_cdkf.Settings.model_validate({})
    motion = {"longitudinal_velocity": "m/s", "sideslip_angle": "rad", "yaw_rate": "rad/s"}
    return (
        statement("(12)", "the squared interval of the central differences is at least 1", _least_interval),
        setting("(21)", "forgetting factor σ", "0.95", default.forgetting),
        foreign("3", "first covariance of the five states", "1", reason="as in every study ours is the process noise"),
        *(
            setting(
                "3", f"process noise of the {words(name)}", "0.001", belief.process_noise[name], f"({unit})²", UNITS
            )
            for name, unit in motion.items()
        ),
        *(
            setting(
                "3",
                f"process noise of the stiffness, {axle} axle, in units of 10⁵ N/rad",
                "0.001",
                belief.process_noise[f"cornering_stiffness_{axle}"] / 1e10,
            )
            for axle in ("front", "rear")
        ),
        setting(
            "3", "variance of the measured acceleration R", "0.005", belief.measurement_noise["lateral_acceleration"]
        ),
        image("table 1", "the car's parameters and first stiffnesses", "the car here is that of Althoff 2020"),
        *_manoeuvre("3.1", "sine with dwell", "sine-with-dwell", "80", "270"),
        *_manoeuvre("3.2", "fishhook", "fishhook", "90", "240"),
        *_manoeuvre("4", "J-turn", "j-turn", "80", "200"),
        image("figures 2, 4, 7", "estimates of speed, sideslip and yaw rate on the three manoeuvres"),
        image("figures 3, 5, 8", "estimated stiffnesses on the three manoeuvres"),
        image("figure 6", "the test bench"),
        *(
            statement(
                "3.1, 3.2, 4", f"the {words(signal)} is estimated well, the sideslip with an offset", _good(signal)
            )
            for signal in GOOD
        ),
        statement("3.1, 3.2, 4", "the estimated stiffnesses fall as the tyres leave their linear range", _falls),
        *(_helps(level, target) for target in JUDGED for level in LEVELS),
        *(_helps_slow(variance, target) for target in JUDGED for variance in WANDERING),
        statement("5", "fading keeps the filter from diverging", _lost),
        statement("3.2, 5", "estimating the stiffnesses beside the motion makes the motion more accurate", _parallel),
        foreign("4", "the filter runs in real time on a DS1006", reason="time per step here: make study-realtime"),
    )
