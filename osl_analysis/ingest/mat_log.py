"""A log in a MATLAB file to canonical columns, by a source file."""

from collections.abc import Mapping
from pathlib import Path

import numpy as np
import polars as pl

from osl_analysis.columns import counter_column, unit_of
from osl_analysis.errors import InputError, listing, nearest
from osl_analysis.formats.mat.address import LISTED, Address, find, vector
from osl_analysis.formats.mat.mat_file import MatFile, open_mat
from osl_analysis.formats.mat.values import Value
from osl_analysis.ingest.mat_source import MatSource
from osl_analysis.ingest.recording import Recording, check_values
from osl_analysis.ingest.row_time import RowStamps, since_first
from osl_analysis.ingest.units import si_factor
from osl_analysis.trial import Array


class Signals:
    """The vectors of one file that a source file asks for."""

    def __init__(self, file: MatFile, source: MatSource) -> None:
        """Reads the variables of all addresses of the source file; an address of another file's kind is refused."""
        self.file, self.source = file, source
        texts = [channel.variable for channel in source.channels.values()]
        texts += [channel.counter for channel in source.channels.values() if channel.counter]
        texts += [source.time.variable] if source.time.variable else []
        addresses = [self.within_part(text) for text in texts]
        self.variables: Mapping[str, Value] = file.read({address.variable for address in addresses})

    def within_part(self, text: str) -> Address:
        """An address of the source file; every refusal names the file."""
        try:
            return self.source.address(text)
        except InputError as error:
            raise InputError(f"{self.file.path}: {error}") from error

    def vector(self, text: str) -> Array:
        """The numbers (n,) at an address of the source file.

        Raises
        ------
        InputError
            There is nothing, or no vector of real numbers.
        """
        address = self.within_part(text)
        if address.variable not in self.file.names and not self.source.log_part:
            raise InputError(
                f"{self.file.path}: no variable '{address.variable}'; it has {listing(self.file.names, LISTED)}"
                f"{nearest(address.variable, self.file.names)}; if one of these holds it, name this one as `log_part`, "
                "in the sample sheet where it differs from trial to trial"
            )
        try:
            return vector(address, find(self.variables, self.file.names, address))
        except InputError as error:
            raise InputError(
                str(error) if str(self.file.path) in str(error) else f"{self.file.path}: {error}"
            ) from error


def read_mat_log(path: Path, source: MatSource) -> Recording:
    """The variables that the source file maps, in SI units; time [s] counts from the first sample.

    Raises
    ------
    InputError
        The file is damaged, a variable is missing or holds no vector of real numbers, vectors differ in length, too
        many numbers are NaN, or time goes back.
    """
    signals = Signals(open_mat(path), source)
    raw = {column: signals.vector(channel.variable) for column, channel in source.channels.items()}
    time, start = time_of(signals, next(iter(raw.values())).size)
    check_lengths(signals, raw, time)
    check_own_variables(path, source)
    columns, origins = [pl.Series("time", time)], {}
    for column, channel in source.channels.items():
        check_values(f"{path}: {channel.variable}", raw[column], time, source.most_missing)
        columns.append(pl.Series(column, channel.to_si(raw[column], unit_of(column))))
        if channel.counter is not None:
            columns.append(counter_of(signals, channel.counter, time).alias(counter_column(column)))
        origins[column] = {**channel.origin(column), "variable": signals.within_part(channel.variable).text}
    stamps = RowStamps(time, source.time)
    missing = {column: int(np.isnan(values).sum()) for column, values in raw.items()}
    facts = {
        **stamps.facts(path.name, start),
        "missing": missing,
        "version": signals.file.version,
        "header": signals.file.header,
        "log_part": source.log_part,
    }
    warnings = [f"{path.name}: {column} is NaN in {n} of {time.size} samples" for column, n in missing.items() if n]
    repeats = f"{path.name}: {stamps.repeats} samples repeat the stamp of the sample before"
    warnings += stamps.repeats_text(repeats, source.place("time"))
    return Recording(pl.DataFrame(columns).filter(pl.Series(stamps.kept)), origins, facts, warnings)


def time_of(signals: Signals, samples: int) -> tuple[Array, float]:
    """Time [s] of every sample since the first one, and the reading of the clock at the first one."""
    path, source = signals.file.path, signals.source.time
    if source.rate is not None:
        return np.arange(samples) / source.rate, 0.0
    raw = signals.vector(str(source.variable))
    factor, what = si_factor(str(source.unit), "s"), f"{path}: {source.variable}"
    advice = "samples; take another variable, or state the rate of the samples: `time: {rate: 1000}`"
    return since_first(raw, factor, what, advice), float(raw[0])


def check_lengths(signals: Signals, raw: Mapping[str, Array], time: Array) -> None:
    """Refuse vectors (n,) of other lengths than time, or than the first of them where there is no time."""
    source = signals.source
    reference = source.time.variable or next(iter(source.channels.values())).variable
    for column, values in raw.items():
        if values.size != time.size:
            raise InputError(
                f"{signals.file.path}: {source.channels[column].variable} has {values.size} numbers and {reference} "
                f"has {time.size}; name variables of one recording, or cut them to one length in MATLAB"
            )


def check_own_variables(path: Path, source: MatSource) -> None:
    """Refuse two signals of different units, such as angle and torque, from one variable."""
    by_address: dict[str, str] = {}
    for column, channel in source.channels.items():
        other = by_address.setdefault(str(source.address(channel.variable).steps), column)
        if unit_of(other) != unit_of(column):
            raise InputError(
                f"{path}: {channel.variable} is {other} and {column} in the source file; correct "
                f"{source.place('channels', column, 'variable')}"
            )


def counter_of(signals: Signals, text: str, time: Array) -> pl.Series:
    """The device's count of its samples, (n,); refused where it is missing or not whole."""
    raw = signals.vector(text)
    wrong = raw != np.rint(raw)
    if wrong.any() or raw.size != time.size:
        what = f"{raw[np.argmax(wrong)]} is no count" if wrong.any() else f"{raw.size} counts of {time.size} samples"
        raise InputError(f"{signals.file.path}: {text}: {what}; remove `counter` from the source file")
    return pl.Series(raw.astype(np.int64))
