"""Wrong noise of inputs is refused in words that name file, key and remedy."""

import pytest

APPENDED = {
    "noise of an input that there is not": (
        '[plant.noise.input]\nspede = "1 m^2/s^2"\n',
        "plant.noise.input.spede: the plant has no input signal 'spede'; closest: speed",
    ),
    "noise of a rate": (
        '[plant.noise.input]\nspeed_rate = "1 m^2/s^4"\n',
        "plant.noise.input.speed_rate: the plant has no input signal 'speed_rate'; closest: speed",
    ),
    "noise of an input that nobody reads": (
        '[plant.noise.input]\nsteering_wheel_angle = "1 deg^2"\n',
        "plant.noise.input.steering_wheel_angle: no estimator reads 'steering_wheel_angle' as an input; remove the key",
    ),
    "noise of an input that estimators take for exact": (
        '[plant.noise.input]\nspeed = "1 m^2/s^2"\n[belief.noise.input]\nspeed = 0\n',
        "belief.noise.input.speed: estimators read 'speed' with noise; state the variance",
    ),
    "negative noise of an input": (
        '[plant.noise.input]\nspeed = "-1 m^2/s^2"\n',
        "plant.noise.input.speed: a variance cannot be negative, got -1",
    ),
    "what an estimator takes for its inputs": (
        '[[estimator]]\nname = "more"\nkind = "ekf"\ninput_signal = "smoothed"\n',
        "estimator[1].input_signal: ",
    ),
}


@pytest.mark.parametrize("case", APPENDED, ids=lambda c: c.replace(" ", "-"))
def test_refusal_of_an_added_table(refused, case):
    appended, expected = APPENDED[case]
    lines = refused(append=appended)
    assert any(line.startswith(expected) for line in lines), lines


def test_noise_that_there_is_not_cannot_be_scaled(refused):
    lines = refused(("trailer_mass", "input_noise_scale"), ('["8 t", "24 t", "32 t"]', "[0, 1]"))
    assert lines[0].startswith(
        "design[0].factor[0].parameter: the plant has no noise of inputs to multiply; state it, e.g. "
        "plant.noise.input.speed"
    )
