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


@dataclass(frozen=True)
class Design:
    """A plan, what its intervals depend on, and the intervals."""

    plan: Plan
    joint: Array  # K, B and I that are expected, (3,)
    sensors: Sensors
    low_pass: LowPass
    distortion: Distortion
    lag_s: float  # lag [s] of the torque whose effect is stated
    within: Mapping[str, float]  # half widths that are asked for, as shares of K, B, I

    found: Precision
    peak_torque: float  # largest torque [N*m]
    lag: Mapping[str, float]  # what the lag adds to K, B, I
    recommended: tuple[Plan, Precision] | None
    """The shortest plan that reaches what is asked for; None where nothing is asked, or it is out
    of reach."""
    warnings: tuple[str, ...]


def designed(chosen: Mapping[str, Any], config: Config) -> Design:
    """The intervals of a plan from the options by name, how long to record, and what stands in the
    way. A rate that is too low for the filter, frequencies that the filter takes out, and a band
    that the analysis refuses."""
    check_finite_options(chosen)
    bench, expected = (
        config.dynamometer,
        {name: chosen[name] for name in ("stiffness", "damping", "inertia")},
    )
    joint = np.array(list(expected.values()), dtype=float)
    within = {name: chosen[f"{option}_within"] for name, option in zip(KBI, expected, strict=True)}
    within = {name: share for name, share in within.items() if share is not None}
    for name, option in zip(KBI, expected, strict=True):
        if name in within and not expected[option]:
            raise InputError(
                f"--{option}-within is a share of an expected {name} of 0; give --{option} above 0"
            )
    distortion = Distortion(chosen["friction"] or 0.0)
    if chosen["pilot"] is not None:
        distortion = pilot_distortion(chosen["pilot"], chosen["trial"])
    plan = plan_of(chosen, bench, bool(within))
    sensors = sensors_of(chosen, bench)
    low_pass, sines = bench.low_pass, plan.sines
    cutoff, high = low_pass.cutoff_hz, float(sines.frequency_hz.max())
    if not cutoff < sensors.rate_hz / 2:
        raise InputError(
            f"--rate {sensors.rate_hz:g} Hz is too low for the filter's cut-off of {cutoff:g} Hz;"
            " sample faster than twice the cut-off"
        )
    if high > cutoff:
        raise InputError(
            f"{high:.4g} Hz is above the filter's cut-off of {cutoff:g} Hz; raise"
            " dynamometer.cutoff_hz or excite lower frequencies"
        )

    def judged(plan: Plan) -> Precision:
        return precision(plan, joint, sensors, low_pass, distortion)

    found, Z, alone = judged(plan), joint @ eq15(sines.w), sines.spacing_hz is None
    torque = np.abs(Z) * sines.size
    if not isinstance(plan, SteppedSine):  # which the analysis does not judge so
        # by samples of the filtered motion, where the two rows of each sine have the same products
        n = len(sines.w)
        fitted_s = float(np.sum(sines.duration_s) if alone else np.max(sines.duration_s))
        share = np.sqrt(n * found.fit.weight * sines.duration_s / fitted_s)
        columns = found.fit.columns
        check_told(
            "the analysis would refuse this protocol",
            (float(sines.frequency_hz.min()), high),
            np.concatenate([columns.real, columns.imag], axis=1) * np.tile(share, 2),
            float(np.sqrt(np.sum((torque * share) ** 2) / (2 * n))),
            (float(joint[0]), float(found.se[0])),
            bench.largest_inertia_error,
        )
    # of one sine at a time the largest; of many the same multiple of the RMS as the angle
    crest = plan.peak.angle / float(np.sqrt(np.sum(sines.size**2) / 2))
    peak_torque = (
        float(torque.max() if alone else crest * np.sqrt(np.sum(torque**2) / 2))
        + distortion.coulomb
    )
    lag_s, recommended = 1e-3 * chosen["lag"], None
    lag = found.fit.fitted(Z * np.exp(-1j * sines.w * lag_s)) - found.fit.fitted(Z)
    said = list(warnings(plan, found, sensors, low_pass, distortion))
    if plan.peak.angle > bench.largest_angle:
        said.append(
            f"the largest angle of {plan.peak.angle:.3g} rad is above dynamometer.largest_angle = "
            f"{bench.largest_angle:g} rad: the recording would be refused"
        )
    if bench.load_cell_range is not None and peak_torque > bench.load_cell_range:
        said.append(
            f"the torque of about {peak_torque:.3g} N·m is above dynamometer.load_cell_range = "
            f"{bench.load_cell_range:g} N·m: the recording would be refused"
        )
    if within:
        best, longest = long_enough(plan, lambda plan: judged(plan).reaches(within))
        if best is not None:
            recommended = best, judged(best)
        else:
            said.append(beyond_reach(longest, judged(longest), joint, within))
    added = dict(zip(KBI, lag.tolist(), strict=True))
    inputs = plan, joint, sensors, low_pass, distortion, lag_s, within
    return Design(*inputs, found, peak_torque, added, recommended, tuple(said))


def check_finite_options(chosen: Mapping[str, Any]) -> None:
    """Refuse an option that is no finite number."""
    for name, value in chosen.items():
        numbers = value if isinstance(value, list) else [value]
        if any(isinstance(one, float) and not np.isfinite(one) for one in numbers):
            raise InputError(f"--{name.replace('_', '-')} is {value}; give a finite number")


def sensors_of(chosen: Mapping[str, Any], bench: DynamometerAnalysis) -> Sensors:
    """What the options say of load cell and encoder, in SI units; else the drift of the
    configuration."""
    step, drift = chosen["encoder_step"], chosen["drift"]
    return Sensors(
        rate_hz=chosen["rate"],
        torque_noise=chosen["torque_noise"],
        noise_band_hz=chosen["noise_band"],
        torque_step=chosen["torque_step"],
        encoder_step=(
            2 * np.pi / 2 ** chosen["encoder_bits"] if step is None else float(np.deg2rad(step))
        ),
        angle_noise=float(np.deg2rad(chosen["angle_noise"])),
        drift=(bench.load_cell_drift if drift is None else drift) / 60,
    )


def beyond_reach(longest: Plan, most: Precision, joint: Array, within: Mapping[str, float]) -> str:
    """What the longest plan that is searched gives, and what limits it."""
    reached = []
    for k, name in ((k, name) for k, name in enumerate(KBI) if name in within):
        cause = max(most.variance, key=lambda one: most.variance[one][k])
        percent = 100 * most.half_width[k] / max(abs(joint[k]), TINY)
        share_of = 100 * most.variance[cause][k] / max(most.se[k] ** 2, TINY)
        reached.append(f"{name} ± {percent:.2g} % (variance by {cause} {share_of:.0f} %)")
    return (
        "what is asked for is beyond the longest record that is searched,"
        f" {longest.record_s / 3600:.2g} h, which gives {', '.join(reached)}; move further, widen"
        " the band, or ask for less"
    )


def warnings(
    plan: Plan,
    found: Precision,
    sensors: Sensors,
    low_pass: LowPass,
    distortion: Distortion,
) -> Iterator[str]:
    """What a user must know of a plan: its band, encoder and load cell, and the distortion."""
    I, correlation, f = (
        found.expected[2],
        found.fit.correlation,
        found.fit.sines.frequency_hz,
    )
    low, high = float(f.min()), float(f.max())
    wide = I != 0 and found.half_width[2] > 0.5 * abs(I)
    # from there on the intervals of K and I are 2.3 times as wide as alone
    if correlation > 0.9 or wide:
        tried = {}  # an octave below or above
        for words, band in {
            f"below {low:.3g} Hz, down to {low / 2:.3g} Hz": (low / 2, high),
            f"above {high:.3g} Hz, up to {2 * high:.3g} Hz": (low, 2 * high),
        }.items():
            if isinstance(plan, SteppedSine):
                hertz = tuple(sorted({*plan.frequencies_hz, *band}))
                wider: Plan = replace(
                    plan, frequencies_hz=hertz, cycles=(max(plan.cycles),) * len(hertz)
                )
            else:
                wider = replace(plan, band_hz=band)
            with suppress(IdentifiabilityError):
                tried[words] = planned_fit(wider, low_pass).correlation
        best = min(tried, key=lambda words: tried[words], default="")
        missing = (
            f"the band {best} (correlation {tried[best]:.2f})"
            if best
            else "a band of several octaves"
        )
        yield (
            f"the excitation hardly tells K from I (correlation {correlation:.2f}"
            f"{', I not known to 50 %' if wide else ''}): what is missing is {missing}"
        )
    smallest = min(plan.sines.size) if isinstance(plan, SteppedSine) else plan.rms * np.sqrt(2)
    if not sensors.encoder_step:
        yield "no step of the encoder is stated: the interval is without its rounding"
    elif smallest < 10 * sensors.encoder_step:
        yield (
            f"the smallest amplitude has {smallest / sensors.encoder_step:.2g} steps of the"
            " encoder; take 10 or more"
        )
    total = np.maximum(found.se**2, TINY)
    if (share := np.max(found.variance["encoder rounding"] / total)) > 0.25:
        noise = isinstance(plan, Continuous) and not plan.chirp
        stays = "" if noise else "; it repeats, so that longer records do not average it out"
        yield (
            f"rounding of the encoder makes {100 * share:.0f} % of the variance{stays}; take a"
            f" finer encoder{'' if noise else ', or half a step of noise on the angle'}"
        )
    if distortion == Distortion():
        yield (
            "no distortion is stated: these are the intervals of a joint that is exactly Eq. 15;"
            " with friction the estimates of a multisine scatter up to 50 times as much, and those"
            " of a stepped sine are shifted; state --friction, or a pilot by --from"
        )
    if isinstance(plan, PeriodicMultisine) and plan.realisations < ENOUGH_REALISATIONS:
        yield (
            f"{plan.realisations} realisation{'s' if plan.realisations > 1 else ''} of a distortion"
            " whose level at detection lines is all that is known of it: take"
            f" {ENOUGH_REALISATIONS} or more, and 8 to know the level within 0.5 dB"
        )


def write_command(plan: Plan, rate_hz: float, output: Path) -> None:
    """Write the angle that a multisine commands: `time` [s], `theta_command` [rad]. Each
    realisation rises within its transient period, in 1 s, and falls after its last one; it is at
    rest for 1 s in between."""
    if not isinstance(plan, PeriodicMultisine):
        raise InputError(f"{output}: only a multisine is written; give --excitation multisine")
    length = (plan.periods + TRANSIENTS) * plan.period_s + 1.0
    time, pause = np.arange(round(length * rate_hz)) / rate_hz, np.zeros(round(rate_hz))
    envelope = 0.5 * (1 - np.cos(np.pi * np.clip(np.minimum(time, length - time), 0, 1)))
    parts = [
        part
        for r in range(plan.realisations)
        for part in (plan.motion(r).angle(time) * envelope, pause)
    ]
    angle = np.concatenate([pause, *parts])
    write_table(
        pl.DataFrame({"time": np.arange(len(angle)) / rate_hz, "theta_command": angle}), output
    )


def other_plan(chosen: Mapping[str, Any], longer: bool) -> Plan:
    """A motion that is no stepped sine; without a stated band 0.5 to 6 Hz, without a stated size 2
    deg rms. `longer`: more realisations may be recommended."""
    band, rms = tuple(chosen["band"] or (0.5, 6.0)), float(np.deg2rad(chosen["rms"] or 2.0))
    peak = None if chosen["peak"] is None else float(np.deg2rad(chosen["peak"]))
    if chosen["excitation"] != "multisine":
        other = Continuous(band, rms, chosen["duration"], chosen["excitation"] == "chirp")
        return other if peak is None else replace(other, rms=rms * peak / other.peak.angle)
    plan = PeriodicMultisine(
        chosen["period"], band, rms, chosen["periods"], chosen["realisations"], chosen["seed"]
    )
    if peak is None:
        return plan
    one, drawn = (
        replace(plan, rms=1.0),
        max(plan.realisations, MOST_DRAWN if longer else 1),
    )
    # none may go beyond the peak
    return replace(plan, rms=peak / max(one.motion(r).peak for r in range(drawn)))


def plan_of(chosen: Mapping[str, Any], bench: DynamometerAnalysis, longer: bool) -> Plan:
    """The protocol: the stepped sine of the configuration, with what is chosen in its place; or
    another motion."""
    if chosen["excitation"] != "stepped-sine":
        return other_plan(chosen, longer)
    frequencies = tuple(chosen["frequencies"] or bench.frequencies_hz or ())
    amplitudes = tuple(chosen["amplitudes"] or bench.amplitudes_deg or ())
    if not (frequencies and amplitudes and (chosen["cycles"] or bench.protocol.cycles_at)):
        raise InputError(
            "the configuration states no whole protocol; give --frequencies, --amplitudes and"
            " --cycles, or state amplitudes_deg, frequencies_hz and cycles under `dynamometer`"
        )
    if not all(0 < x < np.inf for x in (*frequencies, *amplitudes)):
        raise InputError(
            "frequencies and amplitudes of sines are above 0; correct --frequencies, --amplitudes"
        )
    cycles = bench.protocol.cycles_at
    if chosen["cycles"] is not None or len(set(cycles)) == 1:
        cycles = (float(chosen["cycles"] or cycles[0]),) * len(frequencies)
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


def pilot_distortion(results: Path, trial: str | None) -> Distortion:
    """Coulomb friction of the joint in an impedance trial of a pilot, and the variances of its K, B
    and I; medians of all trials where none is named. Raises InputError: the results have none."""
    table = with_evidence(results / "tables/impedance.csv", ("trial", "amplitude_deg", *KBI))
    rows = table.filter(
        pl.col("amplitude_deg").is_null(), **({} if trial is None else {"trial": trial})
    )
    names = ("f_C", *(f"{name}_se" for name in KBI))
    known = [rows[name].drop_nulls().to_list() if name in rows.columns else [] for name in names]
    if not all(known):
        raise InputError(f"{results}: {no_friction_text(table, trial)}")
    friction, *errors = (float(np.median(values)) for values in known)
    return Distortion(max(friction, 0.0), pilot=tuple(se**2 for se in errors))


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


def design_text(made: Design) -> str:
    plan, sensors, low_pass = made.plan, made.sensors, made.low_pass
    peak = plan.peak
    band = f"up to {sensors.noise_band_hz:g} Hz" if sensors.noise_band_hz else "white"
    step = (
        f"encoder step {np.rad2deg(sensors.encoder_step):.3g} deg"
        if sensors.encoder_step
        else "encoder not rounded"
    )
    lag = ", ".join(
        f"{name} {value:+.2g}" + (f" ({100 * value / expected:+.1f} %)" if expected else "")
        for (name, value), expected in zip(made.lag.items(), made.joint, strict=True)
    )
    lines = [
        plan.words,
        (
            f"  record {seconds(plan.record_s)}; largest angle {np.rad2deg(peak.angle):.3g} deg,"
            f" velocity {peak.velocity:.3g} rad/s, acceleration {peak.acceleration:.3g} rad/s²,"
            f" torque about {made.peak_torque:.3g} N·m"
        ),
        (
            f"  torque noise {sensors.torque_noise:.3g} N·m SD ({band}) at {sensors.rate_hz:g} Hz,"
            f" {step}, load cell drift {60 * sensors.drift:.3g} N·m/min; filter"
            f" {low_pass.cutoff_hz:g} Hz, order {low_pass.order}"
        ),
        "",
        *interval_lines(made.found),
        "",
        f"not in the interval: torque later than the angle by {1e3 * made.lag_s:g} ms adds {lag}",
    ]
    if added := made.distortion.added_damping(plan):
        values = ", ".join(f"{value:.3g} ({name})" for name, value in added.items())
        friction = made.distortion.coulomb
        lines.append(
            f"not in the interval: Coulomb friction of {friction:g} N·m adds to B {values}"
            " N·m·s/rad"
        )
    if made.within:
        asked = ", ".join(f"{name} ± {100 * share:g} %" for name, share in made.within.items())
        lines += ["", f"for {asked}:"]
        if made.recommended is None:
            lines.append("  beyond the longest record that is searched")
        else:
            best, found = made.recommended
            lines += [f"  {best.words}", f"  record {seconds(best.record_s)}"]
            lines += ["  " + line for line in interval_lines(found)]
    return "\n".join([*lines, *(f"warning: {said}" for said in made.warnings)])


def seconds(value: float) -> str:
    return f"{value:.4g} s" + (f" ({value / 60:.1f} min)" if value >= 120 else "")


def interval_lines(found: Precision) -> Iterator[str]:
    """A line per parameter, with what the variance is made of, and a line on the interval."""
    yield (
        f"{'':4}{'expected':>10}{'95 % interval ±':>18}{'in %':>10}{'by noise alone ±':>18}  "
        " variance by"
    )
    for k, (name, unit) in enumerate(zip(KBI, ("N·m/rad", "N·m·s/rad", "kg·m²"), strict=True)):
        value, half_width, se = found.expected[k], found.half_width[k], found.se[k]
        of_noise = found.half_width_of_noise[k]
        percent = f"{100 * half_width / abs(value):.3g}" if value else "-"
        shares = {cause: 100 * of[k] / max(se**2, TINY) for cause, of in found.variance.items()}
        made_of = ", ".join(
            f"{cause} {share:.0f} %" for cause, share in shares.items() if share >= 0.5
        )
        yield (
            f"{name:4}{value:>10.4g}{half_width:>18.3g}{percent:>10}{of_noise:>18.3g}   {made_of}"
            f" [{unit}]"
        )
    freedom = ", ".join("∞" if np.isinf(d) else f"{d:.0f}" for d in found.degrees_of_freedom)
    named = ", as impedance.csv will name it" * (found.method in (BY_UNITS, BY_REPEATS))
    yield (
        f"interval from {found.method}{named}, {freedom} degrees of freedom; correlation of K and I"
        f" {found.fit.correlation:.2f}, condition number {found.fit.condition_number:.3g}"
    )


def estimated(found: Precision) -> dict[str, Array]:
    """The numbers of K, B and I, (3,) each, by their names in JSON."""
    return {
        "expected": found.expected,
        "half_width": found.half_width,
        "half_width_of_noise": found.half_width_of_noise,
        "se": found.se,
        "degrees_of_freedom": found.degrees_of_freedom,
    }


def design_json(made: Design) -> str:
    """All of it as JSON, in SI units; null for numbers that are infinite or undefined."""

    def content(plan: Plan, found: Precision) -> dict[str, Any]:
        def of(columns: Mapping[str, Array], k: int) -> dict[str, Any]:
            return {name: float(values[k]) for name, values in columns.items()}

        return {
            "protocol": plan.words,
            "record_s": plan.record_s,
            "peak_angle": plan.peak.angle,
            "estimates": {
                name: {**of(estimated(found), k), "variance": of(found.variance, k)}
                for k, name in enumerate(KBI)
            },
            "interval_method": found.method,
            "correlation_K_I": found.fit.correlation,
            "condition_number": found.fit.condition_number,
        }

    whole = content(made.plan, made.found) | {
        "friction_damping": made.distortion.added_damping(made.plan),
        "lag_s": made.lag_s,
        "lag_errors": made.lag,
        "asked_within": made.within,
        "recommended": None if made.recommended is None else content(*made.recommended),
        "warnings": made.warnings,
    }
    return json.dumps(finite_or_null(whole), indent=2, ensure_ascii=False)
