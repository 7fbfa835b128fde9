"""The simulated campaign as a validated file, such as `config/simulation/default.yaml`.

It contains choices only. The device's physical parameters are in the file that `parameters` names.
"""

from typing import Annotated, Literal, Self

from pydantic import Field, model_validator
from pydantic_core import PydanticCustomError

from osl_analysis.shared_choices import PAPER, WeightSettings
from osl_analysis.simulator.condition_settings import Conditions
from osl_analysis.simulator.effect import NotNegative, Positive
from osl_analysis.simulator.effect_settings import Effects, SecondOrderJoint
from osl_analysis.simulator.excitations import Excitation
from osl_analysis.simulator.passive_foot import PassiveFoot
from osl_analysis.simulator.recorder_settings import RecorderSettings
from osl_analysis.simulator.schedules import ActuatorBench, BeltMotion, SteppedSineSchedule
from osl_analysis.yaml_settings import Settings, ShippedPath

Count = Annotated[int, Field(ge=0, le=100_000)]
SAMPLES_PER_CYCLE = 10
"""Smallest number of samples of the bench's log in one cycle of the fastest sine."""
MOST_SAMPLES = 10_000_000
"""Largest number of samples in a trial: nearly three hours at 1 kHz. More does not fit into memory, or is a slip."""
LONGEST_DELAY_S = 0.03
"""Longest delay [s] of the control loop. With a longer delay no impedance is stable (the limits by linear theory are
0.4 to 25 ms)."""


def check_length(place: str, duration_s: float, rate_hz: float) -> None:
    """Refuse a trial that lasts [s] for too many samples at a rate [Hz]; `place` is the field that decides it.

    Raises
    ------
    PydanticCustomError
        It has more than `MOST_SAMPLES`.
    """
    samples = duration_s * rate_hz
    if samples > MOST_SAMPLES:
        text = f"{duration_s:g} s at {rate_hz:g} Hz are {samples:.3g} samples; shorten it to {MOST_SAMPLES:g} samples"
        raise PydanticCustomError("too_many_samples", "{reason}", {"reason": text, "place": place.split(".")})


class Experiments(Settings):
    """How many trials of each experiment are simulated.

    There is one impedance trial for each stiffness, damping and controller.
    """

    belt: Count
    """Number of belt trials."""
    transmission: Count
    """Number of transmission trials."""
    actuator: Count = 0
    """Number of trials of the actuator's own bench."""
    torque_angle: Count = 0
    """Number of trials of a passive foot."""
    K_d: tuple[Positive, ...]
    """Desired stiffnesses [N*m/rad] of the impedance trials."""
    B_d: tuple[NotNegative, ...]
    """Desired dampings [N*m*s/rad] of the impedance trials."""
    controllers: tuple[Literal["compensated", "uncompensated"], ...]
    """Controllers of the impedance trials."""
    static: Count = 0
    """Number of static trials."""
    plate: Count = 0
    """Number of plate trials: a perturbation of the unloaded platform."""
    walking: Count = 0
    """Number of crossings."""
    perturbed_share: Annotated[float, Field(ge=0, le=1)] = 0.5
    """Probability that a crossing is perturbed."""
    conditions: Conditions = Conditions()
    """What crossings differ in by plan."""

    @model_validator(mode="after")
    def _some(self) -> Self:
        impedance = len(self.K_d) * len(self.B_d) * len(self.controllers)
        bench = self.belt + self.transmission + self.actuator + self.torque_angle + impedance
        if not (bench + self.static + self.plate + self.walking):
            raise ValueError("no trials are planned; ask for at least one")
        return self


class Dynamometer(Settings):
    """The dynamometer, and the log of every bench."""

    rate_hz: Positive
    """Rate [Hz] of the log."""
    damping_ratio: Positive
    """Damping ratio of the position loop."""


class Drivetrain(Settings):
    """How the drivetrain is integrated and controlled."""

    substeps: Annotated[int, Field(ge=1, le=1000)]
    """Integration steps per sample of the log."""
    control_updates: Annotated[int, Field(ge=1)]
    """Updates of the controller per sample of the log."""
    sign_width: Positive
    """Velocity [rad/s] of the actuator over which the controller smooths its sign."""
    hysteresis_width: Positive
    """Deflection [rad] over which the belt's hysteresis torque changes sign after a reversal."""

    @model_validator(mode="after")
    def _even(self) -> Self:
        if self.substeps % self.control_updates:
            raise ValueError("control_updates must divide substeps")
        return self


class SimulationSettings(Settings):
    """A simulated campaign. Files are relative to the working directory."""

    seed: Annotated[int, Field(ge=0)]
    """Seed of every random number."""
    parameters: ShippedPath
    """Parameter file of the simulated device."""
    experiments: Experiments
    """How many trials of each experiment."""
    protocol: SteppedSineSchedule
    """The stepped sine of transmission and impedance trials."""
    belt: BeltMotion
    """The motion of belt trials."""
    dynamometer: Dynamometer
    """The dynamometer."""
    drivetrain: Drivetrain
    """Integration and control of the drivetrain."""
    effects: Effects
    """Every imperfection of bench, drivetrain and controller."""
    recorder: RecorderSettings = RecorderSettings()
    """Imperfections of recorders and sensors."""
    joint: SecondOrderJoint | None = None
    """A second-order joint that replaces the drivetrain in every impedance trial; null: the drivetrain."""
    excitations: tuple[Excitation, ...] = ()
    """Motions of the impedance trials in place of the stepped sine; none: the stepped sine of `protocol`."""
    actuator: ActuatorBench | None = None
    """The schedule of actuator trials."""
    foot: PassiveFoot | None = None
    """The passive foot of torque-angle trials, and its motion."""
    walking: ShippedPath | None = None
    """Settings file of the gait laboratory."""
    gain_weight: WeightSettings = PAPER
    """W of Eq. 14, with which the leg's gains are selected. That of a campaign's configuration replaces it.

    So do its `parameters`, its `impedance_trajectory`, and the frequencies, amplitudes and cycles of `dynamometer`."""

    @model_validator(mode="after")
    def _excitations_have_names(self) -> Self:
        names = [one.name for one in self.excitations]
        if len(set(names)) < len(names):
            raise ValueError(f"excitations have the names {', '.join(names)}; give each a name of its own")
        return self

    def excitation_of(self, trial: str) -> Excitation | None:
        """The excitation of an impedance trial, by its name; None: the stepped sine."""
        found = (one for one in self.excitations if any(trial.endswith(f"_{end}") for end in one.trial_endings))
        return next(found, None)

    @model_validator(mode="after")
    def _actuator_is_described(self) -> Self:
        if self.experiments.actuator and self.actuator is None:
            raise ValueError(f"{self.experiments.actuator} actuator trials are planned but 'actuator' has no schedule")
        return self

    @model_validator(mode="after")
    def _foot_is_described(self) -> Self:
        if self.experiments.torque_angle and self.foot is None:
            raise ValueError(f"{self.experiments.torque_angle} torque-angle trials are planned but there is no 'foot'")
        return self

    @model_validator(mode="after")
    def _is_sampled_fast_enough(self) -> Self:
        rate, bandwidth = self.dynamometer.rate_hz, self.effects.dynamometer_bandwidth
        tones = () if self.actuator is None else (*self.actuator.velocity, *self.actuator.current)
        bands = (one.band_hz[1] for one in self.excitations)
        fastest = max((*self.protocol.frequencies_hz, *(tone.frequency_hz for tone in tones), *bands))
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
    def _ends(self) -> Self:
        durations = {"protocol": self.protocol.total_s, "belt": self.belt.total_s}
        if self.actuator is not None:
            durations["actuator"] = self.actuator.duration_s
        if self.foot is not None:
            durations["foot.cycles"] = self.foot.cycles.total_s
        durations |= {f"excitations.{one.name}": one.total_s for one in self.excitations}
        for name, duration in durations.items():
            check_length(name, duration, self.dynamometer.rate_hz)
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
