"""One recorded file as canonical columns, and the values that none of them can reach."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import polars as pl

from osl_analysis.errors import InputError
from osl_analysis.formats.csv_table import share_above
from osl_analysis.formats.table import Table
from osl_analysis.ingest.source import Channel
from osl_analysis.trial import Array, unit_of


@dataclass(frozen=True)
class Recording:
    """The raw files of one recorder, as read. All but the samples is JSON."""

    samples: pl.DataFrame
    """`time` [s] on the recorder's own clock, and canonical columns in SI units; null where a column has no sample."""
    columns: Mapping[str, Mapping[str, Any]]  # source channel and conversion of each column
    facts: Mapping[str, Any] = field(default_factory=dict)  # Further facts: rates, source of time, plates, damage.
    warnings: Sequence[str] = ()  # warnings, a sentence each

    def __post_init__(self) -> None:
        time = self.samples["time"]
        lasts = float(time[-1] - time[0]) if len(time) else 0.0
        for column, origin in self.columns.items():
            if abs(origin.get("delay", 0.0)) > lasts:
                raise InputError(
                    f"{column}: a delay of {origin['delay']:g} s is longer than the recording of {lasts:g} s; "
                    "correct `delay` and its unit in the source file"
                )


LEVEL_UNIT = "V"  # Of the columns that may be read from truth values: levels of `sync` and `trigger`.


def canonical_column(
    what: str, column: str, channel: Channel, table: Table, time: Array, most_missing: float, place: str
) -> pl.Series:
    """A channel of a table with times (rows,) [s] in SI units: NaN where a reading failed, null where it has no value.
    Refused are truth values that are no level, infinity, and a share of failed readings above `most_missing`. `what` is
    the channel and `place` that of its unit in the source file, for messages."""
    raw, lacking = table.columns[channel.name], np.ma.getmaskarray(table.columns[channel.name])
    if raw.dtype == bool and unit_of(column) != LEVEL_UNIT:
        row = int(np.argmin(lacking))
        raise InputError(
            f"{what} is {str(bool(np.ma.getdata(raw)[row])).lower()} in {table.place(row)}, a truth value and no "
            f"number in {unit_of(column)}; name a number as `{channel.ADDRESS}` in the source file"
        )
    with np.errstate(invalid="ignore"):  # a signalling NaN is one, too
        values: Array = np.ma.getdata(raw).astype(np.float64)
    values[lacking] = 0.0
    missing = np.isnan(values)
    check_values(what, np.where(missing, 0.0, values) if missing.any() else values, time)
    count = int(missing.sum())
    if count > most_missing * values.size:
        row = int(np.argmax(missing))
        first = f"at {time[row]:.3f} s" if table.lines is None else f"in {table.place(row)}"
        raise InputError(
            f"{what}: {table.failed} in {count} of {values.size} {table.noun}s, first {first}; at most "
            f"{most_missing:.1%} may be: repair the recording, or write `most_missing: "
            f"{share_above(count, values.size):g}` in the source file"
        )
    try:
        series = pl.Series(column, channel.to_si(values, unit_of(column), table.units.get(channel.name, "")))
    except InputError as error:
        raise InputError(f"{what}: {error}, as {place}") from error
    return series.set(pl.Series(lacking), None) if lacking.any() else series


def check_values(what: str, values: Array, time: Array) -> None:
    """Refuse NaN and infinity in a channel, (n,), naming the first with its time [s]."""
    finite = np.isfinite(values)
    if not finite.all():
        row = int(np.argmin(finite))
        raise InputError(
            f"{what}: {values[row]} in sample {row + 1} of {values.size}, at {time[row]:.3f} s; repair the recording "
            "or exclude the trial in the sheet"
        )


LARGEST_MEASURED = {  # largest size of a value in its SI unit, by kind of quantity
    "m": 1e3,  # no laboratory is a kilometre long
    "rad": 1e6,  # 160 000 turns
    "rad/s": 1e5,  # a million turns per minute
    "N": 1e6,  # the weight of a hundred tonnes
    "N*m": 1e7,  # N*mm called N*m on a plate stays below, which the centre of pressure tells better
    "A": 1e5,
    "V": 1e6,  # counts of a converter of 16 bits called V stay below
    "N*m/rad": 1e8,
    "N*m*s/rad": 1e8,
    "N*m/kg": 1e6,
}


def check_sizes(recording: Recording) -> None:
    """Refuse values beyond `LARGEST_MEASURED`, and infinite ones. NaN, which is a value that was not seen, passes."""
    time = recording.samples["time"].to_numpy()
    for column in recording.columns:
        bound, values = LARGEST_MEASURED[unit_of(column)], recording.samples[column].to_numpy()
        if np.fmax.reduce(values, initial=0.0) > bound or np.fmin.reduce(values, initial=0.0) < -bound:
            beyond = np.abs(values) > bound
            row = int(np.argmax(beyond))
            raise InputError(
                f"{column} is {values[row]:.4g} {unit_of(column)} at {time[row]:.3f} s, and beyond ±{bound:g} in "
                f"{beyond.sum()} of {np.count_nonzero(~np.isnan(values))} samples: nothing here can be so large; "
                "correct its unit or scale in the source file, or repair the recording"
            )
