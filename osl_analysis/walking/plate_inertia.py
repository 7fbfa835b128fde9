# SPDX-License-Identifier: Apache-2.0
"""Step 3, plate inertia: the plate's own inertia and lag, from its trials without a load.

The platform turns under the foot and carries a force plate of 10 to 40 kg. Its sensors also read
the plate's own wrench, which is linear in its inertial parameters. In the plate's axes and about
its centre, after the zero has removed the weight,

    F = m a' + z x mc + w x (w x mc),    M = mc x a' + I z + w x I w,    a' = R^T (a - g) + g,

where m is the mass, mc mass times centre of mass, I the inertia about the plate's centre, a the
acceleration of that centre, w the angular velocity and z the angular acceleration. A height h of
the corners above the point of the moments adds h z x F to the moments.

A torque that is late by d lowers the damping by K d, and the VAF of a walking fit does not show it.
The unloaded plate does: its inertial force and its acceleration peak at the same time.

How it is estimated; errors are those of the ankle's torque or of the plate, for plates of 25 kg,
0.3 mm marker noise and turns of 2.5 deg in 100 ms:

* Only directions of motion that exceed noise count (`platform.moving_directions`). With all six
  degrees of freedom the torque is off by 1.7 N*m RMS, along one axis by 0.2.
* Only directions of the parameters that the motion shows are identified. The wrench is then right
  for motions like those here; single parameters are the least that fit.
* Columns and wrench pass a second low-pass at 8 Hz: at 20 Hz a mass of 12 kg is read as 10.8.
* The squares of the columns' noise are taken off (Fuller, Measurement Error Models, 1987).
* The lag is found in each turn, to first order in four steps. Its standard error is that of noise
  at rest, met at all times of the turn. Errors over standard errors have an SD of 0.8 to 0.9.
* Errors of the parameters are by leaving out each trial (jackknife), along the same directions.
* Half motions at the ends of a recording are cut: with them the lag is off by milliseconds.

A plate without mass has no directions. `plate_inertia: none` is then stated, and refused where the
force follows the acceleration with more than 1 kg (`plate_lag.check_no_mass`). What was tried and
dropped stands in docs/decisions.md.

Example: `identify_plate_model([(trial, calibration)], settings).lag` [s].
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import scipy

from osl_analysis.base.errors import IdentifiabilityError, InputError, advise, naming
from osl_analysis.base.trial import Array, Trial
from osl_analysis.signals.filters import LowPass, longest_run, runs, sampling_rate
from osl_analysis.walking import platform
from osl_analysis.walking import poses as rigid
from osl_analysis.walking.plate import (
    WrenchReader,
    between,
    check_place,
    check_type_on_platform,
    recorded_corners,
    recorded_wrench,
    wrench_reader,
)
from osl_analysis.walking.poses import (
    FREE_FALL,
    BodyMotion,
    Mask,
    Poses,
    StaticCalibration,
    StoredArray,
    cross_matrix,
)
from osl_analysis.walking.walking_settings import PlateModelSettings, PlatformSettings

# Weights of forces [m] and moments: a force's lever about the ankle is about 0.1 m
WEIGHT = np.repeat([0.1, 1.0], 3)


# When inertia, lag and height of a plate are known.
LIGHT = 0.1  # [N*m], weighted wrench of a plate that is too light to show its lag
SMALLEST_WRENCH = 0.01  # of a direction, as a share of the largest, for it to be identified
LARGEST_NOISE_SHARE = 0.5  # of a direction's power, or of a wrench's that follows a motion
LARGEST_LAG_S = 0.012
LAG_ROUNDING = 1e-6  # of a lag: rounding
LAG_ROUNDS = 4  # of lag and inertia in turn, and of a lag to first order
LARGEST_HEIGHT_SE_M = 0.005  # of a height that is reported
CERTAIN_SES = 4.0  # standard errors beyond which a height is certain
# of an unloaded plate, also of one that was not zeroed: a standing person weighs five times as much
LARGEST_UNLOADED_N = 100.0
SPREAD_S = 0.1  # by which the low-pass of the identification spreads a motion
# at rest noise gives 0.03 deg; 11 frames of a turn at 300 Hz change the lag by 2 ms
OCCLUDED_TURN_DEG = 0.2
LEAP = 0.01  # of the largest force, from 0 to the smallest: a motion begins with less


# Scales of the parameters for a plate of 1 kg whose half is 0.3 m long
TYPICAL_PLATE = np.repeat([1.0, 0.3, 0.09], [1, 3, 6])[:, None]


@dataclass(frozen=True)
class TurnLag:
    """The plate's lag behind the markers in one turn of the platform with nobody on it."""

    trial: str
    time: float  # of the turn [s]
    lag: float  # [s]
    se: float  # its standard error [s], by the noise of markers and plate


@dataclass(frozen=True)
class PlateModel:
    """The plate's inertial parameters, and its lag behind the markers."""

    # (10,): m, mc (x, y, z), I (xx, yy, zz, xy, xz, yz) [kg, kg*m, kg*m^2]; the least that fit
    parameters: StoredArray
    directions: StoredArray  # (10, r) of the parameters that the motion shows
    turns: tuple[TurnLag, ...] = ()  # those that show a lag
    # The model without each trial, for the jackknife; empty with one
    leave_one_out: "tuple[PlateModel, ...]" = ()
    # [m] of the corners' centre above the point of the moments; None where it is not seen
    height: float | None = None
    height_se: float | None = None  # its standard error [m]

    @property
    def certain_height(self) -> float | None:
        """`height` [m] if it is certain, else 0; None where it is not known."""
        if self.height is None:
            return None
        is_certain = abs(self.height) > CERTAIN_SES * (self.height_se or 0.0)
        return self.height if is_certain else 0.0

    @property
    def mass(self) -> float | None:
        """[kg]; None where the motion does not show it."""
        return float(self.parameters[0]) if self.directions[0].any() else None

    @property
    def lag(self) -> float | None:
        """The mean of the lags [s]; None where it is unknown, and then not corrected."""
        return mean_lag(self.turns)


def mean_lag(turns: Sequence[TurnLag]) -> float | None:
    """The lag [s] that fits all turns best; None without one."""
    if not turns:
        return None
    return float(np.average([t.lag for t in turns], weights=[t.se**-2 for t in turns]))


NOT_REMOVED = "walking.plate_inertia is none"
NO_CORRECTION = PlateModel(
    parameters=0 * TYPICAL_PLATE[:, 0],
    directions=TYPICAL_PLATE[:, :0],
)
"""Of a plate that is light or compensates its own inertia: nothing is removed from its wrench."""


def identify_plate_model(
    pairs: Sequence[tuple[Trial, StaticCalibration]], settings: PlateModelSettings
) -> PlateModel:
    """Identify the lag of each unloaded trial, then one inertia from all at the mean lag.

    A trial that cannot be used is excluded, with a warning.

    Raises
    ------
    InputError
        No trial shows the plate's inertia, or its wrench does not follow its motion.
    """
    if not pairs:
        raise InputError(
            "no trials of the unloaded plate", "add trials of experiment 'plate' to the sheet"
        )
    usable = []
    problems = []
    for trial, calibration in pairs:
        try:
            with naming(f"trial {trial.name}", trial=trial.name):
                usable.append(unloaded_recording(trial, calibration, settings))
        except InputError as error:
            problems.append(error)
    if not usable:
        raise problems[0]
    for problem in problems:
        advise(f"excluded from the plate's model: {problem}")

    directions = platform.shared_directions([recording.track for recording in usable])
    motions = [recording.along(axes) for recording, axes in zip(usable, directions, strict=True)]
    model = plate_model(motions)
    for _ in range(LAG_ROUNDS):
        noise = np.concatenate([resting_noise(motion, model) for motion in motions])
        turns = [turn for motion in motions for turn in unloaded_turns(motion, model, noise)]
        model = plate_model(motions, turns)
    single_turns = []
    for motion in motions:
        single_turns += motion.shown(model.lag or 0.0).parts(motion.moves)
    model = with_height(model, single_turns)
    if len(motions) == 1:
        return model
    without_each = []
    for left_out in motions:
        remaining = [motion for motion in motions if motion is not left_out]
        turns = [turn for turn in model.turns if turn.trial != left_out.name]
        without_each.append(plate_model(remaining, turns, model))
    return replace(model, leave_one_out=tuple(without_each))


@dataclass(frozen=True)
class Shown:
    """Equations of n frames of an unloaded plate, low-passed: columns times parameters = wrench."""

    columns: Array  # (n, 6, 10)
    noise: Array  # columns of marker noise alone; their squares are those of the noise in `columns`
    wrench: Array  # (n, 6)

    def parts(self, moves: Mask) -> "list[Shown]":
        """One part for each motion, by its frames `moves` (n,). The parts share the noise."""
        starts = [run.start for run in runs(moves)][1:]
        columns = np.split(self.columns, starts)
        wrenches = np.split(self.wrench, starts)
        share = 1 / np.sqrt(len(columns))
        return [
            Shown(columns_of, share * self.noise, wrench)
            for columns_of, wrench in zip(columns, wrenches, strict=True)
        ]


def shown_together(recordings: Sequence[Shown]) -> Shown:
    """The equations of several recordings, each with a zero of its own."""
    return Shown(
        columns=np.concatenate([without_mean(shown.columns) for shown in recordings]),
        noise=np.concatenate([shown.noise for shown in recordings]),
        wrench=np.concatenate([without_mean(shown.wrench) for shown in recordings]),
    )


@dataclass(frozen=True)
class UnloadedMotion:
    """The motion of the unloaded plate in n frames along some directions, low-passed."""

    name: str
    time: Array  # (n,) [s]
    columns: Array  # (n, 6, 10), without accelerations at rest
    noisy_columns: Array  # (n, 6, 10), with the noise of markers at rest
    moves: Mask  # frames (n,) into which a low-pass spreads a motion
    rests: list[slice]  # runs of frames at rest, without the recording's ends
    wrench_at: WrenchReader  # through both low-passes

    def at_rest(self, values: Array) -> Array:
        """Values (n, ...) in its rests, minus their mean in each."""
        return np.concatenate([values[:0], *[without_mean(values[rest]) for rest in self.rests]])

    def shown(self, lag: float) -> Shown:
        """The equations, for a plate that lags by `lag` [s]."""
        noise = self.at_rest(self.noisy_columns)
        scale = np.sqrt(self.moves.sum() / max(len(noise), 1))
        return Shown(self.columns, scale * noise, self.wrench_at(lag))


@dataclass(frozen=True)
class UnloadedRecording:
    """A trial of an unloaded, moving plate."""

    # The longest run of frames in which it was seen, without a motion that the run cuts
    track: platform.PlatformTrack
    centre: Array  # the plate's centre (3,) [m] at rest
    read: WrenchReader  # in the track's frames
    # The further low-pass of the identification, after that of the crossings
    plate_low_pass: LowPass

    def smooth(self, values: Array) -> Array:
        """Pass values (n, ...) in the track's frames through the low-pass of the identification."""
        return self.plate_low_pass(values, self.track.rate)

    def along(self, axes: Array) -> UnloadedMotion:
        """Motion of the plate's centre along directions (r, 6).

        Outside motions the accelerations are 0. Both versions are low-passed before one is chosen:
        choosing first would turn high frequencies of noise into low ones.
        """
        track = self.track
        motion, weights = track.measured_motion(axes, self.centre)
        noisy_columns = self.smooth(inertial_columns(motion))
        still_columns = self.smooth(inertial_columns(motion.weighted(weights)))
        spread = round(SPREAD_S * track.rate)
        moves = scipy.ndimage.binary_dilation(weights > 0, iterations=spread)
        at_rest = ~moves
        # at the ends a low-pass passes more noise
        at_rest[:spread] = False
        at_rest[-spread:] = False
        return UnloadedMotion(
            track.name,
            track.time,
            columns=np.where(moves[:, None, None], noisy_columns, still_columns),
            noisy_columns=noisy_columns,
            moves=moves,
            rests=[run for run in runs(at_rest) if run.stop - run.start > spread],
            wrench_at=lambda lag: self.smooth(track.low_pass(self.read(lag), track.rate)),
        )


def unloaded_recording(
    trial: Trial, calibration: StaticCalibration, settings: PlateModelSettings
) -> UnloadedRecording:
    """Read the platform over the longest run of frames in which it was seen, and the wrench."""
    check_type_on_platform(trial, settings.plate)
    check_place(recorded_corners(trial, settings.plate), settings.plate, calibration.corners)
    names = settings.markers.platform
    frames, poses = rigid.segment_poses(trial, names, calibration, settings)
    _, wrench = recorded_wrench(trial, settings.plate)
    force = np.abs(wrench[:, 2])
    load = np.median(force)
    if load > LARGEST_UNLOADED_N:
        raise InputError(
            f"the plate carries {load:.0f} N, expected an unloaded plate and at most"
            f" {LARGEST_UNLOADED_N:g} N",
            "zero the plate and record again, or correct the experiment of this trial in the"
            " sheet, which is 'plate'",
        )
    usable = poses.seen()
    turn = platform.rotation_from_rest(poses)
    for gap in runs(poses.bridged):
        is_long = rigid.gap_duration(frames, gap) > settings.longest_fitted_gap_s
        if is_long and abs(turn[gap.stop] - turn[gap.start - 1]) > np.deg2rad(OCCLUDED_TURN_DEG):
            usable[gap] = False
    recording = whole_recording(trial, calibration, frames, poses, usable, settings)
    shown = 0.0  # largest turn from rest to rest [rad]
    if recording is not None:
        whole = poses[between(frames, recording.track.time[[0, -1]])]
        shown = np.ptp(platform.rotation_from_rest(whole))
    if recording is None or shown < settings.smallest_turn:
        raise InputError(
            f"the platform turns by {np.rad2deg(shown):.2f} deg from rest to rest while its"
            f" markers {', '.join(names)} are seen, expected {settings.perturbation_deg:g} deg or"
            " more",
            "correct labels in Nexus or the trial in the column static, or record a turn from"
            " rest to rest with markers in sight",
        )
    smallest = np.min(force, initial=force.max(), where=force > 0)
    if (force == 0).any() and smallest > LEAP * force.max():
        raise InputError(
            f"the plate reads 0, and no force between 0 and {smallest:.2g} N: what lies below was"
            " set to 0",
            "export the trials of the unloaded plate without a threshold",
        )
    return recording


def whole_recording(
    trial: Trial,
    calibration: StaticCalibration,
    frames: Array,
    poses: Poses,
    usable: Mask,
    settings: PlatformSettings,
) -> UnloadedRecording | None:
    """The longest run of usable frames (n,) and its wrench; None if it is too short.

    A motion that the run cuts is left out. The wrench is cut before any filter.
    """
    rows = longest_run(usable)
    for _ in range(2):  # first the whole run, then the run without half motions
        if rows.stop - rows.start < 4 * SPREAD_S * sampling_rate(frames):
            return None
        track = platform.platform_track(
            trial.name, frames[rows], poses[rows], calibration, settings
        )
        whole = whole_motions(track)
        rows = slice(rows.start + whole.start, rows.start + whole.stop)
    time, wrench = recorded_wrench(trial, settings.plate)
    inside = between(time, track.time[[0, -1]])
    return UnloadedRecording(
        track,
        centre=recorded_corners(trial, settings.plate).mean(axis=0),
        read=wrench_reader(time[inside], wrench[inside], track.time),
        plate_low_pass=settings.plate_low_pass,
    )


def whole_motions(track: platform.PlatformTrack) -> slice:
    """The frames without a motion that begins before or ends after the track.

    They are none if it never rests. Half a motion is wrong after a low-pass: the lag is then off by
    milliseconds, the plate's mass by a tenth.
    """
    n = len(track.time)
    count = round(SPREAD_S * track.rate / 2)  # frames at an end whose slope shows a cut motion
    moves = track.moving.copy()
    for end in (slice(0, count), slice(n - count, n)):
        since = track.time[end] - track.time[end].mean()
        moved = np.abs(since @ track.measured[end]).max() / np.linalg.norm(since)
        moves[end] |= moved > platform.STILL * track.noise
    rests = [
        run
        for run in runs(track.gate(moves) == 0)
        if run.stop - run.start >= platform.FEWEST_FRAMES
    ] or [slice(0, 0)]
    return slice(rests[0].start if moves[0] else 0, rests[-1].stop if moves[-1] else n)


def plate_model(
    motions: Sequence[UnloadedMotion],
    turns: Sequence[TurnLag] = (),
    whole: PlateModel | None = None,
) -> PlateModel:
    """One inertia from all recordings at the mean of the lags of their turns.

    With `whole`, a model of more recordings, only its directions are identified; other directions
    stay as in `whole`.
    """
    lag = mean_lag(turns) or 0.0
    model = identify_plate_inertia([motion.shown(lag) for motion in motions], whole)
    return replace(model, turns=tuple(turns))


def inertial_columns(motion: BodyMotion) -> Array:
    """Columns of the plate's own wrench, one per inertial parameter.

    Returns
    -------
    Array
        (n, 6, 10), whose product with the parameters is the wrench about the plate's centre, the
        point of `motion`, in the plate's axes.
    """
    R_transposed = motion.rotation.transpose(0, 2, 1)
    a = np.einsum("nij,nj->ni", R_transposed, motion.acceleration - FREE_FALL) + FREE_FALL
    w = np.einsum("nij,nj->ni", R_transposed, motion.omega)
    z = np.einsum("nij,nj->ni", R_transposed, motion.alpha)
    W = cross_matrix(w)

    columns = np.zeros((len(a), len(WEIGHT), len(TYPICAL_PLATE)))
    columns[:, :3, 0] = a  # F by m
    columns[:, :3, 1:4] = cross_matrix(z) + W @ W  # F by mc
    columns[:, 3:, 1:4] = -cross_matrix(a)  # M by mc
    columns[:, 3:, 4:] = inertia_columns(z) + W @ inertia_columns(w)  # M by I
    return columns


def inertia_columns(v: Array) -> Array:
    """Matrices (n, 3, 6) that map (I_xx, I_yy, I_zz, I_xy, I_xz, I_yz) to I v, for v (n, 3)."""
    x, y, z = v.T
    zero = np.zeros(len(v))
    rows = [
        [x, zero, zero, y, z, zero],
        [zero, y, zero, x, zero, z],
        [zero, zero, z, zero, x, y],
    ]
    return np.moveaxis(np.array(rows), 2, 0)


def identify_plate_inertia(
    recordings: Sequence[Shown], whole: PlateModel | None = None
) -> PlateModel:
    """Identify the inertial parameters by least squares, corrected for marker noise.

    Only directions that the motion shows are identified. So a plate may turn about any axis: its
    wrench is known for motions in crossings like those here, even if single parameters are not.
    With G and N the Gram matrices of the columns and of their noise, estimates are corrected by
    (G - N)^-1 G.

    Parameters
    ----------
    recordings : sequence of Shown
        Each wrench has its own zero. The columns have passed the low-pass of the wrench: with
        filtered motions instead, 8 Hz would make the lag 0.05 ms too small.
    whole : PlateModel, optional
        To whose directions the identified ones are confined, and whose parameters stay where
        nothing is identified; all directions and 0 by default.

    Raises
    ------
    IdentifiabilityError
        Marker noise exceeds the motion in every direction.

    References
    ----------
    Fuller, Measurement Error Models, 1987, section 1.4.
    """
    together = shown_together(recordings)
    wrench = together.wrench
    start = NO_CORRECTION.parameters if whole is None else whole.parameters

    X = stacked_columns(together.columns)
    G = X.T @ X
    noise = stacked_columns(together.noise)
    N = noise.T @ noise
    basis = excited_directions(G, N) if whole is None else whole.directions
    unexplained = (wrench * WEIGHT).T.ravel() - X @ start
    right = X.T @ unexplained + N @ start
    # what the recordings do not show stays as it is
    inverse = np.linalg.pinv(basis.T @ (G - N) @ basis, SMALLEST_WRENCH**2, hermitian=True)
    change = inverse @ basis.T @ right
    parameters = start + basis @ change
    return PlateModel(
        parameters,
        directions=basis,
    )


def excited_directions(squares: Array, noise: Array) -> Array:
    """Find the directions of the parameters whose wrench the motion shows.

    Parameters
    ----------
    squares, noise : Array
        Gram matrices (10, 10) of the columns, and of the marker noise in them.

    Returns
    -------
    Array
        (10, r), in units of a typical plate: eigenvectors above a share of the largest, with at
        most half of noise.
    """
    basis = np.diag(TYPICAL_PLATE[:, 0])
    power, vectors = np.linalg.eigh(basis.T @ squares @ basis)
    basis = basis @ vectors[:, power > SMALLEST_WRENCH**2 * power[-1]]

    share, vectors = scipy.linalg.eigh(basis.T @ noise @ basis, basis.T @ squares @ basis)
    if share[0] > LARGEST_NOISE_SHARE:
        raise IdentifiabilityError(
            f"marker noise is {share[0]:.0%} of what moves the unloaded plate in the direction"
            " that shows it best, expected 50% or less",
            "record larger or faster motions of the unloaded plate",
        )
    return basis @ vectors[:, share <= LARGEST_NOISE_SHARE]


def stacked_columns(columns: Array) -> Array:
    """Weighted columns (6 n, p) out of (n, 6, p), component by component."""
    return (columns * WEIGHT[:, None]).transpose(1, 0, 2).reshape(-1, columns.shape[2])


def without_mean(values: Array) -> Array:
    return values - values.mean(axis=0)


def unloaded_turns(motion: UnloadedMotion, model: PlateModel, noise: Array) -> list[TurnLag]:
    """The lag in each turn of a recording of the unloaded plate; none if the plate is too light.

    Raises
    ------
    InputError
        The wrench does not follow the motion.
    """
    turns = turn_lags(motion, model, noise)
    lag = mean_lag(turns or []) or 0.0
    if turns is None or abs(lag) > LARGEST_LAG_S:
        late = f", but comes {1e3 * lag:.0f} ms later" if turns else ""
        raise InputError(
            f"trial {motion.name}: the unloaded plate's wrench does not follow its motion within"
            f" {LARGEST_LAG_S * 1e3:g} ms{late}",
            "export markers that were smoothed without a filter; else name the plate that moves"
            " under `walking.plate`, synchronise the recorders, or check channels and low-passes of"
            " the amplifier",
            trial=motion.name,
        )
    return turns


def resting_noise(motion: UnloadedMotion, model: PlateModel) -> Array:
    """Weighted noise (k, 6) of the wrench minus the plate's own, at rest.

    A short rest hides the part of it that is slow: errors of lags were 1.1, 1.3 to 1.7 and 1.6 to 2
    times the standard error by rests of 0.5, 0.2 and 0.1 s, and are 0.8 to 0.9 times it with this
    factor and the rests of all recordings together (campaigns of benchmarks/planted_gait.py, cut).
    """
    plate_wrench = motion.noisy_columns @ model.parameters
    noise = motion.wrench_at(model.lag or 0.0) - plate_wrench
    spread = SPREAD_S * sampling_rate(motion.time)
    parts = [noise[:0]]
    for rest in motion.rests:
        hidden_share = spread / (rest.stop - rest.start)
        parts.append((1 + hidden_share) * without_mean(noise[rest]))
    return np.concatenate(parts) * WEIGHT


def turn_lags(motion: UnloadedMotion, model: PlateModel, noise: Array) -> list[TurnLag] | None:
    """Find the lag in each turn, to first order about that of the model, in `LAG_ROUNDS` steps.

    Noise (k, 6) that is met by chance at any time of a turn gives the standard error: of any colour
    and shared by the components.

    Returns
    -------
    list of TurnLag or None
        Without turns that hardly change the wrench, and those that it does not follow: noise of
        occluded markers may look like a motion. None if it does not follow all of them together.
    """
    rate = sampling_rate(motion.time)
    turns = []
    unexplained = 0.0  # squares of all turns
    recorded = 0.0
    for rows in runs(motion.moves):
        expected = without_mean(motion.columns[rows] @ model.parameters) * WEIGHT
        if np.sum(expected**2) < len(expected) * LIGHT**2:
            continue
        by_lag = without_mean(-np.gradient(expected, 1 / rate, axis=0))
        square = np.sum(by_lag**2)
        lag = model.lag or 0.0
        for _ in range(LAG_ROUNDS):
            wrench = without_mean(motion.wrench_at(lag)[rows]) * WEIGHT
            lag += np.sum(by_lag * (wrench - expected)) / square
        residual = np.sum((wrench - expected) ** 2)
        square_of_wrench = np.sum(wrench**2)
        unexplained += residual
        recorded += square_of_wrench
        if residual > LARGEST_NOISE_SHARE * square_of_wrench:
            continue

        # over all times at which the turn may meet the noise; without rests, its own residual
        possible_noise = noise if len(noise) else wrench - expected
        met = scipy.signal.oaconvolve(possible_noise, by_lag[::-1], axes=0).sum(axis=1)
        turns.append(
            TurnLag(
                motion.name,
                time=float(motion.time[rows] @ np.sum(by_lag**2, axis=1) / square),
                lag=float(lag),
                se=max(float(np.sqrt(met @ met / len(possible_noise)) / square), LAG_ROUNDING),
            )
        )
    return None if unexplained > LARGEST_NOISE_SHARE * recorded else turns


def with_height(model: PlateModel, recordings: Sequence[Shown]) -> PlateModel:
    """Add the height of the corners' centre above the point of the moments, where it is seen.

    Its standard error is from leaving out each turn (jackknife).
    """
    count = len(recordings)
    if count < 2:
        return model
    height = height_of(model.directions, recordings)
    without_each = [
        height_of(model.directions, [*recordings[:i], *recordings[i + 1 :]]) for i in range(count)
    ]
    se = float(np.sqrt((count - 1) * np.var(without_each)))
    return replace(model, height=height, height_se=se) if se < LARGEST_HEIGHT_SE_M else model


def height_of(directions: Array, recordings: Sequence[Shown]) -> float:
    """Height h [m] of the corners' centre above the point of the moments.

    A force F then adds h z x F to the moments, beside what the plate's own parameters make, along
    `directions` (10, r). Estimates are corrected for marker noise, as in `identify_plate_inertia`.
    """
    together = shown_together(recordings)
    moment = np.cross(np.array([0.0, 0.0, 1.0]), together.wrench[:, :3])
    lever = np.hstack([np.zeros_like(moment), moment])[:, :, None]
    X = np.column_stack([stacked_columns(together.columns) @ directions, stacked_columns(lever)])
    marker_noise = stacked_columns(together.noise) @ directions
    squares = X.T @ X
    squares[:-1, :-1] -= marker_noise.T @ marker_noise
    right = X.T @ (together.wrench * WEIGHT).T.ravel()
    return (np.linalg.pinv(squares, hermitian=True) @ right)[-1]
