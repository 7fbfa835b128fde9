"""The table that every format is read into, with columns as in the file, unconverted; and the
ledger of its losses."""

import errno
import os
import pickle
import re
import signal
import warnings
from collections import Counter
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from osl_analysis.errors import InputError, printable
from osl_analysis.trial import Array

MOST_BYTES = 4_000_000_000  # largest memory for the values of a recording
MOST_SECONDS = 600  # largest processor time of a decoder

Result = TypeVar("Result")
MIX = np.uint64(0x9E3779B97F4A7C15)  # multiplier of a hash: spreads a word over its high bits
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


def isolated(work: Callable[[], Result]) -> Result:
    """The result of `work`, done in a fork of this process. Raises InputError: that of `work`, or
    the fork dies or needs more memory than a recording may take."""
    reader, writer = os.pipe()
    # warnings about threads, which the fork does not use
    with warnings.catch_warnings(action="ignore"):
        child = os.fork()
    if child == 0:
        answer(work, writer)
    os.close(writer)
    with os.fdopen(reader, "rb") as pipe:
        said = pipe.read()
    _, status = os.waitpid(child, 0)
    if os.WIFSIGNALED(status) or not said:
        name = signal.Signals(os.WTERMSIG(status)).name if os.WIFSIGNALED(status) else "no answer"
        raise InputError(f"its decoder broke down ({name}): the file is damaged; {LIBRARY_REMEDY}")
    is_whole, result = pickle.loads(said)  # safe: our own fork wrote it
    if is_whole is None:
        raise MemoryError
    if not is_whole:
        raise InputError(result)
    return result  # type: ignore[no-any-return]


def answer(work: Callable[[], object], writer: int) -> None:
    """In the fork: do the work within the memory limit, write its result to the pipe, and exit
    without clean-up."""
    is_lower = False  # whether this process has a lower limit than MOST_BYTES
    try:
        with suppress(OSError, ValueError, ImportError, AttributeError):
            import resource

            pages = int(Path("/proc/self/statm").read_text().split()[0])
            limit = pages * resource.getpagesize() + MOST_BYTES
            resource.setrlimit(
                resource.RLIMIT_AS, (limit, resource.getrlimit(resource.RLIMIT_AS)[1])
            )
            is_lower = 0 <= resource.getrlimit(resource.RLIMIT_DATA)[0] < MOST_BYTES
            resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
            resource.setrlimit(resource.RLIMIT_CPU, (MOST_SECONDS, MOST_SECONDS))
            # hides the long messages of a crashing decoder
            os.dup2(os.open(os.devnull, os.O_WRONLY), 2)
        try:
            said = pickle.dumps((True, work()))
        except MemoryError:
            more = f"it takes more than {MOST_BYTES / 1e9:g} GB of memory: damaged, or no recording"
            more += "; save the signals of one trial in a file of their own"
            said = pickle.dumps((None if is_lower else False, more))
        except InputError as error:
            said = pickle.dumps((False, str(error)))
        except Exception as error:
            said = pickle.dumps((False, f"cannot be read ({reason_of(error)}); {LIBRARY_REMEDY}"))
        with os.fdopen(writer, "wb") as pipe:
            pipe.write(said)
    finally:
        os._exit(0)


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
    read, of messages of each channel, or of the rows of a table under channel 0. An unknown count
    is None, never 0."""

    # the recorder did not finish, or the file was cut off: what followed is unknown
    end_missing: bool = False
    # the format does not mark its end, as in text: a cut file looks whole
    end_unknown: bool = False
    gaps: bool = False  # some part of the file, perhaps its summary, is missing or cannot be read
    # number of messages that the file declares; None if it does not, or is not trusted
    expected: int | None = None
    declared: Counter[int] | None = None  # the same for each channel
    declared_chunks: int | None = None  # number of chunks that the file declares
    read: Counter[int] = field(default_factory=Counter)  # messages of each channel
    verified: int = 0  # messages that were read and are covered by a correct checksum
    # messages of `read` that do not fit their schema: lost
    misfits: Counter[int] = field(default_factory=Counter)
    chunks: int = 0
    chunks_lost: int = 0  # chunks that were found but could not be read
    # lost messages of each channel whose number is known
    indexed_lost: Counter[int] = field(default_factory=Counter)
    # gaps in the sequence numbers of each channel
    skipped: Counter[int] = field(default_factory=Counter)
    uncounted: bool = False  # something is or may be lost, and its number of messages is unknown
    is_doubted: bool = False  # some values are no sensor's: bytes of what was read may be lost
    bytes: int = 0  # size of the file's data section
    bytes_lost: int = 0  # bytes of it that could not be read, without those beyond a cut-off end
    # what is missing, was repaired or left out, a sentence each
    remarks: list[str] = field(default_factory=list)

    def lose(self, remark: str, size: int, messages: Counter[int] | None, chunks: int) -> None:
        """Count a lost part: `size` bytes, messages of each channel (None: number unknown),
        chunks."""
        self.remarks.append(remark)
        self.chunks_lost += chunks
        self.bytes_lost += size
        self.gaps = True
        self.uncounted |= messages is None
        self.indexed_lost.update(messages or {})

    def miss_end(self, remark: str) -> None:
        self.end_missing = True
        self.remarks.append(remark)

    @property
    def messages(self) -> int:
        return self.read.total()

    def lost(self, channels: Collection[int] | None = None) -> int | None:
        """Number of lost messages of some channels, else of all; None if unknown, as in a file
        without its end."""
        if self.is_doubted or (
            self.end_missing if self.expected is None else self.expected < self.messages
        ):
            return None
        if self.expected is not None and channels is None:
            return self.expected - self.messages + self.misfits.total()
        if self.declared is not None and channels is not None:
            return sum(
                max(0, self.declared[one] - self.read[one]) + self.misfits[one] for one in channels
            )
        told = self.expected == self.messages or (self.expected is None and not self.uncounted)
        return total_of(self.certain, channels) if told else None

    @property
    def certain(self) -> Counter[int]:
        """Messages of each channel that are certainly lost; more may be. Skipped sequence numbers
        count only if the file does not declare its messages. If it does, the recorder itself
        dropped the others."""
        return self.misfits + (
            self.indexed_lost | (self.skipped if self.declared is None else Counter())
        )

    def share_lost(self, channels: Collection[int] | None = None) -> float:
        """Lost share of the messages of some channels, else of all. If their number is unknown, the
        share of certain losses, of all messages or of bytes is taken, whichever is largest. A
        missing end counts nothing: nobody knows what it held."""
        lost = self.lost(channels)
        certain = total_of(self.certain, channels) if lost is None else lost
        sound = self.read - self.misfits
        share = certain / max(1, total_of(sound, channels) + certain)
        if lost is not None or (self.end_missing and not self.uncounted):
            return share
        total = self.lost() or 0
        return min(
            1.0,
            max(share, total / max(1, sound.total() + total), self.bytes_lost / max(1, self.bytes)),
        )

    def crc(self) -> str:
        """Whether checksums cover the messages that were read: `checked`, `mixed` or `absent`."""
        if self.verified == self.messages and self.messages:
            return "checked"
        return "mixed" if self.verified else "absent"

    def report(self, topics: Mapping[str, Collection[int]] | None = None) -> dict[str, Any]:
        """The provenance's `damage`; null: unknown. With `topics` (channels by topic), also the
        losses of each."""
        lost, sound = self.lost(), self.messages - self.misfits.total()
        chunks = (
            None
            if self.end_missing
            else max(self.chunks_lost, (self.declared_chunks or 0) - self.chunks)
        )
        wrong = self.gaps or chunks != 0 or self.expected not in (None, self.messages)
        wrong |= lost not in (None, 0) or (
            self.declared is not None and +self.declared != +self.read
        )
        found = {
            "complete": False if wrong else None if lost is None or self.end_unknown else True,
            "end_missing": self.end_missing,
            "expected": self.expected if lost is None or self.end_unknown else sound + lost,
            "read": sound,
            "lost": None if self.end_unknown and not lost else lost,
            "share_lost": max(
                (self.share_lost(own) for own in (topics or {}).values()), default=self.share_lost()
            ),
            "remarks": [*map(printable, self.all_remarks(topics is not None))],
        }
        if topics is None:
            return found
        by_topic = {
            one: {"messages": total_of(self.read, own), "lost": self.lost(own)}
            for one, own in topics.items()
        }
        return found | {"crc": self.crc(), "chunks_lost": chunks, "topics": by_topic}

    def all_remarks(self, of_messages: bool = True) -> list[str]:
        """The remarks, followed by those from the counts of the whole file."""
        remarks, more = self.remarks[:20], len(self.remarks) - 20
        remarks += [f"and {more} more remarks"] * (more > 0)
        if self.expected not in (None, self.messages):
            remarks.append(f"it declares {self.expected} messages and holds {self.messages}")
        if of_messages and self.crc() != "checked" and self.messages:
            uncovered = self.messages - self.verified
            remarks.append(
                f"not verifiable: no checksum covers {uncovered} of {self.messages} messages"
            )
        return remarks


def noise_in(x: NDArray[Any], run: slice) -> tuple[float, float]:
    """The `noise_of_pieces` in a run of readings (n,); a short run is widened to 64 readings."""
    wide = max(0, 64 - (run.stop - run.start)) // 2
    return noise_of_pieces(x[None, max(0, run.start - wide) : run.stop + wide])[0]


@np.errstate(over="ignore", invalid="ignore")
def noise_of_pieces(pieces: NDArray[Any]) -> list[tuple[float, float]]:
    """SD of the noise in each of k pieces of a channel (k, n), and the step of its values. The SD
    comes from the median of fourth differences, to which a motion adds little. It is 0 for a
    channel without noise: a command, a simulation or a motion that is only rounded. The step is
    1/1000 of the smallest one if others are no multiples of that."""
    if pieces.shape[1] < 5:
        return [(0.0, 0.0)] * len(pieces)
    apart, (steps, scatter) = (
        np.diff(np.sort(pieces)),
        (np.abs(np.diff(pieces, order)) for order in (1, 4)),
    )
    level, scatter = (
        np.where(apart > 0, apart, np.inf).min(axis=1),
        np.median(scatter, axis=1) / (0.6745 * 70**0.5),
    )
    is_noise = scatter > np.maximum(0.6 * level, 0.01 * np.median(steps, axis=1))
    parts = apart / level[:, None]
    # else the values are not rounded
    is_step = np.mean(np.abs(parts - np.rint(parts)) < 0.05, axis=1) > 0.5
    level = np.where(is_step | (scatter == 0), level, 1e-3 * level)
    return [*zip(np.where(is_noise, scatter, 0.0).tolist(), level.tolist(), strict=True)]


def copied_runs(
    words: NDArray[Any], least: int, proves: Callable[[slice, int], bool]
) -> list[tuple[int, int, int]]:
    """Runs of `least` words (n,) or more that repeat an earlier run exactly, as if a block of a
    file was written twice: first word, word after the last, and first word of the earlier run.
    Words that occur more than three times prove nothing; if most do (a coarse converter), 4 or 16
    in a row are compared as one. Runs that `proves` rejects, by place and lag, do not count. If
    nearly everything is a copy, the motion repeats itself: none counts."""
    bits = words.view(f"u{words.dtype.itemsize}") if words.dtype.kind == "f" else words
    if words.size < max(32, 2 * least):
        return []
    bits, places = bits.astype(np.uint64), np.uint64((1 << words.size.bit_length()) - 1)
    mixed = bits * MIX
    for size in (1, 4, 16):
        # joins two neighbours, then two of these
        for step in (size // 4, size // 2) if size > 1 else ():
            mixed = (mixed[:-step] ^ (mixed[:-step] >> np.uint64(29))) * MIX + mixed[step:]
        keys = np.sort((mixed * MIX & ~places) | np.arange(mixed.size, dtype=np.uint64))
        groups = np.flatnonzero(np.concatenate([[True], (keys[1:] ^ keys[:-1]) > places, [True]]))
        counts = np.diff(groups)
        if (rare := int(counts[counts <= 3].sum())) >= 0.5 * keys.size:
            break
    else:
        return []
    at = (keys & places).astype(np.int64)
    again = [groups[:-1][counts == 3] + 1, groups[:-1][(counts > 1) & (counts < 4)]]
    lags, votes = np.unique(
        np.concatenate([at[one + 1] - at[one] for one in again]), return_counts=True
    )
    many = votes >= max(2, 0.75 * (least - size))
    if not many.any():
        return []
    found, copies, seldom = (
        list[tuple[int, int, int]](),
        np.zeros(bits.size, bool),
        np.zeros(bits.size, bool),
    )
    seldom[at[np.repeat(counts <= 3, counts)]] = True
    before = np.concatenate([[0], np.cumsum(seldom)])  # number of rare words before each place
    for lag in lags[many][np.argsort(-votes[many], kind="stable")][:20].tolist():
        equal = np.zeros(bits.size - lag + 2, bool)
        equal[1:-1] = bits[lag:] == bits[:-lag]
        runs = np.flatnonzero(equal[1:] != equal[:-1]).reshape(-1, 2)
        runs = runs[runs[:, 1] - runs[:, 0] >= max(least, size + 1)]
        first, last = runs[:, 0], runs[:, 1] - size + 1
        for start, stop in runs[before[last] - before[first] >= 0.75 * (last - first)].tolist():
            if proves(slice(start, stop), lag):
                found.append((start + lag, stop + lag, start))
                copies[start:stop] = copies[start + lag : stop + lag] = True
    return found if np.count_nonzero(copies & seldom) <= 0.8 * rare else []


def total_of(counts: Counter[int], channels: Collection[int] | None) -> int:
    """The sum of the counts of some channels, else of all."""
    return counts.total() if channels is None else sum(counts[one] for one in channels)


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
