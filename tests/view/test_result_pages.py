"""The pages of results, folders and studies side by side in a browser: each opens, and its first use works."""

import importlib

import pytest

import harness as h

pytestmark = pytest.mark.browser
SAME = "The scores are those of the store, to the last bit."
PIXEL = """([name, x, y]) => {
    const view = Bokeh.index.find_one(Bokeh.documents[0].get_model_by_name(name));
    const box = view.canvas_view.el.getBoundingClientRect();
    return [box.x + view.frame.x_scale.compute(x), box.y + view.frame.y_scale.compute(y)];
}"""
DRAWN = """(title) => [...Bokeh.documents[0].all_models ?? Bokeh.documents[0]._all_models.values()]
    .some((m) => m.title?.text?.replaceAll('\\n', ' ') === title)"""


def expect(locator):
    return importlib.import_module("playwright.sync_api").expect(locator)


def cells(page, column):
    """Return the texts of a column of the table that is seen first."""
    return page.locator("table").first.locator(f"tbody tr:visible td:nth-child({column})").all_inner_texts()


@pytest.fixture(params=["campaign", "check", "identify", "study", "trace"])
def kind(request):
    return request.param


def test_a_folder_leads_to_every_result(visit, address_of_results, kind):
    page = visit(address_of_results)
    assert cells(page, 3)[:5] == ["campaign", "check", "identify", "study", "trace"]
    page.locator("table").first.locator("tr", has=page.get_by_text(kind, exact=True)).get_by_role("link").first.click()
    page.wait_for_function("document.title && !document.title.startsWith('Results in')")
    page.wait_for_function("window.Bokeh && Bokeh.documents.length && Bokeh.documents[0].is_idle")
    title = {
        "campaign": "Which estimator?",
        "check": "Check of",
        "identify": "Which parameters fit?",
        "study": "How heavy",
        "trace": "What does the",
    }
    assert page.title().startswith(title[kind])


@pytest.mark.parametrize("number", ["", 1, 2, 3, 5])
@pytest.mark.parametrize("width", [390, 1920])
def test_every_page_fits_the_screen(visit, address_of_results, number, width):
    page = visit(address_of_results, str(number))
    page.set_viewport_size({"width": width, "height": 900})
    page.wait_for_timeout(300)
    assert page.evaluate("document.documentElement.scrollWidth") <= width
    for row in page.locator("tbody tr").all():
        assert row.bounding_box()["height"] < 300  # beside a column of words that is out of sight


ROLLED = """(sheet) => {
    sheet.scrollIntoView({block: 'center'});
    const cut = sheet.scrollWidth > sheet.clientWidth;
    sheet.scrollLeft = sheet.scrollWidth;
    const last = [...sheet.querySelectorAll('th')].at(-1).getBoundingClientRect();
    const shadow = getComputedStyle(sheet).backgroundImage.split('linear-gradient').length - 1;
    return [cut, shadow, sheet.getBoundingClientRect().right <= innerWidth, last.right <= innerWidth];
}"""


@pytest.mark.parametrize("number", ["3", "5"])
def test_on_a_phone_every_column_is_reached_and_its_frame_says_that_there_are_more(visit, address_of_results, number):
    page = visit(address_of_results, number)
    page.set_viewport_size({"width": 390, "height": 780})
    page.wait_for_timeout(300)
    seen = [sheet.evaluate(ROLLED) for sheet in page.locator(".sheet:not(.prose)").all()]
    assert any(cut for cut, *_ in seen)
    assert all(shadow == 4 and inside and reached for _, shadow, inside, reached in seen)


def test_on_a_phone_long_texts_of_a_table_are_read_below_each_other(visit, address_of_results):
    page = visit(address_of_results)
    page.set_viewport_size({"width": 390, "height": 780})
    page.wait_for_timeout(300)
    for cell in page.locator(".prose td").all():
        box = cell.bounding_box()
        assert box["x"] >= 0
        assert box["x"] + box["width"] <= 390
    page.get_by_label("rows with").fill("z-check-2")
    expect(page.get_by_role("region", name="Results").locator("tbody tr:visible")).to_have_count(1)


LINES = "() => Bokeh.documents[0].get_model_by_name('boxes of differences').title.text.split('\\n').length"


def test_a_title_is_broken_where_its_figure_ends(visit, address_of_three):
    page = visit(address_of_three)
    page.wait_for_function(f"({LINES})() === 1")
    page.set_viewport_size({"width": 390, "height": 780})
    page.wait_for_function(f"({LINES})() > 1")
    page.set_viewport_size({"width": 1280, "height": 900})
    page.wait_for_function(f"({LINES})() === 1")


def test_a_trace_shows_another_recording_and_sorts_its_candidates(visit, address_of_results):
    page = visit(address_of_results, "5")
    figures = page.get_by_role("region", name="Before and after").locator(".bk-Figure")
    expect(figures).to_have_count(4)
    page.get_by_label("Recording").select_option("log1")
    page.wait_for_function("location.search.includes('drive=1')")
    expect(figures).to_have_count(2)  # log1 has no path
    again = visit(address_of_results, "5" + page.evaluate("location.search"))
    assert again.get_by_label("Recording").input_value() == "log1"


def test_a_table_is_sorted_and_filtered(visit, address_of_results):
    page = visit(address_of_results)
    page.get_by_role("button", name="kind").click()
    rising = cells(page, 2)
    page.get_by_role("button", name="kind").press("Enter")
    assert rising == sorted(rising)
    assert cells(page, 2) == rising[::-1]
    shown = page.get_by_role("region", name="Results").locator("tbody tr:visible")
    expect(shown).to_have_count(9)
    page.get_by_label("rows with").fill("Z-Check-2")
    expect(shown).to_have_count(1)
    expect(shown).to_contain_text("z-check-2")
    page.get_by_label("rows with").fill("")
    expect(shown).to_have_count(9)


def test_a_warning_of_a_check_leads_to_its_signal(visit, address_of_results):
    page = visit(address_of_results, "2?signal=0")
    assert page.get_by_label("Signal", exact=True).input_value() == "speed"
    page.get_by_role("link", name="yaw rate", exact=True).click()
    page.wait_for_function("location.search.includes('signal=1')")
    page.get_by_text("the sign is wrong: slope -1").wait_for()
    page.wait_for_function(DRAWN, arg="yaw rate from speed: disagrees: sign")


def test_a_click_on_a_difference_leads_to_the_run_in_both_studies(visit, address_of_three, folder, other):
    page = visit(address_of_three)
    page.set_viewport_size({"width": 1280, "height": page.evaluate("document.documentElement.scrollHeight")})
    page.wait_for_timeout(500)
    pair = [h.open_results(f)["mass"].rmse.isel(target=0).values for f in (folder, other)]
    change = (pair[1] - pair[0])[1, ..., 1]  # at 1.9 t, the UKF
    assert abs(change).max() > 0
    assert not (pair[1] - pair[0])[..., 0].any()  # the EKF is the same in both
    x, y = page.evaluate(PIXEL, ["boxes of differences", 1 + 0.21, float(change.min())])
    page.mouse.click(x, y)
    worst = int(change.argmin())
    sample, drive, repeat = worst // 12, worst // 6 % 2, worst % 6
    for i, stored in enumerate(pair, 1):
        address = page.get_by_role("link", name=f"in car{'-other' if i == 2 else ''}", exact=False).nth(0)
        address = address.get_attribute("href")
        assert address == f"{i}?design=0&run=0.1.{drive}.{sample}.{repeat}&compared=1"
        run = visit(address_of_three, address)
        run.get_by_text(SAME).wait_for(timeout=120_000)
        shown = run.locator("#what-if table tbody tr").first.locator("td").nth(1).inner_text()
        value = stored[1, sample, drive, repeat, 1]
        assert float(shown.split()[0]) == pytest.approx(value, rel=0.005)


def test_by_keyboard_a_difference_leads_to_its_run_and_the_address_says_it(visit, address_of_three):
    page = visit(address_of_three)
    page.get_by_label("Box of differences").select_option(index=3)
    page.get_by_label("Its run").nth(1).select_option("smallest")
    page.wait_for_function("location.search.includes('run=1.1.1.')")
    chosen = page.get_by_role("region", name="The same run in each study")
    expect(chosen.locator("tbody tr")).to_have_count(2)  # the third study has other runs
    again = visit(address_of_three, page.evaluate("location.search"))
    there = again.get_by_role("region", name="The same run in each study")
    expect(there.locator("tbody tr")).to_have_count(2)
    for told in ("mass, 1.9 t, drive", "compute it again in car-other"):
        assert there.get_by_text(told).inner_text() == chosen.get_by_text(told).inner_text()
    assert there.locator("tbody").inner_text() == chosen.locator("tbody").inner_text()


def test_studies_are_switched_off_and_on(visit, address_of_three):
    page = visit(address_of_three)
    rows = page.get_by_role("region", name="In numbers").locator("tbody tr")
    expect(rows).to_have_count(12)  # three studies, two levels and estimators each
    page.get_by_role("button", name="car-other", exact=True).click()
    expect(rows).to_have_count(8)
    page.get_by_text("No study that is switched on has the runs of car.").wait_for()
    page.wait_for_function("location.search.includes('studies=0.2')")
    again = visit(address_of_three, page.evaluate("location.search"))
    expect(again.get_by_role("region", name="In numbers").locator("tbody tr")).to_have_count(8)
    page.get_by_role("button", name="car-other", exact=True).click()
    expect(rows).to_have_count(12)


def test_a_finding_of_the_campaign_leads_to_its_study(visit, address_of_results):
    page = visit(address_of_results)
    found = page.get_by_role("region", name="What the campaign found")
    assert found.locator("tbody tr").count() == 2
    assert found.get_by_role("link").count() == 1  # there is no page of the other one
    found.get_by_role("link", name="study").click()
    page.wait_for_function("document.title.startsWith('How heavy')")
