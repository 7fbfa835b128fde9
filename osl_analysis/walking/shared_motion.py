"""Step 2b, platform: what its motions in all perturbed crossings share, which gives the onsets.

A platform repeats its command. Marker noise in one crossing reads as more than 1 N*m of inertial
moment of a heavy plate. The mean over crossings, the *shape*, has little noise, and gives each
start to a fraction of a millisecond. Coordinates are those of `PlatformTrack`.
"""

import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
import polars as pl
import scipy

from osl_analysis.errors import InputError
from osl_analysis.trial import Array, Trial
from osl_analysis.walking.platform import (
    PlatformTrack,
    directions,
    noise_gain,
    perturbing_track,
    shared_directions,
)
from osl_analysis.walking.poses import BodyMotion, Mask, StaticCalibration, StoredArray
from osl_analysis.walking.walking_settings import CrossingSettings

LEAD_S = 0.15  # from the begin of the shape to the middle of its rise
TAIL_S = 0.05  # from the end of the window after the middle of the rise to the end of the shape
GRID_S = 0.002  # step of the stored shape
KNOTS_S = 0.01  # step of the spline's knots: 50 Hz, beyond the low-pass of the analysis
ROUNDS = 6  # of shape and alignment in turn; four reduce an error of 5 ms in the start to 1e-5 s
LARGEST_START_STEP_S = 0.02  # by which one round may change a start
DURATION_BOUNDS = (0.5, 2.0)
IMPROBABLE = 1e-3  # p-value below which scatter is not noise: of durations, of a latency
MISFIT_SDS = 4.0  # above the mean square of noise, up to which a crossing follows the shape
FADE_S = 0.025  # in which the shape gives way to the measured motion, at its end
MOST_GROUPS = 10  # of crossings that are left out of the shape, one at a time

SHARE_OF_RISE = 0.3  # of the duration of a smooth step: from 10 to 50 % of its height
SHORT_RISE_S = 0.05  # first guess of the duration where one frame holds the rise
RISE_SHARE = 0.7  # of the rise that the step is fitted to; the end may overshoot
USUAL_STEP = 3  # minimum jerk
FAR_MORE_LIKELY = 30.0  # decrease of chi-square for which another step replaces the usual one
FITS_AS_WELL = 9.0  # increase of chi-square; by noise, one step of 400 is further

FEWEST_EDGES = 3  # of a trigger, for a latency
SMALLEST_TRIGGER = 0.5  # [V] between the levels of a trigger


@dataclass(frozen=True)
class Alignment:
    """How one crossing follows the shape."""

    name: str
    start: float  # when the motion starts [s]
    amplitude: float  # size of the motion, 1 on average, negative in the other direction
    offset: StoredArray  # coordinates (r,) [m] at rest
    # Time scale of the motion, 1 on average; 1 for all if durations do not scatter
    duration: float = 1.0
    start_se: float = 0.0  # standard error [s] of the start by this crossing's marker noise
    duration_se: float = 0.0
    # Mean square of the filtered difference between motion and shape, over that of noise
    misfit: float = 0.0
    follows: bool = True  # whether noise explains the misfit

    def since_start(self, time: Array) -> Array:
        """Times [s] on the time scale of the shape."""
        return (time - self.start) / self.duration


@dataclass(frozen=True)
class PlatformTemplate:
    """The shape that motions of the platform share."""

    axes: StoredArray  # directions (r, 6) of the motion, as in `PlatformTrack`
    time: StoredArray  # grid (g,) [s] from the start of the motion
    shape: StoredArray  # coordinates (g, r) [m] from rest, of a motion of amplitude 1
    noise: float  # standard deviation [m] of the noise in one frame of a crossing
    crossings: int  # number of crossings whose mean the shape is
    scaled: bool  # whether the duration of the motion differs between crossings
    start_shape: float = 0.0  # largest change [s] of the start by another step that fits as well

    @cached_property
    def spline(self) -> "scipy.interpolate.BSpline":
        return scipy.interpolate.make_interp_spline(self.time, self.shape, k=5)

    def covers(self, since_start: Array) -> Mask:
        """Which times [s] from the start are on the grid."""
        return np.asarray((since_start >= self.time[0]) & (since_start <= self.time[-1]))

    def curve(self, time: Array, alignment: Alignment) -> Array:
        """Coordinates (n, r) [m] from rest of a crossing that follows the shape, at times [s].

        They are constant beyond the shape.
        """
        since = np.clip(alignment.since_start(time), self.time[0], self.time[-1])
        return np.asarray(alignment.amplitude * self.spline(since))


@dataclass(frozen=True)
class TriggerLatency:
    """Time from a recorded trigger to the start of the motion."""

    mean: float  # over crossings [s]
    used: bool  # whether errors and sampling explain its scatter: then the trigger tells the onset
    finer: bool  # whether the trigger is sampled more finely than the shape tells a start


@dataclass(frozen=True)
class PlatformModel:
    """What the platform's motions have in common."""

    template: PlatformTemplate | None  # the shape
    reason: str | None  # why there is none
    alignments: dict[str, Alignment]  # how each perturbed crossing follows it, by trial
    triggers: dict[str, float]  # time [s] of the trigger's edge, by trial, where it is recorded
    latency: TriggerLatency | None  # None below three triggers, or without shape
    # The shape without each of up to ten groups of crossings
    leave_out: tuple[PlatformTemplate, ...] = ()

    def onset(self, trial: str, without_model: float) -> float:
        """Onset [s] of a trial's perturbation.

        By the trigger, if its latency is constant, and if it is finer than the shape or the trial
        does not follow the shape; else by the shape; else `without_model` [s], from the trial
        alone.
        """
        alignment = self.followed(trial)
        latency = self.latency
        is_triggered = latency is not None and latency.used and trial in self.triggers
        if latency is not None and is_triggered and (alignment is None or latency.finer):
            return self.triggers[trial] + latency.mean
        return without_model if alignment is None else alignment.start

    def followed(self, trial: str) -> Alignment | None:
        """How a trial follows the shape; None if it does not."""
        alignment = self.alignments.get(trial)
        if self.template is None or alignment is None or not alignment.follows:
            return None
        return alignment


def without_shape(reason: str) -> PlatformModel:
    return PlatformModel(None, reason, alignments={}, triggers={}, latency=None)


NO_SHARED_MOTION = without_shape("each crossing is analysed alone")

Pairs = Sequence[tuple[PlatformTrack, Alignment]]


def identify_platform(
    pairs: Sequence[tuple[Trial, StaticCalibration]], settings: CrossingSettings
) -> PlatformModel:
    """Find the shape that the platform's motions share in perturbed crossings.

    A crossing whose platform is hidden, or does not move enough, has no part; a warning says so.
    """
    if not settings.markers.platform:
        return without_shape("the plate rests: markers.platform is empty")
    difference = different_clusters([static for _, static in pairs], settings)
    if difference is not None:
        warnings.warn(
            f"each crossing keeps its own motion of the platform: {difference}", stacklevel=2
        )
        return without_shape(difference)

    tracks = []
    for trial, static in pairs:
        try:
            tracks.append(perturbing_track(trial, static, settings))
        except InputError as error:
            warnings.warn(
                f"trial {trial.name}: has no part in the platform's shared motion: {error}",
                stacklevel=2,
            )
    try:
        template, alignments = platform_template(tracks, settings.window_s)
    except InputError as error:
        return without_shape(str(error))
    for alignment in alignments:
        if not alignment.follows:
            warnings.warn(
                f"trial {alignment.name}: the platform does not move as in the other crossings"
                f" (misfit {alignment.misfit:.1f} times that of marker noise): its own motion is"
                " used, which has more noise",
                stacklevel=2,
            )

    edges = {}
    for trial, _ in pairs:
        edge = trigger_edge(trial)
        if edge is not None:
            edges[trial.name] = edge
    following = [
        (track, alignment)
        for track, alignment in zip(tracks, alignments, strict=True)
        if alignment.follows
    ]
    return PlatformModel(
        template,
        reason=None,
        alignments={alignment.name: alignment for alignment in alignments},
        triggers={name: edge.time for name, edge in edges.items()},
        latency=trigger_latency([alignment for _, alignment in following], edges),
        leave_out=shapes_without_groups(following, template),
    )


def different_clusters(
    statics: Sequence[StaticCalibration], settings: CrossingSettings
) -> str | None:
    """Say why motions with these static trials cannot be compared; None if they can.

    A motion's coordinates depend on where the platform's markers are placed.
    """
    labels = settings.markers.platform
    limit = settings.largest_residual_mm
    clusters = [static.positions(labels, "static") for static in statics]
    local = [cluster - cluster.mean(axis=0) for cluster in clusters]
    distances_mm = [
        1e3 * float(np.sqrt(np.mean(np.sum((cluster - local[0]) ** 2, axis=1))))
        for cluster in local
    ]
    largest_mm = max(distances_mm, default=0.0)
    if largest_mm <= limit:
        return None
    return (
        f"the platform markers {', '.join(labels)} stand {largest_mm:.0f} mm (RMS) otherwise in one"
        f" static trial than in another, expected {limit:g} mm or less; leave them in place between"
        " sessions, or analyse sessions apart"
    )


def shapes_without_groups(
    following: Pairs, template: PlatformTemplate
) -> tuple[PlatformTemplate, ...]:
    """The shape without each group of crossings, for a jackknife."""
    basis = ShapeBasis(
        template.axes, float(template.time[0]), float(template.time[-1]), template.noise
    )
    groups = min(len(following), MOST_GROUPS)
    shapes = []
    for group in range(groups):
        remaining = [pair for index, pair in enumerate(following) if index % groups != group]
        shape = mean_shape(remaining, basis, scaled=False, normalised=False)
        shapes.append(replace(template, time=shape.time, shape=shape.shape))
    return tuple(shapes)


@dataclass(frozen=True)
class ShapeBasis:
    """What every round of the shape has in common."""

    axes: Array  # directions (r, 6)
    begin: float  # of the shape [s], from the start of the motion
    end: float  # [s]
    noise: float  # standard deviation [m] of the noise in one frame


def platform_template(
    tracks: Sequence[PlatformTrack], window: float
) -> tuple[PlatformTemplate, list[Alignment]]:
    """Find the shape of the motions in two or more crossings, and how each follows it.

    Shape and alignments are fitted in turn. Durations are free only if they scatter beyond noise.
    Crossings that do not follow the shape are left out of it.

    Parameters
    ----------
    tracks : sequence of PlatformTrack
        The motions.
    window : float
        Time [s] from the middle of the rise, which the shape covers.

    Returns
    -------
    tuple of PlatformTemplate and list of Alignment
        Time 0 of the shape is the start of the motion.

    Raises
    ------
    InputError
        Fewer than two motions, or than two that have a shape in common.
    """
    if len(tracks) < 2:
        raise InputError(
            f"{len(tracks)} motions of the platform, expected 2 or more to find what they share"
        )
    basis, guesses = first_guesses(tracks, begin=-LEAD_S, end=window + TAIL_S)

    template, alignments = alternated(list(zip(tracks, guesses, strict=True)), basis, scaled=False)
    with_duration = aligned(tracks, alignments, template, scaled=True)
    if durations_scatter(with_duration):
        pairs = list(zip(tracks, with_duration, strict=True))
        template, alignments = alternated(pairs, basis, scaled=True)

    # Crossings that do not follow are left out, until the same ones follow again
    for _ in range(len(tracks)):
        following = [alignment.follows for alignment in alignments]
        if all(following) or sum(following) < 2:
            break
        pairs = [
            (track, alignment)
            for track, alignment in zip(tracks, alignments, strict=True)
            if alignment.follows
        ]
        template, _ = alternated(pairs, basis, template.scaled)
        alignments = aligned(tracks, alignments, template, template.scaled)
        if [alignment.follows for alignment in alignments] == following:
            break
    if sum(alignment.follows for alignment in alignments) < 2:
        raise InputError(
            "the platform moves in another way in each crossing, so that each keeps its own motion"
        )

    # Time 0 moves to the start of the rise. The noise is that of each sample of the shape, as if it
    # were independent of the others.
    noise = float(template.noise / np.sqrt(template.crossings * tracks[0].rate * GRID_S))
    rise = start_of_rise(template.time, template.shape, noise)
    template = replace(
        template, time=template.time - rise.start, start_shape=rise.change_by_other_steps
    )
    moved = [
        replace(alignment, start=alignment.start + rise.start * alignment.duration)
        for alignment in alignments
    ]
    # Fitted again: if durations are uncertain, the error of a start depends on the point of the
    # shape that it is
    return template, aligned(tracks, moved, template, template.scaled)


def first_guesses(
    tracks: Sequence[PlatformTrack], begin: float, end: float
) -> tuple[ShapeBasis, list[Alignment]]:
    """The directions of the motions about the middles of their rises, and a first alignment."""
    middles = [middle_of_rise(track) for track in tracks]
    motions = []
    for track, middle in zip(tracks, middles, strict=True):
        since = track.time - middle
        near = track.filtered[(since >= begin) & (since <= end)]
        motions.append(near - near.mean(axis=0))  # where each rests is not a direction
    noise = float(np.sqrt(np.mean([track.noise**2 for track in tracks])))
    axes = directions(motions, noise, tracks[0].low_pass, tracks[0].rate)

    guesses = []
    for track, middle in zip(tracks, middles, strict=True):
        along = (track.filtered - track.rest) @ axes.T
        amplitude = float(along[np.argmax(np.abs(along[:, 0])), 0])  # with its sign
        guesses.append(Alignment(track.name, middle, amplitude, track.rest @ axes.T))
    return ShapeBasis(axes, begin, end, noise), guesses


def middle_of_rise(track: PlatformTrack) -> float:
    """Time [s] at which half of the largest displacement from rest is reached."""
    size = np.linalg.norm(track.filtered - track.rest, axis=1)
    half = float(size.max() / 2)
    row = int(np.argmax(size > half))
    share = float((half - size[row - 1]) / (size[row] - size[row - 1])) if row else 1.0
    return float(track.time[max(row - 1, 0)] + share * (track.time[1] - track.time[0]))


def alternated(
    pairs: Pairs, basis: ShapeBasis, scaled: bool
) -> tuple[PlatformTemplate, list[Alignment]]:
    """Fit shape and alignments in turn."""
    for _ in range(ROUNDS):
        template = mean_shape(pairs, basis, scaled)
        pairs = [
            (track, follow_shape(track, alignment, template, scaled)) for track, alignment in pairs
        ]
    return template, [alignment for _, alignment in pairs]


def aligned(
    tracks: Sequence[PlatformTrack],
    guesses: Sequence[Alignment],
    template: PlatformTemplate,
    scaled: bool,
) -> list[Alignment]:
    """How each track follows the shape."""
    return [
        follow_shape(track, guess, template, scaled)
        for track, guess in zip(tracks, guesses, strict=True)
    ]


def durations_scatter(alignments: Sequence[Alignment]) -> bool:
    """Whether durations differ beyond their noise, by a chi-square test."""
    scores = np.array(
        [(alignment.duration - 1) / alignment.duration_se for alignment in alignments]
    )
    limit = scipy.special.chdtri(len(alignments) - 1, IMPROBABLE)
    return bool(np.sum((scores - scores.mean()) ** 2) > limit)


def mean_shape(
    pairs: Pairs, basis: ShapeBasis, scaled: bool, normalised: bool = True
) -> PlatformTemplate:
    """Fit one spline by least squares through all aligned motions.

    Mean amplitude and duration of the crossings become 1 if `normalised`; else they stay those of
    the alignments.
    """
    mean_amplitude = 1.0
    mean_duration = 1.0
    if normalised:
        mean_amplitude = float(np.mean([abs(alignment.amplitude) for _, alignment in pairs]))
        log_durations = [np.log(alignment.duration) for _, alignment in pairs]
        mean_duration = float(np.exp(np.mean(log_durations)))

    times = []
    shapes = []
    weights = []
    for track, alignment in pairs:
        since = (track.time - alignment.start) / (alignment.duration / mean_duration)
        amplitude = alignment.amplitude / mean_amplitude
        near = (since >= basis.begin) & (since <= basis.end)
        times.append(since[near])
        shapes.append((track.measured[near] @ basis.axes.T - alignment.offset) / amplitude)
        weights.append(np.full(near.sum(), abs(amplitude)))
    all_times = np.concatenate(times)
    order = np.argsort(all_times, kind="stable")
    stamps = all_times[order]

    step = max(KNOTS_S, 1.5 / pairs[0][0].rate)
    intervals = round((basis.end - basis.begin) / step)
    inner = np.linspace(basis.begin, basis.end, intervals + 1)[1:-1]
    knots = np.r_[[stamps[0]] * 4, inner, [stamps[-1]] * 4]
    spline = scipy.interpolate.make_lsq_spline(
        stamps, np.concatenate(shapes)[order], knots, k=3, w=np.concatenate(weights)[order]
    )
    grid = np.arange(np.ceil(stamps[0] / GRID_S), np.floor(stamps[-1] / GRID_S) + 1) * GRID_S
    shape = spline(grid)
    rest_level = shape[grid <= grid[0] + LEAD_S / 4].mean(axis=0)
    return PlatformTemplate(basis.axes, grid, shape - rest_level, basis.noise, len(pairs), scaled)


def follow_shape(
    track: PlatformTrack, guess: Alignment, template: PlatformTemplate, scaled: bool
) -> Alignment:
    """Fit start, amplitude, rest and, if `scaled`, duration of a motion to a shape by Gauss-Newton.

    The model of the coordinates is offset + amplitude * shape((t - start) / duration). The motion
    follows the shape if the mean square of their filtered difference is at most four standard
    deviations above that of noise.
    """
    measured = track.measured @ template.axes.T  # (n, r)
    r = measured.shape[1]
    alignment = guess if scaled else replace(guess, duration=1.0)

    for _ in range(ROUNDS):
        since = alignment.since_start(track.time)
        near = template.covers(since)
        shape = template.spline(since[near])
        slope = template.spline(since[near], 1)
        # an amplitude near 0 would make the start undetermined
        amplitude = alignment.amplitude if abs(alignment.amplitude) > 0.1 else 1.0
        by_start = -slope * amplitude / alignment.duration
        derivatives = [shape, by_start]
        if scaled:
            derivatives.append(-slope * since[near, None] * amplitude / alignment.duration)
        columns = np.stack([derivative.T.ravel() for derivative in derivatives], axis=1)
        design = np.hstack([columns, np.repeat(np.eye(r), near.sum(), axis=0)])
        unexplained = (measured[near] - amplitude * shape).T.ravel()
        change = np.asarray(np.linalg.lstsq(design, unexplained)[0], float)

        duration = alignment.duration + (change[2] if scaled else 0.0)
        start_step = np.clip(change[1], -LARGEST_START_STEP_S, LARGEST_START_STEP_S)
        alignment = replace(
            alignment,
            amplitude=amplitude + float(change[0]),
            start=alignment.start + float(start_step),
            duration=float(np.clip(duration, *DURATION_BOUNDS)),
            offset=change[-r:],
        )
    errors = template.noise * np.sqrt(np.diag(np.linalg.inv(design.T @ design)))

    since = alignment.since_start(track.time)
    near = template.covers(since)
    from_rest = measured - alignment.offset
    difference = np.where(near[:, None], from_rest - template.curve(track.time, alignment), 0.0)
    # The low-pass spreads the end of the shape
    inside = near & (since <= template.time[-1] - 2 * track.spread)
    filtered = track.low_pass(difference, track.rate)[inside]
    gain = noise_gain(track.low_pass, track.rate)
    before = filtered[since[inside] < template.time[0] + LEAD_S / 2]
    before_square = float(np.mean(before**2)) if before.size else 0.0
    noise_square = max(template.noise**2 * gain, before_square)
    misfit = float(np.mean(filtered**2)) / noise_square
    independent_samples = max(filtered.size * gain, 1.0)
    return replace(
        alignment,
        start_se=float(errors[1]),
        duration_se=float(errors[2]) if scaled else 0.0,
        misfit=misfit,
        follows=bool(misfit < 1 + MISFIT_SDS * np.sqrt(2 / independent_samples)),
    )


@dataclass(frozen=True)
class RiseStart:
    """Where a rise starts [s], and its largest change [s] by another step that fits as well."""

    start: float
    change_by_other_steps: float


def start_of_rise(time: Array, coordinates: Array, noise: float) -> RiseStart:
    """Find the start of a mean motion, from a smooth step fitted to 0.7 of its rise.

    Steps are the incomplete beta functions I(x; p, p): a straight ramp for p = 1, a cubic for 2,
    minimum jerk for 3, degree seven for 4. Minimum jerk is taken unless another is far more likely.
    Starts of two steps that fit equally well differ by 6 to 10 % of the rise: a smaller margin
    would scatter the onset by several ms.

    Parameters
    ----------
    time, coordinates : Array
        (n,) [s], and (n, r) [m] from rest.
    noise : float
        Of each sample [m].
    """
    size = np.linalg.norm(coordinates, axis=1)
    largest = int(np.argmax(size))
    moved = coordinates @ coordinates[largest] / size[largest]  # along the largest displacement
    height = float(moved[moved > 0.95 * moved[largest]].mean())

    # A first guess from the part of the rise between 10 and 50 % of it
    half = int(np.argmax(moved >= height / 2))
    tenth = int(np.flatnonzero(np.r_[True, moved[1:half] < height / 10])[-1])
    duration = float(time[half] - time[tenth]) / SHARE_OF_RISE
    if duration == 0.0:
        duration = SHORT_RISE_S
    guess = np.array([time[half] - duration / 2, duration, 0.0])  # start, duration, level

    end = int(np.argmax(moved >= RISE_SHARE * height)) + 1

    def residuals(step: Array, p: int) -> Array:
        """Over noise, so that `cost` is half of chi-square."""
        start, duration, level = step
        x = np.clip((time[:end] - start) / duration, 0, 1)
        expected = scipy.special.betainc(p, p, x) + level
        return np.asarray((expected - moved[:end] / height) / (noise / height))

    least_squares: Any = scipy.optimize.least_squares
    fits: dict[int, Any] = {
        p: least_squares(
            residuals, guess, args=(p,), x_scale=[0.01, 0.05, 0.01], diff_step=[1e-4, 1e-4, 1e-4]
        )
        for p in (USUAL_STEP, 1, 2, 4)
    }
    best = min(fits, key=lambda p: fits[p].cost)
    is_certain = 2 * (fits[USUAL_STEP].cost - fits[best].cost) > FAR_MORE_LIKELY
    start = float(fits[best if is_certain else USUAL_STEP].x[0])
    changes = [
        abs(float(fit.x[0] - start))
        for fit in fits.values()
        if 2 * (fit.cost - fits[best].cost) < FITS_AS_WELL
    ]
    return RiseStart(start, max(changes, default=0.0))


@dataclass(frozen=True)
class TriggerEdge:
    """The first rise of a trigger [s], halfway between two samples, and the step [s] of these."""

    time: float
    step: float


def trigger_edge(trial: Trial) -> TriggerEdge | None:
    """Find the first rise of the trigger through the middle of its levels; None without one."""
    if "trigger" not in trial.samples.columns:
        return None
    time, level = trial.arrays("trigger")
    if len(level) < 2 or not np.isfinite(level).all() or np.ptp(level) < SMALLEST_TRIGGER:
        return None
    high = level > (level.max() + level.min()) / 2
    rises = np.flatnonzero(~high[:-1] & high[1:])
    if not len(rises):
        return None
    before, after = time[rises[0] : rises[0] + 2]
    return TriggerEdge(float(before + after) / 2, float(after - before))


def trigger_latency(
    alignments: Sequence[Alignment], edges: Mapping[str, TriggerEdge]
) -> TriggerLatency | None:
    """Compare the starts of crossings that follow the shape with the edges of their triggers.

    The latency is constant if a chi-square test finds no more scatter than starts and sampling
    explain.
    """
    triggered = [alignment for alignment in alignments if alignment.name in edges]
    if len(triggered) < FEWEST_EDGES:
        return None
    latencies = np.array([alignment.start - edges[alignment.name].time for alignment in triggered])
    start_variance = float(np.mean(np.array([alignment.start_se for alignment in triggered]) ** 2))
    resolution = max(edge.step for edge in edges.values()) / np.sqrt(12)
    scatter = np.sum((latencies - latencies.mean()) ** 2) / (start_variance + resolution**2)
    return TriggerLatency(
        mean=float(latencies.mean()),
        used=bool(scatter < scipy.special.chdtri(len(latencies) - 1, IMPROBABLE)),
        finer=bool(resolution < np.sqrt(start_variance)),
    )


def inertial_motion(
    track: PlatformTrack,
    centre: Array,
    template: PlatformTemplate | None,
    alignment: Alignment | None,
    rows: slice,
) -> BodyMotion:
    """Motion of the plate's centre in one crossing, without accelerations at rest.

    It is the shape's if the crossing follows it, until the shape ends; else it is as measured,
    along the crossing's own directions.

    Parameters
    ----------
    track : PlatformTrack
        Of the crossing, n frames.
    centre : Array
        Where the plate's centre rests (3,) [m].
    template, alignment
        The shape, and how the crossing follows it; None if it does not.
    rows : slice
        Frames of the result.
    """
    if template is None or alignment is None:
        axes = shared_directions([track])[0]
        motion, weights = track.measured_motion(axes, centre, rows)
        return motion.weighted(weights)

    since = alignment.since_start(track.time)
    end = float(template.time[-1]) - FADE_S
    curve = template.curve(track.time, alignment)
    projection = template.axes.T @ template.axes
    ended = np.clip((since - end) / FADE_S, 0, 1)[:, None]
    by_shape = (1 - ended) * (alignment.offset + curve) @ template.axes
    by_markers = ended * (track.measured @ projection)
    at_rest = track.rest - track.rest @ projection  # across the directions of the shape
    motion = track.motion_of(at_rest + (by_shape + by_markers), centre, rows)

    noise_of_mean = track.noise / float(np.sqrt(template.crossings))
    shape_track = replace(track, measured=curve, noise=noise_of_mean)
    moves = np.where(since < end, shape_track.moves(np.eye(curve.shape[1])), track.moving)
    return motion.weighted(track.gate(moves)[rows])


def jackknife_rows(by_trials: Sequence[Array], by_crossings: Sequence[Array]) -> Array:
    """Join two jackknives of a torque into one.

    The jackknife variance of k rows is (k - 1)/k times the sum of their squares about their mean.
    That of the result is the sum of both.

    Parameters
    ----------
    by_trials, by_crossings : sequence of Array
        Changes (n,) [N*m] without each plate trial, and without each group of crossings in the
        shape.
    """
    sources = [np.array(rows) for rows in (by_trials, by_crossings) if len(rows) > 1]
    if not len(by_crossings) or not sources:
        return np.array(by_trials)
    total = sum(len(rows) for rows in sources)
    scaled = []
    for rows in sources:
        factor = np.sqrt((1 - 1 / len(rows)) * total / (total - 1))
        scaled.append((rows - rows.mean(axis=0)) * factor)
    return np.concatenate(scaled)


def platform_table(model: PlatformModel) -> pl.DataFrame:
    """Tabulate `platform.csv`: a row per perturbed crossing whose platform was seen.

    It is empty without a shape.
    """
    schema = {
        "trial": pl.String,
        "onset_s": pl.Float64,
        "onset_shape_s": pl.Float64,
        "amplitude": pl.Float64,
        "duration": pl.Float64,
        "misfit": pl.Float64,
        "follows": pl.Int64,
        "trigger_s": pl.Float64,
        "latency_s": pl.Float64,
        "trigger_used": pl.Int64,
    }
    rows = []
    if model.template is not None:
        for name, alignment in model.alignments.items():
            rows.append(
                {
                    "trial": name,
                    "onset_s": model.onset(name, alignment.start),
                    "onset_shape_s": model.template.start_shape,
                    "amplitude": alignment.amplitude,
                    "duration": alignment.duration,
                    "misfit": alignment.misfit,
                    "follows": int(alignment.follows),
                    "trigger_s": model.triggers.get(name),
                    "latency_s": None if model.latency is None else model.latency.mean,
                    "trigger_used": 0 if model.latency is None else int(model.latency.used),
                }
            )
    return pl.DataFrame(rows, schema=schema, orient="row")
