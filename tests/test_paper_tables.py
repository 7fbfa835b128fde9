"""The tables for a paper: K, B and I of each condition, and the components."""

import re

import polars as pl
import pytest

from osl_analysis.report.paper_tables import (
    components_table,
    conditions_table,
    table_format,
    walking_table,
)

ORIGIN = "Measured data: campaign test"


def fits(*rows):
    """Rows of `impedance.csv`; what a row does not name is that of the first trial."""
    first = {
        "trial": "a",
        "joint": "ankle",
        "amplitude_deg": None,
        "controller": "compensated",
        "K_d": 300.0,
        "B_d": 5.0,
        "K": 297.0,
        "K_low": 295.0,
        "K_high": 299.0,
        "B": 5.4,
        "B_low": 5.2,
        "B_high": 5.6,
        "B_viscous": None,
        "I": -0.0241,
        "I_low": -0.0318,
        "I_high": -0.0165,
        "VAF": 99.46,
        "doubtful": "",
    }
    return pl.DataFrame([{**first, **row} for row in rows], infer_schema_length=None)


def markdown_cells(table):
    """Rows of cells, the head first."""
    lines = [line for line in table.to_markdown(ORIGIN).splitlines() if line.startswith("|")]
    rows = [[cell.strip() for cell in line.strip("|").split("|")] for line in lines]
    return [rows[0], *rows[2:]]


def test_a_row_has_estimates_of_all_amplitudes_rounded_by_their_intervals():
    table = conditions_table(fits({}, {"amplitude_deg": 2.0, "K": 1.0}))

    head, *rows = markdown_cells(table)

    assert head == [
        "controller",
        "K_d [N·m/rad]",
        "B_d [N·m·s/rad]",
        "n",
        "K [N·m/rad]",
        "B [N·m·s/rad]",
        "I [10⁻³ kg·m²]",
        "VAF [%]",
    ]
    assert rows == [
        [
            "compensated",
            "300",
            "5",
            "1",
            "297.0 ± 2.0",
            "5.40 ± 0.20",
            "-24.1 ± 7.7",
            "99.46",
        ]
    ]


def test_an_interval_that_is_not_even_has_its_ends_in_brackets():
    table = conditions_table(fits({"K_low": 290.0}))

    assert markdown_cells(table)[1][4] == "297.0 [290.0, 299.0]"
    assert r"297.0 & [\num{290.0}, \num{299.0}] &" in table.to_tex(ORIGIN)


def test_a_column_writes_all_intervals_alike():
    table = conditions_table(fits({"K_low": 290.0}, {"trial": "b", "K_d": 100.0}))

    rows = markdown_cells(table)[1:]

    assert {row[4] for row in rows} == {"297.0 [290.0, 299.0]", "297.0 [295.0, 299.0]"}
    assert {row[5] for row in rows} == {"5.40 ± 0.20"}


def test_a_variance_that_is_nearly_accounted_for_is_not_all_of_it():
    assert markdown_cells(conditions_table(fits({"VAF": 99.987})))[1][7] == "99.99"


def test_trials_of_one_condition_are_one_row_with_their_mean():
    table = conditions_table(fits({}, {"trial": "b", "K": 301.0}, {"trial": "c", "K_d": 100.0}))

    rows = markdown_cells(table)[1:]

    assert [row[1:4:2] for row in rows] == [["100", "1"], ["300", "2"]]
    assert rows[1][4].startswith("299")
    assert "95 % for another motion of this kind, 95 % of the mean (Student)" in table.notes[0]


@pytest.mark.parametrize(
    ("method", "kind"),
    [
        ("units", "for another motion of this kind"),
        ("repeats", "for a repetition of this motion"),
        ("white noise", "of this recording's noise"),
    ],
)
def test_it_is_said_for_what_an_interval_holds(method, kind):
    table = conditions_table(fits({"interval_method": method}))

    assert table.notes == [f"n: trials. Intervals, ± or in brackets: 95 % {kind}."]


def test_trials_of_other_motions_have_no_common_mean():
    motions = ({"excitation": "stepped sine"}, {"trial": "b", "excitation": "chirp"})

    rows = markdown_cells(conditions_table(fits(*motions)))

    assert [row[1] for row in rows] == ["excitation", "stepped sine", "chirp"]


def test_trials_without_a_stated_impedance_are_named():
    nothing = {"controller": None, "K_d": None, "B_d": None}

    rows = markdown_cells(conditions_table(fits(nothing, {"trial": "b_1", **nothing})))

    assert [row[:2] for row in rows] == [["trial", "n"], ["a", "1"], ["b_1", "1"]]


def test_a_doubtful_fit_is_marked_and_explained():
    table = conditions_table(fits({"doubtful": "friction"}, {"trial": "b", "K_d": 100.0}))

    assert [row[3] for row in markdown_cells(table)[1:]] == ["1", "1†"]
    assert "†: with a doubtful fit." in table.to_markdown(ORIGIN)
    assert r"& 1$^\dagger$ &" in table.to_tex(ORIGIN)


def test_a_doubtful_trial_leaves_the_mean_as_everywhere():
    table = conditions_table(fits({}, {"trial": "b", "K": 200.0, "doubtful": "late torque"}))

    (row,) = markdown_cells(table)[1:]

    assert (row[3], row[4]) == ("1", "297.0 ± 2.0")


def test_latex_has_as_many_cells_in_each_row_as_columns_and_says_where_it_is_from():
    tex = conditions_table(fits({}, {"trial": "b_1", "controller": "50 %"})).to_tex(ORIGIN)

    assert (r"\multicolumn{10}{l}{\itshape 50 \%} \\" + "\n300 & 5 & 1 &") in tex
    (formats,) = re.findall(r"\\begin\{tabular\}\{(.*)\}", tex)
    columns = len(re.findall(r"S\[|(?<![A-Za-z])l\b", formats))
    head, units, *rows = [line for line in tex.splitlines() if line.endswith(r"\\")]
    rows = [row for row in rows if "itshape" not in row]
    wide = head.count(r"\multicolumn{2}")
    assert head.count("&") + 1 + wide == columns
    assert units.count("&") == head.count("&")
    assert r"(\num{e-3} \unit{\kilogram\meter\squared})" in units
    assert {row.count("&") + 1 for row in rows} == {columns}
    assert r"& -24.1 & $\pm$ \num{7.7} &" in rows[0]
    assert tex.startswith(f"% {ORIGIN}\n")


@pytest.mark.parametrize(
    ("values", "expected"),
    [
        (["1", "300"], "3.0"),
        (["-0.02", "1.5"], "-1.2"),
        (["{--}", "12.345"], "2.3"),
        (["3.0e-05", "1"], "1.1e-1"),
    ],
)
def test_the_format_of_a_column_holds_its_longest_number(values, expected):
    assert table_format(values) == expected


def summary(**means):
    rows = [
        {"joint": "ankle", "quantity": name, "n": 3, "mean": mean, "low": low, "high": high}
        for name, (mean, low, high) in means.items()
    ]
    return pl.DataFrame(rows)


def test_components_stand_beside_the_values_of_the_draft():
    belt = summary(K_s=(684.4, 679.5, 689.2), hysteresis_area=(0.045, 0.044, 0.046))
    summaries = {"belt_summary": belt, "actuator_summary": summary(f_C=(0.3772, 0.3763, 0.3781))}

    table = components_table(summaries, beside_draft=True)

    assert markdown_cells(table) == [
        ["parameter", "value", "n", "draft"],
        ["K_s [N·m/rad]", "684.4 ± 4.9", "3", "685.6"],
        ["f_C [N·m]", "0.3772 ± 0.0009", "3", "0.377"],
    ]
    assert r"$f_\mathrm{C}$ / \unit{\newton\meter} & 0.3772 & " in table.to_tex(ORIGIN)


def test_components_of_another_device_stand_alone():
    table = components_table({"belt_summary": summary(K_s=(300.0, None, None))}, False)

    assert markdown_cells(table) == [
        ["parameter", "value", "n"],
        ["K_s [N·m/rad]", "300", "3"],
    ]


def test_each_group_of_crossings_is_a_row_by_all_perturbations_together():
    def of(group, quantity, mean, estimator="ensemble", doubt=""):
        return {
            "group": group, "joint": "ankle", "side": "right", "quantity": quantity, "n": 30,
            "estimator": estimator, "mean": mean, "low": 0.9 * mean, "high": 1.1 * mean,
            "doubt": doubt,
        }  # fmt: skip

    summary = pl.DataFrame([
        of("slow", "K", 300.0, doubt="friction"), of("slow", "I", 0.02),
        of("slow", "K", 310.0, "mean of perturbations"), of("fast", "K", 400.0),
    ])  # fmt: skip

    assert markdown_cells(walking_table(summary)) == [
        ["group", "n", "K [N·m/rad]", "I [10⁻³ kg·m²]"],
        ["slow", "30†", "300 ± 30", "20.0 ± 2.0"],
        ["fast", "30", "400 ± 40", "–"],
    ]
