"""Experiment design for the command line: the plan that options ask for, and what it will tell on K, B and I."""

import json
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl

from osl_analysis.bench.gram import BY_REPEATS, BY_UNITS
from osl_analysis.campaign.configuration import Config
from osl_analysis.design.precision import (
    KBI,
    MOST_DRAWN,
    TRANSIENTS,
    Continuous,
    Distortion,
    Joint,
    PeriodicMultisine,
    Plan,
    Precision,
    Sensors,
    SteppedSine,
    long_enough,
    planned_fit,
    precision,
)
from osl_analysis.errors import IdentifiabilityError, InputError
from osl_analysis.judge.doubts import check_told
from osl_analysis.signals import LowPass
from osl_analysis.spectral.response import DETECTION, ENOUGH_REALISATIONS, REALISATIONS
from osl_analysis.table import finite_or_null, read_table, write_table


@dataclass(frozen=True)
class DesignRequest:
    """A plan and what its intervals depend on."""

    plan: Plan
    joint: Joint
    sensors: Sensors
    low_pass: LowPass
    distortion: Distortion
    lag_s: float  # lag [s] of the torque whose effect is stated
    within: Mapping[str, float]  # half widths that are asked for, as shares of K, B, I

    def judged(self, plan: Plan) -> Precision:
        """The intervals that a plan gives; raises as `precision`."""
        return precision(plan, self.joint, self.sensors, self.low_pass, self.distortion)

    @property
    def peak_torque(self) -> float:
        """Largest torque [N*m]: of one sine at a time; of many the same multiple of the RMS as the angle."""
        sines = self.plan.sines
        torque = np.abs(self.joint.impedance(sines.w)) * sines.size
        if sines.alone.all():
            return float(torque.max()) + self.distortion.coulomb
        crest = self.plan.peak[0] / float(np.sqrt(np.sum(sines.size**2) / 2))
        return crest * float(np.sqrt(np.sum(torque**2) / 2)) + self.distortion.coulomb


@dataclass(frozen=True)
class Design:
    request: DesignRequest
    found: Precision
    recommended: tuple[Plan, Precision] | None
    """The shortest plan that reaches what is asked for; None where nothing is asked, or it is out of reach."""
    lag: Mapping[str, float]  # what the lag adds to K, B, I
    warnings: tuple[str, ...]


def designed(request: DesignRequest, config: Config) -> Design:
    """The intervals of a plan, how long to record, and what stands in the way. A rate that is too low for the filter,
    frequencies that the filter takes out, and a band that the analysis will refuse are refused."""
    rate, cutoff, sines = request.sensors.rate_hz, request.low_pass.cutoff_hz, request.plan.sines
    if not cutoff < rate / 2:
        raise InputError(
            f"--rate {rate:g} Hz is too low for the filter's cut-off of {cutoff:g} Hz; sample faster than twice the "
            "cut-off"
        )
    highest = float(sines.frequency_hz.max())
    if highest > cutoff:
        raise InputError(
            f"{highest:.4g} Hz is above the filter's cut-off of {cutoff:g} Hz; raise dynamometer.cutoff_hz or excite "
            "lower frequencies"
        )
    found = request.judged(request.plan)
    fit, Z = found.fit, request.joint.impedance(sines.w)
    if not isinstance(request.plan, SteppedSine):  # which the analysis does not judge so
        # the analysis judges samples of the filtered motion; the two rows of each sine have the same products
        n = len(sines.w)
        fitted_s = float(np.sum(sines.duration_s) if sines.alone.all() else np.max(sines.duration_s))
        share = np.sqrt(n * fit.weight * sines.duration_s / fitted_s)
        motion = np.concatenate([fit.columns.real, fit.columns.imag], axis=1) * np.tile(share, 2)
        torque = float(np.sqrt(np.sum(np.abs(Z * sines.size * share) ** 2) / (2 * n)))
        band = float(sines.frequency_hz.min()), highest
        check_told(
            "the analysis would refuse this protocol",
            band,
            motion,
            torque,
            (request.joint.K, found.rows["K"]["se"]),
            config.dynamometer.largest_inertia_error,
        )
    lag = fit.fitted(Z * np.exp(-1j * sines.w * request.lag_s)) - fit.fitted(Z)
    said, recommended = list(warnings(request, found, config)), None
    if request.within:
        best, longest = long_enough(request.plan, lambda plan: request.judged(plan).reaches(request.within))
        if best is not None:
            recommended = best, request.judged(best)
        else:
            rows = request.judged(longest).rows
            reached = []
            for name in (name for name in KBI if name in request.within):
                row, tiny = rows[name], np.finfo(float).tiny
                cause, part = max(row["variance"].items(), key=lambda one: one[1])
                percent = 100 * row["half_width"] / max(abs(row["expected"]), tiny)
                share_of = 100 * part / max(sum(row["variance"].values()), tiny)
                reached.append(f"{name} ± {percent:.2g} % (variance by {cause} {share_of:.0f} %)")
            said.append(
                f"what is asked for is beyond the longest record that is searched, {longest.record_s / 3600:.2g} h, "
                f"which gives {', '.join(reached)}; move further, widen the band, or ask for less"
            )
    return Design(request, found, recommended, dict(zip(KBI, lag.tolist(), strict=True)), tuple(said))


def warnings(request: DesignRequest, found: Precision, config: Config) -> Iterator[str]:
    """What a user must know of a plan: its band, encoder and load cell, the distortion, the limits of the bench."""
    plan, sensors, low_pass, bench = request.plan, request.sensors, request.low_pass, config.dynamometer
    I, correlation, f = request.joint.I, found.fit.correlation, plan.sines.frequency_hz
    low, high = float(f.min()), float(f.max())
    wide = I != 0 and found.rows["I"]["half_width"] > 0.5 * abs(I)
    if correlation > 0.9 or wide:  # from there on the intervals of K and I are 2.3 times as wide as alone
        tried = {}  # an octave below or above
        for words, band in {
            f"below {low:.3g} Hz, down to {low / 2:.3g} Hz": (low / 2, high),
            f"above {high:.3g} Hz, up to {2 * high:.3g} Hz": (low, 2 * high),
        }.items():
            try:
                tried[words] = planned_fit(plan.banded(*band), low_pass).correlation
            except IdentifiabilityError:
                continue
        best = min(tried, key=lambda words: tried[words], default="")
        missing = f"the band {best} (correlation {tried[best]:.2f})" if best else "a band of several octaves"
        yield (
            f"the excitation hardly tells K from I (correlation {correlation:.2f}"
            f"{', I not known to 50 %' if wide else ''}): what is missing is {missing}"
        )
    if high > 0.5 * low_pass.cutoff_hz:
        yield (
            f"{high:.3g} Hz is near the filter's cut-off of {low_pass.cutoff_hz:g} Hz, which weighs it down and "
            "lets what Eq. 15 does not describe count less there; raise cutoff_hz or lower the frequency"
        )
    smallest = min(plan.sines.size) if isinstance(plan, SteppedSine) else plan.rms * np.sqrt(2)
    if not sensors.encoder_step:
        yield "no step of the encoder is stated: the interval is without its rounding"
    elif smallest < 10 * sensors.encoder_step:
        yield f"the smallest amplitude has {smallest / sensors.encoder_step:.2g} steps of the encoder; take 10 or more"
    shares = [
        {c: v / (sum(r["variance"].values()) or 1) for c, v in r["variance"].items()} for r in found.rows.values()
    ]
    largest = {cause: max(share[cause] for share in shares) for cause in shares[0]}
    if (share := largest["encoder rounding"]) > 0.25:
        noise = isinstance(plan, Continuous) and not plan.chirp
        stays = "" if noise else "; it repeats, so that longer records do not average it out"
        yield (
            f"rounding of the encoder makes {100 * share:.0f} % of the variance{stays}; take a finer encoder"
            f"{'' if noise else ', or half a step of noise on the angle'}"
        )
    if (share := largest["load cell drift"]) > 0.25:
        yield f"the load cell's drift makes {100 * share:.0f} % of the variance; let it warm up, or record for longer"
    stated = request.distortion != Distortion()
    if not stated:
        yield (
            "no distortion is stated: these are the intervals of a joint that is exactly Eq. 15; with friction the "
            "estimates of a multisine scatter up to 50 times as much, and those of a stepped sine are shifted; state "
            "--friction, --distortion or --earlier"
        )
    if isinstance(plan, PeriodicMultisine) and plan.realisations < ENOUGH_REALISATIONS:
        level = "whose level at detection lines is all that is known of it" if found.method == DETECTION else ""
        yield (
            f"{plan.realisations} realisation{'s' if plan.realisations > 1 else ''} of a distortion {level}: take "
            f"{ENOUGH_REALISATIONS} or more, and 8 to know the level within 0.5 dB"
        )
    if isinstance(plan, Continuous) and stated:
        yield "a motion that does not repeat itself does not tell noise from distortion; a multisine does"
    angle, torque = plan.peak[0], request.peak_torque
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


def write_command(plan: Plan, rate_hz: float, output: Path) -> None:
    """Write the angle that a multisine commands: `time` [s], `theta_command` [rad]. Each realisation rises within its
    transient period, in 1 s, and falls after its last one; it is at rest for 1 s in between. The most samples that are
    written are nearly three hours at 1 kHz."""
    if not isinstance(plan, PeriodicMultisine):
        raise InputError(f"{output}: only a multisine is written; give --excitation multisine")
    samples, most = plan.record_s * rate_hz, 1e7
    if samples > most:
        raise InputError(f"{output}: {samples:.3g} samples are more than {most:g}; lower --rate, or ask for less")
    length = (plan.periods + TRANSIENTS) * plan.period_s + 1.0
    time, pause = np.arange(round(length * rate_hz)) / rate_hz, np.zeros(round(rate_hz))
    envelope = 0.5 * (1 - np.cos(np.pi * np.clip(np.minimum(time, length - time), 0, 1)))
    parts = [part for r in range(plan.realisations) for part in (plan.motion(r).angle(time) * envelope, pause)]
    angle = np.concatenate([pause, *parts])
    write_table(pl.DataFrame({"time": np.arange(len(angle)) / rate_hz, "theta_command": angle}), output)


def design_request(chosen: Mapping[str, Any], config: Config) -> DesignRequest:
    """The plan and all that its intervals depend on, in SI units, from the options by name."""
    for name, value in chosen.items():
        numbers = value if isinstance(value, list) else [value]
        if any(isinstance(one, float) and not np.isfinite(one) for one in numbers):
            raise InputError(f"--{name.replace('_', '-')} is {value}; give a finite number")
    bench, study = config.dynamometer, config.study
    expected = {"stiffness": study.K_d, "damping": study.B_d, "inertia": study.I}
    joint = [expected[name] if chosen[name] is None else chosen[name] for name in expected]
    for name, value in zip(expected, joint, strict=True):
        if value < 0 or (name == "stiffness" and value == 0):
            least = "above 0" if name == "stiffness" else "of 0 or more"
            raise InputError(f"--{name} is {value:g}; give a number {least}: the fit refuses any other")
    within = {name: chosen[f"{option}_within"] for name, option in zip(KBI, expected, strict=True)}
    within = {name: share for name, share in within.items() if share is not None}
    step = chosen["encoder_step"]
    drift = bench.load_cell_drift if chosen["drift"] is None else chosen["drift"]
    earlier = Distortion() if chosen["earlier"] is None else earlier_distortion(chosen["earlier"], chosen["trial"])
    if chosen["friction"] is not None and earlier != Distortion():  # it counts once
        raise InputError("--friction and --earlier state the same distortion twice; give one of them")
    coulomb = earlier.coulomb if chosen["friction"] is None else chosen["friction"]
    return DesignRequest(
        plan=plan_of(chosen, config, bool(within)),
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
        low_pass=bench.low_pass,
        distortion=replace(earlier, coulomb=coulomb, level=chosen["distortion"] or 0.0),
        lag_s=1e-3 * chosen["lag"],
        within=within,
    )


def plan_of(chosen: Mapping[str, Any], config: Config, longer: bool) -> Plan:
    """The protocol: the stepped sine of the configuration, with what is chosen in its place; of another motion without
    a stated band 0.5 to 6 Hz, without a stated size 2 deg rms. `longer`: more realisations may be recommended."""
    bench, kind = config.dynamometer, chosen["excitation"]
    if kind != "stepped-sine":
        band = tuple(chosen["band"] or (0.5, 6.0))
        rms = float(np.deg2rad(chosen["rms"] or 2.0))
        peak = None if chosen["peak"] is None else float(np.deg2rad(chosen["peak"]))
        if kind != "multisine":
            other = Continuous(band, rms, chosen["duration"], kind == "chirp")
            return other if peak is None else replace(other, rms=rms * peak / other.peak[0])
        plan = PeriodicMultisine(chosen["period"], band, rms, chosen["periods"], chosen["realisations"], chosen["seed"])
        if peak is None:
            return plan
        one = replace(plan, rms=1.0)  # no realisation may go beyond the peak
        return replace(
            plan, rms=peak / max(one.motion(r).peak for r in range(max(plan.realisations, MOST_DRAWN if longer else 1)))
        )
    frequencies = tuple(chosen["frequencies"] or bench.frequencies_hz)
    amplitudes = tuple(chosen["amplitudes"] or bench.amplitudes_deg)
    if not all(0 < x < np.inf for x in (*frequencies, *amplitudes)):
        raise InputError(
            "frequencies and amplitudes of a stepped sine are above 0; correct --frequencies, --amplitudes"
        )
    cycles = bench.protocol.cycles_at
    if chosen["cycles"] is not None or len(set(cycles)) == 1:
        cycles = (float(chosen["cycles"] or cycles[0]),) * len(frequencies)
    elif len(cycles) != len(frequencies):
        raise InputError("the configuration has cycles for its own frequencies; give --cycles for these")
    if min(cycles) <= bench.settle_cycles:
        raise InputError(
            f"settle_cycles = {bench.settle_cycles} leaves none of {min(cycles):g} cycles; give --cycles above it"
        )
    return SteppedSine(tuple(np.deg2rad(amplitudes).tolist()), frequencies, cycles, bench.settle_cycles)


def earlier_distortion(path: Path, trial: str | None) -> Distortion:
    """The distortion that an earlier trial showed: levels in `response.csv`; in `impedance.csv` the spread of a
    multisine's realisations, or a stepped sine's friction.

    A level is E|d|^2 of Z, times |theta|^2 twice the mean square of the torque that a line has; odd lines are as far
    apart as the closest two. The analysis leaves out parts of the period, not realisations: a design by its standard
    errors is on the safe side (of the drivetrain of `excitations` 1.3 times for K and I, 2 to 5 times for B).
    """
    table = read_table(path)
    of_levels = ("frequency_hz", "angle_deg", "odd_level")
    has_levels = set(of_levels) <= set(table.columns)
    if "trial" not in table.columns or not (has_levels or "coulomb_torque" in table.columns):
        raise InputError(f"{path}: no columns of response.csv or impedance.csv; give one of these tables")
    rows = table if trial is None else table.filter(pl.col("trial") == trial)
    names = rows["trial"].unique().to_list()
    if len(names) != 1:
        what = f"no trial '{trial}'" if trial else f"{len(names)} trials"
        such = f", such as {table['trial'][0]}" if len(table) else ""
        raise InputError(f"{path}: {what}; choose one with --trial{such}")
    if has_levels:
        known = rows.select(pl.col(of_levels).cast(pl.Float64)).drop_nulls().sort("frequency_hz")
        f, angle_deg, level = (known[name].to_numpy() for name in of_levels)
        if len(f) < 2 or not np.isfinite(level).all():
            raise InputError(f"{path}: no odd_level of trial {names[0]}; it needs a periodic motion with odd lines")
        return Distortion(earlier=(f, 0.5 * (level * np.deg2rad(angle_deg)) ** 2 / float(np.min(np.diff(f)))))
    of_spread = ["realisations", "band_low_hz", "band_high_hz", "theta_rms_deg", *(f"{name}_se" for name in KBI)]
    if set(of_spread) <= set(rows.columns):
        of_motions = rows.filter(pl.col("interval_method").is_in([REALISATIONS, BY_UNITS]))
        known = of_motions.select(pl.col(of_spread).cast(pl.Float64)).drop_nulls()
        if len(known):
            count, low, high, rms_deg, *errors = known.row(0)
            return Distortion(spread=(count * np.array(errors) ** 2, (low, high), float(np.deg2rad(rms_deg))))
    whole = rows.filter(pl.col("amplitude_deg").is_null())  # over all amplitudes, or a single row
    value = (whole if len(whole) else rows)["coulomb_torque"].cast(pl.Float64)[0]
    if value is None or not np.isfinite(value):
        raise InputError(f"{path}: coulomb_torque of trial {names[0]} is empty; state --friction")
    return Distortion(coulomb=abs(float(value)))


def design_text(made: Design) -> str:
    """All of it in lines."""
    request, plan, joint = made.request, made.request.plan, made.request.joint
    angle, velocity, acceleration = plan.peak
    sensors, low_pass = request.sensors, request.low_pass
    band = f"up to {sensors.noise_band_hz:g} Hz" if sensors.noise_band_hz else "white"
    step = f"encoder step {np.rad2deg(sensors.encoder_step):.3g} deg" if sensors.encoder_step else "encoder not rounded"
    lag = ", ".join(
        f"{name} {value:+.2g}" + (f" ({100 * value / getattr(joint, name):+.1f} %)" if getattr(joint, name) else "")
        for name, value in made.lag.items()
    )
    lines = [
        plan.words,
        f"  record {seconds(plan.record_s)}; largest angle {np.rad2deg(angle):.3g} deg, velocity {velocity:.3g} rad/s, "
        f"acceleration {acceleration:.3g} rad/s², torque about {request.peak_torque:.3g} N·m",
        f"  torque noise {sensors.torque_noise:.3g} N·m SD ({band}) at {sensors.rate_hz:g} Hz, {step}, load cell drift "
        f"{60 * sensors.drift:.3g} N·m/min; filter {low_pass.cutoff_hz:g} Hz, order {low_pass.order}",
        "",
        *interval_lines(made.found),
        "",
        f"not in the interval: torque later than the angle by {1e3 * request.lag_s:g} ms adds {lag}",
    ]
    if added := request.distortion.added_damping(plan):
        values = ", ".join(f"{value:.3g} ({name})" for name, value in added.items())
        friction = request.distortion.coulomb
        lines.append(f"not in the interval: Coulomb friction of {friction:g} N·m adds to B {values} N·m·s/rad")
    if request.within:
        asked = ", ".join(f"{name} ± {100 * share:g} %" for name, share in request.within.items())
        lines += ["", f"for {asked}:"]
        if made.recommended is None:
            lines.append("  beyond the longest record that is searched")
        else:
            best, found = made.recommended
            lines += [f"  {best.words}", f"  record {seconds(best.record_s)}"]
            lines += ["  " + line for line in interval_lines(found)]
    return "\n".join([*lines, *(f"warning: {said}" for said in made.warnings)])


def seconds(value: float) -> str:
    """A time in seconds, and in minutes where it is long."""
    return f"{value:.4g} s" + (f" ({value / 60:.1f} min)" if value >= 120 else "")


def interval_lines(found: Precision) -> Iterator[str]:
    """A line per parameter, with what the variance is made of, and a line on the interval."""
    yield f"{'':4}{'expected':>10}{'95 % interval ±':>18}{'in %':>10}{'by noise alone ±':>18}   variance by"
    units = ("N·m/rad", "N·m·s/rad", "kg·m²")
    for (name, row), unit in zip(found.rows.items(), units, strict=True):
        value, total = row["expected"], row["se"] ** 2
        percent = f"{100 * row['half_width'] / abs(value):.3g}" if value else "-"
        shares = {cause: 100 * part / total for cause, part in row["variance"].items() if total > 0}
        made_of = ", ".join(f"{cause} {share:.0f} %" for cause, share in shares.items() if share >= 0.5)
        yield (
            f"{name:4}{value:>10.4g}{row['half_width']:>18.3g}{percent:>10}{row['half_width_of_noise']:>18.3g}"
            f"   {made_of} [{unit}]"
        )
    freedom = ", ".join("∞" if np.isinf(d) else f"{d:.0f}" for d in found.column("degrees_of_freedom"))
    table = "impedance.csv" if found.method in (BY_UNITS, BY_REPEATS) else "response_models.csv"
    yield (
        f"interval from {found.method}, as {table} will name it, {freedom} degrees of freedom; correlation of K and I "
        f"{found.fit.correlation:.2f}, condition number {found.fit.condition_number:.3g}"
    )


def design_json(made: Design) -> str:
    """All of it as JSON, in SI units; null for numbers that are infinite or undefined."""
    request = made.request

    def content(plan: Plan, found: Precision) -> dict[str, Any]:
        return {
            "protocol": plan.words,
            "record_s": plan.record_s,
            "peak_angle": plan.peak[0],
            "estimates": dict(found.rows),
            "interval_method": found.method,
            "correlation_K_I": found.fit.correlation,
            "condition_number": found.fit.condition_number,
        }

    def nested(part: Mapping[str, Any]) -> dict[str, Any]:
        return finite_or_null({name: nested(one) if isinstance(one, dict) else one for name, one in part.items()})

    whole = content(request.plan, made.found) | {
        "friction_damping": request.distortion.added_damping(request.plan),
        "lag_s": request.lag_s,
        "lag_errors": dict(made.lag),
        "asked_within": dict(request.within),
        "recommended": None if made.recommended is None else content(*made.recommended),
        "warnings": list(made.warnings),
    }
    return json.dumps(nested(whole), indent=2, ensure_ascii=False)
