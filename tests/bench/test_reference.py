"""Tables that pages of the documentation get from the registries."""

import pytest

from bench import reference
from harness.config.roles import ESTIMATORS
from harness.models.roles import EFFECTS

DOCS = reference.ROOT / "docs"


def test_every_line_of_a_page_names_a_table_and_is_replaced(tmp_path, monkeypatch):
    monkeypatch.setitem(reference.TABLES, "drive-peaks", lambda name: f"peaks of {name}")  # some seconds
    asked = {p.relative_to(DOCS): p.read_text(encoding="utf-8") for p in DOCS.rglob("*.md")}
    asked = {path: text for path, text in asked.items() if "<!-- generated" in text}
    assert len(asked) > 10
    for path, text in asked.items():
        made = reference.filled(text)
        assert "<!-- generated" not in made, path
        assert len(made) > len(text), path


def test_an_unknown_table_is_refused():
    with pytest.raises(KeyError, match="no-such"):
        reference.filled("<!-- generated: no-such -->")


def test_every_estimator_has_a_page_with_its_settings():
    for kind in ESTIMATORS.names():
        text = (DOCS / "estimators" / f"{kind}.md").read_text(encoding="utf-8")
        asked = f"<!-- generated: settings {kind} -->" in text
        assert asked == (reference.settings(kind) != "No settings."), kind
    table = reference.settings("ukf")
    assert [row.split("`")[1] for row in table.splitlines()[2:]] == ["alpha", "beta", "kappa"]


def test_the_library_of_effects_is_complete():
    page = (DOCS / "effects.md").read_text(encoding="utf-8")
    overview = page.split("| where | effects |")[1].split("\n\n")[0]
    tables = reference.effects()
    for name in EFFECTS.names():
        assert overview.count(f"`{name}`") == 1, name
        section = tables.split(f"### `{name}`\n")[1].split("\n### ")[0]
        parameters = EFFECTS.load(name).PARAMETERS
        assert "\nEquation: $" in section, name
        assert "\nConfused with: " in section, name
        rows = [row for row in section.splitlines() if row.startswith("| `")]
        assert [row.split("`")[1] for row in rows] == [p.name for p in parameters]
    assert "Fits `semitrailer`." in tables.split("### `kingpin_damping`")[1].split("###")[0]


def test_commands_are_shown_with_their_options():
    run = reference.commands().split("## `harness run`\n")[1].split("\n## ")[0]
    assert "| `--jobs`, `-j` |" in run
    assert "| `STUDY` | required |" in run


def test_keys_have_default_and_meaning():
    rows = {row.split("`")[1]: row for row in reference.keys("DesignTable").splitlines()[2:]}
    assert "| `1` | Sobol points per band" in rows["samples"]
    assert "| required |" in rows["name"]


def test_formulas_become_mathml_and_code_stays():
    pytest.importorskip("latex2mathml")
    page = reference.with_formulas("The gain $K_1$ of `$HOME`:\n\n$$x^- = A|x|$$\n\n```sh\nexport A=$B$C\n```\n")
    assert page.count("<math") == 2
    assert page.count("<msub>") == 1
    assert "`$HOME`" in page
    assert "export A=$B$C" in page
    assert "|" not in page
