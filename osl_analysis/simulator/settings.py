"""The simulated campaign as a validated file, like `config/simulation/default.yaml`.

Choices only: the device's physical parameters stand in the parameter file that `parameters` names.
"""

from pathlib import Path
from typing import Annotated, Literal, Self

from pydantic import AfterValidator, Field, model_validator

from osl_analysis.yaml_settings import Settings

Positive = Annotated[float, Field(gt=0)]
NotNegative = Annotated[float, Field(ge=0)]
Count = Annotated[int, Field(ge=0)]
SAMPLES_PER_CYCLE = 10
"""Fewest samples of the bench's log in a cycle of the fastest sine that it is to follow."""
LONGEST_DELAY_S = 0.03
"""Of the control loop: with more, none of the study's impedances is stable (linear theory: 0.4 to 25 ms)."""


class Effect(Settings):
    """One imperfection: whether it acts, its size, and the unit of the size (`on` would be a truth value in YAML)."""

    enabled: bool
    size: NotNegative
    unit: str

    @property
    def value(self) -> float:
        """The size, or 0 where the effect is off."""
        return self.size if self.enabled else 0.0


def in_unit(unit: str) -> AfterValidator:
    """A check that an effect's size is given in `unit`."""

    def check(effect: Effect) -> Effect:
        if effect.unit != unit:
            raise ValueError(f"its unit must be '{unit}'")
        return effect

    return AfterValidator(check)


def whole_number(effect: Effect) -> Effect:
    """Refuse a size that is not a whole number."""
    if effect.size != int(effect.size):
        raise ValueError("its size must be a whole number")
    return effect


def positive(effect: Effect) -> Effect:
    """Refuse a size of 0, which would not mean "off"."""
    if effect.size == 0:
        raise ValueError("its size must be positive; set enabled: false to switch it off")
    return effect


class Effects(Settings):
    """Every imperfection of bench, drivetrain and controller; offset, drift and scatter are standard deviations.

    friction: true friction over what the parameter file says and the controller cancels; off: no friction,
        and none to cancel.
    control_delay: between a measurement and the current that answers it; size 0 still holds the current
        between the controller's updates, off is a continuous controller.
    velocity_filter: cut-off of the low-pass over the differentiated encoder; off: the true velocity.
    actuator_encoder, joint_encoder: resolution, the first at the actuator's output.
    load_cell_noise, current_noise: white, of that standard deviation at the log's rate.
    belt_hysteresis: torque by which loading and unloading differ from the elastic belt.
    belt_scatter: of K_s from trial to trial in the belt experiment.
    dynamometer_bandwidth: natural frequency with which the motor follows its command; off: it follows exactly.
    """

    friction: Annotated[Effect, in_unit("1")]
    control_delay: Annotated[Effect, in_unit("update"), AfterValidator(whole_number)]
    velocity_filter: Annotated[Effect, in_unit("Hz"), AfterValidator(positive)]
    actuator_encoder: Annotated[Effect, in_unit("rad")]
    joint_encoder: Annotated[Effect, in_unit("rad")]
    load_cell_noise: Annotated[Effect, in_unit("N*m")]
    load_cell_offset: Annotated[Effect, in_unit("N*m")]
    load_cell_drift: Annotated[Effect, in_unit("N*m/min")]
    load_cell_quantisation: Annotated[Effect, in_unit("N*m")]
    current_noise: Annotated[Effect, in_unit("A")]
    current_quantisation: Annotated[Effect, in_unit("A")]
    belt_hysteresis: Annotated[Effect, in_unit("N*m")]
    belt_scatter: Annotated[Effect, in_unit("1")]
    dynamometer_bandwidth: Annotated[Effect, in_unit("Hz"), AfterValidator(positive)]

    def without(self, *names: str) -> "Effects":
        """These effects with the named ones off, or with all off if none is named."""
        off = {
            name: getattr(self, name).model_copy(update={"enabled": False}) for name in names or type(self).model_fields
        }
        return self.model_copy(update=off)


class Experiments(Settings):
    """How many trials of each kind; an impedance trial per K_d [N*m/rad], B_d [N*m*s/rad] and controller.

    Each of the `walking` crossings is perturbed with likelihood `perturbed_share`; a `plate` trial is a
    perturbation with nobody on the platform.
    """

    belt: Count
    transmission: Count
    actuator: Count = 0
    K_d: tuple[Positive, ...]
    B_d: tuple[NotNegative, ...]
    controllers: tuple[Literal["compensated", "uncompensated"], ...]
    static: Count = 0
    plate: Count = 0
    walking: Count = 0
    perturbed_share: Annotated[float, Field(ge=0, le=1)] = 0.5

    @model_validator(mode="after")
    def _some(self) -> Self:
        impedance = len(self.K_d) * len(self.B_d) * len(self.controllers)
        bench = self.belt + self.transmission + self.actuator + impedance
        if not (bench + self.static + self.plate + self.walking):
            raise ValueError("no trials are planned; ask for at least one")
        return self


class SteppedSineSchedule(Settings):
    """At each amplitude [deg] `cycles` whole cycles at each frequency [Hz], then `rest_s` [s]; `lead_s` [s] first."""

    frequencies_hz: Annotated[tuple[Positive, ...], Field(min_length=1)]
    cycles: Annotated[int, Field(ge=1)]
    amplitudes_deg: Annotated[tuple[Positive, ...], Field(min_length=1)]
    rest_s: NotNegative
    lead_s: NotNegative


class BeltMotion(Settings):
    """The joint rests `rest_s` [s], turns by `amplitude_deg` and back in `ramp_s` [s] each, and rests again."""

    amplitude_deg: Positive
    ramp_s: Positive
    rest_s: NotNegative


class Tone(Settings):
    """One sine of a schedule, from phase 0: its frequency [Hz] and its size."""

    frequency_hz: Positive
    size: Positive


class ActuatorBench(Settings):
    """A bench turns the actuator's output while its current is commanded, for `duration_s` [s]; each a sum of sines.

    Sizes are rad/s and A; both begin and end in `fade_s` [s]. The frequencies must differ, so that the current both
    drives and brakes: that is what tells the gear's friction from the torque constant.
    """

    duration_s: Positive
    fade_s: Positive
    velocity: Annotated[tuple[Tone, ...], Field(min_length=1)]
    current: Annotated[tuple[Tone, ...], Field(min_length=1)]

    @model_validator(mode="after")
    def _fits(self) -> Self:
        if self.duration_s < 4 * self.fade_s:
            raise ValueError("duration_s must be at least four times fade_s")
        return self


class Dynamometer(Settings):
    """Rate [Hz] of the bench's log; damping ratio of the bench's position loop."""

    rate_hz: Positive
    damping_ratio: Positive


class Drivetrain(Settings):
    """How the drivetrain is integrated and controlled, and how fast the belt's hysteresis turns round [rad].

    Fine integration steps and controller's updates per sample; `sign_width` [rad/s], over which the controller
    smooths the sign of the actuator's velocity.
    """

    substeps: Annotated[int, Field(ge=1)]
    control_updates: Annotated[int, Field(ge=1)]
    sign_width: Positive
    hysteresis_width: Positive

    @model_validator(mode="after")
    def _even(self) -> Self:
        if self.substeps % self.control_updates:
            raise ValueError("control_updates must divide substeps")
        return self


class SimulationSettings(Settings):
    """A simulated campaign; `parameters` and `walking` are files, relative to the working directory."""

    seed: Annotated[int, Field(ge=0)]
    parameters: Path
    experiments: Experiments
    protocol: SteppedSineSchedule
    belt: BeltMotion
    dynamometer: Dynamometer
    drivetrain: Drivetrain
    effects: Effects
    actuator: ActuatorBench | None = None
    walking: Path | None = None

    @model_validator(mode="after")
    def _actuator_is_described(self) -> Self:
        if self.experiments.actuator and self.actuator is None:
            raise ValueError(f"{self.experiments.actuator} actuator trials are planned but 'actuator' has no schedule")
        return self

    @model_validator(mode="after")
    def _is_sampled_fast_enough(self) -> Self:
        rate, bandwidth = self.dynamometer.rate_hz, self.effects.dynamometer_bandwidth
        tones = () if self.actuator is None else (*self.actuator.velocity, *self.actuator.current)
        fastest = max((*self.protocol.frequencies_hz, *(tone.frequency_hz for tone in tones)))
        if rate < SAMPLES_PER_CYCLE * fastest:
            raise ValueError(
                f"dynamometer.rate_hz = {rate:g} Hz takes {rate / fastest:g} samples of a cycle at {fastest:g} Hz; "
                f"take {SAMPLES_PER_CYCLE * fastest:g} Hz or more"
            )
        if bandwidth.value >= rate / 2:
            raise ValueError(
                f"effects.dynamometer_bandwidth of {bandwidth.value:g} Hz does not show in a log of {rate:g} Hz; "
                f"choose less than {rate / 2:g} Hz, or enabled: false for a bench that follows exactly"
            )
        return self

    @model_validator(mode="after")
    def _controller_is_fast_enough(self) -> Self:
        velocity, delay = self.effects.velocity_filter, self.effects.control_delay
        per_sample = self.drivetrain.control_updates if delay.enabled else self.drivetrain.substeps
        updates = self.dynamometer.rate_hz * per_sample
        if velocity.value >= updates / 2:
            raise ValueError(
                f"effects.velocity_filter of {velocity.value:g} Hz does nothing in a controller of {updates:g} "
                f"updates/s; choose less than {updates / 2:g} Hz, or enabled: false for the true velocity"
            )
        longest = LONGEST_DELAY_S * updates
        if delay.value > longest:
            raise ValueError(
                f"effects.control_delay of {delay.value:g} updates is {1e3 * delay.value / updates:g} ms, with which "
                f"no impedance is stable; choose {longest:g} updates ({1e3 * LONGEST_DELAY_S:g} ms) or fewer"
            )
        return self

    @model_validator(mode="after")
    def _walking_is_described(self) -> Self:
        wanted = self.experiments.static + self.experiments.plate + self.experiments.walking
        if wanted and self.walking is None:
            raise ValueError(f"{wanted} gait-laboratory trials are planned but 'walking' names no settings file")
        return self
