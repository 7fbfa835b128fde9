"""How well one crossing was recorded: the columns of `walking_crossings.csv` that show it."""

from dataclasses import dataclass

import numpy as np
import scipy

from osl_analysis.errors import InputError
from osl_analysis.measured import check_measured
from osl_analysis.plates import furthest_outside
from osl_analysis.signals import LowPass, sampling_rate
from osl_analysis.signals.grid import GapLimits, uniform_signals
from osl_analysis.trial import Array, Trial
from osl_analysis.walking.ankle import VERTICAL, Ankle, LoadOnFoot
from osl_analysis.walking.passage import Passage, followed_segments
from osl_analysis.walking.plate_model import PlateModel
from osl_analysis.walking.poses import StaticCalibration
from osl_analysis.walking.setup_checks import FLAT, phases_between
from osl_analysis.walking.walking_settings import CrossingSettings

FEWEST_ENCODER_SAMPLES = 30  # that overlap with the markers
LARGEST_DELAY_S = 0.05  # of the encoder, beyond which the clocks are not aligned
NEWTON_STEPS = 8


@dataclass(frozen=True)
class CrossingQuality:
    """Measures of one crossing; None where unknown. The dictionary says what each is."""

    heading_deg: float | None = None
    foot_forward_m: float | None = None
    foot_left_m: float | None = None
    foot_outside_m: float | None = None
    foot_residual_mm: float | None = None
    platform_residual_mm: float | None = None
    shank_residual_mm: float | None = None
    plate_zero_N: float | None = None
    plate_unexplained: float | None = None
    filled_fitted: float | None = None
    encoder_offset_deg: float | None = None
    encoder_delay_ms: float | None = None
    encoder_rms_deg: float | None = None


@dataclass(frozen=True)
class EncoderComparison:
    """The joint encoder beside the angle from markers: encoder(t + delay) = theta(t) + offset.

    The shoe's compliance is the part of their difference that follows the torque.
    """

    offset_deg: float
    delay_ms: float
    rms_deg: float  # of the residual


def crossing_quality(
    trial: Trial,
    passage: Passage,
    ankle: Ankle,
    load: LoadOnFoot,
    unloaded: PlateModel,
    calibration: StaticCalibration,
    encoder: EncoderComparison | None,
    settings: CrossingSettings,
) -> CrossingQuality:
    """Measure the quality of a crossing that markers and plate recorded."""
    flat = phases_between(passage.stance.phase(passage.time), FLAT)
    foot = passage.poses["foot"][flat]
    plate_centre = passage.corners.mean(axis=0)
    from_plate = foot.point(calibration.ankle_centre).mean(axis=0) - plate_centre
    forward = unit_vector(ankle.forward[flat].mean(axis=0))
    left = np.cross(VERTICAL, forward)
    labels = followed_segments(settings)
    markers = foot.points(calibration.positions(labels["foot"], "static"))

    residuals = {segment: residual_mm(passage, segment) for segment in labels}
    filled = filled_shares(passage, settings)
    return CrossingQuality(
        heading_deg=float(np.rad2deg(np.arctan2(forward[1], forward[0]))),
        foot_forward_m=float(from_plate @ forward),
        foot_left_m=float(from_plate @ left),
        foot_outside_m=furthest_outside(markers.reshape(-1, 3), passage.corners),
        foot_residual_mm=residuals.get("foot"),
        platform_residual_mm=residuals.get("platform"),
        shank_residual_mm=residuals.get("shank"),
        plate_zero_N=passage.wrench.zero,
        plate_unexplained=unloaded.unexplained,
        filled_fitted=filled.fitted,
        encoder_offset_deg=None if encoder is None else encoder.offset_deg,
        encoder_delay_ms=None if encoder is None else encoder.delay_ms,
        encoder_rms_deg=None if encoder is None else encoder.rms_deg,
    )


def unit_vector(vector: Array) -> Array:
    return np.asarray(vector / np.linalg.norm(vector))


def residual_mm(passage: Passage, segment: str) -> float:
    """RMS distance [mm] of a segment's markers from their rigid body in stance."""
    residual = passage.recorded[segment][passage.rows].residual
    in_stance = residual[passage.inside & np.isfinite(residual)]
    return 1e3 * float(np.sqrt(np.mean(in_stance**2))) if len(in_stance) else float("nan")


@dataclass(frozen=True)
class FilledShares:
    """Shares of frames in which a marker was filled before the export, which hides the gap.

    `fitted` is from baseline to the end of the window, and counts only poses that rest on the
    filling. None if no cluster tells.
    """

    in_stance: float | None
    fitted: float | None


def filled_shares(passage: Passage, settings: CrossingSettings) -> FilledShares:
    filled_of_clusters = []
    bridged_of_clusters = []
    for recorded in passage.recorded.values():
        pose = recorded[passage.rows]
        if pose.filled is not None:
            filled_of_clusters.append(pose.filled)
            bridged_of_clusters.append(pose.filled & pose.bridged)
    if not filled_of_clusters:
        return FilledShares(None, None)

    filled = np.any(filled_of_clusters, axis=0)
    in_stance = float(np.mean(filled[passage.inside]))
    if passage.onset is None:
        return FilledShares(in_stance, None)
    since = passage.time - passage.onset
    fitted = (since >= -settings.guard_s - settings.baseline_s) & (since <= settings.window_s)
    resting_on_fill = np.any(bridged_of_clusters, axis=0)
    return FilledShares(
        in_stance, float(np.mean(resting_on_fill[fitted])) if fitted.any() else None
    )


def compare_encoder(
    trial: Trial, time: Array, theta: Array, torque: Array, low_pass: LowPass
) -> EncoderComparison | None:
    """Compare the joint's encoder, a column of the trial, with the angle from markers.

    Both pass one low-pass.

    Parameters
    ----------
    time, theta, torque : Array
        Times [s], angle from markers [rad] and torque [N*m], (n,) each.

    Returns
    -------
    EncoderComparison or None
        None if fewer than 30 samples overlap.

    Raises
    ------
    InputError
        The encoder does not follow the markers.
    """
    if "theta" not in trial.columns:
        return None
    if trial.samples["theta"].count() < FEWEST_ENCODER_SAMPLES:
        return None
    encoder = uniform_signals(trial, ["theta"], GapLimits(cutoff_hz=low_pass.cutoff_hz))
    check_measured("the angle from markers", theta)
    check_measured("the encoder's angle", encoder["theta"])

    spare = LARGEST_DELAY_S + 1 / sampling_rate(time)
    inside = (time > encoder.time[0] + spare) & (time < encoder.time[-1] - spare)
    usable = np.interp(time, encoder.time, encoder.usable) == 1
    rows = inside & usable
    if rows.sum() < FEWEST_ENCODER_SAMPLES:
        return None
    spline = scipy.interpolate.make_interp_spline(
        encoder.time, low_pass(encoder["theta"], sampling_rate(encoder.time)), k=5
    )
    offset, delay = 0.0, 0.0
    for _ in range(NEWTON_STEPS):
        residual = spline(time[rows] + delay) - theta[rows] - offset
        columns = np.column_stack([np.ones(len(residual)), -spline(time[rows] + delay, 1)])
        change = np.linalg.lstsq(columns, residual, rcond=None)[0]
        offset += float(change[0])
        delay += float(change[1])
        if abs(delay) > LARGEST_DELAY_S:
            raise InputError(
                "the leg's joint encoder does not follow the angle from markers within"
                f" {LARGEST_DELAY_S * 1e3:g} ms; check the sync line, and which encoder and which"
                " sign the source file maps to theta"
            )

    residual = spline(time[rows] + delay) - theta[rows] - offset
    return EncoderComparison(
        offset_deg=float(np.rad2deg(offset)),
        delay_ms=1e3 * delay,
        rms_deg=float(np.rad2deg(np.sqrt(np.mean(residual**2)))),
    )
