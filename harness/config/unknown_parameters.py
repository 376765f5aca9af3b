"""``unknown_parameters`` and ``considered_parameters`` of ``[belief]``: parameters that an estimator is not sure of."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from harness.common import registry
from harness.common.errors import ModelError
from harness.common.units import to_si
from harness.config.bounds import loading, loading_parameters, quantity, settled_load
from harness.config.parameter_set import RELATIVE_STD
from harness.config.problems import Problems
from harness.config.schema import UncertainTable
from harness.models.assembly.assemble import StateSpaceModel
from harness.models.assembly.parameter_states import ParameterState, is_logarithmic
from harness.models.contracts import Parameter

KEYS: dict[str, bool] = {"unknown_parameters": False, "considered_parameters": True}
"""The keys, and whether their parameters are left alone."""


def parameter_states(
    stated: Mapping[str, tuple[str, list[Any]]],
    model: StateSpaceModel,
    vehicle: str,
    values: Mapping[str, float],
    std: Mapping[str, float],
    problems: Problems,
) -> tuple[ParameterState, ...]:
    """Return the parameters that are states, those that are estimated first.

    Args:
        stated: Where each of ``KEYS`` was written, and its entries.
        model: The model without them.
        vehicle: File of the vehicle.
        values: What is believed of every parameter, SI.
        std: How well values are known, where the parameter set states it.
        problems: Where problems are noted.
    """
    parameters = {p.name: p for p in model.parameters} | loading_parameters(vehicle)
    states: dict[str, ParameterState] = {}
    load: dict[str, float] = {}
    for name, (where, entries) in stated.items():
        for i, entry in enumerate(entries):
            key = f"{where}[{i}]"
            table = UncertainTable(name=entry) if isinstance(entry, str) else entry
            if table.name not in parameters:
                near = registry.closest(table.name, list(parameters))
                problems.add(key, f"the belief has no parameter '{table.name}'{near}")
            elif table.name in states:
                problems.add(key, f"'{table.name}' is named twice; remove one")
            else:
                if table.name in loading_parameters(vehicle) and not load:
                    with problems.catch(key):
                        load = loading(vehicle, values)
                    if not load:
                        continue
                believed = {**values, **load}[table.name]
                state = _state(table, parameters[table.name], believed, std, KEYS[name], key, problems)
                if state is not None:
                    states[table.name] = state
    _refuse_following(states, vehicle, values, stated, problems)
    return tuple(states.values())


def _state(
    table: UncertainTable,
    parameter: Parameter,
    believed: float,
    std: Mapping[str, float],
    considered: bool,
    key: str,
    problems: Problems,
) -> ParameterState | None:
    before, logarithmic = len(problems), is_logarithmic(parameter)
    plain = parameter.unit in ("", "1", "dimensionless")
    if parameter.numerical:
        problems.add(key, f"'{parameter.name}' belongs to how the equations are solved; no measurement determines it")
    if logarithmic and believed <= 0:
        problems.add(
            key,
            f"'{parameter.name}' cannot be negative, so its logarithm is estimated, but it is believed to be "
            f"{quantity(believed, parameter.unit)}; state a positive value under [belief.values]",
        )
    size = abs(believed) or max(abs(parameter.lower), abs(parameter.upper))
    prior: float = std.get(parameter.name, RELATIVE_STD * size)
    walk = 0.0
    if table.prior is not None:
        with problems.catch(f"{key}.prior"):
            prior = to_si(table.prior, parameter.unit, problems.at(f"{key}.prior"))
    if table.walk is not None:
        with problems.catch(f"{key}.walk"):
            unit = "1/s**0.5" if plain else f"({parameter.unit})/s**0.5"
            walk = to_si(table.walk, unit, problems.at(f"{key}.walk"))
    if prior <= 0:
        problems.add(f"{key}.prior", f"a standard deviation must be positive, got {quantity(prior, parameter.unit)}")
    if walk < 0:
        problems.add(f"{key}.walk", "a random walk has no negative standard deviation; give 0 or more")
    if considered and walk > 0:
        problems.add(f"{key}.walk", "the value of a considered parameter is left alone; remove its walk")
    if len(problems) > before:
        return None
    return ParameterState(parameter.name, believed, prior, walk, considered, logarithmic)


def _refuse_following(
    states: Mapping[str, ParameterState],
    vehicle: str,
    values: Mapping[str, float],
    stated: Mapping[str, tuple[str, list[Any]]],
    problems: Problems,
) -> None:
    """Refuse what follows from a load that is uncertain as well."""
    of_load = {n: s.believed for n, s in states.items() if n in loading_parameters(vehicle)}
    if not of_load:
        return
    try:
        follows = settled_load(vehicle, values, of_load)
    except ModelError as error:
        problems.add(next(iter(stated.values()))[0], str(error))
        return
    for name in states:
        if name in follows:
            where = next(w for n, (w, _) in stated.items() if KEYS[n] == states[name].considered)
            problems.add(where, f"'{name}' follows from the load, which is uncertain as well; remove one of the two")
