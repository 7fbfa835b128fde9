"""What the rounding of an encoder adds to the error of Eq. 15 over the rows of a record in which the joint moves."""

from dataclasses import replace
from typing import Protocol

import numpy as np

from osl_analysis.bench.alternatives import joint_angle
from osl_analysis.bench.moving_fit import Columns, FittedRecord
from osl_analysis.bench.settings import BenchStiffness
from osl_analysis.stats.covariance import with_repeated
from osl_analysis.stats.regression import LinearFit
from osl_analysis.stats.rounding import HARMONICS, SIZES, rounding_harmonics
from osl_analysis.trial import Array

DITHERED = 1e-3
"""Share of the rounding that survives the noise before it, below which the residuals have all that is left of it."""


class RoundedRecord(FittedRecord, Protocol):
    """What is needed of a record beside its fit."""

    @property
    def bench_angle(self) -> Array:
        """Angle as the encoder rounded it (n,) [rad]."""
        ...

    @property
    def bench(self) -> BenchStiffness | None:
        """What yields between encoder and joint."""
        ...

    @property
    def steps(self) -> tuple[float | None, float | None]:
        """Steps of angle [rad] and torque [N*m]; None where they are not seen."""
        ...


def with_rounding(fit: LinearFit, record: RoundedRecord) -> LinearFit:
    """A fit of a record (`fit_of`) with the rounding of its angle in its covariance.

    A sweep turns round at places within a step that change slowly: there the errors of many samples are alike, and add
    up. What they do is computed as a variance over all zeros of the encoder (`rounding_harmonics`), from the filtered
    angle. The residuals have a part of it already: the interval may be too wide.
    """
    step = record.steps[0]
    left = np.zeros(HARMONICS) if step is None else surviving(record, step)
    if step is None or left[0] <= DITHERED:
        return fit
    columns, p = Columns(record), len(fit.names)
    gram, sums = np.zeros((p, p)), np.zeros((p, 2 * HARMONICS))
    stiffness, damping, inertia = (fit[name] for name in ("K", "B", "I"))
    for rows in record.fitted_pieces():
        X = columns.at(rows)
        gram += X.T @ X
        if len(X) < 2:
            continue
        # the error acts as K e + B de/dt + I d2e/dt2; by parts, the derivatives are the columns'
        slope = np.gradient(X, axis=0) * record.rate_hz
        weights = stiffness * X - damping * slope + inertia * np.gradient(slope, axis=0) * record.rate_hz
        sums += weights.T @ rounding_harmonics(turned(record, rows), step).T
    changes = np.linalg.solve(gram, sums) * (SIZES * step * np.tile(left, 2))
    return with_component(fit, changes @ changes.T)


def with_component(fit: LinearFit, rounding: Array) -> LinearFit:
    """A fit with the covariance (p, p) of rounding added to its own."""
    spread = fit.covariance, fit.degrees_of_freedom
    covariance, freedom, method = with_repeated(spread, [rounding], fit.interval_method)
    return replace(fit, covariance=covariance, degrees_of_freedom=freedom, interval_method=method)


def surviving(record: RoundedRecord, step: float) -> Array:
    """Share of each harmonic of the rounding to steps [rad] that the noise of the angle leaves in the mean,
    (HARMONICS,).

    The noise is what the angle has beside the filtered one, beyond the rounding of that.
    """
    beyond = 0.0
    for rows in record.fitted_pieces():
        smooth = turned(record, rows) / step
        error, rounded = record.bench_angle[rows] / step - smooth, np.rint(smooth) - smooth
        beyond += float(error @ error - rounded @ rounded)
    variance = max(beyond / record.samples, 0.0)
    return np.asarray(np.exp(-2 * variance * (np.pi * np.arange(1, HARMONICS + 1)) ** 2))


def turned(record: RoundedRecord, rows: slice) -> Array:
    """The filtered angle of the encoder [rad] in some rows: that of the joint, and what the bench yields."""
    theta = record.motion.theta[rows]
    if record.bench is None:
        return theta
    return joint_angle(theta, record.filtered_torque[rows], -record.bench.compliance)
