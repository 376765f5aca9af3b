"""Curves of growth: the exponent is that of the upper end, and the chain of trailers is a chain."""

import pytest

from bench.growth.__main__ import exponent
from bench.growth.road_train import VALUES, road_train
from harness.models.assembly.assemble import symbol


def test_the_exponent_is_that_of_the_largest_sizes():
    sizes = [1, 10, 100, 1000, 10000]
    assert exponent(sizes, [1e6 + n for n in sizes]) < 0.01
    assert exponent(sizes, [5.0, 5.0, *(3.0 * n**1.5 for n in sizes[2:])]) == pytest.approx(1.5)


def test_trailers_follow_a_steady_turn_and_read_the_body_ahead_only():
    model = road_train(12)
    assert len(model.states) == 12
    values = VALUES | {"speed": 10.0, "steering_angle": 0.0, **dict.fromkeys(model.states, 0.0)}
    numbers = {symbol(name): value for name, value in values.items()}
    assert all(float(expr.subs(numbers)) == 0.0 for expr in model.derivatives)
    turning = numbers | {symbol(f"rate_{i}"): 0.1 for i in range(6)}
    by_state = dict(zip(model.states, model.derivatives, strict=True))
    assert all(float(by_state[f"angle_{i}"].subs(turning)) == 0.0 for i in range(1, 6))
    assert float(by_state["rate_3"].subs(turning)) < 0.0  # no angle yet pulls it round
    last = by_state["rate_5"].free_symbols & {symbol(n) for n in model.states}
    assert last == {symbol(n) for n in ("rate_4", "rate_5", "angle_5")}
