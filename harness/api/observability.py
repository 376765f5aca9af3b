"""``harness.observability``: can the states of a model be determined from its measurements?"""

from __future__ import annotations

from typing import TYPE_CHECKING

from harness.api.drive import Drive
from harness.api.model import Model

if TYPE_CHECKING:
    import xarray as xr


def observability(model: Model, drive: Drive | None = None) -> xr.Dataset:
    """Check structural observability along a drive (docs/observability.md).

    Args:
        model: What an estimator believes, with its unknown inputs and parameters.
        drive: Straight, a sine and straight again by default.

    Returns:
        Dataset over ``time`` (s): ``connected`` (states with a path to an output), ``rank`` (structural), each with the
        number ``required`` in its attributes, ``observable`` (both met), ``output_connected (time, state)``. With
        unknown parameters also ``std (time, parameter)``, the smallest standard deviation possible, and
        ``correlation (parameter, other)`` at the end.

    Raises:
        UserError: If the drive does not fit.
        ModelError: If the drive asks for too much lateral acceleration.

    Example:
        >>> import harness as h
        >>> car = h.model("car", "govindarajan_2018", sensors="car_series")
        >>> criteria = h.observability(car, h.drive("sine", duration="5 s", amplitude="20 deg"))
        >>> int(criteria["rank"].max()), criteria["rank"].attrs["required"]
        (2, 2)
    """
    from harness.estimation.information import parameter_information
    from harness.estimation.observability import structural_observability, synthetic_manoeuvre
    from harness.simulation.drives import profile_of

    spec = model.spec
    profile = synthetic_manoeuvre() if drive is None else profile_of(spec, drive)
    criteria = structural_observability(spec.model(), spec.values, profile)
    return criteria.merge(parameter_information(spec, profile)) if spec.parameter_states else criteria
