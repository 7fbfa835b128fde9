"""The fitted rows of a recording's signals, behind a filter."""

from collections.abc import Callable
from typing import Any

import numpy as np
import scipy
from numpy.typing import NDArray

from osl_analysis.inference.spectra import SIGNALS_AT_ONCE, Spectra, Spectrum
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

    def column(self, spectrum: Spectrum) -> Array:
        """Rows (..., m) of the signals with these working spectra (..., f)."""
        spectra = self.spectra

        def windowed(part: Spectrum) -> Array:
            x = scipy.fft.irfft(part * spectra.roll_off, spectra.working_rows)
            x *= spectra.window  # in place, since new memory takes as long as a transform
            return np.asarray(x)

        return self._rows(spectrum, windowed)

    def of_rows(self, rows: Array) -> Array:
        """Rows (..., m) of signals that are given by such rows, and are 0 elsewhere."""
        if self.gain is None:
            return rows

        def everywhere(part: Array) -> Array:
            x = np.zeros((len(part), self.spectra.working_rows))
            for of_all, of_rows in self.spectra.pieces:
                x[:, of_all] = part[:, of_rows]
            return x

        return self._rows(rows, everywhere)

    def _rows(self, signals: NDArray[Any], windowed: Callable[[NDArray[Any]], Array]) -> Array:
        """Rows (..., m) of signals (..., n), a few at once, that are made windowed ones (k, w)."""
        one_by_one = signals.reshape(-1, signals.shape[-1])
        rows = np.empty((len(one_by_one), self.spectra.fitted_rows))
        for first in range(0, len(rows), SIGNALS_AT_ONCE):
            part = slice(first, first + SIGNALS_AT_ONCE)
            x = windowed(one_by_one[part])
            if self.gain is not None:
                spectrum = scipy.fft.rfft(x)
                spectrum *= self.gain
                x = scipy.fft.irfft(spectrum, self.spectra.working_rows)
            rows[part] = self.spectra.fitted(x)
        return rows.reshape(*signals.shape[:-1], self.spectra.fitted_rows)
