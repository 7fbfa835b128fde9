# SPDX-License-Identifier: Apache-2.0
"""The simulated gait laboratory as a validated file, such as `config/simulation/walking.yaml`:
choices only; and what is the same in all of them: places of markers, curves of gait, recorders.

Effects of the leg's controller are the campaign's.
"""

import math
from collections.abc import Mapping
from typing import Annotated

from pydantic import AfterValidator, Field

from osl_analysis.model.compensator import PAPER_WEIGHT, Weight
from osl_analysis.simulator.simulation_settings import (
    Count,
    Effect,
    Share,
    Switches,
    effect,
)
from osl_analysis.yaml_settings import (
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

# labels and units of the plate's channels, force and moment: type 2 of the C3D manual
PLATE_CHANNELS = {"Fx1": "N", "Fy1": "N", "Fz1": "N", "Mx1": "Nmm", "My1": "Nmm", "Mz1": "Nmm"}

FASTEST_MOTION_HZ = 100_000  # rate [Hz] at which a crossing can still be computed


Place = tuple[float, float, float]  # [m]
Bump = tuple[float, float, float]  # size, phase of the peak, sharpness


class MarkerPlaces(Settings):
    """Where the markers are; the right leg's outer side is -y."""

    # from the ankle's centre, in the axes of foot and shank when standing
    foot: Mapping[str, Place] = {
        "FOOT1": (-0.075, 0.012, -0.030),
        "FOOT2": (0.160, 0.020, -0.050),
        "FOOT3": (0.105, -0.050, -0.045),
        "FOOT4": (0.060, 0.008, 0.035),
    }
    shank: Mapping[str, Place] = {
        "SHANK1": (0.055, -0.020, 0.100),
        "SHANK2": (0.010, -0.065, 0.190),
        "SHANK3": (-0.035, 0.050, 0.255),
        "SHANK4": (0.060, 0.025, 0.330),
    }
    ankle_axis: Mapping[str, Place] = {
        "ANKLE_MED": (0.0, 0.042, 0.0),
        "ANKLE_LAT": (0.0, -0.042, 0.0),
    }
    # from the centre of the plate's surface; one is on a post, so that the four do not lie in a
    # plane
    platform: Mapping[str, Place] = {
        "PLAT1": (0.285, 0.235, 0.004),
        "PLAT2": (-0.285, 0.230, 0.004),
        "PLAT3": (-0.280, -0.235, 0.060),
        "PLAT4": (0.285, -0.230, 0.004),
    }


class NominalGait(Settings):
    """The curves of gait, which resemble published ones of level walking with a prosthetic ankle.
    They are the same in every campaign."""

    stance_fraction: float = 0.62  # of the gait cycle
    ankle_height: float = 0.08  # [m] of the ankle's centre above the floor
    heel: Place = (-0.06, 0.0, -0.08)  # pivot from the ankle's centre
    ball: Place = (0.13, 0.0, -0.08)  # pivot from the ankle's centre
    pitch_at_strike_deg: float = 18.0  # toes up
    pitch_at_toe_off_deg: float = -58.0
    foot_flat: tuple[float, float] = (0.12, 0.60)  # phases of stance between which it lies flat
    clearance: float = 0.04  # [m] by which the ankle is lifted in mid-swing
    ankle_angle: tuple[Bump, ...] = ((-7.0, 0.06, 20.0), (12.0, 0.40, 3.5), (-18.0, 0.63, 11.0))
    """Against cycle phase [deg]."""
    ankle_moment: tuple[Bump, ...] = (
        (0.45, 0.28, 6.0), (0.35, 0.37, 14.0), (1.35, 0.475, 11.0), (-0.15, 0.05, 30.0),
    )  # fmt: skip
    """Internal plantarflexion moment [N*m/kg]: 0.5 at midstance, 1.4 at push-off, 0 in swing."""
    roll_lever: float = 0.004  # [m] of the load about the foot's forward axis
    spin_moment: float = 0.03  # [N*m/kg] about the foot's upward axis
    release_s: float = 0.3  # after toe-off in which the foot leaves the platform's motion
    yield_s: float = 0.2  # after the onset within which the shank yields
    standing_share: float = 0.5  # of the body that the foot on the plate carries in quiet standing


class UnloadedMotion(Settings):
    """The perturbation of an unloaded platform."""

    command_s: float = 0.5
    hold_s: float = 0.5
    tilt_deg: float = 2.0
    shift: Place = (0.012, 0.008, 0.006)  # along each axis


class Recorders(Settings):
    """What the recorders do, beyond their imperfections."""

    high: float = 5.0  # [V] of the synchronisation line and the trigger
    trigger_s: float = 0.02  # for which the trigger is high
    # shortest and longest between two changes of the synchronisation line
    sync_interval_s: tuple[float, float] = (0.06, 0.25)
    # gaps in which a marker is hidden, shortest and longest
    short_gap_s: tuple[float, float] = (0.007, 0.04)
    long_gap_s: tuple[float, float] = (0.05, 0.2)
    long_gap_share: float = 0.25  # of all gaps
    # share of a period of the leg's clock that rounding put before the first sample or after the
    # last
    clock_margin: float = 1e-6


MARKERS = MarkerPlaces()
NOMINAL = NominalGait()
UNLOADED = UnloadedMotion()
RECORDERS = Recorders()


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
    """Ramp of the platform about a mediolateral axis; toes up, if the conditions of the campaign do
    not say more."""

    angle_deg: Annotated[float, Field(gt=0, le=60)]
    rise_s: Seconds
    latency_s: NotNegative  # from the command to the start of the ramp
    stance_phase: Annotated[tuple[Share, Share], AfterValidator(check_rising)]
    """First and last share of stance at which the ramp is commanded, drawn evenly."""
    # after toe-off, when the platform starts to return
    hold_s: Annotated[float, Field(ge=0, le=10)]
    return_s: Seconds


class Body(Settings):
    """The inertia of a body. Its mass is the size of an effect (`foot_inertia` or
    `plate_inertia`)."""

    centre_of_mass_m: Place  # in the body's axes
    gyration_m: tuple[Metres, Metres, Metres]  # principal radii about the centre of mass


class MovingPlate(Body):
    """The force plate. Its centre of mass is given from the centre of its surface."""

    centre_m: Place  # of the surface at rest, in laboratory axes
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
