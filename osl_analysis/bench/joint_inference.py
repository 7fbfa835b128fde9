"""K, B and I of an impedance recording, by the one inference (`osl_analysis/inference`).

A person's joint or a device's is the mixture of the hypotheses. A leg is of higher order, so that
its K, B and I are Eq. 15's by least squares, as the paper's are; the inference reads them without
the friction of the actuator, and its drivetrain is no fault of the recording. Single amplitudes are
Eq. 15's, too.
"""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from osl_analysis.bench.analysis import QUANTITIES, Analysis
from osl_analysis.bench.coulomb import CoulombFit, coulomb_fits
from osl_analysis.bench.joint_fit import (
    MIXTURE,
    MIXTURE_BESIDE_FRICTION,
    FrictionFit,
    JointFit,
    SuspectedFault,
)
from osl_analysis.bench.record import Label, Record, signals_of
from osl_analysis.bench.regression import Sums, fit_groups
from osl_analysis.errors import NotWeighedError
from osl_analysis.inference import ImpedanceInference, infer_impedance
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
    errors = known_errors(analysis)
    inferred = inferred_from(record, is_leg)
    friction_is_certain = None
    if inferred is not None:
        friction_is_certain = inferred.friction_probability > CERTAIN_FRICTION
    coulomb = coulomb_fits(s, analysis, friction_is_certain)

    equation_15 = Impedance.of_fit(analysis.calibrated(analysis.whole))
    least_squares = JointFit(equation_15, by_coulomb(coulomb.get(None)))
    whole = whole_fit(least_squares, inferred, coulomb.get(None), errors, is_leg, record)
    if record.with_other_stamps is not None:
        again = None if is_leg else inferred_from(read_otherwise(record), is_leg)
        equation_15 = Impedance.of_fit(analysis.fits_with_other_stamps[None]).widened_by(errors)
        least_squares = replace(least_squares, impedance=equation_15)
        other = whole_fit(least_squares, again, coulomb.get(None), errors, is_leg, record)
        whole = whole.widened_to_include(other)

    fits: dict[Label, JointFit] = {}
    for label, fit in analysis.fits.items():
        if label is None:
            fits[label] = whole
            continue
        fits[label] = JointFit(
            impedance=Impedance.of_fit(analysis.calibrated(fit, label)),
            friction=by_coulomb(coulomb.get(label)),
            suspected_fault=whole.suspected_fault,
            delay_told_s=whole.delay_told_s,
        )
    return fits


def inferred_from(record: Record, is_leg: bool) -> ImpedanceInference | None:
    """The inference from a record; None where it cannot weigh rivals."""
    try:
        return infer_impedance(signals_of(record, is_leg))
    except NotWeighedError:
        return None


def read_otherwise(record: Record) -> Record:
    """The record with the other reading of undecided stamps, and the resolution of its sensors."""
    assert record.with_other_stamps is not None
    return replace(record.with_other_stamps, steps=record.steps)


def whole_fit(
    least_squares: JointFit,
    inferred: ImpedanceInference | None,
    coulomb: CoulombFit | None,
    known_errors: Mapping[str, float],
    is_leg: bool,
    record: Record,
) -> JointFit:
    """Choose what gives K, B and I of a whole recording.

    Parameters
    ----------
    least_squares : JointFit
        Eq. 15, with what is stated of the bench in its intervals.
    inferred : ImpedanceInference or None
        The inference; None where it cannot weigh rivals.
    coulomb : CoulombFit or None
        Coulomb friction by least squares.
    known_errors : Mapping
        Standard errors that all samples share, by symbol.
    is_leg : bool
        Whether a belt and an actuator render the joint.
    record : Record
        The recording, for what is stated of its delay.

    Returns
    -------
    JointFit
        Least squares of a leg, and where no rivals are weighed; else the mixture.
    """
    if inferred is None:
        return least_squares
    if is_leg:
        return leg_fit(least_squares, inferred, coulomb, known_errors)
    return joint_fit(least_squares, inferred, coulomb, known_errors, record)


def leg_fit(
    least_squares: JointFit,
    inferred: ImpedanceInference,
    coulomb: CoulombFit | None,
    known_errors: Mapping[str, float],
) -> JointFit:
    """Eq. 15 by least squares, as the paper has it, with what the inference tells of the friction
    in the actuator. The arguments are those of `whole_fit`."""
    without = None
    if inferred.friction_probability > CERTAIN_FRICTION:
        without = inferred.sound.widened_by(known_errors)
    friction = by_inference(coulomb, least_squares.impedance.B, without)
    return replace(least_squares, friction=friction)


def joint_fit(
    least_squares: JointFit,
    inferred: ImpedanceInference,
    coulomb: CoulombFit | None,
    known_errors: Mapping[str, float],
    record: Record,
) -> JointFit:
    """The mixture of the hypotheses; the arguments are those of `whole_fit`.

    Where a fault does harm, the mixture would hold what the fault makes of K, B and I: they are
    then those of the best joint without a fault, and `suspected_fault.offered` has the mixture.
    Where friction is certain, B holds it as Eq. 15 does, and `friction.without` has B without it.
    """
    without_fault = inferred.impedance if inferred.doubt is None else inferred.sound
    impedance = without_fault.widened_by(known_errors)
    # friction whose size is not certain is not taken off B
    takes_friction_off = (
        inferred.friction_probability > CERTAIN_FRICTION
        and coulomb is not None
        and coulomb.certain is not None
    )
    without_friction = impedance if takes_friction_off else None
    friction = by_inference(coulomb, least_squares.impedance.B, without_friction)
    if takes_friction_off:
        impedance = replace(impedance, B=least_squares.impedance.B)

    fault = probable_fault(inferred)
    path_is_found = fault is not None and fault.family == "path"
    tells_delay = not path_is_found and not is_delay_stated(record)
    return JointFit(
        impedance=impedance,
        friction=friction,
        suspected_fault=suspected_fault_of(inferred, known_errors),
        delay_told_s=inferred.delay_told_s if tells_delay else None,
        estimator=MIXTURE_BESIDE_FRICTION if takes_friction_off else MIXTURE,
    )


def suspected_fault_of(
    inferred: ImpedanceInference, known_errors: Mapping[str, float]
) -> SuspectedFault:
    """What may be wrong, and K, B and I beside it where unseen parts of the recording prefer it."""
    fault, doubt = probable_fault(inferred), inferred.doubt
    offered = None
    if doubt is not None and doubt.gain > 0:
        offered = inferred.impedance.widened_by(known_errors)
    return SuspectedFault(
        # sums over no hypotheses are whole numbers
        fault_probability=float(inferred.fault_probability),
        harm=float(inferred.harm) if fault else 0.0,
        family=fault.family if fault else None,
        explanations=named_explanations(inferred) if fault else None,
        offered=offered,
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
    return suspected_fault_of(inferred, dict.fromkeys(QUANTITIES, 0.0))


def known_errors(analysis: Analysis) -> dict[str, float]:
    """Standard errors of K, B and I that all samples share, and no scatter shows: what is stated of
    the bench, and a band that hardly tells I."""
    told = analysis.calibrated(analysis.whole)
    bare = fit_groups(analysis.sums, analysis.model)
    variances = {name: told.se(name) ** 2 - bare.se(name) ** 2 for name in QUANTITIES}
    return {name: float(np.sqrt(max(variance, 0.0))) for name, variance in variances.items()}


def by_coulomb(coulomb: CoulombFit | None) -> FrictionFit | None:
    """Friction by least squares."""
    if coulomb is None:
        return None
    certain = coulomb.certain
    if certain is None:
        return FrictionFit(coulomb.share)
    size = Estimate.of_fit(certain, "T_C")
    without = Impedance.of_fit(certain)
    return FrictionFit(coulomb.share, size, without)


def by_inference(
    coulomb: CoulombFit | None, B: Estimate, without: Impedance | None
) -> FrictionFit | None:
    """Friction of which the inference tells the effect, and least squares the size.

    Parameters
    ----------
    coulomb : CoulombFit or None
        Coulomb friction by least squares.
    B : Estimate
        Damping with friction [N*m*s/rad].
    without : Impedance or None
        K, B and I without friction; None where friction is not certain.
    """
    if without is None:
        return FrictionFit(share=0.0)
    damping = B.value - without.B.value
    certain = coulomb.certain if coulomb else None
    size = Estimate.of_fit(certain, "T_C") if certain is not None else None
    return FrictionFit(max(damping, 0.0) / B.value, size, without)


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
