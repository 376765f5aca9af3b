"""Studies, sets of drives, channel maps and networks by name: the project's before ours, and it is said."""

from pathlib import Path

import pytest

from harness.common import locations
from harness.common.errors import UserError
from harness.config import load_study
from harness.estimation import narx_network as network
from harness.recordings.read.channel_map import load_map
from support.plugins import forget, project
from support.small_study import STUDY

KINDS = (locations.STUDIES, locations.DRIVE_SETS, locations.TUNINGS, locations.CHANNELS, locations.NETWORKS)
MAP = 'yaw_rate = { channel = "r", unit = "rad/s" }\n'


@pytest.fixture(autouse=True)
def nothing_is_left():
    yield
    forget()


@pytest.mark.parametrize("kind", KINDS, ids=[k.what for k in KINDS])
def test_ours_are_found_from_anywhere(kind, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    names = locations.files(kind)
    assert names
    for name in names:
        assert locations.find(kind, name).is_file()


@pytest.mark.parametrize("kind", KINDS, ids=[k.what for k in KINDS])
def test_those_of_the_project_take_their_place_and_it_is_said_once(kind, tmp_path, monkeypatch, capsys):
    name = next(iter(locations.files(kind)))
    monkeypatch.chdir(project(tmp_path / "mine", {f"{kind.in_project}/{name}{kind.suffix}": ""}))
    for _ in range(2):
        assert locations.find(kind, name) == Path.cwd() / kind.in_project / f"{name}{kind.suffix}"
    said = capsys.readouterr().err
    assert said.count("note: ") == 1
    assert f"{kind.what} '{name}' is that of {kind.in_project}/{name}{kind.suffix}, in place of the package's" in said


def test_what_is_not_there_is_refused_with_the_closest(tmp_path, monkeypatch):
    monkeypatch.chdir(project(tmp_path, {}))
    with pytest.raises(UserError, match=r"no study 'mas'; closest: mass \(looked in studies, .*studies\)"):
        locations.find(locations.STUDIES, "mas")
    with pytest.raises(UserError, match="there is no study"):
        locations.find(locations.STUDIES, "../studies/mass")


def test_a_study_anywhere_takes_drives_of_project_and_package(tmp_path, monkeypatch):
    drives = '[[drive]]\nname = "own"\nkind = "sine"\n'
    monkeypatch.chdir(project(tmp_path / "mine", {"studies/drives/town.toml": drives}))
    text = STUDY.replace('[[drive]]\nname = "sine"\nkind = "sine"\n', "").replace("seed = 0", 'seed = 0\ndrives = "{}"')
    path = tmp_path / "elsewhere.toml"
    path.write_text(text.replace("{}", "town"))
    assert [d.name for d in load_study(path).drives] == ["own"]
    path.write_text(text.replace("{}", "robustness"))
    assert len(load_study(path).drives) == 6


def test_channel_maps_and_networks_by_name(tmp_path, monkeypatch):
    monkeypatch.chdir(project(tmp_path, {"channels/lap.toml": MAP, "networks/small.npz": ""}))
    assert [c.signal for c in load_map("lap").channels] == ["yaw_rate"]
    assert load_map("genesis_g80").title.startswith("Passenger car")
    assert network.find("small") == tmp_path / "networks" / "small.npz"
    assert network.find("semitrailer_24t").is_file()
    with pytest.raises(UserError, match="no channel map 'lapp'; closest: lap"):
        load_map("lapp")
