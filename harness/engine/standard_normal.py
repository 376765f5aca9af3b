"""NumPy's standard normal numbers of many seeds at once, to the same bits and without an object for each seed.

Lane by lane they are those of ``default_rng(SeedSequence(entropy, spawn_key=key)).standard_normal(shape)``: seeds are
hashed by O'Neill's ``seed_seq`` as NumPy has it, PCG64 is the XSL-RR generator of 128 bits (O'Neill 2014,
HMC-CS-2014-0905), and its words become normal numbers by the ziggurat of Marsaglia and Tsang (2000, J. Stat. Softw.
5(8)) with 256 layers, whose tables numba has as NumPy has them. For a short run NumPy takes half as long to make its
objects as to draw the numbers, and each number waits for the one before; lanes do not wait for each other.
"""

from __future__ import annotations

import functools
from types import ModuleType
from typing import Any

import numpy as np
from llvmlite import ir
from numba import types
from numba.extending import intrinsic
from numba.np.random._constants import fi_double, ki_double, wi_double, ziggurat_nor_inv_r, ziggurat_nor_r
from numpy.typing import ArrayLike, NDArray

from harness.engine.compile import load_source
from harness.engine.kernel_source import kernel_source
from harness.engine.simd.lanes import LANES

TAIL, TAIL_INVERSE = float(ziggurat_nor_r), float(ziggurat_nor_inv_r)
"""Where the tail of the lowest layer begins, and one over it."""

MULTIPLIER_HIGH, MULTIPLIER_LOW = 2549297995355413924, 4865540595714422341
"""Upper and lower half of PCG64's multiplier."""

POOL = 4
"""32-bit words in which a seed is mixed."""

ALL_32 = 0xFFFFFFFF

_I64, _I128 = ir.IntType(64), ir.IntType(128)


@intrinsic
def upper_half(typingctx: Any, a: Any, b: Any) -> Any:
    """Return the upper 64 bits of the product of two words."""

    def generate(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        product = builder.mul(*(builder.zext(each, _I128) for each in args))
        return builder.trunc(builder.lshr(product, ir.Constant(_I128, 64)), _I64)

    return types.uint64(types.uint64, types.uint64), generate


def hashed(value, constant, multiplier):
    """Return a word of 32 bits hashed, and the next constant."""
    value = value ^ constant
    constant = (constant * np.uint64(multiplier)) & np.uint64(ALL_32)
    value = (value * constant) & np.uint64(ALL_32)
    return value ^ (value >> np.uint64(16)), constant


def mixed(a, b):
    """Return two words of 32 bits as one."""
    value = (np.uint64(0xCA01F9DD) * a - np.uint64(0x4973F715) * b) & np.uint64(ALL_32)
    return value ^ (value >> np.uint64(16))


def begin(words, state):
    """Write the state of PCG64 that NumPy begins with.

    Args:
        words: From ``seed_words`` ``(1 + words,)``.
        state: Upper and lower half of the state, then of the increment, written ``(4,)``.
    """
    pool, seeds, constant = np.empty(POOL, np.uint64), np.empty(8, np.uint64), np.uint64(0x43B0D7E5)
    for i in range(POOL):
        pool[i], constant = hashed(words[1 + i], constant, 0x931E8875)
    for source in range(POOL):
        for i in range(POOL):
            if i != source:
                value, constant = hashed(pool[source], constant, 0x931E8875)
                pool[i] = mixed(pool[i], value)
    for source in range(POOL, np.int64(words[0])):
        for i in range(POOL):
            value, constant = hashed(words[1 + source], constant, 0x931E8875)
            pool[i] = mixed(pool[i], value)
    constant = np.uint64(0x8B51F9DD)
    for i in range(8):
        seeds[i], constant = hashed(pool[i % POOL], constant, 0x58F38DED)
    low, high = seeds[6] | (seeds[7] << np.uint64(32)), seeds[4] | (seeds[5] << np.uint64(32))
    state[2] = (high << np.uint64(1)) | (low >> np.uint64(63))
    state[3] = (low << np.uint64(1)) | np.uint64(1)
    # From zero the first step leads to the increment; then the seed is added.
    state[1] = state[3] + (seeds[2] | (seeds[3] << np.uint64(32)))
    state[0] = state[2] + (seeds[0] | (seeds[1] << np.uint64(32))) + np.uint64(state[1] < state[3])
    draw(state)


def draw(state):
    """Return a random word of 64 bits and step the generator."""
    high, low = state[0], state[1]
    by_high, by_low = np.uint64(MULTIPLIER_HIGH), np.uint64(MULTIPLIER_LOW)
    product = low * by_low
    state[1] = product + state[3]
    state[0] = upper_half(low, by_low) + high * by_low + low * by_high + state[2] + np.uint64(state[1] < product)
    folded, turn = state[0] ^ state[1], state[0] >> np.uint64(58)
    return (folded >> turn) | (folded << ((np.uint64(64) - turn) & np.uint64(63)))


def uniform(state):
    """Return a number in [0, 1)."""
    return np.float64(draw(state) >> np.uint64(11)) * (1.0 / 9007199254740992.0)


def refused(word, state, widths, inside, heights):
    """Return the normal number of a word that lies outside its layer's rectangle, with as many more as it takes."""
    while True:
        layer, at = word & np.uint64(0xFF), (word >> np.uint64(9)) & np.uint64(0x000FFFFFFFFFFFFF)
        x = np.float64(np.int64(at)) * widths[layer]
        if (word >> np.uint64(8)) & np.uint64(1):
            x = -x
        if at < inside[layer]:
            return x
        if layer == 0:
            while True:
                beyond = -TAIL_INVERSE * np.log1p(-uniform(state))
                height = -np.log1p(-uniform(state))
                if height + height > beyond * beyond:
                    return -(TAIL + beyond) if (at >> np.uint64(8)) & np.uint64(1) else TAIL + beyond
        below, above = heights[layer - np.uint64(1)], heights[layer]
        if (below - above) * uniform(state) + above < np.exp(-0.5 * x * x):
            return x
        word = draw(state)


def fill(words, widths, inside, heights, numbers):
    """Write standard normal numbers.

    Args:
        words: Of the seed of each lane ``(batches * lanes, 1 + words)``, see ``seed_words``.
        widths: Of the layers, over the largest word ``(256,)``.
        inside: Words below these lie inside the rectangle of their layer ``(256,)``.
        heights: Of the density at the layers' edges ``(256,)``.
        numbers: Written ``(batches, samples, width, lanes)``.
    """
    batches, samples, width, lanes = numbers.shape
    states = np.empty((lanes, 4), np.uint64)
    for b in range(batches):
        for lane in range(lanes):
            begin(words[b * lanes + lane], states[lane])
        for k in range(samples):
            for i in range(width):
                for lane in range(lanes):
                    word = draw(states[lane])
                    layer, at = word & np.uint64(0xFF), (word >> np.uint64(9)) & np.uint64(0x000FFFFFFFFFFFFF)
                    x = np.float64(np.int64(at)) * widths[layer]
                    if at < inside[layer]:
                        numbers[b, k, i, lane] = -x if (word >> np.uint64(8)) & np.uint64(1) else x
                    else:
                        numbers[b, k, i, lane] = refused(word, states[lane], widths, inside, heights)


def seed_words(entropy: int, keys: ArrayLike) -> NDArray[np.uint64]:
    """Return what NumPy's SeedSequence mixes of seeds that share their entropy.

    Args:
        entropy: Not negative.
        keys: Spawn keys, numbers below 2**64 ``(seeds, numbers)``.

    Returns:
        For each seed, how many words of 32 bits it has, and these, with zeros behind ``(seeds, 1 + words)``.
    """
    begun = _words_of(entropy)
    begun += [0] * (POOL - len(begun))
    rows = np.asarray(keys, dtype=np.uint64)
    if np.all(rows <= ALL_32):
        begun = [len(begun) + rows.shape[1], *begun]
        return np.concatenate([np.tile(np.array(begun, dtype=np.uint64), (len(rows), 1)), rows], axis=1)
    words = [begun + [word for number in row for word in _words_of(int(number))] for row in rows]
    table = np.zeros((len(words), 1 + max(map(len, words))), dtype=np.uint64)
    for row, each in zip(table, words, strict=True):
        row[0], row[1 : 1 + len(each)] = len(each), each
    return table


def _words_of(number: int) -> list[int]:
    """Return a number as words of 32 bits, the lowest first, at least one."""
    words = [number & ALL_32]
    while number := number >> 32:
        words.append(number & ALL_32)
    return words


def standard_normal(words: NDArray[np.uint64], samples: int, width: int) -> NDArray[np.float64]:
    """Return standard normal numbers ``(samples, width, LANES)``, of several batches with their axis in front.

    Args:
        words: Of the seed of each lane, from ``seed_words`` ``(LANES, 1 + words)``; of several batches all rows.
        samples: Of each lane.
        width: Numbers of a sample.
    """
    numbers = np.empty((len(words) // LANES, samples, width, LANES))
    _compiled().fill(words, wi_double, ki_double, fi_double, numbers)
    return numbers if len(numbers) > 1 else numbers[0]


@functools.cache
def _compiled() -> ModuleType:
    return load_source("standard_normal", kernel_source("standard_normal", [fill]))
