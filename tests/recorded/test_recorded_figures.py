"""Figures of estimators on a recording: as tall as their panels need, two to a page where they fit there."""

import pytest

from harness.recorded import figures
from harness.reporting import style


@pytest.mark.parametrize("panels", range(1, figures.PER_FIGURE + 1))
def test_no_figure_is_taller_than_a_page_and_none_flatter_than_can_be_read(panels):
    height = figures._height(panels)
    assert height <= style.TALLEST
    assert (height - figures._AROUND) / panels >= 1.0


def test_three_panels_leave_room_for_another_figure():
    assert figures._height(3) <= style.HALF
    assert figures._height(4) > style.HALF
