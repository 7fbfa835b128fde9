"""Step 3, stance: when the foot is on the plate, from heel strike to toe-off."""

from dataclasses import dataclass

import numpy as np

from osl_analysis.errors import InputError
from osl_analysis.trial import Array
from osl_analysis.walking.walking_settings import CrossingSettings

SINGLE_SUPPORT = (0.2, 0.8)  # phases of stance between which one foot carries the body


@dataclass(frozen=True)
class Stance:
    """One contact of the foot with the plate, from heel strike to toe-off [s]."""

    heel_strike: float
    toe_off: float

    @property
    def duration(self) -> float:
        return self.toe_off - self.heel_strike

    def phase(self, time: Array) -> Array:
        """Times [s] as shares of the stance."""
        return (time - self.heel_strike) / self.duration


def find_stances(time: Array, force: Array, on: float, off: float, shortest: float) -> list[Stance]:
    """Find the complete stances in a vertical force.

    Parameters
    ----------
    time, force : Array
        Times (n,) [s] and vertical force (n,) [N]. A NaN keeps the last known state.
    on, off : float
        A stance begins where the force rises through `on`, and ends where it falls through `off`
        <= `on` [N]. Both instants are interpolated between samples.
    shortest : float
        Shortest stance [s]; shorter contacts are ignored.
    """
    level = np.where(force > on, 1, np.where(force < off, -1, 0))
    last_known = np.maximum.accumulate(np.where(level != 0, np.arange(len(level)), -1))
    loaded = (last_known >= 0) & (level[last_known] == 1)

    change = np.diff(loaded.astype(int))
    heel_strikes = np.flatnonzero(change == 1)
    toe_offs = np.flatnonzero(change == -1)
    # a contact that began before the recording is not complete
    toe_offs = toe_offs[toe_offs > heel_strikes[0]] if len(heel_strikes) else toe_offs[:0]
    stances = [
        Stance(crossing_time(time, force, start, on), crossing_time(time, force, end, off))
        for start, end in zip(heel_strikes.tolist(), toe_offs.tolist(), strict=False)
    ]
    return [stance for stance in stances if stance.duration >= shortest]


def crossing_time(time: Array, force: Array, row: int, level: float) -> float:
    """Time [s] between a row and the next at which the force passes a level; the later if NaN."""
    before, after = force[row], force[row + 1]
    if not np.isfinite(before + after) or before == after:
        return float(time[row + 1])
    share = np.clip((level - before) / (after - before), 0.0, 1.0)
    return float(time[row] + share * (time[row + 1] - time[row]))


def only_stance(
    time: Array, force: Array, settings: CrossingSettings, where: str, remedy: str
) -> Stance:
    """Find the only stance in a vertical force (n,) [N]; `where` and `remedy` are for messages.

    Raises
    ------
    InputError
        There is none, or more than one.
    """
    stances = find_stances(
        time, force, settings.load_on_n, settings.load_off_n, settings.shortest_stance_s
    )
    if len(stances) != 1:
        times = ", ".join(f"{s.heel_strike:.3f}-{s.toe_off:.3f} s" for s in stances) or "none"
        raise InputError(
            f"one stance {where} is expected, found {times}; {remedy}, or exclude it in the sheet"
        )
    return stances[0]
