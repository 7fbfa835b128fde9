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
from osl_analysis.schema import SCHEMA_FIELD
from osl_analysis.table import read_table

PROFILES = {
    "https://w3id.org/ro/wfrun/process/0.5": "Process Run Crate",
    "https://w3id.org/ro/wfrun/workflow/0.5": "Workflow Run Crate",
    "https://w3id.org/workflowhub/workflow-ro-crate/1.0": "Workflow RO-Crate",
}
RAW = "raw"  # folder of the recordings in the bundle
MAIN = "workflow/Snakefile"
# what is published; fits, trials and notes of jobs are made again
PUBLISHED = (
    "tables", "figures", "report.html", "methods.md", "methods.tex", "methods.bib",
    "summary.json", "numbers.tex",
)  # fmt: skip
JSON_TYPES = {"Int": "integer", "Flo": "number", "Boo": "boolean"}  # by begin of polars' type
README = """# {title}

{about}

Run again what `results` has, with Python {python} and the wheel of osl-analysis {version}. Its
release has it, and `pip wheel --no-deps ./osl-analysis` makes it from a clone:

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
        config = read_config(CAMPAIGN)
        crate = Path(scratch) / "crate"
        summary = read_summary(config.results / "summary.json")
        copy_inputs(open_campaign(config, None), crate, raw)
        inputs = files_below(crate)
        copy_results(config.results, crate / "results")
        results = files_below(crate / "results")

        title = f"Campaign {config.campaign}, analysed with osl-analysis {summary['version']}"
        about = ", ".join(str(summary[name]) for name in ("data", "recorded", "configuration"))
        readme = README.format(
            title=title,
            about=about,
            python=platform.python_version(),
            version=summary["version"],
            recordings="" if raw else WITHOUT,
        )
        write_text(crate / "README.md", readme)
        package = {
            "name": config.campaign.lower(),
            "title": title,
            SCHEMA_FIELD: summary.get(SCHEMA_FIELD),
            "resources": list(resources(crate)),
        }
        text = json.dumps(package, indent=1, ensure_ascii=False)
        write_text(crate / "datapackage.json", f"{text}\n")
        write_text(crate / "requirements.txt", installed_packages())
        # to be read: a run takes those of the package, with its job server
        for name in ("Snakefile", "rules"):
            copy(shipped(name), crate / "workflow" / name)
        whole = library.ROCrate(version="1.1")  # as the profiles ask
        whole.name, whole.description, whole.license = title, about, {"@id": licence}
        describe(whole, crate, inputs, results)
        whole.metadata.write(crate)
        # with dates, by which results go
        with ZipFile(path, "w", ZIP_DEFLATED, strict_timestamps=False) as archive:
            for file in sorted(crate.rglob("*")):
                archive.write(file, file.relative_to(crate))
        return len(files_below(crate))


def files_below(folder: Path) -> list[Path]:
    """All files of a folder and of those in it."""
    return [file for file in folder.rglob("*") if file.is_file()]


def copy_results(results: Path, to: Path) -> None:
    """Copy what is published of a campaign's results, without what an older release left there."""
    for name in PUBLISHED:
        copy(results / name, to / name)
    current = {*described_tables_by_name(), *FIGURES, "captions"}
    for file in to.glob("*/*"):
        if file.is_file() and file.stem not in current:
            file.unlink()


def installed_packages() -> str:
    """The installed packages with their versions, as `requirements.txt`."""
    lines = {f"{package.metadata['Name']}=={package.version}\n" for package in distributions()}
    return "".join(sorted(lines, key=str.casefold))


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
    config = campaign.config
    yaml = YAML()
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
    for name, hash_ in hashes.items():
        if hash_ is None:
            raise InputError(
                f"{config.raw_data / name}: cannot be read; a bundle needs every recording or its"
                " hash"
            )
    lines = [f"{hash_}  {RAW}/{name}\n" for name, hash_ in hashes.items()]
    write_text(crate / "recordings.sha256", "".join(lines))
    if not raw:
        return
    for file in recordings:
        copy(file, crate / RAW / file.relative_to(config.raw_data))
    if config.simulation is not None:
        copy(config.sheet.parent / TRUTH, crate / RAW / TRUTH)


def resources(crate: Path) -> Iterator[dict[str, Any]]:
    """The tables as Frictionless resources, each column with type, unit and meaning."""
    known = {table.place: table for table in described_tables()}
    for path in sorted((crate / "results" / "tables").glob("*.csv")):
        if is_refused(path):
            continue
        described = known.get(f"tables/{path.stem}")
        written = pl.read_csv(path, n_rows=0).columns  # `read_table` may add a column `side`
        fields = []
        for name, kind in read_table(path).select(written).schema.items():
            field = {"name": name, "type": JSON_TYPES.get(str(kind)[:3], "string")}
            column = described.columns.get(name) if described else None
            if column is not None:
                field["unit"] = column.unit
                field["description"] = column.meaning
            fields.append(field)
        resource: dict[str, Any] = {
            "name": path.stem,
            "path": path.relative_to(crate).as_posix(),
            "profile": "tabular-data-resource",
        }
        if described is not None:
            resource["title"] = described.rows
        resource["format"] = "csv"
        resource["encoding"] = "utf-8"
        resource["schema"] = {"fields": fields}
        yield resource


def describe(whole: Any, crate: Path, inputs: list[Path], results: list[Path]) -> None:
    """Say in the crate what each file is, and that the workflow made the results of the inputs."""
    entity = optional_module("rocrate.model.contextentity", "a bundle").ContextEntity
    workflow = whole.add_workflow(crate / MAIN, MAIN, main=True, lang="snakemake")
    workflow["name"] = "osl-analysis"
    tool = entity(whole, "#osl-analysis", {"@type": "SoftwareApplication", "name": "osl-analysis"})
    tool["softwareVersion"] = version("osl-analysis")
    workflow["softwareRequirements"] = whole.add(tool)
    entity_of = {}
    for file in sorted(files_below(crate)):
        name = file.relative_to(crate).as_posix()
        if name != MAIN:
            entity_of[file] = whole.add_file(file, name, properties={"name": name})
    profiles = []
    for address, name in PROFILES.items():
        number = address.rpartition("/")[2]
        properties = {"@type": "CreativeWork", "name": name, "version": number}
        profiles.append(whole.add(entity(whole, address, properties)))
    whole.root_dataset["conformsTo"] = profiles
    ended = (crate / "results" / "summary.json").stat().st_mtime
    run = entity(whole, "#run", {"@type": "CreateAction", "name": "osl-analysis run"})
    run["endTime"] = datetime.fromtimestamp(ended, UTC).isoformat(timespec="seconds")
    run["instrument"] = workflow
    run["object"] = [entity_of[file] for file in inputs]
    run["result"] = [entity_of[file] for file in results]
    whole.root_dataset["mentions"] = [whole.add(run)]
