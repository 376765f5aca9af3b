"""The roles that parts of a model play, and what a file of each must define (``contracts`` says what it is).

Packages are named here and nowhere else, not imported: files of most roles use what finds the files of others.
"""

from __future__ import annotations

from harness.common.registry import Role
from harness.models.sensor_sets import SensorRole

VEHICLES = Role(
    f"{__package__}.vehicles",
    "vehicle",
    ("STATES", "INPUTS", "PARAMETERS", "AXLES", "VALID", "equations"),
    word="vehicles",
)
TYRES = Role(f"{__package__}.tyres", "tyre", ("PARAMETERS", "lateral_force"), word="tyres")
EFFECTS = Role(f"{__package__}.effects", "effect", ("PORT", "READS", "PARAMETERS", "STATES", "apply"), word="effects")
SENSORS = SensorRole(f"{__package__}.sensors", "sensor", ("OUTPUTS",), word="sensors")
PARAMETERS = Role(
    f"{__package__}.parameters",
    "parameter",
    ("VEHICLE", "VALUES", "PROCESS_NOISE", "MEASUREMENT_NOISE", "NOISE_STEP"),
    word="parameters",
)
DRIVES = Role(f"{__package__}.drives", "drive", ("OPTIONS", "generate"), word="drives")

ROLES = {role.word: role for role in (VEHICLES, TYRES, EFFECTS, SENSORS, PARAMETERS, DRIVES)}
"""By the word that commands use for it."""
