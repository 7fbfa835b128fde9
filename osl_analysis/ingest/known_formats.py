"""The known formats: how a file is recognised, described by a source file, read, and listed."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pydantic import ConfigDict, field_validator

from osl_analysis.errors import InputError
from osl_analysis.formats.c3d_header import is_c3d
from osl_analysis.formats.csv_text import is_text
from osl_analysis.formats.mcap.walk import MAGIC
from osl_analysis.formats.nexus_csv import is_nexus
from osl_analysis.ingest.c3d_capture import read_c3d_capture
from osl_analysis.ingest.c3d_source import C3dSource
from osl_analysis.ingest.capture_overview import inspect_c3d, inspect_nexus
from osl_analysis.ingest.csv_log import read_csv_log
from osl_analysis.ingest.csv_source import CsvSource
from osl_analysis.ingest.log_overview import inspect_csv, inspect_mcap
from osl_analysis.ingest.mcap_log import McapSource, read_mcap_log
from osl_analysis.ingest.nexus_capture import NexusSource, read_nexus_capture
from osl_analysis.ingest.overview import Overview
from osl_analysis.ingest.recording import Recording
from osl_analysis.ingest.source_fields import CaptureSource, LogSource
from osl_analysis.yaml_settings import Settings, read_yaml

FIRST_BYTES = 1 << 16

Source = LogSource | CaptureSource


@dataclass(frozen=True)
class KnownFormat:
    """One format of logs or captures."""

    begins: Callable[[bytes], bool]
    """Whether a file that begins with these bytes is of this format."""
    suffixes: tuple[str, ...]
    """Endings of files of this format, for files that are not recognised by their first bytes."""
    source: type[LogSource] | type[CaptureSource]
    """Model of the source files that describe such files."""
    read: Callable[[Path, Any], Recording]
    """Reads a file by its source file."""
    inspect: Callable[[Path], Overview]
    """Lists what a file holds, without a source file."""

    @property
    def is_capture(self) -> bool:
        """Whether its files come from a motion-capture laboratory."""
        return issubclass(self.source, CaptureSource)


FORMATS = {
    "mcap": KnownFormat(
        lambda begin: begin[: len(MAGIC)] == MAGIC, (".mcap",), McapSource, read_mcap_log, inspect_mcap
    ),
    "c3d": KnownFormat(is_c3d, (".c3d",), C3dSource, read_c3d_capture, inspect_c3d),
    "nexus_csv": KnownFormat(is_nexus, (), NexusSource, read_nexus_capture, inspect_nexus),
    "csv": KnownFormat(is_text, (".csv",), CsvSource, read_csv_log, inspect_csv),
}
ANY_TEXT = "csv"
"""Format of a text file that is not recognised by content or name."""
NOT_READ = {
    ".bag": "a ROS 1 bag",
    ".db3": "a ROS 2 bag in SQLite",
    ".mat": "a MATLAB file",
    ".mot": "an OpenSim motion",
    ".tdms": "a LabVIEW TDMS file",
    ".trc": "a TRC file",
}
"""Recordings of formats that are not read yet, by the ending of the file."""


class NamedFormat(Settings):
    """The field of a source file that names the format."""

    model_config = ConfigDict(extra="ignore")

    format: str
    """A name of `FORMATS`."""

    @field_validator("format")
    @classmethod
    def _known(cls, name: str) -> str:
        if name not in FORMATS:
            raise ValueError(f"write one of {', '.join(FORMATS)}")
        return name


def read_source(path: Path) -> Source:
    """A source file, checked: columns are canonical, every unit converts to its column's.

    Raises
    ------
    InputError
        The file is missing, or a field is unknown, absent or of a wrong value.
    """
    return read_yaml(path, FORMATS[read_yaml(path, NamedFormat).format].source)


def recognise(path: Path) -> str:
    """Name of a file's format, by what it begins with, or else by its ending.

    Raises
    ------
    InputError
        The file is of no format that is read.
    """
    suffix = path.suffix.lower()
    if suffix in NOT_READ:
        raise InputError(f"{path}: {NOT_READ[suffix]}, which is not read yet; convert it to MCAP, C3D or CSV")
    with path.open("rb") as file:
        begin = file.read(FIRST_BYTES)
    by_content = [name for name, known in FORMATS.items() if known.begins(begin)]
    by_suffix = [name for name, known in FORMATS.items() if suffix in known.suffixes]
    candidates = [*(name for name in by_content if name != ANY_TEXT), *by_suffix, *by_content]
    if not candidates:
        raise InputError(f"{path}: neither MCAP, C3D nor text (it begins with {begin[:8]!r}); convert it")
    return candidates[0]
