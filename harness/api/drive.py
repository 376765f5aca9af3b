"""``harness.drive``: steering and speed over time, as ``[[drive]]`` of a study states them."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from harness.api._show import Shown
from harness.config import DriveSpec, single_drive

if TYPE_CHECKING:
    import xarray as xr

    from harness.api.model import Model


def drive(kind: str, name: str | None = None, **options: float | str) -> Drive:
    """Return a drive.

    Args:
        kind: Kind of drive (``harness list drives``); ``from_file`` takes steering and speed from a file.
        name: Unique name within a study; the kind by default.
        options: Options of the kind (``harness list drives <kind>``): numbers in SI units, or text with a unit.

    Returns:
        The drive, its options known; their units and bounds are checked where it is driven.

    Raises:
        UserError: If there is no such kind, or it has no such option or needs another one.

    Example:
        >>> import harness as h
        >>> h.drive("sine", speed="20 m/s", duration="10 s")
        Drive 'sine'
          kind: sine
          speed: 20 m/s
          duration: 10 s
    """
    name = kind if name is None else name
    return Drive(**vars(single_drive({**options, "name": name, "kind": kind}, f"drive '{name}'")))


class Drive(Shown, DriveSpec):
    """A drive; made by ``harness.drive``.

    Attributes:
        name: Its name in a study.
        kind: Kind of drive.
        options: Options that were stated.
    """

    def table(self) -> dict[str, Any]:
        """Return the drive by the keys of ``[[drive]]`` in a study file."""
        return {"name": self.name, "kind": self.kind, **self.options}

    def profile(self, model: Model) -> xr.Dataset:
        """Return what a vehicle drives.

        Args:
            model: The vehicle; its wheelbase and steering ratio limit the drive, its step is that of the time.

        Returns:
            Dataset over ``time`` (s) with ``steering_wheel_angle`` (rad), ``speed`` (m/s) and the vehicle's further
            inputs, each with ``units`` and ``long_name``.

        Raises:
            UserError: If an option is out of bounds or of the wrong unit, or a recording cannot be read.
            ModelError: If the drive cannot be made from these options, or asks for too much lateral acceleration.

        Example:
            >>> import harness as h
            >>> car = h.model("car", "govindarajan_2018", sensors="car_series")
            >>> profile = h.drive("sine", duration="10 s", amplitude="20 deg").profile(car)
            >>> dict(profile.sizes), profile.speed.attrs["units"]
            ({'time': 1001}, 'm/s')
        """
        import xarray as xr

        from harness.models.signals import signal_attributes
        from harness.simulation.drives import profile_of

        profile = profile_of(model.spec, self)
        columns = {"steering_wheel_angle": profile.steering_wheel_angle, "speed": profile.speed, **profile.further}
        return xr.Dataset(
            {name: ("time", values, signal_attributes(name)) for name, values in columns.items()},
            coords={"time": ("time", profile.time, signal_attributes("time"))},
            attrs={"name": self.name, "kind": self.kind},
        )

    def _facts(self) -> dict[str, Any]:
        return {"kind": self.kind, **self.options}

    def _title(self) -> str:
        return f"Drive '{self.name}'"
