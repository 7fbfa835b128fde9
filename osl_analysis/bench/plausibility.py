"""What an estimate or a signal cannot be: negative where it resists, beyond the bench in series, or
better known than the motion tells."""

from collections.abc import Mapping
from typing import Any

import numpy as np
import polars as pl
import scipy

from osl_analysis.bench.bench_settings import BenchStiffness
from osl_analysis.bench.record import STIFFNESS_ALONE, Record
from osl_analysis.bench.regression import GroupFit, Sums
from osl_analysis.errors import Change, IdentifiabilityError, InputError
from osl_analysis.inference.rounding_errors import repeated_share
from osl_analysis.measured import check_measured
from osl_analysis.model.drivetrain import DrivetrainParameters
from osl_analysis.trial import Array

USUAL_ERROR = 1e-3  # of the torque's RMS, as calibrations and models leave
LARGE_CHANGE_OF_K = 0.1  # share of K by which the usual error may change it
FEWEST_STEPS = 20.0  # of the encoder; of fewer, rounding is no noise but part of the motion
MOST_NOISE = 0.1  # of the power of the acceleration's own part that may be noise of the encoder
TURN_TORQUE = Change(
    "turn the `sign` of the torque, or of all angles, in the source file", {"torque": -1.0}
)


def check_changes(column: str, values: Array) -> None:
    """Refuse a signal (n,) that never changes, such as that of a dead sensor."""
    check_measured(column, values)
    if not np.ptp(values):
        raise InputError(
            f"{column} stays at {values[0]:g} throughout; check its sensor and its channel in the"
            " source file, or exclude the trial"
        )


def check_resists(trial: str, symbol: str, value: float, high: float | None = None) -> None:
    """Refuse a negative estimate of what can only resist motion: a torque of the wrong sign changes
    the sign of every estimate, and fits as well. If `high`, the interval's upper end, is positive,
    the joint may have no stiffness."""
    if value < 0 and (high is None or high < 0):
        raise InputError(
            f"trial {trial}: {symbol} = {value:.4g} is negative, so the torque drives the motion"
            " instead of resisting it; check the channels of torque and angle in the source file",
            [TURN_TORQUE],
        )


def check_stiffer(trial: str, symbol: str, stiffness: float, bench: BenchStiffness | None) -> None:
    """Refuse a stiffness [N*m/rad] that is not below the bench's."""
    if bench is not None and not 0 < stiffness * bench.compliance < 1:
        raise InputError(
            f"trial {trial}: {symbol} = {stiffness:.4g} N*m/rad is not between 0 and the bench's"
            f" stiffness of {bench.value}, so that the frame would yield more than the joint;"
            " correct `bench_stiffness` and its unit in the configuration"
        )


def plausible(
    table: pl.DataFrame, rails: pl.Expr, p: DrivetrainParameters | None, *names: str
) -> pl.DataFrame:
    """Hold the estimates of a belt, a transmission or an actuator against the parameter file.

    Parameters
    ----------
    table
        Rows of the trial.
    rails
        Saturated samples, as a column of the table.
    p
        The device; None for one without a parameter file.
    names
        Estimates that are compared.

    Returns
    -------
    polars.DataFrame
        The table with `saturated_samples`, and the ratio of each estimate to the file's, such as
        `K_s_ratio`; null where that is not known, or 0.

    Raises
    ------
    InputError
        The first estimate is negative, because torque, angle or current has the wrong sign.
    """
    last = table.row(-1, named=True)
    if names[0] == "k_tau_n_m":
        check_drives(last)
    else:
        check_resists(last["trial"], names[0], last[names[0]])
    known = {**vars(p), "k_tau_n_m": p.k_tau * p.n_m} if p else {}
    # an unknown one is NaN
    ratios = {
        f"{name}_ratio": pl.col(name) / known[name] for name in names if known.get(name, 0.0) > 0
    }
    return table.with_columns(rails, **ratios)


def check_drives(row: Mapping[str, Any]) -> None:
    """Refuse an actuator's row with signs that no actuator has. A reversed torque turns the signs
    of k_tau n_m and of all losses, a reversed current that of k_tau n_m alone, and a reversed
    motion those of the losses alone."""
    losses = [name for name in ("f_C", "B_m", "J_m") if row[name] is not None]
    is_reversed = row["k_tau_n_m_high"] < 0
    gains_energy = bool(losses) and all(row[f"{name}_high"] < 0 for name in losses)
    if not is_reversed and not gains_energy:
        return
    columns = ["current", "torque_m"]
    if losses:
        columns.append(row["motion"])
    estimates = [f"{name} = {row[name]:.3g}" for name in ("k_tau_n_m", *losses)]
    raise InputError(
        f"trial {row['trial']}: {', '.join(estimates)}: no actuator has these signs; check the"
        f" channels of {', '.join(columns)} in the source file",
        [
            Change(f"turn the `sign` of {column} in the source file", {column: -1.0})
            for column in columns
        ],
    )


def usual_errors(record: Record, sums: Sums, fit: GroupFit) -> Array:
    """Errors (p,) of estimates that their intervals must include, since the motion hardly tells K
    from I; 0 where it does.

    The criterion is the usual error of 0.1 % of the torque's RMS in the shape of the part of a
    column that is orthogonal to the others. Slow motion has little of it. With a few steps of the
    encoder rounding is no noise, but part of the motion.

    Parameters
    ----------
    record, sums
        What was fitted.
    fit
        Of Eq. 15 to all of it.

    Raises
    ------
    InputError
        The joint hardly moves.
    IdentifiabilityError
        The acceleration is mostly noise of the encoder.
    """
    moved = np.ptp(record.theta[record.rows()])
    if moved < FEWEST_STEPS * record.encoder_step:
        raise InputError(
            f"trial {record.name}: the joint hardly moves: theta turns by"
            f" {moved / record.encoder_step:.0f} steps of its encoder, {FEWEST_STEPS:g} are needed;"
            " move it by more, and check the unit of theta in the source file"
        )
    covariance = sums.covariance(["theta", "omega", "alpha", "torque"])
    size = np.sqrt(np.diag(covariance))
    correlation = covariance[:3, :3] / np.outer(size[:3], size[:3])
    own_theta, _, own_alpha = size[:3] / np.sqrt(np.diag(np.linalg.inv(correlation)))
    noise_share = acceleration_noise(record) / own_alpha**2
    if noise_share > MOST_NOISE:
        low_hz, high_hz = record.band_hz
        raise IdentifiabilityError(
            f"trial {record.name}: a motion of {low_hz:.2g} to {high_hz:.2g} Hz"
            f" cannot tell K from I: noise of the encoder has {noise_share:.2g} times the power of"
            f" the acceleration's own part behind the filter, at most {MOST_NOISE:g} is allowed;"
            " move the joint by more or faster, by 0.5 to 6 Hz, and check the unit of theta in the"
            f" source file, {STIFFNESS_ALONE}"
        )
    error_of_K, error_of_I = USUAL_ERROR * size[3] / np.array([own_theta, own_alpha])
    errors = dict.fromkeys(fit.names, 0.0)
    # without stiffness a tenth of K is no limit
    if error_of_K > max(LARGE_CHANGE_OF_K * abs(fit["K"]), fit.se("K")):
        errors["K"] = error_of_K
    if error_of_I > (getattr(record.settings, "largest_inertia_error", None) or np.inf):
        errors["I"] = error_of_I
    return np.array(list(errors.values()))


def rounding_errors(record: Record, sums: Sums, model: Mapping[str, str], fit: GroupFit) -> Array:
    """Standard errors (p,) of estimates by the encoder's steps, which no scatter shows where the
    joint returns to the same ones, as under binary steps.

    At rest a step has one error, of variance step^2/12, however many samples show it. Where the
    joint passes through a step its error takes all values and averages out; noise of the angle
    leaves a share of it. An error of the angle is one of the torque by K.

    Parameters
    ----------
    record, sums, model, fit
        What was fitted, and the fit to all of it.
    """
    step = record.encoder_step
    if not step:
        return np.zeros(len(model))
    low_pass = record.settings.low_pass
    rows = record.rows()[:: round(record.rate_hz / record.coarse.rate_hz)]
    columns = np.column_stack([sums.columns[column][rows] for column in model.values()])
    by_row = fit["K"] * np.linalg.pinv(columns)  # change of the estimates by an error (p, m)
    # a low-pass that does not ring where the joint comes to rest
    smooth_rows = record.rate_hz / (2 * np.pi * low_pass.cutoff_hz)
    place = scipy.ndimage.gaussian_filter1d(record.theta, smooth_rows)[rows] / step
    reading, of_row = np.unique(np.rint(record.theta[rows] / step), return_inverse=True)
    by_step = np.zeros((len(reading), len(model)), np.complex128)
    np.add.at(by_step, of_row, (by_row * np.exp(2j * np.pi * place)).T)
    repeated = repeated_share(angle_noise(record), record.rate_hz, step)
    error = step / np.sqrt(12) * repeated
    return np.asarray(error * np.linalg.norm(by_step, axis=0))


def angle_noise(record: Record) -> float:
    """Density [rad^2/Hz] of the angle's noise, taken as white.

    It is the median of what the filter removes from two to four cut-offs or, if the motion itself
    reaches these frequencies, its level at the highest ones.
    """
    rate_hz, cutoff_hz = record.rate_hz, record.settings.cutoff_hz
    removed = (record.theta - record.motion.theta)[record.rows()]
    rows = min(round(rate_hz), len(removed))
    frequency, density = scipy.signal.welch(removed, rate_hz, nperseg=rows)
    level = float(np.median(density[frequency > 0.35 * rate_hz]))
    beyond = (frequency > 2 * cutoff_hz) & (frequency < min(4 * cutoff_hz, 0.45 * rate_hz))
    if beyond.any():
        level = min(level, float(np.median(density[beyond])))
    return level


def acceleration_noise(record: Record) -> float:
    """Variance [rad^2/s^4] that white noise of the angle leaves in the filtered acceleration."""
    cutoff_hz = record.settings.cutoff_hz
    f = np.linspace(0, min(8 * cutoff_hz, record.rate_hz / 2), 2000)
    passed = angle_noise(record) * record.settings.low_pass.gain(f) ** 2
    return float(np.trapezoid((2 * np.pi * f) ** 4 * passed, f))
