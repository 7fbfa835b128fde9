# SPDX-License-Identifier: Apache-2.0
"""One record for every motion: uniform signals, the motion behind one low-pass, and groups of
rows."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from osl_analysis.base.measured import UNIFORM_WIDTH, visible_step
from osl_analysis.base.trial import Array
from osl_analysis.bench.bench_settings import BenchAnalysis
from osl_analysis.inference.spectra import HIGHEST_OF_RATE
from osl_analysis.signals.filters import Motion, seven_point_motion, unfollowed_density
from osl_analysis.signals.grid import UniformSignals
from osl_analysis.spectral.periodic import PeriodicMotion
from osl_analysis.stats.linear_fit import FALSE_ALARM

STIFFNESS_ALONE = "or record slow cycles (experiment 'torque_angle') for the stiffness alone"
# rate of a coarse record: what the filter passes has nothing faster than eight, and rounding,
# jerk and snap are read with sixteen rows a period of the cut-off
COARSE_CUTOFFS = 16.0
SPECTRUM_POINTS = 500  # lines of white noise, and rates of steps
BESIDE_CUTOFF = (2.0, 4.0)  # cut-offs, between which a low-pass removes all, and motion is slower
HARMONICS = 40  # of slow steps, which reach from a dwell of a second to the filter
EDGE_ROUNDING = 1e-6  # rows, of edges of groups and quotients of rates, which are rounded


Label = float | str | None
"""What has a fit of its own: an amplitude [deg], a branch of a belt; None: the whole record."""


class Stratum(NamedTuple):
    """A set of groups that repeat one another, or of all that do not."""

    label: Label = None
    # of a sine
    frequency_hz: float = np.nan  # [Hz]
    commanded_deg: float | None = None  # amplitude [deg] in the protocol


@dataclass(frozen=True)
class Groups:
    """Groups of consecutive rows of a record, such as cycles, periods or blocks of a second.

    Attributes
    ----------
    kind : str
        What they are: `cycles`, `periods`, or `blocks`, which do not repeat.
    first, stop : Array (m,)
        Rows at which each group begins and ends, which may be fractional.
    stratum : Array (m,)
        Index of each group's stratum, from 0.
    strata : tuple of Stratum
    """

    kind: Literal["cycles", "periods", "blocks"]
    first: Array
    stop: Array
    stratum: NDArray[np.intp]
    strata: tuple[Stratum, ...]

    def repeat(self) -> NDArray[np.bool_]:
        """Which groups (m,) repeat others; a group alone in its stratum repeats none."""
        members = np.bincount(self.stratum)[self.stratum]
        return (members > 1) & (self.kind != "blocks")

    def cover(
        self, is_chosen: NDArray[np.bool_], rows: int, edge: float = 0.0
    ) -> NDArray[np.bool_]:
        """Which of some rows lie, at least partly, in chosen groups, or within `edge` rows of
        these."""
        covered = np.zeros(rows, dtype=bool)
        first = np.maximum(self.first[is_chosen] - edge, 0)
        for part in whole_rows(first, self.stop[is_chosen] + edge):
            covered[part] = True
        return covered

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
        Raw resisting torque [N*m]; of a coarse record `filtered_torque` itself.
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
    rate_hz : float
    band_hz : tuple of float
        Lowest and highest frequency of the motion [Hz].
    periodic : PeriodicMotion or None
        Periods of a periodic motion.
    signals : UniformSignals or None
        What was recorded, on the time base; None for a record that no file holds.
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
    rate_hz: float
    band_hz: tuple[float, float] = (np.nan, np.nan)
    periodic: PeriodicMotion | None = None
    signals: UniformSignals | None = None
    with_other_stamps: "Record | None" = None
    actuator: Mapping[str, Array] = field(default_factory=dict)

    @property
    def streams(self) -> Sequence[Mapping[str, Any]]:
        """What the recorders did, by the names of `timebase.csv`."""
        return self.signals.streams if self.signals else ()

    @property
    def inferred_delay_error(self) -> float:
        """Standard uncertainty [s] of the delay between angle and torque that the beat of a held
        channel tells; 0 where none is inferred."""
        if self.signals is None:
            return 0.0
        widths = [part.beat_width for part in self.signals.taken]
        return float(np.linalg.norm(widths)) / UNIFORM_WIDTH

    @cached_property
    def encoder_step(self) -> float:
        """Resolution of the angle [rad]; 0: not known."""
        if self.signals is None:
            return 0.0
        stream = next(x.stream for x in self.signals.taken if "theta" in x.stream.signals)
        theta = stream.signals["theta"]
        stated = stream.stated.get("theta", {}).get("resolution")
        return float(stated or visible_step(theta[~np.isnan(theta)]) or 0.0)

    def is_fitted(self, label: Label = None, edge: int = 0) -> NDArray[np.bool_]:
        """Which rows (n,) lie, at least partly, in the groups of a label, or within `edge` rows of
        these."""
        return self.groups.cover(self.groups.of(label), len(self.time), edge)

    @cached_property
    def angle_noise(self) -> Array:
        """Lines of the angle's noise: their frequencies [Hz] and powers [rad^2], (2, n).

        Rounding of an angle that passes r steps of its encoder in a second is a sawtooth, whose
        harmonic k at the frequency k r has the power step^2/(2 pi^2 k^2). Of slow passages, as of a
        hand that dwells, these lie within the filter. What is left of the noise beyond it is taken
        as white. What the torque follows there is motion, as of a drive that shakes, and no noise.
        """
        rows = self.is_fitted()
        # above these a slow motion has less of its rounding; a slow recorder has its highest ones
        beside_hz = np.array(BESIDE_CUTOFF) * self.settings.cutoff_hz
        above_hz, below_hz = np.minimum(beside_hz, self.rate_hz * np.array(HIGHEST_OF_RATE))
        removed = (self.theta - self.motion.theta)[rows]
        removed_torque = (self.torque - self.filtered_torque)[rows]
        second = min(round(self.rate_hz), len(removed))
        frequency, densities = unfollowed_density(
            removed, removed_torque, self.rate_hz, second, FALSE_ALARM
        )
        density = np.median(densities[(frequency > above_hz) & (frequency < below_hz)])
        hz = np.linspace(0, self.rate_hz / 2, SPECTRUM_POINTS + 1)[1:]
        step = self.encoder_step
        if not step:
            return np.array([hz, np.full_like(hz, density * hz[0])])

        shares = (np.arange(SPECTRUM_POINTS) + 0.5) / SPECTRUM_POINTS
        # what rises and falls is sorted by its runs in half the time of a quantile
        speeds = np.sort(np.abs(self.motion.omega[rows]), kind="stable")
        rates = np.quantile(speeds, shares) / step
        harmonics = np.arange(1, HARMONICS + 1)[:, None]
        of_steps = step**2 / (2 * np.pi**2 * harmonics**2) / SPECTRUM_POINTS
        lines_hz = np.maximum(harmonics * rates, hz[0])
        is_beside = (lines_hz > beside_hz[0]) & (lines_hz < beside_hz[1])
        of_slow = np.sum(of_steps * is_beside) / np.ptp(beside_hz)
        white = np.full_like(hz, max(density - of_slow, 0.0) * hz[0])
        powers = np.broadcast_to(of_steps, lines_hz.shape).ravel()
        return np.array([np.append(hz, lines_hz), np.append(white, powers)])

    @cached_property
    def coarse(self) -> "Record":
        """The filtered signals at `COARSE_CUTOFFS` or more, with the same groups. The torque is the
        filtered one."""
        least_hz = COARSE_CUTOFFS * self.settings.cutoff_hz
        step = max(int(self.rate_hz / least_hz + EDGE_ROUNDING), 1)
        if step == 1:
            return self
        rows = slice(None, None, step)
        motion = self.motion
        torque = self.filtered_torque[rows]
        stop = np.minimum(self.groups.stop / step, len(self.time[rows]))
        return replace(
            self,
            time=self.time[rows],
            theta=motion.theta[rows],
            torque=torque,
            motion=Motion(motion.theta[rows], motion.omega[rows], motion.alpha[rows]),
            filtered_torque=torque,
            usable=self.usable[rows],
            actuator={name: signal[rows] for name, signal in self.actuator.items()},
            groups=replace(self.groups, first=self.groups.first / step, stop=stop),
            rate_hz=self.rate_hz / step,
        )

    def less_torque(self, explained: Array) -> "Record":
        """The record without a part (n,) [N*m] of its torque that is explained."""
        filtered = self.filtered_torque - explained
        is_coarse = self.torque is self.filtered_torque
        raw = filtered if is_coarse else self.torque - explained
        return replace(self, torque=raw, filtered_torque=filtered)


def unlike_groups(first: Array, stop: Array) -> Groups:
    """Groups of rows between edges (m,) that do not repeat one another."""
    return Groups("blocks", first, stop, np.zeros(len(first), dtype=np.intp), (Stratum(),))


def whole_rows(first: Array, stop: Array) -> list[slice]:
    """The rows that lie, at least partly, between edges (m,) of groups."""
    begins = np.floor(first + EDGE_ROUNDING).astype(np.intp)
    ends = np.ceil(stop - EDGE_ROUNDING).astype(np.intp)
    return [slice(begin, end) for begin, end in zip(begins, ends, strict=True)]


def record_of(
    signals: UniformSignals,
    settings: BenchAnalysis,
    groups: Groups,
    theta: Array | None = None,
) -> Record:
    """The record of signals with groups of rows; angle and torque pass the *same* filter.

    Parameters
    ----------
    signals
        With `theta` and `torque`.
    settings
        The bench, and the filter.
    groups
        Those that are fitted.
    theta
        The angle (n,) [rad] that is filtered, by default the joint's.
    """
    torque = signals.signals["torque"]
    if theta is None:
        theta = signals.signals["theta"]
        if settings.bench_stiffness is not None:
            theta = settings.joint_angle(theta, torque)
    low_pass = settings.low_pass
    time = signals.time
    rate_hz = (len(time) - 1) / float(time[-1] - time[0])
    return Record(
        name=signals.trial,
        time=time,
        theta=theta,
        torque=torque,
        motion=seven_point_motion(low_pass(theta, rate_hz), rate_hz),
        filtered_torque=low_pass(torque, rate_hz),
        settings=settings,
        usable=signals.usable,
        groups=groups,
        rate_hz=rate_hz,
        signals=signals,
    )
