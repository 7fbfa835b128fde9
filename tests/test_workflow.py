"""A small campaign through the real Snakefile: everything is made, and a change reruns what depends
on it, no more."""

import json
import os
import re
import shutil
import sys
import zipfile
from functools import cache
from inspect import CO_OPTIMIZED
from pathlib import Path

import numpy as np
import polars as pl
import pytest
import yaml
from any_motion import noise
from conftest import ROOT
from reference import PLANNED, REQUESTS, changed, requests_of
from reference import SHEET as EVERY_TRIAL
from snakemake_runs import OVERRIDES, PLANNED_IN, run_forked, write_small

from osl_analysis.campaign.configuration import overriding
from osl_analysis.commands.reference import tables_page
from osl_analysis.dictionary import described_tables
from osl_analysis.figures import FIGURES
from osl_analysis.files import digest
from osl_analysis.jobs import code
from osl_analysis.jobs.job import call
from osl_analysis.jobs.request import FITS, read_request
from osl_analysis.jobs.run import RUNS
from osl_analysis.refusal import is_refused
from osl_analysis.report.headlines import all_labels

TRIAL = "impedance_K300_B5.0_compensated"
DYNAMOMETER = OVERRIDES["dynamometer"]
CAMPAIGNS = {
    "small": {},
    "other": yaml.safe_load(Path(__file__).with_name("other_campaign.yaml").read_text()),
}
NUMBERED = [
    f"results/{name}"
    for name in (
        "summary.json",
        "tables/findings.csv",
        "tables/settings.csv",
        "figures/captions.md",
    )
]
MADE = {"small": ["reproduce-all"], "other": NUMBERED}
"""What is made of each; of the other one every table, and the numbers of its figures, which are not
drawn."""
FILES = ["--snakefile", str(ROOT / "Snakefile"), "--configfile", "config/small.yaml"]


class Workspace:
    """A folder with a copy of config/ in which the repository's Snakefile runs."""

    def __init__(
        self,
        folder: Path,
        of: "Workspace | dict" = CAMPAIGNS["small"],
        without: tuple[str, ...] = (),
    ):
        """A new campaign with these changes, or a copy of one, dates included, without files of
        these names."""
        self.folder = folder
        if isinstance(of, dict):
            write_small(folder, of)
            self.configure({})
        else:
            shutil.copytree(
                of.folder, folder, ignore=shutil.ignore_patterns(*without), dirs_exist_ok=True
            )

    def configure(self, changes):
        (self.folder / "config/small.yaml").write_text(yaml.safe_dump(OVERRIDES | changes))

    def run(self, *arguments):
        """Snakemake in this folder."""
        return run_forked(["snakemake", *arguments, *FILES], self.folder)

    def planned(self, *arguments):
        """Jobs per rule of a dry run."""
        result = self.run("-n", *arguments)
        assert result.returncode == 0, result.stdout
        stats = re.findall(r"^([\w-]+) +(\d+)$", result.stdout, re.MULTILINE)
        return {rule: int(count) for rule, count in stats if rule not in ("total", "reproduce-all")}

    def table(self, name):
        return pl.read_csv(self.folder / f"results/tables/{name}.csv")


@pytest.fixture(scope="module")
def workspace(tmp_path_factory):
    space = Workspace(tmp_path_factory.mktemp("campaign"))
    result = space.run("reproduce-all")
    space.said = result.stdout
    assert result.returncode == 0, result.stdout
    return space


def test_every_figure_table_and_headline_number_is_there_and_nothing_is_left_to_do(workspace):
    results, drawn = (
        workspace.folder / "results",
        FIGURES.keys() - {"torque_angle", "impedance_over"},
    )
    files = {f"{name}.{suffix}" for name in drawn for suffix in ("csv", "pdf", "svg", "png")}
    assert {path.name for path in (results / "figures").iterdir()} == files | {"captions.md"}
    captions = (results / "figures/captions.md").read_text(encoding="utf-8")
    assert captions.count("\n## ") == len(drawn)
    summary = json.loads((results / "summary.json").read_text())
    assert {"K_s", "B_j", "k_tau_n_m", "walking_K"} <= set(summary["numbers"])
    assert "open results/report.html in a browser: every number" in workspace.said
    assert all(one["line"] in workspace.said for one in summary["findings"])
    for path in (*(results / "tables").glob("*.csv"), *(results / "figures").glob("*.csv")):
        table = pl.read_csv(path, infer_schema_length=None)
        assert (table.columns[-1], {*table["data"]} - {"simulated"}) == ("data", set()), path
    drawings = [path.read_text(encoding="utf-8") for path in (results / "figures").glob("*.svg")]
    assert all("Simulated data: campaign small, osl-analysis" in drawing for drawing in drawings)
    assert (len(workspace.table("walking_crossings")), len(workspace.table("impedance"))) == (
        8,
        4 * 3,
    )
    assert workspace.table("impedance").columns[:3] == [
        "trial",
        "joint",
        "amplitude_deg",
    ], "nobody stated a side"
    shown = pl.read_csv(results / "figures/fig4.csv").select("time", "theta_deg")
    assert np.ptp(shown.to_numpy(), axis=0) == pytest.approx((2, 8), abs=0.2)
    assert {*workspace.table("quality")["verdict"]} == {"pass", "not applicable"}
    assert workspace.table("excluded").is_empty()
    assert workspace.planned("reproduce-all") == workspace.planned() == {}


def test_no_number_of_a_campaign_changes_unnoticed(workspace, tmp_path):
    """Where one may: `python tests/reference.py`."""
    other = Workspace(tmp_path, CAMPAIGNS["other"])
    assert other.run(*MADE["other"]).returncode == 0
    assert (
        changed("small", workspace.folder / "results")
        == changed("other", tmp_path / "results")
        == []
    )


def test_every_column_and_number_is_in_the_data_dictionary_and_the_dictionary_has_no_other_column(
    workspace,
):
    """Without torque against angle, and what test_dictionary.py holds: overground trials and
    calibrations."""
    results, written = workspace.folder / "results", {}
    archives = [zipfile.Path(path) for path in results.rglob("*.zip")]
    for path in (
        *results.rglob("*.csv"),
        *(part for archive in archives for part in archive.iterdir()),
    ):
        below = Path(os.path.relpath(str(path), results))
        tables = [
            t
            for t in described_tables()
            if any(p and below.match(f"{p}.csv") for p in (t.place, t.also))
        ]
        header = set(path.read_text().splitlines()[0].split(","))
        assert header - {name for t in tables for name in t.columns} == set(), (
            f"describe these columns of {path.name}"
        )
        for table in tables:
            written[table.place] = written.get(table.place, set()) | header & set(table.columns)
    described = {t.place: set(t.columns) for t in described_tables()}
    absent = ("torque_angle", "ankle_moment", "human_joint", "impedance_over")
    not_made = {
        p for p in described if p.startswith("comparison") or any(part in p for part in absent)
    }
    not_made -= {"figures/impedance_over_stance", "tables/impedance_over_stance"}
    not_made.add("tables/calibration")
    assert described.keys() - written.keys() == not_made
    # which none states
    missing = {place: described[place] - columns - {"side"} for place, columns in written.items()}
    left = {place: columns for place, columns in missing.items() if columns}
    assert left == {"fits/*/*.zip/series": {"omega"}}
    numbers = json.loads((results / "summary.json").read_text())["numbers"]
    claimed = workspace.table("claims").filter(pl.col("subject").is_null())["name"]
    assert {name.partition(" (")[0] for name in numbers} - {
        label.name for label in all_labels()
    } == set(claimed)
    of_summary = tables_page("").partition("| field | meaning |")[2].partition("The entries, ")[0]
    fields = {
        name
        for row in of_summary.splitlines()
        for name in re.findall(r"`(\w+)`", row.split(" | ")[0])
    }
    assert set.union(*(set(number) for number in numbers.values())) == fields


def requests_in(folder):
    """The requests of the jobs in a folder of results, or of those that were planned, by the names
    of their files."""
    places = [folder / "results/requests", folder / PLANNED_IN]
    found = {
        path.relative_to(place): path
        for place in places
        for path in sorted(place.rglob("job.json"))
    }
    return {
        str("results/requests" / name): json.loads(path.read_text()) for name, path in found.items()
    }


def leaves(value, place=()):
    """Every value in nested mappings, by its place."""
    if not isinstance(value, dict):
        return {place: value}
    return {
        at: one for name, part in value.items() for at, one in leaves(part, (*place, name)).items()
    }


def test_what_a_job_reads_was_made_by_jobs_that_its_rule_waits_for(workspace):
    """Also what the rule does not name (`read`): else a job is early, or not run again. Snakemake
    notes the inputs."""
    requests, waits_for = requests_in(workspace.folder), {}
    of_crossings = [
        said["settings"] for said in requests.values() if said["command"] == "walking.analyse"
    ]
    assert [
        {"perturbed", "direction", "body_mass_kg"} <= said.keys() for said in of_crossings
    ] == 8 * [True]
    simulated = [
        said["made_of"]
        for said in requests.values()
        if said["command"] == "simulate.simulate_trial"
    ]
    assert {OVERRIDES["simulation"] in files for files in simulated} == {True}
    maker = {file: request for request, said in requests.items() for file in said["files"]}
    for note in (
        path for path in (workspace.folder / ".snakemake/metadata").rglob("*") if path.is_file()
    ):
        inputs = json.loads(note.read_text())["input"]
        (request,) = [file for file in inputs if file in requests]
        waits_for[request] = inputs
    assert waits_for.keys() == requests.keys()

    @cache
    def before(request):
        direct = {maker[file] for file in waits_for[request] if file in maker}
        return direct.union(*map(before, direct))

    values = (
        (request, value)
        for request, said in requests.items()
        for value in leaves(said["input"]).values()
    )
    named = [
        (request, file)
        for request, value in values
        for file in (value if isinstance(value, list) else [value])
    ]
    reads = [(request, file) for request, file in named if file in maker]
    assert [(request, file) for request, file in reads if maker[file] not in before(request)] == []
    assert len({file for request, file in reads if file not in waits_for[request]}) > 50


def test_belt_transmission_impedance_and_walking_are_those_that_made_the_recordings(workspace):
    """Hysteresis of 0.25 N*m moves K_s by 0.1 %, friction K by some percent, as each perturbation
    scatters."""

    def truth(trial):
        return json.loads((workspace.folder / f"raw_data/small/truth/{trial}.json").read_text())

    belt, walking = workspace.table("belt"), workspace.table("walking")
    assert belt["K_s"].to_list() == pytest.approx(
        [truth(one)["parameters"]["K_s"] for one in belt["trial"]], rel=0.003
    )
    lossy = workspace.table("transmission").filter(pl.col("amplitude_deg").is_null())
    assert (np.abs(lossy["B_j"].to_numpy() - 0.452) < 4 * lossy["B_j_se"].to_numpy()).all()
    whole = workspace.table("impedance").filter(
        pl.col("amplitude_deg").is_null(), controller="compensated"
    )
    assert whole["K"].to_list() == pytest.approx(whole["K_predicted"].to_list(), rel=0.05)
    rendered = np.mean([truth(trial)["K_rendered"] for trial in walking["trial"]])
    assert walking["K"].mean() == pytest.approx(rendered, rel=0.05)


BENCH = {"fit_belt_trial", "fit_transmission_trial", "fit_impedance_trial"}
CROSSINGS = {
    "identify_plate",
    "analyse_crossing",
    "select_crossings",
    "average_unperturbed",
    "fit_perturbation",
}


def test_changed_settings_give_the_bytes_of_a_fresh_run_and_redo_what_uses_them_alone(
    workspace, tmp_path
):
    """Of thresholds and limits no trial is ingested or fitted again; what several trials share is
    made again, where one of them becomes excluded. Of the filter of the bench, what is ingested,
    simulated and fitted elsewhere stays."""
    of_transmission = pl.col("trial").str.starts_with("transmission")
    rests = workspace.table("quality").filter(of_transmission, check="jitter").sort("value")
    (_, least), (bad, most) = rests.select("trial", "value").rows()
    rule = {"threshold": f"{(least + most) / 2} %", "on_failure": "exclude"}
    changes = {
        "quality": {"jitter": rule},
        "doubtful": {"transmission": {"above": {"samples": 10}}},
    }
    again = Workspace(tmp_path / "again", workspace)
    fresh = Workspace(tmp_path / "fresh", workspace, ("results", ".snakemake"))
    again.configure(changes)
    planned = again.planned()
    assert {"judge", "table"} <= set(planned)
    fits = BENCH | CROSSINGS | {"fit_actuator_trial", "summarise_walking"}
    fits -= {"fit_impedance_trial"}  # it predicts by the components, of which a trial is excluded
    assert not (fits | {"ingest"}) & set(planned)
    names = ("belt_summary", "impedance", "transmission", "transmission_summary")
    targets = [f"results/tables/{name}.csv" for name in (*names, "quality")]
    for space in (again, fresh):
        space.configure(changes | {"dynamometer": DYNAMOMETER | {"cutoff_hz": 18}})
        assert space.run(*targets).returncode == 0
        assert space.planned(*targets) == {}
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
    transmission = again.table("transmission")
    assert bad not in transmission["trial"].to_list()
    assert (transmission["doubtful"] == "samples").all()


NOT_CHANGED = {
    "simulation", "trials", "markers", "time_series", "frequency_response", "on_failure",
    "fewest_unperturbed",
    "plate_inertia",
}  # fmt: skip
"""Such as name markers, a trial, or what a test of its own changes."""
OTHER_WORD = {
    "auto": "any",
    "end": "start",
    "right": "left",
    "matched": "own",
    "mean": "predicted",
    "platform": "belt",
}


def another(value, number):
    """Another value of its kind: near a number, also of a text "0.06 s"; of each `number` a
    different size."""
    if isinstance(value, bool):
        return not value
    if isinstance(value, list):
        return [another(one, number) for one in value]
    if isinstance(value, str):
        size, _, unit = value.partition(" ")
        return f"{another(float(size), number)} {unit}" if unit else OTHER_WORD[value]
    return value + 1 if isinstance(value, int) else value * (1 + 1e-5 * number) + 1e-7 * number


def test_every_setting_is_in_the_request_of_a_job(tmp_path):
    """Else a changed one would leave old results. All are changed at once, in a dry run without the
    recordings."""
    space, places, changes = Workspace(tmp_path), {}, {}
    of_each = "trial|cal|belt_[12]|transmission|actuator|impedance_2|torque_angle_2|overground|static|plate_1|walking_"
    (tmp_path / "trials.csv").write_text(
        "".join(row for row in EVERY_TRIAL if re.match(of_each, row))
    )
    (tmp_path / "raw").mkdir()
    for place, value in leaves(
        default := yaml.safe_load((ROOT / "config/config.yaml").read_text())
    ).items():
        if len(place) > 1 and value not in (None, {}, []) and not NOT_CHANGED & set(place):
            limit = place[0] in ("doubtful", "figures")  # no whole numbers
            places[place] = another(float(value) if limit else value, len(places) + 1)
            inner = changes
            for name in place[:-1]:
                inner = inner.setdefault(name, {})
            inner[place[-1]] = places[place]
    assert len(places) > 130
    example = {"K_d": 300, "B_d": 5}
    measured = {"simulation": None, "sheet": "trials.csv", "raw_data": "raw"}
    measured["figures"] = {"time_series": example, "frequency_response": example}
    requests = []
    for further in ({}, changes):
        (tmp_path / "config/small.yaml").write_text(
            yaml.safe_dump(overriding(overriding(default, measured), further))
        )
        space.planned("reproduce-all")
        requests.append({name: leaves(said) for name, said in requests_in(tmp_path).items()})
    differ = [
        (at, new)
        for name, now in requests[1].items()
        for at, new in now.items()
        if requests[0][name][at] != new
    ]
    found = {
        place
        for place, new in places.items()
        for at, value in differ
        if value == new and (type(new) is float or place[-1] in at)
    }
    assert set(places) - found == set()


@pytest.mark.parametrize("campaign", PLANNED)
def test_nothing_that_a_rule_hands_to_a_job_or_lets_it_wait_for_changes_unnoticed(
    campaign, tmp_path
):
    """Where it may: `python tests/reference.py`."""
    kept = pl.read_csv(REQUESTS, infer_schema=False).filter(campaign=campaign)
    assert requests_of(Workspace(tmp_path), campaign) ^ {*kept.rows()} == set()


def test_a_campaign_that_cannot_be_run_is_one_line_before_any_job(workspace):
    workspace.configure({"dynamometer": DYNAMOMETER | {"cut_off": 20}})
    result = workspace.run("-n")
    workspace.configure({})
    assert result.returncode == 1
    said = (
        r"error: .*/small\.yaml: line \d+ of small\.yaml: unknown field 'dynamometer\.cut_off'; the"
        r" known .*\n\Z"
    )
    assert re.search(said, result.stdout), result.stdout
    assert (
        "did you mean 'profiles/slurm'"
        in workspace.run("-n", "--workflow-profile", "profiles/slrm").stdout
    )


def test_a_run_is_noted_before_anything_of_it_is_read_and_a_dry_run_is_not(tmp_path):
    """So that the next start knows what a killed one left."""
    space = Workspace(tmp_path)
    space.configure({"campaign": "not / a name"})
    for arguments, is_noted in (
        (["-n"], False),
        (["-np"], False),
        (["--dry-run"], False),
        ([], True),
    ):
        assert "is not allowed" in space.run(*arguments).stdout
        assert (tmp_path / RUNS).is_file() == is_noted


@pytest.fixture(scope="module")
def laboratory(workspace, tmp_path_factory):
    """The same campaign as a laboratory's, with six bad trials, after its first run.

    One log is missing, one is damaged, one is another trial's and is refused by the fit; a capture
    cannot be read, the process that reads another is killed. A crossing that the sheet calls
    unperturbed is perturbed: it is excluded."""
    space = Workspace(
        tmp_path_factory.mktemp("laboratory"), workspace, ("results", ".snakemake", "truth")
    )
    space.configure({"simulation": None})
    logs, path = (
        space.folder / "raw_data/small/dynamometer",
        space.folder / "raw_data/small/trials.csv",
    )
    (logs / "belt_01.mcap").unlink()
    (logs / f"{TRIAL}.mcap").write_bytes((logs / f"{TRIAL}.mcap").read_bytes()[:2000])
    shutil.copy(logs / "belt_02.mcap", logs / "impedance_K200_B5.0_compensated.mcap")
    sheet = pl.read_csv(path, infer_schema=False)
    space.mistaken = sheet.filter(pl.col("perturbed").str.to_lowercase() == "true")["trial"][-1]
    wrong = (
        pl.when(pl.col("trial") == space.mistaken)
        .then(pl.lit("false"))
        .otherwise(pl.col("perturbed"))
    )
    sheet.with_columns(perturbed=wrong).write_csv(path)
    (space.folder / "unlucky").touch()
    result = space.run(
        "results/summary.json", "results/figures/fig4.pdf", "results/figures/fig5.csv"
    )
    space.code, space.said = result.returncode, result.stdout
    (space.folder / "unlucky").unlink()
    return space


BAD = {
    "belt_01": r"dynamometer/belt_01\.mcap: no such file; remedy: .*copy",
    TRIAL: rf"dynamometer/{TRIAL}\.mcap: .*no footer.*; remedy: ",
    "impedance_K200_B5.0_compensated": r"_compensated\.mcap: .*; remedy: ",
    "walking_05": (
        r"walking_05\S+: the process of this job was killed \(signal 9, SIGKILL\); remedy: run"
        r" again"
    ),
    "walking_04": r"vicon/walking_04\.c3d: .*[Pp]ermission denied.*; remedy: .*",
}


def test_a_run_with_bad_trials_ends_with_a_line_for_each_with_file_reason_and_remedy(laboratory):
    assert laboratory.code == 1
    assert "Traceback" not in laboratory.said
    said = laboratory.said.partition("NOT ANALYSED: 5 of 22 trials; results are of the others.\n")[
        2
    ].splitlines()
    for told, (trial, reason) in zip(said, sorted(BAD.items()), strict=False):
        assert re.match(rf"  trial {re.escape(trial)}, file raw_data/small/\S*{reason}", told), told
    assert said[-2] == "  therefore not made: figure fig4"
    assert "`exclude` in the sample sheet" in said[-1]


def test_tables_and_numbers_are_made_of_the_trials_that_are_left(laboratory):
    results, table = laboratory.folder / "results", laboratory.table
    assert not list(results.rglob(".*"))
    assert set(table("impedance")["controller"]) == {"uncompensated"}
    assert len(table("walking_crossings")) == 6
    (left_out,) = table("walking_excluded").to_dicts()
    assert left_out["trial"] == laboratory.mistaken
    assert re.search(r"turns at \d\.\d+ s but the sheet says perturbed = false", left_out["reason"])
    refused = [
        path.name
        for path in (*results.glob("tables/*"), *results.glob("figures/*"))
        if is_refused(path)
    ]
    assert refused == ["fig4.csv"]
    excluded = table("excluded")
    assert set(
        excluded.filter(pl.col("check").is_in(["refused", "failed", "died"]))["trial"]
    ) == set(BAD)
    trials = json.loads((results / "summary.json").read_text())["trials"]
    counts = {name: (one["used"], one["of"]) for name, one in trials.items()}
    assert (counts["belt"], counts["walking"]) == ((1, 2), (6, 8))
    assert (
        "% 6 of 8 walking trials; without walking_04, walking_05\n"
        in (results / "numbers.tex").read_text()
    )


def test_a_killed_job_is_tried_again_an_older_copy_of_a_log_is_the_same(
    laboratory,
):
    """With a reason in the sheet a trial is not in the list; with `failed_trials: accept` the run
    is a success."""
    raw = laboratory.folder / "raw_data/small"
    os.utime(raw / "dynamometer/belt_02.mcap", (10**9, 10**9))
    sheet = pl.read_csv(raw / "trials.csv", infer_schema=False)
    lost = pl.when(pl.col("trial") == "belt_01").then(pl.lit("lost")).otherwise(pl.col("exclude"))
    sheet.with_columns(exclude=lost).write_csv(raw / "trials.csv")
    laboratory.configure({"simulation": None, "failed_trials": "accept"})
    (laboratory.folder / "results/trials/gone.parquet").touch()
    trials = [f"results/trials/{trial}.parquet" for trial in (TRIAL, "walking_05")]
    result = laboratory.run("results/tables/belt.csv", trials[0], "results/fits/walking.json")
    assert result.returncode == 0, result.stdout
    named = (
        rf"NOT ANALYSED: 1 of 21 trials; results are of the others.\n  trial {TRIAL}, .*\naccepted"
    )
    assert re.search(named, result.stdout)
    said = (
        "excluded by the sample sheet: belt_01 (lost)\nnot in the sample sheet, and in no table or"
        " figure: gone;"
    )
    assert said in result.stdout
    assert [is_refused(laboratory.folder / path) for path in trials] == [True, False]
    assert (
        digest(raw / "dynamometer/belt_02.mcap")
        in (laboratory.folder / "results/requests/code.json").read_text()
    )


def test_another_recording_is_seen_where_snakemake_has_no_notes_even_with_an_older_date(laboratory):
    """As in a new clone beside results, or after `rm -rf .snakemake`. What has not changed is not
    made again."""
    log = laboratory.folder / "raw_data/small/dynamometer/belt_02.mcap"
    shutil.rmtree(laboratory.folder / ".snakemake")
    assert laboratory.planned("results/tables/belt.csv") == {}
    log.write_bytes(b"another recording")
    os.utime(log, (10**8, 10**8))
    planned = laboratory.planned("results/tables/belt.csv")
    assert planned == {"ingest": 1, "fit_belt_trial": 1, "list_fits": 1, "table": 1}


FIGURE = "figure.plot_numbers figures.walking"
JOBS = {"trials.ingest_and_check", "simulate.simulate_trial", "bench.fit_impedance_trial",
    "bench.fit_belt_trial",
        "walking.fit_perturbation", "tables.write_summary", FIGURE}  # fmt: skip
FITTED = "bench.fit_impedance_trial"
RERUN = {
    "bench/impedance.py": ("\nimport ", "\n# a comment\nimport ", set()),
    "trial.py": ('"""', '"""A docstring. ', set()),
    "ingest/source.py": ("\n\n\n", "\n\n\n\n", set()),
    "dictionary/bench.yaml": (" | ", " | a word of ", {"tables.write_summary"}),
    "report/headlines.yaml": ("median of trials", "a word of median of trials",
    {"tables.write_summary"}),
    "figures/figures.yaml": (" | ", " | a word of ", {FIGURE, "tables.write_summary"}),
    "bench/components.py": ("\ndef belt_table(", "\ndef belt_table(*_, ", {"bench.fit_belt_trial"}),
    "bench/phasors.py": ("\ndef phasor_table(", "\ndef phasor_table(*_, ", {FITTED}),
    "walking/impedance_fit.py": ("    return ", "    return 0 + ", {"walking.fit_perturbation"}),
    "figures/walking.py": ("    return ", "    return 0 + ", {FIGURE}),
}  # fmt: skip
"""By file: what is replaced there, by what, and which jobs run again."""


def test_a_changed_function_or_word_reruns_the_jobs_that_use_it_and_a_comment_or_docstring_none(
    monkeypatch,
):
    read, parsed = code.text_of, {}

    def fingerprints():
        sources = code.Sources()
        sources.known = parsed
        return {job: sources.code(*f"commands.{job}".split()) for job in JOBS}

    before = fingerprints()
    for edited, (old, new, again) in RERUN.items():
        file = ROOT / "osl_analysis" / edited
        count = -1 if edited == "walking/impedance_fit.py" else 1
        changed_text = read(file).replace(old, new, count)
        assert changed_text != read(file), edited
        monkeypatch.setattr(
            code,
            "text_of",
            lambda path, at=file, text=changed_text: text if path == at else read(path),
        )
        now = fingerprints()
        assert {job for job in JOBS if now[job] != before[job]} == again, edited


def test_statements_of_the_same_names_in_the_same_order_have_fingerprints_of_their_own():
    """These two are the same nodes in the same order, and differ in how many arguments each call
    has."""
    one, other = (code.parsed(text, "module")[0][0].code for text in ("x(f(r), q)", "x(f, r)(q)"))
    assert one != other


@pytest.mark.parametrize(
    "command",
    ["trials.ingest_and_check", "bench.fit_impedance_trial", "walking.analyse", "tables.judge"],
)
def test_every_function_of_ours_that_a_job_calls_is_in_its_fingerprint(
    workspace, tmp_path, monkeypatch, command
):
    """But for those of the machinery of jobs."""
    space, called, machinery = (
        Workspace(tmp_path, workspace),
        set(),
        ("jobs.", "judge.used", "refusal"),
    )
    monkeypatch.chdir(space.folder)
    path = next(
        file for file, said in requests_in(space.folder).items() if said["command"] == command
    )
    job = read_request(Path(path))

    def note(frame, event, _):
        file = Path(frame.f_code.co_filename)
        # no body of a class, which an import runs
        is_function = frame.f_code.co_flags & CO_OPTIMIZED
        if event == "call" and is_function and file.is_relative_to(ROOT / "osl_analysis"):
            name = ".".join(
                file.relative_to(ROOT / "osl_analysis").with_suffix("").parts
            ).removesuffix(".__init__")
            called.add((name, frame.f_code.co_qualname.split(".")[0]))

    sys.setprofile(note)
    try:
        assert call(job) == ()
    finally:
        sys.setprofile(None)
    reached, own = set(), code.Sources
    monkeypatch.setattr(
        code,
        "data_of",
        lambda module, one: reached.update((module, name) for name in one.binds) or (),
    )
    own().code(f"commands.{command}", *FITS)
    called = {
        (module, name)
        for module, name in called
        if not module.startswith(machinery) and "<" not in name
    }
    assert len(called) > 10
    assert called - reached == {("table", "tables_of")}


def test_a_persons_stiffness_over_a_recorded_angle_is_a_table_and_a_figure(tmp_path):
    """K rises by 4 N*m/rad per degree."""
    time, (theta, omega, alpha) = noise(rng := np.random.default_rng(1), (0.5, 12.0), 1.2, 20.0)
    slow = np.deg2rad(8) * np.sin(2 * np.pi * 0.11 * time)
    torque = (
        (70 + 4 * np.rad2deg(slow)) * theta
        + 1.0 * omega
        + 0.016 * alpha
        + 0.05 * rng.standard_normal(len(time))
    )
    signals = {"theta": theta, "theta_slow": slow, "torque": torque}
    (tmp_path / "config/sources").mkdir(parents=True)
    pl.DataFrame({"time": time, **signals, "emg": 100 * slow}).write_csv(tmp_path / "w.csv")
    channels = {
        name: {"column": name, "unit": "N*m" if name == "torque" else "rad"} for name in signals
    }
    channels["signal_emg"] = {"column": "emg", "unit": "%"}
    source = {
        "format": "csv",
        "clock": "master",
        "time": {"column": "time", "unit": "s"},
        "channels": channels,
    }
    (tmp_path / "config/sources/w.yaml").write_text(yaml.safe_dump(source))
    (tmp_path / "sheet.csv").write_text("trial,experiment,log,log_source\nw,impedance,w.csv,w\n")
    of_person = {
        "raw_data": ".",
        "sheet": "sheet.csv",
        "dynamometer": {"human": {"over": "theta_slow"}},
    }
    absent = dict.fromkeys(("simulation", "parameters", "impedance_trajectory"))
    (tmp_path / "config/small.yaml").write_text(
        yaml.safe_dump({"campaign": "small", **of_person, **absent})
    )
    made = [
        tmp_path / f"results/{name}"
        for name in ("tables/impedance_over.csv", "figures/impedance_over.png")
    ]
    ran = run_forked(
        ["snakemake", *FILES, "--", *(str(path.relative_to(tmp_path)) for path in made)], tmp_path
    )
    assert ran.returncode == 0, ran.stdout
    table = pl.read_csv(made[0])
    assert np.ptp(table["at"].to_numpy()) == pytest.approx(16, abs=0.4)
    assert table["K"].to_numpy() == pytest.approx(70 + 4 * table["at"].to_numpy(), abs=2.5)
    made_trial = pl.read_parquet(tmp_path / "results/trials/w.parquet")
    assert made_trial["signal_emg"].to_numpy() == pytest.approx(slow, abs=1e-9)
    assert made[1].stat().st_size > 20_000
