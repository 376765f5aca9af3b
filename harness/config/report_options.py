"""Resolve what a study asks of its report: the limits of tolerable errors, sensitivity over time."""

from __future__ import annotations

from harness.common.registry import closest
from harness.config.problems import Problems
from harness.config.schema import StudyFile
from harness.config.specs import DesignSpec, DriveSpec, OverTimeSpec
from harness.models.signals import SIGNALS


def limits(raw: StudyFile, problems: Problems) -> dict[str, float]:
    """Return the largest tolerable RMSE by target in SI; a tolerance design needs at least one.

    Args:
        raw: The study file.
        problems: Where problems are noted.
    """
    from harness.common.units import to_si

    largest: dict[str, float] = {}
    for name, written in raw.limits.items():
        key = f"limits.{name}"
        if name not in raw.targets:
            problems.add(key, f"a limit belongs to a target, '{name}' is none{closest(name, raw.targets)}")
            continue
        with problems.catch(key):
            largest[name] = to_si(written, SIGNALS[name].unit if name in SIGNALS else "", problems.at(key))
            if not largest[name] > 0.0:
                problems.add(key, f"an RMSE is never below zero; give a positive limit, not {written!r}")
    for i, design in enumerate(raw.design):
        if design.sampling == "tolerance" and not raw.limits:
            problems.add(
                f"design[{i}].sampling",
                "a tolerance map needs the error that counts as tolerable; add a table [limits] with an RMSE for a "
                f"target, e.g. {raw.targets[0]} = ...",
            )
    return largest


def score_after(raw: StudyFile, problems: Problems) -> float:
    """Return the time in s after which scores count."""
    from harness.common.units import to_si

    with problems.catch("score_after"):
        seconds = to_si(raw.score_after, "s", problems.at("score_after"))
        if seconds < 0:
            problems.add("score_after", f"a time from the beginning of a drive is not negative, got {seconds:g} s")
        return seconds
    return 0.0


def over_time(
    raw: StudyFile, designs: list[DesignSpec], drives: list[DriveSpec], problems: Problems
) -> OverTimeSpec | None:
    """Return the drive along which errors are kept in windows, or ``None`` if none was asked for or one is wrong.

    Args:
        raw: The study file.
        designs: Those that could be resolved.
        drives: Those that could be resolved.
        problems: Where problems are noted.
    """
    from harness.common.units import to_si

    table, key = raw.report.sensitivity_over_time, "report.sensitivity_over_time"
    if table is None:
        return None
    before = len(problems)
    suited = [d.name for d in raw.design if d.sampling == "saltelli"]
    if table.design not in suited:
        near = closest(table.design, suited)
        problems.add(f"{key}.design", f"'{table.design}' is no design with sampling = 'saltelli'{near}")
    if drives and table.drive not in [d.name for d in drives]:
        near = closest(table.drive, [d.name for d in drives])
        problems.add(f"{key}.drive", f"there is no drive '{table.drive}'{near}")
    window = 0.0
    with problems.catch(f"{key}.window"):
        window = to_si(table.window, "s", problems.at(f"{key}.window"))
        if not window > 0.0:
            problems.add(f"{key}.window", f"give a positive length, not {table.window!r}")
    return OverTimeSpec(table.design, table.drive, window) if len(problems) == before else None
