"""What estimates cannot be, and what a motion cannot show, is refused; what is only unlikely is a column."""

import numpy as np
import polars as pl

from osl_analysis.errors import IdentifiabilityError, InputError
from osl_analysis.measured import check_measured, rms
from osl_analysis.model.parameters import DrivetrainParameters
from osl_analysis.trial import Array, known_factor


def check_changes(column: str, values: Array) -> None:
    """Refuse a signal (n,) that never changes, as that of a dead sensor."""
    check_measured(column, values)
    if not np.ptp(values):
        raise InputError(
            f"{column} stays at {values[0]:g} throughout; check its sensor and its channel in the source file, or "
            "exclude the trial"
        )


def check_resists(trial: str, symbol: str, value: float, high: float | None = None) -> None:
    """Refuse a negative estimate of what can only resist motion. A torque of the wrong sign changes the sign of every
    estimate, and the fit is as good as before. Where `high`, the upper end of the interval, is positive, it may be the
    estimate of a joint without stiffness."""
    if value < 0 and (high is None or high < 0):
        raise InputError(
            f"trial {trial}: {symbol} = {value:.4g} is negative, so the torque drives the motion instead of resisting "
            "it; turn the `sign` of the torque, or of the angle, in the source file"
        )


def plausible(table: pl.DataFrame, rails: pl.Expr, p: DrivetrainParameters | None, *names: str) -> pl.DataFrame:
    """Rows of belt, transmission or actuator with `saturated_samples`, each named estimate's ratio to the parameter
    file's, null without one or where that is 0. Raises InputError: the first estimate is negative:
    torque, angle or current has the wrong sign."""
    last = table.row(-1, named=True)
    if names[0] != "k_tau_n_m":
        check_resists(last["trial"], names[0], last[names[0]])
    elif last["k_tau_n_m_high"] < 0:
        raise InputError(
            f"trial {last['trial']}: k_tau_n_m = {last['k_tau_n_m']:.4g} N*m/A is negative, a positive current gives a "
            "negative torque; turn the `sign` of the current, or of torque_m and theta_m, in the source file"
        )
    known = {name: p.k_tau * p.n_m if name == "k_tau_n_m" else getattr(p, name) for name in names} if p else {}
    ratios = [(pl.col(name) / pl.lit(known.get(name) or None, pl.Float64)).alias(f"{name}_ratio") for name in names]
    return table.with_columns(rails, *ratios)


def plausible_impedance(
    table: pl.DataFrame,
    rails: pl.Expr,
    p: DrivetrainParameters | None,
    is_this_leg: bool = True,
    predicted: float | None = None,
    K_d: float | None = None,
) -> pl.DataFrame:
    """The rows of Eq. 15 with `saturated_samples`, `K_over_K_s` and `K_ratio`: K over `predicted`, by linear theory
    [N*m/rad], if the gains are known, else `K_over_K_d`, over K_d [N*m/rad] if that is stated. Both are of the largest
    amplitude in every row, since friction changes K least there. Where nothing but the parameter file says that the
    joint `is_this_leg`, `K_over_K_s` is null up to 10: another device may be as soft or stiff as it likes, beyond
    that a unit is wrong.
    Raises InputError: K is negative, its interval too, or that of a joint that is this leg is larger than that of the
    belt through which the motor acts."""
    last = table.row(-1, named=True)
    K = last["K"]
    if last["B_low"] < 0 or last["I_high"] < 0:  # of the right sign a joint may drive the motion by its K alone
        check_resists(last["trial"], "K", K, last["K_high"])
    if (
        p is not None and is_this_leg and K > 1.1 * p.K_s
    ):  # a motor in series with it; a tenth allows for the belt at hand
        ratio, reference = K / (predicted or p.K_s), "what the gains should give" if predicted else "K_s"
        name, size = known_factor(ratio)
        factor = name and f"{size:.3g} is the factor {name}"
        what = "correct the `unit` or the `scale`" if factor else "check unit and scale of the channels"
        raise InputError(
            f"trial {last['trial']}: K = {K:.4g} N*m/rad is larger than the belt's K_s = {p.K_s:g} of the parameter "
            f"file, which no motor behind the belt can render; it is {ratio:.3g} times {reference}: "
            f"{factor and f'{factor}: '}{what} in the source file"
        )
    largest = pl.lit(table.sort("amplitude_deg", nulls_last=False)["K"][-1])
    none = pl.lit(None, pl.Float64)
    of_gains = (largest / predicted if predicted else none).alias("K_ratio")
    of_sheet = (none if predicted or not K_d else largest / K_d).alias("K_over_K_d")
    of_belt = pl.col("K") / p.K_s if p and p.K_s else none
    of_belt = of_belt if is_this_leg else pl.when(of_belt > 10).then(of_belt)
    return table.with_columns(rails, of_belt.alias("K_over_K_s"), of_gains, of_sheet)


def check_told(
    what: str,
    band_hz: tuple[float, float],
    motion: Array,
    torque_rms: float,
    stiffness: tuple[float, float],
    largest_inertia_error: float | None,
) -> None:
    """Refuse a motion whose band [Hz] cannot tell K from I; the message begins with `what` and names the band that is
    missing (IdentifiabilityError). It is judged by what an error of 0.1 % of the torque's RMS does, which calibrations
    and models leave, in the shape of the part of a column that the others do not explain: a slow motion has little of
    it. `motion`: angle [rad], velocity and acceleration, filtered, without means, (3, n), `torque_rms` [N*m] filtered,
    `stiffness` K with its standard error."""
    theta, omega, alpha = motion

    def own_part(column: Array, *others: Array) -> float:
        X = np.column_stack(others)
        return max(rms(column - X @ np.linalg.lstsq(X, column, rcond=None)[0]), float(np.finfo(float).tiny))

    of_K, of_I = (1e-3 * torque_rms / own_part(*x) for x in ((theta, omega, alpha), (alpha, omega, theta)))
    (low, high), (K, K_se) = band_hz, stiffness
    cannot = f"{what}: a motion of {low:.2g} to {high:.2g} Hz cannot tell K from I: an error of 0.1 % of the torque"
    if largest_inertia_error is not None and of_I > largest_inertia_error:
        needed = max(high * np.sqrt(of_I / (0.5 * largest_inertia_error)), 1.5 * high)
        raise IdentifiabilityError(
            f"{cannot} changes I by {of_I:.2g} kg*m^2, more than the {largest_inertia_error:g} of "
            f"`largest_inertia_error` in the configuration; the band from {high:.2g} to about {needed:.2g} Hz is "
            "missing, excite it as well, or take the stiffness alone by experiment 'torque_angle', or check the units "
            f"of theta and torque, by which K would be {K:.3g} N*m/rad"
        )
    # K by a tenth, and three times what the error is of torque over angle: without stiffness there is no share of K. It
    # is 1.6 from 0.5 to 6 Hz.
    if of_K > max(0.1 * abs(K), K_se) and rms(theta) > 3 * own_part(theta, omega, alpha):
        raise IdentifiabilityError(
            f"{cannot} changes K by {of_K:.2g} N*m/rad; the band below {low:.2g} Hz is missing, excite it as well"
        )
