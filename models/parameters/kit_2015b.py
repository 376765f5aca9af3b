"""Heading from wheel encoders and a gyro, exercise 2 of the lecture on the Kalman filter (KIT 2015).

The exercise names the variances but gives no numbers. Chosen by this project, of the size of series sensors: the
change of heading per sample of 10 ms with a standard deviation of 1e-3 rad (two encoders that resolve about a
millimetre on a track of 1.5 m), the gyro's heading with 0.01 rad. ``NOISE_STEP`` only names that sample time; the model
is a difference equation, so its variances do not grow with the step of a study.
"""

VEHICLE = "vehicle_heading"

VALUES: dict[str, float] = {}

NOISE_STEP = 0.01

PROCESS_NOISE: dict[str, float] = {"heading": 1e-6}

MEASUREMENT_NOISE: dict[str, float] = {"heading": 1e-4}
