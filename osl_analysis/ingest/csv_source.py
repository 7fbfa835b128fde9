"""Source files for text: a logger's or bench's CSV, and the CSV export of Vicon Nexus."""

from typing import Annotated, Any, Literal

import numpy as np
from pydantic import Field, PositiveFloat, PositiveInt, field_validator, model_validator

from osl_analysis.ingest.source_fields import Laboratory, ModelOutput, Sign, check_column
from osl_analysis.ingest.units import si_factor
from osl_analysis.trial import Array
from osl_analysis.yaml_settings import Settings

Share = Annotated[float, Field(ge=0, le=1)]
Point = tuple[float, float, float]
Delimiter = Literal["auto", ",", ";", "tab", "space", "|"]


class CsvChannel(Settings):
    """One column: canonical value = sign * scale * factor(unit) * (raw + offset).

    `column` is the name in the header, with or without its unit (`torque` finds `torque [Nm]`), or where there is no
    header the column's number, counted from 1. Without `unit` the file's holds: in brackets behind the name, or in a
    row of units. `scale` is for counts: 1 / 16384 and unit rev for an encoder of 14 bits. `offset` is in the file's.
    """

    column: str
    unit: str | None = None
    sign: Sign = 1
    scale: float = 1.0
    offset: float = 0.0

    @field_validator("column", mode="before")
    @classmethod
    def _number(cls, value: Any) -> Any:
        return str(value) if isinstance(value, int) and not isinstance(value, bool) else value

    @field_validator("scale")
    @classmethod
    def _not_zero(cls, value: float) -> float:
        if value == 0:
            raise ValueError("a scale of zero leaves nothing")
        return value


class CsvTime(Settings):
    """Where time comes from: a column with its unit, or the rate [Hz] at which rows were written."""

    column: str | None = None
    unit: str | None = None
    rate: PositiveFloat | None = None

    @model_validator(mode="after")
    def _one(self) -> "CsvTime":
        if (self.column is None) == (self.rate is None):
            raise ValueError("state either the column that holds time or the rate of the rows [Hz]")
        if self.unit is not None:
            si_factor(self.unit, "s")
        return self


class CsvSource(Settings):
    """A log in CSV. `clock: sync` aligns its clock to motion capture by the edges of the column `sync`;
    `clock: shared` by the signal that motion capture's source file names under `shared`.

    `header`: row (the first row names the columns), comment (the last comment line does) or none. Cells that hold one
    of the words in `missing` become NaN; a column with a larger share of them than `most_missing` is refused.
    `ragged`: what becomes of rows of another length than the header: refuse; skip, with a count, up to the same
    share; or dropped_variable, for a logger that leaves out a variable after it failed: the columns that were missing
    in the last complete row are NaN from there on, and a row that this does not explain is refused. A last row that
    is cut off is left out in any case, with a warning.
    """

    format: Literal["csv"]
    description: str = ""
    clock: Literal["master", "sync", "shared"] = "master"
    delimiter: Delimiter = "auto"
    decimal: Literal[".", ","] = "."
    comment: str = "#"
    header: Literal["row", "comment", "none"] = "row"
    units_row: bool = False
    missing: tuple[str, ...] = ("", "nan", "NaN")
    most_missing: Share = 0.01
    ragged: Literal["refuse", "skip", "dropped_variable"] = "refuse"
    time: CsvTime
    channels: dict[str, CsvChannel] = Field(min_length=1)

    @model_validator(mode="after")
    def _consistent(self) -> "CsvSource":
        for column, channel in self.channels.items():
            check_column(column, channel.unit)
        if self.clock == "sync" and "sync" not in self.channels:
            raise ValueError("clock: sync needs the column sync under channels; map it, or write clock: master")
        if self.units_row and self.header != "row":
            raise ValueError("a row of units needs a header row above it")
        return self


class NexusAnalog(Settings):
    """One device channel: the device output's name (`EMG2000 - Voltage`) and the column under it.

    Without `unit` the file's row of units holds.
    """

    device: str
    component: str
    unit: str | None = None
    sign: Sign = 1


class NexusPlate(Settings):
    """A force plate among the devices, whose outputs `<device> - Force` and `<device> - Moment` are in the
    laboratory's axes.

    The file says neither where the plate lies nor what its numbers mean: `corners` [mm], the point about which the
    `moment` is taken [mm] (default: the centre of the corners), and `sign` -1 where the plate reports what acts on it
    instead of what acts on the foot.
    """

    device: str
    corners: tuple[Point, Point, Point, Point]
    moment_about: Point | None = None
    sign: Sign = 1

    def centre(self) -> Array:
        return np.asarray(np.mean(self.corners, axis=0))


class NexusSource(Laboratory):
    """Vicon Nexus's CSV export: sections Devices, Trajectories and Model Outputs in any order.

    Labels are given with or without their subject (`LTOE` for `Anna:LTOE`). `plates` by number, counted from 1.
    """

    format: Literal["nexus_csv"]
    description: str = ""
    delimiter: Delimiter = "auto"
    decimal: Literal[".", ","] = "."
    analogs: dict[str, NexusAnalog] = Field(default={})
    outputs: dict[str, ModelOutput] = Field(default={})
    plates: dict[PositiveInt, NexusPlate] = Field(default={})

    @model_validator(mode="after")
    def _canonical(self) -> "NexusSource":
        for column, analog in self.analogs.items():
            check_column(column, analog.unit)
        for column, output in self.outputs.items():
            check_column(column, output.unit)
        return self
