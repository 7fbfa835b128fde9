"""Diagnostics of a stepped-sine fit that need more than the fit: phasors, and the amplitudes it did not see."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from osl_analysis.bench.diagnostics import held_out_vaf, nonlinearity, torque_lag
from osl_analysis.bench.protocol import Segment
from osl_analysis.commands.stepped_sine import SteppedSineTrial
from osl_analysis.errors import InputError, OslAnalysisError
from osl_analysis.signals import Motion
from osl_analysis.stats.regression import LinearFit
from osl_analysis.stats.rows import Row, delay_row
from osl_analysis.stats.sinusoid import Phasor, fit_sinusoid
from osl_analysis.trial import Array

Admittance = Callable[[NDArray[np.complex128]], NDArray[np.complex128]]


@dataclass(frozen=True)
class SegmentPhasors:
    """Phasors of raw angle [rad] and torque [N*m] at one commanded amplitude [deg] and frequency [Hz]."""

    amplitude_deg: float
    frequency_hz: float
    theta: Phasor
    torque: Phasor


def trial_phasors(record: SteppedSineTrial) -> list[SegmentPhasors]:
    """Phasors of the settled cycles of every segment of a trial.

    The last cycle is not among them: where the angle lags the command by more at one frequency than at another, it
    holds the beginning of what comes next.

    Raises
    ------
    InputError
        As `segment_phasors`, naming the trial.
    """
    try:
        return [segment_phasors(record.time, record.theta, record.torque, s) for s in record.segments(None)]
    except InputError as error:
        raise InputError(f"trial {record.name}, {error}") from error


def segment_phasors(time: Array, theta: Array, torque: Array, segment: Segment) -> SegmentPhasors:
    """Phasors of one segment of the raw signals (n,) [s, rad, N*m].

    Raises
    ------
    InputError
        As `fit_sinusoid`, naming the signal.
    """
    rows, phasors = segment.rows, []
    for name, signal in (("theta", theta), ("torque", torque)):
        try:
            phasors.append(fit_sinusoid(time[rows], signal[rows], segment.frequency_hz))
        except InputError as error:
            raise InputError(f"{name} from {time[segment.start]:.1f} s: {error}") from error
    return SegmentPhasors(segment.amplitude_deg, segment.frequency_hz, *phasors)


def of_amplitude(phasors: Sequence[SegmentPhasors], amplitude: float | None) -> list[SegmentPhasors]:
    """The segments of one amplitude [deg], or all (None)."""
    return [s for s in phasors if amplitude is None or np.isclose(s.amplitude_deg, amplitude)]


def lag_row(phasors: Sequence[SegmentPhasors], K: float, expected: Admittance | None) -> Row:
    """`delay_row` of the torque's lag beyond the linear model's; null where no model tells.

    `expected` is the model's admittance theta/torque for s [rad/s], None where the gains are not known.
    """
    if expected is None:
        return delay_row(None, None, K)
    frequency = np.array([s.frequency_hz for s in phasors])
    measured = np.array([s.torque.value / s.theta.value for s in phasors])
    try:
        amplitude = np.array([abs(s.theta.value) for s in phasors])
        lag = torque_lag(frequency, amplitude, measured, 1 / expected(2j * np.pi * frequency))
    except OslAnalysisError:
        return delay_row(None, None, K)
    return delay_row(lag.lag, lag.se, K)


def nonlinear_row(phasors: Sequence[SegmentPhasors]) -> Row:
    """Shares of the torque's harmonics, and the Coulomb friction that the third one would be."""
    found = nonlinearity(
        np.array([s.frequency_hz for s in phasors]),
        np.array([abs(s.theta.value) for s in phasors]),
        np.array([s.torque.amplitudes for s in phasors]),
    )
    return {
        "even_harmonics": found.even,
        "odd_harmonics": found.odd,
        "coulomb_torque": found.coulomb,
        "coulomb_damping": found.coulomb_damping,
    }


def lowest_held_out(
    record: SteppedSineTrial, amplitude: float | None, fit: LinearFit, columns: Callable[[Motion], Mapping[str, Array]]
) -> float | None:
    """Lowest VAF [percent] of the fit at the amplitudes that it did not see; null for a fit to all, or to the only."""
    others = [part for part in record.parts() if part[0] is not None and part[0] != amplitude]
    if amplitude is None or not others:
        return None
    return min(held_out_vaf(fit, columns(motion), torque) for _, motion, torque in others)
