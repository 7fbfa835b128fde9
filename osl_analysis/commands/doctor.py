"""What `osl-analysis doctor` says: whether this machine and the campaign in the working folder can run."""

import os
import platform
import shutil
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from importlib.metadata import PackageNotFoundError, requires, version
from pathlib import Path

from packaging.requirements import Requirement

from osl_analysis.errors import OslAnalysisError
from osl_analysis.files import CAMPAIGN, root, shipped


@dataclass(frozen=True)
class Looked:
    what: str
    found: str
    remedy: str = ""  # what to do; empty: nothing


def looked_at(folder: Path) -> Iterator[Looked]:
    """What this machine has and lacks, and whether the campaign in a folder can be read."""
    too_old = sys.version_info[:2] < (3, 11)
    there = all(shipped(name).is_file() for name in ("Snakefile", "config/config.yaml"))
    again = "" if there else "install osl-analysis again: the files of its workflow are missing"
    yield Looked("Python", platform.python_version(), "install Python 3.11 or newer" if too_old else "")
    yield Looked("osl-analysis", f"{version('osl-analysis')}, workflow in {root()}", again)
    yield from packages()
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count()
    yield Looked("cores", f"{cores}")
    free = shutil.disk_usage(folder).free / 1e9  # the default campaign takes 0.4 GB, recordings not counted
    few = "make room, or work on another disk" if free < 2 else ""
    yield Looked("free space", f"{free:.0f} GB in {folder.resolve()}", few)
    can = os.access(folder, os.W_OK)
    yield Looked("folder", "can be written to" if can else "cannot be written to", "" if can else "choose another one")
    yield campaign(folder)


def packages() -> Iterator[Looked]:
    """The packages that osl-analysis needs, and those for single formats, where they are too old or not there."""
    extras = ("mat73", "ros", "tdms")
    for text in requires("osl-analysis") or ():
        needed = Requirement(text)
        extra = next((one for one in extras if needed.marker and needed.marker.evaluate({"extra": one})), "")
        if needed.marker and not needed.marker.evaluate() and not extra:
            continue
        try:
            found = version(needed.name)
        except PackageNotFoundError:
            install = f"osl-analysis[{extra}]" if extra else f"{needed}"
            optional = ", only for its files" if extra else ""
            yield Looked(needed.name, f"not installed{optional}", f"pip install '{install}'" if not extra else "")
            continue
        if not needed.specifier.contains(found, prereleases=True):
            yield Looked(needed.name, found, f"pip install '{needed.name}{needed.specifier}'")
        elif needed.name in ("snakemake", "numpy"):
            yield Looked(needed.name, found)


def campaign(folder: Path) -> Looked:
    """The campaign in a folder, as far as its configuration and sheet tell."""
    from osl_analysis.campaign import check_campaign, open_campaign
    from osl_analysis.config import read_config

    path = folder / CAMPAIGN
    if not path.is_file():
        return Looked("campaign", "none in this folder")
    try:
        config = read_config(path)
        if config.simulation is not None:
            return Looked("campaign", f"{config.campaign}, simulated")
        opened = open_campaign(config, None)
        check_campaign(opened)
    except OslAnalysisError as error:
        return Looked("campaign", str(error), "correct it")
    missing = [trial for trial in opened.trials() if not all(log.exists() for log in opened.logs(trial))]
    said = f"{config.campaign}, {len(opened.trials())} trials"
    lack = f"files of {len(missing)} are missing, first of {missing[0]}: correct the sheet" if missing else ""
    return Looked("campaign", said, lack)


def findings_text(found: list[Looked]) -> str:
    width = max(len(one.what) for one in found)
    return "\n".join(
        f"{'!!' if one.remedy else 'ok'} {one.what:<{width}}  {one.found}{f': {one.remedy}' if one.remedy else ''}"
        for one in found
    )
