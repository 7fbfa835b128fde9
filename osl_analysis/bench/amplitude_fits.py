"""One regression for each amplitude of a stepped sine and one over all of them, from sums over the settled segments."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from osl_analysis.bench.alternatives import widened
from osl_analysis.bench.rounding import RepeatedRounding, RoundingSums
from osl_analysis.bench.segments import Segment
from osl_analysis.bench.stepped_sine import Columns, SteppedSineTrial
from osl_analysis.stats.cycle_sums import Cycles
from osl_analysis.stats.partwise import Sums, partwise_fit, partwise_vaf, sums_of
from osl_analysis.stats.regression import LinearFit, linear_fit
from osl_analysis.trial import Array


@dataclass(frozen=True)
class SegmentRows:
    """The rows of a settled segment for a fit: columns, torque, and what the filter took off it."""

    trial: SteppedSineTrial
    segment: Segment
    columns: Columns

    @property
    def cycles(self) -> Cycles | None:
        """The cycles of the segment; None: too few for an interval."""
        return self.segment.repeated

    def named(self) -> Mapping[str, Array]:
        """The columns by name, shape (n,) each."""
        return self.columns(self.trial.moved(self.segment))

    def rows(self) -> tuple[Array, Array, Array]:
        """As `Part` has it."""
        raw, torque = (self.segment.part(signal) for signal in (self.trial.torque, self.trial.filtered_torque))
        return np.array(list(self.named().values())).T, torque, raw - torque


def widened_fits(trial: SteppedSineTrial, columns: Columns) -> Mapping[float | None, LinearFit]:
    """The `fits_by_amplitude` of a trial with the error of the bench's stiffness. They are made once, and kept."""
    if columns not in trial.fits:
        softer = {} if trial.softer is None else fits_by_amplitude(trial.softer, columns)
        fits = fits_by_amplitude(trial, columns)
        trial.fits[columns] = {amplitude: widened(fit, softer.get(amplitude)) for amplitude, fit in fits.items()}
    return trial.fits[columns]


def fits_by_amplitude(trial: SteppedSineTrial, columns: Columns) -> dict[float | None, LinearFit]:
    """The fit of a model to each amplitude [deg] of a trial, and to all of them (None).

    What the rounding of a sensor adds up to in a segment is the same in the fit to its amplitude and in that to all.

    Raises
    ------
    InputError, IdentifiabilityError
        As `linear_fit`.
    """
    parts = segment_sums(trial, columns)
    rounding = rounding_by_segment(trial, [part for part, _ in parts.values() if part.cycles is not None])
    fits: dict[float | None, LinearFit] = {}
    for amplitude in trial.amplitudes:
        segments = trial.segments(amplitude)
        repeated = [one for one in (total(by_segment, segments) for by_segment in rounding) if one is not None]
        fit = None
        if all(segment.repeated is not None for segment in segments):
            names, known = tuple(columns(trial.motion[:0])), [one.covariance_by for one in repeated]
            fit = partwise_fit(names, [parts[s] for s in segments], trial.independent_samples, known)
        if fit is None:
            motion, torque = trial.part(amplitude)
            fit = linear_fit(torque, columns(motion), trial.residual_correlation(amplitude, repeated))
        fits[amplitude] = fit
    return fits


def segment_sums(trial: SteppedSineTrial, columns: Columns) -> Mapping[Segment, tuple[SegmentRows, Sums]]:
    """The rows of each settled segment for a fit, and what they add up to. The sums are made once, and kept."""
    parts = {segment: SegmentRows(trial, segment, columns) for segment in trial.segments(None)}
    if columns not in trial.sums:
        names = tuple(columns(trial.motion[:0]))
        trial.sums[columns] = {segment: sums_of(names, part) for segment, part in parts.items()}
    return {segment: (part, trial.sums[columns][segment]) for segment, part in parts.items()}


def rounding_by_segment(trial: SteppedSineTrial, parts: Iterable[SegmentRows]) -> list[dict[Segment, RoundingSums]]:
    """For each signal whose step is known: what its rounding adds up to in each of these segments."""
    each = [RepeatedRounding(one, trial.filtered_torque, trial.segments(None)) for one in trial.rounded.values()]
    found: list[dict[Segment, RoundingSums]] = [{} for _ in each]
    for part in parts:
        X, *_ = part.rows()
        for one, by_segment in zip(each, found, strict=True):
            by_segment[part.segment] = one.sums_of(part.segment, X)
    return found


def held_out_vaf(fit: LinearFit, trial: SteppedSineTrial, amplitude: float, columns: Columns) -> float:
    """VAF [percent] of a fit at an amplitude [deg] that it did not use."""
    parts = segment_sums(trial, columns)
    return partwise_vaf(fit, [parts[segment][1] for segment in trial.segments(amplitude)])


def total(sums: Mapping[Segment, RoundingSums], segments: Sequence[Segment]) -> RoundingSums | None:
    """What the rounding adds up to over segments; None where one of them has too few cycles for an interval."""
    if not all(segment in sums for segment in segments):
        return None
    first, *others = (sums[segment] for segment in segments)
    return sum(others, first)
