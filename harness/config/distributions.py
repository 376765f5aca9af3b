"""Resolve the distribution of a factor: by mean and deviation, by quantiles, by its ends, or by a sample."""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from harness.common.errors import MissingFileError, UserError
from harness.common.files import read_text
from harness.common.registry import closest
from harness.config.design_tables import DistributionTable
from harness.config.marginals import Marginal
from harness.models.contracts import Parameter

TAKES = {
    "normal": ("mean", "std", "quantiles"),
    "lognormal": ("mean", "std", "quantiles"),
    "truncated_normal": ("mean", "std", "quantiles", "range"),
    "triangular": ("mean", "std", "quantiles", "range", "mode"),
    "uniform": ("mean", "std", "quantiles", "range"),
    "log_uniform": ("quantiles", "range"),
    "beta": ("mean", "std", "quantiles", "range"),
    "discrete": ("values", "weights"),
    "empirical": ("values", "file", "column"),
}
"""Keys that state a distribution of each kind, besides ``kind``."""

_OVER_STD = {"triangular": math.sqrt(6.0), "uniform": math.sqrt(3.0)}
"""Half-width of the symmetric distribution over its standard deviation."""


@dataclass(frozen=True)
class DistributionReader:
    """Reads ``distribution`` of one factor.

    Attributes:
        table: The table.
        where: File and key, for errors.
        parameter: What is varied.
        nominal: Its nominal value, SI.
        number: Returns an entry in SI units, and takes what names it in errors.
        std: What the parameter set states for it, SI; ``None`` for nothing.
        folder: Folder of the study.
    """

    table: DistributionTable
    where: str
    parameter: Parameter
    nominal: float
    number: Callable[[Any, str], float]
    std: float | None
    folder: Path

    def complete(self) -> DistributionTable:
        """Return the table with all that it takes from a parameter set or a file written out.

        Raises:
            UserError: If that cannot be had, or a key does not belong to the kind.
        """
        table, kind = self.table, self.table.kind
        stated = [k for k in table.model_fields_set - {"kind"} if getattr(table, k) is not None]
        if surplus := sorted(set(stated) - set(TAKES[kind])):
            raise UserError(
                f"{self.where}.{surplus[0]}: a {_words(kind)} distribution is stated by {_listed(TAKES[kind])}; "
                f"remove '{surplus[0]}'"
            )
        if table.quantiles is not None and (table.mean is not None or table.std is not None):
            raise UserError(f"{self.where}: two quantiles state what mean and std state; remove one of both")
        if kind == "empirical":
            if (table.values is None) == (table.file is None):
                raise UserError(f"{self.where}: an empirical distribution needs either 'file' or 'values'")
            if table.file is not None:
                return table.model_copy(update={"values": self._column(table.file), "file": None, "column": None})
            return table
        if kind == "discrete":
            if table.values is None:
                raise UserError(f"{self.where}: a discrete distribution needs its 'values'")
            return table
        needs_std = kind not in ("triangular", "uniform", "log_uniform") or table.mean is not None
        if table.std is None and table.quantiles is None and (needs_std or table.range is None):
            return table.model_copy(update={"std": self._stated_std()})
        return table

    def marginal(self) -> Marginal:
        """Return the distribution, SI units; ``uniform`` and ``log_uniform`` have both ends as arguments.

        Raises:
            UserError: If there is no such distribution.
        """
        table = self.complete()
        kind = table.kind
        if kind in ("discrete", "empirical"):
            return self._steps(table)
        ends = self._ends(table)
        if table.quantiles is not None:
            return self._by_quantiles(kind, table.quantiles, ends)
        if ends is not None and table.std is None:
            mode = (ends[0] + ends[1]) / 2 if table.mode is None else self.number(table.mode, f"{self.where}.mode")
            if not ends[0] <= mode <= ends[1]:
                raise UserError(f"{self.where}.mode: the likeliest value lies outside of 'range'")
            return Marginal(kind, (ends[0], mode, ends[1]) if kind == "triangular" else ends)
        if kind == "log_uniform":
            raise UserError(f"{self.where}: a log-uniform distribution needs 'range' or 'quantiles'")
        return self._by_moments(kind, table, ends)

    def _stated_std(self) -> str:
        """Return the standard deviation of the parameter set as text that reads as the same number."""
        if self.table.kind == "log_uniform":
            raise UserError(f"{self.where}: a log-uniform distribution needs 'range' or 'quantiles'")
        if self.std is None:
            raise UserError(
                f"{self.where}: the parameter set has no [std] of '{self.parameter.name}'; state 'std', or 'quantiles'"
            )
        return f"{self.std!r} {self.parameter.unit or 'dimensionless'}"

    def _column(self, name: str) -> list[Any]:
        """Return the numbers of a column of a CSV file."""
        path = next((p for p in (self.folder / name, Path(name)) if p.is_file()), None)
        if path is None:
            raise MissingFileError(
                f"{self.where}.file: there is no file '{name}' in {self.folder} or the working folder"
            )
        rows = cells(path)
        wanted = self.table.column or self.parameter.name
        titles = list(rows)
        if wanted not in titles:
            raise UserError(f"{self.where}.column: {path} has no column '{wanted}'{closest(wanted, titles)}")
        return list(numbers(path, wanted, rows[wanted]))

    def _steps(self, table: DistributionTable) -> Marginal:
        values = [self.number(v, f"{self.where}.values[{i}]") for i, v in enumerate(table.values or [])]
        weights = table.weights or [1.0] * len(values)
        if len(weights) != len(values):
            raise UserError(f"{self.where}.weights: {len(weights)} weights for {len(values)} values; give one each")
        if not all(w > 0 for w in weights):
            raise UserError(f"{self.where}.weights: a weight is positive; leave out values that never are")
        distinct, of = np.unique(values, return_inverse=True)
        if len(distinct) < 2:
            raise UserError(f"{self.where}: all values are {values[0]:g}; a distribution needs at least two")
        counts = np.bincount(of, weights=weights)
        return Marginal(table.kind, (*distinct.tolist(), *counts.tolist()))

    def _ends(self, table: DistributionTable) -> tuple[float, float] | None:
        """Return smallest and largest value where they are stated or, truncated by nothing else, those allowed."""
        if table.range is not None:
            low, high = (self.number(v, f"{self.where}.range[{i}]") for i, v in enumerate(table.range))
            if not low < high:
                raise UserError(f"{self.where}.range: the smaller value comes first; got {low:g} and {high:g}")
            if table.kind == "log_uniform" and low <= 0:
                raise UserError(f"{self.where}.range: a logarithm needs values above zero; raise the lower end")
            return low, high
        if table.kind == "truncated_normal":
            return self.parameter.lower, self.parameter.upper
        if table.kind == "beta":
            raise UserError(f"{self.where}: a beta distribution needs 'range', its smallest and its largest value")
        return None

    def _by_moments(self, kind: str, table: DistributionTable, ends: tuple[float, float] | None) -> Marginal:
        mean = self.nominal if table.mean is None else self.number(table.mean, f"{self.where}.mean")
        if not math.isfinite(mean):
            raise UserError(f"{self.where}: there is no nominal value of '{self.parameter.name}'; state 'mean'")
        std = self._deviation(table.std, mean)
        if kind == "lognormal":
            if mean <= 0:
                raise UserError(f"{self.where}: a lognormal distribution has a positive mean, not {mean:g}")
            spread = math.log1p((std / mean) ** 2)  # of the logarithm: Johnson, Kotz and Balakrishnan 1994, (14.8)
            return Marginal(kind, (math.log(mean) - spread / 2, math.sqrt(spread)))
        if kind in _OVER_STD:
            if ends is not None or table.mode is not None:
                raise UserError(f"{self.where}: a {kind} distribution has either mean and std, or range; remove one")
            half = _OVER_STD[kind] * std
            return Marginal(
                kind, (mean - half, mean, mean + half) if kind == "triangular" else (mean - half, mean + half)
            )
        if kind == "beta":
            assert ends is not None
            exponents = (mean - ends[0]) * (ends[1] - mean) / std**2 - 1.0
            share = (mean - ends[0]) / (ends[1] - ends[0])
            if not 0 < share < 1 or exponents <= 0:
                raise UserError(f"{self.where}: no beta distribution on that range has mean {mean:g} and std {std:g}")
            return Marginal(kind, (exponents * share, exponents * (1 - share), *ends))
        return Marginal(kind, (mean, std, *(ends or ())))

    def _deviation(self, raw: Any, mean: float) -> float:
        from harness.common.units import split, to_si

        written = split(raw) if isinstance(raw, str) else None
        relative = written is not None and written[1] in ("%", "percent")
        std = to_si(raw, "", f"{self.where}.std") * abs(mean) if relative else self.number(raw, f"{self.where}.std")
        if not std > 0:
            raise UserError(f"{self.where}.std: a standard deviation is positive; got {raw!r}, which is {std:g}")
        return std

    def _by_quantiles(self, kind: str, stated: dict[str, Any], ends: tuple[float, float] | None) -> Marginal:
        from harness.common.units import to_si

        place = f"{self.where}.quantiles"
        pairs = sorted((to_si(p, "", place), self.number(v, f"{place}.{p!r}")) for p, v in stated.items())
        shares, values = (np.array(row) for row in zip(*pairs, strict=True))
        if not 0 < shares[0] < shares[1] < 1 or not values[0] < values[1]:
            raise UserError(f'{place}: give two, each larger than the one before, as {{ "5 %" = 20, "95 %" = 26 }}')
        if ends is not None and kind in ("truncated_normal", "beta"):
            return _fitted(kind, shares, values, ends, place)
        in_log = kind in ("lognormal", "log_uniform")
        if in_log and values[0] <= 0:
            raise UserError(f"{place}: a {_words(kind)} distribution has positive values only")
        if ends is not None:
            raise UserError(f"{self.where}: a {_words(kind)} distribution has either quantiles or range; remove one")
        standard = {"triangular": (-1.0, 0.0, 1.0)}.get(kind, (0.0, 1.0))
        at = shares if "uniform" in kind else Marginal(kind if kind == "triangular" else "normal", standard).at(shares)
        written = np.log(values) if in_log else values
        size = float((written[1] - written[0]) / (at[1] - at[0]))
        begin = float(written[0] - size * at[0])
        match kind:
            case "triangular":
                return Marginal(kind, (begin - size, begin, begin + size))
            case "uniform":
                return Marginal(kind, (begin, begin + size))
            case "log_uniform":
                return Marginal(kind, (math.exp(begin), math.exp(begin + size)))
        return Marginal(kind, (begin, size))


def cells(path: Path) -> dict[str, dict[int, str]]:
    """Return the cells of a CSV file by column and line; of lines that are not blank.

    Raises:
        UserError: If it is no text, or two columns have one name.
    """
    lines = read_text(path).splitlines()
    head = lines[0] if lines else ""
    rows = list(csv.reader(io.StringIO("\n".join(lines)), delimiter=max(",;\t", key=head.count)))
    there = {line: row for line, row in enumerate(rows[1:], 2) if any(cell.strip() for cell in row)}
    titles = [title.strip() for title in rows[0]] if rows else []
    if twice := next((title for i, title in enumerate(titles) if title in titles[:i]), None):
        raise UserError(f"{path}: two columns are called '{twice}'; rename or remove one of them")
    return {
        title: {line: row[i].strip() if i < len(row) else "" for line, row in there.items()}
        for i, title in enumerate(titles)
    }


def numbers(path: Path, column: str, texts: Mapping[int, str]) -> list[float]:
    """Return the numbers of a column of a sample.

    Raises:
        UserError: If a cell is none, or they are fewer than two.
    """
    sample = []
    for line, cell in texts.items():
        try:
            sample.append(float(cell) if "_" not in cell else math.nan)
        except ValueError:
            sample.append(math.nan)
        if not math.isfinite(sample[-1]):
            raise UserError(f"{path}: line {line}, column '{column}': {cell!r} is no number; mend or remove the line")
    if len(sample) < 2:
        raise UserError(f"{path}: column '{column}' has {len(sample)} numbers; a sample needs at least 2")
    return sample


def _fitted(kind: str, shares: Any, values: Any, ends: tuple[float, float], where: str) -> Marginal:
    """Return the distribution between two ends that has these quantiles.

    Raises:
        UserError: If there is none.
    """
    from scipy import optimize, special

    def tried(x: Any) -> Marginal:
        positive = np.exp(np.clip(x, -300.0, 300.0)).tolist()
        return Marginal(kind, (float(x[0]) if kind == "truncated_normal" else positive[0], positive[1], *ends))

    score = special.ndtri(shares)
    std = (values[1] - values[0]) / (score[1] - score[0])
    mean = values[0] - std * score[0]
    begin = [mean, math.log(std)]
    if kind == "beta":
        share = min(max((mean - ends[0]) / (ends[1] - ends[0]), 0.01), 0.99)
        total = max(share * (1 - share) * ((ends[1] - ends[0]) / std) ** 2 - 1.0, 0.1)
        begin = [math.log(total * share), math.log(total * (1 - share))]
    if ends[0] < values[0] and values[1] < ends[1]:
        with np.errstate(all="ignore"):
            solved = optimize.root(
                lambda x: [tried(x).below(v) - p for v, p in zip(values, shares, strict=True)], begin
            )
        result = tried(solved.x)
        if solved.success and np.allclose(result.at(shares), values, rtol=1e-6, atol=1e-9 * (ends[1] - ends[0])):
            return result
    raise UserError(f"{where}: no {_words(kind)} distribution from {ends[0]:g} to {ends[1]:g} has these quantiles")


def _words(kind: str) -> str:
    return kind.replace("log_", "log-").replace("_", " ")


def _listed(keys: tuple[str, ...]) -> str:
    return f"{', '.join(keys[:-1])} and {keys[-1]}"
