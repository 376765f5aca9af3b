"""Components from outside: found by three ways, refused twice, imported late, with signals and axles of their own."""

import os
import pickle
import subprocess
import sys
import types

import pytest

import harness
from harness.cli.listing import summary
from harness.common import components
from harness.common.errors import ModelError, UserError
from harness.models.assembly.assemble import assemble
from harness.models.roles import EFFECTS, ROLES, SENSORS, VEHICLES
from harness.models.signals import SIGNALS, Signal
from support.plugins import TINY, example, forget, package, project, register

WAYS = ("project", "package", "register")


@pytest.fixture(autouse=True)
def nothing_is_left():
    yield
    forget()


@pytest.fixture
def come(tmp_path, monkeypatch):
    """Let files come as components by one of the ways."""

    def come(way, files, name="acme"):
        folder = tmp_path / f"{way}-{name}"
        if way == "project":
            monkeypatch.chdir(project(folder, files))
        elif way == "package":
            monkeypatch.syspath_prepend(str(package(folder, files, name)))
            components._installed.cache_clear()
        else:
            register(folder, files)
        return folder

    return come


def test_every_role_may_be_added_to():
    from harness.config.roles import ESTIMATORS
    from harness.recordings.readers import READERS

    assert {r.word for r in (*ROLES.values(), ESTIMATORS, READERS)} == set(components.WORDS)


@pytest.mark.parametrize("way", WAYS)
def test_a_component_is_found_with_its_origin(way, come):
    folder = come(way, {"vehicles/sleeper.py": TINY})
    found = VEHICLES.components()["sleeper"]
    assert summary(found) == "A vehicle that falls asleep."
    assert {"project": "project project-acme", "package": "package acme 1.0", "register": "registered"}[
        way
    ] == found.origin
    assert VEHICLES.load("sleeper").STATES == ("yaw_rate",)
    assert components.file_of(found).is_relative_to(folder)
    assert assemble("sleeper").name == "sleeper"
    assert VEHICLES.components()["car"].origin == components.OURS


@pytest.mark.parametrize(
    ("first", "second"), [("project", "package"), ("register", "project"), ("package", "register")]
)
def test_a_name_twice_is_refused_with_both_places(first, second, come):
    files = {"vehicles/sleeper.py": TINY}
    places = [come(way, files) for way in (first, second)]
    with pytest.raises(ModelError, match="two of the vehicles are called 'sleeper'") as caught:
        VEHICLES.load("sleeper")
    for way, place in zip((first, second), places, strict=True):
        assert ("acme.vehicles.sleeper (package acme 1.0)" if way == "package" else str(place)) in str(caught.value)


def test_a_name_of_ours_is_refused_too(come):
    place = come("project", {"effects/crosswind.py": "PORT = ''\n"})
    with pytest.raises(ModelError, match="'crosswind'") as caught:
        EFFECTS.names()
    assert str(place / "effects" / "crosswind.py") in str(caught.value)
    assert "models/effects/crosswind.py (harness)" in str(caught.value)


def test_two_packages_with_one_name_are_refused(come):
    for name in ("acme", "other"):
        come("package", {"vehicles/sleeper.py": TINY}, name)
    with pytest.raises(ModelError, match=r"acme\.vehicles\.sleeper .*other\.vehicles\.sleeper|other.*acme"):
        VEHICLES.names()


def test_the_same_file_by_two_ways_is_one(come, tmp_path):
    folder = come("project", {"vehicles/sleeper.py": TINY})
    harness.register("vehicles", folder / "vehicles" / "sleeper.py")
    assert VEHICLES.components()["sleeper"].origin == "registered"


def test_the_project_is_found_from_below_and_only_there(come, monkeypatch, tmp_path):
    folder = come("project", {"vehicles/sleeper.py": TINY, "studies/deep/x.toml": ""})
    monkeypatch.chdir(folder / "studies" / "deep")
    assert "sleeper" in VEHICLES.names()
    monkeypatch.chdir(tmp_path)
    assert "sleeper" not in VEHICLES.names()


def test_nothing_is_imported_before_it_is_looked_up(come):
    come("project", {"vehicles/bomb.py": '"""Goes off."""\nraise RuntimeError("imported")\n'})
    assert summary(VEHICLES.components()["bomb"]) == "Goes off."
    assert VEHICLES.load("car")
    with pytest.raises(ModelError, match=r"bomb\.py: cannot be imported: RuntimeError: imported \(line 2 of"):
        VEHICLES.load("bomb")


@pytest.mark.parametrize("way", WAYS)
def test_a_missing_export_is_named_with_the_file(way, come):
    come(way, {"tyres/half.py": "PARAMETERS = ()\n"})
    with pytest.raises(ModelError, match=r"half.*: missing export lateral_force \(see models/contracts"):
        ROLES["tyres"].load("half")


@pytest.mark.parametrize("way", WAYS)
def test_files_import_their_neighbours(way, come):
    come(
        way, {"vehicles/_names.py": 'STATE = "yaw_rate"\n', "vehicles/sleeper.py": "from ._names import STATE\n" + TINY}
    )
    assert VEHICLES.load("sleeper").STATE == "yaw_rate"


def test_an_entry_point_may_name_an_object_and_another_name(come, tmp_path):
    folder = come(
        "package", {"sensors/pack.py": 'class Gyro:\n    """One gyro."""\n    OUTPUTS = {"yaw_rate": "yaw_rate"}\n'}
    )
    points = folder / "acme-1.0.dist-info" / "entry_points.txt"
    points.write_text("[harness.sensors]\none_gyro = acme.sensors.pack:Gyro\n")
    components._installed.cache_clear()
    assert SENSORS.load("one_gyro").OUTPUTS == {"yaw_rate": "yaw_rate"}
    assert tuple(assemble("car", "linear", (), "one_gyro").outputs) == ("yaw_rate",)


def test_an_object_of_a_notebook_is_a_component_and_may_come_again():
    def again(outputs):
        return types.SimpleNamespace(__doc__="A gyro.", OUTPUTS={o: o for o in outputs})

    harness.register("sensors", again(["yaw_rate"]), name="mine")
    assert tuple(assemble("car", "linear", (), "mine").outputs) == ("yaw_rate",)
    harness.register("sensors", again(["yaw_rate", "lateral_acceleration"]), name="mine")
    assert tuple(assemble("car", "linear", (), "mine").outputs) == ("yaw_rate", "lateral_acceleration")


def test_a_file_that_changed_is_registered_anew(tmp_path):
    path = tmp_path / "sleeper.py"
    for state in ("yaw_rate", "heading"):
        path.write_text(TINY.replace("yaw_rate", state))
        harness.register("vehicles", path)
        assert assemble("sleeper").states == (state,)


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (("vehicle", "x.py"), "there is no role 'vehicle'; there are: vehicles"),
        (("vehicles", "nowhere.py"), r"nowhere\.py: cannot be read"),
        (("vehicles", types.SimpleNamespace()), "what shall the component be called"),
    ],
)
def test_what_cannot_be_registered_is_refused(arguments, says):
    with pytest.raises(UserError, match=says):
        harness.register(*arguments)


def test_a_project_file_with_strange_keys_is_refused(come):
    folder = come("project", {"vehicles/sleeper.py": TINY})
    (folder / "harness.toml").write_text('nam = "x"\n')
    with pytest.raises(UserError, match=r"harness\.toml: unknown key 'nam'"):
        VEHICLES.names()


def test_axles_and_signals_come_with_a_vehicle(come):
    come("project", {path: text for path, text in example().items() if path.startswith(("vehicles", "effects"))})
    assert SIGNALS["lateral_force_axle_tag"].meaning == "lateral force, tag axle"  # before anything is assembled
    assert SIGNALS["bogie_lateral_force"].report_unit == "kN"
    assert "delayed_lateral_force_axle_tag" in SIGNALS
    assert "relaxed_force_axle_drive" in list(SIGNALS)
    built = assemble("rigid_truck", "magic_formula", ("worn_tag_axle", "tyre_stiffness_drift"))
    assert "slip_angle_axle_tag" in built.ports


def test_bodies_bring_signals_as_well():
    module = types.ModuleType("dolly")
    module.BODIES, module.AXLES = {"dolly": ("d1",)}, {"d1": "d1"}
    SIGNALS.learn(module)
    assert SIGNALS["external_yaw_moment_dolly"].frame == "dolly"
    assert SIGNALS["inertial_mass_dolly"].unit == "kg"


def test_a_signal_that_is_another_one_elsewhere_is_refused(come):
    text = (
        TINY
        + 'from harness.models.signals import Signal\nSIGNALS = (Signal("speed", "v", "km/h", "km/h", "", "mine"),)\n'
    )
    come("project", {"vehicles/sleeper.py": text})
    with pytest.raises(ModelError, match=r"sleeper\.py: signal 'speed' is another one than in models/signals\.py"):
        assemble("sleeper")


def test_what_is_no_signal_is_refused():
    module = types.ModuleType("wrong")
    module.SIGNALS = ("speed",)
    with pytest.raises(ModelError, match=r"expected harness\.models\.signals\.Signal, got 'speed'"):
        SIGNALS.learn(module)


def test_signals_of_a_project_go_with_it(come, monkeypatch, tmp_path):
    text = (
        TINY
        + 'from harness.models.signals import Signal\nSIGNALS = (Signal("drowsiness", "z", "1", "1", "", "how"),)\n'
    )
    come("project", {"vehicles/sleeper.py": text})
    assert SIGNALS["drowsiness"] == Signal("drowsiness", "z", "1", "1", "", "how")
    monkeypatch.chdir(tmp_path)
    assert "drowsiness" not in SIGNALS


def test_importing_the_harness_scans_nothing():
    code = (
        "import sys, harness; print([m for m in ('numba', 'numpy', 'importlib.metadata', 'sympy') if m in sys.modules])"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert not {"numba", "numpy", "sympy"} & set(eval(done.stdout))


def test_a_folder_that_was_listed_shows_what_comes_into_it_later(tmp_path, monkeypatch):
    """A listing is kept while the folder's time of change stands; a folder in it may become a package without one."""
    folder = project(tmp_path / "project", {"vehicles/sleeper.py": TINY}) / "vehicles"
    monkeypatch.chdir(folder.parent)

    def listed():
        os.utime(folder, (1e9, 1e9))  # long ago
        return {c.name for c in VEHICLES.components().values() if c.origin != components.OURS}

    assert listed() == {"sleeper"}
    reads, read = [], components._read_folder
    monkeypatch.setattr(components, "_read_folder", lambda *key: (reads.append(key), read(*key))[1])
    assert listed() == {"sleeper"}
    assert not reads
    (folder / "walker").mkdir()
    os.utime(folder, (1.1e9, 1.1e9))
    assert {c.name for c in VEHICLES.components().values() if c.origin != components.OURS} == {"sleeper"}
    (folder / "walker" / "__init__.py").write_text(TINY, encoding="utf-8")
    os.utime(folder, (1.1e9, 1.1e9))  # as it was
    assert "walker" in VEHICLES.components()


def test_a_process_that_takes_over_what_is_found_reads_tables_of_the_same_size(monkeypatch):
    for limited in (False, True):
        monkeypatch.setattr(components, "LIMITED", [limited])
        code = (
            "import pickle, sys; from harness.common import components, files; "
            "components.take_over(pickle.load(sys.stdin.buffer)); print(files.LIMITED[0])"
        )
        done = subprocess.run([sys.executable, "-c", code], input=pickle.dumps(components.carried()),
                              capture_output=True, check=True)  # fmt: skip
        assert done.stdout.decode().strip() == str(limited)
