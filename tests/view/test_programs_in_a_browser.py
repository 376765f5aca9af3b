"""What measures the pages of ``harness view`` in a browser."""

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
pytestmark = pytest.mark.browser


def test_the_time_of_a_page_is_measured(folder, browser):
    environment = os.environ | {"PYTHONPATH": str(ROOT)}
    command = [sys.executable, "-m", "bench.view", str(folder)]  # a browser of its own
    done = subprocess.run(command, env=environment, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    seconds = re.search(r"start: (\d+\.\d) s", done.stdout)
    memory = re.search(r"memory of the server: (\d+) MiB", done.stdout)
    assert float(seconds[1]) > 0
    assert int(memory[1]) > 50
    assert "step of a slider" in done.stdout
