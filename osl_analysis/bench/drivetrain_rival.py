"""The drivetrain of Eq. 9 as a rival of Eq. 15: torque predicted from the measured angle, a few numbers fitted."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

from osl_analysis.bench.linear_rivals import offset_and_drift, without
from osl_analysis.errors import InputError
from osl_analysis.model.compensator import Gains
from osl_analysis.model.drivetrain_response import Friction, belt_response
from osl_analysis.parameters import DrivetrainParameters
from osl_analysis.signals import LowPass, Motion
from osl_analysis.stats.comparison import Candidate
from osl_analysis.trial import Array

GIVEN = np.ones(3)
"""The three fitted numbers at their given values: K_1 divided by its given value, 1 plus the change of B_1 divided by
(K_1 J_m)^1/2, and friction divided by that of the parameter file."""
LEAST_GAIN = 0.1
"""Smallest K_1, divided by its given value."""
STEP = 1e-2
"""Step of the numerical derivatives. Because friction stops and starts, the torque is rough at smaller steps."""


@dataclass(frozen=True)
class DrivetrainTrial:
    """One trial for the drivetrain model; signals have shape (n,)."""

    name: str
    """Name of the trial."""
    theta: Array
    """Raw joint angle [rad]."""
    motion: Motion
    """Filtered joint angle with its derivatives."""
    torque: Array
    """Filtered resisting torque [N*m]."""
    amplitude_rows: Sequence[NDArray[np.intp]]
    """Rows of each amplitude."""
    rate_hz: float
    """Sampling rate [Hz]."""
    low_pass: LowPass
    """The filter of angle and torque."""
    gains: Gains
    """Control gains that the leg was given."""
    p: DrivetrainParameters
    """Parameters of the device."""
    sign_width: float
    """Velocity [rad/s] over which the sign of the velocity is smoothed."""

    @property
    def unit_damping(self) -> float:
        """The actuator's own scale of damping, (K_1 J_m)^1/2 [N*m*s/rad]."""
        return float(np.sqrt(self.gains.K_1 * self.p.J_m))

    @property
    def least_damping(self) -> float:
        """Smallest x[1]: 1 % of the damping B_m + B_1 is left."""
        return 1 - 0.99 * (self.p.B_m + self.gains.B_1) / self.unit_damping

    def predicted(self, x: Array) -> Array:
        """Filtered resisting torque [N*m], shape (n,), for the three numbers x of `GIVEN`.

        Raises
        ------
        InputError
            With these gains the model grows without bounds.
        """
        K_1, B_1 = x[0] * self.gains.K_1, self.gains.B_1 + (x[1] - 1) * self.unit_damping
        gains = Gains(float(K_1), float(B_1), self.gains.cancels_friction)
        belt = belt_response(self.theta, self.rate_hz, gains, self.p, Friction(float(x[2]), self.sign_width))
        if not np.isfinite(belt).all():
            raise InputError(
                f"the drivetrain model grows without bounds for K_1 = {gains.K_1:g}, B_1 = {gains.B_1:g}; check the "
                "parameter file against the device"
            )
        return self.low_pass(belt, self.rate_hz) + self.p.B_j * self.motion.omega + self.p.J_j * self.motion.alpha

    def residual(self, prediction: Array, rows: NDArray[np.intp]) -> Array:
        """What a prediction (n,) leaves of the torque of one amplitude, which has its own offset and drift."""
        left = self.torque[rows] - prediction[rows]
        return without(left, offset_and_drift(len(left)))


def drivetrain_candidates(trial: DrivetrainTrial) -> list[Candidate]:
    """Eq. 9, linear (M2), with the friction of the parameter file (M3), and with three numbers fitted (M4)."""
    without_friction = replace(trial, gains=replace(trial.gains, cancels_friction=False))
    return [
        given_drivetrain(without_friction, "M2", "Eq. 9", np.array([1.0, 1.0, 0.0])),
        given_drivetrain(trial, "M3", "Eq. 9 + friction", GIVEN),
        fitted_drivetrain(trial, "M4", "Eq. 9 + friction; K_1 and B_1 and friction fitted"),
    ]


def given_drivetrain(trial: DrivetrainTrial, model: str, terms: str, x: Array) -> Candidate:
    """A model of which nothing is fitted, so that all data are held out."""
    prediction = trial.predicted(x)
    left = np.concatenate([trial.residual(prediction, rows) for rows in trial.amplitude_rows])
    return Candidate(model, terms, 0, left, left)


def fitted_drivetrain(trial: DrivetrainTrial, model: str, terms: str) -> Candidate:
    """K_1, B_1 and the size of the friction fitted to all amplitudes, and to all but one.

    The fit without an amplitude is one Gauss-Newton step from the fit to all, on the rows of the others. A second fit
    in full takes three times as long and changes the VAF on data held out by a hundredth of a percent.
    """
    lowest = np.array([LEAST_GAIN, trial.least_damping, 0.0])

    def left(x: Array) -> Array:
        """What the model with the three numbers x leaves of the torque of all amplitudes."""
        prediction = trial.predicted(x)
        return np.concatenate([trial.residual(prediction, rows) for rows in trial.amplitude_rows])

    best = least_squares(left, GIVEN, bounds=(lowest, np.inf), diff_step=[STEP] * 3, xtol=1e-3, ftol=1e-4, max_nfev=10)
    ends = np.cumsum([0, *(len(trial.torque[rows]) for rows in trial.amplitude_rows)])
    held_out = []
    x, jacobian, residual = (np.asarray(u, dtype=float) for u in (best.x, best.jac, best.fun))
    for rows, start, stop in zip(trial.amplitude_rows, ends[:-1], ends[1:], strict=True):
        others = np.r_[:start, stop : len(residual)]
        step, *_ = np.linalg.lstsq(jacobian[others], -residual[others], rcond=None)
        held_out.append(trial.residual(trial.predicted(np.maximum(x + step, lowest)), rows))
    return Candidate(model, terms, len(GIVEN), residual, np.concatenate(held_out))
