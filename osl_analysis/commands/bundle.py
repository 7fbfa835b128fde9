"""`osl-analysis bundle`: a campaign and its results as one file that is deposited, checked and
rerun: a Workflow Run RO-Crate (https://w3id.org/ro/wfrun/workflow/0.5), whose tables are a
Frictionless data package."""

import json
import platform
import shutil
from collections.abc import Iterator
from contextlib import chdir
from datetime import UTC, datetime
from importlib.metadata import distributions, version
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any
from zipfile import ZIP_DEFLATED, ZipFile

import polars as pl
from ruamel.yaml import YAML

from osl_analysis.campaign.campaign_trials import Campaign, open_campaign
from osl_analysis.campaign.configuration import read_config
from osl_analysis.commands.simulate import TRUTH
from osl_analysis.commands.tables import read_summary
from osl_analysis.dictionary import described_tables, described_tables_by_name
from osl_analysis.errors import InputError, optional_module
from osl_analysis.figures import FIGURES
from osl_analysis.files import CAMPAIGN, atomic_path, digest, root, shipped, write_text
from osl_analysis.refusal import is_refused
from osl_analysis.table import read_table

PROFILES = {
    "https://w3id.org/ro/wfrun/process/0.5": "Process Run Crate",
    "https://w3id.org/ro/wfrun/workflow/0.5": "Workflow Run Crate",
    "https://w3id.org/workflowhub/workflow-ro-crate/1.0": "Workflow RO-Crate",
}
RAW, MAIN = "raw", "workflow/Snakefile"  # in the bundle
README = """# {title}

{about}

Run again what `results` has, with Python {python} and the wheel of osl-analysis {version},
which its release has:

    python -m pip install --no-deps osl_analysis-{version}-py3-none-any.whl -r requirements.txt
    osl-analysis run

{recordings}`datapackage.json` says what each column of each table is, `ro-crate-metadata.json` what
was made of what.
"""
WITHOUT = """The recordings are not in here: put them below `raw/` first.
`sha256sum -c recordings.sha256` says whether they are those of these results.

"""


def write_bundle(folder: Path, output: Path, licence: str, raw: bool) -> int:
    """Write the campaign in a folder with its results as a ZIP file under a licence, an address,
    and with the recordings if `raw`; how many files it has. InputError without results, or where a
    recording is missing."""
    library = optional_module("rocrate.rocrate", "a bundle")
    output = output.absolute()
    with chdir(folder), TemporaryDirectory() as scratch, atomic_path(output) as path:
        config, crate = read_config(CAMPAIGN), Path(scratch) / "crate"
        summary = read_summary(config.results / "summary.json")
        copy_inputs(open_campaign(config, None), crate, raw)
        given = [file for file in crate.rglob("*") if file.is_file()]
        # what is published; fits, trials and notes of jobs are made again
        for name in (
            "tables",
            "figures",
            "report.html",
            "methods.md",
            "methods.tex",
            "methods.bib",
            "summary.json",
            "numbers.tex",
        ):
            copy(config.results / name, crate / "results" / name)
        current = {*described_tables_by_name(), *FIGURES, "captions"}
        for file in (crate / "results").glob("*/*"):
            if file.is_file() and file.stem not in current:  # an older release left it
                file.unlink()
        made = [file for file in (crate / "results").rglob("*") if file.is_file()]
        title = f"Campaign {config.campaign}, analysed with osl-analysis {summary['version']}"
        about = ", ".join(str(summary[name]) for name in ("data", "recorded", "configuration"))
        said = {
            "title": title,
            "about": about,
            "python": platform.python_version(),
            "version": summary["version"],
            "recordings": WITHOUT * (not raw),
        }
        write_text(crate / "README.md", README.format(**said))
        package = {
            "name": config.campaign.lower(),
            "title": title,
            "resources": [*resources(crate)],
        }
        write_text(
            crate / "datapackage.json", json.dumps(package, indent=1, ensure_ascii=False) + "\n"
        )
        lock = sorted(
            {f"{one.metadata['Name']}=={one.version}\n" for one in distributions()},
            key=str.casefold,
        )
        write_text(crate / "requirements.txt", "".join(lock))
        # to be read: a run takes those of the package, with its job server
        for name in ("Snakefile", "rules"):
            copy(shipped(name), crate / "workflow" / name)
        whole = library.ROCrate(version="1.1")  # as the profiles ask
        whole.name, whole.description, whole.license = title, about, {"@id": licence}
        describe(whole, crate, given, made)
        whole.metadata.write(crate)
        # with dates, by which results go
        with ZipFile(path, "w", ZIP_DEFLATED, strict_timestamps=False) as archive:
            for file in sorted(crate.rglob("*")):
                archive.write(file, file.relative_to(crate))
        return sum(file.is_file() for file in crate.rglob("*"))


def copy(file: Path, to: Path) -> None:
    """A file or a folder with its dates; what is not there is not copied."""
    to.parent.mkdir(parents=True, exist_ok=True)
    if file.is_dir():
        shutil.copytree(file, to)
    elif file.is_file():
        shutil.copy2(file, to)


def copy_inputs(campaign: Campaign, crate: Path, raw: bool) -> None:
    """Configuration, sheet, source and parameter files, and the recordings or their hashes. The
    configuration names them where they are in the bundle."""
    config, yaml = campaign.config, YAML()
    content = yaml.load(CAMPAIGN.read_text(encoding="utf-8"))
    # the simulator writes the sheet beside its logs, and `truth`
    is_simulated = config.simulation is not None
    sheet = f"{RAW}/{config.sheet.name}" if is_simulated else config.sheet.name
    content |= {"raw_data": RAW, "sheet": sheet, "sources": "sources", "results": "results"}
    for name in ("parameters", "impedance_trajectory", "simulation"):
        own: Path | None = getattr(config, name)
        # a shipped one keeps its name
        if own is not None and not own.resolve().is_relative_to(root().resolve()):
            content[name] = f"{name}/{own.name}"
            copy(own, crate / content[name])
    if not is_simulated or raw:
        copy(config.sheet, crate / sheet)
    for file in {file for trial in campaign.trials() for file in campaign.sources(trial)}:
        copy(file, crate / "sources" / file.name)
    copy_recordings(campaign, crate, raw)
    yaml.dump(content, crate / CAMPAIGN)


def copy_recordings(campaign: Campaign, crate: Path, raw: bool) -> None:
    """The hashes of the recordings, and themselves if `raw`, with a simulator's truth. Raises
    InputError."""
    config = campaign.config
    recordings = sorted({file for trial in campaign.trials() for file in campaign.logs(trial)})
    hashes = {file.relative_to(config.raw_data).as_posix(): digest(file) for file in recordings}
    if missing := [name for name, found in hashes.items() if found is None]:
        raise InputError(
            f"{config.raw_data / missing[0]}: cannot be read; a bundle needs every recording or its"
            " hash"
        )
    write_text(
        crate / "recordings.sha256",
        "".join(f"{found}  {RAW}/{name}\n" for name, found in hashes.items()),
    )
    for file in recordings if raw else ():
        copy(file, crate / RAW / file.relative_to(config.raw_data))
    if config.simulation is not None and raw:
        copy(config.sheet.parent / TRUTH, crate / RAW / TRUTH)


def resources(crate: Path) -> Iterator[dict[str, Any]]:
    """The tables as Frictionless resources, each column with type, unit and meaning."""
    known = {table.place: table for table in described_tables()}
    kinds = {"Int": "integer", "Flo": "number", "Boo": "boolean"}
    for path in sorted((crate / "results" / "tables").glob("*.csv")):
        if is_refused(path):
            continue
        table, described = read_table(path), known.get(f"tables/{path.stem}")
        fields = []
        # those that are written
        for name, kind in table.select(pl.read_csv(path, n_rows=0).columns).schema.items():
            field = {"name": name, "type": kinds.get(str(kind)[:3], "string")}
            column = described.columns.get(name) if described else None
            fields.append(
                field | ({"unit": column.unit, "description": column.meaning} if column else {})
            )
        place = {
            "name": path.stem,
            "path": path.relative_to(crate).as_posix(),
            "profile": "tabular-data-resource",
        }
        about = {"title": described.rows} if described else {}
        yield place | about | {"format": "csv", "encoding": "utf-8", "schema": {"fields": fields}}


def describe(whole: Any, crate: Path, given: list[Path], made: list[Path]) -> None:
    """Say in the crate what each file is, and that the workflow made the results of what was
    given."""
    entity = optional_module("rocrate.model.contextentity", "a bundle").ContextEntity
    workflow = whole.add_workflow(crate / MAIN, MAIN, main=True, lang="snakemake")
    workflow["name"] = "osl-analysis"
    tool = entity(whole, "#osl-analysis", {"@type": "SoftwareApplication", "name": "osl-analysis"})
    tool["softwareVersion"] = version("osl-analysis")
    workflow["softwareRequirements"] = whole.add(tool)
    every = {}
    for file in (one for one in sorted(crate.rglob("*")) if one.is_file()):
        if (name := file.relative_to(crate).as_posix()) != MAIN:
            every[file] = whole.add_file(file, name, properties={"name": name})
    profiles = [
        whole.add(
            entity(
                whole, at, {"@type": "CreativeWork", "name": name, "version": at.rpartition("/")[2]}
            )
        )
        for at, name in PROFILES.items()
    ]
    whole.root_dataset["conformsTo"] = profiles
    ended = (crate / "results" / "summary.json").stat().st_mtime
    run = entity(whole, "#run", {"@type": "CreateAction", "name": "osl-analysis run"})
    run["endTime"] = datetime.fromtimestamp(ended, UTC).isoformat(timespec="seconds")
    run["instrument"] = workflow
    run["object"], run["result"] = ([every[one] for one in files] for files in (given, made))
    whole.root_dataset["mentions"] = [whole.add(run)]
