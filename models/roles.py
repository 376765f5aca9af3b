"""The roles that parts of a model play, and what a file of each must define (``contracts`` says what it is).

Packages are named here and nowhere else, not imported: files of most roles use what finds the files of others.
"""

from __future__ import annotations

from types import ModuleType

from harness.common.errors import ModelError
from harness.common.registry import Role


class SensorRole(Role):
    """Sets of sensors, of which a list of signals is one as well."""

    def load(self, name: str, exports: tuple[str, ...] | None = None) -> ModuleType:
        """Import a set of sensors, or compose it of the signals that its name lists.

        Args:
            name: Of a file, or the signals with commas between them.
            exports: Names the file must define; by default those of the role.

        Raises:
            ModelError: If there is no set of that name, with the closest ones, or a list has gaps. Whether a vehicle
                publishes what is listed shows where the model is assembled.
        """
        signals = [part.strip() for part in name.split(",")]
        alone = len(signals) == 1 and (name in self.components() or name not in self._measured())
        return super().load(name, exports) if alone else self._composed(name, signals)

    def _measured(self) -> dict[str, str]:
        """Return what the files measure: each output with the signal of the vehicle that it is."""
        signals: dict[str, str] = {}
        for name in self.names():
            for output, signal in super().load(name).OUTPUTS.items():
                signals.setdefault(output, signal)
        return signals

    def _composed(self, name: str, signals: list[str]) -> ModuleType:
        measured = self._measured()
        for i, signal in enumerate(signals):
            if not signal:
                raise ModelError(f"sensors '{name}': there is no signal before or behind a comma; remove it")
            if signal in signals[:i]:
                raise ModelError(f"sensors '{name}': '{signal}' is named twice; remove one")
        module = ModuleType(f"sensors of {name}", f"The sensors of {', '.join(signals)}.")
        vars(module)["OUTPUTS"] = {signal: measured.get(signal, signal) for signal in signals}
        return module


VEHICLES = Role(
    f"{__package__}.vehicles",
    "vehicle",
    ("STATES", "INPUTS", "PARAMETERS", "AXLES", "VALID", "equations"),
    word="vehicles",
)
TYRES = Role(f"{__package__}.tyres", "tyre", ("PARAMETERS", "lateral_force"), word="tyres")
EFFECTS = Role(f"{__package__}.effects", "effect", ("PORT", "READS", "PARAMETERS", "STATES", "apply"), word="effects")
SENSORS = SensorRole(f"{__package__}.sensors", "sensor", ("OUTPUTS",), word="sensors")
DEGRADATIONS = Role(
    f"{__package__}.degradations", "degradation of sensors", ("PARAMETERS", "degrade"), word="degradations"
)
PARAMETERS = Role(
    f"{__package__}.parameters",
    "parameter",
    ("VEHICLE", "VALUES", "PROCESS_NOISE", "MEASUREMENT_NOISE", "NOISE_STEP"),
    word="parameters",
)
DRIVES = Role(f"{__package__}.drives", "drive", ("OPTIONS", "generate"), word="drives")

ROLES = {role.word: role for role in (VEHICLES, TYRES, EFFECTS, SENSORS, DEGRADATIONS, PARAMETERS, DRIVES)}
"""By the word that commands use for it."""
