"""What holds for every file in ``models/effects``; the checks themselves are tried on small effects."""

from __future__ import annotations

import types

import numpy as np
import pytest
import sympy as sp

from harness.models.assembly.assemble import assemble
from harness.models.contracts import Parameter
from harness.models.roles import EFFECTS, VEHICLES
from harness.testing import check_effect
from harness.testing.effects import (
    CHECKS,
    check_contract,
    check_neutral,
    check_presence,
    check_reads,
    check_slope,
    compare,
    drawn,
    fits,
    most_sensors,
    own_parameters,
    plain,
    random_drive,
    tyres,
)
from harness.testing.parts import load


@pytest.mark.parametrize("name", EFFECTS.names())
def test_every_effect(name):
    check_effect(name)


@pytest.mark.parametrize("vehicle", [v for v in VEHICLES.names() if load("vehicles", v).PARAMETERS])
def test_all_effects_together_are_absent_at_their_neutral_values(vehicle):
    """Also that they can be assembled together: no two share a state or parameter, and none makes a loop."""
    for tyre in tyres(vehicle):
        chosen = {
            n: load("effects", n)
            for n in EFFECTS.names()
            if (vehicle, tyre) in {f[:2] for f in fits(n, load("effects", n))}
        }
        if not chosen:
            continue
        built = assemble(vehicle, tyre, chosen, most_sensors(vehicle))
        rng = np.random.default_rng(2)
        for _ in range(5):
            point = random_drive(built, vehicle, rng)
            for p in own_parameters(built, plain(vehicle, tyre)):
                point[p.name] = drawn(p, rng) if p.neutral is None else p.neutral
            with_it, without = compare(vehicle, tyre, built, point)
            assert with_it == pytest.approx(without, rel=1e-12, abs=1e-12 * max(1.0, np.abs(without).max()))


# --- the checks find what they are for


def effect(port="road_wheel_angle", apply=None, unit="dimensionless", neutral=1.0, **more) -> types.ModuleType:
    module = types.ModuleType("gain")
    module.__doc__ = "A gain."
    module.PORT, module.READS, module.STATES = port, (), more.get("states", ())
    module.PARAMETERS = (Parameter("gain", "k", unit, 0.5, 2.0, "gain", neutral),)
    module.apply = apply or (lambda e, value: e.p("gain") * value)
    return module


@pytest.mark.parametrize("check", CHECKS)
def test_a_right_effect_passes(check):
    check("gain", effect())


@pytest.mark.parametrize("port", ["sensor_yaw_rate_trailer", "vertical_load_axle_11"])
def test_effects_on_sensors_and_loads_pass(port):
    check_contract("gain", effect(port))
    check_neutral("gain", effect(port))


@pytest.mark.parametrize(
    ("wrong", "check"),
    [
        (effect(neutral=1.1), check_neutral),
        (effect(neutral=None), check_contract),
        (effect(neutral=3.0), check_contract),
        (effect(unit="N"), check_contract),
        (effect(apply=lambda e, value: value + sp.Float(0.01)), check_neutral),
        (effect(apply=lambda e, value: value), check_presence),
        (effect(port="road_wheel_angel"), check_contract),
        (effect(apply=lambda e, value: e.p("gain") * value + 0 * e.read("speed")), check_reads),
        (effect(apply=lambda e, value: value * (1 + (e.p("gain") - 1) ** 3)), check_slope),
    ],
    ids=["not neutral", "no neutral", "neutral out of bounds", "unit", "offset", "nothing", "port", "reads", "cubic"],
)
def test_a_wrong_effect_is_found(wrong, check):
    with pytest.raises(AssertionError):
        check("gain", wrong)
