"""Exported FMUs under an importer that is not FMPy: the FMU Manipulation Toolbox. See docs/export.md.

    pip install fmu-manipulation-toolbox && python -m bench.fmu_container

Its checks read plant and estimator of the mass study, in FMI 2.0 and 3.0, and its master, which is written in C, drives
both as one FMU: steering goes into the plant, the yaw rate that the plant gives into the estimator. Beside it the same
two in a loop of FMPy.
"""

from __future__ import annotations

import shutil
import subprocess
import tempfile
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from harness.cli.options import study_path
from harness.common.arguments import Parser
from harness.common.arrays import Floats
from harness.common.errors import UserError, WorkError
from harness.common.files import write_files
from harness.config import load_study
from harness.realtime.export.fmi.archive import fmu
from harness.realtime.export.fmi.component import of_a_plant, of_estimator
from harness.realtime.export.plant import printed_plant
from harness.realtime.export.run import export

STEP, SAMPLES, SPEED = 0.01, 1500, 15.0
LINKS = """rule;from_fmu;from_port;to_fmu;to_port
FMU;plant.fmu;;;
FMU;estimator.fmu;;;
INPUT;;steering_wheel_angle;plant.fmu;steering_wheel_angle
INPUT;;speed;plant.fmu;speed
INPUT;;known_speed;estimator.fmu;speed
LINK;plant.fmu;yaw_rate_trailer;estimator.fmu;yaw_rate_trailer
OUTPUT;estimator.fmu;estimate_lateral_force_axle_21;;estimate
OUTPUT;plant.fmu;lateral_force_axle_21;;truth
"""


class Instance:
    """An FMU in FMPy, begun."""

    def __init__(self, path: Path, **first: float) -> None:
        import fmpy
        from fmpy.fmi2 import FMU2Slave
        from fmpy.fmi3 import FMU3Slave

        described = fmpy.read_model_description(str(path))
        two = described.fmiMajorVersion == 2
        self._places = {v.name: v.valueReference for v in described.modelVariables}
        self._fmu = (FMU2Slave if two else FMU3Slave)(
            guid=described.guid,
            modelIdentifier=described.coSimulation.modelIdentifier,
            unzipDirectory=fmpy.extract(str(path), str(path.with_suffix(""))),
        )
        self._set, self._get = ("setReal", "getReal") if two else ("setFloat64", "getFloat64")
        self._fmu.instantiate()
        if two:
            self._fmu.setupExperiment(startTime=0.0)
        self._fmu.enterInitializationMode()
        self.set(**first)
        self._fmu.exitInitializationMode()

    def set(self, **values: float) -> None:
        """Set variables."""
        getattr(self._fmu, self._set)([self._places[n] for n in values], list(values.values()))

    def get(self, name: str) -> float:
        """Return a variable."""
        return float(getattr(self._fmu, self._get)([self._places[name]])[0])

    def step(self, k: int) -> None:
        """Take a step from sample ``k``."""
        self._fmu.doStep(k * STEP, STEP)


def steering(k: int) -> float:
    """Return the angle of the steering wheel at a sample, in rad."""
    return float(0.5 * np.sin(2.0 * np.pi * 0.2 * STEP * k))


def apart(folder: Path) -> Floats:
    """Return force and its estimate of plant and estimator in a loop ``(samples, 2)``."""
    plant = Instance(folder / "plant.fmu", steering_wheel_angle=steering(0), speed=SPEED)
    estimator, rows = Instance(folder / "estimator.fmu", speed=SPEED), []
    for k in range(SAMPLES):
        plant.set(steering_wheel_angle=steering(k), speed=SPEED)
        plant.step(k)
        estimator.set(speed=SPEED, yaw_rate_trailer=plant.get("yaw_rate_trailer"))
        estimator.step(k)
        rows.append([plant.get("lateral_force_axle_21"), estimator.get("estimate_lateral_force_axle_21")])
    return np.array(rows)


def together(folder: Path) -> Floats:
    """Return the same of the container."""
    first = {"steering_wheel_angle": steering(0), "speed": SPEED, "known_speed": SPEED}
    both, rows = Instance(folder / "both.fmu", **first), []
    for k in range(SAMPLES):
        both.set(steering_wheel_angle=steering(k), speed=SPEED, known_speed=SPEED)
        both.step(k)
        rows.append([both.get("truth"), both.get("estimate")])
    return np.array(rows)


def _run(*words: str) -> str:
    done = subprocess.run(words, capture_output=True, text=True, check=False)
    if done.returncode or "ERROR" in done.stderr:
        raise WorkError(f"{words[0]}: {' '.join((done.stderr + done.stdout).split())[-300:]}")
    return done.stdout + done.stderr


def main(arguments: Sequence[str] | None = None) -> None:
    """Print a line for each version."""
    Parser(prog="python -m bench.fmu_container", description=__doc__.splitlines()[0]).parse_args(arguments)
    if missing := [t for t in ("fmutool", "fmucontainer") if shutil.which(t) is None]:
        raise UserError(f"not installed: {', '.join(missing)}; pip install fmu-manipulation-toolbox")
    study = load_study(study_path("mass"))
    plant, exported = of_a_plant(printed_plant(study)), export(study, "UKF", recorded=(None, 1.0))
    estimator = of_estimator(exported.export, True, [SPEED, 0.0])
    for version in (2, 3):
        with tempfile.TemporaryDirectory() as place:
            folder = Path(place)
            contents = {"plant.fmu": fmu(plant, version)[0], "estimator.fmu": fmu(estimator, version)[0]}
            for path in write_files(folder, {**contents, "both.csv": LINKS})[:2]:
                said = _run("fmutool", "-input", str(path), "-check")
                if "seems to be compliant" not in said or "No semantic error" not in said:
                    raise WorkError(f"{path.name}: fmutool says {' '.join(said.split())[-300:]}")
            words = ["-fmu-directory", str(folder), "-container", f"both.csv:{STEP}", "-fmi", str(version)]
            _run("fmucontainer", *words, "-sequential", "-no-auto-input", "-no-auto-output")
            loop, container = apart(folder), together(folder)
        off, largest = np.abs(container - loop).max(axis=0), np.abs(loop).max(axis=0)
        print(
            f"FMI {version}: both comply; force up to {largest[0]:.0f} N, estimate up to {largest[1]:.0f} N; the "
            f"container differs from a loop by {off[0]:g} N and {off[1]:g} N"
        )


if __name__ == "__main__":
    main()
