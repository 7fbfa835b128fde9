"""Experiment design for the command line: the plan that options ask for, and what it will tell on
K, B and I."""

import json
from collections.abc import Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl

from osl_analysis.bench.bench_settings import DynamometerAnalysis
from osl_analysis.bench.group_interval import BY_REPEATS, BY_UNITS
from osl_analysis.bench.identifiability import check_told
from osl_analysis.bench.planned_errors import KBI, Distortion, Sensors, eq15, planned_fit
from osl_analysis.bench.planned_motion import (
    ENOUGH_REALISATIONS,
    MOST_DRAWN,
    TRANSIENTS,
    Continuous,
    PeriodicMultisine,
    Plan,
    SteppedSine,
    long_enough,
)
from osl_analysis.bench.precision import Precision, precision
from osl_analysis.campaign.configuration import Config
from osl_analysis.errors import IdentifiabilityError, InputError, nearest
from osl_analysis.signals import LowPass
from osl_analysis.table import finite_or_null, with_evidence, write_table
from osl_analysis.trial import Array

TINY = float(np.finfo(float).tiny)
OPTION_OF = {"K": "stiffness", "B": "damping", "I": "inertia"}  # with the expected value of each
UNITS = {"K": "N·m/rad", "B": "N·m·s/rad", "I": "kg·m²"}

USUAL_BAND_HZ = (0.5, 6.0)  # of a motion that is no stepped sine
USUAL_RMS_DEG = 2.0  # of its angle
RISE_S = 1.0  # in which a commanded multisine rises, falls, and rests

# from this correlation of K and I on, their intervals are 2.3 times as wide as alone
LARGEST_CORRELATION = 0.9
LARGEST_INERTIA_SHARE = 0.5  # half-width of I as a share of I
FEWEST_STEPS = 10  # of the encoder in the smallest amplitude
LARGEST_ROUNDING_SHARE = 0.25  # of a variance
SHOWN_SHARE_PERCENT = 0.5  # of a variance: smaller causes are not listed
MINUTES_FROM_S = 120  # longer records are told in minutes too


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


def designed(options: Mapping[str, Any], config: Config) -> Design:
    """Predict the intervals of the plan that options ask for, and how long to record.

    Parameters
    ----------
    options : Mapping
        Of `osl-analysis design`, by name.
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
    check_finite_options(options)
    bench = config.dynamometer
    within = wanted_shares(options)
    distortion = Distortion(options["friction"] or 0.0)
    if options["pilot"] is not None:
        distortion = pilot_distortion(options["pilot"], options["trial"])
    plan = plan_of(options, bench, may_be_longer=bool(within))
    assumed = Assumptions(
        joint=np.array([options[option] for option in OPTION_OF.values()], dtype=float),
        sensors=sensors_of(options, bench),
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

    lag_s = 1e-3 * options["lag"]
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


# What options state


def check_finite_options(options: Mapping[str, Any]) -> None:
    """Refuse an option that is no finite number."""
    for name, value in options.items():
        numbers = value if isinstance(value, list) else [value]
        if any(isinstance(number, float) and not np.isfinite(number) for number in numbers):
            raise InputError(f"--{name.replace('_', '-')} is {value}; give a finite number")


def wanted_shares(options: Mapping[str, Any]) -> dict[str, float]:
    """The half-widths that are asked for, as shares of the expected K, B and I."""
    within = {}
    for name, option in OPTION_OF.items():
        share = options[f"{option}_within"]
        if share is None:
            continue
        if not options[option]:
            raise InputError(
                f"--{option}-within is a share of an expected {name} of 0; give --{option} above 0"
            )
        within[name] = share
    return within


def sensors_of(options: Mapping[str, Any], bench: DynamometerAnalysis) -> Sensors:
    """What the options say of load cell and encoder, in SI units; else the drift of the
    configuration."""
    encoder_step = 2 * np.pi / 2 ** options["encoder_bits"]
    if options["encoder_step"] is not None:
        encoder_step = float(np.deg2rad(options["encoder_step"]))
    drift_per_minute = options["drift"]
    if drift_per_minute is None:
        drift_per_minute = bench.load_cell_drift
    return Sensors(
        rate_hz=options["rate"],
        torque_noise=options["torque_noise"],
        noise_band_hz=options["noise_band"],
        torque_step=options["torque_step"],
        encoder_step=encoder_step,
        angle_noise=float(np.deg2rad(options["angle_noise"])),
        drift=drift_per_minute / 60,
    )


def pilot_distortion(results: Path, trial: str | None) -> Distortion:
    """Coulomb friction of the joint in an impedance trial of a pilot, and the variances of its K, B
    and I; medians of all trials where none is named. Raises InputError: the results have none."""
    table = with_evidence(results / "tables/impedance.csv", ("trial", "amplitude_deg", *KBI))
    rows = table.filter(pl.col("amplitude_deg").is_null())
    if trial is not None:
        rows = rows.filter(trial=trial)
    medians = []
    for name in ("f_C", *(f"{name}_se" for name in KBI)):
        values = rows[name].drop_nulls().to_list() if name in rows.columns else []
        if not values:
            raise InputError(f"{results}: {no_friction_text(table, trial)}")
        medians.append(float(np.median(values)))
    friction, *standard_errors = medians
    return Distortion(max(friction, 0.0), pilot=tuple(se**2 for se in standard_errors))


def no_friction_text(table: pl.DataFrame, trial: str | None) -> str:
    """Why a pilot's `impedance` table tells no friction, and what to do."""
    names = table["trial"].unique().sort().to_list()
    if trial is not None and trial not in names:
        return f"no impedance trial '{trial}'{nearest(trial, names)}"
    with_friction = []
    if "f_C" in table.columns:
        with_friction = table.drop_nulls("f_C")["trial"].unique().sort().to_list()
    of_trial = f"of trial '{trial}' " if trial else ""
    remedy = "state it by --friction"
    if with_friction:
        remedy = f"name another trial, as {with_friction[0]}, or {remedy}"
    return f"the friction {of_trial}is not certain; {remedy}"


# The plan


def plan_of(options: Mapping[str, Any], bench: DynamometerAnalysis, may_be_longer: bool) -> Plan:
    """The motion that options ask for; `may_be_longer`: a longer one may be recommended."""
    if options["excitation"] == "stepped-sine":
        return stepped_sine_of(options, bench)
    rms = float(np.deg2rad(options["rms"] or USUAL_RMS_DEG))
    if options["excitation"] == "multisine":
        return multisine_of(options, rms, may_be_longer)
    is_chirp = options["excitation"] == "chirp"
    plan = Continuous(band_of(options), rms, options["duration"], is_chirp)
    if options["peak"] is None:
        return plan
    return replace(plan, rms=rms * float(np.deg2rad(options["peak"])) / plan.peak.angle)


def band_of(options: Mapping[str, Any]) -> tuple[float, float]:
    """Lowest and highest frequency [Hz] of a motion that is no stepped sine."""
    low, high = options["band"] or USUAL_BAND_HZ
    return low, high


def multisine_of(options: Mapping[str, Any], rms: float, may_be_longer: bool) -> PeriodicMultisine:
    """A multisine of an RMS angle [rad], or of which no realisation goes beyond the stated peak."""
    plan = PeriodicMultisine(
        period_s=options["period"],
        band_hz=band_of(options),
        rms=rms,
        periods=options["periods"],
        realisations=options["realisations"],
        seed=options["seed"],
    )
    if options["peak"] is None:
        return plan
    of_unit_size = replace(plan, rms=1.0)
    n_drawn = max(plan.realisations, MOST_DRAWN) if may_be_longer else plan.realisations
    highest = max(of_unit_size.motion(number).peak for number in range(n_drawn))
    return replace(plan, rms=float(np.deg2rad(options["peak"])) / highest)


def stepped_sine_of(options: Mapping[str, Any], bench: DynamometerAnalysis) -> SteppedSine:
    """The stepped sine of the configuration, with what options state in its place."""
    frequencies = tuple(options["frequencies"] or bench.frequencies_hz or ())
    amplitudes = tuple(options["amplitudes"] or bench.amplitudes_deg or ())
    cycles = bench.protocol.cycles_at
    if not (frequencies and amplitudes and (options["cycles"] or cycles)):
        raise InputError(
            "the configuration states no whole protocol; give --frequencies, --amplitudes and"
            " --cycles, or state amplitudes_deg, frequencies_hz and cycles under `dynamometer`"
        )
    if not all(0 < number < np.inf for number in (*frequencies, *amplitudes)):
        raise InputError(
            "frequencies and amplitudes of sines are above 0; correct --frequencies, --amplitudes"
        )
    if options["cycles"] is not None:
        cycles = (float(options["cycles"]),) * len(frequencies)
    elif len(set(cycles)) == 1:
        cycles = (float(cycles[0]),) * len(frequencies)
    elif len(cycles) != len(frequencies):
        raise InputError(
            "the configuration has cycles for its own frequencies; give --cycles for these"
        )
    if min(cycles) <= bench.settle_cycles:
        raise InputError(
            f"settle_cycles = {bench.settle_cycles} leaves none of {min(cycles):g} cycles; give"
            " --cycles above it"
        )
    return SteppedSine(
        tuple(np.deg2rad(amplitudes).tolist()), frequencies, cycles, bench.settle_cycles
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


# What stands in the way of a plan


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


# The answer as text and as JSON


def design_text(design: Design) -> str:
    """The plan, its intervals, what is not in them, and the recommended plan."""
    requested = design.requested
    lines = [requested.plan.words, *motion_lines(design), ""]
    lines += interval_lines(requested.precision)
    lines += ["", lag_line(design)]
    added_damping = design.assumed.distortion.added_damping(requested.plan)
    if added_damping:
        values = ", ".join(f"{value:.3g} ({name})" for name, value in added_damping.items())
        lines.append(
            f"not in the interval: Coulomb friction of {design.assumed.distortion.coulomb:g} N·m"
            f" adds to B {values} N·m·s/rad"
        )
    if design.within:
        wanted = ", ".join(f"{name} ± {100 * share:g} %" for name, share in design.within.items())
        lines += ["", f"for {wanted}:"]
        if design.recommended is None:
            lines.append("  beyond the longest record that is searched")
        else:
            best = design.recommended
            lines += [f"  {best.plan.words}", f"  record {seconds(best.plan.record_s)}"]
            lines += [f"  {line}" for line in interval_lines(best.precision)]
    lines += [f"warning: {warning}" for warning in design.warnings]
    return "\n".join(lines)


def motion_lines(design: Design) -> list[str]:
    """The extremes of the motion, and the errors of the sensors."""
    plan = design.requested.plan
    sensors = design.assumed.sensors
    low_pass = design.assumed.low_pass
    band = f"up to {sensors.noise_band_hz:g} Hz" if sensors.noise_band_hz else "white"
    step = "encoder not rounded"
    if sensors.encoder_step:
        step = f"encoder step {np.rad2deg(sensors.encoder_step):.3g} deg"
    return [
        f"  record {seconds(plan.record_s)}; largest angle {np.rad2deg(plan.peak.angle):.3g} deg,"
        f" velocity {plan.peak.velocity:.3g} rad/s, acceleration {plan.peak.acceleration:.3g}"
        f" rad/s², torque about {design.peak_torque:.3g} N·m",
        f"  torque noise {sensors.torque_noise:.3g} N·m SD ({band}) at {sensors.rate_hz:g} Hz,"
        f" {step}, load cell drift {60 * sensors.drift:.3g} N·m/min; filter"
        f" {low_pass.cutoff_hz:g} Hz, order {low_pass.order}",
    ]


def lag_line(design: Design) -> str:
    """What a late torque adds to K, B and I, in their units and in percent."""
    errors = []
    for k, (name, error) in enumerate(design.lag_errors.items()):
        expected = design.assumed.joint[k]
        percent = f" ({100 * error / expected:+.1f} %)" if expected else ""
        errors.append(f"{name} {error:+.2g}{percent}")
    return (
        f"not in the interval: torque later than the angle by {1e3 * design.lag_s:g} ms adds"
        f" {', '.join(errors)}"
    )


def seconds(duration_s: float) -> str:
    """A duration in seconds, and a long one in minutes too."""
    minutes = f" ({duration_s / 60:.1f} min)" if duration_s >= MINUTES_FROM_S else ""
    return f"{duration_s:.4g} s{minutes}"


def interval_lines(intervals: Precision) -> Iterator[str]:
    """A line per parameter, with what the variance is made of, and a line on the interval."""
    yield (
        f"{'':4}{'expected':>10}{'95 % interval ±':>18}{'in %':>10}{'by noise alone ±':>18}  "
        " variance by"
    )
    for k, (name, unit) in enumerate(UNITS.items()):
        expected = intervals.expected[k]
        half_width = intervals.half_width[k]
        percent = f"{100 * half_width / abs(expected):.3g}" if expected else "-"
        causes = []
        for cause, variance in intervals.variance.items():
            share_percent = 100 * variance[k] / max(intervals.se[k] ** 2, TINY)
            if share_percent >= SHOWN_SHARE_PERCENT:
                causes.append(f"{cause} {share_percent:.0f} %")
        yield (
            f"{name:4}{expected:>10.4g}{half_width:>18.3g}{percent:>10}"
            f"{intervals.half_width_of_noise[k]:>18.3g}   {', '.join(causes)} [{unit}]"
        )
    freedom = ", ".join("∞" if np.isinf(d) else f"{d:.0f}" for d in intervals.degrees_of_freedom)
    method = intervals.method
    if method in (BY_UNITS, BY_REPEATS):
        method += ", as impedance.csv will name it"
    yield (
        f"interval from {method}, {freedom} degrees of freedom; correlation of K and I"
        f" {intervals.fit.correlation:.2f}, condition number {intervals.fit.condition_number:.3g}"
    )


def design_json(design: Design) -> str:
    """All of it as JSON, in SI units; null for numbers that are infinite or undefined."""
    recommended = design.recommended
    content = {
        **planned_json(design.requested),
        "friction_damping": design.assumed.distortion.added_damping(design.requested.plan),
        "lag_s": design.lag_s,
        "lag_errors": design.lag_errors,
        "asked_within": design.within,
        "recommended": None if recommended is None else planned_json(recommended),
        "warnings": design.warnings,
    }
    return json.dumps(finite_or_null(content), indent=2, ensure_ascii=False)


def planned_json(planned: Planned) -> dict[str, Any]:
    """A plan and its intervals for JSON."""
    intervals = planned.precision
    columns = {
        "expected": intervals.expected,
        "half_width": intervals.half_width,
        "half_width_of_noise": intervals.half_width_of_noise,
        "se": intervals.se,
        "degrees_of_freedom": intervals.degrees_of_freedom,
    }
    estimates = {}
    for k, name in enumerate(KBI):
        numbers: dict[str, Any] = {column: float(of_KBI[k]) for column, of_KBI in columns.items()}
        numbers["variance"] = {
            cause: float(of_KBI[k]) for cause, of_KBI in intervals.variance.items()
        }
        estimates[name] = numbers
    return {
        "protocol": planned.plan.words,
        "record_s": planned.plan.record_s,
        "peak_angle": planned.plan.peak.angle,
        "estimates": estimates,
        "interval_method": intervals.method,
        "correlation_K_I": intervals.fit.correlation,
        "condition_number": intervals.fit.condition_number,
    }
