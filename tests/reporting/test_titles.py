"""Titles of panels and names in legends: none is cut off, and none takes the width of the panels."""

import io
import itertools
import re
from types import SimpleNamespace

import matplotlib as mpl
import numpy as np
import pytest
from matplotlib.backends.backend_svg import RendererSVG
from matplotlib.lines import Line2D

from harness.identification import figures
from harness.reporting import style

LONG = (
    "lateral acceleration and dv_y/dt + v_x r: slope 1.254 in place of 1, 10 ± 2.3 ms late, offset of −0.268 ± 0.016 "
    "m/s²"
)


@pytest.mark.parametrize("count", [1, 3])
def test_a_long_title_is_broken_and_the_panel_stays_as_wide_as_beside_a_short_one(count):
    with style.drawing():
        widths = []
        for text in ("short", LONG):
            fig = style.figure(2.0 * count)
            panels = fig.subplots(count, 1, squeeze=False)[:, 0]
            for axes in panels:
                axes.set_title(text, loc="left")
            style.head(fig, "Which?")
            style.svg(fig)
            widths.append([axes.get_position().width for axes in panels])
            renderer = RendererSVG(*(fig.get_size_inches() * fig.dpi), io.StringIO(), image_dpi=72)
            assert all(axes.get_tightbbox(renderer).x1 <= fig.get_window_extent().x1 for axes in panels)
            assert re.sub(r"\s+", " ", panels[0].get_title(loc="left")) == text
    assert widths[1] == pytest.approx(widths[0], abs=0.03)  # the ticks are others


def test_a_long_name_in_a_legend_is_broken_and_the_panels_begin_below_it():
    names = ["short", "changed by " + ", ".join(f"sensor delay of yaw rate {k}" for k in range(9))]
    with style.drawing():
        fig = style.figure(4.0)
        axes = fig.subplots()
        style.head(fig, "Which?", [Line2D([], [], label=name) for name in names])
        style.svg(fig)
        renderer = RendererSVG(*(fig.get_size_inches() * fig.dpi), io.StringIO(), image_dpi=72)
        (legend,) = fig.legends
        shown = [text.get_text() for text in legend.get_texts()]
        box = legend.get_window_extent(renderer)
    assert [name.replace("\n", " ") for name in shown] == names
    assert shown[1].count("\n") >= 2
    assert box.x1 <= fig.get_window_extent().x1
    assert axes.get_window_extent(renderer).y1 < box.y0


def test_of_many_outputs_in_a_low_figure_every_panel_is_whole(monkeypatch):
    drawn, was = [], style.svg
    monkeypatch.setattr(style, "svg", lambda fig: drawn.append(fig) or was(fig))
    outputs = ["yaw_rate_tractor", "yaw_rate_trailer", "articulation_angle", "lateral_force_axle_21",
               "lateral_acceleration_tractor"]  # fmt: skip
    time = np.arange(0, 60, 0.02)
    measured = np.sin(0.3 * time)[:, None] * [0.2, 0.1, 0.1, 8e3, 2.0]
    drive = SimpleNamespace(name="d3", time=time, measurements=measured)
    figures.over_time(SimpleNamespace(drive=drive, free=np.stack([0.9 * measured, measured])), outputs, 4.0)
    (fig,) = drawn
    renderer = RendererSVG(*(fig.get_size_inches() * fig.dpi), io.StringIO(), image_dpi=72)
    boxes = [axes.get_tightbbox(renderer) for axes in fig.axes]
    assert all(box.x0 >= 0 and box.y0 >= 0 and box.x1 <= fig.get_window_extent().x1 for box in boxes)
    for column in (boxes[::2], boxes[1::2]):
        assert all(above.y0 > below.y1 - 1 for above, below in itertools.pairwise(column))  # none covers the next one
    assert all(signal.x1 < error.x0 + 1 for signal, error in zip(boxes[::2], boxes[1::2], strict=True))
    assert min(axes.get_window_extent(renderer).height for axes in fig.axes) > 14


def test_the_error_is_shown_without_the_noise_of_the_sensor(monkeypatch):
    """A model that is 0.02 off in the second half of a drive, under noise of 0.1, with a gap."""
    drawn, was = [], style.svg
    monkeypatch.setattr(style, "svg", lambda fig: drawn.append(fig) or was(fig))
    time = np.arange(0, 120, 0.005)
    measured = 0.1 * np.random.default_rng(1).standard_normal(len(time)) + 0.02 * (time > 60)
    measured[2000:2400] = np.nan
    drive = SimpleNamespace(name="d", time=time, measurements=measured[:, None])
    before = np.zeros((len(time), 1))
    after = 0.02 * (time > 60)[:, None]
    figures.over_time(SimpleNamespace(drive=drive, free=np.stack([before, after])), ["lateral_acceleration"])
    lines = [line.get_ydata() for line in drawn[0].axes[1].get_lines()]
    assert np.nanmean(lines[0][122:]) == pytest.approx(0.02, abs=0.004)
    assert np.nanmean(lines[1][122:]) == pytest.approx(0.0, abs=0.004)
    assert np.nanstd(lines[1]) == pytest.approx(0.1 / 10, rel=0.2)  # of means over 100 samples
    assert np.isnan(lines[0]).sum() == 4


def test_figures_do_not_depend_on_a_matplotlibrc():
    """It may be somebody's, in the working directory, and have LaTeX started."""
    with mpl.rc_context({"text.usetex": True, "axes.facecolor": "red"}), style.drawing():
        assert not mpl.rcParams["text.usetex"]
        assert mpl.rcParams["axes.facecolor"] == mpl.rcParamsDefault["axes.facecolor"]
