"""Means and covariances of mixtures of normal distributions: what a bank of filters mixes, says and concludes."""

from __future__ import annotations

from harness.engine.kernel_names import NY, any_of, cholesky, get, mahalanobis, put, select, splat

NEGLIGIBLE = 1e-15
"""Share in a mixture up to which a component is left out: what it adds is lost in rounding."""


def normalise(weights):
    """Divide weights ``(M, LANES)`` by their sum."""
    total = splat(0.0)
    for j in range(weights.shape[0]):
        total = total + get(weights, j)
    inverse = 1.0 / total
    for j in range(weights.shape[0]):
        put(get(weights, j) * inverse, weights, j)


def moments(shares, means, covariances, n, mean, P):
    """Write mean and covariance of the first ``n`` components of a mixture.

    What has no share to speak of (``NEGLIGIBLE``) is left out, and may be no number: soon most of a bank.

    Args:
        shares: Probabilities ``(M, LANES)``.
        means: ``(M, nx, LANES)``.
        covariances: ``(M, nx, nx, LANES)``.
        n: Number of components.
        mean: Written ``(nx, LANES)``.
        P: Written ``(nx, nx, LANES)``.
    """
    for a in range(n):
        put(splat(0.0), mean, a)
        for b in range(a + 1):
            put(splat(0.0), P, a, b)
    for i in range(shares.shape[0]):
        share = get(shares, i)
        if any_of(share > NEGLIGIBLE):
            for a in range(n):
                put(get(mean, a) + select(share > NEGLIGIBLE, share * get(means, i, a), 0.0), mean, a)
    for i in range(shares.shape[0]):
        share = get(shares, i)
        if not any_of(share > NEGLIGIBLE):
            continue
        for a in range(n):
            away = get(means, i, a) - get(mean, a)
            for b in range(a + 1):
                value = get(covariances, i, a, b) + away * (get(means, i, b) - get(mean, b))
                put(get(P, a, b) + select(share > NEGLIGIBLE, share * value, 0.0), P, a, b)
    for a in range(n):
        for b in range(a):
            put(get(P, a, b), P, b, a)


def tell(first, chance, predicted, said, rows, info):
    """Add what one filter says of a sample to the sums of the mixture, about the prediction of the first.

    Args:
        first: Whether it is the first filter; what the sums held before is then overwritten.
        chance: Its probability before the sample.
        predicted: Its predicted measurements ``(ny, LANES)``.
        said: Its ``Info``.
        rows: 0 prediction of the first filter, 1 mean of the others' distance from it ``(2, ny, LANES)``.
        info: ``Info`` of the mixture; its innovation covariance holds the sum.
    """
    for a in range(NY):
        if first:
            put(get(predicted, a), rows, 0, a)
            put(splat(0.0), rows, 1, a)
            for b in range(NY):
                put(splat(0.0), info.innovation_covariance, a, b)
        away = get(predicted, a) - get(rows, 0, a)
        put(get(rows, 1, a) + chance * away, rows, 1, a)
        for b in range(a + 1):
            other = get(predicted, b) - get(rows, 0, b)
            value = get(info.innovation_covariance, a, b)
            put(
                value + chance * (get(said.innovation_covariance, a, b) + away * other),
                info.innovation_covariance,
                a,
                b,
            )


def conclude(y, log_likelihood, rows, factor, info):
    """Turn the sums of ``tell`` into innovation, its covariance and NIS of the mixture.

    Args:
        y: Measurements, NaN where missing ``(ny, LANES)``.
        log_likelihood: Of the sample under the mixture.
        rows: As in ``tell``; overwritten.
        factor: Scratch ``(2, ny, ny, LANES)``.
        info: As in ``tell``; written but for repairs.
    """
    S = info.innovation_covariance
    seen = splat(0.0)
    for a in range(NY):
        measured = get(y, a) == get(y, a)
        seen = seen + select(measured, 1.0, 0.0)
        put(get(y, a) - get(rows, 0, a) - get(rows, 1, a), info.innovation, a)
        for b in range(a + 1):
            value = get(S, a, b) - get(rows, 1, a) * get(rows, 1, b)
            put(value, S, a, b)
            put(value, S, b, a)
            # a missing measurement gets a unit variance of its own and an innovation of zero
            value = select(measured & (get(y, b) == get(y, b)), value, 1.0 if a == b else 0.0)
            put(value, factor, 0, a, b)
    for a in range(NY):
        put(select(get(y, a) == get(y, a), get(info.innovation, a), 0.0), rows, 0, a)
    cholesky(factor[0], factor[1], NY)
    put(mahalanobis(factor[1], rows[0], rows[1], NY), info.nis, 0)
    put(select(seen > 0.0, log_likelihood, 0.0), info.log_likelihood, 0)
    put(seen, info.seen, 0)
