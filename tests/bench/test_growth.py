"""Curves of growth: the exponent is that of the upper end, and the chain of trailers is a chain."""

import json
import sys

import pytest

from bench.growth.__main__ import exponent, main
from bench.growth.points import VALUES, road_train
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


@pytest.mark.proof
def test_a_point_is_measured_and_what_is_there_is_drawn(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(sys, "argv", ["bench.growth", "--point", "states, EKF", "4"])
    main()
    seconds, memory = json.loads(capsys.readouterr().out)
    assert seconds > 0
    assert memory > 50
    kept = {"states, EKF": {"4": [seconds, memory], "8": [2 * seconds, memory]}, "states, UKF": {"4": [1.0, 200.0]}}
    kept["workers"] = {str(n): [4.0 / n, 200.0] for n in (1, 2, 4)}
    (tmp_path / "growth.json").write_text(json.dumps(kept), encoding="utf-8")
    monkeypatch.setattr(sys, "argv", ["bench.growth", "--largest", "4", "--out", str(tmp_path)])
    main()
    (row,) = (line for line in capsys.readouterr().out.splitlines() if line.startswith("| states, EKF"))
    assert [cell.strip() for cell in row.split("|")][5] == "1.00"  # the exponent of the time
    assert (tmp_path / "growth.svg").stat().st_size > 1000
