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
    "config/config.yaml": "config",
    "config/campaigns/*/config.yaml": "config",
    "config/new_campaign/config.yaml": "config",
    "config/new_campaign/example.yaml": "config",
    "config/new_campaign/simulation.yaml": "simulation",
    "config/sources/*.yaml": "source",
    "config/parameters/*.yaml": "parameters",
    "config/simulation/walking.yaml": "gait_laboratory",
    "config/simulation/[!w]*.yaml": "simulation",
}
"""The schema of each shipped file."""
"""Fields of source files that hold a unit, beside those of plates."""


def call(*arguments):
    return CliRunner().invoke(main, [str(a) for a in arguments])


@pytest.mark.parametrize(
    ("column", "name"),
    [
        *(("theta", f"{name}_deg") for name in ("theta_d", "theta_set", "q_d", "AnkleAngleSoll", "knee_angle")),
        *(("torque", f"{name}_Nm") for name in ("torque_model", "tau_ff", "torque_set", "drive_torque", "u")),
    ],
)
def test_a_channel_that_may_be_another_quantity_is_left_to_the_user(tmp_path, column, name):
    names = {"theta": "ankle_angle_deg", "torque": "loadcell_torque_Nm"} | {column: name}
    rows = [f"{k / 100},{k % 7},{k % 5}" for k in range(30)]
    (tmp_path / "a.csv").write_text("\n".join([f"time_s,{names['theta']},{names['torque']}", *rows]))
    content = yaml.safe_load(draft_campaign(tmp_path).sources["csv"])
    (open_place,) = open_places(content)
    assert content["channels"][open_place[-1]]["column"] == name


@pytest.mark.parametrize(
    ("name", "experiment", "told"),
    [
        ("belt 01", "belt", {}),
        ("impedance_K300_B5.0_uncompensated", "impedance", {"K_d": "300", "B_d": "5.0", "controller": "uncompensated"}),
        ("K_d=250_run2", "impedance", {"K_d": "250"}),
        ("walk_pert_03", "walking", {"perturbed": "true"}),
        ("gait_unperturbed_1", "walking", {"perturbed": "false"}),
        ("stand", "static", {}),
        ("K1_B2_K300", "ingest_only", {}),
        ("standing_K300_B5", "ingest_only", {}),
        ("K300_B2p5", "impedance", {"K_d": "300"}),
        ("k300b5", "impedance", {"K_d": "300", "B_d": "5"}),
        ("2026-11-21_K300_B7.5_uncomp", "impedance", {"K_d": "300", "B_d": "7.5", "controller": "uncompensated"}),
    ],
)
def test_the_name_of_a_file_tells_its_trial_and_nothing_more(name, experiment, told):
    ((cells, still_open),) = draft_trials([(Path(f"{name}.csv"), "csv", False)])
    assert cells["experiment"] == experiment
    assert {k: v for k, v in cells.items() if k in ("K_d", "B_d", "controller", "perturbed")} == told
    complete = experiment not in ("ingest_only", "impedance") or {"K_d", "B_d"} <= told.keys()
    assert bool(still_open) != complete


def test_a_log_and_a_capture_of_one_name_are_one_trial_and_two_logs_are_two():
    files = [("a/walk_1.mcap", False), ("b/walk_1.c3d", True), ("c/walk_1.mcap", False)]
    trials = draft_trials([(Path(path), "s", is_capture) for path, is_capture in files])
    assert [cells["trial"] for cells, _ in trials] == ["walk_1", "walk_1_2"]
    assert (trials[0][0]["log"], trials[0][0]["mocap"]) == ("a/walk_1.mcap", "b/walk_1.c3d")


def test_nothing_is_overwritten_and_nothing_stays_behind(tmp_path):
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine/notes.txt").write_text("mine")
    (tmp_path / "empty").mkdir()
    (tmp_path / "prose").mkdir()
    (tmp_path / "prose/a.csv").write_text("this is\nno table\nat all\n")
    before = sorted(tmp_path.rglob("*"))
    for arguments, said in (
        ((tmp_path / "mine",), "not empty"),
        ((tmp_path / "new", "--from", tmp_path / "empty"), "no recording"),
        ((tmp_path / "new", "--from", tmp_path / "prose"), "no table of numbers"),
        ((tmp_path / "new", "--from", tmp_path / "none"), "no such folder"),
        ((tmp_path / "new", "--recorder", "opensourcelegg"), "did you mean 'opensourceleg'"),
        ((tmp_path / "mine/notes.txt/new",), "choose another place"),
    ):
        result = call("init", *arguments)
        assert result.exit_code == 1
        assert said in result.stderr
        assert len(result.stderr.splitlines()) == 1
    assert sorted(tmp_path.rglob("*")) == before


def test_an_empty_campaign_names_what_is_to_be_done(tmp_path, monkeypatch):
    assert call("init", tmp_path / "mine", "--recorder", "opensourceleg").exit_code == 0
    assert read_source(tmp_path / "mine/sources/opensourceleg.yaml").format == "csv"
    monkeypatch.chdir(tmp_path / "mine")
    assert [
        "no trials; add one row per trial" in found for what, found, _ in looked_at(Path()) if what == "campaign"
    ] == [True]


def test_snakemake_is_given_the_campaign_of_the_folder_or_a_broken_one_is_refused_in_one_line(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(InputError, match="no campaign here"):
        snakemake_arguments([])
    (tmp_path / "config.yaml").write_text("campaign: mine\n")
    snakefile = str(ROOT / "Snakefile")
    assert snakemake_arguments(["-n"]) == ["-n", "--snakefile", snakefile, "--configfile", "config.yaml"]
    (tmp_path / "a.yaml").write_text("campaign: other\n")
    assert snakemake_arguments(["--configfile", "a.yaml"])[-1] == snakefile
    for arguments in (["--workflow-profile", "profiles/slurm"], ["--workflow-profile=profiles/slurm"]):
        assert Path(snakemake_arguments(arguments)[len(arguments) - 1].removeprefix("--workflow-profile=")).is_dir()
    (tmp_path / "profiles/slurm").mkdir(parents=True)
    assert snakemake_arguments(["--workflow-profile", "profiles/slurm"])[1] == "profiles/slurm"
    stated = ["--configfile", "a.yaml", "b.yaml", "-n"], ["-n", "--configfile=b.yaml"]
    for arguments in stated:
        assert "error: b.yaml: no such file" in call("run", *arguments).output
    for name, arguments in (("b.yaml", stated[0]), ("b.yaml", stated[1]), ("config.yaml", [])):
        (tmp_path / name).write_text("campaign: x\n  more: [1\n")
        said = call("run", *arguments)
        assert (said.exit_code, said.output.count("\n")) == (1, 1)
        assert f"error: {name}: not YAML: mapping values are not allowed here in line 2" in said.output


def test_a_file_of_the_campaign_goes_before_the_shipped_one(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    name = "config/parameters/default.yaml"
    assert shipped(name) == ROOT / name
    (tmp_path / name).parent.mkdir(parents=True)
    (tmp_path / name).write_text("name: mine\n")
    assert [shipped(one) for one in (name, "config/none.yaml")] == [Path(name), Path("config/none.yaml")]


def test_every_shipped_file_is_valid_by_its_schema_which_refuses_an_unknown_field_and_explains_the_known_ones():
    made = schemas()
    validators = {name: Draft202012Validator(schema) for name, schema in made.items()}
    for schema in made.values():
        Draft202012Validator.check_schema(schema)
    for pattern, kind in KINDS.items():
        files = sorted(ROOT.glob(pattern))
        assert files, pattern
        for file in files:
            text = file.read_text()
            if file.parent.name == "new_campaign" and kind == "config":
                text = text.format(name="mine", raw_data="rec")
            content = json.loads(json.dumps(yaml.safe_load(text), default=str))
            assert [error.message for error in validators[kind].iter_errors(content)] == [], file
    assert not validators["config"].is_valid({"dynamometer": {"cutof_hz": 15}})
    assert not validators["config"].is_valid({"dynamometer": {"cutoff_hz": -1}})
    assert not validators["source"].is_valid({"format": "csv", "clock": "master", "chanels": {}})
    assert "sample sheet" in made["config"]["$defs"]["Config"]["properties"]["sheet"]["description"]
