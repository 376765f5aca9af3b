"""Texts of small studies: what those of the tests share, and one for tests of how study files are read."""

SEMITRAILER = """\
[plant]
vehicle = "semitrailer"
parameters = "ziaukas_2023"
tyre = "magic_formula"
sensors = "series"

[belief]
unknown_inputs = ["steering_wheel_angle"]

"""
EKF = """\
[[estimator]]
name = "EKF"
kind = "ekf"

"""
STUDY = f"""\
name = "small"
title = "A question?"
seed = 0
targets = ["lateral_force_axle_21", "articulation_angle"]

{SEMITRAILER}[[drive]]
name = "sine"
kind = "sine"

{EKF}[[design]]
name = "level"
repeats = 2
[[design.factor]]
parameter = "trailer_mass"
levels = ["8 t", "24 t", "32 t"]
"""
