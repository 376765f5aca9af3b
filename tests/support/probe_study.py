"""A study of a few short runs, for tests of whoever runs studies, and the bits of a store."""

from harness.study.store import STORE
from support.small_study import EKF, SEMITRAILER

# Filters that follow the steering within these 20 s.
QUICK = SEMITRAILER.replace("ziaukas_2023", "ziaukas_2023_road_wheels")

STUDY = f"""
name = "probe"
title = "Does the runner keep its promises?"
seed = 0
targets = ["lateral_force_axle_21", "articulation_angle"]
{QUICK}{EKF}[[drive]]
name = "weave"
kind = "sine"
duration = 20
speed = 12
[[drive]]
name = "weave-fast"
kind = "sine"
duration = 20
speed = 18
frequency = "0.3 Hz"
[[design]]
name = "level"
repeats = 5
[[design.factor]]
parameter = "trailer_mass"
levels = ["8 t", "24 t"]
[[design]]
name = "band"
samples = 4
[[design.factor]]
parameter = "trailer_mass"
levels = ["24 t"]
band = "5 %"
[[history]]
design = "level"
levels = {{ trailer_mass = "8 t" }}
drive = "weave"
[[history]]
name = "as believed"
design = "level"
levels = {{ trailer_mass = "24 t" }}
drive = "weave"
signals = ["yaw_rate_tractor"]
"""


def bits(folder):
    """Return every file of a result folder's store by its path."""
    return {p.relative_to(folder / STORE): p.read_bytes() for p in sorted((folder / STORE).rglob("*")) if p.is_file()}
