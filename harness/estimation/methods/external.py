"""Estimators from outside: a Python class, a library in C, an FMU or a network in ONNX, in worker processes.

What it gets and gives is in ``docs/estimators/external.md``. It states no covariance of the states, at most variances
of its estimates and the NIS.
"""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import BaseModel, BeforeValidator, ConfigDict, Field, model_validator

from harness.common.units import to_si
from harness.config.key_types import Quantity
from harness.engine.compile import CompiledModel
from harness.estimation.external_filter import ExternalFilter
from harness.estimation.external_loader import KINDS, kind_of
from harness.external.bodies import MODULES
from harness.external.references import installed
from harness.runner.contract import Filter

HAS_COVARIANCE = False


def _several(names: object) -> object:
    return [names] if isinstance(names, str) else names


Names = Annotated[list[str] | dict[str, str], BeforeValidator(_several)]
"""Signals; text is a single one."""

Texts = Annotated[list[str], BeforeValidator(_several)]


class Settings(BaseModel):
    """What runs, and what it gets and gives."""

    model_config = ConfigDict(extra="forbid")

    python: str | None = Field(default=None, description="`module:Class`, the module next to the study or installed")
    library: str | None = Field(default=None, description="shared library in C (`harness_estimator.h`)")
    fmu: str | None = Field(default=None, description="FMU of an observer, for co-simulation; with `filter` of a plant")
    onnx: str | None = Field(default=None, description="network")
    filter: Literal["ukf", "enkf", "particle"] | None = Field(
        default=None,
        description="of an FMU that is a plant: unscented or ensemble filter over its continuous states, or particles",
    )
    inputs: Names | None = Field(
        default=None,
        description="inputs of the belief in the order that it gets them, or a table of the units that it wants; "
        "as it declares, else all",
    )
    measurements: Names | None = Field(default=None, description="the same of what is measured")
    estimates: Names | None = Field(default=None, description="the same of the signals that it gives")
    values: Texts | None = Field(
        default=None,
        description="parameters and noise of the belief that it gets before a run, see the page; a Python class all",
    )
    variances: bool | None = Field(default=None, description="whether it gives the variances of its estimates")
    nis: bool | None = Field(default=None, description="whether it gives the NIS as well")
    timeout: Quantity = Field(default="60 s", description="by the clock, that a run may take")
    settings: dict[str, Any] = Field(default_factory=dict, description="handed on to it")
    files: Texts = Field(default_factory=list, description="further files that decide what it does")

    @model_validator(mode="after")
    def _one_file(self) -> Settings:
        stated = [name for name in KINDS if getattr(self, name) is not None]
        if len(stated) != 1:
            raise ValueError(
                f"state one of {', '.join(KINDS)}, {'not ' + ' and '.join(stated) if stated else 'there is none'}"
            )
        if self.filter is not None and self.fmu is None:
            raise ValueError("filter: it is one over the states of an FMU; state 'fmu'")
        if not to_si(self.timeout, "s", "timeout") > 0:
            raise ValueError("timeout: a run takes some time; give a positive one, e.g. '60 s'")
        return self


def filter_of(settings: Settings, compiled: CompiledModel, folder: Path) -> Filter:
    """Return the estimator, see ``harness.estimation.contract``."""
    return ExternalFilter(settings.model_dump(), compiled, folder)


def files(settings: Settings, folder: Path) -> tuple[Path, ...]:
    """Return the file of ours that runs it, which is imported by name, and an installed module that it names.

    What lies in the folder of the study belongs to the study.
    """
    named = [f"{MODULES[kind_of(settings.model_dump())]}:load", *([settings.python] if settings.python else [])]
    return tuple(path for path in map(installed, named) if path is not None)
