"""Which fits are doubtful: limits on any column of a table, and what becomes of the mark on its way to the reader."""

import polars as pl
import pytest
import yaml

from osl_analysis.campaign.configuration import read_section
from osl_analysis.commands.tables import gather
from osl_analysis.errors import InputError
from osl_analysis.jobs.job import reason_and_remedy
from osl_analysis.judge import doubts as judgements
from osl_analysis.judge.doubts import doubtful_count, marked, not_checked_line, summary_of_trials
from osl_analysis.judge.findings import finding, findings, findings_report
from osl_analysis.judge.recording import CHECKS
from osl_analysis.judge.table import Doubt, DoubtfulFits
from osl_analysis.table import read_table, write_table

NO_CHECKS = pl.DataFrame(schema=["check", "verdict"])


def fits(**columns):
    return pl.DataFrame({"trial": ["a", "b"], **columns})


def doubts(row, above, below):
    table = pl.DataFrame([row], infer_schema_length=None)
    return marked(table, Doubt(above=above, below=below), "impedance")["doubtful"][0]


def test_a_fit_is_doubtful_for_every_limit_that_it_passes_and_says_which():
    row = {"fit": 80.0, "lag": -0.7, "condition": 5.0, "held_out": None, "n": 3}
    reasons = doubts(row, {"lag": 0.5, "condition": 10, "n": 2}, {"fit": 90, "held_out": 80})
    assert reasons == "lag -0.7 is below -0.5; n 3 is above 2; fit 80 is below 90"
    assert doubts(row, {"lag": 0.7, "condition": None}, {"fit": 80}) == ""
    assert doubts({"fit": float("nan")}, {}, {"fit": 90}) == "fit is not a number"
    both = {"held_out": -95.0, "lag": -95.0}  # a lower limit is on the value, an upper one on its size
    assert doubts(both, {"lag": 90}, {"held_out": 90}) == "lag -95 is below -90; held_out -95 is below 90"


def test_a_doubt_begins_with_its_cause_and_a_misfit_that_this_explains_is_no_doubt_of_its_own():
    row = {"coulomb_share": 0.6, "VAF": 80.0, "odd_harmonics": 0.3}
    said = doubts(row, {"coulomb_share": 0.5, "odd_harmonics": 0.25}, {"VAF": 90})
    assert said.startswith("friction: it does not grow with the motion")
    assert "60 % of B is Coulomb friction and not damping" in said
    assert said.endswith("[coulomb_share 0.6 is above 0.5, odd_harmonics 0.3 is above 0.25, VAF 80 is below 90]")
    assert doubts(row, {}, {"VAF": 90}).startswith("model that does not fit: ")
    assert "single amplitudes" not in said, "there are none"
    rows = pl.DataFrame({"trial": "a", "amplitude_deg": [2.0, None], "coulomb_share": [0.1, 0.6], "VAF": [80.0, 95.0]})
    said = marked(rows, Doubt(above={"coulomb_share": 0.5}, below={"VAF": 90}), "impedance")["doubtful"].to_list()
    assert all("Use the rows of single amplitudes, or the damping" in text for text in said)


def test_a_fault_of_the_recording_that_one_amplitude_alone_shows_accuses_nobody():
    """Friction passes for a late torque or a changing K at one amplitude; both would be there at all of them."""
    amplitudes = {"trial": ["a"] * 3, "amplitude_deg": [2.0, 4.0, None]}
    limits = Doubt(above={"lag_share": 0.05, "K_drift": 0.003}, below={"VAF": 90})
    alone = pl.DataFrame({**amplitudes, "lag_share": [0.0, 0.3, 0.0], "K_drift": [0.1, 0.0, None], "VAF": 95.0})
    assert marked(alone, limits, "impedance")["doubtful"].to_list() == ["", "", ""]
    everywhere = alone.with_columns(lag_share=pl.Series([0.1, 0.3, 0.1]), VAF=pl.Series([95.0, 95.0, 80.0]))
    said = marked(everywhere, limits, "impedance")["doubtful"].to_list()
    assert [text.partition(":")[0] for text in said] == ["late torque"] * 3
    assert "VAF 80 is below 90" in said[2]


def test_what_was_not_checked_has_a_row_each_and_a_certainly_negative_inertia_has_one():
    row = {"trial": "a", "K": 300.0, "B": 5.0, "I": -0.02, "I_high": -0.01}
    row |= {"not_checked": "K: no file; frame: no file; whether the torque is late: unseen"}
    line = not_checked_line(marked(pl.DataFrame([row]), Doubt(), "impedance"))
    begins = "NOT CHECKED: K, frame (no file); whether the torque is late (unseen, each ms of delay would "
    assert line.startswith(begins)
    assert "0.3 N*m*s/rad off B = 5 and 0.005 kg*m^2 off I = -0.02" in line
    assert "; whether I is an inertia (it is certainly negative, as no mass is" in line
    line = not_checked_line(marked(pl.DataFrame([row | {"I_high": 0.01, "J_j_high": -0.01}]), Doubt(), "impedance"))
    assert ("whether I is" in line, "whether J_j is an inertia" in line) == (False, True)
    assert not_checked_line(marked(pl.DataFrame([row | {"I_high": 1.0, "not_checked": None}]), Doubt(), "x")) == ""


def test_a_lag_at_the_end_of_those_that_were_tried_is_said_as_a_bound():
    for lag, signal, said in ((-0.01, "angle", "10000 us or more"), (0.0101, "torque", "10100 us")):
        row = {"lag_s": lag, "lag_share": 0.5, "lag_inertia_share": None, "band_high_hz": 5.0}
        assert f"a delay of the {signal} by {said} would explain it" in doubts(row, {"lag_share": 0.05}, {})


def test_a_factor_between_units_is_named_within_eight_percent():
    found = [judgements.known_factor(ratio) for ratio in (1.07 * 4.4482, 1 / 4.4482, 1.09 * 4.4482, 0.0)]
    assert found == ["4.45 is the factor between lbf and N"] * 2 + [""] * 2


def test_no_text_of_the_table_has_the_sign_that_separates_doubts_and_remedies_tell_what_to_do():
    for cause in (*judgements.CAUSES.values(), *(check.cause for check in CHECKS.values())):
        assert ";" not in cause.says + cause.remedy + cause.name
        assert ":" not in cause.name
        assert reason_and_remedy(f"{cause.name}; {cause.remedy}") == (cause.name, cause.remedy)


def test_a_limit_on_what_is_no_column_of_numbers_or_no_table_is_one_line_that_names_it(tmp_path):
    for column in ("VFA", "trial"):
        message = rf"doubtful\.belt: the table has no column '{column}' of numbers; put the limit on one of VAF"
        with pytest.raises(InputError, match=message):
            marked(fits(VAF=[80.0, 99.0]), Doubt(below={column: 1}), "belt")
    (tmp_path / "c.yaml").write_text(yaml.safe_dump({"doubtful": {"belts": {"below": {"VAF": 1}}}}))
    with pytest.raises(InputError, match=r"unknown table 'belts'; limits may stand on belt, transmission"):
        read_section(tmp_path / "c.yaml", "doubtful", DoubtfulFits)


def test_a_crossing_without_a_fit_is_neither_doubtful_nor_not():
    table = marked(fits(vaf=[None, 80.0], excluded=["no markers", None]), Doubt(below={"vaf": 90}), "walking")
    assert (table["doubtful"].to_list(), doubtful_count(table)) == ([None, "vaf 80 is below 90"], (1, 1))


def test_gathered_tables_carry_the_mark_and_the_end_of_the_run_says_so(tmp_path):
    for trial, vaf in (("belt_1", 80.0), ("belt_2", 99.5), ("belt_3", 80.0)):
        write_table(pl.DataFrame({"trial": [trial], "vaf": [vaf], "K_s": [vaf]}), tmp_path / f"{trial}.csv")
    rows = [tmp_path / f"belt_{k}.csv" for k in (1, 2, 3)]
    gather(rows, tmp_path / "belt.csv", Doubt(below={"vaf": 99}))
    gather(rows, tmp_path / "quality.csv")
    assert read_table(tmp_path / "belt.csv")["doubtful"].to_list() == ["vaf 80 is below 99", "", "vaf 80 is below 99"]
    assert "doubtful" not in read_table(tmp_path / "quality.csv").columns
    report = findings_report(NO_CHECKS, (tmp_path / f"{name}.csv" for name in ("belt", "quality", "absent")))
    assert report == "doubtful, 2 of 3 belt trials: vaf: vaf 80 is below 99 [belt_1, belt_3]"


def test_causes_and_trials_are_counted_and_not_the_rows_that_inherit_them():
    """Two of three trials have friction, one of them in four rows of two tables; one has a doubt of its own beside."""
    friction, late = "friction: it is [coulomb_share 0.6 is above 0.5]", "late torque: it is [lag_share 0.1]"
    fit = pl.DataFrame({"trial": ["a", "a", "b", "c"], "doubtful": [friction, friction, f"{friction}; {late}", ""]})
    inherited = pl.DataFrame({"trial": ["a", "a", "c"], "doubtful": [friction, f"impedance.csv: {friction}", late]})
    found = findings(NO_CHECKS, {"impedance": fit, "phasors": inherited})
    counts = [(one["cause"], one["trials"], one["n"]) for one in found]
    assert counts == [("friction", ["a", "b"], 3), ("late torque", ["b"], 3), ("late torque", ["c"], 2)]
    assert "3 impedance trials: friction: it does not grow" in found[0]["line"]
    assert found[2]["of"] == "impedance trials, in phasors.csv alone"
    causes = judgements.CAUSES["friction"], judgements.CAUSES["late torque"]
    assert [one["remedy"] for one in found[:2]] == [causes[0].otherwise, causes[1].remedy]


def test_a_check_that_flags_trials_is_said_with_its_cause_its_value_and_what_to_do():
    checks = {"trial": ["a", "b"], "check": ["gap"] * 2, "value": [0.0, 0.095], "unit": ["s"] * 2}
    table = pl.DataFrame(checks | {"verdict": ["pass", "flag"], "remark": ["", "torque"]})
    (said,) = findings_report(table, []).splitlines()
    assert said.startswith("flagged, 1 of 2 trials: gap in the recording: ")
    assert "as 0.095 s in b (torque). Look for a recorder" in said
    both = findings(table, {"belt": fits(doubtful=["", "x 2 is above 1"])})
    assert [one["verdict"] for one in both] == ["doubtful", "flagged"]


def test_a_finding_names_three_trials_or_those_that_it_spares_and_what_a_delay_takes_from_the_least_to_the_most():
    for n, judged, said in ((4, 7, " [all but t4, t5, t6]"), (4, 8, " [t0, t1, t2, ...]"), (1, 4, " [t0]"), (2, 2, "")):
        trials = [f"t{k}" for k in range(judged)]
        line = finding("flagged", "trials", "c", "s", "", trials[:n], trials)["line"]
        assert line == f"flagged, {n} of {judged} trials: c: s{said}"
    rows = {"trial": ["a", "b", "c"], "amplitude_deg": None, "K": [200.0, 300.0, 900.0], "B": [5.0, 4.0, 9.0]}
    late = ["whether the torque is late: unseen", "whether the torque is late: unseen", None]
    (said,) = findings(NO_CHECKS, {"impedance": pl.DataFrame(rows | {"I": [0.02, 0.03, 0.09], "not_checked": late})})
    takes = "0.2 to 0.3 N*m*s/rad off B = 4 to 5 and 0.004 to 0.005 kg*m^2 off I = 0.02 to 0.03"
    assert (said["trials"], said["n"], takes in said["line"]) == (["a", "b"], 3, True)


def test_a_mean_over_trials_leaves_out_doubtful_ones_while_half_are_sound_and_says_how_many():
    two = fits(K_s=[700.0, 690.0], doubtful=["", "clipped"])
    three = pl.concat([two, two.tail(1)])
    for table, said in ((two, (700.0, 1, 1, 1)), (three, (pytest.approx(2080 / 3), 3, 2, 0))):
        (summary,) = summary_of_trials(table, ["K_s"]).select("mean", "n", "n_doubtful", "n_left_out").rows()
        assert summary == said
    assert len(judgements.counted(two.drop("doubtful"))) == 2


def test_phasors_share_the_doubts_of_the_fit_of_their_trial_and_amplitude(tmp_path):
    fit = {"amplitude_deg": [2.0, 4.0, None], "vaf": [80.0, 95.0, 85.0]}
    phasors = {"amplitude_deg": [2.0, 2.0, 4.0], "distortion": [0.0, 9.0, 0.0]}
    for name, columns in (("impedance", fit), ("phasors", phasors)):
        write_table(pl.DataFrame({"trial": ["a"] * 3, **columns}), tmp_path / name / "a.csv")
    of, strict = [tmp_path / "impedance/a.csv"], Doubt(below={"vaf": 90})
    gather([tmp_path / "phasors/a.csv"], tmp_path / "phasors.csv", Doubt(above={"distortion": 1}), of, strict)
    inherited = "impedance.csv: vaf 80 is below 90"
    said = read_table(tmp_path / "phasors.csv")["doubtful"].to_list()
    assert said == [inherited, f"distortion 9 is above 1; {inherited}", ""]
