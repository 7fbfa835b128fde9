"""The plate's model from plate trials (unloaded platform): its inertia, and its lag behind the markers."""

import warnings
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import polars as pl

from osl_analysis.errors import InputError
from osl_analysis.signals import LowPass, longest_run, runs, sampling_rate
from osl_analysis.trial import Array, Trial
from osl_analysis.walking.ankle import StaticCalibration
from osl_analysis.walking.cluster import (
    BodyMotion,
    Poses,
    body_motion,
    filtered_poses,
    gap_duration,
    reference_positions,
    segment_poses,
)
from osl_analysis.walking.plate import PlateWrench, RecordedWrench, plate_centre, recorded_wrench, rotation_from_rest
from osl_analysis.walking.plate_faults import check_type_on_platform
from osl_analysis.walking.plate_inertia import COMPONENTS, PlateInertia, identify_plate_inertia, plate_lag
from osl_analysis.walking.settings import PlateModelSettings

FEWEST_FRAMES = 10
HIDDEN_TURN = np.deg2rad(0.2)
"""Smallest rotation [rad] during hidden markers that counts as a turn. At rest, noise gives 0.03 deg."""


@dataclass(frozen=True)
class PlateModel:
    """The plate's inertia and lag.

    inertia: inertial parameters.
    lag: lag [s] behind the markers, the mean of `lags`; 0 if `lags` is empty.
    lag_se: standard error [s] of the lag; None with fewer than two lags.
    lags: lags (k,) [s] of the trials that show one.
    leave_one_out: the model without each trial in turn, for the jackknife; empty with a single trial.
    """

    inertia: PlateInertia
    lag: float
    lag_se: float | None
    lags: Array
    leave_one_out: "tuple[PlateModel, ...]" = ()


@dataclass(frozen=True)
class UnloadedRecording:
    """A trial of an unloaded, moving plate.

    name: the trial.
    time: the marker frames (n,) [s].
    rows: the longest run of frames in which the platform was seen.
    motion: motion of the plate's centre in these rows, through the low-pass of the crossings.
    recorded: the plate's wrench as sampled.
    low_pass: the filter of the crossings.
    plate_low_pass: the further filter of the identification.
    hidden: whether the platform turned while its markers were hidden.
    """

    name: str
    time: Array
    rows: slice
    motion: BodyMotion
    recorded: RecordedWrench
    low_pass: LowPass
    plate_low_pass: LowPass
    hidden: bool

    def smooth(self, values: Array) -> Array:
        """Values in `rows`, shape (n, ...), through the low-pass of the identification."""
        return self.plate_low_pass(values, sampling_rate(self.time))

    def wrench_at(self, lag: float) -> PlateWrench:
        """The wrench in `rows`, read a lag [s] later, through both low-passes."""
        rate = sampling_rate(self.time)
        once = self.recorded.at(self.time, lag).filtered(self.low_pass, rate)
        return once[self.rows].filtered(self.plate_low_pass, rate)


def identify_plate_model(
    trials: Sequence[Trial], calibration: StaticCalibration, settings: PlateModelSettings
) -> PlateModel:
    """Lag and inertia from unloaded trials: first the lag of each trial, then one inertia from all at the mean lag.

    Raises
    ------
    InputError
        There are no trials, a foot is on the plate, or the platform did not move or was hidden while it moved.
    """
    if not trials:
        raise InputError("no trials of the unloaded plate; add trials of experiment 'plate' to the sheet")
    for trial in trials:
        check_type_on_platform(trial, settings.plate)
    recordings = without_hidden_turns([unloaded_recording(trial, calibration, settings) for trial in trials])
    lags = [trial_lag(r) if settings.correct_plate_lag else float("nan") for r in recordings]
    model, every = plate_model(recordings, lags), range(len(recordings))
    if len(recordings) == 1:
        return model
    others, names = [[i for i in every if i != one] for one in every], model.inertia.identified
    leave_one_out = [plate_model([recordings[i] for i in kept], [lags[i] for i in kept], names) for kept in others]
    return replace(model, leave_one_out=tuple(leave_one_out))


def plate_model(
    recordings: Sequence[UnloadedRecording], lags: Sequence[float], names: tuple[str, ...] | None = None
) -> PlateModel:
    """The mean of the recordings' lags [s], and one inertia from all recordings at that lag.

    A lag is NaN if its recording shows none. `names` are the inertial parameters to identify, if they are already
    known.
    """
    known = np.array([lag for lag in lags if np.isfinite(lag)])
    lag = float(np.mean(known)) if len(known) else 0.0
    inertia = identify_plate_inertia([(r.motion, r.wrench_at(lag)) for r in recordings], recordings[0].smooth, names)
    error = float(np.std(known, ddof=1) / np.sqrt(len(known))) if len(known) > 1 else None
    return PlateModel(inertia, lag, error, known)


def without_hidden_turns(recordings: Sequence[UnloadedRecording]) -> list[UnloadedRecording]:
    """The recordings whose platform was seen while it turned. A warning names each of the others.

    Raises
    ------
    InputError
        There is no such recording.
    """
    hidden = [r for r in recordings if r.hidden]
    if len(hidden) == len(recordings):
        raise InputError(
            f"the platform's markers were hidden while it turned, in every unloaded trial ({hidden[0].name}, ...); "
            "fill the gaps in Nexus, record one again, or raise longest_fitted_gap_s"
        )
    for r in hidden:
        warnings.warn(
            f"trial {r.name}: excluded from the plate's model: the platform turned while its markers were hidden; fill "
            "the gap in Nexus, or record it again",
            stacklevel=2,
        )
    return [r for r in recordings if not r.hidden]


def unloaded_recording(trial: Trial, calibration: StaticCalibration, settings: PlateModelSettings) -> UnloadedRecording:
    """The plate's motion over the longest run of frames in which the platform was seen, and its wrench."""
    names = settings.markers.platform
    time, poses = segment_poses(trial, names, calibration.platform, settings)
    recorded = recorded_wrench(trial, settings.plate)
    check_unloaded(trial.name, recorded, settings.largest_zero_n)
    rows = longest_run(poses.seen())
    if rows.stop - rows.start < FEWEST_FRAMES:
        raise InputError(
            f"trial {trial.name}: markers {', '.join(names)} are seen together in {rows.stop - rows.start} frames in a "
            f"row, expected {FEWEST_FRAMES} or more; fill the gaps in Nexus, or record the trial again"
        )
    reference = reference_positions(calibration.platform, names, trial.name)
    filtered = filtered_poses(poses[rows], reference, settings.low_pass, sampling_rate(time))
    motion = body_motion(time[rows], filtered, plate_centre(trial, settings.plate))
    hidden = turned_while_hidden(trial.name, time, poses, settings)
    filters = settings.low_pass, settings.plate_low_pass
    return UnloadedRecording(trial.name, time, rows, motion, recorded, *filters, hidden)


def check_unloaded(name: str, recorded: RecordedWrench, largest: float) -> None:
    """Refuse a plate whose vertical force is more than `largest` [N] in most of the recording."""
    load = float(np.median(np.abs(recorded.wrench.force[:, 2])))
    if load > largest:
        raise InputError(
            f"trial {name}: the plate carries {load:.0f} N, expected an unloaded plate and at most {largest:g} N; zero "
            "the plate and record again, or correct the experiment of this trial in the sheet, which is 'plate'"
        )


def turned_while_hidden(name: str, time: Array, poses: Poses, settings: PlateModelSettings) -> bool:
    """Whether the platform turned while its markers were hidden.

    Raises
    ------
    InputError
        The markers were always seen, and the platform did not turn.
    """
    turned = float(np.rad2deg(np.max(rotation_from_rest(poses[longest_run(poses.seen())]))))
    if turned >= settings.perturbation_deg:
        return bool(hidden_turn(time, poses, settings.longest_fitted_gap_s) > HIDDEN_TURN)
    if poses.seen().all():
        raise InputError(
            f"trial {name}: the platform turns by {turned:.2f} deg only, expected {settings.perturbation_deg:g} deg or "
            "more; record a perturbation of the unloaded plate"
        )
    return True


def hidden_turn(time: Array, poses: Poses, longest: float) -> float:
    """The largest rotation [rad] of the platform while its markers were hidden for more than `longest` [s].

    An interpolated turn is not measured. 11 interpolated frames at 300 Hz change the lag of that trial by 2 ms.
    """
    rotation = rotation_from_rest(poses)
    gaps = [gap for gap in runs(poses.bridged) if gap_duration(time, gap) > longest]
    return max((abs(float(rotation[gap.stop] - rotation[gap.start - 1])) for gap in gaps), default=0.0)


def trial_lag(recording: UnloadedRecording) -> float:
    """Lag [s] of the plate in one trial; NaN if the plate is too light to show it."""
    try:
        return plate_lag(recording.motion, recording.wrench_at, recording.smooth)
    except InputError as error:
        raise InputError(f"trial {recording.name}: {error}") from error


def plate_table(model: PlateModel) -> pl.DataFrame:
    """`plate.csv`: RMS [N, N*m] of each component before and after the plate's own wrench is removed, and the lag
    [s]."""
    before, after = model.inertia.rms_before, model.inertia.rms_after
    remaining = [100 * a / b if b > 0 else None for b, a in zip(before.tolist(), after.tolist(), strict=True)]
    rows = {"component": COMPONENTS, "rms_before": before, "rms_after": after, "left_percent": remaining}
    lag = {"lag_s": model.lag, "lag_se_s": model.lag_se, "trials": len(model.lags)}
    return pl.DataFrame(rows).with_columns(**{name: pl.lit(value) for name, value in lag.items()})
