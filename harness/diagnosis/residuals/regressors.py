"""Signals on which a disturbance may depend: inputs, measured motion, and what follows from both at once.

Tyre forces are not among them: the forces of a filter without the disturbance absorb it, and would explain whatever is
missing. Inputs are measured, and a measured angle or rate is hardly filtered.

What has memory (rubber that is stiffer at first, a load that gives way) depends on the high-pass part of a signal: the
signal less its low-pass of first order. That is taken one sample earlier, because the high-pass part of a filtered
signal contains the measurement noise of its own sample, which would explain itself.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from scipy import signal

from harness.common.arrays import Floats
from harness.diagnosis.model.augmented_model import AugmentedModel
from harness.identification.data import Drive
from harness.models.assembly.assemble import Model, symbol
from harness.models.signals import SIGNALS

_LOWEST_SPEED = 1.0
"""m/s; a curvature is taken at this speed at least."""

WITHIN = (0.2, 0.6)
"""s; how old the quick part of a signal may be."""

_WINDOW = 0.1
"""s over which the rate of an input is taken."""


@dataclass(frozen=True)
class Regressor:
    """A signal that a disturbance may depend on.

    Attributes:
        name: As a signal of the project where it is one.
        words: In reports.
        unit: SI.
        of: The signal from states ``(samples, nx)``, inputs ``(samples, nu)`` and rates of those ``(samples, nu)``.
        within: Time constant in s of the low-pass that is taken off, infinite if it is the signal itself.
    """

    name: str
    words: str
    unit: str
    of: Callable[[Floats, Floats, Floats], Floats] = field(compare=False)
    within: float = math.inf

    def over(self, states: Floats, drive: Drive) -> Floats:
        """Return its value over a drive ``(samples,)`` of states ``(samples, nx)``."""
        s = self.of(states, drive.inputs, rates(drive))
        share = self.renewed(float(drive.time[1] - drive.time[0]))
        if share == 0.0:
            return s
        slow, _ = signal.lfilter([share], [1.0, share - 1.0], s, zi=[(1.0 - share) * s[0]])
        return np.concatenate([[0.0], (s - slow)[:-1]])

    def renewed(self, step: float) -> float:
        """Return the share of the low-pass that a step in s renews; none of it where nothing is taken off."""
        return -math.expm1(-step / self.within)


def regressors_of(augmented: AugmentedModel) -> tuple[Regressor, ...]:
    """Return the regressors that a nominal model has, as functions of states and inputs of the augmented one."""
    model, column = augmented.nominal, augmented.model.inputs.index
    inputs = [n for n in model.inputs if n != "time"]
    measured = [s for s in model.states if _measured(model, s) and SIGNALS[s].unit != "N"]
    found = [_column(n, column(n), 1) for n in inputs]
    found += [_column(n, model.states.index(n), 0) for n in measured]
    for n in inputs:
        if n not in model.rates and f"{n}_rate" not in inputs and n != "speed":
            found.append(_rate_of_input(n, column(n)))
    found += [d for s in measured if (d := _rate_of_state(model, s, measured)) is not None]
    if "speed" in inputs:
        speed = column("speed")
        for s in measured:
            if SIGNALS[s].unit == "rad/s":
                found += _cornering(s, model.states.index(s), speed)
    return tuple(found)


def with_quick(regressors: Sequence[Regressor]) -> tuple[Regressor, ...]:
    """Return regressors and the quick parts of those that are angles or rates of turn."""
    found = list(regressors)
    for d in regressors:
        if d.name in SIGNALS and d.unit in ("rad", "rad/s"):
            for within in WITHIN:
                found.append(replace(d, words=f"quick part of the {d.words} (within {within:g} s)", within=within))
    return tuple(found)


def rates(drive: Drive) -> Floats:
    """Return the time derivative of every input over a short window ``(samples, nu)``."""
    step = float(drive.time[1] - drive.time[0])
    reach = max(1, round(0.5 * _WINDOW / step))
    padded = np.pad(drive.inputs, ((reach, reach), (0, 0)), mode="edge")
    return (padded[2 * reach :] - padded[: -2 * reach]) / (2 * reach * step)


def _measured(model: Model, state: str) -> bool:
    return any(
        model.ports.get(f"sensor_{output}", expr) == symbol(state) or expr == symbol(state)
        for output, expr in model.outputs.items()
    )


def _column(name: str, i: int, source: int) -> Regressor:
    return Regressor(name, name.replace("_", " "), SIGNALS[name].unit, lambda *tables: tables[source][:, i])


def _rate_of_input(name: str, i: int) -> Regressor:
    words = f"rate of the {name.replace('_', ' ')}"
    return Regressor(f"{name}_rate", words, f"{SIGNALS[name].unit}/s", lambda x, u, du: du[:, i])


def _rate_of_state(model: Model, state: str, measured: list[str]) -> Regressor | None:
    """Return the rate of a state that follows from measured ones alone."""
    rate = model.derivatives[model.states.index(state)]
    reads = {s.name for s in rate.free_symbols}
    if model.discrete or not reads or not reads <= set(measured):
        return None
    slopes = np.zeros(len(model.states))
    for name in reads:
        slope = rate.diff(symbol(name))
        if not slope.is_number:
            return None
        slopes[model.states.index(name)] = float(slope)
    words = f"rate of the {state.replace('_', ' ')}"
    return Regressor(f"{state}_rate", words, f"{SIGNALS[state].unit}/s", lambda x, u, du: x[:, : len(slopes)] @ slopes)


def _cornering(state: str, i: int, speed: int) -> list[Regressor]:
    of = state.removeprefix("yaw_rate").replace("_", " ")
    return [
        Regressor(
            f"{state}*speed",
            f"yaw rate{of} times speed",
            "m/s^2",
            lambda x, u, du: x[:, i] * u[:, speed],
        ),
        Regressor(
            f"{state}/speed",
            f"curvature{' of the path of the' + of if of else ''}",
            "1/m",
            lambda x, u, du: x[:, i] / np.maximum(u[:, speed], _LOWEST_SPEED),
        ),
    ]
