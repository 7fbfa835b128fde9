"""One record for every motion: uniform signals, the motion behind one low-pass, and groups of rows.

Only the three makers of groups differ between motions: cycles of a stepped sine, parts of the
periods of a periodic motion, and stretches of any other. Later stages know groups only."""

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
from osl_analysis.inference import BenchSignals
from osl_analysis.measured import visible_step
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
from osl_analysis.trial import Array, Trial, stretches

Label = float | str | None
"""What has a fit of its own: an amplitude [deg], a branch of a belt; None: the whole record."""
STRETCH_S = 1.0  # duration [s] of a stretch: 30 correlation times of a 15 Hz low-pass
# cut-offs of the low-pass for the velocity's sign, and for draws of the rounding of steps
QUICK = 4.0
# time to come to a level, in multiples of a rounded signal's last step: exponentially 2, least jerk
# 2.3
COMES = 3.0
BEYOND = 1.1  # cut-offs above which the band's end is motion, not the tail of a faster step
STANDS = 0.1  # share of the SD of the speed below which a joint stands
QUIET = 0.3  # share of the parts of 50 samples that hold noise alone above the motion's frequencies
# share of the power at a few levels above which a motion steps between these (sines 0.05, steps
# 0.2)
AT_LEVELS = 0.15
# range [steps] of the drawn sizes of a sine: less varies too little if samples keep step with it
OF_SINE = 0.5
DRAWS = (np.arange(17) + 0.5) / 17 - 0.5  # shifts of an encoder's zero and of sizes, in steps
ALIKE_S = 0.25  # time [s] over which a model's misfit is correlated
SHORTEST_S = 1.0  # shortest stretch [s] that is fitted
IDLE = 0.05  # share of the joint's angle (SD): backlash and errors of encoders reach that
NOT_MOVED = "the joint does not move; check the channel of theta in the source file"


@dataclass(frozen=True)
class Stratum:
    """A set of groups that repeat one another; if nothing repeats, the set of all groups."""

    rows: slice  # rows of their motion, with its transient
    label: Label = None
    frequency_hz: float = np.nan  # of a sine [Hz]
    commanded_deg: float | None = None  # amplitude [deg] of the sine in the protocol


@dataclass(frozen=True)
class Groups:
    """Groups of consecutive rows of a record; a group ends where the next one begins, or
    earlier."""

    kind: Literal["cycles", "periods", "stretches"]
    first: Array  # row at which each group begins, may be fractional, (m,)
    stop: Array  # where it ends, (m,)
    stratum: NDArray[np.intp]  # index of each group's stratum, from 0, (m,)
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
        """Rows of each label's groups in order of time, with adjacent ones joined; None: of all
        groups."""
        edges = zip(self.first.tolist(), self.stop.tolist(), strict=True)
        rows = [whole_rows(first, stop) for first, stop in edges]
        return {
            label: joined(list(compress(rows, self.of(label)))) for label in (None, *self.labels)
        }


def joined(parts: Sequence[slice], apart: int = 0) -> list[slice]:
    """Parts of a recording in order of time; parts that touch, or lie at most `apart` rows apart,
    are joined."""
    found: list[slice] = []
    for rows in sorted(parts, key=lambda rows: rows.start):
        if found and rows.start <= found[-1].stop + apart:
            found[-1] = slice(found[-1].start, max(rows.stop, found[-1].stop))
        else:
            found.append(rows)
    return found


def before_rounding(read: Array, step: float) -> Array:
    """A signal (n,) before its rounding to steps: halfway between two steps where it goes from one
    to the next. It comes to a level, and leaves it, in `COMES` times the time of the adjacent
    step."""
    at = np.flatnonzero(np.abs(np.diff(read)) > 0.3 * step)
    way, gap, level = np.diff(read)[at] > 0, np.diff(at), read[at + 1]
    turns = np.flatnonzero(way[1:] != way[:-1])
    before, own, after = (np.r_[np.inf, gap, np.inf][turns + k] for k in range(3))
    comes, leaves = (at[turns + k] + 0.5 for k in range(2))
    comes, leaves = (
        comes + np.minimum(COMES * before, 0.45 * own),
        leaves - np.minimum(COMES * after, 0.45 * own),
    )
    place = np.r_[0, at + 0.5, comes, leaves, len(read) - 1]
    value = np.r_[read[0], (read[at] + level) / 2, level[turns], level[turns], read[-1]]
    order = np.argsort(place)
    return np.asarray(np.interp(np.arange(len(read)), place[order], value[order]))


@dataclass(frozen=True)
class Record:
    """Signals of one trial on the dynamometer, shape (n,) each, and the groups of rows that are
    fitted."""

    name: str  # name of the trial
    time: Array  # uniform times [s]
    theta: Array  # angle of the joint [rad], without the deflection of the bench
    torque: Array  # raw resisting torque [N*m], less the load cell's drift
    motion: Motion  # filtered joint angle with its derivatives
    filtered_torque: Array  # the torque through the same filter [N*m]
    low_pass: LowPass  # filter of angle and torque
    usable: NDArray[np.bool_]  # rows that are not near a gap in the recording
    groups: Groups
    # lowest and highest frequency [Hz] of the motion
    band_hz: tuple[float, float] = (np.nan, np.nan)
    drift: float = 0.0  # drift of the load cell [N*m/s] that was subtracted from the torque
    steps: tuple[float | None, float | None] = (None, None)
    """Resolution of angle [rad] and torque [N*m]; None: not known."""
    periodic: PeriodicMotion | None = None  # periods of a periodic motion
    uniform: UniformSignals | None = None
    """The signals on their time base, with what the recorders did; None for a record that no file
    holds."""
    # the same with the other reading of undecided stamps; None: all are decided
    other: "Record | None" = None
    # the same on a bench softer by one standard error; None: its stiffness is exact
    softer: "Record | None" = None
    settings: BenchAnalysis | None = None  # the bench, and limits on the motion
    actuator: Mapping[str, Array] = field(default_factory=dict)
    """If requested, the actuator's filtered angle `theta_m` [rad] and `current` [A]; `quick` is the
    angle for the velocity's sign."""

    @property
    def bench(self) -> BenchStiffness | None:
        """Stiffness of the bench; None: it is rigid."""
        return self.settings.bench_stiffness if self.settings else None

    @property
    def calibration(self) -> Calibration:
        """Uncertainties of angle and torque."""
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
        """Raw angle of the bench (n,) [rad]; equals the joint's if the bench is rigid."""
        return self.theta if self.bench is None or self.uniform is None else self.uniform["theta"]

    @cached_property
    def noise(self) -> tuple[float, float]:
        """Densities of the noise of angle [rad^2/Hz] and torque [N^2 m^2/Hz], taken as white:
        medians from two to four cut-offs of what the filter removes in the fitted rows. If the
        motion itself reaches these frequencies, the angle's density is its level at the highest
        frequencies."""
        welch = partial(scipy.signal.welch, fs=self.rate_hz, noverlap=0, detrend=False)
        length = min(round(self.rate_hz), self.samples)
        pairs = (self.theta, self.motion.theta), (self.torque, self.filtered_torque)
        (f, angle), (_, torque) = (
            welch(self.part(raw - smooth), nperseg=length) for raw, smooth in pairs
        )
        power = np.array([angle, torque])
        highest = min(4 * self.low_pass.cutoff_hz, 0.45 * self.rate_hz)
        beyond = (f > min(2 * self.low_pass.cutoff_hz, 0.8 * highest)) & (f < highest)
        of_theta, of_torque = np.median(power[:, beyond], axis=1) if beyond.any() else (0.0, 0.0)
        highest_of_all = float(np.median(power[0, f > 0.35 * self.rate_hz]))
        return highest_of_all if highest_of_all < 0.3 * of_theta else float(of_theta), float(
            of_torque
        )

    @cached_property
    def repeated_steps(self) -> list[tuple[float, float]]:
        """Steps of angle [rad] and torque [N*m], and the share of their rounding error that all
        cycles repeat: noise of s steps before rounding leaves exp(-(2 pi s)^2/2) of it (Widrow and
        Kollar, Quantization Noise, 2008, ch. 5)."""
        found = list[tuple[float, float]]()
        for step, density, raw in zip(
            self.steps, self.noise, (self.theta, self.torque), strict=True
        ):
            # rounding of slow motion is not white, and fast motion is no noise: third differences
            # take off what is slower than some samples, and in the quietest parts the motion is at
            # a level
            jumps = np.diff(self.part(raw), 3) ** 2 / 20
            quiet = np.quantile(
                np.add.reduceat(jumps, np.arange(0, len(jumps) - 1, 50)) / 50, QUIET
            )
            variance = min(density * self.rate_hz / 2, float(quiet))
            # [steps^2]
            noise = max(variance / step**2 - 1 / 12, 0.0) if step and step**2 else np.inf
            # above 0.1 steps^2 less than a fiftieth of the variance that cycles repeat is left
            found.append(
                (step or 0.0, float(np.exp(-2 * np.pi**2 * noise)) if noise < 0.1 else 0.0)
            )
        return found

    def roundings(self, channel: int, rows: slice = slice(None)) -> Iterator[Array]:
        """Rounding errors (n,) of angle [rad] (0) or torque [N*m] (1) in some rows, one per draw of
        the sensor's zero; none if noise hides them. Motions that return to the same places, levels
        and sines, vary in size, too: levels, whose errors are independent, by the concentration of
        power in single levels. In steps between few levels the errors depend on how the joint
        reaches a level, which every step repeats and nobody knows. Draws then alternate between two
        signals: the one behind a filter `QUICK` times as quick, whose levels ring by some steps
        (alone it accuses sound steps), and the reconstruction before the encoder (alone it makes I
        too certain)."""
        (step, left), raw = self.repeated_steps[channel], (self.theta, self.torque)[channel]
        if not left:
            return
        speed, signal = (
            np.abs(self.motion.omega[rows]),
            (self.motion.theta, self.filtered_torque)[channel][rows],
        )
        stands = speed < STANDS * float(np.std(self.motion.omega[rows]))
        # raw, since levels of the filtered signal ring by many steps of 18 bits
        place = raw[rows] - raw[rows].mean()
        _, level = np.unique(np.rint(place[stands] / step), return_inverse=True)
        larger = float(np.linalg.norm(np.bincount(level, place[stands] ** 2))) / max(
            float(place @ place), step**2
        )
        signals = [signal]
        if larger > AT_LEVELS:
            quick = replace(self.low_pass, cutoff_hz=QUICK * self.low_pass.cutoff_hz)
            signals = [quick(raw[rows], self.rate_hz), before_rounding(raw[rows], step)]
        every = [(one - one.mean()) / step for one in signals]
        more = max(larger, OF_SINE * self.is_stepped_sine) * DRAWS[5 * np.arange(17) % 17]
        for k, (zero, share) in enumerate(
            zip(DRAWS, more / float(np.abs(every).max()), strict=True)
        ):
            read = every[k % len(every)] * (1 + share) + zero
            yield left * step * (read - np.rint(read))

    def coarse_roundings(self, channel: int) -> Iterator[Array]:
        """The `roundings` of all rows, through the fit's filter, in the rows of `coarse`."""
        few, every = self.coarse, round(self.rate_hz / self.coarse.rate_hz)
        first = np.maximum(np.arange(len(few.time)) * every - every // 2, 0)
        return (
            few.low_pass(np.add.reduceat(x, first) / every, few.rate_hz)
            for x in self.roundings(channel)
        )

    @cached_property
    def rounded(self) -> Array | None:
        """Torques (k, n) [N*m] that the `roundings` cause in Eq. 15, in the rows of `coarse`. None
        if noise hides the rounding, or if one equal in all samples is less than half of the
        residual's standard error."""
        few = self.coarse
        motion = np.array(
            [few.part(x) for x in (few.motion.theta, few.motion.omega, few.motion.alpha)]
        )
        motion -= motion.mean(axis=1, keepdims=True)
        K, B, I = np.linalg.lstsq(
            motion @ motion.T, motion @ few.part(few.filtered_torque), rcond=1e-13
        )[0]
        left = np.var(few.part(few.filtered_torque) - np.array([K, B, I]) @ motion)
        samples = 2 * self.low_pass.noise_bandwidth_hz * self.seconds  # independent ones
        of_theta, of_torque = (step * share for step, share in self.repeated_steps)
        s = 2j * np.pi * self.band_hz[1]
        if (
            left / samples
            >= 4 * ((max(abs(K), abs(K + B * s + I * s**2)) * of_theta) ** 2 + of_torque**2) / 12
        ):
            return None
        thetas, torques = (list(self.coarse_roundings(k)) for k in (0, 1))
        if not thetas:
            return np.array(torques) if torques else None
        made = np.empty((len(thetas), len(few.time)))
        # one at a time: together they take 0.4 GB per hour
        for row, theta in zip(made, thetas, strict=True):
            omega = np.gradient(theta, 1 / few.rate_hz)
            row[:] = K * theta + B * omega + I * np.gradient(omega, 1 / few.rate_hz)
        for row, torque in zip(made, torques, strict=False):
            row -= torque
        return made

    @cached_property
    def pieces(self) -> tuple[slice, ...]:
        """The fitted rows."""
        return tuple(self.groups.pieces[None])

    @cached_property
    def samples(self) -> int:
        """Number m of fitted rows."""
        return sum(piece.stop - piece.start for piece in self.pieces)

    @property
    def seconds(self) -> float:
        return self.samples / self.rate_hz

    def thinned(self, step: int) -> "Record":
        """Every `step`-th row of the filtered signals, with the same groups; the torque is the
        filtered one."""
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
        """The record at 250 Hz, or eight cut-offs if more: its filtered signals contain nothing
        faster."""
        at_least = max(250.0, 8 * self.low_pass.cutoff_hz)
        # rates are known to within rounding
        return self.thinned(max(int(self.rate_hz / at_least + 1e-6), 1))

    @property
    def swift_omega(self) -> Array:
        """Velocity [rad/s] in the rows of `coarse`, for the sign of friction. If the motion exceeds
        the fit's cut-off, the filter is one that passes it: the sign of a slower signal changes at
        other times."""
        few, highest = self.coarse, self.band_hz[1]
        if not highest > BEYOND * self.low_pass.cutoff_hz:
            return few.motion.omega
        swift = replace(self.low_pass, cutoff_hz=min(2 * highest, 0.2 * self.rate_hz))
        theta = swift(self.theta, self.rate_hz)[:: round(self.rate_hz / few.rate_hz)]
        return np.asarray(np.gradient(theta, 1 / few.rate_hz))

    def rows(self, label: Label = None) -> NDArray[np.intp]:
        """The fitted rows (m,) of a label or of all, each once."""
        return np.concatenate([np.r_[piece] for piece in self.groups.pieces[label]])

    def part(self, signal: Array) -> Array:
        """A signal (n,) in the fitted rows (m,); a view if they are contiguous."""
        parts = [signal[piece] for piece in self.pieces]
        return parts[0] if len(parts) == 1 else np.concatenate(parts)

    def moving(self, label: Label = None) -> list[slice]:
        """Rows of a label's motion, with its transients; stretches that touch are joined."""
        return joined(
            [one.rows for one in self.groups.strata if label is None or one.label == label], apart=1
        )

    def label_near(self, amplitude_deg: float | None) -> Label:
        """The label near an amplitude [deg], commanded or measured; None: the largest. Raises
        InputError: none is near."""
        of = {
            x: one.commanded_deg or x
            for one in self.groups.strata
            if isinstance(x := one.label, float)
        }
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


def actuator_turns(record: Record) -> bool:
    """Whether an actuator turns with the joint, as that of a leg does: an idle motor beside a joint
    turns less."""
    theta_m = record.actuator.get("theta_m")
    return theta_m is not None and float(np.std(theta_m)) > IDLE * float(np.std(record.theta))


def signals_of(record: Record, has_drivetrain: bool = False) -> BenchSignals:
    """What the inference is given of a record: the raw signals, since it finds their band itself.

    Parameters
    ----------
    record : Record
        Angle and torque of a trial.
    has_drivetrain : bool
        Whether a belt and an actuator render the joint. Its friction then opposes the actuator's
        velocity and grows with the current.
    """
    # the ends of fitted stretches are left out for the sake of the fit's own filter
    edge = round(2 * record.rate_hz / record.low_pass.cutoff_hz)
    inside = np.zeros(len(record.time), dtype=np.bool_)
    for rows in record.pieces:
        inside[max(rows.start - edge, 0) : rows.stop + edge] = True
    return BenchSignals(
        theta=record.theta,
        torque=record.torque if record.uniform is None else record.uniform["torque"],
        rate_hz=record.rate_hz,
        encoder_step=record.steps[0] or 0.0,
        usable=record.usable & inside,
        sliding_angle=record.actuator.get("quick") if has_drivetrain else None,
        load=record.actuator.get("current") if has_drivetrain else None,
        has_drivetrain=has_drivetrain,
    )


def stored_record(record: Record) -> pl.DataFrame:
    """Table for comparison with a drivetrain model, one row per sample: angle of the joint,
    filtered torque, whether the row is fitted, and the frequency [Hz] of its sine if it is, else
    NaN."""
    fitted, hz = np.zeros(len(record.time), dtype=np.bool_), np.full(len(record.time), np.nan)
    fitted[record.rows()] = True
    for one in record.groups.strata:
        hz[one.rows] = np.where(fitted[one.rows], one.frequency_hz, np.nan)
    signals = {"time": record.time, "theta": record.theta, "torque": record.filtered_torque}
    return pl.DataFrame({**signals, "fitted": fitted, "frequency_hz": hz})


def read_record(path: Path, low_pass: LowPass) -> Record:
    """A stored record, whose torque is the filtered one; each stratum is a stretch of rows."""
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
    """Angle of the joint (n,) [rad] from the bench's: the bench turns the joint through its frame
    of some `compliance` [rad/(N*m)], which the resisting torque [N*m] deflects: theta_bench = theta
    + torque/k."""
    return theta - compliance * torque if compliance else theta


def cycles_of(
    segments: Sequence[stepped_sine.Segment],
    settle_cycles: int,
    usable: NDArray[np.bool_],
    stated: bool = True,
) -> Groups:
    """The settled, usable cycles of segments; a stratum is a segment. Commanded amplitudes count
    only if `stated`."""
    kept = [stepped_sine.settled_cycles(segment, settle_cycles, usable) for segment in segments]
    strata = []
    for whole, label in zip(segments, stepped_sine.labels_deg(segments), strict=True):
        meant = (
            None
            if whole.commanded is None or not stated
            else round(float(np.rad2deg(whole.commanded)), 9)
        )
        strata.append(Stratum(whole.rows, label, whole.frequency_hz, meant))
    first, stop = np.concatenate(kept).T
    number = np.repeat(np.arange(len(kept)), [len(one) for one in kept])
    return Groups("cycles", first, np.minimum(stop, len(usable)), number, tuple(strata))


def periods_of(
    motion: PeriodicMotion, rate_hz: float, usable: NDArray[np.bool_], seconds: float = ALIKE_S
) -> Groups | None:
    """Groups of about `seconds` within each period; the same part of each period of a realisation
    is one stratum. None if fewer than two periods are usable. Noise is correlated for much less
    than `ALIKE_S`."""
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


def stretches_of(
    pieces: Sequence[slice], rate_hz: float, seconds: float = STRETCH_S, label: Label = None
) -> Groups:
    """Equal stretches of about `seconds` of each piece; all are one stratum, without repeats."""
    edges = [
        np.linspace(
            piece.start,
            piece.stop,
            max(round((piece.stop - piece.start) / (seconds * rate_hz)), 1) + 1,
        )
        for piece in pieces
    ]
    first, stop = np.concatenate([e[:-1] for e in edges]), np.concatenate([e[1:] for e in edges])
    whole = Stratum(slice(pieces[0].start, pieces[-1].stop), label)
    return Groups("stretches", first, stop, np.zeros(len(first), dtype=np.intp), (whole,))


Parts = tuple[Groups, tuple[float, float], PeriodicMotion | None, UniformSignals]
"""Groups, band [Hz] and periods of a motion, and its signals."""


def sine_record(trial: Trial, settings: SteppedSineAnalysis) -> Record:
    """The record of a trial that follows a stepped sine; raises as `record_of_trial`."""
    return record_of_trial(trial, settings, excitation="stepped_sine")


def record_of_trial(
    trial: Trial,
    settings: SteppedSineAnalysis,
    windows: str | None = None,
    excitation: str | None = None,
) -> Record:
    """The record of a trial.

    `excitation`, by default from the settings, is the kind of motion; `auto` decides by the
    recording. In a stepped sine half of the moving time or more is sines of one frequency; another
    motion has hardly any, and not in the commanded order. In between, the stepped sine may be
    damaged: the error names the setting by which it is fitted as another motion, or as a stepped
    sine. `windows` [s] state that it is another motion, and which part is fitted.

    Raises InputError: a signal is missing, has no time base, does not move, or follows a damaged
    protocol."""
    signals = uniform_signals(
        trial, ("theta", "torque"), settings.gap_limits, computed=("theta_command",)
    )
    steps = list[float | None]()
    for column in ("theta", "torque"):  # what the source file states, else what the values show
        stated, taken = origin(trial, column).get("resolution"), signals.of(column)
        steps.append(
            float(stated) if stated else visible_step(taken.stream.signals[column][taken.present])
        )
    if excitation is None:
        excitation = (
            settings.excitation if isinstance(settings, ImpedanceAnalysis) else "stepped_sine"
        )
    known = Likeness(signals.time, signals["theta"], settings.protocol)
    auto, is_other = excitation == "auto", excitation == "any"
    is_other |= auto and (bool(windows) or known.kind == "other")

    def parts_of(one: UniformSignals) -> Parts:
        if is_other:
            assert isinstance(settings, ImpedanceAnalysis)
            return motion_parts(one, settings, windows or settings.windows)
        likeness = known if one is signals else Likeness(one.time, one["theta"], settings.protocol)
        segments = stepped_sine.find_segments(likeness)
        groups = cycles_of(
            segments, settings.settle_cycles, one.usable, bool(settings.protocol.amplitudes)
        )
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
    if (
        auto
        and not is_other
        and known.moves
        and known.kind == "unclear"
        and known.sines < stepped_sine.HARDLY
    ):
        raise InputError(
            f"trial {trial.name}: theta has the commanded frequencies, but is no stepped sine; look"
            f" for spikes, hum and a mount that turns; {another_motion(known)}, or `excitation:"
            " stepped_sine` to fit what there is"
        )
    assert made.uniform is not None
    bare = []
    # keeps only the signal that tells the rows: saves 0.1 GB per hour
    for one in made.uniform.taken:
        first = {one.signals[0]: one.stream.signals[one.signals[0]]}
        bare.append(replace(one, stream=replace(one.stream, signals=first)))
    uniform = replace(made.uniform, taken=tuple(bare))
    return replace(made, periodic=periodic, steps=(steps[0], steps[1]), uniform=uniform)


def another_motion(known: Likeness) -> str:
    """What to state if another motion than a stepped sine was meant."""
    return (
        f"{100 * known.sines:.0f} % of the moving time are sines of one frequency: if another"
        " motion was meant, state `excitation: any` under `dynamometer` in the configuration, or"
        " its windows in the sheet"
    )


def said_of_noise(known: Likeness, rate_hz: float) -> str:
    """Words on an angle too noisy for its motion to count as such; empty for any other. Motion up
    to 6 Hz at 50 rows per second jumps by a tenth, and counts for half of the time."""
    noise, size = np.rad2deg(stepped_sine.noise_of(known.theta)), np.rad2deg(known.theta.std())
    if size < 0.5 or noise < 0.1 * size or known.moving.mean() > 0.5:
        return ""
    return (
        f"theta jumps from row to row by {noise:.2g} deg of its {size:.2g} deg RMS: it is noise, or"
        f" {rate_hz:.3g} rows per second are too few for its motion; record 100 per second or more,"
        " or correct the channel of theta in the source file"
    )


def said_of_motion(words: str, known: Likeness, signals: UniformSignals) -> str:
    """The words of an error of a motion whose kind was to be read from the recording, with the
    cause if it is known."""
    degrees = np.rad2deg(np.ptp(signals["theta"]))
    if known.moves:
        return f"{words}; {another_motion(known)}" if known.kind == "unclear" else words
    if degrees > 1.0:  # beyond the noise of any encoder
        return (
            f"the joint moves too slowly: theta changes by {degrees:.3g} deg in all, but by no more"
            f" than {100 * stepped_sine.MOVING_SHARE:g} % of it, or its noise, within"
            f" {stepped_sine.BIN_S:g} s; move it by 0.5 to 6 Hz, or take the stiffness alone by"
            " experiment 'torque_angle', or correct the unit of `time`: it gives"
            f" {signals.rate_hz:.3g} rows per second"
        )
    return (
        f"the joint does not move: theta turns by {degrees:.3g} deg in all; check the channel and"
        " the unit of theta in the source file, and that this is the recording of the trial"
    )


def with_actuator(record: Record, trial: Trial) -> Record:
    """The record with the trial's actuator signals, if they come to a time base with angle and
    torque."""
    same, rate = record.low_pass, record.rate_hz
    quick = replace(same, cutoff_hz=min(QUICK * same.cutoff_hz, 0.2 * rate))
    wanted = {
        "theta_m": ("theta_m", same),
        "quick": ("theta_m", quick),
        "current": ("current", same),
    }
    for names in (("theta_m", "quick", "current"), ("theta_m",)):
        if "theta_m" in trial.columns and all(wanted[name][0] in trial.columns for name in names):
            with suppress(InputError):
                return replace(
                    record, actuator=logged(record, trial, {name: wanted[name] for name in names})
                )
    return record


def logged(
    record: Record, trial: Trial, wanted: Mapping[str, tuple[str, LowPass]]
) -> dict[str, Array]:
    """Further columns of a trial at the times of the record, given as column and filter by new
    name. Raises InputError: a column is missing, or its device's stamps do not come to a time
    base."""
    assert record.settings is not None
    columns, found = [column for column, _ in wanted.values()], dict[str, Array]()
    for device in devices_of(trial, list(dict.fromkeys(("theta", *columns, "torque")))):
        if own := {name: one for name, one in wanted.items() if one[0] in device}:
            made = uniform_signals(trial, device, record.settings.gap_limits, wanted=columns)
            filtered = {
                name: low_pass(made[column], made.rate_hz)
                for name, (column, low_pass) in own.items()
            }
            found |= resampled(made.time, filtered, record.time, 1 / made.rate_hz)
    return found


def motion_parts(
    signals: UniformSignals, settings: ImpedanceAnalysis, windows: str | None
) -> Parts:
    """Groups, band and periods of a motion that is no stepped sine, and its signals. The time base
    bridges gaps up to a tenth of a period of the fastest motion. That is found first, from the
    signals as they are."""
    low_pass, rate = settings.low_pass, signals.rate_hz
    compliance = settings.bench_stiffness.compliance if settings.bench_stiffness else 0.0
    time = signals.time - signals.time[0]
    stated = None if windows is None else stated_windows(windows, float(time[-1]))
    inside = np.any(
        [(time >= start) & (time <= stop) for start, stop in stated or [(0.0, np.inf)]], axis=0
    )
    pieces = fitted_pieces(signals, low_pass, stated)
    theta = joint_angle(signals["theta"], signals["torque"], compliance)
    motion = filtered_motion(signals.time, theta, signals["torque"], low_pass)[0]
    stretches: list[slice] = []  # first to last piece in each window, with gaps
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
    periodic = periodic_motion(
        theta, signals["torque"], rate, highest_line, signals.usable & inside
    )
    found = None if periodic is None else periods_of(periodic, rate, rows)
    if periodic is not None:
        lines = np.flatnonzero(lines_of(periodic.realisations).excited)
        band = float(lines[0] / periodic.period), float(lines[-1] / periodic.period)
    return found or stretches_of(pieces, rate), band, periodic, signals


def conditioned(
    signals: UniformSignals,
    settings: SteppedSineAnalysis,
    groups: Groups,
    band: tuple[float, float],
) -> Record:
    """The record of these groups, and the same on a bench softer by one standard error."""
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
    name: str,
    time: Array,
    theta: Array,
    torque: Array,
    low_pass: LowPass,
    groups: Groups,
    compliance: float = 0.0,
) -> Record:
    """The record of uniform raw signals (n,): angle of the bench [rad] and torque [N*m], which may
    drift."""
    joint = joint_angle(theta, torque, compliance)
    motion, filtered = filtered_motion(time, joint, torque, low_pass)
    drift = drift_rate(time, motion, filtered, groups)
    drifted = drift * (time - time.mean())  # keeps the mean over all samples
    torque, filtered = torque - drifted, filtered - drifted
    if compliance and drift:  # drift of the load cell does not turn the frame
        joint = joint_angle(theta, torque, compliance)
        motion = filtered_motion(time, joint, torque, low_pass)[0]
    everywhere = np.ones(len(time), dtype=np.bool_)
    return Record(
        name, time, joint, torque, motion, filtered, low_pass, everywhere, groups, drift=drift
    )


def drift_rate(time: Array, motion: Motion, torque: Array, groups: Groups) -> float:
    """Drift of the load cell [N*m/s]: the slope in time of the groups' mean torques beside Eq. 15.

    At 1 Hz a drift of 0.05 N*m/min would be a tenth of the error of K. All cycles share it, so that
    their spread does not show it. Each label has its own mean torque: an asymmetric joint's grows
    with the amplitude, and amplitudes may grow with time. For sines only the means of cycles count.
    The drift is 0 if no label has the five groups that an interval needs: transients could pass for
    drift."""
    members = np.array([np.count_nonzero(groups.of(label)) for label in groups.labels])
    if members.max() < FEWEST_CYCLES:
        return 0.0
    ramp = time - time.mean()
    if groups.kind == "cycles":
        signals = np.column_stack([ramp, motion.theta, torque])
        sums = products_between(signals, np.ones((len(signals), 1)), groups.first, groups.stop)[
            ..., 0
        ]
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
    """Rows of the fitted stretches: stated windows [s], or from the first to the last motion, less
    two periods of the cut-off at each end (130 ms at 15 Hz). Near the ends the filter depends on
    padding, which would change K by 0.05 % and I by 0.4 %. Raises InputError: nothing moves, or not
    for long enough."""
    time = signals.time - signals.time[0]
    if stated is None:
        moving = stepped_sine.moving_bins(time, signals["theta"])
        if not moving.any():
            raise InputError(NOT_MOVED)
        stated = [
            (float(time[np.argmax(moving)]), float(time[len(moving) - 1 - np.argmax(moving[::-1])]))
        ]
    inside = np.zeros(len(time), dtype=bool)
    edge = 2.0 / low_pass.cutoff_hz
    for start, stop in stated:
        inside |= (time >= start + edge) & (time <= stop - edge)
    shortest = SHORTEST_S * signals.rate_hz
    found = tuple(run for run in runs(inside & signals.usable) if run.stop - run.start >= shortest)
    if not found:
        raise InputError(
            f"nothing is left to fit: the joint moves for {sum(b - a for a, b in stated):.3g} s, of"
            f" which {edge:.2g} s at each end and rows near gaps do not count, and stretches need"
            f" {SHORTEST_S:g} s; record for longer"
        )
    return found


def stated_windows(text: str, duration: float) -> list[tuple[float, float]]:
    """Windows [s] from the start of a record of some duration [s], stated as `2-30 40-62`. Raises
    InputError if they are not windows, overlap, or lie beyond the record."""
    windows = stretches(text)
    if windows[-1][1] > duration + 1.0:
        raise InputError(
            f"windows '{text}' end at {windows[-1][1]:g} s, the record after {duration:.1f} s"
        )
    return windows


def band_of(motion: Motion, rate_hz: float, stretches: Sequence[slice]) -> tuple[float, float]:
    """Lowest and highest frequency [Hz] of a motion (n,): 1 % of the angle's power is below the
    first, 1 % of the acceleration's above the second. Spectra are means over the stretches, gaps
    bridged, in pieces of up to 8 s."""
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
    return float(f[1:][np.argmax(below > 0.01 * below[-1])]), float(
        f[1:][np.argmax(up_to > 0.99 * up_to[-1])]
    )
