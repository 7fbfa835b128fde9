"""The known formats: how a file is recognised, described by a source file, read, and listed."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pydantic import ConfigDict, field_validator

from osl_analysis.errors import InputError, nearest
from osl_analysis.formats.c3d import is_c3d
from osl_analysis.formats.csv_table import is_text
from osl_analysis.formats.json_lines import is_json_lines
from osl_analysis.formats.mat import is_mat
from osl_analysis.formats.mcap import MAGIC
from osl_analysis.formats.nexus_csv import is_nexus
from osl_analysis.formats.opensim_table import is_opensim
from osl_analysis.formats.other_formats import FIRST_BYTES, refuse_others
from osl_analysis.formats.rosbag import ANY_BAG1, SQLITE, folder_format
from osl_analysis.formats.tdms import is_tdms
from osl_analysis.formats.trc import is_trc
from osl_analysis.ingest.c3d_capture import C3dSource, inspect_c3d, read_c3d_capture
from osl_analysis.ingest.csv_log import CsvSource, inspect_csv, read_csv_log
from osl_analysis.ingest.json_log import JsonSource, inspect_json, read_json_log
from osl_analysis.ingest.log_overview import inspect_mcap, inspect_rosbag1, inspect_rosbag2
from osl_analysis.ingest.mat_log import MatSource, inspect_mat, read_mat_log
from osl_analysis.ingest.message_log import (
    McapSource,
    Rosbag1Source,
    Rosbag2Source,
    read_mcap_log,
    read_rosbag1_log,
    read_rosbag2_log,
)
from osl_analysis.ingest.opensim_log import OpenSimSource, inspect_opensim, read_opensim_log
from osl_analysis.ingest.overview import Overview, refuse_draft
from osl_analysis.ingest.recording import Recording
from osl_analysis.ingest.source_fields import CaptureSource, LogSource
from osl_analysis.ingest.tdms_log import TdmsSource, inspect_tdms, read_tdms_log
from osl_analysis.ingest.text_captures import (
    NexusSource,
    TrcSource,
    inspect_nexus,
    inspect_trc,
    read_nexus_capture,
    read_trc_capture,
)
from osl_analysis.yaml_settings import Settings, read_mapping, read_yaml

Source = LogSource | CaptureSource


@dataclass(frozen=True)
class KnownFormat:
    """One format of logs or captures."""

    begins: Callable[[bytes], bool]  # whether a file that begins with these bytes is of this format
    suffixes: tuple[str, ...]
    """Endings of files of this format, for files that are not recognised by their first bytes."""
    source: type[LogSource] | type[CaptureSource]  # model of the source files that describe such files
    read: Callable[[Path, Any], Recording]  # reads a file by its source file
    inspect: Callable[[Path], Overview]  # lists what a file holds, without a source file

    @property
    def is_capture(self) -> bool:
        """Whether its files come from a motion-capture laboratory."""
        return issubclass(self.source, CaptureSource)


FORMATS = {
    "mcap": KnownFormat(
        lambda begin: begin[: len(MAGIC)] == MAGIC, (".mcap",), McapSource, read_mcap_log, inspect_mcap
    ),
    "rosbag1": KnownFormat(
        lambda begin: begin.startswith(ANY_BAG1), (".bag",), Rosbag1Source, read_rosbag1_log, inspect_rosbag1
    ),
    "rosbag2": KnownFormat(
        lambda begin: begin.startswith(SQLITE), (".db3",), Rosbag2Source, read_rosbag2_log, inspect_rosbag2
    ),
    "c3d": KnownFormat(is_c3d, (".c3d",), C3dSource, read_c3d_capture, inspect_c3d),
    "nexus_csv": KnownFormat(is_nexus, (), NexusSource, read_nexus_capture, inspect_nexus),
    "mat": KnownFormat(is_mat, (".mat",), MatSource, read_mat_log, inspect_mat),
    "tdms": KnownFormat(is_tdms, (".tdms",), TdmsSource, read_tdms_log, inspect_tdms),
    "trc": KnownFormat(is_trc, (".trc",), TrcSource, read_trc_capture, inspect_trc),
    "opensim": KnownFormat(is_opensim, (".mot", ".sto"), OpenSimSource, read_opensim_log, inspect_opensim),
    "json_lines": KnownFormat(is_json_lines, (".jsonl", ".ndjson"), JsonSource, read_json_log, inspect_json),
    "csv": KnownFormat(is_text, (".csv",), CsvSource, read_csv_log, inspect_csv),
}
SUFFIXES = tuple(suffix for known in FORMATS.values() for suffix in known.suffixes)
"""Endings of recordings that are read."""
ANY_TEXT = "csv"  # format of a text file that is not recognised by content or name
NOT_READ = (".h5", ".tsv", ".xlsx")
"""Endings of recordings whose formats are not read: `samples` lists them with the remedy."""


class NamedFormat(Settings):
    """The field of a source file that names the format."""

    model_config = ConfigDict(extra="ignore")

    format: str
    """A name of `FORMATS`."""

    @field_validator("format")
    @classmethod
    def _known(cls, name: str) -> str:
        if name not in FORMATS:
            raise ValueError(f"write one of {', '.join(FORMATS)}{nearest(name, FORMATS)}")
        return name


def read_source(path: Path) -> Source:
    """A source file, checked: columns are canonical, every unit converts to its column's."""
    named = read_yaml(path, NamedFormat).format
    refuse_draft(path, read_mapping(path))
    source = read_yaml(path, FORMATS[named].source)
    source.written_in(path)
    return source


def recognise(path: Path) -> str:
    """Name of a file's format, by what it begins with, or else by its ending."""
    if path.is_dir():
        return folder_format(path)
    begin = beginning(path)
    by_suffix = [name for name, known in FORMATS.items() if path.suffix.lower() in known.suffixes]
    candidates = [*formats_of(path, begin), *by_suffix, *[ANY_TEXT] * is_text(begin)]
    if not candidates:
        raise InputError(
            f"{path}: neither MCAP, C3D nor text (it begins with {begin[:8]!r}); export it as one of these"
        )
    return candidates[0]


def check_format(path: Path, source: Source) -> None:
    """Refuse a file whose content is of another format than its source file says."""
    if path.is_dir():
        found_in = folder_format(path)
        if source.format != found_in:
            raise InputError(
                f"{path}: a folder with a recording in {found_in}, its source file says {source.format}; write "
                f"`format: {found_in}` in a source file for it, or name a file in it"
            )
        return
    begin = beginning(path)
    found = formats_of(path, begin)
    if (found and source.format not in found) or (source.format == ANY_TEXT and not is_text(begin)):
        what = f"is {found[0]}" if found else f"is no text (it begins with {begin[:8]!r})"
        remedy = f"write `format: {found[0]}` in a source file for it" if found else "name the recording itself"
        raise InputError(f"{path}: {what}, its source file says {source.format}; {remedy}")


def formats_of(path: Path, begin: bytes) -> list[str]:
    """The formats that a file has by what it begins with; none for text that only its name can tell."""
    refuse_others(path, begin)  # first: a PNG image begins like C3D
    return [name for name, known in FORMATS.items() if name != ANY_TEXT and known.begins(begin)]


def beginning(path: Path) -> bytes:
    with path.open("rb") as file:
        return file.read(FIRST_BYTES)
