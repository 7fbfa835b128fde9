"""What changes while a trial is recorded: the stiffness, as by warming up, and the clocks of two devices.

Each frequency is measured at another time. A stiffness that falls meanwhile looks like inertia: K - I w^2 falls with w.
If K falls by 1 %, I of an ankle rises by 4 %, forty standard errors, and every other number of the fit looks sound; in
a sweep, 5 % make half of I.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import uniform_filter1d
from scipy.special import fdtri, stdtrit

from osl_analysis.bench.lag import LITTLE_INERTIA, MOST, ONLY_NOISE, noise_behind
from osl_analysis.bench.moving_record import MovingRecord, eq15_columns
from osl_analysis.bench.segments import Segment
from osl_analysis.errors import InputError, OslAnalysisError
from osl_analysis.spectral.realisations import PeriodicMotion, lines_of
from osl_analysis.stats.covariance import FEWEST_CYCLES, ResidualCorrelation, products_between
from osl_analysis.stats.fit_row import Row
from osl_analysis.stats.regression import LinearFit, linear_fit
from osl_analysis.timebase.drift import ClockDrift, check_drift, chunked_slope, drift_row
from osl_analysis.trial import Array

CERTAIN = 0.999
"""Probability that the estimate of a constant stiffness is below the part of a change that counts as noise."""
PASSES = 0.99  # probability that a joint of Eq. 15 is taken as one.
UNTOLD = 0.1  # share of I that an unseen change of K may make, from which it is not known whether K changes
OF_DRIFT = ("K_drift", "drift_inertia_share")  # columns of a change of K, null where it cannot be told


def stiffness_of_cycles(theta: Array, torque: Array, segments: Sequence[Segment]) -> dict[Segment, Array]:
    """Middle [samples], torque in phase over angle [N*m/rad] and weight of each used cycle, (3, m), of each segment.
    `theta` [rad] and `torque` [N*m], shape (n,), are the filtered signals, without the load cell's drift. In whole
    cycles of a sine the torque in phase with the angle is K - I w^2."""
    first, end = (np.concatenate([segment.edges[segment.used + k] for segment in segments]) for k in (0, 1))
    begin, stop = int(np.min(first)), int(np.max(end)) + 2
    x, y = theta[begin:stop], torque[begin:stop]
    nowhere = np.zeros(2 * len(first), dtype=np.intp)
    sums = products_between(np.array([x, np.ones_like(x)]).T, np.array([x, y]).T, first - begin, end - begin, nowhere)
    (squares, products), (angles, torques) = np.moveaxis(sums, 0, 2)
    squares -= angles**2 / (end - first)
    products -= angles * torques / (end - first)
    ends = np.cumsum([len(segment.used) for segment in segments])[:-1]
    found = np.split(np.array([(first + end) / 2, products / squares, squares]), ends, axis=1)
    return dict(zip(segments, found, strict=True))


def stiffness_drift_row(stiffness: Mapping[Segment, Array], segments: Sequence[Segment], fit: LinearFit) -> Row:
    """`K_drift`, the change of K over the cycles of the segments as a share of K, and `drift_inertia_share`, of I.
    `stiffness` is that of their cycles (`stiffness_of_cycles`), `fit` that of Eq. 15. Both are what is beyond the noise
    of a constant stiffness, 0 if nothing is. Null where noise hides a change that would spoil I."""
    cycles = Cycles.of(stiffness, segments)
    slope = stiffness_slope(cycles)
    if slope is None:
        return dict.fromkeys(OF_DRIFT)
    taken = cycles.taken_for_inertia() / float(np.hypot(fit["I"], LITTLE_INERTIA))
    noise = float(stdtrit(slope.degrees_of_freedom, CERTAIN)) * slope.se
    if abs(slope.change) <= noise:
        unknown = taken * noise > UNTOLD
        return dict.fromkeys(OF_DRIFT, None if unknown else 0.0)
    beyond = float(np.sign(slope.change)) * (abs(slope.change) - noise)
    return {"K_drift": beyond / fit["K"], "drift_inertia_share": taken * abs(slope.change)}


@dataclass(frozen=True)
class Cycles:
    """Cycles of some segments, shape (n,) each."""

    kind: NDArray[np.intp]  # number of their amplitude and frequency
    curvature: Array  # angular acceleration over angle, -w^2 [rad^2/s^2]
    when: Array  # time from the first cycle, as a share of that to the last
    stiffness: Array  # torque in phase over angle [N*m/rad]
    weight: Array  # sum of the squares of the angle

    @classmethod
    def of(cls, stiffness: Mapping[Segment, Array], segments: Sequence[Segment]) -> "Cycles":
        """The used cycles of the segments, by their `stiffness` (`stiffness_of_cycles`)."""
        kinds = [(segment.amplitude, segment.frequency_hz) for segment in segments]
        number = {kind: k for k, kind in enumerate(dict.fromkeys(kinds))}
        lengths = [stiffness[segment].shape[1] for segment in segments]
        kind = np.repeat([number[kind] for kind in kinds], lengths)
        frequency = np.repeat([frequency for _, frequency in kinds], lengths)
        when, in_phase, weight = np.concatenate([stiffness[segment] for segment in segments], axis=1)
        share = (when - when.min()) / max(np.ptp(when), 1.0)
        return cls(kind, -((2 * np.pi * frequency) ** 2), share, in_phase, weight)

    def chosen(self, cycles: NDArray[np.bool_]) -> "Cycles":
        return Cycles(*(getattr(self, field.name)[cycles] for field in fields(self)))

    def of_kinds(self) -> Array:
        """Columns (n, kinds) of a stiffness of each amplitude and frequency."""
        return np.asarray(self.kind[:, None] == np.unique(self.kind), dtype=np.float64)

    def of_second_order(self) -> Array:
        """Columns (n, 2) of the stiffness in phase of Eq. 15, K - I w^2."""
        return np.stack([np.ones_like(self.curvature), self.curvature], axis=1)

    def taken_for_inertia(self) -> float:
        """Inertia [kg*m^2] as which Eq. 15 takes a stiffness that rises by 1 N*m/rad over the cycles."""
        root = np.sqrt(self.weight)
        return abs(float(np.linalg.lstsq(root[:, None] * self.of_second_order(), root * self.when)[0][1]))


@dataclass(frozen=True)
class Slope:
    """A change [N*m/rad] of stiffness from the first cycle to the last, beside other columns, and its error."""

    change: float
    squares: float  # weighted sum of the squares of what the fit leaves
    degrees_of_freedom: int
    spread: float  # weighted sum of the squares of the time beside the other columns

    @property
    def variance(self) -> float:
        """Variance of what the fit leaves, of a cycle of weight 1."""
        return self.squares / self.degrees_of_freedom

    @property
    def se(self) -> float:
        """Standard error [N*m/rad] of the change."""
        return float(np.sqrt(self.variance / self.spread))


def slope_beside(cycles: Cycles, columns: Array) -> Slope | None:
    """The slope of the stiffness over time beside columns (n, m); None if the cycles are too few to know its error."""
    degrees_of_freedom = len(cycles.when) - columns.shape[1] - 1
    if degrees_of_freedom < FEWEST_CYCLES:
        return None
    root = np.sqrt(cycles.weight)[:, None]
    both = root * np.stack([cycles.when, cycles.stiffness], axis=1)
    both -= root * columns @ np.linalg.lstsq(root * columns, both)[0]
    spread = float(both[:, 0] @ both[:, 0])
    change = float(both[:, 0] @ both[:, 1]) / spread
    return Slope(change, float(np.sum((both[:, 1] - change * both[:, 0]) ** 2)), degrees_of_freedom, spread)


def stiffness_slope(cycles: Cycles) -> Slope | None:
    """The slope of the stiffness over time; None if the cycles do not tell it.

    Cycles of one amplitude at one frequency differ by what K changes alone, wherever in the recording they are. Where
    Eq. 15 with a changing K explains all others, too, but for the noise of cycles, the change from one frequency to the
    next tells much more. An F test decides. Friction, and whatever else Eq. 15 misses, fails it.
    """
    own, common = (slope_beside(cycles, columns) for columns in (cycles.of_kinds(), cycles.of_second_order()))
    if own and common:
        more = common.degrees_of_freedom - own.degrees_of_freedom
        if more > 0 and common.squares - own.squares < more * own.variance * fdtri(
            more, own.degrees_of_freedom, PASSES
        ):
            return common
    many = cycles.chosen(np.bincount(cycles.kind)[cycles.kind] >= FEWEST_CYCLES)
    return slope_beside(many, many.of_kinds())


KEPT = 4  # samples that are kept in half a period of the cut-off: 120 Hz at 15 Hz. The signals have nothing faster.
SHOWS_S = 2.0  # time [s] over which the size and the frequency of a motion are taken
LEAST_MOTION = 0.1  # share of the RMS angle, below which a motion is too small to have a frequency
CERTAIN_BESIDE_MISFIT = 5.0
"""Standard errors from which a change counts where Eq. 15 does not explain the rest: they know little of friction."""
KeptColumns = Mapping[str, Array]  # columns (m,) of a fit by name


@dataclass(frozen=True)
class RecordDrift:
    """Change of the stiffness from the first to the last row that is fitted."""

    change: float  # change [N*m/rad] beyond what noise can make of a constant stiffness; 0 if it is no more
    inertia_share: float  # share of I that a certain change makes; 0 if none is certain


def record_drift(record: MovingRecord) -> RecordDrift | None:
    """The change of K; None where it cannot be told from noise, or from the way in which K depends on the motion.

    A joint that Eq. 15 with a changing K explains, but for noise or for the better part of the rest, has the
    change of that fit. The stiffness of any other one depends on the frequency and the size of its motion. A change
    counts there only beyond what these explain. A single sweep has nothing beyond: its frequency is its time.
    """
    columns, torque = thinned(record)
    residuals = ResidualCorrelation(every=KEPT)
    try:
        plain, changing = (linear_fit(torque, columns | more, residuals) for more in ({}, in_time(columns)))
        noise = ONLY_NOISE * noise_behind(record, record.low_pass)
        explains = float(np.std(changing.residual)) < max(noise, MOST * float(np.std(plain.residual)))
        if not explains:
            more = in_time(columns) | beside_motion(record, columns)
            changing = linear_fit(torque, columns | more, residuals)
    except OslAnalysisError:
        return None
    dof = float(changing.degrees_of_freedom[changing.names.index("K_1")])
    errors = max(float(stdtrit(dof, CERTAIN)), 0.0 if explains else CERTAIN_BESIDE_MISFIT)
    change, noise = changing["K_1"], errors * changing.se("K_1")
    taken = linear_fit(in_time(columns)["K_1"], columns, residuals)["I"] / float(np.hypot(plain["I"], LITTLE_INERTIA))
    if abs(change) > noise:
        return RecordDrift(float(np.sign(change)) * (abs(change) - noise), abs(taken * change))
    return None if abs(taken) * noise > UNTOLD else RecordDrift(0.0, 0.0)


def every(record: MovingRecord) -> int:
    """Rows of the record of which one is kept."""
    return max(record.low_pass.independent_samples(record.rate_hz) // KEPT, 1)


def thinned(record: MovingRecord) -> tuple[dict[str, Array], Array]:
    """The columns (m,) of Eq. 15 with offset and drift in the kept rows, and the filtered torque (m,) [N*m] there."""
    step = every(record)
    columns = {name: record.part(column)[::step] for name, column in eq15_columns(record).items()}
    columns["drift"] = columns["drift"] - columns["drift"].mean()
    return columns, record.part(record.filtered_torque)[::step]


def in_time(columns: KeptColumns) -> dict[str, Array]:
    """The column of K's change from the first kept row to the last: the angle times the time's share, from its mean."""
    time = columns["drift"]
    return {"K_1": columns["K"] * time / np.ptp(time)}


def beside_motion(record: MovingRecord, columns: KeptColumns) -> dict[str, Array]:
    """The columns of a K that depends on the size, and on the frequency, of the motion within seconds around a row."""
    step = every(record)
    rows, theta = record.rows[::step], record.motion.theta[::step]
    omega = record.motion.omega[::step]
    length = max(round(SHOWS_S * record.rate_hz / step), 1)
    angle, velocity = (
        np.sqrt(np.maximum(uniform_filter1d(x**2, length), 0.0))[np.minimum(rows // step, len(x) - 1)]
        for x in (theta - columns["K"].mean(), omega)
    )
    frequency = velocity / np.maximum(angle, LEAST_MOTION * np.std(columns["K"]))
    return {name: columns["K"] * (x - x.mean()) for name, x in (("K_size", angle), ("K_frequency", frequency))}


def record_drift_row(record: MovingRecord, fit: LinearFit) -> Row:
    """`K_drift`, the change as a share of K, and `drift_inertia_share`, the share of I that a certain change makes.
    Null where it cannot be told. `fit` is that of Eq. 15."""
    found = record_drift(record)
    if found is None:
        return dict.fromkeys(OF_DRIFT)
    return {"K_drift": found.change / fit["K"], "drift_inertia_share": found.inertia_share}


def record_clock_row(record: MovingRecord) -> Row:
    """As `clock_drift_row`; all null where one device recorded both, or the motion does not show a drift."""
    drift = drift_between(record)
    try:
        if drift is not None:
            check_drift(drift, record.largest_drift_ppm)
    except InputError as error:
        raise InputError(f"trial {record.name}: {error}") from error
    return drift_row(drift)


def drift_between(record: MovingRecord) -> ClockDrift | None:
    """The drift of the torque's clock against the angle's; None where the record does not show it. A motion that
    repeats itself shows it whatever the joint is. Any other one does so only for a joint of second order: what is left
    of another one changes with the motion, and would pass for tens of ppm in a sweep."""
    if record.uniform.one_device("theta", "torque"):
        return None
    found = drift_beside_impedance(record) if record.periodic is None else drift_of_periods(record.periodic)
    return found if found is not None and np.isfinite(found.se) else None


def drift_of_periods(motion: PeriodicMotion) -> ClockDrift | None:
    """The drift from the phases of torque over angle, which turn from period to period by -2 pi f times the lag."""
    x, y, w = [], [], []
    at = np.flatnonzero(lines_of(motion.realisations).excited)
    for one in motion.realisations:
        ratio = one.torque[:, at] / one.theta[:, at]
        mean = ratio.mean(axis=0)
        elapsed = (np.arange(one.periods) - (one.periods - 1) / 2) * one.period
        x.append(-2 * np.pi * elapsed[:, None] * one.frequency_hz[at])
        y.append(np.angle(ratio / mean))
        w.append(np.broadcast_to(np.abs(one.torque[:, at].mean(axis=0)), ratio.shape))
    weight = np.concatenate([part.ravel() for part in w])
    slope, se = chunked_slope(*(weight * np.concatenate([part.ravel() for part in each]) for each in (x, y)))
    return ClockDrift(1e6 * slope, 1e6 * se)


def drift_beside_impedance(record: MovingRecord) -> ClockDrift | None:
    """The drift from what a torque that gets later and later adds, beside Eq. 15, a lag, and a change of K. None where
    this leaves more than the noise."""
    step = max(record.low_pass.independent_samples(record.rate_hz) // 4, 1)
    motion, slope = record.motion, np.gradient(record.filtered_torque, record.time)
    signals = motion.theta, motion.omega, motion.alpha, slope, record.time, record.filtered_torque
    theta, omega, alpha, slope, time, torque = (record.part(signal)[::step] for signal in signals)
    late = time - time.mean()
    X = np.column_stack([theta, omega, alpha, slope, late, late * theta, np.ones_like(late)])
    Q, _ = np.linalg.qr(X / np.linalg.norm(X, axis=0))
    both = np.stack([-late * slope, torque], axis=1)
    rest = both - Q @ (Q.T @ both)
    slope_of_drift, se = chunked_slope(rest[:, 0], rest[:, 1])
    left = float(np.std(rest[:, 1] - slope_of_drift * rest[:, 0]))
    if left >= ONLY_NOISE * noise_behind(record, record.low_pass):
        return None
    return ClockDrift(1e6 * slope_of_drift, 1e6 * se)
