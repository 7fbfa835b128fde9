"""Coulomb friction beside a model, by least squares: a torque that has the velocity's sign.

It serves what the inference does not weigh: single amplitudes, a leg, and losses without K. A leg's
friction acts behind a spring, so that the sign is its only column.
"""

from contextlib import suppress
from dataclasses import dataclass, replace

import numpy as np

from osl_analysis.bench.analysis import Analysis, widened
from osl_analysis.bench.effects import FALSE_ALARM, Model, with_effects
from osl_analysis.bench.record import Label
from osl_analysis.bench.regression import GroupFit, Sums
from osl_analysis.errors import IdentifiabilityError


@dataclass(frozen=True)
class CoulombFit:
    """Coulomb friction in the rows of a label."""

    # part of the damping that it makes, the smaller of those beside higher derivatives and without;
    # 0 where none is certain over all of the trial
    share: float
    # the model's estimates for the torque less its friction, and the friction `T_C` [N*m]; None
    # where it is not certain in these rows
    certain: GroupFit | None


def coulomb_fits(
    s: Sums, analysis: Analysis, whole_is_certain: bool | None = None
) -> dict[Label, CoulombFit]:
    """Coulomb friction by label; labels whose motion does not tell it from damping are absent.

    No recording shows over which velocity the sign changes: what a tenth of the width changes is
    the half-width of a rectangular distribution (JCGM 100:2008, 4.3.7).

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
    fits: dict[Label, CoulombFit] = {}
    for label in sorted(analysis.fits, key=lambda each: each is not None):  # the whole trial first
        fit = analysis.fits[label]
        try:
            smooth = without_friction(s, model, fit, label, "T_C")
            is_certain = smooth["T_C"] > 0 and smooth.certain("T_C", FALSE_ALARM)
            if whole_is_certain is None:
                whole_is_certain = is_certain
            # a controller may compensate friction that is not Coulomb's: the smaller of two answers
            # counts
            alone = with_effects(s, model, ("T_C",), label)
            viscous = max(smooth[damping], alone[damping])
            share = max(1 - viscous / fit[damping], 0.0) if whole_is_certain else 0.0
            certain = None
            if is_certain and whole_is_certain:
                sharp = without_friction(s, model, fit, label, "T_C_sharp")
                half_width = sharp.estimates - smooth.estimates
                certain = analysis.calibrated(widened(smooth, half_width / np.sqrt(3)), label)
        except IdentifiabilityError:
            continue
        fits[label] = CoulombFit(share, certain)
    return fits


def with_friction(s: Sums, model: Model, label: Label, friction: str = "T_C") -> GroupFit:
    """Fit with friction and the higher derivatives of the angle that the motion determines: without
    these a linear drivetrain's deviation from Eq. 15 passes for friction of 0.4 N*m. Raises
    IdentifiabilityError as `fit_groups`."""
    for higher in (("jerk", "snap"), ("jerk",)):
        with suppress(IdentifiabilityError):
            return with_effects(s, model, (friction, *higher), label)
    return with_effects(s, model, (friction,), label)


def without_friction(s: Sums, model: Model, fit: GroupFit, label: Label, column: str) -> GroupFit:
    """The estimates of a fit to a label for the torque less its friction, and this friction `T_C`
    [N*m], whose sign changes as in a column.

    Two fits share the work. The one `beside` higher derivatives gives the friction T_C and its
    error. The one `alone`, without these, gives by how much friction of 1 N*m moves each estimate,
    and the error of the estimates if T_C were known (their covariance, given T_C):

        x = x_without_column - (dx/dT_C) T_C
    """
    alone = with_effects(s, model, (column,), label)
    beside = with_friction(s, model, label, column)
    at = [k for k, name in enumerate(model.values()) if name in ("theta", "omega", "alpha")]
    at_friction = alone.names.index(column)
    change_per_torque = (fit.estimates[at] - alone.estimates[at]) / alone[column]
    T_C = beside[column]

    with_T_C = alone.covariance[at, at_friction]
    variance_of_T_C = alone.covariance[at_friction, at_friction]
    changes = np.append(-change_per_torque, 1.0)
    covariance = beside.se(column) ** 2 * np.outer(changes, changes)
    covariance[:-1, :-1] += alone.covariance[np.ix_(at, at)]
    covariance[:-1, :-1] -= np.outer(with_T_C, with_T_C) / variance_of_T_C
    return replace(
        beside,
        names=(*(fit.names[k] for k in at), "T_C"),
        estimates=np.append(fit.estimates[at] - change_per_torque * T_C, T_C),
        covariance=covariance,
        degrees_of_freedom=np.full(len(changes), beside.freedom(column)),
    )
