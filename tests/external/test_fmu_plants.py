"""Plants that are FMUs: the same equations as ours give the same numbers, instances are used again, faults are said."""

from dataclasses import replace

import numpy as np
import pytest

import harness as h
from harness.external.description import Description
from harness.external.fmu.plants import load
from harness.external.fmu.read import describe
from harness.external.processes import Lost, Workers
from harness.simulation.drives import profile_of
from harness.simulation.simulate import input_table, simulate_drive
from support.fmus import SPRING, SPRING_MAP, make, needs_compiler, of_model

KINDS = [(2, "cs"), (2, "me"), (3, "cs"), (3, "me")]
pytestmark = needs_compiler


def plant(path, content=SPRING_MAP, **options):
    return load({"file": str(path), "description": describe(path, content).as_dict(), **options})


def drive(samples=300):
    time = np.arange(samples)
    return np.radians(10 * np.sin(0.05 * time))[:, None], 0.1 * np.cos(0.3 * time)[:, None]


def run(body, values=(2.0, 5.0), samples=300):
    return body.simulate(0.01, *drive(samples), np.array(values))


@pytest.fixture(scope="module")
def spring(tmp_path_factory):
    return make(tmp_path_factory.mktemp("spring"), SPRING)


VEHICLES = {
    "semitrailer": (("semitrailer", "ziaukas_2023"), {}, ["yaw_rate_tractor", "articulation_angle"]),
    "car": (("car", "govindarajan_2018"), {"sensors": "car_series"}, ["yaw_rate", "lateral_acceleration"]),
}


@pytest.mark.parametrize("vehicle", VEHICLES)
@pytest.mark.parametrize(("version", "kind", "integrator"), [(*k, "euler") for k in KINDS] + [(2, "me", "rk4")])
def test_the_equations_of_a_vehicle_give_the_numbers_of_the_built_in_plant(
    vehicle, version, kind, integrator, tmp_path
):
    name, options, published = VEHICLES[vehicle]
    spec = h.model(*name, integrator=integrator, **options).spec
    model = spec.model()
    published = [*published, *(n for n in model.outputs if n not in published)]
    content = {
        "inputs": {n: n for n in model.inputs},
        "outputs": {n: n for n in published},
    }
    profile = profile_of(spec, h.drive("sine", duration="6 s", amplitude="40 deg", frequency="0.4 Hz"))
    ours = simulate_drive(spec, profile, published)
    inputs = input_table(profile, model)
    body = plant(make(tmp_path, of_model(model, spec.values, published), version, kind), content, integrator=integrator)
    values = np.array([float(spec.values[n]) for n in model.parameter_names])
    theirs = body.simulate(spec.step, inputs, np.zeros((len(inputs), 0)), values)
    assert (theirs.reached, theirs.reason) == (len(inputs), "")
    for i, signal in enumerate(published):
        of_ours = ours[f"true_{signal}" if signal in model.outputs else signal].to_numpy()
        assert np.ptp(of_ours) > 1e-3
        np.testing.assert_allclose(theirs.outputs[:, i], of_ours, rtol=0, atol=1e-9 * np.abs(of_ours).max())


@pytest.mark.parametrize(("version", "kind"), KINDS)
def test_an_instance_that_is_used_again_gives_the_bits_of_a_new_one(version, kind, tmp_path):
    path = make(tmp_path, SPRING, version, kind)
    body = plant(path)
    run(body)
    varied = run(body, (2.5, 4.0))
    again = run(body)
    assert body._instance.resets
    assert again.outputs.tobytes() == run(plant(path)).outputs.tobytes()
    assert varied.outputs.tobytes() == run(plant(path), (2.5, 4.0)).outputs.tobytes()
    assert varied.outputs.tobytes() != again.outputs.tobytes()


@pytest.mark.parametrize(("version", "kind"), KINDS)
def test_a_start_that_the_library_does_not_hold_is_set(version, kind, tmp_path):
    """The library begins with another mass than its XML states; what is stated counts, in every run."""
    body = plant(make(tmp_path, SPRING.faulty(INSTANTIATE="m->r[NU] = 2.75;"), version, kind))
    same = plant(make(tmp_path / "same", SPRING, version, kind))
    for values in ((2.0, 5.0), (2.5, 5.0), (2.0, 5.0), (2.0, 4.0)):
        assert run(body, values).outputs.tobytes() == run(same, values).outputs.tobytes()


@pytest.mark.parametrize("hook", ["return 3;", "return OK;"], ids=["refused", "not done"])
def test_an_fmu_that_does_not_reset_is_made_anew(hook, tmp_path, spring):
    body = plant(make(tmp_path, SPRING.faulty(RESET=hook)))
    run(body)
    assert not body._instance.resets
    assert run(body, (2.5, 4.0)).outputs.tobytes() == run(plant(spring), (2.5, 4.0)).outputs.tobytes()
    assert run(body).outputs.tobytes() == run(plant(spring)).outputs.tobytes()


def test_an_fmu_that_crashes_on_its_reset_loses_one_run(tmp_path, spring):
    path = make(tmp_path, SPRING.faulty(RESET="*(volatile int *)0 = 1;"))
    workers = Workers({"kind": "fmu", "file": str(path), "description": describe(path, SPRING_MAP).as_dict()})
    first, *others = workers.calls("simulate", [(0.01, *drive(), np.array([2.0, k])) for k in (4.0, 5.0, 5.0, 5.0)])
    workers.close()
    assert isinstance(first, Lost)
    assert "SIGSEGV" in first.reason
    expected = run(plant(spring)).outputs.tobytes()
    assert [other.outputs.tobytes() for other in others] == [expected] * 3


def test_a_step_that_the_fmu_cannot_take_is_said(tmp_path):
    own = replace(SPRING, interface_attributes='fixedInternalStepSize="0.004"')
    result = run(plant(make(tmp_path, own, 3)))
    assert result.reached == 0
    assert "steps of 0.004 s" in result.reason


def test_units_signs_and_process_noise_reach_the_fmu(spring):
    turned = SPRING_MAP | {
        "inputs": {"steering_wheel_angle": {"variable": "delta", "scale": -1}},
        "outputs": {"heading": {"variable": "rate", "scale": -1, "offset": "1 deg"}},
        "process_noise": {"side_force": {"variable": "force", "unit": "kN"}},
    }
    steer, force = drive()
    plain = plant(spring).simulate(0.01, -steer, 1e-3 * force, np.array([2.0, 5.0])).outputs[:, 0]
    theirs = plant(spring, turned).simulate(0.01, steer, force, np.array([2.0, 5.0])).outputs[:, 0]
    np.testing.assert_allclose(theirs, -plain + np.radians(1), atol=1e-15)


BOUNCE = """
dx[0] = x[1]; dx[1] = -9.81; y[0] = x[0]; y[1] = x[1];
"""


@pytest.mark.parametrize("version", [2, 3])
def test_state_and_time_events_are_handled_at_the_ends_of_steps(version, tmp_path):
    from support.fmus import Equations

    ball = Equations(
        {}, {"height": "", "velocity": ""}, {}, {"h": 1.0, "v": 0.0}, BOUNCE, 1,
        {
            "INDICATORS": "z[0] = m->x[0];",
            "EVENT": "if (m->x[0] < 0) { m->x[0] = 0; m->x[1] = -0.7 * m->x[1]; } "
            "if (m->time < 0.2 - 1e-9) m->next = 0.2; else if (!m->b[0]) { m->b[0] = 1; m->x[1] += 1.0; }",
        },
    )  # fmt: skip
    content = {
        "outputs": {n: {"variable": v, "unit": "m"} for n, v in {"position_x": "height"}.items()}
        | {"lateral_velocity": {"variable": "velocity", "unit": "m/s"}}
    }
    body = plant(make(tmp_path, ball, version, "me"), content)
    result = body.simulate(0.01, np.zeros((200, 0)), np.zeros((200, 0)), np.zeros(0))
    height, velocity, expected, kicked = 1.0, 0.0, [], False
    for k in range(200):
        expected.append((height, velocity))
        before = height
        height, velocity = height + 0.01 * velocity, velocity + 0.01 * -9.81
        if (before > 0) != (height > 0) or (k + 1 == 20):
            if height < 0:
                height, velocity = 0.0, -0.7 * velocity
            if k + 1 >= 20 and not kicked:
                kicked, velocity = True, velocity + 1.0
    assert result.reached == 200
    np.testing.assert_allclose(result.outputs, expected, atol=1e-12)


FAULTS = {
    "error": ("STEP", 'if (t >= 1.0) { say(m, "the tyre burst"); return 3; }', "returned error at t = 1", "tyre burst"),
    "fatal": ("STEP", "if (t >= 1.0) return 4;", "returned fatal at t = 1", ""),
    "discard": ("STEP", "if (t >= 1.0) return 2;", "returned discard at t = 1", ""),
    "NaN": ("GET", "if (m->time >= 1.0) m->r[NU + NP] = NAN;", "'rate' is nan at t = 1", ""),
    "infinity": ("GET", "if (m->time >= 1.0) m->r[NU + NP + 1] = INFINITY;", "'beta' is inf at t = 1", ""),
}


@pytest.mark.parametrize(("version", "kind"), KINDS)
@pytest.mark.parametrize("fault", FAULTS)
def test_a_run_that_fails_says_when_and_why_and_the_next_one_is_whole(fault, version, kind, tmp_path):
    hook, code, reason, said = FAULTS[fault]
    body = plant(make(tmp_path, SPRING.faulty(**{hook: f"if (m->r[NU + 1] == 6.0) {{ {code} }}"}), version, kind))
    whole = run(body)
    broken = run(body, (2.0, 6.0))
    assert whole.reason == ""
    assert reason in broken.reason
    assert said in broken.reason
    assert broken.reached in (100, 101)
    assert run(body).outputs.tobytes() == whole.outputs.tobytes()


@pytest.mark.parametrize("version", [2, 3])
def test_an_fmu_may_end_the_simulation(version, tmp_path):
    body = plant(make(tmp_path, SPRING.faulty(COMPLETED="*end = m->time >= 1.0;"), version, "me"))
    assert run(body).reached == 100
    assert "ended the simulation at t = 1" in run(body).reason


def test_a_step_of_fmi_3_that_comes_back_early_is_gone_on_with(tmp_path):
    early = "if (!m->b[0]) { m->b[0] = 1; *early = 1; step /= 2; *last = t + step; } else m->b[0] = 0;"
    halves = run(plant(make(tmp_path / "early", SPRING.faulty(STEP=early), 3)))
    two = run(plant(make(tmp_path / "two", SPRING, 3, substeps=2)))
    assert (halves.reached, halves.reason) == (300, "")
    np.testing.assert_allclose(halves.outputs, two.outputs, rtol=0, atol=1e-12)
    ends = run(plant(make(tmp_path / "ends", SPRING.faulty(STEP="*end = t >= 1.0;"), 3)))
    assert (ends.reached, "ended the simulation" in ends.reason) == (101, True)
    stuck = run(plant(make(tmp_path / "stuck", SPRING.faulty(STEP="*early = 1; *last = t; return OK;"), 3)))
    assert (stuck.reached, "came back early" in stuck.reason) == (1, True)


@pytest.mark.parametrize("version", [2, 3])
def test_discrete_inputs_change_in_event_mode(version, tmp_path):
    (tmp_path / "plain").mkdir()
    expected = run(plant(make(tmp_path / "plain", SPRING, version, "me")))
    sets = replace(SPRING, variability="discrete").faulty(EVENT="m->b[0]++;", COMPLETED="if (m->b[0] > 1000) return 3;")
    discrete = run(plant(make(tmp_path, sets, version, "me")))
    assert discrete.outputs.tobytes() == expected.outputs.tobytes()
    counted = run(plant(make(tmp_path, sets.faulty(COMPLETED="if (m->b[0] > 100) return 3;"), version, "me")))
    assert counted.reached == 101  # one event at the start, and one at each sample behind it


def test_events_without_an_end_are_an_error(tmp_path):
    assert "find no end" in run(plant(make(tmp_path, SPRING.faulty(EVENT="again = 1;"), 2, "me"))).reason


DEADLY = {
    "crash": ("STEP", "if (t >= 1.0) *(volatile int *)0 = 1;", "SIGSEGV"),
    "hang": ("STEP", "while (t >= 1.0);", "no answer within 20 s"),
    "flood": ("STEP", f'if (t == 1.0) for (int i = 0; i < 1000000; i++) puts("{100 * "."}"); if (t > 1) exit(7);',
              "status 7"),
    "prints": ("STEP", 'if (t == 1.0) { puts("licence expired"); fflush(stdout); exit(4); }', "licence expired"),
}  # fmt: skip


@pytest.mark.parametrize("fault", DEADLY)
def test_what_ends_its_process_loses_that_run_only(fault, tmp_path, spring):
    hook, code, reason = DEADLY[fault]
    path = make(tmp_path, SPRING.faulty(**{hook: f"if (m->r[NU + 1] == 6.0) {{ {code} }}"}))
    description = Description.of(describe(path, SPRING_MAP).as_dict())
    workers = Workers({"kind": "fmu", "file": str(path), "description": description.as_dict()}, 20.0)
    jobs = [(0.01, *drive(), np.array([2.0, k])) for k in (5.0, 6.0, 4.0)]
    first, lost, last = workers.calls("simulate", jobs)
    workers.close()
    assert isinstance(lost, Lost)
    assert reason in lost.reason
    reference = plant(spring)
    assert first.outputs.tobytes() == run(reference).outputs.tobytes()
    assert last.outputs.tobytes() == run(reference, (2.0, 4.0)).outputs.tobytes()


@pytest.mark.parametrize("version", [2, 3])
def test_a_refused_licence_is_said_in_the_words_of_the_fmu(version, tmp_path):
    hooks = {"INSTANTIATE": 'say(m, "no licence for module TRUCK"); return 0;'}
    reason = run(plant(make(tmp_path, SPRING.faulty(**hooks), version))).reason
    assert "gives no instance" in reason
    assert "no licence for module TRUCK" in reason


def test_an_abort_on_instantiation_is_one_line(tmp_path):
    path = make(tmp_path, SPRING.faulty(INSTANTIATE="abort();"))
    workers = Workers({"kind": "fmu", "file": str(path), "description": describe(path, SPRING_MAP).as_dict()}, 20.0)
    lost = workers.call("simulate", 0.01, *drive(), np.array([2.0, 5.0]))
    workers.close()
    assert isinstance(lost, Lost)
    assert "SIGABRT" in lost.reason
    assert "\n" not in lost.reason
