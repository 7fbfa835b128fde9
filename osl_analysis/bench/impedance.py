"""Rendered impedance on the dynamometer (Figs. 4-6): Eq. 15 per trial and amplitude, and what the gains should give."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import polars as pl

from osl_analysis.bench.alternatives import check_stiffer, time_base_row, time_base_words, timebase_table
from osl_analysis.bench.changes import OF_DRIFT, stiffness_drift_row, stiffness_of_cycles
from osl_analysis.bench.diagnostics import lowest_held_out_vaf, over_amplitudes
from osl_analysis.bench.lag import torque_lag_row
from osl_analysis.bench.phasors import (
    Admittance,
    SegmentPhasors,
    at_amplitude,
    phasors_beside,
    rendered_nonlinearity_row,
)
from osl_analysis.bench.segments import rows_of
from osl_analysis.bench.series import Series
from osl_analysis.bench.stepped_sine import SteppedSineTrial, clock_drift_row, widened_fits
from osl_analysis.errors import InputError, nearest
from osl_analysis.model.compensator import CONTROLLERS, Gains, select_gains
from osl_analysis.model.gain_selection import Weight
from osl_analysis.parameters import DrivetrainParameters
from osl_analysis.second_order import fit_impedance, impedance_columns
from osl_analysis.stats.fit_row import Row, covariance_row, diagnostics_row, estimates_row
from osl_analysis.stats.regression import LinearFit

IMPEDANCE = ("K", "B", "I")  # parameters of Eq. 15.
MAY_BE_NULL = (
    "amplitude_deg", "K_change", "B_change", "backlash_share", "stiffening", "lag_inertia_share", "frame_stiffness",
    *OF_DRIFT,
)  # fmt: skip
"""Columns without a number in some rows, or in all."""


@dataclass(frozen=True)
class DesiredImpedance:
    """What the leg was asked to render in a trial, as far as it is known."""

    controller: str | None
    """Any name; `compensated` and `uncompensated` are those of the draft. None: none, or not known."""
    K_d: float | None  # desired stiffness [N*m/rad]; None: not known
    B_d: float | None  # desired damping [N*m*s/rad]; None: not known

    def gains(self, p: DrivetrainParameters | None, weight: Weight) -> Gains | None:
        """The gains of a device with these parameters, selected with W of Eq. 14; None where they are not known.

        Raises UnreachableImpedanceError: As `select_gains`.
        """
        if p is None or self.controller is None or self.K_d is None or self.B_d is None or self.unknown_gains():
            return None
        return select_gains(self.controller, self.K_d, self.B_d, p, weight)

    def unknown_gains(self) -> str:
        """Why the gains of this trial are not known, whatever the device; empty where they are."""
        if self.controller is None:
            return "no controller is stated"
        if self.controller not in CONTROLLERS:
            return f"the gains of controller '{self.controller}' are not known{nearest(self.controller, CONTROLLERS)}"
        absent = [name for name in ("K_d", "B_d") if getattr(self, name) is None]
        return f"{' and '.join(absent)} {'is' if len(absent) == 1 else 'are'} not stated" if absent else ""

    def columns(self) -> dict[str, pl.Expr]:
        """`controller`, `K_d` and `B_d` as constant columns of a table."""
        numbers = {name: pl.lit(getattr(self, name), pl.Float64) for name in ("K_d", "B_d")}
        return {"controller": pl.lit(self.controller, pl.String), **numbers}


def trial_phasors(trial: SteppedSineTrial) -> list[SegmentPhasors]:
    """Phasors of the settled cycles of every segment, beside the fits of Eq. 15; as `phasors_beside`."""
    return phasors_beside(trial, impedance_columns)


def impedance_table(
    trial: SteppedSineTrial, phasors: Sequence[SegmentPhasors], expected: Admittance | None = None
) -> pl.DataFrame:
    """The trial's rows of `impedance.csv`: Eq. 15 fitted to each amplitude [deg] and to all of them (amplitude null).

    The interval of the row over all amplitudes contains the noise only. How far friction makes the estimates depend on
    the amplitude is shown beside it, by the lowest and the highest estimate of a single amplitude.

    `load_cell_drift` [N*m/min] was subtracted from the torque. `expected` is the admittance of the linear model, where
    the gains are known; the lag of the torque is measured against it.
    """
    rows: list[Row] = []
    clocks = clock_drift_row(trial)
    stiffness = stiffness_of_cycles(trial.motion.theta, trial.filtered_torque, trial.segments(None))
    for amplitude in trial.amplitudes:
        fit = impedance_of(trial, amplitude)
        other = None if trial.other is None else impedance_of(trial.other, amplitude)
        check_stiffer(trial.name, "K", fit["K"], trial.bench)
        chosen = at_amplitude(phasors, amplitude)
        rows.append(
            {
                "trial": trial.name,
                "amplitude_deg": amplitude,
                **estimates_row(fit, "K", "B", "I", "offset"),
                **covariance_row(fit, "K", "B", "I"),
                **diagnostics_row(fit, trial.rate_hz, trial.low_pass),
                **torque_lag_row(chosen, fit, expected),
                **rendered_nonlinearity_row(chosen, fit),
                "VAF_held_out": lowest_held_out_vaf(trial, amplitude, fit, impedance_columns),
                "load_cell_drift": 60 * trial.drift,
                **stiffness_drift_row(stiffness, trial.segments(amplitude), fit),
                **time_base_row(fit, other, IMPEDANCE),
                **clocks,
            }
        )
    may_be_null = dict.fromkeys(MAY_BE_NULL, pl.Float64)
    table = pl.DataFrame(over_amplitudes(rows), schema_overrides=may_be_null, infer_schema_length=None)
    return table.with_columns(*(bound for name in ("K", "B", "I") for bound in range_over_amplitudes(name)))


def impedance_of(trial: SteppedSineTrial, amplitude: float | None) -> LinearFit:
    """Eq. 15 fitted to one amplitude [deg] or to all of them (None), the error of the bench's stiffness included."""
    return widened_fits(trial, impedance_columns)[amplitude]


def impedance_time_base(trial: SteppedSineTrial) -> pl.DataFrame:
    other = None if trial.other is None else impedance_of(trial.other, None)
    return timebase_table(trial.uniform, time_base_words(impedance_of(trial, None), other, IMPEDANCE), trial.bench)


def range_over_amplitudes(name: str) -> list[pl.Expr]:
    """`<name>_amplitudes_low` and `_high`: the lowest and the highest estimate of a single amplitude. They are in the
    row over all amplitudes (amplitude null) if there are two amplitudes or more; null elsewhere."""
    amplitude = pl.col("amplitude_deg")
    single = pl.col(name).filter(amplitude.is_not_null())
    several = amplitude.is_null() & (amplitude.count() > 1)
    bounds = {"low": single.min(), "high": single.max()}
    return [pl.when(several).then(value).alias(f"{name}_amplitudes_{end}") for end, value in bounds.items()]


def prediction_columns(predicted: tuple[float, float, float] | None) -> dict[str, pl.Expr]:
    """`K_predicted`, `B_predicted`, `I_predicted`: what linear theory expects, as constant columns of a table; null
    where it says nothing."""
    names, values = ("K_predicted", "B_predicted", "I_predicted"), predicted or (None, None, None)
    return {name: pl.lit(value, pl.Float64) for name, value in zip(names, values, strict=True)}


def impedance_series(trial: SteppedSineTrial) -> Series:
    """Measured torque and that of Eq. 15 over the whole trial, fitted to the settled cycles."""
    return trial.beside(impedance_of(trial, None), impedance_columns)


def amplitude_series(trial: SteppedSineTrial, amplitude_deg: float, duration_s: float) -> pl.DataFrame:
    """The last seconds up to the end of one amplitude, measured and by the fit of Eq. 15 to it (Fig. 4). Rests and
    other amplitudes within these seconds have no rows. Rows that the fit leaves out, such as the first cycles at a
    frequency, have no modelled torque (null)."""
    chosen = [b for b in trial.blocks if np.isclose(np.rad2deg(b.amplitude), amplitude_deg)]
    if not chosen:
        raise InputError(
            f"figures.time_series.amplitude_deg = {amplitude_deg:g} is not in the protocol "
            f"({', '.join(f'{b.amplitude_deg:g}' for b in trial.blocks)} deg); choose one of these"
        )
    rows = np.concatenate([np.r_[stretch] for stretch in chosen[0].stretches])
    block = rows if trial.usable is None else rows[trial.usable[rows]]
    last = block[block > block[-1] - round(duration_s * trial.rate_hz)]
    modelled = fit_impedance(*trial.part(amplitude_deg)).torque(trial.motion[last])
    fitted = np.isin(last, rows_of(trial.segments(amplitude_deg)))
    return pl.DataFrame(
        {
            "time": trial.time[last] - trial.time[last[0]],
            "theta_deg": np.rad2deg(trial.motion.theta[last]),
            "torque": trial.filtered_torque[last],
            "torque_model": pl.Series(modelled).set(pl.Series(~fitted), None),
        }
    )
