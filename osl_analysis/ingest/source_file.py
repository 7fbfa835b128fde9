"""A source file in `config/sources/`: what a recorder's channels are, in canonical columns, units and signs."""

from pathlib import Path
from typing import Any, Literal

import numpy as np
from pydantic import ConfigDict, Field, PositiveInt, field_validator, model_validator

from osl_analysis.columns import AXES, COLUMNS, unit_of
from osl_analysis.ingest.units import si_factor
from osl_analysis.trial import Array
from osl_analysis.validation import Settings, read_yaml

Sign = Literal[1, -1]
Axis = Literal["x", "y", "z", "-x", "-y", "-z"]


class LogChannel(Settings):
    """One field of one topic: canonical value = sign * factor(unit) * (raw + offset).

    `field` is a dotted path, with an index where it passes an array (`wrench.force.x`, `position[0]`); `offset`
    is in the source's unit.
    """

    topic: str
    field: str
    unit: str
    sign: Sign = 1
    offset: float = 0.0


class TimeSource(Settings):
    """Time of a message: its header stamp (the field of type Time named by `field`), or when it was logged."""

    source: Literal["header", "log"]
    field: str = "header.stamp"


class McapSource(Settings):
    """A log in MCAP. `clock: sync` aligns its clock to motion capture by the edges of the column `sync`.

    `clock: shared` does so by the signal that motion capture's source file names under `shared`.
    """

    format: Literal["mcap"]
    description: str = ""
    clock: Literal["master", "sync", "shared"] = "master"
    time: TimeSource
    channels: dict[str, LogChannel] = Field(min_length=1)

    @field_validator("channels")
    @classmethod
    def _canonical(cls, channels: dict[str, LogChannel]) -> dict[str, LogChannel]:
        for column, channel in channels.items():
            check_column(column, channel.unit)
        return channels

    @model_validator(mode="after")
    def _has_sync(self) -> "McapSource":
        if self.clock == "sync" and "sync" not in self.channels:
            raise ValueError("clock: sync needs the column sync under channels; map it, or write clock: master")
        return self


class AnalogChannel(Settings):
    """One analog channel, by its label; without `unit` the file's ANALOG:UNITS holds."""

    channel: str
    unit: str | None = None
    sign: Sign = 1


class ModelOutput(Settings):
    """One component of a model output that the laboratory's software stored as a point.

    The unit is what the software computes, not what the file says: Plug-in Gait moments are N*mm/kg whatever
    the file's units.
    """

    label: str
    component: Literal["x", "y", "z"]
    unit: str
    sign: Sign = 1


class PlateUnits(Settings):
    """Units of the plates' force and moment channels where the file's ANALOG:UNITS are absent or wrong."""

    force: str
    moment: str

    @model_validator(mode="after")
    def _known(self) -> "PlateUnits":
        si_factor(self.force, "N")
        si_factor(self.moment, "N*m")
        return self


class SharedAngle(Settings):
    """What aligns a log's clock where the edges of a sync channel cannot.

    A column of the log is, up to scale, sign and offset, the angle at the second of three markers.
    """

    column: str
    markers: tuple[str, str, str]


class C3dSource(Settings):
    """A motion capture recording in C3D.

    `markers`: all (every labelled point that is no model output), none or a list of labels; `plates`: all, none
    or a list counted from 1. `point_unit` and `plate_units` override what the file says. `axes` names the file's axes
    that point forward, to the left and up: `[z, x, y]` or `[x, -z, y]` where y is up. `plate_zero` is the baseline to
    subtract from the plates' channels: none, file (the frames of FORCE_PLATFORM:ZERO) or two frames, counted from 1.
    """

    format: Literal["c3d"]
    description: str = ""
    markers: Literal["all"] | tuple[str, ...] = "all"
    plates: Literal["all"] | tuple[int, ...] = "all"
    analogs: dict[str, AnalogChannel] = Field(default={})
    outputs: dict[str, ModelOutput] = Field(default={})
    point_unit: str | None = None
    plate_units: PlateUnits | None = None
    shared: SharedAngle | None = None
    plate_zero: Literal["none", "file"] | tuple[PositiveInt, PositiveInt] = "none"
    axes: tuple[Axis, Axis, Axis] = ("x", "y", "z")

    @property
    def rotation(self) -> Array:
        """From the file's axes to ours, (3, 3): our coordinates are `rotation @ (x, y, z)`."""
        return np.array(
            [[(-1.0 if name[0] == "-" else 1.0) * (name[-1] == axis) for axis in AXES] for name in self.axes]
        )

    @field_validator("axes")
    @classmethod
    def _right_handed(cls, axes: tuple[Axis, Axis, Axis]) -> tuple[Axis, Axis, Axis]:
        if round(float(np.linalg.det(cls.model_construct(axes=axes).rotation))) != 1:
            raise ValueError("forward, left and up must be three different axes of a right-handed laboratory")
        return axes

    @field_validator("markers", "plates", mode="before")
    @classmethod
    def _choice(cls, value: Any) -> Any:
        if value == "none":
            return ()
        if value == "all" or isinstance(value, list | tuple):
            return value
        raise ValueError("write all, none or a list")

    @model_validator(mode="after")
    def _canonical(self) -> "C3dSource":
        for column, analog in self.analogs.items():
            check_column(column, analog.unit)
        for column, output in self.outputs.items():
            check_column(column, output.unit)
        if self.point_unit is not None:
            si_factor(self.point_unit, "m")
        return self


class AnySource(Settings):
    """Of a source file, the field that says which kind it is."""

    model_config = ConfigDict(extra="ignore")

    format: Literal["mcap", "c3d"]


def check_column(column: str, unit: str | None) -> None:
    """Refuse a column that is not in the nomenclature, or a unit that cannot become the column's."""
    try:
        canonical = unit_of(column)
    except KeyError:
        names = [name for name in COLUMNS if name != "time"]
        raise ValueError(f"'{column}' is no canonical column; the columns are {', '.join(names)}") from None
    if column == "time":
        raise ValueError("time is no channel; say where it comes from under `time`")
    if unit is not None:
        try:
            si_factor(unit, canonical)
        except ValueError as error:
            raise ValueError(f"{column}: {error}") from None


def read_source(path: Path) -> McapSource | C3dSource:
    """A source file, checked: columns are canonical, every unit converts to its column's.

    Raises
    ------
    InputError
        The file is missing, or a field is unknown, absent or of a wrong value.
    """
    models: dict[str, type[McapSource] | type[C3dSource]] = {"mcap": McapSource, "c3d": C3dSource}
    return read_yaml(path, models[read_yaml(path, AnySource).format])
