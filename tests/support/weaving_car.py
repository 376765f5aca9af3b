"""A car that weaves along an exact path, every derivative in closed form, and recordings of it."""

import numpy as np
import pandas as pd

STEP = 0.01
CLOCK = '{ channel = "time", unit = "s" }'
TIME = np.arange(0, 40, STEP)


def drive(time, x=0.0, y=0.0):
    """Motion of a point (x, y) of a car whose CoG weaves at a changing speed; every derivative in closed form."""
    psi = 0.6 * np.sin(0.9 * time) + 3.0 + 0.2 * time
    r = 0.54 * np.cos(0.9 * time) + 0.2
    r_dot = -0.486 * np.sin(0.9 * time)
    v_x, v_x_dot = 12 + 3 * np.sin(0.4 * time), 1.2 * np.cos(0.4 * time)
    v_y, v_y_dot = 0.4 * np.sin(1.3 * time), 0.52 * np.cos(1.3 * time)
    fine = np.arange(0, time[-1] + 1e-3, 1e-3)
    p = 0.6 * np.sin(0.9 * fine) + 3.0 + 0.2 * fine
    east = (12 + 3 * np.sin(0.4 * fine)) * np.cos(p) - 0.4 * np.sin(1.3 * fine) * np.sin(p)
    north = (12 + 3 * np.sin(0.4 * fine)) * np.sin(p) + 0.4 * np.sin(1.3 * fine) * np.cos(p)
    position = [
        np.interp(time, fine, np.concatenate([[0], np.cumsum((v[1:] + v[:-1]) / 2) * 1e-3])) for v in (east, north)
    ]
    return {
        "time": time,
        "position_x": position[0] + x * np.cos(psi) - y * np.sin(psi),
        "position_y": position[1] + x * np.sin(psi) + y * np.cos(psi),
        "heading": psi,
        "yaw_rate": r,
        "yaw_acceleration": r_dot,
        "longitudinal_velocity": v_x - r * y,
        "lateral_velocity": v_y + r * x,
        "longitudinal_acceleration": v_x_dot - v_y * r - r**2 * x - r_dot * y,
        "lateral_acceleration": v_y_dot + v_x * r - r**2 * y + r_dot * x,
        "road_wheel_angle": 0.2 * r,
    }


def stored(folder, columns, **lines):
    """Write a CSV file and a channel map; the map's lines by signal, everything else in SI under its own name."""
    path, text = folder / "drive.csv", lines.pop("tail", "")
    pd.DataFrame(columns).to_csv(path, index=False)
    (folder / "map.toml").write_text("\n".join(f"{k} = {v}" for k, v in lines.items()) + "\n" + text)
    return path, folder / "map.toml"
