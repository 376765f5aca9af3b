"""A vehicle, effect and estimator from outside in a study: three ways give the same; their files count."""

import io
import types

import pytest
from rich.console import Console

import harness
from harness.cli.new import write_new
from harness.common import components, sources
from harness.common.errors import UserError
from harness.config import load_study
from harness.study import cluster
from harness.study.evaluate import StudyEvaluator
from harness.study.provenance import engine_hash
from harness.study.run import run_study
from harness.study.store import Store
from harness.study.stored import study_of
from harness.testing import check_effect, check_estimator, check_parameter_set, check_vehicle
from support.plugins import OneProcess, example, forget, package, project, register, write
from support.probe_study import STUDY, bits


@pytest.fixture(autouse=True)
def nothing_is_left(monkeypatch):
    monkeypatch.setattr("harness.study.layout.commit", lambda: "this one")
    yield
    forget()
    for known in (sources._read, sources._path, sources._digest):
        known.cache_clear()


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    """Every component of the page's example, the estimator as ``harness new`` writes it."""
    folder = project(tmp_path_factory.mktemp("new") / "lab", {})
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        write_new("estimator", "forgetful")
    made = {"estimators/forgetful.py": (folder / "estimators" / "forgetful.py").read_text()}
    return {**example(), **made}


@pytest.fixture
def study(tmp_path, files):
    """The study of the page, shortened, in a folder that is no project."""
    text = files["studies/worn-tag.toml"]
    for old, new in (('"20 s"', '"6 s"'), ("repeats = 5", "repeats = 2"), ("[0.0, 0.3, 0.6]", "[0.0, 0.6]")):
        assert old in text
        text = text.replace(old, new)
    return write(tmp_path / "studies-of-mine", {"worn-tag.toml": text}) / "worn-tag.toml"


def come(way, folder, files, patch):
    """Let files come as components by one of the three ways."""
    if way == "project":
        patch.chdir(project(folder, files))
    elif way == "package":
        patch.syspath_prepend(str(package(folder, files)))
        components._installed.cache_clear()
    else:
        register(folder, files)


def test_three_ways_give_the_same_bits_and_the_example_of_the_page_holds(tmp_path, files, study):
    results, engines = {}, {}
    for way in ("project", "package", "register"):
        with pytest.MonkeyPatch.context() as patch:
            come(way, tmp_path / way, files, patch)
            loaded = load_study(study)
            engines[way] = engine_hash(loaded)
            results[way] = bits(run_study(loaded, tmp_path / f"out-{way}", jobs=1))
            forget()
    assert len(set(engines.values())) == 1
    assert results["project"] == results["package"] == results["register"]


def test_a_result_whose_vehicle_is_not_here_names_it(tmp_path, files, study, monkeypatch):
    come("project", tmp_path / "lab", files, monkeypatch)
    out = tmp_path / "out"
    loaded = load_study(study)
    Store(loaded, lambda: StudyEvaluator(loaded), out)
    study.unlink()
    assert study_of(out).hash == loaded.hash
    forget()
    monkeypatch.chdir(tmp_path)
    with pytest.raises(UserError, match=r"no run can be computed again: plant\.vehicle: unknown vehicle 'rigid_truck'"):
        study_of(out)


def test_the_example_keeps_the_contracts(tmp_path, files, monkeypatch):
    come("project", tmp_path / "lab", files, monkeypatch)
    checks = {"check_vehicle": check_vehicle, "check_parameter_set": check_parameter_set}
    checks |= {"check_effect": check_effect, "check_estimator": check_estimator}
    written = files["tests/test_truck.py"]
    assert all(f"{name}(" in written for name in checks)
    for name, call in types.SimpleNamespace(**_run(written)).__dict__.items():
        if name.startswith("test_"):
            call()


def _run(text):
    names = {}
    exec(text, names)
    return names


def test_files_from_outside_count_in_what_a_store_depends_on(tmp_path, files, study, monkeypatch):
    hashes = {}
    changes = {
        "as it is": {},
        "moved": {},
        "effect": {"effects/worn_tag_axle.py": ("1 - e.p", "1 - 0.5 * e.p")},
        "vehicle": {"vehicles/rigid_truck.py": ("l_1 * steered", "1.01 * l_1 * steered")},
        "estimator": {"estimators/forgetful.py": ("forgetting * get", "forgetting * 1.0 * get")},
        "what it imports": {"effects/_share.py": ("ALL = 1", "ALL = 2")},
        "docstring": {"effects/worn_tag_axle.py": ("are worn", "are quite worn")},
        "another": {"effects/another.py": ("1 - e.p", "1 - 0.9 * e.p")},
    }
    everything = dict(files)
    everything["effects/worn_tag_axle.py"] = "from ._share import ALL\n" + files["effects/worn_tag_axle.py"]
    everything |= {
        "effects/_share.py": "ALL = 1\n",
        "effects/another.py": files["effects/worn_tag_axle.py"].replace("tag_axle_wear", "other_wear"),
    }
    for name, change in changes.items():
        texts = dict(everything)
        for path, (old, new) in change.items():
            assert old in texts[path]
            texts[path] = texts[path].replace(old, new)
        come("project", tmp_path / name.replace(" ", "-"), texts, monkeypatch)
        hashes[name] = engine_hash(load_study(study))
    same = {name for name, found in hashes.items() if found == hashes["as it is"]}
    assert same == {"as it is", "moved", "docstring", "another"}
    assert len(set(hashes.values())) == 5


def test_a_store_is_not_continued_with_another_component(tmp_path, files, study, monkeypatch):
    come("project", tmp_path / "one", files, monkeypatch)
    out = run_study(load_study(study), tmp_path / "out", jobs=1)
    changed = files["effects/worn_tag_axle.py"].replace("1 - e.p", "1 - 0.5 * e.p")
    come("project", tmp_path / "two", {**files, "effects/worn_tag_axle.py": changed}, monkeypatch)
    with pytest.raises(UserError, match="was computed"):
        run_study(load_study(study), out, jobs=1)


def test_an_object_of_a_notebook_counts_by_its_source(files, study, tmp_path, monkeypatch):
    rest = {path: text for path, text in files.items() if not path.startswith("effects")}
    come("project", tmp_path / "lab", rest, monkeypatch)
    found = []
    for factor in (1.0, 1.0, 0.5):
        names = _run(files["effects/worn_tag_axle.py"])
        names["FACTOR"] = factor
        harness.register("effects", types.SimpleNamespace(**names), name="worn_tag_axle")
        found.append(engine_hash(load_study(study)))
    assert found[0] == found[1] != found[2]
    with pytest.raises(
        UserError, match="'worn_tag_axle' was registered without a file, so that workers cannot have it"
    ):
        harness.read_study(study).run(tmp_path / "out", dask="local")
    assert not (tmp_path / "out").exists()


def test_workers_make_sensors_that_a_study_lists_themselves(tmp_path):
    listed = "yaw_rate_tractor, lateral_acceleration_tractor"
    (tmp_path / "listed.toml").write_text(STUDY.replace('sensors = "series"', f'sensors = "{listed}"'))
    loaded = load_study(tmp_path / "listed.toml")
    assert loaded.plant.sensors == listed
    (tmp_path / cluster.STORE).mkdir()
    cluster.refuse_objects(loaded)
    worker = OneProcess(tmp_path)
    cluster.check_workers(worker, loaded, tmp_path, Console(file=io.StringIO()))
    worker.close()


def test_workers_find_the_project_and_are_refused_with_other_files(tmp_path, files, study, monkeypatch):
    come("project", tmp_path / "lab", files, monkeypatch)
    loaded, console = load_study(study), Console(file=io.StringIO())
    (tmp_path / cluster.STORE).mkdir()
    same = OneProcess(tmp_path)
    cluster.check_workers(same, loaded, tmp_path, console)
    same.close()
    path = tmp_path / "lab" / "effects" / "worn_tag_axle.py"
    path.write_text(path.read_text().replace("1 - e.p", "1 - 0.5 * e.p"))
    other = OneProcess(tmp_path)
    with pytest.raises(UserError, match="runs other code of this project or of a component from outside"):
        cluster.check_workers(other, loaded, tmp_path, console)
    other.close()


def test_a_worker_that_lacks_a_package_is_refused(tmp_path, files, study, monkeypatch):
    come("package", tmp_path / "site", files, monkeypatch)
    loaded = load_study(study)
    lacking = OneProcess(tmp_path, str(tmp_path / "site"))
    with pytest.raises(
        UserError, match=r"a worker does not have what the study is made of \(unknown estimator 'forgetful'"
    ):
        cluster.check_workers(lacking, loaded, tmp_path, Console(file=io.StringIO()))
    lacking.close()
