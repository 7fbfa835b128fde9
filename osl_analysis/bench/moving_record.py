"""A trial of any excitation: the rows in which the joint moves, the filtered signals there, and Eq. 15 over them.

Intervals are those of the noise before the filter (HAC), with what an encoder's rounding adds; where the motion repeats
itself, those of the lines of its periods.
"""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from scipy.signal import welch

from osl_analysis.bench.alternatives import joint_angle, widened, without_drift
from osl_analysis.bench.settings import BenchStiffness, ImpedanceAnalysis
from osl_analysis.errors import IdentifiabilityError, InputError, OslAnalysisError
from osl_analysis.protocol.likeness import moving_bins
from osl_analysis.second_order import impedance_columns
from osl_analysis.signals import LowPass, Motion, filtered_motion, runs
from osl_analysis.spectral.equation_error import fit_periodic
from osl_analysis.spectral.realisations import PeriodicMotion, periodic_motion
from osl_analysis.stats.covariance import correlation_samples, moving_sums, with_repeated
from osl_analysis.stats.least_squares import largest_correlation
from osl_analysis.stats.regression import LinearFit, Regressors, regressors, variance_accounted_for
from osl_analysis.stats.rounding import HARMONICS, SIZES, rounding_harmonics, visible_step
from osl_analysis.timebase.grid import GapLimits
from osl_analysis.trial import Array, Trial
from osl_analysis.uniform import UniformSignals, regridded, uniform_signals

PERIODIC = 1.5  # highest line of a periodic motion, in cut-offs of the filter
EDGE = 2.0
"""Periods of the cut-off at each end of what is fitted that are left out: 130 ms at 15 Hz. The ends of a record,
filtered with an invented continuation, would change K by 0.05 % and I by 0.4 %."""
SHORTEST_S = 1.0  # shortest stretch [s] that is fitted
LEAST, MOST = 0.01, 0.99  # shares of the power of angle and acceleration beyond the band of a motion
PARTS = 3  # number of consecutive parts of a record, each of which is predicted by a fit to the others
BAND_PIECE_S = 8.0  # longest piece [s] of the spectrum from which the band is read
TERMS = 5  # terms by which a signal is found from what a filter left of it: up to the cut-off 97 % of it
DITHERED = 1e-3
"""Share of the rounding that survives the noise before it, below which the residuals have all that is left of it."""
Columns = Mapping[str, Array]  # columns (n,) of a regression by name, over all rows of a record
NONE: Columns = {}


@dataclass(frozen=True)
class MovingRecord:
    """Signals of one trial of any excitation, shape (n,) each, and the stretches that are fitted."""

    uniform: UniformSignals  # the signals on their time base
    theta: Array  # angle of the joint [rad], the yielding of the bench taken off
    torque: Array  # raw resisting torque [N*m] without the load cell's drift
    motion: Motion  # filtered joint angle with its derivatives
    filtered_torque: Array  # the torque through the same filter [N*m]
    pieces: tuple[slice, ...]  # rows of the stretches that are fitted: moving, measured, away from ends
    inside: NDArray[np.bool_]  # rows of the stated windows; all of them without one
    band_hz: tuple[float, float]  # lowest and highest frequency [Hz] of the motion
    low_pass: LowPass
    largest_inertia_error: float | None = None
    """Change of I [kg*m^2] by a small torque error from which the record is refused; None: no limit."""
    largest_drift_ppm: float = np.inf
    """Drift [ppm] between the clocks of angle and torque from which the record is refused."""
    drift: float = 0.0  # drift of the load cell [N*m/s] that was subtracted from the torque
    bench: BenchStiffness | None = None
    other: "MovingRecord | None" = None
    """The same if undecided stamps were taken the other way; None where all are decided."""
    steps: tuple[float | None, float | None] = (None, None)
    """Steps to which the raw angle [rad] and torque [N*m] were rounded; None where they are not seen."""

    @property
    def name(self) -> str:
        return self.uniform.trial

    @property
    def time(self) -> Array:
        return self.uniform.time

    @property
    def rate_hz(self) -> float:
        return self.uniform.rate_hz

    @property
    def bench_angle(self) -> Array:
        """Raw angle of the bench (n,) [rad], which is that of the joint where nothing yields."""
        return self.theta if self.bench is None else self.uniform["theta"]

    @cached_property
    def samples(self) -> int:
        """Number m of fitted rows."""
        return sum(piece.stop - piece.start for piece in self.pieces)

    @property
    def rows(self) -> NDArray[np.intp]:
        """The rows that are fitted (m,), one stretch after the other."""
        return np.concatenate([np.r_[piece] for piece in self.pieces])

    def part(self, signal: Array) -> Array:
        """A signal (n,) in the rows that are fitted (m,); a view where they follow one another."""
        parts = [signal[piece] for piece in self.pieces]
        return parts[0] if len(parts) == 1 else np.concatenate(parts)

    @property
    def seconds(self) -> float:
        return self.samples / self.rate_hz

    @cached_property
    def fit(self) -> LinearFit:
        """Eq. 15 with offset and drift, as `fit_of` has it, with the encoder's rounding in the intervals."""
        return with_rounding(fit_of(self), self)

    @property
    def of_noise_and_lines(self) -> LinearFit:
        """The fit, of a periodic motion with estimates and intervals from its lines (`by_lines`)."""
        return by_lines(self.fit, self.periodic, self.time, self.low_pass)

    @cached_property
    def estimate(self) -> LinearFit:
        """The fit with the error of the bench's stiffness in its intervals; raises as `fit_of`."""
        softer = None if self.bench is None else softer_record(self, self.bench)
        return widened(self.of_noise_and_lines, None if softer is None else softer.of_noise_and_lines)

    @cached_property
    def periodic(self) -> PeriodicMotion | None:
        """The realisations of a motion that repeats itself, in the whole record or the stated windows; else None."""
        used = self.uniform.usable & self.inside
        return periodic_motion(self.theta, self.torque, self.rate_hz, PERIODIC * self.low_pass.cutoff_hz, used)


def moving_record(
    trial: Trial, settings: ImpedanceAnalysis, windows: str | None = None, signals: UniformSignals | None = None
) -> MovingRecord:
    """Bring a trial on one time base, find where the joint moves, and filter; `windows` as in `stated_windows`.
    `signals` are those of `recorded`, where it was called already."""
    if signals is None:
        signals = uniform_signals(trial, ("theta", "torque"), settings.gap_limits, computed=("theta_command",))
    stated = windows or settings.windows
    try:
        made = record_of(signals, settings, stated)
        other = made.uniform.other()
        return made if other is None else replace(made, other=record_of(other, settings, stated))
    except (InputError, IdentifiabilityError) as error:
        raise type(error)(f"trial {trial.name}: {error}") from error


def record_of(signals: UniformSignals, settings: ImpedanceAnalysis, windows: str | None) -> MovingRecord:
    """The record behind uniform signals; raises as `moving_record`, without the trial's name. The time base bridges
    gaps up to a tenth of a period of the fastest motion, which is found first."""
    bench, low_pass = settings.bench_stiffness, settings.low_pass
    compliance = bench.compliance if bench else 0.0
    made = filtered_record(signals, low_pass, compliance, windows)
    highest = min(made.band_hz[1], settings.cutoff_hz)
    if made.uniform.report.masked or any(stream.bridged for stream in made.uniform.report.streams):
        limits = GapLimits(highest, settings.cutoff_hz, settings.time_base.longest_gap_s)
        made = filtered_record(regridded(signals, limits), low_pass, compliance, windows)
    drift, raw = drift_of(made), made.uniform
    return replace(
        yielding(made, without_drift(made.time, made.torque, drift), compliance),
        drift=drift,
        bench=bench,
        largest_inertia_error=settings.largest_inertia_error,
        largest_drift_ppm=settings.time_base.largest_drift_ppm,
        steps=(visible_step(raw["theta"]), visible_step(raw["torque"])),
    )


def filtered_record(signals: UniformSignals, low_pass: LowPass, compliance: float, windows: str | None) -> MovingRecord:
    """The record of signals whose torque still has its drift."""
    theta = joint_angle(signals["theta"], signals["torque"], compliance)
    motion, filtered = filtered_motion(signals.time, theta, signals["torque"], low_pass)
    found, inside = fitted_pieces(signals, low_pass, windows), rows_inside(signals, windows)
    band = band_of(motion, signals.rate_hz, stretches_of(found, inside))
    return MovingRecord(signals, theta, signals["torque"], motion, filtered, found, inside, band, low_pass)


def yielding(record: MovingRecord, torque: Array, compliance: float) -> MovingRecord:
    """The record with another torque (n,) [N*m], on a bench of some compliance [rad/(N*m)]."""
    if not compliance:
        return replace(record, torque=torque, filtered_torque=record.low_pass(torque, record.rate_hz))
    theta = joint_angle(record.uniform["theta"], torque, compliance)
    motion, filtered = filtered_motion(record.time, theta, torque, record.low_pass)
    return replace(record, theta=theta, torque=torque, motion=motion, filtered_torque=filtered)


def softer_record(record: MovingRecord, bench: BenchStiffness) -> MovingRecord:
    raw, compliance = record.uniform["torque"], bench.compliance + bench.compliance_error
    drift = drift_of(yielding(record, raw, compliance))
    return yielding(record, without_drift(record.time, raw, drift), compliance)


def drift_of(record: MovingRecord) -> float:
    """Drift [N*m/s] of the load cell beside Eq. 15; raises IdentifiabilityError in the words of `moves_little`."""
    try:
        return estimates_of(record)["drift"]
    except IdentifiabilityError as error:
        raise IdentifiabilityError(moves_little(record, error)) from error


def moves_little(record: MovingRecord, error: IdentifiabilityError) -> str:
    """For how long and at which frequencies a record moves, where Eq. 15 cannot be fitted to it or to a part of it."""
    moving = np.count_nonzero(moving_bins(record.time, record.theta)[record.rows]) / record.rate_hz
    low, high = record.band_hz
    return (
        f"the joint moves for {moving:.2g} of the {record.seconds:.3g} s that are fitted, at {low:.2g} to "
        f"{high:.2g} Hz: {str(error).partition(';')[0]}; keep it moving by 0.5 to 6 Hz, or take the stiffness alone by "
        "experiment 'torque_angle'"
    )


def fitted_pieces(signals: UniformSignals, low_pass: LowPass, windows: str | None) -> tuple[slice, ...]:
    """Rows of the stretches that are fitted: in the windows, or from the first to the last motion, without their ends.

    Raises InputError if the joint does not move, a window is not in the record, or no stretch is long enough.
    """
    time = signals.time - signals.time[0]
    if windows is None:
        moving = moving_bins(time, signals["theta"])
        if not moving.any():
            raise InputError("the joint does not move; check the channel of theta in the source file")
        stated = [(float(time[np.argmax(moving)]), float(time[len(moving) - 1 - np.argmax(moving[::-1])]))]
    else:
        stated = stated_windows(windows, float(time[-1]))
    inside = np.zeros(len(time), dtype=bool)
    edge = EDGE / low_pass.cutoff_hz
    for start, stop in stated:
        inside |= (time >= start + edge) & (time <= stop - edge)
    shortest = SHORTEST_S * signals.rate_hz
    found = tuple(run for run in runs(inside & signals.usable) if run.stop - run.start >= shortest)
    if not found:
        raise InputError(
            f"nothing is left to fit: the joint moves for {sum(b - a for a, b in stated):.3g} s, of which "
            f"{edge:.2g} s at each end and rows near gaps do not count, and stretches need {SHORTEST_S:g} s; record "
            "for longer"
        )
    return found


def rows_inside(signals: UniformSignals, windows: str | None) -> NDArray[np.bool_]:
    """Rows of the stated windows, all of them without one."""
    time = signals.time - signals.time[0]
    if windows is None:
        return np.ones(len(time), dtype=bool)
    parts = [(time >= start) & (time <= stop) for start, stop in stated_windows(windows, float(time[-1]))]
    return np.asarray(np.any(parts, axis=0))


def stated_windows(text: str, duration: float) -> list[tuple[float, float]]:
    """Windows [s] from the start of a record of some duration [s], stated as `2-30 40-62`.

    Raises InputError if they are not windows, overlap, or lie beyond the record.
    """
    parts = [re.fullmatch(r"(\d+\.?\d*)-(\d+\.?\d*)", word) for word in text.split()]
    windows = [(float(part[1]), float(part[2])) for part in parts if part]
    if len(windows) < len(parts) or any(start >= stop for start, stop in windows):
        raise InputError(f"windows '{text}' are not from-to in s, as in '2-30 40-62'; correct the sheet")
    for (_, stop), (start, _) in pairwise(windows):
        if start < stop:
            raise InputError(f"windows '{text}' overlap, or are not in the order of time; correct the sheet")
    if windows[-1][1] > duration + 1.0:
        raise InputError(f"windows '{text}' end at {windows[-1][1]:g} s, the record after {duration:.1f} s")
    return windows


def band_of(motion: Motion, rate_hz: float, stretches: Sequence[slice]) -> tuple[float, float]:
    """Lowest and highest frequency [Hz] of a motion (n,): 1 % of the angle's power lies below, of the acceleration's
    above. Its spectrum is the mean over the stretches, in which gaps are bridged."""
    length = min(round(BAND_PIECE_S * rate_hz), *(one.stop - one.start for one in stretches))
    f, low, high = np.empty(0), np.zeros(length // 2 + 1), np.zeros(length // 2 + 1)
    for one in stretches:
        weight = one.stop - one.start
        f, angle = welch(motion.theta[one], rate_hz, nperseg=length)
        low += weight * angle
        high += weight * welch(motion.alpha[one], rate_hz, nperseg=length)[1]
    below, up_to = np.cumsum(low[1:]), np.cumsum(high[1:])
    if not below[-1] > 0 or not up_to[-1] > 0:
        raise InputError("the joint does not move; check the channel of theta in the source file")
    return float(f[1:][np.argmax(below > LEAST * below[-1])]), float(f[1:][np.argmax(up_to > MOST * up_to[-1])])


def stretches_of(pieces: Sequence[slice], inside: NDArray[np.bool_]) -> list[slice]:
    """Stretches from the first to the last piece in each window; the gaps between pieces belong to them."""
    joined: list[slice] = []
    for piece in pieces:
        if joined and inside[joined[-1].stop : piece.start].all():
            joined[-1] = slice(joined[-1].start, piece.stop)
        else:
            joined.append(piece)
    return joined


def consecutive_parts(samples: int) -> list[slice]:
    """The fitted rows, counted from 0 to m, as three consecutive parts, the first ones longer by one at most."""
    each, more = divmod(samples, PARTS)
    ends = np.cumsum([0, *(each + (k < more) for k in range(PARTS))]).tolist()
    return [slice(*pair) for pair in pairwise(ends)]


def eq15_columns(record: MovingRecord, more: Columns = NONE) -> dict[str, Array]:
    """The columns (n,) of Eq. 15 with offset and drift, and `more` of them, over all rows of a record."""
    time = record.time
    return {**impedance_columns(record.motion), "drift": time - (time[0] + time[-1]) / 2, **more}


def solved(record: MovingRecord, columns: Columns) -> tuple[Regressors, Array]:
    """The columns' decomposition in the fitted rows and the estimates (p,); raises as `linear_fit`."""
    torque = record.part(record.filtered_torque)
    found = regressors({name: record.part(column) for name, column in columns.items()}, torque.shape)
    return found, found.solved(torque)


def estimates_of(record: MovingRecord, more: Columns = NONE) -> dict[str, float]:
    """The estimates of `fit_of` by name, without their intervals."""
    columns = eq15_columns(record, more)
    return dict(zip(columns, solved(record, columns)[1].tolist(), strict=True))


def left_by(record: MovingRecord) -> float:
    """RMS [N*m] of what Eq. 15 with offset and drift leaves of the fitted rows."""
    found, estimates = solved(record, eq15_columns(record))
    return float(np.std(record.part(record.filtered_torque) - found.X @ estimates))


def fit_of(record: MovingRecord, more: Columns = NONE) -> LinearFit:
    """Eq. 15 with offset and drift over the fitted rows, and `more` columns (n,), by name; raises as `linear_fit`.

    The interval is that of the torque's noise as it was before the filter (HAC). The columns are slow, so that the
    estimates do not change if the filter is taken off the noise. Behind the filter it is correlated with both signs at
    the frequencies of the columns: Bartlett's weights then lose up to a tenth of it.
    """
    columns = eq15_columns(record, more)
    found, estimates = solved(record, columns)
    torque, inverse = record.part(record.filtered_torque), found.inverse
    residual = torque - found.X @ estimates
    modelled = np.einsum("p,pn->n", estimates, np.array(list(columns.values())))
    off = noise_beyond(record.torque, record.filtered_torque, modelled, record.low_pass, record.rate_hz)
    noise = record.part(off) + residual
    window = correlation_samples(residual, record.low_pass.independent_samples(record.rate_hz))
    covariance, degrees_of_freedom = moving_sums(found.X @ inverse * noise[:, None], window, slow=True)
    return LinearFit(
        tuple(columns),
        estimates,
        covariance,
        variance_accounted_for(torque, residual),
        1 - float(residual @ residual) / max(float(torque @ torque), np.finfo(float).tiny),
        found.condition,
        window,
        record.samples,
        "HAC",
        degrees_of_freedom,
        residual,
        largest_correlation(inverse),
    )


def noise_beyond(noisy: Array, behind: Array, signal: Array, low_pass: LowPass, rate_hz: float) -> Array:
    """What a filter H took off a `noisy` signal (n,), without the part of the signal itself, which is known behind H.

    `behind` (n,) is the noisy signal behind H, `signal` (n,) the signal behind H. The filter took off (1 - H) of the
    signal s, of which H s is known: s = H s + (1 - H) H s + (1 - H)^2 H s + ...
    """
    part, off = signal, noisy - behind
    for _ in range(TERMS):
        part = part - low_pass(part, rate_hz)
        off = off - part
    return off


def by_lines(fit: LinearFit, motion: PeriodicMotion | None, time: Array, low_pass: LowPass) -> LinearFit:
    """The fit of a record at times (n,) [s] with estimates and intervals from the lines of its motion; diagnostics
    stay. The fit itself where there are none. Whatever repeats in every period, as the rounding of an encoder and
    friction, is in these intervals. Noise alone is in those of `fit`."""
    if motion is None:
        return fit
    try:
        lines = fit_periodic(motion.realisations, low_pass)
    except OslAnalysisError:
        return fit
    middles = [one.start + one.periods * one.period / 2 for one in motion.realisations]
    middle = float(np.average(middles, weights=[one.periods for one in motion.realisations]))
    beside = middle - float(time[-1] - time[0]) / 2  # the drift is subtracted about the middle of the record
    covariance, offset = lines.covariance.copy(), lines.names.index("offset")
    covariance[offset, offset] += (beside * fit.se("drift")) ** 2
    return replace(
        fit,
        names=lines.names,
        estimates=lines.estimates,
        covariance=covariance,
        degrees_of_freedom=lines.degrees_of_freedom,
        interval_method=lines.interval_method,
    )


def with_rounding(fit: LinearFit, record: MovingRecord) -> LinearFit:
    """A fit of a record (`fit_of`) with the rounding of its angle in its covariance.

    A sweep turns round at places within a step that change slowly: there the errors of many samples are alike, and add
    up. What they do is computed as a variance over all zeros of the encoder (`rounding_harmonics`), from the filtered
    angle. The residuals have a part of it already: the interval may be too wide.
    """
    step = record.steps[0]
    if step is None:
        return fit
    turned = record.motion.theta  # the filtered angle of the encoder: that of the joint, and what the bench yields
    if record.bench is not None:
        turned = joint_angle(turned, record.filtered_torque, -record.bench.compliance)
    left = surviving(record.part(record.bench_angle), record.part(turned), step)
    if left[0] <= DITHERED:
        return fit
    columns, p = np.array(list(eq15_columns(record).values())).T, len(fit.names)
    gram, sums = np.zeros((p, p)), np.zeros((p, 2 * HARMONICS))
    stiffness, damping, inertia = (fit[name] for name in ("K", "B", "I"))
    for rows in record.pieces:
        X = columns[rows]
        gram += X.T @ X
        # the error acts as K e + B de/dt + I d2e/dt2; by parts, the derivatives are the columns'
        slope = np.gradient(X, axis=0) * record.rate_hz
        weights = stiffness * X - damping * slope + inertia * np.gradient(slope, axis=0) * record.rate_hz
        sums += weights.T @ rounding_harmonics(turned[rows], step).T
    changes = np.linalg.solve(gram, sums) * (SIZES * step * np.tile(left, 2))
    spread = fit.covariance, fit.degrees_of_freedom
    covariance, freedom, method = with_repeated(spread, [changes @ changes.T], fit.interval_method)
    return replace(fit, covariance=covariance, degrees_of_freedom=freedom, interval_method=method)


def surviving(recorded: Array, turned: Array, step: float) -> Array:
    """Share of each harmonic of the rounding to steps [rad] that the noise of a recorded angle (n,) leaves in the mean,
    (HARMONICS,). The noise is what the angle has beside the filtered one, `turned` (n,), beyond the rounding of
    that."""
    smooth = turned / step
    error, rounded = recorded / step - smooth, np.rint(smooth) - smooth
    variance = max(float(error @ error - rounded @ rounded) / len(smooth), 0.0)
    return np.asarray(np.exp(-2 * variance * (np.pi * np.arange(1, HARMONICS + 1)) ** 2))
