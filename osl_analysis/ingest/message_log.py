"""A log of messages by topic as canonical columns, in the order of their stamps. Topics with
stamps of their own have rows of their own."""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import reduce
from typing import Any

import numpy as np
import polars as pl
from numpy.typing import NDArray

from osl_analysis.errors import InputError, naming
from osl_analysis.ingest.conversion import (
    Converted,
    canonical_column,
    checked_counts,
    losses_of,
    origin_of,
    remark_on_gaps,
    share_lost,
)
from osl_analysis.ingest.likely_clock import rate_of
from osl_analysis.recording import Recording, Rows
from osl_analysis.source_file import MessageChannel, MessageSource
from osl_analysis.trial import counter_column

SECOND_NS = 1_000_000_000
SET_BACK_NS = SECOND_NS  # a stamp that goes back by more is of a clock that was set


@dataclass(frozen=True)
class Topic:
    """Stamps [ns] and canonical columns of one topic, sorted by stamp; late messages, and those
    with the stamp of an earlier one."""

    table: pl.DataFrame
    late: int
    repeated: int
    remarks: list[str]


def convert_messages(recording: Recording, source: MessageSource) -> Converted:
    """Convert the fields that a source file asks for."""
    by_topic: dict[str, dict[str, MessageChannel]] = {}
    for column, setting in source.channels.items():
        by_topic.setdefault(setting.topic, {})[column] = setting
    topics: dict[str, Topic] = {}
    for name, settings in by_topic.items():
        share = share_lost(recording.loss, name)
        if share > source.largest_loss:
            raise InputError(
                f"damaged or incomplete: {100 * share:.3g} % of topic '{name}' is lost, more than"
                f" the {100 * source.largest_loss:.3g} % of `largest_loss` in the source file:"
                f" {'; '.join(recording.loss.remarks)}; record again"
            )
        with naming(f"topic '{name}'"):
            topics[name] = convert_topic(recording, source, settings)
    joined = join_on_stamp([topic.table for topic in topics.values()])
    missing = {
        column: int(topics[setting.topic].table[column].is_nan().sum())
        for column, setting in source.channels.items()
    }
    start = int(joined["stamp"][0])
    time = ((joined.drop_in_place("stamp") - start) / SECOND_NS).alias("time")
    facts: dict[str, Any] = {
        **recording.facts,
        "time": {
            "source": source.time.field if source.time.source == "header" else "log",
            "stamps": source.time.stamps,
            "start_ns": start,
        },
        "rates_hz": {
            name: rate_of(topic.table["stamp"].to_numpy(), SECOND_NS)
            for name, topic in topics.items()
        },
        "stamps": {
            name: {"late": topic.late, "repeated": topic.repeated} for name, topic in topics.items()
        },
        "missing": missing,
    }
    warnings = [*recording.loss.remarks]
    if recording.loss.checksums != "checked":
        warnings.append("not verifiable: no checksum covers its messages")
    warnings += [f"topic '{name}': {text}" for name, one in topics.items() for text in one.remarks]
    warnings += [
        f"{column} is missing in {count} of {len(joined)} rows"
        for column, count in missing.items()
        if count
    ]
    return Converted(
        samples=pl.DataFrame([time, *joined]),
        origins={column: origin_of(one, column) for column, one in source.channels.items()},
        facts=facts,
        warnings=warnings,
        losses=losses_of(recording.loss, True, [*by_topic]),
        begins_s=start / SECOND_NS,
    )


def convert_topic(
    recording: Recording, source: MessageSource, settings: Mapping[str, MessageChannel]
) -> Topic:
    """Convert the asked fields of one topic. Raises InputError: its clock was set back."""
    channels = {column: recording.find(one.address) for column, one in settings.items()}
    rows = next(iter(channels.values())).rows
    stamps = stamps_of(recording, source, rows)
    time = (stamps - stamps[0]) / SECOND_NS
    columns = [pl.Series("stamp", stamps)]
    remarks: list[str] = []
    for column, setting in settings.items():
        raw = channels[column].values
        columns.append(canonical_column(column, channels[column], raw, rows, time, source))
        remarks += remark_on_gaps(setting, raw, rows)
        if setting.counter is not None:
            counter = recording.find({**setting.address, setting.ADDRESS: setting.counter})
            counts = checked_counts(setting, counter.values, rows, time)
            columns.append(pl.Series(counter_column(column), counts))
    back_ns = np.maximum.accumulate(stamps) - stamps
    if back_ns.max() > SET_BACK_NS:
        row = int(np.argmax(back_ns > SET_BACK_NS))
        raise InputError(
            f"time goes back by {back_ns[row] / SECOND_NS:.6f} s at message {row + 1} of"
            f" {rows.count}: the clock was set, or two publishers write to one topic; write the"
            " other `source` of time in the source file, or cut the log there"
        )
    late = int((back_ns > 0).sum())
    table = pl.DataFrame(columns).sort("stamp", maintain_order=True)
    table = table.unique(maintain_order=True)  # a message that was written twice
    repeated = rows.count - table["stamp"].n_unique()
    counts_of = {
        "came late and were put in the order of their stamps": late,
        "repeat the stamp of an earlier one": repeated,
    }
    remarks += [f"{count} messages {what}" for what, count in counts_of.items() if count]
    return Topic(table, late, repeated, remarks)


def stamps_of(recording: Recording, source: MessageSource, rows: Rows) -> NDArray[np.int64]:
    """The stamps [ns] of a topic's messages, (rows,): their own, or the recorder's."""
    if not rows.count:
        raise InputError("no message can be used; check that its sensor was running")
    if source.time.source == "log":
        assert rows.stamps_ns is not None
        return rows.stamps_ns
    address = {"topic": rows.name, "field": source.time.field}
    stamp = next((one for one in recording.channels if one.address == address), None)
    if stamp is None or np.ma.is_masked(stamp.values):
        raise InputError(
            f"it has no field '{source.time.field}' with seconds and nanoseconds in each message;"
            " correct time.field in the source file, or write source: log"
        )
    return np.ma.getdata(stamp.values)


def join_on_stamp(tables: list[pl.DataFrame]) -> pl.DataFrame:
    """One table, sorted, with a row per stamp; if a topic repeats stamps, with all of its rows."""
    if len(tables) == 1:
        return tables[0].clone()
    if any(table["stamp"].n_unique() < len(table) for table in tables):
        return pl.concat(tables, how="diagonal").sort("stamp", maintain_order=True)
    return reduce(
        lambda left, right: left.join(right, on="stamp", how="full", coalesce=True), tables
    ).sort("stamp")
