"""Kalman filters whose model is an FMU for model exchange, in its worker process.

States are got and set, so that one instance serves all sigma points and members and is initialised once a run. The
unscented filter is that of ``harness.estimation.methods.ukf`` with points redrawn behind the process noise (van der
Merwe 2004), the ensemble filter that of ``enkf`` there (Evensen 1994). State events inside a step are not handled.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from harness.common.arrays import Floats
from harness.common.errors import UserError, closest
from harness.common.files import read_toml
from harness.engine.codegen.integrators import TABLEAUX
from harness.external.bodies import RunEstimates
from harness.external.description import ExternalParameter, Port
from harness.external.fmu.instance import Failed, Instance, Library, status_word
from harness.external.fmu.model import FmuModel, read_model
from harness.external.fmu.particles import FmuParticles
from harness.external.fmu.plants import compiled, references, to_signals, to_variables
from harness.external.fmu.read import describe, scalar_variable

FILTERS = ("ukf", "enkf")

SETTINGS = {
    "process_noise", "first_variance", "measurement_noise", "parameters", "integrator", "substeps", "alpha", "beta",
    "kappa", "members", "inflation",
}  # fmt: skip
"""Settings besides ``filter``: variances per sample by state variable in the FMU's units, the same of the first state,
variances by signal in SI, values of parameters in the FMU's units; the others as those of the two estimators."""

MEASUREMENT_NOISE = "measurement_noise."
"""Values of the belief that are the variances of what is measured, where the settings state none."""


class FmuFilter:
    """A filter that believes in an FMU (``harness.external.bodies.EstimatorBody``).

    Args:
        path: The FMU.
        ports: ``inputs`` of the FMU, ``measurements`` and ``estimates``, which are outputs of it.
        kind: One of ``FILTERS``.
        settings: Those of ``SETTINGS`` that are stated.
        values: Names of the values that a run brings: parameters of the FMU, and the noise of what is measured.
        parameters: Those that the FMU has.

    Raises:
        UserError: If it is no FMU for model exchange, or a setting does not fit.
    """

    def __init__(
        self,
        path: Path,
        ports: Mapping[str, Sequence[Port]],
        kind: str,
        settings: Mapping[str, Any],
        values: Sequence[str] = (),
        parameters: Sequence[ExternalParameter] = (),
    ) -> None:
        self._where = f"{path}: settings"
        if kind not in FILTERS:
            raise UserError(f"{self._where}.filter: '{kind}' is none; there are: {', '.join(FILTERS)}")
        if unknown := sorted(set(settings) - SETTINGS):
            raise UserError(f"{self._where}: unknown key '{unknown[0]}'; there are: {', '.join(sorted(SETTINGS))}")
        model = read_model(path)
        if len(model.states) != model.derivatives:
            raise UserError(f"{path}: has states in arrays, which a filter cannot tell apart")
        self._library = Library(model, model.interface("model-exchange"))
        self._instance = Instance(self._library)
        self._kind, self._settings, self._values = kind, settings, list(values)
        self._inputs, self._measured, self._estimated = (
            tuple(ports[name]) for name in ("inputs", "measurements", "estimates")
        )
        self._refs_in = references(model, self._inputs)
        self._refs_out = references(model, (*self._measured, *self._estimated))
        self._q = self._variances("process_noise", model)
        self._first = self._variances("first_variance", model) if "first_variance" in settings else self._q
        self._tableau = tuple(np.array(row) for row in TABLEAUX[settings.get("integrator", "euler")])
        self._substeps = int(settings.get("substeps", 1))
        self._parameters = {
            scalar_variable(model, name, f"{self._where}.parameters").reference: float(value)
            for name, value in settings.get("parameters", {}).items()
        }

        there = {p.name: p for p in parameters}
        for name in values:
            if name not in there and not name.startswith(MEASUREMENT_NOISE) and name != "seed":
                raise UserError(f"{path}: values: it has no parameter '{name}'{closest(name, list(there))}")
        self._stated = {i: there[name] for i, name in enumerate(values) if name in there}

    def _variances(self, name: str, model: FmuModel) -> Floats:
        stated = self._settings.get(name, {})
        if unknown := [n for n in stated if n not in model.states]:
            raise UserError(
                f"{self._where}.{name}: '{unknown[0]}' is no continuous state; there are: {', '.join(model.states)}"
            )
        return np.array([float(stated.get(state, 0.0)) for state in model.states])

    def declared(self) -> dict[str, Any]:
        """Return the signals that it is given and gives."""
        groups = {"inputs": self._inputs, "measurements": self._measured, "estimates": self._estimated}
        return {**{n: [p.signal for p in each] for n, each in groups.items()}, "variances": True, "nis": True}

    def estimate(self, step: float, inputs: Floats, measurements: Floats, values: Floats, seed: int) -> RunEstimates:
        """Run over what was measured; see ``harness.external.bodies.EstimatorBody``."""
        given, samples, targets = to_variables(inputs, self._inputs), len(inputs), len(self._estimated)
        estimates, variances = np.full((2, samples, targets), np.nan)
        nis, k = np.full(samples, np.nan), 0
        try:
            x, self._r = (
                self._begin(given[0], values),
                self._noise(dict(zip(self._values, values.tolist(), strict=True))),
            )
            believed = self._ensemble(x, seed) if self._kind == "enkf" else self._points(x, np.diag(self._first))
            for k in range(samples):
                if k:
                    believed = self._ahead(believed, given[k - 1], step, (k - 1) * step)
                    believed, nis[k] = self._correct(believed, given[k], measurements[k], k * step)
                estimates[k], variances[k] = self._published(believed, given[k], k * step)
        except (Failed, np.linalg.LinAlgError) as error:
            return RunEstimates(estimates, variances, nis, k, f"{error} at t = {k * step:g} s")
        return RunEstimates(estimates, variances, nis, samples)

    def _begin(self, first: Floats, values: Floats) -> Floats:
        """Initialise the instance and return its states."""
        library, model = self._library, self._library.model
        of_run = {
            model.variables[p.variable].reference: (float(values[i]) - p.offset) / p.scale
            for i, p in self._stated.items()
        }
        self._instance.begin({**self._parameters, **of_run}, {}, self._refs_in.tolist(), first)
        x, z, info = np.zeros(model.derivatives), np.zeros(model.indicators), np.zeros(32, np.uint8)
        why, status, _ = compiled().handle_event(
            model.version, library.addresses, self._instance.address, x, z, info, info.view(np.float64)
        )
        if why:
            raise Failed(library.words(f"its first event returned {status_word(int(status))}"))
        return x

    def _noise(self, believed: Mapping[str, float]) -> Floats:
        """Return the variances of what is measured, SI."""
        stated = self._settings.get("measurement_noise", {})
        named = {p.signal: stated.get(p.signal, believed.get(MEASUREMENT_NOISE + p.signal)) for p in self._measured}
        for signal, variance in named.items():
            if variance is None:
                raise Failed(f"no variance is known of '{signal}'; state it in measurement_noise")
        return np.array([float(v) for v in named.values() if v is not None])

    def _sent(self, points: Floats, u: Floats, step: float, begin: float) -> Floats:
        """Return states ``(n, nx)`` a sample later."""
        members, library = np.ascontiguousarray(points), self._library
        self._done(
            "evaluating its derivatives",
            compiled().many_ahead(
                library.model.version, library.addresses, self._instance.address, begin, step / self._substeps,
                self._substeps, self._tableau, u, self._refs_in, members,
            ),
        )  # fmt: skip
        return members

    def _seen(self, points: Floats, u: Floats, time: float) -> tuple[Floats, Floats]:
        """Return what states ``(n, nx)`` measure and publish, SI: ``(n, ny)``, ``(n, targets)``."""
        library, ny = self._library, len(self._measured)
        outputs = np.zeros((len(points), len(self._refs_out)))
        self._done(
            "reading its outputs",
            compiled().many_outputs(
                library.model.version, library.addresses, self._instance.address, time, u, self._refs_in,
                np.ascontiguousarray(points), self._refs_out, outputs,
            ),
        )  # fmt: skip
        signals = to_signals(outputs, (*self._measured, *self._estimated))
        return signals[:, :ny], signals[:, ny:]

    def _done(self, what: str, status: int) -> None:
        if status > 1:
            self._instance.discard()
            raise Failed(self._library.words(f"{what} returned {status_word(int(status))}"))

    @property
    def _weights(self) -> tuple[float, Floats, Floats]:
        """Squared distance of the points, weights of mean and covariance (Ziaukas 2.20, 2.21)."""
        n = self._library.model.derivatives
        alpha, beta, kappa = (
            float(self._settings.get(k, v)) for k, v in (("alpha", 1.0), ("beta", 2.0), ("kappa", 0.0))
        )
        total = alpha**2 * (n + kappa)
        if not total > 0.0:
            raise Failed(f"alpha^2 (n + kappa) = {total:g} must be positive")
        mean = np.full(2 * n + 1, 0.5 / total)
        mean[0] = (total - n) / total
        covariance = mean.copy()
        covariance[0] += 1.0 - alpha**2 + beta
        return total, mean, covariance

    def _points(self, mean: Floats, covariance: Floats) -> Floats:
        """Return sigma points ``(2 nx + 1, nx)``, the mean first (2.22)."""
        total, *_ = self._weights
        kept = np.diag(covariance) > 0.0  # a state that is certain has no points of its own
        root = np.zeros_like(covariance)
        root[np.ix_(kept, kept)] = np.linalg.cholesky(covariance[np.ix_(kept, kept)])
        offsets = np.sqrt(total) * root.T
        return np.concatenate([mean[None], mean + offsets, mean - offsets])

    def _ensemble(self, mean: Floats, seed: int) -> Floats:
        self._rng = np.random.default_rng(seed)
        count = int(self._settings.get("members", 64))
        return mean + np.sqrt(self._first) * self._rng.standard_normal((count, len(mean)))

    def _ahead(self, points: Floats, u: Floats, step: float, begin: float) -> Floats:
        """Return points or members of the prediction: with the process noise, and with points redrawn."""
        sent = self._sent(points, u, step, begin)
        if self._kind == "enkf":
            members = sent + np.sqrt(self._q) * self._rng.standard_normal(sent.shape)
            mean = members.mean(axis=0)
            return mean + float(self._settings.get("inflation", 1.0)) * (members - mean)
        _, weights, spread = self._weights
        mean = weights @ sent
        return self._points(mean, (spread * (sent - mean).T) @ (sent - mean) + np.diag(self._q))

    def _correct(self, points: Floats, u: Floats, y: Floats, time: float) -> tuple[Floats, float]:
        """Return points or members corrected by what was measured, NaN where missing, and the NIS."""
        there = ~np.isnan(y)
        if not there.any():
            return points, np.nan
        outputs, r = self._seen(points, u, time)[0][:, there], self._r[there]
        if self._kind == "enkf":
            weights = np.full(len(points), 1.0 / len(points))
            spread = np.full(len(points), 1.0 / (len(points) - 1))
        else:
            _, weights, spread = self._weights
        mean, predicted = weights @ points, weights @ outputs
        dx, dy = points - mean, outputs - predicted
        innovation, S = y[there] - predicted, (spread * dy.T) @ dy + np.diag(r)
        gain = np.linalg.solve(S, (spread * dy.T) @ dx).T
        nis = float(innovation @ np.linalg.solve(S, innovation))
        if self._kind == "ukf":
            covariance = (spread * dx.T) @ dx - gain @ S @ gain.T
            return self._points(mean + gain @ innovation, 0.5 * (covariance + covariance.T)), nis
        noise = np.sqrt(r) * self._rng.standard_normal(outputs.shape)
        return points + (y[there] + noise - noise.mean(axis=0) - outputs) @ gain.T, nis

    def _published(self, points: Floats, u: Floats, time: float) -> tuple[Floats, Floats]:
        """Return estimates and their variances."""
        published = self._seen(points, u, time)[1]
        if self._kind == "enkf":
            return published.mean(axis=0), published.var(axis=0, ddof=1)
        _, weights, spread = self._weights
        return published[0], np.maximum(spread @ (published - weights @ published) ** 2, 0.0)


def load(loader: Mapping[str, Any]) -> FmuFilter | FmuParticles:
    """Return the filter that a loader makes.

    Args:
        loader: ``file`` is the path of the FMU; ``inputs``, ``measurements`` and ``estimates`` are signals, by default
            all inputs, what has a noise among the ``values``, and all outputs; ``filter`` is one of ``FILTERS``, or
            ``particle``;
            ``settings`` has the path of a ``map`` as of a plant, and those of ``SETTINGS``.

    Raises:
        UserError: If the FMU cannot be loaded, lacks the interface that the filter needs, or a setting does not fit.
    """
    path, settings = Path(loader["file"]), dict(loader["settings"])
    chosen, values = settings.pop("map", None), loader.get("values") or ()
    interface = "co-simulation" if loader["filter"] == "particle" else "model-exchange"
    content = None if chosen is None else read_toml(Path(chosen))
    described = describe(path, content, str(chosen or path), interface=interface)
    outputs = {p.signal: p for p in described.outputs}
    noisy = [n.removeprefix(MEASUREMENT_NOISE) for n in values if n.startswith(MEASUREMENT_NOISE)]
    wanted = {"measurements": noisy, "estimates": list(outputs)}
    ports: dict[str, Sequence[Port]] = {"inputs": described.inputs}
    for group, by_default in wanted.items():
        names = by_default if loader.get(group) is None else loader[group]
        if missing := [n for n in names if n not in outputs]:
            raise UserError(f"{path}: {group}: it publishes no '{missing[0]}'{closest(missing[0], list(outputs))}")
        ports[group] = [outputs[n] for n in names]
    if loader.get("inputs") is not None:
        given = {p.signal: p for p in described.inputs}
        if missing := [n for n in loader["inputs"] if n not in given]:
            raise UserError(f"{path}: inputs: it has no '{missing[0]}'{closest(missing[0], list(given))}")
        ports["inputs"] = [given[n] for n in loader["inputs"]]
    if loader["filter"] != "particle":
        return FmuFilter(path, ports, loader["filter"], settings, values, described.parameters)
    there = {p.name: p for p in described.parameters}
    stated = {i: there[name] for i, name in enumerate(values) if name in there}
    noise = {i: n.removeprefix(MEASUREMENT_NOISE) for i, n in enumerate(values) if n.startswith(MEASUREMENT_NOISE)}
    return FmuParticles(path, described, ports, settings, stated, noise)
