"""The models of source files. A source file describes the recordings of one recorder. Each format
has a class with its own keys, so that a key of another format is refused by name. What is read by a
source file is a `Recording`."""

import math
import re
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from itertools import combinations, pairwise, product
from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal, Self

import numpy as np
import polars as pl
from numpy.typing import NDArray
from pydantic import (
    AfterValidator,
    BeforeValidator,
    Field,
    PositiveFloat,
    PositiveInt,
    PrivateAttr,
    field_validator,
    model_validator,
)

from osl_analysis.errors import InputError, nearest
from osl_analysis.old_formats.csv_table import MISSING
from osl_analysis.old_formats.mat import checked_address
from osl_analysis.old_formats.table import Ledger, noise_in
from osl_analysis.units import (
    ForceUnit,
    LengthUnit,
    MomentUnit,
    TimeUnit,
    Unit,
    quantity,
    si_factor,
)
from osl_analysis.signals import run_edges
from osl_analysis.trial import AXES, COLUMNS, Array, median, unit_of
from osl_analysis.yaml_settings import Settings, distinct, field_line, misplaced, one_of

SampleShare = Annotated[float, Field(ge=0, le=1)]
# [s] of sensor, amplifier and bus; beyond it, K, B and I would be fitted to another motion
LONGEST_DELAY = 0.2
LEVEL_UNIT = "V"  # unit of the columns that may be read from truth values: `sync` and `trigger`
# a scale or an offset; a larger number is a typing error
NoSlip = Annotated[float, Field(ge=-1e12, le=1e12)]
Name = Annotated[str, Field(min_length=1)]


def column_name(given: Any) -> Any:
    if type(given) is int and given < 1:
        raise ValueError(
            "columns are counted from 1; write its number, or a name of digits in quotes"
        )
    return str(given) if type(given) is int else given


ColumnName = Annotated[Name, BeforeValidator(column_name)]
AddressText = Annotated[str, AfterValidator(checked_address)]
Axis = Literal["x", "y", "z", "-x", "-y", "-z"]
Axes = tuple[Axis, Axis, Axis]
Corner = tuple[float, float, float]


class SensorFilter(Settings):
    """The low-pass of a sensor or its amplifier, an analogue Butterworth that ran once while
    recording."""

    cutoff: str  # Cut-off with its unit, as `100 Hz`.
    order: int = Field(default=1, ge=1, le=8)  # Order.

    @field_validator("cutoff")
    @classmethod
    def _above_the_motion(cls, value: str) -> str:
        if quantity(value, "Hz") < 0.5:
            raise ValueError(
                "a cut-off below 0.5 Hz would hide the motion; correct its unit, as `100 Hz`"
            )
        return value


class Conversion(Settings):
    """Conversion of recorded numbers to SI units, sign * scale * factor * (raw + offset), and facts
    on the sensor."""

    SENSOR: ClassVar[set[str]] = {"delay", "low_pass", "resolution", "bits", "range"}

    # Age of a sample at its stamp, as `2 ms`; it is subtracted from the channel's stamps.
    delay: str | None = None
    # The sensor's own low-pass, through which analyses put all other signals.
    low_pass: SensorFilter | None = None
    # Smallest step of the recorded values with its unit, as `0.02 deg`.
    resolution: str | None = None
    # Bits of an encoder per revolution, in place of `resolution`.
    bits: int | None = Field(default=None, ge=4, le=32)
    range: str | tuple[str, str] | None = None
    """Range of the sensor, before `sign` and `offset`: `60 N*m` for +-60 N*m, or both ends, as `[0
    deg, 300 deg]`."""
    # Unit of the numbers, as laboratories spell it. Without it, the one that the file states.
    unit: Unit | None = None
    sign: Literal[1, -1] = 1  # -1 if the recorder has the opposite direction as positive.
    scale: NoSlip = 1.0  # Units per count: 1 / 16384 with the unit rev for an encoder of 14 bits.
    # Offset that is added to the raw numbers before the scale, in the raw unit.
    offset: NoSlip = 0.0

    @field_validator("delay", "scale")
    @classmethod
    def _possible(cls, value: Any) -> Any:
        if isinstance(value, str) and not 0 <= quantity(value, "s") <= LONGEST_DELAY:
            said = f"a delay is the age of a sample, from 0 to {LONGEST_DELAY:g} s"
            raise ValueError(f"{said}; correct its sign or its unit")
        if value == 0:
            raise ValueError("a scale of zero makes every number zero; write the size of one count")
        return value

    def to_si(self, raw: Array, si_unit: str, unit_of_file: str = "") -> Array:
        """Recorded numbers, of any shape, in the SI unit. `unit_of_file` counts if the source file
        states no unit."""
        factor = si_factor(unit_of_file if self.unit is None else self.unit, si_unit)
        with np.errstate(over="ignore"):  # `check_sizes` refuses infinite values later
            return np.asarray(self.sign * self.scale * factor * (raw + self.offset))

    def origin(self, column: str, unit_of_file: str = "") -> dict[str, Any]:
        """Source and conversion of a canonical column, and the stated facts on its sensor in SI
        units, for the trial's provenance. `range` is that of the column, after `sign` and
        `offset`."""
        unit, si_unit = unit_of_file if self.unit is None else self.unit, unit_of(column)
        found = {
            **self.model_dump(exclude=self.SENSOR),
            "unit": unit,
            "factor": si_factor(unit, si_unit),
        }
        found["si_unit"] = si_unit
        if self.delay is not None:
            found["delay"] = quantity(self.delay, "s")
        if self.low_pass is not None:
            cutoff_hz = quantity(self.low_pass.cutoff, "Hz")
            found["low_pass"] = {
                "cutoff_hz": cutoff_hz,
                **self.low_pass.model_dump(exclude={"cutoff"}),
            }
        if self.resolution is not None or self.bits is not None:
            found["resolution"] = self.step(si_unit)
        if self.range is not None:
            offset = self.scale * found["factor"] * self.offset
            found["range"] = sorted(self.sign * (end + offset) for end in self.ends(si_unit))
        return found

    def ends(self, si_unit: str) -> tuple[float, float]:
        """Both ends of the stated range [si_unit]. Raises InputError: the range is empty."""
        assert self.range is not None
        texts = (self.range,) if isinstance(self.range, str) else self.range
        ends = [quantity(text, si_unit) for text in texts]
        low, high = (-ends[0], ends[0]) if len(ends) == 1 else ends
        if low >= high:
            said = f"a range from {low:g} to {high:g} {si_unit} is empty"
            raise InputError(f"{said}; write the lower end first, or one number")
        return low, high

    def step(self, si_unit: str) -> float:
        """Smallest step of the recorded values [si_unit]. Raises InputError: the statement
        contradicts itself."""
        if self.resolution is not None and self.bits is not None:
            raise InputError("state `resolution` or `bits`, not both")
        if self.resolution is None and si_unit != "rad":
            raise InputError(
                "`bits` are those of an encoder per revolution; state `resolution` with its unit"
                " instead"
            )
        step = (
            2 * np.pi / 2 ** (self.bits or 0)
            if self.resolution is None
            else quantity(self.resolution, si_unit)
        )
        if step <= 0:
            raise InputError(
                f"a resolution of {self.resolution} is not positive; write a positive one, or"
                " remove it"
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
    def title(self) -> str:
        """The channel, for messages."""
        return f"{self.ADDRESS} '{self.name}'"


class Channel(Conversion, Addressed):
    """The recorded channel of a canonical column, and its conversion."""

    @property
    def address(self) -> tuple[str, ...]:
        """The full address of the channel. Only one column may be read from it."""
        return self.name, *(getattr(self, key) for key in self.BESIDE)


class LogChannel(Channel):
    """A channel of a log."""

    # Where the device counts its samples, which tells the missing ones.
    counter: ColumnName | None = None
    # After how much the raw numbers begin anew: 360, or 65536 for 16 bits.
    wraps_at: PositiveFloat | None = None


class FieldChannel(LogChannel):
    ADDRESS = "field"
    field: Name
    """Dotted path of the number, with an index or a name where it passes an array:
    `wrench.force.x`, `position[0]`, `position[name=ankle]`; in JSON a name with a dot in it in
    quotes, `functions["loadcell.mz"]`."""
    unit: Unit  # Unit of the numbers, as laboratories spell it.


class MessageChannel(FieldChannel):
    BESIDE = ("topic",)
    topic: Name  # Name of the topic.


class ColumnChannel(LogChannel):
    ADDRESS = "column"
    column: ColumnName
    """Name in the header, with or without its unit (`torque` finds `torque [Nm]`); a pattern in
    which `*` stands for any text, which must fit one column (`"*.output_position"`); or the
    column's number, counted from 1."""


class OpenSimChannel(ColumnChannel):
    unit: Unit  # Unit of the numbers, as laboratories spell it.


class VariableChannel(LogChannel):
    ADDRESS = "variable"
    variable: AddressText
    """Its address in MATLAB's notation: `torque`, `Test.run(2).torque`, `data(:,3)`,
    `runs{2}.torque`. It is within `log_part`, unless it begins with `/`."""
    # Where the device counts its samples, which tells the missing ones.
    counter: AddressText | None = None
    unit: Unit  # Unit of the numbers, as laboratories spell it.


class TdmsChannel(LogChannel):
    ADDRESS = "channel"
    channel: Name  # Group and name, as `Measured Data/Torque`, or the name where one group has it.


class C3dChannel(Channel):
    ADDRESS = "channel"
    channel: Name  # Its label.


class DeviceChannel(Channel):
    ADDRESS, BESIDE = "device", ("component",)
    device: Name  # Name of the device's output, such as `EMG2000 - Voltage`.
    component: Name  # Name of the column under it.


class Time(Addressed):
    """Where the time of a row or message comes from: the recording has it, or the rate at which
    rows were written."""

    IN_FILE: ClassVar[bool] = False  # Whether the format itself tells when a sample was taken.

    stamps: Literal["auto", "exact", "even"] = "auto"
    """How the stamps are taken (docs/time_base.md). `exact`: each sample was taken at its stamp.
    `even`: the device samples evenly, and only the stamps scatter. `auto`: stamps and signals
    decide."""


class MessageTime(Time):
    ADDRESS = "field"
    # `header`: the stamp in the message. `log`: when the recorder logged it.
    source: Literal["header", "log"]
    field: str = "header.stamp"  # Path of a stamp of seconds and nanoseconds.


class RowTime(Time):
    """The time of a table of rows."""

    COUNTS: ClassVar[bool] = False  # Whether it may count samples.

    # Unit of the numbers that are time. Without it, the file's unit is used.
    unit: TimeUnit | None = None
    rate: PositiveFloat | None = None  # Rows per second [Hz], for a file without time.
    repeated: Literal["keep", "drop"] = "keep"
    """Rows whose stamp is that of the row before. `keep`: they are samples whose stamps were
    rounded. `drop`: the recorder read a device faster than it sampled; only the first row of each
    stamp is used."""

    @model_validator(mode="after")
    def _one(self) -> Self:
        # samples at the rate
        counts, rated = self.COUNTS and self.unit is None, self.rate is not None
        if (self.name and rated and not counts) or not (self.name or rated or self.IN_FILE):
            raise ValueError(
                f"state either the {self.ADDRESS} that holds time or the rate of the rows [Hz]"
            )
        if self.unit is not None and not self.name and self.ADDRESS != "column":
            raise ValueError(
                f"`unit` is that of the {self.ADDRESS} of time; name the {self.ADDRESS}, or"
                " remove it"
            )
        return self


class ColumnTime(RowTime):
    ADDRESS, COUNTS = "column", True
    # Name of the column that holds time, or beside `rate` counts the samples.
    column: ColumnName | None = None


class OpenSimTime(ColumnTime):
    column: ColumnName | None = "time"  # Name of the column that holds time.
    unit: TimeUnit | None = "s"  # Unit of the numbers that are time.


class FieldTime(RowTime):
    ADDRESS = "field"
    # Path of the number that is time, or of a stamp of seconds and nanoseconds (no `unit`).
    field: str | None = None


class VariableTime(RowTime):
    ADDRESS = "variable"
    # Address of the variable that holds time, as in `channels`.
    variable: AddressText | None = None


class TdmsTime(RowTime):
    ADDRESS, IN_FILE = "channel", True
    # That of time; LabVIEW's stamps need no unit. Without it: the channels' own timing.
    channel: str | None = None


class ExportedPlate(Settings):
    """A force plate that was exported as numbers. The file does not say where it lies."""

    # -1 if the file has the force on the plate instead of the force on the foot.
    sign: Literal[1, -1] = 1


class OpenSimPlate(ExportedPlate):
    force: str  # Beginning of the names of the force's columns [N]: `R_ground_force_v`.
    # Beginning of the names of the columns of the point of application [m]: `R_ground_force_p`.
    point: str
    # Beginning of the names of the columns of the moment about this point [N*m]:
    # `R_ground_torque_`.
    moment: str
    corners: tuple[Corner, Corner, Corner, Corner]  # Of the surface in the file's axes [m].
    # Whose force it is, where the file has one per foot, not per plate.
    foot: Literal["left", "right"] | None = None


class NexusPlate(ExportedPlate):
    device: str  # The plate's outputs are called `<device> - Force` and `<device> - Moment`.
    corners: tuple[Corner, Corner, Corner, Corner]  # Of the surface in the file's axes [mm].
    # About which the file takes the moment [mm]; without it the corners' centre.
    moment_about: Corner | None = None


class PlateUnits(Settings):
    """Units of the plates' channels where the file's ANALOG:UNITS are absent or wrong."""

    force: ForceUnit  # Unit of the force channels.
    moment: MomentUnit  # Unit of the moment channels.
    # Unit of the centre of pressure of a type 1 plate; null: the file's.
    length: LengthUnit | None = None


class SharedAngle(Settings):
    """An angle recorded by both log and motion capture. It aligns their clocks if there are no sync
    edges."""

    column: Annotated[str, AfterValidator(partial(one_of, COLUMNS, "canonical column of a log"))]
    """Column of the log with the angle. Its scale, sign and offset do not matter."""
    markers: Annotated[tuple[str, str, str], AfterValidator(distinct)]
    """Three markers of motion capture. The angle is at the second marker."""


class ModelOutput(Conversion):
    """One component of a model output, such as a joint moment of Plug-in Gait, that is stored like
    a marker."""

    label: Name  # Label of the output in the file.
    component: Literal["x", "y", "z"]  # Component of the output.
    # In which the software computes; the file may misstate it: moments of Plug-in Gait are N*mm/kg.
    unit: Unit


def all_none_or_list(value: Any) -> Any:
    """A choice among the parts of a file; `none` becomes the empty list."""
    if value not in ("all", "none") and not isinstance(value, list | tuple):
        raise ValueError("write all, none or a list")
    return () if value == "none" else value if value == "all" else distinct(tuple(value))


def canonical(channels: Mapping[str, Conversion]) -> None:
    """Refuse channels that are not in the nomenclature, and units that cannot become the
    column's."""
    names = [name for name in COLUMNS if name != "time"]
    for column, channel in channels.items():
        try:
            si_unit = unit_of(column)
        except KeyError:
            advice = f"the columns are {', '.join(names)}, signal_NAME{nearest(column, names)}"
            raise misplaced(f"'{column}' is not a canonical column; {advice}", column) from None
        if column == "time":
            raise misplaced("time is not a channel; state its source under `time`", column)
        unit, step = partial(si_factor, channel.unit or ""), channel.step
        for key, check in (
            ("unit", unit),
            ("resolution", step),
            ("bits", step),
            ("range", channel.ends),
        ):
            try:
                if getattr(channel, key) is not None:
                    check(si_unit)
            except ValueError as error:
                raise misplaced(
                    f"{getattr(channel, key)!r} is not allowed: {error}", column, key
                ) from None


def each_once(key: str, channels: Mapping[str, Channel], named: dict[tuple[str, ...], str]) -> None:
    """Refuse a channel that is mapped to two columns, unless they are levels. `named`: column by
    channel, so far."""
    for column, channel in channels.items():
        if (
            unit_of(column) != LEVEL_UNIT
            and (other := named.setdefault(channel.address, column)) != column
        ):
            raise misplaced(
                f"{channel.title} is {other} already; correct one", key, column, channel.ADDRESS
            )


class Source(Settings):
    """A source file: what the files of a recorder hold. A recorder writes a log, with its own
    clock, or a capture."""

    format: str  # Format of the file.
    description: str = ""  # For readers; nothing is computed from it.
    _path: Path | None = PrivateAttr(default=None)

    @field_validator("channels", "analogs", "outputs", check_fields=False)
    @classmethod
    def _canonical(cls, channels: Mapping[str, Conversion]) -> Mapping[str, Conversion]:
        canonical(channels)
        return channels

    def written_in(self, path: Path) -> None:
        self._path = path

    def place(self, *keys: str) -> str:
        """A field, for messages: its keys, and the file and line in which they stand."""
        if self._path is None:
            return f"`{'.'.join(keys)}` in the source file"
        line = field_line(self._path, keys)
        return f"`{'.'.join(keys)}` in {self._path}{f', line {line}' if line else ''}"

    def of_part(self, part: str) -> Self:
        """The source file for one part of a log that holds several trials, as the sample sheet
        names it."""
        if part:
            said = (
                f"log_part '{part}': a log in {self.format} holds one trial; leave log_part empty"
            )
            raise InputError(said)
        return self


class InAxes(Source):
    """The source file of files with positions."""

    # The file's axes that point forward, left and up: `[x, -z, y]` where y is up.
    axes: Axes = ("x", "y", "z")

    @property
    def rotation(self) -> Array:
        """Rotation (3, 3) from the file's axes to ours: our coordinates are `rotation @ (x, y,
        z)`."""
        signs = [-1.0 if name[0] == "-" else 1.0 for name in self.axes]
        return np.array(
            [
                [s * (name[-1] == axis) for axis in AXES]
                for s, name in zip(signs, self.axes, strict=True)
            ]
        )

    @model_validator(mode="after")
    def _right_handed(self) -> Self:
        if round(float(np.linalg.det(self.rotation))) != 1:
            said = "forward, left and up must be three different axes of a right-handed laboratory"
            raise misplaced(f"{list(self.axes)} is not allowed: {said}", "axes")
        return self


class LogSource(Source):
    """The source file of a log."""

    clock: Literal["master", "sync", "shared"] = "master"
    """How the log's clock is aligned to motion capture's. `master`: not; the log is the only file.
    `sync`: by the edges of the column `sync`. `shared`: by the signal that motion capture's source
    file names under `shared`."""
    # The recorded channel of each canonical column.
    channels: Annotated[Mapping[str, LogChannel], Field(min_length=1)]
    time: Time  # Where the time of a row or message comes from.
    # Largest share of a channel's numbers, and of the rows, that may be missing.
    most_missing: SampleShare = 0.01

    @model_validator(mode="after")
    def _aligned(self) -> Self:
        if self.clock == "shared" and "sync" in self.channels:
            said = (
                "a log with the mapped column sync is aligned by its edges; write clock: sync, or"
                " remove sync"
            )
            raise misplaced(said, "clock")
        if self.clock == "sync" and "sync" not in self.channels:
            raise misplaced(
                "sync needs the column sync under channels; map it, or write clock: master", "clock"
            )
        each_once("channels", self.channels, {(self.time.name,): "time"} if self.time.name else {})
        return self


class MessageSource(LogSource):
    OF = " of messages"
    channels: Annotated[Mapping[str, MessageChannel], Field(min_length=1)]
    time: MessageTime
    # Largest share of a topic's messages that may be lost, or the log is refused.
    largest_loss: SampleShare = 0.01


class TableSource(LogSource):
    """The source file of a log that is a table of rows."""

    time: RowTime


class SheetSource(TableSource):
    """The source file of a table of cells with a header, from any program."""

    OF = " of format table"
    channels: Annotated[Mapping[str, ColumnChannel], Field(min_length=1)]
    time: ColumnTime
    # Sign at the beginning of comment lines, of `auto` #, % or //; empty if there are none.
    comment: str = "auto"
    header: Literal["auto", "row", "comment", "none"] = "auto"
    """Place of the names: the row above the numbers, the last comment line, or none; `auto` takes
    what is there."""
    # Whether a row of units follows the header; `auto` looks.
    units_row: bool | Literal["auto"] = "auto"
    # Cells that become NaN: what a logger writes if a reading failed.
    missing: tuple[str, ...] = MISSING
    ragged: Literal["refuse", "skip", "dropped_variable"] = "refuse"
    """Rows whose length differs from the header's: the file is refused, or `skip` skips and counts
    them. `dropped_variable`, for a logger that omits a variable after it failed: from there on, the
    columns that were missing in the last complete row are NaN; a row that this does not explain is
    refused."""

    @model_validator(mode="after")
    def _below_a_header(self) -> Self:
        if self.units_row is True and self.header not in ("auto", "row"):
            raise ValueError("a row of units needs a header row above it")
        return self


class CsvSource(SheetSource):
    OF = " of format csv"
    delimiter: Literal["auto", ",", ";", "tab", "space", "|"] = "auto"
    """Sign between cells; `auto` takes that of tab, `;`, `|`, `,` and blank by which most cells are
    numbers."""
    # Decimal sign; `auto` takes the one that the numbers have.
    decimal: Literal["auto", ".", ","] = "auto"


class JsonSource(TableSource):
    OF = " of format json_lines"
    channels: Annotated[Mapping[str, FieldChannel], Field(min_length=1)]
    time: FieldTime


class MatSource(TableSource):
    OF = " of format mat"
    channels: Annotated[Mapping[str, VariableChannel], Field(min_length=1)]
    time: VariableTime
    log_part: Annotated[
        str, AfterValidator(lambda text: checked_address(text, inside=False) if text else text)
    ] = ""
    """Address of the struct or cell that holds the trial, where there are several; the sample
    sheet's replaces it."""

    def of_part(self, part: str) -> Self:
        return self.model_copy(update={"log_part": part}) if part else self


class TdmsSource(TableSource):
    OF = " of format tdms"
    channels: Annotated[Mapping[str, TdmsChannel], Field(min_length=1)]
    time: TdmsTime = Field(default_factory=TdmsTime)


class OpenSimSource(SheetSource, InAxes):
    OF = " of format opensim"
    clock: Literal["master", "sync", "shared", "common"] = "master"  # type: ignore[assignment]
    """How the log's clock is aligned to motion capture's. `common`: its times are those of the TRC
    beside it."""
    channels: Mapping[str, OpenSimChannel] = Field(default={})
    time: OpenSimTime = Field(default_factory=OpenSimTime)
    # Force plates by number, from 1.
    plates: Mapping[PositiveInt, OpenSimPlate] = Field(default={})
    axes: Axes = ("x", "-z", "y")

    @model_validator(mode="after")
    def _something(self) -> Self:
        if not self.channels and not self.plates:
            raise misplaced(
                "name the columns to read under `channels`, or plates under `plates`", "channels"
            )
        if str(self.clock) == "common" and (not self.time.name or self.time.unit != "s"):
            raise misplaced(
                "`clock: common` needs the column of time in s, as {column: time, unit: s}", "time"
            )
        return self


class MarkerSource(InAxes):
    """The source file of a motion capture."""

    markers: Annotated[Literal["all"] | tuple[str, ...], BeforeValidator(all_none_or_list)] = "all"
    """The markers to read: all (every labelled point except model outputs), none or a list of
    labels."""
    shared: SharedAngle | None = None  # What aligns the clock of a log that says `clock: shared`.


class TrcSource(MarkerSource):
    OF = " of format trc"
    point_unit: LengthUnit | None = None  # Unit of length, where the file's own is absent or wrong.


class LaboratorySource(MarkerSource):
    """The source file of a motion capture with devices."""

    # The recorded channel of each canonical column.
    analogs: Mapping[str, Channel] = Field(default={})
    # The model output of each canonical column.
    outputs: Mapping[str, ModelOutput] = Field(default={})

    @model_validator(mode="after")
    def _each_once(self) -> Self:
        each_once("analogs", self.analogs, {})
        return self


class C3dSource(LaboratorySource):
    OF = " of format c3d"
    analogs: Mapping[str, C3dChannel] = Field(default={})
    point_unit: LengthUnit | None = None  # Unit of length, where the file's own is absent or wrong.
    plates: Annotated[
        Literal["all"] | tuple[PositiveInt, ...], BeforeValidator(all_none_or_list)
    ] = "all"
    """Force plates by number, from 1: all, none or a list."""
    # Units of the plates' channels, where the file's are absent or wrong.
    plate_units: PlateUnits | None = None
    plate_zero: Literal["none", "file"] | tuple[PositiveInt, PositiveInt] = "none"
    """Baseline of the plates: none, file (FORCE_PLATFORM:ZERO) or two frames, from 1, between which
    they are empty."""

    @model_validator(mode="after")
    def _zero_lasts(self) -> Self:
        if isinstance(self.plate_zero, tuple) and self.plate_zero[0] > self.plate_zero[1]:
            raise misplaced(
                f"{[*self.plate_zero]} ends before it begins; write the first frame first",
                "plate_zero",
            )
        return self


class NexusSource(LaboratorySource):
    OF = " of format nexus_csv"
    analogs: Mapping[str, DeviceChannel] = Field(default={})
    plates: Mapping[PositiveInt, NexusPlate] = Field(default={})  # Force plates by number, from 1.
    delimiter: Literal["auto", ",", ";", "tab", "space", "|"] = "auto"  # Sign between cells.
    decimal: Literal[".", ","] = "."  # Decimal sign.


SOURCES: Mapping[str, type[Source]] = {
    **dict.fromkeys(("mcap", "rosbag1", "rosbag2"), MessageSource),
    "csv": CsvSource, "table": SheetSource, "json_lines": JsonSource, "mat": MatSource,
    "tdms": TdmsSource,
    "opensim": OpenSimSource, "c3d": C3dSource, "nexus_csv": NexusSource, "trc": TrcSource,
}  # fmt: skip

UNKNOWN = "UNKNOWN"  # in a draft: a value that the file does not tell
NAME_OF_TIME = "NAME_OF_TIME"  # in a draft: the column of time, if no column is named like a clock


def open_places(content: Any, above: tuple[str, ...] = ()) -> Iterator[tuple[str, ...]]:
    """The places of a draft that the user must still edit: placeholder names and UNKNOWN values."""
    for key, value in content.items() if isinstance(content, dict) else ():
        place, is_open = (*above, str(key)), value == UNKNOWN and key in ("unit", "rate")
        if re.fullmatch(r"NAME_\d+", str(key)) or is_open or value == NAME_OF_TIME:
            yield place
        else:
            yield from open_places(value, place)


@dataclass(frozen=True)
class Recording:
    """The raw files of one recorder, as read. Everything but the samples can be written as JSON."""

    samples: pl.DataFrame
    """`time` [s] on the recorder's own clock, and canonical columns in SI units; null where a
    column has no sample."""
    columns: Mapping[str, dict[str, Any]]  # source channel and conversion of each column
    # Further facts: rates, source of time, plates.
    facts: Mapping[str, Any] = field(default_factory=dict)
    warnings: Sequence[str] = ()  # a sentence each
    damage: Ledger = field(default_factory=Ledger)  # lost messages or rows
    # channel numbers of each topic; None for a table
    topics: Mapping[str, Collection[int]] | None = None

    @property
    def losses(self) -> dict[str, Any]:
        """The report on losses for the provenance; empty for a complete table."""
        report = self.damage.report(self.topics)
        return report if self.topics is not None or not report["complete"] else {}


def check_values(what: str, values: Array, time: Array) -> None:
    """Refuse NaN and infinity in a channel (n,). The message gives the time [s] of the first."""
    finite = np.isfinite(values)
    if not finite.all():
        row = int(np.argmin(finite))
        said = f"{what}: {values[row]} in sample {row + 1} of {values.size}, at {time[row]:.3f} s"
        raise InputError(f"{said}; repair the recording or exclude the trial in the sheet")


LARGEST_MEASURED = {  # largest possible size of a value, by its SI unit
    "m": 1e3,  # no laboratory is a kilometre long
    "rad": 1e6,  # 160 000 turns
    "rad/s": 1e5,  # a million turns per minute
    "N": 1e6,  # the weight of a hundred tonnes
    # moments of a plate in N*mm declared as N*m pass; the centre of pressure shows that error
    # better
    "N*m": 1e7,
    "A": 1e5,
    "V": 1e6,  # counts of a 16-bit converter declared as V pass
    "N*m/rad": 1e8,
    "N*m*s/rad": 1e8,
    "N*m/kg": 1e6,
    "1": 1e9,  # counts of a converter
}


AMID = 5000  # number of samples from which the noise of a channel is estimated
NEXT_TO_ZERO = 1e-30  # size, in SI units, below which a value is no sensor's unless it is exactly 0
MOST_BENDS = 100  # largest number of bends at which leaps are searched for
FAR = 40.0  # ratio of a leap to all other bends; swapped markers of eleven laboratories reached 27
# noisy: seldom two equal values
SELDOM_REPEAT = ("theta", "theta_m", "omega_m", "torque", "torque_m", "current")


@np.errstate(over="ignore", invalid="ignore")
def values_of_no_sensor(
    column: str, time: Array, x: Array, origin: Mapping[str, Any], angle: Array | None = None
) -> NDArray[np.bool_] | None:
    """Mask (n,) of readings that come from lost or changed bytes; None if the column often repeats
    a value. They are: two or more raw zeros in a row (`origin` tells the raw zero), with a jump on
    both sides; a value that a torque holds for less than 0.5 s and takes nowhere else; numbers next
    to zero; one to five readings off the curve, or an angle's leap that no mass can do, four times
    as far as any other bend; six or more readings without noise beside a leap. A torque may leave
    its curve where the joint's `angle` (n,), if known, does too, as at a blow."""
    zero = math.prod(origin.get(key, 1) for key in ("sign", "scale", "factor")) * origin.get(
        "offset", 0
    )
    nought, stays = np.abs(x - zero) < NEXT_TO_ZERO, np.diff(x) == 0
    stands = nought[:-1] & nought[1:]
    sizes, bends = np.abs(x), bends_of(x)
    is_coarse = bool(np.count_nonzero(~stays) <= 0.5 * np.sum(~stands))
    moved = out_of_place(column, time, x, bends, angle, is_coarse)
    if is_coarse:
        return moved if moved.any() else None
    lost = (x != 0) & (sizes < NEXT_TO_ZERO)
    if (
        lost.any()
        and np.sum((between := sizes[sizes >= NEXT_TO_ZERO]) < 1e-9 * np.median(between)) > 10
    ):
        lost[:] = False  # it decays there, as in a simulation
    lost |= moved
    zeros = jumped_into(x, stands, bends, may_rest=not column.startswith(("theta", "torque")))
    # near a zero crossing, one jump
    leaps = {a for a, _ in leaps_of(x, bends, 4.0) if column in ("theta", "torque")}
    zeros += [(a, b) for a, b in run_edges(stands).tolist() if a and {a, b + 1} & leaps]
    # longer: `measure_stuck` reports it
    most = 0.5 * time.size / (np.ptp(time) or np.inf) if time.size else 0.0
    # else the sensor has few levels and may rest at each
    if "torque" in column and np.mean(stays) < 0.1:
        zeros += [
            (a, b)
            for a, b in jumped_into(x, stays, bends, True, (10, most))
            if np.sum(x == x[a]) <= b - a + 3
        ]
    if (
        zeros
        and not noise_in(
            elsewhere := x[~nought], slice(elsewhere.size // 4, elsewhere.size // 4 + AMID)
        )[0]
    ):
        zeros = []  # a quiet sensor, or a simulation, that rests
    for a, b in zeros:
        lost[a : b + 1] = True
    return np.asarray(lost)


def out_of_place(
    column: str, time: Array, x: Array, bends: Array, angle: Array | None, is_coarse: bool
) -> NDArray[np.bool_]:
    """Mask (n,) of readings in blocks that changed places; if there are none, those found
    `by_leaps`."""
    moved, of_joint = exchanged(x, bends), np.zeros(x.shape)
    coarse = is_coarse and column != "theta"  # a joint's angle cannot leap, even a coarse one
    if moved.any() or coarse or not (far := leaps_of(x, bends, 4.0)):
        return moved
    if column != "theta" and angle is not None and angle.shape == x.shape:
        of_joint = bends_of(angle)
    return by_leaps(column, time, x, bends, far, of_joint)


@np.errstate(over="ignore", invalid="ignore")
def by_leaps(
    column: str,
    time: Array,
    x: Array,
    bends: Array,
    far: Sequence[tuple[int, int]],
    of_joint: Array,
) -> NDArray[np.bool_]:
    """Mask (n,) of readings that leaps (`leaps_of`) show to be no sensor's
    (`values_of_no_sensor`)."""
    lost, moved = np.zeros(x.size, bool), np.zeros(x.size, bool)
    stays, usual = np.diff(x) == 0, median(np.diff(time))
    # rad
    farthest = {
        "theta": 2000.0 * usual**2 * (usual > 0.0025),
        "theta_m": math.inf if usual > 0.0025 else 0.0,
    }
    # half the size is enough, unless there are many, as of a stepper
    farther = {a for a, _ in leaps_of(x, bends, FAR)}
    for a, b in far:
        size = abs(x[a] - x[a - 1])
        lost[a:b] = of_joint[max(a - 3, 0) : b + 4].max() < 10
        is_turn = any(abs(size / turn - 1) < 0.1 for turn in (2 * np.pi, 360.0))
        most = farthest.get(column, math.inf) / (2 if a in farther and len(farther) < 5 else 1)
        is_moved = a == b and size > most and not is_turn
        moved[a] = is_moved and time[a] - time[a - 1] <= 1.5 * usual
    # it was elsewhere in between
    lost |= moved if moved.sum() % 2 else np.logical_xor.accumulate(moved)
    # rough in between: another channel's readings
    for a, b in pairwise(sorted(farther)) if column == "theta" else ():
        lost[a:b] |= b - a > 3 and median(bends[a + 2 : b - 1]) > 10
    edges = run_edges((bends[2:-1] < 0.02) & (np.mean(bends[2:-1] < 0.02) < 0.5))
    beside = np.array(
        [any(-1 <= at - a <= 1 or 2 <= at - b <= 4 for at, _ in far) for a, b in edges], bool
    )
    # a coarse encoder at constant speed also has such runs
    usual_run = np.diff(edges)[~beside].max(initial=2)
    for a, b in edges[beside].tolist():
        lost[a : b + 3] |= b - a > usual_run and not stays[a : b + 2].any()
    return lost


@np.errstate(over="ignore", invalid="ignore")
def exchanged(x: Array, bends: Array) -> NDArray[np.bool_]:
    """Mask (n,) of readings in two blocks of equal length that changed places. Two of their four
    leaps stand out; a third, perhaps no larger than noise, gives the length. With the blocks put
    back, all leaps must vanish."""
    at, left, lost = list[int](), bends.copy(), np.zeros(x.size, bool)
    for _ in range(9 if x.size > 9 and bends.max() > 10.0 else 0):
        at.append(int(np.argmax(left)))
        left[max(at[-1] - 3, 0) : at[-1] + 4] = 0
    if not at or bends[at[1]] <= max(10.0, 1.5 * (rest := bends[at[4]])):
        return lost
    most = max(8.0, 1.25 * rest) * np.abs(np.diff(x, 3)).max() / bends[at[0]]
    # noise may shift a leap by a few samples
    near = range(-2, 3) if bends[at[1]] > 3 * rest else range(1)
    for (p, q), k in product(combinations(sorted(at[:4]), 2), at[:8]):
        for size in {one + by for one in (k - p, k - q, 4) for by in near}:
            (a, b), (c, d) = sorted((p, p + size)), sorted((q, q + size))
            if 0 <= a < b <= c < d <= x.size:
                back = np.concatenate([x[:a], x[c:d], x[b:c], x[a:b], x[d:]])
                if np.abs(np.diff(back, 3)).max() < most:
                    lost[a:b] = lost[c:d] = True
                    return lost
    return lost


@np.errstate(over="ignore", invalid="ignore")
def bends_of(x: Array) -> Array:
    """Distance (n,) of readings (n,) from the curve of their neighbours, in units of its median:
    the third differences, placed so that the largest is at the row after a leap. 0 at the ends, and
    where a difference is NaN."""
    bends = np.zeros(x.shape)
    np.fmin(np.fmax(np.abs(np.diff(x, 3)), 0), 1e300, out=bends[2:-1])
    usual = median(counted) if (counted := bends[bends > 0]).size else 0.0
    if x.size and not usual > 1e-9 * max(np.fmax.reduce(x), -np.fmin.reduce(x)):
        usual = max(usual, 1e-9 * float(np.nanmedian(np.abs(x))) + 1e-300)
    return np.divide(bends, usual or 1.0, out=bends)


@np.errstate(over="ignore", invalid="ignore")
def leaps_of(x: Array, bends: Array, times: float) -> list[tuple[int, int]]:
    """Rows into which a channel (n,) leaps, each with the row at which it is back (within five
    rows), or else the same row. A leap is ten times the median bend, `times` (4 or more) any other
    bend, and twice the steps beside it. A corner, or the fall and rise after a blow, is not."""
    found, others, far = list[tuple[int, int]](), bends.copy(), np.flatnonzero(bends > 10.0)
    if far.size >= MOST_BENDS:
        far = far[bends[far] > np.partition(bends[far], -MOST_BENDS)[-MOST_BENDS]]
    apart = bends.copy()
    apart[np.clip(far[:, None] + np.arange(-2, 3), 0, x.size - 1)] = 0
    if not far.size or bends.max() <= times * apart.max():
        return found
    for group in np.split(far, np.flatnonzero(np.diff(far) > 2) + 1):
        begin = max(int(group[0]) - 4, 0)
        steps = np.diff(x[begin : int(group[-1]) + 4])
        steps -= median(steps) + median(np.diff(steps)) * (np.arange(steps.size) - steps.size / 2)
        sizes = np.abs(steps)
        large = np.flatnonzero(sizes > 0.5 * sizes.max())
        is_back = (
            large.size == 2 and np.ptp(large) <= 5 and abs(steps[large].sum()) < 0.5 * sizes.max()
        )
        if large.size < 3:
            places = (begin + 1 + large).tolist()
            found += [(places[0], places[-1])] if is_back else [(one, one) for one in places]
            others[max(int(group[0]) - 2, 0) : int(group[-1]) + 3] = 0
    return [(a, b) for a, b in found if bends[a : b + 2].max() > times * others.max()]


def jumped_into(
    x: Array,
    stands: NDArray[np.bool_],
    bends: Array,
    may_rest: bool,
    held: tuple[float, float] = (0, math.inf),
) -> list[tuple[int, int]]:
    """First and last sample of the runs in which readings (n,) stand still (`stands`, (n - 1,),
    between two each), with a jump on both sides, by their `bends_of` and by 2 % of the range. One
    side is enough for eight samples or more that are no rest, and if `held` limits the length of
    runs (exclusive). `may_rest`: runs at the ends do not count."""
    edges = run_edges(stands)
    edges = edges[np.all(np.sign(np.diff(edges) - held) == [1, -1], axis=1)]
    found = list[tuple[int, int]]()
    far = np.abs(np.diff(x, prepend=x[:1])) > 0.02 * np.ptp(x) if len(edges) else np.zeros(0, bool)
    for a, b in edges.tolist():
        inside, at = a and b < x.size - 1, [one for one in (a, b + 1) if 0 < one < x.size]
        jumps = [far[one - 1 : one + 2].max() * bends[one - 1 : one + 2].max() for one in at]
        on_one_side = held[0] > 0 or (b - a > 6 and not may_rest)
        # a few equal samples may be the turning point of the signal
        turns = (
            b - a <= 3
            and b < x.size - 1
            and not (inside and np.sign(x[a - 1]) == np.sign(x[b + 1]) != 0)
        )
        if (
            (inside or not may_rest)
            and not turns
            and (max if on_one_side else min)(jumps, default=0.0) > 6
        ):
            found.append((a, b))
    return found


def check_sizes(recording: Recording) -> None:
    """Refuse values beyond `LARGEST_MEASURED`, and infinite ones. NaN passes: it marks a value that
    was not seen."""
    time = recording.samples["time"].to_numpy()
    sizes = recording.samples.select(pl.col(*recording.columns).abs().max())
    for column, largest in sizes.row(0, named=True).items():
        bound = LARGEST_MEASURED[unit_of(column)]
        if (largest or 0.0) > bound:
            values = recording.samples[column].to_numpy()
            beyond = np.abs(values) > bound
            row = int(np.argmax(beyond))
            raise InputError(
                f"{column} is {values[row]:.4g} {unit_of(column)} at {time[row]:.3f} s, and beyond"
                f" ±{bound:g} in {beyond.sum()} of {np.count_nonzero(~np.isnan(values))} samples:"
                " nothing here can be so large; correct its unit or scale in the source file, or"
                " repair the recording or the byte order it states"
            )
