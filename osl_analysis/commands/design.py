"""Experiment design for the command line: the plan that options ask for, and what it will tell on K, B and I."""

import json
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl

from osl_analysis.bench.gram import BY_UNITS
from osl_analysis.config.configuration import Config
from osl_analysis.design.plan import (
    MOST_DRAWN,
    TRANSIENTS,
    Continuous,
    PeriodicMultisine,
    Plan,
    SteppedSine,
    long_enough,
    longest,
)
from osl_analysis.design.precision import (
    KBI,
    Density,
    Distortion,
    Joint,
    PlannedFit,
    Precision,
    Sensors,
    Spread,
    planned_fit,
    precision,
)
from osl_analysis.errors import IdentifiabilityError, InputError
from osl_analysis.judge.doubts import check_told, told_by
from osl_analysis.signals import LowPass
from osl_analysis.spectral.response import DETECTION, ENOUGH_REALISATIONS, REALISATIONS
from osl_analysis.stats.covariance import CYCLES
from osl_analysis.table import finite_or_null, read_table, write_table
from osl_analysis.trial import Array


@dataclass(frozen=True)
class DesignRequest:
    """A plan and what its intervals depend on."""

    plan: Plan
    joint: Joint
    sensors: Sensors
    low_pass: LowPass
    distortion: Distortion
    lag_s: float  # Lag [s] of the torque whose effect is stated
    within: Mapping[str, float]  # Half widths that are asked for, as shares of K, B, I

    def judged(self, plan: Plan) -> Precision:
        """The intervals that a plan gives; raises as `precision`."""
        return precision(plan, self.joint, self.sensors, self.low_pass, self.distortion)


@dataclass(frozen=True)
class Design:
    request: DesignRequest
    found: Precision
    recommended: tuple[Plan, Precision] | None
    """The shortest plan that reaches what is asked for; None where nothing is asked, or it is out of reach."""
    lag: Mapping[str, float]  # What the lag adds to K, B, I
    warnings: tuple[str, ...]


def designed(request: DesignRequest, config: Config) -> Design:
    """The intervals of a plan, how long to record, and what stands in the way."""
    refuse_band(request)
    found = request.judged(request.plan)
    check_analysed(request, found.fit, float(found.se[0]), config.dynamometer.largest_inertia_error)
    best = None
    if request.within:
        best = long_enough(request.plan, lambda plan: request.judged(plan).reaches(request.joint, request.within))
    said = [*warnings(request, found), *range_warnings(request, config)]
    if request.within and best is None:
        said.append(out_of_reach(request))
    recommended = None if best is None else (best, request.judged(best))
    return Design(request, found, recommended, lag_errors(found.fit, request.joint, request.lag_s), tuple(said))


def lag_errors(fit: PlannedFit, joint: Joint, lag_s: float) -> dict[str, float]:
    """What a torque that is late by `lag_s` [s] adds to K, B and I: the fit of Z exp(-j w lag) minus that of Z."""
    Z = joint.impedance(fit.sines.w)
    late = np.asarray(Z * np.exp(-1j * fit.sines.w * lag_s), dtype=np.complex128)
    return dict(zip(KBI, (fit.fitted(late) - fit.fitted(Z)).tolist(), strict=True))


def refuse_band(request: DesignRequest) -> None:
    """Refuse a rate that is too low for the filter, and frequencies that the filter takes out."""
    rate, cutoff = request.sensors.rate_hz, request.low_pass.cutoff_hz
    if not cutoff < rate / 2:
        raise InputError(
            f"--rate {rate:g} Hz is too low for the filter's cut-off of {cutoff:g} Hz; sample faster than twice the "
            "cut-off"
        )
    highest = float(request.plan.sines.frequency_hz.max())
    if highest > cutoff:
        raise InputError(
            f"{highest:.4g} Hz is above the filter's cut-off of {cutoff:g} Hz; raise dynamometer.cutoff_hz or excite "
            "lower frequencies"
        )


def check_analysed(request: DesignRequest, fit: PlannedFit, K_se: float, largest_inertia_error: float | None) -> None:
    """Refuse a motion that the analysis will refuse, because its band cannot tell K from I. The analysis judges samples
    of the filtered motion. The two rows of each sine have the same products. A stepped sine is analysed in another way,
    and not judged so."""
    if isinstance(request.plan, SteppedSine):
        return
    sines, n = fit.sines, len(fit.sines.w)
    fitted_s = float(np.sum(sines.duration_s) if sines.alone.all() else np.max(sines.duration_s))
    share = np.sqrt(n * fit.weight * sines.duration_s / fitted_s)
    theta, omega, alpha = (fit.columns * share[:, None]).reshape(-1, 3).T
    torque = float(np.sqrt(np.sum(np.abs(request.joint.impedance(sines.w) * sines.size * share) ** 2) / (2 * n)))
    band = float(sines.frequency_hz.min()), float(sines.frequency_hz.max())
    change = told_by(theta, omega, alpha, torque)
    check_told("the analysis would refuse this protocol", band, change, (request.joint.K, K_se), largest_inertia_error)


def warnings(request: DesignRequest, found: Precision) -> Iterator[str]:
    I, low_pass, correlation = request.joint.I, request.low_pass, found.fit.correlation
    wide = I != 0 and found.half_width[2] > 0.5 * abs(I)
    if correlation > 0.9 or wide:  # from there on the intervals of K and I are 2.3 times as wide as alone
        yield (
            f"the excitation hardly tells K from I (correlation {correlation:.2f}"
            f"{', I not known to 50 %' if wide else ''}): what is missing is {better_band(request.plan, low_pass)}"
        )
    highest = float(request.plan.sines.frequency_hz.max())
    if highest > 0.5 * low_pass.cutoff_hz:
        yield (
            f"{highest:.3g} Hz is near the filter's cut-off of {low_pass.cutoff_hz:g} Hz, which weighs it down and "
            "lets what Eq. 15 does not describe count less there; raise cutoff_hz or lower the frequency"
        )
    yield from about_sensors(request.plan, found, request.sensors)
    yield from about_distortion(request.plan, found, request.distortion)


def better_band(plan: Plan, low_pass: LowPass) -> str:
    """Which octave below or above the plan's band tells K and I apart better, in words."""
    low, high = float(plan.sines.frequency_hz.min()), float(plan.sines.frequency_hz.max())
    tried = {}
    for words, band in {
        f"below {low:.3g} Hz, down to {low / 2:.3g} Hz": (low / 2, high),
        f"above {high:.3g} Hz, up to {2 * high:.3g} Hz": (low, 2 * high),
    }.items():
        try:
            tried[words] = planned_fit(plan.banded(*band), low_pass).correlation
        except IdentifiabilityError:
            continue
    if not tried:
        return "a band of several octaves"
    best = min(tried, key=lambda words: tried[words])
    return f"the band {best} (correlation {tried[best]:.2f})"


def about_sensors(plan: Plan, found: Precision, sensors: Sensors) -> Iterator[str]:
    """Warnings on rounding and drift: on fewer than ten steps of the encoder, and on a quarter of a variance."""
    smallest = min(plan.sines.size) if isinstance(plan, SteppedSine) else plan.rms * np.sqrt(2)
    if not sensors.encoder_step:
        yield "no step of the encoder is stated: the interval is without its rounding"
    elif smallest < 10 * sensors.encoder_step:
        yield f"the smallest amplitude has {smallest / sensors.encoder_step:.2g} steps of the encoder; take 10 or more"
    total = np.sum(list(found.causes.values()), axis=0)
    largest = {name: float(np.max(own / np.where(total > 0, total, 1))) for name, own in found.causes.items()}
    if (share := largest["encoder rounding"]) > 0.25:
        noise = isinstance(plan, Continuous) and not plan.chirp
        stays = "" if noise else "; it repeats, so that longer records do not average it out"
        yield (
            f"rounding of the encoder makes {100 * share:.0f} % of the variance{stays}; take a finer encoder"
            f"{'' if noise else ', or half a step of noise on the angle'}"
        )
    if (share := largest["load cell drift"]) > 0.25:
        yield f"the load cell's drift makes {100 * share:.0f} % of the variance; let it warm up, or record for longer"


def about_distortion(plan: Plan, found: Precision, distortion: Distortion) -> Iterator[str]:
    if not distortion.stated:
        yield (
            "no distortion is stated: these are the intervals of a joint that is exactly Eq. 15; with friction the "
            "estimates of a multisine scatter up to 50 times as much, and those of a stepped sine are shifted; state "
            "--friction, --distortion or --earlier"
        )
    if distortion.coulomb and isinstance(plan, SteppedSine):
        yield (
            "this is the interval of a repetition, from the spread of cycles, which all repeat friction; that of the "
            "analysis also has what friction changes from one frequency and amplitude to another, and is wider"
        )
    if isinstance(plan, PeriodicMultisine) and plan.realisations < ENOUGH_REALISATIONS:
        level = "whose level at detection lines is all that is known of it" if found.method == DETECTION else ""
        yield (
            f"{plan.realisations} realisation{'s' if plan.realisations > 1 else ''} of a distortion {level}: take "
            f"{ENOUGH_REALISATIONS} or more, and 8 to know the level within 0.5 dB"
        )
    if isinstance(plan, Continuous) and distortion.stated:
        yield "a motion that does not repeat itself does not tell noise from distortion; a multisine does"


def range_warnings(request: DesignRequest, config: Config) -> Iterator[str]:
    """Warnings on angles and torques that the configuration does not allow."""
    bench, angle, torque = config.dynamometer, request.plan.peak[0], peak_torque(request)
    if angle > bench.largest_angle:
        yield (
            f"the largest angle of {angle:.3g} rad is above dynamometer.largest_angle = {bench.largest_angle:g} rad: "
            "the recording would be refused"
        )
    if bench.load_cell_range is not None and torque > bench.load_cell_range:
        yield (
            f"the torque of about {torque:.3g} N·m is above dynamometer.load_cell_range = "
            f"{bench.load_cell_range:g} N·m: the recording would be refused"
        )


def out_of_reach(request: DesignRequest) -> str:
    """How far the longest plan that is tried comes, and the largest part of each variance there."""
    plan = longest(request.plan)
    found = request.judged(plan)
    causes, parts, tiny = list(found.causes), np.array(list(found.causes.values())), np.finfo(float).tiny
    largest = np.argmax(parts, axis=0)
    shares = 100 * np.max(parts, axis=0) / np.maximum(parts.sum(axis=0), tiny)
    values = np.maximum(np.abs(request.joint.values), tiny)
    reaches = (
        f"{name} ± {100 * found.half_width[k] / values[k]:.2g} % (variance by {causes[largest[k]]} {shares[k]:.0f} %)"
        for k, name in enumerate(KBI)
        if name in request.within
    )
    return (
        f"what is asked for is beyond the longest record that is searched, {plan.record_s / 3600:.2g} h, which gives "
        f"{', '.join(reaches)}; move further, widen the band, or ask for less"
    )


def peak_torque(request: DesignRequest) -> float:
    """Largest torque [N*m]: of sines one at a time the largest, of many the same multiple of the RMS as the angle."""
    sines = request.plan.sines
    torque = np.abs(request.joint.impedance(sines.w)) * sines.size
    if sines.alone.all():
        return float(torque.max()) + request.distortion.coulomb
    crest = request.plan.peak[0] / float(np.sqrt(np.sum(sines.size**2) / 2))
    return crest * float(np.sqrt(np.sum(torque**2) / 2)) + request.distortion.coulomb


def command_of(plan: PeriodicMultisine, rate_hz: float) -> tuple[Array, Array]:
    """Times [s] and angles [rad] of all realisations, shape (n,) each. Each rises within its transient period, in 1 s,
    and falls after its last one; it is at rest for 1 s in between."""
    length = (plan.periods + TRANSIENTS) * plan.period_s + 1.0
    n, pause = round(length * rate_hz), np.zeros(round(rate_hz))
    time = np.arange(n) / rate_hz
    envelope = 0.5 * (1 - np.cos(np.pi * np.clip(np.minimum(time, length - time), 0, 1)))
    parts = [part for r in range(plan.realisations) for part in (plan.motion(r).angle(time) * envelope, pause)]
    angle = np.concatenate([pause, *parts])
    return np.arange(len(angle)) / rate_hz, angle


def write_command(plan: Plan, rate_hz: float, output: Path) -> None:
    """Write the angle that a multisine commands: `time` [s], `theta_command` [rad]. The most samples that are written
    are nearly three hours at 1 kHz."""
    if not isinstance(plan, PeriodicMultisine):
        raise InputError(f"{output}: only a multisine is written; give --excitation multisine")
    samples, most = plan.record_s * rate_hz, 1e7
    if samples > most:
        raise InputError(f"{output}: {samples:.3g} samples are more than {most:g}; lower --rate, or ask for less")
    time, angle = command_of(plan, rate_hz)
    write_table(pl.DataFrame({"time": time, "theta_command": angle}), output)


def design_request(chosen: Mapping[str, Any], config: Config) -> DesignRequest:
    """The plan and all that its intervals depend on, in SI units, from the options by name."""
    for name, value in chosen.items():
        numbers = value if isinstance(value, list) else [value]
        if any(isinstance(one, float) and not np.isfinite(one) for one in numbers):
            raise InputError(f"--{name.replace('_', '-')} is {value}; give a finite number")
    low_pass, study = config.dynamometer.low_pass, config.study
    expected = {"stiffness": study.K_d, "damping": study.B_d, "inertia": study.I}
    joint = [expected[name] if chosen[name] is None else chosen[name] for name in expected]
    within = {name[0]: chosen[f"{option}_within"] for name, option in zip("KBI", expected, strict=True)}
    step = chosen["encoder_step"]
    drift = config.dynamometer.load_cell_drift if chosen["drift"] is None else chosen["drift"]
    return DesignRequest(
        plan=plan_of(chosen, config),
        joint=Joint(*joint),
        sensors=Sensors(
            rate_hz=chosen["rate"],
            torque_noise=chosen["torque_noise"],
            noise_band_hz=chosen["noise_band"],
            torque_step=chosen["torque_step"],
            encoder_step=2 * np.pi / 2 ** chosen["encoder_bits"] if step is None else float(np.deg2rad(step)),
            angle_noise=float(np.deg2rad(chosen["angle_noise"])),
            drift=drift / 60,
        ),
        low_pass=low_pass,
        distortion=distortion_of(chosen),
        lag_s=1e-3 * chosen["lag"],
        within={name: share for name, share in within.items() if share is not None},
    )


def plan_of(chosen: Mapping[str, Any], config: Config) -> Plan:
    """The protocol; without a stated band 0.5 to 6 Hz, without a stated size 2 deg rms."""
    if chosen["excitation"] == "stepped-sine":
        return planned_stepped_sine(chosen, config)
    band = tuple(chosen["band"] or (0.5, 6.0))
    rms = float(np.deg2rad(chosen["rms"] or 2.0))
    peak = None if chosen["peak"] is None else float(np.deg2rad(chosen["peak"]))
    if chosen["excitation"] == "multisine":
        numbers = {name: chosen[name] for name in ("periods", "realisations", "seed")}
        plan = PeriodicMultisine(chosen["period"], band, rms, **numbers)
        longer = any(chosen[f"{name}_within"] is not None for name in ("stiffness", "damping", "inertia"))
        return plan if peak is None else plan.of_peak(peak, max(plan.realisations, MOST_DRAWN if longer else 1))
    other = Continuous(band, rms, chosen["duration"], chosen["excitation"] == "chirp")
    return other if peak is None else replace(other, rms=rms * peak / other.peak[0])


def planned_stepped_sine(chosen: Mapping[str, Any], config: Config) -> SteppedSine:
    """The stepped sine of the configuration, with what is chosen in its place."""
    bench = config.dynamometer
    frequencies = tuple(chosen["frequencies"] or bench.frequencies_hz)
    amplitudes = tuple(chosen["amplitudes"] or bench.amplitudes_deg)
    if not all(0 < x < np.inf for x in (*frequencies, *amplitudes)):
        raise InputError(
            "frequencies and amplitudes of a stepped sine are above 0; correct --frequencies, --amplitudes"
        )
    cycles = bench.protocol.cycles_at
    if chosen["cycles"] is not None:
        cycles = (float(chosen["cycles"]),) * len(frequencies)
    elif len(set(cycles)) == 1:
        cycles = (cycles[0],) * len(frequencies)
    elif len(cycles) != len(frequencies):
        raise InputError("the configuration has cycles for its own frequencies; give --cycles for these")
    if min(cycles) <= bench.settle_cycles:
        raise InputError(
            f"settle_cycles = {bench.settle_cycles} leaves none of {min(cycles):g} cycles; give --cycles above it"
        )
    return SteppedSine(tuple(np.deg2rad(amplitudes).tolist()), frequencies, cycles, bench.settle_cycles)


def distortion_of(chosen: Mapping[str, Any]) -> Distortion:
    """What is stated on distortion; friction counts once, whether stated or in an earlier table."""
    earlier = Distortion() if chosen["earlier"] is None else earlier_distortion(chosen["earlier"], chosen["trial"])
    if chosen["friction"] is not None and earlier != Distortion():
        raise InputError("--friction and --earlier state the same distortion twice; give one of them")
    return replace(
        earlier,
        coulomb=earlier.coulomb if chosen["friction"] is None else chosen["friction"],
        level=chosen["distortion"] or 0.0,
    )


def earlier_distortion(path: Path, trial: str | None) -> Distortion:
    """The distortion that an earlier trial showed.

    `response.csv` has levels; `impedance.csv` the spread of a multisine's realisations, or a stepped sine's friction.
    """
    table = read_table(path)
    has_levels = {"frequency_hz", "angle_deg", "odd_level"} <= set(table.columns)
    if "trial" not in table.columns or not (has_levels or "coulomb_torque" in table.columns):
        raise InputError(f"{path}: no columns of response.csv or impedance.csv; give one of these tables")
    rows = table if trial is None else table.filter(pl.col("trial") == trial)
    names = rows["trial"].unique().to_list()
    if len(names) != 1:
        what = f"no trial '{trial}'" if trial else f"{len(names)} trials"
        such = f", such as {table['trial'][0]}" if len(table) else ""
        raise InputError(f"{path}: {what}; choose one with --trial{such}")
    if has_levels:
        return level_of(rows, path)
    if spread := spread_of(rows):
        return Distortion(spread=spread)
    whole = rows.filter(pl.col("amplitude_deg").is_null())  # over all amplitudes, or a single row
    value = (whole if len(whole) else rows)["coulomb_torque"].cast(pl.Float64)[0]
    if value is None or not np.isfinite(value):
        raise InputError(f"{path}: coulomb_torque of trial {rows['trial'][0]} is empty; state --friction")
    return Distortion(coulomb=abs(float(value)))


def spread_of(rows: pl.DataFrame) -> Spread | None:
    """The spread of the realisations of a multisine, from its row of `impedance.csv`; None of any other trial.

    The analysis leaves out parts of the period of each realisation, not realisations. Of the drivetrain of the campaign
    `excitations` these standard errors are 1.3 times what K and I scatter by from one realisation to the next, and 2 to
    5 times what B does: a design by them is on the safe side.
    """
    columns = ["realisations", "band_low_hz", "band_high_hz", "theta_rms_deg", *(f"{name}_se" for name in KBI)]
    if not set(columns) <= set(rows.columns):
        return None
    of_motions = pl.col("interval_method").is_in([REALISATIONS, BY_UNITS])
    known = rows.filter(of_motions).select(pl.col(columns).cast(pl.Float64)).drop_nulls()
    if not len(known):
        return None
    count, low, high, rms_deg, *errors = known.row(0)
    return Spread(count * np.array(errors) ** 2, (low, high), float(np.deg2rad(rms_deg)))


def level_of(rows: pl.DataFrame, path: Path) -> Distortion:
    """The density of the distortion, from the columns of `response.csv`.

    A level is E|d|^2 of Z, times |theta|^2 twice the mean square of the torque that a line has; odd lines are as far
    apart as the closest two.
    """
    used = ("frequency_hz", "angle_deg", "odd_level")
    known = rows.select(pl.col(used).cast(pl.Float64)).drop_nulls().sort("frequency_hz")
    f, angle_deg, level = (known[name].to_numpy() for name in used)
    if len(f) < 2 or not np.isfinite(level).all():
        raise InputError(f"{path}: no odd_level of trial {rows['trial'][0]}; it needs a periodic motion with odd lines")
    return Distortion(earlier=Density(f, 0.5 * (level * np.deg2rad(angle_deg)) ** 2 / float(np.min(np.diff(f)))))


def design_text(made: Design) -> str:
    request, plan = made.request, made.request.plan
    angle, velocity, acceleration = plan.peak
    sensors, low_pass = request.sensors, request.low_pass
    band = f"up to {sensors.noise_band_hz:g} Hz" if sensors.noise_band_hz else "white"
    step = f"encoder step {np.rad2deg(sensors.encoder_step):.3g} deg" if sensors.encoder_step else "encoder not rounded"
    lines = [
        plan.words,
        f"  record {seconds(plan.record_s)}; largest angle {np.rad2deg(angle):.3g} deg, velocity {velocity:.3g} rad/s, "
        f"acceleration {acceleration:.3g} rad/s², torque about {peak_torque(request):.3g} N·m",
        f"  torque noise {sensors.torque_noise:.3g} N·m SD ({band}) at {sensors.rate_hz:g} Hz, {step}, load cell drift "
        f"{60 * sensors.drift:.3g} N·m/min; filter {low_pass.cutoff_hz:g} Hz, order {low_pass.order}",
        "",
        *interval_lines(request, made.found),
        "",
        *effects(made),
    ]
    if request.within:
        asked = ", ".join(f"{name} ± {100 * share:g} %" for name, share in request.within.items())
        lines += ["", f"for {asked}:"]
        if made.recommended is None:
            lines.append("  beyond the longest record that is searched")
        else:
            best, found = made.recommended
            lines += [f"  {best.words}", f"  record {seconds(best.record_s)}"]
            lines += ["  " + line for line in interval_lines(request, found)]
    return "\n".join([*lines, *(f"warning: {said}" for said in made.warnings)])


def seconds(value: float) -> str:
    """A time in seconds, and in minutes where it is long."""
    return f"{value:.4g} s" + (f" ({value / 60:.1f} min)" if value >= 120 else "")


def interval_lines(request: DesignRequest, found: Precision) -> Iterator[str]:
    """A line per parameter, with what the variance is made of, and a line on the interval."""
    rows = found.rows(request.joint)
    yield f"{'':4}{'expected':>10}{'95 % interval ±':>18}{'in %':>10}{'by noise alone ±':>18}   variance by"
    for (name, row), unit in zip(rows.items(), ("N·m/rad", "N·m·s/rad", "kg·m²"), strict=True):
        value, total = row["expected"], row["se"] ** 2
        percent = f"{100 * row['half_width'] / abs(value):.3g}" if value else "-"
        shares = {cause: 100 * part / total for cause, part in row["variance"].items() if total > 0}
        made_of = ", ".join(f"{cause} {share:.0f} %" for cause, share in shares.items() if share >= 0.5)
        yield (
            f"{name:4}{value:>10.4g}{row['half_width']:>18.3g}{percent:>10}{row['half_width_of_noise']:>18.3g}"
            f"   {made_of} [{unit}]"
        )
    freedom = ", ".join("∞" if np.isinf(d) else f"{d:.0f}" for d in found.degrees_of_freedom)
    what = "interval of a repetition" if found.method in (CYCLES, "HAC") else "interval"
    yield (
        f"{what} from {found.method}, {freedom} degrees of freedom; correlation of K and I "
        f"{found.fit.correlation:.2f}, condition number {found.fit.condition_number:.3g}"
    )


def effects(made: Design) -> Iterator[str]:
    """What shifts the estimates without widening the interval: a lag, and friction."""
    joint = made.request.joint.values
    lag = ", ".join(
        f"{name} {value:+.2g}" + (f" ({100 * value / joint[k]:+.1f} %)" if joint[k] else "")
        for k, (name, value) in enumerate(made.lag.items())
    )
    yield f"not in the interval: torque later than the angle by {1e3 * made.request.lag_s:g} ms adds {lag}"
    added = made.request.distortion.added_damping(made.request.plan)
    if added:
        values = ", ".join(f"{value:.3g} ({name})" for name, value in added.items())
        friction = made.request.distortion.coulomb
        yield f"not in the interval: Coulomb friction of {friction:g} N·m adds to B {values} N·m·s/rad"


def design_json(made: Design) -> str:
    """All of it as JSON, in SI units; null for numbers that are infinite or undefined."""
    request = made.request
    content: dict[str, Any] = {
        **plan_content(request, request.plan, made.found),
        "friction_damping": request.distortion.added_damping(request.plan),
        "lag_s": request.lag_s,
        "lag_errors": dict(made.lag),
        "asked_within": dict(request.within),
        "recommended": None if made.recommended is None else plan_content(request, *made.recommended),
        "warnings": list(made.warnings),
    }

    def nested(part: Mapping[str, Any]) -> dict[str, Any]:
        return finite_or_null({name: nested(one) if isinstance(one, dict) else one for name, one in part.items()})

    return json.dumps(nested(content), indent=2, ensure_ascii=False)


def plan_content(request: DesignRequest, plan: Plan, found: Precision) -> dict[str, Any]:
    return {
        "protocol": plan.words,
        "record_s": plan.record_s,
        "peak_angle": plan.peak[0],
        "estimates": found.rows(request.joint),
        "interval_method": found.method,
        "correlation_K_I": found.fit.correlation,
        "condition_number": found.fit.condition_number,
    }
