"""A log of messages by topic as canonical columns, in the order of their stamps. Topics with
different stamps have rows of their own, null in the columns of the others. Nothing is interpolated
or held."""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
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
from osl_analysis.ingest.stale_rows import find_stale_rows, remarks_on_stale_rows
from osl_analysis.recording import Channel, Loss, Recording, Rows
from osl_analysis.source_file import MessageChannel, MessageSource
from osl_analysis.trial import counter_column

SECOND_NS = 1_000_000_000
SET_BACK_NS = SECOND_NS  # a message that is later than others by more was not only late
LATE_RUN = 4  # breaks in the order of the file that one run of late messages makes, or fewer
MOST_BREAKS = 10  # beyond those of late messages: more, and two spans of time were interleaved


@dataclass(frozen=True)
class Ordering:
    """How many messages of a topic came late, repeat a stamp, or contradict an earlier one of the
    same stamp."""

    late: int = 0
    repeated: int = 0
    contradicted: int = 0


@dataclass(frozen=True)
class Topic:
    """Stamps [ns] and canonical columns of one topic, sorted by stamp."""

    table: pl.DataFrame
    ordering: Ordering
    remarks: Sequence[str]


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
    by_topic: dict[str, dict[str, MessageChannel]] = {}
    for column, setting in source.channels.items():
        by_topic.setdefault(setting.topic, {})[column] = setting
    check_losses(recording.loss, by_topic, source)
    topics: dict[str, Topic] = {}
    for name, settings in by_topic.items():
        channels = {column: find_field(recording, one) for column, one in settings.items()}
        with naming(f"topic '{name}'"):
            topics[name] = convert_topic(recording, source, settings, channels)

    rates = {
        name: rate_of(topic.table["stamp"].to_numpy(), SECOND_NS) for name, topic in topics.items()
    }
    missing = {
        column: int(topics[setting.topic].table[column].is_nan().sum())
        for column, setting in source.channels.items()
    }
    joined = join_on_stamp([topic.table for topic in topics.values()])
    start = int(joined["stamp"][0])
    time = ((joined.drop_in_place("stamp") - start) / SECOND_NS).alias("time")
    stamp = source.time.field if source.time.source == "header" else "log"
    contradicted = sum(topic.ordering.contradicted for topic in topics.values())
    facts: dict[str, Any] = {
        **recording.facts,
        "time": {"source": stamp, "stamps": source.time.stamps, "start_ns": start},
        "rates_hz": rates,
        "stamps": {name: asdict(topic.ordering) for name, topic in topics.items()},
        "missing": missing,
    }
    origins = {column: origin_of(one, column) for column, one in source.channels.items()}
    warnings = [*recording.loss.remarks, *remark_on_checksums(recording.loss)]
    for name, topic in topics.items():
        warnings += [f"topic '{name}': {text}" for text in topic.remarks]
    for column, count in missing.items():
        if count:
            warnings.append(f"{column} is missing in {count} of {len(joined)} rows")
    losses = losses_of(recording.loss, True, [*by_topic], contradicted)
    return Converted(pl.DataFrame([time, *joined]), origins, facts, warnings, losses)


def find_field(recording: Recording, setting: MessageChannel) -> Channel:
    """Find a field; of a damaged log the refusal tells the damage too, which may be why."""
    try:
        return recording.find(setting.address)
    except InputError as error:
        if not recording.loss.remarks:
            raise
        remedy = f"; {error.remedy}" if error.remedy else ""
        damage = ", ".join(recording.loss.remarks)
        raise InputError(f"{error.reason} ({damage}){remedy}") from error


def check_losses(
    loss: Loss, by_topic: Mapping[str, Mapping[str, MessageChannel]], source: MessageSource
) -> None:
    """Refuse a log that has lost a larger share of a topic than the source file allows."""
    for name in by_topic:
        share = share_lost(loss, name)
        if share > source.largest_loss:
            raise InputError(
                f"damaged or incomplete: {100 * share:.3g} % of topic '{name}' is lost, more"
                f" than the {100 * source.largest_loss:.3g} % of `largest_loss` in the source file:"
                f" {'; '.join(loss.remarks)}; record again"
            )


def remark_on_checksums(loss: Loss) -> list[str]:
    """Say where no checksum covers the messages."""
    if loss.checksums == "checked" or not loss.read:
        return []
    which = "some" if loss.checksums == "mixed" else "any"
    return [f"not verifiable: no checksum covers {which} of its {loss.read} messages"]


def convert_topic(
    recording: Recording,
    source: MessageSource,
    settings: Mapping[str, MessageChannel],
    channels: Mapping[str, Channel],
) -> Topic:
    """Convert the asked fields of one topic.

    Parameters
    ----------
    settings, channels
        What the source file says, and the fields of the recording, by canonical column.
    """
    rows = next(iter(channels.values())).rows
    if not rows.count:
        raise InputError("no message can be used; check that its sensor was running")
    from_header = source.time.source == "header"
    stamps = header_stamps(recording, source, rows) if from_header else logged_stamps(rows)
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
    table = pl.DataFrame(columns)
    stale = find_stale_rows(stamps, least=SET_BACK_NS)
    if stale.size:
        remarks += remarks_on_stale_rows(rows, stamps, stale, 1 / SECOND_NS)
        table = table.filter(~pl.Series(np.isin(np.arange(rows.count), stale)))
    table, ordering = sorted_by_stamp(table, source, advice_on_clock(rows, from_header))
    counts_of = {
        "came late and were put in the order of their stamps": ordering.late,
        "repeat a stamp and were joined to its first": ordering.repeated - ordering.contradicted,
        "contradict an earlier one of the same stamp and are lost": ordering.contradicted,
    }
    remarks += [f"{count} messages {what}" for what, count in counts_of.items() if count]
    return Topic(table, ordering, remarks)


def header_stamps(recording: Recording, source: MessageSource, rows: Rows) -> NDArray[np.int64]:
    """The stamps [ns] in the messages of a topic, (rows,)."""
    field = source.time.field
    address = {"topic": rows.name, "field": field}
    stamp = next((one for one in recording.channels if one.address == address), None)
    if stamp is None:
        raise InputError(
            f"it has no field '{field}' with seconds and nanoseconds; correct time.field in the"
            " source file, or write source: log"
        )
    stamps = stamp.read()  # once: not kept, as its values would be
    lacking = int(np.ma.getmaskarray(stamps).sum())
    if lacking:
        raise InputError(f"{lacking} of {rows.count} messages have no '{field}'; write source: log")
    return np.asarray(np.ma.getdata(stamps))


def logged_stamps(rows: Rows) -> NDArray[np.int64]:
    """The recorder's stamps [ns] of a topic, (rows,)."""
    assert rows.stamps_ns is not None
    if (rows.stamps_ns < 0).any():
        row = int(np.argmax(rows.stamps_ns < 0))
        raise InputError(
            f"message {row + 1} was logged at {int(rows.stamps_ns[row]) + 2**64} ns, which is not a"
            " time; write source: header, or record again"
        )
    return rows.stamps_ns


def advice_on_clock(rows: Rows, from_header: bool) -> str:
    """What to do where stamps go back."""
    logged = rows.stamps_ns
    if from_header and logged is not None and (logged[1:] >= logged[:-1]).all():
        return "write source: log in the source file, or exclude the trial"
    return "its times cannot be used: record again, or exclude the trial"


def sorted_by_stamp(
    table: pl.DataFrame, source: MessageSource, advice: str
) -> tuple[pl.DataFrame, Ordering]:
    """Sort the rows of a topic by `stamp` [ns], and join those of one stamp.

    Parameters
    ----------
    table
        Rows in the order of recording.
    advice
        What to do if the clock was set back.

    Raises
    ------
    InputError
        The clock was set back, or too many messages have the stamp of an earlier one.
    """
    stamp = table["stamp"].to_numpy()
    if (stamp[1:] > stamp[:-1]).all():
        return table, Ordering()
    late = check_not_set_back(table.unique(maintain_order=True)["stamp"].to_numpy(), advice)
    table = table.sort("stamp", maintain_order=True)
    distinct, messages = np.unique(stamp, return_counts=True)
    repeated = stamp.size - distinct.size
    if not repeated:
        return table, Ordering(late)
    if distinct.size > 2 and not table.is_duplicated().any() and are_rounded(distinct, messages):
        return table, Ordering(late)
    if repeated > source.largest_loss * stamp.size:
        raise InputError(
            f"{repeated} of {stamp.size} messages have the stamp of an earlier one; stamps must be"
            " their own: check the recorder's clock or the time source in the source file"
        )
    contradicted = table.unique().height - distinct.size
    once = table.unique(subset="stamp", keep="first", maintain_order=True)
    return once, Ordering(late, repeated, contradicted)


def are_rounded(distinct: NDArray[np.int64], messages: NDArray[np.int64]) -> bool:
    """Whether stamps repeat because they are rounded to a step as long as the sampling step or
    longer. Then nearly every tick of the rounding has a message, and no tick has two more than
    usual. The time base finds when they were sampled.

    Parameters
    ----------
    distinct, messages
        Shape (ticks,): rising stamps [ns], and the number of messages at each.
    """
    step = int(np.diff(distinct).min())
    empty_ticks = int(distinct[-1] - distinct[0]) // step + 1 - distinct.size
    repeated = int(messages.sum()) - distinct.size
    is_even = int(messages[1:-1].max()) - int(np.median(messages[1:-1])) <= 1
    return is_even and empty_ticks <= 0.5 * repeated


def check_not_set_back(stamp: NDArray[np.int64], advice: str) -> int:
    """Refuse stamps (n,) [ns] of a clock that was set back, or count those that are late.

    Late messages fill a gap. Those of a clock that was set back fall among earlier ones: put in
    order, the stamps come from two places of the file by turns.
    """
    latest = np.maximum.accumulate(stamp)
    is_late = stamp < latest
    if not is_late.any():
        return 0
    runs = int(is_late[0]) + int((is_late[1:] & ~is_late[:-1]).sum())
    breaks = int((np.diff(np.argsort(stamp, kind="stable")) != 1).sum())
    back_ns = latest - stamp
    is_far = back_ns > SET_BACK_NS
    if is_far.any() or breaks > LATE_RUN * runs + MOST_BREAKS:
        row = int(np.argmax(is_far if is_far.any() else is_late))
        raise InputError(
            f"time goes back by {back_ns[row] / SECOND_NS:.6f} s at message {row + 1} of"
            f" {stamp.size}; the clock was set while recording: {advice}"
        )
    return int(is_late.sum())


def join_on_stamp(tables: Sequence[pl.DataFrame]) -> pl.DataFrame:
    """One table, sorted, with a row per stamp; if a table repeats stamps (they are rounded), all
    rows are kept.

    `tables` are sorted by stamp; they are used up.
    """
    if len(tables) == 1:
        return tables[0]
    are_rounded = any(has_equal(table["stamp"]) for table in tables)
    stamps = pl.concat([table["stamp"] for table in tables])
    # of the type that polars takes, which it would else make for each column
    order = pl.Series(np.argsort(stamps.to_numpy(), kind="stable"), dtype=pl.get_index_type())
    stamps = stamps.gather(order)
    if are_rounded or not has_equal(stamps):
        columns = [stamps]
        before = 0
        for table in tables:
            behind = len(order) - before - len(table)
            for name in table.columns[1:]:  # one by one saves 0.5 GB for an hour's rows
                own = table.drop_in_place(name)
                whole = pl.concat([own.clear(before), own, own.clear(behind)])
                columns.append(whole.gather(order))
            before += len(table)
        return pl.DataFrame(columns)
    joined = reduce(
        lambda left, right: left.join(right, on="stamp", how="full", coalesce=True), tables
    )
    return joined.sort("stamp")


def has_equal(stamps: pl.Series) -> bool:
    """Whether sorted stamps repeat."""
    ns = stamps.to_numpy()
    return bool((ns[1:] == ns[:-1]).any())
