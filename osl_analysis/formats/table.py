"""The table that every format is read into, with columns as in the file, unconverted; and the
ledger of its losses."""

import errno
import re
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from osl_analysis.errors import InputError, printable
from osl_analysis.trial import Array

MOST_BYTES = 4_000_000_000  # largest memory for the values of a recording
LIBRARY_REMEDY = "copy the file again, or export it anew"


@contextmanager
def in_one_sentence(what: str = "", remedy: str = LIBRARY_REMEDY) -> Iterator[None]:
    """Turn any error of a library about a damaged file into one InputError."""
    try:
        yield
    except (InputError, MemoryError, KeyboardInterrupt, SystemExit, GeneratorExit):
        raise
    except BaseException as error:  # also a panic of Rust
        raise InputError(f"{what}cannot be read ({reason_of(error)}); {remedy}") from error


def reason_of(error: BaseException) -> str:
    """The meaning of a library's error about a damaged file. An error of the system, such as a full
    disk, stays."""
    # EINVAL: a wrong file offset
    if isinstance(error, OSError) and error.strerror and error.errno != errno.EINVAL:
        return error.strerror
    said = str(error)
    if re.search(
        r"(?i)truncated|past end|must end|whole buffer|not enough bytes|could not read|EOCD|no end",
        said,
    ):
        return "it is cut off, or its end is lost"
    if re.search(r"(?i)decompress|filter returned|snappy|zstd|invalid data stream", said):
        return "a packed part of it is damaged"
    return "its parts contradict each other"


def check_memory(size: int, what: str = "its values") -> None:
    """Refuse values that take more memory [bytes] than a recording may."""
    if size > MOST_BYTES:
        said = (
            f"{what} take {size / 1e9:.3g} GB of memory, at most {MOST_BYTES / 1e9:g} GB are read"
        )
        raise InputError(
            f"{said}: damaged, or no recording; save the signals of one trial in a file of"
            " their own"
        )


@dataclass
class Ledger:
    """Counts of what a file should hold, what was read and what is lost. They are made while it is
    read, of messages, or of the rows of a table. An unknown count is None, never 0."""

    # the recorder did not finish, or the file was cut off: what followed is unknown
    end_missing: bool = False
    # the format does not mark its end, as in text: a cut file looks whole
    end_unknown: bool = False
    gaps: bool = False  # some part of the file, perhaps its summary, is missing or cannot be read
    # number of messages that the file declares; None if it does not, or is not trusted
    expected: int | None = None
    declared_chunks: int | None = None  # number of chunks that the file declares
    read: int = 0  # messages
    verified: int = 0  # messages that were read and are covered by a correct checksum
    misfits: int = 0  # messages of `read` that do not fit their schema: lost
    chunks: int = 0
    chunks_lost: int = 0  # chunks that were found but could not be read
    indexed_lost: int = 0  # lost messages whose number is known
    skipped: int = 0  # messages that are missing by the recorder's sequence numbers
    uncounted: bool = False  # something is or may be lost, and its number of messages is unknown
    bytes: int = 0  # size of the file's data section
    bytes_lost: int = 0  # bytes of it that could not be read, without those beyond a cut-off end
    # what is missing, was repaired or left out, a sentence each
    remarks: list[str] = field(default_factory=list)

    def lose(self, remark: str, size: int, messages: int | None, chunks: int) -> None:
        """Count a lost part: `size` bytes, messages (None: number unknown), chunks."""
        self.remarks.append(remark)
        self.chunks_lost += chunks
        self.bytes_lost += size
        self.gaps = True
        self.uncounted |= messages is None
        self.indexed_lost += messages or 0

    def miss_end(self, remark: str) -> None:
        self.end_missing = True
        self.remarks.append(remark)

    @property
    def lost(self) -> int | None:
        """Number of lost messages; None if unknown, as in a file without its end."""
        if self.expected is not None:
            if self.expected < self.read:
                return None
            return self.expected - self.read + self.misfits
        if self.end_missing or self.uncounted:
            return None
        return self.certainly_lost

    @property
    def certainly_lost(self) -> int:
        """Messages that are certainly lost; more may be. Skipped sequence numbers count only if the
        file does not declare its messages. If it does, the recorder itself dropped the others."""
        skipped = self.skipped if self.expected is None else 0
        return self.misfits + max(self.indexed_lost, skipped)

    @property
    def share_lost(self) -> float:
        """Lost share of the messages. If their number is unknown, the share of certain losses or of
        bytes is taken, whichever is larger. A missing end counts nothing: nobody knows what it
        held."""
        lost = self.certainly_lost if self.lost is None else self.lost
        share = lost / max(1, self.read - self.misfits + lost)
        if self.lost is not None or (self.end_missing and not self.uncounted):
            return share
        return min(1.0, max(share, self.bytes_lost / max(1, self.bytes)))

    def crc(self) -> str:
        """Whether checksums cover the messages that were read: `checked`, `mixed` or `absent`."""
        if self.verified == self.read and self.read:
            return "checked"
        return "mixed" if self.verified else "absent"

    def report(self, of_messages: bool = False) -> dict[str, Any]:
        """The provenance's `damage`; null: unknown. `of_messages`: also checksums and chunks."""
        lost, sound = self.lost, self.read - self.misfits
        chunks = (
            None
            if self.end_missing
            else max(self.chunks_lost, (self.declared_chunks or 0) - self.chunks)
        )
        wrong = self.gaps or chunks != 0 or self.expected not in (None, self.read)
        wrong |= lost not in (None, 0)
        found: dict[str, Any] = {
            "complete": False if wrong else None if lost is None or self.end_unknown else True,
            "end_missing": self.end_missing,
            "expected": self.expected if lost is None or self.end_unknown else sound + lost,
            "read": sound,
            "lost": None if self.end_unknown and not lost else lost,
            "share_lost": self.share_lost,
            "remarks": [*map(printable, self.all_remarks(of_messages))],
        }
        if of_messages:
            found |= {"crc": self.crc(), "chunks_lost": chunks}
        return found

    def all_remarks(self, of_messages: bool = True) -> list[str]:
        """The remarks, followed by those from the counts of the whole file."""
        remarks, more = self.remarks[:20], len(self.remarks) - 20
        remarks += [f"and {more} more remarks"] * (more > 0)
        if self.expected not in (None, self.read):
            remarks.append(f"it declares {self.expected} messages and holds {self.read}")
        if of_messages and self.crc() != "checked" and self.read:
            uncovered = self.read - self.verified
            remarks.append(
                f"not verifiable: no checksum covers {uncovered} of {self.read} messages"
            )
        return remarks


@dataclass(frozen=True)
class Table:
    """A recording, or a part of one, with one column of time."""

    rows: int
    # by the address in the source file: (rows,), in the file's type; NaN: a failed reading; masked:
    # no reading
    columns: Mapping[str, NDArray[Any]]
    units: Mapping[str, str] = field(default_factory=dict)  # units that the file states, by address
    time: Array | None = None  # time [s] of each row, (rows,), if the format itself tells it
    damage: Ledger = field(default_factory=Ledger)
    facts: Mapping[str, Any] = field(default_factory=dict)  # further provenance of the file
    # provenance of a column, as its full name
    found: Mapping[str, Mapping[str, str]] = field(default_factory=dict)
    lines: NDArray[np.int64] | None = None  # line of each row in a file of text, counted from 1
    has_stamps: bool = False  # the column of time had times of day, and holds them in ns
    # further clocks in the file (name, unit, (rows,) readings), and the rates that it states (name,
    # [Hz])
    clocks: Sequence[tuple[str, str, NDArray[Any]]] = ()
    rates: Sequence[tuple[str, float]] = ()
    noun: str = "row"  # word for a row in messages
    # whether each device has rows of its own, in which the others are masked
    has_own_rows: bool = False
    failed: str = "NaN"  # word for a failed reading in messages

    def place(self, row: int) -> str:
        """A row, for messages."""
        return (
            f"{self.noun} {row + 1} of {self.rows}"
            if self.lines is None
            else f"line {self.lines[row]}"
        )
