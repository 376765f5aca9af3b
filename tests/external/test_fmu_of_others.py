"""FMUs that somebody else's program wrote: PythonFMU, which runs Python in the FMU."""

import numpy as np
import pytest

from harness.external.fmu.read import describe
from harness.external.processes import Lost, Workers

SLAVE = """
import math
from pythonfmu import Fmi2Causality, Fmi2Slave, Fmi2Variability, Real

class Spring(Fmi2Slave):
    author, description = "somebody", "a mass on a spring"

    def __init__(self, **kwargs):
        super().__init__(**kwargs)
        self.delta, self.mass, self.rate, self.angle = 0.0, 2.0, 0.0, 0.0
        self.register_variable(Real("delta", causality=Fmi2Causality.input))
        self.register_variable(
            Real("mass", causality=Fmi2Causality.parameter, variability=Fmi2Variability.tunable, start=2.0)
        )
        self.register_variable(Real("rate", causality=Fmi2Causality.output))

    def do_step(self, current_time, step_size):
        if self.mass > 3.0 and current_time >= 0.5:
            raise ArithmeticError("too heavy")
        self.angle += step_size * self.rate
        self.rate += step_size * (self.delta - 5.0 * self.angle) / self.mass
        return True
"""

MAP = {
    "inputs": {"steering_wheel_angle": {"variable": "delta", "unit": "rad"}},
    "outputs": {"yaw_rate": {"variable": "rate", "unit": "rad/s"}},
    "parameters": {"mass": {"variable": "mass", "unit": "kg"}},
}


@pytest.fixture(scope="module")
def spring(tmp_path_factory):
    builder = pytest.importorskip("pythonfmu.builder").FmuBuilder
    if not builder.has_binary():
        pytest.skip("PythonFMU has no binary for this platform")
    folder = tmp_path_factory.mktemp("pythonfmu")
    (folder / "spring.py").write_text(SLAVE)
    return builder.build_FMU(folder / "spring.py", dest=folder)


def test_an_fmu_that_runs_python_is_run_in_worker_processes(spring):
    description = describe(spring, MAP)
    assert description.facts["needs_tool"] == "yes"
    assert [p.name for p in description.parameters] == ["mass"]
    workers = Workers({"kind": "fmu", "file": str(spring), "description": description.as_dict()})
    steer = np.sin(0.1 * np.arange(100))[:, None]
    jobs = [(0.01, steer, np.zeros((100, 0)), np.array([mass])) for mass in (2.0, 2.5, 3.5, 2.0)]
    first, second, failed, last = workers.calls("simulate", jobs)
    workers.close()
    for mass, result in ((2.0, first), (2.5, second), (2.0, last)):
        assert not isinstance(result, Lost), result
        angle, rate, expected = 0.0, 0.0, []
        for k in range(100):
            expected.append(rate)
            angle += 0.01 * rate
            rate += 0.01 * (steer[k, 0] - 5.0 * angle) / mass
        assert (result.reached, result.reason) == (100, "")
        np.testing.assert_allclose(result.outputs[:, 0], expected, rtol=0, atol=1e-12)
    assert failed.reached == 51
    assert "returned" in failed.reason
