"""The pages as a real browser shows them, opened from the disk."""

import base64
import json
import shutil
import time
from dataclasses import replace

import cv2
import numpy as np
import pytest
from usdfoliage.jobs.plant.pages.library_page import Library, LibraryPlant, write_library_page
from usdfoliage.jobs.plant.pages.report_html import write_plant_report
from usdfoliage.jobs.report.timings import TaskTiming, Timings, write_timings

from tests.support.plant_reports import flat_picture, full_report

webdriver = pytest.importorskip("selenium.webdriver", reason="selenium is not installed")
from selenium.webdriver.common.action_chains import ActionChains  # noqa: E402
from selenium.webdriver.common.by import By  # noqa: E402
from selenium.webdriver.common.keys import Keys  # noqa: E402
from selenium.webdriver.support.select import Select  # noqa: E402

CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
DRIVER = shutil.which("chromedriver")
pytestmark = pytest.mark.skipif(not (CHROMIUM and DRIVER), reason="chromium and chromedriver are not installed")

# The clip of the drawing over the photograph, in percent from the left, as the browser computes it.
CLIP = """const clip = getComputedStyle(document.querySelector('.compare:not([hidden]) .over')).clipPath;
return parseFloat(clip.slice(6, -1).split(' ').pop());"""
FRAME = (
    "return [...document.querySelectorAll('.turn img')].findIndex(i => getComputedStyle(i).visibility === 'visible')"
)


@pytest.fixture(scope="module")
def browser():
    options = webdriver.ChromeOptions()
    options.binary_location = CHROMIUM
    for argument in ("--headless=new", "--no-sandbox", "--disable-gpu", "--disable-dev-shm-usage", "--hide-scrollbars"):
        options.add_argument(argument)
    options.set_capability("goog:loggingPrefs", {"browser": "ALL", "performance": "ALL"})
    driver = webdriver.Chrome(options=options, service=webdriver.ChromeService(DRIVER))
    driver.set_window_size(1280, 900)
    yield driver
    driver.quit()


@pytest.fixture
def opened(browser, tmp_path):
    """The full report, in the browser."""
    page = write_plant_report(tmp_path / "report", full_report(tmp_path))
    timings = Timings(executor="2 processes", seconds=83.0, stages=[TaskTiming(stage="leaves", seconds=3.25)])
    write_timings(page.parent, timings)
    return open_page(browser, page)


def open_page(browser, page):
    for kind in ("browser", "performance"):  # of the pages before
        browser.get_log(kind)
    browser.get(page.as_uri())
    return browser


def asked_for(browser):
    """Addresses of all requests since the page was opened, those within it shortened."""
    messages = [json.loads(entry["message"])["message"] for entry in browser.get_log("performance")]
    addresses = [m["params"]["request"]["url"] for m in messages if m["method"] == "Network.requestWillBeSent"]
    return {"data:" if address.startswith("data:") else address for address in addresses}


def photographed(browser):
    """(H, W, 3) of the window."""
    data = np.frombuffer(base64.b64decode(browser.get_screenshot_as_base64()), np.uint8)
    return cv2.imdecode(data, cv2.IMREAD_COLOR)[..., ::-1]


def show(browser, selector):
    found = browser.find_element(By.CSS_SELECTOR, selector)
    browser.execute_script("arguments[0].scrollIntoView({block: 'center', behavior: 'instant'})", found)
    return found


def test_the_page_opens_without_a_fault_and_asks_only_for_its_times(opened, tmp_path):
    assert opened.get_log("browser") == []
    page = (tmp_path / "report" / "index.html").as_uri()
    assert asked_for(opened) - {"data:"} == {page, page.replace("index.html", "timings.js")}
    broken = "return [...document.images].filter(i => i.hasAttribute('src') && !i.naturalWidth).length"
    assert opened.execute_script(broken) == 0


def test_warnings_are_in_the_first_window_and_nothing_is_wider_than_it(opened):
    warnings = opened.find_elements(By.CSS_SELECTOR, ".look li")
    assert "scale is not known" in warnings[0].text
    assert warnings[-1].rect["y"] + warnings[-1].rect["height"] < 600
    assert warnings[-1].rect["y"] < opened.find_element(By.CSS_SELECTOR, ".turntable").rect["y"]
    width = "return document.documentElement.scrollWidth - document.documentElement.clientWidth"
    assert opened.execute_script(width) == 0
    opened.set_window_size(500, 900)
    try:
        assert opened.execute_script(width) == 0
    finally:
        opened.set_window_size(1280, 900)


def test_the_bar_follows_the_mouse_and_the_keys(opened):
    slider = show(opened, ".compare:not([hidden]) .pair input")
    assert opened.execute_script(CLIP) == pytest.approx(50, abs=0.1)
    half = slider.rect["width"] / 2
    ActionChains(opened).move_to_element(slider).click_and_hold().move_by_offset(
        round(0.6 * half), 0
    ).release().perform()
    assert opened.execute_script(CLIP) == pytest.approx(80, abs=1.5)
    slider.send_keys(Keys.ARROW_LEFT)
    assert opened.execute_script(CLIP) == pytest.approx(78, abs=1.5)
    slider.send_keys(Keys.HOME)
    assert opened.execute_script(CLIP) == 0


def test_left_of_the_bar_is_the_photograph_and_right_of_it_the_plant(opened):
    show(opened, ".compare:not([hidden]) .pair")
    left, top, width, height = opened.execute_script(
        "const b = document.querySelector('.compare:not([hidden]) .pair').getBoundingClientRect();"
        "return [b.left, b.top, b.width, b.height]"
    )
    picture = photographed(opened).astype(int)
    row = round(top + 0.25 * height)
    assert np.abs(picture[row, round(left + 0.25 * width)] - (200, 30, 30)).max() < 10
    assert np.abs(picture[row, round(left + 0.75 * width)] - (30, 30, 200)).max() < 10


def test_another_photograph_can_be_chosen_by_keyboard(opened):
    first = show(opened, ".choose input")
    first.send_keys(Keys.ARROW_RIGHT)
    displayed = [figure for figure in opened.find_elements(By.CSS_SELECTOR, ".compare") if figure.is_displayed()]
    assert len(displayed) == 1
    assert "001.jpg" in displayed[0].text


def test_the_turntable_turns_by_keys_by_mouse_and_by_itself(opened):
    slider = show(opened, ".controls input")
    assert opened.execute_script(FRAME) == 0
    slider.send_keys(Keys.ARROW_RIGHT)
    assert opened.execute_script(FRAME) == 1
    stage = opened.find_element(By.CSS_SELECTOR, ".turn")
    half = round(stage.rect["width"] / 2)
    ActionChains(opened).move_to_element(stage).click_and_hold().perform()
    before = opened.execute_script(FRAME)
    ActionChains(opened).move_by_offset(-half, 0).perform()
    assert opened.execute_script(FRAME) == (before + 2) % 4  # half of a turn of four frames
    ActionChains(opened).release().move_to_element(slider).perform()
    before = opened.execute_script(FRAME)
    slider.send_keys(Keys.SPACE)
    button = opened.find_element(By.CSS_SELECTOR, ".controls button")
    assert button.text == "Pause"
    wait_until(lambda: opened.execute_script(FRAME) != before)
    slider.send_keys(Keys.SPACE)
    assert button.text == "Play"


def test_a_picture_of_a_stage_is_enlarged_and_closed_by_keyboard(opened):
    show(opened, ".zoom").send_keys(Keys.ENTER)
    assert opened.find_element(By.CSS_SELECTOR, "dialog img").is_displayed()
    ActionChains(opened).send_keys(Keys.ESCAPE).perform()
    assert not opened.find_element(By.CSS_SELECTOR, "dialog img").is_displayed()


def test_times_are_displayed_where_their_file_is_beside_the_page(opened, tmp_path):
    times = show(opened, "#times")
    wait_until(times.is_displayed)
    assert "83.0 s, 2 processes" in times.text
    (tmp_path / "report" / "timings.js").unlink()
    open_page(opened, tmp_path / "report" / "index.html")
    assert not opened.find_element(By.CSS_SELECTOR, "#times").is_displayed()


def test_the_window_is_not_blank(opened):
    opened.execute_script("scrollTo({top: 0, behavior: 'instant'})")
    assert len(np.unique(photographed(opened).reshape(-1, 3), axis=0)) > 50


def test_on_paper_are_all_pictures_and_nothing_to_press(opened):
    opened.execute_cdp_cmd("Emulation.setEmulatedMedia", {"media": "print"})
    try:
        figures = opened.find_elements(By.CSS_SELECTOR, ".compare")
        assert [figure.is_displayed() for figure in figures] == [True, True]
        photograph, drawing = figures[1].find_elements(By.CSS_SELECTOR, "img")
        assert drawing.rect["x"] >= photograph.rect["x"] + photograph.rect["width"]  # side by side
        assert opened.find_element(By.CSS_SELECTOR, ".pictures img").is_displayed()
        for pressed in opened.find_elements(By.CSS_SELECTOR, "nav, input, .controls button"):
            assert not pressed.is_displayed()
    finally:
        opened.execute_cdp_cmd("Emulation.setEmulatedMedia", {"media": ""})


def test_no_script_but_the_page_s_own_runs(browser, tmp_path):
    report = replace(full_report(tmp_path), name='<img src=x onerror="window.hit = 1"><script>window.hit = 1</script>')
    page = write_plant_report(tmp_path / "report", report)
    # What if something did get in after all: the policy of the page is the second line.
    text = page.read_text(encoding="utf-8")
    page.write_text(text.replace("<main>", "<main><script>window.hit = 2</script><img src=x onerror='window.hit = 3'>"))
    open_page(browser, page)
    assert browser.execute_script("return window.hit === undefined")
    refused = [entry["message"] for entry in browser.get_log("browser")]
    assert any("Content Security Policy" in message for message in refused)


def test_a_library_is_sorted_and_sifted(browser, tmp_path):
    plants = [
        LibraryPlant(name="birch", state="built", height_m=9.0, leaves=900, report="b/index.html", species="Betula"),
        LibraryPlant(name="ash", state="failed", message="too few photographs"),
        LibraryPlant(name="holly", state="warnings", height_m=2.0, leaves=12_000, thumbnail=flat_picture((0, 99, 0))),
    ]
    open_page(browser, write_library_page(tmp_path, Library(title="coast", plants=plants)))
    assert browser.get_log("browser") == []
    assert asked_for(browser) - {"data:"} == {(tmp_path / "index.html").as_uri()}

    def names():
        return [name.text for name in browser.find_elements(By.CSS_SELECTOR, ".tile h2") if name.is_displayed()]

    assert names() == ["ash", "holly", "birch"]  # what needs a look comes first
    select = Select(browser.find_element(By.CSS_SELECTOR, "#sort"))
    for key, order in (("leaves", ["holly", "birch", "ash"]), ("height", ["birch", "holly", "ash"])):
        select.select_by_value(key)
        assert names() == order
    browser.find_element(By.CSS_SELECTOR, "#turn").send_keys(Keys.SPACE)
    assert names() == ["holly", "birch", "ash"]  # what has no height stays last
    find = browser.find_element(By.CSS_SELECTOR, "#find")
    find.send_keys("BETU")
    assert names() == ["birch"]
    assert "1 of 3" in browser.find_element(By.CSS_SELECTOR, "#left").text
    find.send_keys(Keys.BACKSPACE * 4)
    browser.find_element(By.CSS_SELECTOR, "input[value=failed]").send_keys(Keys.SPACE)
    assert names() == ["holly", "birch"]


def wait_until(holds, max_wait_s=10.0):
    end = time.monotonic() + max_wait_s
    while not holds():
        assert time.monotonic() < end, "it did not come to hold"
        time.sleep(0.05)
