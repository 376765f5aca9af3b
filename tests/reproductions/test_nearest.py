"""The nearest point: the set and the drives that the project comes with are what the box makes of its factors."""

from __future__ import annotations

import tomllib
from pathlib import Path

import numpy as np
import pytest

from harness.config import build_study, resolve_single
from harness.simulation.drives import profile_of
from reproductions.box import studies
from reproductions.box.factors import FACTORS, as_printed
from reproductions.box.plausibility import plausibility
from reproductions.campaign import box

ROOT = Path(__file__).parents[2]
SET, DRIVES = "ziaukas_2023_nearest", "nearest"


@pytest.fixture(scope="module")
def at():
    return box.committed().nearest.at


@pytest.fixture(scope="module")
def of_the_set():
    """Return a study of a user with the set and the drives: that of the ideal case, two lines changed."""
    path = ROOT / "studies" / "ideal.toml"
    table = tomllib.loads(path.read_text(encoding="utf-8")) | {"drives": DRIVES}
    del table["history"]  # of a drive that is not there
    table["plant"] |= {"parameters": SET}
    return build_study(table, path)


def test_the_point_lies_in_the_box_and_has_its_printed_values(at):
    assert list(at) == [f.name for f in FACTORS]
    assert as_printed(at) == at
    assert all(f.lower <= at[f.name] <= f.upper for f in FACTORS)
    assert plausibility(at).plausible


def test_the_set_is_what_the_box_makes_of_the_factors(at, of_the_set):
    point = studies.study_at(at)
    assert of_the_set.plant.values == pytest.approx(point.plant.values, rel=1e-9)
    assert of_the_set.belief.process_noise == pytest.approx(point.belief.process_noise, rel=1e-9)
    for side in ("plant", "belief"):
        ours, theirs = getattr(of_the_set, side), getattr(point, side)
        assert ours.measurement_noise == pytest.approx(theirs.measurement_noise, rel=1e-9)
        assert (ours.vehicle, ours.tyre, ours.sensors) == (theirs.vehicle, theirs.tyre, theirs.sensors)
        assert (ours.integrator, ours.substeps, ours.step) == (theirs.integrator, theirs.substeps, theirs.step)


def test_the_drives_are_what_the_box_makes_of_the_factors(at, of_the_set):
    point = studies.study_at(at)
    assert [d.name for d in of_the_set.drives] == [d.name for d in point.drives]
    spec = resolve_single(
        {"vehicle": "semitrailer", "parameters": SET, "tyre": "magic_formula", "sensors": "series"}, ""
    )
    for ours, theirs in zip(of_the_set.drives, point.drives, strict=True):
        one, other = profile_of(spec, ours), profile_of(spec, theirs)
        for name in ("steering_wheel_angle", "speed"):
            np.testing.assert_allclose(getattr(one, name), getattr(other, name), rtol=1e-9, atol=1e-12)
