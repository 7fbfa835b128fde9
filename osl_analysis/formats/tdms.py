"""LabVIEW's TDMS, by npTDMS."""

import logging
from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import partial
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from osl_analysis.errors import InputError, optional_module
from osl_analysis.formats import in_one_sentence
from osl_analysis.formats._text import CONTROL
from osl_analysis.recording import Channel, End, Format, Kind, Loss, Recording, Rows
from osl_analysis.source_file import LogChannel, Name, RowTime, TableSource
from osl_analysis.units import name_and_ending

MARK = b"TDSm"
INDEX_MARK = b"TDSh"
NS = 1e-9  # s


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


def read(path: Path, source: TdmsSource | None) -> Recording:
    """Read the channels of a file with their timing."""
    nptdms = optional_module("nptdms", "a TDMS file")
    nptdms.log.log_manager.set_level(logging.ERROR)  # of what it would print
    data = path.read_bytes()
    if data.startswith(INDEX_MARK):
        raise InputError("the index of a TDMS file; name the .tdms file beside it")
    # of bytes: it would go by an index beside the file, maybe another's
    file = nptdms.TdmsFile.open(BytesIO(data), raw_timestamps=True)
    every = [channel for group in file.groups() for channel in group.channels()]
    if not every:
        raise InputError("holds no channels, or is cut off before them; copy it again")
    signals = [one for one in every if len(one) and np.dtype(one.dtype).kind in "biufM"]
    is_cut = file.file_status.incomplete_final_segment
    remarks = ["the last segment is not complete: the recorder did not finish"] if is_cut else []
    timings = [_timing_of(channel) for channel in signals]
    first_ns = min((start_ns for start_ns, step_s in timings if step_s), default=0)
    shortest: dict[Any, int] = {}  # of the channels of a group with one timing
    for channel, timing in zip(signals, timings, strict=True):
        key = (channel.group_name, timing)
        shortest[key] = min(shortest.get(key, len(channel)), len(channel))
    rows_of: dict[Any, Rows] = {}
    channels: list[Channel] = []
    for channel, (start_ns, step_s) in zip(signals, timings, strict=True):
        group = channel.group_name
        # the last segment may be cut within a channel
        count = shortest[group, (start_ns, step_s)] if is_cut else len(channel)
        rows = Rows(count, group, noun="value")
        if step_s:
            start_s = (start_ns - first_ns) * NS
            rows = replace(rows, rate_hz=1 / step_s, start_s=start_s)
        about = channel.properties
        are_times = channel.dtype.kind == "M"
        unit = str(about.get("unit_string") or about.get("NI_UnitDescription") or "")
        channels.append(
            Channel(
                address={"channel": f"{group}/{channel.name}"},
                rows=rows_of.setdefault((group, count, start_ns, step_s), rows),
                read=partial(_values_of, channel, count),
                name=channel.name,
                unit="ns" if are_times else unit,
                likely_unit="" if are_times or unit else name_and_ending(channel.name)[1],
                kind=Kind.CLOCK if are_times else Kind.SIGNAL,
                type=channel.dtype.name,
            )
        )
    most = max((rows.count for rows in rows_of.values()), default=0)
    end = End.MISSING if is_cut else End.UNKNOWN
    properties = {str(key): str(value)[:200] for key, value in list(file.properties.items())[:20]}
    return Recording(
        format="tdms",
        channels=channels,
        loss=Loss(most, None, end, remarks=remarks),
        facts={"channels": str(len(every)), **properties},
        find_unlisted=partial(_find_unlisted, every),
    )


def _timing_of(channel: Any) -> tuple[int, float | None]:
    """When a channel begins [ns], and the time between two values [s], if it states one."""
    about = channel.properties
    since = about.get("wf_start_time")
    start_ns = 0
    if since is not None:
        in_us = since.as_datetime64("us")  # finer ones are rounding
        start_ns = int(in_us.astype("datetime64[ns]").astype(np.int64))
    start_ns += round(float(about.get("wf_start_offset", 0.0)) / NS)
    step_s = float(about.get("wf_increment", 0.0))
    return start_ns, step_s if 0 < step_s < np.inf else None


def _values_of(channel: Any, count: int) -> NDArray[Any]:
    """Its first numbers as the file scales them, or stamps [ns]."""
    with in_one_sentence():  # values are read when they are asked for
        values = channel.read_data(length=count)
    if channel.dtype.kind == "M":
        values = values.as_datetime64("ns").astype(np.int64)
    return np.asarray(values)


def _find_unlisted(every: Sequence[Any], address: Mapping[str, str]) -> Channel | None:
    """Say why a channel that the file has is not listed."""
    for channel in every:
        full_name = f"{channel.group_name}/{channel.name}"
        if address["channel"] in (full_name, channel.name):
            kind = "no" if channel.dtype is None else channel.dtype.name
            raise InputError(
                f"channel '{full_name}' holds {len(channel)} values of type {kind} and no numbers;"
                " take another one, or record again"
            )
    return None


def _begins(begin: bytes) -> bool:
    """Tell whether a file is TDMS or its index; text never is: `TDSm` may name a column."""
    return begin.startswith((MARK, INDEX_MARK)) and CONTROL.search(begin) is not None


FORMAT = Format(name="tdms", suffixes=(".tdms",), begins=_begins, source=TdmsSource, read=read)
