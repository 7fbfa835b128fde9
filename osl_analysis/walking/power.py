"""How many crossings are enough: the intervals of K, B and I that n perturbed crossings will have, from the unperturbed
crossings of a pilot alone.

Each unperturbed crossing is taken for a perturbed one: the answer of the expected joint to the planned turn is added to
it, and it is analysed against the others. The scatter of K, B and I is what gait does to one of them. The
mean of n has 1/n of its variance, and that of m unperturbed crossings adds 1/m, which cancels between directions."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import polars as pl

from osl_analysis.errors import InputError
from osl_analysis.signals import differentiate, sampling_rate
from osl_analysis.trial import Array
from osl_analysis.walking.crossing import Crossing
from osl_analysis.walking.gait import unperturbed_gait
from osl_analysis.walking.response import fit_without_offset, isolate_response
from osl_analysis.walking.settings import ResponseSettings


@dataclass(frozen=True)
class PlannedTurn:
    """A perturbation that is planned, and the joint [N*m/rad, N*m*s/rad, kg*m^2] that will answer it."""

    turn: float  # [rad]
    ramp_s: float  # of a minimum-jerk ramp
    phase: float  # of its onset, as a share of stance
    joint: tuple[float, float, float]

    def added_to(self, crossing: Crossing, settings: ResponseSettings) -> Crossing:
        """The unperturbed crossing with the turn and the joint's answer, through the crossings' low-pass."""
        onset = crossing.stance.heel_strike + self.phase * crossing.stance.duration
        since = np.clip((crossing.time - onset) / self.ramp_s, 0, 1)
        ramp = self.turn * since**3 * (10 - 15 * since + 6 * since**2)
        turned = differentiate(crossing.time, settings.low_pass(ramp, sampling_rate(crossing.time)))
        answer = np.array([turned.theta, turned.omega, turned.alpha]).T @ self.joint
        theta, torque = crossing.theta + turned.theta, crossing.torque + answer
        return replace(crossing, onset=onset, turn=self.turn, theta=theta, torque=torque)


def scatter_of_one(crossings: Sequence[Crossing], planned: PlannedTurn, settings: ResponseSettings) -> Array:
    """Standard deviations (3,) of K, B and I of one perturbed crossing against the mean of many unperturbed ones."""
    if (count := len(crossings)) < 4:
        raise InputError(
            f"{count} unperturbed crossings can be used, expected 4 or more to know how they scatter; record more"
        )
    estimates = []
    for k, crossing in enumerate(crossings):
        others = unperturbed_gait([*crossings[:k], *crossings[k + 1 :]], 3)
        response = isolate_response(planned.added_to(crossing, settings), others, settings, settings.perturbed_stance)
        fit = fit_without_offset(response.fitted_motion, response.fitted_torque)
        estimates.append([fit[name] for name in "KBI"])
    return np.asarray(np.std(estimates, axis=0, ddof=1) / np.sqrt(1 + 1 / (count - 1)))


def half_widths(scatter: Array, counts: Sequence[int], unperturbed: int, both: bool) -> pl.DataFrame:
    """Halves of the 95 % intervals of K, B and I for each number of perturbed crossings and as many `unperturbed` ones:
    with turns in `both` directions of half their difference. The table has a row per number."""
    from scipy.special import stdtrit

    rows = []
    for n in counts:
        freedom = min(n - 2 if both else n - 1, unperturbed - 1)
        share = 1 / n + (0.0 if both else 1 / unperturbed)
        half = -stdtrit(freedom, 0.025) * scatter * np.sqrt(share) if freedom > 0 else np.full(3, np.nan)
        rows.append({"n": n, "n_unperturbed": unperturbed} | dict(zip("KBI", half.tolist(), strict=True)))
    return pl.DataFrame(rows)
