"""What must hold for every component, as functions: one line of pytest checks a component of your own.

::

    from harness.testing import check_effect

    def test_my_effect():
        check_effect("my_effect")

Each takes the name of a component, wherever it comes from (``docs/plugins.md``), or a module, and raises an
``AssertionError`` that says what is wrong. Our own components are checked by the same functions.
"""

from harness.testing.data_files import check_parameter_set, check_reader, check_sensors
from harness.testing.degradations import check_degradation
from harness.testing.drives import check_drive
from harness.testing.effects import check_effect
from harness.testing.estimators import check_estimator
from harness.testing.parts import ContractError
from harness.testing.tyres import check_tyre
from harness.testing.vehicles import check_vehicle

__all__ = [
    "ContractError",
    "check_degradation",
    "check_drive",
    "check_effect",
    "check_estimator",
    "check_parameter_set",
    "check_reader",
    "check_sensors",
    "check_tyre",
    "check_vehicle",
]
