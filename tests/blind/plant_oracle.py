"""The truth in the words of the effect library, for a scoring that fits the true structure.

Where the library's equation has another form than the plant's, its parameter is the one that comes closest for small
values, and the effect is named in ``SIMILAR``; a scoring should not judge those values.
"""

from __future__ import annotations

from plant_cases import Drawn
from plant_environment import Changes
from plant_equations import Car, Semitrailer
from plant_sensors import ROLL_FREQUENCY

SIMILAR = (
    "combined_slip",
    "lateral_load_transfer",
    "road_bank_varying",
    "roll_steer",
    "self_steering_axle",
    "steering_ratio_nonlinear",
    "tyre_saturation",
)
"""Effects whose equation differs in form from the library's."""

QUICK_ROLL = 30.0
"""rad/s; the library's body rolls behind its acceleration, the plant's at once."""

_SENSORS = {
    "bias": "sensor_bias",
    "gain_error": "sensor_gain_error",
    "gain_loss_per_speed": "sensor_speed_loss",
    "sensor_delay": "sensor_delay",
    "lever_arm": "sensor_lever_arm",
    "misalignment": "sensor_misalignment",
    "roll_per_acceleration": "roll_gain",
}
_SAME_NAME = {
    "bank": "road_bank",
    "steering_compliance": "steering_compliance",
    "lag": "steering_lag",
    "delay": "steering_delay",
    "kingpin_dry_moment": "kingpin_friction",
    "kingpin_damping": "kingpin_damping",
    "yaw_control": "yaw_control_gain",
    "gust_force": "crosswind_force",
    "gust_moment": "crosswind_moment",
    "gust_force_tractor": "crosswind_force_tractor",
    "gust_force_trailer": "crosswind_force_trailer",
    "gust_moment_tractor": "crosswind_moment_tractor",
    "gust_moment_trailer": "crosswind_moment_trailer",
    "cog_height": "longitudinal_transfer_height",
    "tractor_cog_height": "longitudinal_transfer_height_tractor",
    "trailer_cog_height": "longitudinal_transfer_height_trailer",
    "slosh_frequency": "slosh_frequency_trailer",
    "payload_shift": "payload_shift_trailer",
}


def library_values(effect: Drawn, p: Semitrailer | Car) -> dict[str, float]:
    """Return the library's parameters of an effect; empty where it has none for it.

    Args:
        effect: As drawn; its ``place`` is an axle for a tyre's force offset.
        p: True parameters of the vehicle.
    """
    found: dict[str, float] = {}
    ends = ("11", "12", "2") if isinstance(p, Semitrailer) else ("front", "rear")
    for key, value in effect.values.items():
        name, _, channel = key.partition("@")
        if channel:
            body = channel.removeprefix("lateral_acceleration")
            place = body if name == "roll_per_acceleration" else f"_{channel}"
            found[_SENSORS[name] + place] = value
            if name == "roll_per_acceleration":
                found[f"roll_frequency{place}"] = ROLL_FREQUENCY
        elif name in _SAME_NAME:
            found[_SAME_NAME[name]] = value
        elif name in ("offset", "play"):
            library = {"offset": "steering_offset", "play": "steering_backlash"}[name]
            found[library] = value / p.steering_ratio
        elif name == "steering_ratio":
            found["steering_ratio_error"] = value / type(p)._field_defaults[name] - 1.0
        elif name == "lift":  # the library compares with the other axles, which take what this one gives up
            found["axle_lift_21"] = 1.0 - (1.0 - value) / (1.0 + value / 2.0)
        elif name == "stiffness_drift":
            found.update({f"stiffness_drift_{end}": value for end in ends})
        elif name == "relaxation_length":
            found.update({f"tyre_relaxation_{end}": value for end in ends})
        elif name == "inverse_friction":
            found.update({f"inverse_friction_{end}": value for end in ends})
        elif name == "transfer_loss":
            found.update({f"lateral_transfer_loss_{end}": value for end in ends})
        elif name.startswith("force_offset_"):
            found["tyre_force_offset_" + name.removeprefix("force_offset_")] = value
        elif name.startswith("roll_steer"):
            found[f"roll_steer_{ends[-1]}"] = -value  # the library's is positive into the bend
            found[f"roll_steer_frequency_{ends[-1]}"] = QUICK_ROLL
        elif name == "side_force_slope":
            found["aerodynamic_side_force" + ("_trailer" if isinstance(p, Semitrailer) else "")] = value
        elif name == "slosh_mass" and isinstance(p, Semitrailer):
            found["slosh_share_trailer"] = value / p.trailer_mass
            found["slosh_damping_trailer"] = p.slosh_damping
        elif name == "friction_drop" and isinstance(p, Semitrailer):
            found["friction_change"] = -value * p.friction
    if effect.name == "yaw_moment_control":
        found["yaw_control_speed"] = 25.0
    return found


def library_times(effect: Drawn, changes: Changes) -> dict[str, float]:
    """Return the library's change times of an effect on one drive, in s."""
    return {
        "crosswind": {"crosswind_onset": changes.gust_begin, "crosswind_end": changes.gust_end},
        "friction_change": {"friction_change_time": changes.friction},
        "payload_shift": {"payload_shift_time": changes.payload},
    }.get(effect.name, {})
