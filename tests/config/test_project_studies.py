"""The studies of the project load, and schema and documentation describe what a study may hold."""

from __future__ import annotations

import json
import shutil
import tomllib
from pathlib import Path

import pytest

from harness.config import build_study, load_study, study_schema, write_schema

ROOT = Path(__file__).parents[2]


@pytest.mark.parametrize("path", sorted((ROOT / "studies").glob("*.toml")), ids=lambda p: p.stem)
def test_studies_of_the_project_load(path):
    study = load_study(path)
    assert study.name == path.stem
    assert study.title.endswith("?")
    built = build_study(tomllib.loads(study.text), path)
    assert (built.hash, built.plant, built.designs) == (study.hash, study.plant, study.designs)
    assert build_study(tomllib.loads(built.text), path).hash == study.hash


def test_mass_study_is_that_of_the_thesis():
    study = load_study(ROOT / "studies" / "mass.toml")
    level, band = study.designs
    assert level.factors[0].levels == tuple(1000.0 * m for m in (8, 12, 16, 20, 24, 28, 32))
    assert level.repeats == 20
    assert len(study.drives) == 6
    assert study.belief.values["trailer_mass"] == 24000.0
    assert band.factors[0].lower == pytest.approx([0.95 * m for m in level.factors[0].levels])
    assert {e.kind for e in study.estimators} == {"kf", "ekf", "ukf", "cdkf", "st_cdkf", "particle", "narx"}


def test_schema_describes_every_key_and_is_valid_json(tmp_path):
    schema = json.loads(write_schema(tmp_path / "study.schema.json").read_text())
    assert schema == study_schema()
    assert set(schema["required"]) == {"name", "targets", "plant", "estimator", "design"}
    for table in [schema, *schema["$defs"].values()]:
        for key, entry in table["properties"].items():
            assert "description" in entry, key


def test_the_schema_beside_the_studies_is_up_to_date_and_every_study_names_it():
    stored = (ROOT / "studies" / "study.schema.json").read_text(encoding="utf-8")
    assert json.loads(stored) == study_schema(), "write it anew: harness schema --out studies/study.schema.json"
    for path in (ROOT / "studies").glob("*.toml"):
        assert path.read_text(encoding="utf-8").startswith("#:schema study.schema.json\n"), path


def test_study_copied_elsewhere_has_the_same_hash(tmp_path):
    shutil.copytree(ROOT / "studies", tmp_path / "studies")
    assert load_study(tmp_path / "studies" / "mass.toml").hash == load_study(ROOT / "studies" / "mass.toml").hash


@pytest.mark.parametrize(
    "table",
    [
        "",
        " ModelTable",
        " UncertainTable",
        " DesignTable",
        " FactorTable",
        " DistributionTable",
        " ReportTable",
        " RareEventTable",
        " HistoryTable",
    ],
)
def test_documentation_asks_for_the_keys_of_every_table(table):
    text = (ROOT / "docs" / "studies.md").read_text(encoding="utf-8")
    assert text.count(f"<!-- generated: study-keys{table} -->") == 1


def test_ten_line_study_of_the_documentation_loads(tmp_path):
    text = (ROOT / "docs" / "studies.md").read_text()
    blocks = [b.split("```")[0] for b in text.split("```toml\n")[1:]]
    study, unsure, tyre, fleet, joint, loaded, inputs = blocks
    assert tomllib.loads(unsure)["belief"]["unknown_parameters"][0] == "trailer_mass"
    assert len(study.strip().splitlines()) == 10
    shutil.copytree(ROOT / "studies" / "drives", tmp_path / "drives")
    path = tmp_path / "friction.toml"
    limits, design = joint.split("\n\n", 1)
    path.write_text(study.replace("drives =", f"{limits}\ndrives =") + tyre + fleet + design + loaded)
    loaded = load_study(path)
    assert [d.name for d in loaded.designs] == ["level", "tyre", "fleet", "joint", "loaded"]
    assert loaded.limits == {"lateral_force_axle_21": 5000.0}
    assert loaded.design("tyre").band_labels == ("±10 %", "±20 %", "±30 %")
    runs = [d.bands * d.samples * d.repeats * len(loaded.drives) for d in loaded.designs]
    assert tomllib.loads(inputs)["plant"] == {
        "noise": tomllib.loads((ROOT / "studies" / "input-noise.toml").read_text())["plant"]["noise"]
    }
    assert runs == [120, 3 * 32 * 5 * 6, 64 * 6, 256 * 4 * 6, 8 * 64 * 6]
