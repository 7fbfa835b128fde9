"""The stepped sine: what was commanded, the sines that the joint did, and the cycles of them that
are fitted.

A run is a stretch of one frequency and amplitude, whoever commanded it. A segment is the whole
cycles of a run that follows a commanded amplitude.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import scipy
from numpy.typing import NDArray

from osl_analysis.errors import Change, InputError
from osl_analysis.measured import rms, usual_size
from osl_analysis.signals import sampling_rate
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
    cycles: float | Sequence[float]

    @property
    def cycles_at(self) -> tuple[float, ...]:
        """Number of cycles at each frequency; fractional if a time per frequency is commanded."""
        cycles = np.asarray(self.cycles, dtype=float)
        if not cycles.size:
            return ()
        return tuple(np.broadcast_to(cycles, len(self.frequencies_hz)).tolist())

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
        cycles=() if cycles is None else cycles,
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
    """A stretch of one frequency and amplitude.

    Its sine is the real part of phasor exp(2j pi frequency t) about the centre, t the time from the
    first row of the record [s].
    """

    frequency_hz: float
    phasor: complex  # [rad]
    centre: float  # angle [rad] about which the sine goes
    start: float  # time [s] at which it begins
    stop: float  # time [s] at which it ends
    misfit: float  # RMS deviation [rad] of its angle from the sine: harmonics, decay, rounding
    is_steady: bool = True  # whether both halves have one frequency; those of a sweep do not

    @property
    def amplitude(self) -> float:
        """Amplitude [rad]."""
        return abs(self.phasor)

    @property
    def cycles(self) -> float:
        """Number of cycles, not rounded: the ends of a run are known to a few hundredths."""
        return (self.stop - self.start) * self.frequency_hz

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


def find_sines(time: Array, theta: Array, protocol: SteppedSineProtocol) -> Sines:
    """Find the sines in a joint angle.

    Parameters
    ----------
    time, theta : Array
        Uniform times (n,) [s] and angles (n,) [rad].
    protocol : SteppedSineProtocol
        What was commanded.

    Notes
    -----
    Consecutive similar cycles, each from one upward crossing of the centre to the next, make a run,
    whose sine is fitted. A run extends as far as the angle follows its sine, and no other run has
    begun. Rests, ramps, transients and disturbed cycles lie between the runs.
    """
    time = time - time[0]
    moving = moving_bins(time, theta)
    crossings = upward_crossings(time, theta, moving)
    fitted = [fit_run(time, theta, cycles) for cycles in similar_cycles(time, theta, crossings)]
    sines = [run for run in fitted if run is not None]
    ends = [*(run.start for run in sines[1:]), float(time[-1])]
    fewest = int(min((*protocol.cycles_at, FEWEST_RUN_CYCLES)))
    found = []
    in_sines = np.zeros_like(moving)
    earliest = 0.0
    for sine, latest in zip(sines, ends, strict=False):
        run = prolonged(time, theta, sine, earliest, latest)
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
            in_sines |= (time >= run.start) & (time < run.stop)
    is_stepped = bool(in_sines[moving].sum() > LEAST_SINES * moving.sum())
    return Sines(found, moving, is_stepped)


def noise_of(theta: Array) -> float:
    """Standard deviation of the noise of an angle (n,), in its unit, by its second differences; 0
    of two samples."""
    return usual_size(np.diff(theta, 2)) / SECOND_DIFFERENCE if len(theta) > 2 else 0.0


def moving_bins(time: Array, theta: Array) -> NDArray[np.bool_]:
    """Find the rows in which a joint moves, in bins of `BIN_S`.

    Parameters
    ----------
    time, theta : Array
        (n,) [s] and (n,) [rad].

    Returns
    -------
    Array
        Mask (n,). A bin with only rounding or noise of a sensor at rest does not count.
    """
    bins = np.floor((time - time[0]) / BIN_S)
    first_rows = np.flatnonzero(np.diff(bins, prepend=-1))
    turn = np.maximum.reduceat(theta, first_rows) - np.minimum.reduceat(theta, first_rows)
    moves = turn > max(MOVING_SHARE * float(np.ptp(theta)), MOVING_NOISES * noise_of(theta))
    return np.asarray(np.repeat(moves, np.diff(np.append(first_rows, len(theta)))))


def upward_crossings(time: Array, theta: Array, moving: NDArray[np.bool_]) -> Array:
    """Times [s] at which the angle rises through its centre, from below a dead band to above it.

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
    step = time[before + 1] - time[before]
    return np.asarray(time[before] - x[before] * step / (x[before + 1] - x[before]))


def similar_cycles(time: Array, theta: Array, crossings: Array) -> list[Array]:
    """The upward crossings [s] of each stretch of two or more consecutive cycles that are similar
    in frequency and amplitude; a single one may belong to a ramp or a rest."""
    if len(crossings) < 2:
        return []
    rows = np.searchsorted(time, crossings)
    height = (np.maximum.reduceat(theta, rows) - np.minimum.reduceat(theta, rows))[:-1]
    frequency = 1 / np.diff(crossings)
    stretches = []
    start = 0
    for stop in range(1, len(frequency) + 1):
        recent = slice(max(start, stop - RECENT_CYCLES), stop)
        if stop < len(frequency):
            usual_frequency, usual_height = frequency[recent].mean(), height[recent].mean()
            if (
                abs(frequency[stop] / usual_frequency - 1) <= SAME_FREQUENCY
                and abs(height[stop] / usual_height - 1) <= SAME_AMPLITUDE
            ):
                continue
        heights = height[start:stop]
        # a slow ramp stands outside
        usual = start + np.flatnonzero(np.abs(heights / np.median(heights) - 1) < ONE_HEIGHT)
        if len(usual) > 1:
            stretches.append(crossings[usual[0] : usual[-1] + 2])
        start = stop
    return stretches


def fit_run(time: Array, theta: Array, crossings: Array) -> Run | None:
    """Fit a sine through the rows between the first and the last crossing [s]; None if its misfit
    exceeds 0.3 of its RMS."""
    first, last = np.searchsorted(time, crossings[[0, -1]])
    lengths = np.diff(crossings)
    half = len(lengths) // 2
    stride = max((last - first) // (SAMPLES_PER_CYCLE * len(lengths)), 1)
    t, x = time[first:last:stride], theta[first:last:stride]
    if len(t) < FEWEST_SAMPLES:
        return None
    middle = float(t.mean())

    def misfits(sine: Array) -> Array:
        """What a sine of frequency [Hz], complex amplitude and centre leaves of the angle."""
        frequency_hz, real, imaginary, centre = sine
        turned = np.exp(2j * np.pi * frequency_hz * (t - middle))
        return np.asarray(x - centre - (complex(real, imaginary) * turned).real)

    likely = (1 / lengths.mean(), np.ptp(x) / 2, 0.0, x.mean())
    sine = scipy.optimize.least_squares(misfits, likely, method="lm").x
    frequency_hz, real, imaginary, centre = sine.tolist()
    run = Run(
        frequency_hz=frequency_hz,
        phasor=complex(real, imaginary) * np.exp(-2j * np.pi * frequency_hz * middle),
        centre=centre,
        start=float(time[first]),
        stop=float(time[last - 1]),
        misfit=rms(misfits(sine)),
        is_steady=abs(lengths[:half].mean() / lengths[half:].mean() - 1) < STEADY,
    )
    return run if run.misfit <= LARGEST_MISFIT * run.amplitude / np.sqrt(2) else None


def prolonged(time: Array, theta: Array, run: Run, earliest: float, latest: float) -> Run:
    """Prolong a run as far as the angle (n,) follows its sine, between two times [s]."""
    low, first, last, high = np.searchsorted(time, (earliest, run.start, run.stop, latest))
    rows = np.arange(low, high + 1)
    turned = run.phasor * np.exp(2j * np.pi * run.frequency_hz * time[rows])
    deviation = np.abs(theta[rows] - run.centre - turned.real)
    has_left = deviation > PURE_SINE * run.amplitude + 2 * run.misfit
    outside = np.array([low - 1, *rows[has_left], high + 1])
    begin = outside[outside < first][-1] + 1
    end = outside[outside >= last][0] - 1
    return replace(run, start=float(time[begin]), stop=float(time[end]))


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
    time: Array, theta: Array, sines: Sines, protocol: SteppedSineProtocol
) -> list[Segment]:
    """Find the segments of a joint angle.

    Frequencies, rests, ramps and numbers of cycles are as recorded; the protocol tells which
    amplitudes are meant.

    Parameters
    ----------
    time, theta : Array
        Uniform times (n,) [s] and angles (n,) [rad].
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
    rate_hz = sampling_rate(time)
    sizes = meant_amplitudes(sines.runs, protocol.amplitudes)
    of_runs = [(run, followed(run.amplitude, sizes, LOST_AMPLITUDE)) for run in sines.runs]
    meant = [(run, size) for run, size in of_runs if size is not None]
    frequencies = common_frequencies([run for run, _ in meant], protocol)
    segments = []
    for (run, size), frequency_hz in zip(meant, frequencies, strict=True):
        # in the middle: the ends of a run may lack a quarter of a cycle
        cycles = int(run.cycles + MISSING_CYCLE)
        length = cycles / frequency_hz
        start = (run.start + run.stop - length) / 2
        phase = np.angle(1j * run.phasor * np.exp(2j * np.pi * run.frequency_hz * start))
        if abs(phase) < BEGINS_AT_CENTRE:
            start -= float(phase) / (2 * np.pi * frequency_hz)
        start = max(start, 0.0)
        segments.append(
            Segment(
                amplitude=run.amplitude,
                frequency_hz=frequency_hz,
                start=start * rate_hz,
                stop=(start + length) * rate_hz,
                cycles=cycles,
                commanded=size,
            )
        )
    return segments


def listed_deg(amplitudes: Sequence[float]) -> str:
    return ", ".join(f"{np.rad2deg(amplitude):g}" for amplitude in amplitudes)


def meant_amplitudes(runs: Sequence[Run], commanded: Sequence[float]) -> list[float]:
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
                f"the sine of {run.frequency_hz:.4g} Hz at {run.start:.1f} s has an amplitude of"
                f" {np.rad2deg(run.amplitude):.2f} deg, the protocol says {listed_deg(commanded)}"
                " deg; correct `amplitudes_deg` in the configuration, or the angle's unit in the"
                " source file",
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
