# SPDX-License-Identifier: Apache-2.0
"""Eq. 15 fitted to a record, or another model of the bench: to each amplitude and to all of it,
with the stated errors of the bench and those of the encoder's steps."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import scipy
from numpy.typing import NDArray

from osl_analysis.base.errors import IdentifiabilityError, InputError, naming
from osl_analysis.base.measured import UNIFORM_WIDTH
from osl_analysis.base.trial import Array
from osl_analysis.bench.bench_settings import NOT_STATED, Calibration
from osl_analysis.bench.record import STIFFNESS_ALONE, Groups, Label, Record
from osl_analysis.bench.regression import (
    DERIVATIVES,
    EDGE_ROWS,
    IMPEDANCE,
    SLOW,
    Model,
    Sums,
    columns_of,
    fitted_products,
    friction_column,
    gram_sums,
    least_squares,
    sums_of,
    with_gain,
)
from osl_analysis.inference.rounding_errors import repeated_share
from osl_analysis.inference.spectra import noise_and_band
from osl_analysis.signals.filters import LowPass, run_edges, seven_point_motion
from osl_analysis.stats.budget import QUANTITIES, Budget, Row
from osl_analysis.stats.linear_fit import LinearFit, solved
from osl_analysis.stats.sources import Source

# columns in proportion to the angle; a sine is, but for a tenth at 45 deg
OF_ANGLE = ("theta", "omega", "alpha", "B_m", "J_m", "sine")
SAME_FREQUENCY_RATIO = 1.02  # ratio of frequencies below which noise alone would tell K from I
FEWEST_ENCODER_STEPS = 20.0  # of the encoder; of fewer, rounding is no noise but part of the motion
# of the power of the acceleration's own part that may be noise of the encoder
MOST_ENCODER_NOISE = 0.25


@dataclass(frozen=True)
class Analysis:
    """A model fitted to a record: to each label, and to all of it (None).

    Attributes
    ----------
    record, sums, model
        What was fitted.
    fits : Mapping
        By label. Offsets are in the middle of the angle and of the fitted rows.
    label
        Of the fit that stands for the trial.
    other
        The same with the other reading of undecided stamps; None: all are decided.
    effects
        Sums of all effects in the coarse record, where these were fitted.
    """

    record: Record
    sums: Sums
    model: Model
    fits: Mapping[Label, LinearFit]
    label: Label = None
    other: "Analysis | None" = None
    effects: Sums | None = None

    @property
    def whole(self) -> LinearFit:
        return self.fits[self.label]

    def place(self, label: Label) -> Row:
        """Trial and amplitude of a row."""
        commanded = {each.label: each.commanded_deg for each in self.record.groups.strata}
        return {
            "trial": self.record.name,
            "scope": "all" if label is None else "amplitude",
            "amplitude_deg": label if isinstance(label, float) else None,
            "commanded_deg": commanded.get(label),
        }

    def diagnostics(self, label: Label) -> Row:
        """What a row tells of its fit beside the estimates."""
        fit = self.fits[label]
        return {"interval_method": fit.interval_method, "VAF": fit.vaf}

    def budgets(self, label: Label, *names: str) -> dict[str, Budget]:
        """The estimates with what contributes to their uncertainty."""
        return {name: self.calibrated[label].budget(name) for name in names}

    @cached_property
    def calibrated(self) -> Mapping[Label, LinearFit]:
        """The fits with what is stated of the bench in their intervals; comparisons within a trial
        do not include it."""
        return {label: self.with_bench_errors(fit, label) for label, fit in self.fits.items()}

    def with_bench_errors(self, own: LinearFit, label: Label) -> LinearFit:
        """Add what is stated or inferred of the bench to the intervals of a fit: the errors of its
        calibration, its stiffness, its fixture, and of a held channel's delay, to first order.

        Parameters
        ----------
        own
            Of the model, or with friction.
        label
            Whose rows were fitted.
        """
        record = self.record
        settings = record.settings
        is_stated = (
            settings.calibration != NOT_STATED
            or settings.fixture is not None
            or settings.bench_stiffness is not None
        )
        if not is_stated and not record.inferred_delay_error:
            return own
        rows = record.is_fitted(label)
        columns = dict(self.sums.columns)
        if "T_C" in own.names:
            columns["T_C"] = friction_column(record.motion.omega, record)
        of_estimates = [self.model.get(name, name) for name in own.names]
        sizes = own.estimates
        X = np.column_stack([columns[column] for column in of_estimates])
        is_of_angle = np.isin(of_estimates, OF_ANGLE)
        angle_sizes = sizes * is_of_angle

        def passed(angle: Array) -> Array:
            of_frame = vars(seven_point_motion(angle, record.rate_hz))
            still = np.zeros_like(angle)
            return sizes @ np.array([of_frame.get(name, still) for name in of_estimates])

        return with_torque_errors(
            own, X[rows], bench_torques(record, X @ sizes, X @ angle_sizes, passed, rows)
        )

    def modelled(self, label: Label = None) -> Array:
        """Torque (n,) [N*m] of the fit to a label; a label without a fit has that of the fit to
        all."""
        fit = self.fits.get(label, self.whole)
        columns = [self.sums.columns[column] for column in self.model.values()]
        return fit.estimates @ np.array(columns)


def rendered_impedance(record: Record) -> Analysis:
    """Fit Eq. 15 to a record by least squares, for each amplitude and for all.

    Parameters
    ----------
    record
        Angle and torque of a joint.

    Returns
    -------
    Analysis
        torque = K theta + B omega + I alpha + offset + drift (`IMPEDANCE`), by `least_squares`.

    Raises
    ------
    InputError
        The joint hardly moves.
    IdentifiabilityError
        The motion cannot tell K, B and I.
    """
    with naming(f"trial {record.name}"):
        analysis = fit_all_groups(record, IMPEDANCE)
        if record.groups.kind != "cycles":
            check_encoder(analysis)
        return analysis


def fit_all_groups(record: Record, model: Model, sums: Sums | None = None) -> Analysis:
    """Fit a model to all of a record and to each label that determines it.

    Parameters
    ----------
    record
        Signals and groups.
    model
        The column of each estimate.
    sums
        Those of the record, by default of the columns of Eq. 15.

    Raises
    ------
    IdentifiabilityError
        As `least_squares`.
    """
    effects = None
    if sums is None:
        columns = columns_of(record)
        if is_fitted_coarse(record):
            effects = sums_of(record)
            sums = replace(effects, columns=columns, fast=None)
        else:
            sums = gram_sums(record, columns, record.angle_noise)
    tells_K_from_I = {"theta", "alpha"} <= set(model.values())
    fits = {}
    strata = sums.groups.strata
    for label in dict.fromkeys((*(stratum.label for stratum in strata), None)):
        hz = [each.frequency_hz for each in strata if label in (None, each.label)]
        try:
            if tells_K_from_I and max(hz) < SAME_FREQUENCY_RATIO * min(hz):
                raise IdentifiabilityError(
                    f"K and I cannot be told apart: the sines are of {hz[0]:.3g} Hz alone, and"
                    " at one frequency K - I w^2 is one number",
                    f"excite it below {hz[0] / 2:.2g} Hz or from {2 * hz[0]:.2g} Hz as well,"
                    f" {STIFFNESS_ALONE}",
                )
            fits[label] = least_squares(sums.chosen(sums.groups.of(label)), model)
        except IdentifiabilityError:  # a drive may reach fewer frequencies at one amplitude
            if label is None:
                raise
    if not set(DERIVATIVES).isdisjoint(model.values()):
        step = round(record.rate_hz / record.coarse.rate_hz)
        columns = {name: column[::step] for name, column in sums.columns.items()}
        fits = with_encoder_errors(record, columns, model, fits)
    other = record.with_other_stamps
    others = fit_all_groups(other, model) if other is not None else None
    return Analysis(record, sums, model, fits, other=others, effects=effects)


def is_fitted_coarse(record: Record) -> bool:
    """Whether the fit takes the sums of the coarse record, with all effects.

    They move estimates of a motion that does not repeat itself by about a hundredth of their
    half-widths at most, and are made once for fit, friction and range. The scatter of what repeats
    is that of the raw torque, whose noise is independent from row to row: it needs the recorded
    rate.
    """
    return record.groups.kind == "blocks" and record.coarse is not record


def bench_torques(
    record: Record,
    modelled: Array,
    of_angle: Array,
    passed: Callable[[Array], Array],
    rows: NDArray[np.bool_ | np.intp],
) -> list[tuple[Source, Array]]:
    """Errors of the torque (n,) [N*m] by one standard uncertainty of what is stated of the bench,
    or of a delay that a held channel's beat tells, with their sources, in the fitted rows.

    Parameters
    ----------
    record
        What was recorded.
    modelled, of_angle
        Torque (n,) of the model, and the part that is in proportion to the angle [N*m].
    passed
        Torque of the model for an angle (n,) [rad].
    rows
        Which are fitted.
    """
    stated = record.settings.calibration
    fixture = record.settings.fixture
    bench = record.settings.bench_stiffness
    motion = record.motion
    hysteresis, delay = torque_errors(record.filtered_torque, record.rate_hz, rows, stated)
    torques = [
        (Source.TORQUE_GAIN, stated.torque * modelled),
        (Source.ANGLE_GAIN, stated.angle_gain * of_angle),
        (Source.HYSTERESIS, hysteresis),
        (Source.DELAY, delay),
    ]
    if record.inferred_delay_error:
        slope = np.gradient(record.filtered_torque, 1 / record.rate_hz)
        torques.append((Source.HELD_DELAY, record.inferred_delay_error * slope))
    if fixture is not None:
        from_rest = motion.theta - np.deg2rad(fixture.rest_deg)
        of_rest = fixture.weight * np.deg2rad(fixture.rest_error_deg)
        torques += [
            (Source.FIXTURE, fixture.inertia_error * motion.alpha),
            (Source.FIXTURE, fixture.weight_error * np.sin(from_rest)),
            (Source.FIXTURE, of_rest * np.cos(from_rest)),
        ]
    if bench is not None:
        # a frame that yields more turns the joint by so much less
        torques.append(
            (Source.BENCH_STIFFNESS, passed(bench.compliance_error * record.filtered_torque))
        )
    return [(source, error[rows]) for source, error in torques]


def with_torque_errors(
    fit: LinearFit, X: Array, torques: Sequence[tuple[Source, Array]]
) -> LinearFit:
    """Add errors of the torque (n,), with their sources, to the fit of columns X (n, p)."""
    for source, error in torques:
        change, _ = solved(X.T @ X, X.T @ error)
        fit = fit.with_known_error(source, change)
    return fit


def torque_errors(
    torque: Array, rate_hz: float, rows: NDArray[np.bool_ | np.intp], stated: Calibration
) -> Array:
    """Errors of a smooth torque (n,) [N*m] by one standard uncertainty of the load cell's
    hysteresis and of its delay, (2, n). The loop has the width for the range in `rows` everywhere,
    which is a bound."""
    rate = np.gradient(torque, 1 / rate_hz)
    return np.array([stated.slip * np.ptp(torque[rows]) * np.sign(rate), stated.delay * rate])


def check_encoder(analysis: Analysis) -> None:
    """Refuse a motion that the encoder does not resolve: with a few of its steps rounding is no
    noise, but part of the motion.

    Raises
    ------
    InputError
        The joint hardly moves.
    IdentifiabilityError
        The acceleration is mostly noise of the encoder.
    """
    record = analysis.record
    moved = np.ptp(record.theta[record.is_fitted()])
    if moved < FEWEST_ENCODER_STEPS * record.encoder_step:
        raise InputError(
            f"the joint hardly moves: theta turns by {moved / record.encoder_step:.0f} steps of"
            f" its encoder, {FEWEST_ENCODER_STEPS:g} are needed",
            "move it by more, and check the unit of theta in the source file",
        )
    covariance = analysis.sums.covariance(["theta", "omega", "alpha"])
    own_alpha = 1 / np.linalg.inv(covariance)[2, 2]
    noise_share = analysis.sums.noise[2, 2] / own_alpha
    if noise_share > MOST_ENCODER_NOISE:
        low_hz, high_hz = record.band_hz
        raise IdentifiabilityError(
            f"a motion of {low_hz:.2g} to {high_hz:.2g} Hz cannot tell K from I: noise of the"
            f" encoder has {noise_share:.2g} times the power of the acceleration's own part"
            f" behind the filter, at most {MOST_ENCODER_NOISE:g} is allowed",
            "move the joint by more or faster, by 0.5 to 6 Hz, and check the unit of theta in"
            f" the source file, {STIFFNESS_ALONE}",
        )


def with_encoder_errors(
    record: Record,
    columns: Mapping[str, Array],
    model: Model,
    fits: Mapping[Label, LinearFit],
) -> dict[Label, LinearFit]:
    """Add standard errors by the encoder's steps to fits, which no scatter shows where a motion
    repeats itself.

    At rest a step has one error, of variance step^2/12, however many samples show it; where the
    joint returns to the same ones, as under binary steps, it does not average out. Where the joint
    passes through a step its error takes all values and averages out.

    An error e of the angle is one of the torque by K e + B e' + I e''. Its product with what a row
    of the torque adds to an estimate, r, is that of e with K r - B r' + I r''. Noise leaves a share
    of what rounding to steps makes of it.

    Parameters
    ----------
    record
        What was recorded.
    columns
        Columns of the model, at the rate of the coarse record.
    model, fits
        What was fitted, by label.
    """
    step = record.encoder_step
    if not step:
        return dict(fits)
    coarse = record.coarse
    each = slice(None, None, round(record.rate_hz / coarse.rate_hz))
    # just beyond the filter a coarse sine has harmonics of its rounding
    noise, _ = noise_and_band(record.theta, record.rate_hz)
    repeated = repeated_share(noise, record.rate_hz, step)
    # a low-pass that does not ring where the joint comes to rest
    smooth_rows = record.rate_hz / (2 * np.pi * record.settings.cutoff_hz)
    smooth_theta = scipy.ndimage.gaussian_filter1d(record.theta, smooth_rows)[each]
    # where in its step the angle lies, as a phase exp(2 pi i theta/step): the rows of a step add up
    # while the joint rests, and cancel where it passes through
    turn = np.exp(2j * np.pi * smooth_theta / step)
    reading = np.rint(record.theta[each] / step).astype(int)
    reading -= reading.min()
    X = np.array([columns[column] for column in model.values()])
    slope = np.gradient(X, 1 / coarse.rate_hz, axis=1)
    bend = np.gradient(slope, 1 / coarse.rate_hz, axis=1)
    found = {}
    for label, fit in fits.items():
        rows = np.flatnonzero(coarse.is_fitted(label))
        fitted = X[:, rows]
        _, inverse = solved(fitted @ fitted.T, np.zeros(len(X)))
        of_columns = dict(zip(model.values(), fit.estimates.tolist(), strict=True))
        stiffness, damping, inertia = (of_columns.get(name, 0.0) for name in DERIVATIVES[:3])
        bent = stiffness * fitted - damping * slope[:, rows] + inertia * bend[:, rows]
        # a row of the record is in one step
        is_in_step = scipy.sparse.csc_array((turn[rows], reading[rows], np.arange(len(rows) + 1)))
        of_steps = is_in_step @ (inverse @ bent).T
        squares = np.sum(np.abs(of_steps) ** 2, axis=0)
        errors = repeated * step / UNIFORM_WIDTH * np.sqrt(squares)
        found[label] = fit.with_known_error(Source.ENCODER, errors)
    return found


# The range of estimates over parts of a motion: what the motion decides, and no noise. A
# joint that is not of second order has another K, B and I at another amplitude or
# frequency. The lowest and the highest of them over the amplitudes, and over the lower
# and the upper part of the band, say how much: the interval, which is that of the same
# motion again, does not.


FEWEST_SINES = 3  # of which two tell K from I in the lower and in the upper part of the band
# of a motion without sines: in half of them blocks of another size still tell all estimates
FEWEST_BLOCKS = 16
# periods of the slowest motion from an end of a run, within which parts of a motion hang on how the
# run goes on beyond its end: in a period the high-pass falls by exp(-4.4). Leaving out 0, 0.5 and 1
# periods, an end of the range of I moves by up to 500, 31 and 0.7 % of itself where three seconds
# more are filtered (six motions of 40 s, 0.6 to 5 Hz, of tests/bench/test_amplitude_changes.py)
REACH_PERIODS = 1.0
LEAST_INNER_SHARE = 0.5  # of the groups; where fewer lie within, all of them are parted


def parts_of(record: Record, sums: Sums) -> Iterator[Sums]:
    """The sums of parts of a motion: of each amplitude, and of both parts of its band.

    Parameters
    ----------
    record : Record
        Whose band is parted.
    sums : Sums
        Of its coarse record.
    """
    groups = sums.groups
    hz = np.array([stratum.frequency_hz for stratum in groups.strata])
    if groups.kind == "cycles":
        labels = {stratum.label for stratum in groups.strata}
        for label in labels:
            own_hz = {each.frequency_hz for each in groups.strata if each.label == label}
            if len(labels) > 1 and len(own_hz) > 1:
                yield sums.chosen(groups.of(label))
        sines_hz = np.unique(hz)
        if len(sines_hz) >= FEWEST_SINES:
            both = len(sines_hz) // 2  # the sine in the middle belongs to both parts
            for part_hz in (sines_hz[: len(sines_hz) - both], sines_hz[both:]):
                yield sums.chosen(np.isin(hz[groups.stratum], part_hz))
        return
    low_hz, high_hz = record.band_hz
    reach = REACH_PERIODS * record.coarse.rate_hz / low_hz
    is_inner = far_from_ends(groups, run_edges(record.coarse.is_fitted()), reach)
    if not is_inner.all():
        sums = with_plain_drift(sums, record)
    inner = sums.chosen(is_inner)
    rows = inner.groups.stop - inner.groups.first
    if len(rows) >= FEWEST_BLOCKS:
        mean_square = inner.products(inner.weighted, ["theta"])[:, 0, 0] / rows
        is_large = mean_square > np.median(mean_square)
        yield inner.chosen(~is_large)
        yield inner.chosen(is_large)
    for part in parts_of_band(record, sums, np.sqrt(low_hz * high_hz)):
        yield part.chosen(is_inner)


def parts_of_band(record: Record, sums: Sums, split_hz: float) -> Iterator[Sums]:
    """The sums below and above a frequency, as those of the whole band without slow torque and
    without the noise of the angle.

    Each run of fitted rows is filtered alone, without phase. A constant torque, as of a load cell
    that is not tared, is then no step at the ends of a run.
    """
    coarse = record.coarse
    fast = sums.fast
    if fast is None:
        raise ValueError("the band is parted of sums that keep their fast signals")
    low_pass = LowPass(split_hz)  # behind which 0.4 % of a motion an octave beyond remains
    # of each part the torque has its own offset and drift
    moves = ~np.isin(sums.names, [*SLOW.values()])
    below = fast.copy()
    above = fast.copy()
    for first, stop in run_edges(coarse.is_fitted(edge=EDGE_ROWS)):
        rows = slice(first, stop)
        slow = with_gain(fast[moves, rows], lambda f: low_pass.gain(f * coarse.rate_hz))
        below[moves, rows] = slow
        above[moves, rows] -= slow
    noise_hz, power = record.angle_noise
    gain_below = low_pass.gain(noise_hz)
    for part, gain in ((below, gain_below), (above, 1 - gain_below)):
        noise = np.array([noise_hz, power * gain**2])
        products, noise_of_row = fitted_products(sums.names, part, coarse, noise)
        yield replace(sums, weighted=products, noise=noise_of_row, fast=None)


def far_from_ends(groups: Groups, runs: NDArray[np.intp], reach: float) -> NDArray[np.bool_]:
    """Which groups (m,) lie further than `reach` [rows] from both ends of their run of rows (k, 2).
    All of them, where these are less than `LEAST_INNER_SHARE`: a short motion has no more."""
    run = np.searchsorted(runs[:, 0], groups.first, side="right") - 1
    begin, end = runs[run].T
    is_inner = (groups.first - begin >= reach) & (end - groups.stop >= reach)
    if is_inner.mean() < LEAST_INNER_SHARE:
        return np.ones_like(is_inner)
    return is_inner


def with_plain_drift(sums: Sums, record: Record) -> Sums:
    """The sums with offset and drift as they are. The high-pass leaves nothing of them far from the
    ends of a run, but what it makes of the ends, which may look like a slow motion."""
    if sums.fast is None:
        raise ValueError("only sums that keep their fast signals can be changed so")
    fast = sums.fast.copy()
    for name in SLOW.values():
        fast[sums.names.index(name)] = sums.columns[name]
    products, noise = fitted_products(sums.names, fast, record.coarse, record.angle_noise)
    return replace(sums, weighted=products, noise=noise, fast=fast)


def range_over(parts: Sequence[Sums], *reported: LinearFit) -> dict[str, tuple[float, float]]:
    """The lowest and the highest K, B and I of parts of a motion and of the fits that are
    `reported`, to all of it and to its amplitudes; empty where no part tells them."""
    fits = []
    for part in parts:
        with suppress(IdentifiabilityError):
            fits.append(least_squares(part, IMPEDANCE))
    if not fits:
        return {}
    fits.extend(reported)
    values = {name: [each[name] for each in fits] for name in QUANTITIES}
    return {name: (min(of_fits), max(of_fits)) for name, of_fits in values.items()}
