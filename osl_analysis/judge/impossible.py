"""What a bench recording and its estimates cannot be, and what a motion cannot show: refused with cause and remedy.

What is only unlikely becomes a column of the result table, with a limit under `doubtful` in the configuration.
"""

import math
from dataclasses import dataclass
from typing import Protocol

import numpy as np
import polars as pl

from osl_analysis.config.parameters import DrivetrainParameters
from osl_analysis.errors import IdentifiabilityError, InputError, OslAnalysisError
from osl_analysis.judge.channels import sampled, samples_at_rail
from osl_analysis.measured import check_measured, rms
from osl_analysis.trial import Array, Trial

FACTORS: dict[str, float] = {  # between units that are often taken for one another
    "between peak and RMS current": math.sqrt(2),
    "between lbf*ft and N*m": 1.3558,
    "between lbf and N": 4.4482,
    "between lbf*in and N*m": 8.8507,
    "between kgf*m and N*m": 9.8067,
    "between degrees and radians": 180 / math.pi,
    "between N*cm and N*m": 100.0,
    "between N*mm and N*m, or mA and A": 1000.0,
}


def known_factor(ratio: float) -> str:
    """The factor between two units that may make a number `ratio` times too large, in words; empty if none is near."""
    size = max(abs(ratio), 1 / abs(ratio)) if ratio else math.inf
    name = min(FACTORS, key=lambda known: abs(math.log(size / FACTORS[known])) if math.isfinite(size) else math.inf)
    if math.isfinite(size) and abs(size / FACTORS[name] - 1) < 0.08:
        return f"{FACTORS[name]:.3g} is the factor {name}"
    return ""


@dataclass(frozen=True)
class Impossible:
    """A row that refuses: its sentence names trial, channel, value, limit and what to do."""

    measure: str  # what is measured, with its unit
    says: str  # with {places} for what was found
    kind: type[OslAnalysisError] = InputError

    def of(self, **found: object) -> OslAnalysisError:
        return self.kind(self.says.format(**found))


CANNOT_TELL = (
    "{what}: a motion of {low:.2g} to {high:.2g} Hz cannot tell K from I: an error of 0.1 % of the torque changes "
)
REFUSALS = {
    "step": Impossible(
        "mean time between two samples [s]",
        "trial {trial}: its samples are {step:.2g} s apart, {rate:.3g} in a second: is its time recorded in another "
        "unit than it is declared in? Correct the unit of `time` in the source file",
    ),
    "constant": Impossible(
        "whether the torque changes while the joint turns",
        "trial {trial}: {torque} is {value:.4g} N*m in all samples while {angle} turns by {turn:.2g} rad; is this the "
        "channel of the load cell? Correct it in the source file",
    ),
    "angle": Impossible(
        "half the range of the angle [rad]",
        "trial {trial}: {angle} turns by +-{half:.3g} rad ({degrees:.0f} deg), more than the {limit:g} rad of "
        "`largest_angle` in the configuration: {cause} in the source file",
    ),
    "load": Impossible(
        "largest torque [N*m]",
        "trial {trial}: {torque} reaches {largest:.4g} N*m, more than the {limit:g} N*m of `load_cell_range` in the "
        "configuration; correct its `unit` or `scale` in the source file, or the range",
    ),
    "still": Impossible(
        "whether a signal changes at all",
        "{column} stays at {value:g} throughout; check its sensor and its channel in the source file, or exclude the "
        "trial",
    ),
    "negative": Impossible(
        "sign of what can only resist motion",
        "trial {trial}: {symbol} = {value:.4g} is negative, so the torque drives the motion instead of resisting it; "
        "turn the `sign` of the torque, or of the angle, in the source file",
    ),
    "driving": Impossible(
        "sign of torque per current",
        "trial {trial}: k_tau_n_m = {value:.4g} N*m/A is negative, a positive current gives a negative torque; turn "
        "the `sign` of the current, or of torque_m and theta_m, in the source file",
    ),
    "belt": Impossible(
        "K over the stiffness K_s of the belt behind which the motor acts",
        "trial {trial}: K = {K:.4g} N*m/rad is larger than the belt's K_s = {K_s:g} of the parameter file, which no "
        "motor behind the belt can render; it is {ratio:.3g} times {reference}: {cause}",
    ),
    "fast motion": Impossible(
        "change of I by an error of 0.1 % of the torque [kg*m^2]",
        CANNOT_TELL
        + "I by {change:.2g} kg*m^2, more than the {limit:g} of `largest_inertia_error` in the configuration; "
        "the band from {high:.2g} to about {needed:.2g} Hz is missing, excite it as well, or take the stiffness alone "
        "by experiment 'torque_angle'",
        IdentifiabilityError,
    ),
    "slow motion": Impossible(
        "change of K by an error of 0.1 % of the torque [N*m/rad]",
        CANNOT_TELL + "K by {change:.2g} N*m/rad; the band below {low:.2g} Hz is missing, excite it as well",
        IdentifiabilityError,
    ),
    "alias": Impossible(
        "change of B and I by jumps of the acceleration within a sample, as a share",
        "trial {trial}: the acceleration jumps within a sample, {count} times by about {size:.2g} rad/s^2, as under a "
        "binary sequence: without an anti-aliasing filter the torque's samples change {symbol} by up to {percent:.1f} "
        "%; smooth the command, or record angle and torque through the same low-pass and state it in the source file",
    ),
}
"""What is refused for a number beyond its limit."""
NO_PARAMETERS = "estimates against those of a parameter file: the configuration names none"


class BenchLimits(Protocol):
    """What the configuration says of the bench."""

    @property
    def largest_angle(self) -> float: ...
    @property
    def load_cell_range(self) -> float | None: ...


def check_recording(trial: Trial, limits: BenchLimits, torque: str = "torque", angle: str | None = "theta") -> None:
    """Refuse an angle that no leg's joint turns by, a torque beyond the load cell's range of the configuration or one
    that never changes while the joint turns, and samples so close that the unit of time must be wrong (InputError)."""
    check_unit_of_time(trial)
    turned, measured = recorded_values(trial, angle), recorded_values(trial, torque)
    names = {"trial": trial.name, "torque": torque, "angle": angle}
    if turned.size and measured.size > 1 and np.ptp(turned) and not np.ptp(measured):
        raise REFUSALS["constant"].of(**names, value=measured[0], turn=np.ptp(turned))
    if turned.size and (half := float(np.ptp(turned)) / 2) > limits.largest_angle:
        swapped = measured.size and float(np.ptp(measured)) / 2 < limits.largest_angle
        cause = (
            f"{torque} has +-{np.ptp(measured) / 2:.2g} N*m only, are the two swapped? Correct their names"
            if swapped
            else "is it recorded in deg and declared as rad? Correct its `unit`"
        )
        degrees = float(np.rad2deg(half))
        raise REFUSALS["angle"].of(**names, half=half, degrees=degrees, limit=limits.largest_angle, cause=cause)
    largest = max(float(measured.max()), -float(measured.min())) if measured.size else 0.0
    if limits.load_cell_range is not None and largest > limits.load_cell_range:
        raise REFUSALS["load"].of(**names, largest=largest, limit=limits.load_cell_range)


def check_unit_of_time(trial: Trial) -> None:
    """Refuse samples that are too close for any recorder of a joint. Stamps of a late host come in clusters, most of
    them microseconds apart. The mean step knows nothing of that."""
    time = trial.arrays()[0]
    step = float(np.ptp(time)) / (len(time) - 1) if len(time) > 1 else 0.0
    if 0 < step < 1e-5:  # no recorder of a joint is faster than 100 kHz
        raise REFUSALS["step"].of(trial=trial.name, step=step, rate=1 / step)


def recorded_values(trial: Trial, column: str | None) -> Array:
    """The finite values of a column where it was sampled, (n,); empty where the trial does not have it."""
    values = sampled(trial, column)[1]
    return values[np.isfinite(values)]


def check_changes(column: str, values: Array) -> None:
    """Refuse a signal (n,) that never changes, as that of a dead sensor."""
    check_measured(column, values)
    if not np.ptp(values):
        raise REFUSALS["still"].of(column=column, value=values[0])


def check_resists(trial: str, symbol: str, value: float, high: float | None = None) -> None:
    """Refuse a negative estimate of what can only resist motion: belt stiffness, joint damping, a rendered stiffness. A
    torque that is read with the wrong sign changes the sign of every estimate, and the fit is as good as before. Where
    `high`, the upper end of the interval, is positive, it may be the estimate of a joint without stiffness."""
    if value < 0 and (high is None or high < 0):
        raise REFUSALS["negative"].of(trial=trial, symbol=symbol, value=value)


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


def plausible(table: pl.DataFrame, rails: Saturated, p: DrivetrainParameters | None, *names: str) -> pl.DataFrame:
    """Rows of belt, transmission or actuator with `saturated_samples`, each named estimate's ratio to the parameter
    file's, null without one or where that is 0, and `not_checked`, which says so. Raises InputError: the first of the
    estimates is negative: torque, angle or current has the wrong sign."""
    if names[0] != "k_tau_n_m":
        check_resists(rails.trial, names[0], table[names[0]][-1])
    elif table["k_tau_n_m_high"][-1] < 0:
        raise REFUSALS["driving"].of(trial=rails.trial, value=table["k_tau_n_m"][-1])
    known = {name: p.k_tau * p.n_m if name == "k_tau_n_m" else getattr(p, name) for name in names} if p else {}
    ratios = [(pl.col(name) / pl.lit(known.get(name) or None, pl.Float64)).alias(f"{name}_ratio") for name in names]
    return rails.beside(table).with_columns(*ratios, not_checked(NO_PARAMETERS if p is None else ""))


def plausible_impedance(
    table: pl.DataFrame, rails: Saturated, p: DrivetrainParameters | None, predicted: float | None = None
) -> pl.DataFrame:
    """The rows of Eq. 15 with `saturated_samples`, `K_over_K_s` and `K_ratio`, K over what the gains should give.
    `K_ratio` is that of the largest amplitude in every row: friction changes K least there. `predicted` is the K
    [N*m/rad] of linear theory; None where the gains are not known. Without a parameter file K_s is not known. Raises
    InputError: K is negative, its interval too, or larger than that of the belt through which the motor acts."""
    K, high = table["K"][-1], table["K_high"][-1]
    check_resists(rails.trial, "K", K, high)
    if p is not None and K > 1.1 * p.K_s:  # a motor in series with the belt; a tenth allows for the belt at hand
        ratio, reference = K / (predicted or p.K_s), "what the gains should give" if predicted else "K_s"
        factor = known_factor(ratio)
        cause = (
            f"{factor}: correct the `unit` or the `scale` in the source file"
            if factor
            else "check unit and scale of the channels in the source file"
        )
        raise REFUSALS["belt"].of(trial=rails.trial, K=K, K_s=p.K_s, ratio=ratio, reference=reference, cause=cause)
    largest = pl.lit(table.sort("amplitude_deg", nulls_last=False)["K"][-1])
    of_gains = (largest / predicted if predicted else pl.lit(None, pl.Float64)).alias("K_ratio")
    of_belt = (pl.col("K") / p.K_s if p and p.K_s else pl.lit(None, pl.Float64)).alias("K_over_K_s")
    return rails.beside(table).with_columns(of_belt, of_gains)


@dataclass(frozen=True)
class Tellable:
    """What a small error of the torque in its most harmful shape does to the estimates."""

    stiffness: float  # change of K [N*m/rad]
    inertia: float  # change of I [kg*m^2]
    amplified: float  # change of K over that of torque over angle: 1 where angle and acceleration are not alike


def told_by(theta: Array, omega: Array, alpha: Array, torque_rms: float) -> Tellable:
    """The change of K and I by an error of 0.1 % of the torque's RMS, which calibrations and models leave, that has the
    shape of their own parts of the motion. Angle [rad], velocity and acceleration are filtered and without their means,
    shape (n,) each; `torque_rms` [N*m] is that of the filtered torque. The own part of the acceleration is what angle
    and velocity do not explain. A slow motion has little of it."""
    error, tiny = 1e-3 * torque_rms, float(np.finfo(float).tiny)
    of_theta, of_alpha = max(own_part(theta, omega, alpha), tiny), max(own_part(alpha, omega, theta), tiny)
    return Tellable(error / of_theta, error / of_alpha, rms(theta) / of_theta)


def own_part(column: Array, *others: Array) -> float:
    """RMS of a column (n,) without what is proportional to others (n,)."""
    X = np.column_stack(others)
    return rms(column - X @ np.linalg.lstsq(X, column, rcond=None)[0])


def check_told(
    what: str,
    band_hz: tuple[float, float],
    change: Tellable,
    stiffness: tuple[float, float],
    largest_inertia_error: float | None,
) -> None:
    """Refuse a motion whose band [Hz] cannot tell K from I, with K and its standard error; the message begins with
    `what` and names the band that is missing (IdentifiabilityError)."""
    (low, high), (K, K_se) = band_hz, stiffness
    names = {"what": what, "low": low, "high": high}
    if largest_inertia_error is not None and change.inertia > largest_inertia_error:
        needed = max(high * np.sqrt(change.inertia / (0.5 * largest_inertia_error)), 1.5 * high)
        raise REFUSALS["fast motion"].of(**names, change=change.inertia, limit=largest_inertia_error, needed=needed)
    # K by a tenth, and three times what the error is of torque over angle: without stiffness there is no share of K. It
    # is 1.6 from 0.5 to 6 Hz.
    if change.stiffness > max(0.1 * abs(K), K_se) and change.amplified > 3:
        raise REFUSALS["slow motion"].of(**names, change=change.stiffness)
