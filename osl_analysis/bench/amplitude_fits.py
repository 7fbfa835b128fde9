"""One regression for each amplitude of a stepped sine and one over all of them, from sums over the settled segments."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from osl_analysis.bench.alternatives import widened
from osl_analysis.bench.rounding import RepeatedRounding, RoundingSums, total
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
    rounding = {segment: rounding_beside(part) for segment, (part, _) in parts.items()}
    fits: dict[float | None, LinearFit] = {}
    for amplitude in trial.amplitudes:
        segments = trial.segments(amplitude)
        repeated = [total([rounding[s][column] for s in segments], segments) for column in trial.rounded]
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


def rounding_beside(part: SegmentRows, own: Array | None = None) -> dict[str, RoundingSums]:
    """What the rounding of each signal whose step is known adds up to in a segment, by column.

    With columns `own` (n, q) of a fit to each rounded signal itself, this is beside them. What it is beside the columns
    of the model comes along in the same pass over the samples, and is kept in the trial.
    """
    trial, segment = part.trial, part.segment
    key = part.columns, segment
    if own is not None or key not in trial.rounding:
        X, *_ = part.rows()
        p = X.shape[1]
        each = {c: RepeatedRounding(one, trial.filtered_torque, [segment]) for c, one in trial.rounded.items()}
        both = {column: one.sums_of(segment, X, own) for column, one in each.items()}
        trial.rounding[key] = {column: sums.beside(slice(p)) for column, sums in both.items()}
        if own is not None:
            return {column: sums.beside(slice(p, None)) for column, sums in both.items()}
    return trial.rounding[key]


def held_out_vaf(fit: LinearFit, trial: SteppedSineTrial, amplitude: float, columns: Columns) -> float:
    """VAF [percent] of a fit at an amplitude [deg] that it did not use."""
    parts = segment_sums(trial, columns)
    return partwise_vaf(fit, [parts[segment][1] for segment in trial.segments(amplitude)])
