"""One record for every motion: uniform signals, the motion behind one low-pass, and groups of rows.

What differs from one motion to another is here, in three makers of groups: the cycles of a stepped sine, parts of the
periods of a motion that repeats itself, and stretches of any other one. What comes after knows groups only."""

from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from itertools import compress
from pathlib import Path
from typing import Literal

import numpy as np
import polars as pl
import scipy
from numpy.typing import NDArray

from osl_analysis.bench.settings import (
    NOT_STATED,
    BenchAnalysis,
    BenchStiffness,
    Calibration,
    ImpedanceAnalysis,
    SteppedSineAnalysis,
)
from osl_analysis.errors import IdentifiabilityError, InputError
from osl_analysis.refusal import check_not_refused
from osl_analysis.signals import LowPass, Motion, filtered_motion, runs
from osl_analysis.signals.grid import (
    GapLimits,
    UniformSignals,
    devices_of,
    on_one_grid,
    origin,
    resampled,
    uniform_signals,
)
from osl_analysis.spectral import stepped_sine
from osl_analysis.spectral.periods import PeriodicMotion, lines_of, periodic_motion
from osl_analysis.spectral.stepped_sine import Likeness, whole_rows
from osl_analysis.stats.regression import FEWEST_CYCLES, products_between
from osl_analysis.trial import Array, Trial, stretches, visible_step

Label = float | str | None
"""What a fit of its own is made for: an amplitude [deg], a branch of a belt; None: all of a record."""
STRETCH_S = 1.0  # duration [s] of a stretch: 30 correlation times of a 15 Hz low-pass
QUICK = 4.0  # cut-offs of the low-pass behind which the velocity's sign is read, and the rounding of steps is drawn
COMES = 3.0  # times the last step of a rounded signal in which it comes to a level: exponentially 2, of least jerk 2.3
BEYOND = 1.1  # cut-offs, from which on it is more of the motion than the tail of a step that is faster
STANDS = 0.1  # of the SD of the speed, below which a joint stands
QUIET = 0.3  # share of the parts of 50 samples, in which what is faster than the motion is noise alone
AT_LEVELS = 0.15  # share of the power at a few levels, from which on a motion is between these (sines 0.05, steps 0.2)
OF_SINE = 0.5  # steps by which the size of a sine is drawn: less where samples keep step with it covers too little
DRAWS = (np.arange(17) + 0.5) / 17 - 0.5  # parts of a step of an encoder by which zeros and sizes differ
ALIKE_S = 0.25  # time [s] over which what a model misses is alike
SHORTEST_S = 1.0  # shortest stretch [s] that is fitted
NOT_MOVED = "the joint does not move; check the channel of theta in the source file"


@dataclass(frozen=True)
class Stratum:
    """What groups have in common that repeat one another, or of a motion that does not repeat, all groups."""

    rows: slice  # rows of the motion that they are of, its transient included
    label: Label = None
    frequency_hz: float = np.nan  # of a sine [Hz]
    commanded_deg: float | None = None  # amplitude of the protocol that a sine follows [deg]


@dataclass(frozen=True)
class Groups:
    """Groups of consecutive rows of a record; a group ends where the next one begins, or earlier."""

    kind: Literal["cycles", "periods", "stretches"]
    first: Array  # row at which each group begins, which need not be whole, (m,)
    stop: Array  # where it ends, (m,)
    stratum: NDArray[np.intp]  # number of the stratum of each group, rising from 0, (m,)
    strata: tuple[Stratum, ...]

    @property
    def repeat(self) -> bool:
        """Whether the groups of a stratum repeat one another."""
        return self.kind != "stretches"

    @cached_property
    def labels(self) -> tuple[Label, ...]:
        return tuple(dict.fromkeys(one.label for one in self.strata))

    def of(self, label: Label) -> NDArray[np.bool_]:
        """Which groups have a label; all for None, (m,)."""
        if label is None:
            return np.ones(len(self.first), dtype=np.bool_)
        return np.array([one.label == label for one in self.strata])[self.stratum]

    @cached_property
    def pieces(self) -> Mapping[Label, list[slice]]:
        """Rows of each label's groups in the order of time, adjacent ones together; of all for None."""
        edges = zip(self.first.tolist(), self.stop.tolist(), strict=True)
        rows = [whole_rows(first, stop) for first, stop in edges]
        return {label: joined(list(compress(rows, self.of(label)))) for label in (None, *self.labels)}


def joined(parts: Sequence[slice], apart: int = 0) -> list[slice]:
    """Parts of a recording in the order of time, those that touch, or are `apart` by some rows, as one."""
    found: list[slice] = []
    for rows in sorted(parts, key=lambda rows: rows.start):
        if found and rows.start <= found[-1].stop + apart:
            found[-1] = slice(found[-1].start, max(rows.stop, found[-1].stop))
        else:
            found.append(rows)
    return found


def before_rounding(read: Array, step: float) -> Array:
    """What a signal (n,) in steps was before: halfway where it goes from one step to the next. It comes to a level, and
    leaves it, in `COMES` times what the step beside it took."""
    at = np.flatnonzero(np.abs(np.diff(read)) > 0.3 * step)
    way, gap, level = np.diff(read)[at] > 0, np.diff(at), read[at + 1]
    turns = np.flatnonzero(way[1:] != way[:-1])
    before, own, after = (np.r_[np.inf, gap, np.inf][turns + k] for k in range(3))
    comes, leaves = (at[turns + k] + 0.5 for k in range(2))
    comes, leaves = comes + np.minimum(COMES * before, 0.45 * own), leaves - np.minimum(COMES * after, 0.45 * own)
    place = np.r_[0, at + 0.5, comes, leaves, len(read) - 1]
    value = np.r_[read[0], (read[at] + level) / 2, level[turns], level[turns], read[-1]]
    order = np.argsort(place)
    return np.asarray(np.interp(np.arange(len(read)), place[order], value[order]))


@dataclass(frozen=True)
class Record:
    """Signals of one trial on the dynamometer, shape (n,) each, and the groups of rows that are fitted."""

    name: str  # name of the trial
    time: Array  # uniform times [s]
    theta: Array  # angle of the joint [rad], the yielding of the bench taken off
    torque: Array  # raw resisting torque [N*m] without the load cell's drift
    motion: Motion  # filtered joint angle with its derivatives
    filtered_torque: Array  # the torque through the same filter [N*m]
    low_pass: LowPass  # the filter of angle and torque
    usable: NDArray[np.bool_]  # rows that are not near a gap in the recording
    groups: Groups
    band_hz: tuple[float, float] = (np.nan, np.nan)  # lowest and highest frequency [Hz] of the motion
    drift: float = 0.0  # drift of the load cell [N*m/s] that was subtracted from the torque
    steps: tuple[float | None, float | None] = (None, None)
    """Steps to which angle [rad] and torque [N*m] were rounded; None where they are not known."""
    periodic: PeriodicMotion | None = None  # the periods of a motion that repeats itself
    uniform: UniformSignals | None = None
    """The signals on their time base, with what the recorders did; None for a record that no file holds."""
    other: "Record | None" = None  # the same if undecided stamps were taken the other way; None: all are decided
    softer: "Record | None" = None  # the same with a bench that is softer by one standard error; None: it is exact
    settings: BenchAnalysis | None = None  # the bench, and limits of what a motion must tell
    actuator: Mapping[str, Array] = field(default_factory=dict)
    """Where they were asked for, angle `theta_m` [rad] and `current` [A] of the actuator behind the filter; `quick` is
    the angle of which the sign of the velocity is read."""

    @property
    def bench(self) -> BenchStiffness | None:
        """Stiffness of the bench; None: it does not yield."""
        return self.settings.bench_stiffness if self.settings else None

    @property
    def calibration(self) -> Calibration:
        """What is not known of angle and torque."""
        return self.settings.calibration if self.settings else NOT_STATED

    @property
    def rate_hz(self) -> float:
        return (len(self.time) - 1) / float(self.time[-1] - self.time[0])

    @property
    def is_stepped_sine(self) -> bool:
        return self.groups.kind == "cycles"

    @property
    def two_clocks(self) -> bool:
        """Whether two devices recorded angle and torque."""
        if self.uniform is None:
            return False
        theta, torque = self.uniform.of("theta"), self.uniform.of("torque")
        return theta.stream.stamps is not torque.stream.stamps and not (theta.held or torque.held)

    @property
    def bench_angle(self) -> Array:
        """Raw angle of the bench (n,) [rad], which is that of the joint where nothing yields."""
        return self.theta if self.bench is None or self.uniform is None else self.uniform["theta"]

    @cached_property
    def noise(self) -> tuple[float, float]:
        """Densities of the noise of angle [rad^2/Hz] and torque [N^2 m^2/Hz], as if it were white: their levels between
        two and four cut-offs, of what the filter takes off the rows that are fitted. Where the motion itself reaches
        there, that of the angle is its level at the highest frequencies."""
        welch = partial(scipy.signal.welch, fs=self.rate_hz, noverlap=0, detrend=False)
        length = min(round(self.rate_hz), self.samples)
        pairs = (self.theta, self.motion.theta), (self.torque, self.filtered_torque)
        (f, angle), (_, torque) = (welch(self.part(raw - smooth), nperseg=length) for raw, smooth in pairs)
        power = np.array([angle, torque])
        highest = min(4 * self.low_pass.cutoff_hz, 0.45 * self.rate_hz)
        beyond = (f > min(2 * self.low_pass.cutoff_hz, 0.8 * highest)) & (f < highest)
        of_theta, of_torque = np.median(power[:, beyond], axis=1) if beyond.any() else (0.0, 0.0)
        highest_of_all = float(np.median(power[0, f > 0.35 * self.rate_hz]))
        return highest_of_all if highest_of_all < 0.3 * of_theta else float(of_theta), float(of_torque)

    @cached_property
    def repeated_steps(self) -> list[tuple[float, float]]:
        """Steps of angle [rad] and torque [N*m], and how much of what rounding makes alike in all cycles noise leaves:
        noise of s steps before it exp(-(2 pi s)^2/2) (Widrow and Kollar, Quantization Noise, 2008, ch. 5)."""
        found = list[tuple[float, float]]()
        for step, density, raw in zip(self.steps, self.noise, (self.theta, self.torque), strict=True):
            # rounding of slow motion is no white noise; of motion beyond the cut-off what is slower than some samples,
            # or stands still at a level, is none
            jumps = np.diff(self.part(raw), 3) ** 2 / 20
            quiet = np.quantile(np.add.reduceat(jumps, np.arange(0, len(jumps) - 1, 50)) / 50, QUIET)
            variance = min(density * self.rate_hz / 2, float(quiet))
            noise = max(variance / step**2 - 1 / 12, 0.0) if step and step**2 else np.inf  # [steps^2]
            # beyond 0.1 steps^2 a fiftieth of the variance of what cycles repeat is left
            found.append((step or 0.0, float(np.exp(-2 * np.pi**2 * noise)) if noise < 0.1 else 0.0))
        return found

    def roundings(self, channel: int, rows: slice = slice(None)) -> Iterator[Array]:
        """Errors (n,) of angle [rad] (0) or torque [N*m] (1) in some rows that rounding makes, each with another zero
        of the sensor; none where noise hides it. Of levels and sines, which return to the same places, the size is
        another one too: of levels, whose errors are independent, by what the share of power at each makes of all.
        Between few levels how the joint comes to a level makes the errors, which every step repeats, and is not known:
        the draws are in turn of the signal behind a filter that is quicker by `QUICK`, whose levels ring by some steps
        (alone they accuse sound steps), and of what it was before the encoder (alone they make I too certain)."""
        (step, left), raw = self.repeated_steps[channel], (self.theta, self.torque)[channel]
        if not left:
            return
        speed, signal = np.abs(self.motion.omega[rows]), (self.motion.theta, self.filtered_torque)[channel][rows]
        stands = speed < STANDS * float(np.std(self.motion.omega[rows]))
        place = raw[rows] - raw[rows].mean()  # the filtered signal's levels ring by many steps of 18 bits
        _, level = np.unique(np.rint(place[stands] / step), return_inverse=True)
        larger = float(np.linalg.norm(np.bincount(level, place[stands] ** 2))) / max(float(place @ place), step**2)
        signals = [signal]
        if larger > AT_LEVELS:
            quick = replace(self.low_pass, cutoff_hz=QUICK * self.low_pass.cutoff_hz)
            signals = [quick(raw[rows], self.rate_hz), before_rounding(raw[rows], step)]
        every = [(one - one.mean()) / step for one in signals]
        more = max(larger, OF_SINE * self.is_stepped_sine) * DRAWS[5 * np.arange(17) % 17]
        for k, (zero, share) in enumerate(zip(DRAWS, more / float(np.abs(every).max()), strict=True)):
            read = every[k % len(every)] * (1 + share) + zero
            yield left * step * (read - np.rint(read))

    def coarse_roundings(self, channel: int) -> Iterator[Array]:
        """The `roundings` of all rows, behind the filter of the fit, in the rows of `coarse`."""
        few, every = self.coarse, round(self.rate_hz / self.coarse.rate_hz)
        first = np.maximum(np.arange(len(few.time)) * every - every // 2, 0)
        return (few.low_pass(np.add.reduceat(x, first) / every, few.rate_hz) for x in self.roundings(channel))

    @cached_property
    def rounded(self) -> Array | None:
        """Torques (k, n) [N*m] that the `roundings` make for Eq. 15 in the rows of `coarse`; None where noise
        hides the rounding, or it is less than half of what is left, were that noise and all roundings alike."""
        few = self.coarse
        motion = np.array([few.part(x) for x in (few.motion.theta, few.motion.omega, few.motion.alpha)])
        motion -= motion.mean(axis=1, keepdims=True)
        K, B, I = np.linalg.lstsq(motion @ motion.T, motion @ few.part(few.filtered_torque), rcond=1e-13)[0]
        left = np.var(few.part(few.filtered_torque) - np.array([K, B, I]) @ motion)
        samples = 2 * self.low_pass.noise_bandwidth_hz * self.seconds  # that are independent
        of_theta, of_torque = (step * share for step, share in self.repeated_steps)
        s = 2j * np.pi * self.band_hz[1]
        if left / samples >= 4 * ((max(abs(K), abs(K + B * s + I * s**2)) * of_theta) ** 2 + of_torque**2) / 12:
            return None
        thetas, torques = (list(self.coarse_roundings(k)) for k in (0, 1))
        if not thetas:
            return np.array(torques) if torques else None
        made = np.empty((len(thetas), len(few.time)))
        for row, theta in zip(made, thetas, strict=True):  # one at a time: all at once take 0.4 GB of an hour
            omega = np.gradient(theta, 1 / few.rate_hz)
            row[:] = K * theta + B * omega + I * np.gradient(omega, 1 / few.rate_hz)
        for row, torque in zip(made, torques, strict=False):
            row -= torque
        return made

    @cached_property
    def pieces(self) -> tuple[slice, ...]:
        """Rows that are fitted."""
        return tuple(self.groups.pieces[None])

    @cached_property
    def samples(self) -> int:
        """Number m of fitted rows."""
        return sum(piece.stop - piece.start for piece in self.pieces)

    @property
    def seconds(self) -> float:
        return self.samples / self.rate_hz

    def thinned(self, step: int) -> "Record":
        """Every `step`-th row of the filtered signals, with the same groups; the torque is the filtered one."""
        if step == 1:
            return self
        rows, groups = slice(None, None, step), self.groups
        first, stop = groups.first / step, np.minimum(groups.stop / step, len(self.time[rows]))
        return replace(
            self,
            time=self.time[rows],
            theta=self.motion.theta[rows],
            torque=self.filtered_torque[rows],
            motion=self.motion[rows],
            filtered_torque=self.filtered_torque[rows],
            usable=self.usable[rows],
            actuator={name: signal[rows] for name, signal in self.actuator.items()},
            groups=replace(groups, first=first, stop=stop),
        )

    @cached_property
    def coarse(self) -> "Record":
        """The record at 250 Hz, eight cut-offs or more: its filtered signals have nothing faster."""
        at_least = max(250.0, 8 * self.low_pass.cutoff_hz)
        return self.thinned(max(int(self.rate_hz / at_least + 1e-6), 1))  # a rate is known to rounding

    @property
    def swift_omega(self) -> Array:
        """Velocity [rad/s] in the rows of `coarse`, whose sign is friction's. Where the motion reaches beyond the
        cut-off of the fit it is behind a filter that passes it, since what is left turns at other times."""
        few, highest = self.coarse, self.band_hz[1]
        if not highest > BEYOND * self.low_pass.cutoff_hz:
            return few.motion.omega
        swift = replace(self.low_pass, cutoff_hz=min(2 * highest, 0.2 * self.rate_hz))
        theta = swift(self.theta, self.rate_hz)[:: round(self.rate_hz / few.rate_hz)]
        return np.asarray(np.gradient(theta, 1 / few.rate_hz))

    def rows(self, label: Label = None) -> NDArray[np.intp]:
        """The rows that are fitted (m,), of a label or of all, each once."""
        return np.concatenate([np.r_[piece] for piece in self.groups.pieces[label]])

    def part(self, signal: Array) -> Array:
        """A signal (n,) in the rows that are fitted (m,); a view where they follow one another."""
        parts = [signal[piece] for piece in self.pieces]
        return parts[0] if len(parts) == 1 else np.concatenate(parts)

    def moving(self, label: Label = None) -> list[slice]:
        """Rows of the motion of a label, its transients included: stretches that touch are one."""
        return joined([one.rows for one in self.groups.strata if label is None or one.label == label], apart=1)

    def label_near(self, amplitude_deg: float | None) -> Label:
        """The label of the amplitude [deg] that is meant, as commanded or as measured; None for the largest one.
        Raises InputError: no amplitude is near it."""
        of = {x: one.commanded_deg or x for one in self.groups.strata if isinstance(x := one.label, float)}
        if not of:
            return None
        if amplitude_deg is None:
            return max(of, key=lambda label: of[label])
        near = min(of, key=lambda label: abs(of[label] - amplitude_deg))
        if abs(of[near] / amplitude_deg - 1) > 0.25:
            raise InputError(
                f"figures.time_series.amplitude_deg = {amplitude_deg:g} is not in the protocol "
                f"({', '.join(f'{size:g}' for size in of.values())} deg); choose one of these"
            )
        return near


def stored_record(record: Record) -> pl.DataFrame:
    """What a model of the drivetrain is compared with, a row per sample: the angle of the joint, the filtered torque,
    whether the row is fitted, and the frequency [Hz] of the sine that it then is of, else NaN."""
    fitted, hz = np.zeros(len(record.time), dtype=np.bool_), np.full(len(record.time), np.nan)
    fitted[record.rows()] = True
    for one in record.groups.strata:
        hz[one.rows] = np.where(fitted[one.rows], one.frequency_hz, np.nan)
    signals = {"time": record.time, "theta": record.theta, "torque": record.filtered_torque}
    return pl.DataFrame({**signals, "fitted": fitted, "frequency_hz": hz})


def read_record(path: Path, low_pass: LowPass) -> Record:
    """The record that was stored, whose torque is the filtered one; a stratum is a stretch of rows."""
    check_not_refused(path)
    table = pl.read_parquet(path)
    time, theta, torque, fitted, hz = (table[name].to_numpy() for name in table.columns)
    motion, _ = filtered_motion(time, theta, torque, low_pass)
    parts = runs(fitted)
    first, stop = np.array([[rows.start, rows.stop] for rows in parts]).T
    strata = tuple(Stratum(rows, frequency_hz=float(hz[rows.start])) for rows in parts)
    groups = Groups("stretches", first, stop, np.arange(len(parts)), strata)
    return Record(path.stem, time, theta, torque, motion, torque, low_pass, fitted, groups)


def joint_angle(theta: Array, torque: Array, compliance: float) -> Array:
    """Angle of the joint (n,) [rad] from that of the bench, whose frame the resisting torque [N*m] winds up. The bench
    turns the joint by its frame, of some `compliance` [rad/(N*m)]: theta_bench = theta + torque/k."""
    return theta - compliance * torque if compliance else theta


def cycles_of(
    segments: Sequence[stepped_sine.Segment], settle_cycles: int, usable: NDArray[np.bool_], stated: bool = True
) -> Groups:
    """The settled, usable cycles of segments; a stratum is a segment. None was commanded unless `stated`."""
    kept = [stepped_sine.settled_cycles(segment, settle_cycles, usable) for segment in segments]
    strata = []
    for whole, label in zip(segments, stepped_sine.labels_deg(segments), strict=True):
        meant = None if whole.commanded is None or not stated else round(float(np.rad2deg(whole.commanded)), 9)
        strata.append(Stratum(whole.rows, label, whole.frequency_hz, meant))
    first, stop = np.concatenate(kept).T
    number = np.repeat(np.arange(len(kept)), [len(one) for one in kept])
    return Groups("cycles", first, np.minimum(stop, len(usable)), number, tuple(strata))


def periods_of(
    motion: PeriodicMotion, rate_hz: float, usable: NDArray[np.bool_], seconds: float = ALIKE_S
) -> Groups | None:
    """The same part of some seconds of each period of a realisation is a stratum; None where fewer than two periods are
    usable. Noise is alike over much less than `ALIKE_S`."""
    parts = max(round(motion.period / seconds), 1)
    first, number, strata = [], [], list[Stratum]()
    for one in motion.realisations:
        starts = rate_hz * (one.start + one.period * np.arange(one.periods))
        rows = slice(round(starts[0]), min(round(starts[-1] + rate_hz * one.period), len(usable)))
        for part in range(parts):
            first.append(starts + rate_hz * one.period * part / parts)
            number.append(np.full(one.periods, len(strata)))
            strata.append(Stratum(rows))
    begin, kind = np.concatenate(first), np.concatenate(number)
    stop = np.minimum(begin + rate_hz * motion.period / parts, len(usable))
    lacking = np.concatenate([[0], np.cumsum(~usable)])
    low = np.floor(begin + 1e-6).astype(np.intp)
    high = np.minimum(np.ceil(stop - 1e-6).astype(np.intp), len(usable))
    whole = lacking[high] == lacking[np.minimum(low, high)]
    members = np.bincount(kind[whole], minlength=len(strata))
    chosen = whole & (members[kind] > 1)
    there, numbers = np.unique(kind[chosen], return_inverse=True)
    if np.count_nonzero(members) < 2 or not chosen.any():
        return None
    return Groups("periods", begin[chosen], stop[chosen], numbers, tuple(strata[k] for k in there))


def stretches_of(pieces: Sequence[slice], rate_hz: float, seconds: float = STRETCH_S, label: Label = None) -> Groups:
    """Equal stretches of about some seconds of each piece: all are one stratum, of which nothing repeats."""
    edges = [
        np.linspace(piece.start, piece.stop, max(round((piece.stop - piece.start) / (seconds * rate_hz)), 1) + 1)
        for piece in pieces
    ]
    first, stop = np.concatenate([e[:-1] for e in edges]), np.concatenate([e[1:] for e in edges])
    whole = Stratum(slice(pieces[0].start, pieces[-1].stop), label)
    return Groups("stretches", first, stop, np.zeros(len(first), dtype=np.intp), (whole,))


Parts = tuple[Groups, tuple[float, float], PeriodicMotion | None, UniformSignals]
"""Groups, band [Hz] and periods of a motion, and the signals that they are of."""


def sine_record(trial: Trial, settings: SteppedSineAnalysis) -> Record:
    """The record of a trial that follows a stepped sine; raises as `record_of_trial`."""
    return record_of_trial(trial, settings, excitation="stepped_sine")


def record_of_trial(
    trial: Trial, settings: SteppedSineAnalysis, windows: str | None = None, excitation: str | None = None
) -> Record:
    """The record of a trial.

    `excitation`, or else that of the settings, says what moved the joint; `auto` asks the recording. Half of the moving
    time of a stepped sine is sines of one frequency each; another motion hardly has any, and not the commanded ones in
    turn. Between the two a stepped sine may be damaged: it is refused with the setting by which it is taken for another
    motion, or fitted as one. `windows` [s] state that it is another, and what of it is fitted.

    Raises InputError: a signal is missing, has no time base, does not move, or follows a damaged protocol."""
    signals = uniform_signals(trial, ("theta", "torque"), settings.gap_limits, computed=("theta_command",))
    steps = list[float | None]()
    for column in ("theta", "torque"):  # what the source file states, else what the values show
        stated, taken = origin(trial, column).get("resolution"), signals.of(column)
        steps.append(float(stated) if stated else visible_step(taken.stream.signals[column][taken.present]))
    if excitation is None:
        excitation = settings.excitation if isinstance(settings, ImpedanceAnalysis) else "stepped_sine"
    known = Likeness(signals.time, signals["theta"], settings.protocol)
    auto, is_other = excitation == "auto", excitation == "any"
    is_other |= auto and (bool(windows) or known.kind == "other")

    def parts_of(one: UniformSignals) -> Parts:
        if is_other:
            assert isinstance(settings, ImpedanceAnalysis)
            return motion_parts(one, settings, windows or settings.windows)
        likeness = known if one is signals else Likeness(one.time, one["theta"], settings.protocol)
        segments = stepped_sine.find_segments(likeness)
        groups = cycles_of(segments, settings.settle_cycles, one.usable, bool(settings.protocol.amplitudes))
        hz = [stratum.frequency_hz for stratum in groups.strata]
        return groups, (min(hz), max(hz)), None, one

    try:
        groups, band, periodic, regular = parts_of(signals)
        made = conditioned(regular, settings, groups, band)
        if (again := regular.other()) is not None:
            groups, band, _, again = parts_of(again)
            made = replace(made, other=conditioned(again, settings, groups, band))
    except (InputError, IdentifiabilityError) as error:
        words = said_of_motion(str(error), known, signals) if auto and not is_other else str(error)
        words = said_of_noise(known, signals.rate_hz) or words
        raise type(error)(f"trial {trial.name}: {words}") from error
    if auto and not is_other and known.moves and known.kind == "unclear" and known.sines < stepped_sine.HARDLY:
        raise InputError(
            f"trial {trial.name}: theta has the commanded frequencies, but is no stepped sine; look for spikes, hum "
            f"and a mount that turns; {another_motion(known)}, or `excitation: stepped_sine` to fit what there is"
        )
    assert made.uniform is not None
    bare = []
    for one in made.uniform.taken:  # all but the signal that tells their rows: 0.1 GB of an hour
        first = {one.signals[0]: one.stream.signals[one.signals[0]]}
        bare.append(replace(one, stream=replace(one.stream, signals=first)))
    uniform = replace(made.uniform, taken=tuple(bare))
    return replace(made, periodic=periodic, steps=(steps[0], steps[1]), uniform=uniform)


def another_motion(known: Likeness) -> str:
    """What to state if a motion that is unlike a stepped sine was meant."""
    return (
        f"{100 * known.sines:.0f} % of the moving time are sines of one frequency: if another motion was meant, "
        "state `excitation: any` under `dynamometer` in the configuration, or its windows in the sheet"
    )


def said_of_noise(known: Likeness, rate_hz: float) -> str:
    """What is said of an angle whose rows hardly hang together, so that its motion does not count as such; nothing of
    another one. Motion up to 6 Hz jumps by a tenth, and counts for half of the time, at 50 rows per second."""
    noise, size = np.rad2deg(stepped_sine.noise_of(known.theta)), np.rad2deg(known.theta.std())
    if size < 0.5 or noise < 0.1 * size or known.moving.mean() > 0.5:
        return ""
    return (
        f"theta jumps from row to row by {noise:.2g} deg of its {size:.2g} deg RMS: it is noise, or {rate_hz:.3g} rows "
        "per second are too few for its motion; record 100 per second or more, or correct the channel of theta in the "
        "source file"
    )


def said_of_motion(words: str, known: Likeness, signals: UniformSignals) -> str:
    """The words of an error in a motion that the recording itself was to tell, with its cause where it is known."""
    degrees = np.rad2deg(np.ptp(signals["theta"]))
    if known.moves:
        return f"{words}; {another_motion(known)}" if known.kind == "unclear" else words
    if degrees > 1.0:  # beyond the noise of any encoder
        return (
            f"the joint moves too slowly: theta changes by {degrees:.3g} deg in all, but by no more than "
            f"{100 * stepped_sine.MOVING_SHARE:g} % of it, or its noise, within {stepped_sine.BIN_S:g} s; move it "
            "by 0.5 to 6 Hz, or take the stiffness alone by experiment 'torque_angle', or correct the unit of `time`: "
            f"it gives {signals.rate_hz:.3g} rows per second"
        )
    return (
        f"the joint does not move: theta turns by {degrees:.3g} deg in all; check the channel and the unit of "
        "theta in the source file, and that this is the recording of the trial"
    )


def with_actuator(record: Record, trial: Trial) -> Record:
    """The record with what the trial has of the actuator, if that comes to a time base with angle and torque."""
    same, rate = record.low_pass, record.rate_hz
    quick = replace(same, cutoff_hz=min(QUICK * same.cutoff_hz, 0.2 * rate))
    wanted = {"theta_m": ("theta_m", same), "quick": ("theta_m", quick), "current": ("current", same)}
    for names in (("theta_m", "quick", "current"), ("theta_m",)):
        if "theta_m" in trial.columns and all(wanted[name][0] in trial.columns for name in names):
            with suppress(InputError):
                return replace(record, actuator=logged(record, trial, {name: wanted[name] for name in names}))
    return record


def logged(record: Record, trial: Trial, wanted: Mapping[str, tuple[str, LowPass]]) -> dict[str, Array]:
    """Further columns of a trial at the times of the record: by the name that each is to have, column and filter.
    Raises InputError: one is not there, or its device's stamps do not come to a time base."""
    assert record.settings is not None
    columns, found = [column for column, _ in wanted.values()], dict[str, Array]()
    for device in devices_of(trial, list(dict.fromkeys(("theta", *columns, "torque")))):
        if own := {name: one for name, one in wanted.items() if one[0] in device}:
            made = uniform_signals(trial, device, record.settings.gap_limits, wanted=columns)
            filtered = {name: low_pass(made[column], made.rate_hz) for name, (column, low_pass) in own.items()}
            found |= resampled(made.time, filtered, record.time, 1 / made.rate_hz)
    return found


def motion_parts(signals: UniformSignals, settings: ImpedanceAnalysis, windows: str | None) -> Parts:
    """Groups and band of a motion that is no stepped sine, and its periods. The time base bridges gaps up to a tenth of
    a period of the fastest motion, which is found first: the signals with gaps that the motion bears."""
    low_pass, rate = settings.low_pass, signals.rate_hz
    compliance = settings.bench_stiffness.compliance if settings.bench_stiffness else 0.0
    time = signals.time - signals.time[0]
    stated = None if windows is None else stated_windows(windows, float(time[-1]))
    inside = np.any([(time >= start) & (time <= stop) for start, stop in stated or [(0.0, np.inf)]], axis=0)
    pieces = fitted_pieces(signals, low_pass, stated)
    theta = joint_angle(signals["theta"], signals["torque"], compliance)
    motion = filtered_motion(signals.time, theta, signals["torque"], low_pass)[0]
    stretches: list[slice] = []  # from the first to the last piece in each window, with the gaps between pieces
    for piece in pieces:
        if stretches and inside[stretches[-1].stop : piece.start].all():
            stretches[-1] = slice(stretches[-1].start, piece.stop)
        else:
            stretches.append(piece)
    band = band_of(motion, rate, stretches)
    if not signals.usable.all() or any(stream["bridged"] for stream in signals.streams):
        highest = min(band[1], settings.cutoff_hz)
        limits = GapLimits(highest, settings.cutoff_hz, settings.time_base.longest_gap_s)
        signals = on_one_grid(signals.taken, limits, signals.trial)
        pieces = fitted_pieces(signals, low_pass, stated)
        theta = joint_angle(signals["theta"], signals["torque"], compliance)
    rows = np.zeros(len(signals.time), dtype=bool)
    for piece in pieces:
        rows[piece] = True
    highest_line = 1.5 * low_pass.cutoff_hz
    periodic = periodic_motion(theta, signals["torque"], rate, highest_line, signals.usable & inside)
    found = None if periodic is None else periods_of(periodic, rate, rows)
    if periodic is not None:
        lines = np.flatnonzero(lines_of(periodic.realisations).excited)
        band = float(lines[0] / periodic.period), float(lines[-1] / periodic.period)
    return found or stretches_of(pieces, rate), band, periodic, signals


def conditioned(
    signals: UniformSignals, settings: SteppedSineAnalysis, groups: Groups, band: tuple[float, float]
) -> Record:
    """The record of these groups, and the same with a bench that is softer by one standard error."""
    bench = settings.bench_stiffness

    def on(compliance: float) -> Record:
        raw = signals["theta"], signals["torque"]
        made = record_of(signals.trial, signals.time, *raw, settings.low_pass, groups, compliance)
        return replace(made, usable=signals.usable, band_hz=band, settings=settings)

    made = replace(on(bench.compliance if bench else 0.0), uniform=signals)
    if bench is None or not bench.compliance_error:
        return made
    return replace(made, softer=on(bench.compliance + bench.compliance_error))


def record_of(
    name: str, time: Array, theta: Array, torque: Array, low_pass: LowPass, groups: Groups, compliance: float = 0.0
) -> Record:
    """The record of uniform raw signals (n,): angle of the bench [rad] and torque [N*m], which may drift."""
    joint = joint_angle(theta, torque, compliance)
    motion, filtered = filtered_motion(time, joint, torque, low_pass)
    drift = drift_rate(time, motion, filtered, groups)
    drifted = drift * (time - time.mean())  # the mean over all samples is kept
    torque, filtered = torque - drifted, filtered - drifted
    if compliance and drift:  # what the drift turned the frame by is no angle of the joint
        joint = joint_angle(theta, torque, compliance)
        motion = filtered_motion(time, joint, torque, low_pass)[0]
    everywhere = np.ones(len(time), dtype=np.bool_)
    return Record(name, time, joint, torque, motion, filtered, low_pass, everywhere, groups, drift=drift)


def drift_rate(time: Array, motion: Motion, torque: Array, groups: Groups) -> float:
    """Drift of the load cell [N*m/s]: the slope in time that the mean torques of groups have beside Eq. 15.

    A drift of 0.05 N*m/min that is not subtracted is a tenth of the error of K at 1 Hz. It is the same in every cycle,
    so that the spread between cycles does not contain it. Each label has a mean torque of its own: that of an
    asymmetric joint grows with the amplitude, and amplitudes may grow with time. Of a sine only the means of its cycles
    count. The drift is 0 if no label has the five groups that an interval needs: transients could pass for drift."""
    members = np.array([np.count_nonzero(groups.of(label)) for label in groups.labels])
    if members.max() < FEWEST_CYCLES:
        return 0.0
    ramp = time - time.mean()
    if groups.kind == "cycles":
        signals = np.column_stack([ramp, motion.theta, torque])
        sums = products_between(signals, np.ones((len(signals), 1)), groups.first, groups.stop)[..., 0]
        weight = np.sqrt(groups.stop - groups.first)[:, None]
        label = np.array([groups.labels.index(groups.strata[k].label) for k in groups.stratum])
        enough = np.flatnonzero(members >= FEWEST_CYCLES)
        own = np.where(label[:, None] == enough, weight, 0.0)
        X, y = np.column_stack([sums[:, :2] / weight, own]), sums[:, 2] / weight[:, 0]
        X, y = X[own.any(axis=1)], y[own.any(axis=1)]
    else:
        X = np.column_stack([ramp, motion.theta, motion.omega, motion.alpha, np.ones_like(ramp)])
        rows = np.concatenate([np.r_[piece] for piece in groups.pieces[None]])
        X, y = X[rows], torque[rows]
    scale = np.linalg.norm(X, axis=0)
    scale[scale == 0] = 1.0
    return float(np.linalg.lstsq(X / scale, y, rcond=1e-9)[0][0] / scale[0])


def fitted_pieces(
    signals: UniformSignals, low_pass: LowPass, stated: list[tuple[float, float]] | None
) -> tuple[slice, ...]:
    """Rows of the stretches that are fitted: in stated windows [s], or from the first to the last motion, without two
    periods of the cut-off at their ends, 130 ms at 15 Hz. The ends of a record, filtered with an invented continuation,
    would change K by 0.05 % and I by 0.4 %. Raises InputError: nothing moves, or for long enough."""
    time = signals.time - signals.time[0]
    if stated is None:
        moving = stepped_sine.moving_bins(time, signals["theta"])
        if not moving.any():
            raise InputError(NOT_MOVED)
        stated = [(float(time[np.argmax(moving)]), float(time[len(moving) - 1 - np.argmax(moving[::-1])]))]
    inside = np.zeros(len(time), dtype=bool)
    edge = 2.0 / low_pass.cutoff_hz
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


def stated_windows(text: str, duration: float) -> list[tuple[float, float]]:
    """Windows [s] from the start of a record of some duration [s], stated as `2-30 40-62`. Raises InputError if
    they are not windows, overlap, or lie beyond the record."""
    windows = stretches(text)
    if windows[-1][1] > duration + 1.0:
        raise InputError(f"windows '{text}' end at {windows[-1][1]:g} s, the record after {duration:.1f} s")
    return windows


def band_of(motion: Motion, rate_hz: float, stretches: Sequence[slice]) -> tuple[float, float]:
    """Lowest and highest frequency [Hz] of a motion (n,): 1 % of the angle's power lies below, of the acceleration's
    above. Its spectrum is the mean over the stretches, in which gaps are bridged, in pieces of 8 s or less."""
    length = min(round(8.0 * rate_hz), *(one.stop - one.start for one in stretches))
    f, low, high = np.empty(0), np.zeros(length // 2 + 1), np.zeros(length // 2 + 1)
    for one in stretches:
        weight = one.stop - one.start
        f, angle = scipy.signal.welch(motion.theta[one], rate_hz, nperseg=length)
        low += weight * angle
        high += weight * scipy.signal.welch(motion.alpha[one], rate_hz, nperseg=length)[1]
    below, up_to = np.cumsum(low[1:]), np.cumsum(high[1:])
    if not below[-1] > 0 or not up_to[-1] > 0:
        raise InputError(NOT_MOVED)
    return float(f[1:][np.argmax(below > 0.01 * below[-1])]), float(f[1:][np.argmax(up_to > 0.99 * up_to[-1])])
