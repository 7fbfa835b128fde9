"""Step 6, isolated response: a perturbed crossing minus unperturbed gait at the same phase.

The response is zero on average over a baseline that ends before the onset, because the zero-phase
filter spreads the response to earlier times. A response zeroed at the onset gives K = 321 N*m/rad
for a true 340.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy

from osl_analysis.errors import InputError
from osl_analysis.signals import Motion, differentiate, sampling_rate
from osl_analysis.trial import Array
from osl_analysis.walking.crossing import Crossing
from osl_analysis.walking.unperturbed_gait import (
    PHASES,
    UnperturbedGait,
    aligned_gait,
    signal_at,
)
from osl_analysis.walking.walking_settings import TimingSettings

# Samples at both ends of a response beyond what is used: a spline's derivatives are less accurate
# at its ends
MARGIN = 8
# What a crossing does before the onset, from which its gait is predicted: mean and slope of curves
BEHAVIOUR = ("angle", "torque", "angle_slope", "torque_slope")


@dataclass(frozen=True)
class PerturbationResponse:
    """Isolated response to one perturbation, k samples, zero on average over the baseline.

    Row i of `thetas` and `torques` is the crossing minus the i-th unperturbed one. The response is
    the mean row; the rows scatter by gait.
    """

    name: str
    time: Array  # (k,) [s] from the onset
    thetas: Array  # (crossings, k) [rad]
    torques: Array  # (crossings, k) [N*m]
    # Changes (m, k) [N*m] of the torque without each of m plate trials in the plate's model
    plate_errors: Array
    # (4, crossings): `BEHAVIOUR` before the onset minus that of each unperturbed crossing
    behaviour: Array
    # Samples of the fitted window, from the onset, without its end: 30 for 0.1 s at 300 Hz
    window: slice
    stance_change: float = 0.0  # duration of stance over that of the matched pace, minus 1

    @cached_property
    def motion(self) -> Motion:
        """Angle [rad] of the ankle with its derivatives, (k,) each."""
        return differentiate(self.time, self.thetas.mean(axis=0))

    @property
    def torque(self) -> Array:
        """(k,) [N*m]."""
        return np.asarray(self.torques.mean(axis=0))

    @property
    def fitted_motion(self) -> Motion:
        return self.motion[self.window]

    @property
    def fitted_torque(self) -> Array:
        return self.torque[self.window]


def isolate_response(
    crossing: Crossing, gait: UnperturbedGait, timing: TimingSettings
) -> PerturbationResponse:
    """Subtract unperturbed gait from a perturbed crossing.

    Parameters
    ----------
    timing : TimingSettings
        Baseline, guard and window about the onset.

    Raises
    ------
    InputError
        The crossing has no onset, no pace fits, or baseline and window leave stance.
    """
    if crossing.onset is None:
        raise InputError(
            f"trial {crossing.name}: no onset, expected a perturbed crossing; mark it as"
            " unperturbed in the sheet"
        )
    aligned = aligned_gait(crossing, gait, crossing.onset - timing.guard_s)

    # Time from the onset, and phase on the mean gait
    rate = sampling_rate(crossing.time)
    before = round((timing.baseline_s + timing.guard_s) * rate) + MARGIN  # samples
    after = round(timing.window_s * rate) + MARGIN
    time = np.arange(-before, after + 1) / rate
    crossing_time = crossing.onset + time
    phase = (crossing_time - crossing.stance.heel_strike) / aligned.stance
    first_phase = phase[MARGIN]
    last_phase = phase[-MARGIN - 1]
    if first_phase < 0 or last_phase > 1:
        raise InputError(
            f"trial {crossing.name}: baseline and window span {first_phase:.2f}-{last_phase:.2f} of"
            " stance, expected 0-1; shorten window_s, baseline_s or guard_s, or exclude the trial"
        )
    phase = np.clip(phase, 0.0, 1.0)

    # The crossing minus each unperturbed one, or for errors minus their mean
    theta = signal_at(crossing, crossing.theta, crossing_time)
    torque = signal_at(crossing, crossing.torque, crossing_time)
    plate_errors = signal_at(crossing, crossing.plate_errors, crossing_time)
    thetas = theta - aligned.curves(gait.theta, phase)
    torques = torque - aligned.curves(gait.torque, phase)
    plate_errors = plate_errors - mean_at(gait.plate_errors, phase)

    baseline = slice(MARGIN, MARGIN + round(timing.baseline_s * rate))
    window = slice(before, before + round(timing.window_s * rate))
    return PerturbationResponse(
        name=crossing.name,
        time=time,
        thetas=zeroed(thetas, baseline),
        torques=zeroed(torques, baseline),
        plate_errors=zeroed(plate_errors, baseline),
        behaviour=behaviour_before(time, thetas, torques, timing.guard_s),
        window=window,
        stance_change=crossing.stance.duration / (aligned.stance * aligned.scales.mean()) - 1,
    )


def mean_at(curves: Array, phase: Array) -> Array:
    """Mean over crossings of curves (e, crossings, `PHASES`), at phases (k,): (e, k)."""
    spline = scipy.interpolate.make_interp_spline(PHASES, curves.mean(axis=1), k=3, axis=-1)
    return np.asarray(spline(phase))


def zeroed(curves: Array, baseline: slice) -> Array:
    """Curves (..., k) minus their means over the baseline."""
    return np.asarray(curves - curves[..., baseline].mean(axis=-1, keepdims=True))


def behaviour_before(time: Array, thetas: Array, torques: Array, guard_s: float) -> Array:
    """`BEHAVIOUR` (4, crossings) of curves (crossings, k) until the filter spreads the response."""
    rows = time <= -guard_s
    centred_time = time[rows] - time[rows].mean()
    curves = np.array([thetas, torques])[..., rows]
    square = max(float(centred_time @ centred_time), np.finfo(float).tiny)
    return np.concatenate([curves.mean(axis=-1), curves @ centred_time / square])
