"""K, B and I of an impedance recording by Eq. 15, and what else its torque may hold.

The inference (`osl_analysis/inference`) says whether dry friction is certain and what may be wrong.
Where friction is certain, K, B and I without it are those of the inference. A Coulomb column beside
Eq. 15, which single amplitudes have, sees what the low-pass leaves of a friction that changes its
sign fast: its B is up to 6 % too large.
"""

from dataclasses import replace

import numpy as np

from osl_analysis.bench.analysis import QUANTITIES, Analysis
from osl_analysis.bench.coulomb import CoulombFit, coulomb_fits
from osl_analysis.bench.joint_fit import FrictionFit, JointFit, SuspectedFault
from osl_analysis.bench.record import Label, Record, signals_of
from osl_analysis.bench.regression import Sums, fit_groups
from osl_analysis.errors import NotWeighedError
from osl_analysis.inference import ImpedanceInference, LegInference, infer_impedance, infer_leg
from osl_analysis.inference.constants import HARM_SHARE, LIKELY
from osl_analysis.inference.estimates import Explanation
from osl_analysis.stats.estimates import Estimate, Impedance

CERTAIN_FRICTION = 0.9  # probability from which friction is taken off B: nine in ten are right
NAMED_SHARE = 0.05  # of all faults' probability, below which an explanation is not named


def impedance_fits(analysis: Analysis, s: Sums, is_leg: bool) -> dict[Label, JointFit]:
    """Fit K, B and I to all of a recording (None) and to each amplitude [deg].

    Parameters
    ----------
    analysis : Analysis
        Eq. 15 by least squares.
    s : Sums
        The sums of the record with all effects.
    is_leg : bool
        Whether a belt and an actuator render the joint.
    """
    record = analysis.record
    inferred = inferred_from(record, is_leg)
    friction_is_certain = None
    if inferred is not None:
        friction_is_certain = inferred.friction_probability > CERTAIN_FRICTION
    coulomb = coulomb_fits(s, analysis, friction_is_certain)

    whole = JointFit(
        impedance=Impedance.of_fit(analysis.calibrated(analysis.whole)),
        friction=friction_of(coulomb.get(None)),
    )
    if inferred is not None:
        friction = friction_by_inference(coulomb.get(None), analysis, inferred, is_leg)
        whole = replace(whole, friction=friction)
    if isinstance(inferred, ImpedanceInference):
        whole = with_fault(whole, inferred, record)
    if record.with_other_stamps is not None:
        whole = with_other_reading(whole, analysis)

    fits: dict[Label, JointFit] = {}
    for label, fit in analysis.fits.items():
        if label is None:
            fits[label] = whole
            continue
        fits[label] = JointFit(
            impedance=Impedance.of_fit(analysis.calibrated(fit, label)),
            friction=friction_of(coulomb.get(label)),
            suspected_fault=whole.suspected_fault,
            delay_told_s=whole.delay_told_s,
        )
    return fits


def inferred_from(record: Record, is_leg: bool) -> ImpedanceInference | LegInference | None:
    """The inference from a record; None where it cannot weigh rivals."""
    infer = infer_leg if is_leg else infer_impedance
    try:
        return infer(signals_of(record, is_leg))
    except NotWeighedError:
        return None


def with_fault(fit: JointFit, inferred: ImpedanceInference, record: Record) -> JointFit:
    """The fit with what may be wrong with a recording, and how well it tells a delay."""
    fault = probable_fault(inferred)
    path_is_found = fault is not None and fault.family == "path"
    tells_delay = not path_is_found and not is_delay_stated(record)
    return replace(
        fit,
        suspected_fault=suspected_fault_of(inferred),
        delay_told_s=inferred.delay_told_s if tells_delay else None,
    )


def with_other_reading(fit: JointFit, analysis: Analysis) -> JointFit:
    """The fit with intervals that hold what the other reading of undecided stamps gives. It moves
    the estimates without friction as those of Eq. 15."""
    other = Impedance.of_fit(analysis.fits_with_other_stamps[None])
    friction = fit.friction
    if friction is not None and friction.without is not None:
        moved = friction.without.moved_by(fit.impedance, other)
        friction = replace(friction, without=friction.without.widened_to_include(moved))
    other = other.widened_by(known_errors(analysis))
    return replace(fit, impedance=fit.impedance.widened_to_include(other), friction=friction)


def suspected_fault_of(inferred: ImpedanceInference) -> SuspectedFault:
    """What may be wrong with a recording."""
    fault = probable_fault(inferred)
    return SuspectedFault(
        # sums over no hypotheses are whole numbers
        fault_probability=float(inferred.fault_probability),
        fault_shares=inferred.fault_shares if inferred.doubt else (0.0, 0.0, 0.0),
        family=fault.family if fault else None,
        explanations=named_explanations(inferred) if fault else None,
        unexplained_shares=inferred.unexplained_shares,
        delay_told_s=inferred.delay_told_s,
    )


def suspected_fault_of_losses(record: Record) -> SuspectedFault | None:
    """What may be wrong with a recording of losses, whose stiffness nobody asks for; None where it
    is too short to tell."""
    of_B, of_I = HARM_SHARE[1:]
    try:
        inferred = infer_impedance(signals_of(record), accuracy=(np.inf, of_B, of_I))
    except NotWeighedError:
        return None
    return suspected_fault_of(inferred)


def known_errors(analysis: Analysis) -> dict[str, float]:
    """Standard errors of K, B and I that all samples share, and no scatter shows: what is stated of
    the bench, and a band that hardly tells I."""
    told = analysis.calibrated(analysis.whole)
    bare = fit_groups(analysis.sums, analysis.model)
    variances = {name: told.se(name) ** 2 - bare.se(name) ** 2 for name in QUANTITIES}
    return {name: float(np.sqrt(max(variance, 0.0))) for name, variance in variances.items()}


def friction_of(coulomb: CoulombFit | None) -> FrictionFit | None:
    """Coulomb friction by least squares, and K, B and I without it where it is certain."""
    if coulomb is None:
        return None
    certain = coulomb.certain
    if certain is None:
        return FrictionFit(coulomb.share)
    return FrictionFit(coulomb.share, Estimate.of_fit(certain, "T_C"), Impedance.of_fit(certain))


def friction_by_inference(
    coulomb: CoulombFit | None,
    analysis: Analysis,
    inferred: ImpedanceInference | LegInference,
    is_leg: bool,
) -> FrictionFit:
    """Friction whose effect the inference tells, and least squares the size.

    Of a joint whose friction has no certain size none is taken off. That of a leg acts behind its
    belt, where its size need not show.
    """
    size = None
    if coulomb is not None and coulomb.certain is not None:
        size = Estimate.of_fit(coulomb.certain, "T_C")
    has_size = is_leg or size is not None
    if inferred.friction_probability <= CERTAIN_FRICTION or not has_size:
        return FrictionFit(share=0.0)
    without = inferred.without_friction.widened_by(known_errors(analysis))
    damping = analysis.whole["B"]
    return FrictionFit(max(damping - without.B.value, 0.0) / damping, size, without)


def probable_fault(inferred: ImpedanceInference) -> Explanation | None:
    """The most probable fault; None where the recording is probably sound."""
    if inferred.doubt is not None:
        return inferred.doubt
    if inferred.fault_probability > LIKELY and inferred.explanations:
        return inferred.explanations[0]
    return None


def named_explanations(inferred: ImpedanceInference) -> str:
    """Names of the faults that are not improbable, the most probable first."""
    least = NAMED_SHARE * inferred.fault_probability
    names = [each.name for each in inferred.explanations if each.probability > least]
    return ", ".join(dict.fromkeys(names))


def is_delay_stated(record: Record) -> bool:
    """Whether somebody stated the delay between angle and torque, or how well it is known."""
    streams = record.uniform.streams if record.uniform else ()
    stated = [stream["delay_s"] for stream in streams]
    return record.calibration.delay > 0 or any(stated)
