"""The isolated response to a perturbation: the perturbed crossing minus the mean unperturbed gait at the same phase."""

from dataclasses import dataclass

import numpy as np

from osl_analysis.errors import InputError
from osl_analysis.signals import Motion, differentiate, sampling_rate
from osl_analysis.trial import Array
from osl_analysis.walking.crossing import Crossing
from osl_analysis.walking.phase import BEFORE_ONSET_S, aligned_gait
from osl_analysis.walking.settings import StanceSource, Timing
from osl_analysis.walking.unperturbed import UnperturbedGait, signal_at

MARGIN = 8
"""Additional samples at both ends of a response. A spline's derivatives are less accurate at its ends."""
BEHAVIOUR = ("angle", "torque", "angle_slope", "torque_slope")
"""What a crossing does before the onset, up to where the filter spreads the response: mean and slope of its curves."""


@dataclass(frozen=True)
class PerturbationResponse:
    """Isolated response to one perturbation, k samples; angle and torque are zero on average over the baseline.

    name: the perturbed crossing.
    time: time (k,) [s] from the onset.
    motion: angle [rad] of the ankle and its derivatives, (k,) each.
    torque: torque (k,) [N*m].
    thetas: angles (crossings, k) [rad]; row i is the response with the i-th unperturbed crossing subtracted instead of
        the mean. Their scatter shows how gait varies.
    torques: the same for the torque [N*m].
    plate_errors: changes (m, k) [N*m] of the torque if the plate's model is identified without each of m plate trials.
    behaviour: (4, crossings), `BEHAVIOUR` before the onset, minus that of the i-th unperturbed crossing.
    timing: window, baseline and guard.
    sign: -1 if the platform turned the toes down, else 1.
    stance: duration of stance [s] that converts time to phase.
    stance_change: own duration over the one that the gait before the onset leads to expect, minus 1.
    stance_error: `stance` over the one that the gait before the onset leads to expect, minus 1; 0 if it is this one.
    """

    name: str
    time: Array
    motion: Motion
    torque: Array
    thetas: Array
    torques: Array
    plate_errors: Array
    behaviour: Array
    timing: Timing
    sign: int = 1
    stance: float = float("nan")
    stance_change: float = 0.0
    stance_error: float = 0.0

    @property
    def window(self) -> slice:
        """Samples of the fitted window."""
        return window_samples(self.time, self.timing)

    @property
    def fitted_motion(self) -> Motion:
        """Motion in the window."""
        return self.motion[self.window]

    @property
    def fitted_torque(self) -> Array:
        """Torque [N*m] in the window."""
        return self.torque[self.window]


def window_samples(time: Array, timing: Timing) -> slice:
    """Samples from the onset to the end of the window, without that end: 30 for 0.1 s at 300 Hz."""
    first = int(np.argmin(np.abs(time)))
    return slice(first, first + round(timing.window / (time[1] - time[0])))


def isolate_response(
    crossing: Crossing, gait: UnperturbedGait, timing: Timing, perturbed_stance: StanceSource = "own"
) -> PerturbationResponse:
    """The crossing's response to its perturbation.

    Phase is the time since heel strike divided by a duration of stance. With `own` this is the crossing's own duration,
    with `unperturbed` the mean of the unperturbed crossings. With `matched` it is the duration at which the crossing's
    angle before the onset is most like the mean unperturbed angle; the unperturbed crossings are matched in the same
    way. The baseline ends before the onset, because the filter spreads the response to earlier times. A
    response zeroed at the onset itself gives K = 321 N*m/rad for a true 340.

    Raises
    ------
    InputError
        The crossing has no onset, baseline or window leave the stance, or no duration matches.
    """
    if crossing.onset is None:
        raise InputError(
            f"trial {crossing.name}: no onset, expected a perturbed crossing; mark it as unperturbed in the sheet"
        )
    aligned = aligned_gait(crossing, gait, perturbed_stance)
    time = response_times(sampling_rate(crossing.time), timing)
    phase = (crossing.onset + time - crossing.stance.heel_strike) / aligned.stance
    check_phase(crossing.name, phase[MARGIN:-MARGIN])
    own_time, phase = crossing.onset + time, np.clip(phase, 0.0, 1.0)
    thetas = signal_at(crossing, crossing.theta, own_time) - aligned.curves(gait.theta, phase)
    torques = signal_at(crossing, crossing.torque, own_time) - aligned.curves(gait.torque, phase)
    errors = signal_at(crossing, crossing.plate_errors, own_time) - gait.mean_plate_errors_at(phase)
    behaviour = behaviour_before(time, thetas, torques)
    baseline = slice(MARGIN, MARGIN + round(timing.baseline * sampling_rate(time)))
    thetas, torques, errors = (without_baseline(curves, baseline) for curves in (thetas, torques, errors))
    return PerturbationResponse(
        name=crossing.name,
        time=time,
        motion=differentiate(time, thetas.mean(axis=0)),
        torque=torques.mean(axis=0),
        thetas=thetas,
        torques=torques,
        plate_errors=errors,
        timing=timing,
        sign=crossing.sign,
        stance=aligned.stance,
        behaviour=behaviour,
        stance_change=crossing.stance.duration / aligned.expected - 1,
        stance_error=0.0 if perturbed_stance == "matched" else aligned.stance / aligned.expected - 1,
    )


def behaviour_before(time: Array, thetas: Array, torques: Array) -> Array:
    """`BEHAVIOUR` (4, crossings) of angles [rad] and torques [N*m] (crossings, k) at times (k,) from the onset: means,
    and slopes per s."""
    rows = time <= -BEFORE_ONSET_S
    x = time[rows] - time[rows].mean()
    curves = np.array([thetas, torques])[..., rows]
    return np.concatenate([curves.mean(axis=-1), curves @ x / max(float(x @ x), np.finfo(float).tiny)])


def check_phase(name: str, phase: Array) -> None:
    """Refuse baseline and window whose phases (k,) leave the stance."""
    if phase[0] < 0 or phase[-1] > 1:
        raise InputError(
            f"trial {name}: baseline and window span {phase[0]:.2f}-{phase[-1]:.2f} of stance, expected 0-1; "
            "shorten window_s, baseline_s or guard_s, or exclude the trial"
        )


def response_times(rate: float, timing: Timing) -> Array:
    """Times [s] from the onset at the marker `rate` [Hz]: baseline, guard and window, with margins."""
    first = -round((timing.baseline + timing.guard) * rate) - MARGIN
    last = round(timing.window * rate) + MARGIN
    return np.arange(first, last + 1) / rate


def without_baseline(curves: Array, baseline: slice) -> Array:
    """Curves (..., k) minus their means over the samples of the baseline."""
    return np.asarray(curves - curves[..., baseline].mean(axis=-1, keepdims=True))
