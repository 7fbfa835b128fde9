"""Groups of crossings with a result each: by the conditions in the sheet, and by timing and direction as measured."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from osl_analysis.measured import check_finite
from osl_analysis.trial import Array
from osl_analysis.walking.conditions import Sheet, gaits_of, gaits_served, label, split_keys
from osl_analysis.walking.crossing import Crossing
from osl_analysis.walking.direction import DOWN, UP
from osl_analysis.walking.group_settings import GroupSettings

CLEAR_GAP = 0.03
"""Gap between onset phases [share of stance] that parts two timings. One timing with an SD of 0.02 has such a gap, with
`FEWEST_BESIDE_GAP` crossings on either side, in about one campaign in a hundred."""
FEWEST_BESIDE_GAP = 3
"""Fewest crossings on either side of a gap that parts timings whose overall SD is that of one timing."""
WIDEST_BIN = 2.0
"""Widest part, in `timing_scatter`, of timings that spread without a gap."""
Names = tuple[str, ...]


@dataclass(frozen=True)
class Place:
    """Where a crossing belongs.

    gaits: names of the mean gaits that it belongs to; one for a perturbed crossing.
    group: name of the group whose result it enters; None for an unperturbed crossing, and for one that is not used.
    direction: `up` or `down`, as the platform turned; None if unperturbed, or without a measured turn.
    onset_phase: onset as a share of the gait's mean stance; None if unperturbed.
    """

    gaits: Names
    group: str | None = None
    direction: str | None = None
    onset_phase: float | None = None


def places(crossings: Sequence[Crossing], sheet: Sheet, settings: GroupSettings) -> dict[str, Place]:
    """Gait and group of every row of the sheet, by name; the groups of the `crossings`, which are those that are used.

    Raises
    ------
    InputError
        As `split_keys`.
    """
    keys = split_keys(sheet, settings)
    gaits = gaits_of(sheet, keys)
    found = {name: Place(tuple(gaits_served(cells, gaits, keys))) for name, cells in sheet.items()}
    perturbed = {gait: [c for c in crossings if c.onset is not None and gait in found[c.name].gaits] for gait in gaits}
    phases = {gait: onset_phases(of, mean_stance(gait, crossings, found)) for gait, of in perturbed.items()}
    parts = {gait: timings(phases[gait], settings.timing_scatter) for gait in gaits}
    timed = "timing" in settings.group_by or (
        "timing" not in settings.pool and any(part.max(initial=0) > 0 for part in parts.values())
    )
    for gait, walked in perturbed.items():
        for crossing, phase, part in zip(walked, phases[gait], parts[gait], strict=True):
            measured: dict[str, object] = {}
            if timed:
                measured["timing"] = f"{100 * np.median(phases[gait][parts[gait] == part]):.0f} %"
            if "direction" in settings.group_by:
                measured["direction"] = direction(crossing) or "unknown"
            group = label({**gaits[gait], **measured})
            found[crossing.name] = Place((gait,), group, direction(crossing), float(phase))
    return found


def direction(crossing: Crossing) -> str | None:
    """`up` if the platform turned the toes up, `down` if down; None if its turn is not known."""
    return None if crossing.turn is None else UP if crossing.turn > 0 else DOWN


def mean_stance(gait: str, crossings: Sequence[Crossing], found: Mapping[str, Place]) -> float | None:
    """Mean stance [s] of the unperturbed crossings of a gait; None without any."""
    own = [c.stance.duration for c in crossings if c.onset is None and gait in found[c.name].gaits]
    return float(np.mean(own)) if own else None


def onset_phases(crossings: Sequence[Crossing], stance: float | None) -> Array:
    """Onsets (n,) as shares of a mean `stance` [s]; of each crossing's own without one."""
    return np.array([((c.onset or 0.0) - c.stance.heel_strike) / (stance or c.stance.duration) for c in crossings])


def timings(phases: Array, scatter: float) -> NDArray[np.intp]:
    """The timing (n,) of each onset phase (n,), counted from 0 in the order of phase.

    Phases are cut at their largest gap, then each part again, while `clear_gap` finds one. A part whose SD is still
    above `scatter` is cut into equal bins of at most twice `scatter`.

    Raises
    ------
    InputError
        A phase is not finite, or far beyond 1.
    """
    check_finite("the phase of an onset", phases)
    numbers, count = np.empty(len(phases), dtype=np.intp), 0
    for rows in parted(phases, np.argsort(phases, kind="stable"), scatter):
        bins = equal_bins(phases[rows], scatter) if wide(phases[rows], scatter) else np.zeros(len(rows), dtype=np.intp)
        numbers[rows] = count + bins
        count += int(bins.max(initial=-1)) + 1
    return numbers


def parted(phases: Array, order: NDArray[np.intp], scatter: float) -> list[NDArray[np.intp]]:
    """The parts between clear gaps of phases (n,), whose indices are given in their `order` (k,)."""
    cut = clear_gap(phases[order], scatter)
    if cut is None:
        return [order]
    return [part for half in (order[:cut], order[cut:]) for part in parted(phases, half, scatter)]


def clear_gap(ordered: Array, scatter: float) -> int | None:
    """Where the largest gap above `CLEAR_GAP` of ordered phases (n,) ends; None without one.

    If their SD is that of one timing, a gap counts only with `FEWEST_BESIDE_GAP` phases or more on either side: one
    crossing alone is no timing.
    """
    least = 1 if wide(ordered, scatter) else FEWEST_BESIDE_GAP
    gaps = np.diff(ordered)[least - 1 : max(len(ordered) - least, 0)]
    if not len(gaps) or gaps.max() <= CLEAR_GAP:
        return None
    return int(np.argmax(gaps)) + least


def wide(phases: Array, scatter: float) -> bool:
    """Whether onset phases (n,) scatter by more than one timing does."""
    return len(phases) > 1 and float(np.std(phases, ddof=1)) > scatter


def equal_bins(phases: Array, scatter: float) -> NDArray[np.intp]:
    """Bin (n,) of each phase (n,): as few equal bins as `WIDEST_BIN` allows; bins without a phase are not counted."""
    low, span = phases.min(), np.ptp(phases)
    count = int(np.ceil(span / (WIDEST_BIN * scatter)))
    raw = np.minimum(((phases - low) / span * count).astype(int), count - 1)
    return np.unique(raw, return_inverse=True)[1]
