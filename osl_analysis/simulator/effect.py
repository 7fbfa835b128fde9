"""An imperfection of the simulated laboratory: a switch, a size and the unit of the size."""

import math
from typing import Annotated, Literal

from pydantic import AfterValidator, Field

from osl_analysis.yaml_settings import Settings

Positive = Annotated[float, Field(gt=0)]
NotNegative = Annotated[float, Field(ge=0)]


class Effect(Settings):
    """One imperfection."""

    enabled: bool
    """Whether the imperfection is simulated. (The key is not `on`, which is a truth value in YAML.)"""
    size: NotNegative
    """Its size, in `unit`."""
    unit: str
    """The unit of the size. It must be one that the settings expect."""

    @property
    def value(self) -> float:
        """The size, or 0 where the effect is off."""
        return self.size if self.enabled else 0.0


class SignedEffect(Effect):
    """An imperfection whose size may be negative."""

    size: float
    """Its size, in `unit`."""


class Scatter(Effect):
    """A random imperfection, drawn for each sample."""

    distribution: Literal["normal", "half_normal", "exponential"] = "normal"
    """`normal` (size: standard deviation), `half_normal` (size: standard deviation of the normal distribution whose
    absolute value is taken) or `exponential` (size: mean)."""


class RegularGaps(Effect):
    """Gaps at nearly regular intervals, whose mean is the size."""

    scatter: Annotated[int, Field(ge=0)] = 0
    """Largest deviation of an interval from the mean [samples]."""


class Hum(Effect):
    """A sine whose amplitude is the size."""

    frequency_hz: Positive = 50.0
    """Frequency [Hz]."""


class SensorLowPass(Effect):
    """A causal Butterworth low-pass, whose cut-off is the size."""

    order: Annotated[int, Field(ge=1, le=4)] = 1
    """Order of the low-pass."""


class Encoder(Effect):
    """The step of an encoder, in rad or as bits per turn."""

    @property
    def value(self) -> float:
        """The step [rad], or 0 where the encoder is ideal."""
        return 2 * math.pi / 2**self.size if self.enabled and self.unit == "bit" else super().value


def off(unit: str, size: float = 0.0) -> Effect:
    """An effect that is switched off."""
    return Effect(enabled=False, size=size, unit=unit)


def in_unit(*units: str) -> AfterValidator:
    """A check that an effect's size is given in one of these units."""

    def check(effect: Effect) -> Effect:
        """Refuse another unit."""
        if effect.unit not in units:
            raise ValueError(f"its unit must be {' or '.join(repr(unit) for unit in units)}, not '{effect.unit}'")
        return effect

    return AfterValidator(check)


def whole_number(effect: Effect) -> Effect:
    """Refuse a size that is not a whole number."""
    if effect.size != int(effect.size):
        raise ValueError(f"its size is {effect.size:g}; give a whole number")
    return effect


def positive(effect: Effect) -> Effect:
    """Refuse a size of 0. Only `enabled: false` switches the effect off."""
    if effect.size == 0:
        raise ValueError("its size must be positive; set enabled: false to switch it off")
    return effect


def share(effect: Effect) -> Effect:
    """Refuse a share that is not below 1."""
    if effect.size >= 1:
        raise ValueError("its size is a share and must be less than 1")
    return effect


Seconds = Annotated[Effect, in_unit("s")]
Share = Annotated[Effect, in_unit("1"), AfterValidator(share)]
