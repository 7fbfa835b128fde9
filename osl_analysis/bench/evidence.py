# SPDX-License-Identifier: Apache-2.0
"""Rendered impedance on the dynamometer (Figs. 4-6): the rows of Eq. 15, the budget of each
estimate, and what else the plausibility of a trial is judged by."""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
import polars as pl

from osl_analysis.bench.budgets import alternatives, fit_tables, other_stamps, stated_models
from osl_analysis.bench.friction import (
    CERTAIN_FRICTION,
    actuator_of_leg,
    coulomb_fits,
    fit_less,
    frictionless_leg,
    inferred_of_joint,
    is_friction_untold,
    with_other_shapes,
)
from osl_analysis.bench.impedance import Analysis, parts_of, range_over
from osl_analysis.bench.lags import Belt, belt_of_leg, is_leg
from osl_analysis.bench.plausibility import check_resists, check_stiffer, unit_of_step
from osl_analysis.bench.record import Label
from osl_analysis.bench.regression import IMPEDANCE, Sums, fit_groups, sums_of
from osl_analysis.bench.rendered_gains import rendered_gains
from osl_analysis.inference import FrictionlessActuator, ImpedanceInference
from osl_analysis.model.compensator import CONTROLLERS, Gains, Weight, select_gains
from osl_analysis.model.drivetrain import (
    NOTHING_STATED,
    DrivetrainParameters,
    StatedOfDevice,
    dynamic_stiffness,
)
from osl_analysis.stats.budget import (
    LIKELY,
    QUANTITIES,
    WITHOUT_FRICTION,
    Budget,
    Contribution,
    Row,
    unknown,
)
from osl_analysis.stats.linear_fit import LinearFit
from osl_analysis.stats.rounding import significant

LARGE_DELAY = 0.05  # share of B that the half-width of a leg's delay may make before it is told


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
    of_device: StatedOfDevice = NOTHING_STATED,
) -> dict[str, pl.DataFrame]:
    """Put together the trial's rows of `impedance.csv`, and of `budget.csv`.

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
    of_device
        What its parameter file states beside its values.

    Returns
    -------
    dict of polars.DataFrame
        `impedance`: a row per amplitude [deg], and one over all of them (amplitude null).
        `budget`: what contributes to each of their estimates.

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

    expected = None
    if p and gains:
        expected = partial(dynamic_stiffness, K_1=gains.K_1, B_1=gains.B_1, p=p)
    s = sums_of(record, expected)
    rendered = None
    if p and desired.controller:
        rendered = rendered_gains(analysis, p, of_device)
    found = what_else(analysis, s, p, rendered is not None and rendered.VAF > whole.vaf)

    other_excitation = "periodic" if record.periodic else "other"
    of_trial: Row = {
        **vars(desired),
        "excitation": "stepped sine" if record.groups.kind == "cycles" else other_excitation,
        "band_low_hz": record.band_hz[0],
        "band_high_hz": record.band_hz[1],
        "cutoff_hz": record.settings.cutoff_hz,
        "K_s_ratio": found.belt.K_s_ratio,
        "angle_too_small": unit_of_step(record.encoder_step),
    }
    if expected:
        # a drivetrain is of higher order: Eq. 15 fitted to the linear model's torque
        of_gains = s.estimates([*IMPEDANCE.values()], "linear")
        of_trial.update(K_predicted=of_gains[0], B_predicted=of_gains[1])
    fits = []
    for label in analysis.fits:
        variance = s.of(label).covariance(["theta"])
        budgets = estimates_of(analysis, found, label)
        if label is None:
            budgets = with_other_contributions(analysis, found, budgets, bool(gains))
            if rendered:
                budgets = {**budgets, **rendered.budgets}
                # linear theory has no friction: that of B is in the rendered damping, too
                friction = [
                    each for each in budgets["B"].contributions if each.source == "friction"
                ]
                budgets["B_d_rendered"] = budgets["B_d_rendered"].plus(*friction)
        row: Row = {
            **analysis.place(label),
            **analysis.diagnostics(label),
            **(found.ranges if label is None else {}),
            "VAF_rendered": rendered.VAF if rendered and label is None else None,
            "torque_error": torque_error(analysis.sums, label, desired),
            "theta_rms_deg": np.rad2deg(np.sqrt(variance[0, 0])),
            "fitted_s": record.is_fitted(label).sum() / record.rate_hz,
            **of_trial,
        }
        fits.append((row, budgets))
    tables = fit_tables("impedance", *fits)
    table = tables["impedance"]
    # a leg's friction hides it without compensation; Eq. 15 is of motion below the cut-off
    is_slow = record.band_hz[1] <= record.settings.cutoff_hz
    if gains and gains.cancels_friction and is_slow:
        apart = pl.col("B_predicted") - pl.col("B")
        half_width = (pl.col("B_high") - pl.col("B_low")) / 2
        half_range = ((pl.col("B_range_high") - pl.col("B_range_low")) / 2).max().fill_null(0.0)
        certain = (apart.abs() - (half_width**2 + half_range**2).sqrt()).clip(0)
        table = table.with_columns(B_gap_s=apart.sign() * certain / pl.col("K").abs())
    return {**tables, "impedance": beside_known(table, p, desired)}


@dataclass(frozen=True)
class WhatElse:
    """What a recording tells beside Eq. 15."""

    belt: Belt  # of a leg
    joint: ImpedanceInference | None  # of a joint: the candidate models; None: not weighed
    is_friction_untold: bool  # whether the motion does not tell friction from damping
    without_friction: Mapping[Label, LinearFit]  # where friction is certain
    ranges: Row  # the range of estimates over amplitudes and frequencies


def what_else(
    analysis: Analysis, s: Sums, p: DrivetrainParameters | None, is_of_gains: bool
) -> WhatElse:
    """Weigh the candidate models of a joint or look at the belt of a leg, and fit dry friction."""
    record = analysis.record
    of_leg = is_leg(record, p, is_of_gains)
    joint = None if of_leg else inferred_of_joint(record)
    inferred = actuator_of_leg(record) if of_leg else joint
    is_certain = inferred.friction_probability > CERTAIN_FRICTION if inferred else None
    if of_leg and "theta_m" not in record.actuator:
        is_certain = False  # the drivetrain passes for friction of the joint
    coulomb = coulomb_fits(s, analysis, is_certain)
    certain = {label: fit for label, fit in coulomb.items() if fit is not None}
    column = "T_C"
    if isinstance(inferred, FrictionlessActuator) and is_certain:
        # it acts behind the belt, where its size need not show
        s, certain[None] = frictionless_leg(analysis, inferred)
        column = "friction"
    elif joint and is_certain and None in certain:
        certain[None] = with_other_shapes(certain[None], joint)
    whole = certain.get(None)
    parts = list(parts_of(record, s))
    fit_part = partial(fit_groups, model=IMPEDANCE)
    ranges = range_over(parts, fit_part, analysis.whole, {name: name for name in QUANTITIES})
    if whole is not None:
        size = whole["T_C"] if "T_C" in whole.names else 1.0
        fit_part = partial(fit_less, column=column, size=size)
        ranges |= range_over(parts, fit_part, whole, {"B": "B_viscous"})
    return WhatElse(
        belt=belt_of_leg(record, p) if p and of_leg and "theta_m" in record.actuator else Belt(),
        joint=joint,
        is_friction_untold=not (of_leg and inferred)
        and is_friction_untold(s, analysis, coulomb, inferred is not None),
        without_friction=certain,
        ranges=ranges,
    )


def estimates_of(analysis: Analysis, found: WhatElse, label: Label) -> dict[str, Budget]:
    """The estimates of a label with their own budgets: of Eq. 15, without friction where this is
    certain, and the lag of a leg."""
    budgets = analysis.budgets(label, *QUANTITIES)
    without = found.without_friction.get(label)
    if without is not None:
        for name, column in WITHOUT_FRICTION.items():
            if name in without.names:
                budgets[column] = without.budget(name)
    if found.belt.lag:
        budgets["lag_s"] = found.belt.lag.budget("lag_s")
    return budgets


def with_other_contributions(
    analysis: Analysis, found: WhatElse, budgets: dict[str, Budget], gains_are_known: bool
) -> dict[str, Budget]:
    """The estimates of a whole trial with what another motion, a fault, and what was not checked
    would change."""
    stated = stated_models(analysis.record)
    of_lag = moved_by_lag(found.belt, budgets)
    not_checked = unchecked(analysis, found, budgets, stated, gains_are_known)
    complete = dict(budgets)
    for k, name in enumerate(QUANTITIES):
        common = [
            *over_motion(analysis, found.ranges, name),
            *other_stamps(analysis, name),
            *of_lag.get(name, ()),
            *alternatives(found.joint, stated, k),
            *(of_source[name] for of_source in not_checked if name in of_source),
        ]
        without = WITHOUT_FRICTION[name]
        own = budgets[name]
        if without in budgets:
            complete[without] = budgets[without].plus(*common)
            half = abs(own.value - budgets[without].value) / 2
            own = own.plus(Contribution("friction", half, basis="measured", part="motion"))
        complete[name] = own.plus(*common)
    return complete


def over_motion(analysis: Analysis, ranges: Row, name: str) -> list[Contribution]:
    """Half of the range of an estimate over the motion. Where most of it is a change from the
    smallest to the largest amplitude, beyond noise, it has a name: a stiffening spring, or
    backlash, raises K, and friction lowers K and B."""
    low, high = ranges.get(f"{name}_range_low"), ranges.get(f"{name}_range_high")
    if not (isinstance(low, float) and isinstance(high, float)):
        return []
    source = "amplitude"
    labels = sorted(label for label in analysis.fits if isinstance(label, float))
    if len(labels) > 1:
        small, large = analysis.fits[labels[0]], analysis.fits[labels[-1]]
        change = large[name] - small[name]
        noise = np.hypot(small.half_width(name), large.half_width(name))
        if abs(change) > max(noise, (high - low) / 2):
            if change < 0 and name != "I":
                source = "friction"
            elif name == "K":
                source = "nonlinear_spring"
    detail = "over amplitudes and frequencies"
    return [Contribution(source, (high - low) / 2, basis="measured", part="motion", detail=detail)]


def moved_by_lag(belt: Belt, budgets: Mapping[str, Budget]) -> dict[str, list[Contribution]]:
    """What the certain lag of a leg's torque takes off B and I.

    exp(-s d) = 1 - s d + (s d)^2/2 takes K d off B, and (B + K d/2) d off I, with the fitted B.
    """
    if belt.lag is None or not belt.lag.certain("lag_s"):
        return {}
    lag_s = belt.lag["lag_s"]
    K, B = budgets["K"].value, budgets["B"].value
    detail = f"the torque lags the angle by {significant(1e3 * lag_s, 3)} ms"
    moved = {"B": K * lag_s, "I": (B + K * lag_s / 2) * lag_s}
    return {
        name: [Contribution("late_torque", abs(by), basis="measured", part="fault", detail=detail)]
        for name, by in moved.items()
    }


def unchecked(
    analysis: Analysis,
    found: WhatElse,
    budgets: Mapping[str, Budget],
    stated: set[str],
    gains_are_known: bool,
) -> list[dict[str, Contribution]]:
    """What this recording does not tell, by source and estimate."""
    record = analysis.record
    settings = record.settings
    K, B, I = (budgets[name].value for name in QUANTITIES)
    rows = []
    of_path = found.joint.probability_of("path") if found.joint else 0.0
    lag = found.belt.lag
    # a belt that tells the lag so badly that it may be a tenth of B
    is_untold = lag is None or K * lag.half_width("lag_s") > LARGE_DELAY * abs(B)
    if is_untold and "delay" not in stated and of_path < LIKELY:
        rows.append(unknown("late_torque", "ms", B=1e-3 * K, I=1e-3 * B))
    if not settings.calibration.torque_gain and not gains_are_known:
        rows.append(unknown("wrong_gain", "%", K=0.01 * K, B=0.01 * B, I=0.01 * I))
    # channels of one clock have the same rate
    rates = [stream["ppm"] for stream in record.streams if stream["ppm"] is not None]
    if not np.ptp(rates or [0.0]):
        rows.append(unknown("clocks_disagree", "%", B=0.01 * B, I=0.02 * I))
    if settings.fixture is None:
        rows.append(unknown("fixture_inertia", "N*m", K=1.0))
        rows.append(unknown("fixture_inertia", "kg*m^2", I=1.0))
    if found.joint is None:
        rows.append(unknown("change_over_time", K=0.0))
    if found.is_friction_untold:
        rows.append(unknown("friction", B=0.0))
    return rows


def beside_known(
    table: pl.DataFrame, p: DrivetrainParameters | None, desired: DesiredImpedance
) -> pl.DataFrame:
    """Hold the estimates of Eq. 15 against the belt, the gains and the sample sheet.

    Parameters
    ----------
    table
        The trial's rows, with K by linear theory where the gains are known.
    p
        The device; None for one without a parameter file.
    desired
        What the sheet states.

    Returns
    -------
    polars.DataFrame
        The table with `K_over_K_s`, and `K_ratio`, K over the predicted one, or `K_over_K_d` and
        `B_over_B_d`. These take K and B without friction where they are known, else K at the
        largest amplitude, where friction changes it least.
    """
    whole = table.row(-1, named=True)
    largest = table.sort("amplitude_deg")["K"][-1]
    of_spring = whole["K_without_friction"] or largest
    known = dict[str, float | pl.Expr]()
    predicted = whole["K_predicted"]
    if predicted:
        known["K_ratio"] = of_spring / predicted
    elif desired.K_d:
        known["K_over_K_d"] = nearest_in_range(whole, of_spring, desired.K_d) / desired.K_d
        if desired.B_d:
            known["B_over_B_d"] = (whole["B_viscous"] or whole["B"]) / desired.B_d
    if p is not None and np.isfinite(p.K_s):
        known["K_over_K_s"] = pl.col("K") / p.K_s
    return table.with_columns(**known)


def nearest_in_range(fit: Mapping[str, Any], K: float, K_d: float) -> float:
    """What of K and of its range is nearest to K_d: an amplitude at which the joint renders K_d
    speaks against a wrong gain or unit."""
    ends = [fit.get(f"K_range_{end}") for end in ("low", "high")]
    values = [K, *(value for value in ends if value is not None)]
    return float(np.clip(K_d, min(values), max(values)))


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
