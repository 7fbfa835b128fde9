# SPDX-License-Identifier: Apache-2.0
"""Whitening by the noise's own spectrum: after it, least squares is maximum likelihood.

Load cells drift, persons lean on benches, and amplifiers hum: the noise of a torque is not white.
The residual of a model that is richer than any candidate model has its spectrum (generalised least
squares with an estimated covariance; Ljung, System Identification, 1999, ch. 7). Divided by its
root, torque and columns have white noise of variance 1, whatever the noise was. No trend or
high-pass has to be chosen.
"""

from functools import cached_property

import numpy as np
import scipy

from osl_analysis.base.errors import NotWeighedError
from osl_analysis.base.trial import Array
from osl_analysis.inference.model_names import ModelName
from osl_analysis.inference.spectra import (
    WorkingSpectra,
    friction_torques,
    scaled_normal,
    solve_scaled,
)
from osl_analysis.model.drivetrain import Spectrum

# Width over which the noise's spectrum is averaged [Hz]; 45 lines in a minute, as many as Welch's
# estimate averages in segments of 4 s
COLOUR_BAND = 0.75

SPECTRUM_ROUNDS = 2  # the second one weighs the rich model by the spectrum that the first one found
LEAST_GAIN = 0.03  # of the roll-off's power, below which the spectrum is not divided by it
# variance of the noise over the torque's mean square: a torque without noise has rounding, which is
# not divided by, since its spectrum says nothing
NOISE_ROUNDING = 1e-20
# of the recording, beside its middle, after which stiffness and damping may be others in the rich
# model; each adds two columns
OTHER_MOMENTS = (0.25, 0.75)
# of the noise beside the motion, that columns may take up: of sound multisines of 0.3 to 2.5 Hz
# half are accused at 0.4 (10 s), one of ten at 0.2 (20 s)
MOST_TAKEN = 0.3
LEAST_LEFT = 0.1  # of the noise of a line that columns take up nearly all of: it is not known there
OF_MOTION = 0.95  # share of the angle's power, whose lines are the motion
SLOW_POWERS = 4  # offset and drift: powers of time from 0


class Whitened:
    """Torque and columns of one recording with white noise of variance 1, in its m fitted rows.

    Attributes
    ----------
    spectra : WorkingSpectra
        The recording.
    torque : Array (m,)
        Whitened torque.
    columns : dict
        Whitened columns (k, m) by their names: `derivatives` of the angle, shapes of dry
        `friction`, `slow` ones of offset and drift, and what candidate models of Eq. 15 add to it.
    motion : Array (3, m)
        Whitened angle, velocity, acceleration, whose coefficients are K, B and I.
    rich : Array (k, m)
        Whitened columns of what any candidate model may add to the torque, to first order.
    gain : Array (f,)
        By which the spectra of windowed signals are whitened [1/(N*m)].
    mean_friction : Array (k,)
        Mean torque of each shape of friction over its coefficient.
    """

    def __init__(self, spectra: WorkingSpectra) -> None:
        self.spectra = spectra
        friction = friction_torques(spectra)
        self.mean_friction = np.abs(friction[:, spectra.inside]).mean(axis=1)
        products = {"friction": friction, **products_of_models(spectra, friction[0])}
        products["slow"] = np.vander(spectra.relative_time - 0.5, SLOW_POWERS, increasing=True).T

        parts = {"derivatives": spectra.derivatives}
        parts |= {name: spectra.spectrum_of(x) for name, x in products.items()}
        signals = spectra.windowed(np.concatenate([*parts.values(), spectra.torque[None]]))
        self.gain = whitening_gain(spectra, signals)
        rows = self._rows(signals)
        self.torque = rows[-1]
        self.rich = rows[: -1 - SLOW_POWERS]
        ends = np.cumsum([len(part) for part in parts.values()])
        self.columns = dict(zip(parts, np.split(rows, ends), strict=False))
        self.motion = self.columns["derivatives"][:3]

    @cached_property
    def friction_impedances(self) -> Array:
        """K, B, I (k, 3) [SI] that Eq. 15 without friction reads of each shape of friction of
        1 N*m, beside offset and drift."""
        columns = np.concatenate([self.motion, self.shared(False)])
        return np.array([solve_scaled(columns, shape)[:3] for shape in self.columns["friction"]])

    def shared(self, has_friction: bool) -> Array:
        """Columns (k, m) that all candidate models share: of friction, offset and drift."""
        slow = self.columns["slow"]
        return np.concatenate([self.columns["friction"], slow]) if has_friction else slow

    def column(self, spectrum: Spectrum) -> Array:
        """Whiten the signals with these working spectra (..., f); returns rows (..., m)."""
        return self._rows(self.spectra.windowed(spectrum))

    def _rows(self, windowed: Spectrum) -> Array:
        """The whitened rows (..., m) of windowed signals with these spectra (..., f)."""
        whitened = scipy.fft.irfft(self.gain * windowed, self.spectra.working_rows)
        return whitened[..., self.spectra.rows]


def whitening_gain(spectra: WorkingSpectra, signals: Spectrum) -> Array:
    """Find the whitening gain (f,) from what a rich model leaves of the torque.

    Parameters
    ----------
    spectra : WorkingSpectra
        The recording.
    signals : Spectrum (k + 1, f)
        Windowed columns of the rich model; the torque is last.
    """
    rows = np.sum(spectra.window**2)
    passed = rows * np.maximum(spectra.roll_off**2, LEAST_GAIN)
    torque_variance = np.mean(np.abs(signals[-1]) ** 2) / rows
    least = NOISE_ROUNDING * max(torque_variance, np.finfo(float).tiny)
    lines = max(round(COLOUR_BAND * spectra.padded_seconds), 1)
    gain = np.ones_like(spectra.frequency)
    for _ in range(SPECTRUM_ROUNDS):
        # a sum of squares is the same over time and over frequency (Parseval)
        weighed = (gain * signals).view(float)
        estimates = solve_scaled(weighed[:-1], weighed[-1])
        left = np.abs(signals[-1] - estimates @ signals[:-1]) ** 2
        power = scipy.ndimage.uniform_filter1d(left / passed, lines, mode="nearest")
        gain = 1 / np.sqrt(np.maximum(power, least))
    # the columns take up their share of the noise, of as many independent lines as there are rows
    # in the window
    taken = leverage(weighed[:-1]) * spectra.working_rows / rows
    taken = scipy.ndimage.uniform_filter1d(taken, lines, mode="nearest")
    gain *= np.sqrt(np.maximum(1 - taken, LEAST_LEFT))
    power_up_to = np.cumsum(np.abs(signals[0]) ** 2)
    is_motion = power_up_to < OF_MOTION * power_up_to[-1]
    is_motion[0] = True
    taken_of_motion = taken[is_motion].mean()
    if taken_of_motion > MOST_TAKEN:
        raise NotWeighedError(
            f"the recording is too short: columns of candidate models take up {taken_of_motion:.2f}"
            f" of the noise beside the motion, at most {MOST_TAKEN:g} is allowed",
            "record for longer",
        )
    return gain


def leverage(columns: Array) -> Array:
    """Share (f,) of the noise in each complex line that columns (k, 2 f) of real and imaginary
    parts take up: the diagonal of their hat matrix."""
    normal, length = scaled_normal(columns)
    # columns times the root of the inverse, whose squares are the diagonal
    rooted = np.linalg.inv(np.linalg.cholesky(normal)) / length @ columns
    of_parts = np.einsum("kf,kf->f", rooted, rooted)
    return of_parts.reshape(-1, 2).mean(axis=1)


def products_of_models(spectra: WorkingSpectra, sign: Array) -> dict[str, Array]:
    """What candidate models of Eq. 15 add to it (k, p), by their names, with the smoothed `sign`
    (p,) of the velocity. The first ones change K, B and I, where these are not one number. Those
    after other moments belong to no candidate model: they make the model of the noise richer."""
    angle, theta, omega = spectra.angle, spectra.theta, spectra.omega
    centred_time = spectra.relative_time - 0.5
    products = {
        ModelName.DAMPING_BY_SPEED: [omega * np.abs(omega)],
        ModelName.NONLINEAR_SPRING: [angle**2, angle**2 * angle],
        ModelName.K_BY_SIDE: [np.abs(angle)],
        ModelName.K_AND_B_BY_DIRECTION: [angle * sign, np.abs(omega)],
        ModelName.CHANGE_OVER_TIME: [x * centred_time for x in (theta, omega, spectra.alpha)],
        ModelName.CHANGE_AT_ONCE: [x * (centred_time > 0) for x in (theta, omega)],
        "change at other moments": [
            x * (spectra.relative_time > moment) for moment in OTHER_MOMENTS for x in (theta, omega)
        ],
    }
    return {name: np.array(columns) for name, columns in products.items()}
