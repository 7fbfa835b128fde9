"""How long to record until the intervals are as narrow as asked, and what stands in the way of a plan."""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace

import numpy as np

from osl_analysis.design.plan import LAST_CYCLES, Continuous, PeriodicMultisine, Plan, SteppedSine
from osl_analysis.design.precision import NAMES, Distortion, Joint, Precision, Sensors, Weighted, weighted
from osl_analysis.errors import IdentifiabilityError
from osl_analysis.signals import LowPass
from osl_analysis.spectral.equation_error import DETECTION, ENOUGH_REALISATIONS
from osl_analysis.stats.covariance import FEWEST_CYCLES

MOST_CYCLES, MOST_REALISATIONS, LONGEST_S = 2000, 200, 7200
"""Largest numbers that are tried; more is no experiment."""
PERIODS = (2, 3, 4, 6, 8, 12)  # Periods of a realisation that are tried
SHORTEST_S = 10  # Shortest record [s] of a motion that does not repeat itself


def reached(found: Precision, joint: Joint, within: Mapping[str, float]) -> bool:
    """Whether the half widths are within these shares of K, B, I, as far as there are any."""
    return all(
        found.half_width[NAMES.index(name)] <= share * abs(float(joint.values[NAMES.index(name)]))
        for name, share in within.items()
    )


def long_enough(plan: Plan, enough: Callable[[Plan], bool]) -> Plan | None:
    """The shortest plan of the same kind that is `enough`; None if no length that is tried is. Of a multisine, periods
    and realisations are chosen together, with four realisations or more: their spread is the only interval that has the
    distortion as it is."""
    found = []
    for one in [replace(plan, periods=n) for n in PERIODS] if isinstance(plan, PeriodicMultisine) else [plan]:
        length = smallest(lambda n, one=one: enough(of_length(one, n)), *lengths(one))  # type: ignore[misc]
        if length is not None:
            found.append(of_length(one, length))
    return min(found, key=lambda one: one.record_s, default=None)


def longest(plan: Plan) -> Plan:
    """The longest plan of the same kind that `long_enough` tries."""
    most = replace(plan, periods=max(PERIODS)) if isinstance(plan, PeriodicMultisine) else plan
    return of_length(most, lengths(plan)[1])


def lengths(plan: Plan) -> tuple[int, int]:
    """Smallest and largest number that is tried of cycles, of seconds, or of realisations."""
    if isinstance(plan, SteppedSine):
        return plan.settle_cycles + LAST_CYCLES + FEWEST_CYCLES, MOST_CYCLES
    return (SHORTEST_S, LONGEST_S) if isinstance(plan, Continuous) else (ENOUGH_REALISATIONS, MOST_REALISATIONS)


def of_length(plan: Plan, n: int) -> Plan:
    """The plan with n cycles at each frequency, with n seconds, or with n realisations."""
    if isinstance(plan, SteppedSine):
        return replace(plan, cycles=(float(n),) * len(plan.frequencies_hz))
    if isinstance(plan, Continuous):
        return replace(plan, duration_s=float(n))
    assert isinstance(plan, PeriodicMultisine)
    return replace(plan, realisations=n)


def smallest(enough: Callable[[int], bool], first: int, last: int) -> int | None:
    """The smallest number from `first` to `last` that is enough, where every larger one is; None if `last` is not."""
    if not enough(last):
        return None
    low, high = first - 1, last
    while high - low > 1:
        middle = int(np.clip(round(np.sqrt(max(low, 1) * high)), low + 1, high - 1))
        low, high = (low, middle) if enough(middle) else (middle, high)
    return high


HIGH_CORRELATION = 0.9
"""Correlation of K and I from which the band is too narrow: either interval is then 2.3 times as wide as alone."""
FEW_STEPS = 10  # Steps of the encoder in the smallest amplitude below which it is a warning
MUCH = 0.25  # Share of a variance from which its cause is named
NEAR_CUTOFF = 0.5  # Highest frequency, as a share of the filter's cut-off, above which it is a warning


def lag_errors(fit: Weighted, joint: Joint, lag_s: float) -> dict[str, float]:
    """What a torque that is late by `lag_s` [s] adds to K, B and I: the fit of Z exp(-j w lag) minus that of Z."""
    Z, w = joint.impedance(fit.sines.w), fit.sines.w
    late = np.asarray(Z * np.exp(-1j * w * lag_s), dtype=np.complex128)
    return dict(zip(NAMES, (fit.fitted(late) - fit.fitted(Z)).tolist(), strict=True))


def missing_band(plan: Plan, low_pass: LowPass) -> str:
    """Which octave below or above the plan's band tells K and I apart better, in words."""
    f = plan.sines.frequency_hz
    low, high = float(f.min()), float(f.max())
    tried = {}
    for words, (a, b) in {
        f"below {low:.3g} Hz, down to {low / 2:.3g} Hz": (low / 2, high),
        f"above {high:.3g} Hz, up to {2 * high:.3g} Hz": (low, 2 * high),
    }.items():
        try:
            fit = weighted(banded(plan, a, b), low_pass)
        except IdentifiabilityError:
            continue
        tried[words] = correlation(fit)
    if not tried:
        return "a band of several octaves"
    best = min(tried, key=lambda words: tried[words])
    return f"the band {best} (correlation {tried[best]:.2f})"


def correlation(fit: Weighted) -> float:
    """Correlation of K and I."""
    return float(-fit.normal[0, 2] / np.sqrt(fit.normal[0, 0] * fit.normal[2, 2]))


def banded(plan: Plan, low: float, high: float) -> Plan:
    """The plan with a band [Hz] that is wider at one end: of a stepped sine with one more frequency."""
    if isinstance(plan, SteppedSine):
        f = tuple(sorted({low, *plan.frequencies_hz, high}))
        return replace(plan, frequencies_hz=f, cycles=(float(np.max(plan.cycles)),) * len(f))
    assert isinstance(plan, PeriodicMultisine | Continuous)
    return replace(plan, band_hz=(low, high))


def warnings(
    plan: Plan, found: Precision, joint: Joint, sensors: Sensors, low_pass: LowPass, distortion: Distortion
) -> Iterator[str]:
    """What stands in the way of the intervals, one sentence each."""
    yield from about_excitation(plan, found, joint, low_pass)
    yield from about_sensors(plan, found, sensors)
    yield from about_distortion(plan, found, distortion)


def about_excitation(plan: Plan, found: Precision, joint: Joint, low_pass: LowPass) -> Iterator[str]:
    """Warnings on the band and the filter."""
    wide = joint.I != 0 and found.half_width[2] > 0.5 * abs(joint.I)
    if found.correlation > HIGH_CORRELATION or wide:
        yield (
            f"the excitation hardly tells K from I (correlation {found.correlation:.2f}"
            f"{', I not known to 50 %' if wide else ''}): what is missing is {missing_band(plan, low_pass)}"
        )
    highest = float(plan.sines.frequency_hz.max())
    if highest > NEAR_CUTOFF * low_pass.cutoff_hz:
        yield (
            f"{highest:.3g} Hz is near the filter's cut-off of {low_pass.cutoff_hz:g} Hz, which weighs it down and "
            "lets what Eq. 15 does not describe count less there; raise cutoff_hz or lower the frequency"
        )


def about_sensors(plan: Plan, found: Precision, sensors: Sensors) -> Iterator[str]:
    """Warnings on rounding and drift."""
    smallest = plan.rms * np.sqrt(2) if isinstance(plan, PeriodicMultisine | Continuous) else min(plan.sines.size)
    if not sensors.encoder_step:
        yield "no step of the encoder is stated: the interval is without its rounding"
    elif smallest < FEW_STEPS * sensors.encoder_step:
        yield (
            f"the smallest amplitude has {smallest / sensors.encoder_step:.2g} steps of the encoder; take "
            f"{FEW_STEPS} or more"
        )
    if (share := largest_share(found.causes, "encoder rounding")) > MUCH:
        noise = isinstance(plan, Continuous) and not plan.chirp
        stays = "" if noise else "; it repeats, so that longer records do not average it out"
        yield (
            f"rounding of the encoder makes {100 * share:.0f} % of the variance{stays}; take a finer encoder"
            f"{'' if noise else ', or half a step of noise on the angle'}"
        )
    if (share := largest_share(found.causes, "load cell drift")) > MUCH:
        yield f"the load cell's drift makes {100 * share:.0f} % of the variance; let it warm up, or record for longer"


def about_distortion(plan: Plan, found: Precision, distortion: Distortion) -> Iterator[str]:
    """Warnings on what is not linear."""
    if not distortion.stated:
        yield (
            "no distortion is stated: these are the intervals of a joint that is exactly Eq. 15; with friction the "
            "estimates of a multisine scatter up to 50 times as much, and those of a stepped sine are shifted; state "
            "--friction, --distortion or --earlier"
        )
    if distortion.coulomb and isinstance(plan, SteppedSine):
        yield (
            "the interval of the analysis comes from the spread of cycles, which all repeat friction: it is that of "
            "the noise alone"
        )
    if isinstance(plan, PeriodicMultisine) and plan.realisations < ENOUGH_REALISATIONS:
        level = "whose level at detection lines is all that is known of it" if found.method == DETECTION else ""
        yield (
            f"{plan.realisations} realisation{'s' if plan.realisations > 1 else ''} of a distortion {level}: take "
            f"{ENOUGH_REALISATIONS} or more, and 8 to know the level within 0.5 dB"
        )
    if isinstance(plan, Continuous) and distortion.stated:
        yield "a motion that does not repeat itself does not tell noise from distortion; a multisine does"


def largest_share(causes: Mapping[str, np.ndarray], name: str) -> float:
    """The largest share that one cause has of the variances of K, B, I."""
    total = np.sum(list(causes.values()), axis=0)
    return float(np.max(causes[name] / np.where(total > 0, total, 1)))
