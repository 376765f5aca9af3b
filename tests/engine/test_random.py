"""Random numbers in lanes: the integers against a reference, the distributions against statistics."""

import numpy as np
import pytest
from numba import njit
from scipy import stats

from harness.engine.simd.lanes import LANES, get, put
from harness.engine.simd.random import generator_words, next_words, normal_pair, uniform

SEEDS = [np.random.SeedSequence(7, spawn_key=(lane,)) for lane in range(LANES)]
DRAWS = 40_000


@njit(error_model="numpy")
def fill(memory, words, flat, normals):
    s0, s1 = get(memory, 0), get(memory, 1)
    for k in range(words.shape[0]):
        word, s0, s1 = next_words(s0, s1)
        put(word, words, k)
        put(uniform(word), flat, k)
        first, second = normal_pair(word)
        put(first, normals, 2 * k)
        put(second, normals, 2 * k + 1)
    put(s0, memory, 0)
    put(s1, memory, 1)


def draw(memory, count):
    words, flat, normals = np.empty((count, LANES)), np.empty((count, LANES)), np.empty((2 * count, LANES))
    fill(memory, words, flat, normals)
    return words.view(np.uint64), flat, normals


@pytest.fixture(scope="module")
def drawn():
    return draw(generator_words(SEEDS), DRAWS)


def reference(s0, s1, count):
    """xoroshiro128+ 1.0 of Blackman and Vigna, as published in C."""
    mask = (1 << 64) - 1
    rotate = lambda x, k: ((x << k) | (x >> (64 - k))) & mask  # noqa: E731
    for _ in range(count):
        yield (s0 + s1) & mask
        s1 ^= s0
        s0 = rotate(s0, 24) ^ s1 ^ ((s1 << 16) & mask)
        s1 = rotate(s1, 37)


def test_words_are_those_of_the_reference(drawn):
    for lane, seed in enumerate(SEEDS):
        s0, s1 = (int(w) for w in seed.generate_state(2, np.uint64))
        assert [int(w) for w in drawn[0][:2000, lane]] == list(reference(s0, s1, 2000))


def test_the_stream_goes_on_where_it_stopped(drawn):
    memory = generator_words(SEEDS)
    parts = [draw(memory, count)[0] for count in (10, 1, 89)]
    np.testing.assert_array_equal(np.concatenate(parts), drawn[0][:100])


def test_normal_pairs_are_box_and_muller_of_the_word(drawn):
    words, _, normals = drawn
    radius = np.sqrt(-2 * np.log(((words >> np.uint64(33)).astype(float) + 0.5) / 2.0**31))
    angle = (words & np.uint64(0xFFFFFFFF)).astype(float) * (2 * np.pi / 2.0**32)
    # a radius near zero comes from a number near one, which single precision rounds to 2^-24
    assert np.abs(normals[1::2] - radius * np.cos(angle)).max() < 4e-4
    assert np.abs(normals[0::2] - radius * np.sin(angle)).max() < 4e-4
    away = radius > 0.01
    assert np.abs(normals[1::2] - radius * np.cos(angle))[away].max() < 5e-6
    assert np.abs(normals[0::2] - radius * np.sin(angle))[away].max() < 5e-6


@njit(error_model="numpy")
def pair_of(words, out):
    first, second = normal_pair(get(words, 0))
    put(first, out, 0)
    put(second, out, 1)


def test_the_ends_of_the_range_are_finite():
    out = np.empty((2, LANES))
    words = np.zeros((1, LANES), dtype=np.uint64)
    words[0, :4] = [0, 2**64 - 1, 2**63, 2**32 - 1]
    pair_of(words.view(float), out)
    assert np.isfinite(out).all()
    assert np.hypot(*out[:, 0]) == pytest.approx(np.sqrt(64 * np.log(2)), rel=1e-6)  # the longest: 6.66
    assert np.hypot(*out[:, 1]) < 1e-3


def test_uniform_numbers(drawn):
    flat = drawn[1]
    assert flat.min() > 0.0
    assert flat.max() < 1.0
    for lane in range(LANES):
        assert stats.kstest(flat[:, lane], "uniform").pvalue > 1e-4


def test_normal_numbers(drawn):
    normals = drawn[2]
    n = normals.size
    for power, expected, variance in ((1, 0, 1), (2, 1, 2), (3, 0, 15), (4, 3, 96), (6, 15, 10170)):
        assert abs(np.mean(normals**power) - expected) < 4.5 * np.sqrt(variance / n), power
    for lane in range(LANES):
        assert stats.kstest(normals[:, lane], "norm").pvalue > 1e-4
    for limit in (2.5, 3.5):
        beyond, expected = np.sum(np.abs(normals) > limit), 2 * stats.norm.sf(limit) * n
        assert abs(beyond - expected) < 4.5 * np.sqrt(expected), limit


def test_lanes_and_successive_numbers_are_independent(drawn):
    _, flat, normals = drawn
    for values in (flat - 0.5, normals, normals**2 - 1):
        scaled = values / values.std()
        n = len(scaled)
        between = scaled.T @ scaled / n
        assert np.abs(between[~np.eye(LANES, dtype=bool)]).max() < 5 / np.sqrt(n)
        for lag in (1, 2, 3, 11, 12):
            along = np.mean(scaled[lag:] * scaled[:-lag], axis=0)
            assert np.abs(along).max() < 5 / np.sqrt(n), lag


def test_low_bits_of_the_uniform_numbers_are_even(drawn):
    counts = np.bincount((drawn[0] >> np.uint64(12)).ravel() & np.uint64(0xFF), minlength=256)
    assert stats.chisquare(counts).pvalue > 1e-4


def test_seeds():
    words = generator_words(SEEDS).view(np.uint64)
    assert len(np.unique(words)) == 2 * LANES
    with pytest.raises(ValueError, match=f"one seed for each of {LANES} lanes, got 3"):
        generator_words(SEEDS[:3])
    np.testing.assert_array_equal(words, generator_words(SEEDS).view(np.uint64))
