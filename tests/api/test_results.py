"""Studies and results in Python: the tree, the table of what is selected, and the same study from its file."""

import numpy as np
import pytest
import xarray as xr

import harness as h
from harness.study.results import read
from support import synthetic


@pytest.fixture(scope="module")
def car():
    return h.model("car", "govindarajan_2018", sensors="car_series")


@pytest.fixture(scope="module")
def study(car):
    return h.Study(
        car,
        name="loads",
        targets=["lateral_velocity", "yaw_rate"],
        drives=[h.drive("sine", amplitude="20 deg", duration="10 s"), {"name": "slow", "kind": "sine", "speed": 8.0}],
        estimators={"EKF": "ekf", "wide": h.Estimator("ukf", alpha=0.9)},
        designs=[h.levels("mass", ["1.5 t", "1.8 t"], repeats=3), h.design("nominal")],
        belief={"values": {"yaw_inertia": 2500.0}},
        history={"design": "nominal", "drive": "sine"},
    )


def test_a_study_in_python_is_the_one_of_its_file(study, tmp_path):
    (tmp_path / "loads.toml").write_text(study.toml)
    again = h.read_study(tmp_path / "loads.toml")
    assert again.spec.hash == study.spec.hash
    assert again.runs == study.runs == (2 * 3 + 1) * 2 * 2
    assert study.spec.estimators[1].settings["alpha"] == 0.9
    assert study.spec.belief.values["yaw_inertia"] == 2500.0
    assert "loads" in study._repr_html_()


def test_what_is_wrong_with_a_study_is_said_by_key(car):
    with pytest.raises(h.UserError) as caught:
        h.Study(
            car, targets=["yaw_rat"], drives=[h.drive("sine")], estimators=["ekf"], designs=[h.levels("mas", [1.0])]
        )
    lines = str(caught.value).splitlines()
    assert len(lines) == 2
    assert lines[0].startswith("study: targets[0]: the plant cannot give it")
    assert "design[0].factor[0].parameter" in lines[1]


@pytest.fixture(scope="module")
def results(study, tmp_path_factory):
    return study.run(tmp_path_factory.mktemp("loads"), jobs=1)


def test_the_tree_has_a_node_per_design_and_run(results):
    assert isinstance(results, xr.DataTree)
    assert set(results.children) == {"mass", "nominal", "history"}
    assert results["mass"].sizes == {"band": 2, "sample": 1, "drive": 2, "repeat": 3, "estimator": 2, "target": 2}
    assert results["history/0"].estimate.dims == ("time", "estimator", "target")
    assert results["mass"].factor_mass.attrs["units"] == "kg"
    assert results["mass"].factor_mass.values.ravel().tolist() == [1500.0, 1800.0]


def test_the_table_has_a_row_per_run_estimator_and_target(results):
    table = results.to_dataframe()
    assert len(table) == (2 * 3 + 1) * 2 * 2 * 2
    assert not table.duplicated(["design", "band", "drive", "sample", "repeat", "estimator", "target"]).any()
    rmse = results["mass"].to_dataset().rmse
    for band, drive, repeat, estimator, target in (
        ("1.5 t", "slow", 2, "wide", "yaw_rate"),
        ("1.8 t", "sine", 0, "EKF", "lateral_velocity"),
    ):
        where = {"drive": drive, "estimator": estimator, "target": target, "band": band}
        row = table.query(
            f"design == 'mass' and band == '{band}' and drive == '{drive}' and repeat == {repeat} "
            f"and estimator == '{estimator}' and target == '{target}'"
        )
        assert row.rmse.item() == rmse.sel(where).isel(repeat=repeat, sample=0).item()
        assert row.factor_mass.item() == {"1.5 t": 1500.0, "1.8 t": 1800.0}[band]
    assert set(table.status) == {"ok"}
    assert (table.attrs["units"]["factor_mass"], table.attrs["units"]["time_of_divergence"]) == ("kg", "s")
    assert np.isnan(table.factor_mass[table.design == "nominal"]).all()


def test_a_column_has_one_name_in_table_and_tree(results):
    node, table = results["mass"].to_dataset(), results.to_dataframe("mass")
    assert set(table) - {"design"} <= {*node.variables, *node.dims}
    assert list(table.band.cat.categories) == node.band.values.tolist() == node.band_label.values.tolist()
    assert node.rmse.sel(band="1.8 t").values.tolist() == node.rmse[1].values.tolist()
    assert node.sel(band_label="1.8 t").factor_mass.item() == 1800.0


def test_report_units_scale_errors_and_factors(results):
    si, shown = (results.to_dataframe("mass", report_units=each) for each in (False, True))
    turning = (si.target == "yaw_rate").to_numpy()
    np.testing.assert_allclose(shown.rmse[turning], np.rad2deg(si.rmse[turning]))
    np.testing.assert_allclose(shown.nees, si.nees)
    assert set(shown.target_unit[turning]) == {"°/s"}
    assert (shown.attrs["units"]["factor_mass"], shown.factor_mass.max()) == ("t", pytest.approx(1.8))


def test_what_is_selected_is_tabulated(results):
    part = results["mass"].to_dataset().sel(estimator="wide", drive="sine").isel(band=[0])
    table = h.Results.from_dict({"mass": part}).to_dataframe()
    whole = results.to_dataframe("mass").query("estimator == 'wide' and drive == 'sine' and band == '1.5 t'")
    np.testing.assert_array_equal(np.sort(table.rmse), np.sort(whole.rmse))
    with pytest.raises(KeyError, match="no design 'load'; there are mass, nominal"):
        results.to_dataframe("load")


def test_results_are_the_same_when_they_are_opened_or_copied(results):
    assert "mass" in results.answer
    again = h.open_results(results.folder)
    assert again.copy().to_dataframe().equals(results.to_dataframe())


def test_lost_runs_keep_their_status_in_words(tmp_path):
    def lose(status):
        status.flat[:2] = 1, 2

    folder = synthetic.write(tmp_path / "study", {"level": synthetic.design(repeats=3, status=lose)})
    table = h.open_results(folder).to_dataframe()
    targets = read(folder).designs[0].data.sizes["target"]
    counts = table.status.value_counts()
    assert (counts["estimator_diverged"], counts["plant_diverged"]) == (targets, targets)


def test_a_folder_without_results_is_refused(tmp_path):
    with pytest.raises(h.UserError, match="no finished study here"):
        h.open_results(tmp_path)
