"""Headline numbers, the tables for a paper and the page: what they say of result tables that are
written here by hand."""

import json
import math
from types import SimpleNamespace

import pandas as pd
import polars as pl
import pytest

from osl_analysis.judge.finding import Finding, WordedFinding, Words
from osl_analysis.report import paper_tables
from osl_analysis.report.brief import brief_lines
from osl_analysis.report.left_out import LeftOut
from osl_analysis.report.numbers import ENTRIES, headline_numbers, macro_name, to_json, to_tex
from osl_analysis.report.page import Page, ShownFigure, trials_table, written_page
from osl_analysis.report.rounding import written

ABOUT = dict.fromkeys(("campaign", "data", "version", "configuration", "recorded"), "x")
IMPEDANCE = pl.DataFrame(
    {
        "trial": ["a", "a", "b", "c"],
        "controller": ["PD 1"] * 4,
        "K_d": [100.0, 100.0, 200.0, 200.0],
        "B_d": [0.0, 0.0, 5.0, 5.0],
        "amplitude_deg": [2.0, None, None, None],
        "K": [90.0, 101.0, 202.0, 206.0],
        "K_low": [80.0, 99.0, 200.0, 205.0],
        "K_high": [100.0, 103.0, 204.0, 207.0],
        "B": [0.1, 0.2, 5.3, 5.5],
        "B_viscous": [None, None, 5.1, None],
        "VAF": [97.0, 98.0, 99.0, 99.5],
        "doubtful": ["", "", "", "friction"],
        "interval_method": ["repeats"] * 4,
    }
)


def numbers_of(**tables: pl.DataFrame) -> dict[str, SimpleNamespace]:
    return {number.name: number for number in headline_numbers(tables)}


def test_a_mean_over_trials_leaves_out_amplitudes_and_the_doubtful_trial_beside_sound_ones():
    bias = numbers_of(impedance=IMPEDANCE)["K_bias_PD_1"]

    assert bias.value == pytest.approx((1 + 1) / 2)  # of a and b, in percent
    assert (bias.n, bias.n_doubtful, bias.n_left_out) == (2, 1, 1)


def test_the_error_of_the_damping_is_without_friction_where_this_is_certain():
    assert numbers_of(impedance=IMPEDANCE)["B_error_PD_1"].value == pytest.approx((0.2 + 0.1) / 2)


def test_one_trial_has_its_own_interval_and_several_have_the_range_of_their_values():
    numbers = numbers_of(impedance=IMPEDANCE.with_columns(doubtful=pl.lit("")))

    one, several = numbers["K_PD_1_K_d_100_B_d_0"], numbers["K_PD_1_K_d_200_B_d_5"]
    assert (one.value, one.low, one.high, one.interval) == (101, 99, 103, "repeats")
    assert (several.value, several.low, several.high) == (204, 202, 206)
    assert several.interval == "lowest to highest"


def test_a_mean_of_a_summary_keeps_interval_and_number_and_stands_beside_the_draft():
    belt = pl.DataFrame(
        {"quantity": ["K_s"], "mean": [690.0], "low": [680.0], "high": [700.0], "n": [10]}
    )

    (number,) = headline_numbers({"belt_summary": belt})
    assert (number.value, number.low, number.high, number.n) == (690, 680, 700, 10)
    assert number.draft == 685.6
    assert next(headline_numbers({"belt_summary": belt}, beside_draft=False)).draft is None


def test_two_joints_have_numbers_of_their_own():
    belt = pl.DataFrame(
        {
            "quantity": ["K_s"] * 2, "mean": [1.0, 2.0], "low": [None] * 2, "high": [None] * 2,
            "joint": ["ankle", "knee"],
        }
    )  # fmt: skip

    assert [*numbers_of(belt_summary=belt)] == ["K_s_ankle", "K_s_knee"]


def test_a_number_that_is_not_finite_is_none():
    table = pl.DataFrame({"VAF": [math.nan], "K": [1.0], "K_measured": [0.0]})

    assert [*headline_numbers({"prediction": table})] == []


def test_every_claim_has_its_verdict():
    claims = pl.DataFrame(
        {
            "name": ["K_ok", "of_a"], "subject": [None, "a"], "value": [1.0, 2.0],
            "low": [0.5, 1.0], "high": [1.5, 3.0], "interval": ["95 %"] * 2, "unit": ["%"] * 2,
            "claim": ["K is right"] * 2, "quantity": ["error"] * 2, "verdict": ["holds"] * 2,
        }
    )  # fmt: skip

    (number,) = headline_numbers({"claims": claims})
    assert (number.name, number.unit, number.verdict) == ("K_ok", "%", "holds")


def test_a_summary_is_json_with_every_number_in_full():
    content = json.loads(to_json(ABOUT, headline_numbers({"impedance": IMPEDANCE}), {"n": 1}))

    assert content["n"] == 1
    assert content["numbers"]["K_PD_1_K_d_100_B_d_0"]["low"] == 99.0


def test_macros_are_letters_and_each_line_of_latex_is_a_definition_or_a_comment():
    tex = to_tex(ABOUT, headline_numbers({"impedance": IMPEDANCE}))

    assert macro_name("K_d 200") == "KDTwoZeroZero"
    assert all(line.startswith(("%", r"\newcommand{\osl")) for line in tex.splitlines())
    assert r"\newcommand{\oslKPDOneKDOneZeroZeroBDZero}{\ensuremath{101.0}}" in tex


@pytest.mark.parametrize(
    ("value", "low", "high", "text"),
    [
        (300.123, 298.71, 301.62, "300.1 (298.7 to 301.6)"),
        (0.0312345, None, None, "0.0312"),
        (12345.0, 12000.0, 12700.0, "12345 (12000 to 12700)"),
        (0.0, 0.0, 0.0, "0 (0 to 0)"),
    ],
)
def test_a_number_is_rounded_to_two_digits_of_half_its_interval_or_to_three(value, low, high, text):
    assert written(value, low, high) == text


def test_conditions_are_rows_with_their_trial_or_the_mean_of_several():
    table = paper_tables.conditions_table(IMPEDANCE.with_columns(doubtful=pl.lit("")))

    assert table["K_d"].tolist() == ["100", "200"]
    assert table["n"].tolist() == ["1", "2"]
    assert table["K"][0] == "101.0 (99.0 to 103.0)"
    assert table["K"][1].startswith("204")


def test_latex_has_rules_and_escapes_what_users_write():
    table = pd.DataFrame({"controller": ["PD_1"], "K": ["101"]})

    tex = paper_tables.to_tex(table, "simulated")
    assert r"\toprule" in tex
    assert r"PD\_1" in tex
    assert r"\newton\meter\per\radian" in tex


def test_components_stand_beside_the_draft():
    belt = pl.DataFrame(
        {"quantity": ["K_s"], "mean": [690.0], "low": [680.0], "high": [700.0], "n": [10]}
    )

    table = paper_tables.components_table({"belt_summary": belt}, beside_draft=True)
    assert table.iloc[0].tolist() == ["K_s", "690 (680 to 700)", 10, "685.6"]


def trial_rows(*findings: Finding, left_out: dict[str, LeftOut] | None = None) -> pd.DataFrame:
    sheet = {"a": {"experiment": "impedance", "K_d": 100.0, "log": "a.csv"}}
    worded = [WordedFinding(finding, Words("", "", "")) for finding in findings]
    return trials_table(sheet, {"impedance": IMPEDANCE}, worded, left_out or {})


def test_a_trial_is_doubtful_by_the_findings_on_its_whole_fit():
    whole = Finding("friction", "impedance", "a")
    part = Finding("friction", "impedance", "a", amplitude_deg=2.0)

    assert trial_rows()["verdict"].tolist() == ["clear"]
    assert trial_rows(part)["verdict"].tolist() == ["doubtful in part"]
    assert trial_rows(part, whole)["verdict"].tolist() == ["doubtful"]
    assert trial_rows()["K"].tolist() == ["101.0 (99.0 to 103.0)"]


def test_a_trial_that_is_left_out_says_why():
    rows = trial_rows(left_out={"a": LeftOut(True, "x", ["no torque"])})

    assert rows[["verdict", "why"]].values.tolist() == [["left out", "no torque"]]


def test_the_page_shows_figures_without_other_files_and_escapes_names():
    page = Page(
        title="<b>", made_of="x", intervals="", numbers=[], findings=[],
        tables={"Trials": pd.DataFrame({"trial": ["<script>"]})},
        figures=[ShownFigure("fig5", "Fig. 5", "K & B", "line", b"<svg/>")], absent_figures={},
    )  # fmt: skip

    html = written_page(page)
    assert "&lt;b&gt;" in html
    assert "&lt;script&gt;" in html
    assert "K &amp; B" in html
    assert 'src="data:image/svg+xml;base64,PHN2Zy8+"' in html


def test_the_summary_in_the_terminal_has_trials_and_numbers():
    numbers = headline_numbers({"impedance": IMPEDANCE})
    summary = json.loads(to_json(ABOUT, numbers, {"findings": [], "trials": {}}))
    summary["trials"] = {"impedance": {"of": 3, "used": 2, "missing": {"c": "why"}}}

    lines = brief_lines(summary)
    assert lines[0] == "3 trials: 0 doubtful, 1 refused or excluded"
    assert lines[1].startswith("bench PD 1: K_bias_PD_1 1.00 (1.00 to 1.00) %, B_error_PD_1")


def test_every_number_is_of_a_table_that_the_dictionary_describes():
    from osl_analysis.dictionary import described_tables_by_name

    assert {entry.table for entry in ENTRIES} <= set(described_tables_by_name())
