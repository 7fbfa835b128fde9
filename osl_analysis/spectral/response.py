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

The residual of the least-squares fit is the noise."""

from collections.abc import Mapping, Sequence

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


def response_columns(
    frequency_hz: Array,
    Z: Spectrum,
    angle: Array,
    total_sd: Array,
    levels: Mapping[str, Array],
    count: int = 1,
) -> ResponseColumns:
    """Columns of Z = torque/theta [N*m/rad] of `count` realisations, the RMS amplitude of the angle
    [rad] over these, and the standard deviation of Z by noise and distortion. `levels` are the
    errors of Z in one realisation, (E|.|^2)^1/2 [N*m/rad], averaged over neighbouring lines:
    `noise` of the mean over periods; `odd` and `even` distortion, from lines that are not excited;
    `total`, noise and distortion, from the scatter of realisations."""
    shown = {
        "frequency_hz": frequency_hz,
        "angle_deg": np.rad2deg(angle),
        "Z_re": Z.real,
        "Z_im": Z.imag,
    }
    shown |= {"magnitude": np.abs(Z), "phase_deg": np.rad2deg(np.angle(Z))}
    shown |= {"noise_sd": levels["noise"] / np.sqrt(count), "total_sd": total_sd}
    return shown | {f"{name}_level": level for name, level in levels.items()}


def periodic_response(realisations: Sequence[Realisation]) -> ResponseColumns:
    """The best linear approximation of one or several realisations at the excited lines, and its
    residual. Lines of realisations are rotated by the phases of the angle and averaged before the
    division: noise of the angle biases a mean of quotients. The residual, torque - Z theta,
    includes the effect of the angle's noise and distortion.

    With one realisation the total is the level at lines without excitation, interpolated. With
    several of an odd motion the excited lines show the odd distortion, too. In another motion every
    line shows both, and counts as odd. Raises InputError: as `lines_of`."""
    single = distinct(realisations)
    lines, count = lines_of(single), len(single)
    theta, torque = np.array([r.mean_lines for r in single]).swapaxes(0, 1)
    size = np.abs(theta)
    turn = np.divide(theta.conj(), size, out=np.ones_like(theta), where=size > 0)
    at, k = np.flatnonzero(lines.excited), np.arange(theta.shape[1])
    Z = (torque * turn).sum(axis=0)[at] / size.sum(axis=0)[at]
    everywhere = np.interp(k, at, Z.real) + 1j * np.interp(k, at, Z.imag)
    mean_angle = size.mean(axis=0)[at]
    of_mean = np.mean(
        [scatter(r.spectra[1] - everywhere * r.spectra[0]) / r.periods for r in single], axis=0
    )
    noise = smoothed_lines(of_mean, (k > 0).astype(float))[at]
    square = np.mean(np.abs(torque - everywhere * theta) ** 2, axis=0)
    # excited lines have one degree of freedom less, because Z was fitted there
    square = np.asarray(np.where(lines.excited, square * count / max(count - 1, 1), square))
    several = lines.excited & (count > 1)
    odd, even = (
        (lines.odd, lines.even)
        if lines.only_odd
        else (lines.odd | lines.even, np.zeros_like(lines.even))
    )

    def distortion(kind: NDArray[np.bool_]) -> Array:
        """E|distortion|^2 near each excited line, from lines of one kind (lines,), less the noise
        in them."""
        if not kind.any():
            return np.full(len(at), np.nan)
        shown = np.flatnonzero(kind)
        above = np.maximum(smoothed_lines(square - of_mean, kind.astype(float))[shown], 0.0)
        return np.asarray(np.interp(at, shown, above))

    of_odd = distortion(odd | several)
    total = smoothed_lines(square, lines.excited.astype(float))[at] if count > 1 else noise + of_odd
    seen = total if count > 1 else np.full(len(at), np.nan)
    squares = {"noise": noise, "odd": of_odd, "even": distortion(even), "total": seen}
    levels = {name: np.sqrt(each) / mean_angle for name, each in squares.items()}
    total_sd = np.sqrt(total / count) / mean_angle
    return response_columns(single[0].frequency_hz[at], Z, mean_angle, total_sd, levels, count)


HALF_WIDTH = 8  # number of lines to each side that are fitted together with a line
# complex degrees of freedom of the noise at a line, beside two parabolas
LOCAL_FREEDOM = 2 * HALF_WIDTH + 1 - 2 * 3
RecordLines = tuple[Array, Spectrum, Spectrum]
"""Frequencies [Hz], lines of the angle [rad] and of the torque [N*m] of a whole stretch of a
record, (lines,) each."""


def record_spectrum(theta: Array, torque: Array, rate_hz: float, highest_hz: float) -> RecordLines:
    """Lines 1, 2 ... of angle [rad] and torque [N*m], shape (n,) each, over the whole stretch, up
    to `highest_hz`, without a window. The effects of the record's ends and of a drift of the torque
    are fitted together with a second-order joint and subtracted from the torque; the remainder of
    these effects is smooth over frequency."""
    n = len(theta)
    top = int(np.floor(min(highest_hz, rate_hz / 3) * n / rate_hz)) + 1
    for name, signal in (("the angle", theta), ("the torque", torque)):
        check_measured(name, signal)
    if top < 2 * HALF_WIDTH + 2:
        raise InputError(
            f"{n / rate_hz:.3g} s have {top - 1} lines up to {highest_hz:g} Hz, a frequency"
            f" response needs {2 * HALF_WIDTH + 1}; record for longer"
        )
    angle, force = (
        np.fft.rfft(signal - np.mean(signal))[1:top] * (2 / n) for signal in (theta, torque)
    )
    frequency = np.arange(1, top) * rate_hz / n
    s = np.asarray(2j * np.pi * frequency, dtype=np.complex128)
    # Coefficients are real. The ends add a + b s to Eq. 15, and some more powers because samples
    # are summed instead of integrated; the last column is a drift's.
    ends = np.array([*(s**power for power in range(5)), 1 / s])
    columns = np.concatenate([np.array([angle, s * angle, s**2 * angle]), ends])
    scale = np.linalg.norm(columns, axis=1)[:, None]
    stacked = np.hstack([(columns / scale).real, (columns / scale).imag]).T
    found = np.linalg.lstsq(stacked, np.concatenate([force.real, force.imag]), rcond=None)[0]
    return frequency, angle, np.asarray(force - found[3:] @ (ends / scale[3:]))


def local_fit(spectrum: RecordLines) -> tuple[Spectrum, Array, Array]:
    """The local polynomial method at every line of a record (lines,): Z [N*m/rad] and E|error|^2 of
    it, NaN where the joint does not move, and E|noise|^2 of a line of the torque [(N*m)^2]. Near
    the ends windows are one-sided."""
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
    """The impedance of a record at every `HALF_WIDTH`-th line that moves, with its noise. Without
    repeats distortion counts as noise: `total_sd` equals `noise_sd`, and levels are not known."""
    Z, variance, noise = local_fit(spectrum)
    at = np.arange(HALF_WIDTH // 2, len(noise), HALF_WIDTH)
    at = at[np.isfinite(variance[at])]
    if not len(at):
        raise InputError(
            "the joint moves at no frequency up to the filter's cut-off; move it further, or for"
            " longer"
        )
    sd = np.sqrt(variance[at])
    levels = {"noise": sd} | dict.fromkeys(("odd", "even", "total"), np.full(len(at), np.nan))
    return response_columns(spectrum[0][at], Z[at], nearby(spectrum[1])[at], sd, levels)
