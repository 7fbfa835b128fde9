"""The record of a trial: what kind of motion it is, and which rows are fitted."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from osl_analysis.bench.bench_settings import ImpedanceAnalysis, SteppedSineAnalysis
from osl_analysis.bench.identifiability import STIFFNESS_ALONE
from osl_analysis.bench.record import Groups, Label, Record, Stratum, conditioned, joint_angle
from osl_analysis.errors import Change, IdentifiabilityError, InputError, OslAnalysisError
from osl_analysis.measured import visible_step
from osl_analysis.signals import LowPass, Motion, filtered_angle, runs
from osl_analysis.signals.grid import (
    BRIDGE_MORE,
    GapLimits,
    UniformSignals,
    on_one_grid,
    origin,
    uniform_signals,
)
from osl_analysis.spectral.periods import PeriodicMotion, periodic_motion
from osl_analysis.spectral.stepped_sine import (
    BIN_S,
    MOVING_SHARE,
    Segment,
    Sines,
    find_segments,
    find_sines,
    labels_deg,
    moving_bins,
    noise_of,
)
from osl_analysis.stats.power_density import power_density
from osl_analysis.trial import LATE_END_S, Array, Trial, stretches

SHORTEST_S = 1.0  # s; the shortest stretch that is fitted
EDGE_PERIODS = 2.0  # of the cut-off at each end, where the filter depends on padding
SPECTRUM_S = 8.0  # s; longest piece of a spectrum
OUTSIDE_BAND = 0.01  # share of the power that lies below, or above, a band
LARGE_DEG = 1.0  # deg, beyond the noise of any encoder
SMALLEST_SIZE_DEG = 0.5  # deg RMS, of noise that hides a motion
LARGEST_JUMP = 0.1  # of the RMS of the angle from row to row; a motion jumps by less
SMALLER_UNITS_OF_TIME = (
    Change("take a 1000 times smaller `unit` of `time` (ms for s)", {"time": 1e-3}),
    Change("take a million times smaller `unit` of `time` (us for s)", {"time": 1e-6}),
)
NOT_MOVED = "the joint does not move; check the channel of theta in the source file"

STRETCH_S = 1.0  # s; duration of a stretch: 30 correlation times of a 15 Hz low-pass
ALIKE_S = 0.25  # s; time over which a model's misfit is correlated
EDGE_ROUNDING = 1e-6  # rows; edges of parts are sums of numbers that are rounded


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

    In a stepped sine a quarter of the moving time or more is sines, commanded or pure ones.

    Parameters
    ----------
    trial
        Signals of the recording.
    settings
        How it is analysed.
    windows
        Which part is fitted [s], as `2-30 40-62`; states that it is another motion.
    excitation
        Kind of motion, by default from the settings; `auto` decides by the recording.

    Raises
    ------
    InputError
        A signal is missing, has no time base, or does not move.
    """
    signals = uniform_signals(
        trial, ("theta", "torque"), settings.gap_limits, computed=("theta_command",)
    )
    if excitation is None:
        excitation = "stepped_sine"
        if isinstance(settings, ImpedanceAnalysis):
            excitation = settings.excitation
    sines = None
    if excitation != "any" and not (excitation == "auto" and windows):
        sines = find_sines(signals.time, signals["theta"], settings.protocol)
        if excitation == "auto" and not sines.is_stepped:
            sines = None

    def recorded(regular: UniformSignals) -> Record:
        if sines is None:
            assert isinstance(settings, ImpedanceAnalysis)
            return record_of_motion(regular, settings, windows or settings.windows)
        of_signals = sines
        if regular is not signals:
            of_signals = find_sines(regular.time, regular["theta"], settings.protocol)
        return record_of_sines(regular, settings, of_signals)

    try:
        record = recorded(signals)
        assert record.uniform is not None
        other_stamps = record.uniform.other()  # None where all stamps are decided
        if other_stamps is not None:
            record = replace(record, with_other_stamps=recorded(other_stamps))
    except (InputError, IdentifiabilityError) as error:
        words, changes = why_not_fitted(error, signals)
        raise type(error)(f"trial {trial.name}: {words}", changes) from error
    assert record.uniform is not None
    return replace(
        record,
        steps=(resolution(trial, signals, "theta"), resolution(trial, signals, "torque")),
        uniform=with_first_signals(record.uniform),
    )


def resolution(trial: Trial, signals: UniformSignals, column: str) -> float | None:
    """Step of a signal: what the source file states, else what the values show."""
    stated = origin(trial, column).get("resolution")
    if stated:
        return float(stated)
    taken = signals.of(column)
    return visible_step(taken.stream.signals[column][taken.present])


def with_first_signals(uniform: UniformSignals) -> UniformSignals:
    """The signals with that one alone of each device which tells the rows: saves 0.1 GB per
    hour."""
    bare = []
    for taken in uniform.taken:
        name = taken.signals[0]
        first = {name: taken.stream.signals[name]}
        bare.append(replace(taken, stream=replace(taken.stream, signals=first)))
    return replace(uniform, taken=tuple(bare))


def record_of_sines(signals: UniformSignals, settings: SteppedSineAnalysis, sines: Sines) -> Record:
    """The record of the cycles of a stepped sine."""
    protocol = settings.protocol
    segments = find_segments(signals.time, signals["theta"], sines, protocol)
    groups = cycles_of(segments, settings.settle_cycles, signals.usable, bool(protocol.amplitudes))
    frequencies = [stratum.frequency_hz for stratum in groups.strata]
    return conditioned(signals, settings, groups, (min(frequencies), max(frequencies)))


def why_not_fitted(
    error: OslAnalysisError, signals: UniformSignals
) -> tuple[str, Sequence[Change]]:
    """The words of an error of a motion, or of its cause where the joint hardly moves, and what may
    mend it."""
    theta = signals["theta"]
    moving = moving_bins(signals.time, theta)
    range_deg, size_deg, noise_deg = np.rad2deg([np.ptp(theta), theta.std(), noise_of(theta)])
    # motion up to 6 Hz at 50 rows per second jumps by a tenth, and counts for half of the time
    if size_deg > SMALLEST_SIZE_DEG and noise_deg > LARGEST_JUMP * size_deg and moving.mean() < 0.5:
        return (
            f"theta jumps from row to row by {noise_deg:.2g} deg of its {size_deg:.2g} deg RMS: it"
            f" is noise, or {signals.rate_hz:.3g} rows per second are too few for its motion;"
            " record 100 per second or more, or correct the channel of theta in the source file"
        ), error.changes
    if moving.any():
        return str(error), error.changes
    if range_deg > LARGE_DEG:
        return (
            f"the joint moves too slowly: of {range_deg:.3g} deg, theta changes by no more than"
            f" {100 * MOVING_SHARE:g} % within {BIN_S:g} s, at {signals.rate_hz:.3g} rows per"
            f" second; move it by 0.5 to 6 Hz, {STIFFNESS_ALONE}"
        ), SMALLER_UNITS_OF_TIME
    return (
        f"the joint does not move: theta turns by {range_deg:.3g} deg in all; check the channel and"
        " the unit of theta in the source file, and that this is the recording of the trial"
    ), ()


def record_of_motion(
    signals: UniformSignals, settings: ImpedanceAnalysis, windows: str | None
) -> Record:
    """The record of a motion that is no stepped sine, in groups of its periods or of stretches.

    The time base bridges gaps up to a tenth of a period of the fastest motion. That is found first,
    from the signals as they are.
    """
    low_pass, rate = settings.low_pass, signals.rate_hz
    compliance = settings.bench_stiffness.compliance if settings.bench_stiffness else 0.0
    time = signals.time - signals.time[0]
    stated = None if windows is None else stated_windows(windows, float(time[-1]))
    inside = within(time, stated or [(0.0, np.inf)])
    pieces = fitted_pieces(signals, low_pass, stated)
    theta = joint_angle(signals["theta"], signals["torque"], compliance)
    motion = filtered_angle(signals.time, theta, low_pass)
    band = band_of(motion, rate, over_gaps(pieces, inside))

    is_bridged = any(stream["bridged"] for stream in signals.streams)
    if is_bridged or not signals.usable.all():
        highest = min(band[1], settings.cutoff_hz)
        limits = GapLimits(highest, settings.cutoff_hz, settings.time_base.longest_gap_s)
        signals = on_one_grid(signals.taken, limits, signals.trial)
        pieces = fitted_pieces(signals, low_pass, stated)
        theta = joint_angle(signals["theta"], signals["torque"], compliance)

    periodic = periodic_motion(theta, rate, signals.usable & inside)
    groups = None
    if periodic is not None:
        is_fitted = np.zeros(len(signals.time), dtype=bool)
        for piece in pieces:
            is_fitted[piece] = True
        groups = periods_of(periodic, rate, is_fitted)
    record = conditioned(signals, settings, groups or stretches_of(pieces, rate), band)
    return replace(record, periodic=periodic)


def within(
    time: Array, windows: Sequence[tuple[float, float]], edge: float = 0.0
) -> NDArray[np.bool_]:
    """Whether times (n,) [s] lie in one of the windows [s], less an edge at both ends."""
    inside = [(time >= start + edge) & (time <= stop - edge) for start, stop in windows]
    return np.asarray(np.any(inside, axis=0))


def over_gaps(pieces: Sequence[slice], inside: NDArray[np.bool_]) -> list[slice]:
    """From the first to the last of the pieces in each window, with the gaps between them."""
    found: list[slice] = []
    for piece in pieces:
        if found and inside[found[-1].stop : piece.start].all():
            found[-1] = slice(found[-1].start, piece.stop)
        else:
            found.append(piece)
    return found


def fitted_pieces(
    signals: UniformSignals, low_pass: LowPass, stated: list[tuple[float, float]] | None
) -> tuple[slice, ...]:
    """Rows of the fitted stretches: stated windows [s], or from the first to the last motion.

    Two periods of the cut-off at each end are left out (130 ms at 15 Hz). There the filter depends
    on padding, which would change K by 0.05 % and I by 0.4 %.

    Raises
    ------
    InputError
        Nothing moves, or not for long enough.
    """
    time = signals.time - signals.time[0]
    if stated is None:
        moving = np.flatnonzero(moving_bins(time, signals["theta"]))
        if len(moving) == 0:
            raise InputError(NOT_MOVED)
        stated = [(float(time[moving[0]]), float(time[moving[-1]]))]
    edge = EDGE_PERIODS / low_pass.cutoff_hz
    inside = within(time, stated, edge)
    shortest = SHORTEST_S * signals.rate_hz
    found = tuple(run for run in runs(inside & signals.usable) if run.stop - run.start >= shortest)
    if not found:
        seconds = sum(stop - start for start, stop in stated)
        raise InputError(
            f"nothing is left to fit: the joint moves for {seconds:.3g} s, of"
            f" which {edge:.2g} s at each end and rows near gaps do not count, and stretches need"
            f" {SHORTEST_S:g} s; record for longer"
        )
    return found


def stated_windows(text: str, duration: float) -> list[tuple[float, float]]:
    """Windows [s] from the start of a record of some duration [s], stated as `2-30 40-62`.

    Raises
    ------
    InputError
        They are no windows, overlap, or lie beyond the record.
    """
    windows = stretches(text)
    if windows[-1][1] > duration + LATE_END_S:
        raise InputError(
            f"windows '{text}' end at {windows[-1][1]:g} s, the record after {duration:.1f} s"
        )
    return windows


def band_of(motion: Motion, rate_hz: float, stretches: Sequence[slice]) -> tuple[float, float]:
    """Lowest and highest frequency [Hz] of a motion (n,): 1 % of the angle's power is below the
    first, 1 % of the acceleration's above the second. Spectra are means over the stretches, gaps
    bridged, in pieces of up to 8 s."""
    length = min(round(SPECTRUM_S * rate_hz), *(part.stop - part.start for part in stretches))
    frequency = np.fft.rfftfreq(length, 1 / rate_hz)
    of_angle, of_acceleration = np.zeros(len(frequency)), np.zeros(len(frequency))
    for part in stretches:
        weight = part.stop - part.start
        for total, signal in ((of_angle, motion.theta), (of_acceleration, motion.alpha)):
            frequency, power = power_density(signal[part], rate_hz, length)
            total += weight * power
    below, up_to = np.cumsum(of_angle[1:]), np.cumsum(of_acceleration[1:])
    if not below[-1] > 0 or not up_to[-1] > 0:
        raise InputError(NOT_MOVED)
    lowest = np.argmax(below > OUTSIDE_BAND * below[-1])
    highest = np.argmax(up_to > (1 - OUTSIDE_BAND) * up_to[-1])
    return float(frequency[1:][lowest]), float(frequency[1:][highest])


def cycles_of(
    segments: Sequence[Segment],
    settle_cycles: int,
    usable: NDArray[np.bool_],
    stated: bool = True,
) -> Groups:
    """The settled cycles of segments; a stratum is a segment.

    Parameters
    ----------
    segments
        Sines of one frequency and amplitude.
    settle_cycles
        First cycles of each that are left out.
    usable
        Rows (n,) that are not near a gap.
    stated
        Whether commanded amplitudes count.
    """
    cycles = [settled_cycles(segment, settle_cycles, usable) for segment in segments]
    strata = []
    for segment, label in zip(segments, labels_deg(segments), strict=True):
        commanded_deg = None
        if segment.commanded is not None and stated:
            commanded_deg = round(float(np.rad2deg(segment.commanded)), 9)
        strata.append(Stratum(segment.rows, label, segment.frequency_hz, commanded_deg))
    first, stop = np.concatenate(cycles).T
    number = np.repeat(np.arange(len(cycles)), [len(each) for each in cycles])
    return Groups("cycles", first, np.minimum(stop, len(usable)), number, tuple(strata))


def settled_cycles(segment: Segment, settle_cycles: int, usable: NDArray[np.bool_]) -> Array:
    """Rows (k, 2) at which the fitted cycles of a segment begin and end; raises InputError if none
    is free of gaps.

    The last cycle is left out, too: into it the zero-phase filter smears the next frequency. One
    cycle is kept in any case. The first edge is a whole row; the others are not rounded: a cycle
    with an extra fraction of a row has another mean than the rest (at 250 and 3 Hz the error of B
    was 5.8 times too large).
    """
    before = min(settle_cycles, segment.cycles - 1)
    after = min(1, segment.cycles - before - 1)
    period = (segment.stop - segment.start) / segment.cycles
    number = np.arange(segment.cycles - before - after)
    first = np.rint(segment.start + before * period) + period * number
    is_usable = are_usable(first, first + period, usable)
    if not is_usable.any():
        raise InputError(
            f"no cycle of {np.rad2deg(segment.amplitude):.3g} deg at {segment.frequency_hz:g} Hz is"
            f" free of rows near a gap that is too long to be bridged; {BRIDGE_MORE}"
        )
    return np.stack([first, first + period], axis=1)[is_usable]


def are_usable(first: Array, stop: Array, usable: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Which groups from row `first` (m,) to row `stop` have no row that is not usable (n,)."""
    lacking = np.concatenate([[0], np.cumsum(~usable)])
    low = np.floor(first + EDGE_ROUNDING).astype(np.intp)
    high = np.minimum(np.ceil(stop - EDGE_ROUNDING).astype(np.intp), len(usable))
    return np.asarray(lacking[high] == lacking[np.minimum(low, high)])


def periods_of(
    motion: PeriodicMotion, rate_hz: float, usable: NDArray[np.bool_], seconds: float = ALIKE_S
) -> Groups | None:
    """Groups of about `seconds` within each period of a motion.

    The same part of each period of a realisation is one stratum. Noise is correlated for much less
    than `ALIKE_S`.

    Returns
    -------
    Groups or None
        None if fewer than two periods are usable.
    """
    parts = max(round(motion.period / seconds), 1)
    rows_of_period = rate_hz * motion.period
    begins, numbers, strata = [], [], list[Stratum]()
    for realisation in motion.realisations:
        starts = rate_hz * realisation.start + rows_of_period * np.arange(realisation.periods)
        end = min(round(starts[-1] + rows_of_period), len(usable))
        stratum = Stratum(slice(round(starts[0]), end))
        for part in range(parts):
            begins.append(starts + rows_of_period * part / parts)
            numbers.append(np.full(realisation.periods, len(strata)))
            strata.append(stratum)
    begin, number = np.concatenate(begins), np.concatenate(numbers)
    stop = np.minimum(begin + rows_of_period / parts, len(usable))

    is_whole = are_usable(begin, stop, usable)
    members = np.bincount(number[is_whole], minlength=len(strata))
    is_chosen = is_whole & (members[number] > 1)
    if np.count_nonzero(members) < 2 or not is_chosen.any():
        return None
    used, stratum_of = np.unique(number[is_chosen], return_inverse=True)
    kept = tuple(strata[k] for k in used)
    return Groups("periods", begin[is_chosen], stop[is_chosen], stratum_of, kept)


def stretches_of(
    pieces: Sequence[slice], rate_hz: float, seconds: float = STRETCH_S, label: Label = None
) -> Groups:
    """Equal stretches of about `seconds` of each piece; all are one stratum, without repeats."""
    firsts, stops = [], []
    for piece in pieces:
        number = max(round((piece.stop - piece.start) / (seconds * rate_hz)), 1)
        edges = np.linspace(piece.start, piece.stop, number + 1)
        firsts.append(edges[:-1])
        stops.append(edges[1:])
    first, stop = np.concatenate(firsts), np.concatenate(stops)
    whole = Stratum(slice(pieces[0].start, pieces[-1].stop), label)
    return Groups("stretches", first, stop, np.zeros(len(first), dtype=np.intp), (whole,))
