"""``harness identify`` on recordings that no filter makes sense of: what is wrong is said, and nothing is invented."""

import json
import re

import numpy as np
import pandas as pd
import pytest
from typer.testing import CliRunner

from harness.cli.main import app
from harness.recordings.read.write import write_recording
from support.identification import CAR, model_of, recorded

LINE = ["identify", "--model", "car_reference_point", "--parameters", "sun_2015", "--sensors", "car_reference",
        "--free", "stiffness_over_load_front", "--setting", "annealings=0", "--setting", "profiles=false"]  # fmt: skip


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    folder = tmp_path_factory.mktemp("drives")
    for seed, name in ((1, "first"), (2, "second")):
        write_recording(recorded(model_of(CAR), seed, duration=6.0, speed=15.0, amplitude=0.5), folder / f"{name}.csv")
    return folder


def identified(folder, out, change):
    """Return exit status, what was said, and the estimates after something happened to a recording."""
    table = pd.read_csv(folder / "first.csv")
    change(table)
    table.to_csv(out / "odd.csv", index=False)
    done = CliRunner().invoke(app, [*LINE, "--data", str(out / "odd.csv"), "--test", str(folder / "second.csv"),
                                    "--out", str(out / "out")])  # fmt: skip
    assert done.exception is None or isinstance(done.exception, SystemExit), done.exception
    file = out / "out" / "identify.json"
    estimates = {e["name"]: e for e in json.loads(file.read_text())["estimates"]} if file.exists() else {}
    return done.exit_code, " ".join(done.output.split()), estimates


@pytest.mark.parametrize("signal", ["steering_wheel_angle", "yaw_rate"])
def test_a_million_is_a_divergence_with_its_likely_causes(folder, tmp_path, signal):
    def spike(table):
        table.loc[300, signal] = 1e6

    status, said, found = identified(folder, tmp_path, spike)
    assert (status, found) == (2, {})
    assert "the filter diverges on these recordings at the initial values; check units, signs and spikes" in said


def test_bursts_of_missing_samples_leave_the_rest(folder, tmp_path):
    def bursts(table):
        for first in range(0, len(table), 50):
            table.loc[first : first + 35, "yaw_rate"] = np.nan

    status, said, found = identified(folder, tmp_path, bursts)
    assert status == 0
    assert "yaw_rate: gaps longer than 0.05 s: 11" in said
    low, high = found["stiffness_over_load_front"]["interval_95"]
    assert low < 8.36 < high


def test_a_drive_in_reverse_is_said_and_its_fit_refused(folder, tmp_path):
    def reverse(table):
        table["speed"] = -5.0

    status, said, _ = identified(folder, tmp_path, reverse)
    assert status == 0
    assert "the vehicle drives backwards at 100 % of the samples" in said
    assert "The fit failed: with it the simulation error of the drives that were kept aside is" in said


def test_a_sensor_that_gave_nothing_is_named(folder, tmp_path):
    def dropped(table):
        table["yaw_rate"] = np.nan

    status, said, found = identified(folder, tmp_path, dropped)
    assert (status, found) == (2, {})
    assert "yaw_rate: channel 'yaw_rate'" in said
    assert "holds no number" in said


def _gaps(table):
    for first in range(0, len(table), 50):
        table.loc[first : first + 35, "yaw_rate"] = np.nan


WHOLE = {
    "bursts of missing samples": (_gaps, 0, "The model|missing"),
    "a sensor that gives nothing": (lambda t: t.__setitem__("yaw_rate", np.nan), 2, "holds no number"),
    "a measurement of a million": (lambda t: t.__setitem__("yaw_rate", t.yaw_rate.where(t.index != 300, 1e6)), 0,
                                   "single-sample spikes: 1"),
    "a locked steering wheel": (lambda t: t.__setitem__("steering_wheel_angle", 8.0), 0,
                                "Something is missing that no effect of the library explains"),
    "standstill": (lambda t: t.__setitem__("speed", 0.0), 2, "too little excitation"),
    "reverse": (lambda t: t.__setitem__("speed", -5.0), 0,
                "Something is missing that no effect of the library explains"),
}  # fmt: skip
"""What happens to a recording, the exit status of a trace of it, and what is said."""


@pytest.fixture(scope="module")
def longer(tmp_path_factory):
    """Drives that are long enough for a trace."""
    folder = tmp_path_factory.mktemp("longer")
    for seed, name in ((1, "first"), (2, "second")):
        write_recording(recorded(model_of(CAR), seed, duration=24.0, speed=15.0, amplitude=0.5), folder / f"{name}.csv")
    return folder


@pytest.mark.proof
@pytest.mark.parametrize("what", WHOLE)
def test_a_whole_trace_says_in_words_what_it_cannot_explain(longer, tmp_path, what):
    change, status, said = WHOLE[what]
    table = pd.read_csv(longer / "first.csv")
    change(table)
    table.to_csv(tmp_path / "odd.csv", index=False)
    words = [
        "trace",
        *LINE[1:7],
        "--train",
        tmp_path / "odd.csv",
        "--test",
        longer / "second.csv",
        "--estimator",
        "ekf",
    ]
    done = CliRunner().invoke(app, [str(w) for w in [*words, "--out", tmp_path / "out"]])
    assert done.exception is None or isinstance(done.exception, SystemExit), done.exception
    printed = " ".join(done.output.split())
    assert done.exit_code == status, printed
    assert re.search(said, printed)
    assert "Warning" not in printed
    assert "Traceback" not in printed
