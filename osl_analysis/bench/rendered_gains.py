# SPDX-License-Identifier: Apache-2.0
"""The gains that a controller renders: linear theory (Eq. 9 with the joint's inertia) fitted to the
rows of Eq. 15.

K, B and I of Eq. 15 depend on the motion, since a drivetrain is of third order. Its gains do not.
In the letters of `drivetrain.dynamic_stiffness` the torque is that of Z = P - c/N, of which
N = J_m s^2 + B_m s + (K_1 + B_1 s) e^(-s T) + K_s/n_T^2 has the gains and the delay T of the loop.
Least squares by Gauss and Newton takes the torque's slopes in them as columns, by differences, so
that their interval is made as that of K, B and I. By Eqs. 11 to 13 slow motion meets K_d = Z(0)
and, to first order in s, B_d = Z'(0):

    K_d = K_s - c/kappa,   B_d = B_j + c (B_m + B_1 - K_1 T)/kappa^2,   kappa = K_1 + K_s/n_T^2.

Linear theory has no friction, so Coulomb friction of the joint is fitted beside it, and that of the
actuator, whose velocity is that of the joint times (K_s/n_T)/N, through which its torque acts, too.
Friction that sticks, grows with the load or is cancelled late is no Coulomb friction, and the gains
are the same in every motion. Half of their range over amplitudes and parts of the band, with
friction and without, is therefore an error of the theory, and in the intervals: unlike K of Eq. 15,
gains have no other value at another amplitude. What friction that sticks at rest does alike at all
of them shows in the torque that is left, of which `SHAPE_SHARE` may pass for a gain: that is in the
intervals, too. A motion that does not tell friction from damping tells no gains.

A delay that is stated wrongly acts like an inertia of the actuator, and moves K_d: by up to 2 % for
2 ms. So the delay is fitted, too, and what it would change bounds that. It is not taken in place of
the stated one: beside friction that is cancelled late it is told worse than it is stated.
"""

from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

from osl_analysis.base.errors import IdentifiabilityError
from osl_analysis.base.trial import Array
from osl_analysis.bench.impedance import Analysis, bench_torques, parts_of, with_torque_errors
from osl_analysis.bench.record import Record
from osl_analysis.bench.regression import (
    SLOW,
    Model,
    Sums,
    friction_column,
    gram_sums,
    least_squares,
    offset_and_drift,
    with_effects,
)
from osl_analysis.model.compensator import stiffness_gain
from osl_analysis.model.drivetrain import (
    DrivetrainParameters,
    MotionSpectrum,
    Spectrum,
    StatedOfDevice,
    dynamic_stiffness,
    held_actuator,
    motion_spectrum,
)
from osl_analysis.stats.budget import Budget, Contribution, unknown
from osl_analysis.stats.linear_fit import LinearFit, variance_accounted_for
from osl_analysis.stats.sources import Source

MOST_STEPS = 20  # of Gauss and Newton; a sound leg takes two to seven
# of the gains' standard errors: after a smaller step they have converged. The sign of the
# actuator's velocity moves with them, so that a step is about a tenth of the one before: 1e-3 is
# left
STEP_ROUNDING = 1e-2
MOTION_CUTOFFS = 3.0  # of the low-pass, beyond which nothing of the motion is left
"""As of the torque that linear theory expects."""
CONTROLLER = ("B_1", "K_1", "delay")  # what is fitted; the delay where none is stated
VERY_SLOW = 1e-2  # rad/s, at which Z differs from K_d + s B_d by less than a millionth
COMPONENT_SYMBOLS = ("K_s", "n_T", "J_m", "B_m", "J_j", "B_j")  # of Eq. 9 beside the gains
# of a gain [N*m/rad, N*m*s/rad] or the delay [s], by which its slope is taken: of slopes of 1 to
# 1e4 it leaves a millionth
SLOPE_ROUNDING = 1e-6
# of the torque [N*m] that is left, which may act as a gain: the largest that makes intervals hold
# K_d beside sticking friction (default campaign: 31 of 31; 26 without it)
SHAPE_SHARE = 0.2
SHARE_ROUNDING = 1e-3  # of a component, by which its slope is taken, above all rounding


@dataclass(frozen=True)
class RenderedGains:
    """What a controller renders.

    Attributes
    ----------
    budgets : Mapping of Budget
        Of K_d [N*m/rad] and B_d [N*m*s/rad], and of the delay of the loop [s] where it is fitted,
        by the names of their columns.
    VAF : float
        Of the model of third order [percent].
    VAF_with_friction : float
        The same with Coulomb friction of joint and actuator.
    """

    budgets: Mapping[str, Budget]
    VAF: float
    VAF_with_friction: float


def rendered_gains(
    analysis: Analysis,
    p: DrivetrainParameters,
    of_device: StatedOfDevice,
) -> RenderedGains | None:
    """Fit the gains to the whole record of a leg.

    Parameters
    ----------
    analysis
        Eq. 15 of the record.
    p
        The drivetrain.
    of_device
        Standard errors of its components, and the delay of the loop, which is fitted where none is
        stated.

    Returns
    -------
    RenderedGains or None
        None where a component is not known, or the motion does not tell the gains.
    """
    K = analysis.whole["K"]
    is_known = all(np.isfinite(getattr(p, name)) for name in COMPONENT_SYMBOLS)
    if not is_known or not 0 < K < p.K_s:
        return None
    # of slow motion Eq. 15 has K_d; of a belt that does not yield, its B
    K_1 = float(stiffness_gain(K, p))
    B_1 = analysis.whole["B"] / p.n_T**2
    recording = LegRecording(analysis.record.coarse)
    delay = of_device.loop_delay or 0.0
    leg = Leg(recording, p, K_1, max(B_1, 0.0), delay, CONTROLLER[:2])
    found = converged(leg)
    # from there, since another start may lead to a late spring that damps
    told = found and converged(replace(found[0], fitted=CONTROLLER))
    if of_device.loop_delay is None:
        found = told
    if found is None:
        return None
    delayed, _ = told or found
    return described(*found, delayed.impedance(), of_device.standard_errors)


def converged(leg: "Leg") -> tuple["Leg", LinearFit] | None:
    """Fit what is `fitted` of a leg by Gauss and Newton: the leg, and the last step. None where the
    motion does not tell it, or of a joint that is no such leg."""
    with suppress(IdentifiabilityError):
        for _ in range(MOST_STEPS):
            step = with_effects(leg.sums, leg.model)
            leg = leg.moved_by(step)
            if leg.K_1 <= 0 or leg.impedance()["B_d_rendered"] <= leg.p.B_j:
                break
            if all(abs(step[name]) < STEP_ROUNDING * step.se(name) for name in leg.fitted):
                return leg, step
    return None


@dataclass(frozen=True)
class LegRecording:
    """A record of a leg, with what no controller changes, made once for all steps of a search."""

    record: Record

    def spectrum(self, angle: Array) -> MotionSpectrum:
        """The spectrum of an angle (n,) [rad], or of a torque, as far as motion counts."""
        highest_hz = MOTION_CUTOFFS * self.record.settings.cutoff_hz
        return motion_spectrum(angle, self.record.rate_hz, highest_hz)

    @cached_property
    def motion(self) -> MotionSpectrum:
        return self.spectrum(self.record.motion.theta)

    @cached_property
    def columns(self) -> dict[str, Array]:
        """Torques (n,) of 1 N*m of friction of the joint, of an offset and of a drift."""
        friction = friction_column(self.record.motion.omega, self.record)
        return {"T_C": friction, **offset_and_drift(self.record.time)}


@dataclass(frozen=True)
class Leg:
    """A recording of a leg, and what its controller may render."""

    recording: LegRecording
    p: DrivetrainParameters
    K_1: float  # [N*m/rad]
    B_1: float  # [N*m*s/rad]
    delay: float  # of the loop [s]
    fitted: tuple[str, ...]  # which of the three are

    @property
    def record(self) -> Record:
        return self.recording.record

    @property
    def linear_model(self) -> Model:
        """The columns of linear theory."""
        return {**{name: name for name in self.fitted}, **SLOW}

    @property
    def model(self) -> Model:
        """The columns that are fitted: friction of the joint beside them, and of the actuator
        behind the belt."""
        return {**self.linear_model, "T_C": "T_C", "T_m": "T_m"}

    def moved_by(self, changes: LinearFit | Mapping[str, float]) -> "Leg":
        """The leg whose controller differs so."""
        values = {name: getattr(self, name) + changes[name] for name in self.fitted}
        return replace(self, **values)

    def stepped(self, name: str) -> "Leg":
        """The leg whose controller differs by `SLOPE_ROUNDING` in one of its parameters."""
        return replace(self, **{name: getattr(self, name) + SLOPE_ROUNDING})

    def stiffness(self, s: ArrayLike) -> Spectrum:
        """Z [N*m/rad] at frequencies s [rad/s]."""
        return dynamic_stiffness(s, self.K_1, self.B_1, self.p, self.delay)

    def turned(self, s: Spectrum) -> Spectrum:
        """Angle of the actuator over that of the joint, and the torque at the joint over that of
        the actuator's friction."""
        held = held_actuator(s, self.K_1, self.B_1, self.p, self.delay)
        return self.p.K_s / self.p.n_T / held

    @cached_property
    def torque(self) -> Array:
        """What the controller renders for the record's motion, (n,) [N*m]."""
        return self.recording.motion.torque(self.stiffness)

    @cached_property
    def slopes(self) -> dict[str, Array]:
        """The slopes (n,) of the torque in what is fitted, with offset and drift, and what 1 N*m of
        friction of the joint, and of the actuator, makes of it."""
        stepped_stiffnesses = [self.stepped(name).stiffness for name in self.fitted]

        def actuator_velocity_and_torques(s: Spectrum) -> Spectrum:
            torques = [stiffness(s) for stiffness in stepped_stiffnesses]
            return np.array([s * self.turned(s), *torques])

        omega_m, *torques = self.recording.motion.torque(actuator_velocity_and_torques)
        slopes = {
            name: (torque - self.torque) / SLOPE_ROUNDING
            for name, torque in zip(self.fitted, torques, strict=True)
        }
        friction = friction_column(omega_m, self.record)
        slopes["T_m"] = self.recording.spectrum(friction).torque(self.turned)
        return {**slopes, **self.recording.columns}

    @cached_property
    def residual(self) -> Record:
        """The record with what the controller leaves of the torque."""
        return self.record.less_torque(self.torque)

    @cached_property
    def sums(self) -> Sums:
        """Sums of the slopes and of what the controller leaves."""
        # the slopes are behind the actuator, which passes no noise of the angle: no part is taken
        # off their products
        columns = {**self.slopes, "theta": self.record.motion.theta}
        # the band of stepped sines is parted by cycles
        keep_fast = self.record.groups.kind != "cycles"
        return gram_sums(self.residual, columns, self.record.angle_noise, keep_fast)

    def impedance(self) -> dict[str, float]:
        """K_d and B_d that slow motion meets (Eqs. 11-13), and the delay where it is fitted."""
        Z = complex(self.stiffness(1j * VERY_SLOW))
        values = {"K_d_rendered": Z.real, "B_d_rendered": Z.imag / VERY_SLOW}
        if "delay" in self.fitted:
            values["loop_delay_s"] = self.delay
        return values

    def impedance_slopes(self) -> dict[str, tuple[float, dict[str, float]]]:
        """The same, each with its slopes in the controller's parameters that change it."""
        stepped = {name: self.stepped(name).impedance() for name in self.fitted}
        found = {}
        for column, value in self.impedance().items():
            slopes = {
                name: (stepped[name][column] - value) / SLOPE_ROUNDING for name in self.fitted
            }
            found[column] = (value, {name: slope for name, slope in slopes.items() if slope})
        return found


def described(
    leg: Leg, step: LinearFit, delayed: Mapping[str, float], uncertainties: Mapping[str, float]
) -> RenderedGains:
    """What the converged gains render, with all that contributes to its uncertainty: the interval
    of the last step, what is stated of the bench and of the drivetrain, and the motion. With a
    fitted delay it would be `delayed`."""
    record = leg.record
    rows = record.is_fitted()
    X = np.column_stack([leg.slopes[column] for column in leg.model.values()])[rows]

    torques = bench_torques(
        record,
        leg.torque,
        leg.torque,
        lambda angle: leg.recording.spectrum(angle).torque(leg.stiffness),
        rows,
    )
    rendered = with_torque_errors(step, X, torques).derived(leg.impedance_slopes())

    linear = least_squares(leg.sums, leg.linear_model)
    residual = leg.residual.filtered_torque[rows]
    unexplained = residual - X[:, : len(leg.linear_model)] @ linear.estimates
    left = residual - X @ step.estimates
    of_friction = contributions_of_friction(leg, leg.moved_by(linear), X, left, step)
    of_components = contributions_of_components(leg, X, rows, delayed, uncertainties)
    torque = record.filtered_torque[rows]
    return RenderedGains(
        budgets={
            name: rendered.budget(name).plus(*of_friction[name], *of_components[name])
            for name in rendered.names
        },
        VAF=variance_accounted_for(torque, unexplained),
        VAF_with_friction=variance_accounted_for(torque, left),
    )


def contributions_of_friction(
    leg: Leg, linear: Leg, X: Array, left: Array, step: LinearFit
) -> dict[str, list[Contribution]]:
    """What friction that is no Coulomb friction may make of what the gains render: half of the
    ranges over amplitudes and parts of the band, and with Coulomb friction of both, of the joint
    alone and of neither; and what it does alike at all of them. Of the torque (n,) that the
    slopes X (n, p) have `left` a share may act as any one of them does, by a rectangular
    distribution (JCGM 100:2008, 4.3.7)."""
    of_joint = with_effects(leg.sums, leg.linear_model, "T_C")
    legs = [leg, linear, leg.moved_by(of_joint)]
    for part in parts_of(leg.residual, leg.sums):
        with suppress(IdentifiabilityError):
            legs.append(leg.moved_by(with_effects(part, leg.model)))
    covariance = left @ left * np.linalg.inv(X.T @ X)
    of_all = replace(step, covariance=covariance).derived(leg.impedance_slopes())
    found = {}
    for name in of_all.names:
        half = np.ptp([each.impedance()[name] for each in legs]) / 2
        share = SHAPE_SHARE / np.sqrt(3) * of_all.se(name)
        found[name] = [
            Contribution(
                Source.FRICTION,
                half,
                basis="measured",
                detail="range over amplitudes, frequencies and friction",
            ),
            Contribution(Source.FRICTION_SHAPE, share, basis="assumed"),
        ]
    return found


def contributions_of_components(
    leg: Leg,
    X: Array,
    rows: NDArray[np.bool_ | np.intp],
    delayed: Mapping[str, float],
    uncertainties: Mapping[str, float],
) -> dict[str, list[Contribution]]:
    """What the uncertainty of each component of the drivetrain makes of what the gains render, to
    first order; of one whose uncertainty is not stated, what a percent does. A delay that is stated
    may be another, as by a filter: what the fitted one would change bounds that, by a rectangular
    distribution (JCGM 100:2008, 4.3.7)."""
    before = leg.impedance()
    found = {}
    for name, value in before.items():
        bound = abs(delayed[name] - value) / np.sqrt(3)
        found[name] = [Contribution(Source.COMPONENT, bound, basis="bound", detail="loop_delay")]
    by_torque = np.linalg.pinv(X)  # change of the estimates (p, m)
    for component in COMPONENT_SYMBOLS:
        value = getattr(leg.p, component)
        if not value:  # it is left out of the model
            continue
        other = replace(leg, p=replace(leg.p, **{component: value * (1 + SHARE_ROUNDING)}))
        changes = by_torque @ (leg.torque - other.torque)[rows]
        after = other.moved_by(dict(zip(leg.model, changes, strict=True))).impedance()
        for name in before:
            by_all = abs(after[name] - before[name]) / SHARE_ROUNDING
            if component in uncertainties:
                size = by_all * uncertainties[component] / value
                row = Contribution(Source.COMPONENT, size, shared=True, detail=component)
            else:
                row = unknown(Source.COMPONENT, f"% of {component}", **{name: by_all / 100})[name]
            found[name].append(row)
    return found
