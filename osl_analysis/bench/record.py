"""One record for every motion: uniform signals, the motion behind one low-pass, and groups of
rows."""

from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from osl_analysis.bench.bench_settings import BenchAnalysis
from osl_analysis.errors import InputError
from osl_analysis.signals import Motion, filtered_motion
from osl_analysis.signals.grid import UniformSignals, devices_of, resampled, uniform_signals
from osl_analysis.spectral import PeriodicMotion
from osl_analysis.trial import Array, Trial

QUICK = 4.0  # cut-offs of the low-pass for the velocity's sign
# rate of a coarse record: what the filter passes contains nothing faster than eight cut-offs
COARSE_HZ = 250.0
COARSE_CUTOFFS = 8.0
EDGE_ROUNDING = 1e-6  # rows; edges of groups are sums of numbers that are rounded


Label = float | str | None
"""What has a fit of its own: an amplitude [deg], a branch of a belt; None: the whole record."""


class Stratum(NamedTuple):
    """A set of groups that repeat one another; if nothing repeats, the set of all groups."""

    label: Label = None
    # of a sine
    frequency_hz: float = np.nan  # [Hz]
    commanded_deg: float | None = None  # amplitude [deg] in the protocol
    rows: slice = slice(0)  # rows of its motion, with its transient


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

    def of(self, label: Label) -> NDArray[np.bool_]:
        """Which groups (m,) have a label; all for None."""
        has_label = np.array([label in (None, stratum.label) for stratum in self.strata])
        return has_label[self.stratum]


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
        Raw resisting torque [N*m].
    motion : Motion
        Filtered joint angle with its derivatives.
    filtered_torque : Array (n,)
        The torque through the same filter [N*m].
    settings : BenchAnalysis
        The bench, the filter of angle and torque, and limits on the motion.
    usable : Array (n,) of bool
        Rows that are not near a gap in the recording.
    groups : Groups
        Rows that are fitted.
    band_hz : tuple of float
        Lowest and highest frequency of the motion [Hz].
    encoder_step : float
        Resolution of the angle [rad]; 0: not known.
    periodic : PeriodicMotion or None
        Periods of a periodic motion.
    uniform : UniformSignals or None
        The signals on their time base, with what the recorders did; None for a record that no file
        holds.
    with_other_stamps : Record or None
        The same with the other reading of undecided stamps; None: all are decided.
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
    settings: BenchAnalysis
    usable: NDArray[np.bool_]
    groups: Groups
    band_hz: tuple[float, float] = (np.nan, np.nan)
    encoder_step: float = 0.0
    periodic: PeriodicMotion | None = None
    uniform: UniformSignals | None = None
    with_other_stamps: "Record | None" = None
    actuator: Mapping[str, Array] = field(default_factory=dict)

    @property
    def rate_hz(self) -> float:
        return (len(self.time) - 1) / float(self.time[-1] - self.time[0])

    @property
    def is_stepped_sine(self) -> bool:
        return self.groups.kind == "cycles"

    def is_fitted(self, label: Label = None) -> NDArray[np.bool_]:
        """Which rows (n,) lie, at least partly, in the groups of a label."""
        chosen = self.groups.of(label)
        begins = np.floor(self.groups.first[chosen] + EDGE_ROUNDING).astype(np.intp)
        ends = np.ceil(self.groups.stop[chosen] - EDGE_ROUNDING).astype(np.intp)
        depth = np.zeros(len(self.time) + 1, dtype=np.intp)
        np.add.at(depth, begins, 1)
        np.add.at(depth, ends, -1)
        return np.asarray(np.cumsum(depth[:-1]) > 0)

    def rows(self, label: Label = None) -> NDArray[np.intp]:
        """The fitted rows (m,) of a label or of all."""
        return np.flatnonzero(self.is_fitted(label))

    @cached_property
    def coarse(self) -> "Record":
        """The filtered signals at 250 Hz, or eight cut-offs if more, with the same groups: they
        contain nothing faster. The torque is the filtered one."""
        at_least = max(COARSE_HZ, COARSE_CUTOFFS * self.settings.cutoff_hz)
        # rates are known to within rounding
        step = max(int(self.rate_hz / at_least + 1e-6), 1)
        if step == 1:
            return self
        rows = slice(None, None, step)
        stop = np.minimum(self.groups.stop / step, len(self.time[rows]))
        return replace(
            self,
            time=self.time[rows],
            theta=self.motion.theta[rows],
            torque=self.filtered_torque[rows],
            motion=self.motion[rows],
            filtered_torque=self.filtered_torque[rows],
            usable=self.usable[rows],
            actuator={name: signal[rows] for name, signal in self.actuator.items()},
            groups=replace(self.groups, first=self.groups.first / step, stop=stop),
        )

    @property
    def largest_amplitude(self) -> Label:
        """The label of the largest amplitude; None for a motion that has none."""
        amplitudes = {
            stratum.commanded_deg or stratum.label: stratum.label
            for stratum in self.groups.strata
            if isinstance(stratum.label, float)
        }
        return amplitudes[max(amplitudes)] if amplitudes else None


def with_actuator(record: Record, trial: Trial) -> Record:
    """The record with the trial's actuator signals, of devices whose stamps come to a time base."""
    same = record.settings.low_pass
    wide_band = replace(same, cutoff_hz=min(QUICK * same.cutoff_hz, 0.2 * record.rate_hz))
    low_passes = {"theta_m": same, "current": same, "wide_band_theta_m": wide_band}
    columns = [name for name in ("theta_m", "current") if name in trial.columns]
    signals = dict[str, Array]()
    for device in devices_of(trial, ["theta", *columns, "torque"]) if columns else ():
        if not {*device} & {*columns}:
            continue
        with suppress(InputError):
            uniform = uniform_signals(trial, device, record.settings.gap_limits, wanted=columns)
            filtered = dict[str, Array]()
            for name, low_pass in low_passes.items():
                column = name.removeprefix("wide_band_")
                if column in device:
                    filtered[name] = low_pass(uniform[column], uniform.rate_hz)
            signals.update(resampled(uniform.time, filtered, record.time, 1 / uniform.rate_hz))
    if "theta_m" not in signals:
        return record
    return replace(record, actuator=signals)


def record_of(
    signals: UniformSignals, settings: BenchAnalysis, theta: Array | None = None
) -> Record:
    """The record of signals, in which no row is in a group yet.

    Parameters
    ----------
    signals
        With `theta` and `torque`.
    settings
        The bench, and the filter.
    theta
        The angle (n,) [rad] that is filtered, by default the joint's.
    """
    torque = signals["torque"]
    if theta is None:
        theta = settings.joint_angle(signals["theta"], torque)
    motion, filtered = filtered_motion(signals.time, theta, torque, settings.low_pass)
    return Record(
        name=signals.trial,
        time=signals.time,
        theta=theta,
        torque=torque,
        motion=motion,
        filtered_torque=filtered,
        settings=settings,
        usable=signals.usable,
        groups=Groups("stretches", np.empty(0), np.empty(0), np.empty(0, dtype=np.intp), ()),
        uniform=signals,
    )
