"""Report on planned drives: the answer, a page for the driver, and what else was tried."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes

from harness.common.files import write_files
from harness.experiment.contract import ExpectedOutcome
from harness.experiment.design import TriedDrive
from harness.experiment.files import RESULT, contents, names_of, once_driven, remove_earlier, written_to
from harness.experiment.kept_drives import KeptDrives
from harness.experiment.limits import UNITS, Limits, stated
from harness.experiment.manoeuvres import SPLINE
from harness.experiment.run import Designed
from harness.models.quantities import listed, print_unit, words
from harness.models.roles import DRIVES
from harness.reporting import style
from harness.reporting.document import Block, Bullets, Drawing, Listing, Prose, Report, Section, Sheet, plain, strong
from harness.reporting.style import number, with_unit


def answer(designed: Designed) -> str:
    """Return the drives in a sentence, and what is expected behind them."""
    plan = designed.plan
    sequence = [t for t, _ in plan.sequence]
    drives = listed([
        f"{t.manoeuvre.name}{f' {times} times' if times > 1 else ''} "
        f"({', '.join([f'{round(t.rehearsed.seconds, 1):g} s', *_apart(t, sequence)])})"
        for t, times in plan.sequence
    ])  # fmt: skip
    expected, now = designed.expectation.words, designed.unchanged.words
    more = ", which is no more than is expected without them" if expected == now else ""
    return f"Drive {drives}, {round(plan.seconds, 1):g} s in all; expected: {expected}{more}."


def _apart(drive: TriedDrive, sequence: Sequence[TriedDrive]) -> list[str]:
    """Return in what a drive differs from others of the same manoeuvre; its duration is said besides."""
    others = [o for o in sequence if o is not drive and o.manoeuvre.name == drive.manoeuvre.name]
    return [part for part in _quantities(drive) if any(part not in _quantities(o) for o in others)]


def limits_words(designed: Designed) -> str:
    """Return the limits of every drive in a driver's units, articulation only of several bodies."""
    articulated = len(designed.plant.model().bodies) > 1
    return ", ".join(
        f"{words(name)} {'open' if value is None else _for_driver_in(value, UNITS[name])}"
        for name, value in stated(designed.task.limits).items()
        if articulated or name != "articulation"
    )


def write_design(designed: Designed, folder: Path, command: str) -> list[Path]:
    """Write the drives, ``next_drive.json`` and the report into a folder; return the files.

    Args:
        designed: From ``design_drives``.
        folder: Where to.
        command: How it was made, as the report says.

    Raises:
        UserError: If the folder cannot be written to.
    """
    remove_earlier(folder)
    files = contents(designed)
    result = {RESULT: files.pop(RESULT)}
    written = [*write_files(folder, files), *report(designed, folder, command).write(folder)]
    written = [*write_files(folder, result), *written]  # last: where it is, all is
    KeptDrives(folder).remove()
    return written


def report(designed: Designed, folder: Path, command: str) -> Report:
    """Return the report: the first sections are the page for the driver."""
    expectation = designed.expectation
    sections: list[Block] = [
        Section(partial(_answer, designed, expectation, folder), "Answer"),
        Section(partial(_for_driver, designed), "For the driver"),
        Section(partial(_expected, expectation), "What is expected?"),
        Section(partial(_ranked, designed), "Which manoeuvre tells how much?"),
        *([Section(partial(_sensors, designed), "What would other sensors tell?")] if designed.equipped else []),
        Section(partial(_made, designed, folder, command), "How was this made?"),
    ]
    return Report("What to drive next?", sections)


def _answer(designed: Designed, expectation: ExpectedOutcome, folder: Path) -> list[Block]:
    still = Bullets([plain(text) for text in expectation.open])
    blocks: list[Block] = [Prose(strong(answer(designed)))]
    if expectation.open:
        blocks += [Prose(plain("What stays open:")), still]
    then = once_driven(designed, folder)
    return [*blocks, Prose(plain("Once they are driven:")), Listing(then)] if then else blocks


def _for_driver(designed: Designed) -> list[Block]:
    rows: list[Sequence[str]] = []
    drawings: list[Block] = []
    for name, (tried, times) in zip(names_of(designed), designed.plan.sequence, strict=True):
        profile = tried.rehearsed.profile
        rows.append([
            name,
            tried.manoeuvre.standard,
            f"{times}",
            f"{round(tried.rehearsed.seconds, 1):g}",
            " to ".join(dict.fromkeys(number(3.6 * v) for v in (profile.speed.min(), profile.speed.max()))),
            number(np.degrees(np.abs(profile.steering_wheel_angle).max())),
            number(np.abs(tried.rehearsed.motion.lateral_acceleration).max(initial=0.0)),
        ])  # fmt: skip
        caption = f"{name}: path from above, steering wheel, speed and lateral acceleration. Dashed: limits."
        bodies = list(designed.plant.model().bodies)
        draw = partial(_draw, tried, designed.task.limits, name, bodies if len(bodies) > 1 else [])
        drawings.append(Drawing(draw, caption, f"The drive {name}"))
    ways = [
        f"{name}: {_free(t)}. Enter straight ahead at {_for_driver_in(t.rehearsed.profile.speed[0], 'm/s')}; "
        f"at the end the wheel stands at {_for_driver_in(t.rehearsed.profile.steering_wheel_angle[-1], 'rad')}."
        for name, (t, _) in zip(names_of(designed), designed.plan.sequence, strict=True)
    ]
    header = ["drive", "manoeuvre", "times", "s", "km/h", "steering wheel, °", "lateral, m/s²"]
    model = designed.plant.model()
    rate = 1.0 / designed.plant.step
    signals = listed([words(s) for s in dict.fromkeys([*model.outputs, "steering_wheel_angle", "speed"])])
    notes = [
        "Leave straight, or brake: the road reaches 1 s straight on behind the end. Its limits are those of the "
        "paths of centres of gravity; the vehicle needs its own width and length in addition.",
        f"Record {signals} at {rate:g} Hz, each drive as a file of its own, from before the entry to the end; what has "
        "another rate a channel map brings to that ([recording] step).",
        *(
            ["Drive each as often to fit as to judge: harness trace --train and --test."]
            if designed.goal.turns > 1
            else []
        ),
        f"Limits: {limits_words(designed)}.",
        f"A steering robot takes {listed([f'{n}.csv' for n in names_of(designed)])}. By hand the drawing need not be "
        "met within the limits: what is recorded counts.",
    ]
    sheet = Sheet(header, rows, "The drives in their order.", left=2)
    return [sheet, Bullets([plain(text) for text in (*ways, *notes)]), *drawings]


def _draw(tried: TriedDrive, limits: Limits, name: str, bodies: Sequence[str]) -> bytes:
    """Draw the path from above, and steering, speed and lateral acceleration over time, of several bodies named."""
    profile, motion = tried.rehearsed.profile, tried.rehearsed.motion
    with style.drawing():
        fig = style.figure(4.6)
        (above, wheel), (speed, lateral) = fig.subplots(2, 2)
        for x, y in motion.paths[:1]:
            above.plot(x, y, color="black")
            above.plot(x[:1], y[:1], marker="o", color="black", ls="")
            to_scale = np.ptp(y) > _NARROW * np.ptp(x)
            above.set_ylabel("m to the left" if to_scale else "m to the left, not to scale")
            if to_scale:
                above.set_aspect("equal", adjustable="datalim")
        above.set_xlabel("m along the first heading")
        _over_time(wheel, profile.time, np.degrees(profile.steering_wheel_angle), "steering wheel, ° to the left")
        _over_time(speed, profile.time, 3.6 * profile.speed, "speed, km/h")
        for accelerations in motion.lateral_acceleration:
            _over_time(lateral, profile.time, accelerations, "lateral acceleration, m/s²")
        for sign in (-1, 1):
            lateral.axhline(sign * limits.lateral_acceleration, color="black", ls="--")
        if len(bodies) == len(motion.lateral_acceleration):
            lateral.legend(lateral.get_lines()[: len(bodies)], [words(body) for body in bodies])
        style.head(fig, f"{name}: {tried.manoeuvre.standard}")
        return style.svg(fig)


def _over_time(axes: Axes, time: np.ndarray, values: np.ndarray, label: str) -> None:
    axes.plot(time, values)
    axes.set_xlabel("time, s")
    axes.set_ylabel(label)
    axes.grid()


def _expected(expectation: ExpectedOutcome) -> list[Block]:
    caption = "Before and behind the drives."
    return [Sheet(list(expectation.header), [list(r) for r in expectation.rows], caption, left=2)]


def _ranked(designed: Designed) -> list[Block]:
    plan = designed.plan
    rows = [
        [t.manoeuvre.name, _free(t), f"{t.times}", f"{round(t.seconds, 1):g}", number(max(np.exp(t.value), 1e-12))]
        for t in plan.ranked
    ]
    before, after = (np.exp(designed.goal.value(evidence)) for evidence in (None, plan.evidence))
    rows.append(["the sequence", "", "", f"{round(plan.seconds, 1):g}", number(max(after, 1e-12))])
    now = number(before) if np.isfinite(before) else "∞"
    caption = (
        f"The best drive of each manoeuvre, repeated alone, for {designed.task.budget:g} s at most. Criterion: "
        f"{designed.goal.measure}, the smaller the better; now {now}. {plan.tried} drives were rehearsed."
    )
    refused = [
        plain(f"{name}: no drive keeps to the limits and the budget ({why})") for name, why in plan.refused.items()
    ]
    blocks: list[Block] = [Sheet(["manoeuvre", "quantities", "times", "s", "criterion"], rows, caption, left=2)]
    return [*blocks, *([Bullets(refused)] if refused else [])]


_SHOWN = {"m/s": (3.6, "km/h"), "rad": (np.degrees(1.0), "°"), "rad/s": (np.degrees(1.0), "°/s")}
_NARROW = 0.1
"""Width over length of a path below which its drawing stretches the width."""

_NOT_SHOWN = ("lead_in", "lateral_acceleration_limit", "duration", "fade", "transition", "seed")


def _free(t: TriedDrive) -> str:
    return ", ".join(_quantities(t))


def _quantities(t: TriedDrive) -> list[str]:
    """Return the free quantities of a drive, each with its value as a driver reads it."""
    drive, profile = t.rehearsed.drive, t.rehearsed.profile
    if drive.kind == SPLINE:
        angle = _for_driver_in(float(np.abs(profile.steering_wheel_angle).max()), "rad")
        return [
            "steering and speed as drawn",
            f"from {_for_driver_in(drive.options['speed'], 'm/s')}",
            f"at most {angle}",
        ]
    units = {o.name: o.unit for o in DRIVES.load(drive.kind).OPTIONS}
    options = {k: v for k, v in drive.options.items() if k not in _NOT_SHOWN}
    return [f"{words(k)} {_for_driver_in(v, units[k]) if isinstance(v, float) else v}" for k, v in options.items()]


def _for_driver_in(value: float, unit: str) -> str:
    """Write a quantity in the unit that a driver reads: km/h and degrees, to a tenth."""
    if unit not in _SHOWN:
        return with_unit(value, print_unit(unit))
    scale, shown = _SHOWN[unit]
    tenths = f"{round(scale * value, 1) + 0.0:.1f}".removesuffix(".0").replace("-", "−")  # + 0.0: of no -0
    return f"{tenths}{'' if shown == '°' else ' '}{shown}"


def _sensors(designed: Designed) -> list[Block]:
    rows: list[Sequence[str]] = [
        [e.name, listed([words(o) for o in e.outputs]),
         e.expectation if isinstance(e.expectation, str) else e.expectation.words]
        for e in designed.equipped
    ]  # fmt: skip
    return [Sheet(["sensors", "they measure", "expected"], rows, "The same drives with other sensors.", left=3)]


def _made(designed: Designed, folder: Path, command: str) -> list[Block]:
    text = (
        f"{command}. Every drive was simulated with the likeliest vehicle and with "
        f"{len(designed.goal.versions) - 1} further ones that are still possible, and refused where "
        "one of them passes a limit or leaves the range of its equations."
    )
    commands = written_to(designed, folder)
    return [Prose(plain(text)), *([Listing("\n".join(commands))] if commands else [])]
