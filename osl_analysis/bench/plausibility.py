"""What a bench recording and its estimates cannot be, and what they are not likely to be: signs, sizes and units.

What is impossible is refused. What is unlikely becomes a column of the result table, with a limit under `doubtful` in
the configuration.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import polars as pl

from osl_analysis.bench.diagnostics import check_resists
from osl_analysis.bench.settings import BenchAnalysis
from osl_analysis.doubtful import wrong_scale
from osl_analysis.errors import InputError
from osl_analysis.parameters import DrivetrainParameters
from osl_analysis.rails import sampled, samples_at_rail
from osl_analysis.trial import Array, Trial

SAME_AS_BELT = 1.1
"""Largest K over the belt's K_s. The joint and the motor act through the belt, in series with it, so that the motor can
render no K above K_s; a tenth allows for the belt at hand."""
SHORTEST_STEP_S = 1e-5  # smallest mean time between two samples [s]; no recorder of a joint is faster than 100 kHz
NO_PARAMETERS = "estimates against those of a parameter file: the configuration names none"


def check_recording(trial: Trial, limits: BenchAnalysis, torque: str = "torque", angle: str | None = "theta") -> None:
    """Refuse an angle that no leg's joint turns by, a torque beyond the load cell's range of the configuration or one
    that never changes while the joint turns, and samples so close that the unit of time must be wrong.

    Raises InputError: the message names trial, channel, value, and the likely unit.
    """
    check_unit_of_time(trial)
    turned, measured = recorded_values(trial, angle), recorded_values(trial, torque)
    if turned.size and measured.size > 1 and np.ptp(turned) and not np.ptp(measured):
        raise InputError(
            f"trial {trial.name}: {torque} is {measured[0]:.4g} N*m in all samples while {angle} turns by "
            f"{np.ptp(turned):.2g} rad; is this the channel of the load cell? Correct it in the source file"
        )
    if turned.size and (half := float(np.ptp(turned)) / 2) > limits.largest_angle:
        swapped = measured.size and float(np.ptp(measured)) / 2 < limits.largest_angle
        cause = (
            f"{torque} has +-{np.ptp(measured) / 2:.2g} N*m only, are the two swapped? Correct their names"
            if swapped
            else "is it recorded in deg and declared as rad? Correct its `unit`"
        )
        raise InputError(
            f"trial {trial.name}: {angle} turns by +-{half:.3g} rad ({np.rad2deg(half):.0f} deg), more than the "
            f"{limits.largest_angle:g} rad of `largest_angle` in the configuration: {cause} in the source file"
        )
    largest = max(float(measured.max()), -float(measured.min())) if measured.size else 0.0
    if limits.load_cell_range is not None and largest > limits.load_cell_range:
        raise InputError(
            f"trial {trial.name}: {torque} reaches {largest:.4g} N*m, more than the {limits.load_cell_range:g} N*m of "
            "`load_cell_range` in the configuration; correct its `unit` or `scale` in the source file, or the range"
        )


def check_unit_of_time(trial: Trial) -> None:
    """Refuse samples that are too close for any recorder of a joint; raises as `check_recording`. Stamps of a late host
    come in clusters, most of them microseconds apart. The mean step knows nothing of that."""
    time = trial.arrays()[0]
    step = float(np.ptp(time)) / (len(time) - 1) if len(time) > 1 else 0.0
    if 0 < step < SHORTEST_STEP_S:
        raise InputError(
            f"trial {trial.name}: its samples are {step:.2g} s apart, {1 / step:.3g} in a second: is its time recorded "
            "in another unit than it is declared in? Correct the unit of `time` in the source file"
        )


def recorded_values(trial: Trial, column: str | None) -> Array:
    """The finite values of a column where it was sampled, (n,); empty where the trial does not have it."""
    values = np.empty(0) if column is None else sampled(trial, column)[1]
    finite = np.isfinite(values)
    return values if finite.all() else values[finite]


@dataclass(frozen=True)
class Saturated:
    """How long a sensor of a trial stood at an end of its range: found before the fit, which has no room for it."""

    trial: str  # name of the trial
    samples: int  # longest run of the torque, or of another column, at an end

    def beside(self, table: pl.DataFrame) -> pl.DataFrame:
        return table.with_columns(saturated_samples=pl.lit(self.samples, pl.Int64))


def saturated(trial: Trial, torque: str = "torque", *others: str) -> Saturated:
    """The longest run of torque, or of one of the other columns, at an end of its sensor."""
    return Saturated(trial.name, max(samples_at_rail(trial, column, torque) for column in (torque, *others)))


def not_checked(reason: str) -> pl.Expr:
    """The column `not_checked`: what could not be checked and why; null where all was."""
    return pl.lit(reason or None, pl.String).alias("not_checked")


def against_file(
    table: pl.DataFrame, rails: Saturated, known: Mapping[str, float] | None, names: Sequence[str]
) -> pl.DataFrame:
    """The table with `saturated_samples` and the ratio of each named estimate to the parameter file's, null without one
    or where that is 0, and `not_checked`, which says so."""
    references = {name: (known or {}).get(name) or None for name in names}
    ratios = [(pl.col(name) / pl.lit(own, pl.Float64)).alias(f"{name}_ratio") for name, own in references.items()]
    return rails.beside(table).with_columns(*ratios, not_checked(NO_PARAMETERS if known is None else ""))


def plausible_belt(table: pl.DataFrame, rails: Saturated, p: DrivetrainParameters | None) -> pl.DataFrame:
    """The belt's row beside the parameter file's K_s. Raises InputError: K_s is negative."""
    check_resists(rails.trial, "K_s", table["K_s"][-1])
    return against_file(table, rails, {"K_s": p.K_s} if p else None, ["K_s"])


def plausible_transmission(table: pl.DataFrame, rails: Saturated, p: DrivetrainParameters | None) -> pl.DataFrame:
    """The transmission's rows beside the parameter file's B_j and J_j. Raises InputError: B_j is negative."""
    check_resists(rails.trial, "B_j", table["B_j"][-1])
    return against_file(table, rails, {"B_j": p.B_j, "J_j": p.J_j} if p else None, ["B_j", "J_j"])


def plausible_impedance(
    table: pl.DataFrame, rails: Saturated, p: DrivetrainParameters | None, predicted: float | None = None
) -> pl.DataFrame:
    """The rows of Eq. 15 with `saturated_samples`, `K_over_K_s` and `K_ratio`, K over what the gains should give.

    `K_ratio` is that of the largest amplitude in every row: friction changes K least there. `predicted` is the K
    [N*m/rad] of linear theory; None where the gains are not known. Without a parameter file K_s is not known.

    Raises InputError: K is negative, its interval too, or larger than that of the belt through which the motor acts.
    """
    K, high = table["K"][-1], table["K_high"][-1]
    check_resists(rails.trial, "K", K, high)
    if p is not None and K > SAME_AS_BELT * p.K_s:
        reference = predicted or p.K_s
        raise InputError(
            f"trial {rails.trial}: K = {K:.4g} N*m/rad is larger than the belt's K_s = {p.K_s:g} of the parameter "
            f"file, which no motor behind the belt can render; it is {K / reference:.3g} times "
            f"{'what the gains should give' if predicted else 'K_s'}: {wrong_scale(K / reference)}"
        )
    largest = pl.lit(table.sort("amplitude_deg", nulls_last=False)["K"][-1])
    of_gains = (largest / predicted if predicted else pl.lit(None, pl.Float64)).alias("K_ratio")
    of_belt = (pl.col("K") / p.K_s if p and p.K_s else pl.lit(None, pl.Float64)).alias("K_over_K_s")
    return rails.beside(table).with_columns(of_belt, of_gains)


def plausible_actuator(table: pl.DataFrame, rails: Saturated, p: DrivetrainParameters | None) -> pl.DataFrame:
    """The actuator's row beside the parameter file. Raises InputError: current or torque has the wrong sign."""
    k, high = table["k_tau_n_m"][-1], table["k_tau_n_m_high"][-1]
    if high < 0:
        raise InputError(
            f"trial {rails.trial}: k_tau_n_m = {k:.4g} N*m/A is negative, a positive current gives a negative torque; "
            "turn the `sign` of the current, or of torque_m and theta_m, in the source file"
        )
    known = {"k_tau_n_m": p.k_tau * p.n_m, "f_C": p.f_C, "f_G": p.f_G, "B_m": p.B_m, "J_m": p.J_m} if p else None
    return against_file(table, rails, known, ["k_tau_n_m", "f_C", "f_G", "B_m", "J_m"])
