"""Recordings of clocks that differ: brought to one step where they nearly agree, else refused with the remedy."""

import json

import numpy as np
import pytest
import xarray as xr

import harness as h
from harness.common.errors import UserError
from harness.identification.common_step import at_common_step
from harness.identification.data import step_of
from harness.identification.innovations import Innovations
from harness.recordings import load_recording, measurements
from support.identification import CAR, model_of, recorded


def recording(path, step, dropped=slice(0, 0)):
    """Return a yaw rate of a sine with white noise of 0.01 rad/s, of which samples are missing."""
    time = np.round(np.arange(0.0, 60.0, step), 9)
    rate = 0.3 * np.sin(2.0 * time) + 0.01 * np.random.default_rng(1).standard_normal(len(time))
    rate[dropped] = np.nan
    columns = np.column_stack([time, rate, 15.0 + 0.0 * time])
    np.savetxt(path, columns, delimiter=",", header="time,yaw_rate,speed", comments="", fmt="%.9g")
    return load_recording(path)


def test_a_clock_that_is_off_by_little_is_brought_to_the_step_of_most(tmp_path):
    slow = recording(tmp_path / "slow.csv", 0.00998, slice(2000, 2002))
    others = [recording(tmp_path / f"{i}.csv", 0.01) for i in range(2)]
    again, *same = at_common_step([slow, *others])
    assert [a is b for a, b in zip(same, others, strict=True)] == [True, True]
    assert step_of(again) == 0.01
    time, rate = again["time"].to_numpy(), again["yaw_rate"].to_numpy()
    error = rate - 0.3 * np.sin(2.0 * time)
    assert np.std(error) == pytest.approx(0.01, rel=0.05)  # white noise keeps its variance,
    assert abs(np.corrcoef(error[1:], error[:-1])[0, 1]) < 0.05  # and stays white
    assert np.isnan(measurements(again, ["yaw_rate"])).sum() in (1, 2)  # what was missing is not taken as measured
    assert again.attrs["warnings"][-1] == "brought from a step of 9.98 ms to that of the others, 10 ms"
    assert json.loads(again.attrs["origin"])["resampled"] == 0.01


def test_recordings_of_the_same_step_or_of_others_by_far_stay_as_they_are(tmp_path):
    fine, coarse = recording(tmp_path / "fine.csv", 0.01), recording(tmp_path / "coarse.csv", 0.02)
    assert [a is b for a, b in zip(at_common_step([fine, coarse]), (fine, coarse), strict=True)] == [True, True]
    spec = model_of(CAR)
    run = recorded(spec, 1, duration=6.0, speed=15.0, amplitude=0.5)
    twice = run.isel(time=slice(None, None, 2))
    with pytest.raises(UserError, match=r'all recordings need the same step: state \[recording\] step = "20 ms"'):
        Innovations(spec, jobs=1).drive(twice, "twice")


def test_a_fit_takes_a_recording_whose_clock_is_off():
    car = h.model(**CAR, integrator="rk4")
    first, second = (h.simulate(car, h.drive("sine", duration="10 s", amplitude="20 deg"), seed=i) for i in (1, 2))
    off = second.interp(time=np.arange(0.0, 9.9, 0.00998))
    assert isinstance(off, xr.Dataset)
    fit = h.identify(car, [first, off], ["mass_over_inertia"], settings={"profiles": False, "annealings": 0})
    assert any("brought from a step of 9.98 ms" in note for note in fit.notes)
    assert fit.estimates.loc["mass_over_inertia", "verdict"] == "determined"
