"""Impedance over frequency, Z = torque/theta, with noise and distortion separated.

A nonlinear joint has a best linear approximation Z: the residual torque is uncorrelated with the
motion, and behaves like noise when the phases of the lines change (Pintelon and Schoukens, System
Identification, 2012, ch. 3-4). Equal phases repeat it, so that periods differ by the noise alone.

*robust*: several realisations. The scatter of periods is the noise, that of realisations noise and
  distortion.
*fast*: one realisation of an odd motion with detection lines. They show odd distortion; even lines
  show the even one.
*local polynomial*: a motion without repeats. Near line k impedance and transient are smooth (ch.
  7):

    T(k + r) = (Z_k + z_1 r + z_2 r^2) Theta(k + r) + t_0 + t_1 r + t_2 r^2 + noise,   |r| <=
    `HALF_WIDTH`

The residual of the least-squares fit is the noise.
"""

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from osl_analysis.errors import InputError
from osl_analysis.measured import check_measured
from osl_analysis.spectral.periods import (
    Realisation,
    Spectrum,
    distinct,
    lines_of,
    scatter,
    smoothed_lines,
)
from osl_analysis.trial import Array

ResponseColumns = dict[str, Array]  # columns of `response.csv`, (m,) each; NaN if not known

HALF_WIDTH = 8  # number of lines to each side that are fitted together with a line
POWERS = 3  # coefficients of a parabola over the lines
# complex degrees of freedom of the noise at a line, beside two parabolas
LOCAL_FREEDOM = 2 * HALF_WIDTH + 1 - 2 * POWERS
# powers of s that the ends of a record add to Eq. 15: two, and some more because samples are summed
# instead of integrated
END_POWERS = range(5)
NEARBY = 5  # lines over which the size of the angle is averaged

# The local method does not tell Z where the angle or the fit is weak
MOVING = 0.01  # of the largest nearby RMS of the angle
CONDITION_LIMIT = 1e8
LARGEST_ERROR = 0.1  # of |Z|


class RecordLines(NamedTuple):
    """Lines of a whole stretch of a record, (lines,) each."""

    frequency_hz: Array
    theta: Spectrum  # [rad]
    torque: Spectrum  # [N*m]


class LocalFit(NamedTuple):
    """The local polynomial method at every line of a record, (lines,) each."""

    Z: Spectrum  # [N*m/rad]; NaN where the joint does not move
    variance: Array  # E|error|^2 of Z; NaN as Z
    noise: Array  # E|noise|^2 of a line of the torque [(N*m)^2]


def response_columns(
    frequency_hz: Array,
    Z: Spectrum,
    total_sd: Array,
    levels: Mapping[str, Array],
    count: int = 1,
) -> ResponseColumns:
    """Name the columns of a frequency response, (m,) each.

    Parameters
    ----------
    frequency_hz : Array
        [Hz].
    Z : Spectrum
        torque/theta [N*m/rad] of `count` realisations.
    total_sd : Array
        Standard deviation of Z by noise and distortion [N*m/rad].
    levels : Mapping
        Errors of Z in one realisation, (E|.|^2)^1/2 [N*m/rad], averaged over neighbouring lines:
        `noise` of the mean over periods; `odd` and `even` distortion, from lines that are not
        excited; `total`, noise and distortion, from the scatter of realisations.
    """
    return {
        "frequency_hz": frequency_hz,
        "magnitude": np.abs(Z),
        "phase_deg": np.rad2deg(np.angle(Z)),
        "noise_sd": levels["noise"] / np.sqrt(count),
        "total_sd": total_sd,
        **{f"{name}_level": level for name, level in levels.items()},
    }


def periodic_response(realisations: Sequence[Realisation]) -> ResponseColumns:
    """Find the best linear approximation of a periodic motion at the excited lines, and its
    residual.

    Parameters
    ----------
    realisations : Sequence of Realisation
        One or several, of one period.

    Returns
    -------
    ResponseColumns

    Raises
    ------
    InputError
        As `lines_of`.

    Notes
    -----
    Lines of realisations are rotated by the phases of the angle and averaged before the division:
    noise of the angle biases a mean of quotients. The residual, torque - Z theta, includes the
    effect of the angle's noise and distortion.

    With one realisation the total is the level at lines without excitation, interpolated. With
    several of an odd motion the excited lines show the odd distortion, too. In another motion every
    line shows both, and counts as odd.
    """
    motions = distinct(realisations)
    count = len(motions)
    lines = lines_of(motions)
    excited = np.flatnonzero(lines.excited)
    theta, torque = np.array([motion.mean_lines for motion in motions]).swapaxes(0, 1)
    size = np.abs(theta)
    mean_size = size.mean(axis=0)[excited]
    k = np.arange(theta.shape[1])

    rotation = np.divide(theta.conj(), size, out=np.ones_like(theta), where=size > 0)
    Z = (torque * rotation).sum(axis=0)[excited] / size.sum(axis=0)[excited]
    Z_everywhere = np.interp(k, excited, Z.real) + 1j * np.interp(k, excited, Z.imag)

    variance_of_mean = np.mean(
        [
            scatter(motion.spectra[1] - Z_everywhere * motion.spectra[0]) / motion.periods
            for motion in motions
        ],
        axis=0,
    )
    noise = smoothed_lines(variance_of_mean, (k > 0).astype(float))[excited]
    residual = np.mean(np.abs(torque - Z_everywhere * theta) ** 2, axis=0)
    # excited lines have one degree of freedom less, because Z was fitted there
    of_excited = residual * count / max(count - 1, 1)
    residual = np.asarray(np.where(lines.excited, of_excited, residual))

    def distortion(kind: NDArray[np.bool_]) -> Array:
        """E|distortion|^2 near each excited line, from lines of one kind (lines,), less the noise
        in them."""
        if not kind.any():
            return np.full(len(excited), np.nan)
        k_of_kind = np.flatnonzero(kind)
        smoothed = smoothed_lines(residual - variance_of_mean, kind.astype(float))[k_of_kind]
        return np.asarray(np.interp(excited, k_of_kind, np.maximum(smoothed, 0.0)))

    odd_lines = lines.odd
    even_lines = lines.even
    if not lines.only_odd:
        odd_lines = lines.odd | lines.even
        even_lines = np.zeros_like(lines.even)
    if count > 1:
        odd_lines = odd_lines | lines.excited
    odd = distortion(odd_lines)

    if count > 1:
        total = smoothed_lines(residual, lines.excited.astype(float))[excited]
        total_level = total
    else:
        total = noise + odd
        total_level = np.full(len(excited), np.nan)
    squares = {"noise": noise, "odd": odd, "even": distortion(even_lines), "total": total_level}
    return response_columns(
        frequency_hz=motions[0].frequency_hz[excited],
        Z=Z,
        total_sd=np.sqrt(total / count) / mean_size,
        levels={name: np.sqrt(square) / mean_size for name, square in squares.items()},
        count=count,
    )


def record_spectrum(theta: Array, torque: Array, rate_hz: float, highest_hz: float) -> RecordLines:
    """Take the lines of angle and torque over a whole stretch, without a window.

    Parameters
    ----------
    theta, torque : Array
        (n,) [rad] and (n,) [N*m].
    rate_hz : float
        Sampling rate [Hz].
    highest_hz : float
        Up to which lines go [Hz].

    Returns
    -------
    RecordLines
        Lines 1, 2, ...

    Raises
    ------
    InputError
        The stretch is too short for the local polynomial method, or a value cannot be measured.

    Notes
    -----
    The effects of the record's ends and of a drift of the torque are fitted together with a
    second-order joint and subtracted from the torque; the remainder of these effects is smooth over
    frequency.
    """
    n = len(theta)
    top = int(np.floor(min(highest_hz, rate_hz / 3) * n / rate_hz)) + 1
    check_measured("the angle", theta)
    check_measured("the torque", torque)
    if top < 2 * HALF_WIDTH + 2:
        raise InputError(
            f"{n / rate_hz:.3g} s have {top - 1} lines up to {highest_hz:g} Hz, a frequency"
            f" response needs {2 * HALF_WIDTH + 1}; record for longer"
        )
    theta_lines = np.fft.rfft(theta - np.mean(theta))[1:top] * (2 / n)
    torque_lines = np.fft.rfft(torque - np.mean(torque))[1:top] * (2 / n)
    frequency = np.arange(1, top) * rate_hz / n
    s = np.asarray(2j * np.pi * frequency, dtype=np.complex128)

    # torque = (K + B s + I s^2) theta + ends + drift/s, with real coefficients
    joint = np.array([theta_lines, s * theta_lines, s**2 * theta_lines])
    ends = np.array([*(s**power for power in END_POWERS), 1 / s])
    columns = np.concatenate([joint, ends])
    scale = np.linalg.norm(columns, axis=1)[:, None]
    scaled = columns / scale
    real_columns = np.hstack([scaled.real, scaled.imag]).T
    real_torque = np.concatenate([torque_lines.real, torque_lines.imag])
    coefficients = np.linalg.lstsq(real_columns, real_torque, rcond=None)[0]
    of_ends = coefficients[len(joint) :] @ (ends / scale[len(joint) :])
    return RecordLines(frequency, theta_lines, np.asarray(torque_lines - of_ends))


def local_fit(spectrum: RecordLines) -> LocalFit:
    """Apply the local polynomial method to every line of a record.

    Near the ends windows are one-sided.
    """
    tiny = np.finfo(float).tiny
    k = np.arange(len(spectrum.theta))
    first = np.clip(k - HALF_WIDTH, 0, len(k) - (2 * HALF_WIDTH + 1))
    window = first[:, None] + np.arange(2 * HALF_WIDTH + 1)
    r = (window - k[:, None]) / HALF_WIDTH
    powers = r[..., None] ** np.arange(POWERS)
    theta = spectrum.theta[window]
    torque = spectrum.torque[window]

    columns = np.concatenate([powers * theta[..., None], powers.astype(np.complex128)], axis=2)
    scale = np.maximum(np.linalg.norm(columns, axis=1), tiny)
    U, singular, Vh = np.linalg.svd(columns / scale[:, None, :], full_matrices=False)
    projected = np.einsum("mwp,mw->mp", U.conj(), torque)
    residual = torque - np.einsum("mwp,mp->mw", U, projected)
    noise = np.sum(np.abs(residual) ** 2, axis=1) / LOCAL_FREEDOM

    # the first coefficient is Z_k
    inverse = Vh.conj().transpose(0, 2, 1) / np.maximum(singular, tiny)[:, None, :]
    Z = np.einsum("mp,mp->m", inverse[:, 0], projected) / scale[:, 0]
    variance = noise * np.sum(np.abs(inverse[:, 0]) ** 2, axis=1) / scale[:, 0] ** 2

    condition = singular[:, 0] / np.maximum(singular[:, -1], tiny)
    size = nearby(spectrum.theta)
    is_known = (
        (size > MOVING * size.max())
        & (condition < CONDITION_LIMIT)
        & (variance < LARGEST_ERROR**2 * np.abs(Z) ** 2)
    )
    return LocalFit(np.where(is_known, Z, np.nan), np.where(is_known, variance, np.nan), noise)


def nearby(theta: Spectrum) -> Array:
    """RMS of the angle's lines (m,) over each line and two to each side [rad]."""
    return np.sqrt(np.convolve(np.abs(theta) ** 2, np.ones(NEARBY), "same") / NEARBY)


def local_response(spectrum: RecordLines) -> ResponseColumns:
    """Find the impedance of a record at every `HALF_WIDTH`-th line that moves, with its noise.

    Parameters
    ----------
    spectrum : RecordLines
        Of a motion without repeats.

    Returns
    -------
    ResponseColumns
        Without repeats distortion counts as noise: `total_sd` equals `noise_sd`, and levels are not
        known.

    Raises
    ------
    InputError
        The joint moves at no frequency.
    """
    fit = local_fit(spectrum)
    k = np.arange(HALF_WIDTH // 2, len(fit.noise), HALF_WIDTH)
    k = k[np.isfinite(fit.variance[k])]
    if not len(k):
        raise InputError(
            "the joint moves at no frequency up to the filter's cut-off; move it further, or for"
            " longer"
        )
    sd = np.sqrt(fit.variance[k])
    unknown = np.full(len(k), np.nan)
    return response_columns(
        frequency_hz=spectrum.frequency_hz[k],
        Z=fit.Z[k],
        total_sd=sd,
        levels={"noise": sd, "odd": unknown, "even": unknown, "total": unknown},
    )
