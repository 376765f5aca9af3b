"""``harness.check``: does a recording agree with itself, and which lines of its map mend what does not?"""

from __future__ import annotations

import os
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from harness.api._show import Shown

if TYPE_CHECKING:
    import pandas as pd
    import xarray as xr

    from harness.recordings.check.run import CheckResult


def check(
    source: str | os.PathLike[str] | pd.DataFrame | xr.Dataset,
    channels: str | os.PathLike[str] | Mapping[str, Any] | None = None,
    *,
    parameters: str | None = None,
) -> Check:
    """Compare the signals of a recording with each other, explain what does not agree, and mend its map.

    Args:
        source: As ``harness.read_recording`` takes it: a path, a DataFrame or a Dataset, as it was recorded.
        channels: Channel map: path of a TOML file or its content as a mapping; none where columns are signals.
        parameters: Parameter set or parameter file; no line of the mended map is kept with which its model fits worse
            than without it. Of a car it gives the curves of the axles as well.

    Returns:
        What was found.

    Raises:
        UserError: If source or map cannot be read or do not fit each other.
        ModelError: If there is no such parameter set.

    Example:
        >>> import numpy as np, pandas as pd, harness as h
        >>> time = np.arange(0, 60, 0.01)
        >>> heading = 0.6 * np.sin(0.5 * time) + 0.2 * np.sin(2 * time)
        >>> log = pd.DataFrame({"time": time, "heading": heading, "gyro": np.degrees(np.gradient(heading, 0.01))})
        >>> channels = {
        ...     "time": {"channel": "time", "unit": "s"},
        ...     "heading": {"channel": "heading", "unit": "rad"},
        ...     "yaw_rate": {"channel": "gyro", "unit": "rad/s"},
        ... }
        >>> found = h.check(log, channels)
        >>> [f.kind for f in found.findings], found.passes, found.mended["yaw_rate"]["unit"]
        (['unit'], True, 'deg/s')
    """
    from harness.identification.fit_recordings import NominalFit
    from harness.recordings.check.run import check_recording

    fit_error = None if parameters is None else NominalFit(parameters)
    mapped = channels if channels is None or isinstance(channels, Mapping) else Path(channels)
    return Check(check_recording(source, mapped, parameters, fit_error))


class Check(Shown):
    """What a check found; made by ``harness.check``."""

    def __init__(self, result: CheckResult) -> None:
        self._result = result

    @property
    def findings(self) -> list[Any]:
        """What is wrong, the largest first; each has ``kind``, ``signals``, ``words`` and ``evidence``."""
        return list(self._result.findings)

    @property
    def comparisons(self) -> pd.DataFrame:
        """One row per comparison, by its name.

        Columns ``verdict``, ``slope``, ``slope_std``, ``offset`` (SI), ``delay``, ``delay_std`` and ``drift`` (s),
        ``explained`` (share of the variance), ``reasons``.
        """
        import pandas as pd

        columns = ["verdict", "slope", "slope_std", "offset", "delay", "delay_std", "drift", "explained"]
        rows = {f.name: [*(getattr(f, c) for c in columns), ", ".join(f.reasons)] for f in self._result.fits}
        return pd.DataFrame.from_dict(rows, orient="index", columns=[*columns, "reasons"]).rename_axis("comparison")

    @property
    def recording(self) -> xr.Dataset:
        """The recording as the given map reads it."""
        return self._result.recording

    @property
    def mended(self) -> dict[str, Any] | None:
        """The whole channel map as it should be; ``None`` if there is nothing to mend."""
        return None if self._result.remedy is None else self._result.remedy.content

    @property
    def passes(self) -> bool:
        """Whether nothing disagrees as the mended map reads the recording, or as the given one does."""
        from harness.recordings.motion.consistency import DISAGREES

        fits = self._result.fits if self._result.remedy is None else self._result.remedy.fits
        return all(f.verdict != DISAGREES for f in fits)

    @property
    def answer(self) -> str:
        """The result in sentences."""
        return " ".join(self._result.sentences)

    @property
    def notes(self) -> list[str]:
        """All irregularities of the recording, with the evidence."""
        return self._result.warnings

    def report(self, folder: str | Path) -> list[Path]:
        """Write ``check.html``, ``check.pdf`` and, where there is something to mend, ``mended.toml``; return the paths.

        Raises:
            UserError: If the folder cannot be written.
        """
        from harness.recordings.check.check_report import write_check

        return write_check(self._result, Path(folder))

    def _facts(self) -> dict[str, Any]:
        return {"answer": self.answer, **{f"finding {i + 1}": str(f) for i, f in enumerate(self.findings)}}

    def _table(self) -> tuple[pd.DataFrame, str]:
        return self.comparisons, f"{len(self.comparisons)} comparisons"
