"""Interacting multiple models: against the algorithm written out, and on a mass that it has to find."""

import numpy as np
import pytest
from scipy import stats

from harness.common.errors import UserError
from harness.estimation.compiled_estimator import CompiledEstimator
from support.oscillator import P0, STEP, VALUES, Q, R, compiled, drive, mass, push, run

F = np.eye(3) + STEP * np.array([[0, 1, 0], [-4, -1.5, 1], [0, 0, 0]])
B = STEP * np.array([0, 1, 0])
H = np.array([[1.0, 0, 0]])
PUSHES, DWELL = [-1.0, 0.5, 3.5], 20.0


def cells(values):
    """Return what values stand for: mean square distance from them and width."""
    gaps = np.diff(values) / 2
    below, above = np.append(gaps[0], gaps), np.append(gaps, gaps[-1])
    return [(b**3 + a**3) / (3 * (b + a)) for b, a in zip(below, above, strict=True)], below + above


def textbook(u, y, prior, estimated):
    """Blom and Bar-Shalom's algorithm over filters of ``[x, d]``, d being the push less what is believed.

    Where another hypothesis held before, ``d`` is that of the new one, distributed over its cell.
    """
    squares, widths = cells(PUSHES)
    z = np.array(PUSHES) - 0.3
    stay, count = np.exp(-STEP / DWELL), len(z)
    change = np.full((count, count), (1 - stay) / (count - 1)) + np.eye(count) * (stay - (1 - stay) / (count - 1))
    weights = np.exp(-0.5 * z**2 / prior**2) * widths
    weights /= weights.sum()
    x = [np.array([0, 0, each]) for each in z]
    P = [np.diag([*P0, square]) for square in squares]
    means, covariances, likelihoods, nis = [], [], [], []
    for k in range(1, len(y)):
        if k > 1:
            chance = change.T @ weights
            mixed = []
            for j in range(count):
                share = change[:, j] * weights / chance[j]
                anew = [(np.append(m[:2], z[j]), np.array(p)) for m, p in zip(x, P, strict=True)]
                for i, (_, p) in enumerate(anew):
                    if i == j:
                        anew[i] = x[j], P[j]
                    else:
                        p[2, :2] = p[:2, 2] = 0.0
                        p[2, 2] = squares[j]
                mean = sum(s * m for s, (m, _) in zip(share, anew, strict=True))
                V = sum(s * (p + np.outer(m - mean, m - mean)) for s, (m, p) in zip(share, anew, strict=True))
                mixed.append((mean, V))
            weights, (x, P) = chance, (list(each) for each in zip(*mixed, strict=True))
        seen, logs, predictions, spreads = not np.isnan(y[k, 0]), [], [], []
        for j in range(count):
            m, V = F @ x[j] + B * (u[k - 1, 0] + 0.3), F @ P[j] @ F.T + np.diag([*Q, 0])
            S = (H @ V @ H.T + R).item()
            predictions.append(m[0])
            spreads.append(S)
            logs.append(stats.norm.logpdf(y[k, 0], m[0], S**0.5) if seen else 0.0)
            K = V @ H.T / S * seen
            if not estimated:
                K[2] = 0.0
            x[j] = m + K[:, 0] * (np.nan_to_num(y[k, 0]) - m[0])
            P[j] = (np.eye(3) - K @ H) @ V @ (np.eye(3) - K @ H).T + K @ K.T * R
        centre = weights @ predictions
        spread = weights @ (np.array(spreads) + (np.array(predictions) - centre) ** 2)
        nis.append((y[k, 0] - centre) ** 2 / spread if seen else 0.0)
        joint = weights * np.exp(logs)
        likelihoods.append(np.log(joint.sum()) if seen else 0.0)
        weights = joint / joint.sum()
        mean = sum(w * each for w, each in zip(weights, x, strict=True))
        means.append(mean)
        covariances.append(sum(w * (p + np.outer(e - mean, e - mean)) for w, p, e in zip(weights, P, x, strict=True)))
    return np.array(means), np.array(covariances), np.array(likelihoods), np.array(nis)


@pytest.mark.parametrize("estimated", [True, False])
def test_it_is_the_algorithm_of_blom_and_bar_shalom(estimated):
    u, y = drive({**VALUES, "push": 1.6}, samples=200)
    y[20:40] = np.nan
    infos = []
    bank = {"hypotheses": {"push": PUSHES[::-1]}, "dwell": f"{DWELL} s", "estimated": estimated}
    means, covariances = run("imm", compiled(push()), u, y, [0.0], bank, infos=infos)
    right, P, likelihoods, nis = textbook(u, y, 2.0, estimated)
    np.testing.assert_allclose(means[1:], right, atol=1e-9)
    np.testing.assert_allclose(covariances[1:], P, atol=1e-9)
    np.testing.assert_allclose([i.log_likelihood[0, 0] for i in infos], likelihoods, atol=1e-9)
    np.testing.assert_allclose([i.nis[0, 0] for i in infos], nis, atol=1e-9)


def test_one_hypothesis_is_the_filter_that_considers_or_estimates():
    u, y = drive({**VALUES, "push": 1.6})
    for estimated in (True, False):
        one = run("imm", compiled(push()), u, y, [0.0], {"hypotheses": {"push": ["0.3 m"]}, "estimated": estimated})
        alone = run("ekf", compiled(push(considered=not estimated)), u, y, [0.0])
        for a, b in zip(one, alone, strict=True):
            np.testing.assert_allclose(a, b, atol=1e-9)


BANK = {"mass": ["500 g", "1 kg", "2 kg", "4 kg"]}


@pytest.mark.parametrize(("true", "nearest"), [(1.0, 1.0), (1.8, 2.0), (4.0, 4.0)])
def test_considering_it_finds_the_hypothesis_that_is_nearest(true, nearest):
    u, y = drive({**VALUES, "mass": true}, samples=1500, excitation=4.0)
    means, covariances = run("imm", compiled(mass()), u, y, [0.0], {"hypotheses": BANK, "estimated": False})
    assert np.exp(means[-1, 2]) == pytest.approx(nearest, rel=0.1)
    assert np.log(true / nearest) ** 2 < 4 * covariances[-1, 2, 2]


@pytest.mark.parametrize("true", [0.6, 1.4, 2.8])
def test_estimating_it_finds_what_is_between_hypotheses(true):
    u, y = drive({**VALUES, "mass": true}, samples=1500, excitation=4.0)
    means, covariances = run("imm", compiled(mass()), u, y, [0.0], {"hypotheses": BANK})
    assert np.exp(means[-1, 2]) == pytest.approx(true, rel=0.1)
    assert (means[-1, 2] - np.log(true)) ** 2 < 9 * covariances[-1, 2, 2]


def test_it_follows_a_load_that_is_dropped():
    before = drive({**VALUES, "mass": 4.0}, samples=1000, excitation=4.0)
    behind = drive({**VALUES, "mass": 1.0}, samples=1000, excitation=4.0, seed=6)
    u, y = (np.concatenate(pair) for pair in zip(before, behind, strict=True))
    means, _ = run("imm", compiled(mass()), u, y, [0.0], {"hypotheses": BANK, "dwell": 60})
    assert np.exp(means[999, 2]) == pytest.approx(4.0, rel=0.1)
    assert np.exp(means[-1, 2]) == pytest.approx(1.0, rel=0.1)


@pytest.mark.parametrize(
    ("settings", "says"),
    [
        ({}, "state values of 'mass', which the belief has in unknown_parameters"),
        ({"hypotheses": {"mas": ["1 kg"]}}, "'mas' is none of the belief's unknown_parameters; closest: mass"),
        ({"hypotheses": {"mass": []}}, "'mass' has no value"),
        ({"hypotheses": {"mass": ["1 kg", "1000 g"]}}, "'mass' has a value twice"),
        ({"hypotheses": {"mass": ["1 m"]}}, "hypotheses: 'mass'"),
        ({"hypotheses": {"mass": [0.0]}}, "cannot be negative needs positive values"),
        ({"hypotheses": {"mass": list(range(1, 66))}}, "65 hypotheses are more than 64"),
        ({"hypotheses": {"mass": [1.0]}, "dwell": "0 s"}, "a time must be positive"),
        ({"hypotheses": {"mass": [1.0]}, "dwel": "1 s"}, "dwel"),
    ],
)
def test_wrong_hypotheses_are_refused(settings, says):
    with pytest.raises(UserError, match=says):
        CompiledEstimator("imm", compiled(mass()), settings)


def test_considered_parameters_are_no_hypotheses():
    with pytest.raises(UserError, match="cannot consider"):
        CompiledEstimator("imm", compiled(mass(considered=True)), {"hypotheses": {"mass": [1.0]}})
