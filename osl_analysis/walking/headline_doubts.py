"""Numbers that say whether the result of a group, or of a single perturbation, can be believed.

The residual of a fit is compared with what ordinary gait leaves: each unperturbed crossing's deviation from their mean,
fitted with the same columns. A residual that is a small share of the torque does not count, however regular the gait.
"""

from collections.abc import Mapping, Sequence

import numpy as np

from osl_analysis.second_order import ImpedanceFit
from osl_analysis.signals import Motion
from osl_analysis.stats.repeats import over_repeats
from osl_analysis.trial import Array
from osl_analysis.walking.ensemble import Headline, signs_of
from osl_analysis.walking.response import PerturbationResponse, fit_response, gait_torque, offset_comparison

SMALL_RESIDUAL = 0.03  # share of the torque's RMS below which a residual does not count
SMALL_OFFSET = 0.15  # relative change of K by an offset below which the offset does not count
SMALL_DIFFERENCE = 0.03  # share of the mean stiffness by which single ones may differ
ROUNDING_SHARE = 1e-9  # width of an interval, as a share of the estimate, from which on it is more than rounding
CERTAIN_T = 3.0  # value of t from which a change of stance is certain
QUANTITIES = ("K", "B", "I")
Facts = dict[str, float | None]


def single_facts(response: PerturbationResponse, impedance: ImpedanceFit) -> Facts:
    """Columns of `walking.csv`: residual and offset of one fit over those that ordinary gait causes, change of stance.
    Null where the residual is a small share of the torque, the offset hardly changes K, or no stance is expected."""
    motion, torque = response.fitted_motion, response.fitted_torque
    left = gait_torque(response, impedance)[:, response.window]
    compared = offset_comparison(motion, torque, impedance.K)
    columns = np.column_stack([motion.theta, motion.omega, motion.alpha, np.ones_like(motion.theta)])
    scatter = float(np.std(np.linalg.lstsq(columns, left.T, rcond=None)[0][-1], ddof=1))
    counts = abs(compared["offset_share"] or 0.0) > SMALL_OFFSET and scatter > 0
    return {
        "residual_over_gait": residual_over_gait(motion, torque, left),
        "offset_over_gait": abs(compared["offset"] or 0.0) / scatter if counts else None,
        "stance_change": response.stance_change if np.isfinite(response.stance_change) else None,
    }


def group_facts(headline: Headline) -> Facts:
    """Columns of `walking_groups.csv` on which limits may stand; the dictionary of tables says what each is."""
    ensemble, responses = headline.ensemble, headline.responses
    rows, fit = responses[0].window, headline.ensemble.fit
    motion, torque = ensemble.motion[rows], ensemble.torque[rows]
    left = np.mean([gait_torque(r, fit)[:, rows] for r in responses], axis=0)
    values = {name: float(getattr(fit, name)) for name in QUANTITIES}
    intervals = {name: headline.resampled.interval(name) for name in QUANTITIES}
    singles = [fit_response(r) for r in responses]
    outside = sum(not low <= values[name] <= high for name, (low, high) in intervals.items())
    angles = np.array([r.sign * r.fitted_motion.theta for r in responses])
    return {
        "coherence": rms(angles.mean(axis=0)) / rms(angles),  # 1 for equal responses, 0 if they cancel
        "VAF": fit.fit.vaf,
        "residual_over_gait": residual_over_gait(motion, torque, left),
        "offset_share": offset_comparison(motion, torque, fit.K)["offset_share"],
        "outside_interval": float(outside),
        "estimator_difference": estimator_difference(headline, singles, values, intervals),
        "heterogeneity": heterogeneity(singles),
        "K": values["K"],
        "K_se_share": headline.resampled.se("K") / abs(values["K"]) if values["K"] else None,
        "B_high": intervals["B"][1],
        "I_high": intervals["I"][1],
        **stance_facts(responses),
        "predicted_share": headline.prediction.share,
    }


def residual_over_gait(motion: Motion, torque: Array, left: Array) -> float | None:
    """RMS residual of Eq. 15 over the RMS residual of what ordinary gait leaves (crossings, k). Null if the residual is
    below 3 % of the torque, or gait leaves none."""
    columns = np.column_stack([motion.theta, motion.omega, motion.alpha])
    own, gait = (rms(y - (columns @ np.linalg.lstsq(columns, y.T, rcond=None)[0]).T) for y in (torque[None], left))
    return own / gait if own > SMALL_RESIDUAL * rms(torque) and gait > 0 else None


def rms(values: Array) -> float:
    return float(np.sqrt(np.mean(values**2)))


def estimator_difference(
    headline: Headline,
    singles: Sequence[ImpedanceFit],
    values: Mapping[str, float],
    intervals: Mapping[str, tuple[float, float]],
) -> float:
    """Largest distance of ensemble and mean of perturbations, over the sum of the halves of both intervals. Intervals
    without width, of crossings that are all equal, do not count."""
    distances, signs = [], signs_of(headline.responses)
    for name, (low, high) in intervals.items():
        mean = over_repeats([getattr(fit, name) for fit in singles], headline.common.get(name, ()), signs)
        width = high - low + mean.high - mean.low
        if width > ROUNDING_SHARE * abs(values[name]):
            distances.append(2 * abs(values[name] - mean.mean) / width)
    return max(distances, default=0.0)


def heterogeneity(singles: Sequence[ImpedanceFit]) -> float | None:
    """Scatter of single stiffnesses over that of their standard errors, at least 3 % of the mean each: Cochran's Q over
    its degrees of freedom. None of fewer than two stiffnesses, or where all are 0."""
    K, se = np.array([fit.K for fit in singles]), np.array([fit.fit.se("K") for fit in singles])
    variance = se**2 + (SMALL_DIFFERENCE * K.mean()) ** 2
    if len(K) < 2 or not np.isfinite(se).all() or not (variance > 0).all():
        return None
    weight = 1 / variance
    return float(np.sum(weight * (K - np.average(K, weights=weight)) ** 2) / (len(K) - 1))


def stance_facts(responses: Sequence[PerturbationResponse]) -> Facts:
    """Mean change of stance by the perturbation, as a share; and how far the stance by which phase is computed differs
    from the one that the gait before the onset leads to expect, if that is certain."""
    changes = np.array([r.stance_change for r in responses])
    errors = np.array([r.stance_error for r in responses])[np.isfinite(changes)]
    changes = changes[np.isfinite(changes)]
    if len(changes) < 2:
        return {"stance_change": None, "uncorrected_stance_change": None}
    left = float(errors.mean())
    certain = abs(left) > CERTAIN_T * float(errors.std(ddof=1)) / np.sqrt(len(errors))
    return {"stance_change": float(changes.mean()), "uncorrected_stance_change": left if certain else None}
