"""The drivetrain of Eq. 9 as a rival of Eq. 15: torque predicted from the measured angle, a few numbers fitted."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import least_squares

from osl_analysis.bench.model_comparison import Candidate, offset_and_drift, without
from osl_analysis.errors import InputError
from osl_analysis.model.compensator import Gains
from osl_analysis.model.drivetrain_response import Friction, belt_response
from osl_analysis.parameters import DrivetrainParameters
from osl_analysis.signals import LowPass, Motion
from osl_analysis.trial import Array

GIVEN = np.ones(3)
"""What is fitted: K_1 over what was given, 1 + what B_1 has more in (K_1 J_m)^1/2, friction over what the file says."""
LEAST_GAIN = 0.1
STEP = 1e-2
"""Step of the derivatives: friction's stops and starts make the torque rough at smaller ones."""


@dataclass(frozen=True)
class DrivetrainTrial:
    """A trial's raw angle [rad], its filtered motion and torque [N*m], shape (n,), and the rows of each amplitude.

    `gains`, `p` and `sign_width` [rad/s] are what the leg was given; `low_pass` filtered motion and torque.
    """

    theta: Array
    motion: Motion
    torque: Array
    parts: Sequence[slice]
    rate_hz: float
    low_pass: LowPass
    gains: Gains
    p: DrivetrainParameters
    sign_width: float

    @property
    def unit_damping(self) -> float:
        """The actuator's own scale of damping, (K_1 J_m)^1/2 [N*m*s/rad]."""
        return float(np.sqrt(self.gains.K_1 * self.p.J_m))

    @property
    def least_damping(self) -> float:
        """x[1] at which hardly any damping is left: 1 % of B_m + B_1."""
        return 1 - 0.99 * (self.p.B_m + self.gains.B_1) / self.unit_damping

    def predicted(self, x: Array) -> Array:
        """Filtered resisting torque [N*m], shape (n,), for x as in `GIVEN`.

        Raises
        ------
        InputError
            The gains make the loop grow without bounds.
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

    def residual(self, prediction: Array, part: slice) -> Array:
        """What a prediction leaves of the torque in one part, with an offset and a drift of its own."""
        left = self.torque[part] - prediction[part]
        return without(left, offset_and_drift(len(left)))


def candidates(trial: DrivetrainTrial) -> list[Candidate]:
    """Eq. 9, linear (M2), with the friction of the parameter file (M3), and with three numbers fitted (M4)."""
    without_friction = replace(trial, gains=replace(trial.gains, cancels_friction=False))
    return [
        given(without_friction, "M2", "Eq. 9", np.array([1.0, 1.0, 0.0])),
        given(trial, "M3", "Eq. 9 + friction", GIVEN),
        adjusted(trial, "M4", "Eq. 9 + friction; K_1 and B_1 and friction fitted"),
    ]


def given(trial: DrivetrainTrial, model: str, terms: str, x: Array) -> Candidate:
    """A model of which nothing is fitted: all data are held out."""
    prediction = trial.predicted(x)
    left = np.concatenate([trial.residual(prediction, part) for part in trial.parts])
    return Candidate(model, terms, 0, left, left)


def adjusted(trial: DrivetrainTrial, model: str, terms: str) -> Candidate:
    """K_1, B_1 and the size of the friction fitted, to all parts and to all but one.

    The fit without a part is one Gauss-Newton step from the fit to all, on the rows of the others: a second fit in full
    costs three times as much and moves the VAF on data held out by a hundredth of a percent.
    """
    lowest = np.array([LEAST_GAIN, trial.least_damping, 0.0])

    def left(x: Array) -> Array:
        prediction = trial.predicted(x)
        return np.concatenate([trial.residual(prediction, part) for part in trial.parts])

    found = least_squares(left, GIVEN, bounds=(lowest, np.inf), diff_step=[STEP] * 3, xtol=1e-3, ftol=1e-4, max_nfev=10)
    ends = np.cumsum([0, *(len(trial.torque[part]) for part in trial.parts)])
    held_out = []
    x, jacobian, residual = (np.asarray(u, dtype=float) for u in (found.x, found.jac, found.fun))
    for part, start, stop in zip(trial.parts, ends[:-1], ends[1:], strict=True):
        others = np.r_[:start, stop : len(residual)]
        step, *_ = np.linalg.lstsq(jacobian[others], -residual[others], rcond=None)
        held_out.append(trial.residual(trial.predicted(np.maximum(x + step, lowest)), part))
    return Candidate(model, terms, len(GIVEN), residual, np.concatenate(held_out))
