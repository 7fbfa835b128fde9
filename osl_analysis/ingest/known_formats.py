"""The known formats: how a file is recognised, which keys its source files have, how it is read and listed."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path

from pydantic import ConfigDict, field_validator

from osl_analysis.config.yaml_settings import Settings, read_mapping, read_yaml
from osl_analysis.errors import InputError, nearest, printable
from osl_analysis.formats.c3d import is_c3d
from osl_analysis.formats.csv_table import is_text
from osl_analysis.formats.gait_text import is_nexus, is_opensim, is_trc
from osl_analysis.formats.json_lines import is_json_lines
from osl_analysis.formats.mat import is_mat
from osl_analysis.formats.mcap import MAGIC
from osl_analysis.formats.other_formats import FIRST_BYTES, refuse_others
from osl_analysis.formats.rosbag import ANY_BAG1, SQLITE, folder_format
from osl_analysis.formats.tdms import is_tdms
from osl_analysis.ingest.captures import read_c3d_capture, read_nexus_capture, read_trc_capture
from osl_analysis.ingest.inspect_captures import inspect_c3d, inspect_nexus, inspect_trc
from osl_analysis.ingest.inspect_logs import (
    inspect_csv,
    inspect_json,
    inspect_mat,
    inspect_messages,
    inspect_opensim,
    inspect_tdms,
)
from osl_analysis.ingest.message_log import read_message_log
from osl_analysis.ingest.overview import Overview, refuse_draft
from osl_analysis.ingest.recording import Recording
from osl_analysis.ingest.source import KEYS, Keys, Source, model_of
from osl_analysis.ingest.table_log import read_table_log


@contextmanager
def named(path: Path) -> Iterator[None]:
    """Every refusal names the file."""
    try:
        yield
    except InputError as error:
        if printable(str(path)) in str(error):
            raise
        raise InputError(f"{path}: {error}") from error


@dataclass(frozen=True)
class KnownFormat:
    """One format of logs or captures."""

    name: str  # its name in source files
    begins: Callable[[bytes], bool]  # whether a file that begins with these bytes is of this format
    suffixes: tuple[str, ...]
    """Endings of files of this format, for files that are not recognised by their first bytes."""
    reader: Callable[[Path, Source], Recording]  # reads a file by its source file
    lister: Callable[[Path], Overview]  # lists what a file holds, without a source file
    own_keys: Keys | None = None  # keys of its source files, where `KEYS` has none
    source: type[Source] = field(init=False)
    """The model of its source files, made at import, so that processes forked later share it."""

    @property
    def keys(self) -> Keys:
        """The keys of its source files."""
        return self.own_keys or KEYS[self.name]

    @property
    def is_capture(self) -> bool:
        """Whether its files come from a motion-capture laboratory."""
        return "channels" not in self.keys.source.split()

    def __post_init__(self) -> None:
        object.__setattr__(self, "source", model_of(self.name, self.keys))

    def read(self, path: Path, source: Source) -> Recording:
        """A file as canonical columns in SI units, by its source file. Raises InputError, which names the file."""
        with named(path):
            return self.reader(path, source)

    def inspect(self, path: Path) -> Overview:
        """What a file holds. Raises InputError, which names the file."""
        with named(path):
            return self.lister(path)


FORMATS = {
    "mcap": KnownFormat(
        "mcap", lambda begin: begin.startswith(MAGIC), (".mcap",), read_message_log, partial(inspect_messages, "mcap")
    ),
    "rosbag1": KnownFormat(
        "rosbag1",
        lambda begin: begin.startswith(ANY_BAG1),
        (".bag",),
        read_message_log,
        partial(inspect_messages, "rosbag1"),
    ),
    "rosbag2": KnownFormat(
        "rosbag2",
        lambda begin: begin.startswith(SQLITE),
        (".db3",),
        read_message_log,
        partial(inspect_messages, "rosbag2"),
    ),
    "c3d": KnownFormat("c3d", is_c3d, (".c3d",), read_c3d_capture, inspect_c3d),
    "nexus_csv": KnownFormat("nexus_csv", is_nexus, (), read_nexus_capture, inspect_nexus),
    "mat": KnownFormat("mat", is_mat, (".mat",), read_table_log, inspect_mat),
    "tdms": KnownFormat("tdms", is_tdms, (".tdms",), read_table_log, inspect_tdms),
    "trc": KnownFormat("trc", is_trc, (".trc",), read_trc_capture, inspect_trc),
    "opensim": KnownFormat("opensim", is_opensim, (".mot", ".sto"), read_table_log, inspect_opensim),
    "json_lines": KnownFormat("json_lines", is_json_lines, (".jsonl", ".ndjson"), read_table_log, inspect_json),
    "csv": KnownFormat("csv", is_text, (".csv",), read_table_log, inspect_csv),
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
    name = read_yaml(path, NamedFormat).format
    refuse_draft(path, read_mapping(path))
    source = read_yaml(path, FORMATS[name].source)
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
