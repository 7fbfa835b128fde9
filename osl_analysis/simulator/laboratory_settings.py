# SPDX-License-Identifier: Apache-2.0
"""The simulated gait laboratory as a validated file, such as `config/simulation/walking.yaml`:
choices only; and what is the same in all of them: places of markers, curves of gait, recorders.

Effects of the leg's controller are the campaign's.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

from pydantic import AfterValidator, Field

from osl_analysis.base.files import package_yaml
from osl_analysis.base.yaml_settings import (
    Metres,
    NotNegative,
    Positive,
    Seconds,
    Settings,
    ShippedPath,
    check_rising,
    refuse_if,
    require_at_most,
)
from osl_analysis.model.compensator import PAPER_WEIGHT, Weight
from osl_analysis.simulator.simulation_settings import (
    ClosedShare,
    Count,
    Effect,
    InDegrees,
    InKilograms,
    InMillimetres,
    InNewtonMetres,
    InNewtons,
    InPercent,
    InSeconds,
)

# labels and units of the plate's channels, force and moment: type 2 of the C3D manual
PLATE_CHANNELS = {"Fx1": "N", "Fy1": "N", "Fz1": "N", "Mx1": "Nmm", "My1": "Nmm", "Mz1": "Nmm"}

FASTEST_MOTION_HZ = 100_000  # rate [Hz] at which a crossing can still be computed


Position = tuple[float, float, float]  # [m]
Bump = tuple[float, float, float]  # size, phase of the peak, sharpness

WALKER = package_yaml(Path(__file__).with_name("walker.yaml"))
MARKERS: Mapping[str, Mapping[str, Position]] = WALKER["markers"]
ANKLE_ANGLE: Sequence[Bump] = WALKER["ankle_angle"]
ANKLE_MOMENT: Sequence[Bump] = WALKER["ankle_moment"]
GROUND_REACTION: Mapping[str, Sequence[Bump]] = WALKER["ground_reaction"]


@dataclass(frozen=True)
class NominalGait:
    """Level walking, as it is the same in every campaign."""

    ankle_height: float = 0.08  # [m] of the ankle's centre above the floor
    ankle_half_width: float = 0.042  # [m] from the ankle's centre to the markers on its axis
    heel: float = -0.06  # [m] place of the pivot on the floor, forward of the ankle's centre
    ball: float = 0.13  # [m] as of the heel
    pitch_at_strike_deg: float = 18.0  # toes up
    pitch_at_toe_off_deg: float = -58.0
    stance_edge: float = 0.08  # share of stance, in which the load comes and goes
    foot_flat: tuple[float, float] = (0.12, 0.60)  # phases of stance between which it lies flat
    clearance: float = 0.04  # [m] by which the ankle is lifted in mid-swing
    upward: float = 0.74  # of body weight, throughout stance
    roll_lever: float = 0.004  # [m] of the load about the foot's forward axis
    spin_moment: float = 0.03  # [N*m/kg] about the foot's upward axis
    release_s: float = 0.3  # after toe-off in which the foot leaves the platform's motion
    yield_s: float = 0.2  # after the onset within which the shank yields


NOMINAL = NominalGait()


class WalkingEffects(Settings):
    """Every imperfection of gait and gait laboratory. The size of a scatter, an offset or a noise
    is its standard deviation. The actuator's encoder and current have the imperfections of the
    campaign."""

    heel_strike_scatter: InSeconds  # of the time of heel strike on the platform
    stance_scatter: InPercent  # of the duration of stance on the platform
    angle_scale: InPercent  # of a factor of the ankle's angle
    angle_wander: InDegrees  # smooth deviation of the ankle's angle, below 4 Hz
    force_scale: InPercent  # of a factor of each component of the ground reaction
    placement_forward: InMillimetres  # of the foot's place on the platform
    placement_sideways: InMillimetres
    # of the foot's direction on the platform; the ankle's axis turns with it
    foot_yaw: InDegrees
    # share of the platform's rotation by which the shank rotates within 0.2 s
    shank_yield: InPercent
    foot_inertia: InKilograms  # of foot and shoe below the ankle
    # of the plate above its sensors; off: the reading is the ground reaction
    plate_inertia: InKilograms
    marker_noise: InMillimetres  # white, each axis
    marker_gaps: Effect[Literal["1/trial"]]  # mean number of gaps in which a marker is occluded
    force_noise: InNewtons  # white, each axis
    moment_noise: InNewtonMetres
    force_offset: InNewtons  # constant over a trial
    moment_offset: InNewtonMetres
    plate_lag: Effect[Literal["ms"]]  # of the plate's channels behind markers, trigger and sync
    # mean offset of the leg's clock from that of the recording
    leg_clock_offset: InSeconds
    leg_clock_drift: Effect[Literal["ppm"]]  # scatter of the rate of the leg's clock
    leg_joint_encoder: Effect[Literal["bit"]]


Rate = Annotated[int, Field(ge=1, le=1_000_000)]


class Rates(Settings):
    """Motion is computed at the least common multiple of three rates, so that markers, analogs and
    controller sample it exactly. The leg's log runs on its own clock and is interpolated."""

    points_hz: Rate  # of the markers
    analogs_hz: Rate
    leg_hz: Rate  # of the leg's log
    controller_hz: Rate  # of the leg's controller

    _c3d_can_hold_them = refuse_if(
        lambda s: s.analogs_hz % s.points_hz,
        "analogs_hz must be a multiple of points_hz ({s.points_hz}), not {s.analogs_hz}: C3D needs"
        " that",
        "analogs_hz",
    )
    _are_computable = refuse_if(
        lambda s: s.motion_hz > FASTEST_MOTION_HZ,
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

    _step_is_recorded = require_at_most(
        "heel_strike_s + stance_s", "recording_s", "and the step would not be recorded"
    )


class Perturbation(Settings):
    """Ramp of the platform about a mediolateral axis."""

    angle_deg: Annotated[float, Field(ge=-60, le=60)]  # toes up positive
    rise_s: Seconds
    latency_s: NotNegative  # from the command to the start of the ramp
    stance_phase: Annotated[tuple[ClosedShare, ClosedShare], AfterValidator(check_rising)]
    """First and last share of stance at which the ramp is commanded, drawn evenly."""
    # after toe-off, when the platform starts to return
    hold_s: Annotated[float, Field(ge=0, le=10)]
    return_s: Seconds


class Body(Settings):
    """The inertia of a body. Its mass is the size of an effect (`foot_inertia` or
    `plate_inertia`)."""

    centre_of_mass_m: Position  # in the body's axes
    gyration_m: tuple[Metres, Metres, Metres]  # principal radii about the centre of mass


class MovingPlate(Body):
    """The force plate. Its centre of mass is given from the centre of its surface."""

    centre_m: Position  # of the surface at rest, in laboratory axes
    size_m: tuple[Metres, Metres]  # of the surface along the plate's x and y
    sensor_depth_m: Metres  # of the sensor origin below the surface
    # sensor origin from the surface's centre, along laboratory x and y
    sensor_offset_m: tuple[float, float]
    # point of the surface above which participants put the ankle
    nominal_ankle_m: tuple[float, float]
    # plate trial also shifts and tilts, to identify all inertial parameters; 0: none
    full_motion_every: Count


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

    _ramps_end_in_stance = refuse_if(
        lambda s: (
            s.perturbation.latency_s + s.perturbation.rise_s
            > (1 - s.perturbation.stance_phase[1]) * s.gait.stance_s
        ),
        "perturbation.rise_s ends a ramp, after stance_phase and latency_s, behind toe-off; lower"
        " one of the three",
        "perturbation.rise_s",
    )
