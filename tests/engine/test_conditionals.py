"""A model whose effects may be absent gives the numbers of the plain one, and computes no more than it must."""

from __future__ import annotations

import numpy as np
import pytest
import sympy as sp

from harness.engine.codegen import conditionals, printer
from harness.engine.codegen.derivatives import derive
from harness.engine.codegen.printer import text
from harness.engine.compile import compile_model
from harness.engine.kernel_names import LANES
from harness.models.assembly.assemble import assemble
from harness.models.assembly.expressions import any_of, present

EFFECTS = ("crosswind", "lateral_load_transfer", "liquid_slosh", "steering_lag")
a, b, flag, other = sp.symbols("a b has_one has_other", real=True)
s, t, g = sp.symbols("s t g", real=True)


@pytest.fixture(scope="module")
def models():
    """Return the car's kernels with the effects always computed, and with effects that may be absent."""
    built = [assemble("car", "linear", EFFECTS, "car_navigation", optional=o) for o in (False, True)]
    return [compile_model(m, 0.01, "heun", jacobians=o) for m, o in zip(built, (True, False), strict=True)]


def values(model, rng, amplitudes) -> np.ndarray:
    """Return parameters within their bounds; amplitudes that are not listed are neutral."""
    rows = []
    for p in model.parameters:
        low, high = max(p.lower, -10.0), min(p.upper, 10.0)
        drawn = rng.uniform(low + 0.2 * (high - low), high - 0.2 * (high - low), LANES)
        rows.append(drawn if p.neutral is None or p.name in amplitudes else np.full(LANES, p.neutral))
    return np.array(rows)


@pytest.mark.parametrize(
    "amplitudes", [(), ("crosswind_force",), ("slosh_share", "steering_lag"), ("crosswind_moment", "slosh_share")]
)
def test_same_numbers_with_and_without_branches(models, amplitudes) -> None:
    rng = np.random.default_rng(3)
    p = values(models[0].model, rng, amplitudes)
    assert models[0].model.parameter_names == models[1].model.parameter_names
    x, u = rng.normal(0.0, 0.1, (models[0].nx, LANES)), rng.uniform(1.0, 12.0, (models[0].nu, LANES))
    found = []
    for m in models:
        ahead, y, work = np.empty_like(x), np.empty((m.ny, LANES)), np.empty((m.nw, LANES))
        m.kernels.next_state(x, u, m.constants(p), ahead, work)
        m.kernels.output(x, u, m.constants(p), y)
        found.append((ahead, y))
    own = [models[0].model.states.index(n) for n in models[0].model.states if not skipped(n, amplitudes)]
    np.testing.assert_allclose(found[1][0][own], found[0][0][own], rtol=1e-12, atol=1e-14)
    np.testing.assert_allclose(found[1][1], found[0][1], rtol=1e-12, atol=1e-14)


def skipped(state: str, amplitudes) -> bool:
    """Whether a state belongs to an effect that is absent; it rests, and nothing reads it."""
    owners = {"slosh": "slosh_share", "steering_lag": "steering_lag", "lagged": "steering_lag"}
    return any(word in state and owner not in amplitudes for word, owner in owners.items())


def test_rows_behind_the_constants_say_which_effects_are_in_force(models) -> None:
    model = models[1]
    p = values(model.model, np.random.default_rng(1), ("crosswind_moment",))
    rows = model.constants(p)[model.kernels.CONSTANTS :]
    assert len(rows) == len(model.kernels.CONDITIONS)
    for flags, row in zip(model.kernels.CONDITIONS, rows, strict=True):
        assert (row == ("has_crosswind" in flags)).all()
    assert ("has_crosswind",) in model.kernels.CONDITIONS


def there(condition: frozenset[str]) -> str:
    return " or ".join(sorted(condition))


def test_what_an_absent_effect_reads_is_computed_and_loaded_under_its_flag_only() -> None:
    assignments = {s: sp.sin(a), t: sp.cos(b), g: present(flag, s * t, t)}
    loads = {a: "get(x, 0)", b: "get(x, 1)"}
    assert conditionals.lines(assignments, [g], text, loads, there, {}) == [
        "b = get(x, 1)",
        "t = cos(b)",
        "if has_one:  # has_one",
        "    a = get(x, 0)",
        "    s = sin(a)",
        "    g = s*t",
        "else:",
        "    g = t",
    ]


def test_what_is_read_without_the_effect_is_loaded_there() -> None:
    assignments = {g: present(flag, a + b, b)}
    loads = {a: "get(x, 0)", b: "get(x, 1)"}
    assert conditionals.lines(assignments, [g, a], text, loads, there, {}) == [
        "if has_one:  # has_one",
        "    a = get(x, 0)",
        "    b = get(x, 1)",
        "    g = a + b",
        "else:",
        "    b = get(x, 1)",
        "    g = b",
        "a = get(x, 0)",
    ]


def test_what_is_stored_at_once_is_not_computed_without_the_effect() -> None:
    assignments = {s: sp.sin(a), g: present(flag, s * b, sp.Integer(0))}
    loads = {a: "get(x, 0)", b: "get(x, 1)"}
    assert conditionals.lines(assignments, [b], text, loads, there, {g: "dx, 3"}) == [
        "if has_one:  # has_one",
        "    a = get(x, 0)",
        "    b = get(x, 1)",
        "    s = sin(a)",
        "    put(b*s, dx, 3)",
        "b = get(x, 1)",
    ]


def test_states_of_absent_effects_rest_wherever_they_are(models) -> None:
    """They are copied, through all stages: whatever the work array holds, and whether or not they are zero."""
    branching, rng = models[1], np.random.default_rng(5)
    p = values(branching.model, rng, ("slosh_share",))
    x, u = rng.normal(0.0, 0.1, (branching.nx, LANES)), rng.uniform(1.0, 12.0, (branching.nu, LANES))
    rests, found = np.array([skipped(n, ("slosh_share",)) for n in branching.model.states]), []
    for rubbish in (0.0, np.nan):
        ahead, work = np.full_like(x, np.nan), np.full((branching.nw, LANES), rubbish)
        branching.kernels.next_state(x, u, branching.constants(p), ahead, work)
        np.testing.assert_array_equal(work[: branching.nx][rests], x[rests])  # at the last stage
        found.append(ahead)
    assert 0 < rests.sum() < branching.nx
    np.testing.assert_array_equal(found[0], found[1])
    np.testing.assert_array_equal(found[0][rests], x[rests])
    assert (found[0][~rests] != x[~rests]).all()


def test_one_flag_of_several_suffices() -> None:
    assignments = {s: sp.sin(a), g: present(any_of([other, flag]), s, sp.Integer(1))}
    lines = conditionals.lines(assignments, [g], text, {}, there, {})
    assert lines[0] == "if has_one or has_other:  # has_one or has_other"
    assert lines[-1] == "    g = splat(1.0)"


def test_constants_stay_constants_where_only_effects_make_them_vary() -> None:
    """The load of an axle is a constant until an effect shifts it, and so is what a tyre makes of it."""
    eqs = derive(assemble("semitrailer", "magic_formula", ("lateral_load_transfer",), optional=True), jacobians=False)
    always = [e for e in eqs.assignments.values() if not isinstance(e, present)]
    chosen = [e for e in eqs.assignments.values() if isinstance(e, present)]
    assert chosen
    assert all(e.args[2].free_symbols <= {*eqs.constants} for e in chosen if "lateral_load" in e.args[0].name)
    assert always


def test_what_solves_a_loop_stands_in_one_branch_and_gives_nothing_to_others() -> None:
    """The compliance of the steering solves the force of an axle whose own effects read the same."""
    files = ("body_roll", "steering_compliance", "tyre_relaxation")
    eqs = derive(assemble("car", "magic_formula", files, optional=True), jacobians=False)
    code = printer.kernel(eqs, "derivative", "x, u, c, dx", printer.vector("dx", eqs.derivatives)).splitlines()
    conditions = [line.partition("#")[2].split() for line in code if "  # " in line]
    assert conditions.count(["has_steering_compliance"]) == 1
    assert not [c for c in conditions if "has_steering_compliance" in c and len(c) > 1]
