"""Properties of a channel's sensor (delay, low-pass, resolution, range) and of a recorder's stamps in a source file."""

from typing import Any, Literal

import numpy as np
from pydantic import Field, field_validator

from osl_analysis.errors import InputError
from osl_analysis.ingest.units import quantity
from osl_analysis.yaml_settings import Settings

Stamps = Literal["auto", "exact", "even"]
"""How stamps are taken (docs/time_base.md). `exact`: each sample was taken at its stamp. `even`: the device samples
evenly, and only the stamps scatter. `auto`: stamps and signals decide."""


HIGHEST_ORDER = 8
"""Highest order of a sensor's low-pass that is accepted."""


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

        Raises
        ------
        InputError
            Resolution or range are not positive or of another dimension, or bits are stated for a signal that is not
            an angle.
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
