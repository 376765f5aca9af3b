"""On paper a figure stays with its heading, and no page stays half empty for it."""

import itertools
import json
from dataclasses import replace
from pathlib import Path

import pytest
import typst

import harness.reporting
from harness.reporting.document import Bullets, Heading, Picture, Prose, Report, Sheet, plain, render, source
from harness.reporting.pages import EMPTY, EMPTY_BEFORE_TEXT, SMALLEST, Placed, Room, decided, lay_out

WIDTH = 496.0  # points between the margins


def picture(share):
    """Return a figure that takes a share of a page of 737 points, with its caption a little more."""
    height = share * 737
    drawn = f'<rect width="{WIDTH}" height="{height}" fill="#dddddd"/>'
    svg = f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {WIDTH} {height}">{drawn}</svg>'
    return Picture(svg.encode(), "What it shows.", "a rectangle")


def text(lines):
    return Prose(plain("Word after word of a line. " * 4 * lines))


def table(rows):
    return Sheet(["name", "value"], [[f"row {k}", "1"] for k in range(rows)], "Numbers.")


def asked(folder, blocks, *questions):
    """Return the compiler of a document, laid out, and what it answers to queries of its own."""
    written, files = source(Report("Title", blocks))
    template = Path(harness.reporting.__file__).parent / "template.typ"
    (folder / "template.typ").write_text(template.read_text(encoding="utf-8"), encoding="utf-8")
    where = "\n".join(f"#context [#metadata({q})<q{k}>]" for k, q in enumerate(questions))
    (folder / "report.typ").write_text(f"{written}\n{where}\n", encoding="utf-8")
    for name, svg in files.items():
        (folder / name).write_bytes(svg)
    compiler = typst.Compiler(folder / "report.typ", root=folder, sys_inputs={"medium": "paper"})
    lay_out(compiler, folder)
    return compiler, [json.loads(compiler.query(f"<q{k}>", field="value"))[0] for k in range(len(questions))]


def laid_out(folder, *blocks):
    """Return how figures stand on paper, what each was given, and the pages of the headings by their text."""
    compiler, (headings,) = asked(folder, blocks, "query(heading).map(h => (h.body.text, h.location().page()))")
    placed = [Placed(**p) for p in json.loads(compiler.query("<placed>", field="value"))]
    rooms = {int(n): Room(**r) for n, r in json.loads((folder / "rooms.json").read_text()).items()}
    return placed, rooms, dict(headings)


def test_a_long_table_stands_as_far_below_a_text_as_a_short_one(tmp_path):
    where = "query(figure).first().location().position().y / 1pt"
    (short,), (long,) = (asked(tmp_path, [text(10), table(rows)], where)[1] for rows in (4, 30))
    assert long == pytest.approx(short, abs=0.5)


@pytest.mark.parametrize("lines", range(40, 56, 2))
def test_a_long_table_begins_with_some_rows_and_its_heading(tmp_path, lines):
    """The last row that begins on a page ends 51 points above its edge."""
    (table_at, y, heading_at) = asked(
        tmp_path,
        [text(lines), Heading("A"), table(30)],
        "query(figure).first().location().page()",
        "query(figure).first().location().position().y / 1pt",
        "query(heading).first().location().page()",
    )[1]
    assert table_at == heading_at
    assert y < 842 - 51 - 80


def test_two_headings_do_not_wait_for_their_figures(tmp_path):
    sections = [(Heading(f"Section {k}"), text(2), picture(0.45)) for k in (1, 2)]
    placed, rooms, pages = laid_out(tmp_path, table(28), *itertools.chain(*sections))
    assert [p.stands for p in placed] == [pages["Section 1"], pages["Section 2"]]
    assert not any(r.floats for r in rooms.values())


def test_a_figure_that_lacks_little_is_drawn_smaller(tmp_path):
    (placed,), rooms, pages = laid_out(tmp_path, table(26), Heading("It"), text(2), picture(0.5))
    (given,) = rooms.values()
    assert SMALLEST <= given.share < 1
    assert placed.stands == pages["It"] == 1


def test_one_that_lacks_more_goes_to_the_next_page_with_its_heading(tmp_path):
    (placed,), rooms, pages = laid_out(tmp_path, table(40), Heading("It"), text(2), picture(0.6))
    assert rooms == {}
    assert placed.stands == pages["It"] == 2


def test_where_half_of_a_page_would_stay_empty_the_text_goes_on(tmp_path):
    (placed,), rooms, pages = laid_out(tmp_path, table(12), Heading("It"), text(2), picture(0.85), table(20))
    assert rooms == {1: Room(floats=True)}
    assert (pages["It"], placed.stands) == (1, 2)


def test_what_is_higher_than_a_page_is_drawn_smaller(tmp_path):
    (placed,), rooms, pages = laid_out(tmp_path, table(40), Heading("It"), text(2), picture(0.95))
    assert rooms[1].share == pytest.approx(1 - (placed.whole - placed.page + 3) / placed.figure)
    assert placed.stands == pages["It"] == 2


def test_a_long_text_flows_and_its_figure_follows(tmp_path):
    (placed,), _, pages = laid_out(tmp_path, Heading("It"), text(30), picture(0.75))
    assert placed.whole == pytest.approx(placed.alone, abs=20)
    assert (pages["It"], placed.stands) == (1, 2)


@pytest.mark.parametrize("rows", range(4, 44, 4))
@pytest.mark.parametrize("share", [0.3, 0.42, 0.55])
def test_wherever_a_section_begins_its_figure_is_on_its_page(tmp_path, rows, share):
    blocks = [table(rows), Heading("A"), text(2), picture(share), Heading("B"), text(3), picture(share)]
    placed, rooms, pages = laid_out(tmp_path, *blocks)
    for one, name in zip(placed, "AB", strict=True):
        given = rooms.get(one.number, Room())
        assert given.share >= SMALLEST
        if given.floats:  # half of a page would stay empty
            assert one.room > EMPTY * one.page
        else:
            assert one.stands == pages[name]
            assert one.stands == one.begins or one.room <= EMPTY * one.page


def placed_with(**changed):
    common = {"number": 1, "begins": 1, "stands": 2, "room": 300.0, "page": 737.0, "whole": 500.0, "alone": 450.0,
              "figure": 400.0, "floats": False, "filled": False}  # fmt: skip
    return Placed(**(common | changed))


def test_room_beside_a_figure_that_floats_counts():
    above = placed_with(number=1, stands=2, alone=250.0, floats=True)
    skipping = placed_with(number=2, begins=1, stands=3, room=20.0)
    (given,) = decided(skipping, [above]).values()
    assert given.share == pytest.approx(1 - (500 - (737 - 250) + 3) / 400)
    assert not given.floats


def test_what_could_fill_a_page_decides_how_much_may_stay_empty():
    room = 737 * (EMPTY + EMPTY_BEFORE_TEXT) / 2
    assert decided(placed_with(room=room, whole=600.0)) == {1: Room()}
    assert decided(placed_with(room=room, whole=600.0, filled=True)) == {1: Room(floats=True)}


def test_no_figure_waits_for_another_one_that_floats():
    first = placed_with(number=1, room=400.0, floats=True)
    second = placed_with(number=2, room=350.0, whole=700.0, filled=True)
    assert decided(second, [first]) == {2: Room()}
    assert decided(second, [replace(first, room=200.0)]) == {
        1: Room()
    }  # less stays empty if the first one does not float
    assert decided(second, [replace(first, stands=1)]) == {2: Room(floats=True)}


def test_a_report_with_bullets_before_its_figure_is_whole_in_both_forms():
    html, pdf = render(Report("Title", [Heading("It"), Bullets(["*one*", "two"]), picture(0.3), text(1)]))
    assert html.count(b"<figure") == 1
    assert b"<strong>one</strong>" in html
    assert html.index(b"<strong>one</strong>") < html.index(b"<figure")
    assert pdf.startswith(b"%PDF")
