# SPDX-License-Identifier: Apache-2.0
"""Headline numbers and the tables for a paper: what they say of result tables that are written here
by hand."""

import json
import math
import re
from dataclasses import replace

import polars as pl
import pytest
from conftest import ROOT

from osl_analysis.commands.tables import write_paper_table
from osl_analysis.dictionary.described import described_tables_by_name
from osl_analysis.figures import fig6
from osl_analysis.judge.campaign import CampaignFinding
from osl_analysis.judge.findings import Finding
from osl_analysis.judge.joining import joined
from osl_analysis.judge.known_findings import known_finding
from osl_analysis.judge.rules import Grade
from osl_analysis.report import paper_tables
from osl_analysis.report.listed_numbers import (
    LISTED_NUMBERS,
    WORDS,
    ListedNumber,
    is_nearer_to_Z_d,
    percent_above_K_d,
)
from osl_analysis.report.numbers import (
    headline_numbers,
    macros_tex,
    to_json,
)
from osl_analysis.report.paper_tables import condition_rows, conditions
from osl_analysis.report.verdicts import answer, brief_lines
from osl_analysis.stats.doubts import counted
from osl_analysis.stats.rounding import printed_number, printed_range, written
from osl_analysis.stats.sources import Source

ABOUT = dict.fromkeys(("campaign", "data", "version", "configuration", "recorded", "digest"), "x")
FITS = pl.DataFrame(
    {
        "trial": [*"aabc"],
        "controller": "PD 1",
        "K_d": [100.0, 100.0, 200.0, 200.0],
        "B_d": [0.0, 0.0, 5.0, 5.0],
        "amplitude_deg": [2.0, None, None, None],
        "K": [90.0, 101.0, 202.0, 206.0],
        "K_low": [80.0, 99.0, 200.0, 205.0],
        "K_high": [100.0, 103.0, 204.0, 207.0],
        "B": [0.1, 0.2, 5.3, 5.5],
        "B_viscous": [None, None, 5.1, None],
        "I": None,
        "VAF": [97.0, 98.0, 99.0, 99.5],
        "interval_method": "repeats",
    }
)

SOUND = joined(FITS, "impedance", [])
IMPEDANCE = joined(FITS, "impedance", [Finding("friction", "impedance", "c")])
GROUP_DOUBT = Finding("clocks_disagree", "walking_groups", "all", estimates=("K",))
BELT = pl.DataFrame({"quantity": ["K_s"], "mean": 690.0, "low": 680.0, "high": 700.0, "n": 10})


def numbers_of(**tables):
    return {number.name: number for number in headline_numbers(tables)}


def test_a_group_s_doubt_stands_on_its_number_and_in_a_macro_of_its_own():
    group_cells = {"group": "all", "estimator": "ensemble", "n": 12}
    summary = pl.DataFrame(
        [group_cells | {"quantity": "K", "mean": 300.0, "low": 270.0, "high": 330.0}]
    )
    doubted = joined(summary, "walking_summary", [GROUP_DOUBT])

    number = numbers_of(walking_summary=doubted)["walking_K"]

    text = f"K: {known_finding('clocks_disagree').title}"
    assert number.in_sentence == f"K = 300 ± 30 N*m/rad (doubtful: {text})"
    assert f"\\oslWalkingKDoubtful}}{{{text}}}" in macros_tex(ABOUT, [number], ())
    assert "Doubtful" not in macros_tex(ABOUT, [*numbers_of(walking_summary=summary).values()], ())


def test_a_mean_over_trials_leaves_out_amplitudes_and_doubtful_trials():
    bias = numbers_of(impedance=IMPEDANCE)["K_bias_PD_1"]

    assert bias.value == pytest.approx((1 + 1) / 2)  # of a and b, in percent
    assert (bias.n, bias.n_doubtful) == (2, 1)


def test_of_doubtful_trials_alone_there_is_no_number():
    late = [Finding("late_torque", "impedance", trial) for trial in "abc"]
    doubtful = joined(FITS, "impedance", late)

    assert not [*headline_numbers({"impedance": doubtful})]


def test_numbers_of_another_excitation_are_another_condition_s():
    excitation = pl.Series(["stepped sine"] * 3 + ["periodic"])
    both = SOUND.with_columns(excitation=excitation)

    numbers = numbers_of(impedance=both)
    K_in_table = [row["K [N*m/rad]"].split()[0] for row in rows_of(conditions(both))]

    names = ("K_PD_1_K_d_200_B_d_5_periodic", "K_PD_1_K_d_200_B_d_5_stepped_sine")
    assert [numbers[name].texts[0] for name in names] == ["206.0", "202.0"]
    assert {"206.0", "202.0"} < {*K_in_table}


def test_the_median_VAF_is_that_of_the_fits_that_Fig_6_draws():
    figure_rows = counted(fig6.points(IMPEDANCE))

    number = numbers_of(impedance=IMPEDANCE)["VAF_median_PD_1"]

    assert (number.value, number.n) == (figure_rows["VAF"].median(), len(figure_rows)) == (98.0, 2)


def test_the_error_of_the_damping_is_that_of_Eq_15_and_the_viscous_one_has_its_own_number():
    numbers = numbers_of(impedance=IMPEDANCE)

    assert numbers["B_error_PD_1"].value == pytest.approx((0.2 + 0.3) / 2)
    assert numbers["B_viscous_error_PD_1"].value == pytest.approx(0.1)


def test_one_trial_has_its_own_interval_and_several_have_that_of_their_mean():
    numbers = numbers_of(impedance=SOUND)

    alone = numbers["K_PD_1_K_d_100_B_d_0"]
    several = numbers["K_PD_1_K_d_200_B_d_5"]
    assert (alone.value, alone.low, alone.high, alone.interval) == (101, 99, 103, "repeats")
    half = 12.706 * 2  # Student's quantile of one degree of freedom, and the standard error
    assert (several.value, several.n, several.interval) == (204, 2, "Student")
    assert several.high - several.value == pytest.approx(half, rel=1e-4)


def test_a_number_that_is_no_estimate_has_the_range_of_its_values():
    number = numbers_of(impedance=SOUND)["K_bias_PD_1"]

    assert (number.low, number.high) == pytest.approx((1, 3))
    assert number.texts == ["1.67", "1.00", "3.00"]


def test_trials_without_a_stated_K_d_are_conditions_of_their_own():
    unstated = IMPEDANCE.filter(trial="b").with_columns(K_d=pl.lit(None, pl.Float64))
    both = pl.concat([unstated, unstated.with_columns(trial=pl.lit("d"))])

    assert {"K_PD_1_B_d_5_b", "K_PD_1_B_d_5_d"} <= set(numbers_of(impedance=both))


def test_a_mean_of_a_summary_keeps_interval_and_number_beside_the_draft():
    (number,) = headline_numbers({"belt_summary": BELT})
    assert (number.value, number.low, number.high, number.n) == (690, 680, 700, 10)
    assert number.draft == 685.6
    assert next(headline_numbers({"belt_summary": BELT}, beside_draft=False)).draft is None


def test_two_joints_have_numbers_of_their_own():
    belt = BELT.join(pl.DataFrame({"joint": ["ankle", "knee"]}), how="cross")

    assert [*numbers_of(belt_summary=belt)] == ["K_s_ankle", "K_s_knee"]


def test_every_claim_has_its_verdict():
    claims = pl.DataFrame(
        {
            "name": "K_ok",
            "at": "Fig. 5",
            "value": [None, 1.0],
            "low": 0.5,
            "high": 1.5,
            "interval": "95 %",
            "unit": "%",
            "claim": "K is right",
            "quantity": "error",
            "verdict": "holds",
        }
    )

    (number,) = headline_numbers({"claims": claims})
    assert (number.name, number.unit, number.verdict) == ("K_ok", "%", "holds")


def test_macros_are_letters_and_lines_definitions_or_comments():
    both = pl.concat(IMPEDANCE.with_columns(controller=pl.lit(name)) for name in ("PD+", "PD 1"))

    tex = macros_tex(ABOUT, headline_numbers({"impedance": both}), ["1 of 2 trials"])

    assert tex.count("PDPlusSign") == tex.count("PDOne") > 0
    assert all(line.startswith(("%", r"\newcommand{\osl")) for line in tex.splitlines())
    assert "% 1 of 2 trials\n" in tex
    assert r"\newcommand{\oslCampaign}{x}" in tex
    assert r"\newcommand{\oslKPDOneKDOneZeroZeroBDZeroLow}{\ensuremath{99.0}}" in tex


def test_names_that_differ_in_signs_alone_have_macros_of_their_own():
    both = pl.concat(IMPEDANCE.with_columns(controller=pl.lit(name)) for name in ("PD+", "PD-"))

    tex = macros_tex(ABOUT, headline_numbers({"impedance": both}), [])

    macros = re.findall(r"newcommand{.([A-Za-z]+)}", tex)
    assert len(set(macros)) == len(macros) == tex.count("newcommand")


@pytest.mark.parametrize(
    ("value", "low", "high", "texts"),
    [
        (300.123, 298.71, 301.62, "300.1 298.7 301.6"),
        (14.0, None, None, "14"),
        (99.99863, None, None, "99.9986"),
        (98.76, None, None, "98.8"),
        (-0.0004, -0.012, 0.011, "0.000 -0.012 0.011"),
    ],
)
def test_a_number_is_rounded_to_two_digits_of_half_its_interval_or_to_three(
    value, low, high, texts
):
    assert re.findall(r"-?[\d.]+", written(value, low, high, "%")) == texts.split()


def test_a_mean_is_printed_within_the_range_of_its_finite_values():
    table = pl.DataFrame({"VAF": [99.9814, 99.99863, 99.998, math.nan]})

    (number,) = headline_numbers({"walking": table})

    value, low, high = map(float, number.texts)
    assert low <= value <= high < 100
    assert value == pytest.approx(99.99268, rel=1e-5)


def rows_of(of_conditions):
    """Rows of a table for a paper by its heads."""
    heads, *rows = condition_rows(of_conditions)
    return [dict(zip(heads, map(str, row), strict=True)) for row in rows]


def test_conditions_are_rows_with_their_sound_trial_or_the_mean_of_several():
    one_of_two, mean_of_two = (rows_of(conditions(t))[-1] for t in (IMPEDANCE, SOUND))
    assert (one_of_two["K_d"], one_of_two["B_d"], one_of_two["n"]) == ("200", "5", "1")
    assert re.search(r"202\.0 .*200\.0 .*204\.0", one_of_two["K [N*m/rad]"])
    assert mean_of_two["n"] == "2"
    assert mean_of_two["K [N*m/rad]"].startswith("204 ")


def test_a_condition_without_a_clear_trial_is_marked_and_has_no_numbers():
    alone = IMPEDANCE.filter(trial="c")
    several = pl.concat([alone, alone.with_columns(trial=pl.lit("d"))])

    rows = [rows_of(conditions(table))[0] for table in (alone, several)]
    assert [(row["B_d"], row["n"], row["K [N*m/rad]"]) for row in rows] == [("5†", "0", "–")] * 2


RANGED = SOUND.with_columns(K_range_low=pl.col("K") - 2.8, K_range_high=pl.col("K") + 0.7)


def test_the_range_decides_on_the_digits_where_it_is_wider_than_the_interval():
    """K of a leg, 296.7443 ± 0.0073 with a range from 293.92 to 297.40."""
    number = printed_number(296.7443, 296.7370, 296.7516, half_range=1.74)

    assert (number.text, number.short) == ("296.7 ± 0.1", "296.7 ± 0.1")
    assert str(printed_range(293.92, 297.40, 296.7443)) == "294 to 297"


def test_a_range_never_excludes_the_number_that_it_is_of():
    assert str(printed_range(98.6, 101.4, 101.4)) == "98.6 to 101.4"


@pytest.mark.parametrize(
    ("method", "promise"),
    [
        ("repeats", "repeats: the same motion, started alike, again"),
        ("blocks", "blocks: noise and misfit of this recording"),
    ],
)
def test_the_table_of_conditions_says_what_its_interval_promises(method, promise):
    fits = RANGED.filter(trial="b").with_columns(interval_method=pl.lit(method))

    notes = " ".join(paper_tables.notes_on_conditions(conditions(fits)))

    assert promise in notes
    assert "it holds two other motions of three" in notes
    assert ("the same motion" in notes) == (method == "repeats")


def test_a_condition_of_two_trials_has_the_interval_between_them():
    single, mean_of_two = conditions(SOUND)

    assert (single.interval_method, mean_of_two.interval_method) == ("repeats", "between trials")
    heads, *rows = condition_rows([single, mean_of_two])
    assert [row[heads.index("interval")] for row in rows] == ["repeats", "between trials"]
    notes = " ".join(paper_tables.notes_on_conditions([single, mean_of_two]))
    assert "between trials: the mean over n trials" in notes


def test_a_condition_names_the_trial_that_is_in_no_mean_and_why():
    late = Finding("late_torque", "impedance", "c", estimates=("B", "I"))

    condition = conditions(joined(FITS, "impedance", [late]))[-1]

    title = known_finding("late_torque").title
    assert [str(trial) for trial in condition.left_out] == [f"c from B, I ({title})"]
    assert f"in no mean: c from B, I ({title})" in paper_tables.notes_on_conditions([condition])


def test_what_signs_mean_stands_below_the_rule_of_the_table_in_latex():
    shown = conditions(RANGED)
    notes = paper_tables.notes_on_conditions(shown)

    tex = paper_tables.tex_for_paper(condition_rows(shown), "simulated", notes)

    head, below = tex.split(r"\bottomrule")
    assert r"$\pm$: half of the 95 \% interval" in below
    assert "it holds two other motions of three" in below
    assert r"\multicolumn{3}{c}{range}" in head


def test_numbers_of_a_column_stand_on_the_decimal_point():
    rows = [["K [N*m/rad]"], [printed_number(-2, -3, -1)], [printed_number(134.5, 134.2, 134.8)]]

    tex = paper_tables.tex_for_paper(rows, "simulated")

    assert r"{@{}S[table-format=-3.2]@{\,}c@{\,}S[table-format=1.2]@{}}" in tex


def test_a_condition_shows_friction():
    findings = [
        Finding("fixture_inertia", "impedance", "b", Grade.UNCHECKED),
        Finding("friction", "impedance", "b", Grade.NOTES),
    ]

    (condition,) = conditions(joined(FITS.filter(trial="b"), "impedance", findings))
    assert (condition.is_doubtful, condition.results) == (False, ["friction"])


def test_latex_has_half_of_the_interval_and_escapes_what_users_write():
    rows = [["controller", "K"], ["PD_1 a (1 to 2)", printed_number(-2, -3, -1)]]

    assert r"PD\_1 a (1 to 2) & -2.0 & $\pm$ & 1.0 \\" in paper_tables.tex_for_paper(
        rows, "simulated"
    )


def test_units_stand_below_the_heads_of_columns_and_beside_those_of_rows():
    """Beside a head they would make its column too wide for the page."""
    tex = paper_tables.tex_for_paper([["K [N*m/rad]", "all"], ["K [N*m/rad]", "1"]], "simulated")

    head, body = tex.split(r"\midrule")
    assert head.count(r"\begin{tabular}[t]") == 1
    assert r"$K$ (\unit{" in body
    assert "tabular}[t]" not in body


def test_groups_of_crossings_are_rows_of_both_ensembles_with_their_doubts():
    """A VAF is not rounded to 100 %."""
    columns = ["quantity", "estimator", "mean", "low", "high"]
    rows = [
        ("K", "ensemble", 336.0, 323.0, 348.0),
        ("VAF", "ensemble", 99.996, None, None),
        ("K", "mean of perturbations", 340.0, 1.0, 2.0),
        ("K", "ensemble, predicted gait", 333.0, 321.0, 345.0),
        ("VAF", "ensemble, predicted gait", 98.0, None, None),
    ]
    summary = pl.DataFrame(rows, columns, orient="row").with_columns(group=pl.lit("all"), n=30)
    wide = Finding("wide_interval", "walking_groups", "all", Grade.NOTES, estimates=("K",))
    clear = joined(summary, "walking_summary", [wide])

    minus_mean, predicted = rows_of(list(paper_tables.groups(clear)))
    assert (minus_mean["n"], minus_mean["K [N*m/rad]"][:3], minus_mean["VAF [%]"]) == (
        "30",
        "336",
        "99.99",
    )
    assert (predicted["n"], predicted["K [N*m/rad]"][:3], predicted["VAF [%]"]) == (
        "30",
        "333",
        "98.00",
    )
    doubted = [*paper_tables.groups(joined(summary, "walking_summary", [GROUP_DOUBT]))]
    assert [group.is_doubtful for group in doubted] == [True, True]
    texts = {name: str(number) for name, number in doubted[0].estimates.items()}
    assert texts == {"K": "336 (323 to 348)†", "VAF": "99.99†"}
    assert [group.wide for group in paper_tables.groups(clear)] == [["K"], []]


@pytest.mark.parametrize(("beside_draft", "draft"), [(True, " 7.55 (83/11) |"), (False, "")])
def test_table_1_has_what_is_measured_and_else_what_is_stated(beside_draft, draft, tmp_path):
    summary, page = tmp_path / "actuator_summary.csv", tmp_path / "components.md"
    summary.write_text("quantity,n,mean,low,high\nk_tau_n_m,3,1.08,0.99,1.17\n")
    parameters = ROOT / "config" / "parameters" / "default.yaml"
    write_paper_table(
        {"actuator_summary": summary}, parameters, ABOUT, beside_draft, tmp_path / "a.tex", page
    )
    assert f"| n_T | 4.61 | stated |{draft}\n" in page.read_text()
    assert "| k_tau [N*m/A] | 0.120 (0.110 to 0.130) | 3 |" in page.read_text()


def test_a_run_ends_with_ten_lines_at_most_of_answer_and_findings():
    finding = CampaignFinding(
        verdict="doubtful",
        subject="impedance trials",
        source=Source.FRICTION,
        cause="friction",
        says="",
        size="B 2.1. More",
        remedy="",
        n=3,
        brief="report B " + 20 * "once more ",
        trials=["c"],
        worst="c",
    )
    unchecked = replace(finding, verdict="not checked", cause="the fixture")
    many = pl.concat(IMPEDANCE.with_columns(controller=pl.lit(f"PD {k}")) for k in range(9))
    content = {
        "answer": answer({"impedance": many}),
        "results_of_clear": {},
        "changed": [{"setting": "doubtful.accuracy.K", "value": "0.1", "default": "0.02"}],
        "verdicts": {"clear": 1, "doubtful": 1, "refused": 1},
        "findings": [vars(finding)] * 9 + [vars(unchecked)],
    }

    summary = to_json(ABOUT, headline_numbers({"impedance": many}), content)
    lines = brief_lines(json.loads(summary))

    assert len(lines) == 9, "and one says where the page is"
    assert max(map(len, lines)) <= 110
    assert re.search("K is within 1 % of K_d and B is within 0.3 N.m.s/rad of B_d", lines[0])
    assert any(re.search("3 .*1 doubtful.*1 refused", line) for line in lines)
    assert re.search(r"friction.* 1 .*3 impedance trials.*report B", lines[-2])
    assert re.search("further findings on the page: 5.*the fixture", lines[-1])


def test_the_answer_counts_the_pairs_in_which_compensation_is_nearer():
    pairs = pl.DataFrame(
        {"of": "trials", "quantity": ["K_error", "B_error"], "better": [16, 14], "pairs": 16}
    )

    sentence = answer({"impedance": SOUND, "compensation": pairs})
    assert "in K in 16 of 16, in B in 14 of 16 pairs" in sentence
    assert "pairs" not in answer({"impedance": SOUND, "compensation": pl.DataFrame({"of": []})})
    assert answer({"impedance": SOUND.with_columns(K_d=pl.lit(None, pl.Float64))}) == ""


def test_the_answer_is_a_bound_that_no_trial_exceeds():
    fits = SOUND.with_columns(K=pl.col("K_d") * 1.02401, B=pl.col("B_d") + 0.31)

    assert "K is within 2.5 % of K_d and B is within 0.31 N*m*s/rad" in answer({"impedance": fits})


def test_half_of_an_interval_is_of_its_own_ends_and_not_of_rounded_ones():
    assert printed_number(0.4952, 0.3672, 0.6232).short == "0.50 ± 0.13"
    assert printed_number(0.5044, 0.3756, 0.6236).short == "0.50 ± 0.12"


@pytest.mark.parametrize(
    ("doubted", "told"), [("K", "PD 1, B is within"), ("B", "PD 1, K is within"), ("KB", None)]
)
def test_the_answer_leaves_out_an_estimate_that_is_doubtful(doubted, told):
    doubts = [Finding("friction", "impedance", trial, estimates=(*doubted,)) for trial in "abc"]

    sentence = answer({"impedance": joined(FITS, "impedance", doubts)})

    assert sentence.startswith(f"Over whole trials, {told}") if told else sentence == ""
    assert sentence.count("within") == (told is not None)


@pytest.mark.parametrize("changes", [
    {"value": "K_viscous"}, {"ends": ("K_lo", "K_high")}, {"by": ("controler",)},
    {"value": percent_above_K_d, "of": ("K", "Kd")}, {"words": "K_of"},
])  # fmt: skip
def test_a_number_of_a_column_or_of_words_that_are_not_there_is_refused(changes):
    fields = {"value": "K", "ends": ("K_low", "K_high"), **changes}

    with pytest.raises(ValueError, match=r"no column|no words"):
        ListedNumber("K", "impedance", "N*m/rad", **fields)


def test_each_number_has_words_and_all_words_are_of_a_number():
    assert {entry.words or entry.name for entry in LISTED_NUMBERS} == WORDS.keys()


def test_a_frequency_is_nearer_where_it_is_below_the_best_sound_one_without_compensation():
    """Of three pairs one is nearer; of the last frequency nobody has measured the other arm."""
    response = pl.DataFrame(
        {
            "scope": "all", "joint": "ankle", "side": None, "K_d": 90.0, "B_d": 1.0,
            "controller": ["compensated"] * 4 + ["uncompensated"] * 5,
            "frequency_hz": [1.0, 2.0, 3.0, 4.0, 1.0, 1.0, 2.0, 3.0, 3.0],
            "Z_error": [5.0, 5.0, 5.0, 5.0, 6.0, 7.0, 4.0, 9.0, 4.5],
        }
    )  # fmt: skip

    nearer = is_nearer_to_Z_d(response)

    assert nearer.to_list() == [True, False, False, None, *[None] * 5]


@pytest.mark.parametrize("entry", LISTED_NUMBERS, ids=lambda entry: entry.name)
def test_a_table_without_rows_gives_no_number_and_no_error(entry):
    described = described_tables_by_name()[entry.table]
    columns = [*described.columns, *described.of_fits]
    empty = pl.DataFrame(schema=dict.fromkeys(columns, pl.String))

    numbers = list(headline_numbers({entry.table: empty}))

    assert numbers == []
