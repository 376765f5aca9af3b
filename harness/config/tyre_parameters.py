"""A model on the tyres of property files: their coefficients and relaxation lengths in place of its own tyre."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from harness.common.errors import UserError
from harness.config.bounds import out_of_bounds
from harness.config.derived import axles_of
from harness.config.specs import ModelSpec
from harness.config.tyre_file import TYRE, TyreFile, read_tyre_file
from harness.models.assembly.plan import planner
from harness.models.roles import VEHICLES

TWIN = ",twin"
_RELAXATION = "tyre_relaxation"


@dataclass(frozen=True)
class FittedTyre:
    """The tyres of one group of axles.

    Attributes:
        group: Of the vehicle's ``AXLES``.
        file: Its property file.
        count: Tyres of an axle, or of a wheel that the vehicle has for itself.
        load: Static load of one tyre in N, the mean of the group.
    """

    group: str
    file: TyreFile
    count: int
    load: float


def fitted(base: ModelSpec, given: Sequence[str]) -> list[FittedTyre]:
    """Return which tyre each group of axles has.

    Args:
        base: The vehicle.
        given: Files, ``GROUP=FILE`` or front to rear, one for all groups or one each; ``,twin`` behind one for twin
            tyres.

    Raises:
        UserError: If the vehicle has no tyres, a file is wrong, or the files do not say which group has which.
    """
    if (axles := axles_of(base)) is None:
        raise UserError(f"--tyre: '{base.vehicle}' has no axles with tyres of the library")
    groups, named, row = list(axles.groups), dict[str, str](), list[str]()
    for text in given:
        head, is_named, rest = text.partition("=")
        if is_named and head in groups and head not in named:
            named[head] = rest
        else:
            row.append(text)
    if not named:
        row = row * len(groups) if len(row) == 1 else row
        named = dict(zip(groups, row, strict=False))
        row = row[len(groups) :]
    if row or set(named) != set(groups):
        raise UserError(
            f"--tyre: '{base.vehicle}' has the tyres {', '.join(groups)}; give one file for all, one each in this "
            f"order, or {' '.join(f'--tyre {g}=FILE' for g in groups)}"
        )
    plan = planner(base.model(), VEHICLES.load(base.vehicle)).plan(base.values)
    loads, tyres = axles.loads(base.values), []
    for group in groups:
        path = named[group].removesuffix(TWIN)
        wheels = plan is not None and all(plan.axles[a].y != 0.0 for a in axles.groups[group])
        count = (1 if wheels else 2) * (2 if named[group].endswith(TWIN) else 1)
        load = sum(float(loads[a]) for a in axles.groups[group]) / len(axles.groups[group]) / count
        tyres.append(FittedTyre(group, read_tyre_file(Path(path)), count, load))
    return tyres


def on_tyres(base: ModelSpec, tyres: Sequence[FittedTyre]) -> ModelSpec:
    """Return a model with other tyres.

    Friction becomes a factor on that of the tyres, 1; a camber thrust that the vehicle states is left to them.
    Relaxation lengths are those at the static loads: of the vehicle, one for all tyres the mean, or an effect.

    Raises:
        UserError: If a coefficient is outside its bounds.
        ModelError: If an effect of the model does not fit the tyre.
    """
    own = {p.name for p in VEHICLES.load(base.vehicle).PARAMETERS}
    axles = axles_of(base)
    assert axles is not None
    values = dict(base.values) | {n: v for n, v in (("friction", 1.0), ("camber_thrust", 0.0)) if n in own}
    effects, lengths = [e for e in base.effects if e != _RELAXATION], []
    for tyre in tyres:
        values |= {f"{name}_{tyre.group}": value for name, value in tyre.file.coefficients.items()}
        values[f"tyres_{tyre.group}"] = float(tyre.count)
        if (length := tyre.file.relaxation(tyre.load)) <= 0:
            continue
        lengths.append(length)
        if f"relaxation_length_{tyre.group}" in own:
            values[f"relaxation_length_{tyre.group}"] = length
        elif "relaxation_length" not in own:
            effects = [*dict.fromkeys([*effects, _RELAXATION])]
            values |= {f"{_RELAXATION}_{axle}": length for axle in axles.groups[tyre.group]}
    if lengths and "relaxation_length" in own:
        values["relaxation_length"] = sum(lengths) / len(lengths)
    spec = replace(base, tyre=TYRE, effects=tuple(effects), unknown_inputs=(), parameter_states=())
    parameters = spec.model().parameters
    held = {p.name: values.get(p.name, p.neutral if p.neutral is not None else float("nan")) for p in parameters}
    for p in parameters:
        if (wrong := out_of_bounds(p, held[p.name])) is not None:
            raise UserError(f"--tyre: {wrong}")
    return replace(spec, values=held)


def remarks(spec: ModelSpec, tyres: Sequence[FittedTyre]) -> list[str]:
    """Return what was taken from the files in sentences, and what a user has to know of it."""
    axles = axles_of(spec)
    assert axles is not None
    stiffness, sentences = axles.stiffness(spec.values), []
    for tyre in tyres:
        length = tyre.file.relaxation(tyre.load)
        n = tyre.count * len(axles.groups[tyre.group])
        sentences.append(
            f"{tyre.group}: {tyre.file.path.name} ({tyre.file.kind}), {n} tyres under {tyre.load / 1e3:.3g} kN each; "
            f"cornering stiffness of all {float(stiffness[tyre.group]) / 1e3:.4g} kN/rad, "
            + (f"relaxation length {length:.3g} m" if length > 0 else "no relaxation length in the file")
        )
        low, high = tyre.file.loads
        if not low <= tyre.load <= high:
            sentences.append(
                f"{tyre.group}: {tyre.load / 1e3:.3g} kN is outside the loads of its measurements, {low / 1e3:g} to "
                f"{high / 1e3:g} kN: this may be the tyre of another vehicle"
            )
    if "friction" in spec.values:
        sentences.append("friction: 1, now a factor on the tyres' own: the road over the surface of their measurements")
    return sentences
