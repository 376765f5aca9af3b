"""Effect of estimating or considering the trailer's mass: the tables of docs/remedy.md.

    python bench/remedy.py estimated    # error against the one with the mass known, after 60 s of excited driving
    python bench/remedy.py considered   # share of samples with the true value inside the stated 95 % band
    python bench/remedy.py unweighed    # the same if nothing is linearised in the mass
    python bench/remedy.py straight     # what ten minutes straight ahead do to an estimated mass
    python bench/remedy.py steering     # a considered mass with the steering unknown, by the steering's believed noise
    python bench/remedy.py particles    # the particle filter of the mass study, by the steering's believed noise
    python bench/remedy.py bank         # a bank of filters over the mass, on and between its hypotheses
    python bench/remedy.py alternatives # particles of the mass, and a moving horizon

Every estimator sees the same drives and noise. Settings stand below; numbers come out in a table of Markdown.
"""

from __future__ import annotations

import argparse
import dataclasses
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from harness.common.arguments import Parser
from harness.common.arrays import Floats
from harness.common.statistics import average_bounds
from harness.config import StudySpec, build_study, load_study
from harness.remedy.run import steps_in_turn
from harness.study.design import Unit, units
from harness.study.evaluate import StudyEvaluator
from harness.study.run_noise import Case

TARGETS = ["lateral_force_axle_21", "articulation_angle"]
LEVELS = ["8 t", "16 t", "24 t", "32 t"]
STEERING = ["steering_wheel_angle"]
BELIEVED = {"trailer_mass": "24 t"}
DRIVES = [
    {"name": "slow-sine", "kind": "sine", "speed": "5 m/s", "amplitude": "250 deg", "frequency": "0.1 Hz"},
    {"name": "fast-sine", "kind": "sine", "speed": "15 m/s", "amplitude": "50 deg", "frequency": "0.3 Hz"},
    {"name": "winding-road", "kind": "winding_road"},
    {"name": "steady-circle", "kind": "steady_circle", "speed": "10 m/s", "radius": "45 m"},
    {"name": "growing-circle", "kind": "ramp", "speed": "3 m/s", "amplitude": "450 deg", "rate": "8 deg/s"},
    {"name": "random", "kind": "random_sequence", "speed": "22 m/s", "amplitude": "25 deg"},
]
"""Six excited drives of two minutes; the first minute is for learning."""

RUNS = 8
STATES = 11
"""With the mass, which is one of them."""
CONSIDERED = [{"name": "trailer_mass", "prior": "8 t"}]


def study(
    belief: Mapping[str, Any],
    sensors: str,
    kind: str,
    further: Mapping[str, Any],
    side: str = "plant",
    levels: Sequence[str] = LEVELS,
) -> StudySpec:
    """Return a study of one estimator at every level of the mass."""
    factor = {"parameter": "trailer_mass", "of": side, "levels": levels}
    content = {
        "name": "remedy",
        "seed": 20230109,
        "targets": TARGETS,
        "drive": [{"duration": "120 s", **d} for d in DRIVES],
        "plant": {
            "vehicle": "semitrailer",
            "parameters": "ziaukas_2023",
            "tyre": "magic_formula",
            "sensors": sensors,
        },
        "belief": {"values": BELIEVED, **belief},
        "estimator": [{"name": kind.upper(), "kind": kind}],
        "design": [{"name": "level", "repeats": RUNS, "factor": [factor]}],
        **further,
    }
    return build_study(content, "remedy")


@dataclass(frozen=True)
class Run:
    """What one estimator does on eight runs of a drive: RMSE, NEES and estimates over time."""

    level: str
    drive: str
    rmse: Floats
    nees: Floats
    covered: Floats
    lost: int
    kept: Floats


def runs(compared: StudySpec) -> Iterator[Run]:
    """Run a study of one estimator."""
    evaluator, design = StudyEvaluator(compared), compared.designs[0]
    names, begin = evaluator.compiled.truth_names, round(compared.score_after / compared.plant.step)
    for unit in units(compared, design):
        cases = [Case(0, repeat) for repeat in range(RUNS)]
        batch, believed = evaluator.simulate(unit, cases), evaluator.held(unit, cases, "belief")
        scores = evaluator.estimate(0, unit, cases, batch, believed, keep=True)
        assert scores.kept is not None
        truth = batch.truth[:, [names.index(t) for t in compared.targets]]
        estimate, deviation = scores.kept[:, 0, : len(compared.targets)], scores.kept[:, 1, : len(compared.targets)]
        inside = np.abs(estimate - truth)[begin:] <= 1.96 * deviation[begin:]
        label = design.band_labels[unit.band]
        lost = int(np.sum(scores.diverged_at < len(truth)))
        yield Run(
            label, compared.drives[unit.drive].name, scores.rmse, scores.nees, inside.mean(axis=0), lost, scores.kept
        )


def table(header: Sequence[str], rows: Sequence[Sequence[str]]) -> None:
    """Print a table of Markdown."""
    print("| " + " | ".join(header) + " |", "|" + "---|" * len(header), sep="\n")
    for row in rows:
        print("| " + " | ".join(row) + " |", flush=True)


def estimated() -> None:
    """Compare the error with an estimated mass to that with the mass known and with the mass wrong."""
    settled, sensors = {"score_after": "60 s"}, "stability_control"
    bound = average_bounds(STATES, 1.0)[1]
    rows = []
    for kind, walks in (("ekf", (0, 6, 12)), ("ukf", (6,))):
        with_mass = list(runs(study({}, sensors, kind, settled, side="both")))
        wrong = list(runs(study({}, sensors, kind, settled)))
        for walk in walks:
            mass = {"name": "trailer_mass", "prior": "12 t", "walk": f"{walk} t/sqrt(h)"}
            estimating = list(runs(study({"unknown_parameters": [mass]}, sensors, kind, settled)))
            for level in LEVELS:
                mine = [tuple(r for r in every if r.level == level) for every in (with_mass, wrong, estimating)]
                force = [float(np.median([r.rmse[0] for r in some])) for some in mine]
                over = [(f.rmse[0] / k.rmse[0], f.drive) for k, _, f in zip(*mine, strict=True)]
                worst, where = max((float(np.median(ratio)), drive) for ratio, drive in over)
                nees = np.concatenate([r.nees for r in mine[2]])
                rows.append(
                    [kind.upper(), f"{walk} t", level, *(f"{f / 1e3:.3f}" for f in force), f"{force[1] / force[0]:.1f}",
                     f"{np.median([ratio for ratio, _ in over]):.2f}", f"{worst:.2f} ({where.replace('-', ' ')})",
                     f"{np.median([r.rmse[2] for r in mine[2]]) / 1e3:.2f}", f"{np.median(nees) / STATES:.2f}",
                     f"{100 * np.mean(nees <= bound):.0f} %"]
                )  # fmt: skip
    header = ["estimator", "walk in an hour", "plant", "known kN", "24 t kN", "estimated kN", "24 t over known",
              "estimated over known", "on the worst drive", "mass error t", "NEES", "runs consistent"]  # fmt: skip
    table(header, rows)


def considered() -> None:
    """Compare the share of samples inside the stated band without and with a considered mass."""
    rows = []
    for name, sensors, unknown, noise in (
        ("series, steering measured", "series", [], {}),
        ("stability control, steering measured", "stability_control", [], {}),
    ):
        for kind in ("ekf", "ukf"):
            for prior in (None, "8 t", "14 t"):
                belief: dict[str, Any] = {"unknown_inputs": unknown, **noise}
                if prior:
                    belief["considered_parameters"] = [{"name": "trailer_mass", "prior": prior}]
                results = list(runs(study(belief, sensors, kind, {})))
                shares = [100 * np.mean([r.covered[0] for r in results if r.level == level]) for level in LEVELS]
                rows.append([name, kind.upper(), prior or "none", *(f"{s:.0f} %" for s in shares)])
    table(["sensors", "estimator", "considered ±", *LEVELS], rows)


def unweighed() -> None:
    """Show the share of samples inside the stated band, and its half width, if nothing is linearised in the mass."""
    rows = []
    for sensors in ("series", "stability_control"):
        for prior in ("8 t", "14 t", "24 t"):
            belief = {"unknown_parameters": [{"name": "trailer_mass", "prior": prior}]}
            table_of = {"name": "RBPF", "kind": "rbpf", "particles": 16, "weighed": False}
            results = list(runs(study(belief, sensors, "rbpf", {"estimator": [table_of]})))
            shares = [100 * np.mean([r.covered[0] for r in results if r.level == level]) for level in LEVELS]
            width = 1.96e-3 * np.median([np.median(r.kept[:, 1, 0]) for r in results])
            rows.append([sensors, prior, *(f"{s:.0f} %" for s in shares), f"{width:.1f}"])
    table(["sensors", "considered ±", *LEVELS, "band ± kN"], rows)


def straight() -> None:
    """Drive ten minutes straight ahead with the mass unknown."""
    rows = []
    for walk in ("0 t/sqrt(h)", "4 t/sqrt(h)"):
        unknown = {"unknown_parameters": [{"name": "trailer_mass", "prior": "8 t", "walk": walk}]}
        drive = {"name": "straight", "kind": "sine", "speed": "20 m/s", "amplitude": "0 deg", "duration": "600 s"}
        for run in runs(study(unknown, "stability_control", "ekf", {"drive": [drive]})):
            mean, deviation = run.kept[-1, 0, 2], run.kept[-1, 1, 2]
            rows.append(
                [walk, run.level, f"{mean.min() / 1e3:.2f} to {mean.max() / 1e3:.2f}", f"{deviation[0] / 1e3:.2f}"]
            )
    table(["walk", "plant", "estimate after 10 min t", "stated deviation t"], rows)


def steering() -> None:
    """Consider the mass with the steering unknown and the trailer's yaw rate alone, by the believed random walk."""
    rows = []
    printed = study({"unknown_inputs": STEERING}, "series", "ekf", {}).belief.process_noise[STEERING[0]]
    for factor in (1, 10, 100, 763):
        walk = {"unknown_inputs": STEERING, "noise": {"process": {STEERING[0]: factor * printed}}}
        for name, belief in (("certain", {}), ("considered", {"considered_parameters": CONSIDERED})):
            results = list(runs(study({**walk, **belief}, "series", "ekf", {})))
            shares = [100 * np.mean([r.covered[0] for r in results if r.level == level]) for level in LEVELS]
            lost = sum(r.lost for r in results)
            rows.append([f"{factor}", name, f"{lost} of {len(results) * RUNS}", *(f"{s:.0f} %" for s in shares)])
    table(["variance of the steering over the printed one", "mass", "lost", *LEVELS], rows)


def particles() -> None:
    """Compare the particle filter of the mass study with the EKF at the believed mass, by the believed random walk."""
    mass = load_study(Path(__file__).resolve().parents[1] / "studies" / "mass.toml")
    cloud = next(e for e in mass.estimators if e.kind == "particle")
    field = {"EKF": next(e for e in mass.estimators if e.kind == "ekf" and not e.noise)}
    for count in (64, 1000):
        field[f"PF, {count}"] = dataclasses.replace(cloud, settings=cloud.settings | {"particles": count})
    level = mass.designs[0]
    home, rows = level.factors[0].levels.index(level.factors[0].nominal), []
    for factor in (1, 100, 763):
        noise = {"unknown_inputs": float(factor)}
        tuned = tuple(dataclasses.replace(e, name=name, noise=noise) for name, e in field.items())
        evaluator = StudyEvaluator(dataclasses.replace(mass, estimators=tuned, designs=(level,), history=()))
        errors: dict[str, list[Floats]] = {name: [] for name in field}
        lost = dict.fromkeys(field, 0)
        for drive in range(len(mass.drives)):
            unit, cases = Unit(0, home, drive, 0, 1), [Case(0, repeat) for repeat in range(RUNS)]
            batch, believed = evaluator.simulate(unit, cases), evaluator.held(unit, cases, "belief")
            for index, name in enumerate(field):
                scores = evaluator.estimate(index, unit, cases, batch, believed)
                errors[name].append(scores.rmse[: len(mass.targets)])
                lost[name] += int(np.sum(scores.diverged_at < len(batch.truth)))
        for name, drive_errors in errors.items():
            force, angle = np.median(np.concatenate(drive_errors, axis=1), axis=1)
            rows.append([f"{factor}", name, f"{force / 1e3:.2f}", f"{np.degrees(angle):.2f}", f"{lost[name]}"])
    table(["variance of the steering over the printed one", "filter", "force kN", "angle deg", "lost"], rows)


def bank() -> None:
    """Compare a bank of filters over the mass with one that estimates it, on and between the hypotheses."""
    filters: dict[str, dict[str, Any]] = {"EKF, mass estimated": {"kind": "ekf"}}
    for name, estimated in (("IMM", True), ("IMM, considering", False)):
        filters[name] = {"kind": "imm", "hypotheses": {"trailer_mass": LEVELS}, "estimated": estimated}
    filters["IMM of two"] = {"kind": "imm", "hypotheses": {"trailer_mass": ["11.3 t", "22.6 t"]}}
    _against_known(filters, ["8 t", "12 t", "16 t", "20 t", "24 t", "28 t", "32 t"])


def alternatives() -> None:
    """Compare particles of the mass and a moving horizon with the mass known, as ``bank`` does."""
    horizon = {"kind": "moving_horizon", "window": 10}
    _against_known({"RBPF": {"kind": "rbpf"}, "moving horizon": horizon}, LEVELS)


def _against_known(filters: Mapping[str, Mapping[str, Any]], levels: Sequence[str]) -> None:
    """Print what filters that do not know the mass do in the second minute, against the EKF that knows it."""
    settled = {"score_after": "60 s"}
    unknown = {"unknown_parameters": [{"name": "trailer_mass", "prior": "12 t"}]}
    with_mass = list(runs(study({}, "stability_control", "ekf", settled, side="both", levels=levels)))
    studies = {
        name: study(
            unknown,
            "stability_control",
            settings["kind"],
            {**settled, "estimator": [{"name": name, **settings}]},
            levels=levels,
        )
        for name, settings in filters.items()
    }
    times = steps_in_turn([study({}, "stability_control", "ekf", {}), *studies.values()])
    rows = []
    for (name, compared), seconds in zip(studies.items(), times[1:], strict=True):
        results = list(runs(compared))
        for level in levels:
            mine = [(k, f) for k, f in zip(with_mass, results, strict=True) if f.level == level]
            ratio = np.median([f.rmse[0] / k.rmse[0] for k, f in mine])
            worst = max((float(np.median(f.rmse[0] / k.rmse[0])), f.drive) for k, f in mine)
            force, mass = (np.median([f.rmse[i] for _, f in mine]) for i in (0, 2))
            inside = 100 * np.mean([f.covered[0] for _, f in mine])
            nees = np.median([f.nees for _, f in mine]) / 11.0
            cells = [
                f"{force / 1e3:.3f}",
                f"{ratio:.2f}",
                f"{worst[0]:.2f} ({worst[1]})",
                f"{mass / 1e3:.2f}",
                f"{inside:.0f} %",
                f"{nees:.2f}",
            ]
            rows.append([name, level, *cells, f"{sum(f.lost for _, f in mine)}", f"{seconds / times[0]:.1f}"])
    header = [
        "estimator",
        "plant",
        "force kN",
        "over known",
        "worst drive",
        "mass t",
        "force inside its 95 % band",
        "NEES/dof",
        "lost",
        "time of a step over the EKF's",
    ]
    table(header, rows)


PARTS = {f.__name__: f for f in (estimated, considered, unweighed, straight, steering, particles, bank, alternatives)}

if __name__ == "__main__":
    parser = Parser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("what", choices=list(PARTS))
    PARTS[parser.parse_args().what]()
