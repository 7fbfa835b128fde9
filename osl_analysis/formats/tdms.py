# SPDX-License-Identifier: Apache-2.0
"""LabVIEW's TDMS, by npTDMS.

What the library warns of, such as a scale that it does not apply or a segment that is not as long
as its channels say, is refused: it would give raw or exchanged numbers.
"""

import logging
import struct
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import replace
from functools import partial
from io import BytesIO
from operator import methodcaller
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from osl_analysis.base.errors import InputError, optional_module, shortened
from osl_analysis.base.recording import SECOND_NS, Channel, End, Format, Kind, Loss, Recording, Rows
from osl_analysis.base.source_file import LogChannel, Name, RowTime, TableSource
from osl_analysis.formats.reading import in_one_sentence

LEAD_IN_BYTES = 28  # of a segment: its mark, flags, version, and two lengths from its end on
IS_BIG_ENDIAN = 1 << 6  # flag of a segment


class TdmsChannel(LogChannel):
    """A channel of a group."""

    ADDRESS = "channel"
    channel: Name  # Group and name, as `Measured Data/Torque`, or the name where one group has it.
    time: "TdmsTime | None" = None  # Its own time, where it is not that of the others.


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


def read(path: Path, source: TdmsSource | None) -> Recording:
    """Read the channels of a file with their timing."""
    nptdms = optional_module("nptdms", "a TDMS file")
    nptdms.log.log_manager.console_handler.setLevel(logging.CRITICAL)  # of what it would print
    data = path.read_bytes()
    with library_warnings() as warnings:
        # of bytes: it would go by an index beside the file, maybe another's
        file = nptdms.TdmsFile.open(BytesIO(data), raw_timestamps=True)
    every = [channel for group in file.groups() for channel in group.channels()]
    if not every:
        raise InputError("holds no channels, or is cut off before them", "copy it again")
    is_cut = is_cut_off(data)
    if warnings and not is_cut:
        raise InputError(
            f"its segments contradict each other: npTDMS says '{shortened(warnings[0])}'",
            "copy it again, or save it from LabVIEW or DIAdem under a new name",
        )
    remarks = ["the last segment is not complete: the recorder did not finish"] if is_cut else []
    by_rows: dict[Any, list[Any]] = {}
    not_scaled = {}  # by channel, what the library says where it first looks at its scales
    for channel in every:
        with library_warnings() as warnings:
            kind = np.dtype(channel.dtype).kind
        not_scaled[channel.path] = "".join(warnings[:1])
        if not len(channel) or kind not in "biufM":
            remarks.append(f"channel '{channel.path}' is empty or holds no numbers")
            continue
        # the last segment may be cut within a channel, so that rows end with the shortest one
        length = 0 if is_cut else len(channel)
        key = (channel.group_name, *_timing_of_channel(channel), length)
        by_rows.setdefault(key, []).append(channel)
    first_ns = min((start_ns for _, start_ns, step_s, _ in by_rows if step_s), default=0)
    channels = []
    for (group, start_ns, step_s, _), members in by_rows.items():
        rows = Rows(min(map(len, members)), group, noun="value")
        if step_s:
            rows = replace(rows, rate_hz=1 / step_s, start_s=(start_ns - first_ns) / SECOND_NS)
        channels += [_channel_of(member, rows, not_scaled[member.path]) for member in members]
    return Recording(
        format="tdms",
        channels=channels,
        loss=Loss(
            read=max((channel.rows.count for channel in channels), default=0),
            end=End.MISSING if is_cut else End.UNKNOWN,
            remarks=remarks,
        ),
        facts={key: str(value) for key, value in file.properties.items()},
    )


@contextmanager
def library_warnings() -> Iterator[list[str]]:
    """Collect what the library warns of within the block."""
    warnings: list[str] = []

    class Collector(logging.Handler):
        def emit(self, record: logging.LogRecord) -> None:
            warnings.append(record.getMessage())

    collector = Collector(logging.WARNING)
    logger = logging.getLogger("nptdms")
    logger.addHandler(collector)
    try:
        yield warnings
    finally:
        logger.removeHandler(collector)


def is_cut_off(data: bytes) -> bool:
    """Whether the last segment ends before or behind the end of a file."""
    position = 0
    while position + LEAD_IN_BYTES <= len(data):
        (flags,) = struct.unpack_from("<I", data, position + 4)
        order = ">" if flags & IS_BIG_ENDIAN else "<"
        (length,) = struct.unpack_from(f"{order}Q", data, position + 12)
        position += LEAD_IN_BYTES + length
    return position != len(data)


def _channel_of(channel: Any, rows: Rows, not_scaled: str) -> Channel:
    about = channel.properties
    are_times = channel.dtype.kind == "M"
    unit = str(about.get("unit_string") or about.get("NI_UnitDescription") or "")
    return Channel(
        address={"channel": f"{rows.name}/{channel.name}"},
        rows=rows,
        read=partial(_values_of_channel, channel, rows.count, not_scaled),
        name=channel.name,
        unit="ns" if are_times else unit,
        kind=Kind.CLOCK if are_times else Kind.SIGNAL,
    )


def _timing_of_channel(channel: Any) -> tuple[int, float]:
    """When a channel begins [ns], and the time between two values [s]; 0 if it states none."""
    about = channel.properties
    start_ns = round(about.get("wf_start_offset", 0.0) * SECOND_NS)
    if "wf_start_time" in about:
        in_us = about["wf_start_time"].as_datetime64("us")  # finer ones are rounding
        start_ns += int(in_us.astype("datetime64[ns]").astype(np.int64))
    step_s = about.get("wf_increment", 0.0)
    return start_ns, step_s if 0 < step_s < np.inf else 0.0


def _values_of_channel(channel: Any, count: int, not_scaled: str) -> NDArray[Any]:
    """Its first numbers as the file scales them, or stamps [ns]."""
    if not_scaled:
        raise InputError(
            f"channel {channel.path}: its scale is not applied, and its values are raw: npTDMS says"
            f" '{shortened(not_scaled)}'",
            "save the scaled values from LabVIEW or DIAdem, or export them as text",
        )
    with in_one_sentence():  # values are read when they are asked for
        values = channel.read_data(length=count)
    if channel.dtype.kind == "M":
        values = values.as_datetime64("ns").astype(np.int64)
    return np.asarray(values)


FORMAT = Format(
    name="tdms",
    suffixes=(".tdms",),
    begins=methodcaller("startswith", b"TDSm"),
    source=TdmsSource,
    read=read,
)
