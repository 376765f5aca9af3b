"""Figure (in the form of Bild 5.2, Ziaukas 2023) and table of ``harness observability``.

Next to the command and not in it, because Matplotlib takes longer to import than ``harness --help`` may take.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from rich.console import Console
from rich.table import Table

from harness.common import places
from harness.common.errors import ModelError, UserError
from harness.config import ModelSpec
from harness.config.bounds import loading_parameters, quantity
from harness.estimation.information import TOLD_APART, parameter_information
from harness.estimation.observability import delays, structural_observability, synthetic_manoeuvre
from harness.models.contracts import Profile
from harness.reporting.style import drawing

BLUE, ORANGE, GREEN, VERMILLION, GREY = "#0072B2", "#E69F00", "#009E73", "#D55E00", "#999999"  # Okabe-Ito


def plot(dataset: xr.Dataset) -> Figure:
    """Draw steering, both criteria and the connected states over time, in the form of Bild 5.2.

    Args:
        dataset: Result of ``structural_observability``.
    """
    time, states = dataset["time"].to_numpy(), dataset["state"].to_numpy()
    with drawing({"font.size": 9, "lines.linewidth": 1.0, "axes.linewidth": 0.6, "svg.fonttype": "path"}):
        figure = Figure(figsize=(6.3, 6.0), layout="constrained")
        axes = figure.subplots(3, 1, sharex=True, height_ratios=[2, 2, 0.25 * len(states)])
        _draw_drive(axes[0], dataset)
        required = dataset["rank"].attrs["required"]
        axes[1].axhline(required, color=GREY, linestyle=":", label="needed")
        for name, label, colour, style in (
            ("connected", "1: states connected", BLUE, "-"),
            ("rank", "2: structural rank", VERMILLION, "--"),
        ):
            axes[1].step(time, dataset[name], where="post", color=colour, linestyle=style, label=label)
        low = int(min(dataset["connected"].min(), dataset["rank"].min()))
        axes[1].set(ylabel="number", ylim=(low - 0.6, required + 1.4), yticks=range(low, required + 1))
        axes[1].legend(loc="upper center", ncols=3, frameon=False, handlelength=1.6, columnspacing=1.2)
        _draw_states(axes[2], dataset)
        share = float(dataset["observable"].mean())
        figure.suptitle(
            f"When is {dataset.attrs['model']} structurally observable from {dataset.attrs['outputs']}?\n"
            f"{share:.0%} of {time.size} samples meet both criteria",
            fontsize=10,
        )
    return figure


def report(spec: ModelSpec, unknown_inputs: Sequence[str], out: Path, profile: Profile | None = None) -> xr.Dataset:
    """Check a model on the manoeuvre of Bild 5.2, write ``observability.svg`` and print a short table.

    Args:
        spec: The model with its values; parameters that are not known are among its states.
        unknown_inputs: Inputs that the estimator does not know in addition to those of the model.
        out: Folder of the figure; made if absent.
        profile: Another drive than ``synthetic_manoeuvre()``.

    Raises:
        UserError: If an unknown input is none of the model's.
    """
    try:
        model = spec.model().augment(unknown_inputs)
    except ModelError as error:
        raise UserError(str(error)) from error
    drive = synthetic_manoeuvre() if profile is None else profile
    dataset = structural_observability(model, spec.values, drive)
    try:
        out.mkdir(parents=True, exist_ok=True)
        with places.unfinished(out / "observability.svg") as stream, drawing():  # of fixed ids
            plot(dataset).savefig(stream, format="svg", metadata={"Date": None})
    except OSError as error:
        raise UserError(f"cannot write the figure to {out}: {error.strerror}; choose another folder") from error
    _print(dataset, out / "observability.svg")
    if spec.parameter_states:
        _print_information(spec, parameter_information(spec, drive))
    return dataset


def _print_information(spec: ModelSpec, information: xr.Dataset) -> None:
    """Say how well each parameter can be known after the drive, and which of them it does not tell apart."""
    units = {p.name: p.unit for p in spec.model().parameters}
    units |= {p.name: p.unit for p in loading_parameters(spec.vehicle).values()}
    table = Table(title="What the drive can tell of the parameters at best")
    for heading in ("parameter", "believed", "known to ±", "after the drive ±"):
        table.add_column(heading, justify="left" if heading == "parameter" else "right")
    for s in spec.parameter_states:
        remaining, unit = float(f"{float(information['std'].sel(parameter=s.name)[-1]):.3g}"), units[s.name]
        table.add_row(s.name, quantity(s.believed, unit), quantity(s.prior, unit), quantity(remaining, unit))
    console = Console()
    console.print(table)
    names = [s.name for s in spec.parameter_states]
    alike = [
        f"{first} and {second} ({float(information['correlation'].sel(parameter=first, second=second)):+.2f})"
        for i, first in enumerate(names)
        for second in names[i + 1 :]
        if abs(float(information["correlation"].sel(parameter=first, other=second))) > TOLD_APART
    ]
    console.print(f"Not told apart by this drive: {', '.join(alike) if alike else 'none'}")


def _print(dataset: xr.Dataset, figure: Path) -> None:
    steering = dataset["steering_wheel_angle"].to_numpy()
    moving = np.flatnonzero(steering != steering[-1])
    excited = slice(int(moving[0]), int(moving[-1]) + 1) if moving.size else slice(0, 0)
    late = delays(dataset)
    table = Table(title=f"Structural observability of {dataset.attrs['model']}")
    for heading in ("criterion", "needs", "at start", "steering", "at end", "holds after steering"):
        table.add_column(heading, justify="left" if heading == "criterion" else "right")
    for name in ("connected", "rank"):
        n = dataset[name].to_numpy()
        during = n[excited]
        span = "-" if not during.size else f"{during.min()} .. {during.max()}"
        after = "to the end" if np.isnan(late[name]) else f"{late[name]:.2f} s"
        row = [dataset[name].attrs["long_name"], str(dataset[name].attrs["required"]), str(n[0]), span]
        table.add_row(*row, str(n[-1]), after)
    console = Console()
    console.print(table)
    lost = dataset["state"].to_numpy()[~dataset["output_connected"].to_numpy().all(axis=0)]
    console.print(f"Not always output-connected: {', '.join(lost) if lost.size else 'none'}")
    console.print(f"Measured: {dataset.attrs['outputs']}. Figure: {figure}")


def _draw_drive(axis: Axes, dataset: xr.Dataset) -> None:
    time = dataset["time"].to_numpy()
    axis.plot(time, np.rad2deg(dataset["steering_wheel_angle"]), color=ORANGE)
    axis.set_ylabel("steering-wheel\nangle in deg")
    if "articulation_angle" in dataset:
        angle = axis.twinx()
        angle.plot(time, np.rad2deg(dataset["articulation_angle"]), color=GREEN, linestyle="--")
        angle.set_ylabel("articulation\nangle in deg (dashed)")


def _draw_states(axis: Axes, dataset: xr.Dataset) -> None:
    time = dataset["time"].to_numpy()
    for row, reached in enumerate(dataset["output_connected"].to_numpy().T):
        starts = np.flatnonzero(np.diff(reached, prepend=~reached[0]))
        ends = [*time[starts[1:]], time[-1]]
        for start, end in zip(starts, ends, strict=True):
            bar = axis.barh(row, end - time[start], height=0.7, left=time[start], color=BLUE, linewidth=0)
            if not reached[start]:
                bar[0].set(facecolor="none", edgecolor=VERMILLION, hatch="/////")
    names = [str(s).replace("_", " ") for s in dataset["state"].to_numpy()]
    axis.set(xlabel="time in s", yticks=range(len(names)), yticklabels=names, ylim=(len(names) - 0.5, -0.5))
    axis.set_title("output-connected (filled) or not (hatched)", fontsize=9)
    axis.set_xlim(time[0], time[-1])
