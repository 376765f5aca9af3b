"""The multi-body car as an FMU: ``pythonfmu build -f slave.py commonroad_car.py``.

In the study, ``fmu = "MultiBodyCar.fmu"`` and ``map = "car.toml"`` then stand in place of ``python``.
"""

from commonroad_car import MultiBody
from pythonfmu import Fmi2Causality, Fmi2Slave, Fmi2Variability, Real
from vehiclemodels.init_mb import init_mb


class MultiBodyCar(Fmi2Slave):
    """A slave whose outputs are those of the present state and inputs."""

    author, description = "somebody else", "BMW 320i of the CommonRoad vehicle models"

    def __init__(self, **options):
        super().__init__(**options)
        self.car, self.values, self.started = MultiBody(), {}, False
        self.given = dict.fromkeys((*MultiBody.inputs, *MultiBody.disturbances), 0.0)
        for name in self.given:
            self._register(name, Fmi2Causality.input, self.given, start=0.0)
        for name, stated in MultiBody.parameters.items():
            self.values[name] = stated["value"]
            self._register(name, Fmi2Causality.parameter, self.values, variability=Fmi2Variability.tunable)
        for name in MultiBody.outputs:
            self.register_variable(
                Real(name, causality=Fmi2Causality.output, getter=lambda name=name: self._published()[name])
            )

    def _register(self, name, causality, table, **options):
        def write(value):
            table[name] = value

        self.register_variable(
            Real(name, causality=causality, getter=lambda: table[name], setter=write, **options), nested=False
        )

    def exit_initialization_mode(self):
        """Start straight ahead at the speed that is given."""
        self.car.reset(self.values)
        self.car.x = init_mb([0.0, 0.0, 0.0, self.given["speed"], 0.0, 0.0, 0.0], self.car.car)
        self.started = True

    def _published(self):
        return self.car._published(self.given) if self.started else dict.fromkeys(MultiBody.outputs, 0.0)

    def do_step(self, current_time, step_size):
        """Move on by a step."""
        self.car.step(self.given, step_size)
        return True
