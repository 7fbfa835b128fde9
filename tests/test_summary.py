"""Headline numbers: the right ones, with their intervals, as JSON, LaTeX and Markdown that can be used as it is."""

import json
import os
import re

import polars as pl
import pytest

from osl_analysis.campaign.campaign import ABOUT_MACROS
from osl_analysis.commands import tables
from osl_analysis.commands.tables import format_results_table, read_summary, write_summary
from osl_analysis.errors import InputError
from osl_analysis.jobs.job_log import write_log
from osl_analysis.judge.findings import findings
from osl_analysis.refusal import Refusal
from osl_analysis.report import headlines
from osl_analysis.report.headlines import BOOTSTRAP, FIT, RANGE, STUDENT, headline_numbers, to_tex
from osl_analysis.table import write_table

MADE = {"campaign": "made", "data": "simulated", "version": "1.2.3", "configuration": "0a1b2c3d", "recorded": "seed 1"}


def summary_rows(**means):
    rows = ({"quantity": q, "n": 10, "mean": x, "low": 0.99 * x, "high": 1.01 * x} for q, x in means.items())
    return pl.DataFrame(list(rows))


def walked(estimator=headlines.HEADLINE_ESTIMATOR, **means):
    return summary_rows(**means).with_columns(estimator=pl.lit(estimator), group=pl.lit("all"))


def impedance():
    """Compensated K off by +1 % and -3 %, B by 0.5 and 0.1; VAF of single amplitudes 90, 98, 99."""
    columns = ("controller", "K_d", "B_d", "amplitude_deg", "K", "K_low", "K_high", "B", "B_low", "B_high", "VAF")
    single = ((2, 90.0), (4, 98.0), (6, 99.0))
    rows = [("compensated", 300.0, 5.0, a, 1.0, 0.0, 2.0, 1.0, 0.0, 2.0, v) for a, v in single]
    rows += [
        ("compensated", 300.0, 5.0, None, 303.0, 299.0, 307.5, 5.5, 5.4, 5.7, 10.0),
        ("compensated", 100.0, 0.0, None, 97.0, 95.0, 99.0, 0.1, 0.0, 0.2, 10.0),
        ("uncompensated", 300.0, 5.0, None, 210.0, 208.0, 212.0, 3.6, 3.5, 3.7, 10.0),
    ]
    table = pl.DataFrame(rows, schema=columns, orient="row").with_columns(interval_method=pl.lit("units"))
    whole, steps = pl.col("amplitude_deg").is_null(), {"low": -2.04, "high": 1.06}
    ends = {f"{q}_amplitudes_{end}": pl.when(whole).then(pl.col(q) + step) for q in "KB" for end, step in steps.items()}
    return table.with_columns(**ends, doubtful=pl.Series(["", "VAF 90 is below 95", "", "", "", "x"]))


def all_tables():
    vaf, turns = [99.0, 99.4, None, 50.0], walked("up minus down", K=-3.0)
    return {
        "belt_summary": summary_rows(K_s=686.2, unloading=640.0),
        "transmission_summary": summary_rows(B_j=0.45, J_j=0.0051, VAF=99.2),
        "transmission": pl.DataFrame({"amplitude_deg": [None, None, None, 2.0], "VAF": vaf, "doubtful": [""] * 4}),
        "impedance": impedance(),
        "walking_summary": pl.concat([walked(K=338.0, I=-0.012), walked("mean of perturbations", K=1.0), turns]),
        "walking": pl.DataFrame({"VAF": [96.0, 98.0, float("nan")], "doubtful": ["", "", None]}),
    }


def by_name(tables):
    return {h.name: h for h in headline_numbers(tables)}


def written(numbers):
    """The summary as `summary.json` has it."""
    return json.loads(headlines.to_json(MADE, list(numbers)))


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
    ("K_error_compensated", 2.0, 1.0, 3.0, 2, None, RANGE),  # over trials, all amplitudes each
    ("K_error_uncompensated", 30.0, None, None, 1, None, None),
    ("K_example_compensated", 303.0, 299.0, 307.5, 1, None, FIT),
]


@pytest.mark.parametrize(("name", "value", "low", "high", "n", "draft", "interval"), HEADLINES)
def test_a_headline_has_value_interval_number_and_the_draft_s_value(name, value, low, high, n, draft, interval):
    found = by_name(all_tables())
    row = written(found.values())["numbers"][name]
    assert [row[key] for key in ("value", "low", "high", "draft")] == pytest.approx([value, low, high, draft])
    assert (row["n"], row["interval"], row["unit"]) == (n, interval, found[name].unit)
    assert "VAF_median_uncompensated" not in found


def test_the_example_says_how_far_the_single_amplitudes_spread_and_is_rounded_to_that():
    numbers = headline_numbers(all_tables())
    K = written(numbers)["numbers"]["K_example_compensated"]
    assert (K["amplitudes_low"], K["amplitudes_high"]) == pytest.approx((300.96, 304.06))
    for end, number in (("", "303.0"), ("AmplitudesLow", "301.0"), ("AmplitudesHigh", "304.1")):
        assert rf"\oslCompensatedExampleStiffness{end}}}{{{number}}}" in to_tex(MADE, numbers)
    assert f"299.0 to 307.5, {FIT}; single amplitudes 301.0 to 304.1" in format_results_table(written(numbers))
    again = pl.concat([impedance(), impedance().filter(pl.col("K") == 303.0).with_columns(K=pl.lit(297.0))])
    repeated = by_name({"impedance": again})["K_example_compensated"]
    assert (repeated.value, repeated.low, repeated.high, repeated.n, repeated.interval) == (300, 297, 303, 2, RANGE)
    for same in ({"K_d": 300.0}, {"B_d": 5.0}):  # the example has both
        one = by_name({"impedance": impedance().with_columns(**{k: pl.lit(v) for k, v in same.items()})})
        assert (one["K_example_compensated"].value, one["K_example_compensated"].n) == (303, 1)
    few = impedance().with_columns(interval_method=pl.lit("repeats"), K_amplitudes_high=pl.lit(301.1))
    K = written(headline_numbers({"impedance": few}))["numbers"]["K_example_compensated"]
    assert (K["interval"], headlines.numbers_said(K)[0]) == (headlines.FEW, "303.0")  # not 303.00, as by the range


def test_doubtful_fits_are_counted_by_table_and_rows_without_a_fit_are_none():
    found = by_name(all_tables())
    counted = [found[f"doubtful_{name}"] for name in ("impedance", "walking")]
    assert [(one.value, one.n) for one in counted] == [(2, 6), (0, 2)]
    lines = format_results_table(written(found.values())).splitlines()
    assert "| doubtful trials in impedance.csv, whose column says why | 2 trials |  | 6 |  |" in lines
    assert not [line for line in lines if "in walking.csv" in line], "a count of none is left out"
    one = {"x": NOTHING | {"value": 1.5, "meaning": "a|b"}}
    assert headlines.to_table(one, markdown=False).splitlines()[1] == "a|b       1.50             3"
    assert headlines.to_table(one, markdown=True).splitlines()[-1] == "| a\\|b | 1.50  |  | 3 |  |"
    interval = "679.3 to 693.1, 95 % of the mean (Student)"
    assert f"| belt stiffness while loading, mean of trials | 686.2 N*m/rad | {interval} | 10 | 685.6 |" in lines
    # a table that shares the doubts of another counts trials with a cause of their own
    shared, own = "impedance.csv: friction: x", "distorted motion: x"
    phasors = pl.DataFrame({"trial": ["a", "a", "b"], "doubtful": [shared, "friction: y", f"{own}; {shared}"]})
    fits = impedance().with_columns(pl.Series("trial", list("aaabbb")), doubtful=pl.lit("friction: x"))
    for table, counts in ((impedance(), (2, 2)), (fits, (1, 2))):
        found = by_name({"impedance": table, "phasors": phasors})
        assert (found["doubtful_phasors"].value, found["doubtful_impedance"].value) == counts


def test_torque_against_angle_has_numbers_of_every_trial_with_an_interval_over_cycles_where_there_is_one():
    rows = {"trial": ["slow_1", "fast"], "cycles": [1, 4], "doubtful": ["", "cycle_drift 0.1 is above 0.05"]}
    for name in ("K", "energy_stored", "energy_returned", "energy_lost"):
        rows |= {name: [90.0, 95.0], f"{name}_low": [None, 94.0], f"{name}_high": [None, 96.0]}
    found = by_name({"torque_angle": pl.DataFrame(rows)})
    slow, fast = found["torque_angle_K (slow_1)"], found["energy_lost (fast)"]
    assert (slow.value, slow.low, slow.interval, slow.n, slow.doubt) == (90, None, None, 1, None)
    assert (fast.value, fast.low, fast.high, fast.n, fast.doubt is None, fast.unit) == (95, 94, 96, 4, False, "J")
    assert (slow.macro, fast.macro) == ("TorqueAngleStiffnessSlowOne", "EnergyLostFast")
    assert ", n = 4, DOUBTFUL: cycle_drift 0.1 is above 0.05\n" in to_tex(MADE, [fast])


def test_gains_of_rival_models_have_the_interval_of_their_paired_difference_and_a_mean_that_is_nan_is_refused():
    columns = ("experiment", "controller", "model", "trials", "VAF_gain", "VAF_gain_low", "VAF_gain_high")
    rows = [("belt", None, "M3", 10, 0.02, 0.01, 0.03), ("belt", None, "M4", 10, 0.03, 0.02, 0.04)]
    rows += [("transmission", None, "M2", 1, None, None, None), ("impedance", "uncompensated", "M3", 16, 3.7, 1.5, 5.9)]
    found = by_name({"model_comparison_summary": pl.DataFrame(rows, columns, orient="row")})
    told = [(name, h.value, h.low, h.high, h.n, h.interval) for name, h in found.items()]
    assert told == [
        ("belt_VAF_gain", 0.03, 0.02, 0.04, 10, headlines.PAIRED),
        ("drivetrain_VAF_gain_uncompensated", 3.7, 1.5, 5.9, 16, headlines.PAIRED),
    ]
    with pytest.raises(InputError, match="the mean of 'B_j' is nan"):
        headline_numbers({"transmission_summary": summary_rows(B_j=float("nan"))})


def test_every_line_of_the_macros_is_a_comment_or_one_definition_that_latex_accepts():
    number = r"-?\d+(\.\d+)?(\\times 10\^\{-\d+\})?"
    definition = rf"\\newcommand\{{\\[A-Za-z]+\}}\{{({number}|\\ensuremath\{{{number}\}})\}}% [ -~]*"
    lines = to_tex(MADE, headline_numbers(all_tables())).splitlines()
    assert len(lines) > 40
    facts = [line for line in lines if re.match(rf"\\newcommand{{\\osl({'|'.join(ABOUT_MACROS.values())})}}", line)]
    assert len(facts) == len(ABOUT_MACROS)
    assert all(re.fullmatch(rf"%.*|{definition}", line) for line in lines if line not in facts)
    names = re.findall(r"newcommand\{\\(\w+)\}", "".join(lines))
    assert len(set(names)) == len(names)
    assert {"oslBeltStiffness", "oslBeltStiffnessLow", "oslUncompensatedStiffnessError"} < {*names}
    assert "oslUncompensatedStiffnessErrorLow" not in names, "it has no interval"


@pytest.mark.parametrize(("value", "low", "high", "interval", "text"), [
    (685.6432, 682.9, 688.4, STUDENT, "685.6"), (0.45213, 0.4480, 0.4562, STUDENT, "0.4521"),
    (-0.01234, -0.0223, -0.0024, STUDENT, r"\ensuremath{-0.0123}"), (-0.0004, -1.0, 1.0, STUDENT, "0.0"),
    (5.04e-5, 4.9e-5, 5.2e-5, STUDENT, r"\ensuremath{5.04\times 10^{-5}}"), (0.0, None, None, STUDENT, "0"),
    (95.84, 74.0, 99.2, RANGE, "95.8"),  # a range over trials does not blunt the mean
    (99.961, 99.951, 99.968, RANGE, "99.96"),  # its ends read differently
    (340.0, 340.0, 340.0 + 1e-13, STUDENT, "340"),  # rounding errors are no interval
])  # fmt: skip
def test_values_are_rounded_to_two_digits_of_half_the_interval_or_to_three_digits(value, low, high, interval, text):
    headline = headlines.Headline("x", "1", None, "X", "a number", value, low, high, interval, 1)
    assert rf"\oslX}}{{{text}}}%" in to_tex(MADE, [headline])


def test_files_are_written_from_the_tables_that_exist_and_read_back(tmp_path):
    paths = {name: tmp_path / f"{name}.csv" for name in (*all_tables(), "gains")}
    for name, table in all_tables().items():
        write_table(table, paths[name])
    write_summary(about=MADE, table_paths=paths, summary_json=tmp_path / "s.json", numbers_tex=tmp_path / "n.tex")
    summary, numbers = read_summary(tmp_path / "s.json"), headline_numbers(all_tables())
    said = json.loads(json.dumps(findings(pl.DataFrame(schema=["check", "verdict"]), all_tables())))
    assert said[0]["line"] in format_results_table(summary)
    assert summary == written(numbers) | {"trials": {}, "missing_results": {}, "findings": said}
    assert (tmp_path / "n.tex").read_text() == to_tex(MADE, numbers)


def test_missing_trials_are_counted_and_named_with_the_reason_in_every_form_of_the_summary(tmp_path):
    """A belt trial is refused, an impedance trial excluded by a check, another by the sheet: that is not missing."""
    lost = Refusal("b_1", "raw/b_1.mcap", "ingest", "refused", "raw/b_1.mcap: no such file", "copy it there")
    walking = Refusal("", "t/walking.csv", "j", "refused", "t/walking.csv: 1 perturbation", "record more")
    verdict = {"trial": "i_2", "check": "gap", "value": 0.071, "unit": "s", "threshold": 0.05, "verdict": "exclude"}
    rows = [verdict | {"remark": "theta; late"}, verdict | {"check": "rate", "remark": "slow"}]  # the first is said
    write_table(pl.DataFrame(rows), tmp_path / "quality.csv")
    tables.list_excluded(tmp_path / "quality.csv", {"i_9": "stumbled"}, tmp_path / "excluded.csv", [lost, walking])
    ends = {"summary_json": "s.json", "numbers_tex": "n.tex", "excluded": "excluded.csv"}
    files = {name: tmp_path / file for name, file in ends.items()}
    trials = {"belt": ["b_1", "b_2"], "impedance": ["i_1", "i_2", "i_3"], "static": ["s"]}
    write_summary(about=MADE, table_paths={}, trials=trials, refused=[lost, walking], **files)
    summary, refused = read_summary(tmp_path / "s.json"), "refused: raw/b_1.mcap: no such file; copy it there"
    assert summary["trials"] == {
        "belt": {"used": 1, "of": 2, "missing": {"b_1": refused}},
        "impedance": {"used": 2, "of": 3, "missing": {"i_2": "gap 0.071 s, threshold 0.05: theta, late"}},
        "static": {"used": 1, "of": 1, "missing": {}},
    }
    said, macros = format_results_table(summary).splitlines(), (tmp_path / "n.tex").read_text()
    assert f"1 of 2 belt trials; without b_1 ({refused})" in said
    assert said[-1] == "no t/walking.csv: 1 perturbation"
    assert "% 1 of 2 belt trials; without b_1\n% 2 of 3 impedance trials; without i_2\n% no t/walking.csv" in macros


NOTHING = dict.fromkeys(("low", "high", "interval", "draft")) | {"unit": "", "n": 3, "meaning": "x"}
NUMBER = json.dumps({"campaign": "made", "numbers": {"K_s": {"value": 1.5} | NOTHING}})


@pytest.mark.parametrize(("content", "message"), [
    (None, "no such summary"),
    ('{"campaign": "made", "numbers": {"K_s": {"value": 3}}}', r"field 'numbers\.K_s\.unit' is missing"),
    (NUMBER.replace("1.5", '"much"'), r"numbers\.K_s\.value: 'much' is not allowed"),
    (NUMBER.replace("1.5", "NaN"), r"numbers\.K_s\.value: nan is not allowed"), ("[" * 100_000, "not a summary"),
])  # fmt: skip
def test_a_missing_or_broken_summary_is_refused(tmp_path, content, message):
    if content is not None:
        (tmp_path / "summary.json").write_text(content)
    with pytest.raises(InputError, match=message):
        read_summary(tmp_path / "summary.json")


def test_headline_means_say_how_many_doubtful_trials_they_leave_out_or_contain():
    made = impedance()
    whole = made.filter(pl.col("amplitude_deg").is_null() & (pl.col("controller") == "compensated"))
    far = whole.head(1).with_columns(K=pl.lit(600.0), B=pl.lit(60.0), K_d=pl.lit(200.0), doubtful=pl.lit("K_ratio 3"))
    found = by_name({"impedance": pl.concat([made, far])})
    counts = {name: (h.n, h.n_doubtful, h.n_left_out) for name, h in found.items()}
    assert by_name({"impedance": made.with_columns(doubtful=pl.lit("x"))})["K_example_compensated"].n_doubtful == 1
    assert found["K_error_compensated"].value == pytest.approx(2.0)
    assert found["B_error_compensated"].value == pytest.approx(0.3)
    assert counts["K_error_compensated"] == counts["B_error_compensated"] == (2, 1, 1)
    assert counts["K_error_uncompensated"] == (1, 1, 0), "its only trial is doubtful"
    assert counts["VAF_mean_compensated"] == (3, 1, 0)
    alone = far.with_columns(trial=pl.lit("b"), VAF=pl.lit(97.0))  # of another motion, or of one amplitude
    number = by_name({"impedance": pl.concat([made.with_columns(trial=pl.lit("a")), alone])})["VAF_mean_compensated"]
    assert (number.n, number.value) == (4, 96.0)
    said = format_results_table(written(found.values())) + to_tex(MADE, list(found.values()))
    for words in ("| 2 of 3, 1 doubtful left out |", "| 1, 1 of them doubtful |", "n = 2 of 3, 1 doubtful left out"):
        assert words in said
    belts = summary_rows(K_s=686.2).with_columns(n_doubtful=pl.lit(2), n_left_out=pl.lit(2), doubt=pl.lit("late"))
    one = by_name({"belt_summary": belts})["K_s"]
    assert (one.n_left_out, one.doubt) == (2, "late")
    slow = by_name({"walking_summary": walked(K=3.0).with_columns(group=pl.lit("K_d 2"))})["walking_K (K_d 2)"]
    assert (slow.draft, slow.macro[-5:], slow.meaning[-7:]) == (None, "KdTwo", ", K_d 2")
    assert headlines.doubtful_label("walking_groups").unit == "groups"


def test_numbers_that_a_failed_run_left_behind_are_said_to_be_old(tmp_path):
    summary = tmp_path / "summary.json"
    summary.write_text("{}")
    for job, later, outcome, old in (
        ("ingest.before", -1, "refused", False), ("figure.fig5", 1, "failed", False), ("bench.fine", 1, "done", False),
        ("ingest.after", 1, "refused", True),
    ):  # fmt: skip
        log = tmp_path / f"logs/{job}.log"
        write_log(log, {"job": job, "outcome": outcome, "error": "b_1.mcap: no such file"}, {})
        os.utime(log, (summary.stat().st_mtime + later,) * 2)
        said = "1 jobs were refused or failed, first ingest.after: b_1.mcap: no such file"
        assert (said in tables.later_failures(summary)) == old
