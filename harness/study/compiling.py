"""Compile the kernels of a study before its first unit, in further processes where several are missing."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Protocol

from harness.config import Study
from harness.engine.further_processes import Compiles, compile_all
from harness.study.devices import device
from harness.study.evaluate import StudyEvaluator

_WORTH = 3
"""Missing kernels for each further process: its start takes as long as the compilation of one.

On a card a kernel takes several times as long, so each is worth a process.
"""


class CompilesStudy(Compiles, Protocol):
    """What kernels are compiled of: ``StudyEvaluator``, or that of a device."""

    @property
    def study(self) -> Study:
        """The study."""


def compile_kernels(evaluator: CompilesStudy, processes: int, say: Callable[[str], None]) -> None:
    """Compile the kernels of a study, or load them from the cache.

    Args:
        evaluator: The study.
        processes: That may work at a time, this one included.
        say: Told in words what is done.
    """
    study = evaluator.study

    def further(missing: int) -> int:
        return min(processes - 1, missing // _WORTH if study.device == "cpu" else missing - 1)

    compile_all(evaluator, partial(_evaluator, study), further, say)


def _evaluator(study: Study) -> Compiles:
    evaluator = StudyEvaluator(study)
    return evaluator if study.device == "cpu" else device(study.device).evaluator(evaluator)
