"""A logger of an ordinary truck: what each channel of its files holds of a drive, at 100 Hz and in the file's units.

Channels are late, each by its own; the speed is counted in 1/256 km/h and held to 100 Hz, the steering wheel in 0.1°;
gyroscopes drift; a few samples are outliers or missing. How late and noisy the channels are belongs to a case, drift
and faulty samples to a drive.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from bench.foreign.vehicle import OUTPUTS, Floats

SAMPLES = 10
"""Steps of the integration between two samples."""

PERIOD = 0.01
"""s between two samples."""

LATEST = 0.02
"""s; largest delay of a channel."""

MISSING = 0.001
"""Share of the samples that are missing."""

SPEED_STEP = 1.0 / 256.0
"""km/h, as SAE J1939 counts wheel speeds."""

TIME = "t_s"


@dataclass(frozen=True)
class Channel:
    """A column of a file.

    Attributes:
        signal: What it measures.
        unit: Of the file.
        factor: From SI to that unit.
        digits: Behind the point.
        outlier: Size of an outlier in that unit; 0 if there is none.
    """

    signal: str
    unit: str
    factor: float
    digits: int
    outlier: float


_DEGREES = 180.0 / np.pi
CHANNELS = {
    "EBS_TrailerSpeed": Channel("speed", "km/h", 3.6, 8, 0.0),
    "LWS_Angle": Channel("steering_wheel_angle", "deg", _DEGREES, 1, 60.0),
    "ESC_YawRate": Channel("yaw_rate_tractor", "deg/s", _DEGREES, 4, 12.0),
    "TEBS_YawRate": Channel("yaw_rate_trailer", "deg/s", _DEGREES, 4, 12.0),
    "ARTIC_Angle": Channel("articulation_angle", "deg", _DEGREES, 4, 6.0),
    "ESC_LatAcc": Channel("lateral_acceleration_tractor", "m/s^2", 1.0, 5, 4.0),
    "TEBS_LatAcc": Channel("lateral_acceleration_trailer", "m/s^2", 1.0, 5, 4.0),
}
"""By the name that the file has for it."""

ACCELEROMETERS = {"lateral_acceleration_tractor": 0.05, "lateral_acceleration_trailer": 0.06}
"""m/s^2; standard deviation of their noise."""


@dataclass(frozen=True)
class Logger:
    """A measuring system.

    Attributes:
        delays: s by signal, those that are not recorded among them.
        gyroscopes: Standard deviation of their noise, tractor and trailer, ``(2,)``, °/s.
        drifts: Of their bias, ``(2,)``, °/s.
        articulation_noise: Standard deviation, °.
        articulation_gain: What the articulation sensor reads of an angle.
        speed_noise: Standard deviation, m/s.
        five: Whether an accelerometer in the trailer is the fifth sensor.
    """

    delays: dict[str, float]
    gyroscopes: Floats
    drifts: Floats
    articulation_noise: float
    articulation_gain: float = 1.0
    speed_noise: float = 0.02
    five: bool = False

    @property
    def channels(self) -> dict[str, Channel]:
        """What it records beside the time, by the name in the file."""
        return {name: c for name, c in CHANNELS.items() if self.five or c.signal != "lateral_acceleration_trailer"}

    @property
    def outputs(self) -> tuple[str, ...]:
        """The signals of its sensors: what it records beside speed and steering wheel."""
        return tuple(c.signal for c in self.channels.values() if c.signal not in ("speed", "steering_wheel_angle"))

    @property
    def faults(self) -> tuple[str, ...]:
        """What may truly be said of its recordings, in the words of the project, ``name@signal``."""
        late = ["steering_delay", "speed_delay", *(f"sensor_delay@{s}" for s in self.outputs)]
        gyroscopes = [s for s in self.outputs if s.startswith("yaw_rate")]
        wander = [f"{fault}@{s}" for s in gyroscopes for fault in ("sensor_bias", "sensor_drift")]
        return (*late, *wander, *(["sensor_gain@articulation_angle"] if self.articulation_gain != 1.0 else []))


def draw_delays(rng: np.random.Generator) -> dict[str, float]:
    """Return how late each signal is recorded, in s."""
    names = ("speed", "steering_wheel_angle", *OUTPUTS[1:])
    return {name: float(x) for name, x in zip(names, rng.uniform(0, LATEST, len(names)), strict=True)}


def record(
    rng: np.random.Generator, outputs: Floats, steering_wheel_angle: Floats, logger: Logger, step: float
) -> dict[str, Floats]:
    """Return what the logger writes of a drive.

    Args:
        rng: Draws noise, drift and faulty samples.
        outputs: Of the truck at every step, ``(n + 1, 6)``.
        steering_wheel_angle: At every step, ``(n + 1,)``, in rad.
        logger: The measuring system.
        step: Of the integration in s.

    Returns:
        The time in s and every channel in its unit, ``(samples,)`` each; what is missing is NaN.
    """
    t = np.arange((len(outputs) - 1) // SAMPLES + 1, dtype=float) * PERIOD
    fine = np.arange(len(outputs)) * step
    true = {"steering_wheel_angle": steering_wheel_angle, **dict(zip(OUTPUTS, outputs.T, strict=True))}
    columns = {TIME: t}
    for name, channel in logger.channels.items():
        late = channel.factor * np.interp(t - logger.delays[channel.signal], fine, true[channel.signal])
        columns[name] = _read(rng, channel.signal, late, t, logger)
    for name, channel in logger.channels.items():
        _spoil(rng, columns[name], channel)
    return columns


def _read(rng: np.random.Generator, signal: str, true: Floats, t: Floats, logger: Logger) -> Floats:
    """Return what a sensor reads of a signal, in the unit of its channel."""
    if signal == "speed":
        seen = true[::2]
        seen = seen + logger.speed_noise * 3.6 * rng.standard_normal(seen.size)
        return np.repeat(np.round(seen / SPEED_STEP) * SPEED_STEP, 2)[: t.size]
    if signal == "steering_wheel_angle":
        return np.round(true * 10) / 10
    if signal.startswith("yaw_rate"):
        which = int(signal == "yaw_rate_trailer")
        noisy = true + logger.gyroscopes[which] * rng.standard_normal(t.size)
        return noisy + _wander(rng, t, logger.drifts[which])
    if signal == "articulation_angle":
        return logger.articulation_gain * true + logger.articulation_noise * rng.standard_normal(t.size)
    return true + ACCELEROMETERS[signal] * rng.standard_normal(t.size)


def _wander(rng: np.random.Generator, t: Floats, size: float) -> Floats:
    """Return a bias that changes over minutes: two slow sines and a constant."""
    periods = rng.uniform(120, 260), rng.uniform(50, 100)
    phases = rng.uniform(0, 6.28), rng.uniform(0, 6.28)
    slow, fast = (np.sin(2 * np.pi * t / p + x) for p, x in zip(periods, phases, strict=True))
    return size * (0.8 * slow + 0.4 * fast + 0.6 * rng.standard_normal())


def _spoil(rng: np.random.Generator, values: Floats, channel: Channel) -> None:
    """Put outliers into a channel, and lose some of its samples."""
    if channel.outlier:
        count = 1 if channel.signal == "steering_wheel_angle" else rng.integers(1, 4)
        for k in rng.integers(50, values.size - 50, count):
            values[k] += channel.outlier * rng.uniform(0.7, 1.5) * rng.choice([-1, 1])
    values[rng.random(values.size) < MISSING] = np.nan


def csv_text(recorded: dict[str, Floats]) -> str:
    """Return the file of a drive; a missing sample is an empty field."""
    digits = [CHANNELS[name].digits if name in CHANNELS else 2 for name in recorded]
    rows = (
        ",".join("" if np.isnan(x) else f"{x:.{d}f}" for d, x in zip(digits, row, strict=True))
        for row in zip(*recorded.values(), strict=True)
    )
    return "\n".join([",".join(recorded), *rows]) + "\n"


def map_text(logger: Logger) -> str:
    """Return the channel map of the logger's files, which says nothing of what is wrong with them."""
    lines = [
        'title = "Foreign truck"',
        'source = "a simulation of other hands, by a logger with a clock of its own"',
        "",
        f'time = {{ channel = "{TIME}", unit = "s" }}',
    ]
    lines += [
        f'{c.signal} = {{ channel = "{name}", unit = "{c.unit}", remove_spikes = true }}'
        for name, c in logger.channels.items()
    ]
    return "\n".join(lines) + "\n"
