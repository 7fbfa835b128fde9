"""Events of a crossing: stance from the vertical force, onset of a perturbation from the platform's rotation."""

from dataclasses import dataclass

import numpy as np

from osl_analysis.errors import InputError
from osl_analysis.trial import Array
from osl_analysis.walking.settings import Timing

REST_S = 0.1  # Length [s] of the interval before the first motion in which the platform rests
FITTED_NOISE = 25.0  # The start of a rotation is fitted up to this multiple of the noise at rest (standard deviation)
SMALLEST_PART, LARGEST_PART = 0.03, 0.25
"""Limits of the fitted part, as fractions of the whole rotation. A smaller part follows a power of time more closely. A
larger part is less affected by noise."""
FEWEST_FRAMES = 4  # Smallest number of frames of the fitted start that determines its power
POWERS = np.arange(1.0, 4.01, 0.25)  # Powers of time that are tried. 1 is a straight ramp.
START_STEP_S = 0.0002  # Resolution [s] of the onset


@dataclass(frozen=True)
class Stance:
    """One contact of the foot with the plate, from heel strike to toe-off [s]."""

    heel_strike: float
    toe_off: float

    @property
    def duration(self) -> float:
        return self.toe_off - self.heel_strike


def find_stances(time: Array, force: Array, on: float, off: float, shortest: float) -> list[Stance]:
    """Complete stances of at least `shortest` [s] in a vertical force (n,) [N], from where it rises through `on` [N] to
    where it falls through `off` <= `on`, between samples. A NaN keeps the last known state."""
    level = np.where(force > on, 1, np.where(force < off, -1, 0))
    known = np.maximum.accumulate(np.where(level != 0, np.arange(len(level)), -1))
    loaded = (known >= 0) & (level[known] == 1)
    change = np.diff(loaded.astype(int))
    starts, ends = np.flatnonzero(change == 1), np.flatnonzero(change == -1)
    ends = ends[ends > starts[0]] if len(starts) else ends[:0]
    stances = [
        Stance(time_of_level(time, force, s, on), time_of_level(time, force, e, off))
        for s, e in zip(starts.tolist(), ends.tolist(), strict=False)
    ]
    return [s for s in stances if s.duration >= shortest]


def time_of_level(time: Array, values: Array, row: int, level: float) -> float:
    """Time [s] between rows `row` and `row + 1` at which the values pass `level`; the later row's if one is NaN."""
    before, after = values[row], values[row + 1]
    if not np.isfinite(before + after) or before == after:
        return float(time[row + 1])
    share = np.clip((level - before) / (after - before), 0.0, 1.0)
    return float(time[row] + share * (time[row + 1] - time[row]))


def only_stance(stances: list[Stance]) -> Stance:
    """The one stance of a crossing."""
    if len(stances) != 1:
        times = ", ".join(f"{s.heel_strike:.3f}-{s.toe_off:.3f} s" for s in stances) or "none"
        raise InputError(
            f"one stance on the plate is expected, found {times}; check the plate's number, zero and load thresholds, "
            "cut the recording to one crossing, or exclude it in the sheet"
        )
    return stances[0]


def find_onset(time: Array, rotation: Array, threshold: float) -> float | None:
    """Time [s] at which a platform starts to rotate; None if it never rotates by `threshold` [rad]. `rotation` (n,)
    [rad] is positive in the direction of the perturbation, and has not passed the low-pass, which spreads the start to
    earlier times. The first part is fitted as c (t - onset)^p: a straight line through a smooth start is too late by a
    fifth of the ramp."""
    seen = np.isfinite(rotation)
    time, rotation = time[seen], rotation[seen]
    above = np.flatnonzero(rotation > threshold)
    if not len(above):
        return None
    first = int(above[0])
    resting = (time >= time[first] - 2 * REST_S) & (time < time[first] - REST_S)
    if not resting.any():
        raise InputError(
            f"the platform turns at {time[first]:.3f} s, within {2 * REST_S:g} s of the recording's start; start to "
            "record earlier, or exclude the trial"
        )
    turned, noise = rotation - float(np.mean(rotation[resting])), float(np.std(rotation[resting]))
    end = end_of_start(turned[: first + 1], noise, float(np.max(turned)))
    rows = slice(int(np.searchsorted(time, time[end] - 2 * REST_S)), end + 1)
    return float(time[end] + power_law_start(time[rows] - time[end], turned[rows]))


def end_of_start(turned: Array, noise: float, height: float) -> int:
    """The last frame of the fitted start, in a rotation `turned` (n,) [rad] of the whole `height`, with `noise` (SD) at
    rest."""
    level = height * np.clip(FITTED_NOISE * noise / height, SMALLEST_PART, LARGEST_PART)
    visible = max(0.2 * level, 3 * noise)
    end, start = (int(np.flatnonzero(turned[:-1] < limit)[-1]) + 1 for limit in (level, visible))
    return min(max(end, start + FEWEST_FRAMES - 1), len(turned) - 1)


def power_law_start(time: Array, turned: Array) -> float:
    """The start t0 < 0 [s] of the best fit of c (time - t0)^p to `turned` (n,) [rad], by a search over t0 and p."""
    starts = np.arange(-REST_S, -START_STEP_S, START_STEP_S)
    since = np.clip(time - starts[:, None], 0.0, None)
    misfits = []
    for p in POWERS:
        shape = since**p
        size = shape @ turned / np.sum(shape**2, axis=1)
        misfits.append(np.sum((turned - size[:, None] * shape) ** 2, axis=1))
    return float(starts[np.argmin(misfits) % len(starts)])


def check_onset(onset: float | None, stance: Stance, perturbed: bool, timing: Timing) -> None:
    """Refuse an onset [s] that disagrees with what the sheet says, or whose baseline or window leave the stance."""
    if (onset is not None) != perturbed:
        motion = "does not turn" if onset is None else f"turns at {onset:.3f} s"
        raise InputError(
            f"the platform {motion} but the sheet says perturbed = {str(perturbed).lower()}; correct the sheet, "
            "perturbation_deg or the platform markers, or exclude the trial"
        )
    if onset is None:
        return
    span = f"stance {stance.heel_strike:.3f}-{stance.toe_off:.3f} s"
    if not stance.heel_strike < onset < stance.toe_off:
        raise InputError(f"the perturbation starts at {onset:.3f} s, outside {span}; exclude the trial")
    first, last = onset - timing.lead, onset + timing.window
    if first < stance.heel_strike or last > stance.toe_off:
        raise InputError(
            f"baseline and window, {first:.3f}-{last:.3f} s, leave {span}; shorten window_s, baseline_s or guard_s, or "
            "exclude the trial"
        )
