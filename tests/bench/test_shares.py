"""What whole commands spend in kernels: what a file is for, whose a builtin's time is, and how the profiler counts."""

import cProfile
import pstats

import pytest

from bench.shares import KERNELS, REST, by_place, place_of, shares


@pytest.mark.parametrize(
    ("file", "place"),
    [
        ("/cache/filter_whole_0.py", KERNELS),
        ("/venv/matplotlib/axes/_axes.py", "report"),
        ("/harness/study/report/figures.py", "report"),
        ("/venv/scipy/stats/_qmc.py", "statistics"),
        ("/venv/scipy/linalg/_basic.py", "NumPy and SciPy"),
        ("/harness/study/run.py", REST),
    ],
)
def test_a_file_is_for_one_thing(file, place):
    assert place_of(file, "/cache") == place


def test_the_time_of_a_builtin_is_that_of_its_caller():
    kernel: dict[str, object] = {}
    exec(compile("def kernel():\n    return sorted(range(300_000))\n", "/cache/kernel.py", "exec"), kernel)
    profile = cProfile.Profile()
    profile.runcall(kernel["kernel"])
    found = by_place(pstats.Stats(profile), "/cache")
    assert found[KERNELS] > 0.9 * sum(found.values()) > 0


def test_the_profiler_slows_down_all_but_the_kernels():
    profiled = {KERNELS: 6.0, "report": 3.0, REST: 6.0}
    assert shares(profiled, 9.0) == pytest.approx({KERNELS: 6 / 9, "report": 1 / 9, REST: 2 / 9})
    assert shares(profiled, 5.0)[KERNELS] == 1.0
