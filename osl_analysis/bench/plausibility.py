# SPDX-License-Identifier: Apache-2.0
"""What an estimate or a signal cannot be: negative where it resists, beyond the bench in series, or
a constant."""

from collections.abc import Mapping
from typing import Any

import numpy as np
import polars as pl

from osl_analysis.base.errors import Change, InputError
from osl_analysis.base.measured import check_measured
from osl_analysis.base.source_file import COMPUTED
from osl_analysis.base.trial import Array, Trial
from osl_analysis.bench.bench_settings import BenchStiffness
from osl_analysis.ingest.guard import recorded
from osl_analysis.model.drivetrain import DrivetrainParameters
from osl_analysis.signals.agreement import turns
from osl_analysis.signals.grid import origin

TURN_TORQUE = Change(
    "turn the `sign` of the torque, or of all angles, in the source file (a copy of it if other"
    " trials have it)",
    {"torque": -1.0},
)


OFF_WHOLE = 0.005  # of a number of bits; 3600 and 7200 steps a turn are 0.03 off


def unit_of_step(step: float) -> float | None:
    """The factor by which an angle is too small by the step of its encoder [rad]: a turn has 2^n of
    them, where radians are read as degrees 180/pi times as many. None where neither holds."""
    if not step:
        return None
    for factor in (1.0, 180 / np.pi):
        bits = np.log2(2 * np.pi / (factor * step))
        if abs(bits - round(bits)) < OFF_WHOLE:
            return factor
    return None


def computed_torque(trial: Trial, torque: str = "torque") -> pl.Expr:
    """The column `torque_from`: the channel of a torque whose name or unit is of none that was
    measured; null where the source file says `measured: true`, or the name nothing."""
    facts = origin(trial, torque)
    names = [facts.get(key) or "" for key in ("found", "field", "column", "variable", "channel")]
    called = next(filter(COMPUTED.search, names), None)
    return pl.lit(None if facts.get("measured") else called, pl.String).alias("torque_from")


def speed_alone(trial: Trial) -> pl.Expr:
    """The column `speed_alone`: the speed of an actuator without an angle, which would tell its
    scale; null beside one."""
    name = None if "theta_m" in trial.columns else "omega_m"
    return pl.lit(name, pl.String).alias("speed_alone")


def gear_told(trial: Trial, p: DrivetrainParameters | None) -> list[pl.Expr]:
    """The columns `gear`, by how much farther the motor's side turns, in words, and `gear_ratio`,
    that over the nearest stated ratio, as far as the stiffness of the drive, which yields, does not
    explain it; null where either is not stated."""
    words = None
    ratio = None
    for motor, factor in origin(trial, "theta").get("gears", {}).items():
        words = f"while theta turns once, {motor} turns {factor:.4g} times"
        stated = np.empty(0)
        if p and p.K_s > 0:
            stated = factor / np.array([p.n_T, p.n_m, p.n_T * p.n_m])
        ratio = min(stated[stated > 0], key=lambda over: abs(np.log(over)), default=None)
        if p and ratio:
            turned = turns(*recorded(trial, "theta"), is_speed=False)
            torque_change = turns(*recorded(trial, "torque"), is_speed=False)
            yielded_share = torque_change.std() / (p.K_s * turned.std())
            ratio /= np.clip(ratio, 1 - yielded_share, 1 + yielded_share)
    return [
        pl.lit(words, pl.String).alias("gear"),
        pl.lit(ratio, pl.Float64).alias("gear_ratio"),
    ]


def check_changes(column: str, values: Array) -> None:
    """Refuse a signal (n,) that never changes, such as that of a dead sensor."""
    check_measured(column, values)
    if not np.ptp(values):
        raise InputError(
            f"{column} stays at {values[0]:g} throughout",
            "check its sensor and its channel in the source file, or exclude the trial",
        )


def check_resists(trial: str, symbol: str, value: float, high: float | None = None) -> None:
    """Refuse a negative estimate of what can only resist motion: a torque of the wrong sign changes
    the sign of every estimate, and fits as well. If `high`, the interval's upper end, is positive,
    the joint may have no stiffness."""
    if value < 0 and (high is None or high < 0):
        raise InputError(
            f"trial {trial}: {symbol} = {value:.4g} is negative, so the torque drives the motion"
            " instead of resisting it",
            "check the channels of torque and angle in the source file",
            changes=[TURN_TORQUE],
        )


def check_stiffer(trial: str, symbol: str, stiffness: float, bench: BenchStiffness | None) -> None:
    """Refuse a stiffness [N*m/rad] that is not below the bench's.

    A bench that is stated too soft makes it negative beyond the bench's, a reversed torque within:
    theta becomes theta (1 + 2 K/k)."""
    if bench is not None and not -1 < stiffness * bench.compliance < 1:
        raise InputError(
            f"trial {trial}: {symbol} = {stiffness:.4g} N*m/rad is beyond the bench's stiffness"
            f" of {bench.value}, so that the frame would yield more than the joint",
            "correct `bench_stiffness` and its unit in the configuration",
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
    names = [name for name in ("k_tau_n_m", "f_C", "B_m", "J_m") if row[name] is not None]
    losses = names[1:]
    negative = [name for name in names if row[f"{name}_high"] < 0]
    if "k_tau_n_m" not in negative and (not losses or negative != losses):
        return
    columns = ["current", "torque_m"]
    if losses:
        columns.append(row["motion"])
    estimates = [f"{name} = {row[name]:.3g}" for name in names]
    raise InputError(
        f"trial {row['trial']}: {', '.join(estimates)}: no actuator has these signs",
        f"check the channels of {', '.join(columns)} in the source file",
        changes=[
            Change(f"turn the `sign` of {column} in the source file", {column: -1.0})
            for column in columns
        ],
    )
