"""Which labels of markers are exchanged, where a cluster is not rigid as it is labelled."""

from collections.abc import Iterator, Mapping, Sequence
from itertools import combinations

import numpy as np

from osl_analysis.errors import InputError
from osl_analysis.trial import Array, Trial
from osl_analysis.walking.ankle import SEGMENTS, StaticCalibration
from osl_analysis.walking.cluster import cluster_poses, marker_tracks, reference_positions
from osl_analysis.walking.settings import MarkerSettings

MOST_FRAMES = 40
"""Frames in which exchanges are tried, spread over those that are not rigid as labelled."""
FEWEST_FRAMES = 5
"""Fewest frames that are not rigid: single ones are a matter of noise, not of labels."""

Positions = dict[str, Array]
"""Positions by label: (n, 3) [m] in n frames, or (3,) [m] in the static trial."""


def exchanged_labels(
    trial: Trial, calibration: StaticCalibration, settings: MarkerSettings, segments: Sequence[str] = SEGMENTS
) -> str:
    """Which labels are exchanged, for a message; empty if clusters are rigid as labelled, or no exchange makes them so.

    Two labels of any clusters are exchanged in turn, and those of whole foot and shank in the order of the settings.
    The exchange must bring the median residual of every cluster below `largest_residual_mm`.
    """
    names = {segment: getattr(settings.markers, segment) for segment in segments}
    try:
        tracks = {label: marker_tracks(trial, [label])[1][:, 0] for labels in names.values() for label in labels}
        static = {s: dict(zip(n, reference_positions(getattr(calibration, s), n, trial.name), strict=True))
                  for s, n in names.items()}  # fmt: skip
    except InputError:
        return ""
    limit = settings.largest_residual_mm * 1e-3
    labelled = np.max([residuals(static[s], tracks) for s in names], axis=0)
    wrong = np.flatnonzero(labelled > limit)
    if len(wrong) < FEWEST_FRAMES:
        return ""
    rows = wrong[np.linspace(0, len(wrong) - 1, min(MOST_FRAMES, len(wrong))).astype(int)]
    some = {label: track[rows] for label, track in tracks.items()}
    misfits = {how: misfit(static, exchanged(some, pairs)) for how, pairs in exchanges(names)}
    best = min(misfits, key=lambda how: misfits[how])
    if not misfits[best] <= limit:
        return ""
    before, after = 1e3 * float(np.median(labelled[rows])), 1e3 * misfits[best]
    return (
        f"{best} look exchanged in {len(wrong)} frames: markers lie {before:.0f} mm from their rigid bodies as "
        f"labelled, {after:.1f} mm after the exchange; correct the labels of this trial, or of its static trial"
    )


def exchanges(names: Mapping[str, Sequence[str]]) -> Iterator[tuple[str, list[tuple[str, str]]]]:
    """The exchanges that are tried: words for a message, and pairs of labels."""
    for a, b in combinations([label for labels in names.values() for label in labels], 2):
        yield f"the labels {a} and {b}", [(a, b)]
    foot, shank = names.get("foot", ()), names.get("shank", ())
    if foot and len(foot) == len(shank):
        yield "the labels of foot and shank", list(zip(foot, shank, strict=True))


def exchanged(tracks: Positions, pairs: Sequence[tuple[str, str]]) -> Positions:
    """The tracks with the labels of each pair exchanged."""
    other = dict(pairs) | {b: a for a, b in pairs}
    return {label: tracks[other.get(label, label)] for label in tracks}


def misfit(static: Mapping[str, Positions], tracks: Positions) -> float:
    """Largest median residual [m] of the clusters."""
    return max(float(np.median(residuals(cluster, tracks))) for cluster in static.values())


def residuals(cluster: Positions, tracks: Positions) -> Array:
    """RMS distance (n,) [m] of a cluster's markers from their rigid body; 0 in frames with hidden markers."""
    observed = np.stack([tracks[label] for label in cluster], axis=1)
    return np.nan_to_num(cluster_poses(np.array(list(cluster.values())), observed).residual)
