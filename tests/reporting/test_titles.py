"""Titles of panels: none is cut off, and none takes the width of the panels."""

import io
import re

import pytest
from matplotlib.backends.backend_svg import RendererSVG

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
