"""Table 3.1 of Sun 2015 beside ours: ``python -m reproductions.sun_particle_smoother``.

A lane change of 500 steps of 10 ms with the car of Sun 2015, measured with its noise, in several repeats; RMSE of the
particle filter and of both smoothers with 50 particles as there, with 200 and with 1000. The steering of the thesis is
a recording that is not given, so the drive is ours; so is the first state. The extended Kalman filter on the same runs
shows what is left to gain, as the model is almost linear.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from harness.common.arguments import Parser
from harness.common.arrays import Floats
from harness.engine.compile import CompiledModel, compile_model
from harness.engine.simd.lanes import LANES
from harness.estimation.compiled_estimator import CompiledEstimator
from harness.estimation.particle_smoother import mean_of, reweight, run_filter, simulate_backward
from harness.models.assembly.assemble import assemble
from harness.models.contracts import DriveContext
from harness.models.parameters import sun_2015 as car
from harness.runner.contract import Held, InputSeries, Signals
from harness.simulation.drives import build_drive
from harness.simulation.simulate import CompiledSimulator, in_lanes, input_table, variances

SAMPLES = 501
SIZES = (50, 200, 1000)
PRINTED = {"particle filter": (0.0052, 0.0015, 0.0006), "smoother (reweighting)": (0.0048, 0.0014, 0.0006)}
"""RMSE of lateral velocity in m/s, yaw rate in rad/s and heading in rad at 50 particles (Sun 2015, table 3.1)."""


def simulate_runs(repeats: int, seed: int) -> tuple[CompiledModel, Floats, Floats, Floats]:
    """Return the model, its inputs, the true states and the measurements of a lane change, up to LANES repeats."""
    model = assemble("car_reference_point", sensors="car_reference")
    compiled = compile_model(model, car.NOISE_STEP, signals=model.states)
    context = DriveContext(car.VALUES["axle_distance"], car.VALUES["steering_ratio"], car.NOISE_STEP)
    options = {"duration": 5.0, "lead_in": 0.5, "speed": "50 km/h", "speed_change": "20 km/h"}
    options |= {"amplitude": "30 deg", "frequency": "0.4 Hz", "fade": 1.0, "lateral_acceleration_limit": 6.0}
    profile = build_drive("sine", options, context)
    inputs = in_lanes(input_table(profile, model))[:SAMPLES]
    noise = np.empty((SAMPLES, compiled.nx + compiled.ny, LANES))
    for lane in range(LANES):
        rng = np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(min(lane, repeats - 1),)))
        noise[:, :, lane] = rng.standard_normal(noise.shape[:2])
    held = Held(
        in_lanes(compiled.parameter_vector(car.VALUES)),
        in_lanes(variances(car.PROCESS_NOISE, model.states)),
        in_lanes(variances(car.MEASUREMENT_NOISE, list(model.outputs))),
        np.zeros((compiled.nx, LANES)),
    )
    batch = CompiledSimulator(model, car.NOISE_STEP).run(InputSeries(inputs), held, noise, Signals(model.states))
    return compiled, inputs, batch.truth, batch.measurements


def rmse_of_runs(repeats: int, seed: int, sizes: Sequence[int] = SIZES) -> dict[tuple[str, int], Floats]:
    """Return the RMSE by method and particles, ``(repeats, 3)``; the Kalman filter has none."""
    compiled, inputs, truth, y = simulate_runs(repeats, seed)
    variance = in_lanes(variances(car.PROCESS_NOISE, compiled.model.states))
    r = in_lanes(variances(car.MEASUREMENT_NOISE, list(compiled.model.outputs)))
    constants = compiled.constants(in_lanes(compiled.parameter_vector(car.VALUES)))
    start = np.zeros(compiled.nx)

    def rmse(estimates: list[Floats]) -> Floats:
        return np.array([np.sqrt(np.mean((e - truth[1:, :, i]) ** 2, axis=0)) for i, e in enumerate(estimates)])

    kalman = CompiledEstimator("ekf", compiled)
    state, means = kalman.init(start, variance), []
    for k in range(1, SAMPLES):
        belief = kalman.belief(constants, variance, r)
        state, _ = kalman.step(state, inputs[k - 1], inputs[k], y[k], belief)
        means.append(state.mean)
    errors = {("extended Kalman filter", 0): rmse([np.array(means)[:, :, i] for i in range(repeats)])}
    for size in sizes:
        estimator = CompiledEstimator(
            "particle", compiled, {"particles": size, "resampling": "stratified", "threshold": 1.0}
        )
        seeds = [np.random.SeedSequence(seed, spawn_key=(lane, size)) for lane in range(LANES)]
        first = estimator.init(start, variance, seeds)
        belief = estimator.belief(constants, variance, r)
        runs = run_filter(estimator, inputs, y, belief, first, repeats)
        rng = np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(LANES, size)))
        errors["particle filter", size] = rmse([c.mean for c in runs])
        errors["smoother (reweighting)", size] = rmse([mean_of(c.particles, reweight(c)) for c in runs])
        errors["smoother (backward simulation)", size] = rmse(
            [simulate_backward(c, size, rng).mean(axis=1) for c in runs]
        )
    return errors


def main() -> None:
    """Print the table."""
    parser = Parser(description="Table 3.1 of Sun 2015 beside ours")
    parser.add_argument("--repeats", type=int, default=4, choices=range(1, LANES + 1), help="runs with fresh noise")
    parser.add_argument("--seed", type=int, default=0)
    arguments = parser.parse_args()
    errors = rmse_of_runs(arguments.repeats, arguments.seed)
    print(f"RMSE over 500 steps of 10 ms; ours: mean and standard deviation of {arguments.repeats} runs\n")
    print(f"{'':<32}{'N':>6}{'v_y in m/s':>20}{'yaw rate in rad/s':>22}{'heading in rad':>22}")
    for name, theirs in PRINTED.items():
        print(f"{'Sun: ' + name:<32}{50:>6}{theirs[0]:>20}{theirs[1]:>22}{theirs[2]:>22}")
    for (name, size), values in errors.items():
        spread = values.std(axis=0, ddof=1) if len(values) > 1 else np.zeros(3)
        cells = [f"{m:.3g} ± {s:.1g}" for m, s in zip(values.mean(axis=0), spread, strict=True)]
        print(f"{name:<32}{size or '':>6}{cells[0]:>20}{cells[1]:>22}{cells[2]:>22}")


if __name__ == "__main__":
    main()
