"""The report's section on where a drive tells the estimators something."""

from types import SimpleNamespace

import numpy as np
import pytest
import xarray as xr

from harness.reporting.document import Prose, Sheet
from harness.study.report.sections import certainty


def run(std_of_friction, acceleration="lateral_acceleration", stated=True):
    """Return a run that is calm for 20 s and then drives at 5 m/s^2."""
    time = np.arange(0, 40, 0.01)
    a = np.where(time < 20, 0.5, 5.0) * np.sin(2 * np.pi * time)
    std = np.stack([std_of_friction(time), np.full(len(time), 0.01), np.full(len(time), 0.2)], axis=-1)[:, None]
    values = np.stack([np.full(len(time), 0.9), np.zeros(len(time)), a], axis=-1)
    targets = ["friction_coefficient", "lateral_velocity", acceleration]
    return xr.Dataset(
        {
            "truth": (("time", "target"), values),
            "estimate": (("time", "estimator", "target"), values[:, None]),
            "std": (("time", "estimator", "target"), std if stated else np.full_like(std, np.nan)),
        },
        coords={"time": time, "estimator": ["PF"], "target": targets},
        attrs={"name": "from calm to lively", "band_label": "0.9", "drive": "sine"},
    )


def blocks(*runs):
    return certainty.blocks(SimpleNamespace(store=SimpleNamespace(histories=list(runs))))


def test_says_where_friction_shows():
    prose, sheet = blocks(run(lambda t: np.where(t < 20, 0.3, 0.02)))
    assert isinstance(prose, Prose)
    assert isinstance(sheet, Sheet)
    assert "friction coefficient shows in the measurements at 4 to 6 m/s²" in prose.markup
    assert "0.300 at 0 to 1 m/s² and 0.0200 at 4 to 6 m/s²" in prose.markup
    assert "lateral velocity is known about equally well" in prose.markup
    assert sheet.header == ["target", "estimator", "0 to 1 m/s²", "4 to 6 m/s²"]
    assert [r[2:] for r in sheet.rows] == [["0.300", "0.0200"], ["0.0100", "0.0100"]]


def test_a_quantity_that_never_shows():
    prose, _ = blocks(run(lambda t: np.full(len(t), 0.3)))
    assert "friction coefficient is known about equally well" in prose.markup


def test_a_zero_crossing_is_not_a_calm_moment():
    number, name = certainty.classes(run(lambda t: 0.3 + 0 * t))
    assert name == "lateral_acceleration"
    assert set(number[2500:]) == {4}
    assert set(number[:2000]) == {0}


@pytest.mark.parametrize(
    "other",
    [
        lambda: run(lambda t: 0.3 + 0 * t, acceleration="yaw_rate"),
        lambda: run(lambda t: 0.3 + 0 * t, stated=False),
        lambda: run(lambda t: 0.3 + 0 * t).isel(time=slice(0, 1500)),
    ],
)
def test_nothing_is_said_without_acceleration_uncertainty_or_change(other):
    assert blocks(other()) == []


def test_tractor_and_car_are_both_accelerations():
    assert blocks(run(lambda t: np.where(t < 20, 0.3, 0.02), acceleration="lateral_acceleration_tractor"))
