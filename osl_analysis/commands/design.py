"""Experiment design for the command line: the plan that options ask for, and what it will tell on K, B and I."""

import json
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl

from osl_analysis.bench.excitation_limits import check_told, told_by
from osl_analysis.commands.earlier_trial import earlier_distortion
from osl_analysis.config import Config
from osl_analysis.design.advice import lag_errors, long_enough, longest, reached, warnings
from osl_analysis.design.plan import SHOWN, TRANSIENTS, Continuous, PeriodicMultisine, Plan, SteppedSine
from osl_analysis.design.precision import NAMES, Distortion, Joint, Precision, Sensors, Weighted, precision, weighted
from osl_analysis.errors import InputError
from osl_analysis.signals import LowPass
from osl_analysis.table import finite_or_null, write_table
from osl_analysis.trial import Array

RAMP_S = 1.0  # Time [s] in which a command rises at the start of a realisation and falls at its end
MOST_SAMPLES = 1e7  # Largest number of samples that are written: nearly three hours at 1 kHz
PAUSE_S = 1.0  # Rest [s] between two realisations


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

    def suffices(self, plan: Plan) -> bool:
        """Whether a plan reaches what is asked for."""
        return reached(self.judged(plan), self.joint, self.within)


@dataclass(frozen=True)
class Design:
    """What is said about a request."""

    request: DesignRequest
    found: Precision
    recommended: Plan | None
    """The shortest plan that reaches what is asked for; None where nothing is asked, or it is out of reach."""
    recommended_found: Precision | None
    lag: Mapping[str, float]  # What the lag adds to K, B, I
    warnings: tuple[str, ...]


def designed(request: DesignRequest, config: Config) -> Design:
    """The intervals of a plan, how long to record, and what stands in the way."""
    check_band(request)
    found, fit = request.judged(request.plan), weighted(request.plan, request.low_pass)
    check_analysed(request, fit, float(found.se[0]), config.dynamometer.largest_inertia_error)
    best = long_enough(request.plan, request.suffices) if request.within else None
    said = [*warnings(request.plan, found, request.joint, request.sensors, request.low_pass, request.distortion)]
    said += range_warnings(request, config)
    if request.within and best is None:
        said.append(out_of_reach(request))
    lag = lag_errors(fit, request.joint, request.lag_s)
    return Design(request, found, best, None if best is None else request.judged(best), lag, tuple(said))


def check_band(request: DesignRequest) -> None:
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


def check_analysed(request: DesignRequest, fit: Weighted, K_se: float, largest_inertia_error: float | None) -> None:
    """Refuse a motion that the analysis will refuse, because its band cannot tell K from I. The analysis judges samples
    of the filtered motion. Two rows per sine, in phase and in quadrature with the angle, have the same products. A
    stepped sine is analysed in another way, and not judged so."""
    if isinstance(request.plan, SteppedSine):
        return
    sines, n = fit.sines, len(fit.sines.w)
    fitted_s = float(np.sum(sines.duration_s) if sines.alone.all() else np.max(sines.duration_s))
    size = sines.size * np.sqrt(n * fit.weight * sines.duration_s / fitted_s)
    w, still = sines.w, np.zeros(n)
    theta, omega, alpha = (np.concatenate(pair) for pair in ((size, still), (still, w * size), (-(w**2) * size, still)))
    torque = float(np.sqrt(np.sum(np.abs(request.joint.impedance(w) * size) ** 2) / (2 * n)))
    band = float(sines.frequency_hz.min()), float(sines.frequency_hz.max())
    change = told_by(theta, omega, alpha, torque)
    check_told("the analysis would refuse this protocol", band, change, (request.joint.K, K_se), largest_inertia_error)


def range_warnings(request: DesignRequest, config: Config) -> list[str]:
    """Warnings on angles and torques that the configuration does not allow."""
    said, bench = [], config.dynamometer
    if request.plan.peak[0] > bench.largest_angle:
        said.append(
            f"the largest angle of {request.plan.peak[0]:.3g} rad is above dynamometer.largest_angle = "
            f"{bench.largest_angle:g} rad: the recording would be refused"
        )
    if bench.load_cell_range is not None and peak_torque(request) > bench.load_cell_range:
        said.append(
            f"the torque of about {peak_torque(request):.3g} N·m is above dynamometer.load_cell_range = "
            f"{bench.load_cell_range:g} N·m: the recording would be refused"
        )
    return said


def out_of_reach(request: DesignRequest) -> str:
    """How far the longest plan that is tried comes, and the largest part of each variance there."""
    plan = longest(request.plan)
    found = request.judged(plan)
    causes, parts = list(found.causes), np.array(list(found.causes.values()))
    largest = np.argmax(parts, axis=0)
    shares = 100 * np.max(parts, axis=0) / np.maximum(parts.sum(axis=0), np.finfo(float).tiny)
    values = np.maximum(np.abs(request.joint.values), np.finfo(float).tiny)
    reaches = (
        f"{name} ± {100 * found.half_width[k] / values[k]:.2g} % (variance by {causes[largest[k]]} {shares[k]:.0f} %)"
        for k, name in enumerate(NAMES)
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
    """Times [s] and angles [rad] of all realisations, shape (n,) each. Each rises within its transient period and falls
    after its last one; it is at rest in between."""
    length = (plan.periods + TRANSIENTS) * plan.period_s + RAMP_S
    n, pause = round(length * rate_hz), np.zeros(round(PAUSE_S * rate_hz))
    time = np.arange(n) / rate_hz
    rising = np.clip(np.minimum(time, length - time) / RAMP_S, 0, 1)
    envelope = 0.5 * (1 - np.cos(np.pi * rising))
    parts = [part for r in range(plan.realisations) for part in (plan.motion(r).angle(time) * envelope, pause)]
    angle = np.concatenate([pause, *parts])
    return np.arange(len(angle)) / rate_hz, angle


def write_command(plan: Plan, rate_hz: float, output: Path) -> None:
    """Write the angle that a multisine commands: `time` [s], `theta_command` [rad]."""
    if not isinstance(plan, PeriodicMultisine):
        raise InputError(f"{output}: only a multisine is written; give --excitation multisine")
    samples = plan.record_s * rate_hz
    if samples > MOST_SAMPLES:
        raise InputError(
            f"{output}: {samples:.3g} samples are more than {MOST_SAMPLES:g}; lower --rate, or ask for less"
        )
    time, angle = command_of(plan, rate_hz)
    write_table(pl.DataFrame({"time": time, "theta_command": angle}), output)


BAND_HZ, RMS_DEG = (0.5, 6.0), 2.0
"""Band [Hz] and root mean square of the angle [deg] where none is given."""


def design_request(chosen: Mapping[str, Any], config: Config) -> DesignRequest:
    """The plan and all that its intervals depend on, in SI units, from the options by name."""
    check_numbers(chosen)
    low_pass, study = config.dynamometer.low_pass, config.study
    expected = {"stiffness": study.K_d, "damping": study.B_d, "inertia": study.I}
    joint = [expected[name] if chosen[name] is None else chosen[name] for name in expected]
    within = {name[0]: chosen[f"{option}_within"] for name, option in zip("KBI", expected, strict=True)}
    return DesignRequest(
        plan=plan_of(chosen, config),
        joint=Joint(*joint),
        sensors=sensors_of(chosen, config),
        low_pass=low_pass,
        distortion=distortion_of(chosen),
        lag_s=1e-3 * chosen["lag"],
        within={name: share for name, share in within.items() if share is not None},
    )


def check_numbers(chosen: Mapping[str, Any]) -> None:
    """Refuse options that are no finite numbers."""
    for name, value in chosen.items():
        numbers = value if isinstance(value, list) else [value]
        if any(isinstance(one, float) and not np.isfinite(one) for one in numbers):
            raise InputError(f"--{name.replace('_', '-')} is {value}; give a finite number")


def plan_of(chosen: Mapping[str, Any], config: Config) -> Plan:
    """The protocol."""
    if chosen["excitation"] == "stepped-sine":
        return stepped_sine_of(chosen, config)
    band = tuple(chosen["band"]) if chosen["band"] else BAND_HZ
    rms = float(np.deg2rad(chosen["rms"] or RMS_DEG))
    peak = None if chosen["peak"] is None else float(np.deg2rad(chosen["peak"]))
    if chosen["excitation"] == "multisine":
        numbers = {name: chosen[name] for name in ("periods", "realisations", "seed")}
        plan = PeriodicMultisine(chosen["period"], band, rms, **numbers)
        longer = any(chosen[f"{name}_within"] is not None for name in ("stiffness", "damping", "inertia"))
        return plan if peak is None else plan.of_peak(peak, max(plan.realisations, SHOWN if longer else 1))
    other = Continuous(band, rms, chosen["duration"], chosen["excitation"] == "chirp")
    return other if peak is None else replace(other, rms=rms * peak / other.peak[0])


def stepped_sine_of(chosen: Mapping[str, Any], config: Config) -> SteppedSine:
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


def sensors_of(chosen: Mapping[str, Any], config: Config) -> Sensors:
    """The sensors."""
    step = chosen["encoder_step"]
    drift = config.dynamometer.load_cell_drift if chosen["drift"] is None else chosen["drift"]
    return Sensors(
        rate_hz=chosen["rate"],
        torque_noise=chosen["torque_noise"],
        noise_band_hz=chosen["noise_band"],
        torque_step=chosen["torque_step"],
        encoder_step=2 * np.pi / 2 ** chosen["encoder_bits"] if step is None else float(np.deg2rad(step)),
        angle_noise=float(np.deg2rad(chosen["angle_noise"])),
        drift=drift / 60,
    )


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


UNITS = {"K": "N·m/rad", "B": "N·m·s/rad", "I": "kg·m²"}


def design_text(made: Design) -> str:
    """All of it in lines."""
    request, plan = made.request, made.request.plan
    angle, velocity, acceleration = plan.peak
    lines = [
        plan.words,
        f"  record {seconds(plan.record_s)}; largest angle {np.rad2deg(angle):.3g} deg, velocity {velocity:.3g} rad/s, "
        f"acceleration {acceleration:.3g} rad/s², torque about {peak_torque(request):.3g} N·m",
        sensors_text(request),
        "",
        *interval_lines(request, made.found),
        "",
        *effects(made),
    ]
    if request.within:
        asked = ", ".join(f"{name} ± {100 * share:g} %" for name, share in request.within.items())
        lines += ["", f"for {asked}:"]
        if made.recommended is None or made.recommended_found is None:
            lines.append("  beyond the longest record that is searched")
        else:
            lines += [f"  {made.recommended.words}", f"  record {seconds(made.recommended.record_s)}"]
            lines += ["  " + line for line in interval_lines(request, made.recommended_found)]
    return "\n".join([*lines, *(f"warning: {said}" for said in made.warnings)])


def seconds(value: float) -> str:
    """A time in seconds, and in minutes where it is long."""
    return f"{value:.4g} s" + (f" ({value / 60:.1f} min)" if value >= 120 else "")


def sensors_text(request: DesignRequest) -> str:
    """Sensors and filter in a line."""
    sensors, low_pass = request.sensors, request.low_pass
    band = f"up to {sensors.noise_band_hz:g} Hz" if sensors.noise_band_hz else "white"
    step = f"encoder step {np.rad2deg(sensors.encoder_step):.3g} deg" if sensors.encoder_step else "encoder not rounded"
    return (
        f"  torque noise {sensors.torque_noise:.3g} N·m SD ({band}) at {sensors.rate_hz:g} Hz, {step}, load cell drift "
        f"{60 * sensors.drift:.3g} N·m/min; filter {low_pass.cutoff_hz:g} Hz, order {low_pass.order}"
    )


def interval_lines(request: DesignRequest, found: Precision) -> Iterator[str]:
    """A line per parameter, with what the variance is made of, and a line on the interval."""
    total = found.se**2
    yield f"{'':4}{'expected':>10}{'95 % interval ±':>18}{'in %':>10}{'by noise alone ±':>18}   variance by"
    for k, name in enumerate(NAMES):
        value = float(request.joint.values[k])
        percent = f"{100 * found.half_width[k] / abs(value):.3g}" if value else "-"
        shares = {cause: 100 * v[k] / total[k] for cause, v in found.causes.items() if total[k] > 0}
        made_of = ", ".join(f"{cause} {share:.0f} %" for cause, share in shares.items() if share >= 0.5)
        yield (
            f"{name:4}{value:>10.4g}{found.half_width[k]:>18.3g}{percent:>10}{found.noise_half_width[k]:>18.3g}"
            f"   {made_of} [{UNITS[name]}]"
        )
    freedom = ", ".join("∞" if np.isinf(d) else f"{d:.0f}" for d in found.degrees_of_freedom)
    yield (
        f"interval from {found.method}, {freedom} degrees of freedom; correlation of K and I {found.correlation:.2f}, "
        f"condition number {found.condition_number:.3g}"
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
    """All of it as JSON, in SI units."""
    request, recommended = made.request, made.recommended
    content: dict[str, Any] = {
        **described(request, request.plan, made.found),
        "friction_damping": request.distortion.added_damping(request.plan),
        "lag_s": request.lag_s,
        "lag_errors": dict(made.lag),
        "asked_within": dict(request.within),
        "recommended": None,
        "warnings": list(made.warnings),
    }
    if recommended is not None and made.recommended_found is not None:
        content["recommended"] = described(request, recommended, made.recommended_found)
    return json.dumps(nested(content), indent=2, ensure_ascii=False)


def nested(content: Mapping[str, Any]) -> dict[str, Any]:
    """The mapping with null for numbers that are infinite or undefined, at every depth."""
    made = {name: nested(value) if isinstance(value, dict) else value for name, value in content.items()}
    return finite_or_null(made)


def described(request: DesignRequest, plan: Plan, found: Precision) -> dict[str, Any]:
    """A plan and its intervals, for JSON."""
    estimates = {
        name: {
            "expected": float(request.joint.values[k]),
            "half_width": float(found.half_width[k]),
            "half_width_of_noise": float(found.noise_half_width[k]),
            "se": float(found.se[k]),
            "degrees_of_freedom": float(found.degrees_of_freedom[k]),
            "variance": {cause: float(values[k]) for cause, values in found.causes.items()},
        }
        for k, name in enumerate(NAMES)
    }
    return {
        "protocol": plan.words,
        "record_s": plan.record_s,
        "peak_angle": plan.peak[0],
        "estimates": estimates,
        "interval_method": found.method,
        "correlation_K_I": found.correlation,
        "condition_number": found.condition_number,
    }
