"""How well the values of a parameter set are known: stated by file or set, a tenth elsewhere, and kept when written."""

import pytest

from harness.common.errors import UserError
from harness.config import resolve_single
from harness.config.parameter_set import set_from_file, set_text, stated_std

VALUES = """vehicle = "car"
tyre = "linear"
warning = "from a drive on ice"
[values]
mass = "1.6 t"
[std]
mass = "20 kg"
"""


def written(folder, text):
    """Return the model of a parameter file that states a few values of a published car anew."""
    spec = resolve_single(
        {"vehicle": "car", "parameters": "govindarajan_2018", "tyre": "linear", "sensors": "car_series"}, "test"
    )
    whole = set_text(spec, "test", {}).replace("[values]", '[std]\nmass = "20 kg"\n\n[values]', 1)
    (folder / "set.toml").write_text(whole)
    (folder / "few.toml").write_text(text)
    return resolve_single({"vehicle": "car", "parameters": str(folder / "set.toml"), "sensors": "car_series"}, "test")


def test_what_is_stated_counts_and_a_tenth_elsewhere(tmp_path):
    spec = written(tmp_path, VALUES)
    std = stated_std(spec)
    assert std["mass"] == 20.0
    assert std["yaw_inertia"] == pytest.approx(0.1 * spec.values["yaw_inertia"])
    reference = next(p for p in spec.model().parameters if p.name == "reference_from_cog")
    assert spec.values[reference.name] == 0.0
    assert std[reference.name] == pytest.approx(0.1 * max(abs(reference.lower), abs(reference.upper)))


def test_a_set_that_is_written_keeps_it_with_its_warning(tmp_path):
    text = set_text(written(tmp_path, VALUES), "a fit", {}, warning="the fit failed")
    (tmp_path / "again.toml").write_text(text)
    again = set_from_file("again.toml", tmp_path, "test")
    assert again.std == {"mass": 20.0}
    assert again.warning == "the fit failed"
    few = set_from_file("few.toml", tmp_path, "test")
    assert (few.std, few.warning) == ({"mass": 20.0}, "from a drive on ice")


@pytest.mark.parametrize(
    ("was", "now", "said"),
    [
        ('mass = "20 kg"', 'mass = "0 kg"', "std.mass: a standard deviation must be positive, got 0 kg"),
        ('mass = "20 kg"', 'mass = "20 m"', "std.mass"),
        ('mass = "20 kg"', 'mas = "20 kg"', "has no parameter 'mas' with any tyre or effect; closest: mass"),
    ],
)
def test_a_wrong_deviation_is_named(tmp_path, was, now, said):
    (tmp_path / "set.toml").write_text(VALUES.replace(was, now))
    with pytest.raises(UserError) as caught:
        set_from_file("set.toml", tmp_path, "test")
    assert said in str(caught.value)
