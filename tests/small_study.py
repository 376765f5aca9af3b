"""The text of a small study, for tests of how study files are read."""

STUDY = """\
name = "small"
title = "A question?"
seed = 0
targets = ["lateral_force_axle_21", "articulation_angle"]

[plant]
vehicle = "semitrailer"
parameters = "ziaukas_2023"
tyre = "magic_formula"
sensors = "series"

[belief]
unknown_inputs = ["steering_wheel_angle"]

[[drive]]
name = "sine"
kind = "sine"

[[estimator]]
name = "EKF"
kind = "ekf"

[[design]]
name = "level"
repeats = 2
[[design.factor]]
parameter = "trailer_mass"
levels = ["8 t", "24 t", "32 t"]
"""
