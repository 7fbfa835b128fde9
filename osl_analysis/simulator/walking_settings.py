"""The gait laboratory of a simulated campaign as a validated file, such as `config/simulation/walking.yaml`.

It contains choices only. The parameters of the leg's drivetrain are in the parameter file. The imperfections of its
controller are in the campaign's simulation settings.
"""

import math
from typing import Annotated, Self

from pydantic import Field, model_validator

from osl_analysis.shared_choices import PAPER, WeightSettings
from osl_analysis.simulator.capture_settings import CaptureSettings
from osl_analysis.simulator.effect import NotNegative, Positive
from osl_analysis.simulator.gait_changes import StepChange
from osl_analysis.simulator.settings import Count, check_length
from osl_analysis.simulator.walking_effects import WalkingEffects
from osl_analysis.yaml_settings import Degrees, Settings, ShippedPath

Rate = Annotated[int, Field(ge=1, le=1_000_000)]
Vector = tuple[float, float, float]
PositiveVector = tuple[Positive, Positive, Positive]
Share = Annotated[float, Field(ge=0, le=1)]


class Rates(Settings):
    """Sampling rates.

    Motion is computed at the least common multiple of three of them, so that markers, analogs and controller sample it
    exactly. The leg's log runs on its own clock and is interpolated.
    """

    points_hz: Rate
    """Rate [Hz] of the markers."""
    analogs_hz: Rate
    """Rate [Hz] of the analog channels."""
    leg_hz: Rate
    """Rate [Hz] of the leg's log."""
    controller_hz: Rate
    """Rate [Hz] of the leg's controller."""

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


class Gait(Settings):
    """The nominal crossing."""

    body_mass_kg: Positive
    """Body mass [kg]."""
    recording_s: Positive
    """Duration [s] of the recording."""
    heel_strike_s: Positive
    """Time [s] of the heel strike on the platform."""
    stance_s: Positive
    """Duration [s] of stance on the platform."""
    stride_m: Positive
    """Length [m] of a stride."""

    @model_validator(mode="after")
    def _step_is_recorded(self) -> Self:
        if self.recording_s <= self.heel_strike_s + self.stance_s:
            raise ValueError(
                f"recording_s must be longer than heel_strike_s + stance_s = {self.heel_strike_s + self.stance_s:g} s"
            )
        return self


class Perturbation(Settings):
    """Ramp of the platform about a mediolateral axis; toes up, if the conditions of the campaign do not say more."""

    angle_deg: Degrees
    """Angle [deg] of the ramp."""
    rise_s: Positive
    """Duration [s] of the ramp."""
    latency_s: NotNegative
    """Time [s] from the command to the start of the ramp."""
    stance_phase: tuple[Share, Share]
    """First and last phase of stance at which the ramp is commanded. The phase is drawn evenly from between them."""
    hold_s: NotNegative
    """Time [s] after toe-off at which the platform starts to return."""
    return_s: Positive
    """Duration [s] of the return."""
    axis_depth_m: float | None = None
    """Depth [m] of the axis below the plate's surface. Null: the axis passes through the nominal ankle."""
    shift_mm: Positive | None = None
    """Distance [mm] by which the platform shifts in place of a turn: backward for `up`, which dorsiflexes the ankle, as
    the hip stays where it is. Null: it turns."""
    leg_length_m: Positive = 0.9
    """Distance [m] from ankle to hip, which converts a shift of the platform to an angle of the shank."""
    same_unloaded: bool = False
    """Whether plate trials have the ramp of the crossings. Else its size and duration vary by 15 and 30 %."""


class Body(Settings):
    """The inertia of a body. Its mass is the size of an effect (`foot_inertia` or `plate_inertia`)."""

    centre_of_mass_m: Vector
    """Centre of mass [m] in the body's axes."""
    gyration_m: PositiveVector
    """Principal radii of gyration [m] about the centre of mass."""


class Plate(Body):
    """The force plate. Its centre of mass is given from the centre of its surface."""

    centre_m: Vector
    """Centre [m] of the surface at rest, in laboratory axes."""
    size_m: tuple[Positive, Positive]
    """Size [m] of the surface along the plate's x and y."""
    sensor_depth_m: Positive
    """Depth [m] of the sensor origin below the surface."""
    sensor_offset_m: tuple[float, float]
    """Sensor origin [m] from the surface's centre, along laboratory x and y."""
    nominal_ankle_m: tuple[float, float]
    """Point [m] of the surface above which participants put the ankle. The platform turns about an axis through it."""
    full_motion_every: Count
    """Interval, in plate trials, at which the platform also shifts and tilts about another axis, so that all its
    inertial parameters can be identified. 0: never."""


class WalkingSettings(Settings):
    """A simulated gait laboratory."""

    impedance: ShippedPath
    """File of the desired impedance over the gait cycle, relative to the working directory."""
    rates: Rates
    """Sampling rates."""
    gait: Gait
    """The nominal crossing."""
    perturbation: Perturbation
    """The ramp of the platform."""
    foot: Body
    """Inertia of the foot."""
    plate: Plate
    """The force plate."""
    effects: WalkingEffects
    """Every imperfection of gait and gait laboratory."""
    changes: tuple[StepChange, ...] = ()
    """What makes some crossings differ from the others."""
    gain_weight: WeightSettings = PAPER
    """W of Eq. 14 with which the leg's gains are selected; that of the simulated campaign replaces it."""
    capture: CaptureSettings = CaptureSettings()
    """How the C3D file is recorded."""

    @model_validator(mode="after")
    def _ends(self) -> Self:
        check_length("gait.recording_s", self.gait.recording_s, self.rates.motion_hz)
        return self
