"""Groups of rows of a recording, which later stages fit without knowing what motion it is.

Only the makers of groups differ between motions: cycles of a stepped sine, parts of the periods of
a periodic motion, and stretches of any other.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import compress
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from osl_analysis.spectral import stepped_sine
from osl_analysis.spectral.periods import PeriodicMotion
from osl_analysis.spectral.stepped_sine import whole_rows
from osl_analysis.trial import Array

Label = float | str | None
"""What has a fit of its own: an amplitude [deg], a branch of a belt; None: the whole record."""
STRETCH_S = 1.0  # s; duration of a stretch: 30 correlation times of a 15 Hz low-pass
ALIKE_S = 0.25  # s; time over which a model's misfit is correlated
EDGE_ROUNDING = 1e-6  # rows; edges of parts are sums of numbers that are rounded


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


def cycles_of(
    segments: Sequence[stepped_sine.Segment],
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
    cycles = [stepped_sine.settled_cycles(segment, settle_cycles, usable) for segment in segments]
    strata = []
    for segment, label in zip(segments, stepped_sine.labels_deg(segments), strict=True):
        commanded_deg = None
        if segment.commanded is not None and stated:
            commanded_deg = round(float(np.rad2deg(segment.commanded)), 9)
        strata.append(Stratum(segment.rows, label, segment.frequency_hz, commanded_deg))
    first, stop = np.concatenate(cycles).T
    number = np.repeat(np.arange(len(cycles)), [len(each) for each in cycles])
    return Groups("cycles", first, np.minimum(stop, len(usable)), number, tuple(strata))


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

    # a group counts that has no unusable row
    lacking = np.concatenate([[0], np.cumsum(~usable)])
    low = np.floor(begin + EDGE_ROUNDING).astype(np.intp)
    high = np.minimum(np.ceil(stop - EDGE_ROUNDING).astype(np.intp), len(usable))
    is_whole = lacking[high] == lacking[np.minimum(low, high)]
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
