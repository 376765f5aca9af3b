"""``harness.export_estimator`` and ``harness.export_plant``: what a study ran, as C99 and as an FMU."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from harness.api._show import Shown
from harness.api.study import Study

if TYPE_CHECKING:
    from harness.realtime.export.fmi.component import FmuComponent


def export_estimator(
    study: Study,
    estimator: str | None = None,
    *,
    parameters: str | Path | None = None,
    precision: Literal["double", "float"] = "double",
    name: str | None = None,
    drive: str | None = None,
    duration: float | str = "20 s",
    fmi: Literal[2, 3] | None = None,
    monitor: str | Path | None = None,
) -> ExportedEstimator:
    """Print an estimator of a study as C99, from the kernels that the study runs.

    Args:
        study: The study; its designs do not matter.
        estimator: Name of one of its estimators; the first by default.
        parameters: Parameter file that it believes in place of the study's belief, such as the ``belief.toml`` of
            remedies or the ``amended.toml`` of a trace.
        precision: Of the numbers in C.
        name: That everything in C begins with; names of study and estimator by default.
        drive: Name of the drive of the recorded run that comes with it; the first of the study by default.
        duration: How much of it is recorded, in s or text with a unit.
        fmi: Version of FMI of an FMU for co-simulation in addition to the C; none by default.
        monitor: File of its trust monitor, which ``harness.count_monitor`` writes; it is printed next to it.

    Returns:
        The files.

    Raises:
        UserError: If there is no such estimator, drive or file, or the estimator cannot be printed.

    Example:
        >>> import harness as h
        >>> study = h.Study(
        ...     plant=h.model("car", "govindarajan_2018", sensors="car_series"),
        ...     targets=["lateral_velocity"],
        ...     drives=[h.drive("sine", duration="10 s", amplitude="20 deg")],
        ...     estimators=["ekf"],
        ...     designs=[h.design("nominal")],
        ...     name="car",
        ... )
        >>> exported = h.export_estimator(study, duration="2 s")
        >>> "void car_ekf_step(car_ekf *e, const car_ekf_inputs *inputs" in exported.files["car_ekf.h"]
        True
    """
    from rich.console import Console

    from harness.common.stages import showing
    from harness.common.units import to_si
    from harness.realtime.export.fmi.component import of_estimator
    from harness.realtime.export.run import believing, export

    spec = study.spec if parameters is None else believing(study.spec, Path(parameters))
    seconds, watched = to_si(duration, "s", "duration"), None if monitor is None else Path(monitor)
    with showing(Console(stderr=True), "exporting") as show:
        made = export(spec, estimator, precision, name, (drive, seconds), show, watched)
    component = (
        None if fmi is None else of_estimator(made.export, made.estimator.has_covariance, made.inputs[0].tolist())
    )
    return ExportedEstimator(made.export.name, made.answer, made.files, component, fmi)


def export_plant(
    study: Study,
    *,
    parameters: str | Path | None = None,
    precision: Literal["double", "float"] = "double",
    name: str | None = None,
    fmi: Literal[2, 3] | None = None,
) -> ExportedPlant:
    """Print the plant of a study as C99, without noise, integrated by the kernel that the study runs.

    Args:
        study: The study.
        parameters: Parameter file that it is in place of the study's plant, such as the ``amended.toml`` of a trace.
        precision: Of the numbers in C.
        name: That everything in C begins with; the name of the study and ``plant`` by default.
        fmi: Version of FMI of an FMU for co-simulation in addition to the C; none by default.

    Returns:
        The files.

    Raises:
        UserError: If there is no such file, or the plant cannot be printed.

    Example:
        >>> import harness as h
        >>> study = h.Study(
        ...     plant=h.model("car", "govindarajan_2018", sensors="car_series"),
        ...     targets=["lateral_velocity"],
        ...     drives=[h.drive("sine", duration="10 s", amplitude="20 deg")],
        ...     estimators=["ekf"],
        ...     designs=[h.design("nominal")],
        ...     name="car",
        ... )
        >>> "void car_plant_step(car_plant *e, const car_plant_inputs *inputs);" in h.export_plant(study).files[
        ...     "car_plant.h"
        ... ]
        True
    """
    from harness.realtime.export.fmi.component import of_a_plant
    from harness.realtime.export.plant import files, printed_plant
    from harness.realtime.export.run import believing

    spec = study.spec if parameters is None else believing(study.spec, Path(parameters))
    made = printed_plant(spec, parameters is not None, precision, name)
    return ExportedPlant(made.name, made.answer, files(made), None if fmi is None else of_a_plant(made), fmi)


class _Exported(Shown):
    """What was printed.

    Args:
        name: That everything in C begins with.
        answer: What it is, in a sentence.
        files: Text by file name.
        component: What an FMU is made of; ``None`` without one.
        fmi: Its version.
    """

    def __init__(
        self, name: str, answer: str, files: Mapping[str, str], component: FmuComponent | None, fmi: int | None
    ) -> None:
        self.name, self.answer = name, answer
        self.files: dict[str, str | bytes] = dict(files)
        if component is not None and fmi is not None:
            from harness.realtime.export.fmi.archive import COMPILERS, fmu

            content, has_binary = fmu(component, fmi)
            self.files[f"{name}.fmu"] = content
            what = "the binary of this machine" if has_binary else f"sources only: there is no {', '.join(COMPILERS)}"
            self.answer += f"; {name}.fmu is for FMI {fmi}.0 with {what}"

    def write(self, folder: str | Path) -> list[Path]:
        """Write the files into a folder, made if absent or of an earlier export; return their paths.

        Raises:
            UserError: If the folder cannot be written to, or holds files of these names that are of something else.
        """
        from harness.common.errors import UserError
        from harness.common.files import write_files

        there = [name for name in self.files if (Path(folder) / name).exists()]
        if there and f"{self.name}.h" not in there:
            raise UserError(
                f"{folder}: holds '{there[0]}', which is not of '{self.name}' and would be written over; "
                "take another folder"
            )
        return write_files(Path(folder), self.files)

    def _facts(self) -> Mapping[str, Any]:
        return {"answer": self.answer, "files": ", ".join(self.files)}


class ExportedEstimator(_Exported):
    """An estimator as C99; made by ``harness.export_estimator``.

    Attributes:
        name: That everything in C begins with.
        answer: What it is, in a sentence.
        files: Text by file name, bytes of an FMU.
    """


class ExportedPlant(_Exported):
    """A plant as C99; made by ``harness.export_plant``.

    Attributes:
        name: That everything in C begins with.
        answer: What it is, in a sentence.
        files: Text by file name, bytes of an FMU.
    """
