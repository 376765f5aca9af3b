"""The discrepancy of a model: estimated where it is there, absent where it is not, and what is asked beside it."""

from types import SimpleNamespace

import numpy as np
import pytest

from harness.diagnosis.fitting import Fitting, KeptFits
from harness.diagnosis.model.augmented_model import MEMORY
from harness.diagnosis.model.hypotheses import random_processes
from harness.diagnosis.selection.candidate_fits import CandidateFits
from harness.diagnosis.selection.discrepancy import first_point, hinges, starts, with_discrepancy
from harness.diagnosis.selection.forward_selection import first_variances
from harness.diagnosis.selection.posterior import shared_horizons
from harness.diagnosis.selection.validation import HeldOut, Judgement, predicts_better
from support.driven_car import FREE, driven

SIZE = 0.05


def fits_of(augmented, recordings):
    drives = [augmented.drive(r, f"drive {i}") for i, r in enumerate(recordings)]
    variances = first_variances(augmented, drives)
    fitting, held_out = Fitting(augmented, drives[:-1], variances), HeldOut(augmented, drives[-1:], variances)
    plain = CandidateFits(fitting, held_out, FREE, lambda _: None, KeptFits())
    return plain, CandidateFits(fitting, held_out, FREE, lambda _: None, KeptFits(), random_processes(augmented))


def test_a_force_that_no_equation_holds_is_estimated_with_its_size(augmented):
    values = {"unmodelled_force": SIZE, "unmodelled_lever": 0.0, MEMORY: 1.0}
    plain, disturbed = fits_of(augmented, [driven(seed, ["unmodelled_force"], **values) for seed in (91, 92)])
    nominal = plain.fit((), plain.fitting.first(), 25)
    whole = with_discrepancy(disturbed, (), nominal)
    assert whole is not None
    at = whole.point.values[:, 0]
    assert at[augmented.row("unmodelled_force")] == pytest.approx(SIZE, rel=0.3)
    assert at[augmented.row(MEMORY)] == 1.0
    assert disturbed.judge((), whole.point).discrepancy
    assert not plain.judge((), nominal.point).discrepancy
    first = first_point(disturbed.fitting, whole.point)
    assert first.values[augmented.row(MEMORY), 0] == at[augmented.row(MEMORY)]
    # With the size that is there the stiffness is known less well than the noise of the sensors alone would say.
    assert (disturbed.fitting.standard_errors(whole)[0]) > 1.5 * plain.fitting.standard_errors(nominal)[0]


def test_a_model_that_is_right_has_none(augmented):
    plain, disturbed = fits_of(augmented, [driven(seed) for seed in (93, 94)])
    nominal = plain.fit((), plain.fitting.first(), 25)
    assert with_discrepancy(disturbed, (), nominal) is None


def test_a_fit_starts_from_every_size_and_memory(augmented):
    point = Fitting(augmented, [augmented.drive(driven(95, duration=25.0), "drive")], np.ones(3)).first()
    points = starts(augmented, point, (0.2, 1.0))
    rows = [augmented.row(n) for n in ("unmodelled_force", MEMORY)]
    assert len({tuple(p.values[rows, 0]) for p in points}) == len(points) == 8
    assert not np.any(point.values[rows[0]])


@pytest.mark.parametrize(("after", "better"), [(1.02, True), (1.2, False)])
def test_beside_a_discrepancy_the_plain_error_must_not_grow(after, better):
    """Its floor may hide any error, so that what counts is the one over the noise of sensors and inputs."""

    def judged(plain):
        return Judgement(0.0, np.zeros(1), np.zeros(1), (), None, plain_excess=plain, discrepancy=True)

    assert predicts_better(judged(after), judged(1.0)) == better


def test_horizons_count_by_their_weights():
    blocks = np.array([[[1.0, 4.0], [2.0, 8.0]]])
    assert shared_horizons(blocks, np.array([3.0, 1.0])) == pytest.approx(np.array([[1.75, 3.5]]))
    unreached = np.array([[[1.0, -np.inf], [2.0, 8.0]]])
    assert shared_horizons(unreached, np.array([3.0, 1.0])) == pytest.approx(np.array([[1.0, 2.0]]))


def test_a_size_hinges_on_the_discrepancy_if_it_leaves_its_interval_without():
    def fit(value):
        coordinates = [SimpleNamespace(name="offset"), SimpleNamespace(name="stiffness")]
        return SimpleNamespace(point=SimpleNamespace(value=lambda c: value), coordinates=coordinates)

    added = [SimpleNamespace(random=False, amplitudes=("offset",))]
    errors = np.array([0.5, 0.5])
    assert hinges(fit(1.0), fit(2.1), errors, added) == ("offset",)
    assert hinges(fit(1.0), fit(1.9), errors, added) == ()
