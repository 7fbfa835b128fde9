"""The gait laboratory of a simulated campaign as a validated file, like `config/simulation/walking.yaml`.

Choices only: the leg's drivetrain has its parameter file, its controller's imperfections stand in the campaign's
simulation settings.
"""

import math
from pathlib import Path
from typing import Annotated, Self

from pydantic import Field, model_validator

from osl_analysis.simulator.settings import Count, Effect, NotNegative, Positive, in_unit
from osl_analysis.yaml_settings import Settings

Rate = Annotated[int, Field(ge=1)]
Vector = tuple[float, float, float]
PositiveVector = tuple[Positive, Positive, Positive]
Share = Annotated[float, Field(ge=0, le=1)]


class Rates(Settings):
    """Sampling rates [Hz] of markers, analog channels, the leg's log and the leg's controller.

    Motion is computed at their least common multiple, so that markers, analogs and controller sample it exactly;
    only the leg's log, which runs on its own clock, is interpolated.
    """

    points_hz: Rate
    analogs_hz: Rate
    leg_hz: Rate
    controller_hz: Rate

    @model_validator(mode="after")
    def _c3d_can_hold_them(self) -> Self:
        if self.analogs_hz % self.points_hz:
            raise ValueError(f"analogs_hz must be a multiple of points_hz ({self.points_hz}): C3D stores no other")
        return self

    @property
    def motion_hz(self) -> int:
        """Rate [Hz] at which the motion is computed."""
        return math.lcm(self.points_hz, self.analogs_hz, self.controller_hz)


class Gait(Settings):
    """Nominal crossing: body mass [kg], heel strike on the platform [s], stance [s], stride [m], one recording [s]."""

    body_mass_kg: Positive
    recording_s: Positive
    heel_strike_s: Positive
    stance_s: Positive
    stride_m: Positive

    @model_validator(mode="after")
    def _step_is_recorded(self) -> Self:
        if self.recording_s <= self.heel_strike_s + self.stance_s:
            raise ValueError(
                f"recording_s must be longer than heel_strike_s + stance_s = {self.heel_strike_s + self.stance_s:g} s"
            )
        return self


class Perturbation(Settings):
    """Dorsiflexion ramp of the platform about a mediolateral axis through the nominal ankle.

    Commanded at a phase of stance drawn evenly from `stance_phase`; the platform follows `latency_s` [s] later and
    takes `rise_s` [s]. It holds until `hold_s` [s] after toe-off and returns within `return_s` [s].
    """

    angle_deg: Positive
    rise_s: Positive
    latency_s: NotNegative
    stance_phase: tuple[Share, Share]
    hold_s: NotNegative
    return_s: Positive


class Body(Settings):
    """Centre of mass [m] and principal radii of gyration [m]; the mass is the size of the effect that shows it."""

    centre_of_mass_m: Vector
    gyration_m: PositiveVector


class Plate(Body):
    """The force plate: centre and size [m] of its surface at rest, and how deep its sensor origin lies [m].

    `sensor_offset_m` is where the sensor origin lies from the surface's centre along laboratory x and y; the centre
    of mass is given from the surface's centre too. `nominal_ankle_m` is above which point of it participants put the
    ankle: the platform turns about an axis through it. Every `full_motion_every`-th trial without a foot on the
    plate also shifts it and tilts it about another axis, so that all of its inertia shows; 0: none does.
    """

    centre_m: Vector
    size_m: tuple[Positive, Positive]
    sensor_depth_m: Positive
    sensor_offset_m: tuple[float, float]
    nominal_ankle_m: tuple[float, float]
    full_motion_every: Count


class WalkingEffects(Settings):
    """Every imperfection of gait and gait laboratory; a scatter, an offset or a noise is a standard deviation.

    heel_strike_scatter, stance_scatter: of time and duration of the step on the platform.
    angle_scale, angle_wander: of the ankle's angle, as a factor and as a smooth deviation below 4 Hz.
    force_scale: of each component of the ground reaction.
    placement_forward, placement_sideways, foot_yaw: of the foot on the platform; the ankle's axis turns with it.
    shank_yield: share of the perturbation by which the shank gives way within 0.2 s.
    foot_slip: distance by which the foot slides back during the perturbation.
    foot_inertia: mass of the foot and shoe below the ankle; off: a foot without mass.
    plate_inertia: mass of the plate above its sensors; off: the reading is the ground reaction.
    marker_noise, force_noise, moment_noise: white, each axis.
    marker_gaps: mean number of hidden stretches per crossing.
    force_offset, moment_offset: of the plate's zero, constant over a trial.
    plate_lag: of the plate's channels behind markers, trigger and sync.
    leg_clock_offset: mean start of the leg's clock before the recording; leg_clock_drift: of its rate.
    leg_joint_encoder: resolution in bits per turn; the actuator's encoder and current are the campaign's effects.
    """

    heel_strike_scatter: Annotated[Effect, in_unit("s")]
    stance_scatter: Annotated[Effect, in_unit("%")]
    angle_scale: Annotated[Effect, in_unit("%")]
    angle_wander: Annotated[Effect, in_unit("deg")]
    force_scale: Annotated[Effect, in_unit("%")]
    placement_forward: Annotated[Effect, in_unit("mm")]
    placement_sideways: Annotated[Effect, in_unit("mm")]
    foot_yaw: Annotated[Effect, in_unit("deg")]
    shank_yield: Annotated[Effect, in_unit("%")]
    foot_slip: Annotated[Effect, in_unit("mm")]
    foot_inertia: Annotated[Effect, in_unit("kg")]
    plate_inertia: Annotated[Effect, in_unit("kg")]
    marker_noise: Annotated[Effect, in_unit("mm")]
    marker_gaps: Annotated[Effect, in_unit("1/trial")]
    force_noise: Annotated[Effect, in_unit("N")]
    moment_noise: Annotated[Effect, in_unit("N*m")]
    force_offset: Annotated[Effect, in_unit("N")]
    moment_offset: Annotated[Effect, in_unit("N*m")]
    plate_lag: Annotated[Effect, in_unit("ms")]
    leg_clock_offset: Annotated[Effect, in_unit("s")]
    leg_clock_drift: Annotated[Effect, in_unit("ppm")]
    leg_joint_encoder: Annotated[Effect, in_unit("bit")]

    def without(self, *names: str) -> "WalkingEffects":
        """These effects with the named ones off, or with all off if none is named."""
        names = names or tuple(type(self).model_fields)
        return self.model_copy(update={n: getattr(self, n).model_copy(update={"enabled": False}) for n in names})


class WalkingSettings(Settings):
    """A simulated gait laboratory; `impedance` is a file, relative to the working directory."""

    impedance: Path
    rates: Rates
    gait: Gait
    perturbation: Perturbation
    foot: Body
    plate: Plate
    effects: WalkingEffects
