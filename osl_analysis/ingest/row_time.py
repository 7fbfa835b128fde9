"""Time of the rows of a log that is one table: what a source file states of it, and what is said of its stamps."""

from dataclasses import dataclass
from functools import cached_property
from typing import Annotated, Any, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, PositiveFloat, field_validator

from osl_analysis.errors import InputError
from osl_analysis.ingest.sensor import Stamps
from osl_analysis.ingest.unit_names import TimeUnit
from osl_analysis.ingest.units import si_factor
from osl_analysis.trial import Array, check_time
from osl_analysis.yaml_settings import Settings

Share = Annotated[float, Field(ge=0, le=1)]


class RowTime(Settings):
    """What a source file may state of the time of rows, besides where it stands."""

    unit: TimeUnit | None = None
    """Unit of the numbers that are time."""
    rate: PositiveFloat | None = None
    """Rows per second [Hz], for a file without time."""
    repeated: Literal["keep", "drop"] = "keep"
    """Rows whose stamp is that of the row before. `keep`: they are samples whose stamps were rounded. `drop`: the
    recorder read a device faster than it sampled; only the first row of each stamp is used."""
    stamps: Stamps = "auto"
    """How the stamps are taken."""

    @field_validator("unit")
    @classmethod
    def _of_time(cls, unit: str | None) -> str | None:
        if unit is not None:
            si_factor(unit, "s")
        return unit


@dataclass(frozen=True)
class RowStamps:
    """The stamps of the rows of a file."""

    time: Array
    """Time (rows,) [s] since the first row."""
    stated: RowTime
    """What the source file states of it."""

    @cached_property
    def fresh(self) -> NDArray[np.bool_]:
        """Rows whose stamp is not that of the row before, (rows,)."""
        return np.concatenate([[True], np.diff(self.time) != 0])

    @property
    def kept(self) -> NDArray[np.bool_]:
        """Rows that are used, (rows,)."""
        return self.fresh if self.stated.repeated == "drop" else np.ones_like(self.fresh)

    @property
    def repeats(self) -> int:
        """Number of rows that repeat the stamp of the row before."""
        return int((~self.fresh).sum())

    def facts(self, file: str, start: float) -> dict[str, Any]:
        """What is known of the time of a file, for the trial's provenance; `start` is the clock's first reading."""
        return {
            "time": {**self.stated.model_dump(exclude_none=True), "start": start},
            "rates_hz": {file: median_rate(self.time[self.kept])},
            "repeated_stamps": self.repeats,
        }

    def repeats_text(self, repeats: str, place: str) -> list[str]:
        """A warning of what was done with rows that repeat a stamp, if there are any.

        `repeats` is a sentence that counts them, `place` is where the source file states the time.
        """
        if not self.repeats:
            return []
        if self.stated.repeated == "drop":
            return [f"{repeats} and were left out"]
        return [
            f"{repeats} and are taken for samples whose stamps were rounded; if the device was read faster than it "
            f"sampled, write `repeated: drop` under {place}"
        ]


def median_rate(time: Array) -> float | None:
    """Median sampling rate [Hz] of stamps (n,) [s]; None for a single row, or if most rows repeat a stamp."""
    step = float(np.median(np.diff(time))) if time.size > 1 else 0.0
    return 1 / step if step > 0 else None


def since_first(raw: NDArray[Any], factor: float, what: str, advice: str) -> Array:
    """Time (n,) [s] since the first reading of a clock, from its readings (n,) and their unit [s].

    Raises
    ------
    InputError
        Time goes back, or stands still; `what` begins the message, and `advice` ends it where time stands still.
    """
    time = np.asarray((raw - raw[0]) * factor, dtype=np.float64)
    check_time(what, time)
    if time.size > 1 and time[0] == time[-1]:
        raise InputError(f"{what}: time stands still at {raw[0]:g} in all {time.size} {advice}")
    return time
