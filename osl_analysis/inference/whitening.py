"""Whitening by the noise's own spectrum: after it, least squares is maximum likelihood.

Load cells drift, persons lean on benches, and amplifiers hum: the noise of a torque is not white.
The residual of a model that is richer than any hypothesis has its spectrum (generalised least
squares with an estimated covariance; Ljung, System Identification, 1999, ch. 7). Divided by its
root, torque and columns have white noise of variance 1, whatever the noise was. No trend or
high-pass has to be chosen.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy
from numpy.typing import NDArray

from osl_analysis.inference.acceleration_jumps import acceleration_jumps, jump_columns
from osl_analysis.inference.actuator import frictionless_actuator
from osl_analysis.inference.constants import (
    COLOUR_SEGMENT,
    MOMENTS,
    REFLEX_DELAYS,
)
from osl_analysis.inference.friction_shapes import (
    friction_torques,
    sliding_velocity,
    slipping_spring,
)
from osl_analysis.inference.least_squares import BesideShared, solve_scaled
from osl_analysis.inference.reflex import Reflex, half_waves, muscle_answers
from osl_analysis.inference.spectra import Spectra, Spectrum
from osl_analysis.trial import Array

ROUNDS = 2  # the second one weighs the rich model by the spectrum that the first one found
LEAST_GAIN = 0.03  # of the roll-off's power, below which the spectrum is not divided by it
SLOW_POWERS = 4  # offset and drift: powers of time from 0


def contiguous(rows: NDArray[np.bool_]) -> slice | NDArray[np.bool_]:
    """Rows (w,) of a recording without gaps as a slice, which copies nothing."""
    at = np.flatnonzero(rows)
    if len(at) and at[-1] - at[0] + 1 == len(at):
        return slice(int(at[0]), int(at[-1]) + 1)
    return rows


@dataclass(frozen=True)
class JointKind:
    """What a joint has beside stiffness, damping and inertia."""

    has_friction: bool = False
    has_reflex: bool = False


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
    reading : Array (3, 3) or (3, 4)
        K, B, I by the coefficients of `motion`.
    slow : Array (4, m)
        Offset and drift of the torque.
    acceleration_jumps : Jumps
        Jumps of the acceleration.
    jumps : Array (k, m)
        What sampling makes of a torque that jumps with them.
    friction : Array (k, m)
        Shapes of dry friction.
    reflex : Reflex
        Answers of a muscle to stretch, at the delay that explains most.
    mean_friction : Array (k,)
        Mean torque of each shape over its coefficient.
    sign : Array (p,)
        Smoothed sign of the velocity, at the product rate.
    """

    def __init__(self, spectra: Spectra) -> None:
        self.spectra = spectra
        self._kept = contiguous(spectra.rows)
        self._behind_gaps: dict[float, Array] = {}
        velocity, width = sliding_velocity(spectra)
        self.sign = np.tanh(velocity / width)
        self._half_waves = spectra.spectrum_of(half_waves(spectra))
        shapes = friction_torques(spectra)
        self._friction = spectra.spectrum_of(shapes)
        powers = np.array([(spectra.share - 0.5) ** k for k in range(SLOW_POWERS)])
        self._slow = spectra.spectrum_of(powers)
        self.acceleration_jumps = acceleration_jumps(spectra)
        self._jumps = jump_columns(spectra, self.acceleration_jumps)

        self._gain: Array | None = None
        self._gain = self._inverse_root_of_noise()

        self.torque = self.column(spectra.torque)
        self.motion = self.column(self._motion_spectra())
        self.actuator = None
        self.reading = np.eye(3)
        if spectra.actuator_spectrum is not None:
            self.actuator = frictionless_actuator(spectra)
            self.reading = np.column_stack([self.reading, self.actuator.reading])
        self.slow = self.column(self._slow)
        self.jumps = self.column(self._jumps)
        self.friction = self.column(self._friction)
        self.mean_friction = np.abs(shapes[:, spectra.inside]).mean(axis=1)

    @cached_property
    def reflex(self) -> "Reflex":
        """The reflex at that delay which explains most beside Eq. 15 and friction."""
        beside = BesideShared(np.concatenate([self.motion, self.slow, self.friction]))
        tried = []
        for delay in REFLEX_DELAYS:
            columns = self.column(muscle_answers(self.spectra, self._half_waves, delay))
            left, _ = beside.fit(columns, self.torque)
            tried.append((left, Reflex(delay, columns)))
        return min(tried, key=lambda each: each[0])[1]

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

    def motion_at_working_rate(self, order: int = 0, delay: float = 0.0) -> Array:
        """The columns of `motion` before whitening (3, w) or (4, w), `order` times derived, and
        delayed [s]."""
        spectra = self.spectra
        changed = spectra.s**order * np.exp(-delay * spectra.s) * spectra.roll_off
        spectrum = self._motion_spectra() * changed
        return np.asarray(scipy.fft.irfft(spectrum, spectra.working))

    def _motion_spectra(self) -> Spectrum:
        spectra = self.spectra
        if spectra.actuator_spectrum is None:
            return spectra.derivatives[:3]
        return np.vstack([spectra.derivatives[:3], spectra.actuator_spectrum])

    def shared(self, kind: JointKind) -> Array:
        """Columns (k, m) that all hypotheses share: of friction and reflex, offset and drift."""
        parts = []
        if kind.has_friction:
            parts.append(self.friction)
        if kind.has_reflex:
            parts.append(self.reflex.columns)
        return np.concatenate([*parts, self.slow, self.jumps])

    def column(self, spectrum: Spectrum) -> Array:
        """Whiten the signals with these working spectra (..., f); returns rows (..., m)."""
        spectra = self.spectra
        return self.windowed(scipy.fft.irfft(spectrum * spectra.roll_off, spectra.working))

    def windowed(self, x: Array) -> Array:
        """Whiten signals (..., w) at the working rate; returns rows (..., m)."""
        spectra = self.spectra
        x = x * spectra.window
        if self._gain is None:
            return np.asarray(x[..., self._kept])
        return self._filtered(x, self._gain)

    def _filtered(self, x: Array, gain: Array) -> Array:
        """Kept rows (..., m) of signals (..., w) behind a filter of this gain (f,)."""
        filtered = scipy.fft.irfft(scipy.fft.rfft(x) * gain, self.spectra.working)
        return np.asarray(filtered[..., self._kept])

    def _filtered_one_by_one(self, columns: Array, gain: Array) -> Array:
        """Columns (k, m) behind a filter: all at once would be the peak of memory."""
        filtered = np.empty_like(columns)
        for k, column in enumerate(columns):
            filtered[k] = self._filtered(self._everywhere(column), gain)
        return filtered

    def _everywhere(self, rows: Array) -> Array:
        """Rows (..., m) among all working rows (..., w), with zeros where the window is 0."""
        everywhere = np.zeros((*rows.shape[:-1], self.spectra.working))
        everywhere[..., self._kept] = rows
        return everywhere

    def behind_gap(self, width: float, is_kept: bool) -> Array:
        """Whitened angle and velocity (2, m) behind a gap of some width [rad], which follow the
        joint's when the gap is taken up; kept where another hypothesis tries the same width."""
        if width in self._behind_gaps:
            return self._behind_gaps[width]
        spectra = self.spectra
        wound = width / 2 * slipping_spring(spectra.angle, width / 2)
        spectrum = spectra.spectrum_of(spectra.theta - wound)
        columns = self.column(np.array([spectrum, spectra.s * spectrum]))
        if is_kept:
            self._behind_gaps[width] = columns
        return columns

    def of_product(self, x: Array) -> Array:
        """Whiten signals (..., p) at the product rate; returns rows (..., m)."""
        return self.column(self.spectra.spectrum_of(x))

    def unwhitened(self, rows: Array) -> Array:
        """Take the whitening off rows (k, m); near ends and gaps a part of it stays."""
        assert self._gain is not None
        return self._filtered_one_by_one(rows, 1 / self._gain)

    def _inverse_root_of_noise(self) -> Array:
        """Find the whitening gain (f,) from what the rich model leaves of the torque."""
        spectra = self.spectra
        rich = np.concatenate([self._rich_columns(), self._slow, self._jumps])
        plain_columns, plain_torque = self.column(rich), self.column(spectra.torque)
        segment = min(round(COLOUR_SEGMENT * spectra.rate_hz), plain_torque.shape[-1])

        for round_number in range(ROUNDS):
            columns, torque = plain_columns, plain_torque
            if round_number > 0:
                assert self._gain is not None
                columns = self._filtered_one_by_one(plain_columns, self._gain)
                torque = self._filtered(self._everywhere(plain_torque), self._gain)
            estimates = solve_scaled(columns, torque)
            residual = plain_torque - estimates @ plain_columns
            frequency, power = scipy.signal.welch(
                residual, spectra.rate_hz, nperseg=segment, detrend=False
            )
            passed = np.interp(frequency, spectra.frequency, spectra.roll_off) ** 2
            power = power / np.maximum(passed, LEAST_GAIN)
            smooth = np.convolve(np.pad(power, 1, mode="edge"), np.ones(3) / 3, "valid")
            # per row of the working rate; a torque without noise has the rounding of its numbers
            least = 1e-20 * max(float(np.mean(plain_torque**2)), np.finfo(float).tiny)
            variance = np.maximum(smooth * spectra.rate_hz / 2, least)
            of_all = np.interp(spectra.frequency, frequency, np.log(variance))
            self._gain = np.exp(-0.5 * of_all)
        assert self._gain is not None
        return self._gain

    def _rich_columns(self) -> Spectrum:
        """Spectra (k, f) of what any hypothesis may add to the torque, to first order."""
        spectra = self.spectra
        angle, omega, alpha = spectra.angle, spectra.omega, spectra.alpha
        centred = spectra.share - 0.5
        nonlinear = [
            omega * np.abs(omega),
            angle**2,
            angle**3,
            np.abs(angle),
            np.abs(omega),
            angle * self.sign,
        ]
        drifting = [x * centred for x in (spectra.theta, omega, alpha)]
        later = [spectra.share > moment for moment in MOMENTS[::3]]
        stepping = [x * after for x in (spectra.theta, omega) for after in later]
        products = spectra.spectrum_of(np.array([*nonlinear, *drifting, *stepping]))
        answers = muscle_answers(spectra, self._half_waves, REFLEX_DELAYS[0])
        parts = [spectra.derivatives, self._friction, products, answers]
        if spectra.actuator_spectrum is not None:
            parts.append(spectra.actuator_spectrum[None])
        return np.concatenate(parts)
