"""What is kept from one process to the next is believed only as it was written."""

import pytest

from harness.common import cache, units


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.setenv("HARNESS_CACHE", str(tmp_path / "cache"))
    return tmp_path / "cache"


def test_is_made_once_for_each_key(folder):
    made = []

    def make(content):
        made.append(content)
        return content

    assert cache.kept("things", "one", lambda: make(b"1")) == b"1"
    assert cache.kept("things", "one", lambda: make(b"2")) == b"1"
    assert cache.kept("things", "other", lambda: make(b"3")) == b"3"
    assert made == [b"1", b"3"]


@pytest.mark.parametrize("damage", [lambda c: c[:-1], lambda c: c[:-1] + b"?", lambda c: b"", lambda c: c[:10]])
def test_what_is_damaged_is_made_again(folder, damage):
    cache.kept("things", "one", lambda: b"whole")
    (file,) = (folder / "things").iterdir()
    file.write_bytes(damage(file.read_bytes()))
    assert cache.kept("things", "one", lambda: b"again") == b"again"
    assert cache.kept("things", "one", lambda: b"no more") == b"again"


def test_a_folder_that_cannot_be_written_keeps_nothing(folder):
    folder.write_text("a file in its place")
    assert cache.kept("things", "one", lambda: b"1") == b"1"
    assert cache.kept("things", "one", lambda: b"2") == b"2"


def test_units_are_read_without_what_was_kept_of_them(folder):
    folder.mkdir()
    assert units.registry.__wrapped__()("3 km/h").to_base_units().magnitude == pytest.approx(3 / 3.6)
    kept = [file for file in (folder / "units").iterdir() if file.suffix == ".pickle"]
    assert kept
    for file in kept:
        file.write_bytes(file.read_bytes()[:10])
    assert units.registry.__wrapped__()("3 km/h").to_base_units().magnitude == pytest.approx(3 / 3.6)
