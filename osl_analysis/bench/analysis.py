"""What all fits of a trial on the dynamometer share: fits by label, table rows, series for a
report, the time base, and limits of what an estimate can be."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import reduce

import numpy as np
import polars as pl
from numpy.typing import NDArray

from osl_analysis.bench.bench_settings import NOT_STATED, BenchStiffness, Calibration
from osl_analysis.bench.effects import (
    Fault,
    Model,
    noise_of_angle,
    plain_sums,
    with_effects,
)
from osl_analysis.bench.gram import GroupFit, Sums, held_out_vaf
from osl_analysis.bench.record import Record
from osl_analysis.bench.recorded_motion import SHORTEST_S
from osl_analysis.bench.row_groups import Label
from osl_analysis.errors import IdentifiabilityError, InputError
from osl_analysis.measured import check_measured, rms
from osl_analysis.model.drivetrain import DrivetrainParameters
from osl_analysis.signals.grid import UniformSignals
from osl_analysis.spectral.stepped_sine import moving_bins
from osl_analysis.stats.regression import (
    LinearFit,
    Row,
    covariance_row,
    diagnostics_row,
    estimates_row,
    thinned_rows,
    whiteness_row,
    with_shared_error,
)
from osl_analysis.trial import Array
from osl_analysis.units import known_factor


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
            " instead of resisting it; turn the `sign` of the torque, or of the angle, in the"
            " source file"
        )


def plausible(
    table: pl.DataFrame, rails: pl.Expr, p: DrivetrainParameters | None, *names: str
) -> pl.DataFrame:
    """Rows of belt, transmission or actuator with `saturated_samples`, and the ratio of each named
    estimate to the parameter file's; null without a file, or if that is 0. Raises InputError: the
    first estimate is negative, because torque, angle or current has the wrong sign."""
    last = table.row(-1, named=True)
    if names[0] != "k_tau_n_m":
        check_resists(last["trial"], names[0], last[names[0]])
    elif last["k_tau_n_m_high"] < 0:
        raise InputError(
            f"trial {last['trial']}: k_tau_n_m = {last['k_tau_n_m']:.4g} N*m/A is negative, a"
            " positive current gives a negative torque; turn the `sign` of the current, or of"
            " torque_m and theta_m, in the source file"
        )
    known = (
        {name: p.k_tau * p.n_m if name == "k_tau_n_m" else getattr(p, name) for name in names}
        if p
        else {}
    )
    ratios = [
        (pl.col(name) / pl.lit(known.get(name) or None, pl.Float64)).alias(f"{name}_ratio")
        for name in names
    ]
    return table.with_columns(rails, *ratios)


def plausible_impedance(
    table: pl.DataFrame,
    rails: pl.Expr,
    p: DrivetrainParameters | None,
    is_this_leg: bool = True,
    predicted: float | None = None,
    K_d: float | None = None,
) -> pl.DataFrame:
    """The rows of Eq. 15 with `saturated_samples`, `K_over_K_s`, and `K_ratio`, K over the K
    `predicted` by linear theory [N*m/rad]. If the gains are not known, `K_over_K_d` has K over the
    stated K_d [N*m/rad] instead. Both take K at the largest amplitude, where friction changes it
    least. If only the parameter file says that the joint `is_this_leg`, `K_over_K_s` is null up to
    1, since another device may be that soft. Above 1 a unit may be wrong, or the file is of another
    device. Raises InputError: K and its interval are negative, or K of this leg is larger than that
    of its belt."""
    last = table.row(-1, named=True)
    K = last["K"]
    # the belt is in series with a motor; 10 % for its tolerance
    if p is not None and is_this_leg and K > 1.1 * p.K_s:
        ratio, reference = (
            K / (predicted or p.K_s),
            "what the gains should give" if predicted else "K_s",
        )
        name, size = known_factor(ratio)
        factor = name and f"{size:.3g} is the factor {name}"
        what = (
            "correct the `unit` or the `scale`"
            if factor
            else "check unit and scale of the channels"
        )
        raise InputError(
            f"trial {last['trial']}: K = {K:.4g} N*m/rad is larger than the belt's K_s = {p.K_s:g}"
            f" of the parameter file, which no motor behind the belt can render; it is {ratio:.3g}"
            f" times {reference}: {factor and f'{factor}: '}{what} in the source file"
        )
    largest = pl.lit(table.sort("amplitude_deg", nulls_last=False)["K"][-1])
    none = pl.lit(None, pl.Float64)
    of_gains = (largest / predicted if predicted else none).alias("K_ratio")
    of_sheet = (none if predicted or not K_d else largest / K_d).alias("K_over_K_d")
    of_belt = pl.col("K") / p.K_s if p and p.K_s else none
    of_belt = of_belt if is_this_leg else pl.when(of_belt > 1).then(of_belt)
    return table.with_columns(rails, of_belt.alias("K_over_K_s"), of_gains, of_sheet)


# RMS of the angle over that of its part orthogonal to omega and alpha; below, K hardly depends on I
OWN_ANGLE = 1.25
FAR_TOO_LARGE = 10.0  # multiples of the largest error of I above which units are wrong


def check_told(
    what: str,
    band_hz: tuple[float, float],
    motion: Array,
    torque_rms: float,
    stiffness: tuple[float, float],
    largest_inertia_error: float | None,
) -> float:
    """The error of I [kg*m^2] that its interval must include if the motion hardly determines I,
    else 0.

    Refuses a motion whose band [Hz] cannot tell K from I (IdentifiabilityError); the message begins
    with `what` and names the missing band. The criterion is an error of 0.1 % of the torque's RMS,
    as calibrations and models leave, in the shape of the part of a column that is orthogonal to the
    others. Slow motion has little of it. If the angle is nearly all such a part, as in ramps
    between levels, K is known without I. `motion`: angle [rad], velocity and acceleration,
    filtered, without means, (3, n); `torque_rms` [N*m]: filtered; `stiffness`: K and its standard
    error."""
    theta, omega, alpha = motion

    def own_part(column: Array, *others: Array) -> float:
        X = np.column_stack(others)
        return max(
            rms(column - X @ np.linalg.lstsq(X, column, rcond=None)[0]), float(np.finfo(float).tiny)
        )

    of_K, of_I = (
        1e-3 * torque_rms / own_part(*x) for x in ((theta, omega, alpha), (alpha, omega, theta))
    )
    (low, high), (K, K_se) = band_hz, stiffness
    cannot = (
        f"{what}: a motion of {low:.2g} to {high:.2g} Hz cannot tell K from I: an error of 0.1 % of"
        " the torque"
    )
    most = np.inf if largest_inertia_error is None else largest_inertia_error
    told = rms(theta) < OWN_ANGLE * own_part(theta, omega, alpha) and of_I < FAR_TOO_LARGE * most
    if of_I > most and not told:
        needed = max(high * np.sqrt(of_I / (0.5 * most)), 1.5 * high)
        raise IdentifiabilityError(
            f"{cannot} changes I by {of_I:.2g} kg*m^2, more than the {most:g} of"
            f" `largest_inertia_error` in the configuration; the band from {high:.2g} to about"
            f" {needed:.2g} Hz is missing, excite it as well, or take the stiffness alone by"
            " experiment 'torque_angle', or check the units of theta and torque, by which K would"
            f" be {K:.3g} N*m/rad"
        )
    # Without stiffness a tenth of K is no limit: the angle's RMS must also exceed three times that
    # of its own part. This ratio is 1.6 from 0.5 to 6 Hz.
    if of_K > max(0.1 * abs(K), K_se) and rms(theta) > 3 * own_part(theta, omega, alpha):
        raise IdentifiabilityError(
            f"{cannot} changes K by {of_K:.2g} N*m/rad; the band below {low:.2g} Hz is missing,"
            " excite it as well"
        )
    return of_I if of_I > most else 0.0


QUANTITIES = ("K", "B", "I")  # parameters of Eq. 15
LITTLE = {"K": 0.0, "B": 2.0, "I": 5e-3}
"""Sizes of K, B [N*m*s/rad] and I [kg*m^2], added in quadrature to the divisor of a relative
change."""
SumsOf = Callable[[Record, Model], Sums]
PER_ANGLE = dict.fromkeys(("K", "B", "I", "K_s", "B_j", "J_j", "B_m", "J_m", "weight"), 1) | {
    "K_s2": 2
}
"""Powers of the angle by which estimates are multiplied to give a torque."""
ALSO = {"K_s2": "square", "weight": "theta"}  # columns of estimates that no model names


@dataclass(frozen=True)
class Analysis:
    """A model fitted to a record: to each label, and to all of it (None)."""

    record: Record
    sums: Sums
    model: Model
    # the intervals include the error of the bench's stiffness; offsets are at angle 0
    fits: Mapping[Label, GroupFit]
    # the same with the other reading of undecided stamps; empty: all are decided
    others: Mapping[Label, LinearFit]
    label: Label = None  # of the fit that stands for the trial

    @property
    def whole(self) -> GroupFit:
        return self.fits[self.label]

    def row(self, label: Label, *names: str) -> Row:
        """The first columns of every amplitude's rows: estimates, covariances, repeatability (null:
        no repeats), diagnostics."""
        fit = self.calibrated(self.fits[label], label)
        return {
            **self.place(label),
            **estimates_row(fit, *names),
            **self.beside_estimates(label, *names),
        }

    def place(self, label: Label) -> Row:
        """Trial and amplitude of a row."""
        commanded = {each.label: each.commanded_deg for each in self.record.groups.strata}
        return {
            "trial": self.record.name,
            "amplitude_deg": label if isinstance(label, float) else None,
            "commanded_deg": commanded.get(label),
        }

    def beside_estimates(self, label: Label, *names: str) -> Row:
        """The columns of a row beside its place and its estimates."""
        fit = self.calibrated(self.fits[label], label)
        return {
            **estimates_row(fit, "offset"),
            **covariance_row(fit, *names),
            **{f"{name}_se_bench": fit.se_bench(name) for name in names},
            **{f"{name}_repeat_se": fit.repeat_se(name) for name in names},
            **self.judged(label),
        }

    def calibrated(self, fit: GroupFit, label: Label = None) -> GroupFit:
        """A fit to a label, of the model or with effects, whose intervals include the stated errors
        of the bench's calibration. Comparisons within a trial do not include them."""
        record, rows, stated = self.record, self.record.rows(label), self.record.calibration
        if stated == NOT_STATED:
            return fit
        sign = record.low_pass(np.tanh(record.motion.omega / 0.01), record.rate_hz)
        columns = dict(self.sums.columns) | {"T_C": sign}
        names = list(
            fit.names if "offset" in fit.names else dict.fromkeys((*self.model, *fit.names))
        )
        X = [columns[self.model.get(name, ALSO.get(name, name))][rows] for name in names]
        torques = torque_errors(record.filtered_torque, record.rate_hz, rows, stated)[:, rows]
        found = np.linalg.lstsq(np.column_stack(X), torques.T)[0][
            [names.index(name) for name in fit.names]
        ]
        of_angle = stated.angle_gain * np.array([PER_ANGLE.get(name, 0) for name in fit.names])
        for change in (stated.torque * fit.estimates, of_angle * fit.estimates, *found.T):
            fit = widened(fit, change, shared=True)
        return fit

    def judged(self, label: Label = None) -> Row:
        """The diagnostics of a fit and of its interval."""
        record, rows = self.record, self.record.rows(label)
        kept = rows[thinned_rows(len(rows), record.rate_hz, record.low_pass)]
        white = whiteness_row(record.filtered_torque[kept] - self.modelled(label, kept))
        return diagnostics_row(self.fits[label], record.rate_hz, white)

    def shared(self, label: Label, *names: str) -> Row:
        """VAF of held-out data, the subtracted drift [N*m/min], and the change by another time
        base."""
        told = {
            "VAF_held_out": held_out_vaf(self.sums, self.model, label),
            "load_cell_drift": 60 * self.record.drift,
        }
        return told | self.time_base_row(label, names)

    def time_base_row(self, label: Label, names: Sequence[str]) -> Row:
        """`time_base_shift`: the largest change of an estimate by the other reading of undecided
        stamps, in half-widths of its 95 % interval; null if the stamps are decided."""
        fit, other = self.fits[label], self.others.get(label)
        if other is None:
            return {"time_base_shift": None}
        half = {name: fit.interval(name)[1] - fit[name] for name in names}
        return {"time_base_shift": max(abs(other[name] - fit[name]) / half[name] for name in names)}

    def time_base(self, names: Sequence[str]) -> pl.DataFrame:
        """The trial's rows of `timebase.csv`."""
        fit, other, words = self.whole, self.others.get(self.label), None
        if other is not None:
            words = ", ".join(
                f"{name} {100 * (other[name] / fit[name] - 1):+.2g} %" for name in names
            )
        assert self.record.uniform is not None  # a trial that was read from a file
        return timebase_table(self.record.uniform, words, self.record.bench)

    def modelled(self, label: Label = None, rows: slice | NDArray[np.intp] = slice(None)) -> Array:
        """Torque [N*m] of the fit to a label in some rows; a label without a fit has that of the
        fit to all."""
        fit = at_zero(self.fits.get(label, self.whole), -self.sums.centre)
        parts = (fit[name] * self.sums.columns[column][rows] for name, column in self.model.items())
        return np.asarray(reduce(np.add, parts))

    def series(self) -> "Series":
        """Measured and modelled torque over the whole trial, by the fit that stands for it."""
        record = self.record
        fitted = np.zeros(len(record.time), dtype=bool)
        fitted[record.rows(self.label)] = True
        return Series(
            record.time,
            record.filtered_torque,
            self.modelled(self.label),
            record.motion.theta,
            fitted,
        )

    def last_seconds(self, label: Label, duration_s: float) -> pl.DataFrame:
        """The last seconds of a label's motion, measured and modelled (Fig. 4). Rests and other
        labels within them have no rows. Rows that are not fitted, such as first cycles, have no
        modelled torque (null)."""
        record = self.record
        moving = record.moving(label) if record.is_stepped_sine else record.pieces
        rows = np.concatenate([np.r_[piece] for piece in moving])
        rows = rows[record.usable[rows]]
        last = rows[rows > rows[-1] - round(duration_s * record.rate_hz)]
        modelled = pl.Series(self.modelled(label, last))
        return pl.DataFrame(
            {
                "time": record.time[last] - record.time[last[0]],
                "theta_deg": np.rad2deg(record.motion.theta[last]),
                "torque": record.filtered_torque[last],
                "torque_model": modelled.set(pl.Series(~np.isin(last, record.rows(label))), None),
            }
        )


def fitted_motion(record: Record, sums: Sums, model: Model, again: SumsOf = plain_sums) -> Analysis:
    """Eq. 15, with the other terms of the `model`, fitted to any motion; the arguments are those of
    `analysed`.

    Raises InputError: the joint hardly moves; IdentifiabilityError: as `check_told`."""
    of, (low, high), moving_s = record.groups, record.band_hz, np.inf
    if not record.is_stepped_sine:
        check_moves(record, sums)
        moving_s = (
            np.count_nonzero(moving_bins(record.time, record.theta)[record.rows()]) / record.rate_hz
        )
    try:
        if moving_s < SHORTEST_S:
            raise IdentifiabilityError("K, B and I cannot be told from so little")
        analysis = analysed(record, sums, model, again)
    except IdentifiabilityError as error:
        if record.is_stepped_sine:  # name its frequencies, and the missing band
            hz, sizes = sorted({float(f"{one.frequency_hz:.3g}") for one in of.strata}), of.labels
            words = (
                f"K and I cannot be told apart: the sines of {', '.join(f'{x:g}' for x in sizes)}"
                f" deg are of {', '.join(f'{f:g}' for f in hz)} Hz alone, and at one frequency K -"
                f" I w^2 is one number; the band below {hz[0] / 2:.2g} Hz or from {2 * hz[-1]:.2g}"
                " Hz is missing, excite it as well"
            )
        else:
            words = (
                f"the joint moves for {moving_s:.2g} of the {record.seconds:.3g} s that are fitted,"
                f" at {low:.2g} to {high:.2g} Hz: {str(error).partition(';')[0]}; keep it moving by"
                " 0.5 to 6 Hz, or take the stiffness alone by experiment 'torque_angle'"
            )
        raise IdentifiabilityError(f"trial {record.name}: {words}") from error
    if not record.is_stepped_sine:
        fit, X = analysis.whole, motion_in(record)
        torque, limit = (
            record.part(record.filtered_torque),
            getattr(record.settings, "largest_inertia_error", None),
        )
        told = (X - X.mean(axis=0)).T, float(np.std(torque)), (fit["K"], fit.se("K"))
        of_I = check_told(f"trial {record.name}", record.band_hz, *told, limit)
        analysis = replace(
            analysis,
            fits={None: widened(fit, of_I * np.array([name == "I" for name in fit.names]))},
        )
    check_stiffer(record.name, "K", analysis.whole["K"], record.bench)
    return analysis


def check_moves(record: Record, sums: Sums) -> None:
    """Refuse a record that moves too little or too slowly. With a few steps of the encoder rounding
    is no noise, but part of the motion. In slow motion the encoder's noise is a tenth or more of
    the power of the acceleration's part that is not proportional to angle and velocity."""
    measured, step, fewest, slow, most = (
        record.part(record.bench_angle),
        record.steps[0],
        20.0,
        200,
        0.1,
    )
    values = len(np.unique(measured))
    levels = values if values <= slow else np.inf  # slow motion has more of them
    steps = float(np.inf if step is None else np.ptp(measured) / step)
    if min(steps, levels) < fewest:
        little = (
            f"the joint hardly moves: theta turns by {steps:.0f} steps of its encoder",
            "move it by more",
        )
        quick = (
            f"theta has {levels:g} values in all, as of steps too quick for its rate",
            "move it more slowly",
        )
        said, remedy = little if steps < fewest else quick
        raise InputError(
            f"trial {record.name}: {said}, {fewest:g} are needed; {remedy}, and check the unit of"
            " theta in the source file"
        )
    A, own, one = sums.total, sums.names.index("alpha"), sums.names.index("one")
    at = sums.index(("theta", "omega", "one"))
    left = A[own, own] - A[own, at] @ np.linalg.lstsq(A[np.ix_(at, at)], A[at, own], rcond=1e-14)[0]
    share = noise_of_angle(record)[2] / max(float(left / A[one, one]), np.finfo(float).tiny)
    if share <= most:
        return
    how, remedy = (
        "hardly moves",
        "move it by more, or faster, and check the unit of theta in the source file",
    )
    if steps >= slow:  # the motion is not small
        how = "moves too slowly"
        remedy = (
            "move it faster, by 0.5 to 6 Hz, or take the stiffness alone by experiment"
            " 'torque_angle'"
        )
    raise InputError(
        f"trial {record.name}: the joint {how}: theta turns by {turn_deg(sums):.2g} deg RMS, and"
        f" noise of the encoder has {share:.2g} times the power of the acceleration's own part"
        f" behind the filter, at most {most:g} is allowed; {remedy}"
    )


def motion_in(record: Record) -> Array:
    """Angle, velocity and acceleration in the fitted rows of a record, (m, 3)."""
    motion = record.motion
    return np.column_stack([record.part(x) for x in (motion.theta, motion.omega, motion.alpha)])


def turn_deg(sums: Sums, label: Label = None) -> float:
    """RMS [deg] of the filtered angle about its mean in the rows of a label."""
    A = sums.over(label)
    theta, one = sums.index(["theta", "one"])
    n = A[one, one]
    return float(np.rad2deg(np.sqrt(max(A[theta, theta] / n - (A[theta, one] / n) ** 2, 0.0))))


def analysed(record: Record, sums: Sums, model: Model, again: SumsOf = plain_sums) -> Analysis:
    """Fit a model to all of a record and to each label that determines it, by its sums; `again`
    gives those of the same record on a softer bench or with other stamps. Raises InputError,
    IdentifiabilityError: as `fit_groups`."""

    def fitted(own: Sums) -> dict[Label, GroupFit]:
        found = dict[Label, GroupFit]()
        for label in dict.fromkeys((*own.groups.labels, None)):
            hz = [one.frequency_hz for one in own.groups.strata if label in (None, one.label)]
            try:
                # noise would tell K from I
                if {"theta", "alpha"} <= {*model.values()} and max(hz) < 1.02 * min(hz):
                    raise IdentifiabilityError(
                        f"K and I cannot be told apart by sines of {hz[0]:.3g} Hz"
                    )
                found[label] = at_zero(with_effects(own, model, (), label), own.centre)
            except IdentifiabilityError:  # a drive may reach fewer frequencies at one amplitude
                if label is None:
                    raise
        return found

    fits = fitted(sums)
    if record.softer is not None:
        softer = fitted(again(record.softer, model))
        both = {x: (fit, softer[x]) for x, fit in fits.items() if x in softer}
        fits = {
            x: widened(fit, soft.estimates - fit.estimates, shared=True)
            for x, (fit, soft) in both.items()
        }
    others = {} if record.other is None else fitted(again(record.other, model))
    return Analysis(record, sums, model, fits, others)


def widened(fit: GroupFit, change: Array, shared: bool = False) -> GroupFit:
    """The fit with an error of type B in its intervals, which changes the estimates by `change`
    (p,) per SD; `shared` by all trials on the bench."""
    found, known = with_shared_error(fit, change), fit.shared + change**2 if shared else fit.shared
    return replace(
        fit, covariance=found.covariance, degrees_of_freedom=found.degrees_of_freedom, shared=known
    )


def torque_errors(
    torque: Array, rate_hz: float, rows: NDArray[np.intp], stated: Calibration
) -> Array:
    """Errors of a smooth torque (n,) [N*m] by one standard uncertainty of the load cell's
    hysteresis and of its delay, (2, n). The loop has the width for the range in `rows` everywhere,
    which is a bound."""
    rate = np.gradient(torque, 1 / rate_hz)
    return np.array([stated.slip * np.ptp(torque[rows]) * np.sign(rate), stated.delay * rate])


def at_zero(fit: GroupFit, centre: float) -> GroupFit:
    """The fit with its offset at angle 0 instead of at the motion's `centre` [rad], or back with a
    negative centre."""
    if "K" not in fit.names:
        return fit
    turn = np.eye(len(fit.names))
    turn[fit.names.index("offset"), fit.names.index("K")] = -centre
    repeat = None if fit.repeat is None else turn @ fit.repeat @ turn.T
    return replace(
        fit,
        estimates=turn @ fit.estimates,
        covariance=turn @ fit.covariance @ turn.T,
        repeat=repeat,
    )


def without_lag(analysis: Analysis, lag: Fault | None, label: Label) -> Row:
    """K, B and I of a label after removal of a lag that was found, its error in the intervals; null
    without one."""
    if lag is None or not lag.found:
        return without_row(None, "without_lag")
    record, fit = analysis.record, analysis.fits[label]
    torques = [
        np.interp(record.time + lag.size, record.time, x)
        for x in (record.torque, record.filtered_torque)
    ]
    s = plain_sums(replace(record, torque=torques[0], filtered_torque=torques[1]), analysis.model)
    made = at_zero(with_effects(s, analysis.model, (), label), s.centre)
    per_s = (made.estimates - fit.estimates) / lag.size
    return without_row(analysis.calibrated(widened(made, per_s * lag.se), label), "without_lag")


def without_row(fit: LinearFit | None, end: str) -> Row:
    """K, B and I, with intervals, of a fit that has a cause as a column, named like `K_without_lag`
    for the `end` `without_lag`. A finding states them beside those without the column. Null without
    a fit."""
    row: Row = {}
    for name in ("K", "B", "I"):
        values = (None, None, None) if fit is None else (fit[name], *fit.interval(name))
        row |= dict(
            zip((f"{name}_{end}{bound}" for bound in ("", "_low", "_high")), values, strict=True)
        )
    return row


def check_stiffer(trial: str, symbol: str, stiffness: float, bench: BenchStiffness | None) -> None:
    """Refuse a stiffness [N*m/rad] that is not below the bench's."""
    if bench is not None and not 0 < stiffness * bench.compliance < 1:
        raise InputError(
            f"trial {trial}: {symbol} = {stiffness:.4g} N*m/rad is not between 0 and the bench's"
            f" stiffness of {bench.value}, so that the frame would yield more than the joint;"
            " correct `bench_stiffness` and its unit in the configuration"
        )


def timebase_table(
    signals: UniformSignals, other_hypothesis: str | None, bench: BenchStiffness | None = None
) -> pl.DataFrame:
    """The trial's rows of `timebase.csv`, one per stream. `other_hypothesis` says how the estimates
    change with the other reading of undecided stamps."""
    shared = {
        "grid_rate_hz": (len(signals.time) - 1) / float(signals.time[-1] - signals.time[0]),
        "first_s": float(signals.time[0]),
        "last_s": float(signals.time[-1]),
        "rows": len(signals.time),
        "masked": int(np.count_nonzero(~signals.usable)),
        "farthest_s": signals.farthest_s,
        "other_hypothesis": other_hypothesis,
        "bench_stiffness": 1 / bench.compliance if bench else None,
        "bench_stiffness_se": (
            bench.compliance_error / bench.compliance**2 or None if bench else None
        ),
    }
    rows = [{"trial": signals.trial, **stream, **shared} for stream in signals.streams]
    text, numbers = (
        ("low_pass", "other_hypothesis"),
        ("ppm", "g", "g_se", "bench_stiffness", "bench_stiffness_se"),
    )
    schema = dict.fromkeys(text, pl.String) | dict.fromkeys(numbers, pl.Float64)
    return pl.DataFrame(rows, schema_overrides=schema, infer_schema_length=None)


@dataclass(frozen=True)
class Series:
    """Measured and modelled signals of one trial, shape (n,) each."""

    time: Array  # time [s]
    torque: Array  # measured torque, as it was fitted [N*m]
    torque_model: Array  # torque of the fitted model [N*m]; NaN where it does not apply
    motion: Array  # angle [rad], or velocity [rad/s] where the bench has no angle
    fitted: NDArray[np.bool_]  # rows that are fitted
    is_velocity: bool = False  # whether `motion` is a velocity

    def table(self, most: int = 10_000) -> pl.DataFrame:
        """Every k-th sample, at most `most` rows. Two minutes of a stepped sine then have some 15
        rows per period of the fastest sine. `torque_model` is null where the fit does not use the
        sample. `residual_low` and `residual_high` [N*m] are the range over the next k samples that
        it uses, so that no outlier is lost."""
        k = max(-(-len(self.time) // most), 1)
        left = np.where(self.fitted, self.torque - self.torque_model, np.nan)
        whole = np.concatenate([left, np.full(-len(left) % k, np.nan)]).reshape(-1, k)
        each = slice(None, None, k)
        motion = (
            {"omega": self.motion[each]}
            if self.is_velocity
            else {"theta_deg": np.rad2deg(self.motion[each])}
        )
        shown = {"time": self.time[each] - self.time[0], **motion, "torque": self.torque[each]}
        model = np.where(self.fitted[each], self.torque_model[each], np.nan)
        columns = {**shown, "torque_model": model}
        columns |= {
            "residual_low": np.fmin.reduce(whole, axis=1),
            "residual_high": np.fmax.reduce(whole, axis=1),
        }
        rounded = {
            name: pl.Series(values, dtype=pl.Float64).round_sig_figs(7)
            for name, values in columns.items()
        }
        return pl.DataFrame(rounded).fill_nan(None)


@dataclass(frozen=True)
class FitTables:
    """The tables of one fit by name. A user who asks for the estimates alone does not wait for the
    others."""

    estimates: Mapping[str, pl.DataFrame]
    """Estimates and curves; and `torque`, the fitted samples: time [s] from the first, measured and
    modelled torque [N*m]."""
    series: Series | None = None  # of a fit that is drawn over time
    compute_others: Callable[[], Mapping[str, pl.DataFrame]] = dict

    def everything(self) -> dict[str, pl.DataFrame]:
        """All tables: `estimates`, the thinned `series`, and the others, which are computed now."""
        of_series = {"series": self.series.table()} if self.series else {}
        return {**self.estimates, **of_series, **self.compute_others()}


def tables_of_fit(
    series: Series,
    compute_others: Callable[[], Mapping[str, pl.DataFrame]],
    **estimates: pl.DataFrame,
) -> FitTables:
    """`FitTables` of the series of a fit, its other tables, and its estimates by name."""
    modelled = series.torque_model
    samples = pl.DataFrame({"time": series.time, "torque": series.torque, "torque_model": modelled})
    fitted = samples.filter(np.isfinite(modelled))
    fitted = fitted.with_columns(pl.col("time") - pl.col("time").first())
    return FitTables({**estimates, "torque": fitted}, series, compute_others)


def share_of_inertia(fit: GroupFit) -> float:
    """Divisor of relative changes of I [kg*m^2]."""
    return float(np.hypot(fit["I"], LITTLE["I"]))


def angle_noise_share(record: Record, s: Sums, fit: GroupFit, label: Label = None) -> float:
    """Relative change of I by noise of the angle; 0 if it is within a standard error, which
    includes it."""
    bias = abs(angle_noise_bias(record, s, fit, label))
    return bias / share_of_inertia(fit) if bias > fit.se("I") else 0.0


def angle_noise_bias(record: Record, s: Sums, fit: GroupFit, label: Label = None) -> float:
    """Change of I [kg*m^2] by noise of the angle, to first order in its variance.

    Least squares treat columns as exact. If S is the covariance of their noise, the bias is
    -(X'X/n)^-1 S times the estimates (Fuller, Measurement Error Models, 1987, ch. 2). The noises of
    angle and acceleration are correlated, so that I is too large for a stiff joint, and too small
    for a light one."""
    still, moving, turning = noise_of_angle(record)
    S = np.array([[still, 0, -moving], [0, moving, 0], [-moving, 0, turning]])
    A = s.over(label)
    at, one = s.index(["theta", "omega", "alpha"]), s.names.index("one")
    X = A[np.ix_(at, at)] / A[one, one] - np.outer(A[at, one], A[at, one]) / A[one, one] ** 2
    return float(-np.linalg.solve(X, S @ [fit["K"], fit["B"], fit["I"]])[2])
