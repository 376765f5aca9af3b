"""Jobs that the faults strike: a study, a campaign, a trace, a remedy, an identification and a tuning, each small."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path

from rich.console import Console

from harness.common.errors import UserError, WorkError
from harness.config import load_study
from harness.recordings.read.write import write_recording
from harness.study.run import run_study
from support import campaign_folder
from support.driven_car import driven

STUDY = """
name = "faults"
targets = ["lateral_velocity"]
[plant]
vehicle = "car"
parameters = "govindarajan_2018"
tyre = "magic_formula"
sensors = "car_series"
[[drive]]
name = "sine"
kind = "sine"
amplitude = "20 deg"
duration = "5 s"
[[drive]]
name = "slow"
kind = "sine"
amplitude = "10 deg"
duration = "8 s"
[[estimator]]
kind = "ekf"
[[estimator]]
kind = "ukf"
[[design]]
name = "loads"
samples = 512
repeats = 4
factor = [{ parameter = "mass", range = ["1.4 t", "1.9 t"] }]
[[history]]
design = "loads"
drive = "sine"
band = "1.4 t to 1.9 t"
"""

REMEDY = """
name = "loads"
targets = ["lateral_velocity"]
plant = { vehicle = "car", parameters = "govindarajan_2018", tyre = "magic_formula", sensors = "car_series" }
drive = [{ name = "sine", kind = "sine", amplitude = "20 deg", duration = "5 s" }]
estimator = [{ kind = "ekf" }]
design = [{ name = "loads", samples = 32, repeats = 2, factor = [{ parameter = "mass", range = ["1.4 t", "1.9 t"] }] }]
"""

TUNING = "[[drive]]\nname = 'sine'\nkind = 'sine'\namplitude = '20 deg'\nduration = '20 s'\n"


@dataclass(frozen=True)
class Job:
    """A command that writes a folder.

    Attributes:
        name: What it is.
        arguments: Of the command line.
        out: The folder.
        timed: Files in it that hold durations, which no two runs share.
    """

    name: str
    arguments: tuple[str, ...]
    out: Path
    timed: tuple[str, ...] = ()

    def start(self, fault: str = "nothing", further: tuple[str, ...] = ()) -> subprocess.Popen[str]:
        """Start it in a process group of its own, with a fault of ``bench.faults.child`` if one is given."""
        return subprocess.Popen(
            [sys.executable, "-m", "bench.faults.child", fault, "--", *self.arguments, *further],
            stdout=subprocess.DEVNULL,
            stderr=subprocess.PIPE,
            stdin=subprocess.DEVNULL,
            text=True,
            start_new_session=True,
            env={**os.environ, "PYTHONPATH": os.pathsep.join([str(Path.cwd()), str(Path.cwd() / "tests")])},
        )

    def finish(self) -> str:
        """Run it to its end; return what is wrong, empty if nothing is.

        A study is run here, where its kernels are loaded already; its report tells durations and is not made.
        """
        if self.arguments[0] == "store":
            try:
                run_study(load_study(self.arguments[1]), self.out, 2, Console(quiet=True))
            except (UserError, WorkError) as error:
                return str(error)
            return ""
        process = self.start()
        said = process.communicate()[1]
        return "" if process.returncode == 0 else f"ended with {process.returncode}: {said.strip()[-300:]}"

    def clear(self) -> None:
        """Delete what it has written."""
        shutil.rmtree(self.out, ignore_errors=True)

    def bits(self) -> dict[str, bytes | object]:
        """Return every file that it has written; metadata as what they say, and without what tells durations."""
        contents: dict[str, bytes | object] = {}
        for path in sorted(p for p in self.out.rglob("*") if p.is_file()):
            name = path.relative_to(self.out).as_posix()
            if path.name not in ("run.json", "run.lock", *self.timed):
                contents[name] = json.loads(path.read_bytes()) if path.name == "zarr.json" else path.read_bytes()
        return contents


def jobs(folder: Path) -> dict[str, Job]:
    """Write what the commands read, and return them by name."""
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "faults.toml").write_text(STUDY, encoding="utf-8")
    (folder / "loads.toml").write_text(REMEDY, encoding="utf-8")
    (folder / "training.toml").write_text(TUNING, encoding="utf-8")
    for number, name in enumerate(("train", "test")):
        if not (folder / f"{name}.csv").exists():
            drive = driven(number, duration=30.0, mass=1.05 * 1800)
            write_recording(drive, folder / f"{name}.csv")
    campaign_folder.write_studies(folder / "studies")
    car = ("--model", "car", "--parameters", "blanco_2021", "--tyre", "linear", "--sensors", "car_navigation")
    train, test = str(folder / "train.csv"), str(folder / "test.csv")
    commands = {
        "study": ("store", str(folder / "faults.toml")),
        "campaign": ("campaign", str(folder / "studies"), "--out"),
        "identify": ("identify", *car, "--train", train, "--test", test, "--free", "stiffness_peak_front", "--out"),
        "trace": ("trace", *car, "--train", train, "--test", test, "--estimator", "", "--jobs", "2", "--out"),
        "remedy": ("remedy", str(folder / "loads.toml"), "--equipment", "1", "--yes", "--jobs", "2", "--out"),
        "tune": ("tune", str(folder / "faults.toml"), "--drive", str(folder / "training.toml"), "--budget", "48",
                 "--out"),
    }  # fmt: skip
    by_name = {}
    for name, arguments in commands.items():
        out = folder / f"out-{name}"
        where = out / "tuned.toml" if name == "tune" else out
        timed = ("report.html", "report.pdf") if name == "remedy" else ()  # of steps, as measured
        by_name[name] = Job(name, (*arguments, str(where)), out, timed)
    return by_name
