"""The leg's own joint encoder compared with the angle from markers: offset, delay, and the remaining difference."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import make_interp_spline

from osl_analysis.errors import InputError
from osl_analysis.measured import check_measured
from osl_analysis.signals import LowPass, sampling_rate
from osl_analysis.timebase.gaps import GapLimits
from osl_analysis.trial import Array, Trial
from osl_analysis.uniform import uniform_signals

LARGEST_DELAY_S = 0.05
"""Largest delay [s] between the clocks; beyond it they are not aligned."""
NEWTON_STEPS = 8
FEWEST_SAMPLES = 30


@dataclass(frozen=True)
class EncoderCheck:
    """The encoder's angle minus the markers'.

    offset: [rad].
    delay: [s], positive if the encoder's clock is late.
    rms: RMS [rad] of the difference that remains after both are removed.
    """

    offset: float
    delay: float
    rms: float


def compare_encoder(
    time: Array,
    theta: Array,
    encoder_time: Array,
    encoder: Array,
    low_pass: LowPass,
    usable: NDArray[np.bool_] | None = None,
) -> EncoderCheck | None:
    """Compare the angle (n,) [rad] at `time` [s] with the encoder's (k,), which passes the angle's low-pass here.

    The encoder's stamps are uniform; only rows at which it is `usable` (k,) are compared.

    Least squares of theta_encoder(t + delay) = theta(t) + offset by Gauss and Newton; None if the two overlap in fewer
    than 30 samples.

    Raises
    ------
    InputError
        The delay exceeds 50 ms: the clocks are not aligned, or the encoder belongs to another joint. Or a signal is not
        finite or cannot be measured.
    """
    check_measured("the angle from markers", theta)
    check_measured("the encoder's angle", encoder)
    spare = LARGEST_DELAY_S + 1 / sampling_rate(time)
    rows = (time > encoder_time[0] + spare) & (time < encoder_time[-1] - spare) if len(encoder_time) else time < -1
    if usable is not None and len(encoder_time):
        rows &= np.interp(time, encoder_time, usable) == 1
    if rows.sum() < FEWEST_SAMPLES:
        return None
    spline = make_interp_spline(encoder_time, low_pass(encoder, sampling_rate(encoder_time)), k=5)
    offset, delay = 0.0, 0.0
    for _ in range(NEWTON_STEPS):
        difference = spline(time[rows] + delay) - theta[rows] - offset
        columns = np.column_stack([np.ones(len(difference)), -spline(time[rows] + delay, 1)])
        change = np.linalg.lstsq(columns, difference, rcond=None)[0]
        offset, delay = offset + float(change[0]), delay + float(change[1])
        if abs(delay) > LARGEST_DELAY_S:
            raise InputError(
                f"the leg's joint encoder does not follow the angle from markers within {LARGEST_DELAY_S * 1e3:g} ms; "
                "check the sync line, and which encoder and which sign the source file maps to theta"
            )
    difference = spline(time[rows] + delay) - theta[rows] - offset
    return EncoderCheck(offset, delay, float(np.sqrt(np.mean(difference**2))))


def encoder_check(trial: Trial, time: Array, theta: Array, low_pass: LowPass) -> EncoderCheck | None:
    """The leg's joint encoder compared with the angle (n,) [rad] from markers; None in a trial without one."""
    samples = trial.samples
    if "theta" not in samples.columns or samples["theta"].count() < FEWEST_SAMPLES:
        return None
    own = uniform_signals(trial, ["theta"], GapLimits(cutoff_hz=low_pass.cutoff_hz))
    return compare_encoder(time, theta, own.time, own["theta"], low_pass, own.usable)
