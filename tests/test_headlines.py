"""Doubts and headline numbers: limits on any column, the mark on its way to the reader, JSON, LaTeX
and Markdown."""

import json
import os
import re
from dataclasses import replace

import polars as pl
import pytest
import yaml
from conftest import ROOT, beyond_in, facts_of, findings_of, marked

import osl_analysis
from osl_analysis.campaign.campaign_trials import Campaign
from osl_analysis.campaign.configuration import read_config, read_section
from osl_analysis.campaign.origin import ABOUT_MACROS
from osl_analysis.commands import tables
from osl_analysis.commands.tables import format_results_table, gather, read_summary, write_summary
from osl_analysis.errors import InputError
from osl_analysis.judge.campaign import campaign_findings
from osl_analysis.judge.finding import (
    Beyond,
    Finding,
    Grade,
    Remedy,
    WordedFinding,
    Words,
    findings_frame,
    findings_of_frame,
)
from osl_analysis.judge.judging import judged
from osl_analysis.judge.known_findings import EVIDENCE, FINDINGS
from osl_analysis.judge.limits import DoubtfulFits, Limits
from osl_analysis.judge.summary_findings import causes_in_campaign
from osl_analysis.outcomes.job_log import write_log
from osl_analysis.refusal import Refusal
from osl_analysis.report.decimal_places import RANGE
from osl_analysis.report.headline import (
    LABELS,
    Example,
    Headline,
    HeadlineLabel,
    HeadlineValue,
    headlines_in_summary,
    of_group,
)
from osl_analysis.report.headline_files import to_json, to_tex
from osl_analysis.report.headline_statistics import BOOTSTRAP, FOR_MOTION, FOR_REPETITION, STUDENT
from osl_analysis.report.headline_text import (
    first_sentences,
    number_texts,
    to_table,
    written_number,
)
from osl_analysis.report.headlines import HEADLINE_ESTIMATOR, headline_numbers
from osl_analysis.stats.repeats import counted, doubtful_count, summary_of_trials
from osl_analysis.table import read_table, write_table
from osl_analysis.units import known_factor

NO_CHECKS = pl.DataFrame(schema={"trial": pl.String, "check": pl.String, "verdict": pl.String})


def fits(**columns):
    return pl.DataFrame({"trial": ["a", "b"], **columns})


def doubts(row, above, below):
    return findings_of(row, Limits(above=above, below=below), "phasors")


def causes_of(table, limits):
    return [[one.cause for one in row] for row in judged(table, limits, "phasors")]


def known(tables, limits, verdicts=NO_CHECKS):
    """The findings on a campaign as the summary has them."""
    limits = DoubtfulFits.model_validate(limits)
    marked_tables = {name: marked(table, limits.of(name), name) for name, table in tables.items()}
    findings = campaign_findings(tables, verdicts, limits)
    return [one.to_json() for one in causes_in_campaign(findings, marked_tables, verdicts)]


def test_a_fit_is_doubtful_for_every_limit_that_it_passes():
    row = {"fit": 80.0, "lag": -0.7, "condition": 5.0, "held_out": None, "n": 3}
    found = doubts(row, {"lag": 0.5, "condition": 10, "n": 2}, {"fit": 90, "held_out": 80})
    assert [one.evidence for one in found] == [
        (Beyond("lag", -0.7, -0.5, "below"),), (Beyond("n", 3.0, 2, "above"),),
        (Beyond("fit", 80.0, 90, "below"),)
    ]  # fmt: skip
    assert doubts(row, {"lag": 0.7, "condition": None}, {"fit": 80}) == []
    assert beyond_in(doubts({"fit": float("nan")}, {}, {"fit": 90})) == {"fit": "nan"}
    both = doubts({"held_out": -95.0, "lag": -95.0}, {"lag": 90}, {"held_out": 90})
    assert [one.evidence[0].limit for one in both] == [
        -90,
        90,
    ], "a lower limit is on the value, an upper on its size"


def test_a_misfit_that_a_cause_explains_is_no_doubt_of_its_own():
    row = {
        "coulomb_share": 0.6,
        "VAF": 80.0,
        "torque_distortion": 0.3,
        "B": 2.264,
        "B_viscous": 1.0465,
    }
    (friction,) = doubts(row, {"coulomb_share": 0.5, "torque_distortion": 0.25}, {"VAF": 90})
    assert (friction.cause, [*beyond_in([friction])]) == (
        "friction",
        ["coulomb_share", "torque_distortion", "VAF"],
    )
    assert (friction.sizes, friction.without) == ({"B": pytest.approx(0.6 * 2.264)}, {"B": 1.0465})
    assert friction.remedy == Remedy.ALONE, "there are no rows of single amplitudes"
    assert [one.cause for one in doubts({"VAF": 80.0}, {}, {"VAF": 90})] == [
        "model that does not fit"
    ]
    rows = pl.DataFrame(
        {
            "trial": "a",
            "amplitude_deg": [2.0, None],
            "coulomb_share": [0.1, 0.6],
            "VAF": [80.0, 95.0],
        }
    )
    limits = Limits(above={"coulomb_share": 0.5}, below={"VAF": 90})
    both = [one for row in judged(rows, limits, "phasors") for one in row]
    assert [(one.cause, one.remedy) for one in both] == [("friction", Remedy.WHOLE)] * 2
    sound = rows.with_columns(coulomb_share=pl.Series([0.6, 0.1]))
    (alone,), none = judged(sound, limits, "phasors")
    assert (alone.remedy, alone.amplitude_deg is not None, none) == (Remedy.AMPLITUDE, True, [])
    assert (
        judged(sound.with_columns(frequency_hz=5.0), limits, "phasors")[0][0].remedy
        == Remedy.FREQUENCY
    )


FAR, NEAR = 1.3, 1.1
"""A number beyond its limit by these factors: a cause of others precedes them from 1.15 on."""
OF_UNIT_OR_SIGN = [name for name, one in EVIDENCE.items() if FINDINGS[one.finding].causes_others]


@pytest.mark.parametrize("column", OF_UNIT_OR_SIGN)
def test_a_unit_or_sign_far_off_is_named_before_what_it_may_cause(column):
    row = {"heterogeneity": 5.0, column: FAR}
    limits = Limits(above={"heterogeneity": 1.0, column: 1.0}, below={})
    of_column = FINDINGS[EVIDENCE[column].finding].title

    far = [one.cause for one in findings_of(row, limits, "phasors")]
    near = [one.cause for one in findings_of(row | {column: NEAR}, limits, "phasors")]

    assert far == [of_column, "several stiffnesses"]
    assert near == ["several stiffnesses", of_column], "as the limits are written"


def test_beside_a_clipped_signal_nothing_that_makes_a_fit_worse_is_named():
    row = {"saturated_samples": 9, "coulomb_share": 0.6, "heterogeneity": 5.0}
    limits = Limits(above={"saturated_samples": 5, "coulomb_share": 0.5, "heterogeneity": 1})

    names = [one.cause for one in findings_of(row, limits, "phasors")]

    assert names == ["clipped signal", "several stiffnesses"]


def test_a_misfit_belongs_to_the_cause_that_was_measured():
    row = {"torque_distortion": 0.3, "lag_share": 0.3, "VAF": 80.0}
    limits = Limits(above={"torque_distortion": 0.25, "lag_share": 0.05}, below={"VAF": 90})

    (finding,) = findings_of(row, limits, "phasors")

    assert finding.cause == "late torque"
    assert {one.column for one in finding.evidence} == row.keys()


def test_a_number_is_as_far_beyond_its_limit_below_it_as_above_it():
    assert Beyond("VAF", 30.0, 90.0, "below").excess == pytest.approx(3)
    assert Beyond("lag", -1.5, -0.5, "below").excess == pytest.approx(3)
    assert Beyond("lag", 1.5, 0.5, "above").excess == pytest.approx(3)


def test_a_fault_of_the_recording_that_one_amplitude_alone_shows_accuses_nobody():
    """Friction passes for a late torque or a changing K at one amplitude; both would be there at
    all of them."""
    amplitudes = {"trial": ["a"] * 3, "amplitude_deg": [2.0, 4.0, None]}
    limits = Limits(above={"lag_share": 0.05, "K_drift": 0.003}, below={"VAF": 90})
    alone = pl.DataFrame(
        {**amplitudes, "lag_share": [0.0, 0.3, 0.0], "K_drift": [0.1, 0.0, None], "VAF": 95.0}
    )
    assert causes_of(alone, limits) == [[], [], []]
    everywhere = alone.with_columns(
        lag_share=pl.Series([0.1, 0.3, 0.1]), VAF=pl.Series([95.0, 95.0, 80.0])
    )
    assert causes_of(everywhere, limits) == [["late torque"]] * 3


@pytest.mark.parametrize(("seconds", "noted"), [
    ([30.0, 60.0, 61.0, 60.0], ["a"]), ([30.0, 60.0, 90.0, 120.0], []), ([50.0, 60.0, 60.0, 60.0],
     []),
    ([30.0, 60.0], []), ([30.0, 60.0, 29.0, 60.0], []), ([60.0, 20.0, 60.0], ["b"]),
    ([60.0, 60.0, 120.0, 60.0], ["c"]),
])  # fmt: skip
def test_a_recording_of_another_length_than_its_like_is_noted(seconds, noted):
    motion = ["other"] * len(seconds) + ["stepped sine"]
    rows = {
        "trial": [*"abcde"][: len(motion)],
        "recorded_s": [*seconds, 5.0],
        "excitation": motion,
        "doubtful": "",
    }
    table = pl.DataFrame(rows).with_columns(amplitude_deg=pl.lit(None, pl.Float64))
    found = [
        one
        for one in known({"impedance": table}, {})
        if one["cause"] == "recording of another length"
    ]
    assert [(one["verdict"], one["trials"]) for one in found] == [("remark", noted)] * bool(noted)
    own = dict(zip("abcde", seconds, strict=False))
    assert all(
        f"{own[noted[0]]:g} s are recorded, and 60 s of most" in one["line"] for one in found
    )


def test_a_factor_between_units_is_named_within_eight_percent():
    found = [known_factor(ratio)[0] for ratio in (1.07 * 4.4482, 1 / 4.4482, 1.09 * 4.4482, 0.0)]
    assert found == ["between lbf and N"] * 2 + [""] * 2


def test_a_limit_on_no_column_of_numbers_is_refused_by_name(tmp_path):
    for column in ("VFA", "trial"):
        message = (
            rf"doubtful\.belt: the table has no column '{column}' of numbers; put the limit on one"
            r" of VAF"
        )
        with pytest.raises(InputError, match=message):
            marked(fits(VAF=[80.0, 99.0]), Limits(below={column: 1}), "belt")
    (tmp_path / "c.yaml").write_text(yaml.safe_dump({"doubtful": {"belts": {"below": {"VAF": 1}}}}))
    with pytest.raises(
        InputError, match=r"belts: .*unknown table; limits may stand on belt, transmission"
    ):
        read_section(tmp_path / "c.yaml", "doubtful", DoubtfulFits)


def test_a_crossing_without_a_fit_is_neither_doubtful_nor_not():
    table = marked(
        fits(vaf=[None, 80.0], excluded=["no markers", None]), Limits(below={"vaf": 90}), "walking"
    )
    assert (table["doubtful"].to_list(), doubtful_count(table)) == ([None, "vaf"], (1, 1))


def test_causes_and_trials_are_counted_and_not_the_rows_that_inherit_them():
    """Two of three trials have friction, one of them in four rows of two tables; one has a doubt of
    its own beside."""
    fit = {"trial": ["a", "a", "b", "c"], "amplitude_deg": [2.0, None, None, None]}
    fit |= {"coulomb_share": [0.7, 0.6, 0.7, 0.1]}
    fit |= {"VAF": [80.0, 80.0, 80.0, 95.0], "fault_harm": [0.0, 0.0, 9.0, 0.0]}
    of_path = {"fault": pl.lit("delay"), "fault_family": pl.lit("path")}
    tables = {"impedance": pl.DataFrame(fit).with_columns(K_over_K_s=0.5, K_drift=0.0, **of_path)}
    shared = {
        "trial": ["a", "a", "c"],
        "amplitude_deg": [2.0, None, None],
        "theta_distortion": [0.0, 0.0, 0.1],
    }
    tables["phasors"] = pl.DataFrame(shared)
    limits = {"accuracy": {"B": 0.5}, "impedance": {"below": {"VAF": 90}}}
    found = known(tables, limits | {"phasors": {"above": {"theta_distortion": 0.02}}})
    counts = [(one["cause"], one["trials"], one["n"], one["of"]) for one in found]
    assert counts == [
        ("friction", ["a", "b"], 3, "impedance trials"), ("torque path",
         ["b"], 3, "impedance trials"),
        ("distorted motion", ["c"], 2, "impedance trials, in phasors alone"),
    ]  # fmt: skip
    assert (found[0]["name"], found[0]["brief"]) == ("friction", "report the viscous damping")
    said = found[0]["worst"], found[0]["measure"], found[0]["limit"]
    assert said == ("b", "coulomb_share, VAF", "above 0.5, below 90")
    findings = campaign_findings(tables, NO_CHECKS, DoubtfulFits.model_validate(limits))
    inherited = findings_frame(findings).filter(table="phasors")
    assert inherited.select("trial", "cause", "inherited").unique().rows() == [
        ("a", "friction", "impedance")
    ]


def test_a_check_that_flags_trials_has_its_cause_and_its_value():
    checks = {
        "trial": ["a", "b"],
        "check": ["gap"] * 2,
        "value": [0.0, 0.095],
        "unit": ["s"] * 2,
        "threshold": 0.05,
    }
    table = pl.DataFrame(checks | {"verdict": ["pass", "flag"], "remark": ["", "torque"]})
    belt = fits(VAF=[95.0, 80.0], K_s_ratio=1.0)
    found = known({"belt": belt}, {"belt": {"below": {"VAF": 90}}}, table)
    assert [(one["verdict"], one["cause"], one["trials"], one["limit"]) for one in found] == [
        ("doubtful", "model that does not fit", ["b"], "below 90"),
        ("flagged", "gap in the recording", ["b"], "above 0.05"),
    ]


def test_the_limit_of_every_finding_reaches_table_and_summary(
    tmp_path,
):
    belt = fits(K_s_ratio=[1.3558, 1.0], VAF=[99.0, 80.0], offset=[1.0, 9.0])
    limits = DoubtfulFits.model_validate({
        "belt": {"above": {"K_s_ratio": 1.5, "offset": 5}, "below": {"K_s_ratio": 0.5, "VAF": 90}}
    })  # fmt: skip
    paths = {name: tmp_path / f"{name}.csv" for name in ("belt", "quality", "findings")}
    write_table(marked(belt, limits.of("belt"), "belt"), paths["belt"])
    write_table(NO_CHECKS, paths["quality"])
    tables.write_findings({"belt": paths["belt"]}, paths["quality"], limits, paths["findings"])
    rows = (
        read_table(paths["findings"])
        .select("trial", "cause", "evidence", "value", "limit", "limit_side")
        .rows()
    )
    assert rows == [
        ("a", "another unit", "K_s_ratio", 1.3558, 1.5, "near"),
        ("b", "model that does not fit", "VAF", 80.0, 90.0, "below"),
        ("b", "offset", "offset", 9.0, 5.0, "above"),
    ]  # fmt: skip
    files = {
        "summary_json": tmp_path / "s.json",
        "numbers_tex": tmp_path / "n.tex",
        "findings": paths["findings"],
    }
    write_summary(about=MADE, table_paths={"belt": paths["belt"]}, **files)
    summary = read_summary(tmp_path / "s.json")
    assert [(one["cause"], one["measure"], one["limit"]) for one in summary["findings"]] == [
        ("another unit", "K_s_ratio", "near 1.5"), ("model that does not fit", "VAF", "below 90"),
        ("offset", "offset", "above 5"),
    ]  # fmt: skip
    assert summary["findings"][0]["line"] in format_results_table(summary)


def test_a_mean_leaves_out_doubtful_trials_while_half_are_sound():
    two = fits(K_s=[700.0, 690.0], doubtful=["", "clipped"])
    third = two.tail(1).with_columns(trial=pl.lit("third"))
    for table, said in (
        (two, (700.0, 1, 1, 1)),
        (pl.concat([two, third]), (pytest.approx(2080 / 3), 3, 2, 0)),
    ):
        (summary,) = (
            summary_of_trials(table, ["K_s"]).select("mean", "n", "n_doubtful", "n_left_out").rows()
        )
        assert summary == said
    assert len(counted(two.drop("doubtful"))) == 2


def test_phasors_share_the_doubts_of_the_fit_of_their_trial_and_amplitude(tmp_path):
    fit = {"amplitude_deg": [2.0, 4.0, None], "vaf": [80.0, 95.0, 85.0]}
    fit |= {"K_over_K_s": 0.5, "fault_probability": 0.0, "K_drift": 0.0}
    phasors = {"amplitude_deg": [2.0, 2.0, 4.0], "distortion": [0.0, 9.0, 0.0]}
    for name, columns in (("impedance", fit), ("phasors", phasors)):
        write_table(pl.DataFrame({"trial": ["a"] * 3, **columns}), tmp_path / name / "a.csv")
    of, strict = [tmp_path / "impedance/a.csv"], Limits(below={"vaf": 90})
    gather(
        [tmp_path / "phasors/a.csv"],
        tmp_path / "phasors.csv",
        Limits(above={"distortion": 1}),
        of,
        strict,
    )
    assert read_table(tmp_path / "phasors.csv")["doubtful"].to_list() == [
        "vaf",
        "distortion; vaf",
        "",
    ]


MADE = {
    "campaign": "made",
    "data": "simulated",
    "version": "1.2.3",
    "configuration": "0a1b2c3d",
    "recorded": "seed 1",
}


def summary_rows(**means):
    rows = (
        {"quantity": q, "n": 10, "mean": x, "low": 0.99 * x, "high": 1.01 * x}
        for q, x in means.items()
    )
    return pl.DataFrame(list(rows))


def walked(estimator=HEADLINE_ESTIMATOR, **means):
    return summary_rows(**means).with_columns(estimator=pl.lit(estimator), group=pl.lit("all"))


def impedance():
    """Compensated K off by +1 % and -3 %, B by 0.5 and 0.1; VAF of single amplitudes 90, 98, 99."""
    columns = (
        "controller",
        "K_d",
        "B_d",
        "amplitude_deg",
        "K",
        "K_low",
        "K_high",
        "B",
        "B_low",
        "B_high",
        "VAF",
    )
    single = ((2, 90.0), (4, 98.0), (6, 99.0))
    rows = [("compensated", 300.0, 5.0, a, 1.0, 0.0, 2.0, 1.0, 0.0, 2.0, v) for a, v in single]
    rows += [
        ("compensated", 300.0, 5.0, None, 303.0, 299.0, 307.5, 5.5, 5.4, 5.7, 10.0),
        ("compensated", 100.0, 0.0, None, 97.0, 95.0, 99.0, 0.1, 0.0, 0.2, 10.0),
        ("uncompensated", 300.0, 5.0, None, 210.0, 208.0, 212.0, 3.6, 3.5, 3.7, 10.0),
    ]
    table = pl.DataFrame(rows, schema=columns, orient="row").with_columns(
        interval_method=pl.lit("units")
    )
    whole, steps = pl.col("amplitude_deg").is_null(), {"low": -2.04, "high": 1.06}
    ends = {
        f"{q}_amplitudes_{end}": pl.when(whole).then(pl.col(q) + step)
        for q in "KB"
        for end, step in steps.items()
    }
    sizes = {"I": 0.02, "I_low": 0.01, "I_high": 0.03}
    ends |= {name: pl.when(whole).then(pl.lit(size)) for name, size in sizes.items()}
    rubs = {
        "f_C": 0.3,
        "f_C_low": 0.2,
        "f_C_high": 0.4,
        "B_viscous": 5.2,
        "B_viscous_low": 5.1,
        "B_viscous_high": 5.3,
    }
    ends |= {
        name: pl.when(pl.col("K") == 303.0).then(pl.lit(value)) for name, value in rubs.items()
    }
    return table.with_columns(
        **ends, doubtful=pl.Series(["", "model that does not fit", "", "", "", "x"])
    )


def all_tables():
    vaf, turns = [99.0, 99.4, None, 50.0], walked("up minus down", K=-3.0)
    return {
        "belt_summary": summary_rows(K_s=686.2, unloading=640.0),
        "transmission_summary": summary_rows(B_j=0.45, J_j=0.0051, VAF=99.2),
        "transmission": pl.DataFrame(
            {"amplitude_deg": [None, None, None, 2.0], "VAF": vaf, "doubtful": [""] * 4}
        ),
        "impedance": impedance(),
        "walking_summary": pl.concat(
            [walked(K=338.0, I=-0.012), walked("mean of perturbations", K=1.0), turns]
        ),
        "walking": pl.DataFrame({"VAF": [96.0, 98.0, float("nan")], "doubtful": ["", "", None]}),
    }


def by_name(tables, example=None):
    return {one.name: one for one in facts_of(headline_numbers(tables, example))}


def of_json(number):
    """A headline number of `summary.json`."""
    return headlines_in_summary({"numbers": {"x": number}})["x"]


def written(numbers):
    """The summary as `summary.json` has it."""
    return json.loads(to_json(MADE, list(numbers)))


HEADLINES = [
    # name, value, low, high, n, draft, how its interval begins
    ("K_s", 686.2, 0.99 * 686.2, 1.01 * 686.2, 10, 685.6, STUDENT),
    ("B_j", 0.45, 0.99 * 0.45, 1.01 * 0.45, 10, 0.452, STUDENT),
    ("transmission_VAF", 99.2, 99.0, 99.4, 2, 99.1, RANGE),  # of all amplitudes together
    ("walking_K", 338.0, 0.99 * 338, 1.01 * 338, 10, 340.0, BOOTSTRAP),
    ("walking_K_up_minus_down", -3.0, -2.97, -3.03, 10, None, BOOTSTRAP),
    ("walking_VAF", 97.0, 96.0, 98.0, 2, None, RANGE),  # without the fit that has none
    ("VAF_median_compensated", 98.0, 90.0, 99.0, 3, None, RANGE),  # over single amplitudes
    ("VAF_mean_compensated", 287 / 3, 90.0, 99.0, 3, None, RANGE),
    ("K_bias_compensated", -1.0, -3.0, 1.0, 2, None, RANGE),  # over trials, all amplitudes each
    ("K_bias_uncompensated", -30.0, None, None, 1, None, None),
    ("K_example_compensated", 303.0, 299.0, 307.5, 1, None, FOR_MOTION),
    ("I_example_compensated", 0.02, 0.01, 0.03, 1, None, FOR_MOTION),
    ("B_viscous_example_compensated", 5.2, 5.1, 5.3, 1, None, FOR_MOTION),
    ("f_C_example_compensated", 0.3, 0.2, 0.4, 1, None, FOR_MOTION),
]


@pytest.mark.parametrize(("name", "value", "low", "high", "n", "draft", "interval"), HEADLINES)
def test_a_headline_has_value_interval_number_and_the_draft_s_value(
    name, value, low, high, n, draft, interval
):
    found = by_name(all_tables())
    row = written(headline_numbers(all_tables()))["numbers"][name]
    assert [row[key] for key in ("value", "low", "high", "draft")] == pytest.approx(
        [value, low, high, draft]
    )
    assert (row["n"], row["interval"], row["unit"]) == (n, interval, found[name].unit)
    assert not {"VAF_median_uncompensated", "f_C_example_uncompensated"} & {*found}


def test_the_example_says_how_far_single_amplitudes_spread():
    numbers = headline_numbers(all_tables())
    K = written(numbers)["numbers"]["K_example_compensated"]
    assert (K["amplitudes_low"], K["amplitudes_high"]) == pytest.approx((300.96, 304.06))
    for end, number in (("", "303.0"), ("AmplitudesLow", "301.0"), ("AmplitudesHigh", "304.1")):
        assert rf"\oslCompensatedExampleStiffness{end}}}{{{number}}}" in to_tex(MADE, numbers)
    assert (
        f"299.0 to 307.5, {FOR_MOTION}; single amplitudes 301.0 to 304.1"
        in format_results_table(written(numbers))
    )
    again = pl.concat(
        [impedance(), impedance().filter(pl.col("K") == 303.0).with_columns(K=pl.lit(297.0))]
    )
    repeated = by_name({"impedance": again})["K_example_compensated"]
    assert (repeated.value, repeated.low, repeated.high, repeated.n, repeated.interval) == (
        300,
        297,
        303,
        2,
        RANGE,
    )
    for same in ({"K_d": 300.0}, {"B_d": 5.0}):  # the example has both
        one = by_name(
            {"impedance": impedance().with_columns(**{k: pl.lit(v) for k, v in same.items()})}
        )
        assert (one["K_example_compensated"].value, one["K_example_compensated"].n) == (303, 1)
    few = impedance().with_columns(
        interval_method=pl.lit("repeats"), K_amplitudes_high=pl.lit(301.1)
    )
    K = written(headline_numbers({"impedance": few}))["numbers"]["K_example_compensated"]
    # not 303.00, as by the range
    assert (K["interval"], written_number(of_json(K).estimate).value) == (FOR_REPETITION, "303.0")


def test_trials_of_no_stated_condition_have_their_own_numbers():
    """Where none has amplitudes, no label names them."""
    whole = impedance().filter(pl.col("amplitude_deg").is_null())
    none = {name: pl.lit(None, pl.Float64) for name in ("K_d", "B_d")} | {
        "controller": pl.lit(None, pl.String)
    }
    unstated = whole.with_columns(**none, trial=pl.Series(["a", "b", "c"]))
    found = by_name({"impedance": unstated}, Example(None, None))
    K = {name: (one.value, one.low) for name, one in found.items() if name.startswith("K_example")}
    assert K == {
        f"K_example_no_controller ({name})": ends
        for name, ends in zip("abc", [(303, 299), (97, 95), (210, 208)], strict=True)
    }
    assert {f"{name}_example_no_controller (a)" for name in ("B", "I", "f_C")} <= {*found}
    assert "amplitude" not in found["VAF_mean_no_controller"].meaning


@pytest.mark.parametrize(("value", "low", "high", "said"), [
    (2.0, 1.9991, 2.0003, ("2.000", "1.9991 to 2.0003")), (120.04, 120.01, 120.07,
     ("120.04", "120.01 to 120.07")),
    (119.99, 119.97, 120.02, ("120.0", "119.97 to 120.02")), (5.0123, 4.8, 5.2,
     ("5.01", "4.80 to 5.20")),
    (3.0, 3.0, 3.4, ("3.00", "3.00 to 3.40")),
])  # fmt: skip
def test_no_number_reads_as_an_end_of_its_interval_or_as_beyond_it(value, low, high, said):
    assert written_number(HeadlineValue(value, low, high, STUDENT))[:2] == said


def test_a_campaign_without_numbers_of_the_draft_has_no_column_of_them():
    own = of_json(NOTHING | {"value": 1.0, "interval": None})
    drafted = replace(own, label=replace(own.label, draft=2.0))
    assert "draft" not in to_table([own], False)
    assert "| draft |" in to_table([own, drafted], True)


def test_a_number_whose_interval_holds_zero_is_about_zero_unless_that_is_a_range():
    estimate = HeadlineValue(1e-4, -1e-5, 2e-4, STUDENT)

    of_interval = number_texts(estimate, "1").value
    of_range = number_texts(replace(estimate, interval=RANGE), "1").value

    assert (of_interval, of_range) == ("≈ 0", "1.00·10⁻⁴")


def test_torque_over_angle_is_said_from_its_lowest_to_its_highest_stiffness():
    foot = LABELS["torque_angle"]["K"]
    stiffness = {"a": 5.0, "b": 4.0, "c": 9.0, "d": 6.0}
    each = [Headline(of_group(foot, name), HeadlineValue(K, n=3)) for name, K in stiffness.items()]

    (said,) = first_sentences(each)

    assert said.replace("\xa0", " ").endswith("4.00 N·m/rad (b; n = 3) to 9.00 N·m/rad (c; n = 3).")


def test_only_a_campaign_of_the_draft_s_device_is_compared_with_the_draft():
    assert {one.label.draft for one in headline_numbers(all_tables(), beside_draft=False)} == {None}
    config = read_config(ROOT / "config/config.yaml")
    for changes, expected in (
        ({}, True),
        ({"simulation": None}, False),
        ({"parameters": None}, False),
    ):
        campaign = Campaign(config.model_copy(update=changes), {}, {})
        assert campaign.beside_draft is expected, changes
        for asked in (True, False):
            report = config.report.model_copy(update={"beside_draft": asked})
            assert (
                Campaign(campaign.config.model_copy(update={"report": report}), {}, {}).beside_draft
                is asked
            )


def test_torque_against_angle_has_numbers_of_every_trial():
    rows = {
        "trial": ["slow_1", "fast"],
        "cycles": [1, 4],
        "doubtful": ["", "loop that does not close"],
    }
    for name in ("K", "energy_stored", "energy_returned", "energy_lost"):
        rows |= {name: [90.0, 95.0], f"{name}_low": [None, 94.0], f"{name}_high": [None, 96.0]}
    found = by_name({"torque_angle": pl.DataFrame(rows)})
    slow, fast = found["torque_angle_K (slow_1)"], found["energy_lost (fast)"]
    assert (slow.value, slow.low, slow.interval, slow.n, slow.doubt) == (90, None, None, 1, None)
    assert (fast.value, fast.low, fast.high, fast.n, fast.doubt is None, fast.unit) == (
        95,
        94,
        96,
        4,
        False,
        "J",
    )
    assert (slow.macro, fast.macro) == ("TorqueAngleStiffnessSlowOne", "EnergyLostFast")
    tex = to_tex(MADE, headline_numbers({"torque_angle": pl.DataFrame(rows)}))
    assert ", n = 4, DOUBTFUL: loop that does not close\n" in tex


def test_every_line_of_the_macros_is_a_comment_or_a_definition():
    number = r"-?\d+(\.\d+)?(\\times 10\^\{-\d+\})?"
    definition = (
        rf"\\newcommand\{{\\[A-Za-z]+\}}\{{({number}|\\ensuremath\{{{number}\}})\}}% [ -~]*"
    )
    lines = to_tex(MADE, headline_numbers(all_tables())).splitlines()
    assert len(lines) > 40
    facts = [
        line
        for line in lines
        if re.match(rf"\\newcommand{{\\osl({'|'.join(ABOUT_MACROS.values())})}}", line)
    ]
    assert len(facts) == len(ABOUT_MACROS)
    assert all(re.fullmatch(rf"%.*|{definition}", line) for line in lines if line not in facts)
    names = re.findall(r"newcommand\{\\(\w+)\}", "".join(lines))
    assert len(set(names)) == len(names)
    assert {"oslBeltStiffness", "oslBeltStiffnessLow", "oslUncompensatedStiffnessBias"} < {*names}
    assert "oslUncompensatedStiffnessBiasLow" not in names, "it has no interval"


@pytest.mark.parametrize(("value", "low", "high", "interval", "text"), [
    (685.6432, 682.9, 688.4, STUDENT, "685.6"), (0.45213, 0.4480, 0.4562, STUDENT, "0.4521"),
    (-0.01234, -0.0223, -0.0024, STUDENT, r"\ensuremath{-0.0123}"),
    (-0.0004, -1.0, 1.0, STUDENT, "0.0"),
    (5.04e-5, 4.9e-5, 5.2e-5, STUDENT, r"\ensuremath{5.04\times 10^{-5}}"),
    (0.0, None, None, STUDENT, "0"),
    (95.84, 74.0, 99.2, RANGE, "95.8"),  # a range over trials does not blunt the mean
    (99.961, 99.951, 99.968, RANGE, "99.96"),  # its ends read differently
    (340.0, 340.0, 340.0 + 1e-13, STUDENT, "340"),  # rounding errors are no interval
])  # fmt: skip
def test_values_are_rounded_to_two_digits_of_half_the_interval_or_to_three_digits(
    value, low, high, interval, text
):
    label = HeadlineLabel("x", "1", None, "X", "a number")
    headline = Headline(label, HeadlineValue(value, low, high, interval, 1))
    assert rf"\oslX}}{{{text}}}%" in to_tex(MADE, [headline])


def test_files_are_written_from_the_tables_that_exist_and_read_back(tmp_path):
    paths = {name: tmp_path / f"{name}.csv" for name in (*all_tables(), "gains")}
    for name, table in all_tables().items():
        write_table(table, paths[name])
    write_summary(
        about=MADE,
        table_paths=paths,
        summary_json=tmp_path / "s.json",
        numbers_tex=tmp_path / "n.tex",
    )
    summary, numbers = read_summary(tmp_path / "s.json"), headline_numbers(all_tables())
    assert summary == written(numbers) | {
        "trials": {},
        "missing_results": {},
        "intervals": "",
        "findings": [],
    }
    assert (tmp_path / "n.tex").read_text() == to_tex(MADE, numbers)
    (tmp_path / "s.json").rename(tmp_path / "summary.json")
    table, entries = osl_analysis.read_summary(tmp_path), summary["numbers"]
    assert table.to_dicts() == [
        dict.fromkeys(table.columns) | {"quantity": name} | entries[name] for name in entries
    ]


def test_missing_trials_are_counted_with_the_reason_in_the_summary(tmp_path, monkeypatch):
    """A belt trial is refused, an impedance trial excluded by a check, another by the sheet."""
    lost = Refusal(
        "b_1", "raw/b_1.mcap", "ingest", "refused", "raw/b_1.mcap: no such file", "copy it there"
    )
    walking = Refusal(
        "", "t/walking.csv", "j", "refused", "t/walking.csv: 1 perturbation", "record more"
    )
    verdict = {
        "trial": "i_2",
        "check": "gap",
        "value": 0.071,
        "unit": "s",
        "threshold": 0.05,
        "verdict": "exclude",
    }
    # the first is said
    rows = [verdict | {"remark": "theta; late"}, verdict | {"check": "rate", "remark": "slow"}]
    write_table(pl.DataFrame(rows), tmp_path / "quality.csv")
    tables.list_excluded(
        tmp_path / "quality.csv", {"i_9": "stumbled"}, tmp_path / "excluded.csv", [lost, walking]
    )
    ends = {"summary_json": "s.json", "numbers_tex": "n.tex", "excluded": "excluded.csv"}
    files = {name: tmp_path / file for name, file in ends.items()}
    experiments = {"b": "belt", "i": "impedance", "s": "static"}
    names = ("b_1", "b_2", "i_1", "i_2", "i_3", "i_9", "s")
    sheet = {name: {"trial": name, "experiment": experiments[name[0]]} for name in names}
    fitted = {"belt": ["b_2"], "impedance": ["i_1", "i_3"]}
    for name, of_table in fitted.items():
        write_table(pl.DataFrame({"trial": of_table}), tmp_path / f"{name}.csv")
    table_paths = {name: tmp_path / f"{name}.csv" for name in fitted}
    monkeypatch.setattr(tables, "headline_numbers", lambda *_: {})
    write_summary(
        about=MADE, table_paths=table_paths, sheet=sheet, refused=[lost, walking], **files
    )
    summary = read_summary(tmp_path / "s.json")
    counts = {
        name: (one["used"], one["of"], [*one["missing"]]) for name, one in summary["trials"].items()
    }
    assert counts == {
        "belt": (1, 2, ["b_1"]),
        "impedance": (2, 4, ["i_2", "i_9"]),
        "static": (1, 1, []),
    }
    assert (
        summary["trials"]["impedance"]["missing"]["i_2"]
        == "gap 0.071 s, threshold 0.05: theta, late"
    )
    assert summary["missing_results"] == {"t/walking.csv": "1 perturbation"}
    said = format_results_table(summary)
    assert [one for one in ("b_1", "no t/walking.csv: 1 perturbation") if one not in said] == []


NOTHING = dict.fromkeys(("low", "high", "interval", "draft", "doubt")) | {
    "unit": "",
    "n": 3,
    "meaning": "x",
}
NUMBER = json.dumps({"campaign": "made", "numbers": {"K_s": {"value": 1.5} | NOTHING}})


@pytest.mark.parametrize(("content", "message"), [
    (None, "no such summary"),
    ('{"campaign": "made", "numbers": {"K_s": {"value": 3}}}',
     r"field 'numbers\.K_s\.unit' is missing"),
    (NUMBER.replace("1.5", '"much"'), r"numbers\.K_s\.value: 'much' is not allowed"),
    (NUMBER.replace("1.5", "NaN"), r"numbers\.K_s\.value: nan is not allowed"),
    ("[" * 100_000, "not a summary"),
])  # fmt: skip
def test_a_missing_or_broken_summary_is_refused(tmp_path, content, message):
    if content is not None:
        (tmp_path / "summary.json").write_text(content)
    with pytest.raises(InputError, match=message):
        read_summary(tmp_path / "summary.json")


def test_the_error_of_the_damping_is_without_friction_where_this_is_certain():
    rubs, whole = impedance(), pl.col("amplitude_deg").is_null()
    error = by_name({"impedance": rubs.filter(whole)})["B_error_compensated"]
    assert (error.value, "viscous where friction is certain" in error.meaning) == (
        pytest.approx((0.2 + 0.1) / 2),
        True,
    )
    none = rubs.filter(whole).with_columns(B_viscous=pl.lit(None, pl.Float64))
    recorded = by_name({"impedance": none})["B_error_compensated"]
    assert (recorded.value, "friction" in recorded.meaning) == (
        pytest.approx((0.5 + 0.1) / 2),
        False,
    )
    assert by_name({"impedance": rubs})["B_example_compensated"].value == 5.5, (
        "as recorded, beside it"
    )


def compensated():
    """Fits over all amplitudes with one controller."""
    return impedance().filter(pl.col("amplitude_deg").is_null(), controller="compensated")


def far_off(**columns):
    """A doubtful trial whose K is 600 and whose B is 60, of a condition of its own."""
    found = {"K": 600.0, "B": 60.0, "K_d": 200.0, "doubtful": "K_ratio 3", **columns}
    return compensated().head(1).with_columns(**{name: pl.lit(one) for name, one in found.items()})


def counts_of(headline):
    return headline.n, headline.n_doubtful, headline.n_left_out


def test_a_doubtful_trial_is_in_the_mean_where_it_is_alone_in_its_condition():
    found = by_name({"impedance": pl.concat([impedance(), far_off()])})

    bias, error = found["K_bias_compensated"], found["B_error_compensated"]
    assert bias.value == pytest.approx((-1.0 - 1.0 + 200.0) / 3)
    assert counts_of(bias) == counts_of(error) == (3, 1, 0)
    assert counts_of(found["K_bias_uncompensated"]) == (1, 1, 0)
    assert counts_of(found["VAF_mean_compensated"]) == (3, 1, 0)


def test_a_doubtful_trial_that_a_sound_one_repeats_is_left_out():
    repeated = far_off(K_d=compensated()["K_d"][0])

    found = by_name({"impedance": pl.concat([impedance(), repeated])})

    bias = found["K_bias_compensated"]
    assert bias.value == pytest.approx(-1.0)
    assert (bias.n, bias.n_left_out) == (2, 1)
    assert found["B_error_compensated"].value == pytest.approx(0.15)


def test_a_vaf_of_another_motion_counts_beside_those_of_single_amplitudes():
    fits = impedance().with_columns(trial=pl.lit("a"))
    other = far_off(trial="b", VAF=97.0).select(fits.columns)

    number = by_name({"impedance": pl.concat([fits, other])})["VAF_mean_compensated"]

    assert (number.n, number.value) == (4, 96.0)


def test_a_headline_has_the_doubts_of_its_summary():
    doubts = {"n_doubtful": 2, "n_left_out": 2, "doubt": pl.lit("late")}

    K_s = by_name({"belt_summary": summary_rows(K_s=686.2).with_columns(**doubts)})["K_s"]

    assert (K_s.n_left_out, K_s.doubt) == (2, "late")


def test_a_headline_of_a_group_is_named_by_it():
    slow = walked(K=3.0).with_columns(group=pl.lit("K_d 2"))

    K = by_name({"walking_summary": slow})["walking_K (K_d 2)"]

    assert (K.draft, K.macro[-5:], K.meaning[-7:]) == (None, "KdTwo", ", K_d 2")


def test_numbers_that_a_failed_run_left_behind_are_said_to_be_old(tmp_path):
    summary = tmp_path / "summary.json"
    summary.write_text("{}")
    for job, later, outcome, old in (
        ("ingest.before", -1, "refused", False), ("figure.fig5", 1, "failed", False),
        ("bench.fine", 1, "done", False),
        ("ingest.after", 1, "refused", True),
    ):  # fmt: skip
        log = tmp_path / f"logs/{job}.log"
        write_log(log, {"job": job, "outcome": outcome, "error": "b_1.mcap: no such file"}, {})
        os.utime(log, (summary.stat().st_mtime + later,) * 2)
        said = "1 jobs were refused or failed, first ingest.after: b_1.mcap: no such file"
        assert (said in tables.later_failures(summary)) == old


def test_a_finding_that_is_read_is_the_finding_that_was_written():
    finding = Finding(
        name="friction",
        table="impedance",
        subject="t",
        grade=Grade.DOUBTS,
        evidence=(Beyond("coulomb_share", 0.6, 0.05, "above"), Beyond("VAF", 80.0, 98.0, "below")),
        amplitude_deg=2.0,
        sizes={"B": 0.5},
        without={"B": 1.0, "B_low": 0.9, "B_high": 1.1},
        title="friction",
    )
    unchecked = Finding("shoe_stiffness", "walking_groups", "all", Grade.UNCHECKED, title="shoe")
    written = [WordedFinding(one, Words("says", "", "do")) for one in (finding, unchecked)]

    assert findings_of_frame(findings_frame(written)) == written


def test_a_finding_in_the_table_is_the_finding_that_was_made():
    evidence = (Beyond("lag_share", 0.1, 0.05, "above"), Beyond("VAF", 90.0, 98.0, "below"))
    without = {
        f"{name}{end}": k + 10.0 * way
        for k, name in enumerate("KBI")
        for way, end in enumerate(("", "_low", "_high"))
    }
    finding = Finding(
        "late_torque",
        "impedance",
        "t",
        Grade.DOUBTS,
        evidence,
        4.0,
        sizes={"B": 0.5},
        without=without,
    )
    table = findings_frame([WordedFinding(finding, Words("says", "size", "remedy"))])
    numbers = ("evidence", "value", "limit", "limit_side")
    assert table.select(numbers).rows() == [
        (one.column, one.value, one.limit, one.side) for one in evidence
    ]
    for row in table.drop(numbers).to_dicts():
        found = {
            name.replace("_without", ""): value for name, value in row.items() if "_without" in name
        }
        assert found == without
        sizes = (row["K_size"], row["B_size"], row["I_size"])
        assert (row["finding"], row["grade"], row["amplitude_deg"], sizes) == (
            1,
            "doubts",
            4.0,
            (None, 0.5, None),
        )


def test_what_a_doubt_condemns_is_not_recommended_by_a_note_on_the_same_row():
    row = pl.DataFrame(
        {
            "trial": ["a"],
            "I_high": [-0.01],
            "fault_harm": [20.0],
            "fault": ["delay"],
            "fault_family": ["path"],
            "K_over_K_s": 0.4,
            "K_drift": 0.0,
        }
    )
    for limit, remedy in ((1.0, Remedy.DOUBTED), (30.0, Remedy.WHOLE)):
        (found,) = judged(row, Limits(above={"fault_harm": limit}), "impedance")
        notes = [one.remedy for one in found if one.cause == "I is significantly negative"]
        assert notes == [remedy]


def test_predictions_are_off_by_medians_in_percent_of_K_and_in_units_of_B():
    predicted = pl.DataFrame({
        "joint": ["ankle"] * 3, "side": ["left"] * 3, "doubtful": [""] * 3,
        "VAF": [90.0, 95.0, 99.0], "VAF_fitted": [89.0, 96.0, 98.0],
        "K": [110.0, 90.0, 230.0], "K_measured": [100.0, 100.0, 200.0],
        "B": [2.0, 3.0, 4.0], "B_measured": [2.5, 3.1, 3.8],
    })  # fmt: skip

    numbers = {name: number.value for name, number in by_name({"prediction": predicted}).items()}

    assert numbers == {
        "prediction_VAF": 95.0,
        "prediction_better": 2.0,
        "prediction_K": pytest.approx(10.0),
        "prediction_B": pytest.approx(0.2),
    }
