"""Estimators that are networks in ONNX, run by onnxruntime in one thread.

The one input that is no state takes ``(1, features)`` or a window ``(1, n, features)`` of the last ``n`` samples, the
newest last; features are inputs, then measurements. A missing measurement is the last one that there was, 0 before the
first; samples before the first are 0. A recurrent network has in ``settings`` a table ``state`` that names for each
input that is a state the output that it becomes; they begin with zeros. Outputs that are no states are the estimates,
then variances and NIS as far as they are stated. Where the first dimension is free and there is no state, all samples
of a run are one call.
"""

from __future__ import annotations

import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from harness.common.arrays import Floats
from harness.common.errors import UserError
from harness.external.bodies import RunEstimates, Timed

TYPES = {"tensor(float)": np.float32, "tensor(double)": np.float64}


class NetworkEstimator:
    """A network as an estimator.

    Args:
        loader: ``file`` is the path of the network.

    Raises:
        UserError: If onnxruntime is not there, or the network cannot be read or has other inputs.
    """

    def __init__(self, loader: Mapping[str, Any]) -> None:
        self._name = Path(loader["file"]).name
        self._session = _session(loader["file"], self._name)
        settings = dict(loader.get("settings", {}))
        self._state: dict[str, str] = settings.pop("state", {})
        if settings:
            raise UserError(f"{self._name}: a network has no setting '{next(iter(settings))}', only a table 'state'")
        inputs = {i.name: i for i in self._session.get_inputs()}
        outputs = [o.name for o in self._session.get_outputs()]
        for entry, becomes in self._state.items():
            if entry not in inputs or becomes not in outputs:
                raise UserError(
                    f"{self._name}: state: there is no input '{entry}' with an output '{becomes}'; it has the inputs "
                    f"{', '.join(inputs)} and the outputs {', '.join(outputs)}"
                )
            if inputs[entry].type not in TYPES:
                raise UserError(f"{self._name}: state '{entry}' is {inputs[entry].type}; make it one of floats")
        features = [i for name, i in inputs.items() if name not in self._state]
        if len(features) != 1 or len(features[0].shape) not in (2, 3) or features[0].type not in TYPES:
            said = ", ".join(f"{i.name} {i.shape} {i.type}" for i in features) or "none"
            raise UserError(
                f"{self._name}: takes one input (1, features) or (1, window, features) of floats and its states, "
                f"this has {said}; name states in settings = {{ state = {{ in = 'out' }} }}"
            )
        self._given = [name for name in outputs if name not in self._state.values()]
        self._input, self._type = features[0].name, TYPES[features[0].type]
        self._window = features[0].shape[1] if len(features[0].shape) == 3 else None
        if self._window is not None and not isinstance(self._window, int):
            raise UserError(f"{self._name}: the window of input '{self._input}' has no fixed length")
        self._width = features[0].shape[-1]
        self._at_once = not isinstance(features[0].shape[0], int) and not self._state
        self._first = {
            name: np.zeros([n if isinstance(n, int) else 1 for n in inputs[name].shape], TYPES[inputs[name].type])
            for name in self._state
        }
        variances, nis = bool(loader["variances"]), bool(loader["nis"])
        self._parts = 1 + (variances or nis) + nis
        if len(self._given) < self._parts:
            raise UserError(f"{self._name}: has the outputs {', '.join(self._given)}, not {self._parts} as stated")
        self._estimates = self._session.get_outputs()[outputs.index(self._given[0])].shape[-1]

    def declared(self) -> dict[str, Any]:
        """Return the sizes that the network fixes."""
        sizes = {"features": self._width, "estimates": self._estimates, "values": 0}
        return {"sizes": {name: size for name, size in sizes.items() if isinstance(size, int)}}

    def estimate(self, step: float, inputs: Floats, measurements: Floats, values: Floats, seed: int) -> RunEstimates:
        """Run over what was measured, see ``harness.external.bodies.EstimatorBody``."""
        table = np.column_stack([inputs, _held(measurements)]).astype(self._type)
        if self._window is not None:
            before = np.zeros((self._window - 1, table.shape[1]), self._type)
            table = np.lib.stride_tricks.sliding_window_view(np.concatenate([before, table]), self._window, axis=0)
            table = np.ascontiguousarray(np.swapaxes(table, 1, 2))
        wanted = self._given[: self._parts]
        parts = self._session.run(wanted, {self._input: table}) if self._at_once else self._stepped(table, wanted)
        samples = len(table)
        rows = [np.asarray(part, dtype=float).reshape(samples, -1) for part in parts]
        estimates, variances, nis = (*rows, None, None)[:3]
        assert estimates is not None
        return RunEstimates(estimates, variances, None if nis is None else nis[:, 0], samples)

    def timed(self, step: float, inputs: Floats, measurements: Floats, values: Floats, begins: bool) -> Timed:
        """Take samples, of a new run if it begins; return how long each took and an empty one does, in ns."""
        if begins:
            self._feed, self._last = dict(self._first), np.zeros(measurements.shape[1])
            self._recent = np.zeros((self._window or 1, self._width), self._type)
        clock, ticks, asked = time.perf_counter_ns, [], [self._given[0], *self._state.values()]
        for u, y in zip(inputs, measurements, strict=True):
            self._last = np.where(np.isnan(y), self._last, y)
            self._recent = np.vstack([self._recent[1:], np.append(u, self._last)[None].astype(self._type)])
            self._feed[self._input] = self._recent if self._window is None else self._recent[None]
            begin = clock()
            estimates, *state = self._session.run(asked, self._feed)
            ticks.append(clock() - begin)
            self._feed.update(zip(self._state, state, strict=True))
        return np.array(ticks, dtype=float), 0.0, np.ravel(estimates).astype(float)

    def _stepped(self, table: Any, wanted: list[str]) -> list[Any]:
        """Return the outputs of one call for each sample, states handed on."""
        session, feed, asked = self._session, dict(self._first), [*wanted, *self._state.values()]
        entries, count = list(self._state), len(wanted)
        kept = []
        for k in range(len(table)):
            feed[self._input] = table[k : k + 1]
            answers = session.run(asked, feed)
            feed.update(zip(entries, answers[count:], strict=True))
            kept.append([np.ravel(a) for a in answers[:count]])
        return [np.stack(part) for part in zip(*kept, strict=True)]


def _session(file: str, name: str) -> Any:
    try:
        import onnxruntime
    except ImportError:
        raise UserError(f"{name}: a network needs onnxruntime: pip install 'robustness-harness[onnx]'") from None
    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = options.inter_op_num_threads = 1
    options.log_severity_level = 3
    try:
        return onnxruntime.InferenceSession(file, options, providers=["CPUExecutionProvider"])
    except Exception as error:  # onnxruntime's own have no common class
        raise UserError(f"{name}: cannot be read as a network: {' '.join(str(error).split())[:300]}") from None


def _held(measurements: Floats) -> Floats:
    """Return measurements with the last one where one is missing, 0 before the first."""
    there = np.isfinite(measurements)
    last = np.maximum.accumulate(np.where(there, np.arange(len(measurements))[:, None], -1), axis=0)
    held = np.take_along_axis(measurements, np.maximum(last, 0), axis=0)
    return np.where(last < 0, 0.0, held)


def load(loader: Mapping[str, Any]) -> NetworkEstimator:
    """Return the estimator that a loader makes, see ``harness.external.bodies.load``."""
    return NetworkEstimator(loader)
