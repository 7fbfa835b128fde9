# SPDX-License-Identifier: Apache-2.0
"""Choices of the walking analysis in `config.yaml`, each with its unit."""

from typing import Annotated, ClassVar, Literal, Self

import numpy as np
from pydantic import AfterValidator, Field, model_validator

from osl_analysis.base.yaml_settings import (
    FilterOrder,
    JointDegrees,
    Newtons,
    NotNegative,
    Positive,
    Seconds,
    Settings,
    check_distinct,
    check_rising,
    require_at_most,
)
from osl_analysis.signals.filters import LowPass

Marker = Annotated[str, Field(min_length=1)]
Names = Annotated[tuple[Marker, ...], AfterValidator(check_distinct)]
Cluster = Annotated[Names, Field(min_length=3)]
Side = Literal["left", "right"]

Coordinate = Annotated[float, Field(ge=-1, le=1)]  # [m] of a point of the foot
Load = Annotated[float, Field(gt=0, le=10)]  # a share of the weight; what is larger is in percent


class Markers(Settings):
    """Names of the markers: three or more per rigid cluster, and the malleoli, which the static
    trial shows."""

    foot: Cluster  # Of the cluster on the foot
    shank: Cluster  # Of the cluster on the shank
    platform: Cluster  # Of the cluster on the platform
    ankle_medial: Marker  # On the medial malleolus, in the static trial
    ankle_lateral: Marker  # On the lateral malleolus, in the static trial

    @property
    def clusters(self) -> dict[str, tuple[str, ...]]:
        """Names of the markers of each segment."""
        return {"foot": self.foot, "shank": self.shank, "platform": self.platform}

    @model_validator(mode="after")
    def _are_apart(self) -> Self:
        check_distinct((self.ankle_medial, self.ankle_lateral))
        check_distinct((*self.foot, *self.shank, *self.platform))
        return self


class FootSettings(Settings):
    """Inertial parameters of all that moves below the ankle."""

    mass_kg: Annotated[float, Field(gt=0, le=20)]  # Mass [kg]
    centre_of_mass_m: tuple[Coordinate, Coordinate, Coordinate]
    """Centre of mass [m] from the ankle centre in the static pose: x forward, y to the left, z
    up."""
    # Moment of inertia [kg*m^2] about the mediolateral axis through the centre of mass
    inertia_kg_m2: NotNegative


class OutlierRule(Settings):
    """Which crossings are excluded: those further from the median crossing than `limit` scatters.

    The scatter is 1.4826 times the median absolute deviation, and for each feature at least the
    smallest scatter given here, so that few crossings that agree by chance exclude no sound one.
    """

    limit: Positive  # Largest distance from the median, in scatters
    stance_s: ClassVar[float] = 0.01  # [s] of the duration of stance
    # [deg] of the angle's RMS deviation from the median gait, before any onset
    angle_deg: ClassVar[float] = 0.5
    torque_nm: ClassVar[float] = 2.0  # [N*m] of the torque's RMS deviation, over the same time
    # of the vertical force's RMS deviation, as a share of the usual load: of 300 groups of 5 to 24
    # crossings whose loads scatter by 1, 3 and 5 %, it excludes 0, 0.3 and 0.7 % of the crossings
    load_share: ClassVar[float] = 0.01
    # [m] of the RMS deviation of the centre of pressure, to the left of the ankle
    pressure_m: ClassVar[float] = 0.005


class MarkerSettings(Settings):
    """Which markers form the rigid clusters, and when a cluster counts as occluded."""

    markers: Markers  # Names of the markers
    longest_gap_s: NotNegative  # Longest gap [s] of occluded markers that is interpolated
    # Largest RMS distance [mm] of markers from their rigid body; else they are occluded
    largest_residual_mm: ClassVar[float] = 5.0


class WalkingFilter(Settings):
    """The one zero-phase Butterworth low-pass of markers and wrench."""

    # Cut-off [Hz] of one run of the filter, up to half the rate of fast cameras
    cutoff_hz: Annotated[float, Field(gt=0, le=200)]
    order: FilterOrder  # Order of one run of the filter

    @property
    def low_pass(self) -> LowPass:
        return LowPass(self.cutoff_hz, self.order)


class TimingSettings(Settings):
    """Which samples around the onset of a perturbation are used."""

    window_s: Positive  # Time [s] after the onset that is fitted
    # Length [s] of the interval before the onset whose mean is the response's zero
    baseline_s: Positive
    # Time [s] from the end of the baseline to the onset, which the zero-phase filter spreads
    guard_s: NotNegative


class PlatformSettings(MarkerSettings, WalkingFilter):
    """The moving platform and its force plate."""

    plate: Annotated[int, Field(ge=1)]  # Number of the force plate on the platform, counted from 1
    # Smallest rotation [deg] of the platform that counts as a perturbation
    perturbation_deg: JointDegrees
    # Longest gap [s] where the motion is fitted: after an onset, in an unloaded turn
    longest_fitted_gap_s: NotNegative
    # Cut-off [Hz] of the plate's inertia and lag: 12 kg are 10.8 kg at 20 Hz, 12.0 kg at 8 Hz
    plate_cutoff_hz: ClassVar[float] = 8.0

    @property
    def plate_low_pass(self) -> LowPass:
        return LowPass(self.plate_cutoff_hz, self.order)

    @property
    def smallest_turn(self) -> float:
        """Rotation [rad] from which on the platform perturbs."""
        return float(np.deg2rad(self.perturbation_deg))

    _gaps = require_at_most(
        "longest_fitted_gap_s", "longest_gap_s", "up to which gaps are interpolated at all"
    )


class CalibrationSettings(MarkerSettings):
    """How the ankle's centre and axis are calibrated."""

    side: Side  # Side of the subject that wears the prosthesis


class PlateModelSettings(PlatformSettings):
    """How the plate's own inertia and lag are identified, or `none`: the plate is light or
    compensates them itself."""

    # From the plate trials; `none`: nothing is removed from the wrench
    plate_inertia: Literal["identified", "none"] = "identified"


class CrossingSettings(PlatformSettings, TimingSettings):
    """How angle and torque of a crossing are computed, and the motion that perturbations share."""

    load_on_n: Newtons  # Vertical force [N] above which a stance begins
    # [s]; shorter contacts are no stance: a quick step takes twice as long
    shortest_stance_s: ClassVar[float] = 0.3
    # Length [s] before the step from which the plate's zero is read; null: none is removed
    unloaded_s: Seconds | None
    # Null: the foot's weight and inertia stay in the torque, so that I includes them
    foot: FootSettings | None = None

    _fits = require_at_most(
        "window_s + baseline_s + guard_s",
        "shortest_stance_s",
        "which must hold a whole response",
    )


class SelectionSettings(TimingSettings):
    """Which crossings are excluded."""

    outliers: OutlierRule  # Rule by which crossings are compared and excluded
    # in single support, as a share of the weight
    load_of_weight: Annotated[tuple[Load, Load], AfterValidator(check_rising)]


class WalkingAnalysis(CalibrationSettings, PlateModelSettings, CrossingSettings, SelectionSettings):
    """All choices of the walking analysis."""

    # Fewest unperturbed crossings from which a mean gait is computed
    fewest_unperturbed: Annotated[int, Field(ge=3)]
