# SPDX-License-Identifier: Apache-2.0
"""Friction beside K, B and I of Eq. 15, and what else the torque of a recording may hold.

The inference (`osl_analysis/inference`) says whether dry friction is certain and what may be wrong.
Where friction is certain, K, B and I of a joint without it are those of Eq. 15 with a Coulomb
column, a torque that has the velocity's sign. The inference weighs friction of other shapes too,
as of bristles: what these change is in the budget of the estimates. A leg's friction acts behind
a spring: its effect is told by the actuator's angle.
"""

from contextlib import suppress
from dataclasses import dataclass, replace

import numpy as np

from osl_analysis.base.errors import IdentifiabilityError, NotWeighedError
from osl_analysis.base.trial import Array
from osl_analysis.bench.impedance import Analysis
from osl_analysis.bench.motion import EDGE_PERIODS
from osl_analysis.bench.record import Record
from osl_analysis.bench.regression import (
    BEYOND,
    IMPEDANCE,
    SHARP_WIDTH,
    Model,
    Sums,
    columns_of,
    gram_sums,
    least_squares,
    sums_of,
    with_effects,
)
from osl_analysis.inference import (
    BenchSignals,
    FrictionlessActuator,
    ImpedanceInference,
    frictionless_actuator,
    infer_impedance,
)
from osl_analysis.inference.actuator import MISSED_OF_FRICTION, deviations
from osl_analysis.inference.spectra import FRICTION_WINDS, slipping_springs
from osl_analysis.stats.budget import welch_satterthwaite
from osl_analysis.stats.linear_fit import LinearFit
from osl_analysis.stats.sources import Source

AT_REST = 0.1  # SD of the velocity, below which a joint rests
# share of the rows at rest, above which it mostly rests: 0.77 to 0.87 under binary steps, of ramps
# and a hand at most 0.56
MOST_REST = 2 / 3
CERTAIN_FRICTION = 0.9  # probability from which friction is taken off B: nine in ten are right
# share of B from which friction counts that the column sees and the inference does not; rounding
# makes 0.012 of sound recordings
SEEN_SHARE = 0.02


@dataclass(frozen=True)
class DryFriction:
    """Dry friction of a trial, and the fit without it.

    Attributes
    ----------
    sums : Sums
        Of a coarse record, whose column `T_C` is friction's torque.
    without : LinearFit or None
        The model fitted to the torque less friction; None where friction is not certain.
    size : float
        Times the column.
    is_untold : bool
        Whether the motion does not tell friction from damping.
    """

    sums: Sums
    without: LinearFit | None = None
    size: float = 1.0
    is_untold: bool = False


def coulomb_fit(s: Sums, analysis: Analysis) -> DryFriction:
    """Fit the model to the torque of all of a trial less its Coulomb friction.

    A joint that mostly rests moves by steps between a few levels: each has the same speeds, at
    which friction and damping are one number, and at rest the velocity has no sign but that of
    noise.

    No recording shows over which velocity the sign changes: what a tenth of the width changes is
    taken for a standard uncertainty.

    Parameters
    ----------
    s : Sums
        The sums of the record with all effects.
    analysis : Analysis
        The model's fits, one of whose columns is the velocity.

    Returns
    -------
    DryFriction
        Its fit has the estimates and the friction `T_C` [N*m].
    """
    velocity = analysis.record.motion.omega[analysis.record.is_fitted()]
    if np.mean(np.abs(velocity) < AT_REST * velocity.std()) > MOST_REST:
        return DryFriction(s, is_untold=True)
    model = analysis.model
    try:
        smooth = friction_beside(s, model)
        if not smooth.certain("T_C") or smooth["T_C"] <= 0:
            return DryFriction(s)
        fit = without_friction(s, model, smooth)
        sharp = sums_of(analysis.record, width=SHARP_WIDTH)
        of_sharp = without_friction(sharp, model, friction_beside(sharp, model)).estimates
    except IdentifiabilityError:
        return DryFriction(s, is_untold=True)
    fit = with_errors_of(
        analysis, fit.with_known_error(Source.FRICTION_SIGN, of_sharp - fit.estimates)
    )
    return DryFriction(s, fit, size=fit["T_C"])


def with_errors_of(analysis: Analysis, fit: LinearFit) -> LinearFit:
    """A fit without friction with the errors that the model's own has beside its scatter."""
    for source, change in analysis.whole.known_errors:
        padded = np.pad(change, (0, len(fit.names) - len(change)))
        fit = fit.with_known_error(source, padded)
    return analysis.with_bench_errors(fit, None)


def friction_beside(s: Sums, model: Model) -> LinearFit:
    """Fit of a model with friction, and with the higher derivatives of the angle that the motion
    determines: without these a linear drivetrain's deviation from Eq. 15 passes for friction of
    0.4 N*m. Raises as `least_squares`."""
    for higher in (("jerk", "snap"), ("jerk",)):
        with suppress(IdentifiabilityError):
            return with_effects(s, model, "T_C", *higher)
    return with_effects(s, model, "T_C")


def without_friction(s: Sums, model: Model, friction: LinearFit) -> LinearFit:
    """The estimates of a model for the torque less its friction, as `friction_beside` has fitted
    it, and this friction `T_C` [N*m]. Its error is one of the other estimates, too, by what
    friction of 1 N*m adds to each of them."""
    T_C = friction["T_C"]
    fit = least_squares(s.less("T_C", T_C), model)
    by_friction = np.append(-s.estimates([*model.values()], "T_C"), 1.0)
    standard, freedom = friction.budget("T_C").spread()
    of_friction = standard**2 * np.outer(by_friction, by_friction)
    of_fit = np.zeros_like(of_friction)
    of_fit[:-1, :-1] = fit.covariance
    variances = [np.diag(of_fit), np.diag(of_friction)]
    freedoms = [np.append(fit.degrees_of_freedom, np.inf), np.full(len(by_friction), freedom)]
    return replace(
        fit,
        names=(*model, "T_C"),
        estimates=np.append(fit.estimates, T_C),
        covariance=of_fit + of_friction,
        degrees_of_freedom=welch_satterthwaite(variances, freedoms),
    )


def raw_signals(record: Record, **actuator: Array | None) -> BenchSignals:
    """The raw signals of a record near the fitted rows, since the inference finds their band
    itself; `actuator` has those of a leg's."""
    # the ends of fitted pieces are left out for the sake of the fit's own filter
    edge = round(EDGE_PERIODS * record.rate_hz / record.settings.cutoff_hz)
    return BenchSignals(
        theta=record.theta,
        torque=record.torque,
        rate_hz=record.rate_hz,
        encoder_step=record.encoder_step,
        usable=record.usable & record.is_fitted(edge=edge),
        **actuator,
    )


def actuator_of_leg(record: Record) -> FrictionlessActuator | None:
    """How a leg's actuator, whose friction opposes its velocity and grows with the current, moves
    without it; None where the recording cannot tell it."""
    actuator = record.actuator
    if "wide_band_theta_m" not in actuator:
        return None
    with suppress(NotWeighedError):
        return frictionless_actuator(
            raw_signals(
                record,
                sliding_angle=actuator["wide_band_theta_m"],
                load=actuator.get("current"),
            )
        )
    return None


def friction_of_leg(
    s: Sums, analysis: Analysis, actuator: FrictionlessActuator | None
) -> DryFriction:
    """Dry friction of a leg: that of its `actuator`, behind the belt, where the recording tells how
    this moves without friction; else that of a joint, if there is theta_m."""
    if actuator is None:
        friction = coulomb_fit(s, analysis)
        if "theta_m" in analysis.record.actuator:
            return friction
        # without theta_m the drivetrain passes for friction of the joint
        return DryFriction(s, is_untold=friction.is_untold)
    if actuator.friction_probability > CERTAIN_FRICTION:
        return frictionless_leg(analysis, actuator)
    return DryFriction(s)


def frictionless_leg(analysis: Analysis, actuator: FrictionlessActuator) -> DryFriction:
    """Fit Eq. 15 to the torque that a leg would have without the friction of its actuator.

    Friction turns the actuator to theta_m instead of theta_m0, and the belt makes a torque of it:
    kappa (theta_m - theta_m0), where kappa is the slope of the torque over theta_m beside the
    joint's motion.

    Returns
    -------
    DryFriction
        Its size need not show.
    """
    record = analysis.record
    coarse = record.coarse
    columns = columns_of(coarse)
    X = np.array([columns[column] for column in IMPEDANCE.values()])
    rows = coarse.is_fitted()
    theta_m = coarse.actuator["theta_m"]
    beside = np.vstack([X, theta_m])[:, rows]
    stiffness, *_, kappa = np.linalg.lstsq(beside.T, coarse.filtered_torque[rows])[0]
    theta = coarse.motion.theta
    wound = theta + kappa / stiffness * theta_m
    (hysteresis,) = slipping_springs(wound, FRICTION_WINDS[-1:])
    # friction and the belt's hysteresis look alike: how much is whose is told between all of the
    # hysteresis and none. Angles are linear in it, so that half of it makes their mean
    torques = kappa * (theta_m - actuator.angles(theta, hysteresis / 2, coarse.rate_hz))
    by_all_blocks = replace(actuator, coefficients=actuator.coefficients[:1])
    (half_range,) = by_all_blocks.angles(0 * theta, hysteresis / 2, coarse.rate_hz)
    hysteresis_torque = kappa * half_range
    with_friction = {**columns, "T_C": torques[0]}
    sums = gram_sums(coarse, with_friction, record.angle_noise, keep_fast=True)
    fit = least_squares(sums.less("T_C", 1.0), IMPEDANCE)
    by_torque = np.linalg.pinv(X[:, rows].T)
    of_blocks = deviations(torques[:, rows] @ by_torque.T)
    of_formula = MISSED_OF_FRICTION * (analysis.whole.estimates - fit.estimates)
    of_bounds = by_torque @ hysteresis_torque[rows] / np.sqrt(3)  # a rectangular distribution
    errors = np.vstack([of_blocks, of_formula, of_bounds])
    fit = fit.with_known_error(Source.FRICTION_SHAPE, np.linalg.norm(errors, axis=0))
    return DryFriction(sums, with_errors_of(analysis, fit))


def inferred_of_joint(record: Record) -> ImpedanceInference | None:
    """What may be wrong with the recording of a joint that no actuator renders; None where
    candidate models cannot be weighed, as in a short one.

    None is weighed of a motion beyond `BEYOND` cut-offs: where the acceleration jumps, the torque
    jumps at one of the samples, which is like a delay that differs from jump to jump."""
    if record.band_hz[1] > BEYOND * record.settings.cutoff_hz:
        return None
    with suppress(NotWeighedError):
        return infer_impedance(raw_signals(record))
    return None


def friction_of_joint(s: Sums, analysis: Analysis, joint: ImpedanceInference | None) -> DryFriction:
    """Dry friction of a joint: where the inference is certain of it, or, without an inference, the
    Coulomb column itself."""
    friction = coulomb_fit(s, analysis)
    if joint is None:
        return friction
    if friction.without and joint.friction_probability > CERTAIN_FRICTION:
        return replace(friction, without=with_other_shapes(friction.without, joint))
    is_untold = friction.is_untold or passes_for_damping(s, analysis)
    return DryFriction(s, is_untold=is_untold)


def with_other_shapes(fit: LinearFit, joint: ImpedanceInference) -> LinearFit:
    """A joint's fit without friction, with what friction of another shape would change, as the
    inference tells: a rectangular distribution (JCGM 100:2008, 4.3.7)."""
    others = [joint.without_friction.get(name, fit[name]) for name in fit.names]
    return fit.with_known_error(Source.FRICTION_SHAPE, (others - fit.estimates) / np.sqrt(3))


def passes_for_damping(s: Sums, analysis: Analysis) -> bool:
    """Whether the Coulomb column takes a part of the damping of a joint."""
    friction = friction_beside(s, analysis.model)
    if not friction.certain("T_C"):
        return False
    damping = without_friction(s, analysis.model, friction)["B"]
    return abs(1 - damping / analysis.whole["B"]) > SEEN_SHARE
