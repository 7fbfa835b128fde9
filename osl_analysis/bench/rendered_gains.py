# SPDX-License-Identifier: Apache-2.0
"""The gains that a controller renders: linear theory (Eq. 9 with the joint's inertia) fitted to the
rows of Eq. 15.

K, B and I of Eq. 15 depend on the motion, since a drivetrain is of third order. Its gains do not.
In the letters of `drivetrain.joint_admittance` the torque is that of Z = P - c/N, in which
N = J_m s^2 + (B_m + B_1) s + K_1 + K_s/n_T^2 has the two gains. Least squares by Gauss and Newton
takes the slopes

    dZ/dK_1 = c/N^2,   dZ/dB_1 = c s/N^2

as columns, so that the interval of the gains is made as that of K, B and I. By Eqs. 11 to 13 the
joint at rest has K_d = Z(0), and, to first order in s, B_d = Z'(0):

    K_d = K_s - c/kappa,   B_d = B_j + c (B_m + B_1)/kappa^2,   kappa = K_1 + K_s/n_T^2.

A delay T of the control loop lowers B_1 by K_1 T, which is what the joint shows, and so what is
rendered.
"""

from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from osl_analysis.bench.impedance import Analysis, bench_torques
from osl_analysis.bench.motion_range import parts_of
from osl_analysis.bench.record import Record
from osl_analysis.bench.regression import (
    GroupFit,
    Sums,
    fit_groups,
    motion_sums,
    offset_and_drift,
)
from osl_analysis.errors import IdentifiabilityError
from osl_analysis.model.compensator import Gains, stiffness_gain
from osl_analysis.model.drivetrain import DrivetrainParameters, RationalFunction, joint_admittance
from osl_analysis.model.rendered_impedance import linear_torque
from osl_analysis.stats.budget import Budget, Contribution, unknown
from osl_analysis.stats.linear_fit import solved, variance_accounted_for
from osl_analysis.trial import Array

K_D, B_D = "K_d_rendered", "B_d_rendered"  # columns
Values = dict[str, tuple[float, dict[str, float]]]
GAINS = {"K_1": "K_1", "B_1": "B_1", "offset": "one", "drift": "ramp"}
MOST_STEPS = 20  # of Gauss and Newton; a sound leg takes two to seven
SMALLEST_STEP = 1e-3  # of the gains' standard errors, at which they have converged
MOTION_CUTOFFS = 3.0  # of the low-pass, beyond which nothing of the motion is left
"""As of the torque that linear theory expects."""
COMPONENTS = ("K_s", "n_T", "J_m", "B_m", "J_j", "B_j")  # of Eq. 9 beside the gains
SMALL_CHANGE = 1e-3  # of a component, by which its slope is taken


@dataclass(frozen=True)
class RenderedGains:
    """What a controller renders.

    Attributes
    ----------
    budgets : Mapping of Budget
        Of K_d [N*m/rad] and B_d [N*m*s/rad], by the names of their columns.
    VAF : float
        Of the model of third order [percent].
    """

    budgets: Mapping[str, Budget]
    VAF: float


def rendered_gains(
    analysis: Analysis,
    p: DrivetrainParameters,
    uncertainties: Mapping[str, float],
) -> RenderedGains | None:
    """Fit the gains to the whole record of a leg.

    Parameters
    ----------
    analysis
        Eq. 15 of the record.
    p
        The drivetrain.
    uncertainties
        Stated standard uncertainties of components of the drivetrain, in their units.

    Returns
    -------
    RenderedGains or None
        None where a component is not known, or the motion does not tell the gains.
    """
    K = analysis.whole["K"]
    is_known = all(np.isfinite(getattr(p, name)) for name in COMPONENTS)
    if not is_known or not 0 < K < p.K_s:
        return None
    # of slow motion Eq. 15 has K_d and B_d
    K_1 = float(stiffness_gain(K, p))
    B_1 = (analysis.whole["B"] - p.B_j) * (K_1 + p.K_s_at_actuator) ** 2 * (p.n_T / p.K_s) ** 2
    leg = Leg(analysis.record.coarse, p, Gains(K_1, max(B_1 - p.B_m, 0.0), cancels_friction=True))
    for _ in range(MOST_STEPS):
        try:
            step = leg.step_from(leg.sums())
        except IdentifiabilityError:
            return None
        leg = leg.moved_by(step)
        if p.B_m + leg.gains.B_1 <= 0 or leg.gains.K_1 <= 0:  # not damped, or no stiffness at rest
            return None
        if all(abs(step[name]) < SMALLEST_STEP * step.se(name) for name in ("K_1", "B_1")):
            return described(leg, step, uncertainties)
    return None


@dataclass(frozen=True)
class Leg:
    """A record of a leg, and the gains that may be rendered."""

    record: Record
    p: DrivetrainParameters
    gains: Gains

    @property
    def admittance(self) -> RationalFunction:
        return joint_admittance(self.gains.K_1, self.gains.B_1, self.p, self.p.J_j)

    def moved_by(self, step: GroupFit) -> "Leg":
        """The leg with other gains."""
        gains = replace(
            self.gains, K_1=self.gains.K_1 + step["K_1"], B_1=self.gains.B_1 + step["B_1"]
        )
        return replace(self, gains=gains)

    def torque_for(self, admittance: RationalFunction, angle: Array | None = None) -> Array:
        """Torque (n,) [N*m] of an admittance [rad/(N*m)] for an angle (n,) [rad], by default that
        of the record."""
        theta = self.record.motion.theta if angle is None else angle
        highest_hz = MOTION_CUTOFFS * self.record.settings.cutoff_hz
        return linear_torque(admittance, theta, self.record.rate_hz, highest_hz)

    def slopes(self) -> dict[str, Array]:
        """The slopes (n,) of the torque in K_1 and B_1, with offset and drift."""
        N = self.admittance.numerator
        N_squared = np.convolve(N, N)
        c = self.p.K_s**2 / self.p.n_T**2
        return {
            "K_1": self.torque_for(RationalFunction(N_squared, np.array([c]))),
            "B_1": self.torque_for(RationalFunction(N_squared, np.array([c, 0.0]))),
            **offset_and_drift(self.record.time),
        }

    def left(self) -> Record:
        """The record with what the gains leave of the torque."""
        record = self.record
        torque = self.torque_for(self.admittance)
        return replace(
            record, torque=record.torque - torque, filtered_torque=record.filtered_torque - torque
        )

    def sums(self) -> Sums:
        """Sums of the slopes and of what the gains leave."""
        # the slopes are behind the actuator, which passes no noise of the angle
        columns = {**self.slopes(), "theta": self.record.motion.theta}
        return motion_sums(self.left(), columns, angle_noise=0.0)

    def step_from(self, sums: Sums) -> GroupFit:
        """The changes of the gains that fit best in some groups. Raises as `fit_groups`."""
        return fit_groups(sums, GAINS)

    def impedance(self) -> Values:
        """K_d and B_d that the gains render (Eqs. 11-13), each with its derivatives by them."""
        p = self.p
        c = p.K_s**2 / p.n_T**2
        kappa = self.gains.K_1 + p.K_s_at_actuator
        x = p.B_m + self.gains.B_1
        return {
            K_D: (p.K_s - c / kappa, {"K_1": c / kappa**2}),
            B_D: (p.B_j + c * x / kappa**2, {"B_1": c / kappa**2, "K_1": -2 * c * x / kappa**3}),
        }


def described(leg: Leg, step: GroupFit, uncertainties: Mapping[str, float]) -> RenderedGains:
    """What the converged gains render, with all that contributes to its uncertainty: the interval
    of the last step, what is stated of the bench and of the drivetrain, and the motion."""
    record = leg.record
    rows = record.rows()
    torque = leg.torque_for(leg.admittance)
    slopes = leg.slopes()
    X = np.column_stack([slopes[column] for column in GAINS.values()])[rows]

    fit = step
    passed = partial(leg.torque_for, leg.admittance)
    for source, error in bench_torques(record, torque, torque, passed, rows):
        change, _ = solved(X.T @ X, X.T @ error[rows])
        fit = fit.with_known_error(source, change, shared=True)
    rendered = fit.derived(leg.impedance())

    slow = X[:, 2:] @ np.array([step["offset"], step["drift"]])
    left = leg.left().filtered_torque[rows] - slow
    of_components = contributions_of_components(leg, X, rows, uncertainties)
    return RenderedGains(
        budgets={
            name: rendered.budget(name).plus(over_motion(leg, name), *of_components[name])
            for name in (K_D, B_D)
        },
        VAF=variance_accounted_for(record.filtered_torque[rows], left),
    )


def over_motion(leg: Leg, name: str) -> Contribution:
    """Half of the range over amplitudes and frequencies, which friction makes: linear theory has
    none."""
    values = [leg.impedance()[name][0]]
    for part in parts_of(leg.left(), leg.sums()):
        with suppress(IdentifiabilityError):
            values.append(leg.moved_by(leg.step_from(part)).impedance()[name][0])
    return Contribution("friction", np.ptp(values) / 2, basis="measured", part="motion")


def contributions_of_components(
    leg: Leg, X: Array, rows: NDArray[np.intp], uncertainties: Mapping[str, float]
) -> dict[str, list[Contribution]]:
    """What the uncertainty of each component of the drivetrain makes of what the gains render, to
    first order; of those whose uncertainty is not stated, the one that changes it most."""
    torque = leg.torque_for(leg.admittance)
    before = leg.impedance()
    slopes: dict[str, dict[str, float]] = {K_D: {}, B_D: {}}  # by component, for all of it
    for component in COMPONENTS:
        value = getattr(leg.p, component)
        other = replace(leg, p=replace(leg.p, **{component: value * (1 + SMALL_CHANGE)}))
        change = torque[rows] - other.torque_for(other.admittance)[rows]
        K_1, B_1, *_ = np.linalg.lstsq(X, change)[0]
        gains = replace(leg.gains, K_1=leg.gains.K_1 + K_1, B_1=leg.gains.B_1 + B_1)
        after = replace(other, gains=gains).impedance()
        for name in before:
            slopes[name][component] = (after[name][0] - before[name][0]) / SMALL_CHANGE
    found: dict[str, list[Contribution]] = {}
    for name, by_component in slopes.items():
        stated = [
            Contribution(
                "parameter_differs",
                abs(by_component[component] * uncertainties[component] / getattr(leg.p, component)),
                shared=True,
                detail=component,
            )
            for component in COMPONENTS
            if component in uncertainties
        ]
        found[name] = stated
        others = {key: abs(by_component[key]) for key in COMPONENTS if key not in uncertainties}
        if others:
            largest = max(others, key=others.__getitem__)
            per = unknown("parameter_differs", f"% of {largest}", **{name: others[largest] / 100})
            found[name].append(per[name])
    return found
