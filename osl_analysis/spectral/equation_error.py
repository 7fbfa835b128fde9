"""Eq. 15 by least squares on the lines of a periodic motion, with intervals that distortion is in.

T_k = (K + s_k B + s_k^2 I) Theta_k, s_k = 2j pi k/period, at the excited lines, each weighted as in the fit of filtered
signals over whole periods: by its power behind the low-pass filter. On a device that is no second-order system every
other weight gives other estimates.

The scatter between periods is blind to friction, whose torque repeats with the motion: it covers 2 to 9 %. Other phases
of the lines give another distortion. Its variance is seen between realisations, or in one of them at lines that are not
excited (Pintelon and Schoukens, System Identification, 2012, ch. 4).
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.stats import f

from osl_analysis.errors import InputError
from osl_analysis.signals import LowPass
from osl_analysis.spectral.period import Spectrum
from osl_analysis.spectral.realisations import Lines, Realisation, distinct, lines_of, scatter
from osl_analysis.stats.covariance import ResidualCorrelation
from osl_analysis.stats.regression import LinearFit, linear_fit
from osl_analysis.trial import Array

PERIODS = "periods"  # source of an interval: the scatter of periods
CERTAINLY_MORE = 1 - 1e-6
"""Probability with which the ratio of two variances of one size is below the limit (F distribution)."""


def at_least_of_periods(fit: LinearFit, columns: Mapping[str, Array], errors: Sequence[Spectrum]) -> LinearFit:
    """The fit with the scatter of its periods added to its covariance, if one of its variances is certainly larger.

    `columns` (n,) are those of the fit to the mean periods: real, then imaginary parts of the lines, realisation by
    realisation. `errors` are the equation errors of the single periods, shape (periods, lines) for each realisation,
    weighted as its rows are.
    """
    X = np.column_stack([columns[name] for name in fit.names])
    influence = (X @ np.linalg.inv(X.T @ X)).reshape(len(errors), -1, len(fit.names))
    covariance, freedom = np.zeros((len(fit.names), len(fit.names))), 0
    for own, error in zip(influence, errors, strict=True):
        of_periods = np.concatenate([error.real, error.imag], axis=1) @ own
        covariance += np.cov(of_periods, rowvar=False) / len(error)
        freedom += len(error) - 1
    ratio = np.diag(covariance) / np.maximum(np.diag(fit.covariance), np.finfo(float).tiny)
    if np.all(ratio < f.ppf(CERTAINLY_MORE, freedom, np.minimum(fit.degrees_of_freedom, 1e6))):
        return fit
    return replace(
        fit,
        covariance=fit.covariance + covariance,
        degrees_of_freedom=np.minimum(fit.degrees_of_freedom, freedom),
        interval_method=PERIODS,
    )


ENOUGH_REALISATIONS = 4  # number of realisations from which on the interval comes from their spread
ENOUGH_DETECTION = 4  # smallest number of lines without excitation, over all realisations, that tell the distortion
REALISATIONS, DETECTION, EXCITED = "realisations", "detection lines", "excited lines"
"""Sources of the interval: spread of realisations, lines without excitation, what the fit leaves at excited lines."""


@dataclass(frozen=True)
class LineScatter(ResidualCorrelation):
    """Covariance of a fit to excited lines: rows are real parts, then imaginary parts, realisation by realisation."""

    shape: tuple[int, int] = (0, 0)  # number of realisations and of excited lines
    level: Array | None = None
    """E|error|^2 that the weighted rows have at the excited lines, (realisations, lines); None: what the fit leaves."""
    shares: Array | None = None  # weights (lines, detection lines) with which the level at an excited line was averaged

    def window(self, residual: Array) -> int:
        return 1  # errors of two lines are not correlated

    @property
    def method(self) -> str:
        if self.shape[0] >= ENOUGH_REALISATIONS:
            return REALISATIONS
        return EXCITED if self.level is None else DETECTION

    def covariance(self, X: Array, inverse: Array, residual: Array) -> tuple[Array, Array, str]:
        """Covariance (p, p) of the estimates, its degrees of freedom (p,) and its source."""
        influence = X @ inverse
        count, p = self.shape[0], influence.shape[1]
        by_line = influence.reshape(count, 2, -1, p)
        if self.method == REALISATIONS:
            sums = (influence * residual[:, None]).reshape(count, -1, p).sum(axis=1)
            spread = (sums - sums.mean(axis=0)) * np.sqrt(count / (count - 1))
            return spread.T @ spread, np.full(p, count - 1.0), self.method
        if self.level is None:
            leverage = np.einsum("np,np->n", influence, influence @ np.linalg.pinv(influence.T @ influence))
            squares = (residual**2 / np.maximum(1 - leverage, 0.1)).reshape(count, 2, -1)
            shares = np.einsum("rcmp,rcm->rcmp", by_line**2, squares)
            freedom = shares.sum(axis=(0, 1, 2)) ** 2 / np.maximum(
                (shares**2).sum(axis=(0, 1, 2)), np.finfo(float).tiny
            )
            lost = p * freedom / max(len(residual), 1)
            return (
                np.einsum("rcmp,rcmq,rcm->pq", by_line, by_line, squares),
                np.maximum(np.where(freedom > 0, freedom - lost, np.inf), 1.0),
                self.method,
            )
        covariance = 0.5 * np.einsum("rcmp,rcmq,rm->pq", by_line, by_line, self.level)
        assert self.shares is not None
        each = np.einsum("rcmp,rm,md->rdp", by_line**2, self.level, self.shares)
        freedom = 2 * each.sum(axis=(0, 1)) ** 2 / np.maximum((each**2).sum(axis=(0, 1)), np.finfo(float).tiny)
        return covariance, np.where(freedom > 0, freedom, np.inf), self.method


def fit_periodic(realisations: Sequence[Realisation], low_pass: LowPass) -> LinearFit:
    """Fit Eq. 15 to the excited lines of one or several realisations of a periodic motion.

    Realisations of one motion count as one, with more periods. The interval comes from the spread of four realisations
    or more, else from the lines without excitation, else from what the fit leaves at the excited lines, where a misfit
    of Eq. 15 widens it. Where the periods scatter certainly more, as those of a device that changes, this is added.
    `offset` is the mean torque at angle 0. VAF and R2 are those of all lines up to the highest excited one, behind the
    filter; `samples` are those in the periods, and `residual` the weighted equation error.

    Raises InputError, IdentifiabilityError: As `lines_of` and `linear_fit`.
    """
    single = distinct(realisations)
    lines = lines_of(single)
    at = np.flatnonzero(lines.excited)
    s = 2j * np.pi * single[0].frequency_hz
    weight = low_pass.gain(single[0].frequency_hz)[None, :] * np.sqrt([[r.periods] for r in single])
    theta = np.asarray([r.theta.mean(axis=0) for r in single] * weight, dtype=np.complex128)
    torque = np.asarray([r.torque.mean(axis=0) for r in single] * weight, dtype=np.complex128)
    columns = {name: parts(np.asarray((s**power * theta)[:, at])) for power, name in enumerate("KBI")}
    y = parts(torque[:, at])
    if len(y) <= len(columns):
        raise InputError(
            f"{len(at)} excited line cannot determine K, B and I; excite two frequencies or more, better ten"
        )
    first = linear_fit(y, columns)
    error = np.asarray(torque - theta * (first["K"] + s * first["B"] + s**2 * first["I"]))
    level, shares = distortion_level(error, lines)
    fit = linear_fit(y, columns, LineScatter(shape=(len(single), len(at)), level=level, shares=shares))
    modelled = fit["K"] + s * fit["B"] + s**2 * fit["I"]
    each = [own * (r.torque - modelled * r.theta) for own, r in zip(weight, single, strict=True)]
    fit = at_least_of_periods(fit, columns, [np.asarray(one[:, at]) for one in each])
    top = slice(1, at[-1] + 1)
    left, all_of = (float(np.sum(np.abs(e[:, top]) ** 2)) for e in (error, torque))
    fit = replace(fit, vaf=100 * (1 - left / all_of), r_squared=1 - left / all_of)
    return with_offset(fit, single, mean_errors(error / weight, lines))


def parts(values: Spectrum) -> Array:
    """Real parts, then imaginary parts of the lines (realisations, lines), realisation by realisation, (n,)."""
    return np.concatenate([values.real, values.imag], axis=1).ravel()


def distortion_level(error: Spectrum, lines: Lines) -> tuple[Array | None, Array | None]:
    """E|error|^2 at excited lines (realisations, excited), averaged from lines without excitation, and the weights.
    Between two such lines it is interpolated. None where they are too few. `error` (realisations, lines) is
    weighted."""
    at, seen = np.flatnonzero(lines.excited), np.flatnonzero(lines.detection)
    if len(seen) * len(error) < ENOUGH_DETECTION or len(seen) < 2:
        return None, None
    shares = np.array([np.interp(at, seen, row) for row in np.eye(len(seen))]).T
    level = np.mean(np.abs(error[:, seen]) ** 2, axis=0) @ shares.T
    return np.tile(level, (len(error), 1)), shares


def mean_errors(error: Spectrum, lines: Lines) -> Array:
    """Variance [N^2 m^2] of each realisation's mean torque by what repeats in its periods, (realisations,).

    The mean is line 0, an even line without excitation. Rounding and distortion are in it as in its like: the even ones
    of an odd motion, else all without excitation, else what the fit leaves at the excited ones. An error of a sine's
    amplitude X has E|X|^2 of four times the variance that it has in the mean. `error` (realisations, lines) [N*m].
    """
    kinds = (lines.even if lines.only_odd else lines.even | lines.odd, lines.even | lines.odd, lines.excited)
    alike = next((kind for kind in kinds if np.count_nonzero(kind) >= ENOUGH_DETECTION), lines.excited)
    return np.asarray(np.mean(np.abs(error[:, alike]) ** 2, axis=1) / 4)


def with_offset(fit: LinearFit, realisations: Sequence[Realisation], repeated: Array) -> LinearFit:
    """The fit with `offset`: the mean torque [N*m] minus K times the mean angle, whose error is the larger one of the
    scatter of the periods' means and of `mean_errors`."""
    count = np.array([r.periods for r in realisations], dtype=float)
    theta, left = 0.0, 0.0
    variance = 0.0
    for one, share, same in zip(realisations, count / count.sum(), repeated, strict=True):
        mean = one.torque[:, 0] - fit["K"] * one.theta[:, 0]
        theta += share * float(one.theta[:, 0].real.mean())
        left += share * float(mean.real.mean())
        variance += share**2 * max(float(scatter(mean[:, None])[0]) / one.periods, float(same))
    along = np.zeros(len(fit.names))
    along[fit.names.index("K")] = -theta
    cross = fit.covariance @ along
    covariance = np.block([[fit.covariance, cross[:, None]], [cross[None, :], along @ cross + variance]])
    freedom = np.append(fit.degrees_of_freedom, max(count.sum() - len(realisations), 1.0))
    samples = round(sum(r.periods * r.period * r.rate_hz for r in realisations))
    return replace(
        fit,
        names=(*fit.names, "offset"),
        estimates=np.append(fit.estimates, left),
        covariance=covariance,
        degrees_of_freedom=freedom,
        samples=samples,
    )
