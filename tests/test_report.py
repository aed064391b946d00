from __future__ import annotations

import logging
import re
import shutil
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from hydra.core.hydra_config import HydraConfig

from sgbd.report import main, with_folder
from sgbd.reporting.page import render
from sgbd.reporting.runs import read_results
from tests.reporting.result_folders import write_run, write_sweep

NASTY = "<img src=x onerror=alert(1)>&\"'"


def report(folder: Path) -> str:
    return render(read_results(folder), frame_rows=100, megabytes=5)


# --- the page as text


def test_the_page_is_self_contained_and_the_same_every_time(tmp_path: Path) -> None:
    folder = write_run(tmp_path / "one", {"a": 0.5, "b": 0.25}, history=True, pictures=True)
    page = report(folder)
    assert page == report(folder)
    assert not re.search(r"(src|href)=\"(?!data:|#)", page)
    assert "url(http" not in page
    assert "@import" not in page
    identities = re.findall(r'\bid="([^"]+)"', page)
    assert len(identities) == len(set(identities))
    assert set(re.findall(r'href="#([^"]+)"', page)) <= set(identities)
    assert page.count("<svg") == 2
    assert "102,785" in page


def test_names_are_escaped(tmp_path: Path) -> None:
    page = report(write_run(tmp_path / "one", {NASTY: 0.5, "b": 0.25}, pictures=True, dataset="<script>x</script>"))
    assert "<img src=x" not in page
    assert "<script>x" not in page
    assert "&lt;img src=x onerror=alert(1)&gt;&amp;&#34;&#39;" in page


def test_rows_of_frames_are_shared_among_the_runs(tmp_path: Path) -> None:
    for name in ("x", "y"):
        write_run(tmp_path / name, {f"frame{number}": number / 10 for number in range(9)})
    page = render(read_results(tmp_path), frame_rows=6, megabytes=0)
    assert page.count("The worst 3 of 9 frames") == 2


# --- the command


def test_a_folder_needs_no_key(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "name=it's").mkdir()
    assert with_folder(["outputs/train/x"]) == ["folder='outputs/train/x'"]
    assert with_folder(["name=it's"]) == [r"folder='name=it\'s'"]
    assert with_folder(["outputs/features=all/seed=0"]) == ["folder='outputs/features=all/seed=0'"]
    unchanged = ["folder=x", "output=y", "hydra.run.dir=z", "--cfg", "job", "--config-dir", "here", "--help"]
    assert with_folder(unchanged) == unchanged


@pytest.fixture
def command(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Iterator[Callable[..., int]]:
    """Run the command in this process and return its exit status; Hydra's global state is reset afterwards."""
    handlers, level = logging.root.handlers[:], logging.root.level

    def run(*arguments: str) -> int:
        monkeypatch.setattr(sys, "argv", ["report", *arguments])
        try:
            main()
        except SystemExit as end:
            return int(end.code or 0)
        return 0

    yield run
    logging.root.handlers[:] = handlers
    logging.root.setLevel(level)
    HydraConfig.instance().cfg = None


def test_the_command_writes_one_file_and_explains_what_it_cannot_do(
    command: Callable[..., int],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    write_sweep(tmp_path / "sweep=1", {"rgb": None})
    (tmp_path / "here").mkdir()
    monkeypatch.chdir(tmp_path / "here")
    assert command("../sweep=1", "output=page.html") == 0
    assert [path.name for path in (tmp_path / "here").iterdir()] == ["page.html"]
    assert "Sweep sweep=1" in (tmp_path / "here/page.html").read_text()
    assert command("nowhere") == 1
    told = capsys.readouterr().err
    assert "nowhere does not exist; expected the folder of a training" in told
    assert "Traceback" not in told


# --- the page in a browser


@pytest.fixture(scope="module")
def browser() -> Iterator:
    webdriver = pytest.importorskip("selenium.webdriver", reason="no selenium here: pip install 'sgbd[dev]'")
    programs = [shutil.which(name) for name in ("chromium", "chromium-browser", "google-chrome")]
    program = next(filter(None, programs), None)
    driver = shutil.which("chromedriver")
    if program is None or driver is None:
        pytest.skip("no Chromium with its driver here: apt-get install chromium chromium-driver")
    options = webdriver.ChromeOptions()
    options.binary_location = program
    for argument in ("--headless=new", "--no-sandbox", "--disable-dev-shm-usage", "--window-size=1280,900"):
        options.add_argument(argument)
    options.set_capability("goog:loggingPrefs", {"browser": "ALL"})
    chromium = webdriver.Chrome(options, webdriver.ChromeService(driver))
    chromium.set_page_load_timeout(120)
    yield chromium
    chromium.quit()


@pytest.fixture(scope="module")
def page(browser, tmp_path_factory: pytest.TempPathFactory) -> str:
    """Write a sweep and evaluations of two datasets, one of them with a frame that shows only unseen objects."""
    folder = tmp_path_factory.mktemp("results")
    frames = {"low": 0.1, "high": 0.9, NASTY: 0.5}
    write_run(folder / "first", frames, pictures=True, history=True, unseen_only=("high",))
    write_run(folder / "second", {"other": 0.3}, pictures=True, dataset="elsewhere")
    write_sweep(folder / "third", {"null": None, "0.5": None, "0.25": None})
    path = folder / "report.html"
    path.write_text(report(folder))
    return path.as_uri()


@pytest.fixture
def opened(browser, page: str):
    browser.set_window_size(1280, 900)
    browser.get(page)
    yield browser
    assert [entry for entry in browser.get_log("browser") if entry["level"] == "SEVERE"] == []


def css(browser, selector: str) -> list:
    return browser.find_elements("css selector", selector)


def choose(browser, name: str, value: str) -> None:
    """Set a filter as a user does, and dispatch the event to the page."""
    browser.execute_script(
        "const e = document.querySelector(`#filters [name=${arguments[0]}]`); e.value = arguments[1];"
        "e.dispatchEvent(new Event('input', {bubbles: true}))", name, value,
    )  # fmt: skip


def names(browser) -> list[str]:
    return [card.get_attribute("data-name") for card in css(browser, ".card:not([hidden])")]


def test_nothing_is_loaded_and_nothing_runs_that_is_not_ours(opened) -> None:
    assert opened.execute_script("return performance.getEntriesByType('resource').map(e => e.name)") == []
    sizes = opened.execute_script("return [...document.querySelectorAll('.panels img')].map(i => i.naturalWidth)")
    assert sizes == [64] * 20
    assert opened.title == f"{opened.find_element('css selector', 'h1').text} · sgbd report"


def test_tables_are_sorted_by_clicking_and_by_keyboard(opened) -> None:
    from selenium.webdriver.common.keys import Keys

    opened.execute_script("document.querySelectorAll('details').forEach(d => d.open = true)")
    table = next(t for t in css(opened, "#run-0 figure.table") if "by frame" in t.get_attribute("textContent"))
    (score,) = [h for h in table.find_elements("css selector", "th") if h.text.startswith("overlap F")]
    button = score.find_element("css selector", "button")

    def column() -> list[str]:
        return [row.text for row in table.find_elements("css selector", "tbody td:nth-child(2)")]

    assert column() == ["10.0", "50.0", "90.0"]
    opened.execute_script("arguments[0].click()", button)
    assert (column(), score.get_attribute("aria-sort")) == (["90.0", "50.0", "10.0"], "descending")
    button.send_keys(Keys.ENTER)
    assert (column(), score.get_attribute("aria-sort")) == (["10.0", "50.0", "90.0"], "ascending")


def test_missing_values_stay_last_whichever_way_a_table_is_sorted(opened) -> None:
    opened.execute_script("document.querySelectorAll('details').forEach(d => d.open = true)")
    table = next(t for t in css(opened, "#run-0 figure.table") if "by protocol" in t.get_attribute("textContent"))
    button = table.find_element("css selector", "th:nth-child(3) button")
    for expected in (["25.0", "–", "–"], ["25.0", "–", "–"]):
        opened.execute_script("arguments[0].click()", button)
        assert [cell.text for cell in table.find_elements("css selector", "tbody td:nth-child(3)")] == expected


def test_options_are_sorted_as_numbers_before_texts(opened) -> None:
    table = css(opened, "#sweeps figure.table")[0]
    button = table.find_element("css selector", "th:nth-child(1) button")
    for expected in (["0.25", "0.5", "null"], ["null", "0.5", "0.25"]):
        opened.execute_script("arguments[0].click()", button)
        assert [cell.text for cell in table.find_elements("css selector", "tbody td:nth-child(1)")] == expected


def test_frames_are_filtered(opened) -> None:
    assert names(opened) == ["low", "high", NASTY, "other"]
    choose(opened, "dataset", "elsewhere")
    assert names(opened) == ["other"]
    assert opened.find_element("id", "shown").text == "1 of 4 frames"
    choose(opened, "dataset", "")
    choose(opened, "run", "first")
    choose(opened, "group", "seen")
    assert names(opened) == ["low", NASTY]
    choose(opened, "group", "only-unseen")
    assert names(opened) == ["high"]
    choose(opened, "group", "")
    choose(opened, "least", "20")
    choose(opened, "most", "60")
    assert names(opened) == [NASTY]
    choose(opened, "measure", "unaided_overlap_f_measure")
    assert names(opened) == ["high", NASTY]
    choose(opened, "order", "worst")
    assert names(opened) == [NASTY, "high"]
    choose(opened, "least", "99")
    choose(opened, "most", "")
    assert names(opened) == []
    assert opened.find_element("id", "none").is_displayed()
    opened.execute_script("arguments[0].click()", opened.find_element("css selector", "#filters [type=reset]"))
    opened.execute_async_script("setTimeout(arguments[0], 50)")
    assert names(opened) == ["low", "high", NASTY, "other"]


def test_panels_are_chosen(opened) -> None:
    box = opened.find_element("css selector", "#filters [value=edges]")
    opened.execute_script("arguments[0].click()", box)
    shown = {figure.get_attribute("data-panel") for figure in css(opened, ".panels figure:not([hidden])")}
    assert shown == {"frame", "superpixels", "prediction", "truth"}


def test_pictures_are_enlarged_and_walked_through_with_the_keyboard(opened) -> None:
    from selenium.webdriver.common.keys import Keys

    opener = css(opened, ".card .panels button")[0]
    opened.execute_script("arguments[0].focus()", opener)
    opener.send_keys(Keys.ENTER)
    viewer, title = opened.find_element("id", "viewer"), opened.find_element("id", "viewer-title")
    assert viewer.is_displayed()
    assert title.text == "low · frame"

    def press(key: str) -> str:
        opened.switch_to.active_element.send_keys(key)
        return title.text

    assert press(Keys.ARROW_RIGHT) == "low · superpixels"
    assert press(Keys.ARROW_DOWN) == "high · superpixels"
    assert press(Keys.ARROW_UP) == "low · superpixels"
    assert press(Keys.ARROW_LEFT) == "low · frame"
    assert press(Keys.ARROW_LEFT) == "low · truth"
    (pressed,) = css(opened, "#viewer-panels [aria-pressed=true]")
    assert pressed.text == "truth"
    press(Keys.ESCAPE)
    assert not viewer.is_displayed()
    assert opened.switch_to.active_element == opener


def test_links_open_what_is_folded_up(opened) -> None:
    (link,) = [a for a in css(opened, "#overview a") if a.text == "second"]
    opened.execute_script("arguments[0].click()", link)
    opened.execute_async_script("setTimeout(arguments[0], 100)")
    assert opened.find_element("id", "run-1").get_attribute("open") is not None


def test_links_to_frames_that_are_filtered_out_show_them(opened) -> None:
    from selenium.webdriver.support.ui import WebDriverWait

    choose(opened, "dataset", "elsewhere")
    (link,) = css(opened, "#run-0 figure.table a[href='#frame-1']")
    opened.execute_script("arguments[0].click()", link)
    # The page scrolls smoothly, so it arrives later.
    in_window = """
        const place = document.getElementById('frame-1').getBoundingClientRect();
        return 0 <= place.top && place.top < place.bottom && place.bottom <= innerHeight;
    """
    WebDriverWait(opened, 10).until(lambda driver: driver.execute_script(in_window))


@pytest.mark.parametrize("width", [360, 768, 1280])
def test_no_page_is_wider_than_its_window(opened, width: int) -> None:
    opened.execute_cdp_cmd(
        "Emulation.setDeviceMetricsOverride", {"width": width, "height": 800, "deviceScaleFactor": 1, "mobile": True}
    )
    opened.execute_script("document.querySelectorAll('details').forEach(d => d.open = true)")
    widths = opened.execute_script("return [document.documentElement.scrollWidth, window.innerWidth]")
    opened.execute_cdp_cmd("Emulation.clearDeviceMetricsOverride", {})
    assert widths == [width, width]


def test_colors_follow_the_system_or_the_readers_choice(opened) -> None:
    def background() -> str:
        return opened.execute_script("return getComputedStyle(document.body).backgroundColor")

    def system(scheme: str) -> None:
        features = [{"name": "prefers-color-scheme", "value": scheme}]
        opened.execute_cdp_cmd("Emulation.setEmulatedMedia", {"features": features})

    system("light")
    light = background()
    system("dark")
    dark = background()
    assert light == "rgb(255, 255, 255)"
    assert dark != light
    theme = opened.find_element("id", "theme")
    for expected in (light, dark, dark):
        opened.execute_script("arguments[0].click()", theme)
        assert background() == expected
    system("")
