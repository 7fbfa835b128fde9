"""One record for every motion: uniform signals, the motion behind one low-pass, and groups of
rows."""

from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import compress
from math import ceil, floor
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from osl_analysis.bench.bench_settings import (
    NOT_STATED,
    BenchAnalysis,
    BenchStiffness,
    Calibration,
    Fixture,
    SteppedSineAnalysis,
)
from osl_analysis.errors import InputError
from osl_analysis.inference import BenchSignals
from osl_analysis.signals import LowPass, Motion, filtered_angle, filtered_motion
from osl_analysis.signals.grid import UniformSignals, devices_of, resampled, uniform_signals
from osl_analysis.spectral.periods import PeriodicMotion
from osl_analysis.stats.covariance import FEWEST_CYCLES, products_between
from osl_analysis.stats.power_density import power_density
from osl_analysis.trial import Array, Trial

# cut-offs of the low-pass for the velocity's sign, and for draws of the rounding of steps
QUICK = 4.0
BEYOND = 1.1  # cut-offs above which the band's end is motion, not the tail of a faster step
# rate of a coarse record: what the filter passes contains nothing faster than eight cut-offs
COARSE_HZ = 250.0
COARSE_CUTOFFS = 8.0
LEAST_DRIFT = 0.01  # of the RMS of the angle; a smaller drift of it is a frame that yields
ONE_DRIFT = 0.99  # correlation of time and mean angle from which a drift of either explains both


Label = float | str | None
"""What has a fit of its own: an amplitude [deg], a branch of a belt; None: the whole record."""


@dataclass(frozen=True)
class Stratum:
    """A set of groups that repeat one another; if nothing repeats, the set of all groups."""

    rows: slice  # rows of their motion, with its transient
    label: Label = None
    frequency_hz: float = np.nan  # of a sine [Hz]
    commanded_deg: float | None = None  # amplitude [deg] of the sine in the protocol


@dataclass(frozen=True)
class Groups:
    """Groups of consecutive rows of a record; a group ends where the next one begins, or earlier.

    Attributes
    ----------
    kind : str
        What they are: `cycles`, `periods`, or `stretches`, which do not repeat.
    first, stop : Array (m,)
        Rows at which each group begins and ends, which may be fractional.
    stratum : Array (m,)
        Index of each group's stratum, from 0.
    strata : tuple of Stratum
    """

    kind: Literal["cycles", "periods", "stretches"]
    first: Array
    stop: Array
    stratum: NDArray[np.intp]
    strata: tuple[Stratum, ...]

    @property
    def repeat(self) -> bool:
        """Whether the groups of a stratum repeat one another."""
        return self.kind != "stretches"

    @cached_property
    def labels(self) -> tuple[Label, ...]:
        return tuple(dict.fromkeys(stratum.label for stratum in self.strata))

    def of(self, label: Label) -> NDArray[np.bool_]:
        """Which groups (m,) have a label; all for None."""
        if label is None:
            return np.ones(len(self.first), dtype=np.bool_)
        has_label = np.array([stratum.label == label for stratum in self.strata])
        return has_label[self.stratum]

    @cached_property
    def pieces(self) -> Mapping[Label, list[slice]]:
        """Rows of each label's groups in order of time, with adjacent ones joined; None: of all
        groups."""
        edges = zip(self.first.tolist(), self.stop.tolist(), strict=True)
        # rows that lie at least partly between two edges, up to rounding errors
        rows = [slice(floor(first + 1e-6), ceil(stop - 1e-6)) for first, stop in edges]
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


@dataclass(frozen=True)
class Record:
    """Signals of one trial on the dynamometer, and the groups of rows that are fitted.

    Attributes
    ----------
    name : str
        Name of the trial.
    time : Array (n,)
        Uniform times [s].
    theta : Array (n,)
        Angle of the joint [rad], without the deflection of the bench.
    torque : Array (n,)
        Raw resisting torque [N*m], less the load cell's drift.
    motion : Motion
        Filtered joint angle with its derivatives.
    filtered_torque : Array (n,)
        The torque through the same filter [N*m].
    low_pass : LowPass
        Filter of angle and torque.
    usable : Array (n,) of bool
        Rows that are not near a gap in the recording.
    groups : Groups
        Rows that are fitted.
    band_hz : tuple of float
        Lowest and highest frequency of the motion [Hz].
    drift : float
        Drift of the load cell that was subtracted from the torque [N*m/s].
    steps : tuple
        Resolution of angle [rad] and torque [N*m]; None: not known.
    periodic : PeriodicMotion or None
        Periods of a periodic motion.
    uniform : UniformSignals or None
        The signals on their time base, with what the recorders did; None for a record that no file
        holds.
    with_other_stamps : Record or None
        The same with the other reading of undecided stamps; None: all are decided.
    settings : BenchAnalysis or None
        The bench, and limits on the motion.
    actuator : Mapping of Array (n,)
        If requested, the actuator's filtered angle `theta_m` [rad] and `current` [A];
        `wide_band_theta_m` is the angle for the velocity's sign.
    """

    name: str
    time: Array
    theta: Array
    torque: Array
    motion: Motion
    filtered_torque: Array
    low_pass: LowPass
    usable: NDArray[np.bool_]
    groups: Groups
    band_hz: tuple[float, float] = (np.nan, np.nan)
    drift: float = 0.0
    steps: tuple[float | None, float | None] = (None, None)
    periodic: PeriodicMotion | None = None
    uniform: UniformSignals | None = None
    with_other_stamps: "Record | None" = None
    settings: BenchAnalysis | None = None
    actuator: Mapping[str, Array] = field(default_factory=dict)

    @property
    def bench(self) -> BenchStiffness | None:
        """Stiffness of the bench; None: it is rigid."""
        return self.settings.bench_stiffness if self.settings else None

    @property
    def fixture(self) -> Fixture | None:
        """The fixture of the settings; None without one."""
        return self.settings.fixture if self.settings else None

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
    def bench_angle(self) -> Array:
        """Raw angle of the bench (n,) [rad]; equals the joint's if the bench is rigid."""
        return self.theta if self.bench is None or self.uniform is None else self.uniform["theta"]

    @cached_property
    def noise(self) -> tuple[float, float]:
        """Densities of the noise of angle [rad^2/Hz] and torque [N^2 m^2/Hz], taken as white.

        They are medians from two to four cut-offs of what the filter removes in the fitted rows. If
        the motion itself reaches these frequencies, the angle's density is its level at the highest
        frequencies.
        """
        length = min(round(self.rate_hz), self.samples)

        def removed(raw: Array, smooth: Array) -> tuple[Array, Array]:
            return power_density(
                self.part(raw - smooth),
                self.rate_hz,
                length,
                has_overlap=False,
                takes_off_mean=False,
            )

        frequency, of_angle = removed(self.theta, self.motion.theta)
        _, of_torque = removed(self.torque, self.filtered_torque)
        highest = min(4 * self.low_pass.cutoff_hz, 0.45 * self.rate_hz)
        lowest = min(2 * self.low_pass.cutoff_hz, 0.8 * highest)
        beyond = (frequency > lowest) & (frequency < highest)
        angle, torque = 0.0, 0.0
        if beyond.any():
            angle, torque = float(np.median(of_angle[beyond])), float(np.median(of_torque[beyond]))
        at_highest = float(np.median(of_angle[frequency > 0.35 * self.rate_hz]))
        if at_highest < 0.3 * angle:
            angle = at_highest
        return angle, torque

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
        rows = slice(None, None, step)
        groups = self.groups
        first = groups.first / step
        stop = np.minimum(groups.stop / step, len(self.time[rows]))
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
        at_least = max(COARSE_HZ, COARSE_CUTOFFS * self.low_pass.cutoff_hz)
        # rates are known to within rounding
        return self.thinned(max(int(self.rate_hz / at_least + 1e-6), 1))

    @property
    def swift_omega(self) -> Array:
        """Velocity [rad/s] in the rows of `coarse`, for the sign of friction. If the motion exceeds
        the fit's cut-off, the filter is one that passes it: the sign of a slower signal changes at
        other times."""
        few = self.coarse
        highest = self.band_hz[1]
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
        strata = self.groups.strata
        if label is not None:
            strata = tuple(stratum for stratum in strata if stratum.label == label)
        return joined([stratum.rows for stratum in strata], apart=1)

    @property
    def largest_amplitude(self) -> Label:
        """The label of the largest amplitude; None for a motion that has none."""
        amplitudes = {
            stratum.label: stratum.commanded_deg or stratum.label
            for stratum in self.groups.strata
            if isinstance(stratum.label, float)
        }
        return max(amplitudes, key=lambda label: amplitudes[label]) if amplitudes else None


def signals_of(record: Record, is_leg: bool = False) -> BenchSignals:
    """What the inference is given of a record: the raw signals, since it finds their band itself.

    Parameters
    ----------
    record : Record
        Angle and torque of a trial.
    is_leg : bool
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
        sliding_angle=record.actuator.get("wide_band_theta_m") if is_leg else None,
        load=record.actuator.get("current") if is_leg else None,
    )


def joint_angle(theta: Array, torque: Array, compliance: float) -> Array:
    """Angle of the joint (n,) [rad] from the bench's: the bench turns the joint through its frame
    of some `compliance` [rad/(N*m)], which the resisting torque [N*m] deflects: theta_bench = theta
    + torque/k."""
    return theta - compliance * torque if compliance else theta


def with_actuator(record: Record, trial: Trial) -> Record:
    """The record with the trial's actuator signals, if they come to a time base with angle and
    torque."""
    same = record.low_pass
    wide_band = replace(same, cutoff_hz=min(QUICK * same.cutoff_hz, 0.2 * record.rate_hz))
    of_angle = {"theta_m": ("theta_m", same), "wide_band_theta_m": ("theta_m", wide_band)}
    with_current = {**of_angle, "current": ("current", same)}
    for wanted in (with_current, of_angle):
        if all(column in trial.columns for column, _ in wanted.values()):
            with suppress(InputError):
                return replace(record, actuator=logged(record, trial, wanted))
    return record


def logged(
    record: Record, trial: Trial, wanted: Mapping[str, tuple[str, LowPass]]
) -> dict[str, Array]:
    """Further columns of a trial at the times of the record, given as column and filter by new
    name.

    Raises
    ------
    InputError
        A column is missing, or its device's stamps do not come to a time base.
    """
    assert record.settings is not None
    columns = [column for column, _ in wanted.values()]
    signals = dict[str, Array]()
    for device in devices_of(trial, list(dict.fromkeys(("theta", *columns, "torque")))):
        of_device = {name: each for name, each in wanted.items() if each[0] in device}
        if not of_device:
            continue
        uniform = uniform_signals(trial, device, record.settings.gap_limits, wanted=columns)
        filtered = {
            name: low_pass(uniform[column], uniform.rate_hz)
            for name, (column, low_pass) in of_device.items()
        }
        signals.update(resampled(uniform.time, filtered, record.time, 1 / uniform.rate_hz))
    return signals


def conditioned(
    signals: UniformSignals,
    settings: SteppedSineAnalysis,
    groups: Groups,
    band: tuple[float, float],
) -> Record:
    """The record of these groups."""
    bench = settings.bench_stiffness
    record = record_of(
        signals.trial,
        signals.time,
        signals["theta"],
        signals["torque"],
        settings.low_pass,
        groups,
        bench.compliance if bench else 0.0,
    )
    return replace(record, usable=signals.usable, band_hz=band, settings=settings, uniform=signals)


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
        motion = filtered_angle(time, joint, low_pass)
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
    drift. It is 0, too, where the angle itself drifts in time, which nothing tells from it.
    """
    members = np.array([np.count_nonzero(groups.of(label)) for label in groups.labels])
    if members.max() < FEWEST_CYCLES:
        return 0.0
    ramp = time - time.mean()
    if groups.kind == "cycles":
        columns, target = means_of_cycles(ramp, motion, torque, groups, members)
        if drifts_alike(columns, float(motion.theta.std())):
            return 0.0
    else:
        of_motion = [motion.theta, motion.omega, motion.alpha]
        rows = np.concatenate([np.r_[piece] for piece in groups.pieces[None]])
        columns = np.column_stack([ramp, *of_motion, np.ones_like(ramp)])[rows]
        target = torque[rows]
    scale = np.linalg.norm(columns, axis=0)
    scale[scale == 0] = 1.0
    slope = np.linalg.lstsq(columns / scale, target, rcond=1e-9)[0][0]
    return float(slope / scale[0])


def drifts_alike(columns: Array, theta_rms: float) -> bool:
    """Whether the mean angle of cycles drifts like time, by more than a hundredth of the angle's
    RMS [rad].

    `columns` are those of `means_of_cycles`, of which time and angle come first. Means of the
    labels are taken off.
    """
    labels = columns[:, 2:]
    time, angle = (columns[:, :2] - labels @ np.linalg.lstsq(labels, columns[:, :2])[0]).T
    weight = float(np.linalg.norm(labels))
    if np.linalg.norm(angle) < LEAST_DRIFT * theta_rms * weight:
        return False
    size = float(np.linalg.norm(time) * np.linalg.norm(angle))
    return abs(float(time @ angle)) > ONE_DRIFT * size


def means_of_cycles(
    ramp: Array, motion: Motion, torque: Array, groups: Groups, members: NDArray[np.intp]
) -> tuple[Array, Array]:
    """Means of time, angle, and one for each label (m, 2 + labels), and of the torque (m,), of the
    cycles of labels with enough of them, weighted by the root of their length."""
    signals = np.column_stack([ramp, motion.theta, torque])
    ones = np.ones((len(signals), 1))
    sums = products_between(signals, ones, groups.first, groups.stop)[..., 0]
    weight = np.sqrt(groups.stop - groups.first)[:, None]
    label = np.array([groups.labels.index(groups.strata[k].label) for k in groups.stratum])
    enough = np.flatnonzero(members >= FEWEST_CYCLES)
    mean_of_label = np.where(label[:, None] == enough, weight, 0.0)
    is_used = mean_of_label.any(axis=1)
    columns = np.column_stack([sums[:, :2] / weight, mean_of_label])
    return columns[is_used], (sums[:, 2] / weight[:, 0])[is_used]
