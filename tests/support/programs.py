"""Small forms of every target of the Makefile and of every module that runs, or the test that begins it.

A target or a module that is in no table fails ``tests/test_programs.py``.
"""

import ast
import re
import shlex
import subprocess
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
PACKAGES = ("bench", "harness", "reproductions")
"""Those with modules that run."""
PROGRAM = re.compile(
    rf"\S*bin/(?:python -m (?P<module>(?:{'|'.join(PACKAGES)})[\w.]*)|harness\b)(?P<arguments>[^|&;#\n]*)"
)
NUMBER = r"(\d[\d.]*(?:e[-+]\d+)?)"


@dataclass(frozen=True)
class Small:
    """A small form that is run.

    Attributes:
        given: Variables of make, or arguments of a module.
        says: What it has to print, as a pattern; whatever its groups take are finite numbers.
        writes: Files that are not empty afterwards.
        quick: Whether ``make test`` runs it, not only ``make proof``.
        apart: Why it takes a process of its own.
    """

    given: str
    says: str
    writes: tuple[str, ...] = ()
    quick: bool = False
    apart: str = ""


@dataclass(frozen=True)
class Begun:
    """What has no form that is small enough: it runs until its work begins.

    Attributes:
        given: Variables of make, or arguments of a module.
        at: Where its work begins.
        says: What the work is given there, as a pattern.
        why: It goes no further.
    """

    given: str
    at: str
    says: str
    why: str


@dataclass(frozen=True)
class By:
    """What is begun, and looked at, by a test of its own or by what every change must pass.

    Attributes:
        test: ``file::function`` below tests, or ``.ci/run``.
    """

    test: str


@dataclass(frozen=True)
class Shown:
    """What only a person can begin: its recipe is read.

    Attributes:
        why: Nothing here can.
    """

    why: str


REPORT = ("report.html", "report.pdf")
EVALUATED = "harness.study.evaluate.StudyEvaluator.__init__"
FINDS_NO_RECORDINGS = Small("", r"skipped, there is no folder", quick=True)

TARGETS: dict[str, Small | Begun | By | Shown] = {
    "help": By("test_programs.py::test_help_names_every_target"),
    "setup": Shown("it makes the environment in which tests run"),
    **dict.fromkeys(("lint", "test", "test-view", "proof", "wheel", "notebooks", "docs"), By(".ci/run")),
    "studies": By("test_programs.py::test_all_studies_are_run_and_gathered"),
    "study-%": Begun("", "harness.study.run.run_study", r"results/{stem}\b", "tests of harness run go on from there"),
    "study-realtime": Begun("", "harness.realtime.measure.contestants", "fast-sine", "a minute on a core of its own"),
    "study-narx-architecture": By("test_programs.py::test_a_module_does_its_work"),
    "study-identify-swarm": By("identification/test_swarm.py::test_the_study_writes_its_report"),
    "study-identify-em": By("test_programs.py::test_a_module_does_its_work"),
    "study-identify-%": FINDS_NO_RECORDINGS,
    "reproduce-box": Begun("JOBS=1", "reproductions.box.points.Folder.points", "256", "an hour"),
    "reproduce-nearest": Begun("JOBS=1", EVALUATED, "name='ideal'", "a minute"),
    "reproduce": By("reproductions/test_published.py::test_the_command_writes_report_and_data_of_a_document"),
    "report": By("test_programs.py::test_reports_are_written_again"),
    "loop": By("bench/test_demonstration.py::test_an_effect_is_sealed_traced_and_opened"),
    "loop-%": FINDS_NO_RECORDINGS,
    "attribution": By(
        "bench/test_attribution.py::test_the_command_scores_what_was_traced_and_writes_tables_and_figures"
    ),
    "attribution-docs": By("bench/test_attribution.py::test_the_page_of_the_proof_is_renewed_with_its_figures"),
    "foreign": By("bench/test_foreign.py::test_a_case_is_traced_once"),
    "sensitivity": By("bench/test_sensitivity.py::test_the_command_writes_the_tables_of_what_was_traced"),
    "check-proof": By("bench/test_recording_faults.py::test_the_command_writes_the_table_of_what_is_there"),
    "tuning-proof": Small(
        "SETS=1 CASES=semitrailer",
        rf"\| \*\*all\*\* \| {NUMBER} \| {NUMBER} \| \*\*{NUMBER} %",
        ("results/tuning-proof/variances.jsonl",),
    ),
    "fuzz": By("bench/test_fuzz.py::test_hundreds_of_broken_files_are_read_or_refused_in_words"),
    "mutation": Small("COUNT=1 JOBS=1", rf"{NUMBER} of {NUMBER} mutants killed", ("results/mutation/mutants-0.jsonl",)),
    "faults": By("bench/test_faults.py::test_a_study_that_was_struck_has_the_same_bits"),
    "audit": By("test_programs.py::test_the_audit_counts_what_it_finds"),
    "scale": By("bench/test_short_runs.py::test_the_report_of_a_store_of_many_runs_is_timed"),
    "short-runs": By("bench/test_short_runs.py::test_what_runs_take_beside_their_kernels"),
    "endurance": By("bench/test_endurance.py::test_covariances_stay_symmetric_and_definite"),
    "bench": By("test_programs.py::test_a_module_does_its_work"),
    "lock": Shown("it needs uv and the network, and renews what is pinned"),
    "clean": By("test_programs.py::test_clean_removes_results_and_keeps_the_environment"),
}

MODULES: dict[str, Small | Begun | By] = {
    "harness": Small("list studies", r"(?m)^mass ", quick=True),
    "harness.cli.main": Small("--version", r"harness (\d+\.\d+)", quick=True),
    "harness.external.worker": By("external/test_processes.py::test_a_process_is_reused"),
    "harness.cli.drive_tables": By("cli/test_drive_tables.py::test_the_command_prints_the_peaks_of_every_drive"),
    "reproductions.identify_measured": By("reproductions/test_measured_car.py::test_a_recorded_car_is_identified"),
    "reproductions.narx_training": Small(
        "--out n.npz --neurons 2 --epochs 1 --iterations 1 --polish 1 --restarts 1 --jobs 1",
        rf"candidate 0 chosen; free-running NRMSE .*'test': \[{NUMBER}, {NUMBER}\]",
        ("n.npz",),
        quick=True,
    ),
    "reproductions.narx_architecture": Small(
        "--out narx --most 1 --restarts 1 --spread 1 --epochs 1 --iterations 1 --jobs 1",
        rf"best free-running NRMSE {NUMBER}",
        tuple(f"narx/{name}" for name in REPORT),
    ),
    "reproductions.sun_particle_smoother": Small(
        "--repeats 1",
        rf"extended Kalman filter +{NUMBER} ± 0 +{NUMBER} ± 0 +{NUMBER} ± 0\nparticle filter +50 +{NUMBER}",
    ),
    "reproductions.sun_em": Small(
        "--out em --repeats 1 --beside 1 --iterations 3 --jobs 1",
        rf"likelihood: 1 recordings, median {NUMBER} s",
        tuple(f"em/{name}" for name in (*REPORT, "identify.npz")),
    ),
    "bench": Small("--rounds 1", rf"our UKF is {NUMBER} times as fast as filterpy's"),
    "bench.attribution.changed_criteria": By("bench/test_sensitivity.py::test_a_case_that_is_none_is_told"),
    "bench.bus_logs": Small("--seconds 0.2", rf"log: 1,000 frames in {NUMBER} s of processor time, .* {NUMBER} GiB"),
    "bench.card": Small(
        "--help", "usage: ", quick=True, apart="only a graphics card does more; here numba simulates one"
    ),
    "bench.compilation": Begun("small.toml", EVALUATED, "kind='ekf'", "it compiles into an empty cache"),
    "bench.estimators": Begun("ekf", EVALUATED, "kind='ekf'", "half a minute"),
    "bench.export": By("bench/test_export_figures.py::test_steps_of_c_and_kernel_are_compared"),
    "bench.export_tools": By("bench/test_export_figures.py::test_tools_of_control_units_have_nothing_new_to_say"),
    "bench.external": Small("--rounds 1", rf"two workers are {NUMBER} times as fast as one"),
    "bench.external_estimators": Small("--rounds 1", rf"overhead of C +{NUMBER}"),
    "bench.faults.child": By("bench/test_faults.py::test_a_study_that_was_struck_has_the_same_bits"),
    "bench.fmu_container": By("bench/test_export_figures.py::test_fmus_run_in_the_container_of_another_importer"),
    "bench.floor": Begun("", "bench.floor.throughput.throughput", r"\(\)", "half a minute"),
    "bench.growth": By("bench/test_growth.py::test_a_point_is_measured_and_what_is_there_is_drawn"),
    "bench.house": Small("", rf"{NUMBER}  files\n", quick=True),
    "bench.identify": Small("--coverage 1", rf"mass_over_inertia: {NUMBER} % of 1 intervals hold the truth"),
    "bench.next_drive": Small(
        "--cases 1 --effort 4", rf"{NUMBER} % of 2 standard errors within 15 % of what was expected"
    ),
    "bench.next_drive_proof": Begun(
        "--draws 1 --out out", "harness.diagnosis.run.augmented_model_of", "vehicle='car'", "minutes"
    ),
    "bench.next_drive_ratios": Begun(
        "--cases 1", "harness.diagnosis.run.augmented_model_of", "vehicle='car'", "ten minutes"
    ),
    "bench.notebooks": By("package/test_notebooks.py::test_it_runs"),
    "bench.peers": By("test_programs.py::test_the_peers_are_measured_where_they_are_installed"),
    "bench.quasi_monte_carlo": Small(
        "--points 64 --scramblings 2 --out out", rf"mean \| Sobol, scrambled \| {NUMBER}°", ("out/error.svg",)
    ),
    "bench.questions": Begun("mass trace", "bench.view_pictures.served", "mass", "it takes the mass study and a trace"),
    "bench.real.plant": By("bench/test_real.py::test_the_command_writes_what_the_tracer_gets_and_then_the_seal"),
    "bench.remedy": Begun("estimated", EVALUATED, "kind='ekf'", "minutes"),
    "bench.shares": Begun("--only mass", "subprocess.run", "'--once', 'mass'", "it runs the mass study three times"),
    "bench.view": By("view/test_programs_in_a_browser.py::test_the_time_of_a_page_is_measured"),
}


def modules() -> Iterator[tuple[str, ast.Module]]:
    """Yield every module of the packages with the name by which it runs, one at a time: all trees are 150 MB."""
    for path in (path for top in PACKAGES for path in (ROOT / top).rglob("*.py")):
        parts = path.relative_to(ROOT).with_suffix("").parts
        name = ".".join(parts[:-1] if parts[-1] == "__main__" else parts)
        yield name, ast.parse(path.read_text(encoding="utf-8"))


def runs(tree: ast.Module) -> bool:
    return any(isinstance(node, ast.If) and "__main__" in ast.unparse(node.test) for node in tree.body)


PROGRAMS = frozenset(name for name, tree in modules() if runs(tree))


def expanded(target: str) -> list[str]:
    """Return the targets of a pattern, one for each of its files."""
    folder = {"study-%": "studies", "study-identify-%": "studies/identify", "loop-%": "studies/loops"}.get(target)
    if folder is None:
        return [target]
    stems = sorted(path.stem for path in (ROOT / folder).glob("*.toml"))
    return [target.replace("%", stem) for stem in stems if (target, stem) != ("loop-%", "semitrailer")]


def recipe(target: str, variables: str) -> list[tuple[str, list[str]]]:
    """Return what a target runs of this project: modules with their arguments."""
    stamps = [word for name in ("run", "dev", "docs") for word in ("-o", f".venv/{name}.stamp")]
    command = ["make", "-n", *stamps, "-C", str(ROOT), target, *shlex.split(variables)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    found = PROGRAM.finditer(done.stdout.replace("\\\n", " "))
    return [(m["module"] or "harness", shlex.split(m["arguments"])) for m in found]


def each(kind: type, table: dict) -> list:
    """Return the entries of a kind as parameters; what takes long is of ``make proof``."""
    entries = [(name, way) for key, way in table.items() if isinstance(way, kind) for name in expanded(key)]
    slow = [isinstance(way, Small) and not way.quick for _, way in entries]
    return [
        pytest.param(name, way, id=name, marks=pytest.mark.proof if late else ())
        for (name, way), late in zip(entries, slow, strict=True)
    ]
