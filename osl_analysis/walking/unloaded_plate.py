"""Trials with nobody on the platform: what the plate itself weighs, and how late it is."""

import warnings
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from osl_analysis.errors import InputError
from osl_analysis.signals import LowPass, longest_run, runs, sampling_rate
from osl_analysis.trial import Array, Trial
from osl_analysis.walking.ankle import StaticCalibration
from osl_analysis.walking.kinematics import BodyMotion, body_motion
from osl_analysis.walking.moving_plate import Wrench, at_marker_times, rotation_from_rest
from osl_analysis.walking.plate_inertia import PlateModel, identify_plate_inertia
from osl_analysis.walking.plate_lag import find_plate_lag
from osl_analysis.walking.rigid_body import Poses, smoothed
from osl_analysis.walking.segments import plate_centre, plate_wrench, reference_of, segment_poses
from osl_analysis.walking.settings import WalkingAnalysis

UNSEEN = np.deg2rad(0.2)
"""Turn of the platform [rad] behind hidden markers that counts; a platform at rest turns by 0.03 deg of noise."""


@dataclass(frozen=True)
class UnloadedRecording:
    """An unloaded, moving plate: motion of its centre at the marker frames `time` (n,) [s], of which `rows` are used;
    wrench in its own axes at its own stamps `plate_time` (k,) [s]. Motion and wrench have passed the low-pass of the
    crossings; `smooth` is the further one of the identification. `hidden`: it turned while its markers were not seen.
    """

    name: str
    time: Array
    rows: slice
    motion: BodyMotion
    plate_time: Array
    wrench: Wrench
    low_pass: LowPass
    plate_low_pass: LowPass
    hidden: bool

    def smooth(self, values: Array) -> Array:
        """Values at the frames `rows`, shape (n, ...), through the low-pass of the identification."""
        return self.plate_low_pass(values, sampling_rate(self.time))

    def wrench_at(self, lag: float) -> Wrench:
        """The wrench at the frames `rows`, read a lag [s] later, through both low-passes."""
        rate, read = sampling_rate(self.time), at_marker_times(self.plate_time, self.wrench, self.time, lag)
        force, moment = (self.smooth(self.low_pass(part, rate)[self.rows]) for part in (read.force, read.moment))
        return Wrench(force, moment)


def identify_plate_model(
    trials: Sequence[Trial], calibration: StaticCalibration, settings: WalkingAnalysis
) -> PlateModel:
    """Lag and inertia from unloaded trials: the lag per trial first, then one inertia from all at the mean lag.

    Raises
    ------
    InputError
        No trials, a foot on the plate, or a platform that was not seen while it moved, or did not move.
    """
    if not trials:
        raise InputError("no trials with nobody on the platform; add trials of experiment 'plate' to the sheet")
    recordings = followed([unloaded_recording(trial, calibration, settings) for trial in trials])
    lags = [lag_of(r) if settings.correct_plate_lag else float("nan") for r in recordings]
    model, every = plate_model(recordings, lags), range(len(recordings))
    if len(recordings) == 1:
        return model
    others, names = [[i for i in every if i != one] for one in every], model.inertia.identified
    left_out = [plate_model([recordings[i] for i in kept], [lags[i] for i in kept], names) for kept in others]
    return replace(model, left_out=tuple(left_out))


def plate_model(
    recordings: Sequence[UnloadedRecording], lags: Sequence[float], names: tuple[str, ...] | None = None
) -> PlateModel:
    """The plate's lag from those of the recordings [s], NaN where one cannot tell, and one inertia from all at it.

    `names` of the inertial parameters, where it is known which the plate shows.
    """
    told = np.array([lag for lag in lags if np.isfinite(lag)])
    lag = float(np.mean(told)) if len(told) else 0.0
    inertia = identify_plate_inertia([(r.motion, r.wrench_at(lag)) for r in recordings], recordings[0].smooth, names)
    error = float(np.std(told, ddof=1) / np.sqrt(len(told))) if len(told) > 1 else None
    return PlateModel(inertia, lag, error, told)


def followed(recordings: Sequence[UnloadedRecording]) -> list[UnloadedRecording]:
    """The recordings whose platform was seen while it turned; the others are named in a warning.

    Raises
    ------
    InputError
        There is none.
    """
    hidden = [r for r in recordings if r.hidden]
    if len(hidden) == len(recordings):
        raise InputError(
            f"the platform's markers were hidden while it turned, in every unloaded trial ({hidden[0].name}, ...); "
            "fill the gaps in Nexus, record one again, or raise longest_fitted_gap_s"
        )
    for r in hidden:
        warnings.warn(
            f"trial {r.name}: left out: its platform turned behind hidden markers; fill the gap in Nexus or record it "
            "again",
            stacklevel=2,
        )
    return [r for r in recordings if not r.hidden]


def lag_of(recording: UnloadedRecording) -> float:
    """Lag [s] of the plate in one trial, NaN if its plate is too light to tell."""
    try:
        return find_plate_lag(recording.motion, recording.wrench_at, recording.smooth)
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
    rows = longest_run(poses.seen())
    if rows.stop - rows.start < 10:
        raise InputError(
            f"trial {trial.name}: markers {', '.join(names)} are not seen together; record the trial again"
        )
    seen = smoothed(
        poses[rows],
        reference_of(calibration.platform, names, trial.name),
        settings.low_pass,
        sampling_rate(time),
    )
    motion = body_motion(time[rows], seen, plate_centre(trial, settings.plate))
    turned = float(np.rad2deg(np.max(rotation_from_rest(poses[rows]))))
    still = turned < settings.perturbation_deg
    if still and poses.seen().all():
        raise InputError(
            f"trial {trial.name}: the platform turns by {turned:.2f} deg only, expected {settings.perturbation_deg:g} "
            "deg or more; record a perturbation with nobody on it"
        )
    hidden = still or hidden_turn(time, poses, settings.longest_fitted_gap_s) > UNSEEN
    filters = settings.low_pass, settings.plate_low_pass
    return UnloadedRecording(trial.name, time, rows, motion, plate_time, wrench, *filters, hidden)


def hidden_turn(time: Array, poses: Poses, longest: float) -> float:
    """The largest angle [rad] by which the platform turned while its markers were hidden for more than `longest` [s].

    A bridge across the turn is no motion: 11 frames of it at 300 Hz move the lag of that trial by 2 ms.
    """
    rotation, step = rotation_from_rest(poses), time[1] - time[0]
    gaps = [gap for gap in runs(poses.bridged) if (gap.stop - gap.start - 0.5) * step > longest]
    return max((abs(float(rotation[gap.stop] - rotation[gap.start - 1])) for gap in gaps), default=0.0)
