"""Walking, from analysed crossings to tables: unperturbed gait, perturbations, and the numbers of Fig. 9."""

from collections.abc import Mapping, Sequence
from dataclasses import asdict
from pathlib import Path

import numpy as np
import polars as pl

from osl_analysis.commands.crossing_file import read_crossing
from osl_analysis.commands.unperturbed_file import read_normal_gait, write_normal_gait
from osl_analysis.commands.walking_selection import left_out, used
from osl_analysis.doubtful import EXCLUDED, doubtful_row
from osl_analysis.errors import IdentifiabilityError, InputError, OslAnalysisError
from osl_analysis.second_order import fit_impedance
from osl_analysis.stats.repeats import CommonError, over_repeats
from osl_analysis.stats.rows import Row, covariance_row, delay_row, diagnostics_row, estimates_row
from osl_analysis.table import read_table, write_table
from osl_analysis.walking.crossing import Crossing
from osl_analysis.walking.ensemble import (
    Bootstrap,
    EnsembleResponse,
    bootstrap,
    common_errors,
    ensemble_response,
)
from osl_analysis.walking.lag import response_lag
from osl_analysis.walking.perturbation import NormalGait, Response, Timing, fit_response, isolate, normal_gait
from osl_analysis.walking.settings import WalkingAnalysis

QUANTITIES = ("K", "B", "I", "VAF")
MEAN, ENSEMBLE = "mean of perturbations", "ensemble"
SHARED = "Student + shared errors"
"""Where the interval of a mean over perturbations is from: their scatter, and what they all share."""


def average_unperturbed(crossings: Sequence[Path], selection: Path, settings: WalkingAnalysis, output: Path) -> None:
    """The unperturbed ones of the crossings on a common grid of stance phase, to a Parquet file.

    `selection` is `walking_crossings.csv`: crossings that it leaves out stay out.
    """
    calm = [crossing for crossing in used(crossings, selection) if crossing.onset is None]
    write_normal_gait(normal_gait(calm, settings.fewest_unperturbed), output)


def fit_perturbation(
    crossing: Path, selection: Path, unperturbed: Path, settings: WalkingAnalysis, output: Path
) -> None:
    """Fit Eq. 15 to the isolated response of one perturbed crossing: one row of `walking.csv`.

    A crossing that was left out, or whose response cannot be fitted, has a row without numbers that says why.
    """
    normal, reason = read_normal_gait(unperturbed), left_out(crossing, selection)
    if reason is None:
        try:
            row = fitted_row(read_crossing(crossing), normal, settings)
        except OslAnalysisError as error:
            reason = str(error)
    if reason is not None:
        row = {"trial": crossing.stem, EXCLUDED: reason}
    write_table(pl.DataFrame([row]), output)


def fitted_row(walked: Crossing, normal: NormalGait, settings: WalkingAnalysis) -> dict[str, object]:
    """One row of `walking.csv`."""
    response = isolated(walked, normal, settings)
    fit = fit_response(response).fit
    onset = walked.onset or 0.0
    return {
        "trial": walked.name,
        "onset_s": onset,
        "onset_phase": (onset - walked.stance.heel_strike) / walked.stance.duration,
        "stance_s": walked.stance.duration,
        "bridged": walked.bridged,
        **estimates_row(fit, "K", "B", "I"),
        **covariance_row(fit, "K", "B", "I"),
        **offset_row(response, fit["K"]),
        **lag_row(response, fit["K"]),
        **diagnostics_row(fit, 1 / (response.time[1] - response.time[0]), settings.low_pass),
        EXCLUDED: None,
    }


def lag_row(response: Response, K: float) -> Row:
    """By how much the torque lags the angle and what it costs B, as far as the response itself can tell.

    `lag_out_of_reach` is 1 where no lag within reach fits best, which a torque two frames late does, else 0.
    """
    found = response_lag(response)
    lag = delay_row(None, None, K) if found is None else delay_row(found.lag, found.se, K)
    return {**lag, "lag_out_of_reach": float(found is None)}


def offset_row(response: Response, K: float) -> Row:
    """What a fit with offset [N*m] reads beside the fit without: far apart, the response is not of second order.

    `offset_share` is what K [N*m/rad] loses to the offset, as a share.
    """
    try:
        free = fit_impedance(response.motion[response.window], response.torque[response.window])
    except IdentifiabilityError:
        return {"offset": None, "K_with_offset": None, "offset_share": None}
    return {"offset": free.offset, "K_with_offset": free.K, "offset_share": 1 - free.K / K}


def isolated(crossing: Crossing, normal: NormalGait, settings: WalkingAnalysis) -> Response:
    """The response of a crossing, by the choices of the settings."""
    timing = Timing(settings.window_s, settings.baseline_s, settings.guard_s)
    own = settings.perturbed_stance == "own"
    stance = crossing.stance.duration if own else float(np.mean(normal.stance))
    return isolate(crossing, normal, timing, stance)


def summarise(
    table: Path,
    crossings: Sequence[Path],
    selection: Path,
    unperturbed: Path,
    settings: WalkingAnalysis,
    output: Path,
    responses: Path,
    excluded: Path,
) -> None:
    """Mean over perturbations and ensemble fit to `output`, every response in its window to `responses`, and what was
    left out and why to `excluded`.

    `table` is `walking.csv`, `crossings` are the perturbed ones, `selection` is `walking_crossings.csv`.
    """
    fits = read_table(table, ["trial"])
    write_table(excluded_table(read_table(selection, ["trial", "reason"]), fits), excluded)
    good = fits.filter(pl.col(EXCLUDED).is_null())
    if len(good) < 2:
        raise InputError(
            f"{len(good)} perturbation that can be used cannot give a scatter; record at least two (of {len(fits)}, "
            f"{len(fits) - len(good)} were left out: see {excluded.name})"
        )
    normal, kept = read_normal_gait(unperturbed), set(good["trial"])
    every = [isolated(read_crossing(path), normal, settings) for path in crossings if path.stem in kept]
    ensemble = ensemble_response(every)
    rows = mean_rows(good, common_errors(every))
    rows += ensemble_rows(ensemble, bootstrap(every, settings.bootstrap_samples))
    write_table(pl.DataFrame(rows), output)
    write_table(response_table(every, ensemble), responses)


def excluded_table(selection: pl.DataFrame, fits: pl.DataFrame) -> pl.DataFrame:
    """Crossings that were left out (trial, perturbed, reason): refused, too far from the others, or without a fit."""
    unfitted = fits.select("trial", pl.col(EXCLUDED).alias("late_reason"))
    both = selection.join(unfitted, on="trial", how="left", maintain_order="left")
    reason = pl.coalesce("reason", "late_reason").alias("reason")
    return both.select("trial", "perturbed", reason).filter(pl.col("reason").is_not_null())


def mean_rows(table: pl.DataFrame, common: Mapping[str, Sequence[CommonError]]) -> list[dict[str, object]]:
    """Mean and scatter of the estimates per perturbation; `se` and the interval count in the errors that are `common`
    to all of them. `n_doubtful` of the fits are doubtful, and in the mean all the same.
    """
    return [
        {"quantity": quantity, "estimator": MEAN, "interval_method": SHARED if quantity in common else "Student"}
        | asdict(over_repeats(table[quantity].to_numpy(), common.get(quantity, ())))
        | doubtful_row(table)
        for quantity in QUANTITIES
    ]


def ensemble_rows(ensemble: EnsembleResponse, resampled: Bootstrap) -> list[dict[str, object]]:
    """Estimates from the mean response; `se`, the 95 % interval and the covariances with K, B and I (`cov_K` ...) from
    the bootstrap, no `sd`.
    """
    fit = ensemble.fit
    values = {"K": fit.K, "B": fit.B, "I": fit.I, "VAF": fit.fit.vaf}
    rows: list[dict[str, object]] = []
    for quantity, value in values.items():
        low, high = resampled.interval(quantity)
        rows.append(
            {"quantity": quantity, "estimator": ENSEMBLE, "n": ensemble.n, "mean": value, "sd": None}
            | {"se": resampled.se(quantity), "low": low, "high": high, "interval_method": "bootstrap"}
            | {f"cov_{other}": resampled.cov(quantity, other) for other in "KBI"}
        )
    return rows


def response_table(responses: Sequence[Response], ensemble: EnsembleResponse) -> pl.DataFrame:
    """Isolated responses around the onset: trial (or 'ensemble'), time [s], angle [deg], torque and its fit [N*m].

    The fitted torque stands in the window only.
    """
    frames = [
        response_frame(r.name, r.time, np.rad2deg(r.motion.theta), r.torque, fit_response(r).torque(r.motion), r.window)
        for r in responses
    ]
    mean, window = ensemble, responses[0].window
    modelled = mean.fit.torque(mean.motion)
    frames.append(response_frame(ENSEMBLE, mean.time, np.rad2deg(mean.motion.theta), mean.torque, modelled, window))
    return pl.concat(frames)


def response_frame(
    name: str, time: np.ndarray, theta_deg: np.ndarray, torque: np.ndarray, modelled: np.ndarray, window: slice
) -> pl.DataFrame:
    """One response as rows of the table, the spline's margins left out."""
    fitted = np.full(len(time), np.nan)
    fitted[window] = modelled[window]
    frame = pl.DataFrame(
        {"time": time, "theta_deg": theta_deg, "torque": torque, "torque_model": pl.Series(fitted).fill_nan(None)}
    )
    return frame.select(pl.lit(name).alias("trial"), pl.all())[: window.stop]
