"""A model fitted to a trial on the bench: to each label and to all of it, with table rows, modelled
torque, the stated errors of the bench, and how a user gets at the tables."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
import polars as pl
from numpy.typing import NDArray

from osl_analysis.bench.bench_settings import NOT_STATED, Calibration
from osl_analysis.bench.plausibility import STIFFNESS_ALONE
from osl_analysis.bench.record import Label, Record
from osl_analysis.bench.regression import GroupFit, Model, Sums, fit_groups, plain_sums
from osl_analysis.dictionary import table_of
from osl_analysis.errors import IdentifiabilityError
from osl_analysis.signals import seven_point_motion
from osl_analysis.signals.grid import UniformSignals
from osl_analysis.stats.estimates import Row, estimates_row
from osl_analysis.stats.linear_fit import LinearFit
from osl_analysis.trial import Array

QUANTITIES = ("K", "B", "I")  # parameters of Eq. 15
OF_ANGLE = ("theta", "omega", "alpha", "B_m", "J_m")  # columns in proportion to the angle
SIGN_WIDTH = 0.01  # rad/s; over which the sign of the velocity changes in the error of friction
MOST_SHOWN = 10_000  # rows of a series; two minutes of a stepped sine have 15 per fastest period
SAME_FREQUENCY = 1.02  # ratio of frequencies below which noise alone would tell K from I


@dataclass(frozen=True)
class Series:
    """Measured and modelled signals of one trial, shape (n,) each."""

    time: Array  # time [s]
    torque: Array  # measured torque, as it was fitted [N*m]
    torque_model: Array  # torque of the fitted model [N*m]; NaN where it does not apply
    motion: Array  # angle [rad], or velocity [rad/s] where the bench has no angle
    fitted: NDArray[np.bool_]  # rows that are fitted
    uniform: UniformSignals | None  # how the signals came on their time base
    is_velocity: bool = False  # whether `motion` is a velocity

    def table(self) -> pl.DataFrame:
        """Every k-th sample, at most `MOST_SHOWN` rows.

        `torque_model` is null where the fit does not use the sample. `residual_low` and
        `residual_high` [N*m] are the range over the next k samples that it uses, so that no outlier
        is lost.
        """
        k = max(-(-len(self.time) // MOST_SHOWN), 1)
        modelled = np.where(self.fitted, self.torque_model, np.nan)
        motion = {"omega": self.motion}
        if not self.is_velocity:
            motion = {"theta_deg": np.rad2deg(self.motion)}
        samples = pl.DataFrame(
            {
                "part": np.arange(len(self.time)) // k,
                "time": self.time - self.time[0],
                **motion,
                "torque": self.torque,
                "torque_model": modelled,
                "residual": self.torque - modelled,
            }
        ).fill_nan(None)
        parts = samples.group_by("part", maintain_order=True).agg(
            pl.exclude("residual").first(),
            residual_low=pl.col("residual").min(),
            residual_high=pl.col("residual").max(),
        )
        return parts.select(pl.exclude("part").round_sig_figs(7))


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
        """All tables: `estimates`, the thinned `series`, `timebase`, which has a row per stream and
        none where no grid was needed, and the others, which are computed now."""
        tables = {**self.estimates, **self.compute_others()}
        if self.series is not None:
            rows = []
            if uniform := self.series.uniform:
                rows = [{"trial": uniform.trial, **stream} for stream in uniform.streams]
            tables["series"] = self.series.table()
            tables["timebase"] = table_of(rows, "timebase")
        return tables


def tables_of_fit(
    series: Series,
    compute_others: Callable[[], Mapping[str, pl.DataFrame]] = dict,
    **estimates: pl.DataFrame,
) -> FitTables:
    """`FitTables` of the series of a fit, its other tables, and its estimates by name."""
    modelled = series.torque_model
    samples = pl.DataFrame({"time": series.time, "torque": series.torque, "torque_model": modelled})
    fitted = samples.filter(np.isfinite(modelled))
    fitted = fitted.with_columns(pl.col("time") - pl.col("time").first())
    return FitTables({**estimates, "torque": fitted}, series, compute_others)


@dataclass(frozen=True)
class Analysis:
    """A model fitted to a record: to each label, and to all of it (None).

    Attributes
    ----------
    record, sums, model
        What was fitted.
    fits : Mapping
        By label. Offsets are in the middle of the angle and of the fitted rows.
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
        """The first columns of every amplitude's rows: place, estimates, diagnostics."""
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
        """The errors of estimates that all trials on a bench share, and the fit's diagnostics."""
        fit = self.calibrated(self.fits[label], label)
        return {
            **{f"{name}_se_bench": fit.se_bench(name) for name in names},
            "interval_method": fit.interval_method,
            "VAF": fit.vaf,
            "condition_number": fit.condition_number,
            "largest_correlation": fit.largest_correlation,
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
        stated, fixture = record.settings.calibration, record.settings.fixture
        bench = record.settings.bench_stiffness
        if stated == NOT_STATED and fixture is None and bench is None:
            return fit
        rows = record.rows(label)
        motion = record.motion
        sign = record.settings.low_pass(np.tanh(motion.omega / SIGN_WIDTH), record.rate_hz)
        column_of = {**self.model, "T_C": "T_C"}
        names = list(dict.fromkeys((*fit.names, *self.model)))
        columns = {**self.sums.columns, "T_C": sign}
        X = np.column_stack([columns[column_of[name]] for name in names])
        estimates = np.array([fit[name] if name in fit.names else 0.0 for name in names])
        is_of_angle = np.array([column_of[name] in OF_ANGLE for name in names])

        torques = [
            stated.torque * (X @ estimates),
            stated.angle_gain * (X @ (estimates * is_of_angle)),
            *torque_errors(record.filtered_torque, record.rate_hz, rows, stated),
        ]
        if fixture is not None:
            sine = np.sin(motion.theta - np.deg2rad(fixture.rest_deg))
            torques += [fixture.inertia_error * motion.alpha, fixture.weight_error * sine]
        if bench is not None:
            # a frame that yields more turns the joint by so much less
            yielded = bench.compliance_error * record.filtered_torque
            of_frame = vars(seven_point_motion(yielded, record.rate_hz))
            torques += [
                np.sum(
                    [
                        estimate * of_frame[column_of[name]]
                        for name, estimate in zip(names, estimates, strict=True)
                        if column_of[name] in of_frame
                    ],
                    axis=0,
                )
            ]
        changes = np.linalg.lstsq(X[rows], np.column_stack(torques)[rows])[0]
        for change in changes[: len(fit.names)].T:
            fit = widened(fit, change, of_bench=True)
        return fit

    def time_base_row(self, label: Label, names: Sequence[str]) -> Row:
        """`time_base_shift`: the largest change of an estimate by the other reading of undecided
        stamps, in half-widths of its 95 % interval; null if the stamps are decided."""
        fit = self.fits[label]
        other = self.fits_with_other_stamps.get(label)
        if other is None:
            return {"time_base_shift": None}
        shifts = [
            abs(other[name] - fit[name]) / (fit.interval(name)[1] - fit[name]) for name in names
        ]
        return {"time_base_shift": max(shifts)}

    def modelled(self, label: Label = None) -> Array:
        """Torque (n,) [N*m] of the fit to a label; a label without a fit has that of the fit to
        all."""
        fit = self.fits.get(label, self.whole)
        torque = np.zeros(len(self.record.time))
        for name, column in self.model.items():
            torque += fit[name] * self.sums.columns[column]
        return torque

    def series(self) -> Series:
        """Measured and modelled torque over the whole trial, by the fit that stands for it."""
        record = self.record
        return Series(
            record.time,
            record.filtered_torque,
            self.modelled(self.label),
            record.motion.theta,
            record.is_fitted(self.label),
            record.uniform,
        )

    def last_seconds(self, label: Label, duration_s: float) -> pl.DataFrame:
        """The last seconds of a label's motion, measured and modelled (Fig. 4). Rests and other
        labels within them have no rows. Rows that are not fitted, such as first cycles, have no
        modelled torque (null)."""
        record = self.record
        is_moving = record.is_fitted(label)
        for stratum in record.groups.strata:
            if label in (None, stratum.label):
                is_moving[stratum.rows] = True
        rows = np.flatnonzero(is_moving & record.usable)
        last = rows[rows > rows[-1] - round(duration_s * record.rate_hz)]
        modelled = np.where(record.is_fitted(label), self.modelled(label), np.nan)
        return pl.DataFrame(
            {
                "time": record.time[last] - record.time[last[0]],
                "theta_deg": np.rad2deg(record.motion.theta[last]),
                "torque": record.filtered_torque[last],
                "torque_model": pl.Series(modelled[last]).fill_nan(None),
            }
        )


def analysed(record: Record, model: Model, sums: Sums | None = None) -> Analysis:
    """Fit a model to all of a record and to each label that determines it.

    Parameters
    ----------
    record
        Signals and groups.
    model
        The column of each estimate.
    sums
        Those of the record, by default of the columns of Eq. 15.

    Raises
    ------
    IdentifiabilityError
        As `fit_groups`.
    """
    others: Mapping[Label, GroupFit] = {}
    if record.with_other_stamps is not None:
        others = fits_by_label(plain_sums(record.with_other_stamps, model), model)
    if sums is None:
        sums = plain_sums(record, model)
    return Analysis(record, sums, model, fits_by_label(sums, model), others)


def fits_by_label(sums: Sums, model: Model) -> dict[Label, GroupFit]:
    """Fits to each label that determines the model, and to all (None). Raises as `fit_groups`."""
    tells_K_from_I = {"theta", "alpha"} <= set(model.values())
    fits: dict[Label, GroupFit] = {}
    for label in dict.fromkeys((*(stratum.label for stratum in sums.groups.strata), None)):
        strata = [stratum for stratum in sums.groups.strata if label in (None, stratum.label)]
        hz = [stratum.frequency_hz for stratum in strata]
        try:
            if tells_K_from_I and max(hz) < SAME_FREQUENCY * min(hz):
                raise IdentifiabilityError(
                    f"K and I cannot be told apart: the sines are of {hz[0]:.3g} Hz alone, and at"
                    " one frequency K - I w^2 is one number; excite it below"
                    f" {hz[0] / 2:.2g} Hz or from {2 * hz[0]:.2g} Hz as well, {STIFFNESS_ALONE}"
                )
            fits[label] = fit_groups(sums, model, sums.groups.of(label))
        except IdentifiabilityError:  # a drive may reach fewer frequencies at one amplitude
            if label is None:
                raise
    return fits


def widened(fit: GroupFit, change: Array, of_bench: bool = False) -> GroupFit:
    """The fit with an error of type B in its intervals, which changes the estimates by `change`
    (p,) per standard deviation; `of_bench`: all trials on the bench have the same error."""
    bench_variance = fit.bench_variance + change**2 if of_bench else fit.bench_variance
    return replace(fit.with_shared_error(change), bench_variance=bench_variance)


def torque_errors(
    torque: Array, rate_hz: float, rows: NDArray[np.intp], stated: Calibration
) -> Array:
    """Errors of a smooth torque (n,) [N*m] by one standard uncertainty of the load cell's
    hysteresis and of its delay, (2, n). The loop has the width for the range in `rows` everywhere,
    which is a bound."""
    rate = np.gradient(torque, 1 / rate_hz)
    return np.array([stated.slip * np.ptp(torque[rows]) * np.sign(rate), stated.delay * rate])
