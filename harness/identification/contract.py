"""Contract of a method of identification. Methods are the files of ``harness/identification/methods``.

A method exports

``Settings``                            pydantic model of its settings, each with a description
``identify(problem, settings, say)``    returns a ``Fit``; ``say`` takes a line on what is being done

and is chosen by the stem of its file. It gets recordings and a model, and may use ``problem.innovations`` (filter,
likelihood, derivatives, free run) or its own means.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from types import ModuleType
from typing import Any, Literal

from pydantic import ValidationError

from harness.common.arrays import Floats
from harness.common.errors import UserError
from harness.common.registry import Role, closest
from harness.common.units import refuse_misread
from harness.config import ModelSpec
from harness.identification.data import DriveData
from harness.identification.innovations import Innovations

METHODS = Role(f"{__package__}.methods", "method", ("Settings", "identify"), "harness/identification/contract.py")

Verdict = Literal["determined", "weakly determined", "confounded", "not determined", "at its bound"]


@dataclass(frozen=True)
class Problem:
    """A model to be fitted to recordings.

    Attributes:
        innovations: The model with its filter; its values are where the search begins.
        drives: The recordings to fit, from ``innovations.drive``.
        free: Parameters to be found.
        seed: Of the method's random numbers.
    """

    innovations: Innovations
    drives: tuple[DriveData, ...]
    free: tuple[str, ...]
    seed: int = 0

    @property
    def spec(self) -> ModelSpec:
        """The model with its initial values."""
        return self.innovations.spec


@dataclass(frozen=True)
class Profile:
    """The likelihood along one parameter, all others refitted at each value.

    Attributes:
        values: Values of the parameter, ascending ``(n,)``.
        drop: Log-likelihood below its maximum ``(n,)``, 0 at the estimate.
    """

    values: Floats
    drop: Floats


@dataclass(frozen=True)
class Estimate:
    """One parameter or variance as found.

    Attributes:
        name: Parameter of the model, or ``process_noise <unit>``, ``measurement_noise <output>``.
        unit: SI unit.
        start: Value before the fit.
        value: Value found.
        error: Standard error; NaN if the method states none, infinite if the recordings say nothing.
        lower: Lower end of the 95 % interval.
        upper: Upper end.
        verdict: Whether the recordings determine it; ``None`` if the method cannot say.
        reason: The verdict in a sentence.
        profile: The likelihood along it, if computed.
        widened: Width of the interval, in the coordinate of the search, over that which white innovations would leave.
    """

    name: str
    unit: str
    start: float
    value: float
    error: float = math.nan
    lower: float = math.nan
    upper: float = math.nan
    verdict: Verdict | None = None
    reason: str = ""
    profile: Profile | None = None
    widened: float = 1.0


@dataclass(frozen=True)
class Fit:
    """What a method found.

    Attributes:
        method: Its name.
        spec: The model with what was found; process and measurement noise are the initial ones if it estimates none.
        estimates: Parameters first, in the order asked for, then variances.
        correlation: Of the estimates ``(n, n)``; empty if the method states none.
        objective: Name of what was minimised or maximised.
        before: Objective at the initial values.
        after: Objective at the values found.
        history: Objective at every iteration.
        converged: Whether the method's convergence criterion was met.
        coloured: Outputs whose innovations are coloured by so much that the intervals are wider for it.
        notes: Sentences for the report.
        further: Numbers of the method's own for ``identify.json``.
        asked: What ``EarlierResult`` reads of the task.
        planned: What came of the errors that planned drives were expected to leave, as ``record_of_errors`` has it.
    """

    method: str
    spec: ModelSpec
    estimates: tuple[Estimate, ...]
    correlation: Floats
    objective: str
    before: float
    after: float
    history: tuple[float, ...]
    converged: bool
    coloured: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()
    further: Mapping[str, Any] = field(default_factory=dict)
    asked: Mapping[str, Any] = field(default_factory=dict)
    planned: Mapping[str, Any] | None = None

    def estimate(self, name: str) -> Estimate:
        """Return the estimate of a parameter or variance by name."""
        return next(e for e in self.estimates if e.name == name)


def load_method(name: str) -> ModuleType:
    """Return a method's file.

    Raises:
        ModelError: If there is none of that name (with the closest names) or it lacks an export.
    """
    return METHODS.load(name)


def settings_of(method: ModuleType, given: Mapping[str, Any]) -> Any:
    """Return the settings of a method with those that are given.

    Raises:
        UserError: If a setting is unknown or does not fit.
    """
    name = method.__name__.rsplit(".", 1)[-1]
    refuse_misread(given, f"settings of method '{name}'")
    try:
        return method.Settings(**given)
    except ValidationError as error:
        names = list(method.Settings.model_fields)
        lines = [_in_words(str(item["loc"][0]), item["type"], item["msg"], names) for item in error.errors()]
        raise UserError("\n".join(f"settings of method '{name}': {line}" for line in lines)) from None


def _in_words(key: str, kind: str, message: str, names: Sequence[str]) -> str:
    if kind == "extra_forbidden":
        return f"no setting '{key}'{closest(key, list(names))}"
    return f"{key}: {message[:1].lower()}{message[1:]}"
