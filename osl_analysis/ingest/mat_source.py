"""The source file of a log in a MATLAB file."""

from typing import Literal

from pydantic import Field, field_validator, model_validator

from osl_analysis.formats.mat.address import Address, parsed
from osl_analysis.ingest.row_time import RowTime, Share
from osl_analysis.ingest.source_fields import Conversion, LogSource
from osl_analysis.ingest.unit_names import Unit


def checked_address(text: str | None) -> str | None:
    """The text of an address as it is; refused if it is none."""
    if text is not None:
        parsed(text, inside=True)
    return text


class MatChannel(Conversion):
    """One variable. A MATLAB file states no units, so that each channel needs one."""

    variable: str
    """Its address in MATLAB's notation: `torque`, `Test.run(2).torque`, `data(:,3)`, `runs{2}.torque`. It is within
    `log_part`, unless it begins with `/`."""
    unit: Unit
    """Unit of the numbers, as laboratories spell it."""
    counter: str | None = None
    """Address of the device's count of its samples. It tells which samples are missing."""

    @field_validator("variable", "counter")
    @classmethod
    def _is_address(cls, text: str | None) -> str | None:
        return checked_address(text)


class MatTime(RowTime):
    """Where the time of a sample comes from: a variable, or the rate."""

    variable: str | None = None
    """Address of the variable that holds time, as in `channels`."""

    @field_validator("variable")
    @classmethod
    def _is_address(cls, text: str | None) -> str | None:
        return checked_address(text)

    @model_validator(mode="after")
    def _one(self) -> "MatTime":
        if (self.variable is None) == (self.rate is None):
            raise ValueError(
                "state either the variable that holds time, with its unit, or the rate of the samples [Hz]"
            )
        if (self.variable is None) != (self.unit is None):
            raise ValueError("a variable of time needs its unit, and a rate has none; write as {variable: t, unit: s}")
        return self


class MatSource(LogSource):
    """A log in a MATLAB file of version 5 (`save -v6`, `-v7`) or 7.3."""

    format: Literal["mat"]
    """Format of the file."""
    log_part: str = ""
    """Address of the struct or cell that holds the trial, where the file holds several. That of the sample
    sheet replaces it."""
    most_missing: Share = 0.01
    """Largest share of a variable's numbers that may be NaN."""
    time: MatTime
    """Where the time of a sample comes from."""
    channels: dict[str, MatChannel] = Field(min_length=1)
    """The variable of each canonical column."""

    @field_validator("log_part")
    @classmethod
    def _is_part(cls, text: str) -> str:
        if text:
            parsed(text)
        return text

    def address(self, text: str) -> Address:
        """An address of the source file within the part of the trial."""
        part = parsed(self.log_part) if self.log_part else None
        return parsed(text, inside=part is not None and not text.startswith("/")).below(part)
