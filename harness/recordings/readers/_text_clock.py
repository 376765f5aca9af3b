"""Clocks as text: ISO 8601 with and without a zone, other dates, ``hh:mm:ss.s`` and ``mm:ss.s``, in s.

Stamps with a date count from 1970, without a zone as if in UTC; those without count from midnight and go on behind it.
"""

from __future__ import annotations

import re
from datetime import date

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from harness.common.arrays import Floats
from harness.common.errors import UserError
from harness.recordings.readers._table import TEXT_CLOCKS

_MONTHS = ("jan", "feb", "mar", "apr", "may", "jun", "jul", "aug", "sep", "oct", "nov", "dec")
_DAY = (
    r"(?P<day>\d{4}([-/.])\d{1,2}\2\d{1,2}|\d{1,2}([-/.])\d{1,2}\3(?:\d{4}|\d{2})|\d{8}(?=[T_ ])|"
    r"\d{1,2}[- ][A-Za-z]{3}[a-z]*[- ]\d{4})"
)
_TIME = (
    r"(?P<clock>(?:(?P<h>\d{1,2}):)?(?P<min>\d{1,2}):(?P<s>\d{2})(?:[.,:](?P<f>\d{1,12}))?|"
    r"(?<=\d[T_ ])(?P<packed>\d{6})(?:[.,](?P<g>\d{1,12}))?)\s*(?P<half>[AaPp])?(?:\.?[Mm]\.?)?"
)
_ZONE = r"\s*(?P<zone>Z|UTC|GMT|[+-]\d{2}:?\d{2}|[+-]\d{2})?"
_STAMP = re.compile(rf"\s*(?:{_DAY}[T_ ,;]\s*)?{_TIME}{_ZONE}\s*")
_HALF_A_DAY = 43200.0


def is_stamp(text: str) -> bool:
    """Return whether a text is a time with seconds, with or without a date."""
    match = _STAMP.fullmatch(text)
    if match is None:
        return False
    return bool(match["packed"] or match["h"] or match["f"])  # 10:05 may be hours and minutes


class TextClock:
    """A column of times as text, read piece by piece.

    Args:
        where: File and column, for errors.
    """

    def __init__(self, where: str) -> None:
        self._where = where
        self._seconds: list[Floats] = []
        self._days: list[NDArray[np.intp]] = []
        self._dates: dict[str, int] = {}

    def add(self, texts: pd.Series) -> None:
        """Add the next rows.

        Raises:
            UserError: If one is neither blank nor a time.
        """
        parts = texts.astype("string").str.extract(rf"^{_STAMP.pattern}$")
        seen = sum(map(len, self._seconds))
        odd = np.flatnonzero((texts.notna() & parts["clock"].isna()).to_numpy())
        if odd.size:
            row = int(odd[0])
            raise UserError(
                f"{self._where}, row {seen + row + 1} of the data: '{texts.iloc[row]}' is no time like those above; "
                f"leave the cell empty if the stamp is missing, or {TEXT_CLOCKS}"
            )
        packed = parts["packed"]
        hours, minutes, seconds = (
            _number(parts[name].fillna(packed.str[2 * i : 2 * i + 2])) for i, name in enumerate(("h", "min", "s"))
        )
        fraction = _number("0." + parts["f"].fillna(parts["g"]))
        hours = np.where(np.isnan(hours), 0.0, hours)
        half = parts["half"].fillna("").str.lower().to_numpy(dtype=object)
        hours = np.where(half == "", hours, hours % 12 + np.where(half == "p", 12.0, 0.0))
        total = 3600.0 * hours + 60.0 * minutes + seconds + np.where(np.isnan(fraction), 0.0, fraction)
        zone = parts["zone"].where(parts["zone"].str.contains(r"\d", na=False))
        away = 60.0 * _number(zone.str[1:3]) + np.nan_to_num(_number(zone.str[3:].str.lstrip(":")))
        sign = np.where(zone.fillna("").str[:1].to_numpy(dtype=object) == "-", -1.0, 1.0)
        self._seconds.append(total - 60.0 * sign * np.nan_to_num(away))
        numbers, written = pd.factorize(parts["day"])
        own = [self._dates.setdefault(str(day), len(self._dates)) for day in written]
        self._days.append(np.array([*own, -1], dtype=np.intp)[numbers])

    def values(self) -> Floats:
        """Return the stamps in s ``(rows,)``, NaN where there is none.

        Raises:
            UserError: If day and month of a date may be either.
        """
        seconds, days = np.concatenate(self._seconds), np.concatenate(self._days)
        if self._dates:
            midnights = np.array([*self._midnights(), np.nan])
            return seconds + midnights[days]
        there = np.flatnonzero(np.isfinite(seconds))
        steps = np.diff(seconds[there])
        if (seconds[there] < 2 * _HALF_A_DAY).all():
            turns = np.cumsum((steps < -_HALF_A_DAY).astype(float) - (steps > _HALF_A_DAY))
            seconds[there[1:]] += 2 * _HALF_A_DAY * turns
        return seconds

    def _midnights(self) -> list[float]:
        """Return the beginning of each date in s since 1970."""
        split = {text: re.split(r"[-/. ]", text) for text in self._dates}
        pairs = [(p[0], p[1]) for p in split.values() if len(p) == 3 and len(p[0]) < 3 and p[1].isdigit()]
        month_first = any(int(b) > 12 for _, b in pairs)
        day_first = any(int(a) > 12 for a, _ in pairs) or any("." in text for text in split)
        if len(pairs) > 1 and not month_first and not day_first:
            raise UserError(
                f"{self._where}: '{next(iter(split))}' may be month and day or day and month; write the dates as "
                "year-month-day"
            )
        return [self._midnight(text, parts, month_first) for text, parts in split.items()]

    def _midnight(self, text: str, parts: list[str], month_first: bool) -> float:
        if len(parts) == 1:
            parts = [text[:4], text[4:6], text[6:]]
        elif len(parts[0]) < 3:
            day, month, year = parts if not month_first else (parts[1], parts[0], parts[2])
            parts = [year if len(year) == 4 else f"20{year}", month, day]
        try:
            month_number = int(parts[1]) if parts[1].isdigit() else _MONTHS.index(parts[1][:3].lower()) + 1
            return 86400.0 * (date(int(parts[0]), month_number, int(parts[2])) - date(1970, 1, 1)).days
        except ValueError:
            raise UserError(f"{self._where}: '{text}' is no date; write year-month-day") from None


def _number(texts: pd.Series) -> Floats:
    return np.asarray(pd.to_numeric(texts, errors="coerce").to_numpy(dtype=float, na_value=np.nan))
