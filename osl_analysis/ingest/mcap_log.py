"""A log in MCAP to canonical columns, by a source file."""

from collections import defaultdict
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl

from osl_analysis.columns import unit_of
from osl_analysis.errors import InputError
from osl_analysis.ingest.cdr import Indices
from osl_analysis.ingest.mcap_records import McapFile, read_mcap
from osl_analysis.ingest.recording import Recording, check_finite
from osl_analysis.ingest.source_file import LogChannel, McapSource
from osl_analysis.ingest.topic import Decoded, decode_topic
from osl_analysis.ingest.units import si_factor
from osl_analysis.trial import check_time

SECOND = 1_000_000_000


def read_log(path: Path, source: McapSource) -> Recording:
    """The columns that the source file maps, in SI units; time [s] counts from the first stamp.

    Raises
    ------
    InputError
        No such topic or field, an encoding or schema that cannot be read, no messages, a value that is not
        finite, or time that does not strictly increase.
    """
    by_topic: dict[str, dict[str, LogChannel]] = defaultdict(dict)
    for column, channel in source.channels.items():
        by_topic[channel.topic][column] = channel
    file = read_mcap(path, by_topic)
    try:
        tables = {topic: read_topic(file, topic, channels, source) for topic, channels in by_topic.items()}
    except InputError as error:
        raise InputError(f"{path}: {error}") from error
    joined, *others = tables.values()
    for table in others:
        joined = joined.join(table, on="stamp", how="full", coalesce=True).sort("stamp")
    start = int(joined["stamp"][0])
    time = ((joined["stamp"] - start) / SECOND).alias("time")
    facts = {
        "time": {"source": source.time.source if source.time.source == "log" else source.time.field, "start_ns": start},
        "rates_hz": {topic: rate(table["stamp"].to_numpy()) for topic, table in tables.items()},
    }
    columns = {column: origin(column, channel) for column, channel in source.channels.items()}
    return Recording(joined.select(time, pl.exclude("stamp")), columns, facts, warnings(path, file))


def read_topic(file: McapFile, topic: str, channels: dict[str, LogChannel], source: McapSource) -> pl.DataFrame:
    """Stamps [ns] and columns of one topic."""
    stamp_fields = [f"{source.time.field}.{part}" for part in ("sec", "nanosec")]
    wanted = [channel.field for channel in channels.values()]
    from_header = source.time.source == "header"
    decoded = decode_topic(file, topic, stamp_fields + wanted if from_header else wanted)
    stamp = decoded.log_time
    if from_header:
        seconds, nanoseconds = (decoded.values[name].astype(np.int64) for name in stamp_fields)
        stamp = seconds * SECOND + nanoseconds
    check_time(f"topic {topic}", (stamp - stamp[0]) / SECOND)
    columns = [canonical(column, channel, decoded, stamp) for column, channel in channels.items()]
    return pl.DataFrame([pl.Series("stamp", stamp), *columns])


def canonical(column: str, channel: LogChannel, decoded: Decoded, stamp: Indices) -> pl.Series:
    """One column in SI units; null where a message lacks the field."""
    raw = decoded.values[channel.field].astype(np.float64)
    check_finite(f"topic {channel.topic}, field {channel.field}", raw, (stamp - stamp[0]) / SECOND)
    factor = channel.sign * si_factor(channel.unit, unit_of(column))
    series = pl.Series(column, factor * (raw + channel.offset))
    present = decoded.present[channel.field]
    return series if present.all() else series.set(pl.Series(~present), None)


def origin(column: str, channel: LogChannel) -> dict[str, Any]:
    """Where a column comes from, for the trial's provenance."""
    unit = unit_of(column)
    return {**channel.model_dump(), "factor": si_factor(channel.unit, unit), "si_unit": unit}


def rate(stamp: Indices) -> float | None:
    """Median rate [Hz] of stamps [ns]; None for a single one."""
    return float(SECOND / np.median(np.diff(stamp))) if stamp.size > 1 else None


def warnings(path: Path, file: McapFile) -> list[str]:
    """What a reader of the trial should know about the log."""
    if not file.unverified:
        return []
    return [f"{path.name}: no checksum covers {file.unverified} of {file.messages} messages; damage cannot be excluded"]
