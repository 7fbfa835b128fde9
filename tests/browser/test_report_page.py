# SPDX-License-Identifier: Apache-2.0
"""The page in headless Chromium: a bench trial, a crossing, and a trial without signals."""

import os
import shutil
from dataclasses import replace

import numpy as np
import polars as pl
import pytest
from page_builder import ROW, page, view
from selenium import webdriver
from selenium.webdriver.chrome.service import Service
from selenium.webdriver.common.by import By
from selenium.webdriver.support.ui import WebDriverWait

from osl_analysis.report.page import (
    trial_view,
    written_page,
)
from osl_analysis.report.paper_tables import Condition
from osl_analysis.report.trial_signals import (
    fit_signals,
    measured_response,
    recording_signals,
)
from osl_analysis.stats.rounding import printed_number

pytestmark = pytest.mark.browser
DRIVER = shutil.which("chromedriver")
ESTIMATES = {
    "K": printed_number(101.2, 99.2, 103.4),
    "B": printed_number(5.25, 5.05, 5.45),
    "I": printed_number(-0.125, -0.135, -0.115),
}


def trials():
    """A trial with a fit and a frequency response, one without a model, and one without signals."""
    time = np.linspace(0, 10, 2000)
    torque = 30 * np.sin(time)
    series = pl.DataFrame(
        {"time": time, "theta_deg": np.cos(time), "torque": torque, "torque_model": torque + 1}
    )
    measured = pl.DataFrame(
        {
            "amplitude_deg": [2.0, 2.0],
            "frequency_hz": [1.0, 5.0],
            "magnitude": [0.01, 0.02],
            "magnitude_low": [0.0098, 0.0198],
            "magnitude_high": [0.0102, 0.0202],
            "phase_deg": [0.0, -8.5],
        }
    )
    response = measured_response(measured, {"K": 100.0, "B": 2.0, "I": 0.1})
    fitted = fit_signals(series, "Joint angle")
    signals = {
        "fitted": replace(fitted, response=response),
        "crossing": recording_signals(pl.DataFrame({"time": time, "torque": torque}), ""),
        "unread": None,
    }
    for name, trial_signals in signals.items():
        yield trial_view({**ROW, "trial": name}, {}, [], None, trial_signals)


def written(folder):
    """A page of three conditions and four trials."""
    conditions = [
        Condition({"controller": "compensated", "K_d": K_d}, ["fitted"], 1, False, [], ESTIMATES)
        for K_d in ("200", "1000", "99.5")
    ]
    content = written_page(page(*trials(), view(), conditions=conditions))
    path = folder / "report.html"
    path.write_text(content, encoding="utf-8")
    return path.as_uri()


@pytest.fixture(scope="module")
def chromium():
    if DRIVER is None:
        pytest.fail(
            "no chromedriver: install Chromium and its driver (Debian: chromium, chromium-driver)"
        )
    os.environ.update(SE_OFFLINE="true", SE_AVOID_STATS="true")
    options = webdriver.ChromeOptions()
    for flag in ("headless=new", "no-sandbox", "disable-gpu", "disable-dev-shm-usage"):
        options.add_argument(f"--{flag}")
    options.set_capability("goog:loggingPrefs", {"browser": "ALL", "performance": "ALL"})
    driver = webdriver.Chrome(options=options, service=Service(DRIVER))
    yield driver
    driver.quit()


@pytest.fixture
def opened(chromium, tmp_path):
    """The page, with nothing in its console and on the network when a test is done with it."""
    address = written(tmp_path)
    chromium.get("about:blank")
    for log in ("browser", "performance"):
        chromium.get_log(log)
    chromium.get(address)
    yield chromium
    errors = [entry for entry in chromium.get_log("browser") if entry["level"] != "INFO"]
    sent = [entry["message"] for entry in chromium.get_log("performance")]
    requests = [text for text in sent if '"Network.requestWillBeSent"' in text]
    assert errors == []
    assert [text for text in requests if "report.html" not in text] == []


def open_trial(browser, name):
    """Go to a trial, and wait for its plots if it has some."""
    browser.execute_script("location.hash = '#trial=' + arguments[0]", name)


def lengths(browser):
    """The number of samples in the plots, and which panels are shown."""
    return browser.execute_script(
        "const [drawing] = Bokeh.documents; if (!drawing) return null;"
        "const source = drawing.get_model_by_name('signals');"
        "const panels = drawing.roots()[0].children;"
        "return [source.data.torque.length, panels.map((panel) => panel.visible)];"
    )


def test_a_chosen_trial_shows_its_signals_and_only_the_panels_that_it_has(opened):
    wait = WebDriverWait(opened, 20)

    open_trial(opened, "fitted")
    wait.until(lambda _: lengths(opened) == [2000, [True] * 6])
    height = opened.find_element(By.ID, "plots").size["height"]
    open_trial(opened, "crossing")
    wait.until(lambda _: lengths(opened) == [2000, [True] + [False] * 5])

    assert height > 1000
    assert not opened.find_element(By.TAG_NAME, "main").is_displayed()
    open_trial(opened, "unread")
    assert not opened.find_element(By.ID, "plots").is_displayed()


def column(browser, number):
    cells = browser.find_elements(By.CSS_SELECTOR, f".conditions td:nth-child({number})")
    return [cell.text for cell in cells]


def test_a_table_sorts_by_numbers_both_ways(opened):
    head = opened.find_elements(By.CSS_SELECTOR, ".conditions th")[1]

    head.click()
    upwards = column(opened, 2)
    head.click()

    assert upwards == ["99.5", "200", "1000"]
    assert column(opened, 2) == ["1000", "200", "99.5"]


def test_the_search_hides_trials_without_its_words(opened):
    opened.find_element(By.ID, "search").send_keys("CROSS")

    rows = opened.find_elements(By.CSS_SELECTOR, "#trials tbody tr")
    assert [row.text.split()[0] for row in rows if row.is_displayed()] == ["crossing"]


@pytest.mark.parametrize("address", ["", "#trial=fitted"])
def test_a_phone_does_not_scroll_sideways(opened, address):
    size = {"width": 400, "height": 800, "deviceScaleFactor": 1, "mobile": True}
    opened.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", size)

    opened.execute_script("location.hash = arguments[0]", address)
    if address:
        WebDriverWait(opened, 20).until(lambda _: lengths(opened))

    assert opened.execute_script("return document.documentElement.scrollWidth") <= 400
    opened.execute_cdp_cmd("Emulation.clearDeviceMetricsOverride", {})


def test_the_button_changes_light_and_dark(opened):
    ground = "return getComputedStyle(document.body).backgroundColor"
    before = opened.execute_script(ground)

    opened.find_element(By.ID, "colours").click()

    assert opened.execute_script(ground) != before
