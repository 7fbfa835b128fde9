# SPDX-License-Identifier: Apache-2.0
"""What a source file may say, whatever the format: channels, conversions, clocks, markers.

A source file describes the recordings of one recorder. Each format has a model with the keys of
its own, a subclass of one of these, so that a key of another format is refused by name. Here are
settings and their checks alone: `ingest` reads recordings by them.
"""

import re
from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path
from typing import Annotated, ClassVar, Literal, Self

import numpy as np
from numpy.typing import NDArray
from pydantic import (
    AfterValidator,
    BeforeValidator,
    Field,
    PositiveFloat,
    PrivateAttr,
    field_validator,
    model_validator,
)

from osl_analysis.base.errors import InputError, nearest
from osl_analysis.base.trial import AXES, COLUMNS, unit_of
from osl_analysis.base.units import (
    ForceUnit,
    LengthUnit,
    MomentUnit,
    TimeUnit,
    quantity,
    si_factor,
)
from osl_analysis.base.yaml_settings import (
    Settings,
    check_distinct,
    check_rising,
    field_line,
    from_fraction,
    misplaced,
)

SampleShare = Annotated[float, Field(ge=0, le=1)]
LEVEL_UNIT = "V"  # of the columns that may be read from truth values: `sync` and `trigger`
Name = Annotated[str, Field(min_length=1)]
MOST_DAMAGED = 0.1  # share of the rows that may be left out as damaged; of more, the log is no log


ColumnName = Annotated[Name, Field(coerce_numbers_to_str=True)]
"""A column's name, or its number counted from 1."""
Axis = Literal["x", "y", "z", "-x", "-y", "-z"]
Axes = tuple[Axis, Axis, Axis]
Corner = tuple[float, float, float]


def stated_between(low: float, high: float, unit: str) -> AfterValidator:
    """The check that a number with its unit, as `2 ms`, lies between bounds [unit]."""

    def checked(text: str) -> str:
        value = quantity(text, unit)
        if not low <= value <= high:
            advice_on_delay = "the other channels are late, state it there, without a sign, or "
            raise ValueError(
                f"{advice_on_delay if low == 0 > value else ''}write {low:g} to {high:g} {unit},"
                " and check sign and unit"
            )
        return text

    return AfterValidator(checked)


class SensorFilter(Settings):
    """The low-pass of a sensor or its amplifier, an analogue Butterworth that ran once while
    recording."""

    # Cut-off with its unit, as `100 Hz`. A lower one would hide the motion.
    cutoff: Annotated[str, stated_between(0.5, 1e6, "Hz")]
    order: int = Field(default=1, ge=1, le=8)  # Order.


class Conversion(Settings):
    """Conversion of recorded numbers to SI units, sign * scale * factor * (raw + offset), and facts
    on the sensor."""

    # Age of a sample at its stamp, as `2 ms`; it is subtracted from the channel's stamps. With a
    # longer one, K, B and I would be fitted to another motion.
    delay: Annotated[str, stated_between(0, 0.2, "s")] | None = None
    # The sensor's own low-pass, through which analyses put all other signals.
    low_pass: SensorFilter | None = None
    # Smallest step of the recorded values with its unit, as `0.02 deg`.
    resolution: str | None = None
    # Both ends of the sensor's range, before `sign` and `offset`, as `[-60 N*m, 60 N*m]`.
    range: tuple[str, str] | None = None
    # Unit of the numbers, as laboratories spell it. Without it, the one that the file states.
    unit: str | None = None
    sign: Literal[1, -1] = 1  # -1 if the recorder has the opposite direction as positive.
    # Units per count, a number or products and quotients of numbers: 1/16384 with the unit rev for
    # an encoder of 14 bits.
    scale: Annotated[PositiveFloat, BeforeValidator(from_fraction)] = 1.0
    # Offset that is added to the raw numbers before the scale, in the raw unit.
    offset: float = 0.0

    def ends(self, si_unit: str) -> tuple[float, ...]:
        """Both ends of the stated range [si_unit]. Raises ValueError: the range is empty."""
        return check_rising(tuple(quantity(text, si_unit) for text in self.range or ()))

    def step(self, si_unit: str) -> float:
        """Smallest step of the recorded values [si_unit]. Raises InputError: it is not positive."""
        step = quantity(self.resolution or "", si_unit)
        if step <= 0:
            raise InputError(
                f"a resolution of {self.resolution} is not positive",
                "write a positive one, or remove it",
            )
        return step


class Addressed(Settings):
    """The keys that name one channel of a recording."""

    # The key that names it: `column`, `field`, `channel`, `variable` or `component`.
    ADDRESS: ClassVar[str] = ""
    BESIDE: ClassVar[tuple[str, ...]] = ()  # Other keys that it takes to find it.

    @property
    def name(self) -> str:
        """The channel, as the source file writes it; empty if it names none."""
        return getattr(self, self.ADDRESS) or ""

    @property
    def address(self) -> dict[str, str]:
        """The keys and values that name the channel, the most general first."""
        return {key: getattr(self, key) for key in (*self.BESIDE, self.ADDRESS)}

    @property
    def title(self) -> str:
        """The channel, for messages."""
        return f"{self.ADDRESS} '{self.name}'"


class Channel(Conversion, Addressed):
    """The recorded channel of a canonical column, and its conversion."""


# in the name or unit of a torque that a program computed, as `effort [A]` and `torque_from_current`
COMPUTED = re.compile(
    r"(?i)effort|current|strom|courant|corri?ente|(?<![a-z])i_?q(?![a-z])|(?<![a-z])est(?![a-z])"
    r"|estim|gesch(ä|ae)tzt|calc|berechn|comput"
    r"|observer|model|comm?and|(?<![a-z])cmd|desired|(?<![a-z])soll|\[m?A\]"
)


class LogChannel(Channel):
    """A channel of a log."""

    # Whether a sensor measured it, where a torque's name says otherwise.
    measured: bool | None = None

    # Where the device counts its samples, which tells the missing ones.
    counter: ColumnName | None = None
    # After how much the raw numbers begin anew: 360, or 65536 for 16 bits.
    wraps_at: PositiveFloat | None = None


class MessageChannel(LogChannel):
    """A number in the messages of one topic."""

    ADDRESS = "field"
    BESIDE = ("topic",)
    topic: Name  # Name of the topic.
    field: Name
    """Dotted path of the number, with an index or a name where it passes an array:
    `wrench.force.x`, `position[0]`, `position[name=ankle]`; in JSON a name with a dot in it in
    quotes, `functions["loadcell.mz"]`."""
    unit: str  # Unit of the numbers, as laboratories spell it.


class ColumnChannel(LogChannel):
    """A column of a table."""

    ADDRESS = "column"
    time: "ColumnTime | None" = None  # Its own time, where it is not that of the others.
    column: ColumnName
    """Name in the header, with or without its unit (`torque` finds `torque [Nm]`); a pattern in
    which `*` stands for any text, which must fit one column (`"*.output_position"`); or the
    column's number, counted from 1."""


class Time(Addressed):
    """Where the time of a row or message comes from: the recording has it, or the rate at which
    rows were written."""

    IN_FILE: ClassVar[bool] = False  # Whether the format itself tells when a sample was taken.

    stamps: Literal["auto", "exact", "even"] = "auto"
    """How the stamps are taken (docs/time_base.md). `exact`: each sample was taken at its stamp.
    `even`: the device samples evenly, and only the stamps scatter. `auto`: stamps and signals
    decide."""


class MessageTime(Time):
    """The time of messages."""

    ADDRESS = "field"
    # `header`: the stamp in the message. `log`: when the recorder logged it.
    source: Literal["header", "log"]
    field: str = "header.stamp"  # Path of a stamp of seconds and nanoseconds.


class RowTime(Time):
    """The time of a table of rows."""

    # Unit of the numbers that are time. Without it, the file's unit is used.
    unit: TimeUnit | None = None
    rate: PositiveFloat | None = None  # Rows per second [Hz], for a file without time.
    # What the numbers are: times, or the `interval` since the row before.
    each: Literal["stamp", "interval"] = "stamp"
    # By how many parts per million this clock runs fast, such as a calibration tells.
    drift_ppm: Annotated[float, Field(ge=-1000, le=1000)] = 0.0
    repeated: Literal["keep", "drop"] = "keep"
    """Rows whose stamp is that of the row before. `keep`: they are samples whose stamps were
    rounded. `drop`: the recorder read a device faster than it sampled; only the first row of each
    stamp is used."""

    @model_validator(mode="after")
    def _one(self) -> Self:
        has_both = self.name and self.rate and self.unit  # without a unit it counts samples
        if has_both or not (self.name or self.rate or self.IN_FILE):
            raise ValueError(
                f"state either the {self.ADDRESS} that holds time or the rate of the rows [Hz]"
            )
        return self


class ColumnTime(RowTime):
    """A column of time, or the rate of the rows."""

    ADDRESS = "column"
    # Name of the column that holds time, or beside `rate` counts the samples.
    column: ColumnName | None = None


class ExportedPlate(Settings):
    """A force plate that was exported as numbers. The file does not say where it lies."""

    # Of the surface in the file's axes, in mm for Nexus and in m for OpenSim.
    corners: tuple[Corner, Corner, Corner, Corner]
    # -1 if the file has the force on the plate instead of the force on the foot.
    sign: Literal[1, -1] = 1


class PlateUnits(Settings):
    """Units of the plates' channels where the file's ANALOG:UNITS are absent or wrong."""

    force: ForceUnit  # Unit of the force channels.
    moment: MomentUnit  # Unit of the moment channels.
    # Unit of the centre of pressure of a type 1 plate; null: the file's.
    length: LengthUnit | None = None


class ModelOutput(Conversion):
    """One component of a model output, such as a joint moment of Plug-in Gait, that is stored like
    a marker."""

    label: Name  # Label of the output in the file.
    component: Literal["x", "y", "z"]  # Component of the output.
    # In which the software computes; the file may misstate it: moments of Plug-in Gait are N*mm/kg.
    unit: str


class Source(Settings):
    """A source file: what the files of a recorder hold. A recorder writes a log, with its own
    clock, or a capture."""

    format: str  # Format of the file.
    description: str = ""  # For readers; nothing is computed from it.
    _path: Path | None = PrivateAttr(default=None)

    @field_validator("channels", "analogs", "outputs", check_fields=False)
    @classmethod
    def _canonical(cls, channels: Mapping[str, Conversion]) -> Mapping[str, Conversion]:
        """Refuse columns that are not in the nomenclature, units that cannot become theirs, and a
        channel of two columns, unless they are levels."""
        column_of: dict[tuple[str, ...], str] = {}
        _, *names = COLUMNS
        for column, channel in channels.items():
            if column == "time":
                raise misplaced("time is not a channel; state its source under `time`", column)
            try:
                si_unit = unit_of(column)
            except KeyError:
                advice = f"the columns are {', '.join(names)}, signal_NAME{nearest(column, names)}"
                raise misplaced(f"'{column}' is not a canonical column; {advice}", column) from None
            checks: dict[str, Callable[[str], object]] = {
                "unit": partial(si_factor, channel.unit or ""),
                "resolution": channel.step,
                "range": channel.ends,
            }
            for key, check in checks.items():
                value = getattr(channel, key)
                try:
                    if value is not None:
                        check(si_unit)
                except ValueError as error:
                    raise misplaced(f"{value!r} is not allowed: {error}", column, key) from None
            if isinstance(channel, Channel) and si_unit != LEVEL_UNIT:
                earlier_column = column_of.setdefault(tuple(channel.address.values()), column)
                if earlier_column != column:
                    raise misplaced(
                        f"{channel.title} is {earlier_column} already; correct one",
                        column,
                        channel.ADDRESS,
                    )
        return channels

    def written_in(self, path: Path) -> None:
        """Note the file that these settings come from, for messages."""
        self._path = path

    def place(self, *keys: str) -> str:
        """A field, for messages: its keys, and the file and line in which they stand."""
        where = f"`{'.'.join(keys)}` in {self._path or 'the source file'}"
        line = field_line(self._path, keys) if self._path else None
        return f"{where}, line {line}" if line else where

    def for_part(self, part: str) -> Self:
        """The source file for one part of a log that holds several trials, as the sample sheet
        names it."""
        if part:
            raise InputError(
                f"log_part '{part}': a log in {self.format} holds one trial", "leave log_part empty"
            )
        return self


class InAxes(Source):
    """The source file of files with positions."""

    # The file's axes that point forward, left and up: `[x, -z, y]` where y is up.
    axes: Axes = ("x", "y", "z")

    @property
    def rotation(self) -> NDArray[np.float64]:
        """Rotation (3, 3) from the file's axes to ours: our coordinates are `rotation @ (x, y,
        z)`."""
        rotation = np.zeros((3, 3))
        for row, name in enumerate(self.axes):
            rotation[row, AXES.index(name[-1])] = -1.0 if name.startswith("-") else 1.0
        return rotation

    @model_validator(mode="after")
    def _right_handed(self) -> Self:
        if np.linalg.det(self.rotation) <= 0:
            raise misplaced(
                f"{list(self.axes)} is not allowed: forward, left and up must be three different"
                " axes of a right-handed laboratory",
                "axes",
            )
        return self


class LogSource(Source):
    """The source file of a log."""

    clock: Literal["master", "sync", "common", "start"] = "master"
    """How the log's clock is aligned to motion capture's, or that of a second log to the first.
    `master`: not; the log is the only file, or the first. `sync`: by the edges of the column
    `sync`. `common`: both count from one time. `start`: both begin at one instant."""
    # The recorded channel of each canonical column.
    channels: Annotated[Mapping[str, LogChannel], Field(min_length=1)]
    time: Time  # Where the time of a row or message comes from.
    # Largest share of a channel's numbers, and of the rows, that may be missing.
    most_missing: SampleShare = 0.01
    damaged: Literal["refuse", "skip"] = "refuse"
    """What is none of a sensor, or no row. `refuse`: the file is refused, or a check tells it.
    `skip`: it is left out, at most a tenth of the rows: lines with another number of cells, without
    a time or with one that goes back, cells that are no numbers, and values that leap off their
    neighbours and back or recur in such leaps, as 8388607."""

    @property
    def allowed_missing(self) -> float:
        """The share of numbers and rows that may be missing."""
        return max(self.most_missing, MOST_DAMAGED) if self.damaged == "skip" else self.most_missing


class MessageSource(LogSource):
    """The source file of messages by topic."""

    channels: Annotated[Mapping[str, MessageChannel], Field(min_length=1)]
    time: MessageTime
    # Largest share of a topic's messages that may be lost, or the log is refused.
    largest_loss: SampleShare = 0.01


class TableSource(LogSource):
    """The source file of a log that is a table of rows."""

    time: RowTime


class MarkerSource(InAxes):
    """The source file of a motion capture."""

    markers: Literal["all"] | Annotated[tuple[str, ...], AfterValidator(check_distinct)] = "all"
    """The markers to read: all (every labelled point except model outputs), or a list of labels,
    which may be empty."""


class LaboratorySource(MarkerSource):
    """The source file of a motion capture with devices."""

    # The recorded channel of each canonical column.
    analogs: Mapping[str, Channel] = Field(default={})
    # The model output of each canonical column.
    outputs: Mapping[str, ModelOutput] = Field(default={})
