"""Types of the keys of study files, and the two kinds of their tables."""

from __future__ import annotations

import math
from typing import Annotated, Any

from pydantic import BaseModel, BeforeValidator, ConfigDict, Discriminator, Field, StrictStr, Tag, WithJsonSchema

from harness.common.units import separators
from harness.config.problems import LIST, TABLE, TEXT


def _quantity(value: object) -> object:
    if isinstance(value, bool) or not isinstance(value, int | float | str):
        raise ValueError('expected a number in SI units or text with a unit such as "24 t"')
    if isinstance(value, float) and not math.isfinite(value):
        raise ValueError("expected a finite number")
    return value


Quantity = Annotated[
    Any,
    BeforeValidator(_quantity),
    WithJsonSchema(
        {
            "anyOf": [{"type": "number"}, {"type": "string"}],
            "description": 'a number in SI units, or text with a unit such as "24 t" or "5 %"',
        }
    ),
]


def _number(value: object) -> object:
    if isinstance(value, str):
        raise ValueError(separators(value) or "expected a number without quotes")
    return value


Number = Annotated[float, BeforeValidator(_number), Field(strict=True, allow_inf_nan=False)]
"""A number without a unit: pydantic alone takes ``"1_5"`` for 15."""
Name = Annotated[StrictStr, Field(min_length=1)]
FileName = Annotated[StrictStr, Field(pattern=r"^[A-Za-z0-9][A-Za-z0-9._-]*$")]


def one_of(*forms: str) -> Discriminator:
    """Discriminate the forms of a key; errors about anything else are those of the first form."""

    def form(value: Any) -> str:
        own = TABLE if isinstance(value, dict | BaseModel) else LIST if isinstance(value, list) else TEXT
        return own if own in forms else forms[0]

    return Discriminator(form)


Text = Annotated[Name, Tag(TEXT)]


class StrictTable(BaseModel):
    """A table of the file: unknown keys are refused."""

    model_config = ConfigDict(extra="forbid", frozen=True)


class OpenTable(BaseModel):
    """A table whose further keys belong to a drive or an estimator, which checks them."""

    model_config = ConfigDict(extra="allow", frozen=True)

    @property
    def further(self) -> dict[str, Any]:
        """The keys that belong to the drive or estimator."""
        return dict(self.__pydantic_extra__ or {})
