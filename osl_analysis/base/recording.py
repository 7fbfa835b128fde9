# SPDX-License-Identifier: Apache-2.0
"""What a recording holds, whatever its format: channels, rows, losses, plates and text.

Every format reads its files to one `Recording`. Ingest, `inspect` and `init` take nothing else, and
nothing here knows a format.
"""

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from enum import StrEnum
from functools import cached_property
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from osl_analysis.base.errors import InputError, listing, nearest, shortened
from osl_analysis.base.files import package_yaml
from osl_analysis.base.trial import Array

SECOND_NS = 1_000_000_000
EXPORTED = 0  # type of a plate whose force and moment were exported in the laboratory's axes
MEASURED_BY_TYPE: Any = package_yaml(Path(__file__).with_name("plates.yaml"))
"""By type of plate, what its channels measure in SI units; those of types 4 and 5 when
calibrated."""
CALIBRATED_CHANNELS = {4: 6, 5: 8}
"""By type, the channels that a calibration matrix turns into three forces and three moments."""


class Kind(StrEnum):
    """What a channel is."""

    SIGNAL = "signal"
    MARKER = "marker"  # positions (n, 3), NaN where the marker was not seen
    # angles or moments that the laboratory's program computed: (n, 3), addressed by `label`
    MODEL_OUTPUT = "model output"
    CLOCK = "clock"  # whole nanoseconds


class End(StrEnum):
    """Whether the end of a file is there."""

    WHOLE = "whole"
    MISSING = "missing"  # the recorder did not finish, or the file was cut off
    UNKNOWN = "unknown"  # the format does not mark its end, as in text


@dataclass(frozen=True, eq=False)
class Rows:
    """Instants that channels share: those of a table, a topic, a device or a camera system.

    Attributes
    ----------
    count
        Number of instants.
    name
        Name of the topic, section or group; empty where a file has only one.
    rate_hz
        Rate that the file states.
    start_s
        Time of the first row, on one clock for all rows of a file.
    stamps_ns
        Shape (count,): the recorder's own stamp of each row.
    lines
        Shape (count,): line or message number of each row in the file, for messages to a user.
    noun
        What a row is called in messages to a user: `line`, `message`, `sample`, `frame`, `row`.
    """

    count: int
    name: str = ""
    rate_hz: float | None = None
    start_s: float = 0.0
    stamps_ns: NDArray[np.int64] | None = None
    lines: NDArray[np.int64] | None = None
    noun: str = "row"

    def place(self, row: int | np.integer) -> str:
        """Name a row, counted from 0, to a user."""
        number = f"{row + 1} of {self.count}" if self.lines is None else self.lines[row]
        return f"{self.noun} {number}"

    def counted(self, mask: NDArray[np.bool_]) -> str:
        """Say how many rows a mask (n,) has, and which is the first."""
        return f"{mask.sum()} of {self.count} {self.noun}s, first {self.place(np.argmax(mask))}"


@dataclass(frozen=True, eq=False)
class Channel:
    """One signal of a recording.

    Attributes
    ----------
    address
        Keys and values that name the channel in a source file, as `{"topic": "/leg",
        "field": "joint_angle"}`.
    rows
        The instants of its values.
    read
        Gives the values, shape (n,) or (n, 3), in the type and unit of the file; NaN or masked
        where a value is missing.
    name
        Its name without the place in the file.
    title
        Its name as the file has it, such as `torque [Nm]`, where it has another one.
    unit
        Unit that the file states; empty where it states none.
    likely_unit
        Unit by a convention or a name. It is shown to a user and never used unasked.
    """

    address: Mapping[str, str]
    rows: Rows
    read: Callable[[], NDArray[Any]]
    name: str = ""
    title: str = ""
    unit: str = ""
    likely_unit: str = ""
    kind: Kind = Kind.SIGNAL

    @cached_property
    def values(self) -> NDArray[Any]:
        """The values, read once."""
        return self.read()

    @property
    def key(self) -> str:
        """The address in one text, for messages."""
        return " ".join(self.address.values())


@dataclass(frozen=True)
class Loss:
    """How much of what the recorder wrote was read.

    Attributes
    ----------
    read
        Number of messages or rows that were read.
    expected
        Number that the file declares; None where it does not tell. It is never 0 for "unknown".
    by_topic
        Messages read and expected of each topic, where counts exist.
    remarks
        A sentence for each lost part.
    """

    read: int = 0
    expected: int | None = None
    end: End = End.WHOLE
    by_topic: Mapping[str, tuple[int, int | None]] = field(default_factory=dict)
    remarks: Sequence[str] = ()

    @property
    def lost(self) -> int | None:
        """Number of lost messages or rows; None where it is unknown."""
        if self.expected is None:
            return None
        return max(0, self.expected - self.read)

    @property
    def share(self) -> float:
        """Lost share of what the file declares; 0 where it is unknown."""
        return (self.lost or 0) / (self.expected or 1)


@dataclass(frozen=True, eq=False)
class Plate:
    """A force plate as its file, or the source file, describes it.

    Attributes
    ----------
    type
        1 to 5 of the C3D manual (FORCE_PLATFORM). `EXPORTED`: force and moment were exported in the
        laboratory's axes; its channels are Fx, Fy, Fz, Mx, My, Mz and, where the moment is about a
        point that moves, the coordinates of that point.
    corners
        Shape (4, 3), in `length_unit`, in the laboratory's axes.
    origin
        Shape (3,), in `length_unit`, in the plate's axes. Of type 0: the point about which the
        moment is, in the laboratory's axes.
    channels
        Its analog channels, in the order of the type.
    calibration
        Shape (6, 6) for type 4, (6, 8) for type 5, in N and N times `length_unit` per unit of the
        channels, such as V.
    sign
        -1 where the file has the force on the plate in place of the force on the foot.
    facts
        What the provenance keeps, as the name of the device, or the `foot` whose force it is.
    """

    number: int
    type: int
    corners: Array
    origin: Array
    channels: Sequence[Channel]
    length_unit: str
    facts: Mapping[str, Any]
    calibration: Array | None = None
    sign: int = 1


@dataclass(frozen=True, eq=False)
class Recording:
    """A file, or the files of a bag, as read.

    Attributes
    ----------
    format
        Name of the format.
    notes
        Text of the file: comments, header lines, properties.
    facts
        What `inspect` shows and the provenance keeps, as size and version. A capture tells
        `frames`, `first_frame`, `frame_rate_hz`, `samples_per_frame`, and where it knows them
        `body_mass_kg`, `vertical_on_screen` (`+Z`, `y`), `plates` (how many it describes) and
        `plate_zero_frames` (first and last).
    settings
        Fields of a source file that the file itself tells, as the delimiter of a table.
    questions
        What a user has to decide before all of it can be read, a sentence each, as where force
        plates lie.
    find_unlisted
        Finds a channel that is not listed, as element 7 of an array in a message, or one that is
        named in another way.
    """

    format: str
    channels: Sequence[Channel]
    loss: Loss = field(default_factory=Loss)
    plates: Sequence[Plate] = ()
    notes: Sequence[str] = ()
    facts: Mapping[str, Any] = field(default_factory=dict)
    settings: Mapping[str, Any] = field(default_factory=dict)
    questions: Sequence[str] = ()
    find_unlisted: Callable[[Mapping[str, str]], Channel | None] = lambda address: None

    def find(self, address: Mapping[str, str], noun: str = "") -> Channel:
        """Find the channel that a source file names.

        Parameters
        ----------
        address
            Keys and values, the most general first. The last value is a full name, a name without
            place or unit (`Channel.name`), a pattern with `*` that fits one channel, or its number
            of a column, label or channel (`NUMBERED`), counted from 1.
        noun
            What the channel is called in messages; the last key if empty.

        Raises
        ------
        InputError
            No channel, or several channels have this address.
        """
        similar = [channel for channel in self.channels if channel.address.keys() == address.keys()]
        *place, (key, wanted) = address.items()
        candidates = [channel for channel in similar if [*channel.address.items()][:-1] == place]
        matches = _named(wanted, candidates, key)
        if len(matches) > 1:
            names = [channel.key for channel in matches]
            numbers = [str(candidates.index(channel) + 1) for channel in matches]
            remedy = f"write one of {listing(names)}"
            if len(set(names)) < len(names):
                remedy = f"rename them, or write the number of a column, one of {listing(numbers)},"
            raise InputError(
                f"{noun or key} '{shortened(wanted)}' occurs {len(matches)} times",
                f"{remedy} in the source file",
            )
        channel = matches[0] if matches else self.find_unlisted(address)
        if channel:
            return channel
        missing = f"no {noun or ' '.join(address)} '{shortened(' '.join(address.values()))}'"
        if not similar:
            raise InputError(f"{missing}: the file has none", "export them too")
        keys = [channel.key for channel in similar]
        known = [*keys, *(channel.name for channel in similar)]
        advice = nearest(wanted, known) or "; correct the name in the source file"
        raise InputError(missing, f"the file has {listing(keys)}{advice}")


NUMBERED = ("column", "label", "channel")  # keys whose channel may be given by its number


def _named(wanted: str, channels: Sequence[Channel], key: str) -> list[Channel]:
    """List the channels with a name: in full, without place or unit, by pattern, or by number."""
    pattern = re.compile(re.escape(wanted).replace(r"\*", ".*"), re.DOTALL)
    names = [(channel.address[key], channel.title, channel.name) for channel in channels]
    for is_alike, spelled in product((wanted.__eq__, pattern.fullmatch), zip(*names, strict=True)):
        matches = [channels[row] for row, name in enumerate(spelled) if is_alike(name)]
        if matches:
            return matches
    is_number = key in NUMBERED and wanted.isdecimal()
    return list(channels[int(wanted) - 1 : int(wanted)]) if is_number else []


def alone(path: Path) -> Sequence[Path]:
    """The files of a recording that is one file."""
    return [path]


@dataclass(frozen=True)
class Format:
    """A file format: what a module of `formats/` offers as `FORMAT`.

    Attributes
    ----------
    name
        What `format:` says in a source file.
    suffixes
        Endings of its files, by which a folder is searched.
    begins
        Whether a file that begins with these bytes is of this format.
    source
        Model of its source files (pydantic, `osl_analysis.base.source_file`).
    read
        Reads a file; the source file, where there is one, gives the options of the format.
    is_any_text
        Whether any text may be of it; then others are asked first.
    is_folder
        Whether a folder is one recording of this format.
    files_in
        Files of such a folder that are the recording, or those that belong to a file with this
        suffix, which comes first.
    """

    name: str
    suffixes: tuple[str, ...]
    begins: Callable[[bytes], object]
    source: type[Any]
    read: Callable[[Path, Any], Recording]
    is_any_text: bool = False
    is_folder: Callable[[Path], bool] = lambda path: False
    files_in: Callable[[Path], Sequence[Path]] = alone
