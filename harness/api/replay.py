"""``results.replay``: one run of a finished study computed again."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import xarray as xr

from harness.api._show import Shown
from harness.common.errors import UserError
from harness.common.registry import closest
from harness.config.alone import Change
from harness.study.replay import Place, Replayed
from harness.study.replayed import table
from harness.study.score_names import FLAGS, PER_RUN, PER_TARGET, STATUS
from harness.study.stored import Comparison, StoredRuns

if TYPE_CHECKING:
    import pandas as pd


class Replay(Shown):
    """A run computed again; made by ``Results.replay``.

    Attributes:
        data: Truth, estimates with standard deviations, innovations, NIS, NEES, measurements and inputs over ``time``,
            in SI units: ``truth (time, target)``; ``estimate`` and ``std (time, estimator, target)``; ``innovation``
            and ``innovation_std (time, estimator, output)``; ``nis`` and ``nees (time, estimator)``;
            ``measured_<output>`` and ``input_<name>`` over time. Targets are the signals of the study, then the other
            states that the estimators hold; the coordinate ``target_unit`` has their units. NaN from a divergence on.
        is_same: Whether the scores are those of the store to the last bit; ``None`` where other values were asked for.
        answer: The same in a sentence, with the reason where they are not.

    Example:
        >>> import tempfile, harness as h
        >>> study = h.Study(
        ...     plant=h.model("car", "govindarajan_2018", sensors="car_series"),
        ...     targets=["lateral_velocity"],
        ...     drives=[h.drive("sine", duration="10 s", amplitude="20 deg")],
        ...     estimators=["ekf"],
        ...     designs=[h.levels("mass", ["1.5 t", "1.8 t"], repeats=4)],
        ... )
        >>> run = study.run(tempfile.mkdtemp(), jobs=1).replay(band="1.8 t", repeat=3)
        >>> run.is_same, run.data.sizes["time"], "count_from" in run.toml
        (True, 1001, True)
    """

    def __init__(self, run: Replayed, comparison: Comparison | None, changes: Sequence[Change]) -> None:
        self._run, self._changes = run, changes
        self.data: xr.Dataset = run.data
        self.is_same = None if comparison is None else comparison.same
        said = ", ".join(f"{c.parameter} of the {c.of} {c.value}" for c in changes)
        self.answer = f"This run is in no store: {said}." if comparison is None else comparison.words

    @property
    def scores(self) -> pd.DataFrame:
        """The scores, SI units: a row per estimator and target, columns as ``Results.to_dataframe`` has them."""
        import pandas as pd

        run, words = self._run, {code: word for word, code in FLAGS.items()}
        estimators, units = ([str(e) for e in self.data[name].values] for name in ("estimator", "target_unit"))
        rows = [
            {
                "estimator": estimator,
                "target": target,
                "target_unit": unit,
                **{name: float(run.scores[name][i, k]) for name in PER_TARGET},
                **{name: float(run.scores[name][i]) for name in PER_RUN},
                STATUS: words[int(run.scores[STATUS][i])],
            }
            for i, estimator in enumerate(estimators)
            for k, (target, unit) in enumerate(zip(run.study.targets, units, strict=False))
        ]
        return pd.DataFrame(rows)

    @property
    def toml(self) -> str:
        """The study file that holds this run alone; ``harness run`` gives it the same scores."""
        return self._run.study.text

    def write(self, folder: str | Path) -> list[Path]:
        """Write ``study.toml``, which ``harness run`` takes, and ``run.csv``, all of ``data`` as a table.

        Raises:
            UserError: If the folder cannot be written to.
        """
        from harness.common.files import write_files

        csv = table(self.data).to_csv(index=False, lineterminator="\n")
        return write_files(Path(folder), {"study.toml": self.toml, "run.csv": csv})

    def _facts(self) -> dict[str, Any]:
        return {"study": self._run.study.title, "answer": self.answer}

    def _title(self) -> str:
        return "Run computed again"

    def _table(self) -> tuple[pd.DataFrame, str]:
        return self.scores, "scores"


class Replays(StoredRuns):
    """What computes runs of a result folder again for ``results.replay`` (internal)."""

    def place(self, design: str | None, band: str | int, drive: str | int, sample: int, repeat: int) -> Place:
        """Return which run it is.

        Raises:
            UserError: If there is none.
        """
        study = self.study
        at = _index("design", design if design is not None else 0, [d.name for d in study.designs])
        spec = study.designs[at]
        return Place(
            at,
            _index("band", band, list(spec.band_labels)),
            _index("drive", drive, [d.name for d in study.drives]),
            _index("sample", sample, list(map(str, range(spec.samples)))),
            _index("repeat", repeat, list(map(str, range(spec.repeats)))),
        )

    def run(self, place: Place, estimators: Sequence[str] | None = None, changes: Sequence[Change] = ()) -> Replay:
        """Compute a run again and compare it with the store."""
        names = [e.name for e in self.study.estimators]
        wanted = [estimators] if isinstance(estimators, str) else estimators
        if wanted is not None and not list(wanted):
            raise UserError(f"name at least one estimator; there are: {', '.join(names)}")
        chosen = None if wanted is None else [_index("estimator", name, names) for name in wanted]
        replayed = self.replayer.run(place, chosen, changes)
        return Replay(replayed, None if changes else self.comparison(replayed, self.stored(replayed)), changes)

    @staticmethod
    def changes(plant: Mapping[str, Any] | None, belief: Mapping[str, Any] | None) -> list[Change]:
        """Return the values that are asked for.

        Raises:
            UserError: If one side is no table.
        """
        for side, given in (("plant", plant), ("belief", belief)):
            if given is not None and not isinstance(given, Mapping):
                raise UserError(f"{side}: expected a dictionary such as {{'mass': '1.5 t'}}, got {given!r}")
        of_plant = [Change(name, value, "plant") for name, value in (plant or {}).items()]
        return of_plant + [Change(name, value, "belief") for name, value in (belief or {}).items()]


def _index(what: str, given: str | int, names: list[str]) -> int:
    """Return the index of a name, or the index itself.

    Raises:
        UserError: If there is no such thing.
    """
    if isinstance(given, str) and given in names:
        return list(names).index(given)
    if isinstance(given, int) and not isinstance(given, bool) and 0 <= given < len(names):
        return given
    near = closest(str(given), names) if isinstance(given, str) else f"; there are {len(names)}, counted from 0"
    raise UserError(f"there is no {what} {given!r}{near}")
