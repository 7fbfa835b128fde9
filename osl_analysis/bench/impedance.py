"""Rendered impedance on the dynamometer (Figs. 4-6): Eq. 15 fitted to any motion, per amplitude and
over all, the impedance that the gains should render, and the evidence on which the estimates are
judged."""

from dataclasses import dataclass

import numpy as np
import polars as pl

from osl_analysis.bench import effects
from osl_analysis.bench.amplitude_changes import amplitudes_row
from osl_analysis.bench.analysis import (
    QUANTITIES,
    Analysis,
    angle_noise_share,
    fitted_motion,
    share_of_inertia,
)
from osl_analysis.bench.effects import IMPEDANCE
from osl_analysis.bench.identifiability import turn_deg
from osl_analysis.bench.joint_inference import impedance_fits
from osl_analysis.bench.leg_belt import Lag, belt_of_leg, is_leg, without_lag
from osl_analysis.bench.plausibility import check_resists, plausible_impedance
from osl_analysis.bench.record import Label, Record
from osl_analysis.bench.regression import (
    GroupFit,
    Sums,
    estimates_of,
    every_third,
    held_out_vaf,
    solved,
)
from osl_analysis.dictionary import table_of
from osl_analysis.model.compensator import CONTROLLERS, Gains, Weight, select_gains
from osl_analysis.model.drivetrain import DrivetrainParameters, joint_admittance
from osl_analysis.stats.table_rows import Row


@dataclass(frozen=True)
class DesiredImpedance:
    """What the leg was asked to render in a trial, as far as it is known.

    Attributes
    ----------
    controller : str or None
        Any name; `compensated` and `uncompensated` are those of the draft. None: none, or not
        known.
    K_d : float or None
        Desired stiffness [N*m/rad]; None: not known.
    B_d : float or None
        Desired damping [N*m*s/rad]; None: not known.

    Examples
    --------
    >>> osl.DesiredImpedance("compensated", K_d=300, B_d=5)
    DesiredImpedance(controller='compensated', K_d=300, B_d=5)
    """

    controller: str | None
    K_d: float | None
    B_d: float | None

    def gains(self, p: DrivetrainParameters | None, weight: Weight) -> Gains | None:
        """Select the gains of a device with these parameters.

        Parameters
        ----------
        p
            The device; None for one without a parameter file.
        weight
            W of Eq. 14.

        Returns
        -------
        Gains or None
            None where they are not known.

        Raises
        ------
        UnreachableImpedanceError
            As `select_gains`.
        """
        if p is None or self.K_d is None or self.B_d is None or self.controller not in CONTROLLERS:
            return None
        return select_gains(self.controller, self.K_d, self.B_d, p, weight)

    def columns(self) -> dict[str, pl.Expr]:
        """`controller`, `K_d` and `B_d` as constant columns of a table."""
        numbers = {name: pl.lit(getattr(self, name), pl.Float64) for name in ("K_d", "B_d")}
        return {"controller": pl.lit(self.controller, pl.String), **numbers}


def rendered_impedance(
    record: Record, expected: effects.Admittance | None = None
) -> tuple[Analysis, Sums]:
    """Fit Eq. 15 to a record by least squares, for each amplitude and for all.

    Parameters
    ----------
    record
        Angle and torque of a joint.
    expected
        Admittance of the linear model, where the gains are known.

    Returns
    -------
    analysis
        torque = K theta + B omega + I alpha + offset + drift (`IMPEDANCE`), by `fit_groups`.
    sums
        Those with the columns of all effects, which tell what else the torque may hold.

    Raises
    ------
    InputError, IdentifiabilityError
        As `fitted_motion`.
    """
    analysis = fitted_motion(record, effects.plain_sums(record, IMPEDANCE), IMPEDANCE)
    return analysis, effects.sums_of(record, IMPEDANCE, expected)


def impedance_table(
    analysis: Analysis, s: Sums, p: DrivetrainParameters | None = None
) -> pl.DataFrame:
    """Put together the trial's rows of `impedance.csv`.

    A motion that is no stepped sine has one row. What describes the motion is the same in every
    row: the estimates of a device that is not of second order depend on band and weights.

    Parameters
    ----------
    analysis
        Eq. 15 by least squares.
    s
        Sums of the same record with the columns of all effects.
    p
        The device. With theta_m it gives the belt, which shows a lag that Eq. 15 hides where it
        does not fit the drivetrain. Without it a joint whose actuator turns is taken for a leg,
        since its drivetrain is no fault of the recording (`leg_belt.is_leg`).

    Notes
    -----
    K, B and I are those of Eq. 15 by least squares, of a leg and of any other joint. Where dry
    friction is certain, those of Eq. 15 with a Coulomb column stand beside them.

    Returns
    -------
    polars.DataFrame
        A row per amplitude [deg], and one over all of them (amplitude null).

    Raises
    ------
    InputError
        The torque drives the motion.
    """
    record = analysis.record
    belt = belt_of_leg(record, p)
    whole = analysis.whole
    if whole.interval("B")[0] < 0:
        # with the right sign K may be negative, as of an inertia behind a soft spring, but B is
        # then certainly positive
        check_resists(record.name, "K", whole["K"], whole.interval("K")[1])
    fits = impedance_fits(analysis, s, is_leg(record, p))
    lag = belt.lag if belt else None
    of_trial: Row = {
        **motion_row(record),
        "K_s_ratio": belt.K_s / p.K_s if belt and p else None,
        "VAF_held_out": held_out_vaf(analysis.sums, analysis.model, every_third(record.groups)),
    }
    over_amplitudes = amplitudes_row(analysis)
    rows: list[Row] = []
    for label, fit in analysis.fits.items():
        rows.append(
            {
                **analysis.place(label),
                **fits[label].to_row(),
                **analysis.beside_estimates(label, *QUANTITIES),
                "offset": analysis.calibrated(fit, label)["offset"],
                **lag_row(lag, fit),
                **analysis.time_base_row(label, QUANTITIES),
                "theta_rms_deg": turn_deg(s, label),
                "fitted_s": len(record.rows(label)) / record.rate_hz,
                "angle_noise_share": angle_noise_share(record, s, fit, label),
                **of_trial,
                **(over_amplitudes if label is None else dict.fromkeys(over_amplitudes)),
            }
        )
    is_late = pl.col("lag_share") > 0
    half_width_s = (pl.col("lag_s_high") - pl.col("lag_s_low")) / 2
    certain_lag_s = pl.when(is_late).then("lag_s")
    return table_of(rows, "impedance").with_columns(without_lag(certain_lag_s, half_width_s))


def motion_row(record: Record) -> Row:
    """What moved the joint, and the largest difference between the rates of two clocks [ppm], null
    where there is one clock."""
    kinds = {"cycles": "stepped sine", "periods": "periodic", "stretches": "other"}
    low_hz, high_hz = record.band_hz
    streams = record.uniform.streams if record.uniform else ()
    ppm = [stream["ppm"] for stream in streams if stream["ppm"] is not None]
    between_clocks = max(ppm, default=0.0) - min(ppm, default=0.0)
    return {
        "excitation": "periodic" if record.periodic else kinds[record.groups.kind],
        "band_low_hz": low_hz,
        "band_high_hz": high_hz,
        "cutoff_hz": float(record.low_pass.cutoff_hz),
        "clock_ppm": between_clocks or None,  # channels of one clock have the same rate
    }


def lag_row(lag: Lag | None, fit: GroupFit) -> Row:
    """Lag of a leg's torque behind the angle by its belt, and the shares of B and I that are due to
    a lag that was found.

    exp(-s d) = 1 - s d + (s d)^2/2 takes K d off B, and (B + K d/2) d off I, with the fitted B.
    """
    if lag is None:
        names = ("lag_s", "lag_s_low", "lag_s_high", "lag_share", "lag_inertia_share")
        return dict.fromkeys(names)
    K, B = fit["K"], fit["B"]
    found_s = lag.seconds if lag.is_certain else 0.0
    return {
        "lag_s": lag.seconds,
        "lag_s_low": lag.seconds - lag.half_width,
        "lag_s_high": lag.seconds + lag.half_width,
        "lag_share": abs(K * found_s / B),
        "lag_inertia_share": abs((B + K * found_s / 2) * found_s) / share_of_inertia(fit),
    }


def impedance_with_evidence(
    record: Record,
    rails: pl.Expr,
    p: DrivetrainParameters | None,
    desired: DesiredImpedance | None,
    gains: Gains | None = None,
) -> tuple[Analysis, pl.DataFrame]:
    """Fit Eq. 15 to a record, and put beside its rows all that the verdicts on them need.

    Parameters
    ----------
    record
        Angle and torque of a joint.
    rails
        Saturated samples, as a column of the table.
    p
        The device. What the gains should render is known only with it.
    desired
        What the leg was asked to render.
    gains
        Those that ran.

    Raises
    ------
    InputError, IdentifiabilityError
        As `rendered_impedance` and `plausible_impedance`.
    """
    expected = joint_admittance(gains.K_1, gains.B_1, p, p.J_j) if p and gains else None
    analysis, s = rendered_impedance(record, expected)
    predicted = linear_prediction(s) if expected else None
    table = impedance_table(analysis, s, p)
    names_impedance = desired is not None and bool(desired.controller or desired.K_d)
    has_belt = table["K_s_ratio"].drop_nulls().len() > 0
    table = plausible_impedance(
        table,
        rails,
        p,
        names_impedance or has_belt,
        None if predicted is None else predicted[0],
        None if desired is None else desired.K_d,
        None if desired is None else desired.B_d,
    )
    if predicted is None and record.calibration.torque_gain:
        table = table.with_columns(gain_error=pl.lit(0.0))  # a known spring holds it

    gap = pl.lit(None, pl.Float64)
    if predicted is not None and gains is not None and gains.cancels_friction:
        half_width = (pl.col("B_high") - pl.col("B_low")) / 2
        apart = predicted[1] - pl.col("B")
        certainly_apart = apart.sign() * (apart.abs() - half_width).clip(0)
        gap = certainly_apart / pl.Series(torque_per_angle(s, analysis))
    table = table.with_columns(B_gap_s=gap)
    if desired is not None:
        table = table.with_columns(
            **desired.columns(),
            **beside_desired(analysis, desired, predicted),
        )
    return analysis, table


def linear_prediction(s: Sums) -> list[float]:
    """K, B and I of Eq. 15 fitted to the linear model's torque in the recorded motion: a drivetrain
    is of higher order."""
    at = s.index(list(IMPEDANCE.values()))
    estimates = estimates_of(s.total, at, s.names.index("linear"))
    return [float(estimate) for estimate in estimates[:3]]


def torque_per_angle(s: Sums, analysis: Analysis) -> list[float]:
    """Standard deviation of the torque over that of the angle [N*m/rad] in each row."""
    theta, one = s.names.index("theta"), s.names.index("one")
    ratios = []
    for label in analysis.fits:
        total = s.over(label)
        n = total[one, one]
        of_torque, of_theta = (
            total[k, k] / n - (total[k, one] / n) ** 2 for k in (s.torque, theta)
        )
        ratios.append(float(np.sqrt(of_torque / of_theta)))
    return ratios


def beside_desired(
    analysis: Analysis, desired: DesiredImpedance, predicted: list[float] | None
) -> dict[str, pl.Expr]:
    """Columns with what the gains should render, and the error of the rendered torque."""
    errors = [torque_error(analysis.sums, label, desired) for label in analysis.fits]
    return {
        "K_predicted": pl.lit(predicted[0] if predicted else None, pl.Float64),
        "B_predicted": pl.lit(predicted[1] if predicted else None, pl.Float64),
        "torque_error": pl.lit(pl.Series(errors, dtype=pl.Float64)),
    }


def torque_error(s: Sums, label: Label, desired: DesiredImpedance) -> float | None:
    """RMS [N*m] of tau - (K_d theta + B_d omega) in the rows of a label: the error of the rendered
    torque. Offset and drift are the load cell's, and left out. None where K_d or B_d is not
    known."""
    if desired.K_d is None or desired.B_d is None:
        return None
    total = s.over(label)
    theta, omega, one, ramp = s.index(["theta", "omega", "one", "ramp"])
    weights = np.zeros(len(total))
    weights[s.torque] = 1.0
    weights[theta] = -desired.K_d
    weights[omega] = -desired.B_d
    slow = [one, ramp]
    across = (total @ weights)[slow]
    explained = across @ solved(total[np.ix_(slow, slow)], across)[0]
    left = float(weights @ total @ weights - explained)
    return float(np.sqrt(max(left, 0.0) / total[one, one]))
