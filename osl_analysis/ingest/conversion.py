# SPDX-License-Identifier: Apache-2.0
"""Convert recorded numbers to canonical columns in SI units, and note where they come from.

    value [SI] = sign * scale * factor * (raw + offset)

`factor` is that of the unit. A reading that failed is NaN; a row without a reading is null.
Example: `scale: 1/16384`, `unit: rev` makes 4096 counts of an encoder 1.5708 rad.
"""

import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import polars as pl
from numpy.typing import NDArray

from osl_analysis.base.errors import InputError, naming, printable
from osl_analysis.base.measured import spoiled
from osl_analysis.base.recording import Channel, End, Loss, Recording, Rows
from osl_analysis.base.source_file import (
    LEVEL_UNIT,
    MOST_DAMAGED,
    Conversion,
    LogChannel,
    LogSource,
)
from osl_analysis.base.trial import COUNTER, Array, unit_of
from osl_analysis.base.units import quantity, si_factor
from osl_analysis.ingest.turning import OTHER_TURNING, compare_turning, other_turning_channels

# settings that the provenance has in SI units, and the clock of a channel
SENSOR_FACTS = {"delay", "low_pass", "resolution", "range", "time"}
LARGEST_COUNT = 2 / np.finfo(float).eps  # floats hold whole numbers exactly below it


@dataclass(frozen=True)
class StaleStamps:
    """Rows whose stamp is of another time, which are left out."""

    largest_share: float = 0.001  # of the rows; of more of them, the clock itself goes back
    far_steps: float = 50.0  # usual steps by which a stamp goes back; late messages are nearer


STALE_STAMPS = StaleStamps()


@dataclass(frozen=True)
class Converted:
    """A recording as canonical columns. Everything but the samples can be written as JSON.

    Attributes
    ----------
    samples
        `time` [s] on the recorder's own clock, and columns in SI units; null where a column has no
        sample.
    origins
        Source channel and conversion of each column.
    facts
        Further facts for the provenance: rates, source of time, plates.
    warnings
        A sentence each.
    losses
        Lost messages or rows, for the provenance; empty for a complete table.
    start_s
        The recorder's own time [s] at `time` 0.
    """

    samples: pl.DataFrame
    origins: Mapping[str, dict[str, Any]]
    facts: Mapping[str, Any] = field(default_factory=dict)
    warnings: Sequence[str] = ()
    losses: Mapping[str, Any] = field(default_factory=dict)
    start_s: float = 0.0


def to_si(conversion: Conversion, raw: NDArray[Any], factor: float) -> NDArray[np.float64]:
    """Convert recorded numbers, of any shape, to the SI unit, by the `factor` of their unit."""
    gain = conversion.sign * conversion.scale * factor
    return (raw + conversion.offset) * gain


def origin_of(conversion: Conversion, column: str, unit_of_file: str = "") -> dict[str, Any]:
    """Say where a canonical column comes from, for the trial's provenance. `unit_of_file` counts if
    the source file states no unit.

    Returns
    -------
    dict
        The address and conversion, and the stated facts on the sensor in SI units. `range` is that
        of the column, after `sign` and `offset`.
    """
    si_unit = unit_of(column)
    origin = conversion.model_dump(exclude=SENSOR_FACTS)
    origin["unit"] = unit_of_file if conversion.unit is None else conversion.unit
    origin["factor"] = si_factor(origin["unit"], si_unit)
    if conversion.delay is not None:
        origin["delay"] = quantity(conversion.delay, "s")
    if conversion.low_pass is not None:
        cutoff_hz = quantity(conversion.low_pass.cutoff, "Hz")
        origin["low_pass"] = {"cutoff_hz": cutoff_hz, "order": conversion.low_pass.order}
    if conversion.resolution is not None:
        origin["resolution"] = conversion.step(si_unit)
    if conversion.range is not None:
        offset = conversion.scale * origin["factor"] * conversion.offset
        origin["range"] = sorted(
            conversion.sign * (end + offset) for end in conversion.ends(si_unit)
        )
    return origin


def floats_of(readings: Any) -> Array:
    """Readings of any shape as numbers, NaN where one is masked."""
    numbers: Array = np.ma.filled(np.ma.asarray(readings, np.float64), np.nan)
    return numbers


def numbers_of(channel: Channel) -> Array:
    """The readings of a channel (n,); NaN where one is missing, or if they are no numbers."""
    count = channel.rows.count
    try:
        return floats_of(channel.values).reshape(count)
    except (InputError, ValueError):  # words, or several numbers in a row
        return np.full(count, np.nan)


def share_above(share: float) -> float:
    """A share rounded up to three decimals, for the user to write."""
    return math.ceil(1000 * share) / 1000


def check_finite_values(what: str, values: Array, time: Array) -> None:
    """Refuse NaN and infinity in a channel (n,). The message gives the time [s] of the first."""
    finite = np.isfinite(values)
    if finite.all():
        return
    row = np.argmin(finite)
    raise InputError(
        f"{what}: {values[row]} in sample {row + 1} of {values.size}, at {time[row]:.3f} s",
        "repair the recording or exclude the trial in the sheet",
    )


@dataclass(frozen=True)
class CanonicalColumns:
    """Channels of the same rows as canonical columns.

    Attributes
    ----------
    columns
        In SI units, (n,) each: NaN where a reading failed, null where there is none. Counters
        follow their columns.
    origins
        Where each column comes from.
    remarks
        A sentence for each channel that has no value, or a failed one, in some rows.
    """

    columns: list[pl.Series]
    origins: dict[str, dict[str, Any]]
    remarks: list[str]


def canonical_columns(
    source: LogSource,
    channels: Mapping[str, Channel],
    values: Mapping[str, NDArray[Any]],
    rows: Rows,
    time: Array,
    columns_at_own_rate: Collection[str] = (),
) -> CanonicalColumns:
    """Convert the channels of some rows at times (n,) [s], and their counters.

    Parameters
    ----------
    channels, values
        Channels and their readings (n,), by canonical column; also of the counters, and of the
        other channels that turn. A reading is NaN where it failed, and masked where there is none.
    columns_at_own_rate
        Columns whose empty rows need no remark, since they have a rate of their own.

    Raises
    ------
    InputError
        Truth values in a column that is no level, infinity, or more failed readings than
        `most_missing`.
    """
    columns = []
    in_si: dict[str, Array] = {}
    origins = {}
    remarks = []
    for column, setting in source.channels.items():
        readings = np.ma.asarray(values[column])
        if readings.dtype == bool and unit_of(column) != LEVEL_UNIT:
            raise InputError(
                f"{setting.title} holds truth values and no numbers in {unit_of(column)}",
                f"name a number as `{setting.ADDRESS}` in the source file",
            )
        is_empty = np.ma.getmaskarray(readings)
        numbers, remarks_on_readings = sound_readings(
            source, setting, readings, rows, time, tells_empty=column not in columns_at_own_rate
        )
        remarks += remarks_on_readings
        if setting.wraps_at is not None:
            remarks += unwrap(setting.title, numbers, setting.wraps_at)
        with naming(setting.title, f", as {source.place('channels', column, 'unit')}"):
            origin = origin_of(setting, column, channels[column].unit)
        if setting.offset:
            shift = setting.offset * setting.scale * origin["factor"]
            remarks.append(
                f"{setting.title}: `offset` is added before `scale`, which shifts {column} by"
                f" {shift:.4g} {unit_of(column)}"
            )
        in_si[column] = to_si(setting, numbers, origin["factor"])
        columns.append(pl.Series(column, in_si[column]).set(pl.Series(is_empty), None))
        origins[column] = origin

        counter = column + COUNTER
        if counter in values:
            counts = checked_counts(
                f"{setting.ADDRESS} '{setting.counter}'",
                values[counter],
                rows,
                f"correct or leave out `counter`, or remove the {rows.noun} from the log",
            )
            columns.append(pl.Series(counter, counts))

    other_turning = [
        (channels[key], floats_of(values[key])) for key in channels if key.startswith(OTHER_TURNING)
    ]
    for ratio in compare_turning(time, in_si, other_turning):
        origins[ratio.column].setdefault(ratio.kind, {})[ratio.compared_with] = ratio.ratio
    return CanonicalColumns(columns, origins, remarks)


def sound_readings(
    source: LogSource,
    setting: LogChannel,
    readings: np.ma.MaskedArray[Any, Any],
    rows: Rows,
    time: Array,
    tells_empty: bool,
) -> tuple[Array, list[str]]:
    """Find the readings (n,) of a channel that can be used.

    Returns
    -------
    numbers
        In the unit of the file, (n,): NaN where a reading is empty, has failed, or is left out as
        damaged.
    remarks
        A sentence for each kind of reading that cannot be used; of empty ones if `tells_empty`.

    Raises
    ------
    InputError
        Infinity, or more failed readings than `most_missing`.
    """
    is_empty = np.ma.getmaskarray(readings)
    numbers = floats_of(readings).copy()
    has_failed = np.isnan(numbers) & ~is_empty
    rows_with_fault = {}  # mask (n,) of the rows, by what the channel has there
    if tells_empty:
        rows_with_fault["has no value"] = is_empty
    if source.damaged == "skip":
        is_word = np.isinf(numbers)
        numbers[is_word] = np.nan
        rows_with_fault["has a word or infinity"] = is_word
        known = ~np.isnan(numbers)
        leaps = np.zeros_like(known)
        leaps[known] = spoiled(numbers[known])
        # named before it is left out: the remark quotes the first such number
        rows_with_fault[f"leaps or recurs, as {numbers[np.argmax(leaps)]:.12g},"] = leaps
        numbers[leaps] = np.nan
    rows_with_fault["has no number"] = has_failed
    known = ~np.isnan(numbers)
    check_finite_values(setting.title, np.where(known, numbers, 0.0), time)
    remarks = [
        f"{setting.title} {fault} in {rows.counted(is_faulty)}"
        for fault, is_faulty in rows_with_fault.items()
        if is_faulty.any()
    ]
    missing_share = (~known & ~is_empty).mean()
    if missing_share > source.allowed_missing:
        raise InputError(
            remarks[-1],
            f"more than the {source.allowed_missing:.1%} of `most_missing`: repair the"
            f" recording, or write `most_missing: {share_above(missing_share):g}` in the"
            " source file",
        )
    return numbers, remarks


def unwrap(title: str, numbers: Array, wraps_at: float) -> list[str]:
    """Let numbers (n,) that begin anew at `wraps_at` go on, in place; a sentence if none does."""
    known = ~np.isnan(numbers)
    whole = np.unwrap(numbers[known], period=wraps_at)
    has_no_effect = np.array_equal(whole, numbers[known])
    numbers[known] = whole
    if has_no_effect:
        return [f"{title}: `wraps_at` had no effect, nothing begins anew"]
    return []


def checked_counts(what: str, raw: NDArray[Any], rows: Rows, remedy: str) -> NDArray[np.int64]:
    """Give the device's own count of samples, (n,), of the rows.

    Raises
    ------
    InputError
        A count is missing, or is no whole number.
    """
    counts = floats_of(raw)
    is_count = (counts == np.rint(counts)) & (np.abs(counts) < LARGEST_COUNT)
    if raw.dtype == bool or not is_count.all():
        row = np.argmin(is_count)
        raise InputError(
            f"{what}: {counts[row]:g} in {rows.place(row)} is no count of samples, a whole"
            " number below 9.01e+15",
            remedy,
        )
    return counts.astype(np.int64)


def losses_of(loss: Loss, topics: Collection[str] = ()) -> dict[str, Any]:
    """Report on losses for the provenance. Null means that the number is not known.

    Parameters
    ----------
    topics
        Those that are used, in a log of messages.

    Returns
    -------
    dict
        Empty for a table of which nothing is lost.
    """
    lost = loss.lost
    if loss.end == End.MISSING or (loss.end == End.UNKNOWN and not lost):
        lost = None  # nobody knows what stood behind the end
    if lost == 0 and not topics:
        return {}
    shares = [loss_of(loss, topic).share for topic in topics]
    return {
        "end_missing": loss.end == End.MISSING,
        "read": loss.read,
        "lost": lost,
        "share_lost": max(shares, default=loss.share),
        "remarks": [printable(text) for text in loss.remarks],
    }


def loss_of(loss: Loss, topic: str) -> Loss:
    """What was lost of one topic."""
    return Loss(*loss.by_topic.get(topic, (0, None)))


def asked_channels(recording: Recording, settings: Mapping[str, LogChannel]) -> dict[str, Channel]:
    """Find the channels that settings name, by canonical column, their counters, and all other
    angles and speeds in their rows."""
    asked = {column: recording.find(setting.address) for column, setting in settings.items()}
    asked |= other_turning_channels(recording, asked)
    for column, setting in settings.items():
        if setting.counter is not None:
            address = {**setting.address, setting.ADDRESS: setting.counter}
            asked[column + COUNTER] = recording.find(address)
    return asked


def fresh_rows(
    rows: Rows, stamps: NDArray[Any], least: float = 0.0, skips: bool = False
) -> tuple[NDArray[np.int64], list[str]]:
    """Leave out few rows whose stamp (n,) is of another time, as of a packet that waited in a
    buffer: without them time goes on.

    Parameters
    ----------
    least
        By how much at least, in the unit of the stamps.
    skips
        Whether more rows are left out, and by however little their stamp goes back.

    Returns
    -------
    places
        Of the rows that are kept, from 0: all of a clock that goes back in more of them.
    remarks
        A sentence if some are left out.
    """
    if (stamps[1:] >= stamps[:-1]).all():
        return np.arange(stamps.size), []
    late = np.maximum.accumulate(stamps) - stamps
    early = stamps - np.minimum.accumulate(stamps[::-1])[::-1]
    back = min(late, early, key=np.count_nonzero)
    far = max(least, STALE_STAMPS.far_steps * np.median(np.abs(np.diff(stamps))))
    is_stale = back > (0.0 if skips else far)
    share = MOST_DAMAGED if skips else STALE_STAMPS.largest_share
    if not 0 < is_stale.sum() <= share * stamps.size:
        return np.arange(stamps.size), []
    left_out = f"rows with a stamp of another time are left out: {rows.counted(is_stale)}"
    return np.flatnonzero(~is_stale), [left_out]
