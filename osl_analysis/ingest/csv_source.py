"""The source file of a log in CSV: a logger's or a bench's own table."""

from typing import Any, Literal

from pydantic import Field, field_validator, model_validator

from osl_analysis.formats.csv_rows import CsvLayout
from osl_analysis.ingest.row_time import RowTime, Share
from osl_analysis.ingest.source_fields import Conversion, LogSource
from osl_analysis.ingest.unit_names import TimeUnit

Delimiter = Literal["auto", ",", ";", "tab", "space", "|"]


def text_of_number(value: Any) -> Any:
    """A column's number as text; anything else as it is."""
    return str(value) if isinstance(value, int) and not isinstance(value, bool) else value


class CsvChannel(Conversion):
    """One column. Without `unit`, the file's unit is used: in brackets after the column's name, or in a row of
    units."""

    column: str
    """Name in the header, with or without its unit (`torque` finds `torque [Nm]`); a pattern in which `*` stands for
    any text, which must fit one column (`"*.output_position"`); or the column's number, counted from 1."""
    counter: str | None = None
    """Name of the column in which the device counts its samples. It tells which samples are missing."""

    @field_validator("column", "counter", mode="before")
    @classmethod
    def _number(cls, value: Any) -> Any:
        return text_of_number(value)


class CsvTime(RowTime):
    """Where the time of a row comes from: a column, or the rate at which rows were written."""

    column: str | None = None
    """Name of the column that holds time."""
    unit: TimeUnit | None = None
    """Unit of the column. Without it, the file's unit is used."""

    @field_validator("column", mode="before")
    @classmethod
    def _number(cls, value: Any) -> Any:
        return text_of_number(value)

    @model_validator(mode="after")
    def _one(self) -> "CsvTime":
        if (self.column is None) == (self.rate is None):
            raise ValueError("state either the column that holds time or the rate of the rows [Hz]")
        return self


class CsvSource(LogSource):
    """A log in CSV. An incomplete last row is always skipped, with a warning."""

    format: Literal["csv"]
    """Format of the file."""
    delimiter: Delimiter = "auto"
    """Sign between cells; `auto` takes the first of tab, `;`, `|` and `,` that all lines have."""
    decimal: Literal[".", ","] = "."
    """Decimal sign."""
    comment: str = "#"
    """Sign at the beginning of comment lines; empty if there are none."""
    header: Literal["row", "comment", "none"] = "row"
    """Place of the columns' names: the first row, the last comment line, or none."""
    units_row: bool = False
    """Whether a row of units follows the header."""
    missing: tuple[str, ...] = ("", "nan", "NaN")
    """Cells that become NaN: what the logger writes where a reading failed."""
    most_missing: Share = 0.01
    """Largest share of a column's cells that may be missing, and of the rows that may be skipped. More where a column
    has a lower rate than the rows."""
    extra_cells: Literal["refuse", "first", "last"] = "refuse"
    """Cells without a name: what every row has more than the header. `first` or `last`, as they stand there, leaves
    them out (R writes the rows' names first). A log whose rows fit its header is read as it is."""
    ragged: Literal["refuse", "skip", "dropped_variable"] = "refuse"
    """Treatment of rows whose length differs from the header's.

    `refuse`: the file is refused. `skip`: they are skipped and counted. `dropped_variable`, for a logger that omits a
    variable after it failed: from there on, the columns that were missing in the last complete row are NaN. A row that
    this does not explain is refused.
    """
    time: CsvTime
    """Where the time of a row comes from."""
    channels: dict[str, CsvChannel] = Field(min_length=1)
    """The column of each canonical column."""

    @model_validator(mode="after")
    def _units_below_header(self) -> "CsvSource":
        if self.units_row and self.header != "row":
            raise ValueError("a row of units needs a header row above it")
        return self

    @property
    def layout(self) -> CsvLayout:
        """How the logger writes its table."""
        return CsvLayout(
            self.delimiter,
            self.decimal,
            self.comment,
            self.header,
            self.units_row,
            self.missing,
            self.most_missing,
            self.extra_cells,
            self.ragged,
        )
