"""Trials that quality control excludes are always named."""

import re

import numpy as np
import polars as pl
import pytest
from conftest import ROOT

from osl_analysis.campaign.configuration import read_section
from osl_analysis.commands.tables import judge, list_excluded
from osl_analysis.errors import InputError
from osl_analysis.judge.findings import Judge, exclusion_report, exclusions, without_excluded
from osl_analysis.judge.recording import examine, measured_table
from osl_analysis.judge.table import Commanded, QualityRules
from osl_analysis.refusal import Refusal
from osl_analysis.table import read_table, write_table
from osl_analysis.trial import Trial

RULES = read_section(ROOT / "config/config.yaml", "quality", QualityRules)
ACCEPT = {"plate_3": ["unzeroed_plate"]}
JUDGE = Judge(RULES, ACCEPT)
COLUMNS = ["trial", "check", "value", "unit", "threshold", "remark"]


@pytest.fixture
def checked(tmp_path):
    """What was measured on three plate trials: a slow one, which flags it, two with a plate that was not zeroed."""
    paths = []
    for name, offset, rate in (("plate_1", 1.0, 50), ("plate_2", -80.0, 1000), ("plate_3", -90.0, 1000)):
        force = offset + np.random.default_rng(1).standard_normal(1000)
        trial = Trial(name, pl.DataFrame({"time": np.arange(1000) / rate, "plate1_force_z": force}))
        paths.append(tmp_path / f"quality/{name}.csv")
        write_table(measured_table(name, examine(trial, "plate", Commanded((), (), 1))), paths[-1])
    return paths


def test_an_excluded_trial_is_left_out_and_an_accepted_one_is_not(checked):
    files = [f"fits/{name}.parquet" for name in ("plate_1", "plate_2", "plate_3")]
    inputs = {"trials": files, "table": "tables/plate_2.csv", "quality": list(map(str, checked))}
    used = {"trials": [files[0], files[2]], "table": "tables/plate_2.csv"}
    assert without_excluded(inputs, exclusions(JUDGE.verdicts(checked))) == used
    alone = {"trial": "trials/plate_1.parquet", "motion": ["trials/plate_2.parquet"], "quality": checked}
    assert without_excluded(alone, exclusions(JUDGE.verdicts(checked))) == {"trial": alone["trial"], "motion": []}
    assert exclusion_report(JUDGE.verdicts(checked[:1]), {}) == ""


def test_a_changed_threshold_judges_anew_what_was_measured(checked):
    content = RULES.model_dump(mode="json")
    wider = QualityRules.model_validate(content | {"unzeroed_plate": {"threshold": "85 N", "on_failure": "exclude"}})
    excluding = [exclusions(Judge(rules, {}).verdicts(checked)) for rules in (RULES, wider)]
    assert [list(reasons) for reasons in excluding] == [["plate_2", "plate_3"], ["plate_3"]]
    assert not {"threshold", "verdict"} & set(read_table(checked[0]).columns)


def test_who_was_left_out_is_listed_and_told_with_value_threshold_and_remedy(checked):
    folder = checked[0].parent
    judge(checked, RULES, ACCEPT, folder / "quality.csv")
    list_excluded(folder / "quality.csv", {"b_2": "stumbled"}, folder / "excluded.csv")
    verdicts = read_table(folder / "quality.csv").filter(pl.col("verdict") != "pass")
    assert verdicts.select("trial", "verdict").rows() == [("plate_1", "flag"), ("plate_2", "exclude")]
    listed = read_table(folder / "excluded.csv")
    assert listed.select("trial", "check").rows() == [("plate_2", "unzeroed_plate"), ("b_2", "sample sheet")]
    assert listed["value"][0] == pytest.approx(80, abs=0.5)
    told = exclusion_report(JUDGE.verdicts([*checked, folder / "missing.csv"]), {"b_2": "stumbled"})
    assert "excluded by the sample sheet: b_2 (stumbled)" in told
    assert re.search(r"plate_2 \(unzeroed_plate (80\.0|79\.9)\S* N, threshold 20\.0: plate1 -(80\.0|79\.9) N\)", told)
    assert "`accept`" in told


def test_a_trial_that_could_not_be_judged_is_in_both_lists_with_reason_and_remedy(checked):
    lost = Refusal("plate_9", "p.c3d", "ingest.ingest_trial", "refused", "p.c3d: truncated", "export it again")
    folder = checked[0].parent
    for judged, n in (([], 0), (checked, 3)):
        judge(judged, RULES, ACCEPT, folder / "quality.csv", [lost])
        table = read_table(folder / "quality.csv", [*COLUMNS, "verdict"])
        assert table["trial"].n_unique() == n + 1
        (row,) = table.filter(pl.col("verdict") == "refused").to_dicts()
        assert (row["trial"], row["check"], row["value"]) == ("plate_9", "refused", None)
        list_excluded(folder / "quality.csv", {}, folder / "excluded.csv", [lost])
        listed = read_table(folder / "excluded.csv", COLUMNS)
        assert listed["remark"][0] == "p.c3d: truncated; export it again"
        assert listed["trial"].to_list() == ["plate_9", "plate_2"][: 1 + (n > 0)]


@pytest.mark.parametrize(
    ("name", "files"),
    [("rows", ["fits/plate_2.csv"]), ("trial", "trials/plate_2.parquet"), ("trial", "trials/plate_2.csv")],
)
def test_where_nothing_is_left_the_reason_is_one_line_with_a_remedy(checked, name, files):
    beside = {"motion": ["trials/plate_1.parquet"]} if files == "trials/plate_2.csv" else {}
    with pytest.raises(InputError, match=r"^[^\n]*excludes every trial .*: plate_2 \(unzeroed_plate .*; record again"):
        without_excluded({name: files, "quality": checked} | beside, exclusions(JUDGE.verdicts(checked)))
