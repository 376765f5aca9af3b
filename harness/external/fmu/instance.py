"""Instance of an FMU in this process: its library, its life up to the loop over time, and what it logs."""

from __future__ import annotations

import ctypes
import os
import tempfile
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from harness.common.arrays import Floats
from harness.common.errors import UserError
from harness.external.fmu import archive
from harness.external.fmu.model import FmuModel, Interface, fmpy

STATUSES = ("ok", "warning", "discard", "error", "fatal", "pending")

_HEARD = ("logStatusWarning", "logStatusDiscard", "logStatusError", "logStatusFatal")
"""Standard log categories that are worth hearing."""

_COMMON = ("FreeInstance", "EnterInitializationMode", "ExitInitializationMode", "Reset", "SetDebugLogging")
_OF_INTERFACE = {
    "co-simulation": ("DoStep",),
    "model-exchange": (
        "SetTime", "SetContinuousStates", "GetContinuousStates", "GetDerivatives", "GetEventIndicators",
        "CompletedIntegratorStep", "EnterEventMode", "NewDiscreteStates", "EnterContinuousTimeMode",
    ),
}  # fmt: skip
_IN_FMI_3 = {
    "GetReal": "GetFloat64",
    "SetReal": "SetFloat64",
    "GetDerivatives": "GetContinuousStateDerivatives",
    "NewDiscreteStates": "UpdateDiscreteStates",
}

_STATES = ("GetFMUState", "SetFMUState", "FreeFMUState")

LOOPED = (
    "SetReal", "GetReal", "SetBoolean", *_OF_INTERFACE["co-simulation"], *_OF_INTERFACE["model-exchange"], *_STATES,
)  # fmt: skip
"""Functions that the loops over time call, in the order of their addresses."""


class Failed(Exception):
    """A call of an FMU that did not do what it was called for."""


class Library:
    """An FMU unpacked, and its library loaded into this process.

    Args:
        model: What it says of itself.
        interface: Whose functions are used.

    Attributes:
        model, interface: As given.
        addresses: Of ``LOOPED``; zero where the interface has no such function ``(functions,)``.
        last_words: Last message of the FMU to its logger.

    Raises:
        UserError: If it cannot be unpacked or loaded, or lacks a function.
    """

    def __init__(self, model: FmuModel, interface: Interface) -> None:
        self.model, self.interface, self.last_words = model, interface, ""
        entry = model.library(interface)
        folder = Path(tempfile.mkdtemp(prefix="fmu-"))
        archive.unpack(model.path, folder)
        self.resources = folder / "resources"
        self.resources.mkdir(exist_ok=True)
        path, here = folder / entry, os.getcwd()
        os.chdir(path.parent)  # where some look for further libraries
        try:
            self._dll = ctypes.CDLL(str(path))
        except OSError as error:
            words = str(error).replace(f"{path}: ", "").replace(str(folder), "")
            raise UserError(f"{model.path}: {entry} cannot be loaded: {words}") from None
        finally:
            os.chdir(here)
        needed = {"SetReal", "GetReal", *_COMMON, *_OF_INTERFACE[interface]}
        if model.version == 2:
            needed |= {"SetupExperiment"}
        if not model.indicators:
            needed -= {"GetEventIndicators"}
        self._functions = {name: self._function(name) for name in needed}
        for name in ("SetBoolean", *_STATES):
            if hasattr(self._dll, self._full(name)):
                self._functions[name] = self._function(name)
        self.addresses = np.array(
            [ctypes.cast(f, ctypes.c_void_p).value if (f := self._functions.get(name)) else 0 for name in LOOPED],
            dtype=np.int64,
        )
        self._callbacks = self._logger()

    def _full(self, name: str) -> str:
        if self.model.version == 3:
            return f"fmi3{_IN_FMI_3.get(name, name)}"
        return f"fmi2{name.replace('FMUState', 'FMUstate')}"

    def _function(self, name: str) -> Any:
        try:
            function = getattr(self._dll, self._full(name))
        except AttributeError:
            raise UserError(f"{self.model.path}: its library lacks the function {self._full(name)}") from None
        function.restype = None if name == "FreeInstance" else ctypes.c_int
        return function

    def _logger(self) -> Any:
        """Return what the FMU is given to log with, in which FMPy formats the messages of FMI 2."""
        if self.model.version == 3:

            def hear(environment: object, status: int, category: bytes, message: bytes) -> None:
                self._hear(message)

            return _imported("fmi3").fmi3LogMessageCallback(hear)
        fmi2 = _imported("fmi2")

        def hear_2(environment: object, name: bytes, status: int, category: bytes, message: bytes) -> None:
            self._hear(message)

        callbacks = fmi2.fmi2CallbackFunctions()
        callbacks.logger = fmi2.fmi2CallbackLoggerTYPE(hear_2)
        callbacks.allocateMemory = fmi2.defaultCallbacks.allocateMemory
        callbacks.freeMemory = fmi2.defaultCallbacks.freeMemory
        if hasattr(fmi2, "addLoggerProxy"):
            fmi2.addLoggerProxy(ctypes.byref(callbacks))
        return callbacks

    def _hear(self, message: bytes | None) -> None:
        text = " ".join((message or b"")[:2000].decode(errors="replace").split())
        self.last_words = text[:300] or self.last_words

    def call(self, name: str, *arguments: Any) -> None:
        """Call a function by its name without version.

        Raises:
            Failed: If its status is worse than a warning.
        """
        status = self._functions[name](*arguments)
        if status is not None and status > 1:
            raise Failed(self.words(f"{self._full(name)} returned {status_word(status)}"))

    def words(self, what: str) -> str:
        """Return what happened, with the last message of the FMU."""
        return f"{what}; the FMU said: {self.last_words}" if self.last_words else what

    def instantiate(self) -> ctypes.c_void_p:
        """Return a new instance.

        Raises:
            Failed: If the FMU gives none.
        """
        self.last_words = ""
        for aloud in (False, True):  # the second time it may say why
            if address := self._instance(aloud):
                heard = [c.encode() for c in self.model.log_categories if c in _HEARD]
                if heard and not aloud:
                    names = (ctypes.c_char_p * len(heard))(*heard)
                    self._functions["SetDebugLogging"](
                        ctypes.c_void_p(address), ctypes.c_int(1), ctypes.c_size_t(len(heard)), names
                    )
                return ctypes.c_void_p(address)
        tool = f"; it needs {self.model.tool or 'a program'} to be installed"
        raise Failed(self.words(f"it gives no instance{tool if self.interface in self.model.needs_tool else ''}"))

    def _instance(self, aloud: bool) -> int | None:
        name, token = self.model.name.encode(), self.model.token.encode()
        if self.model.version == 2:
            make = self._dll.fmi2Instantiate
            kind = ctypes.c_int(int(self.interface == "co-simulation"))
            arguments: tuple[Any, ...] = (
                name, kind, token, self.resources.as_uri().encode(), ctypes.byref(self._callbacks), ctypes.c_int(0),
                ctypes.c_int(int(aloud)),
            )  # fmt: skip
        else:
            folder = (str(self.resources) + os.sep).encode()
            flags = ctypes.c_bool(False), ctypes.c_bool(aloud)
            arguments = (name, token, folder, *flags)
            if self.interface == "co-simulation":  # without events and early returns, nor variables for updates between
                make = self._dll.fmi3InstantiateCoSimulation
                arguments += (ctypes.c_bool(False), ctypes.c_bool(False), None, ctypes.c_size_t(0))
                arguments += (None, self._callbacks, None)
            else:
                make = self._dll.fmi3InstantiateModelExchange
                arguments += (None, self._callbacks)
        make.restype = ctypes.c_void_p
        return make(*arguments)


def _imported(name: str) -> Any:
    import importlib

    fmpy()
    return importlib.import_module(f"fmpy.{name}")


def status_word(status: int) -> str:
    """Return what FMI calls a status."""
    return STATUSES[status] if 0 <= status < len(STATUSES) else f"the unknown status {status}"


class Instance:
    """An instance that is reset and used again where the FMU can, and made anew where it cannot.

    Args:
        library: The FMU.

    Attributes:
        was_set: Value references of the parameters that have been set since it was made.
    """

    def __init__(self, library: Library) -> None:
        self.library = library
        self.resets = True
        self._address: ctypes.c_void_p | None = None
        self.was_set: set[int] = set()

    @property
    def is_there(self) -> bool:
        """Whether there is an instance that can be used."""
        return self._address is not None

    @property
    def address(self) -> int:
        """Address of the instance, for the loops."""
        assert self._address is not None
        return int(self._address.value or 0)

    def discard(self) -> None:
        """Take it that the instance cannot be used again; after a fatal status it is not even freed."""
        self._address = None
        self.was_set = set()

    def free(self) -> None:
        """Free the instance."""
        if self._address is not None:
            self.library.call("FreeInstance", self._address)
        self.discard()

    def begin(
        self, values: Mapping[int, float], starts: Mapping[int, float], inputs: Sequence[int], first: Floats
    ) -> None:
        """Initialise it for a run from time zero.

        Args:
            values: Of parameters by value reference, in the units of the FMU, where they differ from their starts.
            starts: The same for parameters at their start: they are set only where an earlier run has changed them.
            inputs: Value references of inputs.
            first: Their first values.

        Raises:
            Failed: If the FMU refuses something.
        """
        library = self.library
        if self._address is not None and not (self.resets and self._reset()):
            self.free()
        if self._address is None:
            self._address = library.instantiate()
        library.last_words = ""
        given = {**values, **{ref: starts[ref] for ref in self.was_set & starts.keys()}}
        self.was_set |= values.keys()
        try:
            self._set(list(given), np.array(list(given.values()), dtype=float))
            zero, no = ctypes.c_double(0.0), ctypes.c_int(0)
            if library.model.version == 2:
                library.call("SetupExperiment", self._address, no, zero, zero, no, zero)
                library.call("EnterInitializationMode", self._address)
            else:
                off = ctypes.c_bool(False)
                library.call("EnterInitializationMode", self._address, off, zero, zero, off, zero)
            self._set(inputs, first)
            library.call("ExitInitializationMode", self._address)
        except Failed:
            self.discard()
            raise

    def _reset(self) -> bool:
        try:
            self.library.call("Reset", self._address)
        except Failed:
            self.resets = False
        return self.resets

    def _set(self, references: Sequence[int], values: Floats) -> None:
        if len(references):
            self._exchange("SetReal", references, (ctypes.c_double * len(references))(*values))

    def read(self, references: Sequence[int]) -> list[float]:
        """Return the values of variables by value reference, after it has been initialised, in the units of the FMU.

        Raises:
            Failed: If the FMU refuses to say.
        """
        numbers = (ctypes.c_double * len(references))()
        self._exchange("GetReal", references, numbers)
        return list(numbers)

    def _exchange(self, name: str, references: Sequence[int], numbers: Any) -> None:
        count = len(references)
        refs = (ctypes.c_uint32 * count)(*references)
        further = (ctypes.c_size_t(count),) if self.library.model.version == 3 else ()
        self.library.call(name, self._address, refs, ctypes.c_size_t(count), numbers, *further)
