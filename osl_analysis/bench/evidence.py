"""Rendered impedance on the dynamometer (Figs. 4-6): the rows of Eq. 15, with the ends of their
intervals as they are printed, and the evidence on which the estimates are judged."""

from dataclasses import dataclass, replace
from functools import partial

import numpy as np
import polars as pl

from osl_analysis.bench.friction import (
    CERTAIN_FRICTION,
    coulomb_fits,
    fault_columns,
    friction_columns,
    inferred_of_joint,
    inferred_of_leg,
    with_other_stamps,
    without_friction,
)
from osl_analysis.bench.impedance import QUANTITIES, Analysis
from osl_analysis.bench.lags import Belt, belt_of_leg, is_leg, without_lag
from osl_analysis.bench.motion_range import parts_of, range_over
from osl_analysis.bench.plausibility import check_resists, check_stiffer
from osl_analysis.bench.record import Label
from osl_analysis.bench.regression import (
    IMPEDANCE,
    GroupFit,
    Sums,
    fit_groups,
    held_out_vaf,
    sums_of,
    with_effects,
)
from osl_analysis.dictionary import table_of
from osl_analysis.model.compensator import CONTROLLERS, Gains, Weight, select_gains
from osl_analysis.model.drivetrain import DrivetrainParameters, joint_admittance
from osl_analysis.stats.estimates import Estimate, Row, estimates_row

RENDERED = (0.94, 1.06)
"""K without friction over that of linear theory, from and to which a sound leg renders it. Legs of
the default device: 0.98 to 1.01. The rest is two standard deviations, of 2 %, of a device from its
parameter file."""
LITTLE = {"K": 0.0, "B": 2.0, "I": 5e-3}
"""Sizes of K, B [N*m*s/rad] and I [kg*m^2], added in quadrature to the divisor of a relative
change."""
CHANGING = ("K", "B")  # with the amplitude, by play, a stiffening spring or friction


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


UNSTATED = DesiredImpedance(None, None, None)


def impedance_table(
    analysis: Analysis,
    p: DrivetrainParameters | None = None,
    desired: DesiredImpedance = UNSTATED,
    gains: Gains | None = None,
) -> pl.DataFrame:
    """Put together the trial's rows of `impedance.csv`: the estimates, and beside them all that the
    verdicts on them need.

    A motion that is no stepped sine has one row. What describes the motion is the same in every
    row: the estimates of a device that is not of second order depend on band and weights.

    Parameters
    ----------
    analysis
        Eq. 15 by least squares.
    p
        The device. With theta_m it gives the belt, which shows a lag that Eq. 15 hides where it
        does not fit the drivetrain. Without it a joint whose actuator turns is taken for a leg,
        since its drivetrain is no fault of the recording (`lags.is_leg`). What the gains should
        render is known only with it.
    desired
        What the leg was asked to render.
    gains
        Those that ran.

    Returns
    -------
    polars.DataFrame
        A row per amplitude [deg], and one over all of them (amplitude null).

    Raises
    ------
    InputError
        The torque drives the motion, or the joint is stiffer than the bench.
    """
    record = analysis.record
    whole = analysis.whole
    check_stiffer(record.name, "K", whole["K"], record.settings.bench_stiffness)
    has_losses = whole.interval("B")[0] >= 0 or whole.interval("I")[0] > 0
    if whole["K"] < 0 and (desired.K_d or not has_losses):
        # with the right sign K may be negative, as of a weight above the axis, if none is stated;
        # B or I is then certainly positive
        check_resists(record.name, "K", whole["K"], whole.interval("K")[1])

    expected = joint_admittance(gains.K_1, gains.B_1, p, p.J_j) if p and gains else None
    s = sums_of(record, expected)
    of_leg = is_leg(record, p)
    belt = belt_of_leg(record, p) if p and of_leg else Belt()
    joint = None if of_leg else inferred_of_joint(record)
    inferred = inferred_of_leg(record) if of_leg else joint
    is_certain = inferred.friction_probability > CERTAIN_FRICTION if inferred else None
    coulomb = coulomb_fits(s, analysis, is_certain)

    ppm = [stream["ppm"] for stream in record.streams if stream["ppm"] is not None]
    other_excitation = "periodic" if record.periodic else "other"
    of_trial: Row = {
        **vars(desired),
        **(fault_columns(joint, record) if joint else {}),
        "excitation": "stepped sine" if record.groups.kind == "cycles" else other_excitation,
        "band_low_hz": record.band_hz[0],
        "band_high_hz": record.band_hz[1],
        "cutoff_hz": record.settings.cutoff_hz,
        # channels of one clock have the same rate
        "clock_ppm": np.ptp(ppm or [0.0]) or None,
        "K_s_ratio": belt.K_s_ratio,
        "VAF_held_out": held_out_vaf(analysis.sums, analysis.model),
        # a known spring holds it
        "gain_error": 0.0 if record.settings.calibration.torque_gain else None,
    }
    if expected:
        # a drivetrain is of higher order: Eq. 15 fitted to the linear model's torque
        of_gains = s.estimates([*IMPEDANCE.values()], "linear")
        of_trial |= {"K_predicted": of_gains[0], "B_predicted": of_gains[1]}
    of_whole = amplitudes_row(analysis)
    parts = list(parts_of(record, s))
    of_parts = range_over(parts, partial(fit_groups, model=IMPEDANCE), whole, QUANTITIES)
    of_whole |= of_parts
    friction = coulomb.get(None)
    if friction and friction.certain and not of_leg:
        of_viscous = range_over(parts, viscous_fit, friction.certain, ["B"])
        of_whole |= {name.replace("B_", "B_viscous_"): x for name, x in of_viscous.items()}
    for name in QUANTITIES:
        estimate = Estimate.of_fit(analysis.calibrated[None], name)
        of_whole |= with_other_stamps(analysis, estimate, name).columns(name)
    centre = record.motion.theta[record.is_fitted()].mean()
    rows = []
    for label, fit in analysis.fits.items():
        variance = s.of(label).covariance(["theta"])
        rows.append(
            {
                **analysis.place(label),
                **analysis.row(label, *QUANTITIES),
                **(of_whole if label is None else {}),
                **{f"{name}_se": analysis.calibrated[label].se(name) for name in QUANTITIES},
                **friction_columns(analysis, inferred, coulomb.get(label), label, of_leg),
                "offset": fit["offset"] - fit["K"] * centre,
                "torque_error": torque_error(analysis.sums, label, desired),
                "time_base_shift": analysis.time_base_shift(label, QUANTITIES),
                "theta_rms_deg": np.rad2deg(np.sqrt(variance[0, 0])),
                "fitted_s": record.is_fitted(label).sum() / record.rate_hz,
                **of_trial,
            }
        )
    table = table_of(rows, "impedance", complete=True)
    if belt.lag:
        table = with_lag(table, belt.lag)
    # a leg's friction hides it without compensation; Eq. 15 is of motion below the cut-off
    is_slow = record.band_hz[1] <= record.settings.cutoff_hz
    if gains and gains.cancels_friction and is_slow:
        apart = pl.col("B_predicted") - pl.col("B")
        certain = (apart.abs() - (pl.col("B_high") - pl.col("B_low")) / 2).clip(0)
        table = table.with_columns(B_gap_s=apart.sign() * certain / pl.col("K").abs())
    return beside_known(table, p, desired)


def viscous_fit(s: Sums) -> GroupFit:
    """Eq. 15 for the torque less its friction. Raises as `fit_groups`."""
    return without_friction(s, IMPEDANCE, with_effects(s, IMPEDANCE, "T_C"))


def with_lag(table: pl.DataFrame, lag: GroupFit) -> pl.DataFrame:
    """A table with K, B and I, with the lag of a leg's torque behind the angle by its belt, the
    shares of B and I that are due to a lag that was found, and B and I without it.

    exp(-s d) = 1 - s d + (s d)^2/2 takes K d off B, and (B + K d/2) d off I, with the fitted B.
    """
    found_s = lag["lag_s"] if lag.certain("lag_s") else None
    without = without_lag(pl.lit(found_s, pl.Float64), lag.half_width("lag_s"))
    size_of_I = (pl.col("I") ** 2 + LITTLE["I"] ** 2).sqrt()
    of_belt = {**estimates_row(lag, "lag_s"), "lag_s_se_bench": lag.se_bench("lag_s")}
    shares = table.with_columns(*without, **of_belt).with_columns(
        lag_share=pl.col("B_without_lag") / pl.col("B") - 1,
        lag_inertia_share=(pl.col("I_without_lag") - pl.col("I")) / size_of_I,
    )
    return shares.with_columns(pl.col("lag_share", "lag_inertia_share").abs().fill_null(0.0))


def beside_known(
    table: pl.DataFrame, p: DrivetrainParameters | None, desired: DesiredImpedance
) -> pl.DataFrame:
    """Hold the estimates of Eq. 15 against the belt, the gains and the sample sheet.

    Parameters
    ----------
    table
        The trial's rows, with K by linear theory where the gains are known.
    p
        The device; None for one without a parameter file. Where neither sheet nor belt says that
        the joint is that of the file, another device may be soft, so that `K_over_K_s` is null up
        to 1. Above 1 a unit may be wrong, or the file is of another device.
    desired
        What the sheet states.

    Returns
    -------
    polars.DataFrame
        The table with `K_over_K_s`, and `K_ratio`, K over the predicted one, with `gain_error`, or
        `K_over_K_d` and `B_over_B_d`. These take K and B without friction where they are known, and
        `K_ratio`, else, K at the largest amplitude, where friction changes it least.
    """
    whole = table.row(-1, named=True)
    largest = table.sort("amplitude_deg")["K"][-1]
    of_spring = whole["K_without_friction"] or largest
    known = dict[str, float | pl.Expr]()
    predicted = whole["K_predicted"]
    if predicted:
        ratio = of_spring / predicted
        known["K_ratio"] = largest / predicted
        known["gain_error"] = max(ratio / RENDERED[1] - 1, 0) + min(ratio / RENDERED[0] - 1, 0)
    elif desired.K_d:
        known["K_over_K_d"] = of_spring / desired.K_d
        if desired.B_d:
            known["B_over_B_d"] = (whole["B_viscous"] or whole["B"]) / desired.B_d
    if p is not None and np.isfinite(p.K_s):
        ratios = pl.col("K") / p.K_s
        is_leg_of_file = desired.controller or desired.K_d or whole["K_s_ratio"] is not None
        known["K_over_K_s"] = ratios if is_leg_of_file else pl.when(ratios > 1).then(ratios)
    return table.with_columns(**known)


def torque_error(s: Sums, label: Label, desired: DesiredImpedance) -> float | None:
    """RMS [N*m] of tau - (K_d theta + B_d omega) in the rows of a label: the error of the rendered
    torque. Offset and drift are the load cell's, and left out. None where K_d or B_d is not
    known."""
    if desired.K_d is None or desired.B_d is None:
        return None
    covariance = s.of(label).covariance(["theta", "omega", "ramp", "torque"])
    weights = np.array([-desired.K_d, -desired.B_d, 0.0, 1.0])
    with_ramp = (covariance @ weights)[2]
    square = weights @ covariance @ weights - with_ramp**2 / covariance[2, 2]
    return float(np.sqrt(max(square, 0.0)))


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
        The relative changes `K_change` and `B_change` from the smallest to the largest amplitude;
        empty for fewer than two amplitudes.
    """
    labels = sorted(label for label in analysis.fits if isinstance(label, float))
    if len(labels) < 2:
        return {}
    row: Row = {}
    change = difference_of(analysis.fits[labels[0]], analysis.fits[labels[-1]])
    for name in CHANGING:
        certain = change.beyond_interval(name)
        row[f"{name}_change"] = certain / np.hypot(analysis.whole[name], LITTLE[name])
    return row


def difference_of(small: GroupFit, large: GroupFit) -> GroupFit:
    """The estimates of one amplitude less those of another, whose errors are independent."""
    return replace(
        large,
        estimates=large.estimates - small.estimates,
        covariance=small.covariance + large.covariance,
        degrees_of_freedom=np.minimum(small.degrees_of_freedom, large.degrees_of_freedom),
        known_errors=(*small.known_errors, *large.known_errors),
    )
