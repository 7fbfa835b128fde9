"""Steps 1 to 3 of one crossing: its poses, its stance on the plate, and the onset in it."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from osl_analysis.errors import InputError
from osl_analysis.signals import longest_run, runs, sampling_rate
from osl_analysis.trial import Array, Trial
from osl_analysis.walking import poses
from osl_analysis.walking.mean_ramp import ramp_of, ramp_onsets
from osl_analysis.walking.plate import (
    ZeroedWrench,
    check_plate,
    check_type_on_platform,
    recorded_corners,
    zeroed_wrench,
)
from osl_analysis.walking.poses import Mask, Poses, StaticCalibration
from osl_analysis.walking.setup_checks import check_onset, check_vertical
from osl_analysis.walking.stance import Stance, only_stance
from osl_analysis.walking.walking_settings import CrossingSettings

SPARE_S = 0.1  # before and after stance, for the low-pass
ONE_CROSSING = (
    "check the plate's number, zero and load thresholds, cut the recording to one crossing"
)


@dataclass(frozen=True)
class Passage:
    """A crossing as markers and plate recorded it, in all k frames and in n `rows`.

    The rows are stance, and up to 0.1 s before and after it for the low-pass.
    """

    name: str
    frames: Array  # time (k,) [s] of all frames
    recorded: dict[str, Poses]  # of foot, shank and platform in all frames, not low-passed
    wrench: ZeroedWrench  # of the plate, in all frames
    corners: Array  # of the plate (4, 3) [m] at rest
    stance: Stance
    onset: float | None  # of the perturbation [s]
    rows: slice
    poses: dict[str, Poses]  # in `rows`, low-passed

    @property
    def time(self) -> Array:
        return self.frames[self.rows]

    @property
    def inside(self) -> Mask:
        """Which of `rows` are in stance."""
        return in_stance(self.time, self.stance)


def in_stance(time: Array, stance: Stance) -> Mask:
    return np.asarray((time >= stance.heel_strike) & (time <= stance.toe_off))


def recorded_passage(
    trial: Trial,
    calibration: StaticCalibration,
    lag: float,
    perturbed: bool,
    settings: CrossingSettings,
    onset: float | None = None,
) -> Passage:
    """Find poses, stance and onset of a crossing.

    Parameters
    ----------
    lag : float
        Of the plate behind the markers [s].
    perturbed : bool
        Whether the sheet says so.
    onset : float or None
        Of the perturbation [s], by the mean ramp of all crossings; None: by its own ramp.

    Raises
    ------
    InputError
        The recording is not one crossing, or its plate or markers cannot be used.
    """
    recorded = {}
    reference = {}
    for segment, labels in settings.markers.clusters.items():
        frames, recorded[segment] = poses.segment_poses(trial, labels, calibration, settings)
        reference[segment] = calibration.positions(labels, trial.name)

    wrench = zeroed_wrench(trial, frames, settings)
    force = wrench.read(lag)[:, :3]
    check_vertical(force)
    stance = only_stance(frames, force[:, 2], settings, "on the plate", ONE_CROSSING)
    check_plate(trial, settings.plate, stance, force[:, 2])
    corners = recorded_corners(trial, settings.plate)

    onset = onset_of(trial, frames, recorded, stance, perturbed, settings, onset)
    for segment, pose in recorded.items():
        check_same_cluster(segment, trial, frames, pose, stance, reference[segment], settings)
        check_followed(segment, frames, pose, stance)

    rows = rows_about_stance(frames, recorded, stance)
    rate = sampling_rate(frames)
    low_passed = {}
    for segment, cluster in reference.items():
        markers = settings.low_pass(recorded[segment][rows].points(cluster), rate)
        low_passed[segment] = poses.cluster_poses(cluster, markers)
    return Passage(trial.name, frames, recorded, wrench, corners, stance, onset, rows, low_passed)


def check_same_cluster(
    segment: str,
    trial: Trial,
    frames: Array,
    pose: Poses,
    stance: Stance,
    reference: Array,
    settings: CrossingSettings,
) -> None:
    """Refuse a cluster that was put on again since the static trial, where its markers were at
    `reference` (m, 3) [m]."""
    inside = in_stance(frames, stance)
    in_stance_residual = pose.residual[inside & np.isfinite(pose.residual)]
    residual_mm = 1e3 * float(np.median(np.r_[0.0, in_stance_residual]))
    if residual_mm <= settings.largest_residual_mm:
        return
    labels = settings.markers.clusters[segment]
    tracks = poses.marker_tracks(trial, labels)[1][inside]
    moved = poses.moved_marker(reference, tracks, poses.cluster_poses(reference, tracks))
    raise InputError(
        f"the {segment} markers stand {residual_mm:.0f} mm (RMS) otherwise than in the static trial"
        f" throughout stance, {labels[moved.index]} most, by {1e3 * moved.distance_m:.0f} mm,"
        f" expected {settings.largest_residual_mm:g} mm or less: they were put on again, or carry"
        " other labels; record a static trial after the change and name it in the column static,"
        " correct the labels, or exclude the trial"
    )


def check_followed(segment: str, frames: Array, pose: Poses, stance: Stance) -> None:
    """Refuse a cluster that is hidden in stance."""
    hidden = np.flatnonzero(in_stance(frames, stance) & ~pose.seen())
    if len(hidden):
        raise InputError(
            f"the {segment} markers cannot be followed at {frames[hidden[0]]:.3f} s, in"
            f" {len(hidden)} frames of stance; correct exchanged labels in"
            " Nexus, raise longest_gap_s, or exclude the trial"
        )


def rows_about_stance(frames: Array, recorded: Mapping[str, Poses], stance: Stance) -> slice:
    """Stance and the frames about it in which all clusters were seen."""
    seen = np.all([pose.seen() for pose in recorded.values()], axis=0)
    near = seen & (frames >= stance.heel_strike - SPARE_S) & (frames <= stance.toe_off + SPARE_S)
    first = np.argmax(in_stance(frames, stance))
    return next(run for run in runs(near) if run.start <= first < run.stop)


def onset_of(
    trial: Trial,
    time: Array,
    recorded: Mapping[str, Poses],
    stance: Stance,
    perturbed: bool,
    settings: CrossingSettings,
    of_mean_ramp: float | None,
) -> float | None:
    """Find the onset [s] of the perturbation: that of the mean ramp, else of the crossing's own.

    Returns
    -------
    float or None
        None without a perturbation.

    Raises
    ------
    InputError
        Sheet, stance, plate or markers forbid it.
    """
    ramp = ramp_of(time, recorded["platform"], settings.smallest_turn)
    onset = None
    if ramp is not None:
        onset = of_mean_ramp
        if onset is None:
            onset = ramp_onsets({trial.name: ramp})[trial.name]
    check_onset(onset, perturbed, stance, settings)
    if onset is None:
        return None

    check_type_on_platform(trial, settings.plate)
    window = (time >= onset) & (time <= onset + settings.window_s)
    for segment in ("foot", "platform"):  # the shank carries the body and moves as in any stance
        pose = recorded[segment]
        gap = longest_run(pose.bridged & window)
        if poses.gap_duration(time, gap) > settings.longest_fitted_gap_s:
            hidden_s = (gap.stop - gap.start) * (time[1] - time[0])
            raise InputError(
                f"the {segment} markers are hidden for {1e3 * hidden_s:.0f} ms from"
                f" {time[gap.start]:.3f} s, while the perturbation is"
                f" fitted, expected {1e3 * settings.longest_fitted_gap_s:g} ms or less; exclude the"
                " trial, or record it again with them in sight: a filled response is no measurement"
            )
    return onset
