"""The page in a browser: a click computes the stored run again, and nothing goes wrong on the way."""

import numpy as np
import pytest

import harness as h
from harness.config import load_study
from harness.study.replay import Place, Replayer
from harness.study.report import analyse
from harness.study.stored import study_of
from harness.view.factors import points_of

SAME = "The scores are those of the store, to the last bit."
PLACE_OF = """([x, y]) => {
    const view = Bokeh.index.find_one(Bokeh.documents[0].get_model_by_name('boxes of runs'));
    const box = view.canvas_view.el.getBoundingClientRect();
    return [box.x + view.frame.x_scale.compute(x), box.y + view.frame.y_scale.compute(y)];
}"""
pytestmark = pytest.mark.browser


@pytest.fixture
def opened(visit, address):
    """Open the page of the study with a query."""
    return lambda query="": visit(address, query)


def said(page, words):
    page.get_by_text(words).first.wait_for(timeout=300_000)


def test_a_click_on_the_worst_run_computes_it_again(opened, folder):
    page = opened()
    errors = h.open_results(folder)["mass"].rmse.isel(band=1, estimator=0, target=0).values
    page.evaluate("window.scrollTo(0, 0)")
    x, y = page.evaluate(PLACE_OF, [1 - 0.84 / 4, float(errors.max())])
    page.mouse.click(x, y)
    said(page, SAME)
    worst = int(errors.argmax())
    sample, drive, repeat = worst // 12, worst // 6 % 2, worst % 6
    page.wait_for_function(f"location.search.includes('run=0.1.{drive}.{sample}.{repeat}')")
    again = opened(page.evaluate("location.search"))
    said(again, SAME)
    said(again, f"repeat {repeat}")


def test_by_keyboard_a_run_is_chosen_and_a_slider_moved(opened):
    page = opened()
    page.get_by_label("Its run").select_option("largest")
    said(page, SAME)
    handle = page.locator("#what-if .noUi-handle").first
    handle.focus()
    for _ in range(3):
        handle.press("ArrowRight")
    said(page, "This run is in no store: mass in t")
    page.wait_for_function("location.search.includes('plant.mass=')")
    page.get_by_role("button", name="As it was").click()
    said(page, SAME)
    page.wait_for_function("!location.search.includes('plant.mass')")


def test_boxes_follow_what_is_chosen(opened):
    page = opened()
    for label, option in (("Score", "NIS"), ("Boxes", "by drive, at 1.9 t"), ("Score", "time of divergence")):
        page.get_by_label(label, exact=True).select_option(option)
    page.get_by_role("button", name="linear", exact=True).click()
    page.get_by_role("button", name="EKF", exact=True).first.click()
    page.wait_for_function("location.search.includes('log=0') && location.search.includes('estimators=1')")
    assert "score=time_of_divergence" in page.evaluate("location.search")


def test_a_run_is_taken_away(opened, tmp_path):
    page = opened("?run=0.1.1.0.4&compared=0")
    said(page, SAME)
    for button, file in (("As study file", "study.toml"), ("As CSV", "run.csv")):
        with page.expect_download() as download:
            page.get_by_role("button", name=button).click()
        assert download.value.suggested_filename == file
        download.value.save_as(tmp_path / file)
    study = load_study(tmp_path / "study.toml")
    assert (study.count_from.drive, study.count_from.repeat) == (1, 4)
    assert (tmp_path / "run.csv").read_text().startswith("time,")


@pytest.mark.parametrize("width", [390, 1280, 1920])
def test_it_is_no_wider_than_the_screen(opened, width):
    page = opened("?run=0.1.1.0.4&compared=0.1")
    page.set_viewport_size({"width": width, "height": 900})
    said(page, SAME)
    page.wait_for_timeout(300)
    assert page.evaluate("document.documentElement.scrollWidth") <= width


def test_nothing_is_written_to_the_store(opened, folder):
    before = {p: (p.stat().st_mtime_ns, p.read_bytes()) for p in sorted(folder.rglob("*")) if p.is_file()}
    said(opened("?run=0.0.0.0.1&compared=0.1&plant.mass=1600"), "This run is in no store")
    after = {p: (p.stat().st_mtime_ns, p.read_bytes()) for p in sorted(folder.rglob("*")) if p.is_file()}
    assert before == after


SET_TIME = """(t) => {
    [...Bokeh.documents[0]._all_models.values()].find((m) => m.type === 'Slider' && m.title === 'Time in s').value = t;
}"""
WHEELS = "Bokeh.documents[0].get_model_by_name('above wheels').data.xs.length"
HERE = "(t) => Math.abs(Bokeh.documents[0].get_model_by_name('above here').data.t[0] - t) < 0.01"


def test_the_vehicle_from_above_follows_the_slider(opened, folder):
    page = opened("?run=0.1.1.0.4&compared=0.1")
    said(page, SAME)
    page.get_by_label("Path coloured by").wait_for()
    study = study_of(folder)
    run = Replayer(study).run(Place(0, 1, 1, 0, 4), everything=True)
    most = np.abs(run.motion["lateral_force"].values).max(axis=1)
    page.wait_for_function(HERE, arg=float(run.motion["time"].values[int(np.argmax(most))]))  # where it begins
    slip = np.abs(run.motion["slip_angle"].values[:, 0])
    wanted = float(run.motion["time"].values[int(np.argmax(slip))])
    page.evaluate(SET_TIME, wanted)
    page.wait_for_function(HERE, arg=wanted)
    time = page.evaluate("Bokeh.documents[0].get_model_by_name('above here').data.t[0]")
    at = run.motion.sel(time=time, method="nearest")
    rows = [row.split("\t") for row in page.locator("table.axles tr").all_inner_texts()[1:]]
    assert [row[0] for row in rows] == ["front", "rear"]
    for column, name, scale in ((1, "slip_angle", 180 / np.pi), (2, "lateral_force", 1e-3), (3, "vertical_load", 1e-3)):
        shown = [float(row[column].replace("−", "-")) for row in rows]
        assert shown == pytest.approx(scale * at[name].values, abs=0.0051 if column < 3 else 0.051)
    assert page.evaluate(WHEELS) == 4
    page.get_by_label("Path coloured by").select_option(index=1)
    who = [row.split("\t")[1] for row in page.locator("table.angles tr").all_inner_texts()[1:]]
    assert who == ["truth", *(e.name for e in study.estimators)]
    page.get_by_role("button", name="Play").click()
    page.wait_for_function(f"!({HERE})({wanted})")


FRAME_OF = """(name) => {
    const view = Bokeh.index.find_one(Bokeh.documents[0].get_model_by_name(name));
    view.canvas_view.el.scrollIntoView({block: 'center'});
    const box = view.canvas_view.el.getBoundingClientRect(), frame = view.frame.bbox;
    return [box.x + frame.left, box.y + frame.top, frame.width, frame.height];
}"""
SELECTED = """() => {
    const models = [...Bokeh.documents[0]._all_models.values()];
    return models.find((m) => m.type === 'ColumnDataSource' && m.data.ys && m.data.score).selected.indices.length;
}"""


LOWER = """() => {
    const models = [...Bokeh.documents[0]._all_models.values()];
    return models.find((m) => m.type === 'RangeSlider').value[0];
}"""
HELD = """(title) => {
    const models = [...Bokeh.documents[0]._all_models.values()];
    return models.find((m) => m.type === 'Figure' && m.title.text.startsWith(title))?.hold_render;
}"""


def test_what_is_brushed_and_the_time_stand_in_the_address(opened, folder):
    page = opened("?design=1&run=1.0.0.5.0&compared=0")
    said(page, SAME)
    left, top, width, height = page.evaluate(FRAME_OF, "scatter 0")
    page.mouse.move(left + 0.3 * width, top + 0.05 * height)
    page.mouse.down()
    page.mouse.move(left + 0.7 * width, top + 0.95 * height, steps=4)
    page.mouse.up()
    page.wait_for_function("location.search.includes('brush=0%2C')")
    count = page.evaluate(SELECTED)
    assert 0 < count < 64
    page.evaluate(SET_TIME, 2.0)
    page.wait_for_function("location.search.includes('time=2.00')")
    again = opened(page.evaluate("location.search"))
    said(again, SAME)
    again.wait_for_function(HERE, arg=2.0)
    assert again.evaluate(SELECTED) == count


def test_points_of_a_design_and_a_run_of_theirs_are_chosen_by_keyboard(opened, folder):
    page = opened("?design=1")
    page.get_by_label("Points by").select_option("mass in t")
    handle = page.locator(".noUi-handle-lower").first
    handle.focus()
    for _ in range(5):  # half of the range
        handle.press("PageUp")
    page.wait_for_function("location.search.includes('brush=0%2C')")
    found = points_of(analyse(folder).store.designs[1], "rmse", 0, 0, None)
    held = np.flatnonzero(found.values[:, 0] >= page.evaluate(LOWER))
    assert 0 < len(held) < 64
    page.wait_for_function(f"({SELECTED})() === {len(held)}")
    page.get_by_label("Their run").select_option("largest")
    said(page, SAME)
    worst = held[np.argmax(found.scores[held])]
    place = f"1.0.{found.worst[worst][0]}.{found.places[worst][1]}.{found.worst[worst][1]}"
    page.wait_for_function(f"location.search.includes('run={place}')")


def test_what_is_out_of_sight_is_painted_when_it_comes_near(opened):
    page = opened("?run=0.1.1.0.4&compared=0")
    said(page, SAME)
    page.wait_for_function(f"({HELD})('Input') === true")
    assert page.evaluate(HELD, "RMSE") is False
    page.evaluate("window.scrollTo(0, document.body.scrollHeight)")
    page.wait_for_function(f"({HELD})('Input') === false")
    page.wait_for_function(f"({HELD})('RMSE') === true")


def test_the_way_of_the_estimates_is_drawn_beside_the_drive(opened, folder):
    page = opened("?run=0.1.1.0.4&compared=0.1")
    said(page, SAME)
    page.get_by_text("they end away from it by").wait_for()
    run = Replayer(study_of(folder)).run(Place(0, 1, 1, 0, 4), [0], everything=True)
    x, y = run.paths["EKF"]
    off = np.hypot(x[-1] - run.motion["x"].values[-1, 0], y[-1] - run.motion["y"].values[-1, 0])
    said(page, f"EKF {off:.3g} m")


def test_the_worst_drive_of_an_estimator_and_where_on_it_are_found_by_choosing(opened, folder):
    """The way of the first, second and fourth question of docs/view.md, on a car."""
    page = opened()
    page.get_by_label("Boxes").select_option("by drive, at 1.9 t")
    page.wait_for_function("location.search.includes('level=1')")
    boxes = page.get_by_label("Box", exact=True)
    errors = h.open_results(folder)["mass"].rmse.isel(band=1, estimator=0, target=0, sample=0).values
    worst = int(np.median(errors, axis=1).argmax())
    offered = [o for o in boxes.locator("option").all_inner_texts() if ", EKF:" in o]
    shown = [float(o.rsplit("median ", 1)[1].split()[0]) for o in offered]
    assert int(np.argmax(shown)) == worst
    boxes.select_option(offered[worst])
    page.get_by_label("Its run").select_option("largest")
    said(page, SAME)
    page.wait_for_function(f"location.search.includes('run=0.1.{worst}.0.{int(errors[worst].argmax())}')")
    page.get_by_label("Path coloured by").select_option("error of EKF: lateral velocity")
    rows = page.locator("#what-if table tbody tr").all_inner_texts()
    assert rows[0].startswith("EKF: RMSE, lateral velocity")
    assert sum("RMSE" in row for row in rows) == 2  # the other estimator on the same run: is it the plant's?


OFFERED = """(title) => [...Bokeh.documents[0]._all_models.values()].find((m) => m.title === title).value.join()"""


def test_signals_sliders_and_colours_stand_in_the_address(opened):
    page = opened("?run=0.1.1.0.4&compared=0")
    said(page, SAME)
    page.get_by_label("Path coloured by").select_option("error of EKF: lateral velocity")
    for title, value in (("Signals", ["yaw_rate"]), ("Parameters of the plant", [])):
        found = "[...Bokeh.documents[0]._all_models.values()].find((m) => m.title === title)"
        page.evaluate(f"([title, value]) => {{ {found}.value = value; }}", [title, value])
    page.wait_for_function("/parameters=(&|$)/.test(location.search) && location.search.includes('signals=yaw_rate')")
    page.wait_for_function("location.search.includes('colour=error+of+EKF')")
    again = opened(page.evaluate("location.search"))
    said(again, SAME)
    assert [again.evaluate(OFFERED, t) for t in ("Signals", "Parameters of the plant")] == ["yaw_rate", ""]
    assert again.get_by_label("Path coloured by").input_value() == "error of EKF: lateral velocity"
    assert again.locator("#what-if .noUi-handle").count() == 0


POINTS = """() => {
    const plot = Bokeh.documents[0].get_model_by_name('boxes of runs');
    const scatter = plot.renderers.map((r) => r.glyph).find((g) => g.type === 'Scatter' && g.marker?.field);
    const wide = plot.renderers.map((r) => r.glyph).find((g) => g.type === 'VBar').width.value;
    return [scatter.size.value, wide * plot.inner_width / (plot.x_range.end - plot.x_range.start)];
}"""
LEGIBLE = """() => {
    const view = Bokeh.index.find_one(Bokeh.documents[0].get_model_by_name('boxes of runs'));
    const axis = [...view.all_renderer_views].find((v) => v.model.type === 'LogAxis');
    return axis.tick_coords.major[1].length;
}"""


@pytest.mark.parametrize("width", [300, 1280])
def test_points_cover_no_box_and_a_logarithmic_axis_has_numbers(opened, width):
    page = opened()
    page.set_viewport_size({"width": width, "height": 900})
    page.wait_for_timeout(500)
    size, box = page.evaluate(POINTS)
    assert size <= max(1.5, 0.51 * box)
    assert 3 <= page.evaluate(LEGIBLE) <= 10


FOCUS = """() => {
    let at = document.activeElement;
    while (at?.shadowRoot?.activeElement) at = at.shadowRoot.activeElement;
    const label = at.labels?.[0]?.textContent ?? at.getAttribute('aria-label') ?? at.textContent;
    return `${at.tagName.toLowerCase()} ${at.className} ${label}`.replace(/\\s+/g, ' ').slice(0, 120);
}"""


def once_round(page, key):
    """What the tabulator reaches until it leaves the page."""
    reached = []
    while not reached or not reached[-1].startswith("body"):
        page.keyboard.press(key)
        page.wait_for_timeout(200)  # as a hand does: by then a list of choices has opened
        reached.append(page.evaluate(FOCUS))
        assert len(reached) < 100, f"it does not leave: {reached}"
    return reached


@pytest.mark.parametrize("key", ["Tab", "Shift+Tab"])
def test_every_control_is_reached_by_the_tabulator(opened, key):
    page = opened("?run=0.1.1.0.4&compared=0")
    said(page, SAME)
    page.get_by_label("Path coloured by").wait_for()
    reached = once_round(page, key)
    wanted = ["Target", "Score", "Boxes", "Box", "Its run", "logarithmic", "EKF", "As CSV", "Play", "Path coloured by"]
    assert [w for w in wanted if not any(w in r for r in reached)] == []
    assert sum("noUi-handle" in r for r in reached) >= 2  # time, and a parameter of the plant
