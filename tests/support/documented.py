"""What README and docs show, as it can be run: the fences of a page in order, and the files that pages speak of.

A fence of ``sh`` is commands, one of ``python`` a cell; a fence below ``**`name`**`` is a file. How a command is run
where it is not run as written says a comment above its fence, which no reader sees, a line for each::

    <!-- commands
    harness run studies/mass.toml: with --quick; all of it takes ten minutes
    harness realtime: begun; a minute
    -->

``with ARGUMENTS`` runs it with further ones, ``begun`` up to where its work begins, ``shown`` not at all. The reason
stands behind the semicolon.
"""

import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd

import harness as h

ROOT = Path(__file__).parents[2]
PAGES = ["README.md", "CONTRIBUTING.md", *sorted(str(p.relative_to(ROOT)) for p in (ROOT / "docs").rglob("*.md"))]
PART = re.compile(
    r"<!-- commands\n(?P<modes>.*?)-->|^\*\*`(?P<file>[\w/.-]+)`\*\*\n\n```\w+\n(?P<content>.*?)^```"
    r"|^```(?P<language>\w*)\n(?P<body>.*?)^```",
    re.DOTALL | re.MULTILINE,
)
MODE = re.compile(r"(?P<command>[^:]+): (?P<how>begun|shown|with (?P<more>[^;]+)); (?P<why>\S.*)")


@dataclass(frozen=True)
class Part:
    """A part of a page: ``file`` with a name, ``python``, or ``sh``, a single command.

    Attributes:
        kind: Which.
        text: Content of the file, cell, or command as written.
        name: Of the file.
        how: Of a command: empty if it is run as written, else ``begun``, ``shown`` or ``with``.
        more: Arguments that are added to it.
    """

    kind: str
    text: str
    name: str = ""
    how: str = ""
    more: str = ""


def parts(page: str) -> list[Part]:
    """Return the parts of a page in order.

    Raises:
        AssertionError: If a comment cannot be read, gives no reason, or fits no command of the fence below it.
    """
    found: list[Part] = []
    modes: list[re.Match[str]] = []
    for part in PART.finditer((ROOT / page).read_text(encoding="utf-8")):
        if part["modes"] is not None:
            lines = [line for line in part["modes"].splitlines() if line.strip()]
            modes = [m for line in lines if (m := MODE.fullmatch(line.strip()))]
            assert len(modes) == len(lines), f"{page}: write 'COMMAND: begun; REASON', not {lines}"
        elif part["file"] is not None:
            found.append(Part("file", part["content"], part["file"]))
        elif part["language"] == "python":
            how = next((m["how"] for m in modes if m["command"] == "python"), "")
            found.append(Part("python", part["body"], how=how))
            modes = []
        elif part["language"] == "sh":
            commands = _commands(part["body"])
            idle = [m["command"] for m in modes if not any(c.startswith(m["command"]) for c in commands)]
            assert not idle, f"{page}: no command below the comment begins with {idle}"
            found += [_moded(c, modes) for c in commands]
            modes = []
    return found


def _commands(body: str) -> list[str]:
    """Return the commands of a fence without comments, continued lines joined."""
    lines = re.sub(r" *\\\n *", " ", body).splitlines()
    return [c for c in (re.sub(r"(^|\s+)#.*", "", line).strip() for line in lines) if c]


def _moded(command: str, modes: list[re.Match[str]]) -> Part:
    mode = next((m for m in modes if command.startswith(m["command"])), None)
    if mode is None:
        return Part("sh", command)
    return Part("sh", command, how=mode["how"].split()[0], more=mode["more"] or "")


MAP = """
time = { channel = "t", unit = "s" }
steering_wheel_angle = { channel = "steer", unit = "deg" }
speed = { channel = "v", unit = "km/h" }
yaw_rate = { channel = "gyro", unit = "deg/s" }
lateral_acceleration = { channel = "a_y", unit = "m/s^2" }
"""
TRUCK_COLUMNS = {  # of docs/trace.md: column and what a unit of it is in SI
    "time": ("t_ms", 1e-3), "steering_wheel_angle": ("LWS_Angle", -np.pi / 180), "speed": ("EBS_v", 1 / 3.6),
    "yaw_rate_tractor": ("ESC_Yaw", np.pi / 180), "yaw_rate_trailer": ("TEBS_Yaw", np.pi / 180),
    "articulation_angle": ("Art", np.pi / 180), "lateral_force_axle_21": ("Fy21_kN", 1e3),
    "lateral_acceleration_tractor": ("ESC_ay_g", 9.80665),
}  # fmt: skip
CAR_COLUMNS = {
    "time": ("t", 1.0), "steering_wheel_angle": ("steer", np.pi / 180), "speed": ("v", 1 / 3.6),
    "yaw_rate": ("gyro", np.pi / 180), "lateral_acceleration": ("a_y", 1.0),
}  # fmt: skip


def recorded(model: h.Model, seed: int, **options: object) -> pd.DataFrame:
    """Return what a logger would have recorded of a drive of random steering, by signal."""
    drive = h.drive("random_sequence", duration="25 s", lateral_acceleration_limit=9.0, seed=seed, **options)
    run = h.simulate(model, drive, seed=seed)
    measured = {n: run[n].to_numpy() for n in model.outputs}
    inputs = {n: run[n].to_numpy() for n in model.inputs if n in run and not n.endswith("_rate")}
    return pd.DataFrame({"time": run["time"].to_numpy(), **inputs, **measured})


def renamed(log: pd.DataFrame, columns: dict[str, tuple[str, float]]) -> pd.DataFrame:
    """Return a log as another logger writes it."""
    return pd.DataFrame({name: log[signal] / unit for signal, (name, unit) in columns.items() if signal in log})


def write_recordings(folder: Path) -> None:
    """Write every recording, map and parameter file that a page speaks of as its reader's."""
    import asammdf
    from scipy.io import savemat

    car = h.model("car", "govindarajan_2018", tyre="linear", sensors="car_series")
    reference = h.model("car_reference_point", "sun_2015", sensors="car_reference")
    truck = h.model("semitrailer", sensors="test_vehicle_inertial", values={"trailer_mass": "24 t"})
    laps = [recorded(car, seed, speed="15 m/s", amplitude="10 deg") for seed in (1, 2, 3)]
    for name, lap in zip(("lap", "a", "b"), laps, strict=True):
        lap.to_csv(folder / f"{name}.csv", index=False)
    own = renamed(laps[0], CAR_COLUMNS)
    savemat(folder / "lap.mat", {n: own[n].to_numpy() for n in own})
    for name, lap in zip(("lap", "other", "drive"), laps, strict=True):
        table = renamed(lap, CAR_COLUMNS)
        with asammdf.MDF(version="4.10") as file:
            clock = table["t"].to_numpy()
            file.append([asammdf.Signal(table[n].to_numpy(), clock, name=n) for n in table])
            file.save(folder / f"{name}.mf4", overwrite=True)
    (folder / "map.toml").write_text(MAP, encoding="utf-8")
    for name in ("mine.toml", "tuned.toml", "fit/parameters.toml"):
        car.write(folder / name)
    for number, (day, letter) in enumerate((("monday", "A"), ("tuesday", "B"), ("wednesday", "C"))):
        log = recorded(truck, 10 + number, speed="20 m/s", amplitude="25 deg")
        log.to_csv(folder / f"{letter}.csv", index=False)
        renamed(log, TRUCK_COLUMNS).to_csv(folder / f"{day}.csv", index=False, sep=";")
    loop = (ROOT / "studies" / "loops" / "genesis.toml").read_text(encoding="utf-8")
    (folder / "my.toml").write_text(re.sub("^recordings = .*", 'recordings = "nowhere"', loop, flags=re.M), "utf-8")
    recorded(reference, 4, speed="15 m/s", amplitude="15 deg").to_csv(folder / "reference.csv", index=False)
