"""``make loop`` in short: one round over drives of the blind plant, judged by the seal; and a trace that is none."""

import json

import pytest

from bench import demonstration
from bench.attribution.run import listed
from bench.attribution.score import score

SHORT = """
title = "What does the model of the semitrailer lack?"
recordings = "results/loop-semitrailer"
step = "10 ms"
rounds = 1
estimators = ["ekf"]
exclude = [{exclude}]
train = [{{ file = "train_a.csv", span = ["0 s", "60 s"] }}]
test = [{{ file = "test.csv", span = ["0 s", "60 s"] }}]
[model]
vehicle = "semitrailer"
parameters = "ziaukas_2023"
tyre = "magic_formula"
sensors = "test_vehicle_inertial"
"""


def test_every_draw_is_an_effect_of_the_semitrailer():
    effects = {case.name for case in listed() if case.kind == "effect"}
    drawn = [demonstration.draw(seed) for seed in range(20)]
    assert {name for name, _ in drawn} <= effects
    assert len({name for name, _ in drawn}) > 5
    assert demonstration.draw(77) == demonstration.draw(77)


@pytest.mark.proof
def test_an_effect_is_sealed_traced_and_opened(tmp_path, monkeypatch, capfd):
    from harness.models.roles import EFFECTS

    kept = {"lifted_axle", "payload_shift", "steering_offset"}
    excluded = ", ".join(f'{{ effect = "{n}", reason = "it is long" }}' for n in EFFECTS.names() if n not in kept)
    monkeypatch.chdir(tmp_path)
    short = tmp_path / "short.toml"
    short.write_text(SHORT.format(exclude=excluded), encoding="utf-8")
    status = demonstration.main(["--seed", "77", "--study", str(short)])
    said = capfd.readouterr().out
    scored = score(demonstration.FOLDER)
    traced = json.loads((demonstration.FOLDER / "trace" / "trace.json").read_text(encoding="utf-8"))
    assert status == (0 if scored.right else 1)
    assert "The seal is opened." in said
    assert f"The trace was {'right' if scored.right else 'wrong'}" in said.replace("\n", " ")
    assert scored.true == ("lifted_axle",)
    assert [a["effect"] for a in traced["added"]] == list(scored.claimed)
    assert (demonstration.FOLDER / "trace" / "report.pdf").stat().st_size > 10_000


def test_a_trace_that_wrote_nothing_is_not_called_wrong(tmp_path, monkeypatch, capfd):
    """Where there are no recordings the command says so and counts as success."""
    monkeypatch.chdir(tmp_path)
    elsewhere = SHORT.replace("results/loop-semitrailer", "nowhere").format(exclude="")
    (tmp_path / "short.toml").write_text(elsewhere, encoding="utf-8")
    assert demonstration.main(["--seed", "77", "--study", str(tmp_path / "short.toml")]) == 2
    assert "seal is opened" not in capfd.readouterr().out
