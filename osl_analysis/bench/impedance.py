"""Eq. 15 fitted to a record, or another model of the bench: to each amplitude and to all of it,
with the stated errors of the bench, and the amplitudes beside each other."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import polars as pl
from numpy.typing import NDArray

from osl_analysis.bench.bench_settings import NOT_STATED, Calibration
from osl_analysis.bench.record import STIFFNESS_ALONE, Label, Record
from osl_analysis.bench.regression import (
    FEWEST_UNITS,
    GroupFit,
    Model,
    Sums,
    combined,
    fit_groups,
    plain_sums,
    scatter_of,
)
from osl_analysis.errors import IdentifiabilityError
from osl_analysis.signals import seven_point_motion
from osl_analysis.stats.estimates import Row, estimates_row
from osl_analysis.stats.linear_fit import LinearFit
from osl_analysis.trial import Array

QUANTITIES = ("K", "B", "I")  # parameters of Eq. 15
OF_ANGLE = ("theta", "omega", "alpha", "B_m", "J_m")  # columns in proportion to the angle
SIGN_WIDTH = 0.01  # rad/s; over which the sign of the velocity changes in the error of friction
SAME_FREQUENCY = 1.02  # ratio of frequencies below which noise alone would tell K from I
LITTLE = {"K": 0.0, "B": 2.0, "I": 5e-3}
"""Sizes of K, B [N*m*s/rad] and I [kg*m^2], added in quadrature to the divisor of a relative
change."""
CHANGING = ("K", "B")  # with the amplitude, by play, a stiffening spring or friction


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

    def place(self, label: Label) -> Row:
        """Trial and amplitude of a row."""
        commanded = {each.label: each.commanded_deg for each in self.record.groups.strata}
        return {
            "trial": self.record.name,
            "scope": "all" if label is None else "amplitude",
            "amplitude_deg": label if isinstance(label, float) else None,
            "commanded_deg": commanded.get(label),
        }

    def row(self, label: Label, *names: str) -> Row:
        """Estimates, the errors of them that all trials on a bench share, and the fit's
        diagnostics."""
        fit = self.calibrated[label]
        return {
            **estimates_row(fit, *names),
            **{f"{name}_se_bench": fit.se_bench(name) for name in names},
            "interval_method": fit.interval_method,
            "VAF": fit.vaf,
            "condition_number": fit.condition_number,
            "largest_correlation": fit.largest_correlation,
        }

    @cached_property
    def calibrated(self) -> Mapping[Label, GroupFit]:
        """The fits with what is stated of the bench in their intervals; comparisons within a trial
        do not include it."""
        return {label: self.with_bench_errors(fit, label) for label, fit in self.fits.items()}

    def with_bench_errors(self, fit: GroupFit, label: Label = None) -> GroupFit:
        """Add what is stated of the bench to the intervals of a fit: the errors of its calibration,
        its stiffness and its fixture, to first order.

        Parameters
        ----------
        fit
            Of the model, or with friction.
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
        columns = dict(self.sums.columns)
        if "T_C" in fit.names:
            sign = np.tanh(motion.omega / SIGN_WIDTH)
            columns["T_C"] = record.settings.low_pass(sign, record.rate_hz)
        estimates = dict.fromkeys((*fit.names, *self.model), 0.0)
        estimates |= dict(zip(fit.names, fit.estimates.tolist(), strict=True))
        of_estimates = [self.model.get(name, name) for name in estimates]
        sizes = np.array([*estimates.values()])
        X = np.column_stack([columns[column] for column in of_estimates])
        is_of_angle = np.isin(of_estimates, OF_ANGLE)

        torques = [
            stated.torque * (X @ sizes),
            stated.angle_gain * (X @ (sizes * is_of_angle)),
            *torque_errors(record.filtered_torque, record.rate_hz, rows, stated),
        ]
        if fixture is not None:
            sine = np.sin(motion.theta - np.deg2rad(fixture.rest_deg))
            torques += [fixture.inertia_error * motion.alpha, fixture.weight_error * sine]
        if bench is not None:
            # a frame that yields more turns the joint by so much less
            yielded = bench.compliance_error * record.filtered_torque
            of_frame = vars(seven_point_motion(yielded, record.rate_hz))
            still = np.zeros_like(yielded)
            torques.append(sizes @ np.array([of_frame.get(name, still) for name in of_estimates]))
        changes = np.linalg.lstsq(X[rows], np.column_stack(torques)[rows])[0]
        for change in changes[: len(fit.names)].T:
            fit = widened(fit, change, of_bench=True)
        return fit

    def time_base_shift(self, label: Label, names: Sequence[str]) -> float | None:
        """The largest change of an estimate by the other reading of undecided stamps, in
        half-widths of its 95 % interval; None if the stamps are decided."""
        fit = self.fits[label]
        other = self.fits_with_other_stamps.get(label)
        if other is None:
            return None
        return max(abs(other[name] - fit[name]) / fit.half_width(name) for name in names)

    def modelled(self, label: Label = None) -> Array:
        """Torque (n,) [N*m] of the fit to a label; a label without a fit has that of the fit to
        all."""
        fit = self.fits.get(label, self.whole)
        torque = np.zeros(len(self.record.time))
        for name, column in self.model.items():
            torque += fit[name] * self.sums.columns[column]
        return torque

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


def amplitudes_row(analysis: Analysis) -> Row:
    """Compare the fits to single amplitudes.

    A stiffening spring, or play, changes K with the amplitude; friction changes K and B. A change
    is reduced by the half-width of its 95 % interval, at most to 0: noise is no change. Its divisor
    has `LITTLE` added in quadrature.

    Parameters
    ----------
    analysis
        Eq. 15 of a trial, for each amplitude and for all.

    Returns
    -------
    dict
        The relative changes `K_change` and `B_change` from the smallest to the largest amplitude,
        and the lowest and the highest estimates; empty for fewer than two amplitudes.
    """
    labels = sorted(label for label in analysis.fits if isinstance(label, float))
    if len(labels) < 2:
        return {}
    row: Row = {}
    change = difference_of(analysis, labels[0], labels[-1])
    for name in CHANGING:
        certain = change.beyond_interval(name)
        of_single = [analysis.fits[label][name] for label in labels]
        row[f"{name}_change"] = float(certain / np.hypot(analysis.whole[name], LITTLE[name]))
        row[f"{name}_amplitudes_low"] = min(of_single)
        row[f"{name}_amplitudes_high"] = max(of_single)
    return row


def difference_of(analysis: Analysis, smallest: Label, largest: Label) -> GroupFit:
    """The estimates of one amplitude less those of another.

    If both amplitudes have the same frequencies, each frequency is left out of both in turn: what
    the model misses at both alike then is no error of the difference. Else their errors are
    independent.
    """
    small, large = analysis.fits[smallest], analysis.fits[largest]
    covariance = small.covariance + large.covariance
    freedom = np.minimum(small.degrees_of_freedom, large.degrees_of_freedom)
    strata = analysis.sums.groups.strata
    of_small, of_large = (
        np.array([each.frequency_hz for each in strata if each.label == label])
        for label in (smallest, largest)
    )
    are_paired = len(of_small) == len(of_large) >= FEWEST_UNITS
    if are_paired and small.repeat is not None and large.repeat is not None:
        order_of_small, order_of_large = np.argsort(of_small), np.argsort(of_large)
        if np.allclose(of_small[order_of_small], of_large[order_of_large], atol=0.05):
            apart = large.left_out[order_of_large] - small.left_out[order_of_small]
            noise = small.repeat + large.repeat
            never = np.full(len(noise), np.inf)
            covariance, freedom = combined(noise, never, scatter_of(apart), len(apart))
    return replace(
        large,
        estimates=large.estimates - small.estimates,
        covariance=covariance,
        degrees_of_freedom=freedom,
    )
