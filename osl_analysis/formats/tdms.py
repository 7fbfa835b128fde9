"""LabVIEW's TDMS, by npTDMS."""

import logging
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from functools import partial
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from osl_analysis.errors import InputError, optional_module, quoted
from osl_analysis.formats import in_one_sentence
from osl_analysis.formats._text import CONTROL
from osl_analysis.recording import Channel, End, Format, Kind, Loss, Recording, Rows
from osl_analysis.source_file import LogChannel, Name, RowTime, TableSource
from osl_analysis.units import name_and_ending

MARK = b"TDSm"
INDEX_MARK = b"TDSh"
LEAD_IN = 28  # bytes: mark, table of contents, version, length of the segment, of its metadata
IS_BIG_ENDIAN = 1 << 6  # bit of the table of contents
NS = 1e-9  # s
SAVE_AGAIN = "copy it again, or open it in LabVIEW or DIAdem and save it under a new name"


class TdmsChannel(LogChannel):
    """A channel of a group."""

    ADDRESS = "channel"
    channel: Name  # Group and name, as `Measured Data/Torque`, or the name where one group has it.


class TdmsTime(RowTime):
    """A channel of time, or the channels' own timing."""

    ADDRESS = "channel"
    IN_FILE = True
    # That of time; LabVIEW's stamps need no unit. Without it: the channels' own timing.
    channel: str | None = None


class TdmsSource(TableSource):
    """The source file of TDMS."""

    channels: Mapping[str, TdmsChannel] = Field(min_length=1)
    time: TdmsTime = Field(default_factory=TdmsTime)


class Timed:
    """A channel of npTDMS with its timing."""

    def __init__(self, channel: Any) -> None:
        about = channel.properties
        self.channel = channel
        self.address = f"{channel.group_name}/{channel.name}"
        self.kind = np.dtype("V" if channel.dtype is None else channel.dtype)
        self.unit = str(about.get("unit_string") or about.get("NI_UnitDescription") or "")
        self.count = len(channel)
        step_s = about.get("wf_increment")
        is_step = isinstance(step_s, float | int) and np.isfinite(step_s) and step_s > 0
        self.step_s = float(step_s) if is_step else None  # between two values
        since = about.get("wf_start_time")
        start_ns = 0
        if since is not None and hasattr(since, "as_datetime64"):
            in_us = since.as_datetime64("us")  # finer ones are rounding
            start_ns = int(in_us.astype("datetime64[ns]").astype(np.int64))
        self.start_ns = start_ns + round(float(about.get("wf_start_offset", 0.0)) / NS)

    @property
    def holds_numbers(self) -> bool:
        """Whether it can be a signal."""
        return self.count > 0 and self.kind.kind in "biuf"

    @property
    def holds_times(self) -> bool:
        """Whether it holds LabVIEW's time stamps."""
        return self.count > 0 and self.kind.kind == "M"

    def values(self, count: int) -> NDArray[Any]:
        """Its first numbers as the file scales them, or stamps [ns]."""
        with _warnings_of_library(), in_one_sentence():  # values are read when they are asked for
            values = self.channel.read_data(length=count)
        if self.holds_times:
            return np.asarray(values.as_datetime64("ns").astype(np.int64))
        return np.asarray(values)

    def no_numbers(self) -> InputError:
        """Say why it cannot be a signal."""
        if not self.count:
            return InputError(
                f"channel '{self.address}' is empty; take another one, or record again"
            )
        kinds = {"O": "text", "V": "nothing", "c": "complex numbers"}
        what = kinds.get(self.kind.kind, self.kind.name)
        return InputError(f"channel '{self.address}' holds {what} and no numbers; take another one")


def read(path: Path, source: TdmsSource | None) -> Recording:
    """Read the channels of a file with their timing."""
    data = path.read_bytes()
    if data.startswith(INDEX_MARK):
        raise InputError("the index of a TDMS file; name the .tdms file beside it")
    if not data.startswith(MARK):
        raise InputError(
            f"no TDMS file (it begins with {quoted(data[:8])}); check the path and the source's"
            " format"
        )
    nptdms = optional_module("nptdms", "a TDMS file")
    with _warnings_of_library() as library_warnings:
        # of bytes: it would go by an index beside the file, maybe another's
        file = nptdms.TdmsFile.open(BytesIO(data), raw_timestamps=True)
    status = file.file_status
    odd_lengths = [text for text in library_warnings if "not a multiple" in text]
    if len(odd_lengths) > status.incomplete_final_segment:
        # the library would give one channel the bytes of the next
        raise InputError(
            f"the length of a segment contradicts that of its channels ({odd_lengths[0][:80]});"
            f" {SAVE_AGAIN}"
        )
    channels_of_file = [Timed(channel) for group in file.groups() for channel in group.channels()]
    if not channels_of_file:
        raise InputError(
            f"the TDMS file holds no channels, or is cut off before them; {SAVE_AGAIN}"
        )
    _check_one_recording(nptdms, data, channels_of_file)
    remarks: list[str] = []
    end = End.UNKNOWN
    if status.incomplete_final_segment or _end_of_segments(data) != len(data):
        end = End.MISSING
        statuses = (status.channel_statuses or {}).values()
        lost = max(
            (
                channel_status.expected_length - channel_status.read_length
                for channel_status in statuses
            ),
            default=0,
        )
        count = f"at least {lost} values of a channel" if lost else "how much is not known"
        remarks.append(
            "the last segment is not complete: the recorder did not finish, or the end is lost;"
            f" {count}"
        )
    signals = [
        channel for channel in channels_of_file if channel.holds_numbers or channel.holds_times
    ]
    # else the channels' own timing is their time
    by_rows = source is not None and bool(source.time.name or source.time.rate is not None)
    # the last segment may be cut within a channel: rows end with the shortest one
    channels = _channels_of(signals, to_shortest=by_rows and end == End.MISSING)
    read_count = max((channel.rows.count for channel in channels), default=0)
    properties = {str(key): str(value)[:200] for key, value in list(file.properties.items())[:20]}
    return Recording(
        format="tdms",
        channels=channels,
        loss=Loss(read_count, None, end, remarks=remarks),
        facts={"channels": str(len(channels_of_file)), **properties},
        find_unlisted=partial(_find_unlisted, channels_of_file),
    )


@contextmanager
def _warnings_of_library() -> Iterator[list[str]]:
    """Collect what npTDMS would print."""
    messages: list[str] = []

    def keep(record: logging.LogRecord) -> bool:
        messages.append(record.getMessage())
        return False

    handler = optional_module("nptdms.log", "a TDMS file").log_manager.console_handler
    handler.addFilter(keep)
    try:
        yield messages
    finally:
        handler.removeFilter(keep)


def _channels_of(signals: Sequence[Timed], to_shortest: bool) -> list[Channel]:
    """Make channels, of which those of one timing share rows."""
    first_ns = min((signal.start_ns for signal in signals if signal.step_s is not None), default=0)
    rows_by_timing: dict[tuple[Any, ...], Rows] = {}
    channels: list[Channel] = []
    for signal in signals:
        group = signal.channel.group_name
        count = signal.count
        if to_shortest:
            alike = [
                other.count
                for other in signals
                if other.channel.group_name == group
                and (other.start_ns, other.step_s) == (signal.start_ns, signal.step_s)
            ]
            count = min(alike)
        key = (group, count, signal.start_ns, signal.step_s)
        if key not in rows_by_timing:
            is_timed = signal.step_s is not None
            rows_by_timing[key] = Rows(
                count,
                name=group,
                rate_hz=1 / signal.step_s if signal.step_s is not None else None,
                start_s=(signal.start_ns - first_ns) * NS if is_timed else 0.0,
                noun="value",
            )
        unit = "ns" if signal.holds_times else signal.unit
        channels.append(
            Channel(
                address={"channel": signal.address},
                rows=rows_by_timing[key],
                read=partial(signal.values, count),
                name=signal.channel.name,
                unit=unit,
                likely_unit="" if unit else name_and_ending(signal.channel.name)[1],
                kind=Kind.CLOCK if signal.holds_times else Kind.SIGNAL,
                type=signal.kind.name,
            )
        )
    return channels


def _find_unlisted(channels_of_file: Sequence[Timed], address: Mapping[str, str]) -> Channel | None:
    """Say why a channel that the file has is not listed."""
    wanted = address["channel"]
    for channel in channels_of_file:
        if wanted in (channel.address, channel.channel.name):
            raise channel.no_numbers()
    return None


def _end_of_segment(data: bytes, begin: int) -> int:
    """Where a segment should end [bytes]."""
    is_big_endian = data[begin + 4] & IS_BIG_ENDIAN
    length = int.from_bytes(data[begin + 12 : begin + 20], "big" if is_big_endian else "little")
    return begin + LEAD_IN + length


def _end_of_segments(data: bytes) -> int:
    """Where the last segment should end [bytes]; npTDMS is silent about a cut lead-in."""
    end = 0
    while end + LEAD_IN <= len(data) and data[end : end + 4] == MARK:
        end = _end_of_segment(data, end)
    return end


def _check_one_recording(nptdms: Any, data: bytes, channels_of_file: Sequence[Timed]) -> None:
    """Refuse a file to which a second recording was appended: npTDMS reads both as one.

    The first segment tells when each channel began. A later one alone tells nothing: it may refer
    to the one before.
    """
    first_end = _end_of_segment(data, 0)
    if first_end >= len(data):
        return
    with _warnings_of_library():
        first = nptdms.TdmsFile.read_metadata(BytesIO(data[:first_end]), raw_timestamps=True)
    began = {
        channel.path: channel.properties.get("wf_start_time")
        for group in first.groups()
        for channel in group.channels()
    }
    for channel in channels_of_file:
        since = began.get(channel.channel.path)
        last = channel.channel.properties.get("wf_start_time")
        if since is None or last is None:
            continue
        if since.as_datetime64("ns") != last.as_datetime64("ns"):
            raise InputError(
                f"channel '{channel.channel.name}' starts anew behind byte {first_end}: two"
                " recordings in one file; save each under a name of its own"
            )


def _begins(begin: bytes) -> bool:
    """Tell whether a file is TDMS or its index; text never is: `TDSm` may name a column."""
    return begin.startswith((MARK, INDEX_MARK)) and CONTROL.search(begin) is not None


FORMAT = Format(name="tdms", suffixes=(".tdms",), begins=_begins, source=TdmsSource, read=read)
