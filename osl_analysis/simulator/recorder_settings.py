"""What recorders and sensors of a simulated bench do to true signals. Everything is off unless it is switched on."""

from typing import Annotated, Literal, Self

from pydantic import AfterValidator, Field, model_validator

from osl_analysis.simulator.effect import (
    Effect,
    RegularGaps,
    Scatter,
    Seconds,
    SensorLowPass,
    Share,
    SignedEffect,
    in_unit,
    off,
    positive,
    whole_number,
)
from osl_analysis.yaml_settings import Settings

Channel = Literal[
    "joint_angle", "actuator_angle", "commanded_angle", "motor_current", "load_cell_torque", "output_torque"
]
"""Channels of the benches' logs."""
WholeSamples = Annotated[Effect, in_unit("sample"), AfterValidator(whole_number), AfterValidator(positive)]
NO_SCATTER = Scatter(enabled=False, size=0, unit="s")
NO_CLOCK_ERROR = SignedEffect(enabled=False, size=0, unit="s")


class NodeSettings(Settings):
    """How one node samples its channels, and what stamps it writes."""

    rate: Annotated[Effect, in_unit("Hz"), AfterValidator(positive)] = off("Hz", 1.0)
    """Rate of the node; off: dynamometer.rate_hz."""
    phase: Seconds = off("s")
    """How much later than the other node it takes each sample. The stamps say so."""
    jitter: Annotated[Scatter, in_unit("s")] = NO_SCATTER
    """True jitter: each sample is taken so much off the even instant. The stamps are those of the samples."""
    latency: Annotated[Scatter, in_unit("s")] = NO_SCATTER
    """False jitter: samples are taken at even instants, and the host stamps each so much later."""
    clock_offset: Annotated[SignedEffect, in_unit("s")] = NO_CLOCK_ERROR
    """What the node's clock shows when the bench's shows 0."""
    clock_drift: Annotated[SignedEffect, in_unit("ppm")] = SignedEffect(enabled=False, size=0, unit="ppm")
    """How much faster than the bench's the node's clock runs."""
    decimals: Annotated[Effect, in_unit("decimal"), AfterValidator(whole_number)] = off("decimal")
    """Decimals of a second with which stamps are written."""
    dropped: Share = off("1")
    """Share of the samples that are missing, at drawn places; at least one gap."""
    burst: WholeSamples = off("sample", 1.0)
    """Missing samples in a row; off: one."""
    lost_every: Annotated[RegularGaps, in_unit("sample"), AfterValidator(whole_number), AfterValidator(positive)] = (
        RegularGaps(enabled=False, size=100, unit="sample")
    )
    """Interval between regular gaps of `burst` missing samples, from the beginning of one to that of the next."""
    duplicated: Share = off("1")
    """Share of the samples that are written twice, with the same stamp."""

    @model_validator(mode="after")
    def _is_never_early(self) -> Self:
        if self.latency.enabled and self.latency.distribution == "normal":
            raise ValueError("latency is never negative; choose distribution: half_normal or exponential")
        return self


class SensorSettings(Settings):
    """What one sensor makes of its true signal, in the order in which it happens."""

    low_pass: Annotated[SensorLowPass, in_unit("Hz"), AfterValidator(positive)] = SensorLowPass(
        enabled=False, size=1, unit="Hz"
    )
    """The sensor's own low-pass."""
    delay: Seconds = off("s")
    """How old a value is at the instant at which it is sampled."""
    clipping: Annotated[Effect, in_unit("N*m", "rad", "A"), AfterValidator(positive)] = off("N*m", 1.0)
    """Largest value in size that the sensor gives, noise and offset included."""
    adc: Annotated[Effect, in_unit("bit"), AfterValidator(whole_number)] = off("bit")
    """Bits of the converter, whose range is from minus to plus `clipping`."""
    failed: Share = off("1")
    """Share of the readings that fail, at drawn places: the log has NaN there."""
    gain: Annotated[SignedEffect, in_unit("1")] = SignedEffect(enabled=False, size=1, unit="1")
    """What the recorder multiplies a value with by mistake: a wrong unit or sign."""

    @model_validator(mode="after")
    def _converter_has_a_range(self) -> Self:
        if self.adc.enabled and not self.clipping.enabled:
            raise ValueError("adc needs the range of the converter; enable clipping and give it")
        return self


class RecorderSettings(Settings):
    """Who writes the log of a bench."""

    node: NodeSettings = NodeSettings()
    """The node of all channels, or of all but the torque where `torque_node` is not null."""
    torque_node: NodeSettings | None = None
    """A node of the torque's own, with its own stamps; null: one message has all channels."""
    sensors: dict[Channel, SensorSettings] = Field(default_factory=dict)
    """Faults of sensors, by channel."""

    def sensor(self, channel: str) -> SensorSettings:
        """What the sensor of a channel does."""
        return next((sensor for name, sensor in self.sensors.items() if name == channel), SensorSettings())
