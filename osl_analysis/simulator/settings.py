"""The simulated campaign as a validated file, such as `config/simulation/default.yaml`: choices only.

The device's physical parameters are in the file that `parameters` names. An imperfection is an `Effect`: a switch, a
size and the unit of the size. All effects of recorders and sensors are off unless they are switched on.
"""

import math
import zlib
from typing import Annotated, Any, Literal, Self

import numpy as np
from pydantic import AfterValidator, Field, model_validator
from pydantic_core import PydanticCustomError

from osl_analysis.config.shared_choices import WEIGHT_OF_PAPER, WeightSettings
from osl_analysis.yaml_settings import Degrees, NotNegative, Positive, Settings, ShippedPath


class Effect(Settings):
    """One imperfection. (The key is not `on`, which is a truth value in YAML.)"""

    enabled: bool
    size: NotNegative  # in `unit`, which must be one that the settings expect
    unit: str

    @property
    def value(self) -> float:
        """The size, or 0 where the effect is off; that of bits per turn is the step [rad] of an encoder."""
        if not self.enabled:
            return 0.0
        return 2 * math.pi / 2**self.size if self.unit == "bit" else self.size


class SignedEffect(Effect):
    """An imperfection whose size may be negative."""

    size: float


class Scatter(Effect):
    """A random imperfection, drawn for each sample. The size is the standard deviation of a `normal` distribution, that
    of the normal one whose absolute value is taken (`half_normal`), or the mean (`exponential`)."""

    distribution: Literal["normal", "half_normal", "exponential"] = "normal"


class RegularGaps(Effect):
    """Gaps at nearly regular intervals, whose mean is the size."""

    scatter: Annotated[int, Field(ge=0)] = 0  # largest deviation of an interval from the mean [samples]


class Hum(Effect):
    """A sine whose amplitude is the size."""

    frequency_hz: Positive = 50.0


class LowPassEffect(Effect):
    """A causal Butterworth low-pass, whose cut-off is the size."""

    order: Annotated[int, Field(ge=1, le=4)] = 1


def off(unit: str, size: float = 0.0) -> Any:
    """An effect that is switched off, of any kind."""
    return Field(default={"enabled": False, "size": size, "unit": unit}, validate_default=True)


def sized(*units: str, whole: bool = False, above_0: bool = False, below_1: bool = False) -> AfterValidator:
    """A check that an effect's size is given in one of these units, and of what kind it is. Only `enabled: false`
    switches an effect off whose size is above 0."""

    def check(effect: Effect) -> Effect:
        if effect.unit not in units:
            raise ValueError(f"its unit must be {' or '.join(repr(unit) for unit in units)}, not '{effect.unit}'")
        if whole and effect.size != int(effect.size):
            raise ValueError(f"its size is {effect.size:g}; give a whole number")
        if above_0 and effect.size == 0:
            raise ValueError("its size must be positive; set enabled: false to switch it off")
        if below_1 and effect.size >= 1:
            raise ValueError("its size is a share and must be less than 1")
        return effect

    return AfterValidator(check)


Seconds = Annotated[Effect, sized("s")]
Torque = Annotated[Effect, sized("N*m")]
Ratio = Annotated[Effect, sized("1")]
ShareEffect = Annotated[Effect, sized("1", below_1=True)]
Hertz = Annotated[Effect, sized("Hz", above_0=True)]
AngleStep = Annotated[Effect, sized("rad", "bit")]  # of an encoder
RampDirection = Literal["up", "down"]
StatedColumn = Literal["K_d", "B_d", "direction", "subject", "session", "side", "group", "body_mass_kg"]


class Subject(Settings):
    """A person, by the name in sample sheet and capture. What is left out is that of the gait laboratory's settings."""

    name: str
    body_mass_kg: Positive | None = None
    stance_s: Positive | None = None


class Conditions(Settings):
    """Lists of which each crossing gets one entry. An empty list leaves the settings of the gait laboratory. In n
    successive crossings, n being the number of combinations, each combination of direction, K_d, B_d and stance_phase
    occurs once, in a random order. Subjects and sessions follow each other in equal blocks."""

    directions: Annotated[tuple[RampDirection, ...], Field(min_length=1)] = ("up",)  # up: toes up, dorsiflexion
    K_d: tuple[Positive, ...] = ()  # largest desired stiffness [N*m/rad]; the whole trajectory is scaled
    B_d: tuple[NotNegative, ...] = ()  # largest desired damping [N*m*s/rad]; the whole trajectory is scaled
    stance_phases: tuple[Annotated[float, Field(ge=0, lt=1)], ...] = ()  # mean phase at which the ramp is commanded
    subjects: tuple[Subject, ...] = ()
    sessions: Annotated[int, Field(ge=1)] = 1  # of each person, with markers attached anew (`marker_placement`)
    side: Literal["left", "right"] = "right"  # that the sheet states; the simulated leg is the right one
    stated: tuple[StatedColumn, ...] = ()  # columns of the sheet that state the condition of a crossing


class SwitchedEffects(Settings):
    """Effects by name, each with its switch."""

    def without(self, *names: str) -> Self:
        """These effects with the named ones off, or with all off if none is named."""
        names = names or tuple(type(self).model_fields)
        return self.model_copy(update={n: getattr(self, n).model_copy(update={"enabled": False}) for n in names})


class Effects(SwitchedEffects):
    """Every imperfection of bench, drivetrain and controller. Noise is white at the rate of the log, sizes are SDs."""

    friction: Ratio  # true friction over the parameter file's, which the controller cancels; off: none at all
    control_delay: Annotated[Effect, sized("update", whole=True)]
    """From a measurement to its current [updates of the controller]. 0: held for one update; off: continuous."""
    velocity_filter: Hertz  # low-pass over the differentiated encoder; off: the controller gets the true velocity
    actuator_encoder: AngleStep  # resolution, at the actuator's output
    joint_encoder: AngleStep  # resolution
    load_cell_noise: Torque
    load_cell_offset: Torque  # constant over a trial
    load_cell_drift: Annotated[Effect, sized("N*m/min")]  # constant over a trial
    load_cell_quantisation: Torque  # resolution
    current_noise: Annotated[Effect, sized("A")]
    current_quantisation: Annotated[Effect, sized("A")]  # resolution
    belt_hysteresis: Torque  # largest torque by which loading and unloading differ from the elastic belt
    belt_scatter: Ratio  # of K_s from trial to trial in the belt experiment
    dynamometer_bandwidth: Hertz  # natural frequency of the position loop; off: the command is followed exactly
    mount_stiffness: Annotated[Effect, sized("N*m/rad", above_0=True)] = off("N*m/rad", 1)  # of the bench's frame
    load_cell_hum: Annotated[Hum, sized("N*m")] = off("N*m")  # of the mains
    load_cell_flicker: Torque = off("N*m")  # 1/f noise within each decade of frequency
    encoder_zero: Annotated[Effect, sized("step")] = off("step")  # largest distance of the joint's, drawn per trial


class SecondOrderJoint(Settings):
    """A joint with the torque of Eq. 15, in place of the drivetrain, and deviations from Eq. 15. Backlash is between
    bench and joint. Inside the gap the joint moves freely. The contact at an end is plastic."""

    K: Positive
    B: NotNegative
    I: NotNegative
    stiffening: Annotated[Effect, sized("1/rad^2")] = off("1/rad^2")  # the spring has K theta (1 + size theta^2)
    coulomb: Torque = off("N*m")  # Coulomb friction of the joint
    backlash: Annotated[Effect, sized("rad")] = off("rad")  # width of the gap, from end to end

    @model_validator(mode="after")
    def _gap_is_computed_for_a_linear_joint(self) -> Self:
        if self.backlash.value and not self.I:
            raise ValueError("backlash needs an inertia I above 0")
        return self


CyclesOfSine = Annotated[int, Field(ge=1, le=10_000)]


class SteppedSineSchedule(Settings):
    """`lead_s` of rest, then a block per amplitude: each frequency in the given order, then `rest_s` of rest. The
    fields from `rest_between_s` on describe other protocols and imperfections of the motion."""

    frequencies_hz: Annotated[tuple[Positive, ...], Field(min_length=1)]
    cycles: CyclesOfSine | tuple[CyclesOfSine, ...] | None = None  # at each frequency: one number, or one for each
    seconds: Positive | None = None  # duration of each frequency in place of `cycles`
    amplitudes_deg: Annotated[tuple[Degrees, ...], Field(min_length=1)]
    rest_s: NotNegative  # after each amplitude
    lead_s: NotNegative  # rest before the first amplitude
    rest_between_s: NotNegative = 0.0  # after each frequency
    ramp_s: NotNegative = 0.0  # in which each frequency grows from 0, and falls to 0, in addition to its cycles
    start: Literal["sine", "cosine"] = "sine"  # at the angle 0, or with a jump of the command to the amplitude
    second_harmonic: ShareEffect = off("1")  # of the motion, as a share of the first
    third_harmonic: ShareEffect = off("1")
    decay: Annotated[Effect, sized("1/s")] = off("1/s")  # of the amplitude from the start of each frequency
    clock_error: Annotated[SignedEffect, sized("ppm")] = off("ppm")  # a positive one raises frequencies

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
    ramp_s: Positive  # of the turn, and of the return
    rest_s: NotNegative

    @property
    def total_s(self) -> float:
        """Duration [s] of a trial."""
        return 2 * (self.ramp_s + self.rest_s)


class Tone(Settings):
    """One sine of a schedule, in the unit of the schedule. It starts at phase 0."""

    frequency_hz: Positive
    size: Positive


class ActuatorBench(Settings):
    """The schedule of the actuator's own bench. Velocity and current have different frequencies, so that
    the current both drives and brakes: else gear friction and torque constant cannot be told apart."""

    duration_s: Positive
    fade_s: Positive  # in which velocity and current fade in and out
    velocity: Annotated[tuple[Tone, ...], Field(min_length=1)]  # of the output [rad/s]
    current: Annotated[tuple[Tone, ...], Field(min_length=1)]  # q-axis [A]

    @model_validator(mode="after")
    def _fits(self) -> Self:
        if self.duration_s < 4 * self.fade_s:
            raise ValueError("duration_s must be at least four times fade_s")
        return self


BenchChannel = Literal[
    "joint_angle", "actuator_angle", "commanded_angle", "motor_current", "load_cell_torque", "output_torque"
]


class NodeSettings(Settings):
    """How one node samples its channels, and what stamps it writes."""

    rate: Hertz = off("Hz", 1.0)  # off: dynamometer.rate_hz
    phase: Seconds = off("s")  # how much later than the other node it takes each sample; the stamps say so
    jitter: Annotated[Scatter, sized("s")] = off("s")  # true: samples are taken off the even instants, and stamped so
    latency: Annotated[Scatter, sized("s")] = off(
        "s"
    )  # false: samples are even, and the host stamps each so much later
    clock_offset: Annotated[SignedEffect, sized("s")] = off("s")  # what the node's clock shows when the bench's shows 0
    clock_drift: Annotated[SignedEffect, sized("ppm")] = off("ppm")  # how much faster than the bench's it runs
    decimals: Annotated[Effect, sized("decimal", whole=True)] = off("decimal")  # of stamps in s
    dropped: ShareEffect = off("1")  # share of the samples that are missing, at drawn places; at least one gap
    burst: Annotated[Effect, sized("sample", whole=True, above_0=True)] = off("sample", 1)  # in a row; off: one
    lost_every: Annotated[RegularGaps, sized("sample", whole=True, above_0=True)] = off(
        "sample", 100
    )  # of `burst` each
    duplicated: ShareEffect = off("1")  # share of the samples that are written twice, with the same stamp

    @model_validator(mode="after")
    def _is_never_early(self) -> Self:
        if self.latency.enabled and self.latency.distribution == "normal":
            raise ValueError("latency is never negative; choose distribution: half_normal or exponential")
        return self


class SensorSettings(Settings):
    """What one sensor makes of its true signal, in the order in which it happens."""

    low_pass: Annotated[LowPassEffect, sized("Hz", above_0=True)] = off("Hz", 1)
    delay: Seconds = off("s")  # how old a value is at the instant at which it is sampled
    clipping: Annotated[Effect, sized("N*m", "rad", "A", above_0=True)] = off("N*m", 1)  # largest value in size
    adc: Annotated[Effect, sized("bit", whole=True)] = off("bit")  # from minus to plus `clipping`
    failed: ShareEffect = off("1")  # share of the readings that fail, at drawn places: the log has NaN there
    gain: Annotated[SignedEffect, sized("1")] = off("1", 1)  # of the recorder by mistake: a wrong unit or sign

    @model_validator(mode="after")
    def _converter_has_a_range(self) -> Self:
        if self.adc.enabled and not self.clipping.enabled:
            raise ValueError("adc needs the range of the converter; enable clipping and give it")
        return self


class RecorderSettings(Settings):
    """Who writes the log of a bench: one node, or two, of which the second has the torque alone."""

    node: NodeSettings = NodeSettings()
    torque_node: NodeSettings | None = None
    sensors: dict[BenchChannel, SensorSettings] = Field(default_factory=dict)

    def sensor(self, channel: str) -> SensorSettings:
        """What the sensor of a channel does."""
        return next((sensor for name, sensor in self.sensors.items() if name == channel), SensorSettings())


class Excitation(Settings):
    """One motion of the joint, and how many trials of each impedance have it. Each trial has random numbers of its own.

    multisine: odd lines of a period with random phases, one in four left out; chirp: a linear sweep; noise: Gaussian,
    flat within the band; prbs: a random binary sequence; ramps: constant velocities between random angles; hand: slow
    noise that wanders in size.
    """

    name: Annotated[str, Field(pattern=r"^[A-Za-z][A-Za-z0-9]{0,30}$")]  # a part of the names of its trials
    kind: Literal["multisine", "chirp", "noise", "prbs", "ramps", "hand"]
    rms_deg: Degrees  # of a binary sequence half its step, of ramps a third of their range
    band_hz: tuple[Positive, Positive] = (0.5, 6.0)  # a binary sequence and ramps have none
    duration_s: Positive = 60.0  # at full size; of a multisine see `periods`
    period_s: Positive = 8.0  # of a multisine
    periods: Annotated[int, Field(ge=1, le=1000)] = 5  # of each realisation of a multisine
    realisations: Annotated[int, Field(ge=1, le=100)] = 1  # motions in one recording, each of other random numbers
    trials: Annotated[int, Field(ge=1, le=1000)] = 1
    clock_s: Positive = 0.1  # between two changes of a binary sequence, or of the velocity of ramps
    smoothing_hz: Positive | None = None  # cut-off of the low-pass over a binary sequence; null: it jumps
    fade_s: Positive = 1.0  # in which the motion grows, and goes back to rest, in addition to its duration
    rest_s: NotNegative = 1.5  # before and after each motion

    @model_validator(mode="after")
    def _band_rises(self) -> Self:
        if self.band_hz[0] >= self.band_hz[1]:
            raise ValueError(
                f"band_hz goes from {self.band_hz[0]:g} to {self.band_hz[1]:g} Hz; write the lower one first"
            )
        return self

    @property
    def full_s(self) -> float:
        """Duration [s] of one realisation at full size."""
        return self.period_s * self.periods if self.kind == "multisine" else self.duration_s

    @property
    def total_s(self) -> float:
        """Duration [s] of a trial."""
        return self.rest_s + self.realisations * (self.full_s + 2 * self.fade_s + self.rest_s)

    @property
    def trial_endings(self) -> list[str]:
        """Endings of the names of its trials."""
        return [f"{self.name}_{number + 1}" for number in range(self.trials)]


class SlippingSpring(Settings):
    """A spring in series with dry friction. CyclesOfSine of amplitude A lose 4 limit (A - limit/stiffness)."""

    stiffness: Positive  # [N*m/rad], until it slips
    limit: Positive  # torque [N*m] at which it slips


class SlowCycles(Settings):
    """Ramps at one speed from rest at 0 to the lowest angle, to the highest, and so on, and back to rest at 0."""

    lowest_deg: Annotated[float, Field(ge=-60, le=0)]
    highest_deg: Annotated[float, Field(gt=0, le=60)]
    speed_deg_s: Annotated[tuple[Positive, ...], Field(min_length=1)]  # of each cycle
    turn_s: Positive  # in which the motion turns at the end of a ramp
    rest_s: Positive  # before and after

    @property
    def total_s(self) -> float:
        """Duration [s] of a trial."""
        way = 2 * (self.highest_deg - self.lowest_deg)
        return 2 * self.rest_s + sum(way / speed for speed in self.speed_deg_s)


class PassiveFoot(Settings):
    """The foot of torque-angle trials, a spring K theta (1 + stiffening theta^2), and how it is moved."""

    K: Positive
    stiffening: NotNegative = 0.0  # [1/rad^2]
    B: NotNegative = 0.0
    slipping: tuple[SlippingSpring, ...] = ()  # parallel to it
    cycles: SlowCycles

    @model_validator(mode="after")
    def _slips_on_the_way(self) -> Self:
        half = np.deg2rad(self.cycles.highest_deg - self.cycles.lowest_deg) / 2
        for spring in self.slipping:
            if spring.limit / spring.stiffness >= half:
                raise ValueError(
                    f"a spring of {spring.stiffness:g} N*m/rad does not reach its limit of {spring.limit:g} N*m on the "
                    "way from the lowest to the highest angle; lower the limit, or leave it out"
                )
        return self


Count = Annotated[int, Field(ge=0, le=100_000)]


def check_length(place: str, duration_s: float, rate_hz: float) -> None:
    """Refuse a trial that lasts [s] for too many samples at a rate [Hz]; `place` is the field that decides it. Nearly
    three hours at 1 kHz are the most: more does not fit into memory, or is a slip."""
    samples, most = duration_s * rate_hz, 10_000_000
    if samples > most:
        text = f"{duration_s:g} s at {rate_hz:g} Hz are {samples:.3g} samples; shorten it to {most:g} samples"
        raise PydanticCustomError("too_many_samples", "{reason}", {"reason": text, "place": place.split(".")})


class Experiments(Settings):
    """How many trials of each experiment are simulated; of impedance one for each stiffness, damping and controller."""

    belt: Count
    transmission: Count
    actuator: Count = 0
    torque_angle: Count = 0  # of a passive foot
    K_d: tuple[Positive, ...]
    B_d: tuple[NotNegative, ...]
    controllers: tuple[Literal["compensated", "uncompensated"], ...]
    static: Count = 0
    plate: Count = 0  # a perturbation of the unloaded platform
    walking: Count = 0  # crossings
    perturbed_share: Annotated[float, Field(ge=0, le=1)] = 0.5  # probability that a crossing is perturbed
    conditions: Conditions = Conditions()

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
    damping_ratio: Positive  # of the position loop


class DrivetrainSettings(Settings):
    """How the drivetrain is integrated and controlled."""

    substeps: Annotated[int, Field(ge=1, le=1000)]  # integration steps per sample of the log
    control_updates: Annotated[int, Field(ge=1)]  # updates of the controller per sample of the log
    sign_width: Positive  # velocity [rad/s] of the actuator over which the controller smooths its sign
    hysteresis_width: Positive  # deflection [rad] over which the belt's hysteresis changes sign after a reversal

    @model_validator(mode="after")
    def _even(self) -> Self:
        if self.substeps % self.control_updates:
            raise ValueError("control_updates must divide substeps")
        return self


class SimulationSettings(Settings):
    """A simulated campaign. Files are relative to the working directory. A campaign's configuration replaces
    `parameters`, `gain_weight`, the gait laboratory's `impedance_trajectory`, and the frequencies, amplitudes and
    cycles of `protocol`."""

    seed: Annotated[int, Field(ge=0)]
    parameters: ShippedPath  # of the simulated device
    experiments: Experiments
    protocol: SteppedSineSchedule  # of transmission and impedance trials
    belt: BeltMotion
    dynamometer: Dynamometer
    drivetrain: DrivetrainSettings
    effects: Effects
    recorder: RecorderSettings = RecorderSettings()
    joint: SecondOrderJoint | None = None  # replaces the drivetrain in every impedance trial
    excitations: tuple[Excitation, ...] = ()  # motions of the impedance trials in place of `protocol`
    actuator: ActuatorBench | None = None
    foot: PassiveFoot | None = None  # of torque-angle trials, and its motion
    walking: ShippedPath | None = None  # settings file of the gait laboratory
    gain_weight: WeightSettings = WEIGHT_OF_PAPER  # W of Eq. 14, with which the leg's gains are selected

    def excitation_of(self, trial: str) -> Excitation | None:
        """The excitation of an impedance trial, by its name; None: the stepped sine."""
        found = (one for one in self.excitations if any(trial.endswith(f"_{end}") for end in one.trial_endings))
        return next(found, None)

    @model_validator(mode="after")
    def _what_is_planned_is_described(self) -> Self:
        names, wanted = [one.name for one in self.excitations], self.experiments
        if len(set(names)) < len(names):
            raise ValueError(f"excitations have the names {', '.join(names)}; give each a name of its own")
        if wanted.actuator and self.actuator is None:
            raise ValueError(f"{wanted.actuator} actuator trials are planned but 'actuator' has no schedule")
        if wanted.torque_angle and self.foot is None:
            raise ValueError(f"{wanted.torque_angle} torque-angle trials are planned but there is no 'foot'")
        crossings = wanted.static + wanted.plate + wanted.walking
        if crossings and self.walking is None:
            raise ValueError(f"{crossings} gait-laboratory trials are planned but 'walking' names no settings file")
        return self

    @model_validator(mode="after")
    def _is_sampled_and_controlled_fast_enough(self) -> Self:
        rate, bandwidth = self.dynamometer.rate_hz, self.effects.dynamometer_bandwidth
        tones = () if self.actuator is None else (*self.actuator.velocity, *self.actuator.current)
        bands = (one.band_hz[1] for one in self.excitations)
        fastest = max((*self.protocol.frequencies_hz, *(tone.frequency_hz for tone in tones), *bands))
        fewest = 10  # samples of the log in one cycle
        if rate < fewest * fastest:
            raise ValueError(
                f"dynamometer.rate_hz = {rate:g} Hz takes {rate / fastest:g} samples of a cycle at {fastest:g} Hz; "
                f"take {fewest * fastest:g} Hz or more"
            )
        if bandwidth.value >= rate / 2:
            raise ValueError(
                f"effects.dynamometer_bandwidth of {bandwidth.value:g} Hz does not show in a log of {rate:g} Hz; "
                f"choose less than {rate / 2:g} Hz, or enabled: false for a bench that follows exactly"
            )
        lasting = {"protocol": self.protocol.total_s, "belt": self.belt.total_s}
        lasting |= {"actuator": self.actuator.duration_s} if self.actuator else {}
        lasting |= {"foot.cycles": self.foot.cycles.total_s} if self.foot else {}
        lasting |= {f"excitations.{one.name}": one.total_s for one in self.excitations}
        for name, duration in lasting.items():
            check_length(name, duration, rate)
        velocity, delay = self.effects.velocity_filter, self.effects.control_delay
        updates = rate * (self.drivetrain.control_updates if delay.enabled else self.drivetrain.substeps)
        if velocity.value >= updates / 2:
            raise ValueError(
                f"effects.velocity_filter of {velocity.value:g} Hz does nothing in a controller of {updates:g} "
                f"updates/s; choose less than {updates / 2:g} Hz, or enabled: false for the true velocity"
            )
        limit_s = 0.03  # with a longer delay no impedance is stable (by linear theory the limits are 0.4 to 25 ms)
        if delay.value > limit_s * updates:
            raise ValueError(
                f"effects.control_delay of {delay.value:g} updates is {1e3 * delay.value / updates:g} ms, with which "
                f"no impedance is stable; choose {limit_s * updates:g} updates ({1e3 * limit_s:g} ms) or fewer"
            )
        return self


def stream(seed: int, trial: str, effect: str) -> np.random.Generator:
    """Random generator of one effect in one trial. It depends on the seed and these two names, and on nothing else. A
    trial that is simulated alone therefore equals the same trial in a campaign. Switching one effect off leaves the
    random numbers of the others as they were."""
    return np.random.default_rng([seed, zlib.crc32(trial.encode()), zlib.crc32(effect.encode())])
