"""``harness.open_results``: the scores of a finished study as one xarray DataTree, and as a table."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd
import xarray as xr
from numpy.typing import NDArray

from harness.common.places import place
from harness.common.units import scale
from harness.models.quantities import quantity
from harness.study.checksums import HISTORY
from harness.study.results import StudyResults, read
from harness.study.score_names import FLAGS, PER_RUN, PER_TARGET, STATUS

if TYPE_CHECKING:
    from harness.api.replay import Replay, Replays
    from harness.study.report.analysis import Analysis

_INDEX = ("band", "drive", "sample", "repeat", "estimator")
_WORDS = ("band_label", "drive", "estimator", "target", "target_unit")


def open_results(folder: str | Path) -> Results:
    """Open the result folder of a study.

    Args:
        folder: Result folder, such as ``results/mass``, or its URL.

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
    stored = read(place(folder))
    root = xr.Dataset(attrs={**stored.attributes, "folder": str(folder)})
    nodes = {d.name: _ordered(d.data) for d in stored.designs}
    runs = {f"history/{i}": history for i, history in enumerate(stored.histories)}
    tree = Results.from_dict({"/": root, **nodes, **runs}, name=str(stored.attributes.get("study_name", "")))
    tree._read = stored
    return tree


class Results(xr.DataTree):
    """The results of a study: a DataTree with one node per design and one per run that was kept over time.

    ``results["<design>"]`` has the dimensions ``band`` (level), ``sample`` (Sobol point), ``drive``, ``repeat``,
    ``estimator`` and ``target``. Variables over all of them: ``rmse``, ``bias``, ``max_error``, in the SI unit of the
    target, which is in the coordinate ``target_unit``. Over all but ``target``: ``nees``, ``nis``, ``nees_inside``,
    ``nis_inside``, ``log_likelihood``, ``repairs``, ``updates``, ``time_of_divergence`` (s) and ``status``, whose codes
    are in its attributes ``flag_values`` and ``flag_meanings``. ``factor_<parameter>`` over ``(band, sample)`` is what
    was varied, in SI units. Coordinates: ``band`` (label, also as ``band_label``, which the store has), ``drive``,
    ``estimator``, ``target``, ``target_unit``, ``duration`` (s). ``.sel`` takes all of them by their names.

    ``results["history/<i>"]`` has ``truth (time, target)``, ``estimate`` and ``std (time, estimator, target)``,
    ``measured_<output>`` and ``input_<name>`` over ``time`` (s).
    """

    __slots__ = ("_analysed", "_read", "_replays")

    _read: StudyResults | None
    _analysed: Analysis | None
    _replays: Replays | None

    @property
    def folder(self) -> Path:
        """The result folder."""
        return self._results.directory

    @property
    def _results(self) -> StudyResults:
        """The same as the report takes it; read again where xarray has made a new tree of this one."""
        stored = getattr(self, "_read", None)
        if stored is None:
            stored = self._read = read(place(str(self.root.attrs["folder"])))
        return stored

    def to_dataframe(self, design: str | None = None, report_units: bool = False) -> pd.DataFrame:
        """Return the scores as a tidy table: one row per run, estimator and target, of what is selected.

        Args:
            design: One design; all of them by default.
            report_units: Whether errors and factors are in the units of reports (deg, kN, t) in place of SI units.

        Returns:
            Columns ``design``, and under their names in the tree ``band`` (label), ``factor_<parameter>``, ``drive``,
            ``sample``, ``repeat``, ``estimator``, ``target``, ``target_unit``, ``rmse``, ``bias``, ``max_error``, the
            scores of the run, and ``status`` in words. Labels are categories in the order of the study.
            ``attrs["units"]`` has the unit of every column that has one. Scores of runs that are not ``ok`` are as
            stored; select with ``status``.

        Raises:
            KeyError: If there is no design of that name.
        """
        nodes = {name: node for name, node in self.children.items() if name != HISTORY and design in (None, name)}
        if not nodes:
            there = ", ".join(name for name in self.children if name != HISTORY)
            raise KeyError(f"there is no design '{design}'; there are {there}")
        tables = [_rows(name, node.to_dataset(), report_units) for name, node in nodes.items()]
        table = pd.concat(tables, ignore_index=True) if len(tables) > 1 else tables[0]
        for name in ("design", "band", "drive", "estimator", "target", "target_unit", STATUS):
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
        return self._results.is_verifiable

    def report(self) -> list[Path]:
        """Write ``report.html`` and ``report.pdf`` into the result folder and return their paths.

        Raises:
            UserError: If the folder cannot be written to.
        """
        from harness.reporting.hooks import first_page
        from harness.study.report import write_report

        return write_report(self._analysis(), first_page("study", self._analysis()))

    def replay(
        self,
        design: str | None = None,
        *,
        band: str | int = 0,
        drive: str | int = 0,
        sample: int = 0,
        repeat: int = 0,
        estimators: Sequence[str] | None = None,
        plant: Mapping[str, float | str] | None = None,
        belief: Mapping[str, float | str] | None = None,
        beside: str | Path | None = None,
    ) -> Replay:
        """Compute one run again from its seeds, with everything kept over time; nothing is written.

        Args:
            design: Name of the design; the first by default.
            band: Label or index of the level.
            drive: Name or index of the drive.
            sample: Index of the Sobol point.
            repeat: Index of the repeat.
            estimators: Names of those to run; all by default.
            plant: What if the plant held other values? By parameter (of the model or its load, or
                ``process_noise_scale`` and so on), a number in SI units or text with a unit.
            belief: The same of what the estimators believe.
            beside: Folder of the study file, where recordings or networks lie beside it.

        Raises:
            UserError: If there is no such run, a value is not possible, or the study names a file that is no longer
                what it was.

        Example:
            >>> import tempfile, harness as h
            >>> study = h.Study(
            ...     plant=h.model("car", "govindarajan_2018", sensors="car_series"),
            ...     targets=["lateral_velocity"],
            ...     drives=[h.drive("sine", duration="10 s", amplitude="20 deg")],
            ...     estimators=["ekf"],
            ...     designs=[h.levels("mass", ["1.5 t", "1.8 t"], repeats=4)],
            ... )
            >>> results = study.run(tempfile.mkdtemp(), jobs=1)
            >>> results.replay(band="1.8 t", repeat=3).answer
            'The scores are those of the store, to the last bit.'
            >>> heavier = results.replay(band="1.8 t", repeat=3, plant={"mass": "1.9 t"})
            >>> sorted(heavier.data.sizes)
            ['estimator', 'output', 'target', 'time']
        """
        from harness.api.replay import Replays

        made = getattr(self, "_replays", None)
        if made is None or beside is not None:
            made = self._replays = Replays(self.folder, None if beside is None else Path(beside))
        return made.run(made.place(design, band, drive, sample, repeat), estimators, made.changes(plant, belief))

    def _analysis(self) -> Analysis:
        from harness.study import report

        made = getattr(self, "_analysed", None)
        if made is None:
            made = self._analysed = report.Analysis(self._results)
        return made


def _ordered(data: xr.Dataset) -> xr.Dataset:
    """Return a design with its scores in a fixed order, bands to be selected by their label."""
    scores = [n for n in (*PER_TARGET, *PER_RUN, STATUS) if n in data]
    ordered = data[[*scores, *sorted(str(n) for n in data if n not in scores)]]
    return ordered.assign_coords(band=ordered["band_label"].to_numpy()).set_xindex("band_label")


def _rows(design: str, data: xr.Dataset, report_units: bool) -> pd.DataFrame:
    """Return the table of one design, of which a part may have been selected."""
    data = data.expand_dims([d for d in (*_INDEX, "target") if d not in data.dims])
    sizes = {dim: data.sizes[dim] for dim in (*_INDEX, "target")}
    places = dict(zip(sizes, (i.ravel() for i in np.indices(list(sizes.values()))), strict=True))
    words = {n: [str(w) for w in np.atleast_1d(data[n].values)] for n in _WORDS}
    units: dict[str, str] = {"time_of_divergence": "s"}
    table: dict[str, Any] = {
        "design": _labels(np.zeros_like(places["band"]), [design]),
        "band": _labels(places["band"], words["band_label"]),
    }
    for factor in json.loads(data.attrs.get("factors", "[]")):
        name = f"factor_{factor['name']}"
        values = _over(data[name], ("band", "sample"))[places["band"], places["sample"]]
        si = str(data[name].attrs.get("units", ""))
        units[name] = str((report_units and factor.get("unit")) or si)
        table[name] = values / scale(units[name], si, name) if report_units else values
    table["drive"] = _labels(places["drive"], words["drive"])
    table |= {name: places[name] for name in ("sample", "repeat")}
    table["estimator"] = _labels(places["estimator"], words["estimator"])
    table["target"] = _labels(places["target"], words["target"])
    shown = [quantity(n, u) for n, u in zip(words["target"], words["target_unit"], strict=True)]
    table["target_unit"] = _labels(places["target"], [q.unit for q in shown] if report_units else words["target_unit"])
    factors = np.array([q.scale if report_units else 1.0 for q in shown])[places["target"]]
    for name in (n for n in PER_TARGET if n in data):
        table[name] = _over(data[name], (*_INDEX, "target")).ravel() * factors
    for name in (n for n in PER_RUN if n in data):
        table[name] = np.repeat(_over(data[name], _INDEX).ravel(), sizes["target"])
    word_of = {code: word for word, code in FLAGS.items()}
    codes = np.repeat(_over(data[STATUS], _INDEX).ravel(), sizes["target"])
    table[STATUS] = pd.Categorical([word_of[int(code)] for code in codes], categories=list(FLAGS))
    frame = pd.DataFrame(table)
    frame.attrs["units"] = units
    return frame


def _over(array: xr.DataArray, dims: tuple[str, ...]) -> NDArray[Any]:
    """Return values over some dimensions; along others, which a selection gave it, they do not change."""
    return np.asarray(array.isel({d: 0 for d in array.dims if d not in dims}).transpose(*dims).values)


def _labels(places: NDArray[np.int64], words: list[str]) -> pd.Categorical[str]:
    """Return words by place as categories in their order; words may occur twice."""
    unique = list(dict.fromkeys(words))
    codes = np.array([unique.index(w) for w in words])
    return pd.Categorical.from_codes(codes[places], pd.Index(unique))
