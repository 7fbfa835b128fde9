"""Phase of stance, and how far a perturbation changes the duration of stance.

A crossing's own duration of stance is a good scale of its phase, unless the perturbation changes it: then the window
lies at a wrong phase of the mean gait. What the person did before the onset knows nothing of the perturbation, and
tells the duration that was to be expected.
"""

from dataclasses import dataclass

import numpy as np

from osl_analysis.errors import InputError
from osl_analysis.trial import Array
from osl_analysis.walking.crossing import Crossing
from osl_analysis.walking.matching import LARGEST, SMALLEST, steadiest_scales
from osl_analysis.walking.settings import StanceSource
from osl_analysis.walking.unperturbed import PHASES, UnperturbedGait, at_phases, signal_at, stance_times

BEFORE_ONSET_S = 0.03
"""Time [s] before the onset at which the matching ends: the filter spreads the response into it."""
FEWEST_PHASES = 20
"""Fewest of the `PHASES` before the onset from which a pace is read: 5 % of stance."""


@dataclass(frozen=True)
class AlignedGait:
    """How a perturbed crossing and the unperturbed ones lie on the mean gait.

    stance: duration of stance [s] of the perturbed crossing that converts time to phase.
    scales: phase of the mean gait over own phase (crossings,), of each unperturbed crossing.
    expected: duration of stance [s] that the gait before the onset leads to expect; NaN if it is like the mean gait at
        no pace.
    """

    stance: float
    scales: Array
    expected: float

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
    expected = own / scale * float(others.mean())
    if source != "matched":
        return AlignedGait(own if source == "own" else usual, np.ones(len(gait.names)), expected)
    if not np.isfinite(scale):
        raise InputError(
            f"trial {crossing.name}: its ankle angle before the onset is like that of the mean unperturbed gait at no "
            f"pace between {SMALLEST:g} and {LARGEST:g} of its own; exclude the trial, give it another group, or state "
            "perturbed_stance: own"
        )
    return AlignedGait(own / scale, others, expected)


def matched_scales_of(crossing: Crossing, gait: UnperturbedGait) -> tuple[float, Array]:
    """Scales of a perturbed crossing and of the unperturbed ones (crossings,), from heel strike to before the onset."""
    onset = crossing.stance.toe_off if crossing.onset is None else crossing.onset
    phase = PHASES[(onset - BEFORE_ONSET_S - crossing.stance.heel_strike) / crossing.stance.duration >= PHASES]
    if len(phase) < FEWEST_PHASES:
        return float("nan"), np.full(len(gait.names), np.nan)
    return steadiest_scales(phase, signal_at(crossing, crossing.theta, stance_times(crossing, phase)), gait.theta)
