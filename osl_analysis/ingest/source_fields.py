"""What the source files of all formats share: sensors, conversion to SI units, clocks, axes, markers, model outputs."""

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Annotated, Any, Literal, Self

import numpy as np
from pydantic import AfterValidator, BeforeValidator, Field, PrivateAttr, field_validator, model_validator
from pydantic_core import PydanticCustomError

from osl_analysis.columns import AXES, COLUMNS, unit_of
from osl_analysis.errors import InputError, nearest
from osl_analysis.ingest.units import Unit, quantity, si_factor
from osl_analysis.trial import Array
from osl_analysis.yaml_settings import Settings, line_of

Stamps = Literal["auto", "exact", "even"]
"""How stamps are taken (docs/time_base.md). `exact`: each sample was taken at its stamp. `even`: the device samples
evenly, and only the stamps scatter. `auto`: stamps and signals decide."""


HIGHEST_ORDER = 8  # highest order of a sensor's low-pass that is accepted


class SensorFilter(Settings):
    """The low-pass of a sensor or its amplifier, an analogue Butterworth that ran once while recording."""

    cutoff: str
    """Cut-off with its unit, as `100 Hz`."""
    order: int = Field(default=1, ge=1, le=HIGHEST_ORDER)
    """Order."""

    @field_validator("cutoff")
    @classmethod
    def _positive(cls, value: str) -> str:
        if quantity(value, "Hz") <= 0:
            raise ValueError("a cut-off must be above zero, as `100 Hz`")
        return value

    def origin(self) -> dict[str, Any]:
        """Cut-off [Hz] and order, for the trial's provenance."""
        return {"cutoff_hz": quantity(self.cutoff, "Hz"), "order": self.order}


class Sensor(Settings):
    """Known properties of a channel's sensor."""

    delay: str | None = None
    """Age of a sample at its stamp, such as `2 ms`. It is subtracted from the channel's stamps."""
    low_pass: SensorFilter | None = None
    """The sensor's own low-pass: analyses put all other signals of the trial through the same filter."""
    resolution: str | None = None
    """Smallest step of the recorded values with its unit, as `0.02 deg`."""
    bits: int | None = Field(default=None, ge=4, le=32)
    """Bits of an encoder per revolution, in place of `resolution`."""
    range: str | tuple[str, str] | None = None
    """Range of the sensor with its unit, before `sign` and `offset`: `60 N*m` for +-60 N*m, or both ends, as
    `[0 deg, 300 deg]`."""

    @field_validator("delay")
    @classmethod
    def _is_time(cls, value: str | None) -> str | None:
        if value is not None:
            quantity(value, "s")
        return value

    def sensor_origin(self, si_unit: str) -> dict[str, Any]:
        """What is stated, in SI units, for the trial's provenance: `delay` [s], `low_pass`, `resolution` and
        both ends of `range` [si_unit].
        """
        stated: dict[str, Any] = {}
        if self.delay is not None:
            stated["delay"] = quantity(self.delay, "s")
        if self.low_pass is not None:
            stated["low_pass"] = self.low_pass.origin()
        if self.resolution is not None or self.bits is not None:
            stated["resolution"] = self.step(si_unit)
        if self.range is not None:
            stated["range"] = list(self.ends(si_unit))
        return stated

    def ends(self, si_unit: str) -> tuple[float, float]:
        """Both ends of the stated range [si_unit]; raises as `sensor_origin`."""
        assert self.range is not None
        texts = (self.range,) if isinstance(self.range, str) else self.range
        ends = [quantity(text, si_unit) for text in texts]
        low, high = (-ends[0], ends[0]) if len(ends) == 1 else ends
        if low >= high:
            raise InputError(
                f"a range from {low:g} to {high:g} {si_unit} is empty; write the lower end first, or one number"
            )
        return low, high

    def step(self, si_unit: str) -> float:
        """Smallest step of the recorded values [si_unit]; raises as `sensor_origin`."""
        if self.resolution is not None and self.bits is not None:
            raise InputError("state `resolution` or `bits`, not both")
        if self.resolution is not None:
            step = quantity(self.resolution, si_unit)
        elif si_unit == "rad":
            step = 2 * np.pi / 2 ** (self.bits or 0)
        else:
            raise InputError("`bits` are those of an encoder per revolution; state `resolution` with its unit instead")
        if step <= 0:
            raise InputError(f"a resolution of {self.resolution} is not positive; write a positive one, or remove it")
        return step


LARGEST = 1e12  # largest size of a scale or an offset: what is larger is a slip
Axis = Literal["x", "y", "z", "-x", "-y", "-z"]


class Conversion(Sensor):
    """How recorded numbers become SI units: sign * scale * factor * (raw + offset), with the unit's factor to SI."""

    unit: Unit | None = None
    """Unit of the numbers, as laboratories spell it. Without it, the unit that the file states is used."""
    sign: Literal[1, -1] = 1
    """-1 if the recorder has the opposite direction as positive."""
    scale: float = Field(default=1.0, ge=-LARGEST, le=LARGEST)
    """Units per count: 1 / 16384 with the unit rev for an encoder of 14 bits."""
    offset: float = Field(default=0.0, ge=-LARGEST, le=LARGEST)
    """Offset that is added to the raw numbers before the scale, in the raw unit."""

    @field_validator("sign", mode="before")
    @classmethod
    def _number(cls, value: Any) -> Any:
        if isinstance(value, bool):
            raise ValueError("write 1 or -1")
        return value

    @field_validator("scale")
    @classmethod
    def _not_zero(cls, value: float) -> float:
        if value == 0:
            raise ValueError("a scale of zero makes every number zero; write the size of one count")
        return value

    def stated_unit(self, unit_of_file: str) -> str:
        """The source file's unit, or else the recording's."""
        return unit_of_file if self.unit is None else self.unit

    def to_si(self, raw: Array, si_unit: str, unit_of_file: str = "") -> Array:
        """Recorded numbers, of any shape, in the SI unit."""
        factor = si_factor(self.stated_unit(unit_of_file), si_unit)
        with np.errstate(over="ignore"):  # what overflows is refused with what is too large
            found = np.asarray(raw + self.offset)
            return np.multiply(self.sign * self.scale * factor, found, out=found)

    def origin(self, column: str, unit_of_file: str = "") -> dict[str, Any]:
        """Where a canonical column comes from and how it was converted, for the trial's provenance."""
        unit, si_unit = self.stated_unit(unit_of_file), unit_of(column)
        address = self.model_dump(exclude=set(Sensor.model_fields))
        sensor, factor = self.sensor_origin(si_unit), si_factor(unit, si_unit)
        if "range" in sensor:
            ends = [self.sign * (end + self.scale * factor * self.offset) for end in sensor["range"]]
            sensor["range"] = sorted(ends)
        return {**address, "unit": unit, "factor": factor, "si_unit": si_unit, **sensor}


class SourceFile(Settings):
    """A source file of any format."""

    _path: Path | None = PrivateAttr(default=None)

    def written_in(self, path: Path) -> None:
        self._path = path

    def place(self, *keys: str) -> str:
        """A field, for messages: its keys, and the file and line in which they stand."""
        if self._path is None:
            return f"`{'.'.join(keys)}` in the source file"
        line = line_of(self._path, keys)
        return f"`{'.'.join(keys)}` in {self._path}{f', line {line}' if line else ''}"


class LogSource(SourceFile):
    """A log: the file of a recorder with a clock of its own."""

    format: str
    """Format of the file."""
    description: str = ""
    """For readers; nothing is computed from it."""
    clock: Literal["master", "sync", "shared"] = "master"
    """How the log's clock is aligned to motion capture's.

    `master`: no alignment; the log is the trial's only file. `sync`: by the edges of the column `sync`. `shared`: by
    the signal that motion capture's source file names under `shared`.
    """
    channels: Mapping[str, Conversion] = Field(min_length=1)
    """The recorded channel of each canonical column."""

    def of_part(self, part: str) -> Self:
        """The source file for one part of a log that holds several trials, as the sample sheet names it."""
        if not part:
            return self
        if "log_part" not in type(self).model_fields:
            raise InputError(f"log_part '{part}' in the sheet: a log in {self.format} holds one trial; clear the cell")
        return self.model_copy(update={"log_part": part})

    @field_validator("channels")
    @classmethod
    def _canonical(cls, channels: Mapping[str, Conversion]) -> Mapping[str, Conversion]:
        for column, channel in channels.items():
            check_canonical(column, channel)
        return channels

    @model_validator(mode="after")
    def _has_sync(self) -> "LogSource":
        if self.clock == "sync" and "sync" not in self.channels:
            raise misplaced("sync needs the column sync under channels; map it, or write clock: master", "clock")
        return self


def rotation_of(axes: tuple[Axis, Axis, Axis]) -> Array:
    """From a file's axes to ours, (3, 3), by the file's axes that point forward, to the left and up."""
    return np.array([[(-1.0 if name[0] == "-" else 1.0) * (name[-1] == axis) for axis in AXES] for name in axes])


def right_handed(axes: tuple[Axis, Axis, Axis]) -> tuple[Axis, Axis, Axis]:
    """The axes as they are; raises ValueError if they are none of a right-handed laboratory."""
    if round(float(np.linalg.det(rotation_of(axes)))) != 1:
        raise ValueError("forward, left and up must be three different axes of a right-handed laboratory")
    return axes


def all_none_or_list(value: Any) -> Any:
    """A choice among a file's things: `none` is the empty list."""
    if value == "none":
        return ()
    if value == "all" or isinstance(value, list | tuple):
        return value
    raise ValueError("write all, none or a list")


Axes = Annotated[tuple[Axis, Axis, Axis], AfterValidator(right_handed)]


class SharedAngle(Settings):
    """An angle that log and motion capture both recorded, which aligns their clocks where no sync edges do."""

    column: str
    """Column of the log with the angle. Its scale, sign and offset do not matter."""
    markers: tuple[str, str, str]
    """Three markers of motion capture. The angle is at the second marker."""


class ModelOutput(Conversion):
    """One component of a model output, such as a joint moment of Plug-in Gait, that is stored like a marker."""

    label: str
    """Label of the output in the file."""
    component: Literal["x", "y", "z"]
    """Component of the output."""
    unit: Unit
    """Unit that the software computes in, which the file may misstate: moments of Plug-in Gait are always N*mm/kg."""


class CaptureSource(SourceFile):
    """A capture: the file of a motion-capture laboratory, whose clock is the trial's."""

    format: str
    """Format of the file."""
    description: str = ""
    """For readers; nothing is computed from it."""
    markers: Annotated[Literal["all"] | tuple[str, ...], BeforeValidator(all_none_or_list)] = "all"
    """The markers to read: all (every labelled point except model outputs), none or a list of labels."""
    axes: Axes = ("x", "y", "z")
    """The file's axes that point forward, to the left and up: `[z, x, y]` or `[x, -z, y]` where y is up."""
    shared: SharedAngle | None = None
    """What aligns the clock of a log that says `clock: shared`."""
    analogs: Mapping[str, Conversion] = Field(default={})
    """The recorded channel of each canonical column."""
    outputs: dict[str, ModelOutput] = Field(default={})
    """The model output of each canonical column."""

    @property
    def rotation(self) -> Array:
        """From the file's axes to ours, (3, 3): our coordinates are `rotation @ (x, y, z)`."""
        return rotation_of(self.axes)

    @field_validator("analogs", "outputs", check_fields=False)
    @classmethod
    def _canonical(cls, channels: Mapping[str, Conversion]) -> Mapping[str, Conversion]:
        for column, channel in channels.items():
            check_canonical(column, channel)
        return channels


def check_canonical(column: str, channel: Conversion) -> None:
    """Refuse a column that is not in the nomenclature, or a unit that cannot become the column's."""
    names = [name for name in COLUMNS if name != "time"]
    try:
        canonical = unit_of(column)
    except KeyError:
        advice = f"the columns are {', '.join(names)}{nearest(column, names)}"
        raise misplaced(f"'{column}' is not a canonical column; {advice}", column) from None
    if column == "time":
        raise misplaced("time is not a channel; state its source under `time`", column)
    checks: dict[str, Callable[[], object]] = {
        "unit": lambda: si_factor(str(channel.unit), canonical),
        "resolution": lambda: channel.step(canonical),
        "bits": lambda: channel.step(canonical),
        "range": lambda: channel.ends(canonical),
    }
    for field, check in checks.items():
        value = getattr(channel, field)
        try:
            if value is not None:
                check()
        except ValueError as error:
            raise misplaced(f"{value!r} is not allowed: {error}", column, field) from None


def misplaced(reason: str, *place: str) -> PydanticCustomError:
    """An error of a check that sees several fields; `place` is the field below them that is wrong."""
    return PydanticCustomError("misplaced", "{reason}", {"reason": reason, "place": place})
