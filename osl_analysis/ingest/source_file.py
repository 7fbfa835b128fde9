"""A source file in `config/sources/`: what a recorder's channels are, in canonical columns, units and signs."""

from pathlib import Path
from typing import Any, Literal

from pydantic import ConfigDict, Field, PositiveInt, field_validator, model_validator

from osl_analysis.ingest.csv_source import CsvSource, NexusSource
from osl_analysis.ingest.source_fields import Laboratory, ModelOutput, Sign, all_none_or_list, check_column
from osl_analysis.ingest.units import si_factor
from osl_analysis.yaml_settings import Settings, read_yaml


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
    A log that has lost more than the share `largest_loss` is refused.
    """

    format: Literal["mcap"]
    description: str = ""
    clock: Literal["master", "sync", "shared"] = "master"
    time: TimeSource
    largest_loss: float = Field(default=0.01, ge=0.0, le=1.0)
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


class PlateUnits(Settings):
    """Units of the plates' force and moment channels where the file's ANALOG:UNITS are absent or wrong."""

    force: str
    moment: str

    @model_validator(mode="after")
    def _known(self) -> "PlateUnits":
        si_factor(self.force, "N")
        si_factor(self.moment, "N*m")
        return self


class AnalogChannel(Settings):
    """One analog channel, by its label; without `unit` the file's ANALOG:UNITS holds."""

    channel: str
    unit: str | None = None
    sign: Sign = 1


class C3dSource(Laboratory):
    """A motion capture recording in C3D.

    `markers`: all (every labelled point that is no model output), none or a list of labels; `plates`: all, none
    or a list counted from 1. `point_unit` and `plate_units` override what the file says.
    `plate_zero` is the baseline to subtract from the plates' channels: none, file (the frames of FORCE_PLATFORM:ZERO)
    or two frames, counted from 1.
    """

    format: Literal["c3d"]
    description: str = ""
    plates: Literal["all"] | tuple[int, ...] = "all"
    analogs: dict[str, AnalogChannel] = Field(default={})
    outputs: dict[str, ModelOutput] = Field(default={})
    point_unit: str | None = None
    plate_units: PlateUnits | None = None
    plate_zero: Literal["none", "file"] | tuple[PositiveInt, PositiveInt] = "none"

    @field_validator("plates", mode="before")
    @classmethod
    def _plate_choice(cls, value: Any) -> Any:
        return all_none_or_list(value)

    @model_validator(mode="after")
    def _canonical(self) -> "C3dSource":
        for column, analog in self.analogs.items():
            check_column(column, analog.unit)
        for column, output in self.outputs.items():
            check_column(column, output.unit)
        if self.point_unit is not None:
            si_factor(self.point_unit, "m")
        return self


Source = McapSource | C3dSource | CsvSource | NexusSource
MODELS: dict[str, type[McapSource] | type[C3dSource] | type[CsvSource] | type[NexusSource]] = {
    "mcap": McapSource,
    "c3d": C3dSource,
    "csv": CsvSource,
    "nexus_csv": NexusSource,
}


class AnySource(Settings):
    """Of a source file, the field that says which kind it is."""

    model_config = ConfigDict(extra="ignore")

    format: Literal["mcap", "c3d", "csv", "nexus_csv"]


def read_source(path: Path) -> Source:
    """A source file, checked: columns are canonical, every unit converts to its column's.

    Raises
    ------
    InputError
        The file is missing, or a field is unknown, absent or of a wrong value.
    """
    return read_yaml(path, MODELS[read_yaml(path, AnySource).format])
