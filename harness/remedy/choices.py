"""Remedies for parameters that are not as believed: estimate or consider them, a bank over them, a sensor."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from harness.common.errors import UserError
from harness.common.files import parse_toml
from harness.config import DesignSpec, FactorSpec, StudySpec, build_study, fitting_sensors
from harness.config.bounds import loading_parameters
from harness.config.roles import ESTIMATORS
from harness.config.schema import EstimatorTable, StudyFile
from harness.config.specs import NOISE_SCALES
from harness.config.tuning import as_table
from harness.estimation.contract import load_estimator
from harness.models.quantities import listed, words
from harness.models.roles import SENSORS


@dataclass(frozen=True)
class Equipment:
    """What estimators get to know of the vehicle.

    Attributes:
        sensors: File in ``models/sensors``.
        unknown_inputs: Inputs that nobody measures.
        added: Signals that are measured beyond the study's own, those of a set of sensors first.
        inputs: Those of them that are inputs.
    """

    sensors: str
    unknown_inputs: tuple[str, ...]
    added: tuple[str, ...]
    inputs: tuple[str, ...]

    @property
    def sources(self) -> list[str]:
        """The set of sensors, if that is another one, and the inputs measured."""
        return [*([self.sensors] if len(self.added) > len(self.inputs) else []), *self.inputs]


@dataclass(frozen=True)
class Remedy:
    """One remedy; without anything it is the study as it is.

    Attributes:
        estimated: Parameters that become states.
        considered: Parameters whose uncertainty is reckoned with.
        banked: Parameters over whose values a bank of filters runs (estimator ``imm``), each estimating the others.
        equipment: What is measured, ``None`` for what the study has.
        ideal_parameters: Parameters that the belief has right, which nobody can do: what a remedy is measured against.
        tuned: Whether the noise believed is tuned for the worst case.
        adapted: Filter that stands in place of the estimator, one of ``adapted``; empty for none.
        amended: Whether the belief is the plant's model, what the remedies of a trace are measured against.
    """

    estimated: tuple[str, ...] = ()
    considered: tuple[str, ...] = ()
    banked: tuple[str, ...] = ()
    equipment: Equipment | None = None
    ideal_parameters: tuple[str, ...] = ()
    tuned: bool = False
    adapted: str = ""
    amended: bool = False

    @property
    def added(self) -> tuple[str, ...]:
        """Signals that it needs beyond the study's own."""
        return () if self.equipment is None else self.equipment.added

    @property
    def measures(self) -> str:
        """The set of sensors and the inputs measured in addition, in words."""
        return ", ".join(words(s) for s in self.equipment.sources) if self.equipment else "nothing"

    @property
    def does(self) -> str:
        """What is done with parameters, in words."""
        return self.phrase()

    def phrase(self, drivers: Sequence[str] = ()) -> str:
        """Say what is done with parameters, where all of those that drive the error are meant in short.

        Args:
            drivers: These; none are told by their names.
        """
        named = {
            "estimate": self.estimated,
            "consider": self.considered,
            "run a bank of filters over": self.banked,
            "know": self.ideal_parameters,
        }
        parts = [f"{verb} {_these(names, drivers)}" for verb, names in named.items() if names]
        parts += ["tune for the worst case"] if self.tuned else []
        parts += [load_estimator(self.adapted).REMEDY] if self.adapted else []
        parts += ["believe the amended model"] if self.amended else []
        return "; ".join(parts) or "as it is"

    @property
    def slug(self) -> str:
        """Name of its folder."""
        parts = [f"estimate-{'-'.join(self.estimated)}"] if self.estimated else []
        parts += [f"consider-{'-'.join(self.considered)}"] if self.considered else []
        parts += [f"bank-{'-'.join(self.banked)}"] if self.banked else []
        parts += [f"know-{'-'.join(self.ideal_parameters)}"] if self.ideal_parameters else []
        parts += ["tune-for-the-worst-case"] if self.tuned else []
        parts += [self.adapted.replace("_", "-")] if self.adapted else []
        parts += ["amended"] if self.amended else []
        parts += [f"with-{'-'.join(self.equipment.sources)}"] if self.equipment else []
        return "-and-".join(parts) or "as-it-is"

    @property
    def words(self) -> str:
        """What it does, as the report calls it."""
        return self.phrase_with_sensors()

    def phrase_with_sensors(self, drivers: Sequence[str] = ()) -> str:
        """Say what it does and measures; ``drivers`` as in ``phrase``."""
        does = self.phrase(drivers)
        if self.equipment is None:
            return does
        sensors = listed([words(s) for s in self.equipment.sources])
        return f"add {sensors}" if does == AS_IT_IS.does else f"{does}, with {sensors}"


def _these(names: Sequence[str], drivers: Sequence[str]) -> str:
    """Name parameters, or say ``all four``."""
    if len(names) > 1 and set(names) == set(drivers):
        counts = {2: "both", 3: "all three", 4: "all four", 5: "all five", 6: "all six"}
        return counts.get(len(names), f"all {len(names)}")
    return f"the {listed([words(n) for n in names])}"


AS_IT_IS = Remedy()

VALUES = 2
"""Values of each parameter in a bank: each filter estimates from there on, and two begin near enough to the truth."""

MOST_BANKED = 3
"""Parameters up to which a bank is tried: of more there would be too many filters."""


def parameters(study: StudySpec) -> list[FactorSpec]:
    """Return the factors of the first design that a belief could be unsure of: no noise, and nothing only believed."""
    names = set(study.belief.model().parameter_names) | set(loading_parameters(study.belief.vehicle))
    uncertain = {s.name for s in study.belief.parameter_states}
    return [
        f
        for f in study.designs[0].factors
        if f.parameter in names - uncertain and f.parameter not in NOISE_SCALES and f.of == "plant"
    ]


def prior(factor: FactorSpec) -> float:
    """Return how far the vehicle is from the belief in a design, in the root mean square over its bands, SI."""
    low, high = (np.array(edge) - factor.nominal for edge in (factor.lower, factor.upper))
    return float(np.sqrt(np.mean((low**2 + low * high + high**2) / 3)))


def hypotheses(factors: Sequence[FactorSpec]) -> dict[str, list[float]]:
    """Return values of each parameter for a bank of filters, over what the study varies.

    A hypothesis stands for all values that are nearer to it than to another one; together they stand for the range, in
    parts of one ratio where values are positive, else of one size.
    """
    grids = {}
    for f in factors:
        low, high = float(np.min(f.lower)), float(np.max(f.upper))
        middles = (np.arange(VALUES) + 0.5) / VALUES
        values = low * (high / low) ** middles if low > 0 else low + (high - low) * middles
        grids[f.parameter] = [float(v) for v in values]
    return grids


def equipments(study: StudySpec) -> list[Equipment]:
    """Return every larger equipment: the sets of sensors that add to the study's, inputs measured or not."""
    here = study.plant.sensors
    own = SENSORS.load(here).OUTPUTS
    sets = [here] + [s for s in _sensor_sets(study) if set(own.values()) < set(SENSORS.load(s).OUTPUTS.values())]
    unknown = study.belief.unknown_inputs
    larger = []
    for name in sets:
        further = tuple(s for o, s in SENSORS.load(name).OUTPUTS.items() if s not in own.values())
        for unmeasured in dict.fromkeys((unknown, ())):
            inputs = tuple(n for n in unknown if n not in unmeasured)
            if further or inputs:
                larger.append(Equipment(name, unmeasured, (*further, *inputs), inputs))
    return larger


def _sensor_sets(study: StudySpec) -> list[str]:
    """Return the sets of sensors that fit the plant; of a plant of somebody else, the belief as well."""
    if study.plant.external is None:
        return fitting_sensors(study.plant.vehicle, study.plant.tyre)
    published = set(study.plant.model().ports)
    fitting = fitting_sensors(study.belief.vehicle, study.belief.tyre)
    return [s for s in fitting if set(SENSORS.load(s).OUTPUTS.values()) <= published]


def applied(study: StudySpec, remedy: Remedy, estimator: str, tuning: Path | None = None) -> StudySpec:
    """Return a study with a remedy: the same points, drives and noise, one estimator, and what the report needs.

    Args:
        study: The study as it is.
        remedy: What is done.
        estimator: Name of the estimator.
        tuning: File with the noise that the estimator is tuned to; by default that of the study, if it is tuned there.

    Raises:
        UserError: If the remedy is not possible, such as a sensor whose noise nobody knows.
    """
    raw = StudyFile.model_validate(parse_toml(study.text, str(study.path)))
    plant: dict[str, Any] = {}
    belief: dict[str, Any] = {}
    if remedy.equipment is not None:
        plant["sensors"] = belief["sensors"] = remedy.equipment.sensors
        belief["unknown_inputs"] = list(remedy.equipment.unknown_inputs)
    spread = {f.parameter: prior(f) for f in parameters(study)}
    stated = raw.belief.model_dump(exclude_unset=True)
    estimated = (*remedy.estimated, *remedy.banked)
    for key, names in (("unknown_parameters", estimated), ("considered_parameters", remedy.considered)):
        if names:
            belief[key] = [*(stated.get(key) or []), *({"name": n, "prior": spread[n]} for n in names)]
    content = raw.model_dump(exclude_unset=True, exclude_none=True)
    content["name"] = f"{study.name}-{remedy.slug}"
    content["title"] = f"{study.title or study.name} Remedy: {remedy.words}"
    content["plant"] = {**content["plant"], **plant}
    content["belief"] = {**content.get("belief", {}), **belief}
    content["estimator"] = [t.model_dump(exclude_unset=True) for t in raw.estimator if name_of(t) == estimator]
    if remedy.banked:
        factors = {f.parameter: f for f in parameters(study)}
        bank = hypotheses([factors[n] for n in remedy.banked]) | {n: [factors[n].nominal] for n in remedy.estimated}
        content["estimator"] = [{"name": estimator, "kind": "imm", "hypotheses": bank}]
    if remedy.adapted:
        content["estimator"] = [{"name": estimator, "kind": remedy.adapted}]
    if remedy.amended:
        content["belief"]["parameters"] = content["plant"]["parameters"]
        content["belief"]["values"] = content["plant"].get("values", {})
    kept = [d for i, d in enumerate(raw.design) if i == 0 or d.sampling == "tolerance"]
    content["design"] = [d.model_dump(exclude_unset=True, exclude_none=True) for d in kept]
    for factor in (
        f for d in content["design"] for f in d.get("factor", []) if f["parameter"] in remedy.ideal_parameters
    ):
        factor["of"] = "both"
    for key in ("history", "report", "tuning"):
        content.pop(key, None)
    noise = next((e.noise for e in study.estimators if e.name == estimator and e.noise), None)
    if noise is not None:  # a file of tunings may have those of other estimators
        content["tuning"] = {"rule": study.tuning, "estimator": {estimator: dict(noise)}}
    if tuning is not None:
        content["tuning"] = as_table(tuning)  # a store names no place
    return build_study(content, study.path.parent / content["name"])


def name_of(table: EstimatorTable) -> str:
    """Return the name of an estimator in tables and figures."""
    return table.name or table.kind


def adapted() -> list[str]:
    """Return the filters that need no idea of what is wrong and may stand in place of the estimator (``REMEDY``)."""
    does = {kind: load_estimator(kind).REMEDY for kind in ESTIMATORS.names()}
    return sorted(filter(does.get, does), key=lambda kind: does[kind])


def singles(drivers: Sequence[str], considers: bool, tunable: bool) -> Iterator[Remedy]:
    """Return what can be done without a sensor: other noise, each driver alone and all together.

    Args:
        drivers: Parameters that drive the error, the strongest first.
        considers: Whether the estimator can consider parameters; only then a bank of such filters is tried.
        tunable: Whether the estimator believes noise, which can be tuned for the worst case.
    """
    if tunable:
        yield Remedy(tuned=True)
    for name in drivers:
        yield Remedy(estimated=(name,))
    if len(drivers) > 1:
        yield Remedy(estimated=tuple(drivers))
    if considers:
        yield Remedy(considered=tuple(drivers))
        if len(drivers) <= MOST_BANKED:
            yield Remedy(banked=tuple(drivers))
        for kind in adapted():
            yield Remedy(adapted=kind)


def pairs(drivers: Sequence[str], chosen: Sequence[Equipment], considers: bool) -> Iterator[Remedy]:
    """Return what can be done with sensors: each equipment alone, with the drivers estimated, considered, in a bank."""
    for equipment in chosen:
        yield Remedy(equipment=equipment)
        for name in drivers if len(drivers) > 1 else ():
            yield Remedy(estimated=(name,), equipment=equipment)
        yield Remedy(estimated=tuple(drivers), equipment=equipment)
        if considers:
            yield Remedy(considered=tuple(drivers), equipment=equipment)
            if len(drivers) <= MOST_BANKED:
                yield Remedy(banked=tuple(drivers), equipment=equipment)


def enlarged(remedy: Remedy, drivers: Sequence[str], banks: bool) -> list[Remedy]:
    """Return remedies that estimate one more of the drivers each, in the order of the drivers, but for all of them.

    Where none is banked, there are those that run a bank over one more in its place: what one filter does not find from
    far away, two do that begin near.

    Args:
        remedy: To be enlarged.
        drivers: Parameters that drive the error.
        banks: Whether a bank may stand in the place of the estimator.
    """
    estimated, banked = [], []
    for name in drivers:
        names = tuple(d for d in drivers if d in remedy.estimated or d == name)
        if name in remedy.banked or len(names) == len(remedy.estimated):
            continue
        if len(names) + len(remedy.banked) < len(drivers):
            estimated.append(replace(remedy, estimated=names))
        if banks and not remedy.banked:
            banked.append(replace(remedy, banked=(name,)))
    return estimated + banked


def promising(promise: dict[Equipment, float], count: int) -> list[Equipment]:
    """Return the equipments that promise most for what they need: none with as many signals or fewer tells more.

    Args:
        promise: What each leaves unknown of the parameters at best, over what is unknown at first.
        count: Largest number.
    """
    order = sorted(promise, key=lambda e: (len(e.added), promise[e]))
    front: list[Equipment] = []
    for equipment in order:
        if not front or promise[equipment] < 0.9 * promise[front[-1]]:
            front.append(equipment)
    return front[:count]


def main_design(study: StudySpec) -> DesignSpec:
    """Return the design whose factors drive the error.

    Raises:
        UserError: If it has none that an estimator could be unsure of.
    """
    if not parameters(study):
        raise UserError(
            f"{study.path}: design[0]: varies no parameter of the plant that an estimator could be unsure of; "
            "'harness remedy' needs a factor such as trailer_mass with of = \"plant\""
        )
    return study.designs[0]
