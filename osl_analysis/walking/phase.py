"""Phase of stance, and how far a perturbation changes the duration of stance.

A crossing's own duration of stance is the best scale of its phase, unless the perturbation changes it: then the window
lies at a wrong phase of the mean gait. What the person did before the onset knows nothing of the
perturbation. It tells the duration that was to be expected, with the scatter of the gait's shape.
"""

from dataclasses import dataclass

import numpy as np

from osl_analysis.errors import InputError
from osl_analysis.measured import rounding_of
from osl_analysis.trial import Array
from osl_analysis.walking.crossing import Crossing
from osl_analysis.walking.settings import StanceSource
from osl_analysis.walking.unperturbed import PHASES, UnperturbedGait, at_phases, signal_at, stance_times

BEFORE_ONSET_S = 0.03
"""Time [s] before the onset at which the matching ends: the filter spreads the response into it."""
SCALES = np.linspace(0.75, 1.33, 59)
"""Scales among which the best is sought first."""
FINER = np.linspace(-0.01, 0.01, 11)
"""Scales about the best one of `SCALES`, by the step of these."""


@dataclass(frozen=True)
class AlignedGait:
    """How a perturbed crossing and the unperturbed ones lie on the mean gait.

    stance: duration of stance [s] of the perturbed crossing that converts time to phase.
    scales: phase of the mean gait over own phase (crossings,), of each unperturbed crossing.
    stance_change: own duration of stance over the one that the gait before the onset leads to expect, minus 1; NaN if
        the gait before the onset is like the mean gait at no pace.
    """

    stance: float
    scales: Array
    stance_change: float

    def curves(self, unperturbed: Array, phase: Array) -> Array:
        """The unperturbed curves (crossings, `PHASES`) at phases (k,) of the mean gait: (crossings, k)."""
        if (self.scales == 1).all():
            return at_phases(unperturbed, phase)
        own = np.clip(phase / self.scales[:, None], 0.0, 1.0)
        return np.array([at_phases(curve, there) for curve, there in zip(unperturbed, own, strict=True)])


def aligned_gait(crossing: Crossing, gait: UnperturbedGait, source: StanceSource) -> AlignedGait:
    """The alignment of a perturbed crossing, whose duration of stance comes from `source`.

    Raises
    ------
    InputError
        `matched`, and the gait before the onset is like the mean gait at no pace.
    """
    own, usual = crossing.stance.duration, float(np.mean(gait.stance))
    scale, others = matched_scales_of(crossing, gait)
    change = scale / float(others.mean()) - 1
    if source != "matched":
        return AlignedGait(own if source == "own" else usual, np.ones(len(gait.names)), change)
    if not np.isfinite([scale, *others]).all():
        raise InputError(
            f"trial {crossing.name}: its gait before the onset is like the mean unperturbed gait at no pace between "
            f"{SCALES[0]:g} and {SCALES[-1]:g} of its own; exclude the trial, or give it another group"
        )
    return AlignedGait(own / scale, others, change)


def matched_scales_of(crossing: Crossing, gait: UnperturbedGait) -> tuple[float, Array]:
    """Scales of a perturbed crossing and of the unperturbed ones (crossings,), from heel strike to before the onset."""
    onset = crossing.stance.toe_off if crossing.onset is None else crossing.onset
    phase = PHASES[(onset - BEFORE_ONSET_S - crossing.stance.heel_strike) / crossing.stance.duration >= PHASES]
    every = np.array([gait.theta, gait.torque])
    times = stance_times(crossing, phase)
    seen = np.array([signal_at(crossing, signal, times) for signal in (crossing.theta, crossing.torque)])
    curves = np.concatenate([seen[:, None], every[:, :, : len(phase)]], axis=1)
    scales = matched_scales(phase, curves, every.mean(axis=1))
    return float(scales[0]), scales[1:]


def matched_scales(phase: Array, curves: Array, mean: Array) -> Array:
    """The scales r (m,) at which curves, as functions of r p, are most like the mean gait; NaN at an end of `SCALES`.

    phase: phases p (k,), from heel strike on.
    curves: (signals, m, k), at p.
    mean: (signals, n), the mean gait at n uniform phases from 0 to 1.

    A curve is like the mean gait if it is a multiple of it with an offset and a drift: people differ in these from step
    to step, and they would be taken for pace. The squared misfits of the signals are divided by what the mean gait's
    own shape leaves beside offset and drift; a signal whose mean is a straight line shows no pace and does not count.
    """
    coarse = np.array([misfits(scale, phase, curves, mean) for scale in SCALES])
    best = np.argmin(coarse, axis=0)
    scales = np.full(curves.shape[1], np.nan)
    for column in np.flatnonzero((best > 0) & (best < len(SCALES) - 1)):
        finer = SCALES[best[column]] + FINER
        one = curves[:, column : column + 1]
        values = np.array([misfits(scale, phase, one, mean)[0] for scale in finer])
        k = int(np.clip(np.argmin(values), 1, len(finer) - 2))
        before, least, after = values[k - 1 : k + 2]
        bend = before - 2 * least + after
        scales[column] = finer[k] + (0.5 * (before - after) / bend * (finer[1] - finer[0]) if bend > 0 else 0.0)
    return scales


def misfits(scale: float, phase: Array, curves: Array, mean: Array) -> Array:
    """Misfits (m,) of curves (signals, m, k) to the mean gait (signals, n) at phases `scale` times p (k,)."""
    grid = np.linspace(0.0, 1.0, mean.shape[1])
    line = np.column_stack([np.ones_like(phase), phase])
    total = np.zeros(curves.shape[1])
    for own, signal in zip(curves, mean, strict=True):
        there = np.interp(scale * phase, grid, signal)
        columns = np.column_stack([there, line])
        shape = there - line @ np.linalg.lstsq(line, there, rcond=None)[0]
        power = float(shape @ shape)
        if power <= len(there) * rounding_of(there):
            continue
        left = own.T - columns @ (np.linalg.pinv(columns) @ own.T)
        total += np.sum(left**2, axis=0) / power
    return total
