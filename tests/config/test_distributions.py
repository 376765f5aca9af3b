"""Distributions of factors: by moments, quantiles, ends and samples, in SI units, within the bounds of a parameter."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import stats

from harness.common.errors import UserError
from harness.common.files import parse_toml
from harness.config import build_study, load_study
from harness.config.self_contained import self_contained
from harness.study.design import points, saltelli_points, scrambled_points, unit_box
from support.small_study import STUDY

HEAD = STUDY.split("[[design]]")[0]
QUANTILES = 'quantiles = { "5 %" = "20 t", "95 %" = "26 t" }'
SHARES = np.array([0.05, 0.5, 0.95])


@pytest.fixture
def study_of(tmp_path):
    def _study(distribution, further="", unit="", samples=64, head=HEAD):
        design = (
            f'[[design]]\nname = "d"\nsamples = {samples}\n{further}\n[[design.factor]]\nparameter = "trailer_mass"\n'
        )
        path = tmp_path / "distributed.toml"
        path.write_text(head + design + f"{unit}\ndistribution = {distribution}\n")
        return load_study(path)

    return _study


@pytest.fixture
def factor_of(study_of):
    return lambda *arguments, **further: study_of(*arguments, **further).designs[0].factors[0]


def _log_spread(relative):
    return np.sqrt(np.log(1 + relative**2))


KNOWN = {
    '{ kind = "normal", mean = "22 t", std = "1 t" }': stats.norm(22e3, 1e3),
    '{ kind = "normal", std = "5 %" }': stats.norm(24e3, 1.2e3),  # about the nominal value
    f'{{ kind = "normal", {QUANTILES} }}': stats.norm(23e3, 3e3 / stats.norm.ppf(0.95)),
    '{ kind = "lognormal", std = "15 %" }': stats.lognorm(
        _log_spread(0.15), scale=24e3 * np.exp(-(_log_spread(0.15) ** 2) / 2)
    ),
    f'{{ kind = "lognormal", {QUANTILES} }}': stats.lognorm(
        np.log(26 / 20) / 2 / stats.norm.ppf(0.95), scale=np.sqrt(20e3 * 26e3)
    ),
    '{ kind = "truncated_normal", std = "5 t" }': stats.truncnorm(-4.6, 7.2, 24e3, 5e3),  # the bounds: 1 t, 60 t
    '{ kind = "triangular", range = ["18 t", "30 t"], mode = "21 t" }': stats.triang(0.25, 18e3, 12e3),
    '{ kind = "triangular", mean = "22 t", std = "1 t" }': stats.triang(0.5, 22e3 - 6e6**0.5, 2 * 6e6**0.5),
    '{ kind = "beta", range = ["18 t", "30 t"], mean = "22 t", std = "2 t" }': stats.beta(7 / 3, 14 / 3, 18e3, 12e3),
}


@pytest.mark.parametrize("distribution", KNOWN)
def test_quantiles_are_those_of_the_distribution(factor_of, distribution):
    marginal, law = factor_of(distribution).marginal, KNOWN[distribution]
    np.testing.assert_allclose(marginal.at(SHARES), law.ppf(SHARES), rtol=1e-9)
    assert marginal.below(23e3) == pytest.approx(law.cdf(23e3), rel=1e-9)


@pytest.mark.parametrize("kind", ["truncated_normal", "beta"])
def test_quantiles_between_two_ends_are_met(factor_of, kind):
    marginal = factor_of(f'{{ kind = "{kind}", {QUANTILES}, range = ["18 t", "40 t"] }}').marginal
    np.testing.assert_allclose(marginal.at(np.array([0.0, 0.05, 0.95, 1.0])), [18e3, 20e3, 26e3, 40e3], rtol=1e-6)


@pytest.mark.parametrize("kind", ["triangular", "uniform", "log_uniform"])
def test_quantiles_of_bounded_distributions_are_met(factor_of, kind):
    factor = factor_of(f'{{ kind = "{kind}", {QUANTILES} }}')
    low, high = factor.lower[0], factor.upper[0]
    law = {"triangular": stats.triang(0.5, low, high - low), "uniform": stats.uniform(low, high - low)}
    np.testing.assert_allclose(law.get(kind, stats.loguniform(low, high)).ppf([0.05, 0.95]), [20e3, 26e3], rtol=1e-9)


def test_uniform_is_a_band(study_of, tmp_path):
    stated = study_of('{ kind = "log_uniform", range = ["20 t", "26 t"] }')
    banded = HEAD + '[[design]]\nname = "d"\nsamples = 64\n[[design.factor]]\nparameter = "trailer_mass"\n'
    (tmp_path / "band.toml").write_text(banded + 'range = ["20 t", "26 t"]\nscale = "log"\n')
    assert load_study(tmp_path / "band.toml").hash == stated.hash


def test_a_sample_is_read_in_the_unit_of_the_factor(study_of, tmp_path):
    (tmp_path / "fleet.csv").write_text("name; mass\nred; 20.5\nblue; 31\n\nold; 20.5\ngreen; 28\n")
    study = study_of('{ kind = "empirical", file = "fleet.csv", column = "mass" }', unit='unit = "t"')
    values, counts = np.unique(points(study, study.designs[0]).values, return_counts=True)
    assert dict(zip(values.tolist(), counts.tolist(), strict=True)) == {20.5e3: 32, 28e3: 16, 31e3: 16}
    text = self_contained(study)
    (tmp_path / "fleet.csv").unlink()
    again = build_study(parse_toml(text, "again"), tmp_path / "elsewhere" / "again.toml")
    assert again.hash == study.hash


def test_a_discrete_factor_takes_its_values_as_often_as_stated(study_of):
    study = study_of('{ kind = "discrete", values = ["24 t", "8 t"], weights = [3, 1] }')
    values, counts = np.unique(points(study, study.designs[0]).values, return_counts=True)
    assert values.tolist() == [8e3, 24e3]
    assert counts.tolist() == [16, 48]


def test_the_deviation_is_that_of_the_parameter_set(study_of, tmp_path):
    own = load_study(_written(tmp_path, "plain.toml", STUDY)).plant
    numbers = "\n".join(f"{name} = {value!r}" for name, value in own.values.items())
    content = f'vehicle = "semitrailer"\ntyre = "magic_formula"\n[values]\n{numbers}\n[std]\ntrailer_mass = "700 kg"\n'
    noise = "\n".join(f"{name} = {value!r}" for name, value in own.process_noise.items())
    outputs = "\n".join(f"{name} = {value!r}" for name, value in own.measurement_noise.items())
    _written(tmp_path, "own.toml", f"{content}[process_noise]\n{noise}\nsteering_wheel_angle = 1e-6\n"
             f"steering_wheel_rate = 1e-6\n[measurement_noise]\n{outputs}\n")  # fmt: skip
    study = study_of('"normal"', head=HEAD.replace('"ziaukas_2023"', f'"{tmp_path}/own.toml"'))
    assert study.designs[0].factors[0].marginal.arguments == (24e3, 700.0)
    text = self_contained(study)
    (tmp_path / "own.toml").unlink()
    again = build_study(parse_toml(text, "again"), tmp_path / "elsewhere" / "again.toml")
    assert again.hash == study.hash


def _written(folder, name, text):
    (folder / name).write_text(text)
    return folder / name


def test_points_go_through_the_inverse_distribution_function(study_of):
    normal, beta = (stats.norm(24e3, 1e3).ppf, stats.beta(7 / 3, 14 / 3, 18e3, 12e3).ppf)
    stated = '{ kind = "beta", range = ["18 t", "30 t"], mean = "22 t", std = "2 t" }'

    def values(*arguments):
        study = study_of(*arguments)
        return points(study, study.designs[0]).values

    np.testing.assert_allclose(values(stated)[0], beta(unit_box(64, 1)), rtol=1e-9)
    one_t = '{ kind = "normal", std = "1 t" }'
    np.testing.assert_allclose(values(one_t)[0], normal(scrambled_points(64, 1, 0)), rtol=1e-9)
    np.testing.assert_allclose(values(one_t, 'sampling = "saltelli"')[0], normal(saltelli_points(64, 1, 0)), rtol=1e-9)
    limited = HEAD.replace("[plant]", '[limits]\narticulation_angle = "1 deg"\n[plant]', 1)
    nested = study_of(one_t, 'sampling = "tolerance"\nboxes = 4', head=limited)
    table = points(nested, nested.designs[0]).values[:, :, 0]
    full = normal(scrambled_points(64, 1, 0))[:, 0]
    np.testing.assert_allclose(table[:, 3:] - 24e3, np.outer([0.25, 0.5, 0.75, 1.0], full - 24e3), atol=1e-6)
    np.testing.assert_allclose(table[3, 1:3], normal([0.001, 0.999]), rtol=1e-9)


def test_no_point_lies_at_infinity(factor_of):
    ends = factor_of('{ kind = "lognormal", std = "5 %" }').marginal.at(np.array([0.0, 1.0]))
    assert np.isfinite(ends).all()
    assert ends[0] > 0


def test_another_distribution_is_another_study(study_of):
    hashes = {study_of(f'{{ kind = "{kind}", std = "{std} kg" }}').hash
              for kind in ("normal", "lognormal") for std in (500, 600)}  # fmt: skip
    assert len(hashes) == 4


REFUSED = {
    '{ kind = "normal", std = "10 t" }': (
        ".distribution: the distribution reaches too far: trailer_mass lies below 1000 kg, the smallest value allowed, "
        'with a probability of 0.01; write kind = "truncated_normal", which ends at the bounds'
    ),
    '"normal"': "the parameter set has no [std] of 'trailer_mass'; state 'std', or 'quantiles'",
    '"gauss"': "got 'gauss'",
    '{ kind = "normal", std = "1 m" }': "distribution.std",
    '{ kind = "normal", std = "-1 t" }': "a standard deviation is positive; got '-1 t'",
    '{ kind = "normal", std = "1 t", mode = "2 t" }': "is stated by mean, std and quantiles; remove 'mode'",
    f'{{ kind = "normal", std = "1 t", {QUANTILES} }}': "remove one of both",
    '{ kind = "normal", quantiles = { "5 %" = "26 t", "95 %" = "20 t" } }': "each larger than the one before",
    '{ kind = "normal", quantiles = { "5 %" = "26 t" } }': "quantiles: has 1; give at least 2",
    '{ kind = "beta", std = "1 t" }': "a beta distribution needs 'range'",
    '{ kind = "beta", std = "9 t", range = ["18 t", "30 t"] }': "no beta distribution on that range has mean 24000",
    f'{{ kind = "beta", {QUANTILES}, range = ["21 t", "30 t"] }}': "no beta distribution from 21000 to 30000",
    '{ kind = "triangular", range = ["18 t", "30 t"], mode = "31 t" }': "the likeliest value lies outside of 'range'",
    '{ kind = "log_uniform", range = ["-18 t", "30 t"] }': "a logarithm needs values above zero",
    '{ kind = "discrete", values = ["18 t", "18 t"] }': "all values are 18000; a distribution needs at least two",
    '{ kind = "discrete", values = ["18 t", "20 t"], weights = [1] }': "1 weights for 2 values; give one each",
    '{ kind = "discrete", values = ["18 t", "90 t"] }': "lies above 60000 kg, the largest value allowed, with a "
    "probability of 0.5; keep within the bounds",
    '{ kind = "empirical" }': "needs either 'file' or 'values'",
    '{ kind = "empirical", file = "none.csv" }': "distribution.file: there is no file 'none.csv'",
    '{ kind = "empirical", file = "fleet.csv", column = "mas" }': "has no column 'mas'; closest: mass",
    '{ kind = "empirical", file = "fleet.csv", column = "mass" }': "line 3, column 'mass': '24_000' is no number",
}


@pytest.mark.parametrize("distribution", REFUSED)
def test_what_is_no_distribution_is_refused_in_a_line(study_of, tmp_path, distribution):
    (tmp_path / "fleet.csv").write_text("name,mass\nred,20500\nblue,24_000\n")
    with pytest.raises(UserError) as refused:
        study_of(distribution)
    assert REFUSED[distribution] in str(refused.value)
    assert "design[0].factor[0].distribution" in str(refused.value) or "fleet.csv" in str(refused.value)
    assert "\n" not in str(refused.value)


def test_a_distribution_has_no_scale_and_no_band(study_of):
    for key in ('scale = "log"', 'band = "1 t"'):
        with pytest.raises(UserError, match=f"factor\\[0\\].{key.split()[0]}: "):
            study_of('{ kind = "normal", std = "1 t" }', unit=key)
