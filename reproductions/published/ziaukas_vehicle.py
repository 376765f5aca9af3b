"""Ziaukas 2023, chapter 6: the measured truck, which nobody else has, and the time of a step."""

from __future__ import annotations

import numpy as np

from harness.common.statistics import Interval
from harness.models.parameters import ziaukas_2023
from harness.realtime.outcome import PACES, PUBLISHED
from reproductions.campaign.claims import EKF, NETWORK, UKF
from reproductions.campaign.evidence import Evidence
from reproductions.published import ziaukas_evidence as evidence
from reproductions.published.record import Record, between, foreign, image, measured, point, setting, statement
from reproductions.published.results import Stored

TITLE = "Ziaukas 2023, chapter 6: the measured truck"
NOTE = (
    "Chapter 6 rests on measured drives of the author's truck, which are not published: its errors cannot be compared. "
    "Only the time of a step can, as a ratio."
)

REALTIME = "realtime"
KINDS = {EKF: "ekf", UKF: "ukf", NETWORK: "narx"}
PROCESSORS = "Ratios depend on processor and code: here all are compiled from the same equations (docs/realtime.md)."

TRACK = (
    ("drives", "11", ""),
    ("shortest and longest drive", "65 and 260", "s"),
    ("median error of the force, filters", "2.39", "kN"),
    ("median error of the force, network", "1.86", "kN"),
    ("largest error of the force, network", "2.96", "kN"),
    ("least error of the force, network less filters", "−0.4", "kN"),
    ("median error of the angle, UKF", "1.41", "°"),
    ("median error of the angle, EKF", "1.72", "°"),
    ("least error of the angle, network", "0.5", "°"),
    ("largest error of the angle, network", "3.22", "°"),
    ("median error of the angle, network", "1.31", "°"),
)
SLALOM = (
    ("largest steering-wheel angle", "720", "°"),
    ("speed", "2", "m/s"),
    ("largest articulation angle", "60", "°"),
    ("largest force", "40", "kN"),
)
ROAD = (
    ("parts of drives", "86", ""),
    ("median error of the force, network", "1.83", "kN"),
    ("median error of the force, filters", "1.94", "kN"),
    ("largest error of the force, network", "7.01", "kN"),
    ("largest error of the force, filters", "7.81", "kN"),
    ("median error of the angle, network", "0.68", "°"),
    ("median error of the angle, filters", "0.89", "°"),
    ("largest error of the angle, EKF", "4.3", "°"),
    ("largest error of the angle, UKF", "3.83", "°"),
    ("largest error of the angle, network", "2.78", "°"),
    ("least error of the angle, all", "0.3", "°"),
)
ROUNDABOUT = (
    ("error of the angle, filters", "1.17", "°"),
    ("error of the force, filters", "1.67", "kN"),
    ("error of the angle, network", "0.42", "°"),
    ("error of the force, network", "1.25", "kN"),
    ("duration", "18", "s"),
)
TURNING = (
    ("largest articulation angle", "60", "°"),
    ("largest force", "40", "kN"),
    ("error of the force, filters", "7.56", "kN"),
    ("error of the force, network", "3.95", "kN"),
)


def _load(name: str) -> Record:
    """Return the load of the 10 ms cycle as a ratio to that of the EKF; the EKF's own depends on the processor."""
    theirs = PUBLISHED[KINDS[name]]
    if name == EKF:
        return foreign("Bild 6.9", f"mean load of a cycle of 10 ms, {name}", f"{theirs}", "%", "of their processor")

    def test(stored: Stored) -> list[Evidence]:
        times = stored.times
        value = Interval(*map(float, times["ratio"].sel(pace=PACES[0], estimator=name).values))
        ratio = theirs / PUBLISHED["ekf"]
        return [Evidence("time of a step over that of the EKF", value, between(ratio), ratio, times.sizes["time"])]

    quantity = f"mean load of a cycle of 10 ms, {name} ({theirs / PUBLISHED['ekf']:.2f} of the EKF)"
    return Record("Bild 6.9", quantity, f"{theirs}", "%", test=test, needs=REALTIME, reason=PROCESSORS)


def _over_network(stored: Stored) -> list[Evidence]:
    """Compare the UKF with the network; the interval takes the ends of both."""
    ratios = stored.times["ratio"].sel(pace=PACES[0])
    own, network = (ratios.sel(estimator=name).values.astype(float) for name in (UKF, NETWORK))
    value = Interval(own[0] / network[0], own[1] / network[2], own[2] / network[1])
    return [Evidence("UKF over network, time of a step", value, between(8.0), 8.0, stored.times.sizes["time"])]


def _network_is_half(stored: Stored) -> list[Evidence]:
    value = Interval(*map(float, stored.times["ratio"].sel(pace=PACES[0], estimator=NETWORK).values))
    return [Evidence("network over EKF, time of a step", value, (0.0, 0.5), 0.67 / 1.65, stored.times.sizes["time"])]


def _in_time(stored: Stored) -> list[Evidence]:
    times = stored.times
    cycle = float(times.attrs["cycle"])
    return [
        point(
            f"{name}: median step over the cycle",
            float(np.median(times["step_time"].sel(estimator=name)) / cycle),
            (0.0, 1.0),
        )
        for name in KINDS
    ]


def records() -> tuple[Record, ...]:
    """Return what the chapter publishes."""
    noise = ziaukas_2023.MEASUREMENT_NOISE["yaw_rate_trailer"]
    where = "the measured drives are not published"
    tables = (
        ("Bild 6.3", TRACK),
        ("Bild 6.4", SLALOM),
        ("Bild 6.6", ROAD),
        ("Bild 6.7", ROUNDABOUT),
        ("Bild 6.8", TURNING),
    )
    return (
        setting("(6.1)", "variance of the measured yaw rate", "1e-4", noise),
        foreign("(6.2), (6.3)", "process noise and UKF as in (5.3) and (5.5)", reason="see there"),
        measured("6.2", "NRMSE falls by from one to two neurons per layer", "75", "%", where),
        measured("6.2", "NRMSE from four neurons per layer on, below", "0.03", "", where),
        measured("6.2, Bild 6.2", "best network: layers of neurons", "8 of 4", "", where),
        *(measured(place, what, theirs, unit, where) for place, table in tables for what, theirs, unit in table),
        image("Bild 6.1 to 6.8", "Lipschitz indices, networks, errors, drives over time"),
        *evidence.findings("6.3.3"),
        *(_load(name) for name in KINDS),
        Record("6.3.3", "UKF over network, about", "8", "", test=_over_network, needs=REALTIME, reason=PROCESSORS),
        statement(
            "6.4",
            "the network takes less than half the time of the EKF",
            _network_is_half,
            REALTIME,
            PROCESSORS,
        ),
        statement("6.3.3", "all three keep the cycle of 10 ms", _in_time, REALTIME),
        foreign("6.3.3", "peaks of the UKF's load, just above", "55", "%", "of their operating system"),
        foreign("6.3.3", "the drive does not matter for the time of a step", reason="one drive is timed"),
        image("Bild 6.9", "load over the drive"),
    )
