"""Rendered impedance on the dynamometer (Figs. 4-6): Eq. 15 fitted to any motion, per amplitude and
over all, the impedance that the gains should render, and the evidence on which the estimates are
judged."""

from dataclasses import dataclass, replace

import numpy as np
import polars as pl

from osl_analysis.bench.analysis import QUANTITIES, Analysis, analysed, widened
from osl_analysis.bench.friction import (
    CERTAIN_FRICTION,
    coulomb_fits,
    delay_told_s,
    fault_columns,
    friction_columns,
    inferred_from,
    with_other_stamps,
)
from osl_analysis.bench.lags import Lag, belt_of_leg, is_leg, without_lag
from osl_analysis.bench.plausibility import (
    check_resists,
    check_stiffer,
    rounding_errors,
    usual_errors,
)
from osl_analysis.bench.record import Label, Record
from osl_analysis.bench.regression import (
    FEWEST_UNITS,
    IMPEDANCE,
    Admittance,
    GroupFit,
    Sums,
    combined,
    estimates_of,
    held_out_vaf,
    scatter_of,
    sums_of,
)
from osl_analysis.dictionary import table_of
from osl_analysis.errors import IdentifiabilityError
from osl_analysis.model.compensator import CONTROLLERS, Gains, Weight, select_gains
from osl_analysis.model.drivetrain import DrivetrainParameters, joint_admittance
from osl_analysis.stats.estimates import Estimate, Row

LITTLE = {"K": 0.0, "B": 2.0, "I": 5e-3}
"""Sizes of K, B [N*m*s/rad] and I [kg*m^2], added in quadrature to the divisor of a relative
change."""
CHANGING = ("K", "B")  # with the amplitude, by play, a stiffening spring or friction
RENDERED = (0.94, 1.06)
"""K without friction over that of linear theory, from and to which a sound leg renders it. Legs of
the default device: 0.98 to 1.01. The rest is two standard deviations, of 2 %, of a device from its
parameter file."""


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


def rendered_impedance(record: Record, expected: Admittance | None = None) -> tuple[Analysis, Sums]:
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
    InputError
        The joint hardly moves.
    IdentifiabilityError
        The motion cannot tell K, B and I.
    """
    try:
        analysis = analysed(record, IMPEDANCE)
    except IdentifiabilityError as error:
        raise IdentifiabilityError(f"trial {record.name}: {error}") from error
    if not record.is_stepped_sine:
        of_bench = usual_errors(record, analysis.sums, analysis.whole)
        of_steps = rounding_errors(record, analysis.sums, IMPEDANCE, analysis.whole)
        whole = widened(widened(analysis.whole, of_bench, of_bench=True), of_steps)
        analysis = replace(analysis, fits={None: whole})
    check_stiffer(record.name, "K", analysis.whole["K"], record.settings.bench_stiffness)
    return analysis, sums_of(record, IMPEDANCE, expected)


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
        since its drivetrain is no fault of the recording (`lags.is_leg`).

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
    whole = analysis.whole
    if whole.interval("B")[0] < 0:
        # with the right sign K may be negative, as of an inertia behind a soft spring, but B is
        # then certainly positive
        check_resists(record.name, "K", whole["K"], whole.interval("K")[1])
    belt = belt_of_leg(record, p)
    of_leg = is_leg(record, p)
    inferred = inferred_from(record, of_leg)
    is_certain = inferred.friction_probability > CERTAIN_FRICTION if inferred else None
    coulomb = coulomb_fits(s, analysis, is_certain)
    of_trial: Row = {
        **fault_columns(inferred),
        "delay_told_s": delay_told_s(inferred, record),
        **motion_row(record),
        "K_s_ratio": belt.K_s / p.K_s if belt and p else None,
        "VAF_held_out": held_out_vaf(analysis.sums, analysis.model),
    }
    over_amplitudes = amplitudes_row(analysis)
    calibrated = analysis.calibrated(whole)
    estimates = {name: Estimate.of_fit(calibrated, name) for name in QUANTITIES}
    of_whole: Row = {}
    for name, estimate in with_other_stamps(analysis, estimates).items():
        of_whole |= estimate.columns(name)
    centre = record.motion.theta[record.rows()].mean()
    rows: list[Row] = []
    for label, fit in analysis.fits.items():
        rows.append(
            {
                **analysis.row(label, *QUANTITIES),
                **(of_whole if label is None else {}),
                **{f"{name}_se": analysis.calibrated(fit, label).se(name) for name in QUANTITIES},
                **friction_columns(analysis, inferred, coulomb.get(label), label, of_leg),
                "offset": fit["offset"] - fit["K"] * centre,
                **lag_row(belt.lag if belt else None, fit),
                **analysis.time_base_row(label, QUANTITIES),
                "theta_rms_deg": float(np.rad2deg(np.sqrt(s.covariance(label, ["theta"])[0, 0]))),
                "fitted_s": len(record.rows(label)) / record.rate_hz,
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
        "cutoff_hz": record.settings.cutoff_hz,
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
    of_inertia = abs((B + K * found_s / 2) * found_s)
    return {
        "lag_s": lag.seconds,
        "lag_s_low": lag.seconds - lag.half_width,
        "lag_s_high": lag.seconds + lag.half_width,
        "lag_share": abs(K * found_s / B),
        "lag_inertia_share": of_inertia / float(np.hypot(fit["I"], LITTLE["I"])),
    }


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
        and the lowest and the highest estimates; null for fewer than two amplitudes.
    """
    labels = sorted(label for label in analysis.fits if isinstance(label, float))
    row: Row = {}
    for name in CHANGING:
        ends = ("change", "amplitudes_low", "amplitudes_high")
        row.update(dict.fromkeys(f"{name}_{end}" for end in ends))
        if len(labels) < 2:
            continue
        of_single = [analysis.fits[label][name] for label in labels]
        row[f"{name}_amplitudes_low"] = min(of_single)
        row[f"{name}_amplitudes_high"] = max(of_single)
        change = difference_of(analysis, labels[0], labels[-1])
        half_width = change.interval(name)[1] - change[name]
        certain = np.sign(change[name]) * max(abs(change[name]) - half_width, 0.0)
        row[f"{name}_change"] = float(certain / np.hypot(analysis.whole[name], LITTLE[name]))
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
        As `rendered_impedance`.
    """
    expected = joint_admittance(gains.K_1, gains.B_1, p, p.J_j) if p and gains else None
    analysis, s = rendered_impedance(record, expected)
    K, B = linear_prediction(s) if expected else (None, None)
    table = impedance_table(analysis, s, p).with_columns(rails)
    B_gap = pl.lit(None, pl.Float64)
    if B is not None and gains is not None and gains.cancels_friction:
        apart = B - pl.col("B")
        certain = (apart.abs() - (pl.col("B_high") - pl.col("B_low")) / 2).clip(0)
        B_gap = apart.sign() * certain / pl.col("K").abs()
    table = table.with_columns(B_gap_s=B_gap)
    stated = desired or DesiredImpedance(None, None, None)
    table = beside_known(table, p, stated, K)
    if K is None and record.settings.calibration.torque_gain:
        table = table.with_columns(gain_error=pl.lit(0.0))  # a known spring holds it
    if desired is not None:
        errors = [torque_error(analysis.sums, label, desired) for label in analysis.fits]
        table = table.with_columns(
            **desired.columns(),
            K_predicted=pl.lit(K, pl.Float64),
            B_predicted=pl.lit(B, pl.Float64),
            torque_error=pl.Series(errors, dtype=pl.Float64),
        )
    return analysis, table


def beside_known(
    table: pl.DataFrame,
    p: DrivetrainParameters | None,
    desired: DesiredImpedance,
    predicted: float | None,
) -> pl.DataFrame:
    """Hold the estimates of Eq. 15 against the belt, the gains and the sample sheet.

    Parameters
    ----------
    table
        The trial's rows.
    p
        The device; None for one without a parameter file. Where neither sheet nor belt says that
        the joint is that of the file, another device may be soft, so that `K_over_K_s` is null up
        to 1. Above 1 a unit may be wrong, or the file is of another device.
    desired
        What the sheet states.
    predicted
        K by linear theory [N*m/rad]; None: the gains are not known.

    Returns
    -------
    polars.DataFrame
        The table with `K_over_K_s`, and `K_ratio`, K over the predicted one, with `gain_error`, or
        `K_over_K_d` and `B_over_B_d`. These take K without friction where that is known, and
        `K_ratio`, else, K at the largest amplitude, where friction changes it least.
    """
    whole = table.row(-1, named=True)
    largest = table.sort("amplitude_deg", nulls_last=False)["K"][-1]
    of_spring = whole["K_without_friction"] or largest
    known: Row = dict.fromkeys(("K_ratio", "gain_error", "K_over_K_d", "B_over_B_d"))
    if predicted:
        ratio = of_spring / predicted
        known["K_ratio"] = largest / predicted
        known["gain_error"] = max(ratio / RENDERED[1] - 1, 0) + min(ratio / RENDERED[0] - 1, 0)
    elif desired.K_d:
        known["K_over_K_d"] = of_spring / desired.K_d
        known["B_over_B_d"] = whole["B"] / desired.B_d if desired.B_d else None
    K_over_K_s = pl.lit(None, pl.Float64)
    if p is not None:
        K_over_K_s = pl.col("K") / p.K_s
        is_leg_of_file = desired.controller or desired.K_d or whole["K_s_ratio"] is not None
        if not is_leg_of_file:
            K_over_K_s = pl.when(K_over_K_s > 1).then(K_over_K_s)
    columns = {name: pl.lit(value, pl.Float64) for name, value in known.items()}
    return table.with_columns(K_over_K_s=K_over_K_s, **columns)


def linear_prediction(s: Sums) -> tuple[float, float]:
    """K and B of Eq. 15 fitted to the linear model's torque in the recorded motion: a drivetrain is
    of higher order."""
    at = s.index(list(IMPEDANCE.values()))
    K, B = estimates_of(s.over(), at, s.names.index("linear"))[:2]
    return float(K), float(B)


def torque_error(s: Sums, label: Label, desired: DesiredImpedance) -> float | None:
    """RMS [N*m] of tau - (K_d theta + B_d omega) in the rows of a label: the error of the rendered
    torque. Offset and drift are the load cell's, and left out. None where K_d or B_d is not
    known."""
    if desired.K_d is None or desired.B_d is None:
        return None
    covariance = s.covariance(label, ["theta", "omega", "ramp"])
    weights = np.array([-desired.K_d, -desired.B_d, 0.0, 1.0])
    with_ramp = (covariance @ weights)[2]
    square = weights @ covariance @ weights - with_ramp**2 / covariance[2, 2]
    return float(np.sqrt(max(square, 0.0)))
