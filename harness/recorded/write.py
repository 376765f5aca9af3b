"""Write what estimators said of recordings: one file for each, as CSV, Parquet or netCDF, and the numbers of all."""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path
from typing import Literal

import xarray as xr

from harness.common.errors import UserError
from harness.common.files import json_text, write_files
from harness.recorded.summary import RunSummary, outputs_of, record
from harness.recordings.read.write import write_recording

Format = Literal["csv", "parquet", "nc"]


def as_columns(run: xr.Dataset) -> xr.Dataset:
    """Return a run with variables over time only; each pair of outputs has its covariance as a column."""
    outputs, columns = outputs_of(run), run.drop_dims(["output", "other_output"])
    for i, output in enumerate(outputs):
        for other in outputs[i + 1 :]:
            pair = run["innovation_covariance"].sel(output=output, other_output=other, drop=True)
            columns[f"innovation_covariance_{output}_{other}"] = pair
    return columns


def write_estimates(folder: Path, runs: Sequence[xr.Dataset], form: Format) -> list[Path]:
    """Write every run into a folder and return the files.

    Args:
        folder: Made if absent.
        runs: From ``harness.recorded.run.RecordedEstimator.run``.
        form: ``csv`` and ``parquet`` have a column for each variable, in SI units; ``nc`` keeps units and provenance
            as CF attributes.

    Raises:
        UserError: If a file cannot be written.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise UserError(f"{folder}: cannot be written: {error.strerror or error}") from None
    written = []
    for run in runs:
        path = folder / f"{file_stem(run.attrs['recording'])}-{file_stem(run.attrs['estimator'])}.{form}"
        write_recording(run if form == "nc" else as_columns(run), path)
        written.append(path)
    return written


def file_stem(name: str) -> str:
    """Return a name as part of a file's name."""
    return re.sub(r"[^\w.=+-]+", "_", name).strip("_") or "unnamed"


def write_numbers(folder: Path, summaries: Sequence[RunSummary], answer: str, comment: str) -> Path:
    """Write the answer and the numbers of all runs as ``estimate.json`` and return its path.

    Raises:
        UserError: If it cannot be written.
    """
    content = {"answer": answer, "comment": comment, "runs": [record(s) for s in summaries]}
    return write_files(folder, {"estimate.json": json_text(content)})[0]
