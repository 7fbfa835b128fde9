"""The guard of a trial's numbers after ingest. Sizes that nothing can reach are refused. Samples of
the joint's angle and torque that leap off the curve of their neighbours are counted.

A flipped bit, a lost or an exchanged block of a file without checksums, and a sensor that fails
look alike in the samples. What did it, no file tells; so the guard only says where to look."""

from collections.abc import Collection
from dataclasses import dataclass

import numpy as np
import polars as pl

from osl_analysis.errors import InputError
from osl_analysis.trial import Array, unit_of

LARGEST_MEASURED = {  # largest possible size of a value, by its SI unit
    "m": 1e3,  # no laboratory is a kilometre long
    "rad": 1e6,  # 160 000 turns
    "rad/s": 1e5,  # a million turns per minute
    "N": 1e6,  # the weight of a hundred tonnes
    # moments of a plate in N*mm declared as N*m pass; the centre of pressure shows that error
    # better
    "N*m": 1e7,
    "A": 1e5,
    "V": 1e6,  # counts of a 16-bit converter declared as V pass
    "N*m/rad": 1e8,
    "N*m*s/rad": 1e8,
    "N*m/kg": 1e6,
    "1": 1e9,  # counts of a converter
}


LARGEST_BEND = 10.0
"""Largest third difference of a sound channel, in units of its usual one. Sound benches, walking
ankles and prosthetic feet reach 5.0; a block of a file that was lost or exchanged usually passes
it."""

USUAL_BEND = 0.99
"""The quantile of a channel's third differences that counts as the usual one. The median would be
zero for a channel that mostly rests, or is coarse. What leaps more often is the channel's own, as a
stepper's steps."""

OFTEN = 0.05  # share of large third differences from which the usual one is large, beside all gaps

SMALLEST_BEND = 1e-3
"""Smallest third difference of a leap, in units of the channel's range. Smaller ones change no K.
Without noise, as in a simulation, the usual third difference may be that of rounding, and each turn
of a slow ramp would pass for a leap."""

LARGEST_TURN = 0.5
"""Largest change of the slope at a leap, in units of the third difference. A leap leaves the slope
as it was. A corner of a sound curve, as where a motion begins or a foot hits, changes it by the
largest of its third differences or more."""

FEWEST_SAMPLES = 400  # of fewer, the four third differences of one leap would be usual ones

LONGEST_STEP = 1.5  # of time, in usual steps: over a longer one rows are missing, a leap is due

MOST_GAPS = 0.01  # share of the steps that may be longer; if more are, the stamps scatter


@dataclass(frozen=True)
class Leaps:
    """Samples of a channel that leap off the curve of their neighbours."""

    column: str
    rows: tuple[int, ...] = ()  # in which they stand among the samples of the channel, from 1
    times: tuple[float, ...] = ()  # [s]

    @property
    def count(self) -> int:
        """Number of leaps: a single wrong number is one, a block of them two."""
        return len(self.times)


def check_sizes(samples: pl.DataFrame, columns: Collection[str]) -> None:
    """Refuse values beyond `LARGEST_MEASURED`, and infinite ones. NaN passes: it marks a value that
    was not seen."""
    time = samples["time"].to_numpy()
    sizes = samples.select(
        pl.max_horizontal(pl.col(column).max(), -pl.col(column).min()).alias(column)
        for column in columns
    )
    for column, largest in sizes.row(0, named=True).items():
        bound = LARGEST_MEASURED[unit_of(column)]
        if (largest or 0.0) > bound:
            values = samples[column].to_numpy()
            beyond = np.abs(values) > bound
            row = int(np.argmax(beyond))
            raise InputError(
                f"{column} is {values[row]:.4g} {unit_of(column)} at {time[row]:.3f} s, and beyond"
                f" ±{bound:g} in {beyond.sum()} of {np.count_nonzero(~np.isnan(values))} samples:"
                " nothing here can be so large; correct its unit or scale in the source file, or"
                " repair the recording or the byte order it states"
            )


def find_leaps(column: str, time: Array, values: Array) -> Leaps:
    """Count the samples of a channel that leap off the curve of their neighbours.

    The curve is told by third differences, which a smooth motion hardly has. They are compared
    with the channel's own usual one, so that neither noise nor a coarse sensor is accused.

    Parameters
    ----------
    column : str
        Name of the channel.
    time : Array
        Times of its samples [s], shape (n,).
    values : Array
        The samples in any unit, shape (n,). NaN is left out.

    Returns
    -------
    Leaps
        Without a count if the channel is short or hardly ever moves.
    """
    nothing = Leaps(column)
    seen = np.isfinite(values)
    time, values = time[seen], values[seen]
    if values.size < FEWEST_SAMPLES:
        return nothing

    bends = np.diff(values, 3)
    sizes = np.abs(bends)
    # hardly a sound channel passes this, and the quantile takes ten times as long
    if np.mean(LARGEST_BEND * sizes > sizes.max()) > OFTEN:
        return nothing
    bends[spans_a_gap(time)] = 0.0
    sizes = np.abs(bends)
    usual = np.quantile(sizes, USUAL_BEND)
    if usual == 0.0:
        return nothing
    limit = max(LARGEST_BEND * usual, SMALLEST_BEND * np.ptp(values))
    far = np.flatnonzero(sizes > limit)

    five_around = np.pad(bends, 2)[far[:, None] + np.arange(5)]
    turns = np.cumsum(five_around, axis=1).sum(axis=1)  # change of slope over five samples
    is_straight_on = np.abs(turns) < LARGEST_TURN * np.abs(bends[far])
    is_middle = np.abs(bends[far]) == np.abs(five_around).max(axis=1)  # others are of the same leap
    leaps = far[is_straight_on & is_middle]
    if not leaps.size:
        return nothing

    # of the samples k to k + 3 of the largest third difference, k + 2 leaps, or the one before
    places = leaps + 2
    rows = np.flatnonzero(seen)[places] + 1
    return Leaps(column, tuple(rows.tolist()), tuple(time[places].tolist()))


def spans_a_gap(time: Array) -> np.ndarray[tuple[int], np.dtype[np.bool_]]:
    """Whether rows are missing among the four samples of each third difference, shape (n - 3,), of
    times (n,) [s]. Stamps that scatter tell no gaps."""
    steps = np.diff(time)
    is_gap = steps > LONGEST_STEP * np.median(steps)
    if np.mean(is_gap) > MOST_GAPS:
        is_gap[:] = False
    return is_gap[:-2] | is_gap[1:-1] | is_gap[2:]
