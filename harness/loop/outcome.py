"""A trace judged: its verdict, ``trace.json``, and the amended model as a parameter set."""

from __future__ import annotations

import json
import math
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from harness.configure import ModelSpec
from harness.configure.parameter_set import set_text
from harness.folder import write_files
from harness.identify.judgement import judged_on
from harness.identify.outcome import Judged
from harness.loop.amend import Estimated, fitted_model
from harness.loop.held_out import EXCESS, Judgement, leaves_nothing
from harness.loop.hypotheses import ALL_PARAMETERS, Hypothesis
from harness.loop.judges import BIC_NEEDED, Candidate, beyond_belief
from harness.loop.trace import Trace
from harness.loop.trials import Say
from harness.loop.wandering import EXPLAINED, Wandering
from harness.loop.where import Where, pinpoint_record, unnamed_record, where
from harness.loop.worth import Worth
from harness.report.opening import listed
from harness.report.store import words
from models.placement import load_effect, ports_of, split
from models.signals import SIGNALS

Floats = NDArray[np.float64]
Verdict = Literal["adequate", "amended", "unresolved"]

COLOURED = 1e-4
"""p-value below which innovations count as coloured; each output of each drive is a test of its own."""


@dataclass(frozen=True)
class Value:
    """A parameter as found: value and standard error in SI units."""

    name: str
    unit: str
    value: float
    std: float


@dataclass(frozen=True)
class Outcome:
    """A trace, judged.

    Attributes:
        trace: What was found.
        verdict: As ``trace.json`` has it.
        answer: The result in sentences.
        values: What each addition holds, by its name.
        judged: Every drive against the nominal model and the final one.
        nominal: The nominal model, refitted, for studies.
        amended: The final model, for studies; effects with moments hold those of the first fitted drive.
        where: Where the model lacks something, and what is left without a name.
        estimators: Estimators on the held-out drives with the nominal and the amended model, where asked for.
        worth: A study with the amended plant against both beliefs, where asked for; why it could not be run, in words.
        notes: What is odd about the recordings, with the evidence.
    """

    trace: Trace
    verdict: Verdict
    answer: str
    values: dict[str, tuple[Value, ...]]
    judged: tuple[Judged, ...]
    nominal: ModelSpec
    amended: ModelSpec
    where: Where
    estimators: tuple[Estimated, ...] = ()
    worth: Worth | str | None = None
    notes: tuple[str, ...] = ()

    @property
    def added(self) -> tuple[Hypothesis, ...]:
        """Everything that was added, a random process last."""
        process = self.where.wandering
        return self.trace.added if process is None else (*self.trace.added, process.hypothesis)

    @property
    def after(self) -> Judgement:
        """The final model on the held-out drives: with what has no name, if that helps there."""
        return final_judgement(self.trace, self.where)


def outcome_of(trace: Trace, say: Say = lambda _: None) -> Outcome:
    """Return the verdict on a trace with all that the report and ``trace.json`` need.

    Args:
        trace: What was found.
        say: Is told what is being done.
    """
    say("looking for where something is missing")
    values, judged, amended = _values(trace), _judged(trace), _amended(trace)
    coloured = any(min(w.ljung_box, w.periodogram) < EXPLAINED for j in judged if j.held_out for w in j.whiteness)
    found = where(trace, amended, coloured or _strays(trace))
    if found.wandering is not None:
        amended = found.wandering.spec
        values[found.wandering.hypothesis.name] = _of_process(found.wandering)
    verdict = verdict_of(trace, found, coloured)
    nominal = fitted_model(trace, trace.fitting.whole.spec, trace.nominal.point)
    answer = _answer(trace, verdict, found)
    return Outcome(trace, verdict, answer, values, judged, nominal, amended, found)


def verdict_of(trace: Trace, found: Where, coloured: bool) -> Verdict:
    """Return whether the model is adequate, amended, or lacks something that has no name here.

    Something is still missing if the final model's innovations on the held-out drives are anything but white, whatever
    was named: then a name may stand for something else. So it is if the model strays there further than the noise of
    the sensors, with the curves that have no name if there are any, and either there are some or the last round held a
    hypothesis that gained enough but did not pass. A random process is added where it leaves nothing, or next to it.
    Many wrong parameters explain nothing if one would be wrong beyond belief.
    """
    if beyond_belief(trace.final):
        return "unresolved"
    if found.wandering is not None:
        return "amended" if found.wandering.white else "unresolved"
    if coloured and (trace.effects or found.unnamed is None):
        return "unresolved"
    if found.unnamed is not None and final_judgement(trace, found).excess > EXCESS:
        return "unresolved"
    if found.unnamed is None and _failed(trace) and not leaves_nothing(trace.after, trace.before):
        return "unresolved"
    return "amended" if trace.effects or found.unnamed is not None else "adequate"


def final_judgement(trace: Trace, found: Where) -> Judgement:
    """Return the final model on the held-out drives, with the curves that have no name if it strays less with them."""
    if found.unnamed is not None and found.unnamed.judgement.excess < trace.after.excess:
        return found.unnamed.judgement
    return trace.after


def _strays(trace: Trace) -> bool:
    """Whether something is left that the named effects do not explain."""
    return not leaves_nothing(trace.after, trace.before) and (_failed(trace) or not trace.effects)


def _failed(trace: Trace) -> bool:
    """Whether the last round held a hypothesis that gained enough on the fitted drives but did not pass."""
    last = trace.rounds[-1]
    return last.added is None and any(c.fitted is not None and c.bic >= BIC_NEEDED for c in last.candidates)


def _values(trace: Trace) -> dict[str, tuple[Value, ...]]:
    """Return the parameters of every addition with standard errors from the information of the final fit."""
    errors = _errors(trace)
    model, found = trace.fitting.whole, {}
    for h in trace.added:
        rows = []
        for name in (*h.shared, *h.moments):
            row = model.row(name)
            for i in range(len(trace.fitting.drives)) if name in h.moments else (0,):
                label = f"{name}@{trace.fitting.drives[i].name}" if name in h.moments else name
                value = float(trace.final.point.values[row, i])
                rows.append(Value(label, model.model.parameters[row].unit, value, errors.get((name, i), math.nan)))
        found[h.name] = tuple(rows)
    return found


def _of_process(process: Wandering) -> tuple[Value, ...]:
    units = {p.name: p.unit for p in process.spec.model().parameters}
    return tuple(Value(n, units[n], process.spec.values[n], e) for n, e in process.errors.items())


def _errors(trace: Trace) -> dict[tuple[str, int], float]:
    """Return the standard errors of the final model by parameter and first drive in which it acts."""
    errors = trace.fitting.standard_errors(trace.final)
    moved = trace.final.coordinates
    return {(c.name, c.drives[0] if c.drives else 0): float(e) for c, e in zip(moved, errors, strict=True)}


def _answer(trace: Trace, verdict: Verdict, found: Where) -> str:
    parameters = [h for h in trace.added if h.kind == "parameter"]
    process = found.wandering
    effects = trace.effects if process is None else (*trace.effects, process.hypothesis)
    names = [words(h.name.replace("@", " of ")) for h in effects]
    named = listed(names) if names else ""
    wrong = ", ".join(words(h.name) for h in parameters)
    also = f" The stated values of {wrong} were wrong." if parameters else ""
    if far := beyond_belief(trace.final):
        rest = "the rest" if effects else "it"
        also = f" Many stated values would explain {rest}, but wrong by factors that nobody believes: {far}."
    after = final_judgement(trace, found)
    gap = _gap(trace.before, after)
    if process is not None:
        gap = (gap if trace.added else "") + _of_a_process(process)
    curves = [] if found.unnamed is None else found.unnamed.words
    unnamed = f" What is missing acts as {'; '.join(curves)}." if curves else ""
    if verdict == "adequate":
        return f"The model is adequate: nothing is missing that these drives can show.{also}{gap if also else ''}"
    if verdict == "amended":
        lacking = f"The model lacks {named}." if named else "The model lacks something outside the library."
        return f"{lacking}{unnamed}{also}{gap}"
    part = f" {named[:1].upper()}{named[1:]} explain{'' if len(names) > 1 else 's'} part of it." if named else ""
    closed = gap if named or curves else ""
    return f"Something is missing that no effect of the library explains.{part}{unnamed}{closed}{also}"


def _of_a_process(process: Wandering) -> str:
    return (
        f" {words(process.hypothesis.name).capitalize()} is a random process: the model alone cannot foretell it. With "
        f"a filter that knows of it the log-likelihood of the held-out drives rises by {process.held_out_gain:.0f}."
    )


def _gap(before: Judgement, after: Judgement) -> str:
    """Say what becomes of the error of the model alone."""
    if math.isinf(before.excess):
        now = "still does" if math.isinf(after.excess) else "no longer does"
        return f" Refitted alone, the model left the range in which it holds on the held-out drives; it {now}."
    if before.excess <= 0 or after.excess >= before.excess:
        return " The held-out error does not fall."
    fall = 100 * (1 - math.sqrt(after.excess / before.excess))
    return f" The held-out error beyond the noise of the sensors falls by {fall:.0f} %."


def _judged(trace: Trace) -> tuple[Judged, ...]:
    """Return every drive against the nominal model and the final one."""
    fitting = trace.fitting
    fitted = (
        judged_on(fitting.whole, fitting.drives, fitting.candidates([f.point])) for f in (trace.nominal, trace.final)
    )
    return tuple(
        Judged(held_out, before, after)
        for held_out, both in ((False, fitted), (True, (trace.before.drives, trace.after.drives)))
        for before, after in zip(*both, strict=True)
    )


def _amended(trace: Trace) -> ModelSpec:
    """Return the final model with its effects at the places where they are in force."""
    spec = trace.fitting.whole.spec
    effects = (*spec.effects, *dict.fromkeys(h.name for h in trace.effects))
    return fitted_model(trace, replace(spec, effects=effects), trace.final.point)


def record(outcome: Outcome) -> dict[str, Any]:
    """Return ``trace.json``: SI units, what is not finite as ``null``."""
    trace = outcome.trace
    outputs = list(trace.fitting.whole.model.outputs)
    return {
        "verdict": outcome.verdict,
        "answer": outcome.answer,
        "notes": list(outcome.notes),
        "residual": _residual(outcome, outputs),
        "pinpoint": pinpoint_record(outcome.where),
        "candidates": [_candidate(c, n, outputs) for n, r in enumerate(trace.rounds, 1) for c in r.candidates],
        "added": [_added(h, outcome) for h in outcome.added if h.kind == "effect"],
        "parameters": [_added(h, outcome) for h in outcome.added if h.kind == "parameter"],
        "unnamed": unnamed_record(outcome.where.unnamed),
        "rounds": [
            {
                "held_out_excess_by_output": _by_output(r.before, outputs),
                "added": r.added.hypothesis.name if r.added else None,
                "reason": r.reason,
                "confusable": list(r.confusable),
            }
            for r in trace.rounds
        ],
        "confusable": [list(r.confusable) for r in trace.rounds if r.added is not None and len(r.confusable) > 1],
        "not_excited": [c.hypothesis.name for c in trace.rounds[0].candidates if not c.score.excited],
        "error": {
            name: {
                "unit": SIGNALS[name].unit,
                "before": _number(trace.before.error[a]),
                "after": _number(outcome.after.error[a]),
            }
            for a, name in enumerate(outputs)
        },
        "excess": {"before": _number(trace.before.excess), "after": _number(outcome.after.excess)},
        "log_likelihood": {
            "train": {"before": trace.nominal.log_likelihood, "after": trace.final.log_likelihood},
            "test": {"before": trace.before.log_likelihood, "after": trace.after.log_likelihood},
        },
        "estimators": {
            e.kind: {
                name: {"unit": SIGNALS[name].unit, "before": _number(e.before[a]), "after": _number(e.after[a])}
                for a, name in enumerate(outputs)
            }
            for e in outcome.estimators
        },
        "worth": _worth(outcome.worth) if isinstance(outcome.worth, Worth) else None,
    }


def _worth(worth: Worth) -> dict[str, Any]:
    """Return the median errors of a study over all its levels, in SI units, with the ratio and its interval."""
    targets = worth.nominal.targets
    gains = [worth.gain(e, t) for e in range(len(worth.nominal.estimators)) for t in range(len(targets))]
    found: dict[str, Any] = {}
    for g in gains:
        t = targets[g.target]
        found.setdefault(g.estimator, {})[t.name] = {
            "unit": SIGNALS[t.name].unit,
            "before": _number(g.before / t.scale),
            "after": _number(g.after / t.scale),
            "ratio": _number(g.ratio.value),
            "ratio_interval_95": [_number(g.ratio.lower), _number(g.ratio.upper)],
            "lost": {"before": g.lost[0], "after": g.lost[1]},
        }
    return {"study": str(worth.study), "moments": worth.moments, "estimators": found}


def _residual(outcome: Outcome, outputs: list[str]) -> dict[str, Any]:
    return {
        j.drive.name: {
            name: {
                "unit": SIGNALS[name].unit,
                "rmse": _number(j.free_error[1, a]),
                "variance_of_whitened_innovations": _number(j.whiteness[a].variance),
                "ljung_box_p": _number(j.whiteness[a].ljung_box),
                "cumulative_periodogram_p": _number(j.whiteness[a].periodogram),
            }
            for a, name in enumerate(outputs)
        }
        for j in outcome.judged
    }


def _candidate(c: Candidate, number: int, outputs: list[str]) -> dict[str, Any]:
    h = c.hypothesis
    return {
        "round": number,
        "name": h.name,
        "kind": h.kind,
        "log_likelihood_gain": _number(c.score.gain),
        "bic_gain": _number(c.bic),
        "fitted": c.fitted is not None,
        "held_out_log_likelihood": _number(c.held_out.log_likelihood) if c.held_out else None,
        "held_out_excess": _number(c.held_out.excess) if c.held_out else None,
        "held_out_excess_by_output": _by_output(c.held_out, outputs) if c.held_out else None,
        "detectable": {a: _number(3.0 * e) for a, e in zip(h.amplitudes, c.score.error, strict=True)},
    }


def _by_output(judged: Judgement, outputs: list[str]) -> dict[str, float | None]:
    return dict(zip(outputs, map(_number, judged.excesses), strict=True))


def _added(h: Hypothesis, outcome: Outcome) -> dict[str, Any]:
    entry: dict[str, Any] = {
        "effect": split(h.name)[0],
        "place": split(h.name)[1],
        "parameters": {
            v.name: {"value": _number(v.value), "std": _number(v.std), "unit": v.unit} for v in outcome.values[h.name]
        },
    }
    if h.kind == "effect":
        entry["port"] = list(ports_of(load_effect(h.name)))
        entry["equation"] = equation(h, outcome)
    elif h.name != ALL_PARAMETERS:
        entry["stated"] = outcome.trace.fitting.whole.spec.values[h.name]
    return entry


def equation(h: Hypothesis, outcome: Outcome) -> dict[str, dict[str, str]]:
    """Return the ports that an effect changes, each before and after, as text over the model's names."""
    spec = outcome.trace.fitting.whole.spec
    before = spec.model().ports
    after = replace(spec, effects=(*spec.effects, h.name)).model().ports
    return {
        port: {"before": str(before[port]), "after": str(after[port])}
        for port in after
        if port in before and before[port] != after[port]
    }


def _number(value: float) -> float | None:
    return float(value) if math.isfinite(value) else None


def write_outcome(outcome: Outcome, folder: Path) -> list[Path]:
    """Write ``trace.json``, and both models as parameter files, and return their paths.

    Raises:
        UserError: If the folder cannot be written to.
    """
    names = ", ".join(d.name for d in outcome.trace.fitting.drives)
    comments = {
        v.name: f"  # {v.unit} +- {v.std:.3g}" for rows in outcome.values.values() for v in rows if math.isfinite(v.std)
    }
    contents = {
        "trace.json": json.dumps(record(outcome), indent=2) + "\n",
        "nominal.toml": set_text(outcome.nominal, f"the nominal model refitted by harness trace on {names}", {}),
        "amended.toml": set_text(outcome.amended, f"harness trace on {names}", comments),
    }
    return write_files(folder, contents)
