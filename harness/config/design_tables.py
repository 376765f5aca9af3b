"""``[[design]]`` of a study file as pydantic models: its factors and their distributions."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field, StrictBool, StrictInt, StrictStr, Tag

from harness.config.key_types import FileName, Name, Number, Quantity, StrictTable, one_of
from harness.config.problems import TABLE, TEXT

MOST_LEVELS = 1000
"""Levels or bands of a factor: the report draws each."""

Levels = Annotated[list[Quantity], Field(min_length=1, max_length=MOST_LEVELS)]


Kind = Literal[
    "normal", "lognormal", "truncated_normal", "triangular", "uniform", "log_uniform", "beta", "discrete", "empirical"
]


class DistributionTable(StrictTable):
    """``distribution`` of ``[[design.factor]]``: one of the kinds, and what states it."""

    kind: Kind = Field(description="the distribution")
    mean: Quantity | None = Field(default=None, description="its mean (default: the nominal value)")
    std: Quantity | None = Field(
        default=None,
        description="its standard deviation; percent is relative to the mean (default: `[std]` of the parameter set)",
    )
    quantiles: Annotated[dict[str, Quantity], Field(min_length=2, max_length=2)] | None = Field(
        default=None, description='two quantiles in place of mean and std: `{ "5 %" = "20 t", "95 %" = "26 t" }`'
    )
    range: Annotated[list[Quantity], Field(min_length=2, max_length=2)] | None = Field(
        default=None, description="smallest and largest value (truncated_normal by default: those of the parameter)"
    )
    mode: Quantity | None = Field(default=None, description="triangular: likeliest value (default: the middle)")
    values: Annotated[list[Quantity], Field(min_length=2)] | None = Field(
        default=None, description="discrete: its values; empirical: the sample, in place of a file"
    )
    weights: list[Number] | None = Field(
        default=None, description="discrete: how often each value is, in any ratio (default: equally often)"
    )
    file: Name | None = Field(default=None, description="empirical: CSV file of the sample, next to the study")
    column: Name | None = Field(
        default=None,
        description="empirical: column of it, in the factor's unit (default: the parameter's name)",
    )


Distribution = Annotated[Annotated[Kind, Tag(TEXT)] | Annotated[DistributionTable, Tag(TABLE)], one_of(TEXT, TABLE)]


class FactorTable(StrictTable):
    """``[[design.factor]]``: exactly one of ``levels``, ``shift``, ``bands``, ``range`` and ``distribution``."""

    parameter: Name = Field(
        description="parameter of the model, or a factor on variances: "
        "process_noise_scale, measurement_noise_scale, input_noise_scale"
    )
    of: Literal["plant", "belief", "both"] = Field(default="plant", description="whose value it replaces")
    unit: Name | None = Field(
        default=None, description="unit of the labels, and of plain numbers in this table (default: SI)"
    )
    levels: Levels | None = Field(default=None, description="values")
    shift: Levels | None = Field(
        default=None, description="differences from the nominal (belief) value; percent is relative to it"
    )
    bands: Levels | None = Field(
        default=None, description="half-widths around the nominal (belief) value; percent is relative to it"
    )
    range: Annotated[list[Quantity], Field(min_length=2, max_length=2)] | None = Field(
        default=None, description="one band by its lower and upper edge"
    )
    distribution: Distribution | None = Field(
        default=None, description="how likely which value is: a kind, or a table with more"
    )
    scale: Literal["linear", "log"] = Field(
        default="linear", description="whether a band is filled evenly in the value or in its logarithm"
    )
    band: Quantity | None = Field(
        default=None,
        description="half-width around each of the levels or shifts; percent is relative to the level",
    )
    labels: list[StrictStr] | None = Field(default=None, description="one label per band, instead of the default")


class DesignTable(StrictTable):
    """``[[design]]``."""

    name: FileName = Field(description="unique name")
    sampling: Literal["sobol", "saltelli", "tolerance", "population"] = Field(
        default="sobol",
        description="sobol: points in each band; saltelli: all factors at once, for sensitivity indices; "
        "population: points of the joint distribution, for how often a limit is broken, by which factors; "
        "tolerance: nested boxes around the nominal point, for the largest one an estimator tolerates",
    )
    samples: Annotated[StrictInt, Field(ge=1)] = Field(default=1, description="Sobol points per band; a power of two")
    boxes: Annotated[StrictInt, Field(ge=2, le=64)] | None = Field(
        default=None, description="tolerance only: number of nested boxes, evenly spaced (default 8)"
    )
    scramblings: Annotated[StrictInt, Field(ge=8, le=1024)] | None = Field(
        default=None, description="population only: independent scramblings of that many samples each (default 8)"
    )
    correlation: list[tuple[Name, Name, Number]] | None = Field(
        default=None, description='correlations of two factors each: `[["payload_mass", "payload_from_rear", 0.6]]`'
    )
    posterior: Name | None = Field(
        default=None,
        description="population only: what parameters are drawn from: a result of `harness identify` or `trace`, or a "
        "sample in a CSV file",
    )
    model: Annotated[StrictInt, Field(ge=1)] | None = Field(
        default=None,
        description="with the posterior of a trace: which model of its `confusable` set vehicles are of, the likeliest "
        "is 1 (default: the amended model)",
    )
    share: Annotated[Number, Field(gt=0)] | None = Field(
        default=None,
        description="population only: how likely it is that the vehicle is one of this design, in any ratio to the "
        "others that state it; the report says how wrong estimates are over all of them",
    )
    groups: dict[Name, Annotated[list[Name], Field(min_length=1)]] | None = Field(
        default=None, description='population only: factors that are ranked as one, `{ tyre = ["friction", ...] }`'
    )
    repeats: Annotated[StrictInt, Field(ge=1)] = Field(default=1, description="runs with fresh noise per point")
    sobol_any_n: StrictBool = Field(
        default=False, description="allow a number of samples that is no power of two (unbalanced)"
    )
    factor: list[FactorTable] = Field(
        default_factory=list, description="what is varied; the i-th bands belong together"
    )
