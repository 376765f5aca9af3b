"""Names, units and frames of what an exported estimator gets and gives, as C identifiers."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace

from harness.common.errors import UserError
from harness.engine.c99.functions import RESERVED
from harness.engine.compile import CompiledModel
from harness.models.signals import signal_attributes


@dataclass(frozen=True)
class Quantity:
    """A number that goes in or comes out.

    Attributes:
        name: Word used in studies.
        field: C identifier.
        says: Unit, frame or bounds, and meaning.
        value: What the study believes, of what it states.
        lower, upper: What a parameter may be.
    """

    name: str
    field: str
    says: str
    value: float | None = None
    lower: float = -math.inf
    upper: float = math.inf

    @property
    def unit(self) -> str:
        """Unit, 1 of what has none."""
        return self.says.split(";")[0]


@dataclass(frozen=True)
class Interface:
    """All quantities of an estimator, in the order of the arrays of its kernels.

    Attributes:
        inputs, measurements, estimates, states: Signals.
        parameters: Of the vehicle.
    """

    inputs: tuple[Quantity, ...]
    measurements: tuple[Quantity, ...]
    estimates: tuple[Quantity, ...]
    states: tuple[Quantity, ...]
    parameters: tuple[Quantity, ...]


def interface_of(compiled: CompiledModel, values: Sequence[float]) -> Interface:
    """Return the quantities of an estimator.

    Args:
        compiled: What it believes.
        values: Of its parameters.
    """
    model = compiled.model
    groups = (model.inputs, model.outputs, compiled.signal_names, model.states)
    inputs, measurements, estimates, states = map(of_signals, groups)
    return Interface(inputs, measurements, estimates, states, of_parameters(compiled, values))


def of_signals(names: Iterable[str]) -> tuple[Quantity, ...]:
    """Return the quantities that signals are."""
    return _quantities((n, _of_signal(n)) for n in names)


def of_parameters(compiled: CompiledModel, values: Sequence[float]) -> tuple[Quantity, ...]:
    """Return the quantities that the parameters of a model are, with their values and bounds."""
    declared = compiled.model.parameters
    says = [_joined(p.unit, f"{p.lower:g} to {p.upper:g}", p.meaning) for p in declared]
    named = _quantities(zip([p.name for p in declared], says, strict=True), values)
    return tuple(replace(q, lower=p.lower, upper=p.upper) for q, p in zip(named, declared, strict=True))


def _of_signal(name: str) -> str:
    about: Mapping[str, str] = signal_attributes(name)
    return _joined(about["units"], f"frame {about['frame']}" if about["frame"] else "", about["long_name"])


def _joined(unit: str, between: str, meaning: str) -> str:
    parts = [unit or "1", between, meaning]
    return "; ".join(part for part in parts if part).replace("*/", "* /")


def _quantities(described: Iterable[tuple[str, str]], values: Sequence[float] = ()) -> tuple[Quantity, ...]:
    """Return quantities with fields that no two share."""
    taken: set[str] = set()
    quantities = []
    for place, (name, says) in enumerate(described):
        field = re.sub(r"\W+", "_", name, flags=re.ASCII)
        field = f"n_{field}" if field[:1].isdigit() else field
        while field in taken or field in RESERVED:
            field += "_"
        taken.add(field)
        quantities.append(Quantity(name, field, says, float(values[place]) if len(values) else None))
    return tuple(quantities)


_OWN = """acceptable advance bare belief callbacks cells column_of count enter_initialization estimator
    exit_initialization follow given instance instantiated kept line lines main memory model none number phase place
    read_line refused restart restored results room say step steps time_of values variables written"""
TAKEN = RESERVED.union(_OWN.split())
"""Names that what comes with an estimator has itself."""

_LIBRARY = """abort abs acos acosh asin asinh assert atan atan2 atanh atexit atof atoi atol bsearch calloc cbrt
    ceil clearerr clock copysign cos cosh div erf erfc exit exp exp2 expm1 fabs fclose fdim feof ferror fflush
    fgetc fgets floor fma fmax fmin fmod fopen fprintf fputc fputs fread free freopen frexp fscanf fseek ftell
    fwrite getc getchar getenv gets hypot ilogb isfinite isinf isnan isnormal labs ldexp ldiv lgamma llabs log
    log10 log1p log2 logb lrint lround malloc memchr memcmp memcpy memmove memset modf nan nearbyint perror pow
    printf putc putchar puts qsort raise rand random read realloc remainder remove remquo rename rewind rint
    round scalbn scanf select setbuf signal signbit sin sinh snprintf sprintf sqrt srand sscanf strcat strchr
    strcmp strcpy strlen strncmp strtod strtof strtol strtoul system tan tanh tgamma time tmpfile tmpnam trunc
    ungetc write FILE NULL NAN INFINITY EOF size_t ptrdiff_t wchar_t int8_t int16_t int32_t int64_t uint8_t
    uint16_t uint32_t uint64_t intptr_t uintptr_t stdin stdout stderr errno asm catch class constexpr delete
    explicit export friend mutable namespace new operator private protected public template this throw try
    typename using virtual"""
OF_THE_LIBRARY = frozenset(_LIBRARY.split())
"""Names of the library of C, and words of C++, which may include a header as well."""


def name_in_c(stated: str | None, otherwise: str) -> str:
    """Return the name that everything of an export begins with.

    Args:
        stated: As the user wants it; ``None`` for one of ours.
        otherwise: What ours is made of.

    Raises:
        UserError: If the stated one is none that C could have.
    """
    if stated is None:
        return identifier(otherwise)
    if not re.fullmatch(r"[A-Za-z]\w*", stated, flags=re.ASCII):
        raise UserError(
            f"--name '{stated}': has to begin with a letter and to have letters, digits and _ only; "
            f"'{identifier(stated)}' would do"
        )
    if stated in TAKEN | OF_THE_LIBRARY:
        raise UserError(f"--name '{stated}': C or what is printed has a name like it; '{identifier(stated)}' would do")
    return stated


def identifier(name: str) -> str:
    """Return a name as a C identifier, for what is printed."""
    word = re.sub(r"\W+", "_", name, flags=re.ASCII).strip("_").lower()
    word = f"n_{word}" if word[:1].isdigit() else word
    return f"{word}_filter".strip("_") if word in TAKEN | OF_THE_LIBRARY or not word else word
