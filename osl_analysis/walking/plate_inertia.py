"""Step 3, plate inertia: the plate's own inertia and lag, from its trials without a load.

The plate's own inertia causes a wrench in its sensors, which is linear in its inertial parameters.
After the zero has removed the weight, in the plate's axes and about its centre,

    F = m a' + z x mc + w x (w x mc),    M = mc x a' + I z + w x I w,    a' = R^T (a - g) + g,

where m is the mass, mc mass times centre of mass, I the inertia about the plate's centre, a the
acceleration of that centre, w the angular velocity and z the angular acceleration.

A lag d of the torque behind the angle changes the damping by -K d. Walking data do not show it,
because the VAF does not change. The unloaded plate shows it: its inertial force and its
acceleration must peak at the same time.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
import polars as pl
import scipy

from osl_analysis.errors import IdentifiabilityError, InputError, advise, naming
from osl_analysis.signals import LowPass, longest_run, runs, sampling_rate
from osl_analysis.trial import Array, Trial
from osl_analysis.walking import platform
from osl_analysis.walking import poses as rigid
from osl_analysis.walking.plate import (
    WrenchReader,
    check_type_on_platform,
    recorded_corners,
    recorded_wrench,
    wrench_reader,
)
from osl_analysis.walking.poses import (
    FREE_FALL,
    BodyMotion,
    Poses,
    StaticCalibration,
    StoredArray,
    cross_matrix,
)
from osl_analysis.walking.walking_settings import PlateModelSettings

PARAMETERS = 10  # m, mc (x, y, z), I (xx, yy, zz, xy, xz, yz)
# Weights of forces [m] and moments: a force's lever about the ankle is about 0.1 m
WEIGHT = np.array([0.1] * 3 + [1.0] * 3)


class PlateLimits:
    """When inertia, lag and height of a plate are known."""

    LIGHT = 0.1  # [N*m], weighted wrench of a plate that is too light to show its lag
    SMALLEST_WRENCH = 0.01  # of a direction, as a share of the largest, for it to be identified
    LARGEST_NOISE_SHARE = 0.5  # of a direction's power in the columns
    LARGEST_LAG_S = 0.012
    LAG_STEP_S = 0.002  # a parabola between the steps is exact to 1 % below 20 Hz
    LARGEST_LAG_MISFIT = 0.5  # of the wrench's mean square, for the wrench to follow the motion
    LARGEST_HEIGHT_SE_M = 0.005  # of a height that is reported
    CERTAIN_SES = 4.0  # standard errors beyond which a height is certain
    SMALLEST_HEIGHT_COLUMN = 0.02  # share of its column that no other explains
    LIGHT_KG = 0.1  # mass below which a centre of mass is not known
    SPREAD_FRAMES = 30  # by which the low-pass of the identification spreads a motion
    # at rest noise gives 0.03 deg; 11 frames at 300 Hz change the lag by 2 ms
    HIDDEN_TURN_DEG = 0.2
    END_S = 0.05  # at both ends of a track, whose slopes tell a motion that the recording cuts
    FEWEST_END_FRAMES = 5


# Scales of the parameters for a plate of 1 kg whose half is 0.3 m long
TYPICAL_PLATE = np.array([[1.0]] + [[0.3]] * 3 + [[0.3**2]] * 6)


@dataclass(frozen=True)
class PlateModel:
    """The plate's inertial parameters, and its lag behind the markers."""

    # (10,): m, mc (x, y, z), I (xx, yy, zz, xy, xz, yz) [kg, kg*m, kg*m^2]; the least that fit
    parameters: StoredArray
    directions: StoredArray  # (10, r) of the parameters that the motion shows
    rms_before: StoredArray  # RMS wrench (6,) [N, N*m] of the unloaded plate, minus its mean
    rms_after: StoredArray  # the same without the plate's own wrench
    lags: tuple[float, ...] = ()  # [s] of the trials that show one
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
        is_certain = abs(self.height) > PlateLimits.CERTAIN_SES * (self.height_se or 0.0)
        return self.height * is_certain

    @property
    def lag(self) -> float | None:
        """The mean of the lags [s]; None where it is unknown, and then not corrected."""
        return float(np.mean(self.lags)) if self.lags else None

    @property
    def lag_sd(self) -> float | None:
        """Scatter [s] of the lags; None with fewer than two."""
        return float(np.std(self.lags, ddof=1)) if len(self.lags) > 1 else None

    @property
    def lag_se(self) -> float | None:
        """Standard error [s] of the lag; None with fewer than two."""
        return None if self.lag_sd is None else self.lag_sd / np.sqrt(len(self.lags))


NOT_REMOVED = "walking.plate_inertia is none"
NO_CORRECTION = PlateModel(
    parameters=np.zeros(PARAMETERS),
    directions=np.zeros((PARAMETERS, 0)),
    rms_before=np.full(6, np.nan),
    rms_after=np.full(6, np.nan),
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
            "no trials of the unloaded plate; add trials of experiment 'plate' to the sheet"
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

    motions = unloaded_motions(usable)
    lags = []
    for recording, (motion, _) in zip(usable, motions, strict=True):
        with naming(f"trial {recording.track.name}", trial=recording.track.name):
            lags.append(plate_lag(motion, recording.wrench_at, recording.smooth))

    model = plate_model(usable, lags)
    if len(usable) == 1:
        return model

    columns_and_wrenches = [
        (recording.smooth(inertial_columns(motion)), recording.wrench_at(model.lag or 0.0))
        for recording, (motion, _) in zip(usable, motions, strict=True)
    ]
    model = with_height(model, columns_and_wrenches)
    without_each = [
        plate_model(usable[:i] + usable[i + 1 :], lags[:i] + lags[i + 1 :], model)
        for i in range(len(usable))
    ]
    return replace(model, leave_one_out=tuple(without_each))


@dataclass(frozen=True)
class UnloadedRecording:
    """A trial of an unloaded, moving plate."""

    # The longest run of frames in which it was seen, without a motion that the run cuts
    track: platform.PlatformTrack
    centre: Array  # the plate's centre (3,) [m] at rest
    wrench_at: WrenchReader  # in the track's frames, through both low-passes
    # The further low-pass of the identification, after that of the crossings
    plate_low_pass: LowPass

    def smooth(self, values: Array) -> Array:
        """Pass values (n, ...) in the track's frames through the low-pass of the identification."""
        return self.plate_low_pass(values, self.track.rate)

    def along(self, axes: Array) -> tuple[BodyMotion, Array]:
        """Motion of the plate's centre along directions (r, 6), weighted by the track's gate, and
        squares (10, 10) of marker noise in its columns.

        The noise is that of frames at rest before `smooth`, which spreads the motions into them.
        """
        motion, weights = self.track.measured_motion(axes, self.centre)
        columns = inertial_columns(motion)
        squares = np.zeros((PARAMETERS, PARAMETERS))
        count = 0
        for run in runs(weights == 0):
            if run.stop - run.start < platform.MotionLimits.FEWEST_FRAMES:
                continue
            still = stacked_columns(without_mean(columns[run]))
            squares = squares + still.T @ still
            count += run.stop - run.start
        return motion.weighted(weights), squares / max(count, 1) * self.noise_sum(weights)

    def noise_sum(self, weights: Array) -> float:
        """The noise's sum of squares after weights and `smooth`, over its mean square before them.

        It is the sum over all lags of A r q, with the autocorrelations r of low-passed noise that
        is differentiated twice (1 at lag 0), q of the further filter's response and A of the
        weights.
        """
        n = 2 * len(weights)  # padded, so that nothing wraps
        f: Array = np.fft.rfftfreq(n, 1 / self.track.rate).astype(float)
        r = np.fft.irfft(self.track.low_pass.gain(f) ** 2 * f**4, n)
        q = np.fft.irfft(self.plate_low_pass.gain(f) ** 2, n)
        A = np.fft.irfft(np.abs(np.fft.rfft(weights, n)) ** 2, n)
        return float(np.sum(A * r / r[0] * q))


def unloaded_recording(
    trial: Trial, calibration: StaticCalibration, settings: PlateModelSettings
) -> UnloadedRecording:
    """Read the platform over the longest run of frames in which it was seen, and the wrench."""
    check_type_on_platform(trial, settings.plate)
    names = settings.markers.platform
    frames, poses = rigid.segment_poses(trial, names, calibration, settings)
    time, wrench = recorded_wrench(trial, settings.plate)
    force = np.abs(wrench[:, 2])
    load = np.median(force)
    if load > settings.largest_zero_n:
        raise InputError(
            f"the plate carries {load:.0f} N, expected an unloaded plate and at"
            f" most {settings.largest_zero_n:g} N; zero the plate and record again, or correct the"
            " experiment of this trial in the sheet, which is 'plate'",
        )
    rows = longest_run(poses.seen())
    shown = 0.0  # largest turn from rest to rest [rad]
    if rows.stop - rows.start >= platform.MotionLimits.FEWEST_FRAMES:
        seen = platform.platform_track(trial.name, frames[rows], poses[rows], calibration, settings)
        whole = whole_motions(seen)
        rows = slice(rows.start + whole.start, rows.start + whole.stop)
        is_long = rows.stop - rows.start >= platform.MotionLimits.FEWEST_FRAMES
        if is_long and not hides_a_motion(frames, poses, settings):
            shown = np.ptp(platform.rotation_from_rest(poses[rows]))
    if shown < settings.smallest_turn:
        raise InputError(
            f"the platform turns by {np.rad2deg(shown):.2f} deg from rest to"
            f" rest while its markers {', '.join(names)} are seen, expected"
            f" {settings.perturbation_deg:g} deg or more; correct labels in Nexus or"
            " the trial in the column static, or record a turn from rest to rest with markers in"
            " sight",
        )
    longest_blank_s = 0.1  # of no force: with noise it is 0 in single samples
    leap = 0.01  # of the largest force, from 0 to the smallest: a motion begins with less
    blank_s = force[longest_run(force == 0)].size / sampling_rate(time)
    smallest = np.min(force, initial=force.max(), where=force > 0)
    if blank_s > longest_blank_s and smallest > leap * force.max():
        raise InputError(
            f"the plate reads 0 for {blank_s:.2f} s, and no force between 0 and"
            f" {smallest:.2g} N: what lies below was set to 0; export the trials of the unloaded"
            " plate without a threshold",
        )
    track = platform.platform_track(trial.name, frames[rows], poses[rows], calibration, settings)

    read = wrench_reader(time, wrench, frames)

    def wrench_at(lag: float) -> Array:
        low_passed = settings.low_pass(read(lag), sampling_rate(frames))
        return settings.plate_low_pass(low_passed[rows], track.rate)

    return UnloadedRecording(
        track,
        centre=recorded_corners(trial, settings.plate).mean(axis=0),
        wrench_at=wrench_at,
        plate_low_pass=settings.plate_low_pass,
    )


def hides_a_motion(frames: Array, poses: Poses, settings: PlateModelSettings) -> bool:
    """Whether the platform turned during a gap of its markers that is too long to be fitted."""
    turn = platform.rotation_from_rest(poses)
    for gap in runs(poses.bridged):
        moved = abs(turn[gap.stop] - turn[gap.start - 1])
        is_long = rigid.gap_duration(frames, gap) > settings.longest_fitted_gap_s
        if is_long and moved > np.deg2rad(PlateLimits.HIDDEN_TURN_DEG):
            return True
    return False


def whole_motions(track: platform.PlatformTrack) -> slice:
    """The frames without a motion that begins before or ends after the track.

    They are none if it never rests. Half a motion is wrong after a low-pass: the lag is then off by
    milliseconds, the plate's mass by a tenth.
    """
    n = len(track.time)
    count = max(round(PlateLimits.END_S * track.rate), PlateLimits.FEWEST_END_FRAMES)
    moves = track.moving.copy()
    for end in (slice(0, count), slice(n - count, n)):
        since = track.time[end] - track.time[end].mean()
        slopes = since @ track.measured[end] / (since @ since)
        moved = np.abs(slopes).max() * np.sqrt(since @ since)
        moves[end] |= moved > platform.MotionLimits.STILL * track.noise
    rests = [
        run
        for run in runs(track.gate(moves) == 0)
        if run.stop - run.start >= platform.MotionLimits.FEWEST_FRAMES
    ]
    if not rests:
        rests = [slice(0, 0)]
    return slice(rests[0].start if moves[0] else 0, rests[-1].stop if moves[-1] else n)


def unloaded_motions(
    recordings: Sequence[UnloadedRecording],
) -> list[tuple[BodyMotion, Array]]:
    """The motion and noise of each recording along the directions that they share."""
    axes_of_each = platform.shared_directions([recording.track for recording in recordings])
    return [recording.along(axes) for recording, axes in zip(recordings, axes_of_each, strict=True)]


def plate_model(
    recordings: Sequence[UnloadedRecording], lags: Sequence[float], whole: PlateModel | None = None
) -> PlateModel:
    """One inertia from all recordings at the mean of their lags [s], NaN where one shows none.

    Only what `whole`, from more recordings, shows is identified, and the rest stays as it is there.
    """
    known_lags = tuple(lag for lag in lags if np.isfinite(lag))
    lag = float(np.mean(known_lags)) if known_lags else 0.0
    motions = unloaded_motions(recordings)
    model = identify_plate_inertia(
        [
            (motion, recording.wrench_at(lag))
            for recording, (motion, _) in zip(recordings, motions, strict=True)
        ],
        recordings[0].smooth,
        within=None if whole is None else whole.directions,
        noise=np.sum([noise for _, noise in motions], axis=0),
        known=None if whole is None else whole.parameters,
    )
    return replace(model, lags=known_lags)


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

    columns = np.zeros((len(a), 6, PARAMETERS))
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
    recordings: Sequence[tuple[BodyMotion, Array]],
    smooth: Callable[[Array], Array] = np.asarray,
    within: Array | None = None,
    noise: Array | None = None,
    known: Array | None = None,
) -> PlateModel:
    """Identify the inertial parameters by least squares, corrected for marker noise.

    Only directions that the motion shows are identified. So a plate may turn about any axis: its
    wrench is known for motions in crossings like those here, even if single parameters are not.

    Parameters
    ----------
    recordings : sequence of (BodyMotion, Array)
        Motion of the plate's centre, and wrench (n, 6), each with its own zero.
    smooth : callable
        The low-pass that the wrench has passed. It is applied to the columns, which are products of
        motions; with filtered motions instead, 8 Hz would make the lag 0.05 ms too small.
    within : Array, optional
        Directions (10, q) to which the identified ones are confined.
    noise : Array, optional
        Gram matrix N (10, 10) of marker noise in the columns. With G that of the columns, estimates
        are corrected by (G - N)^-1 G.
    known : Array, optional
        Parameters (10,) that stay where nothing is identified; 0 by default.

    Raises
    ------
    IdentifiabilityError
        Marker noise exceeds the motion in every direction.

    References
    ----------
    Fuller, Measurement Error Models, 1987, section 1.4.
    """
    columns = np.concatenate(
        [without_mean(smooth(inertial_columns(motion))) for motion, _ in recordings]
    )
    wrench = np.concatenate([without_mean(recorded) for _, recorded in recordings])
    start = np.zeros(PARAMETERS) if known is None else known
    N = np.zeros((PARAMETERS, PARAMETERS)) if noise is None else noise

    X = stacked_columns(columns)
    G = X.T @ X
    basis = excited_directions(G, N, np.eye(PARAMETERS) if within is None else within)
    unexplained = (wrench * WEIGHT).T.ravel() - X @ start
    right = X.T @ unexplained + N @ start
    change = np.linalg.solve(basis.T @ (G - N) @ basis, basis.T @ right)
    parameters = start + basis @ change
    return PlateModel(
        parameters,
        directions=basis,
        rms_before=column_rms(wrench),
        rms_after=column_rms(wrench - columns @ parameters),
    )


def excited_directions(squares: Array, noise: Array, within: Array) -> Array:
    """Find the directions of the parameters whose wrench the motion shows.

    Parameters
    ----------
    squares, noise : Array
        Gram matrices (10, 10) of the columns, and of the marker noise in them.
    within : Array
        Directions (10, q) whose span is searched.

    Returns
    -------
    Array
        (10, r), in units of a typical plate: eigenvectors above a share of the largest, with at
        most half of noise.
    """
    basis = np.linalg.qr(within / TYPICAL_PLATE)[0] * TYPICAL_PLATE
    power, vectors = np.linalg.eigh(basis.T @ squares @ basis)
    basis = basis @ vectors[:, power > PlateLimits.SMALLEST_WRENCH**2 * power[-1]]

    share, vectors = scipy.linalg.eigh(basis.T @ noise @ basis, basis.T @ squares @ basis)
    if share[0] > PlateLimits.LARGEST_NOISE_SHARE:
        raise IdentifiabilityError(
            f"marker noise is {share[0]:.0%} of what moves the unloaded plate in the direction that"
            " shows it best, expected 50% or less; record larger or faster motions of the unloaded"
            " plate"
        )
    return basis @ vectors[:, share <= PlateLimits.LARGEST_NOISE_SHARE]


def stacked_columns(columns: Array) -> Array:
    """Weighted columns (6 n, p) out of (n, 6, p), component by component."""
    return (columns * WEIGHT[:, None]).transpose(1, 0, 2).reshape(-1, columns.shape[2])


def without_mean(values: Array) -> Array:
    return values - values.mean(axis=0)


def column_rms(values: Array) -> Array:
    return np.sqrt(np.mean(values**2, axis=0))


def plate_lag(
    motion: BodyMotion, wrench_at: WrenchReader, smooth: Callable[[Array], Array]
) -> float:
    """Find the lag of the plate behind the markers with the least misfit, in one recording.

    Parameters
    ----------
    motion : BodyMotion
        Of the plate's centre, n frames, not passed through `smooth`.
    wrench_at : callable
        The wrench (n, 6) a lag [s] later, passed through `smooth`.

    Returns
    -------
    float
        [s]; NaN if the plate is too light.

    Raises
    ------
    InputError
        The wrench does not follow the motion at any lag.
    """
    lags = np.arange(
        -PlateLimits.LARGEST_LAG_S,
        PlateLimits.LARGEST_LAG_S + PlateLimits.LAG_STEP_S / 2,
        PlateLimits.LAG_STEP_S,
    )
    wrenches = [wrench_at(lag) for lag in lags]
    directions = identify_plate_inertia([(motion, wrenches[len(lags) // 2])], smooth).directions
    # At the ends of a recording a low-pass passes more noise, and how much depends on the lag
    moves = np.any(motion.alpha != 0, axis=1) | np.any(motion.acceleration != 0, axis=1)
    rows = scipy.ndimage.binary_dilation(moves, iterations=PlateLimits.SPREAD_FRAMES)
    columns = stacked_columns(without_mean(smooth(inertial_columns(motion))[rows]))
    basis = np.linalg.qr(columns @ directions)[0]
    misfit = []  # weighted mean square of what no parameters explain
    for wrench in wrenches:
        stacked = (without_mean(wrench[rows]) * WEIGHT).T.ravel()
        misfit.append(6 * np.mean((stacked - basis @ (basis.T @ stacked)) ** 2))

    best = np.argmin(misfit)
    square = np.sum((column_rms(without_mean(wrenches[best][rows])) * WEIGHT) ** 2)
    if square < PlateLimits.LIGHT**2:
        return np.nan
    if misfit[best] > PlateLimits.LARGEST_LAG_MISFIT * square or best in (0, len(lags) - 1):
        raise InputError(
            "the unloaded plate's wrench does not follow its motion within"
            f" {PlateLimits.LARGEST_LAG_S * 1e3:g} ms; name the plate that moves under"
            " `walking.plate`, synchronise the recorders, or check markers and channels"
        )
    before, smallest, after = misfit[best - 1 : best + 2]
    return float(
        lags[best]
        + 0.5 * PlateLimits.LAG_STEP_S * (before - after) / (before - 2 * smallest + after)
    )


def with_height(
    model: PlateModel, columns_and_wrenches: Sequence[tuple[Array, Array]]
) -> PlateModel:
    """Add the height of the corners' centre above the point of the moments, where it is seen.

    From columns (n, 6, 10) and wrench (n, 6) of each recording; its standard error is from leaving
    out each (jackknife).
    """
    count = len(columns_and_wrenches)
    height = moments_below(model.directions, columns_and_wrenches)
    without_each = [
        moments_below(model.directions, [*columns_and_wrenches[:i], *columns_and_wrenches[i + 1 :]])
        for i in range(count)
    ]
    se = np.sqrt((count - 1) * np.var(without_each))
    return replace(
        model,
        height=height if se < PlateLimits.LARGEST_HEIGHT_SE_M else None,
        height_se=se if np.isfinite(se) else None,
    )


def moments_below(directions: Array, columns_and_wrenches: Sequence[tuple[Array, Array]]) -> float:
    """Height [m] from the two centres of mass that the unloaded plate shows.

    Forces show that from the corners' centre, moments that from their own point: mc gets another
    value in the moments. NaN if only moments show one, as if the plate does not turn, or without a
    mass.
    """
    columns = np.concatenate([without_mean(columns) for columns, _ in columns_and_wrenches])
    wrench = np.concatenate([without_mean(wrench) for _, wrench in columns_and_wrenches])
    is_moment = (np.arange(6) > 2)[:, None]
    mc_of_moments = stacked_columns(columns[:, :, 1:4] * is_moment)
    X = np.column_stack([stacked_columns(columns) @ directions, mc_of_moments])
    size = np.maximum(np.linalg.norm(X, axis=0), 1e-12)
    X = X / size
    estimates = np.linalg.lstsq(X, (wrench * WEIGHT).T.ravel(), rcond=1e-4)[0] / size

    # The last column is mc_z of the moments: is it told apart from the others?
    other_columns = X[:, :-1]
    vertical = X[:, -1]
    unexplained = vertical - other_columns @ np.linalg.lstsq(other_columns, vertical, rcond=1e-4)[0]
    mass = directions[0] @ estimates[: directions.shape[1]]
    if (
        mass > PlateLimits.LIGHT_KG
        and np.linalg.norm(unexplained) > PlateLimits.SMALLEST_HEIGHT_COLUMN
    ):
        return float(estimates[-1] / mass)
    return np.nan


def plate_table(model: PlateModel) -> pl.DataFrame:
    """Tabulate `plate.csv`: RMS of each component before and after the correction, and the lag."""
    table = pl.DataFrame(
        {
            "component": ("F_x", "F_y", "F_z", "M_x", "M_y", "M_z"),
            "rms_before": model.rms_before,
            "rms_after": model.rms_after,
        }
    )
    facts = {"lag_s": model.lag, "lag_se_s": model.lag_se, "height_m": model.height}
    return table.with_columns(pl.lit(fact, pl.Float64).alias(name) for name, fact in facts.items())
