"""Names of scores with their meanings, and the codes of the status of a run."""

from __future__ import annotations

OK, ESTIMATOR_DIVERGED, PLANT_DIVERGED, LOST, PENDING = 0, 1, 2, 3, -1
FLAGS = {
    "ok": OK, "estimator_diverged": ESTIMATOR_DIVERGED, "plant_diverged": PLANT_DIVERGED, "lost": LOST,
    "pending": PENDING,
}  # fmt: skip
"""Codes of the status by the word that stores and tables have for them."""

FATES = {
    OK: "ok", ESTIMATOR_DIVERGED: "estimator diverged", PLANT_DIVERGED: "vehicle out of control",
    LOST: "lost by the code of the plant", PENDING: "pending",
}  # fmt: skip
"""What they mean, in words."""

STATUS = "status"
OVER_TIME = "rmse_over_time"
PER_TARGET = ("rmse", "bias", "max_error")
PER_RUN = (
    "nees", "nis", "nees_inside", "nis_inside", "log_likelihood", "repairs", "updates", "time_of_divergence"
)  # fmt: skip
LOST_CONTROL = "loss_of_control"
NORMAL_SCORE = "normal_score"
"""How the names of the normal scores of a population's factors begin."""

MEANINGS = {
    "rmse": "root mean square error",
    "bias": "mean error, estimate minus truth",
    "max_error": "largest error",
    "nees": "normalised estimation error squared, average over the run",
    "nis": "normalised innovation squared, average over the run",
    "nees_inside": "share of samples with the NEES inside its 95 % region",
    "nis_inside": "share of samples with the NIS inside its 95 % region",
    "log_likelihood": "log-likelihood of the measurements",
    "repairs": "samples at which a covariance factor was repaired",
    "updates": "samples with a measurement",
    "time_of_divergence": "time at which estimator or plant left its range of validity, or a score was no number",
    LOST_CONTROL: "time at which the vehicle slid more sideways than it rolled or left the range of its equations",
    OVER_TIME: "root mean square error in a window of time",
    STATUS: ", ".join(f"{code} {fate}" for code, fate in FATES.items()),
}
