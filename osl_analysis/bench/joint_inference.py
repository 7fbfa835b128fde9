"""Friction beside K, B and I of Eq. 15, and what else the torque of a recording may hold.

The inference (`osl_analysis/inference`) says whether dry friction is certain and what may be wrong.
Where friction is certain, K, B and I without it are those of the inference. A Coulomb column beside
Eq. 15, which single amplitudes have, sees what the low-pass leaves of a friction that changes its
sign fast: its B is up to 6 % too large.
"""

from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import replace

import numpy as np

from osl_analysis.bench.analysis import QUANTITIES, Analysis
from osl_analysis.bench.coulomb import CoulombFit
from osl_analysis.bench.record import Label, Record
from osl_analysis.errors import NotWeighedError
from osl_analysis.inference import (
    BenchSignals,
    ImpedanceInference,
    LegInference,
    infer_impedance,
    infer_leg,
)
from osl_analysis.inference.constants import HARM_SHARE, LIKELY
from osl_analysis.inference.estimates import Explanation
from osl_analysis.signals import runs
from osl_analysis.stats.estimates import INTERVAL_ENDS, Estimate, Impedance, Row

CERTAIN_FRICTION = 0.9  # probability from which friction is taken off B: nine in ten are right
NAMED_SHARE = 0.05  # of all faults' probability, below which an explanation is not named
COLUMNS_OF_LOSSES = (None, "B_j", "J_j")  # of K, B and I in `transmission.csv`

Inferred = ImpedanceInference | LegInference | None
"""What the inference says; None where it cannot weigh rivals."""


def inferred_from(record: Record, is_leg: bool) -> Inferred:
    """The inference from the raw signals of a record, since it finds their band itself.

    Parameters
    ----------
    record : Record
        Angle and torque of a trial.
    is_leg : bool
        Whether a belt and an actuator render the joint. Its friction then opposes the actuator's
        velocity and grows with the current.
    """
    infer = infer_leg if is_leg else infer_impedance
    with suppress(NotWeighedError):
        return infer(signals_of(record, is_leg))
    return None


def signals_of(record: Record, is_leg: bool = False) -> BenchSignals:
    """What the inference is given of a record."""
    # the ends of fitted stretches are left out for the sake of the fit's own filter
    edge = round(2 * record.rate_hz / record.settings.cutoff_hz)
    inside = np.zeros(len(record.time), dtype=np.bool_)
    for rows in runs(record.is_fitted()):
        inside[max(rows.start - edge, 0) : rows.stop + edge] = True
    return BenchSignals(
        theta=record.theta,
        torque=record.torque,
        rate_hz=record.rate_hz,
        encoder_step=record.encoder_step,
        usable=record.usable & inside,
        sliding_angle=record.actuator.get("wide_band_theta_m") if is_leg else None,
        load=record.actuator.get("current") if is_leg else None,
    )


def estimate_columns(name: str, estimate: Estimate | None) -> Row:
    """The columns of an estimate, null where there is none."""
    if estimate is None:
        return dict.fromkeys(f"{name}{end}" for end in INTERVAL_ENDS)
    return estimate.columns(name)


def friction_columns(
    analysis: Analysis,
    inferred: Inferred,
    coulomb: Mapping[Label, CoulombFit],
    label: Label,
    is_leg: bool,
) -> Row:
    """The columns of friction, null where the motion does not tell it from damping.

    Of a whole trial the inference tells the effect of friction, and least squares its size. Of a
    joint whose friction has no certain size none is taken off. That of a leg acts behind its belt,
    where its size need not show.

    Parameters
    ----------
    analysis : Analysis
        Eq. 15.
    inferred : Inferred
        What the inference says of the recording.
    coulomb : Mapping
        As of `coulomb_fits`.
    label : Label
        The row's.
    is_leg : bool
        Whether a belt and an actuator render the joint.
    """
    of_column = coulomb.get(label)
    certain = of_column.certain if of_column else None
    share = of_column.share if of_column else None
    size = Estimate.of_fit(certain, "T_C") if certain else None
    without: Impedance | None = None
    if certain:
        without = {name: Estimate.of_fit(certain, name) for name in QUANTITIES}
    if label is None and inferred is not None:
        share, without = 0.0, None
        if inferred.friction_probability > CERTAIN_FRICTION and (is_leg or size):
            # what is stated of the bench, and a band that hardly tells them, no scatter shows
            whole = analysis.calibrated(analysis.whole)
            without = {
                name: estimate.widened_by(whole.se_bench(name))
                for name, estimate in inferred.without_friction.items()
            }
            share = max(1 - without["B"].value / analysis.whole["B"], 0.0)
        else:
            size = None
    if label is None and without is not None:
        without = with_other_stamps(analysis, without)
    return {
        "coulomb_share": share,
        **estimate_columns("f_C", size),
        **estimate_columns("B_viscous", without["B"] if without else None),
        **estimate_columns("K_without_friction", without["K"] if without else None),
        **estimate_columns("I_without_friction", without["I"] if without else None),
    }


def with_other_stamps(analysis: Analysis, impedance: Impedance) -> Impedance:
    """K, B and I of all of a trial, with intervals that also hold them moved as the other reading
    of undecided stamps moves Eq. 15."""
    other = analysis.fits_with_other_stamps.get(None)
    if other is None:
        return impedance
    by = {name: other[name] - analysis.whole[name] for name in QUANTITIES}
    return {
        name: replace(each, low=each.low + min(by[name], 0), high=each.high + max(by[name], 0))
        for name, each in impedance.items()
    }


def suspected_fault_of_losses(record: Record) -> ImpedanceInference | None:
    """What may be wrong with a recording of losses, whose stiffness nobody asks for; None where it
    is too short to tell."""
    of_B, of_I = HARM_SHARE[1:]
    with suppress(NotWeighedError):
        return infer_impedance(signals_of(record), accuracy=(np.inf, of_B, of_I))
    return None


def probable_fault(inferred: ImpedanceInference | None) -> Explanation | None:
    """The most probable fault; None where the recording is probably sound."""
    if inferred is None:
        return None
    if inferred.doubt is None and inferred.fault_probability > LIKELY:
        return next(iter(inferred.explanations), None)
    return inferred.doubt


def explanations_of(inferred: ImpedanceInference | None) -> str | None:
    """All faults that are not improbable beside each other, the most probable first; None where no
    fault is probable."""
    if inferred is None or probable_fault(inferred) is None:
        return None
    least = NAMED_SHARE * inferred.fault_probability
    names = [each.name for each in inferred.explanations if each.probability > least]
    return ", ".join(dict.fromkeys(names))


def fault_columns(
    inferred: ImpedanceInference | None, names: Sequence[str | None] = QUANTITIES
) -> Row:
    """The columns of a fault, null where no hypotheses were weighed. `names` are those of K, B and
    I in the table; None: it has no such column."""
    fault = probable_fault(inferred)
    facts: Row = {
        # sums over no hypotheses are whole numbers
        "fault_probability": float(inferred.fault_probability) if inferred else None,
        "fault_family": fault.family if fault else None,
        "explanations": explanations_of(inferred),
    }
    for k, name in enumerate(names):
        if name is not None:
            moved = inferred.fault_shares[k] if inferred and inferred.doubt else 0.0
            facts[f"{name}_fault_share"] = moved if inferred else None
            facts[f"{name}_unexplained_share"] = (
                inferred.unexplained_shares[k] if inferred else None
            )
    return facts


def delay_told_s(inferred: ImpedanceInference | None, record: Record) -> float | None:
    """Standard error to which a recording tells a delay [s] between angle and torque that nobody
    states and that is not found; None of a leg."""
    fault = probable_fault(inferred)
    streams = record.uniform.streams if record.uniform else ()
    is_stated = record.settings.calibration.delay > 0 or any(
        stream["delay_s"] for stream in streams
    )
    if inferred is None or is_stated or (fault is not None and fault.family == "path"):
        return None
    return inferred.delay_told_s
