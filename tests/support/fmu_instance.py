"""An instance of an exported FMU, in the calls that FMI 2.0 and 3.0 have in common."""

import ctypes
from typing import ClassVar

STEP = 0.01


class Slave:
    """An instance of an FMU, in the calls of both versions; ``said`` is of all, as FMPy has one logger for FMI 2."""

    said: ClassVar[list[tuple]] = []

    def __init__(self, path, token=None):
        import fmpy
        from fmpy.fmi2 import FMU2Slave
        from fmpy.fmi3 import FMU3Slave

        described = fmpy.read_model_description(str(path))
        self.version = described.fmiMajorVersion
        self.references = {v.name: v.valueReference for v in described.modelVariables}
        self.fmu = (FMU2Slave if self.version == 2 else FMU3Slave)(
            guid=token or described.guid,
            modelIdentifier=described.coSimulation.modelIdentifier,
            unzipDirectory=fmpy.extract(str(path)),
        )
        if self.version == 2:
            from fmpy.fmi2 import addLoggerProxy, defaultCallbacks, fmi2CallbackFunctions, fmi2CallbackLoggerTYPE

            def hear(environment, name, status, category, message):
                self.said.append((status, category, message))

            callbacks = fmi2CallbackFunctions()
            callbacks.logger = self._hear = fmi2CallbackLoggerTYPE(hear)
            callbacks.allocateMemory = defaultCallbacks.allocateMemory
            callbacks.freeMemory = defaultCallbacks.freeMemory
            addLoggerProxy(ctypes.byref(callbacks))
            self.fmu.instantiate(callbacks=callbacks)
        else:
            self.fmu.instantiate(logMessage=lambda environment, *said: self.said.append(said))

    def begin(self, **first):
        if self.version == 2:
            self.fmu.setupExperiment(startTime=0.0)
        self.fmu.enterInitializationMode()
        self.set(**first)
        self.fmu.exitInitializationMode()
        return self

    def set(self, **values):
        for name, value in values.items():
            reference = [self.references[name]]
            if isinstance(value, bool):
                self.fmu.setBoolean(reference, [value])
            elif self.version == 2:
                self.fmu.setReal(reference, [value])
            else:
                self.fmu.setFloat64(reference, [value])

    def get(self, *names):
        references = [self.references[n] for n in names]
        return list(self.fmu.getReal(references) if self.version == 2 else self.fmu.getFloat64(references))

    def whole(self, *names):
        references = [self.references[n] for n in names]
        return list(self.fmu.getInteger(references) if self.version == 2 else self.fmu.getInt32(references))

    def step(self, at, size=STEP):
        self.fmu.doStep(at, size)

    @property
    def words(self):
        return [text.decode() if isinstance(text, bytes) else text for _, _, text in self.said]
