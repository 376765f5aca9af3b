"""Channels with clocks of their own: one hypothesis, of which a model keeps the delays that matter."""

import numpy as np
import pytest

from harness.diagnosis.model.hypotheses import ALL_PARAMETERS, CHANNEL_DELAYS, hypotheses, still_open
from harness.diagnosis.selection.forward_selection import trace
from harness.diagnosis.selection.posterior import log_odds
from support.driven_car import FREE, driven


def late(recording, **samples):
    """Return a recording of which some channels come late by a number of samples."""
    most = max(samples.values())
    shifted = {n: (("time",), np.roll(recording[n].to_numpy(), k)) for n, k in samples.items()}
    return recording.assign(shifted).isel(time=slice(most, None)).assign_coords(time=recording.time[:-most].to_numpy())


@pytest.fixture(scope="module")
def delays(augmented):
    return next(h for h in hypotheses(augmented, FREE) if h.name == CHANNEL_DELAYS)


def test_it_tries_both_inputs_and_every_sensor_and_stands_for_its_parts(augmented, delays):
    names = [h.name for h in delays.parts]
    assert names.count("steering_delay") == names.count("speed_delay") == 1
    assert sorted(names)[:3] == [f"sensor_delay@{n}" for n in ("lateral_acceleration", "lateral_velocity", "yaw_rate")]
    assert delays.many
    assert delays.single == delays.parts
    tried = hypotheses(augmented, FREE)
    assert all(h.single == (h,) for h in tried if h.name != CHANNEL_DELAYS)
    assert [h.name for h in tried if h.many] == [ALL_PARAMETERS, CHANNEL_DELAYS]
    assert (delays.kind, delays.name) not in log_odds(tried)


def test_what_is_in_force_is_not_tried_again(delays):
    left = still_open(delays, {"steering_delay"})
    assert "steering_delay" not in left.amplitudes
    assert len(left.parts) == len(delays.parts) - 1
    assert still_open(delays, set(delays.amplitudes[1:])) is None  # one clock is a hypothesis of its own
    assert still_open(delays.parts[0], set(delays.parts[0].amplitudes)) is None


def test_a_late_steering_channel_and_a_late_sensor_are_named_and_nothing_of_the_vehicle(augmented):
    """A steering wheel that is recorded late looks as if the vehicle turned before its driver: a negative delay."""
    shifted = {"steering_wheel_angle": 3, "lateral_acceleration": 2}
    drives = [augmented.drive(late(driven(60 + i), **shifted), f"drive {i}") for i in range(3)]
    found = trace(augmented, drives[:2], drives[2:], FREE)
    assert found.rounds[0].added.hypothesis.name == CHANNEL_DELAYS
    assert {h.name for h in found.added} == {"steering_delay", "sensor_delay@lateral_acceleration"}
    value = dict(zip(augmented.names, found.final.point.values[:, 0], strict=True))
    assert value["steering_delay"] == pytest.approx(-0.03, abs=0.002)
    assert value["sensor_delay_lateral_acceleration"] == pytest.approx(0.02, abs=0.003)
    assert value["stiffness_peak_front"] == pytest.approx(augmented.spec.values["stiffness_peak_front"], rel=0.02)
