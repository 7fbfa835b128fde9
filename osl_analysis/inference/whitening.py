"""Whitening by the noise's own spectrum: after it, least squares is maximum likelihood.

Load cells drift, persons lean on benches, and amplifiers hum: the noise of a torque is not white.
The residual of a model that is richer than any hypothesis has its spectrum (generalised least
squares with an estimated covariance; Ljung, System Identification, 1999, ch. 7). Divided by its
root, torque and columns have white noise of variance 1, whatever the noise was. No trend or
high-pass has to be chosen.
"""

from functools import cached_property

import numpy as np
import scipy

from osl_analysis.inference.actuator import frictionless_actuator
from osl_analysis.inference.constants import (
    COLOUR_SEGMENT,
    FEWEST_STEPS,
    RIDGE,
    TINY,
    Ranges,
)
from osl_analysis.inference.friction_shapes import (
    friction_torques,
    sliding_velocity,
    slipping_springs,
)
from osl_analysis.inference.spectra import Spectra, Spectrum
from osl_analysis.trial import Array

ROUNDS = 2  # the second one weighs the rich model by the spectrum that the first one found
LEAST_GAIN = 0.03  # of the roll-off's power, below which the spectrum is not divided by it
# variance of the noise over the torque's mean square: a torque without noise has rounding, which is
# not divided by, since its spectrum says nothing
LEAST_NOISE = 1e-20
# of the recording, after which stiffness and damping may be others in the rich model; each adds
# two columns
MOMENTS = (0.25, 0.375, 0.5, 0.625, 0.75)
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


class BesideShared:
    """Least squares of further columns beside shared ones (k, m).

    The shared columns are projected out (Frisch-Waugh-Lovell), so that a search over a hypothesis's
    own parameter solves for three columns.
    """

    def __init__(self, shared: Array) -> None:
        length = np.linalg.norm(shared, axis=1, keepdims=True) + TINY
        self._shared = shared / length
        normal = self._shared @ self._shared.T + RIDGE * np.eye(len(shared))
        self._inverse = np.linalg.inv(normal)

    def rest(self, signals: Array) -> Array:
        """What the shared columns leave of signals (..., m)."""
        of_shared = (signals @ self._shared.T) @ self._inverse
        return np.asarray(signals - of_shared @ self._shared)

    def fit(self, columns: Array, torque: Array) -> tuple[float, Array]:
        """Residual sum of squares and coefficients (k,) of columns (k, m) for a torque (m,)."""
        rest_of_torque = self.rest(torque)
        rest_of_columns = self.rest(columns)
        estimates = solve_scaled(rest_of_columns, rest_of_torque)
        residual = rest_of_torque - estimates @ rest_of_columns
        return float(residual @ residual), estimates


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
    sign : Array (p,)
        Smoothed sign of the velocity, at the product rate.
    """

    def __init__(self, spectra: Spectra) -> None:
        self.spectra = spectra
        velocity, width = sliding_velocity(spectra)
        self.sign = np.tanh(velocity / width)
        shapes = friction_torques(spectra)
        friction = spectra.spectrum_of(shapes)
        powers = np.array([(spectra.relative_time - 0.5) ** k for k in range(SLOW_POWERS)])
        slow = spectra.spectrum_of(powers)

        self._rich_spectra = rich_columns(spectra, self.sign, friction)
        self._gain = whitening_gain(spectra, np.concatenate([self._rich_spectra, slow]))

        self.torque = self.column(spectra.torque)
        self.motion = self.column(self._motion_spectra())
        self.actuator = None
        self.impedance_matrix = np.eye(3)
        if spectra.actuator_spectrum is not None:
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

    def motion_at_product_rate(self) -> Array:
        """The columns of `motion` before whitening, (3, p) or (4, p)."""
        spectra = self.spectra
        of_joint = np.array([spectra.theta, spectra.omega, spectra.alpha])
        if spectra.actuator_derivatives is None:
            return of_joint
        return np.vstack([of_joint, spectra.actuator_derivatives[0]])

    def _motion_spectra(self) -> Spectrum:
        spectra = self.spectra
        if spectra.actuator_spectrum is None:
            return spectra.derivatives[:3]
        return np.vstack([spectra.derivatives[:3], spectra.actuator_spectrum])

    def shared(self, has_friction: bool) -> Array:
        """Columns (k, m) that all hypotheses share: of friction, offset and drift."""
        if has_friction:
            return np.concatenate([self.friction, self.slow])
        return self.slow

    def rich(self) -> Array:
        """Whitened columns (k, m) of what any hypothesis may add to the torque."""
        return self.column(self._rich_spectra)

    def column(self, spectrum: Spectrum) -> Array:
        """Whiten the signals with these working spectra (..., f); returns rows (..., m)."""
        return self.spectra.rows_of(spectrum, self._gain)

    @cached_property
    def gap_widths(self) -> Array:
        """Widths (g,) of a gap that are tried [rad], from what rounding cannot be."""
        least = max(Ranges.PLAY[0], FEWEST_STEPS * self.spectra.signals.encoder_step)
        return np.geomspace(least, max(Ranges.PLAY[1], 2 * least), 8)

    def behind_gaps(self, widths: Array) -> Array:
        """Whitened angle and velocity (g, 2, m) behind gaps of some widths (g,) [rad], which follow
        the joint's when the gap is taken up."""
        spectra = self.spectra
        half = widths / 2
        wound = half[:, None] * slipping_springs(spectra.angle, half.tolist())
        spectrum = spectra.spectrum_of(spectra.theta - wound)
        return self.column(np.stack([spectrum, spectra.s * spectrum], axis=1))

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


def rich_columns(spectra: Spectra, sign: Array, friction: Spectrum) -> Spectrum:
    """Spectra (k, f) of what any hypothesis may add to the torque, to first order.

    Parameters
    ----------
    spectra : Spectra
        The recording.
    sign : Array (p,)
        Smoothed sign of the velocity.
    friction : Spectrum (k, f)
        Shapes of dry friction.
    """
    angle, omega, alpha = spectra.angle, spectra.omega, spectra.alpha
    centred_time = spectra.relative_time - 0.5
    nonlinear = [
        omega * np.abs(omega),
        angle**2,
        angle**2 * angle,
        np.abs(angle),
        np.abs(omega),
        angle * sign,
    ]
    drifting = [x * centred_time for x in (spectra.theta, omega, alpha)]
    later = [spectra.relative_time > moment for moment in MOMENTS]
    stepping = [x * after for x in (spectra.theta, omega) for after in later]
    products = spectra.spectrum_of(np.array([*nonlinear, *drifting, *stepping]))
    parts = [spectra.derivatives, friction, products]
    if spectra.actuator_spectrum is not None:
        parts.append(spectra.actuator_spectrum[None])
    return np.concatenate(parts)
