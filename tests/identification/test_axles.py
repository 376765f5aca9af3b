"""What follows for the axles from a fit: values, and standard errors by the delta method."""

import math
from dataclasses import replace

import numpy as np
import pytest

from harness.config.derived import axle_values
from harness.config.model import resolve_single
from harness.identification.axles import axle_comparison, axle_estimates, axle_sheet
from harness.identification.contract import Estimate, Fit

TABLE = {"vehicle": "car", "parameters": "govindarajan_2018", "tyre": "magic_formula", "sensors": "car_series"}
SPEC = resolve_single(TABLE, "here")


def fit(errors=(0.02, 0.01), correlation=0.6):
    names = ("stiffness_peak_front", "stiffness_peak_rear")
    estimates = [Estimate(n, "N/rad", 1.1 * SPEC.values[n], SPEC.values[n], s * SPEC.values[n])
                 for n, s in zip(names, errors, strict=True)]  # fmt: skip
    matrix = np.array([[1.0, correlation], [correlation, 1.0]])
    return Fit("m", SPEC, tuple(estimates), matrix, "o", 0.0, 0.0, (), True)


def test_standard_errors_follow_from_those_of_the_parameters():
    front, rear, gradient = axle_estimates(fit())
    assert front.start == pytest.approx(1.1 * front.value)
    assert front.error == pytest.approx(0.02 * front.value, rel=1e-3)
    assert rear.error == pytest.approx(0.01 * rear.value, rel=1e-3)
    # EG = m (l_r / C_f - l_f / C_r) / l: relative errors of two terms whose difference it is, correlated
    m, l_f, l_r = (SPEC.values[n] for n in ("mass", "cog_to_front_axle", "cog_to_rear_axle"))
    a, b = m * l_r / (l_f + l_r) / front.value * 0.02, m * l_f / (l_f + l_r) / rear.value * 0.01
    assert gradient.error == pytest.approx(math.sqrt(a**2 + b**2 - 2 * 0.6 * a * b), rel=1e-3)


def test_what_the_recordings_say_nothing_about_stays_unknown():
    front, rear, gradient = axle_estimates(fit(errors=(math.inf, 0.01)))
    assert math.isinf(front.error)
    assert math.isfinite(rear.error)
    assert math.isinf(gradient.error)


def test_tables_stand_beside_the_parameters_in_report_units():
    (sheet,) = axle_sheet(fit())
    assert sheet.rows[0][:2] == ["axle stiffness front", "kN/rad"]
    assert sheet.rows[0][3] == "153"
    softer = replace(SPEC, values=SPEC.values | {"stiffness_peak_rear": 2e5})
    (sheet,) = axle_comparison({"stated": SPEC, "amended": softer})
    assert len(sheet.rows) == len(axle_values(SPEC))
    assert sheet.rows[1][2] != sheet.rows[1][3]
    without = resolve_single({"vehicle": "car_3dof", "parameters": "li_2017", "sensors": "car_lateral"}, "here")
    assert axle_comparison({"stated": without}) == []
