"""Coulomb friction beside a model, by least squares: a torque that has the velocity's sign.

It serves what the inference does not weigh: single amplitudes, a leg, and losses without K. A leg's
friction acts behind a spring, so that the sign is its only column.
"""

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, replace

import numpy as np

from osl_analysis.bench.analysis import Analysis, widened
from osl_analysis.bench.effects import FALSE_ALARM, Model, with_effects
from osl_analysis.bench.record import Label
from osl_analysis.bench.regression import GroupFit, Sums
from osl_analysis.errors import IdentifiabilityError
from osl_analysis.stats.linear_fit import LinearFit


@dataclass(frozen=True)
class CoulombFit:
    """Coulomb friction in the rows of a label.

    Attributes
    ----------
    share : float
        The part of the damping that it makes, the smaller of two answers; 0 where none is certain
        over all of the trial.
    certain : LinearFit or None
        The model's estimates for the torque less its friction, and the friction `T_C`; None where
        it is not certain.
    """

    share: float
    certain: LinearFit | None


def coulomb_fits(
    s: Sums, analysis: Analysis, whole_is_certain: bool | None = None
) -> dict[Label, CoulombFit]:
    """Coulomb friction by label; labels whose motion does not tell it from damping are absent.

    Parameters
    ----------
    s : Sums
        The sums of the record with all effects.
    analysis : Analysis
        The model's fits, one of whose columns is the velocity.
    whole_is_certain : bool, optional
        Whether the whole trial has friction, where that is known; by default this fit decides.
    """
    model = analysis.model
    damping = next(name for name, column in model.items() if column == "omega")
    names = [name for name, column in model.items() if column in ("theta", "omega", "alpha")]
    decides = whole_is_certain is None
    found: dict[Label, CoulombFit] = {}
    for label in sorted(analysis.fits, key=lambda each: each is not None):  # the whole trial first
        fit = analysis.fits[label]
        try:
            beside = with_friction(s, model, label)
            alone = with_effects(s, model, ("T_C",), label)
        except IdentifiabilityError:
            continue
        torque = beside["T_C"]
        # damping that friction makes, as the fit without higher derivatives shows it
        damping_alone = fit[damping] - alone[damping]
        damping_per_torque = damping_alone / alone["T_C"]
        friction_damping = damping_per_torque * torque
        is_certain = torque > 0 and beside.certain("T_C", FALSE_ALARM)
        if label is None and decides:
            whole_is_certain = is_certain
        share = 0.0
        if whole_is_certain:
            # a controller may compensate friction that is not Coulomb's: the smaller of two answers
            # counts as evidence
            share = max(min(friction_damping, damping_alone), 0.0) / fit[damping]
        certain = None
        if is_certain and (decides or whole_is_certain):
            certain = analysis.calibrated(without_sign(s, model, fit, names, label), label)
        found[label] = CoulombFit(share, certain)
    return found


def without_sign(
    s: Sums, model: Model, fit: GroupFit, names: Sequence[str], label: Label
) -> GroupFit:
    """The estimates `names` of a fit for the torque less a friction that has the velocity's sign,
    and this friction.

    No recording shows over which velocity the sign changes: what a tenth of the width changes is
    the half-width of a rectangular distribution (JCGM 100:2008, 4.3.7).
    """

    def less_friction(column: str) -> GroupFit:
        """The estimates with friction of one width."""
        alone = with_effects(s, model, (column,), label)
        beside = with_friction(s, model, label, column)
        return without_friction(fit, alone, beside, names, column)

    smooth = less_friction("T_C")
    sharp = less_friction("T_C_sharp")
    half_width = sharp.estimates - smooth.estimates
    return widened(smooth, half_width / np.sqrt(3))


def with_friction(s: Sums, model: Model, label: Label, friction: str = "T_C") -> GroupFit:
    """Fit with friction and the higher derivatives of the angle that the motion determines: without
    these a linear drivetrain's deviation from Eq. 15 passes for friction of 0.4 N*m. Raises
    IdentifiabilityError as `fit_groups`."""
    for higher in (("jerk", "snap"), ("jerk",)):
        with suppress(IdentifiabilityError):
            return with_effects(s, model, (friction, *higher), label)
    return with_effects(s, model, (friction,), label)


def without_friction(
    fit: LinearFit, alone: GroupFit, beside: GroupFit, names: Sequence[str], friction: str
) -> GroupFit:
    """The estimates for the torque less its friction, and this friction [N*m].

    Two fits share the work. The one `beside` higher derivatives gives the friction T_C and its
    error. The one `alone`, without these, gives by how much friction of 1 N*m moves each estimate,
    and the error of the estimates if T_C were known (their covariance, given T_C):

        x = x_without_column - (dx/dT_C) T_C
    """
    without_column = np.array([fit[name] for name in names])
    with_column = np.array([alone[name] for name in names])
    change_per_torque = (without_column - with_column) / alone[friction]
    T_C = beside[friction]

    at = [alone.names.index(name) for name in names]
    at_friction = alone.names.index(friction)
    with_T_C = alone.covariance[at, at_friction]
    variance_of_T_C = alone.covariance[at_friction, at_friction]
    given_T_C = alone.covariance[np.ix_(at, at)] - np.outer(with_T_C, with_T_C) / variance_of_T_C

    changes = np.append(-change_per_torque, 1.0)
    covariance = beside.se(friction) ** 2 * np.outer(changes, changes)
    covariance[:-1, :-1] += given_T_C
    return replace(
        beside,
        names=(*names, friction),
        estimates=np.append(without_column - change_per_torque * T_C, T_C),
        covariance=covariance,
        degrees_of_freedom=np.full(len(changes), beside.freedom(friction)),
        repeat=None,
    )
