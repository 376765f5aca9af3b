"""What holds for every file in ``models/degradations``; the check finds what it is for."""

import types

import numpy as np
import pytest

from harness.models.contracts import Parameter
from harness.models.roles import DEGRADATIONS
from harness.testing import ContractError, check_degradation


@pytest.mark.parametrize("name", DEGRADATIONS.names())
def test_every_degradation(name):
    check_degradation(name)


@pytest.mark.parametrize(
    ("degrade", "changes", "says"),
    [
        (lambda r: r.values + 1.0, {}, "changes readings at the neutral values"),
        (lambda r: r.values, {}, "changes no reading anywhere"),
        (lambda r: r.values + r.p("size") / 0.0, {}, "at the neutral values"),
        (lambda r: np.where(r.p("size") != 0, np.inf, r.values), {}, "an infinite reading at size"),
        (lambda r: np.where(r.p("size") != 0, r.values[::-1], r.values), {}, "reads ahead at size"),
        (lambda r: np.where(r.p("size") != 0, r.values[..., ::-1] + r.p("size") * np.arange(8), r.values), {}, "mixes"),
        (lambda r: r.values + r.p("size"), {"neutral": None}, "size has no neutral value"),
        (lambda r: r.values + r.p("size"), {"lower": 2.0}, "two numbers that rise"),
    ],
)
def test_a_degradation_that_breaks_the_contract_is_refused(degrade, changes, says):
    file = types.ModuleType("broken", "Broken.")
    about = {"unit": "dimensionless", "lower": -1.0, "upper": 1.0, "neutral": 0.0, **changes}
    file.PARAMETERS = (Parameter(name="size", symbol="s", meaning="size", **about),)
    file.degrade = degrade
    with pytest.raises(ContractError, match=says), np.errstate(all="ignore"):
        check_degradation(file)
