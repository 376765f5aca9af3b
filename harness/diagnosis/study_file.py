"""A loop file: what every file about measured drives holds (``identification.measured_file``), and what a trace takes.

::

    stated_noise = true                                   # noise is held as stated, not refitted

    [[exclude]]
    effect = "payload_shift"
    reason = "nobody moved in the car"

    [changed]                                             # traced again from the amended model, all of it held
    question = "Did the tyres change?"
    train = [{ file = "taped.csv" }]
    test = [{ file = "taped_again.csv" }]

    [worth]                                               # this study with the amended plant and both beliefs
    study = "../mass.toml"                                # from this file
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, ClassVar

from pydantic import Field, StrictBool, StrictInt

from harness.common.registry import closest
from harness.config.problems import Problems
from harness.config.schema import Name, StrictTable
from harness.diagnosis.result.estimator_gain import ESTIMATORS
from harness.diagnosis.result.study_gain import REPEATS
from harness.identification.measured_file import MeasuredFile, MeasuredStudy, SpanTable
from harness.models.roles import EFFECTS


class ExcludeTable(StrictTable):
    """An effect that is not to be tried."""

    effect: Name = Field(description="file in models/effects")
    reason: Name = Field(description="why it cannot be there")


class ChangedTable(StrictTable):
    """Drives in which the vehicle may have changed."""

    question: Name = Field(description="title of its report")
    train: list[SpanTable] = Field(min_length=1, description="drives to fit")
    test: list[SpanTable] = Field(min_length=1, description="held-out drives")


class WorthTable(StrictTable):
    """A study with the amended plant, in which the estimators believe either model."""

    study: Name = Field(description="study file, from this file; of the same vehicle and tyre")
    repeats: Annotated[StrictInt, Field(ge=1)] = Field(
        default=REPEATS, description="runs of each level and drive with other noise"
    )


class LoopFile(MeasuredFile):
    """The whole file."""

    rounds: Annotated[StrictInt, Field(ge=1, le=20)] = Field(default=8, description="largest number of additions")
    estimators: list[Name] = Field(
        default=list(ESTIMATORS), description="estimators to run on the held-out drives with both models"
    )
    stated_noise: StrictBool = Field(default=False, description="hold the noise that the model states")
    exclude: list[ExcludeTable] = Field(default_factory=list, description="effects that are not to be tried")
    changed: ChangedTable | None = Field(default=None, description="drives in which the vehicle may have changed")
    worth: WorthTable | None = Field(default=None, description="study in which the gain of the amendment is measured")


@dataclass(frozen=True)
class LoopStudy(MeasuredStudy):
    """A loop file, read."""

    SCHEMA: ClassVar[type[MeasuredFile]] = LoopFile

    raw: LoopFile

    @property
    def excluded(self) -> frozenset[str]:
        """Effects that are not tried."""
        return frozenset(e.effect for e in self.raw.exclude)

    def spans(self) -> dict[str, list[SpanTable]]:
        """Return the spans by key; those of ``[changed]`` as ``changed.train``, ``changed.test``."""
        changed = self.raw.changed
        further = {} if changed is None else {"changed.train": changed.train, "changed.test": changed.test}
        return super().spans() | further


def load_loop(path: Path) -> LoopStudy:
    """Read a loop file.

    Raises:
        UserError: If anything in it is wrong; one line per problem.
    """
    study, problems, effects = LoopStudy.read(path), Problems(str(path)), EFFECTS.names()
    for i, excluded in enumerate(study.raw.exclude):
        if excluded.effect not in effects:
            message = f"there is no effect '{excluded.effect}'{closest(excluded.effect, effects)}"
            problems.add(f"exclude[{i}].effect", message)
    problems.stop()
    return study
