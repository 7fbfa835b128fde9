# SPDX-License-Identifier: Apache-2.0
"""The simulated campaign as a validated file, such as `config/simulation/default.yaml`: choices
only.

The device's physical parameters are in the file that `parameters` names. An imperfection is an
`Effect`: a switch, a size and the unit of the size. All effects of recorders and sensors are off
unless they are switched on.
"""

import math
from typing import Annotated, Any, Generic, Literal, TypeVar

from pydantic import AfterValidator, Field, NonNegativeInt

from osl_analysis.base.yaml_settings import (
    IDENTIFIER,
    Amplitudes,
    CycleCount,
    Frequencies,
    JointDegrees,
    NotNegative,
    Positive,
    Settings,
    ShippedPath,
    Stiffness,
    check_distinct,
    check_rising,
    refuse_if,
    require_at_most,
)
from osl_analysis.model.compensator import PAPER_WEIGHT, Weight
from osl_analysis.model.multisine import odd_lines

Unit = TypeVar("Unit", bound=str)


class Effect(Settings, Generic[Unit]):
    """One imperfection. (The key is not `on`, which is a truth value in YAML.)"""

    enabled: bool
    size: NotNegative  # in `unit`, which must be one that the settings expect
    unit: Unit

    @property
    def value(self) -> float:
        """The size, or 0 where the effect is off; that of bits per turn is the step [rad] of an
        encoder."""
        if not self.enabled:
            return 0.0
        return 2 * math.pi / 2**self.size if self.unit == "bit" else self.size


AsFactor = Effect[Literal["1"]]
InAmperes = Effect[Literal["A"]]
InDegrees = Effect[Literal["deg"]]
InHertz = Effect[Literal["Hz"]]
InKilograms = Effect[Literal["kg"]]
InMillimetres = Effect[Literal["mm"]]
InNewtons = Effect[Literal["N"]]
InNewtonMetres = Effect[Literal["N*m"]]
InPercent = Effect[Literal["%"]]
InSeconds = Effect[Literal["s"]]
InSteps = Effect[Literal["rad", "bit"]]  # resolution of an encoder


class Updates(Effect[Literal["update"]]):
    """A delay of whole updates."""

    size: NonNegativeInt


def off(unit: str, size: float = 0) -> Any:
    """The default of an effect that is off where it is not given."""
    default = {"enabled": False, "size": size, "unit": unit}
    return Field(default, validate_default=True)


class Effects(Settings):
    """Every imperfection of bench, drivetrain and controller. Noise is white at the rate of the
    log, sizes are SDs."""

    # true over the parameter file's, which the controller cancels; off: none at all
    friction: AsFactor
    # to the current; 0: held for one update; off: continuous
    control_delay: Updates
    # over the differentiated encoder; off: the true velocity
    velocity_filter: InHertz
    actuator_encoder: InSteps  # resolution, at the actuator's output
    joint_encoder: InSteps  # resolution
    load_cell_noise: InNewtonMetres
    load_cell_offset: InNewtonMetres  # constant over a trial
    load_cell_drift: Effect[Literal["N*m/min"]]  # constant over a trial
    load_cell_quantisation: InNewtonMetres  # resolution
    current_noise: InAmperes
    current_quantisation: InAmperes  # resolution
    # largest torque by which loading and unloading differ from the belt's
    belt_hysteresis: InNewtonMetres
    belt_scatter: AsFactor  # of K_s from trial to trial in the belt experiment
    # of the position loop; off: it follows exactly
    dynamometer_bandwidth: InHertz
    # how old its value is at the instant at which it is sampled
    load_cell_delay: InSeconds = off("s")


class SecondOrderJoint(Settings):
    """A joint with the torque of Eq. 15, in place of the drivetrain."""

    K: Positive
    B: NotNegative
    I: NotNegative
    coulomb: InNewtonMetres = off("N*m")  # Coulomb friction of the joint


class SteppedSineSchedule(Settings):
    """`lead_s` of rest, then a block per amplitude: each frequency in the given order, then
    `rest_s` of rest."""

    frequencies_hz: Frequencies
    # at each frequency: one number, or one for each
    cycles: CycleCount | tuple[CycleCount, ...]
    amplitudes_deg: Amplitudes
    rest_s: NotNegative  # after each amplitude
    lead_s: NotNegative  # rest before the first amplitude

    _every_frequency_has_its_cycles = refuse_if(
        lambda s: isinstance(s.cycles, tuple) and len(s.cycles) != len(s.frequencies_hz),
        "cycles {s.cycles} are not as many as the frequencies; give one number for each",
        "cycles",
    )

    @property
    def durations(self) -> list[float]:
        """Time [s] at each frequency."""
        n = len(self.frequencies_hz)
        cycles = self.cycles if isinstance(self.cycles, tuple) else (self.cycles,) * n
        return [count / f for count, f in zip(cycles, self.frequencies_hz, strict=True)]


class BeltMotion(Settings):
    """The motion of the belt experiment: a rest, a turn and back, and a rest."""

    amplitude_deg: JointDegrees
    ramp_s: Positive  # of the turn, and of the return
    rest_s: NotNegative


class Tone(Settings):
    """One sine of a schedule, in the unit of the schedule. It starts at phase 0."""

    frequency_hz: Positive
    size: Positive


Tones = Annotated[tuple[Tone, ...], Field(min_length=1)]


class ActuatorBench(Settings):
    """The schedule of the actuator's own bench. Velocity and current have different frequencies, so
    that the current both drives and brakes: else gear friction and torque constant cannot be told
    apart."""

    duration_s: Positive
    fade_s: Positive  # in which velocity and current fade in and out
    velocity: Tones  # of the output [rad/s]
    current: Tones  # q-axis [A]

    _fits = refuse_if(
        lambda s: s.duration_s < 4 * s.fade_s,
        "duration_s must be at least four times fade_s",
        "duration_s",
    )


class NodeSettings(Settings):
    """How one node samples its channels, and what stamps it writes."""

    rate: InHertz = off("Hz", size=1)  # off: dynamometer.rate_hz
    # how much later than the other node it takes each sample; the stamps say so
    phase: InSeconds = off("s")
    # SD of the instants about even ones; the stamps say so
    jitter: InSeconds = off("s")


class RecorderSettings(Settings):
    """Who writes the log of a bench: one node, or two, of which the second has the torque alone."""

    node: NodeSettings = NodeSettings()
    torque_node: NodeSettings | None = None


RepeatCount = Annotated[int, Field(ge=1, le=1000)]


class Excitation(Settings):
    """One motion of the joint, and how many trials of each impedance have it. A multisine has odd
    lines of a period with random phases, one in four left out; a chirp sweeps linearly; noise is
    Gaussian; a hand is slow noise."""

    # a part of the names of its trials
    name: Annotated[str, Field(pattern=IDENTIFIER)]
    kind: Literal["multisine", "chirp", "noise", "hand"]
    rms_deg: JointDegrees
    band_hz: Annotated[tuple[Positive, Positive], AfterValidator(check_rising)] = (0.5, 6.0)
    duration_s: Positive = 60.0  # at full size; of a multisine see `periods`
    period_s: Positive = 8.0  # of a multisine
    periods: RepeatCount = 5  # of a multisine
    trials: RepeatCount = 1
    # in which the motion grows, and goes back to rest, in addition to its duration
    fade_s: Positive = 1.0
    rest_s: NotNegative = 1.5  # before and after the motion

    _fades = require_at_most("fade_s", "full_s", "and the motion would never be at full size")
    _has_lines = refuse_if(
        lambda s: s.kind == "multisine" and not odd_lines(s.period_s, s.band_hz).size, "no lines"
    )

    @property
    def full_s(self) -> float:
        """Duration [s] at full size."""
        return self.period_s * self.periods if self.kind == "multisine" else self.duration_s


Count = Annotated[int, Field(ge=0, le=100_000)]
ClosedShare = Annotated[float, Field(ge=0, le=1)]


class Experiments(Settings):
    """How many trials of each experiment are simulated; of impedance one for each stiffness,
    damping and controller."""

    belt: Count
    transmission: Count
    actuator: Count = 0
    K_d: Annotated[tuple[Stiffness, ...], AfterValidator(check_distinct)]  # [N*m/rad]
    B_d: Annotated[tuple[NotNegative, ...], AfterValidator(check_distinct)]  # [N*m*s/rad]
    controllers: tuple[Literal["compensated", "uncompensated"], ...]
    static: Count = 0
    plate: Count = 0  # a perturbation of the unloaded platform
    walking: Count = 0  # crossings
    # probability that a crossing is perturbed
    perturbed_share: ClosedShare = 0.5

    @property
    def in_laboratory(self) -> int:
        """How many trials the gait laboratory records."""
        return self.static + self.plate + self.walking


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

    _even = refuse_if(
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
    excitations: Annotated[tuple[Excitation, ...], AfterValidator(check_distinct)] = ()
    actuator: ActuatorBench | None = None
    walking: ShippedPath | None = None  # settings file of the gait laboratory
    gain_weight: Weight = PAPER_WEIGHT  # W of Eq. 14, with which the leg's gains are selected

    _actuator_has_a_schedule = refuse_if(
        lambda s: s.experiments.actuator and s.actuator is None,
        "{s.experiments.actuator} actuator trials are planned but 'actuator' has no schedule",
        "actuator",
    )
    _laboratory_is_described = refuse_if(
        lambda s: s.experiments.in_laboratory and s.walking is None,
        "{s.experiments.in_laboratory} gait-laboratory trials are planned but 'walking' names no"
        " settings file",
        "walking",
    )
    _is_sampled_fast_enough = refuse_if(
        lambda s: s.dynamometer.rate_hz < 10 * max(s.protocol.frequencies_hz),
        "{s.dynamometer.rate_hz:g} Hz is too slow for the protocol; take ten times its highest"
        " frequency",
        "dynamometer.rate_hz",
    )
