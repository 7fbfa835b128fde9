"""One regression for each amplitude of a stepped sine and one over all of them, from one pass over the settled rows."""

from collections.abc import Callable, Mapping, Sequence

import numpy as np

from osl_analysis.bench.rounding import RepeatedRounding, RoundingSums
from osl_analysis.bench.segments import Segment
from osl_analysis.bench.stepped_sine import SteppedSineTrial
from osl_analysis.signals import Motion
from osl_analysis.stats.covariance import FEWEST_CYCLES
from osl_analysis.stats.regression import LinearFit, linear_fit
from osl_analysis.trial import Array

Columns = Callable[[Motion], Mapping[str, Array]]
"""The named columns (n,) of a model for a motion (n,)."""


def fits_by_amplitude(trial: SteppedSineTrial, columns: Columns) -> dict[float | None, LinearFit]:
    """The fit of a model to each amplitude [deg] of a trial, and to all of them (None).

    What the rounding of a sensor adds up to in a segment is the same in the fit to its amplitude and in that to all.

    Raises
    ------
    InputError, IdentifiabilityError
        As `linear_fit`.
    """
    rounding = rounding_by_segment(trial, columns(trial.settled.motion))
    fits: dict[float | None, LinearFit] = {}
    for amplitude in trial.amplitudes:
        motion, torque = trial.part(amplitude)
        repeated = [total(sums, trial.segments(amplitude)) for sums in rounding]
        known = trial.residual_correlation(amplitude, [one for one in repeated if one is not None])
        fits[amplitude] = linear_fit(torque, columns(motion), known)
    return fits


def rounding_by_segment(trial: SteppedSineTrial, columns: Mapping[str, Array]) -> list[dict[Segment, RoundingSums]]:
    """For each signal whose step is known: what its rounding adds up to in the segments that have enough cycles.

    `columns` (n,) are in the rows of all settled segments.
    """
    segments = trial.segments(None)
    ends = np.cumsum([segment.size for segment in segments])[:-1]
    parts = np.split(np.array(list(columns.values())), ends, axis=1)
    long = [(s, X.T) for s, X in zip(segments, parts, strict=True) if len(s.used) >= FEWEST_CYCLES]
    each = [RepeatedRounding(one, trial.filtered_torque, segments) for one in trial.rounded.values()]
    return [{segment: one.sums_of(segment, X) for segment, X in long} for one in each]


def total(sums: Mapping[Segment, RoundingSums], segments: Sequence[Segment]) -> RoundingSums | None:
    """What the rounding adds up to over segments; None where one of them has too few cycles for an interval."""
    if not all(segment in sums for segment in segments):
        return None
    first, *others = (sums[segment] for segment in segments)
    return sum(others, first)
