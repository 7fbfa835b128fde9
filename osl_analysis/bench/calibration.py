# SPDX-License-Identifier: Apache-2.0
"""Calibration of a bench: a known spring or inertia, which gives its lag and gain; its fixture,
measured alone and taken off the torque of every other trial; and the frame between two angles."""

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
import polars as pl

from osl_analysis.base.errors import IdentifiabilityError, InputError
from osl_analysis.base.trial import Trial
from osl_analysis.bench.bench_settings import (
    BenchStiffness,
    Calibration,
    Fixture,
    ImpedanceAnalysis,
)
from osl_analysis.bench.budgets import fit_tables
from osl_analysis.bench.impedance import Analysis, fit_all_groups, with_encoder_errors
from osl_analysis.bench.lags import late_fit
from osl_analysis.bench.plausibility import check_resists
from osl_analysis.bench.record import Record
from osl_analysis.bench.regression import (
    IMPEDANCE,
    SLOW,
    Model,
    columns_of,
    gram_sums,
    least_squares,
    sums_of,
)
from osl_analysis.signals.grid import origin, uniform_signals
from osl_analysis.stats.budget import NORMAL_HALF_WIDTH, Budget, Row
from osl_analysis.stats.linear_fit import LinearFit
from osl_analysis.stats.sources import Source

LEAST_FRICTION = 1e-3  # of the torque's SD; what a sound calibration's friction is negative by


class CalibrationOfTwoClocks(Calibration):
    """A calibration whose `delay` holds the error of a clock that was fitted, too, which tells
    nothing of what delays the torque itself."""

    is_stated: bool

    @property
    def tells_delay(self) -> bool:
        """Whether the delay was measured, too."""
        return self.is_stated


def with_clock_error(settings: ImpedanceAnalysis, clock: Mapping[str, float]) -> ImpedanceAnalysis:
    """Settings whose `calibration.delay` holds the standard error of the fit of a trial's second
    `clock` to the first, in the middle of the trial."""
    error_s = clock["residual"] / np.sqrt(max(clock["edges"], 1))
    stated = settings.calibration
    with_clock = {**stated.model_dump(), "delay": np.hypot(stated.delay, error_s)}
    calibration = CalibrationOfTwoClocks(**with_clock, is_stated=stated.tells_delay)
    return settings.model_copy(update={"calibration": calibration})


JOINT_SIDE = "theta_joint"  # column of the angle between frame and joint
SPRING_LOSS = 1e-3
"""Half-width of the loss factor of a spring, tan(phase), about 0: steel and clamps have 1e-4 to
1e-3."""
LEAST_INERTIA_SHARE = 0.01
"""Torque of the inertia over that of the spring, at the fastest motion, from which damping is told
from a delay. They differ by the inertia's torque alone, and 0.001 of the torque are usually
wrong."""
SAME_FIXTURE = 0.02  # share by which a stated fixture may differ, as rounding does


@dataclass(frozen=True)
class Known:
    """A spring, an inertia, or both, that calibrate a bench."""

    stiffness: float | None  # [N*m/rad]
    inertia: float | None  # [kg*m^2]
    share: float  # their relative standard uncertainty


def measured_frame(trial: Trial, record: Record) -> LinearFit | None:
    """Measure what yields between the angles `theta` and `theta_joint`, its `frame_stiffness`; None
    without an angle on the joint's side, or where nothing certainly yields.

    Notes
    -----
    Least squares of theta - theta_joint over the torque, with an offset.

    Raises
    ------
    InputError
        The angle has no time base, or is that of the bench.
    """
    if JOINT_SIDE not in trial.columns:
        return None
    uniform = uniform_signals(trial, ("theta", JOINT_SIDE, "torque"), record.settings)
    signals = uniform.signals
    wound = signals["theta"] - signals[JOINT_SIDE]
    if not np.ptp(wound):
        raise InputError(
            f"trial {trial.name}: theta - {JOINT_SIDE} is {wound[0]:g} rad in every sample, so"
            " both are one signal",
            f"name the channel of the joint's side for {JOINT_SIDE} in the source file, or leave"
            f" {JOINT_SIDE} out",
        )
    torque, filtered = record.settings.low_pass(
        np.column_stack([signals["torque"], wound]), uniform.rate_hz
    ).T
    columns = {"load": torque, "one": np.ones_like(torque)}
    sums = gram_sums(replace(record, torque=wound, filtered_torque=filtered), columns)
    fit = least_squares(sums, {"compliance": "load", "offset": "one"})
    stiffness = 1 / fit["compliance"]
    frame = fit.derived({"frame_stiffness": (stiffness, {"compliance": -(stiffness**2)})})
    return frame if frame.interval("frame_stiffness")[0] > 0 else None


def stiffness_to_state(frame: LinearFit) -> BenchStiffness:
    """The stiffness of a frame as the configuration states it."""
    return BenchStiffness(
        value=f"{frame['frame_stiffness']:.4g} N*m/rad",
        standard_error=f"{error_to_state(frame, 'frame_stiffness'):.2g} N*m/rad",
    )


def calibration_table(
    analysis: Analysis, known: Known | None, frame: LinearFit | None, stated: Fixture | None
) -> dict[str, pl.DataFrame]:
    """The trial's row of `calibration.csv`, and its rows of `budget.csv`: Eq. 15 of a known spring
    or inertia, with friction and a late torque.

    A spring has no damping beyond `SPRING_LOSS`, unless the fit that allows one, whose `B` is
    given, is certain of it: torque in phase with the velocity, beside friction, is a delay. For an
    inertia, higher derivatives tell a delay from the damping of its bearing. `gain` is the measured
    K or I over the known one; the rest is the fixture's. `known` is None where the fixture turns
    alone: its own inertia and weight are measured. `frame` is what yields between two angles, and
    `stated` the fixture that one alone is compared with.

    Raises
    ------
    InputError
        Nothing is known, and it is no fixture alone.
    IdentifiabilityError
        As `least_squares`.
    """
    row, budgets = known_row(analysis, known, frame) if known else fixture_row(analysis, stated)
    of_trial = {"trial": analysis.record.name, **row, **analysis.diagnostics(None)}
    return fit_tables("calibration", (of_trial, budgets))


def known_row(
    analysis: Analysis, known: Known, frame: LinearFit | None
) -> tuple[Row, dict[str, Budget]]:
    """What a known spring or inertia tells of the bench; raises as `calibration_table`."""
    record = analysis.record
    size = known.stiffness or known.inertia
    if not size or size < 0:
        raise InputError(
            f"trial {record.name}: a calibration needs what is known",
            "fill in known_K [N*m/rad] of its spring, known_I [kg*m^2] of its inertia, or"
            " `alone` under fixture, in the sample sheet",
        )
    counted, damped = late_fits(record, known.stiffness is not None)
    fit = bench_estimates(counted, known)
    check_resists(record.name, "K" if known.stiffness else "I", fit["gain"])
    if counted is not damped:
        # the lag of a spring's own loss in the middle of the band, as a rectangular distribution: a
        # phase of d at f is a lag of d/(2 pi f)
        middle_hz = np.sqrt(record.band_hz[0] * record.band_hz[1])
        lag_of_loss_s = SPRING_LOSS / (2 * np.pi * middle_hz) / np.sqrt(3)
        loss = np.array([lag_of_loss_s, 0.0, 0.0, 0.0])
        fit = fit.with_known_error(Source.SPRING_LOSS, loss)

    low, high = counted.interval("T_C")
    if high < -LEAST_FRICTION * np.std(record.filtered_torque):
        # as none does: the lag of its torque is no delay, and no clock that drifts
        raise InputError(
            f"trial {record.name}: friction T_C = {counted['T_C']:.3g} N*m ({low:.3g} to"
            f" {high:.3g}) is certainly negative, as where the torque is late by what changes",
            "see that nothing slips or filters it, and record angle and torque by one device",
        )
    delay = error_to_state(fit, "lag_s")
    gain = error_to_state(fit, "gain")
    to_state = f"calibration: {{torque_gain: {gain:.2g}, delay: {delay:.2g}}}"
    budgets = {name: fit.budget(name) for name in fit.names}
    if frame is not None:
        stated = stiffness_to_state(frame)
        to_state = (
            f"{{{to_state}, bench_stiffness: {{value: {stated.value}, standard_error:"
            f" {stated.standard_error}}}}}"
        )
        budgets["frame_stiffness"] = frame.budget("frame_stiffness")
    if damped:
        budgets["B"] = damped.budget("B")
    budgets["T_C"] = counted.budget("T_C")
    row: Row = {
        "known_K": known.stiffness,
        "known_I": known.inertia,
        # the lag that is fitted is the mean over the fitted rows
        "lag_at_start_s": fit["lag_s"]
        - counted["clock_drift"] * record.time[record.is_fitted()].mean(),
        "certain_clock_drift_ppm": fit.beyond_interval("clock_drift_ppm"),
        "certain_lag_s": fit.beyond_interval("lag_s"),
        "certain_gain_error": fit.beyond_interval("gain", 1.0),
        "to_state": to_state,
    }
    return row, budgets


def late_fits(record: Record, is_spring: bool) -> tuple[LinearFit, LinearFit | None]:
    """Fit Eq. 15 with friction and a late torque.

    Returns
    -------
    counted : LinearFit
        The fit that counts: of a spring without damping, unless this is certain.
    damped : LinearFit or None
        The fit that allows damping; None for a spring with too little inertia to tell it.
    """
    columns = sums_of(record).columns
    coarse = record.coarse
    model = {**IMPEDANCE, "T_C": "T_C"}

    def fitted(model: Model) -> LinearFit:
        """The fit with the error of the encoder's steps, to first order in the lags."""
        fit, _ = late_fit(coarse, columns, model, drifts=True)
        in_time = sum(fit[name] * columns[column] for name, column in model.items())
        slope = -np.gradient(in_time, 1 / coarse.rate_hz)
        of_lags = {"clock_drift": slope * columns["ramp"], "lag_s": slope}
        of_fit = {**model, **{name: name for name in of_lags}}  # in the order of the fit
        return with_encoder_errors(record, {**columns, **of_lags}, of_fit, {None: fit})[None]

    if not is_spring:
        fit = fitted(model)
        return fit, fit

    undamped = fitted({name: column for name, column in model.items() if name != "B"})
    fastest = 2 * np.pi * record.band_hz[1]
    if abs(undamped["I"]) * fastest**2 < LEAST_INERTIA_SHARE * undamped["K"]:
        return undamped, None
    damped = fitted(model)
    is_damped = damped["B"] > 0 and damped.certain("B")
    return (damped if is_damped else undamped), damped


def bench_estimates(fit: LinearFit, known: Known) -> LinearFit:
    """Lag, gain, and the fixture's inertia or weight, from Eq. 15 of what is known."""
    main, beside, name = ("K", "I", "inertia") if known.stiffness else ("I", "K", "weight")
    size = known.stiffness or known.inertia or np.nan
    taken = known.inertia or 0.0 if known.stiffness else 0.0
    gain = fit[main] / size
    other = fit[beside] / gain
    found = fit.derived(
        {
            "lag_s": (fit["lag_s"], {"lag_s": 1.0}),
            "gain": (gain, {main: 1 / size}),
            name: (other - taken, {beside: 1 / gain, main: -other / fit[main]}),
            "clock_drift_ppm": (1e6 * fit["clock_drift"], {"clock_drift": 1e6}),
        }
    )
    of_known = known.share * np.array([0.0, gain, other - taken, 0.0])
    return found.with_known_error(Source.KNOWN_PART, of_known)


def error_to_state(fit: LinearFit, name: str) -> float:
    """The standard error to state of an estimate: half of its interval over 1.96, since a stated
    error has no degrees of freedom."""
    return fit.half_width(name) / NORMAL_HALF_WIDTH


def fixture_row(analysis: Analysis, stated: Fixture | None) -> tuple[Row, dict[str, Budget]]:
    """Inertia and weight of a fixture that turns alone, the angle at which it hangs, and how far a
    stated fixture is from them.

    A stated fixture is off in its units, and at most in multiples of what the intervals of both, or
    `SAME_FIXTURE`, leave open.

    Raises
    ------
    InputError
        The inertia is certainly negative.
    """
    record = analysis.record
    of_joint = analysis.calibrated[None]
    check_resists(record.name, "I", of_joint["I"], of_joint.interval("I")[1])
    fit = fixture_by_sine(record)
    budgets = {}
    rest_error = ""
    if fit is None:
        fit = fixture_about_middle(analysis)
    else:
        budgets["rest_deg"] = fit.budget("rest_deg")
        rest_error = f", rest_error_deg: {error_to_state(fit, 'rest_deg'):.2g}"
    budgets.update({name: fit.budget(name) for name in ("inertia", "weight")})
    row: Row = {
        "rest_deg": fit["rest_deg"],
        "to_state": (
            f"fixture: {{inertia: {max(fit['inertia'], 0.0):.4g}, weight: {fit['weight']:.4g},"
            f" rest_deg: {fit['rest_deg']:.3g},"
            f" inertia_error: {error_to_state(fit, 'inertia'):.2g},"
            f" weight_error: {error_to_state(fit, 'weight'):.2g}{rest_error}}}"
        ),
    }
    if stated is not None:
        row["fixture_error"] = fixture_error(fit, stated)
    return row, budgets


def fixture_error(fit: LinearFit, stated: Fixture) -> float:
    """How far a stated fixture is from the fitted one: the largest error of inertia and weight over
    what the intervals of both, or `SAME_FIXTURE`, leave open. A weight is a vector that hangs: it
    is off along the fitted one, and across it."""
    weight = fit["weight"]
    turned = np.deg2rad(stated.rest_deg - fit["rest_deg"])
    errors = {  # error, half-width of the fit's interval, that of what is stated, size
        "inertia": (
            stated.inertia - fit["inertia"],
            fit.half_width("inertia"),
            2 * stated.inertia_error,
            fit["inertia"],
        ),
        "along": (
            stated.weight * np.cos(turned) - weight,
            fit.half_width("weight"),
            2 * stated.weight_error,
            weight,
        ),
        "across": (
            stated.weight * np.sin(turned),
            weight * np.deg2rad(fit.half_width("rest_deg")),
            2 * stated.weight * np.deg2rad(stated.rest_error_deg),
            weight,
        ),
    }
    return max(
        abs(error) / max(float(np.hypot(of_fit, of_stated)), SAME_FIXTURE * abs(size))
        for error, of_fit, of_stated, size in errors.values()
    )


def fixture_by_sine(record: Record) -> LinearFit | None:
    """`inertia` [kg*m^2], `weight` [N*m] and `rest_deg` [deg] by the torque that will be taken off,
    I alpha + w sin(theta - rest), beside losses, offset and drift; None where the motion does not
    tell where the weight hangs more closely than its own range."""
    theta = record.motion.theta
    columns = {**columns_of(record), "sine": np.sin(theta), "cosine": np.cos(theta)}
    model = {"I": "alpha", "B": "omega", "sine": "sine", "cosine": "cosine", **SLOW}
    sums = gram_sums(record, columns, record.angle_noise)
    try:
        fit = fit_all_groups(record, model, sums).calibrated[None]
    except IdentifiabilityError:  # within a small motion a cosine is like an offset
        return None
    of_sine, of_cosine = fit["sine"], fit["cosine"]  # w cos(rest) and -w sin(rest)
    weight = float(np.hypot(of_sine, of_cosine))
    by_sine, by_cosine = of_sine / weight, of_cosine / weight
    of_rest = np.rad2deg(np.array([by_cosine, -by_sine]) / weight)
    rest_deg = float(np.rad2deg(np.arctan2(-of_cosine, of_sine)))
    rest_deg = (rest_deg + 90) % 360 - 90  # upright is 180
    fixture = fit.derived(
        {
            "inertia": (fit["I"], {"I": 1.0}),
            "weight": (weight, {"sine": by_sine, "cosine": by_cosine}),
            "rest_deg": (
                rest_deg,
                {"sine": of_rest[0], "cosine": of_rest[1]},
            ),
        }
    )
    range_deg = np.rad2deg(np.ptp(theta[record.is_fitted()]))
    return fixture if 2 * fixture.half_width("rest_deg") < range_deg else None


def fixture_about_middle(analysis: Analysis) -> LinearFit:
    """The same where the motion does not tell where the weight hangs: it is taken to hang in the
    middle of the motion, or opposite where its torque falls with the angle. No small motion tells
    it from another one with the same slope there."""
    record = analysis.record
    theta = record.motion.theta
    middle = float(theta[record.is_fitted()].mean())
    columns = {**columns_of(record), "sine": np.sin(theta - middle)}
    sums = gram_sums(record, columns, record.angle_noise)
    model = {"I": "alpha", "B": "omega", "sine": "sine", **SLOW}
    fit = fit_all_groups(record, model, sums).calibrated[None]
    hangs = fit["sine"] >= 0
    rest_deg = float(np.rad2deg(middle)) + (0.0 if hangs else 180.0)
    return fit.derived(
        {
            "inertia": (fit["I"], {"I": 1.0}),
            "weight": (abs(fit["sine"]), {"sine": 1.0 if hangs else -1.0}),
            "rest_deg": (rest_deg, {"sine": 0.0}),
        }
    )


def with_fixture(trial: Trial, fixture: Fixture) -> Trial:
    """Let the time base take the fixture of the settings off the torque; one that the sheet states
    for this trial comes first."""
    if "torque" not in trial.columns or "fixture" in origin(trial, "torque"):
        return trial
    # arguments of `signals.grid.fixture_torque`
    stated = fixture.model_dump(include={"inertia", "weight", "rest_deg"})
    of_torque = {**origin(trial, "torque"), "fixture": stated}
    columns = {**trial.provenance.get("columns", {}), "torque": of_torque}
    return replace(trial, provenance={**trial.provenance, "columns": columns})


def fixture_column(trial: Trial) -> pl.Expr:
    """The column `fixture`: what is taken off the torque, in words; null if nothing is stated."""
    fixture = origin(trial, "torque").get("fixture")
    if fixture is None:
        return pl.lit(None, pl.String).alias("fixture")
    parts = [f"{name} {value:g}" for name, value in fixture.items() if value]
    return pl.lit(", ".join(parts) or "none", pl.String).alias("fixture")
