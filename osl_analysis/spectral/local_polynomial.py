"""Impedance over frequency from a motion that does not repeat itself: the local polynomial method.

Near line k the impedance, and the transient at the ends of the record, are smooth:

    T(k + r) = (Z_k + z_1 r + z_2 r^2) Theta(k + r) + t_0 + t_1 r + t_2 r^2 + noise,   |r| <= `HALF_WIDTH`

(Pintelon and Schoukens, System Identification, 2012, ch. 7). What the least-squares fit leaves is the noise. For K, B
and I fit the lines themselves: a fit to Z_k loses a factor of two, since neighbours share their lines.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from osl_analysis.errors import InputError
from osl_analysis.measured import check_measured
from osl_analysis.spectral.period import Spectrum
from osl_analysis.spectral.response import LOCAL, FrequencyResponse
from osl_analysis.trial import Array

HALF_WIDTH = 8
"""Lines to each side of a line that are fitted together with it."""
ORDER = 2
"""Order of the polynomials."""
LOCAL_FREEDOM = 2 * HALF_WIDTH + 1 - 2 * (ORDER + 1)
"""Complex degrees of freedom of the noise at a line."""
END_POWERS = 5
"""Powers of s that the ends of a record add."""
WEAK, NEAREST = 0.01, 2
"""RMS of the angle at a line and its `NEAREST` ones to each side, as a share of the largest one, below which the
impedance is not known."""
UNKNOWN = 0.1
"""Standard deviation of an impedance, as a share of it, from which on it is not known."""
LARGEST_CONDITION = 1e8
"""Largest condition number of a local fit, its columns scaled."""


@dataclass(frozen=True)
class RecordSpectrum:
    """Lines of a whole stretch of a record, shape (lines,); line k is the sine Re(X_k exp(2j pi f_k t)), k >= 1."""

    frequency_hz: Array
    """Frequency [Hz]."""
    theta: Spectrum
    """Lines of the angle [rad]."""
    torque: Spectrum
    """Lines of the torque [N*m]."""


@dataclass(frozen=True)
class LocalFit:
    """Result of the local polynomial method at each line, shape (lines,); NaN where the joint does not move."""

    impedance: Spectrum
    """Z [N*m/rad]."""
    variance: Array
    """E|error|^2 of Z [(N*m/rad)^2]."""
    noise: Array
    """E|noise|^2 of a line of the torque [(N*m)^2], with `LOCAL_FREEDOM` complex degrees of freedom."""


def record_spectrum(theta: Array, torque: Array, rate_hz: float, highest_hz: float) -> RecordSpectrum:
    """Lines 1, 2 ... of angle [rad] and torque [N*m], shape (n,) each, over the whole stretch, up to `highest_hz`.

    No window is applied. What the ends of the record and a drift of the torque add (`end_columns`) is fitted together
    with a second-order joint and subtracted from the torque. What is left of it is smooth over frequency.

    Raises
    ------
    InputError
        A value cannot be measured, or the stretch has fewer lines than a local fit needs.
    """
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
    """What the ends of a record and a drift of the torque add to its lines, with real coefficients, (q, lines).

    The ends of Eq. 15 add a + b s, and some more powers because its samples are summed where it has integrals.
    """
    return np.array([*(s**power for power in range(END_POWERS)), 1 / s])


def local_fit(spectrum: RecordSpectrum) -> LocalFit:
    """The local polynomial method at every line of a record; near the first and last line the windows are one-sided."""
    Z, variance, noise, condition = local_fit_at(spectrum, np.arange(len(spectrum.theta)))
    size = nearby(spectrum.theta)
    known = (size > WEAK * size.max()) & (condition < LARGEST_CONDITION)
    known &= variance < UNKNOWN**2 * np.abs(Z) ** 2
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

    Raises
    ------
    InputError
        The joint moves at no line.
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
