"""The scalar example of the lecture on the Kalman filter, exercise 1 (KIT 2015).

Everything is the exercise's: ``x(n+1) = 0.5 x(n) + u(n) + v(n)``, ``y(n) = x(n) + w(n)``, both noises of variance 1.
It starts from a variance of 10 (``START_VARIANCE`` of the vehicle). ``NOISE_STEP`` has no meaning here, because the
model is a difference equation.
"""

VEHICLE = "scalar_example"

VALUES: dict[str, float] = {"transition": 0.5}

NOISE_STEP = 1.0

PROCESS_NOISE: dict[str, float] = {"example_state": 1.0}

MEASUREMENT_NOISE: dict[str, float] = {"example_state": 1.0}
