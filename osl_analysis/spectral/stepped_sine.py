"""The stepped sine: what was commanded, the sines that the joint did, and the cycles of them that
are fitted.

A run is a stretch of one frequency and amplitude, whoever commanded it. A segment is the whole
cycles of a run that follows a commanded amplitude.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy
from numpy.typing import NDArray

from osl_analysis.errors import Change, InputError
from osl_analysis.measured import rms, usual_size
from osl_analysis.trial import Array

# Relative differences of a recorded sine from the commanded one
LOST_AMPLITUDE = 0.25  # a dynamometer loses some of it
SAME_RATE = 1e-3  # of two frequencies; runs that agree so well share one
LARGEST_SLIP = 2e-3  # cycles by which a run may slip against the commanded frequency
OTHER_UNIT = 10  # an amplitude so many times larger or smaller is in another unit

# Largest relative differences between neighbouring cycles of a run
SAME_FREQUENCY = 0.05  # also from the commanded one; more than any clock is off
SAME_AMPLITUDE = 0.15  # a bench loses as much at 5 Hz
# Largest relative difference of a cycle's amplitude from its run's median; beyond, cycles at its
# ends are a ramp.
ONE_HEIGHT = 0.06
RECENT_CYCLES = 5  # with whose mean the next cycle is compared
FEWEST_RUN_CYCLES = 3  # fewer may be a transient
MISSING_CYCLE = 0.25  # cycles that may be missing at the ends of a run
BEGINS_AT_CENTRE = 0.5  # rad of the phase of a run that begins at its centre and rises

BIN_S = 0.25  # time [s] within which a moving joint turns measurably
MOVING_SHARE = 0.02  # smallest share of its range by which it then turns; rests stay within
# standard deviations of the noise, within which the turn and the angle of a sensor at rest stay
MOVING_NOISES = 12
DEAD_BAND_NOISES = 5
# A second difference of white noise has sqrt(6) of its standard deviation; the median size is
# 0.6745 of a normal one.
SECOND_DIFFERENCE = 0.6745 * np.sqrt(6)

SAMPLES_PER_CYCLE = 64  # tell all of a sine
FEWEST_SAMPLES = 8  # for a sine with its growth and a centre
LARGEST_MISFIT = 0.3  # of the sine's RMS
PURE_SINE = 0.08
"""Misfit of a pure sine, of its RMS; a triangle's is 0.12. An angle that deviates by so much of the
amplitude, and twice the misfit, has left its sine."""
STEADY = 0.01  # relative difference of a frequency between the halves of a run; a sweep's is more
LEAST_SINES = 0.25  # of the moving time; below, a motion is no stepped sine


@dataclass(frozen=True)
class SteppedSineProtocol:
    """A stepped sine: each amplitude at every frequency, in any order, with or without rests.

    An empty field was not stated: the recording's own values count.
    """

    amplitudes: Sequence[float]  # [rad]
    frequencies_hz: Sequence[float]
    # number of cycles at each frequency: one number for all, or one for each
    cycles: float | Sequence[float] | None = None

    @property
    def cycles_at(self) -> tuple[float, ...]:
        """Number of cycles at each frequency; fractional if a time per frequency is commanded."""
        if self.cycles is None:
            return ()
        cycles = np.broadcast_to(np.asarray(self.cycles, dtype=float), len(self.frequencies_hz))
        return tuple(cycles.tolist())

    def amplitude_near(self, amplitude: float) -> float | None:
        """The commanded amplitude [rad] within 25 % of a recorded one; else None."""
        return followed(amplitude, self.amplitudes, LOST_AMPLITUDE)

    def frequency_near(self, frequency_hz: float) -> float | None:
        """The commanded frequency [Hz] within 5 % of a recorded one; else None."""
        return followed(frequency_hz, self.frequencies_hz, SAME_FREQUENCY)


def stated_protocol(
    amplitudes_deg: Sequence[float] | None,
    frequencies_hz: Sequence[float] | None,
    cycles: float | Sequence[float] | None,
) -> SteppedSineProtocol:
    """The protocol of a configuration, with amplitudes in degrees; None: not stated."""
    return SteppedSineProtocol(
        amplitudes=tuple(np.deg2rad(amplitudes_deg or ()).tolist()),
        frequencies_hz=tuple(frequencies_hz or ()),
        cycles=cycles,
    )


def followed(value: float, commanded: Sequence[float], tolerance: float) -> float | None:
    """The commanded value that is nearest by their ratio; None if they differ by more than the
    tolerance."""
    nearest = min(commanded, key=lambda target: abs(value / target - 1), default=None)
    is_near = nearest is not None and abs(value / nearest - 1) <= tolerance
    return nearest if is_near else None


# ---- What the joint did


@dataclass(frozen=True)
class Run:
    """A stretch of one frequency and amplitude."""

    frequency_hz: float
    amplitude: float  # [rad]
    phase: float  # of the cosine at the first row of the record [rad]
    start: int  # row at which it begins
    stop: int  # row at which it ends
    cycles: float  # not rounded: the ends of a run are known to a few hundredths
    misfit: float  # RMS deviation [rad] of its angle from the sine: harmonics, decay, rounding
    is_steady: bool  # whether both halves have one frequency; those of a sweep do not

    def __str__(self) -> str:
        return (
            f"{np.rad2deg(self.amplitude):.2g} deg at {self.frequency_hz:.4g} Hz ({self.cycles:.1f}"
            " cycles)"
        )


@dataclass(frozen=True)
class Sines:
    """The sines in a joint's motion.

    Attributes
    ----------
    runs : list of Run
        In order of time.
    moving : Array (n,) of bool
        Rows in which the joint moves.
    is_stepped : bool
        Whether the motion is a stepped sine, and no other one: of the moving time more than
        `LEAST_SINES` is in runs that are commanded, or pure sines.
    """

    runs: list[Run]
    moving: NDArray[np.bool_]
    is_stepped: bool


def find_sines(theta: Array, rate_hz: float, protocol: SteppedSineProtocol) -> Sines:
    """Find the sines in a joint angle.

    Parameters
    ----------
    theta : Array
        Angles (n,) [rad].
    rate_hz : float
        Their rate.
    protocol : SteppedSineProtocol
        What was commanded.

    Notes
    -----
    Consecutive similar cycles, each from one upward crossing of the centre to the next, make a run,
    whose sine is fitted. A run extends as far as the angle follows its sine, and no other run has
    begun. Rests, ramps, transients and disturbed cycles lie between the runs.
    """
    moving = moving_bins(theta, rate_hz)
    stretches = similar_cycles(theta, upward_crossings(theta, moving))
    ends = [*(int(crossings[0]) for crossings in stretches[1:]), len(theta) - 1]
    fewest = int(min((*protocol.cycles_at, FEWEST_RUN_CYCLES)))
    found = []
    in_sines = np.zeros_like(moving)
    earliest = 0
    for crossings, latest in zip(stretches, ends, strict=False):
        run = fit_run(theta, rate_hz, crossings, earliest, latest)
        if run is None:
            continue
        earliest = run.stop
        if run.cycles <= fewest - MISSING_CYCLE:
            continue
        found.append(run)
        nearest = (
            protocol.frequency_near(run.frequency_hz),
            protocol.amplitude_near(run.amplitude),
        )
        is_pure = run.misfit < PURE_SINE * run.amplitude / np.sqrt(2)
        if run.is_steady and (is_pure or None not in nearest):
            in_sines[run.start : run.stop] = True
    is_stepped = bool(in_sines[moving].sum() > LEAST_SINES * moving.sum())
    return Sines(found, moving, is_stepped)


def noise_of(theta: Array) -> float:
    """Standard deviation of the noise of an angle (n,), in its unit, by its second differences; 0
    of two samples."""
    return usual_size(np.diff(theta, 2)) / SECOND_DIFFERENCE if len(theta) > 2 else 0.0


def moving_bins(theta: Array, rate_hz: float) -> NDArray[np.bool_]:
    """Find the rows in which a joint moves, in bins of `BIN_S`.

    Parameters
    ----------
    theta : Array
        (n,) [rad].
    rate_hz : float

    Returns
    -------
    Array
        Mask (n,). A bin with only rounding or noise of a sensor at rest does not count.
    """
    bins = np.arange(len(theta)) // (BIN_S * rate_hz)
    first_rows = np.flatnonzero(np.diff(bins, prepend=-1))
    turn = np.maximum.reduceat(theta, first_rows) - np.minimum.reduceat(theta, first_rows)
    moves = turn > max(MOVING_SHARE * float(np.ptp(theta)), MOVING_NOISES * noise_of(theta))
    return np.asarray(np.repeat(moves, np.diff(np.append(first_rows, len(theta)))))


def upward_crossings(theta: Array, moving: NDArray[np.bool_]) -> Array:
    """Rows, not rounded, at which the angle rises through its centre, from below a dead band to
    above it.

    The band is 2 % of the largest angle, so that rests and noise stay within. The centre is the
    median angle while the joint moves: it may rest elsewhere, and for longer.
    """
    x = theta - np.median(theta[moving] if moving.any() else theta)
    dead_band = max(MOVING_SHARE * np.abs(x).max(), DEAD_BAND_NOISES * noise_of(theta))
    beyond = np.flatnonzero(np.abs(x) > dead_band)
    is_above = x[beyond] > 0
    came_up = beyond[1:][is_above[1:] & ~is_above[:-1]]
    rises = np.flatnonzero((x[:-1] <= 0) & (x[1:] > 0))
    before = rises[np.searchsorted(rises, came_up) - 1]
    return np.asarray(before - x[before] / (x[before + 1] - x[before]))


def similar_cycles(theta: Array, crossings: Array) -> list[Array]:
    """The upward crossings of each stretch of two or more consecutive cycles that are similar
    in frequency and amplitude; a single one may belong to a ramp or a rest."""
    if len(crossings) < 2:
        return []
    rows = np.ceil(crossings).astype(np.intp)
    height = (np.maximum.reduceat(theta, rows) - np.minimum.reduceat(theta, rows))[:-1]
    cycles = np.column_stack([1 / np.diff(crossings), height])
    stretches = [[0]]
    for number in range(1, len(cycles)):
        usual = cycles[stretches[-1][-RECENT_CYCLES:]].mean(axis=0)
        if (np.abs(cycles[number] / usual - 1) <= (SAME_FREQUENCY, SAME_AMPLITUDE)).all():
            stretches[-1].append(number)
        else:
            stretches.append([number])
    found = []
    for stretch in stretches:
        of_median = height[stretch] / np.median(height[stretch])
        usual = np.array(stretch)[np.abs(of_median - 1) < ONE_HEIGHT]  # a slow ramp stands outside
        if len(usual) > 1:
            found.append(crossings[usual[0] : usual[-1] + 2])
    return found


def fit_run(
    theta: Array, rate_hz: float, crossings: Array, earliest: int, latest: int
) -> Run | None:
    """Fit a sine to the angle (n,) between the first and the last crossing [rows], and prolong it
    as far as the angle follows it, between two rows. None if its misfit exceeds 0.3 of its RMS."""
    first, last = np.ceil(crossings[[0, -1]]).astype(np.intp)
    lengths = np.diff(crossings) / rate_hz
    half = len(lengths) // 2
    stride = max((last - first) // (SAMPLES_PER_CYCLE * len(lengths)), 1)
    rows = np.arange(first, last, stride)
    if len(rows) < FEWEST_SAMPLES:
        return None
    x = theta[rows]
    middle = rows.mean()

    def misfits(sine: Array, rows: NDArray[np.intp]) -> Array:
        """What a sine of frequency [Hz], complex amplitude and centre leaves of the angle."""
        frequency_hz, real, imaginary, centre = sine
        turned = np.exp(2j * np.pi * frequency_hz / rate_hz * (rows - middle))
        return np.asarray(theta[rows] - centre - (complex(real, imaginary) * turned).real)

    likely = (1 / lengths.mean(), np.ptp(x) / 2, 0.0, x.mean())
    sine = scipy.optimize.least_squares(misfits, likely, method="lm", args=(rows,)).x
    frequency_hz, real, imaginary, _ = sine.tolist()
    amplitude = float(np.hypot(real, imaginary))
    misfit = rms(misfits(sine, rows))
    if misfit > LARGEST_MISFIT * amplitude / np.sqrt(2):
        return None

    near = np.arange(earliest, latest + 1)
    has_left = np.abs(misfits(sine, near)) > PURE_SINE * amplitude + 2 * misfit
    outside = np.array([earliest - 1, *near[has_left], latest + 1])
    start = int(outside[outside < first][-1]) + 1
    stop = int(outside[outside >= last - 1][0]) - 1
    return Run(
        frequency_hz=frequency_hz,
        amplitude=amplitude,
        phase=float(np.arctan2(imaginary, real)) - 2 * np.pi * frequency_hz / rate_hz * middle,
        start=start,
        stop=stop,
        cycles=(stop - start) / rate_hz * frequency_hz,
        misfit=misfit,
        is_steady=abs(lengths[:half].mean() / lengths[half:].mean() - 1) < STEADY,
    )


# ---- What of it is fitted


@dataclass(frozen=True)
class Segment:
    """Whole cycles of one amplitude at one frequency. Rows are those of the record, and may be
    fractional."""

    amplitude: float  # measured amplitude [rad]
    # the commanded one [Hz] if the recorded one does not differ measurably
    frequency_hz: float
    start: float  # row at which the first cycle begins
    stop: float  # row at which the last one ends
    cycles: int  # number of cycles in between
    commanded: float  # amplitude [rad] in the protocol, or a round one


def find_segments(
    theta: Array, rate_hz: float, sines: Sines, protocol: SteppedSineProtocol
) -> list[Segment]:
    """Find the segments of a joint angle.

    Frequencies, rests, ramps and numbers of cycles are as recorded; the protocol tells which
    amplitudes are meant.

    Parameters
    ----------
    theta : Array
        Angles (n,) [rad].
    rate_hz : float
        Their rate.
    sines : Sines
        What `find_sines` has found in them.
    protocol : SteppedSineProtocol
        What was commanded.

    Returns
    -------
    list of Segment
        In order of time.

    Raises
    ------
    InputError
        There is no sine, or an amplitude is ten times larger or smaller than all commanded ones.
    """
    if not sines.runs:
        commanded_deg = listed_deg(protocol.amplitudes)
        stated = f", the protocol says sines of {commanded_deg} deg" if commanded_deg else ""
        raise InputError(
            f"no sine was found: the joint angle moves by {np.rad2deg(np.ptp(theta)):.3g} deg in"
            f" all{stated}; check the channel and the unit of theta in the source file, and that"
            " the trial is a stepped sine"
        )
    sizes = meant_amplitudes(sines.runs, protocol.amplitudes, rate_hz)
    of_runs = [(run, followed(run.amplitude, sizes, LOST_AMPLITUDE)) for run in sines.runs]
    meant = [(run, size) for run, size in of_runs if size is not None]
    frequencies = common_frequencies([run for run, _ in meant], protocol)
    segments = []
    for (run, size), frequency_hz in zip(meant, frequencies, strict=True):
        # in the middle: the ends of a run may lack a quarter of a cycle
        cycles = int(run.cycles + MISSING_CYCLE)
        length = cycles / frequency_hz * rate_hz
        start = (run.start + run.stop - length) / 2
        turned = run.phase + 2 * np.pi * run.frequency_hz / rate_hz * start
        phase = float(np.angle(1j * np.exp(1j * turned)))
        if abs(phase) < BEGINS_AT_CENTRE:
            start -= phase / (2 * np.pi * frequency_hz) * rate_hz
        start = max(start, 0.0)
        segments.append(
            Segment(
                amplitude=run.amplitude,
                frequency_hz=frequency_hz,
                start=start,
                stop=start + length,
                cycles=cycles,
                commanded=size,
            )
        )
    return segments


def listed_deg(amplitudes: Sequence[float]) -> str:
    return ", ".join(f"{np.rad2deg(amplitude):g}" for amplitude in amplitudes)


def meant_amplitudes(
    runs: Sequence[Run], commanded: Sequence[float], rate_hz: float
) -> list[float]:
    """The amplitudes [rad] that runs were to have; one far from all of them is a warm-up.

    If not all commanded amplitudes were recorded, the protocol may have been another: other runs
    then have their own amplitude to a tenth of a degree. A bench loses some of an amplitude: those
    up to 25 % below a larger one share its. Raises as `find_segments`.
    """
    sizes = list(commanded)
    recorded = {followed(run.amplitude, commanded, LOST_AMPLITUDE) for run in runs}
    if sizes and recorded.issuperset(sizes):
        return sizes
    for run in sorted(runs, key=lambda run: -run.amplitude):
        if followed(run.amplitude, sizes, LOST_AMPLITUDE):
            continue
        ratios = run.amplitude / np.asarray(commanded)
        if (ratios > OTHER_UNIT).all() != (ratios < 1 / OTHER_UNIT).all():
            raise InputError(
                f"the sine of {run.frequency_hz:.4g} Hz at {run.start / rate_hz:.1f} s has an"
                f" amplitude of {np.rad2deg(run.amplitude):.2f} deg, the protocol says"
                f" {listed_deg(commanded)} deg; correct `amplitudes_deg` in the configuration, or"
                " the angle's unit in the source file",
                [Change("", other_unit_of="theta")],
            )
        sizes.append(float(np.deg2rad(round(np.rad2deg(run.amplitude), 1))))
    return sizes


def common_frequencies(runs: Sequence[Run], protocol: SteppedSineProtocol) -> list[float]:
    """The frequency [Hz] of each run, one for all runs that agree to 0.1 %.

    It is the commanded one, or a round one if no protocol is stated, provided that no run slips
    against it by 0.2 % of a cycle. Else it is their mean, as when the clock of the bench is off.
    """
    recorded = np.array([run.frequency_hz for run in runs])
    cycles = np.array([run.cycles for run in runs])
    frequencies = []
    for frequency_hz in recorded:
        similar = np.abs(recorded / frequency_hz - 1) < SAME_RATE
        mean = float(np.average(recorded[similar], weights=cycles[similar] ** 2))
        commanded = protocol.frequency_near(mean) or float(f"{mean:.3g}")
        slip = abs(mean / commanded - 1) * cycles[similar].max()
        frequencies.append(float(commanded) if slip < LARGEST_SLIP else float(f"{mean:.6g}"))
    return frequencies


def labels_deg(segments: Sequence[Segment]) -> list[float]:
    """Find the measured amplitude [deg] that names each segment, to three digits.

    It is the median of all that follow one commanded amplitude.
    """
    amplitude_deg = np.rad2deg([segment.amplitude for segment in segments])
    commanded = np.array([segment.commanded for segment in segments])
    return [float(f"{np.median(amplitude_deg[commanded == each]):.3g}") for each in commanded]
