"""Steering and speed of a recorded drive become the input of a simulated one.

The recording is cut, checked, brought onto the equidistant step and smoothed: recorders republish the latest
value of slow channels, which makes stairs, and write at uneven times, so the columns are interpolated and put
through a low pass without delay.
"""

from __future__ import annotations

import os
from typing import Any

import numpy as np
from numpy.typing import NDArray

from harness.common import registry
from harness.common.arrays import Floats
from harness.common.errors import ModelError
from harness.models.contracts import DriveContext, Option, Profile
from harness.models.drives import _shapes as shapes

OPTIONS: tuple[Option, ...] = (
    Option("file", "text", None, 0.0, 0.0, "recording, relative to the study; format by suffix"),
    Option("time", "text", "time", 0.0, 0.0, "column of the time in s, from any origin"),
    Option("steering", "text", "steering_wheel_angle", 0.0, 0.0, "column of the steering, left positive"),
    Option("speed", "text", "speed", 0.0, 0.0, "column of the speed"),
    Option(
        "steering_is",
        "text",
        "steering_wheel",
        0.0,
        0.0,
        "what the steering is of: steering_wheel or road_wheel",
    ),
    Option(
        "steering_scale",
        "rad",
        1.0,
        -100.0,
        100.0,
        'angle that a 1 in the column stands for, e.g. "1 deg"; times the ratio of the wheelbases',
    ),
    Option("speed_scale", "m/s", 1.0, 1e-6, 100.0, 'speed that a 1 in the column stands for, e.g. "1 km/h"'),
    Option("start", "s", 0.0, 0.0, 1e7, "time after the first sample at which the drive begins"),
    Option("stop", "s", np.inf, 0.0, np.inf, "time after the first sample at which it ends; by default the last"),
    Option("largest_gap", "s", 0.1, 1e-4, 60.0, "longest time between samples that may be interpolated"),
    Option(
        "lowest_speed",
        "m/s",
        1.5,
        0.0,
        40.0,
        "slower ends are cut off, slower samples in between raised to it",
    ),
    Option("cutoff", "Hz", 5.0, 0.05, 1e3, "frequency at which the low pass has lost 3 dB"),
    Option("fade", "s", 3.0, 0.0, 60.0, "time in which the steering comes in, since the vehicle starts straight"),
    shapes.LIMIT,
)

_BACKWARDS = -0.2
"""m/s; anything slower is reversing and not the noise of a sensor at standstill."""


def generate(options: dict[str, Any], context: DriveContext) -> Profile:
    """Return the recorded steering and speed, equidistant, starting at time 0.

    Raises:
        ModelError: If a column is missing or holds NaN, time does not increase, a gap is too long, the
            vehicle reverses, or nothing is left; with file, column and sample (counted from 0).
    """
    if options["steering_is"] not in ("steering_wheel", "road_wheel"):
        raise ModelError(f"steering_is: '{options['steering_is']}' is unknown; write steering_wheel or road_wheel")
    if context.read is None:
        raise ModelError("from_file needs a DriveContext with a function 'read'; the harness provides one")
    path = os.path.join(context.base, options["file"])
    columns = context.read(path)
    time, steering, speed, first = _select(columns, options, path)
    keep = _increasing(time, steering, speed, options, path, first)
    time, steering, speed = time[keep], steering[keep], speed[keep] * options["speed_scale"]
    notes = {"file": options["file"], "republished_rows": str(int((~keep).sum()))}
    moving = np.flatnonzero(speed >= options["lowest_speed"])
    if moving.size < 2 or time[moving[-1]] - time[moving[0]] < 1.0:
        raise ModelError(
            f"{path}: column '{options['speed']}': less than 1 s at {options['lowest_speed']:g} m/s or "
            "faster is left; check speed_scale, start and stop, or lower lowest_speed"
        )
    part = slice(moving[0], moving[-1] + 1)
    time, steering, speed = time[part], steering[part], speed[part]
    if speed.min() < _BACKWARDS:
        n = int(speed.argmin())
        raise ModelError(
            f"{path}: column '{options['speed']}' drives backwards ({speed[n]:.2f} m/s) {time[n]:.2f} s "
            "after the first sample; choose a part that drives forwards with start and stop"
        )
    notes["raised_to_lowest_speed"] = str(int((speed < options["lowest_speed"]).sum()))
    speed = np.maximum(speed, options["lowest_speed"])
    steering = steering * options["steering_scale"]
    if options["steering_is"] == "road_wheel":
        steering = steering * context.steering_ratio
    clock, steering, speed = _resample(time - time[0], steering, speed, options["cutoff"], context.step)
    if options["fade"] > 0:
        steering = steering * shapes.smooth_step(clock / options["fade"])
    return Profile(clock, steering, speed, notes)


def _select(columns: dict[str, Floats], options: dict[str, Any], path: str) -> tuple[Floats, Floats, Floats, int]:
    """Return time since the first sample, steering and speed from start to stop, and where they begin."""
    wanted = []
    for option in ("time", "steering", "speed"):
        name = options[option]
        if name not in columns:
            raise ModelError(f"{path}: no column '{name}' (option {option}){registry.closest(name, sorted(columns))}")
        wanted.append(columns[name])
    time, steering, speed = wanted
    if not np.isfinite(time).all():
        n = int(np.flatnonzero(~np.isfinite(time))[0])
        raise ModelError(f"{path}: column '{options['time']}', sample {n}: {time[n]}; every sample needs a time")
    since = time - time[0] if time.size else time
    inside = np.flatnonzero((since >= options["start"]) & (since <= options["stop"]))
    if inside.size < 2:
        end = since[-1] if since.size else 0.0
        raise ModelError(
            f"{path}: nothing lies between start = {options['start']:g} s and stop = {options['stop']:g} s; "
            f"the recording lasts {end:.2f} s"
        )
    part = slice(inside[0], inside[-1] + 1)
    return since[part], steering[part], speed[part], int(inside[0])


def _increasing(
    time: Floats,
    steering: Floats,
    speed: Floats,
    options: dict[str, Any],
    path: str,
    first: int,
) -> NDArray[np.bool_]:
    """Return a mask without republished rows (same time, same values); refuse NaN, disorder and gaps."""
    for option, column in (("steering", steering), ("speed", speed)):
        bad = np.flatnonzero(~np.isfinite(column))
        if bad.size:
            raise ModelError(
                f"{path}: column '{options[option]}', sample {first + bad[0]}: {column[bad[0]]} "
                f"({bad.size} in all); a drive needs every sample: cut around them with start and stop"
            )
    step = np.diff(time)
    same = (step == 0) & (np.diff(steering) == 0) & (np.diff(speed) == 0)
    backwards = np.flatnonzero((step <= 0) & ~same)
    if backwards.size:
        n = int(backwards[0])
        raise ModelError(
            f"{path}: column '{options['time']}', sample {first + n + 1}: time goes from {time[n]:.6f} to "
            f"{time[n + 1]:.6f} s after the first sample; it must increase ({backwards.size} such samples)"
        )
    gap = int(step.argmax())
    if step[gap] > options["largest_gap"]:
        raise ModelError(
            f"{path}: column '{options['time']}', sample {first + gap + 1}: a gap of {step[gap]:.4f} s, "
            f"{time[gap]:.2f} s after the first sample; up to {options['largest_gap']:g} s is interpolated: "
            "raise largest_gap or cut with start and stop"
        )
    return np.concatenate([[True], ~same])


def _resample(
    time: Floats, steering: Floats, speed: Floats, cutoff: float, step: float
) -> tuple[Floats, Floats, Floats]:
    """Interpolate onto a grid at least as fine as the samples, smooth, and take every ``step``.

    A Gaussian passes half the power at ``sqrt(log 2) / (2 pi sigma)``. The cutoff is at most a fifth of the
    new sampling rate, which leaves 11 % at the Nyquist frequency, so that a long step makes no alias.
    """
    finer = max(int(np.ceil(step / np.median(np.diff(time)))), 1)
    fine = np.arange(int(time[-1] / step + 1e-9) * finer + 1, dtype=np.float64) * (step / finer)
    sigma = np.sqrt(np.log(2.0)) / (2 * np.pi * min(cutoff, 0.2 / step)) * finer / step
    reach = int(np.ceil(4 * sigma))
    weights = np.exp(-0.5 * (np.arange(-reach, reach + 1) / sigma) ** 2)
    weights /= weights.sum()

    def smooth(values: Floats) -> Floats:
        padded = np.pad(np.interp(fine, time, values), reach, mode="edge")
        return np.convolve(padded, weights, mode="valid")[::finer]

    return fine[::finer], smooth(steering), smooth(speed)
