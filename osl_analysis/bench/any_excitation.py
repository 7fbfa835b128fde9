"""Rendered impedance from any motion of the joint: Eq. 15 over the moving record, as a row of `impedance.csv`."""

import numpy as np
import polars as pl

from osl_analysis.bench.alternatives import check_stiffer, time_base_row, time_base_words, timebase_table
from osl_analysis.bench.excitation_clocks import record_clock_row
from osl_analysis.bench.excitation_drift import record_drift_row
from osl_analysis.bench.excitation_lag import record_lag_row
from osl_analysis.bench.excitation_limits import angle_noise_bias, check_alias, check_band
from osl_analysis.bench.excitation_peaks import torque_at_peaks
from osl_analysis.bench.excitation_size import check_moves
from osl_analysis.bench.frequency_response import Admittance
from osl_analysis.bench.impedance import IMPEDANCE, MAY_BE_NULL
from osl_analysis.bench.moving_record import MovingRecord, consecutive_parts, fit_of, moves_little
from osl_analysis.bench.phasor_lag import LITTLE_INERTIA
from osl_analysis.bench.series import Series
from osl_analysis.errors import IdentifiabilityError
from osl_analysis.second_order import impedance_columns, impedance_torque
from osl_analysis.spectral.realisations import distinct
from osl_analysis.spectral.response import periodic_response
from osl_analysis.stats.fit_row import Row, covariance_row, diagnostics_row, estimates_row
from osl_analysis.stats.regression import LinearFit, regressors

SIGN_WIDTH = 0.05
"""Velocity, as a share of its RMS, over which the sign of the velocity is smoothed."""
WEIGHTING = "power of the filtered motion"
"""How frequencies weigh in the estimates, as in every least-squares fit of filtered signals."""
OF_SINES = (
    "stiffening", "backlash_deg", "backlash_share", "K_change", "B_change",
    "K_amplitudes_low", "K_amplitudes_high", "B_amplitudes_low", "B_amplitudes_high", "I_amplitudes_low",
    "I_amplitudes_high",
)  # fmt: skip
"""Columns that only a stepped sine fills."""
OF_PERIODS = ("period_s", "periods", "realisations", "even_harmonics", "odd_harmonics")
"""Columns that only a motion that repeats itself fills."""


def checked_fit(record: MovingRecord) -> LinearFit:
    """The fit of a record that moves, tells K from I, and is not aliased.

    Raises
    ------
    InputError, IdentifiabilityError
        The excitation does not allow a fit; the message names trial, cause and remedy.
    """
    check_moves(record)
    try:
        fit = record.estimate
    except IdentifiabilityError as error:
        low, high = record.band_hz
        raise IdentifiabilityError(
            f"trial {record.name}: the motion of {low:.2g} to {high:.2g} Hz is too narrow: {error}; excite 0.5 to 6 Hz"
        ) from error
    check_alias(record, fit)
    check_band(record, fit, record.largest_inertia_error)
    check_stiffer(record.name, "K", fit["K"], record.bench)
    return fit


def record_table(record: MovingRecord, expected: Admittance | None = None) -> pl.DataFrame:
    """The trial's row of `impedance.csv`, without an amplitude; `expected` as in `impedance_table`.

    Raises
    ------
    InputError, IdentifiabilityError
        As `checked_fit`, or the clocks of angle and torque drift apart.
    """
    fit = checked_fit(record)
    other = None if record.other is None else record.other.of_noise_and_lines
    row: Row = {
        "trial": record.name,
        "amplitude_deg": None,
        **excitation_row(record, fit),
        **estimates_row(fit, "K", "B", "I", "offset"),
        **covariance_row(fit, "K", "B", "I"),
        **diagnostics_row(fit, record.rate_hz, record.low_pass),
        **record_lag_row(record, fit, expected),
        **record_drift_row(record, fit),
        **friction_row(record, fit),
        "torque_at_peaks": torque_at_peaks(record, fit),
        "VAF_held_out": lowest_vaf_of_parts(record),
        "load_cell_drift": 60 * record.drift,
        **time_base_row(fit, other, IMPEDANCE),
        **record_clock_row(record),
    }
    empty: Row = dict.fromkeys(OF_SINES)
    numbers = dict.fromkeys(("amplitude_deg", *MAY_BE_NULL, *OF_SINES, *OF_PERIODS), pl.Float64)
    return pl.DataFrame([row | empty], schema_overrides=numbers)


def excitation_row(record: MovingRecord, fit: LinearFit) -> Row:
    """What moved the joint: estimates of a device that is no second-order system depend on band and weights."""
    return {
        **periodic_row(record),
        "band_low_hz": record.band_hz[0],
        "band_high_hz": record.band_hz[1],
        "theta_rms_deg": float(np.rad2deg(np.std(record.part(record.motion.theta)))),
        "weighting": WEIGHTING,
        "angle_noise_share": abs(angle_noise_bias(record, fit)) / float(np.hypot(fit["I"], LITTLE_INERTIA)),
        "fitted_s": record.seconds,
    }


def periodic_row(record: MovingRecord) -> Row:
    """`excitation`, the period, and for a motion of odd lines the odd and even distortion as shares of the torque."""
    found = record.periodic
    if found is None:
        return {"excitation": "other", **dict.fromkeys(OF_PERIODS)}
    levels = periodic_response(found.realisations)[1]
    shares = (float(x / levels.torque) if np.isfinite(x) else None for x in (levels.even, levels.odd))
    return {
        "excitation": "periodic",
        "period_s": found.period,
        "periods": sum(one.periods for one in found.realisations),
        "realisations": len(distinct(found.realisations)),
        **dict(zip(("even_harmonics", "odd_harmonics"), shares, strict=True)),
    }


def friction_row(record: MovingRecord, fit: LinearFit) -> Row:
    """Coulomb friction [N*m] of a fit that has it beside K, B and I, and the share of B that it makes."""
    motion = record.motion
    width = SIGN_WIDTH * float(np.std(record.part(motion.omega)))
    beside = fit_of(record, {"T_C": record.low_pass(np.tanh(motion.omega / width), record.rate_hz)})
    damping = fit["B"] - beside["B"]
    return {"coulomb_torque": beside["T_C"], "coulomb_damping": damping, "coulomb_share": damping / fit["B"]}


def lowest_vaf_of_parts(record: MovingRecord) -> float:
    """Lowest VAF [percent] of a part of the record by the fit to the others; each has its own offset and drift.

    Raises
    ------
    IdentifiabilityError
        The joint rests in two of three parts.
    """
    columns = {name: record.part(column) for name, column in impedance_columns(record.motion).items()}
    torque, time = record.part(record.filtered_torque), record.part(record.time)
    vafs = []
    for part in consecutive_parts(record.samples):
        others = np.ones(record.samples, dtype=bool)
        others[part] = False
        y = torque[others]
        try:
            estimates = regressors({name: x[others] for name, x in columns.items()}, y.shape).solved(y)
        except IdentifiabilityError as error:
            raise IdentifiabilityError(f"trial {record.name}: {moves_little(record, error)}") from error
        left = torque[part] - np.column_stack([x[part] for x in columns.values()]) @ estimates
        late = time[part] - time[part].mean()
        left = left - np.polyval(np.polyfit(late, left, 1), late)
        vafs.append(100 * (1 - float(np.var(left)) / float(np.var(torque[part]))))
    return min(vafs)


def record_time_base(record: MovingRecord) -> pl.DataFrame:
    """The trial's rows of `timebase.csv`."""
    words = (
        None if record.other is None else time_base_words(record.estimate, record.other.of_noise_and_lines, IMPEDANCE)
    )
    return timebase_table(record.uniform, words, record.bench)


def record_series(record: MovingRecord) -> Series:
    """Measured torque and that of Eq. 15 over the whole trial."""
    fit, motion = record.estimate, record.motion
    modelled = impedance_torque(fit["K"], fit["B"], fit["I"], motion) + fit["offset"]
    fitted = np.zeros(len(record.time), dtype=bool)
    fitted[record.rows] = True
    return Series(record.time, record.filtered_torque, modelled, motion.theta, fitted)


def record_points(record: MovingRecord, duration_s: float) -> pl.DataFrame:
    """The last fitted seconds, measured and by the best second-order fit (Fig. 4)."""
    shown, rows = record_series(record), record.rows
    last = rows[rows > rows[-1] - round(duration_s * record.rate_hz)]
    return pl.DataFrame(
        {
            "time": shown.time[last] - shown.time[last[0]],
            "theta_deg": np.rad2deg(shown.motion[last]),
            "torque": shown.torque[last],
            "torque_model": shown.torque_model[last],
        }
    )
