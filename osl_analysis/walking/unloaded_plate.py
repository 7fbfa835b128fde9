"""Trials with nobody on the platform: what the plate itself weighs, and how late it is."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from osl_analysis.errors import InputError
from osl_analysis.signals import LowPass, sampling_rate
from osl_analysis.trial import Array, Trial
from osl_analysis.walking.ankle import StaticCalibration
from osl_analysis.walking.kinematics import BodyMotion, body_motion
from osl_analysis.walking.moving_plate import Wrench, at_marker_times, rotation_from_rest
from osl_analysis.walking.plate_inertia import PlateModel, identify_plate_inertia
from osl_analysis.walking.plate_lag import find_plate_lag
from osl_analysis.walking.rigid_body import Poses, smoothed
from osl_analysis.walking.segments import plate_centre, plate_wrench, reference_of, segment_poses
from osl_analysis.walking.settings import WalkingAnalysis


@dataclass(frozen=True)
class UnloadedRecording:
    """An unloaded, moving plate: motion of its centre at the marker frames `time` (n,) [s], of which `rows` are used;
    wrench in its own axes at its own stamps `plate_time` (k,) [s]."""

    name: str
    time: Array
    rows: slice
    motion: BodyMotion
    plate_time: Array
    wrench: Wrench
    low_pass: LowPass

    def wrench_at(self, lag: float) -> Wrench:
        """The wrench at the marker frames, read a lag [s] later, low-passed like the motion."""
        rate, read = (
            sampling_rate(self.time),
            at_marker_times(self.plate_time, self.wrench, self.time, lag),
        )
        return Wrench(self.low_pass(read.force, rate), self.low_pass(read.moment, rate))[self.rows]


def identify_plate_model(
    trials: Sequence[Trial], calibration: StaticCalibration, settings: WalkingAnalysis
) -> PlateModel:
    """Lag and inertia from unloaded trials: the lag per trial first, then one inertia from all at the mean lag.

    Raises
    ------
    InputError
        No trials, a foot on the plate, or a platform that was not seen or did not move.
    """
    if not trials:
        raise InputError("no trials with nobody on the platform; add trials of experiment 'plate' to the sheet")
    recordings = [unloaded_recording(trial, calibration, settings) for trial in trials]
    tell = recordings if settings.correct_plate_lag else []
    lags = np.array([lag_of(r) for r in tell])
    lags = lags[np.isfinite(lags)]
    lag = float(np.mean(lags)) if len(lags) else 0.0
    inertia = identify_plate_inertia([(r.motion, r.wrench_at(lag)) for r in recordings])
    error = float(np.std(lags, ddof=1) / np.sqrt(len(lags))) if len(lags) > 1 else None
    return PlateModel(inertia, lag, error, lags)


def lag_of(recording: UnloadedRecording) -> float:
    """Lag [s] of the plate in one trial, NaN if its plate is too light to tell."""
    try:
        return find_plate_lag(recording.motion, recording.wrench_at)
    except InputError as error:
        raise InputError(f"trial {recording.name}: {error}") from error


def unloaded_recording(trial: Trial, calibration: StaticCalibration, settings: WalkingAnalysis) -> UnloadedRecording:
    """The plate's motion over the longest stretch in which the platform was seen, and its wrench."""
    names = settings.markers.platform
    time, poses = segment_poses(trial, names, calibration.platform, settings)
    plate_time, wrench = plate_wrench(trial, settings.plate)
    loaded = float(np.median(np.abs(wrench.force[:, 2])))
    if loaded > settings.largest_zero_n:
        raise InputError(
            f"trial {trial.name}: the plate carries {loaded:.0f} N, expected nobody on it; zero the plate, or take "
            "experiment 'plate' off this trial in the sheet"
        )
    rows = longest_run(poses)
    if rows.stop - rows.start < 10:
        raise InputError(
            f"trial {trial.name}: markers {', '.join(names)} are not seen together; record the trial again"
        )
    seen = smoothed(
        poses[rows],
        reference_of(calibration.platform, names, trial.name),
        settings.plate_low_pass,
        sampling_rate(time),
    )
    motion = body_motion(time[rows], seen, plate_centre(trial, settings.plate))
    turned = float(np.rad2deg(np.max(rotation_from_rest(poses[rows]))))
    if turned < settings.perturbation_deg:
        raise InputError(
            f"trial {trial.name}: the platform turns by {turned:.2f} deg only, expected {settings.perturbation_deg:g} "
            "deg or more; record a perturbation with nobody on it"
        )
    return UnloadedRecording(trial.name, time, rows, motion, plate_time, wrench, settings.plate_low_pass)


def longest_run(poses: Poses) -> slice:
    """The longest run of frames that have a pose."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], poses.seen().astype(int), [0]])))
    starts, ends = edges[::2], edges[1::2]
    if not len(starts):
        return slice(0, 0)
    best = int(np.argmax(ends - starts))
    return slice(int(starts[best]), int(ends[best]))
