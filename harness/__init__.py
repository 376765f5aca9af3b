"""Robustness of vehicle state estimators, and what a model lacks: one package per stage (docs/structure.md).

What is named here is the public interface (docs/api.md); everything else is internal. Names are imported when they are
first asked for, so that ``import harness`` costs next to nothing.
"""

from __future__ import annotations

import importlib
import os
import sys

# ``python -m`` looks into the working directory first, where whoever filled it may have named a file as a package that
# is imported here is named. Where this package lies there itself, what lies next to it is as good.
if sys.argv[:1] == ["-m"] and not sys.flags.safe_path and sys.path[0] != os.path.dirname(os.path.dirname(__file__)):
    del sys.path[0]

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    __version__: str
    from harness.api.diagnosis import Diagnosis as Diagnosis
    from harness.api.drive import Drive as Drive
    from harness.api.drive import drive as drive
    from harness.api.estimates import Estimates as Estimates
    from harness.api.estimates import estimate as estimate
    from harness.api.estimator import Estimator as Estimator
    from harness.api.experiment import NextDrive as NextDrive
    from harness.api.experiment import next_drive as next_drive
    from harness.api.export import ExportedEstimator as ExportedEstimator
    from harness.api.export import ExportedPlant as ExportedPlant
    from harness.api.export import export_estimator as export_estimator
    from harness.api.export import export_plant as export_plant
    from harness.api.identification import Identification as Identification
    from harness.api.identification import identify as identify
    from harness.api.model import Model as Model
    from harness.api.model import model as model
    from harness.api.monitor import TrustMonitor as TrustMonitor
    from harness.api.monitor import count_monitor as count_monitor
    from harness.api.realtime import RealTime as RealTime
    from harness.api.realtime import time_steps as time_steps
    from harness.api.recordings import Check as Check
    from harness.api.recordings import check as check
    from harness.api.recordings import observability as observability
    from harness.api.recordings import read_recording as read_recording
    from harness.api.recordings import simulate as simulate
    from harness.api.remedy import Remedies as Remedies
    from harness.api.remedy import try_remedies as try_remedies
    from harness.api.replay import Replay as Replay
    from harness.api.results import Results as Results
    from harness.api.results import open_results as open_results
    from harness.api.study import Study as Study
    from harness.api.study import design as design
    from harness.api.study import factor as factor
    from harness.api.study import levels as levels
    from harness.api.study import read_study as read_study
    from harness.api.tune import TunedNoise as TunedNoise
    from harness.api.tune import TunedStudy as TunedStudy
    from harness.api.tune import tune as tune
    from harness.api.tune import tune_noise as tune_noise
    from harness.common.components import register as register
    from harness.common.errors import ModelError as ModelError
    from harness.common.errors import UserError as UserError

_PLACES = {
    "harness.api.diagnosis": ("Diagnosis",),
    "harness.api.drive": ("Drive", "drive"),
    "harness.api.estimates": ("Estimates", "estimate"),
    "harness.api.estimator": ("Estimator",),
    "harness.api.experiment": ("NextDrive", "next_drive"),
    "harness.api.export": ("ExportedEstimator", "ExportedPlant", "export_estimator", "export_plant"),
    "harness.api.identification": ("Identification", "identify"),
    "harness.api.model": ("Model", "model"),
    "harness.api.monitor": ("TrustMonitor", "count_monitor"),
    "harness.api.realtime": ("RealTime", "time_steps"),
    "harness.api.recordings": ("Check", "check", "observability", "read_recording", "simulate"),
    "harness.api.remedy": ("Remedies", "try_remedies"),
    "harness.api.replay": ("Replay",),
    "harness.api.results": ("Results", "open_results"),
    "harness.api.study": ("Study", "design", "factor", "levels", "read_study"),
    "harness.api.tune": ("TunedNoise", "TunedStudy", "tune", "tune_noise"),
    "harness.common.components": ("register",),
    "harness.common.errors": ("ModelError", "UserError"),
}
_PLACE_OF = {name: module for module, names in _PLACES.items() for name in names}

__all__ = sorted(_PLACE_OF)


def __getattr__(name: str) -> Any:
    """Import a public name when it is first asked for."""
    if name == "__version__":
        from importlib.metadata import version

        return version("robustness-harness")
    if name not in _PLACE_OF:
        raise AttributeError(f"module 'harness' has no attribute '{name}'; it offers {', '.join(__all__)}")
    public = getattr(importlib.import_module(_PLACE_OF[name]), name)
    globals()[name] = public
    return public


def __dir__() -> list[str]:
    return ["__version__", *__all__]
