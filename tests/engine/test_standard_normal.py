"""The compiled standard normal numbers are NumPy's, to the bit, whatever the seed."""

import numpy as np
import pytest

from harness.engine.simd.lanes import LANES
from harness.engine.standard_normal import seed_words, standard_normal

KEYS = [(0, k, 3) for k in range(LANES)]


def by_numpy(entropy, key, shape):
    return np.random.default_rng(np.random.SeedSequence(entropy, spawn_key=key)).standard_normal(shape)


@pytest.mark.parametrize(
    ("entropy", "keys"),
    [
        (0, KEYS),
        (2**32, [(k, 0, 1_000_000, 0xDEADBEEF, 1) for k in range(LANES)]),
        (2**128 + 17, [(k,) for k in range(LANES)]),
        (5, [(2**32 - 1, 2**32 + k * 2**31, 2**63 + 1) for k in range(LANES)]),
        (7, [()] * LANES),
    ],
)
def test_every_lane_has_the_numbers_of_its_seed(entropy, keys):
    found = standard_normal(seed_words(entropy, keys), 200, 3)
    for lane, key in enumerate(keys):
        np.testing.assert_array_equal(found[..., lane], by_numpy(entropy, key, (200, 3)))


def test_numbers_of_the_tail_and_of_the_wedges_are_the_same():
    found = standard_normal(seed_words(1, KEYS), 200_000, 1)
    expected = np.stack([by_numpy(1, key, (200_000, 1)) for key in KEYS], axis=-1)
    assert (np.abs(expected) > 3.66).sum() > 100  # beyond the lowest layer, by logarithms
    np.testing.assert_array_equal(found, expected)


def test_entropy_of_more_words_than_the_pool_is_mixed_in_full():
    keys = [(4,)] * LANES
    one, other = (standard_normal(seed_words(e, keys), 4, 1)[..., 0] for e in (2**160, 2**160 + 2**130))
    np.testing.assert_array_equal(one, by_numpy(2**160, (4,), (4, 1)))
    assert not np.array_equal(one, other)
