"""Results of the studies of a campaign, read once and asked for by names."""

from __future__ import annotations

from functools import cached_property
from pathlib import Path

import numpy as np
import xarray as xr

from harness.common.arrays import Floats
from harness.common.errors import UserError
from harness.realtime import outcome
from harness.study.report.analysis import Analysis
from harness.study.results import Design, StudyResults, read
from harness.study.score_names import PENDING
from harness.study.store import STORE
from reproductions.campaign.claims import THEIRS

STUDIES = ("ideal", "process-noise", "mass", "cog", "friction", "tyre", "joint")
"""Studies of the campaign: those of the dissertation, on which its findings are tested, and the joint one."""

REALTIME = "realtime"


class Results:
    """The finished studies below a folder.

    Args:
        folder: Holds one result folder per study, named like it.

    Raises:
        UserError: If a study that the claims need is not there.
    """

    study_names: tuple[str, ...] = THEIRS
    """Names of the dissertation's studies that there are."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        stores = dict.fromkeys(STUDIES, STORE) | {REALTIME: outcome.STORE}
        missing = [name for name, store in stores.items() if not (folder / name / store).is_dir()]
        if missing:
            commands = [_command(name, folder) for name in missing]
            raise UserError("\n".join([f"{folder}: {len(missing)} studies are not there yet; run", *commands]))

    @cached_property
    def stores(self) -> dict[str, StudyResults]:
        """The stores of the campaign, by the name of their study."""
        stores = {name: read(self.folder / name) for name in STUDIES}
        for name, store in stores.items():
            pending = sum(d.count(PENDING) for d in store.designs)
            if pending:
                command = _command(name, self.folder)
                raise UserError(f"{self.folder / name}: {pending} runs are still to come; finish them with '{command}'")
        return stores

    @cached_property
    def analyses(self) -> dict[str, Analysis]:
        """The analyses of the stores."""
        return {name: Analysis(store) for name, store in self.stores.items()}

    def errors(self, study: str, band: str | None, estimator: str, target: str) -> Floats:
        """Return the RMSE of a group of runs in report units, ``(stratum, sample, repeat)``, as ``Design.errors``.

        Args:
            study: Its first design is meant, which is the dissertation's.
            band: Label of the level; None for all levels, each with strata of its own.
            estimator: Name.
            target: Signal name.

        Raises:
            UserError: If the study has no such level, estimator or target.
        """
        design = self.design(study)
        t = _index(study, "target", target, [q.name for q in design.targets])
        e = _index(study, "estimator", estimator, design.estimators)
        chosen = range(len(design.bands)) if band is None else [_index(study, "level", band, design.bands)]
        return np.concatenate([design.errors[t, b, e] for b in chosen])

    def diverged(self, study: str, band: str, estimator: str) -> tuple[int, int]:
        """Return in how many runs of a group the estimator diverged, and how many there are of a vehicle in control."""
        design = self.design(study)
        b, e = _index(study, "level", band, design.bands), _index(study, "estimator", estimator, design.estimators)
        return design.diverged(e, b), design.compared(b)

    def bands(self, study: str) -> list[str]:
        """Return the labels of the levels of a study's first design."""
        return self.design(study).bands

    @cached_property
    def times(self) -> xr.Dataset:
        """What ``harness realtime`` measured."""
        return outcome.read(self.folder / REALTIME)

    def design(self, study: str) -> Design:
        """Return the first design of a study."""
        return self.stores[study].designs[0]


def _command(name: str, folder: Path) -> str:
    """Return the command that makes the result of a name below a folder."""
    begin = "harness realtime mass --drive fast-sine" if name == REALTIME else f"harness run {name}"
    return f"{begin} --out {folder / name}"


def _index(study: str, kind: str, name: str, there: list[str]) -> int:
    if name not in there:
        raise UserError(
            f"study '{study}' has no {kind} '{name}', which the campaign compares; it has: {', '.join(there)}"
        )
    return there.index(name)
