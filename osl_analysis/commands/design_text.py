"""The intervals that a plan will give, as text and as JSON."""

import json
from collections.abc import Iterator
from typing import Any

import numpy as np

from osl_analysis.bench.group_interval import BY_REPEATS, BY_UNITS
from osl_analysis.bench.planned_errors import KBI
from osl_analysis.bench.precision import Precision
from osl_analysis.commands.design import TINY, Design, Planned
from osl_analysis.table import finite_or_null

MINUTES_FROM_S = 120  # longer records are told in minutes too
SHOWN_SHARE_PERCENT = 0.5  # of a variance: smaller causes are not listed
UNITS = {"K": "N·m/rad", "B": "N·m·s/rad", "I": "kg·m²"}


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
