"""Study file in, ``StudySpec`` out: everything checked, every number SI, every default filled in.

``schema`` holds the keys, ``model`` resolves plant and belief, ``entries`` drives and estimators, ``factors`` and
``designs`` the designs; ``load`` puts them together, and ``specs`` is what all later stages read.
"""

from harness.config.entries import load_drives, single_drive, single_estimator
from harness.config.load import build_study, load_study
from harness.config.model import resolve_single
from harness.config.model_choice import complete, fitting_sensors, largest_sensors
from harness.config.schema import StudyFile, study_schema, write_schema
from harness.config.specs import (
    NOISE_GROUPS,
    NOISE_SCALES,
    DesignSpec,
    DriveSpec,
    EstimatorSpec,
    FactorSpec,
    HistorySpec,
    InputSignal,
    ModelSpec,
    StudySpec,
)

__all__ = [
    "NOISE_GROUPS",
    "NOISE_SCALES",
    "DesignSpec",
    "DriveSpec",
    "EstimatorSpec",
    "FactorSpec",
    "HistorySpec",
    "InputSignal",
    "ModelSpec",
    "StudyFile",
    "StudySpec",
    "build_study",
    "complete",
    "fitting_sensors",
    "largest_sensors",
    "load_drives",
    "load_study",
    "resolve_single",
    "single_drive",
    "single_estimator",
    "study_schema",
    "write_schema",
]
