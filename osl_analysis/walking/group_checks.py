"""What shows whether the result of a group can be trusted: columns of `walking_groups.csv`.

The fields of each value are columns of the table; the dictionary of tables says what each is, and
limits may stand on them. The residual of a fit is compared with what ordinary gait leaves: each
unperturbed crossing's deviation from their mean, fitted with the same columns. One that is a small
share of the torque does not count, however regular the gait.
"""

from collections.abc import Sequence
from dataclasses import asdict, dataclass

import numpy as np
import polars as pl
import scipy

from osl_analysis.measured import rms
from osl_analysis.signals import Motion
from osl_analysis.stats.regression import LinearFit
from osl_analysis.stats.repeats import over_repeats
from osl_analysis.trial import REFLEX_DELAYS_MS, Array
from osl_analysis.walking.crossing import Crossing
from osl_analysis.walking.ensemble import (
    ESTIMATED,
    UP_MINUS_DOWN,
    GroupHeadline,
    Signs,
    signs_of,
)
from osl_analysis.walking.impedance_fit import compare_offset, fit_response, gait_torque
from osl_analysis.walking.isolated_response import PerturbationResponse
from osl_analysis.walking.plate_gain import KnownLoads, check_gain, weight_of
from osl_analysis.walking.reactions import (
    RAMP,
    REACTIONS,
    REFLEX,
    SLOPING,
    STIFFER,
    Effect,
    reaction_columns,
    reflex_column,
)
from osl_analysis.walking.torque_errors import LABORATORY_ERRORS, LOG_ERRORS

SMALLEST_RESIDUAL_SHARE = 0.03  # of the torque, for a residual to count
SMALLEST_OFFSET_SHARE = 0.15  # by which an offset must change K to count
LEAST_SE_SHARE = 0.03  # of the mean stiffness: single fits are no more certain
CERTAIN_STANCE_SES = 3.0  # standard errors beyond which a change of stance is certain
CERTAIN_PROBABILITY = 0.999  # of Student's t, because several reactions are tried
CERTAIN_MOMENT_SES = 4.0
FEWEST_FOR_MOMENTS = 6  # crossings
SMALLEST_TURN = 0.2  # of directions of walk, about 20 deg (SD), that tells the plate's place
HEIGHT_ERROR_M = 0.01  # of `corners_height` (`LABORATORY_ERRORS`)
UNDISTURBED_PHASE = 0.38  # of stance, until which a crossing tells the error of the moments


@dataclass(frozen=True)
class SingleChecks:
    """Columns of `walking.csv`: one fit beside what ordinary gait causes."""

    residual_over_gait: float | None  # None if the residual is a small share of the torque
    offset_over_gait: float | None  # None if the offset hardly changes K
    stance_change: float | None  # None if no stance is known


def check_single(
    response: PerturbationResponse, fit: LinearFit, plate_unexplained: float | None = None
) -> SingleChecks:
    """Compare residual and offset of one fit with those that ordinary gait and the plate cause.

    `plate_unexplained` is the share of the plate's own wrench that its model leaves: that is one
    cause in all crossings, and judged as such.
    """
    motion = response.fitted_motion
    torque = response.fitted_torque
    of_gait = gait_torque(response, fit)[:, response.window]
    of_plate = torque_of_plate(response, plate_unexplained or 0.0)
    offset = compare_offset(motion, torque, fit["K"])
    columns = np.column_stack([motion.columns, np.ones_like(motion.theta)])
    causes = np.vstack([of_gait, of_plate])
    *gait_offsets, plate_offset = np.linalg.lstsq(columns, causes.T, rcond=None)[0][-1]
    scatter = float(np.hypot(np.std(gait_offsets, ddof=1), plate_offset))
    offset_over_gait = None
    if abs(offset.lowers_K) > SMALLEST_OFFSET_SHARE and scatter > 0:
        offset_over_gait = normal_scatters(abs(offset.offset) / scatter, len(gait_offsets))
    return SingleChecks(
        residual_over_gait=residual_over_gait(motion, torque, of_gait, of_plate),
        offset_over_gait=offset_over_gait,
        stance_change=response.stance_change if np.isfinite(response.stance_change) else None,
    )


def normal_scatters(ratio: float, crossings: int) -> float:
    """What a ratio to the SD of some crossings is in SDs of as rare a normal deviate.

    The SD of few crossings is uncertain: a further one is Student-distributed about their mean.
    """
    t = ratio / np.sqrt(1 + 1 / crossings)
    rarity = scipy.special.stdtr(crossings - 1, -t)
    return float(-scipy.special.ndtri(max(rarity, np.finfo(float).tiny)))


def torque_of_plate(response: PerturbationResponse, share: float) -> Array:
    """Torque (window,) [N*m] of a share of the plate's own wrench."""
    row = [*LABORATORY_ERRORS].index("plate_inertia")
    if not share or len(response.lab_errors) <= row:  # of a log: no plate
        return np.zeros_like(response.fitted_torque)
    size = LABORATORY_ERRORS["plate_inertia"].size / 100
    return np.asarray(share / size * response.lab_errors[row, response.window])


def residual_over_gait(
    motion: Motion, torque: Array, of_gait: Array, of_plate: Array | None = None
) -> float | None:
    """RMS residual of Eq. 15 over that of ordinary gait (crossings, k) and of the plate (k,).

    None below 3 % of the torque, or over 0.
    """
    residual = unexplained_rms(motion.columns, torque[None])
    usual = unexplained_rms(motion.columns, of_gait)
    if of_plate is not None:
        usual = float(np.hypot(usual, unexplained_rms(motion.columns, of_plate[None])))
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
    heterogeneity: float | None
    K: float
    B: float
    K_se_share: float | None
    B_high: float
    I_high: float
    stance_change: float | None
    uncorrected_stance_change: float | None
    predicted_share: float


@dataclass(frozen=True)
class ReactionChecks:
    """Effects beyond Eq. 15 that are certain, and the torque of the most certain."""

    reaction: str | None
    reaction_share: float | None


@dataclass(frozen=True)
class ReflexChecks:
    """A certain reflex and K with it in the model; else the strongest that the window may hide.

    The widths are those of K's interval.
    """

    reflex_delay_ms: float | None = None
    reflex_gain: float | None = None
    reflex_share: float | None = None
    K_with_reflex: float | None = None
    K_with_reflex_low: float | None = None
    K_with_reflex_high: float | None = None
    reflex_K_widths: float | None = None
    hidden_reflex: float | None = None
    hidden_reflex_ms: float | None = None
    hidden_reflex_K: float | None = None
    hidden_reflex_K_widths: float | None = None
    longer_window_s: float | None = None


@dataclass(frozen=True)
class SlopeChecks:
    """What a stiffness that changes with stance, or a common torque, would do to K and B."""

    hidden_slope_low: float | None
    hidden_slope_high: float | None
    K_per_torque: float
    B_per_slope: float
    # What the same torque after either turn adds to K of turns up and takes off K of turns down
    common_K: float | None


@dataclass(frozen=True)
class GroupChecks:
    """All checks of a group that need no other group."""

    fit: FitChecks
    reaction: ReactionChecks
    reflex: ReflexChecks
    slope: SlopeChecks

    def columns(self) -> dict[str, object]:
        return {
            **asdict(self.fit),
            **asdict(self.reaction),
            **asdict(self.reflex),
            **asdict(self.slope),
        }


def check_group(headline: GroupHeadline) -> GroupChecks:
    """Check the result of a group."""
    certain = certain_reactions(headline)
    return GroupChecks(
        fit=check_fit(headline),
        reaction=check_reaction(headline, certain),
        reflex=check_reflex(headline, is_certain=REFLEX in certain),
        slope=check_slope(headline, is_certain=SLOPING in certain),
    )


def check_fit(headline: GroupHeadline) -> FitChecks:
    """Compare the fit to the mean response with single fits and with ordinary gait."""
    responses = headline.responses
    ensemble = headline.ensemble
    fit = headline.ensemble.fit
    window = responses[0].window
    signs = signs_of(responses)
    motion = ensemble.motion[window]
    torque = ensemble.torque[window]
    of_gait = np.mean([gait_torque(response, fit)[:, window] for response in responses], axis=0)
    single_fits = [fit_response(response) for response in responses]
    offset = compare_offset(motion, torque, fit["K"])
    stance = stance_changes(responses)
    return FitChecks(
        coherence=coherence_of(responses),
        VAF=fit.vaf,
        residual_over_gait=residual_over_gait(motion, torque, of_gait),
        offset_share=offset.lowers_K if np.isfinite(offset.lowers_K) else None,
        estimator_difference=estimator_difference(headline, single_fits, signs),
        heterogeneity=heterogeneity_of(single_fits, signs),
        K=fit["K"],
        B=fit["B"],
        K_se_share=headline.resampled.se("K") / abs(fit["K"]) if fit["K"] else None,
        B_high=headline.resampled.interval("B")[1],
        I_high=headline.resampled.interval("I")[1],
        stance_change=stance.mean,
        uncorrected_stance_change=stance.uncorrected,
        predicted_share=headline.predicted_share,
    )


def estimator_difference(
    headline: GroupHeadline, single_fits: Sequence[LinearFit], signs: Signs
) -> float:
    """Largest distance of ensemble and mean of perturbations, in halves of both intervals."""
    fit = headline.ensemble.fit
    distances = [0.0]
    for name in ESTIMATED:
        low, high = headline.resampled.interval(name)
        singles = [single[name] for single in single_fits]
        mean = over_repeats(singles, headline.errors.common.get(name, ()), signs)
        width = high - low + mean.high - mean.low
        if width > 1e-9 * abs(fit[name]):  # intervals of crossings that are all equal have no width
            distances.append(2 * abs(fit[name] - mean.mean) / width)
    return max(distances)


def heterogeneity_of(single_fits: Sequence[LinearFit], signs: Signs) -> float | None:
    """Cochran's Q of single stiffnesses over its degrees of freedom.

    Each direction has its own mean, because a torque after any turn parts them.
    """
    K = np.array([fit["K"] for fit in single_fits])
    se = np.array([fit.se("K") for fit in single_fits])
    variance = se**2 + (LEAST_SE_SHARE * K.mean()) ** 2
    if not np.isfinite(se).all() or not (variance > 0).all():
        return None
    directions = np.unique(signs)
    means = [
        np.average(K, weights=(signs == direction) / variance) * (signs == direction)
        for direction in directions
    ]
    Q = np.sum((K - np.sum(means, axis=0)) ** 2 / variance)
    return float(Q / (len(K) - len(directions)))


def coherence_of(responses: Sequence[PerturbationResponse]) -> float:
    """RMS angle of the mean response over that of single ones, without their gait.

    Equal turns cancel by nothing but gait: what it scatters in small ones is no other direction or
    onset.
    """
    window = responses[0].window
    angles = np.array([response.sign * response.fitted_motion.theta for response in responses])
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


def t_ratio(effect: Effect) -> float:
    """Size over standard error, which crossings that are all equal leave without any."""
    return effect.size / max(effect.se, 1e-9 * abs(effect.size), np.finfo(float).tiny)


def certain_reactions(headline: GroupHeadline) -> list[str]:
    """Effects beyond Eq. 15 that are certain, the likeliest first.

    An effect that yields does not count: a leg's drivetrain looks like that. Nor does
    co-contraction that the jerk explains.
    """
    reactions = headline.reactions
    strength = {name: t_ratio(effect) for name, effect in reactions.sizes.items()}
    strength[STIFFER] = min(strength[STIFFER], t_ratio(reactions.with_jerk[STIFFER]))
    freedom = headline.resampled.degrees_of_freedom
    limit = float(scipy.special.stdtrit(freedom, CERTAIN_PROBABILITY))
    certain = [name for name in REACTIONS if strength[name] > limit]
    return sorted(certain, key=lambda name: -strength[name])


def ensemble_columns(headline: GroupHeadline) -> Motion:
    """The mean motion as columns (k, 1), as of one sample."""
    motion = headline.ensemble.motion
    return Motion(motion.theta[:, None], motion.omega[:, None], motion.alpha[:, None])


def mean_reaction_columns(headline: GroupHeadline) -> dict[str, Array]:
    """Columns (window,) of `REACTIONS` of the mean response, the reflex at its best delay."""
    first = headline.responses[0]
    delay_s = 1e-3 * headline.reactions.delay_ms
    columns = reaction_columns(first.time, first.window, ensemble_columns(headline), delay_s)
    return {name: column[first.window, 0] for name, column in columns.items()}


def check_reaction(headline: GroupHeadline, certain: Sequence[str]) -> ReactionChecks:
    """Name the certain reactions, and the share of the torque of the likeliest."""
    if not certain:
        return ReactionChecks(None, None)
    likeliest = certain[0]
    size = headline.reactions.sizes[likeliest].size
    of_reaction = rms(size * mean_reaction_columns(headline)[likeliest])
    torque = headline.ensemble.torque[headline.responses[0].window]
    return ReactionChecks(" or ".join(certain), of_reaction / rms(torque))


def half_interval(headline: GroupHeadline) -> float:
    """Student's t of a 95 % interval: half its width in standard errors."""
    return float(scipy.special.stdtrit(headline.resampled.degrees_of_freedom, 0.975))


def check_slope(headline: GroupHeadline, is_certain: bool) -> SlopeChecks:
    """Compute what a slope of K over stance, or a torque after any turn, would change."""
    first = headline.responses[0]
    motion = headline.ensemble.motion
    window = first.window
    stance = float(np.mean([response.stance for response in headline.responses]))  # [s]
    K_of, B_of, _ = np.linalg.pinv(motion[window].columns)  # weights of the torque in K and B

    low, high = None, None
    if not is_certain:
        half = half_interval(headline)
        # [N*m/rad per stance]
        reactions = headline.reactions
        slopes = [reactions.alone[SLOPING], reactions.with_jerk[SLOPING]]
        lows = [slope.size * stance - half * (slope.se * stance) for slope in slopes]
        highs = [slope.size * stance + half * (slope.se * stance) for slope in slopes]
        low, high = min(0.0, *lows), max(0.0, *highs)
    ramp = mean_reaction_columns(headline)[RAMP]
    of_slope = (motion.theta * first.time)[window]
    difference = headline.directions.get(UP_MINUS_DOWN)
    return SlopeChecks(
        hidden_slope_low=low,
        hidden_slope_high=high,
        K_per_torque=float(K_of @ ramp / ramp[-1]),
        B_per_slope=float(B_of @ of_slope) / stance,
        common_K=None if difference is None else 0.5 * difference.estimates["K"],
    )


def check_reflex(headline: GroupHeadline, is_certain: bool) -> ReflexChecks:
    """Compute K with a certain reflex, or the strongest reflex that the window may hide."""
    first = headline.responses[0]
    ensemble = headline.ensemble
    window = first.window
    reactions = headline.reactions
    half = half_interval(headline)
    low, high = headline.resampled.interval("K")
    enough_s = 2 * 1e-3 * REFLEX_DELAYS_MS[-1]  # a window of twice the longest delay shows it
    is_long_enough = not first.time[window.stop] < enough_s - 1e-9
    longer_window_s = None if is_long_enough else enough_s

    motion = ensemble_columns(headline)
    stretches = {}
    for delay_ms in REFLEX_DELAYS_MS:
        column = reflex_column(first.time, window, motion, 1e-3 * delay_ms)
        stretches[delay_ms] = column[window, 0]
    if is_certain:
        delay_ms = reactions.delay_ms
        gain = reactions.reflexes[delay_ms].size
        share = np.var(gain * stretches[delay_ms]) / np.var(ensemble.torque[window])
        lows = [K.size - half * K.se for K in reactions.K_with_reflex.values()]
        highs = [K.size + half * K.se for K in reactions.K_with_reflex.values()]
        return ReflexChecks(
            reflex_delay_ms=float(delay_ms),
            reflex_gain=gain,
            reflex_share=100 * float(share),
            K_with_reflex=reactions.K_with_reflex[delay_ms].size,
            K_with_reflex_low=min(lows),
            K_with_reflex_high=max(highs),
            reflex_K_widths=in_widths(max(highs) - min(lows), high - low),
            longer_window_s=longer_window_s,
        )

    K_of = np.linalg.pinv(ensemble.motion[window].columns)[0]  # weights of the torque in K
    largest_gain = {
        delay_ms: gain.size + half * gain.se for delay_ms, gain in reactions.reflexes.items()
    }
    added_K = {
        delay_ms: largest_gain[delay_ms] * float(K_of @ stretch)
        for delay_ms, stretch in stretches.items()
    }
    # of equal ones the later
    worst_ms = max(REFLEX_DELAYS_MS, key=lambda delay_ms: (added_K[delay_ms], delay_ms))
    return ReflexChecks(
        hidden_reflex=largest_gain[worst_ms],
        hidden_reflex_ms=float(worst_ms),
        hidden_reflex_K=added_K[worst_ms],
        hidden_reflex_K_widths=in_widths(added_K[worst_ms], high - low),
        longer_window_s=longer_window_s,
    )


def in_widths(change: float, width: float) -> float:
    """A change over the width of an interval, 1e9 at most: equal crossings have no width."""
    return change / max(width, 1e-9 * abs(change), np.finfo(float).tiny)


@dataclass(frozen=True)
class WitnessChecks:
    """What encoder and unloaded plate say of K, and what errors that nothing shows do to it."""

    encoder_rms_deg: float | None
    encoder_delay_ms: float | None
    plate_height_m: float | None
    plate_ringing_hz: float | None
    plate_unexplained: float | None
    plate_zeroed: float | None
    load_error: float | None
    load_judged_by: str | None
    load_slack: float | None
    weight_change: float | None
    pressure_outside_m: float | None
    filled_share: float | None
    filled_fitted: float | None
    K_by_unexplained: float | None
    B_by_unexplained: float | None
    I_by_unexplained: float | None
    shoe_share: float | None
    K_by_encoder: float | None
    height_share: float | None
    late_K_per_ms: float | None
    late_B_per_ms: float | None
    plate_K_per_m: float | None
    moment_K_per_percent: float | None
    stiff_shoe_K: float | None


def check_witnesses(
    crossings: Sequence[Crossing], K: float, sensitivity: pl.DataFrame
) -> WitnessChecks:
    """Ask the joint's encoder and the unloaded plate about the stiffness K of a group.

    `sensitivity` has the group's rows of `walking_sensitivity.csv`.
    """
    changes = {row["error"]: row for row in sensitivity.rows(named=True)}
    late = changes.get(LOG_ERRORS["torque_lag"].words)
    height_error = changes.get(LABORATORY_ERRORS["corners_height"].words)
    moments = changes.get(LABORATORY_ERRORS["moments"].words)
    of_plate = changes.get(LABORATORY_ERRORS["plate_inertia"].words)
    shoe = changes.get(LABORATORY_ERRORS["shoe"].words)

    compliance = mean_quality(crossings, "shoe_compliance")
    height = mean_quality(crossings, "plate_height_m")
    unexplained = mean_quality(crossings, "plate_unexplained")
    K_per_m = None  # of the corners' height
    if late is None:
        K_per_m = height_error["K"] / HEIGHT_ERROR_M if height_error else 0.0
    gain = check_gain(known_loads(crossings))
    by_unexplained: dict[str, float] = {}
    if of_plate is not None and unexplained is not None:
        # the row is of 1 % of the plate's wrench
        by_unexplained = {name: 100 * unexplained * of_plate[name] for name in ESTIMATED}
    return WitnessChecks(
        encoder_rms_deg=mean_quality(crossings, "encoder_rms_deg"),
        encoder_delay_ms=mean_quality(crossings, "encoder_delay_ms"),
        plate_height_m=height,
        plate_ringing_hz=mean_quality(crossings, "plate_ringing_hz"),
        plate_unexplained=unexplained,
        plate_zeroed=mean_quality(crossings, "plate_zeroed"),
        load_error=gain.load_error,
        load_judged_by=gain.load_judged_by,
        load_slack=gain.load_slack,
        weight_change=gain.weight_change,
        pressure_outside_m=mean_quality(crossings, "pressure_outside_m"),
        filled_share=mean_quality(crossings, "filled_share"),
        filled_fitted=mean_quality(crossings, "filled_fitted"),
        K_by_unexplained=by_unexplained.get("K"),
        B_by_unexplained=by_unexplained.get("B"),
        I_by_unexplained=by_unexplained.get("I"),
        shoe_share=None if compliance is None else K * compliance,
        # two springs in series: 1/K = 1/K_joint + compliance
        K_by_encoder=None if compliance is None else K / (1 - K * compliance),
        height_share=None if height is None or K_per_m is None else K_per_m * height / K,
        late_K_per_ms=late["K"] if late else None,
        late_B_per_ms=late["B"] if late else None,
        plate_K_per_m=K_per_m,
        moment_K_per_percent=moments["K"] if moments else None,
        stiff_shoe_K=shoe["K"] if shoe else None,
    )


def known_loads(crossings: Sequence[Crossing]) -> KnownLoads:
    """Mean loads over crossings, which tell the gain of the platform's plate."""
    weights = [weight_of(crossing.body_mass) for crossing in crossings]
    known_weights = [weight for weight in weights if weight is not None]
    return KnownLoads(
        weight=float(np.mean(known_weights)) if known_weights else None,
        standing=mean_quality(crossings, "standing_N"),
        standing_beside=mean_quality(crossings, "standing_beside_N"),
        stride=mean_quality(crossings, "stride_N"),
        stride_beside=mean_quality(crossings, "stride_beside_N"),
    )


def mean_quality(crossings: Sequence[Crossing], column: str) -> float | None:
    """Mean of a column of quality over the crossings that have it."""
    values = [getattr(crossing.quality, column) for crossing in crossings]
    present = [value for value in values if value is not None]
    return float(np.mean(present)) if present else None


@dataclass(frozen=True)
class SetUpDifference:
    """What stands most otherwise in the crossings than in the static trial; None if unknown."""

    different: str | None
    different_mm: float | None  # mean over the crossings in which it is the largest difference


def set_up_difference(crossings: pl.DataFrame) -> SetUpDifference:
    """Find the largest difference that half of the perturbed, or of the unperturbed, crossings have
    in rows of `walking_crossings.csv`."""
    if "different" not in crossings.columns:
        return SetUpDifference(None, None)
    largest = SetUpDifference(None, None)
    for of_kind in crossings.drop_nulls("different").partition_by("perturbed"):
        for of_what in of_kind.partition_by("different"):
            mean_mm = float(of_what["different_mm"].cast(pl.Float64).mean())  # type: ignore[arg-type]
            if 2 * len(of_what) >= len(of_kind) and mean_mm > (largest.different_mm or 0.0):
                largest = SetUpDifference(of_what["different"][0], mean_mm)
    return largest


@dataclass(frozen=True)
class MomentError:
    """By what share the plate's moments are too large; None where it cannot be told."""

    certain_moment_error: float | None  # beyond 4 standard errors
    moment_error_half: float | None  # half a 95 % interval


def moment_error(crossings: pl.DataFrame) -> MomentError:
    """Compare where the foot stands with where the moments place its pressure.

    The foot stands elsewhere in each crossing, and the centre of pressure must move with it. In the
    foot's own axes, and with moments too large by a share e, it is seen from the ankle at

        m + R d + e (a - c),

    with its place m under the foot, the ankle a, the plate's centre c, and an error d of the
    plate's place, which R turns into the foot's axes. So people may walk in any directions; d is
    told from m where they walk in more than one.

    Six rows of `walking_crossings.csv` are needed that are undisturbed until 38 % of stance.
    """
    places = ["foot_forward_m", "foot_left_m"]
    pressures = ["pressure_ahead_m", "pressure_beside_m"]
    columns = [*places, *pressures, "heading_deg"]
    if not {*columns, "onset_phase"} <= set(crossings.columns):
        return MomentError(None, None)
    undisturbed = pl.col("onset_phase").cast(pl.Float64).fill_null(1.0) > UNDISTURBED_PHASE
    used = crossings.filter(pl.col("reason").is_null(), undisturbed).drop_nulls(columns)
    if len(used) < FEWEST_FOR_MOMENTS:
        return MomentError(None, None)

    heading = np.deg2rad(used["heading_deg"].to_numpy())
    cosine, sine = np.cos(heading), np.sin(heading)
    one, none = np.ones(len(used)), np.zeros(len(used))
    along_the_foot = np.column_stack([one, none, cosine, sine])
    to_its_left = np.column_stack([none, one, -sine, cosine])
    constants = np.vstack([along_the_foot, to_its_left])  # of m and d
    vectors, sizes, _ = np.linalg.svd(constants, full_matrices=False)
    basis = vectors[:, sizes > SMALLEST_TURN * sizes[0]]
    foot = used.select(places).to_numpy().T.ravel()
    pressure = used.select(pressures).to_numpy().T.ravel()
    foot = foot - basis @ (basis.T @ foot)
    pressure = pressure - basis @ (basis.T @ pressure)

    square = float(foot @ foot) or 1.0
    error = float(foot @ pressure) / square
    freedom = len(foot) - basis.shape[1] - 1
    se = float(np.sqrt(np.sum((pressure - error * foot) ** 2) / freedom / square))
    certain = max(abs(error) - CERTAIN_MOMENT_SES * se, 0.0)
    return MomentError(float(np.sign(error) * certain), 2 * se)
