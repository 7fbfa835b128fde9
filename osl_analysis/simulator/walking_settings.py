"""The gait laboratory of a simulated campaign as a validated file, such as `config/simulation/walking.yaml`: choices.

The parameters of the leg's drivetrain are in the parameter file. The imperfections of its controller are in the
campaign's simulation settings.
"""

import math
from typing import Annotated, Self

from pydantic import Field, model_validator

from osl_analysis.config.shared_choices import WEIGHT_OF_PAPER, WeightSettings
from osl_analysis.config.yaml_settings import Degrees, Positive, Settings, ShippedPath
from osl_analysis.simulator.settings import (
    Count,
    Effect,
    Encoder,
    NotNegative,
    Seconds,
    SwitchedEffects,
    Torque,
    check_length,
    in_unit,
)

Percent = Annotated[float, Field(gt=-50, lt=100)]


Percentage = Annotated[Effect, in_unit("%")]
Millimetres = Annotated[Effect, in_unit("mm")]
Milliseconds = Annotated[Effect, in_unit("ms")]
Angle = Annotated[Effect, in_unit("deg")]
Newtons = Annotated[Effect, in_unit("N")]
Kilograms = Annotated[Effect, in_unit("kg")]


class WalkingEffects(SwitchedEffects):
    """Every imperfection of gait and gait laboratory. The size of a scatter, an offset or a noise is its standard
    deviation. The actuator's encoder and current have the imperfections of the campaign."""

    heel_strike_scatter: Seconds  # of the time of heel strike on the platform
    stance_scatter: Percentage  # of the duration of stance on the platform
    angle_scale: Percentage  # of a factor of the ankle's angle
    angle_wander: Angle  # smooth deviation of the ankle's angle, below 4 Hz
    force_scale: Percentage  # of a factor of each component of the ground reaction
    placement_forward: Millimetres  # of the foot's place on the platform
    placement_sideways: Millimetres
    foot_yaw: Angle  # of the foot's direction on the platform; the ankle's axis turns with it
    shank_yield: Percentage  # share of the platform's rotation by which the shank rotates within 0.2 s
    foot_inertia: Kilograms  # of foot and shoe below the ankle
    plate_inertia: Kilograms  # of the plate above its sensors; off: the reading is the ground reaction
    marker_noise: Millimetres  # white, each axis
    marker_gaps: Annotated[Effect, in_unit("1/trial")]  # mean number of gaps in which a marker is hidden
    force_noise: Newtons  # white, each axis
    moment_noise: Torque
    force_offset: Newtons  # constant over a trial
    moment_offset: Torque
    plate_lag: Milliseconds  # of the plate's channels behind markers, trigger and sync
    leg_clock_offset: Seconds  # mean offset of the leg's clock from that of the recording
    leg_clock_drift: Annotated[Effect, in_unit("ppm")]  # scatter of the rate of the leg's clock
    leg_joint_encoder: Annotated[Encoder, in_unit("bit")]


Rate = Annotated[int, Field(ge=1, le=1_000_000)]
Vector = tuple[float, float, float]
PositiveVector = tuple[Positive, Positive, Positive]
Phase = Annotated[float, Field(ge=0, le=1)]


class Rates(Settings):
    """Motion is computed at the least common multiple of three rates, so that markers, analogs and controller sample it
    exactly. The leg's log runs on its own clock and is interpolated."""

    points_hz: Rate  # of the markers
    analogs_hz: Rate
    leg_hz: Rate  # of the leg's log
    controller_hz: Rate  # of the leg's controller

    @model_validator(mode="after")
    def _c3d_can_hold_them(self) -> Self:
        if self.analogs_hz % self.points_hz:
            raise ValueError(
                f"analogs_hz must be a multiple of points_hz ({self.points_hz}), not {self.analogs_hz}: C3D needs that"
            )
        return self

    @property
    def motion_hz(self) -> int:
        """Rate [Hz] at which the motion is computed."""
        return math.lcm(self.points_hz, self.analogs_hz, self.controller_hz)

    @property
    def analog_stride(self) -> int:
        """Samples of the motion per analog sample."""
        return self.motion_hz // self.analogs_hz


class Gait(Settings):
    """The nominal crossing."""

    body_mass_kg: Positive
    recording_s: Positive  # duration
    heel_strike_s: Positive  # time of the heel strike on the platform
    stance_s: Positive  # duration of stance on the platform
    stride_m: Positive
    slower_percent: Percent = 0.0  # extension of the whole gait cycle
    after_window_percent: Percent = 0.0  # extension of stance 100 ms after the onset of a perturbation

    @model_validator(mode="after")
    def _step_is_recorded(self) -> Self:
        if self.recording_s <= self.heel_strike_s + self.stance_s:
            raise ValueError(
                f"recording_s must be longer than heel_strike_s + stance_s = {self.heel_strike_s + self.stance_s:g} s"
            )
        return self


class Perturbation(Settings):
    """Ramp of the platform, toes up, about the mediolateral axis through the nominal ankle. In plate trials size and
    duration vary by 15 and 30 %."""

    angle_deg: Degrees
    rise_s: Positive
    latency_s: NotNegative  # from the command to the start of the ramp
    stance_phase: tuple[Phase, Phase]  # first and last at which the ramp is commanded, drawn evenly
    hold_s: NotNegative  # after toe-off, when the platform starts to return
    return_s: Positive


class Body(Settings):
    """The inertia of a body. Its mass is the size of an effect (`foot_inertia` or `plate_inertia`)."""

    centre_of_mass_m: Vector  # in the body's axes
    gyration_m: PositiveVector  # principal radii about the centre of mass


class MovingPlate(Body):
    """The force plate. Its centre of mass is given from the centre of its surface."""

    centre_m: Vector  # of the surface at rest, in laboratory axes
    size_m: tuple[Positive, Positive]  # of the surface along the plate's x and y
    sensor_depth_m: Positive  # of the sensor origin below the surface
    sensor_offset_m: tuple[float, float]  # sensor origin from the surface's centre, along laboratory x and y
    nominal_ankle_m: tuple[float, float]  # point of the surface above which participants put the ankle
    full_motion_every: Count
    """Interval, in plate trials, at which the platform also shifts and tilts about another axis, so that all its
    inertial parameters can be identified. 0: never."""


class WalkingSettings(Settings):
    """A simulated gait laboratory."""

    impedance: ShippedPath  # file of the desired impedance over the gait cycle
    rates: Rates
    gait: Gait
    perturbation: Perturbation
    foot: Body
    plate: MovingPlate
    effects: WalkingEffects
    gain_weight: WeightSettings = WEIGHT_OF_PAPER  # that of the simulated campaign replaces it

    @model_validator(mode="after")
    def _ends(self) -> Self:
        check_length("gait.recording_s", self.gait.recording_s, self.rates.motion_hz)
        return self
