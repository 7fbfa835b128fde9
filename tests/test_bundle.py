"""A bundle is what others' tools say that it is, and a stranger who has nothing else gets its
tables again."""

import json
import re
import subprocess
import sys
import zipfile
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner
from snakemake_runs import run_forked

from osl_analysis.campaign.campaign_trials import open_campaign
from osl_analysis.campaign.configuration import read_config
from osl_analysis.cli import main
from osl_analysis.commands.bundle import copy_inputs, write_bundle
from osl_analysis.commands.new_campaign import new_campaign
from osl_analysis.commands.simulate import check_folder
from osl_analysis.errors import InputError
from osl_analysis.files import CAMPAIGN
from osl_analysis.schema import SCHEMA

rocrate = pytest.importorskip("rocrate")
LICENCE, PROFILE = "https://spdx.org/licenses/CC-BY-4.0", "workflow-run-crate-0.5"
RUN, ONE_CORE = ("osl-analysis", "run"), ("--cores", "1", "--quiet")
TABLES = [
    f"results/{name}" for name in ("summary.json", "tables/findings.csv", "tables/settings.csv")
]


def tables_of(folder: Path) -> dict[str, str]:
    return {one.name: one.read_text() for one in (folder / "results/tables").glob("*.csv")}


@pytest.fixture(scope="module")
def campaign(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A campaign of one recording elsewhere, analysed."""
    top, t = tmp_path_factory.mktemp("bundle"), np.arange(2000) / 250
    (top / "day").mkdir()
    angle = sum(size * np.sin(2 * np.pi * f * t) for size, f in ((3, 0.75), (2, 1.5), (1, 3)))
    torque = (
        5 * angle
        + np.gradient(angle, t) / 20
        + 0.05 * np.random.default_rng(2).standard_normal(t.size)
    )
    rows = [f"{x:.4f},{y:.6f},{z:.5f}" for x, y, z in zip(t, angle, torque, strict=True)]
    (top / "day/sines.csv").write_text("\n".join(["time [s],angle [deg],torque [Nm]", *rows, ""]))
    new_campaign(top / "mine", (), top / "day")
    with pytest.raises(InputError, match="no such summary"):
        write_bundle(top / "mine", top / "early.zip", LICENCE, raw=True)
    assert not (top / "early.zip").exists()
    assert (
        run_forked([*RUN, *TABLES, "results/figures/fig5.pdf", *ONE_CORE], top / "mine").returncode
        == 0
    )
    return top / "mine"


@pytest.fixture(scope="module")
def unpacked(campaign: Path) -> Path:
    """Its bundle, without what an older release left among the results."""
    old = campaign / "results/tables/model_comparison.csv"
    old.write_text("trial\n")
    said = CliRunner().invoke(
        main, ["bundle", str(campaign), str(campaign / "b.zip"), "--license", LICENCE, "--raw"]
    )
    assert said.exit_code == 0, said.output
    with zipfile.ZipFile(campaign / "b.zip") as archive:
        archive.extractall(campaign.parent / "elsewhere")
        assert archive.getinfo("raw/sines.csv").date_time[0] > 1980, (
            "results say by it when was recorded"
        )
    old.unlink()
    return campaign.parent / "elsewhere"


VALIDATED = """
import json, sys
from importlib import import_module
from pathlib import Path
import rocrate

context = json.loads((Path(rocrate.__file__).parent / "data/ro-crate.jsonld").read_text())
of_version_1_1 = "https://bioschemas.org/ComputationalWorkflow"
context["@context"]["ComputationalWorkflow"] = of_version_1_1
names = ("shared.jsonld.util", "shared.jsonld.context", "parsers.jsonld")
modules = [import_module(f"rdflib.plugins.{name}") for name in names]
read = modules[0].source_to_json
def without_network(at, *a, **k):
    return (context, None) if str(at).startswith("http") else read(at, *a, **k)
for module in modules:
    module.source_to_json = without_network
from rocrate_validator import models, services

asked = services.ValidationSettings(rocrate_uri=sys.argv[1], profile_identifier=sys.argv[2])
asked.requirement_severity = models.Severity.REQUIRED
issues = services.validate(asked).get_issues()
print(json.dumps([(one.check.identifier, str(one.message)) for one in issues]))
"""
"""The validator with the context of RO-Crate from the library, in place of the network."""


def test_a_validator_of_others_finds_a_workflow_run_crate(unpacked: Path) -> None:
    pytest.importorskip("rocrate_validator")
    command = [sys.executable, "-c", VALIDATED, str(unpacked), PROFILE]
    said = subprocess.run(command, check=True, capture_output=True, text=True).stdout
    of_network = ("ro-crate-1.1_3.1", "ro-crate-1.1_3.2")  # that the context can be loaded
    assert [
        message for check, message in json.loads(said.splitlines()[-1]) if check not in of_network
    ] == []


@pytest.mark.filterwarnings("ignore")
def test_another_library_finds_its_tables_as_the_data_package_describes_them(
    unpacked: Path,
) -> None:
    frictionless = pytest.importorskip("frictionless")
    report = frictionless.validate(str(unpacked / "datapackage.json"))
    assert report.valid, report.flatten(["rowNumber", "fieldName", "message"])[:3]
    package = json.loads((unpacked / "datapackage.json").read_text())
    assert package["tables_schema"] == SCHEMA
    tables = {one["path"]: one["schema"]["fields"] for one in package["resources"]}
    assert {"results/tables/impedance.csv", "results/tables/findings.csv"} <= set(tables)
    stiffness = next(one for one in tables["results/tables/impedance.csv"] if one["name"] == "K")
    assert (stiffness["type"], stiffness["unit"]) == ("number", "N*m/rad")


def test_a_run_of_the_bundle_alone_gives_its_tables_again(campaign: Path, unpacked: Path) -> None:
    published = tables_of(unpacked)
    assert published == tables_of(campaign)
    for one in (unpacked / "results/tables").glob("*.csv"):
        one.unlink()
    assert run_forked([*RUN, *TABLES, *ONE_CORE], unpacked).returncode == 0  # no figures
    assert tables_of(unpacked) == published


def test_without_the_recordings_it_has_their_hashes(campaign: Path, tmp_path: Path) -> None:
    write_bundle(campaign, tmp_path / "b.zip", LICENCE, raw=False)
    with zipfile.ZipFile(tmp_path / "b.zip") as archive:
        archive.extractall(tmp_path)
    assert not (tmp_path / "raw").exists()
    assert not re.search(r"recorded: *\d", (tmp_path / "config.yaml").read_text()), (
        "dates of files are not stated ones"
    )
    (tmp_path / "raw").mkdir()
    (tmp_path / "raw/sines.csv").write_bytes((campaign.parent / "day/sines.csv").read_bytes())
    said = subprocess.run(
        ["sha256sum", "-c", "recordings.sha256"], cwd=tmp_path, check=True, capture_output=True
    )
    assert b"raw/sines.csv: OK" in said.stdout


@pytest.mark.parametrize("raw", [True, False])
def test_a_simulated_campaign_stays_one_that_the_simulator_made(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, raw: bool
) -> None:
    new_campaign(tmp_path / "demo", example="bench")
    monkeypatch.chdir(tmp_path / "demo")
    Path("recordings/truth").mkdir()
    for name in ("truth/b.json", "b.mcap"):
        Path("recordings", name).write_text("x")
    Path("recordings/trials.csv").write_text(
        "trial,experiment,log,log_source\nb,belt,b.mcap,dynamometer_bench\n"
    )
    copy_inputs(open_campaign(read_config(CAMPAIGN), None), tmp_path / "crate", raw=raw)
    monkeypatch.chdir(tmp_path / "crate")
    config = read_config(CAMPAIGN)
    check_folder(config.sheet.parent)
    assert (config.simulation.is_file(), config.sheet.parent, config.sheet.is_file()) == (
        True,
        config.raw_data,
        raw,
    )
