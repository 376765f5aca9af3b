"""Number of delays that a NARX model needs, by the Lipschitz indices of He and Asada (1993).

If a regressor holds all that an output depends on, the quotient ``|y_i - y_j| / |x_i - x_j|`` is bounded; if a variable
is missing, samples with nearly equal regressors differ in the output and the quotient grows without bound. The index of
a regressor of n variables is the geometric mean of the p largest quotients times ``sqrt(n)``; where it stops falling,
the regressor is complete.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from harness.common.arrays import Floats
from harness.common.errors import UserError
from harness.estimation.narx_network import scaled

SHARE = 0.015
"""Quotients in the mean as a share of the samples; He and Asada take 1 to 2 %."""

_ROWS = 256


def lipschitz_index(x: Floats, y: Floats, share: float = SHARE) -> float:
    """Return the Lipschitz index of one regressor.

    Args:
        x: Regressors ``(samples, n)``, scaled alike.
        y: Output ``(samples,)``.
        share: Quotients in the mean, as a share of the samples.

    Raises:
        UserError: If there are fewer than ten samples.
    """
    samples, n = x.shape
    if samples < 10:
        raise UserError(f"{samples} samples are too few for a Lipschitz index; give at least 10")
    count = max(1, round(share * samples))
    largest = np.empty(0)
    for start in range(0, samples, _ROWS):
        rows = slice(start, start + _ROWS)
        squares = np.zeros((len(x[rows]), samples))
        for column in x.T:
            squares += (column[rows, None] - column) ** 2
        rise = np.abs(y[rows, None] - y)
        later = np.arange(samples) > np.arange(samples)[rows, None]  # every pair once
        different = later & (squares > 0)  # two equal regressors say nothing of a continuous function
        quotients = rise[different] / np.sqrt(squares[different])
        largest = np.concatenate([largest, quotients])
        if len(largest) > count:
            largest = np.partition(largest, len(largest) - count)[-count:]
    with np.errstate(divide="ignore"):
        return float(np.exp(np.mean(np.log(np.sqrt(n) * largest))))


@dataclass(frozen=True)
class Indices:
    """Lipschitz indices of one drive and output over growing regressors.

    Attributes:
        drive: Name of the drive.
        output: Name of the output.
        delays: Delays ``(of the inputs, of the output)`` of each regressor.
        values: Index of each.
    """

    drive: str
    output: str
    delays: tuple[tuple[int, int], ...]
    values: Floats


def growing(largest: int) -> tuple[tuple[int, int], ...]:
    """Return the delays in the order they are added: inputs and output in turn, inputs first (Ziaukas 5.2.2)."""
    return tuple((n - n // 2, n // 2) for n in range(1, 2 * largest + 1))


def indices(
    inputs: Floats,
    output: Floats,
    largest: int = 4,
    samples: int = 1500,
    names: Sequence[str] = ("", ""),
) -> Indices:
    """Return the Lipschitz indices of one output of a drive over growing regressors.

    Args:
        inputs: ``(samples, inputs)``; each is scaled to [-1, 1] over the drive, a constant one is left out.
        output: ``(samples,)``.
        largest: Most delays of inputs and output.
        samples: Time points compared, spread evenly over the drive.
        names: Of drive and output.

    Raises:
        UserError: If the drive has too few samples for the delays.
    """
    if len(output) < largest + 10:
        raise UserError(f"{len(output)} samples are too few for {largest} delays and a Lipschitz index")
    moving = inputs[:, np.ptp(inputs, axis=0) > 0]
    z, t = _scaled(moving), _scaled(output[:, None])
    at = np.unique(np.linspace(largest, len(output) - 1, samples).astype(int))
    quotients = []
    for n_id, n_fd in growing(largest):
        past = [z[at - m] for m in range(1, n_id + 1)] + [t[at - m] for m in range(1, n_fd + 1)]
        quotients.append(lipschitz_index(np.concatenate(past, axis=1), t[at, 0]))
    return Indices(names[0], names[1], growing(largest), np.array(quotients))


def _scaled(values: Floats) -> Floats:
    return scaled(values, np.column_stack([values.min(axis=0), values.max(axis=0)]))
