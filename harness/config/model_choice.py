"""A model of which only some keys are stated: the others follow from its parameter set and from recordings.

The one place where a vehicle named on the command line or in Python becomes a table as ``[plant]`` of a study has it.
"""

from __future__ import annotations

from collections.abc import Hashable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

from harness.common.errors import ModelError, UserError
from harness.config.parameter_set import ParameterSet, load_set
from harness.models.roles import PARAMETERS, SENSORS, VEHICLES

_TYRE = "magic_formula"


def complete(
    table: Mapping[str, Any],
    recordings: Sequence[Iterable[Hashable]] | None = None,
    choose_sensors: bool = True,
) -> tuple[dict[str, Any], tuple[str, ...]]:
    """Return a model's table with parameter set, tyre and sensors filled in.

    Tyre, effects and sensors that are not stated are those of the parameter file. Effects and sensors that are stated
    take their place, and a note says so; a tyre cannot, because the values belong to it. What neither states is
    ``magic_formula`` where a tyre is needed, no effect, and the sensors that use most of the recordings or, without
    recordings, the usual ones of the vehicle, which also has a usual parameter set.

    Args:
        table: Keys and values as in ``[plant]``; ``vehicle`` at least. ``None`` is what was not stated.
        recordings: The signals of those that the model is for, if any.
        choose_sensors: Whether sensors are filled in that neither table nor parameter file states.

    Returns:
        The table, and notes for the user in sentences without a full stop.

    Raises:
        UserError: If the vehicle has several parameter sets or sensors to choose from and no usual one, or the
            recordings hold nothing that its sensors measure, or nothing whose noise is known.
        ModelError: If there is no such vehicle or parameter set.
    """
    stated = {key: value for key, value in table.items() if value is not None}
    vehicle = str(stated["vehicle"])
    name, chosen_for = _parameter_set(vehicle, stated.get("parameters"))
    parameter_set = load_set(name, Path(), "parameters")
    if parameter_set.vehicle != vehicle:
        raise UserError(f"parameters: '{name}' holds values of vehicle '{parameter_set.vehicle}', not of '{vehicle}'")
    notes = [*chosen_for, *([f"{parameter_set.source}: {parameter_set.warning}"] if parameter_set.warning else [])]
    effects = tuple(stated.get("effects") or ())
    if effects and parameter_set.effects and effects != parameter_set.effects:
        chosen, there = ", ".join(effects), ", ".join(parameter_set.effects)
        notes.append(f"effects: the model has {chosen}, in place of {there} of {parameter_set.source}")
    tyre = stated.get("tyre") or parameter_set.tyre
    if tyre is None and VEHICLES.load(vehicle).AXLES:
        tyre = _TYRE
    sensors = stated.get("sensors") or parameter_set.sensors
    if stated.get("sensors") and parameter_set.sensors and sensors != parameter_set.sensors:
        notes.append(f"sensors: {sensors}, in place of {parameter_set.sensors} of {parameter_set.source}")
    if sensors is None and choose_sensors and recordings is not None:
        sensors, about = _most_sensors(vehicle, tyre, recordings, _noise_known(stated, parameter_set))
        notes += about
    elif sensors is None and choose_sensors:
        sensors = _usual_sensors(vehicle, tyre)
    chosen_keys = {"vehicle": vehicle, "parameters": name, "tyre": tyre, "sensors": sensors}
    return {**stated, **{k: v for k, v in chosen_keys.items() if v is not None}}, tuple(notes)


def _parameter_set(vehicle: str, given: str | None) -> tuple[str, tuple[str, ...]]:
    """Return the parameter set asked for, or the vehicle's usual or only one, and a note if there was a choice.

    Raises:
        UserError: If none is asked for and the vehicle has none, or several and no usual one.
        ModelError: If there is no such vehicle.
    """
    VEHICLES.load(vehicle)
    if given is not None:
        return str(given), ()
    sets = PARAMETERS.names()
    fit = [n for n in sets if vehicle == PARAMETERS.load(n).VEHICLE]
    if (chosen := _usual(vehicle, "parameters", fit)) is not None:
        others = ", ".join(n for n in fit if n != chosen)
        return chosen, (f"parameters: {chosen}, the usual ones of '{vehicle}'; there are also {others}",) * bool(others)
    there = f"There are {', '.join(fit)}; or write a TOML parameter file" if fit else "Write a TOML parameter file"
    raise UserError(f"parameters: which values of '{vehicle}'? {there} (docs/studies.md)")


def _usual(vehicle: str, what: str, fit: Sequence[str]) -> str | None:
    """Return what a vehicle's ``USUAL`` names of what fits, or the only one that fits."""
    named = getattr(VEHICLES.load(vehicle), "USUAL", {}).get(what)
    return named if named in fit else fit[0] if len(fit) == 1 else None


def _noise_known(stated: Mapping[str, Any], parameter_set: ParameterSet) -> set[str]:
    """Return the outputs whose noise a model's table or its parameter set states."""
    return {*parameter_set.measurement, *((stated.get("noise") or {}).get("measurement") or {})}


def fitting_sensors(vehicle: str, tyre: str | None) -> list[str]:
    """Return the sets of sensors whose outputs a vehicle publishes."""
    return [n for n in SENSORS.names() if _fits(vehicle, tyre, n)]


def _usual_sensors(vehicle: str, tyre: str | None) -> str:
    """Return the sensors of a vehicle where no recordings decide: the usual ones, or the only ones that fit."""
    fit = fitting_sensors(vehicle, tyre)
    if (chosen := _usual(vehicle, "sensors", fit)) is not None:
        return chosen
    raise UserError(f"sensors: which of '{vehicle}'? There are {', '.join(fit) or 'none that fit'}")


def largest_sensors(table: Mapping[str, Any]) -> str:
    """Return the sensors that measure all that any set for a vehicle does and whose noise is known.

    Args:
        table: A model as ``complete`` returns it, without sensors.

    Raises:
        UserError: If no set fits the vehicle.
    """
    sets = _outputs(table["vehicle"], table.get("tyre"))
    if not sets:
        raise UserError(f"sensors: no set measures what '{table['vehicle']}' publishes; list what is measured")
    with_noise = _noise_known(table, load_set(str(table["parameters"]), Path(), "parameters"))
    return _named(sets, [o for o in _every(sets) if o in with_noise]) or next(iter(sets))


def _most_sensors(
    vehicle: str, tyre: str | None, recordings: Sequence[Iterable[Hashable]], with_noise: set[str]
) -> tuple[str, tuple[str, ...]]:
    """Return the sensors that use all signals of the recordings whose noise is known, and what further ones would need.

    Raises:
        UserError: If there are none.
    """
    there = set.intersection(*({str(v) for v in r} for r in recordings))
    sets = _outputs(vehicle, tyre)
    every = _every(sets)
    recorded = [o for o in every if o in there]
    if not recorded:
        raise UserError(f"sensors: the recordings hold nothing that sensors of '{vehicle}' measure: {', '.join(every)}")
    chosen = _named(sets, [o for o in recorded if o in with_noise])
    unknown, lacking = [o for o in recorded if o not in with_noise], [o for o in every if o not in there]
    if chosen is None:
        raise UserError(
            f"sensors: nobody knows the noise of {', '.join(recorded)}; state the variance, by the key "
            f"noise.measurement.{recorded[0]} of the model or in [measurement_noise] of a parameter file"
        )
    notes = []
    if unknown:
        notes.append(
            f"sensors: {', '.join(unknown)} of the recordings is not used, because nobody knows the noise; state the "
            "variance in [measurement_noise] of a parameter file"
        )
    if lacking:
        used = "" if "," in chosen else f" ({', '.join(sorted(with_noise.intersection(recorded)))})"
        notes.append(
            f"sensors: {chosen}{used}; the recordings lack {', '.join(lacking)}, and what only that would show "
            "cannot be found"
        )
    return chosen, tuple(notes)


def _outputs(vehicle: str, tyre: str | None) -> dict[str, list[str]]:
    """Return what each set of sensors measures of a vehicle, the largest first."""
    outputs = {n: list(SENSORS.load(n).OUTPUTS) for n in fitting_sensors(vehicle, tyre)}
    return dict(sorted(outputs.items(), key=lambda item: -len(item[1])))


def _every(sets: Mapping[str, list[str]]) -> list[str]:
    """Return what sets of sensors measure, each output once, those of the first set first."""
    return list(dict.fromkeys(o for outputs in sets.values() for o in outputs))


def _named(sets: Mapping[str, list[str]], wanted: Sequence[str]) -> str | None:
    """Return sensors that measure some outputs: the set that does, or the outputs themselves; none of nothing."""
    sensors = next((n for n, outputs in sets.items() if set(outputs) == set(wanted)), ", ".join(wanted))
    return sensors if wanted else None


def _fits(vehicle: str, tyre: str | None, sensors: str) -> bool:
    """Whether a vehicle publishes what a set of sensors measures."""
    from harness.models.assembly.assemble import assemble

    try:
        assemble(vehicle, tyre, (), sensors)
    except ModelError:
        return False
    return True
