"""The decision how stamps are read: as even samples of a device, or as true times of some age."""

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from osl_analysis.signals.device_clock import DeviceClock
from osl_analysis.signals.stamp_evidence import AGES, StampEvidence
from osl_analysis.trial import Array

NO_AGE = int(np.argmin(np.abs(AGES)))  # its place in `AGES`
WORTH_AN_AGE = 9  # chi-square by which an age must fit better than none: three standard errors
DECISIVE = 30  # chi-square between even and true samples that makes a decision firm
KNOWN_RESPONSE = 0.25  # standard error of a response above which no hypothesis is told apart
# Largest chi-square of a hypothesis that fits one signal, and its share of that by each further one
LARGEST_MISFIT = 22
PER_SIGNAL = 0.6
OTHER_KIND_ERRORS = 2  # standard errors that g must lie away from the other kind
# scatter, in steps, below which all hypotheses give the same samples: taken as even
NO_MATTER = 0.001
ROUNDED = 0.36  # decimals of scatter that rounding explains: 1/sqrt(12) = 0.29, and some noise
WANDERING_STEP = 0.1  # steps by which a residual may wander with even stamps


class Reading(NamedTuple):
    """How stamps are read."""

    even: bool  # else they are true
    age: float  # [loops] by which values are older than true stamps
    firm: bool  # whether the other kind is excluded
    why: str  # for the provenance
    matters: bool = True  # whether the two kinds differ


def reading_by_stamps(clock: DeviceClock) -> Reading | None:
    """The reading where the stamps alone tell; None if they do not."""
    if clock.sd < NO_MATTER * clock.step:
        return Reading(True, 0.0, True, "even: the stamps lie on their line", matters=False)
    is_still = clock.scatter < NO_MATTER * clock.step
    is_rounded = clock.scatter < ROUNDED * clock.decimal
    if not clock.settles or not (is_still or is_rounded):
        return None
    if clock.slow.kinks:
        return Reading(False, 0.0, True, "true: only the rate of the stamps changes")
    if is_rounded:
        return Reading(True, 0.0, True, "even: the stamps scatter by their rounding alone")
    return None


def reading_of(clock: DeviceClock, evidence: Mapping[str, StampEvidence]) -> Reading:
    """Choose the hypothesis that fits the evidence of some signals.

    Parameters
    ----------
    clock : DeviceClock
        That the signals share.
    evidence : Mapping
        By signal; may be empty.

    Returns
    -------
    Reading
        It is firm if its chi-square is not too large, and smaller than that of the other kind by
        30. Otherwise the stamps are kept as true if the signals fit no hypothesis, or if the stamps
        wander slowly or scatter by more than a step: so nothing is moved far. They are also kept if
        the device seems even but its stamps do not come back to the line.
    """
    if clock.has_prompt_batches is False and clock.settles and not clock.missing:
        why = (
            "undecided, even: the last sample of each batch is taken for that which waited least;"
            " state `stamps: even`, with a `delay` if it is another"
        )
        return Reading(even=True, age=0.0, firm=False, why=why)
    if not evidence:
        return reading_without_evidence(clock)

    responses = ", ".join(
        f"{name} g = {round(signal.g, 3) + 0.0:.3f} +- {signal.se:.3f}"
        for name, signal in evidence.items()
    )
    misfit = np.sum([signal.misfit for signal in evidence.values()], axis=0)
    misfit_of_even = float(misfit[0])
    misfit_of_true = float(misfit[1:].min())

    weight = np.sum([signal.weight for signal in evidence.values()], axis=0)
    variance = np.diag(np.linalg.inv(weight))
    is_known = variance.max() < KNOWN_RESPONSE**2
    limit = LARGEST_MISFIT * (1 - PER_SIGNAL + PER_SIGNAL * len(evidence))
    if is_known and min(misfit_of_even, misfit_of_true) > limit:
        return undecided_true(f"neither even sampling nor stamps of any age fit, {responses}")
    if not is_known or abs(misfit_of_even - misfit_of_true) < DECISIVE:
        by_stamps = reading_without_evidence(clock)
        return by_stamps._replace(why=f"{by_stamps.why}, {responses}")
    g_of_other_kind = 1.0 if misfit_of_even < misfit_of_true else 0.0
    if not any(
        abs(signal.g - g_of_other_kind) > OTHER_KIND_ERRORS * signal.se
        for signal in evidence.values()
    ):
        return undecided_true(f"g is within its error of the other kind, {responses}")

    if misfit_of_even > misfit_of_true:
        age = age_of(misfit[1:])
        older = f", values {age:.1f} loops older than their stamps" if age else ""
        return Reading(even=False, age=age, firm=True, why=f"true{older}: {responses}")
    cannot_count = clock.missing and not clock.counted and clock.scatter > clock.step
    if not clock.settles or cannot_count:
        why = "too late to count the missing samples" if clock.missing else "the stamps wander"
        return undecided_true(f"even by their scatter, but {why}, {responses}")
    return Reading(even=True, age=0.0, firm=True, why=f"even: {responses}")


def age_of(misfit: Array) -> float:
    """The age [loops] with the smallest chi-square (21,); none unless an age fits clearly
    better."""
    best = int(np.argmin(misfit))
    if misfit[NO_AGE] < misfit[best] + WORTH_AN_AGE:
        best = NO_AGE
    return round(float(AGES[best]), 3)


def reading_without_evidence(clock: DeviceClock) -> Reading:
    """Keep the stamps as true if they wander or scatter by more than a step, else take them as
    even."""
    wanders = clock.wander > WANDERING_STEP * clock.step or clock.scatter > clock.step
    kind = "true" if wanders else "even"
    steps = clock.wander / clock.step
    why = f"undecided, {kind}: the residual wanders by {steps:.3f} steps"
    return Reading(even=not wanders, age=0.0, firm=False, why=why)


def undecided_true(why: str) -> Reading:
    return Reading(even=False, age=0.0, firm=False, why=f"undecided, true: {why}")
