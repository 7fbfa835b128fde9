"""Choices of the walking analysis, each with its unit: they stand in `config.yaml`, physical constants do not."""

from typing import Annotated, Literal

from pydantic import Field

from osl_analysis.signals import LowPass
from osl_analysis.yaml_settings import Settings

Positive = Annotated[float, Field(gt=0)]
Cluster = Annotated[tuple[str, ...], Field(min_length=3)]


class Markers(Settings):
    """Names of the markers: three or more per rigid cluster, and the malleoli that the static trial shows."""

    foot: Cluster
    shank: Cluster
    platform: Cluster
    ankle_medial: str
    ankle_lateral: str


class FootSettings(Settings):
    """What moves below the ankle [kg, m, kg*m^2]: centre of mass from the ankle centre in the static pose (x forward,
    y left, z up), inertia about the mediolateral axis through it."""

    mass_kg: Positive
    centre_of_mass_m: tuple[float, float, float]
    inertia_kg_m2: Annotated[float, Field(ge=0)]


class OutlierRule(Settings):
    """Which crossings are left out: those that lie further from the median crossing than `limit` times the scatter.

    The scatter is 1.4826 times the median absolute deviation, that of a normal distribution, but at least `stance_s`
    of the duration of stance, `placement_m` of the foot's place on the plate, `angle_deg` of the ankle's angle between
    heel strike and the earliest baseline's end (RMS deviation from the median gait).
    """

    limit: Positive
    stance_s: Positive
    placement_m: Positive
    angle_deg: Positive


class WalkingAnalysis(Settings):
    """How angle and torque of a crossing come about, and which stretch of them is fitted.

    `cutoff_hz`, `order`: the one zero-phase low-pass of markers and wrench. `plate_cutoff_hz`: the one with which the
    unloaded plate is identified. Its parameters do not depend on it, but the noise of markers in an acceleration does,
    and biases them: 12 kg read 10.8 kg at 20 Hz and 12.0 kg at 8 Hz. `window_s` after the onset is fitted; the response
    is zero on the mean of the `baseline_s` that end `guard_s` before the onset, so that what the zero-phase filter
    smears ahead of the onset stays out. `load_on_n`, `load_off_n`: hysteresis [N] of the vertical force that makes a
    stance of at least `shortest_stance_s`. The plate's zero is its mean over `unloaded_s` before the foot comes (null:
    taken as recorded); a plate that reads more than `largest_zero_n` then is refused. `perturbation_deg`: rotation
    above which the platform has moved. `longest_gap_s`: hidden markers are bridged up to here, and up to
    `longest_fitted_gap_s` where the motion itself is fitted: around a perturbation, and while the unloaded platform
    turns. `largest_residual_mm`: beyond, a cluster is not rigid. `perturbed_stance`: the duration that turns a
    perturbed crossing's time into phase, its `own`, or the `normal` one (mean of the unperturbed) for perturbations
    that change how long stance lasts. `hinge`: the ankle's axis from the malleoli in the static trial, or functional,
    from how foot and shank turn against each other. `outliers`: null leaves no crossing out. `foot`: null leaves the
    foot's weight and inertia in the torque, where its inertia adds to I.
    """

    cutoff_hz: Positive
    order: Annotated[int, Field(ge=1, le=10)]
    plate_cutoff_hz: Positive
    side: Literal["left", "right"]
    plate: Annotated[int, Field(ge=1)]
    markers: Markers
    window_s: Positive
    baseline_s: Positive
    guard_s: Annotated[float, Field(ge=0)]
    load_on_n: Positive
    load_off_n: Positive
    unloaded_s: Positive | None
    largest_zero_n: Positive
    shortest_stance_s: Positive
    perturbation_deg: Positive
    longest_gap_s: Annotated[float, Field(ge=0)]
    longest_fitted_gap_s: Annotated[float, Field(ge=0)]
    largest_residual_mm: Positive
    fewest_unperturbed: Annotated[int, Field(ge=3)]
    hinge: Literal["anatomical", "functional"]
    outliers: OutlierRule | None
    perturbed_stance: Literal["own", "normal"]
    correct_plate_lag: bool
    bootstrap_samples: Annotated[int, Field(ge=100)]
    foot: FootSettings | None = None

    @property
    def low_pass(self) -> LowPass:
        """The filter of every signal of a crossing."""
        return LowPass(self.cutoff_hz, self.order)

    @property
    def plate_low_pass(self) -> LowPass:
        """The filter of every signal of an unloaded plate."""
        return LowPass(self.plate_cutoff_hz, self.order)


class GaitAnalysis(Settings):
    """Overground gait beside a laboratory's own ankle moment.

    Frames count while the vertical force is above `load_on_n` [N]. `body_mass_kg`: null takes the recording's.
    A plate that reads less than minus `largest_zero_n` [N] in most of the record is refused.
    """

    load_on_n: Positive
    body_mass_kg: Positive | None = None
    largest_zero_n: Positive = 100
