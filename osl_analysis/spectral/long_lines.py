"""The lowest lines of a long signal, and a signal from its lowest lines, where a Fourier transform of all has no room.

A transform needs several times the room of its signal, and where the length has a large prime factor some times more.
Every D-th sample of a signal is a signal of its own, whose part of each line follows from a chirp transform (Bluestein,
IEEE Trans. Audio Electroacoust. 18, 1970). All are exact to rounding, whatever the length.
"""

import numpy as np
import scipy
from numpy.typing import NDArray

from osl_analysis.trial import Array

Spectrum = NDArray[np.complex128]
SHORT = 1 << 19
"""Samples up to which a signal is transformed at once."""
SHARES = 32
"""Parts of a longer signal, each of every so many-th of its samples, that are transformed one after the other."""


def lines(signal: Array, period: int, count: int) -> Spectrum:
    """Lines 0 to count - 1 of a signal (n,) that is 0 from n on to its `period`: `np.fft.rfft(signal, period)`."""
    if period <= SHORT:
        return np.asarray(np.fft.rfft(signal, period)[:count])
    found, k = np.zeros(count, dtype=np.complex128), np.arange(count)
    for first in range(SHARES):
        part = chirp_transform(signal[first::SHARES].astype(np.complex128), SHARES, period, count)
        found += part * turn(first * k, period)
    return found


def from_lines(spectrum: Spectrum, period: int, n: int) -> Array:
    """The first n samples of the signal of a `period` with these lowest lines: `np.fft.irfft(spectrum, period)[:n]`."""
    if period <= SHORT:
        return np.asarray(np.fft.irfft(spectrum, period)[:n])
    signal, k = np.empty(n), np.arange(len(spectrum))
    weight = np.where((k == 0) | (2 * k == period), 1.0, 2.0) / period
    for first in range(SHARES):
        part = signal[first::SHARES]
        conjugate = (spectrum * weight).conj() * turn(first * k, period)
        part[:] = chirp_transform(conjugate, SHARES, period, len(part)).real
    return signal


def chirp_transform(values: Spectrum, step: int, period: int, count: int) -> Spectrum:
    """Sums over m of values (n,) times exp(-2j pi step m k/period), for k from 0 to count - 1.

    With 2 m k = m^2 + k^2 - (k - m)^2 each is a convolution.
    """
    n = len(values)
    chirp = turn(step * np.arange(max(n, count)) ** 2, 2 * period)
    size = scipy.fft.next_fast_len(n + count - 1)
    kernel = np.zeros(size, dtype=np.complex128)
    kernel[:count] = chirp[:count].conj()
    kernel[size - n + 1 :] = chirp[n - 1 : 0 : -1].conj()
    kernel = scipy.fft.fft(kernel, overwrite_x=True)
    kernel *= scipy.fft.fft(values * chirp[:n], size)
    return np.asarray(scipy.fft.ifft(kernel, overwrite_x=True)[:count] * chirp[:count])


def turn(numerator: NDArray[np.int64], denominator: int) -> Spectrum:
    """exp(-2j pi numerator/denominator), of whole numbers, so that no digit of a long turn is lost."""
    return np.asarray(np.exp(-2j * np.pi * (numerator % denominator) / denominator))
