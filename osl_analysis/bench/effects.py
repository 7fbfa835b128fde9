"""Effects as columns beside the physics of the joint: friction, a weight, higher derivatives.

A model (Eq. 15, Eq. 4) names its columns; an effect is one more. All of it is algebra on the Gram
matrices of groups (regression.py).

Friction that is left out passes for a lag and for a changing stiffness. Faults of a recording are
found by the inference (joint_inference.py), or by the belt of a leg."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
import scipy
from numpy.typing import NDArray

from osl_analysis.bench.record import Label, Record
from osl_analysis.bench.regression import EFFECTS_LIMIT, GroupFit, Sums, fit_groups, gram_sums
from osl_analysis.signals import seven_point_motion
from osl_analysis.trial import Array

Admittance = Callable[[NDArray[np.complex128]], NDArray[np.complex128]]
"""theta/torque [rad/(N*m)] of a model, for complex s [rad/s]."""
Model = Mapping[str, str]  # estimate -> column of `sums_of`
# Eq. 15
IMPEDANCE: Model = {"K": "theta", "B": "omega", "I": "alpha", "offset": "one", "drift": "ramp"}
# Eq. 4 without a belt
TRANSMISSION: Model = {"B_j": "omega", "J_j": "alpha", "offset": "one", "drift": "ramp"}
FALSE_ALARM = 1e-3  # probability of a false alarm for one effect
SIGN_WIDTHS = {"T_C_sharp": 1e-3, "T_C": 1e-2}
"""Columns of Coulomb friction, by the velocity [rad/s] over which it changes sign; the larger is
ten times the velocity noise of 14 bits."""
BEYOND = 1.1  # cut-offs above which the band's end is motion, not the tail of a faster step
NEXT = {"theta": "omega", "omega": "alpha", "alpha": "jerk"}  # derivative of each column
LONGEST_LAG = 0.02  # s; the largest lag that is sought
LAG_FOUND = 1e-6  # s; last step of a search that has come to its end
LAG_CONVERGED = 1e-9  # s; the step after it would be a thousand times smaller
# of a search for a lag: four shrink from 20 ms below `LAG_CONVERGED`, as each is about a thousandth
# of the one before; one is to spare
MOST_STEPS = 5


def plain_sums(record: Record, model: Model) -> Sums:
    """The sums of a record without effects."""
    columns, centre = columns_of(record)
    return gram_sums(record, columns, list(model.values()), centre)


def columns_of(record: Record) -> tuple[dict[str, Array], float]:
    """The columns (n,) of the models by name, and the angle [rad] about which `theta` is
    centred."""
    motion = record.motion
    fitted = record.rows()
    centre = float(motion.theta[fitted].mean())
    columns = {
        "theta": motion.theta - centre,
        "omega": motion.omega,
        "alpha": motion.alpha,
        "one": np.broadcast_to(1.0, motion.theta.shape),
        "ramp": record.time - record.time[fitted].mean(),
    }
    return columns, centre


def sums_of(record: Record, model: Model, expected: Admittance | None = None) -> Sums:
    """The sums of a coarse record with all effects; the arguments are those of `effect_columns`."""
    few = record.coarse
    columns, centre = effect_columns(record, expected)
    rich = [*model.values(), "jerk", "snap", "T_C"]
    sums = gram_sums(few, columns, rich, centre)
    return replace(sums, columns={})  # unused, and large


def effect_columns(
    record: Record, expected: Admittance | None = None
) -> tuple[dict[str, Array], float]:
    """The columns (n,) of models and effects of a coarse record, and the centre [rad] of `theta`.
    `expected` is the linear model's admittance, if the gains are known."""
    few = record.coarse
    columns, centre = columns_of(few)
    higher = seven_point_motion(columns["alpha"], few.rate_hz)
    columns["jerk"] = higher.omega
    columns["snap"] = higher.alpha
    low_pass, highest_hz = record.settings.low_pass, record.band_hz[1]
    omega = few.motion.omega
    if highest_hz > BEYOND * low_pass.cutoff_hz:
        # the sign of a slower signal changes at other times
        swift = replace(low_pass, cutoff_hz=min(2 * highest_hz, 0.2 * record.rate_hz))
        theta = swift(record.theta, record.rate_hz)[:: round(record.rate_hz / few.rate_hz)]
        omega = np.gradient(theta, 1 / few.rate_hz)
    for name, width in SIGN_WIDTHS.items():
        columns[name] = low_pass(np.tanh(omega / width), few.rate_hz)
    if expected is not None:
        columns["linear"] = linear_torque(few, expected)
    return columns, centre


def linear_torque(record: Record, expected: Admittance) -> Array:
    """Torque (n,) [N*m] of the linear model with admittance `expected` for the filtered motion, up
    to three cut-offs. The record is extended by its mirror image to make it periodic."""
    n, theta = len(record.time), record.motion.theta - record.motion.theta.mean()
    mirrored = np.fft.rfft(np.concatenate([theta, theta[::-1]]))
    s = np.asarray(2j * np.pi * np.fft.rfftfreq(2 * n, 1 / record.rate_hz), dtype=np.complex128)
    kept = (np.abs(s) < 2 * np.pi * 3.0 * record.settings.cutoff_hz) & (s != 0)
    mirrored[kept] /= expected(s[kept])
    return np.asarray(np.fft.irfft(np.where(kept, mirrored, 0.0), 2 * n)[:n])


def with_effects(s: Sums, model: Model, effects: Sequence[str], label: Label = None) -> GroupFit:
    """Fit of a model with the columns of effects to a label. Raises as `fit_groups`."""
    with_columns = {**model, **{name: name for name in effects}}
    return fit_groups(s, with_columns, s.groups.of(label), EFFECTS_LIMIT)


@dataclass(frozen=True)
class LateFit:
    """A model with a lag of the torque."""

    fit: GroupFit  # its last estimate is the lag, `lag_s` [s]
    has_ended: bool  # whether the search has come to its end


def late_fit(
    few: Record,
    columns: Mapping[str, Array],
    model: Model,
    centre: float = 0.0,
    prompt_torque: Array | float = 0.0,
    lag_s: float = 0.0,
) -> LateFit:
    """Fit a model to a torque that is late (Gauss-Newton).

    In each step the torque is advanced by the lag that is known so far. The slope of the torque is
    a column, which gives the lag that remains. The slope is the model's, as far as its derivatives
    are columns: that of a noisy torque would pull the lag to 0. It needs estimates, so that the
    first step is a fit without a lag. A model without derivatives uses the torque's own slope.

    Parameters
    ----------
    few : Record
        A coarse record of n rows.
    columns : Mapping of Array (n,)
        Columns by name.
    model : Mapping
        Column of each estimate.
    centre : float
        As `gram_sums` takes it.
    prompt_torque : Array (n,) or float
        Part of the torque that is not late, and is subtracted [N*m].
    lag_s : float
        Where the search starts [s].

    Raises
    ------
    InputError, IdentifiabilityError
        As `fit_groups`.
    """
    torque_at = scipy.interpolate.make_interp_spline(few.time, few.filtered_torque, 5)
    derivatives = {
        name: columns[NEXT[column]] for name, column in model.items() if NEXT.get(column) in columns
    }

    def fit_at(times: Array, slope: Mapping[str, Array]) -> GroupFit:
        """The model, with the torque's slope if it is given, for the torque at other times."""
        torque = torque_at(times) - prompt_torque
        advanced = replace(few, filtered_torque=torque, torque=torque)
        sums = gram_sums(advanced, {**columns, **slope}, list(columns), centre)
        with_lag = {**model, "lag_s": "late"} if slope else model
        return fit_groups(sums, with_lag, limit=EFFECTS_LIMIT)

    times = np.clip(few.time + lag_s, few.time[0], few.time[-1])
    fit = fit_at(times, {})
    for _ in range(MOST_STEPS):
        slope = torque_at(times, 1)
        if derivatives:
            slope = np.sum([fit[name] * column for name, column in derivatives.items()], axis=0)
        fit = fit_at(times, {"late": -slope})
        step_s = fit["lag_s"]
        lag_s = float(np.clip(lag_s + step_s, -LONGEST_LAG, LONGEST_LAG))
        times = np.clip(few.time + lag_s, few.time[0], few.time[-1])
        if abs(step_s) < LAG_CONVERGED:
            break
    with_lag = np.append(fit.estimates[:-1], lag_s)
    return LateFit(replace(fit, estimates=with_lag), abs(step_s) <= LAG_FOUND)
