"""Kernels of tests that are printed as C, each with an idiom that a translation may get wrong; and some it refuses."""

import numpy as np

from harness.engine.kernel_names import (
    LANES,
    Belief,
    any_of,
    exp,
    get,
    is_nan,
    log,
    maximum,
    put,
    select,
    splat,
    sqrt,
    tanh,
)

TABLE = np.array([[2, -1, 0], [1, 0, -1]])
WEIGHTS = np.array([0.5, -0.25, 2.0])


def swapped(x, y):
    a, b = get(x, 0), get(x, 1)
    for i in range(5):
        a, b = b, a + 0.1 * b
        put(a - b, y, i)


def first_alone(x, y):
    total = 0
    for i in range(4):
        total = total + get(x, i)
        if i == 2:
            continue
        total = 2.0 * total
    put(total, y, 0)
    put(WEIGHTS[2] * total, y, 1)


def over_a_table(x, y):
    for a in range(2):
        total = splat(0.0)
        for c in range(TABLE.shape[1]):
            j = TABLE[a, c]
            if j < 0:
                break
            total = total + WEIGHTS[j] * get(x, j)
        put(total, y, a)


def behind_zero(x, y):
    for s in range(5):
        put(get(x, (s - 1) % 4), y, s)


def sign_of(value):
    if any_of(value > 0.0):
        return splat(1.0)
    if any_of(is_nan(value)):
        return value
    return splat(-1.0)


def early(x, y):
    for i in range(4):
        put(sign_of(get(x, i)), y, i)


def rows(x):
    first = np.zeros((2, 2, LANES))
    put(get(x, 0), first, 0, 1)
    put(get(x, 3), first, 1, 0)
    return first, first[1]


def made_within(x, y):
    whole, row = rows(x)
    other, _ = rows(y)
    put(get(whole, 0, 1) + get(row, 0), y, 0)
    put(get(other, 0, 1) - get(whole, 0, 0), y, 1)


def followed(x, y):
    before = x
    for i in range(3):
        put(get(before, i) + 1.0, y, i + 1)
        before = y


def halves(x):
    return x[:2], x[2:4]


def cut(x, y):
    upper, lower = halves(x)
    square = x[:4].reshape((2, 2, LANES))
    put(get(upper, 1) * get(lower, 0), y, 0)
    put(get(square, 1, 0) / get(square, 0, 1), y, 1)


def elementary(x, y):
    put(exp(get(x, 0)), y, 0)
    put(log(get(x, 1) * get(x, 1)), y, 1)
    put(tanh(get(x, 2)), y, 2)
    put(sqrt(maximum(get(x, 3), splat(0.0))), y, 3)
    put(exp(800.0 * get(x, 1)), y, 4)


def by_field(x, y):
    belief = Belief(x, y, x, WEIGHTS)
    some = False
    for i in range(4):
        some = some or any_of(get(belief.constants, i) > 0.5)
        if some and i != 1:
            put(select((get(x, i) > 0.0) & ~(get(x, 0) > 1.0), belief.tuning[0], -np.inf), belief.process_noise, i)
    k = int(WEIGHTS[2]) + len_of(x) // 2
    put(1.0 * k, y, 4)


def len_of(x):
    return x.shape[0]


def damped(value, count):
    for _ in range(count):
        value = 0.5 * value
    return value


def parameters_assigned(x, y):
    put(damped(get(x, 0), 3) + damped(2, 2), y, 0)


def count_up(x):
    put(get(x, 0) + 1.0, x, 0)
    return get(x, 0)


def in_order(x, y):
    room = np.zeros((2, LANES))
    put(get(room, 0) + 10.0 * count_up(room) + get(room, 0), y, 0)
    a, b = get(room, 0), count_up(room)
    put(a - b, y, 1)
    put(maximum(get(room, 0), count_up(room) - 5.0), y, 2)


def counters(x, y):
    for i in range(3):
        put(get(x, i), y, i)
    i = get(x, 0)
    for k in range(2):
        i = i + get(x, k)
    put(i, y, 4)


def copied(x, y):
    put(get(x, 1), y, 0)
    return get(x, 2)


def branched(x, y):
    total = splat(-5.0)
    if any_of(get(x, 0) > 0.0):
        total = maximum(total, copied(x, y))
        put(2.0 * total, y, 1)
    put(total, y, 2)


KERNELS = (
    parameters_assigned, in_order, counters,
    swapped, first_alone, over_a_table, behind_zero, early, made_within, followed, cut, elementary, by_field, branched,
)  # fmt: skip


def again(x, y):
    again(x, y)


def as_long_as(x, y):
    while get(x, 0) > 0.0:
        put(splat(0.0), y, 0)


def of_unknown_size(x, y):
    n = int(get(x, 0))
    room = np.empty((n, LANES))
    put(get(x, 0), room, 0)


def of_numpy(x, y):
    put(np.arctan2(1.0, 2.0), y, 0)


def writes_a_table(x, y):
    WEIGHTS[0] = 1.0


def listed(x, y):
    put(sum([get(x, i) for i in range(2)]), y, 0)


REFUSED = {
    again: "'again' calls itself",
    as_long_as: "line 2 has 'while",
    of_unknown_size: "are not known before it runs",
    of_numpy: "'np.arctan2', for which there is no C",
    writes_a_table: "assigns to 'WEIGHTS",
    listed: "'sum', for which there is no C",
}
