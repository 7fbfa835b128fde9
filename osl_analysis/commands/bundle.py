"""`osl-analysis bundle`: a campaign with its results as one ZIP file."""

from contextlib import chdir
from hashlib import sha256
from pathlib import Path
from typing import Any
from zipfile import ZIP_DEFLATED, ZipFile

from ruamel.yaml import YAML

from osl_analysis.campaign.campaign_trials import Campaign, open_campaign
from osl_analysis.campaign.configuration import read_config
from osl_analysis.campaign.result_files import ResultFiles
from osl_analysis.commands.simulate import TRUTH
from osl_analysis.commands.tables import read_summary
from osl_analysis.errors import InputError
from osl_analysis.files import CAMPAIGN, atomic_path, config_here


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
        A result is missing, the sheet names a file outside the campaign's folders, or `output` is
        one of the files.
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
        campaign = open_campaign(config, None)
        files = inputs_of(campaign, content)
        # a run makes the others again
        for published in map(Path, ResultFiles(campaign).published):
            if not published.is_file():
                raise InputError(f"{published}: no such result; run `osl-analysis run` first")
            files[f"results/{published.relative_to(config.results).as_posix()}"] = published
        if output.resolve() in map(Path.resolve, [config_file, *files.values()]):
            raise InputError(f"{output}: is a file of the campaign; name another one")

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
    # a simulator writes the sheet beside its logs, and the truth; no log has the name of a folder
    folder = "sheet" if config.simulation is None else "recordings"
    content["sheet"] = f"{folder}/{config.sheet.name}"
    files = {content["sheet"]: config.sheet}
    for field in ("parameters", "impedance_trajectory", "simulation"):
        file: Path | None = getattr(config, field)
        if file is not None:
            content[field] = f"{field}/{file.name}"
            files[content[field]] = file
    for trial in campaign.trials():
        check_within(campaign, trial)
        for file in (*campaign.logs(trial), *config.raw_data.glob(f"{TRUTH}/{trial}.*")):
            files[f"recordings/{file.relative_to(config.raw_data).as_posix()}"] = file
        for file in campaign.sources(trial):
            files[f"sources/{file.relative_to(config.sources).as_posix()}"] = file
    return files


def check_within(campaign: Campaign, trial: str) -> None:
    """Refuse a trial whose files would not be found in an unpacked bundle."""
    for cell in ("log", "mocap", "log_source", "mocap_source"):
        name = Path(campaign.rows[trial][cell] or "")
        if name.is_absolute() or ".." in name.parts:
            raise InputError(
                f"{campaign.config.sheet}: trial '{trial}': {cell} {name} is outside the folders of"
                " the campaign, so that no bundle can hold it; move it into `raw_data`, or"
                " `sources`, and write its name there"
            )
