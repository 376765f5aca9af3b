"""Kalman-type filters over many hours: a short form of ``python -m bench.endurance``."""

import pytest

from bench.endurance import KINDS, endurance


@pytest.mark.proof
def test_covariances_stay_symmetric_and_definite():
    for kind, found in endurance(KINDS, hours=0.5, part=600.0).items():
        assert found.asymmetry == 0.0, kind
        assert found.pivot > 1e-13, kind
        assert (found.repairs, found.outside) == (0, 0), kind
