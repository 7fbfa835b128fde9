"""A plan: the intervals that n perturbed crossings will have, from a pilot's unperturbed ones.

The expected joint's response to the planned turn is added to each unperturbed crossing, which is
analysed against the others. The scatter of K, B and I is then the effect of gait on one crossing.
The mean over n has 1/n of this variance. The mean of m unperturbed crossings adds 1/m of it, which
cancels between directions.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import polars as pl
import scipy

from osl_analysis.errors import InputError
from osl_analysis.signals import differentiate, sampling_rate
from osl_analysis.trial import Array
from osl_analysis.walking.crossing import Crossing
from osl_analysis.walking.isolated_response import isolate_response
from osl_analysis.walking.unperturbed_gait import unperturbed_gait
from osl_analysis.walking.walking_settings import ResponseSettings

FEWEST_CROSSINGS = 4  # whose scatter tells something


@dataclass(frozen=True)
class PlannedTurn:
    """A planned perturbation, and the expected joint."""

    turn: float  # [rad]
    ramp_s: float  # of a minimum-jerk ramp
    phase: float  # of its onset, as a share of stance
    joint: tuple[float, float, float]  # K, B, I [N*m/rad, N*m*s/rad, kg*m^2]

    def added_to(self, crossing: Crossing, settings: ResponseSettings) -> Crossing:
        """Add the turn and the joint's torque, both low-passed, to an unperturbed crossing."""
        onset = crossing.stance.heel_strike + self.phase * crossing.stance.duration
        x = np.clip((crossing.time - onset) / self.ramp_s, 0, 1)
        ramp = self.turn * x**3 * (10 - 15 * x + 6 * x**2)
        low_passed = settings.low_pass(ramp, sampling_rate(crossing.time))
        motion = differentiate(crossing.time, low_passed)
        return replace(
            crossing,
            onset=onset,
            turn=self.turn,
            theta=crossing.theta + motion.theta,
            torque=crossing.torque + motion.columns @ self.joint,
        )


def scatter_of_one(
    crossings: Sequence[Crossing], planned: PlannedTurn, settings: ResponseSettings
) -> Array:
    """Predict how K, B and I of one perturbed crossing scatter against many unperturbed ones.

    Returns
    -------
    Array
        Standard deviations (3,).

    Raises
    ------
    InputError
        There are too few crossings, or the turn is planned too early in stance.
    """
    count = len(crossings)
    if count < FEWEST_CROSSINGS:
        raise InputError(
            f"{count} unperturbed crossings can be used, expected 4 or more to know how they"
            " scatter; record more"
        )
    shortest_stance = min(crossing.stance.duration for crossing in crossings)
    earliest = (settings.guard_s + settings.baseline_s) / shortest_stance
    if planned.phase < earliest:
        raise InputError(
            f"an onset at {100 * planned.phase:g} % of stance leaves no room for guard and baseline"
            f" before it, expected {100 * earliest:.0f} % or more; state a later phase, in percent"
        )

    columns = []
    gait_torques = []
    for k, crossing in enumerate(crossings):
        others = unperturbed_gait([*crossings[:k], *crossings[k + 1 :]], FEWEST_CROSSINGS - 1)
        response = isolate_response(
            planned.added_to(crossing, settings), others, settings, settings.perturbed_stance
        )
        columns.append(response.fitted_motion.columns)
        gait_torques.append(response.fitted_torque - columns[-1] @ planned.joint)
    # First order, as for a mean of many: the fit to one crossing also has the square of its gait's
    # deviation
    changes = np.linalg.lstsq(np.mean(columns, axis=0), np.transpose(gait_torques))[0].T
    scatter = np.std(changes, axis=0, ddof=1)
    return np.asarray(scatter / np.sqrt(1 + 1 / (count - 1)))


def half_widths(
    scatter: Array, counts: Sequence[int], unperturbed: int, both_directions: bool
) -> pl.DataFrame:
    """Half-widths of the 95 % intervals of K, B and I, a row per number of perturbed crossings.

    `scatter` (3,) is that of one crossing. With turns up and down, of half their difference.
    """
    rows = []
    for n in counts:
        freedom = min(n - 2 if both_directions else n - 1, unperturbed - 1)
        share = 1 / n + (0.0 if both_directions else 1 / unperturbed)
        half = np.full(3, np.nan)
        if freedom > 0:
            half = -scipy.special.stdtrit(freedom, 0.025) * scatter * np.sqrt(share)
        K, B, I = half.tolist()
        rows.append({"n": n, "n_unperturbed": unperturbed, "K": K, "B": B, "I": I})
    return pl.DataFrame(rows)
