"""The box of what the dissertation leaves open: places, evidence, search, and what is kept."""

from __future__ import annotations

import numpy as np
import pytest

from harness.common.errors import UserError
from harness.common.statistics import Interval
from harness.models.roles import PARAMETERS
from reproductions.box import analysis, search, studies
from reproductions.box.evidence import IN_BOX, PUBLISHED, PointResults, distance, evidence_of
from reproductions.box.factors import FACTORS, as_printed, onto_choices, place_of, settings
from reproductions.box.plausibility import plausibility
from reproductions.box.points import SCORES, Folder, Point, lag, ripple, sequence
from reproductions.box.totals import total_indices
from reproductions.campaign import evidence
from reproductions.campaign.evidence import Evidence

CENTRE = np.full(len(FACTORS), 0.5)
BANDS = {
    "ideal": ["nominal"],
    "process-noise": ["×10", "×0.1", "×0.001"],
    "mass": ["8 t", "32 t"],
    "cog": ["-2 m", "+2 m"],
    "friction": ["0.5", "0.6", "1.1"],
    "tyre": ["±0 %", "±10 %", "±20 %", "±30 %"],
}


def point(number=0, place=CENTRE, factors=None, lost=None) -> Point:
    """Return a point whose RMSE is 1 kN and 1 degree at every level, times a factor by ``(study, band)``."""
    rng, scores = np.random.default_rng(1), {}
    for study, bands in BANDS.items():
        samples, repeats = (8, 1) if study == "tyre" else (1, 8)
        shape = (len(bands), 6, samples, repeats, 3, 2)
        base = 1.0 + 0.01 * rng.random(shape[1:4])[..., None, None]
        times = np.array([(factors or {}).get((study, b), 1.0) for b in bands]).reshape(-1, 1, 1, 1, 1, 1)
        rmse = np.broadcast_to(base * times * np.array([1e3, np.pi / 180]), shape).astype(np.float32)
        scores |= {
            f"{study}/rmse": rmse,
            f"{study}/max_error": np.full(shape, 0.1),
            f"{study}/status": np.zeros(shape[:5]),
        }
    for study, band, runs in lost or ():
        scores[f"{study}/max_error"][BANDS[study].index(band)].reshape(-1, 3, 2)[:runs] = 3.0
    return Point(number, place, settings(place), BANDS, scores, list("abcdef"), 0.7, 0.01)


def test_a_factor_takes_its_ends_and_fills_a_logarithm_evenly():
    for factor in FACTORS:
        ends = factor.value(0.0), factor.value(1.0)
        assert ends == pytest.approx(
            (factor.choices[0], factor.choices[-1]) if factor.choices else (factor.lower, factor.upper)
        )
    logarithmic = next(f for f in FACTORS if f.name == "steering_variance")
    assert logarithmic.value(0.5) == pytest.approx(1e-4)


@pytest.mark.parametrize("place", [np.zeros(len(FACTORS)), CENTRE, np.full(len(FACTORS), 0.999)])
def test_every_corner_is_a_study_with_six_drives(place):
    study = studies.study_at(settings(place))
    assert len(study.drives) == 6
    assert {d.name for d in study.designs} == set(BANDS)
    assert study.design("cog").band_labels == tuple(BANDS["cog"])
    assert study.belief.process_noise["steering_wheel_angle"] == pytest.approx(
        settings(place)["steering_variance"] * settings(place)["noise_intensity"]
    )


def test_every_value_has_its_place():
    rng = np.random.default_rng(4)
    at = settings(rng.random(len(FACTORS)))
    again = settings(place_of(at))
    assert again == pytest.approx(at, rel=1e-12)
    printed = as_printed(at)
    assert [f"{v:.3g}" for v in printed.values()] == [f"{v:.3g}" for v in at.values()]
    assert settings(place_of(printed)) == pytest.approx(printed, rel=1e-12)


def test_what_the_default_set_takes_for_the_steering_does_not_move_the_box(monkeypatch):
    at = settings(CENTRE)
    before = studies.study_at(at)
    monkeypatch.setitem(PARAMETERS.load(studies.SET).PROCESS_NOISE, "steering_wheel_angle", 1.0)
    after = studies.study_at(at)
    assert after.belief.process_noise == before.belief.process_noise
    plant = {k: v for k, v in before.plant.process_noise.items() if k != "steering_wheel_angle"}
    assert {k: after.plant.process_noise[k] for k in plant} == plant  # the true steering is the drive's, without noise


def test_both_readings_of_the_steering_noise_lie_in_the_box():
    factor = next(f for f in FACTORS if f.name == "steering_variance")
    assert factor.lower < 1e-5 < 1e-5 * 23**2 < factor.upper


def test_the_lag_of_a_delayed_copy_is_its_delay():
    time = np.arange(3000) * 0.01
    true = np.sin(0.8 * time) + np.sin(0.31 * time)
    assert lag(np.roll(true, 70), true, 0.01) == pytest.approx(0.7, abs=0.011)
    noisy = true + 0.1 * np.random.default_rng(0).standard_normal(len(true))
    assert ripple(noisy, 0.01) == pytest.approx(0.1, rel=0.15)


def test_the_level_as_believed_is_the_ideal_case_and_a_large_error_is_a_lost_run():
    results = PointResults(point(lost=[("cog", "-2 m", 11)]))
    believed = results.errors("mass", "24 t", "EKF", "articulation_angle")
    np.testing.assert_array_equal(believed, results.errors("ideal", None, "EKF", "articulation_angle"))
    assert results.diverged("cog", "-2 m", "UKF") == (11, 48)
    assert np.isnan(results.errors("cog", "-2 m", "EKF", "lateral_force_axle_21")).sum() == 11


def test_findings_follow_the_errors():
    says = evidence_of(point(factors={("mass", "8 t"): 3.0, ("mass", "32 t"): 3.0}))
    holds = dict(zip((c.text for c in IN_BOX), says.holds(), strict=True))
    assert holds["A trailer mass other than believed makes the force clearly worse, in both directions."]
    assert not holds["The mass hardly affects the articulation angle."]
    assert holds["Friction hardly affects the articulation angle."]


def test_a_distance_of_one_is_a_factor_of_two():
    assert distance(1.64, 3.28) == distance(1.64, 0.82) == pytest.approx(1.0)
    assert distance(1.64, np.nan) == 4.0
    assert distance(1 / 60, 0.0) == pytest.approx(1.0)


def test_a_margin_is_positive_inside_and_counts_the_worst_number():
    def one(value):
        return Evidence("EKF", Interval(value, value, value), (0.8, 1.25), np.nan, 1)

    assert analysis.margin([one(1.0)]) == pytest.approx(np.log2(1.25))
    assert analysis.margin([one(1.0), one(2.0)]) == pytest.approx(np.log2(1.25 / 2.0))


@pytest.fixture
def few_resamples(monkeypatch):
    """Where many points are evidence_of of and no interval of a point matters."""
    monkeypatch.setattr(evidence, "RESAMPLES", 100)


def test_what_decides_a_finding_is_found(monkeypatch, few_resamples):
    monkeypatch.setattr(analysis, "total_indices", lambda *_: None)  # of fourteen findings; tested below
    places = sequence(64)
    points = [point(k, p, {("mass", "8 t"): 1 + 4 * p[7], ("mass", "32 t"): 4.0}) for k, p in enumerate(places)]
    found = analysis.survivals(points, [evidence_of(p) for p in points])[5]
    assert found.share.lower < np.mean(places[:, 7] > 0.125) < found.share.upper
    assert found.hinge is not None
    assert found.hinge.strongest(1) == [7]


def ishigami(x):
    z = np.pi * (2 * x - 1)
    return np.sin(z[:, 0]) + 7 * np.sin(z[:, 1]) ** 2 + 0.1 * z[:, 2] ** 4 * np.sin(z[:, 0])


def test_total_indices_of_a_known_function_lie_in_their_intervals():
    places = sequence(256)[:, :4]
    found = total_indices(places, ishigami(places), 1)
    truth = np.array([0.5576, 0.4424, 0.2437, 0.0])  # Ishigami and Homma 1990
    assert (found.lower - 0.01 <= truth).all()
    assert (truth <= found.upper + 0.01).all()
    assert (found.upper - found.lower < 0.15).all()
    assert found.explained > 0.9


def test_a_total_index_counts_what_two_factors_do_together():
    places = sequence(128)[:, :6]
    together = (places[:, 0] - 0.5) * (places[:, 1] - 0.5) + 0.02 * np.random.default_rng(3).standard_normal(128)
    found = total_indices(places, together, 1)
    truth = 1 / 144 / (1 / 144 + 0.02**2)  # all of it but the noise
    assert (found.lower[:2] - 0.01 <= truth).all()
    assert (truth <= found.upper[:2] + 0.01).all()
    assert found.value[2:].max() < 0.1


def test_a_factor_with_choices_counts_by_its_choice():
    places = onto_choices(sequence(64))
    column = [f.name for f in FACTORS].index("finer_plant")
    assert set(places[:, column]) == {0.25, 0.75}
    assert (places[:, 0] == sequence(64)[:, 0]).all()
    found = total_indices(sequence(64), (sequence(64)[:, column] >= 0.5) + 0.1 * sequence(64)[:, 0], 1, onto_choices)
    assert int(np.argmax(found.value)) == column
    assert found.lower[column] > 0.9


def test_no_factor_is_named_where_the_surrogate_explains_little():
    places = sequence(64)[:, :5]
    for outputs, named in ((np.random.default_rng(0).standard_normal(64), []), (places[:, 3] ** 2, [3])):
        found = total_indices(places, outputs, 1)
        assert analysis.Hinge(np.zeros(5), np.zeros(5), found).strongest_in_total() == named


def test_findings_that_never_hold_together_are_named_and_the_richest_point_is_found(few_resamples):
    steep = {("mass", "8 t"): 3.0, ("mass", "32 t"): 3.0}
    points = [point(k, CENTRE, steep if k % 2 else None) for k in range(40)]
    says = [evidence_of(p) for p in points]
    pairs = [(a, b) for a, b, ratio in analysis.exclusions(says) if ratio == 0.0]
    assert (5, 6) in pairs  # a mass that makes the force worse makes the angle worse here
    best = analysis.most_findings(points, says)
    assert sum(says[best].holds()) == max(sum(s.holds()) for s in says)


def test_a_search_goes_towards_the_best_and_repeats_itself():
    places = sequence(64)
    target = np.full(len(FACTORS), 0.7)
    scores = ((places - target) ** 2).sum(axis=1)
    for generation in range(12):
        more = search.candidates(places, scores, generation)
        assert ((more >= 0) & (more <= 1)).all()
        np.testing.assert_array_equal(more, search.candidates(places, scores, generation))
        places = np.concatenate([places, more])
        scores = ((places - target) ** 2).sum(axis=1)
    assert scores.min() < 0.5 * scores[:64].min()


def test_a_point_is_kept_and_one_of_another_box_refused(tmp_path):
    folder = Folder(tmp_path)
    first = point(3, sequence(4)[3])
    folder.put(first)
    again = folder.get(3, first.place)
    assert again is not None
    assert again.bands == first.bands
    assert again.delay == first.delay
    for name in first.scores:
        assert name.split("/")[-1] in SCORES
        np.testing.assert_array_equal(again.scores[name], first.scores[name])
    with pytest.raises(UserError, match="other code or with other settings"):
        folder.get(3, sequence(4)[2])
    (tmp_path / "point_0003.npz").write_bytes(b"half")
    with pytest.raises(UserError, match="is damaged"):
        folder.get(3, first.place)


def test_our_vehicle_is_plausible():
    at = settings(CENTRE) | {f"stiffness_{a}": 1.0 for a in ("11", "12", "2")} | {"stiffness_load_2": 1.0}
    found = plausibility(at)
    assert found.plausible
    assert found.loads.sum() == pytest.approx((8420 + 24000) * 9.81, rel=1e-3)


def test_every_number_has_a_place():
    assert all(p.place.startswith("5") and p.theirs > 0 for p in PUBLISHED)
