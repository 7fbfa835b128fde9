"""Impedance over frequency, Z = torque/theta, with noise and distortion told apart, and structures fitted to it.

A nonlinear joint has a best linear approximation Z: what is left of the torque is not correlated with the motion, and
behaves like noise when the phases of the lines change (Pintelon and Schoukens, System Identification, 2012, ch. 3-4).
The same phases repeat it, so that periods show the noise alone.

*robust*: several realisations. The scatter of periods is the noise, that of realisations noise and distortion.
*fast*: one realisation of an odd motion with detection lines. They show the odd distortion, even lines the even one.
*local polynomial*: a motion that does not repeat itself. Near line k impedance and transient are smooth (ch. 7):

    T(k + r) = (Z_k + z_1 r + z_2 r^2) Theta(k + r) + t_0 + t_1 r + t_2 r^2 + noise,   |r| <= `HALF_WIDTH`

What the least-squares fit leaves is the noise. K, B and I come from the lines themselves: neighbouring Z_k share them.

A structure (Eqs. 15 and 9) is fitted to the lines twice. Weighted by the noise, what it leaves is chi-squared if the
structure is right: this is the test. Where it fails, the weights would decide what is estimated (they raised the spread
of I from 0.8 to 9.4 %), and the fit weighted by power, that of filtered signals, is the result.

Of Eq. 9 the control gains K_1 and B_1 are free; the drivetrain (K_s, n_T, J_m, B_m, B_j, J_j) is that of the parameter
file. With all coefficients free, six parameters would follow any response in a decade of frequency.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np
import scipy
from numpy.typing import NDArray

from osl_analysis.errors import InputError
from osl_analysis.measured import check_measured, noise_before_rounding
from osl_analysis.model.parameters import DrivetrainParameters
from osl_analysis.signals import LowPass
from osl_analysis.spectral.periods import (
    NEIGHBOURS,
    LineKinds,
    Realisation,
    Spectrum,
    distinct,
    lines_of,
    scatter,
    smoothed_lines,
)
from osl_analysis.stats.covariance import Covariance
from osl_analysis.stats.regression import LinearFit, linear_fit
from osl_analysis.trial import Array

ResponseColumns = dict[str, Array]  # of `response.csv`, (m,) each; NaN where the motion does not show it


def response_columns(
    frequency_hz: Array, Z: Spectrum, angle: Array, total_sd: Array, levels: Mapping[str, Array], count: int = 1
) -> ResponseColumns:
    """Columns of Z = torque/theta [N*m/rad] of `count` realisations; amplitude of the angle [rad], RMS over these;
    standard deviation of Z by noise and distortion. `levels` are what is added to Z that is measured in one realisation
    as (E|.|^2)^1/2 [N*m/rad], averaged over neighbouring lines: `noise` in the mean over the periods; `odd` and `even`
    distortion, from lines that are not excited; `total`, noise and distortion, from the scatter of realisations."""
    shown = {"frequency_hz": frequency_hz, "angle_deg": np.rad2deg(angle), "Z_re": Z.real, "Z_im": Z.imag}
    shown |= {"magnitude": np.abs(Z), "phase_deg": np.rad2deg(np.angle(Z))}
    shown |= {"noise_sd": levels["noise"] / np.sqrt(count), "total_sd": total_sd}
    return shown | {f"{name}_level": level for name, level in levels.items()}


@dataclass(frozen=True)
class EquationError:
    """torque - Z theta of several realisations; what the angle's own noise and distortion do to Z is in it."""

    lines: LineKinds
    frequency_hz: Array  # frequencies of the lines [Hz], shape (lines,)
    impedance: Spectrum  # Z (lines,) [N*m/rad]; between excited lines it is interpolated
    angle: Array  # sum over realisations of the amplitudes of the angle (lines,) [rad]
    error: Spectrum  # mean over the periods (realisations, lines) [N*m]
    noise: Array  # E|noise|^2 of this mean, from the scatter of periods, (realisations, lines) [(N*m)^2]
    freedom: Array  # degrees of freedom of the noise at each line of each realisation, (realisations,)


def equation_error(realisations: Sequence[Realisation]) -> EquationError:
    """The best linear approximation at the excited lines, and what it leaves at all lines. Turned by the phases of the
    angle, lines of realisations are averaged before they are divided: noise of the angle biases a mean of quotients."""
    single = distinct(realisations)
    lines = lines_of(single)
    theta, torque = np.array([r.mean_lines for r in single]).swapaxes(0, 1)
    size = np.abs(theta)
    turn = np.divide(theta.conj(), size, out=np.ones_like(theta), where=size > 0)
    at, k = np.flatnonzero(lines.excited), np.arange(theta.shape[1])
    Z = (torque * turn).sum(axis=0)[at] / size.sum(axis=0)[at]
    everywhere = np.interp(k, at, Z.real) + 1j * np.interp(k, at, Z.imag)
    noise = np.array([scatter(r.spectra[1] - everywhere * r.spectra[0]) / r.periods for r in single])
    freedom = np.array([2.0 * (r.periods - 1) for r in single])
    error = torque - everywhere * theta
    return EquationError(lines, single[0].frequency_hz, everywhere, size.sum(axis=0), error, noise, freedom)


def periodic_response(realisations: Sequence[Realisation]) -> tuple[ResponseColumns, dict[str, float]]:
    """The best linear approximation of one or several realisations, at the excited lines, and the levels in its band,
    as the RMS amplitude of the torque per line [N*m]: the `torque` itself; `noise`; `odd` and `even` distortion at all
    lines that show it; distortion that excited lines have, at the lines without excitation (`detection`) and from the
    scatter of realisations (`distortion`). With one realisation the total is the level at detection lines,
    interpolated. Of several of an odd motion the excited lines show the odd distortion too. Of another motion every
    line shows both, and counts as odd. Raises InputError: As `lines_of`."""
    found = equation_error(realisations)
    lines, at, count = found.lines, np.flatnonzero(found.lines.excited), len(found.error)
    mean_angle, of_mean = found.angle[at] / count, found.noise.mean(axis=0)
    noise = smoothed_lines(of_mean, (np.arange(len(found.angle)) > 0).astype(float))[at]
    square = np.mean(np.abs(found.error) ** 2, axis=0)  # at excited lines, where Z was fitted, with one degree less
    square = np.asarray(np.where(lines.excited, square * count / max(count - 1, 1), square))
    several = lines.excited & (count > 1)
    odd, even = (lines.odd, lines.even) if lines.only_odd else (lines.odd | lines.even, np.zeros_like(lines.even))

    def distortion(kind: NDArray[np.bool_]) -> tuple[Array, float]:
        """E|distortion|^2 near each excited line, from lines of one kind (lines,), the noise in them taken off, and its
        RMS over these lines."""
        if not kind.any():
            return np.full(len(at), np.nan), np.nan
        shown, above = np.flatnonzero(kind), square - of_mean
        near = np.interp(at, shown, np.maximum(smoothed_lines(above, kind.astype(float))[shown], 0.0))
        return np.asarray(near), float(np.sqrt(np.maximum(np.mean(above[kind]), 0.0)))

    (of_odd, odd_level), (of_even, even_level) = distortion(odd | several), distortion(even)
    total = smoothed_lines(square, lines.excited.astype(float))[at] if count > 1 else noise + of_odd
    seen = total if count > 1 else np.full(len(at), np.nan)
    squares = {"noise": noise, "odd": of_odd, "even": of_even, "total": seen}
    torque = (found.impedance * found.angle / count)[lines.excited]
    band = {
        "torque": float(np.sqrt(np.mean(np.abs(torque) ** 2))),
        "noise": float(np.sqrt(np.mean(of_mean[1 : at[-1] + 1]))),
        "odd": odd_level,
        "even": even_level,
        "detection": distortion(lines.detection)[1],
        "distortion": distortion(several)[1],
    }
    levels = {name: np.sqrt(each) / mean_angle for name, each in squares.items()}
    total_sd = np.sqrt(total / count) / mean_angle
    return response_columns(found.frequency_hz[at], found.impedance[at], mean_angle, total_sd, levels, count), band


HALF_WIDTH = 8  # lines to each side of a line that are fitted together with it
LOCAL_FREEDOM = 2 * HALF_WIDTH + 1 - 2 * 3  # complex degrees of freedom of the noise at a line, of two parabolas
RecordLines = tuple[Array, Spectrum, Spectrum]
"""Frequencies [Hz], lines of the angle [rad] and of the torque [N*m] of a whole stretch of a record, (lines,) each."""


def record_spectrum(theta: Array, torque: Array, rate_hz: float, highest_hz: float) -> RecordLines:
    """Lines 1, 2 ... of angle [rad] and torque [N*m], shape (n,) each, over the whole stretch, up to `highest_hz`,
    without a window. What the ends of the record and a drift of the torque add (`end_columns`) is fitted together with
    a second-order joint and subtracted from the torque; what is left of it is smooth over frequency."""
    n = len(theta)
    top = int(np.floor(min(highest_hz, rate_hz / 3) * n / rate_hz)) + 1
    for name, signal in (("the angle", theta), ("the torque", torque)):
        check_measured(name, signal)
    if top < 2 * HALF_WIDTH + 2:
        raise InputError(
            f"{n / rate_hz:.3g} s have {top - 1} lines up to {highest_hz:g} Hz, a frequency response needs "
            f"{2 * HALF_WIDTH + 1}; record for longer"
        )
    angle, force = (np.fft.rfft(signal - np.mean(signal))[1:top] * (2 / n) for signal in (theta, torque))
    frequency = np.arange(1, top) * rate_hz / n
    s = np.asarray(2j * np.pi * frequency, dtype=np.complex128)
    ends = end_columns(s)
    columns = np.concatenate([np.array([angle, s * angle, s**2 * angle]), ends])
    scale = np.linalg.norm(columns, axis=1)[:, None]
    stacked = np.hstack([(columns / scale).real, (columns / scale).imag]).T
    found = np.linalg.lstsq(stacked, np.concatenate([force.real, force.imag]), rcond=None)[0]
    return frequency, angle, np.asarray(force - found[3:] @ (ends / scale[3:]))


def end_columns(s: Spectrum) -> Spectrum:
    """What the ends of a record and a drift of the torque add to its lines, with real coefficients, (q, lines). The
    ends of Eq. 15 add a + b s, and some more powers because its samples are summed where it has integrals."""
    return np.array([*(s**power for power in range(5)), 1 / s])


def local_fit(spectrum: RecordLines) -> tuple[Spectrum, Array, Array]:
    """The local polynomial method at every line of a record (lines,): Z [N*m/rad] and E|error|^2 of it, NaN where the
    joint does not move, and E|noise|^2 of a line of the torque [(N*m)^2]. Near the first and last line the windows are
    one-sided."""
    _, angle, force = spectrum
    at = np.arange(len(angle))
    first = np.clip(at - HALF_WIDTH, 0, len(at) - (2 * HALF_WIDTH + 1))
    rows = first[:, None] + np.arange(2 * HALF_WIDTH + 1)
    powers = ((rows - at[:, None]) / HALF_WIDTH)[..., None] ** np.arange(3)
    theta, torque = angle[rows], force[rows]
    columns = np.concatenate([powers * theta[..., None], powers.astype(np.complex128)], axis=2)
    scale = np.maximum(np.linalg.norm(columns, axis=1), np.finfo(float).tiny)
    U, singular, Vh = np.linalg.svd(columns / scale[:, None, :], full_matrices=False)
    projected = np.einsum("mwp,mw->mp", U.conj(), torque)
    left = torque - np.einsum("mwp,mp->mw", U, projected)
    noise = np.sum(np.abs(left) ** 2, axis=1) / LOCAL_FREEDOM
    inverse = Vh.conj().transpose(0, 2, 1) / np.maximum(singular, np.finfo(float).tiny)[:, None, :]
    Z = np.einsum("mp,mp->m", inverse[:, 0], projected) / scale[:, 0]
    variance = noise * np.sum(np.abs(inverse[:, 0]) ** 2, axis=1) / scale[:, 0] ** 2
    condition = singular[:, 0] / np.maximum(singular[:, -1], np.finfo(float).tiny)
    size = nearby(angle)
    known = (size > 0.01 * size.max()) & (condition < 1e8) & (variance < 0.1**2 * np.abs(Z) ** 2)
    return np.where(known, Z, np.nan), np.where(known, variance, np.nan), noise


def nearby(theta: Spectrum) -> Array:
    """RMS of the angle's lines (m,) over each line and two to each side [rad]."""
    return np.sqrt(np.convolve(np.abs(theta) ** 2, np.ones(5), "same") / 5)


def local_response(spectrum: RecordLines) -> ResponseColumns:
    """The impedance of a record at every `HALF_WIDTH`-th line that moves, with its noise. Distortion of a motion that
    does not repeat itself is noise: `total_sd` equals `noise_sd`, levels are not known."""
    Z, variance, noise = local_fit(spectrum)
    at = np.arange(HALF_WIDTH // 2, len(noise), HALF_WIDTH)
    at = at[np.isfinite(variance[at])]
    if not len(at):
        raise InputError("the joint moves at no frequency up to the filter's cut-off; move it further, or for longer")
    sd = np.sqrt(variance[at])
    levels = {"noise": sd} | dict.fromkeys(("odd", "even", "total"), np.full(len(at), np.nan))
    return response_columns(spectrum[0][at], Z[at], nearby(spectrum[1])[at], sd, levels)


class SecondOrder:
    """Z = K + s B + s^2 I (Eq. 15)."""

    name = "Eq. 15"
    parameters: tuple[str, ...] = ("K", "B", "I")

    def start(self, K: float, B: float) -> Array:
        return np.array([K, B, 0.0])  # any point will do: the structure is linear

    def impedance(self, x: Array, s: Spectrum) -> Spectrum:
        return np.asarray(x[0] + x[1] * s + x[2] * s**2)

    def derivatives(self, x: Array, s: Spectrum) -> Spectrum:
        return np.array([np.ones_like(s), s, s**2])


class RationalDrivetrain:
    """Z = P - c/N (Eq. 9), in the letters of `model.drivetrain.joint_admittance`, the joint's inertia included."""

    name = "Eq. 9"
    parameters: tuple[str, ...] = ("K_1", "B_1")

    def __init__(self, p: DrivetrainParameters) -> None:
        self.p = p

    def start(self, K: float, B: float) -> Array:
        """The gain of Eq. 13 for K [N*m/rad] and B [N*m*s/rad] of a fit of Eq. 15; no gain renders more than K_s."""
        if not 0 < K < 0.99 * self.p.K_s:
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


Structure = SecondOrder | RationalDrivetrain
"""An impedance Z(s) with p real parameters: where to begin, its value, and its derivatives (p, ...) by these."""
ENOUGH_REALISATIONS = 4  # number of realisations from which on the interval comes from their spread
REALISATIONS, DETECTION = "realisations", "detection lines"
"""Sources of the interval: spread of realisations, lines without excitation."""


def line_covariance(
    X: Array,
    inverse: Array,
    residual: Array,
    shape: tuple[int, int],
    level: Array | None = None,
    shares: Array | None = None,
    freedom: float = np.nan,
) -> Covariance:
    """Covariance of a fit to the lines of `shape[0]` realisations, whose errors are not correlated; the first arguments
    and the result as of `hac`. Rows are real parts, then imaginary parts, realisation by realisation. `level` is
    E|error|^2 of the weighted rows at the lines (realisations, lines): of noise with `freedom` degrees of freedom, or
    averaged from detection lines with the weights `shares` (lines, detection lines). Else the spread of realisations
    counts, or what is left at excited lines."""
    influence, count = X @ inverse, shape[0]
    p = influence.shape[1]
    by_line, tiny = influence.reshape(count, 2, -1, p), np.finfo(float).tiny
    known = None if level is None else np.asarray(0.5 * np.einsum("rcmp,rcmq,rm->pq", by_line, by_line, level))
    if known is not None and np.isfinite(freedom):
        return known, np.full(p, freedom), "noise", 1
    if count >= ENOUGH_REALISATIONS:
        sums = (influence * residual[:, None]).reshape(count, -1, p).sum(axis=1)
        spread = (sums - sums.mean(axis=0)) * np.sqrt(count / (count - 1))
        return spread.T @ spread, np.full(p, count - 1.0), REALISATIONS, 1
    if level is not None and known is not None and shares is not None:
        each = np.einsum("rcmp,rm,md->rdp", by_line**2, level, shares)
        own = 2 * each.sum(axis=(0, 1)) ** 2 / np.maximum((each**2).sum(axis=(0, 1)), tiny)
        return known, np.where(own > 0, own, np.inf), DETECTION, 1
    leverage = np.einsum("np,np->n", influence, influence @ np.linalg.pinv(influence.T @ influence))
    squares = (residual**2 / np.maximum(1 - leverage, 0.1)).reshape(count, 2, -1)
    each = by_line**2 * squares[..., None]
    own = each.sum(axis=(0, 1, 2)) ** 2 / np.maximum((each**2).sum(axis=(0, 1, 2)), tiny)
    own = np.maximum(np.where(own > 0, own - p * own / max(len(residual), 1), np.inf), 1.0)
    return np.einsum("rcmp,rcmq,rcm->pq", by_line, by_line, squares), own, "excited lines", 1


def repeated_rounding(one: Realisation, impedance: Spectrum) -> Array:
    """E|error|^2 [(N*m)^2] at lines (m,) of the mean over the periods, by what every period repeats of the rounding.
    `impedance` (m,) [N*m/rad] takes the angle's error to the torque. A sample's repeated error has the variance of the
    harmonics that the noise before the rounding leaves (Widrow and Kollar, Quantization Noise, 2008, ch. 5): step^2/12
    without noise. Taken for independent from sample to sample, N of them give a line 4/N of it."""
    samples, k, found = one.period * one.rate_hz, np.arange(1, 101), list[float]()
    for spectra, step in zip(one.spectra, one.steps, strict=True):
        if step is None:
            found.append(0.0)
            continue
        noise = noise_before_rounding(float(np.mean(scatter(spectra)[1:])) * samples / 4 / step**2)
        left = float(np.sum(np.exp(-((2 * np.pi * k * noise) ** 2)) / (2 * (np.pi * k) ** 2)))
        found.append(4 * left * step**2 / samples)
    return np.asarray(np.abs(impedance) ** 2 * found[0] + found[1])


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
    level: Array | None = None  # as in `line_covariance`, of the rows weighted by power
    shares: Array | None = None
    shared: float = 0.0
    """Share of the equation error from which its noise is estimated; 0 where that comes from the scatter of periods."""
    transient: Spectrum | None = None
    """What the ends of a record add with real coefficients, (q, n, m); None for whole periods."""


def lines_of_periods(realisations: Sequence[Realisation], low_pass: LowPass) -> FittedLines:
    """The excited lines of realisations, with noise from the scatter of periods at all lines nearby, and from rounding
    that every period repeats. The `level` of noise and distortion is interpolated between four or more lines without
    excitation."""
    single, found = distinct(realisations), equation_error(realisations)
    at, seen = np.flatnonzero(found.lines.excited), np.flatnonzero(found.lines.detection)
    periods = np.array([[r.periods] for r in single], dtype=float)
    weight = low_pass.gain(found.frequency_hz) * np.sqrt(periods)
    level = shares = None
    if len(seen) * len(single) >= 4 and len(seen) >= 2:
        shares = np.array([np.interp(at, seen, row) for row in np.eye(len(seen))]).T
        apart = np.mean(np.abs((found.error * weight)[:, seen]) ** 2, axis=0)
        level = np.tile(apart @ shares.T, (len(single), 1))
    window = (np.abs(at[:, None] - np.arange(1, found.error.shape[1])) <= NEIGHBOURS).astype(float)
    of_one = np.average(found.noise * periods, axis=0, weights=found.freedom)[1:]
    rounding = np.array([repeated_rounding(one, found.impedance[at]) for one in single])
    noise = window @ of_one / window.sum(axis=1) / periods + rounding
    theta, torque = np.array([r.mean_lines[:, at] for r in single]).swapaxes(0, 1)
    return FittedLines(
        np.asarray(np.broadcast_to(2j * np.pi * found.frequency_hz[at], theta.shape)),
        theta,
        torque,
        power=weight[:, at],
        noise=noise,
        noise_freedom=np.broadcast_to(window.sum(axis=1) * found.freedom.sum(), noise.shape),
        pooled_freedom=float(window.any(axis=0).sum() * found.freedom.sum()),
        level=level,
        shares=shares,
    )


def lines_of_record(spectrum: RecordLines, low_pass: LowPass) -> FittedLines:
    """All lines of a record that does not repeat itself, with its noise from the local polynomial method. What the ends
    of the record and a drift of the torque add is fitted too."""
    frequency, theta, torque = spectrum
    s = np.asarray(2j * np.pi * frequency, dtype=np.complex128)[None, :]
    local = local_fit(spectrum)[2]
    noise, shared = smoothed_lines(local, np.ones(len(local)))[None, :], LOCAL_FREEDOM / (2 * HALF_WIDTH + 1)
    return FittedLines(
        s,
        theta[None, :],
        torque[None, :],
        power=low_pass.gain(frequency)[None, :],
        noise=noise,
        noise_freedom=np.full(noise.shape, np.inf),  # a line that is large makes its own noise large: no bias
        pooled_freedom=2 * noise.size * shared,
        shared=shared,
        transient=end_columns(s[0])[:, None, :],
    )


def fit_by_power(structure: Structure, lines: FittedLines, first: tuple[float, float]) -> LinearFit:
    """A structure fitted to lines that weigh as in the fit of filtered signals: by their power behind the filter."""
    if 2 * lines.theta.size <= len(structure.parameters):
        raise InputError(
            f"{lines.theta.size} excited line cannot determine {' and '.join(structure.parameters)}; excite two "
            "frequencies or more, better ten"
        )
    scatter_of = partial(line_covariance, shape=lines.theta.shape, level=lines.level, shares=lines.shares)
    return gauss_newton(structure, lines, lines.power, structure.start(*first), scatter_of)


def fit_structure(
    structure: Structure, lines: FittedLines, first: tuple[float, float]
) -> tuple[LinearFit, dict[str, float | str]]:
    """A structure fitted to lines; `first` are K [N*m/rad] and B [N*m*s/rad] of a fit of Eq. 15, to start from. Beside
    the fit, whose columns behind the parameters are transients: its `weights`, `power` or `noise`; `VAF` of the lines'
    power behind the filter by the fit by power [percent]; `misfit`, the RMS of what it leaves beyond the noise, as a
    share of the torque [percent]; `misfit_ratio`, what the fit by noise leaves over the noise, 1 on average if the
    structure is right, and the `misfit_p` of noise alone. The last two are NaN without noise."""
    by_power = fit_by_power(structure, lines, first)
    left = float(by_power.residual @ by_power.residual)
    noise = float(np.sum(lines.power**2 * lines.noise))
    torque = float(np.sum(np.abs(lines.power * lines.torque) ** 2))
    misfit, vaf = 100 * float(np.sqrt(max(left - noise, 0.0) / torque)), 100 * (1 - left / torque)
    facts: dict[str, float | str] = {"weights": "power", "VAF": vaf, "misfit": misfit}
    if not (lines.noise > 0).all():
        return by_power, facts | {"misfit_ratio": np.nan, "misfit_p": np.nan}
    shape, first_guess = lines.noise.shape, by_power.estimates[: len(structure.parameters)]
    known = partial(line_covariance, shape=shape, level=np.ones(shape), freedom=lines.pooled_freedom)
    by_noise = gauss_newton(structure, lines, 1 / np.sqrt(lines.noise), first_guess, known)
    unbiased = np.tile(1 - 2 / lines.noise_freedom, (1, 2)).ravel()
    freedom = by_noise.samples - len(by_noise.names)
    ratio = (2 * float(np.sum(unbiased * by_noise.residual**2)) / freedom - lines.shared) / (1 - lines.shared)
    p = float(scipy.special.fdtrc(freedom * (1 - lines.shared), lines.pooled_freedom, max(ratio, 0.0)))
    facts |= {"misfit_ratio": ratio, "misfit_p": p}
    return (by_power, facts) if p < 0.05 else (by_noise, facts | {"weights": "noise"})


def gauss_newton(
    structure: Structure, lines: FittedLines, weight: Array, start: Array, covariance_of: Callable[..., Covariance]
) -> LinearFit:
    """Least squares on the weighted lines, from `start` (p,): linear fits to the structure's derivatives."""

    def rows_of(values: Spectrum) -> Array:
        """Real parts, then imaginary parts of the weighted lines (realisations, lines), realisation by realisation."""
        weighted = np.asarray(values * weight)
        return np.concatenate([weighted.real, weighted.imag], axis=1).ravel()

    x, further = start, [] if lines.transient is None else list(lines.transient)
    fixed = {f"end {k}": rows_of(column) for k, column in enumerate(further)}
    for _ in range(30):
        slopes = structure.derivatives(x, lines.s)
        columns = {name: rows_of(slope * lines.theta) for name, slope in zip(structure.parameters, slopes, strict=True)}
        offset = structure.impedance(x, lines.s) - np.tensordot(x, slopes, axes=1)
        fit = linear_fit(rows_of(lines.torque - offset * lines.theta), columns | fixed, covariance_of)
        step = fit.estimates[: len(x)] - x
        x = x + step
        if np.all(np.abs(step) <= 1e-9 * np.maximum(np.abs(x), np.finfo(float).tiny)):
            break
    return fit
