"""The simulated campaign as a validated file, such as `config/simulation/default.yaml`, and its
gait laboratory, such as `config/simulation/walking.yaml`: choices only; and its plan: the sample
sheet, and the condition of each trial.

The device's physical parameters are in the file that `parameters` names. An imperfection is an
`Effect`: a switch, a size and the unit of the size. All effects of recorders and sensors are off
unless they are switched on. Those of the leg's controller are the campaign's in the gait laboratory
too."""

import itertools
import math
import re
import zlib
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated, Any, Literal, Self

import numpy as np
from pydantic import AfterValidator, Field, ValidationInfo, field_validator, model_validator

from osl_analysis.config.experiments import EXPERIMENTS
from osl_analysis.config.sheet import JOINT, SHEET_COLUMNS, SheetRows
from osl_analysis.errors import InputError
from osl_analysis.model.compensator import PAPER_WEIGHT, Weight
from osl_analysis.model.multisine import odd_lines
from osl_analysis.yaml_settings import (
    Degrees,
    JointDegrees,
    Metres,
    NotNegative,
    Positive,
    Seconds,
    Settings,
    ShippedPath,
    Stiffness,
    below,
    distinct,
    misplaced,
    refused,
    rising,
)


class Effect(Settings):
    """One imperfection. (The key is not `on`, which is a truth value in YAML.)"""

    enabled: bool
    size: NotNegative  # in `unit`, which must be one that the settings expect
    unit: str

    @property
    def value(self) -> float:
        """The size, or 0 where the effect is off; that of bits per turn is the step [rad] of an
        encoder."""
        if not self.enabled:
            return 0.0
        return 2 * math.pi / 2**self.size if self.unit == "bit" else self.size


class SignedEffect(Effect):
    """An imperfection whose size may be negative."""

    size: float


class Scatter(Effect):
    """A random imperfection of each sample: the standard deviation of a `normal`, the mean of an
    `exponential` one."""

    distribution: Literal["normal", "exponential"] = "normal"


def effect(*units: str, off: float | None = None, **rules: bool) -> Any:
    """An effect in one of these units, whose size has to be `whole`, `above_0` or `below_1`. Where
    it is not given it is switched off, with the size `off`; it has to be given if that is None."""
    default = ... if off is None else {"enabled": False, "size": off, "unit": units[0]}
    return Field(default, validate_default=True, json_schema_extra={"units": list(units), **rules})


class Switches(Settings):
    """Settings with effects. Only `enabled: false` switches an effect off whose size has to be
    above 0."""

    @field_validator("*")
    @classmethod
    def _has_its_unit(cls, value: Any, info: ValidationInfo) -> Any:
        rules: Any = cls.model_fields[info.field_name or ""].json_schema_extra
        if not isinstance(value, Effect):
            return value
        if value.unit not in rules["units"]:
            raise ValueError(
                f"its unit must be {' or '.join(map(repr, rules['units']))}, not '{value.unit}'"
            )
        if value.unit in (most := {"bit": 32, "rad": math.pi}) and value.size > most[value.unit]:
            raise ValueError(
                f"its size is {value.size:g} {value.unit}; give at most {most[value.unit]:.3g}"
            )
        if "whole" in rules and value.size != int(value.size):
            raise ValueError(f"its size is {value.size:g}; give a whole number")
        if "above_0" in rules and value.size == 0:
            raise ValueError("its size must be positive; set enabled: false to switch it off")
        if "below_1" in rules and value.size >= 1:
            raise ValueError("its size is a share and must be less than 1")
        return value

    def without(self, *names: str) -> Self:
        """These effects with the named ones off, or with all off if none is named."""
        names = names or tuple(type(self).model_fields)
        return self.model_copy(
            update={n: getattr(self, n).model_copy(update={"enabled": False}) for n in names}
        )


class Subject(Settings):
    """A person, by the name in sample sheet and capture. What is left out is that of the gait
    laboratory's settings."""

    name: str
    body_mass_kg: Positive | None = None
    stance_s: Positive | None = None


class Conditions(Settings):
    """Lists of which each crossing gets one entry. In n successive crossings each of n directions
    occurs once, in a random order; subjects follow each other in equal blocks. The sheet says
    which, where several are."""

    # up: toes up, dorsiflexion
    directions: Annotated[tuple[Literal["up", "down"], ...], Field(min_length=1)] = ("up",)
    subjects: Annotated[tuple[Subject, ...], AfterValidator(distinct)] = ()


class Effects(Switches):
    """Every imperfection of bench, drivetrain and controller. Noise is white at the rate of the
    log, sizes are SDs."""

    # true over the parameter file's, which the controller cancels; off: none at all
    friction: Effect = effect("1")
    # to the current; 0: held for one update; off: continuous
    control_delay: Effect = effect("update", whole=True)
    # over the differentiated encoder; off: the true velocity
    velocity_filter: Effect = effect("Hz", above_0=True)
    actuator_encoder: Effect = effect("rad", "bit")  # resolution, at the actuator's output
    joint_encoder: Effect = effect("rad", "bit")  # resolution
    load_cell_noise: Effect = effect("N*m")
    load_cell_offset: Effect = effect("N*m")  # constant over a trial
    load_cell_drift: Effect = effect("N*m/min")  # constant over a trial
    load_cell_quantisation: Effect = effect("N*m")  # resolution
    current_noise: Effect = effect("A")
    current_quantisation: Effect = effect("A")  # resolution
    # largest torque by which loading and unloading differ from the belt's
    belt_hysteresis: Effect = effect("N*m")
    belt_scatter: Effect = effect("1")  # of K_s from trial to trial in the belt experiment
    # of the position loop; off: it follows exactly
    dynamometer_bandwidth: Effect = effect("Hz", above_0=True)
    mount_stiffness: Effect = effect("N*m/rad", off=1, above_0=True)  # of the bench's frame
    # how old its value is at the instant at which it is sampled
    load_cell_delay: Effect = effect("s", off=0)
    encoder_zero: Effect = effect("step", off=0)  # largest distance of the joint's, drawn per trial


class SecondOrderJoint(Switches):
    """A joint with the torque of Eq. 15, in place of the drivetrain."""

    K: Positive
    B: NotNegative
    I: NotNegative
    coulomb: Effect = effect("N*m", off=0)  # Coulomb friction of the joint


CyclesOfSine = Annotated[int, Field(ge=1, le=10_000)]


class SteppedSineSchedule(Settings):
    """`lead_s` of rest, then a block per amplitude: each frequency in the given order, then
    `rest_s` of rest."""

    frequencies_hz: Annotated[tuple[Positive, ...], Field(min_length=1)]
    # at each frequency: one number, or one for each
    cycles: CyclesOfSine | tuple[CyclesOfSine, ...] | None = None
    seconds: Positive | None = None  # duration of each frequency in place of `cycles`
    amplitudes_deg: Annotated[tuple[Degrees, ...], Field(min_length=1)]
    rest_s: NotNegative  # after each amplitude
    lead_s: NotNegative  # rest before the first amplitude
    # in which each frequency grows from 0, and falls to 0, in addition to its cycles
    ramp_s: NotNegative = 0.0

    @model_validator(mode="after")
    def _duration_is_stated_once(self) -> Self:
        if (self.cycles is None) == (self.seconds is None):
            raise ValueError("state either cycles or seconds at each frequency")
        if isinstance(self.cycles, tuple) and len(self.cycles) != (n := len(self.frequencies_hz)):
            raise ValueError(
                f"{len(self.cycles)} numbers of cycles for {n} frequencies; give one for each"
            )
        return self

    @property
    def durations(self) -> list[float]:
        """Time [s] at full amplitude of each frequency."""
        if self.seconds is not None:
            return [self.seconds] * len(self.frequencies_hz)
        cycles = (
            self.cycles
            if isinstance(self.cycles, tuple)
            else [self.cycles or 0] * len(self.frequencies_hz)
        )
        return [n / f for n, f in zip(cycles, self.frequencies_hz, strict=True)]


class BeltMotion(Settings):
    """The motion of the belt experiment: a rest, a turn and back, and a rest."""

    amplitude_deg: JointDegrees
    ramp_s: Positive  # of the turn, and of the return
    rest_s: NotNegative


class Tone(Settings):
    """One sine of a schedule, in the unit of the schedule. It starts at phase 0."""

    frequency_hz: Positive
    size: Positive


class ActuatorBench(Settings):
    """The schedule of the actuator's own bench. Velocity and current have different frequencies, so
    that the current both drives and brakes: else gear friction and torque constant cannot be told
    apart."""

    duration_s: Positive
    fade_s: Positive  # in which velocity and current fade in and out
    velocity: Annotated[tuple[Tone, ...], Field(min_length=1)]  # of the output [rad/s]
    current: Annotated[tuple[Tone, ...], Field(min_length=1)]  # q-axis [A]

    _fits = refused(
        lambda s: s.duration_s < 4 * s.fade_s,
        "duration_s must be at least four times fade_s",
        "duration_s",
    )


class NodeSettings(Switches):
    """How one node samples its channels, and what stamps it writes."""

    rate: Effect = effect("Hz", off=1, above_0=True)  # off: dynamometer.rate_hz
    # how much later than the other node it takes each sample; the stamps say so
    phase: Effect = effect("s", off=0)
    # true: samples are taken off the even instants, and stamped so
    jitter: Scatter = effect("s", off=0)
    # false: samples are even, and the host stamps each so much later
    latency: Scatter = effect("s", off=0)
    # what the node's clock shows when the bench's shows 0
    clock_offset: SignedEffect = effect("s", off=0)
    clock_drift: SignedEffect = effect("ppm", off=0)  # how much faster than the bench's it runs
    decimals: Effect = effect("decimal", off=0, whole=True)  # of stamps in s
    # share of samples that are missing, at drawn places
    dropped: Effect = effect("1", off=0, below_1=True)

    _is_never_early = refused(
        lambda s: s.latency.enabled and s.latency.distribution == "normal",
        "latency is never negative; choose distribution: exponential",
        "latency",
    )


class RecorderSettings(Settings):
    """Who writes the log of a bench: one node, or two, of which the second has the torque alone."""

    node: NodeSettings = NodeSettings()
    torque_node: NodeSettings | None = None


class Excitation(Settings):
    """One motion of the joint, and how many trials of each impedance have it. A multisine has odd
    lines of a period with random phases, one in four left out; a chirp sweeps linearly; noise is
    Gaussian; a prbs is binary; ramps have constant velocities between random angles; a hand is slow
    noise that wanders in size."""

    # a part of the names of its trials
    name: Annotated[str, Field(pattern=r"^[A-Za-z][A-Za-z0-9]{0,30}$")]
    kind: Literal["multisine", "chirp", "noise", "prbs", "ramps", "hand"]
    rms_deg: JointDegrees  # of a binary sequence half its step, of ramps a third of their range
    band_hz: Annotated[tuple[Positive, Positive], AfterValidator(rising)] = (
        0.5,
        6.0,
    )  # a binary sequence and ramps have none
    duration_s: Positive = 60.0  # at full size; of a multisine see `periods`
    period_s: Positive = 8.0  # of a multisine
    periods: Annotated[int, Field(ge=1, le=1000)] = 5  # of each realisation of a multisine
    # motions in one recording, each of other random numbers
    realisations: Annotated[int, Field(ge=1, le=100)] = 1
    trials: Annotated[int, Field(ge=1, le=1000)] = 1
    clock_s: Positive = 0.1  # between two changes of a binary sequence, or of the velocity of ramps
    # cut-off of the low-pass over a binary sequence; null: it jumps
    smoothing_hz: Positive | None = None
    # in which the motion grows, and goes back to rest, in addition to its duration
    fade_s: Positive = 1.0
    rest_s: NotNegative = 1.5  # before and after each motion

    _fades = below("fade_s + clock_s", "full_s", "and the motion would never be at full size")
    _has_lines = refused(
        lambda s: s.kind == "multisine" and not odd_lines(s.period_s, s.band_hz, 0), "no lines"
    )

    @property
    def full_s(self) -> float:
        """Duration [s] of one realisation at full size."""
        return self.period_s * self.periods if self.kind == "multisine" else self.duration_s


class SlippingSpring(Settings):
    """A spring in series with dry friction. Cycles of amplitude A lose 4 limit (A -
    limit/stiffness)."""

    stiffness: Positive  # [N*m/rad], until it slips
    limit: Positive  # torque [N*m] at which it slips


class SlowCycles(Settings):
    """Ramps at one speed from rest at 0 to the lowest angle, to the highest, and so on, and back to
    rest at 0."""

    lowest_deg: Annotated[float, Field(ge=-60, le=0)]
    highest_deg: Annotated[float, Field(gt=0, le=60)]
    speed_deg_s: Annotated[tuple[Positive, ...], Field(min_length=1)]  # of each cycle
    turn_s: Positive  # in which the motion turns at the end of a ramp
    rest_s: Positive  # before and after


class PassiveFoot(Settings):
    """The foot of torque-angle trials, a spring K theta (1 + stiffening theta^2), and how it is
    moved."""

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
                    f"a spring of {spring.stiffness:g} N*m/rad does not reach its limit of"
                    f" {spring.limit:g} N*m on the way from the lowest to the highest angle; lower"
                    " the limit, or leave it out"
                )
        return self


Count = Annotated[int, Field(ge=0, le=100_000)]


class Experiments(Settings):
    """How many trials of each experiment are simulated; of impedance one for each stiffness,
    damping and controller."""

    belt: Count
    transmission: Count
    actuator: Count = 0
    torque_angle: Count = 0  # of a passive foot
    K_d: Annotated[tuple[Stiffness, ...], AfterValidator(distinct)]  # [N*m/rad]
    B_d: Annotated[tuple[NotNegative, ...], AfterValidator(distinct)]  # [N*m*s/rad]
    controllers: tuple[Literal["compensated", "uncompensated"], ...]
    static: Count = 0
    plate: Count = 0  # a perturbation of the unloaded platform
    walking: Count = 0  # crossings
    # probability that a crossing is perturbed
    perturbed_share: Annotated[float, Field(ge=0, le=1)] = 0.5
    conditions: Conditions = Conditions()

    _some = refused(
        lambda s: (
            not any(
                (s.belt, s.transmission, s.actuator, s.torque_angle, s.static, s.plate, s.walking)
            )
            and not (s.K_d and s.B_d and s.controllers)
        ),
        "no trials are planned; ask for at least one",
    )


class Dynamometer(Settings):
    """The dynamometer, and the log of every bench."""

    rate_hz: Positive
    damping_ratio: Positive  # of the position loop


class DrivetrainSettings(Settings):
    """How the drivetrain is integrated and controlled."""

    substeps: Annotated[int, Field(ge=1, le=1000)]  # integration steps per sample of the log
    control_updates: Annotated[int, Field(ge=1)]  # updates of the controller per sample of the log
    # velocity [rad/s] of the actuator over which the controller smooths its sign
    sign_width: Positive
    # deflection [rad] over which the belt's hysteresis changes sign after a reversal
    hysteresis_width: Positive

    _even = refused(
        lambda s: s.substeps % s.control_updates,
        "control_updates must divide substeps",
        "control_updates",
    )


class SimulationSettings(Settings):
    """A simulated campaign. Files are relative to the working directory. A campaign's configuration
    replaces `parameters`, `gain_weight`, the gait laboratory's `impedance_trajectory`, and the
    frequencies, amplitudes and cycles of `protocol`."""

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
    # motions in place of `protocol`
    excitations: Annotated[tuple[Excitation, ...], AfterValidator(distinct)] = ()
    actuator: ActuatorBench | None = None
    foot: PassiveFoot | None = None  # of torque-angle trials, and its motion
    walking: ShippedPath | None = None  # settings file of the gait laboratory
    gain_weight: Weight = PAPER_WEIGHT  # W of Eq. 14, with which the leg's gains are selected

    @model_validator(mode="after")
    def _what_is_planned_is_described(self) -> Self:
        wanted = self.experiments
        for planned, kind, description, lacks in (
            (wanted.actuator, "actuator", self.actuator, "'actuator' has no schedule"),
            (wanted.torque_angle, "torque-angle", self.foot, "there is no 'foot'"),
            (wanted.static + wanted.plate + wanted.walking, "gait-laboratory", self.walking,
             "'walking' names no settings file"),
        ):  # fmt: skip
            if planned and description is None:
                raise ValueError(f"{planned} {kind} trials are planned but {lacks}")
        return self

    @model_validator(mode="after")
    def _is_sampled_fast_enough(self) -> Self:
        rate, bandwidth = self.dynamometer.rate_hz, self.effects.dynamometer_bandwidth
        asked = [(hz, "protocol.frequencies_hz") for hz in self.protocol.frequencies_hz]
        for one in self.excitations:
            asked += [
                (
                    0.5 / one.clock_s if one.kind in ("prbs", "ramps") else one.band_hz[1],
                    "excitations",
                )
            ]
        for name in ("velocity", "current") if self.actuator else ():
            asked += [
                (tone.frequency_hz, f"actuator.{name}") for tone in getattr(self.actuator, name)
            ]
        (fastest, where), fewest = max(asked), 10  # samples of the log in one cycle
        if rate < fewest * fastest:
            said = (
                f"dynamometer.rate_hz = {rate:g} Hz takes {rate / fastest:g} samples of a cycle at"
                f" {fastest:g} Hz"
            )
            said += f"; take {fewest * fastest:g} Hz or more, or correct {where}"
            raise misplaced(said, "dynamometer", "rate_hz")
        nodes = {
            "node": self.recorder.node,
            "torque_node": self.recorder.torque_node or self.recorder.node,
        }
        for name, slow in (
            (name, one.rate.value)
            for name, one in nodes.items()
            if 0 < one.rate.value <= 2 * fastest
        ):
            said = (
                f"{slow:g} Hz do not show a motion of {fastest:g} Hz; raise it, or correct {where}"
            )
            raise misplaced(said, "recorder", name, "rate", "size")
        least = max(self.protocol.frequencies_hz)
        if bandwidth.enabled and not least <= bandwidth.value < rate / 2:
            said = (
                f"{bandwidth.value:g} Hz do not show in a log of {rate:g} Hz, or do not follow"
                f" {least:g} Hz; choose "
            )
            said += (
                f"{least:g} to {rate / 2:g} Hz, or enabled: false for a bench that follows exactly"
            )
            raise misplaced(said, "effects", "dynamometer_bandwidth", "size")
        return self


def stream(seed: int, trial: str, effect: str) -> np.random.Generator:
    """Random generator of one effect in one trial, which depends on nothing else: a trial that is
    simulated alone equals the campaign's, and switching one effect off leaves the random numbers of
    the others."""
    return np.random.default_rng([seed, zlib.crc32(trial.encode()), zlib.crc32(effect.encode())])


# from the ankle's centre, in the axes of foot and shank when standing [m]; the right leg's outer
# side is -y
FOOT = {
    "FOOT1": (-0.075, 0.012, -0.030),
    "FOOT2": (0.160, 0.020, -0.050),
    "FOOT3": (0.105, -0.050, -0.045),
    "FOOT4": (0.060, 0.008, 0.035),
}
SHANK = {
    "SHANK1": (0.055, -0.020, 0.100),
    "SHANK2": (0.010, -0.065, 0.190),
    "SHANK3": (-0.035, 0.050, 0.255),
    "SHANK4": (0.060, 0.025, 0.330),
}
# from the centre of the plate's surface [m]; one is on a post, so that the four do not lie in a
# plane
PLATFORM = {
    "PLAT1": (0.285, 0.235, 0.004),
    "PLAT2": (-0.285, 0.230, 0.004),
    "PLAT3": (-0.280, -0.235, 0.060),
    "PLAT4": (0.285, -0.230, 0.004),
}
ANKLE_AXIS = {"ANKLE_MED": (0.0, 0.042, 0.0), "ANKLE_LAT": (0.0, -0.042, 0.0)}
PLATE_CHANNELS = {"Fx1": "N", "Fy1": "N", "Fz1": "N", "Mx1": "Nmm", "My1": "Nmm", "Mz1": "Nmm"}
"""Labels and units of the plate's channels, force and moment: type 2 of the C3D manual."""


class WalkingEffects(Switches):
    """Every imperfection of gait and gait laboratory. The size of a scatter, an offset or a noise
    is its standard deviation. The actuator's encoder and current have the imperfections of the
    campaign."""

    heel_strike_scatter: Effect = effect("s")  # of the time of heel strike on the platform
    stance_scatter: Effect = effect("%")  # of the duration of stance on the platform
    angle_scale: Effect = effect("%")  # of a factor of the ankle's angle
    angle_wander: Effect = effect("deg")  # smooth deviation of the ankle's angle, below 4 Hz
    force_scale: Effect = effect("%")  # of a factor of each component of the ground reaction
    placement_forward: Effect = effect("mm")  # of the foot's place on the platform
    placement_sideways: Effect = effect("mm")
    # of the foot's direction on the platform; the ankle's axis turns with it
    foot_yaw: Effect = effect("deg")
    # share of the platform's rotation by which the shank rotates within 0.2 s
    shank_yield: Effect = effect("%")
    foot_inertia: Effect = effect("kg")  # of foot and shoe below the ankle
    # of the plate above its sensors; off: the reading is the ground reaction
    plate_inertia: Effect = effect("kg")
    marker_noise: Effect = effect("mm")  # white, each axis
    marker_gaps: Effect = effect("1/trial")  # mean number of gaps in which a marker is hidden
    force_noise: Effect = effect("N")  # white, each axis
    moment_noise: Effect = effect("N*m")
    force_offset: Effect = effect("N")  # constant over a trial
    moment_offset: Effect = effect("N*m")
    plate_lag: Effect = effect("ms")  # of the plate's channels behind markers, trigger and sync
    # mean offset of the leg's clock from that of the recording
    leg_clock_offset: Effect = effect("s")
    leg_clock_drift: Effect = effect("ppm")  # scatter of the rate of the leg's clock
    leg_joint_encoder: Effect = effect("bit")


Rate = Annotated[int, Field(ge=1, le=1_000_000)]


class Rates(Settings):
    """Motion is computed at the least common multiple of three rates, so that markers, analogs and
    controller sample it exactly. The leg's log runs on its own clock and is interpolated."""

    points_hz: Rate  # of the markers
    analogs_hz: Rate
    leg_hz: Rate  # of the leg's log
    controller_hz: Rate  # of the leg's controller

    _c3d_can_hold_them = refused(
        lambda s: s.analogs_hz % s.points_hz,
        "analogs_hz must be a multiple of points_hz ({s.points_hz}), not {s.analogs_hz}: C3D needs"
        " that",
        "analogs_hz",
    )
    _are_computable = refused(
        lambda s: s.motion_hz > 100_000,
        "controller_hz has with the others the least common multiple {s.motion_hz}; choose 100000"
        " or less, as of 1000",
        "controller_hz",
    )

    @property
    def motion_hz(self) -> int:
        """Rate [Hz] at which the motion is computed."""
        return math.lcm(self.points_hz, self.analogs_hz, self.controller_hz)


class Gait(Settings):
    """The nominal crossing."""

    body_mass_kg: Positive
    recording_s: Positive  # duration
    heel_strike_s: Annotated[float, Field(ge=0.1)]  # time of the heel strike on the platform
    stance_s: Seconds  # duration of stance on the platform
    stride_m: Metres

    _step_is_recorded = below(
        "heel_strike_s + stance_s", "recording_s", "and the step would not be recorded"
    )


class Perturbation(Settings):
    """Ramp of the platform about a mediolateral axis; toes up, if the conditions of the campaign do
    not say more."""

    angle_deg: Annotated[float, Field(gt=0, le=60)]
    rise_s: Seconds
    latency_s: NotNegative  # from the command to the start of the ramp
    stance_phase: tuple[Annotated[float, Field(ge=0, le=1)], Annotated[float, Field(ge=0, le=1)]]
    """First and last share of stance at which the ramp is commanded, drawn evenly."""
    # after toe-off, when the platform starts to return
    hold_s: Annotated[float, Field(ge=0, le=10)]
    return_s: Seconds
    shift_mm: Positive | None = None
    """Distance by which the platform shifts in place of a turn: backward for `up`, which
    dorsiflexes the ankle, as the hip stays where it is. Null: it turns."""
    _in_order = refused(
        lambda s: s.stance_phase[0] > s.stance_phase[1],
        "stance_phase falls; write the lower first",
        "stance_phase",
    )


class Body(Settings):
    """The inertia of a body. Its mass is the size of an effect (`foot_inertia` or
    `plate_inertia`)."""

    centre_of_mass_m: tuple[float, float, float]  # in the body's axes
    gyration_m: tuple[Metres, Metres, Metres]  # principal radii about the centre of mass


class MovingPlate(Body):
    """The force plate. Its centre of mass is given from the centre of its surface."""

    centre_m: tuple[float, float, float]  # of the surface at rest, in laboratory axes
    size_m: tuple[Metres, Metres]  # of the surface along the plate's x and y
    sensor_depth_m: Metres  # of the sensor origin below the surface
    # sensor origin from the surface's centre, along laboratory x and y
    sensor_offset_m: tuple[float, float]
    # point of the surface above which participants put the ankle
    nominal_ankle_m: tuple[float, float]
    # plate trial also shifts and tilts, to identify all inertial parameters; 0: none
    full_motion_every: Count

    _lie_on_it = refused(
        lambda s: any(
            2 * abs(x) > s.size_m[k % 2]
            for k, x in enumerate(s.nominal_ankle_m + s.sensor_offset_m)
        ),
        "nominal_ankle_m or sensor_offset_m is beyond half of size_m = {s.size_m}; correct it, in m"
        " from the centre",
        "nominal_ankle_m",
    )


class WalkingSettings(Settings):
    """A simulated gait laboratory."""

    impedance: ShippedPath  # file of the desired impedance over the gait cycle
    rates: Rates
    gait: Gait
    perturbation: Perturbation
    foot: Body
    plate: MovingPlate
    effects: WalkingEffects
    gain_weight: Weight = PAPER_WEIGHT  # that of the simulated campaign replaces it

    _ramps_end_in_stance = refused(
        lambda s: (
            (one := s.perturbation).latency_s + one.rise_s
            > (1 - one.stance_phase[1]) * s.gait.stance_s
        ),
        "perturbation.rise_s ends a ramp, after stance_phase and latency_s, behind toe-off; lower"
        " one of the three",
        "perturbation.rise_s",
    )


@dataclass(frozen=True)
class Condition:
    """What a trial of the gait laboratory is by plan. None: as the settings of the gait laboratory
    have it."""

    perturbed: bool = False
    direction: str = "up"
    subject: Subject | None = None

    @property
    def person(self) -> str | None:
        """Name of the person, if the campaign names persons."""
        return self.subject.name if self.subject else None

    @property
    def sign(self) -> float:
        return 1.0 if self.direction == "up" else -1.0


def condition_of(row: Mapping[str, Any], settings: SimulationSettings) -> Condition:
    """The condition of a row of the sample sheet: the direction that it states, else by its name,
    which has a place in a random order of all directions. Subjects share the trials of an
    experiment."""
    trial, lists = str(row["trial"]), settings.experiments.conditions
    found = re.search(r"\d+$", trial)
    number = int(found.group()) - 1 if found else 0
    block, place = divmod(number, len(lists.directions))
    name = f"{trial.rstrip('0123456789')}{block}"
    order = stream(settings.seed, name, "condition").permutation(len(lists.directions))
    trials, people = (
        max(getattr(settings.experiments, row["experiment"]), 1),
        lists.subjects or (None,),
    )
    subject = people[number % trials * len(people) // trials]
    return Condition(
        bool(row.get("perturbed")), row.get("direction") or lists.directions[order[place]], subject
    )


def plan_trials(settings: SimulationSettings, only: str | None = None) -> SheetRows:
    """One row per trial, or that of one trial alone, in the columns of `sheet.py`. The same
    settings give the same plan. Whether a crossing is perturbed depends on the seed and its name,
    not on the number of crossings."""
    wanted, found, planned = (
        settings.experiments,
        dict[str, dict[str, Any]](),
        list[tuple[str, str, dict[str, Any]]](),
    )
    for experiment, digits in (
        ("belt", 2),
        ("transmission", 1),
        ("actuator", 1),
        ("torque_angle", 1),
    ):
        planned += [
            (experiment, f"{experiment}_{i + 1:0{digits}d}", {})
            for i in range(getattr(wanted, experiment))
        ]
    for controller, K_d, B_d in itertools.product(wanted.controllers, wanted.K_d, wanted.B_d):
        name = f"impedance_K{K_d:g}_B{B_d:.1f}_{controller}"
        moved = [
            f"{name}_{one.name}_{k + 1}" for one in settings.excitations for k in range(one.trials)
        ] or [name]
        planned += [
            ("impedance", t, {"controller": controller, "K_d": K_d, "B_d": B_d}) for t in moved
        ]
    for experiment, digits in (("static", 1), ("plate", 2), ("walking", 2)):
        planned += [
            (experiment, f"{experiment}_{i + 1:0{digits}d}", {})
            for i in range(getattr(wanted, experiment))
        ]
    for experiment, trial, more in (
        planned if only is None else (one for one in planned if one[1] == only)
    ):
        facts = EXPERIMENTS[experiment]
        files = facts.simulated_files(trial)  # crossings also have the leg's log
        sources = {f"{role}_source": getattr(facts, role) for role in files}
        if settings.recorder.torque_node is not None and facts.place == "bench":
            sources["log_source"] = f"{facts.log}_nodes"
        if trial in found:
            raise InputError(
                f"the plan has two trials '{trial}': K_d and B_d of experiments are too close for"
                " names of their own; remove one of them"
            )
        if experiment == "walking":
            more["perturbed"] = bool(
                stream(settings.seed, trial, "perturbed").random() < wanted.perturbed_share
            )
        row = {"trial": trial, "experiment": experiment, "joint": JOINT, **files, **sources, **more}
        if facts.place != "bench":
            condition, lists = condition_of(row, settings), wanted.conditions
            row["subject"] = condition.person
            row["direction"] = (
                condition.direction if len(lists.directions) > 1 and condition.perturbed else None
            )
        found[trial] = dict.fromkeys(SHEET_COLUMNS) | row
    return found
