"""`osl-analysis bundle`: a campaign with its results as one ZIP file."""

from contextlib import chdir
from hashlib import sha256
from pathlib import Path
from typing import Any
from zipfile import ZIP_DEFLATED, ZipFile

from ruamel.yaml import YAML

from osl_analysis.campaign.campaign_trials import Campaign, open_campaign
from osl_analysis.campaign.configuration import read_config
from osl_analysis.commands.simulate import TRUTH
from osl_analysis.commands.tables import read_summary
from osl_analysis.files import CAMPAIGN, atomic_path, config_here

# of the results; a run makes the others again
PUBLISHED = ("tables", "figures", "report.html", "summary.json", "numbers.tex", "methods.*")


def write_bundle(folder: Path, output: Path) -> None:
    """Write a campaign with its results as a ZIP file, which `osl-analysis run` analyses again
    wherever it is unpacked.

    Parameters
    ----------
    folder : Path
        That of the campaign.
    output : Path
        Holds configuration, sheet, source and parameter files, recordings, results, and
        `SHA256SUMS` of all of them, which `sha256sum -c` checks.

    Raises
    ------
    InputError
        There are no results.
    OSError
        A file is missing, or cannot be read.
    """
    output = output.absolute()
    with chdir(folder), atomic_path(output) as path:
        config_file = config_here()
        config = read_config(config_file)
        read_summary(config.results / "summary.json")
        # it keeps the comments of the configuration
        content = YAML().load(config_file.read_text(encoding="utf-8"))
        files = inputs_of(open_campaign(config, None), content)
        for published in PUBLISHED:
            for file in files_of(config.results, published):
                files[f"results/{file.relative_to(config.results).as_posix()}"] = file

        # dates before 1980, which ZIP does not know, are no reason to refuse
        with ZipFile(path, "w", ZIP_DEFLATED, strict_timestamps=False) as archive:
            with archive.open(CAMPAIGN.name, "w") as config_in_archive:
                YAML().dump(content, config_in_archive)
            for name, file in files.items():
                archive.write(file, name)
            sums = [
                f"{sha256(archive.read(name)).hexdigest()}  {name}\n" for name in archive.namelist()
            ]
            archive.writestr("SHA256SUMS", "".join(sums))


def inputs_of(campaign: Campaign, content: Any) -> dict[str, Path]:
    """The input files of a campaign, by their names in the bundle, which its configuration
    `content` is made to state."""
    config = campaign.config
    content.update(raw_data="recordings", sources="sources", results="results")
    # a simulator writes the sheet beside its logs, and the truth
    content["sheet"] = f"recordings/{config.sheet.name}"
    files = {content["sheet"]: config.sheet}
    for field in ("parameters", "impedance_trajectory", "simulation"):
        file: Path | None = getattr(config, field)
        if file is not None:
            content[field] = f"{field}/{file.name}"
            files[content[field]] = file
    recordings = [file for trial in campaign.trials() for file in campaign.logs(trial)]
    for file in [*recordings, *files_of(config.raw_data, TRUTH)]:
        files[f"recordings/{file.relative_to(config.raw_data).as_posix()}"] = file
    for trial in campaign.trials():
        for file in campaign.sources(trial):
            files[f"sources/{file.name}"] = file
    return files


def files_of(folder: Path, name: str) -> list[Path]:
    """The files in a folder of this name, or all below a folder in it of this name."""
    return [file for file in [*folder.glob(name), *folder.glob(f"{name}/**/*")] if file.is_file()]
