"""Error of a population's median and mean against the number of points: ``python -m bench.quasi_monte_carlo``.

The vehicles of ``studies/fleet.toml`` with its first estimator, all with the noise of the first, so that the RMSE on
the worst drive is a function of the factors alone. Points are scrambled Sobol sequences, of which the first N are
taken, and as many independent ones. The error of a statistic is the root mean square over the scramblings of its
difference from that of all points. Its slope is fitted to log(error) against log(N), with an interval from 2000
resamples of the scramblings.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path

import joblib
import numpy as np

from harness.common.arguments import Parser
from harness.common.arrays import Floats
from harness.common.files import write_files
from harness.config import load_study
from harness.config.marginals import Marginal
from harness.config.specs import StudySpec
from harness.reporting import style
from harness.study.design import Unit, scrambled_points, values_of
from harness.study.evaluate import StudyEvaluator

STATISTICS: Mapping[str, Callable[..., Floats]] = {"median": np.median, "mean": np.mean}
SAMPLINGS = ("Sobol, scrambled", "independent")
_RESAMPLES = 2000
_UNIT = 1024


def errors(study: StudySpec, points: int, scramblings: int, jobs: int) -> Floats:
    """Return the RMSE on the worst drive, SI, ``(sampling, scrambling, point)``; of a diverged run infinite.

    Args:
        study: A study whose first design is a population.
        points: Of each scrambling.
        scramblings: Independent ones.
        jobs: Threads.
    """
    from scipy.special import ndtri

    rng, factors = np.random.default_rng(study.seed), len(study.designs[0].factors)
    sobol = [scrambled_points(points, factors, (study.seed, k)) for k in range(scramblings)]
    unit = np.concatenate([*sobol, rng.random((scramblings * points, factors))])
    values = values_of(study.designs[0], ndtri(np.clip(unit, 2.0**-40, 1 - 2.0**-40)))
    evaluator = StudyEvaluator(study).at(0, values[None])
    units = [
        Unit(0, 0, drive, first, min(first + _UNIT, len(values)), 0, 1)
        for first in range(0, len(values), _UNIT)
        for drive in range(len(study.drives))
    ]
    results = joblib.Parallel(n_jobs=jobs, backend="threading")(joblib.delayed(evaluator.evaluate)(u) for u in units)
    each = [np.where(np.isnan(rmse := r["rmse"][:, 0, 0, 0]), np.inf, rmse) for r in results]
    drives = len(study.drives)
    worst = [np.max(each[i : i + drives], axis=0) for i in range(0, len(each), drives)]
    return np.concatenate(worst).reshape(len(SAMPLINGS), scramblings, points)


def deviations(values: Floats, counts: list[int], statistic: Callable[..., Floats]) -> Floats:
    """Return by how much a statistic of the first points is off, ``(scrambling, count)``.

    Args:
        values: ``(scrambling, point)``.
        counts: How many points.
        statistic: Of the last axis.
    """
    return np.stack([statistic(values[:, :n], axis=-1) for n in counts], axis=-1) - statistic(values.ravel())


def slope(off: Floats, counts: list[int]) -> tuple[float, float, float]:
    """Return the exponent of the root mean square against the count, and its 95 % interval."""

    def fitted(rows: Floats) -> float:
        return float(np.polyfit(np.log(counts), np.log(np.sqrt(np.mean(rows**2, axis=0))), 1)[0])

    rng = np.random.default_rng(0)
    again = [fitted(off[rng.integers(len(off), size=len(off))]) for _ in range(_RESAMPLES)]
    return fitted(off), float(np.quantile(again, 0.025)), float(np.quantile(again, 0.975))


def picture(off: Mapping[str, list[Floats]], counts: list[int], unit: str) -> str:
    """Return the figure: root mean square errors against the number of points, by statistic and sampling."""
    with style.drawing():
        fig = style.figure(2.8)
        looks = style.looks(list(SAMPLINGS))
        for axes, (name, both) in zip(fig.subplots(1, len(off), sharey=True), off.items(), strict=True):
            for sampling, rows in zip(SAMPLINGS, both, strict=True):
                size = np.sqrt(np.mean(rows**2, axis=0))
                axes.loglog(
                    counts, size, "o-", color=looks[sampling].line, label=f"{sampling}: {slope(rows, counts)[0]:.2f}"
                )
            axes.set_xscale("log", base=2)
            axes.set_title(name, loc="left")
            axes.set_xlabel("points")
            axes.legend()
            axes.grid()
        fig.axes[0].set_ylabel(f"error{style.in_unit(unit)}")
        return style.svg(fig)


def main() -> None:
    """Evaluate, print a table and write the figure."""
    parser = Parser(prog="python -m bench.quasi_monte_carlo", description=__doc__)
    parser.add_argument("--points", type=int, default=1024, help="of each scrambling, a power of two (%(default)s)")
    parser.add_argument("--scramblings", type=int, default=32, help="independent ones (%(default)s)")
    parser.add_argument("--jobs", type=int, default=1, help="threads (%(default)s)")
    parser.add_argument("--smooth", action="store_true", help="with a normal payload in place of that of a weighbridge")
    parser.add_argument("--out", type=Path, default=Path("results/quasi-monte-carlo"), help="folder (%(default)s)")
    chosen = parser.parse_args()
    study = load_study(Path(__file__).parents[1] / "studies" / "fleet.toml")
    study = replace(study, estimators=study.estimators[:1])
    if chosen.smooth:
        design = study.designs[0]
        payload = replace(design.factors[0], marginal=Marginal("truncated_normal", (14e3, 4e3, 2e3, 24e3)))
        study = replace(study, designs=(replace(design, factors=(payload, *design.factors[1:])),))
    counts = [2**k for k in range(5, chosen.points.bit_length())]
    rmse = np.degrees(errors(study, chosen.points, chosen.scramblings, chosen.jobs))
    off = {name: [deviations(rows, counts, f) for rows in rmse] for name, f in STATISTICS.items()}
    print("| statistic | points | " + " | ".join(f"N = {n}" for n in counts) + " | exponent |")
    print("|---" * (3 + len(counts)) + "|")
    for name, both in off.items():
        for sampling, rows in zip(SAMPLINGS, both, strict=True):
            sizes = " | ".join(f"{x:.2g}°" for x in np.sqrt(np.mean(rows**2, axis=0)))
            fit, low, high = slope(rows, counts)
            print(f"| {name} | {sampling} | {sizes} | {fit:.2f} ({low:.2f} to {high:.2f}) |")
    for path in write_files(chosen.out, {"error.svg": picture(off, counts, "°")}):
        print(path)


if __name__ == "__main__":
    main()
