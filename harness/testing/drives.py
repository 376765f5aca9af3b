"""What holds for every kind of drive, with its defaults and away from them."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from dataclasses import replace
from types import ModuleType
from typing import Any

import numpy as np

from harness.common.errors import ModelError
from harness.common.units import scale
from harness.models.contracts import DriveContext, Option, Profile
from harness.models.drive_options import options_of
from harness.models.drives._shapes import AMPLITUDE, LIMIT, lateral_acceleration
from harness.models.roles import DRIVES
from harness.simulation.drives import build_drive
from harness.testing.parts import named, require

CONTEXT = DriveContext(wheelbase=3.71, steering_ratio=23.0, step=0.01)


def check_drive(kind: str | ModuleType, options: Mapping[str, object] | None = None) -> None:
    """Check a kind of drive.

    Options and defaults; a profile that is as long as it says, steers, starts straight and comes in smoothly; that it
    is the same every time and leaves its options alone; and that the limit of the lateral acceleration holds.

    Args:
        kind: Its name, or a module that keeps the contract (``harness/models/contracts.py``).
        options: What it cannot do without, such as the file of a recording.

    Raises:
        AssertionError: If something does not hold; the message says what.
        UserError: If an option is wrong.
    """
    with named(DRIVES, kind) as name:
        given = dict(options or {})
        require(DRIVES.load(name).__doc__, f"{name}: write a docstring: its first line is what 'harness list' shows")
        declared = options_of(name)
        for option in declared:
            _check_option(name, option)
        lacking = [o.name for o in declared if o.default is None and o.name not in given]
        require(not lacking, f"{name}: needs {', '.join(lacking)}; give check_drive(..., options={{...}})")
        for step in (0.01, 0.02):
            _check_profile(name, build_drive(name, given, replace(CONTEXT, step=step)), step)
        profile = build_drive(name, given, CONTEXT)
        _check_begins(name, profile)
        _check_repeats(name, given, profile)
        _check_limit(name, {o.name: o.default for o in declared if o.name == AMPLITUDE.name} | given)
        _check_further(name, given, {o.name for o in declared})


def _check_option(name: str, option: Option) -> None:
    require(option.meaning, f"{name}: option '{option.name}' has no meaning")
    require(not option.meaning.endswith("."), f"{name}: the meaning of '{option.name}' ends in a full stop")
    if option.unit == "text":
        return
    scale(option.unit, option.unit, option.name)  # raises if pint does not know it
    require(option.lower < option.upper, f"{name}: bounds of '{option.name}'")
    inside = option.default is None or option.lower <= option.default <= option.upper
    require(inside, f"{name}: the default of '{option.name}' is outside its bounds")


def _check_profile(name: str, profile: Profile, step: float) -> None:
    n = len(profile.time)
    shapes = {profile.time.shape, profile.steering_wheel_angle.shape, profile.speed.shape}
    require(shapes == {(n,)}, f"{name}: time, steering and speed have shapes {sorted(shapes)}")
    require(np.allclose(profile.time, np.arange(n) * step, atol=1e-9), f"{name}: time is not k * {step:g} s")
    require(np.isfinite(profile.steering_wheel_angle).all(), f"{name}: the steering is not finite")
    require(profile.speed.min() > 0, f"{name}: the speed must stay positive")
    steers = np.abs(profile.steering_wheel_angle).max() > math.radians(5)
    require(steers, f"{name}: a drive that does not steer")


def _check_begins(name: str, profile: Profile) -> None:
    steering = profile.steering_wheel_angle
    require(steering[0] == 0.0, f"{name}: it must begin straight ahead")
    # No jump: no sample differs from its neighbour by more than the fastest steering a driver can do.
    rate = np.diff(steering) / CONTEXT.step
    require(np.abs(rate).max() < math.radians(450), f"{name}: it steers faster than any driver")
    # No jerk of the wheel either: the rate itself has no jump of the size of the largest rate.
    require(np.abs(np.diff(rate)).max() < 0.3 * np.abs(rate).max(), f"{name}: the steering rate jumps")
    require(np.abs(np.diff(profile.speed)).max() / CONTEXT.step < 1.5, f"{name}: it accelerates harder than 1.5 m/s^2")


def _check_repeats(name: str, given: dict[str, Any], first: Profile) -> None:
    before = dict(given)
    second = build_drive(name, given, CONTEXT)
    require(given == before, f"{name}: it changes its options")
    same = np.array_equal(first.steering_wheel_angle, second.steering_wheel_angle)
    require(same and np.array_equal(first.speed, second.speed), f"{name}: not the same every time; take a seed")


def _check_limit(name: str, given: dict[str, Any]) -> None:
    """Check that a drive keeps to the limit; its amplitude is stated, as one that is not gives way to the limit."""
    peak = np.abs(lateral_acceleration(build_drive(name, given, CONTEXT), CONTEXT)).max()
    require(peak <= LIMIT.default, f"{name}: its defaults exceed the limit of the lateral acceleration")
    build_drive(name, {**given, LIMIT.name: 1.01 * peak}, CONTEXT)
    says = rf"asks for {peak:.2f} m/s\^2 .* at .* s .*lower the speed .*raise"
    try:
        build_drive(name, {**given, LIMIT.name: 0.99 * peak}, CONTEXT)
    except ModelError as error:
        require(re.search(says, str(error)), f"{name}: the limit is refused in other words: {error}")
    else:
        require(False, f"{name}: its own '{LIMIT.name}' is not kept")


def _check_further(name: str, given: dict[str, Any], declared: set[str]) -> None:
    """Check options that mean the same in every kind that has them."""

    def steering(**options: object) -> np.ndarray:
        return build_drive(name, {**given, **options}, CONTEXT).steering_wheel_angle

    if "direction" in declared:
        mirrored = np.array_equal(steering(direction="left"), -steering(direction="right"))
        require(mirrored, f"{name}: 'direction' does not mirror the steering")
    if "seed" in declared:
        drives = [steering(seed=s) for s in (0, 1, 2)]
        require(not np.array_equal(drives[0], drives[1]), f"{name}: seeds 0 and 1 give the same drive")
        require(not np.array_equal(drives[1], drives[2]), f"{name}: seeds 1 and 2 give the same drive")
    if "duration" in declared:
        last = build_drive(name, {**given, "duration": "95.5 s"}, CONTEXT).time[-1]
        require(abs(last - 95.5) < 1e-6, f"{name}: it lasts {last:g} s when asked for 95.5 s")
