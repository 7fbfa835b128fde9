# SPDX-License-Identifier: Apache-2.0
"""A small campaign through the real Snakefile: everything is made, and a change reruns what depends
on it, no more."""

import ast
import inspect
import json
import os
import re
import shutil
import textwrap
from collections import ChainMap
from importlib import import_module
from pathlib import Path

import polars as pl
import pytest
import yaml
from conftest import ROOT
from polars import selectors
from polars.testing import assert_frame_equal
from reference import changed
from shipped import SETTINGS
from snakemake_runs import FILES, OVERRIDES, Workspace, run_forked

from osl_analysis.base.table import not_analysed, read_table, write_table
from osl_analysis.campaign.configuration import overriding
from osl_analysis.commands.fit import derive
from osl_analysis.commands.tables import (
    HeadlineFacts,
    HeadlineFiles,
    check_claims,
    gather,
    gather_findings,
    judge_table,
    write_summary,
)
from osl_analysis.commands.walking_summary import tabulate_groups
from osl_analysis.figures.drawing import FIGURES
from osl_analysis.judge import known_findings
from osl_analysis.judge.known_findings import KnownFinding, WordsOfRule
from osl_analysis.judge.limits import Accuracy, Limits
from osl_analysis.report.verdicts import brief_lines
from osl_analysis.stats.sources import Source

TRIAL = "impedance_K300_B5.0_compensated"
DYNAMOMETER = OVERRIDES["dynamometer"]
PREFIXED = f"""
configfile: "config/small.yaml"

module osl:
    snakefile: {str(ROOT / "Snakefile")!r}
    prefix: "sub"
    config: config

use rule * from osl as osl_*
"""
"""A workflow that has this one as a module, in a folder."""


@pytest.fixture(scope="module")
def workspace(tmp_path_factory):
    space = Workspace(tmp_path_factory.mktemp("campaign"))
    (space.folder / "note_reads").touch()
    result = space.run("reproduce-all")
    (space.folder / "note_reads").rename(space.folder / "reads_of_first_run")
    space.said = result.stdout
    assert result.returncode == 0, result.stdout
    return space


@pytest.fixture(scope="module")
def every_job(workspace):
    """The jobs of the campaign, whether done or not, with their params."""
    return workspace.jobs("reproduce-all")


def test_every_figure_is_there_with_its_numbers_and_caption(workspace):
    figures = workspace.folder / "results/figures"
    names = FIGURES.keys() - {"torque_angle"}  # no trial of this campaign

    captions = (figures / "captions.md").read_text(encoding="utf-8")

    files = {f"{name}.{suffix}" for name in names for suffix in ("csv", "pdf", "svg", "png")}
    assert {path.name for path in figures.iterdir()} == files | {"captions.md", "captions.tex"}
    assert captions.count("\n## ") == len(names)


def test_every_table_and_figure_says_that_its_data_are_simulated(workspace):
    results = workspace.folder / "results"

    for path in (*(results / "tables").glob("*.csv"), *(results / "figures").glob("*.csv")):
        table = pl.read_csv(path, infer_schema_length=None)
        assert {*table["data"]} <= {"simulated"}, path
    for path in (results / "figures").glob("*.svg"):
        drawing = path.read_text(encoding="utf-8")
        assert re.search("imulated.* small", drawing), path


def test_every_trial_is_used_and_has_its_rows(workspace):
    impedance = workspace.table("impedance")

    assert len(workspace.table("walking_crossings")) == 8
    assert len(impedance) == 4 * 3  # trials; two amplitudes, and all of them
    assert "side" not in impedance.columns, "nobody stated one"
    assert {*workspace.table("quality")["verdict"]} == {"pass", "not applicable"}
    assert workspace.table("excluded").is_empty()


def test_every_job_says_what_made_it(every_job):
    for job in every_job:
        if job["rule"] != "reproduce-all":
            assert job["params"]["made_by"].keys() == {"version", "code", "data"}, job["rule"]


def test_a_run_ends_with_its_headline_numbers_also_with_nothing_to_do(
    workspace,
):
    summary = json.loads((workspace.folder / "results/summary.json").read_text())

    again = workspace.run("reproduce-all").stdout

    assert {"K_s", "B_j", "k_tau_n_m", "walking_K"} <= set(summary["numbers"])
    assert "Nothing to be done" in again
    assert workspace.run("results/tables/belt.csv").stdout.endswith("up to date).\n")
    for said in (workspace.said, again):
        assert "\n".join(brief_lines(summary)) in said
    assert "results/report.html" in workspace.said


def test_options_of_snakemake_and_a_module_do_what_they_do_elsewhere(workspace, tmp_path):
    """`--retries` and `--keep-going` stand in test_small_campaigns.py, modules in
    test_odd_input.py."""
    until = workspace.planned("--forcerun", "ingest", "--until", "ingest")
    accepted = workspace.planned("--config", "failed_trials=accept")
    files = [workspace.run(option) for option in ("--summary", "--rulegraph")]
    page = workspace.run("--report", str(tmp_path / "report.html"))
    (tmp_path / "module.smk").write_text(PREFIXED)
    asked = ["snakemake", "-n", "--snakefile", str(tmp_path / "module.smk"), "osl_reproduce-all"]
    prefixed = run_forked(asked, workspace.folder)
    unknown = workspace.run("-n", f"results/fits/belt/{TRIAL}.csv")

    assert until == {"ingest": 22}
    assert accepted.keys() == {"brief", "methods", "verdict"}
    assert files[0].stdout.count("no update") > 100
    assert "digraph" in files[1].stdout
    assert (tmp_path / "report.html").stat().st_size > 10_000, page.stdout
    assert "takes no `prefix`" in prefixed.stdout
    assert "ask for one of these: belt_01, belt_02" in unknown.stdout


def test_no_number_of_a_campaign_changes_unnoticed(workspace):
    changes = changed(workspace.folder / "results")
    assert changes == [], "if all of it is intended: python tests/reference.py"


# Words decide nothing: with every title and sentence replaced, all numbers are the same.

DERIVED_OF = {
    "impedance": ("compensation", "delay"),
    "belt": ("belt_summary",),
    "transmission": ("transmission_summary",),
    "actuator": ("actuator_summary",),
}
ABOUT = dict.fromkeys(("campaign", "data", "version", "configuration", "recorded", "digest"), "x")
STRICT = Limits(accuracy=Accuracy(B=0.01), below={"K_s": 684.0})  # which one of two belts has
FAULTS = {"impedance_K300_B5.0_compensated": Source.SIGNAL_JUMPS}
"""A fault of a recording, for which B and I are doubtful, whose intervals are wide, and K is
not."""


def made_of_fits(results: Path, folder: Path) -> dict[str, pl.DataFrame]:
    """All that follows from the fits of a campaign, judged by `STRICT` and `FAULTS`, as its rules
    make it: findings, tables, claims; the headline numbers stand in a table, too."""
    findings: dict[str, Path] = {}
    files: dict[str, Path] = {}
    for name in ("belt", "transmission", "actuator", "impedance", "walking", "walking_groups"):
        rows = sorted((results / "fits" / name).glob("*.csv")) or [results / f"fits/{name}.csv"]
        budgets = sorted((results / "fits" / name).glob("*.zip"))
        if name == "walking_groups":
            budgets = [results / "tables/walking_budget.csv"]
        findings[name] = folder / f"_{name}.parquet"
        files[name] = folder / f"{name}.csv"
        write_table(judge_table(name, STRICT, rows, budgets, FAULTS), findings[name])
        write_table(gather(rows, name, [findings[name]]), files[name])
    archives = sorted(results.glob("fits/impedance/*.zip"))
    files["response"] = folder / "response.csv"
    write_table(gather(archives, "response", [findings["impedance"]]), files["response"])
    for name, derived in DERIVED_OF.items():
        for summary in derived:
            files[summary] = folder / f"{summary}.csv"
            write_table(derive(files[name], summary, [findings[name]]), files[summary])
    files["walking_summary"] = folder / "walking_summary.csv"
    of_walking = [findings["walking"], findings["walking_groups"]]
    groups = tabulate_groups(results / "fits/walking_summary.csv", files["walking"], of_walking)
    write_table(groups, files["walking_summary"])

    campaign_findings = folder / "findings.parquet"
    verdicts = results / "tables/quality.csv"
    gather_findings(list(findings.values()), verdicts, campaign_findings, folder / "findings.csv")
    claims = ROOT / "config/claims/draft.yaml"
    compared = check_claims(files, claims, list(findings.values()))
    files["claims"] = folder / "claims.csv"
    write_table(compared, files["claims"])
    sheet = pl.read_csv(results.parent / "raw_data/small/trials.csv", infer_schema=False)
    excluded = results / "tables/excluded.csv"
    write_summary(
        files=HeadlineFiles(files, [], excluded, verdicts, campaign_findings),
        facts=HeadlineFacts(ABOUT, beside_draft=False, settings={}, stated={}, changed=[]),
        sheet={row["trial"]: row for row in sheet.to_dicts()},
        summary_json=folder / "summary.json",
        numbers_tex=folder / "numbers.tex",
    )
    summary = json.loads((folder / "summary.json").read_text())
    headline = [{"quantity": name, **number} for name, number in summary["numbers"].items()]
    counts = {**summary["verdicts"], **summary["results_of_clear"]}
    return {
        **{name: read_table(path) for name, path in files.items()},
        "findings": pl.read_parquet(campaign_findings),
        "numbers": pl.DataFrame(headline, infer_schema_length=None),
        "counts": pl.DataFrame([counts]),
    }


def test_other_titles_and_sentences_of_findings_change_no_number(workspace, tmp_path, monkeypatch):
    results = workspace.folder / "results"
    (tmp_path / "shipped").mkdir()
    (tmp_path / "nonsense").mkdir()
    shipped = made_of_fits(results, tmp_path / "shipped")

    for source, known in list(known_findings.FINDINGS.items()):
        nonsense = KnownFinding(known.name, title=f"K, B: x; not checked: {source[::-1]}", says="y")
        monkeypatch.setitem(known_findings.FINDINGS, source, nonsense)
    for name in list(known_findings.WORDS_OF_RULES):
        monkeypatch.setitem(known_findings.WORDS_OF_RULES, name, WordsOfRule("z: w", "v"))
    renamed = made_of_fits(results, tmp_path / "nonsense")

    assert shipped["impedance"]["doubtful"].drop_nulls().len() > 0, "some are doubtful"
    assert shipped["impedance"]["doubtful"].to_list() != renamed["impedance"]["doubtful"].to_list()
    assert shipped["numbers"]["n_doubtful"].sum() > 0, "and in no mean"
    assert shipped.keys() == renamed.keys()
    for name, table in shipped.items():
        numbers = table.select(selectors.numeric() | selectors.boolean())
        assert_frame_equal(renamed[name].select(numbers.columns), numbers, check_exact=True)
    decided = {"findings": ("source", "grade", "estimates", "evidence"), "claims": ("verdict",)}
    for name, columns in decided.items():
        assert_frame_equal(renamed[name].select(columns), shipped[name].select(columns))


def leaves(value, place=()):
    """Every value in nested mappings, by its place."""
    if not isinstance(value, dict):
        return {place: value}
    by_place = {}
    for name, part in value.items():
        by_place.update(leaves(part, (*place, name)))
    return by_place


CALL = re.compile(r"^ +job\(\n(?:.+\n)+? +\)$", re.MULTILINE)
"""A call of `job` in a rule."""


def calls_of_jobs():
    """By its text, each call of `job` in the rules: the function, and the names of all arguments
    that it gets."""
    files = sorted((ROOT / "rules").glob("*.smk"))
    rules = "\n".join(path.read_text() for path in files if path.stem != "common")
    modules = set(re.findall(r"^from (osl_analysis\.commands\.\w+) ", rules, re.MULTILINE))
    imported = ChainMap(*(vars(import_module(module)) for module in modules))
    calls = {}
    for text in CALL.findall(rules):
        call = ast.parse(textwrap.dedent(text)).body[0].value
        given = {keyword.arg: keyword.value for keyword in call.keywords}
        groups = [given[name] for name in ("inputs", "arguments") if name in given]
        names = [keyword.arg for group in groups for keyword in group.keywords]
        if "left_out" in given:
            names += [
                keyword.value.value
                for keyword in given["left_out"].keywords
                if keyword.arg == "argument"
            ]
        calls[text] = imported[call.args[0].id], names
    return calls


def test_a_rule_gives_its_function_every_argument_by_name():
    calls = calls_of_jobs()

    assert len(calls) > 35
    for text, (function, names) in calls.items():
        assert sorted(names) == sorted(inspect.signature(function).parameters), text


def test_a_rule_leaves_out_trials_by_the_checks_that_it_waits_for():
    for file in (ROOT / "rules").glob("*.smk"):
        for rule in file.read_text().split("rule ")[1:]:
            asked = re.findall(r"(?:excluded|faults)=lambda wildcards: \w+\((.*)\),\n", rule)
            awaited = re.findall(r" {8}(?:lambda wildcards: )?FILES\.checks\((.*)\),\n", rule)
            assert set(asked) == set(awaited), rule


def test_a_job_reads_only_what_its_rule_names_as_input(workspace, every_job):
    """Each file of the campaign that a job opens is an input of it: else it is early, or old."""
    jobs = {job["log"][0]: job for job in every_job if job["log"]}
    made = {file for job in jobs.values() for file in job["files"]}
    lines = (workspace.folder / "reads_of_first_run").read_text().splitlines()

    reads = [line.split("\t") for line in lines]
    undeclared = {
        (log, file)
        for log, file in reads
        if file in made and file not in jobs[log]["needed"] + jobs[log]["files"]
    }

    assert len(reads) > 200
    assert undeclared == set()


def test_belt_and_transmission_are_those_that_made_the_recordings(workspace):
    """Hysteresis of 0.25 N*m moves K_s by 0.1 %."""

    def truth(trial):
        return json.loads((workspace.folder / f"raw_data/small/truth/{trial}.json").read_text())

    belt = workspace.table("belt")
    true_K_s = [truth(trial)["parameters"]["K_s"] for trial in belt["trial"]]
    assert belt["K_s"].to_list() == pytest.approx(true_K_s, rel=0.003)
    lossy = workspace.table("transmission").filter(pl.col("amplitude_deg").is_null())
    assert ((lossy["B_j"] - 0.452).abs() < 2 * (lossy["B_j_high"] - lossy["B_j"])).all()


def test_changed_settings_give_a_fresh_run_s_bytes_and_redo_what_uses_them(workspace, tmp_path):
    """Of thresholds and limits no trial is ingested or fitted again. Of the filter of the bench,
    what is ingested, simulated and fitted elsewhere stays."""
    changes = {
        "quality": {"rate": "990 Hz"},
        "doubtful": {"transmission": {"below": {"VAF": 99.999}}},
    }
    again = Workspace(tmp_path / "again", workspace)
    fresh = Workspace(tmp_path / "fresh", workspace, ("results", ".snakemake"))
    again.configure(changes)
    planned = again.planned()
    assert {"judge", "table"} <= set(planned)
    kept = {
        "ingest",
        "fit",
        "identify_plate",
        "find_timing",
        "analyse_crossing",
        "select_crossings",
        "average_unperturbed",
        "fit_perturbation",
        "summarise_walking",
    }
    assert not kept & set(planned)
    names = ("belt_summary", "impedance", "transmission", "transmission_summary")
    targets = [f"results/tables/{name}.csv" for name in (*names, "quality")]
    for space in (again, fresh):
        space.configure(changes | {"dynamometer": DYNAMOMETER | {"cutoff_hz": 18}})
        assert space.run(*targets).returncode == 0
    assert again.planned(*targets) == {}
    made = (
        path for path in (fresh.folder / "results").rglob("*") if path.suffix in (".csv", ".zip")
    )
    files = [path.relative_to(fresh.folder) for path in made]
    assert len(files) > 40
    assert [
        file
        for file in files
        if (again.folder / file).read_bytes() != (fresh.folder / file).read_bytes()
    ] == []
    for kept in ("results/trials/belt_01.parquet", "results/fits/walking", "results/crossings"):
        assert (again.folder / kept).stat().st_mtime == (workspace.folder / kept).stat().st_mtime


def test_the_lines_for_pandas_read_the_results(workspace, monkeypatch, capsys):
    page = (ROOT / "docs/read_results.md").read_text()
    monkeypatch.chdir(workspace.folder)
    values = {}

    for block in re.findall(r"```python\n(.*?)```", page, re.DOTALL):
        exec(block.replace("NAME", TRIAL), values)

    of_all = workspace.table("impedance").filter(pl.col("amplitude_deg").is_null())
    assert values["whole"]["K"].tolist() == of_all["K"].to_list()
    assert not values["torque"].isna().any().any()
    assert "K_bias_compensated" in capsys.readouterr().out


def test_a_comment_in_a_source_file_makes_nothing_again_a_value_does(workspace, tmp_path):
    space = Workspace(tmp_path, workspace)
    source = tmp_path / "config/sources/dynamometer.yaml"

    source.write_text(f"# of the new bench\n{source.read_text()}")
    assert space.planned() == {}

    source.write_text(f"{source.read_text()}\nmost_missing: 0.02\n")
    assert {"ingest", "fit", "headline_numbers"} <= space.planned().keys()
    assert space.planned("results/trials/actuator_1.parquet") == {}


def test_another_release_makes_everything_again(workspace, every_job, tmp_path):
    space = Workspace(tmp_path, workspace)
    every = {job["rule"] for job in every_job}
    for note in (tmp_path / ".snakemake/metadata").rglob("*"):
        if note.is_file():
            text = note.read_text()
            note.write_text(re.sub(r"('version': ')[\w.]+", r"\g<1>0.9", text))
    assert space.planned().keys() == every - {"reproduce-all"}


NOT_CHANGED = {
    "simulation",
    "trials",
    "markers",
    "time_series",
    "frequency_response",
    "exclude",
    "fewest_unperturbed",
    "plate_inertia",
}
"""Such as name markers, a trial, or what a test of its own changes."""


def another(value, number):
    """Another value of its kind: near a number, also of a text "0.06 s"; of each `number` a
    different size."""
    if isinstance(value, bool):
        return not value
    if isinstance(value, list):
        return [another(one, number) for one in value]
    if isinstance(value, str):
        size, _, unit = value.partition(" ")
        return (
            f"{another(float(size), number)} {unit}"
            if unit
            else {"auto": "any", "end": "start", "right": "left"}[value]
        )
    return value + 1 if isinstance(value, int) else value * (1 + 1e-5 * number) + 1e-7 * number


def test_every_setting_is_a_param_of_a_job(tmp_path):
    """Else a changed one would leave old results. All are changed at once, in a dry run without the
    recordings."""
    space = Workspace(tmp_path)
    places = {}
    changes = {}
    shutil.copy(ROOT / "tests/planned_trials.csv", tmp_path / "trials.csv")
    (tmp_path / "raw").mkdir()
    for place, value in leaves(SETTINGS).items():
        if len(place) > 1 and value not in (None, {}, []) and not NOT_CHANGED & set(place):
            limit = place[0] in ("doubtful", "figures")  # no whole numbers
            is_number = limit and not isinstance(value, bool)
            places[place] = another(float(value) if is_number else value, len(places) + 1)
            inner = changes
            for name in place[:-1]:
                inner = inner.setdefault(name, {})
            inner[place[-1]] = places[place]
    assert len(places) > 75
    example = {"K_d": 300, "B_d": 5}
    measured = {"simulation": None, "sheet": "trials.csv", "raw_data": "raw"}
    measured["figures"] = {"time_series": example, "frequency_response": example}
    planned = []
    for further in ({}, changes):
        (tmp_path / "config/small.yaml").write_text(
            yaml.safe_dump(overriding(overriding(SETTINGS, measured), further))
        )
        jobs = space.jobs("reproduce-all")
        planned.append({job["log"][0]: leaves(job["params"]) for job in jobs if job["log"]})
    differ = [
        (at, new)
        for log, now in planned[1].items()
        for at, new in now.items()
        if planned[0][log][at] != new
    ]
    found = {
        place
        for place, new in places.items()
        for at, value in differ
        if value == new and (type(new) is float or place[-1] in at)
    }
    assert set(places) - found == set()


def test_a_campaign_that_cannot_be_run_is_refused_before_any_job(workspace):
    first = workspace.folder / "config/first.yaml"
    first.write_text("dynamometer: {cut_off: 10}\n")
    workspace.configure({"dynamometer": DYNAMOMETER | {"cut_off": 20}})
    result = run_forked(["snakemake", "-n", *FILES[:3], str(first), FILES[3]], workspace.folder)
    workspace.configure({})
    assert result.returncode == 1
    said = r"/small\.yaml: line \d+.*small\.yaml: dynamometer\.cut_off:"
    assert re.search(said, result.stdout), result.stdout


def test_reading_the_workflow_writes_nothing(tmp_path):
    """With the jobs planned, with a look at what is there, and without any jobs, also of the place
    where Snakemake's catalogue looks for a workflow. Its lint counts a call with every argument by
    its name as a long `run:`, and has no other complaint."""
    space = Workspace(tmp_path)

    def files():
        return {path for path in tmp_path.rglob("*") if ".snakemake" not in path.parts}

    before = files() | {tmp_path / "said.txt"}
    for option in ("-n", "--summary"):
        ended = space.run(option)
        assert (ended.returncode, files()) == (0, before), ended.stdout
    complaints = re.findall(r"^    \* (.+):$", space.run("--lint").stdout, re.MULTILINE)
    assert {*complaints} <= {"Migrate long run directives into scripts or notebooks"}
    assert files() == before
    catalogued = ["snakemake", "-n", "--snakefile", str(ROOT / "workflow/Snakefile"), *FILES[2:]]
    planned = run_forked(catalogued, tmp_path)
    assert (planned.returncode, "verdict" in planned.stdout) == (0, True), planned.stdout


@pytest.fixture(scope="module")
def laboratory(workspace, tmp_path_factory):
    """The same campaign as a laboratory's, with five bad trials, after its first run.

    One log is missing, one is damaged, one is another trial's and is refused by the fit; a capture
    cannot be read. A crossing that the sheet calls
    unperturbed is perturbed: it is excluded."""
    space = Workspace(
        tmp_path_factory.mktemp("laboratory"), workspace, ("results", ".snakemake", "truth")
    )
    space.configure({"simulation": None})
    logs = space.folder / "raw_data/small/dynamometer"
    path = space.folder / "raw_data/small/trials.csv"
    (logs / "belt_01.mcap").unlink()
    (logs / f"{TRIAL}.mcap").write_bytes((logs / f"{TRIAL}.mcap").read_bytes()[:2000])
    shutil.copy(logs / "belt_02.mcap", logs / "impedance_K200_B5.0_compensated.mcap")
    sheet = pl.read_csv(path, infer_schema=False)
    space.mistaken = sheet.filter(pl.col("perturbed").str.to_lowercase() == "true")["trial"][-1]
    wrong = pl.when(trial=space.mistaken).then(pl.lit("false")).otherwise("perturbed")
    sheet.with_columns(perturbed=wrong).write_csv(path)
    (space.folder / "unlucky").mkdir()
    (space.folder / "unlucky/walking_04.c3d.refused").touch()
    result = space.run("reproduce-all")
    space.code, space.said = result.returncode, result.stdout
    shutil.rmtree(space.folder / "unlucky")
    return space


BAD = {
    "belt_01": r"dynamometer/belt_01\.mcap: .*; ",
    TRIAL: rf"dynamometer/{TRIAL}\.mcap: .*; ",
    "impedance_K200_B5.0_compensated": r"_compensated\.mcap: .*; ",
    "walking_04": r"vicon/walking_04\.c3d: .*[Pp]ermission denied.*; .*",
}


def test_a_run_with_bad_trials_ends_with_file_reason_and_remedy_of_each(laboratory):
    assert laboratory.code == 1
    assert "Traceback" not in laboratory.said
    said = laboratory.said.partition("NOT ANALYSED: 4 ")[2].splitlines()[1:]
    for told, (trial, reason) in zip(said, sorted(BAD.items()), strict=False):
        assert re.match(rf"  trial {re.escape(trial)}, file raw_data/small/\S*{reason}", told), told
    assert "`exclude`" in laboratory.said


def test_tables_and_numbers_are_made_of_the_trials_that_are_left(laboratory):
    results = laboratory.folder / "results"
    table = laboratory.table
    assert not list(results.rglob(".*"))
    assert set(table("impedance").drop_nulls("K")["controller"]) == {"uncompensated"}
    assert table("impedance").filter(trial=TRIAL)["status"].to_list() == ["not analysed"]
    assert len(table("walking_crossings").filter(status="used")) == 6
    (left_out,) = table("excluded").filter(check="crossing").to_dicts()
    assert left_out["trial"] == laboratory.mistaken
    assert re.search("perturbed = false", left_out["remark"])
    assert {path.name for path in results.glob("figures/*.csv") if not_analysed(path)} == {
        "fig4.csv"
    }
    assert pl.read_parquet(results / "trials/belt_01.parquet").is_empty()
    assert set(table("excluded").filter(check="refused")["trial"]) == set(BAD)
    walking = json.loads((results / "summary.json").read_text())["trials"]["walking"]
    assert (walking["used"], walking["of"]) == (6, 8)
    assert set(walking["missing"]) == {"walking_04", laboratory.mistaken}
    missing = rf"(?m)^% 6 .*8 walking .*walking_04.*{laboratory.mistaken}"
    assert re.search(missing, (results / "numbers.tex").read_text())


def test_what_is_accepted_or_excluded_by_the_sheet_makes_the_run_a_success(laboratory):
    """With a reason in the sheet a trial is not in the list; with `failed_trials: accept` the run
    is a success. What could not be read is made as soon as it can be."""
    raw = laboratory.folder / "raw_data/small"
    sheet = pl.read_csv(raw / "trials.csv", infer_schema=False)
    lost = pl.when(trial="belt_01").then(pl.lit("lost")).otherwise("exclude")
    sheet.with_columns(exclude=lost).write_csv(raw / "trials.csv")
    laboratory.configure({"simulation": None})
    assert laboratory.run("reproduce-all").returncode == 1
    assert laboratory.planned() == {"verdict": 1}, "also where nothing else is left to do"
    laboratory.configure({"simulation": None, "failed_trials": "accept"})
    result = laboratory.run("reproduce-all")
    assert result.returncode == 0, result.stdout
    named = r"NOT ANALYSED: 3 .*\n(  trial .*\n){3}"
    assert re.search(named, result.stdout)
    assert "belt_01 (lost)" in result.stdout


def test_another_recording_is_seen_by_its_size_and_a_touched_one_is_not(
    laboratory,
):
    log = laboratory.folder / "raw_data/small/dynamometer/belt_02.mcap"
    table = "results/tables/belt.csv"
    os.utime(log)
    assert laboratory.planned(table) == {}
    log.write_bytes(log.read_bytes() + b"more")
    os.utime(log, (10**8, 10**8))
    assert laboratory.planned(table) == {"ingest": 1, "fit": 1, "findings": 1, "table": 1}


def test_a_source_file_that_is_missing_refuses_its_trial(workspace, tmp_path):
    space = Workspace(tmp_path, workspace, ("results", ".snakemake", "truth"))
    space.configure({"simulation": None})
    (tmp_path / "config/sources/vicon.yaml").unlink()

    space.run("results/trials/static_1.parquet")

    (cause,) = not_analysed(tmp_path / "results/trials/static_1.parquet")
    assert "vicon.yaml: no such file" in cause.reason
