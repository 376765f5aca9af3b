"""The report's sections on a population, on scores whose shares are known in closed form."""

from __future__ import annotations

import json
from types import SimpleNamespace

import numpy as np
import pytest
import zarr
from scipy.special import ndtr, ndtri

from harness.study.exceedance import between_share, mixture_quantile
from harness.study.report import analyse, write_report
from harness.study.report.overall import Standing
from harness.study.report.sections import exceedance, shares
from support import synthetic
from support.joint_study import population_of, population_scores


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    path = tmp_path_factory.mktemp("fleet")
    study = population_of(path)
    synthetic.write(path / "out", population_scores(study))
    root = zarr.open_group(path / "out" / "scores.zarr", mode="r+")
    root.attrs["limits"] = json.dumps(study.limits)
    root.attrs["groups"] = json.dumps({d.name: d.groups for d in study.designs})
    return path / "out"


@pytest.fixture(scope="module")
def analysis(folder):
    return analyse(folder)


def words(blocks):
    return " ".join(str(vars(block)) for block in blocks)


def test_shares_are_those_of_the_linear_model(analysis):
    population = analysis.findings[0].population
    assert list(population.groups) == ["noise", "trailer mass", "friction"]
    own = population.shares[1][0]
    # two factors alike with correlation 0.5: each alone gives (1 + 0.5)^2 / 3 of the variance, together all
    np.testing.assert_allclose([s.value for s in own.shapley], [0.0, 0.5, 0.5], atol=0.02)
    np.testing.assert_allclose([s.value for s in own.first], [0.0, 0.75, 0.75], atol=0.03)
    np.testing.assert_allclose([s.value for s in own.total], [0.0, 0.25, 0.25], atol=0.03)
    assert own.explained.value == pytest.approx(1.0, abs=0.01)


def test_words_give_the_shares_with_intervals(analysis):
    told = words(shares.blocks(analysis))
    assert "all factors together explain 1.00 (1.00 to 1.00)" in told
    assert "8 independent scramblings" in told


def test_how_often_the_limit_is_exceeded_is_that_of_the_normal_error(analysis):
    population = analysis.findings[0].population
    assert population.limits == {1: pytest.approx(2.0)}
    # the error is normal about 1.5 deg with 0.2 * sqrt(3): beyond 2 deg with 7.4 %; the largest is twice as large
    assert np.mean(population.rmse[1, 0] > 2.0) == pytest.approx(0.0745, abs=0.01)
    assert np.mean(population.largest[1, 0] > 2.0) == pytest.approx(0.9255, abs=0.01)
    np.testing.assert_allclose(population.largest[1], 2.0 * population.rmse[1])


def test_words_give_the_probability_and_the_points_it_takes(analysis):
    told = words(exceedance.blocks(analysis))
    assert "the RMSE of the articulation angle exceeds 2.00° with a probability of 7." in told
    assert "interval of ±1.0 % takes" in told or "suffice for an interval of ±1.0 %" in told
    assert "8 independent scramblings, each on 2 drives" in told


def test_a_rare_event_is_told_with_its_coefficient_of_variation(analysis):
    event = {"design": "fleet", "target": "articulation_angle", "estimator": "EKF", "limit": np.deg2rad(6.0),
             "probability": 1.2e-6, "variation": 0.3, "thresholds": [0.1] * 6, "evaluations": 5500}  # fmt: skip
    analysis.store.rare_event = event
    (text,) = exceedance.rare(analysis, analysis.findings[0].design)
    analysis.store.rare_event = {}
    assert "exceeds 6.00° with a probability of 1.2e-06" in text
    assert "6 levels and 5500 vehicles" in text
    assert "coefficient of variation 30" in text
    assert exceedance.rare(analysis, analysis.findings[0].design) == []


def test_the_report_has_the_section_and_the_answer(folder):
    write_report(analyse(folder))
    page = (folder / "report.html").read_text(encoding="utf-8")
    assert "What makes the error vary?" in page
    assert "over the population of" in page
    assert "How often is a limit exceeded?" in page
    assert "First-order Sobol indices of the RMSE" in page
    assert "could not be made" not in page


def test_how_much_of_the_error_remains_is_the_ratio_of_the_variances():
    x = np.random.default_rng(0).normal(size=(1, 1, 8, 64))
    target = SimpleNamespace(words="lateral velocity", unit="m/s")

    def population(name, size, *factors):
        design = SimpleNamespace(
            name=name, factors=[SimpleNamespace(name=f) for f in factors], targets=[target], estimators=["EKF"]
        )
        return SimpleNamespace(design=design, rmse=1.0 + size * x, best=lambda _: 0)

    narrow, wide = population("posterior", 0.1, "mass", "friction"), population("tolerances", 0.2, "friction", "mass")
    (sentence,) = exceedance.narrowed([narrow, population("another", 1.0, "mass"), wide])
    assert "25 % (25 to 25 %) of the variance" in sentence
    assert sentence.index("tolerances") < sentence.index("posterior")
    assert exceedance.narrowed([narrow]) == []


def test_over_all_models_errors_are_those_of_the_mixture():
    """Of normal errors about 1 and 2 with shares of 0.7 and 0.3: in closed form."""
    x = ndtri((np.arange(8 * 1024) + 0.5) / (8 * 1024))
    x = np.random.default_rng(0).permutation(x).reshape(1, 1, 8, 1024)
    target = SimpleNamespace(words="lateral velocity", unit="m/s")

    def population(name, share, mean, size):
        design = SimpleNamespace(name=name, targets=[target], estimators=["EKF"])
        rmse = mean + size * x
        return SimpleNamespace(design=design, rmse=rmse, best=lambda _: 0, share=share, limits={0: 1.9})

    several = [population("plain", 1.4, 1.0, 0.1), population("lag", 0.6, 2.0, 0.2)]  # in any ratio
    errors, shares_ = [p.rmse[0, 0] for p in several], [0.7, 0.3]
    for share in (0.5, 0.95):
        interval = mixture_quantile(errors, shares_, share)
        below = 0.7 * ndtr((interval.value - 1.0) / 0.1) + 0.3 * ndtr((interval.value - 2.0) / 0.2)
        assert below == pytest.approx(share, abs=2e-4)
        assert interval.lower < interval.value < interval.upper
    between = 0.7 * 0.3 * 1.0
    whole = between + 0.7 * 0.1**2 + 0.3 * 0.2**2
    part = between_share(errors, shares_)
    assert part.value == pytest.approx(between / whole, abs=1e-3)
    assert part.lower < between / whole < part.upper
    (sentence,) = exceedance.mixed([several[0], population("tolerances", None, 9.0, 1.0), several[1]])
    assert "if “plain” is right (70 %)" in sentence
    assert "tolerances" not in sentence
    assert f"makes {100 * part.value:.3g} %" in sentence
    assert "with a probability of 20.7 %" in sentence  # 0.3 * 0.691
    assert exceedance.mixed(several[:1]) == []


def test_a_quantile_over_models_that_lose_runs_is_infinite_where_those_lie():
    errors = [np.ones((8, 16)), np.full((8, 16), np.inf)]
    assert mixture_quantile(errors, [0.7, 0.3], 0.5).value == 1.0
    assert mixture_quantile(errors, [0.7, 0.3], 0.95).value == np.inf


@pytest.mark.parametrize(
    ("shares_", "expected"), [((None, None, None), 2.0), ((0.6, 0.2, None), (0.6 * 1.0 + 0.2 * 2.0) / 0.8)]
)
def test_errors_over_all_models_weigh_each_by_its_share(shares_, expected):
    """Designs that state none, as the tolerances beside models of a trace, count only where none does."""

    def findings(error, share):
        design = SimpleNamespace(sampling="population", factors=(), errors=np.full((1, 2, 1, 4), error))
        return SimpleNamespace(
            design=design, medians=np.full((1, 1, 2), error), population=SimpleNamespace(share=share)
        )

    standing = Standing([findings(e, s) for e, s in zip((1.0, 2.0, 3.0), shares_, strict=True)], 0, 2.5)
    assert standing.mean == pytest.approx([expected, expected])
