"""The one table of signals: name, symbol, SI unit, report unit, frame and meaning.

Axes follow ISO 8855: x forward, y left, z up, angles positive counter-clockwise seen from above, so
``articulation_angle = heading_trailer - heading_tractor``. Everything inside the project is in SI units
and radians; ``report_unit`` is what figures and tables show.
"""

from __future__ import annotations

from dataclasses import dataclass


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
    """

    name: str
    symbol: str
    unit: str
    report_unit: str
    frame: str
    meaning: str


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

_ROWS: list[Signal] = [
    Signal("time", "t", "s", "s", "", "time since the start of the recording"),
    Signal("steering_wheel_angle", r"\delta_L", "rad", "deg", "vehicle", "steering-wheel angle, left positive"),
    Signal("road_wheel_angle", r"\delta", "rad", "deg", "vehicle", "road-wheel angle of the steered axle"),
    Signal("speed", "v_x", "m/s", "m/s", "trailer", "longitudinal speed (of the trailer, for a semitrailer)"),
    Signal("speed_rate", r"\dot v_x", "m/s^2", "m/s^2", "trailer", "time derivative of speed"),
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
    Signal("heading", r"\psi", "rad", "deg", "earth", "yaw angle of the vehicle"),
    Signal("heading_increment", r"\Delta\psi", "rad", "deg", "earth", "change of heading from sample to sample"),
    Signal("example_state", "x", "dimensionless", "dimensionless", "", "state of the lecture's scalar example"),
    Signal("example_input", "u", "dimensionless", "dimensionless", "", "input of the lecture's scalar example"),
]
_ROWS += [  # what positioning systems add to a measured drive
    Signal("position_x", "x", "m", "m", "earth", "position, east of the origin where the heading is from east"),
    Signal("position_y", "y", "m", "m", "earth", "position, north of the origin where the heading is from east"),
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
    Signal("driving_force", "F_T", "N", "kN", "vehicle", "force of drive and brakes asked of the tyres"),
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
for _body, _index in (("tractor", "1"), ("trailer", "2")):
    _ROWS += [
        Signal(
            f"external_lateral_force_{_body}",
            rf"F_{{\mathrm{{ext}}{_index}}}",
            "N",
            "kN",
            _body,
            f"external lateral force at the CoG of the {_body}",
        ),
        Signal(
            f"external_yaw_moment_{_body}",
            rf"M_{{\mathrm{{ext}}{_index}}}",
            "N*m",
            "kN*m",
            _body,
            f"external yaw moment on the {_body}",
        ),
    ]
for _axle, _where in _AXLES.items():
    _ROWS += [
        Signal(f"lateral_force_axle_{_axle}", f"F_{{y{_axle}}}", "N", "kN", "axle", f"lateral force, {_where}"),
        Signal(
            f"steady_lateral_force_axle_{_axle}",
            f"F_{{0y{_axle}}}",
            "N",
            "kN",
            "axle",
            f"quasi-steady lateral tyre force, {_where}",
        ),
        Signal(f"vertical_load_axle_{_axle}", f"F_{{z{_axle}}}", "N", "kN", "axle", f"vertical load, {_where}"),
        Signal(
            f"slip_angle_axle_{_axle}",
            rf"\alpha_{{{_axle}}}",
            "rad",
            "deg",
            "axle",
            f"slip angle, positive when it makes a force to the left, {_where}",
        ),
        Signal(
            f"lateral_force_capacity_axle_{_axle}",
            f"D_{{{_axle}}}",
            "N",
            "kN",
            "axle",
            f"largest lateral force, {_where}",
        ),
        Signal(
            f"cornering_stiffness_axle_{_axle}",
            f"C_{{F{_axle}}}",
            "N/rad",
            "kN/rad",
            "axle",
            f"slope of force over slip at zero slip, {_where}",
        ),
    ]

SIGNALS: dict[str, Signal] = {s.name: s for s in _ROWS}
