"""How the report looks: layout, colours, numbers and text."""

from __future__ import annotations

import io

import numpy as np
import pytest
from matplotlib.backends.backend_svg import RendererSVG
from matplotlib.lines import Line2D

from harness.common.statistics import Interval, Summary
from harness.models.quantities import Quantity, print_unit, quantity
from harness.reporting import style
from harness.reporting.document import (
    Bullets,
    Heading,
    Listing,
    Picture,
    Prose,
    Report,
    Sheet,
    plain,
    render,
    source,
)
from harness.study.report.sections import boxes, drives, scatter
from support.report_parts import Page, pages

NINE = ("KF", "EKF", "UKF", "CDKF", "ST-CDKF", "PF", "NARX", "EKF, tuned", "PF, tuned")


@pytest.fixture
def drawn(monkeypatch):
    """Figures in the order in which they are laid out."""
    found, svg = [], style.svg
    monkeypatch.setattr(style, "svg", lambda fig: found.append(fig) or svg(fig))
    return found


def test_nothing_is_cut_off_and_panels_do_not_overlap():
    with style.drawing():
        fig = style.figure(5.0)
        panels = fig.subplots(2, 1, sharex=True)
        for axes in panels:
            axes.set_yticks([0, 1], ["a drive with quite a long name", "b"])
            axes.set_ylabel("label")
            axes.set_title("title", loc="left")
        panels[1].set_xticks([0, 1], ["two\nlines", "x"])
        panels[1].set_xlabel("levels")
        style.head(fig, "Is all of it there?", [Line2D([], [], label="one")])
        svg = style.svg(fig)
        renderer = RendererSVG(*fig.bbox.size, io.StringIO(), image_dpi=72)
        upper, lower = (axes.get_tightbbox(renderer) for axes in panels)
    legend = fig.legends[0].get_window_extent(renderer)
    assert svg.startswith(b"<?xml")
    assert min(upper.x0, lower.x0, lower.y0) >= 0
    assert max(upper.x1, lower.x1) <= fig.bbox.x1
    assert lower.y1 <= upper.y0 < upper.y1 <= legend.y0
    assert panels[0].get_window_extent().width > 0.5 * fig.bbox.width


def test_looks_are_fixed_and_never_alike():
    seven = style.looks(["EKF", "UKF", "CDKF", "ST-CDKF", "PF", "NARX", "KF"])
    assert style.looks(["UKF"])["UKF"] == seven["UKF"]
    assert style.looks(["new", "EKF"])["EKF"] == seven["EKF"]
    variant = style.looks(["EKF", "UKF", "NARX", "EKF, tuned"])["EKF, tuned"]
    assert (variant.colour, variant.marker) == (seven["EKF"].colour, seven["EKF"].marker)
    assert variant.hatch != seven["EKF"].hatch
    assert variant.dashes != seven["EKF"].dashes
    many = style.looks([f"filter {k}" for k in range(20)])
    drawn = {(look.colour, look.hatch) for look in many.values()}
    assert len(drawn) == 20
    assert len({look.marker for look in seven.values()}) == 7


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (0.0, "0"),
        (1234.5, "1230"),
        (12.345, "12.3"),
        (0.0012345, "0.00123"),
        (-0.5, "−0.500"),
        (9.999, "10.0"),
        (float("nan"), "–"),
        (2.5e-7, "2.50·10⁻⁷"),
        (4e9, "4.00·10⁹"),
    ],
)
def test_numbers(value, text):
    assert style.number(value) == text


def test_units():
    assert print_unit("deg/s") == "°/s"
    assert print_unit("m/s^2") == "m/s²"
    assert print_unit("kN*m") == "kN·m"
    assert quantity("lateral_force_axle_21", "N").scale == pytest.approx(1e-3)
    assert quantity("yaw_rate_trailer", "rad/s").scale == pytest.approx(np.degrees(1))
    assert isinstance(quantity("unheard_of", "W"), Quantity)
    assert style.with_unit(2.5, "°") == "2.50°"
    assert style.probability(0.0004) == "< 0.001"


def test_any_text_survives_typst():
    """No character of a name or a study text is taken for markup."""
    nasty = 'a_b *c* #d $e$ `f` <g> @h [i] "j" \\k ~l // m /* n */ - + = 1. é'
    picture = Picture(b'<svg xmlns="http://www.w3.org/2000/svg" width="9" height="9"/>', nasty, nasty)
    sheet = Sheet(["name", "n"], [[nasty, "1"], ["", nasty]], nasty)
    blocks = [Heading(nasty), Prose(plain(nasty)), Bullets([plain(nasty)]), picture, sheet, Listing(nasty)]
    html, pdf = render(Report(nasty, blocks))
    assert Page(html.decode()).text.count(nasty) == 10  # title twice, each block once, the table 3 times
    assert pages(pdf) == 1
    assert set(source(Report(nasty, blocks))[1]) == {"figure-01.svg"}


def test_symbols_on_axes_are_set_as_formulas(one_design, monkeypatch):
    drawn = []
    monkeypatch.setattr(style, "svg", lambda fig, *_, **__: drawn.append(fig) or b"<?xml?>")
    analysis = one_design()
    boxes.pictures(analysis, analysis.main)
    labels = [axes.yaxis.label for fig in drawn for axes in fig.axes if "$" in axes.get_ylabel()]
    assert labels
    assert all(label.get_parse_math() for label in labels)


def test_the_map_of_drives_keeps_its_width_below_labels_of_several_factors(one_design, drawn):
    analysis = one_design()
    label = ", ".join(f"{name} 24 t ±5 %" for name in ("trailer mass", "stiffness load 2", "inertia scale", "ratio"))
    analysis.main.design.bands = [f"{label} {k}" for k in range(len(analysis.main.design.bands))]
    drives.blocks(analysis)
    for fig in drawn:
        for axes in fig.axes:
            assert axes.get_position().width > 0.6
            assert axes.get_title(loc="left").count("\n") == 1


def test_figures_over_the_actual_value_share_a_page(one_design, drawn):
    scatter.blocks(one_design(levels=(8.0, 24.0), band=0.05, samples=8, repeats=1))
    assert [fig.get_figheight() for fig in drawn] == [style.HALF]


@pytest.mark.parametrize(("times", "scale"), [(3.0, "linear"), (30.0, "log")])
def test_an_axis_is_logarithmic_where_medians_differ_by_more_than_ten(one_design, drawn, times, scale):
    analysis = one_design(levels=(24.0,), repeats=20)
    analysis.main.design.errors[0, :, 1] = times * analysis.main.design.errors[0, :, 0]
    boxes.pictures(analysis, analysis.main)
    assert [axes.get_yscale() for axes in drawn[0].axes] == [scale, "linear"]
    low, high = drawn[0].axes[0].get_ylim()
    errors = analysis.main.design.errors[0]
    assert low < errors.min()
    assert high > errors.max()


def test_nine_estimators_at_seven_levels_have_boxes_whose_hatches_can_be_told_apart(one_design, drawn):
    analysis = one_design(estimators=NINE, repeats=10)
    boxes.pictures(analysis, analysis.main, opening=True)
    shown = []
    for fig in drawn:
        for axes in fig.axes:
            target = [q.words for q in analysis.main.design.targets].index(axes.get_title(loc="left"))
            low, high = axes.get_xlim()
            shown += [(target, band) for band in range(7) if low < band < high]
            narrowest = min(box.get_window_extent().width for box in axes.patches[-9:])
            assert narrowest > 6.5  # points
    assert shown == [(target, band) for target in range(2) for band in range(7)]
    assert all(fig.get_figheight() <= style.TALLEST for fig in drawn)
    assert drawn[0].get_figheight() <= boxes._OPENING + 0.6


def test_few_runs_are_drawn_themselves(one_design, drawn):
    analysis = one_design(levels=(24.0,), repeats=4, drives=("roundabout",))
    (picture,) = boxes.pictures(analysis, analysis.main)
    values = analysis.main.design.errors[0, 0]
    for e in range(2):
        runs, median = drawn[0].axes[0].lines[2 * e : 2 * e + 2]
        np.testing.assert_allclose(np.sort(runs.get_ydata()), np.sort(values[e].ravel()))
        np.testing.assert_allclose(median.get_ydata(), np.median(values[e]))
    assert "Box" not in picture.caption
    assert len({handle.get_markerfacecolor() for handle in drawn[0].legends[0].get_lines()}) == 2
    enough = one_design(levels=(24.0,), repeats=20, drives=("roundabout",))
    assert "Points" not in boxes.pictures(enough, enough.main)[0].caption


def test_a_box_of_runs_that_diverged_is_open_above_and_a_median_that_did_is_named(one_design, drawn):
    analysis = one_design(levels=(24.0,), repeats=20)
    finite = analysis.main.summaries[0][0][0]
    middle = finite.median.value
    open_above = Summary(40, Interval(middle, finite.minimum, np.inf), middle / 2, np.inf, finite.minimum, np.inf)
    nothing = Summary(40, Interval(np.inf, middle, np.inf), middle, np.inf, finite.minimum, np.inf)
    analysis.main.summaries[0][0] = [open_above, nothing]
    boxes.pictures(analysis, analysis.main)
    axes = drawn[0].axes[0]
    assert [text.get_text() for text in axes.texts] == ["diverged"]
    box = axes.patches[-1]
    assert box.get_y() == pytest.approx(middle / 2)
    assert axes.get_ylim()[1] < box.get_y() + box.get_height() < np.inf
    assert axes.get_ylim()[1] == pytest.approx(1.05 * analysis.main.design.errors[0].max())
