"""Structural observability of a model along a drive (Ziaukas 2023, section 2.2 and Bild 5.2).

At every sample of a simulated drive the model is linearised and only the pattern of its non-zero entries is
kept. Two criteria follow from the pattern alone, both necessary for observability:

1. every state is *output-connected*: a path of couplings leads from it to a measured output;
2. the structural rank of ``(S_A; S_C)`` equals the number of states (2.7).

After an excitation the couplings that it caused decay, but never become exactly zero. An entry therefore
counts as zero when its magnitude is at most ``tolerance`` times the largest it has along the drive. Each
entry is compared with itself, so that neither units nor the size of parameters matter, and an entry that is
the same all along the drive never vanishes. ``docs/observability.md`` shows what depends on this rule.
"""

from __future__ import annotations

import functools
from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

import numpy as np
import sympy as sp
import xarray as xr
from numpy.typing import NDArray
from scipy.sparse import csr_array
from scipy.sparse.csgraph import structural_rank

from harness.common.arrays import Floats, Mask
from harness.common.errors import UserError
from harness.engine.codegen.derivatives import derive
from harness.models.assembly.assemble import StateSpaceModel, symbol
from harness.models.contracts import Profile
from harness.models.signals import SIGNALS
from harness.simulation.simulate import first_state

TOLERANCE = 1e-4
"""An entry below this fraction of its own largest magnitude along the drive counts as zero."""

DRIVEN = ("steering_wheel_angle", "speed")
"""What a drive prescribes (``harness.models.contracts.Profile``)."""


class Linearisation(NamedTuple):
    """The linearised model along a drive.

    Attributes:
        states: (samples, nx), in the units of the signals.
        a: (samples, nx, nx), d(dx/dt)/dx (2.3).
        c: (samples, ny, nx), dy/dx (2.4).
    """

    states: Floats
    a: Floats
    c: Floats


def synthetic_manoeuvre(step: float = 0.01) -> Profile:
    """Return the drive of Bild 5.2: straight, two periods of a steering sine, straight, all at 10 m/s.

    The thesis draws it without numbers; duration, frequency (0.25 Hz) and amplitude (60 deg at the steering
    wheel, about 1.2 m/s^2 on the reference truck) are this project's choice.

    Args:
        step: Sample time in s.
    """
    time = np.arange(round(20.0 / step) + 1, dtype=np.float64) * np.float64(step)
    excited = (time > 4.0) & (time < 12.0)
    sine = np.deg2rad(60.0) * np.sin(2 * np.pi * 0.25 * (time - 4.0))
    return Profile(time, np.where(excited, sine, 0.0), np.full_like(time, 10.0))


def structural_observability(
    model: StateSpaceModel, values: Mapping[str, float], profile: Profile, tolerance: float = TOLERANCE
) -> xr.Dataset:
    """Check both criteria of structural observability at every sample of a drive.

    Args:
        model: The model as the estimator sees it: unknown inputs are states already (``StateSpaceModel.augment``).
            States that the profile prescribes follow it; all others start at zero and are simulated by Euler
            steps.
        values: Value of every parameter in SI units.
        profile: The drive; its sample time is the Euler step.
        tolerance: Fraction of its own largest magnitude along the drive at which an entry counts as zero.

    Returns:
        Over ``time`` (s) and ``state``: ``connected`` (number of output-connected states, criterion 1),
        ``rank`` (structural rank, criterion 2), ``output_connected`` (time, state), ``observable`` (both
        criteria), and the states and inputs of the drive in SI units.

    Raises:
        UserError: As ``linearise``.
    """
    linear = linearise(model, values, profile)
    a, c = nonzero(linear.a, tolerance), nonzero(linear.c, tolerance)
    reached = output_connected(a, c)
    connected, rank = reached.sum(axis=1), structural_ranks(a, c)
    nx = len(model.states)
    data: dict[str, Any] = {
        "connected": ("time", connected, {"long_name": "connected states", "required": nx}),
        "rank": ("time", rank, {"long_name": "structural rank", "required": nx}),
        "output_connected": (("time", "state"), reached, {"long_name": "state is output-connected"}),
        "observable": ("time", (connected == nx) & (rank == nx), {"long_name": "structurally observable"}),
    }
    drive = {name: getattr(profile, name) for name in DRIVEN}
    for name, samples in {**drive, **dict(zip(model.states, linear.states.T, strict=True))}.items():
        signal = SIGNALS[name]
        data[name] = ("time", samples, {"units": signal.unit, "long_name": signal.meaning})
    return xr.Dataset(
        data,
        coords={"time": ("time", profile.time, {"units": "s"}), "state": list(model.states)},
        attrs={
            "model": model.name,
            "outputs": ", ".join(model.outputs),
            "tolerance": tolerance,
            "source": "Ziaukas 2023, section 2.2, Bild 5.2",
        },
    )


def linearise(model: StateSpaceModel, values: Mapping[str, float], profile: Profile) -> Linearisation:
    """Simulate a drive as ``structural_observability`` does; return the exact Jacobians at every sample.

    Raises:
        UserError: If a parameter, an input or an output is missing, or the simulation diverges.
    """
    if not model.outputs:
        raise UserError(f"model '{model.name}' measures nothing; choose a file of models/sensors")
    missing = [n for n in model.parameter_names if n not in values]
    if missing:
        raise UserError(f"model '{model.name}': no value for parameter {', '.join(missing)}")
    p = np.array([values[n] for n in model.parameter_names], dtype=float)
    u = _inputs(model, profile)
    x = _simulate(model, p, u, profile)
    samples, nx = x.shape
    a, c = np.zeros((samples, nx, nx)), np.zeros((samples, len(model.outputs), nx))
    for matrix, (positions, evaluate) in zip((a, c), _jacobians(model), strict=True):
        with np.errstate(all="ignore"):  # NumPy evaluates both branches of a case distinction
            entries = evaluate(x.T, u.T, p)
        for (i, j), entry in zip(positions, entries, strict=True):
            matrix[:, i, j] = entry
    return Linearisation(x, a, c)


def nonzero(entries: Floats, tolerance: float) -> Mask:
    """Return which entries ``(samples, rows, columns)`` exceed a fraction of their own peak."""
    size = np.abs(entries)
    return size > tolerance * size.max(axis=0)


def output_connected(a: Mask, c: Mask) -> Mask:
    """Return for every state whether a path of couplings leads from it to an output (criterion 1).

    Args:
        a: ``(samples, nx, nx)``; row i reads column j.
        c: ``(samples, ny, nx)``.

    Returns:
        ``(samples, nx)``.
    """
    reached = np.asarray(c.any(axis=1))
    for _ in range(a.shape[-1]):
        further = np.asarray(reached | (a & reached[:, :, None]).any(axis=1))
        if (further == reached).all():
            break
        reached = further
    return reached


def structural_ranks(a: Mask, c: Mask) -> NDArray[np.int64]:
    """Return the structural rank of ``(S_A; S_C)`` at every sample (2.7).

    Args:
        a: ``(samples, nx, nx)``.
        c: ``(samples, ny, nx)``.

    Returns:
        ``(samples,)``. Each distinct pattern is ranked once; a drive holds few of them.
    """
    stacked = np.concatenate([a, c], axis=1)
    patterns, which = np.unique(stacked.reshape(len(stacked), -1), axis=0, return_inverse=True)
    shape = stacked.shape[1:]
    ranks = [structural_rank(csr_array(pattern.reshape(shape).astype(float))) for pattern in patterns]
    return np.array(ranks, dtype=np.int64)[np.ravel(which)]


def delays(dataset: xr.Dataset) -> dict[str, float]:
    """Return how long after the steering came to rest each criterion is violated for good, in s.

    ``nan`` if it still holds at the end of the drive; 0 if it is violated from the end of the steering on.
    """
    time, steering = dataset["time"].to_numpy(), dataset["steering_wheel_angle"].to_numpy()
    moving = np.flatnonzero(steering != steering[-1])
    rest = moving[-1] + 1 if moving.size else 0
    result = {}
    for criterion in ("connected", "rank"):
        met = np.flatnonzero(dataset[criterion].to_numpy() == dataset[criterion].attrs["required"])
        last = max(int(met[-1]) + 1, rest) if met.size else rest
        result[criterion] = float(time[last] - time[rest]) if last < len(time) else float("nan")
    return result


def _inputs(model: StateSpaceModel, profile: Profile) -> Floats:
    """Return the inputs (samples, nu) of a model from a drive; rates by differences of the samples."""
    signals = {name: getattr(profile, name) for name in ("time", *DRIVEN)} | profile.further
    step = (profile.time[-1] - profile.time[0]) / (len(profile.time) - 1)
    columns = []
    for name in model.inputs:
        source = model.rates.get(name, name)
        if source not in signals:
            raise UserError(f"model '{model.name}': the drive gives no '{source}', which the model needs")
        samples = signals[source]
        columns.append(np.gradient(samples, step) if name in model.rates else samples)
    return np.column_stack(columns) if columns else np.zeros((len(profile.time), 0))


def _simulate(model: StateSpaceModel, p: Floats, u: Floats, profile: Profile) -> Floats:
    """Return the states (samples, nx) by Euler from the first state; those the profile prescribes are set to it."""
    prescribed = {
        i: getattr(profile, name)
        for i, (name, rate) in enumerate(zip(model.states, model.derivatives, strict=True))
        if rate == (symbol(name) if model.discrete else 0) and name in DRIVEN
    }
    drift = _drift(model)
    step = (profile.time[-1] - profile.time[0]) / (len(profile.time) - 1)
    x = np.zeros((len(profile.time), len(model.states)))
    x[0] = first_state(model, p[:, None], profile)[:, 0]
    for i, samples in prescribed.items():
        x[:, i] = samples
    simulated = [i for i in range(x.shape[1]) if i not in prescribed]
    for k in range(len(x) - 1):
        try:
            rate = np.array(drift(x[k].tolist(), u[k].tolist(), p.tolist()), dtype=float)
        except (OverflowError, ValueError, ZeroDivisionError):
            rate = np.full(x.shape[1], np.nan)
        x[k + 1, simulated] = rate[simulated] if model.discrete else x[k, simulated] + step * rate[simulated]
        if not np.isfinite(x[k + 1]).all():
            raise UserError(
                f"model '{model.name}' diverges at {profile.time[k + 1]:g} s of the drive; "
                "check its parameters, or choose a calmer drive"
            )
    return x


def _arguments(model: StateSpaceModel) -> list[list[sp.Symbol]]:
    return [[symbol(n) for n in part] for part in (model.states, model.inputs, model.parameter_names)]


@functools.lru_cache(maxsize=8)
def _drift(model: StateSpaceModel) -> Callable[..., list[float]]:
    ports = [(symbol(n), e) for n, e in model.ports.items()]
    modules = [{"Heaviside": lambda x, half=0.5: 1.0 if x > 0 else half if x == 0 else 0.0}, "math"]
    # The ports are the shared subexpressions, in order of use already.
    return sp.lambdify(_arguments(model), list(model.derivatives), modules, cse=lambda e: (ports, e))


@functools.lru_cache(maxsize=8)
def _jacobians(model: StateSpaceModel) -> list[tuple[list[tuple[int, int]], Callable[..., list[Any]]]]:
    """Return positions and values of the non-zero entries of both Jacobians, all samples in one call."""
    equations = derive(model)
    shared = [*equations.constants.items(), *equations.assignments.items()]
    result = []
    for entries in (equations.state_jacobian, equations.output_state_jacobian):
        function = sp.lambdify(_arguments(model), list(entries.values()), "numpy", cse=lambda e: (shared, e))
        result.append((list(entries), function))
    return result
