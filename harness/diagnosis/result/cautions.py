"""What a reader of a trace has to know before the answer: fits that ended at a bound, models that cannot be driven."""

from __future__ import annotations

import math

from harness.diagnosis.fitting.fit import Fitted
from harness.diagnosis.selection.forward_selection import Trace
from harness.identification.uncertainty import at_bound
from harness.models.quantities import print_unit, words
from harness.reporting import style


def cautions(trace: Trace) -> tuple[str, ...]:
    """Return the sentences."""
    found = [*_bounds("the refitted nominal model", trace.nominal)]
    if trace.added:
        found += _bounds("the final model", trace.final)
    driveable, stated = trace.fitting.driveable, trace.fitting.first().values[:, 0]
    models = {"stated": stated, "refitted nominal": trace.nominal.point.values[:, 0]}
    if trace.added:
        models["final"] = trace.final.point.values[:, 0]
    for name, values in models.items():
        speed = driveable.unstable_from(values)
        if math.isfinite(speed):
            text = style.with_unit(speed, "m/s")
            found.append(f"The {name} model is unstable straight ahead at {text}, which was driven.")
    return tuple(dict.fromkeys(found))


def _bounds(what: str, fitted: Fitted) -> list[str]:
    found = []
    for c in fitted.coordinates:
        value = fitted.point.value(c)
        if c.drives or not (side := at_bound(c.coordinate(value), c.lower, c.upper)):
            continue
        which, unit = "lower" if side < 0 else "upper", print_unit(c.unit)
        found.append(
            f"The fit of {what} ends at the {which} bound of the {words(c.name)}, {style.with_unit(value, unit)}; the "
            "true value may lie beyond it, or something else is wrong."
        )
    return found
