"""What is kept from one process to the next is believed only as it was written."""

import os

import pytest

from harness.common import cache, units
from harness.common.errors import UserError
from harness.engine.compile import load_source


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.setenv("HARNESS_CACHE", str(tmp_path / "cache"))
    return tmp_path / "cache"


def test_is_made_once_for_each_key(folder):
    made = []

    def make(content):
        made.append(content)
        return content

    assert cache.kept("things", "one", lambda: make("1"), cache.TEXT) == "1"
    assert cache.kept("things", "one", lambda: make("2"), cache.TEXT) == "1"
    assert cache.kept("things", "other", lambda: make("3"), cache.TEXT) == "3"
    assert made == ["1", "3"]


@pytest.mark.parametrize("damage", [lambda c: c[:-1], lambda c: c[:-1] + b"?", lambda c: b"", lambda c: c[:10]])
def test_what_is_damaged_is_made_again(folder, damage):
    cache.kept("things", "one", lambda: "whole", cache.TEXT)
    (file,) = (folder / "things").iterdir()
    file.write_bytes(damage(file.read_bytes()))
    assert cache.kept("things", "one", lambda: "again", cache.TEXT) == "again"
    assert cache.kept("things", "one", lambda: "no more", cache.TEXT) == "again"


def test_a_folder_that_cannot_be_written_keeps_nothing(folder):
    folder.write_text("a file in its place")
    assert cache.kept("things", "one", lambda: "1", cache.TEXT) == "1"
    assert cache.kept("things", "one", lambda: "2", cache.TEXT) == "2"


@pytest.mark.skipif(not hasattr(os, "geteuid"), reason="modes that say who may write")
class TestOthers:
    """What is in the cache is run, so nobody else may write to it."""

    @pytest.fixture(autouse=True)
    def never_asked(self):
        cache._refuse_others.cache_clear()
        yield
        cache._refuse_others.cache_clear()

    @pytest.fixture
    def filled(self, folder):
        (folder / "__pycache__").mkdir(parents=True)
        (folder / "model_0123456789abcdef.py").write_text("x = 1")
        (folder / "__pycache__" / "model_0123456789abcdef.f-1.py311.nbi").write_bytes(b"x")
        for path in (folder, *folder.rglob("*")):
            path.chmod(0o755 if path.is_dir() else 0o644)
        return folder

    def test_it_is_made_for_its_user_alone(self, folder):
        cache.kept("things", "one", lambda: "1", cache.TEXT)
        assert folder.stat().st_mode & 0o077 == 0

    @pytest.mark.parametrize("mode", [0o777, 0o1777, 0o775])
    @pytest.mark.parametrize("of", ["", "__pycache__"])
    def test_a_folder_that_others_may_write_to_is_refused(self, filled, of, mode):
        assert cache.cache_folder() == filled
        cache._refuse_others.cache_clear()
        (filled / of).chmod(mode)
        with pytest.raises(UserError, match=rf"others may write to it, .* close it: 'chmod 700 {filled}'"):
            cache.cache_folder()
        filled.chmod(0o700)  # as the message says
        assert cache.cache_folder() == filled

    @pytest.mark.parametrize("file", ["model_0123456789abcdef.py", "__pycache__/model_0123456789abcdef.f-1.py311.nbi"])
    def test_so_is_one_file(self, filled, file):
        (filled / file).chmod(0o664)
        with pytest.raises(UserError, match="others may write to it"):
            load_source("model", "x = 1")

    @pytest.mark.parametrize("of", ["", "__pycache__", "model_0123456789abcdef.py"])
    def test_what_belongs_to_another_user_is_refused(self, filled, of, monkeypatch):
        if os.geteuid() == 0:
            os.chown(filled / of, 4242, -1)
        else:
            monkeypatch.setattr(os, "geteuid", lambda: 4242)
        with pytest.raises(UserError, match=r"belongs to another user, .* set HARNESS_CACHE to a folder of your own"):
            cache.cache_folder()

    def test_a_device_is_no_cache_and_nobody_is_told_to_close_it(self, monkeypatch):
        monkeypatch.setenv("HARNESS_CACHE", os.devnull)
        with pytest.raises(UserError, match=f"^{os.devnull}: is no folder; set HARNESS_CACHE"):
            cache.cache_folder()

    @pytest.mark.parametrize("at", ["/proc/self", "a file"])
    def test_nobody_is_told_to_close_what_takes_no_file(self, at, tmp_path, monkeypatch):
        if at == "a file":
            (tmp_path / at).touch()
            (tmp_path / at).chmod(0o666)
            at = str(tmp_path / at)
        elif not os.path.isdir(at):
            pytest.skip(f"no {at} here")
        monkeypatch.setenv("HARNESS_CACHE", at)
        with pytest.raises(UserError, match=f"^{at}: is no place to write in; set HARNESS_CACHE"):
            cache.cache_folder()

    @pytest.mark.parametrize("read", [units.registry, lambda: units.to_si("9.25 km/h", "m/s", "speed")])
    def test_a_refused_cache_is_not_said_of_a_quantity_nor_passed_over(self, filled, read):
        filled.chmod(0o777)
        kept_in_memory = (units.registry, units._everyday, units._ends)
        for memory in kept_in_memory:
            memory.cache_clear()
        with pytest.raises(UserError, match=f"^{filled}: others may write to it"):
            read()
        for memory in kept_in_memory:
            memory.cache_clear()

    def test_the_cache_of_numba_is_looked_at_too(self, folder, tmp_path, monkeypatch):
        (tmp_path / "numba").mkdir()
        (tmp_path / "numba").chmod(0o777)
        monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path / "numba"))
        with pytest.raises(UserError, match="or set NUMBA_CACHE_DIR to a folder of your own"):
            cache.cache_folder()


def test_units_are_read_without_what_was_kept_of_them(folder):
    folder.mkdir()
    assert units.registry.__wrapped__()("3 km/h").to_base_units().magnitude == pytest.approx(3 / 3.6)
    kept = [file for file in (folder / "units").iterdir() if file.suffix == ".pickle"]
    assert kept
    for file in kept:
        file.write_bytes(file.read_bytes()[:10])
    assert units.registry.__wrapped__()("3 km/h").to_base_units().magnitude == pytest.approx(3 / 3.6)
