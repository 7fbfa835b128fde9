"""What shows whether the result of a group can be trusted: columns of `walking_groups.csv`.

The fields of each value are columns of the table; the dictionary of tables says what each is, and
limits may stand on them. The residual of a fit is compared with what ordinary gait leaves: each
unperturbed crossing's deviation from their mean, fitted with the same columns. One that is a small
share of the torque does not count, however regular the gait.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from osl_analysis.measured import rms
from osl_analysis.signals import Motion
from osl_analysis.stats.repeats import over_repeats
from osl_analysis.trial import Array
from osl_analysis.walking.ensemble import ESTIMATED, GroupHeadline
from osl_analysis.walking.impedance_fit import fit_response, gait_torque, offset_share
from osl_analysis.walking.isolated_response import PerturbationResponse

SMALLEST_RESIDUAL_SHARE = 0.03  # of the torque, for a residual to count
CERTAIN_STANCE_SES = 3.0  # standard errors beyond which a change of stance is certain


def residual_over_gait(motion: Motion, torque: Array, of_gait: Array) -> float | None:
    """RMS residual of Eq. 15 over that of ordinary gait (crossings, k).

    None below 3 % of the torque, or over 0.
    """
    residual = unexplained_rms(motion.columns, torque[None])
    usual = unexplained_rms(motion.columns, of_gait)
    if residual > SMALLEST_RESIDUAL_SHARE * rms(torque) and usual > 0:
        return residual / usual
    return None


def unexplained_rms(columns: Array, torques: Array) -> float:
    """RMS [N*m] of what the columns (k, 3) leave of torques (n, k)."""
    explained = (columns @ np.linalg.lstsq(columns, torques.T, rcond=None)[0]).T
    return rms(torques - explained)


@dataclass(frozen=True)
class FitChecks:
    """How the fit to the mean response agrees with single fits and with ordinary gait."""

    coherence: float  # 1 for equal responses, 0 if they cancel
    VAF: float
    residual_over_gait: float | None
    offset_share: float | None
    estimator_difference: float
    K: float
    K_se_share: float | None
    B_high: float
    I_high: float
    stance_change: float | None
    uncorrected_stance_change: float | None


def check_fit(headline: GroupHeadline) -> FitChecks:
    """Compare the fit to the mean response with single fits and with ordinary gait."""
    responses = headline.responses
    ensemble = headline.ensemble
    fit = headline.ensemble.fit
    window = responses[0].window
    motion = ensemble.motion[window]
    torque = ensemble.torque[window]
    of_gait = np.mean([gait_torque(response, fit)[:, window] for response in responses], axis=0)
    stance = stance_changes(responses)
    return FitChecks(
        coherence=coherence_of(responses),
        VAF=fit.vaf,
        residual_over_gait=residual_over_gait(motion, torque, of_gait),
        offset_share=offset_share(motion, torque, fit["K"]),
        estimator_difference=estimator_difference(headline),
        K=fit["K"],
        K_se_share=headline.resampled.se("K") / abs(fit["K"]) if fit["K"] else None,
        B_high=headline.resampled.interval("B")[1],
        I_high=headline.resampled.interval("I")[1],
        stance_change=stance.mean,
        uncorrected_stance_change=stance.uncorrected,
    )


def estimator_difference(headline: GroupHeadline) -> float:
    """Largest distance of ensemble and mean of perturbations, in halves of both intervals."""
    fit = headline.ensemble.fit
    single_fits = [fit_response(response) for response in headline.responses]
    distances = [0.0]
    for name in ESTIMATED:
        low, high = headline.resampled.interval(name)
        singles = [single[name] for single in single_fits]
        mean = over_repeats(singles, headline.errors.common.get(name, ()))
        width = high - low + mean.high - mean.low
        if width > 1e-9 * abs(fit[name]):  # intervals of crossings that are all equal have no width
            distances.append(2 * abs(fit[name] - mean.mean) / width)
    return max(distances)


def coherence_of(responses: Sequence[PerturbationResponse]) -> float:
    """RMS angle of the mean response over that of single ones, without their gait.

    Equal turns cancel by nothing but gait: what it scatters in small ones is no other direction or
    onset.
    """
    window = responses[0].window
    angles = np.array([response.fitted_motion.theta for response in responses])
    of_mean = rms(angles.mean(axis=0))
    gait_variance = float(
        np.mean([response.thetas[:, window].var(axis=0, ddof=1) for response in responses])
    )
    of_singles = max(rms(angles) ** 2 - gait_variance, of_mean**2)
    return of_mean / float(np.sqrt(of_singles))


@dataclass(frozen=True)
class StanceChanges:
    """Mean change of stance by the perturbation; what of it is certain and not corrected."""

    mean: float | None
    uncorrected: float | None


def stance_changes(responses: Sequence[PerturbationResponse]) -> StanceChanges:
    """Compare the stance by which phase is computed with the one that was to be expected."""
    expected = [response for response in responses if np.isfinite(response.stance_change)]
    if len(expected) < 2:
        return StanceChanges(None, None)
    changes = np.array([(response.stance_change, response.stance_error) for response in expected])
    mean, error = changes.mean(axis=0).tolist()
    se = float(changes[:, 1].std(ddof=1)) / np.sqrt(len(expected))
    is_certain = abs(error) > CERTAIN_STANCE_SES * se
    return StanceChanges(mean, uncorrected=error if is_certain else None)
