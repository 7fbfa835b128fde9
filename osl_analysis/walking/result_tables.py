"""Tables of the results: single perturbations, headlines, responses, figures."""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, replace

import numpy as np
import polars as pl
import scipy

from osl_analysis.stats.linear_fit import LinearFit
from osl_analysis.stats.repeats import over_repeats
from osl_analysis.stats.table_rows import estimates_row
from osl_analysis.trial import Array
from osl_analysis.walking.crossing import Crossing
from osl_analysis.walking.ensemble import ESTIMATED, Bootstrap, GroupHeadline
from osl_analysis.walking.group_checks import residual_over_gait
from osl_analysis.walking.impedance_fit import fit_response, gait_torque
from osl_analysis.walking.isolated_response import isolate_response
from osl_analysis.walking.unperturbed_gait import PHASES, UnperturbedGait
from osl_analysis.walking.walking_settings import ResponseSettings, TimingSettings

GROUP_QUANTITIES = ("K", "B", "I", "VAF")
ENSEMBLE = "ensemble"
# A bootstrap of fewer crossings does not leave their range, outside of which the mean of all lies
# with a probability of 2^(1 - n): more than 5 %
FEWEST_FOR_BOOTSTRAP = 6
DRAWN_STEP = 4  # a hundred points of stance are enough for a curve


def perturbation_row(
    crossing: Crossing, gait: UnperturbedGait, settings: ResponseSettings
) -> dict[str, object]:
    """Make the row of `walking.csv` of one crossing: Eq. 15 fitted to its isolated response."""
    response = isolate_response(crossing, gait, settings, settings.perturbed_stance)
    fit = fit_response(response)
    return {
        "trial": crossing.name,
        "bridged": crossing.bridged,
        **estimates_row(fit, *ESTIMATED),
        "residual_over_gait": residual_over_gait(
            response.fitted_motion,
            response.fitted_torque,
            gait_torque(response, fit)[:, response.window],
        ),
        "stance_change": response.stance_change if np.isfinite(response.stance_change) else None,
        "encoder_rms_deg": crossing.quality.encoder_rms_deg,
        "VAF": fit.vaf,
        "condition_number": fit.condition_number,
    }


def headline_rows(
    headline: GroupHeadline, fits: pl.DataFrame, doubtful: Mapping[str, int]
) -> list[dict[str, object]]:
    """Make the rows of `walking_summary.csv` of one group.

    They are the mean over perturbations with the errors that all share, and the ensemble with
    either baseline.

    Parameters
    ----------
    fits : DataFrame
        The group's rows of `walking.csv`.
    doubtful : mapping
        Columns with the number of doubtful ones.
    """
    common = headline.errors.common
    rows: list[dict[str, object]] = []
    for quantity in GROUP_QUANTITIES:
        mean = over_repeats(fits[quantity].to_numpy(), common.get(quantity, ()))
        method = f"{mean.interval_method}"
        if quantity in common:
            method += " + shared errors"
        rows.append(
            {
                "quantity": quantity,
                "estimator": "mean of perturbations",
                **asdict(replace(mean, interval_method=method)),
                **doubtful,
            }
        )
    for estimator, fit, resampled in (
        (ENSEMBLE, headline.ensemble.fit, headline.resampled),
        (headline.other_name, headline.other.fit, headline.other_resampled),
    ):
        for quantity in GROUP_QUANTITIES:
            row = bootstrap_row(headline, fit, resampled, quantity)
            rows.append({"estimator": estimator, **row})
    return rows


def bootstrap_row(
    headline: GroupHeadline, fit: LinearFit, resampled: Bootstrap, quantity: str
) -> dict[str, object]:
    """One row with an interval from resamples.

    Of few crossings it is at least that of the unperturbed ones' scatter.
    """
    value = fit.vaf if quantity == "VAF" else fit[quantity]
    se = resampled.se(quantity)
    low, high = resampled.interval(quantity)
    n = len(headline.responses)
    method = "bootstrap"

    common = headline.errors.common
    if quantity in common and n < FEWEST_FOR_BOOTSTRAP:
        scatter = float(np.sqrt(headline.errors.of_one[quantity] / n))
        freedom = common["K"][0][1]
        half = float(-scipy.special.stdtrit(freedom, 0.025)) * scatter
        low = min(low, value - half)
        high = max(high, value + half)
        se = max(se, scatter)
        method = "bootstrap, scatter of unperturbed crossings"
    return {
        "quantity": quantity,
        "n": n,
        "mean": value,
        "sd": None,
        "se": se,
        "low": low,
        "high": high,
        "interval_method": method,
    }


def response_table(group: str, headline: GroupHeadline) -> pl.DataFrame:
    """Tabulate `walking_responses.csv`: the isolated responses of a group, and their mean."""
    first = headline.responses[0]
    time = first.time
    window = first.window
    fitted = [
        (response.name, response.motion, response.torque, fit_response(response))
        for response in headline.responses
    ]
    mean = headline.ensemble
    frames = []
    for name, motion, torque, fit in [*fitted, (ENSEMBLE, mean.motion, mean.torque, mean.fit)]:
        model = np.full(len(time), np.nan)
        model[window] = motion.columns[window] @ fit.estimates
        frame = pl.DataFrame(
            {
                "trial": [name] * len(time),
                "time": time,
                "theta_deg": np.rad2deg(motion.theta),
                "torque": torque,
                "torque_model": model,
            }
        )
        frames.append(frame[: window.stop])
    table = pl.concat(frames).with_columns(pl.col("torque_model").fill_nan(None))
    return table.with_columns(group=pl.lit(group))


def walking_page_points(
    perturbed: Sequence[Crossing],
    gaits: Mapping[str, UnperturbedGait],
    responses: pl.DataFrame,
    timing: TimingSettings,
) -> pl.DataFrame:
    """Points of the walking page.

    Gaits over stance [%] with their SD; responses over time [ms], with the column `doubtful`, and
    their mean with its fit; window and baseline as mean phases [%] and times from the onset [ms].

    Parameters
    ----------
    responses : DataFrame
        `walking_responses.csv`.
    """
    frames = []
    for name, gait in gaits.items():
        frames.append(gait_points("angle", name, np.rad2deg(gait.theta)))
        frames.append(gait_points("torque", name, gait.torque))

    spans = {
        "window": (0.0, timing.window_s),
        "baseline": (-timing.guard_s - timing.baseline_s, -timing.guard_s),
    }
    for name, bounds in spans.items():
        phases = [
            100 * crossing.stance.phase(crossing.onset + np.array(bounds))
            for crossing in perturbed
            if crossing.onset is not None
        ]
        for panel, x in (
            ("angle", np.mean(phases, axis=0)),
            ("response angle", 1e3 * np.array(bounds)),
        ):
            frames.append(pl.DataFrame({"panel": panel, "curve": name, "x": x}))

    is_mean = pl.col("trial") == ENSEMBLE
    curve = pl.when(is_mean).then(pl.lit("mean")).otherwise(pl.lit("each")).alias("curve")
    time_ms = (1e3 * pl.col("time")).alias("x")
    angle = pl.lit("response angle")
    torque = pl.lit("response torque")
    frames.append(
        responses.select("trial", "doubtful", time_ms, curve, mean=pl.col("theta_deg"), panel=angle)
    )
    frames.append(
        responses.select("trial", "doubtful", time_ms, curve, mean=pl.col("torque"), panel=torque)
    )
    fit = responses.filter(is_mean & pl.col("torque_model").is_not_null())
    frames.append(
        fit.select("trial", time_ms, curve=pl.lit("fit"), mean=pl.col("torque_model"), panel=torque)
    )
    return pl.concat(frames, how="diagonal")


def gait_points(panel: str, name: str, curves: Array) -> pl.DataFrame:
    """Mean and SD of curves (crossings, `PHASES`) over stance."""
    drawn = curves[:, ::DRAWN_STEP]
    sd = drawn.std(axis=0, ddof=1) if len(drawn) > 1 else None
    points = pl.DataFrame(
        {"x": 100 * PHASES[::DRAWN_STEP], "mean": drawn.mean(axis=0), "sd": sd},
        schema_overrides={"sd": pl.Float64},
    )
    return points.with_columns(panel=pl.lit(panel), curve=pl.lit(name), n=pl.lit(len(curves)))
