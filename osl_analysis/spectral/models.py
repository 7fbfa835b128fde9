"""Structures of an impedance over frequency (Eqs. 15 and 9) fitted to lines, and whether they leave more than noise.

A structure is fitted twice. Weighted by the noise, what it leaves is chi-squared if the structure is right: this is the
test. Where it passes, this fit is the better one. Where it fails, the weights would decide what is estimated (they
raised the spread of I from 0.8 to 9.4 %), and the fit weighted by power, that of filtered signals, is the result.

Of Eq. 9 the control gains K_1 and B_1 are free, since a controller sets them and friction changes what they do; the
drivetrain (K_s, n_T, J_m, B_m, B_j, J_j) is that of the parameter file. With all coefficients of the rational function
free, six parameters follow any response in a decade of frequency, and their misfit says nothing on the drivetrain.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from scipy.special import fdtrc

from osl_analysis.config.parameters import DrivetrainParameters
from osl_analysis.errors import InputError
from osl_analysis.signals import LowPass
from osl_analysis.spectral.period import Spectrum
from osl_analysis.spectral.realisations import NEIGHBOURS, LineKinds, Realisation, distinct, scatter, smoothed_lines
from osl_analysis.spectral.response import (
    HALF_WIDTH,
    LOCAL_FREEDOM,
    RecordSpectrum,
    end_columns,
    equation_error,
    local_fit,
)
from osl_analysis.stats.covariance import ResidualCorrelation
from osl_analysis.stats.regression import LinearFit, linear_fit
from osl_analysis.stats.rounding import noise_before_rounding
from osl_analysis.trial import Array

EQ_15, EQ_9 = "Eq. 15", "Eq. 9"
LARGEST_SHARE = 0.99
"""Largest stiffness from which K_1 is started, as a share of the belt's: no gain renders more (Eq. 13)."""


class Structure(Protocol):
    """An impedance Z(s) with p real parameters."""

    name: str
    parameters: tuple[str, ...]

    def start(self, K: float, B: float) -> Array:
        """Parameters (p,) to begin with, from a fit of Eq. 15 [N*m/rad], [N*m*s/rad]."""
        ...

    def impedance(self, x: Array, s: Spectrum) -> Spectrum: ...

    def derivatives(self, x: Array, s: Spectrum) -> Spectrum: ...


class SecondOrder:
    """Z = K + s B + s^2 I (Eq. 15)."""

    name = EQ_15
    parameters: tuple[str, ...] = ("K", "B", "I")

    def start(self, K: float, B: float) -> Array:
        """Any point will do: the structure is linear."""
        return np.array([K, B, 0.0])

    def impedance(self, x: Array, s: Spectrum) -> Spectrum:
        return np.asarray(x[0] + x[1] * s + x[2] * s**2)

    def derivatives(self, x: Array, s: Spectrum) -> Spectrum:
        return np.array([np.ones_like(s), s, s**2])


class RationalDrivetrain:
    """Z = P - c/N (Eq. 9), in the letters of `model.drivetrain.joint_admittance`, the joint's inertia included."""

    name = EQ_9
    parameters: tuple[str, ...] = ("K_1", "B_1")

    def __init__(self, p: DrivetrainParameters) -> None:
        self.p = p

    def start(self, K: float, B: float) -> Array:
        """The gain of Eq. 13 for a stiffness K."""
        if not 0 < K < LARGEST_SHARE * self.p.K_s:
            raise InputError(
                f"K = {K:.4g} N*m/rad is not between 0 and the belt's K_s = {self.p.K_s:g}; Eq. 9 of this parameter "
                "file cannot render it"
            )
        return np.array([K * self.p.K_s / (self.p.n_T**2 * (self.p.K_s - K)), max(B, 0.0) / self.p.n_T**2])

    def _actuator(self, x: Array, s: Spectrum) -> Spectrum:
        return np.asarray(self.p.J_m * s**2 + (self.p.B_m + x[1]) * s + x[0] + self.p.K_s / self.p.n_T**2)

    def impedance(self, x: Array, s: Spectrum) -> Spectrum:
        joint = self.p.J_j * s**2 + self.p.B_j * s + self.p.K_s
        return np.asarray(joint - (self.p.K_s / self.p.n_T) ** 2 / self._actuator(x, s))

    def derivatives(self, x: Array, s: Spectrum) -> Spectrum:
        by_gain = (self.p.K_s / self.p.n_T) ** 2 / self._actuator(x, s) ** 2
        return np.array([by_gain, s * by_gain])


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


def parts(values: Spectrum) -> Array:
    """Real parts, then imaginary parts of the lines (realisations, lines), realisation by realisation, (n,)."""
    return np.concatenate([values.real, values.imag], axis=1).ravel()


def distortion_level(error: Spectrum, lines: LineKinds) -> tuple[Array | None, Array | None]:
    """E|error|^2 at excited lines (realisations, excited), averaged from lines without excitation, and the weights.
    Between two such lines it is interpolated. None where they are too few. `error` (realisations, lines) is
    weighted."""
    at, seen = np.flatnonzero(lines.excited), np.flatnonzero(lines.detection)
    if len(seen) * len(error) < ENOUGH_DETECTION or len(seen) < 2:
        return None, None
    shares = np.array([np.interp(at, seen, row) for row in np.eye(len(seen))]).T
    level = np.mean(np.abs(error[:, seen]) ** 2, axis=0) @ shares.T
    return np.tile(level, (len(error), 1)), shares


def repeated_rounding(one: Realisation, impedance: Spectrum) -> Array:
    """E|error|^2 [(N*m)^2] at lines (m,) of the mean over the periods, by what every period repeats of the rounding.
    `impedance` (m,) [N*m/rad] takes the angle's error to the torque."""
    theta, torque = (
        repeated_variance(one, spectra, step) for spectra, step in zip((one.theta, one.torque), one.steps, strict=True)
    )
    return np.asarray(np.abs(impedance) ** 2 * theta + torque)


def repeated_variance(one: Realisation, spectra: Spectrum, step: float | None) -> float:
    """E|error|^2 of a line of a signal with lines (periods, lines) that was rounded to `step`; 0 if it was not.

    A sample's repeated error has the variance of the harmonics that the noise before the rounding leaves (Widrow and
    Kollar, Quantization Noise, 2008, ch. 5): step^2/12 without noise. It is taken for independent from sample to
    sample, as it is where a motion crosses a step or more between two samples; N of them give a line 4/N of it.
    """
    if step is None:
        return 0.0
    samples, k = one.period * one.rate_hz, np.arange(1, 101)
    of_sample = float(np.mean(scatter(spectra)[1:])) * samples / 4 / step**2
    noise = noise_before_rounding(of_sample)
    left = float(np.sum(np.exp(-((2 * np.pi * k * noise) ** 2)) / (2 * (np.pi * k) ** 2)))
    return 4 * left * step**2 / samples


POWER, NOISE = "power", "noise"
"""Weights of a fit: power behind the low-pass filter, or the inverse variance of the noise."""
SIGNIFICANT = 0.05  # probability below which what a structure leaves is more than noise


@dataclass(frozen=True)
class UnitNoise(ResidualCorrelation):
    """Covariance of a fit to lines that were divided by the size of their noise: each row has a variance of 1/2."""

    freedom: float = np.inf  # degrees of freedom of the noise

    def window(self, residual: Array) -> int:
        return 1  # errors of two lines are not correlated

    def covariance(self, X: Array, inverse: Array, residual: Array) -> tuple[Array, Array, str]:
        """Covariance (p, p) of the estimates, its degrees of freedom (p,) and its source."""
        return 0.5 * inverse.T @ (X.T @ X) @ inverse, np.full(X.shape[1], self.freedom), NOISE


@dataclass(frozen=True)
class FittedLines:
    """Lines to which structures are fitted, those of n realisations (or of 1 record) side by side, shape (n, m)."""

    s: Spectrum  # complex frequencies 2j pi f [rad/s]
    theta: Spectrum  # lines of the angle [rad]
    torque: Spectrum  # lines of the torque [N*m]
    power: Array  # weights of the rows in a fit by power
    noise: Array  # E|noise|^2 of the equation error [(N*m)^2]
    noise_freedom: Array  # degrees of freedom of each `noise`: the mean of its inverse is too large by 2 in as many
    pooled_freedom: float  # degrees of freedom of all of them together; neighbours share theirs
    level: Array | None  # E|noise and distortion|^2 of the rows weighted by power; None: what the fit leaves
    shares: Array | None  # as in `LineScatter`
    shared: float = 0.0
    """Share of the equation error from which its noise is estimated; 0 where that comes from the scatter of periods."""
    transient: Spectrum | None = None
    """What the ends of a record add with real coefficients, (q, n, m); None for whole periods."""


@dataclass(frozen=True)
class FittedStructure:
    """A structure with its parameters, and what it leaves."""

    structure: Structure
    fit: LinearFit  # its parameters; further columns are transients
    weights: str  # `POWER` or `NOISE`
    vaf: float  # share of the lines' power behind the filter that the fit by power accounts for [percent]
    misfit: float  # RMS of what the fit by power leaves beyond the noise, as a share of the torque [percent]
    ratio: float
    """What the fit by noise leaves over the noise: 1 on average if the structure is right; NaN without noise."""
    p: float  # probability that noise alone leaves as much; NaN without noise

    def impedance(self, frequency_hz: Array) -> Spectrum:
        s = np.asarray(2j * np.pi * frequency_hz, dtype=np.complex128)
        return self.structure.impedance(self.fit.estimates[: len(self.structure.parameters)], s)


def lines_of_periods(realisations: Sequence[Realisation], low_pass: LowPass) -> FittedLines:
    """The excited lines of realisations. Their noise comes from the scatter of periods at all lines nearby, and from
    rounding that every period repeats."""
    single, found = distinct(realisations), equation_error(realisations)
    at = np.flatnonzero(found.lines.excited)
    periods = np.array([[r.periods] for r in single], dtype=float)
    weight = low_pass.gain(found.frequency_hz) * np.sqrt(periods)
    level, shares = distortion_level(np.asarray(found.error * weight), found.lines)
    window = (np.abs(at[:, None] - np.arange(1, found.error.shape[1])) <= NEIGHBOURS).astype(float)
    of_one = np.average(found.noise * periods, axis=0, weights=found.freedom)[1:]
    rounding = np.array([repeated_rounding(one, found.impedance[at]) for one in single])
    noise = window @ of_one / window.sum(axis=1) / periods + rounding
    theta, torque = (
        np.array([s.mean(axis=0) for s in each])[:, at]
        for each in zip(*((r.theta, r.torque) for r in single), strict=True)
    )
    s = np.broadcast_to(2j * np.pi * found.frequency_hz[at], theta.shape)
    return FittedLines(
        s=np.asarray(s),
        theta=theta,
        torque=torque,
        power=weight[:, at],
        noise=noise,
        noise_freedom=np.broadcast_to(window.sum(axis=1) * found.freedom.sum(), noise.shape),
        pooled_freedom=float(window.any(axis=0).sum() * found.freedom.sum()),
        level=level,
        shares=shares,
    )


def lines_of_record(spectrum: RecordSpectrum, low_pass: LowPass) -> FittedLines:
    """All lines of a record that does not repeat itself, with its noise from the local polynomial method. What the ends
    of the record and a drift of the torque add is fitted too."""
    s = np.asarray(2j * np.pi * spectrum.frequency_hz, dtype=np.complex128)[None, :]
    local = local_fit(spectrum).noise
    noise = smoothed_lines(local, np.ones(len(local)))[None, :]
    return FittedLines(
        s=s,
        theta=spectrum.theta[None, :],
        torque=spectrum.torque[None, :],
        power=low_pass.gain(spectrum.frequency_hz)[None, :],
        noise=noise,
        noise_freedom=np.full(noise.shape, np.inf),  # a line that is large makes its own noise large: no bias
        pooled_freedom=2 * noise.size * LOCAL_FREEDOM / (2 * HALF_WIDTH + 1),
        level=None,
        shares=None,
        shared=LOCAL_FREEDOM / (2 * HALF_WIDTH + 1),
        transient=end_columns(s[0])[:, None, :],
    )


def fit_by_power(structure: Structure, lines: FittedLines, first: tuple[float, float]) -> LinearFit:
    """A structure fitted to lines that weigh as in the fit of filtered signals: by their power behind the filter."""
    if 2 * lines.theta.size <= len(structure.parameters):
        raise InputError(
            f"{lines.theta.size} excited line cannot determine {' and '.join(structure.parameters)}; excite two "
            "frequencies or more, better ten"
        )
    scatter = LineScatter(shape=lines.theta.shape, level=lines.level, shares=lines.shares)
    return gauss_newton(structure, lines, lines.power, structure.start(*first), scatter)


def fit_structure(structure: Structure, lines: FittedLines, first: tuple[float, float]) -> FittedStructure:
    """A structure fitted to lines; `first` are K [N*m/rad] and B [N*m*s/rad] of a fit of Eq. 15, to start from."""
    start = structure.start(*first)
    by_power = fit_by_power(structure, lines, first)
    left = by_power.residual
    noise = float(np.sum(lines.power**2 * lines.noise))
    torque = float(np.sum(np.abs(lines.power * lines.torque) ** 2))
    misfit = 100 * float(np.sqrt(max(float(left @ left) - noise, 0.0) / torque))
    vaf = 100 * (1 - float(left @ left) / torque)
    if not (lines.noise > 0).all():
        return FittedStructure(structure, by_power, POWER, vaf, misfit, np.nan, np.nan)
    weight = 1 / np.sqrt(lines.noise)
    known = UnitNoise(freedom=lines.pooled_freedom)
    by_noise = gauss_newton(structure, lines, weight, by_power.estimates[: len(start)], known)
    unbiased = 1 - 2 / lines.noise_freedom
    squares = 2 * float(np.sum(np.tile(unbiased, (1, 2)).ravel() * by_noise.residual**2))
    freedom = by_noise.samples - len(by_noise.names)
    ratio = (squares / freedom - lines.shared) / (1 - lines.shared)
    p = float(fdtrc(freedom * (1 - lines.shared), lines.pooled_freedom, max(ratio, 0.0)))
    if p < SIGNIFICANT:
        return FittedStructure(structure, by_power, POWER, vaf, misfit, ratio, p)
    return FittedStructure(structure, by_noise, NOISE, vaf, misfit, ratio, p)


def gauss_newton(
    structure: Structure, lines: FittedLines, weight: Array, start: Array, scatter: ResidualCorrelation
) -> LinearFit:
    """Least squares on the weighted lines, from `start` (p,): linear fits to the structure's derivatives."""
    x = start
    further = {} if lines.transient is None else {f"end {k}": column for k, column in enumerate(lines.transient)}
    fixed = {name: parts(np.asarray(column * weight)) for name, column in further.items()}
    for _ in range(30):
        slopes = structure.derivatives(x, lines.s)
        columns = {
            name: parts(np.asarray(slope * lines.theta * weight))
            for name, slope in zip(structure.parameters, slopes, strict=True)
        }
        offset = structure.impedance(x, lines.s) - np.tensordot(x, slopes, axes=1)
        y = parts(np.asarray((lines.torque - offset * lines.theta) * weight))
        fit = linear_fit(y, columns | fixed, scatter)
        step = fit.estimates[: len(x)] - x
        x = x + step
        if np.all(np.abs(step) <= 1e-9 * np.maximum(np.abs(x), np.finfo(float).tiny)):
            break
    return fit
