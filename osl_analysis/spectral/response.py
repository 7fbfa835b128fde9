"""Impedance over frequency without a model, Z = torque/theta, with noise and nonlinear distortion told apart.

A nonlinear joint has a best linear approximation Z: what is left of the torque is not correlated with the motion, and
behaves like noise when the phases of the lines change (Pintelon and Schoukens, System Identification, 2012, ch. 3-4).
The same phases repeat it, so that periods show the noise alone.

*robust*: several realisations. The scatter of periods is the noise, that of realisations noise and distortion.
*fast*: one realisation of an odd motion with detection lines. They show the odd distortion, even lines the even one.
*local polynomial*: a motion that does not repeat itself. Near line k impedance and transient are smooth (ch. 7):

    T(k + r) = (Z_k + z_1 r + z_2 r^2) Theta(k + r) + t_0 + t_1 r + t_2 r^2 + noise,   |r| <= `HALF_WIDTH`

What the least-squares fit leaves is the noise. For K, B and I fit the lines themselves: a fit to Z_k loses a factor of
two, since neighbours share their lines.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from osl_analysis.errors import InputError
from osl_analysis.measured import check_measured
from osl_analysis.spectral.period import Spectrum
from osl_analysis.spectral.realisations import LineKinds, Realisation, distinct, lines_of, scatter, smoothed_lines
from osl_analysis.trial import Array

ROBUST, FAST, LOCAL = "robust", "fast", "local polynomial"
"""Methods: several realisations, one, motion that does not repeat itself."""


@dataclass(frozen=True)
class FrequencyResponse:
    """Impedance over frequency, shape (m,) each; NaN where the motion does not show it. Levels are what is added to Z
    that is measured in one realisation, as a standard deviation of the complex number (E|.|^2)^1/2, averaged over
    neighbouring lines."""

    method: str  # one of `ROBUST`, `FAST`, `LOCAL`
    frequency_hz: Array  # frequency [Hz]
    impedance: Spectrum  # Z = torque/theta [N*m/rad]
    angle: Array  # amplitude of the angle at this frequency [rad], RMS over realisations
    noise_sd: Array  # standard deviation of Z by noise [N*m/rad]
    total_sd: Array  # standard deviation of Z by noise and distortion [N*m/rad]
    noise_level: Array  # noise in the mean over the periods of one realisation [N*m/rad]
    odd_level: Array
    """Odd distortion, from odd lines that are not excited and the scatter of realisations, without the noise
    [N*m/rad]."""
    even_level: Array  # even distortion, from even lines that are not excited, without the noise [N*m/rad]
    total_level: Array  # noise and distortion, from the scatter of realisations [N*m/rad]


@dataclass(frozen=True)
class BandLevels:
    """Levels over the excited band: RMS amplitude of the torque per line [N*m], in one realisation; NaN if not seen."""

    torque: float  # the torque itself at the excited lines
    noise: float  # noise in the mean over the periods
    odd: float  # odd distortion at all odd lines that show it, without the noise
    even: float  # even distortion, without the noise
    detection: float  # distortion at the lines without excitation that show what excited lines have, without the noise
    distortion: float  # distortion at the excited lines from the scatter of realisations, without the noise


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
    """The best linear approximation at the excited lines, and what it leaves at all lines.

    The phases of the angle are the reference: turned by them, the lines of realisations are averaged before they are
    divided. The mean of quotients would be biased by noise of the angle.
    """
    single = distinct(realisations)
    lines = lines_of(single)
    theta, torque = (
        np.array([signal.mean(axis=0) for signal in s])
        for s in zip(*((r.theta, r.torque) for r in single), strict=True)
    )
    size = np.abs(theta)
    turn = np.divide(theta.conj(), size, out=np.ones_like(theta), where=size > 0)
    at, k = np.flatnonzero(lines.excited), np.arange(theta.shape[1])
    Z = (torque * turn).sum(axis=0)[at] / size.sum(axis=0)[at]
    everywhere = np.interp(k, at, Z.real) + 1j * np.interp(k, at, Z.imag)
    noise = np.array([scatter(r.torque - everywhere * r.theta) / r.periods for r in single])
    freedom = np.array([2.0 * (r.periods - 1) for r in single])
    return EquationError(
        lines, single[0].frequency_hz, everywhere, size.sum(axis=0), torque - everywhere * theta, noise, freedom
    )


def periodic_response(realisations: Sequence[Realisation]) -> tuple[FrequencyResponse, BandLevels]:
    """The best linear approximation of one or several realisations, at the excited lines, and the levels in its band.

    With one realisation the total is the level at detection lines, interpolated; without these it is not known.

    Raises InputError: As `lines_of`.
    """
    found = equation_error(realisations)
    at, count = np.flatnonzero(found.lines.excited), len(found.error)
    mean_angle = found.angle[at] / count
    noise = smoothed_lines(found.noise.mean(axis=0), (np.arange(len(found.angle)) > 0).astype(float))[at]
    square = np.mean(np.abs(found.error) ** 2, axis=0)  # at excited lines, where Z was fitted, with one degree less
    square = np.asarray(np.where(found.lines.excited, square * count / max(count - 1, 1), square))
    kinds = showing(found.lines, count)
    odd, even = (without_noise(square, found.noise, kind) for kind in kinds)
    between = smoothed_lines(square, found.lines.excited.astype(float))[at]
    seen = (found.lines.detection).any()
    total = between if count > 1 else (noise + odd[at] if seen else np.full(len(at), np.nan))
    response = FrequencyResponse(
        method=ROBUST if count > 1 else FAST,
        frequency_hz=found.frequency_hz[at],
        impedance=found.impedance[at],
        angle=mean_angle,
        noise_sd=np.sqrt(noise / count) / mean_angle,
        total_sd=np.sqrt(total / count) / mean_angle,
        noise_level=np.sqrt(noise) / mean_angle,
        odd_level=np.sqrt(odd[at]) / mean_angle,
        even_level=np.sqrt(even[at]) / mean_angle,
        total_level=np.sqrt(total if count > 1 else np.full(len(at), np.nan)) / mean_angle,
    )
    return response, band_levels(found, square)


def without_noise(square: Array, noise: Array, kind: NDArray[np.bool_]) -> Array:
    """Level E|distortion|^2 near each line (lines,), from lines of one kind, the noise in them taken off; NaN without
    any. `square` (lines,) is the mean of |error|^2 over realisations, `noise` (realisations, lines) is in it."""
    if not kind.any():
        return np.full(len(square), np.nan)
    at, k = np.flatnonzero(kind), np.arange(len(square))
    above = smoothed_lines(square - noise.mean(axis=0), kind.astype(float))[at]
    return np.asarray(np.interp(k, at, np.maximum(above, 0.0)))


def showing(lines: LineKinds, realisations: int) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """Lines (lines,) that show the odd and the even distortion. Of several realisations of an odd motion the excited
    lines show the odd distortion too. Of another motion every line shows both, and counts as odd."""
    odd, even = lines.odd, lines.even
    if not lines.only_odd:
        odd, even = odd | even, np.zeros_like(even)
    return (odd | lines.excited if realisations > 1 else odd), even


def band_levels(found: EquationError, square: Array) -> BandLevels:
    """RMS over the lines of each kind."""
    count, lines = len(found.error), found.lines
    noise = found.noise.mean(axis=0)
    band = np.arange(len(noise)) <= np.flatnonzero(lines.excited)[-1]
    band[0] = False

    def level(kind: NDArray[np.bool_]) -> float:
        """Distortion at the lines of a kind."""
        above = float(np.mean(square[kind] - noise[kind])) if kind.any() else np.nan
        return float(np.sqrt(np.maximum(above, 0.0)))

    torque = found.impedance * found.angle / count
    odd, even = showing(lines, count)
    return BandLevels(
        torque=float(np.sqrt(np.mean(np.abs(torque[lines.excited]) ** 2))),
        noise=float(np.sqrt(np.mean(noise[band]))),
        odd=level(odd),
        even=level(even),
        detection=level(lines.detection),
        distortion=level(lines.excited) if count > 1 else np.nan,
    )


HALF_WIDTH = 8  # lines to each side of a line that are fitted together with it
ORDER = 2  # order of the polynomials
LOCAL_FREEDOM = 2 * HALF_WIDTH + 1 - 2 * (ORDER + 1)  # complex degrees of freedom of the noise at a line
END_POWERS = 5  # powers of s that the ends of a record add
WEAK, NEAREST = 0.01, 2
"""RMS of the angle at a line and its `NEAREST` ones to each side, as a share of the largest one, below which the
impedance is not known."""
LARGEST_CONDITION = 1e8  # largest condition number of a local fit, its columns scaled


@dataclass(frozen=True)
class RecordSpectrum:
    """Lines of a whole stretch of a record, shape (lines,); line k is the sine Re(X_k exp(2j pi f_k t)), k >= 1."""

    frequency_hz: Array  # frequency [Hz]
    theta: Spectrum  # lines of the angle [rad]
    torque: Spectrum  # lines of the torque [N*m]


@dataclass(frozen=True)
class LocalFit:
    """Result of the local polynomial method at each line, shape (lines,); NaN where the joint does not move."""

    impedance: Spectrum  # Z [N*m/rad]
    variance: Array  # E|error|^2 of Z [(N*m/rad)^2]
    noise: Array  # E|noise|^2 of a line of the torque [(N*m)^2], with `LOCAL_FREEDOM` complex degrees of freedom


def record_spectrum(theta: Array, torque: Array, rate_hz: float, highest_hz: float) -> RecordSpectrum:
    """Lines 1, 2 ... of angle [rad] and torque [N*m], shape (n,) each, over the whole stretch, up to `highest_hz`. No
    window is applied. What the ends of the record and a drift of the torque add (`end_columns`) is fitted together with
    a second-order joint and subtracted from the torque. What is left of it is smooth over frequency."""
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
    joint, ends = np.array([angle, s * angle, s**2 * angle]), end_columns(s)
    columns = np.concatenate([joint, ends])
    scale = np.linalg.norm(columns, axis=1)[:, None]
    stacked = np.hstack([(columns / scale).real, (columns / scale).imag]).T
    found = np.linalg.lstsq(stacked, np.concatenate([force.real, force.imag]), rcond=None)[0]
    return RecordSpectrum(frequency, angle, np.asarray(force - found[3:] @ (ends / scale[3:])))


def end_columns(s: Spectrum) -> Spectrum:
    """What the ends of a record and a drift of the torque add to its lines, with real coefficients, (q, lines). The
    ends of Eq. 15 add a + b s, and some more powers because its samples are summed where it has integrals."""
    return np.array([*(s**power for power in range(END_POWERS)), 1 / s])


def local_fit(spectrum: RecordSpectrum) -> LocalFit:
    """The local polynomial method at every line of a record; near the first and last line the windows are one-sided."""
    Z, variance, noise, condition = local_fit_at(spectrum, np.arange(len(spectrum.theta)))
    size = nearby(spectrum.theta)
    known = (size > WEAK * size.max()) & (condition < LARGEST_CONDITION)
    known &= variance < 0.1**2 * np.abs(Z) ** 2  # a tenth of it is not known
    return LocalFit(np.where(known, Z, np.nan), np.where(known, variance, np.nan), noise)


def local_fit_at(spectrum: RecordSpectrum, at: NDArray[np.intp]) -> tuple[Spectrum, Array, Array, Array]:
    """Impedance, its variance, noise and condition number of the local fits about some lines (m,), counted from 0."""
    width = 2 * HALF_WIDTH + 1
    first = np.clip(at - HALF_WIDTH, 0, len(spectrum.theta) - width)
    rows = first[:, None] + np.arange(width)
    r = (rows - at[:, None]) / HALF_WIDTH
    powers = r[..., None] ** np.arange(ORDER + 1)
    theta, torque = spectrum.theta[rows], spectrum.torque[rows]
    columns = np.concatenate([powers * theta[..., None], powers.astype(np.complex128)], axis=2)
    scale = np.maximum(np.linalg.norm(columns, axis=1), np.finfo(float).tiny)
    U, singular, Vh = np.linalg.svd(columns / scale[:, None, :], full_matrices=False)
    projected = np.einsum("mwp,mw->mp", U.conj(), torque)
    left = torque - np.einsum("mwp,mp->mw", U, projected)
    noise = np.sum(np.abs(left) ** 2, axis=1) / LOCAL_FREEDOM
    inverse = Vh.conj().transpose(0, 2, 1) / np.maximum(singular, np.finfo(float).tiny)[:, None, :]
    Z = np.einsum("mp,mp->m", inverse[:, 0], projected) / scale[:, 0]
    variance = noise * np.sum(np.abs(inverse[:, 0]) ** 2, axis=1) / scale[:, 0] ** 2
    return Z, variance, noise, singular[:, 0] / np.maximum(singular[:, -1], np.finfo(float).tiny)


def nearby(theta: Spectrum) -> Array:
    """RMS of the angle's lines (m,) over each line and its `NEAREST` ones [rad]."""
    window = np.ones(2 * NEAREST + 1)
    return np.sqrt(np.convolve(np.abs(theta) ** 2, window, "same") / len(window))


def local_response(spectrum: RecordSpectrum) -> FrequencyResponse:
    """The impedance of a record at every `HALF_WIDTH`-th line that moves, with its noise.

    Distortion of a motion that does not repeat itself is noise: `total_sd` equals `noise_sd`, levels are not known.
    """
    found = local_fit(spectrum)
    at = np.arange(HALF_WIDTH // 2, len(found.noise), HALF_WIDTH)
    at = at[np.isfinite(found.variance[at])]
    if not len(at):
        raise InputError("the joint moves at no frequency up to the filter's cut-off; move it further, or for longer")
    unknown, sd = np.full(len(at), np.nan), np.sqrt(found.variance[at])
    return FrequencyResponse(
        method=LOCAL,
        frequency_hz=spectrum.frequency_hz[at],
        impedance=found.impedance[at],
        angle=nearby(spectrum.theta)[at],
        noise_sd=sd,
        total_sd=sd,
        noise_level=sd,
        odd_level=unknown,
        even_level=unknown,
        total_level=unknown,
    )
