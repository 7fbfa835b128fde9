"""A new campaign: what is drafted from recordings, what is not overwritten, and how editors check its files."""

import json
from pathlib import Path

import pytest
import yaml
from click.testing import CliRunner
from conftest import ROOT
from jsonschema import Draft202012Validator

from osl_analysis.cli import main
from osl_analysis.commands.inspect import draft_campaign
from osl_analysis.commands.reference import schemas
from osl_analysis.commands.run import looked_at, snakemake_arguments
from osl_analysis.errors import InputError
from osl_analysis.files import shipped
from osl_analysis.ingest.draft import draft_trials
from osl_analysis.ingest.raw_files import read_source
from osl_analysis.ingest.source import open_places

KINDS = {
    "config": "config/config.yaml config/campaigns/*/config.yaml config/new_campaign/[ce]*.yaml",
    "simulation": "config/simulation/[!w]*.yaml config/new_campaign/simulation.yaml",
    "gait_laboratory": "config/simulation/walking.yaml", "parameters": "config/parameters/*.yaml",
    "source": "config/sources/*.yaml",
}  # fmt: skip
"""The shipped files of each schema."""


def call(*arguments):
    return CliRunner().invoke(main, [str(a) for a in arguments])


@pytest.mark.parametrize(
    ("column", "name"), [("theta", "AnkleAngleSoll_deg"), ("torque", "tau_ff_Nm"), ("torque", "u_Nm")]
)
def test_a_channel_that_may_be_another_quantity_is_left_to_the_user(tmp_path, column, name):
    names = {"theta": "ankle_angle_deg", "torque": "loadcell_torque_Nm"} | {column: name}
    rows = [f"{k / 100},{k % 7},{k % 5}" for k in range(30)]
    (tmp_path / "a.csv").write_text("\n".join([f"time_s,{names['theta']},{names['torque']}", *rows]))
    content = yaml.safe_load(draft_campaign(tmp_path).sources["csv"])
    (open_place,) = open_places(content)
    assert content["channels"][open_place[-1]]["column"] == name


@pytest.mark.parametrize(("name", "experiment", "told"), [
    ("belt 01", "belt", {}),
    ("impedance_K300_B5.0_uncompensated", "impedance", {"K_d": "300", "B_d": "5.0", "controller": "uncompensated"}),
    ("walk_pert_03", "walking", {"perturbed": "true"}), ("gait_unperturbed_1", "walking", {"perturbed": "false"}),
    ("k300b5_comp", "impedance", {"K_d": "300", "B_d": "5", "controller": "compensated"}), ("k9_sine", "impedance", {}),
    ("k300b5", "impedance", {"K_d": "300", "B_d": "5"}), ("k9_sines", "impedance", {}),
    ("sines_K100_K300", "impedance", {}), ("gait_K300_unpert", "walking", {"perturbed": "false"}),
    ("2026-11-21_K300_B7.5_uncomp", "impedance", {"K_d": "300", "B_d": "7.5", "controller": "uncompensated"}),
    ("imp_K300_B5_non-comp", "impedance", {"K_d": "300", "B_d": "5", "controller": "uncompensated"}),
    ("quasi-static 2", "torque_angle", {}), ("belt_motor", "ingest_only", {}), ("drivetrain", "transmission", {}),
    ("gait_baseline", "walking", {"perturbed": "false"}), ("calib", "static", {}), ("unloaded", "plate", {}),
    ("_-.motor", "actuator", {}), ("walking 3", "ingest_only", {}),
])  # fmt: skip
def test_the_name_of_a_file_tells_its_trial_and_nothing_more(name, experiment, told):
    ((cells, still_open),) = draft_trials([(Path(f"{name}.csv"), "csv", False)])
    assert (cells["experiment"], cells["trial"][0] in "_-.") == (experiment, False)
    assert {k: v for k, v in cells.items() if k in ("K_d", "B_d", "controller", "perturbed")} == told
    assert bool(still_open) != (experiment not in ("ingest_only", "impedance") or {"K_d", "B_d"} <= told.keys())


def test_a_log_and_a_capture_of_one_name_are_one_trial_and_two_logs_are_two():
    files = [("a/walk_1.mcap", False), ("b/walk_1.c3d", True), ("c/walk_1.mcap", False)]
    trials = draft_trials([(Path(path), "s", is_capture) for path, is_capture in files])
    found = [(cells["trial"], cells["log"], cells.get("mocap")) for cells, _ in trials]
    assert found == [("walk_1", "a/walk_1.mcap", "b/walk_1.c3d"), ("walk_1_2", "c/walk_1.mcap", None)]


def test_nothing_is_overwritten_and_nothing_stays_behind(tmp_path):
    for name in ("mine", "empty", "prose"):
        (tmp_path / name).mkdir()
    (tmp_path / "mine/notes.txt").write_text("mine")
    (tmp_path / "prose/a.csv").write_text("this is\nno table\nat all\n")
    before = sorted(tmp_path.rglob("*"))
    for arguments, said in (
        ((tmp_path / "mine",), "not empty"), ((tmp_path / "new", "--from", tmp_path / "empty"), "no recording"),
        ((tmp_path / "new", "--from", tmp_path / "prose"), "no table of numbers"),
        ((tmp_path / "new", "--from", tmp_path / "none"), "no such folder"),
        ((tmp_path / "new", "--recorder", "opensourcelegg"), "did you mean 'opensourceleg'"),
        ((tmp_path / "mine/notes.txt/new",), "choose another place"),
    ):  # fmt: skip
        result = call("init", *arguments)
        assert (result.exit_code, said in result.stderr, len(result.stderr.splitlines())) == (1, True, 1)
    assert sorted(tmp_path.rglob("*")) == before


def test_an_empty_campaign_names_what_is_to_be_done(tmp_path, monkeypatch):
    assert call("init", tmp_path / "mine", "--recorder", "opensourceleg").exit_code == 0
    assert read_source(tmp_path / "mine/sources/opensourceleg.yaml").format == "csv"
    monkeypatch.chdir(tmp_path / "mine")
    (said,) = [found for what, found, _ in looked_at(Path()) if what == "campaign"]
    assert "no trials; add one row per trial" in said
    assert (call("doctor").exit_code, "!! campaign" in call("doctor").output) == (1, True)
    Path("recordings/a.csv").touch()  # the log is there, the capture is not
    sheet = "trial,experiment,log,log_source,mocap,mocap_source,accept\na,belt,a.csv,opensourceleg,a.c3d,vicon,"
    Path("trials.csv").write_text(f"{sheet}gapp\n")
    assert "'gapp' is no quality check" in [*looked_at(Path())][-1][1]
    Path("trials.csv").write_text(f"{sheet}\n")
    lacks = "files of 1 are missing, first of a: correct the sheet"
    assert [*looked_at(Path())][-1] == ("campaign", "mine, 1 trials", lacks)


def test_snakemake_is_given_the_campaign_of_the_folder_or_a_broken_one_is_refused_in_one_line(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(InputError, match="no campaign here"):
        snakemake_arguments([])
    (tmp_path / "config.yaml").write_text("campaign: mine\n")
    snakefile = str(ROOT / "Snakefile")
    assert snakemake_arguments(["-n"]) == ["-n", "--snakefile", snakefile, "--configfile", "config.yaml"]
    assert snakemake_arguments(["--configfile", "config.yaml"])[-1] == snakefile
    assert snakemake_arguments(["--workflow-profile", "none"])[:2] == ["--workflow-profile", "none"]
    for arguments in (["--workflow-profile", "profiles/slurm"], ["--workflow-profile=profiles/slurm"]):
        assert Path(snakemake_arguments(arguments)[len(arguments) - 1].removeprefix("--workflow-profile=")).is_dir()
    for arguments in (["--configfile", "config.yaml", "b.yaml", "-n"], ["-n", "--configfile=b.yaml"]):
        assert "error: b.yaml: no such file" in call("run", *arguments).output
    (tmp_path / "config.yaml").write_text("campaign: x\n  more: [1\n")
    said = call("run")
    assert (said.exit_code, said.output.count("\n")) == (1, 1)
    assert "error: config.yaml: not YAML: mapping values are not allowed here in line 2" in said.output


def test_a_file_of_the_campaign_goes_before_the_shipped_one(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert shipped("Snakefile") == ROOT / "Snakefile"
    (tmp_path / "Snakefile").write_text("mine")
    assert [shipped(one) for one in ("Snakefile", "none.yaml")] == [Path("Snakefile"), Path("none.yaml")]


def test_every_shipped_file_is_valid_by_its_schema_which_refuses_an_unknown_field_and_explains_the_known_ones():
    made = schemas()
    validators = {name: Draft202012Validator(schema) for name, schema in made.items()}
    for pattern, kind in ((pattern, kind) for kind, patterns in KINDS.items() for pattern in patterns.split()):
        files = sorted(ROOT.glob(pattern))
        assert files, pattern
        for file in files:
            text = file.read_text()
            if file.parent.name == "new_campaign" and kind == "config":
                text = text.format(name="mine", raw_data="rec")
            content = json.loads(json.dumps(yaml.safe_load(text), default=str))
            assert [error.message for error in validators[kind].iter_errors(content)] == [], file
    assert not validators["config"].is_valid({"dynamometer": {"cutof_hz": 15}})
    assert not validators["source"].is_valid({"format": "csv", "clock": "master", "chanels": {}})
    assert "sample sheet" in made["config"]["$defs"]["Config"]["properties"]["sheet"]["description"]
