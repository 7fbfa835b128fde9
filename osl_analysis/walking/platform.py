"""The platform's motion: in one trial, along its few directions; and what crossings share: shape,
onset and trigger.

A pose has six coordinates: the screw (logarithm in SE(3)) from the cluster's pose in the static
trial. A rotation about a fixed axis, however large, is a straight line in them. They are scaled so
that marker noise is equal in all directions: their norm is the root of the sum of squared
displacements of the markers [m].

A platform repeats its command. Marker noise in one crossing reads as more than 1 N*m of inertial
moment of a heavy plate. The mean over crossings has little noise, and gives each start to a
fraction of a millisecond."""

import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
import polars as pl
import scipy

from osl_analysis.errors import InputError
from osl_analysis.signals import LowPass, runs, sampling_rate
from osl_analysis.trial import Array, Trial
from osl_analysis.walking import bodies
from osl_analysis.walking.bodies import BodyMotion, Kept, Mask, Poses, StaticCalibration
from osl_analysis.walking.settings import CrossingSettings, PlatformSettings

FEWEST_FRAMES = 10  # fewest frames for a position at rest
STILL = 7.0  # speed over its noise above which a platform moves; at rest, 1 frame in 10^7 is above


def rotation_from_rest(platform: Poses) -> Array:
    """Angle (n,) [rad] of the platform from its pose in the static trial, about the axis of the
    largest rotation, which is positive; NaN where not seen. It has a sign, so that marker noise has
    zero mean."""
    seen = platform.seen()
    angle = np.full(len(seen), np.nan)
    if seen.any():
        vectors = scipy.spatial.transform.Rotation.from_matrix(platform.rotation[seen]).as_rotvec()
        largest = vectors[np.argmax(np.linalg.norm(vectors, axis=1))]
        angle[seen] = vectors @ largest / max(float(np.linalg.norm(largest)), np.finfo(float).tiny)
    return angle


def moved_from_rest(platform: Poses, settings: PlatformSettings) -> tuple[Array, float]:
    """Displacement (n,) of a platform, NaN where not seen, and the threshold above which it
    perturbs. It is the turn [rad]; for a belt, the shift [m] from the first frame along the largest
    shift."""
    if settings.perturbed_by == "platform":
        return rotation_from_rest(platform), float(np.deg2rad(settings.perturbation_deg))
    away = platform.position - platform.position[np.argmax(platform.seen())]
    largest = away[np.argmax(np.linalg.norm(np.nan_to_num(away), axis=1))]
    return (
        away @ largest / max(float(np.linalg.norm(largest)), 1e-9),
        1e-3 * settings.largest_shift_mm,
    )


def screw_scale(reference: Array) -> Array:
    """Scale (6, 6) [m/rad, 1] of rotation vector and translation about the centroid of markers at
    reference positions (m, 3) [m]. To first order, noise of s [m] in each marker's coordinates is s
    in each of the six."""
    local = reference - reference.mean(axis=0)
    size, axes = np.linalg.eigh(np.sum(local**2) * np.eye(3) - local.T @ local)
    return scipy.linalg.block_diag(
        (axes * np.sqrt(size)) @ axes.T, np.sqrt(len(reference)) * np.eye(3)
    )


def noise_gain(low_pass: LowPass, rate: float, derivative: int = 0) -> float:
    """Variance of a derivative [1/s^derivative, squared] of white unit noise through a low-pass,
    both runs."""
    f = np.linspace(0.0, rate / 2, 2001)
    return float(
        np.trapezoid((2 * np.pi * f) ** (2 * derivative) * low_pass.gain(f) ** 2, f) * 2 / rate
    )


def directions(coordinates: Sequence[Array], noise: float, low_pass: LowPass, rate: float) -> Array:
    """Orthonormal directions (r, 6) of filtered motions (n, 6) [m] from rest: at least one, and all
    whose mean square exceeds the largest that noise would show (Marchenko and Pastur). `noise` [m]
    is that of a frame, unfiltered."""
    stacked, gain = np.concatenate(list(coordinates)), noise_gain(low_pass, rate)
    _, size, axes = np.linalg.svd(stacked, full_matrices=False)
    largest = noise**2 * gain * (1 + np.sqrt(6 / max(len(stacked) * gain, 1.0))) ** 2
    return np.asarray(axes[: max(int(np.sum(size**2 / len(stacked) > 1.3 * largest)), 1)])


@dataclass(frozen=True)
class PlatformTrack:
    """The platform's scaled coordinates in n consecutive frames of one trial, at uniform time (n,)
    [s]."""

    name: str
    time: Array
    reference: Array  # positions (m, 3) [m] of the cluster's markers in the static trial
    measured: Array  # coordinates (n, 6) [m], each frame with its noise
    low_pass: LowPass  # of the crossings
    noise: float  # standard deviation [m] of the noise in one frame of `measured`

    @property
    def rate(self) -> float:
        return sampling_rate(self.time)

    @property
    def spread(self) -> float:
        """Time [s] by which the low-pass widens a motion: 25 ms at 20 Hz."""
        return 0.025 * 20.0 / self.low_pass.cutoff_hz

    @cached_property
    def filtered(self) -> Array:
        return self.low_pass(self.measured, self.rate)

    @cached_property
    def velocity(self) -> Array:
        """Of the filtered coordinates (n, 6) [m/s]."""
        return np.asarray(np.gradient(self.filtered, self.time, axis=0))

    def moves(self, axes: Array) -> Mask:
        """Frames (n,) in which the platform's speed along any of the directions (r, 6) exceeds the
        noise. The ends of a recording do not count: a low-pass passes more noise there."""
        inside = (self.time > self.time[0] + self.spread) & (
            self.time < self.time[-1] - self.spread
        )
        noise = self.noise * np.sqrt(noise_gain(self.low_pass, self.rate, 1))
        return np.asarray(inside & (np.linalg.norm(self.velocity @ axes.T, axis=1) > STILL * noise))

    @cached_property
    def moving(self) -> Mask:
        """Frames (n,) in which the platform moves along any direction."""
        return self.moves(np.eye(6))

    def gate(self, moves: Mask) -> Array:
        """Weights (n,) of inertial forces: 1 while the platform moves and within 2 `spread` of
        that, 0 beyond 3. A slow ramp accelerates most while noise hides its speed: with 1 `spread`,
        a mass would be 0.1 % wrong."""
        if not moves.any():
            return np.zeros(len(moves))
        nearest = scipy.ndimage.distance_transform_edt(~moves) / self.rate
        return np.asarray(0.5 + 0.5 * np.cos(np.pi * np.clip(nearest / self.spread - 2, 0, 1)))

    @cached_property
    def rest(self) -> Array:
        """Coordinates (6,) [m] at rest: their mean while the platform rests before its fastest
        motion."""
        fastest = self.time[int(np.argmax(np.linalg.norm(self.velocity, axis=1)))]
        before = (self.gate(self.moving) == 0) & (self.time < fastest)
        if before.sum() < FEWEST_FRAMES:
            before = self.time <= self.time[0] + self.spread
        return np.asarray(self.measured[before].mean(axis=0))

    def own_motion(
        self, axes: Array, centre: Array, rows: slice = slice(None)
    ) -> tuple[BodyMotion, Array]:
        """Measured motion in `rows`, along directions (r, 6), of the point at `centre` (3,) [m];
        and its `gate`."""
        motion = self.motion_of(
            self.rest + (self.measured - self.rest) @ axes.T @ axes, centre, rows
        )
        return motion, self.gate(self.moves(axes))[rows]

    def motion_of(self, coordinates: Array, centre: Array, rows: slice) -> BodyMotion:
        """Motion in `rows` of the point that rests at `centre` (3,) [m], for other unfiltered
        coordinates (n, 6) [m]. Markers at these poses pass the low-pass, as the wrench does. The
        spline needs 60 frames beside `rows`."""
        first, last, _ = rows.indices(len(self.time))
        start, stop = max(first - 60, 0), min(last + 60, len(self.time))
        screw: Array = np.linalg.solve(screw_scale(self.reference), coordinates.T).T.astype(float)
        pose, origin = (
            scipy.spatial.transform.RigidTransform.from_exp_coords(screw),
            self.reference.mean(axis=0),
        )
        turned = (self.reference - origin) @ np.swapaxes(pose.as_matrix()[:, :3, :3], 1, 2)
        markers = self.low_pass(turned + (pose.translation + origin)[:, None], self.rate)
        poses = bodies.cluster_poses(self.reference, markers[start:stop])
        return bodies.body_motion(self.time[start:stop], poses, centre)[
            first - start : last - start
        ]


def platform_track(
    trial: str,
    time: Array,
    poses: Poses,
    calibration: StaticCalibration,
    settings: PlatformSettings,
) -> PlatformTrack:
    """The track of a platform's poses (n,), none NaN. Gaps of 15 ms and more, which never hide a
    turn, are straight lines: a cubic would amplify the noise beside them into a motion. The noise
    is from the median of second differences."""
    reference, rate = calibration.positions(settings.markers.platform, trial), sampling_rate(time)
    turned = scipy.spatial.transform.Rotation.from_matrix(poses.rotation)
    pose = scipy.spatial.transform.RigidTransform.from_components(
        poses.position - reference.mean(axis=0), turned
    )
    measured = pose.as_exp_coords() @ screw_scale(reference).T
    found = measured.copy()
    for gap in runs(poses.bridged):
        if (gap.stop - gap.start) / rate < 0.015:
            continue
        frames = (
            np.r_[max(gap.start - 4, 0) : gap.start],
            np.r_[gap.stop : min(gap.stop + 4, len(time))],
        )
        before, after = (beside[~poses.bridged[beside]] for beside in frames)
        share = (np.arange(gap.start, gap.stop) - before.mean()) / (after.mean() - before.mean())
        first, last = measured[before].mean(axis=0), measured[after].mean(axis=0)
        found[gap] = first + share[:, None] * (last - first)
    second = np.diff(found[~poses.bridged], n=2, axis=0)
    noise = 1.4826 * float(np.median(np.abs(second))) / np.sqrt(6.0) if second.size else 0.0
    noise = float(max(noise, 2e-7))  # [m]: single precision at 1 m
    return PlatformTrack(trial, time, reference, found, settings.low_pass, noise)


def track_about(
    trial: str,
    time: Array,
    poses: Poses,
    calibration: StaticCalibration,
    settings: PlatformSettings,
    instant: float,
) -> PlatformTrack:
    """The platform's track in the run of seen frames about an instant [s], from its poses at times
    (n,) [s]."""
    for run in runs(poses.seen()):
        if time[run.start] <= instant <= time[run.stop - 1]:
            return platform_track(trial, time[run], poses[run], calibration, settings)
    raise InputError(
        f"the platform markers {', '.join(settings.markers.platform)} are hidden at {instant:.3f} s"
    )


def shared_directions(tracks: Sequence[PlatformTrack]) -> list[Array]:
    """Directions (r, 6) of the motion in each trial: those of all trials together, if no trial has
    fewer alone. Else each has its own: a platform may turn in one trial and shift in another."""

    def of(some: Sequence[PlatformTrack]) -> Array:
        moved = [(t.filtered - t.rest)[t.gate(t.moving) > 0] for t in some]
        noise = float(np.sqrt(np.mean([t.noise**2 for t in some])))
        found = [one for one in moved if len(one)]
        return (
            directions(found, noise, some[0].low_pass, some[0].rate) if found else np.zeros((0, 6))
        )

    together = of(tracks)
    return [
        together if len(own) == len(together) else own for own in (of([track]) for track in tracks)
    ]


def find_onset(
    time: Array, rotation: Array, threshold: float, moves: str = "the platform turns"
) -> float | None:
    """Time [s] at which a platform starts to rotate; None if it never rotates by `threshold` [rad].
    `rotation` (n,) [rad] is positive in the direction of the perturbation. It must not be
    low-passed, which would spread the start. Its first part is fitted by c (t - onset)^p: a
    straight line through a smooth start is late by a fifth of the ramp. Any other curve that rests
    and then `moves` may be given, in any unit."""
    seen = np.isfinite(rotation)
    time, rotation = time[seen], rotation[seen]
    above = np.flatnonzero(rotation > threshold)
    if not len(above):
        return None
    first, rest = int(above[0]), 0.1  # [s] before the first motion in which the platform rests
    resting = (time >= time[first] - 2 * rest) & (time < time[first] - rest)
    if not resting.any():
        raise InputError(
            f"{moves} at {time[first]:.3f} s, within {2 * rest:g} s of the recording's start; start"
            " to record earlier, or exclude the trial"
        )
    turned, noise = rotation - float(np.mean(rotation[resting])), float(np.std(rotation[resting]))
    # Fitted up to 25 times the noise. A smaller part follows a power of time more closely; a larger
    # part is less affected by noise. At least four frames determine the power.
    height = float(np.max(turned))
    level = height * np.clip(25 * noise / height, 0.03, 0.25)
    visible = max(0.2 * level, 3 * noise)
    end, start = (int(np.flatnonzero(turned[:first] < limit)[-1]) + 1 for limit in (level, visible))
    end = min(max(end, start + 3), first)
    rows = slice(int(np.searchsorted(time, time[end] - 2 * rest)), end + 1)
    step = 0.0002  # [s], resolution of the onset
    starts = np.arange(-rest, -step, step)
    since, misfits = np.clip(time[rows] - time[end] - starts[:, None], 0.0, None), []
    for p in np.arange(1.0, 4.01, 0.25):  # 1 is a straight ramp
        shape = since**p
        size = shape @ turned[rows] / np.sum(shape**2, axis=1)
        misfits.append(np.sum((turned[rows] - size[:, None] * shape) ** 2, axis=1))
    return float(time[end] + starts[np.argmin(misfits) % len(starts)])


LEAD_S = 0.15  # time [s] from the begin of the shape to the middle of its rise
GRID_S = 0.002  # step [s] of the stored shape
# alternations of shape and alignment; four reduce an error of 5 ms in the start to 1e-5 s
ROUNDS = 6
# p-value below which scatter is not noise: a duration is then free, a latency not constant
IMPROBABLE = 1e-3


@dataclass(frozen=True)
class Alignment:
    """How one crossing follows the shape."""

    name: str
    start: float  # when the motion starts [s]
    amplitude: float  # size of the motion, 1 on average, negative in the other direction
    offset: Kept  # coordinates (r,) [m] at rest
    # time scale of the motion, 1 on average; 1 for all if durations do not scatter
    duration: float = 1.0
    start_se: float = 0.0  # standard error [s] of the start by this crossing's marker noise
    duration_se: float = 0.0
    # mean square of the filtered difference between motion and shape, over that of noise
    misfit: float = 0.0
    follows: bool = True  # whether noise explains the misfit


@dataclass(frozen=True)
class PlatformTemplate:
    """The shape that motions of the platform share."""

    axes: Kept  # directions (r, 6) of the motion, as in `PlatformTrack`
    time: Kept  # grid (g,) [s] from the start of the motion
    shape: Kept  # coordinates (g, r) [m] from rest, of a motion of amplitude 1
    noise: float  # standard deviation [m] of the noise in one frame of a crossing
    crossings: int  # number of crossings whose mean the shape is
    scaled: bool  # whether the duration of the motion differs between crossings
    start_shape: float = 0.0  # largest change [s] of the start by another step that fits as well

    @cached_property
    def spline(self) -> "scipy.interpolate.BSpline":
        return scipy.interpolate.make_interp_spline(self.time, self.shape, k=5)

    def covers(self, time: Array) -> Mask:
        """Which times [s] from the start are on the grid."""
        return np.asarray((time >= self.time[0]) & (time <= self.time[-1]))

    def curve(self, time: Array, a: Alignment) -> Array:
        """Coordinates (n, r) [m] from rest, at times [s], of a crossing that follows the shape;
        constant beyond it."""
        since = np.clip((time - a.start) / a.duration, self.time[0], self.time[-1])
        return np.asarray(a.amplitude * self.spline(since))


def mean_shape(
    pairs: Sequence[tuple[PlatformTrack, Alignment]],
    axes: Array,
    ends: tuple[float, float],
    noise: float,
    scaled: bool,
    unit: bool = True,
) -> PlatformTemplate:
    """The least-squares spline through all aligned motions, between two `ends` [s] from their
    start. Mean amplitude and duration of the crossings are normalised to 1 if `unit`; else they
    stay those of the alignments."""
    size = float(np.mean([abs(a.amplitude) for _, a in pairs])) if unit else 1.0
    duration = float(np.exp(np.mean([np.log(a.duration) for _, a in pairs]))) if unit else 1.0
    time, values, weights = [], [], []
    for track, a in pairs:
        since, amplitude = (track.time - a.start) / (a.duration / duration), a.amplitude / size
        near = (since >= ends[0]) & (since <= ends[1])
        time.append(since[near])
        values.append((track.measured[near] @ axes.T - a.offset) / amplitude)
        weights.append(np.full(near.sum(), abs(amplitude)))
    order = np.argsort(np.concatenate(time), kind="stable")
    stamps, drawn, trust = (np.concatenate(each)[order] for each in (time, values, weights))
    # knots each 10 ms: 50 Hz, beyond the low-pass of the analysis
    step = max(0.01, 1.5 / pairs[0][0].rate)
    inner = np.linspace(*ends, round((ends[1] - ends[0]) / step) + 1)[1:-1]
    knots = np.r_[[stamps[0]] * 4, inner, [stamps[-1]] * 4]
    spline = scipy.interpolate.make_lsq_spline(stamps, drawn, knots, k=3, w=trust)
    grid = np.arange(np.ceil(stamps[0] / GRID_S), np.floor(stamps[-1] / GRID_S) + 1) * GRID_S
    shape = spline(grid)
    rest = shape[grid <= grid[0] + LEAD_S / 4].mean(axis=0)
    return PlatformTemplate(axes, grid, shape - rest, noise, len(pairs), scaled)


def shape_fit(
    track: PlatformTrack, guess: Alignment, template: PlatformTemplate, scaled: bool
) -> Alignment:
    """The start, amplitude and, if `scaled`, duration with which a motion follows a shape, by
    Gauss-Newton. It follows the shape if the mean square of their filtered difference is at most
    four SDs above that of noise."""
    measured, a = (
        track.measured @ template.axes.T,
        guess if scaled else replace(guess, duration=1.0),
    )
    r = measured.shape[1]
    for _ in range(ROUNDS):
        since = (track.time - a.start) / a.duration
        near = template.covers(since)
        shape, slope = template.spline(since[near]), template.spline(since[near], 1)
        amplitude = a.amplitude if abs(a.amplitude) > 0.1 else 1.0
        columns = [
            shape,
            -slope * amplitude / a.duration,
            -slope * since[near, None] * amplitude / a.duration,
        ]
        moving = np.stack([c.T.ravel() for c in columns[: 3 if scaled else 2]], axis=1)
        design = np.hstack([moving, np.repeat(np.eye(r), near.sum(), axis=0)])
        change: Array = np.asarray(
            np.linalg.lstsq(design, (measured[near] - amplitude * shape).T.ravel())[0], float
        )
        a = replace(
            a,
            amplitude=amplitude + float(change[0]),
            start=a.start + float(np.clip(change[1], -0.02, 0.02)),
            duration=float(np.clip(a.duration + (change[2] if scaled else 0.0), 0.5, 2.0)),
            offset=change[-r:],
        )
    errors = template.noise * np.sqrt(np.diag(np.linalg.inv(design.T @ design)))
    since = (track.time - a.start) / a.duration
    near = template.covers(since)
    inside = near & (since <= template.time[-1] - 2 * track.spread)
    difference = np.where(near[:, None], measured - a.offset - template.curve(track.time, a), 0.0)
    filtered, gain = (
        track.low_pass(difference, track.rate)[inside],
        noise_gain(track.low_pass, track.rate),
    )
    before = filtered[since[inside] < template.time[0] + LEAD_S / 2]
    level = max(template.noise**2 * gain, float(np.mean(before**2)) if before.size else 0.0)
    misfit = float(np.mean(filtered**2)) / level
    follows = bool(misfit < 1 + 4 * np.sqrt(2 / max(filtered.size * gain, 1.0)))
    duration_se = float(errors[2]) if scaled else 0.0
    return replace(
        a, start_se=float(errors[1]), duration_se=duration_se, misfit=misfit, follows=follows
    )


def start_of_rise(time: Array, coordinates: Array, noise: float) -> tuple[float, float]:
    """The start [s] of a mean motion (n, r) [m] from rest, along its largest displacement, from a
    smooth step fitted to
    0.7 of the rise (the end may overshoot); and its largest change [s] by another step that fits as
    well, else 0. `noise` [m] is that of each sample.

    Steps are I(x; p, p): a straight ramp for p = 1, a cubic for 2, minimum jerk for 3, degree seven
    for 4. Minimum jerk is taken unless another lowers chi-square by more than 30. Starts of two
    steps that fit alike differ by 6 to 10 % of the rise: a smaller margin would scatter the onset
    by several ms."""
    size = np.linalg.norm(coordinates, axis=1)
    largest = int(np.argmax(size))
    turned = coordinates @ coordinates[largest] / size[largest]
    height = float(turned[turned > 0.95 * turned[largest]].mean())
    half, end = int(np.argmax(turned >= height / 2)), int(np.argmax(turned >= 0.7 * height)) + 1
    level = int(np.flatnonzero(np.r_[True, turned[1:half] < height / 10])[-1])
    quick = 2 * float(time[half] - time[level]) / 0.6 or 0.05
    guess = np.array([time[half] - quick / 2, quick, 0.0])

    def difference(step: Array, p: int) -> Array:
        """Residuals over noise of a step of some start, duration and level: `cost` is half of
        chi-square."""
        x = np.clip((time[:end] - step[0]) / step[1], 0, 1)
        return np.asarray(
            (scipy.special.betainc(p, p, x) + step[2] - turned[:end] / height) / (noise / height)
        )

    steps: dict[str, Any] = {"x_scale": [0.01, 0.05, 0.01], "diff_step": [1e-4, 1e-4, 1e-4]}
    least: Any = scipy.optimize.least_squares
    found: dict[int, Any] = {p: least(difference, guess, args=(p,), **steps) for p in (3, 1, 2, 4)}
    best = min(found, key=lambda p: found[p].cost)
    fit = found[best if 2 * (found[3].cost - found[best].cost) > 30 else 3]
    # of noise 1 in 400 is beyond
    alike = [one.x[0] for one in found.values() if 2 * (one.cost - found[best].cost) < 9]
    shape = max((abs(float(start - fit.x[0])) for start in alike), default=0.0)
    return float(fit.x[0]), shape


def platform_template(
    tracks: Sequence[PlatformTrack], window: float
) -> tuple[PlatformTemplate, list[Alignment]]:
    """The shape of the motions in two or more crossings, and how each follows it. Crossings that do
    not are left out of it. Time 0 is the start of the shape. It ends 50 ms after a `window` [s]
    from the middle of its rise."""
    if len(tracks) < 2:
        raise InputError(
            f"{len(tracks)} motions of the platform, expected 2 or more to find what they share"
        )
    ends, middles, moved = (-LEAD_S, window + 0.05), [], []
    # the middle of the rise: where the largest displacement from rest is half reached
    for track in tracks:
        size = np.linalg.norm(track.filtered - track.rest, axis=1)
        row, half = int(np.argmax(size > size.max() / 2)), float(size.max() / 2)
        share = float((half - size[row - 1]) / (size[row] - size[row - 1])) if row else 1.0
        middles.append(float(track.time[max(row - 1, 0)] + share * (track.time[1] - track.time[0])))
        since = track.time - middles[-1]
        near = track.filtered[(since >= ends[0]) & (since <= ends[1])]
        moved.append(near - near.mean(axis=0))  # where each rests is not a direction
    noise = float(np.sqrt(np.mean([track.noise**2 for track in tracks])))
    axes = directions(moved, noise, tracks[0].low_pass, tracks[0].rate)

    def alternated(
        pairs: Sequence[tuple[PlatformTrack, Alignment]], scaled: bool
    ) -> tuple[PlatformTemplate, list[Alignment]]:
        """Shape and alignments, fitted in turn."""
        for _ in range(ROUNDS):
            template = mean_shape(pairs, axes, ends, noise, scaled)
            pairs = [(track, shape_fit(track, a, template, scaled)) for track, a in pairs]
        return template, [a for _, a in pairs]

    def aligned(
        alignments: Sequence[Alignment], template: PlatformTemplate, scaled: bool
    ) -> list[Alignment]:
        return [
            shape_fit(track, a, template, scaled)
            for track, a in zip(tracks, alignments, strict=True)
        ]

    guesses = []
    # with the sign of the largest displacement
    for track, middle in zip(tracks, middles, strict=True):
        along = (track.filtered - track.rest) @ axes.T
        amplitude = float(along[np.argmax(np.abs(along[:, 0])), 0])
        guesses.append(Alignment(track.name, middle, amplitude, track.rest @ axes.T))
    template, alignments = alternated(list(zip(tracks, guesses, strict=True)), False)
    free = aligned(alignments, template, True)
    scatter = np.array([(a.duration - 1) / a.duration_se for a in free])
    if np.sum((scatter - scatter.mean()) ** 2) > scipy.special.chdtri(len(tracks) - 1, IMPROBABLE):
        template, alignments = alternated(list(zip(tracks, free, strict=True)), True)
    for _ in range(len(tracks)):
        following = [a.follows for a in alignments]
        if all(following) or sum(following) < 2:
            break
        pairs = [(track, a) for track, a in zip(tracks, alignments, strict=True) if a.follows]
        template, _ = alternated(pairs, template.scaled)
        alignments = aligned(alignments, template, template.scaled)
        if [a.follows for a in alignments] == following:
            break
    if sum(a.follows for a in alignments) < 2:
        raise InputError(
            "the platform moves in another way in each crossing, so that each keeps its own motion"
        )
    # The noise in each sample, as if it were independent of the others
    of_shape = float(template.noise / np.sqrt(template.crossings * tracks[0].rate * GRID_S))
    zero, start_shape = start_of_rise(template.time, template.shape, of_shape)
    template = replace(template, time=template.time - zero, start_shape=start_shape)
    # Fitted again: if durations are uncertain, the error of a start depends on the point of the
    # shape that it is.
    begun = [replace(a, start=a.start + zero * a.duration) for a in alignments]
    return template, aligned(begun, template, template.scaled)


def jackknife_rows(plate: Sequence[Array], platform: Sequence[Array]) -> Array:
    """Rows (m, n) [N*m] whose jackknife variance, (k - 1)/k times the squares of k rows about their
    mean, is the sum of two: of the changes without each plate trial, and of those without each
    group of crossings in the shape."""
    sources = [np.array(rows) for rows in (plate, platform) if len(rows) > 1]
    if not len(platform) or not sources:
        return np.array(plate)
    total = sum(len(rows) for rows in sources)
    sizes = [np.sqrt((1 - 1 / len(rows)) * total / (total - 1)) for rows in sources]
    return np.concatenate(
        [(rows - rows.mean(axis=0)) * size for rows, size in zip(sources, sizes, strict=True)]
    )


def trigger_edge(trial: Trial) -> tuple[float, float] | None:
    """Time [s] of the first rise of the trigger through the middle of its levels, halfway between
    two samples, and the step [s] between them; None without a finite trigger that has an edge, of
    0.5 V or more."""
    if "trigger" not in trial.samples.columns:
        return None
    time, level = trial.arrays("trigger")
    if len(level) < 2 or not np.isfinite(level).all() or np.ptp(level) < 0.5:
        return None
    high = level > (level.max() + level.min()) / 2
    rises = np.flatnonzero(~high[:-1] & high[1:])
    if not len(rises):
        return None
    before, after = time[rises[0] : rises[0] + 2]
    return float(before + after) / 2, float(after - before)


@dataclass(frozen=True)
class PlatformModel:
    """What the platform's motions have in common."""

    template: PlatformTemplate | None  # the shape
    reason: str | None  # why there is none
    alignments: dict[str, Alignment]  # how each perturbed crossing follows it, by trial
    triggers: dict[str, float]  # time [s] of the trigger's edge, by trial, where it is recorded
    latency: dict[str, float] | None
    """Latency behind the trigger: `mean` [s] over crossings; `used`, whether errors and sampling
    explain its scatter, so that the trigger tells the onset; `finer`, whether better than the
    shape. None below three, or without shape."""
    # the shape without each of up to ten groups of crossings
    leave_out: tuple[PlatformTemplate, ...] = ()

    def onset(self, trial: str, own: float) -> float:
        """Onset [s] of a trial's perturbation. By the trigger, if its latency is constant, and if
        it is finer than the shape or the trial does not follow the shape; else by the shape; else
        `own` [s], from the trial alone."""
        a, late = self.followed(trial), self.latency
        if late and late["used"] and trial in self.triggers and (not a or late["finer"]):
            return self.triggers[trial] + late["mean"]
        return a.start if a else own

    def followed(self, trial: str) -> Alignment | None:
        """How a trial follows the shape; None if it does not."""
        a = self.alignments.get(trial)
        return a if self.template is not None and a is not None and a.follows else None


# No shared motion of the platform
ALONE = PlatformModel(None, "each crossing is analysed alone", {}, {}, None)


def moved_cluster(statics: Sequence[StaticCalibration], settings: CrossingSettings) -> str | None:
    """Why motions with these static trials cannot be compared: their platform markers are placed
    differently, and a motion's coordinates depend on that. None if all clusters are the same."""
    labels, limit = settings.markers.platform, settings.largest_residual_mm
    clusters = [static.positions(labels, "static") for static in statics]
    local = [cluster - cluster.mean(axis=0) for cluster in clusters]
    apart = max(
        (1e3 * float(np.sqrt(np.mean(np.sum((p - local[0]) ** 2, axis=1)))) for p in local),
        default=0.0,
    )
    if apart <= limit:
        return None
    return (
        f"the platform markers {', '.join(labels)} stand {apart:.0f} mm (RMS) otherwise in one"
        f" static trial than in another, expected {limit:g} mm or less; leave them in place between"
        " sessions, or analyse sessions apart"
    )


def trigger_latency(
    alignments: Sequence[Alignment], edges: Mapping[str, tuple[float, float]]
) -> dict[str, float] | None:
    """The latency of `PlatformModel`, from crossings that follow the shape and the edges of their
    triggers: time [s] and sampling step [s] of each."""
    both = [(a.start - edges[a.name][0], a.start_se) for a in alignments if a.name in edges]
    if len(both) < 3:
        return None
    late, errors = np.array(both).T
    resolution, of_shape = (
        max(step for _, step in edges.values()) / np.sqrt(12),
        float(np.mean(errors**2)),
    )
    scatter = np.sum((late - late.mean()) ** 2) / (of_shape + resolution**2)
    constant, finer = (
        scatter < scipy.special.chdtri(len(late) - 1, IMPROBABLE),
        resolution < np.sqrt(of_shape),
    )
    return {"mean": float(late.mean()), "used": float(constant), "finer": float(finer)}


def turning_track(
    trial: Trial, static: StaticCalibration, settings: CrossingSettings
) -> PlatformTrack:
    """The track of a crossing about its largest motion; refused if the platform does not move."""
    time, poses = bodies.segment_poses(trial, settings.markers.platform, static, settings)
    turned, threshold = moved_from_rest(poses, settings)
    turned, shifts = np.nan_to_num(turned), settings.perturbed_by == "belt"
    if not len(turned) or turned.max() < threshold:
        least = (
            f"shift by {1e3 * threshold:g} mm"
            if shifts
            else f"turn by {settings.perturbation_deg:g} deg"
        )
        raise InputError(f"the platform does not {least}")
    return track_about(trial.name, time, poses, static, settings, float(time[np.argmax(turned)]))


def identify_platform(
    pairs: Sequence[tuple[Trial, StaticCalibration]], settings: CrossingSettings
) -> PlatformModel:
    """The shape that the platform's motions share in perturbed crossings, each with its
    calibration. A crossing whose platform is hidden, or does not turn by `perturbation_deg`, has no
    part; its analysis says so."""
    labels = settings.markers.platform
    if not labels:
        return replace(ALONE, reason="the plate rests: markers.platform is empty")
    if moved := moved_cluster([static for _, static in pairs], settings):
        warnings.warn(f"each crossing keeps its own motion of the platform: {moved}", stacklevel=2)
        return replace(ALONE, reason=moved)
    tracks = []
    for trial, static in pairs:
        try:
            tracks.append(turning_track(trial, static, settings))
        except InputError as error:
            warnings.warn(
                f"trial {trial.name}: has no part in the platform's shared motion: {error}",
                stacklevel=2,
            )
    try:
        template, alignments = platform_template(tracks, settings.window_s)
    except InputError as error:
        return replace(ALONE, reason=str(error))
    for a in alignments:
        if not a.follows:
            warnings.warn(
                f"trial {a.name}: the platform does not move as in the other crossings (misfit"
                f" {a.misfit:.1f} times that of marker noise): its own motion is used, which has"
                " more noise",
                stacklevel=2,
            )
    edges = {trial.name: edge for trial, _ in pairs if (edge := trigger_edge(trial)) is not None}
    known = [(track, a) for track, a in zip(tracks, alignments, strict=True) if a.follows]
    latency = trigger_latency([a for _, a in known], edges)
    groups, ends = min(len(known), 10), (float(template.time[0]), float(template.time[-1]))
    without = []
    for group in range(groups):
        kept = [pair for index, pair in enumerate(known) if index % groups != group]
        shape = mean_shape(kept, template.axes, ends, template.noise, False, unit=False)
        without.append(replace(template, time=shape.time, shape=shape.shape))
    triggers = {name: edge for name, (edge, _) in edges.items()}
    return PlatformModel(
        template, None, {a.name: a for a in alignments}, triggers, latency, tuple(without)
    )


def inertial_motion(
    track: PlatformTrack,
    centre: Array,
    template: PlatformTemplate | None,
    follows: Alignment | None,
    rows: slice,
) -> BodyMotion:
    """Motion in `rows` of the plate's centre, which rests at `centre` (3,) [m], without
    accelerations at rest. It is the shape's if the crossing `follows` it, until the shape ends;
    else as measured, along its own directions."""
    if template is None or follows is None:
        motion, weights = track.own_motion(shared_directions([track])[0], centre, rows)
        return motion.weighted(weights)
    since, fade = (track.time - follows.start) / follows.duration, 0.025  # [s]
    end = float(template.time[-1]) - fade
    curve, across = template.curve(track.time, follows), template.axes.T @ template.axes
    later = np.clip((since - end) / fade, 0, 1)[:, None]
    along = (1 - later) * (follows.offset + curve) @ template.axes + later * (
        track.measured @ across
    )
    motion = track.motion_of(track.rest - track.rest @ across + along, centre, rows)
    noise = track.noise / float(np.sqrt(template.crossings))  # of a mean
    mean = replace(track, measured=curve, noise=noise)
    moves = np.where(since < end, mean.moves(np.eye(curve.shape[1])), track.moving)
    return motion.weighted(track.gate(moves)[rows])


def platform_table(model: PlatformModel) -> pl.DataFrame:
    """`platform.csv`: one row per perturbed crossing whose platform was seen; none without a
    shape."""
    rows, late = [], model.latency
    for a, shape in ((a, model.template) for a in model.alignments.values() if model.template):
        follows = (a.amplitude, a.duration, a.misfit, int(a.follows))
        latency = (late["mean"], int(late["used"])) if late else (None, 0)
        onset = (model.onset(a.name, a.start), shape.start_shape)
        rows.append((a.name, *onset, *follows, model.triggers.get(a.name), *latency))
    numbers = (
        "onset_s",
        "onset_shape_s",
        "amplitude",
        "duration",
        "misfit",
        "follows",
        "trigger_s",
        "latency_s",
    )
    counts = dict.fromkeys(("follows", "trigger_used"), pl.Int64)
    schema = {"trial": pl.String, **dict.fromkeys(numbers, pl.Float64), **counts}
    return pl.DataFrame(rows, schema=schema, orient="row")
