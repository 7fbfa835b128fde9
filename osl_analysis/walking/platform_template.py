"""The course that the platform's motions share: one shape for all crossings, with a start and an amplitude for each.

A platform repeats its command. The motion measured in one crossing has the noise of its markers, whose accelerations
shake a heavy plate by more than a newton metre; the mean over crossings has little of it, and shows when each of them
started to a fraction of a millisecond. A crossing that does not follow the shape keeps its own motion.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy.special import chdtri

from osl_analysis.errors import InputError
from osl_analysis.trial import Array
from osl_analysis.walking.platform_motion import PlatformTrack
from osl_analysis.walking.platform_rank import directions
from osl_analysis.walking.platform_shape import (
    LEAD_S,
    ROUNDS,
    Alignment,
    PlatformTemplate,
    aligned,
    mean_shape,
    moved_start,
)
from osl_analysis.walking.rise import start_of_rise

CHANCE = 1e-3
"""The duration of the motion is free where noise alone would scatter it as much with this probability only."""
FEWEST = 2
"""Fewest crossings whose mean is a shape."""


def platform_template(tracks: Sequence[PlatformTrack], window: float) -> tuple[PlatformTemplate, list[Alignment]]:
    """The shape of the motions in two or more crossings, and how each follows it.

    The shape ends 50 ms after a `window` [s] that begins in the middle of its rise. Its zero of time is its own start
    (`start_of_rise`). A crossing that does not follow it has no part in it.

    Raises
    ------
    InputError
        Fewer than two crossings follow one shape.
    """
    if len(tracks) < FEWEST:
        raise InputError(f"{len(tracks)} motions of the platform, expected {FEWEST} or more to find what they share")
    ends = -LEAD_S, window + 0.05
    axes = common_directions(tracks, ends)
    noise = float(np.sqrt(np.mean([track.noise**2 for track in tracks])))
    alignments = [first_alignment(track, axes) for track in tracks]
    template, alignments = alternated(tracks, alignments, axes, ends, noise, False)
    free = [aligned(track, a, template, True) for track, a in zip(tracks, alignments, strict=True)]
    scatter = np.array([(a.duration - 1) / a.duration_se for a in free])
    if np.sum((scatter - scatter.mean()) ** 2) > chdtri(len(tracks) - 1, CHANCE):
        template, alignments = alternated(tracks, free, axes, ends, noise, True)
    for _ in range(len(tracks)):
        following = [a.follows for a in alignments]
        if all(following) or sum(following) < FEWEST:
            break
        kept = [t for t, used in zip(tracks, following, strict=True) if used]
        known = [a for a in alignments if a.follows]
        template, _ = alternated(kept, known, axes, ends, noise, template.scaled)
        alignments = [aligned(track, a, template, template.scaled) for track, a in zip(tracks, alignments, strict=True)]
        if [a.follows for a in alignments] == following:
            break
    if sum(a.follows for a in alignments) < FEWEST:
        raise InputError("the platform moves in another way in each crossing, so that each keeps its own motion")
    rise = start_of_rise(template.time, template.shape, template.grid_noise(tracks[0].rate))
    begun = [moved_start(a, rise.time) for a in alignments]
    return replace(template, time=template.time - rise.time, start_se=rise.se, start_shape=rise.shape), begun


def alternated(
    tracks: Sequence[PlatformTrack],
    alignments: Sequence[Alignment],
    axes: Array,
    ends: tuple[float, float],
    noise: float,
    scaled: bool,
) -> tuple[PlatformTemplate, list[Alignment]]:
    """Shape and alignments in turn, until both stand."""
    found = list(alignments)
    for _ in range(ROUNDS):
        template = mean_shape(tracks, found, axes, ends, noise, scaled)
        found = [aligned(track, a, template, scaled) for track, a in zip(tracks, found, strict=True)]
    return template, found


def middle_of_rise(track: PlatformTrack) -> tuple[float, float]:
    """Time [s] at which the largest displacement from rest is half reached, and that displacement [m]."""
    moved = np.linalg.norm(track.filtered - track.rest, axis=1)
    top = float(moved.max())
    row = int(np.argmax(moved > top / 2))
    share = (top / 2 - moved[row - 1]) / (moved[row] - moved[row - 1]) if row else 1.0
    return float(track.time[max(row - 1, 0)] + share * (track.time[1] - track.time[0])), top


def common_directions(tracks: Sequence[PlatformTrack], ends: tuple[float, float]) -> Array:
    """Directions (r, 6) of the motions about the middle of their rise. Where each rests is not a direction."""
    moved = []
    for track in tracks:
        since = track.time - middle_of_rise(track)[0]
        near = track.filtered[(since >= ends[0]) & (since <= ends[1])]
        moved.append(near - near.mean(axis=0))
    noise = float(np.sqrt(np.mean([track.noise**2 for track in tracks])))
    return directions(moved, noise, tracks[0].low_pass, tracks[0].rate)


def first_alignment(track: PlatformTrack, axes: Array) -> Alignment:
    """A motion by the middle of its rise, with the sign of its largest displacement along the first direction."""
    middle, _ = middle_of_rise(track)
    moved = (track.filtered - track.rest) @ axes.T
    size = float(moved[np.argmax(np.abs(moved[:, 0])), 0])
    return Alignment(track.name, middle, 0.0, size, 1.0, 0.0, 0.0, track.rest @ axes.T, 0.0, True)
