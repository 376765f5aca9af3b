"""Contracts of the files in each folder of ``models/``: their exports, and the small records in these.

The folder is the registry: the stem of a file is its name in a study. Nothing here lists names.

==============  =========================================================================================
folder          exports
==============  =========================================================================================
``vehicles``    ``STATES``, ``INPUTS``, ``PARAMETERS``, ``AXLES``, ``VALID``, ``equations(v)``
``tyres``       ``PARAMETERS``, ``lateral_force(t)``
``effects``     ``PORT``, ``READS``, ``PARAMETERS``, ``STATES``, ``apply(e, value)``
``sensors``     ``OUTPUTS``
``degradations`` ``PARAMETERS``, ``degrade(readings)``
``parameters``  ``VEHICLE``, ``VALUES``, ``PROCESS_NOISE``, ``MEASUREMENT_NOISE``, ``NOISE_STEP``; ``STD``, ``TYRE``
``drives``      ``OPTIONS``, ``generate(options, context)``
==============  =========================================================================================

Files outside this tree keep the same contract (``docs/plugins.md``). A vehicle, tyre, effect or set of sensors brings
the signals that there are not yet as ``SIGNALS``, a tuple of ``harness.models.signals.Signal``, and a vehicle may say
by ``AXLE_NAMES`` what each of its axles is; the signals of its axles and bodies follow from their names.

A vehicle with inputs that no drive states exports ``drive_inputs(profile, context)``, their values on a drive by
name, and one whose estimators begin with another variance than the process noise of a step, ``START_VARIANCE`` by
state.

In addition to these a vehicle may export ``wheelbase(values)`` for the limits of the drives, ``check(values)`` for
values that are impossible together, and ``START``: the first value of a state that does not start at zero, as a
number, the name of a parameter, or the name of a drive's input (its first sample). A vehicle that carries a load may
export ``LOADING``, quantities of the load (``Parameter``) from which several of its parameters follow together,
``loading(values)``, the load of given parameters, and ``loaded(values, load)``, the parameters that follow, both of
numbers, arrays and SymPy expressions. A vehicle
of several bodies exports ``BODIES``, the axles of each, the steered one first. Where axles stand follows from the
equations; one that knows how far its bodies reach exports ``outline(values)``: by body, where it ends behind (negative)
and ahead of its CoG and its width, in m. A vehicle with several sets of
parameters or sensors that fit exports ``USUAL``, which of them a command takes if none is named:
``{"parameters": ..., "sensors": ...}``.

A tyre whose cornering stiffness is in proportion to one of its parameters exports the name as ``STIFFNESS``; studies
vary the stiffness of an axle by it. A parameter set whose values belong to one tyre exports that as ``TYRE``.

A degradation of sensors is named among the effects of a plant, ``dropout`` for all sensors or ``dropout@yaw_rate``. It
has no equations: it changes the readings of a simulated drive (``Readings``), and no estimator can believe in it.

An effect whose parameters belong to a body, an axle, a tyre or a measured output exports ``PLACE``
(``models/assembly/placement.py``); one whose state is a random process exports ``NOISE``, its variance per second by
state. One that happens in a drive and stays may also have happened before it, and exports ``STAYS = True``.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from harness.common.arrays import Floats

DRIVE_INPUTS: tuple[str, ...] = ("steering_wheel_angle", "speed")
"""What a drive states over time; a vehicle's first state may be taken from it."""


@dataclass(frozen=True)
class Readings(ABC):
    """Readings of one sensor in runs that are simulated side by side, as a degradation gets them.

    Random numbers are the same however runs are grouped, and independent of those of other streams.

    Attributes:
        values: ``(..., samples, lanes)`` in SI units, NaN where missing.
        noise: The white noise that is in them, same shape.
        deviation: Standard deviation of that noise ``(..., 1, lanes)``.
        step: Sample time in s.
    """

    values: Floats
    noise: Floats
    deviation: Floats
    step: float

    @property
    def samples(self) -> Floats:
        """Number of each sample from 0 on ``(samples, 1)``."""
        return np.arange(self.values.shape[-2], dtype=float)[:, None]

    @property
    def lanes(self) -> int:
        """Runs side by side."""
        return int(self.values.shape[-1])

    @abstractmethod
    def p(self, name: str) -> Floats:
        """Return a parameter of the degradation in each run ``(..., 1, lanes)``."""

    @abstractmethod
    def normal(self, stream: str, shared: bool = False) -> Floats:
        """Return standard normal numbers of a run ``(..., samples, lanes)``; if shared, the same for all sensors."""

    @abstractmethod
    def uniform(self, stream: str) -> Floats:
        """Return numbers as ``normal`` does, evenly distributed from 0 to 1."""

    @abstractmethod
    def gamma(self, stream: str, shape: Floats) -> Floats:
        """Return numbers as ``normal`` does of the gamma distribution of a shape ``(..., 1, lanes)`` and unit scale."""


@dataclass(frozen=True)
class Parameter:
    """A physical parameter of a vehicle, tyre or effect.

    Attributes:
        name: Word used in studies and parameter files, e.g. ``trailer_mass``.
        symbol: LaTeX symbol of the source, e.g. ``m_2``.
        unit: SI unit as pint reads it, e.g. ``kg``.
        lower: Smallest physically meaningful value; values below it are refused.
        upper: Largest physically meaningful value.
        meaning: One sentence.
        neutral: For an effect's parameter: the value at which the effect is absent.
        shared: Of an effect with places: one parameter for all of them.
        grid: Values to start from where the likelihood says nothing about the parameter at the neutral value of
            the effect, or has several maxima.
        natural: Of what is far from usual where it is so at all, an axle that is up or a road that is wet: values that
            it has then. The likelihood about the neutral value says little of them, so a fit starts there as well
            before anything implausible is believed.
        per_drive: A time in a drive: each drive has its own, searched over its duration.
        numerical: Of how the equations are solved, not of the vehicle: no measurement determines it.
        late: Input whose channel is late by so much, in s, where the parameter is negative. What has a whole recording
            reads that input ahead, because no equation of the past follows what is to come.
    """

    name: str
    symbol: str
    unit: str
    lower: float
    upper: float
    meaning: str
    neutral: float | None = None
    shared: bool = False
    grid: tuple[float, ...] = ()
    natural: tuple[float, ...] = ()
    per_drive: bool = False
    numerical: bool = False
    late: str = ""


@dataclass(frozen=True)
class Option:
    """A setting of a drive, given in a study as a number in SI units or as text with a unit.

    Attributes:
        name: Key in the study file.
        unit: SI unit (pint); ``""`` for a plain number, ``"text"`` for a string such as a file name.
        default: Value when the key is absent; ``None`` makes the key required.
        lower: Smallest value allowed (ignored for text).
        upper: Largest value allowed (ignored for text).
        meaning: One sentence.
    """

    name: str
    unit: str
    default: Any
    lower: float
    upper: float
    meaning: str


@dataclass(frozen=True)
class DriveContext:
    """What a drive may know about the vehicle that will drive it, and how it will be sampled.

    Attributes:
        wheelbase: Wheelbase of the steered (leading) body in m.
        steering_ratio: Steering-wheel angle over road-wheel angle.
        step: Sample time in s.
        base: Folder against which relative file names are resolved.
        understeer_gradient: Returns that of the vehicle in rad s^2/m; 0 where nobody knows it.
        read: Reads a recording by path into columns of shape ``(samples,)``; the harness provides it, because
            models read no files.
    """

    wheelbase: float
    steering_ratio: float
    step: float = 0.01
    base: str = "."
    understeer_gradient: Callable[[], float] = float
    read: Callable[[str], dict[str, Floats]] | None = None


@dataclass(frozen=True)
class Profile:
    """A drive: the driver's inputs over time, all of shape ``(samples,)``.

    Attributes:
        time: s, equidistant, starting at 0.
        steering_wheel_angle: rad, positive to the left (ISO 8855).
        speed: m/s, longitudinal speed of the body the vehicle takes its speed from.
        notes: What may be said of how the drive came about.
        further: Inputs of the vehicle that drives it, by name, that follow from the drive (its ``drive_inputs``).
    """

    time: Floats
    steering_wheel_angle: Floats
    speed: Floats
    notes: dict[str, str] = field(default_factory=dict)
    further: dict[str, Floats] = field(default_factory=dict)
