"""Studies side by side: what they share, where their boxes stand, which runs pair, and what is said of both."""

import html
from dataclasses import replace

import numpy as np
import pytest
from bokeh.document import Document

from harness.common.errors import UserError
from harness.reporting import style
from harness.study.report import analyse
from harness.study.report.analysis import Analysis
from harness.view import side_by_side_page
from harness.view.pages import pages
from harness.view.side_by_side import Slot, arranged, side_by_side
from harness.view.side_by_side_page import settings
from support.stored_results import NASTY


@pytest.fixture
def studies(folder, other, unlike):
    folders = [folder, other, unlike]
    return side_by_side(folders, [analyse(f) for f in folders])


@pytest.fixture
def document(folder, other, unlike):
    found = Document()
    side_by_side_page.build([folder, other, unlike])(found)
    found.validate()
    return found


def figures(document):
    return {m.name: m for m in document.models if type(m).__name__ == "figure"}


def labels(figure):
    return [list(axis.major_label_overrides.values()) for axis in figure.xaxis]


def texts(document):
    return [m.text for m in document.models if type(m).__name__ == "Div"]


def widget(document, title):
    return next(m for m in document.models if getattr(m, "title", None) == title)


def named(document, name):
    return next(m for m in document.models if m.name == name)


def order_of(document):
    return next(m for m in document.models if getattr(m, "labels", None) == ["by level", "by study"])


def table(document, heading):
    return next(t for t in texts(document) if "<table" in t and heading in t)


def with_design(analysis, seed=None, **changed):
    """Return the analysis of the same store with another first design."""
    store = analysis.store
    attributes = store.attributes | ({} if seed is None else {"seed": seed})
    first = replace(store.designs[0], **changed)
    return Analysis(replace(store, attributes=attributes, designs=[first, *store.designs[1:]]))


def test_levels_that_studies_share_stand_beside_each_other(document):
    boxes = figures(document)["boxes of runs"]
    inner, groups = labels(boxes)
    assert inner[:5] == ["car", "car-other", "car", "car-other", inner[4]]
    assert NASTY.replace("/", "") in inner[4]
    assert groups == ["1.5 t", "1.9 t", "2.1 t"]
    order_of(document).active = 1
    inner, groups = labels(figures(document)["boxes of runs"])
    assert inner == ["1.5 t", "1.9 t", "1.5 t", "1.9 t", "1.9 t", "2.1 t"]
    assert groups[:2] == ["car", "car-other"]


def test_studies_without_a_common_level_stand_study_by_study(folder, unlike):
    second = analyse(unlike)
    mine = side_by_side([folder, unlike], [analyse(folder), with_design(second, bands=["2 t", "2.1 t"])])
    slots = mine.slots([0, 1], "mass")
    assert slots == [Slot(0, 0), Slot(0, 1), Slot(1, 0), Slot(1, 1)]
    levels = [mine.level(s, "mass") for s in slots]
    assert arranged(slots, levels, by_level=True) == [0, 1, 2, 3]
    same = [*levels[:2], levels[1], levels[0]]
    assert arranged(slots, same, by_level=True) == [0, 3, 1, 2]
    assert arranged(slots, same, by_level=False) == [0, 1, 2, 3]


def test_every_box_is_of_the_runs_of_its_study(document, studies):
    figure = figures(document)["boxes of runs"]
    source = next(r.data_source.data for r in figure.renderers if "middle" in r.data_source.data)
    slots = [Slot(0, 0), Slot(1, 0), Slot(0, 1), Slot(1, 1), Slot(2, 0), Slot(2, 1)]
    assert len(source["middle"]) == 2 * len(slots)
    places = dict(zip(np.round(source["x"], 2), source["middle"], strict=True))
    for i, slot in enumerate(slots):
        for e, side in ((0, -0.21), (1, 0.21)):
            of = studies.design(slot.study, "mass").rmse[0, slot.band, e]
            assert places[round(i + side, 2)] == pytest.approx(np.median(of))


def test_the_difference_is_that_of_the_same_run(document, studies):
    (levels,) = labels(figures(document)["boxes of differences"])  # of one study: no second row of labels
    assert levels == ["1.5 t", "1.9 t"]
    box = widget(document, "Box of differences")
    number = next(i for i, (_, offered) in enumerate(box.options) if offered.startswith(f"1.9 t, {NASTY}"))
    box.value = str(number)
    next(m for m in _beside(document, box) if m.title == "Its run").value = "1"
    first, second = (studies.design(k, "mass") for k in (0, 1))
    change = second.rmse[0, 1, 1] - first.rmse[0, 1, 1]
    drive, sample, repeat = (int(i) for i in np.unravel_index(change.argmax(), change.shape))
    assert f"{NASTY}, mass, 1.9 t, drive {first.drives[drive]}, repeat {repeat}." in texts(document)
    told = table(document, "compute it again")
    for value in (first.rmse[0, 1, 1].flat[change.argmax()], change.max()):
        assert html.escape(style.with_unit(float(value), "m/s")) in told
    assert told.count("<tr>") == 3  # a heading and the two that pair
    assert f'href="2?design=0&amp;run=0.1.{drive}.{sample}.{repeat}&amp;compared=1"' in told


def _beside(document, box):
    """Return the models in the row of a list."""
    return next(m.children for m in document.models if type(m).__name__ == "Row" and box in m.children)


def test_what_is_switched_off_has_no_box_and_no_row(document):
    assert table(document, "median difference").count("<tr>") == 1 + 12
    named(document, "studies").active = [0, 2]
    assert "boxes of differences" not in figures(document)
    told = next(t for t in texts(document) if t.startswith("No study that is switched on has the runs of car."))
    assert told.endswith("are others: seed 12 instead of 11.")
    assert "median difference" not in "".join(texts(document))
    named(document, "estimators").active = [1]
    assert table(document, ">median<").count("<tr>") == 1 + 4
    named(document, "studies").active = []
    assert "No study is switched on." in texts(document)


def test_each_study_has_its_answer_and_its_own_page(folder, other, unlike, document):
    told = table(document, "answer")
    assert '<a href="1">car</a>' in told
    assert '<a href="2">car-other</a>' in told
    assert "<script>" not in told
    assert told.count("With the mass at") == 3
    assert list(pages([folder, other, unlike])) == ["/", "/1", "/2", "/3"]


def test_settings_that_differ_are_told_apart(document):
    told = table(document, "setting")
    assert f"estimator.{html.escape(NASTY)}.alpha" in told
    assert ">0.5<" in told
    assert ">0.05<" in told
    assert "design.all" in told  # the second has no such design, and that is all that is said of it
    assert "design.all.samples" not in told
    assert "plant" not in told
    assert settings({"a": {"b": 1}, "c": [{"name": "d", "e": 2}]}) == {
        "a": None, "a.b": 1, "c": None, "c.d": None, "c.d.name": "d", "c.d.e": 2,
    }  # fmt: skip


def test_the_same_runs_pair_and_differ_by_nothing(folder):
    study = analyse(folder)
    twice = side_by_side([folder, folder], [study, study])
    assert [twice.unpaired(1, name) for name in ("mass", "all")] == ["", ""]
    for score in ("rmse", "nis"):
        assert np.array_equal(twice.scores(0, "mass", score, 0), twice.scores(1, "mass", score, 0))


@pytest.mark.parametrize(
    ("why", "changed"),
    [
        ("seed 12 instead of 11", {"seed": 12}),
        ("no design of the same name ('other' instead of 'mass')", {"name": "other"}),
        ("the design 'mass' has other factors or levels", {"bands": ["1 t", "2 t"]}),
        ("the design 'mass' has other factors or levels", {"factors": []}),
        ("the design 'mass' has other drives", {"drives": ["a", "b"]}),
        ("no estimator of the same name", {"estimators": ["KF", "PF"]}),
    ],
)
def test_runs_that_are_others_do_not_pair(folder, why, changed):
    study = analyse(folder)
    assert side_by_side([folder, folder], [study, with_design(study, **changed)]).unpaired(1, "mass") == why


def test_other_values_of_the_same_levels_do_not_pair(folder):
    study = analyse(folder)
    (factor,) = study.store.designs[0].factors
    second = with_design(study, factors=[replace(factor, values=1.01 * factor.values)])
    assert side_by_side([folder, folder], [study, second]).unpaired(1, "mass") == "the design 'mass' has other points"


def test_what_cannot_stand_side_by_side_is_refused(folder, results):
    with pytest.raises(UserError, match="trace: no study; side by side"):
        pages([folder, results / "trace"])
    with pytest.raises(UserError, match="car: given twice"):
        pages([folder, folder])
    study = analyse(folder)
    (target,) = study.store.designs[0].targets
    second = Analysis(replace(study.store, designs=[
        replace(d, targets=[replace(target, name="yaw_rate", words="yaw rate")]) for d in study.store.designs
    ]))  # fmt: skip
    with pytest.raises(UserError, match="scores yaw rate, and not lateral velocity as"):
        side_by_side([folder, folder], [study, second])
