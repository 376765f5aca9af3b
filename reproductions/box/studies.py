"""The dissertation's studies at one point of the box: one study with a design per section of chapter 5."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from harness.config import StudySpec, build_study
from harness.models.roles import PARAMETERS

SET = "ziaukas_2023"
NETWORK = "semitrailer_24t"
EKF, UKF, NARX = "EKF", "UKF", "NARX"
TARGETS = ("lateral_force_axle_21", "articulation_angle")

RAMPS, GROWING = "two-ramps", "growing-circle"

REPEATS = 8
"""Runs of each drive at each level: as many as a processor's lanes take at once."""

TYRE_SAMPLES = 8

DURATION = 60.0
"""s, of every drive."""


def parameters(at: Mapping[str, float]) -> dict[str, float]:
    """Return the vehicle's parameters at a point that differ from the set, SI."""
    stated = PARAMETERS.load(SET).VALUES
    shapes = {f"shape_factor_{axle}": at[f"shape_factor_{axle}"] for axle in ("11", "12", "2")}
    stiff = {f"stiffness_peak_{a}": at[f"stiffness_{a}"] * stated[f"stiffness_peak_{a}"] for a in ("11", "12", "2")}
    return {
        **shapes,
        **stiff,
        "stiffness_load_2": at["stiffness_load_2"] * stated["stiffness_load_2"],
        "relaxation_length_11": at["relaxation_tractor"],
        "relaxation_length_12": at["relaxation_tractor"],
        "relaxation_length_2": at["relaxation_trailer"],
        "trailer_inertia_scale": at["trailer_inertia_scale"],
        "constraint_rate": at["constraint_rate"],
    }


def noise(at: Mapping[str, float]) -> tuple[dict[str, float], dict[str, float]]:
    """Return the variances of process and measurement noise at a point, SI, the steering wheel's among the first."""
    published = PARAMETERS.load(SET)
    scale = at["noise_intensity"]
    process = {s: v * scale * at["process_noise"] for s, v in published.PROCESS_NOISE.items()}
    process["steering_wheel_angle"] = at["steering_variance"] * scale
    return process, {"yaw_rate_trailer": published.MEASUREMENT_NOISE["yaw_rate_trailer"] * scale}


def drives(at: Mapping[str, float]) -> list[dict[str, Any]]:
    """Return six drives of the described kinds (5.2.1, 5.3, 6.3.1): ramps, circles, sines, a roundabout."""
    pace, intensity, often = at["pace"], at["intensity"], at["frequency"]
    slow, fast = int(at["slow_drives"]), f"{60 * intensity / pace**2:.6g} deg"
    fixed: list[dict[str, Any]] = [
        {"name": RAMPS, "kind": "double_ramp", "speed": 5 * pace, "amplitude": f"{-250 * intensity:.6g} deg",
         "rate": "45 deg/s", "hold": 6.0, "pause": 4.0},
        {"name": GROWING, "kind": "ramp", "speed": 3 * pace, "rate": f"{8 * intensity:.6g} deg/s",
         "amplitude": f"{450 * intensity:.6g} deg"},
        {"name": "slow-sine", "kind": "sine", "speed": 5 * pace, "amplitude": f"{250 * intensity:.6g} deg",
         "frequency": 0.1 * often},
    ]  # fmt: skip
    # From the first on, as many as there are slow drives left over take the place of a faster one.
    faster: list[dict[str, Any]] = [
        {"name": "roundabout", "kind": "roundabout", "speed": 12 * pace, "turn_speed": 6 * pace, "radius": 18.0},
        {"name": "steady-circle", "kind": "steady_circle", "speed": 10 * pace, "radius": 45.0 / intensity},
        {"name": "fast-sine", "kind": "sine", "speed": 15 * pace, "amplitude": fast, "frequency": 0.3 * often},
    ]
    slower: list[dict[str, Any]] = [
        {"name": "tight-turn", "kind": "tight_turn", "speed": 2 * pace, "radius": 8.5 / intensity},
        {"name": "slow-circle", "kind": "steady_circle", "speed": 5 * pace, "radius": 18.0 / intensity},
        {"name": "slower-sine", "kind": "sine", "speed": 3 * pace, "amplitude": f"{400 * intensity:.6g} deg",
         "frequency": 0.06 * often},
    ]  # fmt: skip
    chosen = fixed + slower[: slow - 3] + faster[slow - 3 :]
    return [{**drive, "duration": DURATION, "lateral_acceleration_limit": 20.0} for drive in chosen]


def study_at(at: Mapping[str, float], network: str = NETWORK) -> StudySpec:
    """Return the dissertation's studies at a point.

    Args:
        at: Values by factor, see ``factors.settings``.
        network: Name or file of the network.
    """
    process, measurement = noise(at)
    plant_noise = {k: v for k, v in process.items() if k != "steering_wheel_angle"}
    finer = {"integrator": "rk4", "substeps": 2} if at["finer_plant"] else {}
    tyres = ("shape_factor_2", "stiffness_peak_2", "stiffness_load_2", "relaxation_length_2")
    return build_study(
        {
            "name": "reproduce-box",
            "title": "The studies of the dissertation at a point of what it does not publish",
            "seed": 20230109,
            "targets": list(TARGETS),
            "drive": drives(at),
            "plant": {
                "vehicle": "semitrailer",
                "parameters": SET,
                "tyre": "magic_formula",
                "sensors": "series",
                "values": parameters(at),
                "noise": {"process": plant_noise, "measurement": measurement},
                **finer,
            },
            "belief": {
                "integrator": "euler",
                "substeps": 1,
                "unknown_inputs": ["steering_wheel_angle"],
                "noise": {"process": process, "measurement": measurement},
            },
            "estimator": [
                {"name": EKF, "kind": "ekf"},
                {"name": UKF, "kind": "ukf"},
                {"name": NARX, "kind": "narx", "network": network},
            ],
            "design": [
                {"name": "ideal", "repeats": REPEATS},
                _levels("process-noise", "process_noise_scale", [10, 0.1, 0.001]),
                _levels("mass", "trailer_mass", ["8 t", "32 t"]),
                _levels("cog", "trailer_cog_from_rear", ["-2 m", "2 m"], "shift"),
                _levels("friction", "friction", [0.5, 0.6, 1.1]),
                {
                    "name": "tyre",
                    "samples": TYRE_SAMPLES,
                    "sobol_any_n": True,
                    "factor": [{"parameter": p, "bands": ["0 %", "10 %", "20 %", "30 %"]} for p in tyres],
                },
            ],
            "history": [{"design": "ideal", "drive": RAMPS}],
        },
        path=f"the box of {SET}",
    )


def _levels(name: str, parameter: str, levels: list[Any], key: str = "levels") -> dict[str, Any]:
    return {"name": name, "repeats": REPEATS, "factor": [{"parameter": parameter, key: levels}]}
