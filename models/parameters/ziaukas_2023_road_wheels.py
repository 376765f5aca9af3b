"""The set ``ziaukas_2023`` with the other reading of its steering noise, as a variance of the road wheels' angle.

(5.3) prints the last variance, 1e-5, without a unit. Here it is taken for the angle of the road wheels, which makes it
1e-5 rad^2 times the steering ratio squared at the steering wheel. Everything else is that set's.
"""

from harness.models.parameters import ziaukas_2023

VEHICLE = ziaukas_2023.VEHICLE

VALUES: dict[str, float] = dict(ziaukas_2023.VALUES)

NOISE_STEP = ziaukas_2023.NOISE_STEP

PROCESS_NOISE: dict[str, float] = {
    **ziaukas_2023.PROCESS_NOISE,
    "steering_wheel_angle": ziaukas_2023.PROCESS_NOISE["steering_wheel_angle"] * VALUES["steering_ratio"] ** 2,
}

MEASUREMENT_NOISE: dict[str, float] = dict(ziaukas_2023.MEASUREMENT_NOISE)
