"""What `osl-analysis design` prints: the intervals to expect, how long to record, and warnings, as text or JSON."""

import json
from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np

from osl_analysis.commands.design import Design, DesignRequest, peak_torque
from osl_analysis.design.information import NAMES
from osl_analysis.design.plan import Plan
from osl_analysis.design.precision import Precision
from osl_analysis.table import finite_or_null

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
