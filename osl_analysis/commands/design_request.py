"""What was asked of `osl-analysis design` on the command line, with the configuration for what was not."""

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from osl_analysis.commands.design import DesignRequest
from osl_analysis.commands.earlier_trial import earlier_distortion
from osl_analysis.config import Config
from osl_analysis.design.distortion import Distortion
from osl_analysis.design.information import Joint
from osl_analysis.design.plan import SHOWN, Continuous, PeriodicMultisine, Plan, SteppedSine
from osl_analysis.design.sensors import Sensors
from osl_analysis.errors import InputError

BAND_HZ, RMS_DEG = (0.5, 6.0), 2.0
"""Band [Hz] and root mean square of the angle [deg] where none is given."""


def design_request(chosen: Mapping[str, Any], config: Config) -> DesignRequest:
    """The plan and all that its intervals depend on, in SI units, from the options by name.

    Raises
    ------
    InputError
        A protocol, a table or a number cannot be used.
    """
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
