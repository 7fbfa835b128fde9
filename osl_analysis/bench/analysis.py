"""A model fitted to a trial on the dynamometer: to each label and to all of it, with table rows,
modelled torque, the time base, and the stated errors of the bench."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
import polars as pl
from numpy.typing import NDArray

from osl_analysis.bench.bench_settings import NOT_STATED, Calibration
from osl_analysis.bench.effects import Model, noise_of_angle, plain_sums
from osl_analysis.bench.fit_tables import Series, timebase_table
from osl_analysis.bench.identifiability import STIFFNESS_ALONE, check_moves, check_told
from osl_analysis.bench.motion import SHORTEST_S
from osl_analysis.bench.plausibility import check_stiffer
from osl_analysis.bench.record import Label, Record
from osl_analysis.bench.regression import GroupFit, Sums, fit_groups
from osl_analysis.errors import IdentifiabilityError
from osl_analysis.signals import seven_point_motion
from osl_analysis.spectral.stepped_sine import moving_bins
from osl_analysis.stats.linear_fit import LinearFit, with_shared_error
from osl_analysis.stats.table_rows import Row, diagnostics_row, estimates_row
from osl_analysis.trial import Array

QUANTITIES = ("K", "B", "I")  # parameters of Eq. 15
LITTLE = {"K": 0.0, "B": 2.0, "I": 5e-3}
"""Sizes of K, B [N*m*s/rad] and I [kg*m^2], added in quadrature to the divisor of a relative
change."""
PER_ANGLE = {
    **dict.fromkeys(("K", "B", "I", "K_s", "B_j", "J_j", "B_m", "J_m", "weight"), 1),
    "K_s2": 2,
}
"""Powers of the angle by which estimates are multiplied to give a torque."""
FURTHER_COLUMNS = {"K_s2": "square", "weight": "theta"}  # of estimates that no model names
SIGN_WIDTH = 0.01  # rad/s; over which the sign of the velocity changes in the error of friction
SAME_FREQUENCY = 1.02  # ratio of frequencies below which noise alone would tell K from I


@dataclass(frozen=True)
class Analysis:
    """A model fitted to a record: to each label, and to all of it (None).

    Attributes
    ----------
    record, sums, model
        What was fitted.
    fits : Mapping
        By label. Offsets are at angle 0 and in the middle of the fitted rows.
    fits_with_other_stamps : Mapping
        The same with the other reading of undecided stamps; empty: all are decided.
    label
        Of the fit that stands for the trial.
    """

    record: Record
    sums: Sums
    model: Model
    fits: Mapping[Label, GroupFit]
    fits_with_other_stamps: Mapping[Label, LinearFit]
    label: Label = None

    @property
    def whole(self) -> GroupFit:
        return self.fits[self.label]

    def row(self, label: Label, *names: str) -> Row:
        """The first columns of every amplitude's rows: estimates, shared errors, diagnostics."""
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
            "scope": "all" if label is None else "amplitude",
            "amplitude_deg": label if isinstance(label, float) else None,
            "commanded_deg": commanded.get(label),
        }

    def beside_estimates(self, label: Label, *names: str) -> Row:
        """The columns of a row beside its place and its estimates.

        Parameters
        ----------
        label
            Whose rows were fitted.
        names
            The estimates.
        """
        fit = self.calibrated(self.fits[label], label)
        return {
            **{f"{name}_se_bench": fit.se_bench(name) for name in names},
            **diagnostics_row(fit, fit.interval_method),
        }

    def calibrated(self, fit: GroupFit, label: Label = None) -> GroupFit:
        """Add what is stated of the bench to the intervals of a fit: the errors of its calibration,
        its stiffness and its fixture, to first order.

        Comparisons within a trial do not include them.

        Parameters
        ----------
        fit
            To a label, of the model or with effects.
        label
            Whose rows were fitted.
        """
        record = self.record
        stated = record.calibration
        bench = record.bench
        fixture = record.fixture
        if stated == NOT_STATED and fixture is None and bench is None:
            return fit
        rows = record.rows(label)
        motion = record.motion
        sign = record.low_pass(np.tanh(motion.omega / SIGN_WIDTH), record.rate_hz)
        columns = {**self.sums.columns, "T_C": sign}
        names = list(fit.names)
        if "offset" not in names:
            names = list(dict.fromkeys((*self.model, *fit.names)))
        column_of = {**FURTHER_COLUMNS, **self.model}
        X = np.column_stack([columns[column_of.get(name, name)][rows] for name in names])

        torques = [*torque_errors(record.filtered_torque, record.rate_hz, rows, stated)]
        if fixture is not None:
            sine = np.sin(motion.theta - np.deg2rad(fixture.rest_deg))
            torques += [fixture.inertia_error * motion.alpha, fixture.weight_error * sine]
        if bench is not None:
            torques.append(torque_by_frame(self.model, fit, record, bench.compliance_error))
        by_torques = np.linalg.lstsq(X, np.column_stack(torques)[rows])[0]
        by_torques = by_torques[[names.index(name) for name in fit.names]]

        powers = np.array([PER_ANGLE.get(name, 0) for name in fit.names])
        by_torque_gain = stated.torque * fit.estimates
        by_angle_gain = stated.angle_gain * powers * fit.estimates
        for change in (by_torque_gain, by_angle_gain, *by_torques.T):
            fit = widened(fit, change, of_bench=True)
        return fit

    def time_base_row(self, label: Label, names: Sequence[str]) -> Row:
        """`time_base_shift`: the largest change of an estimate by the other reading of undecided
        stamps, in half-widths of its 95 % interval; null if the stamps are decided."""
        fit = self.fits[label]
        other = self.fits_with_other_stamps.get(label)
        if other is None:
            return {"time_base_shift": None}
        shifts = []
        for name in names:
            half_width = fit.interval(name)[1] - fit[name]
            shifts.append(abs(other[name] - fit[name]) / half_width)
        return {"time_base_shift": max(shifts)}

    def time_base(self) -> pl.DataFrame:
        """The trial's rows of `timebase.csv`."""
        return timebase_table(self.record.uniform)

    def modelled(self, label: Label = None, rows: slice | NDArray[np.intp] = slice(None)) -> Array:
        """Torque [N*m] of the fit to a label in some rows; a label without a fit has that of the
        fit to all."""
        fitted_label = label if label in self.fits else self.label
        fit = at_zero(self.fits[fitted_label], -self.sums.centre)
        columns = self.sums.columns
        torque = np.zeros_like(self.record.time[rows])
        for name, column in self.model.items():
            values = columns[column]
            if column == "ramp":
                # drift counts from the mean time of the fitted rows, so that it does not change the
                # offset (`regression.fit_groups`)
                values = values - values[self.record.rows(fitted_label)].mean()
            torque += fit[name] * values[rows]
        return torque

    def series(self) -> Series:
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


def fitted_motion(record: Record, sums: Sums, model: Model) -> Analysis:
    """Fit Eq. 15, with the other terms of a model, to any motion.

    Parameters
    ----------
    record, sums, model
        As `analysed` takes them.

    Raises
    ------
    InputError
        The joint hardly moves.
    IdentifiabilityError
        The motion cannot tell K, B and I; the message names the missing band.
    """
    moving_s = np.inf
    if not record.is_stepped_sine:
        check_moves(record, sums)
        is_moving = moving_bins(record.time, record.theta)[record.rows()]
        moving_s = np.count_nonzero(is_moving) / record.rate_hz
    try:
        if moving_s < SHORTEST_S:
            raise IdentifiabilityError("K, B and I cannot be told from so little")
        analysis = analysed(record, sums, model)
    except IdentifiabilityError as error:
        missing = missing_band(record, moving_s, error)
        raise IdentifiabilityError(f"trial {record.name}: {missing}, {STIFFNESS_ALONE}") from error
    if not record.is_stepped_sine:
        fit = with_error_of_inertia(analysis)
        analysis = replace(analysis, fits={None: fit})
    check_stiffer(record.name, "K", analysis.whole["K"], record.bench)
    return analysis


def missing_band(record: Record, moving_s: float, error: IdentifiabilityError) -> str:
    """Which part of a motion is missing that would tell K, B and I."""
    if record.is_stepped_sine:
        strata = record.groups.strata
        hz = sorted({float(f"{stratum.frequency_hz:.3g}") for stratum in strata})
        amplitudes = ", ".join(f"{label:g}" for label in record.groups.labels)
        return (
            f"K and I cannot be told apart: the sines of {amplitudes} deg are of"
            f" {', '.join(f'{f:g}' for f in hz)} Hz alone, and at one frequency K - I w^2 is one"
            f" number; excite it below {hz[0] / 2:.2g} Hz or from {2 * hz[-1]:.2g} Hz as well"
        )
    low_hz, high_hz = record.band_hz
    reason = error.reason
    return (
        f"the joint moves for {moving_s:.2g} of the {record.seconds:.3g} s that are fitted, at"
        f" {low_hz:.2g} to {high_hz:.2g} Hz: {reason}; keep it moving by 0.5 to 6 Hz"
    )


def with_error_of_inertia(analysis: Analysis) -> GroupFit:
    """The fit to all of a motion, with the error of I that its band leaves. Raises as
    `check_told`."""
    record = analysis.record
    fit = analysis.whole
    of_record = record.motion
    signals = (of_record.theta, of_record.omega, of_record.alpha)
    motion = np.array([record.part(signal) for signal in signals])
    error_of_I = check_told(
        f"trial {record.name}",
        record.band_hz,
        motion - motion.mean(axis=1, keepdims=True),
        float(np.std(record.part(record.filtered_torque))),
        (fit["K"], fit.se("K")),
        getattr(record.settings, "largest_inertia_error", None),
    )
    return widened(fit, error_of_I * np.array([name == "I" for name in fit.names]))


def analysed(record: Record, sums: Sums, model: Model) -> Analysis:
    """Fit a model, the column of each estimate, to all of a record and to each label that
    determines it. Raises as `fit_groups`."""
    others: Mapping[Label, GroupFit] = {}
    if record.with_other_stamps is not None:
        others = fits_by_label(plain_sums(record.with_other_stamps, model), model)
    return Analysis(record, sums, model, fits_by_label(sums, model), others)


def fits_by_label(sums: Sums, model: Model) -> dict[Label, GroupFit]:
    """Fits to each label that determines the model, and to all (None). Raises as `fit_groups`."""
    tells_K_from_I = {"theta", "alpha"} <= set(model.values())
    fits: dict[Label, GroupFit] = {}
    for label in dict.fromkeys((*sums.groups.labels, None)):
        strata = [stratum for stratum in sums.groups.strata if label in (None, stratum.label)]
        hz = [stratum.frequency_hz for stratum in strata]
        try:
            if tells_K_from_I and max(hz) < SAME_FREQUENCY * min(hz):
                raise IdentifiabilityError(
                    f"K and I cannot be told apart by sines of {hz[0]:.3g} Hz"
                )
            fits[label] = at_zero(fit_groups(sums, model, label), sums.centre)
        except IdentifiabilityError:  # a drive may reach fewer frequencies at one amplitude
            if label is None:
                raise
    return fits


def widened(fit: GroupFit, change: Array, of_bench: bool = False) -> GroupFit:
    """The fit with an error of type B in its intervals, which changes the estimates by `change`
    (p,) per standard deviation; `of_bench`: all trials on the bench have the same error."""
    with_error = with_shared_error(fit, change)
    bench_variance = fit.bench_variance + change**2 if of_bench else fit.bench_variance
    return replace(
        fit,
        covariance=with_error.covariance,
        degrees_of_freedom=with_error.degrees_of_freedom,
        bench_variance=bench_variance,
    )


def torque_by_frame(model: Model, fit: LinearFit, record: Record, compliance_error: float) -> Array:
    """Torque (n,) [N*m] by which a fit is off if the bench yields by `compliance_error`
    [rad/(N*m)] more: the joint then turns by so much less per torque."""
    yielding = seven_point_motion(compliance_error * record.filtered_torque, record.rate_hz)
    by_column = {
        "theta": yielding.theta,
        "square": 2 * np.abs(record.motion.theta - record.motion.theta[0]) * yielding.theta,
        "omega": yielding.omega,
        "alpha": yielding.alpha,
    }
    column_of = {**FURTHER_COLUMNS, **model}
    torque = np.zeros(len(record.time))
    for name in fit.names:
        if column_of.get(name) in by_column:
            torque += fit[name] * by_column[column_of[name]]
    return torque


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
    columns, one = s.index(["theta", "omega", "alpha"]), s.names.index("one")
    n = A[one, one]
    X = A[np.ix_(columns, columns)] / n - np.outer(A[columns, one], A[columns, one]) / n**2
    return float(-np.linalg.solve(X, S @ [fit["K"], fit["B"], fit["I"]])[2])
