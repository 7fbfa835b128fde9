# SPDX-License-Identifier: Apache-2.0
"""The page, its signals and the methods text: what they say of trials that are written here by
hand."""

import json
import re
import zlib
from base64 import b64decode
from dataclasses import replace

import numpy as np
import polars as pl
import pytest
from conftest import ROOT
from page_builder import ABOUT, PART, REMARK, ROW, WHOLE, page, view, worded

from osl_analysis.bench.bench_settings import NOT_STATED, Calibration
from osl_analysis.commands.report import plotted_signals, rates_of
from osl_analysis.dictionary.described import table_of
from osl_analysis.judge.findings import Finding
from osl_analysis.judge.joining import joined
from osl_analysis.report import methods
from osl_analysis.report.page import (
    inline_svg,
    trial_view,
    with_symbols,
    written_page,
)
from osl_analysis.report.paper_tables import Condition, interval_rows
from osl_analysis.report.trial_signals import (
    fit_signals,
    measured_response,
    recording_signals,
)
from osl_analysis.report.verdicts import (
    LeftOut,
    trials_without_result,
    verdict_counts,
    verdicts_sentence,
)
from osl_analysis.stats.budget import Budget, Contribution, budget_rows, scatter
from osl_analysis.stats.rounding import printed_number


@pytest.mark.parametrize(
    ("findings", "verdict"),
    [
        ((), "clear"),
        ((PART,), "doubtful in part"),
        ((PART, WHOLE), "doubtful"),
        ((replace(WHOLE, table="quality"),), "flagged"),
        ((replace(WHOLE, table="quality"), WHOLE), "doubtful"),
    ],
)
def test_a_trial_is_doubtful_by_the_findings_on_its_whole_fit(findings, verdict):
    assert view(*findings)["verdict"] == verdict


def test_a_trial_that_is_left_out_says_why():
    refused = view(WHOLE, left_out=LeftOut(True, ["no torque"]))

    assert (refused["verdict"], refused["left_out"]) == ("refused", ["no torque"])


PLACE = {"trial": ROW["trial"], "amplitude_deg": None}
PARTS = (
    scatter(3.0, 9.0),
    Contribution("torque_gain", 4.0, shared=True),
    Contribution("wrong_gain", None, part="fault", per="3 N*m/rad per %"),
)
BUDGET = table_of(budget_rows(PLACE, {"K": Budget(300.0, PARTS)}), "budget")


def test_an_estimate_has_verdict_parts_of_its_interval_and_unknowns():
    late = Finding("torque_path", "impedance", ROW["trial"], estimates=("K",))
    fit = joined(pl.DataFrame([{**PLACE, "K": 300.0}]), "impedance", [late])

    (shown,) = trial_view(ROW, {"impedance": fit, "budget": BUDGET}, [], None, None)["budgets"]

    assert shown["verdict"] == {"badge": "doubtful", "text": "torque path"}
    assert shown["not_known"] == "wrong gain: 3 N*m/rad per %"
    repeatability, bench = (2.262157 * 3) ** 2, (1.959964 * 4) ** 2  # Student's, by hand
    share = 100 * repeatability / (repeatability + bench)
    assert shown["parts"]["repeatability"] == pytest.approx(share, rel=1e-5)
    assert shown["parts"]["sensor"] == 0


def test_a_table_for_a_paper_has_the_parts_of_each_controller():
    ends = {"K_range_low": 290.0, "K_range_high": 306.0}
    impedance = pl.DataFrame([{"trial": ROW["trial"], "controller": "compensated", **ends}])

    head, (controller, name, n, *widths) = interval_rows(BUDGET, impedance, [])

    assert head[3:] == ["repeatability", "sensor", "bench", "all", "range", "mean of n"]
    assert (controller, name, n) == ("compensated", "K [N*m/rad]", "1")
    assert widths == ["6.8", "–", "7.8", "10", "8", "–"]
    assert interval_rows(BUDGET, pl.DataFrame(), [])[1][:2] == ["–", "K [N*m/rad]"]


def test_the_table_of_parts_has_the_mean_over_trials_beside_them():
    belt_budget = table_of(budget_rows(PLACE, {"K_s": Budget(684.0, PARTS)}), "budget")
    mean = pl.DataFrame([{"quantity": "K_s", "low": 679.5, "high": 689.3}])

    (_, row) = interval_rows(belt_budget, pl.DataFrame(), [mean])

    assert (row[1], row[-3], row[-1]) == ("K_s [N*m/rad]", "10", "4.9")


SHEET = {name: {**ROW, "trial": name} for name in "ab"}


def test_each_trial_counts_once():
    counts, _ = verdict_counts(SHEET, worded(WHOLE, PART), {})

    assert {verdict: n for verdict, n in counts.items() if n} == {"clear": 1, "doubtful": 1}


def test_friction_is_told_of_a_clear_trial_and_counted():
    counts = verdict_counts(SHEET, worded(REMARK), {})

    assert (view(REMARK)["verdict"], view(REMARK)["why"]) == ("clear", "friction")
    assert re.search("2 .*none doubtful.*friction in 1", verdicts_sentence(*counts))


def test_a_trial_has_a_row_of_estimates_per_fit_with_intervals_and_units():
    html = written_page(page(view()))

    table = html.partition("<h2>Estimates</h2>")[2].partition("</table>")[0]
    heads = re.findall("<th>(.*?)</th>", table)
    amplitude_row, trial_row = re.findall("<tr><td>(.*?)</td></tr>", table)
    assert (heads[0], heads[-1]) == ("amplitude [deg]", "VAF [%]")
    assert "N·m/rad" in heads[1]
    assert re.fullmatch("2<.*>90 .*80, 100.*>97", amplitude_row)
    assert re.fullmatch(r"all<.*>101\.0 .*99\.0, 103\.0.*>98", trial_row)


def test_the_page_escapes_names_and_asks_for_no_other_file():
    html = written_page(page(view(PART, WHOLE, REMARK, controller="<script>alert(1)</script>")))

    assert "&lt;b&gt;" in html
    assert "<script>alert" not in html
    assert re.findall(r"<(?:script|img|link)[^>]+(?:src|href)=", html) == []


def test_a_page_without_figures_and_conditions_has_no_empty_frame():
    html = written_page(page(view()))

    assert "<figure" not in html.partition("<script")[0]
    assert '<table class="sort conditions"' not in html


@pytest.mark.parametrize(
    ("shown", "model"),
    [
        (("conditions",), "Iα + offset + drift;"),
        (("groups",), "Iα;"),
        (("conditions", "groups"), "Iα + offset + drift (none while walking);"),
    ],
)
def test_the_page_has_the_offset_where_the_fit_has_it(shown, model):
    rows = [Condition({"controller": "PD"}, ["a"], 1, False, [], {"K": printed_number(300.0)})]

    assert model in written_page(page(view(), **dict.fromkeys(shown, rows)))


def test_inline_figures_have_names_of_their_own_and_links_to_trials():
    svg = (
        '<?xml?><svg><g id="a"/><use href="#a" clip-path="url(#a)"/>'
        '<a href="../report.html#trial=a"/></svg>'
    )

    drawing = inline_svg("fig5", "Fig. 5", svg)
    figure = {"name": "fig5", "title": "Fig. 5", "caption": "", "drawing": drawing}
    drawn = written_page(page(figures=[figure]))

    assert '<g id="fig5-a"/><use href="#fig5-a" clip-path="url(#fig5-a)"/>' in drawn
    assert '<a href="#trial=a"/>' in drawn


def test_symbols_are_set_in_html_and_names_from_files_are_not():
    assert with_symbols(r"$\hat{K}$, $K_d$ & <b>") == (
        "<i>K\u0302</i>, <i>K<sub>d</sub></i> &amp; &lt;b&gt;"
    )
    assert with_symbols(r"\$x_1\$") == "$x_1$"


def unpacked(packed):
    """What the page makes of packed signals."""
    changes = np.frombuffer(zlib.decompress(b64decode(packed["packed"])), "<i4")
    steps = np.cumsum(changes.reshape(len(packed["columns"]), -1), axis=1)
    values = {}
    for (name, (low, step)), column_steps in zip(packed["columns"].items(), steps, strict=True):
        values[name] = np.where(column_steps < 0, np.nan, low + step * column_steps)
    return values


def test_signals_survive_packing_to_a_thousandth_of_their_range():
    time = np.linspace(0, 10, 500)
    torque = 30 * np.sin(time)
    model = np.where(time < 5, torque - 0.1 * np.cos(time), np.nan)
    series = pl.DataFrame(
        {"time": time, "theta_deg": np.cos(time), "torque": torque, "torque_model": model}
    ).fill_nan(None)

    values = unpacked(fit_signals(series, "Joint angle").packed())

    assert values["time"] == pytest.approx(time, abs=1e-5)
    assert values["torque"] == pytest.approx(torque, abs=0.03)
    assert values["residual"] == pytest.approx(torque - model, abs=1e-4, nan_ok=True)


def test_a_crossing_that_was_excluded_shows_its_recording(tmp_path):
    recording = pl.DataFrame({"time": [1.0, 2.0], "theta": [0.0, np.pi]})
    recording.write_parquet(tmp_path / "trial.parquet")
    recording.clear().write_parquet(tmp_path / "crossing.parquet")
    recordings = [tmp_path / "crossing.parquet", tmp_path / "trial.parquet"]

    shown = plotted_signals({"trial": "w", "experiment": "walking"}, {}, None, recordings)

    assert shown.table.to_dict(as_series=False) == {"time": [0, 1], "motion": [0, 180]}


def test_the_model_of_a_response_is_equation_15():
    measured = {
        "amplitude_deg": 2.0,
        "frequency_hz": [1.0, 5.0],
        "magnitude": 0.01,
        "magnitude_low": 0.008,
        "magnitude_high": 0.012,
        "phase_deg": 0.0,
    }
    response = measured_response(pl.DataFrame(measured), {"K": 100.0, "B": 2.0, "I": 0.1})

    at_5_hz = response.row(-1, named=True)
    s = 10j * np.pi
    Y = 1 / (100 + 2 * s + 0.1 * s**2)
    assert at_5_hz["model_magnitude"] == pytest.approx(abs(Y), rel=1e-4)
    assert at_5_hz["model_phase"] == pytest.approx(np.rad2deg(np.angle(Y)), rel=1e-4)


UNCERTAIN = Calibration(torque_gain=0.01, delay=1e-4).model_dump()
SETTINGS = {
    "dynamometer": {
        "order": 4,
        "cutoff_hz": 15.0,
        "bench_stiffness": None,
        "fixture": None,
        "settle_cycles": 2,
        "calibration": NOT_STATED.model_dump(),
        "load_cell_drift": 0.05,
    },
    "torque_angle": {
        "order": 4,
        "cutoff_hz": 15.0,
        "bench_stiffness": {"value": "12000 N*m/rad"},
        "calibration": UNCERTAIN,
        "zero": "start",
        "rest_s": 1.0,
    },
    "parameters": None,
    "walking": {"correct_plate_lag": True, "baseline": "mean"},
}


def paragraphs(sheet=(ROW,), **tables):
    summary = {
        "trials": {},
        "verdicts": {"clear": 1},
        "findings": [],
        "digest": "d1",
        "changed": [],
    }
    return methods.paragraphs(methods.MethodsFacts(ABOUT, SETTINGS, tables, sheet, summary, {}))


@pytest.mark.parametrize(
    ("tables", "fact"),
    [
        (
            {"timebase": {"signals": ["theta", "torque"], "delay_s": [0.0, 0.002]}},
            "torque 0.002 s",
        ),
        ({"torque_angle": {"K": [40.0], "cycles": [3]}}, "12000 N·m/rad"),
        (
            {"torque_angle": {"K": [40.0], "cycles": [3]}},
            "1 % of the torque's gain, 0.1 ms of the torque's delay",
        ),
        ({"impedance": {"K_d": [100.0, 200.0, 100.0]}}, "100 and 200 N·m/rad"),
        ({"walking_groups": {"plate_lag_s": [-0.00001239]}}, "-0.0000124 s"),
        ({"impedance": {"excitation": ["periodic"]}}, "whole periods"),
    ],
)
def test_a_sentence_of_the_methods_is_printed_where_its_fact_is_recorded(tables, fact):
    recorded = {name: pl.DataFrame(columns) for name, columns in tables.items()}

    assert fact in " ".join(paragraphs(**recorded))
    assert fact not in " ".join(paragraphs())


def test_the_methods_have_the_rates_of_markers_and_plate(tmp_path):
    time = np.arange(0, 2, 1 / 1500)
    force = pl.DataFrame({"time": time, "plate1_force_z": 1.0})
    markers = pl.DataFrame({"time": time[::5], "marker_FOOT1_x": 1.0})
    both = force.join(markers, on="time", how="left")
    both.write_parquet(tmp_path / "w.parquet")

    assert rates_of(tmp_path / "w.parquet") == {"markers": "300", "the force plate": "1500"}


def test_the_methods_say_nothing_of_experiments_that_the_campaign_has_not():
    text = " ".join(paragraphs())

    for absent in ("belt", "walkway", "actuator", "transmission", "predicted"):
        assert absent not in text


def test_the_methods_in_latex_escape_words_and_keep_symbols_and_citations():
    tex = methods.to_tex(["A_b is 5 % of $K_\\mathrm{d}$ [@polars]."])

    assert tex.endswith("A\\_b is 5 \\% of $K_\\mathrm{d}$~\\cite{polars}.\n")


def test_everything_that_the_methods_cite_is_in_their_bibliography():
    template = (ROOT / "osl_analysis/report/templates/methods.j2").read_text()
    cited = set(methods.CITATION.findall(template)) - {"key"}

    assert len(cited) >= 5
    for key in cited:
        assert f"{{{key},\n" in methods.BIBTEX
        assert ".." not in methods.reference(key)


def test_the_signals_of_a_page_are_valid_json():
    signals = recording_signals(pl.DataFrame({"time": [0.0], "torque": 1.0}), "")

    html = written_page(page(trial_view(ROW, {}, [], None, signals)))

    (data,) = re.findall(r"const trials = (\{.*\}), plots =", html)
    assert json.loads(data)["a"]["columns"].keys() == {"time", "torque"}


def test_a_perturbed_crossing_without_its_fit_has_no_result():
    sheet = {"w": {"experiment": "walking", "perturbed": True}}
    crossings = pl.DataFrame({"trial": ["w"], "reason": [None]})

    assert trials_without_result(sheet, {"walking_crossings": crossings}) == ["w"]
