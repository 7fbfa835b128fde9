"""Experiment design for the command line: what a protocol will tell on K, B and I, and the command of a multisine."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import polars as pl

from osl_analysis.bench.excitation_limits import check_told, told_by
from osl_analysis.config import Config
from osl_analysis.design.distortion import Distortion
from osl_analysis.design.duration import long_enough, longest, reached
from osl_analysis.design.information import NAMES, Joint, Weighted, weighted
from osl_analysis.design.limits import lag_errors, warnings
from osl_analysis.design.plan import TRANSIENTS, PeriodicMultisine, Plan, SteppedSine
from osl_analysis.design.precision import Precision, precision
from osl_analysis.design.sensors import Sensors
from osl_analysis.errors import InputError
from osl_analysis.signals import LowPass
from osl_analysis.table import write_table
from osl_analysis.trial import Array

RAMP_S = 1.0
"""Time [s] in which a command rises at the start of a realisation and falls at its end."""
MOST_SAMPLES = 1e7
"""Largest number of samples that are written: nearly three hours at 1 kHz."""
PAUSE_S = 1.0
"""Rest [s] between two realisations."""


@dataclass(frozen=True)
class DesignRequest:
    """A plan and what its intervals depend on."""

    plan: Plan
    joint: Joint
    sensors: Sensors
    low_pass: LowPass
    distortion: Distortion
    lag_s: float
    """Lag [s] of the torque whose effect is stated."""
    within: Mapping[str, float]
    """Half widths that are asked for, as shares of K, B, I."""

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
    lag: Mapping[str, float]
    """What the lag adds to K, B, I."""
    warnings: tuple[str, ...]


def designed(request: DesignRequest, config: Config) -> Design:
    """The intervals of a plan, how long to record, and what stands in the way.

    Raises
    ------
    IdentifiabilityError, InputError
        As `precision`, `check_band` and `check_analysed`.
    """
    low_pass = request.low_pass
    check_band(request)
    found, fit = request.judged(request.plan), weighted(request.plan, low_pass)
    check_analysed(request, fit, float(found.se[0]), config.dynamometer.largest_inertia_error)
    best = None
    if request.within:
        best = long_enough(request.plan, request.suffices)
    said = (*warnings(request.plan, found, request.joint, request.sensors, low_pass, request.distortion),)
    lag = lag_errors(fit, request.joint, request.lag_s)
    said += (*range_warnings(request, config),)
    if request.within and best is None:
        said += (out_of_reach(request),)
    return Design(request, found, best, None if best is None else request.judged(best), lag, said)


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
    """Refuse a motion that the analysis will refuse, because its band cannot tell K from I.

    The analysis judges samples of the filtered motion. Two rows per sine, in phase and in quadrature with the angle,
    have the same products. A stepped sine is analysed in another way, and not judged so.

    Raises
    ------
    IdentifiabilityError
        As `bench.excitation_limits.check_told`.
    """
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
    """Times [s] and angles [rad] of all realisations, shape (n,) each.

    Each rises within its transient period and falls after its last one; it is at rest in between.
    """
    length = (plan.periods + TRANSIENTS) * plan.period_s + RAMP_S
    n, pause = round(length * rate_hz), np.zeros(round(PAUSE_S * rate_hz))
    time = np.arange(n) / rate_hz
    rising = np.clip(np.minimum(time, length - time) / RAMP_S, 0, 1)
    envelope = 0.5 * (1 - np.cos(np.pi * rising))
    parts = [part for r in range(plan.realisations) for part in (plan.motion(r).angle(time) * envelope, pause)]
    angle = np.concatenate([pause, *parts])
    return np.arange(len(angle)) / rate_hz, angle


def write_command(plan: Plan, rate_hz: float, output: Path) -> None:
    """Write the angle that a multisine commands: `time` [s], `theta_command` [rad].

    Raises
    ------
    InputError
        The plan is no multisine, or too long.
    """
    if not isinstance(plan, PeriodicMultisine):
        raise InputError(f"{output}: only a multisine is written; give --excitation multisine")
    samples = plan.record_s * rate_hz
    if samples > MOST_SAMPLES:
        raise InputError(
            f"{output}: {samples:.3g} samples are more than {MOST_SAMPLES:g}; lower --rate, or ask for less"
        )
    time, angle = command_of(plan, rate_hz)
    write_table(pl.DataFrame({"time": time, "theta_command": angle}), output)
