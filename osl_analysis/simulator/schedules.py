"""Commands of the simulated benches: stepped sine, belt motion, the actuator's velocity and current."""

from typing import Annotated, Literal, Self

from pydantic import Field, model_validator

from osl_analysis.simulator.effect import (
    Effect,
    NotNegative,
    Positive,
    Share,
    SignedEffect,
    in_unit,
    off,
)
from osl_analysis.yaml_settings import Degrees, Settings

Cycles = Annotated[int, Field(ge=1, le=10_000)]


class SteppedSineSchedule(Settings):
    """`lead_s` of rest, then a block per amplitude: each frequency in the given order, then `rest_s` of rest.

    The fields from `rest_between_s` on describe other protocols and imperfections of the motion.
    """

    frequencies_hz: Annotated[tuple[Positive, ...], Field(min_length=1)]
    """Frequencies [Hz] in the order in which they are run."""
    cycles: Cycles | tuple[Cycles, ...] | None = None
    """Whole cycles at each frequency: one number for all, or one for each; null: see `seconds`."""
    seconds: Positive | None = None
    """Duration [s] of each frequency in place of `cycles`."""
    amplitudes_deg: Annotated[tuple[Degrees, ...], Field(min_length=1)]
    """Amplitudes [deg] in the order in which they are run."""
    rest_s: NotNegative
    """Rest [s] after each amplitude."""
    lead_s: NotNegative
    """Rest [s] before the first amplitude."""
    rest_between_s: NotNegative = 0.0
    """Rest [s] after each frequency."""
    ramp_s: NotNegative = 0.0
    """Time [s] in which the amplitude of each frequency rises from 0, and falls to 0, in addition to its cycles."""
    start: Literal["sine", "cosine"] = "sine"
    """Start of each frequency: at the angle 0 (`sine`), or with a jump of the command to the amplitude (`cosine`)."""
    second_harmonic: Share = off("1")
    """Amplitude of the second harmonic of the motion, as a share of the first."""
    third_harmonic: Share = off("1")
    """Amplitude of the third harmonic of the motion, as a share of the first."""
    decay: Annotated[Effect, in_unit("1/s")] = off("1/s")
    """Rate at which the amplitude decays from the start of each frequency."""
    clock_error: Annotated[SignedEffect, in_unit("ppm")] = SignedEffect(enabled=False, size=0, unit="ppm")
    """Rate error of the clock that generates the motion. A positive error raises frequencies and shortens durations."""

    @model_validator(mode="after")
    def _duration_is_stated_once(self) -> Self:
        if (self.cycles is None) == (self.seconds is None):
            raise ValueError("state either cycles or seconds at each frequency")
        if isinstance(self.cycles, tuple) and len(self.cycles) != len(self.frequencies_hz):
            raise ValueError(
                f"{len(self.cycles)} numbers of cycles for {len(self.frequencies_hz)} frequencies; give one for each"
            )
        return self

    @property
    def durations(self) -> tuple[float, ...]:
        """Time [s] at full amplitude of each frequency, by the clock that generates the motion."""
        if self.seconds is not None:
            return (self.seconds,) * len(self.frequencies_hz)
        assert self.cycles is not None  # as was checked
        cycles = self.cycles if isinstance(self.cycles, tuple) else (self.cycles,) * len(self.frequencies_hz)
        return tuple(n / f for n, f in zip(cycles, self.frequencies_hz, strict=True))

    @property
    def total_s(self) -> float:
        """Duration [s] of a trial."""
        beside = self.rest_between_s + 2 * self.ramp_s
        block = sum(self.durations) + beside * len(self.frequencies_hz) + self.rest_s
        return self.lead_s + block * len(self.amplitudes_deg)


class BeltMotion(Settings):
    """The motion of the belt experiment: a rest, a turn and back, and a rest."""

    amplitude_deg: Degrees
    """Angle [deg] of the turn."""
    ramp_s: Positive
    """Duration [s] of the turn, and of the return."""
    rest_s: NotNegative
    """Duration [s] of each rest."""

    @property
    def total_s(self) -> float:
        """Duration [s] of a trial."""
        return 2 * (self.ramp_s + self.rest_s)


class Tone(Settings):
    """One sine of a schedule. It starts at phase 0."""

    frequency_hz: Positive
    """Frequency [Hz]."""
    size: Positive
    """Amplitude, in the unit of the schedule."""


class ActuatorBench(Settings):
    """The schedule of the actuator's own bench, which turns the output while the current is commanded.

    Velocity and current are sums of sines. Their frequencies must differ, so that the current both drives and brakes.
    Otherwise gear friction and torque constant cannot be told apart.
    """

    duration_s: Positive
    """Duration [s] of a trial."""
    fade_s: Positive
    """Time [s] in which velocity and current fade in and out."""
    velocity: Annotated[tuple[Tone, ...], Field(min_length=1)]
    """Velocity of the output, sizes in rad/s."""
    current: Annotated[tuple[Tone, ...], Field(min_length=1)]
    """q-axis current, sizes in A."""

    @model_validator(mode="after")
    def _fits(self) -> Self:
        if self.duration_s < 4 * self.fade_s:
            raise ValueError("duration_s must be at least four times fade_s")
        return self
