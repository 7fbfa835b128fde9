# SPDX-License-Identifier: Apache-2.0
"""One regression for every motion on the bench, from sums over groups of rows.

One pass over the samples sums the products of all columns in each group: of the model, and of what
else the torque may hold, such as friction, a weight, or higher derivatives. All else is small
algebra on these sums: the fit to a label or to all, its interval, how well it predicts what it has
not seen, and each effect, which is one more column beside the model's.

* A *group* is a few consecutive rows, such as the third cycle of 2 Hz at 5 deg.
* A *stratum* is a set of groups: all cycles of 2 Hz at 5 deg, which repeat one another, or all
  seconds of a motion that does not repeat itself.
* A *label* is what has a fit of its own: 5 deg. None stands for the whole recording.

Each estimate is that of least squares, whatever the motion. Its interval is that of the same
motion, started alike, again where groups repeat, else of noise and misfit of this recording.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
import scipy
from numpy.typing import NDArray

from osl_analysis.base.measured import SMALLEST_SIGNAL, check_finite
from osl_analysis.base.trial import Array
from osl_analysis.bench.record import Groups, Record
from osl_analysis.model.drivetrain import Stiffness, linear_torque
from osl_analysis.signals.filters import HIGHEST_CUTOFF, run_edges, seven_point_motion
from osl_analysis.stats.linear_fit import (
    CONDITION_LIMIT,
    DIRECTION_ROUNDING,
    LinearFit,
    between_cycles,
    products_between,
    solved,
    vaf_by_moments,
)


def left_out(A: Array, b: Array, A_g: Array, b_g: Array) -> tuple[Array, Array]:
    """The scatter by groups that do not repeat one another, each left out in turn.

    It is the cluster jackknife CV3 of MacKinnon, Nielsen and Webb (J. Appl. Econometrics 38, 2023)
    with the degrees of freedom of Bell and McCaffrey (Survey Methodology 28, 2002). With
    u_g = (A - A_g)^-1 (b - b_g) - x,

        V = (n - 1)/n sum u_g u_g'.

    If the rows had independent errors, the u_g of estimate k would have covariances
    C_gg = d_g[k] and C_gh = -d_g' A d_h, where d_g is column k of (A - A_g)^-1 - A^-1, so that V_k
    is distributed as a chi-square of (sum C_gg)^2 / (sum C_gg^2 + sum C_gh^2) freedoms.

    Parameters
    ----------
    A : Array (p, p)
        Normal equations of all rows.
    b : Array (p,)
        Products of all rows with the torque.
    A_g : Array (n, p, p)
        Normal equations of each group.
    b_g : Array (n, p)
        Its products with the torque.

    Returns
    -------
    covariance : Array (p, p)
        Of the estimates.
    freedom : Array (p,)
        Degrees of freedom of its variances.
    """
    n = len(A_g)
    scale = np.sqrt(np.diag(A))
    units = np.outer(scale, scale)
    # without a group the rest may tell nothing: the interval is then very wide
    ridge = DIRECTION_ROUNDING * np.eye(len(A))
    inverse = np.linalg.inv(A / units + ridge) / units
    without = np.linalg.inv((A - A_g) / units + ridge) / units
    u = np.einsum("gij,gj->gi", without, b - b_g) - inverse @ b

    d = without - inverse
    own = np.einsum("gkk->gk", d)
    # sum of squares of d_g' A d_h over all g and h, from p x p matrices, less those of g = h
    root = np.linalg.cholesky(A / units + ridge).T * scale
    e = np.einsum("ij,gjk->gik", root, d)
    inner = np.einsum("gik,gjk->kij", e, e)
    of_pairs = np.sum(inner**2, axis=(1, 2)) - np.sum(np.sum(e**2, axis=1) ** 2, axis=0)
    sum_of_squares = np.sum(own**2, axis=0) + of_pairs
    of_sum = np.sum(own, axis=0) ** 2
    rounding = np.finfo(float)
    # rounding may leave next to nothing of the sum of squares
    freedom = of_sum / np.maximum(sum_of_squares, rounding.eps * of_sum + rounding.tiny)
    return (n - 1) / n * u.T @ u, freedom


Model = Mapping[str, str]  # estimate -> column of `sums_of`
SLOW: Model = {"offset": "one", "drift": "ramp"}  # of a load cell
# Eq. 15
IMPEDANCE: Model = {"K": "theta", "B": "omega", "I": "alpha", **SLOW}
# Eq. 4 without a belt
TRANSMISSION: Model = {"B_j": "omega", "J_j": "alpha", **SLOW}
# velocity [rad/s] of what rubs, a joint or its actuator, over which Coulomb friction changes its
# sign: ten times the noise of 14 bits, and a tenth of it, since no recording shows the width
SIGN_WIDTH = 1e-2
SHARP_WIDTH = 1e-3
BEYOND = 1.1  # cut-offs above which the band's end is motion, not the tail of a faster step
# largest scaled condition number with effects, whose columns may be nearly collinear
EFFECTS_LIMIT = 1e5
EDGE_ROWS = 2  # beside the fitted ones, from which a fraction of a row is read
DERIVATIVES = ("theta", "omega", "alpha", "jerk", "snap")  # of the angle, by their order
RAW_TORQUE = "raw torque"  # column of the torque before the low-pass


@dataclass(frozen=True)
class Sums:
    """Products of q columns in each of m groups; the last one is the filtered `torque`, or behind
    it the `raw torque`, where the record has one.

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
        The products that are fitted: of a motion without what is slower, or `gram`.
    noise : Array (q, q)
        Part of the noise of the angle in the products of a row, which is taken off.
    fast : Array (q, n) or None
        If kept, columns and torques without what is slower than the motion.
    """

    names: tuple[str, ...]
    gram: Array
    groups: Groups
    columns: Mapping[str, Array]
    weighted: Array
    noise: Array
    fast: Array | None = None

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

    @property
    def unfiltered_torque(self) -> str:
        """Name of the torque before the low-pass; a coarse record has the filtered one alone."""
        return RAW_TORQUE if RAW_TORQUE in self.names else "torque"

    def less(self, column: str, size: float) -> "Sums":
        """Those of the torque less `size` times a column."""
        change = np.eye(len(self.names))
        is_torque = np.isin(self.names, ["torque", RAW_TORQUE])
        change[is_torque, self.names.index(column)] = -size
        return replace(
            self,
            gram=change @ self.gram @ change.T,
            weighted=change @ self.weighted @ change.T,
            fast=None,
        )

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


def gram_sums(
    record: Record,
    columns: Mapping[str, Array],
    angle_noise: Array | None = None,
    keep_fast: bool = False,
) -> Sums:
    """Sum the products of columns (n,) and of the record's torque, in each group; with `keep_fast`
    the signals themselves are kept, for parts of the band.

    The noise is read from the raw torque, before the filter.

    Of a motion of the joint, whose `angle_noise` is known, the products that are fitted are without
    what is slower than it, and without that noise. Columns and torque of each run of rows pass the
    same filter: where nothing repeats a high-pass whose corner is the lowest frequency of the
    motion, else they lose their running mean over a period, which is the same all along what
    repeats: it takes off no part of what Eq. 15 misses. Noise of the angle lengthens the columns:
    its part of the products, by the lines of `Record.angle_noise`, is taken off (errors in
    variables; Fuller, Measurement Error Models, 1987).

    Raises
    ------
    InputError
        A column cannot be measured.
    """
    groups = record.groups
    signals = {**columns, "torque": record.filtered_torque}
    if record.torque is not record.filtered_torque:
        signals[RAW_TORQUE] = record.torque
    for name, row in signals.items():
        check_finite(f"column '{name}'", row, least=SMALLEST_SIGNAL)
    names = tuple(signals)
    rows = np.array([*signals.values()])
    gram = products_between(rows.T, rows.T, groups.first, groups.stop)
    if angle_noise is None:
        return Sums(names, gram, groups, columns, weighted=gram, noise=np.zeros_like(gram[0]))
    fast = fast_signals(record, names, rows)
    weighted, noise = fitted_products(names, fast, record, angle_noise)
    kept = fast if keep_fast else None
    return Sums(names, gram, groups, columns, weighted, noise, kept)


def fast_signals(record: Record, names: Sequence[str], signals: Array) -> Array:
    """Columns, filtered and raw torque (q, n) with these names without what is slower than the
    motion, as `gram_sums` says."""
    slow_hz = record.band_hz[0]
    groups = record.groups
    # a part of a period that was recorded once belongs to the period
    repeat = groups.repeat() | (groups.kind == "periods")
    fast = signals.copy()
    n = len(record.time)
    # a fraction of a row at the ends of a run is read from the rows beside it
    for first, stop in run_edges(groups.cover(~repeat, n, EDGE_ROWS)):
        rows = slice(first, stop)
        fast[:, rows] = without_slower(signals[:, rows], slow_hz / record.rate_hz)
    alike = [(repeat, slow_hz)]  # all periods, or the cycles of each sine
    if record.periodic:
        alike = [(repeat, 1 / record.periodic.period)]
    elif groups.kind == "cycles":
        sines_hz = enumerate(stratum.frequency_hz for stratum in groups.strata)
        alike = [(repeat & (groups.stratum == number), hz) for number, hz in sines_hz]
    # offset and drift are left, which tell what is left of the torque's
    moves = ~np.isin(names, ["one", "ramp"])
    for is_alike, hz in alike:
        for first, stop in run_edges(groups.cover(is_alike, n, EDGE_ROWS)):
            rows = slice(first, stop)
            fast[moves, rows] -= running_mean(signals[moves, rows], record.rate_hz / hz)
    return fast


def without_slower(signals: Array, slow: float) -> Array:
    """Signals (q, n) without what is slower than `slow` [cycles per row] (band-spectrum regression;
    Engle, Int. Econ. Review 15, 1974)."""
    return with_gain(signals, lambda frequency: high_pass_gain(frequency, slow))


def with_gain(signals: Array, gain: Callable[[Array], Array]) -> Array:
    """Filter signals (q, n) without phase: the lines of their discrete cosine transform times a
    gain at their frequencies [cycles per row].

    The signals are continued to a fast length by the mirror image that the transform has there:
    other lengths take up to 18 times as long.
    """
    n = signals.shape[1]
    rows = scipy.fft.next_fast_len(n, real=True)
    continued = np.pad(signals, ((0, 0), (0, rows - n)), "symmetric")
    lines = scipy.fft.dct(continued, overwrite_x=True)
    frequency = np.arange(rows) / (2 * rows)
    # a constant has this line alone: whatever gain it gets, offset and estimates are the same
    frequency[0] = frequency[1] / 4
    lines *= gain(frequency)
    return scipy.fft.idct(lines, overwrite_x=True)[:, :n]


def running_mean(signals: Array, period: float) -> Array:
    """Means of signals (q, n) over a period [rows] about each row, or the nearest that lies within
    the rows."""
    n = signals.shape[1]
    length = min(period, n)
    # of all rows before an edge; one more behind the last edge, so that each has a next one
    sums = np.zeros((len(signals), n + 2))
    np.cumsum(signals, axis=1, out=sums[:, 1:-1])
    sums[:, -1] = sums[:, -2]

    def sums_before(edge: float, count: int) -> Array:
        """Sums (q, count) before an edge, which may be within a row, and before those that are 1,
        2 … rows further. Slices of them take a tenth of the time of single edges."""
        row = int(edge)
        whole_rows = sums[:, row : row + count]
        with_next_row = sums[:, row + 1 : row + 1 + count]
        return whole_rows + (edge - row) * (with_next_row - whole_rows)

    half = (length - 1) / 2
    near_end = int(np.ceil(half))  # rows about which a period would begin before the first one
    n_inside = n - 2 * near_end
    means = np.empty(signals.shape)
    inside = means[:, near_end : n - near_end]
    inside[:] = sums_before(near_end + half + 1, n_inside)
    inside -= sums_before(near_end - half, n_inside)
    means[:, :near_end] = sums_before(length, 1)
    means[:, n - near_end :] = sums_before(n, 1) - sums_before(n - length, 1)
    return means / length


def high_pass_gain(frequency: Array, slow: float) -> Array:
    """Gain (n,) at frequencies (n,) above 0, of which the power falls as that of a person's lean
    rises: with the fourth power below `slow`.

    With 1, 1/2 and 1/4 of a motion's lowest frequency a lean leaves intervals of 0.3, 0.4 and 0.5 %
    of K (benchmarks/interval_coverage.py, seeds from 100), and a hardening spring errors of 0.35,
    0.19 and 0.14 of what benchmarks/peers calls off (24 seeds): a person leans on most benches, so
    it is 1.
    """
    return (1 + (slow / frequency) ** 4) ** -0.5


def fitted_products(
    names: Sequence[str], signals: Array, record: Record, angle_noise: Array
) -> tuple[Array, Array]:
    """Products (m, q, q) of signals (q, n) in each group, and what noise of the angle makes of
    those of a row (q, q), which is taken off.
    """
    groups = record.groups
    frequency_hz, power = angle_noise
    gain = record.settings.low_pass.gain(frequency_hz)
    if not groups.repeat().any():
        gain *= high_pass_gain(frequency_hz, record.band_hz[0])
    noise = noise_products(names, frequency_hz, power * gain**2)

    products = products_between(signals.T, signals.T, groups.first, groups.stop)
    products -= (groups.stop - groups.first)[:, None, None] * noise
    return products, noise


def noise_products(names: Sequence[str], frequency_hz: Array, power: Array) -> Array:
    """Mean products (q, q) of what noise of the angle makes of the columns with these names, by the
    frequencies (k,) and powers (k,) [rad^2] of its lines.

    The a-th and the b-th derivative of a line have the amplitudes (i w)^a and (i w)^b. The real
    part of the one times the conjugate of the other is i^(a - b) w^(a + b), or 0 where a - b is
    odd.
    """
    products = np.zeros((len(names), len(names)))
    orders = {name: order for order, name in enumerate(DERIVATIVES) if name in names}
    for first, a in orders.items():
        for second, b in orders.items():
            if (a - b) % 2 == 0:
                sign = (-1) ** ((a - b) // 2)
                moment = power @ (2 * np.pi * frequency_hz) ** (a + b)
                products[names.index(first), names.index(second)] = sign * moment
    return products


def friction_column(omega: Array, record: Record, width: float = SIGN_WIDTH) -> Array:
    """Torque (n,) of a Coulomb friction of 1 N*m at velocities (n,) [rad/s], behind the filter."""
    return record.settings.low_pass(np.tanh(omega / width), record.rate_hz)


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


def sums_of(record: Record, expected: Stiffness | None = None, width: float = SIGN_WIDTH) -> Sums:
    """The sums of the models' columns and of all effects in a coarse record. `expected` is the
    linear model's dynamic stiffness, if the gains are known; `width` that of the velocity [rad/s]
    over which friction `T_C` changes its sign."""
    coarse = record.coarse
    columns = columns_of(coarse)
    higher = seven_point_motion(columns["alpha"], coarse.rate_hz)
    columns["jerk"] = higher.omega
    columns["snap"] = higher.alpha
    low_pass = record.settings.low_pass
    highest_hz = record.band_hz[1]
    omega = record.motion.omega
    if highest_hz > BEYOND * low_pass.cutoff_hz:
        # the sign of a slower signal changes at other times
        swift = replace(low_pass, cutoff_hz=min(2 * highest_hz, HIGHEST_CUTOFF * record.rate_hz))
        omega = np.gradient(swift(record.theta, record.rate_hz), 1 / record.rate_hz)
    step = round(record.rate_hz / coarse.rate_hz)
    # at the recorded rate, at which the sign changes within fewer rows
    columns["T_C"] = friction_column(omega, record, width)[::step]
    if expected is not None:
        columns["linear"] = linear_torque(
            expected, columns["theta"], coarse.rate_hz, 3 * low_pass.cutoff_hz
        )
    return gram_sums(coarse, columns, record.angle_noise, keep_fast=True)


def least_squares(s: Sums, model: Model, limit: float = CONDITION_LIMIT) -> LinearFit:
    """Fit the torque by least squares (Eq. 15), with the interval of repeats or of blocks. Each
    part of a period counts once, however often it was recorded: K, B and I of a leg are those of
    whole periods.

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
    # estimates: normal equations A x = b of all groups g together
    columns = list(model.values())
    products = s.products(s.weighted, [*columns, "torque", s.unfiltered_torque])
    share = np.ones((len(products), 1, 1))
    if s.groups.kind == "periods":  # each part of the period counts once
        share /= np.bincount(s.groups.stratum)[s.groups.stratum][:, None, None]
    products *= share
    A_g = products[:, :-2, :-2]
    b_g = products[:, :-2, -2]
    A = A_g.sum(axis=0)
    b = b_g.sum(axis=0)
    varies = [k for k, column in enumerate(columns) if column != "one"]
    rows_of_groups = s.groups.stop - s.groups.first
    places = np.ix_(*2 * [[s.names.index(column) for column in columns]])
    noise_of_angle = (share[:, 0, 0] @ rows_of_groups) * s.noise[places]
    estimates, inverse = solved(A, b, tuple(model), varies, limit, noise_of_angle)

    # their scatter: of what repeats, or of fits without a group each
    repeat = s.groups.repeat()
    if repeat.any():
        # of the raw torque: before the low-pass, noise is independent from row to row
        raw_g = products[:, :-2, -1]
        noise_g = (raw_g - A_g @ estimates) @ inverse
        covariance, freedom = between_cycles(noise_g[repeat], s.groups.stratum[repeat])
        # a group that repeats no other, as the one settled cycle of a sine, is taken to scatter as
        # the others do: by its share in what white noise of the torque does to each estimate
        noise = share * A_g  # what counts by 1/m scatters by 1/m^2
        of_repeats = inverse @ noise[repeat].sum(axis=0) @ inverse
        more = np.sqrt(np.diag(inverse @ noise.sum(axis=0) @ inverse) / np.diag(of_repeats))
        covariance *= np.outer(more, more)
    else:
        covariance, freedom = left_out(A, b, A_g, b_g)

    # offset and drift anew, from what the other columns leave of the torque: what is slower than
    # the motion tells them, and hardly counts above. No table has their covariance
    sums = s.products(s.gram, [*columns, "torque", "one"]).sum(axis=0)
    is_slow = np.isin(columns, ["one", "ramp"])
    of_slow = sums[:-2][is_slow]
    A_slow = of_slow[:, :-2]
    left = of_slow[:, -2] - A_slow[:, ~is_slow] @ estimates[~is_slow]
    estimates[is_slow], _ = solved(A_slow[:, is_slow], left)

    # VAF, with an own offset, from the covariance of columns and torque
    means = sums / sums[-1, -1]
    moments = means[:-1, :-1] - np.outer(means[-1, :-1], means[-1, :-1])
    weights = np.append(-estimates, 1.0)
    unexplained = max(weights @ moments @ weights, 0.0)
    return LinearFit(
        names=tuple(model),
        estimates=estimates,
        covariance=covariance,
        vaf=vaf_by_moments(unexplained, moments[-1, -1], means[-2, -2]),
        interval_method="repeats" if repeat.any() else "blocks",
        degrees_of_freedom=freedom,
    )


def with_effects(s: Sums, model: Model, *effects: str) -> LinearFit:
    """Fit of a model with the columns of effects. Raises as `least_squares`."""
    with_columns = {**model, **{name: name for name in effects}}
    return least_squares(s, with_columns, EFFECTS_LIMIT)
