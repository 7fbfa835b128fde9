"""The report of a small campaign with a refused recording and a controller named in markup, in
headless Chromium."""

import os
import re
import shutil

import numpy as np
import polars as pl
import pytest
from selenium import webdriver
from selenium.common.exceptions import StaleElementReferenceException
from selenium.webdriver.chrome.service import Service
from selenium.webdriver.common.by import By
from selenium.webdriver.common.keys import Keys
from selenium.webdriver.support.ui import Select, WebDriverWait
from test_workflow import Workspace

from osl_analysis.report.reported_trial import VERDICTS
from osl_analysis.table import read_table

pytestmark, DRIVER = pytest.mark.browser, shutil.which("chromedriver")
HOSTILE = '<img src=x onerror="document.title=1">'
FLAGS = (
    "headless=new",
    "no-sandbox",
    "disable-gpu",
    # a container's /dev/shm may be too small for a renderer, which then hangs
    "disable-dev-shm-usage",
    "disable-background-networking",
    "disable-component-update",
    "disable-sync",
    "no-first-run",
    "window-size=1300,1000",
)
KINDS = ("belt", "transmission", "actuator", "impedance", "static", "plate", "walking")


@pytest.fixture(scope="session")
def results(tmp_path_factory):
    """The results of a small campaign taken for a measured one, with further and with damaged
    recordings."""
    space = Workspace(tmp_path_factory.mktemp("campaign"))
    # this records all trials
    done = space.run("raw_data/small/trials.csv", "results/tables/quality.csv")
    assert done.returncode == 0, done.stdout + done.stderr
    raw = space.folder / "raw_data/small"
    sheet = pl.read_csv(raw / "trials.csv", infer_schema_length=None)
    damaged = raw / "dynamometer/belt_02.mcap"
    damaged.write_bytes(damaged.read_bytes()[:4000])
    hostile = (
        pl.when(pl.col("controller") == "uncompensated")
        .then(pl.lit(HOSTILE))
        .otherwise(pl.col("controller"))
    )
    sheet.with_columns(hostile.alias("controller")).write_csv(raw / "trials.csv")
    space.configure(
        {
            "simulation": None,
            "results": "results/other",
            "failed_trials": "accept",
            "campaign": "other",
        }
    )
    done = space.run("reproduce-all")
    assert done.returncode == 0, done.stdout + done.stderr
    return space.folder / "results/other"


@pytest.fixture(scope="session")
def chromium():
    if DRIVER is None:
        pytest.fail(
            "no chromedriver: install Chromium and its driver (Debian: chromium, chromium-driver)"
        )
    os.environ |= {"SE_OFFLINE": "true", "SE_AVOID_STATS": "true"}
    options = webdriver.ChromeOptions()
    for flag in FLAGS:
        options.add_argument(f"--{flag}")
    # the driver's own wait for a load hung on a busy machine: the tests wait for what they look at
    options.page_load_strategy = "none"
    options.set_capability("goog:loggingPrefs", {"browser": "ALL", "performance": "ALL"})
    driver = webdriver.Chrome(options=options, service=Service(DRIVER))
    yield driver
    driver.quit()


@pytest.fixture
def page(chromium, results):
    """The page as it opens, and nothing in its console or on the network when a test is done with
    it."""
    open_page(chromium, "about:blank")
    chromium.execute_cdp_cmd("Emulation.clearDeviceMetricsOverride", {})
    chromium.execute_cdp_cmd("Emulation.setEmulatedMedia", {"features": []})
    for log in ("browser", "performance"):
        chromium.get_log(log)
    open_page(chromium, (results / "report.html").as_uri())
    yield chromium
    said, sent = (chromium.get_log(log) for log in ("browser", "performance"))
    errors = [entry["message"] for entry in said if entry["level"] in ("SEVERE", "WARNING")]
    requests = [
        entry["message"] for entry in sent if '"Network.requestWillBeSent"' in entry["message"]
    ]
    assert (errors, [text for text in requests if "report.html" not in text]) == ([], [])


def open_page(page, address):
    """Go to an address, and wait until its document is there in place of the one before."""
    state = "return [location.href, document.readyState]"
    page.get(address)
    wait(page, lambda: page.execute_script(state) == [address, "complete"])


def wait(page, condition):
    """Wait for a condition; an element that the page replaces meanwhile is looked for again."""
    return WebDriverWait(page, 20, ignored_exceptions=(StaleElementReferenceException,)).until(
        lambda _: condition()
    )


def open_trial(page, name):
    page.execute_script("location.hash = '#trial=' + encodeURIComponent(arguments[0])", name)
    wait(page, lambda: page.find_element(By.ID, "trial").get_attribute("data-drawn") == name)


def visible(page):
    rows = page.find_elements(By.CSS_SELECTOR, "#table tbody tr")
    return [row.get_attribute("data-name") for row in rows if row.is_displayed()]


def test_the_overview_shows_figures_and_every_trial_and_names_from_files_are_text(page, results):
    sheet = pl.read_csv(results.parents[1] / "raw_data/small/trials.csv", infer_schema_length=None)
    assert sorted(visible(page)) == sorted(sheet["trial"])
    verdicts = [one.text for one in page.find_elements(By.CSS_SELECTOR, "#table td:nth-child(2)")]
    assert (verdicts[0], verdicts) == (
        "refused",
        sorted(verdicts, key=VERDICTS.index, reverse=True),
    )
    figures = {figure.get_attribute("id") for figure in page.find_elements(By.TAG_NAME, "figure")}
    assert {f"figure-fig{k}" for k in range(3, 10)} - {"figure-fig8"} <= figures
    drawn = page.find_elements(By.CSS_SELECTOR, "figure svg")
    assert len(drawn) == len(figures)
    assert all(
        figure.size["width"] > 300 and figure.get_attribute("aria-label") for figure in drawn
    )
    cells = [cell.text for cell in page.find_elements(By.CSS_SELECTOR, "#table td:nth-child(5)")]
    assert sum(HOSTILE in text for text in cells) == 2
    open_trial(page, "impedance_K300_B5.0_uncompensated")
    assert HOSTILE in page.find_element(By.ID, "trial").text
    assert page.find_elements(By.TAG_NAME, "img") == []


@pytest.mark.parametrize("scheme", ["light", "dark"])
@pytest.mark.parametrize(("width", "height"), [(1440, 900), (1280, 800), (390, 844)])
def test_the_first_screen_says_what_was_done_and_found_beside_a_figure_and_nothing_is_wider(
    page, results, width, height, scheme
):
    """Its pictures lie beside the results. The campaign simulates nothing: nothing is compared with
    the draft."""
    screen = {"width": width, "height": height, "deviceScaleFactor": 1, "mobile": width < 500}
    page.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", screen)
    page.execute_cdp_cmd(
        "Emulation.setEmulatedMedia",
        {"features": [{"name": "prefers-color-scheme", "value": scheme}]},
    )
    picture = results.parent / f"page_{width}_{scheme}.png"
    assert page.save_screenshot(str(picture))
    assert picture.stat().st_size > 10_000
    said = page.find_element(By.ID, "summary").text
    for words in (
        "simulated trials of the ankle: 2 belt, ",
        "The error of K against the commanded K_d",
    ):
        assert words in said
    assert "1 was refused" in page.find_element(By.ID, "state").text
    shown = page.find_elements(By.CSS_SELECTOR, ".done, #state, .first figure svg")
    bottoms = [one.location["y"] + one.size["height"] for one in shown]
    assert len(bottoms) == 3
    assert width < 500 or max(bottoms) < 1.05 * height, bottoms
    assert page.execute_script("return document.documentElement.scrollWidth") <= width
    for fold in page.find_elements(By.CSS_SELECTOR, "#overview details"):
        page.execute_script("arguments[0].open = true", fold)
    assert page.execute_script("return document.documentElement.scrollWidth") <= width
    assert "Draft of the paper" not in {
        one.text for one in page.find_elements(By.CSS_SELECTOR, "#numbers th")
    }


def test_a_cell_of_the_map_leads_to_its_trial_and_is_told_by_more_than_its_colour(page):
    cell = page.find_element(By.CSS_SELECTOR, ".map tr:not(.whole) .doubtful")
    assert cell.text == "?"
    cell.click()
    name = cell.get_attribute("title").split(",")[0]
    wait(page, lambda: page.find_element(By.ID, "trial").get_attribute("data-drawn") == name)


def test_it_sorts_by_numbers_both_ways_with_missing_ones_last(page):
    def column():
        cells = page.find_elements(By.CSS_SELECTOR, "#table tbody td:nth-child(7)")
        return [
            float(cell.get_attribute("data-value"))
            for cell in cells
            if cell.get_attribute("data-value")
        ]

    before = column()
    buttons = page.find_elements(By.CSS_SELECTOR, "#table th button")
    (stiffness,) = (one for one in buttons if one.text.split()[0] == "K")
    # at the edge of the window a row may cover it while the page still scrolls
    page.execute_script("arguments[0].scrollIntoView({block: 'center'})", stiffness)
    stiffness.click()
    assert column() == sorted(before)
    stiffness.click()
    assert column() == sorted(before, reverse=True)
    assert (
        page.find_elements(By.CSS_SELECTOR, "#table tbody tr")[-1]
        .find_elements(By.TAG_NAME, "td")[5]
        .text
        == "–"
    )


MADE_TABLE = """
const row = (tag, ...cells) => element("tr", {}, ...cells.map((text) => element(tag, {}, text)));
const texts = ["10", "9", "–", "−3.5", "1.5·10⁻⁵", "x", 'x, "y"', "", "0.2", "0.15"];
const made = element(
  "table", { id: "made" }, element("thead", {}, row("th", "name", "K")),
  element("tbody", {}, ...texts.map((text) => row("td", `of ${text}`, text))),
);
made.tHead.rows[0].cells[1].dataset.unit = "N·m/rad";
document.getElementById("summary").append(element("div", { class: "scroll" }, made));
addTableTools(made, "made");
"""


def column_of(page, table, column):
    """The texts of a column, from above."""
    cells = page.find_elements(By.CSS_SELECTOR, f"{table} tbody tr > :nth-child({column})")
    return [cell.get_attribute("textContent") for cell in cells]


def test_a_table_is_sorted_by_numbers_as_numbers_from_the_keyboard_with_empty_cells_last(page):
    page.execute_script(MADE_TABLE)
    head = page.find_element(By.CSS_SELECTOR, "#made th:nth-child(2)")
    button = head.find_element(By.TAG_NAME, "button")

    button.send_keys(Keys.ENTER)
    upwards = column_of(page, "#made", 2)
    state = head.get_attribute("aria-sort")
    button.send_keys(Keys.SPACE)
    downwards = column_of(page, "#made", 2)

    numbers, texts = ["−3.5", "1.5·10⁻⁵", "0.15", "0.2", "9", "10"], ["x", 'x, "y"']
    assert upwards == [*numbers, *texts, "–", ""]
    assert downwards == [*texts[::-1], *numbers[::-1], "–", ""]
    assert (state, head.get_attribute("aria-sort")) == ("ascending", "descending")


def test_the_csv_of_a_table_has_its_shown_columns_with_units_and_quotes(page):
    page.execute_script(MADE_TABLE)

    text = page.execute_script("return csvOf(document.getElementById('made'))")
    page.execute_script("showColumn(document.getElementById('made'), 1, false)")
    without = page.execute_script("return csvOf(document.getElementById('made'))")

    lines = text.split("\r\n")
    assert lines[0] == "name,K [N*m/rad]"
    assert lines[3:6] == ["of –,", "of −3.5,-3.5", "of 1.5·10⁻⁵,1.5e-5"]
    assert lines[7] == '"of x, ""y""","x, ""y"""'
    assert without.split("\r\n")[:2] == ["name", "of 10"]


def test_a_downloaded_table_has_the_numbers_of_the_results_in_full(page, results, tmp_path):
    allowed = {"behavior": "allow", "downloadPath": str(tmp_path)}
    page.execute_cdp_cmd("Browser.setDownloadBehavior", allowed)
    page.find_element(By.ID, "search").send_keys("impedance_")
    button = page.find_element(By.CSS_SELECTOR, "#trials .csv")
    page.execute_script("arguments[0].click()", button)
    wait(page, lambda: (tmp_path / "trials.csv").exists())

    downloaded = pl.read_csv(tmp_path / "trials.csv", infer_schema_length=None).sort("Trial")

    fits = read_table(results / "tables/impedance.csv").filter(pl.col("amplitude_deg").is_null())
    fits = fits.sort("trial")
    assert downloaded["Trial"].to_list() == fits["trial"].to_list()
    for column in ("K", "K_low", "K_high"):
        assert downloaded[f"{column} [N*m/rad]"].to_list() == fits[column].to_list()
    assert downloaded["B_high [N*m*s/rad]"].to_list() == fits["B_high"].to_list()


def test_a_column_is_hidden_by_its_check_box(page):
    fold = page.find_element(By.CSS_SELECTOR, "#trials .table-tools details")
    page.execute_script("arguments[0].open = true", fold)
    (box,) = [
        label.find_element(By.TAG_NAME, "input")
        for label in fold.find_elements(By.TAG_NAME, "label")
        if label.text == "Condition"
    ]
    condition = page.find_element(By.CSS_SELECTOR, "#table tbody tr td:nth-child(5)")

    page.execute_script("arguments[0].click()", box)
    assert not condition.is_displayed()
    page.execute_script("arguments[0].click()", box)
    assert condition.is_displayed()


SMALLEST_ON_PAPER_PT = 8
SMALL_TEXTS = """
const small = [];
for (const one of document.querySelectorAll("#overview *, header *")) {
  const hasText = [...one.childNodes].some((node) => node.nodeType === 3 && node.data.trim());
  const isShown = one.checkVisibility() && one.getBoundingClientRect().width;
  if (!hasText || !isShown || one.closest("svg") || one.tagName === "OPTION") continue;
  const size_pt = 0.75 * parseFloat(getComputedStyle(one).fontSize);
  if (size_pt < arguments[0]) small.push([one.textContent.trim().slice(0, 30), size_pt]);
}
return small;
"""
FIGURE_SCALES = """
const figures = [...document.querySelectorAll("figure svg")];
const scale = (svg) => 0.75 * svg.getBoundingClientRect().width / svg.viewBox.baseVal.width;
return figures.map(scale);
"""


def screen(page, width, height):
    size = {"width": width, "height": height, "deviceScaleFactor": 1, "mobile": width < 500}
    page.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", size)


def test_on_paper_no_text_is_smaller_than_eight_points_and_no_figure_than_its_own_size(page):
    screen(page, 703, 1000)  # A4 less its margins
    page.execute_cdp_cmd("Emulation.setEmulatedMedia", {"media": "print", "features": []})

    small = page.execute_script(SMALL_TEXTS, SMALLEST_ON_PAPER_PT - 0.01)
    scales = page.execute_script(FIGURE_SCALES)

    page.execute_cdp_cmd("Emulation.setEmulatedMedia", {"media": "", "features": []})
    assert small == []
    assert min(scales) >= 1, "a figure is drawn for its own size, with text of 8 pt"


LETTERS_OF_AXES = """
window.dispatchEvent(new Event("beforeprint"));
const root = Bokeh.documents[0].roots()[0];
const names = ["axis_label_text_font_size", "major_label_text_font_size"];
const letters = names.map((name) => parseFloat(root.left[0][name]));
const width = document.querySelector(".plots .on-paper").width / devicePixelRatio;
window.dispatchEvent(new Event("afterprint"));
return [...letters, width, parseFloat(root.left[0].major_label_text_font_size)];
"""


def test_on_paper_the_letters_of_a_trial_s_axes_have_seven_points(page):
    page.execute_script("location.hash = 'trial=impedance_K300_B5.0_compensated'")
    wait(page, lambda: page.execute_script("return Bokeh.documents.length"))

    *letters, width, afterwards = page.execute_script(LETTERS_OF_AXES)

    on_paper_pt = min(letters) * 680 / width * 72 / 96  # 680 px: A4 less its margins
    assert on_paper_pt >= 7
    assert afterwards == 11, "those of the screen are as before"


def test_the_header_leaves_a_phone_its_screen(page):
    screen(page, 360, 740)

    header = page.find_element(By.TAG_NAME, "header")
    height = header.size["height"]
    page.execute_script("window.scrollTo(0, 2000)")
    bottom = page.execute_script("return arguments[0].getBoundingClientRect().bottom", header)

    assert height <= 48
    assert bottom <= 48


def test_on_paper_the_table_of_trials_names_the_causes_of_doubt(page):
    page.execute_cdp_cmd("Emulation.setEmulatedMedia", {"media": "print", "features": []})
    doubted = [
        row for row in page.find_elements(By.CSS_SELECTOR, "#table tbody tr") if row.is_displayed()
    ]
    said = {
        row.get_attribute("data-verdict"): row.find_element(By.CSS_SELECTOR, "td.doubt").text
        for row in doubted
    }
    page.execute_cdp_cmd("Emulation.setEmulatedMedia", {"media": "", "features": []})
    assert "clear" not in said
    assert all(
        said[verdict] for verdict in ("doubtful", "doubtful in part", "flagged") if verdict in said
    )
    assert {*said} & {"doubtful", "doubtful in part", "flagged"}


def test_it_filters_by_words_and_verdict_and_says_why_a_trial_was_left_out(page):
    page.find_element(By.ID, "search").send_keys("belt_0")
    assert visible(page) == ["belt_02", "belt_01"], "clear ones last"
    page.find_element(By.CSS_SELECTOR, "#filters button[type=reset]").click()
    wait(page, lambda: len(visible(page)) > 10)
    page.execute_script("window.scrollTo(0, 0)")
    page.find_element(By.CSS_SELECTOR, '.count[data-verdict="refused"]').click()
    assert (visible(page), page.find_element(By.CSS_SELECTOR, "#left-out tbody tr th").text) == (
        ["belt_02"],
        "belt_02",
    )
    page.execute_script("location.hash = '#trial=belt_02'")
    wait(page, lambda: "refused" in page.find_element(By.ID, "trial").text)
    assert "belt_02.mcap" in page.find_element(By.ID, "trial").text, "it says why"


@pytest.mark.parametrize("kind", KINDS)
def test_it_opens_a_trial_of_every_kind_and_draws_it(page, kind):
    row = page.find_element(
        By.CSS_SELECTOR, f'#table tr[data-experiment="{kind}"]:not([data-verdict="refused"])'
    )
    name = row.get_attribute("data-name")
    link = row.find_element(By.TAG_NAME, "a")
    for _ in range(2):  # rows that come into sight are laid out, which moves those below
        page.execute_script("arguments[0].scrollIntoView({block: 'center'})", link)
    wait(
        page,
        lambda: (
            100 < page.execute_script("return arguments[0].getBoundingClientRect().y", link) < 700
        ),
    )
    link.click()
    wait(page, lambda: page.find_element(By.ID, "trial").get_attribute("data-drawn") == name)
    boxes = page.find_elements(By.CSS_SELECTOR, '#trial .plot [role="img"]')
    assert len(boxes) >= 2
    assert all(box.size["height"] > 150 for box in boxes)
    assert not [box for box in boxes if "no values" in box.get_attribute("aria-label")]
    assert {"Quality", "Provenance", "SHA-256"} <= set(
        page.find_element(By.ID, "trial").text.split()
    )


def test_the_numbers_and_signals_of_a_trial_are_those_of_the_results(page, results):
    name = "impedance_K300_B5.0_compensated"
    open_trial(page, name)
    table = read_table(results / "tables/impedance.csv").filter(pl.col("trial") == name)
    lines = page.find_elements(By.CSS_SELECTOR, "#trial section:not(.judged) table tbody tr")[
        : len(table)
    ]
    for row, line in zip(table.iter_rows(named=True), lines, strict=True):
        cells = [cell.text for cell in line.find_elements(By.CSS_SELECTOR, "th, td")]
        assert cells[0] == ("all" if row["amplitude_deg"] is None else f"{row['amplitude_deg']:g}")
        for quantity, cell in zip(("K", "B", "I"), cells[1:4], strict=True):
            value, low, high = (float(part.strip("[],")) for part in cell.replace("−", "-").split())
            half = (row[f"{quantity}_high"] - row[f"{quantity}_low"]) / 2
            for shown, true in (
                (value, row[quantity]),
                (low, row[f"{quantity}_low"]),
                (high, row[f"{quantity}_high"]),
            ):
                # four digits
                assert shown == pytest.approx(true, abs=max(0.06 * half, 5e-4 * abs(row[quantity])))
    series = read_table(results / f"fits/impedance/{name}.zip", name="series")
    label = page.find_element(By.CSS_SELECTOR, '#trial .plot [role="img"]').get_attribute(
        "aria-label"
    )
    low, high = re.search(r"measured from (\S+) to (\S+);", label).groups()
    assert (float(low), float(high)) == pytest.approx(
        (series["torque"].min(), series["torque"].max()), rel=5e-3
    )


POINT_AT = """
const [box, share] = arguments, { left, top, width, height } = box.getBoundingClientRect();
const at = { clientX: left + share * width, clientY: top + height / 2 };
box.dispatchEvent(new PointerEvent("pointermove", at));
return box.querySelector(".reading").innerText.split("\\n");
"""


def numbers_in(text):
    return [float(one) for one in re.findall(r"-?\d+\.?\d*(?:e-?\d+)?", text.replace("−", "-"))]


def test_pointing_at_a_signal_shows_its_sample_with_units(page, results):
    name = "impedance_K300_B5.0_compensated"
    series = read_table(results / f"fits/impedance/{name}.zip", name="series")
    open_trial(page, name)
    torque = page.find_element(By.CSS_SELECTOR, "#trial .readable")

    place, measured, *_ = page.execute_script(POINT_AT, torque, 0.6)

    assert re.fullmatch(r"Time \S+ s", place)
    assert re.fullmatch(r"measured: \S+ N·m", measured)
    (time,), (value,) = numbers_in(place), numbers_in(measured)
    near = series.filter((pl.col("time") - time).abs() < 0.06)["torque"]
    assert near.min() - 1e-3 <= value <= near.max() + 1e-3


def test_a_point_is_read_with_its_interval_and_a_loop_with_its_time(page, results):
    name = "impedance_K300_B5.0_compensated"
    phasors = read_table(results / "tables/phasors.csv").filter(pl.col("trial") == name)
    open_trial(page, name)
    loop, magnitude = page.find_elements(By.CSS_SELECTOR, "#trial .pairs .readable")[:2]
    page.execute_script("arguments[0].focus()", magnitude)

    in_loop = page.execute_script(POINT_AT, loop, 0.5)
    magnitude.send_keys(Keys.HOME)
    at_point = magnitude.find_element(By.CSS_SELECTOR, ".reading").text.split("\n")

    assert re.fullmatch(r"Joint angle \S+ deg, at \S+ s", in_loop[0])
    frequency = numbers_in(at_point[0])[0]
    assert frequency == pytest.approx(phasors["frequency_hz"].min(), rel=2e-3)
    for row in phasors.filter(pl.col("frequency_hz") == phasors["frequency_hz"].min()).to_dicts():
        (said,) = [text for text in at_point if text.startswith(f"{row['amplitude_deg']:g} deg: ")]
        assert said.endswith("] rad/(N·m)")
        shown = numbers_in(said.partition(": ")[2])
        true = [row[f"Y_magnitude{end}"] for end in ("", "_low", "_high")]
        assert shown == pytest.approx(true, rel=2e-3)


def test_a_point_of_a_figure_says_the_numbers_of_its_trial(page):
    say = """
    const link = document.querySelector("#figure-fig5 a");
    link.firstElementChild.dispatchEvent(new MouseEvent("mouseover", { bubbles: true }));
    return link.querySelector("title").textContent.split("\\n");
    """

    name, *numbers = page.execute_script(say)

    row = page.find_element(By.CSS_SELECTOR, f'#table tr[data-name="{name}"]')
    value = row.find_element(By.CSS_SELECTOR, '[data-of="K"]').get_attribute("textContent")
    assert f"K {value} N·m/rad" in numbers


def test_the_arrow_keys_step_through_a_signal_and_do_not_leave_the_trial(page):
    name = "impedance_K300_B5.0_compensated"
    open_trial(page, name)
    torque = page.find_element(By.CSS_SELECTOR, "#trial .readable")
    page.execute_script("arguments[0].focus()", torque)
    reading = torque.find_element(By.CSS_SELECTOR, ".reading")

    times = []
    for key in (Keys.HOME, Keys.ARROW_RIGHT, Keys.END, Keys.ARROW_LEFT):
        torque.send_keys(key)
        times += numbers_in(reading.text.split("\n")[0])

    first, second, last, before_last = times
    assert first < second < before_last < last
    assert page.find_element(By.ID, "trial").get_attribute("data-name") == name


DRAWN_SAMPLES = """
const loop = Bokeh.documents[0].roots().find((plot) => plot.height === 420);
const source = loop.renderers[0].data_source;
const chosen = [];
source.data.torque.forEach((torque, k) => { if (!Number.isNaN(torque)) chosen.push(k); });
return chosen;
"""


def test_the_loop_of_one_frequency_and_amplitude_is_drawn_alone(page, results):
    name = "impedance_K300_B5.0_compensated"
    series = read_table(results / f"fits/impedance/{name}.zip", name="series")
    phasors = read_table(results / "tables/phasors.csv").filter(pl.col("trial") == name)
    step = phasors.sort("amplitude_deg", "frequency_hz").row(-1, named=True)
    open_trial(page, name)
    amplitude, frequency = page.find_elements(By.CSS_SELECTOR, "#trial .loop-choice select")
    before = len(page.execute_script(DRAWN_SAMPLES))

    Select(amplitude).select_by_visible_text(f"{step['amplitude_deg']:g} deg")
    Select(frequency).select_by_visible_text(f"{step['frequency_hz']:.3g} Hz")

    chosen = page.execute_script(DRAWN_SAMPLES)
    assert 0 < len(chosen) < before / 2
    angle = series["theta_deg"].to_numpy()[chosen]
    time = series["time"].to_numpy()[chosen]
    assert np.abs(angle).max() == pytest.approx(step["amplitude_deg"], rel=0.15)
    crossings_of_zero = np.count_nonzero(np.diff(np.sign(angle)))
    crossings_in_step = 2 * step["frequency_hz"] * (time[-1] - time[0])
    assert crossings_of_zero == pytest.approx(crossings_in_step, rel=0.15)


def test_a_deep_link_opens_its_trial_and_an_unknown_one_says_so(page, results):
    open_page(page, "about:blank")
    open_page(page, f"{(results / 'report.html').as_uri()}#trial=walking_01")
    wait(
        page, lambda: page.find_element(By.ID, "trial").get_attribute("data-drawn") == "walking_01"
    )
    page.execute_script("location.hash = '#trial=%3Cb%3Enobody'")
    wait(page, lambda: "No such trial" in page.find_element(By.ID, "trial").text)
    assert "<b>nobody" in page.find_element(By.ID, "trial").text


@pytest.mark.parametrize("figure", ["fig5", "fig6", "fig7", "fig9"])
def test_a_point_of_a_figure_opens_its_trial(page, figure):
    links = page.find_elements(By.CSS_SELECTOR, f"#figure-{figure} a")
    names = {
        row.get_attribute("data-name")
        for row in page.find_elements(By.CSS_SELECTOR, "#table tbody tr")
    }
    targets = page.execute_script(
        "return arguments[0].map((link) => link.href.baseVal.slice('#trial='.length))", links
    )
    assert targets
    assert set(targets) <= names
    page.execute_script(
        "arguments[0].dispatchEvent(new MouseEvent('click', {bubbles: true}))", links[0]
    )
    wait(page, lambda: page.find_element(By.ID, "trial").get_attribute("data-drawn") == targets[0])
