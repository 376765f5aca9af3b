"""Static load, lateral force and cornering stiffness of the axles, by a vehicle's own equations at straight driving.

The understeer gradient follows from them: ``(F_z1 / C_1 - F_z2 / C_2) / g`` of the first two groups of wheels of the
leading body (Pacejka 2012, 1.3.2, with the loads for the masses; of a tractor they hold what rests on the kingpin).
"""

from __future__ import annotations

from collections.abc import Mapping
from types import ModuleType
from typing import Any

import numpy as np
import sympy as sp

from harness.models.assembly.model import StateSpaceModel, symbol
from harness.models.assembly.placement import Layout

SPEED = 15.0
"""m/s, which loads and tyres do not depend on."""

GRAVITY = 9.81


class StraightAxles:
    """Axles of a vehicle that drives straight ahead, for any values of its parameters.

    Args:
        model: The vehicle without effects.
        vehicle: Its file.

    Attributes:
        groups: Axles, or wheels, by the group of tyre parameters that they share, front to rear.
        steered: The two groups of which the understeer gradient is; none of a vehicle whose leading body has others.
    """

    def __init__(self, model: StateSpaceModel, vehicle: ModuleType) -> None:
        layout = Layout.of(vehicle)
        self.groups: dict[str, list[str]] = {}
        for axle, group in layout.tyres.items():
            self.groups.setdefault(group, []).append(axle)
        leading = dict.fromkeys(layout.tyres[axle] for axle in layout.bodies[layout.leader] if axle in layout.tyres)
        self.steered: tuple[str, ...] = tuple(leading) if len(leading) == 2 else ()
        slips = {axle: symbol(f"slip_angle_axle_{axle}") for axle in layout.tyres}
        point: dict[sp.Symbol, sp.Expr] = {symbol(n): sp.S.Zero for n in (*model.states, *model.inputs, "time")}
        point[symbol("speed")] = sp.Float(SPEED)
        for state, first in model.start.items():
            point[symbol(state)] = point.get(symbol(str(first)), sp.sympify(first if not isinstance(first, str) else 0))
            if first in model.parameter_names:
                point[symbol(state)] = symbol(str(first))
        at_load = {a: symbol(f"vertical_load_axle_{a}") for a in slips}
        loads: dict[str, sp.Expr] = {}
        for name, expr in model.ports.items():
            written = expr.xreplace(point)
            if symbol(name) in at_load.values():
                loads[name.removeprefix("vertical_load_axle_")] = written
            elif symbol(name) not in slips.values():
                point[symbol(name)] = written
        forces = {a: point[symbol(f"steady_lateral_force_axle_{a}")] for a in slips}
        slopes = {a: force.diff(slips[a]).xreplace({slips[a]: sp.S.Zero}) for a, force in forces.items()}
        self._names = model.parameter_names
        self._loads = self._function([loads[a].xreplace({at_load[b]: loads[b] for b in slips}) for a in slips])
        self._slopes = {a: self._function([slope], at_load[a]) for a, slope in slopes.items()}
        self._forces = {a: self._function([force], at_load[a], slips[a]) for a, force in forces.items()}

    def _function(self, expressions: list[sp.Expr], *further: sp.Symbol) -> Any:
        arguments = [*map(symbol, self._names), *further]
        heaviside = {"Heaviside": lambda x, half=0.5: np.heaviside(x, half)}
        return sp.lambdify(arguments, expressions, [heaviside, "numpy"], cse=True)

    def _each(self, function: Any, values: Mapping[str, Any], *further: Any) -> list[Any]:
        return function(*(values[n] for n in self._names), *further)

    def loads(self, values: Mapping[str, Any]) -> dict[str, Any]:
        """Return the static load of each axle in N; numbers or arrays of one shape, as the values are."""
        return dict(zip(self._forces, self._each(self._loads, values), strict=True))

    def stiffness(self, values: Mapping[str, Any]) -> dict[str, Any]:
        """Return the cornering stiffness of all axles of a group together in N/rad, at their static loads."""
        loads = self.loads(values)
        slopes = {axle: self._each(f, values, loads[axle])[0] for axle, f in self._slopes.items()}
        return {group: sum(slopes[axle] for axle in axles) for group, axles in self.groups.items()}

    def force(self, axle: str, values: Mapping[str, float], slip_angle: Any, load: float) -> Any:
        """Return the lateral force of an axle in N at slip angles in rad under a load in N."""
        return self._each(self._forces[axle], values, load, slip_angle)[0]

    def compliances(self, values: Mapping[str, Any]) -> tuple[Any, Any]:
        """Return load over gravity and stiffness of the two groups in rad s^2/m: slip angle per lateral acceleration.

        Their difference is the understeer gradient.
        """
        loads, stiffness = self.loads(values), self.stiffness(values)
        first, second = (sum(loads[a] for a in self.groups[g]) / GRAVITY / stiffness[g] for g in self.steered)
        return first, second
