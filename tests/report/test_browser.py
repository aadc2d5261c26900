"""The pages in a browser: no complaint, no request; slider and clicks show what the files hold."""

import re
from datetime import UTC, datetime

import numpy as np
import pytest

from auvplan.io import load_run
from auvplan.report import write_report
from auvplan.scenario.scenario import Scenario
from auvplan.site import Site
from tests.io.sample_run import make_run
from tests.report.browser import Browser, chromium
from tests.report.conftest import save

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(chromium() is None, reason="needs Chromium, which is not installed here"),
]

#: What is painted of a moment: places of the vehicle and the obstacles, the arrows, radii of the boundaries.
SHOWN = """(() => {
  const all = (name) => [...document.querySelectorAll(`.painted .${name}`)];
  const place = (mark) => [Number(mark.dataset.north), Number(mark.dataset.east)];
  return {
    vehicle: place(all("vehicle")[0]),
    pixel: all("vehicle")[0].getBoundingClientRect().x,
    obstacles: all("obstacle").map(place),
    boundaries: all("boundary").map((mark) => Number(mark.dataset.radius)),
    arrows: all("current")[0].getAttribute("d"),
  };
})()"""


#: Whether the bar lies over the vehicle, and whether the vehicle is in the window.
COVERED = """(() => {
  const box = (name) => document.querySelector(name).getBoundingClientRect();
  const [vehicle, bar] = [box(".painted .vehicle"), box(".transport")];
  return {
    covered: vehicle.top < bar.bottom && vehicle.bottom > bar.top,
    seen: vehicle.top >= 0 && vehicle.bottom <= window.innerHeight,
  };
})()"""


@pytest.fixture(scope="module")
def browser(tmp_path_factory):
    with Browser(tmp_path_factory.mktemp("profile")) as started:
        yield started


def set_time(browser, seconds):
    browser.run(
        "(() => { const slider = document.getElementById('time'); slider.value = "
        f"{seconds}; slider.dispatchEvent(new Event('input', {{ bubbles: true }})); }})()"
    )
    browser.frames(2)
    return browser.run(SHOWN)


def count(browser, rows):
    return browser.run(f"document.querySelectorAll('{rows}').length")


def assert_quiet(browser):
    assert browser.complaints() == []
    assert browser.requests() == []


def test_the_slider_moves_vehicle_obstacles_and_arrows(browser, run, run_page):
    browser.show(run_page)
    saved = load_run(run_page.parent)
    counts = saved["row_size"].values
    assert count(browser, "#legs-table tbody tr") == len(counts)
    before = set_time(browser, 0)
    for record in (60, int(counts[0]) + 60):
        time = float(saved["time"].values[record])
        shown = set_time(browser, round(time))
        near = abs(round(time) - time) * 3.0 + 1.0
        place = [float(saved[name].values[record]) for name in ("x", "y")]
        assert shown["vehicle"] == pytest.approx(place, abs=near)
        np.testing.assert_allclose(
            shown["obstacles"], saved["obstacle_position"].values[record, :, :2], atol=2.0
        )
        assert shown["pixel"] != before["pixel"]
        assert shown["arrows"] != before["arrows"]
        assert len(shown["arrows"]) > 100
        radii = saved["obstacle_radius"].values[0]
        assert (np.asarray(shown["boundaries"]) > radii).all()
        before = shown
    assert_quiet(browser)


def test_positions_and_edges_of_a_map_across_180_degrees(browser, tmp_path):
    run = make_run()
    run.scenario = Scenario().model_dump(mode="json")
    run.site = Site(179.998, -20.34, datetime(2026, 11, 22, 6, tzinfo=UTC), (1000.0, 1000.0))
    browser.show(write_report(save(run, tmp_path)))
    set_time(browser, 0)
    longitude, latitude = run.site.to_geographic(*run.graph.positions[run.start][:2])
    words = browser.run("document.body.textContent")
    assert f"{-latitude:.4f}°\u00a0S, {longitude:.4f}°\u00a0E" in words
    edges = re.findall(r"([\d.]+)° ([EW])", words)
    assert {side for _, side in edges} == {"E", "W"}
    assert all(179.9 < float(degrees) <= 180.0 for degrees, _ in edges)
    assert_quiet(browser)


def test_times_on_the_page_are_rounded_and_none_is_minus_nothing(browser, run_page):
    browser.show(run_page)
    assert browser.run("report.hours(-20)") == "0 h 00 min"
    assert browser.run("report.hours(-90)") == "−0 h 02 min"
    assert browser.run("report.utc(3.6, '2026-03-01T05:30:00Z')") == "2026-03-01 05:30:04 UTC"


def test_boundaries_grow_between_two_looks_and_shrink_at_one(browser, run, run_page):
    browser.show(run_page)
    first = run.legs[0]
    radii = [set_time(browser, second)["boundaries"][0] for second in range(0, 29, 7)]
    assert (np.diff(radii) > 0.0).all()
    assert radii[0] == pytest.approx(first.obstacle_radii[0] + 3.0 * 2.0**0.5 * 10.0, abs=0.01)
    assert set_time(browser, 200)["boundaries"][0] < radii[0]


def test_keys_play_and_step_and_layers_are_switched(browser, run_page):
    browser.show(run_page)
    browser.run("document.getElementById('time').focus()")
    browser.press("ArrowRight")
    moved = browser.run("Number(document.getElementById('time').value)")
    assert moved > 0
    browser.press(" ", "Space", " ")
    assert browser.run("document.getElementById('play').getAttribute('aria-pressed')") == "true"
    browser.frames(10)
    browser.press(" ", "Space", " ")
    assert browser.run("document.getElementById('play').getAttribute('aria-pressed')") == "false"
    assert browser.run("Number(document.getElementById('time').value)") > moved
    assert browser.run("document.getElementById('time').getAttribute('aria-valuetext')").startswith("0 h")
    for layer, mark in (
        ("plan", ".painted .plan"),
        ("track", ".painted .executed"),
        ("current", ".painted .current"),
    ):
        assert count(browser, mark) == 1
        browser.run(f"document.querySelector('[data-layer={layer}]').click()")
        assert count(browser, mark) == 0
    assert_quiet(browser)


@pytest.mark.slow
def test_light_dark_narrow_and_printed(browser, run_page, tmp_path):
    for width, dark in ((390, True), (1280, False)):
        browser.show(run_page, width, dark=dark)
        assert browser.run("document.documentElement.dataset.theme") == ("dark" if dark else "light")
        assert browser.run("document.documentElement.scrollWidth") <= width
        assert_quiet(browser)
    browser.run("document.querySelector('[name=theme][value=dark]').click()")
    assert browser.run("document.documentElement.dataset.theme") == "dark"
    browser.pdf(tmp_path / "page.pdf")
    assert (tmp_path / "page.pdf").read_bytes().startswith(b"%PDF")
    assert browser.run("document.documentElement.dataset.theme") == "dark"
    browser.run("document.querySelector('[name=theme][value=auto]').click()")
    assert_quiet(browser)


def test_a_mission_of_a_study_opens(browser, study_page):
    browser.show(study_page)
    assert count(browser, "#missions-table tbody tr") == 8
    browser.run("(() => { const list = document.getElementById('case'); list.value = '1';"
                " list.dispatchEvent(new Event('change')); })()")  # fmt: skip
    browser.run("document.querySelector('[data-seed=\"4\"]').click()")
    browser.frames()
    assert browser.run("document.getElementById('mission-title').textContent").startswith("Seed 4")
    stated = browser.run("report.data.cases[1].missions[1].legs.length")
    assert count(browser, "#mission-legs tbody tr") == stated > 0
    words = browser.run("document.getElementById('mission').textContent")
    assert "auvplan report runs/0001-00000004" in words
    assert browser.run("document.getElementById('again').textContent").startswith(
        "auvplan mission whitsunday --seed 4"
    )
    assert "--set vehicle.speed=2.5" in words
    assert_quiet(browser)


def test_the_bar_covers_the_vehicle_at_no_time(browser, run, run_page):
    browser.show(run_page, 1280, 900)
    for second in np.linspace(0.0, run.t_mission, 7):
        set_time(browser, round(second))
        shown = browser.run(COVERED)
        assert not shown["covered"], second
    browser.run("document.getElementById('play').click()")
    browser.frames(5)
    browser.run("document.getElementById('play').click()")
    for second in np.linspace(0.0, run.t_mission, 7):
        set_time(browser, round(second))
        shown = browser.run(COVERED)
        assert not shown["covered"], second
        assert shown["seen"], second
    assert_quiet(browser)
