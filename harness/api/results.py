"""``harness.open_results``: the scores of a finished study as one xarray DataTree, and as a table."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd
import xarray as xr
from numpy.typing import NDArray

from harness.models.quantities import quantity
from harness.study.results import Design, StudyResults, read
from harness.study.scores import FLAGS, PER_RUN, PER_TARGET, STATUS

if TYPE_CHECKING:
    from harness.study.report.analysis import Analysis

_INDEX = ("band", "drive", "sample", "repeat", "estimator")


def open_results(folder: str | Path) -> Results:
    """Open the result folder of a study.

    Args:
        folder: Result folder, such as ``results/mass``.

    Returns:
        The results; all of it is read, and its files checked against their checksums.

    Raises:
        UserError: If there is no store, it is not one that a study wrote, or files of it are missing or damaged.

    Example:
        >>> import tempfile, harness as h
        >>> study = h.Study(
        ...     plant=h.model("car", "govindarajan_2018", sensors="car_series"),
        ...     targets=["lateral_velocity"],
        ...     drives=[h.drive("sine", duration="10 s", amplitude="20 deg")],
        ...     estimators=["ekf"],
        ...     designs=[h.levels("mass", ["1.5 t", "1.8 t"], repeats=4)],
        ... )
        >>> folder = tempfile.mkdtemp()
        >>> _ = study.run(folder, jobs=1)
        >>> results = h.open_results(folder)
        >>> results["mass/rmse"].dims
        ('band', 'sample', 'drive', 'repeat', 'estimator', 'target')
    """
    found = read(Path(folder))
    root = xr.Dataset(attrs={**found.attributes, "folder": str(folder)})
    nodes = {d.name: d.data for d in found.designs}
    runs = {f"history/{i}": history for i, history in enumerate(found.histories)}
    tree = Results.from_dict({"/": root, **nodes, **runs}, name=str(found.attributes.get("study_name", "")))
    tree._read = found
    return tree


class Results(xr.DataTree):
    """The results of a study: a DataTree with one node per design and one per run that was kept over time.

    ``results["<design>"]`` has the dimensions ``band`` (level), ``sample`` (Sobol point), ``drive``, ``repeat``,
    ``estimator`` and ``target``. Variables over all of them: ``rmse``, ``bias``, ``max_error``, in the SI unit of the
    target, which is in the coordinate ``target_unit``. Over all but ``target``: ``nees``, ``nis``, ``nees_inside``,
    ``nis_inside``, ``log_likelihood``, ``repairs``, ``updates``, ``time_of_divergence`` (s) and ``status``, whose codes
    are in its attributes ``flag_values`` and ``flag_meanings``. ``factor_<parameter>`` over ``(band, sample)`` is what
    was varied, in SI units. Coordinates: ``drive``, ``estimator``, ``target``, ``band_label``, ``target_unit``,
    ``duration`` (s).

    ``results["history/<i>"]`` has ``truth (time, target)``, ``estimate`` and ``std (time, estimator, target)``,
    ``measured_<output>`` and ``input_<name>`` over ``time`` (s).
    """

    __slots__ = ("_analysed", "_read")

    _read: StudyResults | None
    _analysed: Analysis | None

    @property
    def folder(self) -> Path:
        """The result folder."""
        return self._found.directory

    @property
    def _found(self) -> StudyResults:
        """The same as the report takes it; read again where xarray has made a new tree of this one."""
        found = getattr(self, "_read", None)
        if found is None:
            found = self._read = read(Path(str(self.root.attrs["folder"])))
        return found

    def to_dataframe(self, design: str | None = None, report_units: bool = False) -> pd.DataFrame:
        """Return the scores as a tidy table: one row per run, estimator and target.

        Args:
            design: One design; all of them by default.
            report_units: Whether errors and factors are in the units of reports (deg, kN, t) in place of SI units.

        Returns:
            Columns ``design``, ``band`` (label), one per factor, ``drive``, ``sample``, ``repeat``, ``estimator``,
            ``target``, ``unit`` (of the errors), ``rmse``, ``bias``, ``max_error``, the scores of the run, and
            ``status`` in words. Labels are categories in the order of the study. ``attrs["units"]`` has the unit of
            every column that has one. Scores of runs that are not ``ok`` are as stored; select with ``status``.

        Raises:
            KeyError: If there is no design of that name.
        """
        wanted = [d for d in self._found.designs if design in (None, d.name)]
        if not wanted:
            raise KeyError(f"there is no design '{design}'; there are {', '.join(d.name for d in self._found.designs)}")
        tables = [_rows(d, report_units) for d in wanted]
        table = pd.concat(tables, ignore_index=True) if len(tables) > 1 else tables[0]
        for name in ("design", "band", "drive", "estimator", "target", STATUS):
            words = dict.fromkeys(word for each in tables for word in each[name].cat.categories)
            table[name] = pd.Categorical(table[name], categories=list(words))
        table.attrs = {"units": {k: v for each in tables for k, v in each.attrs["units"].items()}}
        return table

    @property
    def answer(self) -> str:
        """The answer of the study in a sentence, as the report begins with it."""
        from harness.study.report import headline

        return headline(self._analysis())

    @property
    def is_verifiable(self) -> bool:
        """Whether the store has checksums, so that none of its files can be missing or damaged unnoticed."""
        return self._found.is_verifiable

    def report(self) -> list[Path]:
        """Write ``report.html`` and ``report.pdf`` into the result folder and return their paths.

        Raises:
            UserError: If the folder cannot be written to.
        """
        from harness.study.report import write_report

        return write_report(self._analysis())

    def _analysis(self) -> Analysis:
        from harness.study import report

        made = getattr(self, "_analysed", None)
        if made is None:
            made = self._analysed = report.Analysis(self._found)
        return made


def _rows(design: Design, report_units: bool) -> pd.DataFrame:
    """Return the table of one design."""
    data = design.data
    sizes = {dim: data.sizes[dim] for dim in (*_INDEX, "target")}
    places = dict(zip(sizes, (i.ravel() for i in np.indices(list(sizes.values()))), strict=True))
    units: dict[str, str] = {"time_of_divergence": "s"}
    table: dict[str, Any] = {
        "design": _labels(np.zeros_like(places["band"]), [design.name]),
        "band": _labels(places["band"], [str(b) for b in data["band_label"].values]),
    }
    rows = json.loads(data.attrs.get("factors", "[]"))
    for row, factor in zip(rows, design.factors, strict=True):
        stored = data[f"factor_{row['name']}"].transpose("band", "sample").values
        values = factor.values if report_units else stored
        table[factor.name] = values[places["band"], places["sample"]]
        units[factor.name] = str(row["unit"] if report_units else row["si_unit"])
    table["drive"] = _labels(places["drive"], design.drives)
    table |= {name: places[name] for name in ("sample", "repeat")}
    table["estimator"] = _labels(places["estimator"], design.estimators)
    names = [str(t) for t in data["target"].values]
    table["target"] = _labels(places["target"], names)
    stated = [str(u) for u in data["target_unit"].values]
    shown = [quantity(n, u) for n, u in zip(names, stated, strict=True)]
    table["unit"] = _labels(places["target"], [q.unit for q in shown] if report_units else stated)
    scale = np.array([q.scale if report_units else 1.0 for q in shown])[places["target"]]
    for name in (n for n in PER_TARGET if n in data):
        table[name] = data[name].transpose(*_INDEX, "target").values.ravel() * scale
    for name in (n for n in PER_RUN if n in data):
        table[name] = np.repeat(data[name].transpose(*_INDEX).values.ravel(), sizes["target"])
    words = {code: word for word, code in FLAGS.items()}
    codes = np.repeat(data[STATUS].transpose(*_INDEX).values.ravel(), sizes["target"])
    table[STATUS] = pd.Categorical([words[int(code)] for code in codes], categories=list(FLAGS))
    frame = pd.DataFrame(table)
    frame.attrs["units"] = units
    return frame


def _labels(places: NDArray[np.int64], words: list[str]) -> pd.Categorical[str]:
    """Return words by place as categories in their order; words may occur twice."""
    unique = list(dict.fromkeys(words))
    codes = np.array([unique.index(w) for w in words])
    return pd.Categorical.from_codes(codes[places], pd.Index(unique))
