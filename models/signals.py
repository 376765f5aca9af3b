"""The table of signals: name, symbol, SI unit, report unit, frame and meaning; those of components come with them.

Axes follow ISO 8855: x forward, y left, z up, angles positive counter-clockwise seen from above, so
``articulation_angle = heading_trailer - heading_tractor``. Everything inside the project is in SI units
and radians; ``report_unit`` is what figures and tables show.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from types import ModuleType

from harness.common import components
from harness.common.errors import ModelError
from harness.models.roles import EFFECTS, SENSORS, TYRES, VEHICLES


@dataclass(frozen=True)
class Signal:
    """One measurable or computable quantity.

    Attributes:
        name: Word used in studies, recordings and code.
        symbol: LaTeX symbol.
        unit: SI unit (pint).
        report_unit: Unit of figures and tables (pint).
        frame: Frame the quantity is expressed in.
        meaning: One phrase; the sign convention where it is not that of the frame.
        periodic: Whether it is an angle (rad) that a whole turn does not change, so that differences of it are taken
            modulo a turn.
    """

    name: str
    symbol: str
    unit: str
    report_unit: str
    frame: str
    meaning: str
    periodic: bool = False


def turn_of(name: str) -> float:
    """Return after how much a signal repeats itself: a turn (rad), or 0 where it does not."""
    return 2.0 * math.pi if name in SIGNALS and SIGNALS[name].periodic else 0.0


def _axle_forces(axle: str, where: str) -> list[Signal]:
    """Return what a tyre publishes at an axle."""
    return [
        Signal(f"lateral_force_axle_{axle}", f"F_{{y{axle}}}", "N", "kN", "axle", f"lateral force, {where}"),
        Signal(
            f"steady_lateral_force_axle_{axle}",
            f"F_{{0y{axle}}}",
            "N",
            "kN",
            "axle",
            f"quasi-steady lateral tyre force, {where}",
        ),
        Signal(f"vertical_load_axle_{axle}", f"F_{{z{axle}}}", "N", "kN", "axle", f"vertical load, {where}"),
        Signal(
            f"slip_angle_axle_{axle}",
            rf"\alpha_{{{axle}}}",
            "rad",
            "deg",
            "axle",
            f"slip angle, positive when it makes a force to the left, {where}",
        ),
        Signal(
            f"lateral_force_capacity_axle_{axle}", f"D_{{{axle}}}", "N", "kN", "axle", f"largest lateral force, {where}"
        ),
        Signal(
            f"cornering_stiffness_axle_{axle}",
            f"C_{{F{axle}}}",
            "N/rad",
            "kN/rad",
            "axle",
            f"slope of force over slip at zero slip, {where}",
        ),
    ]


def _axle_states(axle: str, where: str) -> list[Signal]:
    """Return what effects have at an axle."""
    return [
        Signal(f"load_share_axle_{axle}", "s", "1", "1", "axle", f"share in the load of its bogie, {where}"),
        Signal(f"relaxed_force_axle_{axle}", "F_r", "N", "kN", "axle", f"relaxing lateral force, {where}"),
        Signal(
            f"compliance_steer_axle_{axle}", r"\delta_A", "rad", "deg", "axle", f"angle yielded to the force, {where}"
        ),
        Signal(f"swivelled_{axle}", r"\alpha_S", "rad", "deg", "axle", f"slip angle behind trailing wheels, {where}"),
    ]


def _tyre_states(tyre: str) -> list[Signal]:
    """Return what effects have at the axles that share a tyre."""
    which, a = f"as the roll follows it, for tyre {tyre}", "lateral acceleration"
    return [
        Signal(f"roll_steer_leaning_{tyre}", "a_R", "m/s^2", "m/s^2", "axle", f"{a} {which}"),
        Signal(f"roll_steer_leaning_rate_{tyre}", r"\dot a_R", "m/s^3", "m/s^3", "axle", f"rate of the {a} {which}"),
    ]


def _body_forces(body: str, index: str) -> list[Signal]:
    """Return the forces from outside on one of several bodies."""
    return [
        Signal(
            f"external_lateral_force_{body}",
            rf"F_{{\mathrm{{ext}}{index}}}",
            "N",
            "kN",
            body,
            f"external lateral force at the CoG of the {body}",
        ),
        Signal(
            f"external_yaw_moment_{body}",
            rf"M_{{\mathrm{{ext}}{index}}}",
            "N*m",
            "kN*m",
            body,
            f"external yaw moment on the {body}",
        ),
    ]


def _body_motion(body: str, owner: str) -> list[Signal]:
    """Return what a body publishes for effects; ``body`` is what is appended to the names."""
    noise = "filtered white noise of unit intensity"
    walks = [
        Signal(f"unmodelled_{what}_walk{body}", symbol, "s**0.5", "s**0.5", owner, f"{noise}, {what}, {owner}")
        for what, symbol in (("force", "b_1"), ("moment", "b_2"))
    ]
    sideslip = [Signal(f"sideslip_angle{body}", r"\beta", "rad", "deg", owner, f"direction of motion, {owner} CoG")]
    return [
        *walks,
        *(sideslip if body else []),  # of a vehicle of one body it is among its signals
        Signal(f"inertial_mass{body}", "m", "kg", "kg", owner, f"mass that moves as one rigid body, {owner}"),
        Signal(f"lateral_gravity{body}", "g_y", "m/s^2", "m/s^2", owner, f"gravity along the y axis, {owner}"),
        Signal(f"longitudinal_gravity{body}", "g_x", "m/s^2", "m/s^2", owner, f"gravity along the x axis, {owner}"),
        Signal(f"pitch_moment{body}", "M_y", "N*m", "kN*m", owner, f"moment that loads the front of the {owner}"),
        Signal(f"yaw_acceleration{body}", r"\ddot\psi", "rad/s^2", "deg/s^2", owner, f"yaw acceleration, {owner}"),
        Signal(f"cog_shift{body}", "d", "m", "m", owner, f"CoG ahead of where the parameters put it, {owner}"),
        Signal(f"slosh_displacement{body}", "y_s", "m", "m", owner, f"liquid to the left of the {owner}'s axis"),
        Signal(f"slosh_velocity{body}", r"\dot y_s", "m/s", "m/s", owner, f"velocity of the liquid in the {owner}"),
        Signal(
            f"body_leaning{body}", "a_R", "m/s^2", "m/s^2", owner, f"lateral acceleration behind the {owner}'s roll"
        ),
        Signal(f"body_leaning_rate{body}", r"\dot a_R", "m/s^3", "m/s^3", owner, f"rate of the same, {owner}"),
        Signal(f"body_leaning_acceleration{body}", r"\ddot a_R", "m/s^4", "m/s^4", owner, f"rate of that, {owner}"),
        Signal(f"coupling_sway{body}", r"\dot y_K", "m/s", "m/s", owner, f"coupling against the CoG, by roll, {owner}"),
        Signal(f"coupling_sway_rate{body}", r"\ddot y_K", "m/s^2", "m/s^2", owner, f"rate of the same, {owner}"),
        Signal(f"brake_speed{body}", "v_B", "m/s", "m/s", owner, f"speed behind the lag of the {owner}'s brake pull"),
        Signal(f"pitch_speed{body}", "v_p", "m/s", "m/s", owner, f"speed that the pitch of the {owner} has settled to"),
    ]


def _of_sensor(s: Signal) -> list[Signal]:
    """Return the states of a sensor that reads late, is turned, or whose bias wanders."""
    return [
        Signal(f"drift_{s.name}", "d", "", "", s.frame, f"random walk of the bias of {s.name}, over its deviation"),
        Signal(f"delayed_{s.name}", s.symbol, s.unit, s.report_unit, s.frame, f"{s.name}, first state of a delay"),
        Signal(f"delayed_rate_{s.name}", s.symbol, s.unit, s.report_unit, s.frame, "second state of the delay"),
        Signal(f"misaligned_speed_{s.name}", "v_x", "m/s", "m/s", s.frame, f"speed behind a lag, of {s.name}"),
    ]


def _leaning(s: Signal) -> list[Signal]:
    """Return the states of a leaning accelerometer."""
    return [
        Signal(
            f"leaning_{s.name}", s.symbol, s.unit, s.report_unit, s.frame, f"{s.name} behind roll or pitch of the body"
        ),
        Signal(f"leaning_rate_{s.name}", s.symbol, "m/s^3", "m/s^3", s.frame, "time derivative of the same"),
    ]


_AXLES = {
    "11": "first tractor axle (steered)",
    "12": "second tractor axle",
    "21": "first trailer axle",
    "22": "second trailer axle",
    "23": "third trailer axle",
    "fl": "front left wheel of a car",
    "fr": "front right wheel of a car",
    "rl": "rear left wheel of a car",
    "rr": "rear right wheel of a car",
    "front": "front axle of a car",
    "rear": "rear axle of a car",
}

_BELIEF = "an estimator's belief"  # the owner of parameters that are signals
_ROWS: list[Signal] = [
    Signal("time", "t", "s", "s", "", "time since the start of the recording"),
    Signal("steering_wheel_angle", r"\delta_L", "rad", "deg", "vehicle", "steering-wheel angle, left positive"),
    Signal("road_wheel_angle", r"\delta", "rad", "deg", "vehicle", "road-wheel angle of the steered axle"),
    Signal("speed", "v_x", "m/s", "m/s", "trailer", "longitudinal speed (of the trailer, for a semitrailer)"),
    Signal("speed_rate", r"\dot v_x", "m/s^2", "m/s^2", "trailer", "time derivative of speed"),
    Signal(
        "speed_over_ground", "v_x", "m/s", "m/s", "trailer", "true longitudinal speed, of which speed is the record"
    ),
    Signal("speed_over_ground_rate", r"\dot v_x", "m/s^2", "m/s^2", "trailer", "time derivative of speed_over_ground"),
    Signal("speed_tractor", "v_{x1}", "m/s", "m/s", "tractor", "longitudinal speed of the tractor"),
    Signal("lateral_velocity_tractor", "v_{y1}", "m/s", "m/s", "tractor", "lateral velocity of the tractor CoG"),
    Signal("lateral_velocity_trailer", "v_{y2}", "m/s", "m/s", "trailer", "lateral velocity of the trailer CoG"),
    Signal("yaw_rate_tractor", r"\dot\psi_1", "rad/s", "deg/s", "tractor", "yaw rate of the tractor"),
    Signal("yaw_rate_trailer", r"\dot\psi_2", "rad/s", "deg/s", "trailer", "yaw rate of the trailer"),
    Signal(
        "articulation_angle",
        r"\theta",
        "rad",
        "deg",
        "vehicle",
        "heading of the trailer minus that of the tractor",
    ),
    Signal(
        "lateral_acceleration_tractor",
        "a_{y1}",
        "m/s^2",
        "m/s^2",
        "tractor",
        "lateral acceleration of the tractor CoG",
    ),
    Signal(
        "lateral_acceleration_trailer",
        "a_{y2}",
        "m/s^2",
        "m/s^2",
        "trailer",
        "lateral acceleration of the trailer CoG",
    ),
    Signal("coupling_force", "H", "N", "kN", "trailer", "lateral kingpin force on the tractor, trailer axes"),
    Signal("coupling_moment", "M_K", "N*m", "kN*m", "vehicle", "yaw moment of the coupling on the trailer"),
    Signal("constraint_violation", r"\gamma", "m/s", "m/s", "tractor", "lateral slip of the kingpin (0 if tied)"),
]
_ROWS += [  # the exercises of KIT 2015
    Signal("heading", r"\psi", "rad", "deg", "earth", "yaw angle of the vehicle", periodic=True),
    Signal("heading_increment", r"\Delta\psi", "rad", "deg", "earth", "change of heading from sample to sample"),
    Signal("example_state", "x", "dimensionless", "dimensionless", "", "state of the lecture's scalar example"),
    Signal("example_input", "u", "dimensionless", "dimensionless", "", "input of the lecture's scalar example"),
]
_ROWS += [  # what positioning systems add to a measured drive
    Signal("position_x", "x", "m", "m", "earth", "position, east of the origin where the heading is from east"),
    Signal("position_y", "y", "m", "m", "earth", "position, north of the origin where the heading is from east"),
    Signal("latitude", r"\varphi", "rad", "deg", "earth", "geodetic latitude (WGS 84), north positive"),
    Signal("longitude", r"\lambda", "rad", "deg", "earth", "longitude (WGS 84), east positive"),
    Signal("yaw_acceleration", r"\ddot\psi", "rad/s^2", "deg/s^2", "vehicle", "yaw acceleration"),
]
_ROWS += [  # a car
    Signal("longitudinal_velocity", "v_x", "m/s", "m/s", "vehicle", "longitudinal velocity of the CoG"),
    Signal("lateral_velocity", "v_y", "m/s", "m/s", "vehicle", "lateral velocity of the CoG"),
    Signal("lateral_velocity_rear", "v_{y,r}", "m/s", "m/s", "vehicle", "lateral velocity at the rear axle"),
    Signal("yaw_rate", "r", "rad/s", "deg/s", "vehicle", "yaw rate"),
    Signal("sideslip_angle", r"\beta", "rad", "deg", "vehicle", "direction of motion of the CoG, left of the x axis"),
    Signal("roll_angle", r"\varphi", "rad", "deg", "vehicle", "roll angle, positive when leaning to the right"),
    Signal("roll_rate", r"\dot\varphi", "rad/s", "deg/s", "vehicle", "roll rate"),
    Signal("longitudinal_acceleration", "a_x", "m/s^2", "m/s^2", "vehicle", "longitudinal acceleration of the CoG"),
    Signal("lateral_acceleration", "a_y", "m/s^2", "m/s^2", "vehicle", "lateral acceleration of the CoG"),
    Signal("friction_coefficient", r"\mu", "1", "1", "road", "largest friction between tyre and road"),
    Signal("friction_rate", r"\dot\mu", "1/s", "1/s", "road", "time derivative of the friction coefficient"),
    Signal("driving_force", "F_T", "N", "kN", "vehicle", "force of drive and brakes demanded of the tyres"),
    Signal("external_longitudinal_force", r"F_{\mathrm{ext},x}", "N", "kN", "vehicle", "external force along x"),
    Signal("external_lateral_force", r"F_{\mathrm{ext},y}", "N", "kN", "vehicle", "external lateral force at the CoG"),
    Signal("external_yaw_moment", r"M_{\mathrm{ext}}", "N*m", "kN*m", "vehicle", "external yaw moment"),
]
for _end, _index in (("front", "1"), ("rear", "2")):
    _ROWS += [
        Signal(f"slip_angle_{_end}", rf"\alpha_{_index}", "rad", "deg", "axle", f"slip angle of the {_end} axle"),
        Signal(
            f"cornering_stiffness_{_end}",
            f"k_{_index}",
            "N/rad",
            "kN/rad",
            "axle",
            f"lateral force over slip angle of the {_end} axle, both wheels",
        ),
    ]
_ROWS += [row for _body, _index in (("tractor", "1"), ("trailer", "2")) for row in _body_forces(_body, _index)]
_ROWS += [row for _axle, _where in _AXLES.items() for row in _axle_forces(_axle, _where)]

_ROWS += [  # what vehicles of one body publish for effects; of several bodies with their names appended
    row
    for _body, _of in (("", "vehicle"), ("_tractor", "tractor"), ("_trailer", "trailer"))
    for row in _body_motion(_body, _of)
]
_ROWS += [  # states and inputs of effects
    Signal("bank_angle", r"\varphi_B", "rad", "deg", "road", "road bank, positive when the left side is higher"),
    Signal("bank_walk", "b", "s**0.5", "s**0.5", "road", "filtered white noise of unit intensity"),
    Signal("steering_lagged", r"\delta_T", "rad", "deg", "vehicle", "road-wheel angle behind the lag of the steering"),
    Signal("steering_delayed", r"\delta_\tau", "rad", "deg", "vehicle", "first state of the delayed road-wheel angle"),
    Signal("steering_delayed_rate", r"\dot\delta_\tau", "rad", "deg", "vehicle", "second state of the same"),
    Signal("speed_delayed", r"v_\tau", "m/s", "m/s", "vehicle", "first state of the delayed speed"),
    Signal("speed_delayed_rate", r"\dot v_\tau", "m/s", "m/s", "vehicle", "second state of the same"),
    Signal("steering_followed", r"\delta_b", "rad", "deg", "vehicle", "centre of the play of the steering"),
    Signal("steering_yield", r"\delta_c", "rad", "deg", "vehicle", "angle by which the steering yields to its force"),
    Signal("steering_force", "F_c", "N", "kN", "vehicle", "lateral force behind the lag of the steering's compliance"),
    Signal("lateral_force_steered_axle", r"F_\delta", "N", "kN", "vehicle", "lateral force of the steered axle"),
    Signal("pull_speed", "v_D", "m/s", "m/s", "vehicle", "speed behind the lag of the drive's pull"),
    Signal("drive_speed", "v_d", "m/s", "m/s", "vehicle", "speed behind the lag of drive and brake forces"),
    Signal("lateral_velocity_reference", "v_{y,R}", "m/s", "m/s", "vehicle", "lateral velocity at the reference point"),
]
_ROWS += [row for _axle, _where in _AXLES.items() for row in _axle_states(_axle, _where)]
_ROWS += [row for _tyre in ("11", "12", "2", "front", "rear") for row in _tyre_states(_tyre)]

_MEASURED = ("yaw_rate", "heading", "articulation_angle", "sideslip_angle", "roll", "acceleration", "velocity")
_ROWS += [
    row
    for s in list(_ROWS)
    if any(word in s.name for word in _MEASURED) or s.name.startswith("lateral_force_axle")
    for row in _of_sensor(s)
]
_LEANING = ("lateral_acceleration", "longitudinal_acceleration")
_ROWS += [row for s in list(_ROWS) if s.name.startswith(_LEANING) for row in _leaning(s)]


class SignalTable(Mapping[str, Signal]):
    """Every signal by name: those above, and those that components bring with them.

    A component states signals of its own as ``SIGNALS``, a tuple of ``Signal``; the axles (``AXLES``) and bodies
    (``BODIES``) of a vehicle bring the signals of every axle and body, described by its ``AXLE_NAMES`` where it has
    them. They are known as soon as a model has that part; a name that is not known yet, and whoever wants to see the
    whole table, has all components looked at.
    """

    def __init__(self, rows: Iterable[Signal]) -> None:
        self._ours = {s.name: s for s in rows}
        self._further: dict[str, tuple[Signal, str]] = {}
        self._learned: dict[str, ModuleType] = {}
        self._looked: object = None

    def __getitem__(self, name: str) -> Signal:
        if name in self._ours:
            return self._ours[name]
        self._look()
        return self._further[name][0]

    def __iter__(self) -> Iterator[str]:
        self._look()
        return iter((*self._ours, *self._further))

    def __len__(self) -> int:
        self._look()
        return len(self._ours) + len(self._further)

    def learn(self, module: ModuleType) -> None:
        """Take up the signals that a part of a model brings; nothing happens if they are known.

        Raises:
            ModelError: If a signal of that name is something else.
        """
        place = components.place_of(module)
        owner = f"{components.name_of(module)} in {place}"
        if self._learned.get(owner) is module:
            return
        self._drop(owner)
        self._learned[owner] = module
        own = vars(module).get("SIGNALS", ())
        stated = () if own is self else tuple(own)
        for signal in stated:
            if not isinstance(signal, Signal):
                raise ModelError(f"{place}: SIGNALS: expected harness.models.signals.Signal, got {signal!r}")
            other = self._listed(signal.name)
            if other not in (None, signal):
                by = self._further[signal.name][1] if signal.name in self._further else "models/signals.py"
                raise ModelError(
                    f"{place}: signal '{signal.name}' is another one than in {by}, which says {other}; "
                    "take another name"
                )
        for signal in (
            *stated,
            *_of_layout(module),
            *(row for s in stated for row in (*_of_sensor(s), *(_leaning(s) if s.unit == "m/s^2" else ()))),
        ):
            if self._listed(signal.name) is None:
                self._further[signal.name] = signal, owner

    def add(self, signal: Signal) -> None:
        """Take up a quantity that a model has made a signal, such as a parameter that is estimated.

        Vehicles may each have a parameter of that name: the one added last is meant.

        Raises:
            ModelError: If a component's signal of that name is something else.
        """
        other = self._listed(signal.name)
        if other is None or self._further.get(signal.name, ("", ""))[1] == _BELIEF:
            self._further[signal.name] = signal, _BELIEF
        elif other != signal:
            raise ModelError(f"'{signal.name}' is a signal already: {other.meaning}; it cannot be estimated as well")

    def _listed(self, name: str) -> Signal | None:
        return self._ours.get(name) or self._further.get(name, (None,))[0]

    def _drop(self, owner: str) -> None:
        self._learned.pop(owner, None)
        self._further = {n: row for n, row in self._further.items() if row[1] != owner}

    def _look(self) -> None:
        """Take up the signals of every component there is, once until others are there."""
        now = components.generation()
        if now == self._looked:
            return
        for owner, module in list(self._learned.items()):
            if components.is_component(module):  # those that are still there are taken up again
                self._drop(owner)
        self._looked = now
        try:
            for role in (VEHICLES, TYRES, EFFECTS, SENSORS):
                for name in role.names():
                    self.learn(role.load(name))
        except BaseException:
            self._looked = None
            raise


def _of_layout(module: ModuleType) -> list[Signal]:
    """Return the signals of every axle and body of a vehicle."""
    words = getattr(module, "AXLE_NAMES", {})
    axles = {axle: words.get(axle, f"axle {axle}") for axle in getattr(module, "AXLES", {})}
    bodies = [body for body in getattr(module, "BODIES", {}) if body]
    rows = [row for body in bodies for row in (*_body_forces(body, body), *_body_motion(f"_{body}", body))]
    rows += [row for axle, where in axles.items() for row in (*_axle_forces(axle, where), *_axle_states(axle, where))]
    rows += [row for tyre in dict.fromkeys(getattr(module, "AXLES", {}).values()) for row in _tyre_states(tyre)]
    return rows + [row for s in rows if s.name.startswith("lateral_force_axle") for row in _of_sensor(s)]


SIGNALS = SignalTable(_ROWS)

TRUTH = "true_"
"""Before the name of a signal: what a simulated vehicle did, where the signal itself is what its sensor gave."""

MAGNITUDE: dict[str, float] = {
    "rad": 0.1,
    "rad/s": 0.1,
    "m/s": 1.0,
    "m/s^2": 1.0,
    "N": 1e4,
}
"""Usual magnitude of a measured quantity by its unit, in which bounds of sensor errors are counted."""


def signal_attributes(name: str) -> dict[str, str]:
    """Return ``units``, ``long_name`` and ``frame`` of a signal."""
    signal = SIGNALS.get(name)
    if signal is None:
        return {"units": "", "long_name": name, "frame": ""}
    return {"units": signal.unit, "long_name": signal.meaning, "frame": signal.frame}
