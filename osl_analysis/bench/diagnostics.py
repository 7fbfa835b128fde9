"""What makes a bench fit doubtful: a late torque, friction, amplitudes that it does not predict, a wrong sign."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import polars as pl
from numpy.typing import NDArray

from osl_analysis.bench.frequency_response import Admittance, SegmentPhasors
from osl_analysis.bench.stepped_sine import SteppedSineTrial
from osl_analysis.doubtful import doubtful_row
from osl_analysis.errors import InputError, OslAnalysisError
from osl_analysis.signals import Motion
from osl_analysis.stats.comparison import held_out_vaf
from osl_analysis.stats.covariance import ResidualCorrelation
from osl_analysis.stats.fit_row import Row, lag_damping_row
from osl_analysis.stats.regression import LinearFit, linear_fit
from osl_analysis.stats.repeats import summary_table
from osl_analysis.trial import Array

Phasors = NDArray[np.complex128]


@dataclass(frozen=True)
class TorqueLag:
    """By how much the torque lags the angle."""

    lag: float
    """Lag [s]; positive if the torque is late."""
    se: float
    """Its standard error [s]."""


def torque_lag(frequency_hz: Array, theta: Array, impedance: Phasors, expected: Phasors) -> TorqueLag:
    """Lag of the torque, from complex impedances torque/theta (n,) at amplitudes theta (n,) [rad] and frequencies [Hz].

    `expected` (n,) are the impedances of the linear model with the same gains. Without them a lag d is the same as a
    damping of -K d. The phase differs from the model's by -w d for the lag and, for Coulomb friction T_C, by
    4 T_C/(pi theta) Re(1/expected) (its describing function).

    Raises
    ------
    InputError, IdentifiabilityError
        Two points or fewer, or points that are too similar to distinguish lag from friction.
    """
    w = 2 * np.pi * np.asarray(frequency_hz, dtype=float)
    beyond = np.asarray(np.angle(impedance / expected))
    columns = {"lag": -w, "T_C": 4 / (np.pi * theta) * (1 / expected).real}
    fit = linear_fit(beyond, columns, ResidualCorrelation(lags=1))
    return TorqueLag(fit["lag"], fit.se("lag"))


def torque_lag_row(phasors: Sequence[SegmentPhasors], K: float, expected: Admittance | None) -> Row:
    """`lag_damping_row` of the torque's lag relative to the linear model; null if the lag cannot be estimated.

    `expected` is the model's admittance, None where the gains are not known. `K` [N*m/rad] is the estimated stiffness.
    """
    if expected is None:
        return lag_damping_row(None, None, K)
    frequency = np.array([s.frequency_hz for s in phasors])
    measured = np.array([s.torque.value / s.theta.value for s in phasors])
    try:
        amplitude = np.array([abs(s.theta.value) for s in phasors])
        late = torque_lag(frequency, amplitude, measured, 1 / expected(2j * np.pi * frequency))
    except OslAnalysisError:
        return lag_damping_row(None, None, K)
    return lag_damping_row(late.lag, late.se, K)


@dataclass(frozen=True)
class Nonlinearity:
    """Harmonics of the torque under a sine of the angle, and the Coulomb friction that they indicate."""

    even: float
    """Amplitude of harmonics 2 and 4, as a share of the fundamental: asymmetry, play."""
    odd: float
    """Amplitude of harmonics 3 and 5, as a share of the fundamental: friction."""
    coulomb: float
    """Coulomb friction [N*m] that makes the third harmonic."""
    coulomb_damping: float
    """Damping [N*m*s/rad] that this friction adds to B."""


def nonlinearity(frequency_hz: Array, theta: Array, torque: Array) -> Nonlinearity:
    """From amplitudes at n frequencies: of the angle (n,) [rad], and of the torque's harmonics 1 to 5 (n, 5) [N*m].

    Coulomb friction T_C sign(omega) has the harmonics 4 T_C/(k pi), k odd. At one frequency its fundamental is a
    damping of 4 T_C/(pi w |theta|). A fit to all frequencies weights these by duration times velocity squared, with
    equally many cycles at each.
    """
    w = 2 * np.pi * np.asarray(frequency_hz, dtype=float)
    size = np.sqrt(np.sum(torque**2, axis=0))
    coulomb = 0.75 * np.pi * float(np.mean(torque[:, 2]))
    damping = 4 * coulomb / np.pi * float(np.sum(theta) / np.sum(w * theta**2))
    even, odd = (float(np.hypot(*size[harmonics]) / size[0]) for harmonics in ([1, 3], [2, 4]))
    return Nonlinearity(even, odd, coulomb, damping)


def nonlinearity_row(phasors: Sequence[SegmentPhasors]) -> Row:
    """Shares of the torque's harmonics, and the Coulomb friction that the third one indicates."""
    measured = nonlinearity(
        np.array([s.frequency_hz for s in phasors]),
        np.array([abs(s.theta.value) for s in phasors]),
        np.array([s.torque.amplitudes for s in phasors]),
    )
    return {
        "even_harmonics": measured.even,
        "odd_harmonics": measured.odd,
        "coulomb_torque": measured.coulomb,
        "coulomb_damping": measured.coulomb_damping,
    }


def lowest_held_out_vaf(
    trial: SteppedSineTrial, amplitude: float | None, fit: LinearFit, columns: Callable[[Motion], Mapping[str, Array]]
) -> float | None:
    """Lowest VAF [percent] of the fit to one amplitude [deg] at the other amplitudes.

    Null for the fit to all amplitudes (None), and for the only one.
    """
    others = [part for part in trial.parts() if part[0] is not None and part[0] != amplitude]
    if amplitude is None or not others:
        return None
    return min(held_out_vaf(fit, columns(motion), torque) for _, motion, torque in others)


def summary_of_trials(table: pl.DataFrame, quantities: Sequence[str]) -> pl.DataFrame:
    """`summary_table`, with the number `n_doubtful` of trials whose fit is doubtful; they count in the mean as well."""
    counted = {name: pl.lit(count) for name, count in doubtful_row(table).items()}
    return summary_table(table, quantities).with_columns(**counted)


def check_changes(column: str, values: Array) -> None:
    """Refuse a signal (n,) that never changes, as that of a dead sensor.

    Raises
    ------
    InputError
        Every value is the same; the message names the column.
    """
    if not np.ptp(values):
        raise InputError(
            f"{column} stays at {values[0]:g} throughout; check its sensor and its channel in the source file, or "
            "exclude the trial"
        )


def check_resists(trial: str, symbol: str, value: float) -> None:
    """Refuse a negative estimate of what can only resist motion: belt stiffness, joint damping, a rendered stiffness.

    A torque that is read with the wrong sign changes the sign of every estimate, and the fit is as good as before.

    Raises
    ------
    InputError
        It is negative; the message names the trial.
    """
    if value < 0:
        raise InputError(
            f"trial {trial}: {symbol} = {value:.4g} is negative, so the torque drives the motion instead of resisting "
            "it; turn the `sign` of the torque, or of the angle, in the source file"
        )
