"""The error of the platform's shared shape: a jackknife over groups of crossings, beside that over the plate trials."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from osl_analysis.trial import Array
from osl_analysis.walking.platform_motion import PlatformTrack
from osl_analysis.walking.platform_shape import Alignment, PlatformTemplate, mean_shape

GROUPS = 10
"""Largest number of groups of crossings that are left out in turn, for the jackknife of the shape."""


def without_groups(
    tracks: Sequence[PlatformTrack], alignments: Sequence[Alignment], template: PlatformTemplate
) -> tuple[PlatformTemplate, ...]:
    """The shape without each of up to `GROUPS` groups of the crossings that follow it."""
    pairs = [(t, a) for t, a in zip(tracks, alignments, strict=True) if a.follows]
    groups = min(len(pairs), GROUPS)
    ends, found = (float(template.time[0]), float(template.time[-1])), []
    for group in range(groups):
        kept = [pair for index, pair in enumerate(pairs) if index % groups != group]
        shape = mean_shape([t for t, _ in kept], [a for _, a in kept], template.axes, ends, template.noise, False)
        size = float(np.mean([abs(a.amplitude) for _, a in kept]))
        duration = float(np.exp(np.mean([np.log(a.duration) for _, a in kept])))
        found.append(replace(template, time=shape.time / duration, shape=shape.shape / size))
    return tuple(found)


def jackknife_rows(plate: Sequence[Array], platform: Sequence[Array]) -> Array:
    """Rows (m, n) [N*m] whose jackknife has the sum of the variances of two independent sources.

    `plate` are the changes without each plate trial, `platform` those without each group of crossings in the shape of
    the platform's motion. The jackknife's variance of k rows is (k - 1)/k times their sum of squares about the mean.
    """
    if not len(platform):
        return np.array(plate)
    sources = [np.array(rows) for rows in (plate, platform) if len(rows) > 1]
    total = sum(len(rows) for rows in sources)
    scaled = [
        (rows - rows.mean(axis=0)) * np.sqrt((len(rows) - 1) / len(rows) * total / (total - 1)) for rows in sources
    ]
    return np.concatenate(scaled) if scaled else np.array(plate)
