"""Rendered impedance from any motion of the joint: Eq. 15 over the moving record, as a row of `impedance.csv`."""

import numpy as np
import polars as pl

from osl_analysis.bench.alternatives import check_stiffer, time_base_row, time_base_words, timebase_table
from osl_analysis.bench.changes import record_clock_row, record_drift_row
from osl_analysis.bench.excitation_limits import angle_noise_bias, angle_noise_share, check_alias, check_band
from osl_analysis.bench.impedance import IMPEDANCE, MAY_BE_NULL
from osl_analysis.bench.lag import LITTLE_INERTIA, record_lag_row
from osl_analysis.bench.moving_record import MovingRecord, consecutive_parts, fit_of, moves_little
from osl_analysis.bench.phasors import Admittance
from osl_analysis.bench.series import Series
from osl_analysis.errors import IdentifiabilityError, InputError
from osl_analysis.second_order import impedance_columns, impedance_torque
from osl_analysis.spectral.realisations import distinct
from osl_analysis.spectral.response import periodic_response
from osl_analysis.stats.fit_row import Row, covariance_row, diagnostics_row, estimates_row
from osl_analysis.stats.regression import LinearFit, regressors
from osl_analysis.stats.rounding import distinct_values
from osl_analysis.trial import Array

SHARES = (0.005, 0.01, 0.02, 0.05, 0.1, 0.2)
"""Shares of the rows with the highest modelled torque that are compared, from sharp peaks of noise to sines."""
LEAST_RANGE = 0.03
"""Least range of the modelled torque in such rows, as a share of its peak: the top of a sine is flat and noisy."""


def torque_at_peaks(record: MovingRecord, fit: LinearFit) -> float | None:
    """Smallest ratio of `ratio_at_peaks` over the fitted rows of a record."""
    modelled = impedance_torque(fit["K"], fit["B"], fit["I"], record.motion)
    return ratio_at_peaks(record.part(record.filtered_torque), record.part(modelled))


def ratio_at_peaks(measured: Array, modelled: Array) -> float | None:
    """Smallest SD of the measured torque over that of the modelled one, where the latter is at its peaks.

    Both (n,) [N*m], filtered alike; offsets do not matter. The peaks are the highest and the lowest `SHARES` of the
    modelled torque. The ratio is 1 for a joint of Eq. 15. Noise and distortion of the torque raise it. Friction lowers
    it to 0.7. It is near 0 where the torque is clipped, however noisy the plateau is: equal samples, by which a clipped
    sensor is told, are not needed. None where no peak has the range for a comparison.
    """
    found, ordered = [], np.sort(modelled)
    ends = (float(ordered[-1]), True), (float(ordered[0]), False)
    middle = float(np.median(ordered, overwrite_input=True))
    for top, highest in ends:
        for share in SHARES:
            level = float(np.quantile(ordered, 1 - share if highest else share, overwrite_input=True))
            if abs(top - level) > LEAST_RANGE * abs(top - middle):
                rows = modelled >= level if highest else modelled <= level
                found.append(float(np.std(measured[rows]) / np.std(modelled[rows])))
    return min(found, default=None)


FEWEST_STEPS = 20.0
"""Steps of the encoder that an angle turns by at least; below, its rounding is no noise but a part of the motion."""
HARDLY_MOVES = 0.1  # share of the acceleration that is the encoder's noise, from which a record is refused
SLOW = 200.0  # steps of the encoder from which a motion is not small but slow, if noise makes its acceleration


def check_moves(record: MovingRecord) -> float:
    """`angle_noise_share`, refused where the record hardly moves, or slowly."""
    share, steps = angle_noise_share(record), steps_turned(record)
    if steps < FEWEST_STEPS:
        raise InputError(
            f"trial {record.name}: the joint hardly moves: theta turns by {steps:.0f} steps of its encoder, "
            f"{FEWEST_STEPS:g} are needed; move it by more, and check the unit of theta in the source file"
        )
    if share > HARDLY_MOVES:
        slow = steps >= SLOW
        turn = np.rad2deg(np.std(record.part(record.motion.theta)))
        remedy = (
            "move it faster, by 0.5 to 6 Hz, or take the stiffness alone by experiment 'torque_angle'"
            if slow
            else "move it by more, or faster, and check the unit of theta in the source file"
        )
        raise InputError(
            f"trial {record.name}: the joint {'moves too slowly' if slow else 'hardly moves'}: theta turns by "
            f"{turn:.2g} deg RMS, and noise of the encoder has {share:.2g} times the power of the acceleration's own "
            f"part behind the filter, at most {HARDLY_MOVES:g} is allowed; {remedy}"
        )
    return share


def steps_turned(record: MovingRecord) -> float:
    """Steps of the encoder by which the fitted angle turns, at most as many as there are different values. Without end
    where no step is seen, and more values than a slow motion has."""
    measured, step = record.part(record.bench_angle), record.steps[0]
    values = distinct_values(measured, most=int(SLOW))
    levels = np.inf if values is None else len(values)
    return float(levels if step is None else min(np.ptp(measured) / step, levels))


SIGN_WIDTH = 0.05  # velocity, as a share of its RMS, over which the sign of the velocity is smoothed
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
    """The fit of a record that moves, tells K from I, and is not aliased."""
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
    """The trial's row of `impedance.csv`, without an amplitude; `expected` as in `impedance_table`."""
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
    """Lowest VAF [percent] of a part of the record by the fit to the others; each has its own offset and drift."""
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
    other = None if record.other is None else record.other.of_noise_and_lines
    return timebase_table(record.uniform, time_base_words(record.estimate, other, IMPEDANCE), record.bench)


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
