# SPDX-License-Identifier: Apache-2.0
"""The record of a trial: what kind of motion it is, and which rows are fitted."""

from collections.abc import Collection, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from osl_analysis.base.errors import Change, InputError, naming
from osl_analysis.base.measured import noise_of
from osl_analysis.base.trial import Array, Trial, parsed_windows
from osl_analysis.bench.bench_settings import SteppedSineAnalysis
from osl_analysis.bench.record import (
    STIFFNESS_ALONE,
    Groups,
    Record,
    Stratum,
    record_of,
    unlike_groups,
    whole_rows,
)
from osl_analysis.signals.filters import HIGHEST_CUTOFF, power_density, runs
from osl_analysis.signals.grid import (
    BRIDGE_MORE,
    UniformSignals,
    uniform_signals,
)
from osl_analysis.signals.plateaus import FEWEST_PARTS
from osl_analysis.spectral.periodic import PeriodicMotion, periodic_motion
from osl_analysis.spectral.stepped_sine import (
    BIN_S,
    MOVING_SHARE,
    Segment,
    SteppedSineProtocol,
    find_segments,
    find_sines,
    moving_bins,
)

SHORTEST_S = 1.0  # s; the shortest piece that is fitted
EDGE_PERIODS = 2.0  # of the cut-off at each end, where the filter depends on padding
LONGEST_PIECE_S = 8.0  # s; longest piece of a spectrum
OUTSIDE_BAND = 0.01  # share of the power that lies below, or above, a band
QUICK = 4.0  # cut-offs of the low-pass for the velocity's sign
LARGE_DEG = 1.0  # deg, beyond the noise of any encoder

BLOCK_S = 1.0  # s; duration of a block: 30 correlation times of a 15 Hz low-pass
# of periods about their mean, above which a motion is not called periodic: a bench leaves 0.01, a
# hand 0.05 to 0.1. Its interval is by the spread of its periods in any case
BENCH_SCATTER = 0.03


def record_of_trial(
    trial: Trial,
    settings: SteppedSineAnalysis,
    windows: str | None = None,
    excitation: str | None = None,
    extra_columns: Collection[str] = (),
) -> Record:
    """The record of a trial.

    Of a stepped sine, nearly all of whose motion is sines, settled cycles are fitted; of any other
    motion, and of a sine of one settled cycle each, all of it.

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
    extra_columns
        Columns of the actuator to be brought on the same rows, as far as the trial has them.

    Raises
    ------
    InputError
        A signal is missing, has no time base, or does not move.
    """
    signals = uniform_signals(trial, ("theta", "torque"), settings, extra_columns)
    excitation = excitation or getattr(settings, "excitation", "stepped_sine")
    if excitation == "auto" and windows:
        excitation = "any"

    def recorded(regular: UniformSignals) -> Record:
        """The record of signals with one reading of their stamps."""
        theta = regular.signals["theta"]
        rate_hz = regular.rate_hz
        noise = noise_of(theta, 2)
        moving = moving_bins(theta, rate_hz, noise)
        if not moving.any():
            raise standstill(theta, rate_hz)
        protocol = SteppedSineProtocol(
            np.deg2rad(settings.amplitudes_deg or ()).tolist(),
            settings.frequencies_hz or (),
            settings.cycles,
        )
        is_stepped = False
        if excitation != "any":
            sines, is_stepped = find_sines(theta, rate_hz, noise, moving, protocol)
        if is_stepped or excitation == "stepped_sine":
            segments = find_segments(theta, rate_hz, sines, protocol)
            groups = cycles_of(
                segments, settings.settle_cycles, regular.usable, bool(protocol.amplitudes)
            )
            if groups.repeat().any() or excitation == "stepped_sine":
                hz = [stratum.frequency_hz for stratum in groups.strata]
                return replace(record_of(regular, settings, groups), band_hz=(min(hz), max(hz)))
        # a sine of one settled cycle each does not repeat itself
        stated_windows = windows or getattr(settings, "windows", None)
        return record_of_motion(regular, moving, settings, stated_windows, not is_stepped)

    with naming(f"trial {trial.name}"):
        record = recorded(signals)
        if not signals.is_decided:
            record = replace(record, with_other_stamps=recorded(signals.with_other_reading()))
    measured = signals.signals
    rate_hz = signals.rate_hz
    same = settings.low_pass
    actuator = {name: same(measured[name], rate_hz) for name in extra_columns if name in measured}
    if "theta_m" in actuator:  # behind a wide filter too, for the velocity's sign
        wide = replace(same, cutoff_hz=min(QUICK * same.cutoff_hz, HIGHEST_CUTOFF * rate_hz))
        actuator["wide_band_theta_m"] = wide(measured["theta_m"], rate_hz)
    return replace(record, actuator=actuator)


def standstill(theta: Array, rate_hz: float) -> InputError:
    """The error of a joint without a motion to fit: its angle (n,) [rad] stands, or moves too
    slowly."""
    range_deg = np.rad2deg(np.ptp(theta))
    if range_deg > LARGE_DEG:
        return InputError(
            f"of {range_deg:.3g} deg, theta changes within {BIN_S:g} s by no more than"
            f" {100 * MOVING_SHARE:g} % or its jumps from row to row: the joint moves too slowly,"
            f" theta is noise, or {rate_hz:.3g} rows per second are too few",
            f"move it by 0.5 to 6 Hz and record 100 per second or more, {STIFFNESS_ALONE}",
            changes=[Change("", other_unit_of="time")],
        )
    return InputError(
        f"the joint does not move: theta turns by {range_deg:.3g} deg in all",
        "check the channel and the unit of theta in the source file, and that this is the"
        " recording of the trial",
    )


def record_of_motion(
    signals: UniformSignals,
    moving: NDArray[np.bool_],
    settings: SteppedSineAnalysis,
    windows: str | None,
    may_repeat: bool = True,
) -> Record:
    """The record of a motion in groups of its periods, if it `may_repeat` itself, or of blocks.
    `moving` are the rows (n,) in which the joint moves."""
    rate = signals.rate_hz
    time = signals.time - signals.time[0]
    moved = time[moving]
    inside = [(moved[0], moved[-1])]
    is_inside = np.ones(len(time), dtype=bool)
    if windows is not None:
        inside = parsed_windows(windows, time[-1])
        is_inside = within(time, inside)
    pieces = fitted_pieces(time, signals.usable, inside, EDGE_PERIODS / settings.cutoff_hz)
    record = record_of(signals, settings, blocks_of(pieces, rate))
    usable = signals.usable & is_inside
    periodic = periodic_motion(record.theta, rate, usable) if may_repeat else None
    groups = periods_of(periodic, rate, record.is_fitted()) if periodic else None
    if periodic and periodic.scatter > BENCH_SCATTER:
        periodic = None
    return replace(
        record, band_hz=band_of(record), periodic=periodic, groups=groups or record.groups
    )


def band_of(record: Record) -> tuple[float, float]:
    """Lowest and highest frequency [Hz] of a motion: 1 % of the angle's power is below the band,
    1 % of the acceleration's above it."""
    derivatives = np.array([record.motion.theta, record.motion.alpha])[:, record.is_fitted()]
    length = min(round(LONGEST_PIECE_S * record.rate_hz), derivatives.shape[1])
    frequency_hz, power = power_density(derivatives, record.rate_hz, length)
    below, up_to = np.cumsum(power[:, 1:], axis=1)
    lowest = np.argmax(below > OUTSIDE_BAND * below[-1])
    highest = np.argmax(up_to > (1 - OUTSIDE_BAND) * up_to[-1])
    return frequency_hz[1:][lowest], frequency_hz[1:][highest]


def within(
    time: Array, windows: Sequence[tuple[float, float]], edge: float = 0.0
) -> NDArray[np.bool_]:
    """Whether times (n,) [s] lie in one of the windows [s], less an edge at both ends."""
    inside = [(time >= start + edge) & (time <= stop - edge) for start, stop in windows]
    return np.any(inside, axis=0)


def fitted_pieces(
    time: Array, usable: NDArray[np.bool_], windows: list[tuple[float, float]], edge: float
) -> list[slice]:
    """Rows of the fitted pieces: windows [s], or from the first to the last motion.

    Two periods of the cut-off at each end are left out (130 ms at 15 Hz). There the filter depends
    on padding, which would change K by 0.05 % and I by 0.4 %.

    Raises
    ------
    InputError
        Nothing moves for long enough.
    """
    is_fitted = runs(within(time, windows, edge) & usable)
    found = [run for run in is_fitted if time[run.stop - 1] - time[run.start] >= SHORTEST_S]
    if not found:
        seconds = sum(stop - start for start, stop in windows)
        raise InputError(
            f"nothing is left to fit: the joint moves for {seconds:.3g} s, of which {edge:.2g} s"
            f" at each end and rows near gaps do not count, and pieces need {SHORTEST_S:g} s",
            "record for longer, and 100 rows per second or more",
        )
    return found


def cycles_of(
    segments: Sequence[Segment],
    settle_cycles: int,
    usable: NDArray[np.bool_],
    stated: bool = True,
) -> Groups:
    """The settled cycles of segments; a stratum is a segment.

    The last cycle is left out, too: into it the zero-phase filter smears the next frequency. One
    cycle is kept in any case. The first edge is a whole row; the others are not rounded: a cycle
    with an extra fraction of a row has another mean than the rest (at 250 and 3 Hz the error of B
    was 5.8 times too large).

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

    Raises
    ------
    InputError
        No cycle of a segment is free of gaps.
    """
    amplitudes_deg = np.rad2deg([segment.amplitude for segment in segments])
    commanded = np.array([segment.commanded for segment in segments])
    cycles = []
    strata = []
    for segment in segments:
        before = min(settle_cycles, segment.cycles - 1)
        after = min(1, segment.cycles - before - 1)
        period = (segment.stop - segment.start) / segment.cycles
        number = np.arange(segment.cycles - before - after)
        first = np.rint(segment.start + before * period) + period * number
        is_usable = [usable[rows].all() for rows in whole_rows(first, first + period)]
        first = first[is_usable]
        if not first.size:
            raise InputError(
                f"no cycle of {np.rad2deg(segment.amplitude):.3g} deg at {segment.frequency_hz:g}"
                " Hz is free of rows near a gap that is too long to be bridged",
                BRIDGE_MORE,
            )
        cycles.append(np.stack([first, first + period]))
        alike_deg = amplitudes_deg[commanded == segment.commanded]
        label = float(f"{np.median(alike_deg):.3g}")
        commanded_deg = round(np.rad2deg(segment.commanded), 9) if stated else None
        strata.append(Stratum(label, segment.frequency_hz, commanded_deg))
    first, stop = np.concatenate(cycles, axis=1)
    number = np.repeat(np.arange(len(cycles)), [each.shape[1] for each in cycles])
    return Groups("cycles", first, np.minimum(stop, len(usable)), number, tuple(strata))


def periods_of(motion: PeriodicMotion, rate_hz: float, usable: NDArray[np.bool_]) -> Groups | None:
    """Groups of about `BLOCK_S` within each period of a motion.

    The same part of each period of a realisation is one stratum. In parts of a quarter of a second
    flicker noise was correlated from one to the next: K was held in 85 %, and is in 93 %
    (multisine of `benchmarks/interval_coverage.py`).

    Returns
    -------
    Groups or None
        None if no part of a period is usable twice.
    """
    parts = max(round(motion.period / BLOCK_S), 1)
    rows_of_part = rate_hz * motion.period / parts
    part = np.arange(parts)
    begin = (rate_hz * motion.begins[:, None] + rows_of_part * part).ravel()
    number = (motion.realisation[:, None] * parts + part).ravel()
    stop = np.minimum(begin + rows_of_part, len(usable))

    is_whole = np.array([usable[rows].all() for rows in whole_rows(begin, stop)])
    chosen = np.flatnonzero(is_whole)[np.argsort(number[is_whole], kind="stable")]
    _, stratum, times = np.unique(number[chosen], return_inverse=True, return_counts=True)
    if not (times > 1).any():
        return None
    return Groups("periods", begin[chosen], stop[chosen], stratum, len(times) * (Stratum(),))


def blocks_of(pieces: Sequence[slice], rate_hz: float, seconds: float = BLOCK_S) -> Groups:
    """Equal blocks of about `seconds` of each piece, or shorter ones of a short recording; all
    are one stratum, without repeats."""
    longest = min(
        seconds * rate_hz, sum(piece.stop - piece.start for piece in pieces) / FEWEST_PARTS
    )
    edges = []
    for piece in pieces:
        number = max(round((piece.stop - piece.start) / longest), 1)
        of_piece = np.linspace(piece.start, piece.stop, number + 1)
        edges.append((of_piece[:-1], of_piece[1:]))
    first, stop = np.concatenate(edges, axis=1)
    return unlike_groups(first, stop)
