"""The numbers of the boxes are those of the store, and an address says all that is shown."""

from itertools import combinations

import numpy as np
import pytest

import harness as h
from harness.reporting import style
from harness.study.replay import Place
from harness.study.results import read as read_results
from harness.view import looks
from harness.view.boxes import SCORES, boxes
from harness.view.factors import Brush
from harness.view.study_page import PageState, read


@pytest.fixture(scope="module")
def results(folder):
    return read_results(folder)


def test_a_box_holds_the_runs_of_its_level(folder, results):
    design = results.designs[0]
    found = boxes(design, "rmse", 0, [0, 1], None, None)
    assert [(b.across, b.estimator, len(b.values)) for b in found] == [(0, 0, 12), (0, 1, 12), (1, 0, 12), (1, 1, 12)]
    stored = h.open_results(folder)["mass"].rmse.values[..., 0]
    for box in found:
        assert (np.diff(box.values) >= 0).all()
        own = [stored[b, s, d, r, box.estimator] * design.targets[0].scale for b, d, s, r in box.runs]
        np.testing.assert_array_equal(own, box.values)
    assert found[0].quartiles[1] == pytest.approx(np.median(found[0].values))
    assert found[0].values[found[0].nearest(found[0].quartiles[1])] in found[0].values[5:7]


def test_boxes_by_drive_and_of_one_drive(results):
    design = results.designs[0]
    by_drive = boxes(design, "rmse", 0, [1], None, 1)
    assert [(b.across, len(b.values)) for b in by_drive] == [(0, 6), (1, 6)]
    assert {tuple(r[:2]) for b in by_drive for r in b.runs} == {(1, 0), (1, 1)}
    (first, second) = boxes(design, "max_error", 0, [0], 1, None)
    assert {r[1] for b in (first, second) for r in b.runs} == {1}


@pytest.mark.parametrize("score", SCORES)
def test_every_score_has_boxes(results, score):
    found = boxes(results.designs[0], score, 0, [0, 1], None, None)
    assert all(len(b.values) + b.lost == 12 for b in found)
    assert (sum(len(b.values) for b in found) == 0) == (score == "time_of_divergence")


def test_points_are_thinned_by_rank_with_both_ends(results):
    box = boxes(results.designs[0], "rmse", 0, [0], None, None)[0]
    assert list(box.points(100)) == list(range(12))
    assert list(box.points(3))[::2] == [0, 11]


def _asked(query):
    from urllib.parse import parse_qs

    return {
        name: [v.encode() for v in values]
        for name, values in parse_qs(query.lstrip("?"), keep_blank_values=True).items()
    }


def test_an_address_says_what_is_shown(results):
    brush = Brush("0", 1600.0, 1900.0, 0.01, 0.5)
    state = PageState(0, 0, "nis", 1, None, False, (1,), Place(0, 1, 1, 0, 5), (0, 1), brush, {"mass": 1750.5},
                  ("yaw_rate", "lateral_velocity"), ())  # fmt: skip
    assert read(_asked(state.query), results) == state
    assert read({}, results).estimators == (0, 1)


@pytest.mark.parametrize(
    "query",
    ["design=7", "design=-1", "target=x", "score=<b>", "run=0.0.9.0.0", "run=0.0", "estimators=9", "drive=99999999999",
     "run=0.0.0.0.0&plant.mass=nan x", "design=٣", "brush=9,0,1,0,1", "brush=parallel,0,1,nan,1"],
)  # fmt: skip
def test_what_is_not_there_is_not_asked_for(results, query):
    found = read(_asked(query), results)
    assert (found.design, found.target, found.score, found.drive) == (0, 0, "rmse", None)
    assert found.run in (None, Place(0, 0, 0, 0, 0))
    assert found.changes == {}
    assert found.brush is None


def test_lines_of_all_estimators_stand_out_from_white():
    names = ["KF", "EKF", "UKF", "CDKF", "ST-CDKF", "PF", "NARX", "other", "one more", "another"]
    chosen = style.looks(names)
    for look in chosen.values():
        parts = [int(looks.line(look)[i : i + 2], 16) / 255 for i in (1, 3, 5)]
        linear = [p / 12.92 if p <= 0.04045 else ((p + 0.055) / 1.055) ** 2.4 for p in parts]
        assert 1.05 / (0.2126 * linear[0] + 0.7152 * linear[1] + 0.0722 * linear[2] + 0.05) > 2.95
    assert looks.line(chosen["EKF"]) == looks.colour(chosen["EKF"].line)


SEEN = {  # linear RGB as it is seen without one kind of cones (Machado, Oliveira and Fernandes 2009, severity 1.0)
    "protanopia": [[0.152286, 1.052583, -0.204868], [0.114503, 0.786281, 0.099216], [-0.003882, -0.048116, 1.051998]],
    "deuteranopia": [[0.367322, 0.860646, -0.227968], [0.280085, 0.672501, 0.047413], [-0.011820, 0.042940, 0.968881]],
    "tritanopia": [[1.255528, -0.076749, -0.178779], [-0.078411, 0.930809, 0.147602], [0.004733, 0.691367, 0.303900]],
}
XYZ = np.array([[0.4124, 0.3576, 0.1805], [0.2126, 0.7152, 0.0722], [0.0193, 0.1192, 0.9505]])


def lab(colour, seen):
    """Return a colour in CIE 1976 L*a*b* as it is seen."""
    rgb = np.array([int(colour[k : k + 2], 16) for k in (1, 3, 5)]) / 255
    linear = np.where(rgb <= 0.04045, rgb / 12.92, ((rgb + 0.055) / 1.055) ** 2.4)
    ratio = XYZ @ np.clip(np.array(seen) @ linear, 0, 1) / XYZ.sum(axis=1)
    f = np.where(ratio > 0.008856, np.cbrt(ratio), 7.787 * ratio + 16 / 116)
    return np.array([116 * f[1] - 16, 500 * (f[0] - f[1]), 200 * (f[1] - f[2])])


@pytest.mark.parametrize("seen", SEEN.values(), ids=SEEN)
def test_estimators_are_told_apart_without_one_kind_of_cones(seen):
    chosen = list(
        style.looks(["KF", "EKF", "UKF", "CDKF", "ST-CDKF", "PF", "EKF, tuned", "PF, tuned", "NARX"]).values()
    )
    alike = 0
    for one, other in combinations(chosen, 2):
        if np.linalg.norm(lab(looks.line(one), seen) - lab(looks.line(other), seen)) < 12:
            alike += 1
            assert (looks.hatch(one), looks.grain(one)) != (looks.hatch(other), looks.grain(other))
            assert looks.dash(one) != looks.dash(other)
    assert alike  # else colours alone would do, and this tests nothing
