"""The walking tables, as rows and frames: single perturbations, their mean, the ensemble, and the walking page."""

from collections.abc import Mapping, Sequence
from dataclasses import asdict

import numpy as np
import polars as pl
from numpy.typing import NDArray

from osl_analysis.stats.fit_row import Row, covariance_row, diagnostics_row, estimates_row, lag_damping_row
from osl_analysis.stats.repeats import CommonError, over_repeats
from osl_analysis.trial import Array
from osl_analysis.walking.crossing import Crossing
from osl_analysis.walking.direction import DOWN, UP
from osl_analysis.walking.ensemble import Bootstrap, EnsembleResponse, signs_of
from osl_analysis.walking.headline import Headline, Symmetry
from osl_analysis.walking.headline_doubts import single_facts
from osl_analysis.walking.response import PerturbationResponse, isolate_response
from osl_analysis.walking.response_fit import fit_response, offset_comparison, response_lag
from osl_analysis.walking.settings import ResponseSettings, Timing
from osl_analysis.walking.unperturbed import PHASES, UnperturbedGait

QUANTITIES = ("K", "B", "I", "VAF")
MEAN, ENSEMBLE, UP_MINUS_DOWN = "mean of perturbations", "ensemble", "up minus down"
OTHER_BASELINE = {"predicted": "ensemble, mean gait", "mean": "ensemble, predicted gait"}
"""The ensemble with the baseline that the configuration does not name, by the one that it names."""
WITH_COMMON_ERRORS = "Student + shared errors"
"""Interval of a mean over perturbations: from their scatter, and from the errors that all of them share."""
PHASE_STEP = 4
"""Step between the plotted `PHASES`: a hundred points of stance are enough for a curve."""


def perturbation_row(crossing: Crossing, gait: UnperturbedGait, settings: ResponseSettings) -> dict[str, object]:
    """One row of `walking.csv`: the fit of Eq. 15 to the isolated response of one crossing.

    Raises
    ------
    InputError, IdentifiabilityError
        As `isolate_response` and `fit_response`.
    """
    response = isolate_response(crossing, gait, settings.timing, settings.perturbed_stance)
    impedance = fit_response(response)
    fit = impedance.fit
    onset = crossing.onset or 0.0
    return {
        "trial": crossing.name,
        "onset_s": onset,
        "onset_phase": (onset - crossing.stance.heel_strike) / crossing.stance.duration,
        "stance_s": crossing.stance.duration,
        "phase_stance_s": response.stance,
        "bridged": crossing.bridged,
        **estimates_row(fit, "K", "B", "I"),
        **covariance_row(fit, "K", "B", "I"),
        **offset_comparison(response.fitted_motion, response.fitted_torque, fit["K"]),
        **single_facts(response, impedance),
        **response_lag_row(response, fit["K"]),
        **diagnostics_row(fit, 1 / (response.time[1] - response.time[0]), settings.low_pass),
    }


def response_lag_row(response: PerturbationResponse, K: float) -> Row:
    """The lag of the torque behind the angle and its effect on B.

    `lag_out_of_reach` is 1 if the best lag is at or beyond the limit of the search, for example if the torque is two
    frames late. Otherwise it is 0.
    """
    delay = response_lag(response)
    columns = lag_damping_row(None, None, K) if delay is None else lag_damping_row(delay.lag, delay.se, K)
    return {**columns, "lag_out_of_reach": float(delay is None)}


def headline_rows(headline: Headline, fits: pl.DataFrame, doubtful: Mapping[str, int]) -> list[dict[str, object]]:
    """Rows of `walking_summary.csv` of one group.

    `fits` are its rows of `walking.csv`, `doubtful` the column with the number of doubtful ones.
    """
    rows = [{**row, **doubtful} for row in mean_rows(fits, headline.common, signs_of(headline.responses))]
    rows += ensemble_rows(headline.ensemble, headline.resampled)
    other = headline.mean_gait if headline.baseline == "predicted" else headline.predicted_gait
    rows += ensemble_rows(*other, OTHER_BASELINE[headline.baseline])
    return rows if headline.symmetry is None else rows + symmetry_rows(headline.symmetry)


def mean_rows(
    fits: pl.DataFrame, common: Mapping[str, Sequence[CommonError]], signs: NDArray[np.int_] | None = None
) -> list[dict[str, object]]:
    """Mean and scatter of the estimates per perturbation; `se` and interval include the errors that are `common`.

    With `signs` (n,) of two directions it is the mean of both directions' means.
    """
    return [
        {"quantity": name, "estimator": MEAN, "interval_method": WITH_COMMON_ERRORS if name in common else "Student"}
        | asdict(over_repeats(fits[name].to_numpy(), common.get(name, ()), signs))
        for name in QUANTITIES
    ]


def symmetry_rows(symmetry: Symmetry) -> list[dict[str, object]]:
    """K, B and I of each direction alone, and of up minus down, with intervals from the bootstrap."""
    up, down = symmetry.up, symmetry.down
    rows: list[dict[str, object]] = []
    for quantity in "KBI":
        values = getattr(up, quantity), getattr(down, quantity)
        parts = (
            (UP, values[0], symmetry.up_draws, symmetry.counts[0]),
            (DOWN, values[1], symmetry.down_draws, symmetry.counts[1]),
            (UP_MINUS_DOWN, values[0] - values[1], symmetry.difference, sum(symmetry.counts)),
        )
        for estimator, value, drawn, n in parts:
            low, high = drawn.interval(quantity)
            rows.append(
                {"quantity": quantity, "estimator": estimator, "n": n, "mean": value, "se": drawn.se(quantity)}
                | {"low": low, "high": high, "interval_method": "bootstrap"}
            )
    return rows


def reason_rows(reason: str, n: int) -> list[dict[str, object]]:
    """Rows of `walking_summary.csv` of a group without a result: its number of perturbations and the reason."""
    return [{"quantity": q, "estimator": ENSEMBLE, "n": n, "mean": None, "reason": reason} for q in QUANTITIES]


def ensemble_rows(
    ensemble: EnsembleResponse, resampled: Bootstrap, estimator: str = ENSEMBLE
) -> list[dict[str, object]]:
    """Estimates from the mean response; `se`, 95 % interval and covariances with K, B, I (`cov_K`, ...) from the
    bootstrap. There is no `sd`."""
    fit = ensemble.fit
    estimates = {"K": fit.K, "B": fit.B, "I": fit.I, "VAF": fit.fit.vaf}
    rows: list[dict[str, object]] = []
    for quantity, estimate in estimates.items():
        low, high = resampled.interval(quantity)
        rows.append(
            {"quantity": quantity, "estimator": estimator, "n": ensemble.n, "mean": estimate, "sd": None}
            | {"se": resampled.se(quantity), "low": low, "high": high, "interval_method": "bootstrap"}
            | {f"cov_{other}": resampled.cov(quantity, other) for other in "KBI"}
        )
    return rows


def excluded_crossings(selection: pl.DataFrame, unfitted: pl.DataFrame) -> pl.DataFrame:
    """Crossings that are not used (trial, perturbed, reason), in the order of the selection.

    `selection` is `walking_crossings.csv`. `unfitted` (trial, reason) gives the reason why a crossing has no fit. The
    reason is null if it has one.
    """
    both = selection.join(unfitted, on="trial", how="left", maintain_order="left", suffix="_unfitted")
    reason = pl.coalesce("reason", "reason_unfitted").alias("reason")
    return both.select("trial", "perturbed", reason).filter(pl.col("reason").is_not_null())


def response_table(group: str, responses: Sequence[PerturbationResponse], ensemble: EnsembleResponse) -> pl.DataFrame:
    """Isolated responses of a group around the onset: trial (or 'ensemble'), time [s], angle [deg], torque [N*m] and
    its fit.

    The fitted torque is null outside the window.
    """
    window = responses[0].window
    frames = [response_frame(r.name, r, fit_response(r).torque(r.motion), window) for r in responses]
    frames.append(response_frame(ENSEMBLE, ensemble, ensemble.fit.torque(ensemble.motion), window))
    return pl.concat(frames).with_columns(group=pl.lit(group))


def response_frame(
    name: str, response: PerturbationResponse | EnsembleResponse, fitted: Array, window: slice
) -> pl.DataFrame:
    """One response with its fitted torque (k,) [N*m], up to the end of the window."""
    model = np.full(len(response.time), np.nan)
    model[window] = fitted[window]
    columns = {
        "time": response.time,
        "theta_deg": np.rad2deg(response.motion.theta),
        "torque": response.torque,
        "torque_model": pl.Series(model).fill_nan(None),
    }
    return pl.DataFrame(columns).select(pl.lit(name).alias("trial"), pl.all())[: window.stop]


def walking_page_points(
    perturbed: Sequence[Crossing], gaits: Mapping[str, UnperturbedGait], responses: pl.DataFrame, timing: Timing
) -> pl.DataFrame:
    """Points of the walking page: both gaits over stance [%], angle in deg, torque in N*m; responses over time [ms].

    `perturbed` are the crossings whose fitted window and baseline, of this `timing`, are shown, `gaits` the mean gaits
    by curve, `responses` is `walking_responses.csv` with the column `doubtful` of `walking.csv`.
    """
    frames = [frame for curve, gait in gaits.items() for frame in gait_points(curve, gait)]
    return pl.concat([*frames, interval_points(perturbed, timing), response_points(responses)], how="diagonal")


def gait_points(curve: str, gait: UnperturbedGait) -> list[pl.DataFrame]:
    """Mean and SD over crossings, of angle and torque, at every fourth phase."""
    signals = {"angle": np.rad2deg(gait.theta), "torque": gait.torque}
    x = 100 * PHASES[::PHASE_STEP]
    labels = {"curve": pl.lit(curve), "n": pl.lit(len(gait.names))}
    return [
        pl.DataFrame(
            {"x": x, "mean": curves[:, ::PHASE_STEP].mean(axis=0), "sd": curves[:, ::PHASE_STEP].std(axis=0, ddof=1)}
        ).with_columns(panel=pl.lit(panel), **labels)
        for panel, curves in signals.items()
    ]


def interval_points(crossings: Sequence[Crossing], timing: Timing) -> pl.DataFrame:
    """Ends of the fitted window and of the baseline: mean phases of stance [%], and times from the onset [ms]."""
    frames = []
    for curve, ends in (("window", (0.0, timing.window)), ("baseline", (-timing.lead, -timing.guard))):
        phases = [
            [100 * (c.onset + late - c.stance.heel_strike) / c.stance.duration for late in ends]
            for c in crossings
            if c.onset is not None
        ]
        for panel, x in (("angle", np.mean(phases, axis=0)), ("response angle", 1e3 * np.array(ends))):
            frames.append(pl.DataFrame({"panel": panel, "curve": curve, "x": x}))
    return pl.concat(frames)


def response_points(responses: pl.DataFrame) -> pl.DataFrame:
    """Isolated angle and torque of every perturbation and of their mean, and the mean's fit."""
    curve = pl.when(pl.col("trial") == ENSEMBLE).then(pl.lit("mean")).otherwise(pl.lit("each")).alias("curve")
    x = (1e3 * pl.col("time")).alias("x")
    frames = [
        responses.select("trial", "doubtful", x, curve, pl.col(column).alias("mean"), pl.lit(panel).alias("panel"))
        for panel, column in (("response angle", "theta_deg"), ("response torque", "torque"))
    ]
    fit = responses.filter((pl.col("trial") == ENSEMBLE) & pl.col("torque_model").is_not_null())
    labels = pl.lit("fit").alias("curve"), pl.lit("response torque").alias("panel")
    frames.append(fit.select("trial", x, labels[0], pl.col("torque_model").alias("mean"), labels[1]))
    return pl.concat(frames, how="diagonal")
