"""A trial of the unloaded, moving platform: its motion, the plate's wrench, and whether the motion was seen."""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from osl_analysis.errors import InputError
from osl_analysis.signals import LowPass, longest_run, runs, sampling_rate
from osl_analysis.trial import Array, Trial
from osl_analysis.walking.ankle import StaticCalibration
from osl_analysis.walking.cluster import BodyMotion, Poses, gap_duration, reference_positions, segment_poses
from osl_analysis.walking.labels import exchanged_labels
from osl_analysis.walking.plate import (
    PlateWrench,
    RecordedWrench,
    WrenchAtFrames,
    plate_centre,
    recorded_wrench,
    rotation_from_rest,
)
from osl_analysis.walking.plate_inertia import noise_squares
from osl_analysis.walking.platform_motion import PlatformTrack
from osl_analysis.walking.platform_rank import gate, gated_noise
from osl_analysis.walking.settings import PlateModelSettings

FEWEST_FRAMES = 10
HIDDEN_TURN = np.deg2rad(0.2)
"""Smallest rotation [rad] during hidden markers that counts as a turn. At rest, noise gives 0.03 deg."""

HIDDEN = "the platform turned while its markers were hidden; fill the gap in Nexus, or record it again"
CUT = "the recording begins or ends while the platform moves; record from rest to rest"
EDGE_S = 0.05
"""Time [s] at each end of a recording in which a platform that moves is seen."""
STILL = 7.0
"""A platform moves at an end if its speed there is above this multiple of its standard error."""


@dataclass(frozen=True)
class UnloadedRecording:
    """A trial of an unloaded, moving plate.

    name: the trial.
    time: the marker frames (n,) [s].
    rows: the longest run of frames in which the platform was seen, without a motion that the recording cuts.
    track: the platform's coordinates in these rows.
    motion: motion of the plate's centre in these rows, through the low-pass of the crossings.
    centre: the plate's centre (3,) [m] at rest.
    recorded: the plate's wrench as sampled.
    low_pass: the filter of the crossings.
    plate_low_pass: the further filter of the identification.
    unusable: why the trial shows nothing of the plate, for a message; empty if it does.
    noise: weighted squares (10, 10) of the marker noise in the columns of the regression.
    """

    name: str
    time: Array
    rows: slice
    track: PlatformTrack
    motion: BodyMotion
    centre: Array
    recorded: RecordedWrench
    low_pass: LowPass
    plate_low_pass: LowPass
    unusable: str
    noise: Array

    def along(self, axes: Array) -> "UnloadedRecording":
        """The same with the motion along the directions (r, 6), and with the noise in the columns of its regression."""
        motion, weights = self.track.own_motion(axes, self.centre)
        resting = [run for run in runs(weights == 0) if run.stop - run.start >= FEWEST_FRAMES]
        passed = gated_noise(weights, self.track.rate, self.low_pass, self.plate_low_pass)
        noise = noise_squares(motion, resting) * passed
        return replace(self, motion=motion.weighted(weights), noise=noise)

    def smooth(self, values: Array) -> Array:
        """Values in `rows`, shape (n, ...), through the low-pass of the identification."""
        return self.plate_low_pass(values, sampling_rate(self.time))

    @cached_property
    def at_frames(self) -> WrenchAtFrames:
        """The wrench at the marker frames, with any lag."""
        return self.recorded.at_frames(self.time)

    def wrench_at(self, lag: float) -> PlateWrench:
        """The wrench in `rows`, read a lag [s] later, through both low-passes."""
        rate = sampling_rate(self.time)
        once = self.at_frames.late_by(lag).filtered(self.low_pass, rate)
        return once[self.rows].filtered(self.plate_low_pass, rate)


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
            + (f"; {hint}" if (hint := exchanged_labels(trial, calibration, settings, ("platform",))) else "")
        )
    reference = reference_positions(calibration.platform, names, trial.name)
    track = PlatformTrack.of(trial.name, time[rows], poses[rows], reference, settings.low_pass)
    whole = whole_motions(track)
    cut, rests = whole.stop - whole.start < rows.stop - rows.start, whole.stop - whole.start >= FEWEST_FRAMES
    if cut and rests:
        rows = slice(rows.start + whole.start, rows.start + whole.stop)
        track = PlatformTrack.of(trial.name, time[rows], poses[rows], reference, settings.low_pass)
    centre = plate_centre(trial, settings.plate)
    motion, weights = track.own_motion(np.eye(6), centre)
    motion = motion.weighted(weights)
    turned = np.deg2rad(settings.perturbation_deg)
    if cut and (not rests or np.ptp(rotation_from_rest(poses[rows])) < turned):
        unusable = CUT
    else:
        unusable = HIDDEN if turned_while_hidden(trial.name, time, poses, settings) else ""
    filters = settings.low_pass, settings.plate_low_pass
    return UnloadedRecording(
        trial.name, time, rows, track, motion, centre, recorded, *filters, unusable, np.zeros((10, 10))
    )


def whole_motions(track: PlatformTrack) -> slice:
    """The frames (n,) of a track without a motion that begins before or ends after it; empty if it never rests.

    Half a motion has accelerations that the low-pass gets wrong at the end of the recording: the lag is then off by
    milliseconds, and the plate's mass by a tenth.
    """
    count, n = max(round(EDGE_S * track.rate), 5), len(track.time)
    moves = track.moving.copy()
    ends = slice(0, count), slice(n - count, n)
    for end in ends:
        moves[end] |= end_speed(track.time[end], track.measured[end]) > STILL * track.noise
    still = runs(gate(track.time, moves, track.spread) == 0)
    rests = [run for run in still if run.stop - run.start >= FEWEST_FRAMES] or [slice(0, 0)]
    return slice(rests[0].start if moves[0] else 0, rests[-1].stop if moves[-1] else n)


def end_speed(time: Array, coordinates: Array) -> float:
    """Largest slope of coordinates (n, 6) at times (n,) [s], in units of its standard error for noise of 1."""
    since = time - time.mean()
    slopes = since @ coordinates / (since @ since)
    return float(np.abs(slopes).max() * np.sqrt(since @ since))


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
