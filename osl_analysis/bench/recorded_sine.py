"""A stepped-sine trial made of what was recorded: on one time base, with its protocol, without drift, and filtered."""

from collections.abc import Callable
from dataclasses import replace

from osl_analysis.bench.alternatives import joint_angle
from osl_analysis.bench.load_cell_drift import drift_rate, without_angle, without_drift
from osl_analysis.bench.protocol import find_blocks
from osl_analysis.bench.recorded import Recorded, recorded, resolution_of
from osl_analysis.bench.segments import settled
from osl_analysis.bench.settings import SteppedSineAnalysis
from osl_analysis.bench.stepped_sine import SteppedSineTrial
from osl_analysis.errors import InputError, OslAnalysisError
from osl_analysis.signals import filtered_motion
from osl_analysis.trial import Trial

Ask = Callable[[SteppedSineTrial], object]
"""Makes the fits of a trial that are needed of it."""


def stepped_sine_trial(
    trial: Trial, settings: SteppedSineAnalysis, known: Recorded | None = None, ask: Ask | None = None
) -> SteppedSineTrial:
    """Bring a canonical trial on one time base, find its protocol, subtract the load cell's drift, and filter.

    `known` is what `recorded` gives, where it was called already. `ask` makes all fits that are needed of the trial
    with undecided stamps taken the other way: then it is made first, and keeps its fits alone.

    Raises
    ------
    InputError
        A signal is missing, has no time base, or does not follow the protocol; the message names the trial.
    """
    known = known or recorded(trial, settings)
    asked = None if ask is None else asked_otherwise(known, settings, ask)
    made, bench = stepped_sine_alone(trial, settings, known), settings.bench_stiffness
    try:
        return replace(
            made,
            other=asked or stepped_sine_otherwise(known, settings),
            softer=None if bench is None else stepped_sine_of(known, settings, bench.compliance_error),
        )
    except InputError as error:
        raise InputError(f"trial {trial.name}: {error}") from error


def stepped_sine_otherwise(known: Recorded, settings: SteppedSineAnalysis) -> SteppedSineTrial | None:
    """The trial if undecided stamps were taken the other way; None where all are decided. Raises as
    `stepped_sine_of`."""
    again = known.other()
    return None if again is None else stepped_sine_of(again, settings)


def asked_otherwise(known: Recorded, settings: SteppedSineAnalysis, ask: Ask) -> SteppedSineTrial | None:
    """The same with the fits that `ask` makes, and without its samples.

    None too where it, or a fit, is refused: the trial itself then is, which says why, or its fits say it once more.
    """
    try:
        other = stepped_sine_otherwise(known, settings)
        if other is None:
            return None
        other = replace(other, uniform=None)
        ask(other)
        return other.with_fits_alone()
    except OslAnalysisError:
        return None


def stepped_sine_alone(trial: Trial, settings: SteppedSineAnalysis, known: Recorded | None = None) -> SteppedSineTrial:
    """As `stepped_sine_trial`, without `other` and `softer`, which cost as much again."""
    known = known or recorded(trial, settings)
    steps = resolution_of(trial, "theta", known), resolution_of(trial, "torque", known)
    try:
        return replace(stepped_sine_of(known, settings), steps=steps)
    except InputError as error:
        raise InputError(f"trial {trial.name}: {error}") from error


def stepped_sine_of(known: Recorded, settings: SteppedSineAnalysis, more_compliance: float = 0.0) -> SteppedSineTrial:
    """The trial behind uniform signals; raises as `stepped_sine_trial`, without the trial's name.

    The bench is softer than its settings by `more_compliance` [rad/(N*m)].
    """
    signals, bench = known.signals, settings.bench_stiffness
    time, measured, usable = signals.time, signals["torque"], signals.usable
    blocks = find_blocks(time, signals["theta"], settings.protocol, known.motion.runs)
    drift = drift_rate(time, without_angle(signals["theta"], measured), settled(blocks, settings.settle_cycles, usable))
    torque = without_drift(time, measured, drift)
    theta = joint_angle(signals["theta"], torque, (bench.compliance if bench else 0.0) + more_compliance)
    motion, filtered = filtered_motion(time, theta, torque, settings.low_pass)
    return SteppedSineTrial(
        name=signals.trial,
        time=time,
        rate_hz=signals.rate_hz,
        theta=theta,
        torque=torque,
        motion=motion,
        filtered_torque=filtered,
        blocks=blocks,
        command=None,
        settle_cycles=settings.settle_cycles,
        low_pass=settings.low_pass,
        drift=drift,
        usable=usable,
        uniform=signals,
        bench=bench,
        largest_drift_ppm=settings.time_base.largest_drift_ppm,
    )
