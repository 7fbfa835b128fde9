"""The walking tables, as rows and frames: single perturbations, groups, their headline, limits'
columns, figures.

The residual of a fit is compared with what ordinary gait leaves: each unperturbed crossing's
deviation from their mean, fitted with the same columns. One that is a small share of the torque
does not count, however regular the gait."""

import re
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from typing import Any

import numpy as np
import polars as pl
import scipy

from osl_analysis.signals import Motion
from osl_analysis.stats.regression import LinearFit, estimates_row
from osl_analysis.stats.repeats import over_repeats
from osl_analysis.trial import REFLEX_DELAYS_MS, Array, rms
from osl_analysis.walking import response as isolation
from osl_analysis.walking.crossing import DOWN, LABORATORY_ERRORS, LOG_ERRORS, UP, Crossing
from osl_analysis.walking.groups import ALL, SEPARATOR, STATED, Cells, Sheet, cells_said
from osl_analysis.walking.response import (
    PHASES,
    Bootstrap,
    GroupHeadline,
    PerturbationResponse,
    UnperturbedGait,
)
from osl_analysis.walking.settings import ResponseSettings, TimingSettings, UnseenError

GROUP_QUANTITIES, ENSEMBLE = ("K", "B", "I", "VAF"), "ensemble"
COMMANDED = "commanded"  # Series of the curve that the controller commands
FACTS = ("group", "onset_phase", "fitted_phase", "end_phase")
Numbers = dict[str, float | None]


def group_rows(
    selection: pl.DataFrame, sheet: Sheet, gaits: Mapping[str, UnperturbedGait], window: float
) -> list[dict[str, Any]]:
    """Rows of `walking_groups.csv` before any fit, sorted by shared conditions (numbers as
    numbers), direction, phase. A gait without a used perturbed crossing is a group without
    crossings."""
    perturbed, found = (
        selection.filter(pl.col("perturbed")),
        list[tuple[tuple[object, ...], dict[str, Any]]](),
    )
    parts = [
        (own["group"][0], own)
        for own in perturbed.drop_nulls("group").partition_by("group", maintain_order=True)
    ]
    known = {members["gait"][0] for _, members in parts}
    others = perturbed.filter(~pl.col("gait").is_in(known)).partition_by(
        "gait", maintain_order=True
    )
    for name, members in [*parts, *((members["gait"][0], members) for members in others)]:
        gait, used = members["gait"][0], members.drop_nulls("group")
        of_gait = selection.filter(pl.col("gait").str.split(SEPARATOR).list.contains(gait))
        kept, lost = (
            of_gait.filter(pl.col("reason").is_null() == is_used) for is_used in (True, False)
        )
        cells, pooled = shared_cells([sheet[trial] for trial in members["trial"]])
        row = {
            "group": name,
            "gait": gait,
            **{("group_stated" if key == "group" else key): value for key, value in cells.items()},
            "pooled": pooled if len(used) else None,
            **timing_facts(used, gaits[gait].stance if gait in gaits else np.zeros(0), window),
            **moment_error(of_gait),
            "left_out_share": (
                of_gait.group_by("perturbed")
                .agg(pl.col("reason").count() / pl.len())["reason"]
                .max()
            ),
            "left_out_by": parted_by(kept, lost, sheet) if len(lost) else None,
        }
        conditions = [
            (cell is None, isinstance(cell, str), "" if cell is None else cell)
            for cell in cells.values()
        ]
        turned = str(used["direction"][0]) if "direction " in name else ""
        phase = float(used["onset_phase"].cast(pl.Float64).mean()) if len(used) else np.inf  # type: ignore[arg-type]
        found.append(((*conditions, turned, phase, name), row))
    return [row for _, row in sorted(found, key=lambda pair: pair[0])]


def shared_cells(rows: Sequence[Cells]) -> tuple[dict[str, object], str | None]:
    """The cells in which all rows of the sheet agree (others are None), and a text on those with
    several values."""
    stated = {key: {row.get(key) for row in rows} for key in STATED}
    several = (
        f"{key} {cells_said(values)}" for key, values in stated.items() if len(values - {None}) > 1
    )
    cells = {
        key: next(iter(values)) if len(values) == 1 else None for key, values in stated.items()
    }
    return cells, "; ".join(several) or None


def timing_facts(used: pl.DataFrame, stances: Array, window: float) -> dict[str, object]:
    """Columns of `walking_groups.csv`: numbers of crossings that are used, the unperturbed ones'
    durations of stance [s], and the phases of onsets and of the end of the window [s]."""
    phases, down = (
        used["onset_phase"].cast(pl.Float64).to_numpy(),
        int((used["direction"] == DOWN).sum()),
    )
    stance = float(np.mean(stances)) if len(stances) else None
    onset = float(np.mean(phases)) if len(phases) and stance else None
    return {
        "n": len(phases),
        "n_up": len(phases) - down,
        "n_down": down,
        "n_unperturbed": len(stances),
        "stance_s": stance,
        "unperturbed_stance_sd": (
            float(np.std(stances, ddof=1) / np.mean(stances)) if len(stances) > 1 else None
        ),
        "onset_phase": onset,
        "onset_phase_sd": float(np.std(phases, ddof=1)) if len(phases) > 1 else None,
        "end_phase": onset + window / stance if onset is not None and stance else None,
    }


PARTING = {
    "stance_s": 0.01, "load_of_weight": 0.03, "foot_forward_m": 0.01, "foot_left_m": 0.01,
    "gait_deviation_deg": 0.5,
    "torque_deviation": 2.0,
}  # fmt: skip
"""Columns of `walking_crossings.csv` that may separate used from left-out crossings, with the least
difference."""


def parted_by(used: pl.DataFrame, lost: pl.DataFrame, sheet: Sheet) -> str:
    """What parts the crossings that are left out from the used ones: a column of the sheet, or the
    first of `PARTING` in which nine tenths of each lie on their side of the middle of both medians;
    and what both have."""
    for key in STATED:
        of_used, of_lost = (
            {sheet[trial].get(key) for trial in some["trial"]} for some in (used, lost)
        )
        if of_used and of_lost and not of_used & of_lost:
            return f"{key}, {cells_said(of_used)} and {cells_said(of_lost)}"
    for name, least in PARTING.items():
        here, there = (some[name].drop_nulls().cast(pl.Float64).to_numpy() for some in (used, lost))
        if min(len(here), len(there)) < 3:
            continue
        usual, other = float(np.median(here)), float(np.median(there))
        way, middle = np.sign(other - usual), (usual + other) / 2
        beside = np.mean(way * (middle - here) > 0), np.mean(way * (there - middle) > 0)
        if abs(other - usual) > least and min(beside) >= 0.9:
            return f"{name}, {usual:.3g} and {other:.3g}"
    return "no column"


def moment_error(crossings: pl.DataFrame) -> dict[str, float | None]:
    """By what share the plate's moments are too large: certainly (beyond 4 standard errors) and at
    most (half a 95 % interval). The foot stands elsewhere in each crossing, and the centre of
    pressure must move with it. Null without six crossings undisturbed until 38 % of stance."""
    columns = ["foot_forward_m", "foot_left_m", "pressure_ahead_m", "pressure_beside_m"]
    none: dict[str, float | None] = {"certain_moment_error": None, "moment_error_half": None}
    if not {*columns, "onset_phase"} <= set(crossings.columns):
        return none
    still = pl.col("onset_phase").cast(pl.Float64).fill_null(1.0) > 0.38
    used = crossings.filter(pl.col("reason").is_null(), still).drop_nulls(columns)
    if len(used) < 6:
        return none
    values = used.select(columns).to_numpy()
    foot, pressure = np.hsplit(values - values.mean(axis=0), 2)
    size = float(np.sum(foot**2)) or 1.0
    error = float(np.sum(foot * pressure)) / size
    se = float(np.sqrt(np.sum((pressure - error * foot) ** 2) / (2 * len(used) - 3) / size))
    return {
        "certain_moment_error": float(np.sign(error) * max(abs(error) - 4 * se, 0.0)),
        "moment_error_half": 2 * se,
    }


def fitted_time(headline: GroupHeadline) -> float:
    """Time [s] after the onset at which the fit reads a stiffness that changes linearly within the
    window. The fit's K is a sum of torques with weights w, where w . theta = 1. So it is K(t) at t
    = sum of w theta t, after the middle."""
    response, motion = headline.responses[0], headline.ensemble.motion[headline.responses[0].window]
    return float(
        np.linalg.pinv(motion.columns)[0] @ (motion.theta * response.time[response.window])
    )


def perturbation_row(
    crossing: Crossing, gait: UnperturbedGait, settings: ResponseSettings
) -> dict[str, object]:
    """One row of `walking.csv`: the fit of Eq. 15 to the isolated response of one crossing."""
    response = isolation.isolate_response(crossing, gait, settings, settings.perturbed_stance)
    fit, onset = isolation.fit_response(response), crossing.onset or 0.0
    return {
        "trial": crossing.name,
        "onset_s": onset,
        "onset_phase": float(crossing.stance.phase(np.array(onset))),
        "stance_s": crossing.stance.duration,
        "phase_stance_s": response.stance,
        "bridged": crossing.bridged,
        **estimates_row(fit, "K", "B", "I"),
        **single_facts(response, fit),
        **{name: crossing.quality.get(name) for name in ("encoder_rms_deg", "filled_fitted")},
        "interval_method": fit.interval_method,
        "VAF": fit.vaf,
        "condition_number": fit.condition_number,
    }


def single_facts(response: PerturbationResponse, fit: LinearFit) -> Numbers:
    """Columns of `walking.csv`: residual and offset of one fit over those that ordinary gait
    causes, and the change of stance. Null if the residual is a small share of the torque, the
    offset hardly changes K, or no stance is known."""
    motion, torque = response.fitted_motion, response.fitted_torque
    left = isolation.gait_torque(response, fit)[:, response.window]
    offset, share = isolation.offset_comparison(motion, torque, fit["K"])
    columns = np.column_stack([motion.columns, np.ones_like(motion.theta)])
    scatter = float(np.std(np.linalg.lstsq(columns, left.T, rcond=None)[0][-1], ddof=1))
    counts = abs(share) > 0.15 and scatter > 0  # by less an offset hardly changes K
    return {
        "residual_over_gait": residual_over_gait(motion, torque, left),
        "offset_over_gait": abs(offset) / scatter if counts else None,
        "stance_change": response.stance_change if np.isfinite(response.stance_change) else None,
    }


def group_facts(headline: GroupHeadline) -> dict[str, object]:
    """Columns of `walking_groups.csv` on which limits may stand; the dictionary of tables says what
    each is."""
    ensemble, responses = headline.ensemble, headline.responses
    rows, fit = responses[0].window, ensemble.fit
    motion, torque = ensemble.motion[rows], ensemble.torque[rows]
    left = np.mean([isolation.gait_torque(r, fit)[:, rows] for r in responses], axis=0)
    intervals = {name: headline.resampled.interval(name) for name in "KBI"}
    _, share = isolation.offset_comparison(motion, torque, fit["K"])
    singles, signs = [isolation.fit_response(r) for r in responses], isolation.signs_of(responses)
    # of ensemble and mean of perturbations, over the sum of the halves of both intervals
    distances = [0.0]
    for name, (low, high) in intervals.items():
        mean = over_repeats([one[name] for one in singles], headline.common.get(name, ()), signs)
        width = high - low + mean.high - mean.low
        if width > 1e-9 * abs(fit[name]):  # intervals of crossings that are all equal have no width
            distances.append(2 * abs(fit[name] - mean.mean) / width)
    # Cochran's Q of single stiffnesses over its degrees of freedom; standard errors of at least 3 %
    # of the mean
    K, se = np.array([(one["K"], one.se("K")) for one in singles]).T
    variance, heterogeneity, ways = se**2 + (0.03 * K.mean()) ** 2, None, np.unique(signs)
    # a torque after any turn parts both directions
    if np.isfinite(se).all() and (variance > 0).all():
        mean = np.sum(
            [np.average(K, weights=(signs == way) / variance) * (signs == way) for way in ways],
            axis=0,
        )
        heterogeneity = float(np.sum((K - mean) ** 2 / variance) / (len(K) - len(ways)))
    # Equal turns cancel by nothing but gait: what it scatters in small ones is no other direction
    # or onset
    angles = np.array([r.sign * r.fitted_motion.theta for r in responses])
    of_gait = float(np.mean([r.thetas[:, rows].var(axis=0, ddof=1) for r in responses]))
    turned = max(rms(angles) ** 2 - of_gait, rms(angles.mean(axis=0)) ** 2)
    # How far the stance by which phase is computed differs from the one that was to be expected, if
    # that is certain
    known = np.array(
        [(r.stance_change, r.stance_error) for r in responses if np.isfinite(r.stance_change)]
    )
    change, uncorrected = None, None
    if len(known) > 1:
        change, error = known.mean(axis=0).tolist()
        certain = abs(error) > 3 * float(known[:, 1].std(ddof=1)) / np.sqrt(len(known))
        uncorrected = error if certain else None
    return {
        # 1 for equal responses, 0 if they cancel
        "coherence": rms(angles.mean(axis=0)) / float(np.sqrt(turned)),
        "VAF": fit.vaf,
        "residual_over_gait": residual_over_gait(motion, torque, left),
        "offset_share": share if np.isfinite(share) else None,
        "estimator_difference": max(distances),
        "heterogeneity": heterogeneity,
        "K": fit["K"],
        "B": fit["B"],
        "K_se_share": headline.resampled.se("K") / abs(fit["K"]) if fit["K"] else None,
        "B_high": intervals["B"][1],
        "I_high": intervals["I"][1],
        "stance_change": change,
        "uncorrected_stance_change": uncorrected,
        "predicted_share": headline.share,
    } | reaction_facts(headline)


def reaction_facts(headline: GroupHeadline) -> dict[str, object]:
    """Columns of `walking_groups.csv` on effects beyond Eq. 15: the person reacts within the
    window, or K changes with stance. An effect is certain beyond Student's t at 0.1 %, because
    several are tried, the likeliest first. An effect that yields does not count: a leg's drivetrain
    looks like that. Nor does co-contraction that the jerk explains."""
    first, drawn = headline.responses[0], headline.resampled
    rows, found = first.window, drawn.reactions
    motion, torque = headline.ensemble.motion, headline.ensemble.torque
    t = {
        name: size / max(se, 1e-9 * abs(size), np.finfo(float).tiny)
        for name, (size, se) in found.items()
    }
    strength = {name: t[name] for name in isolation.REACTIONS}
    strength[isolation.STIFFER] = min(t[isolation.STIFFER], t[f"{isolation.STIFFER} and jerk"])
    limit, half = (
        float(scipy.special.stdtrit(drawn.degrees_of_freedom, p)) for p in (0.999, 0.975)
    )
    certain = sorted(
        (name for name in strength if strength[name] > limit), key=lambda name: -strength[name]
    )
    likely, per_stance = (
        certain[0] if certain else None,
        float(np.mean([r.stance for r in headline.responses])),
    )
    columns = Motion(*(np.c_[x] for x in (motion.theta, motion.omega, motion.alpha)))
    drawn_as = isolation.reaction_columns(first.time, rows, columns, 1e-3 * found["delay"][0])
    shapes = dict(zip(isolation.REACTIONS, drawn_as, strict=True))
    share, ramp = None, shapes[isolation.RAMP][rows, 0]
    if likely is not None:
        share = rms(found[likely][0] * shapes[likely][rows]) / rms(torque[rows])
    either = (
        np.array([found[isolation.SLOPING], found[f"{isolation.SLOPING} and jerk"]]) * per_stance
    )
    low, high = (either @ [[1, 1], [-half, half]]).T
    inverse = np.linalg.pinv(motion[rows].columns)
    per_slope = float(inverse[1] @ (motion.theta * first.time)[rows]) / per_stance
    both = headline.directions.get("up minus down")
    hidden = (None, None) if isolation.SLOPING in certain else (min(0.0, *low), max(0.0, *high))
    return {
        "reaction": " or ".join(certain) or None,
        "reaction_share": share,
        **reflex_facts(headline, isolation.REFLEX in certain),
        "hidden_slope_low": hidden[0],
        "hidden_slope_high": hidden[1],
        "K_per_torque": float(inverse[0] @ ramp / ramp[-1]),
        "B_per_slope": per_slope,
        # what the same torque after either turn adds to K of turns up and takes off K of turns down
        "common_K": None if both is None else 0.5 * both[0]["K"],
    }


def reflex_facts(headline: GroupHeadline, certain: bool) -> Numbers:
    """Columns of `walking_groups.csv`: a certain reflex and K with it in the model, else null;
    without one, the strongest reflex that the window may hide; and the change of K by either, in
    widths of its interval."""
    first, drawn = headline.responses[0], headline.resampled
    rows, found, names = (
        first.window,
        drawn.reactions,
        [f"K_with_reflex{end}" for end in ("", "_low", "_high")],
    )
    half, (low, high) = (
        float(scipy.special.stdtrit(drawn.degrees_of_freedom, 0.975)),
        drawn.interval("K"),
    )
    motion = Motion(*(np.c_[x] for x in vars(headline.ensemble.motion).values()))
    past = {
        ms: isolation.reflex_column(first.time, rows, motion, 1e-3 * ms)[rows, 0]
        for ms in REFLEX_DELAYS_MS
    }
    enough_s = 2e-3 * REFLEX_DELAYS_MS[-1]
    facts: Numbers = dict.fromkeys(
        ("reflex_delay_ms", "reflex_gain", "reflex_share", *names, "reflex_K_widths")
    )
    facts |= dict.fromkeys(
        ("hidden_reflex", "hidden_reflex_ms", "hidden_reflex_K", "hidden_reflex_K_widths")
    )
    facts["longer_window_s"] = enough_s if first.time[rows.stop] < enough_s - 1e-9 else None
    if certain:
        (gain, _), (delay, _) = (found[name] for name in (isolation.REFLEX, "delay"))
        K, each = (
            found[f"K with {isolation.REFLEX} {delay:.0f}"][0],
            [v for k, v in found.items() if "K with" in k],
        )
        ends = min(one - half * se for one, se in each), max(one + half * se for one, se in each)
        share = 100 * float(
            np.var(gain * past[round(delay)]) / np.var(headline.ensemble.torque[rows])
        )
        facts |= {"reflex_delay_ms": delay, "reflex_gain": gain, "reflex_share": share}
        facts |= dict(zip(names, (K, *ends), strict=True))
        facts |= {"reflex_K_widths": in_widths(ends[1] - ends[0], high - low)}
        return facts
    leak = np.linalg.pinv(headline.ensemble.motion[rows].columns)[0]  # of a torque into K
    most = {ms: size + half * se for ms in past for size, se in [found[f"{isolation.REFLEX} {ms}"]]}
    added, ms = max((most[ms] * float(leak @ past[ms]), ms) for ms in past)
    hidden = {"hidden_reflex": most[ms], "hidden_reflex_ms": float(ms), "hidden_reflex_K": added}
    return facts | hidden | {"hidden_reflex_K_widths": in_widths(added, high - low)}


def in_widths(change: float, width: float) -> float:
    """A change over the width of an interval, which crossings that are all equal leave without any:
    1e9 at most."""
    return change / max(width, 1e-9 * abs(change), np.finfo(float).tiny)


def series_of(group: str) -> str:
    """The name of a group without its timing."""
    return re.sub(r"timing [-\d]+ %(, )?", "", group).removesuffix(", ") or ALL


def with_slopes(facts: Sequence[dict[str, Any]]) -> list[dict[str, Any]]:
    """Rows of `walking_groups.csv` with the slope of K over stance between the neighbours of a
    group in timing, and the share of B that it makes, where it is certain (twice its standard
    error)."""
    rows = []
    for fact in facts:
        slope, share = None, None
        of = series_of(fact["group"])
        alike = [one for one in facts if one.get("K") is not None and series_of(one["group"]) == of]
        alike = sorted(alike, key=lambda one: one["fitted_phase"])
        if fact in alike and len(alike) > 1:
            at = alike.index(fact)
            before, after = alike[max(at - 1, 0)], alike[min(at + 1, len(alike) - 1)]
            apart = after["fitted_phase"] - before["fitted_phase"]
            slope = (after["K"] - before["K"]) / apart if apart > 0 else None
            se = np.hypot(
                *(one["K"] * (one["K_se_share"] or 0.0) for one in (before, after))
            ) / max(apart, 1e-9)
            if slope is not None and abs(slope) > 2 * se and fact["B"]:
                share = slope * fact["B_per_slope"] / fact["B"]
        known = {"K_slope_timings": slope, "slope_share_timings": share}
        rows.append(
            fact
            | (
                known | {"B_without_slope": share and fact["B"] * (1 - share)}
                if "K" in fact
                else {}
            )
        )
    return rows


def sensitivity_table(
    group: str, headline: GroupHeadline, stated: Mapping[UnseenError, float], by_log: bool = False
) -> pl.DataFrame:
    """Rows of `walking_sensitivity.csv`: what each of `LABORATORY_ERRORS`, or of `LOG_ERRORS`,
    changes in the fit to the mean response, to first order, and the uncertainty of it that the
    settings state. Of what changes the torque: Eq. 15 fitted to the change."""
    responses, fit, window = headline.responses, headline.ensemble.fit, headline.responses[0].window
    weights = isolation.joining_weights(isolation.signs_of(responses))
    named, known = (
        LOG_ERRORS if by_log else LABORATORY_ERRORS,
        {str(name): size for name, size in stated.items()},
    )
    torques = np.tensordot(weights, [r.lab_errors[:, window] for r in responses], 1)
    found = np.linalg.lstsq(headline.ensemble.motion[window].columns, torques.T)[0].T
    changes = dict(zip(named, found, strict=False))
    if not by_log:
        K, B, I = (fit[name] for name in "KBI")
        changes["skin"] = named["skin"][1] / 100 * np.array([K, B, I])
        k = np.rad2deg(named["shoe"][1])
        # of 1/(1/Z - 1/k) with the fit's Z = K + B s + I s^2, the joint's, to the second power of s
        left = 1 - K / k
        changes["shoe"] = np.array(
            [K - K / left, B - B / left**2, I - I / left**2 - B**2 / (k * left**3)]
        )
    return pl.DataFrame(
        [
            {
                "group": group,
                "error": words,
                "size": size,
                "unit": unit,
                "stated": known.get(name, 0.0),
            }
            | dict(zip("KBI", change, strict=True))
            for name, change in changes.items()
            for words, size, unit in [named[name]]
        ]
    )


def witness_facts(
    turned: Sequence[Crossing], facts: Mapping[str, Any], sensitivity: pl.DataFrame
) -> dict[str, Any]:
    """Columns of `walking_groups.csv`: what the joint's encoder and the unloaded plate say of the
    stiffness of these crossings, whose angle is that of the markers, and what errors that no
    witness excludes do to K and B."""
    names = (
        "encoder_rms_deg", "encoder_delay_ms", "shoe_compliance", "plate_height_m",
        "plate_ringing_hz",
        "plate_unexplained", "pressure_outside_m", "filled_share", "filled_fitted",
    )  # fmt: skip
    known: dict[str, Any] = {}
    for name in names:
        values = [value for c in turned if (value := c.quality.get(name)) is not None]
        known[name] = float(np.mean(values)) if values else None
    known |= dict.fromkeys(
        (
            *(
                "K_by_unexplained",
                "B_by_unexplained",
                "I_by_unexplained",
                "shoe_share",
                "K_by_encoder",
                "height_share",
            ),
            *(
                "late_K_per_ms",
                "late_B_per_ms",
                "plate_K_per_m",
                "moment_K_per_percent",
                "stiff_shoe_K",
            ),
        )
    )
    compliance, height, K = known.pop("shoe_compliance"), known["plate_height_m"], facts["K"]
    if compliance is not None:
        known |= {"shoe_share": K * compliance, "K_by_encoder": K / (1 - K * compliance)}
    changes = {row["error"]: row for row in sensitivity.rows(named=True)}
    if late := changes.get(LOG_ERRORS["torque_lag"][0]):
        return known | {"late_K_per_ms": late["K"], "late_B_per_ms": late["B"]}
    kinds = ("corners_height", "moments", "plate_inertia")
    high, moments, of_plate = (changes.get(LABORATORY_ERRORS[kind][0]) for kind in kinds)
    known["plate_K_per_m"] = 100 * high["K"] if high else 0.0
    known["height_share"] = None if height is None else known["plate_K_per_m"] * height / K
    if of_plate and (left := known["plate_unexplained"]) is not None:
        known |= {f"{name}_by_unexplained": 100 * left * of_plate[name] for name in "KBI"}
    return known | {
        "moment_K_per_percent": moments["K"] if moments else None,
        "stiff_shoe_K": changes[LABORATORY_ERRORS["shoe"][0]]["K"],
    }


def residual_over_gait(motion: Motion, torque: Array, left: Array) -> float | None:
    """RMS residual of Eq. 15 over that of ordinary gait (crossings, k). Null below 3 % of the
    torque, or over 0."""
    columns = motion.columns
    own, gait = (
        rms(y - (columns @ np.linalg.lstsq(columns, y.T, rcond=None)[0]).T)
        for y in (torque[None], left)
    )
    return own / gait if own > 0.03 * rms(torque) and gait > 0 else None


def headline_rows(
    headline: GroupHeadline,
    fits: pl.DataFrame,
    doubtful: Mapping[str, int],
    stated: Mapping[str, float],
) -> list[dict[str, object]]:
    """Rows of `walking_summary.csv` of one group, from its rows of `walking.csv`, `fits`, their
    number of doubtful ones and the standard errors `stated` of K, B, I: mean per perturbation (of
    both directions' means), with the errors that are common; ensemble; directions. The intervals of
    the latter two are the bootstrap's, wider by what is stated. Of few crossings they are at least
    those of the unperturbed ones' scatter: a bootstrap does not leave the range of n crossings,
    outside of which the mean of all is with a probability of 2^(1 - n)."""
    common, signs = headline.common, isolation.signs_of(headline.responses)
    counts, freedom = np.unique(signs, return_counts=True)[1], common["K"][0][1]
    rows: list[dict[str, object]] = []
    for name in GROUP_QUANTITIES:
        mean = over_repeats(fits[name].to_numpy(), common.get(name, ()), signs)
        method = f"{mean.interval_method}{' + shared errors' * (name in common)}"
        known = {"quantity": name, "estimator": "mean of perturbations"}
        rows.append(known | asdict(mean) | {"interval_method": method} | dict(doubtful))

    def drawn(
        estimator: str, values: Mapping[str, float], resampled: Bootstrap, n: int, quantity: str
    ) -> dict[str, object]:
        # it cancels in the difference
        error = 0.0 if "minus" in estimator else stated.get(quantity, 0.0)
        value, se, ends, method = (
            values[quantity],
            resampled.se(quantity),
            resampled.interval(quantity),
            "bootstrap",
        )
        of = [n] if estimator in (UP, DOWN) else counts
        # the mean of all is outside of their range more often than in 5 %
        if quantity in common and min(of) < 6:
            halves = 1 if "minus" in estimator else len(of)
            scatter = float(np.sqrt(headline.of_one[quantity] * np.sum(1 / np.array(of)))) / halves
            half = float(-scipy.special.stdtrit(freedom, 0.025)) * scatter
            ends, se = (min(ends[0], value - half), max(ends[1], value + half)), max(se, scatter)
            method = "bootstrap, scatter of unperturbed crossings"
        low, high = (
            value + float(np.sign(end - value) * np.hypot(end - value, 1.96 * error))
            for end in ends
        )
        row = {"quantity": quantity, "estimator": estimator, "n": n, "mean": value, "sd": None}
        row |= {"se": float(np.hypot(se, error)), "low": low, "high": high}
        return row | {"interval_method": method + " + stated" * bool(error)}

    for estimator, ensemble, resampled in (
        (ENSEMBLE, headline.ensemble, headline.resampled),
        headline.other,
    ):
        estimates = ensemble.estimates()
        rows += [
            drawn(estimator, estimates, resampled, ensemble.n, quantity)
            for quantity in GROUP_QUANTITIES
        ]
    for quantity in "KBI":
        rows += [
            drawn(estimator, *found, quantity) for estimator, found in headline.directions.items()
        ]
    return rows


def response_table(group: str, headline: GroupHeadline) -> pl.DataFrame:
    """Isolated responses of a group: trial (or 'ensemble'), time [s], angle [deg], torque [N*m],
    fit in the window."""
    window, time, frames = headline.responses[0].window, headline.responses[0].time, []
    fitted = [(r.name, r.motion, r.torque, isolation.fit_response(r)) for r in headline.responses]
    mean = headline.ensemble
    for name, motion, torque, fit in [*fitted, (ENSEMBLE, mean.motion, mean.torque, mean.fit)]:
        model = np.full(len(time), np.nan)
        model[window] = motion.columns[window] @ fit.estimates
        columns = {"trial": pl.Series([name] * len(time)), "time": time}
        columns |= {"theta_deg": np.rad2deg(motion.theta), "torque": torque, "torque_model": model}
        frames.append(pl.DataFrame(columns)[: window.stop])
    table = pl.concat(frames).with_columns(pl.col("torque_model").fill_nan(None))
    return table.with_columns(group=pl.lit(group))


def walking_page_points(
    perturbed: Sequence[Crossing],
    gaits: Mapping[str, UnperturbedGait],
    responses: pl.DataFrame,
    timing: TimingSettings,
) -> pl.DataFrame:
    """Points of the walking page: gaits over stance [%], mean and SD; responses over time [ms],
    with the column `doubtful`, and their mean with its fit; window and baseline as mean phases [%]
    and times from the onset [ms]."""
    step = 4  # a hundred points of stance are enough for a curve
    frames, x = [], 100 * PHASES[::step]
    for name, gait in gaits.items():
        for panel, every in (("angle", np.rad2deg(gait.theta)), ("torque", gait.torque)):
            some = every[:, ::step]
            sd = some.std(axis=0, ddof=1) if len(some) > 1 else None
            points = pl.DataFrame(
                {"x": x, "mean": some.mean(axis=0), "sd": sd}, schema_overrides={"sd": pl.Float64}
            )
            labels = {"panel": pl.lit(panel), "curve": pl.lit(name), "n": pl.lit(len(gait.names))}
            frames.append(points.with_columns(**labels))
    turned = [(c.onset, c.stance) for c in perturbed if c.onset is not None]
    before = (-timing.guard_s - timing.baseline_s, -timing.guard_s)
    for name, ends in (("window", (0.0, timing.window_s)), ("baseline", before)):
        phases = [100 * stance.phase(onset + np.array(ends)) for onset, stance in turned]
        for panel, x in (
            ("angle", np.mean(phases, axis=0)),
            ("response angle", 1e3 * np.array(ends)),
        ):
            frames.append(pl.DataFrame({"panel": panel, "curve": name, "x": x}))
    curve = (
        pl.when(pl.col("trial") == ENSEMBLE)
        .then(pl.lit("mean"))
        .otherwise(pl.lit("each"))
        .alias("curve")
    )
    fit = responses.filter((pl.col("trial") == ENSEMBLE) & pl.col("torque_model").is_not_null())
    for of, doubts, panel, of_curve, column in (
        (responses, ["doubtful"], "response angle", curve, "theta_deg"),
        (responses, ["doubtful"], "response torque", curve, "torque"),
        (fit, [], "response torque", pl.lit("fit").alias("curve"), "torque_model"),
    ):
        time, values = (1e3 * pl.col("time")).alias("x"), pl.col(column).alias("mean")
        frames.append(
            of.select("trial", *doubts, time, of_curve, values, pl.lit(panel).alias("panel"))
        )
    return pl.concat(frames, how="diagonal")


def impedance_over_stance(summary: pl.DataFrame, groups: pl.DataFrame) -> pl.DataFrame:
    """Rows of `impedance_over_stance.csv` from `walking_summary.csv` and `walking_groups.csv`: K,
    B, I of every group at the phase that its fit reads. A series has the groups that differ in
    their timing only."""
    wanted = pl.col("quantity").is_in(["K", "B", "I"]) & pl.col("mean").is_not_null()
    ensemble = summary.filter((pl.col("estimator") == ENSEMBLE) & wanted)
    rows = ensemble.join(groups.select(FACTS), on="group", how="left", maintain_order="left")
    series = pl.Series("series", [series_of(name) for name in rows["group"]], dtype=pl.String)
    order = pl.col("quantity").replace_strict({"K": 0, "B": 1, "I": 2}, return_dtype=pl.Int64)
    table = rows.with_columns(series).sort(order, "series", "fitted_phase", maintain_order=True)
    place = [name for name in ("joint", "side") if name in table.columns]
    return table.select(
        "group", *place, "series", "quantity", pl.col("fitted_phase").alias("phase"), "onset_phase",
        "end_phase", "n",
        pl.col("mean").alias("estimate"), "se", "low", "high", pl.col(COMMANDED).cast(pl.Float64),
    )  # fmt: skip


def with_trajectory(table: pl.DataFrame, phase: Array, K_d: Array, B_d: Array) -> pl.DataFrame:
    """The table with K_d and B_d (n,) of a trajectory at phases of stance (n,), where the sheet
    says nothing."""
    for quantity, values in (("K", K_d), ("B", B_d)):
        at = np.interp(table["phase"].to_numpy(), phase, values, left=np.nan, right=np.nan)
        here = (pl.col("quantity") == quantity) & pl.col(COMMANDED).is_null()
        table = table.with_columns(
            pl.when(here).then(pl.Series(at)).otherwise(COMMANDED).alias(COMMANDED)
        )
    return table.with_columns(pl.col(COMMANDED).fill_nan(None))


def trajectory_points(phase: Array, K_d: Array, B_d: Array) -> pl.DataFrame:
    """The commanded trajectory as rows for the figure: series `commanded`, quantities K and B."""
    curves, index = (
        pl.DataFrame({"series": COMMANDED, "phase": phase, "K": K_d, "B": B_d}),
        ["series", "phase"],
    )
    return curves.unpivot(["K", "B"], index=index, variable_name="quantity", value_name=COMMANDED)
