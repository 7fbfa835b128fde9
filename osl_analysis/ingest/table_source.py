"""The source file of a log that is one table of numbers, in JSON lines, TDMS or a table of OpenSim."""

from typing import Any, ClassVar

from pydantic import Field, model_validator

from osl_analysis.ingest.row_time import RowTime, Share
from osl_analysis.ingest.source_fields import Conversion, LogSource


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


class TableTime(RowTime):
    """Where the time of a row comes from: a column, or the rate at which rows were written."""

    ADDRESS: ClassVar[str]
    """The field that names the column, as in `TableChannel`."""
    IN_FILE: ClassVar[bool] = False
    """Whether the format itself tells when a sample was taken."""

    @property
    def name(self) -> str | None:
        """Name of the column that holds time."""
        given: str | None = getattr(self, self.ADDRESS)
        return given

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
