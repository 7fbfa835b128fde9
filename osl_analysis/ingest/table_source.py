"""The source file of a log that is one table of numbers, in JSON lines, TDMS or a table of OpenSim."""

from typing import Annotated, Any, ClassVar, Literal

from pydantic import Field, PositiveFloat, field_validator, model_validator

from osl_analysis.ingest.sensor import Stamps
from osl_analysis.ingest.source_fields import Conversion, LogSource
from osl_analysis.ingest.units import si_factor
from osl_analysis.yaml_settings import Settings

Share = Annotated[float, Field(ge=0, le=1)]


class TableChannel(Conversion):
    """One column of numbers."""

    ADDRESS: ClassVar[str]
    """The field that names the column: `column`, `field` or `channel`."""

    counter: str | None = None
    """Name of the column in which the device counts its samples. It tells which samples are missing."""

    @property
    def name(self) -> str:
        """The column's name in the file."""
        return str(getattr(self, self.ADDRESS))


class TableTime(Settings):
    """Where the time of a row comes from: a column, or the rate at which rows were written."""

    ADDRESS: ClassVar[str]
    """The field that names the column, as in `TableChannel`."""
    IN_FILE: ClassVar[bool] = False
    """Whether the format itself tells when a sample was taken."""

    unit: str | None = None
    """Unit of the column."""
    rate: PositiveFloat | None = None
    """Rows per second [Hz], for a file without time."""
    repeated: Literal["keep", "drop"] = "keep"
    """Rows whose stamp is that of the row before. `keep`: they are samples whose stamps were rounded. `drop`: the
    recorder read a device faster than it sampled; only the first row of each stamp is used."""
    stamps: Stamps = "auto"
    """How the stamps are taken."""

    @property
    def name(self) -> str | None:
        """Name of the column that holds time."""
        given: str | None = getattr(self, self.ADDRESS)
        return given

    @field_validator("unit")
    @classmethod
    def _of_time(cls, unit: str | None) -> str | None:
        if unit is not None:
            si_factor(unit, "s")
        return unit

    @model_validator(mode="after")
    def _one(self) -> "TableTime":
        given = [value for value in (self.name, self.rate) if value is not None]
        if len(given) > 1 or not (given or self.IN_FILE):
            raise ValueError(f"state either the {self.ADDRESS} that holds time, or the rate of the rows [Hz]")
        if self.unit is not None and self.name is None:
            raise ValueError(f"`unit` is that of the {self.ADDRESS} of time; name the {self.ADDRESS}, or remove it")
        return self


class TableSource(LogSource):
    """A log that is one table of numbers."""

    most_missing: Share = 0.01
    """Largest share of a column's numbers that may be NaN, and of the rows that may be skipped."""
    time: Any
    """Where the time of a row comes from."""
    channels: dict[str, Any] = Field(min_length=1)
    """The column of each canonical column."""
