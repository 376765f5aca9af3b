"""How the report was made: what was run, with what, and what the scores mean."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any

from harness.common.statistics import RESAMPLES, STRATUM
from harness.config import NOISE_GROUPS
from harness.models.quantities import print_unit, quantity, words
from harness.reporting.document import Block, Bullets, Heading, Listing, Prose, Sheet, plain
from harness.reporting.style import number, with_unit
from harness.study.report.analysis import Analysis
from harness.study.results import StudyResults

NOT_VERIFIABLE = "the scores have no checksums, so whether files of them are missing or damaged cannot be told"

_DEFINITIONS = (
    r"*RMSE*, *bias* and *maximum error* of a target $z$ over the $K$ samples of a run: "
    r"$sqrt(1/K sum_(k=1)^K (hat(z)_k - z_k)^2)$, $1/K sum_(k=1)^K (hat(z)_k - z_k)$ and "
    r"$max_k abs(hat(z)_k - z_k)$.",
    r"*NEES*, the normalised estimation error squared, with the covariance $P_k$ that the estimator states: "
    r"$epsilon_k = (x_k - hat(x)_k)^top P_k^(-1) (x_k - hat(x)_k)$; for a consistent estimator it is "
    r"$chi^2$-distributed with $n$ degrees of freedom, $n$ being the number of states.",
    r"*NIS*, the normalised innovation squared, with the innovation $nu_k$ and its covariance $S_k$: "
    r"$nu_k^top S_k^(-1) nu_k$; for a consistent estimator $chi^2$-distributed with $m$ degrees of "
    r"freedom, $m$ "
    r"being the number of outputs.",
    r"*Bounds.* The average NIS over $M$ updates of all runs of a level lies in "
    r"$[chi^2_(0.025)(M m), chi^2_(0.975)(M m)] \/ M$ with a probability of 95 %; the average NEES over "
    r"$N$ runs in "
    r"$[chi^2_(0.025)(N n), chi^2_(0.975)(N n)] \/ N$ with at least that.",
    f"*Interval of a median.* Percentile bootstrap with {RESAMPLES} resamples, each drive resampled within itself "
    f"where all have {STRATUM} runs or more, seeded with the seed of the study; none of fewer than 6 runs.",
)


def blocks(analysis: Analysis) -> list[Block]:
    """Return configuration, definitions and the study text."""
    store = analysis.store
    content: list[Block] = [
        Sheet(["item", "value"], _facts(store), "Configuration of the study and of the run.", left=2),
        *_models(store),
        *_map(store),
        *_noise(store),
        *_tuned(store),
        Heading("Drives and targets", 2),
        _drives(store),
        _targets(store),
        Heading("Definitions", 2),
        Bullets(_DEFINITIONS),
    ]
    if str(store.attributes.get("study", "")).strip():
        content += [
            Heading("The study", 2),
            Prose(plain("The full text from which everything above follows:")),
            Listing(str(store.attributes["study"]).rstrip("\n"), "toml"),
        ]
    return content


def _facts(store: StudyResults) -> list[list[str]]:
    a = store.attributes
    rows = []
    for key, label in (("study_name", "study"), ("study_hash", "hash of the study"), ("seed", "seed")):
        if key in a:
            rows.append([label, str(a[key])])
    if "step" in a:
        rows.append(["step", f"{number(1000 * float(a['step']))} ms"])
    if "score_after" in a:
        rows.append(["scores count", f"from {number(float(a['score_after']))} s of every drive on"])
    for design in store.designs:
        rows.append([f"design “{design.name}”", _size(design.status.shape)])
    if not store.is_verifiable:
        rows.append(["checksums", NOT_VERIFIABLE])
    for key in ("commit", "machine"):
        if key in a:
            rows += [[label, value] for label, value in flatten({key: a[key]})]
    versions = a.get("versions")
    if isinstance(versions, dict):
        rows.append(["versions", ", ".join(f"{k} {v}" for k, v in versions.items())])
    return rows + [[label, value] for label, value in flatten(_timing(store.run)) if value]


def _size(shape: tuple[int, ...]) -> str:
    bands, estimators, drives, samples, repeats = shape
    runs = bands * samples * drives * repeats
    return (
        f"{bands} bands × {samples} samples × {drives} drives × {repeats} repeats = {runs} simulated drives, "
        f"each seen by {estimators} estimators"
    )


_TIMING = {
    "compile_s": ("compilation", "s"),
    "duration_s": ("duration", "s"),
    "runs_per_s": ("rate", "runs per second"),
    "peak_memory_mib": ("peak memory", "MiB"),
}


def _timing(run: dict[str, Any]) -> dict[str, Any]:
    """Put units to what the runner noted."""
    named = {}
    for key, value in run.items():
        label, unit = _TIMING.get(key, (key, "")) if isinstance(value, int | float) else (key, "")
        named[label] = f"{value:.1f} {unit}" if unit else value
    return named


_SIDES = ("plant", "belief")
_UNSHOWN = ("foreign", "units", "map")
_NOISES = {"process_noise": "process", "measurement_noise": "measurement", "input_noise": "input"}


def _sides(store: StudyResults) -> dict[str, dict[str, Any]]:
    """Return what the store says of plant and belief; empty where it says nothing."""
    description = store.attributes.get("description")
    tables = description if isinstance(description, dict) else {}
    return {side: tables[side] for side in _SIDES if isinstance(tables.get(side), dict)}


def _models(store: StudyResults) -> list[Block]:
    """Return plant and belief side by side: the models, and the parameters in which they differ."""
    sides = _sides(store)
    if len(sides) < 2:
        return []
    shown = {side: {**table, **(table.get("foreign") or {})} for side, table in sides.items()}
    keys = [k for k in dict.fromkeys(k for side in shown.values() for k in side) if k not in {*_NOISES, *_UNSHOWN}]
    rows = [[words(k), *(_text(shown[side].get(k)) or "–" for side in _SIDES)] for k in keys]
    rows = [row for row in rows if row[1:] != ["–", "–"]]
    description = store.attributes["description"]
    for key, label in (("differing", "{}"), ("valid", "largest {}")):
        for name, entry in (description.get(key) or {}).items():
            unit = print_unit(str(entry.get("unit") or ""))
            texts = [with_unit(entry[s], unit) if isinstance(entry.get(s), int | float) else "–" for s in _SIDES]
            rows.append([label.format(words(name)), *texts])
    caption = (
        "The simulated vehicle (plant) and the model that the estimators assume (belief), before a design changes them."
    )
    if description.get("valid"):
        caption += (
            " A vehicle beyond its largest values is out of control, an estimate beyond the belief's has diverged."
        )
    return [Sheet(["item", "plant", "belief"], rows, caption, left=3)]


def _map(store: StudyResults) -> list[Block]:
    """Return which variables of a plant of somebody else are which signals; nothing of another plant."""
    entries = (_sides(store).get("plant", {}).get("foreign") or {}).get("map") or []
    rows = [
        [group, words(name), variable, print_unit(unit) or "1", f"{scale:.9g}", f"{offset:.9g}"]
        for group, name, variable, unit, scale, offset in entries
    ]
    caption = (
        "What the plant is given and publishes, and parameters that have another name in the study: the signal in the "
        "unit named is the variable times the factor, plus the offset."
    )
    header = ["", "signal", "variable of the plant", "unit", "factor", "offset"]
    return [Sheet(header, rows, caption, left=4)] if rows else []


def _noise(store: StudyResults) -> list[Block]:
    """Return the noise of plant and belief as standard deviations in report units."""
    sides = _sides(store)
    rows = []
    for key, kind in _NOISES.items():
        variances = {side: sides[side].get(key) or {} for side in sides}
        for place, name in enumerate(dict.fromkeys(n for v in variances.values() for n in v)):
            q, own = quantity(name), (sides["plant"].get("foreign") or {}).get("units", {}).get(name, "")
            cells: list[str] = []
            for side in _SIDES:
                held = variances.get(side, {}).get(name)
                cells.append("–" if held is None else number(q.scale * math.sqrt(held)))
            for side in _SIDES:
                held = variances.get(side, {}).get(name)
                cells.append("–" if held is None else f"{held:g}")
            rows.append(["" if place else kind, q.words, q.unit or print_unit(own) or "1", *cells])
    if not rows:
        return []
    header = ["noise", "signal", "unit", "σ plant", "σ belief", "variance plant", "variance belief"]
    caption = (
        "Noise: standard deviation σ in the unit named, and the variance in SI units as a study states it; process "
        "noise per step, measurement and input noise per sample."
    )
    return [Sheet(header, rows, caption, left=3)]


def _tuned(store: StudyResults) -> list[Block]:
    """Return the factors on the noise that tuned estimators believe; nothing where none is tuned."""
    description = store.attributes.get("description")
    by_estimator = description.get("noise_factors") if isinstance(description, dict) else None
    if not isinstance(description, dict) or not isinstance(by_estimator, dict) or not by_estimator:
        return []
    rows = [
        [name, *(number(float(factors.get(g, 1.0))) for g in NOISE_GROUPS)] for name, factors in by_estimator.items()
    ]
    caption = (
        "Tuned noise: what the variances that are believed are multiplied by, for the estimators named; the others "
        f"believe them as stated. Rule: {description['tuning']}."
    )
    return [Sheet(["estimator", *(words(g) for g in NOISE_GROUPS)], rows, caption)]


def flatten(value: dict[str, Any], prefix: str = "") -> Iterator[tuple[str, str]]:
    """Turn nested settings into pairs of words and text, e.g. ``("plant, tyre", "magic_formula")``.

    Settings two levels down, such as a noise per state, share a row.
    """
    for key, entry in value.items():
        label = f"{prefix}, {words(str(key))}" if prefix else words(str(key))
        flat = isinstance(entry, dict) and not any(isinstance(e, dict) for e in entry.values())
        if isinstance(entry, dict) and not (prefix and flat):
            yield from flatten(entry, label)
        elif isinstance(entry, list | tuple):
            yield label, ", ".join(_text(e) for e in entry)
        else:
            yield label, _text(entry)


def _text(entry: Any) -> str:
    if entry is None:
        return ""
    if isinstance(entry, bool):
        return "yes" if entry else "no"
    if isinstance(entry, float):
        return f"{entry:.6g}"
    if isinstance(entry, list | tuple):
        return ", ".join(_text(e) for e in entry)
    if isinstance(entry, dict):
        return ", ".join(f"{words(str(k))} {_text(v)}" for k, v in entry.items() if v is not None)
    return str(entry)


def _drives(store: StudyResults) -> Sheet:
    rows: dict[str, str] = {}
    for design in store.designs:
        for k, name in enumerate(design.drives):
            is_stated = "duration" in design.data
            rows[name] = number(float(design.data["duration"].values[k])) if is_stated else "–"
    return Sheet(["drive", "duration in s"], [list(item) for item in rows.items()], "Drives.")


def _targets(store: StudyResults) -> Sheet:
    names = dict.fromkeys(t.name for _, _, t in store.pairs())
    for run in store.histories:
        names |= dict.fromkeys(str(t) for t in run["target"].values)
    chosen = [quantity(name) for name in names]
    return Sheet(["quantity", "meaning"], [[q.words, q.meaning] for q in chosen], "Quantities scored or drawn.", left=2)
