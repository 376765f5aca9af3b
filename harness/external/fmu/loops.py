"""Loops over time of FMUs, without Python and without the GIL: they call the C functions of an FMU by their addresses.

They are compiled in a module of their own (``harness.engine.compile.load_source``). What a loop returns is where it
ended and why: a sample, the index in ``WHY`` and a status of FMI. What most functions take:

=========================  =============================================================================
``version``                of FMI, 2 or 3
``f``                      addresses in the order of ``harness.external.fmu.instance.LOOPED``
``instance``               its address
``step``                   sample time in s
``inputs``                 in the units of the FMU ``(samples, n)``
``in_refs``, ``out_refs``  value references of inputs and of what is read
``outputs``                written, in the units of the FMU ``(samples, no)``
``x``, ``z``               states and event indicators of a model exchange
``info``, ``info_time``    32 bytes for what an event brings, and the same bytes as doubles
``flags``, ``times``       room for flags and a time that a step brings
=========================  =============================================================================
"""

from __future__ import annotations

import numpy as np

from harness.engine.simd.memory import borrowed
from harness.external.calls import call

SET, GET, SET_BOOLEAN, DO_STEP, SET_TIME, SET_STATES, GET_STATES = 0, 1, 2, 3, 4, 5, 6
DERIVATIVES, INDICATORS, COMPLETED, ENTER_EVENTS, NEW_DISCRETE, ENTER_TIME = 7, 8, 9, 10, 11, 12
GET_STATE, SET_STATE, FREE_STATE = 13, 14, 15

WHOLE, SETTING, STEPPING, GETTING, TERMINATED, NO_NUMBER, IN_EVENT, IN_DERIVATIVES, ENDLESS, EARLY = range(10)
WHY = (
    "", "setting its inputs", "its step", "reading its outputs", "it ended the simulation", "is no number",
    "handling an event", "evaluating its derivatives", "its events find no end", "its step came back early",
)  # fmt: skip

MOST_ITERATIONS = 100
"""Times that the discrete states of one event may be updated."""


def set_reals(version, f, instance, refs, values):
    """Set variables; returns the status."""
    if refs.size == 0:
        return 0
    if version == 2:
        return call(f[SET], (instance, refs, refs.size, values))
    return call(f[SET], (instance, refs, refs.size, values, values.size))


def get_reals(version, f, instance, refs, values):
    """Get variables; returns the status."""
    if refs.size == 0:
        return 0
    if version == 2:
        return call(f[GET], (instance, refs, refs.size, values))
    return call(f[GET], (instance, refs, refs.size, values, values.size))


def all_numbers(values):
    """Return whether all are finite."""
    number = True
    for i in range(values.size):
        number &= np.isfinite(values[i])
    return number


def do_step(version, f, instance, begin, end, flags, times):
    """Take a communication step; returns why it is not whole, and the status."""
    if version == 2:
        status = call(f[DO_STEP], (instance, begin, end - begin, 1))
        return (STEPPING if status > 1 else WHOLE), status
    while True:
        at = flags.ctypes.data
        status = call(f[DO_STEP], (instance, begin, end - begin, 1, at, at + 1, at + 2, times))
        if status > 1:
            return STEPPING, status
        if flags[1]:
            return TERMINATED, status
        if not flags[2] or times[0] >= end:
            return WHOLE, status
        if not times[0] > begin:
            return EARLY, status
        begin = times[0]


def co_simulate(version, f, instance, step, inputs, in_refs, out_refs, outputs):
    """Run a co-simulation; outputs at a sample are read after the inputs of that sample have been set."""
    flags, times = np.zeros(8, np.uint8), np.zeros(1)
    f, inputs, in_refs, out_refs, outputs = borrowed((f, inputs, in_refs, out_refs, outputs))
    samples = inputs.shape[0]
    for k in range(samples):
        status = set_reals(version, f, instance, in_refs, inputs[k])
        if status > 1:
            return k, SETTING, status
        status = get_reals(version, f, instance, out_refs, outputs[k])
        if status > 1:
            return k, GETTING, status
        if not all_numbers(outputs[k]):
            return k, NO_NUMBER, status
        if k + 1 < samples:
            why, status = do_step(version, f, instance, k * step, (k + 1) * step, flags, times)
            if why != WHOLE:
                return k + 1, why, status
    return samples, WHOLE, 0


def observe(version, f, instance, step, given, in_refs, present, valid_refs, valid_real, out_refs, estimates):
    """Run an observer: at each sample behind the first it is given what is measured, and steps to that sample.

    ``given`` are inputs and measurements, what is missing at its last value ``(samples, n)``; ``present`` says whether
    a measurement is there, 0 or 1 ``(samples, ny)``, to the inputs ``valid_refs``, which are reals or booleans.
    """
    flags, times, truth = np.zeros(8, np.uint8), np.zeros(1), np.zeros(max(1, valid_refs.size))
    integers, octets = np.zeros(truth.size, np.int32), np.zeros(truth.size, np.uint8)
    samples = given.shape[0]
    for k in range(samples):
        status = set_reals(version, f, instance, in_refs, given[k])
        for i in range(valid_refs.size):
            truth[i] = present[k, i]
            integers[i], octets[i] = np.int32(present[k, i]), np.uint8(present[k, i])
        if valid_refs.size > 0 and status <= 1:
            n = valid_refs.size
            if valid_real:
                status = set_reals(version, f, instance, valid_refs, truth[:n])
            elif version == 2:
                status = call(f[SET_BOOLEAN], (instance, valid_refs, n, integers))
            else:
                status = call(f[SET_BOOLEAN], (instance, valid_refs, n, octets, n))
        if status > 1:
            return k, SETTING, status
        if k > 0:
            why, status = do_step(version, f, instance, (k - 1) * step, k * step, flags, times)
            if why != WHOLE:
                return k, why, status
        status = get_reals(version, f, instance, out_refs, estimates[k])
        if status > 1:
            return k, GETTING, status
        if not all_numbers(estimates[k]):
            return k, NO_NUMBER, status
    return samples, WHOLE, 0


def new_discrete_states(version, f, instance, info, info_time):
    """Update the discrete states until they stay; returns why that ends, the status, and the next time event."""
    words = info.view(np.int32)
    for _ in range(MOST_ITERATIONS):
        at = info.ctypes.data
        if version == 2:
            status = call(f[NEW_DISCRETE], (instance, at))
            again, end, defined = words[0] != 0, words[1] != 0, words[4] != 0
        else:
            status = call(f[NEW_DISCRETE], (instance, at, at + 1, at + 2, at + 3, at + 4, at + 24))
            again, end, defined = info[0] != 0, info[1] != 0, info[4] != 0
        if status > 1:
            return IN_EVENT, status, np.inf
        if end:
            return TERMINATED, status, np.inf
        if not again:
            return WHOLE, status, (info_time[3] if defined else np.inf)
    return ENDLESS, 0, np.inf


def handle_event(version, f, instance, x, z, info, info_time):
    """Go through event mode and back to continuous time; writes the states and event indicators behind it.

    Returns:
        Why it fails, the status, the next time event.
    """
    why, status, event = new_discrete_states(version, f, instance, info, info_time)
    if why != WHOLE:
        return why, status, event
    status = call(f[ENTER_TIME], (instance,))
    if status <= 1 and x.size > 0:
        status = call(f[GET_STATES], (instance, x, x.size))
    if status <= 1 and z.size > 0:
        status = call(f[INDICATORS], (instance, z, z.size))
    return (IN_EVENT if status > 1 else WHOLE), status, event


def integrate(f, instance, begin, h, behind, weight, x, room):
    """Take one step of a Runge-Kutta method, in the arithmetic of ``harness.engine.codegen.integrators``.

    It is ``h`` s long; ``behind`` and ``weight`` are the tableau, ``room`` is ``(3, nx)``. Returns the status.
    """
    if x.size == 0:
        return 0
    stage, slope, total = room[0], room[1], room[2]
    stages = weight.size
    for s in range(stages):
        if s > 0:
            status = call(f[SET_TIME], (instance, begin + h * behind[s]))
            if status <= 1:
                status = call(f[SET_STATES], (instance, stage, x.size))
            if status > 1:
                return status
        status = call(f[DERIVATIVES], (instance, slope, x.size))
        if status > 1:
            return status
        for i in range(x.size):
            k = slope[i]
            r = weight[s] * k
            if s > 0:
                r = total[i] + r
            if s + 1 < stages:
                total[i] = r
                stage[i] = x[i] + h * behind[s + 1] * k
            else:
                x[i] = x[i] + h * r
    return 0


def exchange(version, f, instance, timing, tableau, inputs, in_refs, out_refs, outputs, sizes):
    """Run a model exchange with steps of fixed length; state events are handled at the ends of the steps.

    ``timing`` is the sample time in s, the steps of the integrator per sample, and whether inputs may change in event
    mode only; ``tableau`` the fractions of the step behind its beginning and the weights of each stage; ``sizes`` the
    numbers of states and event indicators.
    """
    f, inputs, in_refs, out_refs, outputs = borrowed((f, inputs, in_refs, out_refs, outputs))
    step, substeps, by_event = timing
    behind, weight = tableau
    x, z, room = np.zeros(sizes[0]), np.zeros(sizes[1]), np.zeros((3, sizes[0]))
    before, flags = np.zeros(sizes[1]), np.zeros(16, np.uint8)
    info = np.zeros(32, np.uint8)
    info_time = info.view(np.float64)
    words = flags.view(np.int32)
    why, status, event = handle_event(version, f, instance, x, z, info, info_time)
    if why != WHOLE:
        return 0, why, status
    samples, h = inputs.shape[0], step / substeps
    for k in range(samples):
        if by_event and k > 0:
            status = enter_event_mode(version, f, instance)
            if status <= 1:
                status = set_reals(version, f, instance, in_refs, inputs[k])
            if status > 1:
                return k, SETTING, status
            why, status, event = handle_event(version, f, instance, x, z, info, info_time)
            if why != WHOLE:
                return k, why, status
        else:
            status = set_reals(version, f, instance, in_refs, inputs[k])
            if status > 1:
                return k, SETTING, status
        status = get_reals(version, f, instance, out_refs, outputs[k])
        if status > 1:
            return k, GETTING, status
        if not all_numbers(outputs[k]):
            return k, NO_NUMBER, status
        if k + 1 == samples:
            break
        if z.size > 0:  # those of the new inputs
            status = call(f[INDICATORS], (instance, z, z.size))
            if status > 1:
                return k + 1, STEPPING, status
        for s in range(substeps):
            before[:] = z
            status = integrate(f, instance, k * step + s * h, h, behind, weight, x, room)
            if status > 1:
                return k + 1, IN_DERIVATIVES, status
            now = (k + 1) * step if s + 1 == substeps else k * step + (s + 1) * h
            why, status, event_mode = complete(version, f, instance, now, x, z, flags, words)
            if why != WHOLE:
                return k + 1, why, status
            for i in range(z.size):
                event_mode |= (before[i] > 0.0) != (z[i] > 0.0)
            if event_mode or now >= event - 1e-9 * step:
                status = enter_event_mode(version, f, instance)
                if status > 1:
                    return k + 1, IN_EVENT, status
                why, status, event = handle_event(version, f, instance, x, z, info, info_time)
                if why != WHOLE:
                    return k + 1, why, status
    return samples, WHOLE, 0


def enter_event_mode(version, f, instance):
    """Enter event mode; returns the status."""
    return call(f[ENTER_EVENTS], (instance,))


def complete(version, f, instance, now, x, z, flags, words):
    """Complete a step of the integrator; writes the event indicators at its end.

    Returns:
        Why it fails, the status, whether the FMU asks for event mode.
    """
    status = call(f[SET_TIME], (instance, now))
    if status <= 1 and x.size > 0:
        status = call(f[SET_STATES], (instance, x, x.size))
    if status <= 1 and z.size > 0:
        status = call(f[INDICATORS], (instance, z, z.size))
    if status > 1:
        return STEPPING, status, False
    at = flags.ctypes.data
    if version == 2:
        status = call(f[COMPLETED], (instance, 1, at, at + 4))
        event_mode, end = words[0] != 0, words[1] != 0
    else:
        status = call(f[COMPLETED], (instance, 1, at, at + 1))
        event_mode, end = flags[0] != 0, flags[1] != 0
    if status > 1:
        return STEPPING, status, False
    return (TERMINATED if end else WHOLE), status, event_mode


def many_ahead(version, f, instance, begin, h, substeps, tableau, u, in_refs, members):
    """Send states a sample ahead, with inputs held: written over them ``(n, nx)``; returns the status."""
    behind, weight = tableau
    room = np.zeros((3, members.shape[1]))
    status = set_reals(version, f, instance, in_refs, u)
    for m in range(members.shape[0]):
        x = members[m]
        for s in range(substeps):
            if status <= 1:
                status = call(f[SET_TIME], (instance, begin + s * h))
            if status <= 1:
                status = call(f[SET_STATES], (instance, x, x.size))
            if status <= 1:
                status = integrate(f, instance, begin + s * h, h, behind, weight, x, room)
    return status


def many_outputs(version, f, instance, time, u, in_refs, members, out_refs, outputs):
    """Read outputs ``(n, no)`` of states ``(n, nx)`` at a time; returns the status."""
    status = set_reals(version, f, instance, in_refs, u)
    if status <= 1:
        status = call(f[SET_TIME], (instance, time))
    for m in range(members.shape[0]):
        x = members[m]
        if status <= 1:
            status = call(f[SET_STATES], (instance, x, x.size))
        if status <= 1:
            status = get_reals(version, f, instance, out_refs, outputs[m])
    return status


def get_states(f, instance, states):
    """Get the present state into every slot ``(n,)``; returns the status."""
    status = 0
    for n in range(states.size):
        if status <= 1:
            status = call(f[GET_STATE], (instance, states.ctypes.data + 8 * n))
    return status


def copy_states(f, instance, sources, targets):
    """Copy states into slots ``(n,)``; returns the status."""
    status = 0
    for n in range(sources.size):
        if status <= 1:
            status = call(f[SET_STATE], (instance, sources[n]))
        if status <= 1:
            status = call(f[GET_STATE], (instance, targets.ctypes.data + 8 * n))
    return status


def free_states(f, instance, states):
    """Free the states in slots ``(n,)``."""
    for n in range(states.size):
        if states[n] != 0:
            call(f[FREE_STATE], (instance, states.ctypes.data + 8 * n))


def move_particles(version, f, instance, ends, states, given, in_refs, after, next_refs, out_refs, outputs):
    """Take a communication step of every state ``(n,)`` with inputs of its own, and read outputs behind it.

    ``given`` are inputs during the step ``(n, n inputs)``, ``after`` those behind it. Where the ends of the step are
    one time, outputs alone are read. Returns the status.
    """
    flags, times = np.zeros(8, np.uint8), np.zeros(1)
    status = 0
    for n in range(states.size):
        if status <= 1:
            status = call(f[SET_STATE], (instance, states[n]))
        if status <= 1 and ends[1] > ends[0]:
            status = set_reals(version, f, instance, in_refs, given[n])
            if status <= 1:
                why, status = do_step(version, f, instance, ends[0], ends[1], flags, times)
                if why != WHOLE and status <= 1:
                    status = 2
        if status <= 1:
            status = set_reals(version, f, instance, next_refs, after)
        if status <= 1:
            status = get_reals(version, f, instance, out_refs, outputs[n])
        if status <= 1:
            status = call(f[GET_STATE], (instance, states.ctypes.data + 8 * n))
    return status
