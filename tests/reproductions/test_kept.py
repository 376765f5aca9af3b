"""Parts of a long reproduction: kept whole, read again, refused where other code or settings made them."""

from types import SimpleNamespace

import numpy as np
import pytest

from harness.common.errors import UserError
from reproductions import narx_architecture
from reproductions.kept import Parts, state_of
from reproductions.narx.training import Plan


def test_a_part_is_computed_once(tmp_path):
    parts, calls = Parts(tmp_path / "parts"), []

    def compute():
        calls.append(1)
        return {"value": np.arange(3.0), "count": 7}

    first, there = parts.made("a", "s", compute)
    again, there_again = parts.made("a", "s", compute)
    assert (there, there_again, len(calls)) == (False, True, 1)
    np.testing.assert_array_equal(again["value"], np.arange(3.0))
    assert int(again["count"]) == 7 == int(first["count"])
    assert parts.get("b", "s") is None


def test_other_settings_and_damage_are_refused(tmp_path):
    parts = Parts(tmp_path)
    parts.put("a", state_of({"particles": 40}, 1), {"value": 1.0})
    with pytest.raises(UserError, match="other code or with other settings"):
        parts.get("a", state_of({"particles": 41}, 1))
    (tmp_path / "a.npz").write_bytes((tmp_path / "a.npz").read_bytes()[:40])
    with pytest.raises(UserError, match=r"a\.npz: is damaged .* delete it"):
        parts.get("a", state_of({"particles": 40}, 1))


def test_a_state_depends_on_each_of_its_parts_and_their_order():
    assert len({state_of("a", "b"), state_of("b", "a"), state_of("ab"), state_of(b"a", "b"), state_of("a")}) == 5


def test_finished_architectures_are_kept(tmp_path, monkeypatch, capsys):
    trained = []

    errors = SimpleNamespace(one_step={"test": np.array([0.25, 0.5])}, free={"test": np.array([1.0, 2.0])})

    def candidates(data, plan, count, seed, jobs):
        trained.append((plan.neurons, count))
        if plan.neurons == (2, 2) and len(trained) == 2:
            raise KeyboardInterrupt
        return [SimpleNamespace(open_loop=errors, score=1.5)] * count

    monkeypatch.setattr(narx_architecture, "candidates", candidates)
    given = ({}, Plan(), {(1, 4): 2, (2, 2): 3}, 1, 1, Parts(tmp_path), "code")
    with pytest.raises(KeyboardInterrupt):
        narx_architecture.search(*given)
    found = narx_architecture.search(*given)
    assert trained == [((4,), 2), ((2, 2), 3), ((2, 2), 3)]
    np.testing.assert_array_equal(found[1, 4], [[0.75] * 2, [3.0] * 2, [1.5] * 2])
    assert found[2, 2].shape == (3, 3)
    assert "1 x 4, 2 trainings, kept from before" in capsys.readouterr().err
