"""Populations: correlated factors, groups, and points in independent scramblings of the joint distribution."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import stats

from harness.common.errors import UserError
from harness.common.files import parse_toml
from harness.config import build_study, load_study
from harness.config.dependence import nearest_correlation
from harness.config.self_contained import self_contained
from harness.study.design import points
from support.small_study import STUDY

HEAD = STUDY.split("[[design]]")[0]
LOAD = [
    '{ parameter = "payload_mass", distribution = { kind = "normal", mean = "16 t", std = "2 t" } }',
    '{ parameter = "payload_from_rear", range = ["7 m", "8 m"] }',
    '{ parameter = "friction", distribution = { kind = "discrete", values = [0.5, 0.9] } }',
]
PAIR = '["payload_mass", "payload_from_rear", 0.8]'


@pytest.fixture
def study_of(tmp_path):
    def _study(further="", factors=LOAD, sampling="population", samples=64):
        listed = ",\n".join(factors)
        text = f'[[design]]\nname = "d"\nsampling = "{sampling}"\nsamples = {samples}\n{further}\nfactor = [{listed}]\n'
        path = tmp_path / "population.toml"
        path.write_text(HEAD + text)
        return load_study(path)

    return _study


def test_a_population_is_independent_scramblings_one_behind_the_other(study_of):
    study = study_of()
    table = points(study, study.designs[0])
    assert table.values.shape == (1, 8 * 64, 3)
    each = table.values[0].reshape(8, 64, 3)
    assert len({tuple(rows[0]) for rows in each}) == 8
    for rows in each:  # every scrambling fills each half as often, which independent points do not
        assert np.sum(rows[:, 0] < 16e3) == 32
        assert np.sum(rows[:, 2] == 0.5) == 32
    np.testing.assert_allclose(stats.norm.ppf(stats.norm(16e3, 2e3).cdf(each[..., 0])).ravel(), table.scores[:, 0])


def test_the_copula_has_the_stated_correlation_and_keeps_the_marginals(study_of):
    independent, study = study_of(samples=512), study_of(f"correlation = [{PAIR}]", samples=512)
    table = points(study, study.designs[0])
    load, place, friction = table.values[0].T
    assert np.corrcoef(table.scores.T)[0, 1] == pytest.approx(0.8, abs=0.01)
    assert stats.spearmanr(load, place)[0] == pytest.approx(6 / np.pi * np.arcsin(0.4), abs=0.01)
    assert load.mean() == pytest.approx(16e3, abs=20)
    assert load.std() == pytest.approx(2e3, rel=0.02)
    assert place.min() >= 7.0
    assert place.std() == pytest.approx(12**-0.5, rel=0.02)
    # a factor without dependence keeps the same bits
    np.testing.assert_array_equal(friction, points(independent, independent.designs[0]).values[0, :, 2])
    assert study.hash != independent.hash
    assert build_study(parse_toml(self_contained(study), "again"), "again.toml").hash == study.hash


def test_bands_may_be_correlated_too(study_of):
    study = study_of(f"correlation = [{PAIR}]", sampling="sobol", samples=1024)
    values = points(study, study.designs[0]).values[0]
    assert stats.spearmanr(values[:, 0], values[:, 1])[0] == pytest.approx(6 / np.pi * np.arcsin(0.4), abs=0.02)


def test_the_nearest_correlation_matrix_is_highams(study_of):
    stated = np.array([[1.0, 1.0, 0.0], [1.0, 1.0, 1.0], [0.0, 1.0, 1.0]])  # Higham 2002, section 4
    expected = np.array([[1.0, 0.7607, 0.1573], [0.7607, 1.0, 0.7607], [0.1573, 0.7607, 1.0]])
    np.testing.assert_allclose(nearest_correlation(stated), expected, atol=1e-4)
    pairs = [PAIR, '["payload_mass", "friction", 0.8]', '["payload_from_rear", "friction", -0.8]']
    design = study_of(f"correlation = [{', '.join(pairs)}]").designs[0]
    assert design.correlation_change == pytest.approx(0.3, abs=0.02)
    assert np.linalg.eigvalsh(np.array(design.correlation))[0] > 0
    assert study_of(f"correlation = [{PAIR}]").designs[0].correlation_change == 0.0


def test_groups_decide_no_score(study_of):
    grouped = study_of('groups = { load = ["payload_mass", "payload_from_rear"] }')
    assert grouped.designs[0].groups == (("load", ("payload_mass", "payload_from_rear")),)
    assert grouped.hash == study_of().hash


REFUSED = {
    'correlation = [["payload_mas", "friction", 0.5]]': "correlation[0]: 'payload_mas' is no factor of the design; "
    "closest: payload_mass",
    'correlation = [["payload_mass", "friction", 1]]': "correlation[0]: a correlation lies between -1 and 1, got 1",
    f'correlation = [{PAIR}, ["payload_from_rear", "payload_mass", 0.1]]': "correlation[1]: 'payload_from_rear' and "
    "'payload_mass' are correlated already",
    'groups = { payload_mass = ["payload_from_rear"] }': "groups.payload_mass: a factor has this name",
    'groups = { load = ["payload"] }': "groups.load[0]: 'payload' is no factor of the design",
    'groups = { a = ["friction"], b = ["friction"] }': "groups.b[0]: 'friction' is in the group 'a' already",
    "scramblings = 7": "scramblings: input should be greater than or equal to 8, got 7",
    "boxes = 4": "boxes: nested boxes belong to sampling = 'tolerance'",
}


@pytest.mark.parametrize("further", REFUSED)
def test_what_is_no_dependence_is_refused_in_a_line(study_of, further):
    with pytest.raises(UserError) as refused:
        study_of(further)
    assert f"design[0].{REFUSED[further]}" in str(refused.value)
    assert "\n" not in str(refused.value)


def test_the_width_of_a_probability_is_a_share(study_of, tmp_path):
    study_of()
    text = (tmp_path / "population.toml").read_text()
    for width, refused in (('"0.5 %"', None), ('"2 m"', "probability_within"), ("0", "give a share between 0 and 1")):
        (tmp_path / "wide.toml").write_text(f"{text}\n[report]\nprobability_within = {width}\n")
        if refused is None:
            assert load_study(tmp_path / "wide.toml").probability_within == 0.005
            continue
        with pytest.raises(UserError, match=refused):
            load_study(tmp_path / "wide.toml")


def test_other_samplings_refuse_what_is_of_a_population(study_of):
    with pytest.raises(UserError, match=r"correlation: Sobol indices .* need independent factors; take 'population'"):
        study_of(f"correlation = [{PAIR}]", sampling="saltelli")
    with pytest.raises(UserError, match="groups: groups belong to sampling = 'population'"):
        study_of('groups = { load = ["payload_mass"] }', sampling="saltelli")
    with pytest.raises(UserError, match="scramblings: scramblings belong to sampling = 'population'"):
        study_of("scramblings = 8", sampling="sobol")
    with pytest.raises(UserError, match="sampling = 'population' fills one box"):
        study_of(factors=['{ parameter = "friction", levels = [0.5, 0.9] }'])
    with pytest.raises(UserError, match="correlation\\[0\\]: 'friction' takes one value"):
        study_of(
            'correlation = [["payload_mass", "friction", 0.5]]',
            [LOAD[0], '{ parameter = "friction", levels = [1] }'],
            "sobol",
        )
