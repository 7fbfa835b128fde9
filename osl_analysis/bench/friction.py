"""Friction beside K, B and I of Eq. 15, and what else the torque of a recording may hold.

The inference (`osl_analysis/inference`) says whether dry friction is certain and what may be wrong.
Where friction is certain, K, B and I of a joint without it are those of Eq. 15 with a Coulomb
column, a torque that has the velocity's sign. The inference weighs friction of other shapes too:
where its estimate lies outside the column's interval, as with bristles, the interval is widened to
hold both. A leg's friction acts behind a spring, so that the inference tells its effect, by the
actuator's angle.
"""

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, replace

import numpy as np

from osl_analysis.bench.impedance import QUANTITIES, Analysis
from osl_analysis.bench.record import Label, Record
from osl_analysis.bench.regression import BEYOND, GroupFit, Model, Sums, with_effects
from osl_analysis.errors import IdentifiabilityError, NotWeighedError
from osl_analysis.inference import (
    BenchSignals,
    ImpedanceInference,
    LegInference,
    infer_impedance,
    infer_leg,
)
from osl_analysis.inference.constants import HARM_SHARE, LIKELY
from osl_analysis.inference.infer import Explanation
from osl_analysis.stats.estimates import Estimate, Row
from osl_analysis.trial import Array

WITHOUT_FRICTION = {
    "T_C": "f_C",
    "B": "B_viscous",
    "K": "K_without_friction",
    "I": "I_without_friction",
}
"""Columns of a friction, and of K, B and I without it."""
AT_REST = 0.1  # SD of the velocity, below which a joint rests
# share of the rows at rest, above which it mostly rests: 0.77 to 0.87 under binary steps, of ramps
# and a hand at most 0.56
MOST_REST = 2 / 3
CERTAIN_FRICTION = 0.9  # probability from which friction is taken off B: nine in ten are right
# share of B from which friction counts that the column sees and the inference does not; rounding
# makes 0.012 of sound recordings
SEEN_SHARE = 0.02
NAMED_SHARE = 0.05  # of all faults' probability, below which an explanation is not named


@dataclass(frozen=True)
class CoulombFit:
    """Coulomb friction in the rows of a label."""

    # part of the damping that it makes, the smaller of those beside higher derivatives and without;
    # 0 where none is certain over all of the trial
    share: float
    # the model's estimates for the torque less its friction, and the friction `T_C` [N*m]; None
    # where it is not certain in these rows
    certain: GroupFit | None
    is_seen: bool  # whether the column takes a part of the damping, of either sign


def coulomb_fits(
    s: Sums, analysis: Analysis, whole_is_certain: bool | None = None
) -> dict[Label, CoulombFit]:
    """Coulomb friction by label; labels whose motion does not tell it from damping are absent.

    A joint that mostly rests moves by steps between a few levels: each has the same speeds, at
    which friction and damping are one number, and at rest the velocity has no sign but that of
    noise. Then all labels are absent.

    No recording shows over which velocity the sign changes: what a tenth of the width changes is
    taken for a standard uncertainty.

    Parameters
    ----------
    s : Sums
        The sums of the record with all effects.
    analysis : Analysis
        The model's fits, one of whose columns is the velocity.
    whole_is_certain : bool, optional
        Whether the whole trial has friction, where that is known; by default this fit decides.
    """
    velocity = analysis.record.motion.omega[analysis.record.rows()]
    if np.mean(np.abs(velocity) < AT_REST * velocity.std()) > MOST_REST:
        return {}
    model = analysis.model
    damping = next(name for name, column in model.items() if column == "omega")
    fits: dict[Label, CoulombFit] = {}
    for label in sorted(analysis.fits, key=lambda each: each is not None):  # the whole trial first
        fit = analysis.fits[label]
        try:
            sums = s.of(label)
            # a controller may compensate friction that is not Coulomb's: the smaller of two answers
            # counts
            alone = with_effects(sums, model, "T_C")
            smooth = without_friction(sums, model, alone)
            is_seen = smooth.certain("T_C")
            is_certain = is_seen and smooth["T_C"] > 0
            if whole_is_certain is None:
                whole_is_certain = is_certain
            viscous = max(smooth[damping], alone[damping])
            share = max(1 - viscous / fit[damping], 0.0) if whole_is_certain else 0.0
            certain = None
            if is_certain and whole_is_certain:
                sharp_alone = with_effects(sums, model, "T_C_sharp")
                sharp = without_friction(sums, model, sharp_alone)
                of_width = sharp.estimates - smooth.estimates
                certain = smooth.with_known_error("friction_sign", of_width)
                at = [fit.names.index(name) for name in smooth.names[:-1]]
                for error in fit.known_errors:
                    change = np.append(error.change[at], 0.0)
                    certain = certain.with_known_error(error.source, change)
                certain = analysis.with_bench_errors(certain, label)
        except IdentifiabilityError:
            continue
        taken = abs(1 - smooth[damping] / fit[damping])
        fits[label] = CoulombFit(share, certain, is_seen and taken > SEEN_SHARE)
    return fits


def without_friction(s: Sums, model: Model, alone: GroupFit) -> GroupFit:
    """The estimates for the torque less its friction, and this friction `T_C` [N*m], whose sign
    changes as in the last column of the fit `alone`.

    Two fits share the work. The one `beside` the higher derivatives of the angle that the motion
    determines gives the friction T_C and its error: without these a linear drivetrain's deviation
    from Eq. 15 passes for friction of 0.4 N*m. The one `alone`, without these, gives by how much
    friction of 1 N*m moves each estimate, and the error of the estimates if T_C were known (their
    covariance, given T_C):

        x = x_without_column - (dx/dT_C) T_C
    """
    beside = alone
    column = alone.names[-1]
    for higher in (("jerk", "snap"), ("jerk",)):
        with suppress(IdentifiabilityError):
            beside = with_effects(s, model, column, *higher)
            break
    at = [k for k, name in enumerate(model.values()) if name in ("theta", "omega", "alpha")]
    at_friction = alone.names.index(column)
    plain = s.estimates([*model.values()])
    change_per_torque = (plain[at] - alone.estimates[at]) / alone[column]
    T_C = beside[column]

    with_T_C = alone.covariance[at, at_friction]
    variance_of_T_C = alone.covariance[at_friction, at_friction]
    changes = np.append(-change_per_torque, 1.0)
    covariance = beside.se(column) ** 2 * np.outer(changes, changes)
    covariance[:-1, :-1] += alone.covariance[np.ix_(at, at)]
    covariance[:-1, :-1] -= np.outer(with_T_C, with_T_C) / variance_of_T_C
    return replace(
        beside,
        names=(*(alone.names[k] for k in at), "T_C"),
        estimates=np.append(plain[at] - change_per_torque * T_C, T_C),
        covariance=covariance,
        degrees_of_freedom=np.full(len(changes), beside.freedom(column)),
    )


def raw_signals(record: Record, **actuator: Array | None) -> BenchSignals:
    """The raw signals of a record near the fitted rows, since the inference finds their band
    itself; `actuator` has those of a leg's."""
    # the ends of fitted stretches are left out for the sake of the fit's own filter
    edge = round(2 * record.rate_hz / record.settings.cutoff_hz)
    return BenchSignals(
        theta=record.theta,
        torque=record.torque,
        rate_hz=record.rate_hz,
        encoder_step=record.encoder_step,
        usable=record.usable & record.is_fitted(edge=edge),
        **actuator,
    )


def inferred_of_leg(record: Record) -> LegInference | None:
    """The friction in a leg's actuator, which opposes its velocity and grows with the current; None
    where the recording cannot tell it."""
    actuator = record.actuator
    with suppress(NotWeighedError):
        return infer_leg(
            raw_signals(
                record,
                sliding_angle=actuator["wide_band_theta_m"],
                load=actuator.get("current"),
            )
        )
    return None


def inferred_of_joint(
    record: Record, accuracy: tuple[float, float, float] = HARM_SHARE
) -> ImpedanceInference | None:
    """What may be wrong with the recording of a joint that no actuator renders; None where rivals
    cannot be weighed, as in a short one. `accuracy` has the shares of K, B and I from which a fault
    matters.

    None is weighed of a motion beyond `BEYOND` cut-offs: where the acceleration jumps, the torque
    jumps at one of the samples, which is like a delay that differs from jump to jump."""
    if record.band_hz[1] > BEYOND * record.settings.cutoff_hz:
        return None
    with suppress(NotWeighedError):
        return infer_impedance(raw_signals(record), accuracy)
    return None


def friction_columns(
    analysis: Analysis,
    inferred: ImpedanceInference | LegInference | None,
    coulomb: CoulombFit | None,
    label: Label,
    is_leg: bool,
) -> Row:
    """The columns of friction, as far as the motion tells it from damping.

    Of a whole trial the inference tells whether there is friction. Of a joint least squares tells
    its size and effect; where its size is not certain, none is taken off. Its intervals hold those
    of the inference where both disagree. Friction of a leg acts behind its belt, where its size
    need not show, so that the inference tells its effect.

    Parameters
    ----------
    analysis : Analysis
        Eq. 15.
    inferred : ImpedanceInference or LegInference or None
        What the inference says of the recording.
    coulomb : CoulombFit or None
        Of the label, as of `coulomb_fits`.
    label : Label
        The row's.
    is_leg : bool
        Whether a belt and an actuator render the joint.
    """
    share = coulomb.share if coulomb else None
    estimates = {}
    if coulomb and coulomb.certain:
        estimates = {name: Estimate.of_fit(coulomb.certain, name) for name in WITHOUT_FRICTION}
    if label is None and inferred is not None:
        if inferred.friction_probability > CERTAIN_FRICTION and (is_leg or estimates):
            # what is stated of the bench, and a band that hardly tells them, no scatter shows
            for name, of_other_shapes in inferred.without_friction.items():
                weighed = of_other_shapes.widened_by(analysis.calibrated[None].se_bench(name))
                estimates[name] = weighed if is_leg else widened_to(estimates[name], weighed)
        # the column sees what the inference does not: the motion does not tell it from damping
        share = 0.0 if is_leg or (coulomb and not coulomb.is_seen) else None
        if estimates:
            share = max(1 - estimates["B"].value / analysis.whole["B"], 0.0)
    row: Row = {"coulomb_share": share}
    for name, estimate in estimates.items():
        moved = with_other_stamps(analysis, estimate, name, label)
        row |= moved.columns(WITHOUT_FRICTION[name])
    return row


def widened_to(estimate: Estimate, weighed: Estimate) -> Estimate:
    """An estimate whose interval also holds another one of other shapes of friction, where that
    lies outside it."""
    if estimate.low <= weighed.value <= estimate.high:
        return estimate
    return replace(
        estimate, low=min(estimate.low, weighed.low), high=max(estimate.high, weighed.high)
    )


def with_other_stamps(
    analysis: Analysis, estimate: Estimate, name: str, label: Label = None
) -> Estimate:
    """K, B or I of all of a trial, with an interval that also holds it moved as the other reading
    of undecided stamps moves Eq. 15. Of single amplitudes, and of the friction, the estimate."""
    other = analysis.fits_with_other_stamps.get(None)
    if other is None or label is not None or name not in other.names:
        return estimate
    by = other[name] - analysis.whole[name]
    return replace(estimate, low=estimate.low + min(by, 0), high=estimate.high + max(by, 0))


def suspected_fault_of_losses(record: Record) -> ImpedanceInference | None:
    """What may be wrong with a recording of losses, whose stiffness nobody asks for."""
    return inferred_of_joint(record, accuracy=(np.inf, *HARM_SHARE[1:]))


def probable_fault(joint: ImpedanceInference) -> Explanation | None:
    """The most probable fault; None where the recording is probably sound."""
    if joint.doubt is None and joint.fault_probability > LIKELY:
        return joint.explanations[0]
    return joint.doubt


def explanations_of(joint: ImpedanceInference) -> str | None:
    """All faults that are not improbable beside each other, the most probable first; None where no
    fault is probable."""
    if probable_fault(joint) is None:
        return None
    least = NAMED_SHARE * joint.fault_probability
    names = [each.name for each in joint.explanations if each.probability > least]
    return ", ".join(dict.fromkeys(names))


def fault_columns(
    joint: ImpedanceInference, record: Record, names: Sequence[str | None] = QUANTITIES
) -> Row:
    """The columns of a fault. `names` are those of K, B and I in the table; None: it has no such
    column."""
    fault = probable_fault(joint)
    family = fault.family if fault else None
    # a delay between angle and torque that nobody states, and that is not found
    stated_s = [record.settings.calibration.delay, *(each["delay_s"] for each in record.streams)]
    is_told = any(stated_s) or family == "path"
    row: Row = {
        "fault_probability": joint.fault_probability,
        "fault_family": family,
        "explanations": explanations_of(joint),
        "delay_se_s": None if is_told else joint.delay_se_s,
    }
    moved = joint.fault_shares if fault else (0.0, 0.0, 0.0)
    for name, by_fault, left in zip(names, moved, joint.unexplained_shares, strict=True):
        if name is not None:
            row[f"{name}_fault_share"] = by_fault
            row[f"{name}_unexplained_share"] = left
    return row
