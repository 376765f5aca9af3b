"""Drives of a study: validate the options, build the profile, refuse what no driver would do."""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from harness.common import registry
from harness.common.errors import ModelError, UserError
from harness.common.files import read_toml
from harness.common.units import to_si
from harness.config.derived import GRADIENT, axle_values
from harness.config.specs import DriveSpec, ModelSpec
from harness.models.contracts import DriveContext, Option, Profile
from harness.models.drive_options import options_of
from harness.models.drives._shapes import AMPLITUDE, LIMIT, check_lateral_acceleration, within_limit
from harness.models.roles import DRIVES, VEHICLES
from harness.recordings import readers


def build_drive(kind: str, options: Mapping[str, object], context: DriveContext, where: str = "") -> Profile:
    """Validate a drive's options and return its profile.

    Args:
        kind: File in ``models/drives``.
        options: As a study states them: numbers in SI units, text with a unit, or text.
        context: Vehicle and sampling; ``context.read`` is filled in if absent.
        where: File and drive, named in the errors; by default the kind.

    Raises:
        UserError: If the kind or an option is unknown, absent, out of bounds or of the wrong unit, or a
            recording cannot be read.
        ModelError: If the drive cannot be made from these options, or asks for too much lateral acceleration.
    """
    where = where or f"drive '{kind}'"
    if not context.step > 0 or not context.wheelbase > 0 or not context.steering_ratio > 0:
        raise UserError(
            f"{where}: step, wheelbase and steering ratio must be positive, they are {context.step:g} s, "
            f"{context.wheelbase:g} m and {context.steering_ratio:g}"
        )
    try:
        declared = options_of(kind)
    except ModelError as error:
        raise UserError(f"{where}: {error}") from None
    values = _validate(declared, options, where)
    if context.read is None:
        context = dataclasses.replace(context, read=readers.read)
    module = DRIVES.load(kind)
    try:
        own = {k: v for k, v in values.items() if _declares(module, k)}
        profile = module.generate(own, context)
        _check_shape(profile, context.step)
        if AMPLITUDE.name in own.keys() - options.keys():  # one number for all vehicles is too much for some
            within = within_limit(own[AMPLITUDE.name], profile, context, values[LIMIT.name])
            if within != own[AMPLITUDE.name]:
                profile = module.generate(own | {AMPLITUDE.name: within}, context)
        check_lateral_acceleration(profile, context, values[LIMIT.name])
    except (ModelError, UserError) as error:
        raise type(error)(f"{where}: {error}") from None
    return profile


def profile_of(spec: ModelSpec, drive: DriveSpec) -> Profile:
    """Return a drive as a plant drives it, with the plant's further inputs.

    Args:
        spec: The plant; its wheelbase and steering ratio limit the drive.
        drive: The drive, as a study or the command line states it.

    Raises:
        UserError: As ``build_drive``.
        ModelError: As ``build_drive``.
    """
    context = context_of(spec, drive)
    profile = build_drive(drive.kind, drive.options, context, drive.where)
    vehicle = None if spec.external is not None else VEHICLES.load(spec.vehicle)
    if vehicle is None or not hasattr(vehicle, "drive_inputs"):
        return profile
    return dataclasses.replace(profile, further=vehicle.drive_inputs(profile, context))


def context_of(spec: ModelSpec, drive: DriveSpec) -> DriveContext:
    """Return what a drive is to know of the plant that drives it."""
    gradient = functools.partial(_understeer_gradient, spec)
    return DriveContext(spec.wheelbase, spec.steering_ratio, spec.step, str(drive.base), gradient)


def _understeer_gradient(spec: ModelSpec) -> float:
    return axle_values(spec).get(GRADIENT, 0.0)


def _declares(module: Any, name: str) -> bool:
    return any(o.name == name for o in module.OPTIONS)


def _validate(declared: Sequence[Option], given: Mapping[str, object], where: str) -> dict[str, Any]:
    """Return a value in SI units for every option; refuse unknown and absent keys and wrong values."""
    names = [o.name for o in declared]
    for key in given:
        if key not in names:
            raise UserError(f"{where}: unknown option '{key}'{registry.closest(key, names)}")
    values: dict[str, Any] = {}
    for option in declared:
        if option.name not in given:
            if option.default is None:
                raise UserError(f"{where}: option '{option.name}' is missing: {option.meaning}")
            values[option.name] = option.default
            continue
        value = given[option.name]
        at = f"{where}, {option.name}"
        if option.unit == "text":
            if not isinstance(value, str) or not value:
                raise UserError(f"{at}: expected text, got {value!r}: {option.meaning}")
            values[option.name] = value
            continue
        number = to_si(value, option.unit, at)
        if not option.lower <= number <= option.upper:
            unit = f" {option.unit}" if option.unit else ""
            raise UserError(
                f"{at}: {value!r} lies outside {option.lower:g} to {option.upper:g}{unit}: {option.meaning}"
            )
        values[option.name] = number
    return values


def _check_shape(profile: Profile, step: float) -> None:
    """Refuse a profile that breaks the contract: this is a mistake in the drive's file, not in the study."""
    shapes = {name: np.shape(getattr(profile, name)) for name in ("time", "steering_wheel_angle", "speed")}
    if len(set(shapes.values())) != 1 or len(shapes["time"]) != 1 or shapes["time"][0] < 2:
        raise ModelError(f"time, steering and speed must be vectors of one length, their shapes are {shapes}")
    for name in shapes:
        bad = np.flatnonzero(~np.isfinite(getattr(profile, name)))
        if bad.size:
            raise ModelError(f"{name} is not finite at sample {bad[0]} ({bad.size} in all)")
    grid = np.arange(len(profile.time)) * step
    if np.abs(profile.time - grid).max() > 1e-6 * step:
        n = int(np.argmax(np.abs(profile.time - grid) > 1e-6 * step))
        raise ModelError(f"time is {profile.time[n]:.6f} s at sample {n}, not {grid[n]:.6f} s (step {step:g} s)")
    if profile.speed.min() <= 0:
        n = int(profile.speed.argmin())
        raise ModelError(f"speed is {profile.speed[n]:g} m/s at {profile.time[n]:.2f} s; it must stay positive")


def read_drives(path: str | Path) -> dict[str, tuple[str, dict[str, object]]]:
    """Read the ``[[drive]]`` tables of a TOML file: name to kind and options, in the order of the file.

    Raises:
        UserError: If the file is absent or no TOML, a table lacks ``name`` or ``kind``, or two share a name.
    """
    tables = read_toml(Path(path)).get("drive")
    if not isinstance(tables, list) or not tables or not all(isinstance(t, dict) for t in tables):
        raise UserError(f"{path}: holds no [[drive]] table")
    drives: dict[str, tuple[str, dict[str, object]]] = {}
    for number, table in enumerate(tables, start=1):
        for key in ("name", "kind"):
            if not isinstance(table.get(key), str):
                raise UserError(f"{path}, [[drive]] number {number}: '{key}' is missing or no text")
        if table["name"] in drives:
            raise UserError(f"{path}: two drives are named '{table['name']}'")
        drives[table["name"]] = (
            table["kind"],
            {k: v for k, v in table.items() if k not in ("name", "kind")},
        )
    return drives
