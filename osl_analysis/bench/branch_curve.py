"""Torque over angle of one branch of a loop, loading or unloading: its line, and its curve."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import polars as pl
import scipy

from osl_analysis.stats.regression import CONDITION_LIMIT
from osl_analysis.trial import Array

FEWEST_SAMPLES = 10  # of a parabola, whose noise is measured by a cubic beside it
NORMAL_QUANTILE = 1.96  # half-width of a 95 % interval in standard errors, of many samples


def straight_line(theta: Array, torque: Array, pieces: Sequence[slice]) -> float:
    """Fit the slope of a branch by least squares over angle.

    Each sample has the weight of the angle that it covers, so that a rest on the way, or a slower
    end, does not count more.

    Parameters
    ----------
    theta, torque : Array
        Angle [rad] and torque [N*m] of the trial, (n,) each.
    pieces : Sequence[slice]
        Rows of the branch.

    Returns
    -------
    float
        The slope [N*m/rad].
    """
    weight = np.concatenate([np.abs(np.gradient(theta[piece])) for piece in pieces])
    rows = np.r_[*pieces]
    angle, load = theta[rows], torque[rows]
    centred = angle - np.average(angle, weights=weight)
    return float(np.sum(weight * centred * load) / np.sum(weight * centred**2))


@dataclass(frozen=True)
class LocalParabola:
    """A parabola through the samples of a branch near one angle; NaN where it is not known."""

    torque: float = np.nan  # at the angle [N*m]
    slope: float = np.nan  # at the angle [N*m/rad]
    torque_variance: float = np.nan  # in noise of density 1 (N*m)^2 per sample
    slope_variance: float = np.nan
    density: float = np.nan  # of the noise [(N*m)^2 per sample]
    degrees_of_freedom: float = np.nan  # of the density


def local_parabola(
    theta: Array, torque: Array, at: float, window: float, independent: int
) -> LocalParabola:
    """Fit a parabola to the samples within a window of an angle.

    Parameters
    ----------
    theta, torque : Array
        Angle [rad] and torque [N*m] of a branch in one cycle, (n,) each.
    at, window : float
        The angle, and how far the samples lie from it at most [rad].
    independent : int
        Number of samples after which noise is independent.

    Returns
    -------
    LocalParabola
        All NaN with too few samples. If they do not reach the ends of the window, only the slope is
        NaN.

    Notes
    -----
    The noise is the residual of a cubic, as an AR(1) at steps of `independent` samples: that of the
    parabola would contain the bend of the curve.
    """
    near = np.abs(theta - at) <= window
    x = (theta[near] - at) / window
    load = torque[near]
    cubic = np.vander(x, 4, increasing=True)
    parabola = cubic[:, :3]
    if x.size < FEWEST_SAMPLES or np.linalg.cond(parabola) > CONDITION_LIMIT:
        return LocalParabola()
    solution = np.linalg.pinv(parabola)
    per_unit = np.array([1.0, window])  # of torque and slope: x is in windows
    value, slope = solution[:2] @ load / per_unit
    torque_variance, slope_variance = np.sum(solution[:2] ** 2, axis=1) / [1.0, window**2]
    noise = load - cubic @ np.linalg.lstsq(cubic, load)[0]
    power = float(noise @ noise)
    autocorrelation = float(noise[independent:] @ noise[:-independent])
    autocorrelation = max(autocorrelation / max(power, np.finfo(float).tiny), 0.0)
    memory = independent * (1 + autocorrelation) / (1 - autocorrelation)  # [samples]
    freedom = max(x.size / memory - 4, 1.0)  # the cubic uses up four
    reaches_both_ends = theta.min() <= at - window and theta.max() >= at + window
    return LocalParabola(
        torque=value,
        slope=slope if reaches_both_ends else np.nan,
        torque_variance=torque_variance,
        slope_variance=slope_variance,
        density=power / freedom,
        degrees_of_freedom=freedom,
    )


def branch_curve(
    cycles: Sequence[tuple[Array, Array]], angle_deg: Array, window: float, independent: int
) -> pl.DataFrame:
    """Measure torque and stiffness of one branch at some angles.

    Parameters
    ----------
    cycles : Sequence[tuple[Array, Array]]
        Angle [rad] and torque [N*m] of the branch in each cycle.
    angle_deg : Array
        The angles (m,) [deg].
    window, independent
        As of `local_parabola`.

    Returns
    -------
    pl.DataFrame
        A row per angle: torque [N*m] and stiffness, its slope over angle [N*m/rad], as means over
        the cycles with 95 % intervals; `change`, the torque of the last cycle minus the first. NaN
        out of the branch's reach.

    Notes
    -----
    Intervals are from the cycles' scatter (Student). With one cycle they are from its noise: the
    median density of its points, since at a kink the misfit of the cubic would count as noise. With
    few degrees of freedom the median is below the mean by the factor of Wilson and Hilferty (1931).
    """
    fits = [
        [local_parabola(theta, torque, at, window, independent) for at in np.deg2rad(angle_deg)]
        for theta, torque in cycles
    ]
    # rows: cycles, columns: angles
    torque = np.array([[fit.torque for fit in of_cycle] for of_cycle in fits])
    slope = np.array([[fit.slope for fit in of_cycle] for of_cycle in fits])
    if len(cycles) > 1:
        quantile = float(scipy.special.stdtrit(len(cycles) - 1, 0.975)) / np.sqrt(len(cycles))
        torque_half = quantile * np.std(torque, axis=0, ddof=1)
        slope_half = quantile * np.std(slope, axis=0, ddof=1)
    else:
        torque_half, slope_half = half_widths_by_noise(fits[0])
    mean_torque, mean_slope = torque.mean(axis=0), slope.mean(axis=0)
    return pl.DataFrame(
        {
            "angle_deg": angle_deg,
            "torque": mean_torque,
            "torque_low": mean_torque - torque_half,
            "torque_high": mean_torque + torque_half,
            "stiffness": mean_slope,
            "stiffness_low": mean_slope - slope_half,
            "stiffness_high": mean_slope + slope_half,
            "change": torque[-1] - torque[0],
        }
    )


def half_widths_by_noise(fits: Sequence[LocalParabola]) -> tuple[Array, Array]:
    """Half-widths of the intervals of torque and slope (m,), from the noise of one cycle."""
    known = [fit for fit in fits if np.isfinite(fit.density)]
    density, freedom = np.nan, np.nan
    if known:
        density = float(np.median([fit.density for fit in known]))
        freedom = float(np.median([fit.degrees_of_freedom for fit in known]))
    mean_density = density / (1 - 2 / (9 * freedom)) ** 3
    torque_variance = np.array([fit.torque_variance for fit in fits])
    slope_variance = np.array([fit.slope_variance for fit in fits])
    return (
        NORMAL_QUANTILE * np.sqrt(mean_density * torque_variance),
        NORMAL_QUANTILE * np.sqrt(mean_density * slope_variance),
    )
