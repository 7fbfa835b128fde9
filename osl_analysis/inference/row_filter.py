"""The fitted rows of a recording's signals, behind a filter."""

import numpy as np
import scipy
from numpy.typing import NDArray

from osl_analysis.inference.spectra import Spectra, Spectrum
from osl_analysis.trial import Array


class RowFilter:
    """Takes the m fitted rows of signals, behind a filter.

    Parameters
    ----------
    spectra : Spectra
        The recording.
    gain : Array (f,), optional
        Gain of the filter; none by default.
    """

    def __init__(self, spectra: Spectra, gain: Array | None = None) -> None:
        self.spectra = spectra
        self.gain = gain
        self._kept = contiguous(spectra.rows)

    def column(self, spectrum: Spectrum) -> Array:
        """Rows (..., m) of the signals with these working spectra (..., f)."""
        spectra = self.spectra
        return self.windowed(scipy.fft.irfft(spectrum * spectra.roll_off, spectra.working_rows))

    def windowed(self, x: Array) -> Array:
        """Rows (..., m) of signals (..., w) at the working rate."""
        x = x * self.spectra.window
        if self.gain is None:
            return np.asarray(x[..., self._kept])
        return self._filtered(x, self.gain)

    def of_rows(self, rows: Array) -> Array:
        """Rows (..., m) of signals that are given by such rows, and are 0 elsewhere."""
        if self.gain is None:
            return rows
        everywhere = np.zeros((*rows.shape[:-1], self.spectra.working_rows))
        everywhere[..., self._kept] = rows
        return self._filtered(everywhere, self.gain)

    def of_rows_one_by_one(self, columns: Array) -> Array:
        """The same of columns (k, m), of which all at once would be the peak of memory."""
        if self.gain is None:
            return columns
        filtered = np.empty_like(columns)
        for k, column in enumerate(columns):
            filtered[k] = self.of_rows(column)
        return filtered

    def _filtered(self, x: Array, gain: Array) -> Array:
        filtered = scipy.fft.irfft(scipy.fft.rfft(x) * gain, self.spectra.working_rows)
        return np.asarray(filtered[..., self._kept])


def contiguous(rows: NDArray[np.bool_]) -> slice | NDArray[np.bool_]:
    """Rows (w,) of a recording without gaps as a slice, which copies nothing."""
    at = np.flatnonzero(rows)
    if len(at) and at[-1] - at[0] + 1 == len(at):
        return slice(int(at[0]), int(at[-1]) + 1)
    return rows
