# SPDX-License-Identifier: Apache-2.0
"""A trial: the canonical samples of one recording, checked at construction, and its file (Parquet).

Name, unit and sign of each column stand in `nomenclature.yaml`.
"""

import json
import math
import re
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl
from numpy.typing import NDArray

from osl_analysis.base.errors import InputError, listing, naming, nearest
from osl_analysis.base.files import atomic_path, package_yaml
from osl_analysis.base.measured import check_finite
from osl_analysis.base.table import SCHEMA, check_analysed, check_schema

NOMENCLATURE = package_yaml(Path(__file__).with_name("nomenclature.yaml"))
COLUMNS: dict[str, str] = NOMENCLATURE["columns"]
"""Unit of each canonical column."""
AXES = ("x", "y", "z")
Array = NDArray[np.float64]
FAMILIES: dict[str, str] = NOMENCLATURE["families"]
"""Units of columns that exist once per marker, per plate, per side or per additional signal."""


def marker_columns(label: str) -> list[str]:
    """Columns of one marker's position in the laboratory [m]; NaN where the marker was not seen."""
    return [f"marker_{label}_{axis}" for axis in AXES]


def plate_columns(plate: int) -> list[str]:
    """The six columns of one force plate, counted from 1: ground reaction force [N] and moment
    [N*m] on the foot, in laboratory axes, for the plate at rest. The moment is about the centre of
    the plate's surface."""
    return [f"plate{plate}_{name}_{axis}" for name in ("force", "moment") for axis in AXES]


# end of the name of a column with the device's own sample count, for a column whose source file
# names a `counter`
COUNTER = "_counter"


def unit_of(column: str) -> str:
    """Unit of a canonical column, or of a column of a family. Raises KeyError for another name."""
    for pattern, unit in FAMILIES.items():
        if re.fullmatch(pattern, column, re.DOTALL):
            return unit
    return COLUMNS[column]


LATE_END_S = 1.0  # s by which a stated window may end after the recording


def parsed_windows(text: str, duration_s: float = math.inf) -> list[tuple[float, float]]:
    """Read the parts of a recording that are stated as `2-30 40-62`.

    Parameters
    ----------
    text : str
        From-to pairs [s], parted by blanks.
    duration_s : float
        Of the recording. A part may end `LATE_END_S` later.

    Returns
    -------
    list of (float, float)
        Begin and end [s] of each part.

    Raises
    ------
    InputError
        The text has another form, or the parts overlap, touch, are not in time order, or lie beyond
        the recording.
    """
    has_form = re.fullmatch(r"(\s*\d+\.?\d*-\d+\.?\d*(?=\s|$))+\s*", text)
    edges = list(map(float, re.findall(r"\d+\.?\d*", text)))
    if not has_form or edges != sorted(set(edges)):
        raise InputError(
            f"windows '{text}' are not from-to in s, in the order of time, without overlap or"
            " touching",
            "write them as 2-30 40-62",
            settings=["windows"],
        )
    if edges[-1] > duration_s + LATE_END_S:
        raise InputError(
            f"windows '{text}' reach beyond the recording, which lasts 0 to {duration_s:.1f} s",
            "state windows within these",
            settings=["windows"],
        )
    return list(zip(edges[::2], edges[1::2], strict=True))


NAME_KEY = "osl_analysis.trial"
PROVENANCE_KEY = "osl_analysis.provenance"
SCHEMA_KEY = "osl_analysis.schema"


@dataclass(frozen=True)
class Trial:
    """Samples of one trial in canonical columns (`COLUMNS`), a row per time stamp.

    Attributes
    ----------
    name : str
        Of the trial, for messages.
    samples : polars.DataFrame
        Columns in SI units. *null*: the column has no sample at that time, because its recorder has
        another rate. *NaN*: the column was sampled but has no reading, such as an occluded marker.
        A pandas frame is taken, too; it has no null, so that its NaN stays one.
    provenance : Mapping
        Where each column comes from; all of it is JSON.
    clocks : Mapping
        How the stamps of each column's device are read (`signals.stamp_evidence.Reading`), as
        ingest found it. Without it, a fit decides. Leave it out with changed samples.

    Raises
    ------
    InputError
        No rows, no `time`, or a time that goes back or is not finite.

    Examples
    --------
    >>> import polars as pl
    >>> samples = pl.DataFrame({"time": [0.0, 0.01], "theta": [0.0, 0.1], "torque": [0.0, 30.0]})
    >>> osl.Trial("step", samples).columns
    ['time', 'theta', 'torque']
    """

    name: str
    samples: pl.DataFrame
    provenance: Mapping[str, Any] = field(default_factory=dict)
    clocks: Mapping[str, Sequence[Any]] = field(default_factory=dict, repr=False, compare=False)

    def __post_init__(self) -> None:
        frame: Any = self.samples
        if not isinstance(frame, pl.DataFrame):
            try:  # a pandas frame, or columns by name; `pl.from_pandas` needs pyarrow
                samples = pl.DataFrame({str(name): np.asarray(frame[name]) for name in frame})
            except (TypeError, LookupError, pl.exceptions.PolarsError) as error:
                raise InputError(
                    f"trial {self.name}: the samples are no data frame ({type(frame).__name__})",
                    "give one of polars or pandas, with a column `time` in seconds",
                ) from error
            object.__setattr__(self, "samples", samples)
        if "time" not in self.samples.columns:
            raise InputError(f"trial {self.name}: no column 'time'", "map one in the source file")
        if self.samples.is_empty():
            raise InputError(
                f"trial {self.name}: no samples",
                "record the trial again or exclude it in the sheet",
            )
        check_time(self.name, self.samples["time"].to_numpy())

    @property
    def columns(self) -> Sequence[str]:
        return self.samples.columns

    @cached_property
    def readings(self) -> dict[str, tuple[Array, Array]]:
        """What `ingest.guard.recorded` has read of columns: several checks look at each."""
        return {}

    def parts(self, windows: str) -> list[tuple[float, float]]:
        """Begin and end [s] of windows, stated as `2-30 40-62` after the first sample. Raises
        InputError: they are no windows of this trial."""
        with naming(f"trial {self.name}"):
            return parsed_windows(windows, np.ptp(self.samples["time"].to_numpy()))

    def within(self, windows: str) -> "Trial":
        """The samples within windows, stated as for `parts`."""
        start = self.samples["time"][0]
        is_inside = [
            pl.col("time").is_between(start + first, start + last)
            for first, last in self.parts(windows)
        ]
        return replace(self, samples=self.samples.filter(pl.any_horizontal(is_inside)), clocks={})

    def cut_to(self, windows: str) -> "tuple[Trial, str]":
        """The samples from the first window to the end of the last one, as stated for `parts`, and
        the windows [s] after the first of these samples."""
        parts = np.array(self.parts(windows))
        time = self.samples["time"]
        cut = self.within(f"{parts.min():.9f}-{parts.max():.9f}")
        shifted = np.maximum(parts - (cut.samples["time"][0] - time[0]), 0)
        return cut, " ".join(f"{begin:.9f}-{end:.9f}" for begin, end in shifted)

    def arrays(self, *columns: str) -> list[Array]:
        """Arrays (n,) of `time` [s] and the columns, over the rows in which all were sampled (NaN
        counts as a sample)."""
        self.check_columns(*columns)
        samples = self.samples[["time", *columns]]
        if any(column.null_count() for column in samples.iter_columns()):
            samples = samples.drop_nulls()
        return [column.to_numpy() for column in samples.iter_columns()]

    def signals(self, *columns: str) -> tuple[Array, ...]:
        """Arrays as `arrays`. Raises InputError: a column has a NaN."""
        time, *values = self.arrays(*columns)
        for column, signal in zip(columns, values, strict=True):
            missing = np.isnan(signal).sum()
            if missing:
                raise InputError(
                    f"trial {self.name}: column '{column}' is NaN in {missing} of {len(time)}"
                    " samples",
                    "repair the log or exclude the trial in the sheet",
                )
        return time, *values

    def check_columns(self, *columns: str) -> None:
        """Refuse a column that the trial does not have; the message names a similar one."""
        for column in columns:
            if column not in self.samples:
                raise InputError(
                    f"trial {self.name}: no column '{column}'",
                    "map the channel in the source file (it has"
                    f" {listing(self.columns)}){nearest(column, self.columns)}",
                )


def check_time(name: str, time: Array) -> None:
    """Refuse stamps that no log can have.

    Equal stamps pass: a logger may print few decimals or write a row twice. The time base handles
    them.

    Parameters
    ----------
    name : str
        What the stamps belong to, for the message.
    time : Array
        (n,) [s].

    Raises
    ------
    InputError
        A stamp is not finite, later than any log, or earlier than the one before.
    """
    check_finite(f"{name}: time", time)
    goes_back = np.diff(time) < 0
    if goes_back.any():
        row = np.argmax(goes_back)
        raise InputError(
            f"{name}: time goes from {time[row]:.6f} s to {time[row + 1]:.6f} s at row {row + 1}",
            "write `each: interval` if each is the time since the row before; delete rows that"
            " stand twice, sort rows that changed places by time, and where the recorder's clock"
            " was set back, cut the log or take another time source in the source file",
        )


def write_trial(trial: Trial, path: Path) -> None:
    """Write the trial completely or not at all. Name and provenance (JSON) are in the file's
    metadata."""
    provenance = json.dumps({**trial.provenance, "clocks": trial.clocks}, sort_keys=True)
    metadata = {
        NAME_KEY: trial.name,
        PROVENANCE_KEY: provenance,
        SCHEMA_KEY: str(SCHEMA),
    }
    with atomic_path(path) as temporary:
        trial.samples.write_parquet(temporary, compression="lz4", metadata=metadata)


def write_empty(columns: Sequence[str], path: Path, metadata: dict[str, str]) -> None:
    """Write a file without rows in place of a trial; its metadata say why."""
    empty = pl.DataFrame(schema=dict.fromkeys(columns, pl.Float64))
    with atomic_path(path) as temporary:
        empty.write_parquet(temporary, metadata=metadata)


def read_trial(path: Path | str) -> Trial:
    """Read the Parquet file of a trial.

    Parameters
    ----------
    path : Path or str
        File of `osl-analysis ingest`, or of a campaign (`results/trials/NAME.parquet`).

    Returns
    -------
    Trial
        `trial.samples` is a polars data frame in SI units with a row per time stamp,
        `trial.provenance` says where each column comes from.

    Raises
    ------
    InputError
        The file is missing, is not Parquet that ingest wrote, or is of a newer release.

    Examples
    --------
    >>> osl.read_trial("results/trials/belt_01.parquet").name
    'belt_01'
    """
    path = Path(path)
    name, provenance = metadata_of(path)
    with refusing_other_files(path):
        samples = pl.read_parquet(path, glob=False)
    clocks = provenance.pop("clocks", {})
    return Trial(name, samples, provenance, clocks)


def metadata_of(path: Path) -> tuple[str, dict[str, Any]]:
    """Read name and provenance of a trial without its samples; raises as `read_trial`."""
    check_analysed(path)
    if not path.is_file():
        raise InputError(f"{path}: no such trial", "ingest it first (osl-analysis ingest)")
    with refusing_other_files(path):
        metadata = pl.read_parquet_metadata(path)
        if not {NAME_KEY, PROVENANCE_KEY} <= metadata.keys():
            raise ValueError("Parquet without provenance")
        provenance = json.loads(metadata[PROVENANCE_KEY])
    check_schema(int(metadata.get(SCHEMA_KEY, SCHEMA)), path)  # crossings state none
    return metadata[NAME_KEY], provenance


@contextmanager
def refusing_other_files(path: Path) -> Iterator[None]:
    """Turn Polars' error about a file that is not Parquet into an InputError of one line."""
    try:
        yield
    except (pl.exceptions.PolarsError, pl.exceptions.PanicException, OSError, ValueError) as error:
        reason = str(error).splitlines()[0]
        raise InputError(
            f"{path}: not what `ingest` wrote ({reason})",
            "ingest it again, fit a raw recording with its `--source`, or make a campaign:"
            f" `osl-analysis init FOLDER --from {path.parent}`",
        ) from error
