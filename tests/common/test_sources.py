"""What decides a study's scores is found by its imports, and its digest does not hang on the names of files."""

import dataclasses
import importlib
import sys
from pathlib import Path

import pytest

from harness.cli import main as cli
from harness.common import sources
from harness.config import load_study
from harness.estimation.methods import _sigma_points, kf, narx, ukf
from harness.study import evaluate, report
from harness.study.provenance import engine_hash, parts

STUDIES = Path(__file__).parents[2] / "studies"
FILES = {
    "top": "from inner.deep import double, half\nimport math\n\ndef run(x):\n    return double(half(x))\n",
    "inner/__init__": "from inner.deep import half\n",
    "inner/deep": "def double(x):\n    return 2 * x\n\ndef half(x):\n    return x / 2\n",
    "inner/unused": "print('nobody imports me')\n",
}


@pytest.fixture
def digest(tmp_path, monkeypatch):
    """Write files, and return the digest of what the first consists of."""
    made = []

    def digest(files):
        folder = tmp_path / str(len(made))
        for name, text in files.items():
            path = folder / f"{name}.py"
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text(text)
        names = {name.removesuffix("/__init__").replace("/", ".") for name in files}
        with monkeypatch.context() as patch:
            patch.syspath_prepend(folder)
            for known in (sources._read, sources._path, sources._digest):
                known.cache_clear()
            importlib.invalidate_caches()
            made.append(importlib.import_module(next(iter(files))))
            found = sources.digest([made[-1]])
            for name in names:
                sys.modules.pop(name, None)
        return found

    yield digest
    for known in (sources._read, sources._path, sources._digest):
        known.cache_clear()


def test_a_file_that_is_renamed_or_not_imported_changes_nothing(digest):
    first = digest(FILES)
    moved = {
        "begin": FILES["top"].replace(
            "from inner.deep import double, half", "from far.away import (half,\n    double)"
        ),
        "far/__init__": "",
        "far/away": '"""Other words."""\n' + FILES["inner/deep"],
    }
    assert digest(moved) == first
    assert digest(FILES | {"inner/unused": "1 / 0\n"}) == first
    handed_on = "from inner import half\nfrom inner.deep import double"
    assert digest(FILES | {"top": FILES["top"].replace("from inner.deep import double, half", handed_on)}) == first


@pytest.mark.parametrize(
    ("name", "old", "new"),
    [
        ("inner/deep", "x / 2", "x / 3"),
        ("top", "double(half(x))", "half(x)"),
        ("top", "import double, half", "import half, half as double"),
        ("top", "def run(x):\n", "def run(x):\n    from inner import unused\n"),
    ],
)
def test_what_is_run_counts(digest, name, old, new):
    assert old in FILES[name]
    assert digest(FILES | {name: FILES[name].replace(old, new)}) != digest(FILES)


def test_the_same_name_from_another_file_counts(digest):
    files = FILES | {"inner/other": FILES["inner/deep"].replace("x / 2", "x / 4")}
    assert digest(files) == digest(FILES)
    other = "from inner.deep import double\nfrom inner.other import half"
    changed = files | {"top": files["top"].replace("from inner.deep import double, half", other)}
    assert digest(changed) != digest(files)


def test_a_study_depends_on_what_it_uses_and_on_no_report():
    study = load_study(STUDIES / "kalman-lecture.toml")
    found = sources.modules([evaluate, *parts(study)])
    assert kf.__name__ in found
    assert not {ukf.__name__, cli.__name__, report.__name__} & set(found)
    assert not [name for name in found if name.startswith(f"{report.__name__}.")]
    assert len(found) == len(set(found))
    other = dataclasses.replace(study.estimators[0], kind="ukf")
    with_ukf = dataclasses.replace(study, estimators=(other,))
    assert {ukf.__name__, _sigma_points.__name__} <= set(sources.modules([evaluate, *parts(with_ukf)]))
    assert engine_hash(with_ukf) != engine_hash(study)


def test_a_study_depends_on_the_network_that_it_names(tmp_path):
    study = load_study(STUDIES / "kalman-lecture.toml")

    def with_network(content):
        path = tmp_path / "mine.npz"
        path.write_bytes(content)
        spec = dataclasses.replace(study.estimators[0], kind="narx", settings={"network": str(path)})
        return engine_hash(dataclasses.replace(study, estimators=(spec,)))

    first = with_network(b"1")
    assert with_network(b"2") != first
    assert with_network(b"1") == first
    assert narx.files(narx.Settings(), Path())[0].is_file()


@pytest.mark.parametrize("record", ["", "other-1.0.dist-info"])
def test_a_folder_with_the_records_of_pip_holds_installed_packages(tmp_path, monkeypatch, record: str) -> None:
    folder = tmp_path / "lib"  # as `pip install --target lib` makes it
    (folder / "other_package").mkdir(parents=True)
    (folder / "other_package" / "__init__.py").write_text("")
    (folder / "other_module.py").write_text("")
    if record:
        (folder / record).mkdir()
    monkeypatch.syspath_prepend(folder)
    names = ["other_package", "other_module"]
    found = [sources.is_own(importlib.import_module(name)) for name in names]
    for name in names:
        sys.modules.pop(name)
    for known in (sources._path, sources._is_installed):
        known.cache_clear()
    assert found == [not record] * 2
