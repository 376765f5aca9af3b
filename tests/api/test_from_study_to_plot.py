"""The path of a user in Python: a study, its results pickled and looked at elsewhere, a plot of their own."""

import pickle

import matplotlib as mpl
import numpy as np
import pytest

import harness as h

mpl.use("Agg")


@pytest.fixture(scope="module")
def car():
    return h.model("car", "govindarajan_2018", sensors="car_series")


@pytest.fixture(scope="module")
def study(car):
    return h.Study(
        car,
        name="mass-of-a-car",
        targets=["lateral_velocity"],
        drives=[h.drive("sine", duration="10 s", amplitude="20 deg")],
        estimators={"EKF": "ekf", "wide": h.Estimator("ukf", alpha=0.9)},
        designs=[h.levels("mass", ["1.5 t", "1.8 t", "2.1 t"], repeats=4)],
    )


def through(thing, folder):
    """Return an object that was written to a file and read again, as by another process."""
    file = folder / "result.pickle"
    file.write_bytes(pickle.dumps(thing))
    return pickle.loads(file.read_bytes())


def test_from_a_study_to_pickled_results_to_a_plot(study, tmp_path):
    results = study.run(tmp_path / "results", jobs=1)
    again = through(results, tmp_path)
    assert again.identical(results)
    assert again.answer == results.answer
    table = again.to_dataframe()
    medians = table.groupby(["band", "estimator"], observed=True).rmse.median().unstack("estimator")
    labelled = again["mass"].to_dataset().rmse.median(["sample", "drive", "repeat"]).squeeze("target")
    np.testing.assert_array_equal(medians.to_numpy(), labelled.sel(band=medians.index, estimator=medians.columns))

    figure = mpl.figure.Figure()
    axes = figure.subplots()
    medians.plot.bar(ax=axes, ylabel=f"RMSE in {table.target_unit.iloc[0]}")
    assert [t.get_text() for t in axes.get_xticklabels()] == ["1.5 t", "1.8 t", "2.1 t"]
    assert [p.get_height() for p in axes.patches] == medians.to_numpy().T.ravel().tolist()
    assert axes.get_ylabel() == "RMSE in m/s"

    run = through(again.replay("mass", band="2.1 t", repeat=2, estimators=["EKF"]), tmp_path)
    assert run.is_same
    assert run == results.replay("mass", band="2.1 t", repeat=2, estimators=["EKF"])
    worst = table.query("band == '2.1 t' and repeat == 2 and estimator == 'EKF'").rmse.item()
    error = run.data.estimate.sel(estimator="EKF") - run.data.truth
    assert np.sqrt((error**2).mean("time")).sel(target="lateral_velocity").item() == pytest.approx(worst, rel=1e-2)


def test_from_a_recording_to_estimates_and_tuned_noise(car, tmp_path):
    run = h.simulate(car, h.drive("sine", duration="10 s", amplitude="20 deg"), seed=1)
    estimates = h.estimate(car, run, {"EKF": "ekf"})
    again = through(estimates, tmp_path)
    assert again == estimates
    assert again.errors.equals(estimates.errors)
    assert again != h.estimate(car, run.isel(time=slice(0, 900)), {"EKF": "ekf"})
    assert [p.name for p in again.report(tmp_path / "report")][:1] == ["report.html"]

    tuned = h.tune_noise(car, run)
    assert through(tuned, tmp_path) == tuned
    assert {kind for kind, _ in tuned.variances.index} == {"process", "measurement"}
    assert (tuned.variances.lower <= tuned.variances.upper).all()
    file, *_ = through(tuned, tmp_path).write(tmp_path / "tuned.toml")
    assert h.model("car", file, sensors="car_series").noise.variance[("measurement", "yaw_rate")] == pytest.approx(
        tuned.variances.value[("measurement", "yaw_rate")]
    )


def test_from_a_recording_to_parameters(car, tmp_path):
    run = h.simulate(car, h.drive("sine", duration="20 s", amplitude="20 deg"), seed=1)
    fit = h.identify(car.replace(values={"yaw_inertia": "3000 kg*m^2"}), run, free=["yaw_inertia"])
    again = through(fit, tmp_path)
    assert again == fit
    assert again.answer == fit.answer
    assert again.model == fit.model
    assert {p.name for p in again.report(tmp_path / "fit")} >= {"parameters.toml", "identify.json", "report.html"}


def test_tuned_times_and_observability(study, car, tmp_path):
    (tmp_path / "training.toml").write_text(
        '[[drive]]\nname = "sine"\nkind = "sine"\namplitude = "20 deg"\nduration = "5 s"\n'
    )
    tuned = h.tune(study, tmp_path / "training.toml", estimators=["EKF"], budget=48)
    assert through(tuned, tmp_path) == tuned
    assert tuned.factors.after["EKF"] >= tuned.factors.before["EKF"]
    (file,) = tuned.write(tmp_path / "tuned.toml")
    assert "[estimator.EKF]" in file.read_text()
    with pytest.raises(h.UserError, match="no such design; closest: mass"):
        h.tune(study, tmp_path / "training.toml", objective="worst-case", design="mas")

    times = h.time_steps(study, duration="1 s")
    assert through(times, tmp_path) == times
    assert (times.quantiles["median"] > 0).all()
    assert {e for _, e in times.quantiles.index} == {"EKF", "wide"}

    criteria = h.observability(car)
    assert criteria["rank"].attrs["required"] == len(car.states)
    unsure = h.model("car", "govindarajan_2018", sensors="car_series", unknown_parameters=["mass"])
    assert {"std", "correlation", "rank"} <= set(h.observability(unsure))
