"""One regression for every motion on the bench, from sums over groups of rows.

One pass over the samples sums the products of all columns in each group: of the model, and of what
else the torque may hold, such as friction, a weight, or higher derivatives. All else is small
algebra on these sums: the fit to a label or to all, its interval, how well it predicts what it has
not seen, and each effect, which is one more column beside the model's.

* A *group* is a few consecutive rows, such as the third cycle of 2 Hz at 5 deg.
* A *stratum* is a set of groups that repeat one another: all cycles of 2 Hz at 5 deg.
* A *label* is what has a fit of its own: 5 deg. None stands for the whole recording.
* A *unit* is what is left out at a time to see the scatter: a stratum, or a group where strata are
  few.

The interval covers the estimate from this motion on this joint (docs/method.md). For each estimate
the variance is that of noise and misfit together, or of the misfit where it is the larger.

* *Noise* is what another recording of the same motion would change: the spread of groups that
  repeat one another. Where nothing repeats, the rows of a motion are whitened, and the misfit alone
  is the variance.
* *Misfit* is the scatter when one unit is left out at a time (jackknife). It holds the noise, too,
  and what the model misses from unit to unit. Amplitudes and frequencies are chosen, not drawn: it
  need not hold the estimate at others.

The *score* of a group is by how much it moves the estimates: the products of its residual with the
columns, times the inverse of the normal equations.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
import scipy
from numpy.typing import NDArray

from osl_analysis.bench.record import Groups, Label, Record
from osl_analysis.errors import IdentifiabilityError
from osl_analysis.measured import SMALLEST_SIGNAL, check_finite
from osl_analysis.model.drivetrain import RationalFunction
from osl_analysis.model.rendered_impedance import linear_torque
from osl_analysis.signals import seven_point_motion
from osl_analysis.stats.budget import MOST_FREEDOM, KnownError
from osl_analysis.stats.linear_fit import (
    CONDITION_LIMIT,
    SMALLEST_DIRECTION,
    LinearFit,
    between_cycles,
    condition_of,
    products_between,
    solved,
    vaf_by_moments,
)
from osl_analysis.trial import Array

Model = Mapping[str, str]  # estimate -> column of `sums_of`
# Eq. 15
IMPEDANCE: Model = {"K": "theta", "B": "omega", "I": "alpha", "offset": "one", "drift": "ramp"}
# Eq. 4 without a belt
TRANSMISSION: Model = {"B_j": "omega", "J_j": "alpha", "offset": "one", "drift": "ramp"}
FALSE_ALARM = 1e-3  # probability of a false alarm for one effect
# level of the test below which noise and misfit are one variance; Bancroft's: at 5 % a misfit of
# the noise's size is missed so often that 87 % hold the truth
POOLING = 0.25
SIGN_WIDTHS = {"T_C_sharp": 1e-3, "T_C": 1e-2}
"""Columns of Coulomb friction, by the velocity [rad/s] over which it changes sign; the larger is
ten times the velocity noise of 14 bits."""
BEYOND = 1.1  # cut-offs above which the band's end is motion, not the tail of a faster step
# largest scaled condition number with effects, whose columns may be nearly collinear
EFFECTS_LIMIT = 1e5
FEWEST_UNITS = 4  # with fewer strata the groups are left out instead
# width over which the spectrum of a residual is smooth; it has at least so many lines
SMOOTHING_HZ = 0.5
FEWEST_LINES = 20
NOT_WHITENED = np.ones(1)  # gain
LEAST_POWER = 1e-20  # of the torque's mean square, below which a residual is rounding


@dataclass(frozen=True)
class Sums:
    """Products of q columns in each of m groups; the last columns are the filtered `torque` and the
    `raw torque`.

    Attributes
    ----------
    names : tuple of str
        Names of the columns; `one` is among them.
    gram : Array (m, q, q)
        The products.
    groups : Groups
        Rows, labels and strata of the groups.
    columns : Mapping of Array (n,)
        The columns themselves, without torques.
    weighted : Array (m, q, q)
        The products that are fitted: of whitened columns, or `gram`.
    gain : Array (r,)
        Of the whitening, by frequency from 0 to half the coarse rate; 1: nothing is whitened.
    """

    names: tuple[str, ...]
    gram: Array
    groups: Groups
    columns: Mapping[str, Array]
    weighted: Array
    gain: Array

    def chosen(self, is_chosen: NDArray[np.bool_]) -> "Sums":
        """Those of some groups, by a mask (m,)."""
        groups = replace(
            self.groups,
            first=self.groups.first[is_chosen],
            stop=self.groups.stop[is_chosen],
            stratum=self.groups.stratum[is_chosen],
        )
        return replace(
            self, gram=self.gram[is_chosen], weighted=self.weighted[is_chosen], groups=groups
        )

    def of(self, label: Label) -> "Sums":
        """Those of a label's groups."""
        return self.chosen(self.groups.of(label))

    def products(self, gram: Array, names: Sequence[str]) -> Array:
        """Products of some columns with one another in each group, (m, k, k), from `gram` or the
        `weighted` ones."""
        places = np.array([self.names.index(name) for name in names])
        return gram[:, places[:, None], places]

    def estimates(self, columns: Sequence[str], target: str = "torque") -> Array:
        """Estimates (p,) alone of columns for the torque, or for another column."""
        products = self.products(self.weighted, [*columns, target]).sum(axis=0)
        return solved(products[:-1, :-1], products[:-1, -1])[0]

    def covariance(self, names: Sequence[str]) -> Array:
        """Covariance of columns in the rows of all groups."""
        means = self.products(self.gram, [*names, "one"]).sum(axis=0)
        means /= means[-1, -1]
        of_one = means[-1, :-1]
        return means[:-1, :-1] - np.outer(of_one, of_one)

    def vaf(self, columns: Sequence[str], estimates: Array) -> float:
        """VAF [percent] of estimates (p,) of columns, with an own offset. As
        `variance_accounted_for` if the torque is constant."""
        covariance = self.covariance([*columns, "torque"])
        weights = np.append(-estimates, 1.0)
        left = max(weights @ covariance @ weights, 0.0)
        square, n = np.diag(self.products(self.gram, ["torque", "one"]).sum(axis=0))
        return float(vaf_by_moments(left, covariance[-1, -1], square / n))


def gram_sums(record: Record, columns: Mapping[str, Array]) -> Sums:
    """Sum the products of columns (n,) and of the record's torque, in each group.

    The noise is read from the raw torque, before the filter.

    Raises
    ------
    InputError
        A column cannot be measured.
    """
    signals = {**columns, "torque": record.filtered_torque, "raw torque": record.torque}
    for name, row in signals.items():
        check_finite(f"column '{name}'", row, least=SMALLEST_SIGNAL)
    products = np.array([*signals.values()]).T
    gram = products_between(products, products, record.groups.first, record.groups.stop)
    return Sums(tuple(signals), gram, record.groups, columns, gram, NOT_WHITENED)


def motion_sums(record: Record, columns: Mapping[str, Array]) -> Sums:
    """The sums of a motion of the joint, of whitened columns where nothing repeats.

    The residual of a first fit, of all columns, has the spectrum S(f), from the squares of its
    discrete cosine transform (DCT). Generalised least squares solves

        (X' W W X) x = X' W W torque,   W = DCT^-1 S(f)^-1/2 DCT,

    whose whitened rows have independent errors. A slow error, as of a person who leans on the
    handle, cancels between neighbouring groups, which a jackknife of these does not know. Above the
    cut-off S is that at the cut-off, so that the low-pass stays (Aitken, Proc. R. Soc. Edinburgh
    55, 1936; with an estimated spectrum Hannan, Multiple Time Series, 1970, ch. VII). Raises as
    `gram_sums`.
    """
    sums = gram_sums(record, columns)
    if record.groups.kind != "stretches":
        return sums
    few = record.coarse
    step = round(record.rate_hz / few.rate_hz)
    signals = np.array([*columns.values(), record.filtered_torque]).T[::step]
    rows = few.transformed_rows()
    spectra = scipy.fft.dct(signals[rows], axis=0, norm="ortho")
    lines_per_hz = 2 * len(rows) / few.rate_hz
    gain = whitening_gain(spectra, lines_per_hz, record.settings.cutoff_hz)
    white = np.zeros_like(signals)
    white[rows] = scipy.fft.idct(gain[:, None] * spectra, axis=0, norm="ortho")
    weighted = products_between(white, white, few.groups.first, few.groups.stop)
    return replace(sums, weighted=weighted, gain=gain)


def whitening_gain(spectra: Array, lines_per_hz: float, cutoff_hz: float) -> Array:
    """Gain (r,) that whitens what columns leave of a torque, whose DCT (r, p + 1) has the torque
    last.

    The spectrum of the residual is the mean of the squares of neighbouring lines without the line
    itself: with it, a line whose residual is large by chance would weigh less, and the interval be
    too narrow.
    """
    X = spectra[:, :-1]
    torque = spectra[:, -1]
    squares = (torque - X @ solved(X.T @ X, X.T @ torque)[0]) ** 2
    lines = max(round(SMOOTHING_HZ * lines_per_hz), FEWEST_LINES)
    means = scipy.ndimage.uniform_filter1d(squares, lines, mode="mirror")
    power = (lines * means - squares) / (lines - 1)
    cutoff = round(cutoff_hz * lines_per_hz)
    power[cutoff:] = power[cutoff : cutoff + 1]
    return 1 / np.sqrt(np.maximum(power, LEAST_POWER * np.mean(torque**2)))


def sums_of(record: Record, expected: RationalFunction | None = None) -> Sums:
    """The sums of a coarse record with all effects; the arguments are those of `effect_columns`."""
    return motion_sums(record.coarse, effect_columns(record, expected))


def offset_and_drift(time: Array) -> dict[str, Array]:
    """Columns (n,) of a constant, and of a ramp over times (n,) [s] that is 0 on average."""
    return {"one": np.ones_like(time), "ramp": time - time.mean()}


def columns_of(record: Record) -> dict[str, Array]:
    """The columns (n,) of the models by name; `theta` is 0 in the middle of the fitted rows:
    verdicts do not depend on the encoder's zero."""
    motion = record.motion
    fitted = record.is_fitted()
    return {
        "theta": motion.theta - motion.theta[fitted].mean(),
        "omega": motion.omega,
        "alpha": motion.alpha,
        "one": np.broadcast_to(1.0, motion.theta.shape),
        "ramp": record.time - record.time[fitted].mean(),
    }


def effect_columns(record: Record, expected: RationalFunction | None = None) -> dict[str, Array]:
    """The columns (n,) of models and effects of a coarse record. `expected` is the linear model's
    admittance, if the gains are known."""
    few = record.coarse
    columns = columns_of(few)
    higher = seven_point_motion(columns["alpha"], few.rate_hz)
    columns["jerk"] = higher.omega
    columns["snap"] = higher.alpha
    low_pass = record.settings.low_pass
    highest_hz = record.band_hz[1]
    omega = record.motion.omega
    if highest_hz > BEYOND * low_pass.cutoff_hz:
        # the sign of a slower signal changes at other times
        swift = replace(low_pass, cutoff_hz=min(2 * highest_hz, 0.2 * record.rate_hz))
        omega = np.gradient(swift(record.theta, record.rate_hz), 1 / record.rate_hz)
    step = round(record.rate_hz / few.rate_hz)
    for name, width in SIGN_WIDTHS.items():
        # at the recorded rate, at which the sign changes within fewer rows
        columns[name] = low_pass(np.tanh(omega / width), record.rate_hz)[::step]
    if expected is not None:
        columns["linear"] = linear_torque(
            expected, columns["theta"], few.rate_hz, 3 * low_pass.cutoff_hz
        )
    return columns


@dataclass(frozen=True)
class GroupFit(LinearFit):
    """A fit whose interval covers the estimate from this motion (docs/method.md).

    Attributes
    ----------
    repeat : Array (p, p) or None
        Covariance of the repeatability; None where nothing repeats.
    repeat_freedom : Array (p,) or float
        Degrees of freedom of its variances.
    left_out : Array (u, p)
        Estimates without one unit at a time.
    """

    repeat: Array | None = None
    repeat_freedom: Array | float = np.inf
    left_out: Array = field(default_factory=lambda: np.empty((0, 0)))

    def beyond_interval(self, name: str, expected: float = 0.0) -> float:
        """By how much an estimate differs from what is expected, less the half-width of its
        interval; 0 within it."""
        apart = self[name] - expected
        return float(np.sign(apart)) * max(abs(apart) - self.half_width(name), 0.0)

    def derived(self, functions: Mapping[str, tuple[float, Mapping[str, float]]]) -> "GroupFit":
        """Functions of the estimates, to first order.

        Parameters
        ----------
        functions
            By name the value of each, and its derivatives by the estimates that it is of; its
            scatter has the degrees of freedom of the first of these.
        """
        gradients = [gradient for _, gradient in functions.values()]
        J = np.array([[each.get(name, 0.0) for name in self.names] for each in gradients])
        return GroupFit(
            names=tuple(functions),
            estimates=np.array([value for value, _ in functions.values()]),
            covariance=J @ self.covariance @ J.T,
            vaf=self.vaf,
            condition_number=self.condition_number,
            interval_method=self.interval_method,
            largest_correlation=self.largest_correlation,
            degrees_of_freedom=np.array(
                [self.degrees_of_freedom[self.names.index(next(iter(each)))] for each in gradients]
            ),
            known_errors=tuple(
                KnownError(error.source, J @ error.change, error.shared)
                for error in self.known_errors
            ),
        )

    def certain(self, name: str) -> bool:
        """Whether an estimate differs from 0 by a two-sided test at the level `FALSE_ALARM`."""
        quantile = float(scipy.special.stdtrit(self.freedom(name), 1 - FALSE_ALARM / 2))
        return abs(self[name]) > quantile * self.se(name)


def fit_groups(s: Sums, model: Model, limit: float = CONDITION_LIMIT) -> GroupFit:
    """Fit the torque by least squares (Eq. 15), generalised ones where the sums are of whitened
    rows, with an interval that covers this motion.

    Parameters
    ----------
    s
        Sums of the groups that are fitted.
    model
        Column of each of p estimates, by the estimate's name, as `K: theta`.
    limit
        Largest scaled condition number.

    Raises
    ------
    IdentifiabilityError
        A column is 0 throughout, or the condition number is above the limit.
    """
    columns = list(model.values())
    products = s.products(s.weighted, [*columns, "torque"])
    A_g = products[:, :-1, :-1]
    b_g = products[:, :-1, -1]
    A = A_g.sum(axis=0)
    b = b_g.sum(axis=0)
    estimates, inverse = solved(A, b)
    varies = [k for k, column in enumerate(columns) if column != "one"]
    condition, correlation = condition_of(tuple(model), varies, A, inverse, limit)

    stratum = np.unique(s.groups.stratum, return_inverse=True)[1]
    has_strata = stratum.max() + 1 >= FEWEST_UNITS
    has_repeats = s.groups.kind != "stretches" and np.bincount(stratum).min() > 1
    # estimates (u, p) without one of u units at a time
    unit = stratum if has_strata else np.arange(len(A_g))
    belongs = unit == np.unique(unit)[:, None]
    scale = np.sqrt(np.diag(A))
    scaled = (A - np.tensordot(belongs, A_g, 1)) / np.outer(scale, scale)
    scaled += SMALLEST_DIRECTION * np.eye(len(A))
    b_without = (b - belongs @ b_g) / scale
    left_out = np.linalg.solve(scaled, b_without[..., None])[..., 0] / scale
    covariance = scatter_of(left_out)
    freedom = np.full(len(A), max(len(left_out) - 1.0, 1.0))
    noise = None
    noise_freedom: Array | float = np.inf
    if has_repeats:
        # before the filter noise is independent from row to row
        raw_g = s.products(s.gram, [*columns, "raw torque"])[:, :-1, -1]
        noise, noise_freedom = between_cycles((raw_g - A_g @ estimates) @ inverse, stratum)
        if has_strata:
            covariance, freedom = combined(noise, noise_freedom, covariance, len(left_out))
    elif len(left_out) < FEWEST_UNITS:
        # to first order: without one of them the rest may tell nothing
        scores = (b_g - A_g @ estimates) @ inverse
        covariance = len(scores) / freedom[0] * scores.T @ scores
    return GroupFit(
        names=tuple(model),
        estimates=estimates,
        covariance=covariance,
        vaf=s.vaf(columns, estimates),
        condition_number=condition,
        interval_method="repeats" if has_repeats and not has_strata else "units",
        degrees_of_freedom=freedom,
        largest_correlation=correlation,
        repeat=noise,
        repeat_freedom=noise_freedom,
        left_out=left_out,
    )


def with_effects(s: Sums, model: Model, *effects: str) -> GroupFit:
    """Fit of a model with the columns of effects. Raises as `fit_groups`."""
    with_columns = {**model, **{name: name for name in effects}}
    return fit_groups(s, with_columns, EFFECTS_LIMIT)


def scatter_of(left_out: Array) -> Array:
    """Covariance (p, p) of estimates by the scatter of those without one unit at a time (u, p):
    noise, misfit and leverage (jackknife; Miller, Biometrika 61, 1974)."""
    u = len(left_out)
    scatter = left_out - left_out.mean(axis=0)
    return scatter.T @ scatter * (u - 1) / u


def combined(
    noise: Array,
    freedom: Array,
    misfit: Array,
    units: int,
) -> tuple[Array, Array]:
    """Combine what noise and misfit do to p estimates.

    The misfit holds the noise. Where a test (F) does not tell one from the other, both are
    estimates of one variance, and their mean is taken; else the misfit (Bancroft, Biometrics 20,
    1964). Correlations are those of the sum of noise and misfit.

    Parameters
    ----------
    noise : Array (p, p)
        Covariance by noise, with `freedom` (p,) degrees of freedom.
    misfit : Array (p, p)
        Covariance by the scatter of two `units` or more.

    Returns
    -------
    covariance : Array (p, p)
    freedom : Array (p,)
        Degrees of freedom of its variances.
    """
    of_noise = np.diag(noise)
    of_misfit = np.diag(misfit)
    misfit_freedom = units - 1.0
    noise_freedom = np.minimum(freedom, MOST_FREEDOM)
    both_freedoms = noise_freedom + misfit_freedom
    pooled = (noise_freedom * of_noise + misfit_freedom * of_misfit) / both_freedoms
    largest_ratio = scipy.special.fdtri(misfit_freedom, noise_freedom, 1 - POOLING)
    is_larger = of_misfit > largest_ratio * of_noise
    both = noise + misfit
    of_both = np.maximum(np.diag(both), np.finfo(float).tiny)
    error = np.sqrt(np.where(is_larger, of_misfit, pooled) / of_both)
    return both * np.outer(error, error), np.where(is_larger, misfit_freedom, both_freedoms)


def held_out_vaf(s: Sums, model: Model) -> float | None:
    """Lowest VAF [percent] of a third of the groups, as of every third cycle, by the fit to the
    others, with its own offset. None where two thirds do not tell the estimates."""
    place = np.argsort(np.argsort(s.groups.first)) % 3
    vafs = []
    for third in np.unique(place):
        try:
            estimates = fit_groups(s.chosen(place != third), model).estimates
        except IdentifiabilityError:
            return None
        vafs.append(s.chosen(place == third).vaf([*model.values()], estimates))
    return min(vafs)
