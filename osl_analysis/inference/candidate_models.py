# SPDX-License-Identifier: Apache-2.0
"""The candidate models of Eq. 15 that may explain a torque, as one table, and how each is fitted.

| family | what is not as Eq. 15 has it |
|---|---|
| (none) | nothing: a second-order joint |
| path | the torque is delayed or filtered on its way to the record |
| time | stiffness, damping or inertia changes during the recording |
| speed | damping depends on speed, or there is backlash |
| size | stiffness depends on the angle, or on the frequency |
| direction | stiffness or damping depends on the direction of motion |
| clipping | the largest torques are cut |

The first three columns of a candidate model multiply K, B and I:

    torque = K x_1 + B x_2 + I x_3 + further columns + offset and drift
             (+ dry friction) + noise

A path, for example, delays or filters what the load cell sees of the joint's torque: its x_k are
the delayed angle, velocity and acceleration.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
import scipy

from osl_analysis.base.trial import Array
from osl_analysis.inference.model_names import ModelName
from osl_analysis.inference.spectra import (
    FEWEST_STEPS,
    slipping_springs,
    solve_scaled,
)
from osl_analysis.inference.whitening import Whitened
from osl_analysis.stats.linear_fit import CONDITION_LIMIT, scaled_condition

# Largest delay of torque or angle [s]; a choice: 30 frames at 1 kHz
LARGEST_DELAY_S = 0.03
# Time constants of low-passes [s]; 500 to 3 Hz: amplifiers' filters, held samples at 20 Hz
LAG_S = (3e-4, 0.05)
# Spring in series with the joint [rad/(N*m)]; a frame of 100 kN*m/rad to a belt of 250 N*m/rad
COMPLIANCE = (1e-5, 4e-3)
SPRING_STEPS = 4  # of Gauss-Newton, to K, B and I behind this spring
# Relaxation of a viscoelastic branch [s]; faster than the band it is a damper, slower a spring
BRANCH_S = (5e-3, 0.5)
# Backlash [rad]; 0.03 to 1.1 deg, or more under a larger motion
BACKLASH = (5e-4, 2e-2)

Family = Literal["", "path", "time", "speed", "size", "direction", "clipping"]
# log-likelihood that a grid must gain: below it a weight stays near its small prior, unless B or I
# of Eq. 15 alone is negative, which a path may explain although it gains nothing
WORTH_REFINING = 2.0


# What shows that the ends of a torque are cut
OUTERMOST = 0.002  # quantile of a torque that is its end, beside noise
CUT_ROUNDS = 16  # in which the ends and what is beyond them are found in turn
# slope of a recorded torque over the modelled one beyond its end: halfway between a torque that is
# cut, and one that goes on
MOST_FOLLOWING = 0.5
GRID = 9  # values of a candidate model's own parameter, over the range of a hundred


class Search:
    """Fits of columns to the torque of a joint with or without friction, beside offset and drift.

    These are projected out (Frisch-Waugh-Lovell), so that a search over a candidate model's own
    parameter solves for three columns.

    Attributes
    ----------
    data : Whitened
        The recording.
    has_friction : bool
        Whether the joint has friction.
    left : float
        What Eq. 15 alone leaves of the torque.
    impedance : Array (3,)
        Its K, B, I.
    """

    def __init__(self, data: Whitened, has_friction: bool) -> None:
        self.data = data
        self.has_friction = has_friction
        self._shared = np.linalg.qr(data.shared(has_friction).T)[0]
        self.left, self.impedance = self.fit(data.motion)

    def fit(self, columns: Array, torque: Array | None = None) -> tuple[float, Array]:
        """Residual sum of squares and coefficients (k,) of columns (k, m) for a torque (m,), by
        default that of the recording."""
        rest_of_torque = self.rest(self.data.torque if torque is None else torque)
        rest_of_columns = self.rest(columns)
        estimates = solve_scaled(rest_of_columns, rest_of_torque)
        residual = rest_of_torque - estimates @ rest_of_columns
        return float(residual @ residual), estimates

    def rest(self, signals: Array) -> Array:
        """What friction, offset and drift leave of signals (..., m)."""
        return signals - (signals @ self._shared) @ self._shared.T

    @property
    def is_body(self) -> bool:
        """Whether B and I of Eq. 15 alone are positive."""
        return float(self.impedance[1:].min()) > 0.0

    def minima(self, left: Callable[[float], float], grid: Array) -> list[float]:
        """Up to two minima of what is left over a parameter, sought on a grid (g,) and refined, the
        lower one first; none if it gains nothing.

        A delay has a false minimum beside the true one.
        """
        values = np.array([left(value) for value in grid.tolist()])
        # in noise of variance 1; where B or I of Eq. 15 alone is negative, all are refined
        if self.is_body and (self.left - values.min()) / 2 < WORTH_REFINING:
            return []
        minima = []
        lowest_near = scipy.ndimage.minimum_filter1d(values, 3, mode="nearest")
        for k in np.flatnonzero(values == lowest_near).tolist():
            ends = grid[max(k - 1, 0)], grid[min(k + 1, len(grid) - 1)]
            refined = scipy.optimize.minimize_scalar(
                left,
                bounds=ends,
                method="bounded",
                options={"xatol": 1e-3 * (ends[1] - ends[0])},
            )
            minima.append((refined.fun, refined.x))
        return [parameter for _, parameter in sorted(minima)[:2]]


Terms = tuple[Array, Array]  # whitened columns (k, m), and the torque (m,) that they explain


@dataclass(frozen=True)
class CandidateModel:
    """One explanation of a torque.

    Attributes
    ----------
    family : Family
    name : ModelName
        What it is called.
    terms : function
        Its columns and torque in a search, at a value of its own parameter; None: it cannot be.
        Without one it is Eq. 15 with the columns of its name in `Whitened.columns`.
    grid : function or None
        Values (g,) of the parameter, ascending; None: it has none.
    shares : tuple of float
        Where K, B or I is not one number, the shares of their change that are read: none, and
        those at the ends. The added columns multiply the changes of K, B and I in this order.
    """

    family: Family
    name: ModelName
    terms: Callable[[Search, float], Terms | None] | None = None
    grid: Callable[[Whitened], Array] | None = None
    shares: tuple[float, ...] = (0.0,)


@dataclass(frozen=True)
class ModelAtValue:
    """A candidate model at a value of its own parameter, ready to be fitted and to predict.

    Attributes
    ----------
    model : CandidateModel
        What it is of.
    columns : Array (k, m)
        Whitened columns; the first three multiply K, B and I.
    torque : Array (m,)
        Whitened torque that they explain.
    slopes : sequence of Array (1, m)
        Derivative of the modelled torque by its own parameter, if it has one.
    """

    model: CandidateModel
    columns: Array
    torque: Array
    slopes: Sequence[Array] = ()


def models_at_values(model: CandidateModel, search: Search) -> list[ModelAtValue]:
    """Find values of a candidate model's own parameter that may be; none if it gains nothing, or
    where the motion does not tell its parameters apart: two sines give four numbers, and a
    viscoelastic branch has five parameters."""
    return [
        candidate
        for candidate in values_of_model(model, search)
        if model is EQ_15 or is_told(candidate, search)
    ]


def is_told(candidate: ModelAtValue, search: Search) -> bool:
    """Whether the motion tells a candidate's parameters apart, as it must those of every fit."""
    columns = search.rest(np.concatenate([candidate.columns, *candidate.slopes]))
    return scaled_condition(columns @ columns.T) < CONDITION_LIMIT


def values_of_model(model: CandidateModel, search: Search) -> list[ModelAtValue]:
    """A candidate model at the values of its own parameter that fit best."""
    data = search.data
    terms = model.terms
    if terms is None:
        columns = data.motion
        if model is not EQ_15:
            columns = np.concatenate([columns, data.columns[model.name]])
        return [ModelAtValue(model, columns, data.torque)]
    if model.grid is None:
        without_parameter = terms(search, 0.0)
        return [ModelAtValue(model, *without_parameter)] if without_parameter else []

    def at(value: float) -> Terms:
        modelled = terms(search, value)
        assert modelled is not None
        return modelled

    found = []
    for value in search.minima(lambda value: search.fit(*at(value))[0], model.grid(data)):
        columns, torque = at(value)
        estimates = search.fit(columns, torque)[1]
        # derivative of the modelled torque, from a small step of the parameter
        step = 1e-3 * abs(value) + 1e-9
        columns_then, torque_then = at(value + step)
        slope = (estimates @ (columns_then - columns) - (torque_then - torque)) / step
        found.append(ModelAtValue(model, columns, torque, [slope[None]]))
    return found


def late(search: Search, delay_s: float) -> Terms:
    """A torque, with its friction, that is late by a constant time, or early if it is negative."""
    data = search.data
    advance = np.exp(delay_s * data.spectra.s)
    return data.motion[:3], data.column(data.spectra.torque * advance)


def low_passed(search: Search, lag_s: float) -> Terms:
    """A torque behind a low-pass of first order, or an angle, whose time constant is negative."""
    data = search.data
    low_pass = 1 / (1 + abs(lag_s) * data.spectra.s)
    response = low_pass if lag_s > 0 else 1 / low_pass
    return data.column(data.spectra.derivatives[:3] * response), data.torque


def lags(data: Whitened) -> Array:
    """Time constants of low-passes [s]."""
    of_torque = np.geomspace(*LAG_S, GRID)
    return np.concatenate([-of_torque[::-1], of_torque])


def behind_spring(search: Search, compliance: float) -> Terms:
    """A spring between the angle's encoder and the joint.

    With Z = K + B s + I s^2 and the compliance c the torque is Z/(1 + c Z) theta, which is not
    linear in K, B and I: Gauss-Newton steps linearise it.
    """
    data = search.data
    spectra = data.spectra
    impedance = search.impedance
    for _ in range(SPRING_STEPS):
        of_joint = impedance @ spectra.powers[:3]
        gain = 1 / (1 + compliance * of_joint)
        columns = data.column(spectra.derivatives[:3] * gain**2)
        modelled = data.column(spectra.derivatives[0] * of_joint * gain)
        torque = data.torque - (modelled - impedance @ columns)
        impedance = search.fit(columns, torque)[1]
    return columns, torque


def with_branch(search: Search, relaxation_s: float) -> Terms:
    """A spring that a damper of its own lets go, beside K, B and I (Maxwell): K rises with the
    frequency. It relaxes within a time."""
    data = search.data
    spectra = data.spectra
    high_pass = relaxation_s * spectra.s / (1 + relaxation_s * spectra.s)
    branch = data.column(spectra.derivatives[0] * high_pass)
    return np.vstack([data.motion[:3], branch]), data.torque


def behind_gap(search: Search, width: float) -> Terms:
    """Backlash before spring and damper, which follow the angle when a gap [rad] is taken up."""
    data = search.data
    wound = width / 2 * slipping_springs(data.spectra.angle, [width / 2])[0]
    behind = turned(data, data.spectra.theta - wound)
    return np.vstack([behind[:2], data.motion[2:]]), data.torque


def behind_mount(search: Search, width: float) -> Terms:
    """Backlash between the encoder and a joint that its spring holds in the middle: the joint turns
    by half a gap [rad] less than the angle, to the side to which angle and torque point."""
    spectra = search.data.spectra
    torque = spectra.resampled(*spectra.raw_torque)
    pushed = spectra.angle + torque / search.impedance[0]
    pushed -= np.median(pushed[spectra.inside])
    side = np.clip(2 * pushed / width, -1.0, 1.0)
    return turned(search.data, spectra.theta - width / 2 * side), search.data.torque


def turned(data: Whitened, angle: Array) -> Array:
    """Another angle (p,) than the encoder's with its velocity and acceleration, whitened (3, m)."""
    return data.column(data.spectra.spectrum_of(angle) * data.spectra.powers[:3])


def gap_widths(data: Whitened) -> Array:
    """Widths of a gap [rad], from what rounding cannot be to the SD of the angle: a wider gap is
    taken up by a few motions alone."""
    spectra = data.spectra
    least = max(BACKLASH[0], FEWEST_STEPS * spectra.signals.encoder_step)
    widest = max(BACKLASH[1], float(spectra.angle[spectra.inside].std()))
    return np.geomspace(least, max(widest, 2 * least), GRID)


def cut(search: Search, _: float) -> Terms | None:
    """A torque of which one or both ends are cut, with what K, B and I predict of the missing.

    An end is the median of what is recorded where more is predicted: noise is added after an
    amplifier has cut, so that the largest samples are beyond it. None if the torque goes on there,
    or if no more is missing than what the encoder rounds where the joint rests.
    """
    data = search.data
    spectra = data.spectra
    inside = spectra.inside
    motion = np.array([spectra.angle, spectra.omega, spectra.alpha])[:, inside]
    recorded = spectra.resampled(*spectra.raw_torque)[inside]
    low, high = np.quantile(recorded, (OUTERMOST, 1 - OUTERMOST))
    missing = np.zeros(spectra.product_rows)
    coefficients = search.impedance
    for _step in range(CUT_ROUNDS):
        modelled = coefficients @ motion
        # with the offset of its smaller half, in which nothing is cut
        size = np.abs(modelled - np.median(modelled))
        modelled += np.median((recorded - modelled)[size <= np.median(size)])
        above, below = modelled > high, modelled < low
        high = np.median(recorded[above]) if above.any() else high
        low = np.median(recorded[below]) if below.any() else low
        kept = np.clip(modelled, low, high)
        missing[inside] = modelled - kept
        torque = data.torque + data.column(spectra.spectrum_of(missing))
        coefficients = search.fit(data.motion, torque)[1]

    square = missing @ missing
    followed = missing[inside] @ (recorded - kept)
    rounded = FEWEST_STEPS * spectra.signals.encoder_step * coefficients[0]
    if square <= rounded**2 * np.count_nonzero(missing):
        return None
    return (data.motion, torque) if followed < MOST_FOLLOWING * square else None


EQ_15 = CandidateModel("", ModelName.EQ_15)
CANDIDATE_MODELS = (
    EQ_15,
    CandidateModel(
        "path", ModelName.DELAY, late, lambda _: LARGEST_DELAY_S * np.linspace(-1, 1, 3 * GRID)
    ),
    CandidateModel("path", ModelName.LOW_PASS, low_passed, lags),
    CandidateModel(
        "path", ModelName.SPRING_IN_SERIES, behind_spring, lambda _: np.geomspace(*COMPLIANCE, GRID)
    ),
    CandidateModel("time", ModelName.CHANGE_OVER_TIME, shares=(0.0, -0.5, 0.5)),
    CandidateModel("time", ModelName.CHANGE_AT_ONCE, shares=(0.0, 1.0)),
    CandidateModel("speed", ModelName.DAMPING_BY_SPEED),
    CandidateModel("size", ModelName.NONLINEAR_SPRING),
    CandidateModel("size", ModelName.K_BY_SIDE, shares=(0.0, 1.0, -1.0)),
    CandidateModel(
        "size", ModelName.VISCOELASTIC_BRANCH, with_branch, lambda _: np.geomspace(*BRANCH_S, GRID)
    ),
    CandidateModel("direction", ModelName.K_AND_B_BY_DIRECTION, shares=(0.0, 1.0, -1.0)),
    CandidateModel("speed", ModelName.BACKLASH, behind_gap, gap_widths),
    CandidateModel("speed", ModelName.BACKLASH_IN_MOUNT, behind_mount, gap_widths),
    CandidateModel("clipping", ModelName.CLIPPING, cut),
)
