# SPDX-License-Identifier: Apache-2.0
"""`osl-analysis bundle`: a campaign with its results as one ZIP file."""

from contextlib import chdir
from hashlib import sha256
from pathlib import Path
from typing import Any
from zipfile import ZIP_DEFLATED, ZipFile

from ruamel.yaml import YAML

from osl_analysis.base.errors import InputError
from osl_analysis.base.files import CAMPAIGN, ROOT, atomic_path, default_config
from osl_analysis.campaign.campaign_trials import Campaign, open_campaign
from osl_analysis.campaign.configuration import read_config
from osl_analysis.campaign.result_files import ResultFiles
from osl_analysis.commands.simulate import TRUTH, settings_files
from osl_analysis.commands.tables import read_summary_file
from osl_analysis.config.sheet import RECORDINGS, SOURCES


def write_bundle(folder: Path, output: Path) -> list[str]:
    """Write a campaign with its results as a ZIP file, which `osl-analysis run` analyses again
    wherever it is unpacked.

    Parameters
    ----------
    folder : Path
        That of the campaign.
    output : Path
        Holds configuration, sheet, source and parameter files, recordings, results, and
        `SHA256SUMS` of all of them, which `sha256sum -c` checks.

    Returns
    -------
    list of str
        The files that it holds from outside of the campaign's folder, as links may lead to.

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
        config_file = CAMPAIGN if CAMPAIGN.is_file() else default_config()
        config = read_config(config_file)
        read_summary_file(config.results / "summary.json")
        # it keeps the comments of the configuration
        content = YAML().load(config_file.read_text(encoding="utf-8"))
        campaign = open_campaign(config, None)
        files = inputs_of(campaign, content)
        # a run makes the others again
        for published in map(Path, ResultFiles(campaign).published):
            if not published.is_file():
                raise InputError(f"{published}: no such result", "run `osl-analysis run` first")
            files[f"results/{published.relative_to(config.results).as_posix()}"] = published
        if output.resolve() in map(Path.resolve, [config_file, *files.values()]):
            raise InputError(f"{output}: is a file of the campaign", "name another one")

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
        inside = (Path.cwd(), ROOT)
        return [
            str(file)
            for file in files.values()
            if not any(map(file.resolve().is_relative_to, map(Path.resolve, inside)))
        ]


def inputs_of(campaign: Campaign, content: Any) -> dict[str, Path]:
    """The input files of a campaign, by their names in the bundle, which its configuration
    `content` is made to state."""
    config = campaign.config
    content.update(raw_data="recordings", sources="sources", results="results")
    files = dict[str, Path]()
    for field in ("parameters", "impedance_trajectory", "claims", "simulation"):
        file: Path | None = getattr(config, field)
        if file is not None:
            content[field] = f"{field}/{file.name}"
            files[content[field]] = file
    folder = "sheet"  # not among the recordings, of which one may have its name
    if config.simulation is not None:
        folder = "recordings"  # where the simulator writes the sheet
        for file in settings_files(config.simulation, config.shared()):
            if not file.is_absolute() and file not in files.values():  # nor a shipped one
                check_within(f"{config.simulation}:", file)
                files[file.as_posix()] = file
    # unpacked later than the simulation, it is the newer one, by which the simulator goes
    content["sheet"] = f"{folder}/{config.sheet.name}"
    files[content["sheet"]] = config.sheet
    for trial in campaign.trials():
        for cell in (*RECORDINGS, *SOURCES):
            name = Path(campaign.rows[trial][cell] or "")
            check_within(f"{config.sheet}: trial '{trial}': {cell}", name)
        for file in (*campaign.logs(trial), *config.raw_data.glob(f"{TRUTH}/{trial}.*")):
            files[f"recordings/{file.relative_to(config.raw_data).as_posix()}"] = file
        for file in campaign.sources(trial):
            files[f"sources/{file.relative_to(config.sources).as_posix()}"] = file
    return files


def check_within(where: str, name: Path) -> None:
    """Refuse the name of a file that is not found in an unpacked bundle."""
    if name.is_absolute() or ".." in name.parts:
        raise InputError(
            f"{where} {name} is outside the folders of the campaign, so that no bundle can hold it",
            "move it into these, recordings into `raw_data`, and write its name there",
        )
