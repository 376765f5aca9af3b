"""Counts of the operating system, and that the package needs no Unix."""

import gc
import os
import platform
import subprocess
import sys
from pathlib import Path

import pytest

from harness.common import process

ROOT = Path(__file__).parents[2]

WITHOUT_UNIX = """
import importlib, os, pkgutil, subprocess, sys, time  # the library tells Windows by msvcrt
for name in ("resource", "fcntl", "pwd", "grp", "termios", "posix_ipc"):
    sys.modules[name] = None
sys.modules.setdefault("msvcrt", type(sys)("msvcrt"))  # which is where those are not
for name in ("fork", "getloadavg", "sched_setaffinity", "sched_getaffinity", "getuid", "nice"):
    delattr(os, name)
del time.CLOCK_MONOTONIC
import harness
for module in pkgutil.walk_packages(harness.__path__, "harness."):
    if module.name != "harness.__main__":
        importlib.import_module(module.name)
from harness.common.process import forced_switches, peak_memory_mib
assert peak_memory_mib() is None and forced_switches() == 0
"""


def test_peak_memory_is_that_of_a_process_with_numpy_and_not_of_a_machine():
    assert 30 < process.peak_memory_mib() < 20_000


def test_a_command_looks_for_garbage_rarely_and_goes_on_doing_so():
    before = gc.get_threshold()
    try:
        process.collect_rarely()
        assert 10_000 < gc.get_threshold()[0] < 1_000_000
        assert gc.isenabled()
    finally:
        gc.set_threshold(*before)


def test_switches_are_counted():
    assert process.forced_switches() >= 0


def test_every_module_imports_where_the_unix_modules_are_absent():
    # What compiles for graphics cards takes a package that is not among those of the tests, but for numba's simulator.
    done = subprocess.run(
        [sys.executable, "-c", WITHOUT_UNIX], cwd=ROOT, capture_output=True, text=True, check=False,
        env={**os.environ, "NUMBA_ENABLE_CUDASIM": "1"},
    )  # fmt: skip
    assert done.returncode == 0, done.stderr


FAULTS = """
import resource, sys
import numpy as np
from harness.common.process import keep_freed_memory
if sys.argv[1] == "kept":
    keep_freed_memory()
np.ones(2**17)
before = resource.getrusage(resource.RUSAGE_SELF).ru_minflt
for _ in range(100):
    np.ones(2**17)
print(resource.getrusage(resource.RUSAGE_SELF).ru_minflt - before)
"""


@pytest.mark.skipif(platform.libc_ver()[0] != "glibc", reason="the limits are those of the GNU C library")
def test_a_worker_that_dask_started_does_not_map_its_arrays_anew():
    limited = {**os.environ, "MALLOC_TRIM_THRESHOLD_": "65536"}

    def faults(how):
        command = [sys.executable, "-c", FAULTS, how]
        return int(subprocess.run(command, cwd=ROOT, env=limited, capture_output=True, text=True, check=True).stdout)

    assert faults("kept") < 0.1 * faults("as it is")
