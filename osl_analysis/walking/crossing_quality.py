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
from osl_analysis.walking.passage import Passage
from osl_analysis.walking.poses import StaticCalibration
from osl_analysis.walking.setup_checks import FLAT, phases_between
from osl_analysis.walking.walking_settings import CrossingSettings

FEWEST_ENCODER_SAMPLES = 30  # that overlap with the markers
LARGEST_DELAY_S = 0.05  # of the encoder, beyond which the clocks are not aligned
NEWTON_STEPS = 8


@dataclass(frozen=True)
class CrossingQuality:
    """Measures of one crossing; None where unknown. The dictionary says what each is."""

    foot_forward_m: float | None = None
    foot_left_m: float | None = None
    foot_outside_m: float | None = None
    pressure_outside_m: float | None = None
    encoder_rms_deg: float | None = None
    different: str | None = None
    different_mm: float | None = None


def crossing_quality(
    passage: Passage,
    ankle: Ankle,
    load: LoadOnFoot,
    calibration: StaticCalibration,
    encoder_rms_deg: float | None,
    settings: CrossingSettings,
) -> CrossingQuality:
    """Measure the quality of a crossing that markers and plate recorded."""
    flat = phases_between(passage.stance.phase(passage.time), FLAT)
    foot = passage.poses["foot"][flat]
    plate_centre = passage.corners.mean(axis=0)
    from_plate = foot.point(calibration.ankle_centre).mean(axis=0) - plate_centre
    forward = unit_vector(ankle.forward[flat].mean(axis=0))
    left = np.cross(VERTICAL, forward)
    markers = foot.points(calibration.positions(settings.markers.foot, "static"))

    from_ankle = load.forward[:, None] * ankle.forward + load.left[:, None] * ankle.axis
    pressure = (ankle.centre + from_ankle)[flat]
    return CrossingQuality(
        foot_forward_m=float(from_plate @ forward),
        foot_left_m=float(from_plate @ left),
        foot_outside_m=furthest_outside(markers.reshape(-1, 3), passage.corners),
        pressure_outside_m=pressure_outside(pressure, markers),
        encoder_rms_deg=encoder_rms_deg,
    )


def unit_vector(vector: Array) -> Array:
    return np.asarray(vector / np.linalg.norm(vector))


def pressure_outside(pressure: Array, markers: Array) -> float:
    """Mean distance [m] of the centre of pressure (n, 3) [m] from the area between foot markers.

    Both are seen from above, the markers (n, m, 3) [m] at their mean place.
    """
    corners = markers.mean(axis=0)[:, :2]
    on_mean_foot = (pressure - markers.mean(axis=1) + markers.mean(axis=(0, 1)))[:, :2]
    hull = scipy.spatial.ConvexHull(corners)
    start = corners[hull.vertices]  # of each edge
    edges = np.roll(start, -1, axis=0) - start
    from_start = on_mean_foot[:, None] - start  # (n, edges, 2)
    along = np.sum(from_start * edges, axis=2) / np.sum(edges**2, axis=1)
    share = np.clip(along, 0.0, 1.0)
    distance = np.linalg.norm(from_start - share[..., None] * edges, axis=2).min(axis=1)
    normals = hull.equations[:, :2]
    offsets = hull.equations[:, 2]
    outside = (on_mean_foot @ normals.T + offsets > 0).any(axis=1)
    return float(np.mean(np.where(outside, distance, 0.0)))


def compare_encoder(trial: Trial, time: Array, theta: Array, low_pass: LowPass) -> float | None:
    """Compare the joint's encoder, a column of the trial, with the angle from markers.

    Both pass one low-pass, and encoder(t + delay) = theta(t) + offset.

    Parameters
    ----------
    time, theta : Array
        Times [s] and angle from markers [rad], (n,) each.

    Returns
    -------
    float or None
        RMS difference [deg]; None if fewer than 30 samples overlap.

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
    return float(np.rad2deg(np.sqrt(np.mean(residual**2))))
