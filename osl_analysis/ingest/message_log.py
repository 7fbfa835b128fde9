# SPDX-License-Identifier: Apache-2.0
"""Convert a log of messages by topic to canonical columns, in the order of their stamps.

Topics with different stamps have rows of their own, null in the columns of the others. Nothing is
interpolated or held.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import polars as pl
from numpy.typing import NDArray

from osl_analysis.base.errors import InputError, naming
from osl_analysis.base.recording import SECOND_NS, Recording, Rows
from osl_analysis.base.source_file import MessageChannel, MessageSource
from osl_analysis.ingest.batches import spread_batches
from osl_analysis.ingest.conversion import (
    Converted,
    asked_channels,
    canonical_columns,
    fresh_rows,
    loss_of,
    losses_of,
)
from osl_analysis.ingest.likely_clock import rate_of
from osl_analysis.signals.filters import longest_run


@dataclass(frozen=True)
class LateMessages:
    """Messages that were stamped before one that came earlier."""

    most_in_a_row: int = 10  # messages; of more, the clock was set back


LATE_MESSAGES = LateMessages()


def convert_messages(recording: Recording, source: MessageSource) -> Converted:
    """Convert the fields that a source file asks for.

    Returns
    -------
    Converted
        Time [s] counts from the first stamp.

    Raises
    ------
    InputError
        A field is missing, a topic has lost more messages than `largest_loss`, or stamps
        contradict each other.
    """
    loss = recording.loss
    by_topic: dict[str, dict[str, MessageChannel]] = {}
    for column, setting in source.channels.items():
        by_topic.setdefault(setting.topic, {})[column] = setting
    warnings = [*loss.remarks]
    tables = []
    rates_hz = {}
    origins = {}
    for name, settings in by_topic.items():
        share = loss_of(loss, name).share
        if share > source.largest_loss:
            raise InputError(
                f"damaged or incomplete: {100 * share:.3g} % of topic '{name}' is lost, more"
                f" than the {100 * source.largest_loss:.3g} % of `largest_loss` in the source"
                f" file: {'; '.join(loss.remarks)}",
                "record again",
            )
        with naming(f"topic '{name}'"):
            table, topic_origins, remarks = convert_topic(recording, source, settings)
        tables.append(table)
        rates_hz[name] = rate_of(table["stamp"].to_numpy(), SECOND_NS)
        origins.update(topic_origins)
        warnings += [f"topic '{name}': {text}" for text in remarks]
    joined = join_on_stamp(tables)
    start = joined["stamp"][0]
    time = ((joined["stamp"] - start) / SECOND_NS).alias("time")
    time_facts = {**source.time.model_dump(), "start_ns": start}
    return Converted(
        samples=pl.DataFrame([time, *joined.drop("stamp")]),
        origins=origins,
        facts={**recording.facts, "time": time_facts, "rates_hz": rates_hz},
        warnings=warnings,
        losses=losses_of(loss, [*by_topic]),
        start_s=start / SECOND_NS,
    )


def convert_topic(
    recording: Recording, source: MessageSource, settings: Mapping[str, MessageChannel]
) -> tuple[pl.DataFrame, dict[str, Any], list[str]]:
    """Convert the asked fields of one topic, by canonical column: a table of `stamp` [ns], sorted,
    and columns, their origins, and remarks on messages that came late, or are left out."""
    asked = asked_channels(recording, settings)
    values = {column: channel.values for column, channel in asked.items()}
    rows = next(iter(asked.values())).rows
    stamps = stamps_of(recording, source, rows)
    time = (stamps - stamps[0]) / SECOND_NS
    topic_source = source.model_copy(update={"channels": settings})
    converted = canonical_columns(topic_source, asked, values, rows, time)
    origins = converted.origins
    remarks = converted.remarks
    # a message that is later than others by more was not only late
    fresh, stale = fresh_rows(rows, stamps, least=SECOND_NS)
    table = pl.DataFrame([pl.Series("stamp", stamps), *converted.columns])
    if stale:
        table = table[fresh]
        remarks += stale
    if (table["stamp"].diff() > 0).all():
        return table, origins, remarks
    once = table.unique(maintain_order=True)
    copies = len(table) - len(once)
    late = count_late(once["stamp"].to_numpy())
    if late:
        remarks.append(f"{late} messages came late and were put in the order of their stamps")
    in_order = once.sort("stamp", maintain_order=True)
    counts = in_order["stamp"].rle().struct.field("len").to_numpy()
    repeated = len(table) - counts.size
    allowed = source.largest_loss * len(table)
    # of rounded stamps each has about as many messages; the time base finds when they were sampled
    is_rounded = copies <= allowed and counts.max() <= np.median(counts) + 1
    batches = spread_batches(in_order["stamp"].to_numpy()) if repeated else None
    if batches is not None:
        spread, is_moved = batches
        in_order = in_order.with_columns(stamp=pl.Series(spread))
        rate = rate_of(spread, SECOND_NS)
        remarks.append(
            f"{is_moved.sum()} of {len(in_order)} messages have the stamp of a later one: they came"
            f" in batches, and are spread evenly at the sensor's {rate:.4g} Hz"
        )
        for origin in origins.values():
            origin["time"] = {**source.time.model_dump(), "in_batches": int(is_moved.sum())}
    elif repeated > allowed and not is_rounded:
        raise InputError(
            f"{repeated} of {len(table)} messages have the stamp of an earlier one",
            "stamps must be their own: check the recorder's clock or the time source in the"
            " source file",
        )
    if copies:
        remarks.append(f"{copies} messages are copies of an earlier one: left out")
    return in_order, origins, remarks


def stamps_of(recording: Recording, source: MessageSource, rows: Rows) -> NDArray[np.int64]:
    """The stamps [ns] of the messages of a topic, (rows,): their own, or the recorder's."""
    if source.time.source == "log":
        return np.asarray(rows.stamps_ns, np.int64)
    with naming("time", ", or write source: log"):
        stamp = recording.find({"topic": rows.name, "field": source.time.field})
    stamps = stamp.read()  # once: not kept, as its values would be
    lacking = np.ma.getmaskarray(stamps).sum()
    if lacking:
        raise InputError(
            f"{lacking} of {rows.count} messages have no '{source.time.field}'", "write source: log"
        )
    if not np.ma.getdata(stamps).any():
        raise InputError(
            f"'{source.time.field}' is zero in all {rows.count} messages, which the driver never"
            " fills",
            "write `time: {source: log}`, the recorder's own",
        )
    return np.ma.getdata(stamps)


def count_late(stamp: NDArray[np.int64]) -> int:
    """Count messages that come late, by their stamps (n,) [ns]; refused if the clock was set back.

    A message is late alone, or with a few others. Behind a clock that was set back all are, until
    it has caught up.
    """
    back_ns = np.maximum.accumulate(stamp) - stamp
    is_late = back_ns > 0
    if is_late[longest_run(is_late)].size > LATE_MESSAGES.most_in_a_row:
        row = np.argmax(back_ns)
        raise InputError(
            f"time goes back by {back_ns[row] / SECOND_NS:.6f} s at message {row + 1} of"
            f" {stamp.size}",
            "the clock was set while recording, or a whole buffer came late: write another"
            " source of time in the source file, or record again",
        )
    return int(is_late.sum())


def join_on_stamp(tables: Sequence[pl.DataFrame]) -> pl.DataFrame:
    """One table, sorted by the column `stamp`, with a row per stamp; if a table repeats stamps
    (they are rounded), all rows are kept."""
    rows = pl.concat(tables, how="diagonal").sort("stamp", maintain_order=True)
    repeats = any((table["stamp"].diff() == 0).any() for table in tables)
    if repeats or not (rows["stamp"].diff() == 0).any():
        return rows
    # some stamps are shared: a join, which takes ten times as long
    return pl.concat(tables, how="align_full")
