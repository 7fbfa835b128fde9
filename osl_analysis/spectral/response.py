"""Impedance over frequency without a model, Z = torque/theta, with noise and nonlinear distortion told apart.

A nonlinear joint has a best linear approximation Z: what is left of the torque is not correlated with the motion, and
behaves like noise when the phases of the lines change (Pintelon and Schoukens, System Identification, 2012, ch. 3-4).
The same phases repeat it, so that periods show the noise alone.

*robust*: several realisations. The scatter of periods is the noise, that of realisations noise and distortion.
*fast*: one realisation of an odd motion with detection lines. They show the odd distortion, even lines the even one.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from osl_analysis.spectral.lines import Lines, lines_of, scatter, smoothed
from osl_analysis.spectral.period import Spectrum
from osl_analysis.spectral.realisations import Realisation, distinct
from osl_analysis.trial import Array

ROBUST, FAST, LOCAL = "robust", "fast", "local polynomial"
"""Methods: several realisations, one, motion that does not repeat itself."""


@dataclass(frozen=True)
class FrequencyResponse:
    """Impedance over frequency, shape (m,) each; NaN where the motion does not show it.

    Levels are what is added to Z that is measured in one realisation, as a standard deviation of the complex number
    (E|.|^2)^1/2, averaged over neighbouring lines.
    """

    method: str
    """One of `ROBUST`, `FAST`, `LOCAL`."""
    frequency_hz: Array
    """Frequency [Hz]."""
    impedance: Spectrum
    """Z = torque/theta [N*m/rad]."""
    angle: Array
    """Amplitude of the angle at this frequency [rad], RMS over realisations."""
    noise_sd: Array
    """Standard deviation of Z by noise [N*m/rad]."""
    total_sd: Array
    """Standard deviation of Z by noise and distortion [N*m/rad]."""
    noise_level: Array
    """Noise in the mean over the periods of one realisation [N*m/rad]."""
    odd_level: Array
    """Odd distortion, from odd lines that are not excited and the scatter of realisations, without the noise
    [N*m/rad]."""
    even_level: Array
    """Even distortion, from even lines that are not excited, without the noise [N*m/rad]."""
    total_level: Array
    """Noise and distortion, from the scatter of realisations [N*m/rad]."""


@dataclass(frozen=True)
class BandLevels:
    """Levels over the excited band: RMS amplitude of the torque per line [N*m], in one realisation; NaN if not seen."""

    torque: float
    """The torque itself at the excited lines."""
    noise: float
    """Noise in the mean over the periods."""
    odd: float
    """Odd distortion at all odd lines that show it, without the noise."""
    even: float
    """Even distortion, without the noise."""
    detection: float
    """Distortion at the lines without excitation that show what excited lines have, without the noise."""
    distortion: float
    """Distortion at the excited lines from the scatter of realisations, without the noise."""


@dataclass(frozen=True)
class EquationError:
    """torque - Z theta of several realisations; what the angle's own noise and distortion do to Z is in it."""

    lines: Lines
    frequency_hz: Array
    """Frequencies of the lines [Hz], shape (lines,)."""
    impedance: Spectrum
    """Z (lines,) [N*m/rad]; between excited lines it is interpolated."""
    angle: Array
    """Sum over realisations of the amplitudes of the angle (lines,) [rad]."""
    error: Spectrum
    """Mean over the periods (realisations, lines) [N*m]."""
    noise: Array
    """E|noise|^2 of this mean, from the scatter of periods, (realisations, lines) [(N*m)^2]."""
    freedom: Array
    """Degrees of freedom of the noise at each line of each realisation, (realisations,)."""


def equation_error(realisations: Sequence[Realisation]) -> EquationError:
    """The best linear approximation at the excited lines, and what it leaves at all lines.

    The phases of the angle are the reference: turned by them, the lines of realisations are averaged before they are
    divided. The mean of quotients would be biased by noise of the angle.

    Raises
    ------
    InputError
        As `lines_of`.
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

    Raises
    ------
    InputError
        As `lines_of`.
    """
    found = equation_error(realisations)
    at, count = np.flatnonzero(found.lines.excited), len(found.error)
    mean_angle = found.angle[at] / count
    noise = smoothed(found.noise.mean(axis=0), (np.arange(len(found.angle)) > 0).astype(float))[at]
    square = mean_square(found)
    kinds = showing(found.lines, count)
    odd, even = (without_noise(square, found.noise, kind) for kind in kinds)
    between = smoothed(square, found.lines.excited.astype(float))[at]
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
    above = smoothed(square - noise.mean(axis=0), kind.astype(float))[at]
    return np.asarray(np.interp(k, at, np.maximum(above, 0.0)))


def mean_square(found: EquationError) -> Array:
    """E|error|^2 over realisations (lines,); at excited lines, where Z was fitted to them, with one degree less."""
    square = np.mean(np.abs(found.error) ** 2, axis=0)
    count = len(found.error)
    return np.asarray(np.where(found.lines.excited, square * count / max(count - 1, 1), square))


def showing(lines: Lines, realisations: int) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """Lines (lines,) that show the odd and the even distortion.

    Of several realisations of an odd motion the excited lines show the odd distortion too. Of another motion every line
    shows both, and counts as odd.
    """
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
