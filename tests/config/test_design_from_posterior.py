"""Vehicles drawn from what an identification leaves open."""

import copy
import json
import tomllib
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.stats import spearmanr

from harness.api.study import design as api_design
from harness.common.errors import UserError
from harness.config import build_study, load_study, resolve_single
from harness.config.parameter_set import stated_std
from harness.identification.posterior_study import posterior_study
from harness.study.design import points

CONTENT = {
    "name": "posterior",
    "targets": ["lateral_velocity"],
    "plant": {"vehicle": "car", "parameters": "govindarajan_2018", "tyre": "linear", "sensors": "car_series"},
    "drive": [{"name": "sine", "kind": "sine", "duration": "5 s", "speed": "15 m/s", "amplitude": "20 deg"}],
    "estimator": [{"name": "EKF", "kind": "ekf"}],
    "design": [{"name": "open", "sampling": "population", "samples": 512, "posterior": "fit"}],
}
ESTIMATES = {"mass": (1600.0, 20.0), "yaw_inertia": (2400.0, 150.0), "measurement_noise yaw_rate": (1e-5, 1e-7)}


@pytest.fixture
def study(tmp_path, monkeypatch):
    """Return what builds the study beside the result of a fit, either of them changed."""
    monkeypatch.chdir(tmp_path)

    def built(estimates=ESTIMATES, correlation=0.8, failed=None, **design):
        (tmp_path / "fit").mkdir(exist_ok=True)
        table = np.eye(len(estimates))
        table[0, 1] = table[1, 0] = correlation
        rows = [{"name": n, "value": v, "standard_error": e} for n, (v, e) in estimates.items()]
        content = {"estimates": rows, "correlation": table.tolist(), "failed": failed}
        (tmp_path / "fit/identify.json").write_text(json.dumps(content))
        content = copy.deepcopy(CONTENT)
        content["design"][0] |= design
        return build_study(content, "posterior.toml")

    return built


def test_parameters_are_drawn_as_their_estimates_scatter(study):
    built = study()
    assert [f.parameter for f in built.designs[0].factors] == ["mass", "yaw_inertia"]  # noise keeps its estimate
    drawn = points(built, built.designs[0]).values.reshape(-1, 2)
    np.testing.assert_allclose(drawn.mean(axis=0), [1600.0, 2400.0], rtol=2e-4)
    np.testing.assert_allclose(drawn.std(axis=0), [20.0, 150.0], rtol=0.01)
    assert np.corrcoef(drawn.T)[0, 1] == pytest.approx(0.8, abs=0.01)


def test_a_factor_of_its_own_stands_in_place_of_an_estimate(study):
    factor = {"parameter": "yaw_inertia", "range": ["2000 kg m^2", "2200 kg m^2"]}
    built = study(factor=[factor])
    drawn = points(built, built.designs[0]).values.reshape(-1, 2)
    assert [f.parameter for f in built.designs[0].factors] == ["yaw_inertia", "mass"]
    assert 2000.0 <= drawn[:, 0].min() <= drawn[:, 0].max() <= 2200.0
    assert abs(np.corrcoef(drawn.T)[0, 1]) < 0.05


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"sampling": "sobol"}, "sampling = 'population'"),
        ({"posterior": "nowhere"}, "no trace.json in 'nowhere'"),
        ({"estimates": {"mass": (1600.0, 20.0), "trailer_mass": (9.0, 1.0)}}, "no parameter 'trailer_mass'"),
        ({"estimates": {"mass": (1600.0, None), "yaw_inertia": (1.0, 1.0)}}, "no error of 'mass'"),
        ({"estimates": {"mass": (1600.0, 0.0), "yaw_inertia": (1.0, 1.0)}}, "no error of 'mass'"),
        ({"estimates": {"mass": (-1.0, 20.0), "yaw_inertia": (2400.0, 1.0)}}, "identify.json: mass"),
        ({"estimates": {"mass": (None, 20.0), "yaw_inertia": (2400.0, 1.0)}}, "that no fit writes"),
        ({"correlation": 5.0}, "correlations that no fit writes"),
        ({"failed": "The fit failed: it is worse."}, "The fit failed: it is worse; identify again"),
    ],
)
def test_what_cannot_be_drawn_is_refused_in_words(study, change, said):
    with pytest.raises(UserError, match=said):
        study(**change)


def test_parameters_of_sensors_that_the_plant_does_not_have_play_no_part(study):
    """Those of effects on outputs; a name that ends as some signal does is none."""
    built = study({**ESTIMATES, "sensor_bias_sideslip_angle": (0.0, 0.1)})
    assert [f.parameter for f in built.designs[0].factors] == ["mass", "yaw_inertia"]


def test_parameters_are_drawn_as_a_sample_has_them(study, tmp_path):
    rng = np.random.default_rng(0)
    mass = 1500.0 + 200.0 * rng.beta(2, 5, 300)
    rows = np.column_stack([mass, 1.4 * mass + rng.normal(0, 15, 300)])
    lines = ["mass,yaw_inertia", *(f"{a!r},{b!r}" for a, b in rows.tolist())]
    (tmp_path / "sample.csv").write_text("\n".join(lines) + "\n")
    built = study(posterior="sample.csv")
    drawn = points(built, built.designs[0]).values.reshape(-1, 2)
    assert set(drawn[:, 0]) <= set(rows[:, 0])
    np.testing.assert_allclose(np.quantile(drawn, [0.1, 0.9], axis=0), np.quantile(rows, [0.1, 0.9], axis=0), rtol=2e-3)
    ranks = [spearmanr(*table.T)[0] for table in (drawn, rows)]
    assert ranks[0] == pytest.approx(ranks[1], abs=0.02)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("", "sample.csv: is empty"),
        ("mass,mess\n1600,1\n1700,2\n", "no parameter 'mess'"),
        ("mass\n1600\nheavy\n", "line 3, column 'mass': 'heavy' is no number"),
        ("mass,mass\n1600,1\n1700,2\n", "two columns are called 'mass'"),
        ("mass\n1600\n1600\n", "column 'mass' has one value only"),
        ("mass\n1600\n-1700\n", "mass"),
    ],
)
def test_a_sample_that_is_none_is_refused_in_words(study, tmp_path, text, said):
    (tmp_path / "sample.csv").write_text(text)
    with pytest.raises(UserError, match=said):
        study(posterior="sample.csv")


MODELS = [
    (0.7, {"mass": (1600.0, 20.0), "yaw_inertia": (2400.0, 150.0), "measurement_noise yaw_rate": (1e-5, 1e-7)}, 0.8),
    (0.3, {"mass": (1700.0, 5.0), "steering_lag": (0.1, 0.005)}, -0.5),
]
MIXED = [
    {"name": name, "sampling": "population", "samples": 512, "posterior": "traced", "model": number, "share": share}
    for name, number, share in (("plain", 1, 0.7), ("lag", 2, 0.3))
]


@pytest.fixture
def mixed(tmp_path, monkeypatch):
    """Return what builds a study of a trace that left two models, with one key of the second design changed."""
    monkeypatch.chdir(tmp_path)
    models = []
    for share, estimates, correlation in MODELS:
        table = np.eye(len(estimates))
        table[0, 1] = table[1, 0] = correlation
        rows = [{"name": n, "value": v, "standard_error": e} for n, (v, e) in estimates.items()]
        models.append({"added": [], "share": share, "estimates": rows, "correlation": table.tolist()})
    (tmp_path / "traced").mkdir()
    (tmp_path / "traced/trace.json").write_text(json.dumps({**models[0], "confusable": {"models": models}}))

    def built(**changed):
        plant = CONTENT["plant"] | {"effects": ["steering_lag"]}
        second = {k: v for k, v in (MIXED[1] | changed).items() if v is not None}
        return build_study({**CONTENT, "plant": plant, "design": [MIXED[0], second]}, "posterior.toml")

    return built


def test_each_model_of_a_trace_is_drawn_as_its_own_estimates_scatter(mixed):
    built = mixed()
    assert built.plant.values["steering_lag"] == 0.0  # of what is not that model's
    assert [d.share for d in built.designs] == [0.7, 0.3]
    assert mixed(share=3.0).designs[1].share == 3.0  # in any ratio
    for design, (_, estimates, correlation) in zip(built.designs, MODELS, strict=True):
        names = [n for n in estimates if " " not in n]
        assert [f.parameter for f in design.factors] == names
        drawn = points(built, design).values.reshape(-1, 2)
        values, errors = zip(*(estimates[n] for n in names), strict=True)
        np.testing.assert_allclose(drawn.mean(axis=0), values, rtol=2e-4)
        np.testing.assert_allclose(drawn.std(axis=0), errors, rtol=0.01)
        assert np.corrcoef(drawn.T)[0, 1] == pytest.approx(correlation, abs=0.01)


@pytest.mark.parametrize(
    ("changed", "said"),
    [
        ({"model": 3}, "has 2 confusable models; there is no model = 3"),
        ({"posterior": None}, "model is one of the posterior of a trace"),
        ({"posterior": "sample.csv"}, "is a sample and has no models"),
        ({"share": None}, "'plain' alone states a share"),
        ({"share": 0.0}, "greater than 0"),
        ({"scramblings": 16}, "equally many scramblings, not plain 8, lag 16"),
    ],
)
def test_models_that_cannot_be_weighed_are_refused_in_words(mixed, tmp_path, changed, said):
    (tmp_path / "sample.csv").write_text("mass\n1600\n1700\n")
    with pytest.raises(UserError, match=said):
        mixed(**changed)


def test_a_store_keeps_the_models_and_their_shares(mixed, tmp_path):
    from harness.config.self_contained import self_contained

    built = mixed()
    (tmp_path / "again.toml").write_text(self_contained(built))
    (tmp_path / "traced/trace.json").unlink()
    again = load_study(tmp_path / "again.toml")
    assert [d.share for d in again.designs] == [0.7, 0.3]
    assert [f.marginal for d in again.designs for f in d.factors] == [
        f.marginal for d in built.designs for f in d.factors
    ]


def test_python_states_it_as_a_file_does(study):
    wanted = study().designs[0]
    stated = api_design("open", sampling="population", samples=512, posterior="fit")
    assert build_study({**CONTENT, "design": [stated]}, "posterior.toml").designs[0] == wanted


def test_a_damaged_result_is_refused(study, tmp_path):
    study()
    (tmp_path / "fit/identify.json").write_text('{"estimates": [{"name": 1}]}')
    with pytest.raises(UserError, match="no result of harness identify or trace"):
        build_study(CONTENT, "posterior.toml")


def test_a_store_needs_the_fit_no_more(study, tmp_path):
    from harness.config.self_contained import self_contained

    built = study()
    text = self_contained(built)
    (tmp_path / "fit/identify.json").unlink()
    (tmp_path / "again.toml").write_text(text)
    again = load_study(tmp_path / "again.toml")
    assert again.designs[0].factors[0].marginal == built.designs[0].factors[0].marginal


def test_a_study_says_where_the_model_lacks_what_it_does_not_vary():
    spec = resolve_single(CONTENT["plant"], "test")
    steering, names = np.linspace(-0.1, 0.1, 9), spec.model().inputs
    drives = [SimpleNamespace(inputs=np.column_stack([np.full(9, 20.0) if n == "speed" else steering for n in names]))]
    plain, lacking = (
        posterior_study(spec, "parameters.toml", [("mass", 20.0)], drives, lacks) for lacks in ("", "It is unresolved")
    )
    assert "lacks" not in plain
    assert "# It is unresolved: the model lacks something,\n" in lacking
    assert tomllib.loads(lacking) == tomllib.loads(plain)
    assert tomllib.loads(plain)["drive"][0]["speed"] == 20.0
    assert posterior_study(spec, "parameters.toml", [("mass", np.inf)], drives) == ""
    posterior, tolerances = tomllib.loads(plain)["design"]
    assert (posterior["posterior"], tolerances["factor"][0]["distribution"]["std"]) == (".", stated_std(spec)["mass"])
