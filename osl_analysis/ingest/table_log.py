"""A log that is a table of rows as canonical columns. Its time is a channel, a stated rate, or the
timing that the file itself tells. Nothing is interpolated or held."""

from collections.abc import Mapping
from typing import Any

import numpy as np
import polars as pl
from numpy.typing import NDArray

from osl_analysis.errors import InputError
from osl_analysis.ingest.asked_table import (
    Table,
    check_common_rows,
    read_table,
)
from osl_analysis.ingest.conversion import (
    Converted,
    canonical_column,
    check_finite_values,
    checked_counts,
    losses_of,
    origin_of,
    remark_on_gaps,
    share_above,
)
from osl_analysis.ingest.force_plates import convert_plate
from osl_analysis.ingest.likely_clock import rate_of
from osl_analysis.ingest.other_clocks import check_other_clocks
from osl_analysis.recording import End, Recording
from osl_analysis.source_file import InAxes, TableSource
from osl_analysis.trial import Array, counter_column
from osl_analysis.units import si_factor

MOST_NOTES = 100  # lines of a file's own text that the provenance keeps
MOST_COPIED_SHARE = 0.1  # of rows that repeat the row before; more were read twice
LARGEST_CALIBRATION = 0.1  # by which a `scale` corrects a channel that is in the file's unit
FEWEST_COPIED = 20  # such rows that are refused


def convert_table(recording: Recording, source: TableSource, file_name: str) -> Converted:
    """Convert the channels of a table that a source file asks for.

    Parameters
    ----------
    file_name
        Under which the provenance keeps the rate of the rows.

    Returns
    -------
    Converted
        Time [s] starts at 0 in the first row.

    Raises
    ------
    InputError
        A channel is missing, time stands still or goes back, readings are no numbers, or more of
        them are missing than the source file allows.
    """
    check_loss(recording, source)
    clock = recording.find(source.time.address) if source.time.name else None
    channels = {
        column: recording.find(setting.address) for column, setting in source.channels.items()
    }
    asked = dict(channels)
    for column, setting in source.channels.items():
        if setting.counter is not None:
            address = {**setting.address, setting.ADDRESS: setting.counter}
            asked[counter_column(column)] = recording.find(address)
    table = read_table(recording, source, asked, clock)
    if table.rows.count < 2:
        raise InputError(
            f"holds one {table.rows.noun} of data: nothing to analyse; record the trial again, or"
            " exclude it"
        )
    time = table.time
    apart, remarks = check_other_clocks(recording, source, clock, table.rows, time, channels)
    check_common_rows(table, [*channels])

    samples = [pl.Series("time", time)]
    origins: dict[str, dict[str, Any]] = {}
    missing: dict[str, int] = {}
    warnings = [*recording.loss.remarks, *table.remarks, *remarks]
    for column, channel in channels.items():
        setting = source.channels[column]
        raw = table.values[column]
        series = canonical_column(column, channel, raw, table.rows, time, source)
        samples.append(series)
        warnings += remark_on_gaps(setting, raw, table.rows)
        if setting.counter is not None:
            counter = counter_column(column)
            counts = checked_counts(setting, table.values[counter], table.rows, time)
            samples.append(pl.Series(counter, counts))
        missing[column] = int(series.is_nan().sum())
        if missing[column]:
            rows = f"{time.size} {table.rows.noun}s"
            warnings.append(f"{column} is missing in {missing[column]} of {rows}")
        origin = origin_of(setting, column, channel.unit)
        if setting.name not in (channel.key, channel.title) or "*" in setting.name:
            origin["found"] = channel.title or channel.key
        ratio = unit_ratio(origin, channel.unit)
        if channel.unit and ratio != 1:
            warnings.append(f"{column} is read in {origin['unit']}; the file says {channel.unit}")
        if abs(ratio * origin["scale"] - 1) > LARGEST_CALIBRATION:
            origin["unit_of_file"] = channel.unit
        origins[column] = origin

    frame = pl.DataFrame(samples)
    is_fresh = np.concatenate([[True], np.diff(time) != 0])
    kept, remark = rows_to_keep(frame, is_fresh, source, table.rows.noun)
    warnings += remark
    facts: dict[str, Any] = {
        "time": {**source.time.model_dump(exclude_none=True), "start": table.start},
        "rates_hz": {file_name: rate_of(time[kept])},
        "repeated_stamps": int((~is_fresh).sum()),
        "missing": missing,
    }
    if apart:
        facts["clocks_apart"] = apart
    facts.update(recording.facts)
    if recording.notes:
        facts["comments"] = list(recording.notes[:MOST_NOTES])
    if not kept.all():
        frame = frame.filter(pl.Series(kept))
    if recording.plates:
        frame, plate_origins, facts["plates"] = with_plates(recording, source, table, frame, time)
        origins.update(plate_origins)
    losses = losses_of(recording.loss, of_messages=False)
    return Converted(frame, origins, facts, warnings, losses)


def check_loss(recording: Recording, source: TableSource) -> None:
    """Refuse a table that has lost more rows than the source file allows. A missing end counts
    nothing: nobody knows what it held."""
    loss = recording.loss
    by_rate = source.time.rate is not None and not source.time.name
    allowed = 0.0 if by_rate else source.most_missing
    if loss.end == End.MISSING or not loss.lost or loss.share <= allowed:
        return
    share = share_above(loss.lost, loss.expected or 1)
    advice = f"write `most_missing: {share:g}` in the source file"
    if by_rate:
        advice = "name its time: all rows behind the lost ones would be early"
    raise InputError(
        f"{loss.lost} of {loss.expected} rows cannot be used: {'; '.join(loss.remarks)}; repair the"
        f" log, or {advice}"
    )


def rows_to_keep(
    frame: pl.DataFrame, is_fresh: NDArray[np.bool_], source: TableSource, noun: str
) -> tuple[NDArray[np.bool_], list[str]]:
    """Choose among rows with the stamp of the row before, and say what was done with them.

    Parameters
    ----------
    is_fresh
        Rows (n,) with a stamp of their own.

    Raises
    ------
    InputError
        Many rows repeat stamp and values of the row before: they were read twice.
    """
    repeated = int((~is_fresh).sum())
    if not repeated:
        return is_fresh, []
    begin = f"{repeated} of {is_fresh.size} {noun}s repeat the stamp of the {noun} before and"
    if source.time.repeated == "drop":
        return is_fresh, [f"{begin} were left out"]
    advice = f"write `repeated: drop` under {source.place('time')}"
    is_copy = frame.select(pl.all_horizontal(pl.all().eq_missing(pl.all().shift()))).to_series()
    copied = int(is_copy[1:].sum())
    if copied > max(FEWEST_COPIED, MOST_COPIED_SHARE * is_fresh.size):
        raise InputError(
            f"{copied} of {is_fresh.size} {noun}s have time and values of the {noun} before;"
            f" {advice}, to read each once"
        )
    remark = (
        f"{begin} are taken for samples whose stamps were rounded; if the device was read faster"
        f" than it sampled, {advice}"
    )
    return np.ones_like(is_fresh), [remark]


def with_plates(
    recording: Recording, source: TableSource, table: Table, frame: pl.DataFrame, time: Array
) -> tuple[pl.DataFrame, dict[str, dict[str, Any]], list[dict[str, Any]]]:
    """The samples with the force plates of a table, where each column comes from, and facts on each
    plate."""
    assert isinstance(source, InAxes)
    if len(frame) != time.size or time.size != recording.plates[0].channels[0].rows.count:
        raise InputError(
            "rows that repeat a stamp were left out, but the plates need all; remove `repeated:"
            f" drop`, as {source.place('time', 'repeated')}"
        )
    rate = float(1 / np.median(np.diff(time))) if time.size > 1 else 1.0
    origins: dict[str, dict[str, Any]] = {}
    facts: list[dict[str, Any]] = []
    for plate in recording.plates:
        for channel in plate.channels:
            check_finite_values(f"column '{channel.key}'", channel.values, time)
        load = convert_plate(plate, source, source.rotation, rate_hz=rate)
        frame = frame.with_columns(pl.Series(name, one) for name, one in load.columns.items())
        origins.update(load.origins)
        facts.append(load.facts)
    return frame, origins, facts


def unit_ratio(origin: Mapping[str, Any], unit_of_file: str) -> float:
    """The factor by which a channel is converted, without its scale, over that of the file's unit;
    NaN where that unit is not known, as of the raw channel that `scale` converts."""
    try:
        return float(origin["factor"] / si_factor(unit_of_file, origin["si_unit"]))
    except InputError:
        return np.nan
