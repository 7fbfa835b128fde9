"""Experiment design for the command line: the plan that options ask for, and what it will tell on
K, B and I."""

from collections.abc import Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import polars as pl

from osl_analysis.bench.bench_settings import DynamometerAnalysis
from osl_analysis.bench.identifiability import check_told
from osl_analysis.bench.planned_errors import KBI, Distortion, Sensors, eq15, planned_fit
from osl_analysis.bench.planned_motion import (
    ENOUGH_REALISATIONS,
    TRANSIENTS,
    Continuous,
    PeriodicMultisine,
    Plan,
    SteppedSine,
    long_enough,
)
from osl_analysis.bench.precision import Precision, precision
from osl_analysis.campaign.configuration import Config
from osl_analysis.commands.design_request import (
    DesignRequest,
    check_finite_options,
    pilot_distortion,
    plan_of,
    sensors_of,
    wanted_shares,
)
from osl_analysis.errors import IdentifiabilityError, InputError
from osl_analysis.signals import LowPass
from osl_analysis.table import write_table
from osl_analysis.trial import Array

TINY = float(np.finfo(float).tiny)
RISE_S = 1.0  # in which a commanded multisine rises, falls, and rests
# from this correlation of K and I on, their intervals are 2.3 times as wide as alone
LARGEST_CORRELATION = 0.9
LARGEST_INERTIA_SHARE = 0.5  # half-width of I as a share of I
FEWEST_STEPS = 10  # of the encoder in the smallest amplitude
LARGEST_ROUNDING_SHARE = 0.25  # of a variance


@dataclass(frozen=True)
class Assumptions:
    """What the intervals of a plan depend on beside its motion."""

    joint: Array  # K, B and I that are expected, (3,)
    sensors: Sensors
    low_pass: LowPass
    distortion: Distortion

    def precision_of(self, plan: Plan) -> Precision:
        """The intervals that a plan will give."""
        return precision(plan, self.joint, self.sensors, self.low_pass, self.distortion)


@dataclass(frozen=True)
class Planned:
    """A plan and the intervals that it will give."""

    plan: Plan
    precision: Precision


@dataclass(frozen=True)
class Design:
    """The plan that was asked for, what its intervals depend on, and what it will tell."""

    requested: Planned
    assumed: Assumptions
    lag_s: float  # lag [s] of the torque whose effect is stated
    lag_errors: Mapping[str, float]  # what it adds to K, B and I
    peak_torque: float  # largest torque [N*m]
    within: Mapping[str, float]  # half-widths that are asked for, as shares of K, B, I
    # the shortest plan that reaches them; None where none is asked for, or they are out of reach
    recommended: Planned | None
    warnings: tuple[str, ...]

    @property
    def best_plan(self) -> Plan:
        """The plan to record: the recommended one, if there is one."""
        return self.requested.plan if self.recommended is None else self.recommended.plan


def designed(request: DesignRequest, config: Config) -> Design:
    """Predict the intervals of the plan that options ask for, and how long to record.

    Parameters
    ----------
    request : DesignRequest
    config : Config
        The protocol, and the filter of the analysis.

    Raises
    ------
    InputError
        Options contradict one another, the rate is too low for the filter, or the filter takes
        frequencies out.
    IdentifiabilityError
        The analysis would refuse the band.
    """
    check_finite_options(request)
    bench = config.dynamometer
    within = wanted_shares(request)
    distortion = Distortion(request.friction or 0.0)
    if request.pilot is not None:
        distortion = pilot_distortion(request.pilot, request.trial)
    plan = plan_of(request, bench, may_be_longer=bool(within))
    assumed = Assumptions(
        joint=np.array(request.joint, dtype=float),
        sensors=sensors_of(request, bench),
        low_pass=bench.low_pass,
        distortion=distortion,
    )
    check_band(plan, assumed)

    requested = Planned(plan, assumed.precision_of(plan))
    if not isinstance(plan, SteppedSine):  # which the analysis judges otherwise
        check_identifiable(requested, assumed.joint, bench.largest_inertia_error)
    peak_torque = largest_torque(plan, assumed)
    warnings = list(plan_warnings(requested, assumed))
    warnings += limit_warnings(plan, peak_torque, bench)
    recommended = None
    if within:
        best, longest = long_enough(plan, lambda plan: assumed.precision_of(plan).reaches(within))
        if best is None:
            warnings.append(beyond_reach(Planned(longest, assumed.precision_of(longest)), within))
        else:
            recommended = Planned(best, assumed.precision_of(best))

    lag_s = 1e-3 * request.lag
    return Design(
        requested=requested,
        assumed=assumed,
        lag_s=lag_s,
        lag_errors=errors_by_lag(requested, assumed.joint, lag_s),
        peak_torque=peak_torque,
        within=within,
        recommended=recommended,
        warnings=tuple(warnings),
    )


def write_command(plan: Plan, rate_hz: float, output: Path) -> None:
    """Write the angle that a multisine commands: `time` [s], `theta_command` [rad]. Each
    realisation rises within its transient period, in `RISE_S`, and falls after its last one; it is
    at rest as long in between."""
    if not isinstance(plan, PeriodicMultisine):
        raise InputError(f"{output}: only a multisine is written; give --excitation multisine")
    length_s = (plan.periods + TRANSIENTS) * plan.period_s + RISE_S
    time = np.arange(round(length_s * rate_hz)) / rate_hz
    from_either_end = np.clip(np.minimum(time, length_s - time) / RISE_S, 0, 1)
    envelope = 0.5 * (1 - np.cos(np.pi * from_either_end))
    pause = np.zeros(round(RISE_S * rate_hz))
    parts = [pause]
    for realisation in range(plan.realisations):
        parts += [plan.motion(realisation).angle(time) * envelope, pause]
    angle = np.concatenate(parts)
    time = np.arange(len(angle)) / rate_hz
    write_table(pl.DataFrame({"time": time, "theta_command": angle}), output)


def check_band(plan: Plan, assumed: Assumptions) -> None:
    """Refuse a rate that is too low for the filter, and frequencies that it takes out."""
    cutoff_hz = assumed.low_pass.cutoff_hz
    rate_hz = assumed.sensors.rate_hz
    highest_hz = float(plan.sines.frequency_hz.max())
    if cutoff_hz >= rate_hz / 2:
        raise InputError(
            f"--rate {rate_hz:g} Hz is too low for the filter's cut-off of {cutoff_hz:g} Hz;"
            " sample faster than twice the cut-off"
        )
    if highest_hz > cutoff_hz:
        raise InputError(
            f"{highest_hz:.4g} Hz is above the filter's cut-off of {cutoff_hz:g} Hz; raise"
            " dynamometer.cutoff_hz or excite lower frequencies"
        )


def check_identifiable(planned: Planned, joint: Array, largest_inertia_error: float | None) -> None:
    """Refuse a motion whose band cannot tell K from I, as the analysis will.

    The analysis judges samples of the filtered motion. Two rows for each sine, in phase and in
    quadrature, have the same products.
    """
    sines = planned.plan.sines
    fit = planned.precision.fit
    n = len(sines.w)
    is_one_at_a_time = sines.spacing_hz is None
    fitted_s = np.sum(sines.duration_s) if is_one_at_a_time else np.max(sines.duration_s)
    share = np.sqrt(n * fit.weight * sines.duration_s / float(fitted_s))
    torque = np.abs(joint @ eq15(sines.w)) * sines.size
    rows = np.concatenate([fit.columns.real, fit.columns.imag], axis=1)
    check_told(
        "the analysis would refuse this protocol",
        band_hz=(float(sines.frequency_hz.min()), float(sines.frequency_hz.max())),
        motion=rows * np.tile(share, 2),
        torque_rms=float(np.sqrt(np.sum((torque * share) ** 2) / (2 * n))),
        stiffness=(float(joint[0]), float(planned.precision.se[0])),
        largest_inertia_error=largest_inertia_error,
    )


def largest_torque(plan: Plan, assumed: Assumptions) -> float:
    """The largest torque [N*m] of a plan, with friction: of one sine at a time that of the largest;
    of many the same multiple of their RMS as of the angle."""
    sines = plan.sines
    torque = np.abs(assumed.joint @ eq15(sines.w)) * sines.size
    if sines.spacing_hz is None:
        highest = float(torque.max())
    else:
        crest = plan.peak.angle / float(np.sqrt(np.sum(sines.size**2) / 2))
        highest = float(crest * np.sqrt(np.sum(torque**2) / 2))
    return highest + assumed.distortion.coulomb


def errors_by_lag(planned: Planned, joint: Array, lag_s: float) -> dict[str, float]:
    """What a torque that is late by a lag [s] adds to K, B and I."""
    fit = planned.precision.fit
    w = planned.plan.sines.w
    Z = joint @ eq15(w)
    errors = fit.fitted(Z * np.exp(-1j * w * lag_s)) - fit.fitted(Z)
    return dict(zip(KBI, errors.tolist(), strict=True))


def limit_warnings(plan: Plan, peak_torque: float, bench: DynamometerAnalysis) -> Iterator[str]:
    """Which limits of the configuration a recording of this plan would go beyond."""
    if plan.peak.angle > bench.largest_angle:
        yield (
            f"the largest angle of {plan.peak.angle:.3g} rad is above dynamometer.largest_angle = "
            f"{bench.largest_angle:g} rad: the recording would be refused"
        )
    if bench.load_cell_range is not None and peak_torque > bench.load_cell_range:
        yield (
            f"the torque of about {peak_torque:.3g} N·m is above dynamometer.load_cell_range = "
            f"{bench.load_cell_range:g} N·m: the recording would be refused"
        )


def beyond_reach(longest: Planned, within: Mapping[str, float]) -> str:
    """What the longest plan that is searched gives, and what limits it."""
    intervals = longest.precision
    reached = []
    for k, name in enumerate(KBI):
        if name not in within:
            continue
        variance_by_cause = {cause: variance[k] for cause, variance in intervals.variance.items()}
        cause, variance = max(variance_by_cause.items(), key=lambda item: item[1])
        percent = 100 * intervals.half_width[k] / max(abs(intervals.expected[k]), TINY)
        share_percent = 100 * variance / max(intervals.se[k] ** 2, TINY)
        reached.append(f"{name} ± {percent:.2g} % (variance by {cause} {share_percent:.0f} %)")
    return (
        "what is asked for is beyond the longest record that is searched,"
        f" {longest.plan.record_s / 3600:.2g} h, which gives {', '.join(reached)}; move further,"
        " widen the band, or ask for less"
    )


def plan_warnings(planned: Planned, assumed: Assumptions) -> Iterator[str]:
    """What a user must know of a plan: its band, the encoder, and the distortion."""
    yield from band_warnings(planned, assumed.low_pass)
    yield from encoder_warnings(planned, assumed.sensors)
    if assumed.distortion == Distortion():
        yield (
            "no distortion is stated: these are the intervals of a joint that is exactly Eq. 15;"
            " with friction the estimates of a multisine scatter up to 50 times as much, and those"
            " of a stepped sine are shifted; state --friction, or a pilot by --from"
        )
    plan = planned.plan
    if isinstance(plan, PeriodicMultisine) and plan.realisations < ENOUGH_REALISATIONS:
        plural = "s" if plan.realisations > 1 else ""
        yield (
            f"{plan.realisations} realisation{plural} of a distortion"
            " whose level at detection lines is all that is known of it: take"
            f" {ENOUGH_REALISATIONS} or more, and 8 to know the level within 0.5 dB"
        )


def band_warnings(planned: Planned, low_pass: LowPass) -> Iterator[str]:
    """Whether the band hardly tells K from I, and by which octave to widen it."""
    intervals = planned.precision
    inertia = intervals.expected[2]
    correlation = intervals.fit.correlation
    is_wide = inertia != 0 and intervals.half_width[2] > LARGEST_INERTIA_SHARE * abs(inertia)
    if correlation <= LARGEST_CORRELATION and not is_wide:
        return
    low = float(planned.plan.sines.frequency_hz.min())
    high = float(planned.plan.sines.frequency_hz.max())
    wider_bands = {
        f"below {low:.3g} Hz, down to {low / 2:.3g} Hz": (low / 2, high),
        f"above {high:.3g} Hz, up to {2 * high:.3g} Hz": (low, 2 * high),
    }
    correlations = {}
    for words, band_hz in wider_bands.items():
        with suppress(IdentifiabilityError):
            wider = with_band(planned.plan, band_hz)
            correlations[words] = planned_fit(wider, low_pass).correlation
    missing = "a band of several octaves"
    if correlations:
        best = min(correlations, key=lambda words: correlations[words])
        missing = f"the band {best} (correlation {correlations[best]:.2f})"
    inertia_unknown = ", I not known to 50 %" if is_wide else ""
    yield (
        f"the excitation hardly tells K from I (correlation {correlation:.2f}{inertia_unknown}):"
        f" what is missing is {missing}"
    )


def with_band(plan: Plan, band_hz: tuple[float, float]) -> Plan:
    """A plan with another band; a stepped sine gets further frequencies at its ends."""
    if not isinstance(plan, SteppedSine):
        return replace(plan, band_hz=band_hz)
    frequencies = tuple(sorted({*plan.frequencies_hz, *band_hz}))
    cycles = (max(plan.cycles),) * len(frequencies)
    return replace(plan, frequencies_hz=frequencies, cycles=cycles)


def encoder_warnings(planned: Planned, sensors: Sensors) -> Iterator[str]:
    """Whether the encoder's step is not stated, or too coarse for the motion."""
    plan = planned.plan
    smallest = min(plan.sines.size) if isinstance(plan, SteppedSine) else plan.rms * np.sqrt(2)
    if not sensors.encoder_step:
        yield "no step of the encoder is stated: the interval is without its rounding"
    elif smallest < FEWEST_STEPS * sensors.encoder_step:
        yield (
            f"the smallest amplitude has {smallest / sensors.encoder_step:.2g} steps of the"
            f" encoder; take {FEWEST_STEPS} or more"
        )
    total = np.maximum(planned.precision.se**2, TINY)
    share = float(np.max(planned.precision.variance["encoder rounding"] / total))
    if share > LARGEST_ROUNDING_SHARE:
        problem = f"rounding of the encoder makes {100 * share:.0f} % of the variance"
        if isinstance(plan, Continuous) and not plan.chirp:
            yield f"{problem}; take a finer encoder"
        else:
            yield (
                f"{problem}; it repeats, so that longer records do not average it out; take a"
                " finer encoder, or half a step of noise on the angle"
            )
