"""The 95 % intervals that a planned protocol will give for K, B and I, by the Fisher information of
the fits' columns. docs/design_of_experiments.md has the formulas and their sources."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import scipy

from osl_analysis.bench.effects import IMPEDANCE
from osl_analysis.bench.group_interval import BY_REPEATS, BY_UNITS, FEWEST_UNITS
from osl_analysis.bench.planned_errors import (
    KBI,
    Distortion,
    Impedances,
    PlannedFit,
    Sensors,
    eq15,
    planned_fit,
)
from osl_analysis.bench.planned_motion import (
    ENOUGH_REALISATIONS,
    Continuous,
    PeriodicMultisine,
    Plan,
    SteppedSine,
)
from osl_analysis.bench.row_groups import STRETCH_S
from osl_analysis.signals import LowPass
from osl_analysis.stats.covariance import welch_satterthwaite
from osl_analysis.trial import Array

MANY = 1e5  # degrees of freedom that count as infinite


@dataclass(frozen=True)
class Precision:
    """The precision that a plan will give; arrays are of K, B and I, (3,), in SI units."""

    fit: PlannedFit
    expected: Array
    half_width: Array  # of the 95 % interval
    half_width_of_noise: Array  # the same without distortion
    se: Array
    degrees_of_freedom: Array
    variance: Mapping[str, Array]  # by cause
    method: str  # `interval_method` of the analysis

    def reaches(self, within: Mapping[str, float]) -> bool:
        """Whether the half-widths are within these shares of K, B and I, as far as stated."""
        size = np.maximum(np.abs(self.expected), np.finfo(float).tiny)
        share = self.half_width / size
        return all(share[KBI.index(name)] <= largest for name, largest in within.items())


@dataclass(frozen=True)
class Variances:
    """Variances of K, B and I, (3,) each, by what the analysis knows of them."""

    noise: Array  # of torque and angle, which the scatter of cycles or stretches shows
    known: Array  # of rounding and drift, which count as known
    distortion: Array  # which the scatter of units shows


@dataclass(frozen=True)
class Freedom:
    """Degrees of freedom of K, B and I, (3,) each, and where the interval comes from."""

    of_noise: Array  # of noise and known errors
    of_all: Array  # with the distortion
    method: str


def precision(
    plan: Plan,
    joint: Array,
    sensors: Sensors,
    low_pass: LowPass,
    distortion: Distortion | None = None,
) -> Precision:
    """Predict the intervals that a plan will give for a joint.

    Parameters
    ----------
    plan : Plan
        The motion.
    joint : Array
        K, B and I that are expected, (3,) [SI units].
    sensors : Sensors
        Errors of load cell and encoder.
    low_pass : LowPass
        The filter of the analysis.
    distortion : Distortion, optional
        Stated deviations of the joint from a linear one.

    Returns
    -------
    Precision
        Intervals by the source that the fit will use (`interval_method`).

    Raises
    ------
    IdentifiabilityError
        The motion cannot tell K from I.

    Notes
    -----
    Units are those of `group_sums`: a frequency at an amplitude, or a stretch. The noise has the
    degrees of freedom of cycles, or of stretches; the distortion, as scatter of units, one fewer
    than units; rounding and drift count as known. For a multisine the interval is from the spread
    of realisations; with fewer than four, from the level at detection lines, each of which serves
    the excited lines around it.
    """
    stated = distortion or Distortion()
    fit = planned_fit(plan, low_pass)
    Z = joint @ eq15(fit.sines.w)
    errors = sensors.variances(fit.sines, Z, plan.record_s)
    causes = {name: fit.share(error).sum(axis=1) for name, error in errors.items()}
    causes["encoder rounding"] = causes["encoder rounding"] + common_rounding(sensors, fit, Z)
    variances = Variances(
        noise=causes["torque noise"] + causes["angle noise"],
        known=causes["encoder rounding"] + causes["load cell drift"],
        distortion=stated.variances(plan, fit),
    )
    of_noise = variances.noise + variances.known
    total = of_noise + variances.distortion
    if isinstance(plan, PeriodicMultisine):
        at_lines = np.sum([*errors.values(), stated.at_sines(fit)], axis=0)
        freedom = freedom_of_multisine(plan, fit.share(at_lines))
    else:
        of_each_sine = fit.share(errors["torque noise"] + errors["angle noise"])
        freedom = freedom_of_units(plan, variances, of_each_sine)
    return Precision(
        fit=fit,
        expected=joint,
        half_width=half_width(total, freedom.of_all),
        half_width_of_noise=half_width(of_noise, freedom.of_noise),
        se=np.sqrt(total),
        degrees_of_freedom=freedom.of_all,
        variance={**causes, "distortion": variances.distortion},
        method=freedom.method,
    )


def half_width(variance: Array, degrees_of_freedom: Array) -> Array:
    """Half-widths of 95 % intervals (Student), shape (3,)."""
    return np.asarray(scipy.special.stdtrit(degrees_of_freedom, 0.975) * np.sqrt(variance))


def common_rounding(sensors: Sensors, fit: PlannedFit, Z: Impedances) -> Array:
    """Variances (3,) of K, B and I by the rounding that all sines of one amplitude share, for an
    impedance Z (n,) [N*m/rad]."""
    common = sensors.rounding(fit.sines).common
    variance = np.zeros(3)
    for amplitude in np.unique(np.round(fit.sines.size[common > 0], 9)):
        of_amplitude = np.isclose(fit.sines.size, amplitude)
        change = fit.fitted(np.where(of_amplitude, Z, 0))
        variance = variance + common[of_amplitude].mean() * change**2
    return variance


def freedom_of_multisine(plan: PeriodicMultisine, of_lines: Array) -> Freedom:
    """Degrees of freedom of an interval from realisations, or from detection lines; `of_lines`
    (3, n) are the parts of the variances due to each line."""
    if plan.realisations >= ENOUGH_REALISATIONS:
        of_spread = np.full(3, plan.realisations - 1.0)
        return Freedom(of_spread, of_spread, "realisations")
    motion = plan.motion(0)
    distance = np.abs(motion.lines[:, None] - motion.detection[None, :])
    nearest_detection = np.argmin(distance, axis=1)
    freedom = []
    for of_estimate in of_lines:
        by_detection = np.bincount(nearest_detection, of_estimate)
        effective_lines = by_detection.sum() ** 2 / np.sum(by_detection**2)
        freedom.append(2 * plan.realisations * effective_lines)
    return Freedom(np.array(freedom), np.array(freedom), "detection lines")


def freedom_of_units(
    plan: SteppedSine | Continuous, variances: Variances, of_each_sine: Array
) -> Freedom:
    """Degrees of freedom of an interval from cycles and units; `of_each_sine` (3, n) are the parts
    of the variances due to the noise of each sine."""
    sines = plan.sines
    cycles = np.rint(sines.duration_s / sines.cycle_s)
    groups = float(cycles.sum())
    if isinstance(plan, Continuous):
        groups = plan.record_s / STRETCH_S
    units, method = groups, BY_UNITS
    if isinstance(plan, SteppedSine):
        if len(cycles) >= FEWEST_UNITS:
            units = float(len(cycles))
        else:
            method = BY_REPEATS
    if cycles.min() > 1:
        noise_freedom = welch_satterthwaite(list(of_each_sine.T), cycles - 1)
    else:
        # nothing repeats: neighbours overlap, and each of five columns uses up half a group
        noise_freedom = np.full(3, max(groups / 1.5 - len(IMPEDANCE) / 2, 1.0))
    infinite = np.full(3, np.inf)
    unit_freedom = np.full(3, max(units - 1, 1.0))
    of_noise = welch_satterthwaite([variances.noise, variances.known], [noise_freedom, infinite])
    of_all = welch_satterthwaite(
        [variances.noise, variances.known, variances.distortion],
        [noise_freedom, infinite, unit_freedom],
    )
    return Freedom(
        np.where(of_noise < MANY, of_noise, np.inf),
        np.where(of_all < MANY, of_all, np.inf),
        method,
    )
