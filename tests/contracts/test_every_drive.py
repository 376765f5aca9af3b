"""Every file in models/drives keeps the contract, with its defaults and away from them."""

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from harness.common.errors import ModelError
from harness.common.units import scale
from harness.models.contracts import DriveContext
from harness.models.drive_options import kinds
from harness.models.drives._shapes import LIMIT, lateral_acceleration
from harness.models.roles import DRIVES
from harness.simulation.drives import build_drive

CONTEXT = DriveContext(wheelbase=3.71, steering_ratio=23.0, step=0.01)
KINDS = DRIVES.names()


@pytest.fixture
def required(tmp_path: Path):
    """What each kind cannot do without: a recording, for those that need a file."""
    time = np.arange(0, 20, 0.01)
    columns = [time, 0.8 * np.sin(0.5 * time), 10 + np.sin(0.1 * time)]
    path = tmp_path / "recording.csv"
    np.savetxt(path, np.column_stack(columns), "%.9f", ",", header="time,steering_wheel_angle,speed")

    def of(kind: str) -> dict[str, object]:
        return {o.name: str(path) for o in kinds()[kind] if o.default is None}

    return of


@pytest.mark.parametrize("kind", KINDS)
def test_options_are_documented_and_their_defaults_allowed(kind):
    for option in kinds()[kind]:
        assert option.meaning, option.name
        assert not option.meaning.endswith("."), option.name
        if option.unit != "text":
            scale(option.unit, option.unit, option.name)  # raises if pint does not know it
            assert option.lower < option.upper, option.name
            assert option.lower <= option.default <= option.upper, option.name
    assert LIMIT.name in [o.name for o in kinds()[kind]]
    assert DRIVES.load(kind).__doc__


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("step", [0.01, 0.02])
def test_profile_keeps_the_contract(kind, step, required):
    profile = build_drive(kind, required(kind), replace(CONTEXT, step=step))
    n = len(profile.time)
    assert profile.time.shape == profile.steering_wheel_angle.shape == profile.speed.shape == (n,)
    np.testing.assert_allclose(profile.time, np.arange(n) * step, atol=1e-9)
    assert np.isfinite(profile.steering_wheel_angle).all()
    assert profile.speed.min() > 0
    assert np.abs(profile.steering_wheel_angle).max() > math.radians(5), "a drive that does not steer"


@pytest.mark.parametrize("kind", KINDS)
def test_starts_straight_and_comes_in_smoothly(kind, required):
    profile = build_drive(kind, required(kind), CONTEXT)
    steering = profile.steering_wheel_angle
    assert steering[0] == 0.0
    # No jump: no sample differs from its neighbour by more than the fastest steering a driver can do.
    assert np.abs(np.diff(steering)).max() / CONTEXT.step < math.radians(450)
    # No jerk of the wheel either: the rate itself has no jump of the size of the largest rate.
    rate = np.diff(steering) / CONTEXT.step
    assert np.abs(np.diff(rate)).max() < 0.3 * np.abs(rate).max()
    assert np.abs(np.diff(profile.speed)).max() / CONTEXT.step < 1.5


@pytest.mark.parametrize("kind", KINDS)
def test_is_deterministic_and_leaves_the_options_alone(kind, required):
    options = required(kind)
    before = dict(options)
    first, second = (build_drive(kind, options, CONTEXT) for _ in range(2))
    assert options == before
    np.testing.assert_array_equal(first.steering_wheel_angle, second.steering_wheel_angle)
    np.testing.assert_array_equal(first.speed, second.speed)


@pytest.mark.parametrize("kind", [k for k in KINDS if k != "from_file"])
def test_does_not_depend_on_the_step(kind, required):
    fine, coarse = (build_drive(kind, required(kind), replace(CONTEXT, step=h)) for h in (0.01, 0.02))
    np.testing.assert_allclose(fine.steering_wheel_angle[::2], coarse.steering_wheel_angle, atol=1e-9)
    np.testing.assert_allclose(fine.speed[::2], coarse.speed, atol=1e-9)


@pytest.mark.parametrize("kind", KINDS)
def test_limit_is_enforced(kind, required):
    options = required(kind)
    peak = np.abs(lateral_acceleration(build_drive(kind, options, CONTEXT), CONTEXT)).max()
    assert peak <= LIMIT.default
    build_drive(kind, {**options, LIMIT.name: 1.01 * peak}, CONTEXT)
    with pytest.raises(ModelError, match=rf"asks for {peak:.2f} m/s\^2 .* at .* s .*lower the speed .*raise"):
        build_drive(kind, {**options, LIMIT.name: 0.99 * peak}, CONTEXT)


@pytest.mark.parametrize("kind", [k for k in KINDS if "direction" in [o.name for o in kinds()[k]]])
def test_direction_mirrors(kind):
    left, right = (build_drive(kind, {"direction": d}, CONTEXT) for d in ("left", "right"))
    np.testing.assert_array_equal(left.steering_wheel_angle, -right.steering_wheel_angle)
    with pytest.raises(ModelError, match="direction: 'up' is unknown"):
        build_drive(kind, {"direction": "up"}, CONTEXT)


@pytest.mark.parametrize("kind", [k for k in KINDS if "seed" in [o.name for o in kinds()[k]]])
def test_seed_counts_and_zero_is_one(kind):
    drives = [build_drive(kind, {"seed": s}, CONTEXT).steering_wheel_angle for s in (0, 1, 2)]
    assert not any(np.array_equal(a, b) for a, b in ((drives[0], drives[1]), (drives[1], drives[2])))
    with pytest.raises(ModelError, match=r"seed: 1\.5 is not a whole number"):
        build_drive(kind, {"seed": 1.5}, CONTEXT)


@pytest.mark.parametrize("kind", [k for k in KINDS if "duration" in [o.name for o in kinds()[k]]])
def test_lasts_as_long_as_asked(kind):
    assert build_drive(kind, {"duration": "95.5 s"}, CONTEXT).time[-1] == pytest.approx(95.5)
    assert not build_drive(kind, {"lead_in": "10 s"}, CONTEXT).steering_wheel_angle[:1000].any()
    with pytest.raises(ModelError, match=r"lead[-_]in"):
        build_drive(kind, {"duration": 5, "lead_in": 5}, CONTEXT)
