# SPDX-License-Identifier: Apache-2.0
"""Rendered impedance on the dynamometer (Figs. 4-6): the rows of Eq. 15, the budget of each
estimate, and what else the plausibility of a trial is judged by."""

from dataclasses import dataclass
from functools import partial

import numpy as np
import polars as pl

from osl_analysis.bench.budgets import (
    Evidence,
    fit_tables,
    half_width_of,
    with_other_contributions,
)
from osl_analysis.bench.friction import (
    DryFriction,
    actuator_of_leg,
    friction_of_joint,
    friction_of_leg,
    inferred_of_joint,
)
from osl_analysis.bench.impedance import Analysis, parts_of, range_over
from osl_analysis.bench.lags import Belt, belt_of_leg, is_leg
from osl_analysis.bench.plausibility import check_resists, check_stiffer, unit_of_step
from osl_analysis.bench.record import Label
from osl_analysis.bench.regression import IMPEDANCE, Sums, sums_of, with_effects
from osl_analysis.bench.rendered_gains import rendered_gains
from osl_analysis.model.compensator import CONTROLLERS, Gains, Weight, select_gains
from osl_analysis.model.drivetrain import (
    NOTHING_STATED,
    DrivetrainParameters,
    StatedOfDevice,
    dynamic_stiffness,
)
from osl_analysis.stats.budget import QUANTITIES, WITHOUT_FRICTION, Budget, Row


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
    check_joint(analysis, desired)
    record = analysis.record

    # linear theory of the device, where its gains are known, and what they render
    expected = None
    if p and gains:
        expected = partial(dynamic_stiffness, K_1=gains.K_1, B_1=gains.B_1, p=p)
    s = analysis.effects
    if s is None or expected is not None:
        s = sums_of(record, expected)
    rendered = None
    if p and desired.controller:
        rendered = rendered_gains(analysis, p, of_device)
    is_of_gains = False
    if rendered:
        # friction that only one of the two models has would decide
        with_friction = with_effects(s, IMPEDANCE, "T_C")
        is_of_gains = (
            rendered.VAF > analysis.whole.vaf or rendered.VAF_with_friction > with_friction.vaf
        )
    evidence = weigh_alternatives(analysis, s, p, is_of_gains, bool(gains))

    # what all rows have
    other_excitation = "periodic" if record.periodic else "other"
    of_trial: Row = {
        **vars(desired),
        "excitation": "stepped sine" if record.groups.kind == "cycles" else other_excitation,
        "band_low_hz": record.band_hz[0],
        "band_high_hz": record.band_hz[1],
        "K_s_ratio": evidence.belt.K_s_ratio,
        "angle_too_small": unit_of_step(record.encoder_step),
    }
    if expected:
        # a drivetrain is of higher order: Eq. 15 fitted to the linear model's torque
        of_gains = s.estimates([*IMPEDANCE.values()], "linear")
        of_trial.update(K_predicted=of_gains[0], B_predicted=of_gains[1])

    # a row of each amplitude, and last that of the whole trial
    fits = []
    for label in analysis.fits:
        row: Row = {
            **analysis.place(label),
            **analysis.diagnostics(label),
            "fitted_s": record.is_fitted(label).sum() / record.rate_hz,
            **of_trial,
        }
        if desired.K_d is not None and desired.B_d is not None:
            row["torque_error"] = torque_error(analysis.sums, label, desired.K_d, desired.B_d)
        budgets = analysis.budgets(label, *QUANTITIES)
        if evidence.belt.lag:
            budgets["lag_s"] = evidence.belt.lag.budget("lag_s")
        if label is None:
            for name in (*QUANTITIES, WITHOUT_FRICTION["B"]):
                ends = evidence.ranges.get(name, (None, None))
                row[f"{name}_range_low"], row[f"{name}_range_high"] = ends
            budgets = with_other_contributions(evidence, budgets)
            if rendered:
                row["VAF_rendered"] = rendered.VAF
                budgets.update(rendered.budgets)
        fits.append((row, budgets))
    tables = fit_tables("impedance", *fits)

    # the estimates beside what is known
    table = tables["impedance"]
    # a leg's friction hides it without compensation; Eq. 15 is of motion below the cut-off
    if gains and gains.cancels_friction and record.band_hz[1] <= record.settings.cutoff_hz:
        table = table.with_columns(B_gap_s=damping_gap())
    of_whole = fits[-1][1]
    K = of_whole.get(WITHOUT_FRICTION["K"], of_whole["K"])
    return {**tables, "impedance": beside_known(table, p, desired, K)}


def check_joint(analysis: Analysis, desired: DesiredImpedance) -> None:
    """Refuse a torque that drives the motion, or a joint that is stiffer than its bench, with
    InputError."""
    whole = analysis.whole
    trial = analysis.record.name
    check_stiffer(trial, "K", whole["K"], analysis.record.settings.bench_stiffness)
    has_losses = whole.interval("B")[0] >= 0 or whole.interval("I")[0] > 0
    # with the right sign K may be negative, as of a weight above the axis, if none is stated; B or
    # I is then certainly positive
    if desired.K_d or not has_losses:
        check_resists(trial, "K", whole["K"], whole.interval("K")[1])


def damping_gap() -> pl.Expr:
    """How much B is below the predicted one, beyond its half-width and half-range, over K [s]."""
    apart = pl.col("B_predicted") - pl.col("B")
    half_range = half_width_of("B_range").max().fill_null(0.0)
    certain = (apart.abs() - (half_width_of("B") ** 2 + half_range**2).sqrt()).clip(0)
    return apart.sign() * certain / pl.col("K").abs()


def weigh_alternatives(
    analysis: Analysis,
    s: Sums,
    p: DrivetrainParameters | None,
    is_of_gains: bool,
    gains_are_known: bool,
) -> Evidence:
    """What a recording tells beside Eq. 15: of a leg its belt, of a joint the candidate models, and
    of both dry friction and the range over the motion."""
    record = analysis.record
    joint = None
    belt = Belt()
    has_drivetrain = is_leg(record, p, is_of_gains)
    if has_drivetrain:
        friction = friction_of_leg(s, analysis, actuator_of_leg(record))
        if p and "theta_m" in record.actuator:
            belt = belt_of_leg(record, p)
    else:
        joint = inferred_of_joint(record)
        friction = friction_of_joint(s, analysis, joint)
    return Evidence(
        analysis=analysis,
        belt=belt,
        joint=joint,
        friction=friction,
        ranges=ranges_over_motion(analysis, friction),
        gains_are_known=gains_are_known,
        is_leg=has_drivetrain,
    )


def ranges_over_motion(analysis: Analysis, friction: DryFriction) -> dict[str, tuple[float, float]]:
    """The range of each estimate over amplitudes and parts of the band, with friction and without
    it, where this is certain."""
    parts = list(parts_of(analysis.record, friction.sums))
    ranges = range_over(parts, *analysis.fits.values())
    if friction.without:
        less_friction = [part.less("T_C", friction.size) for part in parts]
        for name, ends in range_over(less_friction, friction.without).items():
            ranges[WITHOUT_FRICTION[name]] = ends
    return ranges


def beside_known(
    table: pl.DataFrame,
    p: DrivetrainParameters | None,
    desired: DesiredImpedance,
    K: Budget,
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
    K
        Of the whole trial, without friction where this is known.

    Returns
    -------
    polars.DataFrame
        The table with `K_over_K_s`, and `K_ratio`, K over the predicted one, or `K_over_K_d` and
        `B_over_B_d`. `K_over_K_s` is of K itself. The others take K and B without friction where
        they are known; for `K_ratio` else K at the largest amplitude, where friction changes it
        least; for `K_over_K_d` what of K and of
        its range is nearest to K_d.
    """
    whole = table.row(-1, named=True)
    largest = table.sort("amplitude_deg")["K"][-1]
    of_spring = whole["K_without_friction"] or largest
    known: dict[str, float | pl.Expr] = {}
    predicted = whole["K_predicted"]
    if predicted:
        known["K_ratio"] = of_spring / predicted
    elif desired.K_d:
        # an amplitude at which the joint renders K_d speaks against a wrong gain or unit, and so
        # does a spring that hardens
        low, high = K.value - K.half_range, K.value + K.half_range
        known["K_over_K_d"] = float(np.clip(desired.K_d, low, high)) / desired.K_d
        if desired.B_d:
            known["B_over_B_d"] = (whole["B_viscous"] or whole["B"]) / desired.B_d
    if p is not None and np.isfinite(p.K_s):
        known["K_over_K_s"] = pl.col("K") / p.K_s
    return table.with_columns(**known)


def torque_error(s: Sums, label: Label, K_d: float, B_d: float) -> float:
    """RMS [N*m] of tau - (K_d theta + B_d omega) in the rows of a label: the error of the rendered
    torque. Offset and drift are the load cell's, and left out."""
    of_label = s.chosen(s.groups.of(label))
    covariance = of_label.covariance(["theta", "omega", "ramp", "torque"])
    weights = np.array([-K_d, -B_d, 0.0, 1.0])
    with_ramp = (covariance @ weights)[2]
    square = weights @ covariance @ weights - with_ramp**2 / covariance[2, 2]
    return float(np.sqrt(max(square, 0.0)))
