"""Whitening by the noise's own spectrum: after it, least squares is maximum likelihood.

Load cells drift, persons lean on benches, and amplifiers hum: the noise of a torque is not white.
The residual of a model that is richer than any rival has its spectrum (generalised least
squares with an estimated covariance; Ljung, System Identification, 1999, ch. 7). Divided by its
root, torque and columns have white noise of variance 1, whatever the noise was. No trend or
high-pass has to be chosen.
"""

from collections.abc import Mapping
from functools import cached_property

import numpy as np
import scipy

from osl_analysis.inference.actuator import frictionless_actuator
from osl_analysis.inference.constants import COLOUR_SEGMENT, RIDGE, TINY
from osl_analysis.inference.friction_shapes import friction_torques, sliding_velocity
from osl_analysis.inference.spectra import Spectra, Spectrum
from osl_analysis.trial import Array

ROUNDS = 2  # the second one weighs the rich model by the spectrum that the first one found
LEAST_GAIN = 0.03  # of the roll-off's power, below which the spectrum is not divided by it
# variance of the noise over the torque's mean square: a torque without noise has rounding, which is
# not divided by, since its spectrum says nothing
LEAST_NOISE = 1e-20
# of the recording, beside its middle, after which stiffness and damping may be others in the rich
# model; each adds two columns
OTHER_MOMENTS = (0.25, 0.375, 0.625, 0.75)
SLOW_POWERS = 4  # offset and drift: powers of time from 0


def solve_scaled(columns: Array, torque: Array) -> Array:
    """Estimate the coefficients (k,) of columns (k, m) for a torque (m,)."""
    products = columns @ columns.T
    length = np.sqrt(products.diagonal()) + TINY
    normal = products / np.outer(length, length) + RIDGE * np.eye(len(length))
    estimates = np.linalg.solve(normal, columns @ torque / length) / length
    # one step of refinement takes off what rounding of the normal matrix has added
    left = torque - estimates @ columns
    return np.asarray(estimates + np.linalg.solve(normal, columns @ left / length) / length)


class Whitened:
    """Torque and columns of one recording with white noise of variance 1, in its m fitted rows.

    Attributes
    ----------
    spectra : Spectra
        The recording.
    torque : Array (m,)
        Whitened torque.
    motion : Array (3, m) or (4, m)
        Whitened angle, velocity, acceleration, whose coefficients are K, B and I. The angle of a
        drivetrain's actuator is the fourth.
    actuator : FrictionlessActuator or None
        What that actuator would do without its friction.
    impedance_matrix : Array (3, 3) or (3, 4)
        Turns the coefficients of `motion` into K, B and I.
    slow : Array (4, m)
        Offset and drift of the torque.
    friction : Array (k, m)
        Shapes of dry friction.
    mean_friction : Array (k,)
        Mean torque of each shape over its coefficient.
    added : dict
        Further columns (p,) of rivals of Eq. 15 by their names, at the product rate.
    """

    def __init__(self, spectra: Spectra) -> None:
        self.spectra = spectra
        velocity, width = sliding_velocity(spectra)
        self.added = added_columns(spectra, np.tanh(velocity / width))
        shapes = friction_torques(spectra)
        friction = spectra.spectrum_of(shapes)
        powers = np.array([(spectra.relative_time - 0.5) ** k for k in range(SLOW_POWERS)])
        slow = spectra.spectrum_of(powers)

        self._rich_spectra = rich_columns(spectra, self.added, friction)
        self._gain = whitening_gain(spectra, np.concatenate([self._rich_spectra, slow]))

        self.torque = self.column(spectra.torque)
        self.motion = self.column(spectra.motion)
        self.actuator = None
        self.impedance_matrix = np.eye(3)
        if spectra.actuator_derivatives is not None:
            self.actuator = frictionless_actuator(spectra)
            columns = [self.impedance_matrix, self.actuator.impedance_column]
            self.impedance_matrix = np.column_stack(columns)
        self.slow = self.column(slow)
        self.friction = self.column(friction)
        self.mean_friction = np.abs(shapes[:, spectra.inside]).mean(axis=1)

    @cached_property
    def higher_motion(self) -> Array:
        """Whitened angle and its first four derivatives (5, m)."""
        return self.column(self.spectra.derivatives)

    def shared(self, has_friction: bool) -> Array:
        """Columns (k, m) that all rivals share: of friction, offset and drift."""
        if has_friction:
            return np.concatenate([self.friction, self.slow])
        return self.slow

    def rich(self) -> Array:
        """Whitened columns (k, m) of what any rival may add to the torque."""
        return self.column(self._rich_spectra)

    def column(self, spectrum: Spectrum) -> Array:
        """Whiten the signals with these working spectra (..., f); returns rows (..., m)."""
        return self.spectra.rows_of(spectrum, self._gain)

    def white_noise(self, density: float) -> float:
        """Sum of squares that white noise of this density [(N*m)^2/Hz] has in the fitted rows."""
        spectra = self.spectra
        passed = np.mean((self._gain * spectra.roll_off) ** 2)
        return float(
            density * spectra.working_rate_hz / 2 * passed * np.count_nonzero(spectra.rows)
        )

    def of_product(self, x: Array) -> Array:
        """Whiten signals (..., p) at the product rate; returns rows (..., m)."""
        return self.column(self.spectra.spectrum_of(x))


def whitening_gain(spectra: Spectra, rich: Spectrum) -> Array:
    """Find the whitening gain (f,) from what a rich model leaves of the torque.

    Parameters
    ----------
    spectra : Spectra
        The recording.
    rich : Spectrum (k, f)
        Columns of the rich model.
    """
    plain_columns = spectra.rows_of(rich)
    plain_torque = spectra.rows_of(spectra.torque)
    segment = min(round(COLOUR_SEGMENT * spectra.working_rate_hz), plain_torque.shape[-1])

    gain = np.ones_like(spectra.frequency)
    for _ in range(ROUNDS):
        columns = spectra.filtered_rows(plain_columns, gain)
        torque = spectra.filtered_rows(plain_torque, gain)
        estimates = solve_scaled(columns, torque)
        residual = plain_torque - estimates @ plain_columns
        frequency, power = scipy.signal.welch(
            residual, spectra.working_rate_hz, nperseg=segment, detrend=False
        )
        passed = np.interp(frequency, spectra.frequency, spectra.roll_off) ** 2
        power = power / np.maximum(passed, LEAST_GAIN)
        smooth = np.convolve(np.pad(power, 1, mode="edge"), np.ones(3) / 3, "valid")
        # per row of the working rate
        least = LEAST_NOISE * max(float(np.mean(plain_torque**2)), np.finfo(float).tiny)
        variance = np.maximum(smooth * spectra.working_rate_hz / 2, least)
        log_variance = np.interp(spectra.frequency, frequency, np.log(variance))
        gain = np.exp(-0.5 * log_variance)
    return gain


def added_columns(spectra: Spectra, sign: Array) -> dict[str, list[Array]]:
    """What rivals of Eq. 15 add to it (p,), by their names, with the smoothed `sign` (p,) of the
    velocity. The first ones change K, B and I, where these are not one number."""
    angle, omega = spectra.angle, spectra.omega
    centred_time = spectra.relative_time - 0.5
    return {
        "damping by speed": [omega * np.abs(omega)],
        "hardening": [angle**2, angle**2 * angle],
        "K by side": [np.abs(angle)],
        "K and B by direction": [angle * sign, np.abs(omega)],
        "change over time": [x * centred_time for x in (spectra.theta, omega, spectra.alpha)],
        "change at once": [x * (centred_time > 0) for x in (spectra.theta, omega)],
    }


def rich_columns(
    spectra: Spectra, added: Mapping[str, list[Array]], friction: Spectrum
) -> Spectrum:
    """Spectra (k, f) of what any rival may add to the torque, to first order.

    Parameters
    ----------
    spectra : Spectra
        The recording.
    added : Mapping
        What rivals add at the product rate (p,).
    friction : Spectrum (k, f)
        Shapes of dry friction.
    """
    products = [column for columns in added.values() for column in columns]
    for moment in OTHER_MOMENTS:
        is_after = spectra.relative_time > moment
        products += [spectra.theta * is_after, spectra.omega * is_after]
    of_products = spectra.spectrum_of(np.array(products))
    return np.concatenate([spectra.derivatives, friction, of_products, spectra.motion[3:]])
