"""Contract of a file in ``harness/estimation/methods``, and the defaults of what it need not export.

``workspace()``                 kernel: scratch arrays of a run
``step(before, u_before, u, y, belief, work, after, info)``
                                kernel: one sample; reads ``before``, writes ``after`` and ``info``

and, where the default in ``DEFAULTS`` does not serve,

``Settings``                    pydantic model of its settings in a study; by default it has none
``HAS_COVARIANCE``              whether it states an error covariance
``tuning(settings, nx, ny)``    the numbers its kernel reads
``memory_size(settings, compiled)``
                                rows of memory it carries in addition to mean and covariance, all zero at first
``write_covariance(state, work)``
                                kernel: writes the covariance of a state that ``step`` left, for an estimator that goes
                                on without it; called only where somebody reads it

and of an estimator that is made for particular signals, such as a trained network,

``fit(settings, compiled, folder)``
                                in place of ``tuning``: the numbers its kernel reads, for this compiled model; files
                                its settings name are relative to the folder. ``UserError`` if the model does not fit
``estimates(settings, folder)`` the signals it estimates; it has no score for any other target
``files(settings, folder)``     the files it reads: a store is not resumed with others

and of one whose memory begins with other than zeros, such as random numbers,

``first_memory(settings, nx, ny, seeds)``
                                in place of ``memory_size``: the memory before the first step, ``(rows, LANES)``;
                                ``seeds`` holds a ``numpy.random.SeedSequence`` per lane

and of one that is no kernel, in place of ``workspace`` and ``step``,

``filter_of(settings, compiled, folder)``
                                the filter (``harness.runner.contract.Filter``) that believes in a compiled model

Three flags tell the contract suite what to expect: ``KALMAN_TYPE`` (equals the textbook filter on a linear model),
``LINEAR`` (assumes a linear model, so it need not follow any other) and ``MONTE_CARLO`` (results scatter with the
seed).
``DEVICES`` names the devices (``harness.study.devices``) on which its scores were compared with the processor's and
differ by rounding (docs/gpu.md). ``REMEDY`` says what a filter does that needs no idea of what is wrong and may stand
in place of one of the Kalman type (``harness remedy``). ``IN_TRACE`` is the place of an estimator among those that a
trace tries unless others are asked for; 0, it is not tried (``harness trace``).

A kernel may call any function that its file defines or imports by name, such as those that several estimators share;
they are compiled with it from their source, behind the kernels of the model the estimator believes in
(``harness.engine.kernel_names`` lists the names that these offer, ``harness.engine.kernel_source`` says what else may
be used).
"""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

from pydantic import BaseModel, ConfigDict

from harness.config.roles import ESTIMATORS
from harness.engine.kernel_names import INPUT_ERRORS
from harness.models.assembly.assemble import StateSpaceModel
from harness.models.signals import turn_of
from harness.runner import filter_loop


class NoSettings(BaseModel):
    """No settings but the noise it believes in."""

    model_config = ConfigDict(extra="forbid")


DEFAULTS: dict[str, Any] = {
    "Settings": NoSettings,
    "HAS_COVARIANCE": True,
    "KALMAN_TYPE": False,
    "LINEAR": False,
    "MONTE_CARLO": False,
    "DEVICES": (),
    "REMEDY": "",
    "IN_TRACE": 0,
    "tuning": lambda settings, nx, ny: [0.0],
    "memory_size": lambda settings, compiled: 0,
    "files": lambda settings, folder: (),
    "write_covariance": filter_loop.write_covariance,
}
"""What a file need not export."""


def load_estimator(kind: str) -> SimpleNamespace:
    """Return the exports of an estimator's file, those it does not state by their defaults.

    Raises:
        ModelError: If there is none of that name or it lacks an export.
    """
    return SimpleNamespace(**{**DEFAULTS, **vars(ESTIMATORS.load(kind))})


def kernel_kinds() -> tuple[str, ...]:
    """Return the estimators that are kernels."""
    return tuple(kind for kind in ESTIMATORS.names() if not hasattr(load_estimator(kind), "filter_of"))


def traced() -> tuple[str, ...]:
    """Return the estimators that a trace tries unless others are asked for (``IN_TRACE``)."""
    places = {kind: load_estimator(kind).IN_TRACE for kind in ESTIMATORS.names()}
    return tuple(sorted((kind for kind, place in places.items() if place), key=lambda kind: places[kind]))


def kernels_of(
    file: SimpleNamespace, model: StateSpaceModel | None = None, input_errors: bool = False
) -> dict[Any, Any]:
    """Return the kernels of an estimator's file by what stands for them in the loops over time.

    Args:
        file: From ``load_estimator``.
        model: What it believes in: parameters among its states are settled after each step, and innovations of periodic
            measurements are taken modulo a turn.
        input_errors: Whether it is told what the errors of its inputs do (``Belief.input_errors``).
    """
    kernels = {
        INPUT_ERRORS: int(input_errors),
        filter_loop.workspace: file.workspace,
        filter_loop.step: file.step,
        filter_loop.write_covariance: file.write_covariance,
    }
    if model is not None and model.within:
        by_gain = filter_loop.settle_parameters if file.KALMAN_TYPE else filter_loop.bound_parameters
        kernels[filter_loop.settle] = by_gain
    if model is not None and any(map(turn_of, model.outputs)):
        kernels[filter_loop.nearest_turn] = filter_loop.nearest_turns
    return kernels
