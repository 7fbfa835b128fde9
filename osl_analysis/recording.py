"""What a recording holds, whatever its format: channels, rows, losses, plates and text.

Every format reads its files to one `Recording`. Ingest, `inspect`, `init`, `watch` and `doctor`
take nothing else, and nothing here knows a format.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from enum import StrEnum
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray


class Kind(StrEnum):
    """What a channel is."""

    SIGNAL = "signal"
    MARKER = "marker"  # positions (n, 3), NaN where the marker was not seen
    MODEL_OUTPUT = "model output"  # an angle or a moment that the laboratory's program computed
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
    """

    count: int
    name: str = ""
    rate_hz: float | None = None
    start_s: float = 0.0
    stamps_ns: NDArray[np.int64] | None = None
    lines: NDArray[np.int64] | None = None


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
    unit
        Unit that the file states; empty where it states none.
    likely_unit
        Unit by a convention or a name. It is shown to a user and never used unasked.
    """

    address: Mapping[str, str]
    rows: Rows
    read: Callable[[], NDArray[Any]]
    name: str = ""
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
    checksums
        Whether checksums cover what was read: `checked`, `mixed`, `absent`, or empty where the
        format has none.
    remarks
        A sentence for each lost part.
    """

    read: int = 0
    expected: int | None = None
    end: End = End.WHOLE
    by_topic: Mapping[str, tuple[int, int | None]] = field(default_factory=dict)
    checksums: str = ""
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
        if not self.expected or self.lost is None:
            return 0.0
        return self.lost / self.expected


@dataclass(frozen=True, eq=False)
class Plate:
    """A force plate as its file describes it (C3D manual, FORCE_PLATFORM).

    Attributes
    ----------
    type
        1 to 4 of the C3D manual.
    corners
        Shape (4, 3), in `length_unit`, in the laboratory's axes.
    origin
        Shape (3,), in `length_unit`, in the plate's axes.
    channels
        Its analog channels, in the order of the type.
    calibration
        Shape (6, 6) for type 4.
    """

    number: int
    type: int
    corners: NDArray[np.float64]
    origin: NDArray[np.float64]
    channels: Sequence[Channel]
    length_unit: str = "mm"
    calibration: NDArray[np.float64] | None = None


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
        What `inspect` shows and the provenance keeps: frames, size, first frame.
    settings
        Fields of a source file that the file itself tells, as the delimiter of a table.
    find_unlisted
        Finds a channel that is too many to be listed, as element 7 of an array in a message.
    """

    format: str
    channels: Sequence[Channel]
    loss: Loss = field(default_factory=Loss)
    plates: Sequence[Plate] = ()
    notes: Sequence[str] = ()
    facts: Mapping[str, Any] = field(default_factory=dict)
    settings: Mapping[str, Any] = field(default_factory=dict)
    find_unlisted: Callable[[Mapping[str, str]], Channel | None] | None = None


@dataclass(frozen=True)
class Format:
    """A file format: what a module of `formats/` offers as `FORMAT`.

    Attributes
    ----------
    name
        What `format:` says in a source file.
    suffixes
        Endings of its files, for files that their first bytes do not tell.
    begins
        Whether a file that begins with these bytes is of this format.
    source
        Model of its source files (pydantic, `osl_analysis.source_file`).
    read
        Reads a file; the source file, where there is one, gives the options of the format.
    priority
        Formats with a lower number are asked first whether a file is theirs; text is asked last.
    """

    name: str
    suffixes: tuple[str, ...]
    begins: Callable[[bytes], bool]
    source: type[Any]
    read: Callable[[Path, Any], Recording]
    priority: int = 0
